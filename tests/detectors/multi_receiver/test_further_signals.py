"""What is said of each signal beside a sky that is known to be true."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.detectors.multi_receiver.detector import MultiReceiver
from skyproof.detectors.multi_receiver.further_signals import Rates, find_further_signals
from skyproof.detectors.multi_receiver.pairing import pair_up
from skyproof.detectors.multi_receiver.settings import MultiReceiverSettings
from skyproof.detectors.second_signals.detector import SecondSignals, SecondSignalsSettings
from skyproof.records import SignalId, SignalRef
from skyproof.testing import FalseSky, MeasuredScene, TrackErrors

PLACES = {"rx1": (0.0, 0.0, 0.0), "rx2": (40.0, 0.0, 0.0), "rx3": (0.0, 30.0, 2.0)}
NEAR = FalseSky(antenna_enu_m=(400.0, 300.0, 10.0), delay_m=600.0)
FAR = FalseSky(antenna_enu_m=(-300.0, 500.0, 10.0), delay_m=600.0)


def make_records(imitated, *, over_db=9.0, receivers=2, late_m=None):
    """Make a true sky of ten satellites with second signals of these satellites at the antennas NEAR and FAR."""
    antennas = dict(list(PLACES.items())[:receivers])
    made = MeasuredScene(
        antennas_enu_m=antennas, false=(NEAR, FAR), epochs=8, errors=TrackErrors(0.5), max_satellites=10
    ).records(np.random.default_rng(3))
    heard = []
    for o in made.observations:
        n = len(o.signals) // 3
        column = np.arange(len(o.signals))
        received = np.isin(column, [n * (1 + which) + k for which, numbers in enumerate(imitated) for k in numbers]) | (
            column < n
        )
        cells = {name: np.where(received, getattr(o, name), np.nan) for name in ("pseudorange_m", "cn0_dbhz")}
        cells["cn0_dbhz"][:, n:] += over_db
        if late_m is not None:
            cells["pseudorange_m"][:, n:] = np.where(received, np.tile(o.pseudorange_m[:, :n], 3) + late_m, np.nan)[
                :, n:
            ]
        heard.append(replace(o, **cells))
    sets = tuple(s for s in made.sets if s.signals[0].copy == "a")
    return replace(made, observations=tuple(heard), sets=sets), [s.sat for s in made.observations[0].signals[:n]]


def examine_all(made, **given):
    settings = MultiReceiverSettings(**{"antennas_enu_m": PLACES, "false_alarm_probability": 1e-6, **given})
    evidence, _ = MultiReceiver(settings).examine(made)
    return [e for e in evidence if e.says == "spoofed"], [e for e in evidence if e.says == "authentic"]


def list_subjects(evidence):
    return sorted(sorted({ref.signal.sat for ref in e.signals}) for e in evidence)


@pytest.mark.parametrize("receivers", [2, 3])
def test_few_signals_are_named_by_the_antenna_they_come_from(receivers):
    made, sats = make_records(([0, 2], [4, 7]), receivers=receivers)
    spoofed, authentic = examine_all(made)
    assert len(authentic) == 1
    assert list_subjects(spoofed) == sorted([sorted([sats[0], sats[2]]), sorted([sats[4], sats[7]])])
    assert all({ref.receiver for ref in e.signals} == set(list(PLACES)[:receivers]) for e in spoofed)
    assert not any(e.whole_sky for e in spoofed)
    assert {e.code for e in spoofed} == {"unlike_echoes_of_one_antenna"}


@pytest.mark.parametrize(("alpha", "named"), [(1e-7, True), (1e-8, False)])
def test_an_alarm_of_second_signals_names_them_one_by_one(alpha, named):
    # They have 6e-8 by the test of a receiver's second signals, and 4 tests here share the rate.
    made, sats = make_records(([0, 2], [4, 7]), over_db=0.0)
    alarm, _ = SecondSignals(SecondSignalsSettings(false_alarm_probability=alpha)).examine(made)
    assert [e.says == "attack" for e in alarm] == [named, named]
    spoofed, authentic = examine_all(made, false_alarm_probability=alpha)
    assert {(ref.signal.sat, ref.signal.copy) for e in spoofed for ref in e.signals} == (
        {(sats[0], "b"), (sats[2], "b"), (sats[4], "c"), (sats[7], "c")} if named else set()
    )
    assert len(authentic) == 1


def test_one_odd_signal_is_not_named():
    made, _ = make_records(([0], []))
    spoofed, authentic = examine_all(made)
    assert spoofed == []
    assert len(authentic) == 1


@pytest.mark.parametrize("known_p", [None, 1e-9])
def test_false_signals_take_the_p_value_of_their_attack(known_p):
    # One odd signal proves nothing alone, and is named beside others that are false: its own test has no small p.
    made, sats = make_records(([0], []))
    sky = pair_up(made, made.sets, MultiReceiverSettings().noise(1), min_satellites=5)
    rates = Rates(alarm=1e-6, mistaken=0.01, multipath_sigma_m=1.0, unrelated_spread_m=300.0)
    named = {} if known_p is None else {SignalRef("rx1", SignalId("G99", copy="b")): known_p}
    found = find_further_signals(made, [sky], {s.receiver: [s] for s in made.sets}, named, rates)
    assert {ref.signal.sat for result in found for ref in result.subject} == (set() if known_p is None else {sats[0]})
    assert all(result.p_value == known_p for result in found)


def test_signals_as_late_and_weak_as_echoes_are_not_named():
    made, _ = make_records(([0, 2, 5], [4]), over_db=-10.0, late_m=500.0)
    assert examine_all(made)[0] == []


def test_early_signals_are_named_however_weak():
    made, sats = make_records(([0, 2, 5], [4]), over_db=-8.0, late_m=-700.0)
    spoofed, _ = examine_all(made)
    assert {ref.signal.sat for e in spoofed for ref in e.signals} == {sats[k] for k in (0, 2, 4, 5)}


def move_ranges(made, by_m):
    """Move the only signals of some satellites in each receiver: (receiver, column) and metres, (epochs,)."""
    observations = []
    for o in made.observations:
        code_m = o.pseudorange_m.copy()
        for (receiver, column), metres in by_m.items():
            if receiver == o.receiver:
                code_m[:, column] += metres
        observations.append(replace(o, pseudorange_m=code_m))
    (first_set, second_set), away = made.sets, {column for _, column in by_m}
    sets = []
    for chosen, o in zip((first_set, second_set), made.observations, strict=True):
        gone = {o.signals[column] for column in away}
        sets.append(replace(chosen, signals=tuple(s for s in chosen.signals if s not in gone)))
    return replace(made, observations=tuple(observations), sets=tuple(sets))


@pytest.mark.parametrize(("apart_m", "named"), [(0.0, False), (60.0, True)], ids=["wrong clocks", "another place"])
def test_signals_equally_off_everywhere_may_have_wrong_orbits(apart_m, named):
    made, sats = make_records(([], []))
    off_m = {0: -700.0, 2: -9e4, 4: -3e3, 6: -800.0}
    by_m = {("rx1", k): m for k, m in off_m.items()} | {("rx2", k): m + apart_m for k, m in off_m.items()}
    spoofed, authentic = examine_all(move_ranges(made, by_m))
    assert authentic
    assert ({ref.signal.sat for e in spoofed for ref in e.signals} == {sats[k] for k in off_m}) == named
    assert bool(spoofed) == named


@pytest.mark.parametrize(("off_m", "named"), [(-3e5, False), (-600.0, True)], ids=["orbits elsewhere", "another place"])
def test_orbits_elsewhere_in_the_sky_differ_by_the_distance(off_m, named):
    # Two satellites of receivers 5 km apart: an orbit off by thousands of km, or codes that an attacker would send.
    far = {"rx1": (0.0, 0.0, 0.0), "rx2": (4000.0, 3000.0, 10.0)}
    made = MeasuredScene(antennas_enu_m=far, epochs=8, errors=TrackErrors(0.5), max_satellites=10).records(
        np.random.default_rng(3)
    )
    by_m = {("rx1", 0): off_m, ("rx2", 0): off_m + 2000.0, ("rx1", 3): off_m, ("rx2", 3): off_m - 1500.0}
    settings = MultiReceiverSettings(antennas_enu_m=far, false_alarm_probability=1e-6, max_separation_m=1e4)
    evidence, _ = MultiReceiver(settings).examine(move_ranges(made, by_m))
    assert any(e.says == "authentic" for e in evidence)
    assert any(e.says == "spoofed" for e in evidence) is named


def test_damaged_numbers_of_one_file_are_no_signals():
    made, _ = make_records(([], []))
    rng = np.random.default_rng(0)
    by_m = {("rx1", k): np.where(rng.random(8) < 0.4, -1e4 * rng.integers(1, 9, 8), 0.0) for k in (0, 2, 4, 6)}
    spoofed, authentic = examine_all(move_ranges(made, by_m))
    assert authentic
    assert not spoofed


def test_nothing_is_named_where_no_sky_is_known_to_be_true():
    made, _ = make_records(([0, 2], [4, 7]))
    evidence, _ = MultiReceiver(MultiReceiverSettings(false_alarm_probability=1e-6)).examine(made)
    assert {e.says for e in evidence} == {"undecided"}


def test_near_antennas_sky_is_not_taken_for_one_antenna():
    # Receivers 6 m apart with two sets each, of which the false ones have too few satellites in common to compare.
    near = {"rx1": (0.0, 0.0, 0.0), "rx2": (6.0, 0.0, 0.0)}
    made = MeasuredScene(
        antennas_enu_m=near, false=(NEAR,), epochs=20, errors=TrackErrors(0.6), max_satellites=6
    ).records(np.random.default_rng(5))
    sets = []
    for receiver, part in zip(near, (slice(0, 5), slice(1, 6)), strict=True):
        true, false = (s for s in made.sets if s.receiver == receiver)
        sets += [true, replace(false, signals=false.signals[part])]
    evidence, _ = MultiReceiver(MultiReceiverSettings(false_alarm_probability=1e-6)).examine(
        replace(made, sets=tuple(sets))
    )
    assert not any(ref.signal.copy == "a" for e in evidence if e.says == "spoofed" for ref in e.signals)
