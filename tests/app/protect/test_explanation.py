"""Why the word of a run is no stronger, by what was decided and not by how it is worded."""

import numpy as np
import pytest
from tests.app.test_shown import NOBODY, describe_samples

from skyproof.app.protect.explanation import describe_unexplained, explain_word, why_untested
from skyproof.app.protect.outcome import Outcome, ReceiverOutcome
from skyproof.app.protect.summary import summarize
from skyproof.app.receive.reception import Reception
from skyproof.fusion.fuse import Decision
from skyproof.fusion.suspicion import Suspicion
from skyproof.fusion.unexplained import Unexplained
from skyproof.records import Cause, Finding, Hypothesis, SignalId, SignalRef

START = np.datetime64("2024-05-14T10:00:00", "ns")
ODD = Unexplained(ref=SignalRef("bow", SignalId("G05", copy="b")), kind="rival", cn0_dbhz=44.0, over_db=3.0)


def make_outcome(reception: Reception, finding: Finding | None = None) -> Outcome:
    suspicion = Suspicion(receivers=("bow",), onset=None, finding=finding, may_also_be=("fault",))
    decision = Decision(
        verdict="suspect",
        labels=(),
        sources=(),
        skies=(),
        onset=None,
        until=None,
        open=None,
        suspicion=suspicion,
        unexplained=(ODD,),
    )
    receiver = ReceiverOutcome(reception=reception)
    evidence = () if finding is None else (finding,)
    return Outcome(receivers=(receiver,), decision=decision, evidence=evidence, sets=(), navigation=NOBODY)


def make_reception(remarks: tuple[str, ...] = (), left_out: str | None = None) -> Reception:
    return Reception(
        source=describe_samples("bow"),
        observations=None,
        decoded=NOBODY,
        n_signals=0,
        examined_s=3.0,
        remarks=remarks,
        left_out=left_out,
    )


def make_failed(because: str) -> Finding:
    return Finding(
        detector="package",
        start_gpst=START,
        end_gpst=START + np.timedelta64(10, "s"),
        signals=(ODD.ref,),
        hypothesis=Hypothesis.ONE_POSITION,
        code="said",
        p={Cause.CLEAN: 1e-9},
        alpha=1e-3,
        data={"because": because, "would_need": "", "words_assumed": ()},
    )


@pytest.mark.parametrize("repeats", [False, True])
def test_odd_signals_are_told_beside_a_failed_test(repeats: bool) -> None:
    # Also where a detector's own sentence holds the same words.
    words = describe_unexplained((ODD,))
    found = make_outcome(make_reception(), make_failed(f"as {words} say" if repeats else "ranges differ"))
    why = explain_word(found)
    assert not why.of_unexplained
    assert summarize(found, why).count(words) == 1 + repeats


def test_odd_signals_are_told_once_where_they_are_the_reason() -> None:
    found = make_outcome(make_reception())
    why = explain_word(found)
    assert why.of_unexplained
    assert summarize(found, why).count(describe_unexplained((ODD,))) == 1


def test_a_remark_is_told_whatever_it_begins_with() -> None:
    # Why a receiver is left out is told once, and is no remark of its own.
    remark = "left out: 7 cells"
    result = why_untested(make_outcome(make_reception((remark,), "deaf")))
    assert result == f"bow: deaf; {remark}"
    assert [noted.rpartition(" ")[2] for noted in make_reception((), "deaf").noted] == ["deaf"]
