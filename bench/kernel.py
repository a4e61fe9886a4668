"""The tracking kernel on one core: nanoseconds a sample and channel, beside two plain correlators of the same periods.

The plain ones correlate only; the kernel also steers its loops and normalises its discriminators. That all three find
the same sums is checked.
"""

import math
from collections.abc import Iterator
from time import process_time

import numba
import numpy as np
from numpy.typing import NDArray
from timing import Spread, line, take_turns

from skyproof.gnss.signals import GPS_L1_CA
from skyproof.receiver import kernels as k

Reals = NDArray[np.float64]
Complex = NDArray[np.complex128]

RATES_HZ = (2.6e6, 4e6, 25e6)
CHANNELS = 12
DURATION_S = 0.02
PLAIN_PERIODS = 2  # what the slow peers do of each channel
CODE_PHASES = 32
TAPS_CHIPS = np.array([0.125, 0.0, -0.125])


def report() -> Iterator[str]:
    """Rows of the table."""
    numba.set_num_threads(1)
    yield f"tracking kernel, {CHANNELS} channels, one core"
    for rate_hz in RATES_HZ:
        case = _Case(rate_hz, TAPS_CHIPS)
        case.check()
        kernel, numpy_s, naive_s = take_turns(case.kernel, case.numpy, case.naive, runs=9, clock=process_time)
        ours = kernel * (1e9 / case.cells)
        many = _Case(rate_hz, np.concatenate([TAPS_CHIPS, np.linspace(-1.0, 1.0, 8)]))
        (with_many,) = take_turns(many.kernel, runs=9, clock=process_time)
        further_ns = (with_many.median - kernel.median) / 8 * 1e9 / case.cells
        plain, naive = (_ratio(peer, case.plain_cells, ours) for peer in (numpy_s, naive_s))
        beside = f"NumPy {plain}, naive Numba loop {naive}; each further tap {further_ns:.2f} ns"
        yield line(f"{rate_hz / 1e6:g} Msps, 3 taps, a sample and channel", ours, "ns", beside)
    numba.set_num_threads(numba.config.NUMBA_NUM_THREADS)


def _ratio(peer: Spread, cells: int, ours: Spread) -> str:
    ns = peer.median * 1e9 / cells
    return f"{ns:.3g} ns ({ns / ours.median:.0f} times)"


