"""What is written as TOML reads back the same, by the standard library's own reader."""

import math
import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyproof.formats.toml_text import toml_lines

TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=12)
SCALARS = st.one_of(st.booleans(), st.integers(-(2**63), 2**63 - 1), st.floats(allow_nan=False), TEXTS)
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(TEXTS, inner, max_size=4)),
    max_leaves=20,
)


def read_back(table):
    return tomllib.loads("\n".join(toml_lines(table)) + "\n")


@given(st.dictionaries(TEXTS, VALUES, max_size=6))
def test_any_nested_table_reads_back_the_same(table):
    back = read_back(table)
    assert back == table
    assert types_of(back) == types_of(table)


def types_of(value):
    if isinstance(value, dict):
        return {key: types_of(one) for key, one in value.items()}
    return [types_of(one) for one in value] if isinstance(value, list) else type(value)


def test_tables_in_lists_have_headings_of_their_own():
    table = {"name": "x", "receivers": [{"a": 1, "antennas": [{"b": 2.5}, {"b": -1e-30}]}, {"a": 2}], "sky": {"c": []}}
    assert list(toml_lines(table)) == [
        'name = "x"',
        "",
        "[[receivers]]",
        "a = 1",
        "",
        "[[receivers.antennas]]",
        "b = 2.5",
        "",
        "[[receivers.antennas]]",
        "b = -1e-30",
        "",
        "[[receivers]]",
        "a = 2",
        "",
        "[sky]",
        "c = []",
    ]
    assert read_back(table) == table


def test_what_is_no_number_reads_back():
    back = read_back({"a": math.nan, "b": -math.inf, "c": -0.0})
    assert math.isnan(back["a"])
    assert back["b"] == -math.inf
    assert math.copysign(1.0, back["c"]) == -1.0


@pytest.mark.parametrize("table", [{"a": None}, {"a": [None]}, {"a": object()}, {1: 2}, {"a": {1: 2}}])
def test_what_toml_cannot_hold_is_refused(table):
    with pytest.raises(TypeError):
        list(toml_lines(table))
