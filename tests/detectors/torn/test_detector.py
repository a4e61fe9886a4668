"""Stray codes of many satellites make a torn receiver; of a few they are faults."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.detectors.torn.detector import Torn, TornSettings
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.records import Cause, CellStatus, Records
from skyproof.testing import MeasuredScene, TrackErrors

RATE = 1e-7
SCENE = MeasuredScene(
    antennas_enu_m={"rx1": (0.0, 0.0, 0.0)}, epochs=30, errors=TrackErrors(sigma_m=1.0, constant_m=1.0)
)
MS_M = 1e-3 * SPEED_OF_LIGHT_M_S


def clean(seed: int = 0) -> Records:
    return SCENE.records(np.random.default_rng(seed))


def change_cells(records: Records, codes_m=None, status=None) -> Records:
    (o,) = records.observations
    changes = {name: value for name, value in (("pseudorange_m", codes_m), ("status", status)) if value is not None}
    return replace(records, observations=(replace(o, **changes),))


def examine(records: Records, window: int = 10) -> list:
    detector, state, found = Torn(TornSettings(false_alarm_probability=RATE)), None, []
    (o,) = records.observations
    for first in range(0, o.gpst.size, window):
        part = replace(records, observations=(o.read(first, first + window),))
        evidence, state = detector.examine(part, state)
        found += evidence
    return found


def make_torn(seed: int, *, satellites: int, epochs: range, alone: int = 0) -> Records:
    """Return records in which so many satellites are whole milliseconds off for an epoch or two, others each time.

    alone : how many satellites are left at those epochs; all if 0.
    """
    rng = np.random.default_rng(seed)
    records = clean(seed)
    codes_m = records.observations[0].pseudorange_m.copy()
    chosen = rng.permutation(codes_m.shape[1])[:satellites]
    for epoch in epochs:
        if alone:
            codes_m[epoch, rng.permutation(codes_m.shape[1])[alone:]] = np.nan
        strays = rng.permutation(chosen)[:2]
        codes_m[epoch, strays] += rng.integers(1, 9, strays.size) * MS_M
    return change_cells(records, codes_m)


@pytest.mark.parametrize("seed", range(4))
def test_a_clean_sky_has_no_strays(seed) -> None:
    assert [e.statistic for e in examine(clean(seed))] == [0.0, 0.0, 0.0]


@pytest.mark.parametrize("seed", range(4))
def test_strays_of_many_satellites_are_found_and_dated(seed) -> None:
    found = examine(make_torn(seed, satellites=8, epochs=range(12, 20)))
    assert [e.failed for e in found] == [False, True, False]
    assert found[1].dated_gpst == clean(seed).observations[0].gpst[12]
    assert [(e.code, e.data["by"]) for e in found] == [("whole", "codes"), ("torn", "codes"), ("whole", "codes")]
    assert (found[1].says, found[1].overrules) == ("undecided", True)
    assert found[1].may_also_be == (Cause.INTERFERENCE, Cause.FAULT)
    assert {ref.signal.sat for ref in found[1].signals} == set(found[1].data["sats"])


def test_few_satellites_at_a_time_are_tested_by_the_last_fix() -> None:
    found = examine(make_torn(1, satellites=8, epochs=range(11, 30), alone=4))
    assert [e.failed for e in found] == [False, True, True]


@pytest.mark.parametrize("satellites", [1, 2])
def test_faults_of_two_satellites_are_not_torn(satellites) -> None:
    assert not any(e.failed for e in examine(make_torn(2, satellites=satellites, epochs=range(5, 25))))


def test_ranges_that_no_receiver_measures_count() -> None:
    records = clean()
    (o,) = records.observations
    codes_m, status = o.pseudorange_m.copy(), o.status.copy()
    for epoch, column in ((12, 1), (13, 4), (15, 6), (16, 2), (18, 7)):
        codes_m[epoch, column], status[epoch, column] = np.nan, CellStatus.IMPOSSIBLE
    assert [e.failed for e in examine(change_cells(records, codes_m, status))] == [False, True, False]


def test_a_whole_sky_that_moves_is_no_stray() -> None:
    records = clean()
    codes_m = records.observations[0].pseudorange_m.copy()
    codes_m[12:] += 5e4
    assert not any(e.failed for e in examine(change_cells(records, codes_m)))


def test_reflections_are_no_strays() -> None:
    rng = np.random.default_rng(3)
    records = clean()
    codes_m = records.observations[0].pseudorange_m.copy()
    codes_m[:, 4:] += rng.exponential(120.0, codes_m[:, 4:].shape).clip(max=500.0)
    assert not any(e.failed for e in examine(change_cells(records, codes_m)))


def test_without_a_good_fix_it_cannot_be_tested() -> None:
    few = replace(SCENE, max_satellites=5).records(np.random.default_rng(0))
    (evidence, *_) = examine(few)
    assert (evidence.says, evidence.code) == ("undecided", "no_good_fix")


@pytest.mark.parametrize("moving", [True, False], ids=["with Dopplers", "codes alone"])
def test_the_last_velocity_bounds_where_the_antenna_is(moving) -> None:
    # Four satellites at a time, 1.6 km off: within what 1 km/s leads to, not within what accelerations do.
    records = clean(2)
    (o,) = records.observations
    rng, codes_m = np.random.default_rng(2), o.pseudorange_m.copy()
    for epoch in range(11, 16):
        codes_m[epoch, rng.permutation(codes_m.shape[1])[4:]] = np.nan
        codes_m[epoch] += 1600.0
    o = replace(o, pseudorange_m=codes_m)
    if not moving:
        none = np.full(codes_m.shape, np.nan)
        o = replace(o, doppler_hz=none, doppler_sigma_hz=none, carrier_cyc=none, carrier_sigma_cyc=none)
    found = examine(replace(records, observations=(o,)))
    assert [e.failed for e in found] == [False, True, False]
    assert found[1].dated_gpst == o.gpst[11]


def test_a_window_in_which_nothing_can_be_tested_fails_nothing() -> None:
    # One epoch, in which nothing goes on from another, of a receiver without a good fix.
    records = clean()
    (o,) = (o for o in records.observations[:1])
    codes_m = np.full_like(o.pseudorange_m, np.nan)
    single_epoch = replace(replace(o, pseudorange_m=codes_m).select(slice(0, 1)))
    found, _ = Torn(TornSettings()).examine(replace(records, observations=(single_epoch,), sets=()))
    assert not any(finding.failed for finding in found)
    assert not any(finding.p for finding in found)
