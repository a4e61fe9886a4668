"""Propagate the errors of a free-running inertial navigator by their linear model.

39 states: errors of position (3), velocity (3) and attitude (3) in ECEF axes as `NavState.covariance` has them, then in
the unit's axes the constant bias of accelerometers (3) and gyros (3) and their slowly changing bias (3 + 3), a
Gauss-Markov process whose driving noise has the density 2 sigma^2 / tau; and the gain errors of accelerometers (9) and
gyros (9), row by row of a matrix M: scale factors on its diagonal, misalignments beside. With f the specific force and
w the angular rate in the unit's axes,

    dr' = dv,   dv' = psi x C f + C (b_a + M_a f) + (gravity gradient) dr - 2 Omega x dv
    psi' = C (b_g + M_g w) - Omega x psi

(Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems, 2nd ed., 4.4.6 and 14.2.3, with
the sign of psi that `NavState` says). A gain error acts as a bias proportional to the reading, and is propagated as
such. Effects of force on gyros, and nonlinear ones, are left out.

The paper on decomposition (Ahmed, Khanafseh, Pervan) takes the figures of its table 1 for all there is; start errors
and the bias that changes with each turn-on make most of the drift, and stand in `build_start_covariance`.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from skyproof.arrays import Reals
from skyproof.gnss.frames import EARTH_RAD_S
from skyproof.gnss.gravity import compute_gravity_m_s2
from skyproof.gnss.imu_grades import ImuGrade
from skyproof.gnss.time import seconds_between
from skyproof.records import NavState

__all__ = [
    "GAINS",
    "STATES",
    "attach_covariance",
    "build_start_covariance",
    "compute_transitions",
    "propagate_covariance",
    "skew",
]

STATES: Final = 39
_CORE: Final = 21  # without the gain errors
_BIASES: Final = slice(9, 12), slice(12, 15)  # of accelerometers and gyros, the constant ones
GAINS: Final = slice(21, 30), slice(30, 39)
"""Of accelerometers and gyros, row by row: of each sensor for what is along each axis."""
_VELOCITY_AND_TILT: Final = np.arange(3, 9)


def build_start_covariance(
    grade: ImuGrade, *, position_m: float = 0.0, velocity_m_s: float = 0.0, tilt_rad: float = 0.0
) -> Reals:
    """Build the covariance (39, 39) at the start.

    The errors are independent, with these standard deviations per axis and the grade's own biases and gain errors.
    """
    sigma = (
        position_m,
        velocity_m_s,
        tilt_rad,
        grade.accelerometer_repeatability_m_s2,
        grade.gyro_repeatability_rad_s,
        grade.accelerometer_instability_m_s2,
        grade.gyro_instability_rad_s,
    )
    gains = [
        np.where(np.eye(3, dtype=np.bool_), scale, grade.misalignment_rad).ravel()
        for scale in (grade.accelerometer_scale, grade.gyro_scale)
    ]
    return np.diag(np.square(np.concatenate((np.repeat(sigma, 3), *gains))))


def propagate_covariance(
    path: NavState,
    grade: ImuGrade,
    start: ArrayLike,
    *,
    most_s: float = 1.0,
    extra: ArrayLike | None = None,
    further: Callable[[float], tuple[Reals, Reals]] | None = None,
) -> Reals:
    """Propagate the covariance (n, 39 + k, 39 + k) along `path` (n,), from `start` at its first.

    path : the navigator's, or a true one nearby. Its states should be at most `most_s` apart. Closer ones cost time
        and nothing else: the model steps at every one. Force and attitude are taken as even between states.
    extra : (n - 1, 2) variances of an axis of velocity and of attitude that each step has beyond the model's.
    further : transition and noise (k, k) over a time in s of k more states, which the navigator's do not drive.
    """
    moves, noises = compute_transitions(path, grade, most_s=most_s)
    if further is not None and len(moves):
        # Readings come evenly: few lengths of a step are different ones.
        lengths_s, number = np.unique(seconds_between(path.gpst[1:], path.gpst[:-1]), return_inverse=True)
        each = [further(float(length_s)) for length_s in lengths_s]
        moves = _join_blocks(moves, np.stack([more for more, _ in each])[number])
        noises = _join_blocks(noises, np.stack([more for _, more in each])[number])
    start = np.asarray(start, np.float64)
    covariance = np.empty((path.gpst.size, *start.shape))
    covariance[0] = start
    for k in range(len(moves)):
        after = moves[k] @ covariance[k] @ moves[k].T + noises[k]
        if extra is not None:
            after[_VELOCITY_AND_TILT, _VELOCITY_AND_TILT] += np.repeat(np.asarray(extra)[k], 3)
        covariance[k + 1] = 0.5 * (after + after.T)
    return covariance


def _join_blocks(first: Reals, second: Reals) -> Reals:
    """Join matrices (n, m, m) and (n, k, k) to blocks on the diagonal of (n, m + k, m + k)."""
    m, size = first.shape[-1], first.shape[-1] + second.shape[-1]
    joined = np.zeros((len(first), size, size))
    joined[:, :m, :m], joined[:, m:, m:] = first, second
    return joined


def compute_transitions(path: NavState, grade: ImuGrade, *, most_s: float = 1.0) -> tuple[Reals, Reals]:
    """Return transition and noise matrices (n - 1, 39, 39) of the errors between states of `path` (n,).

    Raises
    ------
    ValueError : steps longer than `most_s`.
    """
    steps_s = seconds_between(path.gpst[1:], path.gpst[:-1])
    if np.any(steps_s <= 0.0) or np.any(steps_s > most_s * (1.0 + 1e-9)):
        raise ValueError(f"path: steps from {steps_s.min():g} to {steps_s.max():g} s, expected above 0 to {most_s:g}")
    felt = _average_readings(path, steps_s[:, None])
    rates = _build_rates(path, felt, grade)
    # Van Loan, IEEE Trans. Automatic Control 23(3), 1978: both integrals from one exponential.
    block = np.zeros((len(rates), 2 * _CORE, 2 * _CORE))
    block[:, :_CORE, :_CORE] = -rates
    block[:, :_CORE, _CORE:] = _build_noise(grade)
    block[:, _CORE:, _CORE:] = np.swapaxes(rates, -1, -2)
    powers = _compute_exponential(block * steps_s[:, None, None])
    core = np.swapaxes(powers[:, _CORE:, _CORE:], -1, -2)
    step, noise = (np.zeros((len(rates), STATES, STATES)) for _ in range(2))
    step[:], step[:, :_CORE, :_CORE] = np.eye(STATES), core
    noise[:, :_CORE, :_CORE] = core @ powers[:, :_CORE, _CORE:]
    for gains, bias, reading in zip(GAINS, _BIASES, (felt.force, felt.rate), strict=True):
        step[:, :9, gains] = (core[:, :9, bias, None] * reading[:, None, None, :]).reshape(-1, 9, 9)
    return step, noise


def attach_covariance(path: NavState, covariance: Reals) -> NavState:
    """Attach the first nine states' covariance of (n, 39, 39) to the path."""
    return replace(path, covariance=covariance[:, :9, :9])


