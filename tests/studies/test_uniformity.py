"""Every test of the package has uniform p-values under its null, or is as far from that as it says."""

import importlib
import inspect
import pkgutil

import pytest
from scipy import stats
from tests.studies.quick import run_study

import skyproof.detectors
import skyproof.statistics
from skyproof.statistics.distributions import binomial_two_sided
from skyproof.studies.base import StudySettings
from skyproof.studies.uniformity import CASES, STUDIES, p_values
from skyproof.studies.uniformity_draws import ASKED
from skyproof.studies.validation import check

BY_NAME = {study.name: study for study in STUDIES}
EXACT = [case for case in CASES if case.exact]

# Share of p-values at or below 0.01, over 0.01, of those that are not exact.
OFF = {
    "1b, AR(1) 0.5 estimated": (1.15, 1.45),
    "1b, AR(1) 0.9 estimated": (4.0, 5.2),
    "1b, constant errors of 1 m": (0.5, 0.7),
    "one antenna, any noise; it is white, 1 m": (0.0, 0.0),
    "one antenna, any noise; it is AR(1) 0.9, 3 m": (0.0, 0.1),
    "at most 5 m apart": (0.05, 0.2),
    "along baselines, all three, no baseline": (0.8, 0.95),
    "along baselines, all three, 20 m": (0.02, 0.1),
    "known baseline": (0.8, 0.95),
    "carrier fractions, 0.1 cycles": (0.88, 1.0),
    "a second set of unrelated signals": (0.35, 0.5),
    "second signals by echoes": (0.3, 0.55),
    "one signal, not two": (0.8, 1.25),
    "one signal, not two, over a burst": (0.42, 0.75),
    "code against carrier, alike": (0.93, 1.07),
    "magnitudes, A = 14.14": (0.8, 0.97),
    "magnitudes, A = 4.47": (0.2, 0.3),
    "slow and fast, magnitudes": (0.93, 1.03),
    "parity, 1 ms, A = 4.47": (1.0, 1.1),
    "parity, 5 ms, plain discriminators": (1.08, 1.24),
    "what the attacked satellite leaves": (1.0, 1.15),
    "the paper's two-step rule, 1 ms": (5.0, 5.8),
    "the paper's two-step rule, 10 ms": (5.0, 5.8),
    "time to a false alarm, Crosier's sum": (0.05, 0.15),
    "time to a false alarm, Page's sum": (0.08, 0.18),
    "the paper's, antennas 3 mm off": (26.0, 27.2),
    "calibrated, joint and conditional": (0.84, 0.95),
    "clusters among random directions": (0.0, 0.05),
    "five signals, rate estimated": (0.6, 1.3),
    "predicted directions, start angle estimated": (0.92, 1.06),
    "the paper's rule, direction estimated": (0.0, 0.0),
    "a group that is divided": (0.87, 0.98),
    "values of three means, 3 sigma apart": (0.0, 0.02),
    "support of a coefficient": (0.93, 1.07),
}


def is_uniform(p):
    """Test whether both tails may be those of a uniform p-value, on both sides."""
    return all(binomial_two_sided(int((p <= level).sum()), p.size, level) > 1e-4 for level in (0.001, 0.01, 0.1, 0.5))


@pytest.mark.parametrize("name", ["tests", pytest.param("distribution", marks=pytest.mark.long)])
def test_quick_draws_few(name):
    assert all(row["trials"] <= 10_000 for row in run_study(f"uniformity.{name}"))


def test_a_row_has_the_promised_columns_and_every_test_has_one():
    rows = run_study("uniformity.tests")
    assert [row["test"] for row in rows] == [case.test for case in CASES]
    for row in rows:
        assert set(row) == {
            "test",
            "method",
            "trials",
            "ks",
            "ks_p",
            "tail_01",
            "tail_001",
            "tail_01_low",
            "tail_01_high",
            "exact",
            "why",
        }
        assert row["tail_01_low"] <= row["tail_01"] <= row["tail_01_high"]
        assert bool(row["why"]) is not row["exact"]


def test_exact_tests_have_uniform_p_values_in_the_coarse():
    for row in run_study("uniformity.tests"):
        if row["exact"]:
            assert row["ks_p"] > 1e-4, row
            assert binomial_two_sided(round(row["tail_01"] * row["trials"]), row["trials"], 0.01) > 1e-4, row


