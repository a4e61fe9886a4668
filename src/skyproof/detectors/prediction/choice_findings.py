"""What a choice between skies, or that none was made, comes to as findings."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from skyproof.fusion.candidates import SkyCandidates
from skyproof.fusion.policy import POLICY
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.navigation.prediction import Choice
from skyproof.navigation.predictor import SkyFix
from skyproof.records import (
    UNTESTED,
    Cause,
    ConsistentSet,
    Datum,
    Finding,
    Hypothesis,
    ObservationLog,
    OverlappingSkies,
    list_refs,
)

__all__ = ["CHOSEN", "DETECTOR", "chosen", "report_chosen_overlapping", "report_not_chosen", "report_only_sky"]

DETECTOR: Final = "prediction"
CHOSEN: Final = ("chosen_first", "chosen_overlapping")
"""Codes of the findings in which a true sky was chosen first."""


def report_only_sky(
    o: ObservationLog, window: SkyCandidates, end_gpst: np.datetime64, code: str, data: Mapping[str, Datum]
) -> Finding:
    """Return that the window's only sky is authentic by what is assumed."""
    return Finding(
        detector=DETECTOR,
        start_gpst=window.start,
        end_gpst=end_gpst,
        signals=list_refs(o.receiver, window.sets[0].signals),
        hypothesis=Hypothesis.FALSE_SKY,
        code=code,
        data=data,
    )


def chosen(
    o: ObservationLog,
    window: SkyCandidates,
    shown: Sequence[SkyFix],
    choice: Choice,
    by: tuple[str, ...],
    data: Mapping[str, Datum],
    *,
    most_wrong: float,
    first: bool,
) -> list[Finding]:
    """Return that one sky is authentic and the others are spoofed. first : of its receiver."""
    assert choice.chosen is not None
    wrong = max(choice.wrong_probability, POLICY.least_wrong_probability)
    fits = {number: float(fit) for number, fit in enumerate(choice.fits)}
    common: dict[str, Any] = {
        "detector": DETECTOR,
        "start_gpst": window.start,
        "end_gpst": window.end,
        "alpha": most_wrong,
    }
    about = _compare(shown, choice, by) | {"log_likelihood_ratio": float(np.log1p(-wrong) - np.log(wrong))}
    true = Finding(
        signals=list_refs(o.receiver, window.sets[choice.chosen].signals),
        hypothesis=Hypothesis.FALSE_SKY,
        code="chosen_first" if first else "chosen",
        p={Cause.FALSE_SKY: wrong},
        data=about | dict(data),
        **common,
    )
    false = [
        Finding(
            signals=list_refs(o.receiver, window.sets[number].signals),
            hypothesis=Hypothesis.ONE_OF_SKIES,
            code="refused",
            p={Cause.CLEAN: wrong},
            singled_out=True,
            data=about | {"fit": fit, "true_fit": fits[choice.chosen], "whole_sky": True},
            **common,
        )
        for number, fit in fits.items()
        if number != choice.chosen
    ]
    return [true, *false]


def report_chosen_overlapping(
    o: ObservationLog,
    window: SkyCandidates,
    skies: OverlappingSkies,
    shown: Sequence[SkyFix],
    choice: Choice,
    by: tuple[str, ...],
    data: Mapping[str, Any],
    doubt: float,
) -> Finding:
    """Return which of two skies within a chip is true: no signal is named, for the channels follow their sum.

    doubt : that these are not skies to choose from.
    """
    assert choice.chosen is not None
    about = _compare(shown, choice, by, doubt) | dict(data)
    return Finding(
        detector=DETECTOR,
        start_gpst=window.start,
        end_gpst=window.end,
        signals=list_refs(o.receiver, skies.sets[0].signals),
        hypothesis=Hypothesis.ONE_OF_SKIES,
        code="chosen_overlapping",
        data=about | {"satellites": len(skies.sets[0].signals), "assumes": (*data["assumes"], "one_of_overlapping")},
    )


def report_not_chosen(
    o: ObservationLog,
    window: SkyCandidates,
    skies: Sequence[ConsistentSet],
    shown: Sequence[SkyFix],
    choice: Choice,
    by: tuple[str, ...],
    most_wrong: float,
    doubt: float = 0.0,
) -> Finding:
    """Return that the window stays open, and why.

    skies : that were compared; doubt : that these are not skies to choose from.
    """
    fit = float(np.max(choice.fits))
    wrong = choice.wrong_probability
    # Skies that do not differ, or of which both may be false, leave nothing to test by.
    p, alpha = {Cause.FALSE_SKY: UNTESTED}, most_wrong
    hypothesis = Hypothesis.FALSE_SKY
    if fit < POLICY.refused_probability:
        code, hypothesis, alpha = "none_fits", Hypothesis.ONE_OF_SKIES, POLICY.refused_probability
        p = {Cause.CLEAN: fit, Cause.STATEMENT: UNTESTED}
    elif wrong > most_wrong:
        code, p = "too_uncertain", {Cause.FALSE_SKY: wrong}
    elif wrong + doubt > most_wrong:
        code, p = "maybe_one_sky", {Cause.FALSE_SKY: min(1.0, wrong + doubt)}
    else:
        code = "no_difference" if choice.chosen is None else "both_may_be_false"
    return Finding(
        detector=DETECTOR,
        start_gpst=window.start,
        end_gpst=window.end,
        signals=tuple(dict.fromkeys(ref for s in skies for ref in list_refs(o.receiver, s.signals))),
        hypothesis=hypothesis,
        code=code,
        p=p,
        alpha=alpha,
        data=_compare(shown, choice, by) | {"fit": fit, "most_wrong": most_wrong, "doubt": doubt},
    )


def _compare(shown: Sequence[SkyFix], choice: Choice, by: tuple[str, ...], doubt: float = 0.0) -> dict[str, Datum]:
    """Return how many skies were compared and by what, how far apart the likeliest two are, and how sure the choice is.

    doubt : that it was one between other skies.
    """
    likeliest, other = (shown[k].whole for k in np.argsort(-choice.probabilities)[:2])
    off = likeliest.mean - other.mean
    return {
        "skies": len(shown),
        "by": by,
        "apart_m": float(np.linalg.norm(off[:3])),
        "apart_ns": float(abs(off[6]) / SPEED_OF_LIGHT_M_S * 1e9),
        "wrong": float(max(choice.wrong_probability + doubt, POLICY.least_wrong_probability)),
    }
