"""Observation files as inputs: what one receiver measured itself, read instead of tracked."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from skyproof.app.receive.policy import POLICY
from skyproof.app.receive.reception import Reception
from skyproof.arrays import Instants
from skyproof.errors import InputError
from skyproof.formats.bounds import limit_remarks
from skyproof.formats.byte_io import FileBytes, measure_size
from skyproof.formats.pieces import Workspace
from skyproof.formats.plausible import describe_impossible
from skyproof.formats.rinex_obs_pieces import PIECE_BYTES, continue_pieces, read_obs_pieces
from skyproof.formats.rinex_obs_read import ObservationFile
from skyproof.formats.spool import NothingGathered, gather
from skyproof.gnss.time import format_iso, leap_seconds, seconds_between, timedelta_from_s
from skyproof.logs.content import InertialRows, ReceiverStates
from skyproof.navigation.clock import ClockSteps, find_clock_steps, remove_clock_steps
from skyproof.navigation.code_noise import compare_code_noise, estimate_noise_factors, raise_code_sigmas
from skyproof.navigation.rates import RIM_EPOCHS, fill_dopplers
from skyproof.navigation.slips import mark_slips
from skyproof.navigation.time_tags import TagErrors, estimate_tag_errors
from skyproof.navigation.window import median_interval_s
from skyproof.records import (
    FrontEndLevels,
    Kind,
    NavigationData,
    ObservationLog,
    Observations,
    ReceivedMessages,
    ReceiverFixes,
    SignalId,
)
from skyproof.remarks import Remark, RemarkKind

__all__ = ["ObservedFile", "OwnWords", "gather_file", "has_same_measurements", "observe_file", "open_observations"]

NO_SAMPLES = (
    "holds measurements and no samples: no correlation is drawn, second signals of a satellite and the receiver's own "
    "noise cannot be looked for"
)
MOST_TIMES_TOLD = 3
STRETCH_EPOCHS = 1024
SYSTEMS = "GECRJ"


@dataclass(frozen=True, eq=False, kw_only=True)
class OwnWords:
    """What a receiver says of itself in its log; None where the log holds none of it."""

    fixes: ReceiverFixes | None = None
    levels: FrontEndLevels | None = None
    states: ReceiverStates | None = None
    messages: ReceivedMessages | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class ObservedFile:
    """One receiver's observation file or log, open: a `Source` that gives observations.

    observations : as they stand in the file, of the stretch that was asked for.
    ranged : it holds pseudoranges. decoded : orbits from broadcast messages in the file.
    own : what the receiver says of itself there.
    inertial : readings of an inertial unit that stand in the same log.
    multipath_sigma_m : of a pseudorange with the antenna of such a receiver, where that is known.
    """

    name: str
    path: str
    format: str
    observations: ObservationLog
    file: FileBytes
    remarks: tuple[str, ...] = ()
    ranged: bool = True
    decoded: NavigationData = field(default_factory=lambda: NavigationData(ephemerides=()))
    own: OwnWords = field(default_factory=OwnWords)
    inertial: InertialRows | None = None
    multipath_sigma_m: float | None = None

    @property
    def start_gpst(self) -> np.datetime64:
        """Return the first epoch."""
        start: np.datetime64 = self.observations.gpst[0]
        return start

    @property
    def duration_s(self) -> float:
        """Return the time from the first epoch to the last."""
        return float(seconds_between(self.observations.gpst[-1], self.observations.gpst[0]))


def open_observations(
    path: Path,
    glonass_channels: Mapping[str, int] | None = None,
    *,
    start_s: float = 0.0,
    duration_s: float | None = None,
    workspace: Workspace | None = None,
) -> ObservedFile:
    """Read an observation file.

    start_s, duration_s : of the stretch that is wanted; all of it if none is given.
    workspace : where those of a long file are kept.

    Raises
    ------
    InputError : it cannot be read, is no RINEX observation file, or holds nothing that is judged in that stretch.
    """
    file = FileBytes(path)
    file.sum_as_read()
    blocks = (file[at : at + PIECE_BYTES].tobytes() for at in range(0, measure_size(path), PIECE_BYTES))
    pieces = read_obs_pieces(blocks, source=str(path), keep=_is_judged, glonass_channels=glonass_channels)
    to_do = (
        "the observation file holds no measurement of a satellite of GPS, Galileo, BeiDou, GLONASS or QZSS; give the "
        "file that the receiver wrote"
    )
    return gather_file(path, file, pieces, lambda: to_do, start_s=start_s, duration_s=duration_s, workspace=workspace)


def gather_file(
    path: Path,
    file: FileBytes,
    pieces: Iterable[ObservationFile],
    without_any: Callable[[], str],
    *,
    start_s: float,
    duration_s: float | None,
    workspace: Workspace | None,
) -> ObservedFile:
    """Gather the pieces of a file that is being read.

    `without_any` says what to do if nothing was measured.

    Raises InputError if nothing is judged in the stretch.
    """
    noted = _Noted()
    plain = path.with_suffix("") if path.suffix.lower() == ".gz" else path
    stretch = _cut_stretch(continue_pieces(noted.all(pieces)), start_s, duration_s)
    try:
        observations = gather(stretch, plain.stem, workspace or Workspace(), "as-given")
    except NothingGathered:
        if not noted.epochs:
            raise InputError(f"{path}: {without_any()}") from None
        raise InputError(
            f"{path}: lasts {noted.duration_s:.3f} s, but start_s is {start_s:g}"
            + ("" if duration_s is None else f" and duration_s {duration_s:g}")
            + ", in which no epoch lies; give less or more"
        ) from None
    whole = duration_s is not None and noted.duration_s >= start_s + duration_s
    remarks = Remark.without_cut(noted.remarks) if whole else noted.remarks
    return ObservedFile(
        name=observations.receiver,
        path=str(path),
        format=f"RINEX {noted.version:g} observations",
        observations=observations,
        file=file,
        remarks=(*remarks, NO_SAMPLES),
        ranged=noted.ranged,
    )


class _Noted:
    """What is kept of a file beside its measurements, as its pieces pass."""

    def __init__(self) -> None:
        self.version, self.epochs, self.ranged = 0.0, 0, False
        self._first = self._last = np.datetime64("NaT", "ns")
        self._remarks: dict[str, str] = {}
        self._impossible: Counter[str] = Counter()
        self._misread: dict[str, str] = {}

    def all(self, pieces: Iterable[ObservationFile]) -> Iterator[Observations]:
        """Yield the observations of the pieces, and note the rest."""
        for piece in pieces:
            self.version = self.version or piece.version
            self._remarks |= {remark: remark for remark in piece.remarks}
            self._impossible.update(piece.impossible)
            self._misread |= piece.misread
            o = piece.observations
            if not o.gpst.size:
                continue
            self._first, self._last = (o.gpst[0] if not self.epochs else self._first), o.gpst[-1]
            self.epochs += o.gpst.size
            self.ranged |= bool(np.isfinite(o.pseudorange_m).any())
            yield o

    @property
    def duration_s(self) -> float:
        return float(seconds_between(self._last, self._first))

    @property
    def remarks(self) -> tuple[str, ...]:
        """Return each remark once, up to a limit."""
        impossible = describe_impossible(self._impossible, self._misread)
        return limit_remarks((*impossible, *self._remarks.values()), "further remarks")


def _is_judged(signal: SignalId) -> bool:
    """Test whether orbits of the signal's system are read. Those of GPS, Galileo, BeiDou, GLONASS and QZSS are."""
    return signal.sat[0] in SYSTEMS


