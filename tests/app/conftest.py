"""Scenes and the truth about them, which the tests of this room share."""

import importlib.util
import sys
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
