"""Guide loops: the replica goes where one position and clock of all channels put it.

A guide for a channel holds from one row of measurements to the next, and lapses. Loops that are not guided any more
close on their own, as those of a scalar receiver do. The code's loop is

    replica + discriminator + correction = prediction,

so that the replica itself goes there, whatever the discriminator measures. The carrier's loop closes on its own
discriminator with a correction beside it, pi T (predicted - measured Doppler); T is 1 ms, whatever is summed. While a
signal is blocked, its carrier follows the predicted Doppler.

X. Zhang, H. Li, C. Yang and M. Lu, IET Radar, Sonar & Navigation, 2020, doi 10.1049/iet-rsn.2020.0021, (6), (7).
"""

from typing import Final

import numpy as np

from skyproof.arrays import Booleans, Reals
from skyproof.gnss.signals import SignalPlan
from skyproof.receiver import kernels as k

__all__ = [
    "AT_S",
    "CORRECTION_HZ",
    "DOPPLER_HZ",
    "N_GUIDE",
    "SENT_S",
    "SINCE_S",
    "UNTIL_S",
    "guide_loops",
    "is_guided",
    "no_guide",
    "read_loops",
]

# Columns of a channel's guide (float64); NaN without one.
AT_S = 0  # receiver time of what is predicted
SENT_S = 1  # what the received code shows then: time since the channel's code period 0 began
DOPPLER_HZ = 2
CORRECTION_HZ = 3  # predicted less measured Doppler
UNTIL_S = 4  # receiver time at which it lapses
SINCE_S = 5  # since when the channel was guided all the time
N_GUIDE = 6

COUPLING_S: Final = 1e-3
"""T of the carrier's correction."""
LARGEST_CHIPS_S: Final = 5.0


def is_guided(guides: Reals, now_s: float) -> Booleans:
    """Tell which channels (n_channels,) have a guide (n_channels, N_GUIDE) that holds."""
    return np.asarray(guides[:, UNTIL_S] > now_s + 1e-9)


def no_guide() -> Reals:
    """Return the guide (N_GUIDE,) of a channel that is to run unguided at once."""
    guide = np.zeros(N_GUIDE)
    guide[UNTIL_S] = -np.inf
    return guide


def read_loops(loops: Reals, at_s: float, *, rate_hz: float, if_hz: float, signal: SignalPlan) -> tuple[Reals, Reals]:
    """Return what the replicas (n, N_STATE) show at a receiver time near by: as `SENT_S`, and the Doppler."""
    doppler_hz = loops[:, k.FREQUENCY] - if_hz
    shown_s = (loops[:, k.PERIODS] + loops[:, k.CHIP] / signal.code_length) * signal.period_s
    return shown_s + (at_s - loops[:, k.START] / rate_hz) * (1.0 + doppler_hz / signal.carrier_hz), doppler_hz


def guide_loops(
    loops: Reals,
    guides: Reals,
    unseen: Booleans,
    now_s: float,
    *,
    frame_s: float,
    rate_hz: float,
    if_hz: float,
    signal: SignalPlan,
) -> tuple[Reals, Reals]:
    """Return loops (n_channels, N_STATE) as guided for the next frame, and the guides that have not lapsed.

    unseen : (n_channels,) whose phase is not held: their carriers follow the prediction. now_s : the frame's end.
    """
    active = is_guided(guides, now_s)
    lapsed = ~active & np.isfinite(guides[:, AT_S])
    if not active.any() and not lapsed.any():
        return loops, guides
    loops, guides = loops.copy(), guides.copy()
    loops[lapsed, k.CODE_STEER] = 0.0
    loops[~active, k.CARRIER_CORRECTION] = 0.0
    guides[lapsed] = np.nan
    guide, loop = guides[active], loops[active]
    blind = unseen[active]
    loop[blind, k.PLL_VELOCITY] = guide[blind, DOPPLER_HZ]
    loop[blind, k.PLL_ACCELERATION] = 0.0
    loop[blind, k.FREQUENCY] = if_hz + guide[blind, DOPPLER_HZ]
    start_s = loop[:, k.START] / rate_hz
    shown_s = (loop[:, k.PERIODS] + loop[:, k.CHIP] / signal.code_length) * signal.period_s
    wanted_s = guide[:, SENT_S] + (start_s - guide[:, AT_S]) * (1.0 + guide[:, DOPPLER_HZ] / signal.carrier_hz)
    away_chips = (wanted_s - shown_s) * signal.chip_rate_hz
    pace = signal.chip_rate_hz / signal.carrier_hz * (guide[:, DOPPLER_HZ] - loop[:, k.PLL_VELOCITY])
    steer = np.clip(away_chips / frame_s + pace, -LARGEST_CHIPS_S, LARGEST_CHIPS_S)
    loop[:, k.CODE_STEER] = steer
    loop[:, k.CODE_RATE] = signal.chip_rate_hz * (1.0 + loop[:, k.PLL_VELOCITY] / signal.carrier_hz) + steer
    loop[:, k.DLL_BANDWIDTH] = 0.0
    loop[:, k.CARRIER_CORRECTION] = np.where(blind, 0.0, 0.5 * COUPLING_S * guide[:, CORRECTION_HZ])
    loops[active] = loop
    return loops, guides
