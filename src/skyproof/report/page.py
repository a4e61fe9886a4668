"""The report: a verdict and its pictures as one small page that needs no network and no script.

The same verdict and pictures give the same bytes: the page knows no clock and no chance. Everything that came from
outside is escaped, and the page forbids its reader's browser to load anything.
"""

import json
from dataclasses import dataclass
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from skyproof.report import pictures as draw
from skyproof.report.pictures import FixTrack, SignalSeries, SkyPosition, SkySource
from skyproof.report.words import (
    chance_words,
    instant_words,
    number_words,
    p_value_words,
    rate_words,
    seconds_words,
    span_words,
)
from skyproof.verdict import Method, Place, Verdict

__all__ = ["Figure", "FixTrack", "Pictures", "SignalSeries", "SkyPosition", "environment", "report_html"]

MAX_POINTS = 20_000  # of all time lines together: keeps the page small, whatever the number of receivers


@dataclass(frozen=True, eq=False, kw_only=True)
class Pictures:
    """What the report draws beside the verdict. Whatever is left empty is left out of the page.

    zero_gpst : the instant of second zero of all series, ISO 8601 without a zone, GPS time.
    onset_s : onset of the attack in these seconds; None draws no mark.
    origin : the point about which the tracks give east and north.
    """

    zero_gpst: str
    origin: Place | None = None
    onset_s: float | None = None
    series: tuple[SignalSeries, ...] = ()
    tracks: tuple[FixTrack, ...] = ()
    sky: tuple[SkyPosition, ...] = ()


@dataclass(frozen=True)
class Figure:
    """One drawing with its heading and the words below it."""

    heading: str
    svg: Markup
    caption: str


def report_html(verdict: Verdict, pictures: Pictures) -> str:
    """The whole page. Draws and words only: every number in it is the verdict's or the pictures' own."""
    page = environment().get_template("page.html.j2")
    return page.render(
        verdict=verdict,
        how_sure=how_sure(verdict),
        positions=[
            (receiver, kind, fix)
            for receiver in verdict.receivers
            for kind, fix in (
                ("trusted", receiver.trusted_fix),
                ("false", receiver.false_fix),
                ("unprotected", receiver.unprotected_fix),
            )
            if fix is not None
        ],
        maps=_maps(pictures),
        skies=_skies(verdict, pictures),
        time_lines=_time_lines(pictures),
        ran=[(method, _words_of_test(method), _scale(method)) for method in verdict.methods if method.ran],
        not_run=[method for method in verdict.methods if not method.ran],
        settings=_lines(verdict.settings),
    )


def how_sure(verdict: Verdict) -> list[str]:
    """Sentences on how far the verdict can be relied on."""
    allowed = verdict.false_alarm_probability_per_hour
    sentences = [
        f"Clean signals are called spoofed at most {rate_words(allowed)} (false-alarm probability asked for: "
        f"{allowed:g} per hour)."
    ]
    saying = {"spoofed": ("spoofed", "attack"), "authentic": ("authentic",), "undecided": ()}[verdict.verdict]
    for_it = [m for m in verdict.methods if m.ran and m.decision in saying and m.p_value is not None]
    if for_it:
        best = min(for_it, key=lambda method: method.p_value if method.p_value is not None else 1.0)
        assert best.p_value is not None
        sentences.append(
            f"The strongest evidence is that of {best.detector}: {_by_chance(best.decision, best.p_value)}"
        )
    labels = {(s.receiver, s.sat, s.band, s.code, s.copy, s.label) for s in verdict.signals}
    count = len({label[:-1] for label in labels})  # a signal may carry one label after another
    told = ", ".join(f"{sum(x[-1] == label for x in labels)} {label}" for label in draw.LABELS
                     if any(x[-1] == label for x in labels))  # fmt: skip
    sentences.append(f"{count} signals received: {told}." if told else "No signals were received.")
    return sentences


def _by_chance(decision: str | None, p_value: float) -> str:
    otherwise = "were the signals false" if decision == "authentic" else "in a clean sky"
    return f"{otherwise}, chance alone gives as much {chance_words(p_value)} ({p_value_words(p_value)})."


