"""Find a motion that codes show and carriers do not: arrays only.

`level - move` (`steps`) is constant for each satellite whatever the antenna and the oscillator do. An attack that does
not know the phases of the true signals may drag codes off to another position and leave the carriers. This changes it
over seconds:

    change = -u . drag + clock + errors                                     u receiver to satellite

The means over the first and the last quarter of a span are compared, with twice the variance of multipath: it may have
changed altogether. If codes move with carriers, `drag` is zero, and over its covariance chi-square with 3 degrees. Two
oscillators in a receiver change code against carrier as a clock does. The ionosphere's part is centimetres a second.
Reflections are independent between satellites (`whole_sky`).

Recordings that are joined step in a moment. A span in which all carriers break is not tested. If the loops did not see
the moment, it lies in one of the span's thirds or between two. So a motion that is not in every third counts as that of
some satellites.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from skyproof.arrays import Indices, Reals
from skyproof.detectors.continuity.policy import POLICY
from skyproof.detectors.continuity.series import Series
from skyproof.detectors.continuity.steps import fit_jump
from skyproof.detectors.continuity.whole_sky import SkyChange, SkyMotion, estimate_motions, select_least_likely
from skyproof.navigation.reflections import estimate_reflection_sigma_m
from skyproof.records import Observations

__all__ = ["find_code_drags"]

_QUARTERS: Final = 4


def find_code_drags(
    groups: Sequence[tuple[Observations, Series]], *, multipath_sigma_m: float, alpha: float
) -> list[SkyMotion | None]:
    """Find each group's least likely code drag, of those over `code_spans_s` up to the last epoch.

    groups : observations of one signal a transmission, and their series (`series.build_series`). alpha : as of
    `whole_sky.estimate_motions`. P-values are bounds, for all spans together. None where fewer than five satellites
    cover a span.
    """
    spans = [
        (number, o, series, quarters)
        for number, (o, series) in enumerate(groups)
        for span_s in POLICY.code_spans_s
        if (quarters := _average_quarters(series, span_s, multipath_sigma_m)) is not None
    ]
    changes = [
        SkyChange(
            np.array([signal.sat for signal in o.signals]),
            series.unit[-1],
            quarters.mean_m[-1] - quarters.mean_m[0],
            quarters.variance_m2[0] + quarters.variance_m2[-1],
            quarters.time_s,
        )
        for _, o, series, quarters in spans
    ]
    found: list[list[SkyMotion | None]] = [[] for _ in groups]
    for (number, _, series, quarters), motion in zip(
        spans, estimate_motions(changes, alpha=alpha / len(POLICY.code_spans_s)), strict=True
    ):
        if (
            motion is not None
            and motion.whole_sky_p_value < 1.0
            and not _is_gradual(series.unit[-1], quarters.mean_m, quarters.variance_m2)
        ):
            motion = motion._replace(whole_sky_p_value=1.0)
        found[number].append(motion)
    return [select_least_likely(motions) for motions in found]


class _Quarters(NamedTuple):
    """mean_m, variance_m2 (4, m) over the quarters of a span, and the time from the first to the last."""

    mean_m: Reals
    variance_m2: Reals
    time_s: float


def _average_quarters(series: Series, span_s: float, multipath_sigma_m: float) -> _Quarters | None:
    """Average offsets over the quarters of a span; None if the span is too short, or a break of all lies in it.

    The variance is that of noise, bridges, multipath and ionosphere.
    """
    t = series.elapsed_s
    first = int(np.searchsorted(t, t[-1] - span_s - 1e-6))
    if t[-1] - t[first] < (1.0 - POLICY.late_share) * span_s or series.divides[first + 1 :].any():
        return None
    edges = np.searchsorted(t, np.linspace(t[first], t[-1], _QUARTERS + 1)[1:-1])
    starts = np.array([first, *edges])
    if np.any(np.diff([*starts, t.size]) <= 0):
        return None
    mean_m, mean_m2 = _average_from(series, series.offset_m, starts)
    quadrature_m, _ = _average_from(series, series.quadrature_m, starts)
    reflected_m2 = estimate_reflection_sigma_m(quadrature_m, np.sqrt(mean_m2)) ** 2
    bridged_m2 = 0.5 * (series.bridge_m2[-1] - series.bridge_m2[first])
    time_s = float(t[starts[-1] :].mean() - t[first : starts[1]].mean())
    slow_m2 = multipath_sigma_m**2 + 0.5 * (POLICY.ionosphere_sigma_m_s * time_s) ** 2
    return _Quarters(mean_m, mean_m2 + bridged_m2 + reflected_m2 + slow_m2, time_s)


def _average_from(series: Series, values_m: Reals, starts: Indices) -> tuple[Reals, Reals]:
    """Average values (q, m), weighted by noise, from each of `starts` to the next; also return their variance.

    NaN where nothing is known.
    """
    first = int(starts[0])
    values_m, variance_m2 = values_m[first:], series.variance_m2[first:]
    known = np.isfinite(values_m) & (variance_m2 > 0.0)
    weight = np.where(known, 1.0 / np.where(known, variance_m2, 1.0), 0.0)
    total = np.add.reduceat(weight, starts - first, axis=0)
    information = np.where(total > 0.0, total, np.nan)
    sums = np.add.reduceat(weight * np.where(known, values_m, 0.0), starts - first, axis=0)
    return sums / information, 1.0 / information


def _is_gradual(unit: Reals, mean_m: Reals, variance_m2: Reals) -> bool:
    """Test if the motion is in every third: neither one step makes it, nor two."""
    units = np.broadcast_to(unit, (4, *unit.shape))
    rows = np.array([[0, 3], [0, 1], [1, 2], [2, 3]])
    fitted = fit_jump(units, mean_m[rows[:, 1]] - mean_m[rows[:, 0]], variance_m2[rows].sum(axis=1))
    moved, covariance = fitted.jump[:, :3], fitted.covariance[:, :3, :3]
    along = moved[0] / np.linalg.norm(moved[0])
    sigmas = (moved[1:] @ along) / np.sqrt(along @ covariance[1:] @ along)
    return bool(np.all(sigmas > POLICY.sure_sigmas))
