"""What the verdict rests on, drawn: correlation over delay, range differences between receivers, chance."""

import math
from collections.abc import Sequence
from itertools import groupby

import numpy as np
from markupsafe import Markup

from skyproof.gnss.signals import GPS_L1_CA
from skyproof.records import LABELS
from skyproof.report import drawing as draw
from skyproof.report.pictures import DelayProfile, RangeDifference
from skyproof.report.words import power_words

__all__ = ["draw_chance_scale", "plot_differences", "plot_profiles"]

_COLUMNS = 2
_PANEL = 92.0  # units, the height of one


def plot_profiles(profiles: Sequence[DelayProfile], *, title: str) -> Markup:
    """Plot correlation power over delay, a panel per satellite on one scale, with every signal marked."""
    if not profiles:
        return Markup("")
    left_x, gap, top, right_x = 40.0, 14.0, 8.0, 352.0
    columns = min(_COLUMNS, len(profiles))
    wide = (right_x - left_x - gap * (columns - 1)) / columns
    rows = math.ceil(len(profiles) / columns)
    highest = max(float(np.max(profile.power)) for profile in profiles)
    parts: list[Markup] = []
    for index, profile in enumerate(profiles):
        row, column = divmod(index, columns)
        x0, y0 = left_x + column * (wide + gap), top + row * _PANEL
        across = draw.Scale(float(profile.delays_chips[0]), float(profile.delays_chips[-1]), x0, x0 + wide)
        up = draw.Scale(0.0, 1.3 * highest, y0 + _PANEL - 14.0, y0)
        lowest = row == rows - 1 or index + columns >= len(profiles)
        parts += _panel(profile, across, up, numbered=(column == 0, lowest))
    bottom = top + rows * _PANEL
    upwards = "correlation power, noise = 1" if rows > 1 else "power, noise = 1"  # one panel is no longer than that
    names = (f"delay, chips (1 chip = {GPS_L1_CA.chip_m:.0f} m)", upwards)
    parts += [
        draw.text((left_x + right_x) / 2.0, bottom + 16.0, names[0], anchor="middle", css="axis"),
        draw.text(9.0, (top + bottom) / 2.0, names[1], anchor="middle", css="axis", turn=True),
    ]
    return draw.svg(bottom + 22.0, title, parts)


def _panel(profile: DelayProfile, across: draw.Scale, up: draw.Scale, *, numbered: tuple[bool, bool]) -> list[Markup]:
    parts = []
    for tick in draw.nice_ticks(across.low, across.high, 4):
        parts.append(draw.line(across(tick), up.end, across(tick), up.start, "grid"))
        if numbered[1]:
            parts.append(draw.text(across(tick), up.start + 12.0, draw.number(tick), anchor="middle", css="small"))
    for tick in draw.nice_ticks(up.low, up.high, 3):
        if numbered[0]:
            parts.append(draw.text(across.start - 4.0, up(tick) + 3.5, draw.number(tick), anchor="end", css="small"))
    parts += [
        draw.line(across.start, up.start, across.end, up.start, "frame"),
        draw.path(across.pixels(profile.delays_chips), up.pixels(profile.power), "curve"),
    ]
    for tag in profile.tags:
        height = float(np.interp(tag.delay_chips, profile.delays_chips, profile.power))
        x = across(tag.delay_chips)
        parts += [
            draw.line(x, up(height) - 3.0, x, up.start, f"drop {tag.label}"),
            draw.symbol(x, up(height) - 9.0, tag.label, 4.5),
        ]
    return [*parts, draw.text(across.end - 3.0, up.end + 10.0, profile.sat, anchor="end", css="halo")]


def plot_differences(differences: Sequence[RangeDifference], *, title: str) -> Markup:
    """Plot how much longer each satellite's range to the second receiver is, a row per satellite.

    Signals of one transmitter stand one above the other; those of the sky do not.
    """
    if not differences:
        return Markup("")
    labels = [label for label in LABELS if any(d.label == label for d in differences)]
    leading = {d.sat: d.metres for label in reversed(labels) for d in differences if d.label == label}
    order = sorted(leading, key=lambda sat: (leading[sat], sat))
    left_x, right_x, top, step = 34.0, 346.0, 6.0, 17.0
    bottom = top + step * len(order) + 4.0
    reach = max(1.15 * max(abs(d.metres) for d in differences), 1.0)
    across = draw.Scale(-reach, reach, left_x, right_x)
    height = {sat: top + step * (index + 0.5) + 2.0 for index, sat in enumerate(order)}

    parts = draw.columns(across, top, bottom, zero="limit")
    parts += [draw.text(left_x - 4.0, y + 4.0, sat, anchor="end") for sat, y in height.items()]
    for (_, label), group in groupby(sorted(differences, key=_group), key=lambda d: (d.group, d.label)):
        ordered = sorted(group, key=lambda d: height[d.sat])
        x, y = np.array([across(d.metres) for d in ordered]), np.array([height[d.sat] for d in ordered])
        parts.append(draw.path(x, y, f"series thin {label}"))
        parts += [draw.symbol(float(a), float(b), label, 4.5) for a, b in zip(x, y, strict=True)]
    first, second = differences[0].receivers
    name = f"range to {second} minus range to {first}, less its mean, m"
    parts += [
        draw.rect(left_x, top, right_x, bottom, "frame"),
        draw.text((left_x + right_x) / 2.0, bottom + 31.0, name, anchor="middle", css="axis"),
    ]
    return draw.svg(bottom + 38.0, title, parts)


def _group(difference: RangeDifference) -> tuple[int, int]:
    return difference.group, LABELS.index(difference.label)


_MOST = 30.0  # powers of ten


def draw_chance_scale(p_value: float, allowed: float | None, *, title: str) -> Markup:
    """Draw a p-value as a power of ten, against the probability allowed."""
    left_x, right_x, y = 16.0, 344.0, 22.0
    scale = draw.Scale(0.0, _MOST, left_x, right_x)

    def at(probability: float) -> float:
        return scale(min(-math.log10(max(probability, 10.0**-_MOST)), _MOST))

    parts = []
    if allowed is not None:
        parts += [
            draw.rect(at(allowed), y - 7.0, right_x, y + 7.0, "beyond"),
            draw.line(at(allowed), y - 10.0, at(allowed), y + 7.0, "limit"),
            draw.text(at(allowed), y - 13.0, "threshold", anchor="middle", css="small"),
        ]
    parts.append(draw.line(left_x, y, right_x, y, "frame"))
    for power in (0, 10, 20, 30):
        edge = "≤ " if power == _MOST else ""
        x = scale(power)
        written = "1" if power == 0 else edge + power_words(-power)
        parts += [
            draw.line(x, y - 3.0, x, y + 3.0, "frame"),
            draw.text(min(x, right_x - 8.0), y + 19.0, written, anchor="middle", css="small"),
        ]
    parts += [
        draw.circle(at(p_value), y, 5.0, "mark statistic"),
        draw.text(
            (left_x + right_x) / 2.0,
            y + 33.0,
            "p-value: probability of such a result by chance",
            anchor="middle",
            css="small axis",
        ),
    ]
    return draw.svg(60.0, title, parts)
