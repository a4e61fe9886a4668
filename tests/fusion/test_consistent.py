"""At which epochs no test of a receiver has failed."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.fusion.consistent import find_doubtful_epochs, find_unsuspected_epochs
from skyproof.fusion.decide import WindowWord
from skyproof.fusion.fuse import Decision
from skyproof.fusion.labels import FalseSource
from skyproof.fusion.suspicion import Suspicion
from skyproof.fusion.timeline import Onset
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
    doubtful = find_doubtful_epochs(LOG, make_decision("nnsan"), within_s=7.0)
    assert set(np.flatnonzero(doubtful)) == set(range(13, 20))
    assert not find_doubtful_epochs(LOG, make_decision("nnnnn"), within_s=7.0).any()


def test_signals_that_nothing_dates_leave_no_epoch():
    assert not list_seconds(make_decision("nnnnn", suspected="rx1"))
