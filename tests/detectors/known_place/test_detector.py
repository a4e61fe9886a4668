"""Few satellites against the place where a receiver stands."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.detectors.known_place.detector import CodesAtPlace, CodesAtPlaceSettings
from skyproof.navigation.fix import fix_and_geometry
from skyproof.records import Records
from skyproof.testing import MeasuredScene, TrackErrors

RATE = 1e-7
SCENE = MeasuredScene(
    antennas_enu_m={"rx1": (0.0, 0.0, 0.0)}, epochs=20, errors=TrackErrors(sigma_m=1.0, constant_m=1.0)
)


def make_windows(seed: int, *, alone: int, shift_m=(0.0, 0.0, 0.0), one_m: float = 0.0) -> list[Records]:
    """Return a clean window, and one of so few satellites, others at each epoch, shifted or with one code off."""
    rng = np.random.default_rng(seed)
    drawn = SCENE.records(rng)
    (o,) = drawn.observations
    _, geometry = fix_and_geometry(o, drawn.navigation)
    codes_m = o.pseudorange_m.copy()
    codes_m[10:] += geometry.design[10:, :, :3] @ np.array(shift_m)
    codes_m[10:, 0] += one_m
    for epoch in range(10, 20):
        codes_m[epoch, rng.permutation(codes_m.shape[1])[alone:]] = np.nan
    o = replace(o, pseudorange_m=codes_m)
    first, second = (replace(drawn, observations=(o.read(*rows),)) for rows in ((0, 10), (10, 20)))
    return [first, replace(second, sets=())]


def examine(records: list[Records], **settings):
    detector, state = CodesAtPlace(CodesAtPlaceSettings(false_alarm_probability=RATE, **settings)), None
    for window in records:
        (found,), state = detector.examine(window, state)
    return found


@pytest.mark.parametrize("seed", range(4))
def test_few_satellites_of_a_clean_sky_fit(seed) -> None:
    found = examine(make_windows(seed, alone=4), speed_max_m_s=0.0)
    assert found.says == "clean"
    assert found.p_value > 1e-4


@pytest.mark.parametrize("alone", [3, 5])
def test_a_shift_shows_by_three_satellites(alone) -> None:
    found = examine(make_windows(1, alone=alone, shift_m=(400.0, 300.0, 0.0)), speed_max_m_s=0.0)
    assert found.failed
    assert found.dated_gpst is not None


def test_one_satellite_that_is_off_is_a_fault() -> None:
    assert not examine(make_windows(2, alone=5, one_m=5000.0), speed_max_m_s=0.0).failed


def test_a_surveyed_place_needs_no_window_before() -> None:
    first, second = make_windows(3, alone=4, shift_m=(400.0, 300.0, 0.0))
    (sky,) = first.sets
    assert examine([second], positions_ecef_m={"rx1": sky.position_ecef_m}).failed
    assert not examine([make_windows(3, alone=4)[1]], positions_ecef_m={"rx1": sky.position_ecef_m}).failed


@pytest.mark.parametrize(
    ("settings", "count", "code"),
    [({}, 2, "no_place"), ({"speed_max_m_s": 0.0}, 1, "fixed"), ({"speed_max_m_s": 0.0}, 2, "few_satellites")],
)
def test_why_it_could_not_be_tested_is_said(settings, count, code) -> None:
    alone = 2 if code == "few_satellites" else 4
    assert examine(make_windows(0, alone=alone)[:count], **settings).code == code
