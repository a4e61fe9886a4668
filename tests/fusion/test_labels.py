"""Evidence of many windows to labels: what it holds for, and what it does not."""

from dataclasses import replace
from itertools import pairwise

import pytest

from skyproof.fusion.labels import group_false_sources, label_signals, linked

ALL = ("G05a", "G07a", "G10a", "G13a", "G15a")


def list_stretches(labels, name="G05a", receiver="rx1"):
    """List (label, first epoch, last epoch) of one signal's life, and check that no epoch is missing or double."""
    matching = [s for s in labels if str(s.ref) == f"{receiver}:{name[:3]} L1 CA {name[3:]}"]
    for before, after in pairwise(matching):
        assert before.last_epoch < after.first_epoch
    return [(s.label, s.first_epoch, s.last_epoch) for s in matching]


def test_nothing_is_labelled_without_evidence(invented):
    labels = label_signals([], [invented.observations()])
    assert list_stretches(labels) == [("unknown", 0, 39)]
    assert {s.because for s in labels} == {()}


@pytest.mark.parametrize("says", ["clean", "attack", "undecided"])
def test_what_names_no_signal_true_or_false_labels_none(invented, says):
    evidence = [invented.evidence(window, says, *ALL, p_value=0.5) for window in range(4)]
    assert {s.label for s in label_signals(evidence, [invented.observations()])} == {"unknown"}


@pytest.mark.parametrize("says", ["authentic", "spoofed"])
def test_windows_that_agree_make_one_stretch(invented, says):
    evidence = [invented.evidence(window, says, *ALL) for window in range(4)]
    assert list_stretches(label_signals(evidence, [invented.observations()])) == [(says, 0, 39)]


def test_because_names_each_detector_with_its_strongest_p_value(invented):
    evidence = [
        invented.evidence(0, "authentic", "G05a", p_value=1e-7),
        invented.evidence(1, "authentic", "G05a", p_value=1e-12),
        invented.evidence(2, "authentic", "G05a", p_value=1e-9, detector="two"),
        invented.evidence(3, "authentic", "G05a", p_value=None, detector="three"),
    ]
    labels = label_signals(evidence, [invented.observations()])
    assert dict(labels[0].because) == {"one": 1e-12, "two": 1e-9, "three": pytest.approx(1e-6)}


def test_a_label_holds_for_its_receiver_only(invented):
    observed = [invented.observations(receiver=receiver) for receiver in ("rx1", "rx2")]
    labels = label_signals([invented.evidence(w, "authentic", *ALL) for w in range(4)], observed)
    assert list_stretches(labels, receiver="rx1") == [("authentic", 0, 39)]
    assert list_stretches(labels, receiver="rx2") == [("unknown", 0, 39)]


def test_one_copy_says_nothing_of_the_other(invented):
    labels = label_signals(
        [invented.evidence(w, "authentic", "G05a") for w in range(4)], [invented.observations(("G05a", "G05b"))]
    )
    assert list_stretches(labels, "G05b") == [("unknown", 0, 39)]


# --- windows that say nothing


def test_authentic_reaches_across_one_silent_window_but_not_two(invented):
    observed = [invented.observations(duration_s=60)]
    near = [invented.evidence(w, "authentic", "G05a") for w in (0, 1, 3, 4, 5)]
    assert list_stretches(label_signals(near, observed)) == [("authentic", 0, 59)]
    far = [invented.evidence(w, "authentic", "G05a") for w in (0, 1, 4, 5)]
    assert list_stretches(label_signals(far, observed)) == [
        ("authentic", 0, 19),
        ("unknown", 20, 39),
        ("authentic", 40, 59),
    ]


def test_authentic_ends_with_its_evidence(invented):
    # A channel that was captured without a slip goes on as if nothing had happened.
    labels = label_signals([invented.evidence(1, "authentic", *ALL)], [invented.observations()])
    assert list_stretches(labels) == [("unknown", 0, 9), ("authentic", 10, 19), ("unknown", 20, 39)]


def test_spoofed_holds_as_long_as_the_signal_is_tracked(invented):
    labels = label_signals([invented.evidence(2, "spoofed", *ALL)], [invented.observations(duration_s=100)])
    assert list_stretches(labels) == [("unknown", 0, 19), ("spoofed", 20, 99)]  # it may have been captured after 0


def test_a_signal_just_before_its_window_is_spoofed_throughout(invented):
    findings = [invented.evidence(2, "spoofed", "G05a")]
    assert list_stretches(label_signals(findings, [invented.observations(there={"G05a": (16, 39)})])) == [
        ("spoofed", 16, 39)
    ]
    longer = label_signals(findings, [invented.observations(there={"G05a": (14, 39)})])
    assert list_stretches(longer) == [("unknown", 14, 19), ("spoofed", 20, 39)]


