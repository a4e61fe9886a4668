"""Do the signals put a receiver where it stands?

A receiver stands at a surveyed place, or wherever its first window put it; the place that each later window shows is
held against it. The squared distance over both covariances is chi-square with three degrees if the signals are true and
what is stated holds: a fix's covariance has what models of the atmosphere and reflections leave.

A place that is left may be that of false signals, of reflections, or wrongly stated. It is an attack only where

- a window before did show the place where it stands, so that what was stated holds, and another one than this window: a
  place that is wrong by as much as just fits shows so in one window and not in the next;
- there as now no more than one of the satellites did not fit: with errors many times as large as stated those that
  happen to agree show some place, and others another one in the next window;
- without any two of the satellites the rest shows it too: reflections are some satellites'.

Else it stays undecided, with the reason. Where one of several skies shows the right place nothing is said here: which
of them is true is `choice`'s to say.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.base import NotTested, Reporter
from skyproof.detectors.prediction.noticed import compute_least_move_m
from skyproof.detectors.prediction.policy import POLICY
from skyproof.errors import require_probability
from skyproof.fusion.candidates import FixMaker, SkyCandidates, find_reference_kind, select_candidates
from skyproof.gnss.frames import geodetic_from_ecef
from skyproof.gnss.slips import HEIGHT, UNLISTED, list_position_slips
from skyproof.gnss.time import timedelta_from_s
from skyproof.navigation.nav_estimate import KNOWN, NavEstimate, mark_unknown
from skyproof.navigation.prediction import fit_p_value
from skyproof.navigation.predictor import SkyFix, Standing
from skyproof.records import (
    UNTESTED,
    Cause,
    ConsistentSet,
    Datum,
    Finding,
    Hypothesis,
    Need,
    NoticedAttack,
    Records,
    WrongStatement,
    list_refs,
)
from skyproof.statistics.leave_out import largest_p_value_without

__all__ = ["StatedPlace", "StatedPlaceSettings"]

_ALL_BUT_PLACE: Final = np.arange(3, 8)
_NO_PLACE: Final = NotTested("no_place")


@dataclass(frozen=True)
class StatedPlaceSettings:
    """Settings of `StatedPlace`.

    false_alarm_probability : of each receiver and window. multipath_sigma_m : of one pseudorange, one sigma.
    elevation_mask_deg : satellites below are left out of fixes of epochs.
    """

    false_alarm_probability: float = 1e-3
    multipath_sigma_m: float = 1.0
    elevation_mask_deg: float = 5.0

    def __post_init__(self) -> None:
        require_probability("place", "false_alarm_probability", self.false_alarm_probability)


class StatedPlace:
    """The detector: see the module's text. It remembers where each receiver stands, and what showed that first."""

    name = "place"
    needs = (Need.STANDING, Need.SETS, Need.FINDINGS)

    def __init__(self, settings: StatedPlaceSettings | None = None) -> None:
        self.settings = settings or StatedPlaceSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Finding], Any]:
        """Return a finding for each receiver that stands."""
        report = Reporter(self, records, Hypothesis.AS_STATED)
        if lacking := report.name_missing():
            return lacking, state
        watches: dict[str, _Watch] = dict(state or {})
        found = list[Finding]()
        for o in records.observations:
            if o.receiver in records.standing:
                watch = watches.get(o.receiver) or _Watch(records.standing[o.receiver])
                maker = FixMaker.build_for_window(o, records, self.settings)
                finding, watches[o.receiver] = watch.examine(report, maker, select_candidates(records, o.receiver))
                found.append(finding)
        return found, watches


@dataclass(frozen=True, eq=False)
class _Shown:
    """What a window's set shows, and what is expected. p_value : of so large a distance."""

    sky: ConsistentSet
    fix: NavEstimate
    expected: NavEstimate
    p_value: float

    @property
    def off_m(self) -> Reals:
        return self.fix.mean[:3] - self.expected.mean[:3]


