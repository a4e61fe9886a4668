"""The detector over `vector_sqm` and `vector_parity`: do a vector receiver's channels fit one place?"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.base import missing, undecided
from skyproof.detectors.correlators.correlator_laws import code_discriminator, phase_discriminator, prompt_amplitude
from skyproof.detectors.correlators.vector_parity import (
    explanations,
    parity_test,
    parity_threshold,
    parity_vector,
    separability,
    whitener,
)
from skyproof.detectors.correlators.vector_sqm import satellite_geometry
from skyproof.errors import SettingsError, require_probability
from skyproof.navigation.least_squares import design_matrix, line_of_sight
from skyproof.navigation.ranges import corrected_ranges
from skyproof.navigation.window import window_mean
from skyproof.records import Evidence, NavigationData, Need, Observations, Records, SignalId, SignalRef, Taps

__all__ = ["VectorSqm", "VectorSqmSettings"]


@dataclass(frozen=True)
class VectorSqmSettings:
    """Settings of `VectorSqm`.

    false_alarm_probability : of each receiver's window, for thermal noise. Multipath and errors of the orbits shift
        channels as well; windows beyond some tenths of a second see them.
    min_satellites : five can be tested, six are needed to name one.
    """

    false_alarm_probability: float = 1e-3
    min_satellites: int = 5

    def __post_init__(self) -> None:
        require_probability("vector_sqm", "false_alarm_probability", self.false_alarm_probability)
        if self.min_satellites < 5:
            raise SettingsError(f"vector_sqm: min_satellites is {self.min_satellites}; four always fit, take 5 or more")


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


class VectorSqm:
    """The detector: one Evidence per receiver and window, from `vector_taps`, a tuple of `Taps` whose
    channels one solution steers, with early and late half a chip from the prompt.

    The window is one sum. Its statistic is chi-square with 2 (n - 4) degrees without an attack. Taps of scalar tracking
    show nothing here: each channel follows its own signal.
    """

    name = "vector_sqm"
    needs = (Need.OBSERVATIONS, Need.NAVIGATION, Need.SETS, Need.VECTOR_TAPS)

    def __init__(self, settings: VectorSqmSettings | None = None) -> None:
        self.settings = settings or VectorSqmSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Evidence], Any]:
        """Evidence of one window; never raises for what the data lack."""
        lacking = missing(self, records)
        if lacking or records.navigation is None:
            return lacking, state
        by_receiver = {o.receiver: o for o in records.observations}
        return [
            self._receiver(records, records.navigation, by_receiver.get(taps.receiver), taps)
            for taps in records.vector_taps
        ], state

    def _receiver(
        self, records: Records, navigation: NavigationData, observations: Observations | None, taps: Taps
    ) -> Evidence:
        refs = tuple(SignalRef(taps.receiver, signal) for signal in taps.signals)
        positions = [s.position_ecef_m for s in records.sets if s.receiver == taps.receiver]
        pair = pair_of_taps(taps)
        if observations is None or observations.gpst.size == 0 or observations.averaged_s <= 0.0 or not positions:
            return undecided(
                self,
                records,
                refs,
                because=f"no position or no averaged observations of {taps.receiver}",
                would_need="pseudoranges of five or more satellites with their orbits",
            )
        if pair is None or abs(pair[0] - 0.5) > 1e-6:
            return undecided(
                self,
                records,
                refs,
                because=f"{taps.receiver} has no early and late at half a chip",
                would_need="correlators at -0.5, 0 and +0.5 chip",
            )
        _, early, prompt, late = pair
        value = taps.value[:, :, int(np.argmin(np.abs(taps.dopplers_hz)))].astype(np.complex128)
        design = _design(observations, navigation, taps, positions[0])
        level = level_dbhz(observations, taps.signals)
        tracked = np.isfinite(value).all(axis=(0, 2))
        kept = np.flatnonzero(tracked & np.isfinite(design).all(axis=1) & np.isfinite(level))
        if kept.size < self.settings.min_satellites or np.linalg.matrix_rank(design[kept]) < 4:
            return undecided(
                self,
                records,
                refs,
                because=f"{kept.size} satellites in {taps.receiver} tracked through the window",
                would_need=f"{self.settings.min_satellites} or more satellites tracked through the window",
            )
        summed = value[:, kept].mean(axis=0)
        u = code_discriminator(summed[:, early], summed[:, late])
        q = phase_discriminator(summed[:, prompt])
        where = satellite_geometry(design[kept])
        amplitude = prompt_amplitude(level[kept], value.shape[0], coherent_s=observations.averaged_s)
        white = whitener(where.parity, amplitude)
        test = parity_test(parity_vector(u, q, white))
        alpha = self.settings.false_alarm_probability
        attack = float(test.p_value) < alpha
        because = f"{kept.size} channels of {taps.receiver} sit where one position and clock put them"
        if attack:
            found = explanations(parity_vector(u, q, white, scores=False), white, alpha)
            named = [" and ".join(str(taps.signals[kept[k]]) for k in each.satellites) for each in found[:6]]
            because = (
                f"{kept.size} channels of {taps.receiver} do not fit one position and clock; explained by "
                f"{', or '.join(named)}{' or others' if len(found) > 6 else ''} alone (smallest singular value of two "
                f"satellites' directions {separability(where.parity, 1):.2g})"
            )
        return Evidence(
            detector=self.name,
            start_gpst=records.start_gpst,
            end_gpst=records.end_gpst,
            subject=tuple(refs[k] for k in kept),
            says="attack" if attack else "clean",
            because=because,
            statistic=float(test.statistic),
            threshold=float(parity_threshold(alpha, kept.size)),
            false_alarm_probability=alpha,
            p_value=float(test.p_value),
        )


def _design(observations: Observations, navigation: NavigationData, taps: Taps, position_ecef_m: Reals) -> Reals:
    """Rows of the geometry, (n, 4), by the taps' channels; NaN where a satellite's place is not known."""
    mean = window_mean(observations)
    ranges = corrected_ranges(mean.signals, np.array([mean.gpst]), mean.pseudorange_m[None, :], navigation)
    _, unit, _ = line_of_sight(ranges.satellite_ecef_m[0], position_ecef_m)
    rows = {signal: row for signal, row in zip(mean.signals, design_matrix(unit), strict=True)}
    return np.array([rows.get(signal, np.full(4, np.nan)) for signal in taps.signals])
