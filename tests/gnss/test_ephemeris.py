from dataclasses import replace

import numpy as np

from skyproof.gnss.ephemeris import NavigationData
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.time import gpst

EPHEMERIS = make_nominal_constellation(gpst(2190, 0.0)).ephemerides[4]


def test_the_ephemeris_nearest_in_time_is_the_best_one():
    sets = tuple(replace(EPHEMERIS, toe=toe) for toe in (7200.0, 0.0, 14400.0))
    navigation = NavigationData(ephemerides=(*sets, replace(EPHEMERIS, sat="G06", toe=3600.0)))
    assert navigation.best("G05", gpst(2190, 3599.0)) is sets[1]
    assert navigation.best("G05", gpst(2190, 3601.0)) is sets[0]
    assert navigation.best("G07", gpst(2190, 3600.0)) is None
    assert navigation.best("G05", gpst(2190, 30000.0)) is None
    assert navigation.best("G05", gpst(2190, 30000.0), max_age_s=20000.0) is sets[2]
    assert navigation.best("G05", gpst(2189, 604800.0 - 60.0)) is sets[1]
    assert navigation.best("G05", gpst(2190 + 1024, 0.0)) is None
    assert navigation.remarks == ()
    assert isinstance(EPHEMERIS.toe, float)
    assert np.isnan(EPHEMERIS.transmission_tow)
