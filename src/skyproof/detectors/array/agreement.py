"""Find the signals that agree with one attitude of an array and one set of line delays, and the attitude if unknown.

All signals share the errors of attitude, line delays and antenna positions. These are normal with a stated covariance,
which is wide where they are unknown. The search leaves out the least likely signal, one after another. It takes a
signal back if the others, once they have shown the shared errors, predict it. Where attitude or lines are unknown, the
search begins with candidates. Each signal alone gives a candidate for the lines. Candidates for the attitude are the
points of a grid of rotations where the phases of most signals add up, whatever the rest does. This is an ambiguity
function: Counselman and Gourevitch, IEEE Transactions on Geoscience and Remote Sensing 19(4), 1981.

Units and shapes are those of `array_model`: n signals, M antennas, d = M - 1 differences.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from skyproof.arrays import Indices, Reals
from skyproof.detectors.array.array_model import (
    array_design,
    diagonal_blocks,
    residual_covariance,
    sky_p_value,
    white_covariance,
)
from skyproof.detectors.array.policy import POLICY
from skyproof.statistics.directions import hemisphere, mahalanobis_squared, subtract_nearest_whole
from skyproof.statistics.distributions import chi_square_survival, chi_square_threshold

__all__ = [
    "Agreement",
    "ArrayFrame",
    "MeanPhases",
    "find_agreement",
    "find_best_agreement",
    "fit_frame",
    "predict_from_members",
    "propose_frames",
    "residuals",
]

_CELL_RAD: Final = 0.12  # of the grid of rotations, times wavelengths of the longest baseline
_MOST_ROTATIONS: Final = 400_000
_CANDIDATES: Final = 16


@dataclass(frozen=True, eq=False, kw_only=True)
class MeanPhases:
    """One window's phases beside what a first attitude predicts.

    cycles : (n, d) measured minus predicted differences, any whole cycles in them. direction : (n, 3) predicted;
    the other predictions follow from it. sigma_cyc : (n, M). elements_cyc : (M, 3). ratio : (n,) of carriers.
    position_sigma_cyc : of each antenna along each axis. scale_sigma : of the length of all baselines together, as a
        share of it. pattern_sigma_cyc : of each antenna's phase, by its pattern: another one for each direction.
    """

    cycles: Reals
    direction: Reals
    sigma_cyc: Reals
    elements_cyc: Reals
    ratio: Reals
    position_sigma_cyc: float
    scale_sigma: float = 0.0
    pattern_sigma_cyc: float = 0.0

    def part(self, rows: Indices) -> "MeanPhases":
        """Return these phases for some of the signals only."""
        columns = {name: getattr(self, name)[rows] for name in ("cycles", "direction", "sigma_cyc", "ratio")}
        return replace(self, **columns)

    @property
    def raw_cyc(self) -> Reals:
        """Return the differences as they were measured (n, d), any whole cycles in them."""
        return np.asarray(self.cycles + self.ratio[:, None] * (self.direction @ array_design(self.elements_cyc).T))


@dataclass(frozen=True, eq=False, kw_only=True)
class ArrayFrame:
    """State what is known of attitude and line delays.

    turn : (3, 3) directions are `turn @ predicted`. bias_cyc : (d,). attitude_covariance_rad2 : (3, 3) of the remaining
    error.
    bias_sigma_cyc : of each antenna. freed : how many numbers were fitted to the signals.
    """

    turn: Reals
    bias_cyc: Reals
    attitude_covariance_rad2: Reals
    bias_sigma_cyc: float
    freed: int = 0

    def widen(self, *, attitude: bool, bias: bool) -> "ArrayFrame":
        """Return the frame with attitude or lines unknown."""
        covariance = self.attitude_covariance_rad2
        if attitude and not self.attitude_free:
            covariance = POLICY.free_attitude_sigma_rad**2 * np.eye(3)
        axes = int(np.sum(np.diag(covariance) >= POLICY.free_attitude_sigma_rad**2))
        return replace(
            self,
            attitude_covariance_rad2=covariance,
            bias_sigma_cyc=POLICY.free_line_sigma_cyc if bias else self.bias_sigma_cyc,
            freed=axes + self.bias_cyc.size * bias,
        )

    @property
    def attitude_free(self) -> bool:
        """Tell if the attitude, or the heading alone, is unknown."""
        return bool(self.attitude_covariance_rad2[2, 2] >= POLICY.free_attitude_sigma_rad**2)

    @property
    def attitude_sigma_rad(self) -> float:
        """Return the remaining error of the attitude, about the axis where it is largest."""
        return float(np.sqrt(np.linalg.eigvalsh(self.attitude_covariance_rad2).max()))

    @property
    def level(self) -> bool:
        """Tell if the vertical is known."""
        return bool(self.attitude_covariance_rad2[0, 0] < POLICY.free_attitude_sigma_rad**2)

    @property
    def bias_free(self) -> bool:
        """Tell if the line delays are unknown."""
        return self.bias_sigma_cyc >= POLICY.free_line_sigma_cyc


@dataclass(frozen=True, eq=False, kw_only=True)
class Agreement:
    """The signals that agree, in a frame that they were fitted to.

    members : rows. residual_cyc : (members, d) about the frame, without whole cycles. p_value : that all signals agree;
    p_values : (n,) of each given the (other) members. cost : the members' joint statistic, and for each other signal
    what it may have at most. doubtful : rows that would raise no alarm, or that other frames as good would have in or
    out. lone : no other frame is as good.
    """

    frame: ArrayFrame
    members: Indices
    residual_cyc: Reals
    p_value: float
    p_values: Reals
    cost: float
    doubtful: Indices = field(default_factory=lambda: np.zeros(0, np.intp))
    lone: bool = True


def residuals(measured: MeanPhases, frame: ArrayFrame) -> Reals:
    """Compute measured minus predicted differences (n, d) in a frame, any whole cycles in them."""
    moved = measured.direction @ (frame.turn - np.eye(3)).T
    return measured.cycles - measured.ratio[:, None] * (moved @ array_design(measured.elements_cyc).T) - frame.bias_cyc


def compute_covariance(measured: MeanPhases, frame: ArrayFrame) -> Reals:
    """Compute the covariance (n d, n d) of `residuals`."""
    return residual_covariance(
        measured.elements_cyc,
        measured.direction @ frame.turn.T,
        sigma_cyc=np.hypot(measured.sigma_cyc, measured.pattern_sigma_cyc * measured.ratio[:, None]),
        position_sigma_cyc=measured.position_sigma_cyc,
        attitude_covariance_rad2=frame.attitude_covariance_rad2,
        bias_sigma_cyc=frame.bias_sigma_cyc,
        scale_sigma=measured.scale_sigma,
        frequency_ratio=measured.ratio,
    )


def predict_from_members(
    residual_cyc: Reals, covariance: Reals, members: Indices, others: Indices
) -> tuple[Reals, Reals]:
    """Predict other rows from the members: mean (o, d) and covariance (o, d, d) of each.

    residual_cyc : (members, d). covariance : (n d, n d) of all rows.
    """
    d = residual_cyc.shape[1]
    inside, outside = _rows(members, d), _rows(others, d)
    cross = covariance[np.ix_(outside, inside)]
    gain = np.linalg.solve(covariance[np.ix_(inside, inside)], cross.T).T if members.size else cross
    remaining = diagonal_blocks(covariance[np.ix_(outside, outside)] - gain @ cross.T, others.size, d)
    return np.asarray((gain @ residual_cyc.ravel()).reshape(-1, d)), remaining


def find_agreement(measured: MeanPhases, frame: ArrayFrame, false_alarm_probability: float) -> Agreement:
    """Find the signals that agree with a frame whose remaining errors are small against half a cycle.

    If not all agree, the limit for each is one that true signals rarely exceed, however rare alarms are to be. A signal
    beyond that limit that would raise no alarm is doubtful.
    """
    n, d = measured.cycles.shape
    covariance = compute_covariance(measured, frame)
    tight = compute_covariance(measured, _limit_errors(frame))
    residual, least = subtract_nearest_whole(residuals(measured, frame), diagonal_blocks(tight, n, d))
    p_value = float(sky_p_value(residual, covariance, wrapped=False))
    missed = max(false_alarm_probability, POLICY.fitted_missed_probability)
    if p_value >= false_alarm_probability:
        agreed = _build_agreement(
            frame, residual, covariance, np.arange(n), p_value, np.ones(n), false_alarm_probability
        )
        return replace(agreed, doubtful=np.flatnonzero(agreed.p_values < missed / n))
    # Few are enough to show what all share; who stands far off alone must not.
    members = np.flatnonzero(chi_square_survival(least, d) >= missed / n)
    members = _remove_strangers(residual, covariance, members, missed)
    p_values = np.ones(n)
    while True:
        outside = np.setdiff1d(np.arange(n), members)
        if not outside.size:
            break
        mean, remaining = predict_from_members(residual[members], covariance, members, outside)
        off, statistic = subtract_nearest_whole(residual[outside] - mean, remaining)
        p_values[outside] = chi_square_survival(statistic, d)
        best = int(p_values[outside].argmax())
        if not members.size or p_values[outside[best]] < missed / n:
            break
        residual[outside[best]] = off[best] + mean[best]
        more = np.sort(np.append(members, outside[best]))
        kept = _remove_strangers(residual, covariance, more, missed)
        if kept.size <= members.size:
            break
        members = kept
    agreed = _build_agreement(frame, residual, covariance, members, p_value, p_values, missed)
    near = np.setdiff1d(np.flatnonzero(p_values >= false_alarm_probability / n), members)
    return replace(agreed, doubtful=near)


def propose_frames(measured: MeanPhases, frame: ArrayFrame) -> Iterator[ArrayFrame]:
    """Yield the frame if attitude and lines are known, else candidates fitted to most signals."""
    if frame.attitude_free:
        for turn, bias_cyc in _rotations(measured, frame):
            yield fit_frame(measured, replace(frame, turn=turn, bias_cyc=bias_cyc))
    elif frame.bias_free:
        for bias_cyc in residuals(measured, frame):
            yield fit_frame(measured, replace(frame, bias_cyc=frame.bias_cyc + bias_cyc))
    else:
        yield frame


def find_best_agreement(measured: MeanPhases, frame: ArrayFrame, false_alarm_probability: float) -> Agreement:
    """Find the agreement that costs least among all candidates, and the signals that others as good judge otherwise."""
    found = [
        find_agreement(measured, candidate, false_alarm_probability) for candidate in propose_frames(measured, frame)
    ]
    best = min(found, key=lambda candidate: candidate.cost)
    doubtful, lone = best.doubtful, True
    for other in found:
        if other.cost - best.cost < POLICY.as_good_cost:
            doubtful = np.union1d(doubtful, np.setxor1d(best.members, other.members))
            turned = 0.5 * (np.trace(best.frame.turn.T @ other.frame.turn) - 1.0)
            lone &= bool(turned > np.cos(POLICY.alike_rad))
    return replace(best, doubtful=doubtful, lone=lone)


def _build_agreement(
    frame: ArrayFrame,
    residual: Reals,
    covariance: Reals,
    members: Indices,
    p_value: float,
    p_values: Reals,
    false_alarm_probability: float,
) -> Agreement:
    """Build the agreement, with the members' p-values and the cost."""
    n, d = residual.shape
    rows = _rows(members, d)
    member_covariance = covariance[np.ix_(rows, rows)]
    p_values = p_values.copy()
    p_values[members] = chi_square_survival(_conditional(residual[members], member_covariance), d)
    most = float(chi_square_threshold(false_alarm_probability / n, d))
    cost = float(mahalanobis_squared(residual[members].ravel(), member_covariance)) if members.size else 0.0
    return Agreement(
        frame=frame,
        members=members,
        residual_cyc=residual[members],
        p_value=p_value,
        p_values=p_values,
        cost=cost + most * (n - members.size),
    )


