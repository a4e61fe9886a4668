"""Rays to a source of false signals from a receiver that moves, and where they meet."""

import numpy as np
import pytest

from skyproof.app.protect.bearings import ellipse_95, find_bearings
from skyproof.app.protect.positions import Track
from skyproof.detectors.adapter import finding_from_evidence
from skyproof.fusion.labels import FalseSource
from skyproof.gnss.frames import ecef_from_geodetic, geodetic_from_ecef, rot_enu_ecef
from skyproof.records import Direction, Evidence, Fix, FixStatus, SignalId, SignalRef

LAT, LON = np.radians(-33.0), np.radians(151.0)
HERE_M = ecef_from_geodetic(LAT, LON, 30.0)
TURN = rot_enu_ecef(LAT, LON)
TARGET_M = HERE_M + np.array([1200.0, 2500.0, 90.0]) @ TURN
START = np.datetime64("2024-03-03T10:00:00", "ns")
SIGMA_RAD = np.radians(0.5)
REFS = tuple(SignalRef("array", SignalId(sat, copy="b")) for sat in ("G01", "G07", "G12"))
SOURCE = FalseSource(name="S1", signals=REFS, one_antenna=True)


def make_track(speed_m_s, seconds=200):
    """Make a track to the east."""
    gpst = START + np.arange(seconds) * np.timedelta64(1, "s")
    places = HERE_M + np.outer(speed_m_s * np.arange(seconds), TURN[0])
    last = Fix(
        receiver="array",
        signals=(SignalId("G01"),),
        gpst=gpst[-1:],
        position_ecef_m=places[-1:],
        velocity_ecef_m_s=np.zeros((1, 3)),
        clock_bias_s=np.zeros(1),
        clock_drift=np.zeros(1),
        covariance_m2=np.eye(4)[None],
        residual_m=np.zeros((1, 1)),
        status=np.full(1, FixStatus.OK, np.uint8),
    )
    return Track(gpst=gpst, position_ecef_m=places, clock_bias_s=np.zeros(seconds), last=last)


def examine_track(track, rng, *, several=False):
    """Examine a track in windows of ten seconds."""
    directions = []
    for first in range(0, track.gpst.size, 10):
        east, north, up = TURN @ (TARGET_M - track.position_ecef_m[min(first + 5, track.gpst.size - 1)])
        direction = Direction(
            azimuth_rad=float(np.arctan2(east, north) + SIGMA_RAD * rng.standard_normal()) % (2.0 * np.pi),
            elevation_rad=float(np.arctan2(up, np.hypot(east, north)) + SIGMA_RAD * rng.standard_normal()),
            covariance_rad2=SIGMA_RAD**2 * np.eye(2),
            frame="enu",
        )
        directions.append(
            finding_from_evidence(
                Evidence(
                    detector="ins_array",
                    start_gpst=track.gpst[first],
                    end_gpst=track.gpst[first] + np.timedelta64(10, "s"),
                    subject=REFS,
                    says="spoofed",
                    because="signals of 3 satellites come to array from one direction",
                    p_value=1e-9,
                    directions=(direction, direction) if several else (direction,),
                )
            )
        )
    return directions


def test_rays_of_a_receiver_that_moves_meet_at_the_transmitter():
    track = make_track(12.0)
    (bearing,) = find_bearings((SOURCE,), examine_track(track, np.random.default_rng(1)), {"array": track})
    error_m = bearing.meets.position_ecef_m - TARGET_M
    assert error_m @ np.linalg.solve(bearing.meets.covariance_m2, error_m) < 11.3  # 1 % of three degrees
    major_m, minor_m, azimuth_deg = ellipse_95(bearing.meets)
    assert 20.0 < minor_m < major_m < 2000.0
    assert azimuth_deg == pytest.approx(180.0, abs=40.0) or azimuth_deg == pytest.approx(0.0, abs=40.0)
    ring = bearing.ring()
    away_m = np.linalg.norm(ring - bearing.meets.position_ecef_m, axis=1)
    assert (away_m.max(), away_m.min()) == (pytest.approx(major_m, rel=0.02), pytest.approx(minor_m, rel=0.02))
    ((_, line, wedge),) = bearing.draw()
    lat, lon, _ = geodetic_from_ecef(line[0])
    east, north, up = rot_enu_ecef(lat, lon) @ (line[1] - line[0])
    assert np.arctan2(east, north) % (2.0 * np.pi) == pytest.approx(bearing.last["array"].azimuth_rad, abs=1e-9)
    assert abs(up) < 1e-6
    np.testing.assert_array_equal(wedge[0], wedge[-1])


def test_a_receiver_that_stands_has_a_ray_and_no_place():
    track = make_track(0.0)
    (bearing,) = find_bearings((SOURCE,), examine_track(track, np.random.default_rng(2)), {"array": track})
    assert bearing.meets is None
    assert bearing.ring() is None
    assert list(bearing.last) == ["array"]


def test_open_directions_and_places_without_trust_have_no_ray():
    track = make_track(12.0)
    rng = np.random.default_rng(3)
    assert list(find_bearings((SOURCE,), examine_track(track, rng, several=True), {"array": track})) == []
    assert list(find_bearings((SOURCE,), examine_track(track, rng), {})) == []
