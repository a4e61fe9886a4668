"""BroadcastMessages that many satellites cannot have sent fail the test; faults of one or two do not."""

from dataclasses import replace

import numpy as np
import pytest
from tests.gnss.later import extrapolate_hours

from skyproof.detectors.messages.detector import BroadcastMessages, BroadcastMessagesSettings
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import UtcStatement
from skyproof.records import Cause, Ephemeris, ReceivedMessages, Records, UtcParameters
from skyproof.testing import MeasuredScene, TrackErrors

RATE = 1e-7
SCENE = MeasuredScene(antennas_enu_m={"rx1": (0.0, 0.0, 0.0)}, epochs=10, errors=TrackErrors(sigma_m=1.0))
NONE = np.empty(0, "M8[ns]")


def clean() -> Records:
    return SCENE.records(np.random.default_rng(0))


def send(records: Records, count: int, **changes) -> tuple[Ephemeris, ...]:
    """Return the data sets of so many satellites that are received, with clocks late or fields changed."""
    sats = {signal.sat for signal in records.observations[0].signals}
    received = [e for e in records.navigation.ephemerides if e.sat in sats]
    return tuple(replace(e, **{name: change(e) for name, change in changes.items()}) for e in received[:count])


def add_messages(records: Records, ephemerides=(), mistimed=(), utc=()) -> Records:
    start = records.start_gpst
    messages = ReceivedMessages(
        gpst=np.full(len(ephemerides), start, "M8[ns]"),
        ephemerides=tuple(ephemerides),
        mistimed_gpst=np.full(len(mistimed), start, "M8[ns]"),
        mistimed_sat=tuple(mistimed),
        utc_gpst=np.full(len(utc), start, "M8[ns]"),
        utc=tuple(utc),
    )
    return replace(records, messages={"rx1": messages})


def examine(*windows: Records):
    detector, state = BroadcastMessages(BroadcastMessagesSettings(false_alarm_probability=RATE)), None
    for window in windows:
        (found,), state = detector.examine(window, state)
    return found


def examine_all(window: Records):
    return BroadcastMessages(BroadcastMessagesSettings(false_alarm_probability=RATE)).examine(window)[0]


def test_a_clean_sky_has_no_odd_satellite() -> None:
    records = clean()
    assert examine(records).statistic == 0.0
    assert examine(add_messages(records, send(records, 9))).statistic == 0.0


def make_late(e: Ephemeris) -> float:
    return e.af0 + 300.0 / SPEED_OF_LIGHT_M_S


@pytest.mark.parametrize(("count", "failed"), [(1, False), (2, False), (6, True)])
def test_other_clocks_under_one_issue_of_data_are_odd(count, failed) -> None:
    records = clean()
    found = examine(add_messages(records, send(records, count, af0=make_late)))
    assert found.statistic == count
    assert (found.failed, found.overrules, found.code) == (failed, failed, "odd" if failed else "expected")
    assert found.says == ("undecided" if failed else "clean")
    assert found.may_also_be == ((Cause.ORBITS, Cause.FAULT) if failed else ())
    assert found.data.get("how") == ("issue_repeated" if failed else None)


def shift_hours(count: float):
    """Return changes of the times of a data set by so many hours."""
    return {name: lambda e, name=name: getattr(e, name) + 3600.0 * count for name in ("toe", "toc")}


@pytest.mark.parametrize(("off_h", "failed"), [(-5.0, True), (5.0, True), (-167.0, True), (0.0, False)])
def test_data_sets_that_do_not_serve_when_they_come_are_odd(off_h, failed) -> None:
    records = clean()
    alone = replace(records, navigation=replace(records.navigation, ephemerides=records.navigation.ephemerides[:1]))
    found = examine(add_messages(alone, send(records, 6, **shift_hours(off_h))))
    assert found.failed == failed
    if failed:
        assert (found.data["how"], round(found.data["amount"] + off_h)) == ("other_time", 0)


@pytest.mark.parametrize(("count", "failed"), [(2, False), (6, True)])
def test_messages_that_go_back_to_earlier_ones_are_odd(count, failed) -> None:
    records = clean()
    alone = replace(records, navigation=replace(records.navigation, ephemerides=()))
    ill = {"health": lambda e: 63}  # such ones are not held against others
    later = add_messages(alone, send(records, 9, **shift_hours(0.5), **ill))
    found = examine(later, add_messages(alone, send(records, count, **ill)))
    assert found.statistic == count
    assert found.failed == failed


def test_uploads_heard_one_after_the_other_are_no_step_back() -> None:
    records = clean()
    (o,) = records.observations
    two = replace(records, observations=(o, replace(o, receiver="rx2")))
    two = replace(two, navigation=replace(records.navigation, ephemerides=()))
    ill = {"health": lambda e: 63}  # such ones are not held against others
    first, second = (
        add_messages(two, sets).messages["rx1"]
        for sets in (send(records, 6, **shift_hours(0.5), **ill), send(records, 6, **ill))
    )
    assert not examine_all(replace(two, messages={"rx1": first, "rx2": second}))[1].failed


def test_a_later_issue_that_contradicts_is_odd() -> None:
    records = clean()
    later = send(records, 6, af0=make_late, toe=lambda e: e.toe + 3600.0, toc=lambda e: e.toc + 3600.0)
    found = examine(add_messages(records, later))
    assert (found.failed, found.data["how"]) == (True, "other_orbit")
    assert found.data["amount"] > 300.0  # metres: the clock, and an orbit of another hour


