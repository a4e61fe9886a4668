"""What a satellite may say of UTC."""

import numpy as np
import pytest

from skyproof.detectors.messages.utc import leap_seconds_expected, seconds_beyond_utc
from skyproof.gnss.ephemeris import UtcParameters, UtcStatement

NOW = np.datetime64("2024-05-14T10:00:00", "ns")
AFTER = np.datetime64("2031-05-14T10:00:00", "ns")


def build_stated(leaps: int = 18, *, later: int | None = None, from_gpst=NOW, a0: float = 0.0, a1: float = 0.0):
    utc = UtcParameters(a0=a0, a1=a1, tot=0.0, wnt=2314, leap_seconds=leaps)
    return UtcStatement(
        sat="G05", utc=utc, later_leap_seconds=leaps if later is None else later, later_from_gpst=from_gpst
    )


def test_leap_seconds_are_those_of_the_table() -> None:
    assert leap_seconds_expected(NOW, build_stated(17).utc, [build_stated(16)]) == 18
    assert leap_seconds_expected(np.datetime64("2016-12-31T12:00:00", "ns"), None, []) == 17


def test_beyond_the_table_the_file_says_them_or_most_satellites() -> None:
    assert leap_seconds_expected(AFTER, build_stated(19).utc, [build_stated(18)]) == 19
    assert leap_seconds_expected(AFTER, None, [build_stated(19), build_stated(18), build_stated(19)]) == 19


@pytest.mark.parametrize(("a0", "beyond"), [(5e-8, False), (-9e-7, False), (13.7e-6, True), (-2e-6, True)])
def test_a_microsecond_is_the_bound(a0: float, beyond: bool) -> None:
    assert bool(seconds_beyond_utc(build_stated(a0=a0), NOW, 18)) == beyond


def test_a_rate_counts_from_its_time() -> None:
    since_s = (NOW - np.datetime64("2024-05-12T00:00:00", "ns")) / np.timedelta64(1, "s")
    assert seconds_beyond_utc(build_stated(a1=1e-10), NOW, 18) == pytest.approx(1e-10 * since_s)


@pytest.mark.parametrize(("leaps", "off_s"), [(17, -1.0), (18, 0.0), (0, -18.0), (-100, -118.0)])
def test_other_leap_seconds_are_off(leaps: int, off_s: float) -> None:
    assert seconds_beyond_utc(build_stated(leaps), NOW, 18) == off_s


def test_an_announced_change_counts_from_its_time_on() -> None:
    change = build_stated(17, later=18, from_gpst=NOW)
    before = NOW - np.timedelta64(1, "D")
    assert seconds_beyond_utc(change, before, 17) == 0.0
    assert seconds_beyond_utc(change, NOW, 18) == 0.0
    assert seconds_beyond_utc(change, before, 18) == -1.0
