"""Every figure of the page, with its heading and what stands below it."""

import math
from dataclasses import dataclass

from skyproof.gnss.time import format_clock
from skyproof.report import pictures as draw
from skyproof.report import proof, takeover
from skyproof.report.pictures import (
    DelayProfile,
    FixTrack,
    MethodWords,
    RangeDifference,
    SignalSeries,
    SkyPosition,
    SkySource,
    TruePlace,
)
from skyproof.report.takeover import ComparedSkies, CorrelationParts, FixOrigins
from skyproof.report.template import Figure
from skyproof.report.words import chance_words, distance_words, number_words, place_words
from skyproof.verdict import USABLE, Label, Place, Verdict

__all__ = ["Pictures", "draw_map_figures", "draw_signal_figures"]

MAX_POINTS = 20_000  # of all time lines together: keeps the page small, whatever the number of receivers
MOST_CLOSE = 6  # receivers that get a map of their own
LEAST_WRONG = 1e-12  # of a choice, as its words have it


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
    findings: tuple[MethodWords, ...] = ()


def draw_map_figures(pictures: Pictures, *, minutes: bool = False) -> list[Figure]:
    """Draw where it was, what that came from, and which sky is true.

    minutes : write places in degrees and decimal minutes.
    """
    return [*_draw_maps(pictures, minutes), *_origins(pictures), *_draw_compared(pictures)]


def draw_signal_figures(verdict: Verdict, pictures: Pictures) -> list[Figure]:
    """Draw which signals there were, and what shows that they are false."""
    return [*_time_lines(pictures), *_draw_proofs(pictures), *_draw_correlations(pictures), *_skies(verdict, pictures)]


def _draw_maps(pictures: Pictures, minutes: bool) -> list[Figure]:
    """Draw all fixes, then each receiver's close up, where the large map is too coarse for them."""
    overview = draw.draw_local_map(pictures.tracks, pictures.truth, title="Map of all fixes")
    if pictures.origin is None or not overview:
        return []
    kinds = {track.kind for track in pictures.tracks if len(track.points())}
    keys = {
        "trusted": "disc: last trusted fix with its 95 % ellipse",
        "consistent": "open disc: last consistent fix, not proven, with its 95 % ellipse",
        "inertial": "filled square: dead reckoning by the inertial unit",
        "held": "open square: last trusted place of the standing receiver",
        "false": "diamond: position that the false signals show",
        "unprotected": "ring: position without protection",
        "receiver": "large ring, dotted line: what the receiver itself computed",
        "possible": "triangle: a place that the evidence leaves open",
    }
    legend = [words for kind, words in keys.items() if kind in kinds]
    legend += ["cross: true place from the truth file, which the verdict does not use"] * bool(pictures.truth)
    origin = place_words(pictures.origin.lat_deg, pictures.origin.lon_deg, minutes=minutes)
    close = [
        track
        for track in pictures.tracks
        if track.kind in ("trusted", "consistent")
        and len(track.points())
        and draw.extent_m([track]) < 0.1 * draw.extent_m(pictures.tracks)
    ][:MOST_CLOSE]
    figures = [
        Figure(
            "True and false positions" if "false" in kinds else "Map of the fixes",
            overview,
            f"Metres east and north of {origin}. "
            + "; ".join([*legend, "lines: tracks"]).capitalize()
            + "."
            + "".join(_describe_error(track, pictures) for track in pictures.tracks if track not in close),
        )
    ]
    for track in close:
        truth = [place for place in pictures.truth if place.receiver == track.receiver]
        kind = track.kind.capitalize()
        svg = draw.draw_local_map([track], truth, title=f"{kind} fixes of {track.receiver}", least_m=4.0, names=False)
        caption = f"{kind} fixes on the map’s axes, the last one marked, with its 95 % ellipse."
        figures.append(Figure(f"{track.receiver} close up", svg, caption + _describe_error(track, pictures)))
    return figures


def _describe_error(track: FixTrack, pictures: Pictures) -> str:
    """State how far the last usable fix lies from the truth; empty where that is not known."""
    place = next((place for place in pictures.truth if place.receiver == track.receiver), None)
    first = next(
        (usable for usable in pictures.tracks if usable.receiver == track.receiver and len(usable.points())), None
    )
    if place is None or track is not first or track.kind not in USABLE:
        return ""
    east_m, north_m = track.points()[-1]
    off_m = math.hypot(float(east_m) - place.east_m, float(north_m) - place.north_m)
    return f" The last {track.kind} fix of {track.receiver} lies {distance_words(off_m)} from the truth, horizontally."


ORIGINS = {
    "trusted": "filled: authentic signals",
    "consistent": "half filled: signals while no test failed",
    "inertial": "light: inertial unit, from the last of those on",
    "held": "dashed: last trusted place of the standing receiver",
}


