"""CNAV and B-CNAV: frames made field by field, with a checksum of their own, give what was put into them."""

from dataclasses import replace

import numpy as np
import pytest
from tests.logs.frames import make_rtcm3_frame
from tests.logs.test_orbits import encode_value

from skyproof.gnss.constants import GPS_PI
from skyproof.gnss.ephemeris import group_delay_s
from skyproof.gnss.messages import modern
from skyproof.gnss.messages.bit_fields import compute_crc_24q
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.orbits import compute_satellite_state

SENT = make_nominal_constellation(np.datetime64("2022-01-01T20:00:00", "ns")).ephemerides[3]
VALUES = {name: getattr(SENT, name) for name in ("m0", "e", "omega", "omega0", "i0", "toe", "toc")}
VALUES |= {"a_dot": 0.0125, "delta_n": 4e-9, "delta_n_dot": -2e-13, "idot": 3e-11, "crs": -60.25, "crc": 210.5}
VALUES |= {"cus": 7e-6, "cuc": -3e-6, "cis": 5e-8, "cic": -9e-8, "af0": 2.5e-4, "af1": -3e-12, "af2": 0.0}
VALUES |= {"week_mod_8192": SENT.week, "delta_a": SENT.sqrt_a**2 - 26_559_710.0, "delta_omega_dot": 1e-10, "health": 0}
STEP_S = 2.0**-35


def seal(frame: int, n_bits: int) -> int:
    """Return a frame with its checksum, as the frames of RTCM 3 have it, a bit at a time."""
    value = 0
    for k in range(n_bits - 1, 23, -1):
        value = value << 1 ^ (0x1864CFB if (value >> 23 ^ frame >> k) & 1 else 0)
    return frame | value & 0xFFFFFF


def make_cnav(kind: int, tow_s: float, prn: int = 4, **more: float) -> int:
    frame = 0b10001011 << 292 | prn << 286 | kind << 280 | int(tow_s / 6) << 263
    for field in modern._CNAV[kind]:
        frame |= encode_value(field, (VALUES | more).get(field.name, 0), 300)
    return seal(frame, 300)


def list_cnav(*frames: int) -> dict:
    return dict(modern.cnav_message(frame) for frame in frames)


TOW_S = SENT.toe - 3600.0
DELAYS = {"tgd_steps": -300, "l1ca_steps": 20, "l2c_steps": -4096, "l5i_steps": 150, "l5q_steps": 160}


def test_the_checksum_is_that_of_other_frames_with_it() -> None:
    frame = make_rtcm3_frame(b"anything")
    body = frame[:-3]
    assert compute_crc_24q(int.from_bytes(body, "big"), 8 * len(body)) == int.from_bytes(frame[-3:], "big")


def test_cnav_messages_give_the_orbit_that_was_put() -> None:
    messages = list_cnav(make_cnav(10, TOW_S), make_cnav(11, TOW_S + 12), make_cnav(30, TOW_S + 24, **DELAYS))
    made = modern.cnav_ephemeris(messages, "G04", SENT.week + 9)
    assert (made.sat, made.week, made.toe, made.toc_week, made.message) == (
        "G04",
        SENT.week,
        SENT.toe,
        SENT.week,
        "CNAV",
    )
    assert made.sqrt_a == pytest.approx(SENT.sqrt_a, abs=1e-6)
    assert made.omega_dot == pytest.approx(-2.6e-9 * GPS_PI + 1e-10, abs=1e-13)
    for name in ("m0", "e", "i0", "omega0", "omega", "a_dot", "delta_n", "delta_n_dot", "crs", "cus", "cic", "af0"):
        assert getattr(made, name) == pytest.approx(VALUES[name], rel=1e-3, abs=1e-9), name
    assert group_delay_s(made, "L1", "CA") == pytest.approx(STEP_S * -320)
    assert group_delay_s(made, "L5", "Q") == pytest.approx(STEP_S * -460)
    assert group_delay_s(made, "L1", "W") == pytest.approx(STEP_S * -300)
    assert np.isnan(group_delay_s(made, "L2", "L"))  # stated as not available
    assert made.healthy


@pytest.mark.parametrize(
    "changes", [{"toe": SENT.toe - 300.0}, {"toc": SENT.toe - 300.0}, {"prn": 5}, {"delta_a": -60_000.0, "e": 0.4}]
)
def test_parts_of_different_data_make_no_orbit(changes) -> None:
    good = list_cnav(make_cnav(10, TOW_S), make_cnav(11, TOW_S + 12), make_cnav(30, TOW_S + 24))
    assert modern.cnav_ephemeris(good, "G04", SENT.week) is not None
    kind = 30 if "toc" in changes else 10
    bad = good | list_cnav(make_cnav(kind, TOW_S, **changes))
    assert modern.cnav_ephemeris(bad, "G04", SENT.week) is None


def test_damage_and_missing_messages_give_none() -> None:
    good = make_cnav(10, TOW_S)
    assert modern.cnav_message(good ^ 1 << 100) is None
    assert modern.cnav_message(good ^ 1 << 299) is None
    assert modern.cnav_ephemeris(list_cnav(good, make_cnav(11, TOW_S)), "G04", SENT.week) is None
    assert modern.bcnav2_message(1 << 280) is None
    assert modern.bcnav1_subframe(1 << 580) is None


