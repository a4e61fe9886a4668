"""When an attack began and ended."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.fusion.labels import LabelledSignal
from skyproof.fusion.timeline import date_end, date_onset
from skyproof.records import SignalId, SignalRef


def label_false(invented, name, first, last, receiver="rx1"):
    return LabelledSignal(
        ref=invented.ref(name, receiver), label="spoofed", first_epoch=first, last_epoch=last, because=()
    )


def test_the_onset_lies_between_a_miss_and_a_find(invented):
    o = invented.observations(("G05a", "G07b"), found={"G07b": (11.5, 12.0)})
    onset = date_onset([invented.ref("G07b")], [o])
    assert (onset.earliest, onset.seen) == (invented.at(11.5), invented.at(12.02))  # the search takes 20 ms
    assert onset.gpst == invented.at(11.76)
    assert onset.sigma_s == pytest.approx(0.52 / np.sqrt(12.0))


def test_the_earliest_of_all_receivers_counts(invented):
    observed = [
        invented.observations(("G05b", "G07b"), found={"G05b": (12.0, 12.5), "G07b": (11.0, 12.0)}),
        invented.observations(("G05b",), receiver="rx2", begin_s=3, found={"G05b": (6.5, 7.0)}),
    ]
    refs = [invented.ref("G05b"), invented.ref("G07b"), invented.ref("G05b", "rx2")]
    assert date_onset(refs, observed).gpst == invented.at(9.76)  # by rx2, which began 3 s later
    assert date_onset(refs[:2], observed).gpst == invented.at(11.51)


def test_what_the_first_search_found_was_there_from_the_start(invented):
    o = invented.observations(("G05b", "G07b"), begin_s=5, found={"G07b": (11.0, 12.0)})
    onset = date_onset([invented.ref("G05b"), invented.ref("G07b")], [o])
    assert (onset.gpst, onset.sigma_s, onset.from_start) == (invented.at(5), None, True)


def test_hidden_signals_were_present_when_seen_at_the_latest(invented):
    # The invented signals of a satellite have the same delay: what parts from another one may have lain upon it.
    o = invented.observations(("G05a", "G05b"), found={"G05b": (11.5, 12.0)})
    onset = date_onset([invented.ref("G05b")], [o])
    assert (onset.seen, onset.earliest, onset.from_start) == (invented.at(12.02), None, False)
    assert (onset.gpst, onset.sigma_s) == (onset.seen, None)


@pytest.mark.parametrize(("band", "code", "hidden"), [("L1", "CA", True), ("L5", "Q", False)])
def test_what_hides_a_signal_is_two_chips_of_its_own(invented, band, code, hidden):
    o = invented.observations(("G05a", "G05b"), found={"G05b": (11.5, 12.0)})
    signals = tuple(SignalId("G05", band, code, copy) for copy in "ab")
    range_m = o.pseudorange_m + [0.0, 100.0]  # a third of a chip of C/A, three of L5
    onset = date_onset([SignalRef("rx1", signals[1])], [replace(o, signals=signals, pseudorange_m=range_m)])
    assert (onset.earliest is None) is hidden


def test_no_signal_has_no_onset(invented):
    assert date_onset([], [invented.observations()]) is None


def test_the_attack_ends_when_all_receivers_go_on_without_it(invented):
    observed = [invented.observations(("G05b",), receiver=receiver) for receiver in ("rx1", "rx2")]
    ended = [label_false(invented, "G05b", 10, 30), label_false(invented, "G05b", 10, 31, "rx2")]
    assert date_end(ended, observed) == invented.at(31)
    assert date_end([ended[0], label_false(invented, "G05b", 10, 38, "rx2")], observed) is None  # one s before the end
    assert date_end([], observed) is None


def test_the_last_false_signal_decides_the_end(invented):
    o = invented.observations(("G05b", "G07b"))
    assert date_end([label_false(invented, "G05b", 10, 20), label_false(invented, "G07b", 12, 33)], [o]) == invented.at(
        33
    )
    assert date_end([label_false(invented, "G05b", 10, 20), label_false(invented, "G07b", 12, 39)], [o]) is None
