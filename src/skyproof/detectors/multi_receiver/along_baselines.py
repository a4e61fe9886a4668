"""Test by two skies, whatever the noise over time, that one of them is not the one that comes from one antenna.

A table of mean ranges holds K satellites by R receivers. It differs from that of one antenna by *baselines*, 3(R-1)
dimensions. (For false positions 500 m away that is true to 6 mm, growing with the square.) What no baseline explains is
noise under every hypothesis. Two views show what that is:

- *differences* between receivers, free of whatever a satellite has in common in all of them: (K-1)(R-1) contrasts of
  each table, (K-4)(R-1) of them noise;
- *fixes*: each sky against position and clock in its own receiver: R(K-4) dimensions of noise of each table, twice as
  many with two receivers. Errors that receivers share (orbit, atmosphere, the transmitter's own) enlarge this noise and
  nothing else, since the square along baselines is taken between receivers. The test is then too careful.

Where the table is from one antenna, the other table's 3(R-1) dimensions along baselines hold noise, and perhaps a
baseline. They join the noise, which costs nothing where the other way round is true. Where both tables mix two skies it
does, so one test leaves them out. The statistic

    F = (square along baselines / 3(R-1)) / (squares of the noise / their dimensions)

is exactly F if the one table has one antenna and the other no baseline, and smaller with one. The means' errors have to
be normal, independent and of sigmas in known proportion. Nothing is asked about time: correlated and constant errors
cancel, of whatever size. A test of means against the scatter over time cannot have that.

The p-value is the smallest of three, each divided by its share of the rate (Bonferroni's bound). Of all invariant tests
that hold whatever noise and baseline, none is more powerful than F with all dimensions, 3(R-1) and 2R(K-4) + 3(R-1).
Only the division costs some of it.

Where it is stated how the antennas stand, the sky's table lies ahead in one known direction of these 3(R-1), and half
of the rate goes to Student's t of the part of the one table that points there. What the statement says bears on the
power alone: a table of one antenna points nowhere, and exceeds the threshold as rarely if the statement is wrong.

The model is that of N. Stenberg, E. Axell, J. Rantakokko, G. Hendeby, NAVIGATION 69(1), 2022, doi 10.33012/navi.510;
deciding for groups is our own.
"""

from typing import Final, NamedTuple

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.multi_receiver.one_antenna import baseline_design
from skyproof.detectors.multi_receiver.policy import POLICY
from skyproof.statistics.distributions import f_survival

__all__ = ["AlongBaselines", "SpanTest", "combine_views", "project", "span_test"]

_LEAST_SINE: Final = 1e-4  # below, two directions are one but for rounding


class AlongBaselines(NamedTuple):
    """A table in units of its sigmas.

    along : (..., 3(R-1)) along baselines. design : baselines in metres to these. fixes, differences : the square (...)
    of what is noise under every hypothesis, and its dimensions.
    """

    along: Reals
    design: Reals
    fixes: tuple[Reals, int]
    differences: tuple[Reals, int]


class SpanTest(NamedTuple):
    """p_value : (...) of all three. Before they are combined: `fixes`, all noise; `differences`, without what
    receivers share; `alone`, without the other table's own place as well, for pairings that mix."""

    p_value: Reals
    fixes: Reals
    differences: Reals
    alone: Reals


def project(table_m: Reals, unit_enu: Reals, sigma_m: Reals | None = None) -> AlongBaselines:
    """Split a table into what lies along baselines, and what is noise whatever sent it.

    Parameters
    ----------
    table_m : (..., K, R) mean ranges, less what is expected at one point within a kilometre or so; K >= 5.
    unit_enu : (K, 3) receiver to satellite, mean over the window. sigma_m : (K, R) of the means; equal if None.
    """
    k, r = table_m.shape[-2:]
    weight = np.ones(k * r) if sigma_m is None else 1.0 / np.asarray(sigma_m, float).ravel()
    # Ranges may be 2e7 m and what is sought is millimetres: take the common part off before multiplying.
    flat = table_m.reshape(*table_m.shape[:-2], k * r)
    scaled = (flat - flat[..., :1]) * weight
    baselines = baseline_design(np.diag(weight), unit_enu)
    receiver, satellite, position = (
        weight[:, None] * columns
        for columns in (np.tile(np.eye(r), (k, 1)), np.repeat(np.eye(k), r, axis=0), np.repeat(unit_enu, r, axis=0))
    )
    shared = np.column_stack([satellite, receiver[:, 1:]])
    free, spanned = shared.shape[1], shared.shape[1] + baselines.shape[1]
    by_differences = np.linalg.qr(np.column_stack([shared, baselines]), mode="complete")
    along = by_differences.Q[:, free:spanned]
    # With sigmas of a satellite's factor times a receiver's, what is along baselines lies within the fixes; with others
    # it does not, and the noise has to keep clear of it.
    fixed = np.linalg.qr(np.column_stack([position, receiver, baselines])).Q
    basis, size, _ = np.linalg.svd(np.column_stack([fixed, along]))
    fixes, differences = (
        (np.sum((scaled @ rest) ** 2, axis=-1), rest.shape[1])
        for rest in (basis[:, int(np.sum(size > _LEAST_SINE)) :], by_differences.Q[:, spanned:])
    )
    return AlongBaselines(scaled @ along, by_differences.R[free:spanned, free:], fixes, differences)


