"""Antennas whose places in a body are known stand in each window as the body is turned."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.detectors.multi_receiver.detector import MultiReceiver
from skyproof.detectors.multi_receiver.settings import MultiReceiverSettings
from skyproof.gnss.frames import attitude_ecef, ecef_from_geodetic
from skyproof.records import NavState
from skyproof.testing import FalseSky, MeasuredScene, TrackErrors

HEADING_RAD = np.radians(30.0)
APART_M = 20.0
BODY_M = {"rx1": np.zeros(3), "rx2": np.array([APART_M, 0.0, 0.0])}  # forward
PLACES = {"rx1": (0.0, 0.0, 0.0), "rx2": (APART_M * np.sin(HEADING_RAD), APART_M * np.cos(HEADING_RAD), 0.0)}
SETTINGS = MultiReceiverSettings(false_alarm_probability=1e-6, antenna_distance_m=APART_M, antennas_body_sigma_m=0.05)
BESIDE = (APART_M * np.cos(HEADING_RAD), -APART_M * np.sin(HEADING_RAD), 0.0)
"""As far from rx1, to its right."""


def build_scene(captured):
    """Two receivers under the sky; a captured second one receives a place as far from the first as it is."""
    sky = FalseSky(antenna_enu_m=(300.0, 200.0, 10.0), shows_enu_m=BESIDE, delay_m=0.0, receivers=("rx2",))
    return MeasuredScene(
        antennas_enu_m=PLACES,
        sky=("rx1",) if captured else None,
        false=(sky,) if captured else (),
        epochs=12,
        errors=TrackErrors(0.5),
        max_satellites=10,
    )


def turn_records(captured, *, sigma_rad=0.002, turned_rad=0.0, wrong_rad=0.0):
    """Records in which the body's attitude is known, and wrong by so much; the body turns by so much in the window."""
    scene = build_scene(captured)
    records = scene.records(np.random.default_rng(5))
    lat_deg, lon_deg, height_m = scene.place_deg
    place_m = np.tile(ecef_from_geodetic(np.radians(lat_deg), np.radians(lon_deg), height_m), (3, 1))
    headings_rad = HEADING_RAD + wrong_rad + turned_rad * np.array([-0.5, 0.0, 0.5])
    covariance = np.diag(np.repeat([np.inf, np.inf, sigma_rad**2], 3))
    span = records.end_gpst - records.start_gpst
    state = NavState(
        gpst=records.start_gpst + span // 2 * np.arange(3),
        position_ecef_m=place_m,
        velocity_ecef_m_s=np.zeros((3, 3)),
        attitude=attitude_ecef(place_m, headings_rad, np.zeros(3), np.zeros(3)),
        covariance=np.tile(covariance, (3, 1, 1)),
    )
    return replace(records, nav_state=dict.fromkeys(PLACES, state))


def examine_turned(captured, *, antennas_body_m=None, **how):
    """The receivers whose signals are authentic, and the settings of the window."""
    records = turn_records(captured, **how)
    settings = replace(SETTINGS, antennas_body_m=antennas_body_m)
    found, _ = MultiReceiver(settings).examine(records)
    return {ref.receiver for e in found if e.says == "authentic" for ref in e.signals}, settings.place_antennas(records)


def test_a_false_sky_as_far_off_is_told_by_the_attitude():
    known = {"antennas_body_m": BODY_M}
    assert examine_turned(False, **known)[0] == set(PLACES)
    assert examine_turned(True)[0] == set(PLACES)  # by their distance alone
    assert examine_turned(True, **known)[0] == set()


@pytest.mark.parametrize("captured", [False, True])
def test_an_attitude_that_was_right_may_become_wrong(captured):
    # Another window bears the places out; but signals as far apart as the antennas leave the attitude open.
    detector = MultiReceiver(replace(SETTINGS, antennas_body_m=BODY_M))
    first, state = detector.examine(turn_records(False))
    later, _ = detector.examine(turn_records(captured, wrong_rad=0.0 if captured else np.pi / 2.0), state)
    assert "authentic" in {e.says for e in detector.review(first)}
    seen = list(detector.review([*first, *later]))[len(first) :]
    assert {e.says for e in seen} == {"undecided"}
    assert {cause.code for e in seen for cause in e.wrong_statements} == {"attitude_or_axes"}


def test_places_turn_with_the_body():
    _, placed = examine_turned(False, antennas_body_m=BODY_M)
    np.testing.assert_allclose(placed.antennas_enu_m["rx2"], PLACES["rx2"], atol=1e-9)
    assert placed.antennas_sigma_m == pytest.approx(np.hypot(0.05, 0.002 * APART_M))


@pytest.mark.parametrize("how", [{"sigma_rad": 0.1}, {"turned_rad": 0.5}], ids=["attitude", "turn"])
def test_places_that_are_vague_leave_the_distance(how):
    _, placed = examine_turned(False, antennas_body_m=BODY_M, **how)
    assert placed.antennas_enu_m is None
    _, placed = examine_turned(False, antennas_body_m=BODY_M, **{name: 0.1 * value for name, value in how.items()})
    assert placed.antennas_enu_m is not None
