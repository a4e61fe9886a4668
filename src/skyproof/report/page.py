"""The report: a verdict and its pictures as one small page that needs no network and no script.

The same verdict and pictures give the same bytes: the page knows no clock and no chance. Everything that came from
outside is escaped, and the page forbids its reader's browser to load anything.
"""

import json
import math
from dataclasses import dataclass
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from skyproof.report import methods, proof, takeover
from skyproof.report import pictures as draw
from skyproof.report.pictures import (
    DelayProfile,
    Finding,
    FixTrack,
    RangeDifference,
    SignalSeries,
    SkyPosition,
    SkySource,
    TruePlace,
)
from skyproof.report.positions import away_words, within_m
from skyproof.report.takeover import ComparedSkies, CorrelationParts, FixOrigins
from skyproof.report.what_now import ended, what_now
from skyproof.report.words import (
    chance_words,
    distance_words,
    instant_words,
    number_words,
    p_value_words,
    place_words,
    rate_words,
    seconds_words,
    span_words,
)
from skyproof.verdict import Label, Method, Place, Position, ReceiverResult, Signal, Verdict

__all__ = ["Figure", "FixTrack", "Pictures", "SignalSeries", "SkyPosition", "environment", "report_html"]

MAX_POINTS = 20_000  # of all time lines together: keeps the page small, whatever the number of receivers
MOST_OPEN = 80  # signals whose tables are unfolded at first
MOST_NAMED_ABOVE = 3  # receivers at the top of the page; the table below has all
MOST_CLOSE = 6  # receivers that get a map of their own
SURE = "95\N{NO-BREAK SPACE}%"
LEAST_WRONG = 1e-12  # of a choice, as its words have it
LEAST_STATED = 1e-30  # a smaller probability says more of the model than of the world
ORDER = ("spoofed", "attack", "authentic", "multipath", "undecided", "clean")  # of methods, by what they say


@dataclass(frozen=True, eq=False, kw_only=True)
class Pictures:
    """What the report draws beside the verdict. Whatever is left empty is left out of the page.

    zero_gpst : the instant of second zero of all series, ISO 8601 without a zone, GPS time.
    onset_s, until_s : onset and end of the attack in these seconds; None draws no mark. onset_sigma_s : one sigma.
    origin : the point about which the tracks give east and north.
    truth : where receivers truly were, if something else than the recordings states it.
    """

    zero_gpst: str
    origin: Place | None = None
    onset_s: float | None = None
    onset_sigma_s: float | None = None
    until_s: float | None = None
    series: tuple[SignalSeries, ...] = ()
    tracks: tuple[FixTrack, ...] = ()
    truth: tuple[TruePlace, ...] = ()
    sky: tuple[SkyPosition, ...] = ()
    profiles: tuple[DelayProfile, ...] = ()
    differences: tuple[RangeDifference, ...] = ()
    correlations: tuple[CorrelationParts, ...] = ()
    compared: tuple[ComparedSkies, ...] = ()
    origins: tuple[FixOrigins, ...] = ()
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True)
class Figure:
    """One drawing with its heading and the words below it."""

    heading: str
    svg: Markup
    caption: str


@dataclass(frozen=True)
class Fact:
    """An answer at the top of the page: what is asked, and lines of an answer with what belongs to it."""

    name: str
    lines: tuple[tuple[str, str], ...]
    kind: str = ""


@dataclass(frozen=True)
class Tested:
    """A method that ran, as the page shows it."""

    method: Method
    title: str
    about: str
    found: str
    sentences: tuple[str, ...]
    scale: Markup


def report_html(verdict: Verdict, pictures: Pictures) -> str:
    """The whole page. Draws and words only: every number in it is the verdict's or the pictures' own."""
    page = environment().get_template("page.html.j2")
    ran = sorted(
        (m for m in verdict.methods if m.ran),
        key=lambda m: (
            ORDER.index(m.decision or "clean") if (m.decision or "clean") in ORDER else len(ORDER),
            m.detector,
        ),
    )
    return page.render(
        verdict=verdict,
        scope=_scope(verdict),
        facts=_facts(verdict),
        undecided=_undecided(verdict),
        how_sure=how_sure(verdict),
        positions=_positions(verdict),
        maps=[*_maps(pictures), *_origins(pictures), *_compared(pictures)],
        labels=[label for label in draw.LABELS if any(s.label == label for s in verdict.signals)],
        signals=[*_time_lines(pictures), *_proofs(pictures), *_correlations(pictures), *_skies(verdict, pictures)],
        ran=[_tested(method, pictures) for method in ran],
        not_run=[(m, methods.title(m.detector)) for m in verdict.methods if not m.ran],
        tables=_tables(verdict),
        day=_day(verdict),
        settings=_lines(verdict.settings),
    )


