"""Explain pseudoranges that fit no one position by benign causes: the largest p-value under each.

Each cause is a set of errors; what the closest of them leaves of the misfit, over its sigma, is chi-square at most:

- reflections of a street come late, by up to `unrelated_spread_m`: of one or two satellites at any time (`Reflected`),
  and of all of them where no direct signal is received;
- interference draws each code loop to either side, no farther than that;
- two channels or satellites fail, by any amount;
- orbits may be wrong by any amount, of all satellites: nothing is left to test.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final

import numpy as np
from scipy.optimize import lsq_linear

from skyproof.arrays import Indices, Reals
from skyproof.navigation.least_squares import design_matrix
from skyproof.navigation.search import WindowRanges, compute_misfits, find_point_below, solve
from skyproof.records.policy import number
from skyproof.statistics.distributions import chi_square_survival
from skyproof.statistics.leave_out import largest_p_value_without

__all__ = ["POLICY", "RangeFit", "Reflected", "ResidualPolicy", "find_reflected", "fit_groups"]

_ROUNDS = 2
"""From a fit that faults drew off by kilometres the first is not linear."""


@dataclass(frozen=True)
class ResidualPolicy:
    """Numbers by which the residual test decides, each with its reason."""

    no_echo_m: float = number(
        1e4,
        "m",
        "Assumed: no reflection is so late: what comes a detour of ten kilometres is far below what is tracked.",
    )
    one_orbit_m: float = number(
        200.0,
        "m",
        "Assumed: signals of a satellite with a wrong orbit miss a place alike, but for ionosphere and group delays.",
    )
    faulty_satellites: int = number(
        2, "1", "Assumed: satellites that fail, or are received by a reflection, at the same time; more is no accident."
    )


POLICY: Final = ResidualPolicy()


@dataclass(frozen=True, eq=False)
class RangeFit:
    """Rows of a window's measurements, in groups with a clock each, with the position and clocks that fit them best.

    state_m : (3 + groups,). statistic : sum of squared residuals over their sigmas. tests : fits of the window, which
    share the false-alarm probability.
    """

    measurements: WindowRanges
    groups: tuple[Indices, ...]
    state_m: Reals
    statistic: float
    tests: int

    @property
    def rows(self) -> Indices:
        """Return the rows of all groups; none of a fit without any."""
        return np.concatenate([np.empty(0, np.intp), *self.groups])

    @property
    def clocks(self) -> Reals:
        """Return which clock each row has: (rows, groups), ones and zeros."""
        return np.repeat(np.eye(len(self.groups)), [group.size for group in self.groups], axis=0)

    @property
    def spare(self) -> int:
        """Return how many satellites are beyond those that a position and the clocks need."""
        return self.rows.size - len(self.groups) - 3

    def misfits(self, state_m: Reals | None = None) -> tuple[Reals, Reals, Reals]:
        """Return the misfits (n,) of a state (default: the fitted one), their sigma (n,) and the design matrix.

        The design is (n, 3 + groups).
        """
        at_m = self.state_m if state_m is None else state_m
        misfit_m, sigma_m, unit = compute_misfits(self.measurements, self.rows, np.append(at_m[:3], 0.0))
        return misfit_m - self.clocks @ at_m[3:], sigma_m, design_matrix(unit, self.clocks)

    def without(self, rows: Iterable[int]) -> "RangeFit":
        """Fit again without some rows; no fit with a satellite to spare has `spare` of 0 or less."""
        gone = list(rows)
        fewer = [rows_kept for group in self.groups if (rows_kept := group[~np.isin(group, gone)]).size]
        return fit_groups(self.measurements, fewer, self.tests)

    @property
    def p_value(self) -> float:
        """Return the p-value of the misfit by noise, for all fits of the window together; 1 where nothing is tested."""
        return self._chance(self.statistic) if self.spare > 0 and np.isfinite(self.statistic) else 1.0

    def p_value_with_errors(self, low_m: Reals | float, high_m: Reals | float) -> float:
        """Return the p-value of the misfit if each row errs by between `low_m` and `high_m` (n,) beside its noise."""
        free = np.broadcast_to(np.asarray(high_m) > np.asarray(low_m), self.rows.shape)
        state_m, n = self.state_m, self.state_m.size
        low, high = (np.broadcast_to(each, self.rows.shape)[free] for each in (low_m, high_m))
        bounds = np.append(np.full(n, -np.inf), low), np.append(np.full(n, np.inf), high)
        for _ in range(_ROUNDS):
            misfit_m, sigma_m, design = self.misfits(state_m)
            columns = np.hstack((design, np.eye(self.rows.size)[:, free])) / sigma_m[:, None]
            solved = lsq_linear(columns, misfit_m / sigma_m, bounds)
            state_m = state_m + solved.x[:n]
        return self._chance(2.0 * float(solved.cost))

    def p_value_without_two(self, alpha: float) -> float:
        """Return the largest p-value without any one or two rows; alpha : from where on the answer does not matter."""

        def p_values(sets: Iterable[tuple[int, ...]]) -> Iterator[float]:
            for rows in sets:
                yield self.without(rows).p_value

        least = 4 + len(self.groups)
        return largest_p_value_without(self._by_misfit(), p_values, counts=_numbers(), least=least, enough=alpha)

    def p_values_without(self, count: int) -> list[tuple[tuple[int, ...], float]]:
        """Return choices of so many rows, and bounds of the p-value if they err by any amount, the largest first.

        By the linear fit: without rows S the statistic is lower by w_S' P_SS^-1 w_S. Here w are the residuals and P
        their covariance, in sigmas.
        """
        misfit_m, sigma_m, design = self.misfits()
        basis, _ = np.linalg.qr(design / sigma_m[:, None])
        covariance = np.eye(self.rows.size) - basis @ basis.T
        residual = covariance @ (misfit_m / sigma_m)
        chosen = np.array(list(combinations(range(self.rows.size), count)))
        parts, blocks = residual[chosen], covariance[chosen[:, :, None], chosen[:, None, :]]
        lower = np.einsum("ki,kij,kj->k", parts, np.linalg.pinv(blocks, hermitian=True), parts)
        statistics = np.maximum(residual @ residual - lower, 0.0)
        order = np.argsort(statistics)
        return [(tuple(self.rows[chosen[k]].tolist()), self._chance(float(statistics[k]))) for k in order]

    def _chance(self, statistic: float) -> float:
        return min(1.0, self.tests * float(chi_square_survival(statistic, self.spare)))

    def _by_misfit(self) -> list[int]:
        """Return the rows, those that fit worst first: they are the likeliest to be left out."""
        return [row for (row,), _ in self.p_values_without(1)]


def _numbers() -> tuple[int, ...]:
    """Return how many satellites may fail at once, the fewest first."""
    return tuple(range(1, POLICY.faulty_satellites + 1))


def fit_groups(measurements: WindowRanges, groups: Sequence[Indices], tests: int = 1) -> RangeFit:
    """Fit a position, and a clock for each group of rows; the result is NaN if the fit fails."""
    fit = RangeFit(measurements, tuple(groups), np.full(3 + len(groups), np.nan), np.nan, tests)
    if not fit.groups or fit.spare < 0:
        return fit
    start_m = np.concatenate((find_point_below(measurements, fit.rows), np.zeros(len(groups))))
    found = solve(measurements, fit.rows[None], start_m[None], rounds=3, clocks=fit.clocks)
    return replace(fit, state_m=np.asarray(found.state_m[0]), statistic=float(found.statistic[0]))


@dataclass(frozen=True)
class Reflected:
    """One or two rows that reflections explain, and the p-value of the misfit if they do; none and 0 if they do not."""

    rows: tuple[int, ...]
    p_value: float


def find_reflected(fit: RangeFit, *, spread_m: float, alpha: float) -> Reflected:
    """Find the fewest rows whose late signals, by up to `spread_m`, explain a misfit at `alpha`.

    The others have more satellites to spare than are left out: fewer fit whatever is left out.
    """
    for count in (count for count in _numbers() if fit.spare > 2 * count):
        for rows, at_most in fit.p_values_without(count):
            if at_most < alpha:
                break
            p_value = fit.p_value_with_errors(0.0, np.where(np.isin(fit.rows, rows), spread_m, 0.0))
            if p_value >= alpha:
                return Reflected(rows, p_value)
    return Reflected((), 0.0)
