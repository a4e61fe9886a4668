"""Samples missing from signals that overlap, behind drawn correlators: `bench/missing_samples.py`."""

import importlib
import sys
from pathlib import Path
from types import ModuleType

import pytest


@pytest.fixture(scope="module")
def missing() -> ModuleType:
    sys.path.insert(0, str(Path(__file__).parents[2] / "bench"))
    try:
        return importlib.import_module("missing_samples")
    finally:
        sys.path.pop(0)


def test_a_lost_part_of_a_period_is_found_under_a_takeover(missing):
    row = missing.row_of(104)
    assert row["missing_s"] == pytest.approx(0.26525e-3)
    assert row["found"]
    assert row["others_s"] == []
    assert row["shown_ms"] == [pytest.approx(1e3 * row["missing_s"], abs=2e-4)]
    assert row["ahead_s"] == pytest.approx(row["missing_s"], abs=missing.SAME_S)


@pytest.mark.long
def test_missing_samples_are_found_with_their_length(missing):
    rows = [missing.row_of(number) for number in range(110)]
    print("\n".join(missing.table(rows)))
    cut = [row for row in rows if row["missing_s"]]
    found = [row for row in cut if row["found"]]
    assert not any(row["others_s"] for row in rows if not row["missing_s"])
    assert not any(at_s < row["cut_s"] for row in cut for at_s in row["others_s"])
    assert len(found) >= 0.9 * len(cut)
    off_s = [row["ahead_s"] - row["missing_s"] for row in found if row["ahead_s"] is not None]
    assert len(off_s) >= 0.8 * len(found)
    assert max(map(abs, off_s)) < missing.SAME_S
