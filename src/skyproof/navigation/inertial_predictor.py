"""Predict the fixes of a receiver that moves, by an inertial navigator that its fixes corrected.

The navigator begins with the attitude stated at the first reading, which the gyros carry to the first fix. Without one
it begins by alignment in motion (`alignment.align_moving`). Then fixes correct it, those of a time that is taken for
true and those of the chosen sky; in between it runs free, and no signal moves it.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from skyproof.gnss.frames import attitude_ecef
from skyproof.gnss.time import seconds_between
from skyproof.navigation.alignment import align_moving
from skyproof.navigation.inertia import TURN_MOST_RAD, coast, select_readings
from skyproof.navigation.inertia import begin_free_run as begin_free
from skyproof.navigation.ins import (
    ACCELEROMETER,
    POSITION,
    VELOCITY,
    InsSettings,
    InsState,
    apply_correction,
    begin,
    correct,
    step,
)
from skyproof.navigation.ins_updates import estimate_antenna, expect_fix, measurement_from_fix
from skyproof.navigation.nav_estimate import NavEstimate, mark_unknown
from skyproof.navigation.predictor import SkyFix
from skyproof.records import Attitude, InertialReadings, NavState

__all__ = ["Inertial", "begin_at_fix", "scale_to_noise"]

_EVERY_S: Final = 1.0  # between corrections
_WAITING: Final = 120  # fixes, by which it is aligned
_BEHIND: Final = 2.0  # intervals by which the last reading may be earlier than what is asked for
_OPEN_M: Final = 1e3
_SWING_M_S: Final = 0.3  # of the antenna about the unit, when it begins
_NOISE_SHARE: Final = 0.25  # of the variance of smoothed fixes
_CLOCK = np.array([6, 7])


@dataclass(frozen=True, eq=False, kw_only=True)
class Inertial:
    """Predictor of the antenna at the end of `settings.lever_m`.

    readings : of the whole run. initial : attitude at the first of them, one row; None if not stated. clock : whether
    the settings' oscillator is the receiver's; else nothing is said of its clock. state : None before it is aligned and
    after it ended; waiting : the fixes for the next alignment.
    """

    readings: InertialReadings
    settings: InsSettings
    initial: Attitude | None
    clock: bool
    by: tuple[str, ...]
    assumes: tuple[str, ...] = ()
    state: InsState | None = None
    waiting: tuple[NavEstimate, ...] = ()
    moves: bool = True

    def at(self, gpst: np.datetime64) -> NavEstimate | None:
        return self._of(expect_fix, gpst)

    def truth_at(self, gpst: np.datetime64) -> NavEstimate | None:
        """Return the true state at that time: a fix without the lasting errors of fixes."""
        return self._of(estimate_antenna, gpst)

    def _of(
        self, what: Callable[[InsState, InsSettings, np.datetime64], NavEstimate], gpst: np.datetime64
    ) -> NavEstimate | None:
        state = self.until(gpst).state
        late_s = _BEHIND * self.readings.interval_s
        if state is None or not abs(float(seconds_between(gpst, state.gpst))) <= late_s:
            return None
        found = what(state, self.settings, gpst)
        return found if self.clock else mark_unknown(found, _CLOCK)

    def until(self, gpst: np.datetime64) -> "Inertial":
        found = self._step(gpst)
        return self if found is None else replace(self, state=found[1])

    def states_until(self, gpst: np.datetime64) -> NavState | None:
        """Return the unit's states at its own and at each later reading; None if it is not aligned or has none."""
        found = self._step(gpst)
        return None if found is None else found[0]

    def _step(self, gpst: np.datetime64) -> tuple[NavState, InsState | None] | None:
        """Propagate it over later readings, if it is aligned and has any."""
        if self.state is None:
            return None
        rows = select_readings(self.readings, self.state.gpst, gpst)
        return step(self.state, rows, self.settings) if rows.gpst.size else None

    def doubted(self, sigma_m: float, sigma_m_s: float, sigma_m_s2: float) -> "Inertial":
        """Return it with so much more doubt of position, velocity and acceleration, an axis."""
        if self.state is None:
            return self
        more = np.zeros(self.state.covariance.shape[0])
        more[POSITION], more[VELOCITY], more[ACCELEROMETER[0]] = sigma_m**2, sigma_m_s**2, sigma_m_s2**2
        return replace(
            self, state=apply_correction(self.state, np.zeros(more.size), self.state.covariance + np.diag(more))
        )

    def learned(self, shown: SkyFix) -> "Inertial":
        """Correct it by the fixes of the window's epochs, a second or more apart."""
        navigator = self if self.settings.lasting_m2.any() else self._set_lasting(shown.whole)
        last: np.datetime64 | None = None
        for fix in shown.each:
            if last is None or seconds_between(fix.gpst, last) >= _EVERY_S:
                navigator, last = navigator._correct(fix), fix.gpst
        return navigator if navigator.state is not None else navigator._align()

    def followed(self, shown: SkyFix) -> "Inertial":
        return self.learned(shown)

    def _set_lasting(self, fix: NavEstimate) -> "Inertial":
        """Take the covariance of a window's fix for the lasting error of all fixes."""
        rows = np.array([0, 1, 2, 6])
        lasting = np.where(np.isfinite(fix.covariance), fix.covariance, 0.0)[np.ix_(rows, rows)]
        return replace(self, settings=replace(self.settings, lasting_m2=lasting))

    def _correct(self, fix: NavEstimate) -> "Inertial":
        fix = fix if self.clock else mark_unknown(fix, _CLOCK)
        navigator = self.until(fix.gpst)
        if navigator.state is None:
            return replace(navigator, waiting=(*navigator.waiting, fix)[-_WAITING:])
        if abs(float(seconds_between(fix.gpst, navigator.state.gpst))) > _BEHIND * self.readings.interval_s:
            return navigator
        return replace(
            navigator, state=correct(navigator.state, measurement_from_fix(navigator.state, fix, navigator.settings))[0]
        )

    def _align(self) -> "Inertial":
        """Align it, if the waiting fixes are enough."""
        state, later = self._begin_stated(), self.waiting
        if state is None:
            later = ()
            state = align_moving(self.readings, self.waiting, self.settings).state if len(self.waiting) > 2 else None
        if state is None:
            return self
        navigator = replace(self, state=state, waiting=())
        for fix in later:
            navigator = navigator._correct(fix)
        return navigator

    def _begin_stated(self) -> InsState | None:
        """Start at the first fix with velocity, by the stated attitude; None without one."""
        fixes = [fix for fix in self.waiting if fix.there.size >= 6]
        if self.initial is None or not fixes or fixes[0] is not self.waiting[0]:
            return None
        return begin_at_fix(self.readings, self.initial, fixes[0], self.settings)


