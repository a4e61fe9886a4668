"""What the signals in a recording tell of the recorder: lost samples, a mirrored spectrum, its oscillator and clock.

Everything follows from the code phases of the satellites already found, measured in short stretches against what their
Dopplers predict: delay(t) = delay(0) - k t doppler / carrier.

- Samples that were lost make the delay of all satellites jump alike.
- k is one. If I and Q are swapped or one of them is inverted, the Doppler is seen with the wrong sign, and k is -1.
- What is left and common to all satellites is the sampling clock's error less that of the local oscillator: none, if
  one oscillator makes both.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Protocol

import numpy as np
from scipy import fft, special

from skyproof.arrays import Booleans, ComplexFloats, Floats, Integers, Reals
from skyproof.gnss.signals import GPS_L1_CA, SignalDescription, prn_of
from skyproof.records import Samples

__all__ = ["DOPPLER_LIMIT_HZ", "Gap", "Heard", "OscillatorError", "Survey", "oscillator_error", "survey"]

DOPPLER_LIMIT_HZ: Final = 5e3
"""Of a GPS satellite's L1 carrier for a receiver that moves slowly on the Earth: 4.9 kHz at the horizon."""

_RANGE_MIDDLE_SIGMA_HZ: Final = (
    2100.0,
    1410.0,
    1080.0,
    805.0,
    630.0,
    540.0,
    435.0,
    390.0,
    345.0,
    310.0,
    260.0,
    200.0,
)
"""How far the middle between the least and greatest Doppler of 1, 2, ... 12 satellites lies from zero, rms, at places
anywhere and satellites taken by chance above 10 degrees of the nominal constellation (tests/recording/test_survey.py).
The mean of the Dopplers is 10 to 25 % worse."""

_CELLS = 2400  # of a code period: 2.4 samples a microsecond hold the main lobe of a C/A code
_BAND_HZ = 1.15e6
_ARM_CHIPS = 0.5  # between early and prompt
_STRETCHES, _MOST_PERIODS = 20, 10
_LEAST_SATS = 3
_PLACE_PERIODS = (2, 1)  # to either side of a gap, for its exact place: then few data bits change in between
_MOST_DRIFT = 1.3e-4  # of all delays, where the rate is wrong by that much
_AT_START = np.arange(-8, 9)  # cells that the delay predicted may be off: a search at a wrong rate errs by chips
_CLEARLY = 1.2  # power along a drifting line over that without drift
_LINE_SIGMAS = 8.0  # beyond what noise has: the most of some thousand lines
_ELSEWHERE_CHIPS = (205.5, 507.5, 809.5)


class Heard(Protocol):
    """A satellite's signal: its code period began `delay_s` after the recording's first sample did."""

    @property
    def sat(self) -> str: ...
    @property
    def delay_s(self) -> float: ...
    @property
    def doppler_hz(self) -> float: ...


@dataclass(frozen=True, kw_only=True)
class _Moved:
    """A signal as `Heard`."""

    sat: str
    delay_s: float
    doppler_hz: float


@dataclass(frozen=True, kw_only=True)
class Gap:
    """Samples are missing: `at_sample` is the first one after the gap, each number with one sigma.

    missing_samples : how many, known modulo a code period only: 0 to `period_samples`. (As many less than a period, put
        in twice, look the same.)
    """

    at_sample: int
    at_sigma_samples: float
    missing_samples: float
    missing_sigma_samples: float
    period_samples: float


@dataclass(frozen=True, kw_only=True)
class Survey:
    """What the code phases tell.

    gaps : in order. doppler_ratio : code Doppler over carrier Doppler, 1 or, if the spectrum is mirrored, -1; with one
        sigma. conjugate : whether it is mirrored; None if the recording is too short to tell.
    conjugate_error_probability : that this is wrong, both being equally likely before; 0.5 where it is not known.
    clock_minus_lo_ppm : how much faster the sampling clock is than the local oscillator says, with one sigma.
    """

    gaps: tuple[Gap, ...] = ()
    doppler_ratio: float = math.nan
    doppler_ratio_sigma: float = math.inf
    conjugate: bool | None = None
    conjugate_error_probability: float = 0.5
    clock_minus_lo_ppm: float = math.nan
    clock_minus_lo_sigma_ppm: float = math.inf


@dataclass(frozen=True, kw_only=True)
class OscillatorError:
    """How much too high signals appear, in hertz, with one sigma; `ppm` of the oscillator is the opposite: too slow."""

    doppler_hz: float
    sigma_hz: float


