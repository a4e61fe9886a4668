"""The receiver as a step: samples in, measurements out, everything it remembers in an explicit state.

Samples are worked on in frames of a tenth of a second counted from the first sample, whatever blocks they come in: any
cut of the recording gives the same result. Each frame: search for new signals when it is time, one kernel call that
advances all channels, telemetry, lock control, and at every second frame a row of measurements.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from skyproof.gnss.lnav import Subframe
from skyproof.gnss.signals import GPS_L1_CA, GPS_SATS, SignalDescription, prn_of
from skyproof.receiver import kernels as k
from skyproof.receiver import telemetry as tm
from skyproof.receiver.acquisition import Peak, Searcher, SearchSettings
from skyproof.receiver.measurement import Measurement, measure
from skyproof.records import SignalId

FORGET_S = 30.0
"""A lost signal that is found again within this time, near its old delay, keeps its letter."""


@dataclass(frozen=True, kw_only=True)
class ReceiverSettings:
    """How the receiver works. Times in seconds of receiver time.

    early_late_chips : spacing between early and late tap.
    pull_in_s : how long the frequency loop helps; confirm_s : after that time a channel must be locked or is dropped.
    min_lock : mean of (I^2 - Q^2)/(I^2 + Q^2) that counts as locked: 0.4 is met above about 28 dB-Hz.
    near_search_s, full_search_s : how often further signals are looked for near the Doppler of tracked ones, and
        of all satellites at every Doppler.
    """

    signal: SignalDescription = GPS_L1_CA
    sats: tuple[str, ...] = GPS_SATS
    frame_s: float = 0.1
    early_late_chips: float = 0.25
    code_phases: int = 32
    pll_bandwidth_hz: float = 15.0
    fll_bandwidth_hz: float = 8.0
    dll_bandwidth_hz: float = 1.0
    dll_pull_in_hz: float = 4.0
    pull_in_s: float = 0.5
    confirm_s: float = 0.8
    min_lock: float = 0.4
    lose_after_s: float = 0.5
    merge_chips: float = 0.5
    near_search_s: float = 0.5
    full_search_s: float = 5.0
    doppler_max_hz: float = 7000.0
    near_doppler_hz: float = 1000.0
    search: SearchSettings = field(default_factory=SearchSettings)


@dataclass(frozen=True, eq=False, kw_only=True)
class Channel:
    """One tracked signal: what is known of it beside its loops.

    copy is None until the channel is confirmed. missed_s is NaN if the first search found it.
    """

    sat: str
    began_s: float
    found_s: float
    missed_s: float
    arc: int
    copy: str | None = None
    lock: float = 1.0
    unlocked_frames: int = 0
    telemetry: tm.Telemetry = field(default_factory=tm.Telemetry)


@dataclass(frozen=True, eq=False, kw_only=True)
class LostSignal:
    """A confirmed signal that is not tracked at the moment; found again near its old delay it keeps its letter."""

    sat: str
    copy: str
    found_s: float
    missed_s: float
    lost_s: float
    delay_s: float  # of the code period's start after the frame's start, at lost_s
    doppler_hz: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Arc:
    """A stretch of uninterrupted tracking: which signal, and what its message told (as of the last frame)."""

    signal: SignalId
    found_s: float
    missed_s: float
    tow_ms_at_period_0: int | None
    bit_synchronised: bool
    bits_period: int
    subframes: Mapping[int, Subframe]


@dataclass(frozen=True, eq=False, kw_only=True)
class ReceiverState:
    """All that the receiver remembers between two blocks of samples."""

    tail: NDArray[np.float32] = field(default_factory=lambda: np.empty((2, 0), np.float32))
    tail_start: int = 0
    frame: int = 0
    channels: tuple[Channel, ...] = ()
    loops: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, k.N_STATE)))
    periods: tuple[NDArray[np.float64], ...] = ()  # of the frame before, a channel each
    lost: tuple[LostSignal, ...] = ()
    letters: Mapping[str, int] = field(default_factory=dict)
    searched: Mapping[str, Mapping[int, float]] = field(default_factory=dict)  # sat -> Doppler bin -> last time
    next_arc: int = 0


@dataclass(frozen=True, eq=False, kw_only=True)
class Epoch:
    """The measurements of one moment, by arc."""

    elapsed_s: float
    measurements: Mapping[int, Measurement]


@dataclass(frozen=True, eq=False, kw_only=True)
class StepOutput:
    """What a step gives: new epochs, and the arcs as they stand."""

    epochs: tuple[Epoch, ...]
    arcs: Mapping[int, Arc]


class Receiver:
    """The unchanging part: settings, code tables, code spectra. `step` carries a `ReceiverState` forward."""

    def __init__(self, rate_hz: float, if_hz: float = 0.0, settings: ReceiverSettings | None = None) -> None:
        self.settings = settings or ReceiverSettings()
        self.rate_hz = rate_hz
        self.if_hz = if_hz
        self.signal = self.settings.signal
        self.searcher = Searcher(self.signal, rate_hz, self.settings.search)
        half = 0.5 * self.settings.early_late_chips
        self.taps_chips = np.array([half, 0.0, -half])
        self._tables: dict[str, NDArray[np.int8]] = {}
        self._stacked: tuple[tuple[str, ...], NDArray[np.int8]] | None = None

    def frame_start(self, frame: int) -> int:
        """Index of the first sample of a frame."""
        return int(np.ceil(frame * self.settings.frame_s * self.rate_hz - 1e-6))

    def step(self, state: ReceiverState, samples: NDArray[np.float32]) -> tuple[StepOutput, ReceiverState]:
        """Work on all frames that are complete with these samples, shape (2, n), which follow on those before."""
        state = replace(state, tail=np.concatenate([state.tail, samples], axis=1))
        epochs: list[Epoch] = []
        arcs: dict[int, Arc] = {}
        while self.frame_start(state.frame + 1) <= state.tail_start + state.tail.shape[1]:
            state, epoch, frame_arcs = self._frame(state)
            arcs |= frame_arcs
            if epoch is not None:
                epochs.append(epoch)
        # A copy of what is left, so that the state does not hold on to the whole block.
        return StepOutput(epochs=tuple(epochs), arcs=arcs), replace(state, tail=state.tail.copy())

    def _frame(self, state: ReceiverState) -> tuple[ReceiverState, Epoch | None, dict[int, Arc]]:
        begin, end = self.frame_start(state.frame), self.frame_start(state.frame + 1)
        state = self._look_for_signals(state, begin)
        buffer = state.tail[:, : end - state.tail_start]
        loops, periods = self._advance(state, buffer, begin)
        channels = tuple(
            self._attend(channel, rows, loops[i], state.frame)
            for i, (channel, rows) in enumerate(zip(state.channels, periods, strict=True))
        )
        before = state.periods
        state = replace(state, channels=channels, loops=loops)
        epoch = self._epoch(state, before, periods) if state.frame % 2 == 0 and state.frame > 0 else None
        arcs = {c.arc: _arc(c, self.signal) for c in channels if c.copy is not None}
        state = replace(state, periods=periods)
        state = self._confirm(state, end)
        state = self._drop(state, end)
        keep = int(min([end, *state.loops[:, k.START].tolist()]))
        state = replace(
            state, frame=state.frame + 1, tail=state.tail[:, keep - state.tail_start :], tail_start=keep
        )
        return state, epoch, arcs

    # ------------------------------------------------------------------ searching

    def _look_for_signals(self, state: ReceiverState, begin: int) -> ReceiverState:
        offset = begin - state.tail_start
        if state.tail.shape[1] - offset < self.searcher.n_samples:
            return state
        now_s = state.frame * self.settings.frame_s
        dopplers = self._dopplers(state)
        if not dopplers:
            return state
        peaks = self.searcher.search(
            state.tail[:, offset:], self.if_hz, dopplers, lambda sat: self._known(state, sat, begin)
        )
        for peak in peaks:
            state = self._start(state, peak, begin, now_s)
        searched = {sat: dict(bins) for sat, bins in state.searched.items()}
        for sat, grid in dopplers.items():
            searched.setdefault(sat, {}).update({self._bin(d): now_s for d in grid})
        return replace(state, searched=searched)

    def _bin(self, doppler_hz: float) -> int:
        return round(doppler_hz / self.settings.search.doppler_step_hz)

    def _dopplers(self, state: ReceiverState) -> dict[str, NDArray[np.float64]]:
        """Which Dopplers to try in this frame, for each satellite."""
        settings = self.settings
        step_hz = settings.search.doppler_step_hz
        if state.frame % round(settings.full_search_s / settings.frame_s) == 0:
            n = int(settings.doppler_max_hz // step_hz)
            grid = np.arange(-n, n + 1, dtype=np.float64) * step_hz
            return {sat: grid for sat in settings.sats}
        if state.frame % round(settings.near_search_s / settings.frame_s) == 0:
            reach = int(settings.near_doppler_hz // step_hz)
            bins: dict[str, set[int]] = {}
            for channel, loop in zip(state.channels, state.loops, strict=True):
                centre = self._bin(loop[k.FREQUENCY] - self.if_hz)
                bins.setdefault(channel.sat, set()).update(range(centre - reach, centre + reach + 1))
            return {sat: step_hz * np.array(sorted(numbers), dtype=np.float64) for sat, numbers in bins.items()}
        return {}

    def _known(self, state: ReceiverState, sat: str, begin: int) -> Sequence[tuple[float, float]]:
        """(delay in s after sample `begin`, power over noise of the search) of the channels of a satellite."""
        noise = 2.0 * float(np.mean(state.tail[:, :2000] ** 2)) * self.rate_hz * self.signal.period_s
        return [
            (self._delay_s(loop, begin), float(loop[k.POWER]) / noise)
            for channel, loop in zip(state.channels, state.loops, strict=True)
            if channel.sat == sat
        ]

    def _delay_s(self, loop: NDArray[np.float64], begin: int) -> float:
        """Of the first start of a code period at or after sample `begin`."""
        delay = (loop[k.START] - begin) / self.rate_hz - loop[k.CHIP] / loop[k.CODE_RATE]
        return float(np.mod(delay, self.signal.period_s))

    def _start(self, state: ReceiverState, peak: Peak, begin: int, now_s: float) -> ReceiverState:
        settings = self.settings
        chips_per_sample = self.signal.chip_rate_hz / self.rate_hz
        first = np.ceil(peak.delay_s * self.rate_hz)
        loop = np.zeros(k.N_STATE)
        loop[k.START] = begin + first
        loop[k.CHIP] = (first - peak.delay_s * self.rate_hz) * chips_per_sample
        loop[k.PLL_VELOCITY] = peak.doppler_hz
        loop[k.FREQUENCY] = self.if_hz + peak.doppler_hz
        loop[k.CODE_RATE] = self.signal.chip_rate_hz * (1.0 + peak.doppler_hz / self.signal.carrier_hz)
        loop[k.PLL_BANDWIDTH] = settings.pll_bandwidth_hz
        loop[k.FLL_BANDWIDTH] = settings.fll_bandwidth_hz
        loop[k.DLL_BANDWIDTH] = settings.dll_pull_in_hz
        missed = state.searched.get(peak.sat, {}).get(self._bin(peak.doppler_hz), np.nan)
        channel = Channel(sat=peak.sat, began_s=now_s, found_s=now_s, missed_s=missed, arc=state.next_arc)
        return replace(
            state,
            channels=(*state.channels, channel),
            loops=np.concatenate([state.loops, loop[None, :]]),
            periods=(*state.periods, np.empty((0, k.OUT_TAPS + 2 * self.taps_chips.size))),
            next_arc=state.next_arc + 1,
        )

    # ------------------------------------------------------------------ tracking

    def _advance(
        self, state: ReceiverState, buffer: NDArray[np.float32], begin: int
    ) -> tuple[NDArray[np.float64], tuple[NDArray[np.float64], ...]]:
        n = len(state.channels)
        if n == 0:
            return state.loops, ()
        sats, tables = self._stack(tuple(sorted({c.sat for c in state.channels})))
        max_periods = int(buffer.shape[1] / self.rate_hz / self.signal.period_s) + 3
        out = np.empty((n, max_periods, k.OUT_TAPS + 2 * self.taps_chips.size))
        counts = np.zeros(n, np.int64)
        loops = state.loops.copy()
        i_samples, q_samples = buffer[0], buffer[1]
        fresh = buffer[:, begin - state.tail_start :]
        k.advance(
            i_samples, q_samples, state.tail_start, float(np.mean(fresh**2) * 2.0), loops, tables,
            np.array([sats.index(c.sat) for c in state.channels]), self.taps_chips, self.rate_hz, self.if_hz,
            self.signal.chip_rate_hz, self.signal.carrier_hz, self.signal.code_length, out, counts,
        )  # fmt: skip
        return loops, tuple(out[i, : counts[i]] for i in range(n))

    def _stack(self, sats: tuple[str, ...]) -> tuple[tuple[str, ...], NDArray[np.int8]]:
        if self._stacked is None or self._stacked[0] != sats:
            n = int(np.ceil(self.rate_hz * self.signal.period_s)) + 1
            for sat in sats:
                if sat not in self._tables:
                    self._tables[sat] = k.code_table(
                        self.signal.code(prn_of(sat)), self.signal.chip_rate_hz / self.rate_hz,
                        self.settings.code_phases, n,
                    )  # fmt: skip
            self._stacked = sats, np.stack([self._tables[sat] for sat in sats])
        return self._stacked

    def _attend(
        self, channel: Channel, rows: NDArray[np.float64], loop: NDArray[np.float64], frame: int
    ) -> Channel:
        """Lock control and telemetry after a frame; changes the loop's bandwidths when pull-in is over."""
        settings = self.settings
        i_prompt, q_prompt = rows[:, k.OUT_TAPS + 2], rows[:, k.OUT_TAPS + 3]
        lock = lock_indicator(i_prompt, q_prompt)
        smoothed = channel.lock + 0.25 * (lock - channel.lock)
        age_s = (frame + 1) * settings.frame_s - channel.began_s
        if loop[k.FLL_BANDWIDTH] > 0.0:
            if age_s < settings.pull_in_s:
                return replace(channel, lock=lock)
            loop[k.FLL_BANDWIDTH] = 0.0
            loop[k.DLL_BANDWIDTH] = settings.dll_bandwidth_hz
        return replace(
            channel,
            lock=smoothed,
            unlocked_frames=channel.unlocked_frames + 1 if smoothed < settings.min_lock else 0,
            telemetry=tm.step(channel.telemetry, i_prompt, int(rows[0, k.OUT_PERIOD])),
        )

    def _epoch(
        self, state: ReceiverState, before: tuple[NDArray[np.float64], ...], now: tuple[NDArray[np.float64], ...]
    ) -> Epoch:
        elapsed_s = state.frame * self.settings.frame_s
        measurements = {}
        for i, channel in enumerate(state.channels):
            if channel.copy is not None and before[i].size and now[i].size:
                measurements[channel.arc] = measure(
                    np.concatenate([before[i], now[i]]), elapsed_s, self.rate_hz, self.if_hz, self.signal,
                    self.settings.early_late_chips, self.settings.pll_bandwidth_hz,
                )  # fmt: skip
        return Epoch(elapsed_s=elapsed_s, measurements=measurements)

    # ------------------------------------------------------------------ which channels stay

    def _confirm(self, state: ReceiverState, end: int) -> ReceiverState:
        """Give channels that have proved themselves a letter: that of a lost signal they continue, or the next one."""
        letters, lost = dict(state.letters), list(state.lost)
        channels = list(state.channels)
        end_s = (state.frame + 1) * self.settings.frame_s
        for i, channel in enumerate(channels):
            if channel.copy is None and end_s - channel.began_s >= self.settings.confirm_s - 1e-9:
                if channel.lock < self.settings.min_lock:
                    continue
                again = self._continues(lost, channel, state.loops[i], end, end_s)
                if again is not None:
                    lost.remove(again)
                    channels[i] = replace(
                        channel, copy=again.copy, found_s=again.found_s, missed_s=again.missed_s
                    )  # fmt: skip
                    continue
                number = letters.get(channel.sat, 0)
                letters[channel.sat] = number + 1
                channels[i] = replace(channel, copy=letter(number))
        return replace(state, channels=tuple(channels), letters=letters, lost=tuple(lost))

    def _continues(
        self, lost: Sequence[LostSignal], channel: Channel, loop: NDArray[np.float64], end: int, end_s: float
    ) -> LostSignal | None:
        for signal in lost:
            gap_s = end_s - signal.lost_s
            doppler_hz = 0.5 * (signal.doppler_hz + loop[k.FREQUENCY] - self.if_hz)
            drift_s = -doppler_hz / self.signal.carrier_hz * gap_s
            apart_s = self._delay_s(loop, end) - signal.delay_s - drift_s
            apart_s -= self.signal.period_s * round(apart_s / self.signal.period_s)
            chips = abs(apart_s) * self.signal.chip_rate_hz
            if signal.sat == channel.sat and chips < 0.3 + 0.02 * gap_s:
                return signal
        return None

    def _drop(self, state: ReceiverState, end: int) -> ReceiverState:
        """Let go of channels that never locked, lost lock, or fell on the signal of another channel."""
        settings = self.settings
        end_s = (state.frame + 1) * settings.frame_s
        drop: set[int] = set()
        lost = [signal for signal in state.lost if end_s - signal.lost_s < FORGET_S]
        for i, channel in enumerate(state.channels):
            never = channel.copy is None and end_s - channel.began_s >= settings.confirm_s - 1e-9
            gone = channel.copy is not None and channel.unlocked_frames * settings.frame_s >= settings.lose_after_s
            if never or gone or self._falls_on_another(state, i, end):
                drop.add(i)
                if channel.copy is not None:
                    loop = state.loops[i]
                    lost.append(
                        LostSignal(
                            sat=channel.sat, copy=channel.copy, found_s=channel.found_s, missed_s=channel.missed_s,
                            lost_s=end_s, delay_s=self._delay_s(loop, end), doppler_hz=loop[k.FREQUENCY] - self.if_hz,
                        )
                    )  # fmt: skip
        stay = [i for i in range(len(state.channels)) if i not in drop]
        return replace(
            state,
            channels=tuple(state.channels[i] for i in stay),
            loops=state.loops[stay],
            periods=tuple(state.periods[i] for i in stay),
            lost=tuple(lost),
        )

    def _falls_on_another(self, state: ReceiverState, i: int, end: int) -> bool:
        """Whether an older channel of the same satellite follows the same signal (delay and Doppler)."""
        for j in range(i):
            if state.channels[j].sat == state.channels[i].sat:
                apart_s = self._delay_s(state.loops[i], end) - self._delay_s(state.loops[j], end)
                apart_s -= self.signal.period_s * round(apart_s / self.signal.period_s)
                if abs(apart_s) * self.signal.chip_rate_hz < self.settings.merge_chips:
                    return True
        return False


def lock_indicator(i_prompt: NDArray[np.float64], q_prompt: NDArray[np.float64]) -> float:
    """Mean of I^2 - Q^2 over mean of I^2 + Q^2: 1 in perfect lock, 0 on noise."""
    i2, q2 = float(np.sum(i_prompt**2)), float(np.sum(q_prompt**2))
    return (i2 - q2) / (i2 + q2) if i2 + q2 > 0.0 else 0.0


def letter(number: int) -> str:
    """a, b, ... z, aa, ab, ...: the name of the n-th copy found."""
    text = ""
    number += 1
    while number > 0:
        number, digit = divmod(number - 1, 26)
        text = chr(ord("a") + digit) + text
    return text


def _arc(channel: Channel, signal: SignalDescription) -> Arc:
    assert channel.copy is not None
    return Arc(
        signal=SignalId(channel.sat, signal.band, signal.code_name, channel.copy),
        found_s=channel.found_s,
        missed_s=channel.missed_s,
        tow_ms_at_period_0=channel.telemetry.tow_ms_at_period_0,
        bit_synchronised=channel.telemetry.synchronised,
        bits_period=channel.telemetry.bits_period,
        subframes=channel.telemetry.subframes,
    )
