"""When the attack began and ended, from when the receiver's search found the false signals."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skyproof.fusion.labels import LabelledSignal
from skyproof.records import Observations, SignalRef

__all__ = ["Onset", "end_of", "onset_of"]


@dataclass(frozen=True, kw_only=True)
class Onset:
    """sigma_s is None if the attack was on when the recording began; `gpst` is then the recording's start."""

    gpst: np.datetime64
    sigma_s: float | None


def onset_of(signals: Sequence[SignalRef], observations: Sequence[Observations]) -> Onset | None:
    """The earliest appearance of any of these signals: between the last search that missed it and the first that
    found it, uniformly (sigma = interval / sqrt(12)).
    """
    onsets: list[Onset] = []
    for o in observations:
        for column, signal in enumerate(o.signals):
            if SignalRef(o.receiver, signal) in signals:
                found_s, missed_s = float(o.found_elapsed_s[column]), float(o.missed_elapsed_s[column])
                if np.isnan(missed_s):
                    return Onset(gpst=_instant(o, 0.0), sigma_s=None)
                onsets.append(
                    Onset(gpst=_instant(o, 0.5 * (found_s + missed_s)), sigma_s=(found_s - missed_s) / np.sqrt(12.0))
                )
    return min(onsets, key=lambda onset: onset.gpst, default=None)


def end_of(
    false: Sequence[LabelledSignal], observations: Sequence[Observations], *, patience_s: float = 3.0
) -> np.datetime64 | None:
    """The last epoch of any false signal, if all receivers went on at least `patience_s` without one; else None."""
    ends = []
    for o in observations:
        last = max((s.last_epoch for s in false if s.ref.receiver == o.receiver), default=None)
        if last is None:
            continue
        if o.elapsed_s[-1] - o.elapsed_s[last] < patience_s:
            return None
        ends.append(o.gpst[last])
    return max(ends, default=None)


def _instant(o: Observations, elapsed_s: float) -> np.datetime64:
    moment: np.datetime64 = o.gpst[0] + np.timedelta64(round((elapsed_s - float(o.elapsed_s[0])) * 1e9), "ns")
    return moment
