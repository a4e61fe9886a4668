"""Correlation over delay: peaks where signals are, noise elsewhere."""

from dataclasses import dataclass

import numpy as np
import pytest

from skyproof.gnss.signals import GPS_L1_CA, prn_of
from skyproof.recording.profile import compute_delay_profiles
from skyproof.records import Samples

RATE_HZ, IF_HZ = 4.092e6, 0.3e6


@dataclass(frozen=True)
class One:
    sat: str
    delay_s: float
    doppler_hz: float


def draw_recording(signals: list[One], cn0_dbhz: float, duration_s: float = 0.06, seed: int = 3) -> Samples:
    """Draw complex samples of signals of one strength with random phases and bits, in noise of power one."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(duration_s * RATE_HZ)) / RATE_HZ
    wave = (rng.standard_normal(t.size) + 1j * rng.standard_normal(t.size)) / np.sqrt(2.0)
    amplitude = np.sqrt(10.0 ** (cn0_dbhz / 10.0) / RATE_HZ)
    for signal in signals:
        chips = (t - signal.delay_s) * GPS_L1_CA.chip_rate_hz * (1.0 + signal.doppler_hz / GPS_L1_CA.carrier_hz)
        code = GPS_L1_CA.code(prn_of(signal.sat))[np.floor(chips).astype(int) % 1023]
        bits = rng.choice([-1.0, 1.0], 99)[np.floor(chips / 20460.0).astype(int)]
        turns = (IF_HZ + signal.doppler_hz) * t + rng.uniform()
        wave += amplitude * code * bits * np.exp(2j * np.pi * turns)
    planes = np.stack([wave.real, wave.imag]).astype(np.float32)

    def read(start: int, count: int) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
        return planes[:, start : start + count]

    return Samples(name="rx", rate_hz=RATE_HZ, n_samples=t.size, read=read)


def test_each_signal_of_a_satellite_has_its_peak() -> None:
    chip_s = 1.0 / GPS_L1_CA.chip_rate_hz
    true, false = One("G05", 0.3e-3, 3200.0), One("G05", 0.3e-3 + 4.5 * chip_s, 3210.0)
    delays, powers = compute_delay_profiles(draw_recording([true, false], 48.0), IF_HZ, [true], -3.0, 8.0)
    (power,) = powers
    for at in (0.0, 4.5):
        near = np.abs(delays - at) < 1.5
        assert delays[near][np.argmax(power[near])] == pytest.approx(at, abs=0.15)
        assert power[near].max() == pytest.approx(10.0**4.8 * 1e-3, rel=0.25)
    assert np.abs(power[(delays > 1.5) & (delays < 3.0)] - 1.0).max() < 1.0


def test_the_stretch_may_begin_anywhere() -> None:
    signal = One("G12", 0.71e-3, -2500.0)
    samples = draw_recording([signal], 48.0)
    start_s = 0.0101234
    moved = One(
        "G12", (signal.delay_s - (1.0 + signal.doppler_hz / GPS_L1_CA.carrier_hz) * start_s) % 1e-3, signal.doppler_hz
    )
    delays, powers = compute_delay_profiles(samples, IF_HZ, [moved], -2.0, 2.0, start_s=start_s, duration_s=0.02)
    assert delays[np.argmax(powers[0])] == pytest.approx(0.0, abs=0.15)


def test_noise_alone_is_one() -> None:
    _, powers = compute_delay_profiles(draw_recording([], 0.0), IF_HZ, [One("G05", 0.3e-3, 0.0)], -10.0, 10.0)
    assert powers.mean() == pytest.approx(1.0, abs=0.1)


def test_points_are_no_more_than_asked_for() -> None:
    delays, powers = compute_delay_profiles(
        draw_recording([], 0.0), IF_HZ, [One("G05", 0.0, 0.0)], -10.0, 50.0, most_points=100
    )
    assert delays.size == powers.shape[1] <= 101
    np.testing.assert_allclose(np.diff(delays), delays[1] - delays[0])


def test_a_stretch_without_a_code_period_is_refused() -> None:
    with pytest.raises(ValueError, match="code period"):
        compute_delay_profiles(draw_recording([], 0.0, 0.002), IF_HZ, [One("G05", 0.0, 0.0)], -1.0, 1.0, start_s=0.0015)


def test_zeros_alone_have_no_profile() -> None:
    samples = Samples(name="rx", rate_hz=RATE_HZ, n_samples=245_520, read=lambda start, count: np.zeros((2, count)))
    with pytest.raises(ValueError, match="zeros"):
        compute_delay_profiles(samples, IF_HZ, [One("G05", 0.3e-3, 3200.0)], -3.0, 8.0)
