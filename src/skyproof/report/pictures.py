"""Records to SVG: the map, the time line and the sky, drawn by hand for one offline page."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from markupsafe import Markup

from skyproof.arrays import Reals
from skyproof.records import LABELS, freeze
from skyproof.report import drawing as draw
from skyproof.verdict import USABLE, Label, UsableKind

__all__ = [
    "DelayProfile",
    "DelayTag",
    "FixTrack",
    "Kind",
    "MethodWords",
    "RangeDifference",
    "SignalSeries",
    "SkyPosition",
    "SkySource",
    "TruePlace",
    "draw_local_map",
    "draw_time_line",
    "extent_m",
    "plot_sky",
]

Kind = Literal[UsableKind, "false", "unprotected", "possible", "expected", "receiver"]
"""What a position comes from; possible: from a consistent sky that may be the true one or not;
expected: from what was known before; receiver: computed by the receiver itself."""

KINDS: tuple[Kind, ...] = (
    *USABLE,
    "false",
    "possible",
    "expected",
    "unprotected",
    "receiver",
)  # in the order of their weight

Spot = Literal[Kind, "truth"]
SPOTS: tuple[Spot, ...] = (*KINDS, "truth")

MOST_PLACES = 5  # on a map, whose labels name all that is there
MOST_NAMED = 4  # receivers in one label
MOST_RIBBONS = 4  # of a satellite; more signals share the last
ELLIPSE_95 = math.sqrt(-2.0 * math.log(0.05))  # sigmas that hold 95 % of a normal distribution in the plane


@dataclass(frozen=True, eq=False, kw_only=True)
class SignalSeries:
    """One signal over time.

    seconds : (n,) since the zero of the pictures, ascending.
    cn0_dbhz : (n,) carrier to noise density; NaN where the signal is not received.
    """

    receiver: str
    signal: str  # "G05 L1 CA b"
    label: Label
    seconds: Reals
    cn0_dbhz: Reals

    def __post_init__(self) -> None:
        freeze(self, {"seconds": ("epoch",), "cn0_dbhz": ("epoch",)})


@dataclass(frozen=True, eq=False, kw_only=True)
class FixTrack:
    """Fixes of one receiver and kind in the local level plane about the origin of the pictures.

    east_m, north_m : (n,) in order of time; NaN where there is no fix.
    covariance_m2 : (2, 2) of east and north of the last fix; None draws no ellipse.
    """

    receiver: str
    kind: Kind
    east_m: Reals
    north_m: Reals
    covariance_m2: Reals | None = None

    def __post_init__(self) -> None:
        freeze(self, {"east_m": ("epoch",), "north_m": ("epoch",)})
        if self.covariance_m2 is not None:
            freeze(self, {"covariance_m2": ("2", "2")})

    def points(self) -> Reals:
        """Return the existing fixes, shape (n, 2): east and north, metres."""
        points = np.column_stack((self.east_m, self.north_m))
        return points[np.isfinite(points).all(axis=1)]


@dataclass(frozen=True, kw_only=True)
class TruePlace:
    """Where a receiver truly was, known from elsewhere, in the plane of the tracks."""

    receiver: str
    east_m: float
    north_m: float


@dataclass(frozen=True, kw_only=True)
class SkyPosition:
    """Where a signal's satellite stands, by its own message: azimuth clockwise from north."""

    receiver: str
    signal: str
    label: Label
    azimuth_deg: float
    elevation_deg: float


@dataclass(frozen=True, kw_only=True)
class SkySource:
    """Where a source of false signals was seen."""

    name: str
    azimuth_deg: float
    elevation_deg: float


@dataclass(frozen=True, kw_only=True)
class DelayTag:
    """A signal in a delay profile: where it is, and what it was found to be."""

    label: Label
    delay_chips: float


@dataclass(frozen=True, eq=False, kw_only=True)
class DelayProfile:
    """Correlation of one satellite's code over delay, at `at_s` of the pictures' time.

    delays_chips : (n,) behind the first of the tags, evenly spaced. power : (n,) in units of the noise's mean.
    """

    receiver: str
    sat: str
    at_s: float
    delays_chips: Reals
    power: Reals
    tags: tuple[DelayTag, ...]

    def __post_init__(self) -> None:
        freeze(self, {"delays_chips": ("delay",), "power": ("delay",)})


