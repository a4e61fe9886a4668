"""The generator of measurements that the tests of this room share."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest


@pytest.fixture(scope="session")
def sky() -> ModuleType:
    """`sky.py` beside this file: tests are no package here, so that it is loaded by its path."""
    name = "navigation_test_sky"
    spec = importlib.util.spec_from_file_location(name, Path(__file__).with_name("sky.py"))
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module
