"""Angles along a turning arm: the paper's own tests, thresholds and information, beside those that `spin` runs."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import optimize, special

from skyproof.arrays import Complexes, Reals
from skyproof.detectors.array.arm_phases import SpinFit, arm_columns, fit_columns, polynomial_columns

__all__ = [
    "PredictedTest",
    "arm_angles",
    "authentic_threshold",
    "circular_threshold",
    "compare_with_prediction",
    "detection_power",
    "fit_pairs",
    "full_information",
    "pair_information",
]


def arm_angles(count: int, rate_rad: float, *, start_rad: float = 0.0) -> Reals:
    """Return the angle (N,) of the arm at each sample, for `rate_rad` a sample."""
    return np.asarray(start_rad + rate_rad * np.arange(count))


def pair_information(angle_rad: ArrayLike, *, radius_cyc: float, sigma_cyc: float) -> Reals:
    """Compute H'H over the variance, (2, 2), of the paper's differences (equations 12, 19)."""
    columns = _pair_samples(arm_columns(angle_rad, radius_cyc).T).T
    return np.asarray(columns.T @ columns / (2.0 * sigma_cyc**2))


def fit_pairs(phase_cyc: ArrayLike, angle_rad: ArrayLike, *, radius_cyc: float, sigma_cyc: float) -> SpinFit:
    """Compute the paper's statistic (equations 10 to 17): differences of samples (0, 2), (1, 3), ...

    Parameters
    ----------
    phase_cyc : (..., N) difference of two signals, motion removed. angle_rad : (N,).
    sigma_cyc : of a sample of the series; for a difference of two signals sqrt(2) times that of one.
    """
    columns = _pair_samples(arm_columns(angle_rad, radius_cyc).T).T
    return fit_columns(_pair_samples(np.asarray(phase_cyc, np.float64)), columns, 2.0 * sigma_cyc**2)


def authentic_threshold(false_alarm_probability: ArrayLike, noncentrality: ArrayLike) -> Reals:
    """Compute the paper's threshold (16): a pair apart by `noncentrality` stays below with this chance.

    The paper calls pairs below the threshold spoofed. Its false alarm is an authentic pair that is called so.
    """
    return np.asarray(special.chndtrix(false_alarm_probability, 2, noncentrality), np.float64)


def detection_power(threshold: ArrayLike) -> Reals:
    """Compute the chance that a pair from one direction is below the threshold (corrected equation 18)."""
    return np.asarray(-np.expm1(-0.5 * np.asarray(threshold, np.float64)))


def circular_threshold(false_alarm_probability: float) -> float:
    """Compute what the paper's rule comes to if the noncentrality is estimated from the same data.

    "T below the threshold that belongs to T" is "T below this", whatever the samples, the radius and the rate:
    0.0203 at 0.01, and spoofed pairs are then found with a probability of 0.0101.
    """
    return float(optimize.brentq(lambda t: special.chndtr(t, 2, t) - false_alarm_probability, 1e-12, 100.0, xtol=1e-14))


def full_information(
    angle_rad: ArrayLike, *, radius_cyc: float, sigma_cyc: float, degree: int = 2, time: ArrayLike | None = None
) -> Reals:
    """Compute the information (2, 2) of the whole series less a polynomial; parameters as in `full_fit`."""
    columns = arm_columns(angle_rad, radius_cyc)
    polynomial = polynomial_columns(columns.shape[0], degree, time)
    columns = columns - polynomial @ (polynomial.T @ columns)
    return np.asarray(columns.T @ columns / sigma_cyc**2)


class PredictedTest(NamedTuple):
    """statistic : (...) chi-square with `dof` degrees if all signals come from where predicted. start_rad : (...) the
    arm's angle at its zero, estimated or 0."""

    statistic: Reals
    dof: int
    start_rad: Reals


def compare_with_prediction(
    level: ArrayLike, predicted: ArrayLike, information: ArrayLike, *, start_known: bool = True
) -> PredictedTest:
    """Test whether n signals come from their predicted directions, up to a common part and a rotation.

    Parameters
    ----------
    level : (..., n, 2) of `SpinFit`. predicted : (..., n, 2) level direction cosines, azimuths from the arm at its
        zero, or with `start_known` False from anywhere.
    information : (2, 2) of one signal.
    """
    seen = _centre(np.asarray(level, np.float64))
    meant = _centre(np.asarray(predicted, np.float64))
    information = np.asarray(information, np.float64)
    start = np.zeros(np.broadcast_shapes(seen.shape, meant.shape)[:-1], np.float64)
    if not start_known:
        start = np.angle(np.sum(seen * meant.conj(), axis=-1))  # exact where the information is a multiple of I
        for _ in range(4):
            turned = meant * np.exp(1j * start)[..., None]
            slope = _real(1j * turned)
            weighted = slope @ information
            step = np.sum(weighted * _real(seen - turned), axis=(-1, -2)) / np.sum(weighted * slope, axis=(-1, -2))
            start = start + step
    rest = _real(seen - meant * np.exp(1j * start)[..., None])
    dof = 2 * (seen.shape[-1] - 1) - (not start_known)
    return PredictedTest(np.sum((rest @ information) * rest, axis=(-1, -2)), dof, start)


def _pair_samples(series: Reals) -> Reals:
    """Sample k + 1 less sample k - 1 for k = 1, 2, 5, 6, 9, 10, ..., along the last axis."""
    fours = series[..., : series.shape[-1] // 4 * 4].reshape(*series.shape[:-1], -1, 4)
    return np.asarray((fours[..., 2:] - fours[..., :2]).reshape(*series.shape[:-1], -1))


def _centre(level: Reals) -> Complexes:
    """Return vectors (..., n, 2) less their mean, as complex numbers (..., n): a rotation is a factor."""
    of_plane = level[..., 0] + 1j * level[..., 1]
    return np.asarray(of_plane - of_plane.mean(axis=-1, keepdims=True), np.complex128)


def _real(level: Complexes) -> Reals:
    return np.stack((level.real, level.imag), axis=-1)
