"""Positions by code and broadcast orbits from real receivers, against the truths in the data's README.

The bounds are those of the method, not of these files: broadcast ionosphere leaves some metres in daylight (a north
error of 3 m at the afternoon of solar maximum in mosaic-1m), so 95 % of horizontal errors below 4.5 m and of vertical
ones below 5 m. `bench/position.py` has the figures themselves, beside an independent program's.
"""

import numpy as np
import pytest

from skyproof.formats.rinex_nav import read_nav
from skyproof.formats.rinex_obs_read import read_obs
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.navigation.fix import fix
from skyproof.studies.code_signals import select_code_signals
from skyproof.studies.position_filter import FilterSettings, step

pytestmark = pytest.mark.shared_data

STATIONS = {
    "base": ("rinex-mosaic-1m/base.obs", "rinex-mosaic-1m/base.nav", (-3817681.121, 3562839.431, 3650159.159)),
    "rover": ("rinex-mosaic-1m/rover.obs", "rinex-mosaic-1m/base.nav", (-3817681.381, 3562839.979, 3650158.376)),
    "3034": (
        "rinex-mosaic-5km/3034265G.21O",
        "rinex-mosaic-5km/SEPT2650.21P",
        (-3959400.631, 3385704.533, 3667523.111),
    ),
    "0759": ("rinex-gsi-3km/07590920.05o", "rinex-gsi-3km/07590920.05n", (-3976219.508, 3382372.567, 3652512.985)),
    "3040": ("rinex-gsi-3km/30400920.05o", "rinex-gsi-3km/30400920.05n", (-3978241.958, 3382840.234, 3649900.853)),
}


def read_station(shared_data, name, systems):
    observations, navigation, truth = STATIONS[name]
    seen = read_obs(shared_data / "real" / observations).observations
    signals = tuple(s for s in select_code_signals(seen) if s.sat[0] in systems)
    assert {s.sat[0] for s in signals} == set(systems)
    return seen, read_nav(shared_data / "real" / navigation), signals, np.array(truth)


def find_errors_enu_m(position, truth):
    lat, lon, _ = geodetic_from_ecef(truth)
    return (position - truth) @ rot_enu_ecef(lat, lon).T


# All systems of the longest two take half a minute each; test_two_receivers_a_metre_apart keeps watch over them.
CASES = [
    ("base", "G"),
    pytest.param("base", "GERC", marks=pytest.mark.long),
    pytest.param("rover", "GERC", marks=pytest.mark.long),
    ("3034", "G"),
    ("3034", "GE"),
    ("0759", "G"),
    ("3040", "G"),
]


@pytest.mark.parametrize("how", ["fix", "static"])
@pytest.mark.parametrize(("name", "systems"), CASES)
def test_a_station_is_found_in_metres_and_within_its_sigma(shared_data, name, systems, how):
    seen, nav, signals, truth = read_station(shared_data, name, systems)
    if how == "fix":
        found = fix(seen, nav, signals=signals, elevation_mask_deg=10.0)
    else:
        settings = FilterSettings(mode="static", elevation_mask_deg=10.0)
        found = step(None, seen, nav, settings=settings, signals=signals)[0].fix
    assert (found.status == 0).all()
    error = find_errors_enu_m(found.position_ecef_m, truth)
    assert np.quantile(np.hypot(error[:, 0], error[:, 1]), 0.95) < 4.5
    assert np.quantile(np.abs(error[:, 2]), 0.95) < 5.0
    off = found.position_ecef_m - truth
    squared = np.einsum("ni,nij,nj->n", off, np.linalg.inv(found.covariance_m2[:, :3, :3]), off)
    # Errors of five minutes are one draw, so its size is all that can be asked: chi-square of 3 at one in a thousand.
    assert np.median(squared) < 16.3


def test_two_receivers_a_metre_apart_are_found_a_metre_apart(shared_data):
    places = []
    for name in ("base", "rover"):
        seen, nav, signals, truth = read_station(shared_data, name, "GERC")
        places.append(find_errors_enu_m(fix(seen, nav, signals=signals).position_ecef_m, truth))
    apart = np.median(places[1] - places[0], axis=0)  # orbits and atmosphere are the same
    assert np.abs(apart[:2]).max() < 0.5
    assert abs(apart[2]) < 1.0


def test_more_systems_do_not_worsen_the_station(shared_data):
    seen, nav, signals, truth = read_station(shared_data, "base", "GERC")
    every = fix(seen, nav, signals=signals, elevation_mask_deg=10.0)
    alone = fix(seen, nav, signals=tuple(s for s in signals if s.sat[0] == "G"), elevation_mask_deg=10.0)
    norms = [np.median(np.linalg.norm(f.position_ecef_m - truth, axis=1)) for f in (every, alone)]
    assert norms[0] < norms[1]
    for scale in "ERC":
        offset_m = 299792458.0 * every.inter_system_s[scale]
        assert np.abs(np.median(offset_m)) < 60.0  # 200 ns
        assert np.std(offset_m) < 0.6


def test_a_car_that_comes_back_is_found_at_its_old_place(shared_data):
    seen = read_obs(shared_data / "real" / "rinex-mosaic-5km/SEPT265G.21O").observations
    nav = read_nav(shared_data / "real" / "rinex-mosaic-5km/SEPT2650.21P")
    signals = tuple(s for s in select_code_signals(seen) if s.sat[0] in "GE")
    found, _ = step(None, seen, nav, settings=FilterSettings(elevation_mask_deg=10.0), signals=signals)
    place, speed = found.fix.position_ecef_m, np.linalg.norm(found.fix.velocity_ecef_m_s, axis=1)
    assert (found.fix.status == 0).all()
    # The README: at rest for the first 40 s and the last 45 s, else rounds of 130 m by 40 m.
    assert np.median(speed[15:38]) < 0.15
    assert np.median(speed[-40:]) < 0.15
    assert speed[60:300].max() > 3.0
    first = find_errors_enu_m(place, place[20])
    assert 100.0 < np.ptp(first[:, 0]) < 160.0
    assert 25.0 < np.ptp(first[:, 1]) < 60.0
