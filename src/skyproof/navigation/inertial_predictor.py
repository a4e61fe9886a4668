"""What is to be expected of a receiver that moves, by an inertial unit: the navigator that its fixes corrected.

The navigator begins with the attitude stated at the first reading, which the gyros carry to the first fix, or else by
alignment in motion (`alignment.align_moving`). Then fixes correct it, those of a time that is taken for true and those
of the sky that was chosen; in between it runs free, and no signal moves it.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from skyproof.gnss.frames import attitude_ecef
from skyproof.gnss.time import seconds_between
from skyproof.navigation.alignment import align_moving
from skyproof.navigation.inertia import TURN_MOST_RAD, coast, readings_between
from skyproof.navigation.inertia import begin_free_run as begin_free
from skyproof.navigation.ins import (
    POSITION,
    VELOCITY,
    InsSettings,
    InsState,
    begin,
    correct,
    put_right,
    step,
)
from skyproof.navigation.ins_updates import antenna_of, by_fix, expect_fix
from skyproof.navigation.nav_estimate import NavEstimate, without
from skyproof.navigation.predictor import SkyFix
from skyproof.records import Attitude, InertialReadings, NavState

__all__ = ["Inertial", "begun", "noise_of"]

_EVERY_S: Final = 1.0  # between corrections
_WAITING: Final = 120  # fixes, by which it is aligned
_BEHIND: Final = 2.0  # intervals by which the last reading may be earlier than what is asked for
_OPEN_M: Final = 1e3
_SWING_M_S: Final = 0.3  # of the antenna about the unit, when it begins
_NOISE_SHARE: Final = 0.25  # of the variance of smoothed fixes
_CLOCK = np.array([6, 7])


@dataclass(frozen=True, eq=False, kw_only=True)
class Inertial:
    """Of the antenna that `settings.lever_m` is of.

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
        """What is true then: as a fix has it, less what fixes have for long."""
        return self._of(antenna_of, gpst)

    def _of(
        self, what: Callable[[InsState, InsSettings, np.datetime64], NavEstimate], gpst: np.datetime64
    ) -> NavEstimate | None:
        state = self.until(gpst).state
        late_s = _BEHIND * self.readings.interval_s
        if state is None or not abs(float(seconds_between(gpst, state.gpst))) <= late_s:
            return None
        found = what(state, self.settings, gpst)
        return found if self.clock else without(found, _CLOCK)

    def until(self, gpst: np.datetime64) -> "Inertial":
        if self.state is None:
            return self
        rows = readings_between(self.readings, self.state.gpst, gpst)
        if not rows.gpst.size:
            return self
        return replace(self, state=step(self.state, rows, self.settings)[1])

    def doubted(self, sigma_m: float, sigma_m_s: float) -> "Inertial":
        """Return it with so much more doubt of position and velocity, an axis."""
        if self.state is None:
            return self
        more = np.zeros(self.state.covariance.shape[0])
        more[POSITION], more[VELOCITY] = sigma_m**2, sigma_m_s**2
        return replace(self, state=put_right(self.state, np.zeros(more.size), self.state.covariance + np.diag(more)))

    def learned(self, shown: SkyFix) -> "Inertial":
        """With the fixes of the window's epochs, a second or more apart."""
        own = self if self.settings.lasting_m2.any() else self._with_lasting(shown.whole)
        last: np.datetime64 | None = None
        for fix in shown.each:
            if last is None or seconds_between(fix.gpst, last) >= _EVERY_S:
                own, last = own._corrected(fix), fix.gpst
        return own if own.state is not None else own._aligned()

    def followed(self, shown: SkyFix) -> "Inertial":
        return self.learned(shown)

    def _with_lasting(self, fix: NavEstimate) -> "Inertial":
        """What a window's fix leaves open is there in the next one as well."""
        rows = np.array([0, 1, 2, 6])
        lasting = np.where(np.isfinite(fix.covariance), fix.covariance, 0.0)[np.ix_(rows, rows)]
        return replace(self, settings=replace(self.settings, lasting_m2=lasting))

    def _corrected(self, fix: NavEstimate) -> "Inertial":
        fix = fix if self.clock else without(fix, _CLOCK)
        own = self.until(fix.gpst)
        if own.state is None:
            return replace(own, waiting=(*own.waiting, fix)[-_WAITING:])
        if abs(float(seconds_between(fix.gpst, own.state.gpst))) > _BEHIND * self.readings.interval_s:
            return own
        return replace(own, state=correct(own.state, by_fix(own.state, fix, own.settings))[0])

    def _aligned(self) -> "Inertial":
        """With a state, if the fixes that wait are enough for one."""
        state, later = self._begun(), self.waiting
        if state is None:
            later = ()
            state = align_moving(self.readings, self.waiting, self.settings).state if len(self.waiting) > 2 else None
        if state is None:
            return self
        own = replace(self, state=state, waiting=())
        for fix in later:
            own = own._corrected(fix)
        return own

    def _begun(self) -> InsState | None:
        """At the first fix with velocity, by the stated attitude; None without."""
        fixes = [fix for fix in self.waiting if fix.there.size >= 6]
        if self.initial is None or not fixes or fixes[0] is not self.waiting[0]:
            return None
        return begun(self.readings, self.initial, fixes[0], self.settings)


def noise_of(fix: NavEstimate) -> NavEstimate:
    """One of smoothed fixes with what of its error is taken for noise. They share most of it: the whole is taken for
    lasting, and some more for noise."""
    return replace(fix, covariance=_NOISE_SHARE * fix.covariance)


def begun(readings: InertialReadings, initial: Attitude, fix: NavEstimate, settings: InsSettings) -> InsState | None:
    """A navigator at the last reading before a fix with velocity, its attitude carried by the gyros from the first
    reading on, of which it is stated; None where that does not reach so far.

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
    before = readings_between(readings, readings.gpst[0], fix.gpst)
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
