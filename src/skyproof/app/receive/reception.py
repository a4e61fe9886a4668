"""What one receiver received: its recording after tracking, or its own measurements."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skyproof.app.receive.assembled import Assembled
from skyproof.app.receive.diagnosis import Diagnosis, diagnose, remark_on_dopplers, remark_on_gaps
from skyproof.app.receive.policy import POLICY
from skyproof.app.receive.time_tag import (
    compute_clock_biases_s,
    estimate_time_tag,
    find_week,
    move_near_date,
    position_all_epochs,
    time_short_arcs,
)
from skyproof.app.receive.tracker import Tracker, carrier_at_hz
from skyproof.arrays import Reals
from skyproof.errors import InputError, NotEnoughData
from skyproof.formats.pieces import Workspace
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.time import seconds_between
from skyproof.receiver.observables import collect_navigation, list_differing_messages
from skyproof.receiver.snapshot import CodePhase
from skyproof.records import (
    AntennaArray,
    ArrayPhases,
    Ccaf,
    MeasurementSource,
    NavigationData,
    ObservationLog,
    Samples,
    SnapshotChanges,
    Taps,
    TimeSliced,
)
from skyproof.remarks import Remark, RemarkKind
from skyproof.short_repr import ShortRepr

__all__ = ["Reception", "explain_nothing_found", "observe", "overlap_s", "require_signals"]


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Reception(ShortRepr):
    """What one receiver received: its recording after tracking, or its own measurements.

    observations : None if there are none; `left_out` then says why. remarks : beside that and those of the source.
    examined_s : how much of the recording was processed.
    same_as : the receiver whose noise it holds too, where the two are taken as one; its observations are then left out.
    apart_from : the receivers whose noise has nothing in common with its own, so that they have other antennas.
    messages_differ : where signals of one satellite carry different messages, in words; among the remarks as well.
    taps, ccaf : correlators beside the observations, if they were asked for. vector_taps : of vector tracking.
    antennas : the same signals at the same epochs on each antenna, where the receiver has several.
    measured_on : number, from 0, of the antenna whose measurements `observations` are: the first, or if that has
        clearly fewer the one that has most. In a snapshot all antennas share them, and it is the first of these.
    array_phases : the carrier's phases on all of them, if it is known where they are.
    changes : of signals within a snapshot; None of what is none. codes : the code phase of each signal of a snapshot.
    """

    source: MeasurementSource
    observations: ObservationLog | None
    decoded: NavigationData  # from the signals themselves
    n_signals: int
    examined_s: float
    left_out: str | None = None
    same_as: str | None = None
    apart_from: frozenset[str] = frozenset()
    remarks: tuple[str, ...] = ()
    messages_differ: tuple[str, ...] = ()
    taps: TimeSliced[Taps] | None = None
    vector_taps: TimeSliced[Taps] | None = None
    ccaf: TimeSliced[Ccaf] | None = None
    antennas: tuple[ObservationLog, ...] = ()
    measured_on: int = 0
    array_phases: TimeSliced[ArrayPhases] | None = None
    changes: SnapshotChanges | None = None
    codes: tuple[CodePhase, ...] = ()

    @property
    def noted(self) -> tuple[str, ...]:
        """Return the remarks, and why there are no observations."""
        why = () if self.left_out is None else (Remark(f"left out: {self.left_out}", RemarkKind.BEARS),)
        return (*self.remarks, *why)

    @property
    def samples(self) -> Samples | None:
        """Return the recording, where the source is one."""
        return self.source if isinstance(self.source, Samples) else None

    @property
    def measured_samples(self) -> Samples | None:
        """Return the samples that `observations` are measured in, where the source is a recording."""
        samples = self.samples
        return samples if samples is None else (samples, *samples.others)[self.measured_on]


def observe(
    tracker: Tracker,
    navigation: NavigationData | None,
    array: AntennaArray | None = None,
    workspace: Workspace | None = None,
    *,
    diagnose: bool = True,
) -> Reception:
    """Build time, observations and navigation data of one tracked recording.

    array : where its antennas are, if it has several and that is known.
    workspace : where the observations of a long recording are kept; a temporary folder if None.
    diagnose : look for the reason where little was received, which takes seconds.

    The week comes from the recording's date, else from the navigation file, else from the message (which knows it
    modulo 1024, resolved by nothing better than the calendar's present era).
    """
    samples = tracker.samples
    received = {arc.signal for arc in tracker.arcs.values()}
    remarks: list[str] = [*tracker.remarks, *(() if tracker.vector is None else tracker.vector.remarks)]
    week = find_week(tracker, navigation, remarks)
    label = estimate_time_tag(tracker, week)
    if label is not None:
        label = move_near_date(label, samples, tracker.arcs, remarks)
        week = label.week
    decoded = collect_navigation(tracker.arcs, week, samples.path or samples.name)
    orbits = navigation if navigation is not None else decoded
    antennas: tuple[ObservationLog, ...] = ()
    best = 0
    observations = phases = taps = vector_taps = ccaf = None
    if label is not None:
        best = _choose_antenna(tracker.measured.counts(tracker.arcs))
        assembled = Assembled(tracker, tracker.arcs, label)
        positions = position_all_epochs(assembled.stretches(best), orbits)
        arcs = time_short_arcs(tracker, positions, orbits, label, remarks)
        if arcs is not None:
            assembled = Assembled(tracker, arcs, label)
            positions = position_all_epochs(assembled.stretches(best), orbits)
        biases_s = compute_clock_biases_s(positions, tracker.gaps)
        antennas = assembled.split_antennas(biases_s, workspace or Workspace())
        observations = antennas[best]
        taps, vector_taps, ccaf = assembled.taps(), assembled.vector_taps(), assembled.ccaf(observations)
        if array is not None:
            phases = assembled.array_phases(array, observations.gpst)
        remarks += _remark_on_late(antennas, best, samples.rate_hz)
        if best:
            instead = (
                f"its measurements are those on antenna {best + 1} of {len(antennas)}, for the first has fewer: check "
                "that antenna and its line"
            )
            remarks.append(Remark(instead, RemarkKind.BEARS))
    found = _diagnose(tracker) if diagnose and (observations is None or _is_doubtful(tracker)) else None
    if found is None or not found.mirrored:  # signals of a mirrored spectrum are lost all the time: gaps say nothing
        remarks += remark_on_gaps(tracker.gaps, tracker.receiver.signal.period_s)
        remarks += remark_on_dopplers(_average_dopplers_hz(tracker))
    differ = tuple(list_differing_messages(tracker.arcs))
    remarks += differ
    left_out = None
    if observations is None:
        left_out = _explain_no_time(tracker, len(received)) if received else _explain_nothing_received(tracker, found)
        left_out += "" if found is None else f"; {found.cure}"
    elif found is not None and found.is_misread:
        remarks.append(Remark(f"few signals as it was read, or none for long: {found.cure}", RemarkKind.BEARS))
    return Reception(
        source=samples,
        observations=observations,
        decoded=decoded,
        n_signals=len(received),
        examined_s=tracker.examined_s,
        left_out=left_out,
        remarks=tuple(remarks),
        messages_differ=differ,
        taps=taps,
        vector_taps=vector_taps,
        ccaf=ccaf,
        antennas=antennas if len(antennas) > 1 else (),
        measured_on=best,
        array_phases=phases,
    )


def _choose_antenna(counts: Sequence[int]) -> int:
    """Choose the antenna whose measurements stand for the receiver.

    It is the first, if that has nearly as many measurements as any other.

    counts : number of measurements of each antenna.
    """
    return 0 if counts[0] >= POLICY.nearly_all_share * max(counts) else int(np.argmax(counts))


def _remark_on_late(antennas: Sequence[ObservationLog], best: int, rate_hz: float) -> list[str]:
    """Report antennas that begin later or earlier than the one whose measurements are used.

    Their signals are others, and their ranges differ by the same for all satellites.
    """
    remarks: list[str] = []
    for number, antenna in enumerate(antennas):
        apart_m = _compare_ranges_m(antennas[best], antenna)
        if number == best or len(apart_m) < POLICY.fix_satellites:
            continue
        middle_m = float(np.median(apart_m))
        late_s = -middle_m / SPEED_OF_LIGHT_M_S
        late_m = POLICY.late_chips * antenna.signals[0].plan.chip_m
        if abs(middle_m) > late_m and np.median(np.abs(apart_m - middle_m)) < late_m:
            whose = f"antenna {number + 1}" if late_s < 0.0 else "the others"
            late = (
                f"antenna {number + 1} begins {abs(late_s) * 1e3:.4g} ms {'after' if late_s > 0.0 else 'before'} "
                f"antenna {best + 1}, by the ranges of {len(apart_m)} satellites, and its phases are not used: record "
                f"all antennas together, or leave out the first {round(abs(late_s) * rate_hz)} samples of {whose}"
            )
            remarks.append(Remark(late, RemarkKind.BEARS))
    return remarks


def _compare_ranges_m(a: ObservationLog, b: ObservationLog) -> Reals:
    """Compare ranges of b with those of a by satellite, of signals that only one of them has."""
    apart = []
    only = a.measured.any(axis=0), b.measured.any(axis=0)
    for column in np.flatnonzero(only[0] & ~only[1]).tolist():
        for other in np.flatnonzero(only[1] & ~only[0]).tolist():
            if a.signals[column].sat == b.signals[other].sat:
                longer = b.series("pseudorange_m", other) - a.series("pseudorange_m", column)
                if np.isfinite(longer).any():
                    apart.append(float(np.nanmedian(longer)))
    return np.array(apart)


def require_signals(trackers: Sequence[Tracker]) -> None:
    """Raise NotEnoughData if no recording holds a signal, or InputError if that is because none could be read.

    One that holds none beside others that do is left out.
    """
    if trackers and not any(tracker.arcs for tracker in trackers):
        broken = [tracker.broken for tracker in trackers if tracker.broken]
        if broken:
            raise InputError("; ".join(broken))
        paths = ", ".join(t.samples.path or t.samples.name for t in trackers)
        first = trackers[0]
        found = diagnose(first.samples, first.receiver.settings.doppler_max_hz, first.get_inspection)
        raise NotEnoughData(f"{paths}: {_explain_nothing_received(first, found)}; {found.cure}")


def _is_doubtful(tracker: Tracker) -> bool:
    """Test whether the recording may not have been read correctly."""
    n_sats = len({arc.signal.sat for arc in tracker.arcs.values()})
    return n_sats < POLICY.fix_satellites or len(tracker.arcs) > POLICY.many_arcs * n_sats


def _diagnose(tracker: Tracker) -> Diagnosis | None:
    """Diagnose a recording; None if it was left before its end, for an interrupting user does not wait."""
    if not tracker.ended:
        return None
    return diagnose(tracker.samples, tracker.receiver.settings.doppler_max_hz, tracker.get_inspection)


def _average_dopplers_hz(tracker: Tracker) -> list[float]:
    """Average the Dopplers of each satellite's signals."""
    values: dict[str, list[float]] = {}
    for number, doppler_hz in tracker.measured.mean_doppler_hz().items():
        values.setdefault(tracker.arcs[number].signal.sat, []).append(doppler_hz)
    return [float(np.nanmean(of_sat)) for of_sat in values.values()]