@dataclass(frozen=True, kw_only=True)
class RangeDifference:
    """Range of a satellite's signal in the second receiver minus in the first, less the mean of its group: of signals
    that fit one position."""

    receivers: tuple[str, str]
    sat: str
    label: Label
    metres: float
    group: int = 0


@dataclass(frozen=True, kw_only=True)
class MethodWords:
    """What a detector's most telling test found, in its own words, and when."""

    detector: str
    words: str
    from_gpst: str
    to_gpst: str


# The map


def _draw_ellipse(track: FixTrack) -> Reals:
    """Return the 95 % ellipse (n, 2) about the last fix, metres east and north; empty if not known."""
    points = track.points()
    if track.covariance_m2 is None or not len(points) or not np.isfinite(track.covariance_m2).all():
        return np.empty((0, 2))
    variance, axes = np.linalg.eigh(track.covariance_m2)
    radii = ELLIPSE_95 * np.sqrt(np.maximum(variance, 0.0))
    angle = np.linspace(0.0, 2.0 * np.pi, 49)
    return np.asarray(points[-1] + (np.stack((np.cos(angle), np.sin(angle)), axis=-1) * radii) @ axes.T)


def _draw_mark(x: float, y: float, kind: Spot) -> Markup:
    """Draw one shape per kind, so that colour is not needed.

    Disc, open disc, filled and open square, diamond, triangle, large square, ring, cross.
    """
    if kind == "truth":
        return Markup('<path class="true-place" d="M{:.1f} {:.1f}h14m-7 -7v14"/>').format(x - 7.0, y)
    if kind in ("trusted", "consistent"):
        return draw.circle(x, y, 4.5, f"mark {kind}")
    if kind in ("inertial", "held"):
        return draw.rect(x - 4.0, y - 4.0, x + 4.0, y + 4.0, f"mark {kind}")
    if kind == "false":
        return Markup('<path class="mark false" d="M{:.1f} {:.1f}l6 6l-6 6l-6 -6z"/>').format(x, y - 6.0)
    if kind == "possible":
        return Markup('<path class="mark possible" d="M{:.1f} {:.1f}l5.5 9.5h-11z"/>').format(x, y - 6.0)
    if kind == "expected":
        return draw.rect(x - 7.0, y - 7.0, x + 7.0, y + 7.0, "ring expected")
    if kind == "receiver":
        return draw.circle(x, y, 12.0, "ring receiver")
    return draw.circle(x, y, 8.5, "ring unprotected")


def draw_local_map(
    tracks: Sequence[FixTrack],
    truth: Sequence[TruePlace] = (),
    *,
    title: str,
    least_m: float = 10.0,
    names: bool = True,
) -> Markup:
    """Draw a map in metres east and north with a scale bar.

    Last fix of each track marked, the track behind it, 95 % ellipses, and crosses where the truth is known.

    Tracks without any fix are left out; without any track at all the result is empty.
    """
    tracks = [track for track in tracks if len(track.points())]
    if not tracks:
        return Markup("")
    left_x, right_x, top, bottom = 50.0, 350.0, 10.0, 310.0
    crosses = np.array([(place.east_m, place.north_m) for place in truth]).reshape(-1, 2)
    points = np.concatenate([*(track.points() for track in tracks), *map(_draw_ellipse, tracks), crosses])
    west_m, south_m, east_m, north_m = draw.extent(points, least_m, (bottom - top) / (right_x - left_x))
    east, north = draw.Scale(west_m, east_m, left_x, right_x), draw.Scale(south_m, north_m, bottom, top)
    unit, metres = ("km", 1000.0) if east_m - west_m > 20e3 else ("m", 1.0)

    parts = list(draw.grid(east, north, (f"east, {unit}", f"north, {unit}"), (metres, metres)))
    marks: list[Mark] = []
    lines: list[draw.Box] = []  # that names had better not cross
    for track in sorted(tracks, key=lambda track: -KINDS.index(track.kind)):
        fixes = track.points()
        kept = fixes[np.unique(np.linspace(0, len(fixes) - 1, 150).astype(int))]
        way = np.column_stack((east.pixels(kept[:, 0]), north.pixels(kept[:, 1])))
        parts.append(draw.path(way[:, 0], way[:, 1], f"track {track.kind}"))
        ring = np.column_stack((east.pixels(_draw_ellipse(track)[:, 0]), north.pixels(_draw_ellipse(track)[:, 1])))
        parts.append(draw.path(ring[:, 0], ring[:, 1], f"ellipse {track.kind}"))
        lines += [(x - 2.0, y - 2.0, x + 2.0, y + 2.0) for x, y in (*ring, *way)]
        marks.append((east(float(fixes[-1, 0])), north(float(fixes[-1, 1])), track.kind, track.receiver))
    marks += [(east(place.east_m), north(place.north_m), "truth", place.receiver) for place in truth]
    parts += [_draw_mark(x, y, kind) for x, y, kind, _ in marks]
    bar, room = draw.scale_bar(east, bottom - 8.0)
    places = _places(marks)
    tags = [tag for place in places for tag in _label_place(place, names, brief=len(places) > MOST_PLACES)]
    taken = [room, *lines, *((x - 8.0, y - 8.0, x + 8.0, y + 8.0) for x, y, _, _ in marks)]
    words = draw.place_tags(tags, taken, (left_x + 2.0, top + 2.0, right_x - 2.0, bottom - 2.0))
    return draw.svg(348.0, title, [*parts, *bar, *words])


