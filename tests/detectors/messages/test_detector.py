"""BroadcastMessages that many satellites cannot have sent fail the test; faults of one or two do not."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.detectors.messages.detector import BroadcastMessages, BroadcastMessagesSettings
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.records import Cause, Ephemeris, ReceivedMessages, Records
from skyproof.testing import MeasuredScene, TrackErrors

RATE = 1e-7
SCENE = MeasuredScene(antennas_enu_m={"rx1": (0.0, 0.0, 0.0)}, epochs=10, errors=TrackErrors(sigma_m=1.0))
NONE = np.empty(0, "M8[ns]")


def clean() -> Records:
    return SCENE.records(np.random.default_rng(0))


def sent(records: Records, count: int, **changes) -> tuple[Ephemeris, ...]:
    """Return the data sets of so many satellites that are received, with clocks late or fields changed."""
    sats = {signal.sat for signal in records.observations[0].signals}
    own = [e for e in records.navigation.ephemerides if e.sat in sats]
    return tuple(replace(e, **{name: change(e) for name, change in changes.items()}) for e in own[:count])


def with_messages(records: Records, ephemerides=(), mistimed=()) -> Records:
    start = records.start_gpst
    messages = ReceivedMessages(
        gpst=np.full(len(ephemerides), start, "M8[ns]"),
        ephemerides=tuple(ephemerides),
        mistimed_gpst=np.full(len(mistimed), start, "M8[ns]"),
        mistimed_sat=tuple(mistimed),
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
    assert examine(with_messages(records, sent(records, 9))).statistic == 0.0


def late(e: Ephemeris) -> float:
    return e.af0 + 300.0 / SPEED_OF_LIGHT_M_S


@pytest.mark.parametrize(("count", "failed"), [(1, False), (2, False), (6, True)])
def test_other_clocks_under_one_issue_of_data_are_odd(count, failed) -> None:
    records = clean()
    found = examine(with_messages(records, sent(records, count, af0=late)))
    assert found.statistic == count
    assert (found.failed, found.overrules, found.code) == (failed, failed, "odd" if failed else "expected")
    assert found.says == ("undecided" if failed else "clean")
    assert found.may_also_be == ((Cause.ORBITS, Cause.FAULT) if failed else ())
    assert found.data.get("how") == ("issue_repeated" if failed else None)


def hours(count: float):
    """Return changes of the times of a data set by so many hours."""
    return {name: lambda e, name=name: getattr(e, name) + 3600.0 * count for name in ("toe", "toc")}


@pytest.mark.parametrize(("off_h", "failed"), [(-5.0, True), (5.0, True), (-167.0, True), (0.0, False)])
def test_data_sets_that_do_not_serve_when_they_come_are_odd(off_h, failed) -> None:
    records = clean()
    alone = replace(records, navigation=replace(records.navigation, ephemerides=records.navigation.ephemerides[:1]))
    found = examine(with_messages(alone, sent(records, 6, **hours(off_h))))
    assert found.failed == failed
    if failed:
        assert (found.data["how"], round(found.data["amount"] + off_h)) == ("other_time", 0)


@pytest.mark.parametrize(("count", "failed"), [(2, False), (6, True)])
def test_messages_that_go_back_to_earlier_ones_are_odd(count, failed) -> None:
    records = clean()
    alone = replace(records, navigation=replace(records.navigation, ephemerides=()))
    ill = {"health": lambda e: 63}  # such ones are not held against others
    later = with_messages(alone, sent(records, 9, **hours(0.5), **ill))
    found = examine(later, with_messages(alone, sent(records, count, **ill)))
    assert found.statistic == count
    assert found.failed == failed


def test_receivers_that_hear_an_upload_one_after_the_other_do_not_go_back() -> None:
    records = clean()
    (o,) = records.observations
    two = replace(records, observations=(o, replace(o, receiver="rx2")))
    two = replace(two, navigation=replace(records.navigation, ephemerides=()))
    ill = {"health": lambda e: 63}  # such ones are not held against others
    first, second = (
        with_messages(two, sets).messages["rx1"]
        for sets in (sent(records, 6, **hours(0.5), **ill), sent(records, 6, **ill))
    )
    assert not examine_all(replace(two, messages={"rx1": first, "rx2": second}))[1].failed


def test_a_later_issue_that_contradicts_is_odd() -> None:
    records = clean()
    later = sent(records, 6, af0=late, toe=lambda e: e.toe + 3600.0, toc=lambda e: e.toc + 3600.0)
    found = examine(with_messages(records, later))
    assert (found.failed, found.data["how"]) == (True, "other_orbit")
    assert found.data["amount"] > 300.0  # metres: the clock, and an orbit of another hour


def test_messages_of_earlier_windows_are_remembered() -> None:
    records = clean()
    unknown = replace(records, navigation=replace(records.navigation, ephemerides=records.navigation.ephemerides[:1]))
    first = with_messages(unknown, sent(records, 6))
    second = with_messages(unknown, sent(records, 6, af0=late))
    assert not examine(first).failed
    assert examine(first, second).failed


def test_another_time_of_week_is_odd() -> None:
    records = clean()
    sats = sorted({signal.sat for signal in records.observations[0].signals})
    assert not examine(with_messages(records, mistimed=sats[:1])).failed
    found = examine(with_messages(records, mistimed=sats[:6]))
    assert (found.failed, found.data["how"], found.data["odd"]) == (True, "mistimed", tuple(sats[:6]))


def test_satellites_below_the_horizon_are_odd() -> None:
    """The same measurements, with the receiver at the other side of the Earth."""
    records = clean()
    (sky,) = records.sets
    found = examine(replace(records, sets=(replace(sky, position_ecef_m=-sky.position_ecef_m),)))
    assert (found.failed, found.data["how"]) == (True, "below_horizon")
