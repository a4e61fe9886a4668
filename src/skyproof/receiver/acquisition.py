"""Where signals are: parallel code-phase search over Doppler, several peaks a satellite.

The search correlates 1 ms at a time (circularly, by FFT) and adds powers over `n_periods`. Under noise alone a cell
over its mean is Gamma(n_periods, 1/n_periods), so a threshold follows from the false-alarm probability of the whole
search (Kay, Detection Theory, 5.3; Kaplan & Hegarty, 8.5). A peak is a cell above the threshold; what is already
tracked, and what a stronger peak of the same satellite explains (its own triangle, its code side lobes), is not
reported again.
"""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft, special

from skyproof.gnss.signals import SignalDescription, prn_of

CODE_SIDELOBE = 0.0204
"""Highest code side lobe in power over the peak with a margin of 3 dB: -19.9 + 3 dB (C/A: 65/1023, or 1/15.7)."""


@dataclass(frozen=True, kw_only=True)
class SearchSettings:
    """How the search looks.

    false_alarm_probability : per search of all satellites, delays and Dopplers asked for.
    n_periods : code periods added non-coherently.
    doppler_step_hz : at 1 ms the loss between two bins of 500 Hz is at most 0.9 dB.
    mask_chips : half width of what a known peak covers.
    """

    false_alarm_probability: float = 1e-4
    n_periods: int = 20
    doppler_step_hz: float = 500.0
    mask_chips: float = 1.2
    max_peaks: int = 3


@dataclass(frozen=True, kw_only=True)
class Peak:
    """A signal found: its code period began `delay_s` after the stretch searched did.

    doppler_hz is the apparent carrier minus the nominal one (intermediate frequency taken off).
    """

    sat: str
    delay_s: float
    doppler_hz: float
    power: float  # cell over noise mean
    cn0_dbhz: float


