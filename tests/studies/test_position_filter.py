from dataclasses import fields, replace

import numpy as np
import pytest
from scipy import stats
from tests.navigation import sky

from skyproof.errors import SettingsError
from skyproof.studies.position_filter import FilterSettings, step

STATIC, KINEMATIC = FilterSettings(mode="static"), FilterSettings(mode="kinematic")


def draw_driven(rng, settings, *, n=40, doppler=True, sats=9):
    """Draw observations that follow the filter's own model, with the truth (n, 4) of place and clock."""
    nav, place = sky.make_navigation(), sky.place(48.0, 11.0, 400.0)
    walk = np.linalg.cholesky(np.array([[1 / 3, 1 / 2], [1 / 2, 1.0]]))
    path, velocity = np.zeros((n, 3)), np.zeros(3)
    clock, drift, drifts = np.zeros(n), 30.0, np.full(n, 30.0)
    clock[0] = 2e4
    for i in range(1, n):
        push = walk @ rng.standard_normal((2, 3)) * (settings.mode == "kinematic") * settings.acceleration_m2_s3**0.5
        path[i], velocity = path[i - 1] + velocity + push[0], velocity + push[1]
        shake = walk @ rng.standard_normal(2) * settings.drift_m2_s3**0.5
        clock[i] = clock[i - 1] + drift + shake[0] + settings.clock_m2_s**0.5 * rng.standard_normal()
        drift += shake[1]
        drifts[i] = drift
    names = sky.list_visible(nav, place, 15.0)[:sats]
    made = sky.make_scene(nav, [(names, place + path, clock / sky.C)], n=n).observations
    still = sky.make_scene(nav, [(names, place, 0.0)], n=n).observations
    air = sky.make_scene(nav, [(names, place, 0.0)], n=n, air=False).observations
    truth = [sky.measure(nav, s, made.gpst, place, 0.0) for s in names]
    elevation = np.stack([t.elevation_rad for t in truth], axis=1)
    ionosphere = 0.5 * np.stack([t.pseudorange_m - t.carrier_m for t in truth], axis=1)
    sigma_b = np.hypot(settings.multipath_sigma_m / np.sin(elevation), settings.ionosphere_share * ionosphere)
    fade = np.exp(-1.0 / settings.error_time_s)
    b = sigma_b * rng.standard_normal(sigma_b.shape)
    for i in range(1, n):
        b[i] = fade * b[i - 1] + np.sqrt(1 - fade**2) * sigma_b[i - 1] * rng.standard_normal(len(names))
    wander = np.cumsum(settings.ambiguity_m2_s**0.5 * rng.standard_normal(b.shape), axis=0)
    code_noise, rate_noise = 0.8, 0.03
    carrier_noise = settings.carrier_sigma_m / np.sin(elevation) * rng.standard_normal(b.shape)
    rate = -still.doppler_hz * sky.WAVELENGTH + drifts[:, None]
    spread = np.hypot(rate_noise, settings.range_rate_sigma_m_s)
    seen = replace(
        made,
        pseudorange_m=made.pseudorange_m + b + code_noise * rng.standard_normal(b.shape),
        pseudorange_sigma_m=np.full(b.shape, code_noise),
        carrier_cyc=made.carrier_cyc + (wander + carrier_noise) / sky.WAVELENGTH,
        doppler_hz=-(rate + spread * rng.standard_normal(b.shape)) / sky.WAVELENGTH if doppler else np.nan * b,
        doppler_sigma_hz=np.full(b.shape, rate_noise / sky.WAVELENGTH),
    )
    assert air.signals == seen.signals
    return seen, nav, np.column_stack((place + path, clock))


def find_errors(found, truth):
    return np.column_stack((found.fix.position_ecef_m, sky.C * found.fix.clock_bias_s)) - truth


