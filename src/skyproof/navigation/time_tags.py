"""Test whether a receiver's epochs are labelled with the time at which their ranges were measured.

A range is c times label minus time of transmission, so that a clock error is the same in all ranges, and the satellites
are where they were. A label that does not belong to its ranges, as UTC for GPS time or a rounded one, puts each
satellite where it is at another time. Then all ranges are off in the ratio of their range rates. That is the
coarse-time error of F. van Diggelen, A-GPS (2009), chapter 4: a fifth unknown beside position and clock. A transmitter
does not make it, for the time of a signal and its delay come together.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from skyproof.arrays import Booleans, Indices, Integers, Reals
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.sky import rotate_to_reception
from skyproof.gnss.time import timedelta_from_s
from skyproof.navigation.fix import fix_and_geometry
from skyproof.navigation.least_squares import compute_line_of_sight, invert_normal
from skyproof.navigation.raim import count_unknowns
from skyproof.navigation.ranges import correct_ranges
from skyproof.records import FixStatus, NavigationData, Observations, Selectable, SignalId
from skyproof.statistics.distributions import chi_square_survival

__all__ = ["TagErrors", "estimate_tag_errors"]

_LEAST_DOF: Final = 2  # that stay with five unknowns
_FALSE: Final = 1e-9
"""Chance that noise makes a label wrong: a day at 1 Hz has 1e5 epochs."""
_FITS: Final = 1e-3  # p-value from which what stays is noise as stated
_LOOKED_AT: Final = 1e-3  # chance that noise makes a label doubtful, so that its error is found in several steps
_STEPS: Final = 5
_MOST_S: Final = 100.0  # of an error that these steps find: beyond, orbits are too far from straight
_AGREEING_SIGMA: Final = 6.0


@dataclass(frozen=True, eq=False, kw_only=True)
class TagErrors:
    """By epoch (n_epochs,): label minus time at which its ranges were measured, seconds; 0 where the label is right.

    sigma_s : one sigma of an error that is not 0, else NaN. known : where the ranges tell.
    """

    error_s: Reals
    sigma_s: Reals
    known: Booleans

    @cached_property
    def offset_s(self) -> float:
        """Return the common error of most labels.

        0 where most are right, whole seconds where it may be another scale.
        """
        error_s = float(np.median(self.error_s[self.known])) if self.known.any() else 0.0
        whole_s = float(np.rint(error_s))
        near_s = _AGREEING_SIGMA * float(np.median(self.sigma_s[self.error_s != 0.0])) if error_s else 0.0
        return whole_s if whole_s and abs(error_s - whole_s) < near_s else error_s

    @cached_property
    def stray(self) -> Booleans:
        """Mark the epochs (n_epochs,) whose labels are off otherwise than most."""
        beyond_s = _AGREEING_SIGMA * np.nan_to_num(self.sigma_s) if self.offset_s else 0.0
        return np.asarray(self.known & (np.abs(self.error_s - self.offset_s) > beyond_s))

    @staticmethod
    def join(parts: Iterable["TagErrors"]) -> "TagErrors":
        """Return those of stretches that follow each other as one."""
        columns = zip(*((part.error_s, part.sigma_s, part.known) for part in parts), strict=True)
        error_s, sigma_s, known = (np.concatenate(column) for column in columns)
        return TagErrors(error_s=error_s, sigma_s=sigma_s, known=known)


def estimate_tag_errors(observations: Observations, navigation: NavigationData) -> TagErrors:
    """Estimate the error of each epoch's label, (n_epochs,), where it explains what no position does.

    A label is wrong where the fifth unknown takes away of the misfit what no chance does, and what stays is noise: as
    stated, or as the median epoch has it.
    """
    n = observations.gpst.size
    signals = _select_one_of_each(observations)
    late_s, tried = np.zeros(n), _estimate_linear(observations, navigation, signals)
    misfit, remaining = tried.statistic, tried.statistic.copy()
    rows = np.flatnonzero(tried.known & (chi_square_survival(tried.taken, 1) < _LOOKED_AT))
    step = tried.select(rows)
    for _ in range(_STEPS):
        late_s[rows] += step.error_s
        step = _estimate_linear(_label(observations, rows, late_s[rows]), navigation, signals)
        stays = step.known & (np.abs(late_s[rows]) < _MOST_S)
        late_s[rows[~stays]] = 0.0
        rows, step = rows[stays], step.select(stays)
    remaining[rows] = step.statistic
    dof = np.maximum(tried.dof, 1)
    noise = max(1.0, float(np.median((remaining / dof)[tried.known]))) if tried.known.any() else 1.0
    chance = chi_square_survival(np.maximum(misfit - remaining, 0.0) / noise, 1)
    wrong = (late_s != 0.0) & (chi_square_survival(remaining / noise, dof) >= _FITS) & (chance < _LOOKED_AT)
    wrong &= np.any(wrong & (chance < _FALSE))  # where one label is surely wrong, doubtful ones are no chance either
    return TagErrors(
        error_s=np.where(wrong, late_s, 0.0),
        sigma_s=np.where(wrong, tried.sigma_s * np.sqrt(noise), np.nan),
        known=tried.known,
    )


def _select_one_of_each(observations: Observations) -> tuple[SignalId, ...]:
    """Return of each satellite the signal with most ranges, of equals that of the highest carrier."""
    count = np.isfinite(observations.pseudorange_m).sum(axis=0)
    order = np.lexsort((-observations.carrier_hz, -count))
    chosen: dict[str, SignalId] = {}
    for column in order:
        chosen.setdefault(observations.signals[column].sat, observations.signals[column])
    return tuple(chosen.values())


def _label(observations: Observations, rows: Indices, late_s: Reals) -> Observations:
    """Make some epochs' labels earlier by `late_s`, independently: they need not be in order."""
    part = observations.select(rows)
    return replace(part, gpst=part.gpst - timedelta_from_s(late_s))


