"""The tracking kernel on one core: nanoseconds a sample and channel, beside two plain correlators of the same periods.

The correlator alone and the kernel that closes loops around it take turns with the plain ones and with a bare sum over
the samples: that reads what the correlator has to read at least. That all find the same sums is checked.
"""

import math
from collections.abc import Iterator
from itertools import pairwise
from time import process_time

import numba
import numpy as np
from numpy.typing import NDArray
from timing import Spread, line, take_turns

from skyproof.arrays import Complexes, Floats, Reals
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.receiver import kernels as k
from skyproof.receiver.correlator import allocate_scratch, correlate_period, table_pad
from skyproof.receiver.discriminator import compute_discriminator
from skyproof.receiver.replica import CODE_SCALE, code_table

RATES_HZ = (2.6e6, 4e6, 5e6, 25e6)
DELAYS = (3, 5, 41)
CHANNELS = 12
ANTENNAS = 4
DURATION_S = 0.02
PLAIN_PERIODS = 1  # what the slow peers do of each channel
CODE_PHASES = 32
RUNS = 15


def report() -> Iterator[str]:
    """Rows of the table."""
    numba.set_num_threads(1)
    yield f"tracking kernel, {CHANNELS} channels, one core, a sample and channel"
    for rate_hz in RATES_HZ:
        cases = [_Case(rate_hz, _delays_chips(n)) for n in DELAYS]
        for case in cases:
            case.check()
        ours = take_turns(*[c.correlate for c in cases], *[c.track for c in cases], runs=RUNS, clock=process_time)
        alone = [time * (1e9 / case.cells) for time, case in zip(ours, cases, strict=False)]
        closed = [time * (1e9 / case.cells) for time, case in zip(ours[len(cases) :], cases, strict=True)]
        numpy_s, naive_s, reading_s = take_turns(
            cases[0].numpy, cases[0].naive, cases[0].read, runs=5, clock=process_time
        )
        plain, naive = (_ratio(peer, cases[0].plain_cells, alone[0]) for peer in (numpy_s, naive_s))
        reading_ns = reading_s.median * 1e9 / cases[0].cells
        limit = f"reading 8 bytes a sample {reading_ns:.2f} ns ({8.0 / reading_ns:.0f} GB/s)"
        for case, correlator, loops in zip(cases, alone, closed, strict=True):
            name = f"{rate_hz / 1e6:g} Msps, {case.delays.size} delays"
            first = case is cases[0]
            yield line(f"{name}, correlator alone", correlator, "ns", f"NumPy {plain}, naive {naive}" if first else "")
            yield line(f"{name}, loops closed", loops, "ns", limit if first else "")
        further = ", ".join(
            f"{(b.median - a.median) / (more - few):.3f} ns from {few} to {more}"
            for (a, few), (b, more) in pairwise(zip(alone, DELAYS, strict=True))
        )
        yield f"  {rate_hz / 1e6:g} Msps, each further delay: {further}"
        several, one = take_turns(
            lambda first=cases[0]: first.track_antennas(ANTENNAS), cases[0].track, runs=RUNS, clock=process_time
        )
        each, alone_ns = several * (1e9 / cases[0].cells / ANTENNAS), one.median * 1e9 / cases[0].cells
        peer = f"one antenna {alone_ns:.2f} ns"
        yield line(f"{rate_hz / 1e6:g} Msps, {ANTENNAS} antennas, loops closed, each antenna", each, "ns", peer)
    numba.set_num_threads(numba.config.NUMBA_NUM_THREADS)


def _delays_chips(n: int) -> Reals:
    """Early, prompt, late, and the others evenly over a chip to either side."""
    return np.concatenate([[0.125, 0.0, -0.125], np.linspace(-1.0, 1.0, n - 3)])


def _ratio(peer: Spread, cells: int, ours: Spread) -> str:
    ns = peer.median * 1e9 / cells
    return f"{ns:.3g} ns ({ns / ours.median:.0f} times)"


