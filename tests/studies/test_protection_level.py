"""Fixes against their protection levels, where the risks asked can be counted."""

import pytest
from scipy import stats

from skyproof.studies.base import StudySettings
from skyproof.studies.protection_level import RISKS, STUDIES

(STUDY,) = STUDIES


def assert_held(rows):
    """Check that no more errors exceed the level than requested, whatever the bias.

    On one axis, without a fault, as many do as the covariance has.
    """
    for row in rows:
        risk, trials = row["integrity_risk"], row["trials"]
        assert stats.binomtest(row["beyond"], trials, risk, alternative="greater").pvalue > 1e-4, row
        if row["share_beyond_covariance"] is not None:
            count = round(row["share_beyond_covariance"] * trials)
            which = "two-sided" if row["axis"] == "vertical" else "greater"
            assert stats.binomtest(count, trials, risk, alternative=which).pvalue > 1e-4, row


@pytest.fixture(scope="module")
def rows():
    return list(STUDY.run(StudySettings(quick=True, trials=960)))


def test_no_more_fixes_are_beyond_their_level_than_asked(rows):
    assert_held(rows)
    assert {row["integrity_risk"] for row in rows} == set(RISKS)


def test_a_detected_bias_has_no_level_and_others_move_the_fix(rows):
    for axis in ("horizontal", "vertical"):
        matching = {row["bias_sigma"]: row for row in rows if row["axis"] == axis and row["integrity_risk"] == RISKS[0]}
        assert matching[0.0]["with_level"] > 0.99
        assert matching[30.0]["with_level"] < 0.01
        assert matching[5.0]["error_p50_m"] > 3.0 * matching[0.0]["error_p50_m"]
        assert matching[0.0]["protection_p50_m"] > matching[0.0]["error_p50_m"]


@pytest.mark.long
def test_fixes_beyond_their_level_keep_the_asked_rate():
    found = list(STUDY.run(StudySettings()))
    assert_held(found)
    assert max(row["beyond"] for row in found) > 0  # the level is no larger than need be by far
