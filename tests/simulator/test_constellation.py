"""Which satellites a scene has, and that given directions are where the satellites stand."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from skyproof.errors import InputError, ScenarioError
from skyproof.formats.rinex_nav import write_nav
from skyproof.gnss.ephemeris import Ephemeris
from skyproof.gnss.lnav import quantise
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.orbit_faults import find_orbit_fault
from skyproof.simulator.constellation import make_navigation
from skyproof.simulator.scenario import Scenario, parse_scenario
from skyproof.simulator.sky import make_scene

DIRECTIONS = [("G02", 274.0, 21.0), ("G32", 168.0, 57.0), ("G13", 90.0, 26.0), ("G17", 239.0, 89.0)]


def make_scenario(lat_deg: float = 30.0, *, descending: bool = False, **sky: Any) -> Scenario:
    directions = [{"sat": sat, "az_deg": az, "el_deg": el, "descending": descending} for sat, az, el in DIRECTIONS]
    return parse_scenario(
        {
            "start_gpst": "2020-03-01T06:43:18",
            "duration_s": 10.0,
            "receivers": [{"name": "one", "lat_deg": lat_deg, "lon_deg": -71.0, "height_m": 30.0}],
            "sky": {"directions": directions} | sky,
        }
    )


def test_without_a_word_it_is_the_nominal_constellation() -> None:
    table = make_scenario(directions=None)
    assert make_navigation(table) == make_nominal_constellation(table.start_gpst)


def test_a_navigation_file_is_read(tmp_path: Path) -> None:
    result = make_scenario()
    write_nav(tmp_path / "given.rnx", make_navigation(result))
    reported = make_scenario(directions=None).model_copy(update={"navigation": tmp_path / "given.rnx"})
    assert {eph.sat for eph in make_navigation(reported).ephemerides} == {sat for sat, _, _ in DIRECTIONS}
    first, other = (make_scene(table, make_navigation(table)).skies[0] for table in (result, reported))
    np.testing.assert_allclose(first.delays_s(np.array([3.0])), other.delays_s(np.array([3.0])), rtol=0.0, atol=1e-14)
    absent = reported.model_copy(update={"navigation": tmp_path / "none.rnx"})
    with pytest.raises(InputError, match=r"none\.rnx"):
        make_navigation(absent)


@pytest.mark.parametrize("descending", [False, True])
@pytest.mark.parametrize("lat_deg", [-35.0, 0.0, 30.0])
def test_satellites_stand_where_the_scenario_has_them(lat_deg: float, descending: bool) -> None:
    table = make_scenario(lat_deg, descending=descending)
    sky = make_scene(table, make_navigation(table)).skies[0]
    seen = {heard.id.sat: column for column, heard in enumerate(sky.signals)}
    assert seen.keys() == {sat for sat, _, _ in DIRECTIONS}
    for sat, az_deg, el_deg in DIRECTIONS:
        column = seen[sat]
        az = np.degrees(np.interp(0.0, sky.knots_s, np.unwrap(sky.az_rad[:, column]))) % 360.0
        el = np.degrees(np.interp(0.0, sky.knots_s, sky.el_rad[:, column]))
        # 1e-5 degree: the message holds angles to 8e-8 degree; the knots of elevations are 1 s apart
        assert el == pytest.approx(el_deg, abs=1e-5)
        if el_deg < 80.0:
            assert az == pytest.approx(az_deg, abs=1e-5)


def test_they_move_as_gps_satellites_do() -> None:
    up, down = (make_navigation(make_scenario(descending=descending)).ephemerides for descending in (False, True))
    for first, other in zip(up, down, strict=True):
        assert isinstance(first, Ephemeris)
        assert isinstance(other, Ephemeris)
        assert quantise(first) == first  # a receiver that decodes the message has the same orbit
        assert find_orbit_fault(first) is None
        assert first.m0 != other.m0
    nominal = make_nominal_constellation(make_scenario().start_gpst).ephemerides[0]
    assert isinstance(nominal, Ephemeris)
    assert {eph.sqrt_a for eph in up if isinstance(eph, Ephemeris)} == {nominal.sqrt_a}
    for descending, sign in ((False, 1.0), (True, -1.0)):
        table = make_scenario(descending=descending)
        sky = make_scene(table, make_navigation(table)).skies[0]
        south = [column for column, heard in enumerate(sky.signals) if heard.id.sat == "G32"]
        rate = np.diff(sky.el_rad[:, south[0]]).mean()  # it stands in the south: northward is up
        assert np.sign(rate) == sign


def test_a_direction_where_no_gps_satellite_comes_is_refused() -> None:
    table = make_scenario(60.0, directions=[{"sat": "G01", "az_deg": 0.0, "el_deg": 40.0}])
    with pytest.raises(ScenarioError, match=r"sky\.directions\[0\]: G01 .*\b8\d"):
        make_navigation(table)


@pytest.mark.parametrize(
    ("sky", "words"),
    [
        ({"directions": [{"sat": "G01", "az_deg": 1.0, "el_deg": 40.0}] * 2}, r"sky: directions: .*\btwo places"),
        ({"directions": [{"sat": "G01", "az_deg": 1.0, "el_deg": -4.0}]}, r"sky\.directions\[0\]\.el_deg"),
        ({"directions": [{"sat": "G01", "az_deg": 1.0, "el": 4.0}]}, r"sky\.directions\[0\]\.el: "),
        ({"sats": ["G05"]}, "sky: sats 'G05'"),
    ],
)
def test_mistakes_are_refused_with_their_key(sky: dict[str, Any], words: str) -> None:
    with pytest.raises(ScenarioError, match=words):
        make_scenario(**sky)


def test_directions_and_a_navigation_file_together_are_refused() -> None:
    table = make_scenario().model_dump(mode="json", exclude_none=True) | {"navigation": "brdc.rnx"}
    with pytest.raises(ScenarioError, match=r"sky\.directions .*navigation\b"):
        parse_scenario(table)
