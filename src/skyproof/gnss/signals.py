"""What a signal is: a description, so that a further signal is a further row and not a further `if`."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from skyproof.gnss.codes import ca_code
from skyproof.gnss.constants import CA_CHIP_RATE_HZ, CA_CODE_LENGTH, L1_HZ

__all__ = ["GPS_L1_CA", "GPS_SATS", "SignalDescription", "prn_of", "sat_name"]

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
    name="GPS L1 C/A", band="L1", code_name="CA", carrier_hz=L1_HZ, chip_rate_hz=CA_CHIP_RATE_HZ,
    code_length=CA_CODE_LENGTH, code=ca_code,
)  # fmt: skip
"""IS-GPS-200N, 3.3.1.1 (carrier), 3.3.2.3 (code), 3.3.3.1 (50 bits a second)."""


def prn_of(sat: str) -> int:
    """5 for "G05". Raises ValueError for anything but a GPS satellite G01 to G32."""
    match = re.fullmatch(r"G(\d\d?)", sat)
    prn = int(match[1]) if match else 0
    if not 1 <= prn <= 32:
        raise ValueError(f"{sat!r} is no GPS satellite; expected G01 to G32")
    return prn


def sat_name(prn: int) -> str:
    """ "G05" for 5. Raises ValueError outside 1 to 32."""
    if not 1 <= prn <= 32:
        raise ValueError(f"PRN {prn} is no GPS satellite; expected 1 to 32")
    return GPS_SATS[prn - 1]
