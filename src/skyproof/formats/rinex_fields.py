"""Records of a RINEX observation file as bytes: the kernel that lays out their fields (RINEX 3.05, table A3)."""

from math import copysign, floor, isfinite
from typing import Final

import numpy as np

from skyproof.compiled import compiled

__all__ = ["bound_bytes", "lay_out"]

FIELD: Final = 16
"""Of a value: F14.3, loss of lock, strength."""
_SIGNAL: Final = 4 * FIELD
_BLANK, _MINUS, _POINT, _ZERO, _END = (ord(letter) for letter in " -.0\n")
_SPLIT: Final = 134217729.0  # 2^27 + 1


def bound_bytes(head_bytes: int, slots: "np.ndarray[tuple[int], np.dtype[np.int64]]") -> int:
    """Return how many bytes an epoch's record has at most; slots (s,) of each satellite."""
    return head_bytes + 4 + int(np.sum(4 + _SIGNAL * slots))


@compiled
def _round_thousandths(size):  # type: ignore[no-untyped-def]
    """Round a number from 0 to 1e13 to thousandths, as text is: to nearest, exact halves to even.

    Its product with 1000 is taken with what its rounding loses (T. J. Dekker, Numerische Mathematik 18, 1971).
    """
    product = size * 1000.0
    high = size * _SPLIT
    high -= high - size
    lost = (high * 1000.0 - product) + (size - high) * 1000.0
    whole = floor(product)
    beyond = product - whole
    if beyond > 0.5 or (beyond == 0.5 and (lost > 0.0 or (lost == 0.0 and whole % 2.0 == 1.0))):
        whole += 1.0
    return int(whole)


@compiled
def _put_number(value, out, at):  # type: ignore[no-untyped-def]
    """Write a value as F14.3 into `out` from `at` on, which is blank."""
    remaining, place, digits = _round_thousandths(abs(value)), at + 13, 0
    while remaining > 0 or digits < 4:
        if digits == 3:
            out[place] = _POINT
            place -= 1
        out[place] = _ZERO + remaining % 10
        remaining //= 10
        place -= 1
        digits += 1
    if copysign(1.0, value) < 0.0:
        out[place] = _MINUS


@compiled
def _put_count(count, out, at):  # type: ignore[no-untyped-def]
    """Write a count as I3 into `out` from `at` on, which is blank."""
    place = at + 2
    while place >= at and (count > 0 or place == at + 2):
        out[place] = _ZERO + count % 10
        count //= 10
        place -= 1


@compiled
def lay_out(values, there, indicator, heads, sat_of, names, slot, slots, out):  # type: ignore[no-untyped-def]
    """Write the records of epochs into `out`, and return how many bytes they are. Epochs without a signal have none.

    values (n, c, 4), there (n, c), indicator (n, c) of loss of lock; heads (n, h) bytes of each epoch's line up to the
    number of satellites. sat_of (c,) ascending, names (s, 3) bytes, slots (s,) signals that each satellite has room
    for, slot (c,) which of them a channel is. out : as many bytes as `bound_bytes` says for each epoch.
    """
    at = 0
    for n in range(values.shape[0]):
        count, last = 0, -1
        for c in range(values.shape[1]):
            if there[n, c] and sat_of[c] != last:
                count, last = count + 1, sat_of[c]
        if count == 0:
            continue
        for k in range(heads.shape[1]):
            out[at + k] = heads[n, k]
        at += heads.shape[1]
        out[at : at + 3] = _BLANK
        _put_count(count, out, at)
        out[at + 3] = _END
        at += 4
        first, last = 0, -1
        for c in range(values.shape[1] + 1):
            if c < values.shape[1] and not there[n, c]:
                continue
            if c == values.shape[1] or sat_of[c] != last:
                if last >= 0:  # the line of the satellite before is complete
                    at = first + 3 + _SIGNAL * slots[last]
                    while out[at - 1] == _BLANK:
                        at -= 1
                    out[at] = _END
                    at += 1
                if c == values.shape[1]:
                    break
                first, last = at, sat_of[c]
                out[first : first + 3] = names[last]
                out[first + 3 : first + 3 + _SIGNAL * slots[last]] = _BLANK
            begin = first + 3 + _SIGNAL * slot[c]
            out[begin : begin + _SIGNAL] = _BLANK
            cn0_dbhz = values[n, c, 3]
            strength = _BLANK
            if isfinite(cn0_dbhz):
                strength = _ZERO + int(min(max(cn0_dbhz // 6.0, 1.0), 9.0))
            for k in range(4):
                if isfinite(values[n, c, k]):
                    _put_number(values[n, c, k], out, begin + FIELD * k)
                    if k == 1 and indicator[n, c] > 0:
                        out[begin + FIELD * k + 14] = _ZERO + indicator[n, c]
                    if k < 2:
                        out[begin + FIELD * k + 15] = strength
    return at
