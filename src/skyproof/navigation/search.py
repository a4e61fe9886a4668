"""Branch and bound for sets of signals, at most one per satellite, that fit one position and clock.

Every four signals have closed-form solutions of their own (two skies can be thousands of kilometres apart: no common
linearisation serves both). From there breadth first over the further satellites: each candidate takes one of a
satellite's signals, or skips it; a signal is checked against the prediction, then the candidate is solved anew. All
candidates of a level are arrays with one leading axis. The statistic can only grow with further signals, so a candidate
beyond the threshold of the full set is dropped without loss. How many satellites may be skipped follows from the size
wanted: the caller begins with all (iterative deepening), so that the work grows only as far as it must.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from skyproof.arrays import Booleans, Indices, Reals
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S, WGS84_A_M, WGS84_F
from skyproof.gnss.frames import geodetic_from_ecef
from skyproof.gnss.sky import rotate_to_reception
from skyproof.navigation.chance import set_combinations
from skyproof.navigation.least_squares import design_matrix, gauss_newton, line_of_sight
from skyproof.navigation.ranges import atmosphere
from skyproof.records import Klobuchar
from skyproof.statistics.distributions import chi_square_threshold

__all__ = ["SetCandidates", "SetSearch", "WindowRanges", "below", "innovation", "misfits", "plausible", "solve"]

_UNKNOWNS = 4
_MOST_FOURS = 300_000
_MOST_CANDIDATES = 10_000
_LINEAR_SLACK = 2.0  # the prediction is linear; twice the threshold leaves room for what that costs
_LOWEST_M, _FARTHEST_M = -20e3, 50e6
_TRAVEL_S = 0.075  # of a signal from orbit to ground, within 0.01 s


@dataclass(frozen=True, eq=False, kw_only=True)
class WindowRanges:
    """One window's signals: satellite_ecef_m (n, 3) at transmission, range_m (n,) without the satellite's clock,
    sigma_m (n,) of all but the ionosphere, carrier_hz (n,), tow_s of the window, and how the ionosphere is to be taken
    off."""

    satellite_ecef_m: Reals
    range_m: Reals
    sigma_m: Reals
    carrier_hz: Reals
    tow_s: float
    ionosphere: Klobuchar | None
    ionosphere_share: float


@dataclass(frozen=True, eq=False, kw_only=True)
class SetCandidates:
    """choice (m, satellites): row of `WindowRanges`, or -1 for skipped; state_m (m, 4), covariance_m2 (m, 4, 4) and
    statistic (m,)."""

    choice: Indices
    state_m: Reals
    covariance_m2: Reals
    statistic: Reals

    def take(self, rows: Booleans | Indices) -> "SetCandidates":
        return SetCandidates(
            choice=self.choice[rows],
            state_m=self.state_m[rows],
            covariance_m2=self.covariance_m2[rows],
            statistic=self.statistic[rows],
        )


class SetSearch:
    """Finds consistent sets among the signals of several satellites; remembers the solutions of the fours.

    Parameters
    ----------
    copies : per satellite, the rows of `measurements` that are its signals.
    """

    def __init__(self, measurements: WindowRanges, copies: list[Indices]) -> None:
        self._measurements = measurements
        self._copies = [copies[k] for k in _spread_first(measurements, copies)]
        self._fours: dict[int, SetCandidates] = {}

    def of_size(self, size: int, free: Booleans, *, false_alarm_probability: float) -> SetCandidates:
        """All consistent candidates of `size` satellites, the smallest statistic first; `choice` is (m, size).

        Parameters
        ----------
        size : five at least.
        free : (n,) which of the measurements may be used.

        The work is bounded. Nothing is found if the first satellites, of which four are taken, give more than 300 000
        combinations (beyond 12 satellites of 3 signals each: sets so small among so many signals mean nothing). And of
        the candidates on a level the 10 000 with the smallest statistics stay: more there are only where the copies of
        many satellites are within the noise of each other and can be exchanged.
        """
        n = len(self._copies)
        if sum(bool(free[rows].any()) for rows in self._copies) < size:
            return _nothing(size)
        skips = n - size
        first = [int(free[rows].sum()) for rows in self._copies[: _UNKNOWNS + skips]]
        limit = float(chi_square_threshold(false_alarm_probability, size - _UNKNOWNS))
        found = _nothing(n)
        if set_combinations(first, _UNKNOWNS) <= _MOST_FOURS:
            for level in range(_UNKNOWNS - 1, n):
                found = self._extended(found, level, skips, free, limit)
                if level - (_UNKNOWNS - 1) <= skips:
                    fours = self._fours_up_to(level)
                    found = _joined(found, fours.take(np.all((fours.choice < 0) | free[fours.choice], axis=1)))
        found = found.take((found.choice >= 0).sum(axis=1) == size)
        found = found.take(plausible(found.state_m[:, :3]))
        found = found.take(np.argsort(found.statistic, kind="stable"))
        return SetCandidates(
            choice=found.choice[found.choice >= 0].reshape(-1, size),
            state_m=found.state_m,
            covariance_m2=found.covariance_m2,
            statistic=found.statistic,
        )

    def _extended(
        self, candidates: SetCandidates, level: int, skips: int, free: Booleans, limit: float
    ) -> SetCandidates:
        """The candidates with each free signal of the satellite at `level`, where it fits, and with none of them."""
        signals = self._copies[level][free[self._copies[level]]]
        skipped = candidates.take((candidates.choice[:, : level + 1] < 0).sum(axis=1) <= skips)
        parents = len(candidates.statistic)
        children = candidates.take(np.repeat(np.arange(parents), signals.size))
        children.choice[:, level] = np.tile(signals, parents)  # `take` by index has made a copy
        return _joined(skipped, _one_more(self._measurements, children, level, limit))

    def _fours_up_to(self, level: int) -> SetCandidates:
        """All fours whose last satellite is at `level`: both solutions of each, unless nowhere near the Earth."""
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
            self._fours[level] = _solved_fours(self._measurements, choice[real], rows[real])
        return self._fours[level]


def solve(
    measurements: WindowRanges, choice: Indices, start_m: Reals, *, rounds: int = 1, clocks: Reals | None = None
) -> SetCandidates:
    """Position and clock of each row of `choice` (m, k), from `start_m` (m, 4), with the atmosphere of the start.

    With `clocks` (k, c), as in `design_matrix`, several clocks: states and covariances are of 3 + c numbers.
    A last step of 100 m is taken linearly: what that neglects in a range is its square over the distance, 0.5 mm.
    """
    taken = choice >= 0
    rows = np.where(taken, choice, 0)
    satellite = measurements.satellite_ecef_m[rows]
    state = start_m
    for _ in range(rounds):
        turned, _, _ = line_of_sight(satellite, state[:, :3])
        delay_m, delay_sigma_m = _atmosphere(measurements, rows, state, turned)
        sigma_m = np.hypot(measurements.sigma_m[rows], delay_sigma_m)
        solution = gauss_newton(
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


def innovation(measurements: WindowRanges, rows: Indices, state_m: Reals, covariance_m2: Reals) -> tuple[Reals, Reals]:
    """Each measurement (m,) minus its prediction from a fit without it, and the variance of that, m and m^2."""
    satellite = measurements.satellite_ecef_m[rows][:, None, :]
    turned, unit, distance_m = line_of_sight(satellite, state_m[:, :3])
    delay_m, delay_sigma_m = _atmosphere(measurements, rows[:, None], state_m, turned)
    predicted_m = (distance_m + delay_m)[:, 0] + state_m[:, 3]
    design = design_matrix(unit)
    prediction_m2 = (design @ covariance_m2 @ np.swapaxes(design, -1, -2))[:, 0, 0]
    variance_m2 = prediction_m2 + measurements.sigma_m[rows] ** 2 + delay_sigma_m[:, 0] ** 2
    return measurements.range_m[rows] - predicted_m, variance_m2


def misfits(measurements: WindowRanges, rows: Indices, state_m: Reals) -> tuple[Reals, Reals, Reals]:
    """Measurements (n,) minus what one state (4,) predicts, their sigmas (n,), and unit vectors (n, 3)."""
    turned, unit, distance_m = line_of_sight(measurements.satellite_ecef_m[rows][None], state_m[None, :3])
    delay_m, delay_sigma_m = _atmosphere(measurements, rows[None], state_m[None], turned)
    misfit_m = measurements.range_m[rows] - (distance_m + delay_m)[0] - state_m[3]
    return misfit_m, np.hypot(measurements.sigma_m[rows], delay_sigma_m[0]), unit[0]


def below(measurements: WindowRanges, rows: Indices) -> Reals:
    """(3,) the point of the Earth's surface below the middle of these satellites: where to begin."""
    middle_m = measurements.satellite_ecef_m[rows].sum(axis=0)
    return np.asarray(middle_m * (WGS84_A_M / np.linalg.norm(middle_m)))


