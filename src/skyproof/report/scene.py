"""A simulated scene to one offline page: the map, antennas, the sky, levels, false codes, and what is switched when."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

import numpy as np
from markupsafe import Markup

from skyproof.arrays import Reals
from skyproof.records import LABELS, freeze
from skyproof.report import drawing as draw
from skyproof.report.pictures import SignalSeries, SkyPosition, SkySource, draw_time_line, plot_sky
from skyproof.report.template import Figure, load_environment

__all__ = [
    "Element",
    "GroundTrack",
    "PlotLine",
    "Role",
    "ScenePage",
    "SceneSky",
    "Setting",
    "SettingGroup",
    "Switching",
    "draw_scene_map",
    "plot_array",
    "plot_lines",
    "plot_switching",
    "write_scene_html",
]

Role = Literal["receiver", "shows", "transmits", "receives", "disturbs"]
"""What stands at a place: a receiver; where an attack puts whoever believes it; its antennas; other transmitters."""

ROLES: dict[Role, str] = {
    "receiver": "receiver, with the way it went",
    "shows": "place that an attack shows",
    "transmits": "antenna that transmits false signals",
    "receives": "receive antenna of a meaconer",
    "disturbs": "transmitter of interference",
}
MOST_POINTS = 14_000  # of all time lines together: keeps the page small, whatever the number of receivers
STANDS_M = 0.5  # what moves less stands still
CLOSE = 0.35  # what takes less of the map than this is drawn anew, larger


@dataclass(frozen=True, eq=False, kw_only=True)
class GroundTrack:
    """Where something is over the scene, in the local level plane.

    east_m, north_m : (n,) in order of time; one point stands still.
    """

    name: str
    role: Role
    east_m: Reals
    north_m: Reals

    def __post_init__(self) -> None:
        freeze(self, {"east_m": ("epoch",), "north_m": ("epoch",)})

    @property
    def points(self) -> Reals:
        """Return east and north, (n, 2), metres."""
        return np.column_stack((self.east_m, self.north_m))


@dataclass(frozen=True, kw_only=True)
class Element:
    """An antenna of a receiver in the body's plane. radius_m : of the circle that it runs, from start_deg on
    (clockwise from forward); turns : whether clockwise seen from above."""

    name: str
    forward_m: float
    right_m: float
    down_m: float = 0.0
    radius_m: float = 0.0
    start_deg: float = 0.0
    clockwise: bool = True


@dataclass(frozen=True, kw_only=True)
class SceneSky:
    """The sky of one receiver. sources : directions of transmitters; axes : of the receiver's body."""

    receiver: str
    positions: tuple[SkyPosition, ...]
    sources: tuple[SkySource, ...] = ()
    axes: tuple[SkySource, ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class PlotLine:
    """One line of a plot over time. seconds, values : (n,), NaN where there is nothing."""

    name: str
    kind: Literal["authentic", "spoofed", "multipath"]  # that gives colour and dashes
    seconds: Reals
    values: Reals

    def __post_init__(self) -> None:
        freeze(self, {"seconds": ("epoch",), "values": ("epoch",)})


@dataclass(frozen=True, eq=False, kw_only=True)
class Switching:
    """When a transmitter is on, and how strong. seconds, power_db : (n,), NaN where it is off."""

    name: str
    what: str
    role: Literal["transmits", "disturbs"]
    seconds: Reals
    power_db: Reals

    def __post_init__(self) -> None:
        freeze(self, {"seconds": ("epoch",), "power_db": ("epoch",)})


@dataclass(frozen=True)
class Setting:
    """One line of the scenario."""

    name: str
    value: str
    unit: str = ""


@dataclass(frozen=True)
class SettingGroup:
    """The settings of one thing."""

    heading: str
    settings: tuple[Setting, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class ScenePage:
    """What the page shows. Whatever is left empty is left out.

    facts, events : sentences on the scene, and on what happens in it. zero : what second zero is, in words.
    origin : the point about which the map gives east and north, in words.
    displacements : from where a receiver is to what an attack shows, by heading.
    levels : of every receiver; offsets, disturbance, reflections : lines for each receiver that has any.
    """

    name: str
    description: str
    facts: tuple[str, ...]
    events: tuple[str, ...]
    zero: str
    origin: str
    ways: tuple[GroundTrack, ...]
    displacements: tuple[tuple[str, tuple[PlotLine, ...]], ...] = ()
    arrays: tuple[tuple[str, tuple[Element, ...]], ...] = ()
    skies: tuple[SceneSky, ...] = ()
    levels: tuple[SignalSeries, ...] = ()
    level_note: str = ""
    onset_s: float | None = None
    offsets: tuple[tuple[str, tuple[PlotLine, ...]], ...] = ()
    disturbance: tuple[tuple[str, tuple[PlotLine, ...]], ...] = ()
    reflections: tuple[tuple[str, tuple[PlotLine, ...]], ...] = ()
    switching: tuple[Switching, ...] = ()
    span_s: tuple[float, float] = (0.0, 1.0)
    settings: tuple[SettingGroup, ...] = ()
    made_by: str = ""


def write_scene_html(page: ScenePage) -> str:
    """Write the whole page. The same scene gives the same bytes."""
    present: list[Role] = [role for role in ROLES if any(way.role == role for way in page.ways)]
    return (
        load_environment()
        .get_template("scene.html.j2")
        .render(
            page=page,
            places=_draw_maps(page) + _displacements(page) + _arrays(page),
            keys=[(_key(role), ROLES[role]) for role in present],
            labels=[label for label in LABELS if any(s.label == label for s in page.levels)],
            switching=_switching(page),
            signals=_draw_signals(page),
        )
    )


# The map


def draw_scene_map(ways: Sequence[GroundTrack], *, title: str, least_m: float = 10.0) -> Markup:
    """Draw paths in metres east and north with equal scales, each end marked by its role's shape."""
    if not ways:
        return Markup("")
    left_x, right_x, top, bottom = 60.0, 350.0, 10.0, 300.0
    bounds_m = draw.extent(np.concatenate([way.points for way in ways]), least_m, (bottom - top) / (right_x - left_x))
    across = draw.Scale(bounds_m[0], bounds_m[2], left_x, right_x)
    up = draw.Scale(bounds_m[1], bounds_m[3], bottom, top)
    unit, size = ("m", 1.0) if bounds_m[2] - bounds_m[0] < 2e4 else ("km", 1e3)
    parts = list(draw.grid(across, up, (f"east, {unit}", f"north, {unit}"), (size, size)))
    ordered = sorted(ways, key=lambda way: -list(ROLES).index(way.role))
    ends: list[tuple[float, float, GroundTrack]] = []
    begins: list[tuple[float, float]] = []
    for way in ordered:
        x, y = across.pixels(way.east_m), up.pixels(way.north_m)
        parts.append(draw.path(x, y, f"way {way.role}"))
        ends.append((float(x[-1]), float(y[-1]), way))
        if np.hypot(x[0] - x[-1], y[0] - y[-1]) > 12.0:
            begins.append((float(x[0]), float(y[0])))
            parts.append(draw.circle(*begins[-1], 3.0, f"start {way.role}"))
    parts += [_draw_mark(x, y, way.role) for x, y, way in ends]
    along = [
        (float(x) - 2.0, float(y) - 2.0, float(x) + 2.0, float(y) + 2.0)
        for way in ordered
        for x, y in zip(across.pixels(way.east_m[::6]), up.pixels(way.north_m[::6]), strict=True)
    ]
    tags = [draw.Tag(x, y, words, f"name {role}", 8.0) for x, y, role, words in _label_ends(ends)]
    return draw.svg(
        338.0, title, [*parts, *draw.place_tags(tags, along, (left_x + 2, top + 2, right_x - 2, bottom - 2))]
    )


def _draw_mark(x: float, y: float, role: Role) -> Markup:
    """Draw one shape per role, so that colour is not needed."""
    if role == "receiver":
        return draw.circle(x, y, 4.5, "mark receiver")
    shapes: dict[Role, str] = {
        "shows": "M{:.1f} {:.1f}m0 -8l8 8l-8 8l-8 -8z",
        "transmits": "M{:.1f} {:.1f}m0 -6l5.5 9.5h-11z",
        "receives": "M{:.1f} {:.1f}m0 6l5.5 -9.5h-11z",
        "disturbs": "M{:.1f} {:.1f}m-5 -5l10 10m0 -10l-10 10",
    }
    return Markup('<path class="mark {}" d="{}"/>').format(role, shapes[role].format(x, y))


def _label_ends(ends: Sequence[tuple[float, float, GroundTrack]]) -> list[tuple[float, float, Role, str]]:
    """Label marks of a role that nearly coincide once: x, y, role, words."""
    groups: list[tuple[float, float, Role, list[str]]] = []
    for x, y, way in ends:
        near = next((g for g in groups if g[2] == way.role and np.hypot(g[0] - x, g[1] - y) < 10.0), None)
        if near is None:
            groups.append((x, y, way.role, [way.name]))
        elif way.name not in near[3]:
            near[3].append(way.name)
    return [(x, y, role, _name_role(role, names)) for x, y, role, names in groups]


def _name_role(role: Role, names: Sequence[str]) -> str:
    who = ", ".join(names)
    if len(who) > 24:
        who = f"{len(names)} {'receivers' if role == 'receiver' else 'transmitters'}"
    if role in ("receiver", "disturbs"):
        return who
    return f"{who} {role if len(names) == 1 else role.removesuffix('s')}"


def _key(role: Role) -> Markup:
    return Markup('<svg class="mark-key" viewBox="0 0 16 16" aria-hidden="true">{}</svg>').format(
        _draw_mark(8.0, 8.0, role)
    )


def _size_m(ways: Sequence[GroundTrack]) -> float:
    return float(np.ptp(np.concatenate([way.points for way in ways]), axis=0).max())


def _draw_maps(page: ScenePage) -> list[Figure]:
    """Draw the whole map, then the receivers and what is near them, where they are too small on it."""
    if not page.ways:
        return []
    caption = f"Metres east and north of {page.origin}. Marks stand where each is at the end, rings where it began."
    figures = [Figure("Map", draw_scene_map(page.ways, title=f"Map of {page.name}"), caption)]
    receivers = [way for way in page.ways if way.role == "receiver"]
    size_m, all_m = _size_m(receivers), _size_m(page.ways)
    reach_m = max(size_m, 0.02 * all_m, 5.0)
    middle = np.concatenate([way.points for way in receivers]).mean(axis=0)
    near = [way for way in page.ways if way in receivers or np.abs(way.points - middle).max() < 2.0 * reach_m]
    if STANDS_M < _size_m(near) < 0.6 * all_m and size_m < CLOSE * all_m:
        close = draw_scene_map(near, title=f"The surroundings of the receivers of {page.name}", least_m=4.0)
        figures.append(Figure("Close up", close, "The surroundings of the receivers, on the axes of the map."))
    return figures


def _displacements(page: ScenePage) -> list[Figure]:
    return [
        Figure(
            heading,
            plot_lines(
                lines, title=f"{heading} over time", zero=page.zero, quantity="away from the true place", metres=True
            ),
            "East, north and up, from where the receiver’s first antenna is to the place shown.",
        )
        for heading, lines in page.displacements
    ]


# Antennas


def plot_array(elements: Sequence[Element], *, title: str) -> Markup:
    """Plot antennas in the body's plane from above: forward up, right to the right, metres."""
    if not elements:
        return Markup("")
    left_x, right_x, top, bottom = 56.0, 326.0, 10.0, 280.0
    corners = [(e.right_m + sign * e.radius_m, e.forward_m + sign * e.radius_m) for e in elements for sign in (-1, 1)]
    bounds_m = draw.extent(np.array([(0.0, 0.0), *corners]), 0.05, (bottom - top) / (right_x - left_x))
    across = draw.Scale(bounds_m[0], bounds_m[2], left_x, right_x)
    up = draw.Scale(bounds_m[1], bounds_m[3], bottom, top)
    unit, size = ("m", 1.0) if bounds_m[2] - bounds_m[0] > 1.5 else ("cm", 0.01)
    parts = list(draw.grid(across, up, (f"right, {unit}", f"forward, {unit}"), (size, size)))
    x0, y0 = across(0.0), up(0.0)
    parts.append(Markup('<path class="body" d="M{:.1f} {:.1f}m-6 0h12m-6 -6v12"/>').format(x0, y0))
    tags = []
    for e in elements:
        x, y = across(e.right_m), up(e.forward_m)
        if e.radius_m:
            start = np.radians(e.start_deg)
            parts.append(draw.circle(x, y, across(e.right_m + e.radius_m) - x, "way receiver"))
            x += (across(e.radius_m) - across(0.0)) * float(np.sin(start))
            y -= (across(e.radius_m) - across(0.0)) * float(np.cos(start))
            parts.append(draw.line(across(e.right_m), up(e.forward_m), x, y, "body"))
        parts.append(draw.circle(x, y, 4.5, "mark receiver"))
        level = f" ({abs(e.down_m) / size:.4g} {unit} {'down' if e.down_m > 0.0 else 'up'})" if e.down_m else ""
        tags.append(draw.Tag(x, y, f"{e.name}{level}", "name receiver"))
    taken = [(x0 - 6.0, y0 - 6.0, x0 + 6.0, y0 + 6.0)]
    return draw.svg(
        318.0, title, [*parts, *draw.place_tags(tags, taken, (left_x + 2, top + 2, right_x - 2, bottom - 2))]
    )


def _arrays(page: ScenePage) -> list[Figure]:
    figures = []
    for receiver, elements in page.arrays:
        caption = "Seen from above, in axes of the body; cross: the place that the map shows."
        for e in elements:
            if e.radius_m:
                sense = "clockwise" if e.clockwise else "counterclockwise"
                caption += f" {e.name} circles {sense}; drawn where it begins."
        picture = plot_array(elements, title=f"Antennas of {receiver}")
        figures.append(Figure(f"Antennas of {receiver}", picture, caption))
    return figures


# Over time


def plot_lines(lines: Sequence[PlotLine], *, title: str, zero: str, quantity: str, metres: bool = False) -> Markup:
    """Plot lines over time, each named at its end. metres : values are metres and may be written as kilometres."""
    lines = [plot_line for plot_line in lines if np.isfinite(plot_line.values).any()]
    if not lines:
        return Markup("")
    left_x, top, bottom = 64.0, 12.0, 262.0
    right_x = min(306.0, draw.WIDTH - 14.0 - 7.0 * max(len(plot_line.name) for plot_line in lines))
    first_s, last_s = (
        min(float(plot_line.seconds[0]) for plot_line in lines),
        max(float(plot_line.seconds[-1]) for plot_line in lines),
    )
    unit, scale = draw.time_unit(last_s - first_s)
    low, high = _bound_axis(np.concatenate([plot_line.values for plot_line in lines]))
    kilo = metres and max(abs(low), abs(high)) >= 2e4
    across = draw.Scale(first_s, max(last_s, first_s + 1e-3), left_x, right_x)
    up = draw.Scale(low, high, bottom, top)
    written = f"{quantity}, {'km' if kilo else 'm'}" if metres else quantity
    parts = list(draw.grid(across, up, (f"time since {zero}, {unit}", written), (scale, 1e3 if kilo else 1.0)))
    ends, early = [], []
    for plot_line in lines:
        parts.append(
            draw.path(across.pixels(plot_line.seconds), up.pixels(plot_line.values), f"series {plot_line.kind}")
        )
        last = int(np.flatnonzero(np.isfinite(plot_line.values))[-1])
        x, y = across(float(plot_line.seconds[last])), up(float(plot_line.values[last]))
        if x > right_x - 20.0:
            ends.append((x, y, plot_line))
        else:
            early.append(draw.Tag(x, y, plot_line.name, f"small name {plot_line.kind}", 2.0))
    parts += draw.place_tags(early, (), (left_x + 2.0, top + 2.0, right_x - 2.0, bottom - 2.0))
    heights = draw.spread([y for _, y, _ in ends], 12.0, top + 4.0, max(bottom, top + 12.0 * len(ends)))
    for (x, y, plot_line), height in zip(ends, heights, strict=True):
        parts += [
            draw.line(x + 1.0, y, right_x + 9.0, height, "leader"),
            draw.text(right_x + 11.0, height + 4.0, plot_line.name, css=f"small name {plot_line.kind}"),
        ]
    return draw.svg(max(300.0, 12.0 * len(ends) + 24.0), title, parts)


def _bound_axis(values: Reals) -> tuple[float, float]:
    """Bound an axis a little beyond the values; a constant stands in the middle of one unit."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    room = max(0.06 * (high - low), 0.5 if high - low < 1.0 else 0.0)
    return low - room, high + room


def plot_switching(rows: Sequence[Switching], span_s: tuple[float, float], *, title: str, zero: str) -> Markup:
    """Plot a row for each transmitter, filled while it is on, with its least and most power."""
    if not rows:
        return Markup("")
    left_x, right_x, top, height, band = 12.0, 348.0, 4.0, 44.0, 18.0
    bottom = top + height * len(rows)
    unit, scale = draw.time_unit(span_s[1] - span_s[0])
    across = draw.Scale(*span_s, left_x, right_x)
    parts = draw.columns(across, top, bottom, unit=scale, below=15.0)
    for index, row in enumerate(rows):
        base = top + height * (index + 1) - 5.0
        on = np.isfinite(row.power_db)
        power_db = row.power_db[on]
        if not power_db.size:
            continue
        low, high = float(power_db.min()), float(power_db.max())
        up = draw.Scale(low, max(high, low + 1e-6), base - (0.3 if high - low > 0.05 else 1.0) * band, base - band)
        parts.append(_fill(across.pixels(row.seconds), up.pixels(row.power_db), on, base, f"on {row.role}"))
        written = f"{_db(low)} dB" if high - low < 0.05 else f"{_db(low)} to {_db(high)} dB"
        parts += [
            draw.line(left_x, base, right_x, base, "frame"),
            draw.text(left_x, base - band - 6.0, row.name, css=f"name {row.role}"),
            draw.text(right_x, base - band - 6.0, f"{row.what}, {written}", anchor="end", css="small halo"),
        ]
    parts.append(
        draw.text((left_x + right_x) / 2.0, bottom + 32.0, f"time since {zero}, {unit}", anchor="middle", css="axis")
    )
    return draw.svg(bottom + 38.0, title, parts)


def _db(value: float) -> str:
    rounded = round(value, 1)
    return f"{rounded:+g}".replace("-", "\N{MINUS SIGN}") if rounded else "0"


def _fill(x: Reals, y: Reals, on: "np.ndarray[tuple[int, ...], np.dtype[np.bool_]]", base: float, css: str) -> Markup:
    """Fill areas between a line and its base where it is on."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]).astype(int)))
    steps = []
    for begin, end in edges.reshape(-1, 2):
        line = "".join(f"L{a:.1f} {b:.1f}" for a, b in zip(x[begin:end], y[begin:end], strict=True))
        steps.append(f"M{x[begin]:.1f} {base:.1f}{line}L{max(x[end - 1], x[begin] + 1.0):.1f} {base:.1f}z")
    return Markup('<path class="{}" d="{}"/>').format(css, "".join(steps))


def _switching(page: ScenePage) -> list[Figure]:
    picture = plot_switching(
        page.switching, page.span_s, title=f"Attacks and interference of {page.name} over time", zero=page.zero
    )
    if not picture:
        return []
    caption = (
        "Filled while a transmitter is on; height is power. The power of false signals is relative to the true signal "
        "of the same satellite, that of interference to the receiver's noise in its band. Both hold at the first "
        "receiver, at the distance at the start."
    )
    return [Figure("What is on when", picture, caption)]


def _draw_signals(page: ScenePage) -> list[Figure]:
    """Draw the figures of the signals, receiver by receiver."""
    names = list(dict.fromkeys(series.receiver for series in page.levels))
    return [figure for name in names for figure in (*_skies(page, name), _level(page, name), *_over_time(page, name))]


def _level(page: ScenePage, name: str) -> Figure:
    points = min(120, max(24, MOST_POINTS // len(page.levels)))
    return Figure(
        f"Signals of {name}",
        draw_time_line(
            [s for s in page.levels if s.receiver == name],
            zero=page.zero,
            onset_s=page.onset_s,
            title=f"Carrier to noise density of every signal at {name} over time",
            points=points,
        ),
        "One row per satellite, one line per signal: carrier to noise density. " + page.level_note,
    )


class _OverTime(NamedTuple):
    """A figure of each receiver: the field of the page that holds its lines, and its words."""

    lines: Literal["offsets", "disturbance", "reflections"]
    heading: str
    title: str
    quantity: str
    caption: str
    metres: bool = True


_OVER_TIME: Final = (
    _OverTime(
        "offsets",
        "False codes",
        "Code of false signals behind that of the true ones",
        "behind the true code",
        "By how much the code of each false signal is later than that of the true signal of the same satellite at the "
        "same antenna. What all have in common looks like an error of the clock; what differs moves the fix.",
    ),
    _OverTime(
        "disturbance",
        "Disturbance",
        "Power of noise and interference",
        "power over the receiver’s noise, dB",
        "Power of what is no signal, in the whole band sampled.",
        metres=False,
    ),
    _OverTime(
        "reflections",
        "Reflections",
        "Longer way of the reflections of true signals",
        "longer way",
        "By how much the way of each reflection is longer than that of the signal itself.",
    ),
)


def _over_time(page: ScenePage, name: str) -> Iterator[Figure]:
    for kind in _OVER_TIME:
        every: tuple[tuple[str, tuple[PlotLine, ...]], ...] = getattr(page, kind.lines)
        for lines in (receiver_lines for receiver, receiver_lines in every if receiver == name):
            title = f"{kind.title} at {name} over time"
            plot = plot_lines(lines, title=title, zero=page.zero, quantity=kind.quantity, metres=kind.metres)
            yield Figure(f"{kind.heading} at {name}", plot, kind.caption)


def _skies(page: ScenePage, name: str) -> list[Figure]:
    figures = []
    for sky in page.skies:
        if sky.receiver != name:
            continue
        caption = "Half-way through the scene; zenith in the middle, rings of elevation every 30°."
        if any(position.label == "spoofed" for position in sky.positions):
            caption += " A disc and a diamond are a satellite that is imitated; a diamond alone, one that is not "
            caption += "received itself."
        if sky.sources:
            caption += " Cross: direction of a transmitter, on the rim if it stands lower than the horizon."
        if sky.axes:
            caption += " Lines: axes of the receiver’s body, dotted where they point below the horizon."
        picture = plot_sky(sky.positions, sky.sources, sky.axes, title=f"Sky over {sky.receiver}")
        figures.append(Figure(f"Sky over {sky.receiver}", picture, caption))
    return figures
