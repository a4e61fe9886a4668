"""Two skies in signals that overlap: the detector over `decomposition` and `inverse_raim`.

Each satellite's correlation is taken apart into one or two signals, as many as its count test says; then the signals
left over by the best consistent set are searched for a second one, of five satellites at least. Echoes make second
signals, too, but no second position. Which sky is true the correlation does not tell. An inertial unit that has
navigated alone since before the attack does, by `navigation.exclusion`: where its state is among the records, with its
covariance, the signals of the satellites that show both skies are named, or it is reported that they cannot be.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from skyproof.arrays import Reals
from skyproof.decomposition.fit import (
    CountTest,
    Decomposition,
    Dictionary,
    at_strongest_doppler,
    count_statistic,
    count_test,
    taps_dictionary,
)
from skyproof.detectors.base import missing, undecided
from skyproof.detectors.dccaf.inverse_raim import passing_sets, second_subset, set_states
from skyproof.errors import require_probability
from skyproof.gnss.constants import CA_CHIP_RATE_HZ, SPEED_OF_LIGHT_M_S
from skyproof.gnss.time import week_and_tow
from skyproof.navigation.chance import chance_p_value, set_combinations
from skyproof.navigation.exclusion import choose_fix, wrong_choice_rule
from skyproof.navigation.least_squares import gauss_newton, line_of_sight
from skyproof.navigation.nav_state import covered, state_at
from skyproof.navigation.ranges import atmosphere, corrected_ranges
from skyproof.records import Ccaf, Evidence, NavigationData, Need, Records, Says, SignalRef
from skyproof.statistics.distributions import chi_square_threshold

__all__ = ["Dccaf", "DccafSettings", "Delays", "delays_of"]

_CHIP_M = SPEED_OF_LIGHT_M_S / CA_CHIP_RATE_HZ
_SEED = 20190601  # of the simulated law of the count: the same in every run


@dataclass(frozen=True)
class DccafSettings:
    """Settings of `Dccaf`.

    false_alarm_probability : that unrelated second signals pass for a second sky, in each receiver and window.
    second_signal_probability : that a satellite alone is said to have two signals, divided by the number of satellites.
    set_probability : that a true set fails its chi-square test, and that the true fix fails its own.
    wrong_choice_probability : that the false sky is chosen, both being equally likely before; else none is.
    multipath_sigma_m, ionosphere_share : as for `residual`.
    window_chips : delays are searched this far to both sides of the reference.
    count_runs : simulated correlations for the law of the count, once for each front end.
    """

    false_alarm_probability: float = 1e-3
    second_signal_probability: float = 0.01
    set_probability: float = 1e-3
    wrong_choice_probability: float = 1e-3
    multipath_sigma_m: float = 1.0
    ionosphere_share: float = 0.25
    window_chips: float = 1.3
    count_runs: int = 4000

    def __post_init__(self) -> None:
        for name in (
            "false_alarm_probability",
            "second_signal_probability",
            "set_probability",
            "wrong_choice_probability",
        ):
            require_probability("dccaf", name, getattr(self, name))


class Delays(NamedTuple):
    """delay_chips, sigma_chips (channels, 2): NaN for a second signal that is not there; p_value (channels,) of "one
    signal". Strongest first."""

    delay_chips: Reals
    sigma_chips: Reals
    p_value: Reals


def delays_of(ccaf: Ccaf, epoch: int, settings: DccafSettings) -> Delays:
    """One or two delays of each channel at one epoch, at the Doppler of its strongest signal."""
    grid = np.asarray(ccaf.value[epoch], np.complex128)
    variance = ccaf.noise_variance[epoch]
    there = np.isfinite(grid).all(axis=(1, 2)) & np.isfinite(variance) & np.isfinite(ccaf.reference_m[epoch])
    points = tuple(float(x) for x in ccaf.delays_chips)
    dictionary, law = _law(points, ccaf.band_hz, settings.window_chips, settings.count_runs, ccaf.noise_samples)
    n = len(there)
    delay, sigma, p_value = np.full((n, 2), np.nan), np.full((n, 2), np.nan), np.full(n, np.nan)
    if not there.any():
        return Delays(delay, sigma, p_value)
    taps, variance = grid[there, 0], variance[there]
    if ccaf.dopplers_hz.size > 1:
        taps, factor, _ = at_strongest_doppler(grid[there], dictionary, ccaf.dopplers_hz, ccaf.coherent_s)
        variance = factor * variance
    statistic, one, two = count_statistic(taps, dictionary, variance)
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
    delay = np.where(
        double[:, None],
        np.take_along_axis(two.delay_chips, order, axis=-1),
        np.concatenate((one.delay_chips, alone), axis=1),
    )
    sigma = np.where(
        double[:, None],
        np.take_along_axis(spread, order, axis=-1),
        np.concatenate((np.sqrt(one.covariance[:, :, 0]), alone), axis=1),
    )
    return delay, sigma


