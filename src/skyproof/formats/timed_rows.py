"""Read rows of numbers with a time each, from CSV or Parquet, as sensors and loggers write them.

The time stands in `gpst` (GPS time: ISO 8601 without a zone in CSV, a timestamp without a zone in Parquet) or in
`time_s`, seconds from a start that the file does not state. Times rise. Other columns do no harm. An empty field, NaN
and infinity are a number that is missing.
"""

import csv
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq

from skyproof.arrays import Integers, Reals
from skyproof.errors import InputError, shorten
from skyproof.formats.bounds import SECONDS, SERIES_BYTES, SERIES_ROWS
from skyproof.formats.byte_io import read_content, read_text
from skyproof.formats.documents import read_rows
from skyproof.gnss.time import FIRST_YEAR, LAST_YEAR, parse_iso
from skyproof.remarks import Remark, RemarkKind

__all__ = ["TimedRows", "read_timed_rows"]

TIMES: Final = ("gpst", "time_s")
"""Columns of time, the one that is used first."""
_NAT: Final = np.iinfo(np.int64).min


@dataclass(frozen=True, eq=False, kw_only=True)
class TimedRows:
    """The rows of a file.

    time_ns : (n,) rising, whole nanoseconds: of `datetime64[ns]` if `dated`, else since `time_s` = 0. values : (n, k)
    one column for each name that was asked for; NaN where a number is missing. where : of a row's number, the place of
    that row in the file: "imu.csv: line 7". remarks : on rows left out.
    """

    source: str
    time_ns: Integers
    dated: bool
    values: Reals
    where: Callable[[int], str]
    remarks: tuple[str, ...] = ()


def read_timed_rows(path: str | os.PathLike[str], columns: Sequence[str], what: str) -> TimedRows:
    """Read the named columns of a file that ends in .csv or .parquet, over its times.

    what : the file in words, for messages: "the inertial readings".

    Raises
    ------
    InputError : the file cannot be read, is longer than `SERIES_BYTES`, ends otherwise, lacks a column, holds text
        where a number or an instant is expected, has no row, or its times do not rise. Names file, line and column.
        A file of text that ends within a row is read up to there, which `remarks` says.
    """
    source, ending = os.fspath(path), Path(path).suffix.lower()
    if ending not in (".csv", ".parquet"):
        raise InputError(f'{source}: {what} cannot be read from a file that ends in "{ending}"; give .csv or .parquet')
    content_or_text = read_text if ending == ".csv" else read_content
    content = content_or_text(Path(path), SERIES_BYTES, what, "give a table of rows over time")
    remarks: tuple[str, ...] = ()
    if ending == ".csv":
        content, remarks = _drop_cut_row(content, columns)
    read = _read_csv if ending == ".csv" else _read_parquet
    time, times, values, where = read(content, columns, source)
    if times.size == 0:
        raise InputError(f"{source}: no rows, expected one for each time; give a file with readings")
    _require_rising(times, time, where)
    values[~np.isfinite(values)] = np.nan
    return TimedRows(source=source, time_ns=times, dated=time == "gpst", values=values, where=where, remarks=remarks)


_Read = tuple[str, Integers, Reals, Callable[[int], str]]


def _find_time_column(names: Sequence[str], columns: Sequence[str], where: str) -> str:
    """Find the column of time. Raises InputError where a column is missing or appears twice."""
    time = next((name for name in TIMES if name in names), None)
    lacking = ([" or ".join(TIMES)] if time is None else []) + [name for name in columns if name not in names]
    if time is None or lacking:
        raise InputError(
            f"{where}: the columns are {shorten(', '.join(names), 200) or 'none'}, expected {', '.join(lacking)} as "
            "well; name the columns so, in these units"
        )
    for name in (time, *columns):
        if list(names).count(name) > 1:
            raise InputError(f"{where}: the column {name} appears twice; leave one out")
    return time


# CSV ------------------------------------------------------------------------------------------------------------------


