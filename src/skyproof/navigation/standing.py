"""Whether a body stands, by its inertial unit: then its velocity is known to be nothing.

A body that stands has readings that are constant but for the unit's white noise, and no velocity and no turn beyond
what the filter leaves open. Two tests, each at half of the stated rate:

- the spread of readings about their mean: its sum of squares over the noise's variance is chi-square with 6 (n - 1)
  degrees for n readings of three accelerometers and three gyros;
- velocity and mean rate against nothing and the Earth's turn: the normalised innovation of `ins_updates.by_rest`, chi-
  square with six degrees.

So bodies that stand are said to move at the stated rate; one that vibrates more than the unit's noise always moves. The
other fault, a body that moves as evenly as one that stands, shows in the velocity alone. Nothing is called standing
where the filter does not know its velocity well enough to notice the slowest speed at which the body moves.
"""

from typing import Final, NamedTuple

import numpy as np

from skyproof.gnss.imu_grades import ImuGrade
from skyproof.navigation.ins import VELOCITY, InsSettings, InsState, Measurement
from skyproof.navigation.ins_updates import by_rest
from skyproof.records import ImuSeries
from skyproof.statistics.distributions import chi_square_survival, chi_square_threshold

__all__ = ["Stillness", "at_rest", "stillness"]

_LEAST: Final = 8  # readings, by which a spread is known


class Stillness(NamedTuple):
    """statistic : chi-square with `dof` degrees if the unit stands. p_value : of so large a one."""

    statistic: float
    dof: int
    p_value: float


def stillness(readings: ImuSeries, grade: ImuGrade) -> Stillness:
    """The spread of readings about their mean, over the unit's white noise.

    Raises
    ------
    ValueError : fewer than two readings.
    """
    n = readings.gpst.size
    if n < 2:
        raise ValueError(f"{n} readings have no spread; give two or more")
    statistic = 0.0
    for values, walk in (
        (readings.specific_force_m_s2, grade.velocity_random_walk_m_s_rts),
        (readings.angular_rate_rad_s, grade.angular_random_walk_rad_rts),
    ):
        statistic += float(np.sum((values - values.mean(axis=0)) ** 2)) * readings.interval_s / walk**2
    dof = 6 * (n - 1)
    return Stillness(statistic, dof, float(chi_square_survival(statistic, dof)))


def at_rest(
    state: InsState,
    readings: ImuSeries,
    settings: InsSettings,
    *,
    false_alarm_probability: float = 1e-3,
    least_speed_m_s: float = 0.3,
    sway_m_s: float = 0.01,
) -> Measurement | None:
    """The correction of a body that stands, None where it moves or that is not known.

    readings : the last ones, up to the state's instant; half a second of them at least is of use.
    least_speed_m_s : slower than this the body does not move evenly.
    """
    n = readings.gpst.size
    seen = float(chi_square_threshold(false_alarm_probability, 3))
    sigma2 = float(np.linalg.eigvalsh(state.covariance[VELOCITY, VELOCITY])[-1]) + sway_m_s**2
    if n < _LEAST or sigma2 * seen > least_speed_m_s**2:
        return None
    if stillness(readings, settings.grade).p_value < 0.5 * false_alarm_probability:
        return None
    rate_sigma = settings.grade.angular_random_walk_rad_rts / np.sqrt(n * readings.interval_s)
    rest = by_rest(state, readings.angular_rate_rad_s.mean(axis=0), rate_sigma, sway_m_s=sway_m_s)
    spread = rest.sensitivity @ state.covariance @ rest.sensitivity.T + rest.noise
    nis = float(rest.innovation @ np.linalg.solve(spread, rest.innovation))
    return rest if nis <= float(chi_square_threshold(0.5 * false_alarm_probability, 6)) else None