@dataclass(frozen=True, eq=False)
class _Watch:
    """Over one receiver, window by window.

    seen_there : what was shown when a window first put it where it stands. named : whether it was attacked.
    fitted : satellites that ever fitted a position.
    """

    predictor: Standing
    seen_there: NavEstimate | None = None
    named: bool = False
    fitted: frozenset[str] = frozenset()

    def examine(self, report: Reporter, maker: FixMaker, window: SkyCandidates) -> tuple[Finding, "_Watch"]:
        """Return what a window shows, and the watch after it."""
        watch = replace(self, fitted=self.fitted.union(s.sat for sky in window.sets for s in sky.signals))
        place = _Here(watch, report, maker, window)
        fixes = [(sky, place.fix(sky)) for sky in window.sets]
        comparisons = [comparison for sky, fix in fixes if (comparison := place.hold(sky, fix.whole)) is not None]
        if not comparisons:
            learns = len(fixes) == 1 and not window.doubted
            nothing = report.pass_over(list_refs(maker.log.receiver, maker.log.signals), _NO_PLACE)
            return nothing, replace(watch, predictor=watch.predictor.learned(fixes[0][1])) if learns else watch
        best = max(comparisons, key=lambda comparison: comparison.p_value)
        if best.p_value >= place.alpha:
            first = watch.seen_there is None and place.fits_all(best.sky)
            return place.report_there(best), replace(watch, seen_there=best.fix) if first else watch
        finding = place.report_departure(best)
        return finding, replace(watch, named=watch.named or finding.says == "attack")


