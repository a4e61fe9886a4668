"""What stands of each detector in the verdict, from pieces of evidence made by hand."""

import itertools

import numpy as np
import pytest

from skyproof.app.protect.methods import count_by_detector
from skyproof.detectors.adapter import finding_from_evidence
from skyproof.explain import explain
from skyproof.records import Evidence, Finding, Hypothesis, SignalId, SignalRef

START = np.datetime64("2022-01-01T10:00:00", "ns")
ASKED = 1e-5


def make_evidence(says, p_value=None, window=0, **more):
    """Make evidence of the window of ten seconds with this number."""
    begin = START + np.timedelta64(10 * window, "s")
    return finding_from_evidence(
        Evidence(
            detector="residual",
            start_gpst=begin,
            end_gpst=begin + np.timedelta64(10, "s"),
            subject=(),
            says=says,
            because=more.pop("because", says),
            p_value=p_value,
            false_alarm_probability=ASKED,
            **more,
        )
    )


def make_assumed(window=0):
    """Make evidence that a sky is true by an assumption, without a test."""
    begin = START + np.timedelta64(10 * window, "s")
    return Finding(
        detector="residual",
        start_gpst=begin,
        end_gpst=begin + np.timedelta64(10, "s"),
        signals=(),
        hypothesis=Hypothesis.FALSE_SKY,
        code="goes_on",
        alpha=ASKED,
        data={"assumes": ("clean_start",), "by": ("place",), "clean_until": "10:00:10"},
    )


def make_method(*pieces):
    (found,) = count_by_detector(pieces)
    return found.method()


FAILED = make_evidence(
    "undecided", 6.6e-236, 2, because="12 satellites do not fit one position", would_need="a second receiver"
)


@pytest.mark.parametrize("order", list(itertools.permutations(range(4))))
def test_a_failed_test_outranks_passed_ones(order):
    pieces = [
        make_evidence("clean", 0.57),
        make_evidence("authentic", 1e-9, 1),
        FAILED,
        make_evidence("clean", 0.073, 3),
    ]
    found = make_method(*(pieces[k] for k in order))
    assert (found.decision, found.p_value, found.tests) == ("failed", 6.6e-236, 4)
    assert (found.from_gpst, found.to_gpst) == ("2022-01-01T10:00:20.000", "2022-01-01T10:00:30.000")
    assert found.would_need == explain(FAILED).remedy


def test_of_failed_tests_the_least_p_stands_with_its_window():
    worse = make_evidence("undecided", 0.0, 5, statistic=9e4, threshold=21.0)
    found = make_method(FAILED, worse, make_evidence("undecided", 3e-7, 6), make_evidence("clean", 0.3, 7))
    assert (found.p_value, found.statistic, found.threshold) == (0.0, 9e4, 21.0)
    assert found.from_gpst == "2022-01-01T10:00:50.000"


def test_an_attack_outranks_a_failed_test():
    assert make_method(FAILED, make_evidence("attack", 1e-7, 3)).decision == "attack"
    assert make_method(make_evidence("spoofed", 1e-7, 3), FAILED).decision == "spoofed"


@pytest.mark.parametrize("p_value", [ASKED, 0.5])
def test_what_does_not_decide_has_not_failed(p_value):
    open_ = make_evidence("undecided", p_value, null="one antenna")
    assert make_method(open_, make_evidence("clean", 0.9)).decision == "clean"
    assert make_method(open_).decision == "undecided"


def test_a_test_that_never_ran_gives_its_most_frequent_reason():
    early = make_evidence("undecided", code="few_epochs", because="1 epoch", would_need="more epochs")
    often = [
        make_evidence(
            "undecided", window=k, code="few_satellites", because=f"{k} satellites", would_need="five satellites"
        )
        for k in (1, 2)
    ]
    found = make_method(early, *often)
    assert (found.ran, found.decision, found.p_value) == (False, None, None)
    reason = explain(often[0])
    assert (found.why_not, found.would_need) == (reason.sentence, reason.remedy)
    assert (found.from_gpst, found.to_gpst) == (None, None)


def test_a_remark_alone_is_no_test():
    remark, reason = (
        make_evidence("clean", noted=True),
        make_evidence("undecided", code="few_satellites", because="two satellites"),
    )
    found = make_method(remark, reason)
    assert (found.ran, found.decision, found.tests, found.why_not) == (False, None, 0, explain(reason).sentence)
    assert make_method(remark).why_not == explain(remark).sentence


def test_what_has_no_p_value_shows_none_of_another_test():
    found = make_method(make_evidence("clean", 0.02), make_assumed(window=1))
    assert (found.decision, found.p_value, found.from_gpst) == ("authentic", None, "2022-01-01T10:00:10.000")


def test_what_is_said_without_a_p_value_ran():
    assert make_method(make_assumed(), make_evidence("undecided", code="few_satellites")).ran


def test_a_remark_on_the_input_is_no_reason_for_deciding_nothing():
    common = {
        "detector": "ins_array",
        "start_gpst": START,
        "end_gpst": START + np.timedelta64(10, "s"),
        "signals": (SignalRef("rx1", SignalId("G05")),),
        "hypothesis": Hypothesis.SKY_DIRECTIONS,
    }
    remark = Finding(code="antennas_noisy", data={"antennas": ("1", "3")}, **common)
    reason = Finding(code="no_place", **common)
    found = make_method(remark, remark, reason)
    assert (found.ran, found.why_not, found.would_need) == (False, explain(reason).sentence, explain(reason).remedy)
