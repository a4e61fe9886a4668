"""Detect several channels in one stream of numbers, by where in a turn each sample stands.

In the samples of one channel a signal has one carrier. Where channels take turns, sample by sample, each position of
the turn has an amplitude and a phase of its own, and so the signal has as many carriers, apart by the rate over their
number (Vaidyanathan, Multirate Systems and Filter Banks, chapter 4). Real channels read as I and Q make mirror images.
The powers there are compared with those of the code at delays without the signal. So an interfering line, which is
present at all delays, does not count. Channels of equal phases, as behind a splitter, have no images; then their
powers, or the correlation of neighbours, go with the position.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import fft

from skyproof.arrays import Booleans, ComplexFloats, Floats, Integers, Reals
from skyproof.gnss.signals import GPS_L1_CA, SignalPlan, prn_of

__all__ = ["InterleavedSignal", "Turns", "turns"]

_POSITIONS: Final = 24
"""Turns of 2, 3, 4, 6, 8 and 12 samples show among so many."""
_SHARE: Final = 0.1
"""Of the signals' power, above which an image is one of channels: imbalance of I and Q or of converters makes less."""
_SIGMAS: Final = 6.0
_SWING: Final = 0.05
"""Of power or of the correlation of neighbours, relative to the power, with the position."""
_BLOCKS, _LINE = 64, 30.0
"""Of the spectrum, for its median, and how far over it a line stands: noise once in 10^9."""
_MOST_SIGNALS, _MOST_SAMPLES, _LEAST_PERIODS = 6, 1 << 18, 4
_APART_HZ: Final = 3e3
"""Nearer to the signal's own carriers an image cannot be distinguished from them in one code period."""
_OFF_CHIPS: Final = (200.5, 401.0, 602.5, 803.0)


@dataclass(frozen=True, kw_only=True)
class InterleavedSignal:
    """A signal found. carrier_hz : in the samples; delay_s : of a code period's start behind the first sample."""

    sat: str
    carrier_hz: float
    delay_s: float
    cn0_dbhz: float


@dataclass(frozen=True, kw_only=True)
class Turns:
    """samples : how many make a turn; 1 in one channel. mirrored : whether I and Q show each signal's mirror image."""

    samples: int
    mirrored: bool = False

    @property
    def one_channel(self) -> bool:
        return self.samples == 1 and not self.mirrored


def turns(
    planes: Floats,
    rate_hz: float,
    signals: Sequence[InterleavedSignal],
    *,
    real: bool,
    code: SignalPlan = GPS_L1_CA,
) -> Turns:
    """Count the samples after which the same channel comes again, by the images of signals found.

    Parameters
    ----------
    planes : (2, n) I and Q; Q zero for real samples.
    signals : found in them; the strongest are looked at.
    """
    as_read = _turns(planes, rate_hz, signals, real, code)
    single = [found for found in signals if _is_single(found, rate_hz)]
    if as_read.one_channel or not single:
        return as_read
    # mirror images among the images of turns look like turns of twice the length
    samples = _turns(planes, rate_hz, single, real, code).samples
    return Turns(samples=samples if samples > 1 or as_read.mirrored else as_read.samples, mirrored=as_read.mirrored)


def _is_single(one: InterleavedSignal, rate_hz: float) -> bool:
    """Test whether mirror images lie clear of all the signal's own images."""
    return abs(math.remainder(2.0 * one.carrier_hz, rate_hz / _POSITIONS)) > _APART_HZ


