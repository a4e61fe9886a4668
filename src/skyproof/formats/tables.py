"""Write tables of columns, as CSV for people and Parquet for programs, and name the columns of fixes."""

import contextlib
import csv
import io
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from skyproof.arrays import Integers
from skyproof.errors import OutputError
from skyproof.formats.atomic_write import write_whole
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.records import Fix, FixStatus, ReceiverFixes

__all__ = ["FIXES_COLUMNS", "Column", "Words", "build_fixes_columns", "build_own_fixes_columns", "open_growing_tables"]


@dataclass(frozen=True, eq=False)
class Words:
    """A column of few different texts: `words` by `codes` (n,)."""

    codes: NDArray[Any]
    words: Sequence[str]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.asarray(np.array(self.words, dtype)[self.codes])


Column = NDArray[Any] | Words

FIXES_COLUMNS: Final = (
    "receiver",
    "gpst",
    "kind",
    "lat_deg",
    "lon_deg",
    "height_m",
    "sigma_east_m",
    "sigma_north_m",
    "sigma_up_m",
    "clock_bias_m",
    "satellites",
    "horizontal_protection_m",
    "vertical_protection_m",
    "hidden_m",
)
_TEXT_TYPES: Final = {str, type(None)}
_CSV_ROWS: Final = 8192  # turned to text at once, so that memory does not grow with the table


def _refuse_ending(path: str | os.PathLike[str], ending: str) -> OutputError:
    return OutputError(f'{os.fspath(path)}: cannot write a table that ends in "{ending}"; use .csv or .parquet')


@contextlib.contextmanager
def open_growing_tables(
    paths: Sequence[str | os.PathLike[str]], metadata: Mapping[str, str] | None = None
) -> Iterator[Callable[[Mapping[str, Column]], None]]:
    """Write one table to .csv or .parquet files block by block, so that memory does not grow with it.

    It yields a function that takes the next block of columns, each of shape (n_rows,): the same names and types each
    time. At least one block is needed, which may be empty. The files appear when the block of code ends well, or not at
    all.

    What is missing (NaN, NaT, None) is an empty field in CSV and null in Parquet. CSV is UTF-8 with a line of names,
    instants as ISO 8601 in nanoseconds without a zone, floats with the fewest digits that read back the same. Parquet
    holds instants as timestamps in nanoseconds without a zone, a group of rows for each block, and `metadata` in its
    schema.

    Raises
    ------
    OutputError : a file cannot be written, or its ending is another one.
    ValueError : the columns are not of one length.
    """
    with contextlib.ExitStack() as stack:
        takers = [_open_taker(stack, path, metadata or {}) for path in paths]

        def take(columns: Mapping[str, Column]) -> None:
            shapes = {name: np.shape(c.codes if isinstance(c, Words) else c) for name, c in columns.items()}
            if len(set(shapes.values())) > 1 or any(len(shape) != 1 for shape in shapes.values()):
                raise ValueError(f"columns must be of one dimension and one length, not {shapes}")
            for taker in takers:
                taker(columns)

        yield take


def _open_taker(
    stack: contextlib.ExitStack, path: str | os.PathLike[str], metadata: Mapping[str, str]
) -> Callable[[Mapping[str, Column]], None]:
    ending = Path(path).suffix.lower()
    if ending not in (".csv", ".parquet"):
        raise _refuse_ending(path, ending)
    file = stack.enter_context(write_whole(path))
    writer: Any = None

    def take_parquet(columns: Mapping[str, Column]) -> None:
        nonlocal writer
        table = pa.table({name: _convert_to_arrow(column) for name, column in columns.items()})
        if writer is None:
            writer = stack.enter_context(pq.ParquetWriter(file, table.schema.with_metadata(dict(metadata))))
        writer.write_table(table)

    begun = False

    def take_csv(columns: Mapping[str, Column]) -> None:
        nonlocal begun
        for line in _write_csv_lines(columns, headed=not begun):
            file.write(f"{line}\n".encode())
        begun = True

    return take_parquet if ending == ".parquet" else take_csv


def build_fixes_columns(fixes: Iterable[tuple[str, Fix]]) -> dict[str, NDArray[Any]]:
    """Build the table of fixes, `FIXES_COLUMNS`, of (kind, Fix) pairs: a row per receiver, kind and epoch.

    `kind` is "trusted", "consistent", "inertial", "held", "false", "unprotected" or the name of a sky that may be the
    true one. `gpst` is the time that the signals of the fix give: the receiver's clock less the clock bias. An epoch
    without a fix (status not 0) has no row. Sigmas are the roots of the diagonal of the covariance, turned from ECEF to
    east, north, up at the fix itself; `clock_bias_m` is c times the clock bias; `satellites` counts those used. The
    protection levels are NaN where none is promised, and `hidden_m` where nothing bounds it. Rows stand in the order
    given.
    """
    parts = [_fix_columns(kind, fix) for kind, fix in fixes]
    empty = {name: np.empty(0) for name in FIXES_COLUMNS}
    empty |= {
        "receiver": np.empty(0, "U1"),
        "kind": np.empty(0, "U1"),
        "gpst": np.empty(0, "datetime64[ns]"),
        "satellites": np.empty(0, np.int64),
    }
    return {name: np.concatenate([empty[name], *(part[name] for part in parts)]) for name in FIXES_COLUMNS}


