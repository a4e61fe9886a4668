"""Numbers in plain words."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyproof.gnss.time import format_clock, format_instant, format_moment
from skyproof.report.evidence import describe_chance
from skyproof.report.words import (
    angle_words,
    chance_words,
    evidence_words,
    leap_words,
    number_words,
    p_value_words,
    place_words,
    rate_words,
    seconds_words,
    span_words,
)


@pytest.mark.parametrize(
    ("probability", "words"),
    [
        (1.0, "in 100 of 100 cases"),
        (0.33, "in 33 of 100 cases"),
        (0.015, "in 1.5 of 100 cases"),
        (0.02, "in 2 of 100 cases"),
        (0.001, "once in 1\u202f000 cases"),
        (2.9e-5, "once in 30\u202f000 cases"),
        (1.3e-9, "once in 7·10⁸ cases"),
        (1e-20, "once in 10²⁰ cases"),
        (0.0, "practically never"),
        (5e-324, "practically never"),
    ],
)
def test_chances_read_as_people_say_them(probability: float, words: str) -> None:
    assert chance_words(probability) == words


@given(st.floats(0.0, 1.0))
def test_every_probability_has_words(probability: float) -> None:
    assert chance_words(probability)
    assert p_value_words(probability)[0] == "p"
    assert rate_words(probability)


def test_p_values_and_rates() -> None:
    assert [p_value_words(p) for p in (0.33, 1.3e-9, 0.0)] == [
        "p\N{NO-BREAK SPACE}=\N{NO-BREAK SPACE}0.33",
        "p\N{NO-BREAK SPACE}=\N{NO-BREAK SPACE}1.3·10⁻⁹",
        "p\N{NO-BREAK SPACE}<\N{NO-BREAK SPACE}10⁻³⁰⁰",
    ]
    assert [rate_words(p) for p in (1e-3, 0.5, 0.9)] == ["once in 1\u202f000 hours", "once in 2 hours", "every hour"]


def test_numbers_of_any_size_stay_readable() -> None:
    words = [number_words(x) for x in (27104.24, 13.80001, 3e-9, -1234.5)]
    assert [text.replace("\N{MINUS SIGN}", "-") for text in words] == ["27104", "13.8", "3e-09", "-1234"]


def test_instants_lose_idle_zeros_and_stretches_a_second_date() -> None:
    assert format_instant("2022-01-01T10:00:24.500000") == "2022-01-01 10:00:24.5"
    assert format_instant("2022-01-01T10:00:20") == "2022-01-01 10:00:20"
    assert span_words("2022-01-01T10:00:00", "2022-01-01T10:01:00") == "2022-01-01 10:00:00 to 10:01:00"
    assert span_words("2022-01-01T23:59:00", "2022-01-02T00:01:00") == "2022-01-01 23:59:00 to 2022-01-02 00:01:00"
    assert span_words(None, "2022-01-01T10:01:00") == "unknown to 2022-01-01 10:01:00"


def test_times_come_in_the_unit_of_their_size() -> None:
    assert [seconds_words(s) for s in (2.0, -0.0125, 4.46e-6, 0.0, 3e-10)] == [
        "2 s",
        "-12.5 ms",
        "4.46 µs",
        "0 ns",
        "0.3 ns",
    ]


def test_degrees_and_decimal_minutes_are_as_fine_as_degrees() -> None:
    assert place_words(59.4121, -16.8837, 5, minutes=True) == "59° 24.726′ N, 16° 53.022′ W"
    assert angle_words(-0.99999999, 179.9999999, 7, minutes=True) == ("1° 00.00000′ S", "179° 59.99999′ E")
    assert angle_words(59.4121, -16.8837, 4, minutes=False) == ("59.4121° N", "16.8837° W")


def test_no_more_is_claimed_of_evidence_than_was_counted() -> None:
    assert evidence_words(1e-30) == evidence_words(9e-7) == f"less than {chance_words(1e-6)}"
    assert evidence_words(1e-5) == chance_words(1e-5)
    assert "1e-30" not in describe_chance("spoofed", 1e-30)
    assert evidence_words(1e-30) in describe_chance("spoofed", 1e-30)
    assert describe_chance("authentic", 1e-3) != describe_chance("attack", 1e-3)  # under another hypothesis


@pytest.mark.parametrize(
    ("gpst", "by_both", "clock"),
    [
        (
            "2022-01-01T10:00:24.5",
            "2022-01-01 10:00:24.5 GPS time (10:00:06.5 UTC)",
            "10:00:24.5 GPS time (10:00:06.5 UTC)",
        ),
        (
            "2022-01-01T00:00:08",
            "2022-01-01 00:00:08 GPS time (2021-12-31 23:59:50 UTC)",
            "00:00:08 GPS time (2021-12-31 23:59:50 UTC)",
        ),
    ],
)
def test_instants_stand_by_both_clocks(gpst: str, by_both: str, clock: str) -> None:
    assert (format_moment(gpst), format_clock(gpst)) == (by_both, clock)
    assert leap_words(gpst) == "UTC + 18 s"
