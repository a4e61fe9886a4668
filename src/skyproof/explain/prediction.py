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
    "skies that part farther, or a better prediction: an inertial unit, a better oscillator, a surveyed position"
)


def _describe(template: str) -> "Any":
    """Return a function that fills a template with what was compared, and by what."""

    def fill(finding: Finding) -> str:
        data: Mapping[str, Any] = finding.data
        return template.format(
            receiver=finding.signals[0].receiver,
            apart="{apart_m:.0f} m and {apart_ns:.0f} ns apart".format(**data) if "apart_m" in data else "",
            sure=f"the probability that this is the wrong choice is {_round_up(data['wrong'])} or less"
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
    return Entry(_describe("of {skies} skies of {receiver}, {apart}, none is chosen: " + why), _REMEDY)


ENTRIES: Final[Mapping[str, Entry]] = {
    "only_sky": Entry("the only sky of {receiver}, before a second one was seen"),
    "goes_on": Entry(_describe("the signals of {receiver} that were chosen before go on as expected by {by}")),
    "chosen": Entry(_describe("of {skies} skies of {receiver}, {apart}, this one fits {by}; {sure}")),
    "chosen_first": Entry(
        _describe("which of {skies} skies of {receiver} is true was chosen from {since} on by {by}; {sure}"),
        beside=True,
    ),
    "refused": Entry(
        _describe(
            "of {skies} skies of {receiver}, {apart}, this one does not fit {by} (p = {fit:.0e}), and another one does "
            "(p = {true_fit:.2g}); {sure}"
        )
    ),
    "chosen_overlapping": Entry(
        _describe(
            "in signals of {receiver} that overlap within a chip are {skies} skies, {apart}, of {satellites} "
            "satellites each; the true one was chosen by {by}, and its fixes are trusted; {sure}"
        ),
        beside=True,
    ),
    "none_fits": _open("none of them fits {by} (p = {fit:.0e})"),
    "too_uncertain": _open(
        "by {by} the likelier one is wrong with a probability of {wrong:.2g}, more than the limit of {most_wrong:g}"
    ),
    "maybe_one_sky": _open(
        "the likelier one alone, with its reflections or by chance, may make the others (p = {doubt:.2g})"
    ),
    "no_difference": _open("in what {by} shows they do not differ by more than their noise"),
    "both_may_be_false": _open(
        "they differ in what {by} does not show, too, and are of so few satellites that both may be false"
    ),
}
