"""What a receiver measures in a recording, written as it comes: a recording of any length in little memory.

Kept in memory is what later has to be known of all of it: where each measurement is, and what its carrier's
half cycles are found by.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any, ClassVar, Final, Generic, Protocol, Self, TypeVar

import numpy as np

from skyproof.arrays import Booleans, Indices, Integers, Reals
from skyproof.formats.pieces import ArrayPieces, Workspace
from skyproof.receiver import measurement as m
from skyproof.receiver.channels import Arc
from skyproof.receiver.measurement import Measurements
from skyproof.receiver.observables import ArcCarrier, resolve_carriers

__all__ = ["MeasurementLog", "RowLog"]

PIECE_S: Final = 10.0
"""Of receiver time. What is younger is lost with a run that is killed."""


class MeasuredRows(Protocol):
    """A dataclass of arrays with one row per signal and time, in order of time."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def elapsed_s(self) -> Reals: ...
    @property
    def arc(self) -> Integers: ...
    def __len__(self) -> int: ...
    def select(self, rows: slice | Booleans | Indices) -> Self: ...


R = TypeVar("R", bound=MeasuredRows)


class RowLog(Generic[R]):
    """Rows of one recording in order of time, appended block by block and read in stretches."""

    def __init__(self, workspace: Workspace, name: str, keep: Callable[[R], dict[str, Any]] | None = None) -> None:
        """Make an empty one, whose pieces go to the folder `name` of the workspace.

        keep : the part of rows that is kept in memory.
        """
        self._stored = ArrayPieces(workspace, name)
        self._keep = keep
        self._pieces: list[tuple[float, float, dict[str, Any]]] = []  # from, to, and what is at hand
        self._young: list[R] = []

    def append(self, rows: R, arcs: Mapping[int, Arc]) -> None:
        """Append the rows of the next block, with their arcs. Raises OutputError if they cannot be written."""
        if not self._young or len(rows):
            self._young.append(rows)
        begun_s = next((rows_before.elapsed_s[0] for rows_before in self._young if len(rows_before)), np.inf)
        if not len(rows) or rows.elapsed_s[-1] - begun_s < PIECE_S:
            return
        piece = _join(self._young)
        signals = [arcs[number].signal for number in piece.arc.tolist()]
        names = {name: np.array([getattr(s, name) for s in signals], np.str_) for name in ("sat", "copy")}
        self._stored.append({f.name: getattr(piece, f.name) for f in fields(piece)} | names)
        kept = {} if self._keep is None else self._keep(piece)
        pieces = [*self._pieces, (float(piece.elapsed_s[0]), float(piece.elapsed_s[-1]), kept)]
        young = [piece.select(slice(0))]
        self._pieces, self._young = pieces, young  # at once, whenever Ctrl-C comes

    def clear(self) -> None:
        """Forget everything."""
        self._stored.clear()
        self._pieces, self._young = [], []

    def kept_columns(self) -> dict[str, Any]:
        """Return the kept part of all rows. Raises IndexError before anything was appended."""
        parts = [kept for _, _, kept in self._pieces]
        if self._keep is not None:
            parts.append(self._keep(_join(self._young)))
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

    def select_between(self, begin_s: float, end_s: float) -> R:
        """Read the rows with begin <= `elapsed_s` < end. Raises IndexError before anything was appended."""
        kind, parts = type(self._young[0]), []
        for number, (first_s, last_s, _) in enumerate(self._pieces):
            if first_s < end_s and last_s >= begin_s:
                stored = self._stored.read(number)
                parts.append(kind(**{f.name: stored[f.name] for f in fields(kind)}))
        found = _join([*parts, *self._young])
        return found.select((found.elapsed_s >= begin_s) & (found.elapsed_s < end_s))


def _join(parts: Sequence[R]) -> R:
    return type(parts[0])(
        **{f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(parts[0])}
    )


