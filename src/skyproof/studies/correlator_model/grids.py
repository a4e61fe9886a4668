"""Correlation grids whose values are drawn; which intervals there are and what they show is the receiver's own."""

from collections.abc import Sequence
from concurrent.futures import Executor

import numpy as np

from skyproof.arrays import Complexes, Floats, Integers, Reals
from skyproof.gnss.signals import prn_of
from skyproof.receiver import kernels as k
from skyproof.receiver.grids import (
    DOPPLER_HZ,
    FRACTION_S,
    NOISE,
    NOISE_TAPS,
    Bursts,
    GridCorrelator,
    align_replica,
    find_first_row,
)
from skyproof.receiver.replica import CODE_SCALE
from skyproof.studies.correlator_model.correlation import interpolate, noise_root, tabulate_correlation
from skyproof.studies.correlator_model.waves import SIGNAL, STEP_S, Waves

__all__ = ["ModelGrids"]


class ModelGrids(GridCorrelator):
    """Correlation grids that are drawn. waves : what arrives."""

    def __init__(
        self, like: GridCorrelator, bandwidth_hz: float | None, waves: Waves, rng: np.random.Generator
    ) -> None:
        super().__init__(like.asked, like.rate_hz, like.if_hz, like.signal, like._code_phases)
        if self.dopplers_hz.tolist() != [0.0] or self.periods != SIGNAL.periods_per_symbol:
            raise ValueError("grids are drawn at one Doppler, over one data bit")
        self._bandwidth_hz, self.waves, self._rng = bandwidth_hz, waves, rng

    def _fill(
        self,
        bursts: Bursts,
        samples: Floats,
        first_sample: int,
        frame: tuple[Reals, Integers],
        bit_start: Reals,
        sats: Sequence[str],
        times_s: Reals,
        threads: Executor,
        n_threads: int,
    ) -> None:
        """Draw the values of every channel that knows its bits and has a whole burst."""
        rows, counts = frame
        for channel, sat in enumerate(sats):
            numbers = rows[channel, : counts[channel], k.OUT_PERIOD]
            first = find_first_row(numbers, bit_start[channel], self.periods)
            begins = first + self.periods * np.arange(times_s.size)
            if bit_start[channel] < 0.0 or begins[-1] + self.periods > counts[channel]:
                continue
            value, meta = self._draw(sat, rows[channel], begins, times_s)
            bursts.value[channel, :, 0] = CODE_SCALE * value
            bursts.meta[channel] = meta
            bursts.periods[channel] = np.rint(numbers[begins])

    def _draw(self, sat: str, rows: Reals, begins: Integers, times_s: Reals) -> tuple[Complexes, Reals]:
        """Return values (n_intervals, n_delays) and the columns of `Bursts.meta`."""
        correlation = tabulate_correlation(prn_of(sat), self.rate_hz, self._bandwidth_hz, self.band_hz)
        first, last = rows[begins], rows[begins + self.periods - 1]
        code_rate_hz, carrier_hz = SIGNAL.chip_rate_hz, SIGNAL.carrier_hz
        frequency_hz, chips_per_sample = np.array(
            [
                align_replica(row, end, self.rate_hz, self.if_hz, code_rate_hz, carrier_hz)
                for row, end in zip(first, last, strict=True)
            ]
        ).T
        start, chip = first[:, k.OUT_START], first[:, k.OUT_CHIP]
        n = np.ceil((self.periods * SIGNAL.code_length - chip) / chips_per_sample)
        value = np.zeros((begins.size, self.delays_chips.size), np.complex128)
        w, at_s = self.waves, (start + 0.5 * (n - 1.0)) / self.rate_hz
        step = np.minimum((at_s / STEP_S).astype(np.int64), w.amplitude.shape[0] - 1)
        u = at_s / STEP_S - step
        for wave in w.of(sat):
            sent_s = at_s + np.sum(w.code_s[step, wave] * np.stack([u**0, u, u * u], axis=1), axis=1)
            lag = sent_s * code_rate_hz - chip - 0.5 * (n - 1.0) * chips_per_sample
            a, b, c = w.turns_cyc[step, wave].T
            off_hz = (b + 2.0 * u * c) / STEP_S - frequency_hz
            cycles = a + u * (b + u * c) - frequency_hz * 0.5 * (n - 1.0) / self.rate_hz
            sign = w.symbols[wave, ((w.lead_s + sent_s) / SIGNAL.symbol_s).astype(np.int64)]
            size = w.amplitude[step, wave] * np.sinc(off_hz * n / self.rate_hz) * sign
            turn = np.exp(2j * np.pi * cycles)
            value += (size * turn)[:, None] * interpolate(correlation.signal, lag[:, None] + self.delays_chips)
        white = w.white[step, w.of(sat)[0]]
        root = noise_root(correlation.replica, self.delays_chips)
        noise = self._rng.standard_normal((*value.shape, 2)) @ np.array([1.0, 1.0j])
        value += np.sqrt(white / n)[:, None] * (noise @ root.T)
        freedom = 2 * NOISE_TAPS * begins.size
        measured = self._rng.chisquare(freedom) / freedom
        meta = np.empty((begins.size, 3))
        meta[:, FRACTION_S] = (chip + (times_s * self.rate_hz - start) * chips_per_sample) / code_rate_hz
        meta[:, DOPPLER_HZ] = frequency_hz - self.if_hz
        meta[:, NOISE] = CODE_SCALE**2 * 2.0 * float(np.mean(white / n)) * correlation.replica[0] * measured
        return value, meta
