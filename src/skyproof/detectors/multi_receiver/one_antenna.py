"""Test if signals of several receivers come from one transmit antenna: the group decision's mathematics, no records.

Source of the data model: N. Stenberg, E. Axell, J. Rantakokko, G. Hendeby, NAVIGATION 69(1), 2022, doi
10.33012/navi.510. The decision by groups of satellites and its treatment of noise that is not white are our own.

A table of pseudoranges at a common instant, K satellites by R receivers, is

    rho[k, i] = a_k + c_i - b_i . u_k + e[k, i]        b_i = p_i - p_1,  u_k receiver to satellite.

Each kind of signal (time scale, band, code) has its own c, by which the receivers' paths for it differ. Then M =
(K-G)(R-1) contrasts remove the terms of G kinds.

Signals of one antenna all take the same path from it to receiver i, so H0, "one antenna", is b = 0: the table is a
satellite's term plus a receiver's term. M = (K-1)(R-1) contrasts remove both terms
(`statistics.lines.additive_contrasts`, weighted by the thermal sigma of each track, which need be known up to a common
factor only). Under H0 they have zero mean.

With orbits the means are tested along baselines alone. Each receiver's signals fit a position, so a departure from one
antenna shows in 3(R-1) numbers. The other contrasts are noise under every hypothesis, which would only hide them.

The test takes the mean over the window. The slope is left out, although it is zero under H0 as well. For antennas at
rest it changes by 1e-4 m/s per metre of baseline. After a minute that is a five hundredth of what the mean shows, and
testing it would only spend degrees of freedom. The noise is measured from the residuals around a line, so that a slope
cannot hide in it.

Noise: thermal and slow errors are AR(1) with unknown coefficient phi, common to the window; each track has a constant
error besides, of known sigma (multipath). With neither (`WHITE`) the statistic is exactly F. With unknown phi the
p-value is the largest over a confidence set of phi plus the probability that the set misses the true one (Berger and
Boos, JASA 89, 1994, doi 10.1080/01621459.1994.10476836). In short windows that set is wide, and steady noise could be
the visible tip of a slow error of any size. So a second test, which does not use the noise, takes the error of a track
as bounded. The smaller of the two p-values, doubled, holds.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from skyproof.arrays import Booleans, Indices, Reals
from skyproof.statistics.autoregression import ar1_line, correlation_grid, estimate_ar1
from skyproof.statistics.distributions import f_survival, f_threshold
from skyproof.statistics.lines import additive_contrasts, fit_line

__all__ = [
    "WHITE",
    "BaselineEstimate",
    "ContrastLevels",
    "MeanTest",
    "Means",
    "TableContrasts",
    "TrackNoise",
    "average_contrasts",
    "average_stretches",
    "baseline_design",
    "compute_contrasts",
    "distance_p_value",
    "estimate_baselines",
    "mix_sigmas",
    "one_antenna_test",
    "ratio_test",
]


@dataclass(frozen=True)
class TrackNoise:
    """What is assumed of the errors of a track (one signal in one receiver).

    multipath_sigma_m : error that stays constant over the window, one sigma.
    correlation_max : largest coefficient of AR(1) noise from epoch to epoch; 0 if the noise is white.
    miss_probability : chance, added to every p-value, that the confidence set of the coefficient misses it.
    bound_m : no track's AR(1) error has a larger sigma than this, however slow it is, thermal noise in it; infinite if
        nothing is known.
    carrier_multipath_sigma_m : error of a carrier that stays constant over the window, one sigma.
    """

    multipath_sigma_m: float = 1.0
    correlation_max: float = 0.98
    miss_probability: float = 1e-4
    bound_m: float = 3.0
    carrier_multipath_sigma_m: float = 0.005


WHITE = TrackNoise(multipath_sigma_m=0.0, correlation_max=0.0, miss_probability=0.0, bound_m=np.inf)


class ContrastLevels(NamedTuple):
    """Mean contrasts of a window under each noise that is considered (axis 0): a grid of coefficients, then the bound.

    level : (G, ..., M) estimated mean of each contrast.
    variance : (G, ..., M) of the estimates.
    plausible : (G, ...) whether the noise is in the confidence set.
    dof : (G,) degrees of freedom of the variance; infinite for the bound, which is known.
    miss_probability : chance that the confidence set misses the true coefficient.
    bounded : whether the last entry of axis 0 is the bound.
    """

    level: Reals
    variance: Reals
    plausible: Booleans
    dof: Reals
    miss_probability: float
    bounded: bool

    def worst(self, p_values: Reals) -> tuple[Reals, Indices]:
        """Combine the p-values of each noise (G, ...) into one (...), and return which noise (...) decides."""
        grid = np.where(self.plausible, p_values, -1.0)
        decides = np.argmax(grid[:-1] if self.bounded else grid, axis=0)
        p_value = np.take_along_axis(grid, decides[None], 0)[0] + self.miss_probability
        if self.bounded:
            decides = np.where(grid[-1] < p_value, grid.shape[0] - 1, decides)
            p_value = 2.0 * np.minimum(p_value, grid[-1])
        return np.minimum(p_value, 1.0), decides

    def threshold(self, false_alarm_probability: float, dof_num: int, decides: Indices) -> Reals:
        """Return the mean square (...) beyond which `worst` is below `false_alarm_probability`, under `decides`."""
        share = false_alarm_probability / (2.0 if self.bounded else 1.0)
        known = np.isinf(self.dof[decides])
        tail = np.where(known, share, np.maximum(share - self.miss_probability, 0.0))
        return f_threshold(tail, dof_num, self.dof[decides])

    def dof_over(self, array: Reals) -> Reals:
        """Return `dof` shaped to go along axis 0 of `array`."""
        return self.dof.reshape((-1,) + (1,) * (array.ndim - 1))


class TableContrasts(NamedTuple):
    """Of a series of tables. values : (..., N, M). gain : (..., M) variance that a constant error of 1 m per track
    adds. matrix : (..., K*R, M), as of `additive_contrasts`."""

    values: Reals
    gain: Reals
    matrix: Reals


def compute_contrasts(ranges_m: Reals, sigma_m: Reals, kinds: Indices | None = None) -> TableContrasts:
    """Compute contrasts of a series of tables.

    Parameters
    ----------
    ranges_m : (..., N, K, R) pseudoranges at common instants.
    sigma_m : (..., K, R) thermal noise of each track, up to a common factor.
    kinds : (K,) number of each row's kind of signal; all of one kind if absent.
    """
    matrix, gain = additive_contrasts(sigma_m, kinds)
    flat = ranges_m.reshape(*ranges_m.shape[:-2], -1)
    # Ranges are 2e7 m and what is sought is millimetres: take the common part off before multiplying.
    flat = flat - flat[..., :1]
    return TableContrasts(flat @ matrix, gain, matrix)


def average_contrasts(values: Reals, gain: Reals, noise: TrackNoise, gaps: Reals | None = None) -> ContrastLevels:
    """Average contrasts (..., N, M), N >= 4, with the variances that the noise model gives them.

    gaps : (N-1,) steps between the epochs, in units of the usual step.
    """
    n, m = values.shape[-2:]
    phi = correlation_grid(noise.correlation_max)
    fit = ar1_line(values, phi.reshape((-1,) + (1,) * (values.ndim - 2)), gaps)
    dof = np.full(phi.size, (n - 2.0) * m)
    level = fit.level / fit.gain[..., None]
    constant = noise.multipath_sigma_m**2 * gain
    variance = (fit.rss / dof[0] / fit.gain**2)[..., None] + constant
    plausible = fit.support >= noise.miss_probability
    plausible[0] = True  # residuals that swing more than white noise: white it is
    bounded = bool(np.isfinite(noise.bound_m))
    if bounded:
        largest = np.broadcast_to(noise.bound_m**2 * gain + constant, variance.shape[1:])
        level = np.concatenate([level, level[:1]])
        variance = np.concatenate([variance, largest[None]])
        plausible = np.concatenate([plausible, np.ones_like(plausible[:1])])
        dof = np.append(dof, np.inf)
    return ContrastLevels(level, variance, plausible, dof, noise.miss_probability, bounded)


class Means(NamedTuple):
    """level (M,) and variance (M,) of mean contrasts, under the noise as it looks."""

    level: Reals
    variance: Reals


def average_stretches(
    values: Reals, gain: Reals, multipath_sigma_m: float, stretches: Sequence[tuple[int, int]]
) -> list[Means]:
    """Average contrasts (N, M) over each of `stretches`, with the variance that the noise seems to have.

    A stretch runs from its first epoch to before its last.

    The noise is AR(1) around a line through the whole window, its variance and coefficient as estimated. The mean of n
    epochs has the variance s^2 / n^2 times the sum over all pairs of phi^|i-j|. It is an estimate where
    `average_contrasts` is a bound, for decisions that a bound would make too lightly.
    """
    residual = fit_line(values).residual
    variance = np.sum(residual**2) / max((len(values) - 2) * values.shape[1], 1)
    phi, found = estimate_ar1(residual), []
    for first, end in stretches:
        n = end - first
        lags = np.arange(1, n)
        share = (n + 2.0 * np.sum((n - lags) * phi**lags)) / n**2
        found.append(Means(values[first:end].mean(axis=0), variance * share + multipath_sigma_m**2 * gain))
    return found


class MeanTest(NamedTuple):
    """p_value (...), statistic (...), and which noise (...) of `ContrastLevels` gave them."""

    p_value: Reals
    statistic: Reals
    decides: Indices


def one_antenna_test(levels: ContrastLevels, expected: Reals | None = None, *, along: Reals | None = None) -> MeanTest:
    """Test that the mean contrasts are zero (one antenna), or `expected` (..., M) (a known baseline).

    The statistic is the mean square of the means over their sigmas, under the noise that decides. Under H0 with white
    noise and no constant error: F with M and `dof` degrees. With a constant error part of the denominator is known, not
    estimated; the law is then between F and chi-square/M, and the p-value errs to the safe side (high).

    along : (M, q) of full rank, as of `baseline_design`: only the part of the means that these q columns explain is
        tested, whose law has q degrees in place of M.
    """
    level = levels.level if expected is None else levels.level - expected
    if along is None:
        dof_num, squares = level.shape[-1], np.sum(level**2 / levels.variance, axis=-1)
    else:
        dof_num, squares = along.shape[-1], _squares_along(level, levels.variance, along)
    statistic = squares / dof_num
    p_value, decides = levels.worst(f_survival(statistic, dof_num, levels.dof_over(statistic)))
    return MeanTest(p_value, np.take_along_axis(statistic, decides[None], 0)[0], decides)


def _squares_along(level: Reals, variance: Reals, along: Reals) -> Reals:
    """Compute the squares (...), in sigmas, of the weighted least-squares fit of `along` (M, q) to levels (..., M)."""
    weighted = along / variance[..., None]
    moment = np.einsum("...mq,...m->...q", weighted, level)
    solved = np.linalg.solve(np.swapaxes(weighted, -1, -2) @ along, moment[..., None])[..., 0]
    return np.asarray(np.sum(moment * solved, axis=-1), float)


def mix_sigmas(one_m: Reals, other_m: Reals, mixtures: int = 5) -> tuple[Reals, Reals]:
    """Mix the sigmas of two tables, (mixtures, ...) of each: from one for all tracks to those that are given.

    What is constant is alike in every track, what is thermal as `one_m`, `other_m` (..., K, R). Up to a common factor.
    """
    typical = np.mean(np.concatenate([one_m**2, other_m**2], axis=-2), axis=(-1, -2), keepdims=True)
    mixed = []
    for sigma_m in (one_m, other_m):
        share = np.linspace(0.0, 1.0, mixtures).reshape((-1,) + (1,) * sigma_m.ndim)
        mixed.append(np.sqrt(share * sigma_m**2 / typical + (1.0 - share)))
    return mixed[0], mixed[1]


class RatioTest(NamedTuple):
    """p_value, statistic (...); dof_num, dof_den of the F law; log_likelihood_ratio (...) of the second over the
    first."""

    p_value: Reals
    statistic: Reals
    dof_num: int
    dof_den: int
    log_likelihood_ratio: Reals

    def threshold(self, false_alarm_probability: float) -> float:
        """Return the value that the statistic has to exceed."""
        return float(f_threshold(false_alarm_probability, self.dof_num, self.dof_den))


def ratio_test(
    larger_m: Reals,
    larger_sigma_m: Reals,
    smaller_m: Reals,
    smaller_sigma_m: Reals,
    *,
    mixtures: int = 5,
    larger_kinds: Indices | None = None,
    smaller_kinds: Indices | None = None,
) -> RatioTest:
    """Test that the first table of means, not the second, is the one of one antenna.

    If the first is from one antenna, its contrasts have zero mean, and those of the second a mean that depends on the
    baseline; at worst, with no baseline, zero as well. The ratio of the mean squares is then F with as many degrees as
    each has contrasts, whatever the noise, if both have the same: correlation and constant errors cancel. Any baseline
    makes the ratio smaller. Two tables that share tracks are correlated, which makes large ratios rarer still.

    Parameters
    ----------
    larger_m, smaller_m : (..., K, R) and (..., K', R) mean ranges over the window.
    larger_sigma_m, smaller_sigma_m : thermal sigma of these means up to a common factor; leading axes broadcast.
    larger_kinds, smaller_kinds : (K,), (K',) as in `compute_contrasts`.
    mixtures : variances between all thermal (proportional to sigma^2) and all constant (the same for every track) are
        tried in this many steps; the largest p-value counts. With equal sigmas all steps agree.

    Returns
    -------
    RatioTest : at the mixture of the largest p-value. The log likelihood ratio is that of "the second is the one of one
        antenna" over "the first is". The noise is equal, of unknown variance (density 1/variance); the other one's
        contrasts have any mean (flat density). So it is half the number of contrasts times the log of the ratio.
    """
    mean_squares, dofs = [], []
    tables = (larger_m, larger_kinds), (smaller_m, smaller_kinds)
    for (means_m, kinds), sigma_m in zip(tables, mix_sigmas(larger_sigma_m, smaller_sigma_m, mixtures), strict=True):
        spread = sigma_m.reshape((mixtures,) + (1,) * (means_m.ndim + 1 - sigma_m.ndim) + sigma_m.shape[1:])
        values, _, _ = compute_contrasts(means_m[..., None, :, :], spread, kinds)
        mean_squares.append(np.mean(values[..., 0, :] ** 2, axis=-1))
        dofs.append(values.shape[-1])
    statistic = mean_squares[0] / np.maximum(mean_squares[1], 1e-300)
    p_values = f_survival(statistic, dofs[0], dofs[1])
    worst = np.argmax(p_values, axis=0)[None]
    statistic = np.take_along_axis(statistic, worst, 0)[0]
    return RatioTest(
        np.take_along_axis(p_values, worst, 0)[0],
        statistic,
        dofs[0],
        dofs[1],
        np.asarray(0.25 * (dofs[0] + dofs[1]) * np.log(statistic), float),
    )


class BaselineEstimate(NamedTuple):
    """Baselines (b_2, ..., b_R) from mean contrasts, for each coefficient of `ContrastLevels`, if it is they.

    enu_m : (G, ..., 3 (R - 1)); covariance_m2 : (G, ..., 3 (R - 1), 3 (R - 1)).
    """

    enu_m: Reals
    covariance_m2: Reals


def baseline_design(matrix: Reals, unit_enu: Reals) -> Reals:
    """Compute the design (M, 3 (R-1)): mean contrasts = design @ (b_2, ..., b_R), each east, north, up in metres.

    matrix : (K*R, M) of `compute_contrasts`; unit_enu : (K, 3) receiver to satellite.
    """
    n_sats = unit_enu.shape[0]
    n_receivers = matrix.shape[0] // n_sats
    table = np.zeros((n_sats, n_receivers, n_receivers - 1, 3))
    for other in range(1, n_receivers):
        table[:, other, other - 1] = -unit_enu
    return np.asarray(matrix.T @ table.reshape(n_sats * n_receivers, -1), float)


def estimate_baselines(levels: ContrastLevels | Means, design: Reals) -> BaselineEstimate:
    """Estimate baselines by least squares; design (M, 3 (R - 1)) of full rank."""
    weighted = design / levels.variance[..., None]
    covariance = np.linalg.inv(np.swapaxes(weighted, -1, -2) @ design)
    enu = covariance @ np.swapaxes(weighted, -1, -2) @ levels.level[..., None]
    return BaselineEstimate(enu[..., 0], np.asarray(covariance, float))


def distance_p_value(
    levels: ContrastLevels, baseline: BaselineEstimate, distance_m: float, hypothesis: Literal["at least", "at most"]
) -> Reals:
    """Test that the antennas stand `at least`, or `at most`, so far apart in the horizontal; (...) p-values.

    The vertical is left free, since satellites determine it worst. The statistic is the squared distance, in the
    metric of the covariance, of the estimate from the nearest baseline that the hypothesis allows. For the true
    baseline it is twice an F with 2 and `dof` degrees. So the nearest allowed one gives a p-value that is never too
    small.
    """
    horizontal_m, covariance_m2 = baseline.enu_m[..., :2], baseline.covariance_m2[..., :2, :2]
    allowed = np.hypot(horizontal_m[..., 0], horizontal_m[..., 1]) >= distance_m
    if hypothesis == "at most":
        allowed = ~allowed
    angle_rad = np.linspace(0.0, 2.0 * np.pi, 256, endpoint=False)
    rim_m = distance_m * np.stack([np.cos(angle_rad), np.sin(angle_rad)], axis=-1)
    off_m = horizontal_m[..., None, :] - rim_m
    squared = np.einsum("...ai,...ij,...aj->...a", off_m, np.linalg.inv(covariance_m2), off_m).min(axis=-1)
    return levels.worst(np.where(allowed, 1.0, f_survival(squared / 2.0, 2, levels.dof_over(squared))))[0]
