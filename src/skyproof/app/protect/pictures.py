"""What the report draws, taken from a run's outcome: positions, truth where it is known, signals, sky, correlations,
range differences between receivers, and what each detector found in words.
"""

import csv
from bisect import bisect_left
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any, Final, cast

import numpy as np

from skyproof.app.common.windows import cut
from skyproof.app.protect.methods import count_by_detector
from skyproof.app.protect.outcome import Outcome, ReceiverOutcome
from skyproof.app.protect.own_words import select_receiver_words, select_rows_with_place
from skyproof.app.protect.positions import KINDS, place_of
from skyproof.app.protect.takeover_pictures import compare_skies, decompose_correlations, list_origins
from skyproof.app.receive.tracker import carrier_at_hz
from skyproof.arrays import Reals
from skyproof.detectors.multi_receiver.common_epochs import CommonRanges, align_ranges
from skyproof.errors import InputError
from skyproof.explain import explain
from skyproof.formats.bounds import TRACK_BYTES
from skyproof.formats.byte_io import read_content
from skyproof.formats.documents import read_json
from skyproof.fusion.labels import LabelledSignal
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.frames import ecef_from_geodetic, geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.orbits import compute_satellite_state
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.gnss.sky import compute_azimuth_elevation
from skyproof.gnss.time import format_iso, seconds_between
from skyproof.recording.profile import compute_delay_profiles
from skyproof.records import ConsistentSet, ObservationLog, Observations, Records, Samples
from skyproof.report.drawing import thin
from skyproof.report.figures import Pictures
from skyproof.report.pictures import (
    DelayProfile,
    DelayTag,
    FixTrack,
    MethodWords,
    RangeDifference,
    SignalSeries,
    SkyPosition,
    TruePlace,
)
from skyproof.report.scene import STANDS_M
from skyproof.verdict import USABLE, Label

__all__ = ["build_pictures", "list_kinds"]

PROFILES: Final = 6
"""Satellites whose correlation is drawn: more would show the same again."""
PROFILE_REACH_CHIPS: Final = 60.0  # between a satellite's first and last signal; farther ones are not drawn together
PAIRS: Final = 3  # of receivers, whose range differences are drawn
SERIES_POINTS: Final = 2048  # of a signal over time: more than a page draws, and a day of all would fill the memory
COMPARED_WINDOWS: Final = 256  # from which the one to be drawn is chosen
PERIOD_NS: Final = 1_000_000


def list_kinds(r: ReceiverOutcome) -> list[str]:
    """List the kinds of a receiver's published fixes: the trusted, the false, and each open sky."""
    possible = list(r.shown) if "false" not in r.tracks and len(r.shown) > 1 else []
    return [*(kind for kind in KINDS if kind in r.tracks), *possible]


def build_pictures(outcome: Outcome) -> Pictures:
    """Build everything that the report draws beside the verdict."""
    findings = tuple(_describe_findings(outcome))
    observed = [r for r in outcome.receivers if r.reception.observations is not None]
    if not observed:
        return Pictures(zero_gpst="1980-01-06T00:00:00", findings=findings)
    zero = min(r.reception.observations.gpst[0] for r in observed if r.reception.observations is not None)
    decision = outcome.decision
    onset = decision.onset if decision.onset is not None and decision.onset.sigma_s is not None else None
    origin = _find_origin(outcome)
    return Pictures(
        zero_gpst=format_iso(zero, 3),
        origin=None if origin is None else place_of(origin),
        onset_s=None if onset is None else float(seconds_between(onset.gpst, zero)),
        onset_sigma_s=None if onset is None else onset.sigma_s,
        until_s=None if decision.until is None else float(seconds_between(decision.until, zero)),
        series=tuple(s for r in observed for s in _series(r.reception.observations, outcome, zero)),
        tracks=() if origin is None else tuple(t for r in observed for t in _tracks(r, origin)),
        truth=() if origin is None else tuple(_read_truth(observed, origin)),
        sky=tuple(p for r in observed for p in _sky(r, outcome)),
        profiles=tuple(_correlate_profiles(observed, outcome, zero)),
        differences=tuple(_compare_ranges(observed, outcome)),
        correlations=tuple(decompose_correlations(outcome, zero)),
        compared=tuple(compare_skies(outcome, zero)),
        origins=tuple(list_origins(outcome, zero)),
        findings=findings,
    )


