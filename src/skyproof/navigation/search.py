"""Branch and bound for sets of signals, at most one per satellite, that fit one position and clock.

Every four signals have closed-form solutions of their own (two skies can be thousands of kilometres apart: no common
linearisation serves both). From there breadth first over the further satellites: each candidate takes one of a
satellite's signals, or skips it; a signal is checked against the prediction, then the candidate is solved again. All
candidates of a level are arrays with one leading axis. The statistic can only grow with further signals, so a candidate
beyond the threshold of the full set is dropped without loss. How many satellites may be skipped follows from the size
wanted: the caller begins with all (iterative deepening), so that the work grows only as far as it must.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from skyproof.arrays import Booleans, Indices, Reals
from skyproof.gnss.constants import WGS84_A_M
from skyproof.gnss.frames import geodetic_from_ecef
from skyproof.navigation.chance import count_set_combinations
from skyproof.navigation.fit_kernels import (
    FARTHEST_M,
    LOWEST_M,
    extend_candidates,
    find_fours,
    order_by_geometry,
    predict_misfits,
    solve_choices,
)
from skyproof.navigation.ranges import describe_ionosphere
from skyproof.records import Klobuchar, Selectable
from skyproof.statistics.distributions import chi_square_threshold

__all__ = [
    "SetCandidates",
    "SetSearch",
    "WindowRanges",
    "compute_innovation",
    "compute_misfits",
    "find_point_below",
    "is_plausible",
    "solve",
]

_UNKNOWNS = 4
_MOST_FOURS = 300_000
_MOST_CANDIDATES = 10_000


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

    @cached_property
    def kernel_arguments(self) -> tuple[Reals, Reals, Reals, Reals, float, Reals]:
        """Return the first arguments of the kernels of `fit_kernels`."""
        arrays = (
            np.ascontiguousarray(values, np.float64)
            for values in (self.satellite_ecef_m, self.range_m, self.sigma_m, self.carrier_hz)
        )
        satellite_ecef_m, range_m, sigma_m, carrier_hz = arrays
        model = describe_ionosphere(self.ionosphere, self.ionosphere_share)
        return satellite_ecef_m, range_m, sigma_m, carrier_hz, float(self.tow_s), model


@dataclass(frozen=True, eq=False, kw_only=True)
class SetCandidates(Selectable):
    """choice (m, satellites): row of `WindowRanges`, or -1 for skipped; state_m (m, 4), covariance_m2 (m, 4, 4) and
    statistic (m,)."""

    choice: Indices
    state_m: Reals
    covariance_m2: Reals
    statistic: Reals


class SetSearch:
    """Finds consistent sets among the signals of several satellites; remembers the solutions of the fours.

    Parameters
    ----------
    copies : per satellite, the rows of `measurements` that are its signals.
    """

    def __init__(self, measurements: WindowRanges, copies: list[Indices]) -> None:
        self._measurements = measurements
        firsts = np.array([satellite_rows[0] for satellite_rows in copies], np.intp)
        self._copies = [
            copies[k] for k in order_by_geometry(np.ascontiguousarray(measurements.satellite_ecef_m[firsts]))
        ]
        self._table = np.full((len(copies), max(map(len, copies))), -1)
        for k, rows in enumerate(self._copies):
            self._table[k, : rows.size] = rows
        self._fours: dict[int, SetCandidates] = {}

    def find_of_size(self, size: int, free: Booleans, *, false_alarm_probability: float) -> SetCandidates:
        """Find all consistent candidates of `size` satellites, the smallest statistic first.

        `choice` is (m, size).

        Parameters
        ----------
        size : five at least.
        free : (n,) which of the measurements may be used.

        The work is bounded. Nothing is found if the first satellites give more than 300 000 combinations of four
        (beyond 12 satellites of 3 signals each: sets so small among so many signals mean nothing). And of the
        candidates on a level the 10 000 with the smallest statistics stay: more there are only where the copies of many
        satellites are within the noise of each other and can be exchanged.
        """
        n = len(self._copies)
        usable = (self._table >= 0) & free[self._table]
        if np.count_nonzero(usable.any(axis=1)) < size:
            return _make_empty(size)
        skips = n - size
        first = usable[: _UNKNOWNS + skips].sum(axis=1)
        if count_set_combinations(first, _UNKNOWNS) > _MOST_FOURS:
            return _make_empty(size)
        levels = range(_UNKNOWNS - 1, _UNKNOWNS + skips)
        fours = [self._find_fours_up_to(level) for level in levels]
        kept = [np.all((candidates.choice < 0) | free[candidates.choice], axis=1) for candidates in fours]
        choice, state_m, covariance_m2, statistic = extend_candidates(
            *self._measurements.kernel_arguments,
            np.where(usable, self._table, -1),
            np.repeat(np.array(levels), [int(rows.sum()) for rows in kept]),
            *(
                np.concatenate([getattr(candidates, name)[rows] for candidates, rows in zip(fours, kept, strict=True)])
                for name in ("choice", "state_m", "covariance_m2")
            ),
            skips,
            float(chi_square_threshold(false_alarm_probability, size - _UNKNOWNS)),
            _MOST_CANDIDATES,
        )
        whole = np.flatnonzero(((choice >= 0).sum(axis=1) == size) & is_plausible(state_m[:, :3]))
        order = whole[np.argsort(statistic[whole], kind="stable")]
        return SetCandidates(
            choice=choice[order][choice[order] >= 0].reshape(-1, size),
            state_m=state_m[order],
            covariance_m2=covariance_m2[order],
            statistic=statistic[order],
        )

    def _find_fours_up_to(self, level: int) -> SetCandidates:
        """Solve all fours whose last satellite is at `level`.

        Both solutions of each, unless nowhere near the Earth.
        """
        if level not in self._fours:
            sats = np.array([(*three, level) for three in combinations(range(level), 3)])
            picks = np.indices((self._table.shape[1],) * _UNKNOWNS).reshape(_UNKNOWNS, -1).T
            rows = self._table[sats[:, None, :], picks[None, :, :]].reshape(-1, _UNKNOWNS)
            sats = np.repeat(sats, len(picks), axis=0)[np.all(rows >= 0, axis=1)]
            rows = rows[np.all(rows >= 0, axis=1)]
            four, state_m, covariance_m2 = find_fours(*self._measurements.kernel_arguments, rows)
            choice = np.full((four.size, len(self._copies)), -1)
            np.put_along_axis(choice, sats[four], rows[four], axis=1)
            self._fours[level] = SetCandidates(
                choice=choice,
                state_m=state_m,
                covariance_m2=covariance_m2,
                statistic=np.zeros(four.size),  # four always fit
            )
        return self._fours[level]


def solve(
    measurements: WindowRanges, choice: Indices, start_m: Reals, *, rounds: int = 1, clocks: Reals | None = None
) -> SetCandidates:
    """Solve position and clock of each row of `choice` (m, k), from `start_m` (m, 4).

    The atmosphere is that of the start.

    With `clocks` (k, c), as in `design_matrix`, there are several clocks: states and covariances have 3 + c numbers. A
    last step of 100 m is taken linearly, which neglects its square over the distance in a range, 0.5 mm.
    """
    state_m = np.array(start_m, np.float64)
    m, n = state_m.shape
    covariance_m2, statistic = np.empty((m, n, n)), np.empty(m)
    solve_choices(
        *measurements.kernel_arguments,
        np.ascontiguousarray(choice, np.int64),
        np.ones((choice.shape[1], 1)) if clocks is None else np.ascontiguousarray(clocks, np.float64),
        rounds,
        state_m,
        covariance_m2,
        statistic,
    )
    return SetCandidates(choice=choice, state_m=state_m, covariance_m2=covariance_m2, statistic=statistic)


def compute_innovation(
    measurements: WindowRanges, rows: Indices, state_m: Reals, covariance_m2: Reals
) -> tuple[Reals, Reals]:
    """Subtract from each measurement (m,) its prediction by a fit without it; with the variance, m and m^2."""
    misfit_m, variance_m2, _ = _predict(measurements, rows, state_m, covariance_m2)
    return misfit_m, variance_m2


def compute_misfits(measurements: WindowRanges, rows: Indices, state_m: Reals) -> tuple[Reals, Reals, Reals]:
    """Return measurements (n,) minus one state's (4,) predictions, their sigmas (n,), and unit vectors (n, 3)."""
    states_m = np.broadcast_to(state_m, (rows.size, 4))
    misfit_m, variance_m2, unit = _predict(measurements, rows, states_m, np.zeros((rows.size, 4, 4)))
    return misfit_m, np.sqrt(variance_m2), unit


