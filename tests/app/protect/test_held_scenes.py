"""Ready-made scenes through the whole of `protect`: what is held while overlapping signals pull."""

import importlib
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def scenes():
    sys.path.insert(0, str(Path(__file__).parents[3] / "bench"))
    try:
        yield importlib.import_module("held")
    finally:
        sys.path.pop(0)


def run_samples(held, name, folder):
    return held.row_of(held.scene_named(name, short=True), name, folder, "navigation", samples=True)


def run_correlators(held, name, folder):
    return held.row_of(held.scene_named(name), name, folder, "navigation", samples=False)


@pytest.mark.parametrize("name", ["texbat-like-4", "texbat-like-5", "texbat-like-6"])
def test_drawn_likenesses_are_named_and_nothing_false_is_trusted(scenes, name, tmp_path):
    # The sixth pushes the position of a car of which only the oscillator is known: the false clock is the true one.
    row = run_correlators(scenes, name, tmp_path)
    print(row)
    assert row["verdict"] == "spoofed"
    assert row["alarms_before"] == 0
    assert row["after_pull_s"] < 20.0
    assert row["trusted"] > 100
    assert row["trusted_worst_m"] < 10.0
    assert row["ordinary_clock_m"] > 50.0


def test_a_roof_in_austin_that_is_drawn_off_keeps_its_place(scenes, tmp_path):
    row = run_samples(scenes, "static-austin", tmp_path)
    print(row)
    assert row["verdict"] == "spoofed"
    assert row["alarms_before"] == 0
    assert row["trusted"] > 600  # of 5 a second over 130 s
    assert row["trusted_95_m"] < 10.0
    assert row["trusted_worst_m"] < 30.0
    assert row["ordinary_worst_m"] > 30.0


def test_an_approach_at_too_low_a_rate_is_not_authentic(scenes, tmp_path):
    # 5 Msps part signals from 0.2 chip on: too few satellites show two for a word, and nothing false is trusted.
    row = run_samples(scenes, "las-vegas", tmp_path)
    print(row)
    assert row["verdict"] in ("no_attack_seen", "suspect", "spoofed")
    assert row["alarms_before"] == 0
    assert row["trusted"] == 0 or row["trusted_worst_m"] < 30.0
    assert row["ordinary_worst_m"] > 100.0
