"""The verdict's models: what they refuse, and that they stay as they were made."""

import copy
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import pytest
from pydantic import ValidationError

from skyproof import records, verdict
from skyproof.short_repr import write_notebook_html
from skyproof.verdict import CAUSES, Verdict, write_word

SAMPLE = json.loads((Path(__file__).parent / "formats" / "verdict-sample.json").read_text(encoding="utf-8"))
Document = dict[str, Any]


def change_document(change: Callable[[Document], object]) -> Document:
    document = copy.deepcopy(SAMPLE)
    change(document)
    return document


def test_the_sample_is_a_verdict_and_keeps_what_it_was_given() -> None:
    verdict = Verdict.model_validate(SAMPLE)
    assert verdict.model_dump(mode="json") == SAMPLE
    assert verdict.signals[1].copy == "b"


def test_a_verdict_cannot_be_changed() -> None:
    verdict = Verdict.model_validate(SAMPLE)
    with pytest.raises(ValidationError, match="frozen"):
        verdict.verdict = "authentic"  # type: ignore[misc]
    with pytest.raises(AttributeError):
        verdict.signals.append(verdict.signals[0])  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("change", "place", "fault"),
    [
        (lambda d: d.update(extra=1), "extra", "extra_forbidden"),
        (lambda d: d.pop("until_gpst"), "until_gpst", "missing"),
        (lambda d: d.update(verdict="undecided"), "verdict", "literal_error"),
        (lambda d: d["signals"][0].update(label="false"), "signals.0.label", "literal_error"),
        (lambda d: d["signals"][0].update(cn0_dbhz=float("nan")), "signals.0.cn0_dbhz", "finite_number"),
        (lambda d: d["methods"][0].update(statistic=float("inf")), "methods.0.statistic", "finite_number"),
        (lambda d: d["methods"][0].update(p_value=1.5), "methods.0.p_value", "less_than_equal"),
        (lambda d: d.update(since_sigma_s=-0.1), "since_sigma_s", "greater_than_equal"),
        (lambda d: d.update(since_gpst="2022-01-01T10:00:24Z"), "since_gpst", "string_pattern_mismatch"),
        (
            lambda d: d["receivers"][0]["trusted_fix"].update(lat_deg=100.0),
            "receivers.0.trusted_fix.lat_deg",
            "less_than_equal",
        ),
        (lambda d: d.update(may_also_be=["weather"]), "may_also_be.0", "literal_error"),
    ],
)
def test_a_value_that_makes_no_sense_is_refused(change: Callable[[Document], object], place: str, fault: str) -> None:
    with pytest.raises(ValidationError) as raised:
        Verdict.model_validate(change_document(change))
    assert [(".".join(map(str, e["loc"])), e["type"]) for e in raised.value.errors()] == [(place, fault)]


def test_a_number_that_is_none_is_refused_among_the_settings() -> None:
    with pytest.raises(ValidationError) as raised:
        Verdict.model_validate(change_document(lambda d: d["settings"].update(window_s=float("nan"))))
    assert {e["loc"][:2] for e in raised.value.errors()} == {("settings", "window_s")}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d["signals"][0].update(receiver="rx9"), "rx9"),
        (lambda d: d["signals"][1].update(source="S2"), "S2"),
        (lambda d: d["methods"][1].update(why_not=None), "ins_array .*why_not"),
        (lambda d: d.update(verdict="suspect"), r"\bsuspect .*\breason\b"),
        (lambda d: d.update(verdict="no_attack_seen"), r"\bno_attack_seen .*\breason\b"),
        (lambda d: d.update(verdict="no_attack_seen", reason="alone"), "not_excluded"),
    ],
)
def test_parts_that_contradict_each_other_are_refused(change: Callable[[Document], object], words: str) -> None:
    with pytest.raises(ValidationError, match=words) as raised:
        Verdict.model_validate(change_document(change))
    assert [e["type"] for e in raised.value.errors()] == ["value_error"]


def test_a_verdict_shows_itself_in_a_notebook() -> None:
    result = Verdict.model_validate(SAMPLE)._repr_html_()
    for text in (
        "Spoofed",
        SAMPLE["summary"],
        "Since 2022-01-01 10:00:24 GPS time (10:00:06 UTC) ± 0.5 s.",
        "59.4121000",
        "trusted",
    ):
        assert text in result, text


def test_a_suspicion_shows_its_reason_and_what_else_it_may_be() -> None:
    changes = {
        "verdict": "suspect",
        "reason": "the position jumps",
        "may_also_be": ["missing_samples", "reflections"],
        "remedy": "the recording uncut",
    }
    verdict = Verdict.model_validate(SAMPLE | changes)
    parts = [words for _, words in verdict.explained]
    causes = ", or ".join(CAUSES[cause] for cause in verdict.may_also_be)
    assert len(parts) == 4
    assert parts[2:] == [causes, verdict.remedy]
    assert all(words in verdict._repr_html_() for words in ("Suspect", verdict.remedy, causes))


def test_no_attack_seen_is_shown_with_blanks_and_its_limits() -> None:
    changes = {"verdict": "no_attack_seen", "reason": "one receiver", "not_excluded": ["a false sky", "a slow drag"]}
    result = Verdict.model_validate(SAMPLE | changes)._repr_html_()
    assert write_word("no_attack_seen").capitalize() in result
    assert f": {'; '.join(changes['not_excluded'])}." in result
    assert "no_attack_seen" not in result


def test_every_benign_cause_of_the_records_has_words() -> None:
    assert get_args(records.CauseName) == tuple(verdict.CAUSES)


def test_a_notebook_shows_names_and_runs_nothing() -> None:
    result = write_notebook_html("<b>", ["a & <script>"], (("<i>",), [("<img>",)]), (("empty",), []))
    assert "&lt;b&gt;" in result
    assert "a &amp; &lt;script&gt;" in result
    assert not any(tag in result for tag in ("<b>", "<script", "<i>", "<img", "empty"))