def _turns(planes: Floats, rate_hz: float, signals: Sequence[InterleavedSignal], real: bool, code: SignalPlan) -> Turns:
    chosen = sorted(signals, key=lambda found: -found.cn0_dbhz)[:_MOST_SIGNALS]
    per_period = rate_hz * code.period_s
    n_periods = min(int(planes.shape[1] / per_period), max(_LEAST_PERIODS, int(_MOST_SAMPLES / per_period)))
    size = int(per_period) // _POSITIONS * _POSITIONS
    if not chosen or n_periods < 1 or size == 0:
        return Turns(samples=1)
    starts = np.round(np.arange(n_periods) * per_period).astype(np.int64) // _POSITIONS * _POSITIONS
    index = starts[:, np.newaxis] + np.arange(size)
    index = index[index[:, -1] < planes.shape[1]]
    wave = planes[0, index] + np.complex64(1j) * planes[1, index]
    straight, mirrored = np.zeros((2, _POSITIONS)), np.zeros((2, _POSITIONS))
    whole = 0.0
    for found in chosen:
        powers, level = _average_powers(wave, index, rate_hz, found, code)
        own_hz = np.arange(_POSITIONS) * rate_hz / _POSITIONS
        twice = np.abs(np.remainder(2.0 * found.carrier_hz + own_hz + 0.5 * rate_hz, rate_hz) - 0.5 * rate_hz)
        clear = twice > _APART_HZ if real else np.ones(_POSITIONS, bool)
        straight += np.where(clear, (powers - level, level**2), 0.0)
        whole += float(powers[0] - level[0])
        if not real and twice[0] > _APART_HZ:
            powers, level = _average_powers(wave.conj(), index, rate_hz, found, code)
            mirrored += np.stack([powers - level, level**2])
    images = np.flatnonzero(_mark_outstanding(straight, whole, len(index)) | _mark_swings(planes))
    return Turns(
        samples=_POSITIONS // math.gcd(_POSITIONS, *(int(image) for image in images)),
        mirrored=bool(_mark_outstanding(mirrored, whole, len(index)).any()),
    )


def _average_powers(
    wave: ComplexFloats, index: Integers, rate_hz: float, one: InterleavedSignal, code: SignalPlan
) -> tuple[Reals, Reals]:
    """Average powers of the signal, and beside it, over code periods, at the carrier and its images.

    The Doppler of the code is less than a tenth of a chip in ten periods and left out.
    """
    chips = code.code(prn_of(one.sat)).astype(np.float32)
    turned = wave * np.exp(-2j * np.pi * np.remainder(index * (one.carrier_hz / rate_hz), 1.0)).astype(np.complex64)
    chip = (index / rate_hz - one.delay_s) * code.chip_rate_hz

    def at(off_chips: float) -> Reals:
        replica = chips[np.floor(chip - off_chips).astype(np.int64) % chips.size]
        sums = (turned * replica).reshape(len(index), -1, _POSITIONS).sum(axis=1)
        return np.asarray(np.mean(np.abs(np.fft.fft(sums, axis=1)) ** 2, axis=0), np.float64)

    return at(0.0), np.mean([at(off) for off in _OFF_CHIPS], axis=0)


def _mark_outstanding(over: Reals, whole: float, n_periods: int) -> Booleans:
    """Mark positions whose power stands out.

    over : (2, positions) of the power over the level beside, and the level's square, both summed over signals.
    """
    sigma = np.sqrt(over[1] / n_periods * (1.0 + 1.0 / len(_OFF_CHIPS)))
    return np.asarray((over[0] > _SHARE * whole) & (over[0] > _SIGMAS * sigma) & (over[1] > 0.0))


def _mark_swings(planes: Floats) -> Booleans:
    """Mark the frequencies of the position at which the power or the correlation of neighbours swings.

    Lines are cut out first: those of the sampling clock, which front ends let in, would swing too.
    """
    spectrum = fft.fft(planes[0] + np.complex64(1j) * planes[1])
    power = np.abs(spectrum) ** 2
    size = power.size // _BLOCKS
    if size == 0:
        return np.zeros(_POSITIONS, bool)
    level = np.median(power[: size * _BLOCKS].reshape(_BLOCKS, size), axis=1)
    spectrum[power > _LINE * level[np.minimum(np.arange(power.size) // size, _BLOCKS - 1)]] = 0.0
    wave = fft.ifft(spectrum)
    n = (wave.size - 1) // _POSITIONS * _POSITIONS
    out = np.zeros(_POSITIONS, bool)
    whole = float(np.mean(np.abs(wave) ** 2))
    if n == 0 or whole == 0.0:
        return out
    for later in (0, 1):
        products = (wave[:n] * wave[later : n + later].conj()).reshape(-1, _POSITIONS).mean(axis=0) / whole
        out |= np.abs(np.fft.fft(products)) / _POSITIONS > max(_SWING, _SIGMAS / math.sqrt(n))
    out[0] = False
    return out
