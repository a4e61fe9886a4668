"""The receiver as a step: samples in, measurements out, everything it remembers in an explicit state.

Samples are worked on in frames of a tenth of a second counted from the first sample, whatever blocks they come in: any
cut of the recording gives the same result. Each frame searches for new signals when it is time, advances all channels
by one kernel call, controls locks and reads telemetry. Every second frame measures a row for each channel.
"""

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Booleans, Complexes, ComplexFloats, Floats, Reals
from skyproof.compiled import count_threads
from skyproof.gnss.signals import prn_of
from skyproof.receiver import kernels as k
from skyproof.receiver import measurement as m
from skyproof.receiver.acquisition import Peak
from skyproof.receiver.antennas import (
    compute_weights,
    find_first_prompt,
    measure_antennas,
    subtract_by_antenna,
    unwrap_phases,
)
from skyproof.receiver.channels import Arc, arc_from_channel
from skyproof.receiver.coasting import SINCE_S, coast, has_power, update_courses
from skyproof.receiver.correlator import REACH_CHIPS, table_pad
from skyproof.receiver.crosstalk import Rows
from skyproof.receiver.discriminator import compute_discriminator
from skyproof.receiver.false_lock import leave_false_locks
from skyproof.receiver.gaps import look_for_gap
from skyproof.receiver.grids import GridCorrelator, Grids, is_disturbed
from skyproof.receiver.guidance import DOPPLER_HZ as GUIDED_DOPPLER_HZ
from skyproof.receiver.guidance import SINCE_S as GUIDED_SINCE_S
from skyproof.receiver.guidance import guide_loops, is_guided
from skyproof.receiver.keeping import (
    StepCollector,
    confirm,
    drop,
    end_diverged_arcs,
    forget_time,
    holds_signal,
    read_messages,
)
from skyproof.receiver.lock import lock_value
from skyproof.receiver.looking import Lookout, delay_s
from skyproof.receiver.looks import average_looks, measure_turns
from skyproof.receiver.measurement import Measurements
from skyproof.receiver.noncoherent import measure_without_phase
from skyproof.receiver.replica import CODE_SCALE, code_table
from skyproof.receiver.settings import MEASURE_FRAMES, LoopSettings, ReceiverSettings
from skyproof.receiver.state import ReceiverState, StepOutput
from skyproof.receiver.steering import steer

__all__ = ["MEASURE_FRAMES", "LoopSettings", "Receiver", "ReceiverSettings", "ReceiverState", "StepOutput"]

STEER_SHARE = 0.5
"""Of a measured error of code by which it is steered until the next measurement: 0.8 Hz of noise bandwidth."""
POWER_STRIDE = 61
"""Every so many samples tell the level of a frame, to a per cent or better."""


