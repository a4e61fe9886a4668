"""Cells of RTCM 3 observation messages: MSM4 to MSM7, 1002, 1004, 1010 and 1012 (RTCM 10403.3, 3.5.1 and 3.5.16).

Kernels walk the bits of all messages of a stretch at once.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from skyproof.arrays import Booleans, Integers, Octets, Reals
from skyproof.compiled import compiled
from skyproof.gnss.constants import MILLISECOND_M, SPEED_OF_LIGHT_M_S
from skyproof.gnss.signals import carrier_hz_of, rinex_signal
from skyproof.records import SignalId

__all__ = ["NO_CHANNEL", "ObservedCells", "PhaseTurns", "legacy_cells", "msm_cells", "signal_of"]

NO_CHANNEL: Final = -99
"""In place of a frequency number that is not known."""
SYSTEMS: Final = "GRESJCI"
"""In the order of the message numbers: 107x, 108x, 109x and so on."""
_SIGNALS: Final = {
    "G": "2:1C 3:1P 4:1W 8:2C 9:2P 10:2W 15:2S 16:2L 17:2X 22:5I 23:5Q 24:5X 30:1S 31:1L 32:1X",
    "R": "2:1C 3:1P 8:2C 9:2P",
    "E": "2:1C 3:1A 4:1B 5:1X 6:1Z 8:6C 9:6A 10:6B 11:6X 12:6Z 14:7I 15:7Q 16:7X 18:8I 19:8Q 20:8X 22:5I 23:5Q 24:5X",
    "S": "2:1C 22:5I 23:5Q 24:5X",
    "J": "2:1C 9:6S 10:6L 11:6X 15:2S 16:2L 17:2X 22:5I 23:5Q 24:5X 30:1S 31:1L 32:1X",
    "C": "2:2I 3:2Q 4:2X 8:6I 9:6Q 10:6X 14:7I 15:7Q 16:7X 22:5D 23:5P 24:5X 25:7D 30:1D 31:1P 32:1X",
    "I": "22:5A",
}
"""RINEX name of each bit of the signal mask (tables 3.5-91 to 3.5-108)."""
_OLD_SIGNALS: Final = {(0, 0): "1C", (0, 1): "1P", (1, 0): "2X", (1, 1): "2P", (1, 2): "2D", (1, 3): "2W"}
"""RINEX name of band and code indicator of 1002 and 1004 (DF010, DF016); those of GLONASS are C/A and P."""
_OLD: Final = 40
"""Signal numbers of the old messages begin here, behind the bits of the mask: 4 a band."""

_LOCK_4: Final = np.array([0, *(2 ** (k + 4) for k in range(1, 16))])
_index = np.arange(705)
_step = np.maximum(_index // 32 - 1, 0)
_LOCK_10: Final = (_index - 32 * _step) << _step
_index = np.arange(128)
_step = np.minimum(_index // 24, 5)
_LOCK_7: Final = np.append(
    ((_index - 24 * _step) << _step)[:127] + np.array([24 * (2**k - 1) for k in _step[:127]]), 937
)


def _longest(least: Integers, size: int, unit_ms: int) -> Integers:
    """Return the longest time in ms that a lock can have lasted at each indicator, from the shortest; the last counts
    on without end, and so do indicators without a meaning."""
    longest = np.full(size, least[-1] * unit_ms)
    longest[: least.size - 1] = least[1:] * unit_ms - 1
    return longest


LOCK_4_MS: Final = _longest(_LOCK_4, 16, 1)
LOCK_10_MS: Final = _longest(_LOCK_10, 1024, 1)
LOCK_7_MS: Final = _longest(_LOCK_7, 128, 1000)
"""By DF402, DF407 and DF013 (tables 3.5-74, 3.5-75, 3.4-2)."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ObservedCells:
    """Measurements (n_cells,) in the order of the messages; NaN where a message has none.

    message : number of the message in its list. key : system, satellite and signal, 16, 8 and 8 bits. code_m, phase_m,
    rate_m_s : ranges and range rate. lock_ms : longest time of lock that the indicator allows. longest_ms : to which
    it counts. half_open : half a cycle may be missing. short : messages that are shorter than they say.
    """

    message: Integers
    key: Integers
    code_m: Reals
    phase_m: Reals
    rate_m_s: Reals
    cn0_dbhz: Reals
    lock_ms: Integers
    longest_ms: Integers
    half_open: Booleans
    short: int

    @classmethod
    def of(cls, reals: Reals, integers: Integers, n: int, short: int) -> "ObservedCells":
        """Take the first `n` columns that a kernel filled."""
        code_m, phase_m, rate_m_s, cn0_dbhz = reals[:, :n]
        message, key, lock_ms, longest_ms, half = integers[:, :n]
        return cls(
            message=message,
            key=key,
            code_m=code_m,
            phase_m=phase_m,
            rate_m_s=rate_m_s,
            cn0_dbhz=cn0_dbhz,
            lock_ms=lock_ms,
            longest_ms=longest_ms,
            half_open=half > 0,
            short=int(short),
        )