Mark = tuple[float, float, Spot, str]
"""x, y, what stands there, and the receiver."""


def _places(marks: Sequence[Mark]) -> list[list[Mark]]:
    """Marks that (nearly) coincide, together."""
    places: list[list[Mark]] = []
    for mark in marks:
        near = next((p for p in places if math.hypot(p[0][0] - mark[0], p[0][1] - mark[1]) < 10.0), None)
        if near is None:
            places.append([mark])
        else:
            near.append(mark)
    return places


def _label_place(place: Sequence[Mark], names: bool, *, brief: bool) -> list[draw.Tag]:
    """Label one place; kinds of the same receivers share one label, in the colour of the weightiest.

    If it is to be brief, that one stands for all: the marks show the others.
    """
    receivers: dict[Spot, list[str]] = {}
    for _, _, spot, receiver in place:
        receivers.setdefault(spot, []).append(receiver)
    spots: dict[tuple[str, ...], list[Spot]] = {}
    for spot in SPOTS:
        if spot in receivers and (spot != "truth" or len(receivers) == 1):  # its cross says so where others are named
            spots.setdefault(tuple(receivers[spot]), []).append(spot)
    x, y = place[0][:2]
    tags = []
    for who, same in spots.items():
        written = ", ".join(same[:1] if brief else same)
        if names:
            written += f": {', '.join(who) if len(who) <= MOST_NAMED else f'{len(who)} receivers'}"
        tags.append(draw.Tag(x, y, written, f"name {same[0]}", 9.0))
    return tags


# The time line


def _row_range(series: Sequence[SignalSeries]) -> tuple[float, float]:
    """Bounds of C/N0 in dB-Hz that hold all values and have a round middle."""
    values = np.concatenate([s.cn0_dbhz[np.isfinite(s.cn0_dbhz)] for s in series])
    if not values.size:
        return 30.0, 50.0
    low = 5.0 * math.floor(values.min() / 5.0)
    return low, low + 10.0 * max(math.ceil((values.max() - low) / 10.0), 1)