def _read_csv(content: bytes, columns: Sequence[str], source: str) -> _Read:
    """Read CSV by PyArrow, which is fast; where that fails, row by row, to name the row."""
    head, _, rest = content.partition(b"\n")
    names = _read_names(head, source)
    time = _find_time_column(names, columns, f"{source}: line 1")

    def where(row: int) -> str:
        rows = (line for line, fields in _iterate_rows(content, source) if fields)
        return f"{source}: line {next(line for number, line in enumerate(rows) if number == row)}"

    types = {name: pa.float64() for name in columns} | {time: pa.timestamp("ns") if time == "gpst" else pa.float64()}
    try:
        table = pa_csv.read_csv(
            pa.py_buffer(rest),
            read_options=pa_csv.ReadOptions(column_names=_make_unlike(names)),
            convert_options=pa_csv.ConvertOptions(
                column_types=types, include_columns=[time, *columns], strings_can_be_null=False
            ),
        )
    except pa.ArrowInvalid:
        times, values = _read_row_by_row(content, names, time, columns, source)
        return time, times, values, where
    _require_rows(table.num_rows, source)
    return time, _convert_to_ns(table.column(time), time, where), _convert_numbers(table, columns, source), where


def _drop_cut_row(content: bytes, columns: Sequence[str]) -> tuple[bytes, tuple[str, ...]]:
    """Return the content without a last row that is cut, and a remark on that.

    A last row may lack its line end (RFC 4180, 2). It is cut if fields are missing, or the last one cannot be read.
    """
    kept, newline, last = content.rpartition(b"\n")
    if not newline or not last.strip():
        return content, ()
    names, fields = _read_names(content.partition(b"\n")[0], ""), _read_names(last, "")
    by_name = dict(zip(names, fields, strict=False))
    numbers = [text for name, text in by_name.items() if name in columns or name == "time_s"]
    if len(fields) >= len(names) and fields[-1] and all(map(_is_number, numbers)):
        return content, ()
    line = content.count(b"\n") + 1
    cut = f"the file is cut: it ends within line {line}, which is left out"
    return kept + newline, (Remark(cut, RemarkKind.CUT),)


def _is_number(text: str) -> bool:
    try:
        float(text or "nan")
    except ValueError:
        return False
    return True


def _read_names(head: bytes, source: str) -> list[str]:
    try:
        return [name.strip() for name in next(csv.reader([head.decode("utf-8", errors="replace")]), [])]
    except csv.Error as error:  # a field of more than 131072 characters
        raise InputError(f"{source}: line 1: {error}; begin with a line that names the columns") from error


def _make_unlike(names: Sequence[str]) -> list[str]:
    """Make repeated names different; only columns that were not asked for repeat."""
    return [name if name and name not in names[:k] else f"{k}: {name}" for k, name in enumerate(names)]


def _iterate_rows(content: bytes, source: str) -> Iterator[tuple[int, list[str]]]:
    """Iterate over the rows after the first, each with its last line."""
    return islice(read_rows(content.decode("utf-8", errors="replace"), source), 1, None)


def _read_row_by_row(
    content: bytes, names: Sequence[str], time: str, columns: Sequence[str], source: str
) -> tuple[Integers, Reals]:
    at, where_values = names.index(time), [names.index(name) for name in columns]
    times, values = list[int](), list[list[float]]()
    for line, fields in _iterate_rows(content, source):
        if not fields:
            continue
        where = f"{source}: line {line}"
        if len(fields) != len(names):
            raise InputError(f"{where}: {len(fields)} fields, expected {len(names)}; fix the line or leave it out")
        _require_rows(len(times), source)
        times.append(_parse_instant_ns(fields[at].strip(), time, where))
        values.append(
            [_parse_number(fields[k].strip(), name, where) for k, name in zip(where_values, columns, strict=True)]
        )
    return np.array(times, np.int64), np.array(values, np.float64).reshape(len(times), len(columns))


def _parse_instant_ns(text: str, time: str, where: str) -> int:
    if time == "gpst":
        try:
            return int(parse_iso(text).astype(np.int64))
        except ValueError as error:
            raise InputError(f"{where}, gpst: {error}; fix it or leave the line out") from error
    time_s = _parse_number(text, time, where)
    return _NAT if np.isnan(time_s) or abs(time_s) > SECONDS else round(time_s * 1e9)