def _cut_stretch(pieces: Iterable[Observations], start_s: float, duration_s: float | None) -> Iterator[Observations]:
    """Cut what lies from `start_s` on, `duration_s` long at most. Elapsed time counts from its first epoch."""
    begun_s: float | None = None
    for piece in pieces:
        rows = piece.elapsed_s >= start_s
        if duration_s is not None:
            rows &= piece.elapsed_s < start_s + duration_s
        if not rows.any():
            continue
        kept = piece.select(rows)
        begun_s = float(kept.elapsed_s[0]) if begun_s is None else begun_s
        missed_s = kept.missed_elapsed_s - begun_s
        yield replace(
            kept,
            elapsed_s=kept.elapsed_s - begun_s,
            found_elapsed_s=np.maximum(kept.found_elapsed_s - begun_s, 0.0),
            missed_elapsed_s=np.where(missed_s >= 0.0, missed_s, np.nan),
        )


def has_same_measurements(a: ObservedFile, b: ObservedFile) -> bool:
    """Test whether two files hold the same pseudoranges at common epochs.

    Noise never repeats itself to the millimetre.
    """
    log, other = a.observations, b.observations
    common = [s for s in log.signals if s in other.signals]
    alike = compared = 0
    for first in range(0, log.gpst.size, STRETCH_EPOCHS):
        ours = log.read(first, first + STRETCH_EPOCHS)
        begin = int(np.searchsorted(other.gpst, ours.gpst[0]))
        theirs = other.read(begin, int(np.searchsorted(other.gpst, ours.gpst[-1], side="right")))
        _, rows, columns = np.intersect1d(ours.gpst, theirs.gpst, return_indices=True)
        x = ours.pseudorange_m[rows][:, [ours.signals.index(s) for s in common]]
        y = theirs.pseudorange_m[columns][:, [theirs.signals.index(s) for s in common]]
        finite = np.isfinite(x) & np.isfinite(y)
        compared += int(finite.sum())
        alike += int(np.sum(x[finite] == y[finite]))
    return alike > 0.5 * compared