# ---------------------------------------------------------------------- positions


def _find_origin(outcome: Outcome) -> Any:
    """Find the first place that may be used; without one, the first of any kind."""
    for kind in (*USABLE, "unprotected", "false"):
        for r in outcome.receivers:
            if kind in r.tracks:
                return r.tracks[kind].last.position_ecef_m[0]
    return None


def _enu(origin: Any) -> Reals:
    lat, lon, _ = geodetic_from_ecef(origin)
    return np.asarray(rot_enu_ecef(lat, lon))


def _tracks(r: ReceiverOutcome, origin: Any) -> list[FixTrack]:
    rot = _enu(origin)
    name = r.reception.source.name
    tracks = []
    for kind in list_kinds(r):
        track = r.tracks[kind]
        enu = (track.position_ecef_m - origin) @ rot.T
        tracks.append(
            FixTrack(
                receiver=name if kind in KINDS else f"{name} {kind}",
                kind=cast(Any, kind if kind in KINDS else "possible"),
                east_m=enu[:, 0],
                north_m=enu[:, 1],
                covariance_m2=(rot @ track.last.covariance_m2[0, :3, :3] @ rot.T)[:2, :2],
            )
        )
    receiver_fixes = select_receiver_words(r.reception).fixes
    if (rows := select_rows_with_place(receiver_fixes)).size and receiver_fixes is not None:
        enu = (receiver_fixes.position_ecef_m[rows] - origin) @ rot.T
        tracks.append(FixTrack(receiver=name, kind="receiver", east_m=enu[:, 0], north_m=enu[:, 1]))
    return tracks


def _read_truth(observed: Sequence[ReceiverOutcome], origin: Any) -> Iterator[TruePlace]:
    """Yield the true places of receivers at their last fix, where files beside the recording state them."""
    rot = _enu(origin)
    for r in observed:
        source = r.reception.source
        at_gpst = next((r.tracks[kind].last.gpst[0] for kind in KINDS if kind in r.tracks), None)
        if not source.path or at_gpst is None:
            continue
        folder = Path(source.path).parent
        place = _read_place(folder / "truth.json", source.name)
        if place is None:
            place = _interpolate_place(folder / f"{source.name}-truth.csv", at_gpst)
        if place is not None:
            east_m, north_m, _ = rot @ (place - origin)
            yield TruePlace(receiver=source.name, east_m=float(east_m), north_m=float(north_m))


def _read_place(path: Path, name: str) -> Reals | None:
    """Read the place (3,) ECEF of a receiver that stands.

    Content that is not understood is ignored.
    """
    try:
        stated = read_json(path, "the truth", "give that of the simulator")
        stated_receiver = next(row for row in stated["receivers"] if row["name"] == name)
        places = [_ecef_m(stated_receiver[key]) for key in ("position", "position_at_end") if key in stated_receiver]
    except (InputError, ValueError, TypeError, LookupError, StopIteration):
        return None
    stands = all(np.linalg.norm(place - places[0]) < STANDS_M for place in places)
    return places[0] if places and stands else None


def _interpolate_place(path: Path, at_gpst: np.datetime64) -> Reals | None:
    """Interpolate the place (3,) ECEF in a table over time; None if the instant is not within it."""
    try:
        lines = read_content(path, TRACK_BYTES, "the truth", "give that of the simulator").decode("utf-8").splitlines()
        rows = [(row["gpst"], row["x_m"], row["y_m"], row["z_m"]) for row in csv.DictReader(lines)]
        since_s = np.array([float(seconds_between(np.datetime64(row[0], "ns"), at_gpst)) for row in rows])
        places = np.array([row[1:] for row in rows], np.float64)
    except (InputError, csv.Error, ValueError, TypeError, LookupError):
        return None
    if not (since_s.size and np.isfinite(places).all() and since_s[0] <= 0.0 <= since_s[-1]):
        return None
    return np.array([np.interp(0.0, since_s, axis) for axis in places.T])


