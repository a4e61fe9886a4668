from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from tests.navigation import sky

from skyproof.formats.rinex_nav import read_nav
from skyproof.navigation import fix as fix_module
from skyproof.navigation.fix import fix
from skyproof.records import SignalId


@pytest.mark.parametrize("bias_s", [0.0, 0.0213, -0.93, 1.0])
@pytest.mark.parametrize("where", [(59.0, 17.0, 100.0), (-33.0, 151.0, -20.0), (0.0, 180.0, 12000.0)])
def test_without_noise_the_fix_is_right_to_a_millimetre(bias_s, where):
    nav, position = sky.make_navigation(), sky.place(*where)
    seen = sky.make_scene(nav, [(sky.list_visible(nav, position), position, bias_s)], n=20, drift=3e-7).observations
    found = fix(seen, nav)
    assert (found.status == 0).all()
    np.testing.assert_allclose(found.position_ecef_m, np.tile(position, (20, 1)), atol=1e-3)
    np.testing.assert_allclose(found.clock_bias_s, bias_s + 3e-7 * np.arange(20), atol=1e-3 / sky.C)
    error_ns = (found.gpst - (seen.gpst - np.rint(found.clock_bias_s * 1e9).astype("timedelta64[ns]"))).astype(int)
    np.testing.assert_array_equal(error_ns, 0)
    inner = slice(1, -1)  # the generator's Doppler is a central difference
    np.testing.assert_allclose(found.velocity_ecef_m_s[inner], 0.0, atol=2e-4)
    np.testing.assert_allclose(found.clock_drift[inner], 3e-7, atol=1e-12)
    assert np.nanmax(np.abs(found.residual_m)) < 1e-3


def test_a_moving_receiver_has_its_velocity():
    nav, position = sky.make_navigation(), sky.place(48.0, 11.0, 9000.0)
    velocity = np.array([120.0, -180.0, 90.0])
    path = position + np.arange(9)[:, None] * velocity
    seen = sky.make_scene(nav, [(sky.list_visible(nav, position), path, 5e-3)], n=9).observations
    found = fix(seen, nav)
    np.testing.assert_allclose(found.position_ecef_m, path, atol=1e-3)
    np.testing.assert_allclose(found.velocity_ecef_m_s[1:-1], np.tile(velocity, (7, 1)), atol=2e-4)


def test_errors_are_as_large_as_the_covariance_says():
    rng = np.random.default_rng(100)
    nav, position = sky.make_navigation(), sky.place(59.0, 17.0, 100.0)
    sats = sky.list_visible(nav, position)
    seen = sky.make_scene(nav, [(sats, position, 2e-4)], n=3000, step_s=0.1).observations
    elevation = np.stack([sky.measure(nav, s, seen.gpst, position, 0.0).elevation_rad for s in sats], axis=1)
    thermal = rng.uniform(0.5, 4.0, seen.pseudorange_m.shape)
    sigma = np.hypot(thermal, 0.7 / np.sin(elevation))
    noise = sigma * rng.standard_normal(sigma.shape)
    seen = replace(seen, pseudorange_m=seen.pseudorange_m + noise, pseudorange_sigma_m=thermal)
    found = fix(seen, nav, multipath_sigma_m=0.7, ionosphere_share=0.0)
    error = np.concatenate((found.position_ecef_m - position, (found.clock_bias_s[:, None] - 2e-4) * sky.C), axis=1)
    squared = np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.covariance_m2), error)
    assert stats.kstest(squared, stats.chi2(4).cdf).pvalue > 1e-3
    residual = np.nansum((found.residual_m / sigma) ** 2, axis=1)
    assert stats.kstest(residual, stats.chi2(len(sats) - 4).cdf).pvalue > 1e-3