def test_an_axis_and_motion_that_change_move_the_satellite() -> None:
    plain = modern.cnav_ephemeris(
        list_cnav(make_cnav(10, TOW_S), make_cnav(11, TOW_S), make_cnav(30, TOW_S)), "G04", SENT.week
    )
    still = replace(plain, a_dot=0.0, delta_n_dot=0.0)
    at = plain.reference_gpst + np.timedelta64(3600, "s")
    apart_m = np.linalg.norm(
        compute_satellite_state(plain, at).position_ecef_m - compute_satellite_state(still, at).position_ecef_m
    )
    along_m = 0.5 * 2e-13 * 3600.0**2 * SENT.sqrt_a**2
    assert apart_m == pytest.approx(np.hypot(along_m, 45.0), rel=0.1)
    step = np.timedelta64(500, "ms")
    moved_m = (
        compute_satellite_state(plain, at + step).position_ecef_m
        - compute_satellite_state(plain, at - step).position_ecef_m
    )
    assert compute_satellite_state(plain, at).velocity_ecef_m_s == pytest.approx(moved_m, abs=1e-3)


BDS = VALUES | {
    "week_bdt": SENT.week - 1356,
    "kind": 3,
    "delta_a": -1500.0,
    "omega_dot": -7e-9,
    "iode": 37,
    "iodc": 37 + 512,
    "hour": SENT.toe // 3600 - 1,
    "tgd_b1c": -1.2e-8,
    "tgd_b2a": 3.0e-9,
    "isc_b2a": 4e-10,
    "isc_b1c": -6e-10,
}


def make_bcnav2(number: int, sow_s: float, **more: float) -> int:
    frame = 27 << 282 | number << 276 | int(sow_s / 3) << 258
    for field in modern._BCNAV2[number]:
        frame |= encode_value(field, (BDS | more).get(field.name, 0), 288)
    return seal(frame, 288)


def make_bcnav1(**more: float) -> int:
    frame = 0
    for field in modern._BCNAV1:
        frame |= encode_value(field, (BDS | more).get(field.name, 0), 600)
    return seal(frame, 600)


def list_bcnav2(*frames: int) -> dict:
    return dict(modern.bcnav2_message(frame) for frame in frames)


def test_both_messages_of_beidou_give_the_orbit_that_was_put() -> None:
    sow_s = SENT.toe - 1800.0
    parts = list_bcnav2(make_bcnav2(10, sow_s), make_bcnav2(11, sow_s + 3), make_bcnav2(30, sow_s + 6))
    second = modern.bcnav2_ephemeris(parts, "C27", SENT.week)
    first = modern.bcnav1_ephemeris(dict([modern.bcnav1_subframe(make_bcnav1())]), "C27", SENT.week)
    for made in (first, second):
        assert (made.week, made.toe, made.iode, made.iodc) == (SENT.week, SENT.toe, 37, 549)
        assert made.sqrt_a**2 == pytest.approx(27_906_100.0 - 1500.0, abs=0.01)
        for name in ("m0", "e", "i0", "omega0", "omega_dot", "a_dot", "delta_n_dot", "crc", "cuc", "af0", "tgd"):
            assert getattr(made, name) == pytest.approx((BDS | {"tgd": -1.2e-8})[name], rel=1e-2, abs=1e-10), name
        assert np.isnan(group_delay_s(made, "B1", "2I"))
        assert group_delay_s(made, "B3", "6I") == 0.0
    assert group_delay_s(second, "B2a", "5D") == pytest.approx(3.4e-9, abs=2.0**-34)
    assert group_delay_s(first, "B1C", "1D") == pytest.approx(-1.26e-8, abs=2.0**-34)


@pytest.mark.parametrize(
    ("number", "at_s", "changes"),
    [(30, 6, {"iodc": 38}), (11, 90, {}), (11, -3, {}), (10, 0, {"kind": 1}), (10, 0, {"kind": 0})],
)
def test_parts_of_beidou_that_do_not_belong_make_none(number, at_s, changes) -> None:
    sow_s = SENT.toe - 1800.0
    parts = list_bcnav2(make_bcnav2(10, sow_s), make_bcnav2(11, sow_s + 3), make_bcnav2(30, sow_s + 6))
    parts |= list_bcnav2(make_bcnav2(number, sow_s + at_s, **changes))
    assert modern.bcnav2_ephemeris(parts, "C27", SENT.week) is None


def test_an_inclined_orbit_counts_from_its_own_axis() -> None:
    made = modern.bcnav1_ephemeris(dict([modern.bcnav1_subframe(make_bcnav1(kind=2))]), "C38", SENT.week)
    assert made.sqrt_a**2 == pytest.approx(42_162_200.0 - 1500.0, abs=0.01)
    assert modern.bcnav1_ephemeris(dict([modern.bcnav1_subframe(make_bcnav1(kind=2))]), "C59", SENT.week) is None
