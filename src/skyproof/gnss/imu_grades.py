"""Grades of inertial units: how large the errors of gyros and accelerometers are, by name."""

from dataclasses import dataclass
from typing import Final

import numpy as np

__all__ = ["GRADES", "ImuGrade", "imu_grade"]

_MILLI_G_M_S2: Final = 9.80665e-3
_DEG_PER_HOUR_RAD_S: Final = np.pi / 180.0 / 3600.0
_IN_RUN: Final = 0.1  # of a stated bias, that changes during a run


@dataclass(frozen=True, kw_only=True)
class ImuGrade:
    """Errors of one axis of a grade, in SI units; standard deviations. `source` says whose figures they are.

    velocity_random_walk_m_s_rts, angular_random_walk_rad_rts : white noise, in m/s and rad per square root of a second.
    ..._instability : standard deviation of the Gauss-Markov bias, whose Allan deviation peaks at 0.617 of it.
    ..._repeatability : of the constant bias, drawn again at each turn-on (each seed). ..._scale : of the scale factor,
    without unit; misalignment_rad : of each sensor axis toward each other axis.
    """

    velocity_random_walk_m_s_rts: float
    angular_random_walk_rad_rts: float
    accelerometer_instability_m_s2: float
    gyro_instability_rad_s: float
    accelerometer_repeatability_m_s2: float = 0.0
    gyro_repeatability_rad_s: float = 0.0
    correlation_s: float = 300.0
    accelerometer_scale: float = 0.0
    gyro_scale: float = 0.0
    misalignment_rad: float = 0.0
    source: str = ""


def imu_grade(
    *,
    gyro_bias_deg_h: float,
    gyro_noise_deg_sqrt_h: float,
    accel_bias_ug: float,
    accel_noise_m_s_sqrt_h: float,
    scale_ppm: float = 0.0,
    misalignment_mrad: float = 0.0,
    source: str = "as stated",
) -> ImuGrade:
    """Make a grade from the figures of a data sheet.

    Bias is what a unit has after turn-on, one sigma; a tenth of it changes during a run (300 s), which is our choice.
    Noise is angular and velocity random walk. Scale factors hold for gyros and accelerometers alike.
    """
    return _convert_grade(
        m_s_rthour=accel_noise_m_s_sqrt_h,
        milli_g=_IN_RUN * 1e-3 * accel_bias_ug,
        deg_rthour=gyro_noise_deg_sqrt_h,
        deg_hour=_IN_RUN * gyro_bias_deg_h,
        turn_on_milli_g=1e-3 * accel_bias_ug,
        turn_on_deg_hour=gyro_bias_deg_h,
        gyro_ppm=scale_ppm,
        accelerometer_ppm=scale_ppm,
        misalignment_mrad=misalignment_mrad,
        source=source,
    )


def _convert_grade(
    *,
    m_s_rthour: float,
    milli_g: float,
    deg_rthour: float,
    deg_hour: float,
    turn_on_milli_g: float,
    turn_on_deg_hour: float,
    gyro_ppm: float,
    accelerometer_ppm: float,
    misalignment_mrad: float,
    source: str,
) -> ImuGrade:
    """Convert figures in the units of data sheets."""
    return ImuGrade(
        velocity_random_walk_m_s_rts=m_s_rthour / 60.0,
        angular_random_walk_rad_rts=np.radians(deg_rthour) / 60.0,
        accelerometer_instability_m_s2=milli_g * _MILLI_G_M_S2,
        gyro_instability_rad_s=deg_hour * _DEG_PER_HOUR_RAD_S,
        accelerometer_repeatability_m_s2=turn_on_milli_g * _MILLI_G_M_S2,
        gyro_repeatability_rad_s=turn_on_deg_hour * _DEG_PER_HOUR_RAD_S,
        gyro_scale=1e-6 * gyro_ppm,
        accelerometer_scale=1e-6 * accelerometer_ppm,
        misalignment_rad=1e-3 * misalignment_mrad,
        source=source,
    )


_GROVES = "Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems, 2nd ed., table 4.1"
_TABLE = "Ahmed, Khanafseh, Pervan, table 1"
_OURS = "turn-on bias, correlation time and, where not of the data sheet, gain errors are ours"
_CALIBRATED = "as a calibration leaves them"
_NAVIGATION = {"m_s_rthour": 0.0143, "milli_g": 0.01, "deg_rthour": 0.001, "deg_hour": 0.0035}
_TACTICAL = {"m_s_rthour": 0.06, "milli_g": 0.05, "deg_rthour": 0.15, "deg_hour": 0.5}
GRADES: dict[str, ImuGrade] = {
    "consumer": imu_grade(
        gyro_bias_deg_h=1800.0,
        gyro_noise_deg_sqrt_h=1.0,
        accel_bias_ug=30_000.0,
        accel_noise_m_s_sqrt_h=0.6,
        scale_ppm=10_000.0,
        misalignment_mrad=10.0,
        source=f"{_GROVES}: above 100 deg/h and 3 mg; the figures are ours, of chips as they leave the factory",
    ),
    "industrial": imu_grade(
        gyro_bias_deg_h=360.0,
        gyro_noise_deg_sqrt_h=0.4,
        accel_bias_ug=5_000.0,
        accel_noise_m_s_sqrt_h=0.06,
        scale_ppm=1_000.0,
        misalignment_mrad=1.0,
        source=f"between consumer and tactical of {_GROVES}; the figures are ours, of calibrated MEMS units",
    ),
    "navigation": _convert_grade(
        **_NAVIGATION,
        turn_on_milli_g=0.025,
        turn_on_deg_hour=0.003,
        gyro_ppm=5.0,
        accelerometer_ppm=100.0,
        misalignment_mrad=0.025,
        source=f"{_TABLE} (Honeywell HG9900); {_OURS}",
    ),
    "tactical": _convert_grade(
        **_TACTICAL,
        turn_on_milli_g=0.75,
        turn_on_deg_hour=4.0,
        gyro_ppm=500.0,
        accelerometer_ppm=300.0,
        misalignment_mrad=1.0,
        source=f"{_TABLE} (Safran STIM300); {_OURS}",
    ),
    "navigation-calibrated": _convert_grade(
        **_NAVIGATION,
        turn_on_milli_g=0.01,
        turn_on_deg_hour=0.002,
        gyro_ppm=2.0,
        accelerometer_ppm=40.0,
        misalignment_mrad=0.01,
        source=f"{_TABLE}; {_OURS}, {_CALIBRATED}",
    ),
    "tactical-calibrated": _convert_grade(
        **_TACTICAL,
        turn_on_milli_g=0.2,
        turn_on_deg_hour=1.0,
        gyro_ppm=130.0,
        accelerometer_ppm=80.0,
        misalignment_mrad=0.27,
        source=f"{_TABLE}; {_OURS}, {_CALIBRATED}",
    ),
}
"""By name. Biases of tactical units are from 1 to 100 deg/h (Groves, table 4.1): state the figures of a poor one, or of
one that is better, by `imu_grade`. The paper's table alone, without turn-on bias, is `dataclasses.replace(grade,
..._repeatability...=0.0)`.
"""
