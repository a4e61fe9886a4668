"""What stands at the top of the page: what to do, since when, where, how sure; and what belongs to the word."""

from dataclasses import dataclass

from skyproof.report import pictures as draw
from skyproof.report.evidence import by_chance, quoted, strongest
from skyproof.report.positions import away_words, within_m
from skyproof.report.what_now import ended, what_now
from skyproof.report.words import (
    chance_words,
    distance_words,
    instant_words,
    number_words,
    place_words,
    rate_words,
)
from skyproof.verdict import Position, ReceiverResult, Signal, Verdict

__all__ = ["Fact", "counts", "explained", "facts", "how_sure", "scope"]

MOST_NAMED_ABOVE = 3  # receivers at the top of the page; the table below has all
SURE = "95\N{NO-BREAK SPACE}%"
LEAST_STATED = 1e-30  # a smaller probability says more of the model than of the world


@dataclass(frozen=True)
class Fact:
    """An answer at the top of the page: what is asked, and lines of an answer with what belongs to it."""

    name: str
    lines: tuple[tuple[str, str], ...]
    kind: str = ""


def explained(verdict: Verdict) -> list[tuple[str, str]]:
    """What belongs to the word beside the summary; and what is assumed."""
    assumed = [("Assumed:", verdict.assumed.removeprefix("Assumed: "))] if verdict.assumed is not None else []
    return [*verdict.explained, *assumed]


def scope(verdict: Verdict) -> str:
    """What the page is about: when, how long, how many."""
    n = len(verdict.receivers)
    parts = [f"{n} receiver{'s' * (n != 1)}"]
    starts = sorted(r.start_gpst for r in verdict.receivers if r.start_gpst is not None)
    if starts:
        parts.append(f"from {instant_words(starts[0])} GPS time")
    longest_s = max((r.duration_s for r in verdict.receivers), default=0.0)
    return ", ".join([*parts, f"{number_words(longest_s)} s"]) if longest_s else ", ".join(parts)


def facts(verdict: Verdict) -> list[Fact]:
    """Answers, the most urgent first."""
    found = [_when(verdict)] if verdict.verdict in ("spoofed", "suspect") else []
    trusted = [(r, r.trusted_fix) for r in verdict.receivers if r.trusted_fix is not None]
    shows = [(source, source.shows) for source in verdict.sources if source.shows is not None]
    false = [(r, r.false_fix) for r in verdict.receivers if r.false_fix is not None]
    skies = [
        (place_words(place.lat_deg, place.lon_deg, 5), f"{source.name}, {len(source.sats)} satellites")
        for source, place in shows
    ]
    open_still = len(skies) > 1 and not false
    if trusted:
        found.append(
            Fact(
                "True position",
                _few(
                    [
                        (
                            place_words(fix.lat_deg, fix.lon_deg, 5),
                            f"{r.name}{_not_later(r, fix)}, within {distance_words(within_m(fix))} horizontally "
                            f"({SURE})",
                        )
                        for r, fix in trusted
                    ]
                ),
                "authentic",
            )
        )
        if open_still:
            found.append(Fact("Consistent skies show", _few(skies)))
    elif open_still:
        found.append(Fact("True position: one of", _few(skies)))
    elif false:
        found.append(Fact("True position", (("Not known", "no signals were shown to be true"),)))
    else:
        found.append(Fact("True position", (("Not known", _unprotected_words(verdict)),)))
    if false:
        found.append(
            Fact(
                "The false signals show",
                _few(
                    [
                        (place_words(fix.lat_deg, fix.lon_deg, 5), r.name + (f" seems {away}" if away else ""))
                        for r, fix, away in ((r, fix, away_words(r, fix)) for r, fix in false)
                    ]
                ),
                "spoofed",
            )
        )
    return [Fact("What to do now", what_now(verdict), "now"), *found, _sure(verdict)]


