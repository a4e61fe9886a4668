"""What is to be expected of a receiver by what it showed while its sky was taken for true.

A predictor is a state that learns from fixes of a time when the sky is taken for true, carries them on, and later
follows the sky that was chosen. What it learned of a place that stays is not moved by what it follows: who leads a
chosen sky away slowly does not lead the expectation away with it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Protocol, Self

import numpy as np

from skyproof.arrays import Indices, Reals
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.oscillators import Oscillator
from skyproof.navigation.nav_estimate import KNOWN, NavEstimate, without
from skyproof.navigation.prediction import standing_still
from skyproof.statistics.kalman import kalman_update

__all__ = ["Predictor", "SkyFix", "Standing", "surveyed"]

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
        """What a fix of the true sky would show then; None if nothing is known."""

    def until(self, gpst: np.datetime64) -> Self:
        """Carried on to then: what is earlier will not be asked for."""

    def learned(self, shown: SkyFix) -> Self:
        """With what a sky shows that is taken for true."""

    def followed(self, shown: SkyFix) -> Self:
        """With what a sky shows that was chosen as the true one."""


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
        carried = self._carried(self.known, gpst)
        if not carried.there.size:
            return None
        lasting = 0.0 if self.lasting is None else self.lasting
        return NavEstimate(gpst=gpst, mean=carried.mean, covariance=carried.covariance + lasting)

    def until(self, gpst: np.datetime64) -> "Standing":
        return self

    def learned(self, shown: SkyFix) -> "Standing":
        return self._taken(shown.whole, place=self.stands and not self.surveyed)

    def followed(self, shown: SkyFix) -> "Standing":
        return self._taken(shown.whole, place=False)

    def _carried(self, known: NavEstimate, gpst: np.datetime64) -> NavEstimate:
        carried = standing_still(known, gpst, self.oscillator or Oscillator())
        open_ = np.zeros(KNOWN, np.bool_)
        open_[:6], open_[6:] = not self.stands, self.oscillator is None
        return without(carried, np.flatnonzero(open_))

    def _taken(self, fix: NavEstimate, *, place: bool) -> "Standing":
        rows = np.concatenate((_PLACE if place else [], _CLOCK if self.oscillator is not None else [])).astype(np.intp)
        rows = np.intersect1d(rows, fix.there)
        if not rows.size:
            return self
        before = _nothing(fix.gpst) if self.known is None else self._carried(self.known, fix.gpst)
        if not place:
            before = _parted(before)
        seen, new = np.intersect1d(rows, before.there), np.setdiff1d(rows, before.there)
        known = _adopted(_updated(before, fix, seen), fix, new)
        lasting = np.zeros((KNOWN, KNOWN)) if self.lasting is None else self.lasting.copy()
        lasting[np.ix_(new, new)] = fix.covariance[np.ix_(new, new)]
        return replace(self, known=known, lasting=lasting)


def surveyed(predictor: Standing, position_ecef_m: Reals, position_m2: Reals) -> Standing:
    """Of a receiver that stands where it was surveyed, whatever was received when; covariance (3, 3)."""
    place = _nothing(np.datetime64(0, "ns"))
    mean, covariance = place.mean.copy(), place.covariance.copy()
    mean[:3], covariance[:3, :3] = position_ecef_m, position_m2
    known = NavEstimate(gpst=place.gpst, mean=mean, covariance=covariance)
    return replace(predictor, stands=True, surveyed=True, known=known)


def _nothing(gpst: np.datetime64) -> NavEstimate:
    return NavEstimate(gpst=gpst, mean=np.zeros(KNOWN), covariance=np.diag(np.full(KNOWN, np.inf)))


def _parted(known: NavEstimate) -> NavEstimate:
    """Place and clock as if they had nothing to do with each other, so that the one's correction leaves the other."""
    covariance = known.covariance.copy()
    covariance[:6, 6:] = covariance[6:, :6] = 0.0
    return NavEstimate(gpst=known.gpst, mean=known.mean, covariance=covariance)


def _updated(before: NavEstimate, fix: NavEstimate, seen: Indices) -> NavEstimate:
    """A Kalman filter's correction by some of a fix."""
    if not seen.size:
        return before
    there = before.there
    h = (there[None, :] == seen[:, None]).astype(np.float64)
    p, r = before.covariance[np.ix_(there, there)], fix.covariance[np.ix_(seen, seen)]
    update = kalman_update(p, h, r, fix.mean[seen] - before.mean[seen])
    mean, covariance = before.mean.copy(), before.covariance.copy()
    mean[there] += update.change
    covariance[np.ix_(there, there)] = update.covariance
    return NavEstimate(gpst=fix.gpst, mean=mean, covariance=covariance)


def _adopted(known: NavEstimate, fix: NavEstimate, new: Indices) -> NavEstimate:
    """With what was not known before as the fix has it; the clock's rate open."""
    mean, covariance = known.mean.copy(), known.covariance.copy()
    mean[new], covariance[np.ix_(new, new)] = fix.mean[new], fix.covariance[np.ix_(new, new)]
    if _CLOCK[0] in new:
        mean[_DRIFT], covariance[_DRIFT, _DRIFT] = 0.0, _OPEN_DRIFT_M_S**2
    return NavEstimate(gpst=fix.gpst, mean=mean, covariance=covariance)
