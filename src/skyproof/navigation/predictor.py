"""Predict a receiver's fixes from those of a time when its sky was taken for true.

A predictor is a state that learns from trusted fixes, carries them on, and later follows the chosen sky. What it
learned of a fixed place is not moved by what it follows: an attacker who slowly drags a chosen sky away does not drag
the prediction with it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Protocol, Self

import numpy as np

from skyproof.arrays import Indices, Reals
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.oscillators import Oscillator
from skyproof.navigation.nav_estimate import KNOWN, NavEstimate, mark_unknown
from skyproof.navigation.prediction import predict_standing
from skyproof.statistics.kalman import kalman_update

__all__ = ["Predictor", "SkyFix", "Standing", "place_surveyed"]

_PLACE, _CLOCK, _DRIFT = np.arange(3), np.array([6]), 7
_OPEN_DRIFT_M_S: Final = 1e-4 * SPEED_OF_LIGHT_M_S  # of a crystal of which nothing is known


@dataclass(frozen=True, eq=False, kw_only=True)
class SkyFix:
    """What one sky shows in one window.

    whole : of the window, at its middle. each : the fixes of its epochs.
    """

    whole: NavEstimate
    each: Sequence[NavEstimate] = ()


class Predictor(Protocol):
    """Of one receiver. by : codes of what it rests on; assumes : of what that takes for given. moves : whether it
    learns from the fixes of epochs, velocity too."""

    @property
    def by(self) -> tuple[str, ...]: ...
    @property
    def assumes(self) -> tuple[str, ...]: ...
    @property
    def moves(self) -> bool: ...
    def at(self, gpst: np.datetime64) -> NavEstimate | None:
        """Predict the fix of the true sky at that time; None if nothing is known."""

    def until(self, gpst: np.datetime64) -> Self:
        """Advance to that time; earlier times are not asked for again."""

    def learned(self, shown: SkyFix) -> Self:
        """Learn from the fix of a sky that is taken for true."""

    def followed(self, shown: SkyFix) -> Self:
        """Follow the fix of a sky that was chosen as the true one."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Standing:
    """Of a receiver that stands, of its oscillator, or both.

    stands : its position stays; False if nothing is known of its motion. oscillator : None if nothing is known of its
    clock. known : what was learned, None before. lasting : (8, 8) the part of the fixes' error that does not average
    out: all of the first one's, as multipath and models leave it for minutes.
    """

    stands: bool
    oscillator: Oscillator | None
    by: tuple[str, ...]
    assumes: tuple[str, ...] = ()
    known: NavEstimate | None = None
    lasting: Reals | None = None
    surveyed: bool = False
    moves: bool = False

    def at(self, gpst: np.datetime64) -> NavEstimate | None:
        if self.known is None:
            return None
        carried = self._carry(self.known, gpst)
        if not carried.there.size:
            return None
        lasting = 0.0 if self.lasting is None else self.lasting
        return NavEstimate(gpst=gpst, mean=carried.mean, covariance=carried.covariance + lasting)

    def until(self, gpst: np.datetime64) -> "Standing":
        return self

    def learned(self, shown: SkyFix) -> "Standing":
        return self._take(shown.whole, place=self.stands and not self.surveyed)

    def followed(self, shown: SkyFix) -> "Standing":
        return self._take(shown.whole, place=False)

    def _carry(self, known: NavEstimate, gpst: np.datetime64) -> NavEstimate:
        carried = predict_standing(known, gpst, self.oscillator or Oscillator())
        open_ = np.zeros(KNOWN, np.bool_)
        open_[:6], open_[6:] = not self.stands, self.oscillator is None
        return mark_unknown(carried, np.flatnonzero(open_))

    def _take(self, fix: NavEstimate, *, place: bool) -> "Standing":
        rows = np.concatenate((_PLACE if place else [], _CLOCK if self.oscillator is not None else [])).astype(np.intp)
        rows = np.intersect1d(rows, fix.there)
        if not rows.size:
            return self
        before = _start_unknown(fix.gpst) if self.known is None else self._carry(self.known, fix.gpst)
        if not place:
            before = _decorrelate(before)
        seen, new = np.intersect1d(rows, before.there), np.setdiff1d(rows, before.there)
        known = _adopt(_update(before, fix, seen), fix, new)
        lasting = np.zeros((KNOWN, KNOWN)) if self.lasting is None else self.lasting.copy()
        lasting[np.ix_(new, new)] = fix.covariance[np.ix_(new, new)]
        return replace(self, known=known, lasting=lasting)


def place_surveyed(predictor: Standing, position_ecef_m: Reals, position_m2: Reals) -> Standing:
    """Place a predictor where the receiver was surveyed, whatever is received; covariance (3, 3)."""
    place = _start_unknown(np.datetime64(0, "ns"))
    mean, covariance = place.mean.copy(), place.covariance.copy()
    mean[:3], covariance[:3, :3] = position_ecef_m, position_m2
    known = NavEstimate(gpst=place.gpst, mean=mean, covariance=covariance)
    return replace(predictor, stands=True, surveyed=True, known=known)


def _start_unknown(gpst: np.datetime64) -> NavEstimate:
    return NavEstimate(gpst=gpst, mean=np.zeros(KNOWN), covariance=np.diag(np.full(KNOWN, np.inf)))


def _decorrelate(known: NavEstimate) -> NavEstimate:
    """Remove the correlation of place and clock, so that correcting one leaves the other."""
    covariance = known.covariance.copy()
    covariance[:6, 6:] = covariance[6:, :6] = 0.0
    return NavEstimate(gpst=known.gpst, mean=known.mean, covariance=covariance)


def _update(before: NavEstimate, fix: NavEstimate, seen: Indices) -> NavEstimate:
    """Correct some components by a fix (Kalman filter)."""
    if not seen.size:
        return before
    known = before.there
    h = (known[None, :] == seen[:, None]).astype(np.float64)
    p, r = before.covariance[np.ix_(known, known)], fix.covariance[np.ix_(seen, seen)]
    update = kalman_update(p, h, r, fix.mean[seen] - before.mean[seen])
    mean, covariance = before.mean.copy(), before.covariance.copy()
    mean[known] += update.change
    covariance[np.ix_(known, known)] = update.covariance
    return NavEstimate(gpst=fix.gpst, mean=mean, covariance=covariance)


def _adopt(known: NavEstimate, fix: NavEstimate, new: Indices) -> NavEstimate:
    """Adopt components that were not known before from the fix; the clock's rate stays open."""
    mean, covariance = known.mean.copy(), known.covariance.copy()
    mean[new], covariance[np.ix_(new, new)] = fix.mean[new], fix.covariance[np.ix_(new, new)]
    if _CLOCK[0] in new:
        mean[_DRIFT], covariance[_DRIFT, _DRIFT] = 0.0, _OPEN_DRIFT_M_S**2
    return NavEstimate(gpst=fix.gpst, mean=mean, covariance=covariance)
