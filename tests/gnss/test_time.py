"""Golden instants from outside: IERS Bulletin C (leap seconds), IS-GPS-200N 3.3.4 (weeks), GPS week rollovers."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyproof.gnss.time import (
    GPS_EPOCH,
    format_iso,
    gpst,
    gpst_from_utc,
    leap_seconds,
    parse_iso,
    resolve_week,
    seconds_between,
    timedelta_from_s,
    utc_from_gpst,
    week_and_tow,
)

INSTANTS = st.integers(0, 80 * 31_557_600 * 10**9).map(lambda ns: GPS_EPOCH + np.timedelta64(ns, "ns"))


def test_weeks_and_seconds_name_known_instants():
    assert gpst(0, 0.0) == np.datetime64("1980-01-06T00:00:00")
    assert gpst(2190, 596758.0) == np.datetime64("2022-01-01T21:45:58")  # README of the rendered pair
    assert gpst(1042, 518400.0) == np.datetime64("2000-01-01T00:00:00")
    assert gpst(1024, 0.0) == np.datetime64("1999-08-22T00:00:00")  # first rollover
    assert gpst(2048, 0.0) == np.datetime64("2019-04-07T00:00:00")  # second rollover


@given(INSTANTS)
def test_week_and_second_name_an_instant_to_a_nanosecond(t):
    week, tow_s = week_and_tow(t)
    assert isinstance(week, int)
    assert 0.0 <= tow_s < 604800.0
    assert gpst(week, tow_s) == t


def test_arrays_of_instants_go_through_as_scalars_do():
    week, tow_s = np.array([[2190], [2191]]), np.array([0.25, 604799.999999999, 604800.5])
    t = gpst(week, tow_s)
    assert t.shape == (2, 3)
    assert t[1, 1] == gpst(2191, 604799.999999999)
    back_week, back_tow_s = week_and_tow(t)
    np.testing.assert_array_equal(back_week, [[2190, 2190, 2191], [2191, 2191, 2192]])
    np.testing.assert_array_equal(back_tow_s[0], [0.25, 604799.999999999, 0.5])


def test_an_instant_before_the_epoch_has_a_negative_week():
    assert week_and_tow(gpst(-1, 1.5)) == (-1, 1.5)


def test_seconds_between_labels_broadcast_and_keep_the_sign():
    t = gpst(2190, np.array([0.0, 1.5]))
    np.testing.assert_array_equal(seconds_between(t, gpst(2190, 1.0)), [-1.0, 0.5])
    assert seconds_between(gpst(2190, 1e-9), gpst(2190, 0.0)) == 1e-9


@pytest.mark.parametrize(
    ("utc", "leaps"),
    [
        ("1981-06-30T23:59:59", 0),
        ("1981-07-01", 1),
        ("1990-12-31T23:59:59", 6),
        ("1991-01-01", 7),
        ("1999-01-01", 13),
        ("2005-12-31T23:59:59", 13),
        ("2006-01-01", 14),
        ("2009-01-01", 15),
        ("2012-07-01", 16),
        ("2015-07-01", 17),
        ("2016-12-31T23:59:59", 17),
        ("2017-01-01", 18),
        ("2022-01-01", 18),
    ],
)
def test_leap_seconds_are_those_of_the_iers(utc, leaps):
    t = gpst_from_utc(np.datetime64(utc))
    assert seconds_between(t, np.datetime64(utc)) == leaps
    assert leap_seconds(t) == leaps
    assert utc_from_gpst(t) == np.datetime64(utc)


@given(INSTANTS)
def test_utc_and_back_is_the_same_but_for_the_leap_second(t):
    assert abs(seconds_between(gpst_from_utc(utc_from_gpst(t)), t)) in (0.0, 1.0)
    assert leap_seconds(t) <= leap_seconds(t + np.timedelta64(1, "D"))


@given(INSTANTS, st.integers(-511, 511))
def test_ten_bits_find_their_week_within_ten_years(t, weeks_off):
    week, _ = week_and_tow(t)
    assert resolve_week((week + weeks_off) % 1024, t) == week + weeks_off


def test_the_week_rollover_is_resolved_by_the_date():
    assert resolve_week(0, parse_iso("2019-04-08")) == 2048
    assert resolve_week(1023, parse_iso("2019-04-08")) == 2047
    assert resolve_week(0, parse_iso("1999-08-01")) == 1024
    assert resolve_week(142, np.datetime64("2022-01-01")) == 2190  # a label of any resolution


def test_iso_rounds_and_carries():
    assert format_iso(parse_iso("2022-01-01T21:45:58.5"), 1) == "2022-01-01T21:45:58.5"
    assert format_iso(parse_iso("2021-12-31T23:59:59.9996")) == "2022-01-01T00:00:00.000"
    assert format_iso(parse_iso("2022-01-01"), 0) == "2022-01-01T00:00:00"
    assert format_iso(gpst(2190, 1e-9), 9) == "2021-12-26T00:00:00.000000001"
    with pytest.raises(ValueError, match="0 to 9"):
        format_iso(GPS_EPOCH, 10)


@given(INSTANTS)
def test_text_names_the_instant(t):
    assert parse_iso(format_iso(t, 9)) == t


@pytest.mark.parametrize(
    "text",
    [
        "",
        "now",
        "2022-01-01T00:00:00Z",
        "2022-01-01T00:00:00+01:00",
        "2022-13-01",
        "2022",
        "2022-01-01T25:00:00",
        "NaT",
    ],
)
def test_anything_but_gps_time_without_a_zone_is_refused(text):
    with pytest.raises(ValueError):  # noqa: PT011 - some words are numpy's
        parse_iso(text)


def test_seconds_become_whole_nanoseconds():
    assert timedelta_from_s(1.5) == np.timedelta64(1_500_000_000, "ns")
    assert timedelta_from_s(-2.6e-9) == np.timedelta64(-3, "ns")
    found = timedelta_from_s(np.array([[0.0, 1e-9], [3600.0, 0.25]]))
    assert found.dtype == np.dtype("timedelta64[ns]")
    np.testing.assert_array_equal(found.astype(np.int64), [[0, 1], [3_600_000_000_000, 250_000_000]])
