"""The studies of the paper on a spinning antenna: rows as promised, and every claim held."""

import pytest
from tests.studies.quick import assert_holds, run_study

from skyproof.studies.spin import STUDIES

NAMES = ("roc", "dead-zone", "solid-angle", "scenario", "samples", "circular", "protect")


@pytest.mark.parametrize("name", NAMES)
def test_every_claim_is_held_and_quick_is_quick(name):
    assert_holds(f"spin.{name}")


def test_all_studies_are_named():
    assert {f"spin.{name}" for name in NAMES} == {study.name for study in STUDIES}


def test_dead_zones_match_table_1_and_full_ones_are_smaller():
    rows = run_study("spin.dead-zone")
    assert all(set(row) == {"test", "reference", "n", "blocks"} for row in rows)
    table = {150: (278, 389, 266, 398), 200: (201, 318, 194, 296)}
    references = ("(40, 35)", "(160, 20)", "(240, 55)", "(320, 70)")
    found = {(row["test"], row["reference"], row["n"]): row["blocks"] for row in rows}
    for n, counts in table.items():
        for reference, count in zip(references, counts, strict=True):
            assert abs(found[("paper", reference, n)] - count) <= 1
            assert 20 * found[("full", reference, n)] <= found[("paper", reference, n)]


def test_solid_angles_are_forty_times_smaller():
    rows = run_study("spin.solid-angle", quick=False)
    share = {(row["test"], row["reference"], row["n"]): row["share"] for row in rows}
    for reference, ratio, small in (
        ("(40, 35)", 42.0, 2.6e-4),
        ("(160, 20)", 40.6, 4.4e-4),
        ("(240, 55)", 40.7, 1.8e-4),
        ("(320, 70)", 40.5, 1.6e-4),
    ):
        full = share[("full", reference, 150)]
        assert share[("paper", reference, 150)] / full == pytest.approx(ratio, rel=0.04)
        assert full == pytest.approx(small, rel=0.05)


def test_the_scenario_is_counted_as_computed():
    rows = run_study("spin.scenario", quick=False)
    found = {(row["pair"], row["test"]): row for row in rows}
    for pair, limit in (("[3,1]", 22.0503), ("[4,1]", 0.0760), ("[2,1]", 0.0201)):
        assert found[(pair, "paper")]["threshold"] == pytest.approx(limit, abs=5e-5)
    for row in rows:
        assert row["p_d_simulated"] == pytest.approx(row["p_d_theory"], abs=0.003), row
        assert row["authentic_p_fa_simulated"] == pytest.approx(0.01, abs=0.0014), row
    assert found[("[4,1]", "full")]["p_d_theory"] > 0.99999


def test_the_seed_gives_the_rows():
    assert run_study("spin.scenario", trials=500) == run_study.__wrapped__("spin.scenario", trials=500)
    assert run_study("spin.scenario", trials=500) != run_study("spin.scenario", trials=500, seed=2)


def test_protect_names_both_false_signals_and_no_true_one():
    rows = run_study("spin.protect")
    assert {row["sat"] for row in rows} == {"G01", "G02", "true"}
    assert all(row["named_share"] == (row["sat"] != "true") for row in rows)
