"""Rows of numbers as a chart: points and lines over straight or logarithmic axes, with a legend below.

One SVG that stands alone: it brings its style, light and dark. Lines differ in colour (of Okabe and Ito, "Color
universal design", 2008, which colour-blind people tell apart), in the shape of their marks and, beyond six, in dashes.
"""

import math
import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from markupsafe import Markup

from skyproof.arrays import Reals
from skyproof.report import drawing as draw

__all__ = ["Axes", "Curve", "draw_chart_svg", "group_curves", "write_value"]


@dataclass(frozen=True, kw_only=True)
class Axes:
    """What of the rows is drawn: column `y` over column `x`, a line for each combination of the values of `by`.

    where : only rows with these values.
    scattered : marks alone, however many, as the order of the rows means nothing.
    diagonal : a line where x and y are the same, at all x; for axes that are both straight or both logarithmic.
    """

    title: str
    x: str
    y: str
    x_label: str
    y_label: str
    by: tuple[str, ...] = ()
    where: Mapping[str, Any] = field(default_factory=dict)
    x_log: bool = False
    y_log: bool = False
    scattered: bool = False
    diagonal: bool = False


@dataclass(frozen=True, eq=False)
class Curve:
    """One line: its name, and x and y (n,) in the order of the rows, NaN where it is broken."""

    name: str
    x: Reals
    y: Reals


_STYLE = Markup("""<style>
svg { background: #ffffff; font-family: system-ui, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
text { font-size: 11.5px; fill: #5a6675; }
.small { font-size: 10px; }
.axis, .title { fill: #1b2430; }
.title { font-weight: 600; }
.grid { stroke: #e9edf2; fill: none; }
.frame { stroke: #d5dbe3; fill: none; }
.curve { fill: none; stroke-width: 1.5; stroke-linejoin: round; stroke-linecap: round; }
.curve.c0 { stroke: #0072b2; } .point.c0 { fill: #0072b2; }
.curve.c1 { stroke: #d55e00; } .point.c1 { fill: #d55e00; }
.curve.c2 { stroke: #009e73; } .point.c2 { fill: #009e73; }
.curve.c3 { stroke: #cc79a7; } .point.c3 { fill: #cc79a7; }
.curve.c4 { stroke: #b58900; } .point.c4 { fill: #b58900; }
.curve.c5 { stroke: #56b4e9; } .point.c5 { fill: #56b4e9; }
.d1 { stroke-dasharray: 6 4; } .d2 { stroke-dasharray: 1.5 4; } .d3 { stroke-dasharray: 8 3 1.5 3; }
@media (prefers-color-scheme: dark) {
  svg { background: #12171d; } text { fill: #9aa7b6; } .axis, .title { fill: #e4e9ef; }
  .grid { stroke: #242c35; } .frame { stroke: #38424e; }
}
</style>""")
_COLOURS, _DASHES = 6, 4
_MARKS = (
    "m-2.6 0a2.6 2.6 0 1 0 5.2 0a2.6 2.6 0 1 0 -5.2 0z",
    "m0 -3.3l3.3 3.3l-3.3 3.3l-3.3 -3.3z",
    "m-2.4 -2.4h4.8v4.8h-4.8z",
    "m0 -3l3 5.2h-6z",
    "m0 3l3 -5.2h-6z",
    "m-3 -1h2v-2h2v2h2v2h-2v2h-2v-2h-2z",
)
_MOST_MARKS = 40  # with more points than that only the line is drawn
_LEFT, _RIGHT, _TOP, _BOTTOM = 58.0, 350.0, 30.0, 250.0
_LEGEND_FROM, _LEGEND_STEP, _LETTER = 48.0, 15.0, 5.6
_TITLE_LETTERS, _TITLE_STEP = 50, 14.0
_AXIS_NAME = 24.0  # of room for the name of the y axis, left of its numbers
_TICKS = 6

_UNITS = {
    "m": "m",
    "s": "s",
    "ms": "ms",
    "us": "µs",
    "hz": "Hz",
    "db": "dB",
    "dbhz": "dB-Hz",
    "chip": "chip",
    "deg": "°",
    "rad": "rad",
    "cyc": "cycles",
    "m_s": "m/s",
    "pi": "π",
}
_NAMES = {"cn0": "C/N0", "prn": "PRN", "k": "K"}


def write_value(column: str, value: Any) -> str:
    """Write a value for a legend: words unchanged, numbers with the column's name and unit."""
    if isinstance(value, str):
        return value
    match = re.fullmatch(r"(.+?)_(m_s|[a-z]+)", column)
    name, unit = (match[1], _UNITS[match[2]]) if match and match[2] in _UNITS else (column, "")
    name = _NAMES.get(name, name.replace("_", " "))
    if isinstance(value, bool | np.bool_):
        return name if value else f"no {name}"
    if unit == "Hz" and isinstance(value, int | float | np.number) and value >= 1e6:
        value, unit = float(value) / 1e6, "MHz"
    written = draw.number(float(value)) if isinstance(value, int | float | np.number) else str(value)
    return f"{name} {written}{'' if unit in ('', '°') else ' '}{unit}"


