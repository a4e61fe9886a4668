"""Fine delay and Doppler of short stretches, against the truth of the simulator."""

import numpy as np
import pytest

from skyproof.gnss.codes import generate_ca_code
from skyproof.receiver.snapshot import measure_code_phase

RATE_HZ = 2.6e6


def wrap_period(difference_s):
    """Wrap a difference to -0.5 .. 0.5 ms."""
    return (difference_s + 5e-4) % 1e-3 - 5e-4


def draw_wave(rng, rate_hz, duration_s, prn, delay_s, doppler_hz, cn0_dbhz, bits=True):
    """Draw one signal in white noise of variance 1 in I and in Q, with bits that turn anywhere."""
    k = np.arange(round(duration_s * rate_hz))
    chips = (k / rate_hz - delay_s) * 1.023e6 * (1.0 + doppler_hz / 1575.42e6)
    sign = rng.choice([-1.0, 1.0], 20)[(np.floor(chips / 1023).astype(int) + rng.integers(20)) // 20 + 1] if bits else 1
    amplitude = np.sqrt(2.0 * 10 ** (cn0_dbhz / 10) / rate_hz)
    turn = np.exp(2j * np.pi * doppler_hz / rate_hz * k)
    signal = amplitude * sign * generate_ca_code(prn)[np.floor(chips).astype(int) % 1023] * turn
    return (np.stack([signal.real, signal.imag]) + rng.normal(size=(2, k.size))).astype(np.float32)


def draw_trials(rng, n, duration_s, cn0_dbhz, rate_hz=RATE_HZ):
    """Draw errors of code and Doppler over their stated sigmas."""
    code, doppler = [], []
    for _ in range(n):
        delay_s, true_hz = rng.uniform(0, 1e-3), rng.uniform(-4000, 4000)
        samples = draw_wave(rng, rate_hz, duration_s, 7, delay_s, true_hz, cn0_dbhz)
        found = measure_code_phase(
            samples, rate_hz, 0.0, "G07", delay_s + rng.uniform(-0.3, 0.3) / 1.023e6, true_hz + rng.uniform(-20, 20)
        )
        assert found.found
        truth_s = (found.elapsed_s - delay_s) * (1.0 + true_hz / 1575.42e6)
        code.append(wrap_period(found.code_s - truth_s) / found.code_sigma_s)
        doppler.append((found.doppler_hz - true_hz) / found.doppler_sigma_hz)
        assert found.cn0_dbhz == pytest.approx(cn0_dbhz, abs=1.5)
    return np.array(code), np.array(doppler)


@pytest.mark.parametrize(("duration_s", "cn0_dbhz"), [(0.02, 42.0), (0.05, 38.0), (0.05, 47.0)])
def test_errors_are_as_large_as_stated(duration_s, cn0_dbhz):
    # 30 trials: a standard deviation is good to an eighth, so that three of its sigmas are 0.4.
    code, doppler = draw_trials(np.random.default_rng(1), 30, duration_s, cn0_dbhz)
    assert 0.6 < np.sqrt(np.mean(code**2)) < 1.4
    assert 0.6 < np.sqrt(np.mean(doppler**2)) < 1.4
    assert abs(np.mean(code)) < 0.6


def test_samples_in_step_with_the_chips_are_reported_as_coarse():
    # At 16/3 samples a chip every edge falls on one of three places; noise is far less than what that leaves open.
    code, _ = draw_trials(np.random.default_rng(2), 12, 0.02, 55.0, rate_hz=5.456e6)
    assert 0.2 < np.sqrt(np.mean(code**2)) < 1.4


def test_noise_alone_has_no_strong_signal():
    rng = np.random.default_rng(3)
    noise = rng.normal(size=(2, round(0.05 * RATE_HZ))).astype(np.float32)
    found = measure_code_phase(noise, RATE_HZ, 0.0, "G07", 3e-4, 1000.0)
    assert not found.found or found.cn0_dbhz < 33.0


@pytest.mark.parametrize("duration_s", [0.001, 0.2])
def test_a_stretch_too_short_or_too_long_is_refused(duration_s):
    samples = np.zeros((2, round(duration_s * RATE_HZ)), np.float32)
    with pytest.raises(ValueError, match=r"\bsamples; "):
        measure_code_phase(samples, RATE_HZ, 0.0, "G07", 0.0, 0.0)
