"""Couple signals and replicas over an integration: lag, phase, and the mean of both bits times the phasor.

Phases and lags run straight over stretches of at most 20 ms, which are cut where signals come and go; bits and where
guesses of them end cut them further, exactly.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Booleans, Complexes, Integers, Reals
from skyproof.compiled import compiled
from skyproof.gnss.signals import SignalPlan
from skyproof.simulator.received import Delay, ReceiverSky, Scene, collect_windows, find_rows
from skyproof.simulator.tracked import Tracked

__all__ = [
    "StraightSpans",
    "WaveEdges",
    "compute_couplings",
    "cut_spans",
    "list_pairs",
    "list_received_waves",
    "list_replica_waves",
    "mark_present",
]

STRAIGHT_S = 0.02
"""Over which phases and lags run straight: a GPS carrier bends by 5e-5 cycles, differences of copies by less."""
_JITTER = 1e-12


@dataclass(frozen=True, eq=False, kw_only=True)
class StraightSpans:
    """Edges of the stretches over which phases run straight: (n_epochs, n_stretches + 1)."""

    elapsed_s: Reals
    true_s: Reals

    @property
    def middle_true_s(self) -> Reals:
        return np.asarray(0.5 * (self.true_s[:, 0] + self.true_s[:, -1]))


@dataclass(frozen=True, eq=False, kw_only=True)
class WaveEdges:
    """Signals or replicas at the edges: delays (n_epochs, n_edges, n), the bits' positions, which bits, when there.

    sent : symbols since the first of the message. symbols, guesses : (n_messages, n_symbols), as in `Messages`.
    message : (n,) -1 for no bits. guessed : (n,) how much of each symbol, 0 for replicas, who know it.
    windows_s : (n, n_windows, 2) in true time.
    """

    sats: list[str]
    code_s: Reals
    carrier_s: Reals
    sent: Reals
    symbols: NDArray[np.int8]
    guesses: NDArray[np.int8]
    message: Integers
    guessed: Reals
    windows_s: Reals
    of: Integers


def cut_spans(sky: ReceiverSky, middle_s: Reals, coherent_s: float) -> StraightSpans:
    """Cut integrations into even stretches, and where a signal comes or goes: carriers may bend sharply there."""
    stretches = math.ceil(coherent_s / STRAIGHT_S * (1.0 - _JITTER))
    elapsed_s = middle_s[:, np.newaxis] + coherent_s * (np.arange(stretches + 1) / stretches - 0.5)
    edges_s = np.unique(collect_windows(sky.signals))
    edges_s = sky.elapsed_at(edges_s[np.isfinite(edges_s)])
    inside = np.abs(middle_s[:, np.newaxis] - edges_s) < 0.5 * coherent_s
    cuts_s = np.sort(np.where(inside, edges_s, elapsed_s[:, -1:]), axis=1)[:, : inside.sum(axis=1).max(initial=0)]
    elapsed_s = np.sort(np.concatenate([elapsed_s, cuts_s], axis=1), axis=1)
    return StraightSpans(elapsed_s=elapsed_s, true_s=elapsed_s + sky.true_minus_elapsed_s(elapsed_s))


def list_received_waves(scene: Scene, sky: ReceiverSky, spans: StraightSpans) -> WaveEdges:
    """List the signals, then their reflections, at the edges."""
    code_s, carrier_s = _compute_delays(sky.delays_s, spans.true_s)
    of = np.array([*range(len(sky.signals)), *(ray.of for ray in sky.rays)], np.int64)
    code_s, carrier_s = code_s[..., of], carrier_s[..., of]
    for row, ray in enumerate(sky.rays, len(sky.signals)):
        further_s = ray.further_s(spans.true_s)
        code_s[..., row] += further_s
        carrier_s[..., row] += further_s - (ray.phase_cyc + ray.rate_hz * spans.true_s) / sky.signal.carrier_hz
    received = [sky.signals[column] for column in of]
    message = find_rows(scene.messages, received)
    return WaveEdges(
        sats=[each.id.sat for each in received],
        code_s=code_s,
        carrier_s=carrier_s,
        sent=_count_sent(scene, sky, spans.true_s, code_s),
        symbols=scene.messages.symbols,
        guesses=scene.messages.guesses,
        message=message,
        guessed=scene.messages.guess_s[message] / sky.signal.symbol_s,
        windows_s=collect_windows(received),
        of=of,
    )


def list_replica_waves(
    scene: Scene, sky: ReceiverSky, tracked: Tracked, spans: StraightSpans, wiped: bool
) -> WaveEdges:
    """List the replicas at the edges."""
    code_s, carrier_s = _compute_delays(tracked.delays_s, spans.true_s)
    always_s = np.tile([-np.inf, np.inf], (len(tracked.signals), 1, 1))
    return WaveEdges(
        sats=[signal.sat for signal in tracked.signals],
        code_s=code_s,
        carrier_s=carrier_s,
        sent=_count_sent(scene, sky, spans.true_s, code_s),
        symbols=scene.messages.symbols,
        guesses=scene.messages.guesses,
        message=tracked.symbols if wiped else np.full(len(tracked.signals), -1),
        guessed=np.zeros(len(tracked.signals)),
        windows_s=always_s,
        of=tracked.columns,
    )


def mark_present(sky: ReceiverSky, tracked: Tracked, spans: StraightSpans) -> Booleans:
    windows_s = collect_windows(sky.signals)
    first_s, last_s = (spans.true_s[:, edge, np.newaxis, np.newaxis] for edge in (0, -1))
    present: Booleans = np.any((windows_s[..., 0] <= first_s) & (last_s <= windows_s[..., 1]), axis=2)
    return np.asarray(present[:, tracked.columns] | (tracked.columns < 0))


def list_pairs(channel_sats: Sequence[str], row_sats: Sequence[str]) -> Integers:
    """Pair channels and rows of one satellite, (n_pairs, 2)."""
    return np.argwhere(np.array(channel_sats)[:, np.newaxis] == np.array(row_sats))


def compute_couplings(
    spans: StraightSpans,
    channels: WaveEdges,
    rows: WaveEdges,
    pairs: Integers,
    dopplers_hz: Reals,
    signal: SignalPlan,
) -> tuple[Reals, Reals, Complexes]:
    """Compute lag, phase, and each stretch's part of the mean of bits and phasor.

    Returns the lag in chips (n_epochs, n_stretches, n_pairs), and the phase at the edges in cycles (n_epochs, n_edges,
    n_pairs). The parts of the mean are (n_epochs, n_pairs, n_stretches, n_dopplers).
    """
    channel, row = pairs.T
    late_chips = (rows.code_s[..., row] - channels.code_s[..., channel]) * signal.chip_rate_hz
    turns_cyc = signal.carrier_hz * (channels.carrier_s[..., channel] - rows.carrier_s[..., row])
    since_s = spans.elapsed_s - 0.5 * (spans.elapsed_s[:, :1] + spans.elapsed_s[:, -1:])
    shape = turns_cyc.shape[0], pairs.shape[0], turns_cyc.shape[1] - 1, dopplers_hz.size
    coupling = np.empty(shape, np.complex128)
    _couple(
        coupling,
        pairs,
        spans.true_s,
        turns_cyc,
        np.multiply.outer(since_s, dopplers_hz),
        rows.sent,
        channels.sent,
        rows.symbols,
        rows.guesses,
        rows.message,
        rows.guessed,
        channels.message,
        rows.windows_s,
    )
    return 0.5 * (late_chips[:, :-1] + late_chips[:, 1:]), turns_cyc, coupling


def _compute_delays(delays_s: Delay, true_s: Reals) -> tuple[Reals, Reals]:
    code_s, carrier_s = delays_s(true_s.ravel())
    return code_s.reshape(*true_s.shape, -1), carrier_s.reshape(*true_s.shape, -1)


def _count_sent(scene: Scene, sky: ReceiverSky, true_s: Reals, code_s: Reals) -> Reals:
    """Count the symbols that have been sent since the first."""
    symbol_s = sky.signal.period_s * sky.signal.periods_per_symbol
    return np.asarray((scene.messages.lead_s + (true_s[..., np.newaxis] - code_s)) / symbol_s)


@compiled
def _couple(
    coupling: Complexes,
    pairs: Integers,
    true_s: Reals,
    turns_cyc: Reals,
    tap_cyc: Reals,
    sent: Reals,
    wiped: Reals,
    symbols: NDArray[np.int8],
    guesses: NDArray[np.int8],
    message: Integers,
    guessed: Reals,
    wiped_message: Integers,
    windows_s: Reals,
) -> None:
    """Fill each stretch's share of the mean of both bits times the phasor.

    The arrays are those of `compute_couplings`.
    """
    epochs, n_pairs, stretches, n_dopplers = coupling.shape
    for e in range(epochs):
        for p in range(n_pairs):
            c, r = pairs[p, 0], pairs[p, 1]
            for s in range(stretches):
                for d in range(n_dopplers):
                    coupling[e, p, s, d] = 0.0
                begin_s, took_s = true_s[e, s], true_s[e, s + 1] - true_s[e, s]
                if took_s <= 0.0:
                    continue
                part = took_s / (true_s[e, stretches] - true_s[e, 0])
                bit, bits = sent[e, s, r], sent[e, s + 1, r] - sent[e, s, r]
                own_bit, own_bits = wiped[e, s, c], wiped[e, s + 1, c] - wiped[e, s, c]
                for w in range(windows_s.shape[1]):
                    u = min(max((windows_s[r, w, 0] - begin_s) / took_s, 0.0), 1.0)
                    end = min(max((windows_s[r, w, 1] - begin_s) / took_s, 0.0), 1.0)
                    while u < end:
                        # the middle of what is left of a bit shows which bit it is, roundings or not
                        at, own_at = math.floor(bit + u * bits + 1e-9), math.floor(own_bit + u * own_bits + 1e-9)
                        until = min(end, (at + 1 - bit) / bits)
                        sign = 1.0
                        if message[r] >= 0:
                            sign = float(symbols[message[r], at])
                        if bit + u * bits + 1e-9 - at < guessed[r]:
                            sign = float(guesses[message[r], at])
                            until = min(until, (at + guessed[r] - bit) / bits)
                        if wiped_message[c] >= 0:
                            until = min(until, (own_at + 1 - own_bit) / own_bits)
                            sign *= symbols[wiped_message[c], own_at]
                        if until <= u:
                            until = min(end, u + 1e-9)
                        share, half = until - u, 0.5 * (until + u)
                        for d in range(n_dopplers):
                            run = turns_cyc[e, s + 1, p] - turns_cyc[e, s, p] - tap_cyc[e, s + 1, d] + tap_cyc[e, s, d]
                            turn = turns_cyc[e, s, p] - tap_cyc[e, s, d] + run * half
                            angle_rad = 2.0 * math.pi * (turn - math.floor(turn))
                            x = math.pi * run * share
                            loss = math.sin(x) / x if abs(x) > 1e-6 else 1.0
                            size = sign * share * loss * part
                            coupling[e, p, s, d] += complex(size * math.cos(angle_rad), size * math.sin(angle_rad))
                        u = until