def signal_of(key: int) -> SignalId | None:
    """Return the signal of a key of `ObservedCells`; None for what has no name here."""
    system, sv, number = SYSTEMS[key >> 16], key >> 8 & 0xFF, key & 0xFF
    if number >= _OLD:
        band, code = divmod(number - _OLD, 4)
        attribute = _OLD_SIGNALS.get((band, code)) if system != "R" else f"{band + 1}{'CP'[code & 1]}"
    else:
        attribute = dict(pair.split(":") for pair in _SIGNALS[system].split()).get(str(number))
    kind = None if attribute is None else rinex_signal(system, attribute)
    sv += 19 if system == "S" else 0  # the first one is PRN 120
    return None if kind is None else SignalId(f"{system}{sv:02d}", *kind)


@compiled
def _bits_at(octets: Octets, at: int, count: int) -> int:
    """Return the number in `count` bits, 32 at most, from bit `at` on."""
    value = 0
    last = (at + count + 7) >> 3
    for k in range(at >> 3, last):
        value = value << 8 | octets[k]
    found: int = (value >> (8 * last - at - count)) & ((1 << count) - 1)
    return found


@compiled
def _read_signed_at(octets: Octets, at: int, count: int) -> int:
    value: int = _bits_at(octets, at, count)
    return value - (1 << count) if value >> (count - 1) else value


def msm_cells(octets: Octets, begin: Integers, size: Integers, number: Integers, channels: Integers) -> ObservedCells:
    """Return the cells of MSM4 to MSM7.

    begin, size : first octet and octets of each content. number : of each message. channels : (64,) GLONASS's
    frequency number by satellite, filled in where the messages say it.
    """
    room = int(size.sum()) * 8 // 48 + 1
    reals, integers = np.empty((4, room)), np.empty((5, room), np.int64)
    n, short = _walk_msm(octets, begin, size, number, LOCK_4_MS, LOCK_10_MS, channels, reals, integers)
    return ObservedCells.of(reals, integers, n, short)


