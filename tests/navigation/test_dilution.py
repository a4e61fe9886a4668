"""HDOP against its definition."""

from dataclasses import replace

import numpy as np
import pytest
from tests.navigation import sky

from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.navigation.dilution import compute_horizontal_dilution
from skyproof.navigation.fix import fix


@pytest.mark.parametrize("where", [(59.0, 17.0, 100.0), (-41.3, 174.8, 12.0)])
def test_it_is_the_horizontal_sigma_of_unit_ranges(where):
    nav, position = sky.make_navigation(), sky.place(*where)
    seen = sky.make_scene(nav, [(sky.list_visible(nav, position), position, 2e-3)], n=12).observations
    pseudorange_m = seen.pseudorange_m.copy()
    pseudorange_m[4:, 0] = np.nan  # another geometry from here on
    pseudorange_m[9, 3:] = np.nan  # and no fix
    seen = replace(seen, pseudorange_m=pseudorange_m, pseudorange_sigma_m=np.ones_like(pseudorange_m))
    found = fix(seen, nav, multipath_sigma_m=0.0, ionosphere_share=0.0)
    lat_rad, lon_rad, _ = geodetic_from_ecef(position)
    rot_enu = rot_enu_ecef(lat_rad, lon_rad)
    east_m2, north_m2, _ = np.diagonal(rot_enu @ found.covariance_m2[:, :3, :3] @ rot_enu.T, axis1=1, axis2=2).T
    hdop = compute_horizontal_dilution(found, nav)
    assert np.isfinite(hdop).tolist() == [row != 9 for row in range(12)]
    np.testing.assert_allclose(hdop, np.sqrt(east_m2 + north_m2), rtol=1e-4)
    assert hdop[4] > hdop[3]