def oscillator_error(dopplers_hz: Sequence[float] | Reals) -> OscillatorError:
    """The Doppler common to all satellites, with orbits and place unknown: the middle of their range.

    True Dopplers lie within 4.9 kHz of zero, on either side alike. One sigma is that of the middle for as many
    satellites as there are. NaN without a satellite.
    """
    values = np.asarray(dopplers_hz, np.float64)
    if values.size == 0:
        return OscillatorError(doppler_hz=math.nan, sigma_hz=math.inf)
    middle = 0.5 * float(values.min() + values.max())
    sigma_hz = _RANGE_MIDDLE_SIGMA_HZ[min(values.size, len(_RANGE_MIDDLE_SIGMA_HZ)) - 1]
    return OscillatorError(doppler_hz=middle, sigma_hz=sigma_hz)


# --- code phases


@dataclass(frozen=True, eq=False, kw_only=True)
class _Blocks:
    """One code period after the other, at zero frequency and few samples a chip: (n_blocks, _CELLS).

    changing : whether the samples change in every one.
    """

    waves: ComplexFloats
    first_sample: Integers  # (n_blocks,)
    block_samples: int
    rate_hz: float
    signal: SignalDescription
    changing: bool

    @property
    def block_s(self) -> float:
        return self.block_samples / self.rate_hz


@dataclass(frozen=True, eq=False, kw_only=True)
class _Tracks:
    """Correlation of every satellite in every stretch, around the delay predicted.

    around : (n_sats, n_stretches, _CELLS) power over the noise's mean, all delays, that predicted first.
    middle_s : (n_stretches,) since the first sample.
    """

    spectra: ComplexFloats  # (n_sats, n_blocks, _CELLS) of signal times conjugate code
    around: Floats
    middle_s: Reals
    ratio: float  # of code Doppler to carrier Doppler that was taken
    periods: int  # blocks a stretch
    noise: Reals  # (n_sats,) mean power of one block's cell


def survey(
    samples: Samples,
    carrier_hz: float,
    signals: Sequence[Heard],
    *,
    signal: SignalDescription = GPS_L1_CA,
    false_alarm_probability: float = 1e-4,
    longest_s: float = 0.5,
    _drifts: bool = True,
) -> Survey:
    """What the code phases of `signals` tell of the recorder, from at most the first `longest_s`.

    Parameters
    ----------
    samples, carrier_hz : the recording and where the nominal carrier lies in it.
    signals : found near its beginning; one a satellite is used, the first.
    false_alarm_probability : of one gap or more reported in a recording that has none. At least three satellites are
        needed, so that one signal's own jump is not taken for a gap. Nothing is reported where the samples do not
        change in one code period or more: what noise does to a delay cannot be learnt there.
    """
    unique = list({heard.sat: heard for heard in reversed(signals)}.values())[::-1]
    n_blocks = int(min(longest_s, samples.duration_s) / signal.period_s)
    if len(unique) < _LEAST_SATS or n_blocks < 3:
        return Survey()
    blocks = _blocks(samples, carrier_hz, n_blocks, signal)
    if not blocks.changing:
        return Survey()
    spectra = np.stack([_correlation_spectra(blocks, heard) for heard in unique])
    # the wrong sign of the Doppler smears the peaks of a long recording: take the one that gives more
    lines = [(tracks, *_line(blocks, tracks)) for tracks in (_tracks(blocks, unique, spectra, r) for r in (1.0, -1.0))]
    tracks, _, drift = max(lines, key=lambda line: line[1])
    if drift != 0.0 and _drifts:
        met = _met(blocks, unique, tracks, drift)
        return _drifting(
            samples,
            carrier_hz,
            met,
            drift,
            signal=signal,
            false_alarm_probability=false_alarm_probability,
            longest_s=longest_s,
        )
    breaks, cells = _jumps(tracks, false_alarm_probability / 2.0)
    levels = _levels(blocks, unique, tracks, breaks, cells, false_alarm_probability / 2.0)
    gaps = _gaps(samples, carrier_hz, blocks, unique, tracks, levels)
    return replace(_reading(unique, tracks, levels, signal), gaps=gaps)


