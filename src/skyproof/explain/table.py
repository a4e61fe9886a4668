"""Find the words for a finding by its detector and its code: `ENTRIES` of the module with the detector's name."""

from collections.abc import Iterator, Mapping
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pkgutil import iter_modules
from typing import Any, Final

from skyproof import explain as room
from skyproof.detectors.base import NEEDS
from skyproof.detectors.registry import load_detectors
from skyproof.explain.entry import Entry, Wording, collect_fields, fill, join
from skyproof.gnss.oscillators import PLATFORM_CLASSES
from skyproof.records import Evidence, Finding

__all__ = ["ASSUMPTIONS", "explain", "list_entries", "stands_beside"]

ASSUMPTIONS: Final[Mapping[str, str]] = {
    "receiver_stands": "{receiver} does not move",
    "stands_where_surveyed": "{receiver} stands where it was surveyed",
    "inertial_as_stated": "the errors of the inertial unit are no larger than stated",
    **{
        f"oscillator_{name}": f"the clock of {{receiver}} runs freely on a {name} oscillator"
        for name in PLATFORM_CLASSES
    },
    "one_transmit_antenna": "there are several false signals, and they come from one transmit antenna",
    "none_from_satellites": "no false signal comes from the direction of its satellite",
    "no_concert": "no two transmitters act in concert",
    "one_false_sky": "one transmitter sends one false sky",
    "one_change": "within two minutes, signals change from the sky to a transmitter and back at most once",
    "antennas_as_stated": "the antennas stand where they are stated to",
    "antennas_rigid": "the antennas do not move relative to each other",
    "distance_as_stated": "the antennas stand {distance_m:g} ± {distance_sigma_m:.2g} m apart",
    "distance_as_stated_and_not_shown": (
        "the antennas stand {distance_m:g} ± {distance_sigma_m:.2g} m apart, and an attack on one receiver alone does "
        "not imitate that distance"
    ),
    "distance_kept": "the antennas keep the distance that they had while both skies were received",
    "clean_start": "the signals of {receiver} were true until {clean_until}, before a second sky was seen",
    "one_of_overlapping": "one of the skies that overlap in {receiver} is the true one",
}

_COMMON: Final[Mapping[str, Entry]] = {
    "failed": Entry("the detector {detector} of {module} failed: {error}", "{detector} repaired"),
    "review_failed": Entry("review of the detector {detector} of {module} failed: {error}", "{detector} repaired"),
}


def explain(finding: Finding | Evidence, *, strict: bool = False) -> Wording:
    """Describe a finding in words: the result or why nothing was tested, the remedy, the assumptions.

    Raises
    ------
    KeyError : if `strict`, its data lack a field of the entry's template; else its code stands for the sentence, as no
        wording is worth a run.
    """
    if isinstance(finding, Evidence):
        return Wording(finding.because, finding.would_need, finding.assumes)
    data: Mapping[str, Any] = finding.data
    if "because" in data:  # of a detector that puts its findings in words itself
        return Wording(data["because"], data["would_need"], data["words_assumed"])
    if finding.lacking:
        without = join([need.replace("_", " ") for need in finding.lacking])
        return Wording(f"without {without}", "; ".join(NEEDS[need] for need in finding.lacking))
    entry = _find_entry(finding)
    fields = collect_fields(finding)
    return Wording(
        sentence=_fill_or_code(entry, finding, strict=strict),
        remedy=None if entry.remedy is None else fill(entry.remedy, finding),
        assumptions=tuple(ASSUMPTIONS[code].format_map(fields) for code in data.get("assumes", ())),
    )


def _fill_or_code(entry: Entry, finding: Finding, *, strict: bool) -> str:
    try:
        return fill(entry.sentence, finding) or finding.code
    except KeyError:
        if strict:
            raise
        return finding.code.replace("_", " ")


def stands_beside(finding: Finding | Evidence) -> bool:
    """Return whether a finding stands beside the verdict, whatever that is."""
    if isinstance(finding, Evidence):
        return finding.noted
    beside = finding.data.get("beside")
    return bool(beside) if beside is not None else not finding.lacking and _find_entry(finding).beside


def list_entries() -> Iterator[tuple[str, str, Entry]]:
    """Yield detector, code and entry of all that can be said, in alphabetical order."""
    for module in sorted(iter_modules(room.__path__), key=lambda module: module.name):
        for code, entry in sorted((_load_entries(module.name) or {}).items()):
            yield module.name, code, entry


@cache
def _load_entries(detector: str) -> Mapping[str, Entry] | None:
    """Return a detector's entries by code; None of one that has no module here."""
    name = f"{room.__name__}.{detector}"
    return getattr(import_module(name), "ENTRIES", None) if find_spec(name) is not None else None


def _find_entry(finding: Finding) -> Entry:
    """Return the entry of a detector of ours, or what a package's own detector states in its `sentences`."""
    if finding.code in _COMMON:
        return _COMMON[finding.code]
    entries = _load_entries(finding.detector)
    if entries is not None and finding.code in entries:
        return entries[finding.code]
    kind = load_detectors().get(finding.detector)
    sentence = getattr(kind, "sentences", {}).get(finding.code, finding.code.replace("_", " "))
    return Entry(sentence, getattr(kind, "remedies", {}).get(finding.code))
