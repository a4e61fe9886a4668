"""The navigation filter of a vector receiver: one position, velocity and clock that close the loops of all channels.

State, in metres and seconds: ECEF position and velocity, c times clock bias and drift (X. Zhang, H. Li, C. Yang and M.
Lu, IET Radar, Sonar & Navigation, 2020, doi 10.1049/iet-rsn.2020.0021, (3)). An epoch's ranges and Dopplers are the
replicas' with what the discriminators found beside them, white from epoch to epoch; the update is that of an extended
Kalman filter.

All signals that drive the filter do so alike, whether they fit or not: a vector receiver excludes none. Where they do
not fit one position, the noise of all is scaled up by their residuals. The prior then counts no more than they do: the
state is that of the epochs themselves, as (8) has it. Residuals, and a filter that has gone wrong, show in each epoch
alone. Its least squares have n - 4 residuals that do not depend on the state, and 4 unknowns that check the state.
"""

from dataclasses import dataclass, replace
from functools import cache
from typing import Final, NamedTuple

import numpy as np

from skyproof.arrays import Booleans, Reals
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.navigation.least_squares import compute_line_of_sight, design_matrix, invert_spd
from skyproof.navigation.vector_sky import SkyEpoch
from skyproof.statistics.distributions import chi_square_threshold
from skyproof.statistics.kalman import kalman_update

__all__ = [
    "CLOCK",
    "CORE",
    "DRIFT",
    "POSITION",
    "VELOCITY",
    "Expected",
    "VectorEpoch",
    "VectorSettings",
    "VectorState",
    "VectorUpdate",
    "dopplers_from_rates",
    "predict_measurements",
    "propagate_state",
    "rates_from_dopplers",
    "start_state",
    "update_state",
]

POSITION, VELOCITY, CLOCK, DRIFT = slice(0, 3), slice(3, 6), 6, 7
CORE = 8
_PLACE: Final = [0, 1, 2, CLOCK]
_RATES: Final = [3, 4, 5, DRIFT]


@dataclass(frozen=True)
class VectorSettings:
    """Settings of the filter; noises are densities of random walks.

    acceleration_m2_s3 : 3 m/s of change in a second.
    clock_m2_s, drift_m2_s3 : a quartz oscillator (h0 = 2e-19, h-2 = 2e-20; R. G. Brown and P. Y. C. Hwang,
        "Introduction to Random Signals and Applied Kalman Filtering", 4th ed., table 9.3).
    range_sigma_m, rate_sigma_m_s : of a range and a range rate, beside the thermal noise.
    misfit_probability : that noise alone is taken for signals that do not fit, an epoch.
    divergence_probability : that it is taken for a state gone wrong, an epoch.
    misses : epochs in a row in which that shows, before the filter has diverged.
    """

    acceleration_m2_s3: float = 10.0
    clock_m2_s: float = 0.009
    drift_m2_s3: float = 0.036
    range_sigma_m: float = 1.0
    rate_sigma_m_s: float = 0.05
    misfit_probability: float = 1e-4
    divergence_probability: float = 1e-9
    misses: int = 3


@dataclass(frozen=True, eq=False, kw_only=True)
class VectorState:
    """What is known after an epoch.

    elapsed_s : receiver time of the epoch. mean (8,), covariance (8, 8). misses : epochs in a row that contradict it.
    """

    elapsed_s: float
    mean: Reals
    covariance: Reals
    misses: int = 0


class VectorEpoch(NamedTuple):
    """What was measured, (k,) each, NaN where nothing was: a range is a pseudorange with the satellite's clock and the
    delays on the way taken off, a rate its change as the carrier shows it."""

    range_m: Reals
    range_sigma_m: Reals
    rate_m_s: Reals
    rate_sigma_m_s: Reals


class Expected(NamedTuple):
    """What a state predicts: ranges and rates (k,) in the terms of `VectorEpoch`, rows of the geometry (k, 4)."""

    range_m: Reals
    rate_m_s: Reals
    design: Reals


class VectorUpdate(NamedTuple):
    """An update.

    state : after it. diverged : whether the measurements have contradicted the state for so long that it is wrong.
    range_m, rate_m_s : (k,) what the updated state predicts of all satellites, in the terms of `VectorEpoch`.
    design : (k, 4) rows of the geometry.
    range_left_m, rate_left_m_s : (k,) measured less fitted, of the epoch's own least squares; NaN of satellites not in
        them.
    """

    state: VectorState
    diverged: bool
    range_m: Reals
    rate_m_s: Reals
    design: Reals
    range_left_m: Reals
    rate_left_m_s: Reals


