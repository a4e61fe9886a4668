"""A receiver that follows satellites from the first sample on, without a search: where its loops alone are timed."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from waves import Cell, add, noise, pair_of

from skyproof.arrays import Floats
from skyproof.receiver.acquisition import Peak
from skyproof.receiver.tracking import Receiver, ReceiverSettings, ReceiverState


def following(
    rate_hz: float, sats: Sequence[str], duration_s: float, rng: np.random.Generator
) -> tuple[Receiver, ReceiverState, Floats]:
    """The receiver, its state before the first sample, and samples (2, n) of a signal of each satellite in noise."""
    receiver = Receiver(rate_hz, 0.0, ReceiverSettings(sats=tuple(sats), full_search_s=1e6, near_search_s=1e6))
    state = ReceiverState(frame=1, tail=np.zeros((1, 2, 0), np.float32))
    planes, cell = noise(rng, round(duration_s * rate_hz)), Cell(apart_chips=0.5, relative_db=0.0, apart_hz=0.0)
    for sat in sats:
        wave = replace(pair_of(rng, cell, 0.0, 0.0, duration_s + 0.1)[0], sat=sat)
        add(wave, 0, planes, rate_hz)
        peak = Peak(
            sat=sat, delay_s=wave.delay_s, doppler_hz=wave.doppler_hz, cn0_dbhz=wave.cn0_dbhz, power=100.0, p_value=0.0
        )
        state = receiver.start_channel(state, peak)
    return receiver, state, planes
