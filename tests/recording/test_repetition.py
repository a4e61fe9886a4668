"""What repeats is found without rate or code, with an error that is stated; noise and lines do not repeat."""

import numpy as np
import pytest
from scipy import stats

from skyproof.gnss.codes import generate_ca_code
from skyproof.recording.repetition import find_repetition

PRNS = (3, 7, 12, 19, 24, 31)


def draw_signals(
    rate_hz: float, if_hz: float, seconds: float, *, cn0_dbhz: float = 45.0, real: bool = False, seed: int = 1
) -> np.ndarray:
    """Draw satellites with Dopplers and data bits of their own in white noise of variance 1."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(round(rate_hz * seconds)) / rate_hz
    wave = np.zeros(time_s.size, np.complex128)
    for prn in PRNS:
        doppler_hz, delay_s, phase = rng.uniform(-5e3, 5e3), rng.uniform(0.0, 1e-3), rng.uniform()
        at = (time_s - delay_s) * (1.0 + doppler_hz / 1575.42e6)
        chips = generate_ca_code(prn)[np.floor(at * 1.023e6).astype(np.int64) % 1023]
        bits = rng.choice([-1.0, 1.0], 1000)[np.floor(at / 0.02).astype(np.int64) % 1000]
        wave += chips * bits * np.exp(2j * np.pi * ((if_hz + doppler_hz) * time_s + phase))
    amplitude = np.sqrt(10.0 ** (cn0_dbhz / 10.0) / rate_hz)
    noise = (rng.standard_normal((2, time_s.size)) / np.sqrt(2.0)).T @ np.array([1.0, 1j])
    wave = amplitude * wave + noise
    return wave.real.astype(np.float32) if real else wave.astype(np.complex64)


@pytest.mark.parametrize(
    ("rate_hz", "if_hz", "real"),
    [(2.048e6, 0.0, False), (4.1e6, 300e3, False), (16.3676e6, 4.1304e6, True), (5_432_100.0, -0.7e6, False)],
)
def test_period_and_carrier_are_found_without_a_guess(rate_hz: float, if_hz: float, real: bool) -> None:
    found = find_repetition(draw_signals(rate_hz, if_hz, 0.04, cn0_dbhz=50.0, real=real))
    assert found.log10_chance < -10.0
    assert abs(found.period_samples - rate_hz * 1e-3) < 4.0 * found.period_sigma
    assert found.period_sigma < 0.05 * rate_hz / 1.023e6
    assert found.carrier_cycles * rate_hz == pytest.approx(if_hz, abs=100e3)


@pytest.mark.parametrize("real", [False, True])
def test_noise_repeats_as_seldom_as_its_chance_says(real: bool) -> None:
    rng = np.random.default_rng(5)
    n, trials, level = 1 << 14, 150, 0.2
    alarms = 0
    for _ in range(trials):
        wave = rng.standard_normal((2, n))
        found = find_repetition(wave[0].astype(np.float32) if real else (wave[0] + 1j * wave[1]).astype(np.complex64))
        alarms += found.log10_chance < np.log10(level)
    # The chance allows for each lag apart, but their sums share multiples: fewer alarms come. None would be a fault.
    assert stats.binomtest(alarms, trials, level, alternative="greater").pvalue > 1e-3
    assert alarms > 0


def test_lines_and_colour_do_not_repeat() -> None:
    rng = np.random.default_rng(6)
    n = 1 << 17
    noise = rng.standard_normal((2, n)).T @ np.array([1.0, 1j])
    coloured = np.convolve(noise, np.hanning(9), mode="same")
    line = 3.0 * np.exp(2j * np.pi * 0.1234 * np.arange(n))
    assert find_repetition((coloured + line).astype(np.complex64)).log10_chance > -3.0


def test_a_line_hides_no_signals() -> None:
    wave = draw_signals(2.6e6, 0.0, 0.05)
    line = 30.0 * np.exp(2j * np.pi * 0.1234 * np.arange(wave.size))
    found = find_repetition((wave + line).astype(np.complex64))
    assert found.log10_chance < -10.0
    assert found.period_samples == pytest.approx(2600.0, abs=0.2)


def test_real_samples_read_as_complex_show_images() -> None:
    real = draw_signals(10e6, 1.6e6, 0.1, cn0_dbhz=50.0, real=True)
    folded = find_repetition((real[0::2] + 1j * real[1::2]).astype(np.complex64))
    assert folded.mirrored_share > 0.02
    assert find_repetition(draw_signals(5e6, 1.6e6, 0.1, cn0_dbhz=50.0)).mirrored_share < 0.01


def test_the_error_of_the_period_is_what_its_sigma_says() -> None:
    ratios = []
    for seed in range(20):
        found = find_repetition(draw_signals(2.6e6, 0.0, 0.05, seed=seed))
        ratios.append((found.period_samples - 2600.0) / found.period_sigma)
    assert np.abs(ratios).max() < 4.0
    assert np.std(ratios) > 0.15  # not stated many times too large either


def test_too_few_samples_are_refused() -> None:
    with pytest.raises(ValueError, match="2000 samples"):
        find_repetition(np.zeros(2000, np.complex64))