def propagate_state(
    state: VectorState,
    elapsed_s: float,
    settings: VectorSettings,
    change: Reals | None = None,
    *,
    walk2: float = np.inf,
) -> VectorState:
    """Propagate the state to a later time: F x + u, F P F' + Q.

    change : (6,) of position beside that of an even motion, and of velocity, where an inertial unit shows them; what
        these leave open is a random walk of density `walk2`, m^2/s^3, in place of the settings', if it is smaller.
    """
    dt_s = elapsed_s - state.elapsed_s
    step = np.eye(CORE)
    step[POSITION, VELOCITY] = dt_s * np.eye(3)
    step[CLOCK, DRIFT] = dt_s
    covariance = step @ state.covariance @ step.T
    walk = np.array([[dt_s**3 / 3.0, dt_s**2 / 2.0], [dt_s**2 / 2.0, dt_s]])
    for axis in range(3):
        covariance[np.ix_([axis, axis + 3], [axis, axis + 3])] += min(settings.acceleration_m2_s3, walk2) * walk
    covariance[np.ix_([CLOCK, DRIFT], [CLOCK, DRIFT])] += settings.drift_m2_s3 * walk
    covariance[CLOCK, CLOCK] += settings.clock_m2_s * dt_s
    mean = step @ state.mean
    if change is not None:
        mean[:6] += change
    return replace(state, elapsed_s=elapsed_s, mean=mean, covariance=covariance)


def predict_measurements(mean: Reals, sky: SkyEpoch) -> Expected:
    """Predict the measurements of a state (8,)."""
    _, unit, distance_m = compute_line_of_sight(sky.satellite_ecef_m, mean[POSITION])
    range_m = distance_m + mean[CLOCK]
    rate_m_s = -unit @ mean[VELOCITY] + sky.drift_gain * mean[DRIFT]
    return Expected(range_m, rate_m_s, design_matrix(unit))


def start_state(epoch: VectorEpoch, sky: SkyEpoch, place_ecef_m: Reals, elapsed_s: float) -> VectorState | None:
    """Start a filter from one epoch's least squares, linear about a place near by (3,).

    None where fewer than five satellites give a range and a rate.
    """
    used = np.isfinite(epoch.range_m) & np.isfinite(epoch.rate_m_s)
    if used.sum() < 5:
        return None
    mean = np.zeros(CORE)
    mean[POSITION] = place_ecef_m
    covariance = np.zeros((CORE, CORE))
    for _ in range(2):
        range_m, rate_m_s, design = predict_measurements(mean, sky)
        for places, misfit, sigma in (
            (_PLACE, epoch.range_m - range_m, epoch.range_sigma_m),
            (_RATES, epoch.rate_m_s - rate_m_s, epoch.rate_sigma_m_s),
        ):
            fit = _fit(design[used], misfit[used], sigma[used])
            mean[places] += fit.step
            covariance[np.ix_(places, places)] = fit.covariance * max(fit.left / max(used.sum() - 4, 1), 1.0)
    return VectorState(elapsed_s=elapsed_s, mean=mean, covariance=covariance)


