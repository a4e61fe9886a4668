"""The corpus that two trees are held against: the same tree says the same, and what differs is sorted."""

import copy
import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).resolve().parents[1] / "bench"))  # benches import each other by bare names
from corpus import QUICK, QUICK_REAL, REAL, names_of, not_installed
from corpus_differences import differences
from corpus_kinds import KINDS, row_of

LEAST_DRAWN = 300


def test_every_detector_of_this_tree_is_installed() -> None:
    # Entry points come from the environment, which may be older than the tree: `make setup` mends it.
    assert not_installed() == []


@pytest.mark.parametrize("name", ["plain-1", "several-1", "array-1-attack", "arm-1-attack", "damaged-orbits-1"])
def test_one_tree_says_the_same_twice(name: str) -> None:
    assert list(differences([row_of(name)], [row_of(name)])) == []


def list_kinds(names: list[str] | tuple[str, ...]) -> set[str]:
    return {name.partition("-")[0] for name in names}


def test_the_quick_rows_are_of_every_kind() -> None:
    without_samples = {kind for kind in KINDS if "samples" not in kind}
    assert list_kinds(QUICK) == without_samples - set(REAL)
    assert list_kinds(QUICK_REAL) == set(REAL)


def test_the_whole_corpus_has_hundreds_of_scenes() -> None:
    names = names_of()
    assert len(names) == len(set(names))
    assert sum(name.partition("-")[0] not in REAL for name in names) >= LEAST_DRAWN
    assert list_kinds(names_of(samples=True)) >= set(KINDS) - set(REAL)


@pytest.mark.usefixtures("shared_data")
def test_the_quick_rows_are_part_of_the_whole() -> None:
    assert {*QUICK, *QUICK_REAL} <= set(names_of())


ROW = {
    "name": "attack-1",
    "runs": {
        "two": {
            "truth": "captured",
            "word": "suspect",
            "labels": {"rx1 G01 L1 C/A 0-9": "unknown"},
            "places": {"rx1": [[1.0, 2.0, 3.0], [1.0, 2.0, 3.0]]},
            "counts": {"wrong_labels": 1, "right_labels": 10, "wrong_fixes": 1, "right_fixes": 1},
            "p": {"residual 0.0": 0.5, "continuity 10.0": 1e-9},
            "failed": {"continuity - undecided reflections": 1},
            "interference": [],
        }
    },
}


def sort_differences(before: dict, **parts: object) -> list[str]:
    after = copy.deepcopy(before)
    for part, value in parts.items():
        run = after["runs"]["two"]
        run[part] = run[part] | value if part == "counts" else value
    return [sort for sort, _ in differences([before], [after])]


@pytest.mark.parametrize(
    ("truth", "word", "sort"),
    [
        ("captured", "spoofed", "better"),
        ("captured", "authentic", "worse"),
        ("clean", "authentic", "better"),
        ("clean", "spoofed", "worse"),
        ("attack", "spoofed", "other"),
    ],
)
def test_words_are_sorted_by_the_truth(truth: str, word: str, sort: str) -> None:
    before = copy.deepcopy(ROW)
    before["runs"]["two"]["truth"] = truth
    assert sort_differences(before, word=word) == [sort]


@pytest.mark.parametrize(
    ("part", "value"),
    [
        ("labels", {"rx1 G01 L1 C/A 0-9": "spoofed"}),
        ("places", {"rx1": [[1.0, 2.0, 3.0]]}),
        ("places", {"rx1": [[1.0, 2.0, 3.0], [1.0, 2.0, 3.002]]}),
        ("p", {"residual 0.0": 0.5, "continuity 10.0": 2e-9}),
        ("failed", {"continuity - undecided reflections": 2}),
        ("failed", {"continuity jump spoofed reflections": 1}),
        ("interference", [["rx1", "L1", "2021-01-01T00:00:00", "None", 10.0, 0]]),
    ],
)
def test_what_has_no_truth_is_listed_as_other(part: str, value: object) -> None:
    assert sort_differences(ROW, **{part: value}) == ["other"]


def test_a_code_that_only_one_tree_has_is_no_difference() -> None:
    assert sort_differences(ROW, failed={"continuity jump undecided reflections": 1}) == []


@pytest.mark.parametrize(
    ("what", "value", "counts", "sort"),
    [
        ("labels", {"rx1 G01 L1 C/A 0-9": "spoofed"}, {"right_labels": 20}, "better"),
        ("labels", {"rx1 G01 L1 C/A 0-9": "spoofed"}, {"wrong_labels": 2, "right_labels": 20}, "worse"),
        ("labels", {"rx1 G01 L1 C/A 0-9": "authentic"}, {"right_labels": 0}, "worse"),
        ("places", {"rx1": [[1.0, 2.0, 3.0]]}, {"wrong_fixes": 0}, "better"),
        ("places", {"rx1": [[1.0, 2.0, 3.0]]}, {"right_fixes": 0}, "worse"),
    ],
)
def test_labels_and_places_are_sorted_by_counts(what: str, value: object, counts: object, sort: str) -> None:
    assert sort_differences(ROW, **{what: value}, counts=counts) == [sort]


def test_rows_that_are_missing_are_listed() -> None:
    assert [sort for sort, _ in differences([ROW], [])] == ["other"]
    assert [sort for sort, _ in differences([], [ROW])] == ["other"]


def test_runs_that_are_missing_are_listed() -> None:
    without = {"name": "attack-1", "runs": {}}
    assert "other" in [sort for sort, _ in differences([ROW], [without])]
    assert "other" in [sort for sort, _ in differences([without], [ROW])]
