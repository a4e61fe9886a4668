"""The detector of two skies in overlapping signals: an attack that it names, and what it does without grids."""

from dataclasses import replace

import numpy as np
import pytest
from tests.detectors.nulls import CLEAN_CCAF, OVERLAPPED_CCAF, with_ccaf

from skyproof.decomposition.correlation import correlation, noise_variance
from skyproof.decomposition.fit import (
    at_strongest_doppler,
    count_statistic,
    count_test,
    delay_dictionary,
    simulate_taps,
)
from skyproof.detectors.dccaf.detector import Dccaf, DccafSettings, delays_of
from skyproof.errors import SettingsError
from skyproof.gnss.frames import ecef_from_geodetic, rot_enu_ecef
from skyproof.records import NavState


def test_a_sky_shown_two_hundred_metres_off_in_overlapping_signals_is_an_attack():
    rng = np.random.default_rng(2)
    detector = Dccaf(DccafSettings(count_runs=1000))
    told = [detector.examine(with_ccaf(OVERLAPPED_CCAF.records(rng), rng))[0][0] for _ in range(10)]
    assert sum(evidence.says == "attack" for evidence in told) >= 9
    assert any("second position" in evidence.because for evidence in told)


def test_two_delays_come_where_the_count_says_two_and_one_elsewhere():
    rng = np.random.default_rng(3)
    settings = DccafSettings(count_runs=1000)
    one, two = (with_ccaf(scene.records(rng), rng).ccaf[0] for scene in (CLEAN_CCAF, OVERLAPPED_CCAF))
    assert np.isnan(delays_of(one, 0, settings).delay_chips[:, 1]).all()
    found = delays_of(two, 0, settings)
    assert np.isfinite(found.delay_chips[:, 1]).sum() >= 5


def test_missing_grids_cost_their_channel_only():
    rng = np.random.default_rng(4)
    records = with_ccaf(OVERLAPPED_CCAF.records(rng), rng)
    grid = records.ccaf[0]
    value = np.array(grid.value)
    value[:, 0] = np.nan
    less = replace(records, ccaf=(replace(grid, value=value),))
    assert Dccaf(DccafSettings(count_runs=1000)).examine(less)[0][0].says == "attack"
    value[:, :-4] = np.nan
    none = replace(records, ccaf=(replace(grid, value=value),))
    assert Dccaf(DccafSettings(count_runs=1000)).examine(none)[0][0].says == "undecided"


def test_settings_that_make_no_sense_are_refused():
    with pytest.raises(SettingsError, match="second_signal_probability"):
        DccafSettings(second_signal_probability=0.0)


# All bins of a grid

BINS_HZ, COHERENT_S, RATE_HZ = 25.0 * np.arange(-2.0, 3.0), 0.02, 10e6


def grids(trials, doppler_hz, rng, second=0.0):
    """One signal (trials, bins, taps) at a Doppler, and another of that amplitude 0.25 chip behind; the bins' noise is
    correlated."""
    delays, variance = delay_dictionary(RATE_HZ), float(noise_variance(45.0, COHERENT_S, RATE_HZ))
    delay = rng.uniform(-0.3, 0.3, trials)
    turn = np.exp(2j * np.pi * rng.random((trials, 2))) * np.array([1.0, second])
    along = turn[:, :1] * correlation(delays.points - delay[:, None], RATE_HZ)
    along = along + turn[:, 1:] * correlation(delays.points - delay[:, None] - 0.25, RATE_HZ)
    none = np.zeros((trials, BINS_HZ.size, 1))
    noise = simulate_taps(none, none, np.full(none.shape[:2], variance), delays, rng)
    values, vectors = np.linalg.eigh(np.sinc((BINS_HZ[:, None] - BINS_HZ) * COHERENT_S))
    noise = (vectors * np.sqrt(np.maximum(values, 0.0))) @ noise
    return np.sinc((doppler_hz - BINS_HZ) * COHERENT_S)[:, None] * along[:, None, :] + noise, delays, variance


def test_a_reference_off_by_half_a_bin_costs_no_power_where_all_bins_are_used():
    rng = np.random.default_rng(7)
    grid, delays, _ = grids(300, 12.5, rng)
    taps, factor, doppler = at_strongest_doppler(grid, delays, BINS_HZ, COHERENT_S)
    assert np.std(doppler - 12.5) < 1.2  # the bound is 0.62 Hz
    assert abs(np.mean(doppler) - 12.5) < 0.2
    assert factor == pytest.approx(1.0, abs=0.02)
    near = np.abs(delays.points) < 0.35
    energy = np.max(np.abs(taps[:, near]), axis=1).mean()
    assert energy == pytest.approx(0.9935, abs=0.008)  # mean of six seeds, +- 4 sigma; between taps the top is missed
    assert np.max(np.abs(grid[:, 2, near]), axis=1).mean() < 0.95  # the nearest bin alone


def test_a_second_signal_is_counted_as_asked_at_a_doppler_that_was_found():
    rng = np.random.default_rng(8)
    delays = delay_dictionary(RATE_HZ)
    law = count_test(delays, rng, runs=4000)
    for doppler_hz in (0.0, 9.0):
        grid, delays, variance = grids(2500, doppler_hz, rng)
        taps, factor, _ = at_strongest_doppler(grid, delays, BINS_HZ, COHERENT_S)
        p_value = law.p_value(count_statistic(taps, delays, factor * variance)[0])
        for asked in (0.1, 0.02):
            sigma = np.sqrt(asked * (1.0 / 2500 + 1.0 / 4000))
            assert np.mean(p_value < asked) == pytest.approx(asked, abs=3.5 * sigma)
    grid, delays, variance = grids(200, 9.0, rng, second=0.87)
    taps, factor, _ = at_strongest_doppler(grid, delays, BINS_HZ, COHERENT_S)
    assert np.mean(law.p_value(count_statistic(taps, delays, factor * variance)[0]) < 1e-3) > 0.97


