"""One position and a clock for each kind of signal, from files of real receivers and one mixed navigation file."""

import numpy as np
import pytest

from skyproof.formats.rinex_nav import get_glonass_channels, read_nav
from skyproof.formats.rinex_obs_read import read_obs
from skyproof.navigation.sets import find_consistent_sets

pytestmark = [pytest.mark.shared_data, pytest.mark.long]

FILES = {
    "base": ("rinex-mosaic-1m/base.obs", "rinex-mosaic-1m/base.nav", "GECR", (-3817681.121, 3562839.431, 3650159.159)),
    "rover": (
        "rinex-mosaic-1m/rover.obs",
        "rinex-mosaic-1m/base.nav",
        "GECR",
        (-3817681.381, 3562839.979, 3650158.376),
    ),
    "3034": (
        "rinex-mosaic-5km/3034265G.21O",
        "rinex-mosaic-5km/SEPT2650.21P",
        "GE",
        (-3959400.631, 3385704.533, 3667523.111),
    ),
    "0759": ("rinex-gsi-3km/07590920.05o", "rinex-gsi-3km/07590920.05n", "G", (-3976219.508, 3382372.567, 3652512.985)),
}


@pytest.mark.parametrize("name", FILES)
def test_all_kinds_of_a_clean_sky_are_one_set_at_the_place(shared_data, name):
    observations, orbits, systems, truth = FILES[name]
    navigation = read_nav(shared_data / "real" / orbits)
    path = shared_data / "real" / observations
    o = read_obs(path, glonass_channels=get_glonass_channels(navigation)).observations
    for first in (0, o.gpst.size // 2):
        window = o.select(slice(first, first + 10))
        (found,) = find_consistent_sets(window, navigation)
        assert {kind[0] for kind in found.offsets_s} == set(systems)
        assert np.linalg.norm(found.position_ecef_m - truth) < 15.0
        # Ways through a receiver, time scales and the means of satellites' delays together.
        assert max(abs(offset_s) for offset_s in found.offsets_s.values()) < 100e-9
        measured = np.isfinite(window.pseudorange_m).mean(axis=0) >= 0.5
        assert len(found.signals) >= 0.85 * measured.sum()
