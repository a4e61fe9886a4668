"""Attacks and clean skies drawn at random, judged as `protect` judges: `bench/drawn.py`."""

import importlib
import sys
from pathlib import Path
from types import ModuleType
from typing import get_args

import pytest

from skyproof.app.common.progress import Silent
from skyproof.app.common.settings import Settings
from skyproof.app.protect import judge, methods
from skyproof.records import Says
from skyproof.studies.random_scenes import build_scene, draw_scene

BENCH = Path(__file__).parents[2] / "bench"


def _load_bench() -> ModuleType:
    sys.path.insert(0, str(BENCH))
    try:
        return importlib.import_module("drawn")
    finally:
        sys.path.remove(str(BENCH))


drawn = _load_bench()
SHORT = {"duration_s": 25.0, "most_receivers": 2}
"""Of the scenes of the fast tests."""


def draw_rows(attacks: int, clean: int, **options) -> list[dict]:
    rows = [drawn.examined(name, **options) for name in drawn.names_of({"attack": attacks, "clean": clean})]
    return [row for row in rows if row["verdict"] != "no scene"]


def test_a_row_follows_from_its_name():
    first, other = (drawn.examined("attack-2", **SHORT) for _ in range(2))
    assert first | {"seconds": 0.0} == other | {"seconds": 0.0}


def list_names(rows):
    return [row["name"] for row in rows]


def test_a_late_copy_of_the_sky_counts_as_any_other_attack():
    # In this scene "multipath" is said of one window.
    row = drawn.examined("attack-90")
    assert not drawn.wrong_attacks([row])
    assert set(methods.STRENGTH) == {"failed", *get_args(Says)}


def test_drawn_clean_skies_are_never_called_spoofed():
    rows = draw_rows(0, 4, **SHORT)
    assert not list_names(row for row in rows if row["verdict"] == "spoofed" or row["wrong_labels"])
    assert not list_names(drawn.wrong_attacks(rows))


def test_no_drawn_attack_moves_a_trusted_fix():
    rows = draw_rows(8, 0, **SHORT)
    assert not list_names(drawn.wrong_attacks(rows))


def test_beside_possible_echoes_no_second_sky_is_shown_true():
    # Five satellites of a weak sky 12 m off, received by both receivers of which nothing is stated.
    made = build_scene(draw_scene("attack-318", most_receivers=2))
    heard = drawn.heard_of(made)
    outcome, _ = judge([h.reception for h in heard], made.navigation, Settings(), Silent())
    assert outcome.decision.verdict == "no_attack_seen"
    assert not [s for s in outcome.decision.labels if s.label == "authentic"]


@pytest.mark.long
def test_no_drawn_attack_of_hundreds_moves_a_trusted_fix():
    rows = draw_rows(300, 0)
    assert not list_names(drawn.wrong_attacks(rows))


@pytest.mark.long
def test_hundreds_of_drawn_clean_skies_are_never_called_spoofed():
    rows = draw_rows(0, 300)
    assert not list_names(row for row in rows if row["verdict"] == "spoofed" or row["wrong_labels"])
    assert not list_names(drawn.wrong_attacks(rows))