def test_a_detector_with_several_bins_sees_what_one_with_the_right_bin_sees():
    rng = np.random.default_rng(9)
    records = with_ccaf(OVERLAPPED_CCAF.records(rng), rng)
    (one,) = records.ccaf
    scale = np.sinc((8.0 - BINS_HZ) * COHERENT_S)[:, None]  # noise of the bins alike: the worst case of a reference
    several = replace(one, dopplers_hz=BINS_HZ, value=one.value * scale)
    found, other = (delays_of(each, 0, DccafSettings(count_runs=1000)) for each in (one, several))
    np.testing.assert_allclose(other.delay_chips, found.delay_chips, atol=0.02)
    beside, share = np.array([-25.0, 25.0]), np.sinc(0.5)  # on both sides of the signal: 0.9 dB are lost
    off = replace(one, dopplers_hz=beside, value=np.repeat(share * one.value, 2, axis=2))
    other = delays_of(off, 0, DccafSettings(count_runs=1000))
    alone = np.isnan(found.delay_chips[:, 1]) & np.isnan(other.delay_chips[:, 1])
    both = ~np.isnan(found.delay_chips[:, 1]) & ~np.isnan(other.delay_chips[:, 1])
    for rows in (alone, both):
        np.testing.assert_allclose(
            other.sigma_chips[rows], found.sigma_chips[rows] / np.sqrt(2.0 * share**2), rtol=0.03
        )


# Which sky is true


def inertial(records, offset_enu_m, sigma_m, rng):
    """With a navigator at an offset from the scene's place, and an error of its own of `sigma_m` an axis."""
    (grid,) = records.ccaf
    lat_deg, lon_deg, height_m = OVERLAPPED_CCAF.place_deg
    geodetic = np.radians(lat_deg), np.radians(lon_deg), height_m
    place = ecef_from_geodetic(*geodetic) + np.asarray(offset_enu_m) @ rot_enu_ecef(*geodetic[:2])
    place = place + sigma_m * rng.standard_normal(3)
    state = NavState(
        gpst=grid.gpst[-1] + np.array([-1, 0, 1]).astype("timedelta64[s]"),
        position_ecef_m=np.tile(place, (3, 1)),
        velocity_ecef_m_s=np.zeros((3, 3)),
        attitude=np.tile(np.eye(3), (3, 1, 1)),
        covariance=np.tile(sigma_m**2 * np.eye(9), (3, 1, 1)),
    )
    return replace(records, nav_state=state)


FALSE_ENU_M = OVERLAPPED_CCAF.false[0].shows_enu_m


@pytest.mark.parametrize(("offset_enu_m", "says"), [((0.0, 0.0, 0.0), "authentic"), (FALSE_ENU_M, "spoofed")])
def test_an_inertial_unit_says_which_of_the_two_skies_the_receiver_follows(offset_enu_m, says):
    rng = np.random.default_rng(10)
    detector = Dccaf(DccafSettings(count_runs=1000))
    for _ in range(5):
        records = inertial(with_ccaf(OVERLAPPED_CCAF.records(rng), rng), offset_enu_m, 10.0, rng)
        told, _ = detector.examine(records)
        if told[0].says != "attack":
            continue
        assert {evidence.says for evidence in told[1:]} == {says}  # the grid's reference is the true signal
        assert told[1].p_value < 1e-3
        assert 5 <= len(told[1].subject) <= len(told[0].subject)


def test_an_inertial_unit_that_drifts_too_far_chooses_nothing_and_rarely_wrong():
    rng = np.random.default_rng(11)
    detector = Dccaf(DccafSettings(count_runs=1000))
    said = []
    for k in range(24):
        records = with_ccaf(OVERLAPPED_CCAF.records(rng), rng)
        told, _ = detector.examine(inertial(records, (0.0, 0.0, 0.0), 40.0 if k % 2 else 400.0, rng))
        said += [(k % 2, evidence.says) for evidence in told[1:]]
    assert (1, "authentic") in said
    assert {says for near, says in said if not near} == {"undecided"}
    assert all(says != "spoofed" for _, says in said)


def test_a_unit_that_fits_neither_sky_chooses_nothing():
    rng = np.random.default_rng(13)
    records = inertial(with_ccaf(OVERLAPPED_CCAF.records(rng), rng), (-500.0, 300.0, 0.0), 10.0, rng)
    told, _ = Dccaf(DccafSettings(count_runs=1000)).examine(records)
    assert [evidence.says for evidence in told] == ["attack", "undecided"]
    assert told[1].because.startswith("neither")


def test_a_state_of_another_time_without_covariance_or_whose_place_the_signals_gave_is_not_used():
    rng = np.random.default_rng(12)
    detector = Dccaf(DccafSettings(count_runs=1000))
    records = inertial(with_ccaf(OVERLAPPED_CCAF.records(rng), rng), (0.0, 0.0, 0.0), 10.0, rng)
    state = records.nav_state
    unknown = state.covariance.copy()
    unknown[:, range(6), range(6)] = np.inf
    later = state.gpst + np.timedelta64(10, "s")
    for changed in (replace(state, gpst=later), replace(state, covariance=None), replace(state, covariance=unknown)):
        told, _ = detector.examine(replace(records, nav_state=changed))
        assert [evidence.says for evidence in told] == ["attack"]
