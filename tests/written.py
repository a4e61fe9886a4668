"""Tables on a disk for tests."""

from collections.abc import Mapping
from pathlib import Path

from skyproof.formats.tables import Column, open_growing_tables


def write_table(path: Path, columns: Mapping[str, Column]) -> None:
    """Write one block of columns, each (n_rows,), as a file that ends in .csv or .parquet."""
    with open_growing_tables([path]) as take:
        take(columns)