class _Case:
    """Twelve signals in noise, and channels that sit on them."""

    def __init__(self, rate_hz: float, delays_chips: Reals) -> None:
        rng = np.random.default_rng(1)
        self.rate_hz, self.delays = rate_hz, delays_chips
        n = int(DURATION_S * rate_hz)
        time_s = np.arange(n) / rate_hz
        self.samples = rng.standard_normal((2, n)).astype(np.float32)
        self.codes = np.stack([GPS_L1_CA.code(prn) for prn in range(1, CHANNELS + 1)])
        self.states = np.zeros((CHANNELS, k.N_STATE))
        self.nominal = GPS_L1_CA.chip_rate_hz / rate_hz
        for state, code in zip(self.states, self.codes, strict=True):
            doppler_hz, delay_s = rng.uniform(-4e3, 4e3), rng.uniform(0.0, 1e-3)
            chip_rate_hz = GPS_L1_CA.chip_rate_hz * (1.0 + doppler_hz / GPS_L1_CA.carrier_hz)
            chips = code[np.floor((time_s - delay_s) * chip_rate_hz).astype(np.int64) % code.size]
            signal = 0.3 * chips * np.exp(2j * np.pi * doppler_hz * time_s)
            self.samples += np.stack([signal.real, signal.imag]).astype(np.float32)
            first = math.ceil(delay_s * rate_hz)
            state[k.START] = first
            state[k.CHIP] = (first - delay_s * rate_hz) * self.nominal
            state[k.PHASE] = doppler_hz * first / rate_hz
            state[k.PLL_VELOCITY] = state[k.FREQUENCY] = doppler_hz
            state[k.CODE_RATE] = chip_rate_hz
            state[k.PLL_BANDWIDTH], state[k.DLL_BANDWIDTH] = 15.0, 1.0
            state[k.INTEGRATION], state[k.BIT_START] = 1.0, -1.0
        columns = math.ceil(rate_hz * GPS_L1_CA.period_s) + 1
        self.tables = np.stack([code_table(code, self.nominal, CODE_PHASES, columns) for code in self.codes])
        self.periods = int(DURATION_S * 1e3) - 2  # whole ones that every channel has
        self.cells = int(self.periods * rate_hz * GPS_L1_CA.period_s) * CHANNELS
        self.plain_cells = self.cells * PLAIN_PERIODS // self.periods
        self.out = np.empty((CHANNELS, self.periods, k.OUT_TAPS + 2 * delays_chips.size))
        self.counts = np.zeros(CHANNELS, np.int64)
        self.sums = np.empty((CHANNELS, self.periods, delays_chips.size, 2))
        self.complex = self.samples[0] + 1j * self.samples[1]
        self.power = float(np.mean(self.samples[:, :2000] ** 2) * 2.0) * CODE_SCALE**2
        self.gain = compute_discriminator(self.nominal, 0.25).gain

    def correlate(self) -> None:
        _correlate(
            self.samples[0],
            self.samples[1],
            self.states,
            self.tables,
            table_pad(self.nominal),
            self.nominal,
            self.rate_hz,
            self.delays,
            self.sums,
        )

    def track(self) -> None:
        self._advance(self.samples[None], self.out)

    def track_antennas(self, n: int) -> None:
        """With n antennas that receive the same."""
        self._advance(
            np.repeat(self.samples[None], n, axis=0),
            np.empty((CHANNELS, self.periods, k.row_size(self.delays.size, n))),
        )

    def _advance(self, samples: Floats, out: Reals) -> None:
        k.advance(
            samples,
            self.samples.shape[1],
            0,
            self.power,
            np.tile([1.0 / len(samples), 0.0], (CHANNELS, len(samples), 1)),
            self.states.copy(),
            self.tables,
            table_pad(self.nominal),
            np.arange(CHANNELS),
            self.delays,
            np.zeros(1),
            math.inf,
            1.0,
            self.rate_hz,
            0.0,
            GPS_L1_CA.chip_rate_hz,
            GPS_L1_CA.carrier_hz,
            GPS_L1_CA.code_length,
            self.gain,
            out,
            self.counts,
        )

    def read(self) -> float:
        """Every channel reads the samples, as the correlator does."""
        n = self.cells // CHANNELS
        return sum(_read(self.samples[0, :n], self.samples[1, :n]) for _ in range(CHANNELS))

    def _periods(self) -> Iterator[tuple[int, Reals, Complexes]]:
        """Channel, its state, and the samples of its first period."""
        for channel, state in enumerate(self.states):
            n = math.ceil((GPS_L1_CA.code_length - state[k.CHIP]) / (state[k.CODE_RATE] / self.rate_hz))
            first = int(state[k.START])
            yield channel, state, self.complex[first : first + n]

    def numpy(self) -> list[Complexes]:
        return [_numpy(x, self.codes[c], row, self.rate_hz, self.delays) for c, row, x in self._periods()]

    def naive(self) -> list[Complexes]:
        return [_naive(x, self.codes[c], row, self.rate_hz, self.delays) for c, row, x in self._periods()]

    def check(self) -> None:
        """All agree, but for the noise that the low-pass of our replica keeps out."""
        self.correlate()
        self.track()
        assert np.all(self.counts == self.periods)
        ours = np.ascontiguousarray(self.sums[:, 0]).view(np.complex128)[..., 0]
        tracked = np.ascontiguousarray(self.out[:, 0, k.OUT_TAPS :]).view(np.complex128)
        numpy_sums, naive_sums = np.array(self.numpy()), np.array(self.naive())
        scale = np.sqrt(np.mean(np.abs(numpy_sums) ** 2))
        assert np.allclose(numpy_sums, naive_sums, atol=1e-6 * scale)
        for sums in (ours, tracked):
            gain = np.vdot(numpy_sums, sums) / np.vdot(numpy_sums, numpy_sums)
            assert abs(gain / CODE_SCALE - 1.0) < 0.1
            assert np.sqrt(np.mean(np.abs(sums / gain - numpy_sums) ** 2)) < 0.1 * scale


