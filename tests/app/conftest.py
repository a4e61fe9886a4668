"""Scenes and the truth about them, which the tests of this room share."""

import importlib.util
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest


@pytest.fixture(scope="session")
def kit() -> ModuleType:
    """`kit.py` beside this file: tests are no package here, so that it is loaded by its path."""
    name = "app_test_kit"
    spec = importlib.util.spec_from_file_location(name, Path(__file__).with_name("kit.py"))
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def made_once(tmp_path_factory) -> Callable[[str, Callable[[Path], None]], Path]:
    """A folder that is filled once in the whole run, however many processes pytest-xdist runs the tests in."""
    base = tmp_path_factory.getbasetemp()
    base = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base

    def made_once(name: str, fill: Callable[[Path], None]) -> Path:
        folder, done = base / name, base / f"{name}.done"
        try:
            folder.mkdir()
        except FileExistsError:
            deadline_s = time.monotonic() + 1200.0
            while not done.exists() and time.monotonic() < deadline_s:
                time.sleep(0.5)
            assert done.read_text() == "", f"{name} could not be made"
            return folder
        error = "interrupted"
        try:
            fill(folder)
            error = ""
        finally:
            (base / f"{name}.part").write_text(error)
            os.replace(base / f"{name}.part", done)
        return folder

    return made_once
