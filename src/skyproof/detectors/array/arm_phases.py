"""Test if signals come from one direction: an antenna on a spinning arm writes the direction into each carrier phase.

The arm has the radius r (cycles) and the angle a(n). The phase of a signal from azimuth az and elevation el has a part
r cos(el) cos(a(n) + az). This is linear in the level direction cosines L = [cos el cos az, cos el sin az]. Signals of
one transmitter have the same L. After Zhang, Chen, Huang, Zhang and Ou, "Spoofing Detection Technique Based on Carrier
Phase Double Difference of Spin-Antenna", 2016, in Chinese, doi 10.13203/j.whugis20140360
("the paper"). The paper takes differences over two samples that do not
overlap, which loses all but 1/40 of the information and supposes all motion removed. Here the whole series is used,
with a polynomial for cycles, clocks and motion.

Corrected: equation 6 holds sin w, cos w; equation 18 is one minus a tail probability. The paper's threshold assumes
that the direction of the authentic signal is known. With the estimate put in, as it proposes, spoofed pairs are found
with probability 0.0101, see `circular_threshold`. Motion is not removed by the ephemeris where a signal is false.
`docs/methods/spin.md` has the rest.

Phases and the radius are in cycles, angles in radians; phases grow where the antenna is nearer to the source (the
opposite sign of range only mirrors all directions). Series run along the last axis, N samples.
"""

from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike

from skyproof.arrays import Indices, Reals
from skyproof.statistics.distributions import chi_square_survival, chi_square_threshold

__all__ = [
    "RepairedPhase",
    "SpinFit",
    "SpinRate",
    "arm_columns",
    "estimate_rate",
    "find_bent_signals",
    "fit_columns",
    "fit_whole_series",
    "polynomial_columns",
    "repair_slips",
    "step_statistics",
    "subtract_mean",
]


def arm_columns(angle_rad: ArrayLike, radius_cyc: float) -> Reals:
    """Compute S (..., N, 2): a signal's phase has the part S @ L."""
    angle_rad = np.asarray(angle_rad, np.float64)
    return radius_cyc * np.stack((np.cos(angle_rad), -np.sin(angle_rad)), axis=-1)


class SpinFit(NamedTuple):
    """level : (..., 2) level direction cosines (their difference, for a pair's difference of phases). information :
    (2, 2), the inverse covariance of `level`. statistic : (...) chi-square with 2 degrees where the true one is 0."""

    level: Reals
    information: Reals
    statistic: Reals


# The paper's test -----------------------------------------------------------------------------------------------------


# The whole series -----------------------------------------------------------------------------------------------------


def fit_whole_series(
    phase_cyc: ArrayLike,
    angle_rad: ArrayLike,
    *,
    radius_cyc: float,
    sigma_cyc: float,
    degree: int = 2,
    time: ArrayLike | None = None,
) -> SpinFit:
    """Fit polynomial and arm to the whole series by least squares.

    Cycles, drift and (degree 2) curvature do not change the distribution of the statistic. Neither does an arm that
    starts elsewhere or turns at another rate.

    Parameters
    ----------
    phase_cyc : (..., N) a signal less the mean of all (`subtract_mean`), or the difference of two.
    angle_rad : (N,). time : (N,) where samples are not even. degree : of the polynomial.
    sigma_cyc : of a sample of the series. For levels of several signals less their mean give that of one signal: then
        differences of levels have the right covariance.
    """
    columns = arm_columns(angle_rad, radius_cyc)
    polynomial = polynomial_columns(columns.shape[0], degree, time)
    columns = columns - polynomial @ (polynomial.T @ columns)
    return fit_columns(np.asarray(phase_cyc, np.float64), columns, sigma_cyc**2)


def subtract_mean(phase_cyc: ArrayLike) -> Reals:
    """Subtract the mean of n signals (..., n, N) at each sample: any receiver clock drops out."""
    phase_cyc = np.asarray(phase_cyc, np.float64)
    return np.asarray(phase_cyc - phase_cyc.mean(axis=-2, keepdims=True))


class SpinRate(NamedTuple):
    """rate_rad : (...) a unit of time. sigma_rad : (...) its standard deviation."""

    rate_rad: Reals
    sigma_rad: Reals