def test_no_label_reaches_over_a_slip(invented):
    observed = [invented.observations(slips={"G05a": [20]})]
    labels = label_signals([invented.evidence(0, "spoofed", "G05a")], observed)
    assert list_stretches(labels) == [("spoofed", 0, 19), ("unknown", 20, 39)]


def test_a_window_speaks_for_what_fills_it(invented):
    observed = [invented.observations(slips={"G05a": [17]})]  # 3 s of the window lie behind the slip
    labels = label_signals([invented.evidence(1, "spoofed", "G05a")], observed)
    assert list_stretches(labels) == [("unknown", 0, 9), ("spoofed", 10, 16), ("unknown", 17, 39)]


def test_a_false_signal_that_keeps_slipping_is_spoofed_all_the_same(invented):
    slips = list(range(0, 40, 3))
    observed = [invented.observations(slips={"G05a": slips})]
    (found,) = list_stretches(label_signals([invented.evidence(w, "spoofed", "G05a") for w in range(4)], observed))
    assert found == ("spoofed", 0, 39)
    labels = label_signals([invented.evidence(w, "authentic", "G05a") for w in range(4)], observed)
    assert list_stretches(labels) == [("unknown", 0, 39)]


def test_labels_stay_where_the_signal_was_measured(invented):
    observed = [invented.observations(there={"G05a": (12, 33)})]
    labels = label_signals([invented.evidence(w, "spoofed", "G05a") for w in range(4)], observed)
    assert list_stretches(labels) == [("spoofed", 12, 33)]
    never = [invented.observations(there={"G05a": (50, 60)})]
    assert list_stretches(label_signals([invented.evidence(1, "spoofed", "G05a")], never)) == []


# --- windows that contradict each other


def test_a_captured_channel_is_cut_where_the_evidence_turns(invented):
    says = ["authentic", "authentic", "spoofed", "spoofed"]
    labels = label_signals([invented.evidence(w, s, "G05a") for w, s in enumerate(says)], [invented.observations()])
    assert list_stretches(labels) == [("authentic", 0, 19), ("spoofed", 20, 39)]


@pytest.mark.parametrize(("first", "last"), [("authentic", "spoofed"), ("spoofed", "authentic")])
def test_between_contradicting_windows_nothing_is_known(invented, first, last):
    evidence = [invented.evidence(0, first, "G05a"), invented.evidence(2, last, "G05a")]
    labels = label_signals(evidence, [invented.observations(duration_s=30)])
    assert list_stretches(labels) == [(first, 0, 9), ("unknown", 10, 19), (last, 20, 29)]


@pytest.mark.parametrize("detectors", [("one", "one"), ("one", "two")])
def test_a_window_that_contradicts_itself_decides_nothing(invented, detectors):
    evidence = [
        invented.evidence(1, says, "G05a", detector=detector)
        for says, detector in zip(("authentic", "spoofed"), detectors, strict=True)
    ]
    labels = label_signals(evidence, [invented.observations()])
    assert list_stretches(labels) == [("unknown", 0, 39)]
    assert labels[0].because == ()


def test_two_lives_of_one_signal_have_labels_of_their_own(invented):
    observed = [invented.observations(slips={"G05a": [20]})]
    evidence = [invented.evidence(w, s, "G05a") for w, s in enumerate(["authentic", "authentic", "spoofed", "spoofed"])]
    assert list_stretches(label_signals(evidence, observed)) == [("authentic", 0, 19), ("spoofed", 20, 39)]


# --- tests that failed


def test_authentic_does_not_reach_across_a_failed_test(invented):
    evidence = [invented.evidence(w, "authentic", *ALL) for w in (0, 2, 3)]
    failed = invented.evidence(1, "undecided", *ALL, detector="two", p_value=1e-30)
    labels = label_signals([*evidence, failed], [invented.observations()])
    assert list_stretches(labels) == [("authentic", 0, 9), ("unknown", 10, 19), ("authentic", 20, 39)]


@pytest.mark.parametrize("p_value", [None, 0.01])
def test_a_test_that_did_not_fail_changes_nothing(invented, p_value):
    evidence = [invented.evidence(w, "authentic", *ALL) for w in (0, 2, 3)]
    undecided = invented.evidence(1, "undecided", *ALL, detector="two", p_value=p_value)
    assert list_stretches(label_signals([*evidence, undecided], [invented.observations()])) == [("authentic", 0, 39)]


def test_a_single_fault_costs_its_signal_and_not_the_others(invented):
    failed = [invented.evidence(w, "undecided", *ALL, detector="two", p_value=1e-30) for w in range(4)]
    evidence = [invented.evidence(w, "authentic", *ALL[1:]) for w in range(4)]
    labels = label_signals([*failed, *evidence], [invented.observations()])
    assert list_stretches(labels, "G05a") == [("unknown", 0, 39)]
    assert list_stretches(labels, "G07a") == [("authentic", 0, 39)]