def build_own_fixes_columns(receiver: str, fixes: ReceiverFixes, rows: Integers) -> dict[str, NDArray[Any]]:
    """Return rows of the table of fixes that a receiver computed itself; `kind` is "receiver".

    Its accuracy to the east and the north is what it states horizontally over the root of two.
    """
    lat_rad, lon_rad, height_m = geodetic_from_ecef(fixes.position_ecef_m[rows])
    level_m = fixes.horizontal_sigma_m[rows] / np.sqrt(2.0)
    none = np.full(rows.size, np.nan)
    values = (
        np.full(rows.size, receiver),
        fixes.gpst[rows].astype("datetime64[ns]"),
        np.full(rows.size, "receiver"),
        np.degrees(lat_rad),
        np.degrees(lon_rad),
        height_m,
        level_m,
        level_m,
        fixes.vertical_sigma_m[rows],
        SPEED_OF_LIGHT_M_S * fixes.clock_bias_s[rows],
        np.maximum(fixes.satellites[rows], 0),
        none,
        none,
        none,
    )
    return dict(zip(FIXES_COLUMNS, values, strict=True))


def _fix_columns(kind: str, fix: Fix) -> dict[str, NDArray[Any]]:
    good = np.asarray(fix.status == FixStatus.OK)
    lat_rad, lon_rad, height_m = geodetic_from_ecef(fix.position_ecef_m[good])
    rot_enu = rot_enu_ecef(lat_rad, lon_rad)
    covariance_enu_m2 = rot_enu @ fix.covariance_m2[good, :3, :3] @ np.swapaxes(rot_enu, -1, -2)
    sigma_m = np.sqrt(np.diagonal(covariance_enu_m2, axis1=-2, axis2=-1))
    sats, sat_of_signal = np.unique([signal.sat for signal in fix.signals], return_inverse=True)
    used = np.isfinite(fix.residual_m[good])
    is_of_sat = sat_of_signal[:, np.newaxis] == np.arange(len(sats))  # (signal, satellite)
    satellites = (used.astype(np.int64) @ is_of_sat > 0).sum(axis=1)
    values = (
        np.full(lat_rad.size, fix.receiver),
        fix.gpst[good].astype("datetime64[ns]"),
        np.full(lat_rad.size, kind),
        np.degrees(lat_rad),
        np.degrees(lon_rad),
        height_m,
        *sigma_m.T,
        SPEED_OF_LIGHT_M_S * fix.clock_bias_s[good],
        satellites,
        *fix.protection_m[good].T,
        fix.hidden_m[good],
    )
    return dict(zip(FIXES_COLUMNS, values, strict=True))


def _convert_to_arrow(column: Column) -> Any:
    """Convert a column from its bytes: `pyarrow.array` and `take` import packages first that nothing else needs."""
    if isinstance(column, Words):
        return _convert_texts(column.words, column.codes)
    column = np.asarray(column)
    if column.dtype.kind == "M":
        column = column.astype("datetime64[ns]")
    if column.dtype.kind == "b":
        return _build_array(pa.bool_(), np.zeros(column.size, np.bool_), np.packbits(column, bitorder="little"))
    if column.dtype.kind not in "Miuf":
        texts = column.tolist()
        return pa.array(column, from_pandas=True) if {type(t) for t in texts} - _TEXT_TYPES else _convert_texts(texts)
    missing = np.isnat(column) if column.dtype.kind == "M" else np.isnan(column)
    return _build_array(pa.from_numpy_dtype(column.dtype), missing, column)


def _convert_texts(texts: Sequence[str | None], codes: Integers | None = None) -> Any:
    """Convert texts, or of each of `codes` (n,) the text that it counts to."""
    words = [b"" if text is None else text.encode() for text in texts]
    missing = np.array([text is None for text in texts], np.bool_)
    sizes, letters = np.array([*map(len, words)], np.int64), np.frombuffer(b"".join(words), np.uint8)
    if codes is not None:
        first = (np.cumsum(sizes) - sizes)[codes]
        sizes, missing = sizes[codes], missing[codes]
        letters = letters[np.arange(sizes.sum()) + np.repeat(first - np.cumsum(sizes) + sizes, sizes)]
    return _build_array(pa.string(), missing, np.cumsum(np.append(0, sizes), dtype=np.int32), letters)


def _build_array(kind: Any, missing: NDArray[np.bool_], *buffers: NDArray[Any]) -> Any:
    known = pa.py_buffer(np.packbits(~missing, bitorder="little")) if missing.any() else None
    held = [pa.py_buffer(np.ascontiguousarray(buffer)) for buffer in buffers]
    return pa.Array.from_buffers(kind, missing.size, [known, *held])


def _write_csv_lines(columns: Mapping[str, Column], *, headed: bool) -> Iterator[str]:
    arrays = [np.asarray(column) for column in columns.values()]
    if headed:
        yield _write_csv_text([columns.keys()])
    for start in range(0, len(arrays[0]) if arrays else 0, _CSV_ROWS):
        part = [_format_texts(a[start : start + _CSV_ROWS]) for a in arrays]
        yield _write_csv_text(zip(*part, strict=True))


def _write_csv_text(rows: Iterable[Iterable[str]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().removesuffix("\n")


def _format_texts(values: NDArray[Any]) -> list[str]:
    if values.dtype.kind == "M":
        texts: list[str] = np.datetime_as_string(values.astype("datetime64[ns]")).tolist()
        return ["" if text == "NaT" else text for text in texts]
    return [_format_text(value) for value in values.tolist()]


def _format_text(value: object) -> str:
    if value is None or value != value:  # NaN alone differs from itself
        return ""
    return str(value).lower() if isinstance(value, bool) else repr(value) if isinstance(value, float) else str(value)
