"""Test if samples are missing: code, carriers and data bits of all signals decide together.

If n code periods are missing, codes do not move. Each carrier turns by its frequency times the missing time, and all
data bits move by n periods. Every row of measurements is tested for moved bits (`bit_edges`). If none moved, whole bits
may be missing. Carriers that jump together raise that question, though fades, slips and a second signal in the beam
make them jump too. The answer is whether they turned by the predicted amount. Missing time that is no whole number of
periods throws all codes off: `channels.match_lost` finds signals that come back with one shift.

Carriers are known modulo half a cycle, as bits turn them. If nothing is missing, fades may turn them by any amount.
Take the likelihood ratio of the prediction by whole missing bits, averaged over an unknown turn of the oscillator that
is common to all. It then has the mean 1. So by Markov's inequality it exceeds N/p for any of N candidates with
probability p at most.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from skyproof.arrays import Booleans, Reals
from skyproof.receiver import coasting
from skyproof.receiver import kernels as k
from skyproof.receiver import measurement as m
from skyproof.receiver.bit_edges import EdgeSums, add_bits, collect_prompts, edge_scores, shift_limit
from skyproof.receiver.channels import GAP_VOTES, Gap
from skyproof.receiver.crosstalk import Rows
from skyproof.receiver.settings import ReceiverSettings
from skyproof.receiver.state import ReceiverState

__all__ = ["Look", "look_for_gap", "turn_ratio"]

JUMP_SIGMAS = 6.0
MOST_VOTES: Final = 0.7
"""Of the signals measured, whose carriers must have jumped to raise the question."""
MOST_LOOKS: Final = 5
DOUBT_SCORE: Final = 2.0
"""While bits fit so much better elsewhere, no measurement is given; where they fit so much worse, they did not move."""
FRESH_S: Final = 2.0
"""Carriers that jump together again within this time do what they did before: their row is given."""
LATELY_FRAMES: Final = 4
"""Before bits are seen to have moved they did: one row of measurements tells it mostly."""
QUIET_WITHIN_S: Final = 0.3
FALSE_TURN_PROBABILITY: Final = 1e-4
MOST_BITS_MISSING: Final = 16
"""Without bits that move. After more the carriers' turns are no longer predicted."""
TURN_SIGMA_CYC: Final = 0.01
"""Of a carrier over two rows of measurements beside what they state: its Doppler does not change quite evenly."""
_TURNS_CYC: Final = np.arange(0.0, 0.5, 0.0025)


@dataclass(frozen=True, eq=False, kw_only=True)
class Look:
    """What one row of measurements says. gap : samples that are missing. withheld : the row may be of the other side of
    a gap; untimed : so may all that comes until a time of week is read."""

    gap: Gap | None = None
    withheld: bool = False
    untimed: bool = False


def look_for_gap(
    state: ReceiverState,
    table: Reals,
    good: Booleans,
    blocks: tuple[Rows, Rows],
    elapsed_s: float,
    settings: ReceiverSettings,
    if_hz: float,
) -> tuple[Look, ReceiverState]:
    """Test one row of measurements (n_channels, N_COLUMNS), those of `good` channels, made of two frames' blocks."""
    jumped = good & (table[:, m.JUMP] > JUMP_SIGMAS)
    asks = bool(jumped.sum() >= GAP_VOTES and jumped.sum() > MOST_VOTES * good.sum())
    known = good & (state.loops[:, k.BIT_START] >= 0.0)
    moved, gap, doubts, signal = state.moved, None, False, settings.signal
    if moved is not None:
        moved = _add_look(moved, state, known, blocks)
        score = float(np.max(edge_scores(moved)))
        doubts = score > DOUBT_SCORE
        if score > shift_limit(settings.false_gap_probability, signal.periods_per_symbol):
            lately_s = elapsed_s - LATELY_FRAMES * settings.frame_s
            gap = Gap(elapsed_s=max(moved.since_s, lately_s), shift_s=0.0, signals=int(known.sum()))
        elif score < -DOUBT_SCORE:
            if moved.is_fresh and moved.looks == 1:
                gap = _find_missing_bits(state, table, good & ~jumped, elapsed_s, moved.since_s, if_hz, signal.symbol_s)
            moved = None
        elif moved.looks >= MOST_LOOKS:
            moved, doubts = None, False
    if gap is not None:
        return Look(gap=gap), replace(state, moved=None, asked_s=elapsed_s)
    if not asks:
        state = replace(state, moved=moved or EdgeSums(periods_per_bit=signal.periods_per_symbol, since_s=elapsed_s))
        return Look(withheld=doubts), _with_quiet_row(state, table, good, elapsed_s)
    fresh = elapsed_s - state.asked_s > FRESH_S
    if moved is None:
        moved = EdgeSums(periods_per_bit=signal.periods_per_symbol, since_s=elapsed_s, is_fresh=fresh)
        # What came after the row's moment: whether the row is of the other side already.
        doubts = bool(np.max(edge_scores(_add_look(moved, state, known, blocks[1:]))) > DOUBT_SCORE)
    untimed = fresh and bool(known.sum() < GAP_VOTES)
    return Look(withheld=fresh or doubts, untimed=untimed), replace(state, moved=moved, asked_s=elapsed_s)