@compiled
def _walk_msm(
    octets: Octets,
    begin: Integers,
    size: Integers,
    number: Integers,
    lock_4_ms: Integers,
    lock_10_ms: Integers,
    channels: Integers,
    reals: Reals,
    integers: Integers,
) -> tuple[int, int]:
    """Fill reals and integers as `ObservedCells.of` takes them; return how many cells there are, and short messages."""
    sats, signals = np.empty(64, np.int64), np.empty(32, np.int64)
    rough_ms, rough_m_s = np.empty(64), np.empty(64)
    n, short = 0, 0
    for m in range(begin.size):
        at, n_bits = 8 * begin[m], 8 * size[m]
        kind, system = number[m] % 10, (number[m] - 1070) // 10
        if n_bits < 169:
            short += 1
            continue
        n_sats, n_signals = 0, 0
        for k in range(64):
            if _bits_at(octets, at + 73 + k, 1):
                sats[n_sats] = k + 1
                n_sats += 1
        for k in range(32):
            if _bits_at(octets, at + 137 + k, 1):
                signals[n_signals] = k + 1
                n_signals += 1
        n_masked = n_sats * n_signals
        if n_masked > 64 or n_bits < 169 + n_masked:
            short += 1
            continue
        n_cells = 0
        for k in range(n_masked):
            n_cells += _bits_at(octets, at + 169 + k, 1)
        with_rates, fine = kind == 5 or kind == 7, kind >= 6
        code_bits, phase_bits, lock_bits, cn0_bits = (20, 24, 10, 10) if fine else (15, 22, 4, 6)
        code_ms, phase_ms = (2.0**-29, 2.0**-31) if fine else (2.0**-24, 2.0**-29)
        of_sats = n_sats * (36 if with_rates else 18)
        of_cell = code_bits + phase_bits + lock_bits + 1 + cn0_bits + (15 if with_rates else 0)
        if n_bits < 169 + n_masked + of_sats + n_cells * of_cell:
            short += 1
            continue
        first = at + 169 + n_masked
        mod = first + (12 if with_rates else 8) * n_sats
        for s in range(n_sats):
            whole_ms = _bits_at(octets, first + 8 * s, 8)
            rough_ms[s] = np.nan if whole_ms == 255 else whole_ms + _bits_at(octets, mod + 10 * s, 10) / 1024.0
            if with_rates:
                rate = _read_signed_at(octets, mod + 10 * n_sats + 14 * s, 14)
                rough_m_s[s] = np.nan if rate == -8192 else rate
                channel = _bits_at(octets, first + 8 * n_sats + 4 * s, 4)
                if system == 1 and channel <= 13 and sats[s] < channels.size:
                    channels[sats[s]] = channel - 7
            else:
                rough_m_s[s] = np.nan
        code_at = first + of_sats
        phase_at = code_at + n_cells * code_bits
        lock_at = phase_at + n_cells * phase_bits
        half_at = lock_at + n_cells * lock_bits
        cn0_at = half_at + n_cells
        rate_at = cn0_at + n_cells * cn0_bits
        cell = 0
        for k in range(n_masked):
            if not _bits_at(octets, at + 169 + k, 1):
                continue
            s = k // n_signals
            code = _read_signed_at(octets, code_at + cell * code_bits, code_bits)
            phase = _read_signed_at(octets, phase_at + cell * phase_bits, phase_bits)
            unknown = -(1 << (code_bits - 1))
            reals[0, n] = np.nan if code == unknown else (rough_ms[s] + code * code_ms) * MILLISECOND_M
            unknown = -(1 << (phase_bits - 1))
            reals[1, n] = np.nan if phase == unknown else (rough_ms[s] + phase * phase_ms) * MILLISECOND_M
            reals[2, n] = np.nan
            if with_rates:
                rate = _read_signed_at(octets, rate_at + cell * 15, 15)
                if rate != -16384:
                    reals[2, n] = rough_m_s[s] + 1e-4 * rate
            cn0 = _bits_at(octets, cn0_at + cell * cn0_bits, cn0_bits)
            reals[3, n] = np.nan if cn0 == 0 else (cn0 / 16.0 if fine else cn0)
            lock = _bits_at(octets, lock_at + cell * lock_bits, lock_bits)
            integers[0, n] = m
            integers[1, n] = system << 16 | sats[s] << 8 | signals[k % n_signals]
            integers[2, n] = lock_10_ms[lock] if fine else lock_4_ms[lock]
            integers[3, n] = lock_10_ms[-1] if fine else lock_4_ms[-1]
            integers[4, n] = _bits_at(octets, half_at + cell, 1)
            n += 1
            cell += 1
    return n, short


# ---------------------------------------------------------------------- 1002, 1004, 1010, 1012


class PhaseTurns:
    """Remembers, by system, satellite and band, how far the old messages' phases were from their codes.

    They state phase less code within 1500 cycles, which begin again where they overflow (DF012).
    """

    def __init__(self) -> None:
        self.last_cyc = np.full((2, 64, 2), np.nan)


_HZ_OF_GPS: Final = np.array([carrier_hz_of("L1"), carrier_hz_of("L2")])
_HZ_OF_GLONASS: Final = np.array([[carrier_hz_of(band, k) for k in range(-7, 14)] for band in ("G1", "G2")])


def legacy_cells(
    octets: Octets, begin: Integers, size: Integers, number: Integers, channels: Integers, turns: PhaseTurns
) -> ObservedCells:
    """Return the cells of 1002, 1004, 1010 and 1012, as `msm_cells`."""
    room = int(size.sum()) * 8 // 62 + 1
    reals, integers = np.empty((4, room)), np.empty((5, room), np.int64)
    n, short = _walk_legacy(
        octets,
        begin,
        size,
        number,
        LOCK_7_MS,
        _HZ_OF_GPS,
        _HZ_OF_GLONASS,
        channels,
        turns.last_cyc,
        reals,
        integers,
    )
    return ObservedCells.of(reals, integers, n, short)


