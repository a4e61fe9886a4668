"""Find where samples were lost, and how many, from the jumps of the code phases."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skyproof.arrays import Floats, Reals
from skyproof.gnss.signals import prn_of
from skyproof.recording.code_phases import CodeBlocks, FoundSignal, Tracks, compute_ramp, predict_delay_s
from skyproof.recording.jumps import DelayLevels, find_segments, fit_model
from skyproof.records import Samples

__all__ = ["MissingSamples", "find_gaps"]
_PLACE_PERIODS = (2, 1)  # to either side of a gap, for its exact place: then few data bits change in between
_ELSEWHERE_CHIPS = (205.5, 507.5, 809.5)


@dataclass(frozen=True, kw_only=True)
class MissingSamples:
    """Samples are missing: `at_sample` is the first one after the gap, each number with one sigma.

    missing_samples : how many, known modulo a code period only: 0 to `period_samples`. (As many less than a period, put
        in twice, look the same.)
    """

    at_sample: int
    at_sigma_samples: float
    missing_samples: float
    missing_sigma_samples: float
    period_samples: float


def find_gaps(
    samples: Samples,
    carrier_hz: float,
    blocks: CodeBlocks,
    signals: Sequence[FoundSignal],
    tracks: Tracks,
    levels: DelayLevels,
) -> tuple[MissingSamples, ...]:
    """Estimate place and size of each jump; the stretch that holds a jump has no part in its size."""
    places = [
        _locate_gap(samples, carrier_hz, blocks, signals, tracks, levels, row) for row in range(1, len(levels.breaks))
    ]
    middle_s = tracks.middle_s
    half_s = 0.5 * tracks.periods * blocks.signal.period_s
    used = np.ones(middle_s.size, bool)
    for at, sigma in places:
        used &= np.abs(middle_s - at / blocks.rate_hz) > half_s + sigma / blocks.rate_hz
    segment = find_segments(levels.breaks, middle_s.size)
    for number in range(len(levels.breaks)):  # a level needs at least one stretch
        if not used[segment == number].any():
            used[segment == number] = True
    model_s = levels.offset_s[segment] + levels.drift * middle_s
    final = fit_model(middle_s, levels.errors_s + model_s, levels.sigma_s, levels.breaks, used)
    period = blocks.rate_hz * blocks.signal.period_s
    gaps = []
    for row, (at, sigma) in enumerate(places, 1):
        pick = np.zeros(final.covariance.shape[0])
        pick[row - 1], pick[row] = 1.0, -1.0  # what is missing makes the next code period come early
        missing = blocks.rate_hz * float(pick[:-1] @ final.offset_s)
        missing_sigma = blocks.rate_hz * math.sqrt(float(pick @ final.covariance @ pick))
        gaps.append(
            MissingSamples(
                at_sample=round(at),
                at_sigma_samples=sigma,
                missing_samples=missing % period,
                missing_sigma_samples=missing_sigma,
                period_samples=period,
            )
        )
    return tuple(gaps)


def _locate_gap(
    samples: Samples,
    carrier_hz: float,
    blocks: CodeBlocks,
    signals: Sequence[FoundSignal],
    tracks: Tracks,
    levels: DelayLevels,
    row: int,
) -> tuple[float, float]:
    """Locate the first sample after jump number `row`.

    Returns mean and spread of its likelihood, with a flat prior.

    First among code periods, by the powers at the delays before and after; then among samples, by the energies of the
    two coherent sums, up to the place and from it on, of every satellite.
    """
    k = levels.breaks[row]
    begin = max(levels.breaks[row - 1], k - 2)
    end = min([*levels.breaks, tracks.middle_s.size][row + 1], k + 2)
    part = slice(begin * tracks.periods, end * tracks.periods)
    extra_s = levels.offset_s[[row - 1, row]] + levels.drift * tracks.middle_s[k]
    gain = np.zeros(part.stop - part.start)
    for number, received in enumerate(signals):
        delay_s = predict_delay_s(blocks, received, tracks.ratio)[part]
        before, after = (
            np.abs(np.mean(tracks.spectra[number, part] * compute_ramp(blocks, delay_s + extra), axis=1)) ** 2
            for extra in extra_s
        )
        gain += (after - before) / tracks.noise[number]
    # a jump at the beginning of period b loses all gains before it
    first_period = part.start + int(np.argmax(-np.concatenate([[0.0], np.cumsum(gain)])))
    at, sigma = float(first_period * blocks.block_samples), 0.0
    for periods in _PLACE_PERIODS:
        start = max(0, round(at) - periods * blocks.block_samples)
        count = min(round(at) + periods * blocks.block_samples, samples.n_samples) - start
        at, sigma = _find_likeliest(
            samples.read(start, count), start, carrier_hz, blocks, signals, tracks.ratio, extra_s
        )
    return at, sigma


def _find_likeliest(
    planes: Floats,
    start: int,
    carrier_hz: float,
    blocks: CodeBlocks,
    signals: Sequence[FoundSignal],
    ratio: float,
    extra_s: Reals,
) -> tuple[float, float]:
    """Estimate where in a stretch, from sample `start` on, the delay changes: mean and spread."""
    count = planes.shape[1]
    wave = (planes[0] + 1j * planes[1]).astype(np.complex128)
    time_s = (start + np.arange(count)) / blocks.rate_hz
    counts = np.arange(1, count)
    score, noise = np.zeros(count - 1), 0.0
    for received in signals:
        chips = blocks.signal.code(prn_of(received.sat))
        turns = np.mod((carrier_hz + received.doppler_hz) / blocks.rate_hz * np.arange(count), 1.0)
        base = wave * np.exp(-2j * np.pi * turns)
        at_chip = (
            time_s * (1.0 + ratio * received.doppler_hz / blocks.signal.carrier_hz) - received.delay_s
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
