"""What is known of each receiver, by settings and platform file, that says which of two skies is true."""

from pathlib import Path

import numpy as np
import pytest
from tests.app.kit import PLACES

from skyproof.app.common.body import BodyFiles
from skyproof.app.common.platform import Platform
from skyproof.app.common.platform_use import derive_settings, match_tables
from skyproof.app.protect.predictors import build_predictors, build_unit
from skyproof.formats.imu import ImuFile
from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.navigation.inertial_predictor import Inertial
from skyproof.navigation.predictor import Standing

START = np.datetime64("2024-05-14T10:00:00", "ns")
PLACE = {"lat_deg": PLACES[0].lat_deg, "lon_deg": PLACES[0].lon_deg, "height_m": 52.0, "sigma_m": 0.5}
READINGS = ImuFile(
    source="imu.csv",
    time_ns=np.arange(1, 11) * 10_000_000,
    dated=False,
    interval_s=0.01,
    specific_force_m_s2=np.tile([0.0, 0.0, -9.81], (10, 1)),
    angular_rate_rad_s=np.zeros((10, 3)),
)


def make_predictors(names=("a",), **tables):
    imu = {"imu": {"file": Path("imu.csv"), "lever_arm_m": [1.0, 0.0, -2.0], "grade": "tactical"}}
    platform = Platform.model_validate(tables | (imu if tables.pop("with_imu", False) else {}))
    own = match_tables(platform, names)
    settings, _ = derive_settings(platform, platform.protect, names, own)
    unit = build_unit(platform, BodyFiles(imu=READINGS), names, own, START)
    return build_predictors(names, settings, platform, own, unit)


def test_nothing_is_predicted_for_a_receiver_without_statements():
    assert make_predictors() == {}
    assert make_predictors(motion="moving") == {}
    assert make_predictors(motion="moving", receivers=[{"position": PLACE}]) == {}


@pytest.mark.parametrize(
    ("tables", "by"),
    [
        ({"motion": "static"}, ("standing",)),
        ({"motion": "static", "oscillator": "ocxo"}, ("standing", "clock")),
        ({"oscillator": "ocxo"}, ("clock",)),
        ({"receivers": [{"position": PLACE}]}, ("surveyed_place",)),
        ({"with_imu": True, "motion": "static"}, ("standing",)),
        ({"with_imu": True}, ("inertial_unit",)),
        ({"with_imu": True, "motion": "moving", "oscillator": "csac"}, ("inertial_unit", "clock")),
        ({"with_imu": True, "motion": "moving", "receivers": [{"position": PLACE}]}, ("inertial_unit",)),
    ],
)
def test_what_says_most_is_taken_and_stands_in_the_words(tables, by):
    (predictor,) = make_predictors(**tables).values()
    assert predictor.by == by
    assert isinstance(predictor, Inertial if "inertial_unit" in by else Standing)
    assert len(predictor.assumes) == len(by)


def test_a_surveyed_place_is_expected_from_the_first_moment_on():
    (predictor,) = make_predictors(receivers=[{"position": PLACE}]).values()
    place = ecef_from_geodetic(np.radians(PLACE["lat_deg"]), np.radians(PLACE["lon_deg"]), 52.0)
    expected = predictor.at(START)
    assert expected.mean[:3] == pytest.approx(place)
    assert expected.covariance[:3, :3] == pytest.approx(0.25 * np.eye(3))


def test_the_unit_does_not_carry_an_antenna_of_unknown_arm():
    bodies = [{"name": "a", "body_m": [5.0, 0.0, 0.0]}, {"name": "b", "body_m": [2.0, 1.0, 0.0]}, {"name": "c"}]
    found = make_predictors(("a", "b", "c"), receivers=bodies, with_imu=True)
    arms_m = {name: list(value.settings.lever_m) for name, value in found.items()}
    assert arms_m == {"a": [1.0, 0.0, -2.0], "b": [-2.0, 1.0, -2.0]}
    assert found["a"].readings.gpst[0] == START + np.timedelta64(10, "ms")
