"""One signal or two over a burst: false second signals as stated, delays at the bound, reflections separated."""

import numpy as np
import pytest
from tests.detectors.nulls import CCAF_POINTS, CCAF_RATE_HZ, INTERVALS, correlate_code, draw_burst

from skyproof.detectors.dccaf.bursts import build_shapes, fit_components, joint_p_value
from skyproof.detectors.dccaf.delays import DccafSettings
from skyproof.detectors.dccaf.policy import POLICY
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.studies.decomposition_laws import noise_variance

PRN = 7
OWN = build_shapes(GPS_L1_CA, PRN, tuple(CCAF_POINTS.tolist()), CCAF_RATE_HZ, 1.3)


def draw_bursts(count, delays, amplitudes, cn0_dbhz, rng):
    """Draw `count` bursts with delays and amplitudes (count, n)."""
    variance = float(noise_variance(cn0_dbhz, 0.02, CCAF_RATE_HZ))
    taps = [draw_burst(PRN, d, a, variance, rng) for d, a in zip(delays, amplitudes, strict=True)]
    return fit_components(np.array(taps), OWN, np.full((count, INTERVALS), variance))


def test_a_satellites_own_side_lobes_are_in_its_shape():
    lag = np.linspace(-3.0, 3.0, 25)
    far = correlate_code(PRN, lag) - correlate_code(1, lag)
    assert np.abs(far).max() > 0.05  # codes differ by their side lobes
    shape = build_shapes(GPS_L1_CA, PRN, tuple(lag.tolist()), CCAF_RATE_HZ, 0.1)
    middle = shape.value[shape.grid.size // 2]
    np.testing.assert_allclose(np.linalg.pinv(shape.whiten) @ middle, correlate_code(PRN, lag), atol=2e-3)


@pytest.mark.long
@pytest.mark.parametrize("cn0_dbhz", [36.0, 50.0])
def test_one_signal_counts_as_two_at_most_as_often_as_stated(cn0_dbhz):
    rng = np.random.default_rng(1)
    count = 200
    found = draw_bursts(count, rng.uniform(-0.3, 0.3, (count, 1)), np.ones((count, 1)), cn0_dbhz, rng)
    p_value = joint_p_value(found.second, INTERVALS, OWN.path)
    for asked in (0.3, 0.1):
        share = np.mean(p_value < asked)
        assert share < asked + 4.0 * np.sqrt(asked / count)
        assert share > 0.2 * asked - 4.0 * np.sqrt(0.2 * asked / count)  # a bound that says something
    assert np.all(found.unlike <= found.second + 1e-9)


def test_a_single_signals_delay_has_the_sigma_that_is_stated():
    rng = np.random.default_rng(2)
    delay = rng.uniform(-0.3, 0.3, (150, 1))
    found = draw_bursts(150, delay, np.ones((150, 1)), 45.0, rng)
    scaled = (found.one_chips - delay[:, 0]) / found.one_sigma
    assert np.std(scaled) == pytest.approx(1.0, abs=0.17)
    assert abs(np.mean(scaled)) < 0.2


def test_two_signals_keep_delays_and_sigmas_at_any_phase():
    rng = np.random.default_rng(3)
    first = rng.uniform(-0.3, 0.3, 100)
    delay = np.stack([first, first + 0.3], axis=1)
    found = draw_bursts(100, delay, np.tile([1.0, 0.8], (100, 1)), 45.0, rng)
    assert np.mean(joint_p_value(found.second, INTERVALS, OWN.path) < 1e-6) == 1.0
    scaled = (found.two_chips - delay) / np.sqrt(found.two_variance)
    assert np.sqrt(np.mean(scaled**2)) == pytest.approx(1.0, abs=0.17)


def test_only_later_and_weaker_signals_pass_as_reflections():
    # Reflections of all delays and strengths: hardly one is taken for another signal. 5 dB and more apart they are.
    rng = np.random.default_rng(4)
    count = 150
    first = rng.uniform(-0.2, 0.2, count)
    later = rng.uniform(0.0, 1.0, count)
    weaker_db = rng.uniform(3.0, 20.0, count)
    strength = np.stack([np.ones(count), 10.0 ** (-0.05 * weaker_db)], axis=1)
    for cn0_dbhz in (38.0, 50.0):
        found = draw_bursts(count, np.stack([first, first + later], axis=1), strength, cn0_dbhz, rng)
        assert np.mean(joint_p_value(found.unlike, INTERVALS, OWN.path) < 1e-2) <= 0.01
    before = draw_bursts(100, np.stack([first, first - 0.3], axis=1)[:100], np.tile([1.0, 0.6], (100, 1)), 45.0, rng)
    as_strong = draw_bursts(
        100, np.stack([first, first + 0.3], axis=1)[:100], np.tile([1.0, 0.95], (100, 1)), 45.0, rng
    )
    for found in (before, as_strong):
        assert np.mean(joint_p_value(found.unlike, INTERVALS, OWN.path) < 1e-4) > 0.95


@pytest.mark.parametrize(("rays", "most"), [(2, 0.075), (3, 0.15)])
def test_several_reflections_count_as_often_as_allowed_for(rays, most):
    # Each 3 to 20 dB weaker: together they may look like one signal that is no reflection.
    rng = np.random.default_rng(5)
    count = 150
    first = rng.uniform(-0.2, 0.2, (count, 1))
    delay = np.concatenate([first, first + rng.uniform(0.0, 1.0, (count, rays))], axis=1)
    strength = np.concatenate([np.ones((count, 1)), 10.0 ** (-0.05 * rng.uniform(3.0, 20.0, (count, rays)))], axis=1)
    found = draw_bursts(count, delay, strength, 47.0, rng)
    share = np.mean(joint_p_value(found.unlike, INTERVALS, OWN.path) < POLICY.signal_probability)
    assert share < most + 3.0 * np.sqrt(most / count)
    assert most <= DccafSettings().no_reflection_probability


def test_an_estimated_variance_makes_the_law_wider():
    t = np.array([20.0, 40.0])
    assert np.all(joint_p_value(t, 4, OWN.path, 64) > joint_p_value(t, 4, OWN.path))
    np.testing.assert_allclose(joint_p_value(t, 4, OWN.path, 10**7), joint_p_value(t, 4, OWN.path), rtol=0.01)


def test_two_sides_of_one_peak_have_no_sigma():
    # Signals 0.04 chip apart with one phase: the fit makes them as near as it may, and then its curvature is none.
    rng = np.random.default_rng(11)
    delay = np.tile([0.0, 0.04], (60, 1))
    found = draw_bursts(60, delay, np.tile([1.0, 1.0], (60, 1)), 50.0, rng)
    nearest = np.abs(np.diff(found.two_chips, axis=1))[:, 0] < 0.006
    assert nearest.any()
    assert found.at_edge[nearest].all()
    assert found.at_edge[~nearest].mean() < 0.1
