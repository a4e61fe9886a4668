"""The search: what it finds, how exactly, what it takes out, and how often it finds what is not there."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal as filters
from scipy import stats
from tests.recordings import COMPLEX_4, CTTC, REAL_12, REAL_24

from skyproof.gnss.signals import GPS_L1_CA, GPS_SATS, prn_of
from skyproof.receiver.acquisition import KnownSignal, Searcher, SearchSettings, _is_in_arcs
from skyproof.receiver.calibration import fit_tail, tail_exponent
from skyproof.receiver.cancellation import measure, remove, separation_chips
from skyproof.receiver.fourier import N_CELLS, correlate_rows

GRID = np.arange(-10, 11) * 500.0
EVERYWHERE = {sat: GRID for sat in GPS_SATS}
RATE_HZ = 2.6e6
CHIP_S = 1.0 / 1.023e6
NEAR = SearchSettings(coherent_periods=4, n_sums=10)


def draw_wave(rng, n, sat, cn0_dbhz, delay_s, doppler_hz, rate_hz=RATE_HZ):
    """Draw one signal with random bits and phase, beside noise of variance 2 a complex sample."""
    k = np.arange(n)
    chips = (k / rate_hz - delay_s) * 1.023e6 * (1.0 + doppler_hz / 1575.42e6)
    number = np.floor(chips / 1023 / 20 + rng.integers(20) / 20).astype(int)
    bits = rng.choice([-1, 1], n // int(0.02 * rate_hz) + 3)[number + 1]
    code = GPS_L1_CA.code(prn_of(sat))[np.floor(chips).astype(int) % 1023]
    turns = doppler_hz / rate_hz * k + rng.random()
    return np.sqrt(2.0 * 10.0 ** (cn0_dbhz / 10.0) / rate_hz) * code * bits * np.exp(2j * np.pi * turns)


def draw_noise(rng, n):
    return rng.normal(size=n) + 1j * rng.normal(size=n)


def quantize_planes(samples):
    return np.stack([samples.real, samples.imag]).astype(np.float32)


def measure_apart_chips(delay_s, truth_s):
    return ((delay_s - truth_s + 0.5e-3) % 1e-3 - 0.5e-3) / CHIP_S


def make_near_grid(doppler_hz, settings=NEAR, reach_hz=250.0):
    steps = int(reach_hz // settings.doppler_step_hz)
    return (round(doppler_hz / settings.doppler_step_hz) + np.arange(-steps, steps + 1.0)) * settings.doppler_step_hz


# ---------------------------------------------------------------------- the kernel


def test_the_kernel_equals_its_numpy_twin():
    rng = np.random.default_rng(1)
    spectra = rng.normal(size=(2, 3, 2, N_CELLS)).astype(np.float32)
    codes = rng.normal(size=(2, 2, N_CELLS)).astype(np.float32)
    row, code = np.array([0, 1, 1]), np.array([1, 0, 1])
    power, highest = np.empty((3, N_CELLS), np.float32), np.empty(3, np.float32)
    correlate_rows(spectra, codes, row, code, 0, 3, power, highest)
    product = (spectra[row, :, 0] + 1j * spectra[row, :, 1]) * (codes[code, 0] + 1j * codes[code, 1])[:, None]
    twin = np.sum(np.abs(np.fft.ifft(product)) ** 2, axis=1)
    twin /= twin.mean(axis=-1, keepdims=True)
    np.testing.assert_allclose(power, twin, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(highest, twin.max(axis=-1), rtol=1e-5)


# ---------------------------------------------------------------------- what is found


def test_the_satellites_of_the_sky_are_found_and_no_others(clean):
    searcher = Searcher(GPS_L1_CA, clean.samples.rate_hz, SearchSettings())
    peaks = searcher.search(clean.planes, 0.0, EVERYWHERE, {})
    in_sky = {heard.id.sat for heard in clean.scene.skies[0].signals}
    assert {peak.sat for peak in peaks} == in_sky
    assert len(peaks) == len(in_sky)


def test_delay_is_within_a_tenth_chip_and_doppler_within_10_hz(clean):
    searcher = Searcher(GPS_L1_CA, clean.samples.rate_hz, SearchSettings())
    sky = clean.scene.skies[0]
    start = 1_000_000
    peaks = searcher.search(clean.planes[:, start:], 0.0, EVERYWHERE, {})
    true_s = start / clean.samples.rate_hz + sky.true_minus_elapsed_s(start / clean.samples.rate_hz)
    assert peaks
    for peak in peaks:
        column = [heard.id.sat for heard in sky.signals].index(peak.sat)
        # Scenes start at whole seconds, so code periods begin at whole milliseconds of transmission.
        truth_s = (sky.code_delay_s(true_s)[column] - true_s) % 1e-3
        assert abs(measure_apart_chips(peak.delay_s, truth_s)) < 0.1
        rate = sky.carrier_delay_rate(true_s)[column]
        drift = sky.receiver.lo_ppm * 1e-6
        assert peak.doppler_hz == pytest.approx(-1575.42e6 * (rate + drift), abs=10.0)


def test_both_copies_are_found_once_the_meaconer_is_on(meaconer):
    searcher = Searcher(GPS_L1_CA, meaconer.samples.rate_hz, SearchSettings())
    start = int(4.0 * meaconer.samples.rate_hz)
    peaks = searcher.search(meaconer.planes[:, start:], 0.0, EVERYWHERE, {})
    in_sky = sorted(heard.id.sat for heard in meaconer.scene.skies[0].signals)
    assert sorted(peak.sat for peak in peaks) == in_sky


def test_what_is_known_is_not_found_again(clean):
    searcher = Searcher(GPS_L1_CA, clean.samples.rate_hz, SearchSettings())
    known = {
        peak.sat: [KnownSignal(delay_s=peak.delay_s, doppler_hz=peak.doppler_hz)]
        for peak in searcher.search(clean.planes, 0.0, EVERYWHERE, {})
    }
    assert known
    assert searcher.search(clean.planes, 0.0, EVERYWHERE, known) == []


@pytest.mark.parametrize("rate_hz", [2.6e6, 4.0e6, 5.456e6, 16.3676e6])
def test_any_sample_rate_will_do(rate_hz):
    rng = np.random.default_rng(4)
    searcher = Searcher(GPS_L1_CA, rate_hz, SearchSettings())
    n = searcher.n_samples
    samples = draw_wave(rng, n, "G09", 46.0, 321.7 * CHIP_S, 1510.0, rate_hz) + draw_noise(rng, n)
    (peak,) = searcher.search(quantize_planes(samples), 0.0, {"G09": GRID}, {})
    assert abs(measure_apart_chips(peak.delay_s, 321.7 * CHIP_S)) < 0.1
    assert peak.doppler_hz == pytest.approx(1510.0, abs=5.0)
    assert peak.cn0_dbhz == pytest.approx(46.0, abs=1.25)  # three sigma


def test_real_samples_at_an_if_are_searched_as_well():
    rng = np.random.default_rng(6)
    rate_hz, if_hz = 12e6, 3e6
    searcher = Searcher(GPS_L1_CA, rate_hz, SearchSettings())
    n = searcher.n_samples
    turned = draw_wave(rng, n, "G09", 43.0, 50.3 * CHIP_S, -2210.0, rate_hz)
    turned *= np.exp(2j * np.pi * if_hz / rate_hz * np.arange(n))
    planes = np.stack([turned.real + rng.normal(size=n) / np.sqrt(2.0), np.zeros(n)]).astype(np.float32)
    (peak,) = searcher.search(planes, if_hz, {"G09": GRID, "G10": GRID}, {})
    assert abs(measure_apart_chips(peak.delay_s, 50.3 * CHIP_S)) < 0.1
    assert peak.doppler_hz == pytest.approx(-2210.0, abs=5.0)


def test_the_samples_asked_for_are_enough_and_left_as_they_were():
    rng = np.random.default_rng(7)
    searcher = Searcher(GPS_L1_CA, 4e6, SearchSettings(n_sums=4))
    assert searcher.n_samples == 16000  # a recording of 4 ms
    planes = quantize_planes(draw_noise(rng, 16000))
    before = planes.copy()
    searcher.search(planes, 0.0, EVERYWHERE, {"G01": [KnownSignal(delay_s=1e-4, doppler_hz=0.0)]})
    np.testing.assert_array_equal(planes, before)


# ---------------------------------------------------------------------- several signals of one satellite


def test_taking_a_signal_out_leaves_the_noise():
    rng = np.random.default_rng(8)
    n = 104_000
    alone = quantize_planes(draw_noise(rng, n))
    strong = draw_wave(rng, n, "G07", 55.0, 123.4 * CHIP_S, 2345.0)
    planes = alone + quantize_planes(strong)
    power = remove(planes, GPS_L1_CA, RATE_HZ, 0.0, [("G07", KnownSignal(delay_s=123.4 * CHIP_S, doppler_hz=2345.0))])
    # One complex amplitude a period of 2600 samples goes with it.
    assert np.sum((planes - alone) ** 2) / np.sum(np.abs(strong) ** 2) < 0.01
    assert power[0] / (2.0 * 2600.0) == pytest.approx(10.0**5.5 * 1e-3, rel=0.1)


@pytest.mark.parametrize("doppler_apart_hz", [0.0, 50.0])
@pytest.mark.parametrize(("apart", "relative_db"), [(1.5, -10.0), (4.0, -10.0), (1.0, -6.0), (8.0, 10.0)])
def test_a_second_signal_beside_a_known_one_is_found(apart, relative_db, doppler_apart_hz):
    rng = np.random.default_rng(9)
    searcher = Searcher(GPS_L1_CA, RATE_HZ, NEAR)
    n = searcher.n_samples
    found = 0
    for _ in range(10):
        delay_s, doppler_hz = rng.uniform(0.0, 1e-3), rng.uniform(-4000.0, 4000.0)
        second_s = delay_s + apart * CHIP_S
        samples = draw_noise(rng, n) + draw_wave(rng, n, "G07", 45.0, delay_s, doppler_hz)
        samples += draw_wave(rng, n, "G07", 45.0 + relative_db, second_s, doppler_hz + doppler_apart_hz)
        known = {"G07": [KnownSignal(delay_s=delay_s + 0.01 * CHIP_S, doppler_hz=doppler_hz + 1.0)]}
        peaks = searcher.search(quantize_planes(samples), 0.0, {"G07": make_near_grid(doppler_hz)}, known)
        found += len(peaks) == 1 and abs(measure_apart_chips(peaks[0].delay_s, second_s)) < 0.25
    assert found >= 9


def test_two_unknown_signals_1_5_chips_apart_are_both_found():
    rng = np.random.default_rng(10)
    searcher = Searcher(GPS_L1_CA, RATE_HZ, SearchSettings())
    n = searcher.n_samples
    samples = draw_noise(rng, n) + draw_wave(rng, n, "G07", 50.0, 0.4e-3, 1100.0)
    samples += draw_wave(rng, n, "G07", 45.0, 0.4e-3 + 1.5 * CHIP_S, 1130.0)
    peaks = searcher.search(quantize_planes(samples), 0.0, EVERYWHERE, {})
    assert [peak.sat for peak in peaks] == ["G07", "G07"]
    errors = sorted(measure_apart_chips(peak.delay_s, 0.4e-3) for peak in peaks)
    np.testing.assert_allclose(errors, [0.0, 1.5], atol=0.15)


def test_a_reflection_within_half_a_chip_is_not_another_signal():
    rng = np.random.default_rng(11)
    searcher = Searcher(GPS_L1_CA, RATE_HZ, NEAR)
    n = searcher.n_samples
    for _ in range(10):
        samples = draw_noise(rng, n) + draw_wave(rng, n, "G07", 45.0, 0.4e-3, 1100.0)
        samples += draw_wave(rng, n, "G07", 37.0, 0.4e-3 + 0.4 * CHIP_S, 1100.0)
        known = {"G07": [KnownSignal(delay_s=0.4e-3 + 0.05 * CHIP_S, doppler_hz=1100.0)]}
        assert searcher.search(quantize_planes(samples), 0.0, {"G07": make_near_grid(1100.0)}, known) == []


@pytest.mark.parametrize(("apart", "relative_db"), [(0.35, -3.0), (-0.5, -3.0), (0.5, -6.0)])
@pytest.mark.parametrize("turn_cyc", [0.0, 0.25, 0.5])
def test_a_signal_pulled_by_its_reflection_leaves_no_other(apart, relative_db, turn_cyc):
    # What one signal leaves of two has its top up to a chip from where the loop is, beyond the mask.
    rng = np.random.default_rng(18)
    searcher = Searcher(GPS_L1_CA, RATE_HZ, SearchSettings(coherent_periods=4, n_sums=5))
    n = searcher.n_samples
    reflected = 10.0 ** (relative_db / 20.0) * np.exp(2j * np.pi * turn_cyc)
    for seed in range(4):  # the same bits for both
        direct, late = (
            draw_wave(np.random.default_rng(seed), n, "G07", 47.0, 0.4e-3 + chips * CHIP_S, 1100.0)
            for chips in (0.0, apart)
        )
        planes = quantize_planes(draw_noise(rng, n) + direct + reflected * late)
        rough = KnownSignal(delay_s=0.4e-3, doppler_hz=1100.0)
        loop = measure(planes, GPS_L1_CA, RATE_HZ, 0.0, "G07", rough, doppler_reach_hz=50.0).signal
        assert searcher.search(planes, 0.0, {"G07": make_near_grid(1100.0, searcher.settings)}, {"G07": [loop]}) == []


@pytest.mark.parametrize("apart", [-1.5, -0.5, 0.5, 1.0, 1.5])
def test_overlapping_signals_separation_is_right(apart):
    rng = np.random.default_rng(19)
    n = 52_000
    first, second = (
        draw_wave(np.random.default_rng(3), n, "G07", 47.0, 0.4e-3 + chips * CHIP_S, 1100.0) for chips in (0.0, apart)
    )
    planes = quantize_planes(draw_noise(rng, n) + first - 0.6 * second)
    wrong = KnownSignal(delay_s=0.4e-3 - 0.2 * np.sign(apart) * CHIP_S, doppler_hz=1100.0)
    beyond = KnownSignal(delay_s=0.4e-3 + (apart + 0.3 * np.sign(apart)) * CHIP_S, doppler_hz=1102.0)
    reported = separation_chips(planes, GPS_L1_CA, RATE_HZ, 0.0, "G07", wrong, beyond)
    assert reported == pytest.approx(abs(apart), abs=0.15)


def test_a_strong_signal_is_not_taken_for_others_or_twice():
    # At 60 dB-Hz its side lobes and cross-correlations stand 12 dB above the noise of 20 x 1 ms.
    rng = np.random.default_rng(12)
    searcher = Searcher(GPS_L1_CA, RATE_HZ, SearchSettings())
    n = searcher.n_samples
    for _ in range(3):
        samples = draw_noise(rng, n) + draw_wave(rng, n, "G07", 60.0, rng.uniform(0.0, 1e-3), 1000.0)
        assert [p.sat for p in searcher.search(quantize_planes(samples), 0.0, EVERYWHERE, {})] == ["G07"]


def test_a_weak_satellite_is_found_below_a_strong_known_one():
    # 38 dB-Hz beside 60 dB-Hz, whole kilohertz apart, where cross-correlation is worst.
    rng = np.random.default_rng(13)
    searcher = Searcher(GPS_L1_CA, RATE_HZ, SearchSettings())
    n = searcher.n_samples
    samples = (
        draw_noise(rng, n)
        + draw_wave(rng, n, "G07", 60.0, 0.2e-3, 1000.0)
        + draw_wave(rng, n, "G11", 40.0, 0.7e-3, -2000.0)
    )
    known = {"G07": [KnownSignal(delay_s=0.2e-3, doppler_hz=1000.0)]}
    peaks = searcher.search(quantize_planes(samples), 0.0, EVERYWHERE, known)
    assert [peak.sat for peak in peaks] == ["G11"]


def test_strong_unrequested_signals_are_taken_for_none():
    # Four of 60 dB-Hz, whole kilohertz off; the weak one beside them stands 2 dB above what noise reaches.
    rng = np.random.default_rng(21)
    searcher = Searcher(GPS_L1_CA, RATE_HZ, SearchSettings(coherent_periods=4, n_sums=5))
    n, delay_s = searcher.n_samples, 0.7e-3
    grid = dict.fromkeys(GPS_SATS[:12], make_near_grid(0.0, searcher.settings))
    for _ in range(3):
        samples = draw_noise(rng, n) + draw_wave(rng, n, "G05", 38.0, delay_s, 40.0)
        for sat in ("G20", "G23", "G28", "G31"):
            samples += draw_wave(rng, n, sat, 60.0, rng.uniform(0.0, 1e-3), 1000.0 * rng.integers(-4, 5))
        (peak,) = searcher.search(quantize_planes(samples), 0.0, grid, {})
        assert peak.sat == "G05"
        assert abs(measure_apart_chips(peak.delay_s, delay_s)) < 0.5


def test_a_satellite_is_searched_at_the_requested_dopplers_only():
    rng = np.random.default_rng(22)
    searcher = Searcher(GPS_L1_CA, RATE_HZ, SearchSettings(coherent_periods=4, n_sums=5))
    n = searcher.n_samples
    samples = (
        draw_noise(rng, n)
        + draw_wave(rng, n, "G07", 60.0, 0.2e-3, 3000.0)
        + draw_wave(rng, n, "G07", 42.0, 0.6e-3, 0.0)
    )
    peaks = searcher.search(quantize_planes(samples), 0.0, {"G07": make_near_grid(0.0, searcher.settings)}, {})
    assert [abs(measure_apart_chips(peak.delay_s, 0.6e-3)) < 0.3 for peak in peaks] == [True]


# ---------------------------------------------------------------------- stretches without noise


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "made",
    [
        lambda k: np.ones(k.size),
        lambda k: np.zeros(k.size),
        lambda k: 1.0 - 2.0 * (k % 2),
        lambda k: 0.7 - (k % 37 < 20),
        lambda k: 0.7 - (k % 1000 < 400),
        lambda k: np.where(k == 12345, -1.0, 1.0),
    ],
    ids=["constant", "zeros", "alternating", "37", "1000", "one sample differs"],
)
@pytest.mark.parametrize("if_hz", [0.0, 1234.5])
def test_a_stretch_that_holds_lines_and_no_noise_gives_no_signal(made, if_hz):
    searcher = Searcher(GPS_L1_CA, RATE_HZ, SearchSettings())
    wave = made(np.arange(searcher.n_samples))
    assert searcher.search(quantize_planes(wave * (1.0 + 1.0j)), if_hz, {"G01": GRID, "G07": GRID}, {}) == []


@given(st.lists(st.tuples(st.integers(0, 29), st.integers(0, 14)), max_size=8))
def test_arcs_of_a_circle_cover_what_they_cover_one_by_one(arcs):
    middle, reach = np.array(arcs, np.int64).reshape(-1, 2).T
    one_by_one = np.zeros(30, bool)
    for k, far in zip(middle, reach, strict=True):
        one_by_one[np.arange(k - far, k + far + 1) % 30] = True
    assert np.array_equal(_is_in_arcs(middle - reach, middle + reach, 30), one_by_one)


# ---------------------------------------------------------------------- false alarms


def test_the_tail_of_white_noise_is_that_of_gamma():
    rng = np.random.default_rng(14)
    tail = fit_tail(rng.gamma(10.0, 0.1, 500_000).astype(np.float32), 10)
    assert 1.0 <= tail.scale < 1.1
    threshold = tail.threshold(1_000_000, 1e-4)
    assert float(tail_exponent(np.array(threshold), 10)) == pytest.approx(np.log(1e10), rel=0.07)
    assert tail.p_value(threshold, 1_000_000) == pytest.approx(1e-4, rel=1e-6)


def test_a_heavier_tail_raises_the_threshold():
    rng = np.random.default_rng(15)
    power = rng.gamma(10.0, 0.1, 500_000) + 0.3 * rng.exponential(size=500_000)
    tail = fit_tail((power / power.mean()).astype(np.float32), 10)
    assert tail.scale > 1.2


def _draw_white(rng, n):
    return draw_noise(rng, n)


def _color_noise(rng, n):
    return filters.lfilter(*filters.butter(3, 0.35), draw_noise(rng, n))


def _draw_with_lines(rng, n):
    turns = rng.uniform(-1e6, 1e6, (3, 1)) / RATE_HZ * np.arange(n) + rng.random((3, 1))
    return draw_noise(rng, n) + np.sum(
        10.0 ** (rng.uniform(-20.0, 5.0, (3, 1)) / 20.0) * np.exp(2j * np.pi * turns), axis=0
    )


def _draw_under_strong(rng, n):
    """Draw noise under strong satellites whole kilohertz off, where cross-correlation is worst."""
    strong = [
        draw_wave(rng, n, sat, rng.uniform(48.0, 54.0), rng.uniform(0.0, 1e-3), 1000.0 * rng.integers(-3, 4))
        for sat in ("G30", "G31", "G32")
    ]
    return draw_noise(rng, n) + sum(strong)


def _draw_strong(rng, n, first_prn, rate_hz=RATE_HZ):
    """Draw satellites from `first_prn` on, and the sum of what they send, without noise."""
    sats = [f"G{prn:02d}" for prn in rng.choice(np.arange(first_prn, 33), rng.integers(1, 5), replace=False)]
    waves = [
        draw_wave(rng, n, sat, rng.uniform(45.0, 60.0), rng.uniform(0.0, 1e-3), rng.uniform(-5e3, 5e3), rate_hz)
        for sat in sats
    ]
    return sats, sum(waves)


def _draw_under_some_strong(rng, n):
    return draw_noise(rng, n) + _draw_strong(rng, n, 13)[1]


def _draw_under_strong_in_one_bit(rng, n):
    samples = _draw_under_some_strong(rng, n)
    return np.sign(samples.real) + 1j * np.sign(samples.imag)


def _assert_hold(p_values, wanted):
    """Check that p-values are at most as frequent as stated, at that level and a fiftieth, and at least half.

    Neighbouring cells and Dopplers are not independent, so that a search holds fewer than are counted.
    """
    p_values = np.array(p_values)
    low, high = stats.binom.interval(0.999, p_values.size, wanted)
    assert 0.5 * low <= np.count_nonzero(p_values < wanted) <= high
    assert np.count_nonzero(p_values < 0.02 * wanted) <= stats.binom.ppf(0.9995, p_values.size, 0.02 * wanted)


@pytest.mark.long
@pytest.mark.parametrize(
    "made",
    [
        _draw_white,
        _color_noise,
        _draw_with_lines,
        _draw_under_strong,
        _draw_under_some_strong,
        _draw_under_strong_in_one_bit,
    ],
)
def test_false_alarms_come_at_the_stated_rate(made):
    # Near search of 12 satellites; none of those that send, where any do, is asked for.
    rng = np.random.default_rng(16)
    wanted = 0.05
    settings = SearchSettings(coherent_periods=4, n_sums=5, false_alarm_probability=wanted)
    searcher = Searcher(GPS_L1_CA, RATE_HZ, settings)
    p_values = []
    for _ in range(1500):
        centre_hz = 0.0 if made is _draw_under_strong else settings.doppler_step_hz * rng.integers(-10, 10)
        grid = {f"G{prn:02d}": make_near_grid(centre_hz, settings) for prn in range(1, 13)}
        peaks = searcher.search(quantize_planes(made(rng, searcher.n_samples)), 0.0, grid, {})
        p_values.append(min((peak.p_value for peak in peaks), default=1.0))
    _assert_hold(p_values, wanted)


@pytest.mark.long
@pytest.mark.parametrize("rate_hz", [2.6e6, 5.0e6])
def test_false_alarms_of_a_full_search_keep_the_stated_rate(rate_hz):
    rng = np.random.default_rng(20)
    wanted = 0.1
    searcher = Searcher(GPS_L1_CA, rate_hz, SearchSettings(false_alarm_probability=wanted))
    p_values = []
    for _ in range(300):
        strong_sats, strong = _draw_strong(rng, searcher.n_samples, 1, rate_hz)
        peaks = searcher.search(quantize_planes(strong + draw_noise(rng, searcher.n_samples)), 0.0, EVERYWHERE, {})
        once = {peak.sat: max(p.power for p in peaks if p.sat == peak.sat) for peak in peaks if peak.sat in strong_sats}
        assert set(once) == set(strong_sats)
        false = [peak.p_value for peak in peaks if peak.power != once.get(peak.sat)]
        p_values.append(min(false, default=1.0))
    _assert_hold(p_values, wanted)


@pytest.mark.long
@pytest.mark.parametrize("cn0_dbhz", [38.0, 45.0, 52.0])
def test_a_tracked_satellite_alone_gives_no_second_signal(cn0_dbhz):
    # 2000 searches, at 1e-4 each; tracked within 0.02 chip and 2 Hz.
    rng = np.random.default_rng(17)
    searcher = Searcher(GPS_L1_CA, RATE_HZ, SearchSettings(coherent_periods=4, n_sums=5))
    false = 0
    for _ in range(2000):
        delay_s, doppler_hz = rng.uniform(0.0, 1e-3), rng.uniform(-4000.0, 4000.0)
        samples = draw_noise(rng, searcher.n_samples) + draw_wave(
            rng, searcher.n_samples, "G07", cn0_dbhz, delay_s, doppler_hz
        )
        known_signal = KnownSignal(
            delay_s=delay_s + 0.02 * rng.normal() * CHIP_S, doppler_hz=doppler_hz + 2.0 * rng.normal()
        )
        grid = {"G07": make_near_grid(doppler_hz, searcher.settings)}
        false += bool(searcher.search(quantize_planes(samples), 0.0, grid, {"G07": [known_signal]}))
    assert false <= 2  # 0.2 are expected


# ---------------------------------------------------------------------- recordings

REAL = {
    "iq-pocketsdr/L1_20211125_004000_12MHz_I.bin": (12e6, 3e6, 87, 28, REAL_12),
    "iq-pocketsdr/L1_20211201_054600_24MHz_I.bin": (24e6, 6e6, 43, 23, REAL_24),
    "iq-pocketsdr/L1_20211202_084700_4MHz_IQ.bin": (4e6, 0.0, 100, 25, COMPLEX_4),
    "iq-pocketsdr/L2_20211202_084700_4MHz_IQ_first100ms.bin": (4e6, 0.0, 99, None, {}),
    "iq-cttc/GSoC_CTTC_capture_2012_07_26_4Msps_4ms.dat": (4e6, 0.0, 4, 30, CTTC),
}
"""Rate, intermediate frequency, periods that are continuous, the weakest satellite, and all of them: README of the
recordings."""


@pytest.mark.shared_data
@pytest.mark.parametrize("name", REAL)
def test_a_real_capture_gives_the_satellites_known_to_be_in_it(shared_data, name):
    rate_hz, if_hz, periods, weakest, in_capture = REAL[name]
    planes = _read(shared_data / "real" / name, conjugate="L1_20211202" in name)
    reach = 32 if "cttc" in name else 14
    searcher = Searcher(GPS_L1_CA, rate_hz, SearchSettings(n_sums=periods))
    peaks = searcher.search(planes, if_hz, dict.fromkeys(GPS_SATS, 500.0 * np.arange(-reach, reach + 1)), {})
    found = [prn_of(peak.sat) for peak in peaks]
    assert len(found) == len(set(found))
    assert set(found) <= set(in_capture)
    assert set(in_capture) - set(found) <= {weakest}
    for peak in peaks:
        doppler_hz, chips = in_capture[prn_of(peak.sat)]
        assert abs(measure_apart_chips(peak.delay_s, chips * CHIP_S)) < 1.0
        assert peak.doppler_hz == pytest.approx(doppler_hz, abs=50.0 if periods > 4 else 125.0)


def _read(path, *, conjugate):
    if path.suffix == ".dat":
        return np.fromfile(path, np.float32).reshape(-1, 2).T
    values = np.fromfile(path, np.int8).astype(np.float32)
    if path.stem.endswith("_I"):
        return np.stack([values, np.zeros_like(values)])
    return values.reshape(-1, 2).T * np.array([[1.0], [-1.0 if conjugate else 1.0]], np.float32)
