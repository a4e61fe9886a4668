"""Where signals are: parallel code-phase search over Doppler, several signals a satellite, strong ones taken out.

The search folds `coherent_periods` code periods after wipe-off, correlates them circularly by FFT and adds powers over
`n_sums` such blocks. What noise reaches is learnt from codes that nobody sends (`calibration`). A signal found is
measured, taken out of the samples with its whole correlation shape (`cancellation`), and its satellite is looked at
again: so a second signal of a satellite comes to light, and no side lobe or cross-correlation is taken for one.

What strong signals leave on other codes is no noise: no tail of a search's own cells tells how far it reaches
(docs/design/receiver.md). So nothing is called a signal before what may have made it is out of the samples. Where a
cell stands that white noise does not explain, strong signals that the search is not asked for are sought once, in a few
periods, and taken out; of those asked for, only what is too strong for a cross-correlation of the stronger ones is
taken at once, and all else is looked at again behind them. A sky on which nothing stands out costs nothing of this.

Time is saved (docs/design/receiver.md) by 2 cells a chip, cut out of the spectrum, so that any sample rate is resampled
for nothing; by transforms shared between satellites and between Dopplers that differ by whole kilohertz; and by a
kernel of its own for what is done for each satellite, Doppler and block (`fourier`).
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from skyproof.arrays import Booleans, ComplexFloats, Floats, Integers, Reals
from skyproof.compiled import compiled, threads
from skyproof.gnss.signals import GPS_SATS, SignalPlan, prn_of
from skyproof.receiver.calibration import tail_of, unused_codes, white_tail
from skyproof.receiver.cancellation import KnownSignal, Measured, measure, noise_of, remove, separation_chips
from skyproof.receiver.fourier import N_CELLS, correlate_rows

__all__ = ["KnownSignal", "Peak", "SearchSettings", "Searcher"]

_CROSS: Final = 0.02
"""Power over the strongest's of what may be its cross-correlation: -23.9 dB at most without Doppler, -21.6 dB with a
difference of whole kilohertz, -19 dB with a margin and the noise on it (Kaplan and Hegarty, 2nd edition, 4.3.4)."""
_ADDING: Final = 4.0
"""Strong signals whose cross-correlations may add in phase in one cell: so many times the sum of their powers."""
_ROUNDS: Final = 8
"""Looks at most, each of which takes out what stands clear of stronger signals, 11 dB or more of them."""
_GLANCE_PERIODS: Final = 5
"""Code periods in which signals not asked for are sought. Those above 42 dB-Hz show; what a weaker one leaves on other
codes is at most a tenth of a period's noise."""
_SPREAD_HZ: Final = 1e4
"""The Dopplers of two satellites differ by less, +-5 kHz each, whatever the oscillator adds to both."""
_LEFT: Final = 1e-3
"""Power over its own that a signal taken out may leave anywhere: the front end's shape, motion within the stretch."""
_SHOULDER: Final = 0.05
"""The same within `shoulder_chips`, where an error of delay and reflections leave most."""
_LINE: Final = 30.0
"""Power of a spectral bin over its neighbours' median that no noise reaches: 21 times the mean, once in 10^9."""
_CODE_LINE_HZ: Final = 1e4
"""The strongest line of a C/A code holds a hundredth of its power. Lines up to those of a signal of 60 dB-Hz are left:
they add at most a tenth to the noise, and cutting the lines out of a code would leave what cannot be taken out."""
_FREQUENCY: Final = fft.fftfreq(N_CELLS)  # of the cells of a row's spectrum, cycles a cell
_WORTH_THREADS: Final = 1000  # transforms: a few milliseconds


@dataclass(frozen=True, kw_only=True)
class SearchSettings:
    """How the search looks.

    false_alarm_probability : per search of all satellites, delays and Dopplers asked for.
    coherent_periods, n_sums : code periods added coherently, and such blocks whose powers are added.
    doppler_step_hz : the grid of Dopplers; zero means half the reciprocal of a block, which costs at most 0.9 dB.
    mask_chips : nearer to a stronger signal of the same Doppler nothing is called another signal but a reflection.
    shoulder_chips : up to here a second signal must stand out from what errors of the model leave of the first.
    max_peaks : new signals of one satellite in one search.
    """

    false_alarm_probability: float = 1e-4
    coherent_periods: int = 1
    n_sums: int = 20
    doppler_step_hz: float = 0.0
    mask_chips: float = 0.7
    shoulder_chips: float = 1.5
    max_peaks: int = 3

    def __post_init__(self) -> None:
        if self.doppler_step_hz == 0.0:
            object.__setattr__(self, "doppler_step_hz", 500.0 / self.coherent_periods)


