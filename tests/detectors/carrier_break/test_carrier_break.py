"""Carriers that break at one moment: those of one sky go on together, those of another one do not."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from tests.detectors import nulls

from skyproof.detectors.carrier_break.detector import CarrierBreak
from skyproof.detectors.carrier_break.phases import compare_phases, find_breaks
from skyproof.records import Cause, CellStatus, Finding, Observations, Records
from skyproof.testing import MeasuredScene

SCENE = MeasuredScene(antennas_enu_m={"rx1": (0.0, 0.0, 0.0)}, epochs=50, step_s=0.2, max_satellites=9)
AFTER = 30  # the first epoch after the break; the one before has no measurements


def receive(seed: int = 0) -> Records:
    """Return a window of a clean sky, its receiver one of ours."""
    return nulls.track(SCENE.records(np.random.default_rng(seed)))


def break_all(records: Records, jumps_cyc, *, missing_s: float = 0.0) -> Records:
    """Return a window whose carriers break at one moment and go on elsewhere; samples may be missing there."""
    (o,) = records.observations
    carrier_cyc, pseudorange_m = o.carrier_cyc.copy(), o.pseudorange_m.copy()
    doppler_hz, status = o.doppler_hz.copy(), o.status.copy()
    carrier_cyc[AFTER:] += jumps_cyc - missing_s * doppler_hz[AFTER:].mean(axis=0)
    pseudorange_m[AFTER:] += missing_s * 299792458.0
    for values in (carrier_cyc, pseudorange_m, doppler_hz):
        values[AFTER - 1] = np.nan
    status[AFTER] = CellStatus.SLIP
    broken = replace(o, carrier_cyc=carrier_cyc, pseudorange_m=pseudorange_m, doppler_hz=doppler_hz, status=status)
    return replace(records, observations=(broken,))


def examine(records: Records) -> Finding:
    (found,) = CarrierBreak().examine(records)[0]
    return found


def observe(records: Records) -> Observations:
    (o,) = records.observations
    return o


def test_another_sky_goes_on_apart():
    found = examine(break_all(receive(), np.resize([0.0, 0.25], 9)))
    assert (found.code, found.says) == ("goes_apart", "undecided")
    assert found.p[Cause.CLEAN] < 1e-6
    assert found.may_also_be == (Cause.MISSING_SAMPLES, Cause.MOTION, Cause.FAULT)
    assert found.dated_gpst == observe(receive()).gpst[AFTER]


@pytest.mark.parametrize("jump_cyc", [0.0, 0.3, 17.5])
def test_one_sky_goes_on_together(jump_cyc):
    halves = 0.5 * np.random.default_rng(2).integers(0, 4, 9)  # bits leave half a cycle open
    found = examine(break_all(receive(), jump_cyc + halves))
    assert found.code == "goes_on"
    assert found.p[Cause.CLEAN] > 0.01


def test_missing_samples_are_seen_in_codes():
    found = examine(break_all(receive(), 0.2, missing_s=2e-4))
    assert found.p[Cause.CLEAN] > 0.01


def test_some_carriers_that_break_are_no_common_break():
    records = break_all(receive(), np.random.default_rng(3).random(9))
    o = observe(records)
    status = o.status.copy()
    status[AFTER, 5:] = CellStatus.OK
    assert examine(replace(records, observations=(replace(o, status=status),))).code == "unbroken"


def test_p_values_of_one_sky_are_uniform_at_most():
    p_values = []
    for seed in range(200):
        o = observe(break_all(receive(seed), 0.1))
        (one,) = find_breaks(o)
        p_values.append(compare_phases(o, one, 0.0)[0])
    for asked in (0.1, 0.01):
        assert stats.binomtest(int((np.array(p_values) < asked).sum()), 200, asked, alternative="greater").pvalue > 1e-3


def test_an_antenna_that_moves_tells_nothing():
    o = observe(break_all(receive(), np.random.default_rng(4).random(9)))
    (one,) = find_breaks(o)
    assert compare_phases(o, one, 1.0) == (1.0, pytest.approx(np.nan, nan_ok=True))


def test_a_break_between_two_windows_is_found():
    records = break_all(receive(), np.random.default_rng(5).random(9))
    o = observe(records)
    first, second = (replace(records, observations=(o.read(*rows),)) for rows in ((0, AFTER), (AFTER, 50)))
    detector = CarrierBreak()
    _, state = detector.examine(first)
    (found,), _ = detector.examine(second, state)
    assert found.code == "goes_apart"


def test_logs_of_others_are_not_tested():
    records = SCENE.records(np.random.default_rng(0))
    assert examine(records).code == "without_taps"
    nothing = observe(records).carrier_cyc * np.nan
    without = nulls.track(replace(records, observations=(replace(observe(records), carrier_cyc=nothing),)))
    assert examine(without).code == "no_carriers"
