"""What one antenna shows of signals on top of its own, drawn: a satellite's correlation coloured by its phase, skies
beside what was expected of the true one, and what positions came from over time.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from markupsafe import Markup

from skyproof.arrays import Complexes, Integers, Reals
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.records import freeze
from skyproof.report import drawing as draw
from skyproof.report.pictures import FixTrack, Kind, draw_local_map
from skyproof.verdict import UsableKind

__all__ = ["ComparedSkies", "CorrelationParts", "FixOrigins", "OriginSpan", "TimeOffset"]
__all__ += ["map_skies", "plot_clocks", "plot_correlations", "plot_origins"]

_PHASES = 12  # colours round the circle
_COLUMNS = 2
_PANEL = 116.0  # units, the height of one
_POINTS = 240  # of a line over time
_LEAST_NS = 1.0


@dataclass(frozen=True, eq=False, kw_only=True)
class CorrelationParts:
    """One satellite's correlation in one coherent interval, and the signals it was taken apart into.

    delays_chips : (n,) behind the stronger signal, ascending. value : (n,) in units of the root of one value's noise
    variance; its phase counts from the stronger signal's. parts : (2, n) magnitude of each signal alone, the stronger
    first. second_chips, second_db, second_deg : delay, power and phase of the second against it.
    """

    receiver: str
    sat: str
    at_s: float
    delays_chips: Reals
    value: Complexes
    parts: Reals
    second_chips: float
    second_db: float
    second_deg: float

    def __post_init__(self) -> None:
        freeze(self, {"delays_chips": ("delay",), "value": ("delay",), "parts": ("2", "delay")})


@dataclass(frozen=True, kw_only=True)
class TimeOffset:
    """Clock by one sky, less what was expected of it."""

    name: str
    kind: Kind
    ns: float
    sigma_ns: float


@dataclass(frozen=True, eq=False, kw_only=True)
class ComparedSkies:
    """Skies of one receiver beside what was expected of the true one at `at_s` of the pictures' time.

    tracks : one fix each, metres east and north of the expected position, which is one of them; none if it was not
    known. offsets : the same of time. by : what the expectation rests on. wrong : probability that the likeliest sky is
    not the true one. chosen : whether one was.
    """

    receiver: str
    at_s: float
    by: str
    tracks: tuple[FixTrack, ...]
    offsets: tuple[TimeOffset, ...]
    wrong: float
    chosen: bool


@dataclass(frozen=True)
class OriginSpan:
    """So long positions came from there, in seconds of the pictures' time."""

    origin: UsableKind
    from_s: float
    to_s: float


@dataclass(frozen=True, eq=False, kw_only=True)
class FixOrigins:
    """What the usable positions of a receiver came from, and how far an ordinary receiver's position was from them.

    seconds, away_m : (n,) ascending; NaN where there is not both.
    """

    receiver: str
    usable: tuple[OriginSpan, ...]
    seconds: Reals
    away_m: Reals

    def __post_init__(self) -> None:
        freeze(self, {"seconds": ("epoch",), "away_m": ("epoch",)})


# Correlation


def plot_correlations(satellites: Sequence[CorrelationParts], *, title: str) -> Markup:
    """Plot a panel per satellite: correlation magnitude as height, phase as colour, signals as lines."""
    if not satellites:
        return Markup("")
    left_x, gap, top, right_x = 40.0, 14.0, 8.0, 352.0
    columns = min(_COLUMNS, len(satellites))
    wide = (right_x - left_x - gap * (columns - 1)) / columns
    rows = math.ceil(len(satellites) / columns)
    highest = max(float(np.max(np.abs(satellite.value))) for satellite in satellites)
    parts: list[Markup] = []
    for index, satellite in enumerate(satellites):
        row, column = divmod(index, columns)
        x0, y0 = left_x + column * (wide + gap), top + row * _PANEL
        across = draw.Scale(float(satellite.delays_chips[0]), float(satellite.delays_chips[-1]), x0, x0 + wide)
        up = draw.Scale(0.0, 1.4 * highest, y0 + _PANEL - 24.0, y0)
        parts += _panel(satellite, across, up, numbered=column == 0)
    bottom = top + rows * _PANEL
    parts += [
        draw.text(
            (left_x + right_x) / 2.0,
            bottom + 14.0,
            f"delay, chips (1 chip = {GPS_L1_CA.chip_m:.0f} m)",
            anchor="middle",
            css="axis",
        ),
        draw.text(9.0, (top + bottom) / 2.0, "magnitude, noise = 1", anchor="middle", css="small axis", turn=True),
        *_draw_phase_key(left_x, right_x, bottom + 24.0),
    ]
    return draw.svg(bottom + 52.0, title, parts)


