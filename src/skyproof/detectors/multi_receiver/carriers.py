"""Test carriers between two receivers: from one antenna, or from the sky over antennas that stand as known.

A satellite's carrier differs between two receivers by whole cycles, by the clocks, and by the path. The clocks' part is
the same for all satellites of a kind of signal. The path's part is the same for all signals of one antenna, and -b.u_k
for the sky over the baseline b. Fractions of cycles of the differences, less those of another satellite, are double
differences. They are zero for one antenna, and follow from b for the sky. Their noise is millimetres against a
wavelength of 0.2 m, where code has a metre. After N. Stenberg, E. Axell, J. Rantakokko, G. Hendeby, NAVIGATION 69(1),
2022, doi 10.33012/navi.510, who test how fast the differences change; fractions decide at once, slopes at 1 m after a
minute.

Errors are taken as normal, of stated sigma. Whole cycles are free, so both statistics are smallest values over them:
chi-square at the true ones, and no larger. p-values are never too small then.

For the sky, cycles and baseline are estimated together. Three satellites' whole cycles that the known geometry allows
give a baseline. It gives the next one's cycles, and these a better baseline. Each is rounded in turn, as in P.
Teunissen, "GNSS ambiguity bootstrapping", 1998. What the geometry allows is part of the statistic. If it allows so much
that fractions fit by chance, there is no decision. Signals of several kinds, of one set, rarely fit together by chance.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from scipy import special

from skyproof.arrays import Booleans, Complexes, Indices, Reals
from skyproof.detectors.multi_receiver.common_epochs import CommonPhases
from skyproof.detectors.multi_receiver.known_geometry import Fit, Reach
from skyproof.detectors.multi_receiver.policy import POLICY
from skyproof.statistics.distributions import chi_square_survival, chi_square_threshold

__all__ = ["CarrierTest", "Fractions", "estimate_fractions", "evaluate_one_antenna_carriers", "sky_carriers"]

_MOST_WAYS: Final = 400_000
"""To choose three whole cycles."""
_NEVER: Final = 1e-15  # p-value of ways that are not followed
_UNKNOWN: Final = 1e6  # variance of what is not known yet, m^2 and cycles^2


class CarrierTest(NamedTuple):
    """Chi-square of `dof` degrees at most, if the hypothesis is true, and its tail.

    by_chance : expected number of ways to choose whole cycles that fit any fractions; with several, a large p-value is
    no evidence. p_unrelated : probability that fractions which have nothing to do with each other fit as well.
    """

    statistic: float
    dof: int
    by_chance: float = 0.0
    p_unrelated: float = 1.0

    def fits(self, probability: float) -> bool:
        """Tell if the p-value reaches `probability`, and would not by chance."""
        return self.p_value >= probability and self.by_chance < POLICY.cycles_by_chance

    @property
    def p_value(self) -> float:
        return float(chi_square_survival(self.statistic, self.dof))

    def threshold(self, false_alarm_probability: float) -> float:
        """Return the value that the statistic has to exceed."""
        return float(chi_square_threshold(false_alarm_probability, self.dof))


@dataclass(frozen=True, eq=False, kw_only=True)
class Fractions:
    """Of K transmissions of one kind, the second receiver's carrier minus the first one's.

    rows : (K,) which of the transmissions that were given. cycles : (K,) fraction of a cycle of `wave_m`, up to a
    constant for all; of half a wavelength where half cycles are open. sigma_cyc : (K,).
    """

    rows: Indices
    cycles: Reals
    sigma_cyc: Reals
    wave_m: float


def estimate_fractions(phases: CommonPhases, other: int, multipath_sigma_m: float) -> Fractions | None:
    """Estimate fractions of receiver `other` against the first one; None with fewer than five steady satellites.

    multipath_sigma_m : error of a carrier that stays over the window, one sigma.
    """
    if not phases.whole_cycles.all():
        return None
    cyc = phases.cyc[..., other] - phases.cyc[..., 0]
    known = np.isfinite(cyc)
    folded = 2.0 if phases.half_open[known][:, [0, other]].any() else 1.0
    cycles, steady = _average_fractions(folded * cyc)
    rows = np.flatnonzero(steady)
    if rows.size < POLICY.carrier_satellites:
        return None
    wave_m = float(phases.wave_m[0]) / folded
    each_cyc2 = np.where(known, np.sum((folded * phases.sigma_cyc[..., [0, other]]) ** 2, axis=-1), 0.0)
    thermal_cyc2 = (each_cyc2.sum(axis=0) / np.maximum(known.sum(axis=0), 1) ** 2)[rows]
    sigma_cyc = np.sqrt(2.0 * (multipath_sigma_m / wave_m) ** 2 + thermal_cyc2)
    return Fractions(rows=rows, cycles=cycles[rows], sigma_cyc=sigma_cyc, wave_m=wave_m)


def _average_fractions(cyc: Reals) -> tuple[Reals, Booleans]:
    """Average fractions of differences (N, K) against one satellite: (K,), and which of them are steady.

    The reference is the satellite that most are steady with.
    """
    known = np.isfinite(cyc)
    phasor: Complexes = np.where(known, np.exp(2j * np.pi * np.where(known, cyc, 0.0)), 0.0)
    together = known.T.astype(float) @ known
    mean = (phasor.conj().T @ phasor) / np.maximum(together, 1.0)
    steady = (np.abs(mean) >= POLICY.steady_phasor_length) & (together >= 0.5 * len(cyc))
    reference = int(np.argmax(steady.sum(axis=1)))
    return np.asarray(np.angle(mean[reference]) / (2.0 * np.pi)), steady[reference]


def evaluate_one_antenna_carriers(fractions_of_kind: Fractions) -> CarrierTest:
    """Test "all from one antenna": the fractions are the same.

    By chance any fractions pass, with the share of whole cycles that an ellipsoid of the test's limit covers; with that
    of the statistic they are as equal as these.
    """
    weight = fractions_of_kind.sigma_cyc**-2
    off = _wrap(fractions_of_kind.cycles - fractions_of_kind.cycles[:, None])
    off -= (off @ weight / weight.sum())[:, None]
    test = CarrierTest(float(np.min(off**2 @ weight)), fractions_of_kind.cycles.size - 1)
    log_sigmas = float(np.sum(np.log(fractions_of_kind.sigma_cyc))) + 0.5 * np.log(weight.sum())
    limit = test.threshold(POLICY.carrier_fit_probability)
    by_chance, p_unrelated = (
        float(np.exp(min(log_sigmas + _log_ball(test.dof, squared), 0.0))) for squared in (limit, test.statistic)
    )
    return test._replace(by_chance=by_chance, p_unrelated=p_unrelated)


def sky_carriers(
    kinds: Sequence[Fractions], unit_enu: Sequence[Reals], geometry: Fit, receivers: Sequence[str]
) -> CarrierTest | None:
    """Test "the sky over two antennas that stand as known"; None if that leaves too much to search.

    kinds : of one kind of signal or several. unit_enu : (K, 3) directions of the satellites of each. receivers : the
    two.
    """
    rows = _Rows(kinds, unit_enu)
    reach = geometry.reach(receivers)
    ways = None if reach is None else rows.list_base_cycles(reach)
    if reach is None or ways is None:
        return None
    dof = rows.cycles.size - rows.design.shape[1]
    gate = float(chi_square_threshold(_NEVER, dof + 3))
    state, squares = np.zeros((len(ways), rows.design.shape[1])), np.zeros(len(ways))
    covariance, log_sigmas = _UNKNOWN * np.eye(rows.design.shape[1]), 0.0
    for row, whole in zip(rows.base, ways.T, strict=True):
        off = rows.cycles[row] - whole - state @ rows.design[row]
        gain, covariance, _ = rows.add(row, covariance)
        state = state + off[:, None] * gain
    remaining = [row for row in range(rows.cycles.size) if row not in rows.base]
    while remaining:
        row = rows.next(remaining, covariance)
        remaining.remove(row)
        off = rows.cycles[row] - state @ rows.design[row]
        off -= np.rint(off)
        gain, covariance, variance = rows.add(row, covariance)
        state = state + off[:, None] * gain
        if row not in rows.firsts:  # which give their kind's constant, and fit anything
            squares = squares + off**2 / variance
            log_sigmas += 0.5 * np.log(variance)
            state, squares = state[squares < gate], squares[squares < gate]
    misfit = geometry.misfit(receivers, state[:, :3], covariance[:3, :3])
    test = CarrierTest(float(np.min(squares + misfit.squared, initial=gate)), dof + misfit.dof)
    density = abs(float(np.linalg.det(rows.three)))  # of ways, per m^3
    log_chance = (
        np.log(density * reach.volume_m3) + log_sigmas + _log_ball(dof, test.threshold(POLICY.carrier_fit_probability))
    )
    return test._replace(by_chance=float(np.exp(min(log_chance, 100.0))))


class _Rows:
    """Fractions of several kinds as rows of one least-squares problem: of a baseline, and a constant for each kind.

    cycles, sigma_cyc (n,); design (n, 3 + kinds). firsts : the first row of each kind. base : four rows of one kind;
    the last three, less the first, measure a baseline by `three` (3, 3).
    """

    def __init__(self, kinds: Sequence[Fractions], unit_enu: Sequence[Reals]) -> None:
        number = np.repeat(np.arange(len(kinds)), [one_kind.cycles.size for one_kind in kinds])
        along = np.concatenate([-unit / one_kind.wave_m for one_kind, unit in zip(kinds, unit_enu, strict=True)])
        self.cycles = np.concatenate([one_kind.cycles for one_kind in kinds])
        self.sigma_cyc = np.concatenate([one_kind.sigma_cyc for one_kind in kinds])
        self.design = np.column_stack([along, number[:, None] == np.arange(len(kinds))]).astype(float)
        self.firsts = [int(np.flatnonzero(number == kind)[0]) for kind in range(len(kinds))]
        first, *other_rows = np.flatnonzero(number == np.argmax(np.bincount(number)))
        chosen = _select_independent(along[other_rows] - along[first])
        self.base = [int(first), *(int(other_rows[k]) for k in chosen)]
        self.three = along[self.base[1:]] - along[first]

    def list_base_cycles(self, reach: Reach) -> Reals | None:
        """List whole cycles (C, 4) of the base's rows that put the antennas within reach; None if too many do."""
        if np.linalg.cond(self.three) > 100.0:
            return None
        back = np.linalg.inv(self.three)
        slack_m = POLICY.cycle_reach_sigmas * float(np.linalg.norm(back) * np.max(self.sigma_cyc) * np.sqrt(2.0))
        x = self.cycles[self.base[1:]] - self.cycles[self.base[0]]
        half = (reach.outer_m + slack_m) * np.linalg.norm(self.three, axis=1)
        middle = x - self.three @ reach.centre_m
        low, high = np.ceil(middle - half), np.floor(middle + half)
        if np.prod(high - low + 1.0) > _MOST_WAYS:
            return None
        ranges = (np.arange(a, b + 1.0) for a, b in zip(low, high, strict=True))
        whole = np.stack(np.meshgrid(*ranges, indexing="ij"), axis=-1).reshape(-1, 3)
        away_m = np.linalg.norm((x - whole) @ back.T - reach.centre_m, axis=1)
        inside = (away_m <= reach.outer_m + slack_m) & (away_m >= reach.inner_m - slack_m)
        return np.column_stack([np.zeros(np.sum(inside)), whole[inside]])

    def add(self, row: int, covariance: Reals) -> tuple[Reals, Reals, float]:
        """Return gain (p,) and covariance (p, p) with this row, and the variance of its prediction."""
        along = covariance @ self.design[row]
        variance = float(self.design[row] @ along) + float(self.sigma_cyc[row]) ** 2
        gain = along / variance
        return gain, covariance - np.outer(gain, along), variance

    def next(self, left: Sequence[int], covariance: Reals) -> int:
        """Return the row whose cycles are known best."""
        design = self.design[left]
        return left[int(np.argmin(np.einsum("ij,jk,ik->i", design, covariance, design) + self.sigma_cyc[left] ** 2))]


def _log_ball(dimensions: int, squared_radius: float) -> float:
    """Return the logarithm of a ball's volume."""
    half = 0.5 * dimensions
    return float(half * np.log(np.pi * squared_radius) - special.gammaln(half + 1.0))


def _select_independent(rows: Reals) -> list[int]:
    """Select three rows (K, 3) far from linear dependence: each is the longest beside those before it."""
    remainder, chosen = rows.copy(), list[int]()
    for _ in range(3):
        chosen.append(int(np.argmax(np.sum(remainder**2, axis=1))))
        along = remainder[chosen[-1]] / np.linalg.norm(remainder[chosen[-1]])
        remainder = remainder - np.outer(remainder @ along, along)
    return chosen


def _wrap(cycles: Reals) -> Reals:
    return np.asarray(cycles - np.rint(cycles))
