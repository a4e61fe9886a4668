"""The paper's rules of the vector receiver: block rates, equilibrium, two steps."""

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import brentq

from skyproof.arrays import Booleans, Integers, Reals
from skyproof.detectors.correlators import correlator_laws as law
from skyproof.detectors.correlators.vector_sqm import SatelliteGeometry
from skyproof.studies import discriminator_laws as laws

__all__ = [
    "CODE_LIMIT_CHIPS",
    "PHASE_LIMIT_RAD",
    "Equilibrium",
    "TwoStep",
    "block_rate",
    "detection_probability",
    "equilibrium",
    "geometry_matrix",
    "limit_scale",
    "linear_shift",
    "parameter",
    "rule_alarm_probability",
    "two_step",
]


CODE_LIMIT_CHIPS: Final = 0.1  # T1 and T2 of the paper, section 4


PHASE_LIMIT_RAD: Final = 0.05 * np.pi


def geometry_matrix(azimuth_rad: ArrayLike, elevation_rad: ArrayLike) -> Reals:
    """Rows (-cos el sin az, -cos el cos az, -sin el, 1) of (10), shape (..., n, 4)."""
    az, el = np.broadcast_arrays(np.asarray(azimuth_rad, float), np.asarray(elevation_rad, float))
    rows = (-np.cos(el) * np.sin(az), -np.cos(el) * np.cos(az), -np.sin(el), np.ones(az.shape))
    return np.asarray(np.stack(rows, axis=-1), float)


def linear_shift(
    where: SatelliteGeometry, code_chips: ArrayLike, doppler_hz: ArrayLike, *, coherent_s: float = 1e-3
) -> tuple[Reals, Reals]:
    """S C^s in chips and pi T S f^s in radians: the equilibrium without the bias of the discriminators."""
    code = where.projector @ np.asarray(code_chips, float)[..., None]
    doppler = where.projector @ np.asarray(doppler_hz, float)[..., None]
    return code[..., 0], np.pi * coherent_s * doppler[..., 0]


class Equilibrium(NamedTuple):
    """Where the loops settle, shapes (..., n). NaN where no equilibrium exists: the satellite loses lock."""

    code_chips: Reals
    phase_rad: Reals


def equilibrium(
    where: SatelliteGeometry,
    code_chips: ArrayLike,
    doppler_hz: ArrayLike,
    cn0_dbhz: ArrayLike,
    *,
    coherent_s: float = 1e-3,
) -> Equilibrium:
    """Settled offsets (20), (21) under an attack that adds `code_chips` (..., n) and `doppler_hz` (..., n).

    Code: S dC = S C^s and G^T gamma1(dC) = 0, four equations, by Newton. Phase: gamma2(dC, dphi) = pi T S f^s, one
    equation a satellite, on the branch from zero to the maximum of gamma2. `cn0_dbhz` holds for one update of the loops
    (`coherent_s` long), not of the sums that a metric takes; one number or one per satellite.
    """
    code_s, doppler_s, cn0 = np.broadcast_arrays(
        *(np.asarray(x, float) for x in (code_chips, doppler_hz, cn0_dbhz, where.design[..., 0]))
    )[:3]
    amplitude = laws.prompt_amplitude(cn0, coherent_s=coherent_s)
    shift, asked = linear_shift(where, code_s, doppler_s, coherent_s=coherent_s)
    code = _code_equilibrium(where, shift, amplitude)
    return Equilibrium(code, _phase_equilibrium(asked, amplitude, code))


def _code_equilibrium(where: SatelliteGeometry, shift: Reals, amplitude: Reals) -> Reals:
    across = np.swapaxes(where.span, -1, -2)
    x = np.zeros((*shift.shape[:-1], 4, 1))
    step_chips, tolerance = 1e-6, 1e-12
    for _ in range(40):
        code = shift - (where.span @ x)[..., 0]
        mean = laws.code_mean(amplitude, code)
        misfit = across @ mean[..., None]
        if np.max(np.abs(misfit)) < tolerance:
            break
        slope = (laws.code_mean(amplitude, code + step_chips) - mean) / step_chips
        step = np.linalg.pinv(across @ (slope[..., None] * where.span)) @ misfit
        largest = np.max(np.abs(step), axis=(-1, -2), keepdims=True)
        x = x + step * np.minimum(1.0, 0.2 / np.maximum(largest, 1e-300))
    settled = np.max(np.abs(misfit), axis=(-1, -2), keepdims=True)[..., 0] < 1e-9
    return np.asarray(np.where(settled, code, np.nan), float)


def _phase_equilibrium(asked: Reals, amplitude: Reals, code: Reals) -> Reals:
    known = np.isfinite(code)
    coefficients = laws.phase_mean_coefficients(amplitude, np.where(known, code, 0.0))
    top = _bisect(lambda phase: -laws.phase_mean_slope(coefficients, phase), np.full(code.shape, law.HALF_PI))
    wanted = np.abs(asked)
    reached = laws.sine_series(coefficients, top) >= wanted
    phase = _bisect(lambda phase: laws.sine_series(coefficients, phase) - wanted, top)
    return np.asarray(np.where(known & reached, np.sign(asked) * phase, np.nan), float)


def _bisect(rising: Callable[[Reals], Reals], high: Reals) -> Reals:
    low = np.zeros(high.shape)
    for _ in range(54):
        middle = 0.5 * (low + high)
        above = rising(middle) > 0.0
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return np.asarray(0.5 * (low + high), float)


class TwoStep(NamedTuple):
    """chosen : (...) satellite with the largest parameter. alarm : (...) whether it is beyond a limit."""

    chosen: Integers
    alarm: Booleans


