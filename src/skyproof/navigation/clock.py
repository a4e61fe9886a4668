"""The receiver's clock moved by whole milliseconds, as receivers do that keep theirs near GPS time, and back."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Instants, Integers, Reals
from skyproof.gnss.constants import MILLISECOND_M, SPEED_OF_LIGHT_M_S
from skyproof.gnss.time import seconds_between
from skyproof.records import ObservationLog, Observations, SignalId

__all__ = ["ClockStep", "ClockSteps", "TimeBreaks", "anchor_label", "find_clock_steps", "remove_clock_steps"]

_WITHIN_M: Final = 150.0
_ACCELERATION_M_S2: Final = 50.0  # of a platform; what it makes of a range within an interval is no step
_LEAST_CHANNELS: Final = 3
_NEIGHBOURS: Final = (-2, -1, 1, 2)


@dataclass(frozen=True, kw_only=True)
class ClockStep:
    """A receiver's clock was set by whole milliseconds; `gpst` is the first epoch by the clock that was set."""

    gpst: np.datetime64
    milliseconds: int


def anchor_label(observations: Observations, clock_bias_s: ArrayLike) -> Observations:
    """Shift the clock label by whole milliseconds, so that it is off by half a millisecond at most.

    With k = round(bias / 1 ms), `gpst` moves back by k ms exactly, the pseudorange by c times k ms, and the carrier by
    the cycles in k ms (whole cycles on L1). The times of transmission and code minus carrier stay the same.

    Parameters
    ----------
    clock_bias_s : what the clock shows minus true time, as in `Fix`. A scalar shifts all epochs alike; an array
        (n_epochs,) each by its own k, which steps by a millisecond where a drifting clock passes a half.

    Raises
    ------
    ValueError : a bias is not finite or the array does not fit the epochs.
    """
    bias_s = np.asarray(clock_bias_s, np.float64)
    if bias_s.shape not in ((), observations.gpst.shape) or not np.all(np.isfinite(bias_s)):
        raise ValueError(
            f"clock_bias_s must be finite, one number or {observations.gpst.size}; got shape {bias_s.shape}"
        )
    shift_ms = np.broadcast_to(np.rint(bias_s * 1e3).astype(np.int64), observations.gpst.shape)
    return replace(
        observations,
        gpst=observations.gpst - shift_ms.astype("timedelta64[ms]"),
        pseudorange_m=observations.pseudorange_m - shift_ms[:, None] * (SPEED_OF_LIGHT_M_S * 1e-3),
        carrier_cyc=observations.carrier_cyc - shift_ms[:, None] * (observations.carrier_hz * 1e-3),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class ClockSteps:
    """(n_epochs,) whole milliseconds by which a receiver's clock was set before each epoch, as pseudoranges and as
    carrier phases have them; receivers differ in that. `elapsed_s` is without them."""

    by_code: Integers
    by_carrier: Integers
    elapsed_s: Reals
    steps: tuple[ClockStep, ...]


def find_clock_steps(log: ObservationLog, stretch_epochs: int = 1024) -> ClockSteps | None:
    """Find the steps of whole milliseconds that a receiver's clock made; None if there are none.

    The clock was set where all pseudoranges step by the same k milliseconds. The rest must be less than 150 m and what
    a platform's acceleration may add.

    The expected change of a range between epochs comes from its Dopplers, or without them from its own rate in the
    intervals around. A false time that steps by just that much is taken for the receiver's, and shows in the clock bias
    alone.
    """
    n = log.gpst.size
    code_ms, carrier_ms = np.zeros((2, n), np.int64)
    rim = max(_NEIGHBOURS) + 1
    for first in range(0, n, stretch_epochs):
        begin, stop = max(first - rim, 0), min(first + stretch_epochs, n)
        o = log.read(begin, stop + rim)
        if o.gpst.size < 2:
            continue
        wavelength_m = SPEED_OF_LIGHT_M_S / o.carrier_hz
        rate_m_s = -wavelength_m * o.doppler_hz
        inner = slice(first - begin, stop - begin)
        code_ms[first:stop] = _count_steps_ms(o.pseudorange_m, rate_m_s, o.elapsed_s)[inner]
        carrier_ms[first:stop] = _count_steps_ms(wavelength_m * o.carrier_cyc, rate_m_s, o.elapsed_s)[inner]
    if not (code_ms.any() or carrier_ms.any()):
        return None
    by_code, gpst = np.cumsum(code_ms), log.gpst
    return ClockSteps(
        by_code=by_code,
        by_carrier=np.cumsum(carrier_ms),
        elapsed_s=log.elapsed_s - by_code * 1e-3,
        steps=tuple(ClockStep(gpst=gpst[k], milliseconds=int(code_ms[k])) for k in np.flatnonzero(code_ms)),
    )


def remove_clock_steps(observations: Observations, steps: ClockSteps, first: int = 0) -> Observations:
    """Remove clock steps, as if the receiver had let its clock run.

    The first epoch is number `first` of the run.

    Labels, pseudoranges and elapsed time move back by the steps, carrier phases where they step too. Times of
    transmission stay what they were.
    """
    rows = slice(first, first + observations.gpst.size)
    by_code, by_carrier = steps.by_code[rows], steps.by_carrier[rows]
    return replace(
        observations,
        gpst=observations.gpst - by_code.astype("timedelta64[ms]"),
        elapsed_s=steps.elapsed_s[rows],
        pseudorange_m=observations.pseudorange_m - by_code[:, None] * MILLISECOND_M,
        carrier_cyc=observations.carrier_cyc - by_carrier[:, None] * (observations.carrier_hz * 1e-3),
    )


class TimeBreaks:
    """Find where a receiver's time breaks, as its epochs come: samples are missing there, or all signals became others.

    The signals' time advances as `elapsed_s` does, but for their Dopplers and the clock's drift. It broke where the
    median of three channels or more leaps by more than 150 m and what a platform's acceleration may add meanwhile.
    Channels that come back one by one after it are none of the next break's.
    """

    def __init__(self) -> None:
        self._labels: list[np.datetime64] = []
        self._zero: np.datetime64 | None = None
        self._signals: tuple[SignalId, ...] = ()
        self._last: tuple[Reals, Reals, Reals] | None = None

    @property
    def gpst(self) -> Instants:
        """Return the labels of the epochs before which the time broke, (n_breaks,)."""
        return np.array(self._labels, "datetime64[ns]")

    def take(self, o: Observations) -> None:
        """Look at epochs that follow those before them; signals may be others."""
        if not o.gpst.size:
            return
        self._zero = o.gpst[0] if self._zero is None else self._zero
        self._follow(o.signals)
        ahead_m = SPEED_OF_LIGHT_M_S * (seconds_between(o.gpst, self._zero) - o.elapsed_s)
        range_m = o.pseudorange_m - ahead_m[:, None]
        rate_m_s = -SPEED_OF_LIGHT_M_S / o.carrier_hz * o.doppler_hz
        begin = 0
        while begin < o.gpst.size:
            known = range_m[begin:], rate_m_s[begin:], np.broadcast_to(o.elapsed_s[begin:, None], range_m[begin:].shape)
            row, self._last = _find_first_break(known, self._last)
            if row is None:
                break
            self._labels.append(o.gpst[begin + row])
            begin, self._last = begin + row, None

    def _follow(self, signals: tuple[SignalId, ...]) -> None:
        """Keep what each signal had last in the order of the signals that come."""
        if self._last is not None and signals != self._signals:
            column_of = {signal: column for column, signal in enumerate(self._signals)}
            columns = np.array([column_of.get(signal, -1) for signal in signals], np.intp)
            range_m, rate_m_s, at_s = (np.append(values, np.nan)[columns] for values in self._last)
            self._last = range_m, rate_m_s, at_s
        self._signals = signals


def _find_first_break(
    rows: tuple[Reals, Reals, Reals], last: tuple[Reals, Reals, Reals] | None
) -> tuple[int | None, tuple[Reals, Reals, Reals]]:
    """Find the first row before which the time broke (None if none did), and each channel's last values.

    rows : ranges, rates and times, (n, n_channels). last : (n_channels,) each, of before.
    """
    n_channels = rows[0].shape[1]
    before = (np.full(n_channels, np.nan),) * 3 if last is None else last
    range_m, rate_m_s, at_s = (np.vstack((earlier_row, after)) for earlier_row, after in zip(before, rows, strict=True))
    present = np.isfinite(range_m) & np.isfinite(rate_m_s)
    number = np.where(present, np.arange(len(present))[:, None], -1)
    latest = np.maximum.accumulate(number, axis=0)
    columns, earlier = np.arange(n_channels), np.maximum(latest[:-1], 0)
    dt_s = at_s[1:] - at_s[earlier, columns]
    by_doppler_m = 0.5 * dt_s * (rate_m_s[1:] + rate_m_s[earlier, columns])
    leap_m = np.where(present[1:] & (latest[:-1] >= 0), range_m[1:] - range_m[earlier, columns] - by_doppler_m, np.nan)
    slack_m = _WITHIN_M + 0.25 * _ACCELERATION_M_S2 * dt_s**2
    median_m = _compute_row_medians(leap_m)
    broken = np.abs(median_m) > _compute_row_medians(np.where(np.isfinite(leap_m), slack_m, np.nan))
    if not broken.any():
        end = np.maximum(latest[-1], 0)
        return None, (range_m[end, columns], rate_m_s[end, columns], at_s[end, columns])
    row = int(np.argmax(broken))
    decided = np.flatnonzero(np.isfinite(median_m[:row]))
    few = slice(int(decided[-1]) + 1 if decided.size else 0, row + 1)  # some come back before there are three
    leapt = np.flatnonzero((np.abs(leap_m[few]) > slack_m[few]).any(axis=1))
    return few.start + int(leapt[0]), before


def _count_steps_ms(range_m: Reals, rate_m_s: Reals, elapsed_s: Reals) -> Integers:
    """Count the milliseconds (n_epochs,) by which all ranges (n_epochs, n_channels) step before each epoch."""
    dt_s = np.diff(elapsed_s)[:, None]
    moved_m = np.diff(range_m, axis=0)
    by_doppler = 0.5 * dt_s * (rate_m_s[1:] + rate_m_s[:-1])
    expected_m = np.where(np.isfinite(by_doppler), by_doppler, _estimate_pace(moved_m / dt_s) * dt_s)
    beyond_m = _compute_row_medians(moved_m - expected_m)
    steps = np.rint(beyond_m / MILLISECOND_M)
    slack_m = _WITHIN_M + 0.25 * _ACCELERATION_M_S2 * dt_s[:, 0] ** 2
    steps[~(np.abs(beyond_m - steps * MILLISECOND_M) < np.minimum(slack_m, 0.25 * MILLISECOND_M))] = 0.0
    return np.append(0, steps.astype(np.int64))


def _estimate_pace(rate_m_s: Reals) -> Reals:
    """Take the median rate (n - 1, n_channels) of the two intervals before each and the two after it."""
    n, padded = len(rate_m_s), np.pad(rate_m_s, ((2, 2), (0, 0)), constant_values=np.nan)
    around = np.stack([padded[2 + k : 2 + k + n] for k in _NEIGHBOURS], axis=-1)
    return _compute_row_medians(around.reshape(-1, len(_NEIGHBOURS)), least=1).reshape(rate_m_s.shape)


def _compute_row_medians(values: Reals, least: int = _LEAST_CHANNELS) -> Reals:
    """Compute medians (n,) of the finite values in each row; NaN for fewer than `least` of them."""
    if values.shape[1] < least:
        return np.full(len(values), np.nan)
    ordered = np.sort(np.where(np.isfinite(values), values, np.nan), axis=1)  # NaN last
    count = np.isfinite(ordered).sum(axis=1)
    low, high = (np.maximum(k, 0)[:, None] for k in ((count - 1) // 2, count // 2))
    middle = 0.5 * (np.take_along_axis(ordered, low, 1) + np.take_along_axis(ordered, high, 1))[:, 0]
    return np.where(count >= least, middle, np.nan)