def _explain_nothing_received(tracker: Tracker, found: Diagnosis | None) -> str:
    """Describe what to check if no satellite was tracked, in the order of likelihood."""
    samples = tracker.samples
    if found is not None and found.n_sats and samples.duration_s < POLICY.followed_s:
        return (
            f"it holds {found.n_sats} satellites, read by its description, but lasts {samples.duration_s:.3g} s, "
            f"and signals have to be followed for seconds: give {POLICY.time_of_week_s:g} s or more"
            f"{_suggest_snapshot(samples)}"
        )
    return explain_nothing_found(samples, tracker.examined_s)


def explain_nothing_found(samples: Samples, examined_s: float) -> str:
    """Describe what to check in a recording without satellites, in the order of likelihood."""
    length = f"{examined_s:.1f}" if examined_s >= 1.0 else f"{examined_s:.3g}"
    return (
        f"no GPS L1 C/A signal found in {length} s; it was read as {samples.format}, "
        f"{samples.rate_hz:g} samples/s, carrier at {carrier_at_hz(samples):g} Hz: "
        "check rate_hz, if_hz, kind, encoding, bits and bit_order in its sidecar, that the antenna was connected, and "
        "whether the oscillator may be off by more than the search reaches (doppler_max_hz)"
    )


def _explain_no_time(tracker: Tracker, n_signals: int) -> str:
    """Explain why signals without a time of week are useless, and what would give it."""
    cure = (
        f"give {POLICY.time_of_week_s:g} s of signal or more"
        if tracker.examined_s < POLICY.time_of_week_s
        else "the signals are too weak or too often interrupted to read their messages"
    )
    cure += _suggest_snapshot(tracker.samples)
    return f"{n_signals} signals found, but no time of week read from them in {tracker.examined_s:.1f} s: {cure}"


def _suggest_snapshot(samples: Samples) -> str:
    """Describe what of an array's recording can be judged without tracking signals."""
    if not samples.others:
        return ""
    return (
        "; or have part of it judged by its directions alone, which takes no time of week: "
        f"duration_s = {POLICY.advised_snapshot_s:g}"
    )


def overlap_s(a: ObservationLog, b: ObservationLog) -> float:
    """Return the common time of two receivers, seconds; negative if one was recorded after the other."""
    return float(seconds_between(min(a.gpst[-1], b.gpst[-1]), max(a.gpst[0], b.gpst[0])))
