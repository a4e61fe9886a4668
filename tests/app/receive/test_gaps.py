"""Samples that are missing, stated by the recording or not: letters and ranges after them, nothing wrong in between."""

from dataclasses import replace

import numpy as np
import pytest
from tests.app import kit

from skyproof.app.common.settings import Settings
from skyproof.app.receive.reception import observe
from skyproof.app.receive.tracker import track
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.records import SampleGap, Samples
from skyproof.simulator.samples import render_samples
from skyproof.simulator.scenario import FrontEnd
from skyproof.simulator.sky import make_scene

LIGHT_M_S = 299_792_458.0
RATE_HZ = 2_600_000
CUT_S = 9.03
AVERAGED_S = 0.2
WRONG_M = 30.0  # more than noise, the filter of the code loop and multipath make of a C/A range at 42 dB-Hz and more


@pytest.fixture(scope="module")
def sky():
    """Render 24 s of a clean sky to two-bit samples in memory, and return them with the scene."""
    scenario = kit.make_scenario(
        receivers=1, duration_s=24.0, front_end=FrontEnd(rate_hz=RATE_HZ, encoding="sign-magnitude", bits=2)
    )
    navigation = make_nominal_constellation(scenario.start_gpst)
    (samples,) = render_samples(scenario, navigation)
    planes = samples.read(0, samples.n_samples).astype(np.int8)
    return replace(samples, read=make_reader(planes)), make_scene(scenario, navigation), navigation


def make_reader(planes):
    return lambda start, count: planes[:, start : start + count].astype(np.float32)


def remove_samples(samples: Samples, missing: int, *, reported: bool = False) -> Samples:
    """Remove so many samples of the recording from `CUT_S` on."""
    at = int(CUT_S * RATE_HZ)

    def read(start, count):
        count = max(min(count, samples.n_samples - missing - start), 0)
        split = int(np.clip(at - start, 0, count))
        return np.concatenate([samples.read(start, split), samples.read(start + split + missing, count - split)], 1)

    gaps = (SampleGap(at, missing),) if reported else ()
    return replace(samples, read=read, n_samples=samples.n_samples - missing, gaps=gaps)


def receive(samples, navigation):
    (tracker,), _ = track([samples], Settings())
    return observe(tracker, navigation)


def measure_range_errors_m(o, scene, missing_s):
    """Measure errors of pseudoranges, (n_epochs, n_signals), less what all share in an epoch.

    The clock may step at a gap.
    missing_s : by so much the samples after the cut are older than their number says.
    """
    (sky,) = scene.skies
    recorded_s = o.elapsed_s + np.where(o.elapsed_s > CUT_S, missing_s, 0.0)
    true_s = recorded_s + sky.true_minus_elapsed_s(recorded_s)
    delay_m = LIGHT_M_S * sky.code_delay_s(true_s)
    columns = [[heard.id.sat for heard in sky.signals].index(signal.sat) for signal in o.signals]
    errors_m = o.pseudorange_m - delay_m[:, columns]
    known = np.isfinite(errors_m).any(axis=1)
    errors_m[known] -= np.nanmedian(errors_m[known], axis=1, keepdims=True)
    return errors_m


def assert_bridged(reception, scene, missing_s, back_s):
    """Check that letters stay, that no range is ever wrong, and that all are back `back_s` after the cut."""
    o = reception.observations
    assert {signal.copy for signal in o.signals} == {"a"}
    assert len(o.signals) >= 8
    errors_m = measure_range_errors_m(o, scene, missing_s)
    assert np.nanmax(np.abs(errors_m)) < WRONG_M
    after = o.elapsed_s > CUT_S + back_s
    assert after.sum() > 5
    assert np.isfinite(errors_m[after]).mean() > 0.98
    assert np.isfinite(errors_m[o.elapsed_s < CUT_S - AVERAGED_S]).mean() > 0.7  # the first seconds are searched in