class Searcher:
    """Keeps the code spectra of one signal and sample rate; `search` looks at one stretch of samples."""

    def __init__(self, signal: SignalDescription, rate_hz: float, settings: SearchSettings) -> None:
        self.signal = signal
        self.rate_hz = rate_hz
        self.settings = settings
        self.period_s = signal.code_length / signal.chip_rate_hz
        # At most about four samples a chip are searched: more costs time and finds nothing more.
        wanted = min(rate_hz, 4.2e6) * self.period_s
        self.n = round(wanted) if abs(wanted - round(wanted)) < 1e-9 else fft.next_fast_len(int(wanted) - 32)
        self._spectra: dict[str, NDArray[np.complex64]] = {}
        self._threads = ThreadPoolExecutor(os.cpu_count())

    @property
    def duration_s(self) -> float:
        """How long a stretch the search needs."""
        return self.settings.n_periods * self.period_s

    @property
    def n_samples(self) -> int:
        return int(np.ceil(self.duration_s * self.rate_hz)) + 2

    def search(
        self,
        samples: NDArray[np.float32],
        if_hz: float,
        dopplers_hz: dict[str, NDArray[np.float64]],
        known: Callable[[str], Sequence[tuple[float, float]]],
    ) -> list[Peak]:
        """All credible new peaks.

        samples : (2, >= n_samples) I and Q.
        dopplers_hz : for each satellite to look for, the Dopplers to try (multiples of the step).
        known : for a satellite, (delay_s, power) of signals already tracked; power may be NaN.
        """
        if not dopplers_hz:
            return []
        spectra = self._signal_spectra(samples, if_hz, np.unique(np.concatenate(list(dopplers_hz.values()))))
        n_cells = sum(d.size for d in dopplers_hz.values()) * self.n
        threshold = self.threshold(n_cells)

        def look(sat: str) -> list[Peak]:
            power = self._power(sat, dopplers_hz[sat], spectra)
            return self._peaks(sat, dopplers_hz[sat], power, threshold, known(sat), samples, if_hz)

        # Satellites in parallel (the transforms release the interpreter); the order of the result is that of the sats.
        return [peak for peaks in self._threads.map(look, dopplers_hz) for peak in peaks]

    def threshold(self, n_cells: int) -> float:
        """Cell over noise mean that noise alone exceeds anywhere with the false-alarm probability of the settings."""
        m = self.settings.n_periods
        return float(special.gammainccinv(m, self.settings.false_alarm_probability / n_cells) / m)

    def _signal_spectra(
        self, samples: NDArray[np.float32], if_hz: float, dopplers_hz: NDArray[np.float64]
    ) -> dict[float, NDArray[np.complex64]]:
        """Spectra of each code period after wipe-off, (n_periods, n), one for each Doppler modulo the FFT's bin.

        Dopplers that differ by whole bins share a transform: a circular shift of the spectrum does the rest.
        """
        m, n = self.settings.n_periods, self.n
        bin_hz = 1.0 / self.period_s
        spectra: dict[float, NDArray[np.complex64]] = {}
        count = self.n_samples - 2
        k = np.arange(count)
        for offset in np.unique(np.mod(dopplers_hz, bin_hz)):
            cycles = np.mod((if_hz + offset) / self.rate_hz * k, 1.0)
            base = (samples[0, :count] + 1j * samples[1, :count]) * np.exp(-2j * np.pi * cycles)
            if m * n != count:
                edges = np.ceil(np.arange(m * n) * (count / (m * n)) - 1e-9).astype(np.int64)
                base = np.add.reduceat(base, edges)
            spectra[float(offset)] = fft.fft(base.astype(np.complex64).reshape(m, n), axis=1)
        return spectra

    def _code_spectrum(self, sat: str) -> NDArray[np.complex64]:
        if sat not in self._spectra:
            chips = self.signal.code(prn_of(sat))
            # The mean chip over each cell: no sharper than the samples that were averaged, the first of which stands
            # at the cell's beginning and not half a sample after it.
            half_sample = 0.5 * self.n / (self.rate_hz * self.period_s)
            fine = (np.arange(8 * self.n) + 0.5) / 8.0 - half_sample
            replica = chips[np.floor(fine * chips.size / self.n).astype(np.int64) % chips.size]
            replica = replica.reshape(self.n, 8).mean(axis=1)
            self._spectra[sat] = np.conj(fft.fft(replica)).astype(np.complex64)
        return self._spectra[sat]

    def _power(
        self, sat: str, dopplers_hz: NDArray[np.float64], spectra: dict[float, NDArray[np.complex64]]
    ) -> NDArray[np.float64]:
        """Correlation power over its mean, (n_dopplers, n)."""
        code = self._code_spectrum(sat)
        power = np.empty((dopplers_hz.size, self.n))
        bin_hz = 1.0 / self.period_s
        for row, doppler in enumerate(dopplers_hz):
            offset = float(np.mod(doppler, bin_hz))
            shift = round((doppler - offset) / bin_hz)
            product = spectra[offset] * np.roll(code, shift)[None, :]
            correlation = fft.ifft(product, axis=1, overwrite_x=True).view(np.float32)
            power[row] = np.einsum("pnc,pnc->n", *[correlation.reshape(-1, self.n, 2)] * 2)
        # Signals lift the mean; the median of Gamma(m) is that of the noise almost whatever the signals do.
        m = self.settings.n_periods
        power *= special.gammaincinv(m, 0.5) / m / np.median(power)
        return power

    def _peaks(
        self, sat: str, dopplers_hz: NDArray[np.float64], power: NDArray[np.float64], threshold: float,
        known: Sequence[tuple[float, float]], samples: NDArray[np.float32], if_hz: float,
    ) -> list[Peak]:  # fmt: skip
        power = power.copy()
        peaks: list[Peak] = []
        strongest = max((p for _, p in known if np.isfinite(p)), default=0.0)
        for delay_s, _ in known:
            self._mask(power, delay_s)
        for _ in range(self.settings.max_peaks):
            row, column = np.unravel_index(int(np.argmax(power)), power.shape)
            value = float(power[row, column])
            if value < threshold or value - 1.0 < CODE_SIDELOBE * (strongest - 1.0):
                break
            strongest = max(strongest, value)
            delay_s = self._interpolate(power[row], int(column))
            doppler_hz = self._fine_doppler(sat, delay_s, float(dopplers_hz[row]), samples, if_hz)
            cn0_dbhz = 10.0 * np.log10((value - 1.0) / self.period_s)
            peaks.append(Peak(sat=sat, delay_s=delay_s, doppler_hz=doppler_hz, power=value, cn0_dbhz=cn0_dbhz))
            self._mask(power, delay_s)
        return peaks

    def _mask(self, power: NDArray[np.float64], delay_s: float) -> None:
        half = self.settings.mask_chips / self.signal.code_length * self.n
        centre = delay_s / self.period_s * self.n
        columns = np.arange(int(np.floor(centre - half)), int(np.ceil(centre + half)) + 1) % self.n
        power[:, columns] = 0.0

    def _interpolate(self, row: NDArray[np.float64], column: int) -> float:
        """Delay of the triangle through the highest cell and its neighbours (amplitudes), in seconds."""
        amplitude = np.sqrt(np.maximum(row[[column - 1, column, (column + 1) % self.n]] - 1.0, 0.0))
        low = min(amplitude[0], amplitude[2])
        rise = amplitude[1] - low
        shift = 0.5 * (amplitude[2] - amplitude[0]) / rise if rise > 0.0 else 0.0
        return float((column + shift) % self.n * self.period_s / self.n)

    def _fine_doppler(
        self, sat: str, delay_s: float, doppler_hz: float, samples: NDArray[np.float32], if_hz: float
    ) -> float:
        """Doppler to a few hertz: spectrum of the squared prompts (free of data bits), within half a bin."""
        chips = self.signal.code(prn_of(sat))
        m = self.settings.n_periods - 1
        begin = int(np.ceil(delay_s * self.rate_hz))
        count = int(m * self.period_s * self.rate_hz)
        k = np.arange(begin, min(begin + count, samples.shape[1]))
        code_rate = self.signal.chip_rate_hz * (1.0 + doppler_hz / self.signal.carrier_hz)
        replica = chips[np.floor((k / self.rate_hz - delay_s) * code_rate).astype(np.int64) % chips.size]
        base = (samples[0, k] + 1j * samples[1, k]) * replica
        base *= np.exp(-2j * np.pi * np.mod((if_hz + doppler_hz) / self.rate_hz * k, 1.0))
        # Half a period at a time: unambiguous over twice the search's step.
        parts = 2 * m
        edges = (np.arange(parts) * (k.size / parts)).astype(np.int64)
        prompts = np.add.reduceat(base, edges)
        n_fft = 1024
        spectrum = np.abs(fft.fft(prompts**2, n_fft))
        frequency = fft.fftfreq(n_fft, self.period_s / 2.0) / 2.0
        spectrum[np.abs(frequency) > 0.75 * self.settings.doppler_step_hz] = 0.0
        return doppler_hz + float(frequency[int(np.argmax(spectrum))])
