"""Compute amplitudes of signals and sigmas of noise in correlators, behind the recorder if it counts."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from skyproof.arrays import Reals
from skyproof.simulator.correlation import Correlation
from skyproof.simulator.correlator_coupling import StraightSpans, WaveEdges
from skyproof.simulator.received import ReceiverSky
from skyproof.simulator.recorder import compute_recorded
from skyproof.simulator.scenario import FrontEnd

__all__ = ["CorrelatorLevels", "compute_levels"]


@dataclass(frozen=True, eq=False, kw_only=True)
class CorrelatorLevels:
    """amplitude : (n_epochs, n_rows) of correlation. sigma : (n_epochs, n_channels), of noise in I and in Q."""

    amplitude: Reals
    sigma: Reals


def compute_levels(
    sky: ReceiverSky,
    front_end: FrontEnd,
    rows: WaveEdges,
    spans: StraightSpans,
    coherent_s: float,
    tables: Correlation,
    others: Literal["neglected", "noise"],
    quantised: bool,
    channel_sats: Sequence[str],
) -> CorrelatorLevels:
    at_s, signal = spans.middle_true_s, sky.signal
    power = 10.0 ** (sky.cn0_dbhz(at_s)[:, rows.of] / 10.0) / front_end.band_hz  # over the noise's
    power *= np.array([1.0] * len(sky.signals) + [ray.amplitude**2 for ray in sky.rays])
    begin_s, end_s = rows.windows_s[..., 0], rows.windows_s[..., 1]
    now = ((begin_s <= at_s[:, np.newaxis, np.newaxis]) & (at_s[:, np.newaxis, np.newaxis] <= end_s)).any(axis=2)
    of_signals = np.where(now, power, 0.0)
    lines = np.zeros(at_s.size) + sum(jammer.power_at(at_s) for jammer in sky.jammers)
    total = sky.noise_power(at_s) + of_signals.sum(axis=1) + lines
    gain, variance = compute_recorded(front_end, total) if quantised else (np.ones(at_s.size), total)

    # what is white, then what only the replica's spectrum lets through
    white = variance - gain**2 * (of_signals.sum(axis=1) + lines)
    noise = (white + gain**2 * sky.line_power(at_s, front_end.band_hz))[:, np.newaxis] * np.ones(len(channel_sats))
    if others == "noise":
        near = np.abs(np.fft.fftfreq(tables.signal.shape[1], 1.0 / (signal.code_length))) < 2.0
        through = np.sum(tables.signal[:, near] ** 2, axis=1).mean() / tables.points  # 2/3 for chips
        other = np.array(rows.sats)[:, np.newaxis] != np.array(channel_sats)
        noise += gain[:, np.newaxis] ** 2 * (of_signals @ other) * through * front_end.band_hz / signal.chip_rate_hz
    real = front_end.kind == "real"  # half of a real signal's amplitude, and of the noise's power, meets the replica
    return CorrelatorLevels(
        amplitude=gain[:, np.newaxis] * np.sqrt((0.5 if real else 2.0) * power),
        sigma=np.sqrt((0.5 if real else 1.0) * noise / (front_end.rate_hz * coherent_s)),
    )
