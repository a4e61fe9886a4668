"""Phases and codes of a snapshot on several antennas: what was put in comes out, within the sigmas stated."""

import numpy as np
import pytest

from skyproof.gnss.signals import GPS_L1_CA
from skyproof.receiver.array_snapshot import MOST_LATE, measure_snapshot
from skyproof.receiver.snapshot import grid_sigma_chips

RATE_HZ, IF_HZ = 3e6, 0.7e6
N = round(0.064 * RATE_HZ)
CHIP_HZ, PERIOD_S = GPS_L1_CA.chip_rate_hz, GPS_L1_CA.period_s


def receive_samples(rng, phases_cyc, cn0_dbhz, doppler_hz, delay_s, *, real=True, one_bit=False):
    """Draw G07 with random bits and edges, and noise of each antenna, (n_antennas, 2, N), and receive it."""
    t = np.arange(N) / RATE_HZ
    chips = (t - delay_s) * (1.0 + doppler_hz / GPS_L1_CA.carrier_hz) * CHIP_HZ
    code = GPS_L1_CA.code(7)[np.floor(chips).astype(int) % 1023]
    bits = rng.choice([-1.0, 1.0], 6)[(np.floor(chips / 1023).astype(int) + rng.integers(1, 20)) // 20]
    amplitude = np.sqrt((4.0 if real else 2.0) * 10.0 ** (0.1 * cn0_dbhz) / RATE_HZ)
    planes = np.zeros((len(phases_cyc), 2, N), np.float32)
    for plane, phase_cyc in zip(planes, phases_cyc, strict=True):
        wave = amplitude * bits * code * np.exp(2j * np.pi * ((IF_HZ + doppler_hz) * t + phase_cyc))
        plane[0] = wave.real + rng.standard_normal(N)
        if not real:
            plane[1] = wave.imag + rng.standard_normal(N)
    return np.sign(planes) if one_bit else planes


def wrap_cycles(value, period=1.0):
    return value - period * np.rint(value / period)


@pytest.mark.parametrize(("real", "one_bit"), [(True, True), (False, False)])
def test_phases_and_codes_are_as_far_off_as_their_sigmas_say(real, one_bit):
    rng = np.random.default_rng(2)
    phase, code = [], []
    for _ in range(6):
        phases_cyc, doppler_hz, delay_s = rng.random(5), rng.uniform(-4e3, 4e3), rng.uniform(0.0, 1e-3)
        planes = receive_samples(rng, phases_cyc, 44.0, doppler_hz, delay_s, real=real, one_bit=one_bit)
        off_s, off_hz = rng.uniform(-0.3, 0.3) / CHIP_HZ, rng.uniform(-20.0, 20.0)
        found = measure_snapshot(planes, RATE_HZ, IF_HZ, "G07", delay_s + off_s, doppler_hz + off_hz)
        assert found.code.found
        error = found.phase_cyc - phases_cyc
        phase.append(
            wrap_cycles(error[:, 1:] - error[:, :1]) / np.hypot(found.sigma_cyc[:, 1:], found.sigma_cyc[:, :1])
        )
        shown_s = (found.middle_s - delay_s) * (1.0 + doppler_hz / GPS_L1_CA.carrier_hz)
        code.append(wrap_cycles(found.code_s - shown_s, PERIOD_S) / found.code_sigma_s)
        lost_db = 10.0 * np.log10(np.pi / 2.0) if one_bit else 0.0
        assert found.cn0_dbhz == pytest.approx(44.0 - lost_db, abs=1.5)
    # 6 x 4 x 4 errors, of which those against one antenna hang together.
    assert np.sqrt(np.mean(np.square(phase))) == pytest.approx(1.0, abs=0.3)
    assert np.sqrt(np.mean(np.square(code))) < 1.3


def test_many_antennas_follow_what_none_of_them_could():
    rng = np.random.default_rng(3)
    phases_cyc = rng.random(16)
    planes = receive_samples(rng, phases_cyc, 31.0, 1234.0, 3e-4, real=False)
    found = measure_snapshot(planes, RATE_HZ, IF_HZ, "G07", 3e-4, 1230.0)
    assert found.code.cn0_dbhz == pytest.approx(31.0 + 10.0 * np.log10(16.0), abs=1.0)
    error = found.phase_cyc - phases_cyc
    assert np.abs(wrap_cycles(error - error[:, :1])).max() < 0.25


def test_noise_has_no_energy_and_a_dead_antenna_no_phase():
    rng = np.random.default_rng(4)
    planes = rng.standard_normal((4, 2, N)).astype(np.float32)
    assert measure_snapshot(planes, RATE_HZ, IF_HZ, "G07", 3e-4, 1230.0).energy < 40.0
    planes = receive_samples(rng, rng.random(4), 44.0, 1234.0, 3e-4)
    planes[2] = 0.0
    found = measure_snapshot(planes, RATE_HZ, IF_HZ, "G07", 3e-4, 1230.0)
    assert np.isnan(found.phase_cyc[:, 2]).all()
    assert np.isfinite(found.phase_cyc[:, [0, 1, 3]]).all()


def test_the_mean_of_parts_is_no_surer_than_the_sample_grid():
    rng = np.random.default_rng(5)
    found = measure_snapshot(
        receive_samples(rng, rng.random(4), 60.0, 1234.0, 3e-4), RATE_HZ, IF_HZ, "G07", 3e-4, 1230.0
    )
    of_mean_s = np.sqrt(np.mean(found.code_sigma_s**2) / found.code_sigma_s.size)
    assert of_mean_s > grid_sigma_chips(RATE_HZ, GPS_L1_CA) / CHIP_HZ


@pytest.mark.parametrize("late_periods", [3, -5])
def test_an_antenna_late_by_periods_is_found_by_its_data_bits(late_periods):
    rng = np.random.default_rng(8)
    planes = receive_samples(rng, rng.random(4), 45.0, 1234.0, 3e-4)
    planes[2] = np.roll(planes[2], -round(late_periods * PERIOD_S * RATE_HZ), axis=-1)
    later = measure_snapshot(planes, RATE_HZ, IF_HZ, "G07", 3e-4, 1230.0).later
    assert later[2].argmax() - MOST_LATE == late_periods
    assert later[2].max() > 100.0
    assert later[[0, 1, 3]].max() < 15.0
