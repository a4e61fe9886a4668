"""Coast: loops continue without their signal while it has faded, and close again when it is back.

Two signals of a satellite that overlap beat: their sum vanishes for tenths of a second and longer, and loops closed on
noise alone wander off. A frame whose prompts have no more power than noise (a Gamma variable, the number of prompts its
shape) is a fade. The channel then keeps its course: the Doppler and its rate as measured before. The common change of
all other channels is added: it is the oscillator's, and the common part of the receiver's motion. Code follows the
carrier. When the power is back the loops are closed where they are, and the carrier counts as slipped.
"""

import numpy as np
from scipy import special

from skyproof.arrays import Booleans, Reals
from skyproof.receiver import kernels as k

__all__ = ["AT_S", "N_COURSE", "QUIET_S", "SINCE_S", "coast", "has_power", "update_courses"]

# Columns of a channel's course (float64).
AT_S = 0  # receiver time of Doppler and rate; NaN before the first measurement
DOPPLER_HZ = 1
RATE_HZ_S = 2
SINCE_S = 3  # since when it coasts; NaN while its loops are closed
PULL_UNTIL_S = 4  # until when its loops pull in after a long fade
QUIET_S = 5  # the last row of measurements in which not all carriers jumped: its time, carrier, Doppler
QUIET_CYC = 6
QUIET_HZ = 7
N_COURSE = 8

DOPPLER_SHARE, RATE_SHARE = 0.3, 0.02
"""Of what a measurement differs from the course by, which moves Doppler and rate: over a second, and over ten."""
LEAST_COMMON = 3
"""So many other channels tell what is common to all."""
LONG_S = 1.0
"""After a longer fade the Doppler may be off by more than a phase loop pulls in alone."""


def has_power(loops: Reals, noise: float, probability: float) -> Booleans:
    """Tell if each channel's prompts of a frame have more power than noise alone exceeds with this probability.

    loops : (n_channels, N_STATE). noise : power of noise in the prompt of one code period.
    """
    count = loops[:, k.LOCK_COUNT]
    power = loops[:, k.LOCK_I] + loops[:, k.LOCK_Q]
    return np.asarray((count > 0.0) & (power > noise * special.gammainccinv(np.maximum(count, 1.0), probability)))


def update_courses(courses: Reals, doppler_hz: Reals, good: Booleans, elapsed_s: float) -> Reals:
    """Update the courses with a row of measurements.

    doppler_hz : (n_channels,); the `good` ones count. The other channels move by the median departure of these from
    their courses.
    """
    courses = courses.copy()
    known = np.isfinite(courses[:, AT_S])
    away_s = np.where(known, elapsed_s - courses[:, AT_S], 0.0)
    ahead_hz = courses[:, DOPPLER_HZ] + courses[:, RATE_HZ_S] * away_s
    measured = good & known
    more_hz = np.where(measured, doppler_hz - ahead_hz, 0.0)
    if measured.sum() >= LEAST_COMMON:
        more_hz[~measured] = np.median(more_hz[measured])
    courses[known, DOPPLER_HZ] = (ahead_hz + DOPPLER_SHARE * more_hz)[known]
    courses[known, RATE_HZ_S] += (RATE_SHARE * more_hz / np.maximum(away_s, 1e-3))[known]
    courses[known, AT_S] = elapsed_s
    new = good & ~known
    courses[new, AT_S], courses[new, DOPPLER_HZ], courses[new, RATE_HZ_S] = elapsed_s, doppler_hz[new], 0.0
    return courses


def coast(
    loops: Reals,
    courses: Reals,
    there: Booleans,
    now_s: float,
    if_hz: float,
    nominal: tuple[float, float],
    pull_s: float,
) -> tuple[Reals, Reals]:
    """Return loops and courses at the end of a frame: channels whose signal is not `there` coast.

    nominal : chip rate and carrier, Hz. pull_s : for how long the loops pull in after a long fade.

    A channel that was never measured does not coast.
    """
    loops, courses = loops.copy(), courses.copy()
    since_s = courses[:, SINCE_S]
    back = there & np.isfinite(since_s)
    loops[back, k.SLIPPED] = 1.0
    loops[back, k.RESIDUAL] = np.nan
    courses[back & (now_s - since_s > LONG_S), PULL_UNTIL_S] = now_s + pull_s
    courses[there, SINCE_S] = np.nan
    gone = ~there & np.isfinite(courses[:, AT_S])
    courses[gone & np.isnan(since_s), SINCE_S] = now_s
    doppler_hz = (courses[:, DOPPLER_HZ] + courses[:, RATE_HZ_S] * (now_s - courses[:, AT_S]))[gone]
    chip_rate_hz, carrier_hz = nominal
    loops[gone, k.PLL_VELOCITY] = doppler_hz
    loops[gone, k.PLL_ACCELERATION] = courses[gone, RATE_HZ_S]
    loops[gone, k.FREQUENCY] = if_hz + doppler_hz
    loops[gone, k.CODE_RATE] = chip_rate_hz * (1.0 + doppler_hz / carrier_hz)
    loops[gone, k.CODE_STEER] = 0.0
    return loops, courses