@compiled
def _walk_legacy(
    octets: Octets,
    begin: Integers,
    size: Integers,
    number: Integers,
    lock_ms: Integers,
    hz_of_gps: Reals,
    hz_of_glonass: Reals,
    channels: Integers,
    last_cyc: Reals,
    reals: Reals,
    integers: Integers,
) -> tuple[int, int]:
    n, short = 0, 0
    for m in range(begin.size):
        at, end = 8 * begin[m], 8 * (begin[m] + size[m])
        glonass, codes = number[m] >= 1009, number[m] % 4 == 0
        header = 61 if glonass else 64
        of_sat = (79 if glonass else 74) + (51 if codes else 0)
        if at + header > end:
            short += 1
            continue
        n_sats = _bits_at(octets, at + header - 9, 5)
        if at + header + n_sats * of_sat > end:
            short += 1
            continue
        for s in range(n_sats):
            k = at + header + s * of_sat
            sv, code = _bits_at(octets, k, 6), _bits_at(octets, k + 6, 1)
            k += 7
            system, hz_1, hz_2, unit_m = 0, hz_of_gps[0], hz_of_gps[1], MILLISECOND_M
            if glonass:
                system, unit_m = 1, 2.0 * MILLISECOND_M
                channel = _bits_at(octets, k, 5)
                k += 5
                if channel > 20:
                    continue
                hz_1, hz_2 = hz_of_glonass[0, channel], hz_of_glonass[1, channel]
                if 1 <= sv <= 24 and channel <= 13:
                    channels[sv] = channel - 7
            elif sv >= 40:
                system, sv = 3, sv - 39
            if sv < 1 or (glonass and sv > 24):
                continue
            range_bits = 25 if glonass else 24
            modulus_bits = 7 if glonass else 8
            fraction = _bits_at(octets, k, range_bits)
            apart = _read_signed_at(octets, k + range_bits, 20)
            lock = _bits_at(octets, k + range_bits + 20, 7)
            k += range_bits + 27
            whole = _bits_at(octets, k, modulus_bits)
            cn0 = _bits_at(octets, k + modulus_bits, 8)
            k += modulus_bits + 8
            code_m = 0.02 * fraction + whole * unit_m
            integers[0, n] = m
            integers[1, n] = system << 16 | sv << 8 | (_OLD + code)
            reals[0, n] = code_m
            reals[1, n] = code_m + _unwrap_m(apart, hz_1, last_cyc[1 if glonass else 0, sv], 0)
            reals[3, n] = np.nan if cn0 == 0 else 0.25 * cn0
            integers[2, n] = lock_ms[lock]
            n += 1
            if not codes:
                continue
            code = _bits_at(octets, k, 2)
            more = _read_signed_at(octets, k + 2, 14)
            apart = _read_signed_at(octets, k + 16, 20)
            lock, cn0 = _bits_at(octets, k + 36, 7), _bits_at(octets, k + 43, 8)
            if more == 0 and apart == 0 and cn0 == 0:  # as some fill in what they did not measure
                continue
            integers[0, n] = m
            integers[1, n] = system << 16 | sv << 8 | (_OLD + 4 + code)
            reals[0, n] = np.nan if more == -8192 else code_m + 0.02 * more
            reals[1, n] = code_m + _unwrap_m(apart, hz_2, last_cyc[1 if glonass else 0, sv], 1)
            reals[3, n] = np.nan if cn0 == 0 else 0.25 * cn0
            integers[2, n] = lock_ms[lock]
            n += 1
    reals[2, :n] = np.nan
    integers[3, :n] = lock_ms[-1]
    integers[4, :n] = 0
    return n, short


@compiled
def _unwrap_m(apart: int, carrier_hz: float, last_cyc: Reals, band: int) -> float:
    """Return phase less code in metres, with turns of 1500 cycles that make it continuous; NaN without one."""
    if apart == -524288:
        return np.nan
    wavelength_m = SPEED_OF_LIGHT_M_S / carrier_hz
    apart_cyc = 0.0005 * apart / wavelength_m
    if not np.isnan(last_cyc[band]):
        apart_cyc += 1500.0 * np.round((last_cyc[band] - apart_cyc) / 1500.0)
    last_cyc[band] = apart_cyc
    return apart_cyc * wavelength_m
