"""Golden positions and delays: an independent program's (truth.csv of the rendered pair), and one written out here."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyproof.formats.rinex_nav import read_nav
from skyproof.gnss.atmosphere import compute_klobuchar_s, compute_troposphere_m
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import Ephemeris
from skyproof.gnss.frames import ecef_from_geodetic, geodetic_from_ecef
from skyproof.gnss.orbits import compute_satellite_state, compute_satellite_state_s
from skyproof.gnss.sky import compute_azimuth_elevation, rotate_to_reception
from skyproof.gnss.time import gpst, gpst_from_utc

# G05 of 1 January 2022, 22:00, from the IGS broadcast file of the day, rounded; every term is at work.
EPHEMERIS = Ephemeris(
    sat="G05",
    week=2190,
    toe=597600.0,
    toc_week=2190,
    toc=597600.0,
    af0=-1.1e-4,
    af1=-3.4e-12,
    af2=2e-19,
    tgd=-1.1e-8,
    iode=57,
    iodc=57,
    sqrt_a=5153.66,
    e=0.0057,
    i0=0.9605,
    omega0=-0.99,
    omega=1.02,
    m0=-2.31,
    delta_n=4.6e-9,
    idot=-3.3e-10,
    omega_dot=-8.06e-9,
    crs=-84.9,
    crc=272.1,
    cus=6.0e-6,
    cuc=-4.6e-6,
    cis=1.1e-7,
    cic=-9.3e-8,
)


def compute_slow_position_m(eph, tk):
    """Compute the position by bisection, perifocal coordinates and rotation matrices: the slow twin."""
    mean = eph.m0 + (np.sqrt(3.986005e14 / eph.sqrt_a**6) + eph.delta_n) * tk
    low, high = mean - 1.0, mean + 1.0
    for _ in range(80):
        middle = (low + high) / 2
        low, high = (middle, high) if middle - eph.e * np.sin(middle) < mean else (low, middle)
    x = eph.sqrt_a**2 * (np.cos(low) - eph.e)
    y = eph.sqrt_a**2 * np.sqrt(1 - eph.e**2) * np.sin(low)
    r, phi = np.hypot(x, y), np.arctan2(y, x) + eph.omega
    r += eph.crc * np.cos(2 * phi) + eph.crs * np.sin(2 * phi)
    u = phi + eph.cuc * np.cos(2 * phi) + eph.cus * np.sin(2 * phi)
    i = eph.i0 + eph.idot * tk + eph.cic * np.cos(2 * phi) + eph.cis * np.sin(2 * phi)
    node = eph.omega0 + eph.omega_dot * tk - 7.2921151467e-5 * (eph.toe + tk)

    def make_rotation(axis, angle):
        a, b = [k for k in range(3) if k != axis]
        rot = np.eye(3)
        rot[a, a] = rot[b, b] = np.cos(angle)
        rot[a, b], rot[b, a] = -np.sin(angle), np.sin(angle)
        return rot

    return make_rotation(2, node) @ make_rotation(0, i) @ make_rotation(2, u) @ [r, 0.0, 0.0]


@given(st.floats(-4 * 3600.0, 4 * 3600.0), st.floats(0.0, 0.03), st.floats(-np.pi, np.pi))
def test_positions_are_those_of_an_independent_computation(since_toe_s, e, m0):
    eph = replace(EPHEMERIS, e=e, m0=m0)
    ours_m = compute_satellite_state_s(eph, eph.week, eph.toe + since_toe_s).position_ecef_m
    np.testing.assert_allclose(ours_m, compute_slow_position_m(eph, since_toe_s), atol=1e-6)


@given(st.floats(-4 * 3600.0, 4 * 3600.0))
def test_velocity_and_drift_are_rates_of_position_and_clock(since_toe_s):
    eph = replace(EPHEMERIS, af2=1e-16, e=0.02)
    states = compute_satellite_state_s(eph, eph.week, eph.toe + since_toe_s + np.array([-1.0, 0.0, 1.0]))
    moved_m = states.position_ecef_m[2] - states.position_ecef_m[0]
    np.testing.assert_allclose(states.velocity_ecef_m_s[1], moved_m / 2.0, atol=1e-4)  # third derivative / 6: 2e-5
    gained_s = states.clock_s[2] - states.clock_s[0]
    assert abs(states.clock_drift[1] - gained_s / 2.0) < 1e-15


def test_the_clock_has_polynomial_and_relativity_but_no_delay():
    eph = replace(EPHEMERIS, m0=np.pi / 2, e=0.01, af0=1e-4, af1=0.0, af2=0.0)
    eccentric_rad = np.pi / 2 + 0.01  # to first order of e
    # IS-GPS-200N, 20.3.3.3.3.1.
    expected_s = 1e-4 - 4.442807633e-10 * 0.01 * eph.sqrt_a * np.sin(eccentric_rad)
    assert compute_satellite_state_s(eph, eph.week, eph.toe).clock_s == pytest.approx(expected_s, abs=1e-14)
    later = compute_satellite_state_s(replace(EPHEMERIS, e=0.0), EPHEMERIS.week, EPHEMERIS.toc + 1000.0)
    assert later.clock_s == pytest.approx(-1.1e-4 - 3.4e-9 + 2e-13, abs=1e-18)


def test_instants_and_seconds_of_week_give_the_same_state():
    tow_s = np.linspace(590000.0, 604000.0, 6).reshape(2, 3).round(3)
    by_label = compute_satellite_state(EPHEMERIS, gpst(np.array(2190), tow_s))
    by_second = compute_satellite_state_s(EPHEMERIS, 2190, tow_s)
    assert by_label.position_ecef_m.shape == by_label.velocity_ecef_m_s.shape == (2, 3, 3)
    assert by_label.clock_s.shape == by_label.clock_drift.shape == (2, 3)
    np.testing.assert_allclose(by_label.position_ecef_m, by_second.position_ecef_m, atol=1e-5)
    np.testing.assert_allclose(by_label.clock_s, by_second.clock_s, atol=1e-19)
    state = compute_satellite_state(EPHEMERIS, gpst(2190, 590000.0))
    assert state.position_ecef_m.shape == (3,)
    np.testing.assert_array_equal(state.position_ecef_m, by_label.position_ecef_m[0, 0])


def test_an_orbit_runs_on_over_the_end_of_the_week():
    eph = replace(EPHEMERIS, week=2191, toe=0.0, toc_week=2191, toc=0.0)
    across = compute_satellite_state_s(eph, [2190, 2190, 2191, 2191], [604799.0, 604800.0, 0.0, 1.0])
    np.testing.assert_allclose(across.position_ecef_m[1], across.position_ecef_m[2], atol=1e-9)
    steps_m = np.diff(across.position_ecef_m[[0, 2, 3]], axis=0)
    np.testing.assert_allclose(steps_m[0], steps_m[1], atol=1.0)
    old_toe = replace(EPHEMERIS, toe=0.0, week=2190, toc_week=2189, toc=604784.0)
    assert abs(compute_satellite_state_s(old_toe, 2190, 0.0).clock_s - old_toe.af0) < 1e-7  # 16 s after toc, not a week


@pytest.mark.shared_data
def test_the_sky_of_an_independent_program_is_ours(shared_data, authentic_rows):
    # Geometry, clocks, relativity, group delay, Sagnac, ionosphere and troposphere together, to 0.2 mm.
    navigation = read_nav(shared_data / "rf" / "brdc0010.22n")
    truth = json.loads((shared_data / "rf" / "meaconing-pair" / "truth.json").read_text())
    places = {receiver["name"]: receiver["position"] for receiver in truth["receivers"]}
    rows = authentic_rows
    assert len(rows["prn"]) == 1416
    for name, prn in sorted(set(zip(rows["receiver"], rows["prn"], strict=True))):
        mine = (rows["receiver"] == name) & (rows["prn"] == prn)
        tow_s, place = rows["tow_s"][mine], places[name]
        rx_m = ecef_from_geodetic(np.radians(place["lat_deg"]), np.radians(place["lon_deg"]), place["h_m"])
        lat_rad, lon_rad, height_m = geodetic_from_ecef(rx_m)
        eph = navigation.best(f"G{prn:02d}", gpst(2190, tow_s[0]))
        delay_s = np.full_like(tow_s, 0.075)
        for _ in range(5):
            state = compute_satellite_state_s(eph, 2190, tow_s - delay_s)
            range_m = np.linalg.norm(rotate_to_reception(state.position_ecef_m, delay_s) - rx_m, axis=-1)
            az_rad, el_rad = compute_azimuth_elevation(rx_m, rotate_to_reception(state.position_ecef_m, delay_s))
            iono_s = compute_klobuchar_s(navigation.ionosphere, lat_rad, lon_rad, az_rad, el_rad, tow_s)
            tropo_s = compute_troposphere_m(lat_rad, height_m, el_rad) / SPEED_OF_LIGHT_M_S
            delay_s = range_m / SPEED_OF_LIGHT_M_S + iono_s + tropo_s
        code_delay_s = delay_s - (state.clock_s - eph.tgd)
        np.testing.assert_allclose(np.degrees(az_rad), rows["az_deg"][mine], atol=1e-4)  # written to four decimals
        np.testing.assert_allclose(np.degrees(el_rad), rows["el_deg"][mine], atol=1e-4)
        np.testing.assert_allclose(range_m, rows["range_m"][mine], atol=2e-4)
        difference_m = (code_delay_s - rows["code_delay_s"][mine]) * SPEED_OF_LIGHT_M_S
        np.testing.assert_allclose(difference_m, 0.0, atol=2e-4)
        split_s = rows["code_delay_s"][mine] - rows["carrier_delay_s"][mine]  # the ionosphere, twice
        np.testing.assert_allclose(iono_s * SPEED_OF_LIGHT_M_S, split_s / 2 * SPEED_OF_LIGHT_M_S, atol=1e-5)


@pytest.mark.shared_data
def test_neighbouring_broadcast_orbits_agree_where_they_meet(shared_data):
    ephemerides = [e for e in read_nav(shared_data / "rf" / "brdc0010.22n").ephemerides if e.health == 0]
    gaps_m = []
    for first in ephemerides:
        for second in ephemerides:
            if first.sat == second.sat and (first.week, first.toe + 7200.0) == (second.week, second.toe):
                middle = gpst(first.week, first.toe + 3600.0)
                gap_m = (
                    compute_satellite_state(first, middle).position_ecef_m
                    - compute_satellite_state(second, middle).position_ecef_m
                )
                gaps_m.append(np.linalg.norm(gap_m))
    assert len(gaps_m) > 250
    assert np.median(gaps_m) < 1.0  # the control segment's fits: metres at the worst, decimetres as a rule
    assert np.quantile(gaps_m, 0.99) < 10.0


def propagate_two_lines(first, second):
    """Return the UTC epoch of two-line elements and the ECEF position then, by Kepler and sidereal time (1982)."""
    epoch = np.datetime64(f"20{first[18:20]}-01-01T00:00:00", "ns")
    epoch += np.timedelta64(round((float(first[20:32]) - 1.0) * 86400e9), "ns")
    inclination, node, e, perigee, mean = (
        float(text) for text in (second[8:16], second[17:25], "0." + second[26:33], second[34:42], second[43:51])
    )
    days = (epoch - np.datetime64("2000-01-01T12:00:00", "ns")) / np.timedelta64(1, "D")
    sidereal_rad = np.radians((280.46061837 + 360.98564736629 * days) % 360.0)
    motion_rad_s = float(second[52:63]) * 2.0 * np.pi / 86400.0
    sqrt_a = (3.986005e14 / motion_rad_s**2) ** (1 / 6)
    plain = dict.fromkeys(("idot", "omega_dot", "delta_n", "crs", "crc", "cus", "cuc", "cis", "cic", "toe"), 0.0)
    angles = {"i0": inclination, "omega": perigee, "m0": mean}
    kepler = replace(
        EPHEMERIS,
        sqrt_a=sqrt_a,
        e=e,
        **plain,
        **{k: np.radians(v) for k, v in angles.items()},
        omega0=np.radians(node) - sidereal_rad,
    )
    return epoch, compute_slow_position_m(kepler, 0.0)


@pytest.mark.shared_data
def test_satellites_are_where_the_tracking_radars_see_them(shared_data):
    # Two-line elements near 31 October 2012 (NORAD) against the broadcast of that day.
    # Mean elements read as plain Kepler leave out what the Moon, the Sun and the Earth's shape do: some tens of
    # kilometres, a tenth of a degree. A coarse check, but of everything, the Earth's orientation included.
    text = (shared_data / "real" / "brdc" / "TLE_GNSS_20121101.txt").read_text(encoding="latin-1")
    lines = [line for line in text.splitlines() if line[:1] not in ("#", "")]
    navigation = read_nav(shared_data / "real" / "brdc" / "brdc3050.12n")
    gaps_m = []
    for name, first, second in zip(lines, lines[1:], lines[2:], strict=False):
        if name[:1] == "G" and first[:2] == "1 " and second[:2] == "2 ":
            utc, radar_m = propagate_two_lines(first, second)
            eph = navigation.best(name.strip(), gpst_from_utc(utc), max_age_s=3600.0)
            if eph is not None:
                gaps_m.append(
                    np.linalg.norm(compute_satellite_state(eph, gpst_from_utc(utc)).position_ecef_m - radar_m)
                )
    assert len(gaps_m) >= 15
    assert np.median(gaps_m) < 25e3
    assert max(gaps_m) < 60e3
