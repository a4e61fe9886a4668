"""How many signals of a satellite there are within a chip and a half: birth and death of the filter's components.

Birth: what a row of looks has left once the known signals are fitted is searched for one more, at every delay and
Doppler. Rao's score test (C. R. Rao, Proc. Camb. Phil. Soc. 44, 1948): the score of a signal of amplitude zero, with
what errors of the known signals can do to it projected out. At one place it is chi-square with two degrees of freedom
where there is nothing; the largest of all places exceeds t with the probability that R. J. Adler and J. E. Taylor
(Random Fields and Geometry, 2007, theorem 15.10.1; K. J. Worsley, Adv. Appl. Prob. 26, 1994) give for a chi-square
field, from the lengths of the paths that a signal runs through as its delay and its Doppler change.

Death: a signal whose amplitude the filter cannot tell from nothing, or whose delay it cannot tell from another's, for
several rows on end.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Booleans, Complexes, Integers, Reals
from skyproof.decomposition.fit import Dictionary
from skyproof.receiver.joint import CHIPS, N_FITTED, N_STATE, Joint, Row, fit_row
from skyproof.receiver.joint_search import search

__all__ = ["Candidates", "birth_threshold", "born", "faint", "false_birth_probability", "newcomer", "unresolved"]

LEFT = 0.02
"""Of a candidate's energy that the known signals cannot imitate: below, its score counts for less."""
RESOLVED_SIGMAS = 3.0
"""By so many of its standard deviations two delays have to be apart where a signal is born."""
LOST_SIGMAS = 1.5
"""Nearer than this many, the two are not told apart any more."""
FAINT = 14.0
"""Of amplitude squared over its variance: with nothing there, chi-square with two degrees of freedom exceeds it once in
a thousand rows."""


@dataclass(frozen=True, eq=False)
class Candidates:
    """Where a further signal is looked for: delays in chips and Dopplers in hertz beside the replica's."""

    chips: Reals
    hz: Reals

    @staticmethod
    def of(dictionary: Dictionary, band_cycles: float, row_s: float, *, reach_hz: float = 60.0) -> "Candidates":
        """The whole of the dictionary's window, a fifth of a cycle of the highest frequency apart."""
        return _candidates(float(dictionary.grid[-1]), band_cycles, row_s, reach_hz)


@lru_cache(maxsize=32)
def _candidates(window_chips: float, band_cycles: float, row_s: float, reach_hz: float) -> Candidates:
    n, m = math.ceil(5.0 * band_cycles * window_chips), math.ceil(2.5 * row_s * reach_hz)
    return Candidates(np.linspace(-window_chips, window_chips, 2 * n + 1), np.linspace(-reach_hz, reach_hz, 2 * m + 1))


def newcomer(
    looks: Complexes, times_s: Reals, look_s: float, row: Row, dictionary: Dictionary, candidates: Candidates
) -> tuple[Reals, Reals]:
    """The largest score (...) that a further signal has beside those fitted in `row`, and its state (..., N_STATE).

    looks : (..., n_looks, d), bits wiped off, to which the row was fitted.
    """
    leading, (n, p) = row.mean.shape[:-2], (row.mean.shape[-2], row.covariance.shape[-1])
    sound = np.asarray(np.isfinite(row.covariance).all(axis=(-2, -1)))
    spread = np.where(sound[..., None, None], row.covariance, 0.0).reshape(-1, p, p)
    scores, states = np.empty(len(spread)), np.empty((len(spread), N_STATE))
    search(
        np.ascontiguousarray(looks).reshape(-1, *looks.shape[-2:]),
        times_s,
        look_s,
        row.mean.reshape(-1, n, N_STATE),
        spread,
        dictionary.table,
        candidates.chips,
        candidates.hz,
        LEFT,
        scores,
        states,
    )
    return np.where(sound, scores.reshape(leading), 0.0), states.reshape(*leading, N_STATE)


