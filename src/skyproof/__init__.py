"""skyproof tells true satellite-navigation signals from false ones, and gives the true position and time back.

    import skyproof as sp

    print(sp.inspect("rx1.bin")[0].summary)
    verdict = sp.protect("rx1.bin", "rx2.bin", nav="brdc0010.22n")
    observations = sp.receive("rx1.bin", nav="brdc0010.22n").observations
    made = sp.simulate("takeover", out="scene")
    table = sp.to_dataframe(observations)  # needs skyproof[pandas]
    labelled = sp.to_xarray(observations)  # needs skyproof[xarray]

The vocabulary is `skyproof.records` and `skyproof.verdict`. Frames are ECEF WGS-84, instants are GPS time as
numpy.datetime64[ns], angles are radians inside and degrees where a name ends in _deg, units stand in the names.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from skyproof.app.inspect import inspect
    from skyproof.app.protect import verdict_of as protect
    from skyproof.app.receive import receive
    from skyproof.app.scenes.simulate import simulate
    from skyproof.formats.labelled import to_dataframe, to_xarray

    __version__: str

__all__ = ["inspect", "protect", "receive", "simulate", "to_dataframe", "to_xarray"]

_FROM = {
    "inspect": ("skyproof.app.inspect", "inspect"),
    "protect": ("skyproof.app.protect", "verdict_of"),
    "receive": ("skyproof.app.receive", "receive"),
    "simulate": ("skyproof.app.scenes.simulate", "simulate"),
    "to_dataframe": ("skyproof.formats.labelled", "to_dataframe"),
    "to_xarray": ("skyproof.formats.labelled", "to_xarray"),
}


def __dir__() -> list[str]:
    """The promise, loaded or not, and what every module has."""
    return sorted({*(name for name in globals() if name.startswith("__")), "__version__", *__all__})


def __getattr__(name: str) -> Any:
    """Load a use case when it is first asked for: `skyproof --help` needs none of them."""
    if name == "__version__":
        return import_module("importlib.metadata").version(__name__)
    if name not in _FROM:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, function = _FROM[name]
    return getattr(import_module(module), function)