def _panel(one: CorrelationParts, across: draw.Scale, up: draw.Scale, *, numbered: bool) -> list[Markup]:
    parts: list[Markup] = []
    for tick in draw.nice_ticks(across.low, across.high, 5):
        parts += [
            draw.line(across(tick), up.end, across(tick), up.start, "grid"),
            draw.text(across(tick), up.start + 12.0, draw.number(tick), anchor="middle", css="small"),
        ]
    for tick in draw.nice_ticks(up.low, up.high, 3):
        if numbered:
            parts.append(draw.text(across.start - 4.0, up(tick) + 3.5, draw.number(tick), anchor="end", css="small"))
    x, y = across.pixels(one.delays_chips), up.pixels(np.abs(one.value))
    colour = _colour_by_phase(one.value)
    edges = np.concatenate([[0], np.flatnonzero(np.diff(colour)) + 1, [colour.size]])
    for first, stop in pairwise(edges):
        over = slice(first, min(stop + 1, colour.size))
        line = "L".join(f"{a:.1f} {b:.1f}" for a, b in zip(x[over], y[over], strict=True))
        shape = f"M{x[over][0]:.1f} {up.start:.1f}L{line}L{x[over][-1]:.1f} {up.start:.1f}z"
        parts.append(Markup('<path class="phase p{}" d="{}"/>').format(int(colour[first]), shape))
    parts += [
        draw.path(x, up.pixels(part), f"part {name}") for part, name in zip(one.parts, ("first", "second"), strict=True)
    ]
    words = f"{one.second_chips:+.2f} chip, {one.second_db:+.0f} dB, {one.second_deg:+.0f}°"
    return [
        *parts,
        draw.line(across.start, up.start, across.end, up.start, "frame"),
        draw.text(across.start + 3.0, up.end + 10.0, one.sat, css="halo"),
        draw.text(across.start + 3.0, up.end + 21.0, words.replace("-", "\N{MINUS SIGN}"), css="small halo"),
    ]


def _colour_by_phase(value: Complexes) -> Integers:
    """Return which twelfth of the circle each phase is next to."""
    return np.asarray(np.rint(np.angle(value) / (2.0 * np.pi / _PHASES)).astype(np.int64) % _PHASES)


