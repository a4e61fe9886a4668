import numpy as np
import pytest
from tests.studies.quick import assert_holds, run_study

from skyproof.studies import studies
from skyproof.studies.base import StudySettings
from skyproof.studies.validation import check
from skyproof.studies.vector_sqm import STUDIES

QUICK = StudySettings(quick=True)
BY_NAME = {study.name: study for study in STUDIES}


def test_every_study_of_the_paper_is_found():
    names = ["false-alarm", "bias", "density", "parameters", "cn0-k", "one-spoofer", "many", "delay", "protect"]
    assert [f"vector-sqm.{name}" for name in names] == list(BY_NAME)
    assert set(BY_NAME) <= set(studies())


@pytest.mark.parametrize("name", sorted(set(BY_NAME) - {"vector-sqm.one-spoofer"}))
def test_every_claim_of_a_study_holds(name):
    assert BY_NAME[name].claims
    assert_holds(name)


def test_false_alarm_rows_have_their_keys_and_figures():
    table = run_study("vector-sqm.false-alarm")
    assert list(table[0]) == ["cn0_dbhz", "k", "p_fa_theory", "p_fa_simulated", "p_fa_rule", "trials"]
    np.testing.assert_allclose([r["p_fa_theory"] for r in table[:3]], [0.7265, 0.4077, 0.0721], atol=5e-4)
    np.testing.assert_allclose([r["p_fa_simulated"] for r in table[:3]], [0.7230, 0.4061, 0.0721], atol=6e-3)
    np.testing.assert_allclose([r["p_fa_rule"] for r in table[:3]], [0.9985, 0.9185, 0.316], atol=6e-3)


def test_detection_of_one_and_of_three():
    table = run_study("vector-sqm.many")
    np.testing.assert_allclose([r["p_d_theory"] for r in table[:3]], [0.911, 0.955, 0.995], atol=2e-3)
    np.testing.assert_allclose([r["p_d_theory"] for r in table], [r["p_d_simulated"] for r in table], atol=5e-3)
    assert all(r["p_d_parity"] > r["p_d_theory"] for r in table[:3])


def test_our_delay_is_at_most_half_of_the_papers():
    table = run_study("vector-sqm.delay")
    ours = [r for r in table if r["method"] == "bank of cumulative sums"]
    assert len(ours) == 7
    assert all(r["of_paper"] <= 0.5 for r in ours)
    first = next(r for r in table if r["method"] == "paper, limits scaled")
    assert first["mean_delay_ms"] == pytest.approx(29.0, abs=2.0)  # simulated independently


def test_loops_lose_lock_at_low_power():
    lost = {r["prn"] for r in run_study("vector-sqm.bias") if r["cn0_dbhz"] == 30 and r["phase_rad"] is None}
    assert lost == {2, 28}


def test_the_density_is_the_counted_one():
    table = [r for r in run_study("vector-sqm.density") if r["metric"] == "phase, rad"]
    counted = np.array([[r["density"], r["density_simulated"]] for r in table])
    assert np.abs(counted[:, 0] - counted[:, 1]).max() < 0.05 * counted.max()


def test_the_same_seed_gives_the_same_rows():
    study, few = BY_NAME["vector-sqm.many"], StudySettings(trials=500, seed=3)
    assert list(study.run(few)) == list(study.run(few))


@pytest.mark.long
def test_every_claim_on_one_spoofer_holds():
    study = BY_NAME["vector-sqm.one-spoofer"]
    table = list(study.run(QUICK))
    assert all(item.agrees for item in check(study, table))
    # on the satellite with the largest noise-free parameter
    whole = [r for r in table if r["attack"] == "both" and r["code_chips"] == 0.4]
    reported = {r["prn"]: (r["tested_prn"], r["p_d_largest"]) for r in whole}
    for prn, tested, p_d in ((12, 2, 0.8484), (13, 20, 0.5814), (17, 20, 0.9252), (28, 2, 0.8884)):
        assert reported[prn] == (tested, pytest.approx(p_d, abs=6e-5))


def test_protect_names_the_attacked_satellite_and_no_other():
    (row,) = run_study("vector-sqm.protect")
    assert (row["spoofed_share"], row["named_share"], row["true_named"]) == (1.0, 1.0, 0.0)
    assert row["delay_s"] < 11.0
