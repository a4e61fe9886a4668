"""Do the measurements of one receiver fit one position (RAIM), or two (an attack beside the true sky)?

Failing RAIM is no sign of an attack by itself, and its exclusion never decides who is authentic: it believes the
majority, and the attacker may be the majority. It names a signal that does not fit the others, and blames it only as
far as nothing else speaks for false signals. A second set of signals that
agree on another position or time is a sign: echoes and false correlation peaks do not agree with each other.
"""

from collections import Counter
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from skyproof.detectors.base import missing, undecided
from skyproof.detectors.second_signals.late_copies import without_late_copies
from skyproof.detectors.second_signals.second_sky import second_sky_p_value
from skyproof.errors import SettingsError, require_probability
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.time import week_and_tow
from skyproof.navigation.least_squares import design_matrix, gauss_newton, line_of_sight
from skyproof.navigation.raim import GlobalTest, exclude_one, global_test
from skyproof.navigation.ranges import atmosphere, corrected_ranges
from skyproof.navigation.window import window_mean
from skyproof.records import ConsistentSet, Evidence, NavigationData, Need, Observations, Records, SignalId, SignalRef

__all__ = ["PlainFix", "Residual", "ResidualSettings", "plain_fix"]


@dataclass(frozen=True)
class ResidualSettings:
    """Settings of `Residual`.

    false_alarm_probability : of each test of each receiver and window.
    min_satellites : of a set that counts as a sky.
    multipath_sigma_m : error of a track that stays over the window, one sigma.
    ionosphere_share : of the ionosphere's delay, one sigma of what the model leaves.
    unrelated_spread_m : delays of signals that have nothing to do with each other spread over at least this.
    """

    false_alarm_probability: float = 1e-3
    min_satellites: int = 5
    multipath_sigma_m: float = 1.0
    ionosphere_share: float = 0.25
    unrelated_spread_m: float = 300.0

    def __post_init__(self) -> None:
        require_probability("residual", "false_alarm_probability", self.false_alarm_probability)
        if self.min_satellites < 5:
            raise SettingsError(f"residual: min_satellites is {self.min_satellites}; four always fit, take 5 or more")


class PlainFix(NamedTuple):
    """What a receiver without protection makes of a window.

    signals : the first-found one of each satellite. test : of all of them together. excluded : the one that has to go
        to make the others fit, None if none does or none has to.
    """

    signals: tuple[SignalId, ...]
    test: GlobalTest
    excluded: SignalId | None


def plain_fix(window: Observations, navigation: NavigationData, settings: ResidualSettings) -> PlainFix | None:
    """Fit one position to the first-found signal of each satellite; None with fewer than five.

    Under the null (one sky, errors as in `settings`) the statistic is chi-square with as many degrees as there are
    satellites beyond four.
    """
    mean = window_mean(window)
    ranges = corrected_ranges(mean.signals, np.array([mean.gpst]), mean.pseudorange_m[None, :], navigation)
    first: dict[str, int] = {}
    for row in sorted(np.flatnonzero(np.isfinite(ranges.range_m[0])), key=lambda row: mean.signals[row]):
        first.setdefault(mean.signals[row].sat, int(row))
    rows = list(first.values())
    if len(rows) < 5:
        return None
    satellite, range_m = ranges.satellite_ecef_m[0, rows], ranges.range_m[0, rows]
    sigma_m = np.hypot(mean.sigma_m[rows], settings.multipath_sigma_m)
    state_m = gauss_newton(satellite, range_m, sigma_m, np.zeros(4), tolerance_m=10.0).state_m
    tow_s = np.asarray(week_and_tow(mean.gpst)[1])
    for _ in range(2):  # the atmosphere depends on the position, a little
        turned, _, _ = line_of_sight(satellite, state_m[:3])
        delays = atmosphere(
            state_m[:3], turned, tow_s, navigation.ionosphere, ionosphere_share=settings.ionosphere_share
        )
        total_m = np.hypot(sigma_m, delays.sigma_m)
        solution = gauss_newton(satellite, range_m - delays.delay_m, total_m, state_m)
        state_m = solution.state_m
    signals = tuple(mean.signals[row] for row in rows)
    if not np.all(np.isfinite(state_m)):
        return None
    _, unit, distance_m = line_of_sight(satellite, state_m[:3])
    misfit_m = range_m - delays.delay_m - distance_m - state_m[3]
    alpha = settings.false_alarm_probability
    test = global_test(solution.residual_m, total_m, false_alarm_probability=alpha)
    exclusion = exclude_one(design_matrix(unit), misfit_m, total_m, false_alarm_probability=alpha)
    cured = not test.consistent and exclusion.excluded >= 0 and bool(exclusion.test.consistent)
    return PlainFix(signals, test, signals[int(exclusion.excluded)] if cured else None)


