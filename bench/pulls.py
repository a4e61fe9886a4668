"""What the correlation of a second signal does to loops of their own: where they can stay, by how much they are pulled.

Without noise. Side lobes of the code are included.
"""

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray
from waves import CHIP_M, RATE_HZ, SAT, Cell

from skyproof.arrays import Reals
from skyproof.gnss.signals import GPS_L1_CA, prn_of
from skyproof.receiver.replica import low_pass_gain
from skyproof.receiver.tracking import Receiver


@cache
def _shape(rate_hz: float) -> tuple[Reals, Reals]:
    """Correlation of signal and replica out to 12 chips, side lobes of the code included: where, and how high.

    Sharp chips in the samples, chips behind the replica's low-pass against them; 1 at the highest.
    """
    chips_per_sample = GPS_L1_CA.chip_rate_hz / rate_hz
    f = (np.arange(4000) + 0.5) / 4000.0 * 0.5 / chips_per_sample
    weight = np.sinc(f) ** 2 * low_pass_gain(f * chips_per_sample)
    x = np.linspace(-4.0, 4.0, 801)
    top = (np.cos(2.0 * np.pi * np.outer(x, f)) @ weight) / weight.sum()
    chips = GPS_L1_CA.code(prn_of(SAT)).astype(np.float64)
    lobes = np.fft.ifft(np.abs(np.fft.fft(chips)) ** 2).real / chips.size
    at = np.linspace(-12.0, 12.0, 2401)
    high = sum(lobes[k % chips.size] * np.interp(at - k, x, top, left=0.0, right=0.0) for k in range(-16, 17))
    return at, np.asarray(high)


def correlation(delay_chips: Reals, rate_hz: float = RATE_HZ) -> Reals:
    """Of signal and replica, at most 12 chips apart; any shape."""
    return np.asarray(np.interp(delay_chips, *_shape(rate_hz)))


@cache
def _receiver(rate_hz: float) -> Receiver:
    return Receiver(rate_hz)


def _taps(tau: Reals, cell: Cell, wave: NDArray[np.complex128], half: float) -> NDArray[np.complex128]:
    """Early, prompt, late, (3, ...), of a replica `tau` later than a signal of 1, beside the other one of `wave`."""
    at = tau + np.array([-half, 0.0, half]).reshape(3, *[1] * tau.ndim)
    return correlation(at, cell.rate_hz) + wave * correlation(at - cell.apart_chips, cell.rate_hz)


@cache
def stays(cell: Cell, of_second: bool, n_phases: int = 64) -> tuple[float, Reals]:
    """Share of phases for which a loop without noise that begins on a signal is still there after 3 s, and where.

    The loop of `kernels`: normalised dot product, 4 Hz for the first half second, then 1 Hz; every 5 ms.
    """
    receiver = _receiver(cell.rate_hz)
    half, gain = float(receiver.taps_chips[0]), receiver.discriminator.gain
    amplitude = 10.0 ** ((-cell.relative_db if of_second else cell.relative_db) / 20.0)
    phase = np.arange(n_phases) / n_phases
    tau = np.zeros(n_phases)
    step_s = 0.005
    power: Reals | None = None
    settings = receiver.settings
    for k in range(600):
        wave = amplitude * np.exp(2j * np.pi * (phase + cell.apart_hz * k * step_s)) * np.sinc(cell.apart_hz * step_s)
        early, prompt, late = _taps(tau, cell, wave, half)
        now = np.abs(prompt) ** 2
        power = now if power is None else power + 0.1 * (now - power)
        dot = ((late - early) * np.conj(prompt)).real / np.maximum(power, 0.05) / gain
        bandwidth_hz = (settings.pull_in if k * step_s < settings.pull_in_s else settings.tracking).dll_bandwidth_hz
        tau = tau + 4.0 * bandwidth_hz * step_s * np.clip(dot, -0.5, 0.5)
    present = np.abs(tau) < min(0.5, 0.5 * cell.apart_chips)
    return float(present.mean()), np.where(present, tau, np.nan)


def pulls(cell: Cell, of_second: bool, n_phases: int = 32) -> tuple[float, float]:
    """What the other signal does to the measured code (m) and Doppler (Hz) of one: rms over the phase between them.

    Without a difference of Doppler the loop goes along with the pull, to where its discriminator is zero; with one it
    stands, and the measurement, over 0.2 s in bits of 20 ms, has the pull to itself.
    """
    receiver = _receiver(cell.rate_hz)
    half, gain = float(receiver.taps_chips[0]), receiver.discriminator.gain
    if cell.apart_hz == 0.0:
        _, tau = stays(cell, of_second)
        rms = float(np.sqrt(np.nanmean(tau**2))) if np.isfinite(tau).any() else math.nan
        return CHIP_M * rms, 0.0
    amplitude = 10.0 ** ((-cell.relative_db if of_second else cell.relative_db) / 20.0)
    t_s = (np.arange(10) + 0.5) * 0.02 - 0.1
    phase = np.arange(n_phases)[:, None] / n_phases + cell.apart_hz * t_s
    wave = amplitude * np.exp(2j * np.pi * phase) * np.sinc(cell.apart_hz * 0.02)
    early, prompt, late = _taps(np.zeros((n_phases, 1)), cell, wave, half)
    angle = 0.5 * np.unwrap(2.0 * np.angle(prompt), axis=1)
    fit = np.polynomial.polynomial.polyfit(t_s, angle.T, 2)
    wipe = np.exp(-1j * np.polynomial.polynomial.polyval(t_s, fit))
    wipe = np.where((prompt * wipe).real < 0.0, -wipe, wipe)
    tau = ((late - early) * wipe).real.sum(axis=1) / (prompt * wipe).real.sum(axis=1) / gain
    return CHIP_M * float(np.sqrt(np.mean(tau**2))), float(np.sqrt(np.mean((fit[1] / (2.0 * np.pi)) ** 2)))
