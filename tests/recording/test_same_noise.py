"""The same noise in two recordings is seen, and common signals are never taken for it, however strong."""

import numpy as np
import pytest

from skyproof.gnss.signals import GPS_L1_CA
from skyproof.recording.same_noise import (
    EXPLAINED,
    N_ROWS,
    bound_explained,
    correlate_noise,
    cut_rows,
    find_usable_hz,
    remove_repetition,
)

RATE_HZ = 2.6e6
N = round(N_ROWS * 1e-3 * RATE_HZ)
CELLS = int(find_usable_hz(RATE_HZ, 0.0, real=False) * 1e-3)


def draw_noise(rng, n=N):
    return rng.normal(size=n) + 1j * rng.normal(size=n)


def draw_sky(rng, *, cn0_dbhz=45.0, sats=10, rate_hz=RATE_HZ):
    """Draw signals with bits at two antennas, 0.37 us later and 150 Hz higher at the other; noise variance 2."""
    n = round(N_ROWS * 1e-3 * rate_hz)
    sums = np.zeros((2, n), complex)
    for sat in range(1, sats + 1):
        delay_s, doppler_hz, phase = rng.uniform(0.0, 1e-3), rng.uniform(-4000.0, 4000.0), rng.random()
        bits, first = rng.choice([-1, 1], 20), rng.integers(20)
        for k, (later_s, higher_hz) in enumerate(((0.0, 0.0), (0.37e-6, 150.0))):
            t_s = np.arange(n) / rate_hz - later_s
            chips = (t_s - delay_s) * 1.023e6 * (1.0 + doppler_hz / 1575.42e6)
            number = np.floor(chips).astype(int)
            wave = GPS_L1_CA.code(sat)[number % 1023] * bits[(number // 1023 + first) // 20]
            sums[k] += wave * np.exp(2j * np.pi * ((doppler_hz + higher_hz) * t_s + phase))
    return np.sqrt(2.0 * 10.0 ** (cn0_dbhz / 10.0) / rate_hz) * sums


def quantize(wave, bits):
    planes = np.stack([wave.real, wave.imag]).astype(np.float32)
    if bits is None:
        return planes
    size = 1.0 if bits == 1 else np.where(np.abs(planes) > np.sqrt(np.mean(planes**2)), 3.0, 1.0)
    return (np.sign(planes) * size).astype(np.float32)


def compare(first, second):
    return correlate_noise(first, second, period_s=GPS_L1_CA.period_s)


def find(first, second, carrier_cycles=0.0):
    return compare(cut_rows(first, carrier_cycles, CELLS), cut_rows(second, carrier_cycles, CELLS))


@pytest.mark.parametrize("bits", [1, 2, None])
def test_a_copy_is_seen_whatever_its_shift_and_its_gain(bits):
    rng = np.random.default_rng(1)
    original = quantize(draw_sky(rng)[0] + draw_noise(rng), bits)
    reported = find(original, 0.37 * np.roll(original, 3, axis=1))
    assert reported.coefficient > 0.97  # a lag between two that are tried loses up to 2.5 %
    assert reported.lag_s == pytest.approx(3.0 / RATE_HZ, abs=2e-9)
    assert reported.p_value < 1e-12


@pytest.mark.parametrize(("share", "least"), [(0.01, 0.96), (0.2, 0.5)])
def test_turned_bits_hide_no_copy(share, least):
    rng = np.random.default_rng(2)
    original = quantize(draw_sky(rng)[0] + draw_noise(rng), 1)
    reported = find(original, np.where(rng.random(original.shape) < share, -original, original))
    assert reported.coefficient > least
    assert reported.p_value < 1e-12


@pytest.mark.parametrize("own_db", [-10.0, 0.0])
def test_two_receivers_on_one_antenna_are_seen(own_db):
    # Each with noise of its own, and with a carrier of its own.
    rng = np.random.default_rng(3)
    antenna = draw_sky(rng)[0] + draw_noise(rng)
    turn = np.exp(2j * np.pi * 90.0 * np.arange(N) / RATE_HZ)
    own_amplitude = 10.0 ** (own_db / 20.0)
    reported = find(
        quantize(antenna + own_amplitude * draw_noise(rng), None),
        quantize(antenna * turn + own_amplitude * draw_noise(rng), None),
    )
    assert reported.coefficient == pytest.approx(1.0 / (1.0 + own_amplitude**2), abs=0.03)
    assert reported.p_value < 1e-12


def test_a_recording_of_another_rate_and_kind_is_compared():
    rng = np.random.default_rng(4)
    antenna = np.fft.fftshift(np.fft.fft(draw_sky(rng)[0] + draw_noise(rng)))
    wide = np.zeros(4 * N, complex)  # real samples at four times the rate
    middle = 2 * N + round(0.7 * N)
    wide[middle - N // 2 : middle - N // 2 + N] = antenna
    real = np.fft.ifft(np.fft.ifftshift(wide)).real
    first = quantize(np.fft.ifft(np.fft.ifftshift(antenna)), 1)
    reported = compare(
        cut_rows(first, 0.0, CELLS),
        cut_rows(np.stack([np.sign(real), 0.0 * real]).astype(np.float32), 0.7 / 4.0, CELLS),
    )
    assert reported.coefficient > 0.6
    assert abs(reported.lag_s) < 1e-8


def draw_common_signals(rng, stronger_db, sats, bits):
    first, second = draw_sky(rng, cn0_dbhz=45.0 + stronger_db, sats=sats)
    return find(quantize(first + draw_noise(rng), bits), quantize(second + draw_noise(rng), bits))


@pytest.mark.parametrize(
    ("stronger_db", "sats", "bits"), [(0, 10, 1), (10, 10, 2), (15, 4, 1), (20, 10, 1), (30, 10, None)]
)
def test_common_signals_are_no_common_noise(stronger_db, sats, bits):
    reported = draw_common_signals(np.random.default_rng(5), stronger_db, sats, bits)
    assert reported.p_value == 1.0


@pytest.mark.long
@pytest.mark.parametrize("sats", [4, 10, 20, 32])
@pytest.mark.parametrize("bits", [1, 2, None])
def test_no_strength_of_common_signals_is_taken_for_common_noise(sats, bits):
    # What is left in common stays below half of what is taken to be explained.
    rng = np.random.default_rng([6, sats, bits or 0])
    for stronger_db in range(0, 31, 3):
        first, second = draw_sky(rng, cn0_dbhz=45.0 + stronger_db, sats=sats)
        rows = [cut_rows(quantize(item + draw_noise(rng), bits), 0.0, CELLS) for item in (first, second)]
        remaining = [remove_repetition(item)[0] for item in rows]
        reported = compare(*rows)
        repeats = max(
            1.0 - np.sum(np.abs(b) ** 2) / np.sum(np.abs(a) ** 2) for a, b in zip(rows, remaining, strict=True)
        )
        assert reported.p_value == 1.0
        assert reported.coefficient < 0.5 * bound_explained(float(repeats))


@pytest.mark.long
def test_independent_noise_shares_nothing():
    rng = np.random.default_rng(7)
    for _ in range(30):
        first, other = (draw_noise(rng, N_ROWS * 512).reshape(N_ROWS, 512).astype(np.complex64) for _ in range(2))
        reported = compare(first, other)
        assert reported.p_value == 1.0
        assert reported.coefficient < 0.5 * EXPLAINED


@pytest.mark.long
def test_explained_correlation_alarms_no_more_than_stated():
    # Noise that has in common just what signals may have: at one lag, so that the bound over all lags is ample.
    rng, wanted, cells = np.random.default_rng(8), 0.2, 512
    alarms, coefficients = 0, []
    for _ in range(60):
        common, first, other = (draw_noise(rng, N_ROWS * cells).reshape(N_ROWS, cells) for _ in range(3))
        own_amplitude = np.sqrt(1.0 / EXPLAINED - 1.0)
        reported = compare(
            (common + own_amplitude * first).astype(np.complex64), (common + own_amplitude * other).astype(np.complex64)
        )
        alarms += reported.p_value < wanted
        coefficients.append(reported.coefficient)
    assert alarms <= 20  # 12 are stated; twice the sigma more
    assert np.mean(coefficients) == pytest.approx(EXPLAINED, rel=0.05)


def test_the_bound_grows_with_what_repeats():
    assert bound_explained(0.1) == EXPLAINED
    assert EXPLAINED < bound_explained(0.5) < bound_explained(0.6) < bound_explained(0.64) == 1.0


@pytest.mark.parametrize("bits", [1, None])
def test_two_antennas_have_nothing_in_common_but_signals(bits):
    rng = np.random.default_rng(8)
    first, second = (quantize(wave + draw_noise(rng), bits) for wave in draw_sky(rng))
    assert find(first, second).of_two_antennas


def test_receivers_that_add_noise_to_one_antenna_are_not_two():
    rng = np.random.default_rng(9)
    antenna, own_amplitude = draw_sky(rng)[0] + draw_noise(rng), 10.0 ** (10.0 / 20.0)
    one, other = (quantize(antenna + own_amplitude * draw_noise(rng), None) for _ in range(2))
    assert not find(one, other).of_two_antennas


def test_where_nearly_all_repeats_noise_shows_nothing():
    rng = np.random.default_rng(10)
    wave = draw_sky(rng, cn0_dbhz=130.0, sats=1)
    assert not find(*(quantize(one, None) for one in wave)).of_two_antennas
