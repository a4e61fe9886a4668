"""When the attack began and ended, from when the receiver's search found the false signals."""

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import permutations

import numpy as np

from skyproof.fusion.labels import LabelledSignal
from skyproof.fusion.policy import POLICY
from skyproof.gnss.time import timedelta_from_s
from skyproof.navigation.window import median_interval_s
from skyproof.records import ObservationLog, SignalRef

__all__ = ["Onset", "Pair", "compare_pairs", "date_end", "date_onset"]


@dataclass(frozen=True, kw_only=True)
class Onset:
    """When false signals began to be received.

    seen : when they were first seen, so that they began then at the latest.
    earliest : they began after this; None if that is not known, because they were received when the recording began, or
        may have been hidden in the true signals for any time.
    from_start : whether they were seen from the first moment on.
    """

    seen: np.datetime64
    earliest: np.datetime64 | None
    from_start: bool = False

    @property
    def gpst(self) -> np.datetime64:
        """Return the middle of the interval; `seen` if it has no beginning."""
        return self.seen if self.earliest is None else self.earliest + (self.seen - self.earliest) / 2

    @property
    def sigma_s(self) -> float | None:
        """Return the sigma of `gpst`, any instant of the interval being as likely; None if it has no beginning."""
        if self.earliest is None:
            return None
        return float((self.seen - self.earliest) / np.timedelta64(1, "s") / np.sqrt(12.0))


@dataclass(frozen=True)
class Pair:
    """Two signals of one transmission of a receiver. is_near : when both were first measured, the later one stood so
    near the other that a search may not have seen it before."""

    later: SignalRef
    other: SignalRef
    is_near: bool = field(compare=False, default=False)


def compare_pairs(o: ObservationLog) -> Iterator[Pair]:
    """Yield each signal with those of its transmission that were found no later, where both were measured at once."""
    for transmission, number in Counter(signal.transmission for signal in o.signals).items():
        columns = [k for k, signal in enumerate(o.signals) if number > 1 and signal.transmission == transmission]
        for later, other in permutations(columns, 2):
            common = np.flatnonzero(o.measured[:, later] & o.measured[:, other])
            if common.size and o.found_elapsed_s[other] <= o.found_elapsed_s[later]:
                is_near = (
                    _measure_apart_m(o, later, other, int(common[0]))
                    < POLICY.hidden_chips * o.signals[later].plan.chip_m
                )
                yield Pair(SignalRef(o.receiver, o.signals[later]), SignalRef(o.receiver, o.signals[other]), is_near)


def date_onset(
    signals: Collection[SignalRef],
    observations: Sequence[ObservationLog],
    hidden: Collection[SignalRef] | None = None,
) -> Onset | None:
    """Date the earliest of these signals, each found by a search, in any receiver.

    It came between the last search that missed it and the one that found it. Where most of those that came with it
    stood within two chips of another signal of their satellite, they may have been there before, unseen.

    hidden : signals that did; by the observations if absent.
    """
    found: list[tuple[np.datetime64, np.datetime64, SignalRef]] = []
    for o in observations:
        for column, signal in enumerate(o.signals):
            ref = SignalRef(o.receiver, signal)
            if ref in signals:
                found_s, missed_s = float(o.found_elapsed_s[column]), float(o.missed_elapsed_s[column])
                if np.isnan(missed_s):
                    return Onset(seen=_find_instant(o, 0.0), earliest=None, from_start=True)
                found.append((_find_instant(o, found_s + POLICY.searched_s), _find_instant(o, missed_s), ref))
    if not found:
        return None
    seen, missed, _ = min(found, key=lambda each: each[0])
    if hidden is None:
        hidden = {pair.later for o in observations for pair in compare_pairs(o) if pair.is_near}
    together_s = max(POLICY.together_s, *(POLICY.gap_intervals * median_interval_s(o.elapsed_s) for o in observations))
    company = [ref in hidden for at, _, ref in found if at - seen <= timedelta_from_s(together_s)]
    return Onset(seen=seen, earliest=None if sum(company) > POLICY.hidden_share * len(company) else missed)


def _measure_apart_m(o: ObservationLog, one: int, other: int, epoch: int) -> float:
    a, b = (o.series("pseudorange_m", channel, epoch, epoch + 1) for channel in (one, other))
    return float(np.abs(a - b)[0])


def date_end(false: Sequence[LabelledSignal], observations: Sequence[ObservationLog]) -> np.datetime64 | None:
    """Return the last epoch of any false signal, if all receivers received none for `ended_s` and two epochs; else
    None."""
    ends = []
    for o in observations:
        last = max((s.last_epoch for s in false if s.ref.receiver == o.receiver), default=None)
        if last is None:
            continue
        if o.elapsed_s[-1] - o.elapsed_s[last] < max(
            POLICY.ended_s, POLICY.gap_intervals * median_interval_s(o.elapsed_s)
        ):
            return None
        ends.append(o.gpst[last])
    return max(ends, default=None)


def _find_instant(o: ObservationLog, elapsed_s: float) -> np.datetime64:
    moment: np.datetime64 = o.gpst[0] + timedelta_from_s(elapsed_s - float(o.elapsed_s[0]))
    return moment
