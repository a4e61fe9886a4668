"""Names of satellites, and of signals as RINEX calls them (RINEX 3.05, tables 4 to 10)."""

import re
from typing import Final

__all__ = ["GPS_SATS", "prn_of", "rinex_attribute", "rinex_signal", "sat_name", "time_scale_of"]

GPS_SATS: Final = tuple(f"G{prn:02d}" for prn in range(1, 33))
_NUMBERS: Final = {"G": (32, 0), "R": (28, 0), "E": (36, 0), "C": (63, 0), "J": (10, 192), "S": (58, 100), "I": (14, 0)}
"""Highest number of a satellite's name, and what to add for its PRN (RINEX 3.05, 3.5)."""
_LOWEST: Final = {"S": 20}


def prn_of(sat: str) -> int:
    """Return the number by which a satellite's codes are listed: 5 for "G05", 193 for "J01", 120 for "S20".

    Raises ValueError for what is not the name of a satellite.
    """
    match = re.fullmatch(r"([A-Z])(\d\d?)", sat)
    highest, more = _NUMBERS.get(match[1], (0, 0)) if match else (0, 0)
    number = int(match[2]) if match else 0
    if not _LOWEST.get(sat[:1], 1) <= number <= highest:
        named = ", ".join(f"{k}{_LOWEST.get(k, 1):02d} to {k}{last}" for k, (last, _) in _NUMBERS.items())
        raise ValueError(f"{sat!r} is not a satellite; expected {named}")
    return number + more


def sat_name(prn: int) -> str:
    """Return "G05" for 5. Raises ValueError outside 1 to 32."""
    if not 1 <= prn <= 32:
        raise ValueError(f"PRN {prn} is not a GPS satellite; expected 1 to 32")
    return GPS_SATS[prn - 1]


def time_scale_of(sat: str) -> str:
    """Return the letter of the system whose time a satellite keeps: GPS's for QZSS and SBAS, else its own."""
    return "G" if sat[0] in "JS" else sat[0]


_BANDS: Final = {
    "G": {"1": "L1", "2": "L2", "5": "L5"},
    "J": {"1": "L1", "2": "L2", "5": "L5", "6": "L6"},
    "E": {"1": "E1", "5": "E5a", "6": "E6", "7": "E5b", "8": "E5"},
    "R": {"1": "G1", "2": "G2", "3": "G3", "4": "G1a", "6": "G2a"},
    "C": {"1": "B1C", "2": "B1", "5": "B2a", "6": "B3", "7": "B2", "8": "B2ab"},
    "S": {"1": "L1", "5": "L5"},
    "I": {"1": "L1", "5": "L5", "9": "S"},
}
_FDMA: Final = ("G1", "G2")


def rinex_signal(system: str, attribute: str, version: float = 3.05) -> tuple[str, str] | None:
    """Return band and code of a RINEX 3 signal such as "1C"; None for a band that the system has not.

    C/A codes are "CA" (GPS, QZSS, SBAS on L1, GLONASS on G1 and G2), BeiDou's codes keep the band's digit ("2I", "1P"),
    all others are the attribute ("Q"). Version 3.02 wrote BeiDou's B1I as band 1.
    """
    digit, letter = attribute[0], attribute[1:]
    if system == "C" and digit == "1" and (letter in "IQ" or (letter == "X" and 3.015 < version < 3.025)):
        digit = "2"
    band = _BANDS.get(system, {}).get(digit)
    if band is None or not letter:
        return None
    if system == "C":
        return ("B2b" if digit == "7" and letter in "DPZ" else band), digit + letter
    if letter == "C" and (band == "L1" or (system == "R" and band in _FDMA)):
        return band, "CA"
    return band, letter


def rinex_attribute(sat: str, band: str, code: str) -> str | None:
    """Return what RINEX 3.05 calls a signal, "1C" for instance; None where it has no name for it."""
    digits = [digit for digit, name in _BANDS.get(sat[0], {}).items() if name == ("B2" if band == "B2b" else band)]
    candidates = [code] if sat[0] == "C" else [digit + ("C" if code == "CA" else code) for digit in digits]
    return next((c for c in candidates if len(c) == 2 and rinex_signal(sat[0], c) == (band, code)), None)
