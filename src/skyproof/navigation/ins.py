"""Correct an inertial navigator: position, velocity, attitude, biases of the sensors, and the clock.

Two functions over an explicit state: `step` advances it over readings (`inertia`: strapdown and its linear errors),
`correct` takes in a measurement (`ins_updates` makes them). An error-state filter: the estimates are kept out of the
covariance's states and corrected after each measurement, the attitude by a rotation (Groves, Principles of GNSS,
Inertial, and Multisensor Integrated Navigation Systems, 2nd ed., 14.1 and 14.2.6).

States are errors, the navigator's value minus truth. There are the 15 of position, velocity, attitude, accelerometers
and gyros, with each sensor's bias in its constant and its slow part, and the gain errors of both (39, `ins_errors`: of
sensors the errors that remain in the readings). Then c times clock bias and drift (2). Then the lasting error of fixes,
of position and c times clock (4): multipath and model errors stay in every fix for minutes. A filter without it takes a
thousand fixes for a thousand independent ones and claims a thirtieth of their error.
"""

from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg
from scipy.spatial.transform import Rotation

from skyproof.arrays import Reals
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.imu_grades import ImuGrade
from skyproof.gnss.oscillators import Oscillator, compute_clock_step
from skyproof.gnss.time import seconds_between
from skyproof.navigation.inertia import FreeRun, coast, compute_turn_and_tilt
from skyproof.navigation.ins_errors import GAINS, STATES, build_start_covariance
from skyproof.records import ImuSeries, NavState
from skyproof.statistics.distributions import chi_square_survival
from skyproof.statistics.kalman import kalman_update

__all__ = [
    "ACCELEROMETER",
    "ATTITUDE",
    "CLOCK",
    "GRAVITY_M_S2",
    "GYRO",
    "LASTING",
    "POSITION",
    "SIZE",
    "VELOCITY",
    "Innovation",
    "InsSettings",
    "InsState",
    "Measurement",
    "apply_correction",
    "begin",
    "correct",
    "step",
    "subtract_errors",
]

POSITION, VELOCITY, ATTITUDE = slice(0, 3), slice(3, 6), slice(6, 9)
ACCELEROMETER, GYRO = (slice(9, 12), slice(15, 18)), (slice(12, 15), slice(18, 21))
"""Of each sensor the constant and the slow part of the bias."""
CLOCK, LASTING = slice(STATES, STATES + 2), slice(STATES + 2, STATES + 6)
SIZE: Final = STATES + 6
_BIASES, _GAINS = slice(9, 21), slice(GAINS[0].start, GAINS[1].stop)
GRAVITY_M_S2: Final = 9.81
_TURNS_S: Final = 5.0  # our choice: what bodies take to turn
_OPEN_CLOCK: Final = 1e6, 1e4  # m and m/s: nothing is known


