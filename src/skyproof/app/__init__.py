"""The use cases, callable from Python: what opens inputs, runs the pipeline and writes outputs.

They take a second to load, so that each is loaded when it is first asked for: `app.protect.protect(...)`.
"""

from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from skyproof.app import fleet, init, inspect, protect, receive, verify
    from skyproof.app.scenes import demo, pages, scene_page, simulate

__all__ = ["demo", "fleet", "init", "inspect", "pages", "protect", "receive", "scene_page", "simulate", "verify"]

_OF_SCENES = {"demo", "pages", "scene_page", "simulate"}


def __getattr__(name: str) -> ModuleType:
    """Load a use case when it is first named."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return import_module(f"{__name__}.scenes.{name}" if name in _OF_SCENES else f"{__name__}.{name}")
