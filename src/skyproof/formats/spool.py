"""Measurements of a receiver on a disk, in pieces as they come: a run of any length in the memory of one piece.

A piece is a file of NumPy arrays (`numpy.savez`) that appears whole or not at all, so that what was written before a
run was killed can be read. Pieces follow each other in time; a signal may come with any of them.
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Booleans, Instants, Reals
from skyproof.records import CellStatus, Observations, SignalId

__all__ = ["ObservationSpool"]

_OF_CHANNELS: Final = ("found_elapsed_s", "missed_elapsed_s", "carrier_hz")
_OF_EPOCHS: Final = ("gpst", "elapsed_s")
_OF_CELLS: Final = tuple(
    f.name
    for f in fields(Observations)
    if f.name not in ("receiver", "signals", "averaged_s", *_OF_EPOCHS, *_OF_CHANNELS)
)
_ABSENT: Final[dict[str, Any]] = {"status": np.uint8(CellStatus.NOT_TRACKED), "half_cycle_open": np.bool_(False)}
"""What stands in the cells of a signal that a piece does not have; NaN in the others."""


@dataclass(frozen=True, eq=False)
class _Piece:
    """What of a piece stays in memory: 18 bytes an epoch, and 2 a cell."""

    path: Path
    first: int  # of its epochs in the whole
    signals: tuple[SignalId, ...]
    gpst: Instants
    elapsed_s: Reals
    measured: Booleans
    slipped: Booleans

    @property
    def stop(self) -> int:
        return self.first + self.gpst.size


class ObservationSpool:
    """An `ObservationLog` whose pieces are appended. Its channels are the signals of all pieces, in their order."""

    def __init__(self, folder: Path, receiver: str) -> None:
        """An empty one in `folder`, which is made."""
        folder.mkdir(parents=True)
        self.folder, self.receiver = folder, receiver
        self._pieces: list[_Piece] = []
        self._channels: dict[SignalId, tuple[float, ...]] = {}
        self._averaged_s = 0.0
        self._whole: dict[str, NDArray[Any]] = {}

    def append(self, piece: Observations) -> None:
        """Write a piece that follows those before it.

        Raises
        ------
        ValueError : it does not follow them in time. OSError : it cannot be written.
        """
        if not piece.gpst.size:
            return
        if self._pieces and piece.gpst[0] <= self._pieces[-1].gpst[-1]:
            raise ValueError(f"a piece from {piece.gpst[0]} on, after one to {self._pieces[-1].gpst[-1]}")
        path = self.folder / f"{len(self._pieces):06d}.npz"
        part = path.with_suffix(".part")
        names = np.array([(s.sat, s.band, s.code, s.copy) for s in piece.signals], np.str_)
        with part.open("wb") as file:
            np.savez(file, signals=names, **{name: getattr(piece, name) for name in (*_OF_EPOCHS, *_OF_CELLS)})
        part.replace(path)
        first = self._pieces[-1].stop if self._pieces else 0
        times = piece.gpst.copy(), piece.elapsed_s.copy()
        self._pieces.append(_Piece(path, first, piece.signals, *times, piece.measured, piece.slipped))
        self._averaged_s = piece.averaged_s
        for channel, signal in enumerate(piece.signals):
            known = tuple(float(getattr(piece, name)[channel]) for name in _OF_CHANNELS)
            self._channels[signal] = min(known, self._channels.get(signal, known), key=lambda one: one[0])
        self._whole.clear()

    @property
    def signals(self) -> tuple[SignalId, ...]:
        return tuple(sorted(self._channels))

    @property
    def gpst(self) -> Instants:
        return self._joined("gpst")

    @property
    def elapsed_s(self) -> Reals:
        return self._joined("elapsed_s")

    @property
    def measured(self) -> Booleans:
        return self._joined("measured")

    @property
    def slipped(self) -> Booleans:
        return self._joined("slipped")

    @property
    def found_elapsed_s(self) -> Reals:
        return self._of_channels("found_elapsed_s")

    @property
    def missed_elapsed_s(self) -> Reals:
        return self._of_channels("missed_elapsed_s")

    @property
    def carrier_hz(self) -> Reals:
        return self._of_channels("carrier_hz")

    def series(self, name: str, channel: int, first: int = 0, stop: int | None = None) -> Reals:
        """One observable (a field of `Observations`) of one channel, of the epochs from `first` to before `stop`."""
        signal = self.signals[channel]
        stop = self.gpst.size if stop is None else min(stop, self.gpst.size)
        values = np.full(max(stop - first, 0), np.nan)
        for piece, rows, into in self._between(first, stop):
            if signal in piece.signals:
                with np.load(piece.path) as stored:
                    values[into] = stored[name][rows, piece.signals.index(signal)]
        return values

    def read(self, first: int, stop: int) -> Observations:
        """The epochs from `first` to before `stop`, of all channels.

        Raises OSError if what was written cannot be read.
        """
        stop = min(stop, self.gpst.size)
        signals, shape = self.signals, (max(stop - first, 0), len(self._channels))
        values: dict[str, Any] = {}
        for piece, rows, into in self._between(first, stop):
            columns = np.array([signals.index(signal) for signal in piece.signals], np.intp)
            with np.load(piece.path) as stored:
                for name in _OF_CELLS:
                    own = stored[name][rows]
                    if name not in values:
                        values[name] = np.full(shape, _ABSENT.get(name, np.nan), own.dtype)
                    values[name][into, columns] = own
        for name in _OF_CELLS:
            values.setdefault(name, np.full(shape, _ABSENT.get(name, np.nan)))
        values |= {name: self._joined(name)[first:stop] for name in _OF_EPOCHS}
        values |= {name: self._of_channels(name) for name in _OF_CHANNELS}
        return Observations(receiver=self.receiver, signals=signals, averaged_s=self._averaged_s, **values)

    def _between(self, first: int, stop: int) -> Iterator[tuple[_Piece, slice, slice]]:
        """The pieces that have epochs of a stretch: which of their own, and where those stand in the stretch."""
        for piece in self._pieces:
            begin, end = max(first, piece.first), min(stop, piece.stop)
            if begin < end:
                yield piece, slice(begin - piece.first, end - piece.first), slice(begin - first, end - first)

    def _of_channels(self, name: str) -> Reals:
        index = _OF_CHANNELS.index(name)
        return np.array([self._channels[signal][index] for signal in self.signals], np.float64)

    def _joined(self, name: str) -> NDArray[Any]:
        """What every epoch has, of all pieces; put together once after a piece came."""
        if name not in self._whole:
            self._whole[name] = self._put_together(name)
        return self._whole[name]

    def _put_together(self, name: str) -> NDArray[Any]:
        if name in _OF_EPOCHS:
            dtype = "datetime64[ns]" if name == "gpst" else np.float64
            return np.concatenate([np.empty(0, dtype), *(getattr(piece, name) for piece in self._pieces)])
        signals = self.signals
        whole = np.zeros((self._pieces[-1].stop if self._pieces else 0, len(signals)), np.bool_)
        for piece in self._pieces:
            columns = np.array([signals.index(signal) for signal in piece.signals], np.intp)
            whole[piece.first : piece.stop, columns] = getattr(piece, name)
        return whole
