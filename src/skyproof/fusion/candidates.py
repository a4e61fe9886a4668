"""The skies that one receiver shows, window by window, and what each of them shows as a fix."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from skyproof.arrays import Reals
from skyproof.fusion.policy import POLICY
from skyproof.fusion.trusted import apply_mask, fix_of, mask_signals
from skyproof.gnss.constants import MILLISECOND_M, SPEED_OF_LIGHT_M_S
from skyproof.gnss.time import seconds_between, timedelta_from_s
from skyproof.navigation.nav_estimate import KNOWN, NavEstimate, estimates_from_fix
from skyproof.navigation.predictor import SkyFix
from skyproof.records import (
    ConsistentSet,
    Kind,
    NavigationData,
    ObservationLog,
    Observations,
    OverlappingSkies,
    Records,
    SignalId,
)

__all__ = ["FixMaker", "SkyCandidates", "align_clock", "find_reference_kind", "select_candidates"]


@dataclass(frozen=True, eq=False, kw_only=True)
class SkyCandidates:
    """One receiver's sets in a window that are no late copies of another one.

    attacked : there is evidence of an attack. doubted : or a second set, or a failed test. overlapping : skies in
    signals within a chip, in order.
    """

    start: np.datetime64
    end: np.datetime64
    sets: tuple[ConsistentSet, ...]
    attacked: bool
    doubted: bool
    overlapping: tuple[OverlappingSkies, ...] = ()


def select_candidates(records: Records, receiver: str) -> SkyCandidates:
    """Return the skies of one receiver in a window, by what was found in it: its sets but for late copies."""
    about = [
        (e, signals)
        for e in records.findings
        if (signals := {ref.signal for ref in e.signals if ref.receiver == receiver})
    ]
    late = set[SignalId]().union(*(signals for e, signals in about if e.says == "multipath"))
    sets = tuple(
        s
        for s in records.sets
        if s.receiver == receiver and len(late.intersection(s.signals)) < POLICY.late_share * len(s.signals)
    )
    overlapping = [skies for e, _ in about for skies in e.overlapping]
    return SkyCandidates(
        start=records.start_gpst,
        end=records.end_gpst,
        sets=sets,
        attacked=any(e.says == "attack" for e, _ in about),
        doubted=len(sets) > 1 or any(e.says in ("attack", "spoofed") or e.failed for e, _ in about),
        overlapping=tuple(sorted(overlapping, key=lambda skies: skies.sets[0].gpst)),
    )


def find_reference_kind(s: ConsistentSet) -> Kind:
    """Return the kind of signal behind the set's clock."""
    return next((kind for kind, off_s in s.offsets_s.items() if off_s == 0.0), s.signals[0].kind)


@dataclass(frozen=True, eq=False, kw_only=True)
class FixMaker:
    """Of one receiver. navigation : orbits, without which there are no fixes of epochs."""

    log: ObservationLog
    navigation: NavigationData | None
    multipath_sigma_m: float
    elevation_mask_deg: float

    @classmethod
    def build_for_window(cls, o: Observations, records: Records, settings: Any) -> "FixMaker":
        """Return what makes fixes of a receiver's epochs in one window. settings : of a detector."""
        return cls(
            log=o,
            navigation=records.navigation,
            multipath_sigma_m=settings.multipath_sigma_m,
            elevation_mask_deg=settings.elevation_mask_deg,
        )

    def shown(self, window: SkyCandidates, s: ConsistentSet, *, kind: Kind, bias_s: float, epochs: bool) -> SkyFix:
        """Return what a set shows, at the instant of the receiver's label less the clock bias last taken for true.

        A false sky's own time does not count.

        kind : of the signals whose clock is compared. epochs : with the fixes of the window's epochs, and velocity.
        """
        gpst = s.gpst - timedelta_from_s(bias_s)
        clock_m = SPEED_OF_LIGHT_M_S * s.clock_of_s(kind)
        mean, covariance = np.zeros(KNOWN), np.diag(np.full(KNOWN, np.inf))
        rows = np.array([0, 1, 2, 6])[: 4 if np.isfinite(clock_m) else 3]
        mean[rows] = np.append(s.position_ecef_m, clock_m)[: rows.size]
        covariance[np.ix_(rows, rows)] = s.covariance_m2[: rows.size, : rows.size]
        each = self._compute_each(window, s, kind) if epochs else ()
        middle = [fix for fix in each if abs(float(seconds_between(fix.gpst, gpst))) < POLICY.same_instant_s]
        if middle:
            rates = np.intersect1d(middle[0].there, [3, 4, 5, 7])
            mean[rates] = middle[0].mean[rates]
            covariance[np.ix_(rates, rates)] = middle[0].covariance[np.ix_(rates, rates)]
        return SkyFix(whole=NavEstimate(gpst=gpst, mean=mean, covariance=covariance), each=each)

    def compute_last_fix(self, window: SkyCandidates, s: ConsistentSet, without: Sequence[str]) -> NavEstimate | None:
        """Return the last fix of a window by its first kind of signals, without some satellites; None without one."""
        stop = int(np.searchsorted(self.log.gpst, window.end))
        found = self._compute_fixes(self._select_rest(s, without), max(stop - POLICY.at_end_epochs, 0), stop)
        return found[-1] if found else None

    def compute_fixes(self, window: SkyCandidates, s: ConsistentSet, without: Sequence[str]) -> tuple[NavEstimate, ...]:
        """Return the fixes of a window by its first kind of signals, without some satellites."""
        first, stop = (int(row) for row in np.searchsorted(self.log.gpst, np.array([window.start, window.end])))
        return self._compute_fixes(self._select_rest(s, without), first, stop)

    def _select_rest(self, s: ConsistentSet, without: Sequence[str]) -> list[SignalId]:
        kind = find_reference_kind(s)
        return [signal for signal in s.signals if signal.kind == kind and signal.sat not in without]

    def _compute_each(self, window: SkyCandidates, s: ConsistentSet, kind: Kind) -> tuple[NavEstimate, ...]:
        """Return the fixes of epochs by one kind of signals, or by the set's own kind where it has none of that."""
        kinds = (kind, find_reference_kind(s))
        signals = next((same for k in kinds if (same := [signal for signal in s.signals if signal.kind == k])), [])
        edges = np.array([window.start, window.end])
        first, stop = (int(row) for row in np.searchsorted(self.log.gpst, edges))
        return self._compute_fixes(signals, first, stop)

    def _compute_fixes(self, own: Sequence[SignalId], first: int, stop: int) -> tuple[NavEstimate, ...]:
        """Return the fixes of epochs by some signals."""
        if self.navigation is None:
            return ()
        o = self.log.read(first, stop)
        o = apply_mask(o, mask_signals(o, own))
        fix = fix_of(
            o,
            self.navigation,
            multipath_sigma_m=self.multipath_sigma_m,
            elevation_mask_deg=self.elevation_mask_deg,
        )
        return () if fix is None else tuple(estimates_from_fix(fix))


def align_clock(shown: SkyFix, expected: NavEstimate) -> SkyFix:
    """Shift a fix's clock by whole milliseconds, as receivers do, to within half a one of the expected clock."""
    if 6 not in expected.there:
        return shown
    steps = np.rint((shown.whole.mean[6] - expected.mean[6]) / MILLISECOND_M)
    by_m: Reals = MILLISECOND_M * steps * (np.arange(KNOWN) == 6)
    whole, *each = (replace(fix, mean=fix.mean - by_m) for fix in (shown.whole, *shown.each))
    return SkyFix(whole=whole, each=tuple(each))
