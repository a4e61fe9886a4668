"""Choose each channel's loops by its age, its bits and its strength; none while it coasts."""

from dataclasses import replace

import numpy as np

from skyproof.arrays import Reals
from skyproof.receiver import coasting
from skyproof.receiver import kernels as k
from skyproof.receiver.settings import LoopSettings, ReceiverSettings
from skyproof.receiver.state import ReceiverState

__all__ = ["set_loops", "steer"]

WEAK_HYSTERESIS_DB = 2.0


def steer(state: ReceiverState, settings: ReceiverSettings, now_s: float) -> ReceiverState:
    """Set integration and bandwidths by what is known of each channel."""
    loops = state.loops.copy()
    for channel, loop, course in zip(state.channels, loops, state.courses, strict=True):
        if np.isfinite(course[coasting.SINCE_S]):
            set_loops(loop, replace(_choice(loop, settings), pll_bandwidth_hz=0.0, dll_bandwidth_hz=0.0))
            continue
        pulls_in = now_s - channel.began_s < settings.pull_in_s - 1e-9 or now_s < course[coasting.PULL_UNTIL_S] - 1e-9
        choice = settings.pull_in if pulls_in else _choice(loop, settings)
        if pulls_in:
            loop[k.CODE_STEER] = 0.0
        elif loop[k.CODE_STEER] != 0.0:  # the measurement steers, which knows what of the error is another signal's
            choice = replace(choice, dll_bandwidth_hz=0.0)
        set_loops(loop, choice)
    return replace(state, loops=loops)


def _choice(loop: Reals, settings: ReceiverSettings) -> LoopSettings:
    if loop[k.BIT_START] < 0.0:
        return settings.searching_bits
    is_weak = loop[k.INTEGRATION] == settings.weak.integration
    limit = settings.weak_dbhz + (WEAK_HYSTERESIS_DB if is_weak else 0.0)
    return settings.weak if loop[k.CN0_DBHZ] < limit else settings.tracking


def set_loops(loop: Reals, choice: LoopSettings) -> None:
    """Write the settings into a channel's row (N_STATE,)."""
    loop[k.INTEGRATION] = choice.integration
    loop[k.PLL_BANDWIDTH] = choice.pll_bandwidth_hz
    loop[k.FLL_BANDWIDTH] = choice.fll_bandwidth_hz
    loop[k.DLL_BANDWIDTH] = choice.dll_bandwidth_hz
