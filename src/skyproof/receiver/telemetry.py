"""Decode prompt correlations to navigation bits and time of week: one small state a channel, frame by frame."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Booleans, Floats, Reals
from skyproof.gnss.lnav import Subframe
from skyproof.gnss.signals import MessageDecoder, SignalPlan
from skyproof.receiver.bit_edges import EdgeSums, add_bits, edge_scores, shift_limit
from skyproof.receiver.polarity import BRIDGED_WORDS, Stretch, find_stretches, join_stretches

FALSE_REFUTATION = 1e-6
"""Probability that bits which begin where the time of week has them are taken for others."""
FALSE_START = 1e-5
"""Probability, at most, of each look that bits are taken to begin where they do not. A code period is 300 km."""
SYNC_BITS = 75
"""Bits looked at to find where they begin: some 35 transitions, of 20 ms enough down to 28 dB-Hz."""
MOST_SYNC_BITS = 300
"""Kept while too few transitions tell where bits begin: a message may send zeros for two seconds, and words of reserved
pages hardly turn over."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Telemetry:
    """What is known of one channel's message.

    prompts : in-phase prompts not yet made into bits; the first one is that of code period `prompts_period`.
    bits : the latest bits, 0 or 1, polarity unknown; the first begins with code period `bits_period`.
    due_bits : so many bits make the next subframe whole; None while none is found.
    tow_ms_at_period_0 : time of week at which the satellite sent the start of code period 0; None until decoded. It is
        kept through a fade, and while the bits are found again, as long as it fits where they begin.
    subframes : the latest of each kind: 1, 2, 3, and page 18 of 4 as 4.
    stretches : where it is known whether the bits came inverted.
    """

    prompts: Floats = field(default_factory=lambda: np.empty(0, np.float32))
    prompts_period: int = 0
    synchronised: bool = False
    bits: NDArray[np.int8] = field(default_factory=lambda: np.empty(0, np.int8))
    bits_period: int = 0
    due_bits: int | None = None
    tow_ms_at_period_0: int | None = None
    subframes: Mapping[int, Subframe] = field(default_factory=dict)
    stretches: tuple[Stretch, ...] = ()


def step(telemetry: Telemetry, prompts: NDArray[np.floating], first_period: int, signal: SignalPlan) -> Telemetry:
    """Take the in-phase prompts (n,) of the code periods from `first_period` on, which follow on those before.

    A signal whose message is not known has no telemetry: it does not change.
    """
    decoder = signal.decoder
    if decoder is None:
        return telemetry
    if telemetry.prompts.size == 0:
        telemetry = replace(telemetry, prompts_period=first_period)
    telemetry = replace(telemetry, prompts=np.concatenate([telemetry.prompts, prompts.astype(np.float32)]))
    if not telemetry.synchronised:
        if telemetry.prompts.size < SYNC_BITS * signal.periods_per_symbol:
            return telemetry
        telemetry = _synchronise(telemetry, signal)
        if not telemetry.synchronised:
            return telemetry
    return _decode(_make_bits(telemetry, signal), telemetry.bits.size, signal, decoder)


def bit_energy(prompts: Floats, periods: int) -> Reals:
    """Compute the mean energy of sums over a bit's periods that begin at period 0, 1, ...

    It is largest where the bits begin.
    """
    sums = np.convolve(prompts.astype(np.float64), np.ones(periods), "valid")
    n = sums.size // periods * periods
    energy: Reals = np.mean(sums[:n].reshape(-1, periods) ** 2, axis=0)
    return energy


def bit_start(telemetry: Telemetry, signal: SignalPlan) -> int | None:
    """Return the code period, modulo those of a bit, with which bits begin; None while that is not known."""
    if telemetry.synchronised:
        return telemetry.bits_period % signal.periods_per_symbol
    if telemetry.tow_ms_at_period_0 is not None:
        return -telemetry.tow_ms_at_period_0 // signal.period_ms % signal.periods_per_symbol
    return None


def _synchronise(telemetry: Telemetry, signal: SignalPlan) -> Telemetry:
    """Find where bits begin: where a known time of week has them, unless refuted, else where all other starts are.

    As long as neither is known, the latest prompts are kept for the next look.
    """
    known, periods = bit_start(telemetry, signal), signal.periods_per_symbol
    best = int(np.argmax(bit_energy(telemetry.prompts, periods)))
    if known is not None:
        expected = (known - telemetry.prompts_period) % periods
        if expected == best or not np.any(_find_refuting(telemetry.prompts, expected, periods)):
            return _start_bits(telemetry, expected)
        telemetry = replace(telemetry, tow_ms_at_period_0=None, stretches=())
    if np.all(_find_refuted(telemetry.prompts, best, periods)):
        return _start_bits(telemetry, best)
    dropped = max(telemetry.prompts.size - MOST_SYNC_BITS * periods, 0)
    return replace(telemetry, prompts=telemetry.prompts[dropped:], prompts_period=telemetry.prompts_period + dropped)


