"""Fields of lines are the numbers that Python reads, and lines are the same whatever blocks they come in."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from skyproof.logs.text import MISSING, read_fields, split_lines


def list_fields(*lines: str, **names: tuple[str, ...]):
    (stretch,) = split_lines(["\n".join(lines).encode() + b"\n"])
    return read_fields(stretch, np.arange(len(lines)), {"word": 0, "a": 1, "b": 2}, **names)


@given(st.one_of(st.floats(-1e59, 1e59).map(repr), st.integers(-(2**63) + 1, 2**63 - 1).map(str)))
@example("1.5e+59")
@example("-1260194483885406208")
@example("9223372036854775807")
@example("+1E-3")
@example(".5")
@example("5.")
def test_numbers_are_those_of_python(text) -> None:
    real = list_fields(f"Raw,{text},x", reals=("a",)).reals["a"][0]
    whole = list_fields(f"Raw,{text},x", wholes=("a",)).wholes["a"][0]
    assert real == pytest.approx(float(text), rel=1e-15, abs=1e-300)
    if text.lstrip("+-").isdigit() and abs(int(text)) < 9_223_372_036_854_775_800:
        assert whole == int(text)
    elif not text.lstrip("+-").isdigit():
        assert whole == MISSING


@pytest.mark.parametrize(
    "text", ["", " ", "-", ".", "e5", "1e", "1.2.3", "0x10", "nan", "9e999", "1e60", "1 2", "1_0", "--1"]
)
def test_what_is_no_number_is_missing(text) -> None:
    assert math.isnan(list_fields(f"Raw,{text},7", reals=("a",)).reals["a"][0])
    fields = list_fields(f"Raw,{text},7", wholes=("a", "b"))
    assert [fields.wholes[name].tolist() for name in "ab"] == [[MISSING], [7]]


def test_short_lines_lack_their_last_fields() -> None:
    fields = list_fields("Raw,1", "Raw", "Raw,2,3", wholes=("b", "none"), reals=("a",), places=("word", "b"))
    assert fields.wholes["b"].tolist() == [MISSING, MISSING, 3]
    assert fields.wholes["none"].tolist() == [MISSING] * 3
    assert [math.isnan(value) for value in fields.reals["a"]] == [False, True, False]
    assert fields.places["word"].tolist() == [0, 6, 10]
    assert fields.places["b"].tolist() == [-1, -1, 16]


@given(st.binary(max_size=300), st.integers(1, 40), st.integers(1, 100))
def test_lines_are_those_of_the_whole_text(text, block, stretch_bytes) -> None:
    monkey = pytest.MonkeyPatch()
    monkey.setattr("skyproof.logs.text._STRETCH_BYTES", stretch_bytes)
    stretches = list(split_lines(text[k : k + block] for k in range(0, len(text), block)))
    monkey.undo()
    found = [s.octets[b:e].tobytes() for s in stretches for b, e in zip(s.begin, s.end, strict=True)]
    lines = [line.removesuffix(b"\r") for line in text.split(b"\n") if line]
    assert found == lines
    assert [s.last for s in stretches].count(True) == 1
    assert stretches[-1].cut == bool(text and not text.endswith(b"\n"))


def test_a_line_without_end_takes_no_memory(monkeypatch) -> None:
    monkeypatch.setattr("skyproof.logs.text._STRETCH_BYTES", 1000)
    monkeypatch.setattr("skyproof.logs.text._LONGEST_LINE", 100)
    stretches = list(split_lines([b"a" * 999] * 50 + [b"\nRaw,1\n"]))
    assert max(s.octets.size for s in stretches) < 3500
    assert stretches[-1].line(stretches[-1].begin.size - 1) == "Raw,1"
