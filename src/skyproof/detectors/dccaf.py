"""Two skies in signals that overlap: the detector over `decomposition` and `inverse_raim`.

Each satellite's correlation is taken apart into one or two signals, as many as its count test says; then the signals
left over by the best consistent set are searched for a second one, of five satellites at least. Echoes make second
signals, too, but no second position. Which sky is true the correlation does not tell: `navigation.exclusion` does.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from skyproof.detectors.base import missing, undecided
from skyproof.detectors.decomposition import (
    CountTest,
    Decomposition,
    Dictionary,
    count_statistic,
    count_test,
    taps_dictionary,
)
from skyproof.detectors.inverse_raim import passing_sets, second_subset, set_states
from skyproof.errors import SettingsError
from skyproof.gnss.constants import CA_CHIP_RATE_HZ, SPEED_OF_LIGHT_M_S
from skyproof.gnss.time import week_and_tow
from skyproof.navigation.chance import chance_p_value, set_combinations
from skyproof.navigation.least_squares import gauss_newton, line_of_sight
from skyproof.navigation.ranges import atmosphere, corrected_ranges
from skyproof.records import Ccaf, Evidence, NavigationData, Reals, Records, SignalRef
from skyproof.statistics.distributions import chi_square_threshold

__all__ = ["Dccaf", "DccafSettings", "Delays", "delays_of"]

_CHIP_M = SPEED_OF_LIGHT_M_S / CA_CHIP_RATE_HZ
_SEED = 20190601  # of the simulated law of the count: the same in every run


@dataclass(frozen=True)
class DccafSettings:
    """Settings of `Dccaf`.

    false_alarm_probability : that unrelated second signals pass for a second sky, in each receiver and window.
    second_signal_probability : that a satellite alone is said to have two signals, divided by the number of satellites.
    set_probability : that a true set fails its chi-square test.
    multipath_sigma_m, ionosphere_share : as for `residual`.
    window_chips : delays are searched this far to both sides of the reference.
    count_runs : simulated correlations for the law of the count, once for each front end.
    """

    false_alarm_probability: float = 1e-3
    second_signal_probability: float = 0.01
    set_probability: float = 1e-3
    multipath_sigma_m: float = 1.0
    ionosphere_share: float = 0.25
    window_chips: float = 1.3
    count_runs: int = 4000

    def __post_init__(self) -> None:
        for name in ("false_alarm_probability", "second_signal_probability", "set_probability"):
            if not 0.0 < getattr(self, name) < 1.0:
                raise SettingsError(f"dccaf: {name} is {getattr(self, name)}, expected between 0 and 1")


class Delays(NamedTuple):
    """delay_chips, sigma_chips (channels, 2): NaN for a second signal that is not there; p_value (channels,) of "one
    signal". Strongest first."""

    delay_chips: Reals
    sigma_chips: Reals
    p_value: Reals


def delays_of(ccaf: Ccaf, epoch: int, settings: DccafSettings) -> Delays:
    """One or two delays of each channel at one epoch, of the Doppler bin nearest to the reference."""
    row = int(np.argmin(np.abs(ccaf.dopplers_hz)))
    taps = np.asarray(ccaf.value[epoch, :, row, :], np.complex128)
    variance = ccaf.noise_variance[epoch]
    there = np.isfinite(taps).all(axis=1) & np.isfinite(variance) & np.isfinite(ccaf.reference_m[epoch])
    points = tuple(float(x) for x in ccaf.delays_chips)
    dictionary, law = _law(points, ccaf.band_hz, settings.window_chips, settings.count_runs, ccaf.noise_samples)
    n = len(there)
    delay, sigma, p_value = np.full((n, 2), np.nan), np.full((n, 2), np.nan), np.full(n, np.nan)
    if not there.any():
        return Delays(delay, sigma, p_value)
    statistic, one, two = count_statistic(taps[there], dictionary, variance[there])
    p_value[there] = law.p_value(statistic)
    double = p_value[there] < settings.second_signal_probability / there.sum()
    delay[there], sigma[there] = _strongest_first(one, two, double)
    return Delays(delay, sigma, p_value)


