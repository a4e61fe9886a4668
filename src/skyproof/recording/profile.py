"""Correlate a few code periods over delay: a person sees there how many signals a satellite has.

Each period is correlated coherently, and the powers of the periods are added, so that neither data bits nor the phases
of several signals matter.
"""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from skyproof.arrays import ComplexFloats, Integers, Reals
from skyproof.gnss.signals import GPS_L1_CA, SignalPlan, prn_of
from skyproof.recording.code_phases import FoundSignal
from skyproof.records import Samples

__all__ = ["compute_delay_profiles"]

_BAND_HZ: Final = 1.2e6  # to either side: more holds little of a C/A code's power, and noise
_STEPS: Final = 10  # a chip: finer than the band can show
_ELSEWHERE: Final = (0.2, 0.8)  # of a period from the signal: where its correlation is noise


def compute_delay_profiles(
    samples: Samples,
    carrier_hz: float,
    signals: Sequence[FoundSignal],
    first_chips: float,
    last_chips: float,
    *,
    start_s: float = 0.0,
    duration_s: float = 0.05,
    most_points: int = 160,
    signal: SignalPlan = GPS_L1_CA,
) -> tuple[Reals, Reals]:
    """Compute power over delay around signals at a known place, in units of the noise's power.

    Parameters
    ----------
    carrier_hz : where the nominal carrier lies in the samples.
    signals : (K,) `delay_s` from `start_s` to the beginning of a code period, and Doppler. What lies within half the
        inverse of a period (500 Hz) of it in frequency is seen as well.
    first_chips, last_chips : bounds of the delays, later than the signal's own; at most `most_points`, evenly spaced.
    start_s, duration_s : the stretch, from the first sample on; whole periods of it are used.

    Returns delays, chips (D,), and powers (K, D).
    Raises ValueError if the stretch holds no code period, or no noise: zeros alone.
    """
    periods, first = _read_periods(samples, carrier_hz, start_s, duration_s, signal)
    if not periods.any():
        raise ValueError(f"nothing but zeros within {duration_s:g} s from {start_s:g} s on")
    reach = periods.shape[1] // 2
    lines = np.arange(-reach, reach + 1)
    fine = signal.code_length * _STEPS
    low, high = round(first_chips * _STEPS), round(last_chips * _STEPS)
    steps = np.arange(low, high + 1, max(-(-(high - low) // most_points), 1))
    far = slice(*(round(share * fine) for share in _ELSEWHERE))
    begun_s = first / samples.rate_hz - start_s
    powers = np.empty((len(signals), steps.size))
    for row, found in enumerate(signals):
        late_s = found.delay_s - found.doppler_hz / signal.carrier_hz * begun_s - begun_s
        ramp = _rotate(np.outer(np.mod(late_s / signal.period_s, 1.0), lines))
        padded = np.zeros((first.size, fine), np.complex64)
        padded[:, lines] = (
            _remove_doppler(periods, found.doppler_hz, signal)
            * ramp
            * np.conj(_compute_code_lines(found.sat, lines, signal))
        )
        waves = fft.ifft(padded, axis=1)
        power = np.asarray(np.mean(waves.real**2 + waves.imag**2, axis=0), np.float64)
        powers[row] = power[steps % fine] / np.mean(power[far])
    return steps / _STEPS, powers


def _rotate(cycles: NDArray[np.floating[Any]]) -> ComplexFloats:
    """Compute exp(j 2 pi cycles)."""
    angle = (2.0 * np.pi * np.mod(cycles, 1.0)).astype(np.float32)
    turns = np.empty(angle.shape, np.complex64)
    turns.real, turns.imag = np.cos(angle), np.sin(angle)
    return turns


def _read_periods(
    samples: Samples, carrier_hz: float, start_s: float, duration_s: float, signal: SignalPlan
) -> tuple[ComplexFloats, Integers]:
    """Compute spectra of code periods at the nominal carrier (n, 2 reach + 1), and each first sample.

    Only the lines within the band are kept, which bounds memory and work whatever the rate.
    """
    exact = samples.rate_hz * signal.period_s
    size = round(exact)
    first = np.round(start_s * samples.rate_hz + np.arange(int(duration_s / signal.period_s)) * exact).astype(np.int64)
    first = first[(first >= 0) & (first + size <= samples.n_samples)]
    if first.size == 0:
        raise ValueError(f"no code period of {signal.period_s:g} s within {duration_s:g} s from {start_s:g} s on")
    planes = samples.read(int(first[0]), int(first[-1] - first[0]) + size)
    rows = first[:, np.newaxis] - first[0] + np.arange(size)
    waves = (planes[0][rows] + 1j * planes[1][rows]) * _rotate(-carrier_hz / samples.rate_hz * np.arange(size))
    reach = min(int(_BAND_HZ * signal.period_s), (size - 1) // 2)
    return fft.fft(waves.astype(np.complex64), axis=1)[:, np.arange(-reach, reach + 1)], first


def _remove_doppler(periods: ComplexFloats, doppler_hz: float, signal: SignalPlan) -> ComplexFloats:
    """Take a Doppler off the spectra: back to few samples a period, turned, and to lines again."""
    lines = periods.shape[1]
    waves = fft.ifft(fft.ifftshift(periods, axes=1), axis=1)
    turned = waves * _rotate(-doppler_hz * signal.period_s / lines * np.arange(lines))
    return np.asarray(fft.fftshift(fft.fft(turned, axis=1), axes=1), np.complex64)


def _compute_code_lines(sat: str, lines: Integers, signal: SignalPlan) -> ComplexFloats:
    """Compute spectral lines of the periodic code with rectangular chips."""
    code = fft.fft(signal.code(prn_of(sat)).astype(np.float64))
    part = lines / code.size
    return np.asarray(code[lines % code.size] * np.sinc(part) * np.exp(-1j * np.pi * part), np.complex64)