@dataclass(frozen=True, eq=False)
class _Here:
    """One receiver in one window."""

    watch: _Watch
    report: Reporter
    maker: FixMaker
    window: SkyCandidates

    @property
    def alpha(self) -> float:
        return float(self.report.detector.settings.false_alarm_probability)

    def fix(self, sky: ConsistentSet) -> SkyFix:
        return self.maker.shown(self.window, sky, kind=find_reference_kind(sky), bias_s=0.0, epochs=False)

    def hold(self, sky: ConsistentSet, fix: NavEstimate) -> _Shown | None:
        expected = self.watch.predictor.at(fix.gpst)
        place = None if expected is None else mark_unknown(expected, _ALL_BUT_PLACE)
        if place is None or not place.there.size:
            return None
        if self.watch.predictor.surveyed:
            datum_m2 = POLICY.datum_sigma_m**2 * np.diag(np.arange(KNOWN) < 3)
            place = replace(place, covariance=place.covariance + datum_m2)
        return _Shown(sky, fix, place, fit_p_value(place, fix))

    def report_there(self, shown: _Shown) -> Finding:
        """Return that the window shows the place where the receiver stands."""
        return self.report.find(
            list_refs(self.maker.log.receiver, shown.sky.signals),
            "there",
            {Cause.CLEAN: shown.p_value},
            estimates={"noticed": (NoticedAttack("displacement", self._find_noticed_m(shown)),)},
            data={"statistic": float(np.linalg.norm(shown.off_m)), "surveyed": self.watch.predictor.surveyed},
        )

    def _find_noticed_m(self, shown: _Shown) -> float:
        """Return by how much the position has to be moved, level and the worst way, for this window to notice it."""
        both_m2 = shown.expected.covariance[:3, :3] + shown.fix.covariance[:3, :3]
        return compute_least_move_m(both_m2, shown.fix.mean[:3], dof=3, false_alarm_probability=self.alpha)

    def report_departure(self, shown: _Shown) -> Finding:
        """Return the window's finding: an attack where no benign cause remains."""
        causes = self._find_slips(shown) if self.watch.predictor.surveyed else ()
        slipped = bool(causes) and causes[0].code != UNLISTED and not self.watch.named
        why, without_two = ("slip", None) if slipped else self._find_benign(shown)
        p = {Cause.CLEAN: shown.p_value}
        data: dict[str, Datum] = {
            "statistic": float(np.linalg.norm(shown.off_m)),
            "surveyed": self.watch.predictor.surveyed,
        }
        if why is not None:
            p |= dict.fromkeys((Cause.STATEMENT, Cause.REFLECTIONS), UNTESTED)
        else:
            p |= {} if without_two is None else {Cause.REFLECTIONS: without_two}
            data["assumes"] = self.watch.predictor.assumes
        return self.report.find(
            list_refs(self.maker.log.receiver, shown.sky.signals),
            why or "elsewhere",
            p,
            estimates={} if why is None else {"wrong_statements": causes},
            data=data,
            dated_gpst=self._date_departure(shown),
        )

    def _date_departure(self, shown: _Shown) -> np.datetime64 | None:
        """Return the first of the window's last epochs that are all nearer to what it shows than to where it stands."""
        each = self.maker.shown(
            self.window, shown.sky, kind=find_reference_kind(shown.sky), bias_s=0.0, epochs=True
        ).each
        places_m = np.array([fix.mean[:3] for fix in each]).reshape(-1, 3)
        to_shown_m, to_stated_m = (
            np.linalg.norm(places_m - known.mean[:3], axis=1) for known in (shown.fix, shown.expected)
        )
        before = np.flatnonzero(to_shown_m >= to_stated_m)
        first = int(before[-1]) + 1 if before.size else 0
        if first >= len(each):
            return None
        gpst = self.maker.log.gpst
        row = int(np.searchsorted(gpst, each[first].gpst - timedelta_from_s(POLICY.label_off_s)))
        dated: np.datetime64 = gpst[min(row, gpst.size - 1)]
        return dated

    def _find_slips(self, shown: _Shown) -> tuple[WrongStatement, ...]:
        """Return the slips of writing that would put the place where the signals do, or an amount that none gives."""
        about = f"position of {self.maker.log.receiver}"
        lat, lon, height_m = geodetic_from_ecef(shown.fix.mean[:3])
        height = f"height_m = {float(height_m):.1f}"
        found = []
        for slip in list_position_slips(shown.expected.mean[:3]):
            mean, covariance = shown.expected.mean.copy(), shown.expected.covariance.copy()
            mean[:3] = slip.position_ecef_m
            covariance[:3, :3] += slip.covariance_m2
            meant = replace(shown.expected, mean=mean, covariance=covariance)
            if fit_p_value(meant, shown.fix) >= POLICY.slip_p_value:
                value = height if slip.code == HEIGHT else slip.value
                found.append(WrongStatement(code=slip.code, about=about, words=slip.words, value=value))
        if found:
            return tuple(found)
        value = f"lat_deg = {np.degrees(lat):.6f}, lon_deg = {np.degrees(lon):.6f}, {height}"
        return (WrongStatement(code=UNLISTED, about=about, words="by no amount that is usual", value=value),)

    def _find_benign(self, shown: _Shown) -> tuple[str | None, float | None]:
        """Return the code of why a benign cause may have done it, None if none may; and the p-value without two."""
        if self.watch.named:
            return None, None
        if self.watch.seen_there is None:
            return "never_there", None
        if fit_p_value(mark_unknown(self.watch.seen_there, _ALL_BUT_PLACE), shown.fix) >= self.alpha:
            return "as_before", None
        if not self.fits_all(shown.sky):
            return "others_misfit", None
        without_two = self._drop_two_satellites(shown)
        return ("by_some", None) if without_two >= self.alpha else (None, without_two)

    def fits_all(self, sky: ConsistentSet) -> bool:
        """Tell whether a set has all satellites but one of those measured that ever fitted a position."""
        log = self.maker.log
        o = log.read(*(int(row) for row in np.searchsorted(log.gpst, np.array([self.window.start, self.window.end]))))
        measured = np.flatnonzero(np.isfinite(o.pseudorange_m).any(axis=0))
        measured_sats = {o.signals[column].sat for column in measured}
        return (
            len(measured_sats & self.watch.fitted - {signal.sat for signal in sky.signals}) <= POLICY.misfit_satellites
        )

    def _drop_two_satellites(self, shown: _Shown) -> float:
        """Return the largest p-value without any two satellites; 1 where too few are left."""

        def p_values(pairs: Iterable[tuple[str, ...]]) -> Iterator[float]:
            for pair in pairs:
                fix = self.maker.compute_last_fix(self.window, shown.sky, pair)
                yield 1.0 if fix is None else fit_p_value(shown.expected, fix)

        sats = sorted({signal.sat for signal in shown.sky.signals})
        return largest_p_value_without(sats, p_values, least=POLICY.least_satellites, enough=self.alpha)