def _start_bits(telemetry: Telemetry, offset: int) -> Telemetry:
    """Start the bits with the prompt of that number."""
    return replace(
        telemetry,
        synchronised=True,
        prompts=telemetry.prompts[offset:],
        prompts_period=telemetry.prompts_period + offset,
        bits=np.empty(0, np.int8),
        bits_period=telemetry.prompts_period + offset,
    )


def _find_refuting(prompts: Floats, offset: int, periods: int) -> Booleans:
    """Find other starts (periods - 1,) that refute bits that begin at period `offset`."""
    return np.asarray(_score_starts(prompts, offset, periods) > shift_limit(FALSE_REFUTATION, periods))


def _find_refuted(prompts: Floats, offset: int, periods: int) -> Booleans:
    """Find other starts (periods - 1,) that bits that begin at period `offset` refute."""
    return np.asarray(_score_starts(prompts, offset, periods) < -shift_limit(FALSE_START, periods))


def _score_starts(prompts: Floats, offset: int, periods: int) -> Reals:
    sums = EdgeSums(periods_per_bit=periods, since_s=0.0)
    return edge_scores(
        add_bits(sums, prompts[None].astype(np.complex128), np.zeros(1, np.int64), np.array([float(offset)]))
    )


def _make_bits(telemetry: Telemetry, signal: SignalPlan) -> Telemetry:
    periods = signal.periods_per_symbol
    n = telemetry.prompts.size // periods
    if n == 0:
        return telemetry
    used = n * periods
    new = (telemetry.prompts[:used].reshape(n, periods).sum(axis=1) < 0.0).astype(np.int8)
    return replace(
        telemetry,
        bits=np.concatenate([telemetry.bits, new]),
        prompts=telemetry.prompts[used:],
        prompts_period=telemetry.prompts_period + used,
    )


def bits_kept(decoder: MessageDecoder) -> int:
    """Return the length of two frames and a head, in bits.

    A frame is always whole in it, and starts can be checked against each other.
    """
    return 2 * decoder.frame_bits + decoder.head_bits


def _decode(telemetry: Telemetry, n_before: int, signal: SignalPlan, decoder: MessageDecoder) -> Telemetry:
    """Look for frames each second until one is found, then each time one is whole; forget what no frame can need."""
    n, most, a_second = telemetry.bits.size, bits_kept(decoder), round(1.0 / signal.symbol_s)
    is_due = n // a_second > n_before // a_second if telemetry.due_bits is None else n >= telemetry.due_bits
    if n < decoder.head_bits or not (is_due or n >= most):
        return telemetry
    subframes = dict(telemetry.subframes)
    tow_ms, due_bits, periods = telemetry.tow_ms_at_period_0, None, signal.periods_per_symbol
    starts = decoder.find_frames(telemetry.bits)
    for start in starts:
        how = decoder.read_time(telemetry.bits[start : start + decoder.head_bits])
        if how is None:
            continue
        tow_ms = how.tow_s * 1000 - (telemetry.bits_period + start * periods) * signal.period_ms
        end = start + decoder.frame_bits
        due_bits = end if end > n else end + decoder.frame_bits
        subframe = decoder.read_frame(telemetry.bits[start:end]) if end <= n else None
        if subframe is not None and decoder.keeps(subframe):
            subframes[subframe.id] = subframe
    if n >= most and due_bits is None:  # two frames' time without one: bits may not begin where we think
        return Telemetry(
            tow_ms_at_period_0=telemetry.tow_ms_at_period_0,
            subframes=telemetry.subframes,
            stretches=telemetry.stretches,
        )
    known = telemetry.stretches if tow_ms == telemetry.tow_ms_at_period_0 else ()
    found = find_stretches(telemetry.bits, starts[0], telemetry.bits_period, signal, decoder) if starts else ()
    bridged = BRIDGED_WORDS * decoder.word_bits * periods
    telemetry = replace(
        telemetry,
        tow_ms_at_period_0=tow_ms,
        due_bits=due_bits,
        subframes=subframes,
        stretches=join_stretches(known, found, bridged),
    )
    drop = n - (decoder.frame_bits + decoder.head_bits)
    if n < most or due_bits is None:
        return telemetry
    return replace(
        telemetry,
        due_bits=due_bits - drop,
        bits=telemetry.bits[drop:],
        bits_period=telemetry.bits_period + drop * periods,
    )