def _ecef_m(stated: Mapping[str, Any]) -> Reals:
    lat_deg, lon_deg = float(stated["lat_deg"]), float(stated["lon_deg"])
    height_m = float(stated["height_m"] if "height_m" in stated else stated["h_m"])
    place = np.asarray(ecef_from_geodetic(np.radians(lat_deg), np.radians(lon_deg), height_m), np.float64)
    if not np.isfinite(place).all():
        raise ValueError("no place")
    return place


# ---------------------------------------------------------------------- signals


def _series(o: ObservationLog | None, outcome: Outcome, zero: np.datetime64) -> list[SignalSeries]:
    assert o is not None
    series = []
    for s in _labels_of(o, outcome):
        stop = s.last_epoch + 1
        seconds = np.asarray(seconds_between(o.gpst[s.first_epoch : stop], zero), np.float64)
        cn0_dbhz = o.series("cn0_dbhz", o.signals.index(s.ref.signal), s.first_epoch, stop)
        seconds, cn0_dbhz = thin(seconds, cn0_dbhz, SERIES_POINTS)
        series.append(
            SignalSeries(
                receiver=o.receiver, signal=str(s.ref.signal), label=s.label, seconds=seconds, cn0_dbhz=cn0_dbhz
            )
        )
    return series


def _labels_of(o: ObservationLog, outcome: Outcome) -> list[LabelledSignal]:
    return [s for s in outcome.decision.labels if s.ref.receiver == o.receiver]


def _sky(r: ReceiverOutcome, outcome: Outcome) -> list[SkyPosition]:
    o = r.reception.observations
    track = r.usable or r.tracks.get("unprotected")
    if o is None or track is None:
        return []
    place = track.last.position_ecef_m[0]
    positions = []
    for s in _labels_of(o, outcome):
        ephemeris = outcome.navigation.best(s.ref.signal.sat, o.gpst[s.last_epoch])
        if ephemeris is not None:
            state = compute_satellite_state(ephemeris, o.gpst[s.last_epoch])
            azimuth, elevation = compute_azimuth_elevation(place, state.position_ecef_m)
            positions.append(
                SkyPosition(
                    receiver=o.receiver,
                    signal=str(s.ref.signal),
                    label=s.label,
                    azimuth_deg=float(np.degrees(azimuth)) % 360.0,
                    elevation_deg=float(np.degrees(elevation)),
                )
            )
    return positions


# ---------------------------------------------------------------------- correlation


@dataclass(frozen=True)
class _Peak:
    """A signal at an epoch; `delay_s` from the start of the stretch to the beginning of a code period."""

    sat: str
    label: Label
    cn0_dbhz: float
    pseudorange_m: float
    delay_s: float
    doppler_hz: float


def _correlate_profiles(
    observed: Sequence[ReceiverOutcome], outcome: Outcome, zero: np.datetime64
) -> list[DelayProfile]:
    """Correlate attacked satellites over delay, in the first receiver with several signals of one.

    If none has, in the first with signals that are not known to be true.
    """
    for several in (True, False):
        for r in observed:
            o, samples = r.reception.observations, r.reception.measured_samples
            if o is None or samples is None or not (labels := _labels_of(o, outcome)):
                continue
            if (epoch := _find_telling_epoch(o, labels, several)) is not None:
                return _correlate_at(samples, o, labels, epoch, several, float(seconds_between(o.gpst[epoch], zero)))
    return []


