"""What the choice between skies finds, in words."""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from skyproof.explain.bases import name_bases
from skyproof.explain.entry import Entry
from skyproof.explain.units import clock
from skyproof.records import Finding

__all__ = ["ENTRIES"]

_REMEDY: Final = (
    "skies that are farther apart, or a better prediction: an inertial unit, a better oscillator, a surveyed position"
)


def _describe(template: str) -> "Any":
    """Return a function that fills a template with what was compared, and by what."""

    def fill(finding: Finding) -> str:
        data: Mapping[str, Any] = finding.data
        return template.format(
            receiver=finding.signals[0].receiver,
            apart="{apart_m:.0f} m and {apart_ns:.0f} ns apart".format(**data) if "apart_m" in data else "",
            sure=f"this choice is wrong with a probability of {_round_up(data['wrong'])} or less"
            if "wrong" in data
            else "",
            since=clock(finding.start_gpst),
            **{**data, "by": name_bases(data["by"])},
        )

    return fill


def _round_up(probability: float) -> str:
    """Return a probability rounded up to one digit."""
    unit = 10.0 ** np.floor(np.log10(probability))
    return f"{np.ceil(probability / unit - 1e-9) * unit:.0e}"


def _open(why: str) -> Entry:
    return Entry(_describe("{receiver} receives {skies} skies, {apart}, and none is chosen: " + why), _REMEDY)


ENTRIES: Final[Mapping[str, Entry]] = {
    "only_sky": Entry("this was the only sky of {receiver} before a second one was seen"),
    "goes_on": Entry(_describe("the chosen signals of {receiver} continue as predicted by {by}")),
    "chosen": Entry(_describe("{receiver} receives {skies} skies, {apart}, and this one fits {by}; {sure}")),
    "chosen_first": Entry(
        _describe("from {since} on, {by} decided which of {skies} skies of {receiver} is true; {sure}"),
        beside=True,
    ),
    "refused": Entry(
        _describe(
            "{receiver} receives {skies} skies, {apart}; this one does not fit {by} (p = {fit:.0e}), another one does "
            "(p = {true_fit:.2g}); {sure}"
        )
    ),
    "chosen_overlapping": Entry(
        _describe(
            "the overlapping signals of {receiver} hold {skies} skies, {apart}, of {satellites} satellites each; "
            "the true one was chosen by {by}, and its fixes are trusted; {sure}"
        ),
        beside=True,
    ),
    "none_fits": _open("none of them fits {by} (p = {fit:.0e})"),
    "too_uncertain": _open(
        "judged by {by}, the likelier one is wrong with a probability of {wrong:.2g}, above the limit {most_wrong:g}"
    ),
    "maybe_one_sky": _open("reflections of the likelier one, or chance, may explain the others (p = {doubt:.2g})"),
    "no_difference": _open("judged by {by}, they differ by no more than noise"),
    "both_may_be_false": _open(
        "they also differ where {by} predicts nothing, and have so few satellites that both may be false"
    ),
}
