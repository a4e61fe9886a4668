"""Does each signal come to an antenna array from where its satellite stands, by the attitude of an inertial system?

Between the antennas of an array the carrier phases differ by the array's baselines times the direction of arrival. The
difference of that between what is predicted (ephemeris, position, attitude) and what is measured is noise for a true
signal. After Zhang, Ding, Xia, Liu and Yao, "INS-Aided Multi-Antenna GNSS Carrier Phase Double Difference Spoofing
Detection" ("the paper"; its double difference is predicted minus measured). The paper tests three antennas and one
satellite with white noise only (equations 37 to 44). Here: any number of antennas in any geometry, phases known modulo
one cycle, errors of antenna positions, line biases and attitude that all satellites share, any number of epochs.

Corrected: 0.01 is the standard deviation of a phase, not a variance, and the mean belongs into equation 37; an
error of 3 mm in each antenna's position is larger than the noise and makes the paper's test alarm in 27 % of trials
instead of 1 %; whole cycles cannot be neglected: from baselines of 0.58 wavelengths on they make further blind
directions. `docs/methods/ins-array.md` has the rest.

Phases and lengths are in cycles (wavelengths of the carrier that the elements are counted in), angles in radians.
Directions are unit vectors in the frame of the elements. M antennas make d = M - 1 differences against the first one;
no statistic depends on which antenna is first.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Indices, Reals
from skyproof.detectors.base import missing, undecided
from skyproof.errors import require_probability
from skyproof.gnss.constants import L1_HZ, SPEED_OF_LIGHT_M_S
from skyproof.gnss.orbits import satellite_state_s
from skyproof.gnss.sky import rotate_to_reception, unit_vectors
from skyproof.gnss.time import week_and_tow
from skyproof.navigation.nav_state import covered, state_at
from skyproof.records import ArrayPhases, Evidence, NavigationData, NavState, Need, Records, SignalId, SignalRef
from skyproof.statistics.directions import nearest_whole, squared_norm
from skyproof.statistics.distributions import chi_square_survival, chi_square_threshold

__all__ = [
    "InsArray",
    "InsArraySettings",
    "MeanDifferences",
    "array_design",
    "between_signals",
    "blind_directions",
    "conditional_statistics",
    "differences",
    "direction_statistic",
    "equilateral_triangle",
    "joint_statistic",
    "mean_differences",
    "predicted_directions",
    "regular_tetrahedron",
    "residual_covariance",
    "single_statistic",
    "sky_p_value",
    "unexplained",
    "white_covariance",
]


def equilateral_triangle(side: float) -> Reals:
    """Elements (3, 3) of the paper's array, the second on the x axis."""
    return side * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, np.sqrt(0.75), 0.0]])


def regular_tetrahedron(side: float) -> Reals:
    """Elements (4, 3): the triangle and a fourth one above. Its power is the same in all directions."""
    return np.vstack([equilateral_triangle(side), side * np.array([[0.5, np.sqrt(1 / 12), np.sqrt(2 / 3)]])])


def differences(values: ArrayLike, axis: int = -1) -> Reals:
    """Every antenna minus the first along `axis`, which gets one shorter."""
    moved = np.moveaxis(np.asarray(values, np.float64), axis, -1)
    return np.moveaxis(moved[..., 1:] - moved[..., :1], -1, axis)


def array_design(elements_cyc: ArrayLike) -> Reals:
    """(..., d, 3) phase differences in cycles for unit directions, from elements (..., M, 3)."""
    return differences(elements_cyc, axis=-2)


def white_covariance(sigma_cyc: ArrayLike) -> Reals:
    """Covariance (..., d, d) of the differences of M phases with independent errors of standard deviation (..., M)."""
    variance = np.asarray(sigma_cyc, np.float64) ** 2
    d = variance.shape[-1] - 1
    return np.asarray(variance[..., 1:, None] * np.eye(d) + variance[..., :1, None])


def unexplained(phase_cyc: ArrayLike, elements_cyc: ArrayLike, direction: ArrayLike) -> Reals:
    """Measured minus predicted phase differences z (..., n, d), any whole cycles in them.

    Parameters
    ----------
    phase_cyc : (..., n, M), growing where an antenna is nearer to the source.
    elements_cyc : (M, 3) or (..., n, M, 3). direction : (..., n, 3) predicted.
    """
    predicted = np.einsum("...ma,...a->...m", np.asarray(elements_cyc, np.float64), np.asarray(direction, np.float64))
    return differences(np.asarray(phase_cyc, np.float64) - predicted)