def _with_quiet_row(state: ReceiverState, table: Reals, good: Booleans, elapsed_s: float) -> ReceiverState:
    courses = state.courses.copy()
    courses[good, coasting.QUIET_S] = elapsed_s
    courses[good, coasting.QUIET_CYC] = table[good, m.CARRIER_CYC]
    courses[good, coasting.QUIET_HZ] = table[good, m.DOPPLER_HZ]
    return replace(state, courses=courses)


def _add_look(moved: EdgeSums, state: ReceiverState, known: Booleans, blocks: Sequence[Rows]) -> EdgeSums:
    """Add one more look at the bits of the channels that know where theirs begin."""
    prompts, firsts = collect_prompts(blocks, known)
    return add_bits(moved, prompts, firsts, state.loops[known, k.BIT_START]) if prompts.size else moved


def _find_missing_bits(
    state: ReceiverState, table: Reals, quiet: Booleans, elapsed_s: float, since_s: float, if_hz: float, bit_s: float
) -> Gap | None:
    """Test if whole data bits are missing since the last row before all carriers jumped.

    Channels count that are quiet in both rows.
    """
    quiet &= state.courses[:, coasting.QUIET_S] > since_s - QUIET_WITHIN_S
    if quiet.sum() < GAP_VOTES:
        return None
    now, before = table[quiet], state.courses[quiet]
    away_s = elapsed_s - before[:, coasting.QUIET_S]
    mean_hz = 0.5 * (now[:, m.DOPPLER_HZ] + before[:, coasting.QUIET_HZ])
    turn_cyc = before[:, coasting.QUIET_CYC] - now[:, m.CARRIER_CYC] - mean_hz * away_s
    variance = (
        2.0 * now[:, m.CARRIER_SIGMA_CYC] ** 2 + 0.5 * (now[:, m.DOPPLER_SIGMA_HZ] * away_s) ** 2 + TURN_SIGMA_CYC**2
    )
    predicted_cyc = (if_hz + mean_hz) * bit_s * np.arange(1, MOST_BITS_MISSING + 1)[:, np.newaxis]
    ratios = turn_ratio(turn_cyc - predicted_cyc, np.sqrt(variance))
    if np.max(ratios) < MOST_BITS_MISSING / FALSE_TURN_PROBABILITY:
        return None
    return Gap(elapsed_s=since_s, shift_s=0.0, signals=int(quiet.sum()))


def turn_ratio(apart_cyc: Reals, sigma_cyc: Reals) -> Reals:
    """Compute the likelihood ratio of candidates (n_candidates,): carriers turned as predicted, or by any amount.

    apart_cyc : (n_candidates, n_signals) turn beyond the predicted one, modulo half a cycle. sigma_cyc : (n_signals,).

    It is averaged over a turn that all have in common.
    """
    rest = apart_cyc[:, np.newaxis, :] - _TURNS_CYC[:, np.newaxis]
    rest = rest - 0.5 * np.rint(2.0 * rest)
    density = np.exp(-0.5 * (rest / sigma_cyc) ** 2) / (np.sqrt(2.0 * np.pi) * sigma_cyc) / 2.0
    return np.asarray(np.mean(np.prod(density, axis=-1), axis=-1))
