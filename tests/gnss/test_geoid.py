"""The geoid's height against values that the makers of EGM96 published, and across the edges of the grid."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyproof.gnss.geoid import interpolate_geoid_m

# The test points of NGA's program F477 for EGM96 to degree 360 (INPUT.DAT, OUTPUT.DAT): latitude, longitude, metres.
PUBLISHED = [
    (38.6281550, 269.7791550, -31.628),
    (-14.6212170, 305.0211140, -2.969),
    (46.8743190, 102.4487290, -43.575),
    (-23.6174460, 133.8747120, 15.871),
    (38.6254730, 359.9995000, 50.066),
    (-0.4667440, 0.0023000, 17.329),
]


def test_the_grid_gives_the_published_values_to_what_it_states() -> None:
    lat_deg, lon_deg, metres = np.array(PUBLISHED).T
    off_m = interpolate_geoid_m(lat_deg, lon_deg) - metres
    assert np.abs(off_m).max() < 1.6
    assert np.sqrt(np.mean(off_m**2)) < 0.8


@given(st.floats(-90.0, 90.0), st.floats(-540.0, 540.0))
def test_it_is_known_everywhere_and_the_same_after_a_turn(lat_deg: float, lon_deg: float) -> None:
    metres = float(interpolate_geoid_m(lat_deg, lon_deg))
    assert -107.0 <= metres <= 86.0
    assert metres == pytest.approx(float(interpolate_geoid_m(lat_deg, lon_deg + 360.0)), abs=1e-6)


def test_it_is_steady_across_greenwich_and_the_date_line() -> None:
    lon_deg = np.array([-1e-9, 1e-9, 180.0 - 1e-9, -180.0 + 1e-9])
    for lat_deg in (-90.0, -37.3, 0.0, 59.4, 90.0):
        west, east, near, far = interpolate_geoid_m(lat_deg, lon_deg)
        assert west == pytest.approx(east, abs=1e-6)
        assert near == pytest.approx(far, abs=1e-6)


def test_shapes_broadcast_and_what_is_unknown_stays_so() -> None:
    metres = interpolate_geoid_m(np.array([[0.0], [np.nan]]), np.array([10.0, np.inf, 20.0]))
    assert np.isfinite(metres).tolist() == [[True, False, True], [False, False, False]]
