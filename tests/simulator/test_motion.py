"""Trajectories: what each one gives belongs to one smooth curve, and that curve is the one asked for."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from skyproof.errors import ScenarioError
from skyproof.formats.track import RecordedTrack
from skyproof.gnss.frames import (
    attitude_ecef,
    ecef_from_geodetic,
    geodetic_from_ecef,
    heading_pitch_roll_rad,
    rot_enu_ecef,
)
from skyproof.simulator.motion import (
    AlongMotion,
    Held,
    SpinningArm,
    compute_antenna_motion,
)
from skyproof.simulator.trajectories import (
    add_drift,
    ecef_from_enu,
    from_samples,
    from_track,
    make_circle,
    make_las_vegas,
    make_las_vegas_false,
    make_static,
    make_way_points,
)

LAT_RAD, LON_RAD = np.radians(40.0), np.radians(-3.0)
HOME = ecef_from_geodetic(LAT_RAD, LON_RAD, 650.0)
ROT_ENU = rot_enu_ecef(LAT_RAD, LON_RAD)
WAY = ecef_from_enu([[0, 0, 0], [500, 0, 0], [500, 400, 20], [0, 800, 20], [100, 1500, 30], [101, 2500, 30]], HOME)
NODES, WEIGHTS = np.polynomial.legendre.leggauss(4)


def convert_enu(ecef_m):
    return (np.asarray(ecef_m) - HOME) @ ROT_ENU.T


def list_speeds(motion):
    return np.linalg.norm(motion.velocity_ecef_m_s, axis=1)


def list_angles_deg(motion):
    return np.degrees(np.stack(heading_pitch_roll_rad(motion.position_ecef_m, motion.attitude), axis=-1))


def integrate(trajectory, t_s, name):
    """Integrate a field from the first of the times to each later one, by Gauss-Legendre between them."""
    step_s = np.diff(t_s)[:, np.newaxis]
    moments_s = t_s[:-1, np.newaxis] + 0.5 * step_s * (1.0 + NODES)
    values = getattr(trajectory.at(moments_s.ravel()), name).reshape(*moments_s.shape, 3)
    return np.cumsum(0.5 * step_s * np.einsum("tni,n->ti", values, WEIGHTS), axis=0)


def sample(**more):
    t_s = np.arange(0.0, 241.0)
    return from_samples(t_s, make_way_points(WAY, 15.0).at(t_s).position_ecef_m, **more)


EVERY = {
    "static": make_static(HOME, heading_rad=1.0, pitch_rad=0.1, roll_rad=-0.2),
    "way points": make_way_points(WAY, 15.0),
    "way points straight in space, no bank": make_way_points(WAY, 15.0, level=False, attitude=AlongMotion(bank=False)),
    "way points, level nose": make_way_points(WAY, 15.0, radius_m=60.0, attitude=AlongMotion(pitch=False)),
    "way points, held": make_way_points(WAY, 15.0, from_rest=False, to_rest=False, attitude=Held(1.0, 0.1, -0.2)),
    "circle": make_circle(HOME, 80.0, 12.0, start_rad=1.0),
    "circle anticlockwise": make_circle(HOME, 80.0, 12.0, clockwise=False),
    "approach": make_las_vegas(),
    "false approach": make_las_vegas_false(),
    "samples": sample(),
}
ALL = pytest.mark.parametrize("trajectory", EVERY.values(), ids=EVERY.keys())


@ALL
def test_velocity_integrates_to_the_place_to_a_micrometre(trajectory):
    t_s = np.linspace(0.0, 240.0, 6001)
    motion = trajectory.at(t_s)
    gone_m = motion.position_ecef_m[1:] - motion.position_ecef_m[0]
    assert np.abs(integrate(trajectory, t_s, "velocity_ecef_m_s") - gone_m).max() < 1e-6
    gained_m_s = motion.velocity_ecef_m_s[1:] - motion.velocity_ecef_m_s[0]
    assert np.abs(integrate(trajectory, t_s, "acceleration_ecef_m_s2") - gained_m_s).max() < 1e-7


@ALL
def test_rates_are_those_of_the_attitude(trajectory):
    # C' = C [w x], with C' from values half a millisecond apart; angular acceleration adds up to the rate.
    t_s, half_s = np.linspace(0.25, 239.0, 1201), 2.5e-4
    motion = trajectory.at(t_s)
    change = (trajectory.at(t_s + half_s).attitude - trajectory.at(t_s - half_s).attitude) / (2.0 * half_s)
    spin = np.swapaxes(motion.attitude, 1, 2) @ change
    rate_rad_s = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=-1)
    assert np.abs(rate_rad_s - motion.angular_rate_body_rad_s).max() < 1e-7
    t_s = np.linspace(0.0, 240.0, 24_001)
    gained = np.diff(trajectory.at(t_s[[0, -1]]).angular_rate_body_rad_s, axis=0)[0]
    assert np.abs(integrate(trajectory, t_s, "angular_acceleration_body_rad_s2")[-1] - gained).max() < 1e-6


@ALL
def test_attitude_is_a_rotation(trajectory):
    attitude = trajectory.at(np.linspace(-5.0, 250.0, 500)).attitude
    assert np.abs(np.swapaxes(attitude, 1, 2) @ attitude - np.eye(3)).max() < 1e-14
    assert np.linalg.det(attitude).min() > 0.999


@pytest.mark.parametrize("name", ["acceleration_ecef_m_s2", "angular_acceleration_body_rad_s2"])
@pytest.mark.parametrize("trajectory", [EVERY["way points"], EVERY["way points, level nose"]], ids=["wide", "narrow"])
def test_accelerations_are_continuous(trajectory, name):
    # Twice as many moments, half as large the greatest change: a jump would stay as large.
    def greatest(n):
        return np.abs(np.diff(getattr(trajectory.at(np.linspace(0.0, 240.0, n + 1)), name), axis=0)).max()

    assert greatest(96_000) == pytest.approx(greatest(48_000) / 2.0, rel=0.02)


def test_times_come_as_one_axis():
    with pytest.raises(ValueError, match=r"t_s has shape \(\), expected \(n,\)"):
        EVERY["static"].at(3.0)
    assert EVERY["way points"].at([]).position_ecef_m.shape == (0, 3)


def test_the_same_times_in_two_pieces_give_the_same_bytes():
    t_s = np.linspace(0.0, 240.0, 1001)
    for trajectory in EVERY.values():
        whole = trajectory.at(t_s)
        for name in ("position_ecef_m", "attitude", "angular_acceleration_body_rad_s2"):
            pieces = [getattr(trajectory.at(part), name) for part in (t_s[:333], t_s[333:])]
            assert np.array_equal(np.concatenate(pieces), getattr(whole, name))


# --- attitude


def test_body_axes_are_forward_right_down():
    def axes_enu(*angles_deg):
        return (ROT_ENU @ attitude_ecef(HOME, *np.radians(angles_deg))).T

    east, north, up = np.eye(3)
    np.testing.assert_allclose(axes_enu(0, 0, 0), [north, east, -up], atol=1e-15)
    np.testing.assert_allclose(axes_enu(90, 0, 0), [east, -north, -up], atol=1e-15)  # heading: clockwise
    np.testing.assert_allclose(axes_enu(0, 90, 0), [up, east, north], atol=1e-15)  # pitch: nose up
    np.testing.assert_allclose(axes_enu(0, 0, 90), [north, -up, -east], atol=1e-15)  # roll: right side down


@given(st.floats(0.0, 359.0), st.floats(-85.0, 85.0), st.floats(-179.0, 179.0))
def test_angles_of_an_attitude_are_those_it_was_made_of(heading_deg, pitch_deg, roll_deg):
    angles = np.radians([heading_deg, pitch_deg, roll_deg])
    found = heading_pitch_roll_rad(HOME, attitude_ecef(HOME, *angles))
    turn = (np.array(found) - angles + np.pi) % (2.0 * np.pi) - np.pi
    np.testing.assert_allclose(turn, 0.0, atol=1e-12)


def test_a_held_attitude_keeps_its_angles_along_the_way():
    motion = EVERY["way points, held"].at(np.linspace(0.0, 200.0, 50))
    np.testing.assert_allclose(list_angles_deg(motion), np.degrees([[1.0, 0.1, -0.2]] * 50), atol=1e-6)


def test_the_nose_points_along_the_way_and_a_plumb_hangs():
    motion = EVERY["way points"].at(np.linspace(20.0, 200.0, 1000))
    forward = motion.velocity_ecef_m_s / list_speeds(motion)[:, np.newaxis]
    np.testing.assert_allclose(motion.attitude[:, :, 0], forward, atol=1e-9)
    up = rot_enu_ecef(*geodetic_from_ecef(motion.position_ecef_m)[:2])[:, 2]
    aside = np.einsum("ni,ni->n", motion.attitude[:, :, 1], motion.acceleration_ecef_m_s2 + 9.80665 * up)
    assert np.abs(aside).max() < 1e-5
    assert np.abs(list_angles_deg(motion)[:, 2]).max() > 10.0  # it did bank


def test_without_bank_and_pitch_the_body_stays_level():
    level = list_angles_deg(EVERY["way points, level nose"].at(np.linspace(0.0, 240.0, 500)))
    assert np.abs(level[:, 1]).max() < 1e-5
    assert np.abs(level[:, 2]).max() > 10.0
    unbanked = list_angles_deg(EVERY["way points straight in space, no bank"].at(np.linspace(0.0, 240.0, 500)))
    assert np.abs(unbanked[:, 2]).max() < 1e-5
    assert unbanked[:, 1].max() == pytest.approx(np.degrees(np.arctan(20 / 400)), abs=0.01)


# --- way points


def test_a_way_begins_and_ends_at_rest_at_its_ends():
    way = make_way_points(WAY, 15.0, start_s=3.0)
    end_s = 3.0 + way.curve.duration_s
    motion = way.at([0.0, 3.0, end_s, end_s + 60.0])
    np.testing.assert_allclose(motion.position_ecef_m, WAY[[0, 0, -1, -1]], atol=1e-7)
    np.testing.assert_allclose(list_speeds(motion), 0.0, atol=1e-12)
    assert list_speeds(way.at([3.5, end_s - 0.5])).min() > 1e-4
    np.testing.assert_allclose(list_angles_deg(motion)[[0, 3], 0], [90.0, 0.0573], atol=0.01)  # as the way leads there


def test_a_way_in_motion_comes_in_and_goes_on_straight():
    way = make_way_points(WAY, 15.0, from_rest=False, to_rest=False, start_s=3.0, level=False)
    motion = way.at([1.0, 3.0, 3.0 + way.curve.duration_s, 13.0 + way.curve.duration_s])
    np.testing.assert_allclose(list_speeds(motion), 15.0, atol=1e-12)
    last = (WAY[-1] - WAY[-2]) / np.linalg.norm(WAY[-1] - WAY[-2])
    np.testing.assert_allclose(convert_enu(motion.position_ecef_m[0]), [-30.0, 0.0, 0.0], atol=1e-7)
    np.testing.assert_allclose(motion.position_ecef_m[1:3], WAY[[0, -1]], atol=1e-7)
    np.testing.assert_allclose(motion.position_ecef_m[3], WAY[-1] + 150.0 * last, atol=1e-7)


def test_speed_and_accelerations_are_those_asked_for():
    way = make_way_points(WAY, 15.0, acceleration_m_s2=1.5, lateral_m_s2=2.5, level=False)
    motion = way.at(np.linspace(0.0, way.curve.duration_s, 20_001))
    along, across = np.einsum("ni,nij->jn", motion.acceleration_ecef_m_s2, split_motion(motion))
    assert list_speeds(motion).max() == pytest.approx(15.0, abs=1e-12)
    assert np.abs(along).max() == pytest.approx(1.5, rel=1e-5)
    assert np.abs(across).max() == pytest.approx(2.5, rel=1e-9)


def split_motion(motion):
    """Split a turn in a nearly level plane into parts along the way and across it, (n, 3, 2)."""
    forward = motion.attitude[:, :, 0]
    along = np.einsum("ni,ni->n", motion.acceleration_ecef_m_s2, forward)
    pull = motion.acceleration_ecef_m_s2 - along[:, np.newaxis] * forward
    length = np.linalg.norm(pull, axis=1, keepdims=True)
    return np.stack([forward, pull / np.where(length > 0.0, length, 1.0)], axis=-1)


def test_a_turn_holds_its_radius_between_smooth_ends():
    corner = ecef_from_enu([[0, 0, 0], [0, 1000, 0], [1000, 1000, 0]], HOME)
    way = make_way_points(corner, 20.0, radius_m=100.0, turn_in_s=1.5, from_rest=False, to_rest=False, level=False)
    motion = way.at(np.linspace(0.0, way.curve.duration_s, 20_001))
    across = np.linalg.norm(motion.acceleration_ecef_m_s2, axis=1)
    held = across > 4.0 - 1e-9
    assert held.sum() * way.curve.duration_s / 20_000 == pytest.approx((100.0 * np.pi / 2 - 30.0) / 20.0, abs=0.02)
    assert across[~held].max() < 4.0
    east_m, north_m, _ = convert_enu(motion.position_ecef_m).T
    np.testing.assert_allclose(east_m, 1000.0 - north_m[::-1], atol=1e-6)  # symmetric, and both legs are met
    np.testing.assert_allclose(north_m, 1000.0 - east_m[::-1], atol=1e-6)


def test_a_level_way_keeps_its_height_and_a_straight_one_not():
    lat_deg, lon_deg = np.array([40.0, 40.5, 40.4]), np.array([-3.0, -3.1, -2.5])
    points = ecef_from_geodetic(np.radians(lat_deg), np.radians(lon_deg), np.full(3, 700.0))
    t_s = np.linspace(0.0, 900.0, 2001)
    heights = [
        geodetic_from_ecef(make_way_points(points, 120.0, level=level).at(t_s).position_ecef_m)[2]
        for level in (True, False)
    ]
    assert np.abs(heights[0] - 700.0).max() < 3e-3
    assert heights[1].min() < 700.0 - 50.0
    motion = make_way_points(points, 120.0, from_rest=False, to_rest=False).at(t_s)
    assert np.abs(list_speeds(motion) / 120.0 - 1.0).max() < 2e-5


@settings(max_examples=40, deadline=None)
@given(
    legs=st.lists(
        st.tuples(st.floats(-150.0, 150.0), st.floats(50.0, 400.0), st.floats(-20.0, 20.0)), min_size=1, max_size=6
    ),
    speed_m_s=st.floats(4.0, 30.0),
    lateral_m_s2=st.floats(0.5, 9.0),
    turn_in_s=st.floats(0.5, 3.0),
    rests=st.tuples(st.booleans(), st.booleans()),
    level=st.booleans(),
)
def test_any_way_is_smooth_and_keeps_its_limits_and_ends(legs, speed_m_s, lateral_m_s2, turn_in_s, rests, level):
    turns_deg, lengths_m, climbs_m = np.array(legs).T
    heading_rad = np.radians(np.cumsum(turns_deg))
    steps = np.stack([lengths_m * np.sin(heading_rad), lengths_m * np.cos(heading_rad), climbs_m], axis=-1)
    points = ecef_from_enu(np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)]), HOME)
    try:
        way = make_way_points(
            points,
            speed_m_s,
            lateral_m_s2=lateral_m_s2,
            turn_in_s=turn_in_s,
            from_rest=rests[0],
            to_rest=rests[1],
            level=level,
        )
    except ScenarioError as error:
        assume("way points" not in str(error) and "speed_m_s" not in str(error))
        raise
    t_s = np.linspace(0.0, way.curve.duration_s, int(8.0 * way.curve.duration_s / turn_in_s))
    motion = way.at(t_s)
    np.testing.assert_allclose(motion.position_ecef_m[[0, -1]], points[[0, -1]], atol=1e-6)
    gone_m = motion.position_ecef_m[1:] - motion.position_ecef_m[0]
    assert np.abs(integrate(way, t_s, "velocity_ecef_m_s") - gone_m).max() < 1e-5
    assert list_speeds(motion).max() < speed_m_s * (1.0 + 2e-4)
    assert np.linalg.norm(motion.acceleration_ecef_m_s2, axis=1).max() < 1.001 * np.hypot(lateral_m_s2, 2.0)
    assert np.isfinite(motion.angular_acceleration_body_rad_s2).all()


@pytest.mark.parametrize(
    ("points", "more", "words"),
    [
        ([[0, 0, 0]], {}, r"\b1 given, .*\b2 or more"),
        ([[0, 0, 0], [0, 0, 0], [9, 9, 9]], {}, r"way points\[1\]: .*\bsame\b"),
        ([[0, 0, 0], [0, 500, 0], [0, 1, 0]], {}, r"way points\[1\]: .*\b180\.0 degrees"),
        ([[0, 0, 0], [0, 500, 0], [30, 500, 0]], {}, r"way points\[1\] to \[2\]: 30\.0 m\b"),
        ([[0, 0, 0], [0, 50, 0]], {}, r"\b109\.4 m, .*\b50\.0 m\b"),
        ([[0, 0, 0], [0, np.nan, 0]], {}, r"way points\[1\]: .*\bnumber"),
        ([[0, 0, 0], [0, 4e5, 0]], {}, r"way points\[\d\]: 200 km\b"),
        ([[0, 0, 0], [0, 10, 500]], {}, r"\b89 degrees, .*\bheading, pitch"),
        (WAY, {"speed_m_s": 0.0}, "speed_m_s 0: "),
        (WAY, {"speed_m_s": np.nan}, "speed_m_s nan: "),
        (WAY, {"acceleration_m_s2": -1.0}, "acceleration_m_s2 -1: "),
        (WAY, {"lateral_m_s2": 0.0}, r"lateral_m_s2 0: expected"),
        (WAY, {"radius_m": 0.999}, r"radius_m 0\.999: .*\b10 m/s .*\b100 m/s\^2"),
    ],
)
def test_an_impossible_way_is_refused_with_place_and_remedy(points, more, words):
    if len(points) != len(WAY):
        points = ecef_from_enu(np.array(points, float), HOME)
    with pytest.raises(ScenarioError, match=words):
        make_way_points(points, **({"speed_m_s": 10.0} | more))


# --- circle and approach


@pytest.mark.parametrize("clockwise", [True, False])
def test_a_circle_is_the_closed_form(clockwise):
    t_s, sign = np.linspace(-50.0, 300.0, 200), 1.0 if clockwise else -1.0
    motion = make_circle(HOME, 80.0, 12.0, clockwise=clockwise, start_rad=0.5).at(t_s)
    azimuth_rad = 0.5 + sign * 12.0 / 80.0 * t_s
    out = np.stack([np.sin(azimuth_rad), np.cos(azimuth_rad), np.zeros(200)], axis=-1)
    np.testing.assert_allclose(convert_enu(motion.position_ecef_m), 80.0 * out, atol=1e-8)
    ahead = sign * np.stack([out[:, 1], -out[:, 0], np.zeros(200)], axis=-1)
    np.testing.assert_allclose(motion.velocity_ecef_m_s @ ROT_ENU.T, 12.0 * ahead, atol=1e-12)
    np.testing.assert_allclose(motion.acceleration_ecef_m_s2 @ ROT_ENU.T, -144.0 / 80.0 * out, atol=1e-12)
    bank_deg = np.degrees(np.arctan(144.0 / 80.0 / 9.80665))
    np.testing.assert_allclose(list_angles_deg(motion)[:, 2], sign * bank_deg, atol=1e-2)  # up turns by 80 m / 6400 km
    assert np.linalg.norm(motion.angular_rate_body_rad_s, axis=1) == pytest.approx(12.0 / 80.0, rel=1e-4)


@pytest.mark.parametrize(
    ("radius_m", "speed_m_s", "words"),
    [
        (0.0, 5.0, "radius_m 0: "),
        (5.0, 0.0, "speed_m_s 0: "),
        (5.0, 60.0, r"radius_m 5: .*\b60 m/s .*\b720 m/s\^2, .*\b100; .*\b36\.0 m"),
    ],
)
def test_a_circle_that_cannot_be_is_refused(radius_m, speed_m_s, words):
    with pytest.raises(ScenarioError, match=words):
        make_circle(HOME, radius_m, speed_m_s)


def test_the_approach_is_the_published_one():
    ends = make_las_vegas().at([0.0, 233.0])
    lat_rad, lon_rad, height_m = geodetic_from_ecef(ends.position_ecef_m)
    assert np.degrees([lat_rad[0], lon_rad[0]]) == pytest.approx([35.939, -115.2447], abs=1e-10)
    assert height_m[0] / 0.3048 == pytest.approx(5100.0, abs=1e-6)
    np.testing.assert_allclose(list_speeds(ends), 140 * 1852 / 3600, rtol=1e-12)
    threshold = ecef_from_geodetic(np.radians(36.075463), np.radians(-115.166788), 2230 * 0.3048)
    crossed_s = np.linalg.norm(threshold - ends.position_ecef_m[0]) / (140 * 1852 / 3600)
    assert crossed_s == pytest.approx(232.1, abs=0.1)
    np.testing.assert_allclose(make_las_vegas().at([crossed_s]).position_ecef_m[0], threshold, atol=1e-7)
    assert list_angles_deg(ends)[0] == pytest.approx([24.9, -3.0, 0.0], abs=0.1)
    assert geodetic_from_ecef(make_las_vegas().at([90.0]).position_ecef_m[0])[2] < 4000 * 0.3048


def test_the_false_approach_leads_off_by_100_m_up_east():
    t_s = np.array([0.0, 88.9, 90.0, 140.0, 190.0, 191.1, 233.0])
    true, false = (trajectory.at(t_s).position_ecef_m for trajectory in (make_las_vegas(), make_las_vegas_false()))
    rot = rot_enu_ecef(*geodetic_from_ecef(true[2])[:2])
    off_m = (false - true) @ rot.T
    np.testing.assert_allclose(off_m[[0, 1, 3, 5, 6], 0], np.sqrt(0.5) * np.array([0, 0, 50, 100, 100]), atol=1e-7)
    np.testing.assert_allclose(off_m[:, 1], 0.0, atol=1e-7)
    np.testing.assert_allclose(off_m[:, 2], off_m[:, 0], atol=1e-7)
    assert np.linalg.norm(off_m[[2, 4]], axis=1) == pytest.approx([0.14, 99.86], abs=0.01)  # the blend


def test_a_drift_without_time_is_refused():
    with pytest.raises(ScenarioError, match="from 10 s to 10 s"):
        add_drift(EVERY["static"], [1.0, 0.0, 0.0], 10.0, 10.0)


# --- samples and files


def test_samples_of_a_smooth_motion_give_it_back():
    t_s = np.arange(0.0, 101.0, 0.5)
    truth = make_circle(HOME, 80.0, 12.0)
    found, moments_s = from_samples(t_s, truth.at(t_s).position_ecef_m), np.linspace(5.0, 95.0, 777)
    exact, other = truth.at(moments_s), found.at(moments_s)
    assert np.abs(exact.position_ecef_m - other.position_ecef_m).max() < 1e-5
    assert np.abs(exact.acceleration_ecef_m_s2 - other.acceleration_ecef_m_s2).max() < 1e-4
    assert np.abs(exact.attitude - other.attitude).max() < 1e-5
    assert np.abs(exact.angular_rate_body_rad_s - other.angular_rate_body_rad_s).max() < 1e-4


def test_samples_keep_an_attitude_that_is_given():
    t_s, truth = np.arange(0.0, 60.0, 0.25), EVERY["way points"]
    result = truth.at(t_s)
    found = from_samples(t_s, result.position_ecef_m, attitude=result.attitude)
    np.testing.assert_allclose(found.at(t_s).attitude, result.attitude, atol=1e-12)
    between_s = t_s[8:-8] + 0.1
    exact, other = truth.at(between_s), found.at(between_s)
    assert np.abs(exact.attitude - other.attitude).max() < 2e-4
    assert np.abs(exact.angular_rate_body_rad_s - other.angular_rate_body_rad_s).max() < 1e-2


@pytest.mark.parametrize("n", [2, 3, 4, 5, 6, 7])
def test_few_samples_are_met(n):
    t_s, places = np.arange(float(n)), ecef_from_enu([[3.0 * k, k * k, 0.0] for k in range(n)], HOME)
    motion = from_samples(t_s, places).at(t_s)
    np.testing.assert_allclose(motion.position_ecef_m, places, atol=1e-7)
    assert np.isfinite(motion.angular_acceleration_body_rad_s2).all()


def test_beyond_its_samples_a_body_goes_straight_on():
    found = sample(attitude=Held())
    assert found.span_s == (0.0, 240.0)
    t_s = np.arange(0.0, 101.0)
    moving = from_samples(t_s, make_circle(HOME, 80.0, 12.0).at(t_s).position_ecef_m).at([100.0, 103.0])
    gone_m = moving.position_ecef_m[1] - moving.position_ecef_m[0]
    np.testing.assert_allclose(gone_m, 3.0 * moving.velocity_ecef_m_s[0], atol=1e-8)
    np.testing.assert_array_equal(moving.acceleration_ecef_m_s2[1], 0.0)
    np.testing.assert_array_equal(moving.angular_rate_body_rad_s[1], 0.0)
    np.testing.assert_array_equal(moving.attitude[1], moving.attitude[0])


def test_a_standing_body_turns_smoothly_to_its_next_heading():
    east, north = make_way_points(WAY[:2], 15.0), make_way_points(WAY[1:3], 15.0)
    t_s = np.arange(0.0, 120.0, 0.5)
    first, second = east.at(t_s).position_ecef_m, north.at(t_s).position_ecef_m
    found = from_samples(np.concatenate([t_s, 120.0 + t_s]), np.concatenate([first, second]))
    heading_deg = list_angles_deg(found.at(np.linspace(5.0, 130.0, 2000)))[:, 0]
    turning = np.diff((heading_deg + 180.0) % 360.0)
    assert heading_deg[0] == pytest.approx(90.0, abs=0.01)
    assert (heading_deg[-1] + 180.0) % 360.0 == pytest.approx(180.0, abs=0.1)
    assert np.abs(turning).max() < 0.2  # a degree takes more than 0.3 s


def test_a_standing_body_turns_to_the_nearer_side_over_north():
    # It comes in 10 degrees west of north, stands, and leaves 10 degrees east of north.
    east_m = 500.0 * np.tan(np.radians(10.0))
    t_s = np.arange(0.0, 120.0, 0.5)
    first = make_way_points(ecef_from_enu([[0, 0, 0], [-east_m, 500, 0]], HOME), 15.0).at(t_s).position_ecef_m
    second = make_way_points(ecef_from_enu([[-east_m, 500, 0], [0, 1000, 0]], HOME), 15.0).at(t_s).position_ecef_m
    found = from_samples(np.concatenate([t_s, 120.0 + t_s]), np.concatenate([first, second]))
    heading_deg = (list_angles_deg(found.at(np.linspace(5.0, 150.0, 2000)))[:, 0] + 180.0) % 360.0 - 180.0
    assert heading_deg[[0, -1]] == pytest.approx([-10.0, 10.0], abs=0.1)
    assert np.abs(heading_deg).max() < 11.0


def test_a_body_that_never_moves_heads_north():
    motion = from_samples([0.0, 1.0, 2.0], np.tile(HOME, (3, 1))).at([0.5])
    np.testing.assert_allclose((list_angles_deg(motion) + 180.0) % 360.0, [[180.0] * 3], atol=1e-6)


def test_knots_apart_take_errors_out_of_the_motion():
    t_s, rng = np.arange(0.0, 200.0), np.random.default_rng(3)
    places = make_circle(HOME, 200.0, 12.0).at(t_s).position_ecef_m
    noisy = places + rng.standard_normal(places.shape)
    pull = [
        np.linalg.norm(found.at(t_s[10:-10]).acceleration_ecef_m_s2, axis=1)
        for found in (from_samples(t_s, noisy), from_samples(t_s, noisy, knot_s=20.0))
    ]
    assert np.median(pull[0]) > 5.0
    assert np.median(pull[1]) == pytest.approx(0.72, abs=0.1)


@pytest.mark.parametrize(
    ("t_s", "places", "more", "words"),
    [
        ([0.0], [HOME], {}, r"\b1 given, .*\b2\b"),
        ([0.0, 1.0, 1.0], [HOME] * 3, {}, r"samples\[2\]: .*\b1 s .*\b1 s;"),
        ([0.0, np.nan], [HOME] * 2, {}, r"samples\[1\]: .*\bnumber"),
        ([0.0, 1.0], [HOME] * 3, {}, r"\(2,\) .*\(3, 3\)"),
        ([0.0, 1.0], [HOME] * 2, {"attitude": np.eye(3)}, r"attitude: .*\(3, 3\), .*\(2, 3, 3\)"),
        ([0.0, 1.0], [HOME] * 2, {"knot_s": 5.0}, "knot_s 5: "),
        (np.arange(9.0), [HOME] * 9, {"knot_s": 0.1}, r"knot_s 0\.1: "),
        ([0.0, 1.0], ecef_from_enu([[0, 0, 0], [0, 0, 9]], HOME), {}, "too steep"),
    ],
)
def test_samples_that_make_no_motion_are_refused(t_s, places, more, words):
    with pytest.raises(ScenarioError, match=words):
        from_samples(t_s, np.array(places), **more)


def test_a_files_points_make_a_motion_from_the_time_asked_for():
    t_s = np.arange(0.0, 60.0)
    truth = make_circle(HOME, 80.0, 12.0).at(t_s)
    reported = np.stack(heading_pitch_roll_rad(truth.position_ecef_m, truth.attitude), axis=-1)
    track = RecordedTrack(source="a.csv", position_ecef_m=truth.position_ecef_m, t_s=t_s, attitude_rad=reported)
    found = from_track(track, start_s=10.0)
    assert found.span_s == (10.0, 69.0)
    np.testing.assert_allclose(found.at(10.0 + t_s).position_ecef_m, truth.position_ecef_m, atol=1e-7)
    np.testing.assert_allclose(found.at(10.0 + t_s).attitude, truth.attitude, atol=1e-9)
    with pytest.raises(ScenarioError, match=r"a\.csv: speed_m_s 3: .*\btimes\b"):
        from_track(track, speed_m_s=3.0)


def test_a_file_without_times_is_gone_at_the_speed_asked_for():
    track = RecordedTrack(source="a.kml", position_ecef_m=ecef_from_enu([[0, 100 * k, 0] for k in range(8)], HOME))
    motion = from_track(track, speed_m_s=5.0).at([0.0, 70.0, 140.0])
    np.testing.assert_allclose(convert_enu(motion.position_ecef_m), [[0, 0, 0], [0, 350, 0], [0, 700, 0]], atol=1e-6)
    with pytest.raises(ScenarioError, match=r"a\.kml: speed_m_s: .*\btimes\b"):
        from_track(track)
    twice = RecordedTrack(source="a.kml", position_ecef_m=np.stack([HOME, HOME]))
    with pytest.raises(ScenarioError, match=r"points\[1\]: .*\bsame\b"):
        from_track(twice, speed_m_s=5.0)


# --- points of the body


@pytest.mark.parametrize(
    "lever",
    [
        np.array([2.0, -1.5, -3.0]),
        SpinningArm(
            radius_m=0.5, rate_rad_s=2.0, start_rad=0.3, axis_body=(0.2, -0.1, 2.0), centre_body_m=(1.0, 0, -2.0)
        ),
    ],
    ids=["fixed", "spinning"],
)
def test_an_antennas_velocity_is_that_of_its_place(lever):
    def antenna(t_s):
        return compute_antenna_motion(
            EVERY["way points"].at(t_s), lever.at(t_s) if isinstance(lever, SpinningArm) else lever
        )

    t_s, half_s = np.linspace(1.0, 239.0, 5000), 1e-3
    before, now, after = (antenna(t_s + shift_s) for shift_s in (-half_s, 0.0, half_s))
    velocity = (after.position_ecef_m - before.position_ecef_m) / (2.0 * half_s)
    assert np.abs(velocity - now.velocity_ecef_m_s).max() < 5e-6
    acceleration = (after.velocity_ecef_m_s - before.velocity_ecef_m_s) / (2.0 * half_s)
    assert np.abs(acceleration - now.acceleration_ecef_m_s2).max() < 2e-5


def test_a_lever_stands_in_body_axes():
    body = make_static(HOME, heading_rad=np.pi / 2).at([0.0, 1.0])
    antenna = compute_antenna_motion(body, [2.0, 1.0, -3.0])
    np.testing.assert_allclose(convert_enu(antenna.position_ecef_m), [[2.0, -1.0, 3.0]] * 2, atol=1e-8)


def test_a_spinning_arm_turns_clockwise_once_a_period():
    arm = SpinningArm(radius_m=0.5, rate_rad_s=np.pi / 2, centre_body_m=(0.0, 0.0, -1.0))
    lever = arm.at([0.0, 1.0, 2.0, 4.0])
    places = [[0.5, 0, -1], [0, 0.5, -1], [-0.5, 0, -1], [0.5, 0, -1]]
    np.testing.assert_allclose(lever.offset_body_m, places, atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(lever.velocity_body_m_s, axis=1), 0.25 * np.pi)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"axis_body": (0.0, 0.0, 0.0)}, r"axis_body .*: .*\bdirection"),
        ({"radius_m": 0.0}, "radius_m 0: expected"),
        ({"rate_rad_s": np.inf}, "rate_rad_s inf: "),
    ],
)
def test_an_arm_that_cannot_be_is_refused(more, words):
    with pytest.raises(ScenarioError, match=words):
        SpinningArm(**({"radius_m": 0.5, "rate_rad_s": 1.0} | more))


def test_a_place_that_is_none_is_refused():
    with pytest.raises(ScenarioError, match=r"position_ecef_m: \[1\.0, 2\.0\], .*\bthree\b"):
        make_static([1.0, 2.0])
