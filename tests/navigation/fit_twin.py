"""Position and clock by least squares, delays, search for sets in plain NumPy: the slow twin of `fit_kernels`."""

from itertools import combinations

import numpy as np

from skyproof.gnss.atmosphere import compute_klobuchar_s, compute_troposphere_m
from skyproof.gnss.constants import EARTH_ROTATION_RAD_S, L1_HZ, SPEED_OF_LIGHT_M_S, WGS84_A_M, WGS84_F
from skyproof.gnss.ephemeris import Klobuchar
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.sky import rotate_to_reception
from skyproof.navigation.chance import count_set_combinations
from skyproof.navigation.least_squares import Solution, design_matrix
from skyproof.navigation.ranges import AtmosphereDelays
from skyproof.navigation.search import SetCandidates, find_point_below, is_plausible
from skyproof.statistics.distributions import chi_square_threshold

_NIGHT = Klobuchar(alpha=(0.0, 0.0, 0.0, 0.0), beta=(0.0, 0.0, 0.0, 0.0))  # leaves 5 ns times the obliquity
_UNKNOWN_IN_NIGHTS = 2.0  # 3 m at the zenith: between the 1.5 m of any night and the 5 m of an ordinary day

_UNKNOWNS = 4
_MOST_FOURS = 300_000
_MOST_CANDIDATES = 10_000
_LINEAR_SLACK = 2.0  # the prediction is linear; twice the threshold leaves room for what that costs
_LOWEST_M, _FARTHEST_M = -20e3, 50e6
_TRAVEL_S = 0.075  # of a signal from orbit to ground, within 0.01 s


def invert_spd(matrix, *, smallest_pivot=1e-13):
    """Invert symmetric positive definite matrices (..., n, n); NaN where one is not, or only just.

    Cholesky is written out over the few rows: unlike `numpy.linalg.inv` one singular matrix does not fail the
    batch, and for n = 4 it is several times faster. `smallest_pivot` is relative to the diagonal.
    """
    n = matrix.shape[-1]
    lower, inverse = np.zeros_like(matrix), np.zeros_like(matrix)
    for j in range(n):
        diagonal = matrix[..., j, j]
        pivot = diagonal - np.sum(lower[..., j, :j] ** 2, axis=-1)
        lower[..., j, j] = np.sqrt(np.where(pivot > smallest_pivot * diagonal, pivot, np.nan))
        for i in range(j + 1, n):
            inner = np.sum(lower[..., i, :j] * lower[..., j, :j], axis=-1)
            lower[..., i, j] = (matrix[..., i, j] - inner) / lower[..., j, j]
    for j in range(n):
        inverse[..., j, j] = 1.0 / lower[..., j, j]
        for i in range(j + 1, n):
            inner = np.sum(lower[..., i, j:i] * inverse[..., j:i, j], axis=-1)
            inverse[..., i, j] = -inner / lower[..., i, i]
    return np.asarray(np.swapaxes(inverse, -1, -2) @ inverse)


def compute_line_of_sight(satellite_ecef_m, position_ecef_m):
    """Compute satellites in the frame of reception, unit vectors to them, and distances.

    Parameters
    ----------
    satellite_ecef_m : (..., k, 3) at transmission, in the ECEF frame of transmission.
    position_ecef_m : (..., 3) at reception, in the ECEF frame of reception.

    The travel time is the unturned distance plus the first-order Sagnac term: the distance is right to a nanometre.
    """
    position = position_ecef_m[..., None, :]
    turned_m2 = satellite_ecef_m[..., 0] * position[..., 1] - satellite_ecef_m[..., 1] * position[..., 0]
    straight_m = np.linalg.norm(satellite_ecef_m - position, axis=-1)
    travel_s = (straight_m + EARTH_ROTATION_RAD_S / SPEED_OF_LIGHT_M_S * turned_m2) / SPEED_OF_LIGHT_M_S
    satellite = rotate_to_reception(satellite_ecef_m, travel_s)
    difference = satellite - position
    distance_m = np.linalg.norm(difference, axis=-1)
    return satellite, difference / distance_m[..., None], distance_m


def invert_normal(normal):
    """Invert normal matrices (..., n, n) in which clocks (from column 3 on) may have no measurement.

    Such a clock gets a weight of one of its own, so that it touches nothing and the others are solved.
    """
    n = normal.shape[-1]
    if n > 4:
        empty = np.diagonal(normal, axis1=-2, axis2=-1) == 0.0
        empty[..., :3] = False
        normal = normal + empty[..., None] * np.eye(n)
    return invert_spd(normal)


