"""Allan deviation of phases (or of integrals of rates), overlapping, with confidence limits."""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtri

from skyproof.arrays import Reals

__all__ = ["AllanDeviation", "NoiseKind", "allan_deviation", "allan_freedom"]

NoiseKind = Literal["white phase", "flicker phase", "white", "flicker", "random walk"]
"""Of the frequency, where the name does not say phase; a gyro's angular random walk is "white" here."""


class AllanDeviation(NamedTuple):
    """Per averaging time: tau_s (m,); deviation, lower, upper (..., m), in units of the phase per second."""

    tau_s: Reals
    deviation: Reals
    lower: Reals
    upper: Reals


def allan_deviation(
    phase: ArrayLike,
    interval_s: float,
    factors: Sequence[int],
    *,
    noise: NoiseKind = "white",
    confidence: float = 0.9,
) -> AllanDeviation:
    """Estimate the overlapping Allan deviation and its confidence limits (NIST SP 1065, 5.2.4 and 5.4).

    Parameters
    ----------
    phase : (..., n), evenly spaced; of a rate, its integral: n - 1 rates times the interval, summed from zero on.
    factors : averaging times as multiples of the interval; each from 1 to (n - 1) // 2.
    noise : which noise the limits hold for; the deviation itself does not depend on it.

    Raises
    ------
    ValueError : a factor does not fit the length.
    """
    phase = np.asarray(phase, np.float64)
    n = phase.shape[-1]
    if not factors or min(factors) < 1 or 2 * max(factors) > n - 1:
        raise ValueError(f"factors must be from 1 to {(n - 1) // 2} for {n} phases, not {list(factors)}")
    tau_s = interval_s * np.asarray(factors, np.float64)
    bends = (phase[..., 2 * m :] - 2.0 * phase[..., m:-m] + phase[..., : -2 * m] for m in factors)
    deviation = np.sqrt(np.stack([np.mean(bend**2, axis=-1) for bend in bends], axis=-1) / 2.0) / tau_s
    freedom = np.array([allan_freedom(n, m, noise) for m in factors])
    tail = 0.5 * (1.0 - confidence)
    return AllanDeviation(
        tau_s=tau_s,
        deviation=deviation,
        lower=deviation * np.sqrt(freedom / chdtri(freedom, tail)),
        upper=deviation * np.sqrt(freedom / chdtri(freedom, 1.0 - tail)),
    )


def allan_freedom(n: int, m: int, noise: NoiseKind) -> float:
    """Return the equivalent degrees of freedom of the overlapping Allan variance of n phases at m intervals.

    Howe, Allan, Barnes 1981, as NIST SP 1065, table 5 prints them: within some per cent of the truth.
    """
    match noise:
        case "white phase":
            freedom = (n + 1) * (n - 2 * m) / (2.0 * (n - m))
        case "flicker phase":
            freedom = np.exp(np.sqrt(np.log((n - 1) / (2.0 * m)) * np.log((2 * m + 1) * (n - 1) / 4.0)))
        case "white":
            freedom = (3.0 * (n - 1) / (2.0 * m) - 2.0 * (n - 2) / n) * 4.0 * m**2 / (4.0 * m**2 + 5.0)
        case "flicker" if m == 1:
            freedom = 2.0 * (n - 2) / (2.3 * n - 4.9) * (n - 2)
        case "flicker":
            freedom = 5.0 * n**2 / (4.0 * m * (n + 3.0 * m))
        case "random walk":
            freedom = (n - 2) / m * ((n - 1) ** 2 - 3.0 * m * (n - 1) + 4.0 * m**2) / (n - 3) ** 2
    return float(max(freedom, 1.0))
