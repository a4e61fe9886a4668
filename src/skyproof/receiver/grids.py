"""Correlate over a grid of delays and Dopplers around tracked signals (cross ambiguity function), from samples.

Each interval is correlated again with a replica that runs straight: its carrier at the mean frequency of the channel's
loop, its code at the rate that goes with it. So neither the loops' noise nor what a second signal makes of them smears
the grid, and where its zero lies is known exactly. Intervals begin with a data bit, or with a part of one; over several
bits the message is taken off by the sign that the sums themselves show.

The replica is the code in an ideal band that any front end of 4/5 of the sample rate passes unchanged (3/5 of the
rate). So the signal's shape and the correlation of the noise are one function, and no filter has to be known. Taps lie
as near as that band's correlation needs.

The noise is measured where the code does not correlate with itself: at delays some chips away, beside which its
autocorrelation is -1/1023 (IS-GPS-200, Gold codes). Other satellites' signals are part of it, as of the grid.
"""

import math
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, fields
from functools import cache

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Complexes, ComplexFloats, Floats, Integers, Reals
from skyproof.compiled import compiled
from skyproof.gnss.signals import GPS_SATS, SignalPlan, prn_of
from skyproof.receiver import kernels as k
from skyproof.receiver.correlator import allocate_scratch, correlate_period, table_pad
from skyproof.receiver.replica import CODE_SCALE, code_table
from skyproof.records import CcafAsked, Selectable

__all__ = [
    "BAND_SHARE",
    "DOPPLER_HZ",
    "FRACTION_S",
    "NOISE",
    "NOISE_TAPS",
    "Bursts",
    "GridCorrelator",
    "Grids",
    "align_replica",
    "find_first_row",
    "is_disturbed",
    "noise_delays",
]

BAND_SHARE = 0.6
"""Of the sample rate: the part that a front end that passes 4/5 of it does not change."""
NOISE_TAPS = 16
TAPS_A_BAND = 1.1
"""Taps for each that the band's correlation needs."""
SETTLE_S = 0.01
"""From the beginning of a frame to the common time of the first interval, less half of it: half a data bit."""
MOVED_DB = 1.0
MOVED_SIGMAS = 3.0
MOVED_SIGNALS = 3
"""So many signals whose strength moves by so much, and by so many sigmas, against their means say that much is at
stake. Of twelve in noise it happens once in a day."""

# Columns of `Bursts.meta`.
FRACTION_S = 0
DOPPLER_HZ = 1
NOISE = 2
N_META = 3


@dataclass(frozen=True, eq=False, kw_only=True)
class Grids(Selectable):
    """Grids of any number of channels and intervals, one a row.

    elapsed_s : (n,) receiver time, common to all channels of an interval: within half a data bit of the middle of each.
    arc : (n,) which stretch of tracking. periods, fraction_s : (n,) code periods of the arc, and seconds beside them,
        that the grid's zero shows at that time. doppler_hz : (n,) of the replica.
    noise_variance : (n,) mean square of one value's noise. value : (n, n_dopplers, n_delays) complex64, correlation a
        sample.
    """

    elapsed_s: Reals
    arc: Integers
    periods: Integers
    fraction_s: Reals
    doppler_hz: Reals
    noise_variance: Reals
    value: ComplexFloats

    def __len__(self) -> int:
        return int(self.arc.size)

    @staticmethod
    def nothing(n_dopplers: int = 0, n_delays: int = 0) -> "Grids":
        """Return grids without a row."""
        none, whole = np.empty(0), np.empty(0, np.int64)
        return Grids(
            elapsed_s=none,
            arc=whole,
            periods=whole,
            fraction_s=none,
            doppler_hz=none,
            noise_variance=none,
            value=np.empty((0, n_dopplers, n_delays), np.complex64),
        )

    @staticmethod
    def join(parts: Sequence["Grids"]) -> "Grids":
        """Join the rows of all parts, in their order."""
        if not parts:
            return Grids.nothing()
        return Grids(**{f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Grids)})