def false_birth_probability(
    score: float, dictionary: Dictionary, candidates: Candidates, times_s: Reals, look_s: float
) -> float:
    """Chance that the largest score of one row exceeds `score` where there is no further signal.

    The expected Euler characteristic of a chi-square field with two degrees of freedom over the rectangle of delays and
    Dopplers, both measured by the angle that a signal turns by: near the probability where that is small.
    """
    value, _ = dictionary.at(candidates.chips)
    turn = np.exp(2j * np.pi * candidates.hz[:, None] * times_s) * np.sinc(candidates.hz * look_s)[:, None]
    wide, high = _length(value), _length(turn)
    lines = (wide + high) * math.sqrt(score / (2.0 * math.pi))
    area = wide * high * (score - 1.0) / (2.0 * math.pi)
    return min(math.exp(-0.5 * score) * (1.0 + lines + area), 1.0)


def _length(path: NDArray[np.inexact]) -> float:
    """Of the path of unit vectors (n, d), whatever their phase."""
    unit = path / np.linalg.norm(path, axis=-1, keepdims=True)
    along = np.abs(np.sum(unit[1:].conj() * unit[:-1], axis=-1))
    return float(np.sum(np.arccos(np.minimum(along, 1.0))))


def birth_threshold(
    probability: float, dictionary: Dictionary, candidates: Candidates, times_s: Reals, look_s: float
) -> float:
    """The score that is exceeded with `probability` in one row of nothing more."""
    low, high = 4.0, 2000.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        above = false_birth_probability(middle, dictionary, candidates, times_s, look_s) > probability
        low, high = (middle, high) if above else (low, middle)
    return high


def born(
    looks: Complexes, times_s: Reals, look_s: float, row: Row, state: Reals, dictionary: Dictionary, threshold: float
) -> tuple[Row, Booleans]:
    """The row fitted anew with a newcomer (..., N_STATE), and whether that holds it: signals all resolved, and twice
    the likelihood gained still above the threshold.
    """
    start = np.concatenate([row.mean, state[..., None, :]], axis=-2)
    fitted = fit_row(looks, times_s, look_s, start, dictionary, steps=12)
    gain = 2.0 * (row.misfit - fitted.misfit)
    inside = np.all(np.abs(fitted.mean[..., CHIPS]) <= dictionary.grid[-1], axis=-1)
    return fitted, (gain > threshold) & inside & (
        _least_apart(fitted.mean, fitted.covariance, N_FITTED) > RESOLVED_SIGMAS
    )


def _least_apart(mean: Reals, covariance: Reals, size: int) -> Reals:
    """Least distance (...) of two delays in standard deviations of their difference; infinite for one signal."""
    n = mean.shape[-2]
    least = np.full(mean.shape[:-2], np.inf)
    for k in range(n):
        for m in range(k):
            a, b = k * size + CHIPS, m * size + CHIPS
            distance = np.abs(mean[..., k, CHIPS] - mean[..., m, CHIPS])
            with np.errstate(invalid="ignore"):
                variance = covariance[..., a, a] + covariance[..., b, b] - 2.0 * covariance[..., a, b]
                sigmas = distance / np.sqrt(np.maximum(variance, 0.0))
            least = np.minimum(least, np.where(np.isfinite(variance), sigmas, 0.0))
    return least


def unresolved(joint: Joint) -> Booleans:
    """Whether two delays of the filter (...) cannot be told apart."""
    return np.asarray(_least_apart(joint.mean, joint.covariance, N_STATE) < LOST_SIGMAS)


def faint(joint: Joint) -> tuple[Booleans, Integers]:
    """Whether a signal of the filter (...) cannot be told from nothing, and the number of the faintest."""
    n = joint.mean.shape[-2]
    strength = np.empty(joint.mean.shape[:-1])
    for k in range(n):
        part = slice(k * N_STATE, k * N_STATE + 2)
        a = joint.mean[..., k, :2]
        strength[..., k] = np.sum(a * np.linalg.solve(joint.covariance[..., part, part], a[..., None])[..., 0], axis=-1)
    weakest = np.argmin(strength, axis=-1)
    return np.min(strength, axis=-1) < FAINT, weakest
