"""The signals and reflections of a scene at one antenna, as functions of the sampling clock."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Integers, Reals
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.simulator import align_channels, correlate
from skyproof.simulator.received import Scene, find_rows

__all__ = ["SIGNAL", "STEP_S", "Waves", "compute_waves"]

STEP_S = 0.1
"""Phases and delays are parabolas over each; amplitudes are those of its middle."""
SIGNAL = GPS_L1_CA


@dataclass(frozen=True, eq=False)
class Waves:
    """Signals and reflections at one antenna, over steps of `STEP_S` of the sampling clock.

    code_s, turns_cyc : (n_steps, n_waves, 3) of 1, u, u^2 with u from 0 to 1 over the step: time of transmission less
        that of the sampling clock, and the carrier's phase in the samples. amplitude : (n_steps, n_waves), of a sample.
    white : (n_steps, n_waves) variance of a sample's noise in I and in Q for that satellite; power : (n_steps,) mean of
        I^2 + Q^2 of samples. symbols, guesses : (n_waves, n_symbols); guessed : (n_waves,) share of a symbol's first
        code period. lead_s : of the first symbol before the scene.
    """

    sats: tuple[str, ...]
    code_s: Reals
    turns_cyc: Reals
    amplitude: Reals
    white: Reals
    power: Reals
    symbols: NDArray[np.int8]
    guesses: NDArray[np.int8]
    guessed: Reals
    lead_s: float

    def of(self, sat: str) -> Integers:
        """Select the waves of a satellite."""
        return np.flatnonzero(np.array(self.sats) == sat)


def compute_waves(scene: Scene, index: int) -> Waves:
    """Compute the waves at antenna number `index` over the whole scene."""
    sky, front_end = scene.skies[index], scene.scenario.front_end
    if front_end.kind != "complex":
        raise ValueError("samples must be complex")
    n_steps = math.ceil(scene.scenario.duration_s / STEP_S) + 2
    knots_s = STEP_S * np.arange(2 * n_steps + 1) / 2.0
    ahead_s = sky.true_minus_elapsed_s(knots_s)
    true_s = knots_s + ahead_s
    of = np.array([*range(len(sky.signals)), *(ray.of for ray in sky.rays)], np.int64)
    code_s, carrier_s = (each[:, of].copy() for each in sky.delays_s(true_s))
    for row, ray in enumerate(sky.rays, len(sky.signals)):
        further_s = ray.further_s(true_s)
        code_s[:, row] += further_s
        carrier_s[:, row] += further_s - (ray.phase_cyc + ray.rate_hz * true_s) / SIGNAL.carrier_hz
    turns_cyc = SIGNAL.carrier_hz * (ahead_s[:, None] - carrier_s) + front_end.if_hz * knots_s[:, None]
    middle_s = STEP_S * (np.arange(n_steps) + 0.5)
    seen: dict[str, Any] = {
        "delays_chips": (0.0,),
        "coherent_s": SIGNAL.period_s,
        "tracked": align_channels(scene, index),
    }
    alone, among = (correlate(scene, index, middle_s, others=each, **seen) for each in ("neglected", "noise"))
    parts = alone.parts
    direct = (parts.channel == parts.signal) & (parts.ray < 0)
    amplitude = np.zeros((n_steps, len(sky.signals)))
    amplitude[:, parts.signal[direct]] = np.abs(parts.weight[:, direct])
    amplitude = amplitude[:, of] * np.array([1.0] * len(sky.signals) + [ray.amplitude for ray in sky.rays])
    sampled = front_end.rate_hz * SIGNAL.period_s
    rows, messages = find_rows(scene.messages, [sky.signals[column] for column in of]), scene.messages
    return Waves(
        sats=tuple(sky.signals[column].id.sat for column in of),
        code_s=_parabolas(ahead_s[:, None] - code_s),
        turns_cyc=_parabolas(turns_cyc),
        amplitude=amplitude,
        white=among.noise_sigma[:, of] ** 2 * sampled,
        power=2.0 * alone.noise_sigma[:, 0] ** 2 * sampled + np.sum(amplitude**2, axis=1),
        symbols=messages.symbols[rows],
        guesses=messages.guesses[rows],
        guessed=messages.guess_s[rows] / SIGNAL.period_s,
        lead_s=messages.lead_s,
    )


def _parabolas(values: Reals) -> Reals:
    """Fit parabolas through start, middle and end of each step: (2 n_steps + 1, n) to (n_steps, n, 3)."""
    first, middle, last = values[:-2:2], values[1::2], values[2::2]
    return np.stack([first, 4.0 * middle - 3.0 * first - last, 2.0 * (first + last) - 4.0 * middle], axis=-1)
