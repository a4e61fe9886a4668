"""Codes against carriers: a wrong rate or carrier is identified, measured and corrected."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.recording.test_survey import record

from skyproof.gnss.constants import L1_HZ
from skyproof.receiver import measurement as m
from skyproof.receiver.clock_agreement import Disagreement, correct_samples, estimate_from_survey, estimate_from_tracks
from skyproof.receiver.measurement import Measurements
from skyproof.recording.survey import survey_recorder
from skyproof.records import Samples

PPM = 1e-6


def measure_at(wrong_ppm, rate_hz=2.6e6, **front_end):
    """Survey a clean sky whose rate is given wrong; Dopplers are those seen at that rate."""
    samples, heard = record(rate_hz, **front_end)
    given_hz = samples.rate_hz * (1.0 + wrong_ppm * PPM)
    for wave in heard:
        wave.doppler_hz += wrong_ppm * PPM * (samples.if_hz + wave.doppler_hz)
    reported = survey_recorder(replace(samples, rate_hz=given_hz), samples.if_hz, heard)
    return replace(samples, rate_hz=given_hz), reported, {wave.sat: wave.doppler_hz for wave in heard}


WRONG_PPM = (-100.0, -30.0, -10.0, -3.0, -1.0, 1.0, 3.0, 10.0, 30.0, 100.0)


def check_rate(wrong_ppm, rate_hz, **front_end):
    samples, reported, dopplers_hz = measure_at(wrong_ppm, rate_hz, **front_end)
    apart = estimate_from_survey(reported, dopplers_hz)
    assert apart.certain
    assert not apart.of_carrier
    assert apart.sigma < 0.15 * PPM
    assert correct_samples(samples, apart).rate_hz == pytest.approx(rate_hz, rel=max(4.0 * apart.sigma, 1e-7))
    assert reported.gaps == ()


@pytest.mark.parametrize("wrong_ppm", [-100.0, 3.0, 10.0])
def test_a_rate_that_is_given_wrong_is_measured(wrong_ppm):
    check_rate(wrong_ppm, 2.6e6)


@pytest.mark.long
@pytest.mark.parametrize("wrong_ppm", WRONG_PPM)
@pytest.mark.parametrize(
    ("rate_hz", "front_end"),
    [
        (4e6, {"encoding": "int", "bits": 8}),
        (5.456e6, {"kind": "real", "encoding": "sign-magnitude", "bits": 2, "if_hz": 1_364_000}),
    ],
)
def test_rates_that_are_given_wrong_are_measured(wrong_ppm, rate_hz, front_end):
    # In less than 0.5 s a drift of few ppm may look like a mirrored spectrum: then nothing is reported.
    check_rate(wrong_ppm, rate_hz, duration_s=0.5, **front_end)


def test_a_right_rate_is_left_alone():
    _, reported, dopplers_hz = measure_at(0.0)
    assert not estimate_from_survey(reported, dopplers_hz).certain


# --- by what was tracked


def make_tracked(share, *, n_sats=8, seed=0, rows=11, oscillator_hz=0.0, sigma_m=1.0):
    """Make rows of so many satellites, 0.2 s apart, whose codes run faster than carriers by `share`."""
    rng = np.random.default_rng(seed)
    elapsed_s = np.repeat(1.0 + 0.2 * np.arange(rows), n_sats)
    arc = np.tile(np.arange(n_sats), rows)
    doppler_hz = oscillator_hz + np.tile(np.linspace(-3e3, 3e3, n_sats), rows)
    carrier_cyc = -doppler_hz * elapsed_s
    code_s = elapsed_s * (1.0 + share + doppler_hz / L1_HZ) + rng.normal(0.0, sigma_m / 3e8, arc.size)
    table = np.zeros((arc.size, m.N_COLUMNS))
    table[:, m.PERIODS] = np.floor(code_s / 1e-3)
    table[:, m.FRACTION_S] = code_s - 1e-3 * table[:, m.PERIODS]
    table[:, m.CARRIER_CYC], table[:, m.DOPPLER_HZ], table[:, m.CODE_SIGMA_S] = carrier_cyc, doppler_hz, sigma_m / 3e8
    return Measurements(
        elapsed_s=elapsed_s,
        arc=arc,
        table=table,
        taps=np.zeros((arc.size, 1, 3), np.complex64),
        own=np.empty((arc.size, 0, 8)),
        turns_rad=np.full((arc.size, 1), np.nan),
        first_power=np.empty((arc.size, 0)),
    )


def list_sats(n):
    return {number: f"G{number + 1:02d}" for number in range(n)}


@given(share=st.floats(-1e-4, 1e-4), n_sats=st.integers(4, 12), seed=st.integers(0, 1000))
def test_the_drift_of_tracked_signals_is_measured(share, n_sats, seed):
    apart = estimate_from_tracks(make_tracked(share, n_sats=n_sats, seed=seed), list_sats(n_sats))
    assert abs(apart.code_minus_carrier - share) < 12.0 * apart.sigma + 1e-11
    assert apart.sigma < 1e-8


def test_agreeing_signals_are_corrected_once_in_a_thousand():
    # The scatter of few satellites determines the sigma badly; the least that counts holds against that.
    certain = [
        estimate_from_tracks(make_tracked(0.0, n_sats=4 + seed % 9, seed=seed), list_sats(12)).certain
        for seed in range(300)
    ]
    assert sum(certain) <= 1


def test_two_of_eight_signals_that_are_drawn_away_move_nothing():
    measurements = make_tracked(0.0)
    for arc in (0, 1):
        rows = measurements.arc == arc
        measurements.table[rows, m.FRACTION_S] += 1e-6 * measurements.elapsed_s[rows]
    assert not estimate_from_tracks(measurements, list_sats(8)).certain


def test_too_few_or_too_short_signals_show_nothing():
    assert estimate_from_tracks(make_tracked(1e-5, n_sats=3), list_sats(3)) is None
    assert estimate_from_tracks(make_tracked(1e-5, rows=5), list_sats(8)) is None


# --- which of both is wrong


@given(share=st.floats(4e-6, 1e-4), sign=st.sampled_from([-1.0, 1.0]), off_hz=st.floats(-800.0, 800.0))
def test_carriers_that_are_off_are_told_from_a_rate_that_is_off(share, sign, off_hz):
    # An oscillator off by half a ppm beside it; a carrier given too high makes all signals appear low.
    share *= sign
    rate = Disagreement(
        code_minus_carrier=share,
        sigma=1e-9,
        oscillator_hz=off_hz,
        oscillator_sigma_hz=300.0,
        certain=True,
        carrier_hz=L1_HZ,
    )
    carrier = replace(rate, oscillator_hz=off_hz - share * L1_HZ)
    assert not rate.of_carrier
    assert carrier.of_carrier
    samples = Samples(name="a", rate_hz=4e6 * (1.0 + share), n_samples=1, read=lambda start, count: None, if_hz=0.0)
    assert correct_samples(samples, rate).rate_hz == pytest.approx(4e6, rel=1e-12)
    assert correct_samples(samples, carrier).rate_hz == samples.rate_hz
    assert correct_samples(samples, carrier).if_hz == pytest.approx(-share * L1_HZ)
