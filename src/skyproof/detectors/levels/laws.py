"""Statistics of levels against their own past, with their laws under the null: arrays only.

**The common change.** Satellite s of n changes its level by `d_s = c + e_s` against its own past. `e_s` is independent
of other satellites (fading, reflections), with one sigma `fading_db`. `c` is the receiver's common wander (noise
figure, temperature, weak interference that is always there), with one sigma `common_db`. The median estimates c
whatever single satellites do; its variance is `common_db^2 + pi/2 fading_db^2 / n` (asymptotic variance of a median).

**The scale.** How much a receiver's levels wander depends on where it is. A statistic T, normal with one sigma s, is
compared with its own past: s^2 has a scaled inverse chi-square law with `prior_degrees` degrees about 1. After m values
`T / s` is Student's t with `prior_degrees + m` degrees (Gelman et al., Bayesian Data Analysis, 2.6 and 3.2).

**The dip.** Interference may be shorter than a window. A window is cut into `DIP_PARTS` parts. The median of each
signal over a part changes as that over a window does, whatever the parts share. The lowest part is held against the
scale of the receiver's own parts; its chance is that of one part times their number (union bound).

**The losses.** Each signal is lost within a window independently, at a rate with a beta law that its past sharpens. The
number of lost ones is beta-binomial (`OwnRate`; Gelman et al., 3.1 and 5.3).

**The excess.** Readings of C/N0 err by one sigma `reading_sigma_db`, and those of one second alike. The median over t
seconds has the variance `pi/2 reading_sigma_db^2 / t` about a level that is at most what a satellite's can be.

**The pattern.** Levels of satellites differ by their elevation and by what they send. A transmitter that gives all its
signals one power flattens the pattern. The slope of the change over the reference is then -1 (`pattern_slope`).
"""

from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from skyproof.arrays import Indices, Reals
from skyproof.detectors.levels.policy import POLICY

__all__ = [
    "DIP_PARTS",
    "Dip",
    "OwnRate",
    "OwnScale",
    "SharedChange",
    "chance_of_excess",
    "estimate_shared_change",
    "find_dip",
    "mean_by_group",
    "pattern_slope",
    "split_in_two",
]

DIP_PARTS: Final = 5
"""Of a window: two seconds where a window has ten."""


class SharedChange(NamedTuple):
    """Change that all satellites share, and its one sigma under the null, dB; `satellites` that show it."""

    change_db: float
    sigma_db: float
    satellites: int


def estimate_shared_change(change_db: ArrayLike, *, fading_db: float, common_db: float) -> SharedChange:
    """Estimate what the levels of satellites (n,) change by together."""
    values = np.asarray(change_db, np.float64)
    variance_db2 = common_db**2 + 0.5 * np.pi * fading_db**2 / values.size
    return SharedChange(float(np.median(values)), float(np.sqrt(variance_db2)), values.size)


class Dip(NamedTuple):
    """The lowest part of a window: its common change over its sigma and in dB, rows from first to before stop.

    parts : of the window. scatter : root mean square over the parts of what they change by over their sigma.
    """

    statistic: float
    change_db: float
    first: int
    stop: int
    parts: int
    scatter: float


def chance_of_excess(over_db: ArrayLike, seconds: ArrayLike, *, signals: int) -> float:
    """Return the chance that medians of readings over so many seconds exceed the highest true level by so much.

    over_db, seconds : (n,) of those that do, of so many signals (union bound).
    """
    sigma_db = POLICY.reading_sigma_db * np.sqrt(0.5 * np.pi / np.asarray(seconds, np.float64))
    return min(1.0, signals * float(special.ndtr(-np.asarray(over_db, np.float64) / sigma_db).min()))


def find_dip(change_db: Reals, satellite: Indices, *, fading_db: float, common_db: float) -> Dip:
    """Find where all signals are weakest together: changes (n_epochs, n_signals), the satellite (n_signals,) of each.

    The rows are those about the lowest part in which the median of the signals is less than half of its change.
    """
    n = change_db.shape[0]
    edges = np.linspace(0, n, min(DIP_PARTS, n) + 1).round().astype(np.intp)
    by_part = [np.median(change_db[a:b], axis=0) for a, b in pairwise(edges.tolist())]
    found = [
        estimate_shared_change(mean_by_group(satellite, part), fading_db=fading_db, common_db=common_db)
        for part in by_part
    ]
    statistics = np.array([shared.change_db / shared.sigma_db for shared in found])
    k = int(statistics.argmin())
    lowest_db = found[k].change_db
    low = np.median(change_db, axis=1) <= 0.5 * lowest_db if lowest_db < 0.0 else np.zeros(n, np.bool_)
    low[edges[k] : edges[k + 1]] |= not low[edges[k] : edges[k + 1]].any()
    inside = edges[k] + int(np.argmax(low[edges[k] : edges[k + 1]]))
    before, after = np.flatnonzero(~low[:inside]), np.flatnonzero(~low[inside:])
    return Dip(
        statistic=float(statistics[k]),
        change_db=lowest_db,
        first=int(before[-1]) + 1 if before.size else 0,
        stop=inside + int(after[0]) if after.size else n,
        parts=len(found),
        scatter=float(np.sqrt(np.mean(statistics**2))),
    )