def residual_covariance(
    elements_cyc: ArrayLike,
    direction: ArrayLike,
    *,
    sigma_cyc: ArrayLike = 0.01,
    position_sigma_cyc: ArrayLike = 0.0,
    attitude_covariance_rad2: ArrayLike = 0.0,
    bias_sigma_cyc: float = 0.0,
    frequency_ratio: ArrayLike = 1.0,
) -> Reals:
    """Covariance V (..., n d, n d) of `unexplained`, signals outermost.

    White noise is every signal's own. Position, bias and attitude errors are one draw for all signals, and for all
    epochs if the n rows are signals at several epochs. The attitude error enters to first order.
    A mean over epochs has the covariance of mean directions (then shorter than 1) and white noise less by the number.

    Parameters
    ----------
    elements_cyc : (M, 3). direction : (..., n, 3) predicted.
    sigma_cyc : of one antenna's phase; anything that broadcasts to (..., n, M).
    position_sigma_cyc : of each antenna along each axis, one number or (M,).
    attitude_covariance_rad2 : (3, 3) of the small rotation in the elements' frame, or one variance for each axis.
    bias_sigma_cyc : of each antenna's line, the same for all signals.
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
    lever = np.cross(array_design(elements_cyc), scaled[..., None, :])
    gram = scaled @ np.swapaxes(scaled, -1, -2)
    common = (
        np.einsum("...ij,ab->...iajb", gram, position)
        + bias[:, None, :]
        + np.einsum("...iax,xy,...jby->...iajb", lever, tilt, lever)
    )
    white = white_covariance(sigma_cyc)
    i = np.arange(n)
    common[..., i, :, i, :] += np.moveaxis(white, -3, 0)
    size = n * (antennas - 1)
    return np.asarray(common.reshape(*common.shape[:-4], size, size))


def single_statistic(residual_cyc: ArrayLike, covariance: ArrayLike, *, wrapped: bool = False) -> Reals:
    """T (...) of one signal: chi-square with d degrees for a true one. The paper's test is that with the covariance of
    white noise alone, not wrapped (equation 37).

    Parameters
    ----------
    residual_cyc : (..., d). covariance : (..., d, d).
    wrapped : choose the whole cycles that leave least; needs errors small against half a cycle.
    """
    return nearest_whole(residual_cyc, covariance)[1] if wrapped else squared_norm(residual_cyc, covariance)


def joint_statistic(residual_cyc: ArrayLike, covariance: ArrayLike, *, wrapped: bool = False) -> Reals:
    """T (...) of n signals, or of n signals and epochs: chi-square with n d degrees if all are true.

    Parameters
    ----------
    residual_cyc : (..., n, d). covariance : (..., n d, n d) of `residual_covariance`.
    wrapped : choose whole cycles signal by signal first.
    """
    residual_cyc = np.asarray(residual_cyc, np.float64)
    if wrapped:
        residual_cyc = nearest_whole(residual_cyc, _own(covariance, *residual_cyc.shape[-2:]))[0]
    return squared_norm(residual_cyc.reshape(*residual_cyc.shape[:-2], -1), covariance)


def conditional_statistics(residual_cyc: ArrayLike, covariance: ArrayLike, *, wrapped: bool = False) -> Reals:
    """T (..., n) of each signal given the others, which show the errors that all share: chi-square with d degrees each.

    Valid for a signal if the others are true. Parameters as in `joint_statistic`.
    """
    residual_cyc = np.asarray(residual_cyc, np.float64)
    n, d = residual_cyc.shape[-2:]
    if wrapped:
        residual_cyc = nearest_whole(residual_cyc, _own(covariance, n, d))[0]
    information = np.linalg.inv(np.asarray(covariance, np.float64))
    weighted = np.einsum("...ij,...j->...i", information, residual_cyc.reshape(*residual_cyc.shape[:-2], n * d))
    return squared_norm(weighted.reshape(residual_cyc.shape), _own(information, n, d))


def sky_p_value(residual_cyc: ArrayLike, covariance: ArrayLike) -> Reals:
    """p-value (...) that all of n signals are true, whole cycles unknown: the smaller of the joint one and n times the
    smallest conditional one, doubled. By the union bound never too small; too large by what both tests have in common.

    Parameters as in `joint_statistic`.
    """
    n, d = np.shape(residual_cyc)[-2:]
    joint = chi_square_survival(joint_statistic(residual_cyc, covariance, wrapped=True), n * d)
    if n == 1:
        return joint
    worst = conditional_statistics(residual_cyc, covariance, wrapped=True).max(axis=-1)
    return np.asarray(np.minimum(1.0, 2.0 * np.minimum(joint, n * chi_square_survival(worst, d))))


def between_signals(residual_cyc: ArrayLike, covariance: ArrayLike) -> tuple[Reals, Reals]:
    """Residuals (..., n - 1, d) of signals against the first one and their full covariance: line biases cancel.

    `joint_statistic` of them has (n - 1) d degrees, whichever signal is first. Parameters as in `joint_statistic`;
    residuals wrapped to within half a cycle before.
    """
    residual_cyc = np.asarray(residual_cyc, np.float64)
    covariance = np.asarray(covariance, np.float64)
    n, d = residual_cyc.shape[-2:]
    contrast = np.kron(np.column_stack([-np.ones(n - 1), np.eye(n - 1)]), np.eye(d))
    return differences(residual_cyc, axis=-2), contrast @ covariance @ contrast.T


def direction_statistic(residual_cyc: ArrayLike, covariance: ArrayLike, design: ArrayLike) -> tuple[Reals, Reals, int]:
    """Only what an error of direction can cause, and the rest as a check of phases and whole cycles.

    Parameters
    ----------
    residual_cyc : (..., k). covariance : (..., k, k).
    design : (k, q): `array_design` for one signal; stacked for several epochs or frequencies, or block by block.

    Returns
    -------
    statistic : (...) chi-square with `dof` degrees. rest : (...) chi-square with k - dof, independent. dof : its rank.
    """
    residual_cyc = np.asarray(residual_cyc, np.float64)
    covariance = np.asarray(covariance, np.float64)
    design = np.asarray(design, np.float64)
    dof = int(np.linalg.matrix_rank(design))
    # An orthonormal basis of the columns makes the information regular also where the design is not.
    basis = np.linalg.svd(design, full_matrices=False)[0][:, :dof]
    weighted = np.linalg.solve(covariance, np.broadcast_to(basis, (*covariance.shape[:-2], *basis.shape)))
    along = np.einsum("...kq,...k->...q", weighted, residual_cyc)
    statistic = squared_norm(along, np.swapaxes(weighted, -1, -2) @ basis)
    return statistic, squared_norm(residual_cyc, covariance) - statistic, dof


def blind_directions(direction: ArrayLike, elements_cyc: ArrayLike, *, tolerance: float = 1e-9) -> Reals:
    """Directions (k, 3), up and `direction` itself among them, that differ from it by whole cycles at every antenna of
    a planar array in the x-y plane: no test of one signal and epoch can tell them apart.

    Raises
    ------
    ValueError : the array is not planar, or is a line.
    """
    design = array_design(elements_cyc)
    if np.any(design[:, 2]) or np.linalg.matrix_rank(design[:, :2]) < 2:
        raise ValueError("blind_directions: elements must span the x-y plane, with z the same for all")
    level = np.asarray(direction, np.float64)[:2]
    # Two independent baselines give all candidates; the others must then be whole, too.
    pair = design[_independent(design[:, :2]), :2]
    reach = np.ceil(2.0 * np.linalg.norm(pair, axis=-1)).astype(int)
    whole = np.stack(np.meshgrid(*(np.arange(-k, k + 1) for k in reach), indexing="ij"), axis=-1).reshape(-1, 2)
    there = level + np.linalg.solve(pair, whole.T).T
    others = (there - level) @ design[:, :2].T
    squared = np.sum(there**2, axis=-1)
    keep = (squared < 1.0) & np.all(np.abs(others - np.rint(others)) < tolerance, axis=-1)
    return np.column_stack([there[keep], np.sqrt(1.0 - squared[keep])])


class MeanDifferences(NamedTuple):
    """cycles : (n_channels, d). sigma_cyc : (n_channels, n_antennas) of the means of the antennas. share : (n_epochs,
    n_channels) of each epoch in the mean. epochs : (n_channels,) their number."""

    cycles: Reals
    sigma_cyc: Reals
    share: Reals
    epochs: Indices


def mean_differences(phases: ArrayPhases, predicted_cyc: ArrayLike = 0.0) -> MeanDifferences:
    """Mean over the epochs of measured minus predicted phase differences, each signal over those that it has whole.

    Parameters
    ----------
    predicted_cyc : (n_epochs, n_channels, n_antennas); without it the mean is of the differences themselves, which have
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


