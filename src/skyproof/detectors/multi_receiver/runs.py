"""Take windows in a row together: for antennas too near, or a geometry too weak, for one window to decide.

A *run* is what up to `longest_run_windows` windows measured of the same transmissions in the same receivers. In a
longer time the thermal noise averages out and, above all, shows how correlated it is. The constant error of a track
does not average out: past a minute or two a run learns nothing more, so it is bounded.

A run as a whole may be of the sky though its end is not. So a window is decided by all ways in which its signals can
have come from one antenna: from some instant to some later one, around the window, while they came from the sky before
and after (`window_p_values`). Where nothing of the run is left outside, the mean shows it, as in a single window
(`pairing.Pairing.one_antenna`). Otherwise the step at its ends shows it as well: it is the known baseline, and the
constant errors cancel in it. That one antenna sent the window is rejected if each of these ways is, so how many there
are costs nothing (R. L. Berger, Technometrics 24, 1982, doi 10.2307/1267823); how often a window is looked at does,
`longest_run_windows` times at most. That the sky sent it is tested in the same way, with the parts exchanged.

Instants are resolved to half a window. The halves in which a stretch begins and ends take no part, as what they hold
is mixed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from skyproof.arrays import Indices, Reals
from skyproof.detectors.multi_receiver.common_epochs import CommonRanges
from skyproof.detectors.multi_receiver.known_geometry import AntennaGeometry
from skyproof.detectors.multi_receiver.one_antenna import baseline_design
from skyproof.detectors.multi_receiver.pairing import Pairing
from skyproof.detectors.multi_receiver.policy import POLICY
from skyproof.gnss.time import seconds_between
from skyproof.records import BY_NAME, SignalId
from skyproof.statistics.autoregression import ar1_whiten, correlation_grid
from skyproof.statistics.distributions import f_survival

__all__ = ["WindowRun", "prolong", "window_p_values"]

_OUT, _IN, _BEGINS, _ENDS = range(4)


@dataclass(frozen=True, eq=False)
class _Part:
    """What one window measured. open : nothing was said of it yet."""

    ranges: CommonRanges
    start_gpst: np.datetime64
    end_gpst: np.datetime64
    open: bool


@dataclass(frozen=True, eq=False)
class WindowRun:
    """Windows that follow each other, oldest first, of one pairing of the receivers' signals."""

    receivers: tuple[str, ...]
    parts: tuple[_Part, ...]

    @cached_property
    def tracks(self) -> tuple[tuple[SignalId, ...], ...]:
        """Return the transmissions (R, K) that all windows have, by receiver."""
        shared = frozenset.intersection(*(part.ranges.transmissions for part in self.parts))
        return tuple(zip(*sorted(shared, key=lambda tracks: [BY_NAME(signal) for signal in tracks]), strict=True))

    @property
    def length_s(self) -> float:
        """Return the time from the first window's start to the last one's end."""
        return float(seconds_between(self.parts[-1].end_gpst, self.parts[0].start_gpst))

    def close_decided(self, which: Sequence[bool]) -> "WindowRun":
        """Return the same run with these of its windows decided."""
        pairs = zip(self.parts, which, strict=True)
        return replace(self, parts=tuple(replace(part, open=part.open and not done) for part, done in pairs))

    def join(self, pairing: Pairing) -> tuple[Pairing, Indices]:
        """Join its windows into one, of the kind of `pairing`, the last; also number each instant's half window."""
        tracks = self.tracks
        cells, times_s, ranges_m, sigmas_m = [], [], [], []
        for number, part in enumerate(self.parts):
            places = {row: k for k, row in enumerate(zip(*part.ranges.tracks, strict=True))}
            part_ranges = part.ranges.take(np.array([places[row] for row in zip(*tracks, strict=True)], np.intp))
            half_s = 0.5 * float(seconds_between(part.end_gpst, part.start_gpst))
            cells.append(2 * number + (part_ranges.time_s >= half_s))
            times_s.append(part_ranges.time_s + float(seconds_between(part.start_gpst, self.parts[0].start_gpst)))
            ranges_m.append(part_ranges.range_m)
            sigmas_m.append(part_ranges.range_sigma_m)
        ranges = CommonRanges(
            tracks=tracks,
            range_m=np.concatenate(ranges_m),
            range_sigma_m=np.concatenate(sigmas_m),
            time_s=np.concatenate(times_s),
            step_s=self.parts[-1].ranges.step_s,
        )
        return replace(pairing, ranges=ranges, start_gpst=self.parts[0].start_gpst), np.concatenate(cells)


