"""Correlators in looks: a share of the time is enough to show the peak's shape, at that share of the cost."""

import math

import numpy as np

from skyproof.arrays import Complexes, ComplexFloats, Integers, Reals
from skyproof.compiled import compiled
from skyproof.receiver import kernels as k

__all__ = ["average_looks", "measure_turns"]


def average_looks(
    before: tuple[Reals, Integers],
    now: tuple[Reals, Integers],
    wipe: Complexes,
    *,
    n_looks: int,
    look_samples: float,
    epoch_samples: float,
    n_taps: int,
    columns: tuple[int, int] | None = None,
) -> ComplexFloats:
    """Average the correlators of the code periods of each look with all taps, carrier and bits wiped off.

    before, now : as `measurement.measure` takes them. wipe : as it returns them.
    n_looks, look_samples : of the two frames, as many to either side of the absolute sample `epoch_samples`; every look
        begins at a multiple of `look_samples`.
    columns : of the kernel's output, the first correlator that is averaged, and how many; all taps if None.

    Returns
    -------
    (n_channels, n_looks, n_taps) or as many as asked for, NaN where none was taken.
    """
    column, count = columns or (k.OUT_TAPS, n_taps)
    looks = _assign_looks(before, now, wipe, n_looks, look_samples, epoch_samples, n_taps)
    taps = np.full((wipe.shape[0], n_looks, count), complex(np.nan, np.nan))
    _look_means(*before, *now, wipe, looks, column, taps)
    return taps.astype(np.complex64)


def measure_turns(
    before: tuple[Reals, Integers],
    now: tuple[Reals, Integers],
    wipe: Complexes,
    *,
    n_looks: int,
    look_samples: float,
    epoch_samples: float,
    n_taps: int,
) -> Reals:
    """Return the angle by which the correlators of each look were turned, without data bits, in radians.

    The shape is (n_channels, n_looks).

    Parameters as of `average_looks`. A carrier ahead of its replica's by less than a quarter of a cycle was turned back
    by that much.
    """
    looks = _assign_looks(before, now, wipe, n_looks, look_samples, epoch_samples, n_taps)
    sums = np.zeros((wipe.shape[0], n_looks), np.complex128)
    channels, rows = np.nonzero(looks >= 0)
    turned = wipe[channels, rows]
    np.add.at(sums, (channels, looks[channels, rows]), np.where(turned.real >= 0.0, turned, -turned))
    return np.where(sums == 0.0, np.nan, np.angle(sums))


def _assign_looks(
    before: tuple[Reals, Integers],
    now: tuple[Reals, Integers],
    wipe: Complexes,
    n_looks: int,
    look_samples: float,
    epoch_samples: float,
    n_taps: int,
) -> Integers:
    """Assign each code period to its look, as `wipe` has them; -1 in none, or where not all taps were taken."""
    looks = np.full(wipe.shape, -1)
    first = math.floor(epoch_samples / look_samples + 0.5) - n_looks // 2
    _fill_looks(*before, *now, look_samples, first, n_looks, n_taps, looks)
    return looks


@compiled
def _fill_looks(
    rows_before: Reals,
    count_before: Integers,
    rows_now: Reals,
    count_now: Integers,
    look_samples: float,
    first: int,
    n_looks: int,
    n_taps: int,
    looks: Integers,
) -> None:
    for channel in range(looks.shape[0]):
        n_before = count_before[channel]
        for r in range(n_before + count_now[channel]):
            row = rows_before[channel, r] if r < n_before else rows_now[channel, r - n_before]
            look = math.floor(row[k.OUT_START] / look_samples) - first
            if 0 <= look < n_looks and not math.isnan(row[k.OUT_TAPS + 2 * n_taps - 1]):
                looks[channel, r] = look


@compiled
def _look_means(
    rows_before: Reals,
    count_before: Integers,
    rows_now: Reals,
    count_now: Integers,
    wipe: Complexes,
    looks: Integers,
    column: int,
    taps: Complexes,
) -> None:
    for channel in range(taps.shape[0]):
        n_before = count_before[channel]
        counts = np.zeros(taps.shape[1])
        for r in range(n_before + count_now[channel]):
            look = looks[channel, r]
            if look < 0:
                continue
            if counts[look] == 0.0:
                taps[channel, look] = 0.0
            counts[look] += 1.0
            row = rows_before[channel, r] if r < n_before else rows_now[channel, r - n_before]
            for tap in range(taps.shape[2]):
                value = complex(row[column + 2 * tap], row[column + 2 * tap + 1])
                taps[channel, look, tap] += value * wipe[channel, r]
        for look in range(taps.shape[1]):
            if counts[look] > 0.0:
                taps[channel, look] /= counts[look]
