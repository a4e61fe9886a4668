"""Hold what one receiver measures of its signals, epoch by epoch."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import cached_property
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Booleans, Instants, Reals
from skyproof.gnss.signals import carrier_hz_of
from skyproof.records.shapes import Channels, Selectable, freeze
from skyproof.records.signals import BY_NAME, SignalId
from skyproof.short_repr import ShortRepr

__all__ = [
    "CELL_STATUS",
    "OBSERVABLES",
    "ArrayPhases",
    "CellStatus",
    "ObservationLog",
    "Observations",
]


class CellStatus(IntEnum):
    """The status of a cell of `Observations`. `OK` and `SLIP` have numbers; `NO_RANGE` and `IMPOSSIBLE` all but the
    range, where they have any; the others NaN."""

    OK = 0
    NOT_TRACKED = 1
    NO_TIME = 2
    SLIP = 3
    NO_RANGE = 4
    IMPOSSIBLE = 5


CELL_STATUS: dict[int, str] = {
    CellStatus.OK: "ok",
    CellStatus.NOT_TRACKED: "not tracked",
    CellStatus.NO_TIME: "no time of week decoded yet",
    CellStatus.SLIP: "cycle slip since the epoch before",
    CellStatus.NO_RANGE: "the code's phase alone is known, and no range",
    CellStatus.IMPOSSIBLE: "a range that no receiver measures",
}
"""A `CellStatus` in words."""

OBSERVABLES: Final = (
    "pseudorange_m",
    "carrier_cyc",
    "doppler_hz",
    "cn0_dbhz",
    "pseudorange_sigma_m",
    "carrier_sigma_cyc",
    "doppler_sigma_hz",
)
"""Fields of `Observations` with one real number a cell, NaN where nothing was measured."""
_CELLS: Final = (*OBSERVABLES, "status", "half_cycle_open", "quadrature_m")
_EMPTY: Final = {"status": CellStatus.NOT_TRACKED, "half_cycle_open": False}
_OF_CHANNELS: Final = ("found_elapsed_s", "missed_elapsed_s", "carrier_hz")


def _carriers_hz(stated_hz: Reals, signals: Sequence[SignalId]) -> Reals:
    """Return the carrier of each signal (n_channels,): one number stated for all, or NaN for their plans'."""
    carriers_hz = np.asarray(stated_hz, np.float64)
    if carriers_hz.ndim:
        return carriers_hz
    if np.isnan(carriers_hz):
        return np.array([carrier_hz_of(signal.band) for signal in signals], np.float64)
    return np.full(len(signals), carriers_hz)


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Observations(ShortRepr, Selectable, Channels):
    """One receiver's measurements at common receiver times: epochs along axis 0, channels along axis 1.

    gpst : (n_epochs,) what the receiver's clock shows at each epoch; true GPS time is this minus the clock bias.
    elapsed_s : (n_epochs,) samples since the first one over the nominal rate.
    pseudorange_m : c times (gpst minus the time of transmission that the code shows); formed from sample counts and
        fractions. With `averaged_s` > 0 it is the mean over that time, centred on the epoch: white from epoch to epoch.
    carrier_cyc : accumulated carrier phase, same sign as the range (grows when the range grows), arbitrary start.
    doppler_hz : apparent carrier frequency minus nominal; falls with a growing range rate; contains the clock drift.
    pseudorange_sigma_m, carrier_sigma_cyc, doppler_sigma_hz : thermal noise, one sigma.
    status : (n_epochs, n_channels) uint8, see CellStatus. NaN always has a reason here.
    half_cycle_open : (n_epochs, n_channels) where the carrier may be half a cycle off, for nothing gave the sign of the
        data bits; elsewhere it is arbitrary by whole cycles only.
    quadrature_m : (n_epochs, n_channels) what the code discriminator shows a quarter of a cycle off the carrier: early
        less late over prompt, imaginary part, in metres of code; NaN where nobody measured it. Zero but for noise if
        one signal arrives, and its noise is that of the pseudorange. Of it and of `half_cycle_open` one value at
        construction stands for all cells.
    found_elapsed_s : (n_channels,) when the search found the signal.
    missed_elapsed_s : (n_channels,) the last search before that which looked and did not find it; NaN if the first
        search already found it. The signal came between the two.
    carrier_hz : (n_channels,) nominal carrier; by default that of each signal's plan, NaN for GLONASS's G1 and G2.
    """

    BY_ROW = ("gpst", "elapsed_s", *_CELLS)
    CELLS = _CELLS
    OF_CHANNELS = _OF_CHANNELS

    receiver: str
    signals: tuple[SignalId, ...]
    gpst: Instants
    elapsed_s: Reals
    pseudorange_m: Reals
    carrier_cyc: Reals
    doppler_hz: Reals
    cn0_dbhz: Reals
    pseudorange_sigma_m: Reals
    carrier_sigma_cyc: Reals
    doppler_sigma_hz: Reals
    status: NDArray[np.uint8]
    found_elapsed_s: Reals
    missed_elapsed_s: Reals
    carrier_hz: Reals = field(default_factory=lambda: np.array(np.nan))
    averaged_s: float = 0.0
    half_cycle_open: Booleans = field(default_factory=lambda: np.array(False))
    quadrature_m: Reals = field(default_factory=lambda: np.array(np.nan))

    def __post_init__(self) -> None:
        object.__setattr__(self, "carrier_hz", _carriers_hz(self.carrier_hz, self.signals))
        for name in ("half_cycle_open", "quadrature_m"):
            if np.ndim(value := getattr(self, name)) == 0:
                object.__setattr__(self, name, np.full(np.shape(self.status), value))
        cell = ("epoch", "channel")
        freeze(
            self,
            {
                "gpst": ("epoch",),
                "elapsed_s": ("epoch",),
                "found_elapsed_s": ("channel",),
                "missed_elapsed_s": ("channel",),
                "carrier_hz": ("channel",),
            }
            | dict.fromkeys(_CELLS, cell),
        )
        if len(self.signals) != self.found_elapsed_s.size:
            raise ValueError(f"Observations has {len(self.signals)} signals for {self.found_elapsed_s.size} channels")

    @cached_property
    def column_of(self) -> Mapping[SignalId, int]:
        """Return the column of each signal."""
        return {signal: column for column, signal in enumerate(self.signals)}

    @property
    def measured(self) -> Booleans:
        """Return where there is a pseudorange or an unknowable range, (n_epochs, n_channels)."""
        return np.asarray(np.isfinite(self.pseudorange_m) | (self.status == CellStatus.NO_RANGE))

    @property
    def slipped(self) -> Booleans:
        """Return where the carrier is not that of the epoch before, (n_epochs, n_channels)."""
        return np.asarray(self.status == CellStatus.SLIP)

    def series(self, name: str, channel: int, first: int = 0, stop: int | None = None) -> Reals:
        """Return one observable (a field's name) of one channel, epochs from `first` to before `stop`."""
        values: Reals = getattr(self, name)[first:stop, channel]
        return values

    def read(self, first: int, stop: int) -> "Observations":
        """Return the epochs from `first` to before `stop`, as views."""
        return self.select(slice(first, stop))

    @staticmethod
    def join(pieces: Sequence["Observations"]) -> "Observations":
        """Join one receiver's pieces, in order of time, into one with the signals of all.

        At least one piece.

        What holds for a channel (`found_elapsed_s` and the like) is that of the piece that found its signal first.
        """
        same = all(piece.signals == pieces[0].signals for piece in pieces[1:])  # mostly the same objects
        every = pieces[0].signals if same else {signal for piece in pieces for signal in piece.signals}
        signals = tuple(sorted(every, key=BY_NAME))
        at = {} if same and signals == every else {signal: column for column, signal in enumerate(signals)}
        shape = sum(piece.gpst.size for piece in pieces), len(signals)
        cells: dict[str, Any] = {
            name: np.full(shape, _EMPTY.get(name, np.nan), getattr(pieces[0], name).dtype) for name in _CELLS
        }
        known: dict[str, Any] = {name: np.full(len(signals), np.nan) for name in _OF_CHANNELS}
        first = 0
        for piece in pieces:
            columns = np.array([at[signal] for signal in piece.signals], np.intp) if at else np.arange(len(signals))
            for name, whole in cells.items():
                whole[first : first + piece.gpst.size, columns if at else slice(None)] = getattr(piece, name)
            sooner = ~(piece.found_elapsed_s > known["found_elapsed_s"][columns])  # NaN: not known yet
            for name, of_channels in known.items():
                of_channels[columns[sooner]] = getattr(piece, name)[sooner]
            first += piece.gpst.size
        times: dict[str, Any] = {
            name: np.concatenate([getattr(piece, name) for piece in pieces]) for name in ("gpst", "elapsed_s")
        }
        return replace(pieces[-1], receiver=pieces[0].receiver, signals=signals, **times, **cells, **known)


