"""At which epochs no test of a receiver has failed."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.fusion.consistent import (
    Rest,
    find_doubtful_epochs,
    find_unsuspected_epochs,
    name_against_rest,
    select_consistent,
)
from skyproof.fusion.decide import WindowWord
from skyproof.fusion.fuse import Decision
from skyproof.fusion.labels import FalseSource
from skyproof.fusion.suspicion import Suspicion
from skyproof.fusion.timeline import Onset
from skyproof.records import Cause, ConsistentSet, Finding, Hypothesis, SignalRef
from skyproof.testing import MeasuredScene

SCENE = MeasuredScene(antennas_enu_m={"rx1": (0.0, 0.0, 0.0)}, epochs=50, step_s=1.0, max_satellites=4)
(LOG,) = SCENE.records(np.random.default_rng(1)).observations
WORDS = {"n": "no_attack_seen", "a": "authentic", "s": "suspect", "f": "spoofed"}


def make_time(seconds):
    return LOG.gpst[0] + np.timedelta64(round(1e9 * seconds), "ns")


def make_decision(words, *, onset=None, receiver="rx1", suspected=None):
    """Make a decision. words : a letter for each window of 10 s."""
    windows = tuple(
        WindowWord(receiver=receiver, start_gpst=make_time(10 * k), end_gpst=make_time(10 * k + 10), word=WORDS[letter])
        for k, letter in enumerate(words)
    )
    suspicion = None
    if suspected is not None:
        suspicion = Suspicion(receivers=(suspected,), onset=onset, finding=None, may_also_be=())
    return Decision(
        verdict="spoofed" if "f" in words else "suspect" if suspicion else "no_attack_seen",
        labels=(),
        sources=(),
        skies=(),
        onset=onset,
        until=None,
        open=None,
        suspicion=suspicion,
        windows=windows,
    )


def list_seconds(decided):
    return set(np.flatnonzero(find_unsuspected_epochs(LOG, decided)))


@pytest.mark.parametrize(
    ("words", "windows"),
    [
        ("nnnnn", (0, 1, 2, 3, 4)),
        ("nnsnn", (0, 1)),  # the window forgets, the position does not
        ("nsnan", (0, 3, 4)),
        ("aanan", (0, 1, 2, 3, 4)),
        ("sssss", ()),
        ("nsasn", (0, 2)),
    ],
)
def test_only_positive_evidence_ends_what_a_failed_test_began(words, windows):
    assert list_seconds(make_decision(words)) == {10 * k + s for k in windows for s in range(10)}


def test_what_is_dated_before_its_window_begins_there():
    onset = Onset(seen=make_time(25.0), earliest=None)
    assert list_seconds(make_decision("nnnsn", onset=onset, suspected="rx1")) == set(range(25))
    assert list_seconds(make_decision("nnnff", onset=Onset(seen=make_time(25.0), earliest=make_time(21.0)))) == set(
        range(21)
    )
    assert list_seconds(make_decision("nnfan", onset=Onset(seen=make_time(22.0), earliest=None))) == {
        *range(20),
        *range(30, 50),
    }


def test_skies_of_which_one_is_true_date_nothing():
    sky = FalseSource(name="S1", signals=())
    decided = replace(
        make_decision("nnsff", onset=Onset(seen=make_time(0.0), earliest=None, from_start=True)), skies=(sky, sky)
    )
    assert list_seconds(decided) == set(range(20))


def test_an_attack_on_one_receiver_is_on_all_a_suspicion_is_not():
    onset = Onset(seen=make_time(25.0), earliest=None)
    assert list_seconds(make_decision("nnffn", onset=onset, receiver="rx2")) == set(range(25))
    assert list_seconds(make_decision("nnssn", onset=onset, receiver="rx2", suspected="rx2")) == set(range(50))


def test_what_a_failed_test_follows_soon_is_doubtful():
    doubtful = find_doubtful_epochs(LOG, find_unsuspected_epochs(LOG, make_decision("nnsan")), within_s=7.0)
    assert set(np.flatnonzero(doubtful)) == set(range(13, 20))
    assert not find_doubtful_epochs(LOG, np.ones(50, np.bool_), within_s=7.0).any()


FALSE = SignalRef("rx1", LOG.signals[0])


def test_the_rest_goes_on_from_where_tests_of_all_failed_or_soon_did():
    named = frozenset((FALSE,))
    whole = make_decision("nnffn", onset=Onset(seen=make_time(25.0), earliest=None))
    found = select_consistent(LOG, whole, Rest(named=named, decision=make_decision("nnnnn")), within_s=7.0)
    assert set(np.flatnonzero(found.of_rest)) == set(range(13, 50))
    assert set(np.flatnonzero(found.cells[:, 0])) == set(range(13))
    assert found.cells[:, 1:].all()
    assert not found.doubtful.any()
    assert (found.faults == 1).all()


def test_a_rest_that_a_test_rejects_ends_there():
    of_rest = make_decision("nnnsn", onset=Onset(seen=make_time(33.0), earliest=None), suspected="rx1")
    named = frozenset((FALSE, *(SignalRef("rx2", signal) for signal in LOG.signals[1:3])))
    whole = make_decision("nnffn", onset=Onset(seen=make_time(25.0), earliest=None))
    found = select_consistent(LOG, whole, Rest(named=named, decision=of_rest), within_s=7.0)
    assert set(np.flatnonzero(found.cells[:, 1])) == set(range(30))
    assert set(np.flatnonzero(found.doubtful)) == set(range(23, 30))
    assert set(found.faults[13:30]) == {3}  # those of other receivers count
    assert set(found.faults[:13]) == {1}


def name_signals(second, *refs, **data):
    """Make a finding that names signals as false."""
    return Finding(
        detector="test",
        start_gpst=make_time(second),
        end_gpst=make_time(second + 10),
        signals=refs,
        hypothesis=Hypothesis.ONE_POSITION,
        code="false",
        p={Cause.CLEAN: 0.0},
        alpha=1e-6,
        singled_out=True,
        data=data,
    )


def make_set(second, *signals):
    return ConsistentSet(
        receiver="rx1",
        signals=signals,
        gpst=make_time(second),
        position_ecef_m=np.zeros(3),
        clock_bias_s=0.0,
        covariance_m2=np.eye(4),
        statistic=0.0,
        dof=1,
        p_value=1.0,
    )


@pytest.mark.parametrize(
    ("sets", "named"),
    [
        ([(25.0, (1, 2, 3)), (25.0, (0,))], True),
        ([(15.0, (0, 1, 2, 3)), (25.0, (1, 2, 3))], True),  # it was true before
        ([(25.0, (1, 2, 3)), (35.0, (0, 1, 2))], False),  # what most signals fit may be the attacker's
        ([(25.0, (1, 2)), (25.0, (0, 3))], False),  # or either of two
    ],
)
def test_names_are_against_the_rest_unless_most_signals_fit_with_them(sets, named):
    made = [make_set(second, *(LOG.signals[k] for k in some)) for second, some in sets]
    found = name_against_rest(make_decision("nnfff"), [name_signals(20.0, FALSE)], made)
    assert found == (frozenset((FALSE,)) if named else frozenset())


def test_a_refused_or_open_sky_leaves_no_rest():
    decision = make_decision("nnfff")
    assert not name_against_rest(decision, [name_signals(20.0, FALSE), name_signals(30.0, FALSE, whole_sky=True)], [])
    sky = FalseSource(name="S1", signals=())
    assert not name_against_rest(replace(decision, skies=(sky, sky)), [name_signals(20.0, FALSE)], [])


def test_signals_that_nothing_dates_leave_no_epoch():
    assert not list_seconds(make_decision("nnnnn", suspected="rx1"))
