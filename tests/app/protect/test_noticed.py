"""Of each kind of attack the size that the best test of the worst window would have noticed."""

import numpy as np
import pytest
from tests.formats.test_verdict import SAMPLE

from skyproof.app.protect.noticed import list_noticed_sizes
from skyproof.records import Finding, Hypothesis, NoticedAttack, SignalId, SignalRef
from skyproof.verdict import Verdict

START = np.datetime64("2024-01-01T00:00:00", "ns")
G01 = SignalId(sat="G01", band="L1", code="CA", copy="a")


def make_finding(window, *noticed, receiver="rx1", detector="continuity"):
    start = START + np.timedelta64(10 * window, "s")
    return Finding(
        detector=detector,
        start_gpst=start,
        end_gpst=start + np.timedelta64(10, "s"),
        signals=(SignalRef(receiver, G01),),
        hypothesis=Hypothesis.CONTINUOUS,
        code="goes_on",
        estimates={"noticed": noticed},
    )


def test_the_best_test_of_the_worst_window_counts():
    jumps = [NoticedAttack("position_jump", size) for size in (8.0, 12.0, 5.0, 30.0)]
    found = [
        make_finding(0, jumps[0]),
        make_finding(0, jumps[3], detector="other"),
        make_finding(1, jumps[1]),
        make_finding(2, jumps[2]),
    ]
    (size,) = list_noticed_sizes(found)
    assert (size.size, size.unit, size.detector, size.share_of_windows) == (12.0, "m", "continuity", 1.0)


def test_windows_without_a_test_are_counted():
    (size,) = list_noticed_sizes(
        [make_finding(0, NoticedAttack("clock_jump", 3e-8)), make_finding(1), make_finding(2), make_finding(3)]
    )
    assert size.share_of_windows == 0.25
    assert "25 %" in size.words


def test_receivers_stand_apart():
    found = [make_finding(0, NoticedAttack("code_drag", 1.5), receiver=name) for name in ("rx2", "rx1")]
    assert [size.receiver for size in list_noticed_sizes(found)] == ["rx1", "rx2"]


@pytest.mark.parametrize(("word", "shown"), [("authentic", True), ("spoofed", False)])
def test_it_stands_beside_words_that_nothing_was_seen(word, shown):
    verdict = Verdict.model_validate(SAMPLE | {"verdict": word})
    assert any(size.words in words for _, words in verdict.explained for size in verdict.noticed) is shown