def _blocks(samples: Samples, carrier_hz: float, n_blocks: int, signal: SignalDescription) -> _Blocks:
    exact = samples.rate_hz * signal.period_s
    size = round(exact)
    first = np.round(np.arange(n_blocks) * exact).astype(np.int64)
    first = first[first + size <= samples.n_samples]
    phasor = np.exp(-2j * np.pi * np.mod(carrier_hz / samples.rate_hz * np.arange(size), 1.0)).astype(np.complex64)
    kept = _bins(size, samples.rate_hz)
    waves = np.zeros((first.size, _CELLS), np.complex64)
    changing = True
    for row, start in enumerate(first):  # one period at a time: memory stays with the few cells that are kept
        planes = samples.read(int(start), size)
        changing &= bool(np.ptp(planes) > 0.0)
        spectrum = fft.fft((planes[0] + 1j * planes[1]) * phasor)
        waves[row, kept] = spectrum[kept]
    waves = fft.ifft(waves, axis=1)
    return _Blocks(
        waves=waves, first_sample=first, block_samples=size, rate_hz=samples.rate_hz, signal=signal, changing=changing
    )


def _bins(size: int, rate_hz: float) -> Integers:
    """Indices of the FFT bins that are kept, which count from the end for negative frequencies."""
    reach = min(int(_BAND_HZ * size / rate_hz), (size - 1) // 2, _CELLS // 2 - 1)
    return np.arange(-reach, reach + 1)


def _correlation_spectra(blocks: _Blocks, heard: Heard) -> ComplexFloats:
    """Spectra of all blocks, Doppler taken off, times the conjugate one of the code."""
    size, rate_hz = blocks.block_samples, blocks.rate_hz
    chips = blocks.signal.code(prn_of(heard.sat))
    fine = np.arange(8 * _CELLS) * (blocks.block_s / (8 * _CELLS)) * blocks.signal.chip_rate_hz
    code = fft.fft(chips[np.floor(fine).astype(np.int64) % chips.size].astype(np.float64))
    kept = _bins(size, rate_hz)
    replica = np.zeros(_CELLS, np.complex64)
    replica[kept] = np.conj(code[kept]) / (8 * _CELLS)
    turns = np.mod(heard.doppler_hz * blocks.block_s / _CELLS * np.arange(_CELLS), 1.0)
    spectra: ComplexFloats = fft.fft(blocks.waves * np.exp(-2j * np.pi * turns).astype(np.complex64), axis=1) * replica
    return spectra


def _tracks(blocks: _Blocks, signals: Sequence[Heard], spectra: ComplexFloats, ratio: float) -> _Tracks:
    n_blocks = spectra.shape[1]
    periods = int(np.clip(n_blocks // _STRETCHES, 1, _MOST_PERIODS))
    n_stretches = n_blocks // periods
    around = np.empty((len(signals), n_stretches, _CELLS), np.float32)
    for row, heard in enumerate(signals):
        # one ramp a stretch: within it the delay moves by a few hundredths of a chip, and half a sample for rounding
        ramps = _ramp(blocks, _by_stretch(_predicted_s(blocks, heard, ratio), periods).mean(axis=1))
        for j, ramp in enumerate(ramps):
            waves = fft.ifft(spectra[row, j * periods : (j + 1) * periods] * ramp, axis=-1)
            around[row, j] = np.sum(waves.real**2 + waves.imag**2, axis=0)
    noise = np.median(around[:, :, ::3], axis=(1, 2)) / special.gammaincinv(periods, 0.5)
    around /= noise[:, np.newaxis, np.newaxis] * periods
    middle_s = (_by_stretch(blocks.first_sample, periods).mean(axis=1) + 0.5 * blocks.block_samples) / blocks.rate_hz
    return _Tracks(spectra=spectra, around=around, middle_s=middle_s, ratio=ratio, periods=periods, noise=noise)


def _by_stretch(values: Reals | Integers, periods: int) -> Reals:
    """Values of all blocks as (n_stretches, periods); what fills no stretch is left out."""
    n_stretches = values.size // periods
    return np.asarray(values[: n_stretches * periods].reshape(n_stretches, periods), np.float64)


def _predicted_s(blocks: _Blocks, heard: Heard, ratio: float) -> Reals:
    """Delay of the code's start after each block's first sample, not reduced to one period."""
    start_s = blocks.first_sample / blocks.rate_hz
    # whole periods are taken off exactly: the blocks' starts are rounded to samples
    past_s = start_s - np.arange(start_s.size) * blocks.signal.period_s
    return heard.delay_s - past_s - ratio * heard.doppler_hz / blocks.signal.carrier_hz * start_s


def _ramp(blocks: _Blocks, delay_s: Reals) -> ComplexFloats:
    """What brings a delay to the first cell: (..., _CELLS)."""
    bins = fft.fftfreq(_CELLS, 1.0 / _CELLS)
    turns = np.multiply.outer(np.asarray(delay_s) / blocks.block_s, bins)
    return np.asarray(np.exp(2j * np.pi * np.mod(turns, 1.0)), np.complex64)


def _line(blocks: _Blocks, tracks: _Tracks) -> tuple[float, float]:
    """The power along the straight line of common delays that holds most, and its drift: 0 unless a drift that makes
    more than a cell or so of difference holds clearly more.

    Without drift any delay is looked at: what a gap does to it is the same for either sign of the Doppler.
    """
    total = np.sum(tracks.around, axis=0)
    level = float(np.max(np.sum(total, axis=0)))
    cell_s = blocks.block_s / _CELLS
    step = 0.5 * cell_s / float(np.ptp(tracks.middle_s) + 1e-9)
    drifts = step * np.arange(-math.ceil(_MOST_DRIFT / step), math.ceil(_MOST_DRIFT / step) + 1)
    drifts = drifts[np.abs(drifts) > 2.0 * step]
    if drifts.size == 0 or tracks.middle_s.size < 3:
        return level, 0.0
    stretches = np.arange(tracks.middle_s.size)
    power = np.zeros(drifts.size)
    for number, drift in enumerate(drifts):
        power[number] = np.max(np.sum(total[stretches, _along(tracks, drift, cell_s)], axis=1))
    best = int(np.argmax(power))
    noise = float(tracks.around.shape[0] * tracks.middle_s.size)
    if power[best] - noise < _CLEARLY * max(level - noise, 0.0) + _LINE_SIGMAS * math.sqrt(noise / tracks.periods):
        return level, 0.0
    return float(power[best]), float(drifts[best])


def _along(tracks: _Tracks, drift: float, cell_s: float) -> Integers:
    """Cells of a drifting delay in each stretch, for each of those at the start: (n_starts, n_stretches)."""
    cells: Integers = (np.round(drift * tracks.middle_s / cell_s).astype(np.int64) + _AT_START[:, np.newaxis]) % _CELLS
    return cells


def _met(blocks: _Blocks, signals: Sequence[Heard], tracks: _Tracks, drift: float) -> list["_Moved"]:
    """The signals with the delays that they have along the line: a search at a wrong rate smears each by chips."""
    cell_s = blocks.block_s / _CELLS
    cells = _along(tracks, drift, cell_s)
    starts = [_peak_at(np.sum(mine[np.arange(mine.shape[0]), cells], axis=1)) for mine in tracks.around]
    return [
        _Moved(sat=one.sat, delay_s=one.delay_s + start * cell_s, doppler_hz=one.doppler_hz)
        for one, start in zip(signals, starts, strict=True)
    ]


def _peak_at(power: Reals | Floats) -> float:
    """Cells of the highest of `_AT_START`, by the parabola through it and its neighbours."""
    best = int(np.clip(np.argmax(power), 1, power.size - 2))
    low, middle, high = (float(value) for value in power[best - 1 : best + 2])
    bend = low - 2.0 * middle + high
    return float(_AT_START[best]) + (float(np.clip(0.5 * (low - high) / bend, -1.0, 1.0)) if bend < 0.0 else 0.0)


def _drifting(
    samples: Samples,
    carrier_hz: float,
    signals: Sequence[Heard],
    drift: float,
    *,
    signal: SignalDescription,
    false_alarm_probability: float,
    longest_s: float,
) -> Survey:
    """The survey at the rate by which the common drift is nearly none, and what that rate is off.

    A carrier's frequency is in cycles a sample: at another rate it is another one in hertz.
    """
    rated = replace(samples, rate_hz=samples.rate_hz / (1.0 - drift))
    moved = [
        _Moved(sat=one.sat, delay_s=one.delay_s, doppler_hz=one.doppler_hz + drift * (carrier_hz + one.doppler_hz))
        for one in signals
    ]
    found = survey(
        rated,
        carrier_hz,
        moved,
        signal=signal,
        false_alarm_probability=false_alarm_probability,
        longest_s=longest_s,
        _drifts=False,
    )
    return replace(found, clock_minus_lo_ppm=found.clock_minus_lo_ppm + 1e6 * drift)


# --- jumps


def _jumps(tracks: _Tracks, probability: float) -> tuple[list[int], list[int]]:
    """Stretches at which the common delay jumps by more than a chip or so, and the delay (in cells) from each on.

    The sum over satellites and periods of noise alone is Gamma; what exceeds its quantile for all delays and stretches,
    and stands above everything near the delay expected, is where the satellites are.
    """
    total = np.sum(tracks.around, axis=0)
    shape = tracks.around.shape[0] * tracks.periods
    threshold = special.gammainccinv(shape, probability / total.size) / tracks.periods
    best = np.argmax(total, axis=1)
    breaks, cells = [0], [0]
    near = np.arange(-3, 4)
    for j, cell in enumerate(best):
        here = total[j, (cells[-1] + near) % _CELLS].max()
        if total[j, cell] <= threshold or total[j, cell] <= here:
            continue
        mine = tracks.around[:, j]
        moved = mine[:, (cell + near) % _CELLS].max(axis=1) > mine[:, (cells[-1] + near) % _CELLS].max(axis=1)
        if np.mean(moved) > 0.5:
            breaks.append(j)
            cells.append(int(cell))
    if len(breaks) > 1 and breaks[1] == 0:  # the prediction itself was off
        breaks, cells = [0, *breaks[2:]], cells[1:]
    return breaks, cells


@dataclass(frozen=True, eq=False, kw_only=True)
class _Levels:
    """The common delay beyond the prediction: `offset_s` from stretch `breaks` on, plus `drift` times the time.

    covariance : of (offset_s..., drift). errors_s : (n_sats, n_stretches) each satellite's delay beyond this model;
    sigma_s : (n_sats,) of one of them. used : (n_stretches,) those that the model was fitted to.
    """

    breaks: list[int]
    offset_s: Reals
    drift: float
    covariance: Reals
    errors_s: Reals
    sigma_s: Reals
    used: Booleans


def _levels(
    blocks: _Blocks, signals: Sequence[Heard], tracks: _Tracks, breaks: list[int], cells: list[int], probability: float
) -> _Levels:
    """Fit a level between jumps and one drift, and look for smaller jumps until there are none."""
    middle_s, n_stretches = tracks.middle_s, tracks.middle_s.size
    used = np.ones(n_stretches, bool)
    centred = (np.array(cells) + _CELLS // 2) % _CELLS - _CELLS // 2
    centre_s = (centred * (blocks.block_s / _CELLS))[_segment_of(breaks, n_stretches)]
    errors_s, sigma_s = _delay_errors(blocks, signals, tracks, centre_s)
    # Each pass measures nearer to the peaks, where early and late are balanced; smaller jumps show once drift is off.
    for look in (False, True, False):
        common_s, common_sigma_s = _weighted(errors_s, sigma_s)
        offset_s, drift, _ = _fit(middle_s, centre_s + common_s, common_sigma_s, breaks, used)
        centre_s = offset_s[_segment_of(breaks, n_stretches)] + drift * middle_s
        errors_s, sigma_s = _delay_errors(blocks, signals, tracks, centre_s)
        if look:
            breaks, used = _smaller_jumps(middle_s, errors_s, sigma_s, breaks, used, probability)
    return _fitted(middle_s, centre_s + errors_s, sigma_s, breaks, used)


def _fitted(middle_s: Reals, delay_s: Reals, sigma_s: Reals, breaks: list[int], used: Booleans) -> _Levels:
    """The model of the delays (n_sats, n_stretches) of all satellites, fitted to the stretches used."""
    common_s, common_sigma_s = _weighted(delay_s, sigma_s)
    offset_s, drift, covariance = _fit(middle_s, common_s, common_sigma_s, breaks, used)
    model_s = offset_s[_segment_of(breaks, middle_s.size)] + drift * middle_s
    return _Levels(
        breaks=breaks,
        offset_s=offset_s,
        drift=drift,
        covariance=covariance,
        errors_s=delay_s - model_s,
        sigma_s=sigma_s,
        used=used,
    )


def _segment_of(breaks: Sequence[int], n_stretches: int) -> Integers:
    return np.searchsorted(np.asarray(breaks), np.arange(n_stretches), side="right") - 1


def _delay_errors(blocks: _Blocks, signals: Sequence[Heard], tracks: _Tracks, centre_s: Reals) -> tuple[Reals, Reals]:
    """Delay beyond prediction and centre of each satellite in each stretch, and one sigma for each satellite.

    Late less early power over their sum, which is taken over all stretches so that a weak one is not divided by noise.
    The powers of a cell with signal-to-noise ratio r are non-central chi-square: variance 1 + 2 r of a period.
    """
    n_stretches, periods = tracks.middle_s.size, tracks.periods
    chip_s = 1.0 / blocks.signal.chip_rate_hz
    bins = fft.fftfreq(_CELLS, 1.0 / _CELLS)
    arms = np.exp(2j * np.pi * np.outer(bins, [-_ARM_CHIPS, _ARM_CHIPS]) * chip_s / blocks.block_s) / _CELLS
    arms = arms.astype(np.complex64)
    slope_per_chip = _early_late_slope(blocks)
    errors_s, sigma_s = np.empty((len(signals), n_stretches)), np.empty(len(signals))
    for row, heard in enumerate(signals):
        delay_s = _by_stretch(_predicted_s(blocks, heard, tracks.ratio), periods).mean(axis=1) + centre_s
        replicas = _ramp(blocks, delay_s)[:, :, np.newaxis] * arms
        spectra = tracks.spectra[row, : n_stretches * periods].reshape(n_stretches, periods, _CELLS)
        early, late = (np.abs(spectra @ replicas) ** 2).sum(axis=1).T / tracks.noise[row]
        ratio = max(float(np.mean(early + late)) / (2.0 * periods) - 1.0, 0.01)  # signal to noise on either arm
        scale = slope_per_chip * 2.0 * periods * ratio / chip_s
        errors_s[row] = (late - early) / scale
        sigma_s[row] = math.sqrt(periods * (2.0 + 4.0 * ratio)) / scale
    return errors_s, sigma_s


def _early_late_slope(blocks: _Blocks) -> float:
    """Change of (late - early) / (late + early) per chip of delay, for a smooth code spectrum in the band kept."""
    chips = blocks.block_s * blocks.signal.chip_rate_hz
    bins = _bins(blocks.block_samples, blocks.rate_hz)
    angle = 2.0 * np.pi * bins / chips
    weight = np.sinc(bins / chips) ** 2
    shape, steepness = np.sum(weight * np.cos(angle * _ARM_CHIPS)), np.sum(weight * angle * np.sin(angle * _ARM_CHIPS))
    return float(2.0 * steepness / shape)


def _weighted(values: Reals, sigma: Reals) -> tuple[Reals, float]:
    """Mean over satellites (axis 0) by their sigmas, and its sigma: no less than what the scatter shows."""
    weight = 1.0 / sigma**2
    mean = weight @ values / weight.sum()
    stated = 1.0 / math.sqrt(weight.sum())
    if mean.size < 8:
        return mean, stated
    # second differences know neither level nor drift, and their median no jump; variance 6 of white noise
    shown = 1.4826 * float(np.median(np.abs(np.diff(mean, 2)))) / math.sqrt(6.0)
    return mean, max(stated, shown)


def _fit(
    time_s: Reals, values: Reals, sigma: float, breaks: Sequence[int], used: Booleans
) -> tuple[Reals, float, Reals]:
    """Least squares of a level from each break on and one drift, none where there is too little to tell it."""
    segment = _segment_of(breaks, time_s.size)
    design = np.zeros((time_s.size, len(breaks) + 1))
    design[np.arange(time_s.size), segment] = 1.0
    if np.count_nonzero(used) > len(breaks) + 1:
        design[:, -1] = time_s
    inverse = np.linalg.pinv(design[used])
    solution = inverse @ values[used]
    return solution[:-1], float(solution[-1]), sigma**2 * (inverse @ inverse.T)


def _smaller_jumps(
    time_s: Reals, errors_s: Reals, sigma_s: Reals, breaks: list[int], used: Booleans, probability: float
) -> tuple[list[int], Booleans]:
    """Breaks, with those added where the common delay jumps by more than noise does anywhere with `probability`.

    A break at k is a jump within the stretch before it, which belongs to neither side and is used no more. The
    strongest satellite must not be the only one that jumps.
    """
    limit = float(special.ndtri(1.0 - 0.5 * probability / max(time_s.size, 1)))
    others = np.arange(sigma_s.size) != np.argmin(sigma_s)
    series = [_weighted(errors_s, sigma_s), _weighted(errors_s[others], sigma_s[others])]

    def without(k: int) -> Booleans:
        return np.asarray(used & (np.arange(time_s.size) != k - 1))

    def possible(k: int) -> bool:
        segment = _segment_of(sorted([*breaks, k]), time_s.size)
        return k not in breaks and np.unique(segment[without(k)]).size == len(breaks) + 1

    def significance(k: int, which: int) -> float:
        more = sorted([*breaks, k])
        offset_s, _, covariance = _fit(time_s, *series[which], more, without(k))
        row = more.index(k)
        pick = np.zeros(covariance.shape[0])
        pick[row], pick[row - 1] = 1.0, -1.0
        return float((offset_s[row] - offset_s[row - 1]) / math.sqrt(pick @ covariance @ pick))

    while len(breaks) + 2 < np.count_nonzero(used):
        scores = {k: significance(k, 0) for k in range(1, time_s.size) if possible(k)}
        if not scores:
            break
        best = max(scores, key=lambda k: abs(scores[k]))
        if abs(scores[best]) <= limit or significance(best, 1) * math.copysign(1.0, scores[best]) <= 0.5 * limit:
            break
        used = without(best)
        breaks = sorted([*breaks, best])
    return breaks, used


# --- gaps


def _gaps(
    samples: Samples, carrier_hz: float, blocks: _Blocks, signals: Sequence[Heard], tracks: _Tracks, levels: _Levels
) -> tuple[Gap, ...]:
    """Place and size of each jump; the stretch that holds a jump has no part in its size."""
    places = [_place(samples, carrier_hz, blocks, signals, tracks, levels, row) for row in range(1, len(levels.breaks))]
    middle_s = tracks.middle_s
    half_s = 0.5 * tracks.periods * blocks.signal.period_s
    used = np.ones(middle_s.size, bool)
    for at, sigma in places:
        used &= np.abs(middle_s - at / blocks.rate_hz) > half_s + sigma / blocks.rate_hz
    segment = _segment_of(levels.breaks, middle_s.size)
    for number in range(len(levels.breaks)):  # a level needs at least one stretch
        if not used[segment == number].any():
            used[segment == number] = True
    model_s = levels.offset_s[segment] + levels.drift * middle_s
    final = _fitted(middle_s, levels.errors_s + model_s, levels.sigma_s, levels.breaks, used)
    period = blocks.rate_hz * blocks.signal.period_s
    gaps = []
    for row, (at, sigma) in enumerate(places, 1):
        pick = np.zeros(final.covariance.shape[0])
        pick[row - 1], pick[row] = 1.0, -1.0  # what is missing makes the next code period come early
        missing = blocks.rate_hz * float(pick[:-1] @ final.offset_s)
        missing_sigma = blocks.rate_hz * math.sqrt(float(pick @ final.covariance @ pick))
        gaps.append(
            Gap(
                at_sample=round(at),
                at_sigma_samples=sigma,
                missing_samples=missing % period,
                missing_sigma_samples=missing_sigma,
                period_samples=period,
            )
        )
    return tuple(gaps)


def _place(
    samples: Samples,
    carrier_hz: float,
    blocks: _Blocks,
    signals: Sequence[Heard],
    tracks: _Tracks,
    levels: _Levels,
    row: int,
) -> tuple[float, float]:
    """The first sample after jump number `row`: mean and spread of its likelihood, each place being as likely before.

    First among code periods, by the powers at the delays before and after; then among samples, by the energies of the
    two coherent sums, up to the place and from it on, of every satellite.
    """
    k = levels.breaks[row]
    begin = max(levels.breaks[row - 1], k - 2)
    end = min([*levels.breaks, tracks.middle_s.size][row + 1], k + 2)
    part = slice(begin * tracks.periods, end * tracks.periods)
    extra_s = levels.offset_s[[row - 1, row]] + levels.drift * tracks.middle_s[k]
    gain = np.zeros(part.stop - part.start)
    for number, heard in enumerate(signals):
        delay_s = _predicted_s(blocks, heard, tracks.ratio)[part]
        before, after = (
            np.abs(np.mean(tracks.spectra[number, part] * _ramp(blocks, delay_s + extra), axis=1)) ** 2
            for extra in extra_s
        )
        gain += (after - before) / tracks.noise[number]
    # a jump at the beginning of period b loses all gains before it
    first_period = part.start + int(np.argmax(-np.concatenate([[0.0], np.cumsum(gain)])))
    at, sigma = float(first_period * blocks.block_samples), 0.0
    for periods in _PLACE_PERIODS:
        start = max(0, round(at) - periods * blocks.block_samples)
        count = min(round(at) + periods * blocks.block_samples, samples.n_samples) - start
        at, sigma = _likeliest(samples.read(start, count), start, carrier_hz, blocks, signals, tracks.ratio, extra_s)
    return at, sigma


def _likeliest(
    planes: Floats,
    start: int,
    carrier_hz: float,
    blocks: _Blocks,
    signals: Sequence[Heard],
    ratio: float,
    extra_s: Reals,
) -> tuple[float, float]:
    """Mean and spread of where, in a stretch that begins at sample `start`, the delay changes between two values."""
    count = planes.shape[1]
    wave = (planes[0] + 1j * planes[1]).astype(np.complex128)
    time_s = (start + np.arange(count)) / blocks.rate_hz
    counts = np.arange(1, count)
    score, noise = np.zeros(count - 1), 0.0
    for heard in signals:
        chips = blocks.signal.code(prn_of(heard.sat))
        turns = np.mod((carrier_hz + heard.doppler_hz) / blocks.rate_hz * np.arange(count), 1.0)
        base = wave * np.exp(-2j * np.pi * turns)
        at_chip = (
            time_s * (1.0 + ratio * heard.doppler_hz / blocks.signal.carrier_hz) - heard.delay_s
        ) * blocks.signal.chip_rate_hz

        before, after, *elsewhere = (
            base * chips[np.floor(at_chip - extra).astype(np.int64) % chips.size]
            for extra in (*(extra_s * blocks.signal.chip_rate_hz), *_ELSEWHERE_CHIPS)
        )
        up_to, from_on = np.cumsum(before[:-1]), np.cumsum(after[:0:-1])[::-1]
        score += np.abs(up_to) ** 2 / counts + np.abs(from_on) ** 2 / counts[::-1]
        # the noise of such a sum, from delays where there is no signal
        noise += float(np.mean([abs(np.sum(wrong)) ** 2 for wrong in elsewhere])) / count
    likelihood = np.exp((score - score.max()) * len(signals) / noise)
    likelihood /= likelihood.sum()
    mean = float(likelihood @ counts)
    return start + mean, math.sqrt(float(likelihood @ (counts - mean) ** 2))


# --- Doppler's sign and the clock


def _reading(signals: Sequence[Heard], tracks: _Tracks, levels: _Levels, signal: SignalDescription) -> Survey:
    """Code Doppler over carrier Doppler, and what of the code's drift is common, from each satellite's own drift."""
    used = levels.used
    time_s = tracks.middle_s[used] - tracks.middle_s[used].mean()
    if time_s.size < 3:
        return Survey()
    errors_s = levels.errors_s[:, used]
    drift = levels.drift + errors_s @ time_s / np.sum(time_s**2)
    excess = _excess(errors_s, levels.sigma_s, time_s, drift - levels.drift)
    sigma = levels.sigma_s * excess / math.sqrt(np.sum(time_s**2))
    expected = np.array([heard.doppler_hz for heard in signals]) / signal.carrier_hz
    design = np.stack([np.ones(len(signals)), expected], axis=1) / sigma[:, np.newaxis]
    covariance = np.linalg.pinv(design.T @ design)
    _, beyond = covariance @ design.T @ (drift / sigma)
    ratio, ratio_sigma = float(tracks.ratio - beyond), math.sqrt(float(covariance[1, 1]))
    error = float(special.expit(-2.0 * abs(ratio) / ratio_sigma**2))
    reliable = error < 1e-3 and abs(abs(ratio) - 1.0) < 5.0 * ratio_sigma + 0.1
    if not reliable:
        return Survey(doppler_ratio=ratio, doppler_ratio_sigma=ratio_sigma, conjugate_error_probability=0.5)
    drift = drift - (tracks.ratio - math.copysign(1.0, ratio)) * expected
    weight = 1.0 / sigma**2
    return Survey(
        doppler_ratio=ratio,
        doppler_ratio_sigma=ratio_sigma,
        conjugate=ratio < 0.0,
        conjugate_error_probability=error,
        clock_minus_lo_ppm=1e6 * float(weight @ drift / weight.sum()),
        clock_minus_lo_sigma_ppm=1e6 / math.sqrt(float(weight.sum())),
    )


def _excess(errors_s: Reals, sigma_s: Reals, time_s: Reals, drift: Reals) -> float:
    """Scatter of the delays around each satellite's own line over what noise explains, at least one."""
    left = errors_s - errors_s.mean(axis=1, keepdims=True) - np.outer(drift, time_s)
    freedom = errors_s.shape[0] * (time_s.size - 2)
    return max(1.0, math.sqrt(float(np.sum((left / sigma_s[:, np.newaxis]) ** 2)) / freedom))
