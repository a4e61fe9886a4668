"""A tracked recording's time: which week, what the receiver's clock shows, and by how much its label is off."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from skyproof.app.receive.tracker import Tracker
from skyproof.arrays import Booleans, Indices, Instants, Reals
from skyproof.errors import InputError
from skyproof.formats.bounds import list_names
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.orbits import compute_satellite_state
from skyproof.gnss.time import GPS_EPOCH, format_iso, resolve_week, timedelta_from_s, week_and_tow
from skyproof.navigation.fix import fix
from skyproof.receiver.channels import Arc, Gap
from skyproof.receiver.observables import ReceiverTimeTag, list_weeks, receiver_time_tag, time_by_range
from skyproof.records import FixStatus, NavigationData, Observations, Samples, SignalId

__all__ = [
    "Shown",
    "compute_clock_biases_s",
    "estimate_time_tag",
    "find_week",
    "move_near_date",
    "position_all_epochs",
    "select_first_copies",
    "time_short_arcs",
]


def find_week(tracker: Tracker, navigation: NavigationData | None, remarks: list[str]) -> int:
    """Find the recording's GPS week by its date, the navigation file or the signals, in this order.

    Raises InputError if no signal's week is that of the navigation file.
    """
    start = tracker.samples.start_gpst
    if start is not None:
        return int(week_and_tow(start)[0])
    stated, near = min(list_weeks(tracker.arcs), default=None), np.datetime64("now", "ns")
    if navigation is not None and navigation.ephemerides:
        week = int(np.median([e.week for e in navigation.ephemerides]))
        if stated is not None and all((stated_week - week + 1) % 1024 > 2 for stated_week in list_weeks(tracker.arcs)):
            raise InputError(
                f"{tracker.samples.path or tracker.samples.name}: its signals are in {_describe_week(stated, near)} "
                f"(or 1024 weeks before or after), the navigation file is for {_describe_week(week, near)}; give the "
                "file of the day, or, if the signals may lie about it, start_gpst in the sidecar"
            )
        remarks.append(f"no date in the sidecar: GPS week {week} taken from the navigation file")
        return week
    week = resolve_week(stated, near) if stated is not None else int(week_and_tow(near)[0])
    remarks.append(
        f"no date in the sidecar and no navigation file: GPS week {week} taken "
        + ("from the message, as the one nearest to today" if stated is not None else "as today's; give start_gpst")
    )
    return week


def _describe_week(week: int, near: np.datetime64) -> str:
    """Name the first day of a week, whole or modulo 1024."""
    whole = week if week >= 1024 else resolve_week(week, near)
    return f"GPS week {whole}, from {format_iso(GPS_EPOCH + np.timedelta64(7 * whole, 'D'), 0)[:10]} on"


def estimate_time_tag(tracker: Tracker, week: int) -> ReceiverTimeTag | None:
    """Estimate the label at the first sample, from measurements before missing samples if possible."""
    first = tracker.measured.first
    before = _count_gaps(first.elapsed_s, tracker.gaps) == 0
    label = receiver_time_tag(first.select(before), tracker.arcs, week)
    return label if label is not None else receiver_time_tag(first, tracker.arcs, week)


def _count_gaps(elapsed_s: ArrayLike, gaps: Sequence[Gap]) -> Indices:
    """Count the unmarked gaps before each moment."""
    return np.searchsorted(np.sort([gap.elapsed_s for gap in gaps]), np.asarray(elapsed_s, float), side="right")


def move_near_date(
    label: ReceiverTimeTag, samples: Samples, arcs: Mapping[int, Arc], remarks: list[str]
) -> ReceiverTimeTag:
    """Move the label to the week nearest to the recording's date; remark if the signals say otherwise.

    A recorder's clock may never have been set. The message knows the week modulo 1024.
    """
    if samples.start_gpst is None:
        return label
    week, tow_s = week_and_tow(samples.start_gpst)
    ahead_s = label.tow_ms * 1e-3 - tow_s
    turned = round(ahead_s / 604800.0)
    label = replace(label, week=int(week) - turned)
    off_s = ahead_s - 604800.0 * turned
    stated = _find_stated_week(arcs, label)
    if stated is not None and (stated - label.week) % 1024 != 0:
        label = replace(label, week=resolve_week(stated, samples.start_gpst))
        off_s += 604800.0 * (label.week - int(week) + turned)
    if abs(off_s) > 2.0:
        remarks.append(
            f"the sidecar's start_gpst is {format_iso(samples.start_gpst, 0)}, but the signals' own time differs from "
            f"it by {off_s:+.1f} s; the signals' time is used"
        )
    return label


def _find_stated_week(arcs: Mapping[int, Arc], label: ReceiverTimeTag) -> int | None:
    """Find the week at `label`, modulo 1024, that most signals state; None if none does."""
    half_week_s = 302_400
    weeks = Counter(
        (int(first.fields["week_mod_1024"]) - (first.tow_s < label.tow_ms * 1e-3 - half_week_s)) % 1024
        for arc in arcs.values()
        if (first := arc.subframes.get(1)) is not None
    )
    return weeks.most_common(1)[0][0] if weeks else None


@dataclass(frozen=True, eq=False, kw_only=True)
class Shown:
    """Where the signals found first say that a receiver is, unjudged; (n_epochs,), NaN where they do not.

    good : where there is a fix.
    """

    gpst: Instants
    elapsed_s: Reals
    position_ecef_m: Reals
    clock_bias_s: Reals
    good: Booleans


def position_all_epochs(stretches: Iterator[Observations], orbits: NavigationData) -> Shown:
    """Compute the positions of all epochs of a recording, by the signals found first."""
    parts = []
    for part in stretches:
        found = fix(part, orbits, signals=select_first_copies(part), elevation_mask_deg=0.0)
        parts.append(
            (found.gpst, part.elapsed_s, found.position_ecef_m, found.clock_bias_s, found.status == FixStatus.OK)
        )
    gpst, elapsed_s, position_ecef_m, clock_bias_s, good = (np.concatenate(each) for each in zip(*parts, strict=True))
    return Shown(gpst=gpst, elapsed_s=elapsed_s, position_ecef_m=position_ecef_m, clock_bias_s=clock_bias_s, good=good)


def time_short_arcs(
    tracker: Tracker, shown: Shown, orbits: NavigationData, label: ReceiverTimeTag, remarks: list[str]
) -> dict[int, Arc] | None:
    """Time arcs too short for a subframe by the others' position; None if no arc gains by it."""
    good = np.flatnonzero(shown.good)
    if good.size == 0:
        return None
    segment = _count_gaps(shown.elapsed_s[good], tracker.gaps)

    def range_m(sat: str, elapsed_s: float) -> float | None:
        # Beyond a gap the receiver's clock is another one.
        near = good[segment == _count_gaps(elapsed_s, tracker.gaps)]
        if near.size == 0:
            return None
        row = near[np.argmin(np.abs(shown.elapsed_s[near] - elapsed_s))]
        ephemeris = orbits.best(sat, shown.gpst[row])
        if ephemeris is None:
            return None
        later = timedelta_from_s(elapsed_s - float(shown.elapsed_s[row]))
        state = compute_satellite_state(ephemeris, shown.gpst[row] + later - np.timedelta64(75, "ms"))
        clock_s = float(shown.clock_bias_s[row]) - float(state.clock_s)
        away_m = float(np.linalg.norm(state.position_ecef_m - shown.position_ecef_m[row]))
        return away_m + SPEED_OF_LIGHT_M_S * clock_s

    arcs = time_by_range(tracker.arcs, tracker.measured.first, label, range_m)
    gained = sorted(
        str(arc.signal)
        for number, arc in arcs.items()
        if arc.tow_ms_at_period_0 is not None and tracker.arcs[number].tow_ms_at_period_0 is None
    )
    if not gained:
        return None
    remarks.append(
        f"{list_names(gained)}: received too shortly for a time of week of their own; it was taken from the range that "
        "the position of the others predicts"
    )
    return arcs


