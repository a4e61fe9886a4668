"""Judge the signals beside named false ones, as if the receivers had not received those."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

import numpy as np

from skyproof.app.common.progress import Progress
from skyproof.app.common.session import Session, examine_all
from skyproof.app.receive.reception import Reception
from skyproof.arrays import Booleans, Indices, Instants, Reals
from skyproof.fusion.consistent import Rest, name_against_rest
from skyproof.fusion.fuse import Decision, fuse
from skyproof.records import (
    ArrayPhases,
    Ccaf,
    ConsistentSet,
    Finding,
    ObservationLog,
    Observations,
    SignalId,
    SignalRef,
    Taps,
    TimeSliced,
)

__all__ = ["judge_rest"]

R = TypeVar("R", Taps, Ccaf, ArrayPhases)


def judge_rest(
    receptions: Sequence[Reception],
    decision: Decision,
    evidence: Sequence[Finding],
    sets: Sequence[ConsistentSet],
    begin: Callable[[Sequence[Reception]], Session],
    progress: Progress,
) -> tuple[Rest, Sequence[Finding]] | None:
    """Judge all signals but those that are named as false against them, with what tests of these found.

    None where no such signals are named, and where an interruption left windows out.

    begin : the session of what receivers received.
    """
    named = name_against_rest(decision, evidence, sets)
    if not named:
        return None
    kept = [_leave_out(reception, named) for reception in receptions]
    found, of_rest, cut_short = examine_all(begin(kept), progress)
    if cut_short:
        return None
    observed = [r.observations for r in kept if r.observations is not None and r.observations.gpst.size > 1]
    return Rest(named=named, decision=fuse(found, observed, of_rest)), found


def _leave_out(reception: Reception, named: frozenset[SignalRef]) -> Reception:
    """Return a reception without some signals."""
    log = reception.observations
    left_out = frozenset(ref.signal for ref in named if log is not None and ref.receiver == log.receiver)
    if log is None or not left_out:
        return reception
    sliced: dict[str, Any] = {
        name: None if slices is None else _PartSlices(slices, left_out)
        for name in ("taps", "vector_taps", "ccaf", "array_phases")
        for slices in (getattr(reception, name),)
    }
    return replace(reception, observations=_PartLog(log, _find_kept(log.signals, left_out)), **sliced)


def _find_kept(signals: Sequence[SignalId], left_out: frozenset[SignalId]) -> Indices:
    return np.array([k for k, signal in enumerate(signals) if signal not in left_out], np.intp)


@dataclass(frozen=True, eq=False)
class _PartSlices(Generic[R]):
    """What a receiver has beside its measurements, without some signals."""

    whole: TimeSliced[R]
    left_out: frozenset[SignalId]

    @property
    def receiver(self) -> str:
        return self.whole.receiver

    def select_between(self, begin_s: float, end_s: float, /) -> R:
        """Select what has begin <= `elapsed_s` < end, as one record."""
        record = self.whole.select_between(begin_s, end_s)
        return record.select_channels(_find_kept(record.signals, self.left_out))


@dataclass(frozen=True, eq=False)
class _PartLog:
    """Some channels of a log."""

    whole: ObservationLog
    columns: Indices

    @property
    def receiver(self) -> str:
        return self.whole.receiver

    @property
    def signals(self) -> tuple[SignalId, ...]:
        return tuple(self.whole.signals[k] for k in self.columns)

    @property
    def gpst(self) -> Instants:
        return self.whole.gpst

    @property
    def elapsed_s(self) -> Reals:
        return self.whole.elapsed_s

    @property
    def found_elapsed_s(self) -> Reals:
        return self.whole.found_elapsed_s[self.columns]

    @property
    def missed_elapsed_s(self) -> Reals:
        return self.whole.missed_elapsed_s[self.columns]

    @property
    def carrier_hz(self) -> Reals:
        return self.whole.carrier_hz[self.columns]

    @property
    def measured(self) -> Booleans:
        return self.whole.measured[:, self.columns]

    @property
    def slipped(self) -> Booleans:
        return self.whole.slipped[:, self.columns]

    def series(self, name: str, channel: int, first: int = 0, stop: int | None = None) -> Reals:
        """Return one observable of one channel, epochs from `first` to before `stop`."""
        return self.whole.series(name, int(self.columns[channel]), first, stop)

    def read(self, first: int, stop: int) -> Observations:
        """Read the epochs from `first` to before `stop`."""
        return self.whole.read(first, stop).select_channels(self.columns)
