from dataclasses import replace

import numpy as np
import pytest
from tests.navigation import sky

from skyproof.navigation.rates import fill_dopplers
from skyproof.records import CellStatus


def drop_rows(o, rows=slice(None)):
    doppler_hz = o.doppler_hz.copy()
    doppler_hz[rows] = np.nan
    return replace(o, doppler_hz=doppler_hz, doppler_sigma_hz=np.where(np.isnan(doppler_hz), np.nan, 0.1))


@pytest.fixture
def seen():
    """Make nine epochs of a sky whose Dopplers are right; those at the ends of a scene are one-sided."""

    def make(step_s):
        nav, position = sky.make_navigation(), sky.place(59.0, 17.0, 100.0)
        skies = [(sky.list_visible(nav, position), position, 0.0)]
        return sky.make_scene(nav, skies, n=11, drift=1e-6, step_s=step_s).observations.select(slice(1, -1))

    return make


@pytest.mark.parametrize(("step_s", "within_hz"), [(0.05, 0.05), (1.0, 0.05), (30.0, 0.1)])
def test_a_missing_doppler_is_the_slope_of_the_phase(seen, step_s, within_hz):
    o = seen(step_s)
    found, derived = fill_dopplers(drop_rows(o))
    assert derived.all()
    np.testing.assert_allclose(found.doppler_hz, o.doppler_hz, atol=within_hz)
    assert np.isfinite(found.doppler_sigma_hz).all()
    assert (found.doppler_sigma_hz > 0.0).all()


def test_a_doppler_that_is_there_stays(seen):
    o = seen(1.0)
    found, derived = fill_dopplers(drop_rows(o, np.array([3])))
    assert derived.mean() == pytest.approx(1.0 / 9.0)
    kept = np.arange(9) != 3
    np.testing.assert_array_equal(found.doppler_hz[kept], o.doppler_hz[kept])
    same, derived = fill_dopplers(o)
    assert same is o
    assert not derived.any()


def test_a_phase_is_not_followed_over_a_slip_or_a_gap(seen):
    o = drop_rows(seen(1.0))
    status, carrier_cyc = o.status.copy(), o.carrier_cyc.copy()
    status[5, 0] = CellStatus.SLIP
    carrier_cyc[5:, 0] += 1e5
    carrier_cyc[2, 1] = np.nan
    found, _ = fill_dopplers(replace(o, status=status, carrier_cyc=carrier_cyc))
    np.testing.assert_allclose(found.doppler_hz[:, 0], seen(1.0).doppler_hz[:, 0], atol=0.05)
    assert np.isnan(found.doppler_hz[:3, 1]).all()  # an arc of two epochs, and the hole
    assert np.isfinite(found.doppler_hz[3:, 1]).all()