def draw_time_line(
    series: Sequence[SignalSeries],
    *,
    title: str,
    zero: str,
    onset_s: float | None = None,
    onset_sigma_s: float | None = None,
    until_s: float | None = None,
    points: int = 240,
) -> Markup:
    """Draw C/N0 of every signal over time, a row per satellite, coloured by label.

    Below each row a ribbon a signal shows how long it carries its label.

    zero : what second zero is, in words, for the axis. onset_sigma_s : draws a band of two of it to either side.
    points : the most that are drawn of one signal.
    """
    series = [s for s in series if s.seconds.size]
    if not series:
        return Markup("")
    rows: dict[str, list[SignalSeries]] = {}
    for signal_series in sorted(series, key=lambda s: s.signal):
        rows.setdefault(signal_series.signal.split()[0], []).append(signal_series)
    copies = {sat: sorted({s.signal for s in row}) for sat, row in rows.items()}
    slots = min(max(len(names) for names in copies.values()), MOST_RIBBONS)
    left_x, right_x, top, plot = 34.0, 324.0, 24.0, 21.0
    height = plot + 3.0 + 4.0 * slots
    bottom = top + height * len(rows)
    start_s, end_s = min(float(s.seconds[0]) for s in series), max(float(s.seconds[-1]) for s in series)
    unit, scale = draw.time_unit(end_s - start_s)
    time = draw.Scale(start_s, max(end_s, start_s + 1e-3), left_x, right_x)
    low, high = _row_range(series)

    parts: list[Markup] = []
    if onset_s is not None and onset_sigma_s is not None and time.low <= onset_s <= time.high:
        edges = [min(max(time(onset_s + sign * 2.0 * onset_sigma_s), left_x), right_x) for sign in (-1.0, 1.0)]
        parts.append(draw.rect(edges[0], top, edges[1], bottom, "onset-band"))
    parts += draw.columns(time, top, bottom, unit=scale, below=15.0)
    parts += [
        draw.text((left_x + right_x) / 2.0, bottom + 32.0, f"time since {zero}, {unit}", anchor="middle", css="axis"),
        draw.text(
            draw.WIDTH - 3.0,
            (top + bottom) / 2.0,
            f"C/N₀, each row {low:g} to {high:g} dB-Hz",
            anchor="middle",
            css="axis",
            turn=True,
        ),
    ]
    for index, (sat, signals) in enumerate(rows.items()):
        begin = top + height * index
        row = draw.Scale(low, high, begin + plot, begin + 2.0)
        middle = (low + high) / 2.0
        parts += [
            draw.line(left_x, begin, right_x, begin, "frame"),
            draw.line(left_x, row(middle), right_x, row(middle), "grid"),
            draw.text(left_x - 4.0, begin + height / 2.0 + 4.0, sat, anchor="end"),
            draw.text(right_x + 3.0, row(middle) + 3.0, f"{middle:g}", css="small"),
        ]
        for signal_series in signals:
            seconds, cn0_dbhz = draw.thin(signal_series.seconds, signal_series.cn0_dbhz, points)
            slot = min(copies[sat].index(signal_series.signal), slots - 1)
            parts += [
                draw.path(time.pixels(seconds), row.pixels(cn0_dbhz), f"series {signal_series.label}"),
                _draw_ribbon(time, seconds, cn0_dbhz, begin + plot + 3.0 + 4.0 * slot, signal_series.label),
            ]
    parts.append(draw.line(left_x, bottom, right_x, bottom, "frame"))
    for name, at_s in (("onset", onset_s), ("end", until_s)):
        if at_s is not None and time.low <= at_s <= time.high:
            x = time(at_s)
            parts += [
                draw.line(x, top - 4.0, x, bottom, "onset"),
                draw.text(
                    min(max(x, left_x + 20.0), right_x - 20.0), top - 8.0, name, anchor="middle", css="name false"
                ),
            ]
    return draw.svg(bottom + 38.0, title, parts)


def _draw_ribbon(time: draw.Scale, seconds: Reals, values: Reals, y: float, label: Label) -> Markup:
    """Draw a bar while there are values."""
    finite = np.concatenate([[False], np.isfinite(values) & np.isfinite(seconds), [False]])
    begins, ends = np.flatnonzero(~finite[:-1] & finite[1:]), np.flatnonzero(finite[:-1] & ~finite[1:]) - 1
    spans = zip(time.pixels(seconds[begins]), time.pixels(seconds[ends]), strict=True)
    steps = "".join(f"M{first:.1f} {y:.1f}H{max(last, first + 1.0):.1f}" for first, last in spans)
    return Markup('<path class="ribbon {}" d="{}"/>').format(label, steps) if steps else Markup("")


# The sky


