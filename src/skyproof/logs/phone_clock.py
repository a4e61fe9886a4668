"""Set the hardware clock of a phone to GPS time, and join what it shows over its stops."""

from itertools import pairwise
from typing import Final

import numpy as np

from skyproof.arrays import Integers, Reals
from skyproof.gnss.constants import FASTEST_M_S, MILLISECOND_M, SPEED_OF_LIGHT_M_S
from skyproof.gnss.time import GPS_EPOCH_NS
from skyproof.logs.text import MISSING, Fields

__all__ = ["FIRST_NS", "LAST_NS", "MS_NS", "PhoneClock", "or_zero"]

MS_NS: Final = 1_000_000
FIRST_NS, LAST_NS = (int(np.datetime64(f"{year}-01-01", "ns").astype(np.int64)) for year in (2000, 2200))
_JOINED_S: Final = 600.0  # after which any oscillator may be off by a millisecond


class PhoneClock:
    """What the phone's hardware clock shows, set to GPS time.

    A part is what it runs without a stop; parts are counted from 0. breaks : stops that the phone counted.
    """

    def __init__(self) -> None:
        self.breaks = 0
        self._time_ns: int | None = None
        self._count = 0
        self._bias_ns: int | None = None
        self._since_ns: list[int] = []  # the first label of each part
        self._shifts = np.empty((0, 3))  # `_shift` of each part
        self._last = np.empty((0, 4))  # time (s), part, code (m) and rate (m/s) of the last row of each signal

    def label(self, raw: Fields) -> tuple[Integers, Integers]:
        """Return what the clock shows at each row (n,), and the number of the part; -1 where it has no time."""
        time_ns, full_ns, count = (
            raw.wholes[name] for name in ("TimeNanos", "FullBiasNanos", "HardwareClockDiscontinuityCount")
        )
        first = np.flatnonzero(np.append(True, np.diff(time_ns) != 0)) if time_ns.size else np.empty(0, np.int64)
        sizes = np.diff(np.append(first, time_ns.size))
        sub_ns = or_zero(raw.reals["BiasNanos"])
        columns = [values[first].tolist() for values in (time_ns, full_ns, sub_ns, count)]
        labels = [self._label(*epoch) for epoch in zip(*columns, strict=True)]
        label_ns, part = np.array(labels, np.int64).reshape(-1, 2).repeat(sizes, axis=0).T
        return label_ns, part

    def _label(self, time_ns: int, full_ns: int, sub_ns: float, count: int) -> tuple[int, int]:
        bias_ns = full_ns + round(sub_ns)
        if full_ns in (MISSING, 0) or not FIRST_NS < GPS_EPOCH_NS + time_ns - bias_ns < LAST_NS:
            return 0, -1  # the phone does not know the time
        stopped = self._time_ns is not None and (count != self._count or time_ns < self._time_ns)
        self.breaks += stopped
        if self._bias_ns is None or stopped:
            self._bias_ns = bias_ns
            self._since_ns.append(GPS_EPOCH_NS + time_ns - bias_ns)
        elif abs(bias_ns - self._bias_ns) > MS_NS:
            self._bias_ns += round((bias_ns - self._bias_ns) / MS_NS) * MS_NS
        self._time_ns, self._count = time_ns, count
        return GPS_EPOCH_NS + time_ns - self._bias_ns, len(self._since_ns) - 1

    def run_ms(self, label_ns: Integers, part: Integers) -> Integers:
        """Return for how long the clock has run at rows without a stop."""
        return np.asarray(label_ns - np.array(self._since_ns)[part]) // MS_NS

    def join(
        self, label_ns: Integers, part: Integers, signal: Integers, code_m: Reals, rate_m_s: Reals
    ) -> tuple[Integers, Reals]:
        """Return what a clock that continues over the stops shows less at rows (n,), ns, and its rate, m/s.

        A stop of unknown length, after which the oscillator has another rate, adds the same to all codes and to all
        their rates: the median of what the signals show beyond their last measurement is taken off. What satellites do
        differently stays. The phone's own bias counts where no signal is left. Whole milliseconds are given
        back.
        """
        more = max(int(signal.max(initial=-1)) + 1 - len(self._last), 0)
        self._last = np.vstack([self._last, np.full((more, 4), np.nan)])
        kept = np.flatnonzero((signal >= 0) & np.isfinite(code_m) & (np.abs(rate_m_s) <= FASTEST_M_S))
        order = kept[np.argsort(signal[kept], kind="stable")]
        since_s = (label_ns - (self._since_ns[0] if self._since_ns else 0)) * 1e-9
        rows = np.stack([since_s, part, code_m, rate_m_s], axis=1)[order]
        leads = np.append(True, np.diff(signal[order]) != 0)[: order.size]
        before = np.roll(rows, 1, axis=0)
        before[leads] = self._last[signal[order[leads]]]
        ends = np.append(leads[1:], True)[: order.size]
        self._last[signal[order[ends]]] = rows[ends]
        gap_s = rows[:, 0] - before[:, 0]
        over = np.flatnonzero((gap_s > 0.0) & (gap_s < _JOINED_S) & (before[:, 1] < rows[:, 1]))
        over = over[np.argsort(rows[over, 1], kind="stable")]
        begin = np.searchsorted(rows[over, 1], np.arange(len(self._shifts), len(self._since_ns) + 1))
        for number, (first, stop) in enumerate(pairwise(begin.tolist()), len(self._shifts)):
            chosen = over[first:stop]
            self._shifts = np.vstack([self._shifts, self._shift(number, rows[chosen], before[chosen])])
        began_s, shift_m, drift_m_s = self._shifts[part].T
        moved_m = shift_m + drift_m_s * (since_s - began_s)
        return np.rint(moved_m / SPEED_OF_LIGHT_M_S * 1e9).astype(np.int64), drift_m_s

    def _shift(self, part: int, rows: Reals, before: Reals) -> list[float]:
        """Return when a part began (s), what is taken off its codes then (m) and off their rates (m/s)."""
        began_s = (self._since_ns[part] - self._since_ns[0]) * 1e-9
        if not len(rows):
            return [began_s, 0.0, 0.0]
        then_s, shift_m, drift_m_s = self._shifts[before[:, 1].astype(np.int64)].T
        rate_m_s = before[:, 3] - drift_m_s
        new_m_s = float(np.median(rows[:, 3] - rate_m_s))
        code_m = before[:, 2] - shift_m - drift_m_s * (before[:, 0] - then_s)
        gap_s = rows[:, 0] - before[:, 0]
        over_m = rows[:, 2] - code_m - 0.5 * gap_s * (rate_m_s + rows[:, 3] - new_m_s)
        new_m = float(np.median(over_m - new_m_s * (rows[:, 0] - began_s)))
        return [began_s, new_m - round(new_m / MILLISECOND_M) * MILLISECOND_M, new_m_s]


def or_zero(values: Reals) -> Reals:
    return np.where(np.isnan(values), 0.0, values)
