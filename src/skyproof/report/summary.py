"""What stands at the top of the page: what to do, since when, where; what belongs to the word; and how sure it is."""

from dataclasses import dataclass

from skyproof.gnss.time import format_clock, format_instant, format_moment, format_utc
from skyproof.records import LABELS
from skyproof.report.evidence import describe_chance, find_strongest, quote
from skyproof.report.positions import describe_distance, within_m
from skyproof.report.what_now import has_lost_fix, what_now
from skyproof.report.words import distance_words, number_words, place_words, rate_words, uses_minutes
from skyproof.verdict import InterferenceSpell, Place, Position, ReceiverResult, Signal, UsableKind, Verdict

__all__ = ["Fact", "count_labels", "describe_certainty", "list_explanations", "list_facts", "scope"]

MOST_NAMED_ABOVE = 3  # receivers at the top of the page; the table below has all
SURE = "95\N{NO-BREAK SPACE}%"
SHORT_OF: dict[UsableKind, str] = {
    "trusted": "trusted",
    "consistent": "consistent, not proven",
    "inertial": "dead-reckoned from the inertial unit",
    "held": "held at its last trusted place",
}


@dataclass(frozen=True)
class Fact:
    """An answer at the top of the page: what is asked, and lines of an answer with what belongs to it."""

    name: str
    lines: tuple[tuple[str, str], ...]
    kind: str = ""


def list_explanations(verdict: Verdict) -> list[tuple[str, str]]:
    """Return headings and words below the answers, with the assumptions; the remedy is part of what to do."""
    assumed = [("Assumed:", verdict.assumed.removeprefix("Assumed: "))] if verdict.assumed is not None else []
    return [*((name, words) for name, words in verdict.explained if words != verdict.remedy), *assumed]


def scope(verdict: Verdict) -> str:
    """What the page is about: when, how long, how many."""
    n = len(verdict.receivers)
    parts = [f"{n} receiver{'s' * (n != 1)}"]
    starts = sorted(r.start_gpst for r in verdict.receivers if r.start_gpst is not None)
    if starts:
        parts.append(f"from {format_moment(starts[0])}")
    longest_s = max((r.duration_s for r in verdict.receivers), default=0.0)
    return ", ".join([*parts, f"{number_words(longest_s)} s"]) if longest_s else ", ".join(parts)


def list_facts(verdict: Verdict) -> list[Fact]:
    """Answers, the most urgent first."""
    found = [_describe_onset(verdict)] if verdict.verdict in ("spoofed", "suspect") else []
    if verdict.interference.spells:
        found.append(
            Fact("Interference", _few([_describe_interference(spell) for spell in verdict.interference.spells]))
        )
    usable = [(r, *r.usable) for r in verdict.receivers if r.usable is not None]
    false = [(r, r.false_fix) for r in verdict.receivers if r.false_fix is not None]
    skies = [
        (
            _place(verdict, source.shows),
            _append_instant(f"{source.name}, {len(source.sats)} satellites", source.shows_gpst),
        )
        for source in verdict.sources
        if source.shows is not None
    ]
    open_still = len(skies) > 1 and not false
    if usable:
        proven = all(kind == "trusted" for _, kind, _ in usable)
        lines = [_describe_usable(verdict, r, kind, fix) for r, kind, fix in usable]
        name = "True position" if proven else "Usable position"
        if all(has_lost_fix(r) for r, _, _ in usable):
            name = f"Last {name[:1].lower()}{name[1:]}"
        found.append(Fact(name, _few(lines), "authentic" if proven else ""))
        if open_still:
            found.append(Fact("One of these skies is true", _few(skies)))
    elif open_still:
        found.append(Fact("True position: one of", _few(skies)))
    elif false:
        found.append(Fact("True position", (("Not known", "no signal was proved authentic"),)))
    else:
        found.append(Fact("True position", (("Not known", _describe_unprotected(verdict)),)))
    if false:
        lines = [(_place(verdict, fix), _false_words(r, fix)) for r, fix in false]
        found.append(Fact("The false signals show", _few(lines), "spoofed"))
    return [Fact("What to do now", what_now(verdict), "now"), *found]


def _describe_interference(spell: InterferenceSpell) -> tuple[str, str]:
    """Since when, and how much where."""
    until = "" if spell.until_gpst is None else f" to {format_instant(spell.until_gpst)[11:]}"
    shade = "; shading of the whole antenna would look the same" if spell.may_also_be else ""
    strength = f", {spell.strength}" if spell.strength else ""
    down = f"C/N0 down by {spell.fall_db:.0f} dB on {', '.join(spell.carriers)}"
    words = f"GPS time, {spell.receiver}: {down}{strength}{shade}"
    return f"{format_instant(spell.since_gpst)[11:]}{until}", words