def fit_position(
    satellite_ecef_m,
    range_m,
    sigma_m,
    start_m,
    *,
    clocks=None,
    max_steps=12,
    tolerance_m=1e-4,
):
    """Fit position and clocks by iterated weighted least squares until none moves by more than `tolerance_m`.

    Parameters
    ----------
    satellite_ecef_m : (..., k, 3) at transmission, in the ECEF frame of transmission.
    range_m : (..., k) geometric range plus c times clock bias; all other delays are taken off.
    sigma_m : (..., k) one sigma. Not finite in any of the three means: not used.
    start_m : (..., 3 + c) where to start. Earth's centre with any clock does for a position near the Earth.
    clocks : (k, c) as in `design_matrix`.
    """
    used = np.isfinite(range_m) & np.isfinite(sigma_m) & np.isfinite(satellite_ecef_m[..., 0])
    weight = np.where(used, 1.0 / np.where(used, sigma_m, 1.0) ** 2, 0.0)
    satellite_ecef_m = np.where(used[..., None], satellite_ecef_m, 2.6e7)  # anywhere but at the receiver
    range_m = np.where(used, range_m, 0.0)
    state = np.array(start_m, dtype=np.float64)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        for _ in range(max_steps):
            _, unit, distance = compute_line_of_sight(satellite_ecef_m, state[..., :3])
            clock = state[..., 3:] if clocks is None else state[..., 3:] @ clocks.T
            misfit = np.where(used, range_m - distance - clock, 0.0)
            design = design_matrix(unit, clocks)
            weighted = np.swapaxes(design * weight[..., None], -1, -2)
            covariance = invert_normal(weighted @ design)
            step = (covariance @ (weighted @ misfit[..., None]))[..., 0]
            state = state + step
            step_m = np.linalg.norm(step, axis=-1)
            if not np.any(step_m > tolerance_m):
                break
        residual = np.where(used, misfit - (design @ step[..., None])[..., 0], 0.0)
    return Solution(state_m=state, covariance_m2=covariance, residual_m=residual, last_step_m=step_m)


def compute_atmosphere(
    position_ecef_m,
    satellite_ecef_m,
    tow_s,
    ionosphere,
    *,
    ionosphere_share=0.25,
    carrier_hz=None,
):
    """Delays of the code at `position_ecef_m` (..., 3) from satellites (..., k, 3) in the frame of reception.

    `sigma_m` is `ionosphere_share` of the ionosphere's delay: the broadcast model takes away about half of it
    (IS-GPS-200N, 20.3.3.5.2.5), and position and clock take up about half of what it leaves, which is alike for all
    satellites. Without the model's parameters 3 m at the zenith are taken, with a sigma of as much. Satellites below
    the horizon get the delay of the horizon. The ionosphere's delay goes with the inverse square of `carrier_hz`
    (k,), L1 without it (IS-GPS-200N, 20.3.3.3.3.3). Above 11 km the troposphere thins out with a scale of 6.3 km.
    """
    lat_rad, lon_rad, height_m = (value[..., None] for value in geodetic_from_ecef(position_ecef_m))
    # As `sky.compute_azimuth_elevation`, which would find the place once more: the dearest step where candidates are
    # many.
    enu_m = (satellite_ecef_m - position_ecef_m[..., None, :]) @ np.swapaxes(
        rot_enu_ecef(lat_rad, lon_rad)[..., 0, :, :], -1, -2
    )
    az_rad = np.arctan2(enu_m[..., 0], enu_m[..., 1])
    el_rad = np.arctan2(enu_m[..., 2], np.hypot(enu_m[..., 0], enu_m[..., 1]))
    above_rad = np.maximum(el_rad, 0.0)
    place = (lat_rad, lon_rad, az_rad, above_rad, np.asarray(tow_s)[..., None])
    if ionosphere is None:
        ionosphere_m = _UNKNOWN_IN_NIGHTS * SPEED_OF_LIGHT_M_S * compute_klobuchar_s(_NIGHT, *place)
        ionosphere_sigma_m = ionosphere_m
    else:
        ionosphere_m = SPEED_OF_LIGHT_M_S * compute_klobuchar_s(ionosphere, *place)
        ionosphere_sigma_m = ionosphere_share * ionosphere_m
    if carrier_hz is not None:
        slower = (L1_HZ / carrier_hz) ** 2
        ionosphere_m, ionosphere_sigma_m = slower * ionosphere_m, slower * ionosphere_sigma_m
    thin = np.exp(-np.clip(height_m - 11000.0, 0.0, 1e6) / 6340.0)
    return AtmosphereDelays(
        elevation_rad=el_rad,
        delay_m=ionosphere_m + thin * compute_troposphere_m(lat_rad, height_m, above_rad),
        sigma_m=ionosphere_sigma_m,
        ionosphere_m=ionosphere_m,
    )


