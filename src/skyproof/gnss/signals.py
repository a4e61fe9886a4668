"""What a signal is: a description, so that a further signal is a further row and not a further `if`."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from skyproof.gnss.codes import ca_code
from skyproof.gnss.constants import CA_CHIP_RATE_HZ, CA_CODE_LENGTH, L1_HZ, SPEED_OF_LIGHT_M_S

__all__ = [
    "GPS_L1_CA",
    "GPS_SATS",
    "SignalDescription",
    "carrier_hz_of",
    "chip_m_of",
    "frequency_number_of",
    "prn_of",
    "rinex_attribute",
    "rinex_signal",
    "sat_name",
    "service_of",
    "time_scale_of",
]

GPS_SATS: Final = tuple(f"G{prn:02d}" for prn in range(1, 33))


@dataclass(frozen=True)
class SignalDescription:
    """Carrier, code and symbol timing of a signal. `code(prn)` gives one period: int8 of shape (code_length,), +-1."""

    name: str
    band: str
    code_name: str
    carrier_hz: float
    chip_rate_hz: float
    code_length: int
    code: Callable[[int], NDArray[np.int8]]
    symbol_s: float = 0.02
    periods_per_symbol: int = 20

    @property
    def period_s(self) -> float:
        """Duration of one code period."""
        return self.code_length / self.chip_rate_hz


GPS_L1_CA: Final = SignalDescription(
    name="GPS L1 C/A",
    band="L1",
    code_name="CA",
    carrier_hz=L1_HZ,
    chip_rate_hz=CA_CHIP_RATE_HZ,
    code_length=CA_CODE_LENGTH,
    code=ca_code,
)
"""IS-GPS-200N, 3.3.1.1 (carrier), 3.3.2.3 (code), 3.3.3.1 (50 bits a second)."""


def prn_of(sat: str) -> int:
    """5 for "G05". Raises ValueError for anything but a GPS satellite G01 to G32."""
    match = re.fullmatch(r"G(\d\d?)", sat)
    prn = int(match[1]) if match else 0
    if not 1 <= prn <= 32:
        raise ValueError(f"{sat!r} is not a GPS satellite; expected G01 to G32")
    return prn


def sat_name(prn: int) -> str:
    """ "G05" for 5. Raises ValueError outside 1 to 32."""
    if not 1 <= prn <= 32:
        raise ValueError(f"PRN {prn} is not a GPS satellite; expected 1 to 32")
    return GPS_SATS[prn - 1]


def time_scale_of(sat: str) -> str:
    """The letter of the system whose time a satellite keeps: GPS's for QZSS and SBAS, else its own."""
    return "G" if sat[0] in "JS" else sat[0]


def service_of(band: str, code: str) -> str:
    """One name for the codes that a receiver may take the same signal by: of a pilot, of its data, or of both at once.

    Receivers call what they tracked by different codes, "C" or "X" on E1, that are one signal with one delay (RINEX
    3.05, tables 4 to 10). A code of which nothing is known is its own service.
    """
    return next((f"{band} {codes}" for codes in _COMPONENTS.get(band, ()) if code in codes.split()), code)


_COMPONENTS: Final = {
    "L1": ("S L X",),
    "L2": ("S L X",),
    "L5": ("I Q X",),
    "E1": ("B C X",),
    "E5a": ("I Q X",),
    "E5b": ("I Q X",),
    "E5": ("I Q X",),
    "E6": ("B C X",),
    "G3": ("I Q X",),
    "B1C": ("1D 1P 1X",),
    "B2a": ("5D 5P 5X",),
    "B2b": ("7D 7P 7Z",),
    "B2ab": ("8D 8P 8X",),
}


# --- names, carriers and chips of all systems' signals (RINEX 3.05, tables 4 to 10)