def compute_clock_biases_s(shown: Shown, gaps: Sequence[Gap]) -> Reals | None:
    """Compute the shift of each epoch's clock label, (n_epochs,), to agree with most signals.

    Labels agree to within half a millisecond. None where they give no fix at all. Where samples are missing unmarked it
    steps by what is missing. Where the signals' time steps back, as in a recording joined to itself, it continues with
    the samples.
    """
    known = np.isfinite(shown.clock_bias_s)
    if not known.any():
        return None
    segment = _count_gaps(shown.elapsed_s, gaps)
    parts = np.unique(segment[known])
    biases_s = np.array([np.median(shown.clock_bias_s[known & (segment == part)]) for part in parts])
    biases_s = np.minimum.accumulate(biases_s)  # labels never go back, where the signals' time does
    chosen = biases_s[np.clip(np.searchsorted(parts, segment), 0, parts.size - 1)]
    # When a gap began is known to a few epochs only: the fixes themselves show on which side of it they lie.
    chosen[known] = biases_s[np.argmin(np.abs(shown.clock_bias_s[known][:, None] - biases_s), axis=1)]
    return np.asarray(chosen)


def select_first_copies(observations: Observations) -> tuple[SignalId, ...]:
    """Select the signal of each satellite that was found first."""
    first: dict[str, SignalId] = {}
    for signal in sorted(observations.signals, key=lambda s: (len(s.copy), s.copy)):
        first.setdefault(signal.sat, signal)
    return tuple(first.values())
