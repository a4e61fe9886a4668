"""Correlation of what arrives with replicas, and of replicas with themselves, in tables over the lag."""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from skyproof.arrays import Reals
from skyproof.receiver.replica import low_pass_gain
from skyproof.simulator.samples import compute_low_pass
from skyproof.studies.correlator_model.waves import SIGNAL

__all__ = ["POINTS", "CodeCorrelation", "interpolate", "noise_root", "tabulate_correlation"]

POINTS = 32
"""A chip, of tables of correlation."""
_RIDGE = 1e-9


@dataclass(frozen=True, eq=False)
class CodeCorrelation:
    """Of one code: correlation of what arrives with a replica, and of the replica with itself, `POINTS` a chip."""

    signal: Reals
    replica: Reals


@cache
def tabulate_correlation(
    prn: int, rate_hz: float, bandwidth_hz: float | None, band_hz: float | None
) -> CodeCorrelation:
    """Tabulate the correlation of a code with a replica.

    band_hz : to which a replica is cut; None stands for the receiver's own low-pass.
    """
    code = SIGNAL.code(prn).astype(np.float64)
    lines = np.arange(code.size * POINTS // 2 + 1)
    hz = lines / code.size * SIGNAL.chip_rate_hz
    power = (np.abs(np.fft.fft(code)) ** 2)[lines % code.size] * np.sinc(lines / code.size) ** 2 / code.size**2
    arrives = np.ones(hz.size) if bandwidth_hz is None else compute_low_pass(hz, bandwidth_hz)
    replica = low_pass_gain(hz / rate_hz) if band_hz is None else np.asarray(hz <= 0.5 * band_hz, np.float64)

    def table(shape: Reals) -> Reals:
        return np.asarray(np.fft.irfft(power * shape, code.size * POINTS) * (code.size * POINTS))

    level = math.sqrt(float(table(arrives**2)[0]))
    return CodeCorrelation(signal=table(arrives * replica) / level, replica=table(replica**2))


def interpolate(table: Reals, lag_chips: Reals) -> Reals:
    """Interpolate a table of `POINTS` a chip at lags of any shape."""
    at = np.mod(lag_chips * POINTS, table.size)
    whole = at.astype(np.int64)
    return np.asarray(table[whole % table.size] * (1.0 - at + whole) + table[(whole + 1) % table.size] * (at - whole))


def noise_root(table: Reals, delays_chips: Reals) -> Reals:
    """Compute the lower triangle whose square is the covariance of replicas' noise, of variance 1."""
    covariance = interpolate(table, np.subtract.outer(delays_chips, delays_chips))
    return np.linalg.cholesky(covariance + _RIDGE * table[0] * np.eye(delays_chips.size))
