"""Measurements from rows of correlators made by formula: phase, code, strength, slips."""

import numpy as np
import pytest

from skyproof.gnss.signals import GPS_L1_CA
from skyproof.receiver import kernels as k
from skyproof.receiver import measurement as m
from skyproof.receiver.discriminator import compute_discriminator

RATE_HZ = 2.6e6
DISCRIMINATOR = compute_discriminator(1.023e6 / RATE_HZ, 0.25)
BIT = 20


def give_zero(t):
    """Return zeros: no phase of the signal beside the loop's."""
    return np.zeros_like(t)


def draw_rows(rng, cn0_dbhz, n_frames, *, beside_cyc=give_zero, code_chips=0.0, offset=7, bits=True):
    """Draw code periods of one channel, frame by frame, with the signal's phase beside a fixed loop.

    offset : of the bits' beginning, periods. Early and late are the line of the discriminator about the prompt.
    """
    n = 100 * n_frames
    period = np.arange(n)
    t = (period + 0.5) * 1e-3
    bit = np.where((period - offset) // BIT % 3 == 0, -1.0, 1.0) if bits else 1.0
    rows = np.zeros((n, k.OUT_TAPS + 6))
    rows[:, k.OUT_START] = period * 2600
    rows[:, k.OUT_PERIOD] = period
    amplitude = np.sqrt(2.0 * 10.0 ** (0.1 * cn0_dbhz) * 1e-3)
    signal = amplitude * bit * np.exp(2j * np.pi * beside_cyc(t))
    noise = rng.normal(size=(n, 3)) + 1j * rng.normal(size=(n, 3))
    gain = 0.5 * DISCRIMINATOR.gain * code_chips
    # E - L carries noise of its own: variance 2 noise_chips2 gain^2 of the prompt's.
    apart = np.sqrt(0.5 * DISCRIMINATOR.noise_chips2) * DISCRIMINATOR.gain * noise[:, 1]
    taps = np.stack([signal * (0.9 + gain) + apart, signal + noise[:, 0], signal * (0.9 - gain) - apart], axis=1)
    rows[:, k.OUT_TAPS :: 2], rows[:, k.OUT_TAPS + 1 :: 2] = taps.real, taps.imag
    return rows.reshape(n_frames, 1, 100, -1)


def build_measured(frames, cn0_dbhz, *, bit_start=7.0, withheld=()):
    """Build the table of a channel of known strength, a row every two frames. withheld : rows not given out."""
    state = np.zeros((1, k.N_STATE))
    state[0, [k.RESIDUAL, k.CODE_MINUS_CARRIER]] = np.nan
    state[0, k.BIT_START] = bit_start
    state[0, k.CN0_DBHZ] = cn0_dbhz
    counts = np.array([100])
    tables = []
    for i in range(1, len(frames), 2):
        table, *_ = m.measure(
            state, (frames[i - 1], counts), (frames[i], counts), 0.1 * i, RATE_HZ, 0.0, GPS_L1_CA, DISCRIMINATOR
        )
        tables.append(table[0])
        if len(tables) - 1 not in withheld:
            state[0, k.SLIPPED] = 0.0
    return np.array(tables)


def scale_spread(values, sigma):
    return float(np.std(values) / np.sqrt(np.mean(sigma**2)))


@pytest.mark.parametrize("cn0_dbhz", [28.0, 35.0, 45.0])
def test_errors_are_as_large_as_stated(cn0_dbhz):
    table = build_measured(draw_rows(np.random.default_rng(1), cn0_dbhz, 1600), cn0_dbhz)
    for value, sigma in ((m.CARRIER_CYC, m.CARRIER_SIGMA_CYC), (m.DOPPLER_HZ, m.DOPPLER_SIGMA_HZ)):
        assert 0.92 < scale_spread(table[:, value], table[:, sigma]) < 1.12
    code_s = table[:, m.PERIODS] * 1e-3 + table[:, m.FRACTION_S] - 0.1 * np.arange(1, 1600, 2)
    assert 0.92 < scale_spread(code_s, table[:, m.CODE_SIGMA_S]) < 1.12


def test_sigmas_are_the_bounds_of_theory():
    table = build_measured(draw_rows(np.random.default_rng(2), 45.0, 200), 45.0)
    energy = 10**4.5 * 0.2
    assert np.median(table[:, m.CARRIER_SIGMA_CYC]) == pytest.approx(np.sqrt(9 / 8 / energy) / 2 / np.pi, rel=0.03)
    assert np.median(table[:, m.DOPPLER_SIGMA_HZ]) == pytest.approx(np.sqrt(6 / energy) / 2 / np.pi / 0.2, rel=0.03)
    expected_s = np.sqrt(DISCRIMINATOR.noise_chips2 / energy) / 1.023e6
    assert np.median(table[:, m.CODE_SIGMA_S]) == pytest.approx(expected_s, rel=0.03)


@pytest.mark.parametrize("cn0_dbhz", [25.0, 30.0, 40.0, 55.0])
def test_the_strength_reported_has_no_bias(cn0_dbhz):
    table = build_measured(draw_rows(np.random.default_rng(3), cn0_dbhz, 2000), cn0_dbhz)
    mean_dbhz = 10.0 * np.log10(np.mean(10.0 ** (0.1 * table[:, m.CN0_DBHZ])))
    assert abs(mean_dbhz - cn0_dbhz) < 0.1


def test_an_error_of_the_loops_code_is_measured_away():
    table = build_measured(draw_rows(np.random.default_rng(4), 80.0, 20, code_chips=0.05), 80.0)
    late_s = 0.1 * np.arange(1, 20, 2) - table[:, m.PERIODS] * 1e-3 - table[:, m.FRACTION_S]
    np.testing.assert_allclose(late_s, -0.05 / 1.023e6, atol=1e-3 / 1.023e6)


def test_an_accelerating_phase_biases_neither_phase_nor_rate():
    # 103 Hz/s, 2 g: the mean over a bit of such a phase is not its value in the middle, by 0.0017 cycle.
    rate_hz_s = 103.0

    def beside_cyc(t):
        return 0.5 * rate_hz_s * (t % 0.2 - 0.1) ** 2  # each block its own, without steps

    table = build_measured(draw_rows(np.random.default_rng(5), 70.0, 40, beside_cyc=beside_cyc), 70.0)
    carrier_cyc = table[:, m.CARRIER_CYC] - 0.5 * np.rint(2.0 * table[:, m.CARRIER_CYC])
    assert abs(np.mean(carrier_cyc)) < 2e-4
    assert np.abs(table[:, m.DOPPLER_HZ]).max() < 0.02


@pytest.mark.parametrize("bits_known", [True, False])
@pytest.mark.parametrize("cn0_dbhz", [33.0, 35.0, 40.0])
def test_a_held_phase_never_slips_nor_is_said_to(cn0_dbhz, bits_known):
    # Ten minutes and all places of bits in a block: its first and last group may be a single period.
    offsets = range(1, BIT, 3)
    for offset in offsets:
        frames = draw_rows(np.random.default_rng(offset), cn0_dbhz, 6000 // len(offsets), offset=offset)
        table = build_measured(frames, cn0_dbhz, bit_start=offset if bits_known else -1.0)
        assert np.abs(np.diff(table[:, m.CARRIER_CYC])).max() < 0.3
        assert not table[:, m.SLIP].any()


@pytest.mark.parametrize("slipped_cyc", [0.5, -0.5, 1.0])
@pytest.mark.parametrize("takes_s", [0.08, 0.15])
@pytest.mark.parametrize("cn0_dbhz", [33.0, 45.0])
def test_a_slip_of_the_loop_is_repaired_and_reported(slipped_cyc, takes_s, cn0_dbhz):
    # The signal walks away from the loop by half cycles, as fast as loops of 6 to 15 Hz slip.
    takes_s *= abs(slipped_cyc) / 0.5

    def beside_cyc(t):
        return slipped_cyc * np.clip((t - 4.05) / takes_s, 0.0, 1.0)

    table = build_measured(draw_rows(np.random.default_rng(6), cn0_dbhz, 100, beside_cyc=beside_cyc), cn0_dbhz)
    moved = np.mean(table[25:, m.CARRIER_CYC]) - np.mean(table[:19, m.CARRIER_CYC])
    assert moved == pytest.approx(-slipped_cyc, abs=0.02)
    slips_s = 0.1 + 0.2 * np.flatnonzero(table[:, m.SLIP])
    assert slips_s.size
    assert ((slips_s > 3.9) & (slips_s < 4.8)).all()
    assert not table[:19, m.TURNED].any()
    assert (table[25:, m.TURNED] == (abs(slipped_cyc) == 0.5)).all()


def test_a_slip_in_an_omitted_row_is_reported_in_the_next():
    def beside_cyc(t):
        return 0.5 * np.clip((t - 4.05) / 0.08, 0.0, 1.0)

    frames = draw_rows(np.random.default_rng(6), 45.0, 100, beside_cyc=beside_cyc)
    assert np.flatnonzero(build_measured(frames, 45.0)[:, m.SLIP]).tolist() == [20]
    assert np.flatnonzero(build_measured(frames, 45.0, withheld=(20,))[:, m.SLIP]).tolist() == [20, 21]


@pytest.mark.parametrize("jump_cyc", [0.25, 0.3])
def test_a_jump_that_may_be_either_is_said(jump_cyc):
    # Half a cycle at once is a data bit, and a whole one is nothing; what lies between may be either. The loop then
    # settles at the half cycle that is nearer.
    def beside_cyc(t):
        settled = 0.5 if jump_cyc > 0.25 else 0.0
        return np.where(t > 4.067, settled + (jump_cyc - settled) * np.exp(-np.maximum(t - 4.067, 0.0) / 0.03), 0.0)

    table = build_measured(draw_rows(np.random.default_rng(8), 40.0, 100, beside_cyc=beside_cyc), 40.0)
    assert np.flatnonzero(table[:, m.SLIP]).tolist() == [20]
    assert table[20, m.JUMP] > 6.0
    assert np.delete(table[:, m.JUMP], 20).max() < 6.0


def test_signals_that_fade_at_once_have_not_jumped():
    # From 42 to 24 dB-Hz within a block: what noise does then must not look like samples that are missing.
    strong = draw_rows(np.random.default_rng(9), 42.0, 20)
    noise = draw_rows(np.random.default_rng(10), -100.0, 20)
    faded = (strong - noise) * 10.0**-0.9 + noise
    jumps = [build_measured(np.concatenate([strong[:11], faded[11:]]), 42.0)[5:, m.JUMP]]
    assert np.max(jumps) < 6.0
