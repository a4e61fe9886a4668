"""The description of a signal: a further signal is a further plan, and not a further `if`."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Booleans, Integers
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.lnav import How, Subframe

__all__ = ["MessageDecoder", "SignalPlan"]

Bits = NDArray[np.int8]


def _refuse_code(prn: int) -> NDArray[np.int8]:
    raise ValueError(f"the code of PRN {prn} is not known: the signal is not received from samples")


@dataclass(frozen=True, kw_only=True)
class MessageDecoder:
    """Read a message from a channel's bits, 0 or 1, of either polarity.

    frame_bits, head_bits, word_bits : of a complete frame, of the head that states its time, of a word with parity.
    find_frames : bits (n,) to where frames start. read_time, read_frame : the head or the whole of a frame to what it
        states, None where it does not hold. keeps : whether the receiver uses a frame's fields.
    sign_words : as `gnss.lnav.find_word_signs`.
    """

    frame_bits: int
    head_bits: int
    word_bits: int
    find_frames: Callable[[Bits], list[int]]
    read_time: Callable[[Bits], How | None]
    read_frame: Callable[[Bits], Subframe | None]
    keeps: Callable[[Subframe], bool]
    sign_words: Callable[[Bits, int], tuple[Integers, Booleans, Bits]]


@dataclass(frozen=True, kw_only=True)
class SignalPlan:
    """Describe a signal that satellites send: carrier, code, symbols, message.

    systems : letters of the systems whose satellites send it. band, codes : as receivers name it (`SignalId`). Several
    codes are components of one signal; a receiver takes one or both (RINEX 3.05, tables 4 to 10).
    carrier_hz : nominal; where satellites have frequency numbers, that of number 0. carrier_step_hz : from number to
        number; 0 without them.
    chip_rate_hz : of the code; of two codes that alternate chip by chip, of both together.
    code_length : chips of the primary code; 0 of a code without a short period. secondary_length : primary periods of
        the longest secondary code; 1 without one.
    symbol_s : of the symbols that are sent; 0 of a signal whose message is not open. message : its name.
        decoder : of its bits; None where no samples of the signal are received.
    code : one period of the primary code of a PRN, int8 of shape (code_length,), +-1. It raises ValueError for a PRN
        without a code, and for all where no samples of the signal are received.
    strongest_dbw : received in an antenna of 0 dBi at most; where not stated, that of the strongest, Galileo's E5 and
    GPS's L5.
    highest_side_lobe : of the primary codes with each other, and of one with itself beyond a chip, as a share of the
        peak's amplitude; NaN where not known.
    """

    name: str
    systems: str
    band: str
    codes: tuple[str, ...]
    carrier_hz: float
    carrier_step_hz: float = 0.0
    chip_rate_hz: float
    code_length: int = 0
    secondary_length: int = 1
    symbol_s: float = 0.0
    message: str = ""
    decoder: MessageDecoder | None = None
    code: Callable[[int], NDArray[np.int8]] = _refuse_code
    strongest_dbw: float = -148.0
    highest_side_lobe: float = float("nan")

    @property
    def has_code(self) -> bool:
        """Return whether the chips of its codes are known."""
        return self.code is not _refuse_code

    @property
    def chip_m(self) -> float:
        """Return the length of a chip, metres."""
        return SPEED_OF_LIGHT_M_S / self.chip_rate_hz

    @property
    def period_s(self) -> float:
        """Return the duration of one period of the primary code."""
        return self.code_length / self.chip_rate_hz

    @property
    def period_ms(self) -> int:
        """Return the duration of one period of the primary code in milliseconds, as times of week count."""
        return round(1000.0 * self.period_s)

    @property
    def periods_per_symbol(self) -> int:
        """Return the number of periods of the primary code in a symbol."""
        return round(self.symbol_s / self.period_s)
