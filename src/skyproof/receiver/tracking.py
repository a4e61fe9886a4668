"""The receiver as a step: samples in, measurements out, everything it remembers in an explicit state.

Samples are worked on in frames of a tenth of a second counted from the first sample, whatever blocks they come in: any
cut of the recording gives the same result. Each frame: search for new signals when it is time, one kernel call that
advances all channels, lock control, telemetry, and at every second frame a row of measurements for each channel.
"""

import math
import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Booleans, Complexes, ComplexFloats, Floats, Integers, Reals
from skyproof.gnss.signals import GPS_L1_CA, GPS_SATS, SignalDescription, prn_of
from skyproof.receiver import kernels as k
from skyproof.receiver import measurement as m
from skyproof.receiver import telemetry as tm
from skyproof.receiver.acquisition import KnownSignal, Peak, Searcher, SearchSettings
from skyproof.receiver.antennas import N_LAST, combining, first_weights, measure_antennas, separated, unwrapped
from skyproof.receiver.channels import (
    FORGET_S,
    GAP_VOTES,
    Arc,
    Channel,
    Gap,
    LostSignal,
    Place,
    arc_of,
    continued,
    letter,
)
from skyproof.receiver.correlator import REACH_CHIPS, table_pad
from skyproof.receiver.crosstalk import Rows
from skyproof.receiver.discriminator import discriminator
from skyproof.receiver.grids import GridCorrelator, Grids, at_stake
from skyproof.receiver.joining import Components, JointReceiver, JointStates
from skyproof.receiver.lock import lock_threshold, lock_value
from skyproof.receiver.looks import look_means
from skyproof.receiver.measurement import Measurements
from skyproof.receiver.replica import CODE_SCALE, code_table
from skyproof.records import CcafAsked

MEASURE_FRAMES = 2
TELEMETRY_FRAMES = 5
LOCK_FRAMES = 5
JUMP_SIGMAS = 6.0
STEER_SHARE = 0.5
"""Of a measured error of code by which it is steered until the next measurement: 0.8 Hz of noise bandwidth."""
POWER_STRIDE = 61
"""Every so many samples tell the level of a frame, to a per cent or better."""
MERGE_HZ = 100.0
DOPPLER_BIN_HZ = 500.0
"""How finely it is remembered where was searched last."""

SEARCH = SearchSettings(coherent_periods=1, n_sums=20)
NEAR_SEARCH = SearchSettings(coherent_periods=4, n_sums=5)


@dataclass(frozen=True, kw_only=True)
class LoopSettings:
    """Coherent integration in code periods (a divisor of a bit's) and loop bandwidths in hertz."""

    integration: int
    pll_bandwidth_hz: float
    fll_bandwidth_hz: float = 0.0
    dll_bandwidth_hz: float = 1.0


@dataclass(frozen=True, kw_only=True)
class ReceiverSettings:
    """How the receiver works. Times in seconds of receiver time.

    early_late_chips : spacing between early and late tap.
    further_taps_chips : taps beside early, prompt and late, ahead of prompt positive.
    further_taps_hz : Dopplers beside the carrier's at which all taps are taken as well.
    looks_per_frame, look_share : all taps are taken in this share of so many equal parts of a frame, and averaged over
        each; 0 takes them all the time and averages over a row of measurements.
    grids : which correlation grids are taken; None takes none.
    joint : whether signals are followed by joint channels beside the loops, so that several of a satellite within a
        chip and a half are told apart (`joining`).
    pull_in, searching_bits, tracking, weak : the loops for `pull_in_s`; until bits are known; then; and below
        `weak_dbhz` (with 2 dB of hysteresis).
    confirm_s : after that time a channel must be locked or is dropped.
    false_hold_probability : that noise passes for a locked signal in one look at the last half second.
    near_search_s, full_search_s : how often further signals are looked for near the Doppler of tracked and lost ones,
        and of every satellite at every Doppler; the latter every `first_search_s` until the first signal is found.
    pulled_chips : by as much code and carrier may part before a channel counts as pulled away from its signal.
    """

    signal: SignalDescription = GPS_L1_CA
    sats: tuple[str, ...] = GPS_SATS
    frame_s: float = 0.1
    early_late_chips: float = 0.25
    further_taps_chips: tuple[float, ...] = ()
    further_taps_hz: tuple[float, ...] = ()
    looks_per_frame: int = 0
    look_share: float = 1.0
    grids: CcafAsked | None = None
    joint: bool = False
    code_phases: int = 32
    # Of 5 ms: a frequency loop of 1 ms shakes by 18 Hz at 35 dB-Hz and loses every other signal.
    pull_in: LoopSettings = LoopSettings(
        integration=5, pll_bandwidth_hz=15.0, fll_bandwidth_hz=5.0, dll_bandwidth_hz=4.0
    )
    searching_bits: LoopSettings = LoopSettings(integration=5, pll_bandwidth_hz=15.0)
    tracking: LoopSettings = LoopSettings(integration=5, pll_bandwidth_hz=15.0)
    weak: LoopSettings = LoopSettings(integration=20, pll_bandwidth_hz=6.0, dll_bandwidth_hz=0.5)
    weak_dbhz: float = 31.0
    pull_in_s: float = 0.5
    confirm_s: float = 0.8
    false_hold_probability: float = 1e-4
    merge_chips: float = 0.5
    pulled_chips: float = 0.1
    near_search_s: float = 0.5
    full_search_s: float = 10.0
    first_search_s: float = 1.0
    doppler_max_hz: float = 7000.0
    near_doppler_hz: float = 125.0
    search: SearchSettings = SEARCH
    near_search: SearchSettings = NEAR_SEARCH