def _draw_phase_key(left: float, right: float, y: float) -> list[Markup]:
    """Draw a bar of all colours from -180 to 180 degrees."""
    across = draw.Scale(-180.0, 180.0, left + 60.0, right - 60.0)
    step = 360.0 / _PHASES
    parts = []
    for k in range(-_PHASES // 2, _PHASES // 2 + 1):
        edges = [across(min(max(step * (k + side), -180.0), 180.0)) for side in (-0.5, 0.5)]
        parts.append(draw.rect(edges[0], y, edges[1], y + 8.0, f"phase p{k % _PHASES}"))
    for degrees in (-180.0, -90.0, 0.0, 90.0, 180.0):
        parts.append(
            draw.text(across(degrees), y + 19.0, f"{draw.number(degrees)}°", anchor="middle", css="small"),
        )
    return [*parts, draw.text(across.start - 8.0, y + 7.5, "phase", anchor="end", css="small")]


# Skies


def map_skies(compared: ComparedSkies, *, title: str) -> Markup:
    """Map where the skies put the receiver, about where it was predicted."""
    return draw_local_map(compared.tracks, title=title, least_m=4.0)


def plot_clocks(compared: ComparedSkies, *, title: str) -> Markup:
    """Plot a row per sky: its time against the predicted one, two sigma to either side."""
    if not compared.offsets:
        return Markup("")
    left_x, right_x, top, step = 76.0, 346.0, 6.0, 20.0
    bottom = top + step * len(compared.offsets)
    reach = 1.15 * max(*(abs(offset.ns) + 2.0 * offset.sigma_ns for offset in compared.offsets), _LEAST_NS)
    across = draw.Scale(-reach, reach, left_x, right_x)
    parts = draw.columns(across, top, bottom, zero="limit")
    for row, offset in enumerate(compared.offsets):
        y = top + step * (row + 0.5)
        ends = np.array([across(offset.ns + side * offset.sigma_ns) for side in (-2.0, 2.0)])
        mark = "ring expected" if offset.kind == "expected" else f"mark {offset.kind}"
        parts += [
            draw.text(left_x - 6.0, y + 4.0, offset.name, anchor="end", css=f"name {offset.kind}"),
            draw.path(ends, np.array([y, y]), f"range {offset.kind}"),
            draw.circle(across(offset.ns), y, 4.5, mark),
        ]
    parts += [
        draw.rect(left_x, top, right_x, bottom, "frame"),
        draw.text((left_x + right_x) / 2.0, bottom + 31.0, "time minus expected time, ns", anchor="middle", css="axis"),
    ]
    return draw.svg(bottom + 38.0, title, parts)


# Where positions come from


def plot_origins(
    origins: FixOrigins, *, title: str, zero: str, onset_s: float | None = None, until_s: float | None = None
) -> Markup:
    """Plot how far an ordinary receiver was from the usable position, and what that came from."""
    spans = [s for span in origins.usable for s in (span.from_s, span.to_s)]
    start_s = min([*spans, *origins.seconds[:1].tolist()], default=0.0)
    end_s = max([*spans, *origins.seconds[-1:].tolist()], default=0.0)
    if end_s <= start_s:
        return Markup("")
    left_x, right_x, top, bottom = 52.0, 346.0, 14.0, 130.0
    unit, scale = draw.time_unit(end_s - start_s)
    across = draw.Scale(start_s, end_s, left_x, right_x)
    away = origins.away_m[np.isfinite(origins.away_m)]
    up = draw.Scale(0.0, max(1.1 * float(away.max(initial=0.0)), 10.0), bottom, top)
    low = bottom + 8.0
    seconds, away_m = draw.thin(origins.seconds, origins.away_m, _POINTS)
    parts = [
        *_axes(across, up, scale, low + 14.0),
        draw.path(across.pixels(seconds), up.pixels(away_m), "curve"),
        draw.text(left_x - 5.0, low + 9.0, "source", anchor="end", css="small axis"),
        *(
            draw.rect(across(span.from_s), low, max(across(span.to_s), across(span.from_s) + 1.0), low + 11.0, css)
            for span in origins.usable
            for css in (f"from {span.origin}",)
        ),
    ]
    for name, at_s in (("onset", onset_s), ("end", until_s)):
        if at_s is not None and start_s <= at_s <= end_s:
            x = across(at_s)
            parts += [
                draw.line(x, top - 3.0, x, low + 11.0, "onset"),
                draw.text(
                    min(max(x, left_x + 20.0), right_x - 20.0), top - 4.0, name, anchor="middle", css="name false"
                ),
            ]
    parts += [
        draw.text(10.0, (top + bottom) / 2.0, "distance, m", anchor="middle", css="axis", turn=True),
        draw.text((left_x + right_x) / 2.0, low + 44.0, f"time since {zero}, {unit}", anchor="middle", css="axis"),
    ]
    return draw.svg(low + 50.0, title, parts)


def _axes(across: draw.Scale, up: draw.Scale, seconds: float, numbers_at: float) -> list[Markup]:
    parts = []
    for tick in draw.nice_ticks(across.low / seconds, across.high / seconds):
        x = across(tick * seconds)
        parts += [
            draw.line(x, up.end, x, up.start, "grid"),
            draw.text(x, numbers_at + 11.0, draw.number(tick), anchor="middle"),
        ]
    for tick in draw.nice_ticks(up.low, up.high, 4):
        parts += [
            draw.line(across.start, up(tick), across.end, up(tick), "grid"),
            draw.text(across.start - 5.0, up(tick) + 4.0, draw.number(tick), anchor="end"),
        ]
    return [*parts, draw.rect(across.start, up.end, across.end, up.start, "frame")]
