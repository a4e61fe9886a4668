"""Correlation grids from samples: their shape, noise and zero, against a sum over samples written out plainly."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from skyproof.decomposition.correlation import band_share, correlation
from skyproof.decomposition.fit import decompose, taps_dictionary
from skyproof.gnss.codes import generate_ca_code
from skyproof.gnss.constants import CA_CHIP_RATE_HZ, L1_HZ
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.receiver import kernels as k
from skyproof.receiver.grids import GridCorrelator, Grids, is_disturbed, noise_delays
from skyproof.receiver.tracking import Receiver, ReceiverSettings, ReceiverState
from skyproof.records import CcafAsked

RATE_HZ, IF_HZ, PRN = 4e6, 50e3, 7
ASKED = CcafAsked(reach_chips=1.5, every_s=0.2, soon_s=0.2, dopplers_hz=(-25.0, 0.0, 25.0))
FRAME = 400_000
FIRST = 37


def filter_code(prn=PRN, points=64):
    """Filter one period of the code by a low-pass of 3.2 MHz, `points` a chip, to mean square 1."""
    line = np.fft.rfftfreq(1023 * points, 1.0 / points)
    chips = np.fft.rfft(np.repeat(generate_ca_code(prn).astype(float), points))
    falling = np.clip((np.abs(line) * CA_CHIP_RATE_HZ / 1.6e6 - 0.75) / 0.5, 0.0, 1.0)
    code = np.fft.irfft(chips * (0.5 + 0.5 * np.cos(np.pi * falling)))
    return code / np.sqrt(np.mean(code**2))


CODE = filter_code()


def draw_samples(late_chips, doppler_hz, amplitude, rng, *, bits=True, noise=1.0, seconds=0.1):
    """Draw samples with signals (n,) that start `late_chips` after sample `FIRST`, at one carrier, with one message."""
    n = int(seconds * RATE_HZ) + 5000
    t = (np.arange(n) - FIRST) / RATE_HZ
    wave = np.zeros(n, complex)
    message = rng.choice([-1.0, 1.0], 40) if bits else np.ones(40)
    for late, size in zip(np.atleast_1d(late_chips), np.atleast_1d(amplitude), strict=True):
        if size == 0.0:
            continue
        chips = t * CA_CHIP_RATE_HZ * (1.0 + doppler_hz / L1_HZ) - late
        code = CODE[np.floor(chips * 64).astype(int) % CODE.size]
        sent = message[np.floor(chips / 1023.0 / 20.0).astype(int) + 5]
        wave += size * code * sent * np.exp(2j * np.pi * (IF_HZ + doppler_hz) * t)
    wave += noise * (rng.standard_normal(n) + 1j * rng.standard_normal(n))
    return np.stack([wave.real, wave.imag]).astype(np.float32)


def make_rows(doppler_hz, *, count=100, wander_chips=0.0, rng=None):
    """Make the rows that loops would have written of code periods that begin at sample `FIRST`."""
    rows = np.zeros((1, count + 4, k.row_size(3, 1)))
    per_sample = CA_CHIP_RATE_HZ * (1.0 + doppler_hz / L1_HZ) / RATE_HZ
    for r in range(count):
        start = FIRST + int(np.ceil(r * 1023 / per_sample - 1e-9))
        wander = 0.0 if rng is None else wander_chips * rng.standard_normal()
        rows[0, r, k.OUT_START] = start
        rows[0, r, k.OUT_CHIP] = (start - FIRST) * per_sample - r * 1023 + wander
        rows[0, r, k.OUT_PHASE] = (IF_HZ + doppler_hz) * (start - FIRST) / RATE_HZ
        rows[0, r, k.OUT_FREQUENCY] = IF_HZ + doppler_hz
        rows[0, r, k.OUT_PERIOD] = 1000 + r
    return rows, np.array([count])


def take_grids(samples, rows, asked=ASKED, bit_start=0.0):
    correlator = GridCorrelator(asked, RATE_HZ, IF_HZ, GPS_L1_CA, 32)
    with ThreadPoolExecutor(1) as threads:
        grids = correlator.take(
            samples, 0, rows, np.array([bit_start]), [f"G{PRN:02d}"], np.array([5]), 0.0, threads, 1
        )
    return grids, correlator


def test_a_signal_has_the_shape_of_its_band_at_its_delay():
    rng = np.random.default_rng(1)
    late, doppler_hz = 0.21, 1234.0
    samples = draw_samples(late, doppler_hz, 3.0, rng, noise=0.0)
    rows = make_rows(doppler_hz, wander_chips=0.02, rng=rng)
    grids, correlator = take_grids(samples, rows)
    assert len(grids) == 4
    per_s = CA_CHIP_RATE_HZ * (1.0 + doppler_hz / L1_HZ)
    # What the zero of each grid shows at the common time, against the signal there.
    delay_chips = (grids.fraction_s + (grids.periods - 1000) * 1e-3) * CA_CHIP_RATE_HZ
    true = (grids.elapsed_s - FIRST / RATE_HZ) * per_s - late
    table = taps_dictionary(tuple(correlator.delays_chips.tolist()), correlator.band_hz, GPS_L1_CA)
    found = decompose(grids.value[:, 1].astype(complex), table, signals=1, noise_variance=1e-6)
    np.testing.assert_allclose(delay_chips - true, found.delay_chips[:, 0], atol=0.004)
    like = correlation(correlator.delays_chips - found.delay_chips, correlator.band_hz, GPS_L1_CA)
    peak = np.abs(found.amplitude)
    np.testing.assert_allclose(np.abs(grids.value[:, 1]), np.abs(found.amplitude * like), atol=0.09 * peak.max())
    beside = np.abs(grids.value[:, [0, 2]]).max(axis=2) / np.abs(grids.value[:, 1]).max(axis=1)[:, None]
    np.testing.assert_allclose(beside, np.sinc(0.5), atol=0.01)
    assert peak == pytest.approx(
        3.0 * band_share(correlator.band_hz, GPS_L1_CA) / np.sqrt(band_share(3.2e6, GPS_L1_CA)), rel=0.05
    )


def test_noise_has_the_stated_variance_and_covariance():
    rng = np.random.default_rng(2)
    values, variances = [], []
    for _ in range(25):
        grids, correlator = take_grids(draw_samples(0.0, 0.0, 0.0, rng), make_rows(0.0))
        values.append(grids.value)
        variances.append(grids.noise_variance)
    value = np.concatenate(values).astype(complex)  # (100, dopplers, delays)
    variance = float(np.mean(variances))
    delays, bins = correlator.delays_chips, correlator.dopplers_hz
    found = np.einsum("ndi,nej->diej", value, value.conj()) / len(value)
    lag = correlation(delays[:, None] - delays, correlator.band_hz, GPS_L1_CA)
    apart = np.sinc((bins[:, None] - bins) * 0.02)
    stated = variance * np.einsum("de,ij->diej", apart, lag)
    assert np.abs(found - stated).max() < 5.0 * variance / np.sqrt(len(value))
    assert np.mean(np.abs(value) ** 2) == pytest.approx(variance, rel=0.05)
    spread = np.var(variances) / variance**2 * correlator.noise_samples
    assert 0.5 < spread < 2.0  # as many independent values as it says


def test_bits_are_taken_off_over_longer_intervals():
    rng = np.random.default_rng(3)
    asked = CcafAsked(reach_chips=1.0, every_s=0.2, soon_s=0.2, coherent_s=0.08, intervals=1)
    samples = draw_samples(0.0, -800.0, 0.3, rng)
    long, _ = take_grids(samples, make_rows(-800.0), asked)
    short, correlator = take_grids(samples, make_rows(-800.0))
    middle, at = correlator.delays_chips.size // 2, long.value.shape[2] // 2
    assert np.abs(long.value[0, 0, at]) == pytest.approx(np.abs(short.value[:, 1, middle]).mean(), rel=0.05)
    assert long.noise_variance[0] == pytest.approx(short.noise_variance.mean() / 4.0, rel=0.8)


def test_without_bits_or_with_too_few_periods_there_is_no_grid():
    samples = draw_samples(0.0, 0.0, 1.0, np.random.default_rng(4))
    assert len(take_grids(samples, make_rows(0.0), bit_start=-1.0)[0]) == 0
    assert len(take_grids(samples, make_rows(0.0, count=70))[0]) == 0
    # Bits that begin later leave room for the whole of it.
    assert len(take_grids(samples, make_rows(0.0), bit_start=19.0)[0]) == 4


@pytest.mark.parametrize("prn", [1, 7, 32])
def test_noise_is_measured_where_the_code_is_quiet(prn):
    code = generate_ca_code(prn).astype(int)
    lags = np.array(noise_delays(GPS_L1_CA, f"G{prn:02d}"), int)
    assert len(set(lags)) == 16
    assert np.abs(lags).min() > 3
    assert {int(code @ np.roll(code, lag + d)) for lag in lags for d in (-1, 0, 1)} == {-1}


def test_much_is_at_stake_when_several_signals_change_at_once():
    mean = np.full(8, 45.0)
    moved = mean.copy()
    moved[:2] -= 6.0
    assert not is_disturbed(moved, mean, 0.2)
    moved[2] += 3.0
    assert is_disturbed(moved, mean, 0.2)
    rng = np.random.default_rng(5)
    noisy = mean + 0.4 * rng.standard_normal((2000, 8))
    assert sum(is_disturbed(levels, mean, 0.2) for levels in noisy) <= 2


def test_a_receiver_takes_grids_about_its_pseudorange(clean):
    # Of 4 s, in two pieces as in one.
    rate = clean.samples.rate_hz
    settings = ReceiverSettings(
        grids=CcafAsked(reach_chips=1.0, every_s=0.4, soon_s=0.2),
        sats=tuple(s.id.sat for s in clean.scene.skies[0].signals),
    )
    planes = clean.planes[:, : int(4.0 * rate)]
    whole, _ = Receiver(rate, settings=settings).step(ReceiverState(), planes)
    receiver, state, parts = Receiver(rate, settings=settings), ReceiverState(), []
    for part in np.array_split(planes, [int(1.3 * rate)], axis=1):
        output, state = receiver.step(state, part)
        parts.append(output.grids)
    grids, pieces = whole.grids, Grids.join(parts)
    np.testing.assert_array_equal(grids.value, pieces.value)
    np.testing.assert_array_equal(grids.fraction_s, pieces.fraction_s)
    measured, off_s, sigma_s = whole.measurements, [], []
    for row in range(len(grids)):
        arc = np.flatnonzero(measured.arc == grids.arc[row])
        near = arc[np.argmin(np.abs(measured.elapsed_s[arc] - grids.elapsed_s[row]))]
        after_s = grids.elapsed_s[row] - measured.elapsed_s[near]
        table = measured.table[near]
        code_s = (table[0] - grids.periods[row]) * 1e-3 + table[1] + after_s * (1.0 + table[3] / L1_HZ)
        off_s.append(grids.fraction_s[row] - code_s)
        sigma_s.append(table[5])
    assert len(grids) > 100
    # The zero is where the loop stood, which follows the signal with a noise below that of one measurement.
    assert np.abs(off_s).max() < 10.0 * np.mean(sigma_s)
    assert abs(np.mean(off_s)) < 2.0 * np.mean(sigma_s)
