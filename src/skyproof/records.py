"""The vocabulary: what flows between the rooms.

Frozen dataclasses of arrays, time along axis 0, channels along axis 1, NaN where there is nothing, units in the names.
An instant is a label: `numpy.datetime64[ns]` read as GPS time (no leap seconds, no zone). A measurement is never the
difference of two labels. Frames are ECEF WGS-84 unless a name says otherwise; angles are radians unless a name says
deg.

Frozen means frozen: `freeze` checks that shapes agree and keeps read-only views; the caller's arrays stay writable.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from enum import IntEnum, StrEnum
from functools import cached_property
from operator import attrgetter
from pathlib import Path
from typing import Any, Final, Literal, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Booleans, ComplexFloats, Floats, Indices, Instants, Integers, Reals
from skyproof.gnss.constants import L1_HZ
from skyproof.gnss.ephemeris import BroadcastEphemeris, Ephemeris, Klobuchar, NavigationData, UtcParameters
from skyproof.gnss.frames import ecef_from_geodetic, rot_enu_ecef
from skyproof.gnss.signals import time_scale_of
from skyproof.short_repr import ShortRepr

__all__ = [
    "BY_NAME",
    "CELL_STATUS",
    "FIX_STATUS",
    "OBSERVABLES",
    "AntennaArray",
    "ArrayPhases",
    "Asked",
    "Attitude",
    "Baseline",
    "Cause",
    "Ccaf",
    "CcafAsked",
    "CellStatus",
    "ConsistentSet",
    "Direction",
    "Ephemeris",
    "Evidence",
    "Fix",
    "FixStatus",
    "FrontEndLevels",
    "Holding",
    "ImuSeries",
    "InterferenceSign",
    "Klobuchar",
    "MeasurementSource",
    "NavState",
    "NavigationData",
    "Need",
    "NoiseRise",
    "ObservationLog",
    "Observations",
    "OpenFile",
    "ReceivedMessages",
    "ReceiverFixes",
    "Records",
    "SampleGap",
    "Samples",
    "SignalId",
    "SignalRef",
    "SpinArm",
    "StatementTest",
    "Stretched",
    "Taps",
    "TapsAsked",
    "UtcParameters",
    "WrongStatement",
    "freeze",
]

T_co = TypeVar("T_co", covariant=True)


class CellStatus(IntEnum):
    """Why a cell of `Observations` is as it is. `OK` and `SLIP` have numbers; `NO_RANGE` and `IMPOSSIBLE` all but the
    range, where they have any; the others NaN."""

    OK = 0
    NOT_TRACKED = 1
    NO_TIME = 2
    SLIP = 3
    NO_RANGE = 4
    IMPOSSIBLE = 5


class FixStatus(IntEnum):
    """Why an epoch of a `Fix` is as it is. Only `OK` has numbers; the others NaN."""

    OK = 0
    TOO_FEW = 1
    WEAK_GEOMETRY = 2
    NOT_CONVERGED = 3
    MISFIT = 4
    OFF_EARTH = 5


CELL_STATUS: dict[int, str] = {
    CellStatus.OK: "ok",
    CellStatus.NOT_TRACKED: "not tracked",
    CellStatus.NO_TIME: "no time of week decoded yet",
    CellStatus.SLIP: "cycle slip since the epoch before",
    CellStatus.NO_RANGE: "the code's phase alone is known, and no range",
    CellStatus.IMPOSSIBLE: "a range that no receiver measures",
}
"""A `CellStatus` in words."""

FIX_STATUS: dict[int, str] = {
    FixStatus.OK: "ok",
    FixStatus.TOO_FEW: "fewer than four satellites with an ephemeris",
    FixStatus.WEAK_GEOMETRY: "geometry too weak",
    FixStatus.NOT_CONVERGED: "did not converge",
    FixStatus.MISFIT: "residuals that fit no one position",
    FixStatus.OFF_EARTH: "off the Earth, by as few satellites as unknowns",
}
"""A `FixStatus` in words."""


class Need(StrEnum):
    """What a detector may need of a window. All but `TWO_RECEIVERS` are fields of `Records`."""

    OBSERVATIONS = "observations"
    TWO_RECEIVERS = "two_receivers"
    NAVIGATION = "navigation"
    SETS = "sets"
    TAPS = "taps"
    VECTOR_TAPS = "vector_taps"
    CCAF = "ccaf"
    ARRAY_PHASES = "array_phases"
    NAV_STATE = "nav_state"
    SPIN_ARMS = "spin_arms"
    OWN_FIXES = "own_fixes"


def freeze(record: Any, shapes: Mapping[str, tuple[str, ...]]) -> None:
    """Replace each named array by a read-only view after checking that shapes agree.

    Parameters
    ----------
    record : dataclass instance under construction.
    shapes : field name to symbolic shape, e.g. {"pseudorange_m": ("epoch", "channel")}; equal symbols must be equal
        sizes; a symbol that is a number is that size.

    Raises
    ------
    ValueError : a shape does not fit; the message names the record, the field, and both shapes.
    """
    sizes: dict[str, int] = {}
    for name, symbols in shapes.items():
        array = np.asarray(getattr(record, name))
        if array.ndim != len(symbols):
            raise ValueError(f"{type(record).__name__}.{name} has shape {array.shape}, expected ({', '.join(symbols)})")
        for size, symbol in zip(array.shape, symbols, strict=True):
            wanted = int(symbol) if symbol.isdigit() else sizes.setdefault(symbol, size)
            if size != wanted:
                raise ValueError(
                    f"{type(record).__name__}.{name} has shape {array.shape}, but {symbol} is {wanted} elsewhere"
                )
        view = array.view()
        view.flags.writeable = False
        object.__setattr__(record, name, view)


@dataclass(frozen=True, order=True, slots=True)
class SignalId:
    """One received signal. `copy` numbers several signals of one satellite in order of finding, nothing more."""

    sat: str  # "G05"
    band: str = "L1"
    code: str = "CA"
    copy: str = "a"

    @property
    def transmission(self) -> tuple[str, str, str]:
        """What a satellite sends once and a receiver may receive several times: satellite, band, code."""
        return self.sat, self.band, self.code

    @property
    def kind(self) -> tuple[str, str, str]:
        """What takes one way through a receiver: time scale, band, code. All signals of a kind share its delay."""
        return time_scale_of(self.sat), self.band, self.code

    def __str__(self) -> str:
        return f"{self.sat} {self.band} {self.code} {self.copy}"


BY_NAME: Final = attrgetter("sat", "band", "code", "copy")
"""Key that sorts signals as they compare, and faster."""


@dataclass(frozen=True, order=True, slots=True)
class SignalRef:
    """A signal in one receiver."""

    receiver: str
    signal: SignalId

    def __str__(self) -> str:
        return f"{self.receiver}:{self.signal}"


@dataclass(frozen=True, order=True)
class SampleGap:
    """Samples that were never recorded: `missing_samples` of them, just before the one numbered `at_sample`."""

    at_sample: int
    missing_samples: int


class OpenFile(Protocol):
    """A file that is read and stays open, so that what is said of it holds for the bytes that were read."""

    def sum_as_read(self) -> None:
        """Sum bytes as they are read from now on."""

    def sha256(self, progress: Callable[[int, int], None] | None = None) -> str | None:
        """Of the whole file, hexadecimal; None where the bytes as they were read are not known any more."""

    def changes(self) -> tuple[str, ...]:
        """Say what became of it since it was opened; a file that ends otherwise, or was written to, is `CUT`."""


class MeasurementSource(Protocol):
    """What one receiver's measurements come from: a recording of samples, or observations of a receiver.

    name : of the receiver. path : of the file, empty where there is none. start_gpst : rough. file : what was read.
    """

    @property
    def name(self) -> str: ...
    @property
    def path(self) -> str: ...
    @property
    def format(self) -> str: ...
    @property
    def remarks(self) -> tuple[str, ...]: ...
    @property
    def start_gpst(self) -> np.datetime64 | None: ...
    @property
    def duration_s(self) -> float: ...
    @property
    def file(self) -> OpenFile | None: ...


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Samples(ShortRepr):
    """An open recording: yields any stretch of samples on demand, never the whole file.

    `read(start, count)` gives float32 of shape (2, count): I and Q (Q zero for real samples), at `rate_hz`. The radio
    frequency `centre_hz` lies at `if_hz` in them, and higher frequencies lie higher. It is short at the end only.

    gaps : what the recording itself says is missing, in order; samples are numbered as recorded, so that `read` goes
        over a gap without a sign.
    file : what `read` reads from, if it is a file; several recordings may share one.
    stated_in : the file beside it that says how to read it, if there is one.
    others : of the further antennas of the same receiver, sampled at the same instants behind the same oscillator. What
        stands here of rate, frequency and length holds for them too.
    dead : why nothing comes from it, of one whose samples never change; `read` gives zeros then.
    """

    name: str
    rate_hz: float
    n_samples: int
    read: Callable[[int, int], Floats]
    centre_hz: float = 1575.42e6
    if_hz: float = 0.0
    start_gpst: np.datetime64 | None = None  # rough, by the recorder's clock
    antenna: str = "1"
    path: str = ""
    format: str = ""
    remarks: tuple[str, ...] = ()
    gaps: tuple[SampleGap, ...] = ()
    file: OpenFile | None = None
    stated_in: Path | None = None
    others: tuple["Samples", ...] = ()
    dead: str = ""

    @property
    def duration_s(self) -> float:
        return self.n_samples / self.rate_hz

    def read_all(self, start: int, count: int) -> Floats:
        """Every antenna's samples, (n_antennas, 2, count)."""
        if not self.others:
            return self.read(start, count)[None]
        return np.stack([one.read(start, count) for one in (self, *self.others)])


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class AntennaArray(ShortRepr):
    """Where the antennas of one receiver are, and what their lines do.

    elements_m : (n_antennas, 3) phase centres in the body frame (forward, right, down).
    sigma_m : of each phase centre along each axis; None if not known.
    line_bias_cyc : (n_antennas,) by which each line delays the carrier; None if not known.
    """

    elements_m: Reals
    sigma_m: float | None = None
    line_bias_cyc: Reals | None = None

    def __post_init__(self) -> None:
        lines: dict[str, tuple[str, ...]] = {} if self.line_bias_cyc is None else {"line_bias_cyc": ("antenna",)}
        freeze(self, {"elements_m": ("antenna", "3"), **lines})


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
_CELLS: Final = (*OBSERVABLES, "status", "half_cycle_open")
_EMPTY: Final = {"status": CellStatus.NOT_TRACKED, "half_cycle_open": False}
_OF_CHANNELS: Final = ("found_elapsed_s", "missed_elapsed_s", "carrier_hz")


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Observations(ShortRepr):
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
        data bits; elsewhere it is arbitrary by whole cycles only. One value at construction stands for all cells.
    found_elapsed_s : (n_channels,) when the search found the signal.
    missed_elapsed_s : (n_channels,) the last search before that which looked and did not find it; NaN if the first
        search already found it. The signal came between the two.
    carrier_hz : (n_channels,) nominal carrier; one number at construction stands for all channels.
    """

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
    carrier_hz: Reals = field(default_factory=lambda: np.array(L1_HZ))
    averaged_s: float = 0.0
    half_cycle_open: Booleans = field(default_factory=lambda: np.array(False))

    def __post_init__(self) -> None:
        carrier_hz, half_open = np.asarray(self.carrier_hz, np.float64), np.asarray(self.half_cycle_open, np.bool_)
        if carrier_hz.ndim == 0:
            object.__setattr__(self, "carrier_hz", np.full(len(self.signals), carrier_hz))
        if half_open.ndim == 0:
            object.__setattr__(self, "half_cycle_open", np.full(np.shape(self.status), half_open))
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
        """The column of each signal."""
        return {signal: column for column, signal in enumerate(self.signals)}

    @property
    def measured(self) -> Booleans:
        """(n_epochs, n_channels) where there is a pseudorange, or a signal whose range cannot be known."""
        return np.asarray(np.isfinite(self.pseudorange_m) | (self.status == CellStatus.NO_RANGE))

    @property
    def slipped(self) -> Booleans:
        """(n_epochs, n_channels) where the carrier is not that of the epoch before."""
        return np.asarray(self.status == CellStatus.SLIP)

    def series(self, name: str, channel: int, first: int = 0, stop: int | None = None) -> Reals:
        """One observable (a field's name) of one channel, of the epochs from `first` to before `stop`."""
        values: Reals = getattr(self, name)[first:stop, channel]
        return values

    def read(self, first: int, stop: int) -> "Observations":
        """The epochs from `first` to before `stop`, as views."""
        part: dict[str, Any] = {name: getattr(self, name)[first:stop] for name in ("gpst", "elapsed_s", *_CELLS)}
        return replace(self, **part)

    def rows(self, which: Booleans | Indices) -> "Observations":
        """Some of the epochs, a mask or numbers, as copies."""
        part: dict[str, Any] = {name: getattr(self, name)[which] for name in ("gpst", "elapsed_s", *_CELLS)}
        return replace(self, **part)

    @staticmethod
    def joined(pieces: Sequence["Observations"]) -> "Observations":
        """One receiver's pieces, at least one, in order of time, as one with the signals of all.

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

    What every epoch has is at hand: times, (n_epochs,), and where there are measurements, (n_epochs, n_channels).
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
        """One observable (a field of `Observations`) of one channel, of the epochs from `first` to before `stop`."""

    def read(self, first: int, stop: int) -> Observations:
        """The epochs from `first` to before `stop`, of all channels."""


class Stretched(Protocol[T_co]):
    """What a receiver has beside its measurements over a run, read in stretches: a record, or pieces on a disk."""

    @property
    def receiver(self) -> str: ...

    def between(self, begin_s: float, end_s: float) -> T_co:
        """What has begin <= `elapsed_s` < end, as one record."""


@dataclass(frozen=True, kw_only=True)
class TapsAsked:
    """Which `Taps` a detector asks a receiver for.

    delays_chips : beside early, prompt and late, ahead of prompt positive. every_s, coherent_s : means over so much of
        every so much.
    """

    delays_chips: tuple[float, ...]
    every_s: float
    coherent_s: float


@dataclass(frozen=True, kw_only=True)
class CcafAsked:
    """Which `Ccaf` a detector asks a receiver for.

    reach_chips : of delays to both sides of what is tracked, as near as the band's correlation needs. dopplers_hz : off
        the tracked carrier. coherent_s : of each interval; the message's bits are taken off. intervals : one after the
        other, taken `every_s`, and `soon_s` apart while the signals' strengths change together.
    """

    reach_chips: float
    every_s: float
    soon_s: float
    dopplers_hz: tuple[float, ...] = (0.0,)
    coherent_s: float = 0.02
    intervals: int = 4


@dataclass(frozen=True, kw_only=True)
class Asked:
    """What a detector asks receivers for beside observations."""

    taps: TapsAsked | None = None
    ccaf: CcafAsked | None = None


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Taps(ShortRepr):
    """Correlator outputs of one receiver at common receiver times, carrier and data bits wiped off.

    elapsed_s : (n_epochs,) as in `Observations`, the middle of what each value is the mean of.
    delays_chips : (n_delays,) of the replica ahead of the tracked code; dopplers_hz : (n_dopplers,) off the carrier.
    value : (n_epochs, n_channels, n_dopplers, n_delays) complex64, correlation a sample, so in the samples' own unit;
        NaN where nothing is tracked. The prompt is real but for noise.
    """

    receiver: str
    signals: tuple[SignalId, ...]
    elapsed_s: Reals
    delays_chips: Reals
    dopplers_hz: Reals
    value: ComplexFloats

    def __post_init__(self) -> None:
        freeze(
            self,
            {
                "elapsed_s": ("epoch",),
                "delays_chips": ("delay",),
                "dopplers_hz": ("doppler",),
                "value": ("epoch", "channel", "doppler", "delay"),
            },
        )

    def between(self, begin_s: float, end_s: float) -> "Taps":
        """What has begin <= `elapsed_s` < end."""
        rows = (self.elapsed_s >= begin_s) & (self.elapsed_s < end_s)
        return replace(self, elapsed_s=self.elapsed_s[rows], value=self.value[rows])


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Ccaf(ShortRepr):
    """One receiver's complex correlation over a grid of delays and Dopplers (cross ambiguity function), with its noise.

    gpst, elapsed_s : (n_epochs,) middle of each coherent interval of `coherent_s`, as in `Observations`.
    delays_chips : (n_delays,) of the replica behind the reference, positive for a longer way; dopplers_hz :
        (n_dopplers,) above the reference's. Phases are those at mid-interval.
    reference_m, reference_hz : (n_epochs, n_channels) pseudorange and Doppler of the grid's zero.
    value : (n_epochs, n_channels, n_dopplers, n_delays) complex, correlation a sample; NaN where there is none.
    noise_variance : (n_epochs, n_channels) mean square of one value's noise. Between the values at (tau1, f1) and
        (tau2, f2) the covariance is that times R(tau1 - tau2) sinc((f1 - f2) coherent_s), sinc(x) = sin(pi x) / (pi x),
        with R the code's correlation in the band of `band_hz` (two-sided).
    noise_samples : independent complex samples that each variance is estimated from; None if it is known.
    """

    receiver: str
    signals: tuple[SignalId, ...]
    gpst: Instants
    elapsed_s: Reals
    coherent_s: float
    band_hz: float
    delays_chips: Reals
    dopplers_hz: Reals
    reference_m: Reals
    reference_hz: Reals
    value: NDArray[np.complexfloating[Any, Any]]
    noise_variance: Reals
    noise_samples: int | None = None

    def __post_init__(self) -> None:
        cell = ("epoch", "channel")
        freeze(
            self,
            {
                "gpst": ("epoch",),
                "elapsed_s": ("epoch",),
                "delays_chips": ("delay",),
                "dopplers_hz": ("doppler",),
                "reference_m": cell,
                "reference_hz": cell,
                "noise_variance": cell,
                "value": ("epoch", "channel", "doppler", "delay"),
            },
        )


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ImuSeries(ShortRepr):
    """Readings of one inertial measurement unit in body axes: means over the intervals that end at `gpst`.

    gpst : (n,) end of each interval, rising; where labels are more than one and a half intervals apart, readings are
        missing.
    interval_s : length of each interval; it times a reading is the increment of velocity or angle.
    specific_force_m_s2, angular_rate_rad_s : (n, 3); the rate is relative to inertial space.
    """

    gpst: Instants
    interval_s: float
    specific_force_m_s2: Reals
    angular_rate_rad_s: Reals

    def __post_init__(self) -> None:
        freeze(self, {"gpst": ("n",), "specific_force_m_s2": ("n", "3"), "angular_rate_rad_s": ("n", "3")})


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Attitude(ShortRepr):
    """How a body is turned over time: angles from the local level and true north, see `skyproof.gnss.frames`.

    gpst : (n,) rising. A single row holds at all times.
    angles_rad : (n, 3) heading, pitch, roll. sigma_rad : one sigma about each axis, constant over the time.
    """

    gpst: Instants
    angles_rad: Reals
    sigma_rad: float

    def __post_init__(self) -> None:
        freeze(self, {"gpst": ("n",), "angles_rad": ("n", "3")})


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class NavState(ShortRepr):
    """Position, velocity and attitude of one body over time, relative to the Earth, in ECEF axes.

    gpst : (n,) rising. position_ecef_m, velocity_ecef_m_s : (n, 3).
    attitude : (n, 3, 3), `vector_ecef = attitude @ vector_body`; body axes are forward, right, down.
    covariance : (n, 9, 9) of the errors of position, velocity (ECEF axes) and attitude, m, m/s, rad; None if unknown.
        Attitude errors are the small rotation psi in ECEF axes with `attitude = (1 + [psi x]) true attitude`.
        Variances of position and velocity are infinite where these are only what the received signals say, which may
        be false: then they serve to express the attitude, and the attitude's part contains what that costs.
    """

    gpst: Instants
    position_ecef_m: Reals
    velocity_ecef_m_s: Reals
    attitude: Reals
    covariance: Reals | None = None

    def __post_init__(self) -> None:
        shapes: dict[str, tuple[str, ...]] = {
            "gpst": ("n",),
            "position_ecef_m": ("n", "3"),
            "velocity_ecef_m_s": ("n", "3"),
            "attitude": ("n", "3", "3"),
        }
        freeze(self, shapes | ({} if self.covariance is None else {"covariance": ("n", "9", "9")}))


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ArrayPhases(ShortRepr):
    """Carrier phases of every signal on every antenna of one receiver's array: epochs, channels, antennas.

    elapsed_s : (n_epochs,) as in `Observations`.
    elements_m : (n_antennas, 3) phase centres in the body frame (forward, right, down).
    phase_cyc : (n_epochs, n_channels, n_antennas) grows where an antenna is nearer to the source, by the projection of
        its position in wavelengths; what antennas share and whole cycles are arbitrary. NaN where there is nothing.
    sigma_cyc : likewise, thermal noise, one sigma.
    calibrated : constant delays of antenna lines are known, and taken off.
    elements_sigma_m : of each phase centre along each axis; None if not known.
    lasting_sigma_cyc : of each signal's phase on each antenna, what epochs share and their mean keeps.
    carrier_hz : (n_channels,) nominal carrier; one number at construction stands for all channels.
    """

    receiver: str
    signals: tuple[SignalId, ...]
    gpst: Instants
    elapsed_s: Reals
    elements_m: Reals
    phase_cyc: Reals
    sigma_cyc: Reals
    carrier_hz: Reals = field(default_factory=lambda: np.array(L1_HZ))
    calibrated: bool = True
    elements_sigma_m: float | None = None
    lasting_sigma_cyc: float = 0.0

    def __post_init__(self) -> None:
        carrier_hz = np.asarray(self.carrier_hz, np.float64)
        if carrier_hz.ndim == 0:
            object.__setattr__(self, "carrier_hz", np.full(len(self.signals), carrier_hz))
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

    def between(self, begin_s: float, end_s: float) -> "ArrayPhases":
        """What has begin <= `elapsed_s` < end."""
        rows = (self.elapsed_s >= begin_s) & (self.elapsed_s < end_s)
        return replace(
            self, **{name: getattr(self, name)[rows] for name in ("gpst", "elapsed_s", "phase_cyc", "sigma_cyc")}
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class SpinArm:
    """How the antenna of a receiver turns in a level circle: the arm's length, its rate and what is known of it.

    rate_sigma_rad_s : 0 if the rate is known exactly. Its sign, like the angle of the start, does not matter where
        signals are compared with each other.
    """

    receiver: str
    radius_m: float
    rate_rad_s: float
    rate_sigma_rad_s: float = 0.0


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class FrontEndLevels(ShortRepr):
    """Levels that the receiver measured in its front end; NaN where it gives none.

    gpst : (n,). band : (n,) text, such as "L1", "L2L5", or a receiver's own name of the chain. agc_db : (n,) gain of
    the amplifier in decibels, of arbitrary zero, falling when the input grows; agc_share : (n,) the same as a share
    of full scale, 0 to 1, where only that is known. noise_db : (n,) power of the samples, decibels of arbitrary zero.
    jamming_share : (n,) the receiver's indicator of continuous waves, 0 to 1.
    """

    gpst: Instants
    band: NDArray[np.str_]
    agc_db: Reals
    agc_share: Reals
    noise_db: Reals
    jamming_share: Reals

    def __post_init__(self) -> None:
        names = ("gpst", "band", "agc_db", "agc_share", "noise_db", "jamming_share")
        freeze(self, dict.fromkeys(names, ("row",)))

    def between(self, start_gpst: np.datetime64, end_gpst: np.datetime64) -> "FrontEndLevels":
        """Return what has start <= `gpst` < end."""
        rows = (self.gpst >= start_gpst) & (self.gpst < end_gpst)
        names = ("gpst", "band", "agc_db", "agc_share", "noise_db", "jamming_share")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ReceiverFixes(ShortRepr):
    """Positions, velocities and clocks that the receiver computed itself; NaN where it gives none.

    gpst : (n,) of the fix. position_ecef_m, velocity_ecef_m_s : (n, 3). horizontal_sigma_m, vertical_sigma_m : (n,) as
    the receiver states its accuracy, one sigma. clock_bias_s, clock_drift : (n,) receiver minus GPS time, s and s/s.
    satellites : (n,) used, -1 where not known.
    """

    gpst: Instants
    position_ecef_m: Reals
    velocity_ecef_m_s: Reals
    horizontal_sigma_m: Reals
    vertical_sigma_m: Reals
    clock_bias_s: Reals
    clock_drift: Reals
    satellites: Integers

    def __post_init__(self) -> None:
        row = dict.fromkeys(
            ("gpst", "horizontal_sigma_m", "vertical_sigma_m", "clock_bias_s", "clock_drift", "satellites"), ("fix",)
        )
        freeze(self, row | dict.fromkeys(("position_ecef_m", "velocity_ecef_m_s"), ("fix", "3")))

    @classmethod
    def from_geodetic(
        cls,
        gpst: Instants,
        lat_rad: Reals,
        lon_rad: Reals,
        height_m: Reals,
        *,
        velocity_enu_m_s: Reals | None = None,
        **given: NDArray[Any],
    ) -> "ReceiverFixes":
        """Make fixes of latitude, longitude and height above the ellipsoid; what is not given is not known.

        velocity_enu_m_s : (n, 3) to the east, the north and upwards. given : any other field.
        """
        unknown = np.full(gpst.size, np.nan)
        fields: dict[str, Any] = {
            "velocity_ecef_m_s": np.full((gpst.size, 3), np.nan),
            "horizontal_sigma_m": unknown,
            "vertical_sigma_m": unknown,
            "clock_bias_s": unknown,
            "clock_drift": unknown,
            "satellites": np.full(gpst.size, -1, np.int64),
        }
        if velocity_enu_m_s is not None:
            rotation = np.swapaxes(rot_enu_ecef(lat_rad, lon_rad), -1, -2)
            fields["velocity_ecef_m_s"] = (rotation @ velocity_enu_m_s[:, :, None])[:, :, 0]
        return cls(gpst=gpst, position_ecef_m=ecef_from_geodetic(lat_rad, lon_rad, height_m), **(fields | given))

    def between(self, start_gpst: np.datetime64, end_gpst: np.datetime64) -> "ReceiverFixes":
        """Return the fixes with start <= `gpst` < end."""
        rows = (self.gpst >= start_gpst) & (self.gpst < end_gpst)
        return replace(self, **{column.name: getattr(self, column.name)[rows] for column in fields(self)})


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ReceivedMessages(ShortRepr):
    """Broadcast messages of one receiver's signals, as they came.

    gpst : (n,) when each of the data sets was whole, by the receiver's clock; ephemerides : n of them, without those
    that repeat the last one of their satellite and message. mistimed_gpst : (m,) when a message said another time of
    week than the receiver's clock; mistimed_sat : m satellites that sent them.
    """

    gpst: Instants
    ephemerides: tuple[BroadcastEphemeris, ...]
    mistimed_gpst: Instants
    mistimed_sat: tuple[str, ...]

    def between(self, start_gpst: np.datetime64, end_gpst: np.datetime64) -> "ReceivedMessages":
        """Return what has start <= time < end."""
        rows = np.flatnonzero((self.gpst >= start_gpst) & (self.gpst < end_gpst))
        times = np.flatnonzero((self.mistimed_gpst >= start_gpst) & (self.mistimed_gpst < end_gpst))
        return ReceivedMessages(
            gpst=self.gpst[rows],
            ephemerides=tuple(self.ephemerides[k] for k in rows),
            mistimed_gpst=self.mistimed_gpst[times],
            mistimed_sat=tuple(self.mistimed_sat[k] for k in times),
        )


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Fix(ShortRepr):
    """Position, velocity and clock of one receiver from one set of signals, epoch by epoch.

    gpst : (n_epochs,) true time of reception (the clock bias is taken off), to the nanosecond.
    clock_bias_s : what the receiver's clock shows minus what the signals' time says.
    covariance_m2 : (n_epochs, 4, 4) of ECEF position and c times clock bias.
    residual_m : (n_epochs, n_signals) measured minus modelled pseudorange, NaN where not used.
    status : (n_epochs,) uint8, see FixStatus; NaN in the numbers unless 0.
    inter_system_s : time scale ("G", "E", "C", "R") to (n_epochs,), the clock bias by its signals minus
        `clock_bias_s`; NaN where it has none. Zero for the scale that the clock bias refers to: the first of G, E, C, R
        that is there. Empty from sources that do not state it.
    protection_m : (n_epochs, 2) horizontal and vertical protection level, see `navigation.protection`; NaN where none
        is promised. By default none is at any epoch.
    """

    receiver: str
    signals: tuple[SignalId, ...]
    gpst: Instants
    position_ecef_m: Reals
    velocity_ecef_m_s: Reals
    clock_bias_s: Reals
    clock_drift: Reals
    covariance_m2: Reals
    residual_m: Reals
    status: NDArray[np.uint8]
    inter_system_s: Mapping[str, Reals] = field(default_factory=dict)
    protection_m: Reals = field(default_factory=lambda: np.full(2, np.nan))

    def __post_init__(self) -> None:
        if self.protection_m.ndim == 1:  # the same at every epoch
            object.__setattr__(self, "protection_m", np.broadcast_to(self.protection_m, (len(self.gpst), 2)))
        freeze(
            self,
            {
                "gpst": ("epoch",),
                "position_ecef_m": ("epoch", "3"),
                "velocity_ecef_m_s": ("epoch", "3"),
                "clock_bias_s": ("epoch",),
                "clock_drift": ("epoch",),
                "covariance_m2": ("epoch", "4", "4"),
                "residual_m": ("epoch", "signal"),
                "status": ("epoch",),
                "protection_m": ("epoch", "2"),
            },
        )


@dataclass(frozen=True, eq=False, kw_only=True, repr=False, slots=True)
class ConsistentSet(ShortRepr):
    """Signals of one receiver, at most one per transmission, that together fit one position in one window, and a clock
    for each kind of signal (`SignalId.kind`).

    The set says nothing of authenticity: a meaconed sky is as consistent as the true one.
    clock_bias_s : by the kind that most of those on a first band are of; offsets_s : kind to its clock bias minus that
        one, so what time scales and the ways through the receiver differ by. Empty where one kind is all.
    statistic : the sum of squared normalised residuals, chi-square with `dof` degrees if the set is consistent.
    """

    receiver: str
    signals: tuple[SignalId, ...]
    gpst: np.datetime64  # middle of the window
    position_ecef_m: Reals  # (3,)
    clock_bias_s: float
    covariance_m2: Reals  # (4, 4)
    statistic: float
    dof: int
    p_value: float
    offsets_s: Mapping[tuple[str, str, str], float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        freeze(self, {"position_ecef_m": ("3",), "covariance_m2": ("4", "4")})

    def clock_of_s(self, kind: tuple[str, str, str]) -> float:
        """The clock bias by one kind of signal; NaN where the set has none of it."""
        if any(signal.kind == kind for signal in self.signals):
            return self.clock_bias_s + self.offsets_s.get(kind, 0.0)
        return float("nan")


@dataclass(frozen=True, eq=False, kw_only=True, repr=False, slots=True)
class OverlappingSkies(ShortRepr):
    """Skies in signals of one receiver that overlap within a chip, taken apart at one instant; one is true at most.

    sets : what each shows; their `signals` are the channels that it was found in. doubt : bound of the probability that
    these are not the skies, under the model of the signals. reflected : of each set, bound of the probability that its
    signals or the others' are as they are, if one sky made all by reflections and this set is taken for the true one.
    """

    sets: tuple[ConsistentSet, ...]
    doubt: float
    reflected: tuple[float, ...]


@dataclass(frozen=True, eq=False, kw_only=True, repr=False, slots=True)
class Baseline(ShortRepr):
    """Where these receivers' antennas stand relative to the first one, by what their signals show over a stretch.

    enu_m : (R - 1, 3) east, north, up, metres; covariance_m2 : (3 (R - 1), 3 (R - 1)), thermal noise and multipath.
    """

    receivers: tuple[str, ...]
    start_gpst: np.datetime64
    end_gpst: np.datetime64
    enu_m: Reals
    covariance_m2: Reals

    def __post_init__(self) -> None:
        freeze(self, {"enu_m": ("other", "3"), "covariance_m2": ("axis", "axis")})

    @property
    def distances_m(self) -> tuple[tuple[float, float], ...]:
        """Distance of each receiver's antenna from the first one, and its sigma, metres."""
        away = [float(np.linalg.norm(enu_m)) for enu_m in self.enu_m]
        blocks = [self.covariance_m2[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] for k in range(len(self.enu_m))]
        units = self.enu_m / np.maximum(away, 1e-9)[:, None]
        return tuple((d, float(np.sqrt(u @ c @ u))) for d, u, c in zip(away, units, blocks, strict=True))


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Direction(ShortRepr):
    """Where a signal comes from, as seen from the antenna, radians.

    azimuth_rad : from north by east, or in the body frame from forward to the right. elevation_rad : above the horizon,
        or above the body's plane of forward and right.
    covariance_rad2 : (2, 2) of the angles between the estimate and the truth, along the horizon to where the azimuth
        grows, and upwards.
    """

    azimuth_rad: float
    elevation_rad: float
    covariance_rad2: Reals
    frame: Literal["enu", "body"]

    def __post_init__(self) -> None:
        freeze(self, {"covariance_rad2": ("2", "2")})

    @property
    def sigma_rad(self) -> float:
        """One sigma of each of the two angles, root mean square."""
        return float(np.sqrt(0.5 * np.trace(self.covariance_rad2)))


Says = Literal["authentic", "spoofed", "attack", "clean", "multipath", "undecided"]
"""What a piece of evidence says of its subject.

authentic : the subject's signals come from the sky (positive evidence).
spoofed : the subject's signals are imitations.
multipath : the subject's signals are late copies of others, by a reflector or a repeater; they show no other place.
attack : some of the subject's signals are imitations; not which.
clean : no sign of an attack; no evidence of authenticity either.
undecided : the test could not tell, or could not run; `because` says why and what would help.
"""

Cause = Literal[
    "reflections",
    "interference",
    "gain",
    "shade",
    "oscillator",
    "motion",
    "fault",
    "orbits",
    "statement",
    "missing_samples",
]
"""What else than an attack may make a test fail: `fault` of one satellite or of the receiver, wrong `orbits` or clocks,
a `statement` of the user that is not true, samples that are missing or a recording that was cut and joined."""
InterferenceSign = Literal["cn0", "lost", "level"]
"""What interference shows by: C/N0 that falls, signals that are lost, the level of the front end that rises."""
Null = Literal["sky", "one antenna"]
"""What a test may reject: that the signals are the sky's, or that they come from one transmit antenna."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False, slots=True)
class NoiseRise(ShortRepr):
    """Interference on one carrier of a receiver: C/N0 of all its signals falls alike.

    carrier : by GPS's name where systems share one, "L1". from_gpst, to_gpst : first and last epoch that show it.
    fall_db, sigma_db : of C/N0, and its one sigma; a lower bound where most signals are lost. level_db : by which the
    front end takes in more power; None where that is not known. lost : signals that are lost. may_be_shade : nothing
    tells it from shade of the whole antenna.
    """

    receiver: str
    carrier: str
    from_gpst: np.datetime64
    to_gpst: np.datetime64
    fall_db: float
    sigma_db: float
    level_db: float | None
    lost: int
    signs: tuple[InterferenceSign, ...]
    may_be_shade: bool


@dataclass(frozen=True, eq=False, kw_only=True, repr=False, slots=True)
class StatementTest(ShortRepr):
    """What signals say of a statement of the user: key, of which receivers, and whether they agree with it.

    one_place : carriers put the receivers' antennas into one place, to millimetres and not by chance. shown : what the
        signals show instead, over the window. p_value : of the statement, where the signals do not decide.
    fitting : codes of slips that carriers fit, none if they fit the statement, None if they do not tell.
    """

    key: str
    receivers: tuple[str, ...]
    agrees: bool
    one_place: bool = False
    shown: Baseline | None = None
    p_value: float | None = None
    fitting: tuple[str, ...] | None = None


@dataclass(frozen=True, kw_only=True)
class WrongStatement:
    """How a statement of the user may be untrue: code, what it is about, words, and what would be right."""

    code: str
    about: str
    words: str
    value: str | None = None

    @property
    def sentence(self) -> str:
        """Say what may be wrong, and what would be right."""
        return f"{self.about} may be wrong: {self.words}" + (f" ({self.value} would fit)" if self.value else "")


@dataclass(frozen=True, eq=False, kw_only=True, repr=False, slots=True)
class Evidence(ShortRepr):
    """One test's outcome on one window: the statistic, its threshold and what it says, with the error rate asked for.

    p_value : probability of a statistic at least as extreme under the hypothesis that `says` rejects
        ("authentic" rejects "from one antenna"; "spoofed" and "attack" reject "clean sky"), or, where it says
        "undecided", that `null` names.
    log_likelihood_ratio : of what it says over its opposite, natural logarithm; None where no model is stated.
    noted : it stands beside the verdict, whatever that is.
    code : of what could not be tested, the reason's short name, which `because` puts in words. lacking : what the test
        needs and did not get.
    directions : where the subject's signals come from, if that is one place and the test can tell it: all that fit, the
        likeliest first.
    assumes : under what the word holds that the measurements cannot show, in words; each stands beside the verdict.
    baselines : what the subject's signals say of the antennas, over the whole window first and then over parts of it.
    whole_sky : of "spoofed": the subject is one sky of two that cannot both be true; from how many antennas it came is
        not known.
    overrules : of a test that failed ("undecided", and p_value below false_alarm_probability): its subject stays open
        whatever other tests say of this window, and the verdict with it.
    overlapping : skies in signals that were taken apart, instant by instant.
    may_also_be : of a test that failed, what else than an attack would explain it, the likeliest first.
    dated_gpst : of a test that failed, the epoch from which on it does, where the test dates that.
    interference : that the window shows, a carrier each; None of a test that does not look for it.
    statement : of the user, that it rests on or contradicts. wrong_statements : that would explain what it found, the
        likeliest first.
    """

    detector: str
    start_gpst: np.datetime64
    end_gpst: np.datetime64
    subject: tuple[SignalRef, ...]
    says: Says
    because: str
    statistic: float | None = None
    threshold: float | None = None
    false_alarm_probability: float | None = None
    p_value: float | None = None
    log_likelihood_ratio: float | None = None
    would_need: str | None = None
    group: int | None = None  # evidence of one group decision shares a number within its window
    overrules: bool = False
    noted: bool = False
    code: str = ""
    lacking: tuple[Need, ...] = ()
    directions: tuple[Direction, ...] = ()
    assumes: tuple[str, ...] = ()
    baselines: tuple[Baseline, ...] = ()
    whole_sky: bool = False
    overlapping: tuple[OverlappingSkies, ...] = ()
    null: Null = "sky"
    may_also_be: tuple[Cause, ...] = ()
    dated_gpst: np.datetime64 | None = None
    interference: tuple[NoiseRise, ...] | None = None
    statement: StatementTest | None = None
    wrong_statements: tuple[WrongStatement, ...] = ()

    @property
    def failed(self) -> bool:
        """Whether a test rejected that the signals are the sky's, and it is open why."""
        asked = self.false_alarm_probability
        rejected = self.p_value is not None and asked is not None and self.p_value < asked
        return rejected and self.says == "undecided" and self.null == "sky"


class Holding:
    """What says which needs it meets: fields are named as they are."""

    observations: tuple[Any, ...]

    def has(self, need: Need) -> bool:
        """Whether what a detector needs is there."""
        if need is Need.TWO_RECEIVERS:
            return len({o.receiver for o in self.observations}) >= 2
        value = getattr(self, need)
        return value is not None and value != () and value != {}


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Records(ShortRepr, Holding):
    """All that is known of one window, for detectors to look at. A detector declares which of these it needs.

    sets : of each receiver, what was found in `observations`. taps, array_phases : of the receivers that have them.
    vector_taps : of receivers whose channels all follow one position. ccaf : correlation grids.
    nav_state : of the body that carries all antennas, by receiver, with the place of its antenna. spin_arms : of the
        receivers whose antenna turns. levels : of the front ends, own_fixes : that the receivers computed themselves,
        both by receiver.
    """

    start_gpst: np.datetime64
    end_gpst: np.datetime64
    observations: tuple[Observations, ...] = ()
    navigation: NavigationData | None = None
    sets: tuple[ConsistentSet, ...] = ()
    taps: tuple[Taps, ...] = ()
    vector_taps: tuple[Taps, ...] = ()
    ccaf: tuple[Ccaf, ...] = ()
    array_phases: tuple[ArrayPhases, ...] = ()
    nav_state: Mapping[str, NavState] = field(default_factory=dict)
    spin_arms: tuple[SpinArm, ...] = ()
    levels: Mapping[str, FrontEndLevels] = field(default_factory=dict)
    messages: Mapping[str, ReceivedMessages] = field(default_factory=dict)
    own_fixes: Mapping[str, ReceiverFixes] = field(default_factory=dict)
