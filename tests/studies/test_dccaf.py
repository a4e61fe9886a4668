"""The studies of decomposition and inverse RAIM: rows as promised, and figures within their bounds."""

from itertools import pairwise

import numpy as np
import pytest
from scipy import stats

from skyproof.studies import dccaf, inverse_raim
from skyproof.studies.base import StudySettings
from skyproof.studies.validation import check

KEYS = [
    "method",
    "rate_hz",
    "separation_chip",
    "cn0_dbhz",
    "coherent_ms",
    "power_db",
    "doppler_hz",
    "success",
    "rms_chip",
    "crlb_chip",
    "ms_per_satellite",
    "trials",
]
FOUND = {study.name: study for study in (*dccaf.STUDIES, *inverse_raim.STUDIES)}


@pytest.fixture(scope="module")
def separation():
    return list(FOUND["dccaf.separation"].run(StudySettings(quick=True, seed=3)))


@pytest.mark.long
def test_separation_has_the_promised_rows_with_the_swarm_beside(separation):
    assert all(list(row) == KEYS for row in separation)
    assert {row["method"].split()[0] for row in separation} == {"variable", "swarm"}


@pytest.mark.long
def test_two_signals_are_separated_at_the_bound(separation):
    ours = {row["rate_hz"]: row for row in separation if row["method"] == "variable projection"}
    for rate_hz, success in ((5e6, 0.98), (10e6, 0.99), (25e6, 0.99)):
        assert ours[rate_hz]["success"] >= success
        assert ours[rate_hz]["rms_chip"] <= 1.1 * ours[rate_hz]["crlb_chip"]
    swarm = [row["success"] for row in separation if row["method"].startswith("swarm")]
    assert max(swarm) < min(row["success"] for row in ours.values())


@pytest.mark.long
def test_false_second_signals_come_as_asked():
    rows = list(FOUND["dccaf.count"].run(StudySettings(quick=True, trials=4000, seed=4)))
    for row in rows:
        if row["case"] == "one signal" and row["noise"] != "other satellites" and row["p_fa_asked"] >= 0.01:
            sigma = np.sqrt(2.0 * row["p_fa_asked"] / row["trials"])  # the law is counted, too
            assert row["counted_as_two"] == pytest.approx(row["p_fa_asked"], abs=3.5 * sigma + 0.1 * row["p_fa_asked"])


def test_a_wrongly_stated_noise_scales_the_statistic():
    delays = dccaf.delay_dictionary(5e6)
    delay, amplitude = np.full((20, 1), 0.1), np.ones((20, 1), complex)
    taps = dccaf.simulate_taps(delay, amplitude, 0.002, delays, np.random.default_rng(6))
    first, second = (dccaf.count_statistic(taps, delays, reported)[0] for reported in (0.002, 0.003))
    np.testing.assert_allclose(first, 1.5 * second, rtol=1e-5)


@pytest.mark.parametrize(
    "name", ["dccaf.approach", *(pytest.param(name, marks=pytest.mark.long) for name in ("dccaf.grid", "dccaf.noise"))]
)
def test_every_quick_figure_is_found_within_its_tolerance(name):
    study = FOUND[name]
    for item in check(study, list(study.run(StudySettings(quick=True, seed=2)))):
        assert item.agrees is not False, (item.claim.what, item.same, item.better)
        assert "not found" not in item.cells()


def test_a_restart_helps_as_predicted_and_with_velocity_more():
    rows = list(FOUND["dccaf.restart"].run(StudySettings(trials=300)))
    for errors in ("table 1", "switch-on, start"):
        east = [row["east_m"] for row in rows if row["errors"] == errors]
        assert len(east) == 4
        assert all(after < 0.6 * before for before, after in pairwise(east))
    for row in rows:
        for axis in ("east", "north", "up"):
            assert row[f"{axis}_m"] == pytest.approx(row[f"{axis}_predicted_m"], rel=0.17)  # 4.1 % is one sigma


def test_soon_after_a_clean_fix_the_choice_is_as_predicted():
    rows = list(FOUND["dccaf.interval"].run(StudySettings(trials=800)))
    assert {row["interval_s"] for row in rows} == {10, 15, 20, 30, 40, 60, 100}
    for row in rows:
        assert row["east_m"] == pytest.approx(row["east_predicted_m"], rel=0.11)  # 2.5 % is one sigma
        assert stats.binomtest(round(row["wrong_covariance"] * 800), 800, row["wrong_predicted"]).pvalue > 1e-4


def test_drift_and_wrong_choice_are_as_predicted():
    rows = list(FOUND["dccaf.exclusion"].run(StudySettings(trials=150)))
    assert {row["grade"] for row in rows} == {"navigation", "tactical"}
    assert {row["time_s"] for row in rows} == {100, 190, 233}
    for row in rows:
        for axis in ("east", "north", "up"):
            assert row[f"{axis}_m"] == pytest.approx(row[f"{axis}_predicted_m"], rel=0.25)  # 5.8 % is one sigma
        predicted = row["wrong_predicted"]
        sigma = np.sqrt(predicted * (1.0 - predicted) / row["trials"])
        assert abs(row["wrong_covariance"] - predicted) < 4.0 * sigma + 0.01


def test_both_searches_find_the_same_sets_in_the_promised_time():
    rows = list(FOUND["inverse-raim.sets"].run(StudySettings(trials=10)))
    timed = {(row["satellites"], row["signals"]): row for row in rows if row["same_sets"] is not None}
    assert all(row["same_sets"] for row in timed.values())
    most = timed[12, 3]
    assert most["sets"] == 531_441
    assert most["ms_exhaustive"] < 45.0  # 5 ms on an idle core; the bound is for a busy machine
    assert most["ms_pruned"] < 1.0
    assert {row["attack"] for row in rows} == {"position", "time"}


@pytest.mark.long
def test_the_promised_figures_hold_at_full_count():
    rows = [row for row in FOUND["dccaf.separation"].run(StudySettings()) if row["method"] == "variable projection"]
    for row in rows:
        if (row["separation_chip"], row["cn0_dbhz"], row["coherent_ms"]) == (0.25, 45.0, 20.0):
            assert row["success"] >= (0.985 if row["rate_hz"] < 6e6 else 0.99)
            assert row["rms_chip"] <= 1.1 * row["crlb_chip"]
    for row in FOUND["dccaf.count"].run(StudySettings()):
        if row["case"] == "one signal" and row["noise"] != "other satellites":
            assert row["counted_as_two"] == pytest.approx(row["p_fa_asked"], rel=0.2)


@pytest.mark.long
@pytest.mark.parametrize("name", [name for name in FOUND if name not in ("dccaf.separation", "dccaf.count")])
def test_no_figure_is_outside_its_tolerance_at_full_count(name):
    study = FOUND[name]
    for item in check(study, list(study.run(StudySettings()))):
        assert item.agrees is not False, (item.claim.what, item.same, item.better)


def test_protect_finds_the_pull_over_las_vegas():
    (row,) = FOUND["dccaf.protect"].run(StudySettings(quick=True))
    assert (row["spoofed_share"], row["wrong_labels"], row["wrong_fixes"]) == (1.0, 0.0, 0.0)
    assert row["delay_s"] < 11.0  # at 1 m/s
