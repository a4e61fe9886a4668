"""State that the receiver keeps between two blocks of samples, and the output of a step."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from skyproof.arrays import Floats, Integers, Reals
from skyproof.receiver import kernels as k
from skyproof.receiver.antennas import N_LAST, first_weights
from skyproof.receiver.bit_edges import EdgeSums
from skyproof.receiver.channels import Arc, Channel, DelayDoppler, Gap, LostSignal
from skyproof.receiver.coasting import N_COURSE
from skyproof.receiver.false_lock import N_TURNS
from skyproof.receiver.grids import Grids
from skyproof.receiver.guidance import N_GUIDE
from skyproof.receiver.measurement import Measurements
from skyproof.receiver.settings import LOCK_FRAMES

__all__ = ["ReceiverState", "StepOutput", "keep_channels", "place_of", "with_channel"]

_OF_CHANNELS: Final = (
    "loops",
    "rows",
    "counts",
    "weights",
    "last_phases",
    "lock",
    "locked_at",
    "courses",
    "turns",
    "guides",
)
"""Arrays with a row a channel."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ReceiverState:
    """All that the receiver remembers between two blocks of samples.

    The arrays have a row a channel: loops as in `kernels`; rows and counts of the frame before; the lock value and
    number of prompts of the last frames, NaN before the channel began and while it coasted; where it was when it was
    last locked (time, delay, Doppler, number of the code period). weights : of the antennas, with which `rows` were
    summed; last_phases : as `antennas.unwrap_phases` gives them, NaN before. courses : as in `coasting`; turns : as in
    `false_lock`; guides : as in `guidance`. noise : power of noise alone in the prompt of one code period, in the frame
    before. moved : whether data bits begin elsewhere since the carriers jumped, while that is open; asked_s : when they
    last did.
    """

    tail: Floats = field(default_factory=lambda: np.empty((1, 2, 0), np.float32))
    tail_start: int = 0
    frame: int = 0
    channels: tuple[Channel, ...] = ()
    loops: Reals = field(default_factory=lambda: np.empty((0, k.N_STATE)))
    rows: Reals = field(default_factory=lambda: np.empty((0, 0, 0)))
    counts: Integers = field(default_factory=lambda: np.empty(0, np.int64))
    weights: Reals = field(default_factory=lambda: np.empty((0, 1, 2)))
    last_phases: Reals = field(default_factory=lambda: np.empty((0, 1, N_LAST)))
    prompts: tuple[tuple[Floats, ...], ...] = ()  # in phase, of the frames since the last telemetry
    lock: Reals = field(default_factory=lambda: np.empty((0, LOCK_FRAMES, 2)))
    locked_at: Reals = field(default_factory=lambda: np.empty((0, 4)))
    courses: Reals = field(default_factory=lambda: np.empty((0, N_COURSE)))
    turns: Reals = field(default_factory=lambda: np.empty((0, N_TURNS)))
    guides: Reals = field(default_factory=lambda: np.empty((0, N_GUIDE)))
    noise: float = 0.0
    moved: EdgeSums | None = None
    asked_s: float = -np.inf
    lost: tuple[LostSignal, ...] = ()
    letters: Mapping[str, int] = field(default_factory=dict)
    searched: Mapping[str, Mapping[int, float]] = field(default_factory=dict)  # sat -> Doppler bin -> last time
    next_arc: int = 0


@dataclass(frozen=True, eq=False, kw_only=True)
class StepOutput:
    """What a step gives: measurements, the arcs that were followed as they stand, gaps that were bridged, the
    requested correlation grids. noncoherent : rows of guided channels without a phase, for the filter that guides
    them; they are no measurements.
    """

    measurements: Measurements
    arcs: Mapping[int, Arc]
    gaps: tuple[Gap, ...] = ()
    grids: Grids = field(default_factory=Grids.nothing)
    noncoherent: Measurements = field(default_factory=Measurements.nothing)


def keep_channels(state: ReceiverState, stay: Sequence[int]) -> ReceiverState:
    """Keep these channels of the state alone."""
    if len(stay) == len(state.channels):
        return state
    rows = np.array(stay, np.int64)
    arrays: dict[str, Any] = {name: getattr(state, name)[rows] for name in _OF_CHANNELS}
    return replace(
        state,
        channels=tuple(state.channels[i] for i in stay),
        prompts=tuple(state.prompts[i] for i in stay),
        **arrays,
    )


def with_channel(
    state: ReceiverState, channel: Channel, loop: Reals, delay_s: float, *, antenna: int, rows_shape: tuple[int, int]
) -> ReceiverState:
    """Add one more channel to the state.

    loop : (N_STATE,), with the carrier's Doppler and the next period's start set. antenna : on which the signal
    was found. rows_shape : of what the kernel gives of a channel in a frame.
    """
    n_antennas = state.tail.shape[0]
    begun_s = channel.began_s
    course = np.full(N_COURSE, np.nan)
    new = {
        "loops": loop,
        "rows": np.zeros(rows_shape),
        "counts": np.zeros((), np.int64),
        "weights": first_weights(antenna, n_antennas)[0],
        "last_phases": np.full((n_antennas, N_LAST), np.nan),
        "lock": np.full((LOCK_FRAMES, 2), np.nan),
        "locked_at": np.array([begun_s, delay_s, loop[k.PLL_VELOCITY], 0.0]),
        "courses": course,
        "turns": np.zeros(N_TURNS),
        "guides": np.full(N_GUIDE, np.nan),
    }
    arrays: dict[str, Any] = {
        name: np.concatenate([getattr(state, name), row[None]]) if state.channels else row[None]
        for name, row in new.items()
    }
    return replace(
        state, channels=(*state.channels, channel), prompts=(*state.prompts, ()), next_arc=state.next_arc + 1, **arrays
    )


def place_of(locked_at: Reals) -> DelayDoppler:
    """Return where a channel was when it was last locked, from its row (4,)."""
    at_s, delay_s, doppler_hz, period = locked_at.tolist()
    return DelayDoppler(at_s=at_s, delay_s=delay_s, doppler_hz=doppler_hz, period=round(period))