class ObservationLog(Protocol):
    """One receiver's measurements over a whole run, read in stretches: `Observations`, or pieces of them on a disk.

    What every epoch has is in memory: times, (n_epochs,), and where there are measurements, (n_epochs, n_channels).
    """

    @property
    def receiver(self) -> str: ...
    @property
    def signals(self) -> tuple[SignalId, ...]: ...
    @property
    def gpst(self) -> Instants: ...
    @property
    def elapsed_s(self) -> Reals: ...
    @property
    def found_elapsed_s(self) -> Reals: ...
    @property
    def missed_elapsed_s(self) -> Reals: ...
    @property
    def carrier_hz(self) -> Reals: ...
    @property
    def measured(self) -> Booleans: ...
    @property
    def slipped(self) -> Booleans: ...

    def series(self, name: str, channel: int, first: int = 0, stop: int | None = None) -> Reals:
        """Return one observable (a field's name) of one channel, epochs from `first` to before `stop`."""

    def read(self, first: int, stop: int) -> Observations:
        """Read the epochs from `first` to before `stop`, of all channels."""


@dataclass(frozen=True, kw_only=True)
class SnapshotChange:
    """A signal that does not stay what it is within a snapshot.

    kind : it begins, ends, or turns to another direction, from `gpst` on. p_value : that noise makes it.
    """

    signal: SignalId
    kind: str
    gpst: np.datetime64
    after_s: float
    p_value: float


