"""Compute which attacks the directions of a window would have shown, at its geometry and noise."""

from collections.abc import Callable
from typing import Final

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.array.agreement import ArrayFrame, MeanPhases, compute_covariance
from skyproof.detectors.array.array_model import array_design, diagonal_blocks
from skyproof.detectors.array.policy import POLICY
from skyproof.records import NOTICED, NoticedAttack
from skyproof.statistics.directions import hemisphere, subtract_nearest_whole
from skyproof.statistics.distributions import chi_square_threshold, noncentrality_for_power

__all__ = ["least_noticeable_angle", "least_noticeable_satellites"]

_DIRECTIONS: Final = 6000


def least_noticeable_satellites(
    satellites: int, chance_of: Callable[[int], float], alpha: float
) -> tuple[NoticedAttack, ...]:
    """Return the least number of satellites that one transmitter must imitate to be noticed; empty if all are too few.

    chance_of : of so many, that a true sky shows them in one direction.
    """
    for size in range(2, satellites + 1):
        if chance_of(size) < alpha:
            return (NoticedAttack("one_transmitter", float(size)),)
    return ()


def least_noticeable_angle(
    measured: MeanPhases, frame: ArrayFrame, up: Reals, false_alarm_probability: float
) -> tuple[NoticedAttack, ...]:
    """Return the angle from its satellite from which on a false signal would have been noticed.

    It holds whichever signal is false. It is empty if such a signal may come from a quarter of a turn away unnoticed.

    By the conditional test of each signal given the others, over a grid of directions above the horizon, whole cycles
    unknown. up : (3,) in the axes of the predicted directions.
    """
    n, d = measured.cycles.shape
    if n < 2:
        return ()
    threshold = float(chi_square_threshold(false_alarm_probability / (2.0 * n), d))
    enough = float(noncentrality_for_power(threshold, d, power=NOTICED))
    information = diagonal_blocks(np.linalg.inv(compute_covariance(measured, frame)), n, d)
    design = array_design(measured.elements_cyc) @ frame.turn
    upper = hemisphere(_DIRECTIONS)
    sphere = np.concatenate([upper, -upper])
    above = sphere[sphere @ up >= 0.0]
    widest = 0.0
    for direction, ratio, signal_information in zip(measured.direction, measured.ratio, information, strict=True):
        unseen = (
            subtract_nearest_whole(ratio * (above - direction) @ design.T, np.linalg.inv(signal_information))[1]
            < enough
        )
        cosine = above[unseen] @ direction / np.linalg.norm(direction)
        widest = max(widest, float(np.arccos(np.clip(cosine.min(initial=1.0), -1.0, 1.0))))
    widest += float(np.sqrt(2.0 * np.pi / _DIRECTIONS))  # to the next direction of the grid
    return (NoticedAttack("elsewhere", widest),) if widest < POLICY.most_noticed_rad else ()
