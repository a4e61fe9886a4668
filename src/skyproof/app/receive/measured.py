"""What a receiver measures in a recording, written as it comes: a recording of any length in little memory.

At hand stays what later has to be known of all of it: where each measurement is, and what its carrier's half cycles are
found by.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from typing import Any, ClassVar, Final, Generic, Protocol, Self, TypeVar

import numpy as np

from skyproof.arrays import Booleans, Indices, Integers, Reals
from skyproof.formats.pieces import ArrayPieces, Workspace
from skyproof.receiver import measurement as m
from skyproof.receiver.channels import Arc
from skyproof.receiver.measurement import Measurements
from skyproof.receiver.observables import ArcCarrier, arc_carriers

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
        """An empty one, whose pieces go to the folder `name` of the workspace. keep : what of rows stays at hand."""
        self._stored = ArrayPieces(workspace, name)
        self._keep = keep
        self._pieces: list[tuple[float, float, dict[str, Any]]] = []  # from, to, and what is at hand
        self._young: list[R] = []

    def append(self, rows: R, arcs: Mapping[int, Arc]) -> None:
        """The rows of the next block, and the arcs that they are of. Raises OutputError if they cannot be written."""
        if not self._young or len(rows):
            self._young.append(rows)
        begun_s = next((one.elapsed_s[0] for one in self._young if len(one)), np.inf)
        if not len(rows) or rows.elapsed_s[-1] - begun_s < PIECE_S:
            return
        piece = _joined(self._young)
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

    def at_hand(self) -> dict[str, Any]:
        """What stays at hand of all rows. Raises IndexError before anything was appended."""
        parts = [kept for _, _, kept in self._pieces]
        if self._keep is not None:
            parts.append(self._keep(_joined(self._young)))
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

    def between(self, begin_s: float, end_s: float) -> R:
        """What has begin <= `elapsed_s` < end. Raises IndexError before anything was appended."""
        kind, parts = type(self._young[0]), []
        for number, (first_s, last_s, _) in enumerate(self._pieces):
            if first_s < end_s and last_s >= begin_s:
                stored = self._stored.read(number)
                parts.append(kind(**{f.name: stored[f.name] for f in fields(kind)}))
        found = _joined([*parts, *self._young])
        return found.select((found.elapsed_s >= begin_s) & (found.elapsed_s < end_s))


def _joined(parts: Sequence[R]) -> R:
    return type(parts[0])(
        **{f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(parts[0])}
    )


class MeasurementLog:
    """Measurements of one recording in order of time, appended block by block."""

    def __init__(self, workspace: Workspace, receiver: str, epoch_s: float) -> None:
        """An empty one. epoch_s : from one row of measurements to the next."""
        self.epoch_s = epoch_s
        self._rows: RowLog[Measurements] = RowLog(workspace, f"{receiver}/measured", self._kept)
        self._first: dict[int, Measurements] = {}
        self._dopplers_hz: dict[int, tuple[float, int]] = {}
        self._n = self.n_antennas = 0

    def __len__(self) -> int:
        return self._n

    def append(self, measured: Measurements, arcs: Mapping[int, Arc]) -> None:
        """The measurements of the next block, and the arcs that they are of."""
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
        """Of each arc the first measurement."""
        return Measurements.joined([self._first[number] for number in sorted(self._first)])

    def mean_doppler_hz(self) -> dict[int, float]:
        """Of each arc; NaN if none is known."""
        return {number: total / n if n else np.nan for number, (total, n) in self._dopplers_hz.items()}

    def read(self, first: int, stop: int) -> Measurements:
        """Those of the epochs from number `first` to before `stop`; the epoch at the first sample is number 0."""
        return self._rows.between((first - 0.5) * self.epoch_s, (stop - 0.5) * self.epoch_s)

    def whole(self) -> Measurements:
        """All of them, in the memory that they take."""
        return self._rows.between(-np.inf, np.inf)

    def on_antenna(self, first: int, stop: int, antenna: int | None) -> Measurements:
        """`read` as one antenna of several measured; None stands for the only one."""
        found = self.read(first, stop)
        return found if antenna is None else found.on_antenna(antenna)

    def counts(self, arcs: Mapping[int, Arc]) -> list[int]:
        """How many measurements with a time of week each antenna has; of a receiver with one, it has. Of several those
        count that most of them share, if there are any: one that was begun late has signals of its own."""
        timed = [number for number, arc in arcs.items() if arc.tow_ms_at_period_0 is not None]
        columns = self._rows.at_hand()
        rows = np.isin(columns["arc"], timed)
        if not self.n_antennas:
            return [int(rows.sum())]
        there = columns["there"][rows]
        shared = there.sum(axis=1) > 0.5 * self.n_antennas
        return [int(n) for n in there[shared if shared.any() else slice(None)].sum(axis=0)]

    def carriers(self, arcs: Mapping[int, Arc], antenna: int | None) -> dict[int, ArcCarrier]:
        """`observables.arc_carriers` of all measurements, or of those of one of several antennas."""
        columns = self._rows.at_hand()
        slipped = columns["slipped"]
        if antenna is not None:
            rows = columns["there"][:, antenna]
            columns = {name: column[rows] for name, column in columns.items()}
            begins = np.zeros(columns["arc"].size, np.bool_)
            begins[np.unique(columns["arc"], return_index=True)[1]] = True  # nothing to have slipped from
            slipped = columns["slipped"] | (columns["own_slipped"][:, antenna] & ~begins)
        return arc_carriers(
            columns["epoch"],
            columns["arc"],
            columns["periods"].astype(np.int64),
            columns["turned"],
            slipped,
            arcs,
            averaged_s=self.epoch_s,
        )

    def _kept(self, rows: Measurements) -> dict[str, Any]:
        """What of rows stays at hand: some 14 bytes each."""
        return {
            "epoch": np.rint(rows.elapsed_s / self.epoch_s).astype(np.int32),
            "arc": rows.arc.astype(np.int32),
            "periods": rows.column(m.PERIODS).astype(np.int32),
            "turned": rows.column(m.TURNED) > 0.0,
            "slipped": rows.column(m.SLIP) > 0.0,
            "there": np.isfinite(rows.own[..., m.OWN_PHASE_CYC]),
            "own_slipped": rows.own[..., m.OWN_SLIP] > 0.0,
        }