def test_claims_hold():
    assert all(item.agrees for item in check(BY_NAME["uniformity.tests"], run_study("uniformity.tests")))


@pytest.mark.long
def test_shares_rise_to_one_and_the_right_line_is_beside_them():
    rows = run_study("uniformity.distribution")
    charts = BY_NAME["uniformity.distribution"].charts
    assert {row["group"] for row in rows} == {chart.where["group"] for chart in charts}
    for case in CASES:
        shares = [row["share"] for row in rows if row["test"] == case.test and row["method"] == case.method]
        assert len(shares) == len(ASKED)
        assert shares == sorted(shares)
        assert shares[-1] == 1.0
    right = [row for row in rows if row["test"] == "uniform"]
    assert all(row["share"] == row["p"] for row in right)
    assert len(right) == len(ASKED) * len({case.group for case in CASES})


def test_a_seed_gives_the_same_p_values_whatever_else_is_drawn():
    settings = StudySettings(trials=100, seed=3)
    alone = [p_values(case, settings).tobytes() for case in CASES[:4]]
    assert alone == [p_values(case, settings).tobytes() for case in CASES[3::-1]][::-1]
    assert len(set(alone)) == 4


# Where the p-values of a module that is not named are made; None where it makes none, or its own tests count them.
MADE_ELSEWHERE = {
    "adapter": None,
    "leave_out": None,
    "exchange": None,
    "policy": None,
    "agreement": "ins_array",
    "arm_phases": "spin",
    "array_model": "ins_array",
    "bands": None,
    "base": None,
    "beats": None,
    "carrier_break": None,
    "phases": None,
    "beats_detector": None,
    "code_carrier": None,
    "code_doppler": None,
    "code_motion": None,
    "divergence": None,
    "laws": None,
    "own_fixes": None,
    "torn": None,
    "messages": None,
    "levels": None,
    "parts": None,
    "statements": "one_antenna",
    "known_place": None,
    "place": None,
    "inertia": None,
    "course": None,
    "free_navigators": None,
    "unit_errors": None,
    "walk": None,
    "choice": None,
    "snapshot": None,
    "registry": None,
    "carriers": None,
    "coherence": None,
    "causes": None,
    "delays": "bursts",
    "continuity": None,
    "code_drag": None,
    "steps": None,
    "whole_sky": None,
    "known_geometry": None,
    "late_copies": None,
    "echoes": "second_signals",
    "further_signals": "second_signals",
    "multi_receiver": "one_antenna",
    "one_set": "one_antenna",
    "over_time": "one_antenna",
    "pairing": "one_antenna",
    "residual_causes": "residual",
    "runs": "one_antenna",
    "second_component": None,
    "second_sky": "chance",
    "skies_fit": "chance",
    "several_sets": "one_antenna",
    "sqm_detector": "sqm",
    "vector_cusum": None,
    "vector_sqm_detector": "vector_parity",
    "window": "one_antenna",
}


def test_no_module_with_p_values_is_forgotten():
    named = {method for case in CASES for method in case.method.split(", ")}
    for package in (skyproof.detectors, skyproof.statistics):
        for found in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            *_, folder, name = found.name.split(".")
            name = folder if name == "detector" else name
            if "p_value" in inspect.getsource(importlib.import_module(found.name)) and name not in named:
                assert name in MADE_ELSEWHERE, f"no p-value of {name} is drawn"
                assert MADE_ELSEWHERE[name] in named | {None}


@pytest.mark.long
@pytest.mark.parametrize("case", EXACT, ids=lambda case: f"{case.method}: {case.test}")
def test_p_values_of_exact_tests_are_uniform(case):
    p = p_values(case, StudySettings(seed=2))
    assert stats.kstest(p, "uniform").pvalue > 1e-4
    assert is_uniform(p)


@pytest.mark.long
@pytest.mark.parametrize("case", [case for case in CASES if not case.exact], ids=lambda case: f"{case.test}")
def test_tests_that_are_not_exact_are_off_by_what_they_say(case):
    low, high = OFF[case.test]
    p = p_values(case, StudySettings(seed=2))
    assert low <= (p <= 0.01).mean() / 0.01 <= high


def test_those_that_are_not_exact_are_those_that_are_off():
    assert set(OFF) == {case.test for case in CASES if not case.exact}
