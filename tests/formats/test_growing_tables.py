"""Tables that are written block by block hold what one table holds, appear whole, and keep no block."""

import csv
from itertools import pairwise

import numpy as np
import pyarrow.parquet as pq
import pytest

from skyproof.errors import OutputError
from skyproof.formats.tables import open_growing_tables

COLUMNS = {
    "gpst": np.datetime64("2024-01-01T00:00:00", "ns") + np.arange(7) * np.timedelta64(1_000_000_007, "ns"),
    "sat": np.array([f"G{k:02d}" for k in range(7)]),
    "range_m": np.array([2.1e7 / 3.0, np.nan, -0.1, 1e-12, 0.0, 1e300, 7.0]),
    "n": np.arange(7),
}


def make_blocks(*edges):
    return [{name: column[a:b] for name, column in COLUMNS.items()} for a, b in pairwise(edges)]


@pytest.mark.parametrize("edges", [(0, 7), (0, 1, 4, 4, 7), (0, 0, 7)])
def test_blocks_of_any_size_make_the_same_table(tmp_path, edges):
    paths = [tmp_path / "t.csv", tmp_path / "t.parquet"]
    with open_growing_tables(paths, {"grade": "tactical"}) as take:
        for block in make_blocks(*edges):
            take(block)
    with open(paths[0], newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["sat"] for row in rows] == COLUMNS["sat"].tolist()
    assert rows[1]["range_m"] == ""
    np.testing.assert_array_equal([float(row["range_m"] or "nan") for row in rows], COLUMNS["range_m"])
    assert rows[1]["gpst"] == "2024-01-01T00:00:01.000000007"
    table = pq.read_table(paths[1])
    assert table.schema.metadata[b"grade"] == b"tactical"
    np.testing.assert_array_equal(table["gpst"].to_numpy(), COLUMNS["gpst"])
    np.testing.assert_array_equal(table["range_m"].to_numpy(), COLUMNS["range_m"])
    assert table["range_m"].null_count == 1


def test_no_rows_keep_the_columns(tmp_path):
    with open_growing_tables([tmp_path / "t.csv", tmp_path / "t.parquet"]) as take:
        take(make_blocks(0, 0)[0])
    assert (tmp_path / "t.csv").read_text() == "gpst,sat,range_m,n\n"
    assert pq.read_table(tmp_path / "t.parquet").column_names == ["gpst", "sat", "range_m", "n"]


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_what_is_interrupted_leaves_nothing(tmp_path, error):
    def write():
        with open_growing_tables([tmp_path / "t.csv", tmp_path / "t.parquet"]) as take:
            take(make_blocks(0, 4)[0])
            raise error

    with pytest.raises(error):
        write()
    assert list(tmp_path.iterdir()) == []


def test_another_ending_is_reported(tmp_path):
    with pytest.raises(OutputError, match=r"\.xlsx"), open_growing_tables([tmp_path / "t.xlsx"]):
        pass
