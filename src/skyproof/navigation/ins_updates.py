"""What corrects an inertial navigator: fixes, ranges and range rates, and the body's standing still.

Each function makes a `Measurement` about a state. Measurements may be up to a reading's interval later than the state:
the antenna is carried there along its velocity and acceleration.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Reals
from skyproof.gnss.constants import EARTH_ROTATION_RAD_S
from skyproof.gnss.frames import geodetic_from_ecef, heading_pitch_roll_rad, rot_enu_ecef
from skyproof.gnss.gravity import gravity_ecef_m_s2
from skyproof.gnss.time import seconds_between, week_and_tow
from skyproof.navigation.fix import range_rates
from skyproof.navigation.ins import (
    ACCELEROMETER,
    ATTITUDE,
    CLOCK,
    GYRO,
    LASTING,
    POSITION,
    SIZE,
    VELOCITY,
    InsSettings,
    InsState,
    Measurement,
)
from skyproof.navigation.ins_errors import GAINS, skew
from skyproof.navigation.known import KNOWN, Known
from skyproof.navigation.least_squares import line_of_sight
from skyproof.navigation.ranges import atmosphere, corrected_ranges, space_sigma_m, time_scales
from skyproof.records import NavigationData, Observations, SignalId

__all__ = ["antenna_of", "by_fix", "by_gravity", "by_heading", "by_ranges", "by_rest", "expected"]

_SPIN: Final = np.array([0.0, 0.0, EARTH_ROTATION_RAD_S])


class _Antenna(NamedTuple):
    """Position, velocity, c times clock bias and drift (8,), and their sensitivity (8, 45) to the state's errors."""

    mean: Reals
    sensitivity: Reals


def _antenna(state: InsState, settings: InsSettings, gpst: np.datetime64) -> _Antenna:
    """What is true of the antenna at an instant near the state's, as the state has it."""
    ahead_s = float(seconds_between(gpst, state.gpst))
    force, rate = state.last
    arm = state.attitude @ settings.lever_m
    swing = state.attitude @ np.cross(rate - _SPIN @ state.attitude, settings.lever_m)
    speed, pull = state.velocity_ecef_m_s + swing, np.zeros(3)
    if state.run.last is not None:
        pull = state.attitude @ force + gravity_ecef_m_s2(state.position_ecef_m) - 2.0 * np.cross(_SPIN, speed)
    clock_m = state.clock_m + [ahead_s * state.clock_m[1], 0.0]
    h = np.zeros((KNOWN, SIZE))
    h[0:3, POSITION] = h[3:6, VELOCITY] = np.eye(3)
    h[0:3, ATTITUDE], h[3:6, ATTITUDE] = -skew(arm), -skew(swing)
    _of_sensor(h[3:6], GYRO, GAINS[1], -state.attitude @ skew(settings.lever_m), rate)
    h[6:8, CLOCK] = np.eye(2)
    h[0:3] += ahead_s * h[3:6]
    h[6] += ahead_s * h[7]
    place = state.position_ecef_m + arm + ahead_s * speed + 0.5 * ahead_s**2 * pull
    return _Antenna(np.concatenate((place, speed + ahead_s * pull, clock_m)), h)


def _of_sensor(h: Reals, biases: tuple[slice, slice], gains: slice, by: Reals, felt: Reals, slow: float = 1.0) -> None:
    """Put into rows (m, 45) the sensitivity `by` (m, 3) to a sensor's error: biases, and gains by what it felt (3,)."""
    h[:, biases[0]], h[:, biases[1]] = by, slow * by
    h[:, gains] = (by[:, :, None] * felt).reshape(len(by), 9)


def antenna_of(state: InsState, settings: InsSettings, gpst: np.datetime64 | None = None) -> Known:
    """What is true of the antenna, at the state's instant or one near it."""
    gpst = state.gpst if gpst is None else gpst
    mean, h = _antenna(state, settings, gpst)
    return Known(gpst=gpst, mean=mean, covariance=h @ state.covariance @ h.T)


def expected(state: InsState, settings: InsSettings, gpst: np.datetime64 | None = None) -> Known:
    """What a fix at the antenna would say, lasting error included, at the state's instant or one near it."""
    gpst = state.gpst if gpst is None else gpst
    mean, h = _as_a_fix(state, settings, gpst)
    return Known(gpst=gpst, mean=mean, covariance=h @ state.covariance @ h.T)


def _as_a_fix(state: InsState, settings: InsSettings, gpst: np.datetime64) -> _Antenna:
    mean, h = _antenna(state, settings, gpst)
    rows = [0, 1, 2, 6]
    h[rows, LASTING] = np.eye(4)
    mean[rows] += state.lasting_m
    return _Antenna(mean, h)


def by_fix(state: InsState, fix: Known, settings: InsSettings) -> Measurement:
    """A fix of the antenna, of which whatever is known counts. Its covariance is that of the noise alone, which is
    another one in the next fix; the lasting error stands in the settings."""
    mean, h = _as_a_fix(state, settings, fix.gpst)
    there = fix.there
    return Measurement(
        innovation=(mean - fix.mean)[there], sensitivity=h[there], noise=fix.covariance[np.ix_(there, there)]
    )


