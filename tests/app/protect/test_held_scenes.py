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


def test_an_approach_at_a_rate_too_low_to_part_its_signals_is_not_called_authentic(held, tmp_path):
    """5 Msps part signals from 0.2 chip on: too few satellites show two for a word, and nothing false is trusted."""
    row = held.judged("las-vegas", tmp_path)
    print(row)
    assert row["verdict"] in ("undecided", "spoofed")
    assert row["alarms_before"] == 0
    assert row["trusted"] == 0 or row["trusted_worst_m"] < 30.0
    assert row["ordinary_worst_m"] > 100.0