def _remove_strangers(residual: Reals, covariance: Reals, members: Indices, false_alarm_probability: float) -> Indices:
    """Remove the least likely members until the rest passes."""
    d = residual.shape[1]
    while members.size:
        rows = _rows(members, d)
        member_covariance = covariance[np.ix_(rows, rows)]
        if float(sky_p_value(residual[members], member_covariance, wrapped=False)) >= false_alarm_probability:
            break
        members = np.delete(members, int(_conditional(residual[members], member_covariance).argmax()))
    return members


def _conditional(residual: Reals, covariance: Reals) -> Reals:
    n, d = residual.shape
    information = np.linalg.inv(covariance)
    weighted = (information @ residual.ravel()).reshape(n, d)
    return mahalanobis_squared(weighted, diagonal_blocks(information, n, d))


def _limit_errors(frame: ArrayFrame) -> ArrayFrame:
    """Return the frame for choosing whole cycles: about a frame that fits, errors are small."""
    return replace(
        frame,
        attitude_covariance_rad2=np.radians(3.0) ** 2 * np.eye(3)
        if frame.attitude_free
        else frame.attitude_covariance_rad2,
        bias_sigma_cyc=0.03 if frame.bias_free else frame.bias_sigma_cyc,
    )


def fit_frame(measured: MeanPhases, frame: ArrayFrame) -> ArrayFrame:
    """Move a frame with unknown attitude or lines to where the signals near it place it."""
    bias_covariance = white_covariance(np.full(frame.bias_cyc.size + 1, frame.bias_sigma_cyc))
    design = array_design(measured.elements_cyc)
    gate_cyc = POLICY.first_gate_cyc * min(1.0, float(np.linalg.norm(design, axis=1).max()))
    for _ in range(4):
        z = residuals(measured, frame)
        z = z - np.rint(z)
        near = np.flatnonzero(np.all(np.abs(z) < gate_cyc, axis=1))
        if not near.size:
            break
        near_phases = measured.part(near)
        weighted = np.linalg.solve(compute_covariance(near_phases, frame), z[near].ravel()).reshape(near.size, -1)
        if frame.bias_free:
            frame = replace(frame, bias_cyc=frame.bias_cyc + bias_covariance @ weighted.sum(axis=0))
        if frame.attitude_free:
            lever = np.cross(design, (near_phases.direction @ frame.turn.T * near_phases.ratio[:, None])[:, None, :])
            step = -frame.attitude_covariance_rad2 @ np.einsum("nax,na->x", lever, weighted)
            frame = replace(frame, turn=Rotation.from_rotvec(step).as_matrix() @ frame.turn)
    return frame


