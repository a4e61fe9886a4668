"""Find the attitude at the start of an inertial navigator from fixes, while the body moves.

A rough attitude is found first. Then its errors are estimated from all measurements at once, from a start that claims
nothing about the attitude (90 degrees about each axis). That is done three times, each linear about the attitude and
biases of the time before (Gauss-Newton). So the readings behind the rough attitude are not counted twice, and the
covariance holds the correlation of tilt and accelerometer biases. No early measurement turns the axes about which later
ones are linear, as it would in a filter with an open attitude.

The rough attitude is from velocities of fixes against the specific force, summed up between fixes along the gyros' turn
(Wu and Pan, "Velocity/position integration formula, part I: application to in-flight coarse alignment", IEEE Trans.
Aerospace and Electronic Systems 49(2), 2013), solved for the one rotation between the two by singular values (Markley,
J. Astronautical Sciences 36(3), 1988). The body's heading relative to its course does not matter. A changing velocity
shows the heading: straight and even motion shows none, and gets no alignment.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from skyproof.arrays import Reals
from skyproof.gnss.frames import EARTH_RAD_S, geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.gravity import compute_gravity_m_s2
from skyproof.gnss.time import seconds_between
from skyproof.navigation.inertia import FreeRun, select_readings
from skyproof.navigation.ins import ATTITUDE, SIZE, InsSettings, InsState, apply_correction, begin, subtract_errors
from skyproof.navigation.ins_errors import STATES, compute_transitions
from skyproof.navigation.ins_updates import measurement_from_fix
from skyproof.navigation.nav_estimate import NavEstimate, estimate_from_parts
from skyproof.navigation.strapdown import navigate, navigate_paths
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
    """Return one sigma of a turn about the vertical."""
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
    fixes = [_keep_motion(fix) for fix in fixes if fix.there.size >= 6]
    fixes = [fix for fix in fixes if readings.gpst[0] <= fix.gpst <= readings.gpst[-1]]
    if len(fixes) < 3:
        return _fail("fewer than three fixes with velocity")
    first_gpst = readings.gpst[np.searchsorted(readings.gpst, fixes[0].gpst, side="right") - 1]
    within = select_readings(readings, first_gpst, fixes[-1].gpst)
    if (
        not within.gpst.size
        or np.diff(seconds_between(within.gpst, first_gpst), prepend=0.0).max() > _HOLE * readings.interval_s
    ):
        return _fail("readings are missing")
    errors, place_ecef_m = _SensorErrors(np.zeros(12), np.zeros((2, 3, 3))), fixes[0].mean[0:3]
    rough = _align_by_velocities(within, _integrate_turns(within, place_ecef_m), fixes)
    for _ in range(_ROUNDS):
        start = _make_start(first_gpst, fixes[0], fixes[0].mean[3:6], rough, settings)
        state, nis, dof = _fit_errors(start, within, fixes, errors, settings)
        errors = _SensorErrors(state.bias, state.gain)
        rough = state.attitude @ _integrate_turns(errors.off(within), place_ecef_m)[-1].T
    p_value = float(chi_square_survival(nis, dof))
    return _check_heading(state, p_value, heading_most_rad, "the motion does not show the heading yet")


class _SensorErrors(NamedTuple):
    """As a state has them: bias (12,), gain (2, 3, 3)."""

    bias: Reals
    gain: Reals

    def off(self, readings: ImuSeries) -> ImuSeries:
        """Subtract these errors from readings."""
        return subtract_errors(readings, self.bias[:6] + self.bias[6:], self.gain)


def _fit_errors(
    start: NavState, readings: ImuSeries, fixes: Sequence[NavEstimate], errors: _SensorErrors, settings: InsSettings
) -> tuple[InsState, float, int]:
    """Estimate the state at the last reading from all fixes, linear about an uncorrected path.

    Returns it with the sum of squared innovations and its degrees of freedom.
    """
    right = errors.off(readings)
    path = navigate(start, right)
    rows = np.searchsorted(path.gpst, np.array([fix.gpst for fix in fixes]), side="right") - 1
    every = max(int(_KNOT_S / readings.interval_s), 1)
    knots = np.unique(np.concatenate((np.arange(0, path.gpst.size, every), rows, [path.gpst.size - 1])))
    steps, noises = compute_transitions(
        path.select(knots), settings.grade, most_s=2.0 * max(_KNOT_S, readings.interval_s)
    )
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
            seen = measurement_from_fix(state, fix, settings)
            unexpected = seen.innovation - seen.sensitivity @ wrong
            update = kalman_update(covariance, seen.sensitivity, seen.noise, unexpected)
            wrong, covariance = wrong + update.change, update.covariance
            nis, dof = nis + float(update.statistic), dof + unexpected.size
    return apply_correction(state, wrong, covariance), nis, dof


def _keep_motion(fix: NavEstimate) -> NavEstimate:
    """Keep the position and velocity of a fix."""
    return estimate_from_parts(
        fix.gpst,
        position_ecef_m=fix.mean[0:3],
        position_m2=fix.covariance[0:3, 0:3],
        velocity_ecef_m_s=fix.mean[3:6],
        velocity_m2_s2=fix.covariance[3:6, 3:6],
    )


def _fail(because: str) -> Alignment:
    return Alignment(state=None, heading_sigma_rad=np.inf, p_value=1.0, because=because)


def _integrate_turns(readings: ImuSeries, place_ecef_m: Reals) -> Reals:
    """Integrate the gyros to rotations (n + 1, 3, 3) from the body's axes at the start.

    The last two axes hold the rotation after each reading. The Earth's rotation, which is about other axes, is left in.
    """
    return navigate_paths(
        place_ecef_m,
        np.zeros(3),
        np.eye(3),
        np.zeros_like(readings.specific_force_m_s2),
        readings.angular_rate_rad_s,
        readings.interval_s,
    )[2]


def _align_by_velocities(readings: ImuSeries, turned: Reals, fixes: Sequence[NavEstimate]) -> Reals:
    """Estimate the attitude (3, 3) at the first reading from specific force and changes of velocity."""
    at_s = seconds_between(np.array([fix.gpst for fix in fixes]), fixes[0].gpst)
    speeds, places = (np.stack([fix.mean[part] for fix in fixes]) for part in (slice(3, 6), slice(0, 3)))
    pushes = np.einsum("nij,nj->ni", turned[:-1], readings.specific_force_m_s2) * readings.interval_s
    rows = np.searchsorted(readings.gpst, np.array([fix.gpst for fix in fixes]), side="right")
    felt = np.diff(np.concatenate((np.zeros((1, 3)), np.cumsum(pushes, axis=0)))[rows], axis=0)
    pull = compute_gravity_m_s2(places[:-1]) - 2.0 * np.cross(EARTH_RAD_S, speeds[:-1])
    return _find_rotation(np.diff(speeds, axis=0) - pull * np.diff(at_s)[:, None], felt)


def _find_rotation(there: Reals, here: Reals) -> Reals:
    """Find the rotation (3, 3) that takes vectors `here` (n, 3) nearest to those `there`."""
    u, _, vt = np.linalg.svd(there.T @ here)
    return np.asarray(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt)


def _make_start(
    gpst: np.datetime64, place: NavEstimate, velocity: Reals, attitude: Reals, settings: InsSettings
) -> NavState:
    """Make a state near the truth with a covariance that claims nothing."""
    return NavState(
        gpst=np.array([gpst]),
        position_ecef_m=(place.mean[0:3] - attitude @ settings.lever_m)[None],
        velocity_ecef_m_s=velocity[None],
        attitude=attitude[None],
        covariance=np.diag(np.repeat(np.square([_OPEN_M, _OPEN_M_S, _OPEN_RAD]), 3))[None],
    )


def _check_heading(state: InsState, p_value: float, heading_most_rad: float, because: str) -> Alignment:
    sigma_rad = heading_sigma_rad(state)
    found = sigma_rad <= heading_most_rad
    return Alignment(
        state=state if found else None,
        heading_sigma_rad=sigma_rad,
        p_value=p_value,
        because="" if found else f"heading to {np.degrees(sigma_rad):.0f} degrees: {because}",
    )
