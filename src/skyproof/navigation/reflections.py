"""How far reflections shift the averaged code of each signal, from what discriminators show off the carrier.

Reflections of complex amplitude sum a_i exp(j phi_i) change early less late over prompt, in units of code, by a complex
offset D. Its real part is what the code loop takes for a delay: the range is off by it, and the loop removes it. Its
imaginary part stays visible. With alpha the reflection over the direct signal and f, g of delay, spacing and band,

    D = alpha f / (1 + alpha g),  |alpha g| < 1,

is analytic in alpha and zero at zero. Its mean square over an even phase is zero (mean value property), so

    E (Re D)^2 = E (Im D)^2,  for any delay, power, spacing and band,

and likewise for means over time and products between satellites. The relation of error and spacing is that of R. D. J.
van Nee, "Reducing multipath tracking errors in spread-spectrum ranging systems", Electronics Letters 28(8), 1992. What
it needs is a phase that is even over satellites or time: paths differ by many wavelengths from satellite to satellite.
Reflections that come and go within a measurement leave a mean error of the order alpha^2 that is not seen.
"""

import numpy as np

from skyproof.arrays import Reals

__all__ = ["estimate_reflection_sigma_m"]

_OWN_SHARE = 0.5
"""Chosen, of the variance: signals differ, but one phase may hide a reflection."""
_FEWEST = 2
"""Signals less than that have no variance of the t distribution that the mean square of theirs leads to."""


def estimate_reflection_sigma_m(quadrature_m: Reals, thermal_m: Reals, *, own_share: float = _OWN_SHARE) -> Reals:
    """Estimate one sigma (..., k) of the errors that reflections add to averaged ranges.

    The variance is `own_share` of the signal's own square, the rest of that of all n signals, the sum of squares over n
    - 2: the variance of Student's t with n degrees of freedom. Thermal noise is taken off. A signal of which nothing is
    known has that of all.

    quadrature_m : (..., k) averaged as the ranges are, NaN where unknown. thermal_m : (..., k) its noise, one sigma.
    """
    known = np.isfinite(quadrature_m) & np.isfinite(thermal_m)
    own_m2 = np.where(known, quadrature_m**2 - thermal_m**2, 0.0)
    degrees = np.maximum(known.sum(axis=-1, keepdims=True) - _FEWEST, 1)
    all_m2 = np.maximum(own_m2.sum(axis=-1, keepdims=True), 0.0) / degrees
    own_m2 = np.where(known, np.maximum(own_m2, 0.0), all_m2)
    return np.asarray(np.sqrt(own_share * own_m2 + (1.0 - own_share) * all_m2))