class MeasurementLog:
    """Measurements of one recording in order of time, appended block by block."""

    def __init__(self, workspace: Workspace, receiver: str, epoch_s: float, *, as_one: bool = False) -> None:
        """An empty one. epoch_s : from one row of measurements to the next. as_one : of several antennas keep only what
        is measured in their sum."""
        self.epoch_s, self._as_one = epoch_s, as_one
        self._rows: RowLog[Measurements] = RowLog(workspace, f"{receiver}/measured", self._columns_to_keep)
        self._first: dict[int, Measurements] = {}
        self._dopplers_hz: dict[int, tuple[float, int]] = {}
        self._n = self.n_antennas = 0

    def __len__(self) -> int:
        return self._n

    def append(self, measured: Measurements, arcs: Mapping[int, Arc]) -> None:
        """Append the measurements of the next block, with their arcs."""
        measured = replace(measured, own=measured.own[:, :0]) if self._as_one else measured
        numbers, rows = np.unique(measured.arc, return_index=True)
        for number, row in zip(numbers.tolist(), rows.tolist(), strict=True):
            if number not in self._first:
                self._first[number] = measured.select(np.arange(len(measured)) == row)
            doppler_hz = measured.column(m.DOPPLER_HZ)[measured.arc == number]
            known = doppler_hz[np.isfinite(doppler_hz)]
            total, n = self._dopplers_hz.get(number, (0.0, 0))
            self._dopplers_hz[number] = total + float(known.sum()), n + known.size
        self._n += len(measured)
        self.n_antennas = int(measured.own.shape[1])  # that are measured beside their sum; none where there is one
        self._rows.append(measured, arcs)

    def clear(self) -> None:
        """Forget everything."""
        self._rows.clear()
        self._first, self._dopplers_hz, self._n = {}, {}, 0

    @property
    def first(self) -> Measurements:
        """Return the first measurement of each arc."""
        return Measurements.join([self._first[number] for number in sorted(self._first)])

    def mean_doppler_hz(self) -> dict[int, float]:
        """Average the Dopplers of each arc; NaN if none is known."""
        return {number: total / n if n else np.nan for number, (total, n) in self._dopplers_hz.items()}

    def read(self, first: int, stop: int) -> Measurements:
        """Read the epochs from number `first` to before `stop`; the epoch at the first sample is number 0."""
        return self._rows.select_between((first - 0.5) * self.epoch_s, (stop - 0.5) * self.epoch_s)

    def whole(self) -> Measurements:
        """Read all measurements, in the memory that they take."""
        return self._rows.select_between(-np.inf, np.inf)

    def on_antenna(self, first: int, stop: int, antenna: int | None) -> Measurements:
        """`read` as one antenna of several measured; None stands for the only one."""
        found = self.read(first, stop)
        return found if antenna is None else found.on_antenna(antenna)

    def counts(self, arcs: Mapping[int, Arc]) -> list[int]:
        """Count the measurements with a time of week on each antenna, or on the only one.

        Of several antennas those count that most of them share, if there are any: an antenna that began late has
        signals of its own.
        """
        timed = [number for number, arc in arcs.items() if arc.tow_ms_at_period_0 is not None]
        columns = self._rows.kept_columns()
        rows = np.isin(columns["arc"], timed)
        if not self.n_antennas:
            return [int(rows.sum())]
        present = columns["there"][rows]
        shared = present.sum(axis=1) > 0.5 * self.n_antennas
        return [int(n) for n in present[shared if shared.any() else slice(None)].sum(axis=0)]

    def carriers(self, arcs: Mapping[int, Arc], antenna: int | None) -> dict[int, ArcCarrier]:
        """Collect `observables.arc_carriers` of all arcs, or of those on one of several antennas."""
        columns = self._rows.kept_columns()
        slipped = columns["slipped"]
        if antenna is not None:
            rows = columns["there"][:, antenna]
            columns = {name: column[rows] for name, column in columns.items()}
            begins = np.zeros(columns["arc"].size, np.bool_)
            begins[np.unique(columns["arc"], return_index=True)[1]] = True  # nothing to have slipped from
            slipped = columns["slipped"] | (columns["own_slipped"][:, antenna] & ~begins)
        return resolve_carriers(
            columns["epoch"],
            columns["arc"],
            columns["periods"].astype(np.int64),
            columns["turned"],
            slipped,
            arcs,
            averaged_s=self.epoch_s,
        )

    def _columns_to_keep(self, rows: Measurements) -> dict[str, Any]:
        """Return the part of rows that is kept in memory: some 14 bytes each."""
        return {
            "epoch": np.rint(rows.elapsed_s / self.epoch_s).astype(np.int32),
            "arc": rows.arc.astype(np.int32),
            "periods": rows.column(m.PERIODS).astype(np.int32),
            "turned": rows.column(m.TURNED) > 0.0,
            "slipped": rows.column(m.SLIP) > 0.0,
            "there": np.isfinite(rows.own[..., m.OWN_PHASE_CYC]),
            "own_slipped": rows.own[..., m.OWN_SLIP] > 0.0,
        }
