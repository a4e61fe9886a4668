"""The corpus that two trees are held against: the same tree says the same, and what differs is sorted."""

import copy
import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).resolve().parents[1] / "bench"))  # benches import each other by bare names
from corpus import differences, row_of


@pytest.mark.parametrize("name", ["plain-1", "array-1-attack", "arm-1", "damaged-orbits-1"])
def test_one_tree_says_the_same_twice(name: str) -> None:
    assert list(differences([row_of(name)], [row_of(name)])) == []


ROW = {
    "name": "attack-1",
    "truth": "captured",
    "runs": {
        "two": {
            "word": "suspect",
            "labels": {"rx1 G01 L1 C/A 0-9": "unknown"},
            "places": {"rx1": [[1.0, 2.0, 3.0], [1.0, 2.0, 3.0]]},
            "p": {"residual 0.0": 0.5, "continuity 10.0": 1e-9},
        }
    },
}


@pytest.mark.parametrize(
    ("truth", "part", "value", "sort"),
    [
        ("captured", "word", "spoofed", "better"),
        ("captured", "word", "authentic", "worse"),
        ("clean", "word", "authentic", "better"),
        ("clean", "word", "spoofed", "worse"),
        ("attack", "word", "spoofed", "other"),
        ("captured", "labels", {"rx1 G01 L1 C/A 0-9": "spoofed"}, "other"),
        ("captured", "places", {"rx1": [[1.0, 2.0, 3.0]]}, "other"),
        ("captured", "places", {"rx1": [[1.0, 2.0, 3.0], [1.0, 2.0, 3.002]]}, "other"),
        ("captured", "p", {"residual 0.0": 0.5, "continuity 10.0": 2e-9}, "other"),
    ],
)
def test_each_difference_is_listed_and_sorted(truth: str, part: str, value: object, sort: str) -> None:
    before = copy.deepcopy(ROW) | {"truth": truth}
    after = copy.deepcopy(before)
    after["runs"]["two"][part] = value
    assert [kind for kind, _ in differences([before], [after])] == [sort]


def test_rows_that_are_missing_are_listed() -> None:
    assert [kind for kind, _ in differences([ROW], [])] == ["other"]
    assert [kind for kind, _ in differences([], [ROW])] == ["other"]
