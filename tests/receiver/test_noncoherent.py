"""Code and Doppler of a signal whose phase is not held: unbiased, as sharp as stated, and nothing of noise alone."""

import numpy as np
import pytest

from skyproof.gnss.signals import GPS_L1_CA
from skyproof.receiver import kernels as k
from skyproof.receiver.discriminator import Discriminator
from skyproof.receiver.noncoherent import measure_noncoherent
from skyproof.statistics.distributions import binomial_survival

RATE_HZ, IF_HZ, NEAR_HZ = 2e6, 4e3, -1300.0
SHARP = Discriminator(gain=2.0, noise_chips2=0.0625)
NOISE = 7.0
DRAWS = 400


def draw_rows(rng, cn0_dbhz, off_hz=0.0, code_chips=0.0, n=200, first=7):
    """Draw rows of the kernel: a loop that wanders, bits that turn, taps 1/8 chip off with sharp chips' noise."""
    rows = np.zeros((n, k.row_size(3, 1)))
    t_s = 1e-3 * np.arange(n)
    rows[:, k.OUT_START] = RATE_HZ * t_s
    rows[:, k.OUT_PERIOD] = first + np.arange(n)
    rows[:, k.OUT_FREQUENCY] = IF_HZ + NEAR_HZ + 8.0 * np.cumsum(rng.standard_normal(n)) / np.sqrt(n)
    rows[:, k.OUT_PHASE] = 123.4 + 1e-3 * np.concatenate(([0.0], np.cumsum(rows[:-1, k.OUT_FREQUENCY])))
    own_cyc = rows[:, k.OUT_PHASE] + 0.5e-3 * rows[:, k.OUT_FREQUENCY]
    bits = rng.choice([-1.0, 1.0], n)[(rows[:, k.OUT_PERIOD].astype(int) - 3) // 20]
    phase_cyc = (IF_HZ + NEAR_HZ + off_hz) * (t_s + 0.5e-3) - own_cyc + rng.uniform()
    amplitude = np.sqrt(NOISE * 1e-3 * 10.0 ** (0.1 * cn0_dbhz))
    taps = np.array([0.125, 0.0, -0.125])
    shape = 1.0 - np.abs(code_chips - taps)
    mixed = np.linalg.cholesky(1.0 - np.abs(taps[:, None] - taps))
    noise = np.sqrt(0.5 * NOISE) * (rng.standard_normal((2, n, 3)) @ mixed.T)
    value = amplitude * (bits * np.exp(2j * np.pi * phase_cyc))[:, None] * shape + noise[0] + 1j * noise[1]
    rows[:, k.OUT_TAPS :: 2], rows[:, k.OUT_TAPS + 1 :: 2] = value.real, value.imag
    return rows


def show_sky(rows, probability=1e-3):
    return measure_noncoherent(
        rows,
        3.0,
        NOISE,
        NEAR_HZ,
        rate_hz=RATE_HZ,
        if_hz=IF_HZ,
        signal=GPS_L1_CA,
        discriminator=SHARP,
        probability=probability,
    )


@pytest.mark.parametrize("cn0_dbhz", [22.0, 26.0, 35.0])
def test_code_and_doppler_scatter_as_stated_about_the_truth(cn0_dbhz):
    rng = np.random.default_rng(round(cn0_dbhz))
    found = [
        measured for measured in (show_sky(draw_rows(rng, cn0_dbhz)) for _ in range(DRAWS)) if measured is not None
    ]
    assert len(found) > 0.95 * DRAWS
    for error in (
        np.array([(measured.doppler_hz - NEAR_HZ) / measured.doppler_sigma_hz for measured in found]),
        np.array([measured.code_chips / measured.code_sigma_chips for measured in found]),
    ):
        assert abs(error.mean()) < 4.0 * error.std() / np.sqrt(len(found))
        assert 0.85 < error.std() < 1.15
    assert abs(np.mean([measured.cn0_dbhz for measured in found]) - cn0_dbhz) < 0.5


@pytest.mark.parametrize("off_hz", [-20.0, -6.0, 6.0, 20.0])
def test_a_carrier_is_found_within_half_a_bits_inverse(off_hz):
    rng = np.random.default_rng(3)
    found = [show_sky(draw_rows(rng, 40.0, off_hz, code_chips=0.04)) for _ in range(60)]
    assert abs(np.mean([result.doppler_hz - NEAR_HZ for result in found]) - off_hz) < 0.5
    assert abs(np.mean([result.code_chips for result in found]) - 0.04) < 0.01


def test_noise_alone_shows_nothing_but_as_often_as_stated():
    rng = np.random.default_rng(5)
    passed = sum(show_sky(draw_rows(rng, -50.0), 0.05) is not None for _ in range(DRAWS))
    assert binomial_survival(passed, DRAWS, 0.05) > 1e-3
    assert passed > 4


def test_a_cut_bit_does_not_count_and_three_are_needed():
    rng = np.random.default_rng(6)
    assert show_sky(draw_rows(rng, 45.0, n=76)) is not None  # 16 periods of one, three whole ones
    assert show_sky(draw_rows(rng, 45.0, n=75)) is None
    rows = draw_rows(rng, 45.0, n=96)  # 16 of one, four whole ones
    other = rows.copy()
    other[:16, k.OUT_TAPS :] = 1e3
    assert show_sky(other).doppler_hz == pytest.approx(show_sky(rows).doppler_hz)