def _place(verdict: Verdict, place: Place | Position) -> str:
    return place_words(place.lat_deg, place.lon_deg, 5, minutes=uses_minutes(verdict))


def _append_instant(words: str, gpst: str | None) -> str:
    """Words with an instant behind them, by both clocks."""
    return words if gpst is None else f"{words}, at {format_clock(gpst)}"


def _describe_usable(verdict: Verdict, receiver: ReceiverResult, kind: UsableKind, fix: Position) -> tuple[str, str]:
    """A receiver's last fix that may be used; that it is not later where others are."""
    later = " and not later" if has_lost_fix(receiver) else ""
    how = "" if kind == "trusted" else f", {SHORT_OF[kind]}"
    within = f"within {distance_words(within_m(fix))} horizontally ({SURE})"
    hidden = f"; an attack may have moved it by up to {distance_words(fix.hidden_m)} unnoticed" if fix.hidden_m else ""
    return _place(verdict, fix), f"{_append_instant(receiver.name, fix.gpst)}{later}{how}, {within}{hidden}"


def _false_words(receiver: ReceiverResult, fix: Position) -> str:
    away = describe_distance(receiver, fix)
    return _append_instant(receiver.name + (f" seems {away}" if away else ""), fix.gpst)


def _few(lines: list[tuple[str, str]]) -> tuple[tuple[str, str], ...]:
    more = len(lines) - MOST_NAMED_ABOVE
    return (*lines[:MOST_NAMED_ABOVE], *([("", f"and {more} more, in the table below")] if more > 0 else []))


def _describe_onset(verdict: Verdict) -> Fact:
    name, kind, sigma_s = f"{verdict.verdict.capitalize()} since", verdict.verdict, verdict.since_sigma_s
    if verdict.since_gpst is None:
        return Fact(name, (("Not known", ""),), kind)
    clock = format_instant(verdict.since_gpst)[11:]
    sentences = f"{verdict.since_gpst[:10]}, GPS time; {format_utc(verdict.since_gpst)} UTC"
    until = [f"until {format_moment(verdict.until_gpst)}"] if verdict.until_gpst is not None else []
    if sigma_s is None:
        how = "present when the recording begins" if verdict.from_start else "first seen then, may have begun earlier"
        return Fact(name, ((f"{clock} or before", "; ".join([sentences, how, *until])),), kind)
    return Fact(name, ((clock, "; ".join([f"± {sigma_s:.2g} s (one sigma), {sentences}", *until])),), kind)


def _describe_unprotected(verdict: Verdict) -> str:
    words = [(r, r.unprotected_fix) for r in verdict.receivers if r.unprotected_fix is not None]
    if not words:
        return "no position could be computed"
    r, fix = words[0]
    return _append_instant(f"without protection {r.name} shows {_place(verdict, fix)}", fix.gpst)


def describe_certainty(verdict: Verdict) -> list[str]:
    """Sentences on how far the verdict can be relied on."""
    allowed = verdict.false_alarm_probability_per_hour
    sentences = [
        f"Clean signals are called spoofed at most {rate_words(allowed)} (false-alarm probability set to "
        f"{allowed:g} per hour)."
    ]
    best = find_strongest(verdict)
    if best is not None and best.p_value is not None:
        sentences.append(
            f"The strongest evidence comes from {quote(best.detector)}: {describe_chance(best.decision, best.p_value)}"
        )
    by_label = count_labels(verdict.signals)
    count = len({(s.receiver, s.sat, s.band, s.code, s.copy) for s in verdict.signals})
    changing = len(_collect_labels(verdict.signals)) - count
    twice = f"; the label of {changing} changed" if changing else ""
    sentences.append(
        f"{count} signal{'s' * (count != 1)} received: {by_label}{twice}." if by_label else "No signals were received."
    )
    return sentences


def count_labels(signals: tuple[Signal, ...] | list[Signal]) -> str:
    """How many carry which label; a signal may carry one label after another."""
    labels = _collect_labels(signals)
    counts = {label: sum(x[-1] == label for x in labels) for label in LABELS}
    return ", ".join(f"{count} {label}" for label, count in counts.items() if count)


def _collect_labels(signals: tuple[Signal, ...] | list[Signal]) -> set[tuple[str, ...]]:
    """Each signal with each label that it carries, once."""
    return {(s.receiver, s.sat, s.band, s.code, str(s.copy), s.label) for s in signals}
