"""Laws of code and carrier discriminators: densities, means and tails, exact beside the paper's."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from skyproof.arrays import Complexes, Reals
from skyproof.detectors.correlators.correlator_laws import (
    HALF_PI,
    REACH,
    Form,
    code_amplitudes,
    code_angle_density,
    phase_density,
    triangle,
)

__all__ = [
    "code_density",
    "code_discriminator",
    "code_mean",
    "code_probability",
    "code_sigma_chips",
    "code_tail",
    "combine_taps",
    "phase_mean",
    "phase_mean_by_integral",
    "phase_mean_coefficients",
    "phase_mean_slope",
    "phase_probability",
    "phase_sigma_rad",
    "phase_tail",
    "prompt_amplitude",
    "sine_series",
]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(128)  # as 400 give, to 1e-12


def prompt_amplitude(cn0_dbhz: ArrayLike, sums: ArrayLike = 1, *, coherent_s: float = 1e-3) -> Reals:
    """Compute A_K = sqrt(2 T K C/N0): prompt over its noise in one component, `sums` = K."""
    return np.asarray(np.sqrt(2.0 * coherent_s * np.asarray(sums, float) * 10.0 ** (np.asarray(cn0_dbhz) / 10)), float)


def combine_taps(taps: Complexes, *, axis: int) -> Complexes:
    """Average K integrations of (..., 3) early, prompt, late after wiping the prompt's sign (23).

    `axis` is that of the integrations, not the last. The sign is wrong with probability Q(A_1 cos(phase)): 4e-6 at 40
    dB-Hz and 1 ms, 0.08 at 30. Below 35 dB-Hz sum over whole bits first.
    """
    sign = np.where(taps[..., 1:2].real < 0.0, -1.0, 1.0)
    return np.asarray(np.mean(taps * sign, axis=axis))


def code_discriminator(early: ArrayLike, late: ArrayLike) -> Reals:
    """Compute 0.5 (|E| - |L|) / (|E| + |L|) in chips, positive where the received code is ahead."""
    e, lt = np.abs(early), np.abs(late)
    return np.asarray(0.5 * (e - lt) / (e + lt), float)


def code_density(value_chips: ArrayLike, amplitude: ArrayLike, code_chips: ArrayLike = 0.0) -> Reals:
    """Compute the density of the code discriminator, per chip; zero outside (-0.5, 0.5)."""
    value = np.asarray(value_chips, float)
    inside = np.abs(value) < 0.5
    angle = 0.25 * np.pi - np.arctan(2.0 * np.where(inside, value, 0.0))
    density = code_angle_density(angle, amplitude, code_chips) * 2.0 / (1.0 + 4.0 * value**2)
    return np.asarray(np.where(inside, density, 0.0), float)


def _integrate(
    density: Callable[[Reals], Reals], low: ArrayLike, high: ArrayLike, peak: Reals, width: ArrayLike
) -> Reals:
    """Integrate `density(angle (..., nodes))` over (low, high), within `REACH` widths of the peak."""
    reach = REACH * np.asarray(width, float)
    a = np.maximum(np.asarray(low, float), peak - reach)
    b = np.maximum(np.minimum(np.asarray(high, float), peak + reach), a)
    half = 0.5 * (b - a)[..., None]
    return np.asarray(np.sum(half * _WEIGHTS * density(0.5 * (a + b)[..., None] + half * _NODES), axis=-1), float)


def _integrate_code(low: ArrayLike, high: ArrayLike, amplitude: ArrayLike, code_chips: ArrayLike, power: int) -> Reals:
    """Integrate the density times the discriminator to a power over angles (low, high)."""
    a, c, low, high = np.broadcast_arrays(*(np.asarray(x, float) for x in (amplitude, code_chips, low, high)))
    a1, a2 = code_amplitudes(a, c)

    def integrand(angle: Reals) -> Reals:
        density = code_angle_density(angle, a[..., None], c[..., None])
        return density * (0.5 * np.tan(0.25 * np.pi - angle)) ** power if power else density

    return _integrate(integrand, low, high, np.arctan2(a2, a1), 1.0 / np.maximum(np.hypot(a1, a2), 1e-3))


def code_mean(amplitude: ArrayLike, code_chips: ArrayLike) -> Reals:
    """Compute gamma1 (18): the mean of the code discriminator.

    Never reaches the offset, since the weaker tap is Rice-biased.
    """
    return _integrate_code(0.0, HALF_PI, amplitude, code_chips, 1)


def code_sigma_chips(amplitude: ArrayLike, code_chips: ArrayLike = 0.0) -> Reals:
    """Compute the standard deviation of the code discriminator; 1 / (sqrt(2) A) for large A."""
    mean = code_mean(amplitude, code_chips)
    return np.asarray(np.sqrt(_integrate_code(0.0, HALF_PI, amplitude, code_chips, 2) - mean**2), float)


def _limits(limit_chips: ArrayLike) -> tuple[Reals, Reals]:
    """Return the angles between which |discriminator| <= limit."""
    half = np.arctan(2.0 * np.minimum(np.asarray(limit_chips, float), 0.5))
    return 0.25 * np.pi - half, 0.25 * np.pi + half


def code_probability(limit_chips: ArrayLike, amplitude: ArrayLike, code_chips: ArrayLike = 0.0) -> Reals:
    """Compute Prob(|code discriminator| <= limit), first factor of (26)."""
    low, high = _limits(limit_chips)
    return _integrate_code(low, high, amplitude, code_chips, 0)


def code_tail(limit_chips: ArrayLike, amplitude: ArrayLike, code_chips: ArrayLike = 0.0) -> Reals:
    """Compute Prob(|code discriminator| > limit), the tail itself: small ones keep their digits."""
    low, high = _limits(limit_chips)
    below = _integrate_code(0.0, low, amplitude, code_chips, 0)
    return np.asarray(below + _integrate_code(high, HALF_PI, amplitude, code_chips, 0), float)


def _integrate_phase(
    low: ArrayLike,
    high: ArrayLike,
    amplitude: ArrayLike,
    phase_rad: ArrayLike,
    code_chips: ArrayLike,
    power: int = 0,
    form: Form = "corrected",
) -> Reals:
    """Integrate over (low, high), which may reach beyond pi/2 since the density has period pi."""
    arrays = (np.asarray(x, float) for x in (amplitude, phase_rad, code_chips, low, high))
    a, p, c, low, high = np.broadcast_arrays(*arrays)
    width = np.minimum(1.0 / np.maximum(a * triangle(c), 1e-3), HALF_PI / REACH)

    def integrand(angle: Reals) -> Reals:
        density = phase_density(angle, a[..., None], p[..., None], c[..., None], form=form)
        return density * angle**power if power else density

    # The peak comes again each half turn; each one is integrated over its own half turn at most.
    peaks = (_integrate(integrand, low, high, p + turn, width) for turn in (-np.pi, 0.0, np.pi))
    return np.asarray(sum(peaks), float)


def phase_probability(
    limit_rad: ArrayLike,
    amplitude: ArrayLike,
    phase_rad: ArrayLike = 0.0,
    code_chips: ArrayLike = 0.0,
    *,
    form: Form = "corrected",
) -> Reals:
    """Compute Prob(|phase discriminator| <= limit), second factor of (26).

    With limit pi/2 the density's whole integral.
    """
    limit = np.minimum(np.asarray(limit_rad, float), HALF_PI)
    return _integrate_phase(-limit, limit, amplitude, phase_rad, code_chips, form=form)


def phase_tail(
    limit_rad: ArrayLike, amplitude: ArrayLike, phase_rad: ArrayLike = 0.0, code_chips: ArrayLike = 0.0
) -> Reals:
    """Compute Prob(|phase discriminator| > limit), the tail itself."""
    limit = np.minimum(np.asarray(limit_rad, float), HALF_PI)
    return _integrate_phase(limit, np.pi - limit, amplitude, phase_rad, code_chips)


def phase_mean_by_integral(amplitude: ArrayLike, phase_rad: ArrayLike, code_chips: ArrayLike = 0.0) -> Reals:
    """Compute gamma2 (18) as the integral over the density."""
    return _integrate_phase(-HALF_PI, HALF_PI, amplitude, phase_rad, code_chips, power=1)


def phase_sigma_rad(amplitude: ArrayLike, phase_rad: ArrayLike = 0.0, code_chips: ArrayLike = 0.0) -> Reals:
    """Compute the standard deviation of the phase discriminator; 1 / A for large A at offset zero."""
    mean = phase_mean_by_integral(amplitude, phase_rad, code_chips)
    return np.asarray(
        np.sqrt(_integrate_phase(-HALF_PI, HALF_PI, amplitude, phase_rad, code_chips, power=2) - mean**2), float
    )


def phase_mean_coefficients(amplitude: ArrayLike, code_chips: ArrayLike = 0.0) -> Reals:
    """Compute coefficients (..., m) of gamma2 = sum of c_m sin(2 m phase), m = 1, 2, ...

    (-1)^(m+1)/m sqrt(pi rho)/2 [I_(m-1/2) + I_(m+1/2)](rho/2) exp(-rho/2), rho = (A R(code))^2/2.
    """
    level = np.asarray(amplitude, float) * triangle(code_chips)
    orders = np.arange(1.0, 12.0 + np.ceil(4.5 * float(np.max(level, initial=1.0))))
    rho = 0.5 * level[..., None] ** 2
    bessel = special.ive(orders - 0.5, 0.5 * rho) + special.ive(orders + 0.5, 0.5 * rho)
    return np.asarray((-1.0) ** (orders + 1) / orders * 0.5 * np.sqrt(np.pi * rho) * bessel, float)


def phase_mean(amplitude: ArrayLike, phase_rad: ArrayLike, code_chips: ArrayLike = 0.0) -> Reals:
    """Compute gamma2 (18): the mean of the phase discriminator, by its series.

    Rises to a maximum and falls to 0 at pi/2.
    """
    return sine_series(phase_mean_coefficients(amplitude, code_chips), np.asarray(phase_rad, float))


def sine_series(coefficients: Reals, phase_rad: Reals) -> Reals:
    """Sum over m of coefficients (..., m) times sin(2 m phase (...))."""
    orders = np.arange(1.0, coefficients.shape[-1] + 1.0)
    return np.asarray(np.sum(coefficients * np.sin(2.0 * orders * phase_rad[..., None]), axis=-1), float)


def phase_mean_slope(coefficients: Reals, phase_rad: Reals) -> Reals:
    """Compute the derivative of gamma2 by the phase, from `phase_mean_coefficients`."""
    orders = np.arange(1.0, coefficients.shape[-1] + 1.0)
    return np.asarray(np.sum(2.0 * orders * coefficients * np.cos(2.0 * orders * phase_rad[..., None]), axis=-1), float)
