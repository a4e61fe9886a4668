"""Find jumps that the code phases of all satellites make alike, and the delays between them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import fft, special

from skyproof.arrays import Booleans, Integers, Reals
from skyproof.recording.code_phases import (
    CELLS,
    CodeBlocks,
    FoundSignal,
    Tracks,
    compute_ramp,
    group_by_stretch,
    list_bins,
    predict_delay_s,
)

__all__ = ["LEAST_SATS", "DelayLevels", "find_jumps", "find_segments", "fit_levels", "fit_model"]
_ARM_CHIPS = 0.5  # between early and prompt
LEAST_SATS = 3


def find_jumps(tracks: Tracks, probability: float) -> tuple[list[int], list[int]]:
    """Find stretches where the common delay jumps by a chip or more, and the delay (in cells) after each.

    The sum over satellites and periods of noise alone is Gamma. The satellites are where it exceeds its quantile for
    all delays and stretches, and everything near the expected delay.
    """
    total = np.sum(tracks.around, axis=0)
    shape = tracks.around.shape[0] * tracks.periods
    threshold = special.gammainccinv(shape, probability / total.size) / tracks.periods
    best = np.argmax(total, axis=1)
    breaks, cells = [0], [0]
    near = np.arange(-3, 4)
    for j, cell in enumerate(best):
        near_power = total[j, (cells[-1] + near) % CELLS].max()
        if total[j, cell] <= threshold or total[j, cell] <= near_power:
            continue
        mine = tracks.around[:, j]
        moved = mine[:, (cell + near) % CELLS].max(axis=1) > mine[:, (cells[-1] + near) % CELLS].max(axis=1)
        if np.mean(moved) > 0.5:
            breaks.append(j)
            cells.append(int(cell))
    if len(breaks) > 1 and breaks[1] == 0:  # the prediction itself was off
        breaks, cells = [0, *breaks[2:]], cells[1:]
    return breaks, cells


@dataclass(frozen=True, eq=False, kw_only=True)
class DelayLevels:
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


def fit_levels(
    blocks: CodeBlocks,
    signals: Sequence[FoundSignal],
    tracks: Tracks,
    breaks: list[int],
    cells: list[int],
    probability: float,
) -> DelayLevels:
    """Fit a level between jumps and one drift, and look for smaller jumps until there are none."""
    middle_s, n_stretches = tracks.middle_s, tracks.middle_s.size
    used = np.ones(n_stretches, bool)
    centred = (np.array(cells) + CELLS // 2) % CELLS - CELLS // 2
    centre_s = (centred * (blocks.block_s / CELLS))[find_segments(breaks, n_stretches)]
    errors_s, sigma_s = _delay_errors(blocks, signals, tracks, centre_s)
    # Each pass measures nearer to the peaks, where early and late are balanced; smaller jumps show once drift is off.
    for look in (False, True, False):
        common_s, common_sigma_s = average_weighted(errors_s, sigma_s)
        offset_s, drift, _ = _fit(middle_s, centre_s + common_s, common_sigma_s, breaks, used)
        centre_s = offset_s[find_segments(breaks, n_stretches)] + drift * middle_s
        errors_s, sigma_s = _delay_errors(blocks, signals, tracks, centre_s)
        if look:
            breaks, used = _find_smaller_jumps(middle_s, errors_s, sigma_s, breaks, used, probability)
    return fit_model(middle_s, centre_s + errors_s, sigma_s, breaks, used)


def fit_model(middle_s: Reals, delay_s: Reals, sigma_s: Reals, breaks: list[int], used: Booleans) -> DelayLevels:
    """Fit the model of the delays (n_sats, n_stretches) of all satellites to the stretches used."""
    common_s, common_sigma_s = average_weighted(delay_s, sigma_s)
    offset_s, drift, covariance = _fit(middle_s, common_s, common_sigma_s, breaks, used)
    model_s = offset_s[find_segments(breaks, middle_s.size)] + drift * middle_s
    return DelayLevels(
        breaks=breaks,
        offset_s=offset_s,
        drift=drift,
        covariance=covariance,
        errors_s=delay_s - model_s,
        sigma_s=sigma_s,
        used=used,
    )


def find_segments(breaks: Sequence[int], n_stretches: int) -> Integers:
    return np.searchsorted(np.asarray(breaks), np.arange(n_stretches), side="right") - 1


def _delay_errors(
    blocks: CodeBlocks, signals: Sequence[FoundSignal], tracks: Tracks, centre_s: Reals
) -> tuple[Reals, Reals]:
    """Delay beyond prediction and centre of each satellite in each stretch, and one sigma for each satellite.

    Late less early power over their sum, which is taken over all stretches so that a weak one is not divided by noise.
    The powers of a cell with signal-to-noise ratio r are non-central chi-square: variance 1 + 2 r of a period.
    """
    n_stretches, periods = tracks.middle_s.size, tracks.periods
    chip_s = 1.0 / blocks.signal.chip_rate_hz
    bins = fft.fftfreq(CELLS, 1.0 / CELLS)
    arms = np.exp(2j * np.pi * np.outer(bins, [-_ARM_CHIPS, _ARM_CHIPS]) * chip_s / blocks.block_s) / CELLS
    arms = arms.astype(np.complex64)
    slope_per_chip = _compute_slope(blocks)
    errors_s, sigma_s = np.empty((len(signals), n_stretches)), np.empty(len(signals))
    for row, received in enumerate(signals):
        delay_s = group_by_stretch(predict_delay_s(blocks, received, tracks.ratio), periods).mean(axis=1) + centre_s
        replicas = compute_ramp(blocks, delay_s)[:, :, np.newaxis] * arms
        spectra = tracks.spectra[row, : n_stretches * periods].reshape(n_stretches, periods, CELLS)
        early, late = (np.abs(spectra @ replicas) ** 2).sum(axis=1).T / tracks.noise[row]
        ratio = max(float(np.mean(early + late)) / (2.0 * periods) - 1.0, 0.01)  # signal to noise on either arm
        scale = slope_per_chip * 2.0 * periods * ratio / chip_s
        errors_s[row] = (late - early) / scale
        sigma_s[row] = math.sqrt(periods * (2.0 + 4.0 * ratio)) / scale
    return errors_s, sigma_s


def _compute_slope(blocks: CodeBlocks) -> float:
    """Compute the change of (late - early) / (late + early) per chip.

    The code spectrum is smooth in the band kept.
    """
    chips = blocks.block_s * blocks.signal.chip_rate_hz
    bins = list_bins(blocks.block_samples, blocks.rate_hz)
    angle = 2.0 * np.pi * bins / chips
    weight = np.sinc(bins / chips) ** 2
    shape, steepness = np.sum(weight * np.cos(angle * _ARM_CHIPS)), np.sum(weight * angle * np.sin(angle * _ARM_CHIPS))
    return float(2.0 * steepness / shape)


def average_weighted(values: Reals, sigma: Reals) -> tuple[Reals, float]:
    """Average over satellites (axis 0) by their sigmas; its sigma is no less than the scatter shows."""
    weight = 1.0 / sigma**2
    mean = weight @ values / weight.sum()
    stated = 1.0 / math.sqrt(weight.sum())
    if mean.size < 8:
        return mean, stated
    # second differences know neither level nor drift, and their median no jump; variance 6 of white noise
    scatter = 1.4826 * float(np.median(np.abs(np.diff(mean, 2)))) / math.sqrt(6.0)
    return mean, max(stated, scatter)


def _fit(
    time_s: Reals, values: Reals, sigma: float, breaks: Sequence[int], used: Booleans
) -> tuple[Reals, float, Reals]:
    """Fit a level from each break on and one drift by least squares; no drift where too few stretches show it."""
    segment = find_segments(breaks, time_s.size)
    design = np.zeros((time_s.size, len(breaks) + 1))
    design[np.arange(time_s.size), segment] = 1.0
    if np.count_nonzero(used) > len(breaks) + 1:
        design[:, -1] = time_s
    inverse = np.linalg.pinv(design[used])
    solution = inverse @ values[used]
    return solution[:-1], float(solution[-1]), sigma**2 * (inverse @ inverse.T)


def _find_smaller_jumps(
    time_s: Reals, errors_s: Reals, sigma_s: Reals, breaks: list[int], used: Booleans, probability: float
) -> tuple[list[int], Booleans]:
    """Add breaks where the common delay jumps by more than noise does anywhere with `probability`.

    A break at k is a jump within the stretch before it, which belongs to neither side and is used no more. The
    strongest satellite must not be the only one that jumps.
    """
    limit = float(special.ndtri(1.0 - 0.5 * probability / max(time_s.size, 1)))
    without_strongest = np.arange(sigma_s.size) != np.argmin(sigma_s)
    series = [
        average_weighted(errors_s, sigma_s),
        average_weighted(errors_s[without_strongest], sigma_s[without_strongest]),
    ]

    def without(k: int) -> Booleans:
        return np.asarray(used & (np.arange(time_s.size) != k - 1))

    def possible(k: int) -> bool:
        segment = find_segments(sorted([*breaks, k]), time_s.size)
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
