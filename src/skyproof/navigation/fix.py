"""Position, velocity and clock, epoch by epoch, from one set of signals; all epochs of a block at once."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skyproof.gnss.constants import EARTH_ROTATION_RAD_S, SPEED_OF_LIGHT_M_S
from skyproof.gnss.sky import rotate_to_reception
from skyproof.gnss.time import week_and_tow
from skyproof.navigation.least_squares import Solution, design_matrix, gauss_newton, line_of_sight, spd_inverse
from skyproof.navigation.ranges import Ranges, atmosphere, corrected_ranges
from skyproof.records import Fix, NavigationData, Observations, Reals, SignalId

__all__ = ["fix"]

_BLOCK_EPOCHS = 4096  # bounds the memory of a day at 1 Hz
_CONVERGED_M = 1e-2


@dataclass(frozen=True)
class _Settings:
    multipath_sigma_m: float
    ionosphere_share: float
    elevation_mask_rad: float
    start_ecef_m: Reals
    max_gdop: float


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
) -> Fix:
    """Weighted least squares for position and clock from pseudoranges, and for velocity and drift from Dopplers.

    The receiver's clock may be off by seconds. Klobuchar, Saastamoinen, group delay, relativity and Sagnac are taken
    off. One pseudorange has

        sigma^2 = thermal^2 + (multipath_sigma_m / sin el)^2 + (ionosphere_share * ionosphere)^2

    the law of the RTKLIB 2.4.2 manual, appendix E.6 (a^2 + b^2 / sin^2 el) with the measured thermal noise for a.

    Parameters
    ----------
    signals : those to use, by default all; at most one of a satellite at a time.
    multipath_sigma_m : multipath at the zenith, one sigma.
    ionosphere_share : what `ranges.atmosphere` leaves of the ionosphere.
    elevation_mask_deg : satellites lower than this are not used.
    start_ecef_m : (3,) where to start, by default the Earth's centre.
    max_gdop : geometry beyond this is status 2.

    Returns
    -------
    Fix, with status 1 for fewer than four satellites, 2 for weak geometry, 3 without convergence. Velocity and drift
    are NaN, too, where fewer than four of the satellites have a Doppler.

    Raises
    ------
    ValueError : a signal is not in the observations, or two signals of a satellite are to be used at once.
    """
    signals = observations.signals if signals is None else signals
    columns = _columns(observations, signals)
    settings = _Settings(
        multipath_sigma_m,
        ionosphere_share,
        np.radians(elevation_mask_deg),
        np.zeros(3) if start_ecef_m is None else np.asarray(start_ecef_m, np.float64),
        max_gdop,
    )
    n = observations.gpst.size
    blocks = [
        _fix_block(observations, navigation, signals, columns, slice(first, first + _BLOCK_EPOCHS), settings)
        for first in range(0, max(n, 1), _BLOCK_EPOCHS)
    ]
    state, velocity, covariance, residual, status = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
    bias_s = state[:, 3] / SPEED_OF_LIGHT_M_S
    bias_ns = np.rint(np.nan_to_num(bias_s) * 1e9).astype(np.int64)
    return Fix(
        receiver=observations.receiver,
        signals=signals,
        gpst=observations.gpst - bias_ns.astype("timedelta64[ns]"),
        position_ecef_m=state[:, :3],
        velocity_ecef_m_s=velocity[:, :3],
        clock_bias_s=bias_s,
        clock_drift=velocity[:, 3] / SPEED_OF_LIGHT_M_S,
        covariance_m2=covariance,
        residual_m=residual,
        status=status.astype(np.uint8),
    )


def _columns(observations: Observations, signals: tuple[SignalId, ...]) -> list[int]:
    where = {signal: column for column, signal in enumerate(observations.signals)}
    missing = [str(signal) for signal in signals if signal not in where]
    if missing:
        raise ValueError(f"{observations.receiver} has no signal {', '.join(missing)}")
    columns = [where[signal] for signal in signals]
    there = np.isfinite(observations.pseudorange_m[:, columns])
    for sat in {signal.sat for signal in signals}:
        at_once = there[:, [signal.sat == sat for signal in signals]].sum(axis=1)
        if np.any(at_once > 1):
            raise ValueError(f"several signals of {sat} at once in {observations.receiver}; say which with `signals`")
    return columns


def _fix_block(
    observations: Observations,
    navigation: NavigationData,
    signals: tuple[SignalId, ...],
    columns: list[int],
    rows: slice,
    settings: _Settings,
) -> tuple[Reals, Reals, Reals, Reals, Reals]:
    """State (n, 4), velocity and drift in m/s (n, 4), covariance (n, 4, 4), residuals (n, k), status (n,)."""
    gpst = observations.gpst[rows]
    ranges = corrected_ranges(signals, gpst, observations.pseudorange_m[rows][:, columns], navigation)
    thermal_m = observations.pseudorange_sigma_m[rows][:, columns]
    _, tow_s = week_and_tow(gpst)  # of the label: the ionosphere does not care for a second
    solution, used = _position(ranges, thermal_m, tow_s, navigation, settings)
    satellite, unit, distance_m = line_of_sight(ranges.satellite_ecef_m, solution.state_m[:, :3])
    velocity = _velocity(
        ranges,
        satellite,
        unit,
        distance_m,
        used,
        observations.doppler_hz[rows][:, columns],
        observations.doppler_sigma_hz[rows][:, columns],
        observations.carrier_hz,
    )
    design = np.where(used[..., None], design_matrix(unit), 0.0)
    gdop = np.sqrt(np.trace(spd_inverse(np.swapaxes(design, -1, -2) @ design), axis1=-2, axis2=-1))
    status = np.select(
        [used.sum(axis=1) < 4, ~(gdop <= settings.max_gdop), ~(solution.last_step_m < _CONVERGED_M)],
        [1.0, 2.0, 3.0],
        0.0,
    )
    bad = status > 0
    for array in (solution.state_m, velocity, solution.covariance_m2):
        array[bad] = np.nan
    residual = np.where(used & ~bad[:, None], solution.residual_m, np.nan)
    return solution.state_m, velocity, solution.covariance_m2, residual, status


def _position(
    ranges: Ranges, thermal_m: Reals, tow_s: Reals, navigation: NavigationData, settings: _Settings
) -> tuple[Solution, NDArray[np.bool_]]:
    """Rough position without atmosphere, then twice with the atmosphere of the position so far."""
    n = len(ranges.range_m)
    start = np.broadcast_to(np.append(settings.start_ecef_m, 0.0), (n, 4))
    solution = gauss_newton(ranges.satellite_ecef_m, ranges.range_m, thermal_m, start, tolerance_m=10.0)
    used = np.isfinite(ranges.range_m) & np.isfinite(thermal_m)
    for last in (False, True):
        satellite, _, _ = line_of_sight(ranges.satellite_ecef_m, solution.state_m[:, :3])
        delays = atmosphere(
            solution.state_m[:, :3], satellite, tow_s, navigation.ionosphere, ionosphere_share=settings.ionosphere_share
        )
        if not last:
            used &= delays.elevation_rad >= settings.elevation_mask_rad
        sigma_m = np.sqrt(
            thermal_m**2 + (settings.multipath_sigma_m / np.sin(delays.elevation_rad)) ** 2 + delays.sigma_m**2
        )
        solution = gauss_newton(
            ranges.satellite_ecef_m,
            ranges.range_m - delays.delay_m,
            np.where(used, sigma_m, np.nan),
            solution.state_m,
            max_steps=6,
        )
    return solution, used


def _velocity(
    ranges: Ranges,
    satellite_ecef_m: Reals,
    unit: Reals,
    distance_m: Reals,
    used: NDArray[np.bool_],
    doppler_hz: Reals,
    doppler_sigma_hz: Reals,
    carrier_hz: float,
) -> Reals:
    """Velocity and c times clock drift, (n, 4), m/s.

    With q = 1 + doppler/carrier, satellite drift s and receiver drift d, what is received runs at
    q = (1 + s) (1 - r'/c) / (1 + d), and the range at r' = u.(v_s (1 - r'/c) - w x s r'/c - v): the satellite moves
    during the time of transmission, and the frame turns by the change of the travel time (millimetres a second both).
    Solved for r' this is linear in v and d.
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
    sigma = doppler_sigma_hz * c / carrier_hz
    there = used & np.isfinite(measured) & np.isfinite(sigma)
    design = np.where(there[..., None], np.concatenate((-unit, (factor * pace)[..., None]), axis=-1), 0.0)
    weighted = np.swapaxes(design / np.where(there, sigma, 1.0)[..., None] ** 2, -1, -2)
    solved = spd_inverse(weighted @ design) @ (weighted @ np.where(there, measured, 0.0)[..., None])
    return np.asarray(solved[..., 0])
