"""Measurements of one receiver in pieces that follow each other in time, each with the signals that it has.

Few pieces are put together; many go to a disk as they come, so that a run of any length takes the memory of one piece.
"""

from collections.abc import Iterable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Booleans, Instants, Reals
from skyproof.formats.pieces import ArrayPieces, Workspace
from skyproof.records import OBSERVABLES, ObservationLog, Observations, SignalId
from skyproof.short_repr import summarize

__all__ = ["NothingGathered", "ObservationSpool", "gather", "rename_receiver"]

HELD_EPOCHS: Final = 4096
"""As many are kept in memory, as one record."""
_OF_EPOCHS: Final = ("gpst", "elapsed_s")
_OF_CELLS: Final = (*OBSERVABLES, "status", "half_cycle_open", "quadrature_m")


class NothingGathered(ValueError):
    """There was no piece."""


def gather(
    pieces: Iterable[Observations],
    receiver: str,
    workspace: Workspace,
    name: str = "observations",
) -> ObservationLog:
    """Gather pieces to one record if they are few, else on the workspace's disk, in a folder of that name.

    Raises
    ------
    NothingGathered : no piece. ValueError : one that does not follow those before in time.
    """
    held: list[Observations] = []
    spool: ObservationSpool | None = None
    for piece in pieces:
        if spool is None:
            held.append(piece)
            if sum(held_piece.gpst.size for held_piece in held) > HELD_EPOCHS:
                spool = ObservationSpool(workspace, receiver, name)
                for held_piece in held:
                    spool.append(held_piece)
                held.clear()
        else:
            spool.append(piece)
    if spool is not None:
        return spool
    if not held:
        raise NothingGathered
    return rename_receiver(Observations.join(held), receiver)


def rename_receiver(log: ObservationLog, receiver: str) -> ObservationLog:
    """Return the same measurements under a receiver's name."""
    if isinstance(log, Observations):
        return replace(log, receiver=receiver)
    other = copy(log)
    other.receiver = receiver  # type: ignore[misc]
    return other


@dataclass(frozen=True, eq=False)
class _Piece:
    """What of a piece stays in memory: 16 bytes an epoch, and a quarter of a byte a cell."""

    first: int  # of its epochs in the whole
    signals: tuple[SignalId, ...]
    gpst: Instants
    elapsed_s: Reals
    flags: dict[str, NDArray[np.uint8]]  # packed

    @property
    def stop(self) -> int:
        return self.first + self.gpst.size

    def flag(self, name: str) -> Booleans:
        shape = self.gpst.size, len(self.signals)
        return np.unpackbits(self.flags[name], count=shape[0] * shape[1]).reshape(shape).view(np.bool_)


