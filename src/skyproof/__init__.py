"""skyproof tells true satellite-navigation signals from false ones, and gives the true position and time back.

    import skyproof as sp

    print(sp.inspect("rx1.bin")[0].summary)
    verdict = sp.protect(["rx1.bin", "rx2.bin"], nav="brdc0010.22n")
    observations = sp.receive("rx1.bin", nav="brdc0010.22n").observations
    made = sp.simulate("takeover", out="scene")

The vocabulary is `skyproof.records` and `skyproof.verdict`. Frames are ECEF WGS-84, instants are GPS time as
numpy.datetime64[ns], angles are radians inside and degrees where a name says so, units stand in the names.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from skyproof.app.inspect import inspect
    from skyproof.app.protect import verdict_of as protect
    from skyproof.app.receive import receive
    from skyproof.app.scenes.simulate import simulate

__all__ = ["inspect", "protect", "receive", "simulate"]

_FROM = {
    "inspect": ("skyproof.app.inspect", "inspect"),
    "protect": ("skyproof.app.protect", "verdict_of"),
    "receive": ("skyproof.app.receive", "receive"),
    "simulate": ("skyproof.app.scenes.simulate", "simulate"),
}


def __getattr__(name: str) -> Any:
    """Load a use case when it is first asked for: `skyproof --help` needs none of them."""
    if name not in _FROM:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, function = _FROM[name]
    return getattr(import_module(module), function)
