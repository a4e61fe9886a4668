"""Can the satellites have sent these messages, and be received where they say that they are?

Whoever makes signals makes messages too, from orbits of some time and place. A satellite is odd in a window if

- an orbit or clock that it sends contradicts those before, of the same receiver or another one, or the navigation file,
  by more than the accuracies that they state (`laws`);
- it sends another orbit under one issue of data;
- it sends a data set whose time has passed, or goes back to one of before: a record that is played again;
- its message says another time of week than the receiver's clock;
- it says of UTC what cannot be (`utc`);
- it stands below the horizon of where the receiver is.

Where no other data set serves together with one that came, one of the day around is carried on to its time, and both
are compared by what an orbit and an atomic clock do within hours (`last_day`): a test of its own.

A satellite, its channel, its message or a data set of the file is so by a fault with a small probability, each
independently: the number of odd satellites is binomial, and the chance of so many is the p-value. One that repeats
an issue of data, or a data set that was put together from two, does not fail the test; a navigation file of another day
does. What fails leaves the cause open: nothing here tells who sent it.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any, Final, NamedTuple

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.base import NotTested, Reporter, leave_open
from skyproof.detectors.messages.last_day import difference_over_hours, is_of_last_day
from skyproof.detectors.messages.laws import (
    chance_of_difference,
    lowest_elevation_rad,
    range_difference_m,
    serve_together,
)
from skyproof.detectors.messages.policy import POLICY
from skyproof.detectors.messages.utc import leap_seconds_expected, seconds_beyond_utc
from skyproof.errors import require_probability
from skyproof.gnss.ephemeris import MAX_AGE_S, Ephemeris, UtcStatement
from skyproof.gnss.sky import compute_azimuth_elevation
from skyproof.gnss.time import seconds_between
from skyproof.navigation.ranges import correct_ranges
from skyproof.records import (
    Cause,
    Datum,
    Finding,
    Hypothesis,
    NavigationData,
    Need,
    Observations,
    ReceivedMessages,
    Records,
    SignalRef,
    list_refs,
)
from skyproof.statistics.distributions import binomial_survival

__all__ = ["BroadcastMessages", "BroadcastMessagesSettings"]

_TESTS: Final = 2  # of what is odd now, and against the day around


@dataclass(frozen=True)
class BroadcastMessagesSettings:
    """Settings of `BroadcastMessages`.

    false_alarm_probability : of each receiver and window.
    fault_probability : of one satellite, its channel or its message, to be odd within a window.
    """

    false_alarm_probability: float = 1e-3
    fault_probability: float = 1e-3

    def __post_init__(self) -> None:
        require_probability("messages", "false_alarm_probability", self.false_alarm_probability)
        require_probability("messages", "fault_probability", self.fault_probability)


_Key = tuple[str, str]


class _Oddity(NamedTuple):
    """How a satellite is odd, a code, and by how much: metres, hours, seconds or degrees."""

    code: str
    amount: float = 0.0


class _Past(NamedTuple):
    """What is remembered.

    sent : data sets. latest : the latest time of those that each receiver had of a satellite and message. utc : what
    each satellite said last of UTC.
    """

    sent: dict[_Key, tuple[Ephemeris, ...]]
    latest: dict[tuple[str, _Key], np.datetime64]
    utc: dict[str, UtcStatement]


class BroadcastMessages:
    """The detector: see the module's text. It remembers four data sets of each satellite and message."""

    name = "messages"
    share = 0.0  # it never speaks of an attack
    needs = (Need.OBSERVATIONS, Need.NAVIGATION)

    def __init__(self, settings: BroadcastMessagesSettings | None = None) -> None:
        self.settings = settings or BroadcastMessagesSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Finding], Any]:
        """Return the findings of one window; never raises for what the data lack."""
        report = Reporter(self, records, Hypothesis.TRUE_MESSAGES)
        lacking = report.name_missing()
        if lacking or records.navigation is None:
            return lacking, state
        past = _Past({}, {}, {}) if state is None else _Past(*(dict(part) for part in state))
        sent, latest, utc = past
        found = []
        for o in records.observations:
            messages = records.messages.get(o.receiver)
            came = () if messages is None else zip(messages.gpst, messages.ephemerides, strict=True)
            filed = _by_key(e for e in records.navigation.ephemerides if isinstance(e, Ephemeris))
            if messages is None and not any(s.receiver == o.receiver for s in records.sets):
                every = list_refs(o.receiver, o.signals)
                found.append(report.pass_over(every, NotTested("no_message")))
                continue
            odd = (
                dict(_find_below_horizon(records, o))
                | _find_mistimed(messages)
                | _compare_with_utc(messages, records.navigation, utc)
            )
            of_day: dict[str, _Oddity | None] = {}
            for gpst, e in came:
                if not isinstance(e, Ephemeris):
                    continue
                key = e.sat, e.message
                before = tuple(dict.fromkeys((*sent.get(key, ()), *filed.get(key, ()))))
                newest = latest.get((o.receiver, key), e.reference_gpst)
                latest[o.receiver, key] = max(newest, e.reference_gpst)
                why = _find_outdated(e, gpst, newest) or self._find_contradiction(e, before)
                odd |= {} if why is None else {e.sat: why}
                of_day |= self._compare_with_day(e, before) if why is None else {}
                sent[key] = (*(other for other in sent.get(key, ()) if other != e), e)[-POLICY.remembered_data_sets :]
            measured = {o.signals[k].sat for k in np.flatnonzero(np.isfinite(o.pseudorange_m).any(axis=0))}
            found.append(self._test_number(report, o, measured | odd.keys(), odd))
            if of_day:
                differ = {sat: why for sat, why in of_day.items() if why is not None}
                found.append(self._test_number(report, o, of_day.keys(), differ, of_day=True))
        return found, past

    def _find_contradiction(self, e: Ephemeris, before: Sequence[Ephemeris]) -> _Oddity | None:
        """Find how a data set contradicts others of its satellite; None if it does not."""
        if any(_same_issue(e, other) and _other_orbit(e, other) for other in before):
            return _Oddity("issue_repeated")
        serving = [other for other in before if other.healthy and serve_together(e, other) and _other_orbit(e, other)]
        chances = [(chance, other) for other in serving if (chance := chance_of_difference(e, other)) is not None]
        if not e.healthy or not chances:
            return None
        chance, other = min(chances, key=itemgetter(0))
        if len(chances) * chance >= self.settings.false_alarm_probability:
            return None
        return _Oddity("other_orbit", range_difference_m(e, other))

    def _compare_with_day(self, e: Ephemeris, before: Sequence[Ephemeris]) -> dict[str, _Oddity | None]:
        """Return how a data set differs from the nearest one of the day around, None if not.

        Empty without any, and where another one serves together with it, which says more.
        """
        of_last_day = [other for other in before if other.healthy and is_of_last_day(e, other)]
        if not e.healthy or not of_last_day or any(other != e and serve_together(e, other) for other in before):
            return {}
        nearest = min(
            of_last_day, key=lambda other: abs(float(seconds_between(e.reference_gpst, other.reference_gpst)))
        )
        difference = difference_over_hours(e, nearest)
        if difference is None:
            return {}
        is_odd = difference.chance < self.settings.false_alarm_probability
        return {e.sat: _Oddity(f"{difference.what}_of_day", difference.amount_m) if is_odd else None}

    def _test_number(
        self, report: Reporter, o: Observations, sats: Collection[str], odd: Mapping[str, _Oddity], of_day: bool = False
    ) -> Finding:
        """Test the number of odd ones among satellites; of_day : by data sets of the day around."""
        alpha = self.settings.false_alarm_probability / _TESTS
        probability = POLICY.day_fault_probability if of_day else self.settings.fault_probability
        p_value = float(binomial_survival(len(odd), max(len(sats), 1), probability))
        failed = p_value < alpha
        names = tuple(sorted(odd))
        data: dict[str, Datum] = {"receiver": o.receiver, "odd": names, "satellites": len(sats)}
        data["statistic"] = float(len(odd))
        if failed:
            data |= {"how": odd[names[0]].code, "amount": odd[names[0]].amount}
        chosen = odd.keys() if failed else sats
        return report.find(
            tuple(SignalRef(o.receiver, signal) for signal in o.signals if signal.sat in chosen),
            f"{'of_day_' if of_day else ''}{'odd' if failed else 'expected'}",
            {Cause.CLEAN: p_value, **leave_open((Cause.ORBITS, Cause.FAULT))},
            alpha=alpha,
            data=data,
        )