class SetSearch:
    """Finds consistent sets among the signals of several satellites; remembers the solutions of the fours.

    Parameters
    ----------
    copies : per satellite, the rows of `measurements` that are its signals.
    """

    def __init__(self, measurements, copies):
        self._measurements = measurements
        self._copies = [copies[k] for k in _order_by_spread(measurements, copies)]
        self._fours = {}

    def find_of_size(self, size, free, *, false_alarm_probability):
        """Find all consistent candidates of `size` satellites, the smallest statistic first; `choice` is (m, size).

        Parameters
        ----------
        size : five at least.
        free : (n,) which of the measurements may be used.

        The work is bounded. Nothing is found if fours of the first satellites give more than 300 000
        combinations (beyond 12 satellites of 3 signals each: sets so small among so many signals mean nothing). And of
        the candidates on a level the 10 000 with the smallest statistics stay: more there are only where the copies of
        many satellites are within the noise of each other and can be exchanged.
        """
        n = len(self._copies)
        if sum(bool(free[rows].any()) for rows in self._copies) < size:
            return _find_nothing(size)
        skips = n - size
        first = [int(free[rows].sum()) for rows in self._copies[: _UNKNOWNS + skips]]
        limit = float(chi_square_threshold(false_alarm_probability, size - _UNKNOWNS))
        found = _find_nothing(n)
        if count_set_combinations(first, _UNKNOWNS) <= _MOST_FOURS:
            for level in range(_UNKNOWNS - 1, n):
                found = self._extend(found, level, skips, free, limit)
                if level - (_UNKNOWNS - 1) <= skips:
                    fours = self._find_fours_up_to(level)
                    found = _join(found, fours.select(np.all((fours.choice < 0) | free[fours.choice], axis=1)))
        found = found.select((found.choice >= 0).sum(axis=1) == size)
        found = found.select(is_plausible(found.state_m[:, :3]))
        found = found.select(np.argsort(found.statistic, kind="stable"))
        return SetCandidates(
            choice=found.choice[found.choice >= 0].reshape(-1, size),
            state_m=found.state_m,
            covariance_m2=found.covariance_m2,
            statistic=found.statistic,
        )

    def _extend(self, candidates, level, skips, free, limit):
        """Extend candidates by each free signal of the satellite at `level` that fits, and by none of them."""
        signals = self._copies[level][free[self._copies[level]]]
        skipped = candidates.select((candidates.choice[:, : level + 1] < 0).sum(axis=1) <= skips)
        parents = len(candidates.statistic)
        children = candidates.select(np.repeat(np.arange(parents), signals.size))
        children.choice[:, level] = np.tile(signals, parents)  # `take` by index has made a copy
        return _join(skipped, _add_signal(self._measurements, children, level, limit))

    def _find_fours_up_to(self, level):
        """Find all fours whose last satellite is at `level`: both solutions of each, if anywhere near the Earth."""
        if level not in self._fours:
            table = np.full((level + 1, max(map(len, self._copies))), -1)
            for k, rows in enumerate(self._copies[: level + 1]):
                table[k, : rows.size] = rows
            sats = np.array([(*three, level) for three in combinations(range(level), 3)])
            picks = np.stack(np.meshgrid(*[np.arange(table.shape[1])] * _UNKNOWNS, indexing="ij"), axis=-1).reshape(
                -1, 4
            )
            rows = table[sats[:, None, :], picks[None, :, :]].reshape(-1, _UNKNOWNS)
            choice = np.full((len(rows), len(self._copies)), -1)
            np.put_along_axis(choice, np.repeat(sats, len(picks), axis=0), rows, axis=1)
            real = np.all(rows >= 0, axis=1)
            self._fours[level] = _solve_fours(self._measurements, choice[real], rows[real])
        return self._fours[level]


