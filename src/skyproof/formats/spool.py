"""Measurements of one receiver in pieces that follow each other in time, each with the signals that it has.

Few pieces are put together; many go to a disk as they come, so that a run of any length takes the memory of one piece.
"""

from collections.abc import Iterable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, fields, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Booleans, Instants, Reals
from skyproof.formats.pieces import ArrayPieces, Workspace
from skyproof.records import CellStatus, ObservationLog, Observations, SignalId

__all__ = ["NothingGathered", "ObservationSpool", "gathered", "joined", "named"]

HELD_EPOCHS: Final = 4096
"""As many are kept in memory, as one record."""
_OF_CHANNELS: Final = ("found_elapsed_s", "missed_elapsed_s", "carrier_hz")
_OF_EPOCHS: Final = ("gpst", "elapsed_s")
_OF_CELLS: Final = tuple(
    f.name
    for f in fields(Observations)
    if f.name not in ("receiver", "signals", "averaged_s", *_OF_EPOCHS, *_OF_CHANNELS)
)
_ABSENT: Final[dict[str, Any]] = {"status": np.uint8(CellStatus.NOT_TRACKED), "half_cycle_open": np.bool_(False)}
"""What stands in the cells of a signal that a piece does not have; NaN in the others."""


class NothingGathered(ValueError):
    """There was no piece."""


def gathered(
    pieces: Iterable[Observations],
    receiver: str,
    workspace: Workspace,
    name: str = "observations",
) -> ObservationLog:
    """Pieces as they come, as one record if they are few, else on the disk of the workspace, in a folder of that name.

    Raises
    ------
    NothingGathered : no piece. ValueError : one that does not follow those before in time. OutputError : the disk
        cannot be written.
    """
    held: list[Observations] = []
    spool: ObservationSpool | None = None
    for piece in pieces:
        if spool is None:
            held.append(piece)
            if sum(one.gpst.size for one in held) > HELD_EPOCHS:
                spool = ObservationSpool(workspace, receiver, name)
                for one in held:
                    spool.append(one)
                held.clear()
        else:
            spool.append(piece)
    return spool if spool is not None else joined(held, receiver)


def joined(pieces: Sequence[Observations], receiver: str) -> Observations:
    """Pieces as one record with the signals of all. Raises NothingGathered without a piece."""
    if not pieces:
        raise NothingGathered
    channels = _Channels()
    for piece in pieces:
        channels.take(piece)
    signals = channels.signals
    n = sum(piece.gpst.size for piece in pieces)
    cells = {name: _empty(name, (n, len(signals)), getattr(pieces[0], name).dtype) for name in _OF_CELLS}
    first = 0
    for piece in pieces:
        columns = _columns(piece.signals, signals)
        for name, whole in cells.items():
            whole[first : first + piece.gpst.size, columns] = getattr(piece, name)
        first += piece.gpst.size
    times: dict[str, Any] = {name: np.concatenate([getattr(piece, name) for piece in pieces]) for name in _OF_EPOCHS}
    of_channels: dict[str, Any] = channels.known()
    return Observations(
        receiver=receiver, signals=signals, averaged_s=pieces[-1].averaged_s, **times, **cells, **of_channels
    )