def observe_file(
    source: ObservedFile, workspace: Workspace | None = None, navigation: NavigationData | None = None
) -> Reception:
    """Prepare a receiver's measurements for comparison.

    Its clock runs without steps, its labels agree with the ranges by the orbits, and missing Dopplers come from the
    carriers.

    navigation : the orbits; those of the file's own messages if absent.
    """
    orbits = source.decoded if navigation is None else navigation
    clock = _Clock.of(source.observations, find_clock_steps(source.observations), orbits)
    made = _Made()
    whole = gather(made.prepare(source.observations, clock), source.name, workspace or Workspace(), "observations")
    remarks = [*clock.remarks()]
    if made.derived:
        remarks.append(
            f"Dopplers of {made.derived / made.phases:.0%} of the cells are missing and taken from the carrier phase"
        )
    return Reception(
        source=source,
        observations=whole,
        decoded=source.decoded,
        n_signals=len(whole.signals),
        examined_s=source.duration_s,
        remarks=tuple(remarks),
    )


@dataclass(frozen=True, eq=False)
class _Clock:
    """How a log's labels differ from a clock that runs on: its steps, and what does not go with the ranges.

    noise : of codes over what is stated of it, by kind of signal, where it is larger.
    """

    gpst: Instants
    steps: ClockSteps | None
    tags: TagErrors
    noise: Mapping[Kind, float]

    @classmethod
    def of(cls, log: ObservationLog, steps: ClockSteps | None, navigation: NavigationData) -> "_Clock":
        """Estimate the clock's steps and label errors of a log, and by how much its codes are noisier than stated."""
        tags, noise = [], []
        for first in range(0, log.gpst.size, STRETCH_EPOCHS):
            part = _remove_steps(log, steps, first, first + STRETCH_EPOCHS)
            tags.append(estimate_tag_errors(part, navigation))
            noise.append(compare_code_noise(part))
        return cls(log.gpst, steps, TagErrors.join(tags), estimate_noise_factors(noise))

    def correct(self, log: ObservationLog, first: int, stop: int) -> Observations:
        """Correct epochs `first` to before `stop`, without those whose labels are off unlike most."""
        part = _remove_steps(log, self.steps, first, stop).select(~self.tags.stray[first:stop])
        if self.noise:
            part = replace(part, pseudorange_sigma_m=raise_code_sigmas(part, self.noise))
        if not self.tags.offset_s:
            return part
        return replace(part, gpst=part.gpst - timedelta_from_s(self.tags.offset_s))

    def remarks(self) -> Iterator[str]:
        """Report what was corrected."""
        if self.steps is not None and self.steps.steps:
            times = [format_iso(step.gpst, 0)[11:] for step in self.steps.steps]
            yield (
                f"the receiver's clock steps by whole milliseconds at {_first_times(times)}; it is taken as if it did "
                "not"
            )
        offset_s, stray = self.tags.offset_s, self.tags.stray
        if offset_s:
            as_utc = abs(offset_s + leap_seconds(self.gpst[0])) < POLICY.near_utc_s
            yield Remark(
                f"the times of its epochs are {abs(offset_s):.3f} s {'ahead of' if offset_s > 0.0 else 'behind'} the "
                f"time at which its ranges fit the orbits{', as UTC is behind GPS time' if as_utc else ''}; they are "
                "corrected by that",
                RemarkKind.BEARS,
            )
        if self.noise:
            worst = sorted(self.noise.items(), key=lambda each: -each[1])
            named = ", ".join(f"{' '.join(kind)} {factor:.1f} times" for kind, factor in worst[:MOST_TIMES_TOLD])
            more = f", and {len(worst) - MOST_TIMES_TOLD} more kinds" if len(worst) > MOST_TIMES_TOLD else ""
            yield f"codes are noisier than their stated or thermal noise, and count as such: {named}{more}"
        if stray.any():
            times = [format_iso(when, 1)[11:] for when in self.gpst[stray]]
            errors_s = self.tags.error_s[stray]
            yield Remark(
                f"{len(times)} epochs are left out, at {_first_times(times)}: their times are not those at which their "
                f"ranges fit the orbits, {errors_s.min():+.3f} to {errors_s.max():+.3f} s off",
                RemarkKind.BEARS,
            )