def test_messages_of_earlier_windows_are_remembered() -> None:
    records = clean()
    unknown = replace(records, navigation=replace(records.navigation, ephemerides=records.navigation.ephemerides[:1]))
    first = add_messages(unknown, send(records, 6))
    second = add_messages(unknown, send(records, 6, af0=make_late))
    assert not examine(first).failed
    assert examine(first, second).failed


def test_another_time_of_week_is_odd() -> None:
    records = clean()
    sats = sorted({signal.sat for signal in records.observations[0].signals})
    assert not examine(add_messages(records, mistimed=sats[:1])).failed
    found = examine(add_messages(records, mistimed=sats[:6]))
    assert (found.failed, found.data["how"], found.data["odd"]) == (True, "mistimed", tuple(sats[:6]))


def test_satellites_below_the_horizon_are_odd() -> None:
    # The same measurements, with the receiver at the other side of the Earth.
    records = clean()
    (sky,) = records.sets
    found = examine(replace(records, sets=(replace(sky, position_ecef_m=-sky.position_ecef_m),)))
    assert (found.failed, found.data["how"]) == (True, "below_horizon")


def use_old_file(records: Records, hours: float = 24.0) -> Records:
    """Return the window with the navigation file of so many hours before."""
    before = tuple(extrapolate_hours(e, -hours) for e in records.navigation.ephemerides)
    return replace(records, navigation=replace(records.navigation, ephemerides=before))


def test_messages_that_go_on_from_yesterdays_file_are_expected() -> None:
    records = clean()
    today, of_day = examine_all(add_messages(use_old_file(records), send(records, 9)))
    assert (today.code, of_day.code, of_day.statistic) == ("expected", "of_day_expected", 0.0)
    assert (of_day.data["satellites"], of_day.p[Cause.CLEAN]) == (9, 1.0)


@pytest.mark.parametrize(("count", "failed"), [(2, False), (6, True)])
def test_clocks_that_leave_yesterdays_file_are_odd(count, failed) -> None:
    records = clean()
    changed = send(records, count, af0=make_late) + send(records, 9)[count:]
    today, of_day = examine_all(add_messages(use_old_file(records, 12.0), changed))
    assert not today.failed
    assert (of_day.failed, of_day.statistic, of_day.says) == (failed, count, "undecided" if failed else "clean")
    assert of_day.data.get("how") == ("clock_of_day" if failed else None)
    assert of_day.may_also_be == ((Cause.ORBITS, Cause.FAULT) if failed else ())
    if failed:
        assert of_day.data["amount"] == pytest.approx(300.0, abs=1.0)


def test_yesterdays_messages_with_todays_times_are_odd() -> None:
    records = clean()
    yesterday = use_old_file(records)
    again = send(yesterday, 9, **{name: lambda e, name=name: 86_400.0 + getattr(e, name) for name in ("toe", "toc")})
    _, of_day = examine_all(add_messages(yesterday, again))
    assert (of_day.failed, of_day.data["how"], of_day.statistic) == (True, "orbit_of_day", 9.0)


def state_utc(records: Records, count: int, leap_seconds: int, system: str = "G") -> list[UtcStatement]:
    """Return what so many satellites say of UTC."""
    names = sorted({signal.sat for signal in records.observations[0].signals})[:count]
    utc = UtcParameters(a0=0.0, a1=0.0, tot=0.0, wnt=2190, leap_seconds=leap_seconds)
    later = {"later_leap_seconds": leap_seconds, "later_from_gpst": records.start_gpst}
    return [UtcStatement(sat=system + name[1:], utc=utc, **later) for name in names]


@pytest.mark.parametrize(("count", "leaps", "failed"), [(9, 18, False), (2, 17, False), (6, 17, True)])
def test_satellites_that_say_other_leap_seconds_are_odd(count, leaps, failed) -> None:
    records = clean()
    found = examine(add_messages(records, utc=state_utc(records, count, leaps)))
    assert (found.failed, found.statistic) == (failed, count if leaps != 18 else 0.0)
    if failed:
        assert (found.data["how"], found.data["amount"]) == ("utc", -1.0)


def test_a_systems_majority_counts_beyond_the_table() -> None:
    # What was said in earlier windows is remembered; another system has its own.
    records = replace(clean(), start_gpst=np.datetime64("2031-05-14T10:00:00", "ns"))
    records = replace(records, navigation=replace(records.navigation, utc=None))
    first = add_messages(records, utc=state_utc(records, 9, 19)[2:] + state_utc(records, 2, 18, "E"))
    second = add_messages(records, utc=state_utc(records, 2, 18))
    assert examine(first).statistic == 0.0
    assert examine(first, second).statistic == 2.0


def test_a_risen_satellite_is_checked_against_its_own_past() -> None:
    # Without a file, when the orbits are those of the log itself.
    records = clean()
    again = tuple(extrapolate_hours(e, 7.0) for e in send(records, 9))
    moved = tuple(replace(e, af0=make_late(e)) for e in again)
    for sets, failed in ((again, False), (moved, True)):
        of_log = replace(records, navigation=replace(records.navigation, ephemerides=(*send(records, 9), *sets)))
        seen = add_messages(of_log, send(records, 9))
        since = replace(of_log, start_gpst=of_log.start_gpst + np.timedelta64(7, "h"))
        detector = BroadcastMessages(BroadcastMessagesSettings(false_alarm_probability=RATE))
        _, of_day = detector.examine(add_messages(since, sets), detector.examine(seen)[1])[0]
        assert (of_day.failed, of_day.data["satellites"]) == (failed, 9)
