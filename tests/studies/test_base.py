"""What every study keeps, whoever wrote it; and the table that all of them make together."""

import json
import math
import re
from collections.abc import Iterable, Iterator
from datetime import date
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from skyproof.report.chart import Axes
from skyproof.studies import studies
from skyproof.studies.base import Claim, Row, Study, StudySettings, value_of
from skyproof.studies.reached import list_methods_called, list_unreached
from skyproof.studies.validation import check, table

FOUND = studies()


def make_toy(**changes: Any) -> Study:
    def run(settings: StudySettings) -> Iterator[Row]:
        draws = settings.rng().standard_normal(settings.count(1000, 100))
        yield {"trials": draws.size, "mean": float(np.mean(draws)), "method": "paper"}
        yield {"trials": draws.size, "mean": math.nan, "method": "skyproof"}

    options: dict[str, Any] = {
        "name": "toy.mean",
        "title": "The mean",
        "paper": "Someone, Journal 1(1), 2022",
        "figure": "Figure 1",
        "run": run,
        "charts": (Axes(title="t", x="trials", y="mean", x_label="x", y_label="y", by=("method",)),),
    }
    return Study(**(options | changes))


def make_claim(**changes: Any) -> Claim:
    options: dict[str, Any] = {"what": "mean", "paper": 0.0, "same": lambda rows: rows[0]["mean"], "tolerance": 0.2}
    return Claim(**(options | changes))


# Every study


@pytest.mark.parametrize("name", FOUND)
def test_a_study_has_paper_figure_and_words_for_the_list(name: str) -> None:
    study = FOUND[name]
    assert name == study.name
    paper, _, figure = name.partition(".")
    assert paper
    assert figure or study.paper == "skyproof"
    assert name == name.lower()
    assert " " not in name
    assert study.title
    assert study.paper
    assert study.figure


def test_papers_stand_together() -> None:
    papers = [study.paper for study in FOUND.values()]
    assert sum(a != b for a, b in pairwise(papers)) == max(len(set(papers)) - 1, 0)


# Settings


def test_the_seed_gives_the_numbers_and_streams_are_apart() -> None:
    draws = [
        StudySettings(seed=seed).rng(stream).standard_normal() for seed, stream in ((3, 0), (3, 0), (3, 1), (4, 0))
    ]
    assert draws[0] == draws[1]
    assert len(set(draws)) == 3


def test_trials_that_are_given_come_before_quick() -> None:
    assert StudySettings().count(1000, 10) == 1000
    assert StudySettings(quick=True).count(1000, 10) == 10
    assert StudySettings(trials=7, quick=True).count(1000, 10) == 7


# The table


def make_page(*claims: Claim, **changes: Any) -> str:
    study = make_toy(claims=claims, **changes)
    return table({study.name: study}, StudySettings(quick=True, seed=5), made_on=date(2026, 1, 2))


def test_the_page_names_version_date_and_seed() -> None:
    assert re.search(r"\b2026-01-02, seed 5, quick\b", make_page(make_claim()))


def test_agreeing_and_failing_figures_are_told_apart() -> None:
    assert "| 0.2 |" in make_page(make_claim())
    assert "| **not** 0.001 |" in make_page(make_claim(paper=1.0, tolerance=0.001))
    assert "| within |" not in make_page(make_claim(tolerance=None)).partition("###")[2]


def test_an_independent_check_comes_before_the_printed_value() -> None:
    (checked,) = check(make_toy(claims=(make_claim(paper=9.0, reference=0.0),)), list(make_toy().run(StudySettings())))
    assert checked.agrees is True
    (checked,) = check(
        make_toy(claims=(make_claim(paper=0.0, reference="recordings"),)), list(make_toy().run(StudySettings()))
    )
    assert checked.agrees is True


def test_a_better_figure_is_judged_where_there_is_no_same_one() -> None:
    (checked,) = check(make_toy(claims=(make_claim(same=None, better=lambda rows: 0.1),)), [])
    assert checked.agrees is True
    (checked,) = check(make_toy(claims=(make_claim(same=None, better=lambda rows: 0.3),)), [])
    assert checked.agrees is False


def test_a_tolerance_may_depend_on_how_many_were_counted() -> None:
    loose = make_claim(same=lambda rows: 0.3, tolerance=lambda rows: 3.0 / np.sqrt(rows[0]["trials"]))
    for trials, agrees, reported in ((25, True, "| within 0.6 |"), (400, False, "| **not** within 0.15 |")):
        (checked,) = check(make_toy(claims=(loose,)), [{"trials": trials}])
        assert checked.agrees is agrees
        assert reported[2:-2] == checked.cells()[-1]