def test_a_test_that_singles_a_signal_out_leaves_that_one_open(invented):
    failed = [
        replace(invented.evidence(w, "undecided", "G05a", detector="two", p_value=1e-30), singled_out=True)
        for w in range(4)
    ]
    for of_others in (ALL, ALL[1:]):
        evidence = [invented.evidence(w, "authentic", *of_others) for w in range(4)]
        labels = label_signals([*failed, *evidence], [invented.observations()])
        assert list_stretches(labels, "G05a") == [("unknown", 0, 39)]
        assert list_stretches(labels, "G07a") == [("authentic", 0, 39)]


def test_a_minority_is_not_authentic_where_most_fail_together(invented):
    # Signals that are drawn off their true delays: a few of them fit each other by chance.
    failed = [invented.evidence(w, "undecided", *ALL, detector="two", p_value=1e-30) for w in (2, 3)]
    evidence = [invented.evidence(w, "authentic", *(ALL if w < 2 else ALL[:3])) for w in range(4)]
    labels = label_signals([*failed, *evidence], [invented.observations()])
    assert list_stretches(labels, "G05a") == [("authentic", 0, 19), ("unknown", 20, 39)]
    assert all(s.because == () for s in labels if s.label == "unknown")


@pytest.mark.parametrize(("withheld", "label"), [((), "unknown"), (("G13a",), "authentic")])
def test_what_fits_and_is_withheld_did_not_make_a_test_fail(invented, withheld, label):
    failed = [invented.evidence(w, "undecided", *ALL, detector="two", p_value=1e-30) for w in range(4)]
    true = [invented.evidence(w, "authentic", *ALL[:3]) for w in range(4)]
    refs = tuple(ref for ref in failed[0].signals if ref.signal.sat + ref.signal.copy in withheld)
    true = [replace(e, estimates={**e.estimates, "withheld": refs}) for e in true]
    labels = label_signals([*true, *failed], [invented.observations()])
    assert list_stretches(labels) == [(label, 0, 39)]
    assert list_stretches(labels, "G13a") == [("unknown", 0, 39)]


def test_another_signal_of_an_authentic_transmission_may_have_made_a_test_fail(invented):
    # The test took the false ones of two satellites that are received twice: directions show which are the sky's.
    observed = [invented.observations((*ALL, "G13b", "G15b"))]
    failed = [invented.evidence(w, "undecided", *ALL, detector="two", p_value=1e-30) for w in range(4)]
    true = [invented.evidence(w, "authentic", *ALL[:3], "G13b", "G15b") for w in range(4)]
    labels = label_signals([*true, *failed], observed)
    assert list_stretches(labels, "G05a") == list_stretches(labels, "G13b") == [("authentic", 0, 39)]
    assert list_stretches(labels, "G13a") == [("unknown", 0, 39)]


def test_a_failed_overruling_test_leaves_its_signals_open(invented):
    broken = invented.evidence(2, "undecided", "G05a", "G07a", detector="two", overrules=True)
    evidence = [*(invented.evidence(window, "authentic", *ALL) for window in range(4)), broken]
    labels = label_signals(evidence, [invented.observations()])
    assert [label for label, *_ in list_stretches(labels)] == ["authentic", "unknown", "authentic"]
    assert list_stretches(labels, "G10a") == [("authentic", 0, 39)]
    passed = invented.restate(broken, p_value=0.5)
    assert list_stretches(label_signals([*evidence[:-1], passed], [invented.observations()])) == [("authentic", 0, 39)]


def test_spoofed_stays_where_a_test_fails(invented):
    evidence = [
        invented.evidence(0, "spoofed", "G05a"),
        invented.evidence(0, "undecided", *ALL, detector="two", p_value=1e-30),
    ]
    assert list_stretches(label_signals(evidence, [invented.observations()]))[0][0] == "spoofed"


# --- sources


def test_groups_are_linked_by_what_they_share():
    assert linked([{1, 2}, {3}, {4, 5}, {2, 4}, {6}]) == [{1, 2, 4, 5}, {3}, {6}]
    assert linked([{1}, {2}, {3}, {1, 2, 3}]) == [{1, 2, 3}]
    assert linked([]) == []


def test_a_transmitter_is_the_same_in_all_windows(invented):
    evidence = [
        invented.evidence(0, "spoofed", "G05b", "G07b"),
        invented.evidence(1, "spoofed", "G07b", "G10b"),
        invented.evidence(1, "spoofed", "G05c", "G07c"),
        invented.evidence(2, "authentic", "G05a", "G05b"),
        invented.evidence(2, "attack", "G05a", "G07c"),
    ]
    sources = group_false_sources(evidence)
    assert [source.name for source in sources] == ["S1", "S2"]
    assert [ref.signal.sat + ref.signal.copy for ref in sources[0].signals] == ["G05b", "G07b", "G10b"]
    assert [ref.signal.sat + ref.signal.copy for ref in sources[1].signals] == ["G05c", "G07c"]