def _find_telling_epoch(o: ObservationLog, labels: Sequence[LabelledSignal], several: bool) -> int | None:
    """Find the last epoch at which most satellites have several signals (or one that is not true)."""
    measured = o.measured
    signals: dict[tuple[str, str, str], Any] = {}
    false: dict[tuple[str, str, str], Any] = {}
    for s in labels:
        rows = np.zeros(o.gpst.size, np.int64)
        rows[s.first_epoch : s.last_epoch + 1] = 1
        rows *= measured[:, o.signals.index(s.ref.signal)]
        sent = s.ref.signal.transmission
        signals[sent] = signals.get(sent, 0) + rows
        if s.label != "authentic":
            false[sent] = false.get(sent, 0) + rows
    if several:
        attacked = sum((rows >= 2 for rows in signals.values()), np.zeros(o.gpst.size, np.int64))
    else:
        attacked = sum((rows >= 1 for rows in false.values()), np.zeros(o.gpst.size, np.int64))
    if not attacked.any():
        return None
    return int(np.flatnonzero(attacked == attacked.max())[-1])


def _correlate_at(
    samples: Samples, o: ObservationLog, labels: Sequence[LabelledSignal], epoch: int, several: bool, at_s: float
) -> list[DelayProfile]:
    length_s = min(0.05, float(o.elapsed_s[epoch]))
    start_s = float(o.elapsed_s[epoch]) - length_s
    epoch_log = o.read(epoch, epoch + 1)
    groups: dict[str, list[_Peak]] = {}
    for s in labels:
        if s.first_epoch <= epoch <= s.last_epoch and (peak := _build_peak(epoch_log, s, length_s)) is not None:
            groups.setdefault(peak.sat, []).append(peak)
    chosen = [
        sorted(group, key=_reference_order)
        for group in groups.values()
        if (len(group) >= 2 if several else group[0].label != "authentic")
    ]
    chosen = [[p for p in group if abs(_chips(p, group[0])) <= PROFILE_REACH_CHIPS] for group in chosen]
    chosen = sorted(chosen, key=lambda group: (-min(len(group), 2), -min(p.cn0_dbhz for p in group)))[:PROFILES]
    chosen.sort(key=lambda group: group[0].sat)
    offsets = [_chips(p, group[0]) for group in chosen for p in group]
    first, last = min(offsets, default=0.0) - 2.5, max(offsets, default=0.0) + 2.5
    try:
        delays_chips, powers = compute_delay_profiles(
            samples,
            carrier_at_hz(samples),
            [group[0] for group in chosen],
            first,
            last,
            start_s=start_s,
            duration_s=length_s,
        )
    except ValueError:  # a stretch too short to hold a code period
        return []
    return [
        DelayProfile(
            receiver=samples.name,
            sat=group[0].sat,
            at_s=at_s,
            delays_chips=delays_chips,
            power=power,
            tags=tuple(DelayTag(label=p.label, delay_chips=_chips(p, group[0])) for p in group),
        )
        for group, power in zip(chosen, powers, strict=True)
    ]


def _build_peak(o: Observations, s: LabelledSignal, length_s: float) -> _Peak | None:
    """Build the peak of a signal at the one epoch of `o`."""
    column = o.signals.index(s.ref.signal)
    range_m, doppler_hz = float(o.pseudorange_m[0, column]), float(o.doppler_hz[0, column])
    if not np.isfinite(range_m + doppler_hz):
        return None
    # The code period is a millisecond of transmission time, which is the label less the range.
    shown_s = float(o.gpst[0].astype("datetime64[ns]").astype(np.int64) % PERIOD_NS) * 1e-9
    sent_s = shown_s - range_m / SPEED_OF_LIGHT_M_S
    before_s = length_s * (1.0 + doppler_hz / float(o.carrier_hz[column]))
    delay_s = (before_s - sent_s) % (PERIOD_NS * 1e-9)
    return _Peak(s.ref.signal.sat, s.label, float(o.cn0_dbhz[0, column]), range_m, delay_s, doppler_hz)


def _reference_order(peak: _Peak) -> tuple[bool, float]:
    """Return the key that sorts peaks by reference: the authentic signal, else the first that arrives."""
    return peak.label != "authentic", peak.pseudorange_m


def _chips(peak: _Peak, reference: _Peak) -> float:
    return (peak.pseudorange_m - reference.pseudorange_m) / GPS_L1_CA.chip_m