def estimate_rate(
    phase_cyc: ArrayLike,
    rate_rad: float,
    *,
    radius_cyc: float,
    sigma_cyc: float,
    degree: int = 2,
    time: ArrayLike | None = None,
    rate_sigma_rad: float = np.inf,
    within: float = 0.05,
) -> SpinRate:
    """Estimate the rate that explains most of n signals together.

    A grid over `rate_rad` (1 ± `within`), then variable projection (Kaufman, BIT 15, 1975), within the same limits.
    Signals of one direction carry no information on the rate: then the prior decides.

    Parameters
    ----------
    phase_cyc : (..., n, N), n at least 2.
    rate_sigma_rad : of `rate_rad`, normal.
    time : (N,) in the units of the rate; sample numbers if None. Other parameters as in `fit_whole_series`.
    """
    series = subtract_mean(phase_cyc)
    count = series.shape[-1]
    time = np.arange(count, dtype=float) if time is None else np.asarray(time, np.float64)
    centred = time - 0.5 * (time[0] + time[-1])  # with the phase in the middle, rate and direction hardly correlate
    polynomial = polynomial_columns(count, degree, time)
    series = series - (series @ polynomial) @ polynomial.T
    steps = 2 * int(np.ceil(2.0 * within * abs(rate_rad) * (time[-1] - time[0]))) + 1
    grid = rate_rad * (1.0 + within * np.linspace(-1.0, 1.0, max(3, steps)))
    explained = np.stack(
        [np.sum((series @ _basis(polynomial, arm_columns(rate * centred, 1.0))) ** 2, axis=(-1, -2)) for rate in grid],
        axis=-1,
    )
    prior = rate_sigma_rad**-2.0
    rate = grid[(explained / sigma_cyc**2 - prior * (grid - rate_rad) ** 2).argmax(axis=-1)]
    for _ in range(4):
        columns = arm_columns(rate[..., None] * centred, radius_cyc)
        columns = columns - polynomial @ (polynomial.T @ columns)
        basis = np.linalg.qr(columns).Q
        level = (series @ columns) @ np.linalg.inv(np.swapaxes(columns, -1, -2) @ columns)
        turned = centred[:, None] * arm_columns(rate[..., None] * centred + 0.5 * np.pi, radius_cyc)
        slope = level @ np.swapaxes(turned, -1, -2)
        slope = slope - (slope @ polynomial) @ polynomial.T
        slope = slope - (slope @ basis) @ np.swapaxes(basis, -1, -2)
        weight = np.sum(slope**2, axis=(-1, -2)) / sigma_cyc**2 + prior
        pull = np.sum(slope * series, axis=(-1, -2)) / sigma_cyc**2 + prior * (rate_rad - rate)
        rate = np.clip(rate + pull / weight, grid.min(), grid.max())
    return SpinRate(rate, weight**-0.5)


# Slips ----------------------------------------------------------------------------------------------------------------


def step_statistics(
    phase_cyc: ArrayLike,
    angle_rad: ArrayLike,
    *,
    sigma_cyc: float,
    degree: int = 2,
    time: ArrayLike | None = None,
) -> tuple[Reals, Reals]:
    """Compute the statistic (..., N - 1) and size (..., N - 1) in cycles of a step before each sample but the first.

    Without a step the statistic is chi-square with 1 degree of freedom. Parameters as in `fit_whole_series`.
    """
    series = np.asarray(phase_cyc, np.float64)
    count = series.shape[-1]
    polynomial = polynomial_columns(count, degree, time)
    basis = np.hstack([polynomial, _basis(polynomial, arm_columns(angle_rad, 1.0))])
    rest = series - (series @ basis) @ basis.T
    seen = _sum_after(rest)
    power = np.arange(count - 1.0, 0.0, -1.0) - np.sum(_sum_after(basis.T) ** 2, axis=0)
    # With fewer samples on a side than the fit has parameters a step may be no different from them.
    power = np.where(power > 1e-6, power, np.inf)
    return seen**2 / power / sigma_cyc**2, seen / power


class RepairedPhase(NamedTuple):
    """phase_cyc : (..., n, N). jump_cyc : (..., n, N) what was taken off from each sample on, multiples of a half."""

    phase_cyc: Reals
    jump_cyc: Reals