def plot_sky(
    positions: Sequence[SkyPosition], sources: Sequence[SkySource] = (), axes: Sequence[SkySource] = (), *, title: str
) -> Markup:
    """Plot satellites by azimuth and elevation, north up, east right, with their signals' labels.

    sources : marked by crosses. axes : of a body, lines from the zenith to where they point, dashed below the horizon.
    """
    if not positions:
        return Markup("")
    x0, y0, radius = draw.WIDTH / 2.0, 150.0, 124.0

    def place(azimuth_deg: float, elevation_deg: float) -> tuple[float, float]:
        out = radius * (90.0 - max(elevation_deg, 0.0)) / 90.0
        return x0 + out * math.sin(math.radians(azimuth_deg)), y0 - out * math.cos(math.radians(azimuth_deg))

    parts = [
        draw.circle(x0, y0, radius * (90.0 - elevation) / 90.0, "frame" if elevation == 0.0 else "grid")
        for elevation in (0.0, 30.0, 60.0)
    ]
    parts += [draw.line(x0 - radius, y0, x0 + radius, y0, "grid"), draw.line(x0, y0 - radius, x0, y0 + radius, "grid")]
    rings = [(x0 + 2.0, y0 - radius * (90.0 - elevation) / 90.0 - 2.0, f"{elevation:g}°") for elevation in (30.0, 60.0)]
    parts += [draw.text(x, y, words, css="small") for x, y, words in rings]
    parts += [
        draw.text(x0, y0 - radius - 9.0, "N 0°", anchor="middle"),
        draw.text(x0 + radius + 8.0, y0 + 4.0, "E 90°"),
        draw.text(x0, y0 + radius + 18.0, "S 180°", anchor="middle"),
        draw.text(x0 - radius - 8.0, y0 + 4.0, "W 270°", anchor="end"),
    ]
    tags: list[draw.Tag] = []
    marks: list[draw.Box] = []
    for axis in axes:
        x, y = place(axis.azimuth_deg, axis.elevation_deg)
        parts.append(draw.line(x0, y0, x, y, "body below" if axis.elevation_deg < -0.5 else "body"))
        tags.append(draw.Tag(x, y, axis.name, radius=2.0))
    stands: list[tuple[str, float, float, list[Label]]] = []
    for position in sorted(positions, key=lambda p: (p.signal, LABELS.index(p.label))):
        sat = position.signal.split()[0]
        x, y = place(position.azimuth_deg, position.elevation_deg)
        same = next((d for d in stands if d[0] == sat and math.hypot(d[1] - x, d[2] - y) < 12.0), None)
        if same is None:
            stands.append((sat, x, y, [position.label]))
        elif position.label not in same[3]:
            same[3].append(position.label)
    for sat, x, y, labels in stands:
        wide = 11.0 * (len(labels) - 1)
        for index, label in enumerate(sorted(labels, key=LABELS.index)):
            parts.append(draw.symbol(x - wide / 2.0 + 11.0 * index, y, label))
        tags.append(draw.Tag(x, y, sat, radius=7.0))
        marks.append((x - wide / 2.0 - 6.0, y - 7.0, x + wide / 2.0 + 6.0, y + 7.0))
    for source in sources:
        x, y = place(source.azimuth_deg, source.elevation_deg)
        parts.append(Markup('<path class="cross" d="M{:.1f} {:.1f}l10 10m0 -10l-10 10"/>').format(x - 5.0, y - 5.0))
        tags.append(draw.Tag(x, y, source.name))
    rim = [
        (x0 - 16.0, 4.0, x0 + 16.0, 20.0),
        (x0 - 22.0, y0 + radius + 8.0, x0 + 22.0, y0 + radius + 20.0),
        (x0 + radius + 4.0, y0 - 7.0, 360.0, y0 + 7.0),
        (0.0, y0 - 7.0, x0 - radius - 4.0, y0 + 7.0),
    ]
    rim += [(x, y - 9.0, x + 18.0, y + 1.0) for x, y, _ in rings]
    parts += draw.place_tags(tags, [*rim, *marks], (2.0, 2.0, draw.WIDTH - 2.0, 296.0))
    return draw.svg(298.0, title, parts)


def extent_m(tracks: Sequence[FixTrack]) -> float:
    """Return the larger side of the box around all fixes, metres; 0 without fixes."""
    points: list[Reals] = [track.points() for track in tracks if len(track.points())]
    return float(np.ptp(np.concatenate(points), axis=0).max()) if points else 0.0