# ---------------------------------------------------------------------- range differences


def _compare_ranges(observed: Sequence[ReceiverOutcome], outcome: Outcome) -> Iterator[RangeDifference]:
    """Yield per pair of receivers how much longer each satellite's range is to the one than to the other.

    Less the mean of the satellites of the same label, from the last window in which most of them can be compared.
    """
    observations = [r.reception.observations for r in observed if r.reception.observations is not None]
    windows = sorted({(e.start_gpst, e.end_gpst) for e in outcome.evidence}, reverse=True)
    windows = windows[:: max(-(-len(windows) // COMPARED_WINDOWS), 1)]
    for pair in list(combinations(observations, 2))[:PAIRS]:
        per_window = [_compare_ranges_in(pair, window, outcome) for window in windows]
        yield from max(per_window, key=lambda found: (len({d.group for d in found}), len(found)), default=[])


def _compare_ranges_in(
    pair: tuple[ObservationLog, ObservationLog], window: tuple[np.datetime64, np.datetime64], outcome: Outcome
) -> list[RangeDifference]:
    cuts = [cut(o, *window) for o in pair]
    if any(o.gpst.size < 2 for o in cuts):
        return []
    records = Records(start_gpst=window[0], end_gpst=window[1], observations=tuple(cuts))
    by_label = [_group_sets(o, window, outcome) for o in pair]
    found: list[RangeDifference] = []
    for label in (name for name in by_label[0] if name in by_label[1]):
        for ranges in _pair_sets(records, by_label[0][label], by_label[1][label]):
            group = len({d.group for d in found})
            found += [
                RangeDifference(
                    receivers=(pair[0].receiver, pair[1].receiver),
                    sat=sat,
                    label=label,
                    metres=float(value),
                    group=group,
                )
                for sat, value in zip(ranges.sats, ranges.apart_m[:, 0], strict=True)
            ]
    return found


def _pair_sets(
    records: Records, first: Sequence[ConsistentSet], second: Sequence[ConsistentSet]
) -> Iterator[CommonRanges]:
    """Pair sets of two receivers, one of each, by the least difference of their ranges.

    Where labels leave it open, that is how sets of one sky find each other.
    """
    every = [(a, b, align_ranges(records, (a, b))) for a in first for b in second]
    scattered = [(float(np.ptp(c.apart_m)), n) for n, (_, _, c) in enumerate(every) if c.sats and len(c.range_m)]
    taken: set[int] = set()
    for _, n in sorted(scattered):
        a, b, ranges = every[n]
        if not {id(a), id(b)} & taken:
            taken |= {id(a), id(b)}
            yield ranges


def _group_sets(
    o: ObservationLog, window: tuple[np.datetime64, np.datetime64], outcome: Outcome
) -> dict[Label, list[ConsistentSet]]:
    """Group the window's consistent sets by the label that most of their signals carry."""
    middle = window[0] + (window[1] - window[0]) / 2
    row = int(np.clip(np.searchsorted(o.gpst, middle), 0, o.gpst.size - 1))
    labels = {s.ref.signal: s.label for s in _labels_of(o, outcome) if s.first_epoch <= row <= s.last_epoch}
    chosen: dict[Label, list[ConsistentSet]] = {}
    first, stop = (bisect_left(outcome.sets, edge, key=lambda s: s.gpst) for edge in window)
    for candidate in outcome.sets[first:stop]:
        if candidate.receiver == o.receiver:
            carried = [labels.get(signal, "unknown") for signal in candidate.signals]
            chosen.setdefault(max(sorted(set(carried)), key=carried.count), []).append(candidate)
    return chosen


# ---------------------------------------------------------------------- evidence in words


def _describe_findings(outcome: Outcome) -> Iterator[MethodWords]:
    for evidence in count_by_detector(outcome.evidence):
        found = evidence.most_telling
        if found is not None:
            yield MethodWords(
                detector=found.detector,
                words=explain(found).sentence,
                from_gpst=format_iso(found.start_gpst, 3),
                to_gpst=format_iso(found.end_gpst, 3),
            )