@numba.njit(nogil=True)
def _correlate(
    i_samples: NDArray[np.float32],
    q_samples: NDArray[np.float32],
    states: Reals,
    tables: NDArray[np.int8],
    pad: int,
    nominal: float,
    rate_hz: float,
    delays: Reals,
    sums: Reals,
) -> None:
    """Periods of every channel one after another, as `advance` does, but with the loops left open."""
    shifts, dopplers = np.empty(delays.size), np.zeros(1)
    scratch = allocate_scratch(tables.shape[2], delays.size)
    for channel in range(states.shape[0]):
        state = states[channel]
        begin, chip, phase_cyc = int(state[k.START]), state[k.CHIP], state[k.PHASE]
        chips_per_sample, cycles_per_sample = state[k.CODE_RATE] / rate_hz, state[k.FREQUENCY] / rate_hz
        for period in range(sums.shape[1]):
            n = math.ceil((1023 - chip) / chips_per_sample)
            correlate_period(
                i_samples,
                q_samples,
                begin,
                n,
                chip,
                chips_per_sample,
                phase_cyc,
                cycles_per_sample,
                tables[channel],
                pad,
                nominal,
                delays,
                dopplers,
                scratch,
                sums[channel, period : period + 1],
                shifts,
            )
            begin += n
            chip += n * chips_per_sample - 1023
            phase_cyc += n * cycles_per_sample


@numba.njit(nogil=True, fastmath={"reassoc", "contract", "nsz"})
def _read(i_samples: NDArray[np.float32], q_samples: NDArray[np.float32]) -> float:
    total = np.float32(0.0)
    for n in range(i_samples.size):
        total += i_samples[n] + q_samples[n]
    return float(total)


def _numpy(x: Complexes, code: NDArray[np.int8], row: Reals, rate_hz: float, taps: Reals) -> Complexes:
    n = np.arange(x.size)
    base = x * np.exp(-2j * np.pi * (row[k.PHASE] + n * (row[k.FREQUENCY] / rate_hz)))
    chips = row[k.CHIP] + n * (row[k.CODE_RATE] / rate_hz)
    replicas = (code[np.floor(chips + tap).astype(np.int64) % code.size] for tap in taps)
    return np.array([np.sum(base * replica) for replica in replicas])


@numba.njit(nogil=True)
def _naive(x: Complexes, code: NDArray[np.int8], row: Reals, rate_hz: float, taps: Reals) -> Complexes:
    sums = np.zeros(taps.size, np.complex128)
    for n in range(x.size):
        angle_rad = -2.0 * math.pi * (row[k.PHASE] + n * (row[k.FREQUENCY] / rate_hz))
        base = x[n] * complex(math.cos(angle_rad), math.sin(angle_rad))
        chip = row[k.CHIP] + n * (row[k.CODE_RATE] / rate_hz)
        for tap in range(taps.size):
            sums[tap] += base * code[math.floor(chip + taps[tap]) % code.size]
    return sums
