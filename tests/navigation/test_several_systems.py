"""Several time scales in one fix: simulated, with orbits of GPS's form under other systems' names."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from tests.navigation import sky

from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.navigation.fix import fix, fix_and_geometry
from skyproof.navigation.protection import compute_protection_levels
from skyproof.navigation.raim import check_residuals, count_unknowns, exclude_one, exclude_several
from skyproof.navigation.ranges import compute_space_sigma_m, list_time_scales
from skyproof.records import SignalId
from skyproof.studies.position_filter import FilterSettings, step

NAMES = {"G": ("L1", "CA"), "E": ("E1", "C"), "C": ("B1C", "1P"), "J": ("L1", "CA")}
LATE_S = {"G": 0.0, "J": 0.0, "E": -35e-9, "C": 210e-9}


def make_sky(shares, *, bias_s=3e-4, n=6, **scene):
    """Make observations in which each system has its share of the visible satellites and its own lateness."""
    nav, place = sky.make_navigation(), sky.place(48.0, 11.0, 500.0)
    names = sky.list_visible(nav, place)
    of, rest = {}, list(names)
    for system, count in shares.items():
        of |= {name: system + name[1:] for name in rest[:count]}
        rest = rest[count:]
    message = {"E": "INAV", "C": "D1"}
    nav = replace(
        nav,
        ephemerides=tuple(
            replace(e, sat=of[e.sat], tgd=0.0, tgd2=0.0, message=message.get(of[e.sat][0], "LNAV"))
            for e in nav.ephemerides
            if e.sat in of
        ),
    )
    skies = [([s for s in of.values() if s[0] == k], place, bias_s + LATE_S[k]) for k in shares]
    seen = sky.make_scene(nav, skies, n=n, **scene).observations
    signals = tuple(SignalId(s.sat, *NAMES[s.sat[0]]) for s in seen.signals)
    return replace(seen, signals=signals), nav, place


@pytest.mark.parametrize("shares", [{"G": 4, "E": 3, "C": 2}, {"G": 1, "E": 6}, {"E": 4, "C": 3}, {"G": 4, "J": 4}])
def test_each_time_scale_has_its_clock_at_the_right_place(shares):
    seen, nav, place = make_sky(shares)
    found = fix(seen, nav)
    assert (found.status == 0).all()
    np.testing.assert_allclose(found.position_ecef_m, np.tile(place, (6, 1)), atol=1e-3)
    scales = [k for k in "GEC" if k in shares]
    first = LATE_S[scales[0]]
    np.testing.assert_allclose(found.clock_bias_s, 3e-4 + first, atol=1e-3 / sky.C)
    assert list(found.inter_system_s) == scales
    for scale in scales:
        np.testing.assert_allclose(found.inter_system_s[scale], LATE_S[scale] - first, atol=1e-3 / sky.C)
    np.testing.assert_allclose(found.velocity_ecef_m_s[1:-1], 0.0, atol=1e-3)


def test_a_system_away_for_some_epochs_costs_nothing():
    seen, nav, place = make_sky({"G": 4, "E": 5})
    code = seen.pseudorange_m.copy()
    gps = np.array([s.sat[0] == "G" for s in seen.signals])
    code[np.ix_([1], ~gps)], code[np.ix_([2], gps)] = np.nan, np.nan
    code[3, np.flatnonzero(gps)[:3]], code[3, np.flatnonzero(~gps)[:2]] = np.nan, np.nan  # 4 satellites, 5 unknowns
    found = fix(replace(seen, pseudorange_m=code), nav)
    assert found.status.tolist() == [0, 0, 0, 1, 0, 0]
    np.testing.assert_allclose(found.position_ecef_m[[0, 1, 2, 4]], np.tile(place, (4, 1)), atol=1e-3)
    np.testing.assert_array_equal(np.isnan(found.inter_system_s["E"]), [False, True, False, True, False, False])
    np.testing.assert_array_equal(np.isnan(found.inter_system_s["G"]), [False, False, True, True, False, False])
    np.testing.assert_allclose(found.clock_bias_s[2], 3e-4 + LATE_S["E"], atol=1e-3 / sky.C)


def test_errors_with_three_clocks_match_the_covariance():
    rng = np.random.default_rng(4)
    seen, nav, place = make_sky({"G": 4, "E": 3, "C": 2}, n=2000, step_s=0.1)
    quiet, _ = fix_and_geometry(seen, nav, ionosphere_share=0.0)
    _, geometry = fix_and_geometry(seen, nav, ionosphere_share=0.0)
    noise = geometry.sigma_m * rng.standard_normal(geometry.sigma_m.shape)
    found, geometry = fix_and_geometry(
        replace(seen, pseudorange_m=seen.pseudorange_m + np.nan_to_num(noise)), nav, ionosphere_share=0.0
    )
    error = np.column_stack((found.position_ecef_m - place, sky.C * (found.clock_bias_s - quiet.clock_bias_s)))
    squared = np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.covariance_m2), error)
    assert stats.kstest(squared, stats.chi2(4).cdf).pvalue > 1e-3
    unknowns = count_unknowns(geometry.design, np.isfinite(geometry.sigma_m))
    assert (unknowns == 6).all()
    tested = check_residuals(geometry.misfit_m, geometry.sigma_m, false_alarm_probability=0.02, unknowns=unknowns)
    assert stats.kstest(tested.p_value, "uniform").pvalue > 1e-3
    assert stats.binomtest(int((~tested.consistent).sum()), 2000, 0.02).pvalue > 1e-3


def test_faults_go_in_any_system_but_a_lone_satellite_stays():
    rng = np.random.default_rng(6)
    seen, nav, place = make_sky({"G": 4, "E": 4, "C": 1}, noise_m=0.3, rng=rng)
    code = seen.pseudorange_m.copy()
    galileo = [i for i, s in enumerate(seen.signals) if s.sat[0] == "E"]
    alone = next(i for i, s in enumerate(seen.signals) if s.sat[0] == "C")
    code[:, galileo[1]] += 80.0
    code[:, alone] += 500.0
    spoiled = replace(seen, pseudorange_m=code)
    plain, geometry = fix_and_geometry(spoiled, nav)
    found = exclude_one(geometry.design, geometry.misfit_m, geometry.sigma_m, false_alarm_probability=1e-4)
    assert (found.excluded == galileo[1]).all()
    assert (found.test.dof == 9 - 1 - 6).all()
    cured = fix(spoiled, nav, false_alarm_probability=1e-4)
    assert np.isnan(cured.residual_m[:, galileo[1]]).all()
    assert np.isfinite(cured.residual_m[:, alone]).all()
    error_m = np.linalg.norm(cured.position_ecef_m - place, axis=1)
    assert error_m.max() < 5.0
    assert np.linalg.norm(plain.position_ecef_m - place, axis=1).min() > error_m.max()
    np.testing.assert_allclose(cured.inter_system_s["C"] - LATE_S["C"], 500.0 / sky.C, atol=10.0 / sky.C)


def test_several_faults_go_one_by_one_and_only_if_it_helps():
    rng = np.random.default_rng(8)
    unit = rng.standard_normal((50, 14, 3))
    unit[..., 2] = np.abs(unit[..., 2]) + 0.2
    unit /= np.linalg.norm(unit, axis=-1, keepdims=True)
    design = np.concatenate((-unit, np.ones((50, 14, 1))), axis=-1)
    misfit, sigma = rng.standard_normal((50, 14)), np.ones((50, 14))
    two = misfit.copy()
    two[:, 3] += 60.0
    two[:, 9] -= 45.0
    excluded, test = exclude_several(design, two, sigma, false_alarm_probability=1e-5)
    exact = excluded[:, [3, 9]].all(axis=1) & (excluded.sum(axis=1) == 2)
    assert exact.mean() > 0.9
    assert test.consistent[exact].all()
    hopeless = misfit + 200.0 * rng.standard_normal((50, 14))
    assert not exclude_several(design, hopeless, sigma, false_alarm_probability=1e-5)[0].any()


def test_real_geometry_has_finite_levels_without_the_lone_one():
    seen, nav, place = make_sky({"G": 5, "E": 3, "C": 1}, noise_m=0.5)
    _, geometry = fix_and_geometry(seen, nav)
    lat, lon, _ = geodetic_from_ecef(place)
    levels = compute_protection_levels(geometry.design, geometry.misfit_m, geometry.sigma_m, rot_enu_ecef(lat, lon))
    assert np.isfinite(levels.horizontal_m).all()
    assert (levels.vertical_m > 0.0).all()
    assert not levels.alarm.any()


def test_the_filter_takes_in_a_late_and_distant_system():
    seen, nav, place = make_sky({"G": 5, "E": 4}, n=40, noise_m=0.4)
    galileo = np.array([s.sat[0] == "E" for s in seen.signals])
    code = seen.pseudorange_m.copy()
    code[:20, galileo] = np.nan
    code[:, galileo] += 3000.0  # a receiver's own delay of 10 us
    found, state = step(None, replace(seen, pseudorange_m=code), nav, settings=FilterSettings(mode="static"))
    assert state.scales == ("G", "E")
    assert np.isnan(found.fix.inter_system_s["E"][:20]).all()
    np.testing.assert_allclose(found.fix.inter_system_s["E"][-1] - LATE_S["E"], 3000.0 / sky.C, atol=2.0 / sky.C)
    assert np.linalg.norm(found.fix.position_ecef_m - place, axis=1)[5:].max() < 4.0
    assert found.rejected.sum() == 0


def test_scales_and_their_errors_are_as_documented():
    scales, clocks = list_time_scales(tuple(SignalId(s) for s in ("R01", "J02", "E03", "G04")))
    assert scales == ("G", "E", "R")
    np.testing.assert_array_equal(clocks, [[0, 0, 1], [1, 0, 0], [0, 1, 0], [1, 0, 0]])
    np.testing.assert_allclose(
        compute_space_sigma_m(tuple(SignalId(s) for s in ("G01", "E01", "C01", "R01"))), [0.0, 0.0, 0.8, np.sqrt(3.64)]
    )
