"""Which of the pairings of two skies comes from one antenna, if the orbits are known: exact under any noise over time.

After N. Stenberg, E. Axell, J. Rantakokko, G. Hendeby, NAVIGATION 69(1), 2022, doi 10.33012/navi.510, whose model is
kept; deciding for groups is our own. In each of R receivers the signals of K satellites fall into two skies, each of
which fits one position (`split_skies`). A *pairing* takes a sky from each receiver, its *complement* the others. Means
over the window make two tables of K by R, which `detectors.multi_receiver.along_baselines` tests.

With one transmit antenna besides, exactly one of a pairing and its complement has no baseline. If it is the pairing,
the complement may help to know the noise.

With the baseline known the alternative is a point, and one direction decides (`check_known_baseline`). With carrier
phases the fractions of cycles decide (`fraction_test`): they need a bound on the error, and are a hundred times
sharper.

`choose` takes the pairing with the largest p-value if all others are rejected. It errs only if the true one is
rejected, so at most with the stated probability, whatever the number of pairings.
"""

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from skyproof.arrays import Indices, Reals
from skyproof.detectors.multi_receiver.along_baselines import combine_views, project
from skyproof.detectors.multi_receiver.one_antenna import baseline_design, compute_contrasts
from skyproof.statistics.clusters import LineClusters, divide_line
from skyproof.statistics.distributions import chi_square_survival, f_survival

__all__ = [
    "FractionTest",
    "GroupChoice",
    "SkySplit",
    "check_known_baseline",
    "check_known_sky",
    "choose",
    "find_lone_sky",
    "fraction_test",
    "pairings",
    "split_skies",
    "transmit_antennas",
]


class SkySplit(NamedTuple):
    """first : (..., K) which track of each satellite belongs to the first sky, the other to the second.
    squares : (...) squared residuals of both, 2(K-4) degrees of freedom in units of the variance.
    runner_up : (...) those of the next best split."""

    first: Indices
    squares: Reals
    runner_up: Reals


def split_skies(range_m: Reals, unit_enu: Reals) -> SkySplit:
    """Split two tracks of each satellite into two skies that each fit a position and clock; every split is tried.

    Parameters
    ----------
    range_m : (..., K, 2) mean pseudoranges less what is expected at a point within a kilometre or so, K from 5 to 16.
    unit_enu : (K, 3) receiver to satellite.
    """
    n = unit_enu.shape[0]
    design = np.column_stack([unit_enu, np.ones(n)])
    parity = np.linalg.qr(design, mode="complete").Q[:, 4:]  # (K, K-4)
    bits = (np.arange(2 ** (n - 1))[:, None] >> np.arange(n - 1)) & 1
    bits = np.column_stack([np.zeros(len(bits), np.intp), bits])  # the first one's first names the sky
    lowest, gap = range_m[..., 0], range_m[..., 1] - range_m[..., 0]
    first = (lowest @ parity)[..., None, :] + bits.astype(float) @ (gap[..., None] * parity)
    total = (range_m.sum(axis=-1) @ parity)[..., None, :]
    squares = np.sum(first**2, axis=-1) + np.sum((total - first) ** 2, axis=-1)
    two = np.argpartition(squares, 1, axis=-1)[..., :2]
    least = np.sort(np.take_along_axis(squares, two, -1), axis=-1)
    return SkySplit(bits[np.argmin(squares, axis=-1)], least[..., 0], least[..., 1])


def find_lone_sky(range_m: Reals, unit_enu: Reals) -> SkySplit:
    """Find the one sky that fits best, where the other tracks need not fit anything.

    Arguments as of `split_skies`; all 2^K ways to take one track of each satellite. `squares` and `runner_up` belong to
    the one sky alone, K-4 degrees of freedom. Whether it is the true one is for a known baseline (`check_known_sky`).
    """
    n = unit_enu.shape[0]
    parity = np.linalg.qr(np.column_stack([unit_enu, np.ones(n)]), mode="complete").Q[:, 4:]
    bits = (np.arange(2**n)[:, None] >> np.arange(n)) & 1
    gap = range_m[..., 1] - range_m[..., 0]
    misfit = (range_m[..., 0] @ parity)[..., None, :] + bits.astype(float) @ (gap[..., None] * parity)
    squares = np.sum(misfit**2, axis=-1)
    least = np.sort(np.partition(squares, 1, axis=-1)[..., :2], axis=-1)
    return SkySplit(bits[np.argmin(squares, axis=-1)], least[..., 0], least[..., 1])


def check_known_sky(
    sky_m: Reals, unit_enu: Reals, baseline_enu_m: Reals, variance_m2: ArrayLike, sigma_m: Reals | None = None
) -> Reals:
    """Compute the p-value (...) that a pairing comes from the sky over known antennas; variance_m2 (...).

    sky_m : (..., K, R). With `sigma_m` (K, R), known up to a factor, the variance is that factor.
    """
    sigma_m = np.ones(sky_m.shape[-2:]) if sigma_m is None else sigma_m
    values, _, matrix = compute_contrasts(sky_m[..., None, :, :], sigma_m)
    error = values[..., 0, :] - baseline_design(matrix, unit_enu) @ np.asarray(baseline_enu_m, float).ravel()
    return chi_square_survival(np.sum(error**2, axis=-1) / np.asarray(variance_m2, float), error.shape[-1])


