"""Find antennas of an array that fail: dead, late, noisy, or with a phase that jumps.

They are left out, and named.

The step of each phase from one epoch to the next, less its median over the antennas, holds nothing that all share. An
antenna that jumps or is noisy stands out against two that do not. With two antennas it stays open which one fails.
"""

from dataclasses import replace
from typing import Final, Literal

import numpy as np

from skyproof.arrays import Booleans, Indices, Reals
from skyproof.detectors.array.policy import POLICY
from skyproof.records import ArrayPhases

__all__ = ["Failing", "Fault", "find_failing", "leave_out"]

Fault = Literal["silent", "deaf", "noisy", "jumping"]
"""What is wrong with an antenna.

silent : it gives no phases. deaf : it has none of the signals that the others have. noisy : its phase is noisy.
jumping : its phase jumps.
"""
Failing = dict[int, Fault]
"""Number of an antenna, from 0, to what is wrong with it."""

_MEDIAN_OF_SQUARE: Final = 0.455  # of chi-square with one degree


def find_failing(phases: ArrayPhases) -> Failing:
    """Return the antennas that fail within a window, and how."""
    measured = np.isfinite(phases.phase_cyc) & np.isfinite(phases.sigma_cyc)
    count = measured.sum(axis=(0, 1))
    few = count < POLICY.least_phases_share * count.max(initial=0)
    most = measured.sum(axis=-1) > 0.5 * count.size
    with_most = measured[most].sum(axis=0)
    alone = ~few & (with_most < POLICY.least_phases_share * with_most.max(initial=0))
    found: Failing = dict.fromkeys(np.flatnonzero(few).tolist(), "silent")
    found |= dict.fromkeys(np.flatnonzero(alone).tolist(), "deaf")
    good = [k for k in range(count.size) if k not in found]
    if len(good) < 3:
        return found
    jumps, noisy = _find_jumps_and_noise(phases, np.array(good))
    found |= {good[k]: "noisy" for k in np.flatnonzero(noisy).tolist()}
    found |= {good[k]: "jumping" for k in np.flatnonzero(jumps & ~noisy).tolist()}
    return found if len(good) - int((jumps | noisy).sum()) >= 2 else {}


def leave_out(phases: ArrayPhases, lost: Failing) -> ArrayPhases:
    """Return the other antennas' phases."""
    kept = np.array([k for k in range(len(phases.elements_m)) if k not in lost], np.intp)
    return replace(
        phases,
        elements_m=phases.elements_m[kept],
        phase_cyc=phases.phase_cyc[..., kept],
        sigma_cyc=phases.sigma_cyc[..., kept],
    )


def _find_jumps_and_noise(phases: ArrayPhases, good: Indices) -> tuple[Booleans, Booleans]:
    phase, sigma = phases.phase_cyc[..., good], phases.sigma_cyc[..., good]
    complete = np.isfinite(phase).all(axis=-1) & np.isfinite(sigma).all(axis=-1)
    # From each epoch of a signal to the next that it has.
    signal, epoch = np.nonzero(complete.T)
    follows = (np.diff(signal) == 0) & (np.diff(epoch) <= POLICY.jump_epochs)
    order = np.argsort(epoch[1:][follows], kind="stable")
    before, after = np.flatnonzero(follows)[order], np.flatnonzero(follows)[order] + 1
    if not after.size:
        return np.zeros(good.size, np.bool_), np.zeros(good.size, np.bool_)
    steps = phase[epoch[after], signal[after]] - phase[epoch[before], signal[before]]
    noise = np.hypot(sigma[epoch[after], signal[after]], sigma[epoch[before], signal[before]])
    steps = steps - steps[:, :1]
    steps = steps - np.rint(steps)
    steps = steps - np.median(steps, axis=-1, keepdims=True)
    steps = steps - np.rint(steps)
    # Epoch by epoch, what most signals do at once on an antenna.
    epoch = epoch[after]
    begins = np.flatnonzero(np.diff(epoch, prepend=-1))
    common = np.array([_circular_median(part) for part in np.split(steps, begins[1:])])
    usual = np.median(noise, axis=0)
    jumps = np.any(np.abs(common) > np.maximum(POLICY.jump_cyc, POLICY.jump_sigmas * usual), axis=0)
    rms = np.sqrt(np.median(steps**2, axis=0) / _MEDIAN_OF_SQUARE)
    return np.asarray(jumps), np.asarray(rms > np.maximum(POLICY.step_noise_cyc, POLICY.noise_excess * usual))


def _circular_median(steps: Reals) -> Reals:
    """Compute the median (n_antennas,) of steps (n, n_antennas) modulo one cycle."""
    about = np.angle(np.exp(2j * np.pi * steps).sum(axis=0)) / (2.0 * np.pi)
    rest = steps - about
    return np.asarray(about + np.median(rest - np.rint(rest), axis=0))