def scale_to_noise(fix: NavEstimate) -> NavEstimate:
    """Scale a smoothed fix's covariance to the share that counts as noise.

    Smoothed fixes share most of their error: the whole counts as lasting, and some more as noise.
    """
    return replace(fix, covariance=_NOISE_SHARE * fix.covariance)


def begin_at_fix(
    readings: InertialReadings, initial: Attitude, fix: NavEstimate, settings: InsSettings
) -> InsState | None:
    """Start a navigator at the last reading before a fix with velocity.

    The gyros carry the attitude from the first reading, where it is stated. None where they do not reach so far.

    Its position is open: the fix has a lasting error, which is another state, and is to correct it.
    """
    place = fix.mean[:3]
    start = NavState(
        gpst=readings.gpst[:1],
        position_ecef_m=place[None],
        velocity_ecef_m_s=np.zeros((1, 3)),
        attitude=attitude_ecef(place[None], *initial.angles_rad.T),
        covariance=np.diag(np.repeat([0.0, 0.0, initial.sigma_rad**2], 3))[None],
    )
    before = select_readings(readings, readings.gpst[0], fix.gpst)
    _, run = coast(
        begin_free(start, settings.grade), before, settings.grade, tilt_most_rad=np.inf, turn_most_rad=TURN_MOST_RAD
    )
    if run is None or not 0.0 <= float(seconds_between(fix.gpst, run.state.gpst[0])) <= _BEHIND * readings.interval_s:
        return None
    turned = run.state.attitude[0]
    covariance = np.zeros((9, 9))
    covariance[:3, :3] = _OPEN_M**2 * np.eye(3)
    covariance[3:6, 3:6] = fix.covariance[3:6, 3:6] + _SWING_M_S**2 * np.eye(3)
    covariance[6:, 6:] = run.covariance[6:9, 6:9]
    return begin(
        NavState(
            gpst=run.state.gpst,
            position_ecef_m=(place - turned @ settings.lever_m)[None],
            velocity_ecef_m_s=fix.mean[None, 3:6],
            attitude=turned[None],
            covariance=covariance[None],
        ),
        settings,
    )