def transmit_antennas(difference_m: Reals, sigma_m: ArrayLike, false_alarm_probability: float) -> LineClusters:
    """Cluster false signals by their transmit antennas, by differences (..., K) of two receivers.

    Signals of one antenna have the same difference; two antennas at equal difference of distance look as one. The
    probability of finding more antennas than there are is at most `false_alarm_probability`.
    """
    return divide_line(difference_m, sigma_m, false_alarm_probability)


def pairings(receivers: int) -> Indices:
    """List which of two skies each pairing takes from each receiver, (2^R, R)."""
    return np.array(list(itertools.product((0, 1), repeat=receivers)), np.intp)


def check_known_baseline(
    one_m: Reals, other_m: Reals, unit_enu: Reals, baseline_enu_m: Reals, sigma_m: Reals | None = None
) -> Reals:
    """Compute the p-value (...) of one antenna for a pairing and the sky for its complement.

    Three tests as of `span_test`. Two, by fixes and by differences, look where "the other way round" would show: one
    direction, one side of it, Student's t against all else. The third looks at all that baselines span, for pairings
    that mix.

    Parameters
    ----------
    one_m, other_m : (..., K, R) mean ranges of the pairing and of its complement, less what is expected at one point
        within a kilometre or so; K >= 5.
    unit_enu : (K, 3) receiver to satellite, mean over the window. sigma_m : (K, R) of the means, up to a common factor,
        the same in both; equal if None.
    baseline_enu_m : (R-1, 3) of each receiver's antenna from the first one's.
    """
    one, other = (project(table_m, unit_enu, sigma_m) for table_m in (one_m, other_m))
    shift = one.design @ np.asarray(baseline_enu_m, float).ravel()
    length = float(np.linalg.norm(shift))
    error = np.concatenate([one.along, other.along - shift], axis=-1)
    if length == 0.0:
        return np.ones(error.shape[:-1])
    along = error @ np.concatenate([shift, -shift]) / (np.sqrt(2.0) * length)
    square, dof = _square(error), error.shape[-1]
    noises = [
        (mine[0] + theirs[0], mine[1] + theirs[1])
        for mine, theirs in ((one.fixes, other.fixes), (one.differences, other.differences))
    ]
    fixes, differences = (
        _t_tail(along, noise + np.maximum(square - along**2, 0.0), d + dof - 1) for noise, d in noises
    )
    return combine_views(fixes, differences, _f_tail(square, dof, *noises[1]))


class FractionTest(NamedTuple):
    """statistic : (...) chi-square with `dof` degrees under H0, if the sigma is small beside the modulus; p_value."""

    statistic: Reals
    p_value: Reals
    dof: int


def fraction_test(difference_cyc: Reals, sigma_cyc: ArrayLike, *, modulus_cyc: float = 1.0) -> FractionTest:
    """Test that carrier differences of two receivers are the same for all satellites but for whole cycles.

    H0 is "one antenna"; less what a known baseline gives each satellite it is "the sky". It rests on `sigma_cyc`, which
    has to hold slow errors as well. It is blind where the true differences coincide by chance: for random ones of K
    satellites and a radius r = sigma sqrt(threshold), about sqrt(K) pi^(h/2) / Gamma(h/2 + 1) r^h, h = K - 1, cycles.
    Receivers' clocks may differ by some microseconds (1.4 mm each between satellites); their drift does not matter.

    Parameters
    ----------
    difference_cyc : (..., K) mean over the window, any whole cycles. sigma_cyc : (...) of each, the same for all K.
    modulus_cyc : 0.5 where half cycles are open.
    """
    n = difference_cyc.shape[-1]
    turns = np.sort(np.mod(difference_cyc / modulus_cyc, 1.0), axis=-1)
    raised = turns[..., None, :] + (np.arange(n) < np.arange(n)[:, None])  # cut the circle before each of them
    squares = np.min(np.sum((raised - raised.mean(axis=-1, keepdims=True)) ** 2, axis=-1), axis=-1)
    statistic = np.asarray(squares * modulus_cyc**2 / np.asarray(sigma_cyc, float) ** 2, float)
    return FractionTest(statistic, chi_square_survival(statistic, n - 1), n - 1)


class GroupChoice(NamedTuple):
    """which : (...) the pairing that comes from one antenna, -1 if that is open. p_value : (...) of the runner-up: the
    probability of a choice as clear as this if it is wrong."""

    which: Indices
    p_value: Reals


def choose(p_values: Reals, false_alarm_probability: float, *, accept_probability: float = 1e-9) -> GroupChoice:
    """Choose the one pairing out of p_values (..., G) with one antenna, if all others are rejected.

    A wrong choice needs the true pairing's p-value to be below `false_alarm_probability`, so it is at most as probable.
    None is chosen if even the best has less than `accept_probability`: then no pairing has one antenna.
    """
    best = np.argmax(p_values, axis=-1)
    two = np.sort(p_values, axis=-1)[..., -2:]
    decided = (two[..., 0] < false_alarm_probability) & (two[..., 1] >= accept_probability)
    return GroupChoice(np.where(decided, best, -1), two[..., 0])


def _f_tail(square: Reals, dof: int, noise: Reals, noise_dof: int) -> Reals:
    return f_survival(square / dof / np.maximum(noise / noise_dof, 1e-300), dof, noise_dof)


def _t_tail(along: Reals, noise: Reals, dof: int) -> Reals:
    return np.asarray(special.stdtr(dof, -along / np.sqrt(np.maximum(noise / dof, 1e-300))), float)


def _square(vectors: Reals) -> Reals:
    return np.asarray(np.sum(vectors**2, axis=-1), float)