def mean_by_group(group: Indices, values: Reals) -> Reals:
    """Return the mean of the values (n,) of each group (n,), in the order of the groups' numbers."""
    _, index = np.unique(group, return_inverse=True)
    return np.asarray(np.bincount(index, values) / np.bincount(index))


class OwnScale(NamedTuple):
    """The scale of a statistic by its own past: sum of squares of so many earlier values."""

    squares: float = 0.0
    seen: float = 0.0

    @property
    def degrees(self) -> float:
        """Return the degrees of freedom of the law of the next value."""
        return POLICY.prior_degrees + self.seen

    @property
    def sigma(self) -> float:
        """Return one sigma of the next value."""
        return float(np.sqrt((POLICY.prior_degrees + self.squares) / self.degrees))

    def above(self, statistic: float) -> float:
        """Return the chance of a value at least as large; uniform under the null."""
        return float(special.stdtr(self.degrees, -statistic / self.sigma))

    def below(self, statistic: float) -> float:
        """Return the chance of a value at most as large; uniform under the null."""
        return self.above(-statistic)

    def after(self, statistic: float) -> "OwnScale":
        """Return the scale that has seen one more value."""
        keep = min(1.0, (POLICY.most_degrees - 1.0) / max(self.seen, 1.0))
        return OwnScale(keep * self.squares + statistic**2, keep * self.seen + 1.0)


class OwnRate(NamedTuple):
    """The rate at which signals are lost within a window by its own past: how many were lost, and how many stayed."""

    lost: float = 0.0
    stayed: float = 0.0

    def above(self, lost: int, signals: int) -> float:
        """Return the chance that so many of the signals are lost or more, each independently at the rate."""
        first, second = POLICY.prior_lost + self.lost, POLICY.prior_stayed + self.stayed
        counts = np.arange(lost, signals + 1)
        log_chance = (
            special.gammaln(signals + 1)
            - special.gammaln(counts + 1)
            - special.gammaln(signals - counts + 1)
            + special.betaln(first + counts, second + signals - counts)
            - special.betaln(first, second)
        )
        return min(1.0, float(np.exp(log_chance).sum()))

    def after(self, lost: int, signals: int) -> "OwnRate":
        """Return the rate that has seen one more window."""
        keep = 1.0 - 1.0 / POLICY.most_degrees
        return OwnRate(keep * self.lost + lost, keep * self.stayed + signals - lost)


def pattern_slope(
    reference_db: ArrayLike, change_db: ArrayLike, *, fading_db: float, windows: ArrayLike
) -> tuple[float, float] | None:
    """Estimate the slope of changes over reference levels (n,), and its one sigma; 0 under the null, -1 of equal power.

    windows : (n,) how many windows each reference is the mean of: its noise is in both, and is taken off. None where
        the levels hardly differ, so that no slope shows.
    """
    reference, change = np.asarray(reference_db, np.float64), np.asarray(change_db, np.float64)
    centred = reference - reference.mean()
    spread_db2 = float(centred @ centred)
    noise_db2 = float(np.sum(fading_db**2 / np.asarray(windows, np.float64))) * (1.0 - 1.0 / reference.size)
    if spread_db2 <= 2.0 * noise_db2:
        return None
    slope = (float(centred @ (change - change.mean())) + noise_db2) / spread_db2
    noise = np.mean(1.0 / np.asarray(windows, np.float64))
    return slope, fading_db * float(np.sqrt((1.0 + noise) / spread_db2))


def split_in_two(values: Reals) -> int:
    """Find the row at which a series (n,) steps to its other level, by least squares; NaN is left out."""
    known = np.flatnonzero(np.isfinite(values))
    n = known.size
    if n < 2:
        return int(known[0]) if n else 0
    sums = np.cumsum(values[known])
    first = np.arange(1, n)
    means = sums[-1] / n
    gain = (sums[:-1] - first * means) ** 2 / (first * (n - first))
    return int(known[1 + np.argmax(gain)])