def _first_times(times: Sequence[str]) -> str:
    more = f" and {len(times) - MOST_TIMES_TOLD} more" if len(times) > MOST_TIMES_TOLD else ""
    return ", ".join(times[:MOST_TIMES_TOLD]) + more


def _remove_steps(log: ObservationLog, steps: ClockSteps | None, first: int, stop: int) -> Observations:
    part = log.read(first, stop)
    return part if steps is None else remove_clock_steps(part, steps, first)


@dataclass
class _Made:
    """How many cells have a carrier phase, and how many a Doppler that was taken from it."""

    derived: int = 0
    phases: int = 0

    def prepare(self, log: ObservationLog, clock: _Clock) -> Iterator[Observations]:
        """Yield a log in stretches, as if its clock had run on, with Dopplers."""
        kept = np.cumsum(np.append(0, ~clock.tags.stray))
        usual_s = median_interval_s(log.elapsed_s if clock.steps is None else clock.steps.elapsed_s)
        for first in range(0, log.gpst.size, STRETCH_EPOCHS):
            begin, stop = max(first - RIM_EPOCHS, 0), min(first + STRETCH_EPOCHS, log.gpst.size)
            part = clock.correct(log, begin, stop + RIM_EPOCHS)
            whole, derived = fill_dopplers(mark_slips(part), usual_s)
            kept_rows = slice(int(kept[first] - kept[begin]), int(kept[stop] - kept[begin]))
            self.derived += int(derived[kept_rows].sum())
            self.phases += int(np.isfinite(part.carrier_cyc[kept_rows]).sum())
            yield whole.read(kept_rows.start, kept_rows.stop)
