"""The search: what it finds, how exactly, and how often it finds what is not there."""

import numpy as np
import pytest
from scipy import stats

from skyproof.gnss.signals import GPS_L1_CA, GPS_SATS
from skyproof.receiver.acquisition import Searcher, SearchSettings

GRID = np.arange(-10, 11) * 500.0


def nothing_known(sat):
    return []


def test_the_satellites_of_the_sky_are_found_and_no_others(clean):
    searcher = Searcher(GPS_L1_CA, clean.samples.rate_hz, SearchSettings())
    peaks = searcher.search(clean.planes, 0.0, {sat: GRID for sat in GPS_SATS}, nothing_known)
    there = {heard.id.sat for heard in clean.scene.skies[0].signals}
    assert {peak.sat for peak in peaks} == there
    assert len(peaks) == len(there)


def test_delay_and_doppler_are_within_half_a_sample_and_30_hz(clean):
    searcher = Searcher(GPS_L1_CA, clean.samples.rate_hz, SearchSettings())
    sky = clean.scene.skies[0]
    start = 1_000_000
    peaks = searcher.search(clean.planes[:, start:], 0.0, {sat: GRID for sat in GPS_SATS}, nothing_known)
    true_s = start / clean.samples.rate_hz + sky.true_minus_elapsed_s(start / clean.samples.rate_hz)
    for peak in peaks:
        column = [heard.id.sat for heard in sky.signals].index(peak.sat)
        sent_s = true_s - sky.code_delay_s(true_s)[column]
        # Scenes start at whole seconds, so code periods begin at whole milliseconds of transmission.
        truth_s = (-sent_s) % 1e-3
        apart_s = (peak.delay_s - truth_s + 0.5e-3) % 1e-3 - 0.5e-3
        assert abs(apart_s) * clean.samples.rate_hz < 0.5
        rate = sky.carrier_delay_s(true_s, 1)[column]
        drift = sky.receiver.lo_ppm * 1e-6
        assert peak.doppler_hz == pytest.approx(-1575.42e6 * (rate + drift), abs=30.0)


def test_both_copies_are_found_once_the_meaconer_is_on(meaconed):
    searcher = Searcher(GPS_L1_CA, meaconed.samples.rate_hz, SearchSettings())
    start = int(4.0 * meaconed.samples.rate_hz)
    peaks = searcher.search(meaconed.planes[:, start:], 0.0, {sat: GRID for sat in GPS_SATS}, nothing_known)
    there = sorted(heard.id.sat for heard in meaconed.scene.skies[0].signals)
    assert sorted(peak.sat for peak in peaks) == there


def test_what_is_known_is_not_found_again(clean):
    searcher = Searcher(GPS_L1_CA, clean.samples.rate_hz, SearchSettings())
    grid = {sat: GRID for sat in GPS_SATS}
    first = {peak.sat: peak for peak in searcher.search(clean.planes, 0.0, grid, nothing_known)}

    def known(sat):
        return [(first[sat].delay_s, first[sat].power)] if sat in first else []

    assert searcher.search(clean.planes, 0.0, grid, known) == []


@pytest.mark.parametrize("rate_hz", [2.6e6, 4.0e6, 5.456e6, 16.3676e6])
def test_any_sample_rate_will_do(rate_hz):
    rng = np.random.default_rng(4)
    n = int(0.03 * rate_hz)
    chips = np.arange(n) * 1.023e6 / rate_hz - 321.7
    turns = 1510.0 * np.arange(n) / rate_hz
    wave = 0.3 * GPS_L1_CA.code(9)[np.floor(chips).astype(int) % 1023] * np.exp(2j * np.pi * turns)
    planes = (np.stack([wave.real, wave.imag]) + rng.normal(size=(2, n))).astype(np.float32)
    searcher = Searcher(GPS_L1_CA, rate_hz, SearchSettings())
    (peak,) = searcher.search(planes, 0.0, {"G09": GRID}, nothing_known)
    assert peak.delay_s * 1.023e6 == pytest.approx(321.7, abs=0.1)
    assert peak.doppler_hz == pytest.approx(1510.0, abs=15.0)


@pytest.mark.long
def test_noise_alone_is_found_at_the_stated_rate():
    """One Doppler and as many searches as give 50 alarms: neighbouring cells of a sampled code are correlated, so the
    union bound makes it too few rather than too many."""
    rng = np.random.default_rng(5)
    rate_hz, wanted = 2.046e6, 0.05
    searcher = Searcher(GPS_L1_CA, rate_hz, SearchSettings(false_alarm_probability=wanted, n_periods=4))
    trials = 1500
    alarms = 0
    for _ in range(trials):
        planes = rng.normal(size=(2, searcher.n_samples)).astype(np.float32)
        alarms += bool(searcher.search(planes, 0.0, {"G20": np.array([0.0])}, nothing_known))
    low, high = stats.binom.interval(0.999, trials, wanted)
    assert 0.5 * low <= alarms <= high