@dataclass(frozen=True, eq=False, kw_only=True)
class InsSettings:
    """What the filter takes for given.

    lever_m : (3,) from the unit to the antenna, body axes.
    lasting_m2 : (4, 4) covariance of the lasting error of position and c times clock in fixes, ECEF.
    lasting_s : after which it is another one (between multipath, a minute, and orbits, hours).
    tilt_most_rad : one sigma of a tilt beyond which the linear model holds no more, and the state ends.
    """

    grade: ImuGrade
    oscillator: Oscillator
    lever_m: Reals = field(default_factory=lambda: np.zeros(3))
    lasting_m2: Reals = field(default_factory=lambda: np.zeros((4, 4)))
    lasting_s: float = 600.0
    tilt_most_rad: float = np.radians(5.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class InsState:
    """What is known at one instant.

    run : the unit's state, and the covariance (45, 45) of all errors.
    bias : (12,) of the sensors, in their covariance's order: constant of accelerometers and gyros, then slow.
    gain : (2, 3, 3) errors of the gains of accelerometers and gyros.
    clock_m : (2,) c times bias and drift. lasting_m : (4,) what a fix there and then has more than truth.
    """

    run: FreeRun
    bias: Reals
    gain: Reals
    clock_m: Reals
    lasting_m: Reals

    @property
    def gpst(self) -> np.datetime64:
        """Return the time of the last reading."""
        return np.datetime64(self.run.state.gpst[0])

    @property
    def covariance(self) -> Reals:
        """Return the covariance (45, 45) of the errors."""
        return self.run.covariance

    @property
    def position_ecef_m(self) -> Reals:
        """Return the position (3,) of the unit."""
        return np.asarray(self.run.state.position_ecef_m[0])

    @property
    def velocity_ecef_m_s(self) -> Reals:
        """Return the velocity (3,) of the unit."""
        return np.asarray(self.run.state.velocity_ecef_m_s[0])

    @property
    def attitude(self) -> Reals:
        """Return the rotation (3, 3) from body to ECEF axes."""
        return np.asarray(self.run.state.attitude[0])

    @property
    def accelerometer_bias_m_s2(self) -> Reals:
        """Return the bias (3,) in body axes, constant and slow part together."""
        return self.bias[0:3] + self.bias[6:9]

    @property
    def gyro_bias_rad_s(self) -> Reals:
        """Return the bias (3,) in body axes, constant and slow part together."""
        return self.bias[3:6] + self.bias[9:12]

    @property
    def last(self) -> Reals:
        """Return the last specific force and angular rate (2, 3), errors taken off; at rest before the first."""
        return np.zeros((2, 3)) if self.run.last is None else self.run.last


@dataclass(frozen=True, eq=False, kw_only=True)
class Measurement:
    """What was measured, linear about a state.

    innovation : (m,) what the navigator says minus what was measured. sensitivity : (m, 45) of that to the errors.
    noise : (m, m) covariance of what was measured.
    """

    innovation: Reals
    sensitivity: Reals
    noise: Reals


@dataclass(frozen=True, kw_only=True)
class Innovation:
    """How a measurement fits: its normalised square, chi-square with `dof` degrees if state and measurement are true.

    used : it was taken in.
    """

    nis: float
    dof: int
    p_value: float
    used: bool


def begin(
    start: NavState, settings: InsSettings, clock_m: ArrayLike | None = None, clock_m2: ArrayLike | None = None
) -> InsState:
    """Start a filter at the last row of `start`, the state of the unit with its covariance.

    The grade's biases are unknown.

    clock_m, clock_m2 : (2,) and (2, 2), c times bias and drift; without them the clock is not known.

    Raises
    ------
    ValueError : a start without covariance, or a clock without one.
    """
    if start.covariance is None or (clock_m is None) != (clock_m2 is None):
        raise ValueError("a start or a clock without covariance; give both")
    covariance = np.zeros((SIZE, SIZE))
    covariance[:STATES, :STATES] = build_start_covariance(settings.grade)
    covariance[:9, :9] = start.covariance[-1]
    covariance[CLOCK, CLOCK] = np.diag(np.square(_OPEN_CLOCK)) if clock_m2 is None else clock_m2
    covariance[LASTING, LASTING] = settings.lasting_m2
    return InsState(
        run=FreeRun(state=_make_state(start.gpst[-1], *_split_state(start), covariance), covariance=covariance),
        bias=np.zeros(12),
        gain=np.zeros((2, 3, 3)),
        clock_m=np.zeros(2) if clock_m is None else np.asarray(clock_m, np.float64),
        lasting_m=np.zeros(4),
    )


def step(state: InsState, readings: ImuSeries, settings: InsSettings) -> tuple[NavState, InsState | None]:
    """Advance the state over later readings.

    Returns the unit's states after each, and the state at the last.

    The states' covariance is that of position, velocity and attitude. Gaps are bridged as in `inertia.coast`; None
    where a gap is too long, or the covariance too large to be true.
    """
    ahead_s = np.maximum(seconds_between(readings.gpst, state.gpst), 0.0)
    fade = np.exp(-ahead_s / settings.grade.correlation_s)[:, None]
    bias = state.bias[:6] + fade * state.bias[6:]
    path, run = coast(
        state.run,
        subtract_errors(readings, bias, state.gain),
        settings.grade,
        tilt_most_rad=settings.tilt_most_rad,
        further=partial(_propagate_clock_and_lasting, settings),
    )
    if run is None:
        return path, None
    passed_s = float(seconds_between(run.state.gpst[0], state.gpst))
    run = _add_second_order(run, passed_s)
    slow = np.repeat([1.0, np.exp(-passed_s / settings.grade.correlation_s)], 6)
    return path, replace(
        state,
        run=run,
        bias=slow * state.bias,
        clock_m=state.clock_m + [passed_s * state.clock_m[1], 0.0],
        lasting_m=np.exp(-passed_s / settings.lasting_s) * state.lasting_m,
    )


def subtract_errors(readings: ImuSeries, bias: Reals, gain: Reals) -> ImuSeries:
    """Subtract biases (6,) or (n, 6) of accelerometers and gyros, and gain errors (2, 3, 3), from readings."""
    force = readings.specific_force_m_s2 - bias[..., :3]
    rate = readings.angular_rate_rad_s - bias[..., 3:]
    return replace(readings, specific_force_m_s2=force - force @ gain[0].T, angular_rate_rad_s=rate - rate @ gain[1].T)


def _propagate_clock_and_lasting(settings: InsSettings, seconds: float) -> tuple[Reals, Reals]:
    """Return the transition and noise (6, 6) of the clock and of the lasting errors."""
    moves, noise_s2 = compute_clock_step(settings.oscillator, seconds)
    fade = np.exp(-seconds / settings.lasting_s)
    return (
        linalg.block_diag(moves, fade * np.eye(4)),
        linalg.block_diag(SPEED_OF_LIGHT_M_S**2 * noise_s2, (1.0 - fade**2) * settings.lasting_m2),
    )


def _add_second_order(run: FreeRun, seconds: float) -> FreeRun:
    """Add the second-order part of gravity, g tilt turn / 2, to the covariance.

    It counts as an acceleration that changes every `_TURNS_S`: white noise of twice its square times that.
    """
    turn2, tilt2 = compute_turn_and_tilt(run.state, run.covariance[None])
    density = 0.5 * GRAVITY_M_S2**2 * float(turn2[0] * tilt2[0]) * _TURNS_S
    covariance = run.covariance.copy()
    walk = density * np.array([[seconds**3 / 3.0, seconds**2 / 2.0], [seconds**2 / 2.0, seconds]])
    for axis in range(3):
        covariance[np.ix_([axis, axis + 3], [axis, axis + 3])] += walk
    state = _make_state(run.state.gpst[0], *_split_state(run.state), covariance)
    return FreeRun(state=state, covariance=covariance, last=run.last)


def correct(
    state: InsState, measurement: Measurement, *, false_alarm_probability: float = 0.0
) -> tuple[InsState, Innovation]:
    """Correct the state by a measurement; return it, and how the measurement fits.

    false_alarm_probability : if less than that is the chance of so bad a fit, the measurement is left out.
    """
    h, y = measurement.sensitivity, measurement.innovation
    update = kalman_update(state.covariance, h, measurement.noise, y)
    nis = float(update.statistic)
    p_value = float(chi_square_survival(nis, y.size))
    fit = Innovation(nis=nis, dof=y.size, p_value=p_value, used=p_value >= false_alarm_probability)
    if not fit.used:
        return state, fit
    return apply_correction(state, update.change, update.covariance), fit


def apply_correction(state: InsState, wrong: Reals, covariance: Reals) -> InsState:
    """Subtract estimated errors (45,) from the state, and set the covariance (45, 45) of the remaining ones."""
    covariance = 0.5 * (covariance + covariance.T)
    upright = Rotation.from_rotvec(-wrong[ATTITUDE]) * Rotation.from_matrix(state.attitude)
    place, speed = state.position_ecef_m - wrong[POSITION], state.velocity_ecef_m_s - wrong[VELOCITY]
    more, gain, last = wrong[_BIASES], wrong[_GAINS].reshape(2, 3, 3), state.run.last
    if last is not None:  # by which the next piece is corrected for turning
        last = last - np.stack((more[0:3] + more[6:9], more[3:6] + more[9:12])) - np.einsum("sjk,sk->sj", gain, last)
    return InsState(
        run=FreeRun(
            state=_make_state(state.gpst, place, speed, upright.as_matrix(), covariance),
            covariance=covariance,
            last=last,
        ),
        bias=state.bias + more,
        gain=state.gain + gain,
        clock_m=state.clock_m - wrong[CLOCK],
        lasting_m=state.lasting_m - wrong[LASTING],
    )


def _split_state(state: NavState) -> tuple[Reals, Reals, Reals]:
    return state.position_ecef_m[-1], state.velocity_ecef_m_s[-1], state.attitude[-1]


def _make_state(gpst: np.datetime64, place: Reals, speed: Reals, attitude: Reals, covariance: Reals) -> NavState:
    return NavState(
        gpst=np.array([gpst]),
        position_ecef_m=place[None],
        velocity_ecef_m_s=speed[None],
        attitude=attitude[None],
        covariance=covariance[None, :9, :9],
    )
