"""The pieces that pictures are drawn from: scales, ticks, lines, text, discs, and labels that keep out of each other.

Pictures are SVG, drawn by hand, 360 units wide, so that they can be read on a telephone; colours, fonts and the dark
and printed looks come from the page's style sheet through the classes set here. Same input, same characters. Text is
escaped.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from skyproof.arrays import Reals
from skyproof.verdict import Label

__all__ = [
    "WIDTH",
    "Box",
    "Scale",
    "Tag",
    "circle",
    "columns",
    "extent",
    "grid",
    "line",
    "log_grid",
    "nice_ticks",
    "number",
    "path",
    "place_tags",
    "rect",
    "scale_bar",
    "spread",
    "svg",
    "symbol",
    "text",
    "thin",
    "time_unit",
]

WIDTH = 360.0


@dataclass(frozen=True)
class Scale:
    """A straight axis: values `low` to `high` onto pixels `start` to `end`."""

    low: float
    high: float
    start: float
    end: float

    def __call__(self, value: float) -> float:
        return self.start + (value - self.low) / (self.high - self.low) * (self.end - self.start)

    def pixels(self, values: Reals) -> Reals:
        """Convert an array of values, any shape, to pixels."""
        return self.start + (values - self.low) / (self.high - self.low) * (self.end - self.start)


# Numbers


def nice_ticks(low: float, high: float, wanted: int = 5) -> list[float]:
    """Return about `wanted` multiples of 1, 2 or 5 times a power of ten within [low, high].

    Raises ValueError if the range is empty or not finite.
    """
    span = high - low
    if not (math.isfinite(span) and span > 0.0):
        raise ValueError(f"no ticks between {low} and {high}")
    power = 10.0 ** math.floor(math.log10(span / wanted))
    step = next(power * factor for factor in (1.0, 2.0, 5.0, 10.0) if span / (power * factor) <= wanted)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [index * step for index in range(first, last + 1)]


def thin(seconds: Reals, values: Reals, limit: int) -> tuple[Reals, Reals]:
    """Thin to at most `limit` points (n,) by means over blocks of equal length; an empty block stays NaN."""
    size = -(-seconds.size // limit)
    if size <= 1:
        return seconds, values
    blocks = -(-seconds.size // size)
    padded = np.full((2, blocks * size), np.nan)
    padded[:, : seconds.size] = seconds, values
    finite = np.isfinite(padded).reshape(2, blocks, size)
    sums = np.where(finite, padded.reshape(2, blocks, size), 0.0).sum(axis=-1)
    counts = finite.sum(axis=-1)
    means = np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)
    return means[0], means[1]


def number(value: float) -> str:
    """Write a number as short as possible, with a real minus sign."""
    return f"{value:.10g}".replace("-", "\N{MINUS SIGN}") if value else "0"


def time_unit(span_s: float) -> tuple[str, float]:
    """Choose the unit that suits a span, and return its seconds."""
    return ("s", 1.0) if span_s <= 600.0 else ("min", 60.0) if span_s <= 36000.0 else ("h", 3600.0)


def extent(points: Reals, least_m: float, shape: float) -> tuple[float, float, float, float]:
    """Bound points (n, 2) to west, south, east and north with equal scales; `shape` is height over width."""
    low, high = points.min(axis=0), points.max(axis=0)
    middle, span = (low + high) / 2.0, 1.25 * (high - low)
    width = max(span[0], span[1] / shape, least_m)
    half = np.array([width, width * shape]) / 2.0
    return (*(middle - half), *(middle + half))


# Shapes


def text(x: float, y: float, words: str, *, anchor: str = "start", css: str = "", turn: bool = False) -> Markup:
    """Draw words at a place; `turn` writes them upwards."""
    turned = Markup(' transform="rotate(-90 {:.1f} {:.1f})"').format(x, y) if turn else Markup("")
    return Markup('<text class="{}" x="{:.1f}" y="{:.1f}" text-anchor="{}"{}>{}</text>').format(
        css, x, y, anchor, turned, words
    )


def line(x1: float, y1: float, x2: float, y2: float, css: str) -> Markup:
    """Draw a straight line."""
    return Markup('<line class="{}" x1="{:.1f}" y1="{:.1f}" x2="{:.1f}" y2="{:.1f}"/>').format(css, x1, y1, x2, y2)


def circle(x: float, y: float, radius: float, css: str) -> Markup:
    """Draw a circle or disc, by its class."""
    return Markup('<circle class="{}" cx="{:.1f}" cy="{:.1f}" r="{:.1f}"/>').format(css, x, y, radius)


def path(x: Reals, y: Reals, css: str) -> Markup:
    """Draw a line through the points, broken where one is NaN; a point alone is a dot (round caps)."""
    finite = np.isfinite(x) & np.isfinite(y)
    steps: list[str] = []
    for index in np.flatnonzero(finite):
        begins = index == 0 or not finite[index - 1]
        steps.append(f"{'M' if begins else 'L'}{x[index]:.1f} {y[index]:.1f}{'h0' if begins else ''}")
    return Markup('<path class="{}" d="{}"/>').format(css, "".join(steps)) if steps else Markup("")


def symbol(x: float, y: float, label: Label, size: float = 5.5) -> Markup:
    """Draw a label's shape, readable without colour: disc true, diamond false, triangle echo, square unknown."""
    if label == "authentic":
        return circle(x, y, size, "symbol authentic")
    shapes = {
        "spoofed": f"m0 {-1.25 * size:.1f}l{1.25 * size:.1f} {1.25 * size:.1f}l{-1.25 * size:.1f} {1.25 * size:.1f}"
        f"l{-1.25 * size:.1f} {-1.25 * size:.1f}z",
        "multipath": f"m0 {-1.1 * size:.1f}l{1.1 * size:.1f} {1.9 * size:.1f}h{-2.2 * size:.1f}z",
        "unknown": f"m{-0.85 * size:.1f} {-0.85 * size:.1f}h{1.7 * size:.1f}v{1.7 * size:.1f}h{-1.7 * size:.1f}z",
    }
    return Markup('<path class="symbol {}" d="M{:.1f} {:.1f}{}"/>').format(label, x, y, shapes[label])