def predicted_directions(phases: ArrayPhases, state: NavState, navigation: NavigationData) -> Reals:
    """Unit vectors (n_epochs, n_channels, 3) to the satellites in the body frame; NaN without a fresh ephemeris or
    outside the time of the body's state.

    Errors of position are of no account: 1 km is 50 microradians.
    """
    direction = np.full((*phases.phase_cyc.shape[:2], 3), np.nan)
    inside = covered(state, phases.gpst)
    if not inside.any():
        return direction
    gpst = phases.gpst[inside]
    here = state_at(state, gpst)
    week, tow_s = week_and_tow(gpst)
    for channel, signal in enumerate(phases.signals):
        orbit = navigation.best(signal.sat, gpst[gpst.size // 2])
        if orbit is None:
            continue
        travel_s = np.full(gpst.shape, 0.075)
        for _ in range(2):
            sent_m = satellite_state_s(orbit, week, tow_s - travel_s).position_ecef_m
            satellite_m = rotate_to_reception(sent_m, travel_s)
            travel_s = np.linalg.norm(satellite_m - here.position_ecef_m, axis=-1) / SPEED_OF_LIGHT_M_S
        to_satellite = unit_vectors(here.position_ecef_m, satellite_m)
        direction[inside, channel] = np.einsum("kij,ki->kj", here.attitude, to_satellite)
    return direction


def _independent(design: Reals) -> list[int]:
    """The longest baseline and the one farthest off its line."""
    first = int(np.argmax(np.sum(design**2, axis=-1)))
    off = np.abs(design[:, 0] * design[first, 1] - design[:, 1] * design[first, 0])
    return [first, int(np.argmax(off))]


def _own(matrix: ArrayLike, n: int, d: int) -> Reals:
    """Blocks on the diagonal, (..., n, d, d)."""
    matrix = np.asarray(matrix, np.float64)
    i = np.arange(n)
    return np.moveaxis(matrix.reshape(*matrix.shape[:-2], n, d, n, d)[..., i, :, i, :], 0, -3)


# The detector ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class InsArraySettings:
    """Settings of `InsArray`.

    false_alarm_probability : of each array and window.
    position_sigma_m : of each antenna's phase centre along each axis, where the array does not state it.
    bias_sigma_cyc : of what calibration leaves of each antenna's line.
    attitude_sigma_deg : about each axis, where the inertial system gives no covariance.
    min_epochs : of a signal that is tested.
    """

    false_alarm_probability: float = 1e-3
    position_sigma_m: float = 0.003
    bias_sigma_cyc: float = 0.005
    attitude_sigma_deg: float = 0.05
    min_epochs: int = 1

    def __post_init__(self) -> None:
        require_probability("ins_array", "false_alarm_probability", self.false_alarm_probability)


class InsArray:
    """The detector: one Evidence per array and window, from `array_phases` (a tuple of `ArrayPhases`) and
    `nav_state` (`NavState`, the body that carries the arrays).

    Where the state's position is only what the signals show (its variance is infinite), only signals of consistent sets
    are tested: if they are true, one of the positions that the attitude's covariance allows for is theirs.

    The joint test of all signals and the conditional tests of each share the false alarms evenly, by the union bound.
    """

    name = "ins_array"
    needs = (Need.ARRAY_PHASES, Need.NAV_STATE, Need.NAVIGATION)

    def __init__(self, settings: InsArraySettings | None = None) -> None:
        self.settings = settings or InsArraySettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Evidence], Any]:
        """Evidence of one window; never raises for what the data lack."""
        lacking = missing(self, records)
        if lacking or records.navigation is None or records.nav_state is None:
            return lacking, state
        body, orbits = records.nav_state, records.navigation
        return [self._array(records, phases, body, orbits) for phases in records.array_phases], state

    def _array(self, records: Records, phases: ArrayPhases, state: NavState, navigation: NavigationData) -> Evidence:
        if not phases.calibrated:
            return undecided(
                self,
                records,
                tuple(SignalRef(phases.receiver, s) for s in phases.signals),
                because=f"by how much the antenna lines of {phases.receiver} delay the carrier is not known",
                would_need="line_bias_cyc of that receiver in the platform file",
            )
        direction = predicted_directions(phases, state, navigation)
        elements_cyc = phases.elements_m * (L1_HZ / SPEED_OF_LIGHT_M_S)
        ratio = phases.carrier_hz / L1_HZ
        mean = mean_differences(phases, np.einsum("kni,mi,n->knm", direction, elements_cyc, ratio))
        testable = [not _is_of_signals(state) or signal in _placed(records) for signal in phases.signals]
        used = np.flatnonzero((mean.epochs >= self.settings.min_epochs) & testable)
        refs = tuple(SignalRef(phases.receiver, phases.signals[k]) for k in used)
        if used.size == 0:
            return undecided(
                self,
                records,
                tuple(SignalRef(phases.receiver, s) for s in phases.signals),
                because=f"no signal on all antennas of {phases.receiver} while its attitude"
                f"{', its position' if _is_of_signals(state) else ''} and an ephemeris are known",
                would_need="phases of all antennas, ephemerides, and attitudes over the same time",
            )
        known_m = phases.elements_sigma_m
        covariance = residual_covariance(
            elements_cyc,
            np.einsum("kn,kni->ni", mean.share, np.nan_to_num(direction))[used],
            sigma_cyc=mean.sigma_cyc[used],
            position_sigma_cyc=(self.settings.position_sigma_m if known_m is None else known_m)
            * L1_HZ
            / SPEED_OF_LIGHT_M_S,
            attitude_covariance_rad2=self._attitude_covariance(state),
            bias_sigma_cyc=self.settings.bias_sigma_cyc,
            frequency_ratio=ratio[used],
        )
        residual = mean.cycles[used]
        p_value = float(sky_p_value(residual, covariance))
        alpha = self.settings.false_alarm_probability
        false = _out_of_place(residual, covariance, alpha) if p_value < alpha else []
        n = used.size
        because = f"{n} signals come to the array {phases.receiver} from where their satellites stand"
        if false:
            because = f"{len(false)} of {n} signals do not come to the array {phases.receiver} from their satellites"
        return Evidence(
            detector=self.name,
            start_gpst=records.start_gpst,
            end_gpst=records.end_gpst,
            subject=tuple(refs[k] for k in false) if false else refs,
            says="spoofed" if false else "clean",
            because=because,
            p_value=p_value,
            false_alarm_probability=alpha,
            statistic=float(joint_statistic(residual, covariance, wrapped=True)),
            threshold=float(chi_square_threshold(0.5 * alpha, residual.size)),
        )

    def _attitude_covariance(self, state: NavState) -> Reals:
        """(3, 3) in the body frame, in the middle of the window: an inertial system's error hardly changes in it."""
        if state.covariance is None:
            return np.asarray(np.radians(self.settings.attitude_sigma_deg) ** 2 * np.eye(3))
        middle = state.gpst.size // 2
        attitude = state.attitude[middle]
        return np.asarray(attitude.T @ state.covariance[middle, 6:, 6:] @ attitude)


def _is_of_signals(state: NavState) -> bool:
    """Whether the position is only what the signals show."""
    return state.covariance is not None and not bool(np.isfinite(state.covariance[0, 0, 0]))


def _placed(records: Records) -> frozenset[SignalId]:
    """The signals that belong to a consistent set."""
    return frozenset(signal for one in records.sets for signal in one.signals)


def _out_of_place(residual: Reals, covariance: Reals, false_alarm_probability: float) -> list[int]:
    """The signals to take out, the least likely first, until the others pass; at least one."""
    n, d = residual.shape
    left = list(range(n))
    out: list[int] = []
    while left:
        rows = np.add.outer(np.array(left) * d, np.arange(d)).ravel()
        rest, own = residual[left], covariance[np.ix_(rows, rows)]
        if out and sky_p_value(rest, own) >= false_alarm_probability:
            break
        out.append(left.pop(int(conditional_statistics(rest, own, wrapped=True).argmax())))
    return sorted(out)