def _by_key(ephemerides: Iterable[Ephemeris]) -> dict[_Key, tuple[Ephemeris, ...]]:
    found: dict[_Key, tuple[Ephemeris, ...]] = {}
    for e in ephemerides:
        found[e.sat, e.message] = (*found.get((e.sat, e.message), ()), e)
    return found


def _find_outdated(e: Ephemeris, gpst: np.datetime64, newest: np.datetime64) -> _Oddity | None:
    """Return how a data set, whole at an instant, does not serve then or is older than the newest that came before."""
    off_s = float(seconds_between(gpst, e.reference_gpst))
    if abs(off_s) > MAX_AGE_S[e.sat[0]]:
        return _Oddity("other_time", off_s / 3600.0)
    if seconds_between(newest, e.reference_gpst) > POLICY.time_back_s:
        return _Oddity("goes_back")
    return None


def _same_issue(e: Ephemeris, other: Ephemeris) -> bool:
    return (e.week, e.toe, e.toc, e.iode, e.iodc) == (other.week, other.toe, other.toc, other.iode, other.iodc)


def _other_orbit(e: Ephemeris, other: Ephemeris) -> bool:
    """Tell whether orbit or clock differ by more than the digits of a file."""
    return e != other and not np.allclose(e.orbit_row, other.orbit_row, rtol=1e-9, atol=1e-14)