@pytest.mark.parametrize(
    ("settings", "doppler"),
    [(STATIC, True), pytest.param(KINEMATIC, False, marks=pytest.mark.long)],
    ids=["static", "kinematic"],
)
def test_errors_and_innovations_are_as_large_as_the_filter_says(settings, doppler):
    rng = np.random.default_rng(11)
    trials, nees, nis, dof = 30, [], 0.0, 0
    for _ in range(trials):
        seen, nav, truth = draw_driven(rng, settings, doppler=doppler)
        found, _ = step(None, seen, nav, settings=replace(settings, false_alarm_probability=1e-9))
        error = find_errors(found, truth)[-1]
        nees.append(error @ np.linalg.solve(found.fix.covariance_m2[-1], error))
        inner = slice(2, -1)  # the generator's Doppler at the ends is a difference to one side
        nis, dof = nis + found.nis[inner].sum(), dof + int(found.nis_dof[inner].sum())
    # Trials share the sky but no noise.
    low, high = stats.chi2(4 * trials).ppf([5e-4, 1 - 5e-4])
    assert low < np.sum(nees) < high, np.mean(nees)
    low, high = stats.chi2(dof).ppf([5e-4, 1 - 5e-4])
    assert low < nis < high, nis / dof


def clean(*, n=60, noise_m=0.5, seed=5, sats=10, **scene):
    nav, place = sky.make_navigation(), sky.place(59.0, 17.0, 100.0)
    names = sky.list_visible(nav, place, 10.0)[:sats]
    rng = np.random.default_rng(seed)
    seen = sky.make_scene(nav, [(names, place, 1e-4)], n=n, noise_m=noise_m, rng=rng, **scene).observations
    return seen, nav, place


def cut(observations, rows):
    names = {f.name for f in fields(observations)} - {
        "receiver",
        "signals",
        "found_elapsed_s",
        "missed_elapsed_s",
        "carrier_hz",
        "averaged_s",
    }
    return replace(observations, **{name: getattr(observations, name)[rows] for name in names})


@pytest.mark.parametrize("at", [1, 17, 40])
def test_pieces_give_what_the_whole_gives(at):
    seen, nav, _ = clean()
    code, status = seen.pseudorange_m.copy(), seen.status.copy()
    code[:15, 2], code[15:20, 3] = np.nan, np.nan
    status[30, 1] = 3
    seen = replace(seen, pseudorange_m=code, status=status)
    whole, end = step(None, seen, nav)
    first, state = step(None, cut(seen, slice(None, at)), nav)
    second, again = step(state, cut(seen, slice(at, None)), nav)
    for name in ("position_ecef_m", "velocity_ecef_m_s", "clock_bias_s", "covariance_m2", "residual_m", "status"):
        pieces = np.concatenate((getattr(first.fix, name), getattr(second.fix, name)))
        np.testing.assert_allclose(pieces, getattr(whole.fix, name), rtol=1e-7, atol=1e-6)
    assert end.signals == again.signals
    np.testing.assert_allclose(again.mean, end.mean, rtol=1e-12, atol=1e-5)


def test_at_rest_the_filter_beats_the_fix_and_stands_still():
    seen, nav, place = clean(n=120, noise_m=3.0)
    found, _ = step(None, seen, nav, settings=STATIC)
    error = np.linalg.norm(found.fix.position_ecef_m - place, axis=1)
    assert error[-1] < 1.5
    np.testing.assert_array_equal(found.fix.velocity_ecef_m_s, 0.0)
    assert np.linalg.norm(np.diff(found.fix.position_ecef_m[60:], axis=0), axis=1).max() < 0.3


def test_the_carrier_is_as_early_as_the_code_is_late():
    # Over an hour the model's ionosphere changes by metres; ambiguities that may not walk must not notice.
    seen, nav, place = clean(n=60, noise_m=0.0, sats=7, step_s=60.0, start=sky.START - np.timedelta64(30, "m"))
    fixed = replace(STATIC, ambiguity_m2_s=1e-9, elevation_mask_deg=0.0)
    found, _ = step(None, replace(seen, doppler_hz=np.full_like(seen.doppler_hz, np.nan)), nav, settings=fixed)
    assert not found.slipped.any()
    assert np.linalg.norm(found.fix.position_ecef_m - place, axis=1).max() < 0.02


def test_lasting_errors_do_not_average_out_without_a_carrier():
    seen, nav, _ = clean(n=60)
    code_only = replace(
        seen, carrier_cyc=np.full_like(seen.carrier_cyc, np.nan), doppler_hz=np.full_like(seen.doppler_hz, np.nan)
    )
    found, _ = step(None, code_only, nav, settings=STATIC)
    sigma = np.sqrt(np.trace(found.fix.covariance_m2[:, :3, :3], axis1=1, axis2=2))
    assert sigma[-1] > 0.7 * sigma[0]  # a tenth of the time after which they are others


