"""Position, velocity and clock, epoch by epoch, from one set of signals; all epochs of a block at once."""

from dataclasses import dataclass

import numpy as np

from skyproof.arrays import Booleans, Indices, Reals
from skyproof.gnss.constants import EARTH_ROTATION_RAD_S, SPEED_OF_LIGHT_M_S
from skyproof.gnss.sky import rotate_to_reception
from skyproof.gnss.time import week_and_tow
from skyproof.navigation.least_squares import (
    Solution,
    compute_line_of_sight,
    design_matrix,
    fit_position,
    invert_normal,
    invert_spd,
)
from skyproof.navigation.raim import exclude_several
from skyproof.navigation.ranges import (
    Ranges,
    compute_atmosphere,
    compute_space_sigma_m,
    correct_ranges,
    list_time_scales,
)
from skyproof.records import Fix, FixStatus, NavigationData, Observations, SignalId

__all__ = ["FixGeometry", "RangeRates", "compute_range_rates", "fix", "fix_and_geometry"]

_BLOCK_EPOCHS = 4096  # bounds the memory of a day at 1 Hz
_CONVERGED_M = 1e-2


@dataclass(frozen=True, eq=False, kw_only=True)
class FixGeometry:
    """The linear problem at each epoch's fix, for `raim` and `protection`.

    design (n_epochs, n_signals, 3 + c) by position and the clock of each time scale; misfit_m and sigma_m
    (n_epochs, n_signals), NaN where not used.
    """

    design: Reals
    misfit_m: Reals
    sigma_m: Reals


@dataclass(frozen=True)
class _Settings:
    multipath_sigma_m: float
    ionosphere_share: float
    elevation_mask_rad: float
    start_ecef_m: Reals
    max_gdop: float
    false_alarm_probability: float | None


@dataclass(frozen=True)
class _Channels:
    """What does not change with time: columns, carrier_hz (k,), clocks (k, c) or None for one scale, space_m (k,)."""

    signals: tuple[SignalId, ...]
    columns: list[int]
    carrier_hz: Reals
    scales: tuple[str, ...]
    clocks: Reals | None
    space_m: Reals


def fix(
    observations: Observations,
    navigation: NavigationData,
    *,
    signals: tuple[SignalId, ...] | None = None,
    multipath_sigma_m: float = 0.5,
    ionosphere_share: float = 0.25,
    elevation_mask_deg: float = 5.0,
    start_ecef_m: Reals | None = None,
    max_gdop: float = 50.0,
    false_alarm_probability: float | None = None,
) -> Fix:
    """Solve for position and clock from pseudoranges, and for velocity and drift from Dopplers.

    Each is a weighted least-squares fit. The receiver's clock may be off by seconds. Klobuchar, Saastamoinen, group
    delay, relativity and Sagnac are taken off. One pseudorange has

        sigma^2 = thermal^2 + (multipath_sigma_m / sin el)^2 + (ionosphere_share * ionosphere)^2 + space^2

    the law of the RTKLIB 2.4.2 manual, appendix E.6 (a^2 + b^2 / sin^2 el) with the measured thermal noise for a, and
    `ranges.compute_space_sigma_m`, what a system's orbits and clocks are worse than those of GPS.

    Each time scale among the signals (GPS and QZSS share one) has a clock bias of its own at every epoch: the receiver
    delays its signals in its own way, and the scales differ. A scale without a satellite is left out of that epoch.

    Parameters
    ----------
    signals : those to use, by default all; at most one of a satellite at a time.
    multipath_sigma_m : multipath at the zenith, one sigma.
    ionosphere_share : what `ranges.compute_atmosphere` leaves of the ionosphere.
    elevation_mask_deg : satellites lower than this are not used.
    start_ecef_m : (3,) where to start, by default the Earth's centre.
    max_gdop : geometry beyond this is `FixStatus.WEAK_GEOMETRY`.
    false_alarm_probability : if given, epochs whose residuals fail `raim.check_residuals` at this rate leave out as few
        measurements as make them pass, by `raim.exclude_several`; where that does not help, all are kept. Never to be
        used to decide who is authentic.

    Returns
    -------
    Fix, with status 1 for fewer satellites than unknowns, 2 for weak geometry, 3 without convergence. Velocity and
    drift are NaN, too, where fewer than four of the satellites have a Doppler.

    Raises
    ------
    ValueError : a signal is not in the observations, or two signals of a satellite are to be used at once.
    """
    return fix_and_geometry(
        observations,
        navigation,
        signals=signals,
        multipath_sigma_m=multipath_sigma_m,
        ionosphere_share=ionosphere_share,
        elevation_mask_deg=elevation_mask_deg,
        start_ecef_m=start_ecef_m,
        max_gdop=max_gdop,
        false_alarm_probability=false_alarm_probability,
    )[0]