@dataclass(frozen=True, eq=False, kw_only=True)
class ReceiverState:
    """All that the receiver remembers between two blocks of samples.

    The arrays have a row a channel: loops as in `kernels`; rows and counts of the frame before; the lock value and
    number of prompts of the last frames, NaN before the channel began; where it was when it was last locked (time,
    delay, Doppler). weights : of the antennas, with which `rows` were summed; last_phases : as `antennas.unwrapped`
    gives them, NaN before.
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
    locked_at: Reals = field(default_factory=lambda: np.empty((0, 3)))
    joint: JointStates = field(default_factory=dict)
    lost: tuple[LostSignal, ...] = ()
    letters: Mapping[str, int] = field(default_factory=dict)
    searched: Mapping[str, Mapping[int, float]] = field(default_factory=dict)  # sat -> Doppler bin -> last time
    next_arc: int = 0


@dataclass(frozen=True, eq=False, kw_only=True)
class StepOutput:
    """What a step gives: measurements, the arcs that were followed as they stand, gaps that were bridged, the
    correlation grids that were asked for, and what joint channels say."""

    measurements: Measurements
    arcs: Mapping[int, Arc]
    gaps: tuple[Gap, ...] = ()
    grids: Grids = field(default_factory=Grids.nothing)
    components: tuple[Components, ...] = ()


class Receiver:
    """The unchanging part: settings, code tables, code spectra. `step` carries a `ReceiverState` forward."""

    def __init__(self, rate_hz: float, if_hz: float = 0.0, settings: ReceiverSettings | None = None) -> None:
        self.settings = settings or ReceiverSettings()
        self.rate_hz = rate_hz
        self.if_hz = if_hz
        self.signal = self.settings.signal
        self.searcher = Searcher(self.signal, rate_hz, self.settings.search)
        self.near_searcher = Searcher(self.signal, rate_hz, self.settings.near_search)
        # Early and late are whole steps of the table off the prompt, so that all three are rounded alike.
        step_chips = self.signal.chip_rate_hz / rate_hz / self.settings.code_phases
        half = step_chips * max(round(0.5 * self.settings.early_late_chips / step_chips), 1)
        self.discriminator = discriminator(self.signal.chip_rate_hz / rate_hz, 2.0 * half)
        further = np.array(self.settings.further_taps_chips)
        if self.settings.looks_per_frame:  # what is compared within a look has to be rounded alike
            further = step_chips * np.rint(further / step_chips)
        self.taps_chips = np.array([half, 0.0, -half, *further])
        self.taps_hz = np.array([0.0, *self.settings.further_taps_hz])
        self.n_taps = self.taps_chips.size * self.taps_hz.size
        self.n_looks = max(MEASURE_FRAMES * self.settings.looks_per_frame, 1)
        self._look_samples = self.settings.frame_s * rate_hz / max(self.settings.looks_per_frame, 1)
        self._reach_chips = max(REACH_CHIPS, float(np.max(np.abs(self.taps_chips))) + 1.0)
        self._pad = table_pad(self.signal.chip_rate_hz / rate_hz, self._reach_chips)
        self._max_periods = int(self.settings.frame_s / self.signal.period_s) + 4
        self._n_threads = os.cpu_count() or 1
        self._threads = ThreadPoolExecutor(self._n_threads)
        self.grids: GridCorrelator | None = None
        if self.settings.grids is not None:
            self.grids = GridCorrelator(self.settings.grids, rate_hz, if_hz, self.signal, self.settings.code_phases)
        self.joint = JointReceiver(self.signal, rate_hz, if_hz) if self.settings.joint else None
        self._tables: dict[str, NDArray[np.int8]] = {}
        self._stacked: tuple[tuple[str, ...], NDArray[np.int8]] | None = None

    def frame_start(self, frame: int) -> int:
        """Index of the first sample of a frame."""
        return int(np.ceil(frame * self.settings.frame_s * self.rate_hz - 1e-6))

    def step(self, state: ReceiverState, samples: Floats) -> tuple[StepOutput, ReceiverState]:
        """Work on all frames that are complete with these samples, which follow on those before.

        samples : (2, n), or (n_antennas, 2, n) of several antennas that share the sampling clock and the oscillator.
        """
        fresh = samples if samples.ndim == 3 else samples[None]
        known = state.tail if state.tail.shape[-1] else fresh[..., :0]
        state = replace(state, tail=np.ascontiguousarray(np.concatenate([known, fresh], axis=-1)))
        measured = [Measurements.nothing(self.n_looks, self.n_taps, _antennas_measured(state.tail))]
        arcs: dict[int, Arc] = {}
        gaps: list[Gap] = []
        grids: list[Grids] = []
        components: list[Components] = []
        while self.frame_start(state.frame + 1) <= state.tail_start + state.tail.shape[-1]:
            state = self._frame(state, measured, arcs, gaps, grids)
            if self.joint is not None:
                state = self._follow_jointly(self.joint, state, components)
        arcs |= {c.arc: arc_of(c, self.signal) for c in state.channels if c.copy is not None}
        output = StepOutput(
            measurements=Measurements.joined(measured),
            arcs=arcs,
            gaps=tuple(gaps),
            grids=Grids.joined(grids),
            components=tuple(components),
        )
        joint = [one.replica.start for _, one in state.joint.values()]
        keep = int(min([self.frame_start(state.frame), *state.loops[:, k.START].tolist(), *joint]))
        # A copy of what is left, so that the state does not hold on to the whole block.
        return output, replace(state, tail=state.tail[..., keep - state.tail_start :].copy(), tail_start=keep)

    def _frame(
        self,
        state: ReceiverState,
        measured: list[Measurements],
        arcs: dict[int, Arc],
        gaps: list[Gap],
        grids: list[Grids],
    ) -> ReceiverState:
        begin, end = self.frame_start(state.frame), self.frame_start(state.frame + 1)
        state = self._look_for_signals(state, begin)
        before = state
        state = self._advance(state, begin, end)
        state = self._check_locks(state, end)
        if state.frame > 0 and state.frame % MEASURE_FRAMES == 0:
            state = self._measure(state, before, measured, arcs, gaps)
            if self.grids is not None:
                grids += self._take_grids(self.grids, state, measured[-1])
        state = self._steer_slowly(self._read_messages(state, arcs))
        state = self._confirm(state, gaps)
        return replace(self._drop(state, end, arcs), frame=state.frame + 1)

    def _follow_jointly(
        self, joint: JointReceiver, state: ReceiverState, components: list[Components]
    ) -> ReceiverState:
        """Joint channels over the frame that has just been worked on, and new ones on loops whose bits are known."""
        end = self.frame_start(state.frame) - state.tail_start
        found, states = joint.step(state.joint, state.tail[0, :, :end], state.tail_start)
        components += found
        ready = [i for i, c in enumerate(state.channels) if c.copy is not None and state.loops[i, k.BIT_START] >= 0.0]
        if ready:
            fresh = state.tail[0, :, end - round(self.settings.frame_s * self.rate_hz) : end : POWER_STRIDE]
            power = 2.0 * float(np.mean(fresh**2))
            channels = [(state.channels[i].arc, state.channels[i].sat) for i in ready]
            states = joint.begin(states, channels, state.loops[ready], power)
        return replace(state, joint=states)

    # ------------------------------------------------------------------ searching

    def _look_for_signals(self, state: ReceiverState, begin: int) -> ReceiverState:
        """Search one antenna after the other, so that what a faded one misses the next one finds."""
        now_s = state.frame * self.settings.frame_s
        settings = self.settings
        for searcher, every_s, dopplers in (
            (self.searcher, self._full_search_s(state), self._everywhere(state)),
            (self.near_searcher, settings.near_search_s, self._nearby(state, now_s)),
        ):
            antenna = round(now_s / every_s) % state.tail.shape[0]
            samples = state.tail[antenna, :, begin - state.tail_start :]
            if not dopplers or samples.shape[1] < searcher.n_samples:
                continue
            peaks = searcher.search(samples, self.if_hz, dopplers, self._known(state, begin))
            for peak in peaks:
                state = self._start(state, peak, begin, now_s, antenna)
            searched = {sat: dict(bins) for sat, bins in state.searched.items()}
            for sat, grid in dopplers.items():
                searched.setdefault(sat, {}).update({_bin(d): now_s for d in grid})
            state = replace(state, searched=searched)
        return state

    def _full_search_s(self, state: ReceiverState) -> float:
        """How often every Doppler is searched: soon, while a front end may not have come up yet."""
        return self.settings.full_search_s if state.next_arc else self.settings.first_search_s

    def _everywhere(self, state: ReceiverState) -> dict[str, Reals]:
        """Every Doppler of every satellite, when it is time."""
        settings = self.settings
        if state.frame % round(self._full_search_s(state) / settings.frame_s):
            return {}
        step_hz = settings.search.doppler_step_hz
        n = int(settings.doppler_max_hz // step_hz)
        grid = np.arange(-n, n + 1, dtype=np.float64) * step_hz
        return {sat: grid for sat in settings.sats}

    def _nearby(self, state: ReceiverState, now_s: float) -> dict[str, Reals]:
        """Dopplers near those of tracked signals, and of those lost a moment ago."""
        settings = self.settings
        if state.frame == 0 or state.frame % round(settings.near_search_s / settings.frame_s):
            return {}
        step_hz = settings.near_search.doppler_step_hz
        reach = int(settings.near_doppler_hz // step_hz)
        centres: dict[str, set[int]] = {}
        for channel, loop in zip(state.channels, state.loops, strict=True):
            centres.setdefault(channel.sat, set()).add(round((loop[k.FREQUENCY] - self.if_hz) / step_hz))
        for old in state.lost:
            if now_s - old.place.at_s < FORGET_S:
                centres.setdefault(old.sat, set()).add(round(old.place.doppler_hz / step_hz))
        return {
            sat: step_hz * np.array(sorted({c + d for c in found for d in range(-reach, reach + 1)}), np.float64)
            for sat, found in centres.items()
        }

    def _known(self, state: ReceiverState, begin: int) -> dict[str, list[KnownSignal]]:
        """The tracked signals of each satellite, as of sample `begin`."""
        known: dict[str, list[KnownSignal]] = {}
        delays_s, dopplers_hz = self._delay_s(state.loops, begin), state.loops[:, k.FREQUENCY] - self.if_hz
        for channel, delay_s, doppler_hz in zip(state.channels, delays_s.tolist(), dopplers_hz.tolist(), strict=True):
            known.setdefault(channel.sat, []).append(KnownSignal(delay_s=delay_s, doppler_hz=doppler_hz))
        return known

    def _delay_s(self, loops: Reals, begin: int) -> Reals:
        """Of the first start of a code period at or after sample `begin`; loops (..., N_STATE), gives (...)."""
        delay = (loops[..., k.START] - begin) / self.rate_hz - loops[..., k.CHIP] / loops[..., k.CODE_RATE]
        return np.asarray(np.mod(delay, self.signal.period_s))

    def _start(self, state: ReceiverState, peak: Peak, begin: int, now_s: float, antenna: int = 0) -> ReceiverState:
        chips_per_sample = self.signal.chip_rate_hz / self.rate_hz
        first = np.ceil(peak.delay_s * self.rate_hz)
        loop = np.zeros(k.N_STATE)
        loop[k.START] = begin + first
        loop[k.CHIP] = (first - peak.delay_s * self.rate_hz) * chips_per_sample
        loop[k.PLL_VELOCITY] = peak.doppler_hz
        loop[k.FREQUENCY] = self.if_hz + peak.doppler_hz
        loop[k.CODE_RATE] = self.signal.chip_rate_hz * (1.0 + peak.doppler_hz / self.signal.carrier_hz)
        loop[k.BIT_START] = -1.0
        loop[[k.RESIDUAL, k.CODE_MINUS_CARRIER]] = np.nan
        loop[k.CN0_DBHZ] = peak.cn0_dbhz
        _set_loops(loop, self.settings.pull_in)
        missed_s = state.searched.get(peak.sat, {}).get(_bin(peak.doppler_hz), np.nan)
        channel = Channel(sat=peak.sat, began_s=now_s, found_s=now_s, missed_s=missed_s, arc=state.next_arc)
        n_antennas = state.tail.shape[0]
        rows = np.zeros((1, self._max_periods, k.row_size(self.n_taps, n_antennas)))
        weights, last = first_weights(antenna, n_antennas), np.full((1, n_antennas, N_LAST), np.nan)
        old = (state.rows, state.weights, state.last_phases) if state.channels else (rows[:0], weights[:0], last[:0])
        return replace(
            state,
            channels=(*state.channels, channel),
            loops=np.concatenate([state.loops, loop[None]]),
            rows=np.concatenate([old[0], rows]),
            counts=np.append(state.counts, 0),
            weights=np.concatenate([old[1], weights]),
            last_phases=np.concatenate([old[2], last]),
            prompts=(*state.prompts, ()),
            lock=np.concatenate([state.lock, np.full((1, LOCK_FRAMES, 2), np.nan)]),
            locked_at=np.concatenate([state.locked_at, [[now_s, peak.delay_s, peak.doppler_hz]]]),
            next_arc=state.next_arc + 1,
        )

    # ------------------------------------------------------------------ tracking

    def _advance(self, state: ReceiverState, begin: int, end: int) -> ReceiverState:
        n = len(state.channels)
        if n == 0:
            return state
        n_samples, n_antennas = end - state.tail_start, state.tail.shape[0]
        sats, tables = self._stack(tuple(sorted({c.sat for c in state.channels})))
        rows = np.zeros((n, self._max_periods, k.row_size(self.n_taps, n_antennas)))
        counts = np.zeros(n, np.int64)
        loops = state.loops.copy()
        loops[:, [k.LOCK_I, k.LOCK_Q, k.LOCK_COUNT]] = 0.0
        # What noise of the samples' power gives in a correlator, a sample.
        fresh = state.tail[..., begin - state.tail_start : n_samples : POWER_STRIDE]
        powers = np.array([2.0 * float(np.mean(one**2)) * CODE_SCALE**2 for one in fresh])
        power = float(powers.max())
        weights = combining(state.rows, state.weights, powers)
        table_of = np.array([sats.index(c.sat) for c in state.channels])

        def work(part: slice) -> None:
            k.advance(
                state.tail,
                n_samples,
                state.tail_start,
                power,
                weights[part],
                loops[part],
                tables,
                self._pad,
                table_of[part],
                self.taps_chips,
                self.taps_hz,
                self._look_samples,
                self.settings.look_share,
                self.rate_hz,
                self.if_hz,
                self.signal.chip_rate_hz,
                self.signal.carrier_hz,
                self.signal.code_length,
                self.discriminator.gain,
                rows[part],
                counts[part],
            )

        share = -(-n // self._n_threads)
        list(self._threads.map(work, [slice(first, first + share) for first in range(0, n, share)]))
        in_phase = k.OUT_TAPS + 2
        prompts = tuple(
            (*old, rows[i, : counts[i], in_phase].astype(np.float32)) for i, old in enumerate(state.prompts)
        )
        return replace(state, loops=loops, rows=rows, counts=counts, weights=weights, prompts=prompts)

    def _stack(self, sats: tuple[str, ...]) -> tuple[tuple[str, ...], NDArray[np.int8]]:
        if self._stacked is None or self._stacked[0] != sats:
            n = int(np.ceil(self.rate_hz * self.signal.period_s)) + 1
            for sat in sats:
                if sat not in self._tables:
                    self._tables[sat] = code_table(
                        self.signal.code(prn_of(sat)),
                        self.signal.chip_rate_hz / self.rate_hz,
                        self.settings.code_phases,
                        n,
                        self._reach_chips,
                    )
            self._stacked = sats, np.stack([self._tables[sat] for sat in sats])
        return self._stacked

    def _check_locks(self, state: ReceiverState, end: int) -> ReceiverState:
        """Note the lock value of the frame, and where the channels are that hold their signal in it."""
        loops = state.loops
        now = np.stack([lock_value(loops[:, k.LOCK_I], loops[:, k.LOCK_Q]), loops[:, k.LOCK_COUNT]], axis=-1)
        state = replace(state, lock=np.concatenate([state.lock[:, 1:], now[:, None]], axis=1))
        here = np.empty_like(state.locked_at)
        here[:, 0] = (state.frame + 1) * self.settings.frame_s
        here[:, 1] = self._delay_s(loops, end)
        here[:, 2] = loops[:, k.FREQUENCY] - self.if_hz
        return replace(state, locked_at=np.where(self._holds(state, MEASURE_FRAMES)[:, None], here, state.locked_at))

    def _holds(self, state: ReceiverState, n_frames: int) -> Booleans:
        """Whether each channel holds its signal, by its last `n_frames` frames (fewer if it is younger)."""
        value, prompts = state.lock[:, -n_frames:, 0], state.lock[:, -n_frames:, 1]
        there = ~np.isnan(value)
        frames = np.maximum(there.sum(axis=1), 1)
        mean_value = np.sum(value, axis=1, where=there) / frames
        mean_prompts = np.maximum(np.sum(prompts, axis=1, where=there) / frames, 1.0)
        # A short look may err more often: it decides on one row of measurements, not on the channel.
        error = self.settings.false_hold_probability if n_frames == LOCK_FRAMES else 1e-2
        return np.asarray(mean_value > lock_threshold(mean_prompts, frames, error))

    def _measure(
        self,
        state: ReceiverState,
        before: ReceiverState,
        measured: list[Measurements],
        arcs: dict[int, Arc],
        gaps: list[Gap],
    ) -> ReceiverState:
        """A row of measurements for each confirmed channel that holds its signal, at the start of the frame."""
        settings = self.settings
        n = len(state.channels)
        if n == 0:
            return state
        elapsed_s = state.frame * settings.frame_s
        loops = state.loops.copy()
        # Both are of no other state, so that they may be worked on in place.
        earlier, later = (before.rows.copy(), before.counts), (state.rows, state.counts)
        error_chips = separated(
            [c.sat for c in state.channels],
            earlier,
            later,
            (before.weights, state.weights),
            taps_chips=self.taps_chips,
            rate_hz=self.rate_hz,
            if_hz=self.if_hz,
            signal=self.signal,
            code_gain=self.discriminator.gain,
        )
        table, taps, wipe = m.measure(
            loops, earlier, later, elapsed_s, self.rate_hz, self.if_hz, self.signal, self.discriminator
        )
        steer = np.where(np.isfinite(error_chips), STEER_SHARE * error_chips, 0.0)
        loops[:, k.CODE_STEER] = steer / (MEASURE_FRAMES * settings.frame_s)
        good = self._holds(state, MEASURE_FRAMES) & np.isfinite(table[:, m.FRACTION_S])
        # Telling fast what the strength is matters while it is not known; later, what it is on average.
        share = np.where(np.isfinite(loops[:, k.CODE_MINUS_CARRIER]), 0.2, 1.0)
        loops[good, k.CN0_DBHZ] += (share * (table[:, m.CN0_DBHZ] - loops[:, k.CN0_DBHZ]))[good]
        confirmed = np.array([c.copy is not None for c in state.channels])
        loops[good | ~confirmed, k.SLIPPED] = 0.0
        state = replace(state, loops=loops)
        jumped = good & (table[:, m.JUMP] > JUMP_SIGMAS)
        if jumped.sum() >= GAP_VOTES and jumped.sum() > 0.7 * good.sum():
            gaps.append(Gap(elapsed_s=elapsed_s, shift_s=0.0, signals=int(jumped.sum())))
            state = replace(state, last_phases=np.full_like(state.last_phases, np.nan))
            return self._forget_time(state, arcs)
        state = self._end_diverged_arcs(state, table, good, elapsed_s, arcs)
        good &= confirmed
        own, last_phases = self._on_each_antenna(state, earlier, later, taps, wipe, good, elapsed_s)
        numbers = np.array([c.arc for c in state.channels], np.int64)
        looks = taps[:, np.newaxis, : self.n_taps]
        if settings.looks_per_frame:
            looks = look_means(
                earlier,
                later,
                wipe,
                n_looks=self.n_looks,
                look_samples=self._look_samples,
                epoch_samples=elapsed_s * self.rate_hz,
                n_taps=self.n_taps,
            )
        of_all = Measurements(elapsed_s=np.full(n, elapsed_s), arc=numbers, table=table, taps=looks, own=own)
        measured.append(of_all.chosen(good))
        return replace(state, last_phases=last_phases)

    def _take_grids(self, grids: GridCorrelator, state: ReceiverState, row: Measurements) -> list[Grids]:
        """Of the channels that were just measured, if it is time."""
        elapsed_s = state.frame * self.settings.frame_s
        channels = [i for i, channel in enumerate(state.channels) if channel.arc in row.arc]
        if not channels or row.elapsed_s[0] != elapsed_s:
            return []
        interval_s = MEASURE_FRAMES * self.settings.frame_s
        soon = at_stake(row.column(m.CN0_DBHZ), state.loops[channels, k.CN0_DBHZ], interval_s)
        if not grids.due(state.frame, self.settings.frame_s, soon=soon):
            return []
        return [
            grids.take(
                state.tail[0],
                state.tail_start,
                (state.rows[channels], state.counts[channels]),
                state.loops[channels, k.BIT_START],
                [state.channels[i].sat for i in channels],
                np.array([state.channels[i].arc for i in channels], np.int64),
                elapsed_s,
                self._threads,
                self._n_threads,
            )
        ]

    def _on_each_antenna(
        self,
        state: ReceiverState,
        earlier: Rows,
        later: Rows,
        taps: ComplexFloats,
        wipe: Complexes,
        good: Booleans,
        elapsed_s: float,
    ) -> tuple[Reals, Reals]:
        """What each of several antennas measures beside their sum, and the phases to go on from."""
        n_antennas = state.tail.shape[0]
        if n_antennas == 1:
            return np.empty((good.size, _antennas_measured(state.tail), m.N_OWN)), state.last_phases
        own = measure_antennas(
            earlier,
            later,
            wipe,
            taps,
            elapsed_s,
            n_antennas,
            self.rate_hz,
            self.signal.period_s,
            self.signal.chip_rate_hz,
            self.discriminator,
            self.settings.false_hold_probability,
        )
        interval_s = MEASURE_FRAMES * self.settings.frame_s
        return own, unwrapped(own, state.last_phases, good, interval_s)

    def _forget_time(self, state: ReceiverState, arcs: dict[int, Arc]) -> ReceiverState:
        """New arcs for all channels, with bits and time of week to be found anew.

        Samples that are missing shift both by the same unknown time; if whole code periods are missing nothing but the
        phases of the carriers shows it. If none are missing after all, nothing is lost: an arc's time, once read, holds
        from its beginning.
        """
        channels, loops = list(state.channels), state.loops.copy()
        loops[:, k.BIT_START] = -1.0
        loops[:, [k.RESIDUAL, k.CODE_MINUS_CARRIER]] = np.nan
        number = state.next_arc
        for i, channel in enumerate(channels):
            if channel.copy is not None:
                arcs[channel.arc] = arc_of(channel, self.signal)
                channel = replace(channel, arc=number, began="after a gap")
                number += 1
            channels[i] = replace(channel, telemetry=tm.Telemetry())
        return replace(state, channels=tuple(channels), loops=loops, next_arc=number)

    def _end_diverged_arcs(
        self, state: ReceiverState, table: Reals, good: Booleans, elapsed_s: float, arcs: dict[int, Arc]
    ) -> ReceiverState:
        """End the arc of a channel whose code has left its carrier: it was pulled to another signal's peak.

        On one signal code minus carrier moves with the ionosphere only, millimetres a second.
        """
        loops, channels = state.loops.copy(), list(state.channels)
        code_s = table[:, m.PERIODS] * self.signal.period_s - elapsed_s + table[:, m.FRACTION_S]
        apart_s = code_s + table[:, m.CARRIER_CYC] / self.signal.carrier_hz
        reference = loops[:, k.CODE_MINUS_CARRIER]
        limit_s = np.maximum(self.settings.pulled_chips / self.signal.chip_rate_hz, 6.0 * table[:, m.CODE_SIGMA_S])
        new = good & ~np.isfinite(reference)
        pulled = good & (np.abs(apart_s - reference) > limit_s)
        loops[good, k.CODE_MINUS_CARRIER] += 0.02 * (apart_s - reference)[good]
        loops[new | pulled, k.CODE_MINUS_CARRIER] = apart_s[new | pulled]
        number = state.next_arc
        for i in np.flatnonzero(pulled):
            if channels[i].copy is not None:
                arcs[channels[i].arc] = arc_of(channels[i], self.signal)
                channels[i] = replace(channels[i], arc=number, began="pulled away")
                number += 1
        return replace(state, loops=loops, channels=tuple(channels), next_arc=number)

    def _read_messages(self, state: ReceiverState, arcs: dict[int, Arc]) -> ReceiverState:
        """Telemetry every few frames, of channels past their pull-in; tells the loops where bits begin.

        A time of week that moves against the code periods counted means that samples are missing: a new arc.
        """
        if (state.frame + 1) % TELEMETRY_FRAMES:
            return state
        now_s = (state.frame + 1) * self.settings.frame_s
        channels, loops = list(state.channels), state.loops.copy()
        prompts = list(state.prompts)
        number = state.next_arc
        for i, channel in enumerate(channels):
            new = np.concatenate(prompts[i])
            prompts[i] = ()
            if new.size == 0 or now_s - channel.began_s <= self.settings.pull_in_s:
                continue
            first = int(loops[i, k.PERIODS]) - new.size
            told_ms = channel.telemetry.tow_ms_at_period_0
            telemetry = tm.step(channel.telemetry, new, first)
            loops[i, k.BIT_START] = (
                float(telemetry.bits_period % tm.PERIODS_PER_BIT) if telemetry.synchronised else -1.0
            )
            if channel.copy is not None and told_ms is not None and told_ms != telemetry.tow_ms_at_period_0:
                arcs[channel.arc] = arc_of(channel, self.signal)
                channel = replace(channel, arc=number, began="after a gap")
                number += 1
            channels[i] = replace(channel, telemetry=telemetry)
        return replace(state, channels=tuple(channels), loops=loops, prompts=tuple(prompts), next_arc=number)

    def _steer_slowly(self, state: ReceiverState) -> ReceiverState:
        """Integration and bandwidths by what is known of each channel."""
        settings = self.settings
        now_s = (state.frame + 1) * settings.frame_s
        loops = state.loops.copy()
        for channel, loop in zip(state.channels, loops, strict=True):
            if now_s - channel.began_s < settings.pull_in_s - 1e-9:
                choice = settings.pull_in
            elif loop[k.BIT_START] < 0.0:
                choice = settings.searching_bits
            else:
                is_weak = loop[k.INTEGRATION] == settings.weak.integration
                limit = settings.weak_dbhz + (2.0 if is_weak else 0.0)
                choice = settings.weak if loop[k.CN0_DBHZ] < limit else settings.tracking
            if choice is settings.pull_in:
                loop[k.CODE_STEER] = 0.0
            elif loop[k.CODE_STEER] != 0.0:  # the measurement steers, which knows what of the error is another signal's
                choice = replace(choice, dll_bandwidth_hz=0.0)
            _set_loops(loop, choice)
        return replace(state, loops=loops)

    # ------------------------------------------------------------------ which channels stay

    def _confirm(self, state: ReceiverState, gaps: list[Gap]) -> ReceiverState:
        """Give channels that have proved themselves a letter: that of a lost signal they continue, or the next one."""
        if all(channel.copy is not None for channel in state.channels):
            return state
        end_s = (state.frame + 1) * self.settings.frame_s
        holds = self._holds(state, LOCK_FRAMES)
        due = [
            i
            for i, channel in enumerate(state.channels)
            if channel.copy is None and holds[i] and end_s - channel.began_s >= self.settings.confirm_s - 1e-9
        ]
        if not due:
            return state
        letters, channels = dict(state.letters), list(state.channels)
        places = [(channels[i].sat, _place(state.locked_at[i])) for i in due]
        matches, gap = continued(state.lost, places, self.signal)
        if gap is not None:
            gaps.append(gap)
        for i, old in zip(due, matches, strict=True):
            channel = channels[i]
            if old is not None:
                channels[i] = replace(
                    channel, copy=old.copy, found_s=old.found_s, missed_s=old.missed_s, began="found again"
                )
            else:
                number = letters.get(channel.sat, 0)
                letters[channel.sat] = number + 1
                channels[i] = replace(channel, copy=letter(number))
        lost = tuple(old for old in state.lost if not any(old is match for match in matches))
        return replace(state, channels=tuple(channels), letters=letters, lost=lost)

    def _drop(self, state: ReceiverState, end: int, arcs: dict[int, Arc]) -> ReceiverState:
        """Let go of channels that never locked, lost lock, or fell on the signal of another channel."""
        end_s = (state.frame + 1) * self.settings.frame_s
        holds = self._holds(state, LOCK_FRAMES)
        doubles = self._doubles(state, end)
        lost = tuple(old for old in state.lost if end_s - old.place.at_s < FORGET_S)
        if holds.all() and not doubles:
            return replace(state, lost=lost) if lost != state.lost else state
        stay: list[int] = []
        for i, channel in enumerate(state.channels):
            is_young = end_s - channel.began_s < self.settings.confirm_s - 1e-9
            if i not in doubles and (is_young or holds[i]):
                stay.append(i)
            elif channel.copy is not None:
                arcs[channel.arc] = arc_of(channel, self.signal)
                gone = LostSignal(
                    sat=channel.sat,
                    copy=channel.copy,
                    found_s=channel.found_s,
                    missed_s=channel.missed_s,
                    place=_place(state.locked_at[i]),
                )
                lost = (*lost, gone)
        return replace(
            state,
            channels=tuple(state.channels[i] for i in stay),
            loops=state.loops[stay],
            rows=state.rows[stay],
            counts=state.counts[stay],
            weights=state.weights[stay],
            last_phases=state.last_phases[stay],
            prompts=tuple(state.prompts[i] for i in stay),
            lock=state.lock[stay],
            locked_at=state.locked_at[stay],
            lost=lost,
        )

    def _doubles(self, state: ReceiverState, end: int) -> set[int]:
        """Channels that follow the signal of another one of their satellite, which has the better right to it: it was
        not pulled there, or is older.
        """
        delays_s, hz = self._delay_s(state.loops, end).tolist(), state.loops[:, k.FREQUENCY].tolist()
        of_sat: dict[str, list[int]] = {}
        for i, channel in enumerate(state.channels):
            of_sat.setdefault(channel.sat, []).append(i)
        doubles = set()
        for numbers in of_sat.values():
            by_right = sorted(numbers, key=lambda i: (state.channels[i].began == "pulled away", i))
            for place, i in enumerate(by_right):
                for j in by_right[:place]:
                    apart_s = math.remainder(delays_s[i] - delays_s[j], self.signal.period_s)
                    same_hz = abs(hz[i] - hz[j]) < MERGE_HZ
                    if same_hz and abs(apart_s) * self.signal.chip_rate_hz < self.settings.merge_chips:
                        doubles.add(i)
        return doubles


def _set_loops(loop: Reals, choice: LoopSettings) -> None:
    loop[k.INTEGRATION] = choice.integration
    loop[k.PLL_BANDWIDTH] = choice.pll_bandwidth_hz
    loop[k.FLL_BANDWIDTH] = choice.fll_bandwidth_hz
    loop[k.DLL_BANDWIDTH] = choice.dll_bandwidth_hz


def _antennas_measured(tail: Floats) -> int:
    """Antennas that are measured beside their sum: none where there is one."""
    return tail.shape[0] if tail.shape[0] > 1 else 0


def _bin(doppler_hz: float) -> int:
    return round(doppler_hz / DOPPLER_BIN_HZ)


def _place(locked_at: Reals) -> Place:
    at_s, delay_s, doppler_hz = locked_at.tolist()
    return Place(at_s=at_s, delay_s=delay_s, doppler_hz=doppler_hz)
