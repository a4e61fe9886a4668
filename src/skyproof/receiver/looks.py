"""Correlators in looks: a share of the time is enough to see what the peak looks like, and costs that share."""

import math

import numpy as np

from skyproof.arrays import Complexes, ComplexFloats, Integers, Reals
from skyproof.compiled import compiled
from skyproof.receiver import kernels as k

__all__ = ["look_means", "look_turns"]


def look_means(
    before: tuple[Reals, Integers],
    now: tuple[Reals, Integers],
    wipe: Complexes,
    *,
    n_looks: int,
    look_samples: float,
    epoch_samples: float,
    n_taps: int,
) -> ComplexFloats:
    """Mean correlators of the code periods of each look in which all taps were taken, carrier and bits wiped off.

    before, now : as `measurement.measure` takes them. wipe : as it gives them.
    n_looks, look_samples : of the two frames, as many to either side of the absolute sample `epoch_samples`; every look
        begins at a multiple of `look_samples`.

    Returns
    -------
    (n_channels, n_looks, n_taps), NaN where none was taken.
    """
    taps = np.full((wipe.shape[0], n_looks, n_taps), complex(np.nan, np.nan))
    first = math.floor(epoch_samples / look_samples + 0.5) - n_looks // 2
    _look_means(*before, *now, wipe, look_samples, first, taps)
    return taps.astype(np.complex64)


@compiled
def _look_means(
    rows_before: Reals,
    count_before: Integers,
    rows_now: Reals,
    count_now: Integers,
    wipe: Complexes,
    look_samples: float,
    first: int,
    taps: Complexes,
) -> None:
    for channel in range(taps.shape[0]):
        n_before = count_before[channel]
        counts = np.zeros(taps.shape[1])
        for r in range(n_before + count_now[channel]):
            row = rows_before[channel, r] if r < n_before else rows_now[channel, r - n_before]
            look = math.floor(row[k.OUT_START] / look_samples) - first
            if look < 0 or look >= taps.shape[1] or math.isnan(row[k.OUT_TAPS + 2 * taps.shape[2] - 1]):
                continue
            if counts[look] == 0.0:
                taps[channel, look] = 0.0
            counts[look] += 1.0
            for tap in range(taps.shape[2]):
                value = complex(row[k.OUT_TAPS + 2 * tap], row[k.OUT_TAPS + 2 * tap + 1])
                taps[channel, look, tap] += value * wipe[channel, r]
        for look in range(taps.shape[1]):
            if counts[look] > 0.0:
                taps[channel, look] /= counts[look]


def look_turns(
    before: tuple[Reals, Integers],
    now: tuple[Reals, Integers],
    wipe: Complexes,
    *,
    n_looks: int,
    look_samples: float,
    epoch_samples: float,
    n_taps: int,
) -> Reals:
    """By which angle the correlators of each look were turned, data bits aside, (n_channels, n_looks) radians.

    Parameters as of `look_means`. A carrier ahead of its replica's by less than a quarter of a cycle was turned back by
    as much.
    """
    sums = np.zeros((wipe.shape[0], n_looks), np.complex128)
    first = math.floor(epoch_samples / look_samples + 0.5) - n_looks // 2
    _look_turns(*before, *now, wipe, look_samples, first, n_taps, sums)
    return np.where(sums == 0.0, np.nan, np.angle(sums))


@compiled
def _look_turns(
    rows_before: Reals,
    count_before: Integers,
    rows_now: Reals,
    count_now: Integers,
    wipe: Complexes,
    look_samples: float,
    first: int,
    n_taps: int,
    sums: Complexes,
) -> None:
    for channel in range(sums.shape[0]):
        n_before = count_before[channel]
        for r in range(n_before + count_now[channel]):
            row = rows_before[channel, r] if r < n_before else rows_now[channel, r - n_before]
            look = math.floor(row[k.OUT_START] / look_samples) - first
            if look < 0 or look >= sums.shape[1] or math.isnan(row[k.OUT_TAPS + 2 * n_taps - 1]):
                continue
            sums[channel, look] += wipe[channel, r] if wipe[channel, r].real >= 0.0 else -wipe[channel, r]