def group_curves(rows: Iterable[Mapping[str, Any]], axes: Axes) -> tuple[list[Curve], list[str]]:
    """Group the rows into lines, and list the names on the x axis if its column holds words.

    A row without one of the columns, or with None there, is left out; what has no logarithm breaks a line.
    """
    kept = [row for row in rows if all(row.get(key) == value for key, value in axes.where.items())]
    kept = [row for row in kept if row.get(axes.x) is not None and row.get(axes.y) is not None]
    names = list(dict.fromkeys(str(row[axes.x]) for row in kept)) if any(_is_word(row[axes.x]) for row in kept) else []
    groups: dict[tuple[Any, ...], list[Mapping[str, Any]]] = {}
    for row in kept:
        groups.setdefault(tuple(row.get(key) for key in axes.by), []).append(row)
    curves = []
    for key, members in groups.items():
        x = np.array([names.index(str(row[axes.x])) if names else float(row[axes.x]) for row in members], np.float64)
        y = np.array([float(row[axes.y]) for row in members], np.float64)
        name = ", ".join(write_value(column, value) for column, value in zip(axes.by, key, strict=True))
        curves.append(Curve(name, _log(x) if axes.x_log and not names else x, _log(y) if axes.y_log else y))
    return curves, names


def draw_chart_svg(rows: Sequence[Mapping[str, Any]], charts: Sequence[Axes]) -> Markup:
    """Draw all charts of the same rows, one below the other, as a file; empty if there is nothing to draw."""
    pieces, height = [], 0.0
    for axes in charts:
        body, tall = _draw_chart(rows, axes)
        if body:
            pieces.append(Markup('<g transform="translate(0 {:.0f})">\n{}\n</g>').format(height, body))
            height += tall
    if not pieces:
        return Markup("")
    title = "; ".join(axes.title for axes in charts)
    return Markup(
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {:.0f} {:.0f}" width="{:.0f}" role="img" '
        'aria-label="{}">\n{}\n{}\n</svg>\n'
    ).format(draw.WIDTH, height, 2.0 * draw.WIDTH, title, _STYLE, Markup("\n").join(pieces))


def _draw_chart(rows: Sequence[Mapping[str, Any]], axes: Axes) -> tuple[Markup, float]:
    curves, names = group_curves(rows, axes)
    finite = [np.isfinite(curve.x) & np.isfinite(curve.y) for curve in curves]
    if not any(mask.any() for mask in finite):
        return Markup(""), 0.0
    x = np.concatenate([curve.x[mask] for curve, mask in zip(curves, finite, strict=True)])
    y = np.concatenate([curve.y[mask] for curve, mask in zip(curves, finite, strict=True)])
    x_log = axes.x_log and not names
    seen = np.concatenate((y, x)) if axes.diagonal else y
    up = draw.Scale(*_bound_axis(seen, axes.y_log, 0.5), _BOTTOM, _TOP)
    up_ticks = _place_ticks(up, axes.y_log)
    left_x = max(_LEFT, _AXIS_NAME + _LETTER * max((len(written) for _, written in up_ticks), default=0))
    across = draw.Scale(*((-0.5, len(names) - 0.5) if names else _bound_axis(x, x_log, 0.2)), left_x, _RIGHT)
    across_ticks = [(float(index), name) for index, name in enumerate(names)]
    parts = _draw_grid(
        across, up, axes, across_ticks or _ticks_at_values(x, across, x_log) or _place_ticks(across, x_log), up_ticks
    )
    if axes.diagonal:
        ends = max(across.low, up.low), min(across.high, up.high)
        parts += [draw.line(across(ends[0]), up(ends[0]), across(ends[1]), up(ends[1]), "frame")] * (ends[0] < ends[1])
    for index, curve in enumerate(curves):
        parts += _draw_curve(across.pixels(curve.x), up.pixels(curve.y), index, scattered=axes.scattered)
    legend, lines = _draw_legend([curve.name for curve in curves], scattered=axes.scattered)
    title = textwrap.wrap(axes.title, _TITLE_LETTERS)
    lower = _TITLE_STEP * (len(title) - 1)
    body = Markup("\n").join([*parts, *legend])
    if lower:
        body = Markup('<g transform="translate(0 {:.0f})">\n{}\n</g>').format(lower, body)
    written = [draw.text(8.0, 18.0 + _TITLE_STEP * row, line, css="title") for row, line in enumerate(title)]
    return Markup("\n").join([*written, body]), lower + _BOTTOM + _LEGEND_FROM + _LEGEND_STEP * lines


def _draw_curve(x: Reals, y: Reals, index: int, *, scattered: bool) -> list[Markup]:
    colour = f"c{index % _COLOURS}"
    parts = [] if scattered else [draw.path(x, y, f"curve {colour} d{index // _COLOURS % _DASHES}")]
    if scattered or x.size <= _MOST_MARKS:
        shape = _MARKS[index % len(_MARKS)]
        spots = "".join(f"M{a:.1f} {b:.1f}{shape}" for a, b in zip(x, y, strict=True) if math.isfinite(a + b))
        parts.append(Markup('<path class="point {}" d="{}"/>').format(colour, spots))
    return parts