def _origins(pictures: Pictures) -> list[Figure]:
    zero = format_clock(pictures.zero_gpst)
    return [
        Figure(
            f"Source of the position of {track.receiver}",
            takeover.plot_origins(
                track,
                title=f"Source of the position of {track.receiver} and error of an ordinary receiver over time",
                zero=zero,
                onset_s=pictures.onset_s,
                until_s=pictures.until_s,
            ),
            "Line: distance between the unprotected and the usable position. Bar: source of the usable position "
            f"({'; '.join(ORIGINS[kind] for kind in ORIGINS if kind in _kinds(track))}); a gap where there is none.",
        )
        for track in pictures.origins
    ]


def _kinds(origins: FixOrigins) -> set[str]:
    return {span.origin for span in origins.usable}


def _draw_compared(pictures: Pictures) -> list[Figure]:
    """Draw skies beside the predicted one: position on a map, time on a line, and the choice in words."""
    figures = []
    for comparison in pictures.compared:
        heading = f"Which sky of {comparison.receiver} is true"
        how = (
            f"At {number_words(comparison.at_s)} s; predicted by {comparison.by}. "
            + (
                f"Disc: chosen; diamond: refused; this is wrong {_wrong_words(comparison.wrong)}."
                if comparison.chosen
                else ""
            )
            + (
                f"None is chosen: the likelier one is wrong {_wrong_words(comparison.wrong)}."
                if not comparison.chosen
                else ""
            )
        )
        if comparison.tracks:
            svg = takeover.map_skies(
                comparison, title=f"Positions by the skies of {comparison.receiver} and the expected one"
            )
            words = "Metres east and north of the expected position (square), with 95 % ellipses."
            figures.append(Figure(f"{heading}: position", svg, f"{how} {words}"))
        if comparison.offsets:
            svg = takeover.plot_clocks(
                comparison, title=f"Times by the skies of {comparison.receiver} against the expected one"
            )
            words = "" if comparison.tracks else f"{how} "
            words += "The receiver’s clock by each sky, two sigma to either side."
            figures.append(Figure(f"{heading}: time", svg, words))
    return figures


def _wrong_words(probability: float) -> str:
    return chance_words(max(probability, LEAST_WRONG))


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
    for receivers in _group_by_sky(pictures.sky):
        title = f"Sky over {', '.join(receivers)}"
        positions = [p for p in pictures.sky if p.receiver == receivers[0]]
        figures.append(Figure(title, draw.plot_sky(positions, sources, title=title), caption))
    return figures


def _group_by_sky(sky: tuple[SkyPosition, ...]) -> list[list[str]]:
    """Group receivers with the same labels in the same directions, which one drawing shows."""
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
            draw.draw_time_line(
                [series for series in pictures.series if series.receiver == receiver],
                title=f"Carrier to noise density and label of every signal of {receiver} over time",
                zero=format_clock(pictures.zero_gpst),
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


def _draw_proofs(pictures: Pictures) -> list[Figure]:
    """Draw the correlation of attacked satellites, and range differences of each pair of receivers."""
    figures = []
    if pictures.profiles:
        first = pictures.profiles[0]
        several = any(len(profile.tags) > 1 for profile in pictures.profiles)
        labels: set[Label] = {tag.label for profile in pictures.profiles for tag in profile.tags}
        figures.append(
            Figure(
                f"Two peaks where there should be one: {first.receiver}"
                if several
                else f"Correlation in {first.receiver}",
                proof.plot_profiles(
                    pictures.profiles, title=f"Correlation over delay of satellites in {first.receiver}"
                ),
                f"Samples of 50 ms at {number_words(first.at_s)} s, compared with each satellite’s code at every "
                "delay. "
                f"Each peak is a signal; delays count from the {'true' if 'authentic' in labels else 'first'} one.",
            )
        )
    for pair in sorted({d.receivers for d in pictures.differences}):
        rows = [d for d in pictures.differences if d.receivers == pair]
        figures.append(
            Figure(
                f"Range difference, {pair[1]} minus {pair[0]}",
                proof.plot_differences(rows, title=f"Range differences between {pair[0]} and {pair[1]} by satellite"),
                "Difference of the ranges from a satellite to the two antennas. Signals from the sky have a different "
                "one for each satellite. Signals of one transmitter share one, and stand in one line.",
            )
        )
    return figures


def _draw_correlations(pictures: Pictures) -> list[Figure]:
    """Draw the correlations of satellites with two signals within about a chip."""
    if not pictures.correlations:
        return []
    first = pictures.correlations[0]
    return [
        Figure(
            f"Two signals in one peak: {first.receiver}",
            takeover.plot_correlations(pictures.correlations, title=f"Correlation of {first.receiver} taken apart"),
            f"Correlation at {number_words(first.at_s)} s, 20 ms: height is its magnitude, colour its phase, both from "
            "the samples. Lines: the stronger signal (full) and the second one (dashed) as they were taken apart; in "
            "numbers the second’s delay, power and phase against the stronger one. One signal alone has one colour.",
        )
    ]