def solve(measurements, choice, start_m, *, rounds=1, clocks=None):
    """Solve position and clock of each row of `choice` (m, k), from `start_m` (m, 4), with its atmosphere.

    With `clocks` (k, c), as in `design_matrix`, several clocks: states and covariances have 3 + c numbers.
    A last step of 100 m is taken linearly: what that neglects in a range is its square over the distance, 0.5 mm.
    """
    taken = choice >= 0
    rows = np.where(taken, choice, 0)
    satellite = measurements.satellite_ecef_m[rows]
    state = start_m
    for _ in range(rounds):
        turned, _, _ = compute_line_of_sight(satellite, state[:, :3])
        delay_m, delay_sigma_m = _compute_atmosphere(measurements, rows, state, turned)
        sigma_m = np.hypot(measurements.sigma_m[rows], delay_sigma_m)
        solution = fit_position(
            satellite,
            measurements.range_m[rows] - delay_m,
            np.where(taken, sigma_m, np.nan),
            state,
            clocks=clocks,
            max_steps=6,
            tolerance_m=100.0,
        )
        state = solution.state_m
    return SetCandidates(
        choice=choice,
        state_m=state,
        covariance_m2=solution.covariance_m2,
        statistic=np.sum((solution.residual_m / sigma_m) ** 2, axis=-1),
    )


def compute_innovation(measurements, rows, state_m, covariance_m2):
    """Subtract from each measurement (m,) its prediction from a fit without it; also give the variance, m and m^2."""
    satellite = measurements.satellite_ecef_m[rows][:, None, :]
    turned, unit, distance_m = compute_line_of_sight(satellite, state_m[:, :3])
    delay_m, delay_sigma_m = _compute_atmosphere(measurements, rows[:, None], state_m, turned)
    predicted_m = (distance_m + delay_m)[:, 0] + state_m[:, 3]
    design = design_matrix(unit)
    prediction_m2 = (design @ covariance_m2 @ np.swapaxes(design, -1, -2))[:, 0, 0]
    variance_m2 = prediction_m2 + measurements.sigma_m[rows] ** 2 + delay_sigma_m[:, 0] ** 2
    return measurements.range_m[rows] - predicted_m, variance_m2


def _solve_fours(measurements, choice, rows):
    starts = _solve_bancroft(measurements.satellite_ecef_m[rows], measurements.range_m[rows])
    near = _is_roughly_plausible(starts, 500e3)  # closed form and a poor geometry; NaN is nowhere
    four, _ = np.nonzero(near)
    # Twice: the start has no atmosphere, and in a poor geometry is kilometres away from the place whose it should be.
    solved = solve(measurements, rows[four], starts[near], rounds=2)
    kept = _is_plausible_within_sigma(solved)
    moved_m = np.linalg.norm(np.diff(solved.state_m, axis=0), axis=-1)
    kept[1:] &= (np.diff(four) != 0) | (moved_m > 10.0)  # else both starts led to one solution
    return SetCandidates(
        choice=choice[four[kept]],
        state_m=solved.state_m[kept],
        covariance_m2=solved.covariance_m2[kept],
        statistic=np.zeros(int(kept.sum())),  # four always fit
    )


def _add_signal(measurements, candidates, level, limit):
    """Predict a further signal, just chosen at `level`, drop candidates that it does not fit, and solve again."""
    rows = candidates.choice[:, level]
    misfit_m, variance_m2 = compute_innovation(measurements, rows, candidates.state_m, candidates.covariance_m2)
    candidates = candidates.select(candidates.statistic + misfit_m**2 / variance_m2 <= _LINEAR_SLACK * limit)
    solved = solve(measurements, candidates.choice[:, : level + 1], candidates.state_m)
    kept = np.flatnonzero((solved.statistic <= limit) & _is_plausible_within_sigma(solved))
    if kept.size > _MOST_CANDIDATES:
        kept = kept[np.argpartition(solved.statistic[kept], _MOST_CANDIDATES)[:_MOST_CANDIDATES]]
    return SetCandidates(
        choice=candidates.choice[kept],
        state_m=solved.state_m[kept],
        covariance_m2=solved.covariance_m2[kept],
        statistic=solved.statistic[kept],
    )


def _is_plausible_within_sigma(solved):
    """Test plausibility with ten sigma allowed, since few signals in poor geometry know the place roughly."""
    spread_m2 = np.trace(solved.covariance_m2[:, :3, :3], axis1=-2, axis2=-1)
    return _is_roughly_plausible(solved.state_m, 10.0 * np.sqrt(spread_m2))


