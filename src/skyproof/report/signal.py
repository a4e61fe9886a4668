"""Pictures of a recording's samples, each an SVG of its own, light and dark: levels, spectrum, correlation."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup

from skyproof.arrays import Reals
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.report import drawing as draw
from skyproof.report.chart import Axes, draw_chart_svg

__all__ = ["Lobe", "Mark", "draw_correlation_svg", "draw_levels_svg", "draw_spectrum_svg"]

_STYLE = Markup("""<style>
svg { background: #ffffff; font-family: system-ui, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
text { font-size: 11.5px; fill: #5a6675; }
.small { font-size: 10px; }
.axis, .title, .name { fill: #1b2430; } .title, .name { font-weight: 600; }
.grid { stroke: #e9edf2; fill: none; } .frame { stroke: #d5dbe3; fill: none; }
.lobe { fill: none; stroke: #0072b2; stroke-width: 1; stroke-linejoin: round; }
.bar { fill: #0072b2; } .peak { fill: #d55e00; } .several { fill: #d55e00; font-weight: 600; }
@media (prefers-color-scheme: dark) {
  svg { background: #12171d; } text { fill: #9aa7b6; } .axis, .title, .name { fill: #e4e9ef; }
  .grid { stroke: #242c35; } .frame { stroke: #38424e; } .lobe { stroke: #56b4e9; } .bar { fill: #56b4e9; }
  .peak, .several { fill: #e69f00; }
}
</style>""")
_LEFT, _RIGHT, _TOP, _ROW = 64.0, 316.0, 34.0, 40.0
_MOST_POINTS = 1024


@dataclass(frozen=True)
class Mark:
    """A line in the spectrum: where it is, how high its top, and whether it hurts."""

    frequency_hz: float
    density: float
    hurts: bool


@dataclass(frozen=True, eq=False)
class Lobe:
    """The correlation of one satellite over a code period: delays in chips, ascending, power over the noise's.

    peaks : how many signals of it were found.
    """

    sat: str
    delay_chips: Reals
    power: Reals
    cn0_dbhz: float
    peaks: int


def draw_levels_svg(values: Reals, shares: Reals) -> Markup:
    """Draw the histogram (n,) of the numbers as bars."""
    gap = float(np.min(np.diff(values))) if values.size > 1 else 1.0
    across = draw.Scale(float(values[0]) - gap, float(values[-1]) + gap, _LEFT, 350.0)
    up = draw.Scale(0.0, 108.0 * float(shares.max()), 250.0, _TOP)
    width = 0.9 * gap / (across.high - across.low) * (across.end - across.start)
    bars = [
        Markup('<rect class="bar" x="{:.2f}" y="{:.2f}" width="{:.2f}" height="{:.2f}"/>').format(
            across(float(value)) - width / 2.0, up(float(share) * 100.0), width, up(0.0) - up(float(share) * 100.0)
        )
        for value, share in zip(values, shares, strict=True)
    ]
    names = ("value of a number", "share of the numbers, %")
    return _picture("Levels", 286.0, [*draw.grid(across, up, names), *bars])


def _picture(title: str, height: float, parts: Sequence[Markup]) -> Markup:
    return Markup(
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {w:.0f} {h:.0f}" width="{:.0f}" role="img" '
        'aria-label="{t}">\n{}\n{}\n</svg>\n'
    ).format(
        2.0 * draw.WIDTH,
        _STYLE,
        Markup("\n").join([draw.text(8.0, 18.0, title, css="title"), *parts]),
        w=draw.WIDTH,
        h=height,
        t=title,
    )


def draw_spectrum_svg(frequency_hz: Reals, density: Reals, floor: Reals, lines: Sequence[Mark]) -> Markup:
    """Draw the power density (n,) with its floor and the lines found, over the floor's highest."""
    reference = floor.max()
    rows: list[dict[str, Any]] = []
    for name, values in (("measured", density), ("without lines", floor)):
        size = -(-values.size // _MOST_POINTS)
        starts = np.arange(0, values.size, size)
        tops = np.maximum.reduceat(values, starts)  # so that no line is lost
        rows += [
            {"curve": name, "mhz": mhz, "db": db}
            for mhz, db in zip((frequency_hz[starts] / 1e6).tolist(), _db(tops / reference).tolist(), strict=True)
        ]
    for name, hurts in (("line, notched", True), ("line, harmless", False)):
        rows += [
            {"curve": name, "mhz": mark.frequency_hz / 1e6, "db": float(_db(np.array(mark.density / reference)))}
            for mark in lines[:_MOST_POINTS]
            if mark.hurts == hurts
        ]
        if (n := sum(row["curve"] == name for row in rows)) and n > 1:
            rows = _break_curve(rows, name)
    axes = Axes(
        title="Spectrum",
        x="mhz",
        y="db",
        x_label="frequency in the samples, MHz",
        y_label="power density, dB",
        by=("curve",),
    )
    return draw_chart_svg(rows, [axes])


def _break_curve(rows: list[dict[str, Any]], name: str) -> list[dict[str, Any]]:
    """Put breaks between the points of a curve, so that no stroke joins them."""
    parted: list[dict[str, Any]] = []
    for row in rows:
        parted.append(row)
        if row["curve"] == name:
            parted.append({**row, "db": float("nan")})
    return parted


def draw_correlation_svg(lobes: Sequence[Lobe]) -> Markup:
    """Draw one row per satellite: correlation amplitude over delay, with its peaks marked."""
    if not lobes:
        return Markup("")
    bottom = _TOP + _ROW * len(lobes)
    across = draw.Scale(0.0, GPS_L1_CA.code_length, _LEFT, _RIGHT)
    parts = draw.columns(across, _TOP, bottom, css="small")
    for index, lobe in enumerate(lobes):
        parts += _row(lobe, across, _TOP + _ROW * (index + 1))
    parts += [
        Markup('<rect class="frame" x="{}" y="{}" width="{}" height="{}"/>').format(
            _LEFT, _TOP, _RIGHT - _LEFT, bottom - _TOP
        ),
        draw.text((_LEFT + _RIGHT) / 2.0, bottom + 30.0, "delay, chips", anchor="middle", css="axis"),
    ]
    return _picture("Correlation amplitude of each satellite", bottom + 38.0, parts)


def _row(lobe: Lobe, across: draw.Scale, bottom: float) -> list[Markup]:
    amplitude, length = np.sqrt(lobe.power), GPS_L1_CA.code_length
    up = draw.Scale(0.0, 1.08 * float(amplitude.max()), bottom, bottom - _ROW)
    parts = [
        draw.line(_LEFT, bottom, _RIGHT, bottom, "grid"),
        draw.path(across.pixels(lobe.delay_chips), up.pixels(amplitude), "lobe"),
        draw.text(_LEFT - 6.0, bottom - 16.0, lobe.sat, anchor="end", css="name"),
        draw.text(_LEFT - 6.0, bottom - 4.0, f"{lobe.cn0_dbhz:.0f} dB-Hz", anchor="end", css="small"),
        draw.text(
            _RIGHT + 6.0,
            bottom - 10.0,
            f"{lobe.peaks} peak{'s' * (lobe.peaks > 1)}",
            css="small several" if lobe.peaks > 1 else "small",
        ),
    ]
    remaining = amplitude.copy()
    for _ in range(lobe.peaks):
        top = int(np.argmax(remaining))
        parts.append(draw.circle(across(float(lobe.delay_chips[top])), up(float(amplitude[top])), 2.6, "peak"))
        apart = np.abs((lobe.delay_chips - lobe.delay_chips[top] + 0.5 * length) % length - 0.5 * length)
        remaining[apart < 1.5] = 0.0
    return parts


def _db(ratio: Reals) -> Reals:
    return 10.0 * np.log10(np.maximum(ratio, 1e-12))