def _draw_legend(names: Sequence[str], *, scattered: bool) -> tuple[list[Markup], int]:
    """Draw keys and names in as many columns as the longest name leaves room for."""
    if not any(names):
        return [], 0
    width = 38.0 + _LETTER * max(len(name) for name in names)
    columns = max(1, min(len(names), int((draw.WIDTH - 8.0) // width)))
    parts: list[Markup] = []
    for index, name in enumerate(names):
        x, y = 8.0 + index % columns * width, _BOTTOM + _LEGEND_FROM + index // columns * _LEGEND_STEP
        key_x = np.array([x + 11.0] if scattered else [x, x + 22.0])
        parts += [
            *_draw_curve(key_x, np.full(key_x.size, y - 3.5), index, scattered=scattered),
            draw.text(x + 28.0, y, name, css="small axis"),
        ]
    return parts, math.ceil(len(names) / columns)


def _draw_grid(
    across: draw.Scale,
    up: draw.Scale,
    axes: Axes,
    across_ticks: Sequence[tuple[float, str]],
    up_ticks: Sequence[tuple[float, str]],
) -> list[Markup]:
    parts: list[Markup] = []
    left_x = across.start
    for value, written in across_ticks:
        x = across(value)
        parts += [
            draw.line(x, _TOP, x, _BOTTOM, "grid"),
            draw.text(
                min(x, draw.WIDTH - 1.0 - 3.7 * len(written)), _BOTTOM + 14.0, written, anchor="middle", css="small"
            ),
        ]
    for value, written in up_ticks:
        y = up(value)
        parts += [
            draw.line(left_x, y, _RIGHT, y, "grid"),
            draw.text(left_x - 5.0, y + 3.5, written, anchor="end", css="small"),
        ]
    parts.append(
        Markup('<rect class="frame" x="{}" y="{}" width="{}" height="{}"/>').format(
            left_x, _TOP, _RIGHT - left_x, _BOTTOM - _TOP
        )
    )
    return [
        *parts,
        draw.text((left_x + _RIGHT) / 2.0, _BOTTOM + 30.0, axes.x_label, anchor="middle", css="axis"),
        draw.text(12.0, (_TOP + _BOTTOM) / 2.0, axes.y_label, anchor="middle", css="axis", turn=True),
    ]


def _ticks_at_values(values: Reals, scale: draw.Scale, log: bool) -> list[tuple[float, str]]:
    """Place ticks at the values themselves if they are few and far enough apart to be read; else none."""
    distinct = np.unique(values)
    if not 2 <= distinct.size <= _TICKS:
        return []
    written = [draw.number(float(f"{10.0**value if log else value:.6g}")) for value in distinct]
    widths = np.array([_LETTER * len(label) for label in written])
    apart = np.diff(scale.pixels(distinct)) - 0.5 * (widths[1:] + widths[:-1])
    return list(zip(distinct.tolist(), written, strict=True)) if np.all(apart > 6.0) else []


def _place_ticks(scale: draw.Scale, log: bool) -> list[tuple[float, str]]:
    """Place ticks and their numbers on an axis.

    Within two decades they stand at 1, 2 and 5 of each, else at powers of ten.
    """
    if not log:
        return [(tick, draw.number(tick)) for tick in draw.nice_ticks(scale.low, scale.high, _TICKS)]
    span = scale.high - scale.low
    step = max(1, round(span / 6.0))
    leads = (1, 2, 5) if span <= 2.0 else (1,)
    values = [
        (power + math.log10(lead), lead, power)
        for power in range(math.floor(scale.low), math.ceil(scale.high) + 1)
        for lead in leads
    ]
    return [
        (at, _power(lead, power))
        for at, lead, power in values
        if scale.low - 1e-9 <= at <= scale.high + 1e-9 and (power % step == 0 or span <= 2.0)
    ]


def _power(lead: int, power: int) -> str:
    if -3 <= power <= 4:
        return f"{lead * 10.0**power:g}"
    raised = "10" + str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return raised if lead == 1 else f"{lead}·{raised}"


def _bound_axis(values: Reals, log: bool, near: float) -> tuple[float, float]:
    """Bound an axis a little beyond the values.

    A straight axis begins at zero if the lowest is below `near` of the top.
    """
    low, high = float(values.min()), float(values.max())
    span = high - low
    if span <= 1e-12 * max(abs(low), abs(high), 1e-300):
        if not log and high >= 0.0:
            return 0.0, 1.1 * high or 1.0
        span = (0.5 if log else max(abs(high), 1.0)) * 0.5
        return low - span, high + span
    room = 0.04 * span
    if not log and 0.0 <= low < near * high:
        return 0.0, high + room
    return low - room, high + room


def _log(values: Reals) -> Reals:
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = np.log10(values)
    return np.where(np.isfinite(logs), logs, np.nan)


def _is_word(value: Any) -> bool:
    return isinstance(value, str)
