"""Read RINEX observation files: versions 2.10 and 2.11, 3.0x and 4.0x, compact and gzip too, all systems.

Damage costs the cell, the satellite or the epoch that is damaged and is reported in the remarks, never the file; of a
compact file it costs all that continues from it.
"""

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Booleans, Instants, Integers, Reals
from skyproof.errors import InputError
from skyproof.formats.bounds import EMPTY_CELLS, OBSERVATION_BYTES, Remarks, list_names
from skyproof.formats.byte_io import unpack_beginning, unpack_text
from skyproof.formats.crinex import expand, is_compact
from skyproof.formats.plausible import LETTERS, Implausible, describe_impossible, leave_out_impossible
from skyproof.formats.rinex_cells import Lines, SatelliteRows, find_rows_2, find_rows_3, parse_cells, split_lines
from skyproof.formats.rinex_obs_header import TO_DO, Header, read_header
from skyproof.formats.rinex_obs_types import KINDS, map_signals, report_names
from skyproof.formats.signatures import read_head
from skyproof.gnss.constants import BDT_BEHIND_GPST_S
from skyproof.gnss.signals import carrier_hz_of
from skyproof.gnss.thermal_noise import carrier_sigma_cyc, code_sigma_m, doppler_sigma_hz
from skyproof.gnss.time import format_iso, gpst_from_utc
from skyproof.records import CellStatus, Observations, SignalId
from skyproof.remarks import Remark, RemarkKind

__all__ = [
    "ObservationFile",
    "holds_observations",
    "parse_obs",
    "read_body",
    "read_obs",
    "require_text",
]

_UNKNOWN_CN0_DBHZ: Final = 40.0
_EMPTY_LINES: Final = 1 << 20  # that a file may have beside one line in 16 bytes
_FILLED: Final = 16  # a table may have at most so many cells for each that is filled
_LATE_NS: Final = 500_000_000  # receivers that round the instants of a header differ by less


@dataclass(frozen=True, eq=False, kw_only=True)
class ObservationFile:
    """One receiver's observations and what the header states beside them; None or "" where it does not.

    observations : epochs in GPS time, in order, one channel a signal, every copy "a".
    position_ecef_m : (3,) approximate. antenna_delta_hen_m : (3,) height, east, north of the antenna over the marker.
    time_system : of the file, "GPS" for instance. glonass_channels : frequency numbers by satellite.
    impossible : cells that were left out since no receiver measures such values, by type ("G C1C"). misread : types
        that were left out as a whole, and why.
    """

    observations: Observations
    version: float
    marker: str = ""
    receiver: str = ""
    antenna: str = ""
    position_ecef_m: Reals | None = None
    antenna_delta_hen_m: Reals | None = None
    interval_s: float | None = None
    time_system: str = "GPS"
    leap_seconds: int | None = None
    glonass_channels: Mapping[str, int] = field(default_factory=dict)
    impossible: Mapping[str, int] = field(default_factory=dict)
    misread: Mapping[str, str] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()


def read_obs(
    path: str | os.PathLike[str],
    *,
    keep: Callable[[SignalId], bool] | None = None,
    glonass_channels: Mapping[str, int] | None = None,
) -> ObservationFile:
    """Read the observations in a RINEX file, plain, compact or gzip.

    Parameters
    ----------
    keep : which signals; all without it. The others are not even parsed.
    glonass_channels : frequency numbers where the header has none, as `rinex_nav.get_glonass_channels` gives them.

    Raises
    ------
    InputError : the file cannot be read, is no RINEX observation file, or holds no observation.
    """
    content = unpack_text(Path(path), OBSERVATION_BYTES, "the observation file", TO_DO)
    return parse_obs(content, source=str(path), keep=keep, glonass_channels=glonass_channels)


def holds_observations(path: Path) -> bool:
    """Test whether a file begins as a RINEX observation file does, plain, compact or gzip."""
    if not path.is_file():
        return False
    first = unpack_beginning(read_head(path)).split(b"\n", 1)[0]
    compact = first[60:80].rstrip() == b"CRINEX VERS   / TYPE"
    return compact or (first[60:80].rstrip() == b"RINEX VERSION / TYPE" and first[20:21].upper() == b"O")


