"""Infer lost samples, a mirrored spectrum, and oscillator and clock errors of a recorder from its signals.

Everything follows from the code phases of the satellites already found, measured in short stretches against what their
Dopplers predict: delay(t) = delay(0) - k t doppler / carrier.

- Samples that were lost make the delay of all satellites jump alike.
- k is one. If I and Q are swapped or one of them is inverted, the Doppler is seen with the wrong sign, and k is -1.
- The remaining drift that all satellites share is the sampling clock's error less that of the local oscillator: none,
if one oscillator makes both.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy import special

from skyproof.arrays import Integers, Reals
from skyproof.gnss.signals import GPS_L1_CA, SignalPlan
from skyproof.recording.code_phases import (
    AT_START,
    CELLS,
    CodeBlocks,
    FoundSignal,
    Tracks,
    correlate_spectra,
    correlate_tracks,
    find_peak,
    read_blocks,
)
from skyproof.recording.gaps import MissingSamples, find_gaps
from skyproof.recording.jumps import LEAST_SATS, DelayLevels, find_jumps, fit_levels
from skyproof.records import Samples

__all__ = ["DOPPLER_LIMIT_HZ", "OscillatorError", "Survey", "estimate_oscillator_error", "survey_recorder"]
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
_MOST_DRIFT = 1.3e-4  # of all delays, where the rate is wrong by that much
_CLEARLY = 1.2  # power along a drifting line over that without drift
_LINE_SIGMAS = 8.0  # beyond what noise has: the most of some thousand lines


@dataclass(frozen=True, kw_only=True)
class _Moved:
    """A signal as `FoundSignal`."""

    sat: str
    delay_s: float
    doppler_hz: float


@dataclass(frozen=True, kw_only=True)
class Survey:
    """What the code phases show.

    gaps : in order. doppler_ratio : code Doppler over carrier Doppler, 1 or, if the spectrum is mirrored, -1; with one
        sigma. conjugate : whether it is mirrored; None if the recording is too short to tell.
    conjugate_error_probability : that this is wrong, both being equally likely before; 0.5 where it is not known.
    clock_minus_lo_ppm : how much faster the sampling clock is than the local oscillator says, with one sigma.
    """

    gaps: tuple[MissingSamples, ...] = ()
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


def estimate_oscillator_error(dopplers_hz: Sequence[float] | Reals) -> OscillatorError:
    """Estimate the Doppler common to all satellites: the middle of their range.

    Orbits and place are unknown.

    True Dopplers lie within 4.9 kHz of zero, on either side alike. One sigma is that of the middle for as many
    satellites as there are. NaN without a satellite.
    """
    values = np.asarray(dopplers_hz, np.float64)
    if values.size == 0:
        return OscillatorError(doppler_hz=math.nan, sigma_hz=math.inf)
    middle = 0.5 * float(values.min() + values.max())
    sigma_hz = _RANGE_MIDDLE_SIGMA_HZ[min(values.size, len(_RANGE_MIDDLE_SIGMA_HZ)) - 1]
    return OscillatorError(doppler_hz=middle, sigma_hz=sigma_hz)


def survey_recorder(
    samples: Samples,
    carrier_hz: float,
    signals: Sequence[FoundSignal],
    *,
    signal: SignalPlan = GPS_L1_CA,
    false_alarm_probability: float = 1e-4,
    longest_s: float = 0.5,
    _drifts: bool = True,
) -> Survey:
    """Survey the recorder by the code phases of `signals`, from at most the first `longest_s`.

    Parameters
    ----------
    samples, carrier_hz : the recording and where the nominal carrier lies in it.
    signals : found near its beginning; one per satellite is used, the first.
    false_alarm_probability : of one gap or more reported in a recording that has none. At least three satellites are
        needed, so that one signal's own jump is not taken for a gap. Nothing is reported where the samples do not
        change in one code period or more: what noise does to a delay cannot be learnt there.
    """
    unique = list({received.sat: received for received in reversed(signals)}.values())[::-1]
    n_blocks = int(min(longest_s, samples.duration_s) / signal.period_s)
    if len(unique) < LEAST_SATS or n_blocks < 3:
        return Survey()
    blocks = read_blocks(samples, carrier_hz, n_blocks, signal)
    if not blocks.changing:
        return Survey()
    spectra = np.stack([correlate_spectra(blocks, received) for received in unique])
    # the wrong sign of the Doppler smears the peaks of a long recording: take the one that gives more
    lines = [
        (tracks, *_find_line(blocks, tracks))
        for tracks in (correlate_tracks(blocks, unique, spectra, r) for r in (1.0, -1.0))
    ]
    tracks, _, drift = max(lines, key=lambda line: line[1])
    if drift != 0.0 and _drifts:
        met = _move_to_line(blocks, unique, tracks, drift)
        return _survey_drifting(
            samples,
            carrier_hz,
            met,
            drift,
            signal=signal,
            false_alarm_probability=false_alarm_probability,
            longest_s=longest_s,
        )
    breaks, cells = find_jumps(tracks, false_alarm_probability / 2.0)
    levels = fit_levels(blocks, unique, tracks, breaks, cells, false_alarm_probability / 2.0)
    gaps = find_gaps(samples, carrier_hz, blocks, unique, tracks, levels)
    return replace(_read_drifts(unique, tracks, levels, signal), gaps=gaps)


def _find_line(blocks: CodeBlocks, tracks: Tracks) -> tuple[float, float]:
    """Find the straight line of common delays that holds most power: that power, and the drift.

    The drift is 0 unless one that makes more than a cell or so of difference holds clearly more. Without drift any
    delay is tried: a gap changes it equally for either sign of the Doppler.
    """
    total = np.sum(tracks.around, axis=0)
    level = float(np.max(np.sum(total, axis=0)))
    cell_s = blocks.block_s / CELLS
    step = 0.5 * cell_s / float(np.ptp(tracks.middle_s) + 1e-9)
    drifts = step * np.arange(-math.ceil(_MOST_DRIFT / step), math.ceil(_MOST_DRIFT / step) + 1)
    drifts = drifts[np.abs(drifts) > 2.0 * step]
    if drifts.size == 0 or tracks.middle_s.size < 3:
        return level, 0.0
    stretches = np.arange(tracks.middle_s.size)
    power = np.zeros(drifts.size)
    for number, drift in enumerate(drifts):
        power[number] = np.max(np.sum(total[stretches, _list_cells(tracks, drift, cell_s)], axis=1))
    best = int(np.argmax(power))
    noise = float(tracks.around.shape[0] * tracks.middle_s.size)
    if power[best] - noise < _CLEARLY * max(level - noise, 0.0) + _LINE_SIGMAS * math.sqrt(noise / tracks.periods):
        return level, 0.0
    return float(power[best]), float(drifts[best])


def _list_cells(tracks: Tracks, drift: float, cell_s: float) -> Integers:
    """List the cells of a drifting delay in each stretch, for each start: (n_starts, n_stretches)."""
    cells: Integers = (np.round(drift * tracks.middle_s / cell_s).astype(np.int64) + AT_START[:, np.newaxis]) % CELLS
    return cells


def _move_to_line(blocks: CodeBlocks, signals: Sequence[FoundSignal], tracks: Tracks, drift: float) -> list["_Moved"]:
    """Give the signals their delays along the line: a search at a wrong rate smears each by chips."""
    cell_s = blocks.block_s / CELLS
    cells = _list_cells(tracks, drift, cell_s)
    starts = [find_peak(np.sum(mine[np.arange(mine.shape[0]), cells], axis=1)) for mine in tracks.around]
    return [
        _Moved(sat=received.sat, delay_s=received.delay_s + start * cell_s, doppler_hz=received.doppler_hz)
        for received, start in zip(signals, starts, strict=True)
    ]


def _survey_drifting(
    samples: Samples,
    carrier_hz: float,
    signals: Sequence[FoundSignal],
    drift: float,
    *,
    signal: SignalPlan,
    false_alarm_probability: float,
    longest_s: float,
) -> Survey:
    """Survey again at the rate that nearly removes the common drift. Reports by how much that rate is off.

    A carrier's frequency is in cycles a sample: at another rate it is another one in hertz.
    """
    rated = replace(samples, rate_hz=samples.rate_hz / (1.0 - drift))
    moved = [
        _Moved(
            sat=received.sat,
            delay_s=received.delay_s,
            doppler_hz=received.doppler_hz + drift * (carrier_hz + received.doppler_hz),
        )
        for received in signals
    ]
    found = survey_recorder(
        rated,
        carrier_hz,
        moved,
        signal=signal,
        false_alarm_probability=false_alarm_probability,
        longest_s=longest_s,
        _drifts=False,
    )
    return replace(found, clock_minus_lo_ppm=found.clock_minus_lo_ppm + 1e6 * drift)


def _read_drifts(signals: Sequence[FoundSignal], tracks: Tracks, levels: DelayLevels, signal: SignalPlan) -> Survey:
    """Estimate code Doppler over carrier Doppler, and the code's common drift, from each satellite's own drift."""
    used = levels.used
    time_s = tracks.middle_s[used] - tracks.middle_s[used].mean()
    if time_s.size < 3:
        return Survey()
    errors_s = levels.errors_s[:, used]
    drift = levels.drift + errors_s @ time_s / np.sum(time_s**2)
    excess = _compute_excess(errors_s, levels.sigma_s, time_s, drift - levels.drift)
    sigma = levels.sigma_s * excess / math.sqrt(np.sum(time_s**2))
    expected = np.array([received.doppler_hz for received in signals]) / signal.carrier_hz
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


def _compute_excess(errors_s: Reals, sigma_s: Reals, time_s: Reals, drift: Reals) -> float:
    """Compute the scatter of the delays around each satellite's line over what noise explains, at least one."""
    residual_s = errors_s - errors_s.mean(axis=1, keepdims=True) - np.outer(drift, time_s)
    freedom = errors_s.shape[0] * (time_s.size - 2)
    return max(1.0, math.sqrt(float(np.sum((residual_s / sigma_s[:, np.newaxis]) ** 2)) / freedom))
