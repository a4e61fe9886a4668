"""The detector over `sqm`: is early equal to late, as noise allows?"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import special

from skyproof.arrays import Reals
from skyproof.detectors.base import missing, undecided
from skyproof.detectors.correlators.correlator_laws import prompt_amplitude
from skyproof.detectors.correlators.sqm import delta_law, delta_metric
from skyproof.errors import SettingsError, require_probability
from skyproof.records import Evidence, Need, Observations, Records, SignalId, SignalRef, Taps

__all__ = ["Sqm", "SqmSettings", "level_dbhz", "pair_of_taps"]


@dataclass(frozen=True)
class SqmSettings:
    """Settings of `Sqm`.

    false_alarm_probability : of all signals and epochs of a receiver's window together.
    distortion_allowed : of delta, that echoes and the antenna's filter make without an attack; 0 makes the test exact.
    """

    false_alarm_probability: float = 1e-3
    distortion_allowed: float = 0.02

    def __post_init__(self) -> None:
        require_probability("sqm", "false_alarm_probability", self.false_alarm_probability)
        if self.distortion_allowed < 0.0:
            raise SettingsError(f"sqm: distortion_allowed is {self.distortion_allowed}, expected 0 or more")


def pair_of_taps(taps: Taps) -> tuple[float, int, int, int] | None:
    """Spacing in chips and places of early, prompt and late: the widest pair within a chip that stands evenly about the
    prompt; None if there is none. Early is the replica ahead."""
    delays = taps.delays_chips
    prompt = np.flatnonzero(np.abs(delays) < 1e-6)
    for early in np.argsort(-delays):
        late = np.flatnonzero(np.abs(delays + delays[early]) < 1e-6)
        if prompt.size and late.size and 1e-6 < delays[early] < 1.0:
            return float(delays[early]), int(early), int(prompt[0]), int(late[0])
    return None


def level_dbhz(observations: Observations, signals: tuple[SignalId, ...]) -> Reals:
    """Median C/N0 of each signal over the window, (n,); NaN where it was not measured."""
    column = {signal: i for i, signal in enumerate(observations.signals)}
    levels = np.full(len(signals), np.nan)
    for i, signal in enumerate(signals):
        if signal in column:
            known = observations.cn0_dbhz[:, column[signal]]
            known = known[np.isfinite(known)]
            levels[i] = np.median(known) if known.size else np.nan
    return levels


class Sqm:
    """The detector: one Evidence per receiver and window, from observations and `taps`, a tuple of `Taps`.

    The statistic is the smallest p-value of delta over signals and epochs, made one of all: exact for white noise of
    known C/N0, taps without a band limit, and loops that leave the pair alone. A filter that rounds the peak makes
    alarms rarer. A loop that holds this very pair equal adds its jitter to sums T shorter than its time, about 2 B T of
    the variance, and takes noise and distortion alike from longer ones.
    """

    name = "sqm"
    needs = (Need.OBSERVATIONS, Need.TAPS)

    def __init__(self, settings: SqmSettings | None = None) -> None:
        self.settings = settings or SqmSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Evidence], Any]:
        """Evidence of one window; never raises for what the data lack."""
        lacking = missing(self, records)
        if lacking:
            return lacking, state
        by_receiver = {o.receiver: o for o in records.observations}
        return [self._receiver(records, by_receiver.get(taps.receiver), taps) for taps in records.taps], state

    def _receiver(self, records: Records, observations: Observations | None, taps: Taps) -> Evidence:
        refs = tuple(SignalRef(taps.receiver, signal) for signal in taps.signals)
        pair = pair_of_taps(taps)
        if pair is None or observations is None or observations.averaged_s <= 0.0:
            return undecided(
                self,
                records,
                refs,
                because=f"{taps.receiver} has no prompt with early and late about it, or no C/N0",
                would_need="correlators at -d, 0 and +d chip, and observations averaged over their time",
            )
        spacing, early, prompt, late = pair
        amplitude = prompt_amplitude(level_dbhz(observations, taps.signals), coherent_s=observations.averaged_s)
        value = taps.value[:, :, int(np.argmin(np.abs(taps.dopplers_hz)))].astype(np.complex128)
        delta = np.abs(delta_metric(value[..., early], value[..., prompt], value[..., late]))
        law = delta_law(spacing)
        excess = np.maximum(delta - self.settings.distortion_allowed, 0.0)
        p_value = 2.0 * special.ndtr(-amplitude * excess / np.sqrt(law.noise + delta**2))
        known = np.isfinite(p_value)
        if not known.any():
            return undecided(
                self,
                records,
                refs,
                because=f"no signal of {taps.receiver} was tracked with a known C/N0",
                would_need="signals tracked over the window",
            )
        together = -np.expm1(known.sum() * np.log1p(-np.minimum(np.where(known, p_value, 1.0), 1.0 - 1e-16)))
        alpha = self.settings.false_alarm_probability
        smallest = float(together.min())
        worst = np.unravel_index(int(np.argmin(together)), together.shape)
        attack = smallest < alpha
        named = np.flatnonzero((together < alpha).any(axis=0)) if attack else np.flatnonzero(known.any(axis=0))
        return Evidence(
            detector=self.name,
            start_gpst=records.start_gpst,
            end_gpst=records.end_gpst,
            subject=tuple(refs[k] for k in named),
            says="attack" if attack else "clean",
            because=f"early minus late of {taps.signals[worst[1]]} in {taps.receiver} is up to {delta[worst]:.3f} of "
            f"the prompt, {'more than' if attack else 'as'} noise and an allowed distortion of "
            f"{self.settings.distortion_allowed:g} explain",
            statistic=float(delta[worst]),
            false_alarm_probability=alpha,
            p_value=smallest,
        )