@lru_cache(maxsize=16)
def _law(
    points: tuple[float, ...], band_hz: float, window_chips: float, runs: int, noise_samples: int | None
) -> tuple[Dictionary, CountTest]:
    dictionary = taps_dictionary(points, band_hz, window_chips=window_chips)
    return dictionary, count_test(dictionary, np.random.default_rng(_SEED), runs=runs, noise_samples=noise_samples)


def _strongest_first(one: Decomposition, two: Decomposition, double: Any) -> tuple[Reals, Reals]:
    order = np.argsort(-np.abs(two.amplitude), axis=-1)
    spread = np.sqrt(np.diagonal(two.covariance, axis1=-2, axis2=-1))
    alone = np.full((len(double), 1), np.nan)
    delay = np.where(double[:, None], np.take_along_axis(two.delay_chips, order, axis=-1),
                     np.concatenate((one.delay_chips, alone), axis=1))  # fmt: skip
    sigma = np.where(double[:, None], np.take_along_axis(spread, order, axis=-1),
                     np.concatenate((np.sqrt(one.covariance[:, :, 0]), alone), axis=1))  # fmt: skip
    return delay, sigma


class Dccaf:
    """The detector: one Evidence per receiver and window, of the last epoch in which most channels are there."""

    name = "dccaf"
    needs = ("ccaf", "navigation")

    def __init__(self, settings: DccafSettings | None = None) -> None:
        self.settings = settings or DccafSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Evidence], Any]:
        """Evidence of one window; `records.extras["ccaf"]` is a sequence of `Ccaf`."""
        lacking = missing(self, records)
        if lacking or records.navigation is None:
            return lacking, state
        return [self._receiver(records, records.navigation, ccaf) for ccaf in records.extras["ccaf"]], state

    def _receiver(self, records: Records, navigation: NavigationData, ccaf: Ccaf) -> Evidence:
        every = tuple(SignalRef(ccaf.receiver, signal) for signal in sorted(ccaf.signals))
        whole = np.isfinite(ccaf.value).all(axis=(2, 3)).sum(axis=1)
        few = undecided(
            self, records, every, because="fewer than five satellites with a correlation grid and an orbit",
            would_need="correlation grids of five or more satellites with their orbits",
        )  # fmt: skip
        if whole.size == 0 or whole.max() < 5:
            return few
        epoch = int(np.flatnonzero(whole == whole.max())[-1])
        found = delays_of(ccaf, epoch, self.settings)
        linear = self._linear(navigation, ccaf, epoch, found)
        if linear is None:
            return few
        unit, misfit_m, sigma_m, rows = linear
        best = passing_sets(unit, misfit_m, sigma_m, false_alarm_probability=self.settings.set_probability)
        doubles = [str(ccaf.signals[row]) for row in rows if np.isfinite(found.delay_chips[row, 1])]
        if not best.statistic.size:
            return undecided(
                self, records, every, because=f"no choice of one signal a satellite fits one position in "
                f"{ccaf.receiver}; {len(doubles)} satellites have two signals", would_need="more satellites",
            )  # fmt: skip
        second = second_subset(
            unit, misfit_m, sigma_m, best.choice[0], false_alarm_probability=self.settings.set_probability
        )
        return self._told(records, ccaf, every, unit, misfit_m, sigma_m, best.choice[0], len(doubles), second)

    def _told(self, records: Records, ccaf: Ccaf, every: tuple[SignalRef, ...], unit: Reals, misfit_m: Reals,
              sigma_m: Reals, choice: Any, doubles: int, second: Any) -> Evidence:  # fmt: skip
        alpha = self.settings.false_alarm_probability
        n = len(misfit_m)
        p_value, because = 1.0, f"{n} satellites in {ccaf.receiver} fit one position, {doubles} have a second signal"
        if second is not None:
            rows, sets = second
            p_value = float(chance_p_value(
                sigma_m[rows], window_m=2.0 * self.settings.window_chips * _CHIP_M,
                largest_statistic=chi_square_threshold(self.settings.set_probability, len(rows) - 4),
                combinations=set_combinations(np.isfinite(misfit_m).sum(axis=1) - 1, len(rows)),
            ))  # fmt: skip
            left = np.where(np.isfinite(misfit_m), misfit_m, np.nan).copy()
            left[np.arange(n), choice] = np.nan
            left = np.take_along_axis(left, np.argsort(np.isnan(left), axis=1, kind="stable"), axis=1)
            one, _ = set_states(unit, misfit_m, sigma_m, choice[None, :])
            other, _ = set_states(unit[rows], left[rows], sigma_m[rows], sets.choice[:1])
            apart = other[0] - one[0]
            because = (
                f"signals of {len(rows)} satellites in {ccaf.receiver} fit a second position, "
                f"{np.linalg.norm(apart[:3]):.0f} m away, and a time {apart[3]:.0f} m off"
            )
        attack = p_value < alpha
        return Evidence(
            detector=self.name, start_gpst=records.start_gpst, end_gpst=records.end_gpst, subject=every,
            says="attack" if attack else "clean" if doubles == 0 else "undecided", because=because,
            p_value=p_value, false_alarm_probability=alpha,
            would_need=None if attack or doubles == 0 else "five or more satellites with a second signal",
        )  # fmt: skip

    def _linear(
        self, navigation: NavigationData, ccaf: Ccaf, epoch: int, found: Delays
    ) -> tuple[Reals, Reals, Reals, Any] | None:
        """Unit vectors in ECEF, misfits (n, 2), sigmas (n,) at the fix of the strongest signals; rows of channels."""
        gpst = ccaf.gpst[epoch]
        measured_m = ccaf.reference_m[epoch][:, None] + found.delay_chips * _CHIP_M
        ranges = corrected_ranges(ccaf.signals, np.array([gpst]), measured_m[None, :, 0], navigation)
        sats = [signal.sat for signal in ccaf.signals]
        rows = np.array([
            row for row in np.flatnonzero(np.isfinite(ranges.range_m[0]) & np.isfinite(found.delay_chips[:, 0]))
            if sats.index(sats[row]) == row
        ], np.int64)  # fmt: skip
        rows = rows[np.argsort([sats[row] for row in rows], kind="stable")]
        if rows.size < 5:
            return None
        satellite, range_m = ranges.satellite_ecef_m[0, rows], ranges.range_m[0, rows]
        sigma_m = np.hypot(_CHIP_M * np.nanmax(found.sigma_chips[rows], axis=1), self.settings.multipath_sigma_m)
        tow_s = np.asarray(week_and_tow(gpst)[1])
        state_m = gauss_newton(satellite, range_m, sigma_m, np.zeros(4), tolerance_m=10.0).state_m
        for _ in range(2):
            turned, _, _ = line_of_sight(satellite, state_m[:3])
            delays = atmosphere(
                state_m[:3], turned, tow_s, navigation.ionosphere, ionosphere_share=self.settings.ionosphere_share
            )
            total_m = np.hypot(sigma_m, delays.sigma_m)
            state_m = gauss_newton(satellite, range_m - delays.delay_m, total_m, state_m).state_m
        if not np.all(np.isfinite(state_m)):
            return None
        _, unit, distance_m = line_of_sight(satellite, state_m[:3])
        first = range_m - delays.delay_m - distance_m - state_m[3]
        second = first + (measured_m[rows, 1] - measured_m[rows, 0])
        return unit, np.stack((first, second), axis=1), total_m, rows