def test_a_figure_that_cannot_be_made_has_its_reason() -> None:
    text = make_page(
        make_claim(what="Figure 7", paper="6 of 8", same=None, tolerance=None, reference="needs a | recording")
    )
    assert "| Figure 7 | 6 of 8 | needs a \\| recording |" in text


def test_a_figure_that_is_not_found_never_agrees() -> None:
    text = make_page(make_claim(same=lambda rows: rows[1]["mean"]))
    assert "| not found |" in text
    assert "| **not** " in text


def test_a_figure_that_protect_does_not_reach_says_so() -> None:
    text = make_page(make_claim(), make_claim(protect=lambda rows: 0.25), make_claim(protect=lambda rows: math.nan))
    assert [text.count(f"| {words} |") for words in ("not reached", "0.25", "not run")] == [1, 1, 1]
    (checked,) = check(
        make_toy(claims=(make_claim(tolerance=None, protect=lambda rows: 9.0),)), [{"n": 1, "mean": 0.0}]
    )
    assert checked.agrees is None


def test_the_page_names_code_that_no_command_reaches() -> None:
    found = list_methods_called(FOUND["multi-receiver.distance"].run)
    names = ("combine_views", "project", "span_test")
    assert found.reached == tuple(f"detectors.multi_receiver.along_baselines.{name}" for name in names)
    assert not found.not_reached
    assert "decomposition.fit.decompose" in list_methods_called(FOUND["dccaf.separation"].run).reached


def test_what_no_command_reaches_stands_in_studies() -> None:
    # But for the contract until 0.3.
    offered = {"detectors.base": ("missing", "undecided")}
    assert list_unreached() == offered


def test_claims_that_differ_in_one_thing_share_a_row() -> None:
    text = make_page(*(make_claim(what="kept", across=across) for across in ("10 s", "30 s")), make_claim(what="alone"))
    assert text.count("| kept, within 0.2 |") == 1
    assert "| 10 s | 30 s |" in text
    assert "| alone |" in text


def test_a_column_that_is_the_same_in_all_rows_stands_once() -> None:
    text = make_page(*(make_claim(what=what, paper="a picture", reference=0.0) for what in ("one", "two", "three")))
    assert text.count("*paper* a picture") == text.count("a picture") == 1
    assert text.count("*within* 0.2") == 1


def test_a_study_without_claims_is_on_the_page() -> None:
    assert "### `toy.mean`" in make_page()


def test_the_same_seed_gives_the_same_page() -> None:
    assert make_page(make_claim()) == make_page(make_claim())


@pytest.mark.parametrize("name", FOUND)
def test_the_charts_name_columns_in_words(name: str) -> None:
    for chart in FOUND[name].charts:
        assert chart.title
        assert chart.x_label
        assert chart.y_label


def write_plainly(rows: Iterable[Row]) -> str:
    """Write rows as JSON without times, which depend on the machine."""
    return json.dumps(
        [
            {k: v.item() if isinstance(v, np.generic) else v for k, v in row.items() if not k.startswith("ms_")}
            for row in rows
        ]
    )


@pytest.mark.long
@pytest.mark.parametrize("name", FOUND)
def test_rows_are_plain_repeatable_and_hold_charts_and_claims(name: str) -> None:
    study = FOUND[name]
    rows = list(study.run(StudySettings(quick=True)))
    assert rows
    assert write_plainly(rows) == write_plainly(study.run(StudySettings(quick=True)))
    for chart in study.charts:
        drawn = [row for row in rows if all(row.get(key) == value for key, value in chart.where.items())]
        assert any(row.get(chart.x) is not None and row.get(chart.y) is not None for row in drawn), chart.title
        assert all(any(by in row for row in drawn) for by in chart.by), chart.title
    for item in check(study, rows):
        assert item.same is None or isinstance(item.same, float)


def test_a_claims_figure_is_missing_where_its_rows_are() -> None:
    rows = [{"n": 1, "p": None}, {"n": 1, "p": 0.25}, {"n": 1, "p": 0.75}, {"n": 2, "p": 0.5, "only": "here"}]
    assert value_of("p", n=1)(rows) == 0.25
    assert value_of("p", max, n=1)(rows) == 0.75
    assert value_of("p", only="here")(rows) == 0.5
    assert math.isnan(value_of("p", n=3)(rows))
    with pytest.raises(KeyError):
        value_of("q", n=1)(rows)
