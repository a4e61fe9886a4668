"""Correlate a signal behind the front end with a receiver's replica, over a whole code period, from the spectra.

The result is the mean over where samples fall within chips. Aliases of sharp chips are left out.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from skyproof.arrays import Reals
from skyproof.gnss.signals import SignalPlan
from skyproof.simulator.samples import compute_low_pass
from skyproof.simulator.scenario import FrontEnd

__all__ = ["Correlation", "Replica", "compute_correlation", "read"]

Replica = Literal["chips", "filtered"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Correlation:
    """Tables over one code period, `points` a chip: of signal and replica, and of the replica with itself.

    signal, replica : (n_codes, code_length * points); lags beyond half a period are negative ones.
    """

    points: int
    signal: Reals
    replica: Reals


def compute_correlation(
    prns: Sequence[int], signal: SignalPlan, front_end: FrontEnd, *, replica: Replica = "chips"
) -> Correlation:
    """Correlate signals behind the front end (`samples.filter_codes`: mean square 1) with replicas.

    replica : "chips" are sharp; "filtered" are like the signal behind the filter. Without a bandwidth both are chips,
    and R is the triangle with side lobes between them.
    """
    codes = np.stack([signal.code(prn) for prn in prns]).astype(np.float64)
    power = np.abs(np.fft.fft(codes)) ** 2 / codes.shape[1] ** 2
    points = 2 ** math.ceil(math.log2(32 * max(front_end.rate_hz / signal.chip_rate_hz, 2.0)))
    chips = _interpolate(np.fft.ifft(power).real * codes.shape[1], points)
    if front_end.bandwidth_hz is None:
        return Correlation(points=points, signal=chips, replica=chips)
    length = codes.shape[1]
    turns = np.arange(length * points // 2 + 1) / length  # of each line, a chip
    passed = compute_low_pass(turns * signal.chip_rate_hz, front_end.bandwidth_hz)
    lines = power[:, np.arange(turns.size) % length] * np.sinc(turns) ** 2

    def table(shape: Reals) -> Reals:
        return np.asarray(np.fft.irfft(lines * shape, length * points) * (length * points))

    filtered = table(passed**2)
    level = filtered[:, :1].copy()
    filtered /= level
    if replica == "filtered":
        return Correlation(points=points, signal=filtered, replica=filtered)
    return Correlation(points=points, signal=table(passed) / np.sqrt(level), replica=chips)


def _interpolate(corners: Reals, points: int) -> Reals:
    """Interpolate linearly between values one chip apart, `points` a chip, over a period."""
    share = np.arange(points) / points
    lines = corners[:, :, np.newaxis] * (1.0 - share) + np.roll(corners, -1, axis=1)[:, :, np.newaxis] * share
    return lines.reshape(corners.shape[0], -1)


def read(table: Reals, lag_chips: Reals, points: int) -> Reals:
    """Read a correlation's table at lags of any shape."""
    at = np.mod(lag_chips * points, table.size)
    whole = at.astype(np.int64)
    share = at - whole
    return np.asarray(table[whole % table.size] * (1.0 - share) + table[(whole + 1) % table.size] * share)
