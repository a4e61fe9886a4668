"""Studies of exclusion, the third part of the paper on decomposition (Ahmed, Khanafseh, Pervan): on the approach to Las
Vegas a free-running inertial unit says which of two fixes is true.

What computes them is in `dccaf_exclusion_figures`."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from skyproof.report.chart import Axes
from skyproof.studies.base import Claim, Row, Study, value_of
from skyproof.studies.dccaf_exclusion_figures import BOTH, SET, THRESHOLD_S, approach, exclusion, interval, restart

__all__ = ["STUDIES_OF_EXCLUSION"]

PAPER: Final = "Ahmed, Khanafseh, Pervan, decomposition of the cross-ambiguity function with inverse RAIM and inertia"


def _farthest(rows: Sequence[Row]) -> float:
    """Return the drift counted over that predicted, of the row and axis where they differ most."""
    ratios = [row[f"{axis}_m"] / row[f"{axis}_predicted_m"] for row in rows for axis in ("east", "north", "up")]
    return float(max(ratios, key=lambda ratio: abs(ratio - 1.0)))


def _largest_excess(rows: Sequence[Row]) -> float:
    """Return wrong choices counted less predicted, in standard deviations of the count, at their largest."""
    sigmas = []
    for row in rows:
        chance, trials = row["wrong_predicted"], row["trials"]
        sigma = max(np.sqrt(chance * (1.0 - chance) / trials), 1.0 / trials)
        sigmas.append((row["wrong_covariance"] - chance) / sigma)
    return float(max(sigmas, key=abs))


_PICTURE: Final = "a picture"
_ONE_RUN: Final = "one run"
_COUNTED: Final = (
    Claim(
        what="drift over the linear covariance's, farthest from one",
        paper="none",
        reference=1.0,
        same=_farthest,
        tolerance=lambda rows: float(4.5 / np.sqrt(2.0 * min(row["trials"] for row in rows))),
    ),
    Claim(
        what="wrong choices, counted less predicted, in sigmas, farthest",
        paper="none",
        reference=0.0,
        same=_largest_excess,
        tolerance=4.0,
    ),
)
_APPROACH: Final = (
    ("threshold, east of the fix, m (reference along the parallel half-way)", "east_m", THRESHOLD_S, 7024.0, 8.0),
    ("threshold, north of the fix, m", "north_m", THRESHOLD_S, 15150.0, 5.0),
    ("speed, m/s (140 kt)", "speed_m_s", 0.0, 72.02, 0.005),
    (
        "height at 90 s, ft (the paper: below 4000; reference: an even descent, ours: straight in space)",
        "height_ft",
        90.0,
        3988.0,
        20.0,
    ),
    ("false path east of the true at 200 s, m", "false_east_m", 200.0, 70.7, 0.05),
    ("false path above the true at 200 s, m", "false_up_m", 200.0, 70.7, 0.05),
    ("offset at 100 s, m (the paper: detected then)", "offset_m", 100.0, 10.0, 0.05),
)
STUDIES_OF_EXCLUSION: Final[tuple[Study, ...]] = (
    Study(
        name="dccaf.approach",
        title="The approach and the path that the spoofer shows",
        paper=PAPER,
        figure="Figures 6 and 8",
        run=approach,
        charts=(
            Axes(title="Height above the ellipsoid", x="time_s", y="height_m", x_label="time, s", y_label="height, m"),
            Axes(
                title="False path from the true one", x="time_s", y="offset_m", x_label="time, s", y_label="offset, m"
            ),
        ),
        claims=(
            *(
                Claim(
                    what=what,
                    paper=_PICTURE,
                    reference=reference,
                    same=value_of(column, time_s=time_s),
                    tolerance=tolerance,
                    digits=5,
                )
                for what, column, time_s, reference, tolerance in _APPROACH
            ),
            Claim(
                what="detected at 100 s",
                paper="detected",
                reference="not separable at 45 dB-Hz and 20 ms: the offset is at most 0.034 chip; "
                "the files have no noise, or 190 s are meant, 100 s after the onset",
            ),
            Claim(
                what="coordinates of figure 8",
                paper="30.29 N, 97.74 W",
                reference="cannot be reproduced: that is Austin, Texas, another data set",
            ),
        ),
    ),
    Study(
        name="dccaf.exclusion",
        title="Which fix is true: the free-running unit decides",
        paper=PAPER,
        figure="Figure 11",
        note="At 233 s. References of drifts are 300 runs, tolerance 10 %; choices by distance, covariance (better).",
        run=exclusion,
        charts=(
            Axes(
                title="Drift to the east of a free-running unit",
                x="time_s",
                y="east_m",
                x_label="time, s",
                y_label="1 sigma, m",
                by=("grade", "errors"),
                y_log=True,
            ),
            Axes(
                title="Wrong choice between two fixes, by covariance (predicted)",
                x="time_s",
                y="wrong_predicted",
                x_label="time, s",
                y_label="probability",
                by=("grade", "errors"),
                where={"grade": "tactical"},
            ),
        ),
        claims=(
            *(
                claim
                for grade, errors, drift, wrong in (
                    ("navigation", "table 1", 2.5, 0.0),
                    ("navigation", "calibrated, start", 19.0, 6e-4),
                    ("navigation", "switch-on, start", 49.0, 8e-3),
                    ("tactical", "table 1", 92.0, 2.4e-3),
                    ("tactical", "table 1, start", 93.0, 0.02),
                    ("tactical", "calibrated, start", 182.0, 0.26),
                    ("tactical", "switch-on, start", 686.0, 0.43),
                )
                for claim in (
                    Claim(
                        what=f"{grade}, {errors}",
                        across="drift east, m",
                        paper=_ONE_RUN,
                        reference=drift,
                        tolerance=0.1 * drift,
                        same=value_of("east_m", grade=grade, errors=errors, time_s=233),
                    ),
                    Claim(
                        what=f"{grade}, {errors}",
                        across="wrong choice",
                        paper=_ONE_RUN,
                        reference=wrong,
                        same=value_of("wrong_nearest", grade=grade, errors=errors, time_s=233),
                        better=value_of("wrong_covariance", grade=grade, errors=errors, time_s=233),
                    ),
                )
            ),
            *_COUNTED,
        ),
    ),
    Study(
        name="dccaf.interval",
        title="After a clean fix: how soon and how long the next choice is safe",
        paper=PAPER,
        figure="None: the interval between decompositions",
        note="Wrong choices by the rule of thumb (same) and as counted (better).",
        run=interval,
        charts=(
            Axes(
                title="Wrong choice after a clean fix (predicted), the false fix leaving at 1 m/s",
                x="interval_s",
                y="wrong_predicted",
                x_label="time since the clean fix, s",
                y_label="probability",
                by=("grade", "errors"),
                where={"grade": "tactical"},
                y_log=True,
            ),
        ),
        claims=(
            *(
                Claim(
                    what=f"{grade}, {errors}: {interval_s} s",
                    paper="left for later",
                    reference=reference,
                    same=value_of("wrong_rule", grade=grade, errors=errors, interval_s=interval_s),
                    better=value_of("wrong_covariance", grade=grade, errors=errors, interval_s=interval_s),
                    tolerance=tolerance,
                )
                for grade, errors, interval_s, reference, tolerance in (
                    ("navigation", "table 1, start", 10, 1.4e-2, 2e-3),
                    ("tactical", "table 1, start", 10, 1.4e-2, 2e-3),
                    ("tactical", "table 1, start", 15, 7e-4, 2e-4),
                    ("tactical", "calibrated, start", 100, 4e-4, 1e-4),
                    ("tactical", "switch-on, start", 10, 2e-2, 4e-3),
                    ("tactical", "switch-on, start", 20, 4.5e-3, 1e-3),
                    ("tactical", "switch-on, start", 60, 0.05, 0.005),
                    ("tactical", "switch-on, start", 100, 0.16, 0.016),
                )
            ),
            *_COUNTED,
        ),
    ),
    Study(
        name="dccaf.restart",
        title="A tactical unit that takes a fix on its way",
        paper=PAPER,
        figure="Figure 14",
        note="At 233 s, restarted at 190 s.",
        run=restart,
        charts=(
            Axes(
                title="Drift to the east at 233 s of tactical units that took a fix at 190 s",
                x="restart",
                y="east_m",
                x_label="at 190 s",
                y_label="1 sigma, m",
                by=("errors",),
                y_log=True,
            ),
        ),
        claims=(
            Claim(
                what="table 1: wrong choice by distance, without a restart",
                paper="unreliable",
                reference=0.24,
                same=value_of("wrong_nearest", errors="table 1", restart="none"),
                tolerance=0.04,
            ),
            Claim(
                what="table 1: wrong choice, place set, by distance (same) and covariance (better)",
                paper="one run",
                same=value_of("wrong_nearest", errors="table 1", restart=SET),
                better=value_of("wrong_covariance", errors="table 1", restart=SET),
            ),
            *(
                Claim(
                    what=f"tactical, {errors}: drift east, m, place set (same), place and velocity updated (better)",
                    paper=_ONE_RUN,
                    reference="see the covariance below",
                    same=value_of("east_m", errors=errors, restart=SET),
                    better=value_of("east_m", errors=errors, restart=BOTH),
                )
                for errors in ("table 1", "calibrated, start")
            ),
            Claim(
                what="the curves of the figure",
                paper="one run each",
                reference="a run is one draw: its distribution is compared instead, by the covariance",
            ),
            *_COUNTED,
        ),
    ),
)