class _Sky(NamedTuple):
    """Satellites of one epoch around a fix: unit vectors in ECEF (n, 3) to them, misfits (n, 2) of their signals,
    sigmas (n,), channels (n,), and the fix (3,)."""

    unit: Reals
    misfit_m: Reals
    sigma_m: Reals
    rows: Any
    place_ecef_m: Reals


class _Fixes(NamedTuple):
    """Place and clock (2, 4) from `_Sky.place_ecef_m`, their covariances (2, 4, 4), and for each satellite the signals
    (n, 2) that make them; -1 where a satellite is not in the second."""

    state_m: Reals
    covariance_m2: Reals
    signal: Any


class Dccaf:
    """The detector: of each receiver and window an Evidence of the last epoch in which most channels are there.

    An attack is reported of the receiver as a whole. With `nav_state`, a `NavState` with covariance of a unit
    that has had no fix since before the attack, there is more evidence, on the signals nearest to the references, which
    are those that the receiver follows.
    """

    name = "dccaf"
    needs = (Need.CCAF, Need.NAVIGATION)

    def __init__(self, settings: DccafSettings | None = None) -> None:
        self.settings = settings or DccafSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Evidence], Any]:
        """Evidence of one window; `ccaf` is a sequence of `Ccaf`."""
        lacking = missing(self, records)
        if lacking or records.navigation is None:
            return lacking, state
        said = [self._receiver(records, records.navigation, ccaf) for ccaf in records.ccaf]
        return [evidence for each in said for evidence in each], state

    def _receiver(self, records: Records, navigation: NavigationData, ccaf: Ccaf) -> list[Evidence]:
        every = tuple(SignalRef(ccaf.receiver, signal) for signal in sorted(ccaf.signals))
        whole = np.isfinite(ccaf.value).all(axis=(2, 3)).sum(axis=1)
        few = undecided(
            self,
            records,
            every,
            because="fewer than five satellites with a correlation grid and an orbit",
            would_need="correlation grids of five or more satellites with their orbits",
        )
        if whole.size == 0 or whole.max() < 5:
            return [few]
        epoch = int(np.flatnonzero(whole == whole.max())[-1])
        found = delays_of(ccaf, epoch, self.settings)
        sky = self._sky(navigation, ccaf, epoch, found)
        if sky is None:
            return [few]
        probability = self.settings.set_probability
        best = passing_sets(sky.unit, sky.misfit_m, sky.sigma_m, false_alarm_probability=probability)
        doubles = int(np.isfinite(found.delay_chips[sky.rows, 1]).sum())
        if not best.statistic.size:
            return [
                undecided(
                    self,
                    records,
                    every,
                    because=f"no choice of one signal a satellite fits one position in "
                    f"{ccaf.receiver}; {doubles} satellites have two signals",
                    would_need="more satellites",
                )
            ]
        second = second_subset(sky.unit, sky.misfit_m, sky.sigma_m, best.choice[0], false_alarm_probability=probability)
        if second is None:
            return [
                self._of_receiver(
                    records,
                    every,
                    1.0,
                    f"{len(sky.rows)} satellites in {ccaf.receiver} fit one position, {doubles} have a second signal",
                    doubles,
                )
            ]
        rows, _ = second
        p_value = float(
            chance_p_value(
                sky.sigma_m[rows],
                window_m=2.0 * self.settings.window_chips * _CHIP_M,
                largest_statistic=chi_square_threshold(probability, len(rows) - 4),
                combinations=set_combinations(np.isfinite(sky.misfit_m).sum(axis=1) - 1, len(rows)),
            )
        )
        fixes = _fixes(sky, best.choice[0], rows)
        apart = fixes.state_m[1] - fixes.state_m[0]
        because = (
            f"signals of {len(rows)} satellites in {ccaf.receiver} fit a second position, "
            f"{np.linalg.norm(apart[:3]):.0f} m away, and a time {apart[3]:.0f} m off"
        )
        chosen = self._chosen(records, ccaf, epoch, found, sky, fixes) if p_value < self._alpha else []
        return [self._of_receiver(records, every, p_value, because, doubles), *chosen]

    @property
    def _alpha(self) -> float:
        return self.settings.false_alarm_probability

    def _of_receiver(
        self, records: Records, every: tuple[SignalRef, ...], p_value: float, because: str, doubles: int
    ) -> Evidence:
        attack = p_value < self._alpha
        return Evidence(
            detector=self.name,
            start_gpst=records.start_gpst,
            end_gpst=records.end_gpst,
            subject=every,
            says="attack" if attack else "clean" if doubles == 0 else "undecided",
            because=because,
            p_value=p_value,
            false_alarm_probability=self._alpha,
            would_need=None if attack or doubles == 0 else "five or more satellites with a second signal",
        )

    def _chosen(
        self, records: Records, ccaf: Ccaf, epoch: int, found: Delays, sky: _Sky, fixes: _Fixes
    ) -> list[Evidence]:
        """Which of two skies is true, by the inertial unit; nothing where there is none.

        The p-value is that of the other sky's fix by its chi-square test: uniform if that were the true one.
        """
        inertial = _inertial_place(records, ccaf.gpst[epoch])
        if inertial is None:
            return []
        place_m, place_m2 = inertial[0] - sky.place_ecef_m, inertial[1]
        choice = choose_fix(
            place_m,
            place_m2,
            fixes.state_m[:, :3],
            fixes.covariance_m2[:, :3, :3],
            false_alarm_probability=self.settings.set_probability,
            wrong_probability=self.settings.wrong_choice_probability,
        )
        refs = [SignalRef(ccaf.receiver, ccaf.signals[row]) for row in sky.rows]
        both = fixes.signal[:, 1] >= 0
        true = int(choice.chosen)
        if true < 0:
            apart_m = fixes.state_m[1, :3] - fixes.state_m[0, :3]
            chance = float(wrong_choice_rule(apart_m, place_m2 + fixes.covariance_m2[:, :3, :3].mean(axis=0)))
            neither = bool(np.all(choice.p_value < self.settings.set_probability))
            return [
                undecided(
                    self,
                    records,
                    tuple(ref for ref, there in zip(refs, both, strict=True) if there),
                    because=f"neither of two positions in {ccaf.receiver} fits the inertial unit"
                    if neither
                    else f"the inertial unit does not tell which of two positions in {ccaf.receiver} is true: "
                    f"the nearer one would be wrong with probability {chance:.2g}",
                    would_need="an inertial unit that drifts less, or a clean fix less than a minute before",
                )
            ]
        near, far = np.sqrt(choice.distance2[[true, 1 - true]])
        followed = np.argmin(np.where(np.isnan(found.delay_chips), np.inf, np.abs(found.delay_chips)), axis=1)[sky.rows]
        kinds: tuple[tuple[Says, str, int], ...] = (("authentic", "show", true), ("spoofed", "do not show", 1 - true))
        said = []
        for says, verb, sky_number in kinds:
            mine = both & (fixes.signal[:, sky_number] == followed)
            if mine.any():
                said.append(
                    Evidence(
                        detector=self.name,
                        start_gpst=records.start_gpst,
                        end_gpst=records.end_gpst,
                        subject=tuple(ref for ref, named in zip(refs, mine, strict=True) if named),
                        says=says,
                        because=f"the inertial unit is {near:.1f} sigma from the position that these signals {verb}, "
                        f"and {far:.1f} from the other",
                        statistic=float(choice.distance2[1 - true]),
                        threshold=float(chi_square_threshold(self.settings.set_probability, 3)),
                        p_value=float(choice.p_value[1 - true]),
                        false_alarm_probability=self.settings.set_probability,
                    )
                )
        return said

    def _sky(self, navigation: NavigationData, ccaf: Ccaf, epoch: int, found: Delays) -> _Sky | None:
        """Around the fix of the strongest signals; None with fewer than five satellites."""
        gpst = ccaf.gpst[epoch]
        measured_m = ccaf.reference_m[epoch][:, None] + found.delay_chips * _CHIP_M
        ranges = corrected_ranges(ccaf.signals, np.array([gpst]), measured_m[None, :, 0], navigation)
        sats = [signal.sat for signal in ccaf.signals]
        rows = np.array(
            [
                row
                for row in np.flatnonzero(np.isfinite(ranges.range_m[0]) & np.isfinite(found.delay_chips[:, 0]))
                if sats.index(sats[row]) == row
            ],
            np.int64,
        )
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
        return _Sky(unit, np.stack((first, second), axis=1), total_m, rows, state_m[:3])


def _fixes(sky: _Sky, choice: Any, rows: Any) -> _Fixes:
    """Of the set `choice` (n,) and of what it leaves over of the satellites `rows`."""
    signal = np.stack((choice, np.full(len(choice), -1)), axis=1)
    signal[rows, 1] = 1 - choice[rows]
    one = set_states(sky.unit, sky.misfit_m, sky.sigma_m, choice[None, :])
    other = set_states(sky.unit[rows], sky.misfit_m[rows], sky.sigma_m[rows], signal[rows, 1][None, :])
    return _Fixes(np.concatenate((one[0], other[0])), np.stack((one[1], other[1])), signal)


def _inertial_place(records: Records, gpst: np.datetime64) -> tuple[Reals, Reals] | None:
    """Place (3,) and covariance (3, 3) in ECEF at a time within the navigator's own; None without them.

    A place that is only what the signals show (infinite variance) cannot choose between them.
    """
    path, at = records.nav_state, np.array([gpst])
    if path is None or path.covariance is None or not covered(path, at).all():
        return None
    here = state_at(path, at)
    if here.covariance is None or not np.isfinite(here.covariance[0, :3, :3]).all():
        return None
    return here.position_ecef_m[0], here.covariance[0, :3, :3]