_BANDS: Final = {
    "G": {"1": "L1", "2": "L2", "5": "L5"},
    "J": {"1": "L1", "2": "L2", "5": "L5", "6": "L6"},
    "E": {"1": "E1", "5": "E5a", "6": "E6", "7": "E5b", "8": "E5"},
    "R": {"1": "G1", "2": "G2", "3": "G3", "4": "G1a", "6": "G2a"},
    "C": {"1": "B1C", "2": "B1", "5": "B2a", "6": "B3", "7": "B2", "8": "B2ab"},
    "S": {"1": "L1", "5": "L5"},
    "I": {"1": "L1", "5": "L5", "9": "S"},
}
_MHZ: Final = {
    "L1": 1575.42,
    "L2": 1227.60,
    "L5": 1176.45,
    "L6": 1278.75,
    "S": 2492.028,
    "E1": 1575.42,
    "E5a": 1176.45,
    "E5b": 1207.14,
    "E5": 1191.795,
    "E6": 1278.75,
    "G3": 1202.025,
    "G1a": 1600.995,
    "G2a": 1248.06,
    "B1C": 1575.42,
    "B1": 1561.098,
    "B2a": 1176.45,
    "B2": 1207.14,
    "B2b": 1207.14,
    "B2ab": 1191.795,
    "B3": 1268.52,
}
_FDMA_MHZ: Final = {"G1": (1602.0, 0.5625), "G2": (1246.0, 0.4375)}  # of number 0, and the step (ICD 5.1, 3.3.1.1)
_CHIPS_MHZ: Final = {
    "G1": 0.511,
    "G2": 0.511,
    "B1": 2.046,
    "B2": 2.046,
    "B3": 10.23,
    "L5": 10.23,
    "E5a": 10.23,
    "E5b": 10.23,
    "E5": 10.23,
    "E6": 5.115,
    "L6": 5.115,
    "G3": 10.23,
    "B2a": 10.23,
    "B2b": 10.23,
    "B2ab": 10.23,
}
_PRECISE: Final = frozenset("PYWDM")


def rinex_signal(system: str, attribute: str, version: float = 3.05) -> tuple[str, str] | None:
    """Band and code of a RINEX 3 signal such as "1C"; None for a band that the system does not have.

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
    if letter == "C" and (band == "L1" or (system == "R" and band in _FDMA_MHZ)):
        return band, "CA"
    return band, letter


def rinex_attribute(sat: str, band: str, code: str) -> str | None:
    """What RINEX 3.05 calls a signal, "1C" for instance; None where it has no name for it."""
    digits = [digit for digit, name in _BANDS.get(sat[0], {}).items() if name == ("B2" if band == "B2b" else band)]
    candidates = [code] if sat[0] == "C" else [digit + ("C" if code == "CA" else code) for digit in digits]
    return next((c for c in candidates if len(c) == 2 and rinex_signal(sat[0], c) == (band, code)), None)


def frequency_number_of(band: str, carrier_hz: float) -> int | None:
    """GLONASS's frequency number of a carrier in its bands G1 and G2; None in any other band."""
    if band not in _FDMA_MHZ or not np.isfinite(carrier_hz):
        return None
    centre_mhz, step_mhz = _FDMA_MHZ[band]
    return round((carrier_hz / 1e6 - centre_mhz) / step_mhz)


def carrier_hz_of(band: str, frequency_number: int | None = None) -> float:
    """Carrier of a band in Hz; of GLONASS's G1 and G2 by the satellite's frequency number, NaN without it."""
    if band in _FDMA_MHZ:
        centre_mhz, step_mhz = _FDMA_MHZ[band]
        return float("nan") if frequency_number is None else 1e6 * (centre_mhz + step_mhz * frequency_number)
    return 1e6 * _MHZ[band]


def chip_m_of(sat: str, band: str, code: str) -> float:
    """Length of a chip in metres, for the noise of code to be expected."""
    rate_mhz = _CHIPS_MHZ.get(band, 1.023)
    if sat[0] == "R" and code == "P":
        rate_mhz = 5.11
    elif sat[0] == "G" and band in ("L1", "L2") and code in _PRECISE:
        rate_mhz = 10.23
    return SPEED_OF_LIGHT_M_S / (1e6 * rate_mhz)