def named(log: ObservationLog, receiver: str) -> ObservationLog:
    """The same measurements as those of a receiver of that name."""
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
        """An empty one, in a folder of the receiver and that name."""
        self.receiver = receiver
        self._stored = ArrayPieces(workspace, f"{receiver}/{name}")
        self._pieces: list[_Piece] = []
        self._channels = _Channels()
        self._averaged_s = 0.0
        self._times: dict[str, NDArray[Any]] = {}

    def append(self, piece: Observations) -> None:
        """Write a piece that follows those before it.

        Raises
        ------
        ValueError : it does not follow them in time. OutputError : it cannot be written.
        """
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
        self._averaged_s = piece.averaged_s
        self._channels.take(piece)
        self._times.clear()

    @property
    def signals(self) -> tuple[SignalId, ...]:
        return self._channels.signals

    @property
    def gpst(self) -> Instants:
        return self._time("gpst")

    @property
    def elapsed_s(self) -> Reals:
        return self._time("elapsed_s")

    @property
    def measured(self) -> Booleans:
        return self._flag("measured")

    @property
    def slipped(self) -> Booleans:
        return self._flag("slipped")

    @property
    def found_elapsed_s(self) -> Reals:
        return self._channels.known()["found_elapsed_s"]

    @property
    def missed_elapsed_s(self) -> Reals:
        return self._channels.known()["missed_elapsed_s"]

    @property
    def carrier_hz(self) -> Reals:
        return self._channels.known()["carrier_hz"]

    def series(self, name: str, channel: int, first: int = 0, stop: int | None = None) -> Reals:
        """One observable (a field of `Observations`) of one channel, of the epochs from `first` to before `stop`."""
        signal = self.signals[channel]
        stop = self.gpst.size if stop is None else min(stop, self.gpst.size)
        values = np.full(max(stop - first, 0), np.nan)
        for number, rows, into in self._between(first, stop):
            signals = self._pieces[number].signals
            if signal in signals:
                values[into] = self._stored.read_one(number, name)[rows, signals.index(signal)]
        return values

    def read(self, first: int, stop: int) -> Observations:
        """The epochs from `first` to before `stop`, of all channels.

        Raises OSError if what was written cannot be read.
        """
        stop = min(stop, self.gpst.size)
        signals, shape = self.signals, (max(stop - first, 0), len(self.signals))
        cells: dict[str, NDArray[Any]] = {}
        for number, rows, into in self._between(first, stop):
            columns = _columns(self._pieces[number].signals, signals)
            stored = self._stored.read(number)
            for name in _OF_CELLS:
                if name not in cells:
                    cells[name] = _empty(name, shape, stored[name].dtype)
                cells[name][into, columns] = stored[name][rows]
        for name in _OF_CELLS:
            cells.setdefault(name, _empty(name, shape, np.asarray(_ABSENT.get(name, np.nan)).dtype))
        times: dict[str, Any] = {name: self._time(name)[first:stop] for name in _OF_EPOCHS}
        of_channels: dict[str, Any] = self._channels.known()
        return Observations(
            receiver=self.receiver,
            signals=signals,
            averaged_s=self._averaged_s,
            **times,
            **cells,
            **of_channels,
        )

    def _between(self, first: int, stop: int) -> Iterator[tuple[int, slice, slice]]:
        """The pieces that have epochs of a stretch: which of their own, and where those stand in the stretch."""
        for number, piece in enumerate(self._pieces):
            begin, end = max(first, piece.first), min(stop, piece.stop)
            if begin < end:
                yield number, slice(begin - piece.first, end - piece.first), slice(begin - first, end - first)

    def _time(self, name: str) -> NDArray[Any]:
        """What every epoch has, of all pieces; put together once after a piece came."""
        if name not in self._times:
            dtype = "datetime64[ns]" if name == "gpst" else np.float64
            self._times[name] = np.concatenate([np.empty(0, dtype), *(getattr(piece, name) for piece in self._pieces)])
        return self._times[name]

    def _flag(self, name: str) -> Booleans:
        signals = self.signals
        whole = np.zeros((self._pieces[-1].stop if self._pieces else 0, len(signals)), np.bool_)
        for piece in self._pieces:
            whole[piece.first : piece.stop, _columns(piece.signals, signals)] = piece.flag(name)
        return whole


class _Channels:
    """What is known of each signal of several pieces: of the one in which it was found first."""

    def __init__(self) -> None:
        self._of: dict[SignalId, tuple[float, ...]] = {}
        self.signals: tuple[SignalId, ...] = ()

    def take(self, piece: Observations) -> None:
        for channel, signal in enumerate(piece.signals):
            known = tuple(float(getattr(piece, name)[channel]) for name in _OF_CHANNELS)
            self._of[signal] = min(known, self._of.get(signal, known), key=lambda one: one[0])
        if len(self._of) != len(self.signals):
            self.signals = tuple(sorted(self._of))

    def known(self) -> dict[str, Reals]:
        """Fields of `Observations` that are of channels."""
        values = np.array([self._of[signal] for signal in self.signals], np.float64).reshape(-1, len(_OF_CHANNELS))
        return {name: values[:, index].copy() for index, name in enumerate(_OF_CHANNELS)}


def _columns(own: Sequence[SignalId], signals: Sequence[SignalId]) -> NDArray[np.intp]:
    at = {signal: column for column, signal in enumerate(signals)}
    return np.array([at[signal] for signal in own], np.intp)


def _empty(name: str, shape: tuple[int, int], dtype: Any) -> NDArray[Any]:
    return np.full(shape, _ABSENT.get(name, np.nan), dtype)
