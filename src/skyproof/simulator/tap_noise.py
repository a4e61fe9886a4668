"""Draw noise of correlator taps with the covariance of their replicas."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from skyproof.arrays import Complexes, ComplexFloats, Integers, Reals
from skyproof.gnss.signals import SignalPlan
from skyproof.simulator.correlation import Correlation, read
from skyproof.simulator.correlator_coupling import StraightSpans, WaveEdges, compute_couplings

__all__ = ["TapNoise"]

_RIDGE = 1e-9  # of the noise, that keeps the root of its covariance real where taps are nearly one


class TapNoise:
    """Noise of all taps with the covariance that the replicas give, of variance 1 in I and in Q."""

    def __init__(
        self,
        tables: Correlation,
        delays: Reals,
        dopplers: Reals,
        coherent_s: float,
        signal: SignalPlan,
        lobe_chips: float,
    ) -> None:
        self.tables, self.dopplers, self.coherent_s, self.signal = tables, dopplers, coherent_s, signal
        apart = np.subtract.outer(delays, delays)
        self.reach_chips = float(np.ptp(delays)) + lobe_chips
        self.of_delays = [_factor(read(table, apart, tables.points)).T.astype(np.float32) for table in tables.replica]
        self.of_dopplers = _factor(np.sinc(np.subtract.outer(dopplers, dopplers) * coherent_s)).astype(np.float32)
        distances, which = np.unique(np.round(apart, 12), return_inverse=True)  # few, if taps stand evenly
        self.apart: Reals = np.asarray(distances, np.float64)
        self.which: Integers = np.asarray(which, np.int64).reshape(delays.size, delays.size)

    def draw(
        self,
        rng: np.random.Generator,
        draws: tuple[int, ...],
        channel_sats: Sequence[str],
        sats: Sequence[str],
        spans: StraightSpans,
        channels: WaveEdges,
    ) -> ComplexFloats:
        """(*draws, n_epochs, n_channels, n_dopplers, n_delays)."""
        cell = self.dopplers.size, self.which.shape[0]
        count, epochs = math.prod(draws), spans.true_s.shape[0]
        noise = np.empty((count, epochs, len(channel_sats), *cell), np.complex64)
        for number, sat in enumerate(sats):
            mine = [channel for channel, name in enumerate(channel_sats) if name == sat]
            near = self._find_near(mine, channels)
            far = np.setdiff1d(np.arange(epochs), near)
            if far.size:
                shape = 2, count, far.size, len(mine), *cell
                mixed = rng.standard_normal((math.prod(shape[:-1]), cell[1]), np.float32) @ self.of_delays[number]
                if cell[0] > 1:
                    mixed = self.of_dopplers @ mixed.reshape(-1, *cell)
                mixed = mixed.reshape(shape)
                noise[:, far[:, np.newaxis], mine] = mixed[0] + 1j * mixed[1]
            if near.size:
                together = self._draw_together(rng, count, near, mine, self.tables.replica[number], spans, channels)
                noise[:, near[:, np.newaxis], mine] = together
        return noise.reshape(*draws, *noise.shape[1:])

    def _find_near(self, mine: list[int], channels: WaveEdges) -> Integers:
        """Find the epochs in which replicas of these channels overlap."""
        late_chips = channels.code_s[..., mine] * self.signal.chip_rate_hz
        distance = np.diff(np.sort(late_chips, axis=-1), axis=-1)
        return np.flatnonzero((distance < self.reach_chips).any(axis=(1, 2)))

    def _draw_together(
        self,
        rng: np.random.Generator,
        count: int,
        near: Integers,
        mine: list[int],
        table: Reals,
        spans: StraightSpans,
        channels: WaveEdges,
    ) -> ComplexFloats:
        """Draw channels of one satellite in these epochs: (count, n_near, n_mine, n_dopplers, n_delays)."""
        pairs = np.array([(first, second) for first in mine for second in mine])
        apart_hz = np.subtract.outer(self.dopplers, self.dopplers).ravel()
        those = StraightSpans(elapsed_s=spans.elapsed_s[near], true_s=spans.true_s[near])
        taken = replace(
            channels, code_s=channels.code_s[near], carrier_s=channels.carrier_s[near], sent=channels.sent[near]
        )
        lag_chips, _, coupling = compute_couplings(those, taken, taken, pairs, apart_hz, self.signal)
        n, d, k = len(mine), self.dopplers.size, self.which.shape[0]
        common = coupling.sum(axis=2).reshape(-1, n, n, d, d)
        lags = read(table, lag_chips.mean(axis=1).reshape(-1, n, n, 1) + self.apart, self.tables.points)
        if n == 2 and d == 1:
            return self._draw_two(rng, count, common[:, 0, 1, 0, 0], lags[:, 0, 1][:, self.which], table)
        # axes: epoch, channel, channel, doppler, doppler, delay, delay
        covariance = common[..., np.newaxis, np.newaxis] * lags[..., self.which][:, :, :, np.newaxis, np.newaxis]
        root = _factor(covariance.transpose(0, 1, 3, 5, 2, 4, 6).reshape(near.size, n * d * k, n * d * k))
        normals = rng.standard_normal((near.size, n * d * k, 2 * count), np.float32)
        mixed = root.astype(np.complex64) @ normals.view(np.complex64)
        return np.asarray(mixed.reshape(-1, n, d, k, count).transpose(4, 0, 1, 2, 3))

    def _draw_two(
        self, rng: np.random.Generator, count: int, common: Complexes, alike: Reals, table: Reals
    ) -> ComplexFloats:
        """Draw the same for two channels without Doppler taps, four times faster.

        But for one turn the covariance is real, and its first block is known.
        """
        k = self.which.shape[0]
        known = _factor(read(table, self.apart, self.tables.points)[self.which])
        shared = np.linalg.inv(known) @ (np.abs(common)[:, np.newaxis, np.newaxis] * alike)
        rest = known @ known.T - shared.transpose(0, 2, 1) @ shared
        own_root = np.linalg.cholesky(rest + 10.0 * _RIDGE * np.eye(k))
        normals = rng.standard_normal((2, common.size, k, 2 * count), np.float32)
        first_noise = known.astype(np.float32) @ normals[0]
        second_noise = (
            shared.transpose(0, 2, 1).astype(np.float32) @ normals[0] + own_root.astype(np.float32) @ normals[1]
        )
        turn = np.exp(-1j * np.angle(common)).astype(np.complex64)[:, np.newaxis, np.newaxis]
        mixed = np.stack(
            [first_noise.view(np.complex64), second_noise.view(np.complex64) * turn], axis=1
        )  # epoch, channel, tap, draw
        return np.asarray(mixed.transpose(3, 0, 1, 2)[:, :, :, np.newaxis])


def _factor(covariance: Reals | Complexes) -> Reals | Complexes:
    """Factor covariances of variance 1, (..., n, n), to lower triangles."""
    return np.asarray(np.linalg.cholesky(covariance + _RIDGE * np.eye(covariance.shape[-1])))