def fix_and_geometry(
    observations: Observations,
    navigation: NavigationData,
    *,
    signals: tuple[SignalId, ...] | None = None,
    multipath_sigma_m: float = 0.5,
    ionosphere_share: float = 0.25,
    elevation_mask_deg: float = 5.0,
    start_ecef_m: Reals | None = None,
    max_gdop: float = 50.0,
    false_alarm_probability: float | None = None,
    reflected_sigma_m: Reals | None = None,
) -> tuple[Fix, FixGeometry]:
    """Solve as `fix` does, and return the last linear problem too.

    reflected_sigma_m : (n_epochs, n_channels) of reflections beyond `multipath_sigma_m`; none if absent.
    """
    channels = _select_channels(observations, observations.signals if signals is None else signals)
    settings = _Settings(
        multipath_sigma_m,
        ionosphere_share,
        np.radians(elevation_mask_deg),
        np.zeros(3) if start_ecef_m is None else np.asarray(start_ecef_m, np.float64),
        max_gdop,
        false_alarm_probability,
    )
    n = observations.gpst.size
    noise_m = observations.pseudorange_sigma_m[:, channels.columns]
    if reflected_sigma_m is not None:
        noise_m = np.hypot(noise_m, reflected_sigma_m[:, channels.columns])
    blocks = [
        _fix_block(observations, navigation, channels, noise_m, slice(first, first + _BLOCK_EPOCHS), settings)
        for first in range(0, max(n, 1), _BLOCK_EPOCHS)
    ]
    state, offset_m, velocity, covariance, residual, status, design, sigma = (
        np.concatenate(parts) for parts in zip(*blocks, strict=True)
    )
    bias_s = state[:, 3] / SPEED_OF_LIGHT_M_S
    bias_ns = np.rint(np.nan_to_num(bias_s) * 1e9).astype(np.int64)
    found = Fix(
        receiver=observations.receiver,
        signals=channels.signals,
        gpst=observations.gpst - bias_ns.astype("timedelta64[ns]"),
        position_ecef_m=state[:, :3],
        velocity_ecef_m_s=velocity[:, :3],
        clock_bias_s=bias_s,
        clock_drift=velocity[:, 3] / SPEED_OF_LIGHT_M_S,
        covariance_m2=covariance,
        residual_m=residual,
        status=status.astype(np.uint8),
        inter_system_s={scale: offset_m[:, k] / SPEED_OF_LIGHT_M_S for k, scale in enumerate(channels.scales)},
    )
    return found, FixGeometry(design=design, misfit_m=residual, sigma_m=sigma)


def _select_channels(observations: Observations, signals: tuple[SignalId, ...]) -> _Channels:
    where = {signal: column for column, signal in enumerate(observations.signals)}
    missing = [str(signal) for signal in signals if signal not in where]
    if missing:
        raise ValueError(f"{observations.receiver} has no signal {', '.join(missing)}")
    columns = [where[signal] for signal in signals]
    present = np.isfinite(observations.pseudorange_m[:, columns])
    for sat in {signal.sat for signal in signals}:
        at_once = present[:, [signal.sat == sat for signal in signals]].sum(axis=1)
        if np.any(at_once > 1):
            raise ValueError(f"several signals of {sat} at once in {observations.receiver}; say which with `signals`")
    scales, clocks = list_time_scales(signals)
    return _Channels(
        signals,
        columns,
        observations.carrier_hz[columns],
        scales,
        clocks if len(scales) > 1 else None,
        compute_space_sigma_m(signals),
    )