@dataclass(frozen=True, kw_only=True)
class Peak:
    """A signal found: a code period begins `delay_s` after the stretch searched does.

    doppler_hz is the apparent carrier minus the nominal one (intermediate frequency taken off).
    power : highest cell over the mean of its row; p_value : of such a cell anywhere in the search, under noise.
    """

    sat: str
    delay_s: float
    doppler_hz: float
    cn0_dbhz: float
    power: float
    p_value: float


@dataclass(frozen=True, kw_only=True)
class _Candidate:
    sat: str
    row_hz: float
    delay_s: float
    power: float
    p_value: float


@dataclass(frozen=True, kw_only=True)
class _Look:
    """candidates : the highest cell of each satellite that the noise does not explain.
    doubtful : satellites with a cell that white noise alone would not explain; among them those of the candidates.
    """

    candidates: tuple[_Candidate, ...]
    doubtful: tuple[str, ...]


class Searcher:
    """Keeps the code spectra of one signal and sample rate; `search` looks at one stretch of samples."""

    def __init__(self, signal: SignalPlan, rate_hz: float, settings: SearchSettings) -> None:
        if 2 * signal.code_length > N_CELLS:
            raise ValueError(f"{signal.name} has {signal.code_length} chips a period; the search takes {N_CELLS // 2}")
        self.signal = signal
        self.rate_hz = rate_hz
        self.settings = settings
        self.period_s = signal.period_s
        self._per_period = rate_hz * signal.period_s
        self._n_fft = round(self._per_period)
        self._codes: dict[str, Floats] = {}
        self._unused_codes = unused_codes(8)
        self._unused = [self._code_spectrum(code) for code in self._unused_codes]
        self._threads = ThreadPoolExecutor(threads())
        self._glance: Searcher | None = None

    @property
    def duration_s(self) -> float:
        """How long a stretch the search needs."""
        return self.settings.coherent_periods * self.settings.n_sums * self.period_s

    @property
    def _near_hz(self) -> float:
        """Signals whose Dopplers differ by less disturb each other within a block."""
        return 1.5 / (self.settings.coherent_periods * self.period_s)

    @property
    def n_samples(self) -> int:
        """How many samples the search needs."""
        return int(np.ceil(self.duration_s * self.rate_hz - 1e-6))

    def search(
        self,
        samples: Floats,
        if_hz: float,
        dopplers_hz: Mapping[str, Reals],
        known: Mapping[str, Sequence[KnownSignal]],
    ) -> list[Peak]:
        """All credible new signals of those asked for.

        samples : (2, >= n_samples) I and Q.
        dopplers_hz : for each satellite to look for, the Dopplers to try; multiples of the step share most work.
        known : for each satellite, the signals that are not to be found again; also of satellites not looked for.
        """
        if not dopplers_hz:
            return []
        planes = np.array(samples[:, : self.n_samples], dtype=np.float32)
        taken: dict[str, list[tuple[KnownSignal, float]]] = {}
        self._take_out(planes, if_hz, [(sat, one) for sat, ones in known.items() for one in ones], taken)
        n_cells = N_CELLS * sum(rows_hz.size for rows_hz in dopplers_hz.values())
        look = self._look(planes, if_hz, dopplers_hz, taken, n_cells)
        if look.doubtful and self._take_out_others(planes, if_hz, dopplers_hz):
            look = self._look(planes, if_hz, dopplers_hz, taken, n_cells)
        peaks: list[Peak] = []
        for _ in range(_ROUNDS):
            if not look.candidates:
                break
            known_before = {sat: [one for one, _ in ones] for sat, ones in taken.items()}
            fresh = [(c, self._measured(planes, if_hz, c)) for c in _clear(look.candidates)]
            self._take_out(planes, if_hz, [(c.sat, m.signal) for c, m in fresh], taken)
            noise = self._noise(planes, if_hz)
            peaks += [
                Peak(
                    sat=c.sat,
                    delay_s=m.signal.delay_s,
                    doppler_hz=m.signal.doppler_hz,
                    power=c.power,
                    p_value=c.p_value,
                    cn0_dbhz=10.0 * np.log10(max(m.power / noise - 1.0, 1e-3) / self.period_s),
                )
                for c, m in fresh
                if not self._shoulder(samples, if_hz, c.sat, m.signal, known_before)
            ]
            found = Counter(peak.sat for peak in peaks)
            wanted = {sat: dopplers_hz[sat] for sat in look.doubtful if found[sat] < self.settings.max_peaks}
            if not wanted:
                break
            look = self._look(planes, if_hz, wanted, taken, n_cells)
        order = list(dopplers_hz)
        return sorted(peaks, key=lambda peak: order.index(peak.sat))

    # ------------------------------------------------------------------ one look

    def _look(
        self,
        planes: Floats,
        if_hz: float,
        dopplers_hz: Mapping[str, Reals],
        taken: Mapping[str, list[tuple[KnownSignal, float]]],
        n_cells: int,
    ) -> _Look:
        """The highest cell of each satellite, held against the noise of a search of `n_cells`."""
        rows_hz = np.unique(np.concatenate(list(dopplers_hz.values())))
        spectra = self._rows(planes, if_hz, rows_hz)
        sats = list(dopplers_hz)
        row = np.concatenate([np.searchsorted(rows_hz, dopplers_hz[sat]) for sat in sats])
        of_sat = np.repeat(np.arange(len(sats)), [dopplers_hz[sat].size for sat in sats])
        # Every row as often as the satellites use it, thinned to a quarter, each time with another unused code.
        n_unused = max(16, row.size // 4)
        unused_row = np.sort(row)[np.linspace(0, row.size - 1, n_unused).astype(np.int64)]
        codes = np.stack([self._code(sat) for sat in sats] + self._unused)
        power, highest = self._correlate(
            spectra,
            codes,
            np.concatenate([row, unused_row]),
            np.concatenate([of_sat, len(sats) + np.arange(n_unused) % len(self._unused)]),
        )
        tail = tail_of(power[row.size :], self.settings.n_sums)
        probability = self.settings.false_alarm_probability
        threshold = tail.threshold(n_cells, probability)
        lowest = min(threshold, white_tail(self.settings.n_sums).threshold(n_cells, probability))
        candidates, doubtful = [], []
        noise: float | None = None  # needed rarely
        for number, sat in enumerate(sats):
            mine = np.flatnonzero(of_sat == number)
            if highest[mine].max() <= lowest:
                continue
            cells = power[mine[0] : mine[-1] + 1]
            if sat in taken:
                noise = self._noise(planes, if_hz) if noise is None else noise
                cells = cells * self._weights(taken[sat], dopplers_hz[sat], lowest, noise)
            at, column = np.unravel_index(int(np.argmax(cells)), cells.shape)
            if cells[at, column] <= lowest:
                continue
            doubtful.append(sat)
            value, row_hz = float(power[mine[at], column]), float(dopplers_hz[sat][at])
            if value > threshold:
                candidates.append(
                    _Candidate(
                        sat=sat,
                        row_hz=row_hz,
                        power=value,
                        p_value=tail.p_value(value, n_cells),
                        delay_s=self._delay_s(int(column), row_hz),
                    )
                )
        return _Look(candidates=tuple(candidates), doubtful=tuple(doubtful))

    def _take_out_others(self, planes: Floats, if_hz: float, dopplers_hz: Mapping[str, Reals]) -> bool:
        """Take strong signals out that are not looked for, of any satellite at any Doppler; whether there are any."""
        step_hz = 0.5 / self.period_s
        rows_hz = np.concatenate(list(dopplers_hz.values()))
        first, last = np.max(rows_hz) - _SPREAD_HZ, np.min(rows_hz) + _SPREAD_HZ
        grid_hz = step_hz * np.arange(np.ceil(first / step_hz), np.floor(last / step_hz) + 1.0)

        def asked(sat: str, at_hz: Reals) -> Booleans:
            apart_hz = np.abs(at_hz - dopplers_hz.get(sat, np.array([np.inf]))[:, np.newaxis])
            return np.asarray(np.min(apart_hz, axis=0) < self._near_hz)

        if all(np.all(asked(sat, grid_hz)) for sat in GPS_SATS):
            return False
        if self._glance is None:
            n_sums = min(_GLANCE_PERIODS, self.settings.coherent_periods * self.settings.n_sums)
            self._glance = Searcher(self.signal, self.rate_hz, SearchSettings(n_sums=n_sums))
        others = [
            (peak.sat, KnownSignal(delay_s=peak.delay_s, doppler_hz=peak.doppler_hz))
            for peak in self._glance.search(planes, if_hz, dict.fromkeys(GPS_SATS, grid_hz), {})
            if not asked(peak.sat, np.array([peak.doppler_hz]))[0]
        ]
        remove(planes, self.signal, self.rate_hz, if_hz, others)
        return bool(others)

    def _correlate(self, spectra: Floats, codes: Floats, row: Integers, code: Integers) -> tuple[Floats, Floats]:
        """Power over its mean of each job's cells, (n_jobs, N_CELLS), and the highest of each; many jobs in threads."""
        power, highest = np.empty((row.size, N_CELLS), np.float32), np.empty(row.size, np.float32)

        def work(part: tuple[int, int]) -> None:
            correlate_rows(spectra, codes, row, code, *part, power, highest)

        if row.size * spectra.shape[1] < _WORTH_THREADS:
            work((0, row.size))
        else:
            edges = np.linspace(0, row.size, 4 * threads() + 1).astype(int).tolist()
            list(self._threads.map(work, pairwise(edges)))
        return power, highest

    def _weights(
        self, taken: Sequence[tuple[KnownSignal, float]], dopplers_hz: Reals, threshold: float, noise: float
    ) -> Floats:
        """Factors, (n_dopplers, N_CELLS), that leave above the threshold what the signals taken out do not explain."""
        settings = self.settings
        limit = np.full((dopplers_hz.size, N_CELLS), threshold)
        cells = np.arange(N_CELLS)
        for one, power in taken:
            centre_chips = self._cell(one) * self.signal.code_length / N_CELLS
            apart = np.abs(
                (cells * self.signal.code_length / N_CELLS - centre_chips + 0.5 * self.signal.code_length)
                % self.signal.code_length
                - 0.5 * self.signal.code_length
            )
            near = np.abs(dopplers_hz - one.doppler_hz) < self._near_hz
            snr = power / noise * settings.coherent_periods
            limit[near] = np.maximum(limit[near], 1.0 + _LEFT * snr)
            shoulder = np.where(apart < settings.shoulder_chips, 1.0 + _SHOULDER * snr, 0.0)
            shoulder[apart < settings.mask_chips] = np.inf
            limit[near] = np.maximum(limit[near], shoulder)
        return (threshold / limit).astype(np.float32)

    # ------------------------------------------------------------------ spectra

    def _rows(self, planes: Floats, if_hz: float, rows_hz: Reals) -> Floats:
        """Spectra of the blocks at each Doppler, (n_rows, n_sums, 2, N_CELLS), in the order of `fft.fftfreq`."""
        bin_hz = 1.0 / self.period_s
        offset_hz = np.mod(rows_hz, bin_hz)
        offsets_hz, which = np.unique(offset_hz, return_inverse=True)
        shifts = np.round((rows_hz - offset_hz) / bin_hz).astype(np.int64)
        base = self._spectra(planes, if_hz, offsets_hz)
        if self._has_lines(base):
            _notch(planes, _LINE + _CODE_LINE_HZ * planes.shape[1] / self.rate_hz)
            base = self._spectra(planes, if_hz, offsets_hz)
        settings = self.settings
        middle = 0.5 * (settings.n_sums - 1)
        blocks_s = (np.arange(settings.n_sums) - middle) * settings.coherent_periods * self.period_s
        # Cells by which the code runs ahead of the middle of the stretch.
        ahead = rows_hz[:, None] / self.signal.carrier_hz * blocks_s * (N_CELLS / self.period_s)
        rows = np.empty((rows_hz.size, settings.n_sums, 2, N_CELLS), np.float32)
        for number in range(rows_hz.size):
            spectra = base[which[number]]
            _cut(spectra.view(np.float32), int(shifts[number]), rows[number])
            if np.abs(ahead[number]).max() > 0.3:  # costs less than 0.1 dB below
                turns = np.exp(2j * np.pi * _FREQUENCY * ahead[number][:, None])
                turned = (rows[number, :, 0] + 1j * rows[number, :, 1]) * turns
                rows[number, :, 0], rows[number, :, 1] = turned.real, turned.imag
        return rows

    def _spectra(self, planes: Floats, if_hz: float, offsets_hz: Reals) -> ComplexFloats:
        """Of each block, folded to one code period after wipe-off at each offset: (n_offsets, n_sums, n_fft)."""
        settings = self.settings
        n_periods = settings.coherent_periods * settings.n_sums
        exact = np.arange(n_periods) * self._per_period
        starts = np.minimum(np.round(exact), planes.shape[1] - self._n_fft).astype(np.int64)
        folded = np.zeros((offsets_hz.size, settings.n_sums, self._n_fft), np.complex64)
        for number, offset_hz in enumerate(offsets_hz):
            _fold(
                planes[0],
                planes[1],
                starts,
                settings.coherent_periods,
                (if_hz + offset_hz) / self.rate_hz,
                folded[number],
            )
        spectra: ComplexFloats = fft.fft(folded, axis=-1, overwrite_x=True)
        late = (starts - exact).reshape(settings.n_sums, -1).mean(axis=1)
        if np.abs(late).max() > 1e-6:
            spectra *= np.exp(-2j * np.pi * fft.fftfreq(self._n_fft) * late[:, None]).astype(np.complex64)
        return spectra

    def _has_lines(self, spectra: ComplexFloats) -> bool:
        psd = _mean_power(spectra.view(np.float32))
        limit = _LINE + _CODE_LINE_HZ * self.settings.coherent_periods * self.period_s
        return bool(np.any(psd > limit * _level(psd.mean(axis=0))))

    def _code(self, sat: str) -> Floats:
        if sat not in self._codes:
            self._codes[sat] = self._code_spectrum(self.signal.code(prn_of(sat)))
        return self._codes[sat]

    def _code_spectrum(self, chips: NDArray[np.int8]) -> Floats:
        """Conjugate spectrum of rectangular chips, (2, N_CELLS): that of the chips as points, times sinc."""
        lines = np.round(_FREQUENCY * N_CELLS).astype(np.int64)
        points = fft.fft(chips.astype(np.float64))[lines % chips.size]
        turns = lines / chips.size
        spectrum = np.conj(points * np.sinc(turns) * np.exp(-1j * np.pi * turns))
        return np.stack([spectrum.real, spectrum.imag]).astype(np.float32)

    # ------------------------------------------------------------------ cells, delays, signals

    def _delay_s(self, column: int, doppler_hz: float) -> float:
        """At the first sample, of a cell, which holds for the middle of the stretch."""
        cell_s = self._n_fft / self.rate_hz / N_CELLS
        ran_s = 0.5 * (self.duration_s - self.settings.coherent_periods * self.period_s)
        return float((column * cell_s + doppler_hz / self.signal.carrier_hz * ran_s) % self.period_s)

    def _cell(self, one: KnownSignal) -> float:
        """Inverse of `_delay_s`, fractional."""
        ran_s = 0.5 * (self.duration_s - self.settings.coherent_periods * self.period_s)
        delay_s = one.delay_s - one.doppler_hz / self.signal.carrier_hz * ran_s
        return float(delay_s / self.period_s * N_CELLS % N_CELLS)

    def _noise(self, planes: Floats, if_hz: float) -> float:
        """Mean power of the correlation of one code period with noise alone, through the code's own band."""
        return noise_of(planes, self.signal, self.rate_hz, if_hz, self._unused_codes[0])

    def _measured(self, planes: Floats, if_hz: float, candidate: _Candidate) -> Measured:
        return measure(
            planes,
            self.signal,
            self.rate_hz,
            if_hz,
            candidate.sat,
            KnownSignal(delay_s=candidate.delay_s, doppler_hz=candidate.row_hz),
            doppler_reach_hz=min(0.75 * self.settings.doppler_step_hz, 499.0),
        )

    def _shoulder(
        self, samples: Floats, if_hz: float, sat: str, found: KnownSignal, known: Mapping[str, Sequence[KnownSignal]]
    ) -> bool:
        """Whether a signal lies so near one taken out before that it is called its reflection.

        Where they overlap, they are measured together: beside a signal that has a reflection within half a chip the
        top of what is left, once one signal is taken out, stands up to a chip away.
        """
        settings = self.settings
        for one in known.get(sat, []):
            apart_s = (found.delay_s - one.delay_s + 0.5 * self.period_s) % self.period_s - 0.5 * self.period_s
            chips = abs(apart_s) * self.signal.chip_rate_hz
            if chips >= settings.shoulder_chips or abs(found.doppler_hz - one.doppler_hz) >= self._near_hz:
                continue
            if chips < settings.mask_chips:
                return True
            planes = np.array(samples[:, : self.n_samples], dtype=np.float32)
            others = [(name, other) for name, ones in known.items() for other in ones if other is not one]
            remove(planes, self.signal, self.rate_hz, if_hz, others)
            apart = separation_chips(planes, self.signal, self.rate_hz, if_hz, sat, one, found)
            if apart < settings.mask_chips:
                return True
        return False

    def _take_out(
        self,
        planes: Floats,
        if_hz: float,
        fresh: Sequence[tuple[str, KnownSignal]],
        taken: dict[str, list[tuple[KnownSignal, float]]],
    ) -> None:
        """Take signals out of the samples; with those of the same satellite taken out before, until they agree."""
        power = remove(planes, self.signal, self.rate_hz, if_hz, fresh)
        for (sat, one), value in zip(fresh, power, strict=True):
            taken.setdefault(sat, []).append((one, float(value)))
        together = [(sat, one) for sat in {sat for sat, _ in fresh} if len(taken[sat]) > 1 for one, _ in taken[sat]]
        if together:
            remove(planes, self.signal, self.rate_hz, if_hz, sorted(together, key=lambda pair: pair[0]), rounds=2)


def _clear(candidates: Sequence[_Candidate]) -> list[_Candidate]:
    """Those that are no cross-correlation of the stronger ones, the strongest first."""
    clear: list[_Candidate] = []
    stronger = 0.0
    for one in sorted(candidates, key=lambda c: -c.power):
        if one.power - 1.0 >= _CROSS * _ADDING * stronger or not clear:
            clear.append(one)
        stronger += one.power - 1.0
    return clear


def _notch(planes: Floats, limit: float) -> None:
    """Bring lines above `limit` times their neighbours' median down to it, in place, with the skirts that reach it.

    Over the whole stretch, not a code period at a time: there the skirts of a line between two bins reach everywhere,
    and cutting its top off leaves short pulses.
    """
    spectrum = fft.fft(planes[0] + 1j * planes[1])
    psd = spectrum.real**2 + spectrum.imag**2
    level = _level(psd)
    lines = np.flatnonzero(psd > limit * level)
    with np.errstate(divide="ignore"):  # between the lines of a stretch that only repeats itself there is nothing
        reach = np.minimum(np.sqrt(psd[lines] / level[lines]) / np.pi, psd.size // 2 - 1).astype(np.int64)
    cut = _covered(lines - reach, lines + reach, psd.size)
    cut &= psd > level
    spectrum[cut] *= np.sqrt(level[cut] / psd[cut])
    wave = fft.ifft(spectrum, overwrite_x=True)
    planes[0], planes[1] = wave.real, wave.imag


def _covered(first: Integers, last: Integers, size: int) -> Booleans:
    """Which bins of a circle of `size` lie in any of the arcs from `first` to `last`, both included."""
    steps = np.zeros(size + 1, np.int64)
    np.add.at(steps, first % size, 1)
    np.add.at(steps, last % size + 1, -1)
    return np.cumsum(steps)[:size] + np.count_nonzero(first % size > last % size) > 0


def _level(psd: Floats) -> Floats:
    """Median of the surroundings of each bin, 64 of them."""
    width = psd.size // 64
    level = np.empty(psd.size, np.float32)
    level[: 64 * width] = np.repeat(np.median(psd[: 64 * width].reshape(64, width), axis=-1), width)
    level[64 * width :] = level[64 * width - 1]
    return level


@compiled
def _mean_power(spectra: Floats) -> Floats:
    """Over the blocks, (n_offsets, n_fft), of interleaved real and imaginary parts (n_offsets, n_blocks, 2 n_fft)."""
    n = spectra.shape[2] // 2
    power = np.zeros((spectra.shape[0], n), np.float32)
    for offset in range(spectra.shape[0]):
        for block in range(spectra.shape[1]):
            line = spectra[offset, block]
            out = power[offset]
            for k in range(n):
                out[k] += line[2 * k] * line[2 * k] + line[2 * k + 1] * line[2 * k + 1]
    power *= np.float32(1.0 / spectra.shape[1])
    return power


@compiled
def _cut(spectra: Floats, shift: int, out: Floats) -> None:
    """The N_CELLS bins around bin `shift`, zero where there are none.

    spectra : (n_sums, 2 n_fft), interleaved real and imaginary parts, periodic; out : (n_sums, 2, N_CELLS), filled.
    """
    n_fft, n = spectra.shape[1] // 2, out.shape[2]
    half = min(n // 2, (n_fft - 1) // 2)
    out[:] = np.float32(0.0)
    for block in range(spectra.shape[0]):
        line, real, imag = spectra[block], out[block, 0], out[block, 1]
        k = -half
        while k < half:  # in runs without a wrap on either side
            source, cell = (k + shift) % n_fft, k % n
            count = min(half - k, n_fft - source, n - cell)
            _unweave(line[2 * source : 2 * (source + count)], real[cell : cell + count], imag[cell : cell + count])
            k += count


@compiled
def _unweave(line: Floats, real: Floats, imag: Floats) -> None:
    for k in range(real.shape[0]):
        real[k] = line[2 * k]
        imag[k] = line[2 * k + 1]


@compiled(fastmath={"reassoc", "contract", "nsz"})
def _turn(i: Floats, q: Floats, cosines: Floats, sines: Floats, c: np.float32, s: np.float32, out: Floats) -> None:
    """Add samples turned back by the rotations and by (c, s) to `out`, (n, 2)."""
    for k in range(i.shape[0]):
        real = cosines[k] * c - sines[k] * s
        imag = cosines[k] * s + sines[k] * c
        out[2 * k] += i[k] * real + q[k] * imag
        out[2 * k + 1] += q[k] * real - i[k] * imag


@compiled
def _fold_planes(i: Floats, q: Floats, starts: Integers, coherent: int, cycle_step: float, out: Floats) -> None:
    n = out.shape[1] // 2
    chunk = 512
    cosines, sines = np.empty(chunk, np.float32), np.empty(chunk, np.float32)
    for k in range(chunk):
        angle = 2.0 * np.pi * ((k * cycle_step) % 1.0)
        cosines[k] = np.cos(angle)
        sines[k] = np.sin(angle)
    for period in range(starts.shape[0]):
        block = out[period // coherent]
        for at in range(0, n, chunk):
            to = min(n, at + chunk)
            begin = starts[period] + at
            angle = 2.0 * np.pi * ((begin * cycle_step) % 1.0)
            _turn(
                i[begin : begin + to - at],
                q[begin : begin + to - at],
                cosines,
                sines,
                np.float32(np.cos(angle)),
                np.float32(np.sin(angle)),
                block[2 * at : 2 * to],
            )


def _fold(i: Floats, q: Floats, starts: Integers, coherent: int, cycle_step: float, out: ComplexFloats) -> None:
    """Samples wiped off and added over the periods of each block: into `out`, (n_blocks, n)."""
    _fold_planes(i, q, starts, coherent, cycle_step, out.view(np.float32))