def test_bad_epochs_have_a_status_and_good_ones_stay_good():
    nav, position = sky.make_navigation(), sky.place(59.0, 17.0, 100.0)
    seen = sky.make_scene(nav, [(sky.list_visible(nav, position), position, 0.0)], n=6, noise_m=1.0).observations
    pseudorange = seen.pseudorange_m.copy()
    pseudorange[1, 3:] = np.nan
    pseudorange[2] = np.nan
    pseudorange[4, ::2] += 3e8 * np.arange(pseudorange[4, ::2].size)  # fits no place near the Earth
    found = fix(replace(seen, pseudorange_m=pseudorange), nav)
    assert found.status[[0, 3, 5]].tolist() == [0, 0, 0]
    assert found.status[[1, 2]].tolist() == [1, 1]
    assert found.status[4] != 0
    bad = [1, 2, 4]
    for numbers in (
        found.position_ecef_m,
        found.velocity_ecef_m_s,
        found.clock_bias_s,
        found.covariance_m2,
        found.residual_m,
    ):
        assert np.isnan(numbers[bad]).all()
    clean = fix(seen, nav)
    np.testing.assert_allclose(found.position_ecef_m[[0, 3, 5]], clean.position_ecef_m[[0, 3, 5]], atol=1e-6)
    assert (fix(seen, nav, max_gdop=1.0).status == 2).all()


def test_low_satellites_are_left_out_and_their_residual_is_nan():
    nav, position = sky.make_navigation(), sky.place(59.0, 17.0, 100.0)
    sats = sky.list_visible(nav, position, 3.0)
    seen = sky.make_scene(nav, [(sats, position, 0.0)], n=2).observations
    elevation = np.array([sky.measure(nav, s, seen.gpst, position, 0.0).elevation_rad[0] for s in sats])
    found = fix(seen, nav, elevation_mask_deg=20.0)
    np.testing.assert_array_equal(np.isfinite(found.residual_m[0]), np.degrees(elevation) >= 20.0)
    assert (np.degrees(elevation) < 20.0).any()


def test_two_signals_of_a_satellite_at_once_are_refused():
    nav, position = sky.make_navigation(), sky.place(59.0, 17.0, 100.0)
    sats = sky.list_visible(nav, position)
    seen = sky.make_scene(nav, [(sats, position, 0.0), (sats[:1], position, 1e-6)], n=4).observations
    with pytest.raises(ValueError, match=rf"\b{sats[0]}\b"):
        fix(seen, nav)
    with pytest.raises(ValueError, match="no signal G32"):
        fix(seen, nav, signals=(SignalId("G32"),))
    chosen = tuple(s for s in seen.signals if s.copy == "a")
    assert (fix(seen, nav, signals=chosen).status == 0).all()
    relay = seen.pseudorange_m.copy()
    a, b = (seen.signals.index(SignalId(sats[0], copy=c)) for c in "ab")
    relay[2:, a], relay[:2, b] = np.nan, np.nan
    relay[2:, b] -= 1e-6 * sky.C
    np.testing.assert_allclose(
        fix(replace(seen, pseudorange_m=relay), nav).position_ecef_m, np.tile(position, (4, 1)), atol=1e-3
    )


def test_blocks_of_epochs_give_what_the_whole_gives(monkeypatch):
    nav, position = sky.make_navigation(), sky.place(59.0, 17.0, 100.0)
    seen = sky.make_scene(nav, [(sky.list_visible(nav, position), position, 0.0)], n=25, noise_m=2.0).observations
    whole = fix(seen, nav)
    monkeypatch.setattr(fix_module, "_BLOCK_EPOCHS", 7)
    pieces = fix(seen, nav)
    np.testing.assert_allclose(pieces.position_ecef_m, whole.position_ecef_m, atol=1e-5)
    np.testing.assert_allclose(pieces.residual_m, whole.residual_m, atol=1e-5)


@pytest.mark.shared_data
@pytest.mark.parametrize("receiver", ["rx1", "rx2"])
@pytest.mark.parametrize("label", ["authentic", "spoofed"])
def test_the_meaconing_pairs_true_signals_give_its_true_places(shared_data, receiver, label):
    seen, clock_s, truth = sky.read_meaconing_pair(shared_data, receiver)
    found = fix(
        seen,
        read_nav(shared_data / "rf" / "brdc0010.22n"),
        signals=tuple(s for s in seen.signals if s.copy == {"authentic": "a", "spoofed": "b"}[label]),
    )
    place, extra_s = sky.find_shown(truth, receiver, label)
    epochs = np.flatnonzero(np.isfinite(found.clock_bias_s))
    assert epochs.size == {"authentic": 59, "spoofed": 35}[label]
    np.testing.assert_allclose(found.position_ecef_m[epochs], np.tile(place, (epochs.size, 1)), atol=0.02)
    np.testing.assert_allclose(found.clock_bias_s[epochs], clock_s[epochs] + extra_s, atol=0.02 / sky.C)
    np.testing.assert_allclose(found.velocity_ecef_m_s[epochs], 0.0, atol=0.01)
