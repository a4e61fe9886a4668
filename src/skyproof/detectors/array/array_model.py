"""Model an antenna array's phases under signals from known directions, and test if they come from there.

The carrier phases at two antennas differ by the baseline times the direction of arrival. Ephemeris, position and
attitude predict this difference. For a true signal, measured minus predicted is noise. After Zhang, Ding, Xia, Liu and
Yao, "INS-Aided Multi-Antenna GNSS Carrier Phase Double Difference Spoofing Detection" ("the paper"; its double
difference is predicted minus measured). The paper tests three antennas and one satellite with white noise only
(equations 37 to 44). This module takes any number of antennas, in any geometry, and of epochs. Phases are known modulo
one cycle. All satellites share the errors of antenna positions, line biases and attitude.

Corrected: 0.01 is the standard deviation of a phase, not a variance, and equation 37 lacks the mean. An error of 3 mm
in each antenna's position exceeds the noise: the paper's test then alarms in 27 % of trials instead of 1 %. Whole
cycles cannot be neglected: from baselines of 0.58 wavelengths on they make further blind directions.
`docs/methods/ins-array.md` has the rest.

Phases and lengths are in cycles (wavelengths of the carrier that the elements are counted in), angles in radians.
Directions are unit vectors in the frame of the elements. M antennas make d = M - 1 differences against the first one;
no statistic depends on which antenna is first.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Booleans, Indices, Reals
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.orbits import compute_satellite_state_s
from skyproof.gnss.sky import compute_unit_vectors, rotate_to_reception
from skyproof.gnss.time import week_and_tow
from skyproof.navigation.nav_state import interpolate_state, mark_covered
from skyproof.records import ArrayPhases, NavigationData, NavState
from skyproof.statistics.directions import mahalanobis_squared, subtract_nearest_whole
from skyproof.statistics.distributions import chi_square_survival

__all__ = [
    "MeanDifferences",
    "array_design",
    "conditional_statistics",
    "diagonal_blocks",
    "differences",
    "joint_statistic",
    "mean_differences",
    "predict_directions",
    "residual_covariance",
    "sky_p_value",
    "white_covariance",
]


def differences(values: ArrayLike, axis: int = -1) -> Reals:
    """Subtract the first antenna from every other along `axis`, which gets one shorter."""
    moved = np.moveaxis(np.asarray(values, np.float64), axis, -1)
    return np.moveaxis(moved[..., 1:] - moved[..., :1], -1, axis)


def array_design(elements_cyc: ArrayLike) -> Reals:
    """Compute (..., d, 3) phase differences in cycles for unit directions, from elements (..., M, 3)."""
    return differences(elements_cyc, axis=-2)


def white_covariance(sigma_cyc: ArrayLike) -> Reals:
    """Compute the covariance (..., d, d) of differences of M phases with independent sigmas (..., M)."""
    variance = np.asarray(sigma_cyc, np.float64) ** 2
    d = variance.shape[-1] - 1
    return np.asarray(variance[..., 1:, None] * np.eye(d) + variance[..., :1, None])


def residual_covariance(
    elements_cyc: ArrayLike,
    direction: ArrayLike,
    *,
    sigma_cyc: ArrayLike = 0.01,
    position_sigma_cyc: ArrayLike = 0.0,
    attitude_covariance_rad2: ArrayLike = 0.0,
    bias_sigma_cyc: float = 0.0,
    scale_sigma: float = 0.0,
    frequency_ratio: ArrayLike = 1.0,
) -> Reals:
    """Compute the covariance V (..., n d, n d) of measured minus predicted differences, signals outermost.

    White noise is independent between signals. Errors of position, scale, bias and attitude are one draw for all
    signals. If the n rows are signals at several epochs, the draw is the same at all epochs. The attitude error enters
    to first order. A mean over epochs has the covariance of mean directions (then shorter than 1), and the variance of
    white noise divided by the number of epochs.

    Parameters
    ----------
    elements_cyc : (M, 3). direction : (..., n, 3) predicted.
    sigma_cyc : of one antenna's phase; anything that broadcasts to (..., n, M).
    position_sigma_cyc : of each antenna along each axis, one number or (M,).
    attitude_covariance_rad2 : (3, 3) of the small rotation in the elements' frame, or one variance for each axis.
    bias_sigma_cyc : of each antenna's line, the same for all signals.
    scale_sigma : of the length of all baselines together, as a share of it.
    frequency_ratio : (n,) carrier of each signal over the one whose wavelengths the elements are counted in.
    """
    elements_cyc = np.asarray(elements_cyc, np.float64)
    direction = np.asarray(direction, np.float64)
    antennas, n = elements_cyc.shape[0], direction.shape[-2]
    ratio = np.broadcast_to(np.asarray(frequency_ratio, np.float64), (n,))
    scaled = direction * ratio[:, None]
    sigma_cyc = np.broadcast_to(np.asarray(sigma_cyc, np.float64), (*direction.shape[:-1], antennas))
    position = white_covariance(np.broadcast_to(np.asarray(position_sigma_cyc, np.float64), (antennas,)))
    bias = white_covariance(np.full(antennas, bias_sigma_cyc))
    tilt = np.asarray(attitude_covariance_rad2, np.float64)
    tilt = tilt if tilt.ndim else tilt * np.eye(3)
    # D A [u x]: how the differences of each signal follow a small rotation.
    design = array_design(elements_cyc)
    lever = np.cross(design, scaled[..., None, :])
    longer = scale_sigma * scaled @ design.T
    gram = scaled @ np.swapaxes(scaled, -1, -2)
    common = (
        np.einsum("...ij,ab->...iajb", gram, position)
        + bias[:, None, :]
        + np.einsum("...iax,xy,...jby->...iajb", lever, tilt, lever)
        + np.einsum("...ia,...jb->...iajb", longer, longer)
    )
    white = white_covariance(sigma_cyc)
    i = np.arange(n)
    common[..., i, :, i, :] += np.moveaxis(white, -3, 0)
    size = n * (antennas - 1)
    return np.asarray(common.reshape(*common.shape[:-4], size, size))


def joint_statistic(residual_cyc: ArrayLike, covariance: ArrayLike, *, wrapped: bool = False) -> Reals:
    """Compute T (...) of n signals, or of n signals and epochs: chi-square with n d degrees if all are true.

    Parameters
    ----------
    residual_cyc : (..., n, d). covariance : (..., n d, n d) of `residual_covariance`.
    wrapped : choose whole cycles signal by signal first.
    """
    residual_cyc = np.asarray(residual_cyc, np.float64)
    if wrapped:
        residual_cyc = subtract_nearest_whole(residual_cyc, diagonal_blocks(covariance, *residual_cyc.shape[-2:]))[0]
    return mahalanobis_squared(residual_cyc.reshape(*residual_cyc.shape[:-2], -1), covariance)


def conditional_statistics(residual_cyc: ArrayLike, covariance: ArrayLike, *, wrapped: bool = False) -> Reals:
    """Compute T (..., n) of each signal given the others: chi-square with d degrees each.

    The others show the errors that all signals share. The statistic is valid for a signal if the others are true.

    Parameters as in `joint_statistic`.
    """
    residual_cyc = np.asarray(residual_cyc, np.float64)
    n, d = residual_cyc.shape[-2:]
    if wrapped:
        residual_cyc = subtract_nearest_whole(residual_cyc, diagonal_blocks(covariance, n, d))[0]
    information = np.linalg.inv(np.asarray(covariance, np.float64))
    weighted = np.einsum("...ij,...j->...i", information, residual_cyc.reshape(*residual_cyc.shape[:-2], n * d))
    return mahalanobis_squared(weighted.reshape(residual_cyc.shape), diagonal_blocks(information, n, d))


def sky_p_value(residual_cyc: ArrayLike, covariance: ArrayLike, *, wrapped: bool = True) -> Reals:
    """Compute the p-value (...) of all n signals being true, by the union bound over two tests.

    It is twice the smaller of the joint p-value and n times the smallest conditional one. It is never too small; the
    overlap of both tests makes it too large.

    Parameters as in `joint_statistic`.
    """
    n, d = np.shape(residual_cyc)[-2:]
    joint = chi_square_survival(joint_statistic(residual_cyc, covariance, wrapped=wrapped), n * d)
    if n == 1:
        return joint
    worst = conditional_statistics(residual_cyc, covariance, wrapped=wrapped).max(axis=-1)
    return np.asarray(np.minimum(1.0, 2.0 * np.minimum(joint, n * chi_square_survival(worst, d))))


class MeanDifferences(NamedTuple):
    """cycles : (n_channels, d). sigma_cyc : (n_channels, n_antennas) of the means of the antennas. share : (n_epochs,
    n_channels) of each epoch in the mean. epochs : (n_channels,) their number."""

    cycles: Reals
    sigma_cyc: Reals
    share: Reals
    epochs: Indices

    def long_enough(self, min_share: float) -> Booleans:
        """Select the signals (n,) with at least this share of the epochs of the longest one.

        A channel that has lost its signal follows noise until that shows, and a window may begin just then.
        """
        return np.asarray(self.epochs >= np.maximum(min_share * self.epochs.max(initial=0), 1.0))


def mean_differences(phases: ArrayPhases, predicted_cyc: ArrayLike = 0.0) -> MeanDifferences:
    """Average measured minus predicted phase differences over the epochs where a signal has all antennas.

    Parameters
    ----------
    predicted_cyc : (n_epochs, n_channels, n_antennas). By default the measured differences are averaged; they then have
        to stay within a small part of a cycle over the window.
    """
    z = differences(phases.phase_cyc - np.asarray(predicted_cyc, np.float64))
    whole = np.all(np.isfinite(z), axis=-1) & np.all(np.isfinite(phases.sigma_cyc), axis=-1)
    z = np.where(whole[..., None], z, 0.0)
    count = whole.sum(axis=0)
    share = whole / np.maximum(count, 1)
    # Wrapped about the middle of the circle's mean, so that values near half a cycle do not cancel.
    turns = np.sum(np.exp(2j * np.pi * z) * whole[..., None], axis=0)
    middle = np.angle(turns) / (2.0 * np.pi)
    about = z - middle
    mean = middle + np.einsum("kn,kna->na", share, about - np.rint(about))
    variance = np.where(whole[..., None], phases.sigma_cyc, 0.0) ** 2
    variance_of_mean = np.einsum("kn,knm->nm", share**2, variance) + phases.lasting_sigma_cyc**2
    return MeanDifferences(mean, np.sqrt(variance_of_mean), share, count)


def predict_directions(phases: ArrayPhases, state: NavState, navigation: NavigationData) -> Reals:
    """Compute unit vectors (n_epochs, n_channels, 3) to the satellites in the body frame.

    They are NaN without a fresh ephemeris, or outside the time of the body's state.

    Errors of position can be neglected: 1 km is 50 microradians.
    """
    direction = np.full((*phases.phase_cyc.shape[:2], 3), np.nan)
    inside = mark_covered(state, phases.gpst)
    if not inside.any():
        return direction
    gpst = phases.gpst[inside]
    body = interpolate_state(state, gpst)
    week, tow_s = week_and_tow(gpst)
    for channel, signal in enumerate(phases.signals):
        orbit = navigation.best(signal.sat, gpst[gpst.size // 2])
        if orbit is None:
            continue
        travel_s = np.full(gpst.shape, 0.075)
        for _ in range(2):
            sent_m = compute_satellite_state_s(orbit, week, tow_s - travel_s).position_ecef_m
            satellite_m = rotate_to_reception(sent_m, travel_s)
            travel_s = np.linalg.norm(satellite_m - body.position_ecef_m, axis=-1) / SPEED_OF_LIGHT_M_S
        to_satellite = compute_unit_vectors(body.position_ecef_m, satellite_m)
        direction[inside, channel] = np.einsum("kij,ki->kj", body.attitude, to_satellite)
    return direction


def diagonal_blocks(matrix: ArrayLike, n: int, d: int) -> Reals:
    """Extract the blocks (..., n, d, d) on the diagonal of a matrix (..., n d, n d)."""
    matrix = np.asarray(matrix, np.float64)
    i = np.arange(n)
    return np.moveaxis(matrix.reshape(*matrix.shape[:-2], n, d, n, d)[..., i, :, i, :], 0, -3)
