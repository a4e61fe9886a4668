"""Evidence of the contract before findings says as a finding what it said."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from skyproof.detectors.adapter import finding_from_evidence, restore
from skyproof.explain import explain, stands_beside
from skyproof.records import Evidence, SignalId, SignalRef

START = np.datetime64("2022-01-01", "ns")
PLAIN = Evidence(
    detector="odd",
    start_gpst=START,
    end_gpst=START + np.timedelta64(10, "s"),
    subject=(SignalRef("rx1", SignalId("G05", "L1", "CA", "a")),),
    says="undecided",
    because="so it is",
    would_need="more",
    assumes=("the sky is blue",),
)
WORDS = ("authentic", "spoofed", "attack", "multipath", "undecided", "clean")


@pytest.mark.parametrize(("says", "alpha", "p_value"), list(product(WORDS, [None, 1e-3], [None, 1e-5, 0.4])))
def test_the_word_stays(says, alpha, p_value):
    if says in ("spoofed", "attack") and alpha is not None and p_value == 0.4:
        pytest.skip("no evidence that can be used: an alarm above its stated rate")
    evidence = replace(PLAIN, says=says, false_alarm_probability=alpha, p_value=p_value)
    finding = finding_from_evidence(evidence)
    words = {"clean", "undecided"} if says in ("clean", "undecided") and not evidence.failed else {says}
    assert finding.says in words
    assert finding.failed == evidence.failed


@pytest.mark.parametrize("overrules", [False, True])
def test_a_failed_test_keeps_its_causes_and_what_it_overrules(overrules):
    causes = ("shade", "fault")
    failed = replace(
        PLAIN, false_alarm_probability=1e-3, p_value=1e-9, overrules=overrules, may_also_be=causes, noted=True
    )
    finding = finding_from_evidence(failed)
    assert (finding.failed, finding.overrules, finding.may_also_be) == (True, overrules, causes)
    assert finding.p_value == 1e-9
    assert stands_beside(finding)


def test_a_failed_test_that_names_no_cause_is_no_attack():
    finding = finding_from_evidence(replace(PLAIN, false_alarm_probability=1e-3, p_value=1e-9))
    assert (finding.says, finding.failed) == ("undecided", True)


def test_words_and_the_evidence_itself_are_kept():
    finding = finding_from_evidence(PLAIN)
    words = explain(finding)
    assert (words.sentence, words.remedy, words.assumptions) == (PLAIN.because, PLAIN.would_need, PLAIN.assumes)
    other = replace(finding, detector="even")
    assert restore([finding, other], "odd") == [PLAIN, other]