class Residual:
    """The detector: one Evidence per receiver and window."""

    name = "residual"
    needs = (Need.OBSERVATIONS, Need.NAVIGATION)

    def __init__(self, settings: ResidualSettings | None = None) -> None:
        self.settings = settings or ResidualSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Evidence], Any]:
        """Evidence of one window; never raises for what the data lack."""
        lacking = missing(self, records)
        if lacking or records.navigation is None:
            return lacking, state
        return [self._receiver(records, records.navigation, o) for o in records.observations], state

    def _receiver(self, records: Records, navigation: NavigationData, observations: Observations) -> Evidence:
        every = tuple(SignalRef(observations.receiver, signal) for signal in observations.signals)
        own = [s for s in records.sets if s.receiver == observations.receiver]
        sets = tuple(
            s for s in without_late_copies(observations, own) if len(s.signals) >= self.settings.min_satellites
        )
        if observations.gpst.size == 0:
            return undecided(self, records, every, because="no epoch in the window")
        if len(sets) >= 2:
            return self._several_skies(records, observations, sets)
        plain = plain_fix(observations, navigation, self.settings)
        if plain is None:
            return undecided(
                self,
                records,
                every,
                because="fewer than five satellites with a pseudorange and an orbit",
                would_need="five or more satellites with pseudoranges and orbits",
            )
        return self._one_sky(records, observations, plain)

    def _several_skies(self, records: Records, observations: Observations, sets: tuple[ConsistentSet, ...]) -> Evidence:
        p_value = second_sky_p_value(
            observations,
            sets,
            unrelated_spread_m=self.settings.unrelated_spread_m,
            multipath_sigma_m=self.settings.multipath_sigma_m,
        )
        subject = tuple(SignalRef(observations.receiver, signal) for s in sets for signal in s.signals)
        sizes = " and ".join(str(len(s.signals)) for s in sets)
        far_m = max(float(np.linalg.norm(s.position_ecef_m - sets[0].position_ecef_m)) for s in sets[1:])
        late_s = max(abs(s.clock_bias_s - sets[0].clock_bias_s) for s in sets[1:])
        because = (
            f"{sizes} signals in {observations.receiver} fit positions up to {far_m:.0f} m apart, and times "
            f"{late_s * 1e6:.2f} us ({late_s * SPEED_OF_LIGHT_M_S:.0f} m) apart"
        )
        if p_value >= self.settings.false_alarm_probability:
            return undecided(
                self,
                records,
                subject,
                because=f"{because}, which unrelated signals do as well by chance",
                would_need="more satellites with a second signal",
            )
        return Evidence(
            detector=self.name,
            start_gpst=records.start_gpst,
            end_gpst=records.end_gpst,
            subject=subject,
            says="attack",
            because=because,
            p_value=p_value,
            false_alarm_probability=self.settings.false_alarm_probability,
        )

    def _one_sky(self, records: Records, observations: Observations, plain: PlainFix) -> Evidence:
        receiver, test = observations.receiver, plain.test
        n = len(plain.signals)
        fits = bool(test.consistent)
        because = f"{n} satellites in {receiver} {'fit' if fits else 'do not fit'} one position"
        if not fits:
            because += _blame(plain, _doubled(observations))
        return Evidence(
            detector=self.name,
            start_gpst=records.start_gpst,
            end_gpst=records.end_gpst,
            subject=tuple(SignalRef(receiver, signal) for signal in plain.signals),
            says="clean" if fits else "undecided",
            because=because,
            statistic=float(test.statistic),
            threshold=float(test.threshold),
            false_alarm_probability=self.settings.false_alarm_probability,
            p_value=float(test.p_value),
            would_need=None if fits else "another receiver, or both signals of the satellites that have two",
        )


def _blame(plain: PlainFix, doubled: int) -> str:
    """What may be wrong where measurements do not fit: of one signal only if nothing speaks for more."""
    if doubled:
        have = "has" if doubled == 1 else "have"
        return f", and {doubled} of them {have} more than one signal: true and false ones may be mixed"
    if plain.excluded is not None:
        return f"; without {plain.excluded} they do: a fault of it, unless the others are false"
    return ", and no single one is to blame: several faults, or true and false signals mixed"


def _doubled(observations: Observations) -> int:
    """How many satellites have more than one signal with a pseudorange in the window."""
    measured = np.flatnonzero(np.isfinite(observations.pseudorange_m).any(axis=0))
    sats = Counter(observations.signals[column].sat for column in measured)
    return sum(count > 1 for count in sats.values())