def plausible(position_ecef_m: Reals) -> Booleans:
    """Not deeper than 20 km, nor more than 50 000 km from the Earth's centre: a spoofer may show a strange place."""
    _, _, height_m = geodetic_from_ecef(position_ecef_m)
    return np.asarray((height_m >= _LOWEST_M) & (np.linalg.norm(position_ecef_m, axis=-1) <= _FARTHEST_M))


def _solved_fours(measurements: WindowRanges, choice: Indices, rows: Indices) -> SetCandidates:
    starts = _bancroft(measurements.satellite_ecef_m[rows], measurements.range_m[rows])
    near = _roughly_plausible(starts, 500e3)  # closed form and a poor geometry; NaN is nowhere
    four, _ = np.nonzero(near)
    # Twice: the start has no atmosphere, and in a poor geometry is kilometres away from the place whose it should be.
    solved = solve(measurements, rows[four], starts[near], rounds=2)
    kept = _plausible_within_sigma(solved)
    moved_m = np.linalg.norm(np.diff(solved.state_m, axis=0), axis=-1)
    kept[1:] &= (np.diff(four) != 0) | (moved_m > 10.0)  # else both starts led to one solution
    return SetCandidates(
        choice=choice[four[kept]],
        state_m=solved.state_m[kept],
        covariance_m2=solved.covariance_m2[kept],
        statistic=np.zeros(int(kept.sum())),  # four always fit
    )