def repair_slips(
    phase_cyc: ArrayLike,
    angle_rad: ArrayLike,
    *,
    sigma_cyc: float,
    degree: int = 2,
    time: ArrayLike | None = None,
    false_alarm_probability: float = 1e-3,
    most: int = 10,
) -> RepairedPhase:
    """Take off half-cycle slips of n signals, the largest first, `most` at most.

    Without slips a step is found with at most `false_alarm_probability` (union bound over signals and samples).
    Even then nothing changes unless its size is nearer to a half cycle than to none. If two signals are given,
    either may be repaired: the difference is the same.

    Parameters
    ----------
    phase_cyc : (..., n, N), n at least 2. sigma_cyc : of a sample of one signal. Others as in `fit_whole_series`.
    """
    phase_cyc = np.asarray(phase_cyc, np.float64)
    n, count = phase_cyc.shape[-2:]
    phase = phase_cyc.reshape(-1, n, count).copy()
    jump = np.zeros(phase.shape)
    share = 1.0 - 1.0 / n
    limit = float(chi_square_threshold(false_alarm_probability / (n * (count - 1)), 1))
    todo = np.arange(phase.shape[0])
    for _ in range(most):
        statistic, size = step_statistics(
            subtract_mean(phase[todo]), angle_rad, sigma_cyc=sigma_cyc * np.sqrt(share), degree=degree, time=time
        )
        place = statistic.reshape(len(todo), -1).argmax(axis=-1)
        signal, before = np.divmod(place, count - 1)
        row = np.arange(len(todo))
        half = np.rint(2.0 * size[row, signal, before] / share) / 2.0
        found = (statistic[row, signal, before] > limit) & (half != 0.0)
        todo, signal, before, half = todo[found], signal[found], before[found], half[found]
        if todo.size == 0:
            break
        phase[todo, signal] -= half[:, None] * (np.arange(count) > before[:, None])
        jump[todo, signal, before + 1] += half
    return RepairedPhase(phase.reshape(phase_cyc.shape), jump.reshape(phase_cyc.shape))


# Of no one direction --------------------------------------------------------------------------------------------------


def find_bent_signals(
    phase_cyc: ArrayLike,
    angle_rad: ArrayLike,
    sigma_cyc: ArrayLike,
    *,
    degree: int = 2,
    time: ArrayLike | None = None,
    accept_probability: float = 1e-3,
) -> Indices:
    """Find those of n signals whose phases fit no single direction: more than noise remains beside polynomial and arm.

    The worst is found first. It affects the mean of all, so the others are judged without it.

    If two signals are given, neither is named, as either may be the bent one. If none is bent, one is found with
    `accept_probability` at most (union bound over signals).

    Parameters
    ----------
    phase_cyc : (n, N). sigma_cyc : (n,) of a sample of each signal. Others as in `fit_whole_series`.
    """
    phase_cyc, sigma_cyc = np.asarray(phase_cyc, np.float64), np.asarray(sigma_cyc, np.float64)
    n, count = phase_cyc.shape
    polynomial = polynomial_columns(count, degree, time)
    basis = np.hstack([polynomial, _basis(polynomial, arm_columns(angle_rad, 1.0))])
    remaining, found = np.arange(n), list[int]()
    while remaining.size > 2:
        series = subtract_mean(phase_cyc[remaining])
        rest = series - (series @ basis) @ basis.T
        # Of a signal less the mean of all: its own noise and a share of the others'.
        variance_of_others = np.sum(sigma_cyc[remaining] ** 2) - sigma_cyc[remaining] ** 2
        variance = (1.0 - 1.0 / remaining.size) ** 2 * sigma_cyc[
            remaining
        ] ** 2 + variance_of_others / remaining.size**2
        p_value = chi_square_survival(np.sum(rest**2, axis=-1) / variance, count - basis.shape[1])
        worst = int(p_value.argmin())
        if p_value[worst] * remaining.size >= accept_probability:
            break
        found.append(int(remaining[worst]))
        remaining = np.delete(remaining, worst)
    return np.array(sorted(found), np.intp)


# Shared ---------------------------------------------------------------------------------------------------------------


def fit_columns(series: Reals, columns: Reals, variance: float) -> SpinFit:
    gram = columns.T @ columns
    level = (series @ columns) @ np.linalg.inv(gram)
    information = gram / variance
    return SpinFit(level, information, np.sum((level @ information) * level, axis=-1))


def polynomial_columns(count: int, degree: int, time: ArrayLike | None) -> Reals:
    """Build orthonormal columns (N, degree + 1)."""
    at = np.arange(count, dtype=float) if time is None else np.asarray(time, np.float64)
    scaled = (2.0 * at - at[0] - at[-1]) / (at[-1] - at[0])
    return np.asarray(np.linalg.qr(legendre.legvander(scaled, degree)).Q, float)


def _basis(polynomial: Reals, columns: Reals) -> Reals:
    """Build orthonormal columns of the part of `columns` that the polynomial cannot represent."""
    return np.asarray(np.linalg.qr(columns - polynomial @ (polynomial.T @ columns)).Q, float)


def _sum_after(series: Reals) -> Reals:
    """Sum from each sample but the first to the end."""
    return np.asarray(np.cumsum(series[..., ::-1], axis=-1)[..., -2::-1])
