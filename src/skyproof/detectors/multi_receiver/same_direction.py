"""Withhold signals of a true sky that the antenna of false ones could as well have sent, as the receivers stand.

A set of signals fits one position, and with five of them a sixth is not missed: one that is false fits by chance, if
its satellite's range differs between the receivers by what it would from the false antenna. Nothing that receivers
compare separates such a signal from a true one, so it is not called authentic. It is if the antenna's signal of that
satellite is known as another signal.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from skyproof.arrays import Booleans, Reals
from skyproof.detectors.base import leave_open
from skyproof.detectors.multi_receiver.common_epochs import CommonRanges, align_ranges
from skyproof.detectors.multi_receiver.pairing import Pairing
from skyproof.detectors.multi_receiver.policy import POLICY
from skyproof.records import Cause, Finding, Hypothesis, Records, SignalRef

__all__ = ["withhold_doubtful"]


def withhold_doubtful(records: Records, skies: Sequence[Pairing], said: Sequence[Finding]) -> list[Finding]:
    """Remove from a window's authentic signals those that an antenna of the false signals could have sent."""
    groups = [e.signals for e in said if e.says == "spoofed" and not e.whole_sky]
    doubtful = {ref for sky in skies for group in groups for ref in _list_doubtful(records, sky, group)}
    return [_leave_out_doubtful(e, doubtful) if e.says == "authentic" else e for e in said]


def _leave_out_doubtful(e: Finding, doubtful: set[SignalRef]) -> Finding:
    kept = tuple(ref for ref in e.signals if ref not in doubtful)
    n = len({ref.signal.sat for ref in e.signals}) - len({ref.signal.sat for ref in kept})
    if not n:
        return e
    data = {**e.data, "doubtful": n}
    if len({ref.signal.sat for ref in kept}) >= POLICY.fix_satellites:
        withheld = tuple(ref for ref in e.signals if ref in doubtful)
        return replace(e, signals=kept, data=data, estimates={**e.estimates, "withheld": withheld})
    del data["group"]
    open_: dict[str, Any] = {"p": leave_open((Cause.FALSE_SKY,)), "hypothesis": Hypothesis.FALSE_SKY}
    return replace(e, code="few_without_doubtful", data={**data, "found": e.code}, **open_)


def _list_doubtful(records: Records, sky: Pairing, group: Sequence[SignalRef]) -> Iterator[SignalRef]:
    """Yield the doubtful signals of the sky, in all its receivers."""
    ranges = sky.ranges
    sets = tuple(
        replace(chosen, signals=tuple(ref.signal for ref in group if ref.receiver == chosen.receiver))
        for chosen in sky.sets
    )
    if any(not chosen.signals for chosen in sets):
        return
    false = align_ranges(records, sets, kind=ranges.signals[0].kind, min_satellites=1)
    sent = {ref.signal.transmission for ref in group}
    for k in np.flatnonzero(_is_from_antenna(ranges, false, sky.noise.multipath_sigma_m)):
        tracks = [receiver_tracks[k] for receiver_tracks in ranges.tracks]
        if tracks[0].transmission not in sent:
            yield from (SignalRef(name, track) for name, track in zip(sky.receivers, tracks, strict=True))


def _is_from_antenna(ranges: CommonRanges, false: CommonRanges, multipath_sigma_m: float) -> Booleans:
    """Find transmissions (K,) whose ranges differ between receivers as those of one antenna do."""
    _, own_rows, other = np.intersect1d(np.round(ranges.time_s, 6), np.round(false.time_s, 6), return_indices=True)
    if not own_rows.size or not false.signals:
        return np.zeros(len(ranges.signals), np.bool_)
    away_m = (ranges.range_m[own_rows, :, 1:] - ranges.range_m[own_rows, :, :1]).mean(axis=0)
    false_m = (false.range_m[other, :, 1:] - false.range_m[other, :, :1]).mean(axis=0)
    slow = min(POLICY.slow_noise_factor / own_rows.size, 1.0)

    def variance_m2(some: CommonRanges) -> Reals:
        each_m2 = some.sigma_m**2 * slow + multipath_sigma_m**2
        return np.asarray(each_m2[:, 1:] + each_m2[:, :1])

    sigma_m = np.sqrt(variance_m2(ranges.at(own_rows)) + variance_m2(false.at(other)).mean(axis=0) / len(false.signals))
    return np.asarray((np.abs(away_m - false_m.mean(axis=0)) < POLICY.same_antenna_sigmas * sigma_m).all(axis=1))
