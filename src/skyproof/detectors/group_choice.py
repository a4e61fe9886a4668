"""Which of the pairings of two skies comes from one antenna, if the orbits are known: exact under any noise over time.

After N. Stenberg, E. Axell, J. Rantakokko, G. Hendeby, NAVIGATION 69(1), 2022, doi 10.33012/navi.510, whose model is
kept; deciding for groups is our own. In each of R receivers the signals of K satellites fall into two skies, each of
which fits one position (`split_skies`). A *pairing* takes a sky from each receiver, its *complement* the others. Means
over the window make a table of K by R; M = (K-1)(R-1) contrasts of it see neither satellites' nor receivers' terms
(`statistics.lines.additive_contrasts`).

A pairing of one antenna has contrasts of zero mean. Any other, whatever it mixes, has skies that fit a position in each
receiver, so the mean of its contrasts lies in the 3(R-1) dimensions that baselines span (to 6 mm for false positions
500 m away, growing with the square). The dimensions left are noise under every hypothesis. So

    F = (square within the span / 3(R-1)) / (squares outside of it, of pairing and complement / their dimensions)

is exactly F if the pairing is of one antenna, provided that the means' errors are normal, independent and of sigmas in
known proportion. Nothing is asked about time: correlated and constant errors cancel, of whatever size. That is
what a test of means against the scatter over time, as the paper's, cannot have.

With the baseline known the alternative is a point, and one direction decides (`known_baseline_test`). With carrier
phases the fractions of cycles decide (`fraction_test`): they need a bound on the error, and are a hundred times
sharper.

`choose` takes the pairing with the largest p-value if all others are rejected. It errs only if the true one is
rejected, so at most with the stated probability, whatever the number of pairings.
"""

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from skyproof.detectors.one_antenna import baseline_design, table_contrasts
from skyproof.statistics.clusters import LineClusters, line_clusters
from skyproof.statistics.distributions import chi_square_survival, f_survival

__all__ = [
    "Choice", "FractionTest", "SkySplit", "SpanTest", "choose", "fraction_test", "known_baseline_test",
    "known_sky_test", "lone_sky", "pairings", "span_test", "split_skies", "transmit_antennas",
]  # fmt: skip

Reals = NDArray[np.float64]


class SkySplit(NamedTuple):
    """first : (..., K) which track of each satellite is of the first sky; the other is of the second.
    squares : (...) squared residuals of both, 2(K-4) degrees of freedom in units of the variance.
    runner_up : (...) those of the next best split."""

    first: NDArray[np.intp]
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
    both = (range_m.sum(axis=-1) @ parity)[..., None, :]
    squares = np.sum(first**2, axis=-1) + np.sum((both - first) ** 2, axis=-1)
    two = np.argpartition(squares, 1, axis=-1)[..., :2]
    least = np.sort(np.take_along_axis(squares, two, -1), axis=-1)
    return SkySplit(bits[np.argmin(squares, axis=-1)], least[..., 0], least[..., 1])


def lone_sky(range_m: Reals, unit_enu: Reals) -> SkySplit:
    """The one sky that fits best, where the other tracks need not fit anything: false signals of several antennas.

    Arguments as of `split_skies`; all 2^K ways to take one track of each satellite. `squares` and `runner_up` are of
    the one sky alone, K-4 degrees of freedom. Whether it is the true one a known baseline tells (`known_sky_test`).
    """
    n = unit_enu.shape[0]
    parity = np.linalg.qr(np.column_stack([unit_enu, np.ones(n)]), mode="complete").Q[:, 4:]
    bits = (np.arange(2**n)[:, None] >> np.arange(n)) & 1
    gap = range_m[..., 1] - range_m[..., 0]
    misfit = (range_m[..., 0] @ parity)[..., None, :] + bits.astype(float) @ (gap[..., None] * parity)
    squares = np.sum(misfit**2, axis=-1)
    least = np.sort(np.partition(squares, 1, axis=-1)[..., :2], axis=-1)
    return SkySplit(bits[np.argmin(squares, axis=-1)], least[..., 0], least[..., 1])


def known_sky_test(
    sky_m: Reals, unit_enu: Reals, baseline_enu_m: Reals, variance_m2: ArrayLike, sigma_m: Reals | None = None
) -> Reals:
    """p-value (...) of "this pairing is of the sky over antennas that are known"; variance_m2 (...) of each mean.

    sky_m : (..., K, R). With `sigma_m` (K, R), known up to a factor, the variance is that factor.
    """
    sigma_m = np.ones(sky_m.shape[-2:]) if sigma_m is None else sigma_m
    values, _, _ = table_contrasts(sky_m[..., None, :, :], sigma_m)
    error = values[..., 0, :] - _expected(sky_m.shape[-2:], unit_enu, baseline_enu_m, sigma_m)
    return chi_square_survival(np.sum(error**2, axis=-1) / np.asarray(variance_m2, float), error.shape[-1])


def transmit_antennas(difference_m: Reals, sigma_m: ArrayLike, false_alarm_probability: float) -> LineClusters:
    """From how many antennas false signals come, and which from the same, by differences (..., K) of two receivers.

    Signals of one antenna have the same difference; two antennas at equal difference of distance look as one. The
    probability of finding more antennas than there are is at most `false_alarm_probability`.
    """
    return line_clusters(difference_m, sigma_m, false_alarm_probability)


def pairings(receivers: int) -> NDArray[np.intp]:
    """(2^R, R): which of two skies each pairing takes from each receiver; the complement of row g is row -1 - g."""
    return np.array(list(itertools.product((0, 1), repeat=receivers)), np.intp)


