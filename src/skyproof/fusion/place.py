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

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from skyproof.arrays import Reals
from skyproof.fusion.policy import POLICY
from skyproof.fusion.rivals import FixMaker, Rivals, reference_kind, rivals_of
from skyproof.gnss.frames import geodetic_from_ecef
from skyproof.gnss.slips import HEIGHT, UNLISTED, position_slips
from skyproof.gnss.time import timedelta_from_s
from skyproof.navigation.foresight import Foresight, SkyFix, Standing
from skyproof.navigation.known import KNOWN, Known, without
from skyproof.navigation.prediction import fit_p_value
from skyproof.records import UNTESTED, Cause, ConsistentSet, Datum, Finding, Hypothesis, WrongStatement, list_refs
from skyproof.statistics.leave_out import largest_p_value_without

__all__ = ["DETECTOR", "displacements"]

DETECTOR: Final = "place"
_ALL_BUT_PLACE: Final = np.arange(3, 8)


def displacements(
    evidence: Sequence[Finding],
    sets: Sequence[ConsistentSet],
    makers: Sequence[FixMaker],
    foresights: Mapping[str, Foresight],
    alpha: float,
) -> list[Finding]:
    """Evidence on the receivers that stand, one piece for each window that shows them elsewhere.

    alpha : probability of a false alarm in a window.
    """
    found: list[Finding] = []
    for maker in makers:
        foresight = foresights.get(maker.log.receiver)
        if isinstance(foresight, Standing) and foresight.stands:
            found += _Watch(maker, foresight, alpha).through(rivals_of(maker.log, evidence, sets))
    return found


@dataclass(frozen=True, eq=False)
class _Shown:
    """What a window's set shows, and what is expected. p_value : of so large a distance."""

    sky: ConsistentSet
    fix: Known
    expected: Known
    p_value: float

    @property
    def off_m(self) -> Reals:
        return self.fix.mean[:3] - self.expected.mean[:3]


class _Watch:
    """Over one receiver, window by window."""

    def __init__(self, maker: FixMaker, foresight: Standing, alpha: float) -> None:
        self.maker, self.foresight, self.alpha = maker, foresight, alpha
        self.seen_there: Known | None = None  # what was shown when that was first so
        self.named = False
        self.fitted = set[str]()

    def through(self, windows: Iterable[Rivals]) -> list[Finding]:
        found: list[Finding] = []
        for window in windows:
            self.fitted.update(signal.sat for sky in window.sets for signal in sky.signals)
            fixes = [(sky, self._fix(window, sky)) for sky in window.sets]
            shown = [one for sky, fix in fixes if (one := self._shown(sky, fix.whole)) is not None]
            if not shown:
                if len(fixes) == 1 and not window.doubted:
                    self.foresight = self.foresight.learned(fixes[0][1])
                continue
            best = max(shown, key=lambda one: one.p_value)
            if best.p_value >= self.alpha:
                if self.seen_there is None and self._fits_all(window, best.sky):
                    self.seen_there = best.fix
                continue
            found.append(self._report(window, best))
            self.named |= found[-1].says == "attack"
        return found

    def _fix(self, window: Rivals, sky: ConsistentSet) -> SkyFix:
        return self.maker.shown(window, sky, kind=reference_kind(sky), bias_s=0.0, epochs=False)

    def _shown(self, sky: ConsistentSet, fix: Known) -> _Shown | None:
        expected = self.foresight.at(fix.gpst)
        place = None if expected is None else without(expected, _ALL_BUT_PLACE)
        if place is None or not place.there.size:
            return None
        if self.foresight.surveyed:
            datum_m2 = POLICY.datum_sigma_m**2 * np.diag(np.arange(KNOWN) < 3)
            place = replace(place, covariance=place.covariance + datum_m2)
        return _Shown(sky, fix, place, fit_p_value(place, fix))

    def _report(self, window: Rivals, shown: _Shown) -> Finding:
        """Return the window's finding: an attack where no benign cause remains."""
        causes = self._causes(shown) if self.foresight.surveyed else ()
        slipped = bool(causes) and causes[0].code != UNLISTED and not self.named
        why, without_two = ("slip", None) if slipped else self._find_benign(window, shown)
        p = {Cause.CLEAN: shown.p_value}
        data: dict[str, Datum] = {
            "statistic": float(np.linalg.norm(shown.off_m)),
            "surveyed": self.foresight.surveyed,
        }
        if why is not None:
            p |= dict.fromkeys((Cause.STATEMENT, Cause.REFLECTIONS), UNTESTED)
        else:
            p |= {} if without_two is None else {Cause.REFLECTIONS: without_two}
            data["assumes"] = self.foresight.assumes
        return Finding(
            detector=DETECTOR,
            start_gpst=window.start,
            end_gpst=window.end,
            signals=list_refs(self.maker.log.receiver, shown.sky.signals),
            hypothesis=Hypothesis.AS_STATED,
            code=why or "elsewhere",
            p=p,
            alpha=self.alpha,
            estimates={} if why is None else {"wrong_statements": causes},
            data=data,
            dated_gpst=self._date(window, shown),
        )

    def _date(self, window: Rivals, shown: _Shown) -> np.datetime64 | None:
        """Return the first of the window's last epochs that are all nearer to what it shows than to where it stands."""
        each = self.maker.shown(window, shown.sky, kind=reference_kind(shown.sky), bias_s=0.0, epochs=True).each
        places_m = np.array([one.mean[:3] for one in each]).reshape(-1, 3)
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

    def _causes(self, shown: _Shown) -> tuple[WrongStatement, ...]:
        """The slips in stating the place that would put it where the signals do, or an amount that none gives."""
        about = f"position of {self.maker.log.receiver}"
        lat, lon, height_m = geodetic_from_ecef(shown.fix.mean[:3])
        height = f"height_m = {float(height_m):.1f}"
        found = []
        for slip in position_slips(shown.expected.mean[:3]):
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

    def _find_benign(self, window: Rivals, shown: _Shown) -> tuple[str | None, float | None]:
        """Return the code of why a benign cause may have done it, None if none may; and the p-value without two."""
        if self.named:
            return None, None
        if self.seen_there is None:
            return "never_there", None
        if fit_p_value(without(self.seen_there, _ALL_BUT_PLACE), shown.fix) >= self.alpha:
            return "as_before", None
        if not self._fits_all(window, shown.sky):
            return "others_misfit", None
        without_two = self._without_two(window, shown)
        return ("by_some", None) if without_two >= self.alpha else (None, without_two)

    def _fits_all(self, window: Rivals, sky: ConsistentSet) -> bool:
        """Whether of the satellites that ever fitted a position, and are measured in a window, one at most is not in
        this set."""
        log = self.maker.log
        o = log.read(*(int(row) for row in np.searchsorted(log.gpst, np.array([window.start, window.end]))))
        measured = np.flatnonzero(np.isfinite(o.pseudorange_m).any(axis=0))
        there = {o.signals[column].sat for column in measured}
        return len(there & self.fitted - {signal.sat for signal in sky.signals}) <= POLICY.misfit_satellites

    def _without_two(self, window: Rivals, shown: _Shown) -> float:
        """Return the largest p-value without any two satellites; 1 where too few are left."""

        def p_values(pairs: Iterable[tuple[str, ...]]) -> Iterator[float]:
            for pair in pairs:
                fix = self.maker.at_end(window, shown.sky, pair)
                yield 1.0 if fix is None else fit_p_value(shown.expected, fix)

        sats = sorted({signal.sat for signal in shown.sky.signals})
        return largest_p_value_without(sats, p_values, least=POLICY.least_satellites, enough=self.alpha)