def update_state(
    state: VectorState, epoch: VectorEpoch, predicted: Expected, drives: Booleans, settings: VectorSettings
) -> VectorUpdate:
    """Update a state, already at the epoch's time, by the epoch's measurements.

    predicted : by the state. drives : (k,) satellites whose measurements are used.
    """
    range_m, rate_m_s, design = predicted
    ranges = drives & np.isfinite(epoch.range_m)
    rates = drives & np.isfinite(epoch.rate_m_s)
    by_range = _test_epoch(design, epoch.range_m - range_m, epoch.range_sigma_m, ranges, state, _PLACE, settings)
    by_rate = _test_epoch(design, epoch.rate_m_s - rate_m_s, epoch.rate_sigma_m_s, rates, state, _RATES, settings)
    rows = np.zeros((ranges.sum() + rates.sum(), CORE))
    rows[: ranges.sum(), _PLACE] = design[ranges]
    rows[ranges.sum() :, _RATES] = design[rates]
    misfit = np.concatenate(((epoch.range_m - range_m)[ranges], (epoch.rate_m_s - rate_m_s)[rates]))
    variance = np.concatenate((epoch.range_sigma_m[ranges], epoch.rate_sigma_m_s[rates])) ** 2
    factor = np.repeat([by_range.factor, by_rate.factor], [ranges.sum(), rates.sum()])
    assumed = state.covariance.copy()
    for places, judged in ((_PLACE, by_range), (_RATES, by_rate)):
        if judged.factor > 1.0:
            assumed[np.ix_(places, places)] += judged.factor * judged.covariance
    mean, covariance = state.mean, state.covariance
    if misfit.size:
        # The covariance is of what comes at random: a misfit that stays is no noise.
        update = kalman_update(
            covariance,
            rows,
            np.diag(variance),
            misfit,
            assumed_covariance=assumed,
            assumed_noise=np.diag(factor * variance),
        )
        mean, covariance = mean + update.change, update.covariance
    misses = state.misses + 1 if by_range.contradicts or by_rate.contradicts else 0
    after = replace(state, mean=mean, covariance=covariance, misses=misses)
    moved = mean - state.mean  # by 100 m: straight to a millimetre
    return VectorUpdate(
        after,
        misses >= settings.misses,
        range_m + design @ moved[_PLACE],
        rate_m_s + design @ moved[_RATES],
        design,
        by_range.left,
        by_rate.left,
    )


def rates_from_dopplers(sky: SkyEpoch, doppler_hz: Reals, carrier_hz: float) -> Reals:
    """Convert Dopplers to rates (k,) in the terms of `VectorEpoch`."""
    pace = (1.0 + doppler_hz / carrier_hz) / (1.0 + sky.satellite_drift)
    return np.asarray(sky.moving * (1.0 - pace) * SPEED_OF_LIGHT_M_S - sky.along_m_s, float)


def dopplers_from_rates(sky: SkyEpoch, rate_m_s: Reals, carrier_hz: float) -> Reals:
    """Convert rates to Dopplers (k,): the inverse of `rates_from_dopplers`."""
    pace = 1.0 - (rate_m_s + sky.along_m_s) / (sky.moving * SPEED_OF_LIGHT_M_S)
    return np.asarray(carrier_hz * (pace * (1.0 + sky.satellite_drift) - 1.0), float)


class _Fit(NamedTuple):
    step: Reals
    covariance: Reals
    residual: Reals
    left: float


def _fit(design: Reals, misfit: Reals, sigma: Reals) -> _Fit:
    """Solve least squares of four unknowns; `left`, the residual sum, is chi-square with n - 4 degrees."""
    weighted = design / sigma[:, None] ** 2
    covariance = invert_spd(weighted.T @ design)
    step = covariance @ (weighted.T @ misfit)
    residual = misfit - design @ step
    return _Fit(step, covariance, residual, float(np.sum((residual / sigma) ** 2)))


@cache
def _limit(probability: float, dof: int) -> float:
    return float(chi_square_threshold(probability, dof))


class _Judged(NamedTuple):
    factor: float
    contradicts: bool
    left: Reals
    covariance: Reals


def _test_epoch(
    design: Reals,
    misfit: Reals,
    sigma: Reals,
    used: Booleans,
    state: VectorState,
    places: list[int],
    settings: VectorSettings,
) -> _Judged:
    """Compute by how much an epoch's variances have to grow, and whether it contradicts the state."""
    residual, n = np.full(used.size, np.nan), int(used.sum())
    if n < 4:
        return _Judged(1.0, False, residual, np.zeros((4, 4)))
    fit = _fit(design[used], misfit[used], sigma[used])
    if not np.all(np.isfinite(fit.covariance)):
        return _Judged(1.0, False, residual, np.zeros((4, 4)))
    residual[used] = fit.residual
    factor = 1.0
    if n > 4 and fit.left > _limit(settings.misfit_probability, n - 4):
        factor = fit.left / (n - 4)
    total = state.covariance[np.ix_(places, places)] + factor * fit.covariance
    off = float(fit.step @ np.linalg.solve(total, fit.step))
    return _Judged(factor, off > _limit(settings.divergence_probability, 4), residual, fit.covariance)