def span_test(
    one_m: Reals,
    other_m: Reals,
    unit_enu: Reals,
    sigma_m: Reals | None = None,
    *,
    other_unit_enu: Reals | None = None,
    other_sigma_m: Reals | None = None,
    stated_enu_m: Reals | None = None,
) -> SpanTest:
    """Test that a table comes from one antenna, with another's help to know the noise.

    `alone` is uniform if it does; the two others are if, besides, the other table has no baseline and (`fixes`)
    receivers share no errors, and are larger otherwise. What is stated as 1 % is 0.9 % without a baseline, and falls to
    0.06 % over baselines that are seen.

    Parameters
    ----------
    one_m, other_m, unit_enu, sigma_m : as of `project`; sigmas up to one factor that both tables share.
    other_unit_enu, other_sigma_m : of the other table, where they are not the same. stated_enu_m : (R-1, 3) of each
        receiver's antenna from the first one's, where that is stated.
    """
    one = project(one_m, unit_enu, sigma_m)
    other = project(
        other_m,
        unit_enu if other_unit_enu is None else other_unit_enu,
        sigma_m if other_sigma_m is None else other_sigma_m,
    )
    beside, dof = np.sum(other.along**2, axis=-1), other.along.shape[-1]
    (fixes, fixes_dof), (differences, differences_dof) = (
        (mine[0] + theirs[0], mine[1] + theirs[1])
        for mine, theirs in ((one.fixes, other.fixes), (one.differences, other.differences))
    )
    ahead = None if stated_enu_m is None else one.design @ np.asarray(stated_enu_m, float).ravel()
    by_fixes = _test_along(one.along, ahead, fixes + beside, fixes_dof + dof)
    by_differences = _test_along(one.along, ahead, differences + beside, differences_dof + dof)
    alone = _test_along(one.along, None, differences, differences_dof)
    return SpanTest(combine_views(by_fixes, by_differences, alone), by_fixes, by_differences, alone)


def combine_views(fixes: Reals, differences: Reals, alone: Reals) -> Reals:
    """Combine p-values to one by Bonferroni's bound."""
    parts = (
        (fixes, POLICY.fixes_share),
        (differences, POLICY.differences_share),
        (alone, POLICY.alone_share),
    )
    least = np.min([p_value / share for p_value, share in parts], axis=0)
    return np.asarray(np.minimum(least, 1.0), float)


def _test_along(along: Reals, ahead: Reals | None, noise: Reals, noise_dof: int) -> Reals:
    """Test that the part (..., d) along baselines is noise; where the sky would put it `ahead` (d,), look there too."""
    square, dof = np.sum(along**2, axis=-1), along.shape[-1]
    anywhere = f_survival(square / dof / np.maximum(noise / noise_dof, 1e-300), dof, noise_dof)
    if ahead is None or not ahead.any():
        return anywhere
    forward = along @ ahead / np.linalg.norm(ahead)
    noise, noise_dof = noise + np.maximum(square - forward**2, 0.0), noise_dof + dof - 1
    two_sided = f_survival(forward**2 / np.maximum(noise / noise_dof, 1e-300), 1, noise_dof)
    there = np.where(forward > 0.0, 0.5 * two_sided, 1.0)
    return np.asarray(np.minimum(2.0 * np.minimum(anywhere, there), 1.0))