def _fix_block(
    observations: Observations,
    navigation: NavigationData,
    channels: _Channels,
    noise_m: Reals,
    rows: slice,
    settings: _Settings,
) -> tuple[Reals, ...]:
    """Fix a block of epochs.

    Returns state (n, 4), other clocks minus that one in metres (n, c), velocity and drift in m/s (n, 4), covariance (n,
    4, 4), residuals (n, k), status (n,), design (n, k, 3 + c) and sigma (n, k).
    """
    gpst, columns = observations.gpst[rows], channels.columns
    ranges = correct_ranges(channels.signals, gpst, observations.pseudorange_m[rows][:, columns], navigation)
    _, tow_s = week_and_tow(gpst)  # of the label: the ionosphere does not care for a second
    solution, sigma_m = _solve_position(ranges, noise_m[rows], tow_s, navigation, channels, settings)
    used = np.isfinite(sigma_m)
    satellite, unit, distance_m = compute_line_of_sight(ranges.satellite_ecef_m, solution.state_m[:, :3])
    velocity = _solve_velocity(
        ranges,
        satellite,
        unit,
        distance_m,
        used,
        observations.doppler_hz[rows][:, columns],
        observations.doppler_sigma_hz[rows][:, columns],
        channels.carrier_hz,
    )
    design = np.where(used[..., None], design_matrix(unit, channels.clocks), 0.0)
    present = np.any(design[..., 3:] != 0.0, axis=1)
    reference = np.argmax(present, axis=1)  # scales stand in the order of preference
    gain = _select_reference(invert_normal(np.swapaxes(design, -1, -2) @ design), reference)
    gdop = np.sqrt(np.trace(gain, axis1=-2, axis2=-1))
    status = np.select(
        [
            used.sum(axis=1) < 3 + np.maximum(present.sum(axis=1), 1),
            ~(gdop <= settings.max_gdop),
            ~(solution.last_step_m < _CONVERGED_M),
        ],
        [float(FixStatus.TOO_FEW), float(FixStatus.WEAK_GEOMETRY), float(FixStatus.NOT_CONVERGED)],
        float(FixStatus.OK),
    )
    bad = status != FixStatus.OK
    clocks_m = np.where(present, solution.state_m[:, 3:], np.nan)
    clock_m = np.take_along_axis(clocks_m, reference[:, None], axis=1)
    state = np.concatenate((solution.state_m[:, :3], clock_m), axis=1)
    covariance = _select_reference(solution.covariance_m2, reference)
    for array in (state, clocks_m, velocity, covariance):
        array[bad] = np.nan
    kept = used & ~bad[:, None]
    residual = np.where(kept, solution.residual_m, np.nan)
    return state, clocks_m - clock_m, velocity, covariance, residual, status, design, np.where(kept, sigma_m, np.nan)


def _select_reference(matrix: Reals, reference: Indices) -> Reals:
    """Select the rows and columns of position and the reference clock: (n, 4, 4) of (n, 3 + c, 3 + c)."""
    if matrix.shape[-1] == 4:
        return matrix
    kept = np.concatenate((np.broadcast_to(np.arange(3), (len(matrix), 3)), 3 + reference[:, None]), axis=1)
    return matrix[np.arange(len(matrix))[:, None, None], kept[:, :, None], kept[:, None, :]]