def _is_roughly_plausible(state_m, slack_m):
    """Test as `is_plausible` does, with the smallest radius of the Earth for its surface."""
    centre_m = np.linalg.norm(state_m[..., :3], axis=-1)
    polar_m = WGS84_A_M * (1.0 - WGS84_F)
    return np.asarray((centre_m >= polar_m + _LOWEST_M - slack_m) & (centre_m <= _FARTHEST_M + slack_m))


def _compute_atmosphere(measurements, rows, state_m, turned_ecef_m):
    delays = compute_atmosphere(
        state_m[:, :3],
        turned_ecef_m,
        np.full(len(state_m), measurements.tow_s),
        measurements.ionosphere,
        ionosphere_share=measurements.ionosphere_share,
        carrier_hz=measurements.carrier_hz[rows],
    )
    return delays.delay_m, delays.sigma_m


def _solve_bancroft(satellite_ecef_m, range_m):
    """Solve for both solutions (m, 2, 4) of four ranges (m, 4) to satellites (m, 4, 3), NaN where there is none.

    S. Bancroft, "An algebraic solution of the GPS equations", IEEE Trans. AES 21(1), 1985. The Earth's turn is taken
    for 75 ms, which leaves metres; the atmosphere is left in.
    """
    satellite = rotate_to_reception(satellite_ecef_m, np.full(range_m.shape, _TRAVEL_S))
    common_m = range_m.mean(axis=1, keepdims=True) - SPEED_OF_LIGHT_M_S * _TRAVEL_S  # keeps the numbers of one size
    unit = WGS84_A_M
    a = np.concatenate((satellite, (range_m - common_m)[..., None]), axis=-1) / unit
    minkowski = np.array([1.0, 1.0, 1.0, -1.0])
    solvable = np.linalg.det(a) != 0.0  # also what LAPACK would refuse, batch and all
    a = np.where(solvable[:, None, None], a, np.eye(_UNKNOWNS))
    half_squares = 0.5 * np.sum(a * a * minkowski, axis=-1)
    solved = np.linalg.solve(a, np.stack((np.ones_like(half_squares), half_squares), axis=-1))
    u, v = solved[..., 0], solved[..., 1]
    uu, uv, vv = (np.sum(p * q * minkowski, axis=-1) for p, q in ((u, u), (u, v), (v, v)))
    with np.errstate(invalid="ignore", divide="ignore"):
        # uu x^2 + 2 (uv - 1) x + vv = 0, in the form that keeps its digits when uu is small.
        half = uv - 1.0
        # Noise can make a double root complex: then the real part is the start.
        root = -half - np.copysign(np.sqrt(np.maximum(half**2 - uu * vv, 0.0)), half)
        x = np.stack((root / uu, vv / root), axis=-1)
    solutions = (v[:, None, :] + x[..., None] * u[:, None, :]) * minkowski * unit
    solutions[..., 3] += common_m
    backwards = np.any(range_m[:, None, :] < solutions[..., 3:], axis=-1)  # squaring lets negative distances in
    solutions[backwards | ~solvable[:, None]] = np.nan
    return np.asarray(solutions)


def _order_by_spread(measurements, copies):
    """Order satellites so that the first few already have a good geometry, seen from below their middle."""
    satellite = measurements.satellite_ecef_m[[c[0] for c in copies]]
    _, unit, _ = compute_line_of_sight(satellite, find_point_below(measurements, np.array([c[0] for c in copies])))
    design = design_matrix(unit)
    covariance = np.eye(_UNKNOWNS) * 1e3
    order: list[int] = []
    for _ in copies:
        gained = np.einsum("ki,ij,kj->k", design, covariance, design)
        gained[order] = -1.0
        best = int(np.argmax(gained))
        order.append(best)
        along = covariance @ design[best]
        covariance = covariance - np.outer(along, along) / (1.0 + design[best] @ along)
    return order


def _find_nothing(n_satellites):
    return SetCandidates(
        choice=np.empty((0, n_satellites), dtype=np.intp),
        state_m=np.empty((0, _UNKNOWNS)),
        covariance_m2=np.empty((0, _UNKNOWNS, _UNKNOWNS)),
        statistic=np.empty(0),
    )


def _join(*parts):
    return SetCandidates(
        choice=np.concatenate([part.choice for part in parts]),
        state_m=np.concatenate([part.state_m for part in parts]),
        covariance_m2=np.concatenate([part.covariance_m2 for part in parts]),
        statistic=np.concatenate([part.statistic for part in parts]),
    )
