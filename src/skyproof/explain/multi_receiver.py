"""What `multi_receiver` finds, in words."""

from collections.abc import Callable, Mapping
from typing import Any, Final

from skyproof.explain.entry import Entry, collect_fields, join
from skyproof.records import Finding

__all__ = ["ENTRIES"]

_WHERE: Final = "the distance between the antennas (antenna_distance_m), or where they stand (antennas_enu_m)"
_MEASURED_AGAIN: Final = "what was given of the antennas, measured again"
_MORE_SATELLITES: Final = "more satellites in view"
_BETTER: Final = (
    "a longer recording, to know better where the antennas stand, or to allow for longer reflections than the "
    "{multipath_sigma_m:g} m of multipath_sigma_m"
)
_KNOWN: Final[Mapping[str, str]] = {
    "places": "where the antennas are known to stand",
    "distance": "the distance of {distance_m:g} m that was given",
    "learnt_distance": "the distance of {distance_m:.1f} m that they had while both skies were received",
    "learnt_baseline": "where the antennas stand by the windows in which both skies are received",
}
_SHOWN: Final[Mapping[str, str]] = {
    "code": "range differences between the receivers vary by {scatter_m:.1f} m between satellites",
    "skies": (
        "range differences between the receivers vary by {scatter_m:.1f} m between satellites, far more than those of "
        "the other signals"
    ),
    "carriers": "the carriers' differences between the receivers are no whole cycles from satellite to satellite",
}
_CARRIERS: Final[Mapping[str, str]] = {
    "unused": "",
    "missing": ", or carrier phases of 5 satellites in each receiver, steady over a window, at known instants",
    "coarse": ", or to know more closely where the antennas stand (antennas_enu_m), which carriers would tell",
    "misfit": ", or better carriers: they fit neither one antenna nor what is known of the antennas",
}
_FEW_ECHOES: Final = "echoes of so few satellites, received in place of blocked signals, may fit a wrong place"
_ONE_ANTENNA: Final = "{signals} come from one antenna: they do not show {known}"
_NOT_ONE: Final = "{signals} do not come from one antenna: {shown}"
_ELSEWHERE: Final = "{signals} disagree with {known}{far}"
_MIXED: Final = "one receiver may follow a false sky and another the true one"

_SENTENCES: Final[Mapping[str, str]] = {
    "one_set": "no five signals of {missing} fit one position, so that it cannot be compared",
    "few_in_common": "{common} satellites are in the consistent sets of {names} alike, and {needed} are needed",
    "few_common_epochs": "no {needed} signals of one kind are in {names} over {epochs} common epochs",
    "one_antenna": _ONE_ANTENNA,
    "one_antenna_of_several": _ONE_ANTENNA,
    "one_antenna_over_time": f"in {{length_s:.0f}} s together, {_ONE_ANTENNA}",
    "one_antenna_if_apart": (
        "{signals} come from one antenna, if the receivers' antennas are {limit_m:g} m or more apart"
    ),
    "one_place": (
        "{signals} put the antennas into one place, to millimetres, but the receivers' noise is of antennas that differ"
    ),
    "one_antenna_or_sky": (
        "{signals} could come from one antenna or from the sky: range differences between the receivers vary by "
        "{scatter_m:.1f} m between satellites, which errors may explain"
    ),
    "one_antenna_or_few_echoes": f"{{signals}} could come from one antenna, or from the sky: {_FEW_ECHOES}",
    "least_contrast": (
        "{signals} come from one antenna: range differences between the receivers vary by {scatter_m:.2f} m between "
        "satellites, those of any other pairing by {others_m:.1f} m or more"
    ),
    "as_known": f"{_NOT_ONE}; they agree with {{known}}{{doubtful_ones}}",
    "as_known_over_time": (
        "in {length_s:.0f} s together, {signals} do not come from one antenna; they agree with {known}{doubtful_ones}"
    ),
    "beside_false_sky": f"{_NOT_ONE}; the receivers' other signals come from one antenna{{doubtful_ones}}",
    "one_may_be_false": "{signals} do not come from one antenna, but one receiver alone may follow a false sky",
    "as_learnt": (
        "{signals} do not come from one antenna, but one receiver alone may follow a false sky; they agree with {known}"
    ),
    "elsewhere_than_learnt": f"{_NOT_ONE}, but they do not agree with {{known}}",
    "elsewhere_than_known": f"{_ELSEWHERE}; some of them are imitations, or what was given is wrong",
    "maybe_elsewhere": _ELSEWHERE,
    "elsewhere_by_few": f"{_ELSEWHERE}; {_FEW_ECHOES}",
    "swings": "the range differences of {signals} swing by {noise_m:.0f} m within the window",
    "too_far": (
        "{signals} put the antennas {farthest_m:.0f} m apart, more than the {limit_m:g} m that they may be: " + _MIXED
    ),
    "too_near": (
        "{signals} put the antennas {farthest_m:.0f} m apart, less than the {limit_m:g} m that were stated: " + _MIXED
    ),
    "sets_by_chance": ("several sets of signals that each fit one position ({counts}); which is true was not decided"),
    "several_skies": "several sets of signals that each fit one position ({counts}); which is true was not decided",
    "second_sky": "{n_signals} signals in {receiver} fit one position beside that of the signals that are true",
    "unlike_echoes": "{second_ones} earlier, later or stronger than echoes of true signals would be",
    "unlike_echoes_of_one_antenna": (
        "{second_ones} earlier, later or stronger than echoes of true signals would be, and come from one antenna"
    ),
}

