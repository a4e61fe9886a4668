"""Records to SVG: the map, the time line, the sky and the scale of evidence, drawn by hand for one offline page."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from skyproof.records import Reals, freeze
from skyproof.report import drawing as draw
from skyproof.verdict import Label

__all__ = [
    "LABELS", "FixTrack", "Kind", "SignalSeries", "SkyPosition", "SkySource", "evidence_scale", "extent_m", "local_map",
    "sky_plot", "time_line",
]  # fmt: skip

Kind = Literal["trusted", "false", "unprotected", "possible"]
"""What a position comes from; possible: from a consistent sky of which it is open whether it is the true one."""

KINDS: tuple[Kind, ...] = ("trusted", "false", "possible", "unprotected")  # in the order of their weight

LABELS: tuple[Label, ...] = ("authentic", "spoofed", "multipath", "unknown")
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
        """The fixes that there are, shape (n, 2): east and north, metres."""
        points = np.column_stack((self.east_m, self.north_m))
        return points[np.isfinite(points).all(axis=1)]


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


# The map


def _ellipse(track: FixTrack, east: draw.Scale, north: draw.Scale) -> Markup:
    points = track.points()
    if track.covariance_m2 is None or not len(points) or not np.isfinite(track.covariance_m2).all():
        return Markup("")
    variance, axes = np.linalg.eigh(track.covariance_m2)
    radii = ELLIPSE_95 * np.sqrt(np.maximum(variance, 0.0))
    angle = np.linspace(0.0, 2.0 * np.pi, 49)
    ring = points[-1] + (np.stack((np.cos(angle), np.sin(angle)), axis=-1) * radii) @ axes.T
    return draw.path(east.pixels(ring[:, 0]), north.pixels(ring[:, 1]), f"ellipse {track.kind}")


def _mark(x: float, y: float, kind: Kind) -> Markup:
    """One shape a kind, so that colour is not needed: disc, diamond, triangle, ring."""
    if kind == "trusted":
        return draw.circle(x, y, 4.5, "mark trusted")
    if kind == "false":
        return Markup('<path class="mark false" d="M{:.1f} {:.1f}l6 6l-6 6l-6 -6z"/>').format(x, y - 6.0)
    if kind == "possible":
        return Markup('<path class="mark possible" d="M{:.1f} {:.1f}l5.5 9.5h-11z"/>').format(x, y - 6.0)
    return draw.circle(x, y, 8.5, "ring unprotected")


def local_map(tracks: Sequence[FixTrack], *, title: str, least_m: float = 10.0, names: bool = True) -> Markup:
    """A map of fixes in metres east and north: last fix of each track marked, the track behind it, 95 % ellipses.

    Tracks without any fix are left out; without any track at all the result is empty.
    """
    tracks = [track for track in tracks if len(track.points())]
    if not tracks:
        return Markup("")
    left, right, top, bottom = 50.0, 350.0, 10.0, 310.0
    ellipse_points = [track.points()[-1] + sign * ELLIPSE_95 * np.sqrt(np.diag(track.covariance_m2))
                      for track in tracks if track.covariance_m2 is not None for sign in (-1.0, 1.0)]  # fmt: skip
    points = np.concatenate([track.points() for track in tracks] + [np.array(ellipse_points).reshape(-1, 2)])
    points = points[np.isfinite(points).all(axis=1)]
    west_m, south_m, east_m, north_m = draw.extent(points, least_m, (bottom - top) / (right - left))
    east, north = draw.Scale(west_m, east_m, left, right), draw.Scale(south_m, north_m, bottom, top)

    parts = list(draw.grid(east, north, ("east, m", "north, m")))
    marks: list[Mark] = []
    for track in sorted(tracks, key=lambda track: -KINDS.index(track.kind)):
        fixes = track.points()
        kept = fixes[np.unique(np.linspace(0, len(fixes) - 1, 150).astype(int))]
        parts.append(draw.path(east.pixels(kept[:, 0]), north.pixels(kept[:, 1]), f"track {track.kind}"))
        parts.append(_ellipse(track, east, north))
        marks.append((east(float(fixes[-1, 0])), north(float(fixes[-1, 1])), track.kind, track.receiver))
    parts += [_mark(x, y, kind) for x, y, kind, _ in marks]
    return draw.svg(348.0, title, [*parts, *(_names(marks, (left + right) / 2.0, top, bottom) if names else [])])


Mark = tuple[float, float, Kind, str]
"""x, y, kind and receiver."""


def _names(marks: Sequence[Mark], middle: float, top: float, bottom: float) -> list[Markup]:
    """A label beside each place that is marked, towards the middle of the map: kinds, then receivers."""
    parts: list[Markup] = []
    for left_of_mark in (False, True):
        labels = [label for place in _places(marks) if (place[0][0] > middle) == left_of_mark for label in _said(place)]
        heights = draw.spread([y + 4.0 for _, y, _, _ in labels], 14.0, top + 12.0, bottom - 4.0)
        for (x, _, kind, text), height in zip(labels, heights, strict=True):
            sign = -1.0 if left_of_mark else 1.0
            near = [mark for mark in marks if abs(mark[1] + 4.0 - height) < 14.0 and abs(mark[0] - x) < 60.0]
            beside = sign * (max([sign * x, *(sign * mark[0] for mark in near)]) + 14.0)
            parts.append(draw.text(beside, height, text, anchor="end" if left_of_mark else "start",
                                   css=f"name {kind}"))  # fmt: skip
    return parts


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


def _said(place: Sequence[Mark]) -> list[tuple[float, float, Kind, str]]:
    """The labels of one place: x, y, kind that gives the colour, text; kinds of the same receivers share a label."""
    receivers: dict[Kind, list[str]] = {}
    for _, _, kind, receiver in place:
        receivers.setdefault(kind, []).append(receiver)
    kinds: dict[tuple[str, ...], list[Kind]] = {}
    for kind in KINDS:
        if kind in receivers:
            kinds.setdefault(tuple(receivers[kind]), []).append(kind)
    x, y = place[0][:2]
    return [(x, y, same[0], f"{', '.join(same)}: {', '.join(names)}") for names, same in kinds.items()]


# The time line


def _row_range(series: Sequence[SignalSeries]) -> tuple[float, float]:
    """Bounds of C/N0 in dB-Hz that hold all values and have a round middle."""
    values = np.concatenate([s.cn0_dbhz[np.isfinite(s.cn0_dbhz)] for s in series])
    if not values.size:
        return 30.0, 50.0
    low = 5.0 * math.floor(values.min() / 5.0)
    return low, low + 10.0 * max(math.ceil((values.max() - low) / 10.0), 1)


def time_line(
    series: Sequence[SignalSeries], *, title: str, zero: str, onset_s: float | None = None, points: int = 240
) -> Markup:
    """C/N0 of every signal over time, a row for each satellite, coloured by label, with the onset marked.

    zero : what second zero is, in words, for the axis. points : the most that are drawn of one signal.
    """
    series = [s for s in series if s.seconds.size]
    if not series:
        return Markup("")
    rows = sorted({s.signal.split()[0] for s in series})
    left, right, top, height = 34.0, 324.0, 24.0, 24.0
    bottom = top + height * len(rows)
    start_s, end_s = min(float(s.seconds[0]) for s in series), max(float(s.seconds[-1]) for s in series)
    unit, scale = draw.time_unit(end_s - start_s)
    time = draw.Scale(start_s, max(end_s, start_s + 1e-3), left, right)
    low, high = _row_range(series)

    parts: list[Markup] = []
    for tick in draw.nice_ticks(time.low / scale, time.high / scale):
        parts += [draw.line(time(tick * scale), top, time(tick * scale), bottom, "grid"),
                  draw.text(time(tick * scale), bottom + 15.0, draw.number(tick), anchor="middle")]  # fmt: skip
    parts += [draw.text((left + right) / 2.0, bottom + 32.0, f"time since {zero}, {unit}", anchor="middle", css="axis"),
              draw.text(draw.WIDTH - 3.0, (top + bottom) / 2.0, f"C/N₀, each row {low:g} to {high:g} dB-Hz",
                        anchor="middle", css="axis", turn=True)]  # fmt: skip
    for index, sat in enumerate(rows):
        row = draw.Scale(low, high, top + height * (index + 1) - 2.0, top + height * index + 2.0)
        middle = (low + high) / 2.0
        parts += [draw.line(left, top + height * index, right, top + height * index, "frame"),
                  draw.line(left, row(middle), right, row(middle), "grid"),
                  draw.text(left - 4.0, row(middle) + 4.0, sat, anchor="end"),
                  draw.text(right + 3.0, row(middle) + 3.0, f"{middle:g}", css="small")]  # fmt: skip
        for one in (s for s in series if s.signal.split()[0] == sat):
            seconds, cn0_dbhz = draw.thin(one.seconds, one.cn0_dbhz, points)
            parts.append(draw.path(time.pixels(seconds), row.pixels(cn0_dbhz), f"series {one.label}"))
    parts.append(draw.line(left, bottom, right, bottom, "frame"))
    if onset_s is not None and time.low <= onset_s <= time.high:
        x = time(onset_s)
        parts += [draw.line(x, top - 4.0, x, bottom, "onset"),
                  draw.text(min(max(x, left + 20.0), right - 20.0), top - 8.0, "onset", anchor="middle",
                        css="name false")]  # fmt: skip
    return draw.svg(bottom + 38.0, title, parts)


# The sky


def sky_plot(
    positions: Sequence[SkyPosition], sources: Sequence[SkySource] = (), axes: Sequence[SkySource] = (), *, title: str
) -> Markup:
    """Satellites by azimuth and elevation, north up, east right, each a disc in the colours of its signals' labels.

    sources : marked by crosses. axes : of a body, lines from the zenith to where they point, dashed below the horizon.
    """
    if not positions:
        return Markup("")
    x0, y0, radius = draw.WIDTH / 2.0, 150.0, 124.0

    def place(azimuth_deg: float, elevation_deg: float) -> tuple[float, float]:
        out = radius * (90.0 - max(elevation_deg, 0.0)) / 90.0
        return x0 + out * math.sin(math.radians(azimuth_deg)), y0 - out * math.cos(math.radians(azimuth_deg))

    parts = [draw.circle(x0, y0, radius * (90.0 - elevation) / 90.0, "frame" if elevation == 0.0 else "grid")
             for elevation in (0.0, 30.0, 60.0)]  # fmt: skip
    parts += [draw.line(x0 - radius, y0, x0 + radius, y0, "grid"),
              draw.line(x0, y0 - radius, x0, y0 + radius, "grid")]  # fmt: skip
    rings = [(x0 + 2.0, y0 - radius * (90.0 - elevation) / 90.0 - 2.0, f"{elevation:g}°") for elevation in (30.0, 60.0)]
    parts += [draw.text(x, y, words, css="small") for x, y, words in rings]
    parts += [draw.text(x0, y0 - radius - 9.0, "N 0°", anchor="middle"),
              draw.text(x0 + radius + 8.0, y0 + 4.0, "E 90°"),
              draw.text(x0, y0 + radius + 18.0, "S 180°", anchor="middle"),
              draw.text(x0 - radius - 8.0, y0 + 4.0, "W 270°", anchor="end")]  # fmt: skip
    tags: list[draw.Tag] = []
    for axis in axes:
        x, y = place(axis.azimuth_deg, axis.elevation_deg)
        parts.append(draw.line(x0, y0, x, y, "body below" if axis.elevation_deg < -0.5 else "body"))
        tags.append(draw.Tag(x, y, axis.name, radius=2.0))
    discs: list[tuple[str, float, float, list[Label]]] = []
    for position in sorted(positions, key=lambda p: (p.signal, LABELS.index(p.label))):
        sat = position.signal.split()[0]
        x, y = place(position.azimuth_deg, position.elevation_deg)
        same = next((d for d in discs if d[0] == sat and math.hypot(d[1] - x, d[2] - y) < 12.0), None)
        if same is None:
            discs.append((sat, x, y, [position.label]))
        elif position.label not in same[3]:
            same[3].append(position.label)
    for sat, x, y, labels in discs:
        parts += draw.disc(x, y, 7.0, sorted(labels, key=LABELS.index))
        tags.append(draw.Tag(x, y, sat))
    for source in sources:
        x, y = place(source.azimuth_deg, source.elevation_deg)
        parts.append(Markup('<path class="cross" d="M{:.1f} {:.1f}l10 10m0 -10l-10 10"/>').format(x - 5.0, y - 5.0))
        tags.append(draw.Tag(x, y, source.name))
    rim = [(x0 - 16.0, 4.0, x0 + 16.0, 20.0), (x0 - 22.0, y0 + radius + 8.0, x0 + 22.0, y0 + radius + 20.0),
           (x0 + radius + 4.0, y0 - 7.0, 360.0, y0 + 7.0), (0.0, y0 - 7.0, x0 - radius - 4.0, y0 + 7.0)]
    rim += [(x, y - 9.0, x + 18.0, y + 1.0) for x, y, _ in rings]
    parts += draw.place_tags(tags, rim, (2.0, 2.0, draw.WIDTH - 2.0, 296.0))
    return draw.svg(298.0, title, parts)


# The evidence


def evidence_scale(statistic: float, threshold: float, *, title: str) -> Markup:
    """A statistic on a logarithmic scale of multiples of its threshold; empty if there is no such multiple."""
    if not (statistic > 0.0 and threshold > 0.0):
        return Markup("")
    left, right, y, least, most = 20.0, 340.0, 22.0, 0.01, 100.0
    scale = draw.Scale(math.log10(least), math.log10(most), left, right)
    ratio = statistic / threshold
    x = scale(math.log10(min(max(ratio, least), most)))
    parts = [draw.line(left, y, right, y, "frame"), draw.line(scale(0.0), y - 10.0, scale(0.0), y + 6.0, "limit"),
             draw.text(scale(0.0), y - 13.0, "threshold", anchor="middle", css="small")]  # fmt: skip
    for tick in (0.01, 0.1, 1.0, 10.0, 100.0):
        edge = "≤ " if tick == least else "≥ " if tick == most else ""
        at = scale(math.log10(tick))
        parts += [draw.line(at, y - 3.0, at, y + 3.0, "frame"),
                  draw.text(at, y + 18.0, f"{edge}{tick:g}", anchor="middle", css="small")]  # fmt: skip
    parts.append(draw.circle(x, y, 5.0, "mark statistic"))
    parts.append(draw.text((left + right) / 2.0, y + 33.0, "statistic divided by threshold (no unit)", anchor="middle",
                           css="small axis"))  # fmt: skip
    return draw.svg(60.0, title, parts)


def extent_m(tracks: Sequence[FixTrack]) -> float:
    """The larger side of the box around all fixes, metres; 0 without fixes."""
    points: list[NDArray[np.float64]] = [track.points() for track in tracks if len(track.points())]
    return float(np.ptp(np.concatenate(points), axis=0).max()) if points else 0.0