class _Felt(NamedTuple):
    """Between neighbouring states (n - 1, ...): the attitude half-way; means of specific force and angular rate in the
    unit's axes, as its readings are, and of the former in ECEF axes; the place."""

    attitude: Reals
    force: Reals
    rate: Reals
    force_ecef: Reals
    place: Reals


def _average_readings(path: NavState, steps_s: Reals) -> _Felt:
    velocity = 0.5 * (path.velocity_ecef_m_s[1:] + path.velocity_ecef_m_s[:-1])
    place = 0.5 * (path.position_ecef_m[1:] + path.position_ecef_m[:-1])
    pull = compute_gravity_m_s2(place)
    force = np.diff(path.velocity_ecef_m_s, axis=0) / steps_s + 2.0 * np.cross(EARTH_RAD_S, velocity) - pull
    turned = Rotation.from_matrix(np.swapaxes(path.attitude[:-1], -1, -2) @ path.attitude[1:]).as_rotvec()
    attitude = path.attitude[:-1] @ Rotation.from_rotvec(0.5 * turned).as_matrix()
    return _Felt(
        attitude=attitude,
        force=np.einsum("nji,nj->ni", attitude, force),
        rate=turned / steps_s + EARTH_RAD_S @ attitude,
        force_ecef=force,
        place=place,
    )


def _build_rates(path: NavState, felt: _Felt, grade: ImuGrade) -> Reals:
    """Build the model's matrix (n - 1, 21, 21) between neighbouring states, without the gain errors."""
    place, attitude = felt.place, felt.attitude
    span_m = 1000.0 * np.eye(3)
    gradient = (
        compute_gravity_m_s2(place[:, None, :] + span_m) - compute_gravity_m_s2(place[:, None, :] - span_m)
    ) / 2000.0  # symmetric
    rates = np.zeros((len(place), _CORE, _CORE))
    rates[:, 0:3, 3:6] = np.eye(3)
    rates[:, 3:6, 0:3] = gradient
    rates[:, 3:6, 3:6] = -2.0 * skew(EARTH_RAD_S)
    rates[:, 3:6, 6:9] = -skew(felt.force_ecef)
    rates[:, 6:9, 6:9] = -skew(EARTH_RAD_S)
    for accelerometer in (9, 15):
        rates[:, 3:6, accelerometer : accelerometer + 3] = attitude
        rates[:, 6:9, accelerometer + 3 : accelerometer + 6] = attitude
    rates[:, 15:, 15:] = -np.eye(6) / grade.correlation_s
    return rates


def _compute_exponential(matrices: Reals) -> Reals:
    """Compute exp of matrices (n, m, m) by its series, ten times as fast as `scipy.linalg.expm`.

    The model is a chain from biases over tilt and velocity to position: powers beyond the ninth are nothing. Over steps
    of up to two seconds it agrees with the other to 1e-14, noise to 4e-13 of its size.
    """
    power, total = matrices, np.eye(matrices.shape[-1]) + matrices
    for k in range(2, 10):
        power = power @ matrices / k
        total = total + power
    return np.asarray(total)


def _build_noise(grade: ImuGrade) -> Reals:
    """Return the density (21, 21) of the driving noise."""
    slow = np.square((grade.accelerometer_instability_m_s2, grade.gyro_instability_rad_s)) * 2.0 / grade.correlation_s
    density = (0.0, grade.velocity_random_walk_m_s_rts**2, grade.angular_random_walk_rad_rts**2, 0.0, 0.0, *slow)
    return np.diag(np.repeat(density, 3))


def skew(vector: Reals) -> Reals:
    """Build the matrices [v x] (..., 3, 3) of vectors (..., 3)."""
    x, y, z = np.moveaxis(np.asarray(vector), -1, 0)
    zero = np.zeros_like(x)
    rows = ((zero, -z, y), (z, zero, -x), (-y, x, zero))
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