def rect(left: float, top: float, right: float, bottom: float, css: str) -> Markup:
    """Draw a box."""
    return Markup('<rect class="{}" x="{:.1f}" y="{:.1f}" width="{:.1f}" height="{:.1f}"/>').format(
        css, left, top, right - left, bottom - top
    )


def scale_bar(across: Scale, y: float) -> tuple[list[Markup], "Box"]:
    """Draw a bar of a round number of metres at the left end of an axis, and return its room."""
    most_m = 0.3 * (across.high - across.low)
    power = 10.0 ** math.floor(math.log10(most_m))
    length_m = max(power * factor for factor in (1.0, 2.0, 5.0) if power * factor <= most_m)
    x, end = across.start + 10.0, across.start + 10.0 + abs(across(length_m) - across(0.0))
    written = f"{number(length_m)} m" if length_m < 1000.0 else f"{number(length_m / 1000.0)} km"
    parts = [
        Markup('<path class="bar" d="M{:.1f} {:.1f}v6H{:.1f}v-6"/>').format(x, y - 6.0, end),
        text((x + end) / 2.0, y - 6.0, written, anchor="middle", css="small halo"),
    ]
    return parts, (x - 4.0, y - 18.0, end + 4.0, y + 3.0)


def svg(height: float, title: str, parts: Iterable[Markup]) -> Markup:
    """Draw the whole picture; `title` is what a screen reader says."""
    body = Markup("\n").join(part for part in parts if part)
    return Markup('<svg viewBox="0 0 {:.0f} {:.0f}" role="img" aria-label="{}">\n{}\n</svg>').format(
        WIDTH, height, title, body
    )


# Axes


def grid(
    across: Scale, up: Scale, names: tuple[str, str], units: tuple[float, float] = (1.0, 1.0), wanted: int = 5
) -> Iterator[Markup]:
    """Draw lines and numbers at round values, a frame, and the axes' names with their units.

    across, up : values to pixels, rightwards and upwards. units : what numbers are divided by before they are written.
    """
    left_x, right_x, top, bottom = across.start, across.end, up.end, up.start
    for tick in nice_ticks(across.low / units[0], across.high / units[0], wanted):
        x = across(tick * units[0])
        yield line(x, top, x, bottom, "grid")
        written = number(tick)
        yield text(min(x, WIDTH - 1.0 - 3.7 * len(written)), bottom + 15.0, written, anchor="middle")
    for tick in nice_ticks(up.low / units[1], up.high / units[1], wanted):
        y = up(tick * units[1])
        yield line(left_x, y, right_x, y, "grid")
        yield text(left_x - 5.0, y + 4.0, number(tick), anchor="end")
    yield _frame(left_x, right_x, top, bottom)
    yield from _axis_names(left_x, right_x, top, bottom, names)


def columns(
    across: Scale,
    top: float,
    bottom: float,
    *,
    unit: float = 1.0,
    below: float = 14.0,
    zero: str = "grid",
    css: str = "",
) -> list[Markup]:
    """Draw lines from top to bottom at round values, with their numbers `below` them. zero : style of that at zero."""
    parts: list[Markup] = []
    for tick in nice_ticks(across.low / unit, across.high / unit):
        x = across(tick * unit)
        parts += [
            line(x, top, x, bottom, zero if tick == 0.0 else "grid"),
            text(x, bottom + below, number(tick), anchor="middle", css=css),
        ]
    return parts