def _rotations(measured: MeanPhases, frame: ArrayFrame) -> Iterator[tuple[Reals, Reals]]:
    """Yield rotations and line delays about which the phases of most signals add up, the best first."""
    reach = float(np.linalg.norm(array_design(measured.elements_cyc), axis=1).max()) if frame.bias_cyc.size else 1.0
    cell_rad = max(_CELL_RAD / max(reach, 0.5), (4.0 * np.pi**2 / _MOST_ROTATIONS) ** (1.0 / 3.0))
    turns = _grid(cell_rad, level=frame.level)
    raw = measured.raw_cyc - frame.bias_cyc
    score = np.empty(len(turns))
    sums = np.empty((len(turns), raw.shape[1]), np.complex128)
    elements = array_design(measured.elements_cyc)
    for first in range(0, len(turns), 20_000):
        rows = slice(first, first + 20_000)
        predicted = np.einsum(
            "ax,rxy,ny,n->rna", elements, turns[rows], measured.direction, measured.ratio, optimize=True
        )
        sums[rows] = np.exp(2j * np.pi * (raw - predicted)).sum(axis=1)
        score[rows] = (np.abs(sums[rows]) if frame.bias_free else sums[rows].real).sum(axis=1)
    kept: list[int] = []
    for row in np.argsort(-score):
        # Neighbours on the grid lead to one maximum; the trace of a turn is 1 + 2 cos.
        if all(np.sum(turns[row] * turns[other]) < 1.0 + 2.0 * np.cos(2.0 * cell_rad) for other in kept):
            kept.append(int(row))
            bias_cyc = np.angle(sums[row]) / (2.0 * np.pi) if frame.bias_free else 0.0
            yield turns[row], frame.bias_cyc + bias_cyc
        if len(kept) == _CANDIDATES:
            return