def parameter(code_chips: ArrayLike, phase_rad: ArrayLike) -> Reals:
    """xi = 0.5 (|dC| / 0.5 + |dphi| / (pi / 4)), section 3.2 of the paper."""
    return np.asarray(np.abs(code_chips) + 2.0 / np.pi * np.abs(phase_rad), float)


def two_step(
    code_chips: ArrayLike,
    phase_rad: ArrayLike,
    *,
    code_limit_chips: float = CODE_LIMIT_CHIPS,
    phase_limit_rad: float = PHASE_LIMIT_RAD,
) -> TwoStep:
    """The paper's rule on discriminators (..., n): look at the satellite with the largest parameter only."""
    u, q = np.abs(np.asarray(code_chips, float)), np.abs(np.asarray(phase_rad, float))
    chosen = np.argmax(parameter(u, q), axis=-1)
    beyond = (u > code_limit_chips) | (q > phase_limit_rad)
    return TwoStep(chosen, np.take_along_axis(beyond, chosen[..., None], axis=-1)[..., 0])


def detection_probability(
    amplitude: ArrayLike,
    code_chips: ArrayLike = 0.0,
    phase_rad: ArrayLike = 0.0,
    *,
    code_limit_chips: ArrayLike = CODE_LIMIT_CHIPS,
    phase_limit_rad: ArrayLike = PHASE_LIMIT_RAD,
) -> Reals:
    """P_1 = 1 - P_0 of one satellite chosen beforehand (26), (27): P_FA (30) at offsets zero, P_D (31) at the settled
    ones.

    Takes code and phase as independent, which holds to 0.5 % at amplitude 4.5 and better above (the prompt is 0.5
    correlated with early and late).
    """
    code = laws.code_tail(code_limit_chips, amplitude, code_chips)
    phase = laws.phase_tail(phase_limit_rad, amplitude, phase_rad, code_chips)
    return np.asarray(code + phase - code * phase, float)


def rule_alarm_probability(
    amplitude: ArrayLike,
    code_chips: ArrayLike,
    phase_rad: ArrayLike,
    *,
    code_limit_chips: float = CODE_LIMIT_CHIPS,
    phase_limit_rad: float = PHASE_LIMIT_RAD,
) -> float:
    """Probability that the rule alarms, with its choice of the largest parameter: the true false-alarm probability at
    offsets zero (n,), the true power elsewhere.

    Silent if the chosen satellite is within both limits and every other has a smaller parameter:
    sum over m of the integral over the box |u| <= T1, |q| <= T2 of p_m(u, q) prod_{i != m} F_i(xi(u, q)), F_i the
    distribution of a satellite's parameter. Code and phase are taken as independent, as in (26).
    """
    arrays = (np.asarray(x, float) for x in (amplitude, code_chips, phase_rad))
    a, code, phase = (np.atleast_1d(x) for x in np.broadcast_arrays(*arrays))
    x, w = np.polynomial.legendre.leggauss(160)
    u, q = code_limit_chips * x, phase_limit_rad * x
    density_u = code_limit_chips * w * laws.code_density(u, a[:, None], code[:, None])
    density_q = phase_limit_rad * w * law.phase_density(q, a[:, None], phase[:, None], code[:, None])
    xi = np.linspace(0.0, float(parameter(code_limit_chips, phase_limit_rad)), 200)
    kinds, which = np.unique(np.stack((a, code, phase), axis=-1), axis=0, return_inverse=True)
    below = np.stack([_parameter_below(xi, *kind) for kind in kinds])[which.reshape(-1)]
    at = parameter(u[:, None], q[None, :])
    rest = np.stack([np.prod(np.delete(below, m, axis=0), axis=0) for m in range(a.size)])
    silent = [
        float(np.sum(density_u[m][:, None] * density_q[m][None, :] * np.interp(at, xi, rest[m]))) for m in range(a.size)
    ]
    return 1.0 - sum(silent)


def _parameter_below(xi: Reals, amplitude: float, code_chips: float, phase_rad: float) -> Reals:
    """Prob(parameter <= xi) of one satellite, (k,)."""
    x, w = np.polynomial.legendre.leggauss(200)
    reach = np.minimum(xi, 0.5)[:, None]
    u = reach * x
    knots = np.linspace(0.0, law.HALF_PI, 4001)
    pair = sum(law.phase_density(side * knots, amplitude, phase_rad, code_chips) for side in (-1.0, 1.0))
    within = cumulative_trapezoid(pair, knots, initial=0.0)
    at = np.interp(np.maximum(xi[:, None] - np.abs(u), 0.0) * law.HALF_PI, knots, within)
    return np.asarray(np.sum(reach * w * laws.code_density(u, amplitude, code_chips) * at, axis=-1), float)


def block_rate(rate_per_s: float, sums: ArrayLike, *, coherent_s: float = 1e-3) -> Reals:
    """False-alarm probability p_K of one of the tests of K sums that gives `rate_per_s` in each second."""
    return np.asarray(-np.expm1(np.log1p(-rate_per_s) * np.asarray(sums, float) * coherent_s), float)


def limit_scale(amplitude: float, satellites: int, probability: float) -> float:
    """Factor on both limits of the paper with which all `satellites` together alarm with `probability`."""
    each = -np.expm1(np.log1p(-probability) / satellites)

    def excess(scale: float) -> float:
        limits = {"code_limit_chips": scale * CODE_LIMIT_CHIPS, "phase_limit_rad": scale * PHASE_LIMIT_RAD}
        return float(np.log(np.maximum(detection_probability(amplitude, **limits), 1e-300)) - np.log(each))

    return float(brentq(excess, 1e-4, 5.0, xtol=1e-9))