def _predict(
    measurements: WindowRanges, rows: Indices, state_m: Reals, covariance_m2: Reals
) -> tuple[Reals, Reals, Reals]:
    """Compute misfits (m,) by states (m, 4), their variances with those of the states, and unit vectors (m, 3)."""
    misfit_m, variance_m2, unit = np.empty(rows.size), np.empty(rows.size), np.empty((rows.size, 3))
    predict_misfits(
        *measurements.kernel_arguments,
        np.ascontiguousarray(rows, np.int64),
        np.ascontiguousarray(state_m, np.float64),
        np.ascontiguousarray(covariance_m2, np.float64),
        misfit_m,
        variance_m2,
        unit,
    )
    return misfit_m, variance_m2, unit


def find_point_below(measurements: WindowRanges, rows: Indices) -> Reals:
    """Find the point (3,) of the Earth's surface below the middle of these satellites, as a start."""
    middle_m = measurements.satellite_ecef_m[rows].sum(axis=0)
    return np.asarray(middle_m * (WGS84_A_M / np.linalg.norm(middle_m)))


def is_plausible(position_ecef_m: Reals) -> Booleans:
    """Check that positions lie at most 20 km deep and within 50 000 km of the Earth's centre.

    A spoofer may show a strange place.
    """
    _, _, height_m = geodetic_from_ecef(position_ecef_m)
    return np.asarray((height_m >= LOWEST_M) & (np.linalg.norm(position_ecef_m, axis=-1) <= FARTHEST_M))


def _make_empty(n_satellites: int) -> SetCandidates:
    return SetCandidates(
        choice=np.empty((0, n_satellites), dtype=np.intp),
        state_m=np.empty((0, _UNKNOWNS)),
        covariance_m2=np.empty((0, _UNKNOWNS, _UNKNOWNS)),
        statistic=np.empty(0),
    )