# What stands at the top


CURE = "; would decide it: "


def _undecided(verdict: Verdict) -> list[tuple[str, str]]:
    """What is open and what would decide it, but for what the summary says already; and what is assumed."""
    assumed = [("Assumed:", verdict.assumed.removeprefix("Assumed: "))] if verdict.assumed is not None else []
    if verdict.undecided_because is None:
        return assumed
    why, _, cure = verdict.undecided_because.partition(CURE)
    parts = [("Not decided:", why)] if why not in verdict.summary else []
    return [*parts, *([("Would decide it:", cure)] if cure else []), *assumed]


def _scope(verdict: Verdict) -> str:
    """What the page is about: when, how long, how many."""
    n = len(verdict.receivers)
    parts = [f"{n} receiver{'s' * (n != 1)}"]
    starts = sorted(r.start_gpst for r in verdict.receivers if r.start_gpst is not None)
    if starts:
        parts.append(f"from {instant_words(starts[0])} GPS time")
    longest_s = max((r.duration_s for r in verdict.receivers), default=0.0)
    return ", ".join([*parts, f"{number_words(longest_s)} s"]) if longest_s else ", ".join(parts)


def _facts(verdict: Verdict) -> list[Fact]:
    facts = [_when(verdict)] if verdict.verdict == "spoofed" else []
    trusted = [(r, r.trusted_fix) for r in verdict.receivers if r.trusted_fix is not None]
    shows = [(source, source.shows) for source in verdict.sources if source.shows is not None]
    false = [(r, r.false_fix) for r in verdict.receivers if r.false_fix is not None]
    skies = [
        (place_words(place.lat_deg, place.lon_deg, 5), f"{source.name}, {len(source.sats)} satellites")
        for source, place in shows
    ]
    open_still = len(skies) > 1 and not false
    if trusted:
        facts.append(
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
            facts.append(Fact("Consistent skies show", _few(skies)))
    elif open_still:
        facts.append(Fact("True position: one of", _few(skies)))
    elif false:
        facts.append(Fact("True position", (("Not known", "no signals were shown to be true"),)))
    else:
        facts.append(Fact("True position", (("Not known", _unprotected_words(verdict)),)))
    if false:
        facts.append(
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
    return [Fact("What to do now", what_now(verdict), "now"), *facts, _sure(verdict)]


def _not_later(receiver: ReceiverResult, fix: Position) -> str:
    """When a receiver's last trusted fix was, if it has later fixes that are not trusted."""
    return f" at {instant_words(fix.gpst)[11:]}, not later" if ended(receiver) else ""


def _few(lines: list[tuple[str, str]]) -> tuple[tuple[str, str], ...]:
    more = len(lines) - MOST_NAMED_ABOVE
    return (*lines[:MOST_NAMED_ABOVE], *([("", f"and {more} more, in the table below")] if more > 0 else []))


def _when(verdict: Verdict) -> Fact:
    since, sigma_s = instant_words(verdict.since_gpst), verdict.since_sigma_s
    if verdict.since_gpst is None:
        return Fact("Spoofed since", (("Not known", ""),), "spoofed")
    day, clock = since[:10], since[11:]
    until = [f"until {instant_words(verdict.until_gpst)}"] if verdict.until_gpst is not None else []
    if sigma_s is None:
        how = "the recording begins under attack" if verdict.from_start else "first seen then, begun then or earlier"
        words = "; ".join([f"{how}, {day}, GPS time", *until])
        return Fact("Spoofed since", ((f"{clock} or before", words),), "spoofed")
    words = "; ".join([f"± {sigma_s:.2g} s (one sigma), {day}, GPS time", *until])
    return Fact("Spoofed since", ((clock, words),), "spoofed")


def _sure(verdict: Verdict) -> Fact:
    """How often such a verdict is wrong, and how strong its strongest evidence is."""
    rate = rate_words(verdict.false_alarm_probability_per_hour)
    lines = [(f"{rate[:1].upper()}{rate[1:]}", "at most, clean signals are called spoofed")]
    best = _strongest(verdict)
    if best is not None and best.p_value is not None:
        chance = (
            chance_words(best.p_value) if best.p_value >= LEAST_STATED else f"less than {chance_words(LEAST_STATED)}"
        )
        words = "clean" if verdict.verdict == "spoofed" else "false"
        lines.append((f"{chance[:1].upper()}{chance[1:]}", f"{words} signals look like these by chance"))
    return Fact("How sure", tuple(lines))


def _strongest(verdict: Verdict) -> Method | None:
    """The method with the least p-value for the verdict."""
    saying = {"spoofed": ("spoofed", "attack"), "authentic": ("authentic",), "undecided": ()}[verdict.verdict]
    for_it = [m for m in verdict.methods if m.ran and m.decision in saying and m.p_value is not None]
    return min(for_it, key=lambda method: method.p_value if method.p_value is not None else 1.0, default=None)


def how_sure(verdict: Verdict) -> list[str]:
    """Sentences on how far the verdict can be relied on."""
    allowed = verdict.false_alarm_probability_per_hour
    sentences = [
        f"Clean signals are called spoofed at most {rate_words(allowed)} (false-alarm probability asked for: "
        f"{allowed:g} per hour)."
    ]
    best = _strongest(verdict)
    if best is not None and best.p_value is not None:
        sentences.append(
            f"The strongest evidence is that of {_quoted(best.detector)}: {_by_chance(best.decision, best.p_value)}"
        )
    counts = _counts(verdict.signals)
    count = len({(s.receiver, s.sat, s.band, s.code, s.copy) for s in verdict.signals})
    changing = len(_labels(verdict.signals)) - count
    twice = f"; {changing} with one label after another" if changing else ""
    sentences.append(
        f"{count} signal{'s' * (count != 1)} received: {counts}{twice}." if counts else "No signals were received."
    )
    return sentences


def _quoted(detector: str) -> str:
    """Its heading on this page, or its own name."""
    return f"“{methods.title(detector)}”" if methods.about(detector) else detector


def _counts(signals: tuple[Signal, ...] | list[Signal]) -> str:
    """How many carry which label; a signal may carry one label after another."""
    labels = _labels(signals)
    counts = {label: sum(x[-1] == label for x in labels) for label in draw.LABELS}
    return ", ".join(f"{count} {label}" for label, count in counts.items() if count)


def _labels(signals: tuple[Signal, ...] | list[Signal]) -> set[tuple[str, ...]]:
    """Each signal with each label that it carries, once."""
    return {(s.receiver, s.sat, s.band, s.code, str(s.copy), s.label) for s in signals}


def _by_chance(decision: str | None, p_value: float) -> str:
    otherwise = "were the signals false" if decision == "authentic" else "in a clean sky"
    return f"{otherwise}, chance alone gives as much {chance_words(p_value)} ({p_value_words(p_value)})."


# Positions


def _unprotected_words(verdict: Verdict) -> str:
    shown = [(r, r.unprotected_fix) for r in verdict.receivers if r.unprotected_fix is not None]
    if not shown:
        return "no position could be computed"
    r, fix = shown[0]
    return f"without protection {r.name} shows {place_words(fix.lat_deg, fix.lon_deg, 5)}"


def _positions(verdict: Verdict) -> list[tuple[ReceiverResult, str, Position, str]]:
    """Receiver, kind, fix, and how far from the trusted one."""
    rows = []
    for receiver in verdict.receivers:
        for kind, fix in (
            ("trusted", receiver.trusted_fix),
            ("false", receiver.false_fix),
            ("unprotected", receiver.unprotected_fix),
        ):
            if fix is not None:
                away = "" if kind == "trusted" else away_words(receiver, fix)
                rows.append((receiver, kind, fix, "the same" if away.startswith("0.0 m") else away))
    return rows


def _maps(pictures: Pictures) -> list[Figure]:
    """All fixes, then the trusted ones of each receiver close up, where the large map is too coarse for them."""
    overview = draw.local_map(pictures.tracks, pictures.truth, title="Map of all fixes")
    if pictures.origin is None or not overview:
        return []
    kinds = {track.kind for track in pictures.tracks if len(track.points())}
    keys = {
        "trusted": "disc: last trusted fix with its 95 % ellipse",
        "false": "diamond: what the false signals show",
        "unprotected": "ring: what a receiver without protection shows",
        "possible": "triangle: a place that the evidence leaves open",
    }
    legend = [words for kind, words in keys.items() if kind in kinds]
    legend += ["cross: the true place, by a file beside the recording, which the verdict does not use"] * bool(
        pictures.truth
    )
    close = [
        track
        for track in pictures.tracks
        if track.kind == "trusted"
        and len(track.points())
        and draw.extent_m([track]) < 0.1 * draw.extent_m(pictures.tracks)
    ][:MOST_CLOSE]
    figures = [
        Figure(
            "Where it was, where it seemed to be" if "false" in kinds else "Map of the fixes",
            overview,
            f"Metres east and north of {place_words(pictures.origin.lat_deg, pictures.origin.lon_deg)}. "
            + "; ".join([*legend, "lines: the way there"]).capitalize()
            + "."
            + "".join(_off_truth(track, pictures) for track in pictures.tracks if track not in close),
        )
    ]
    for track in close:
        truth = [place for place in pictures.truth if place.receiver == track.receiver]
        svg = draw.local_map([track], truth, title=f"Trusted fixes of {track.receiver}", least_m=4.0, names=False)
        caption = "Trusted fixes on the map’s axes, the last one marked, with its 95 % ellipse."
        figures.append(Figure(f"{track.receiver} close up", svg, caption + _off_truth(track, pictures)))
    return figures


def _off_truth(track: FixTrack, pictures: Pictures) -> str:
    """How far the last trusted fix lies from the truth; empty where that is not known."""
    place = next((place for place in pictures.truth if place.receiver == track.receiver), None)
    if track.kind != "trusted" or place is None or not len(track.points()):
        return ""
    east_m, north_m = track.points()[-1]
    off_m = math.hypot(float(east_m) - place.east_m, float(north_m) - place.north_m)
    return f" The last trusted fix of {track.receiver} lies {distance_words(off_m)} from the truth, horizontally."


ORIGINS = {
    "satellites": "filled: satellites",
    "inertia": "light: inertia, since the last trusted fix",
    "held": "dashed: held, as the receiver stands",
}


def _origins(pictures: Pictures) -> list[Figure]:
    zero = f"{instant_words(pictures.zero_gpst)} GPS time"
    return [
        Figure(
            f"What the trusted position of {one.receiver} came from",
            takeover.origins_plot(
                one,
                title=f"Origin of the trusted position of {one.receiver} and error of an ordinary receiver over time",
                zero=zero,
                onset_s=pictures.onset_s,
                until_s=pictures.until_s,
            ),
            "Line: distance between what a receiver without protection shows and the trusted position. Bar: what the "
            f"trusted position came from ({'; '.join(ORIGINS[kind] for kind in ORIGINS if kind in _kinds(one))}); "
            "nothing where there is none.",
        )
        for one in pictures.origins
    ]


def _kinds(origins: FixOrigins) -> set[str]:
    return {one.origin for one in origins.trusted}


def _compared(pictures: Pictures) -> list[Figure]:
    """Skies beside what was expected: position on a map, time on a line; in words how sure the choice is."""
    figures = []
    for one in pictures.compared:
        heading = f"Which sky of {one.receiver} is true"
        how = (
            f"At {number_words(one.at_s)} s; expected by {one.by}. "
            + (f"Disc: chosen; diamond: refused; this is wrong {_wrong_words(one.wrong)}." if one.chosen else "")
            + (f"None is chosen: the likelier one is wrong {_wrong_words(one.wrong)}." if not one.chosen else "")
        )
        if one.tracks:
            svg = takeover.skies_map(one, title=f"Positions by the skies of {one.receiver} and the expected one")
            words = "Metres east and north of the expected position (square), with 95 % ellipses."
            figures.append(Figure(f"{heading}: position", svg, f"{how} {words}"))
        if one.offsets:
            svg = takeover.clock_plot(one, title=f"Times by the skies of {one.receiver} against the expected one")
            words = "" if one.tracks else f"{how} "
            words += "The receiver’s clock by each sky, two sigma to either side."
            figures.append(Figure(f"{heading}: time", svg, words))
    return figures


def _wrong_words(probability: float) -> str:
    return chance_words(max(probability, LEAST_WRONG))


# Signals


def _receivers(items: tuple[SkyPosition, ...] | tuple[SignalSeries, ...]) -> list[str]:
    return sorted({item.receiver for item in items})


def _skies(verdict: Verdict, pictures: Pictures) -> list[Figure]:
    sources = [
        SkySource(name=source.name, azimuth_deg=source.azimuth_deg, elevation_deg=source.elevation_deg)
        for source in verdict.sources
        if source.azimuth_deg is not None and source.elevation_deg is not None
    ]
    caption = (
        "Where the satellites stand, zenith in the middle; rings of elevation every 30°. Symbols side by side are "
        "signals of one satellite."
    )
    if sources:
        caption += " Cross: a source of false signals."
    figures = []
    for receivers in _same_sky(pictures.sky):
        title = f"Sky over {', '.join(receivers)}"
        here = [p for p in pictures.sky if p.receiver == receivers[0]]
        figures.append(Figure(title, draw.sky_plot(here, sources, title=title), caption))
    return figures


def _same_sky(sky: tuple[SkyPosition, ...]) -> list[list[str]]:
    """Receivers together that have the same labels in the same directions: one drawing shows all."""
    groups: dict[frozenset[tuple[str, str, int, int]], list[str]] = {}
    for receiver in _receivers(sky):
        seen = frozenset(
            (p.signal.split()[0], p.label, round(p.azimuth_deg), round(p.elevation_deg))
            for p in sky
            if p.receiver == receiver
        )
        groups.setdefault(seen, []).append(receiver)
    return list(groups.values())


def _time_lines(pictures: Pictures) -> list[Figure]:
    points = min(240, max(40, MAX_POINTS // max(len(pictures.series), 1)))
    band = "; the shaded band is two sigma of the onset to either side" if pictures.onset_sigma_s is not None else ""
    return [
        Figure(
            f"Signals of {receiver}",
            draw.time_line(
                [series for series in pictures.series if series.receiver == receiver],
                title=f"Carrier to noise density and label of every signal of {receiver} over time",
                zero=f"{instant_words(pictures.zero_gpst)} GPS time",
                onset_s=pictures.onset_s,
                onset_sigma_s=pictures.onset_sigma_s,
                until_s=pictures.until_s,
                points=points,
            ),
            "One row per satellite: carrier to noise density of each of its signals, and below it a bar for as long as "
            f"the signal is received, by label{band}.",
        )
        for receiver in _receivers(pictures.series)
    ]


def _proofs(pictures: Pictures) -> list[Figure]:
    """Correlation of attacked satellites, and range differences of each pair of receivers."""
    figures = []
    if pictures.profiles:
        one = pictures.profiles[0]
        several = any(len(profile.tags) > 1 for profile in pictures.profiles)
        shown: set[Label] = {tag.label for profile in pictures.profiles for tag in profile.tags}
        figures.append(
            Figure(
                f"Two peaks where there should be one: {one.receiver}" if several else f"Correlation in {one.receiver}",
                proof.profile_plot(pictures.profiles, title=f"Correlation over delay of satellites in {one.receiver}"),
                f"Samples of 50 ms at {number_words(one.at_s)} s, compared with each satellite’s code at every delay. "
                f"Each peak is a signal; delays count from the {'true' if 'authentic' in shown else 'first'} one.",
            )
        )
    for pair in sorted({d.receivers for d in pictures.differences}):
        rows = [d for d in pictures.differences if d.receivers == pair]
        figures.append(
            Figure(
                f"The way to {pair[1]} against the way to {pair[0]}",
                proof.difference_plot(rows, title=f"Range differences between {pair[0]} and {pair[1]} by satellite"),
                "How much longer a satellite’s way is to one antenna than to the other. From the sky every satellite "
                "has a difference of its own; signals of one transmitter share theirs, and stand in one line.",
            )
        )
    return figures


def _correlations(pictures: Pictures) -> list[Figure]:
    """Of satellites with two signals within a chip or so."""
    if not pictures.correlations:
        return []
    one = pictures.correlations[0]
    return [
        Figure(
            f"Two signals in one peak: {one.receiver}",
            takeover.correlation_plot(pictures.correlations, title=f"Correlation of {one.receiver} taken apart"),
            f"Correlation at {number_words(one.at_s)} s, 20 ms: height is its magnitude, colour its phase, both from "
            "the samples. Lines: the stronger signal (full) and the second one (dashed) as they were taken apart; in "
            "numbers the second’s delay, power and phase against the stronger one. One signal alone has one colour.",
        )
    ]


def _tables(verdict: Verdict) -> list[tuple[str, str, bool, list[tuple[Signal, str]]]]:
    """Receiver, count of its labels, whether it is unfolded, and its signals, each with why."""
    tables: list[tuple[str, str, bool, list[tuple[Signal, str]]]] = []
    rows_before = 0
    for receiver in verdict.receivers:
        own = [s for s in verdict.signals if s.receiver == receiver.name]
        if own:
            rows_before += len(own)
            opened = not tables or rows_before <= MOST_OPEN
            tables.append((receiver.name, _counts(own), opened, [(s, _why(s)) for s in own]))
    return tables


def _day(verdict: Verdict) -> str:
    """The date of all that was received; empty if there are several, or none is known."""
    instants = [instant for s in verdict.signals for instant in (s.from_gpst, s.to_gpst)]
    days = {instant[:10] for instant in instants if instant is not None}
    return days.pop() if len(days) == 1 and None not in instants else ""


def _why(signal: Signal) -> str:
    if not signal.because:
        return "no evidence"
    return "; ".join(
        methods.reason(b.detector, signal.label) + (f" ({p_value_words(b.p_value)})" if b.p_value is not None else "")
        for b in signal.because
    )


# Evidence


def _tested(method: Method, pictures: Pictures) -> Tested:
    found = next((f.words for f in pictures.findings if f.detector == method.detector), "")
    scale = Markup("")
    if method.p_value is not None:
        title = f"{method.detector}: {p_value_words(method.p_value)}"
        scale = proof.chance_scale(method.p_value, method.false_alarm_probability, title=title)
    return Tested(
        method,
        methods.title(method.detector),
        methods.about(method.detector),
        f"{found[:1].upper()}{found[1:]}." if found else "",
        tuple(_words_of_test(method)),
        scale,
    )


def _words_of_test(method: Method) -> list[str]:
    sentences = []
    if method.p_value is not None:
        words = _by_chance(method.decision, method.p_value)
        if method.decision == "undecided":  # what was tested, one antenna or a clean sky, the evidence says
            words = f"it did not decide ({p_value_words(method.p_value)})."
        sentences.append(words[0].upper() + words[1:])
    if method.statistic is not None:
        against = f", its threshold {number_words(method.threshold)}" if method.threshold is not None else ""
        sentences.append(f"Statistic {number_words(method.statistic)}{against}.")
    made = f"{method.tests} {'test' if method.tests == 1 else 'tests'} made"
    if method.false_alarm_probability is not None:
        made += f", false alarms allowed in each: {chance_words(method.false_alarm_probability)}"
    return [*sentences, f"{made}."]


def _lines(settings: dict[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """Nested settings as dotted names and JSON values, in their order."""
    lines: list[tuple[str, str]] = []
    for key, value in settings.items():
        if isinstance(value, dict) and value:
            lines += _lines(value, f"{prefix}{key}.")
        else:
            lines.append((f"{prefix}{key}", json.dumps(value, ensure_ascii=False)))
    return lines


def _fixed(value: float | None, digits: int) -> str | None:
    return None if value is None else f"{value:.{digits}f}"


@cache
def environment() -> Environment:
    """The templates of all pages, and how they write numbers."""
    environment = Environment(
        loader=PackageLoader("skyproof.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {
        "fixed": _fixed,
        "instant": instant_words,
        "p_value": p_value_words,
        "seconds": seconds_words,
    }
    environment.globals["span"] = span_words
    return environment
