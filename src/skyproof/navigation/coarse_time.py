"""Fix a position from code phases alone: tens of milliseconds, with orbits and a rough time from elsewhere.

So short a recording shows where in its period each code stands, and its Doppler, but not which period: the range is
known up to whole milliseconds (300 km), and the time of transmission only as well as the rough time. Both come out of
one weighted fit. After F. van Diggelen, A-GPS (2009), chapter 4 (five states: position, common bias, coarse time;
whole milliseconds counted from a reference satellite), and B. Peterson, R. Hartnett, G. Ottman, "GPS receiver
structures for the urban canyon", ION GPS 1995. The rough place, where none is given, is that of the Dopplers.

The whole numbers are never taken for granted. From one satellite on, each further one joins with every whole number
that is allowed so far, by place, time, Dopplers and the codes joined. Every set is solved and tested by all its
residuals. Reported is the one set that remains; or that none fits; or that several do.

State, along the last axis: ECEF position (m), common bias (m), true minus rough time (s), clock drift (m/s), ECEF
velocity (m/s). What is known beforehand enters as measurements of it. Leading axes are candidates.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from skyproof.arrays import Indices, Reals
from skyproof.gnss.constants import MU_M3_S2, SPEED_OF_LIGHT_M_S
from skyproof.gnss.frames import EARTH_RAD_S, ecef_from_geodetic, geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.orbits import compute_satellite_state_s
from skyproof.gnss.signals import SignalPlan
from skyproof.gnss.sky import compute_azimuth_elevation, rotate_to_reception
from skyproof.gnss.time import timedelta_from_s, week_and_tow
from skyproof.navigation.least_squares import compute_line_of_sight, invert_spd
from skyproof.navigation.ranges import compute_atmosphere
from skyproof.records import Ephemeris, NavigationData, Selectable, freeze
from skyproof.statistics.distributions import chi_square_survival, chi_square_threshold

__all__ = ["COARSE_STATUS", "CoarseFix", "CoarseSettings", "solve_coarse_fix"]

COARSE_STATUS: Final[Mapping[int, str]] = {
    0: "ok",
    1: "fewer than five satellites with an ephemeris",
    2: "geometry too weak",
    3: "did not converge",
    4: "no whole milliseconds fit: a measurement, the rough time or the rough place is off by more than stated",
    5: "several sets of whole milliseconds fit: a closer time or place, or more satellites, would decide",
}
"""Why a `CoarseFix` has no result; 0 to 3 are those of `FIX_STATUS`. The numbers are NaN unless 0."""

_POSITION, _BIAS, _TIME, _DRIFT, _VELOCITY, _STATES = slice(0, 3), 3, 4, 5, slice(6, 9), 9
_ATMOSPHERE_RATE_M_S: Final = 0.02  # of ionosphere and troposphere together at 5 to 10 degrees, where both change most
_ANY_BIAS_M, _ANY_DRIFT_M_S = 1e9, 1e6  # wide enough to say nothing, and to cost nothing
_GRID_POINTS: Final = 600  # 9 degrees apart: a Doppler fit that starts no further off finds its minimum
_LARGEST_STEP_M: Final = 1.5e6
_PRUNE: Final = 1e-9  # a set that is less likely than this so far is not followed further
_REACH_SIGMA: Final = 6.0
_MAX_CANDIDATES: Final = 2000
_CONVERGED_M: Final = 0.1
_MAX_STEPS: Final = 40


@dataclass(frozen=True, kw_only=True)
class CoarseSettings:
    """What is assumed, and how sure the answer has to be.

    velocity_sigma_m_s : of each component of the receiver's velocity; 10 covers ships, most drones and road traffic.
    height_m, height_sigma_m : above the ellipsoid, where no place is given; the default reaches from the sea's bottom
        to airliners.
    multipath_sigma_m, ionosphere_share : as in `fix`.
    false_alarm_probability : that the right set is called unfit though all sigmas are as stated.
    wrong_probability : above this chance that another set is the right one, nothing is reported.
    max_sigma_m : of the position (root of the trace) beyond which geometry counts as too weak.
    """

    velocity_sigma_m_s: float = 10.0
    height_m: float = 0.0
    height_sigma_m: float = 6000.0
    multipath_sigma_m: float = 0.5
    ionosphere_share: float = 0.25
    false_alarm_probability: float = 1e-4
    wrong_probability: float = 1e-5
    max_sigma_m: float = 1000.0


@dataclass(frozen=True, eq=False, kw_only=True)
class CoarseFix:
    """One position, with the time that it took.

    gpst : true time of reception as found, good to `time_sigma_s` (some 10 ms).
    time_error_s : true time minus the rough time given.
    phase_s : true time modulo the shortest code period, good to tens of nanoseconds.
    covariance : (5, 5) of ECEF position (m), c times phase (m), and time (s).
    residual_m : (n_sats,) measured minus modelled code, NaN where not used.
    statistic, dof, p_value : of all residuals (codes, Dopplers, rough place and time), chi-square if the set is right.
    wrong_probability : the chance that another set of whole milliseconds is right, given that the sigmas are.
    candidates : sets that were solved with all satellites.
    """

    sats: tuple[str, ...]
    status: int
    gpst: np.datetime64
    position_ecef_m: Reals
    velocity_ecef_m_s: Reals
    time_error_s: float
    time_sigma_s: float
    phase_s: float
    clock_drift: float
    covariance: Reals
    residual_m: Reals
    statistic: float
    dof: int
    p_value: float
    wrong_probability: float
    candidates: int

    def __post_init__(self) -> None:
        freeze(
            self,
            {"position_ecef_m": ("3",), "velocity_ecef_m_s": ("3",), "covariance": ("5", "5"), "residual_m": ("sat",)},
        )

    @property
    def because(self) -> str:
        """Return the status in words."""
        return COARSE_STATUS[self.status]


@dataclass(frozen=True, eq=False, kw_only=True)
class _Problem:
    """Everything measured and assumed; arrays (k,) over the satellites in use."""

    ephemerides: tuple[Ephemeris, ...]
    navigation: NavigationData
    week: int
    tow_s: float
    code_m: Reals  # range, modulo wrap_m
    code_sigma_m: Reals
    wrap_m: Reals
    rate_m_s: Reals  # apparent range rate; NaN where no Doppler
    rate_sigma_m_s: Reals
    time_sigma_s: float
    place_ecef_m: Reals | None
    place_sigma_m: float
    settings: CoarseSettings

    @property
    def n_rates(self) -> int:
        return int(np.isfinite(self.rate_m_s).sum())

    def dof(self, n_codes: int) -> int:
        """Count measurements less unknowns. The bias counts once a code is used, the drift once a Doppler is."""
        known = n_codes + self.n_rates + 4 + (1 if self.place_ecef_m is None else 3)
        return known - 7 - (n_codes > 0) - (self.n_rates > 0)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Sky:
    """What a state predicts: all (..., k), designs (..., k, 9)."""

    range_m: Reals
    range_sigma_m: Reals
    range_design: Reals
    rate_m_s: Reals
    rate_design: Reals
    elevation_rad: Reals


@dataclass(frozen=True, eq=False, kw_only=True)
class _Solved(Selectable):
    """state (n, 9), covariance (n, 9, 9), cost (n,), step_m (n,), and the codes (n, k) that were fitted, else NaN."""

    state: Reals
    covariance: Reals
    cost: Reals
    step_m: Reals
    target_m: Reals


def solve_coarse_fix(
    sats: tuple[str, ...],
    code_s: Reals,
    code_sigma_s: Reals,
    doppler_hz: Reals,
    doppler_sigma_hz: Reals,
    rough_gpst: np.datetime64,
    rough_sigma_s: float,
    navigation: NavigationData,
    *,
    place_ecef_m: Reals | None = None,
    place_sigma_m: float = 100e3,
    signal: SignalPlan,
    period_s: Reals | float | None = None,
    settings: CoarseSettings | None = None,
) -> CoarseFix:
    """Estimate position, velocity and time from one instant's code phases and Dopplers.

    Parameters
    ----------
    sats : one a measurement; those without a healthy ephemeris (at most 7500 s away) are not used.
    code_s, code_sigma_s : (n_sats,) time that the received code shows, modulo `period_s`; NaN: not used.
    doppler_hz, doppler_sigma_hz : (n_sats,) apparent minus nominal carrier; contains the clock drift. May be NaN.
    rough_gpst, rough_sigma_s : the instant of reception, and one sigma of its error.
    place_ecef_m, place_sigma_m : (3,) rough place and one sigma of each coordinate; without one the Dopplers give it.
    signal : that was received. period_s : of the code phases, for all or each: that of the code, or of the bits where
        their edges are known; the former if not given.

    Returns
    -------
    CoarseFix, with status, see COARSE_STATUS.

    Raises
    ------
    ValueError : arrays and `sats` disagree in length, a satellite comes twice, or a sigma of time or place is not
        positive.
    """
    settings = settings or CoarseSettings()
    columns = [
        np.broadcast_to(np.asarray(a, np.float64), (len(sats),))
        for a in (code_s, code_sigma_s, doppler_hz, doppler_sigma_hz, signal.period_s if period_s is None else period_s)
    ]
    if len(set(sats)) != len(sats):
        raise ValueError(f"a satellite appears twice in {', '.join(sats)}; give one signal of each")
    if not (rough_sigma_s > 0.0 and place_sigma_m > 0.0):
        raise ValueError(f"rough_sigma_s {rough_sigma_s:g} and place_sigma_m {place_sigma_m:g} must be positive")
    found = [navigation.best(sat, rough_gpst) for sat in sats]
    healthy = np.array([isinstance(e, Ephemeris) and e.health == 0 for e in found], np.bool_)
    used = np.flatnonzero(healthy & np.isfinite(columns[0]) & (columns[1] > 0.0))
    code, code_sigma, doppler, doppler_sigma, period = (column[used] for column in columns)
    week, tow_s = week_and_tow(rough_gpst)
    with_rate = np.isfinite(doppler) & (doppler_sigma > 0.0)
    wavelength_m = SPEED_OF_LIGHT_M_S / signal.carrier_hz
    problem = _Problem(
        ephemerides=tuple(e for k in used if isinstance(e := found[k], Ephemeris)),
        navigation=navigation,
        week=week,
        tow_s=tow_s,
        code_m=-SPEED_OF_LIGHT_M_S * code,
        code_sigma_m=SPEED_OF_LIGHT_M_S * code_sigma,
        wrap_m=SPEED_OF_LIGHT_M_S * period,
        rate_m_s=np.where(with_rate, -wavelength_m * doppler, np.nan),
        rate_sigma_m_s=np.hypot(wavelength_m * np.where(with_rate, doppler_sigma, 1.0), _ATMOSPHERE_RATE_M_S),
        time_sigma_s=rough_sigma_s,
        place_ecef_m=None if place_ecef_m is None else np.asarray(place_ecef_m, np.float64),
        place_sigma_m=place_sigma_m,
        settings=settings,
    )
    if used.size < 5 or (place_ecef_m is None and problem.n_rates < 4):
        return _report_no_answer(sats, rough_gpst, 1)
    starts = _find_starts(problem)
    if starts.cost.size == 0:
        return _report_no_answer(sats, rough_gpst, 4)
    solved = _solve_whole_numbers(problem, starts)
    if solved is None:
        return _report_no_answer(sats, rough_gpst, 5)
    return _check_answer(problem, solved, sats, used, rough_gpst)


def _predict_sky(problem: _Problem, state: Reals) -> _Sky:
    """Predict ranges, rates and their derivatives (rates in the inertial frame that is ECEF at reception)."""
    position, bias, late_s = state[..., _POSITION], state[..., _BIAS], state[..., _TIME]
    travel_s = np.full((*late_s.shape, len(problem.ephemerides)), 0.075)
    for _ in range(2):  # 75 ms is right to 10 ms or 8 m of range; once more, to 20 ns
        orbits = [
            compute_satellite_state_s(e, problem.week, problem.tow_s + late_s - travel_s[..., k])
            for k, e in enumerate(problem.ephemerides)
        ]
        sent_m = np.stack([o.position_ecef_m for o in orbits], axis=-2)
        satellite, unit, distance = compute_line_of_sight(sent_m, position)
        travel_s = distance / SPEED_OF_LIGHT_M_S
    sent_m_s = np.stack([o.velocity_ecef_m_s for o in orbits], axis=-2) + np.cross(EARTH_RAD_S, sent_m)
    satellite_m_s = rotate_to_reception(sent_m_s, travel_s)
    earth_m_s = np.cross(EARTH_RAD_S, position)[..., None, :]
    towards = 1.0 + np.sum(unit * satellite_m_s, axis=-1) / SPEED_OF_LIGHT_M_S  # light takes time to bring the news
    still_m_s = np.sum(unit * (satellite_m_s - earth_m_s), axis=-1) / towards
    velocity = state[..., None, _VELOCITY]
    rate = still_m_s - np.sum(unit * velocity, axis=-1) / towards
    clock_m = SPEED_OF_LIGHT_M_S * np.stack(
        [o.clock_s - e.tgd for o, e in zip(orbits, problem.ephemerides, strict=True)], axis=-1
    )
    clock_m_s = SPEED_OF_LIGHT_M_S * np.stack([o.clock_drift for o in orbits], axis=-1)
    drift = state[..., _DRIFT][..., None]

    settings = problem.settings
    air = compute_atmosphere(
        position,
        satellite,
        np.asarray(problem.tow_s),
        problem.navigation.ionosphere,
        ionosphere_share=settings.ionosphere_share,
    )
    low = np.sin(np.maximum(air.elevation_rad, np.radians(5.0)))
    sigma_m = np.sqrt(problem.code_sigma_m**2 + (settings.multipath_sigma_m / low) ** 2 + air.sigma_m**2)

    range_design = np.zeros((*distance.shape, _STATES))
    range_design[..., _POSITION] = -unit
    range_design[..., _BIAS] = 1.0
    range_design[..., _TIME] = still_m_s - clock_m_s
    across = satellite_m_s - earth_m_s - velocity
    across = across - unit * np.sum(unit * across, axis=-1, keepdims=True)
    fall = -MU_M3_S2 * satellite / np.sum(satellite**2, axis=-1, keepdims=True) ** 1.5
    turn = np.cross(EARTH_RAD_S, earth_m_s)
    rate_design = np.zeros_like(range_design)
    rate_design[..., _POSITION] = -across / distance[..., None] - np.cross(unit, EARTH_RAD_S)
    rate_design[..., _TIME] = np.sum(across**2, axis=-1) / distance + np.sum(unit * (fall - turn), axis=-1)
    rate_design[..., _DRIFT] = 1.0
    rate_design[..., _VELOCITY] = -unit
    return _Sky(
        range_m=distance - clock_m + air.delay_m + bias[..., None],
        range_sigma_m=sigma_m,
        range_design=range_design,
        rate_m_s=(rate - clock_m_s) * (1.0 - drift / SPEED_OF_LIGHT_M_S) + drift,
        rate_design=rate_design,
        elevation_rad=air.elevation_rad,
    )


def _linearize_prior(problem: _Problem, state: Reals) -> tuple[Reals, Reals]:
    """Linearize the prior: normalised misfits (..., r) with designs (..., r, 9)."""
    settings = problem.settings
    wanted, sigma = np.zeros(_STATES), np.full(_STATES, np.inf)
    sigma[_TIME], sigma[_BIAS], sigma[_DRIFT] = problem.time_sigma_s, _ANY_BIAS_M, _ANY_DRIFT_M_S
    sigma[_VELOCITY] = max(settings.velocity_sigma_m_s, 1e-4)
    if problem.place_ecef_m is not None:
        wanted[_POSITION], sigma[_POSITION] = problem.place_ecef_m, problem.place_sigma_m
    misfit = (wanted - state) / sigma
    design = np.broadcast_to(np.diag(1.0 / sigma), (*misfit.shape, _STATES))
    if problem.place_ecef_m is not None:
        return misfit, design
    lat_rad, lon_rad, height_m = geodetic_from_ecef(state[..., _POSITION])
    high = (settings.height_m - height_m) / settings.height_sigma_m
    up = np.zeros((*high.shape, 1, _STATES))
    up[..., 0, _POSITION] = rot_enu_ecef(lat_rad, lon_rad)[..., 2, :] / settings.height_sigma_m
    return np.concatenate((misfit, high[..., None]), axis=-1), np.concatenate((design, up), axis=-2)


def _stack_system(problem: _Problem, state: Reals, target_m: Reals) -> tuple[Reals, Reals]:
    """Stack normalised misfits (n, r) and designs (n, r, 9). Codes that are NaN in the target do not count."""
    sky = _predict_sky(problem, state)
    known, known_design = _linearize_prior(problem, state)
    codes, rates = np.isfinite(target_m), np.isfinite(problem.rate_m_s)
    code_weight = np.where(codes, 1.0 / sky.range_sigma_m, 0.0)
    rate_weight = np.where(rates, 1.0 / problem.rate_sigma_m_s, 0.0)
    code = np.where(codes, target_m - sky.range_m, 0.0) * code_weight
    rate = np.where(rates, problem.rate_m_s - sky.rate_m_s, 0.0) * rate_weight
    misfit = np.concatenate((code, rate, known), axis=-1)
    design = np.concatenate(
        (sky.range_design * code_weight[..., None], sky.rate_design * rate_weight[..., None], known_design), axis=-2
    )
    return misfit, design


def _solve(problem: _Problem, state: Reals, target_m: Reals) -> _Solved:
    """Solve for each state (n, 9) by damped Gauss-Newton (Levenberg), from codes `target_m` (n, k).

    Damping is not for far starts only. Four codes and a rough place can leave a valley of 100 km, along which a range
    bends by many of its sigmas. There undamped steps oscillate across it for ever.
    """
    state = state.copy()
    n = len(state)
    misfit, design = _stack_system(problem, state, target_m)
    damping, step_m = np.full(n, 1e-6), np.full(n, np.inf)
    diagonal = np.eye(_STATES)
    for _ in range(_MAX_STEPS):
        active = np.flatnonzero((step_m > _CONVERGED_M) | (damping > 1e-2))
        if not active.size:
            break
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            transposed = np.swapaxes(design[active], -1, -2)
            normal = transposed @ design[active]
            gradient = (transposed @ misfit[active][..., None])[..., 0]
            damped = normal * (1.0 + diagonal * damping[active, None, None])
            step = (invert_spd(damped) @ gradient[..., None])[..., 0]
            length_m = np.linalg.norm(step[:, _POSITION], axis=-1)
            step *= np.minimum(1.0, _LARGEST_STEP_M / np.maximum(length_m, 1.0))[:, None]
            trial = state[active] + step
            trial_misfit, trial_design = _stack_system(problem, trial, target_m[active])
            fall = np.sum(misfit[active] ** 2, axis=-1) - np.sum(trial_misfit**2, axis=-1)
            promised = np.sum(step * (2.0 * gradient - (normal @ step[..., None])[..., 0]), axis=-1)
            # Where nothing is left to gain, rounding decides the sign: that is convergence, not failure.
            good = (fall > 0.25 * promised) | (np.abs(promised) < 1e-6)
            taken = (fall > 0.0) | good
        at = active[taken]
        state[at], misfit[at], design[at] = trial[taken], trial_misfit[taken], trial_design[taken]
        damping[active] = np.where(good, np.maximum(damping[active] * 0.1, 1e-6), damping[active] * 10.0)
        step_m[active] = length_m
        damping[active[~np.isfinite(length_m)]] = 0.0  # cannot be solved: not tried again
        step_m[active[~np.isfinite(length_m)]] = 0.0
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        covariance = invert_spd(np.swapaxes(design, -1, -2) @ design)
        cost = np.sum(misfit**2, axis=-1)
    lost = ~np.isfinite(cost) | ~np.isfinite(covariance[..., 0, 0])
    return _Solved(
        state=state, covariance=covariance, cost=np.where(lost, np.inf, cost), step_m=step_m, target_m=target_m
    )


def _find_starts(problem: _Problem) -> _Solved:
    """Find places that the Dopplers and the prior allow.

    Without a prior place the search covers the Earth below the satellites.
    """
    k = len(problem.ephemerides)
    if problem.place_ecef_m is not None:
        places = problem.place_ecef_m[None]
    else:
        places = _list_places(problem)
    state = np.zeros((len(places), _STATES))
    state[:, _POSITION] = places
    rates = problem.rate_m_s - _predict_sky(problem, state).rate_m_s
    if problem.n_rates:
        state[:, _DRIFT] = np.nanmedian(rates, axis=-1)
    solved = _solve(problem, state, np.full((len(places), k), np.nan))
    likely = solved.cost <= chi_square_threshold(_PRUNE, max(problem.dof(0), 1))
    return _keep_distinct(solved.select(likely & (solved.step_m < 1e3)), 1e3)


def _list_places(problem: _Problem) -> Reals:
    """List grid points on the Earth where all satellites stand above the horizon, else the best ones."""
    n = np.arange(_GRID_POINTS)
    lat_rad = np.arcsin((2.0 * n + 1.0) / _GRID_POINTS - 1.0)
    lon_rad = np.mod(n * np.pi * (3.0 - np.sqrt(5.0)), 2.0 * np.pi) - np.pi
    places = ecef_from_geodetic(lat_rad, lon_rad, np.full(n.size, problem.settings.height_m))
    sent_m = np.stack(
        [compute_satellite_state_s(e, problem.week, problem.tow_s).position_ecef_m for e in problem.ephemerides]
    )
    _, el_rad = compute_azimuth_elevation(places[:, None, :], sent_m)
    lowest = el_rad.min(axis=1)
    return np.asarray(places[lowest > min(np.radians(-5.0), lowest.max() - np.radians(5.0))])


def _keep_distinct(solved: _Solved, apart_m: float) -> _Solved:
    """Keep the cheapest solution of each place, cheapest first."""
    order = np.argsort(solved.cost, kind="stable")
    kept: list[int] = []
    for k in order:
        away = np.linalg.norm(solved.state[kept][:, _POSITION] - solved.state[k, _POSITION], axis=-1)
        if not np.any(away < apart_m):
            kept.append(int(k))
    return solved.select(np.array(kept, dtype=np.intp))


def _solve_whole_numbers(problem: _Problem, solved: _Solved) -> _Solved | None:
    """Solve all sets of whole numbers that fit, cheapest first; None if there are too many to follow."""
    reference = int(np.argmin(problem.code_sigma_m - problem.wrap_m))  # of the longest period, the surest
    sky = _predict_sky(problem, solved.state)
    target = np.full_like(solved.target_m, np.nan)
    target[:, reference] = problem.code_m[reference]
    state = solved.state.copy()
    state[:, _BIAS] += target[:, reference] - sky.range_m[:, reference]
    solved = _solve(problem, state, target)
    while np.any(open_columns := ~np.isfinite(solved.target_m[0])):
        sky = _predict_sky(problem, solved.state)
        spread = np.einsum("nki,nij,nkj->nk", sky.range_design, solved.covariance, sky.range_design)
        sigma = np.sqrt(spread + sky.range_sigma_m**2)
        reach = (_REACH_SIGMA * sigma + _bound_bend_m(problem, solved)[:, None]) / problem.wrap_m
        widest = np.where(open_columns, reach.max(axis=0), np.inf)
        joined = np.flatnonzero(widest < 0.2)
        turns = (sky.range_m - problem.code_m) / problem.wrap_m
        if joined.size:  # all those that leave no choice at once
            target, state = solved.target_m.copy(), solved.state
            target[:, joined] = (problem.code_m + np.rint(turns) * problem.wrap_m)[:, joined]
        else:
            k = int(np.argmin(widest))
            first = np.ceil(turns[:, k] - reach[:, k]).astype(np.int64)
            count = np.maximum(np.floor(turns[:, k] + reach[:, k]).astype(np.int64) - first + 1, 0)
            if count.sum() > _MAX_CANDIDATES:
                return None
            parent = np.repeat(np.arange(count.size), count)
            number = first[parent] + np.arange(parent.size) - np.repeat(np.cumsum(count) - count, count)
            target, state = solved.target_m[parent].copy(), solved.state[parent]
            target[:, k] = problem.code_m[k] + number * problem.wrap_m[k]
        if not len(target):
            break
        solved = _solve(problem, state, target)
        limit = chi_square_threshold(_PRUNE, max(problem.dof(int(np.isfinite(target[0]).sum())), 1))
        solved = solved.select(solved.cost <= limit)
        if not solved.cost.size:
            break
    return _keep_distinct(solved, 100.0)


def _bound_bend_m(problem: _Problem, solved: _Solved) -> Reals:
    """Bound the error (n,) of the linear prediction of a range: its curvature over place and over time.

    A range of 20 000 km bends by d^2 / 2 r over a distance d, and over time by at most 0.2 m/s^2.
    """
    variance = np.diagonal(solved.covariance, axis1=-2, axis2=-1)
    place_m2 = np.sum(variance[:, _POSITION], axis=-1)
    return np.asarray(_REACH_SIGMA**2 * (place_m2 / 4e7 + 0.1 * variance[:, _TIME]))


def _check_answer(
    problem: _Problem, solved: _Solved, sats: tuple[str, ...], used: Indices, rough_gpst: np.datetime64
) -> CoarseFix:
    dof = problem.dof(used.size)
    if not solved.cost.size:
        return _report_no_answer(sats, rough_gpst, 4)
    cost = solved.cost
    share = np.exp(-0.5 * (cost - cost[0]))
    wrong = float(share[1:].sum() / share.sum())
    state, covariance = solved.state[0], solved.covariance[0]
    settings = problem.settings
    unfit = cost[0] > chi_square_threshold(settings.false_alarm_probability, dof)
    if unfit:
        status = 4
    elif wrong > settings.wrong_probability:
        status = 5
    elif not solved.step_m[0] < 10.0 * _CONVERGED_M:
        status = 3
    else:
        status = 2 if np.sqrt(np.trace(covariance[_POSITION, _POSITION])) > settings.max_sigma_m else 0
    tests = (float(cost[0]), dof, float(chi_square_survival(cost[0], dof)), wrong, int(cost.size))
    if status:
        return _report_no_answer(sats, rough_gpst, status, tests)
    residual = np.full(len(sats), np.nan)
    residual[used] = solved.target_m[0] - _predict_sky(problem, state).range_m
    return _fix(sats, rough_gpst, state, covariance, residual, 0, tests, float(problem.wrap_m.min()))


def _report_no_answer(
    sats: tuple[str, ...],
    rough_gpst: np.datetime64,
    status: int,
    tests: tuple[float, int, float, float, int] = (np.nan, 0, np.nan, np.nan, 0),
) -> CoarseFix:
    return _fix(
        sats,
        rough_gpst,
        np.full(_STATES, np.nan),
        np.full((_STATES, _STATES), np.nan),
        np.full(len(sats), np.nan),
        status,
        tests,
        np.nan,
    )


def _fix(
    sats: tuple[str, ...],
    rough_gpst: np.datetime64,
    state: Reals,
    covariance: Reals,
    residual_m: Reals,
    status: int,
    tests: tuple[float, int, float, float, int],
    wrap_m: float,
) -> CoarseFix:
    late_s = float(state[_TIME])
    moved = timedelta_from_s(0.0 if status else late_s)
    first = np.array([0, 1, 2, _BIAS, _TIME])
    mirrored = np.array([1.0, 1.0, 1.0, -1.0, 1.0])  # the bias is minus c times the phase of true time
    statistic, dof, p_value, wrong, candidates = tests
    return CoarseFix(
        sats=sats,
        status=status,
        gpst=rough_gpst + moved if status == 0 else np.datetime64("NaT", "ns"),
        position_ecef_m=state[_POSITION],
        velocity_ecef_m_s=state[_VELOCITY],
        time_error_s=late_s,
        time_sigma_s=float(np.sqrt(covariance[_TIME, _TIME])),
        phase_s=float(np.mod(-state[_BIAS], wrap_m) / SPEED_OF_LIGHT_M_S),
        clock_drift=float(state[_DRIFT] / SPEED_OF_LIGHT_M_S),
        covariance=covariance[np.ix_(first, first)] * np.outer(mirrored, mirrored),
        residual_m=residual_m,
        statistic=statistic,
        dof=dof,
        p_value=p_value,
        wrong_probability=wrong,
        candidates=candidates,
    )
