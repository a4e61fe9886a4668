"""Render the signals of one receiver's sky and Gaussian noise, as quantised samples.

The receiver's noise has variance 1 in I and in Q before quantisation, so a complex signal of carrier-to-noise density C
has the amplitude sqrt(2 C / rate) (real samples: sqrt(4 C / rate), since the noise fills only half the rate).

A front end of a stated bandwidth filters the signals: instead of the chips, one period of the code as the filter lets
it pass is read, from a table of rows at fractions of a sample, which costs no more. C is the power that is left of
the signal behind the filter, so that the samples have the carrier-to-noise density asked for. The noise stays white
over the samples: that is what the theory of correlators assumes, a recorder's converter adds its own noise behind the
filter anyway, and blocks stay independent of each other. Left out: the filter rings for some chips across a data bit
that turns over, which is one edge of ten thousand, and it follows each signal's own carrier, kilohertz off the front
end's.

Everything lies on a grid that is fixed from the first sample on: chunks, within which phases run straight, and blocks
of chunks, each with its own noise stream. What is asked for is cut out of whole blocks, so the same samples come
whichever stretches are asked for, by however many threads.
"""

import math
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Floats, Integers, Reals
from skyproof.compiled import count_threads
from skyproof.gnss.ephemeris import NavigationData
from skyproof.records import Samples
from skyproof.simulator.received import (
    AddedNoise,
    Jammer,
    Messages,
    ReceiverSky,
    Scene,
    collect_windows,
    find_rows,
    stack_codes,
)
from skyproof.simulator.recorder import quantise
from skyproof.simulator.sample_kernels import CHUNK, ROWS, SPARE, add_line, add_signals
from skyproof.simulator.scenario import FrontEnd, Scenario
from skyproof.simulator.sky import make_scene

__all__ = ["BLOCK", "Rendering", "compute_low_pass", "prepare_rendering", "render", "render_samples"]

T = TypeVar("T")

BLOCK = 32 * CHUNK


@dataclass(frozen=True, eq=False, kw_only=True)
class Rendering:
    """All that is needed to render any stretch of one antenna's samples.

    Signals come first, then their reflections; both are rows of the arrays.
    """

    sky: ReceiverSky
    front_end: FrontEnd
    seed: int
    n_samples: int
    codes: NDArray[np.int8]  # (n_rows, code_length)
    waves: Floats  # (n_rows, ROWS + 1, columns) of `filter_codes`, or (n_rows, 0, 0)
    messages: Messages
    carried: Integers  # (n_rows,) row of the messages that each carries


@dataclass(frozen=True, eq=False, kw_only=True)
class _Chunks:
    """Every row in consecutive chunks; arrays (n_rows, n_chunks), phases at each chunk's first sample."""

    period: Integers  # code periods since the first symbol
    chip: Reals
    chip_step: Reals
    phase_cyc: Reals
    phase_step_cyc: Reals
    amplitude: Reals
    first: Integers  # samples of the chunk in which the signal is there
    last: Integers


def render_samples(scenario: Scenario, navigation: NavigationData) -> tuple[Samples, ...]:
    """Render the recordings of a scene, one per receiver, when they are read.

    `read` gives the quantised values (sign: -1, 1; sign-magnitude: -3, -1, 1, 3; int: whole numbers) and is safe to
    call from several threads. Raises ScenarioError as `make_scene` does.
    """
    scene = make_scene(scenario, navigation)
    return tuple(_make_samples(scene, prepare_rendering(scene, index)) for index in range(len(scene.skies)))


def prepare_rendering(scene: Scene, index: int) -> Rendering:
    """Prepare to render antenna number `index`. The number of samples is a multiple of 8: whole bytes."""
    sky, front_end, messages = scene.skies[index], scene.scenario.front_end, scene.messages
    of = _list_signals(sky)
    codes = stack_codes(sky.signals, sky.signal)
    return Rendering(
        sky=sky,
        front_end=front_end,
        seed=scene.scenario.seed,
        n_samples=int(scene.scenario.duration_s * front_end.rate_hz) // 8 * 8,
        codes=codes[of],
        waves=filter_codes(codes, sky.signal.chip_rate_hz, front_end)[of],
        messages=messages,
        carried=find_rows(messages, sky.signals)[of],
    )