@dataclass(frozen=True, eq=False)
class _Linear(Selectable):
    """By epoch (n,): what a linear step gives for the error, and how much it takes away of the statistic.

    statistic : of the misfit with four unknowns. dof : with five.
    """

    error_s: Reals
    sigma_s: Reals
    statistic: Reals
    taken: Reals
    dof: Integers
    known: Booleans


def _estimate_linear(observations: Observations, navigation: NavigationData, signals: tuple[SignalId, ...]) -> _Linear:
    """Return the least-squares estimate of the fifth unknown beside those of a fix."""
    found, geometry = fix_and_geometry(observations, navigation, signals=signals)
    columns = [observations.signals.index(signal) for signal in signals]
    ranges = correct_ranges(signals, observations.gpst, observations.pseudorange_m[:, columns], navigation)
    _, unit, distance_m = compute_line_of_sight(ranges.satellite_ecef_m, found.position_ecef_m)
    moving_m_s = rotate_to_reception(ranges.satellite_velocity_ecef_m_s, distance_m / SPEED_OF_LIGHT_M_S)
    used = np.isfinite(geometry.misfit_m) & np.isfinite(geometry.sigma_m)
    per_sigma = np.where(used, 1.0 / np.where(used, geometry.sigma_m, 1.0), 0.0)
    rate = np.where(used, np.sum(unit * moving_m_s, axis=-1), 0.0) * per_sigma
    misfit = np.where(used, geometry.misfit_m, 0.0) * per_sigma
    design = geometry.design * per_sigma[..., None]
    across = np.swapaxes(design, -1, -2)
    rate = rate - (design @ (invert_normal(across @ design) @ (across @ rate[..., None])))[..., 0]
    power = np.sum(rate**2, axis=-1)
    dof = used.sum(axis=-1) - count_unknowns(design, used) - 1
    known = (found.status == FixStatus.OK) & (dof >= _LEAST_DOF) & (power > 0.0)
    power = np.where(known, power, 1.0)
    slope = np.sum(rate * misfit, axis=-1) / power
    return _Linear(
        error_s=-slope,
        sigma_s=1.0 / np.sqrt(power),
        statistic=np.sum(misfit**2, axis=-1),
        taken=slope**2 * power,
        dof=dof,
        known=known,
    )