def parse_obs(
    content: bytes,
    *,
    source: str = "observations",
    keep: Callable[[SignalId], bool] | None = None,
    glonass_channels: Mapping[str, int] | None = None,
) -> ObservationFile:
    """Parse the bytes of a RINEX observation file; `source` names it in messages.

    Loss of lock, slips stated by event records and a power failure become status 3 (cycle slip). So does a phase that
    may be half a cycle off and then may not, or the reverse. Sigmas are those of thermal noise in textbook loops: code
    by an early-minus-late loop of 1 Hz and 0.5 chip, phase and frequency by loops of 15 Hz, 20 ms of integration
    (Kaplan and Hegarty, Understanding GPS/GNSS, 3rd ed., 8.9). Without C/N0 the strength indicator gives them, and 40
    dB-Hz where there is none either, which the remarks report.

    Raises
    ------
    InputError : as `read_obs` does.
    """
    compact_remarks: tuple[str, ...] = ()
    if is_compact(content):
        content, compact_remarks = expand(content, source=source)
    require_text(content, source)
    header, body_at = read_header(content, source)
    lines = split_lines(np.frombuffer(content, np.uint8)[body_at:], header.n_lines + 1)
    found = read_body(lines, header, keep=keep, glonass_channels=glonass_channels)
    impossible = describe_impossible(found.impossible, found.misread)
    remarks = [*compact_remarks, *header.remark_words(), *impossible, *found.remarks]
    if not found.observations.signals:
        first = f"; {found.remarks[0]}" if found.remarks else ""
        raise InputError(f"{source}: no observation after line {header.n_lines}{first}; {TO_DO}")
    return replace(found, remarks=tuple(remarks))


def require_text(content: bytes, source: str) -> None:
    """Raise InputError for hardly more than empty lines, whose tables would take all memory."""
    if content.count(b"\n") > _EMPTY_LINES + len(content) // 16:
        raise InputError(f"{source}: hardly more than empty lines; {TO_DO}")


def read_body(
    lines: Lines,
    header: Header,
    *,
    keep: Callable[[SignalId], bool] | None = None,
    glonass_channels: Mapping[str, int] | None = None,
    to_end: bool = True,
) -> ObservationFile:
    """Read the observations in lines of a file's body, which may hold none.

    to_end : whether the file ends with these lines. Changes of the observation types go into `header`, for later lines.
    """
    rows = (
        find_rows_3(lines, header.layout, header.restate, to_end=to_end)
        if header.version >= 3.0
        else find_rows_2(lines, header.layout, header.system, header.restate, to_end=to_end)
    )
    header.layout = rows.layouts[-1]
    numbers = dict(glonass_channels or {}) | header.glonass_channels
    table, implausible = _leave_out_implausible(_Table.of(lines, rows, header, keep), header, numbers)
    remarks = [
        *(_report_end(lines, rows, header) if to_end else ()),
        *report_names(rows.layouts, header.version),
        *implausible.remarks,
        *rows.remarks,
        *table.remarks,
    ]
    unnumbered = sorted({s.sat for s in table.signals if s.band in ("G1", "G2") and s.sat not in numbers})
    if unnumbered:
        unknown = f"no frequency number of {list_names(unnumbered)}: their carriers are not known"
        remarks.append(Remark(unknown, RemarkKind.BEARS))
    return ObservationFile(
        observations=_make_observations(table, header, numbers, remarks),
        version=header.version,
        marker=header.marker,
        receiver=header.receiver,
        antenna=header.antenna,
        position_ecef_m=header.position_ecef_m,
        antenna_delta_hen_m=header.antenna_delta_hen_m,
        interval_s=header.interval_s,
        time_system=header.time_system,
        leap_seconds=header.leap_seconds,
        glonass_channels=header.glonass_channels,
        impossible=implausible.counts,
        misread=implausible.misread,
        remarks=tuple(remarks),
    )


def _report_end(lines: Lines, rows: SatelliteRows, header: Header) -> Iterable[str]:
    """Yield remarks on signs that the file continued after the last of the lines."""
    if any(Remark.kind_of(remark) is RemarkKind.CUT for remark in rows.remarks):
        return
    if lines.text.size and lines.text[-1] != ord("\n"):
        number = lines.first_number + len(lines) - 1
        yield Remark(
            f"the file is cut, within line {number}, which has no end; add the end of the line if the line is whole",
            RemarkKind.CUT,
        )
        return
    last_ns = int(rows.instant_ns.max()) if rows.instant_ns.size else None
    if last_ns is not None and header.last_ns is not None and header.last_ns - last_ns > _LATE_NS:
        stated, found = (format_iso(np.datetime64(ns, "ns"), 0).replace("T", " ") for ns in (header.last_ns, last_ns))
        yield Remark(
            f"the header states observations until {stated}, but the last belong to {found}: the file is cut, or its "
            "header is that of a longer one",
            RemarkKind.BEARS,
        )