class _Case:
    """Twelve signals in noise, and channels that sit on them."""

    def __init__(self, rate_hz: float, taps_chips: Reals) -> None:
        rng = np.random.default_rng(1)
        self.rate_hz, self.taps = rate_hz, taps_chips
        n = int(DURATION_S * rate_hz)
        time_s = np.arange(n) / rate_hz
        self.samples = rng.standard_normal((2, n)).astype(np.float32)
        self.codes = np.stack([GPS_L1_CA.code(prn) for prn in range(1, CHANNELS + 1)])
        self.states = np.zeros((CHANNELS, k.N_STATE))
        chips_a_sample = GPS_L1_CA.chip_rate_hz / rate_hz
        for state, code in zip(self.states, self.codes, strict=True):
            doppler_hz, delay_s = rng.uniform(-4e3, 4e3), rng.uniform(0.0, 1e-3)
            chip_rate_hz = GPS_L1_CA.chip_rate_hz * (1.0 + doppler_hz / GPS_L1_CA.carrier_hz)
            chips = code[np.floor((time_s - delay_s) * chip_rate_hz).astype(np.int64) % code.size]
            signal = 0.3 * chips * np.exp(2j * np.pi * doppler_hz * time_s)
            self.samples += np.stack([signal.real, signal.imag]).astype(np.float32)
            first = math.ceil(delay_s * rate_hz)
            state[k.START] = first
            state[k.CHIP] = (first - delay_s * rate_hz) * chips_a_sample
            state[k.PHASE] = doppler_hz * first / rate_hz
            state[k.PLL_VELOCITY] = state[k.FREQUENCY] = doppler_hz
            state[k.CODE_RATE] = chip_rate_hz
            state[k.PLL_BANDWIDTH], state[k.DLL_BANDWIDTH] = 15.0, 1.0
        columns = math.ceil(rate_hz * GPS_L1_CA.period_s) + 1
        self.tables = np.stack([k.code_table(code, chips_a_sample, CODE_PHASES, columns) for code in self.codes])
        self.out = np.empty((CHANNELS, int(DURATION_S * 1e3) + 2, k.OUT_TAPS + 2 * taps_chips.size))
        self.counts = np.zeros(CHANNELS, np.int64)
        self.complex = self.samples[0] + 1j * self.samples[1]
        self.kernel()
        self.cells = int(self._length(0, self.counts[0]) * CHANNELS)
        self.plain_cells = int(self._length(0, PLAIN_PERIODS) * CHANNELS)

    def _length(self, channel: int, periods: int) -> int:
        """Samples in the first periods of a channel."""
        last = self.out[channel, periods - 1]
        return int(last[k.OUT_START] - self.out[channel, 0, k.OUT_START] + self.rate_hz * GPS_L1_CA.period_s)

    def kernel(self) -> None:
        power = float(np.mean(self.samples[:, :2000] ** 2) * 2.0)
        k.advance(
            self.samples[0], self.samples[1], 0, power, self.states.copy(), self.tables, np.arange(CHANNELS), self.taps,
            self.rate_hz, 0.0, GPS_L1_CA.chip_rate_hz, GPS_L1_CA.carrier_hz, GPS_L1_CA.code_length, self.out,
            self.counts,
        )  # fmt: skip

    def _periods(self) -> Iterator[tuple[int, Reals, Complex]]:
        """Channel, what the kernel used, and the samples of each period that the slow peers do."""
        for channel in range(CHANNELS):
            for row in self.out[channel, :PLAIN_PERIODS]:
                chips_a_sample = row[k.OUT_CODE_RATE] / self.rate_hz
                n = math.ceil((GPS_L1_CA.code_length - row[k.OUT_CHIP]) / chips_a_sample)
                first = int(row[k.OUT_START])
                yield channel, row, self.complex[first : first + n]

    def numpy(self) -> list[Complex]:
        return [_numpy(x, self.codes[c], row, self.rate_hz, self.taps) for c, row, x in self._periods()]

    def naive(self) -> list[Complex]:
        return [_naive(x, self.codes[c], row, self.rate_hz, self.taps) for c, row, x in self._periods()]

    def check(self) -> None:
        """All three agree, but for the kernel's code phase, which is rounded to 1/32 sample."""
        kernel = np.array([r[k.OUT_TAPS :].view(np.complex128) for _, r, _ in self._periods()])
        numpy_sums, naive_sums = np.array(self.numpy()), np.array(self.naive())
        scale = np.sqrt(np.mean(np.abs(kernel) ** 2))
        assert np.allclose(numpy_sums, naive_sums, atol=1e-6 * scale)
        assert np.sqrt(np.mean(np.abs(kernel - numpy_sums) ** 2)) < 0.02 * scale


def _numpy(x: Complex, code: NDArray[np.int8], row: Reals, rate_hz: float, taps: Reals) -> Complex:
    n = np.arange(x.size)
    base = x * np.exp(-2j * np.pi * (row[k.OUT_PHASE] + n * (row[k.OUT_FREQUENCY] / rate_hz)))
    chips = row[k.OUT_CHIP] + n * (row[k.OUT_CODE_RATE] / rate_hz)
    replicas = (code[np.floor(chips + tap).astype(np.int64) % code.size] for tap in taps)
    return np.array([np.sum(base * replica) for replica in replicas])


@numba.njit(nogil=True)
def _naive(x: Complex, code: NDArray[np.int8], row: Reals, rate_hz: float, taps: Reals) -> Complex:
    sums = np.zeros(taps.size, np.complex128)
    for n in range(x.size):
        angle_rad = -2.0 * math.pi * (row[k.OUT_PHASE] + n * (row[k.OUT_FREQUENCY] / rate_hz))
        base = x[n] * complex(math.cos(angle_rad), math.sin(angle_rad))
        chip = row[k.OUT_CHIP] + n * (row[k.OUT_CODE_RATE] / rate_hz)
        for tap in range(taps.size):
            sums[tap] += base * code[math.floor(chip + taps[tap]) % code.size]
    return sums
