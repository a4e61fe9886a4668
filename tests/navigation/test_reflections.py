"""How far reflections shift averaged codes: the law between what is seen and what is not, and its estimate."""

import numpy as np

from skyproof.navigation.reflections import estimate_reflection_sigma_m

HALF_CHIPS = 0.128


def _offsets_chips(wave, delay_chips, steps=200):
    """A discriminator's offset at the code where its real part is zero: (code error, part off the carrier)."""
    late = np.zeros(wave.shape)
    for _ in range(steps):
        early, prompt, behind = (
            np.maximum(1.0 - np.abs(late + tap), 0.0) + wave * np.maximum(1.0 - np.abs(late + tap - delay_chips), 0.0)
            for tap in (-HALF_CHIPS, 0.0, HALF_CHIPS)
        )
        apart = (behind - early) / prompt / 2.0
        late = late + 0.3 * apart.real
    return late, apart.imag


def test_the_error_of_the_code_is_as_large_as_what_is_seen_off_the_carrier():
    phase_rad = 2.0 * np.pi * (np.arange(360) + 0.5) / 360.0
    for amplitude in (0.05, 0.25, 0.5):
        for delay_chips in (0.05, 0.3, 0.7):
            error, seen = _offsets_chips(amplitude * np.exp(1j * phase_rad), delay_chips)
            assert 0.75 < np.sqrt(np.mean(error**2) / np.mean(seen**2)) < 1.25, (amplitude, delay_chips)


def test_noise_alone_adds_next_to_nothing_and_reflections_their_size():
    rng = np.random.default_rng(4)
    thermal_m = np.full((4000, 8), 0.2)
    noise_m = thermal_m * rng.standard_normal(thermal_m.shape)
    alone_m = estimate_reflection_sigma_m(noise_m, thermal_m)
    assert np.sqrt(np.mean(alone_m**2)) < 0.2
    off_m = 5.0 * rng.standard_normal(thermal_m.shape)
    sigma_m = estimate_reflection_sigma_m(off_m + noise_m, thermal_m, own_share=0.0)
    error_m = 5.0 * rng.standard_normal(thermal_m.shape)
    assert 0.94 < np.mean(np.abs(error_m) < 1.96 * sigma_m) < 0.97
    of_one_m = estimate_reflection_sigma_m(np.where(np.arange(8) == 3, np.nan, off_m), thermal_m)
    assert np.isfinite(of_one_m).all()
    assert not estimate_reflection_sigma_m(np.full((2, 5), np.nan), np.ones((2, 5))).any()
