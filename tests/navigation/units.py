"""Inertial units with errors, drawn on their own, and fixes of an antenna: for the tests of the inertial filter."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.gnss.imu_grades import ImuGrade
from skyproof.gnss.time import GPS_EPOCH
from skyproof.navigation.ins import SIZE, InsState
from skyproof.navigation.nav_estimate import NavEstimate, estimate_from_parts
from skyproof.records import ImuSeries, NavState
from skyproof.simulator.inertial import simulate_inertial
from skyproof.simulator.trajectories import make_circle, make_static

HOME = ecef_from_geodetic(0.9, 0.2, 100.0)
ROUND = make_circle(HOME, 300.0, 30.0)
REST = make_static(HOME, heading_rad=0.5, pitch_rad=0.1, roll_rad=-0.2)
ARM = np.array([0.5, 0.2, -1.0])


def label(seconds):
    return GPS_EPOCH + np.rint(np.asarray(seconds) * 1e9).astype("timedelta64[ns]")


def read_perfectly(motion, duration_s, rate_hz=20.0, start_s=0.0):
    unit = simulate_inertial(motion.at, rate_hz=rate_hz, duration_s=duration_s, start_s=start_s)
    return unit.read(0, unit.n_samples)


@dataclass(frozen=True)
class Unit:
    """readings with errors, of bias and gain; bias (n + 1, 6) of accelerometers and gyros, constant and slow part."""

    readings: ImuSeries
    bias: np.ndarray


def add_errors(true: ImuSeries, grade: ImuGrade, rng: np.random.Generator) -> Unit:
    n, dt = true.gpst.size, true.interval_s
    six = np.repeat([grade.accelerometer_repeatability_m_s2, grade.gyro_repeatability_rad_s], 3)
    sigma = np.repeat([grade.accelerometer_instability_m_s2, grade.gyro_instability_rad_s], 3)
    walk = np.repeat([grade.velocity_random_walk_m_s_rts, grade.angular_random_walk_rad_rts], 3)
    fade = np.exp(-dt / grade.correlation_s)
    bias = np.empty((n + 1, 6))
    bias[0] = sigma * rng.standard_normal(6)
    for k in range(n):
        bias[k + 1] = fade * bias[k] + sigma * np.sqrt(1.0 - fade**2) * rng.standard_normal(6)
    bias += six * rng.standard_normal(6)
    stream = rng.spawn(1)[0]
    gain = grade.misalignment_rad * stream.standard_normal((2, 3, 3))
    for part, scale in zip(gain, (grade.accelerometer_scale, grade.gyro_scale), strict=True):
        part[np.diag_indices(3)] = scale * stream.standard_normal(3)
    wrong = 0.5 * (bias[1:] + bias[:-1]) + walk / np.sqrt(dt) * rng.standard_normal((n, 6))
    readings = replace(
        true,
        specific_force_m_s2=true.specific_force_m_s2 @ (np.eye(3) + gain[0]).T + wrong[:, :3],
        angular_rate_rad_s=true.angular_rate_rad_s @ (np.eye(3) + gain[1]).T + wrong[:, 3:],
    )
    return Unit(readings, bias)


def cut_piece(readings: ImuSeries, start_s: float, end_s: float) -> ImuSeries:
    rows = slice(*np.searchsorted(readings.gpst, [label(start_s), label(end_s)], side="right"))
    return replace(
        readings,
        gpst=readings.gpst[rows],
        specific_force_m_s2=readings.specific_force_m_s2[rows],
        angular_rate_rad_s=readings.angular_rate_rad_s[rows],
    )


def draw_start(motion, sigma, rng, at_s=0.0) -> NavState:
    """Draw a start that is off the truth by errors of `sigma` (9,)."""
    m, off = motion.at(np.array([at_s])), sigma * rng.standard_normal(9)
    return NavState(
        gpst=label([at_s]),
        position_ecef_m=m.position_ecef_m + off[:3],
        velocity_ecef_m_s=m.velocity_ecef_m_s + off[3:6],
        attitude=(Rotation.from_rotvec(off[6:]).as_matrix() @ m.attitude[0])[None],
        covariance=np.diag(sigma**2)[None],
    )


def draw_fix(motion, at_s, rng, place_m=1.5, speed_m_s=0.1, arm=ARM, shift=0.0) -> NavEstimate:
    m = motion.at(np.array([at_s]))
    turned = m.attitude[0] @ np.stack((arm, np.cross(m.angular_rate_body_rad_s[0], arm)), axis=1)
    return estimate_from_parts(
        label(at_s),
        position_ecef_m=m.position_ecef_m[0] + turned[:, 0] + shift + place_m * rng.standard_normal(3),
        position_m2=place_m**2 * np.eye(3),
        velocity_ecef_m_s=m.velocity_ecef_m_s[0] + turned[:, 1] + speed_m_s * rng.standard_normal(3),
        velocity_m2_s2=speed_m_s**2 * np.eye(3),
    )


def compute_nees(state: InsState, motion, at_s: float, bias) -> float:
    """Compute NEES of the fifteen errors, chi-square with as many degrees where the covariance is true."""
    m = motion.at(np.array([at_s]))
    psi = Rotation.from_matrix(state.attitude @ m.attitude[0].T).as_rotvec()
    remaining = bias - np.concatenate((state.accelerometer_bias_m_s2, state.gyro_bias_rad_s))
    apart = (state.position_ecef_m - m.position_ecef_m[0], state.velocity_ecef_m_s - m.velocity_ecef_m_s[0])
    error = np.concatenate((*apart, psi, remaining))
    fifteen = np.zeros((15, SIZE))
    fifteen[:15, :15] = np.eye(15)
    fifteen[9:, 15:21] = np.eye(6)
    return float(error @ np.linalg.solve(fifteen @ state.covariance @ fifteen.T, error))
