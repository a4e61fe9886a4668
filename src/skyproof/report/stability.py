"""The errors of generated clocks and inertial units as one page: Allan deviations beside theory."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from skyproof.arrays import Reals
from skyproof.records import freeze
from skyproof.report import drawing as draw
from skyproof.report.template import Figure, load_environment

__all__ = ["AllanCurve", "plot_allan", "write_stability_html"]


@dataclass(frozen=True, eq=False, kw_only=True)
class AllanCurve:
    """Deviation, its limits and theory (n,), above zero, at averaging times tau_s (n,)."""

    name: str
    tau_s: Reals
    deviation: Reals
    lower: Reals
    upper: Reals
    theory: Reals

    def __post_init__(self) -> None:
        freeze(self, {name: ("tau",) for name in ("tau_s", "deviation", "lower", "upper", "theory")})


def plot_allan(curves: Sequence[AllanCurve], *, title: str, unit: str) -> Markup:
    """Plot points with their limits over logarithmic axes, and theory as a line named at its end."""
    if not curves:
        return Markup("")
    left_x, top, bottom = 56.0, 10.0, 270.0
    right_x = draw.WIDTH - 14.0 - 7.0 * max(len(curve.name) for curve in curves)
    across = draw.Scale(*_decades(np.concatenate([curve.tau_s for curve in curves]), 1.0), left_x, right_x)
    reach = [values for curve in curves for values in (curve.lower, curve.upper, curve.theory)]
    up = draw.Scale(*_decades(np.concatenate(reach), 0.5), bottom, top)
    parts = list(draw.log_grid(across, up, ("averaging time, s", f"Allan deviation, {unit}")))
    ends = []
    for curve in curves:
        x = across.pixels(np.log10(curve.tau_s))
        y, low, high, theory = (
            up.pixels(np.log10(v)) for v in (curve.deviation, curve.lower, curve.upper, curve.theory)
        )
        parts.append(draw.path(x, theory, "theory"))
        for at, middle, below, above in zip(x, y, low, high, strict=True):
            parts += [draw.line(at, below, at, above, "limits"), draw.circle(at, middle, 2.2, "point")]
        ends.append((float(x[-1]), float(theory[-1])))
    heights = draw.spread([end for _, end in ends], 12.0, top + 4.0, bottom)
    for (start, end), height, curve in zip(ends, heights, curves, strict=True):
        parts += [
            draw.line(start + 2.0, end, right_x + 9.0, height, "leader"),
            draw.text(right_x + 11.0, height + 4.0, curve.name, css="small name receiver"),
        ]
    return draw.svg(308.0, title, parts)


def _decades(values: Reals, least: float) -> tuple[float, float]:
    """Return decimal logarithms around the values, with a little room, on multiples of `least`."""
    low, high = np.log10(values.min()) - 0.05, np.log10(values.max()) + 0.05
    return float(np.floor(low / least) * least), float(np.ceil(high / least) * least)


def write_stability_html(plots: Sequence[tuple[str, str, Sequence[AllanCurve]]], made_by: str) -> str:
    """Write the whole page. plots : heading, unit, curves."""
    caption = (
        "Points: roots of the mean Allan variance of several runs, with 90 % limits by their spread; neighbours have "
        "much in common. Lines: what the class or grade promises."
    )
    figures = [
        Figure(heading, plot_allan(curves, title=f"Allan deviation of {heading}", unit=unit), caption)
        for heading, unit, curves in plots
    ]
    return load_environment().get_template("stability.html.j2").render(figures=figures, made_by=made_by)
