"""Lost samples, the mirrored spectrum and the oscillator, shown by the code phases of the satellites."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from skyproof.gnss.codes import generate_ca_code
from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.orbits import compute_satellite_state
from skyproof.gnss.sky import compute_azimuth_elevation
from skyproof.recording.survey import DOPPLER_LIMIT_HZ, Survey, estimate_oscillator_error, survey_recorder
from skyproof.simulator import scenes
from skyproof.simulator.samples import render_samples
from skyproof.simulator.scenario import FrontEnd, ScenePlace
from skyproof.simulator.sky import make_scene

START = np.datetime64("2024-03-03T11:59:58", "ns")
PLACE = ScenePlace(lat_deg=48.1, lon_deg=11.6, height_m=500.0)
INT8 = {"encoding": "int", "bits": 8}
TWO_BIT_REAL = {"kind": "real", "encoding": "sign-magnitude", "bits": 2}


def record(rate_hz, *, duration_s=0.1, seed=0, **front_end):
    """Render a clean sky in memory, with its satellites as a search would give them, by the truth."""
    scenario = scenes.make_clean(
        PLACE,
        START,
        duration_s=duration_s,
        receivers=1,
        mask_deg=10.0,
        seed=seed,
        front_end=FrontEnd(rate_hz=rate_hz, **front_end),
    )
    navigation = make_nominal_constellation(START)
    samples, sky = render_samples(scenario, navigation)[0], make_scene(scenario, navigation).skies[0]
    late_s = sky.true_minus_elapsed_s(0.0)
    delays_s, rates = sky.code_delay_s(late_s), sky.carrier_delay_rate(late_s)
    heard = [
        SimpleNamespace(
            sat=signal.id.sat,
            delay_s=float((delays_s[k] - late_s) % 1e-3),
            doppler_hz=float(-1575.42e6 * (rates[k] + sky.receiver.lo_ppm * 1e-6)),
        )
        for k, signal in enumerate(sky.signals)
    ]
    planes = samples.read(0, samples.n_samples)
    return replace(samples, read=lambda start, count: planes[:, start : start + count]), heard


def drop_samples(samples, at_sample, count):
    planes = samples.read(0, samples.n_samples)
    kept = np.concatenate([planes[:, :at_sample], planes[:, at_sample + count :]], axis=1)
    return replace(samples, n_samples=kept.shape[1], read=lambda start, n: kept[:, start : start + n])


@pytest.mark.parametrize(
    ("rate_hz", "front_end", "at_sample", "count"),
    [
        (2.6e6, {}, 110_000, 1300),
        (2.6e6, {}, 110_000, 1),
        (4e6, INT8, 211_111, 1),
        (4e6, INT8, 211_111, 3 * 4000 + 77),
        (4e6, INT8, 60_000, 3999),
        (5.456e6, {**TWO_BIT_REAL, "if_hz": 1_364_000}, 100_000, 3),
        (16_367_600, {**TWO_BIT_REAL, "if_hz": 4_130_400}, 777_777, 9000),
    ],
)
def test_missing_samples_are_found_where_and_as_many_as_they_are(rate_hz, front_end, at_sample, count):
    samples, heard = record(rate_hz, **front_end)
    (gap,) = survey_recorder(drop_samples(samples, at_sample, count), samples.if_hz, heard).gaps
    assert abs(gap.at_sample - at_sample) < 4.0 * gap.at_sigma_samples + 1.0
    assert gap.at_sigma_samples < 50e-6 * rate_hz
    period = rate_hz * 1e-3
    off = (gap.missing_samples - count + 0.5 * period) % period - 0.5 * period
    assert abs(off) < 4.0 * gap.missing_sigma_samples
    assert gap.missing_sigma_samples < 0.3


def test_two_gaps_are_told_apart():
    samples, heard = record(4e6, **INT8)
    twice = drop_samples(drop_samples(samples, 280_000, 1500), 120_000, 333)
    first, second = survey_recorder(twice, 0.0, heard).gaps
    assert abs(first.at_sample - 120_000) < 4.0 * first.at_sigma_samples + 1.0
    assert abs(second.at_sample - (280_000 - 333)) < 4.0 * second.at_sigma_samples + 1.0
    assert first.missing_samples == pytest.approx(333, abs=0.4)
    assert second.missing_samples == pytest.approx(1500, abs=0.4)


def test_whole_code_periods_are_missing_without_a_sign():
    samples, heard = record(4e6, **INT8)
    assert survey_recorder(drop_samples(samples, 200_000, 8000), 0.0, heard).gaps == ()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("still", [slice(0, 400_000), slice(0, 120_000), slice(200_000, 206_000)])
def test_nothing_is_said_of_samples_that_do_not_change(still):
    samples, heard = record(4e6, **INT8)
    planes = samples.read(0, samples.n_samples).copy()
    planes[:, still] = 0.0
    cut = replace(samples, read=lambda start, count: planes[:, start : start + count])
    assert survey_recorder(cut, 0.0, heard) == Survey()


def test_the_jump_of_one_satellite_is_no_gap():
    samples, heard = record(4e6, **INT8)
    strong = heard[0]
    n = samples.n_samples
    time_s = np.arange(n) / 4e6
    jump_chips = np.where(time_s > 0.05, 100.0, 0.0)
    at_chip = (time_s * (1.0 + strong.doppler_hz / 1575.42e6) - strong.delay_s) * 1.023e6 - jump_chips
    false = 240.0 * generate_ca_code(int(strong.sat[1:]))[np.floor(at_chip).astype(int) % 1023]
    turned = false * np.exp(2j * np.pi * strong.doppler_hz * time_s)
    planes = samples.read(0, n) + 0.1 * np.stack([turned.real, turned.imag])
    spoofed = replace(samples, read=lambda start, count: planes[:, start : start + count])
    assert survey_recorder(spoofed, 0.0, heard).gaps == ()


def assert_count(trials, wanted):
    alarms, ratios, clocks = 0, [], []
    for seed in range(trials):
        samples, heard = record(2.6e6, seed=seed)
        reported = survey_recorder(samples, 0.0, heard, false_alarm_probability=wanted)
        alarms += bool(reported.gaps)
        ratios.append((reported.doppler_ratio - 1.0) / reported.doppler_ratio_sigma)
        clocks.append(reported.clock_minus_lo_ppm / reported.clock_minus_lo_sigma_ppm)
    return alarms, ratios, clocks


def test_a_continuous_recording_has_no_gap():
    # The bound holds; there are fewer, for neighbouring places are tested as if they were independent.
    assert assert_count(5, 1e-3)[0] == 0


@pytest.mark.long
def test_gaps_keep_the_stated_rate_and_sigmas_are_right():
    trials, wanted = 150, 0.2
    alarms, ratios, clocks = assert_count(trials, wanted)
    assert alarms <= stats.binom.ppf(0.999, trials, wanted)
    for normalised in (ratios, clocks):
        assert abs(np.mean(normalised)) < 4.0 / np.sqrt(trials)
        assert 0.75 < np.std(normalised) < 1.25


def test_a_mirrored_spectrum_is_found():
    samples, heard = record(2.6e6)
    right = survey_recorder(samples, 0.0, heard)
    assert right.conjugate is False
    mirrored = replace(samples, read=lambda start, count: samples.read(start, count) * np.float32([[1.0], [-1.0]]))
    seen = [SimpleNamespace(sat=item.sat, delay_s=item.delay_s, doppler_hz=-item.doppler_hz) for item in heard]
    wrong = survey_recorder(mirrored, 0.0, seen)
    assert wrong.conjugate is True
    assert wrong.conjugate_error_probability < 1e-3
    assert wrong.doppler_ratio == pytest.approx(-1.0, abs=4.0 * wrong.doppler_ratio_sigma)


def test_four_milliseconds_do_not_show_a_mirrored_spectrum():
    samples, heard = record(2.6e6, duration_s=0.004)
    reported = survey_recorder(samples, 0.0, heard)
    assert reported.conjugate is None
    assert reported.conjugate_error_probability == 0.5


def test_a_sampling_clock_of_its_own_is_found():
    # A rate stated 2 ppm too low: delays in seconds seem to grow by 2 microseconds a second.
    samples, heard = record(2.6e6, duration_s=0.3)
    coupled = survey_recorder(samples, 0.0, heard)
    assert abs(coupled.clock_minus_lo_ppm) < 4.0 * coupled.clock_minus_lo_sigma_ppm
    off = survey_recorder(replace(samples, rate_hz=2.6e6 * (1.0 - 2e-6)), 0.0, heard)
    assert off.gaps == ()
    assert off.clock_minus_lo_ppm == pytest.approx(2.0, abs=4.0 * off.clock_minus_lo_sigma_ppm)


def test_two_satellites_show_nothing():
    samples, heard = record(2.6e6, duration_s=0.02)
    assert survey_recorder(samples, 0.0, heard[:2]) == Survey()


def test_the_middle_of_the_dopplers_is_as_near_to_zero_as_stated():
    rng = np.random.default_rng(2)
    navigation = make_nominal_constellation(START)
    instants = START + (rng.uniform(-3600.0, 3600.0, 400) * 1e9).astype("timedelta64[ns]")
    places = ecef_from_geodetic(np.arcsin(rng.uniform(-0.95, 0.95, 400)), rng.uniform(-np.pi, np.pi, 400), 0.0)
    states = [compute_satellite_state(ephemeride, instants) for ephemeride in navigation.ephemerides]
    position = np.stack([state.position_ecef_m for state in states])
    velocity = np.stack([state.velocity_ecef_m_s for state in states])
    away = position - places
    doppler_hz = -np.sum(away * velocity, axis=-1) / np.linalg.norm(away, axis=-1) / 299_792_458.0 * 1575.42e6
    above = compute_azimuth_elevation(places, position)[1] > np.radians(10.0)
    assert np.abs(doppler_hz[above]).max() < DOPPLER_LIMIT_HZ
    for n in (1, 4, 6, 8):
        middles = []
        for column in range(instants.size):
            values = doppler_hz[above[:, column], column]
            if values.size >= n:
                reported = estimate_oscillator_error(rng.choice(values, n, replace=False) + 700.0)
                middles.append((reported.doppler_hz - 700.0) / reported.sigma_hz)
        assert 0.85 < np.std(middles) < 1.15


def test_without_satellites_the_oscillator_is_not_known():
    assert np.isnan(estimate_oscillator_error([]).doppler_hz)
