"""Find signals: parallel code-phase search over Doppler, several signals a satellite, strong ones subtracted first.

The search folds `coherent_periods` code periods after wipe-off, correlates them circularly by FFT and adds powers over
`n_sums` such blocks. Codes that no satellite sends show the height of the noise (`calibration`). A signal found is
measured and subtracted from the samples with its whole correlation shape (`cancellation`). Then its satellite is
searched again. So a second signal of a satellite is found, and no side lobe or cross-correlation is taken for one.

The cross-correlation of strong signals with other codes is no noise: the tail of a search's own cells does not bound it
(docs/design/receiver.md). So nothing is called a signal before its possible cause is out of the samples. If white noise
does not explain a cell, strong signals outside the search are found once, in a few periods, and subtracted. Of the
requested signals, only those too strong for a cross-correlation of the stronger ones are taken at once. All others are
tested again behind them. A sky without strong signals costs none of this.

Three things save time (docs/design/receiver.md). There are 2 cells a chip, cut out of the spectrum, which resamples any
sample rate for nothing. Satellites, and Dopplers that differ by whole kilohertz, share transforms. A kernel does the
work for each satellite, Doppler and block (`fourier`).
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
from skyproof.compiled import compiled, count_threads
from skyproof.gnss.signals import GPS_SATS, SignalPlan, prn_of
from skyproof.receiver.calibration import fit_tail, list_unused_codes, white_tail
from skyproof.receiver.cancellation import KnownSignal, Measured, measure, measure_noise, remove, separation_chips
from skyproof.receiver.fourier import N_CELLS, correlate_rows

__all__ = ["KnownSignal", "Peak", "SearchSettings", "Searcher"]

_CROSS: Final = 0.02
"""Power over the strongest's of what may be its cross-correlation: -23.9 dB at most without Doppler, -21.6 dB with a
difference of whole kilohertz, -19 dB with a margin and the noise on it (Kaplan and Hegarty, 2nd edition, 4.3.4)."""
_ADDING: Final = 4.0
"""Strong signals whose cross-correlations may add in phase in one cell: so many times the sum of their powers."""
_ROUNDS: Final = 8
"""Looks at most; each subtracts signals that are clear of stronger ones, 11 dB or more."""
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
        self._unused_codes = list_unused_codes(8)
        self._unused = [self._code_spectrum(code) for code in self._unused_codes]
        self._threads = ThreadPoolExecutor(count_threads())
        self._glance: Searcher | None = None

    @property
    def duration_s(self) -> float:
        """Return the length of the stretch that the search needs."""
        return self.settings.coherent_periods * self.settings.n_sums * self.period_s

    @property
    def _near_hz(self) -> float:
        """Return the difference of Dopplers below which signals disturb each other within a block."""
        return 1.5 / (self.settings.coherent_periods * self.period_s)

    @property
    def n_samples(self) -> int:
        """Return the number of samples that the search needs."""
        return int(np.ceil(self.duration_s * self.rate_hz - 1e-6))

    def search(
        self,
        samples: Floats,
        if_hz: float,
        dopplers_hz: Mapping[str, Reals],
        known: Mapping[str, Sequence[KnownSignal]],
    ) -> list[Peak]:
        """Find all credible new signals of the requested satellites.

        samples : (2, >= n_samples) I and Q.
        dopplers_hz : for each satellite to look for, the Dopplers to try; multiples of the step share most work.
        known : for each satellite, the signals that are not to be found again; also of satellites not looked for.
        """
        if not dopplers_hz:
            return []
        planes = np.array(samples[:, : self.n_samples], dtype=np.float32)
        taken: dict[str, list[tuple[KnownSignal, float]]] = {}
        self._remove_jointly(
            planes, if_hz, [(sat, known_signal) for sat, ones in known.items() for known_signal in ones], taken
        )
        n_cells = N_CELLS * sum(rows_hz.size for rows_hz in dopplers_hz.values())
        look = self._look(planes, if_hz, dopplers_hz, taken, n_cells)
        if look.doubtful and self._remove_others(planes, if_hz, dopplers_hz):
            look = self._look(planes, if_hz, dopplers_hz, taken, n_cells)
        peaks: list[Peak] = []
        for _ in range(_ROUNDS):
            if not look.candidates:
                break
            known_before = {sat: [known_signal for known_signal, _ in ones] for sat, ones in taken.items()}
            fresh = [(c, self._measure(planes, if_hz, c)) for c in _select_clear(look.candidates)]
            self._remove_jointly(planes, if_hz, [(c.sat, m.signal) for c, m in fresh], taken)
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
                if not self._is_shoulder(samples, if_hz, c.sat, m.signal, known_before)
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
        """Find the highest cell of each satellite, with its chance under the noise of a search of `n_cells`."""
        rows_hz = np.unique(np.concatenate(list(dopplers_hz.values())))
        spectra = self._compute_rows(planes, if_hz, rows_hz)
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
        tail = fit_tail(power[row.size :], self.settings.n_sums)
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

    def _remove_others(self, planes: Floats, if_hz: float, dopplers_hz: Mapping[str, Reals]) -> bool:
        """Remove strong signals of any other satellite or Doppler; tell if there were any."""
        step_hz = 0.5 / self.period_s
        rows_hz = np.concatenate(list(dopplers_hz.values()))
        first, last = np.max(rows_hz) - _SPREAD_HZ, np.min(rows_hz) + _SPREAD_HZ
        grid_hz = step_hz * np.arange(np.ceil(first / step_hz), np.floor(last / step_hz) + 1.0)

        def is_requested(sat: str, at_hz: Reals) -> Booleans:
            apart_hz = np.abs(at_hz - dopplers_hz.get(sat, np.array([np.inf]))[:, np.newaxis])
            return np.asarray(np.min(apart_hz, axis=0) < self._near_hz)

        if all(np.all(is_requested(sat, grid_hz)) for sat in GPS_SATS):
            return False
        if self._glance is None:
            n_sums = min(_GLANCE_PERIODS, self.settings.coherent_periods * self.settings.n_sums)
            self._glance = Searcher(self.signal, self.rate_hz, SearchSettings(n_sums=n_sums))
        strong = [
            (peak.sat, KnownSignal(delay_s=peak.delay_s, doppler_hz=peak.doppler_hz))
            for peak in self._glance.search(planes, if_hz, dict.fromkeys(GPS_SATS, grid_hz), {})
            if not is_requested(peak.sat, np.array([peak.doppler_hz]))[0]
        ]
        remove(planes, self.signal, self.rate_hz, if_hz, strong)
        return bool(strong)

    def _correlate(self, spectra: Floats, codes: Floats, row: Integers, code: Integers) -> tuple[Floats, Floats]:
        """Compute the power over its mean of each job's cells, (n_jobs, N_CELLS), and each job's highest.

        Many jobs run in threads.
        """
        power, highest = np.empty((row.size, N_CELLS), np.float32), np.empty(row.size, np.float32)

        def work(part: tuple[int, int]) -> None:
            correlate_rows(spectra, codes, row, code, *part, power, highest)

        if row.size * spectra.shape[1] < _WORTH_THREADS:
            work((0, row.size))
        else:
            edges = np.linspace(0, row.size, 4 * count_threads() + 1).astype(int).tolist()
            list(self._threads.map(work, pairwise(edges)))
        return power, highest

    def _weights(
        self, taken: Sequence[tuple[KnownSignal, float]], dopplers_hz: Reals, threshold: float, noise: float
    ) -> Floats:
        """Compute factors, (n_dopplers, N_CELLS), that keep above the threshold what removed signals do not explain."""
        settings = self.settings
        limit = np.full((dopplers_hz.size, N_CELLS), threshold)
        cells = np.arange(N_CELLS)
        for removed, power in taken:
            centre_chips = self._cell(removed) * self.signal.code_length / N_CELLS
            apart = np.abs(
                (cells * self.signal.code_length / N_CELLS - centre_chips + 0.5 * self.signal.code_length)
                % self.signal.code_length
                - 0.5 * self.signal.code_length
            )
            near = np.abs(dopplers_hz - removed.doppler_hz) < self._near_hz
            snr = power / noise * settings.coherent_periods
            limit[near] = np.maximum(limit[near], 1.0 + _LEFT * snr)
            shoulder = np.where(apart < settings.shoulder_chips, 1.0 + _SHOULDER * snr, 0.0)
            shoulder[apart < settings.mask_chips] = np.inf
            limit[near] = np.maximum(limit[near], shoulder)
        return (threshold / limit).astype(np.float32)

    # ------------------------------------------------------------------ spectra

    def _compute_rows(self, planes: Floats, if_hz: float, rows_hz: Reals) -> Floats:
        """Return spectra of the blocks a Doppler, (n_rows, n_sums, 2, N_CELLS), in the order of `fft.fftfreq`."""
        bin_hz = 1.0 / self.period_s
        offset_hz = np.mod(rows_hz, bin_hz)
        offsets_hz, which = np.unique(offset_hz, return_inverse=True)
        shifts = np.round((rows_hz - offset_hz) / bin_hz).astype(np.int64)
        base = self._compute_spectra(planes, if_hz, offsets_hz)
        if self._has_lines(base):
            _notch(planes, _LINE + _CODE_LINE_HZ * planes.shape[1] / self.rate_hz)
            base = self._compute_spectra(planes, if_hz, offsets_hz)
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

    def _compute_spectra(self, planes: Floats, if_hz: float, offsets_hz: Reals) -> ComplexFloats:
        """Compute spectra of each block, folded to one code period at each offset: (n_offsets, n_sums, n_fft)."""
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
        return bool(np.any(psd > limit * _median_level(psd.mean(axis=0))))

    def _code(self, sat: str) -> Floats:
        if sat not in self._codes:
            self._codes[sat] = self._code_spectrum(self.signal.code(prn_of(sat)))
        return self._codes[sat]

    def _code_spectrum(self, chips: NDArray[np.int8]) -> Floats:
        """Compute the conjugate spectrum of rectangular chips, (2, N_CELLS): that of points, times sinc."""
        lines = np.round(_FREQUENCY * N_CELLS).astype(np.int64)
        points = fft.fft(chips.astype(np.float64))[lines % chips.size]
        turns = lines / chips.size
        spectrum = np.conj(points * np.sinc(turns) * np.exp(-1j * np.pi * turns))
        return np.stack([spectrum.real, spectrum.imag]).astype(np.float32)

    # ------------------------------------------------------------------ cells, delays, signals

    def _delay_s(self, column: int, doppler_hz: float) -> float:
        """Return the delay at the first sample of a cell, which holds for the middle of the stretch."""
        cell_s = self._n_fft / self.rate_hz / N_CELLS
        ran_s = 0.5 * (self.duration_s - self.settings.coherent_periods * self.period_s)
        return float((column * cell_s + doppler_hz / self.signal.carrier_hz * ran_s) % self.period_s)

    def _cell(self, known_signal: KnownSignal) -> float:
        """Return the fractional cell of a signal: the inverse of `_delay_s`."""
        ran_s = 0.5 * (self.duration_s - self.settings.coherent_periods * self.period_s)
        delay_s = known_signal.delay_s - known_signal.doppler_hz / self.signal.carrier_hz * ran_s
        return float(delay_s / self.period_s * N_CELLS % N_CELLS)

    def _noise(self, planes: Floats, if_hz: float) -> float:
        """Measure the mean power of one code period's correlation with noise alone, through the code's own band."""
        return measure_noise(planes, self.signal, self.rate_hz, if_hz, self._unused_codes[0])

    def _measure(self, planes: Floats, if_hz: float, candidate: _Candidate) -> Measured:
        return measure(
            planes,
            self.signal,
            self.rate_hz,
            if_hz,
            candidate.sat,
            KnownSignal(delay_s=candidate.delay_s, doppler_hz=candidate.row_hz),
            doppler_reach_hz=min(0.75 * self.settings.doppler_step_hz, 499.0),
        )

    def _is_shoulder(
        self, samples: Floats, if_hz: float, sat: str, found: KnownSignal, known: Mapping[str, Sequence[KnownSignal]]
    ) -> bool:
        """Tell if a signal lies so near one subtracted before that it is called its reflection.

        Where they overlap, they are measured together. A signal with a reflection within half a chip leaves a false
        top, up to a chip away, once a single one is subtracted.
        """
        settings = self.settings
        for known_signal in known.get(sat, []):
            apart_s = (found.delay_s - known_signal.delay_s + 0.5 * self.period_s) % self.period_s - 0.5 * self.period_s
            chips = abs(apart_s) * self.signal.chip_rate_hz
            if chips >= settings.shoulder_chips or abs(found.doppler_hz - known_signal.doppler_hz) >= self._near_hz:
                continue
            if chips < settings.mask_chips:
                return True
            planes = np.array(samples[:, : self.n_samples], dtype=np.float32)
            other_signals = [
                (name, other) for name, ones in known.items() for other in ones if other is not known_signal
            ]
            remove(planes, self.signal, self.rate_hz, if_hz, other_signals)
            apart = separation_chips(planes, self.signal, self.rate_hz, if_hz, sat, known_signal, found)
            if apart < settings.mask_chips:
                return True
        return False

    def _remove_jointly(
        self,
        planes: Floats,
        if_hz: float,
        fresh: Sequence[tuple[str, KnownSignal]],
        taken: dict[str, list[tuple[KnownSignal, float]]],
    ) -> None:
        """Remove signals from the samples, jointly with earlier ones of the same satellite until they agree."""
        power = remove(planes, self.signal, self.rate_hz, if_hz, fresh)
        for (sat, known_signal), value in zip(fresh, power, strict=True):
            taken.setdefault(sat, []).append((known_signal, float(value)))
        together = [
            (sat, known_signal)
            for sat in {sat for sat, _ in fresh}
            if len(taken[sat]) > 1
            for known_signal, _ in taken[sat]
        ]
        if together:
            remove(planes, self.signal, self.rate_hz, if_hz, sorted(together, key=lambda pair: pair[0]), rounds=2)


def _select_clear(candidates: Sequence[_Candidate]) -> list[_Candidate]:
    """Select candidates that are no cross-correlation of the stronger ones, the strongest first."""
    clear: list[_Candidate] = []
    stronger = 0.0
    for candidate in sorted(candidates, key=lambda c: -c.power):
        if candidate.power - 1.0 >= _CROSS * _ADDING * stronger or not clear:
            clear.append(candidate)
        stronger += candidate.power - 1.0
    return clear


def _notch(planes: Floats, limit: float) -> None:
    """Limit lines above `limit` times their neighbours' median, in place, with the skirts that reach it.

    Over the whole stretch, not a code period at a time: there the skirts of a line between two bins reach everywhere,
    and cutting its top off leaves short pulses.
    """
    spectrum = fft.fft(planes[0] + 1j * planes[1])
    psd = spectrum.real**2 + spectrum.imag**2
    level = _median_level(psd)
    lines = np.flatnonzero(psd > limit * level)
    with np.errstate(divide="ignore"):  # between the lines of a stretch that only repeats itself there is nothing
        reach = np.minimum(np.sqrt(psd[lines] / level[lines]) / np.pi, psd.size // 2 - 1).astype(np.int64)
    cut = _is_in_arcs(lines - reach, lines + reach, psd.size)
    cut &= psd > level
    spectrum[cut] *= np.sqrt(level[cut] / psd[cut])
    wave = fft.ifft(spectrum, overwrite_x=True)
    planes[0], planes[1] = wave.real, wave.imag


def _is_in_arcs(first: Integers, last: Integers, size: int) -> Booleans:
    """Find the bins of a circle of `size` that lie in any of the arcs from `first` to `last`, both included."""
    steps = np.zeros(size + 1, np.int64)
    np.add.at(steps, first % size, 1)
    np.add.at(steps, last % size + 1, -1)
    return np.cumsum(steps)[:size] + np.count_nonzero(first % size > last % size) > 0


def _median_level(psd: Floats) -> Floats:
    """Compute the median of the surroundings of each bin, 64 of them."""
    width = psd.size // 64
    level = np.empty(psd.size, np.float32)
    level[: 64 * width] = np.repeat(np.median(psd[: 64 * width].reshape(64, width), axis=-1), width)
    level[64 * width :] = level[64 * width - 1]
    return level


@compiled
def _mean_power(spectra: Floats) -> Floats:
    """Average power over the blocks, (n_offsets, n_fft), of interleaved parts (n_offsets, n_blocks, 2 n_fft).

    The parts are real and imaginary.
    """
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
    """Copy the N_CELLS bins around bin `shift`, zero where there are none.

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
            _separate(line[2 * source : 2 * (source + count)], real[cell : cell + count], imag[cell : cell + count])
            k += count


@compiled
def _separate(line: Floats, real: Floats, imag: Floats) -> None:
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
    """Add samples, wiped off, over the periods of each block, into `out`, (n_blocks, n)."""
    _fold_planes(i, q, starts, coherent, cycle_step, out.view(np.float32))