def _not_later(receiver: ReceiverResult, fix: Position) -> str:
    """When a receiver's last trusted fix was, if it has later fixes that are not trusted."""
    return f" at {instant_words(fix.gpst)[11:]}, not later" if ended(receiver) else ""


def _few(lines: list[tuple[str, str]]) -> tuple[tuple[str, str], ...]:
    more = len(lines) - MOST_NAMED_ABOVE
    return (*lines[:MOST_NAMED_ABOVE], *([("", f"and {more} more, in the table below")] if more > 0 else []))


def _when(verdict: Verdict) -> Fact:
    since, sigma_s = instant_words(verdict.since_gpst), verdict.since_sigma_s
    name, kind = f"{verdict.verdict.capitalize()} since", verdict.verdict
    if verdict.since_gpst is None:
        return Fact(name, (("Not known", ""),), kind)
    day, clock = since[:10], since[11:]
    until = [f"until {instant_words(verdict.until_gpst)}"] if verdict.until_gpst is not None else []
    if sigma_s is None:
        how = "there when the recording begins" if verdict.from_start else "first seen then, begun then or earlier"
        words = "; ".join([f"{how}, {day}, GPS time", *until])
        return Fact(name, ((f"{clock} or before", words),), kind)
    words = "; ".join([f"± {sigma_s:.2g} s (one sigma), {day}, GPS time", *until])
    return Fact(name, ((clock, words),), kind)


def _sure(verdict: Verdict) -> Fact:
    """How often such a verdict is wrong, and how strong its strongest evidence is."""
    rate = rate_words(verdict.false_alarm_probability_per_hour)
    lines = [(f"{rate[:1].upper()}{rate[1:]}", "at most, clean signals are called spoofed")]
    best = strongest(verdict)
    if best is not None and best.p_value is not None:
        chance = (
            chance_words(best.p_value) if best.p_value >= LEAST_STATED else f"less than {chance_words(LEAST_STATED)}"
        )
        words = "clean" if verdict.verdict == "spoofed" else "false"
        lines.append((f"{chance[:1].upper()}{chance[1:]}", f"{words} signals look like these by chance"))
    return Fact("How sure", tuple(lines))


def _unprotected_words(verdict: Verdict) -> str:
    shown = [(r, r.unprotected_fix) for r in verdict.receivers if r.unprotected_fix is not None]
    if not shown:
        return "no position could be computed"
    r, fix = shown[0]
    return f"without protection {r.name} shows {place_words(fix.lat_deg, fix.lon_deg, 5)}"


def how_sure(verdict: Verdict) -> list[str]:
    """Sentences on how far the verdict can be relied on."""
    allowed = verdict.false_alarm_probability_per_hour
    sentences = [
        f"Clean signals are called spoofed at most {rate_words(allowed)} (false-alarm probability asked for: "
        f"{allowed:g} per hour)."
    ]
    best = strongest(verdict)
    if best is not None and best.p_value is not None:
        sentences.append(
            f"The strongest evidence is that of {quoted(best.detector)}: {by_chance(best.decision, best.p_value)}"
        )
    by_label = counts(verdict.signals)
    count = len({(s.receiver, s.sat, s.band, s.code, s.copy) for s in verdict.signals})
    changing = len(_labels(verdict.signals)) - count
    twice = f"; {changing} with one label after another" if changing else ""
    sentences.append(
        f"{count} signal{'s' * (count != 1)} received: {by_label}{twice}." if by_label else "No signals were received."
    )
    return sentences


def counts(signals: tuple[Signal, ...] | list[Signal]) -> str:
    """How many carry which label; a signal may carry one label after another."""
    labels = _labels(signals)
    counts = {label: sum(x[-1] == label for x in labels) for label in draw.LABELS}
    return ", ".join(f"{count} {label}" for label, count in counts.items() if count)


def _labels(signals: tuple[Signal, ...] | list[Signal]) -> set[tuple[str, ...]]:
    """Each signal with each label that it carries, once."""
    return {(s.receiver, s.sat, s.band, s.code, str(s.copy), s.label) for s in signals}