@dataclass(frozen=True, kw_only=True)
class SnapshotChanges:
    """What was found changed of all signals of a snapshot. chance : that noise changes one signal that does not."""

    signals: tuple[SignalId, ...]
    changes: tuple[SnapshotChange, ...]
    chance: float


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ArrayPhases(ShortRepr, Selectable, Channels):
    """Carrier phases of every signal on every antenna of one receiver's array: epochs, channels, antennas.

    elapsed_s : (n_epochs,) as in `Observations`.
    elements_m : (n_antennas, 3) phase centres in the body frame (forward, right, down).
    phase_cyc : (n_epochs, n_channels, n_antennas) grows where an antenna is nearer to the source, by the projection of
        its position in wavelengths; what antennas share and whole cycles are arbitrary. NaN where there is nothing.
    sigma_cyc : the same, thermal noise, one sigma.
    calibrated : constant delays of antenna lines are known, and taken off.
    elements_sigma_m : of each phase centre along each axis; None if not known.
    pattern_sigma_m : of each antenna's phase, by its pattern and its neighbours: what is the same for signals of one
        direction only, as a length; None if not known.
    lasting_sigma_cyc : of each signal's phase on each antenna, what epochs share and their mean keeps.
    carrier_hz : (n_channels,) nominal carrier; by default that of each signal's plan, NaN for GLONASS's G1 and G2.
    """

    BY_ROW = ("gpst", "elapsed_s", "phase_cyc", "sigma_cyc")
    CELLS = ("phase_cyc", "sigma_cyc")
    OF_CHANNELS = ("carrier_hz",)
    TIME = "elapsed_s"

    receiver: str
    signals: tuple[SignalId, ...]
    gpst: Instants
    elapsed_s: Reals
    elements_m: Reals
    phase_cyc: Reals
    sigma_cyc: Reals
    carrier_hz: Reals = field(default_factory=lambda: np.array(np.nan))
    calibrated: bool = True
    elements_sigma_m: float | None = None
    pattern_sigma_m: float | None = None
    lasting_sigma_cyc: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "carrier_hz", _carriers_hz(self.carrier_hz, self.signals))
        cell = ("epoch", "channel", "antenna")
        freeze(
            self,
            {
                "gpst": ("epoch",),
                "elapsed_s": ("epoch",),
                "elements_m": ("antenna", "3"),
                "phase_cyc": cell,
                "sigma_cyc": cell,
                "carrier_hz": ("channel",),
            },
        )
        if len(self.signals) != self.carrier_hz.size:
            raise ValueError(f"ArrayPhases has {len(self.signals)} signals for {self.carrier_hz.size} channels")
