"""Every finding has words: the table that `make messages` prints for review, and no code in the product without."""

import ast
import string
from pathlib import Path

import numpy as np
import pytest

import skyproof
from skyproof.detectors.base import NEEDS
from skyproof.explain import explain, list_entries, stands_beside
from skyproof.explain.bases import name_bases
from skyproof.explain.entry import Entry
from skyproof.explain.table import ASSUMPTIONS
from skyproof.explain.units import metres, seconds
from skyproof.records import Cause, Finding, Hypothesis, Need, SignalId, SignalRef
from skyproof.verdict import CAUSES

PACKAGE = Path(skyproof.__file__).parent
ENTRIES = list(list_entries())
START = np.datetime64("2022-01-01T12:00:00", "ns")
SIGNALS = tuple(SignalRef("rx1", SignalId(sat, "L1", "CA", "a")) for sat in ("G05", "G07"))


def make_finding(detector="known_place", code="fits", **changes):
    fields = {
        "detector": detector,
        "start_gpst": START,
        "end_gpst": START + np.timedelta64(10, "s"),
        "signals": SIGNALS,
        "hypothesis": Hypothesis.AS_STATED,
        "code": code,
    }
    return Finding(**(fields | changes))


def read_words(words):
    """Return a template as it stands; of a function, the first line of its documentation."""
    if words is None or isinstance(words, str):
        return words
    return f"({(words.__doc__ or words.__name__).strip().splitlines()[0]})"


def test_the_table_of_all_sentences_can_be_read(capsys):
    # `make messages` shows it: detector, code, sentence, remedy.
    for detector, code, entry in ENTRIES:
        print(f"{detector:16}{code:28}{read_words(entry.sentence)}")
        if entry.remedy:
            print(f"{'':44}to resolve: {read_words(entry.remedy)}")
    for code, text in ASSUMPTIONS.items():
        print(f"{'assumed':16}{code:28}{text}")
    lines = capsys.readouterr().out
    print(lines)
    assert len(lines.splitlines()) > len(ENTRIES) > 40


@pytest.mark.parametrize(("detector", "code", "entry"), ENTRIES, ids=[f"{d} {c}" for d, c, _ in ENTRIES])
def test_sentences_stand_within_others(detector, code, entry):
    # They begin small but for names and end without a full stop; a template's fields have names.
    assert code.isidentifier()
    for words in (entry.sentence, entry.remedy):
        if isinstance(words, str):
            assert words.strip() == words
            assert not words.endswith(".")
            assert not words[0].isupper() or words.split()[0].isupper() or words.split()[0][1:2].isupper()
            assert all(name for _, name, _, _ in string.Formatter().parse(words) if name is not None)


def list_codes(path):
    """List the codes of findings that a module states as literals."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.Call):
            continue
        name = getattr(node.func, "attr", getattr(node.func, "id", ""))
        place = {"NotTested": 0, "find": 1}.get(name)
        codes = [word.value for word in node.keywords if word.arg == "code" and name == "Finding"]
        codes += node.args[place : place + 1] if place is not None else []
        parts = [
            part for item in codes for part in ((item.body, item.orelse) if isinstance(item, ast.IfExp) else (item,))
        ]
        found |= {part.value for part in parts if isinstance(part, ast.Constant) and isinstance(part.value, str)}
    return found


def test_every_code_of_the_product_has_an_entry():
    known = {code for _, code, _ in ENTRIES}
    for path in [*(PACKAGE / "detectors").rglob("*.py"), *(PACKAGE / "fusion").rglob("*.py")]:
        assert list_codes(path) <= known, path


def test_an_assumption_is_filled_from_the_finding():
    result = explain(
        make_finding("place", "elsewhere", data={"assumes": ("receiver_stands",), "statistic": 3.0, "surveyed": False})
    )
    assert result.assumptions == ("rx1 does not move",)
    assert result.sentence.startswith("the signals put rx1 3.0 m from where it stood")


def test_what_is_lacking_is_named_with_what_gives_it():
    lacking = make_finding(code="without_sets", data={"lacking": ("sets",)})
    assert explain(lacking).remedy == NEEDS[Need.SETS]
    assert not stands_beside(lacking)


def test_a_detector_of_a_package_without_words_shows_its_code():
    assert explain(make_finding("elsewhere", "odd_rate")).sentence == "odd rate"


def test_a_code_without_words_costs_no_run():
    assert explain(make_finding(code="unheard_of")).sentence == "unheard of"


def test_figures_have_units():
    assert [metres(3.14159), metres(5000.0)] == ["3.1 m", "5.0 km"]
    assert [seconds(x) for x in (2.0, 0.4, 3e-6, 5e-9)] == ["2 s", "400 ms", "3 µs", "5 ns"]
    assert name_bases(("standing", "clock")) == "the statement that it stands still and its clock"


def test_causes_are_named_alike_in_verdict_and_findings():
    benign = {str(cause) for cause in Cause} - {"clean", "false_sky"}
    assert set(CAUSES) == benign


def test_an_entry_has_no_remedy_unless_it_states_one():
    assert Entry("so it is").remedy is None


def test_a_finding_without_a_field_of_its_words_costs_no_run():
    lacking = make_finding("torn", "torn", data={"receiver": "rx1"})
    assert explain(lacking).sentence == "torn"
    with pytest.raises(KeyError, match="sats"):
        explain(lacking, strict=True)