class SpanTest(NamedTuple):
    """statistic and p_value (...); F with dof_num and dof_den degrees under H0."""

    statistic: Reals
    p_value: Reals
    dof_num: int
    dof_den: int


def span_test(one_m: Reals, other_m: Reals, unit_enu: Reals, sigma_m: Reals | None = None) -> SpanTest:
    """Test that a pairing comes from one antenna, with its complement's help to know the noise.

    Parameters
    ----------
    one_m, other_m : (..., K, R) mean ranges of the pairing and of its complement, K >= 5.
    unit_enu : (K, 3). sigma_m : (K, R) of the means, up to a common factor, the same in both; equal if None.
    """
    one, other, span = _contrasts(one_m, other_m, unit_enu, sigma_m)
    inside = np.sum((one @ span) ** 2, axis=-1)
    outside = _outside(one, span) + _outside(other, span)
    dof_num, dof_den = span.shape[1], 2 * (span.shape[0] - span.shape[1])
    statistic = inside / dof_num / np.maximum(outside / dof_den, 1e-300)
    return SpanTest(statistic, f_survival(statistic, dof_num, dof_den), dof_num, dof_den)


def known_baseline_test(
    one_m: Reals, other_m: Reals, unit_enu: Reals, baseline_enu_m: Reals, sigma_m: Reals | None = None
) -> Reals:
    """p-value (...) of "the pairing is of one antenna, and its complement of the sky over antennas that are known".

    Two tests, the smaller p-value doubled. One looks where "the other way round" would show: one direction of all 2M
    contrasts, Student's t against the 2M - 1 others, on both sides (pairings that mix show there as well, if the
    transmitter stands on the baseline's line). The other looks at all else that baselines span, as `span_test` does,
    for the rest of what mixes. Both are exact as that one is.

    Parameters
    ----------
    baseline_enu_m : (R-1, 3) of each receiver's antenna from the first one's. Others as of `span_test`.
    """
    one, other, span = _contrasts(one_m, other_m, unit_enu, sigma_m)
    expected = _expected(one_m.shape[-2:], unit_enu, baseline_enu_m, sigma_m)
    length = float(np.linalg.norm(expected))
    error = np.concatenate([one, other - expected], axis=-1)
    if length == 0.0:
        return np.ones(error.shape[:-1])
    direction = np.concatenate([expected, -expected]) / (np.sqrt(2.0) * length)
    along = error @ direction
    rest = np.maximum(np.sum(error**2, axis=-1) - along**2, 1e-300)
    p_swapped = 2.0 * special.stdtr(error.shape[-1] - 1, -np.abs(along) / np.sqrt(rest / (error.shape[-1] - 1)))
    inside = np.sum((one @ span) ** 2, axis=-1) + np.sum(((other - expected) @ span) ** 2, axis=-1) - along**2
    outside = _outside(one, span) + _outside(other, span)
    dof_num, dof_den = 2 * span.shape[1] - 1, 2 * (span.shape[0] - span.shape[1])
    p_mixed = f_survival(np.maximum(inside, 0.0) / dof_num / np.maximum(outside / dof_den, 1e-300), dof_num, dof_den)
    return np.asarray(np.minimum(1.0, 2.0 * np.minimum(p_swapped, p_mixed)))


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


class Choice(NamedTuple):
    """which : (...) the pairing that comes from one antenna, -1 if that is open. p_value : (...) of the runner-up: the
    probability of a choice as clear as this if it is wrong."""

    which: NDArray[np.intp]
    p_value: Reals


def choose(p_values: Reals, false_alarm_probability: float, *, accept_probability: float = 1e-9) -> Choice:
    """The one pairing out of p_values (..., G) that is of one antenna, if all others are rejected.

    A wrong choice needs the true pairing's p-value to be below `false_alarm_probability`, so it is at most as probable.
    None is chosen if even the best has less than `accept_probability`: then no pairing is of one antenna.
    """
    best = np.argmax(p_values, axis=-1)
    two = np.sort(p_values, axis=-1)[..., -2:]
    decided = (two[..., 0] < false_alarm_probability) & (two[..., 1] >= accept_probability)
    return Choice(np.where(decided, best, -1), two[..., 0])


def _contrasts(
    one_m: Reals, other_m: Reals, unit_enu: Reals, sigma_m: Reals | None
) -> tuple[Reals, Reals, Reals]:
    """Contrasts (..., M) of both tables, and the span of baselines, orthonormal (M, 3(R-1))."""
    sigma_m = np.ones(one_m.shape[-2:]) if sigma_m is None else sigma_m
    one, _, matrix = table_contrasts(one_m[..., None, :, :], sigma_m)
    other, _, _ = table_contrasts(other_m[..., None, :, :], sigma_m)
    span = np.linalg.qr(baseline_design(matrix, unit_enu)).Q
    return one[..., 0, :], other[..., 0, :], span


def _expected(shape: tuple[int, ...], unit_enu: Reals, baseline_enu_m: Reals, sigma_m: Reals | None) -> Reals:
    """(M,) contrasts of the sky over antennas that are known."""
    sigma_m = np.ones(shape) if sigma_m is None else sigma_m
    _, _, matrix = table_contrasts(np.zeros((1, *shape)), sigma_m)
    return np.asarray(baseline_design(matrix, unit_enu) @ np.asarray(baseline_enu_m, float).ravel(), float)


def _outside(contrasts: Reals, span: Reals) -> Reals:
    return np.asarray(np.sum((contrasts - (contrasts @ span) @ span.T) ** 2, axis=-1), float)
