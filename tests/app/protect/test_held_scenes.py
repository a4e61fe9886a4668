"""The paper's two scenes through samples and the whole of `protect`: what is held while overlapping signals pull."""

import importlib
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def held():
    sys.path.insert(0, str(Path(__file__).parents[3] / "bench"))
    try:
        yield importlib.import_module("held")
    finally:
        sys.path.pop(0)


def test_a_roof_in_austin_that_is_drawn_off_keeps_its_place(held, tmp_path):
    row = held.judged("static-austin", tmp_path)
    print(row)
    assert row["verdict"] == "spoofed"
    assert row["alarms_before"] == 0
    assert row["trusted"] > 600  # of 5 a second over 130 s
    assert row["trusted_95_m"] < 10.0
    assert row["trusted_worst_m"] < 30.0
    assert row["ordinary_worst_m"] > 30.0


@pytest.mark.parametrize("grade", ["navigation", "tactical"])
def test_an_approach_to_las_vegas_that_is_drawn_off_is_carried_on_by_inertia(held, tmp_path, grade):
    row = held.judged("las-vegas", tmp_path, grade)
    print(row)
    assert row["verdict"] == "spoofed"
    assert row["alarms_before"] == 0
    assert row["trusted_95_m"] < 10.0
    assert row["trusted_worst_m"] < 30.0
