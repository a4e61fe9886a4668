"""What shares a part of the spectrum: signals on one carrier, and the front end's chain that receives it."""

from typing import Final

from skyproof.records import SignalId

__all__ = ["carrier_name", "chain_covers"]

_CARRIERS: Final = {
    "L1": "L1",
    "E1": "L1",
    "B1C": "L1",
    "L5": "L5",
    "E5a": "L5",
    "B2a": "L5",
    "E5b": "E5b",
    "B2": "E5b",
    "B2b": "E5b",
    "E5": "E5",
    "B2ab": "E5",
    "E6": "E6",
    "L6": "E6",
}
_UPPER: Final = frozenset({"L1", "B1", "G1", "G1a"})
"""Carriers from 1559 to 1610 MHz; the others lie from 1164 to 1300 MHz."""
_UPPER_NAMES: Final = ("L1", "E1", "B1", "G1")
_LOWER_NAMES: Final = ("L2", "L5", "L6", "E5", "E6", "B2", "B3", "G2", "G3")


def carrier_name(signal: SignalId) -> str:
    """Name the carrier of a signal: by GPS's name where other systems share it."""
    return _CARRIERS.get(signal.band, signal.band)


def chain_covers(chain: str, carrier: str) -> bool:
    """Tell whether a front end's chain, named as `FrontEndLevels.band`, may receive a carrier; yes where not known."""
    upper, lower = (any(name in chain for name in names) for names in (_UPPER_NAMES, _LOWER_NAMES))
    if not (upper or lower):
        return True
    return upper if carrier in _UPPER else lower
