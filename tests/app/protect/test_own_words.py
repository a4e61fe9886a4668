"""What a receiver says of itself: spells of one word, its last fix, how far that lies from the trusted one."""

import numpy as np
import pytest

from skyproof.app.protect.own_words import compare_receiver_fix, list_receiver_states, select_rows_with_place
from skyproof.app.protect.positions import Track
from skyproof.formats.tables import FIXES_COLUMNS, build_own_fixes_columns
from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.logs.content import ReceiverStates
from skyproof.records import Fix, ReceiverFixes

START = np.datetime64("2024-05-14T10:00:00", "ns")
SECOND = np.timedelta64(1, "s")
LAT_DEG, LON_DEG = 59.4, 16.9
NORTH_DEG_A_METRE = 1.0 / 111_412.0


def make_times(n: int) -> np.ndarray:
    return START + np.arange(n) * SECOND


def make_places(north_m) -> np.ndarray:
    lat = np.radians(LAT_DEG + np.asarray(north_m, float) * NORTH_DEG_A_METRE)
    return ecef_from_geodetic(lat, np.full(lat.size, np.radians(LON_DEG)), np.full(lat.size, 30.0))


def make_own_fixes(north_m) -> ReceiverFixes:
    n = len(north_m)
    lat = np.radians(LAT_DEG + np.asarray(north_m, float) * NORTH_DEG_A_METRE)
    return ReceiverFixes.from_geodetic(
        make_times(n), lat, np.full(n, np.radians(LON_DEG)), np.full(n, 30.0), horizontal_sigma_m=np.full(n, 2.0)
    )


def make_trusted(north_m) -> Track:
    position = make_places(north_m)
    last = Fix(
        receiver="rx1",
        signals=(),
        gpst=make_times(len(north_m))[-1:],
        position_ecef_m=position[-1:],
        velocity_ecef_m_s=np.zeros((1, 3)),
        clock_bias_s=np.zeros(1),
        clock_drift=np.zeros(1),
        covariance_m2=np.eye(4)[None],
        residual_m=np.empty((1, 0)),
        status=np.zeros(1, np.uint8),
    )
    clock_s = np.where(np.isfinite(position[:, 0]), 0.0, np.nan)
    return Track(
        gpst=make_times(len(north_m)) + np.timedelta64(3, "ms"),
        position_ecef_m=position,
        clock_bias_s=clock_s,
        last=last,
    )


def list_states(*rows: tuple[int, str, str, bool]) -> ReceiverStates:
    seconds, subjects, words, alarms = zip(*rows, strict=True)
    return ReceiverStates(
        gpst=START + np.array(seconds) * SECOND,
        subject=np.array(subjects, "U14"),
        state=np.array(words),
        alarm=np.array(alarms),
    )


def test_words_that_stay_are_one_spell() -> None:
    found = list_receiver_states(
        list_states(
            (0, "jamming", "none", False),
            (1, "jamming", "none", False),
            (2, "jamming", "critical", True),
            (2, "spoofing", "none", False),
            (3, "jamming", "critical", True),
        )
    )
    spells = [(s.subject, s.state, s.alarm, s.since_gpst[-9:-7], s.until_gpst[-9:-7]) for s in found]
    assert spells == [
        ("jamming", "none", False, "00", "01"),
        ("jamming", "critical", True, "02", "03"),
        ("spoofing", "none", False, "02", "02"),
    ]


def test_of_two_front_ends_the_one_that_alarms_counts() -> None:
    found = list_receiver_states(list_states((0, "jamming", "none", False), (0, "jamming", "warning", True)))
    assert [(s.state, s.alarm) for s in found] == [("warning", True)]


def test_of_many_spells_alarms_stay() -> None:
    flicker = [(k, "jamming", "none" if k % 2 else "unknown", False) for k in range(200)]
    flicker[150] = (150, "jamming", "critical", True)
    found = list_receiver_states(list_states(*flicker))
    assert len(found) == 20
    assert [s.state for s in found].count("critical") == 1


def test_a_receiver_that_says_nothing_has_no_words() -> None:
    assert list_receiver_states(None) == ()
    assert compare_receiver_fix(None, None) is None


def test_the_distance_is_of_the_same_epochs() -> None:
    ours = make_trusted([0.0, 0.0, 0.0, np.nan, 0.0])
    found = compare_receiver_fix(make_own_fixes([0.0, 50.0, 900.0, 5000.0, 30.0]), ours)
    assert found is not None
    assert found.from_trusted_m == pytest.approx(30.0, abs=0.1)
    assert found.most_from_trusted_m == pytest.approx(900.0, abs=1.0)
    assert found.most_from_trusted_gpst[-9:-7] == "02"
    assert found.horizontal_sigma_m == 2.0


def test_without_a_trusted_position_there_is_no_distance() -> None:
    found = compare_receiver_fix(make_own_fixes([0.0, 50.0]), None)
    assert found is not None
    assert found.from_trusted_m is None
    assert found.lat_deg == pytest.approx(LAT_DEG + 50.0 * NORTH_DEG_A_METRE)


def test_its_rows_in_the_table_of_fixes_are_its_own() -> None:
    fixes = make_own_fixes([0.0, 50.0, 60.0])
    columns = build_own_fixes_columns("rx1", fixes, select_rows_with_place(fixes))
    assert tuple(columns) == FIXES_COLUMNS
    assert set(columns["kind"]) == {"receiver"}
    assert np.hypot(columns["sigma_east_m"], columns["sigma_north_m"]) == pytest.approx(2.0)
