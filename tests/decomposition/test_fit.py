"""The correlation function taken apart: the model, and the fit against its bound."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyproof.decomposition.correlation import band_share, correlation, correlation_slope
from skyproof.decomposition.fit import bins_dictionary, decompose, taps_dictionary
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.studies.correlation_models import model, model_as_printed
from skyproof.studies.decomposition_laws import (
    blocks_dictionary,
    delay_bound,
    delay_dictionary,
    noise_variance,
    simulate_taps,
)
from skyproof.studies.swarm import SwarmSettings, swarm_decompose

AMPLITUDES = np.array([1.0, 0.87])


def draw_two_signals(rng, n, separation_chips, rate_hz, *, cn0_dbhz=45.0):
    """Draw taps of two signals: their delays, amplitudes of random phases, noise variance and taps."""
    delays = delay_dictionary(rate_hz)
    variance = noise_variance(cn0_dbhz, 0.02, rate_hz)
    first = rng.uniform(-0.2, 0.2, (n, 1))
    delay = np.concatenate((first, first + separation_chips), axis=1)
    amplitude = AMPLITUDES * np.exp(2j * np.pi * rng.random((n, 2)))
    return delay, amplitude, variance, simulate_taps(delay, amplitude, variance, delays, rng)


# The model


@pytest.mark.parametrize("band_hz", [2.5e6, 5e6, 25e6])
def test_the_correlation_integrates_the_spectrum_over_the_band(band_hz):
    b = band_hz / 2.046e6
    f, weight = np.polynomial.legendre.leggauss(400)
    f = b * f
    power = np.sinc(f) ** 2 * weight
    for lag in (0.0, 0.03, 0.4, 1.0, 1.7, -2.2):
        assert correlation(lag, band_hz, GPS_L1_CA) == pytest.approx(
            np.sum(power * np.cos(2 * np.pi * f * lag)) / power.sum(), abs=1e-12
        )
    assert band_share(band_hz, GPS_L1_CA) == pytest.approx(b * power.sum(), abs=1e-12)
    step = 1e-6
    for lag in (0.0, 0.3, -1.1):
        rise = correlation(lag + step, band_hz, GPS_L1_CA) - correlation(lag - step, band_hz, GPS_L1_CA)
        assert correlation_slope(lag, band_hz, GPS_L1_CA) == pytest.approx(rise / (2 * step), abs=1e-7)


def test_power_shares_and_noise_level_match_the_guide():
    assert band_share(5e6, GPS_L1_CA) == pytest.approx(0.957, abs=5e-4)
    assert band_share(25e6, GPS_L1_CA) == pytest.approx(0.992, abs=5e-4)
    assert np.sqrt(noise_variance(45.0, 0.02, 25e6)) == pytest.approx(0.040, abs=5e-4)


def test_without_a_band_limit_the_correlation_is_the_triangle():
    lag = np.linspace(-2.0, 2.0, 41)
    assert np.allclose(correlation(lag, 1e12, GPS_L1_CA), np.maximum(1.0 - np.abs(lag), 0.0), atol=2e-5)


def test_the_phase_factor_is_the_integrals_not_the_printed_one():
    t = (np.arange(200_000) + 0.5) / 200_000 * 0.02
    integral = np.mean(np.exp(1j * (2 * np.pi * 17.3 * t + 1.1)))
    assert model_as_printed(1.0, 17.3, 1.1, 0.02) == pytest.approx(integral, abs=1e-8)
    assert model_as_printed(1.0, 17.3, 1.1, 0.02) == pytest.approx(-0.4707 + 0.6646j, abs=1e-4)
    assert model_as_printed(1.0, 17.3, 1.1, 0.02, form="paper") == pytest.approx(-0.137 - 0.803j, abs=1e-3)


def test_filtered_taps_have_the_models_signal_and_noise():
    # Independent of the model: random chips, an ideal low-pass, white noise, replicas shifted sample by sample.
    rng = np.random.default_rng(3)
    over, rate_hz, chips, trials = 20, 5.115e6, 512, 800
    n, every = chips * over, 4  # 20.46 MHz, down to 5.115
    code = np.repeat(rng.choice([-1.0, 1.0], (trials, chips)), over, axis=1)
    passed = np.abs(np.fft.fftfreq(n, 1.0 / (over * 1.023e6))) < 0.5 * rate_hz
    low = np.fft.ifft(np.fft.fft(code) * passed).real[:, ::every]
    noise = rng.standard_normal(low.shape) + 1j * rng.standard_normal(low.shape)
    lags = np.arange(-6, 7)
    signal = np.stack([np.mean(low * np.roll(low, k, axis=1), axis=1) for k in lags], axis=1)
    noise_taps = np.stack([np.mean(noise * np.roll(low, k, axis=1), axis=1) for k in lags], axis=1)
    shape = correlation(lags * 1.023e6 / rate_hz, rate_hz, GPS_L1_CA)
    assert np.allclose(signal.mean(axis=0) / signal.mean(axis=0)[6], shape, atol=5e-3)
    covariance = (noise_taps.T @ noise_taps.conj()).real / trials
    expected = correlation((lags[:, None] - lags) * 1.023e6 / rate_hz, rate_hz, GPS_L1_CA)
    assert np.allclose(covariance / np.trace(covariance) * len(lags), expected, atol=0.12)  # 3 sigma of 800


def test_grid_noise_and_signals_agree_between_blocks_and_bins():
    blocks = blocks_dictionary(0.02, 10, within_hz=60.0)
    bins = bins_dictionary(0.02, np.arange(-100.0, 101.0, 25.0), within_hz=60.0)
    for table in (blocks, bins):
        energy = np.sum(np.abs(table.value) ** 2, axis=1)
        assert np.abs(energy[np.abs(table.grid) < 20.0] - 1.0).max() < 0.03  # all of a signal's energy is there


# The bound


@pytest.mark.parametrize(
    ("rate_hz", "phase_deg", "first", "second"),
    [
        (2.5e6, 0, 0.116, 0.138),
        (2.5e6, 60, 0.044, 0.052),
        (2.5e6, 90, 0.039, 0.046),
        (5e6, 0, 0.0162, 0.0180),
        (5e6, 180, 0.0162, 0.0180),
        (5e6, 60, 0.0126, 0.0141),
        (5e6, 90, 0.0119, 0.0132),
        (10e6, 0, 0.0067, 0.0077),
        (25e6, 0, 0.0041, 0.0048),
        (25e6, 90, 0.0041, 0.0048),
        (50e6, 45, 0.0029, 0.0033),
    ],
)
def test_the_bound_for_two_signals_is_that_of_the_guide(rate_hz, phase_deg, first, second):
    amplitude = AMPLITUDES * np.exp(1j * np.radians([0.0, phase_deg]))
    bound = delay_bound([0.0, 0.25], amplitude, noise_variance(45.0, 0.02, rate_hz), delay_dictionary(rate_hz))
    assert np.sqrt(np.diag(bound)) == pytest.approx([first, second], rel=0.025)


@pytest.mark.parametrize(("rate_hz", "alone"), [(2.5e6, 0.0138), (5e6, 0.0093), (10e6, 0.0063), (25e6, 0.0041)])
def test_the_bound_for_one_signal_is_that_of_the_guide(rate_hz, alone):
    bound = delay_bound([0.0], [1.0], noise_variance(45.0, 0.02, rate_hz), delay_dictionary(rate_hz))
    assert np.sqrt(bound[0, 0]) == pytest.approx(alone, abs=6e-5)


def test_three_signals_are_for_high_rates_only():
    amplitude = [1.0, 0.87j, -0.3]
    fast, slow = (
        np.sqrt(
            np.diag(
                delay_bound([0.0, 0.25, 0.4], amplitude, noise_variance(45.0, 0.02, rate_hz), delay_dictionary(rate_hz))
            )
        )
        for rate_hz in (25e6, 5e6)
    )
    assert fast == pytest.approx([0.0042, 0.005, 0.014], rel=0.03)
    assert slow[2] > 0.06


def test_an_unknown_doppler_keeps_the_bound_of_the_delays():
    delays, variance = delay_dictionary(5e6), noise_variance(45.0, 0.02, 5e6)
    blocks = blocks_dictionary(0.02, 10, within_hz=60.0)
    amplitude = AMPLITUDES * np.exp(1j * np.array([0.0, 1.0]))
    known = delay_bound([0.0, 0.25], amplitude, variance, delays)
    joint_bound = delay_bound([0.0, 0.25], amplitude, variance, delays, blocks, 3.0)
    assert np.allclose(np.diag(joint_bound)[:2], np.diag(known), rtol=0.02)
    assert np.all(
        (np.sqrt(np.diag(joint_bound)[2:]) > 0.7) & (np.sqrt(np.diag(joint_bound)[2:]) < 1.6)
    )  # guide: 0.8 to 1.5 Hz


# The fit


def test_without_noise_the_signals_come_back_exactly():
    rng = np.random.default_rng(5)
    for rate_hz, count in ((5e6, 2), (25e6, 2), (25e6, 3)):
        delays = delay_dictionary(rate_hz)
        delay = np.array([-0.113, 0.171, 0.457])[:count] + np.zeros((4, 1))
        amplitude = np.array([1.0, 0.87, 0.6])[:count] * np.exp(2j * np.pi * rng.random((4, count)))
        found = decompose(
            model(amplitude, delay, np.zeros_like(delay), taps_chips=delays.points, coherent_s=0.02, band_hz=rate_hz)[
                :, 0
            ],
            delays,
            signals=count,
        )
        assert np.allclose(found.delay_chips, delay, atol=2e-4)
        assert np.allclose(found.amplitude, amplitude, atol=4e-3)


@pytest.mark.parametrize(("rate_hz", "at_least"), [(5e6, 0.985), (10e6, 0.99), (25e6, 0.99)])
def test_two_signals_a_quarter_chip_apart_reach_the_bound(rate_hz, at_least):
    rng = np.random.default_rng(7)
    delay, amplitude, variance, taps = draw_two_signals(rng, 1000, 0.25, rate_hz)
    delays = delay_dictionary(rate_hz)
    found = decompose(taps, delays, noise_variance=variance)
    error = found.delay_chips - delay
    bound = delay_bound(delay, amplitude, variance, delays)
    assert np.mean(np.all(np.abs(error) < 0.05, axis=1)) >= at_least
    rms = np.sqrt(np.mean(error**2) / np.mean(np.diagonal(bound, axis1=1, axis2=2)))
    assert 0.9 < rms <= 1.1


def test_an_estimates_covariance_is_that_of_its_errors():
    rng = np.random.default_rng(8)
    delay, _, variance, taps = draw_two_signals(rng, 2000, 0.4, 10e6)
    found = decompose(taps, delay_dictionary(10e6), noise_variance=variance)
    error = found.delay_chips - delay
    squared = np.einsum("ti,tij,tj->t", error, np.linalg.inv(found.covariance), error)
    assert squared.mean() == pytest.approx(2.0, rel=0.12)  # 0.045 of it is one sigma; 1.04 of the bound is usual


def test_separate_dopplers_are_found_too():
    rng = np.random.default_rng(9)
    rate_hz, n = 5e6, 60
    delays, blocks = delay_dictionary(rate_hz), blocks_dictionary(0.02, 10, within_hz=60.0)
    variance = noise_variance(45.0, 0.02, rate_hz)
    delay, doppler = np.array([-0.1, 0.15]), np.array([11.3, 13.1])
    turn = np.exp(2j * np.pi * doppler * blocks.points[:, None]) * np.sinc(doppler * 2e-3) / np.sqrt(10)
    amplitude = AMPLITUDES * np.exp(2j * np.pi * rng.random((n, 1, 2)))
    taps = simulate_taps(np.broadcast_to(delay, (n, 10, 2)), amplitude * turn, np.full((n, 10), variance), delays, rng)
    found = decompose(taps, delays, blocks, noise_variance=variance)
    assert np.mean(np.all(np.abs(found.delay_chips - delay) < 0.05, axis=1)) >= 0.95
    assert np.sqrt(np.median((found.doppler_hz - doppler) ** 2)) < 1.5


def test_leading_axes_are_free_and_change_nothing():
    rng = np.random.default_rng(10)
    _, _, variance, taps = draw_two_signals(rng, 6, 0.3, 5e6)
    delays = delay_dictionary(5e6)
    whole = decompose(taps.reshape(2, 3, -1), delays, noise_variance=variance)
    assert whole.delay_chips.shape == (2, 3, 2)
    assert whole.covariance.shape == (2, 3, 2, 2)
    problem = decompose(taps[4], delays, noise_variance=variance)
    assert np.array_equal(problem.delay_chips, whole.delay_chips[1, 1])


def test_taps_that_do_not_fit_the_dictionary_are_refused():
    with pytest.raises(ValueError, match="dictionaries"):
        decompose(np.zeros((3, 7), complex), delay_dictionary(5e6))


def test_the_swarm_finds_less_than_variable_projection():
    rng = np.random.default_rng(11)
    delay, _, variance, taps = draw_two_signals(rng, 30, 0.25, 5e6)
    delays = delay_dictionary(5e6)
    near = np.abs(delays.points) <= 1.0
    swarm = swarm_decompose(
        taps[:, None, near],
        delays.points[near],
        coherent_s=0.02,
        band_hz=5e6,
        rng=rng,
        settings=SwarmSettings(particles=100, iterations=300),
    )
    right = np.mean(np.all(np.abs(swarm.delay_chips - delay) < 0.05, axis=1))
    ours = decompose(taps, delays, noise_variance=variance)
    assert 0.35 <= right <= 0.95  # guide: 0.64 of 60 to 100
    assert np.mean(np.all(np.abs(ours.delay_chips - delay) < 0.05, axis=1)) > right


def test_the_swarm_costs_what_numpy_says():
    rng = np.random.default_rng(12)
    _, _, _, taps = draw_two_signals(rng, 1, 0.25, 5e6)
    delays = delay_dictionary(5e6)
    fit = swarm_decompose(
        taps[:, None, :],
        delays.points,
        coherent_s=0.02,
        band_hz=5e6,
        rng=rng,
        settings=SwarmSettings(particles=20, iterations=20),
    )
    fitted = model(
        fit.amplitude, fit.delay_chips, fit.doppler_hz, taps_chips=delays.points, coherent_s=0.02, band_hz=5e6
    )
    assert fit.cost[0] == pytest.approx(np.sum(np.abs(taps - fitted[:, 0]) ** 2), rel=1e-3)


def test_a_wider_band_of_shorter_chips_is_the_same_shape():
    # The signal's plan gives the chip: ten times the chip rate in ten times the band looks alike, in chips.
    fast = replace(GPS_L1_CA, chip_rate_hz=10.0 * GPS_L1_CA.chip_rate_hz)
    lag = np.linspace(-1.5, 1.5, 31)
    np.testing.assert_allclose(correlation(lag, 50e6, fast), correlation(lag, 5e6, GPS_L1_CA), atol=1e-12)
    np.testing.assert_allclose(correlation_slope(lag, 50e6, fast), correlation_slope(lag, 5e6, GPS_L1_CA), atol=1e-12)
    taps = tuple(np.linspace(-1.0, 1.0, 9))
    slow, same = (taps_dictionary(taps, *of) for of in ((5e6, GPS_L1_CA), (50e6, fast)))
    np.testing.assert_allclose(np.abs(same.value), np.abs(slow.value), atol=1e-9)


@given(delay=st.floats(-1.3, 1.3))
def test_a_dictionary_is_read_between_its_points(delay):
    dictionary = delay_dictionary(10e6)
    value, slope = dictionary.at(delay)
    before, after = (dictionary.at(np.clip(delay + step, -1.3, 1.3)) for step in (-1e-5, 1e-5))
    width = np.clip(delay + 1e-5, -1.3, 1.3) - np.clip(delay - 1e-5, -1.3, 1.3)
    np.testing.assert_allclose(slope, (after[0] - before[0]) / width, atol=1e-3 * np.linalg.norm(slope) + 1e-6)
    assert np.linalg.norm(value) == pytest.approx(1.0, abs=0.05)