class ObservationSpool:
    """An `ObservationLog` whose pieces are appended. Its channels are the signals of all pieces, in their order."""

    def __init__(self, workspace: Workspace, receiver: str, name: str = "observations") -> None:
        """Start an empty spool in a folder of the receiver and that name."""
        self.receiver = receiver
        self._stored = ArrayPieces(workspace, f"{receiver}/{name}")
        self._pieces: list[_Piece] = []
        self._known = _make_empty(receiver)  # what is known of the channels of all pieces
        self._times: dict[str, NDArray[Any]] = {}

    def __repr__(self) -> str:
        names = ("receiver", "signals", *_OF_EPOCHS)
        return summarize(type(self).__name__, {name: getattr(self, name) for name in names})

    def append(self, piece: Observations) -> None:
        """Write a piece that follows those before it. Raises ValueError if it does not follow them in time."""
        if not piece.gpst.size:
            return
        if self._pieces and piece.gpst[0] <= self._pieces[-1].gpst[-1]:
            raise ValueError(f"a piece from {piece.gpst[0]} on, after one to {self._pieces[-1].gpst[-1]}")
        names = np.array([(s.sat, s.band, s.code, s.copy) for s in piece.signals], np.str_)
        self._stored.append({"signals": names} | {name: getattr(piece, name) for name in (*_OF_EPOCHS, *_OF_CELLS)})
        self._pieces.append(
            _Piece(
                first=self._pieces[-1].stop if self._pieces else 0,
                signals=piece.signals,
                gpst=piece.gpst.copy(),
                elapsed_s=piece.elapsed_s.copy(),
                flags={name: np.packbits(getattr(piece, name)) for name in ("measured", "slipped")},
            )
        )
        self._known = Observations.join((self._known, piece.read(0, 0)))
        self._times.clear()

    @property
    def signals(self) -> tuple[SignalId, ...]:
        return self._known.signals

    @property
    def gpst(self) -> Instants:
        return self._join_times("gpst")

    @property
    def elapsed_s(self) -> Reals:
        return self._join_times("elapsed_s")

    @property
    def measured(self) -> Booleans:
        return self._flag("measured")

    @property
    def slipped(self) -> Booleans:
        return self._flag("slipped")

    @property
    def found_elapsed_s(self) -> Reals:
        return self._known.found_elapsed_s

    @property
    def missed_elapsed_s(self) -> Reals:
        return self._known.missed_elapsed_s

    @property
    def carrier_hz(self) -> Reals:
        return self._known.carrier_hz

    def series(self, name: str, channel: int, first: int = 0, stop: int | None = None) -> Reals:
        """Read one observable (a field of `Observations`) of one channel, from epoch `first` to before `stop`."""
        signal = self.signals[channel]
        stop = self.gpst.size if stop is None else min(stop, self.gpst.size)
        values = np.full(max(stop - first, 0), np.nan)
        for number, rows, into in self._find_between(first, stop):
            signals = self._pieces[number].signals
            if signal in signals:
                values[into] = self._stored.read_one(number, name)[rows, signals.index(signal)]
        return values

    def read(self, first: int, stop: int) -> Observations:
        """Read the epochs from `first` to before `stop`, of all channels.

        Raises OSError if what was written cannot be read.
        """
        stop = min(stop, self.gpst.size)
        parts = [self._read_part(number, rows) for number, rows, _ in self._find_between(first, stop)]
        return replace(Observations.join((self._known, *parts)), receiver=self.receiver)

    def _read_part(self, number: int, rows: slice) -> Observations:
        """Read epochs of a piece, without the fields of its channels: `_known` has those."""
        signals, stored = self._pieces[number].signals, self._stored.read(number)
        arrays: dict[str, Any] = {name: stored[name][rows] for name in (*_OF_EPOCHS, *_OF_CELLS)}
        never = np.full(len(signals), np.inf)
        return replace(
            self._known, signals=signals, found_elapsed_s=never, missed_elapsed_s=never, carrier_hz=never, **arrays
        )

    def _find_between(self, first: int, stop: int) -> Iterator[tuple[int, slice, slice]]:
        """Find the pieces that overlap a stretch, with the rows in the piece and in the stretch."""
        for number, piece in enumerate(self._pieces):
            begin, end = max(first, piece.first), min(stop, piece.stop)
            if begin < end:
                yield number, slice(begin - piece.first, end - piece.first), slice(begin - first, end - first)

    def _join_times(self, name: str) -> NDArray[Any]:
        """Join an epoch field of all pieces once after a piece came; each piece then keeps a view of it."""
        if name not in self._times:
            dtype = "datetime64[ns]" if name == "gpst" else np.float64
            whole = np.concatenate([np.empty(0, dtype), *(getattr(piece, name) for piece in self._pieces)])
            parts: list[dict[str, Any]] = [{name: whole[piece.first : piece.stop]} for piece in self._pieces]
            self._pieces = [replace(piece, **part) for piece, part in zip(self._pieces, parts, strict=True)]
            self._times[name] = whole
        return self._times[name]

    def _flag(self, name: str) -> Booleans:
        signals = self.signals
        whole = np.zeros((self._pieces[-1].stop if self._pieces else 0, len(signals)), np.bool_)
        for piece in self._pieces:
            whole[piece.first : piece.stop, _find_columns(piece.signals, signals)] = piece.flag(name)
        return whole


def _find_columns(own: Sequence[SignalId], signals: Sequence[SignalId]) -> NDArray[np.intp]:
    at = {signal: column for column, signal in enumerate(signals)}
    return np.array([at[signal] for signal in own], np.intp)


def _make_empty(receiver: str) -> Observations:
    none = np.empty((0, 0))
    cells: dict[str, Any] = dict.fromkeys(OBSERVABLES, none)
    return Observations(
        receiver=receiver,
        signals=(),
        gpst=np.empty(0, "datetime64[ns]"),
        elapsed_s=np.empty(0),
        **cells,
        status=none.astype(np.uint8),
        found_elapsed_s=np.empty(0),
        missed_elapsed_s=np.empty(0),
    )