def by_ranges(
    state: InsState,
    observations: Observations,
    row: int,
    navigation: NavigationData,
    settings: InsSettings,
    *,
    signals: tuple[SignalId, ...] | None = None,
    multipath_sigma_m: float = 0.5,
    ionosphere_share: float = 0.25,
    elevation_mask_deg: float = 5.0,
    range_rate_sigma_m_s: float = 0.05,
) -> Measurement:
    """Pseudoranges and Dopplers of one epoch, any number of satellites: models and sigmas as in `fix`.

    The label is taken for GPS time to within a millisecond, so that the clock's bias is what `Fix.clock_bias_s` says.
    What multipath and ionosphere leave changes slowly and differs from satellite to satellite: as far as it is common
    to a fix, it is the settings' lasting error; the rest is taken for noise.

    Raises
    ------
    ValueError : signals of several time scales.
    """
    signals = observations.signals if signals is None else signals
    if len(time_scales(signals)[0]) > 1:
        raise ValueError("signals of several time scales; give those of one with `signals`")
    columns = [observations.signals.index(signal) for signal in signals]
    gpst = observations.gpst[row : row + 1]
    mean, h = _as_a_fix(state, settings, gpst[0])
    carrier_hz = observations.carrier_hz[columns]
    ranges = corrected_ranges(signals, gpst, observations.pseudorange_m[row : row + 1, columns], navigation)
    satellite, unit, distance_m = line_of_sight(ranges.satellite_ecef_m[0], mean[0:3])
    delays = atmosphere(
        mean[0:3],
        satellite,
        week_and_tow(gpst)[1][0],
        navigation.ionosphere,
        ionosphere_share=ionosphere_share,
        carrier_hz=carrier_hz,
    )
    sigma_m = np.sqrt(
        observations.pseudorange_sigma_m[row, columns] ** 2
        + (multipath_sigma_m / np.sin(delays.elevation_rad)) ** 2
        + delays.sigma_m**2
        + space_sigma_m(signals) ** 2
    )
    rates = range_rates(
        ranges,
        satellite[None],
        unit[None],
        distance_m[None],
        observations.doppler_hz[row : row + 1, columns],
        observations.doppler_sigma_hz[row : row + 1, columns],
        carrier_hz,
    )
    codes = distance_m + mean[6] - (ranges.range_m[0] - delays.delay_m)
    dopplers = -unit @ mean[3:6] + rates.drift_gain[0] * mean[7] - rates.measured_m_s[0]
    high = delays.elevation_rad >= np.radians(elevation_mask_deg)
    misfit = np.concatenate((codes, dopplers))
    sigma = np.concatenate((sigma_m, np.hypot(rates.sigma_m_s[0], range_rate_sigma_m_s)))
    sensitivity = np.concatenate((-unit @ h[0:3] + h[6], -unit @ h[3:6] + rates.drift_gain[0][:, None] * h[7]))
    used = np.flatnonzero(np.tile(high, 2) & np.isfinite(misfit) & np.isfinite(sigma))
    return Measurement(innovation=misfit[used], sensitivity=sensitivity[used], noise=np.diag(sigma[used] ** 2))


def by_rest(
    state: InsState,
    angular_rate_rad_s: ArrayLike,
    rate_sigma_rad_s: float,
    *,
    sway_m_s: float = 0.01,
    slow: float = 1.0,
) -> Measurement:
    """The unit stands: no velocity, but for a sway of so much, and no turn but the Earth's.

    angular_rate_rad_s : (3,) mean reading over the rest, biases included, with noise of `rate_sigma_rad_s` an axis.
    slow : share of the state's slow bias that is in that mean.
    """
    h = np.zeros((6, SIZE))
    h[0:3, VELOCITY] = np.eye(3)
    h[3:6, ATTITUDE] = -state.attitude.T @ skew(_SPIN)
    rate = state.true_rate(angular_rate_rad_s)
    _of_sensor(h[3:6], GYRO, GAINS[1], np.eye(3), rate, slow)
    turn = rate - _SPIN @ state.attitude
    noise = np.diag(np.repeat(np.square([sway_m_s, rate_sigma_rad_s]), 3))
    return Measurement(innovation=np.concatenate((state.velocity_ecef_m_s, turn)), sensitivity=h, noise=noise)


def by_gravity(
    state: InsState, specific_force_m_s2: ArrayLike, noise_m2_s4: ArrayLike, *, slow: float = 1.0
) -> Measurement:
    """The unit stands, and its accelerometers feel gravity alone. Only for readings that did not carry the state here:
    they are in its velocity already.

    specific_force_m_s2 : (3,) mean reading over the rest, biases included. noise_m2_s4 : (3, 3).
    slow : share of the state's slow bias that is in that mean.
    """
    gravity = gravity_ecef_m_s2(state.position_ecef_m)
    h = np.zeros((3, SIZE))
    h[:, ATTITUDE] = state.attitude.T @ skew(gravity)
    felt = state.true_force(specific_force_m_s2)
    _of_sensor(h, ACCELEROMETER, GAINS[0], np.eye(3), felt, slow)
    return Measurement(
        innovation=felt + gravity @ state.attitude, sensitivity=h, noise=np.asarray(noise_m2_s4, np.float64)
    )


def by_heading(state: InsState, heading_rad: float, sigma_rad: float) -> Measurement:
    """The heading is known."""
    found_rad = heading_pitch_roll_rad(state.position_ecef_m, state.attitude)[0]
    forward, (east, north, _) = state.attitude[:, 0], rot_enu_ecef(*geodetic_from_ecef(state.position_ecef_m)[:2])
    along_east, along_north = forward @ east, forward @ north
    by_forward = (along_north * east - along_east * north) / (along_east**2 + along_north**2)
    h = np.zeros((1, SIZE))
    h[0, ATTITUDE] = np.cross(forward, by_forward)
    off = float(found_rad) - heading_rad
    return Measurement(
        innovation=np.array([(off + np.pi) % (2.0 * np.pi) - np.pi]), sensitivity=h, noise=np.array([[sigma_rad**2]])
    )