def _one_more(measurements: WindowRanges, candidates: SetCandidates, level: int, limit: float) -> SetCandidates:
    """Candidates with a fifth or further signal, just chosen at `level`: predicted, then solved anew."""
    rows = candidates.choice[:, level]
    misfit_m, variance_m2 = innovation(measurements, rows, candidates.state_m, candidates.covariance_m2)
    candidates = candidates.take(candidates.statistic + misfit_m**2 / variance_m2 <= _LINEAR_SLACK * limit)
    solved = solve(measurements, candidates.choice[:, : level + 1], candidates.state_m)
    kept = np.flatnonzero((solved.statistic <= limit) & _plausible_within_sigma(solved))
    if kept.size > _MOST_CANDIDATES:
        kept = kept[np.argpartition(solved.statistic[kept], _MOST_CANDIDATES)[:_MOST_CANDIDATES]]
    return SetCandidates(
        choice=candidates.choice[kept],
        state_m=solved.state_m[kept],
        covariance_m2=solved.covariance_m2[kept],
        statistic=solved.statistic[kept],
    )


def _plausible_within_sigma(solved: SetCandidates) -> Booleans:
    """Of few signals in poor geometry the place is only roughly known: ten sigma are allowed."""
    spread_m2 = np.trace(solved.covariance_m2[:, :3, :3], axis1=-2, axis2=-1)
    return _roughly_plausible(solved.state_m, 10.0 * np.sqrt(spread_m2))


def _roughly_plausible(state_m: Reals, slack_m: Reals | float) -> Booleans:
    """As `plausible`, with the smallest radius of the Earth for its surface."""
    centre_m = np.linalg.norm(state_m[..., :3], axis=-1)
    polar_m = WGS84_A_M * (1.0 - WGS84_F)
    return np.asarray((centre_m >= polar_m + _LOWEST_M - slack_m) & (centre_m <= _FARTHEST_M + slack_m))


def _atmosphere(measurements: WindowRanges, rows: Indices, state_m: Reals, turned_ecef_m: Reals) -> tuple[Reals, Reals]:
    delays = atmosphere(
        state_m[:, :3],
        turned_ecef_m,
        np.full(len(state_m), measurements.tow_s),
        measurements.ionosphere,
        ionosphere_share=measurements.ionosphere_share,
        carrier_hz=measurements.carrier_hz[rows],
    )
    return delays.delay_m, delays.sigma_m


def _bancroft(satellite_ecef_m: Reals, range_m: Reals) -> Reals:
    """Both solutions (m, 2, 4) for four ranges (m, 4) to satellites (m, 4, 3), NaN where there is none.

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
    both = np.linalg.solve(a, np.stack((np.ones_like(half_squares), half_squares), axis=-1))
    u, v = both[..., 0], both[..., 1]
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


def _spread_first(measurements: WindowRanges, copies: list[Indices]) -> list[int]:
    """Order of satellites in which the first few already have a good geometry, seen from below their middle."""
    satellite = measurements.satellite_ecef_m[[c[0] for c in copies]]
    _, unit, _ = line_of_sight(satellite, below(measurements, np.array([c[0] for c in copies])))
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


def _nothing(n_satellites: int) -> SetCandidates:
    return SetCandidates(
        choice=np.empty((0, n_satellites), dtype=np.intp),
        state_m=np.empty((0, _UNKNOWNS)),
        covariance_m2=np.empty((0, _UNKNOWNS, _UNKNOWNS)),
        statistic=np.empty(0),
    )


def _joined(*parts: SetCandidates) -> SetCandidates:
    return SetCandidates(
        choice=np.concatenate([part.choice for part in parts]),
        state_m=np.concatenate([part.state_m for part in parts]),
        covariance_m2=np.concatenate([part.covariance_m2 for part in parts]),
        statistic=np.concatenate([part.statistic for part in parts]),
    )