@dataclass(frozen=True, eq=False)
class Bursts:
    """The intervals of a frame, by channel; NaN of a channel that has no whole burst.

    value : (n_channels, n_intervals, n_dopplers, n_delays) in units of `CODE_SCALE`. meta : (n_channels, n_intervals,
        N_META) seconds, Hz and mean square of a value's noise. periods : (n_channels, n_intervals), of the first row.
    """

    value: Complexes
    meta: Reals
    periods: Integers

    @staticmethod
    def empty(n_channels: int, n_intervals: int, shape: tuple[int, int]) -> "Bursts":
        """Return bursts to be filled."""
        return Bursts(
            np.full((n_channels, n_intervals, *shape), complex(np.nan, np.nan)),
            np.full((n_channels, n_intervals, N_META), np.nan),
            np.zeros((n_channels, n_intervals), np.int64),
        )


@cache
def noise_delays(signal: SignalPlan, sat: str) -> tuple[float, ...]:
    """Return delays, chips, at which a satellite's Gold code correlates with itself by -1, as it does a chip aside.

    The peak is the code's length. The nearest to zero beyond three chips, two chips apart at least.
    """
    code = signal.code(prn_of(sat))
    like = np.rint(np.fft.irfft(np.abs(np.fft.rfft(code)) ** 2, code.size))
    found: list[float] = []
    for size in range(4, code.size // 2):
        quiet = bool(np.all(like[[size - 1, size, size + 1]] == -1))
        if quiet and (not found or size - abs(found[-1]) >= 2):
            found += [float(size), -float(size)]
        if len(found) >= NOISE_TAPS:
            break
    return tuple(found[:NOISE_TAPS])


def is_disturbed(cn0_dbhz: Reals, mean_dbhz: Reals, duration_s: float) -> bool:
    """Tell if strengths (n_channels,), measured over `duration_s`, depart from their means of the last second.

    One signal's reflection beats with it. Several signals at once mean an attack, a jammer, or a platform that turns.
    Noise estimated from differences of code periods is known to the root of 3/2 over their number.
    """
    periods = 1e3 * duration_s
    sigma_db = 10.0 / math.log(10.0) * np.sqrt(1.5 / periods + 2.0 / (10.0 ** (0.1 * cn0_dbhz) * duration_s))
    moved = np.abs(cn0_dbhz - mean_dbhz) > np.maximum(MOVED_DB, MOVED_SIGMAS * sigma_db)
    return int(moved.sum()) >= MOVED_SIGNALS


class GridCorrelator:
    """Takes the grids that a receiver is asked for. Holds settings and code tables; remembers nothing."""

    def __init__(self, asked: CcafAsked, rate_hz: float, if_hz: float, signal: SignalPlan, code_phases: int) -> None:
        self.asked, self.rate_hz, self.if_hz, self.signal = asked, rate_hz, if_hz, signal
        self.band_hz = BAND_SHARE * rate_hz
        self._chips_per_sample = signal.chip_rate_hz / rate_hz
        self._code_phases = code_phases
        self.periods = max(round(asked.coherent_s / signal.period_s), 1)
        # Whole steps of the table off zero, so that all are rounded alike.
        step_chips = self._chips_per_sample / code_phases
        apart = step_chips * max(math.floor(signal.chip_rate_hz / self.band_hz / TAPS_A_BAND / step_chips), 1)
        side = math.ceil(asked.reach_chips / apart)
        self.delays_chips: Reals = np.arange(-side, side + 1.0) * apart
        self.dopplers_hz = np.array(asked.dopplers_hz)
        self._step_chips = step_chips
        self._tables: dict[str, NDArray[np.int8]] = {}
        self._reach_chips = max(abs(delay) for sat in GPS_SATS for delay in noise_delays(signal, sat)) + 1.0
        self._pad = table_pad(self._chips_per_sample, self._reach_chips)

    def nothing(self) -> Grids:
        """Return no row, of the shape of those that there may be."""
        return Grids.nothing(self.dopplers_hz.size, self.delays_chips.size)

    @property
    def noise_samples(self) -> int:
        """Return the number of independent complex samples behind each noise variance."""
        return NOISE_TAPS * self.asked.intervals

    def due(self, frame: int, frame_s: float, *, soon: bool) -> bool:
        """Tell if it is time in this frame."""
        every_s = self.asked.soon_s if soon else self.asked.every_s
        return frame % max(round(every_s / frame_s), 1) == 0

    def take(
        self,
        samples: Floats,
        first_sample: int,
        frame: tuple[Reals, Integers],
        bit_start: Reals,
        sats: Sequence[str],
        arcs: Integers,
        elapsed_s: float,
        threads: Executor,
        n_threads: int,
    ) -> Grids:
        """Compute the intervals of one frame.

        samples : (2, n) of one antenna; element 0 has the absolute index `first_sample`. frame : rows and counts of the
        kernel's code periods in the frame that begins at `elapsed_s`. bit_start : (n_channels,) as in the loops' state;
        a channel that does not know its bits has no grid. sats, arcs : of the channels.
        """
        if not len(sats):
            return self.nothing()
        intervals = self.asked.intervals
        coherent_s = self.periods * self.signal.period_s
        times_s: Reals = elapsed_s + SETTLE_S + (np.arange(float(intervals)) + 0.5) * coherent_s
        bursts = Bursts.empty(len(sats), intervals, (self.dopplers_hz.size, self.delays_chips.size))
        self._fill(bursts, samples, first_sample, frame, bit_start, sats, times_s, threads, n_threads)
        # The bursts' noise is one: of sixteen values alone it would be known to a quarter only.
        whole = np.isfinite(bursts.meta).all(axis=(1, 2))
        meta = bursts.meta[whole]
        variance = meta[:, :, NOISE].mean(axis=1, keepdims=True) + np.zeros(intervals)
        return Grids(
            elapsed_s=np.tile(times_s, int(whole.sum())),
            arc=np.repeat(arcs[whole], intervals),
            periods=bursts.periods[whole].ravel(),
            fraction_s=meta[:, :, FRACTION_S].ravel(),
            doppler_hz=meta[:, :, DOPPLER_HZ].ravel(),
            noise_variance=variance.ravel() / CODE_SCALE**2,
            value=(bursts.value[whole] / CODE_SCALE).astype(np.complex64).reshape(-1, *bursts.value.shape[2:]),
        )

    def _fill(
        self,
        bursts: Bursts,
        samples: Floats,
        first_sample: int,
        frame: tuple[Reals, Integers],
        bit_start: Reals,
        sats: Sequence[str],
        times_s: Reals,
        threads: Executor,
        n_threads: int,
    ) -> None:
        """Correlate the samples. times_s : (n_intervals,) common to all channels."""
        n = len(sats)
        names = sorted(set(sats))
        tables = np.stack([self._table(sat) for sat in names])
        table_of = np.array([names.index(sat) for sat in sats])
        noise = np.array([noise_delays(self.signal, sat) for sat in sats])
        delays = np.concatenate([np.tile(-self.delays_chips, (n, 1)), noise], axis=1)
        delays = self._step_chips * np.rint(delays / self._step_chips)
        rows, counts = frame

        def work(part: slice) -> None:
            _correlate(
                samples,
                first_sample,
                rows[part],
                counts[part],
                bit_start[part],
                tables,
                self._pad,
                table_of[part],
                delays[part],
                self.dopplers_hz,
                times_s,
                self.periods,
                self.signal.periods_per_symbol,
                self.rate_hz,
                self.if_hz,
                self.signal.chip_rate_hz,
                self.signal.carrier_hz,
                self.signal.code_length,
                bursts.value[part],
                bursts.meta[part],
                bursts.periods[part],
            )

        share = -(-n // n_threads)
        list(threads.map(work, [slice(first, first + share) for first in range(0, n, share)]))

    def _table(self, sat: str) -> NDArray[np.int8]:
        if sat not in self._tables:
            half = 0.5 * self.band_hz / self.rate_hz
            self._tables[sat] = code_table(
                self.signal.code(prn_of(sat)),
                self._chips_per_sample,
                self._code_phases,
                int(np.ceil(self.rate_hz * self.signal.period_s)) + 1,
                self._reach_chips,
                lambda cycles: np.asarray(np.abs(cycles) <= half, np.float64),
            )
        return self._tables[sat]


@compiled
def find_first_row(periods: Reals, bit_start: float, step: int) -> int:
    """Return the first row that begins a data bit, or a part of `step` code periods of one; their number if none does.

    periods : (n_rows,) numbers of the code periods.
    """
    row = 0
    while row < periods.shape[0] and (periods[row] - bit_start) % step != 0.0:
        row += 1
    return row


@compiled
def align_replica(
    row: Reals, last: Reals, rate_hz: float, if_hz: float, code_rate_hz: float, carrier_hz: float
) -> tuple[float, float]:
    """Return frequency, Hz, and chips a sample of the replica that runs straight from a row to the last one."""
    frequency_hz = row[k.OUT_FREQUENCY]
    if last[k.OUT_START] > row[k.OUT_START]:
        took_s = (last[k.OUT_START] - row[k.OUT_START]) / rate_hz
        frequency_hz = (last[k.OUT_PHASE] - row[k.OUT_PHASE]) / took_s
    return frequency_hz, code_rate_hz / rate_hz * (1.0 + (frequency_hz - if_hz) / carrier_hz)


@compiled
def _correlate(
    samples: Floats,
    first_sample: int,
    rows: Reals,
    counts: Integers,
    bit_start: Reals,
    tables: NDArray[np.int8],
    pad: int,
    table_of: Integers,
    delays_chips: Reals,
    dopplers_hz: Reals,
    times_s: Reals,
    periods: int,
    periods_per_bit: int,
    rate_hz: float,
    if_hz: float,
    code_rate_hz: float,
    carrier_hz: float,
    code_length: int,
    value: Complexes,
    meta: Reals,
    first_periods: Integers,
) -> None:
    """Correlate every channel's intervals one after the other, from the first data bit (or part) of the frame."""
    nominal = code_rate_hz / rate_hz
    n_delays = delays_chips.shape[1]
    longest = math.ceil(code_length / nominal) + 64
    scratch = allocate_scratch(longest, n_delays)
    sums, shifts = np.empty((dopplers_hz.size, n_delays, 2)), np.empty(n_delays)
    total = np.empty((dopplers_hz.size, n_delays), np.complex128)
    bit = np.empty((dopplers_hz.size, n_delays), np.complex128)
    grid = value.shape[3]
    for channel in range(rows.shape[0]):
        if bit_start[channel] < 0.0:
            continue
        numbers = rows[channel, : counts[channel], k.OUT_PERIOD]
        r = find_first_row(numbers, bit_start[channel], min(periods, periods_per_bit))
        for interval in range(times_s.size):
            if r + periods > counts[channel]:
                break
            row, last = rows[channel, r], rows[channel, r + periods - 1]
            frequency_hz, chips_per_sample = align_replica(row, last, rate_hz, if_hz, code_rate_hz, carrier_hz)
            start, chip = int(row[k.OUT_START]), row[k.OUT_CHIP]
            n_all = math.ceil((periods * code_length - chip) / chips_per_sample)
            middle_s = 0.5 * n_all / rate_hz
            begin, at, used, shift = start, chip, 0, 0.0
            total[:] = 0.0
            bit[:] = 0.0
            for p in range(periods):
                n = math.ceil((code_length - at) / chips_per_sample)
                since_s = (begin - start) / rate_hz
                correlate_period(
                    samples[0],
                    samples[1],
                    begin - first_sample,
                    n,
                    at,
                    chips_per_sample,
                    frequency_hz * since_s,
                    frequency_hz / rate_hz,
                    tables[table_of[channel]],
                    pad,
                    nominal,
                    delays_chips[channel],
                    dopplers_hz / rate_hz,
                    scratch,
                    sums,
                    shifts,
                )
                for d in range(dopplers_hz.size):
                    angle_rad = -2.0 * math.pi * dopplers_hz[d] * (since_s - middle_s)
                    turn = complex(math.cos(angle_rad), math.sin(angle_rad))
                    for tap in range(n_delays):
                        bit[d, tap] += complex(sums[d, tap, 0], sums[d, tap, 1]) * turn
                shift += shifts[0] * n / n_all
                at += n * chips_per_sample - code_length
                begin += n
                used += n
                ends = (row[k.OUT_PERIOD] + p + 1.0 - bit_start[channel]) % periods_per_bit == 0.0
                if ends or p == periods - 1:
                    # A bit turns all over: by what most of the grid shows, whatever stands at its middle.
                    along = np.sum((bit[:, :grid] * np.conj(total[:, :grid])).real)
                    total += -bit if along < 0.0 else bit
                    bit[:] = 0.0
            value[channel, interval] = total[:, :grid] / used
            noise = 0.0
            for tap in range(grid, n_delays):
                noise += abs(total[0, tap] / used) ** 2 / (n_delays - grid)
            chips = chip - shift + (times_s[interval] * rate_hz - start) * chips_per_sample
            meta[channel, interval, FRACTION_S] = chips / code_rate_hz
            meta[channel, interval, DOPPLER_HZ] = frequency_hz - if_hz
            meta[channel, interval, NOISE] = noise
            first_periods[channel, interval] = round(row[k.OUT_PERIOD])
            r += periods
