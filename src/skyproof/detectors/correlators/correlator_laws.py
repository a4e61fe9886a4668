"""Laws of early, prompt and late correlators and of the two discriminators made of them.

Model. Equations in brackets: X. Zhang, H. Li, C. Yang and M. Lu, "Signal quality monitoring-based spoofing detection
method for Global Navigation Satellite System vector tracking structure", IET Radar, Sonar & Navigation, 2020, doi
10.1049/iet-rsn.2020.0021. Taps stand at -0.5, 0 and +0.5 chip. With noise of variance 1 in I and in Q a tap is
A R(offset) exp(j phase) + n, A = sqrt(2 T K C/N0), R the triangle (12), (13), (15). Noise of two taps correlates as R
of their distance: 0.5 from prompt to each side, 0 from early to late.

Densities are written in the angle whose tangent is the ratio of the paper, so that nothing overflows and the range is
finite. (17) and (29) have a factor 1 - Q(u) in print, with which the density of the phase does not integrate to one; it
is 1 - 2 Q(u). All functions broadcast over free leading axes.
"""

from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from skyproof.arrays import Reals

__all__ = [
    "CODE_SPACING_CHIPS",
    "REACH",
    "Form",
    "code_amplitudes",
    "code_angle_density",
    "code_score",
    "phase_density",
    "phase_discriminator",
    "phase_score",
    "triangle",
]

Form = Literal["corrected", "paper"]

CODE_SPACING_CHIPS: Final = 0.5  # of early and late from prompt
HALF_PI: Final = 0.5 * np.pi

_LAST_SCORE: Final = 6.0
REACH: Final = 12.0  # standard deviations: what lies outside is below 1e-31


# Amplitudes and discriminators ----------------------------------------------------------------------------------------


def triangle(offset_chips: ArrayLike) -> Reals:
    """Compute the correlation R of a code with itself, without the band limit: max(0, 1 - |x|)."""
    return np.asarray(np.maximum(0.0, 1.0 - np.abs(np.asarray(offset_chips, float))), float)


def phase_discriminator(prompt: ArrayLike) -> Reals:
    """Compute atan(Im P / Re P) in radians, within -pi/2 and pi/2, independent of a data bit."""
    p = np.asarray(prompt)
    return np.asarray(np.arctan2(p.imag * np.where(p.real < 0.0, -1.0, 1.0), np.abs(p.real)), float)


# Densities ------------------------------------------------------------------------------------------------------------


def code_amplitudes(amplitude: ArrayLike, code_chips: ArrayLike) -> tuple[Reals, Reals]:
    amplitude, offset = np.asarray(amplitude, float), np.asarray(code_chips, float)
    return amplitude * triangle(offset - CODE_SPACING_CHIPS), amplitude * triangle(offset + CODE_SPACING_CHIPS)


def code_angle_density(angle_rad: ArrayLike, amplitude: ArrayLike, code_chips: ArrayLike = 0.0) -> Reals:
    """Compute the density of atan(|L| / |E|) in (0, pi/2): a ratio of two independent Rice variables (16), (28).

    amplitude : A_K. code_chips : true offset, received minus local.
    """
    angle = np.asarray(angle_rad, float)
    a1, a2 = code_amplitudes(amplitude, code_chips)
    sin, cos = np.sin(angle), np.cos(angle)
    z = a1 * a2 * sin * cos
    bracket = (1.0 + 0.5 * ((a1 * cos) ** 2 + (a2 * sin) ** 2)) * special.i0e(z) + z * special.i1e(z)
    return np.asarray(2.0 * sin * cos * np.exp(-0.5 * (a1 * sin - a2 * cos) ** 2) * bracket, float)


def phase_density(
    value_rad: ArrayLike,
    amplitude: ArrayLike,
    phase_rad: ArrayLike = 0.0,
    code_chips: ArrayLike = 0.0,
    *,
    form: Form = "corrected",
) -> Reals:
    """Compute the density of the phase discriminator, per radian, in (-pi/2, pi/2) (17), (29).

    Its period is pi.

    form : "paper" has 1 - Q(u) as printed, "corrected" 1 - 2 Q(u). The printed one integrates to 1.14 at amplitude 1.
    """
    value = np.asarray(value_rad, float)
    level = np.asarray(amplitude, float) * triangle(code_chips)
    apart = value - np.asarray(phase_rad, float)
    # u = a cos + b sin and v = b cos - a sin of the paper with a, b = level (cos, sin)(phase)
    u, v = level * np.cos(apart), -level * np.sin(apart)
    factor = special.erf(u / np.sqrt(2.0)) if form == "corrected" else special.ndtr(u)
    return np.asarray(np.exp(-0.5 * level**2) / np.pi + u / np.sqrt(2.0 * np.pi) * np.exp(-0.5 * v**2) * factor, float)


# Integrals ------------------------------------------------------------------------------------------------------------


# gamma2 as a series ---------------------------------------------------------------------------------------------------


# Normal scores --------------------------------------------------------------------------------------------------------


def _rareness(knots: Reals, density: Reals) -> tuple[Reals, int]:
    """Convert tail probabilities beyond even knots to standard normal deviates, up to the last place below 6.

    From there on scores grow in proportion to the value, so that offsets that a large attack causes keep their
    ratios."""
    mass = np.concatenate(([0.0], np.cumsum(0.5 * (density[1:] + density[:-1])[::-1])))[::-1]
    rare = -special.ndtri(np.maximum(0.5 * mass / mass[0], 1e-300))
    return np.asarray(rare, float), int(np.searchsorted(rare, _LAST_SCORE)) - 1


def _interpolate(place: Reals, table: Reals, last: int) -> Reals:
    """Interpolate linearly at places 0 to `last`.

    np.interp would search for each, which takes three times as long.
    """
    below = np.minimum(place.astype(np.int64), last - 1)
    low = table[below]
    return np.asarray(low + (place - below) * (table[below + 1] - low), float)


def code_score(value_chips: ArrayLike, amplitude: float) -> Reals:
    """Convert the code discriminator to a standard normal deviate: exactly N(0, 1) at offset zero, any amplitude.

    Where the discriminator is nearly normal it is the value over its standard deviation; where it saturates (1 ms at 40
    dB-Hz) it has the right tails all the same.
    """
    value = np.asarray(value_chips, float)
    knots = np.linspace(0.0, min(0.25 * np.pi, 1.5 * REACH / max(amplitude, 1e-3)), 4001)
    rare, last = _rareness(knots, code_angle_density(0.25 * np.pi - knots, amplitude))
    size = np.abs(value)
    limit = 0.5 * np.tan(knots[last])
    near = _interpolate(np.arctan(2.0 * np.minimum(size, limit)) / knots[1], rare, last)
    return np.asarray(np.copysign(np.where(size > limit, rare[last] * size / limit, near), value), float)


def phase_score(value_rad: ArrayLike, amplitude: float) -> Reals:
    """Convert the phase discriminator to a standard normal deviate: exactly N(0, 1) at offset zero, any amplitude."""
    value = np.asarray(value_rad, float)
    knots = np.linspace(0.0, min(HALF_PI, REACH / max(amplitude, 1e-3)), 4001)
    rare, last = _rareness(knots, phase_density(knots, amplitude))
    size = np.abs(value)
    near = _interpolate(np.minimum(size, knots[last]) / knots[1], rare, last)
    return np.asarray(np.copysign(np.where(size > knots[last], rare[last] * size / knots[last], near), value), float)