def _words_of_test(method: Method) -> list[str]:
    sentences = [f"{method.tests} {'test' if method.tests == 1 else 'tests'} made."]
    if method.statistic is not None:
        against = f", its threshold {number_words(method.threshold)}" if method.threshold is not None else ""
        sentences.append(f"The statistic of the most telling one is {number_words(method.statistic)}{against}.")
    if method.p_value is not None:
        words = _by_chance(method.decision, method.p_value)
        sentences.append(words[0].upper() + words[1:])
    if method.false_alarm_probability is not None:
        sentences.append(f"False alarms allowed: {chance_words(method.false_alarm_probability)}.")
    return sentences


def _scale(method: Method) -> Markup:
    if method.statistic is None or method.threshold is None:
        return Markup("")
    title = f"{method.detector}: statistic {number_words(method.statistic)}, threshold {number_words(method.threshold)}"
    return draw.evidence_scale(method.statistic, method.threshold, title=title)


def _maps(pictures: Pictures) -> list[Figure]:
    """All fixes, then the trusted ones of each receiver close up, where the large map is too coarse for them."""
    if pictures.origin is None or not (overview := draw.local_map(pictures.tracks, title="Map of all fixes")):
        return []
    figures = [Figure(
        "Where it was, where it seemed to be", overview,
        f"Metres east and north of {pictures.origin.lat_deg:.6f}°, {pictures.origin.lon_deg:.6f}°. Disc: last trusted "
        "fix with its 95 % ellipse; diamond: what the false signals show; ring: what a receiver without protection "
        "shows; triangle: a place that the evidence leaves open; lines: the way there.",
    )]  # fmt: skip
    for track in pictures.tracks:
        if track.kind == "trusted" and draw.extent_m([track]) < 0.1 * draw.extent_m(pictures.tracks):
            close = draw.local_map([track], title=f"Trusted fixes of {track.receiver}", least_m=4.0, names=False)
            caption = "Trusted fixes on the map's axes, the last one marked, with its 95 % ellipse."
            figures.append(Figure(f"{track.receiver} close up", close, caption))
    return figures


def _receivers(items: tuple[SkyPosition, ...] | tuple[SignalSeries, ...]) -> list[str]:
    return sorted({item.receiver for item in items})


def _skies(verdict: Verdict, pictures: Pictures) -> list[Figure]:
    sources = [
        SkySource(name=source.name, azimuth_deg=source.azimuth_deg, elevation_deg=source.elevation_deg)
        for source in verdict.sources
        if source.azimuth_deg is not None and source.elevation_deg is not None
    ]
    return [
        Figure(
            f"Sky over {receiver}",
            draw.sky_plot([p for p in pictures.sky if p.receiver == receiver], sources, title=f"Sky over {receiver}"),
            "Where the satellites stand, zenith in the middle; rings of elevation every 30°. A divided disc is a "
            "satellite of which several signals are received." + (" Cross: a source of false signals." * bool(sources)),
        )
        for receiver in _receivers(pictures.sky)
    ]


def _time_lines(pictures: Pictures) -> list[Figure]:
    points = min(240, max(40, MAX_POINTS // max(len(pictures.series), 1)))
    return [
        Figure(
            f"Signals of {receiver}",
            draw.time_line(
                [series for series in pictures.series if series.receiver == receiver],
                title=f"Carrier to noise density and label of every signal of {receiver} over time",
                zero=f"{instant_words(pictures.zero_gpst)} GPS time", onset_s=pictures.onset_s, points=points,
            ),
            "One row a satellite, one line a signal: carrier to noise density, coloured by label.",
        )
        for receiver in _receivers(pictures.series)
    ]  # fmt: skip


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
    environment.filters |= {"fixed": _fixed, "instant": instant_words, "p_value": p_value_words,
                            "seconds": seconds_words}  # fmt: skip
    environment.globals["span"] = span_words
    return environment
