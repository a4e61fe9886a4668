"""Rows over time: what is written comes back, and what cannot be read says where."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.written import write_table

from skyproof.errors import InputError
from skyproof.formats.timed_rows import read_timed_rows

START = np.datetime64("2022-01-01T10:29:58", "ns")
NUMBERS = st.floats(-1e6, 1e6) | st.just(np.nan)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("rows")


def write_csv(tmp_path, text):
    path = tmp_path / "a.csv"
    path.write_text(text)
    return path


@given(
    st.lists(st.tuples(st.integers(1, 10**10), NUMBERS, NUMBERS), min_size=1, max_size=8),
    st.sampled_from([".csv", ".parquet"]),
    st.booleans(),
)
def test_what_is_written_comes_back(folder, rows, ending, dated):
    steps_ns, a, b = zip(*rows, strict=True)
    times_ns = np.cumsum(np.array(steps_ns) if dated else np.array(steps_ns) // 1000 * 1000 + 1000)
    time = {"gpst": START + times_ns.astype("timedelta64[ns]")} if dated else {"time_s": times_ns * 1e-9}
    path = folder / f"rows{ending}"
    write_table(path, {"other": np.full(len(rows), "x"), "b": np.array(b), **time, "a": np.array(a)})
    found = read_timed_rows(path, ("a", "b"), "the rows")
    assert found.dated == dated
    assert np.array_equal(found.time_ns - (START.astype(np.int64) if dated else 0), times_ns)
    assert np.array_equal(found.values, np.column_stack([a, b]), equal_nan=True)
    assert (
        found.where(len(rows) - 1)
        == f"{path}: {'line' if ending == '.csv' else 'row'} {len(rows) + (ending == '.csv')}"
    )


def test_spaces_empty_lines_and_extra_columns_do_no_harm(tmp_path):
    path = write_csv(tmp_path, '\ufefftime_s, a ,note,note,b\n0.0, 1,"x, y",,2\n\n0.5,,z,,"3"\n')
    found = read_timed_rows(path, ("a", "b"), "the rows")
    assert found.time_ns.tolist() == [0, 500_000_000]
    assert np.array_equal(found.values, [[1.0, 2.0], [np.nan, 3.0]], equal_nan=True)
    assert found.where(1).endswith("a.csv: line 4")


HEAD = "gpst,a,b\n2022-01-01T00:00:00,1,2\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", r"line 1: .*\bgpst or time_s, a, b\b"),
        ("a" * 140_000 + "\n", r"line 1: .*\b131072\b"),
        ("time_s,b\n", r"line 1: .*\btime_s, b, expected a\b"),
        ("time_s,a,a,b\n1,2,3,4\n", r"line 1: .*\ba appears\b"),
        ("time_s,a,b\n", "no rows"),
        (HEAD + "2022-01-01T00:00:01,1\n", r"line 3: 2 .*\b3;"),
        (HEAD + "2022-01-01T00:00:01,1,2,3\n", r"line 3: 4 .*\b3;"),
        (HEAD + "\n2022-01-01T00:00:01,1,two\n", 'line 4, b: "two"'),
        (HEAD + "2022-01-01T00:00:01Z,1,2\n", r"line 3, gpst: .*\bzone\b"),
        (HEAD + "1650-01-01T00:00:01,1,2\n", r"line 3, gpst: .*\b1650\b.*\b1980\b.*\b2199\b"),
        (HEAD + "9650-01-01T00:00:01,1,2\n", r"line 3, gpst: .*\b9650\b.*\b1980\b.*\b2199\b"),
        (HEAD + ",1,2\n", "line 3, gpst: no"),
        (HEAD + "2022-01-01T00:00:00,1,2\n", r"line 3, gpst: .*\bsame\b"),
        (HEAD + "2021-12-31T23:59:59.5,1,2\n", r"line 3, gpst: .*\bearlier\b"),
        ("time_s,a,b\n1,2,3\nnan,2,3\n", "line 3, time_s: no time.*seconds"),
        ("time_s,a,b\n1,2,3\n1.7e9,2,3\n", "line 3, time_s: no time.*1e.09"),
    ],
)
def test_what_cannot_be_read_says_where_and_what_to_do(tmp_path, text, words):
    with pytest.raises(InputError, match=words):
        read_timed_rows(write_csv(tmp_path, text), ("a", "b"), "the rows")


def test_a_file_of_another_kind_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"\".txt\".*\.csv or \.parquet"):
        read_timed_rows(tmp_path / "a.txt", ("a",), "the rows")
    path = tmp_path / "a.parquet"
    path.write_bytes(b"PAR1, but not really")
    with pytest.raises(InputError, match="Parquet"):
        read_timed_rows(path, ("a",), "the rows")


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"gpst": pa.array([0, 1], pa.timestamp("us", "UTC")), "a": [1.0, 2.0]}, r"\btz=UTC\b.*\bzone\b"),
        ({"gpst": [0.0, 1.0], "a": [1.0, 2.0]}, r"\bgpst\b.*\bdouble\b.*timestamp"),
        ({"time_s": ["0", "x"], "a": [1.0, 2.0]}, r"row 1, time_s: .*\bstring\b.*seconds"),
        ({"time_s": [0.0, 1.0], "a": ["1", "2"]}, r"\ba is of\b.*\bstring\b.*numbers"),
        ({"time_s": [0.0, None], "a": [1.0, 2.0]}, "row 2, time_s: "),
        ({"gpst": pa.array([0, 1], pa.timestamp("s")), "a": [1.0, 2.0]}, r"row 1, gpst: .*\b1970\b"),
        ({"gpst": pa.array([10**12, 10**13], pa.timestamp("s")), "a": [1.0, 2.0]}, r"row 1, gpst: .*\byear\b"),
    ],
)
def test_a_column_of_another_type_is_refused(tmp_path, columns, words):
    path = tmp_path / "a.parquet"
    pq.write_table(pa.table(columns), path)
    with pytest.raises(InputError, match=words):
        read_timed_rows(path, ("a",), "the rows")