_Block = tuple[SignalId, Integers, dict[str, Reals], NDArray[np.uint8], Booleans, Booleans]
"""One signal's epochs, numbers by kind, strength, loss of lock, and where its phase may be half a cycle off."""


@dataclass(frozen=True, eq=False)
class _Table:
    """Every signal's numbers by epoch, (n_epochs, n_signals) each."""

    signals: tuple[SignalId, ...]
    instant_ns: Integers
    numbers: Mapping[str, Reals]  # by kind
    strength: NDArray[np.uint8]
    lost: Booleans
    half_open: Booleans
    remarks: tuple[str, ...]
    impossible: Booleans | None = None  # ranges that were left out

    @classmethod
    def of(cls, lines: Lines, rows: SatelliteRows, header: Header, keep: Callable[[SignalId], bool] | None) -> "_Table":
        place, instant_ns, remarks = _order_epochs(rows)
        observed = rows.flag[rows.epoch] < 6
        bad: list[int] = []
        blocks: list[_Block] = []
        for layout, types_by_system in enumerate(rows.layouts):
            for letter in sorted({chr(k) for k in np.unique(rows.sat // 100)}):
                types = types_by_system.get(letter, types_by_system.get("", ()))
                its = np.flatnonzero(observed & (rows.layout == layout) & (rows.sat // 100 == ord(letter)))
                its = its[place[rows.epoch[its]] >= 0]
                fields = map_signals(types, letter, header.version)
                blocks += _read_blocks(lines, rows, its, fields, header, keep, place, bad)
        signals = tuple(sorted({block[0] for block in blocks}))
        column = {signal: k for k, signal in enumerate(signals)}
        shape = (instant_ns.size, len(signals))
        filled = sum(block[1].size for block in blocks)
        if shape[0] * shape[1] > EMPTY_CELLS + _FILLED * filled:
            raise InputError(
                f"{header.source}: {shape[0]} epochs of {shape[1]} signals, of which {filled} cells are filled: the "
                "file is damaged, or holds many files; give the file of one receiver and one day"
            )
        numbers = {kind: np.full(shape, np.nan) for kind in KINDS}
        strength, lost, half_open = np.zeros(shape, np.uint8), np.zeros(shape, np.bool_), np.zeros(shape, np.bool_)
        for signal, epochs, values, marks, slips, halves in blocks:
            for kind, value in values.items():
                numbers[kind][epochs, column[signal]] = value
            strength[epochs, column[signal]] = marks
            lost[epochs, column[signal]] = slips
            half_open[epochs, column[signal]] = halves
        lost |= _mark_stated_slips(rows, place, instant_ns, signals) | _mark_changes(
            half_open, np.isfinite(numbers["L"])
        )
        faults = Remarks()
        for k in sorted(set(bad)):
            faults.add(f"line {lines.first_number + k}: a field that is not a number is left out")
        words = faults.words("further lines with fields that are not numbers")
        return cls(signals, instant_ns, numbers, strength, lost, half_open, (*remarks, *words))


def _order_epochs(rows: SatelliteRows) -> tuple[Integers, Integers, list[str]]:
    """Order the epochs of the file in time.

    Returns the place of each (-1 if it is left out), the times, and remarks on repairs.
    """
    epochs = np.flatnonzero(rows.flag < 6)
    order = epochs[np.argsort(rows.instant_ns[epochs], kind="stable")]
    instant_ns = rows.instant_ns[order]
    new = np.append(True, np.diff(instant_ns) > 0)[: order.size]
    place = np.full(rows.flag.size, -1, np.int64)
    place[order[new]] = np.arange(int(new.sum()))
    remarks: list[str] = []
    if not new.all():
        twice = f"{int((~new).sum())} epochs appear twice; the first of each is taken"
        remarks.append(Remark(twice, RemarkKind.BEARS))
    if (np.diff(epochs[np.argsort(order, kind="stable")]) < 0).any() or (np.diff(rows.instant_ns[epochs]) < 0).any():
        remarks.append("epochs are not in order of time; they were sorted")
    return place, instant_ns[new], remarks


def _read_blocks(
    lines: Lines,
    rows: SatelliteRows,
    its: Integers,
    fields: Mapping[tuple[str, str], Mapping[str, int]],
    header: Header,
    keep: Callable[[SignalId], bool] | None,
    place: Integers,
    bad: list[int],
) -> Iterable[_Block]:
    """Read the numbers of each signal in the rows `its` of one system."""
    sats = np.unique(rows.sat[its]).tolist()
    names = {sat: f"{chr(sat // 100)}{sat % 100:02d}" for sat in sats}
    wanted = {
        signal: columns
        for signal, columns in fields.items()
        if keep is None or any(keep(SignalId(name, *signal)) for name in names.values())
    }
    kept = sorted({column for columns in wanted.values() for column in columns.values()})
    if not kept or its.size == 0:
        return []
    if its.size * len(kept) > EMPTY_CELLS + lines.text.size:
        raise InputError(
            f"{header.source}: {its.size} records for {len(kept)} types of observation in {lines.text.size} bytes: the "
            "header is damaged; fetch the file again"
        )
    old = header.version < 3.0
    parsed = parse_cells(lines, rows.line[its], kept, five_a_line=old, name_columns=0 if old else 3)
    bad.extend(parsed.bad.tolist())
    at = {column: k for k, column in enumerate(kept)}
    blocks = []
    failed = rows.flag[rows.epoch[its]] == 1
    for sat in sats:
        sat_rows = np.flatnonzero(rows.sat[its] == sat)
        for signal, columns in wanted.items():
            if keep is not None and not keep(SignalId(names[sat], *signal)):
                continue
            values = {kind: parsed.value[sat_rows, at[column]] for kind, column in columns.items()}
            present = np.any([np.isfinite(values[kind]) for kind in "CLD" if kind in values] or [[False]], axis=0)
            if not present.any():
                continue
            first = at[columns.get("C", columns.get("L", next(iter(columns.values()))))]
            phase = at.get(columns.get("L", -1))
            slip, half_open = np.zeros(sat_rows.size, np.bool_), np.zeros(sat_rows.size, np.bool_)
            if phase is not None:
                slip = np.isfinite(values["L"]) & ((parsed.lli[sat_rows, phase] & 1 > 0) | failed[sat_rows])
                half_open = np.isfinite(values["L"]) & (parsed.lli[sat_rows, phase] & 2 > 0)
            strength = parsed.strength[sat_rows, first]
            if phase is not None:
                strength = np.maximum(strength, parsed.strength[sat_rows, phase])
            epochs = place[rows.epoch[its[sat_rows[present]]]]
            chosen = {kind: value[present] for kind, value in values.items()}
            blocks.append(
                (SignalId(names[sat], *signal), epochs, chosen, strength[present], slip[present], half_open[present])
            )
    return blocks


def _mark_stated_slips(
    rows: SatelliteRows, place: Integers, instant_ns: Integers, signals: tuple[SignalId, ...]
) -> Booleans:
    """Mark slips that event records (flag 6) report, at their satellites' first epoch from then on."""
    lost = np.zeros((instant_ns.size, len(signals)), np.bool_)
    for row in np.flatnonzero(rows.flag[rows.epoch] == 6):
        epoch = int(np.searchsorted(instant_ns, rows.instant_ns[rows.epoch[row]]))
        sat = f"{chr(rows.sat[row] // 100)}{rows.sat[row] % 100:02d}"
        if epoch < instant_ns.size:
            lost[epoch, [k for k, signal in enumerate(signals) if signal.sat == sat]] = True
    return lost


def _mark_changes(marks: Booleans, present: Booleans) -> Booleans:
    """Mark where a flag differs from that of the same signal's measurement before; all (n_epochs, n_signals)."""
    changed = np.zeros_like(marks)
    for column in np.flatnonzero(marks.any(axis=0)):
        epochs = np.flatnonzero(present[:, column])
        changed[epochs[1:], column] = np.diff(marks[epochs, column])
    return changed


def _leave_out_implausible(table: _Table, header: Header, channels: Mapping[str, int]) -> tuple[_Table, Implausible]:
    """Return the table without impossible cells, and without signals that then have none.

    Types that are misread as a whole go into `header`, for the lines that follow.
    """
    cells, implausible = leave_out_impossible(
        {name: table.numbers[kind] for name, kind in LETTERS.items()},
        signals=table.signals,
        elapsed_s=np.asarray((table.instant_ns - table.instant_ns[:1]) * 1e-9, np.float64),
        carrier_hz=_find_carriers_hz(table.signals, channels),
        misread=header.misread,
    )
    header.misread = implausible.misread
    if not implausible.counts:
        return table, implausible
    numbers = {kind: cells[name] for name, kind in LETTERS.items()}
    stays = np.flatnonzero(np.any([np.isfinite(numbers[kind]).any(axis=0) for kind in "CLD"], axis=0))
    return (
        replace(
            table,
            signals=tuple(table.signals[k] for k in stays),
            numbers={kind: values[:, stays] for kind, values in numbers.items()},
            strength=table.strength[:, stays],
            lost=table.lost[:, stays],
            half_open=table.half_open[:, stays],
            impossible=implausible.ranges[:, stays],
        ),
        implausible,
    )


def _find_carriers_hz(signals: Sequence[SignalId], channels: Mapping[str, int]) -> Reals:
    return np.array([carrier_hz_of(s.band, channels.get(s.sat)) for s in signals], np.float64)


def _make_observations(table: _Table, header: Header, channels: Mapping[str, int], remarks: list[str]) -> Observations:
    code_m, phase_cyc, doppler_hz, cn0_dbhz = (table.numbers[kind] for kind in KINDS)
    present = np.isfinite(code_m) | np.isfinite(phase_cyc) | np.isfinite(doppler_hz)
    by_strength = np.where(table.strength > 0, 6.0 * table.strength + 3.0, _UNKNOWN_CN0_DBHZ)
    unknown = present & ~np.isfinite(cn0_dbhz)
    if unknown.any():
        where = "all" if unknown.sum() == present.sum() else "some"
        instead = f"the strength indicator or of {_UNKNOWN_CN0_DBHZ:g} dB-Hz"
        remarks.append(f"C/N0 is missing in {where} cells: sigmas there are those of {instead}")
    assumed_dbhz = np.where(np.isfinite(cn0_dbhz), cn0_dbhz, by_strength)
    chip_m = np.array([s.plan.chip_m for s in table.signals])
    status = np.where(present, np.where(table.lost, CellStatus.SLIP, CellStatus.OK), CellStatus.NOT_TRACKED)
    if table.impossible is not None:
        status[table.impossible] = CellStatus.IMPOSSIBLE
    elapsed_s = np.asarray((table.instant_ns - table.instant_ns[:1]) * 1e-9, np.float64)
    first = present.argmax(axis=0) if len(present) else np.zeros(len(table.signals), np.intp)
    return Observations(
        receiver=header.marker or "rx1",
        signals=table.signals,
        gpst=_convert_to_gpst(table.instant_ns.astype("datetime64[ns]"), header),
        elapsed_s=elapsed_s,
        pseudorange_m=code_m,
        carrier_cyc=phase_cyc,
        doppler_hz=doppler_hz,
        cn0_dbhz=np.where(present, cn0_dbhz, np.nan),
        pseudorange_sigma_m=np.where(np.isfinite(code_m), code_sigma_m(assumed_dbhz, chip_m), np.nan),
        carrier_sigma_cyc=np.where(np.isfinite(phase_cyc), carrier_sigma_cyc(assumed_dbhz), np.nan),
        doppler_sigma_hz=np.where(np.isfinite(doppler_hz), doppler_sigma_hz(assumed_dbhz), np.nan),
        status=status.astype(np.uint8),
        half_cycle_open=table.half_open,
        found_elapsed_s=elapsed_s[first],
        missed_elapsed_s=np.where(first > 0, elapsed_s[np.maximum(first - 1, 0)], np.nan),
        carrier_hz=_find_carriers_hz(table.signals, channels),
    )


def _convert_to_gpst(instants: Instants, header: Header) -> Instants:
    """Convert instants of the file's time system to GPS time (RINEX 3.05, 4.1): GLONASS's is UTC."""
    if header.time_system in ("GLO", "UTC") and instants.size:
        return np.asarray(instants + (gpst_from_utc(instants[0]) - instants[0]))
    if header.time_system in ("BDT", "BDS"):
        return np.asarray(instants + np.timedelta64(round(BDT_BEHIND_GPST_S), "s"))
    return instants
