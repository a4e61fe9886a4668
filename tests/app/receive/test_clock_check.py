"""A sample rate that is given wrong loses no signal: it is measured from the recording, reported and used."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from skyproof.app.common.settings import Settings
from skyproof.app.inspect import inspect_recording
from skyproof.app.receive.reception import observe, require_signals
from skyproof.app.receive.tracker import track
from skyproof.errors import NotEnoughData
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.simulator import scenes
from skyproof.simulator.samples import render_samples
from skyproof.simulator.scenario import FrontEnd, ScenePlace

START = np.datetime64("2024-03-03T11:59:58", "ns")
PLACE = ScenePlace(lat_deg=48.1, lon_deg=11.6, height_m=500.0)
RATE_HZ = 2.6e6


@cache
def record(duration_s: float, seed: int = 0):
    scenario = scenes.make_clean(
        PLACE, START, duration_s=duration_s, receivers=1, mask_deg=15.0, seed=seed, front_end=FrontEnd(rate_hz=RATE_HZ)
    )
    samples = render_samples(scenario, make_nominal_constellation(START))[0]
    planes = samples.read(0, samples.n_samples)
    return replace(samples, read=lambda start, count: planes[:, start : start + count])


def misstate_rate(samples, ppm):
    return replace(samples, rate_hz=RATE_HZ * (1.0 + ppm * 1e-6))


def run_tracking(samples):
    trackers, _ = track([samples], Settings())
    return trackers[0]


def check_followed(ppm, samples):
    tracker = run_tracking(misstate_rate(samples, ppm))
    assert tracker.samples.rate_hz == pytest.approx(RATE_HZ, rel=2e-8)
    assert tracker.given.rate_hz == RATE_HZ * (1.0 + ppm * 1e-6)
    signals = {arc.signal for arc in tracker.arcs.values()}
    assert len(signals) == len(tracker.arcs) >= 7  # none was lost
    assert len(tracker.measured) >= 0.95 * len(signals) * (samples.duration_s - 1.0) / tracker.epoch_s
    (remark,) = [remark for remark in observe(tracker, None).remarks if "rate_hz" in remark]
    found_ppm, sigma_ppm = (float(number) for number in re.search(r"is ([\d.]+) ± ([\d.]+) ppm", remark).groups())
    assert sigma_ppm < 0.05
    assert abs(found_ppm - abs(ppm)) < 4.0 * sigma_ppm
    assert ("too high" in remark) == (ppm > 0.0)


@pytest.mark.long
def test_a_rate_that_loses_all_signals_is_corrected():
    check_followed(10.0, record(3.2))


@pytest.mark.long
@pytest.mark.parametrize("ppm", [-100.0, -30.0, -10.0, -3.0, -1.0, -0.1, 0.1, 1.0, 3.0, 30.0, 100.0])
def test_signals_are_followed_at_any_rate_that_is_given_wrong(ppm):
    check_followed(ppm, record(6.0))


@pytest.mark.long
def test_right_rates_are_left_alone():
    for seed in range(1, 25):
        samples = record(3.2, seed)
        assert run_tracking(samples).given is None
        assert inspect_recording(samples).given is None
        record.cache_clear()


@pytest.mark.long
@pytest.mark.parametrize("ppm", [100.0, -30.0])
def test_an_inspection_reads_at_the_rate_that_it_measures(ppm):
    found = inspect_recording(misstate_rate(record(0.5), ppm))
    assert found.samples.rate_hz == pytest.approx(RATE_HZ, rel=1e-7)
    assert len(found.satellites) >= 7
    assert "rate_hz" in found.remarks[0]
    assert found.document()["given"]["rate_hz"] == RATE_HZ * (1.0 + ppm * 1e-6)


@pytest.mark.long
def test_a_carrier_that_is_given_wrong_is_no_rate():
    found = inspect_recording(replace(record(0.5), if_hz=6000.0))
    assert found.samples.rate_hz == RATE_HZ
    assert abs(found.samples.if_hz) < 100.0
    assert "if_hz = 6000 is" in found.remarks[0]


def test_what_is_only_too_short_is_not_called_badly_read():
    trackers, _ = track([record(0.5)], Settings())
    with pytest.raises(NotEnoughData, match=r"\b0\.5 s\b") as refused:
        require_signals(trackers)
    assert "check rate_hz" not in str(refused.value)
    assert "12 s" in str(refused.value)
