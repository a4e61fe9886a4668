"""Signals that are received and belong to nothing that was decided: how many, how strong, what would explain them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from skyproof.arrays import Reals
from skyproof.fusion.labels import LabelledSignal
from skyproof.fusion.policy import POLICY
from skyproof.records import Finding, ObservationLog, SignalId, SignalRef
from skyproof.statistics.medians import medians

__all__ = ["Kind", "Unexplained", "unexplained"]

Kind = Literal["double", "echo", "rival", "misfit", "untested"]
"""double : beside another one of its satellite, where it is open which of them is true.
echo : beside an authentic signal of its satellite, later and weaker: a reflection would explain it.
rival : beside one, but earlier or stronger: no reflection is. Of two unknown signals of a satellite, the one found
    later, unless the weaker of them is the later one.
misfit : the only signal of its satellite there, in a test that failed: a fault, an echo alone or an imitation.
untested : the only one of its satellite, and nothing spoke of it: received by one receiver only, or too shortly.
"""


@dataclass(frozen=True, kw_only=True)
class Unexplained:
    """One signal that stays unknown.

    cn0_dbhz : mean, NaN where it is not known. over_db : over the authentic one's C/N0, None without one.
    """

    ref: SignalRef
    kind: Kind
    cn0_dbhz: float
    over_db: float | None = None


def unexplained(
    labels: Sequence[LabelledSignal],
    evidence: Sequence[Finding],
    observations: Sequence[ObservationLog],
    *,
    parts: bool = True,
) -> tuple[Unexplained, ...]:
    """List the signals that are unknown all the time that they are received.

    parts : also those that are unknown for longer than the longest window.
    """
    # A failed test of one receiver's signals says that they do not fit each other; one of several, that they differ.
    failed = {ref for e in evidence if e.failed and len({ref.receiver for ref in e.signals}) == 1 for ref in e.signals}
    window_s = max(((e.end_gpst - e.start_gpst) / np.timedelta64(1, "s") for e in evidence), default=0.0)
    found: list[Unexplained] = []
    for o in observations:
        columns = [s for s in labels if s.ref.receiver == o.receiver]
        decided = {s.ref for s in columns if s.label in ("authentic", "spoofed")}
        longest: dict[SignalRef, LabelledSignal] = {}
        for s in columns:
            if s.label == "unknown" and (
                s.ref not in longest or _measure_length_s(s, o) > _measure_length_s(longest[s.ref], o)
            ):
                longest[s.ref] = s
        length_s = float(o.elapsed_s[-1] - o.elapsed_s[0]) if o.elapsed_s.size else np.inf
        short_s = min(POLICY.counted_s, POLICY.counted_share * length_s)
        least_s = {True: POLICY.longer_windows * window_s if parts else np.inf, False: short_s}
        listed = [s for ref, s in longest.items() if _measure_length_s(s, o) >= least_s[ref in decided]]
        # Where nothing at all is decided it is no news that a signal is not; that a satellite is there twice is.
        found += [_describe(s, columns, o, s.ref in failed) for s in listed] if decided else _find_doubles(listed, o)
    return tuple(found)


def _find_doubles(left: Sequence[LabelledSignal], o: ObservationLog) -> list[Unexplained]:
    """List each satellite's signals beside the one that was found first, while that one was there."""
    found = []
    for s in left:
        for other in left:
            first, last = max(s.first_epoch, other.first_epoch), min(s.last_epoch, other.last_epoch)
            if _is_found_after(s, other) and last >= first:
                a, b = (_read_series(o, "cn0_dbhz", signal.ref.signal, first, last) for signal in (s, other))
                over_db, cn0_dbhz = float(medians(a - b)), float(medians(a))
                found.append(Unexplained(ref=s.ref, kind="double", cn0_dbhz=cn0_dbhz, over_db=over_db))
                break
    return found


def _is_found_after(s: LabelledSignal, other: LabelledSignal) -> bool:
    """Tell whether both belong to one transmission and the other one was found first."""
    transmission, first = s.ref.signal, other.ref.signal
    return transmission.transmission == first.transmission and (len(first.copy), first.copy) < (
        len(transmission.copy),
        transmission.copy,
    )


def _measure_length_s(s: LabelledSignal, o: ObservationLog) -> float:
    return float(o.elapsed_s[s.last_epoch] - o.elapsed_s[s.first_epoch])


def _describe(s: LabelledSignal, own: Sequence[LabelledSignal], o: ObservationLog, failed: bool) -> Unexplained:
    cn0_dbhz = _compute_mean(_read_series(o, "cn0_dbhz", s.ref.signal, s.first_epoch, s.last_epoch))
    transmission = s.ref.signal.transmission
    beside = [other for other in own if other.label == "authentic" and other.ref.signal.transmission == transmission]
    for other in beside or [other for other in own if other.label == "unknown" and _is_found_after(s, other)]:
        first, last = max(s.first_epoch, other.first_epoch), min(s.last_epoch, other.last_epoch)
        if last < first:
            continue
        late_m, over_db = (
            float(
                medians(
                    _read_series(o, name, s.ref.signal, first, last)
                    - _read_series(o, name, other.ref.signal, first, last)
                )
            )
            for name in ("pseudorange_m", "cn0_dbhz")
        )
        is_echo = late_m > 0.0 and over_db < 0.0 if other.label == "authentic" else late_m * over_db < 0.0
        return Unexplained(ref=s.ref, kind="echo" if is_echo else "rival", cn0_dbhz=cn0_dbhz, over_db=over_db)
    return Unexplained(ref=s.ref, kind="misfit" if failed else "untested", cn0_dbhz=cn0_dbhz)


def _read_series(o: ObservationLog, name: str, signal: SignalId, first_epoch: int, last_epoch: int) -> Reals:
    return o.series(name, o.signals.index(signal), first_epoch, last_epoch + 1)


def _compute_mean(values: Reals) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else float("nan")