def _grid(cell_rad: float, *, level: bool) -> Reals:
    """Build rotations (r, 3, 3) some `cell_rad` apart, which tilt the vertical as far as vehicles do, or not at all."""
    turned = Rotation.from_rotvec(np.outer(np.arange(0.0, 2.0 * np.pi, cell_rad), [0.0, 0.0, 1.0]))
    if level:
        return np.asarray(turned.as_matrix())
    cap = hemisphere(max(int(2.0 * np.pi / cell_rad**2), 1))
    cap = cap[cap[:, 2] >= np.cos(POLICY.most_tilt_rad)]
    tilt = np.arccos(np.clip(cap[:, 2], -1.0, 1.0))
    axis = np.column_stack([-cap[:, 1], cap[:, 0], np.zeros(len(cap))])
    length = np.linalg.norm(axis, axis=1, keepdims=True)
    tilted = Rotation.from_rotvec(np.divide(axis, length, out=np.zeros_like(axis), where=length > 0) * tilt[:, None])
    return np.asarray((tilted.as_matrix()[:, None] @ turned.as_matrix()[None]).reshape(-1, 3, 3))


def _rows(signals: Indices, d: int) -> Indices:
    return np.add.outer(np.asarray(signals, np.intp) * d, np.arange(d)).ravel()