def prolong(runs: Sequence[WindowRun], pairing: Pairing, *, still_open: bool, least: int) -> WindowRun:
    """Add this pairing to its run, or begin a new one.

    A window must follow the run's last, with `least` transmissions in common.
    """
    stride = -(-len(pairing.ranges.range_m) // POLICY.kept_instants)
    ranges = pairing.ranges.at(np.arange(0, len(pairing.ranges.range_m), stride))
    part = _Part(replace(ranges, step_s=stride * ranges.step_s), pairing.start_gpst, pairing.end_gpst, open=still_open)
    rows = ranges.transmissions
    going_on = [
        run
        for run in runs
        if run.receivers == pairing.receivers
        and run.parts[-1].end_gpst == pairing.start_gpst
        and len(rows & run.parts[-1].ranges.transmissions) >= least
    ]
    before = max(going_on, key=lambda run: len(rows & run.parts[-1].ranges.transmissions), default=None)
    parts = (*before.parts[1 - POLICY.longest_run_windows :], part) if before is not None else (part,)
    run = WindowRun(pairing.receivers, parts)
    while len(run.parts) > 1 and (not (tracks := run.tracks) or len(tracks[0]) < least):
        run = replace(run, parts=run.parts[1:])
    return run


def window_p_values(
    joined: Pairing, cells: Indices, geometry: AntennaGeometry, sender: Literal["one antenna", "the sky"], limit: float
) -> Reals:
    """Return the p-values (W,) of "`sender` sent this window's signals", over antennas that stand as known.

    There is one for each window of a run.

    cells : of each instant, the number of its half window, as of `WindowRun.join`. limit : larger ones are not
    needed; if the run as a whole exceeds it, so does each window. Without orbits all are 1.
    """
    n_windows = int(cells.max()) // 2 + 1
    names, cell = np.unique(cells, return_inverse=True)
    n = names.size
    if joined.unit_enu is None or _p_value_of_part(joined, cell, 0, n - 1, geometry, sender) > limit:
        return np.ones(n_windows)
    stretches = [(first, last) for first in range(n) for last in range(first, n)]
    inner = [(first, last) for first, last in stretches if first > 1 or last < n - 2]
    by_stretch = (
        dict(zip(inner, _p_values_of_stretches(joined, cell, inner, geometry, sender), strict=True)) if inner else {}
    )
    p_values = [
        by_stretch[s] if s in by_stretch else _p_value_of_part(joined, cell, *s, geometry, sender) for s in stretches
    ]
    found = np.ones(n_windows)
    for window in np.unique(names // 2):
        first, last = np.flatnonzero(names // 2 == window)[[0, -1]]
        found[window] = max(p for p, (a, b) in zip(p_values, stretches, strict=True) if a <= first and b >= last)
    return found


def _p_value_of_part(
    joined: Pairing, cell: Indices, first: int, last: int, geometry: AntennaGeometry, sender: str
) -> float:
    """Return the p-value of the instants in the cells first to last, whatever the others are."""
    part = replace(joined, ranges=joined.ranges.at((cell >= first) & (cell <= last)))
    return part.survival(geometry) if sender == "the sky" else part.one_antenna_each_p_value


def _p_values_of_stretches(
    joined: Pairing, cell: Indices, stretches: Sequence[tuple[int, int]], geometry: AntennaGeometry, sender: str
) -> Reals:
    """Return p-values (S,) of `sender` within each stretch of cells, and the other sender outside.

    The measured baselines within and outside share the constant errors. From one antenna the first is zero but for
    errors; given those, the second must be one that the known geometry allows.
    """
    assert joined.unit_enu is not None
    phi = correlation_grid(joined.noise.correlation_max)[joined.plausible]
    fit = _Cells(joined.contrasts.values, cell, phi, joined.ranges.gaps)
    levels = [fit.levels(first, last) for first, last in stretches]
    dof = np.array([level.dof for level in levels])[:, None]
    constant_m2 = joined.noise.multipath_sigma_m**2 * joined.contrasts.gain
    design = baseline_design(joined.contrasts.matrix, joined.unit_enu)
    means, noise = np.stack([level.mean for level in levels]), np.stack([level.variance for level in levels])
    weighted = design / (noise[..., 0, 0, None] + constant_m2)[..., None]
    solve = np.linalg.solve(np.swapaxes(weighted, -1, -2) @ design, np.swapaxes(weighted, -1, -2))  # (S, G, q, M)
    baseline_m = means @ np.swapaxes(solve, -1, -2)  # (S, G, 2, q)
    of_noise, of_constant = solve @ np.swapaxes(solve, -1, -2), solve * constant_m2 @ np.swapaxes(solve, -1, -2)
    covariance_m2 = noise[..., None, None] * of_noise[..., None, None, :, :] + of_constant[..., None, None, :, :]
    turned = POLICY.satellite_turn_rad_s * float(joined.ranges.time_s[-1] - joined.ranges.time_s[0])

    zero, sky = (0, 1) if sender == "one antenna" else (1, 0)
    between = covariance_m2[..., sky, zero, :, :]
    inverse = np.linalg.inv(covariance_m2[..., zero, zero, :, :])
    carried = between @ inverse
    level = np.einsum("...i,...ij,...j->...", baseline_m[..., zero, :], inverse, baseline_m[..., zero, :])
    shown_m = baseline_m[..., sky, :] - (carried @ baseline_m[..., zero, :, None])[..., 0]
    turned_m2 = (turned * np.linalg.norm(baseline_m[..., sky, :], axis=-1)[..., None, None]) ** 2
    left_m2 = covariance_m2[..., sky, sky, :, :] - carried @ np.swapaxes(between, -1, -2)
    misfit = geometry.misfit(joined.receivers, shown_m, left_m2 + turned_m2 * np.eye(left_m2.shape[-1]))
    degrees = baseline_m.shape[-1] + misfit.dof
    p_value = f_survival((level + misfit.squared) / degrees, degrees, dof)
    return np.asarray(np.minimum(np.max(p_value, axis=-1) + joined.noise.miss_probability, 1.0))


class _Levels(NamedTuple):
    """mean (G, 2, M) of the contrasts within a stretch and without it; variance (G, 2, 2) by noise, of any; dof."""

    mean: Reals
    variance: Reals
    dof: float


class _Cells:
    """Least squares of one mean contrast for each cell, under AR(1) noise of the coefficients phi (G,): its sums."""

    def __init__(self, values: Reals, cell: Indices, phi: Reals, gaps: Reals) -> None:
        n = int(cell.max()) + 1
        within = ar1_whiten((cell[:, None] == np.arange(n)).astype(float), phi, gaps)
        white = ar1_whiten(values, phi, gaps)
        self.gram = np.swapaxes(within, -1, -2) @ within  # (G, n, n)
        self.moment = np.swapaxes(within, -1, -2) @ white  # (G, n, M)
        self.square = np.sum(white**2, axis=(-1, -2))
        self.n_cells, self.shape = n, values.shape

    def levels(self, first: int, last: int) -> _Levels:
        """Average the cells first to last; those beside them have their own averages."""
        number = np.arange(self.n_cells)
        part = np.full(self.n_cells, _OUT)
        part[(number >= first) & (number <= last)] = _IN
        part[number == first - 1], part[number == last + 1] = _BEGINS, _ENDS
        parts_present = np.unique(part)
        columns = (part[:, None] == parts_present).astype(float)
        inverse = np.linalg.inv(columns.T @ self.gram @ columns)
        moment = columns.T @ self.moment
        means = inverse @ moment
        dof = float((self.shape[0] - parts_present.size) * self.shape[1])
        rss = self.square - np.sum(moment * means, axis=(-1, -2))
        two = np.searchsorted(parts_present, [_IN, _OUT])
        return _Levels(means[:, two], (rss / dof)[:, None, None] * inverse[:, two[:, None], two], dof)