def _parse_number(text: str, column: str, where: str) -> float:
    try:
        return float(text) if text else np.nan
    except ValueError:
        raise InputError(
            f'{where}, {column}: "{shorten(text)}" is not a number; fix it, or leave the field empty'
        ) from None


# Parquet --------------------------------------------------------------------------------------------------------------


def _read_parquet(content: bytes, columns: Sequence[str], source: str) -> _Read:
    try:
        file = pq.ParquetFile(pa.BufferReader(content))
        names = file.schema_arrow.names
        time = _find_time_column(names, columns, source)
        _require_rows(file.metadata.num_rows, source)
        table = file.read(columns=[time, *columns])
    except (pa.ArrowException, OSError) as error:
        words = shorten(str(error).splitlines()[0] if str(error) else type(error).__name__, 120)
        raise InputError(f"{source}: not a readable Parquet file ({words}); write it again") from error

    def where(row: int) -> str:
        return f"{source}: row {row + 1}"

    of_time = table.column(time)
    if time == "gpst" and not (pa.types.is_timestamp(of_time.type) and of_time.type.tz is None):
        raise InputError(
            f"{source}: the column gpst is of type {of_time.type}, expected a timestamp without a zone; store GPS time "
            "so, or give time_s"
        )
    return time, _convert_to_ns(of_time, time, where), _convert_numbers(table, columns, source), where


# Both -----------------------------------------------------------------------------------------------------------------


def _convert_numbers(table: pa.Table, columns: Sequence[str], source: str) -> Reals:
    values = np.empty((table.num_rows, len(columns)))
    for k, name in enumerate(columns):
        column = table.column(name)
        if not (pa.types.is_floating(column.type) or pa.types.is_integer(column.type) or pa.types.is_null(column.type)):
            raise InputError(f"{source}: the column {name} is of type {column.type}, expected numbers; store them so")
        values[:, k] = column.cast(pa.float64(), safe=False).to_numpy()
    return values


def _convert_to_ns(column: pa.ChunkedArray, time: str, where: Callable[[int], str]) -> Integers:
    """Convert times to whole nanoseconds; `_NAT` where there is none."""
    if time == "gpst":
        try:
            instants = column.cast(pa.timestamp("ns")).to_numpy().astype("datetime64[ns]")
        except pa.ArrowInvalid:  # a year that nanoseconds do not reach
            instants = column.cast(pa.timestamp("s"), safe=False).to_numpy().astype("datetime64[s]")
        years = instants.astype("datetime64[Y]").astype(np.int64) + 1970
        outside = (~np.isnat(instants) & ((years < FIRST_YEAR) | (years > LAST_YEAR))).nonzero()[0]
        if outside.size:
            row = int(outside[0])
            raise InputError(
                f"{where(row)}, gpst: the year is {years[row]}, expected {FIRST_YEAR} to {LAST_YEAR}; fix the time"
            )
        return np.asarray(instants.astype(np.int64))
    try:
        seconds = column.cast(pa.float64(), safe=False).to_numpy()
    except pa.ArrowException:
        raise InputError(
            f"{where(0)}, time_s: of type {column.type}, expected seconds; store the times as numbers"
        ) from None
    known = np.abs(seconds) <= SECONDS
    return np.where(known, np.rint(np.where(known, seconds, 0.0) * 1e9).astype(np.int64), _NAT)


def _require_rows(rows: int, source: str) -> None:
    if rows > SERIES_ROWS:
        raise InputError(f"{source}: more rows than the limit of {SERIES_ROWS}; give a shorter stretch")


def _require_rising(times: Integers, time: str, where: Callable[[int], str]) -> None:
    unknown = (times == _NAT).nonzero()[0]
    if unknown.size:
        expected = "an instant" if time == "gpst" else f"seconds, {SECONDS:g} or less either way, and no smaller unit"
        raise InputError(f"{where(int(unknown[0]))}, {time}: no time, expected {expected}; leave the row out")
    back = (np.diff(times) <= 0).nonzero()[0]
    if back.size:
        row = int(back[0]) + 1
        by = "the same time as" if times[row] == times[row - 1] else "earlier than"
        raise InputError(
            f"{where(row)}, {time}: {by} the row before, expected times that rise; sort the rows and leave out "
            "repeated ones"
        )
