"""What a joint channel knows before it begins: the correlation's shape, the times of its looks, its thresholds."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Reals
from skyproof.decomposition.fit import Dictionary
from skyproof.decomposition.shape import Filter, code_dictionary, filter_loss, quiet_lags
from skyproof.gnss.signals import SignalPlan
from skyproof.receiver import joint as j
from skyproof.receiver.components import Candidates, birth_threshold
from skyproof.receiver.joint import JointSettings
from skyproof.receiver.replica import passed

__all__ = ["QUIET_TAPS", "JointModel"]

WINDOW_CHIPS = 1.6
REACH_CHIPS = 2.2
QUIET_TAPS = 4
SUSPICION = 0.05
"""Of rows with nothing more in them, so many are followed by another."""


@dataclass(frozen=True, eq=False, kw_only=True)
class JointModel:
    """What does not change while a satellite is followed.

    code : (n,) of +1 and -1. false_births_per_h : of a channel on clean sky. most : signals at once.
    low_pass : amplitude that the replica keeps at frequencies in cycles a sample, nothing from half a cycle on.
    front_end : likewise of the samples; None where they hold all that the replica lets through.
    """

    signal: SignalPlan
    code: NDArray[np.int8]
    rate_hz: float
    periods_per_look: int = 4
    bits_per_row: int = 10
    false_births_per_h: float = 0.01
    most: int = 2
    settings: JointSettings = field(default_factory=JointSettings)
    low_pass: Filter = passed
    front_end: Filter | None = None

    @property
    def look_s(self) -> float:
        """Duration of a look."""
        return self.periods_per_look * self.signal.period_s

    @property
    def bit_s(self) -> float:
        """Duration of a data bit."""
        return self.signal.periods_per_symbol * self.signal.period_s

    @cached_property
    def bit_times_s(self) -> Reals:
        """Of the looks of a bit, about its middle."""
        n = self.signal.periods_per_symbol // self.periods_per_look
        return np.asarray((np.arange(n) + 0.5) * self.look_s - 0.5 * self.bit_s, np.float64)

    @cached_property
    def row_times_s(self) -> Reals:
        """Of the looks of a row, about its middle."""
        n = self.bits_per_row * self.bit_times_s.size
        return np.asarray((np.arange(n) + 0.5) * self.look_s - 0.5 * self.bits_per_row * self.bit_s, np.float64)

    @property
    def chips_per_sample(self) -> float:
        """At the nominal rate."""
        return self.signal.chip_rate_hz / self.rate_hz

    @cached_property
    def taps_chips(self) -> Reals:
        """Delays of the replicas, later positive: one a sample, and then `QUIET_TAPS` that show noise alone."""
        side = int(REACH_CHIPS / self.chips_per_sample)
        near = np.arange(-side, side + 1) * self.chips_per_sample
        # A whole number of samples as well, so that all are rounded alike.
        quiet = quiet_lags(self.code, QUIET_TAPS)
        return np.concatenate([near, np.rint(quiet / self.chips_per_sample) * self.chips_per_sample])

    @property
    def band_cycles(self) -> float:
        """Highest frequency of the replica, cycles a chip."""
        return 0.5 / self.chips_per_sample

    @cached_property
    def dictionary(self) -> Dictionary:
        """Of the taps that show signals."""
        return code_dictionary(
            self.code,
            self.taps_chips[:-QUIET_TAPS].tolist(),
            self._replica,
            None if self.front_end is None else self._front_end,
            band_cycles=self.band_cycles,
            window_chips=WINDOW_CHIPS,
        )

    @cached_property
    def loss(self) -> float:
        """Of C/N0 by the replica's low-pass."""
        return filter_loss(self._replica, band_cycles=self.band_cycles)

    @cached_property
    def candidates(self) -> Candidates:
        """Where further signals are looked for."""
        return Candidates.of(self.dictionary, self.band_cycles, self.bits_per_row * self.bit_s)

    @cached_property
    def threshold(self) -> float:
        """Of the score at which a signal is born."""
        probability = self.false_births_per_h * self.bits_per_row * self.bit_s / 3600.0
        return birth_threshold(probability, self.dictionary, self.candidates, self.row_times_s, self.look_s)

    @cached_property
    def suspicion(self) -> float:
        """Of the score at which another row is worth its time."""
        return birth_threshold(SUSPICION, self.dictionary, self.candidates, self.row_times_s, self.look_s)

    def _replica(self, cycles: Reals) -> Reals:
        return self.low_pass(cycles * self.chips_per_sample)

    def _front_end(self, cycles: Reals) -> Reals:
        assert self.front_end is not None
        return self.front_end(cycles * self.chips_per_sample)

    def energy(self, cn0_dbhz: float) -> float:
        """Amplitude squared, in sigmas of a look, of a signal of this strength."""
        return float(10.0 ** (0.1 * cn0_dbhz) * self.look_s * self.loss)

    def cn0_dbhz(self, mean: Reals) -> Reals:
        """Strengths (n,) of signals (n, N_STATE)."""
        energy = mean[..., j.RE] ** 2 + mean[..., j.IM] ** 2
        return np.asarray(10.0 * np.log10(np.maximum(energy, 1e-9) / (self.look_s * self.loss)))