def _find_mistimed(messages: ReceivedMessages | None) -> dict[str, _Oddity]:
    """Return the satellites whose messages say another time."""
    return {} if messages is None else dict.fromkeys(messages.mistimed_sat, _Oddity("mistimed"))


def _compare_with_utc(
    messages: ReceivedMessages | None, navigation: NavigationData, utc: dict[str, UtcStatement]
) -> dict[str, _Oddity]:
    """Find the satellites whose statement on UTC is impossible; `utc` collects each statement."""
    found: dict[str, _Oddity] = {}
    if messages is None:
        return found
    utc |= {stated.sat: stated for stated in messages.utc}
    for gpst, stated in zip(messages.utc_gpst, messages.utc, strict=True):
        heard = (other for sat, other in utc.items() if sat[0] == stated.sat[0])
        beyond_s = seconds_beyond_utc(stated, gpst, leap_seconds_expected(gpst, navigation.utc, heard))
        found |= {stated.sat: _Oddity("utc", beyond_s)} if beyond_s else {}
    return found


def _find_below_horizon(records: Records, o: Observations) -> Iterator[tuple[str, _Oddity]]:
    """Yield the satellites that are below the horizon of the place that the largest set shows."""
    sets = [s for s in records.sets if s.receiver == o.receiver]
    if not sets or records.navigation is None:
        return
    place_m = max(sets, key=lambda s: len(s.signals)).position_ecef_m
    middle = o.read(o.gpst.size // 2, o.gpst.size // 2 + 1)
    ranges = correct_ranges(
        o.signals, middle.gpst, _fill_ranges(o, middle), records.navigation, with_unknown_delay=True
    )
    _, elevation_rad = compute_azimuth_elevation(place_m, ranges.satellite_ecef_m[0])
    lowest_rad = lowest_elevation_rad(place_m)
    for k in np.flatnonzero(np.isfinite(elevation_rad) & (elevation_rad < lowest_rad)):
        yield o.signals[k].sat, _Oddity("below_horizon", float(np.degrees(-elevation_rad[k])))


def _fill_ranges(o: Observations, middle: Observations) -> Reals:
    """Return the ranges of an epoch; a signal that it lacks has its range at another epoch."""
    measured = np.isfinite(o.pseudorange_m)
    some = o.pseudorange_m[measured.argmax(axis=0), np.arange(len(o.signals))]
    return np.where(np.isfinite(middle.pseudorange_m), middle.pseudorange_m, some[None])