def _list_signals(sky: ReceiverSky) -> Integers:
    """Return the signal of each row: of signals themselves, then of their reflections."""
    return np.array([*range(len(sky.signals)), *(ray.of for ray in sky.rays)], np.int64)


def filter_codes(codes: NDArray[np.int8], chip_rate_hz: float, front_end: FrontEnd) -> Floats:
    """Filter codes (n, code_length) by the front end's low-pass: chips' line spectrum times the filter's.

    Row p, column k of each is the code (k - 2 + p / ROWS) samples after its start, for ROWS + 1 rows; (n, 0, 0) without
    a bandwidth. The filter is `compute_low_pass`. The mean square of each code is 1.
    """
    n_codes, length = codes.shape
    if front_end.bandwidth_hz is None:
        return np.empty((n_codes, 0, 0), np.float32)
    points = 2 ** math.ceil(math.log2(ROWS * max(front_end.rate_hz / chip_rate_hz, 1.0)))  # a chip
    turns = np.arange(length * points // 2 + 1) / length  # of each line, a chip
    passed = (
        np.sinc(turns) * np.exp(-1j * np.pi * turns) * compute_low_pass(turns * chip_rate_hz, front_end.bandwidth_hz)
    )
    chips_per_sample = chip_rate_hz / front_end.rate_hz
    columns = math.ceil(length / chips_per_sample) + 2 * SPARE + 1
    at = (np.arange(columns) - SPARE + np.arange(ROWS + 1)[:, np.newaxis] / ROWS) * chips_per_sample * points
    waves = np.empty((n_codes, ROWS + 1, columns), np.float32)
    for wave, code in zip(waves, codes, strict=True):
        lines = np.fft.fft(code)[np.arange(turns.size) % length] * passed
        period = np.fft.irfft(lines, length * points)
        period /= np.sqrt(np.mean(period**2))
        wave[:] = np.interp(at, np.arange(period.size), period, period=period.size)
    return waves


def compute_low_pass(frequency_hz: Reals, bandwidth_hz: float) -> Reals:
    """Compute the amplitude that a front end passes at frequencies off the carrier, any shape; no phase.

    Half at half the bandwidth; from 3/4 to 5/4 of that it falls like a cosine from one to zero, so that nothing folds
    back if the bandwidth is at most 4/5 of the rate.
    """
    falling = np.clip((np.abs(frequency_hz) / (0.5 * bandwidth_hz) - 0.75) / 0.5, 0.0, 1.0)
    return np.asarray(0.5 + 0.5 * np.cos(np.pi * falling))


def render(rendering: Rendering, block: int, *, noise: bool = True) -> Floats:
    """Render block number `block` before quantisation, float32 (2, BLOCK), I and Q.

    Q of real samples has no meaning.
    """
    planes = _draw_noise(rendering, block) if noise else np.zeros((2, BLOCK), np.float32)
    chunks = _compute_chunks(rendering, block)
    for jammer in rendering.sky.jammers:
        _add_jammer(planes, rendering, jammer, block)
    add_signals(
        planes,
        rendering.codes,
        rendering.waves,
        rendering.sky.signal.chip_rate_hz / rendering.front_end.rate_hz,
        rendering.messages.symbols,
        rendering.messages.guesses,
        rendering.messages.guess_s * rendering.sky.signal.chip_rate_hz,
        rendering.carried,
        rendering.sky.signal.periods_per_symbol,
        chunks.period,
        chunks.chip,
        chunks.chip_step,
        chunks.phase_cyc,
        chunks.phase_step_cyc,
        chunks.amplitude,
        chunks.first,
        chunks.last,
    )
    return planes


def render_quantised(rendering: Rendering, block: int) -> Floats:
    """Render block number `block` as the recorder stores it, float32 (2, n), cut at the recording's end."""
    planes = render(rendering, block)
    if rendering.front_end.agc:
        planes *= _compute_gain(rendering, block)
    planes = planes[:, : rendering.n_samples - block * BLOCK]
    real = rendering.front_end.kind == "real"
    quantise(planes[:1] if real else planes, rendering.front_end)
    if real:
        planes[1] = 0.0
    return planes


def map_ahead(function: Callable[[int], T], blocks: range) -> Iterator[T]:
    """Compute `function(block)` for each block in order, by as many threads as there are cores, few at a time."""
    workers = count_threads()
    if len(blocks) < 2 or workers < 2:
        yield from map(function, blocks)
        return
    with ThreadPoolExecutor(workers) as pool:
        waiting: list[Future[T]] = []
        try:
            for block in blocks:
                waiting.append(pool.submit(function, block))
                if len(waiting) > 2 * workers:
                    yield waiting.pop(0).result()
            while waiting:
                yield waiting.pop(0).result()
        finally:  # the reader may stop early
            for future in waiting:
                future.cancel()


def _make_samples(scene: Scene, rendering: Rendering) -> Samples:
    kept = lru_cache(maxsize=4)(partial(render_quantised, rendering))  # short reads in a row meet the same block

    def read(start: int, count: int) -> Floats:
        if start < 0 or count < 0:
            raise ValueError(f"start {start} and count {count} must not be negative")
        count = max(0, min(count, rendering.n_samples - start))
        planes = np.empty((2, count), np.float32)
        blocks = range(start // BLOCK, -(-(start + count) // BLOCK)) if count else range(0)
        for block, values in zip(blocks, map_ahead(kept, blocks), strict=True):
            begin, end = max(start, block * BLOCK), min(start + count, (block + 1) * BLOCK)
            planes[:, begin - start : end - start] = values[:, begin - block * BLOCK : end - block * BLOCK]
        return planes

    return Samples(
        name=rendering.sky.name,
        antenna=rendering.sky.antenna.name,
        rate_hz=rendering.front_end.rate_hz,
        n_samples=rendering.n_samples,
        read=read,
        centre_hz=rendering.sky.signal.carrier_hz,
        if_hz=rendering.front_end.if_hz,
        start_gpst=round_start(scene, rendering.sky),
        format="simulated",
    )


def round_start(scene: Scene, sky: ReceiverSky) -> np.datetime64:
    """Return the receiver's clock at its first sample, to the second."""
    shown_s = round(sky.receiver.start_offset_s + sky.receiver.clock_offset_s)
    start: np.datetime64 = scene.scenario.start_gpst.astype("datetime64[s]") + np.timedelta64(shown_s, "s")
    return start + np.timedelta64(0, "ns")


def _list_edges(block: int) -> Integers:
    """Return the first samples of a block's chunks, and the first sample after them."""
    return block * BLOCK + CHUNK * np.arange(BLOCK // CHUNK + 1, dtype=np.int64)


def _compute_times(rendering: Rendering, samples: Integers) -> tuple[Integers, Reals, Reals]:
    """Compute whole seconds and the rest elapsed at samples, and how much later it is by true time.

    Counts, so that no time of day eats the digits; the third is small.
    """
    rate_hz = int(rendering.front_end.rate_hz)
    whole_s, rest = np.divmod(samples, rate_hz)
    rest_s = rest / rate_hz
    return whole_s, rest_s, rendering.sky.true_minus_elapsed_s(whole_s + rest_s)


def _compute_chunks(rendering: Rendering, block: int) -> _Chunks:
    sky, front_end = rendering.sky, rendering.front_end
    signal, rate_hz = sky.signal, int(front_end.rate_hz)
    edges = _list_edges(block)
    whole_s, rest_s, late_s = _compute_times(rendering, edges)
    true_s = whole_s + rest_s + late_s
    code_delay_s, carrier_delay_s = _compute_delays_s(sky, true_s)

    carrier_hz = signal.carrier_hz
    phase_cyc = carrier_hz * (late_s - carrier_delay_s.T)
    phase_step_cyc = np.diff(phase_cyc, axis=1) / CHUNK + front_end.if_hz / rate_hz
    phase_cyc = phase_cyc + front_end.if_hz * rest_s  # a whole number of cycles in a whole second

    periods_in_1_s = round(1.0 / signal.period_s)
    sent = periods_in_1_s * (rendering.messages.lead_s + rest_s + late_s - code_delay_s.T)
    period = np.floor(sent)
    advance = np.diff(sent, axis=1) + periods_in_1_s * np.diff(whole_s)

    first, last = _find_presence(rendering, edges[:-1])
    return _Chunks(
        period=(period + periods_in_1_s * whole_s).astype(np.int64)[:, :-1],
        chip=((sent - period) * signal.code_length)[:, :-1],
        chip_step=advance * signal.code_length / CHUNK,
        phase_cyc=phase_cyc[:, :-1],
        phase_step_cyc=phase_step_cyc,
        amplitude=_compute_amplitudes(rendering, 0.5 * (true_s[:-1] + true_s[1:])),
        first=first,
        last=last,
    )


def _compute_delays_s(sky: ReceiverSky, true_s: Reals) -> tuple[Reals, Reals]:
    """Compute delays of code and carrier of all rows at times (n,): (n, n_rows)."""
    code_s, carrier_s = sky.delays_s(true_s)
    if not sky.rays:
        return code_s, carrier_s
    further_s = np.stack([ray.further_s(true_s) for ray in sky.rays], axis=1)
    turned_cyc = np.stack([ray.phase_cyc + ray.rate_hz * true_s for ray in sky.rays], axis=1)
    of = [ray.of for ray in sky.rays]
    return (
        np.concatenate([code_s, code_s[:, of] + further_s], axis=1),
        np.concatenate([carrier_s, carrier_s[:, of] + further_s - turned_cyc / sky.signal.carrier_hz], axis=1),
    )


def _compute_amplitudes(rendering: Rendering, true_s: Reals) -> Reals:
    """Compute amplitudes of all rows at times (n,): (n_rows, n)."""
    sky, front_end = rendering.sky, rendering.front_end
    per_hertz = 4.0 if front_end.kind == "real" else 2.0
    amplitude = np.sqrt(per_hertz / front_end.rate_hz) * 10.0 ** (sky.cn0_dbhz(true_s).T / 20.0)
    weight = np.array([1.0] * len(sky.signals) + [ray.amplitude for ray in sky.rays])
    return np.asarray(amplitude[_list_signals(sky)] * weight[:, np.newaxis])


def _find_presence(rendering: Rendering, firsts: Integers) -> tuple[Integers, Integers]:
    """Find the first sample with each row, and the first without it again, in each chunk.

    Counted from each chunk's first sample and held within the chunk. Pauses are longer than chunks.
    """
    sky = rendering.sky
    sample = _find_first_sample(rendering, collect_windows(sky.signals))
    inside = np.clip(sample[..., np.newaxis] - firsts, 0, CHUNK).astype(np.int64)  # (signal, window, edge, chunk)
    which = np.argmax(inside[:, :, 1] > inside[:, :, 0], axis=1)[:, np.newaxis]
    of = _list_signals(sky)
    first, last = (np.take_along_axis(inside[:, :, edge], which, axis=1)[:, 0][of] for edge in (0, 1))
    return first, last


def _find_first_sample(rendering: Rendering, true_s: Reals) -> Reals:
    """Find the first sample at or after each time, any shape."""
    return np.ceil(rendering.sky.elapsed_at(true_s) * rendering.front_end.rate_hz)


def _compute_powers(rendering: Rendering, block: int) -> tuple[Reals, Reals]:
    """Compute powers that transmitters add to the receiver's noise, over it, in each chunk of a block.

    Shapes are (n_noises, n_chunks) and (n_jammers, n_chunks).
    """
    edges = _list_edges(block)
    whole_s, rest_s, late_s = _compute_times(rendering, edges[:-1] + CHUNK // 2)
    true_s = whole_s + rest_s + late_s
    sky = rendering.sky
    noises = [noise.power(true_s) for noise in sky.noises]
    jammers = [jammer.power(true_s) for jammer in sky.jammers]
    return np.reshape(noises, (-1, true_s.size)), np.reshape(jammers, (-1, true_s.size))


def _draw_noise(rendering: Rendering, block: int) -> Floats:
    """Draw the receiver's noise, from a stream of this antenna and block alone; add transmitters' noise."""
    seeds = np.random.SeedSequence(rendering.seed, spawn_key=(rendering.sky.number, block))
    rng = np.random.Generator(np.random.SFC64(seeds))
    planes = np.zeros((2, BLOCK), np.float32)
    rows = planes[:1] if rendering.front_end.kind == "real" else planes
    rng.standard_normal(out=rows, dtype=np.float32)
    if rendering.sky.noises:
        power = np.ones(BLOCK, np.float32)
        added, _ = _compute_powers(rendering, block)
        for noise, of_chunks in zip(rendering.sky.noises, added.astype(np.float32), strict=True):
            first, last = _find_within(rendering, noise.from_s, noise.until_s, block)
            power[first:last] += np.repeat(of_chunks, CHUNK)[first:last]
        rows *= np.sqrt(power)
    return planes


def _find_within(rendering: Rendering, from_s: float, until_s: float, block: int) -> tuple[int, int]:
    """Find the samples of a block between two true times."""
    sample = _find_first_sample(rendering, np.array([from_s, until_s]))
    first, last = np.clip(sample - block * BLOCK, 0, BLOCK).astype(np.int64).tolist()
    return first, last


def _add_jammer(planes: Floats, rendering: Rendering, jammer: Jammer, block: int) -> None:
    """Add a line or a chirp to a block; its phase runs straight within chunks but for the sweep."""
    first, last = _find_within(rendering, jammer.from_s, jammer.until_s, block)
    if first >= last:
        return
    sky, source, rate_hz = rendering.sky, jammer.source, rendering.front_end.rate_hz
    edges = _list_edges(block)
    whole_s, rest_s, late_s = _compute_times(rendering, edges)
    true_s = whole_s + rest_s + late_s
    left_s = true_s - jammer.delay_s(true_s)
    phase_cyc = sky.signal.carrier_hz * (late_s + left_s - true_s) + source.offset_hz * left_s
    step_cyc = np.diff(phase_cyc) / CHUNK + rendering.front_end.if_hz / rate_hz
    phase_cyc = phase_cyc + rendering.front_end.if_hz * rest_s
    _, powers = _compute_powers(rendering, block)
    amplitude = np.sqrt(2.0 * powers[sky.jammers.index(jammer)])
    sweep_cyc = source.sweep_hz * source.period_s if source.kind == "chirp" else 0.0
    turns = left_s / source.period_s
    add_line(planes, phase_cyc[:-1], step_cyc, amplitude, turns[:-1], np.diff(turns) / CHUNK, sweep_cyc, first, last)


def _compute_gain(rendering: Rendering, block: int) -> Floats:
    """Compute the gain of each sample of a block.

    It keeps the expected power at that of the receiver's own noise.

    It follows the power at once, chunk by chunk, as known beforehand: so it does not depend on what was read before.
    """
    power = np.ones(BLOCK, np.float32)
    sources: list[AddedNoise] = [*rendering.sky.noises, *rendering.sky.jammers]
    for source, of_chunks in zip(
        sources, np.concatenate(_compute_powers(rendering, block)).astype(np.float32), strict=True
    ):
        first, last = _find_within(rendering, source.from_s, source.until_s, block)
        power[first:last] += np.repeat(of_chunks, CHUNK)[first:last]
    edges = _list_edges(block)
    whole_s, rest_s, late_s = _compute_times(rendering, edges[:-1] + CHUNK // 2)
    first_in, last_in = _find_presence(rendering, edges[:-1])
    signals = 0.5 * _compute_amplitudes(rendering, whole_s + rest_s + late_s) ** 2 * (last_in - first_in) / CHUNK
    power += np.repeat(signals.sum(axis=0).astype(np.float32), CHUNK)
    return np.asarray(np.float32(1.0) / np.sqrt(power))