def test_a_moving_receiver_has_its_path_and_velocity():
    nav, place = sky.make_navigation(), sky.place(48.0, 11.0, 200.0)
    angle = np.arange(90) * 0.1
    path = place + 150.0 * np.column_stack((np.cos(angle), np.sin(angle), 0.0 * angle))
    seen = sky.make_scene(nav, [(sky.list_visible(nav, place, 10.0), path, 2e-4)], n=90, noise_m=0.3).observations
    velocity = 15.0 * np.column_stack((-np.sin(angle), np.cos(angle), 0.0 * angle))
    found, _ = step(None, replace(seen, doppler_hz=np.full_like(seen.doppler_hz, np.nan)), nav)
    assert np.linalg.norm(found.fix.position_ecef_m - path, axis=1)[10:].max() < 1.0
    assert np.linalg.norm(found.fix.velocity_ecef_m_s - velocity, axis=1)[10:].max() < 1.5


@pytest.mark.parametrize("reported", [True, False])
def test_a_slip_costs_an_arc_and_not_the_position(reported):
    seen, nav, place = clean()
    carrier, status = seen.carrier_cyc.copy(), seen.status.copy()
    carrier[30:, 4] += 7.0
    status[30, 4] = 3 if reported else 0
    found, _ = step(None, replace(seen, carrier_cyc=carrier, status=status), nav)
    plain, _ = step(None, seen, nav)
    assert found.slipped.sum() == (0 if reported else 1)
    assert found.slipped[30, 4] == (not reported)
    moved = np.linalg.norm(found.fix.position_ecef_m - plain.fix.position_ecef_m, axis=1)
    assert moved.max() < 0.3
    assert np.linalg.norm(found.fix.position_ecef_m[-1] - place) < 2.0


def test_a_code_that_does_not_fit_is_left_out_and_reported():
    seen, nav, _ = clean()
    code = seen.pseudorange_m.copy()
    code[25, 3] += 60.0
    found, _ = step(None, replace(seen, pseudorange_m=code), nav)
    assert found.rejected[25, 3]
    assert found.rejected.sum() == 1
    assert np.isnan(found.fix.residual_m[25, 3])


def test_a_clock_moved_by_a_millisecond_moves_the_clock_only():
    seen, nav, _ = clean()
    code, gpst = seen.pseudorange_m.copy(), seen.gpst.copy()
    code[30:] += 1e-3 * sky.C
    gpst[30:] += np.timedelta64(1, "ms")
    plain, _ = step(None, seen, nav)
    found, _ = step(None, replace(seen, pseudorange_m=code, gpst=gpst), nav)  # its carriers have not followed
    np.testing.assert_allclose(found.fix.clock_bias_s[30:] - plain.fix.clock_bias_s[30:], 1e-3, atol=1e-8)
    assert np.linalg.norm(found.fix.position_ecef_m - plain.fix.position_ecef_m, axis=1).max() < 1.0
    assert not found.rejected.any()


def test_the_filter_runs_through_epochs_without_measurements():
    seen, nav, place = clean()
    code = seen.pseudorange_m.copy()
    code[:3, 3:] = np.nan  # no fix yet
    code[20:26] = np.nan
    code[40:44, 2:] = np.nan  # two satellites hold it for a while
    found, _ = step(None, replace(seen, pseudorange_m=code), nav)
    assert (found.fix.status == 1).nonzero()[0].tolist() == [0, 1, 2, 20, 21, 22, 23, 24, 25]
    assert np.isnan(found.fix.position_ecef_m[20:26]).all()
    assert np.linalg.norm(found.fix.position_ecef_m[[19, 26, 43, 44]] - place, axis=1).max() < 3.0
    sigma = np.sqrt(np.trace(found.fix.covariance_m2[:, :3, :3], axis1=1, axis2=2))
    assert sigma[43] > sigma[39] > sigma[50] * 0.5
    empty, state = step(None, cut(seen, slice(0, 0)), nav)
    assert state is None
    assert empty.fix.gpst.size == 0


def test_what_makes_no_sense_is_refused():
    seen, nav, _ = clean(n=6)
    _, state = step(None, seen, nav)
    with pytest.raises(ValueError, match=r"\border\b"):
        step(state, seen, nav)
    with pytest.raises(SettingsError, match="'static' or 'kinematic'"):
        FilterSettings(mode="flying")