def _solve_position(
    ranges: Ranges,
    thermal_m: Reals,
    tow_s: Reals,
    navigation: NavigationData,
    channels: _Channels,
    settings: _Settings,
) -> tuple[Solution, Reals]:
    """Solve without atmosphere, then twice with the atmosphere at the position so far; sigma is NaN if unused."""
    n = len(ranges.range_m)
    start = np.zeros((n, 3 + len(channels.scales)))
    start[:, :3] = settings.start_ecef_m
    solution = fit_position(
        ranges.satellite_ecef_m, ranges.range_m, thermal_m, start, clocks=channels.clocks, tolerance_m=10.0
    )
    used = np.isfinite(ranges.range_m) & np.isfinite(thermal_m)
    for last in (False, True):
        satellite, _, _ = compute_line_of_sight(ranges.satellite_ecef_m, solution.state_m[:, :3])
        delays = compute_atmosphere(
            solution.state_m[:, :3],
            satellite,
            tow_s,
            navigation.ionosphere,
            ionosphere_share=settings.ionosphere_share,
            carrier_hz=channels.carrier_hz,
        )
        if not last:
            used &= delays.elevation_rad >= settings.elevation_mask_rad
        sigma_m = np.sqrt(
            thermal_m**2
            + (settings.multipath_sigma_m / np.sin(delays.elevation_rad)) ** 2
            + delays.sigma_m**2
            + channels.space_m**2
        )
        sigma_m = np.where(used, sigma_m, np.nan)
        range_m = ranges.range_m - delays.delay_m
        solution = fit_position(
            ranges.satellite_ecef_m, range_m, sigma_m, solution.state_m, clocks=channels.clocks, max_steps=6
        )
    if settings.false_alarm_probability is None:
        return solution, sigma_m
    _, unit, _ = compute_line_of_sight(ranges.satellite_ecef_m, solution.state_m[:, :3])
    excluded, _ = exclude_several(
        design_matrix(unit, channels.clocks),
        np.where(used, solution.residual_m, np.nan),
        sigma_m,
        false_alarm_probability=settings.false_alarm_probability,
    )
    if not np.any(excluded):
        return solution, sigma_m
    sigma_m = np.where(excluded, np.nan, sigma_m)
    again = fit_position(
        ranges.satellite_ecef_m, range_m, sigma_m, solution.state_m, clocks=channels.clocks, max_steps=6
    )
    return again, sigma_m


def _solve_velocity(
    ranges: Ranges,
    satellite_ecef_m: Reals,
    unit: Reals,
    distance_m: Reals,
    used: Booleans,
    doppler_hz: Reals,
    doppler_sigma_hz: Reals,
    carrier_hz: Reals,
) -> Reals:
    """Solve for velocity and c times clock drift, (n, 4), m/s, from `compute_range_rates`."""
    rates = compute_range_rates(ranges, satellite_ecef_m, unit, distance_m, doppler_hz, doppler_sigma_hz, carrier_hz)
    usable = used & np.isfinite(rates.measured_m_s) & np.isfinite(rates.sigma_m_s)
    design = np.where(usable[..., None], np.concatenate((-unit, rates.drift_gain[..., None]), axis=-1), 0.0)
    weighted = np.swapaxes(design / np.where(usable, rates.sigma_m_s, 1.0)[..., None] ** 2, -1, -2)
    solved = invert_spd(weighted @ design) @ (weighted @ np.where(usable, rates.measured_m_s, 0.0)[..., None])
    return np.asarray(solved[..., 0])


@dataclass(frozen=True, eq=False, kw_only=True)
class RangeRates:
    """measured_m_s = -unit . velocity + drift_gain * c * drift, with noise of sigma_m_s; all (..., k)."""

    measured_m_s: Reals
    drift_gain: Reals
    sigma_m_s: Reals


def compute_range_rates(
    ranges: Ranges,
    satellite_ecef_m: Reals,
    unit: Reals,
    distance_m: Reals,
    doppler_hz: Reals,
    doppler_sigma_hz: Reals,
    carrier_hz: Reals,
) -> RangeRates:
    """Write Dopplers as linear equations for the receiver's velocity and clock drift.

    Take q = 1 + doppler/carrier, satellite drift s and receiver drift d. The received signal runs at q = (1 + s) (1 -
    r'/c) / (1 + d), and the range at r' = u.(v_s (1 - r'/c) - w x s r'/c - v). The satellite moves during the time of
    transmission, and the frame turns by the change of the travel time (millimetres a second both). Solved for r' this
    is linear in v and d.
    """
    c = SPEED_OF_LIGHT_M_S
    moving = rotate_to_reception(ranges.satellite_velocity_ecef_m_s, distance_m / c)
    turning = EARTH_ROTATION_RAD_S * (
        satellite_ecef_m[..., 0] * unit[..., 1] - satellite_ecef_m[..., 1] * unit[..., 0]
    )  # u.(w x s)
    along = np.sum(unit * moving, axis=-1)
    factor = 1.0 + (along + turning) / c
    pace = (1.0 + doppler_hz / carrier_hz) / (1.0 + ranges.satellite_drift)
    measured = factor * c * (1.0 - pace) - along  # = -u.v + factor pace c d
    return RangeRates(measured_m_s=measured, drift_gain=factor * pace, sigma_m_s=doppler_sigma_hz * c / carrier_hz)