def log_grid(across: Scale, up: Scale, names: tuple[str, str]) -> Iterator[Markup]:
    """Draw the grid of decimal logarithms: lines and numbers at powers of ten."""
    left_x, right_x, top, bottom = across.start, across.end, up.end, up.start
    for power in range(math.ceil(across.low), math.floor(across.high) + 1):
        yield line(across(power), top, across(power), bottom, "grid")
        yield text(across(power), bottom + 15.0, _power_of_ten(power), anchor="middle")
    for power in range(math.ceil(up.low), math.floor(up.high) + 1):
        yield line(left_x, up(power), right_x, up(power), "grid")
        yield text(left_x - 5.0, up(power) + 4.0, _power_of_ten(power), anchor="end")
    yield _frame(left_x, right_x, top, bottom)
    yield from _axis_names(left_x, right_x, top, bottom, names)


def _power_of_ten(power: int) -> str:
    if -2 <= power <= 3:
        return f"{10.0**power:g}"
    return "10" + str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def _frame(left: float, right: float, top: float, bottom: float) -> Markup:
    return rect(left, top, right, bottom, "frame")


def _axis_names(left: float, right: float, top: float, bottom: float, names: tuple[str, str]) -> Iterator[Markup]:
    yield text((left + right) / 2.0, bottom + 32.0, names[0], anchor="middle", css="axis")
    yield text(11.0, (top + bottom) / 2.0, names[1], anchor="middle", css="axis", turn=True)


# Labels


def spread(wanted: Sequence[float], gap: float, lowest: float, highest: float) -> list[float]:
    """Places near the wanted ones, in their order, `gap` apart and within bounds: for labels that would overlap."""
    order = sorted(range(len(wanted)), key=lambda index: wanted[index])
    placed = [0.0] * len(wanted)
    last = lowest - gap
    for index in order:
        last = placed[index] = max(wanted[index], last + gap)
    ceiling = highest + gap
    for index in reversed(order):
        ceiling = placed[index] = min(placed[index], ceiling - gap)
    return placed


@dataclass(frozen=True)
class Tag:
    """Words that belong to a mark at (x, y) of a radius."""

    x: float
    y: float
    words: str
    css: str = "small halo"
    radius: float = 7.0


Box = tuple[float, float, float, float]
"""Left, top, right, bottom."""

_LETTER, _BOLD, _HEIGHT = 6.4, 7.4, 11.5  # of the style sheet's text in a wide typeface
_STEPS = ((0.0, 1.0), (1.0, 0.0), (-1.0, 0.0), (0.0, -1.0), (1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0))


def place_tags(tags: Sequence[Tag], taken: Sequence[Box], bounds: Box) -> list[Markup]:
    """Place every tag beside its mark, clear of marks, of `taken` and of the other tags.

    What finds no room near its mark moves away, with a line back to it.
    """
    boxes = [*taken, *((t.x - t.radius, t.y - t.radius, t.x + t.radius, t.y + t.radius) for t in tags)]
    parts: list[Markup] = []
    for tag in tags:
        width = (_BOLD if "name" in tag.css.split() else _LETTER) * len(tag.words)
        choices = [(away, step) for away in (0.0, 8.0, 16.0, 26.0, 38.0, 52.0, 70.0) for step in _STEPS]
        candidates = [_bound_tag(tag, width, away, step, bounds) for away, step in choices]
        best = int(
            np.argmin(_weigh_overlap(np.array(candidates), np.array(boxes), bounds) + 0.2 * np.arange(len(candidates)))
        )
        away, box = choices[best][0], candidates[best]
        boxes.append(box)
        if away > 0.0:
            near = min(max(tag.x, box[0]), box[2]), min(max(tag.y, box[1]), box[3])
            parts.append(line(tag.x, tag.y, *near, "leader"))
        parts.append(text((box[0] + box[2]) / 2.0, box[3] - 2.5, tag.words, anchor="middle", css=tag.css))
    return parts


def _bound_tag(tag: Tag, width: float, away: float, step: tuple[float, float], bounds: Box) -> Box:
    """Bound the words of a tag; above or below their mark they give way to the sides."""
    out = tag.radius + 1.0 + away
    slant = 0.9 if step[0] and step[1] else 1.0
    x = tag.x + step[0] * (slant * out + width / 2.0)
    y = tag.y + step[1] * (slant * out + _HEIGHT / 2.0)
    if step[1]:
        x = min(max(x, bounds[0] + width / 2.0), bounds[2] - width / 2.0)
    return x - width / 2.0, y - _HEIGHT / 2.0, x + width / 2.0, y + _HEIGHT / 2.0


def _weigh_overlap(candidates: Reals, taken: Reals, bounds: Box) -> Reals:
    """Weigh the overlap of boxes (n, 4) with others (m, 4); out of bounds is worst."""
    low = np.maximum(candidates[:, None, :2], taken[None, :, :2])
    high = np.minimum(candidates[:, None, 2:], taken[None, :, 2:])
    overlap = np.prod(np.maximum(high - low, 0.0), axis=-1).sum(axis=-1)
    outside = np.maximum(np.array(bounds[:2]) - candidates[:, :2], 0.0)
    outside += np.maximum(candidates[:, 2:] - np.array(bounds[2:]), 0.0)
    return np.asarray(1e5 * outside.sum(axis=-1) + 150.0 * overlap)
