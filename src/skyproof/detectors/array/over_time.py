"""Add up what an array measured over blocks of 1, 2, 4, ... windows, in sums that keep no window.

A block holds the mean residuals of those signals that all its windows have, about the frame of the newest window. Noise
is new in every window. What reflections write into a phase is forgotten as the satellite moves (a Gauss-Markov
process), but for what the antennas' own patterns are. What all signals share (places of antennas, lines, attitude)
stays. Windows join where the body's attitude, the antennas and what is known of both are the same.

Two blocks of one length make one of twice the length, as in a binary counter: of each length so many windows apart a
test, and no more than one block of each length waits. Cutting a run between windows changes nothing.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.array.agreement import ArrayFrame, MeanPhases, residuals
from skyproof.detectors.array.policy import POLICY
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.records import SignalRef

__all__ = ["Block", "Waiting", "add_block", "alpha_alone", "alpha_of_block", "pattern_share", "share_after_averaging"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Block:
    """Windows together.

    refs : n signals. residual_cyc : (n, d) mean about the frame. towards : (n, 3) mean predicted direction in the
    frame's axes. white_cyc2 : (n, M) variance of the mean by noise; lasting_cyc2 : (M,) by what lasts in a window.
    frame : of the newest window, as it was fitted, body : (3, 3) from ECEF to the body in it. measured : its phases.
    """

    refs: tuple[SignalRef, ...]
    residual_cyc: Reals
    towards: Reals
    white_cyc2: Reals
    lasting_cyc2: Reals
    frame: ArrayFrame
    body: Reals
    measured: MeanPhases
    windows: int
    duration_s: float

    def part(self, refs: Sequence[SignalRef]) -> "Block":
        """Return some of the signals."""
        rows = np.array([self.refs.index(ref) for ref in refs], np.intp)
        return replace(
            self,
            refs=tuple(refs),
            residual_cyc=self.residual_cyc[rows],
            towards=self.towards[rows],
            white_cyc2=self.white_cyc2[rows],
            measured=self.measured.part(rows),
        )

    def mean_phases(self, kept: float) -> MeanPhases:
        """Return phases as of one window, which have the mean residuals in the frame.

        kept : share of the variance of what lasts in a window, what does not change from window to window.
        """
        lasting_share = kept + (1.0 - kept) * share_after_averaging(self.duration_s)
        direction = self.towards @ self.frame.turn  # from the frame's axes to those of the prediction
        measured = replace(
            self.measured,
            direction=direction,
            cycles=np.zeros_like(self.residual_cyc),
            sigma_cyc=np.sqrt(self.white_cyc2 + lasting_share * self.lasting_cyc2),
        )
        return replace(measured, cycles=self.residual_cyc - residuals(measured, self.frame))


def share_after_averaging(duration_s: float) -> float:
    """Return the share of a Gauss-Markov process's variance that a mean over this duration keeps."""
    x = duration_s / POLICY.lasting_forgotten_s
    return float(2.0 / x * (1.0 - (1.0 - np.exp(-x)) / x)) if x > 1e-4 else 1.0


def pattern_share(lasting_sigma_cyc: float, carrier_hz: float, pattern_sigma_m: float | None = None) -> float:
    """Return the largest share of a phase's lasting variance that antenna patterns cause, and that stays."""
    pattern_m = POLICY.pattern_sigma_m if pattern_sigma_m is None else pattern_sigma_m
    pattern_cyc = pattern_m * carrier_hz / SPEED_OF_LIGHT_M_S
    return (pattern_cyc / max(lasting_sigma_cyc, pattern_cyc)) ** 2 if pattern_cyc else 0.0


def alpha_alone(false_alarm_probability: float) -> float:
    """Return the part of a window's false-alarm probability that the window alone spends: half of it."""
    return 0.5 * false_alarm_probability


def alpha_of_block(false_alarm_probability: float, windows: int) -> float:
    """Return what a block of so many windows spends: the other half of each, shared by all lengths of blocks."""
    return 0.5 * false_alarm_probability * windows / POLICY.block_lengths


@dataclass(frozen=True, eq=False)
class Waiting:
    """Of one receiver: blocks that wait for one as long, by length; and signals that blocks have shown to be false,
    with the number of windows until the next block as long."""

    blocks: tuple[Block | None, ...] = (None,) * POLICY.block_lengths
    false: dict[SignalRef, int] = field(default_factory=dict)

    def with_false(self, refs: Collection[SignalRef], windows: int) -> "Waiting":
        """Return it with signals that a block of so many windows shows to be false."""
        longest = {ref: max(windows, self.false.get(ref, 0)) for ref in refs}
        return replace(self, false={**self.false, **longest})


def add_block(waiting: Waiting, block: Block) -> tuple[Waiting, list[Block]]:
    """Add a window's block; return what waits, and the longer blocks that it completed."""
    levels = list(waiting.blocks)
    false = {ref: windows - 1 for ref, windows in waiting.false.items() if windows > 1}
    complete = list[Block]()
    for level, other in enumerate(levels):
        joined = None if other is None else _join(other, block)
        if joined is None:
            levels[level] = block
            break
        levels[level] = None
        complete.append(joined)
        block = joined
    return Waiting(tuple(levels), false), complete


def _join(earlier: Block, later: Block) -> Block | None:
    """Return two blocks of one length as one; None where they do not go together."""
    refs = [ref for ref in later.refs if ref in earlier.refs]
    if len(refs) < 2 or not _is_same_array(earlier, later):
        return None
    a, b = earlier.part(refs), later.part(refs)
    apart = b.residual_cyc - a.residual_cyc
    return replace(
        b,
        residual_cyc=a.residual_cyc + 0.5 * (apart - np.rint(apart)),
        towards=0.5 * (a.towards + b.towards),
        white_cyc2=0.25 * (a.white_cyc2 + b.white_cyc2),
        lasting_cyc2=np.maximum(a.lasting_cyc2, b.lasting_cyc2),
        windows=a.windows + b.windows,
        duration_s=a.duration_s + b.duration_s,
    )


def _is_same_array(a: Block, b: Block) -> bool:
    """Tell if two blocks are from the same antennas on a body that stands the same way."""
    if a.measured.elements_cyc.shape != b.measured.elements_cyc.shape:
        return False
    if not np.array_equal(a.measured.elements_cyc, b.measured.elements_cyc):
        return False
    known = ((f.attitude_free, f.level, f.bias_free) for f in (a.frame, b.frame))
    if len(set(known)) > 1:
        return False
    cosine = 0.5 * (np.trace(a.body @ b.body.T) - 1.0)
    return bool(cosine > np.cos(POLICY.alike_rad))