class Receiver:
    """The unchanging part: settings, code tables, code spectra. `step` carries a `ReceiverState` forward."""

    def __init__(self, rate_hz: float, if_hz: float = 0.0, settings: ReceiverSettings | None = None) -> None:
        self.settings = settings or ReceiverSettings()
        self.rate_hz = rate_hz
        self.if_hz = if_hz
        self.signal = self.settings.signal
        self._lookout = Lookout(rate_hz, if_hz, self.settings)
        # Early and late are whole steps of the table off the prompt, so that all three are rounded alike.
        step_chips = self.signal.chip_rate_hz / rate_hz / self.settings.code_phases
        half = step_chips * max(round(0.5 * self.settings.early_late_chips / step_chips), 1)
        self.discriminator = compute_discriminator(self.signal.chip_rate_hz / rate_hz, 2.0 * half)
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
        self._n_threads = count_threads()
        self._threads = ThreadPoolExecutor(self._n_threads)
        self.grids: GridCorrelator | None = None
        if self.settings.grids is not None:
            self.grids = GridCorrelator(self.settings.grids, rate_hz, if_hz, self.signal, self.settings.code_phases)
        self._tables: dict[str, NDArray[np.int8]] = {}
        self._stacked: tuple[tuple[str, ...], NDArray[np.int8]] | None = None

    def frame_start(self, frame: int) -> int:
        """Return the index of the first sample of a frame."""
        return int(np.ceil(frame * self.settings.frame_s * self.rate_hz - 1e-6))

    def start_channel(self, state: ReceiverState, peak: Peak) -> ReceiverState:
        """Start a channel on a peak at the first sample, as if a search had found it on the first antenna."""
        return self._lookout.start_channel(state, peak, 0, 0.0, 0, self._rows_shape(state))

    def _rows_shape(self, state: ReceiverState) -> tuple[int, int]:
        """Return the shape of the kernel's output of a channel in a frame."""
        return self._max_periods, k.row_size(self.n_taps, state.tail.shape[0])

    def step(self, state: ReceiverState, samples: Floats) -> tuple[StepOutput, ReceiverState]:
        """Process all frames that are complete with these samples, which follow those before.

        samples : (2, n), or (n_antennas, 2, n) of several antennas that share the sampling clock and the oscillator.
        """
        fresh = samples if samples.ndim == 3 else samples[None]
        known = state.tail if state.tail.shape[-1] else fresh[..., :0]
        state = replace(state, tail=np.ascontiguousarray(np.concatenate([known, fresh], axis=-1)))
        nothing = Measurements.nothing(self.n_looks, self.n_taps, _count_measured_antennas(state.tail))
        collector = StepCollector(measured=[nothing])
        if self.grids is not None:
            collector.grids.append(self.grids.nothing())
        while self.frame_start(state.frame + 1) <= state.tail_start + state.tail.shape[-1]:
            state = self._run_frame(state, collector)
        arcs: dict[int, Arc] = collector.arcs | {
            c.arc: arc_from_channel(c, self.signal) for c in state.channels if c.copy is not None
        }
        output = StepOutput(
            measurements=Measurements.join(collector.measured),
            arcs=arcs,
            gaps=tuple(collector.gaps),
            grids=Grids.join(collector.grids),
            noncoherent=Measurements.join([nothing, *collector.noncoherent]),
        )
        keep = int(min([self.frame_start(state.frame), *state.loops[:, k.START].tolist()]))
        # A copy of what is left, so that the state does not hold on to the whole block.
        return output, replace(state, tail=state.tail[..., keep - state.tail_start :].copy(), tail_start=keep)

    def set_guides(self, state: ReceiverState, guides: Mapping[int, Reals]) -> ReceiverState:
        """Set new guides (N_GUIDE,) of these arcs; the others keep theirs until it lapses.

        A guide's column `SINCE_S` is not used. Guides must come after a row of measurements, before the next frame.
        """
        now_s = state.frame * self.settings.frame_s
        before, after = is_guided(state.guides, now_s), state.guides.copy()
        for i, channel in enumerate(state.channels):
            if channel.arc in guides:
                after[i] = guides[channel.arc]
                after[i, GUIDED_SINCE_S] = state.guides[i, GUIDED_SINCE_S] if before[i] else now_s
        return self._follow_guides(replace(state, guides=after), now_s)

    def _follow_guides(self, state: ReceiverState, now_s: float) -> ReceiverState:
        if not np.isfinite(state.guides).any():
            return state
        unseen = np.isfinite(state.courses[:, SINCE_S]) | ~holds_signal(state, MEASURE_FRAMES, self.settings)
        loops, guides = guide_loops(
            state.loops,
            state.guides,
            unseen,
            now_s,
            frame_s=self.settings.frame_s,
            rate_hz=self.rate_hz,
            if_hz=self.if_hz,
            signal=self.signal,
        )
        return replace(state, loops=loops, guides=guides)

    def _run_frame(self, state: ReceiverState, given: StepCollector) -> ReceiverState:
        begin, end = self.frame_start(state.frame), self.frame_start(state.frame + 1)
        end_s = (state.frame + 1) * self.settings.frame_s
        state = self._lookout.look(state, begin, self._rows_shape(state))
        before = state
        state = self._advance(state, begin, end)
        state = self._check_locks(state, end)
        if state.frame > 0 and state.frame % MEASURE_FRAMES == 0:
            state = self._measure(state, before, given)
            if self.grids is not None:
                given.grids += self._take_grids(self.grids, state, given.measured[-1])
        state = read_messages(state, self.settings, given)
        state = self._follow_guides(steer(state, self.settings, end_s), end_s)
        state = confirm(state, self.settings, given)
        state = drop(state, self._delay_s(state.loops, end), self.settings, given)
        return replace(state, frame=state.frame + 1)

    def _delay_s(self, loops: Reals, begin: int) -> Reals:
        return delay_s(loops, begin, self.rate_hz, self.signal.period_s)

    def _advance(self, state: ReceiverState, begin: int, end: int) -> ReceiverState:
        n = len(state.channels)
        if n == 0:
            return state
        n_samples, n_antennas = end - state.tail_start, state.tail.shape[0]
        sats, tables = self._stack_tables(tuple(sorted({c.sat for c in state.channels})))
        rows = np.zeros((n, self._max_periods, k.row_size(self.n_taps, n_antennas)))
        counts = np.zeros(n, np.int64)
        loops = state.loops.copy()
        loops[:, [k.LOCK_I, k.LOCK_Q, k.LOCK_COUNT]] = 0.0
        # What noise of the samples' power gives in a correlator, a sample.
        fresh = state.tail[..., begin - state.tail_start : n_samples : POWER_STRIDE]
        powers = np.array([2.0 * float(np.mean(plane**2)) * CODE_SCALE**2 for plane in fresh])
        power = float(powers.max())
        weights = compute_weights(state.rows, state.weights, powers)
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
        noise = power * self.rate_hz * self.signal.period_s
        return replace(state, loops=loops, rows=rows, counts=counts, weights=weights, prompts=prompts, noise=noise)

    def _stack_tables(self, sats: tuple[str, ...]) -> tuple[tuple[str, ...], NDArray[np.int8]]:
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
        """Update locks: let channels coast whose signal has faded, and note the frame's lock value of the others.

        Also note where those are that hold their signal in it.
        """
        settings, loops = self.settings, state.loops
        end_s = (state.frame + 1) * settings.frame_s
        received = has_power(loops, state.noise, settings.false_return_probability)
        now = np.stack([lock_value(loops[:, k.LOCK_I], loops[:, k.LOCK_Q]), loops[:, k.LOCK_COUNT]], axis=-1)
        lock = np.concatenate([state.lock[:, 1:], now[:, None]], axis=1)
        coasted = np.isfinite(state.courses[:, SINCE_S])  # in this frame: when its signal is back, its phase is not yet
        nominal = self.signal.chip_rate_hz, self.signal.carrier_hz
        loops, courses = coast(loops, state.courses, received, end_s, self.if_hz, nominal, settings.pull_in_s)
        lock[coasted | np.isfinite(courses[:, SINCE_S])] = np.nan
        state = replace(state, loops=loops, courses=courses, lock=lock)
        now_at = np.empty_like(state.locked_at)
        now_at[:, 0] = end_s
        now_at[:, 1] = self._delay_s(loops, end)
        now_at[:, 2] = loops[:, k.FREQUENCY] - self.if_hz
        ahead_s = (loops[:, k.START] - end) / self.rate_hz - loops[:, k.CHIP] / loops[:, k.CODE_RATE]
        now_at[:, 3] = loops[:, k.PERIODS] + np.rint((now_at[:, 1] - ahead_s) / self.signal.period_s)
        held = received & holds_signal(state, MEASURE_FRAMES, settings)
        return replace(state, locked_at=np.where(held[:, None], now_at, state.locked_at))

    def _measure(self, state: ReceiverState, before: ReceiverState, given: StepCollector) -> ReceiverState:
        """Measure a row for each confirmed channel that holds its signal, at the start of the frame."""
        settings = self.settings
        n = len(state.channels)
        if n == 0:
            return state
        elapsed_s = state.frame * settings.frame_s
        loops = state.loops.copy()
        # Both are of no other state, so that they may be worked on in place.
        earlier, later = (before.rows.copy(), before.counts), (state.rows, state.counts)
        error_chips = subtract_by_antenna(
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
        good = holds_signal(state, MEASURE_FRAMES, settings) & np.isfinite(table[:, m.FRACTION_S])
        good &= np.isfinite(state.lock[:, -MEASURE_FRAMES:, 0]).all(axis=1)
        # Telling fast what the strength is matters while it is not known; later, what it is on average.
        share = np.where(np.isfinite(loops[:, k.CODE_MINUS_CARRIER]), 0.2, 1.0)
        loops[good, k.CN0_DBHZ] += (share * (table[:, m.CN0_DBHZ] - loops[:, k.CN0_DBHZ]))[good]
        good &= loops[:, k.CN0_DBHZ] > settings.least_dbhz
        turning, loops, turns = leave_false_locks(loops, state.turns, (earlier, later), good, self.signal)
        good &= ~turning
        proved = np.array([c.copy is not None for c in state.channels])
        loops[good | ~proved, k.SLIPPED] = 0.0
        courses = update_courses(state.courses, table[:, m.DOPPLER_HZ], good & proved, elapsed_s)
        state = replace(state, loops=loops, courses=courses, turns=turns)
        look, state = look_for_gap(state, table, good, (earlier, later), elapsed_s, settings, self.if_hz)
        if look.gap is not None:
            given.gaps.append(look.gap)
        if look.gap is not None or look.untimed:
            return forget_time(state, self.signal, given)
        state = end_diverged_arcs(state, table, good, elapsed_s, settings, given)
        if look.withheld:
            loops = state.loops.copy()
            loops[good, k.SLIPPED] = 1.0
            return replace(state, loops=loops)
        good &= proved
        per_antenna, last_phases = self._measure_antennas(state, earlier, later, taps, wipe, good, elapsed_s)
        numbers = np.array([c.arc for c in state.channels], np.int64)
        looks, first_power = taps[:, np.newaxis, : self.n_taps], np.empty((n, 0))
        if settings.looks_per_frame:
            which: Any = {
                "n_looks": self.n_looks,
                "look_samples": self._look_samples,
                "epoch_samples": elapsed_s * self.rate_hz,
                "n_taps": self.n_taps,
            }
            looks = average_looks(earlier, later, wipe, **which)
            if n_antennas := _count_measured_antennas(state.tail):
                columns = find_first_prompt(later[0], n_antennas), 1
                prompt = average_looks(earlier, later, wipe, columns=columns, **which)[..., 0]
                first_power = np.asarray(np.abs(prompt) ** 2, np.float64)
        turns = self._measure_turns(state, before, wipe, elapsed_s)
        of_all = Measurements(
            elapsed_s=np.full(n, elapsed_s),
            arc=numbers,
            table=table,
            taps=looks,
            own=per_antenna,
            turns_rad=turns,
            first_power=first_power,
        )
        given.measured.append(of_all.select(good))
        given.noncoherent.append(self._measure_noncoherent(state, of_all, taps, (earlier, later), proved & ~good))
        return replace(state, last_phases=last_phases)

    def _measure_noncoherent(
        self,
        state: ReceiverState,
        of_all: Measurements,
        taps: ComplexFloats,
        frames: tuple[Rows, Rows],
        among: Booleans,
    ) -> Measurements:
        """Measure the guided channels among these that do not hold a phase."""
        guided = is_guided(state.guides, state.frame * self.settings.frame_s)
        table = measure_without_phase(
            of_all.table,
            taps,
            frames,
            state.loops[:, k.BIT_START],
            np.where(among & guided, state.guides[:, GUIDED_DOPPLER_HZ], np.nan),
            state.noise,
            rate_hz=self.rate_hz,
            if_hz=self.if_hz,
            signal=self.signal,
            discriminator=self.discriminator,
            probability=self.settings.false_return_probability,
        )
        return replace(of_all, table=table).select(np.isfinite(table[:, m.DOPPLER_HZ]))

    def _measure_turns(self, state: ReceiverState, before: ReceiverState, wipe: Complexes, elapsed_s: float) -> Reals:
        """Return by how much the correlators of each look were turned to remove the carrier; NaN where not guided."""
        turns = np.full((len(state.channels), self.n_looks), np.nan)
        since_s = state.guides[:, GUIDED_SINCE_S]
        guided = is_guided(state.guides, elapsed_s) & (
            since_s < elapsed_s - 0.5 * MEASURE_FRAMES * self.settings.frame_s + 1e-9
        )
        if self.settings.looks_per_frame and guided.any():
            found = measure_turns(
                (before.rows, before.counts),
                (state.rows, state.counts),
                wipe,
                n_looks=self.n_looks,
                look_samples=self._look_samples,
                epoch_samples=elapsed_s * self.rate_hz,
                n_taps=self.n_taps,
            )
            turns[guided] = found[guided]
        return turns

    def _take_grids(self, grids: GridCorrelator, state: ReceiverState, row: Measurements) -> list[Grids]:
        """Compute the grids of the channels that were just measured, if it is time."""
        elapsed_s = state.frame * self.settings.frame_s
        channels = [i for i, channel in enumerate(state.channels) if channel.arc in row.arc]
        if not channels or row.elapsed_s[0] != elapsed_s:
            return []
        interval_s = MEASURE_FRAMES * self.settings.frame_s
        soon = is_disturbed(row.column(m.CN0_DBHZ), state.loops[channels, k.CN0_DBHZ], interval_s)
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

    def _measure_antennas(
        self,
        state: ReceiverState,
        earlier: Rows,
        later: Rows,
        taps: ComplexFloats,
        wipe: Complexes,
        good: Booleans,
        elapsed_s: float,
    ) -> tuple[Reals, Reals]:
        """Measure each of several antennas beside their sum; also return the phases to continue from."""
        n_antennas = state.tail.shape[0]
        if n_antennas == 1:
            return np.empty((good.size, _count_measured_antennas(state.tail), m.N_OWN)), state.last_phases
        per_antenna = measure_antennas(
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
        return per_antenna, unwrap_phases(per_antenna, state.last_phases, good, interval_s)


def _count_measured_antennas(tail: Floats) -> int:
    """Return the number of antennas measured beside their sum: none where there is one."""
    return tail.shape[0] if tail.shape[0] > 1 else 0