_SKIES_REMEDY: Final = (
    "a longer window, antennas farther apart, both skies tracked in all receivers, or to know where the antennas stand "
    "(antennas_enu_m)"
)
_REMEDIES: Final[Mapping[str, str]] = {
    "one_set": "5 or more satellites with pseudoranges and orbits in {missing}",
    "few_in_common": "more satellites in common",
    "few_common_epochs": "measurements at the same times and of the same signals, or a longer window",
    "one_antenna": _MEASURED_AGAIN,
    "one_place": _WHERE,
    "one_antenna_or_sky": "a longer window, or antennas farther apart{of_carriers}{or_where}",
    "one_antenna_or_few_echoes": _MORE_SATELLITES,
    "one_may_be_false": _WHERE,
    "elsewhere_than_learnt": "a longer recording",
    "elsewhere_than_known": _MEASURED_AGAIN,
    "maybe_elsewhere": _BETTER,
    "elsewhere_by_few": _MORE_SATELLITES,
    "swings": _BETTER,
    "too_far": (
        f"{_WHERE}; or, if they may be that far apart, a larger max_separation_m in the table [protect] of a platform "
        "file"
    ),
    "too_near": _MEASURED_AGAIN,
    "few_without_doubtful": "a third receiver, or antennas in another direction from each other",
    "sets_by_chance": _SKIES_REMEDY,
    "several_skies": _SKIES_REMEDY,
}


def _describe(finding: Finding, code: str) -> str:
    """Describe what was found, and what may be wrong of a statement of the user."""
    causes = finding.wrong_statements
    if code in ("statement_or_false", "few_without_doubtful"):
        found = _SENTENCES[str(finding.data["found"])].format_map(_collect_more(finding))
        return f"{causes[0].sentence}, or signals are false: {found}" if code == "statement_or_false" else found
    sentence = _SENTENCES[code].format_map(_collect_more(finding))
    return f"{sentence}; {causes[0].sentence}" if causes else sentence


def _prescribe(finding: Finding, code: str) -> str | None:
    """Name what would decide, first the check of a statement that may be wrong."""
    template, causes = _REMEDIES.get(code), finding.wrong_statements
    remedy = None if template is None else template.format_map(_collect_more(finding))
    checked = [f"{causes[0].about} checked"] if causes else []
    return ", or ".join([*checked, *([remedy] if remedy else [])]) or None


def _collect_more(finding: Finding) -> Mapping[str, Any]:
    """Return the finding's fields, and the phrases that its data make."""
    fields = collect_fields(finding)
    phrases: dict[str, Callable[[Mapping[str, Any]], str]] = {
        "satellites": _name_signals,
        "known": lambda f: _KNOWN[f["known"]].format_map(f),
        "by": lambda f: _SHOWN[f["by"]].format_map(f),
        "apart_m": _name_distances,
        "carriers": lambda f: _CARRIERS[f["carriers"]],
        "antennas_known": lambda f: "" if f["antennas_known"] else f", or to know {_WHERE}",
        "sets": lambda f: ", ".join(f"{n:.0f} in {r}" for r, n in zip(f["receivers"], f["sets"], strict=True)),
        "receivers": lambda f: " and ".join(f["receivers"]),
        "without": lambda f: " and ".join(f["without"]),
    }
    made = {name: phrase(fields) for name, phrase in phrases.items() if name in fields}
    return {
        **fields,
        "signals": made.get("satellites", ""),
        "known": made.get("known", ""),
        "shown": made.get("by", ""),
        "far": made.get("apart_m", ""),
        "of_carriers": made.get("carriers", ""),
        "or_where": made.get("antennas_known", ""),
        "counts": made.get("sets", ""),
        "names": made.get("receivers", ""),
        "missing": made.get("without", ""),
        "second_ones": _name_second_signals(fields),
        "doubtful_ones": _name_doubtful(finding),
    }


def _name_signals(fields: Mapping[str, Any]) -> str:
    """Name the signals that several receivers have."""
    kinds = "" if fields["kinds"] == ("G L1 CA",) else f" {' and '.join(fields['kinds'])}"
    return f"the {fields['satellites']} satellites'{kinds} signals in {join(fields['receivers'])}"


def _name_distances(fields: Mapping[str, Any]) -> str:
    """State how far from the first one signals put the other antennas."""
    first, *other_receivers = fields["receivers"]
    apart = zip(other_receivers, fields["apart_m"], fields["apart_sigma_m"], strict=False)
    places = [f"the antenna of {name} {d:.1f} ± {s:.1f} m from that of {first}" for name, d, s in apart]
    return f": they put {', '.join(places)}" if places else ""


def _name_second_signals(fields: Mapping[str, Any]) -> str:
    """Name the second signals of one satellite or several."""
    count, receivers = fields["n_satellites"], fields["receiver"]
    if count == 1:
        return f"a second signal in {receivers} is"
    return f"the second signals of {count} satellites in {receivers} are"


def _name_doubtful(finding: Finding) -> str:
    """State of how many satellites the antenna of false signals could have sent the signals."""
    if "doubtful" not in finding.data:
        return ""
    words = f"; {finding.data['doubtful']} of them could as well come from the antenna of the false signals"
    return words if finding.code == "few_without_doubtful" else f"{words}, and are left out"


def _make_entry(code: str) -> Entry:
    return Entry(lambda finding: _describe(finding, code), lambda finding: _prescribe(finding, code))


ENTRIES: Final[Mapping[str, Entry]] = {
    code: _make_entry(code) for code in (*_SENTENCES, "few_without_doubtful", "statement_or_false")
}
