"""The attitude at the start of an inertial navigator: from fixes while the body moves.

A rough attitude is found first, and then the likeliest errors of it by all measurements at once, from a start that
claims nothing of the attitude (90 degrees about each axis), three times over, each about the attitude and biases that
the one before found (Gauss-Newton). So what the rough attitude takes from the same readings is not counted twice, the
covariance has the correlation of tilt and accelerometer biases in it, and no early measurement turns the axes about
which later ones are linear, as it would in a filter whose attitude is open.

The rough attitude is from velocities of fixes against the specific force, summed up between fixes along the gyros' turn
(Wu and Pan, "Velocity/position integration formula, part I: application to in-flight coarse alignment", IEEE Trans.
Aerospace and Electronic Systems 49(2), 2013), solved for the one rotation between the two by singular values (Markley,
J. Astronautical Sciences 36(3), 1988). How body and course are turned to each other is of no account. What shows the
heading is that the velocity changes: straight and even motion has none, and gets no alignment.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from skyproof.arrays import Reals
from skyproof.gnss.frames import EARTH_RAD_S, geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.gravity import gravity_ecef_m_s2
from skyproof.gnss.time import seconds_between
from skyproof.navigation.inertia import FreeRun, readings_between
from skyproof.navigation.ins import ATTITUDE, SIZE, InsSettings, InsState, begin, put_right, without_errors
from skyproof.navigation.ins_errors import STATES, transitions
from skyproof.navigation.ins_updates import by_fix
from skyproof.navigation.nav_estimate import NavEstimate, known
from skyproof.navigation.strapdown import strapdown, strapdown_paths
from skyproof.records import ImuSeries, InertialReadings, NavState
from skyproof.statistics.distributions import chi_square_survival
from skyproof.statistics.kalman import kalman_update

__all__ = ["Alignment", "align_moving", "heading_sigma_rad"]

_OPEN_RAD: Final = np.pi / 2.0
_OPEN_M: Final = 1e3
_OPEN_M_S: Final = 1e2
_ROUNDS: Final = 3
_KNOT_S: Final = 0.5  # between covariances
_HOLE: Final = 1.5  # intervals between readings: more, and one is missing


@dataclass(frozen=True, eq=False, kw_only=True)
class Alignment:
    """What an alignment found: the state at its end, or None and why not.

    heading_sigma_rad : infinite where nothing was found. p_value : of how the corrections fitted, of all together.
    """

    state: InsState | None
    heading_sigma_rad: float
    p_value: float
    because: str = ""


def heading_sigma_rad(state: InsState) -> float:
    """One sigma of a turn about the vertical."""
    up = rot_enu_ecef(*geodetic_from_ecef(state.position_ecef_m)[:2])[2]
    return float(np.sqrt(up @ state.covariance[ATTITUDE, ATTITUDE] @ up))


def align_moving(
    readings: InertialReadings,
    fixes: Sequence[NavEstimate],
    settings: InsSettings,
    *,
    heading_most_rad: float = np.radians(10.0),
) -> Alignment:
    """Align by fixes with velocity of a body that speeds up, brakes or turns on its way; the state is at the last
    reading before the last fix.

    readings : over all of the fixes without a gap. heading_most_rad : one sigma; where the motion does not show the
    heading so well, nothing is found: wait for more.
    """
    fixes = [_of_motion(fix) for fix in fixes if fix.there.size >= 6]
    fixes = [fix for fix in fixes if readings.gpst[0] <= fix.gpst <= readings.gpst[-1]]
    if len(fixes) < 3:
        return _nothing("fewer than three fixes with velocity")
    first_gpst = readings.gpst[np.searchsorted(readings.gpst, fixes[0].gpst, side="right") - 1]
    within = readings_between(readings, first_gpst, fixes[-1].gpst)
    if (
        not within.gpst.size
        or np.diff(seconds_between(within.gpst, first_gpst), prepend=0.0).max() > _HOLE * readings.interval_s
    ):
        return _nothing("readings are missing")
    errors, place_ecef_m = _SensorErrors(np.zeros(12), np.zeros((2, 3, 3))), fixes[0].mean[0:3]
    rough = _by_velocities(within, _turned(within, place_ecef_m), fixes)
    for _ in range(_ROUNDS):
        start = _start(first_gpst, fixes[0], fixes[0].mean[3:6], rough, settings)
        state, nis, dof = _batch(start, within, fixes, errors, settings)
        errors = _SensorErrors(state.bias, state.gain)
        rough = state.attitude @ _turned(errors.off(within), place_ecef_m)[-1].T
    p_value = float(chi_square_survival(nis, dof))
    return _judged(state, p_value, heading_most_rad, "the motion does not show the heading yet")


class _SensorErrors(NamedTuple):
    """As a state has them: bias (12,), gain (2, 3, 3)."""

    bias: Reals
    gain: Reals

    def off(self, readings: ImuSeries) -> ImuSeries:
        """Readings without them."""
        return without_errors(readings, self.bias[:6] + self.bias[6:], self.gain)


def _batch(
    start: NavState, readings: ImuSeries, fixes: Sequence[NavEstimate], errors: _SensorErrors, settings: InsSettings
) -> tuple[InsState, float, int]:
    """The state at the last reading by all fixes, linear about the path from a rough start and sensor errors on that
    nothing corrects; and the sum of squares of what came unexpected, with its degrees."""
    right = errors.off(readings)
    path = strapdown(start, right)
    rows = np.searchsorted(path.gpst, np.array([fix.gpst for fix in fixes]), side="right") - 1
    every = max(int(_KNOT_S / readings.interval_s), 1)
    knots = np.unique(np.concatenate((np.arange(0, path.gpst.size, every), rows, [path.gpst.size - 1])))
    steps, noises = transitions(path.select(knots), settings.grade, most_s=2.0 * max(_KNOT_S, readings.interval_s))
    wrong, covariance, nis, dof = np.zeros(SIZE), begin(start, settings).covariance, 0.0, 0
    wrong[9:STATES] = -np.concatenate((errors.bias, errors.gain.ravel()))  # before, none were expected
    for number, knot in enumerate(knots):
        if number:
            moves, noise = np.eye(SIZE), np.zeros((SIZE, SIZE))
            moves[:STATES, :STATES], noise[:STATES, :STATES] = steps[number - 1], noises[number - 1]
            wrong, covariance = moves @ wrong, moves @ covariance @ moves.T + noise
        last = np.stack((right.specific_force_m_s2[max(knot - 1, 0)], right.angular_rate_rad_s[max(knot - 1, 0)]))
        state = InsState(
            run=FreeRun(state=path.select(np.array([knot])), covariance=covariance, last=last),
            bias=errors.bias,
            gain=errors.gain,
            clock_m=np.zeros(2),
            lasting_m=np.zeros(4),
        )
        for fix in (fixes[int(k)] for k in np.flatnonzero(rows == knot)):
            seen = by_fix(state, fix, settings)
            unexpected = seen.innovation - seen.sensitivity @ wrong
            update = kalman_update(covariance, seen.sensitivity, seen.noise, unexpected)
            wrong, covariance = wrong + update.change, update.covariance
            nis, dof = nis + float(update.statistic), dof + unexpected.size
    return put_right(state, wrong, covariance), nis, dof


def _of_motion(fix: NavEstimate) -> NavEstimate:
    """Position and velocity of a fix."""
    return known(
        fix.gpst,
        position_ecef_m=fix.mean[0:3],
        position_m2=fix.covariance[0:3, 0:3],
        velocity_ecef_m_s=fix.mean[3:6],
        velocity_m2_s2=fix.covariance[3:6, 3:6],
    )


def _nothing(because: str) -> Alignment:
    return Alignment(state=None, heading_sigma_rad=np.inf, p_value=1.0, because=because)


def _turned(readings: ImuSeries, place_ecef_m: Reals) -> Reals:
    """Turns (n + 1, 3, 3) from the body's axes at the begin of the readings to those after each; the Earth's own turn,
    which is about other axes, left in."""
    return strapdown_paths(
        place_ecef_m,
        np.zeros(3),
        np.eye(3),
        np.zeros_like(readings.specific_force_m_s2),
        readings.angular_rate_rad_s,
        readings.interval_s,
    )[2]


def _by_velocities(readings: ImuSeries, turned: Reals, fixes: Sequence[NavEstimate]) -> Reals:
    """The attitude (3, 3) at the begin of the readings that takes what the unit felt to how the velocities changed."""
    at_s = seconds_between(np.array([fix.gpst for fix in fixes]), fixes[0].gpst)
    speeds, places = (np.stack([fix.mean[part] for fix in fixes]) for part in (slice(3, 6), slice(0, 3)))
    pushes = np.einsum("nij,nj->ni", turned[:-1], readings.specific_force_m_s2) * readings.interval_s
    rows = np.searchsorted(readings.gpst, np.array([fix.gpst for fix in fixes]), side="right")
    felt = np.diff(np.concatenate((np.zeros((1, 3)), np.cumsum(pushes, axis=0)))[rows], axis=0)
    pull = gravity_ecef_m_s2(places[:-1]) - 2.0 * np.cross(EARTH_RAD_S, speeds[:-1])
    return _rotation(np.diff(speeds, axis=0) - pull * np.diff(at_s)[:, None], felt)


def _rotation(there: Reals, here: Reals) -> Reals:
    """The rotation (3, 3) that takes vectors `here` (n, 3) nearest to those `there`."""
    left, _, right = np.linalg.svd(there.T @ here)
    return np.asarray(left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right)


def _start(
    gpst: np.datetime64, place: NavEstimate, velocity: Reals, attitude: Reals, settings: InsSettings
) -> NavState:
    """A start near the truth that claims nothing."""
    return NavState(
        gpst=np.array([gpst]),
        position_ecef_m=(place.mean[0:3] - attitude @ settings.lever_m)[None],
        velocity_ecef_m_s=velocity[None],
        attitude=attitude[None],
        covariance=np.diag(np.repeat(np.square([_OPEN_M, _OPEN_M_S, _OPEN_RAD]), 3))[None],
    )


def _judged(state: InsState, p_value: float, heading_most_rad: float, because: str) -> Alignment:
    sigma_rad = heading_sigma_rad(state)
    found = sigma_rad <= heading_most_rad
    return Alignment(
        state=state if found else None,
        heading_sigma_rad=sigma_rad,
        p_value=p_value,
        because="" if found else f"heading to {np.degrees(sigma_rad):.0f} degrees: {because}",
    )
