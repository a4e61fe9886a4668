"""A tracked recording's measurements as records, made stretch by stretch of what was written while it was tracked."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from skyproof.app.receive.tracker import Tracker
from skyproof.arrays import Instants, Reals
from skyproof.formats.pieces import Workspace
from skyproof.formats.spool import gather
from skyproof.navigation.clock import anchor_label
from skyproof.receiver.channels import Arc
from skyproof.receiver.grids import GridCorrelator
from skyproof.receiver.observables import (
    ArcCarrier,
    ReceiverTimeTag,
    assemble,
    assemble_array_phases,
    assemble_grids,
    assemble_taps,
)
from skyproof.records import (
    AntennaArray,
    ArrayPhases,
    Ccaf,
    ObservationLog,
    Observations,
    Taps,
    TimeSliced,
)

__all__ = ["Assembled"]

STRETCH_EPOCHS: Final = 1024


@dataclass(frozen=True, eq=False)
class Assembled:
    """arcs, label : by which times of week are known; antennas are numbered from 0."""

    tracker: Tracker
    arcs: Mapping[int, Arc]
    label: ReceiverTimeTag

    @cached_property
    def elapsed_s(self) -> Reals:
        """Return the times of all epochs (n_epochs,), also of those without a measurement."""
        return self.tracker.epoch_s * np.arange(1.0, self.tracker.n_epochs + 1)

    @cached_property
    def _carriers(self) -> dict[int | None, dict[int, ArcCarrier]]:
        return {}

    def stretches(self, antenna: int, biases_s: Reals | None = None) -> Iterator[Observations]:
        """Yield one antenna's measurements, its clock moved by `biases_s` (n_epochs,) as `anchor_label` does."""
        measured = self.tracker.measured
        part = antenna if measured.n_antennas else None
        if part not in self._carriers:
            self._carriers[part] = measured.carriers(self.arcs, part)
        for first in range(0, max(self.elapsed_s.size, 1), STRETCH_EPOCHS):
            rows = slice(first, first + STRETCH_EPOCHS)
            elapsed_s = self.elapsed_s[rows]
            found = assemble(
                self.tracker.samples.name,
                measured.on_antenna(first + 1, first + 1 + elapsed_s.size, part),
                self.arcs,
                self.label,
                elapsed_s,
                self._carriers[part],
                carrier_hz=self._carrier_hz,
                averaged_s=self.tracker.epoch_s,
            )
            yield found if biases_s is None else anchor_label(found, biases_s[rows])

    def split_antennas(self, biases_s: Reals | None, workspace: Workspace) -> tuple[ObservationLog, ...]:
        """Return each antenna's measurements; with one antenna, all that there are."""
        n = self.tracker.measured.n_antennas
        names = ["observations"] if not n else [f"observations-{antenna + 1}" for antenna in range(n)]
        return tuple(
            gather(self.stretches(antenna, biases_s), self.tracker.samples.name, workspace, name)
            for antenna, name in enumerate(names)
        )

    def taps(self) -> TimeSliced[Taps] | None:
        """Return the correlators that were requested, at the epochs of the observations."""
        return _Taps(self) if self.tracker.receiver.settings.looks_per_frame else None

    def vector_taps(self) -> TimeSliced[Taps] | None:
        """Return the correlators of channels that one position steers, as their replicas gave them."""
        if self.tracker.vector is None or not self.tracker.receiver.settings.looks_per_frame:
            return None
        return _Taps(self, as_replica=True)

    def ccaf(self, observations: ObservationLog) -> TimeSliced[Ccaf] | None:
        """Return the correlation grids that were requested."""
        grids = self.tracker.receiver.grids
        return None if grids is None else _Grids(self, grids, observations)

    def array_phases(self, array: AntennaArray, gpst: Instants) -> TimeSliced[ArrayPhases] | None:
        """Return the carrier phases on all antennas; None if there is no epoch.

        gpst : (n_epochs,) of the observations.
        """
        return _Phases(self, array, gpst) if self.elapsed_s.size else None

    def rows_between(self, begin_s: float, end_s: float) -> slice:
        """Select the epochs whose blocks have anything of begin <= t < end."""
        half_s = 0.5 * self.tracker.epoch_s
        first, stop = np.searchsorted(self.elapsed_s, [begin_s - half_s, end_s + half_s])
        return slice(int(first), int(stop))

    @property
    def _carrier_hz(self) -> float:
        return self.tracker.receiver.settings.signal.carrier_hz


@dataclass(frozen=True, eq=False)
class _Taps:
    """`TimeSliced[Taps]` of a tracked recording."""

    of: Assembled
    as_replica: bool = False

    @property
    def receiver(self) -> str:
        return self.of.tracker.samples.name

    def select_between(self, begin_s: float, end_s: float) -> Taps:
        rows, tracker = self.of.rows_between(begin_s, end_s), self.of.tracker
        receiver = tracker.receiver
        found = assemble_taps(
            self.receiver,
            tracker.measured.read(rows.start + 1, rows.stop + 1),
            self.of.arcs,
            self.of.elapsed_s[rows],
            delays_chips=receiver.taps_chips,
            dopplers_hz=receiver.taps_hz,
            samples_per_period=receiver.rate_hz * receiver.signal.period_s,
            averaged_s=tracker.epoch_s,
            look_share=receiver.settings.look_share,
            as_replica=self.as_replica,
        )
        return found.select_between(begin_s, end_s)


@dataclass(frozen=True, eq=False)
class _Grids:
    """`TimeSliced[Ccaf]` of a tracked recording."""

    of: Assembled
    taken: GridCorrelator
    observations: ObservationLog

    @property
    def receiver(self) -> str:
        return self.of.tracker.samples.name

    def select_between(self, begin_s: float, end_s: float) -> Ccaf:
        grids = self.of.tracker.grids.select_between(begin_s, end_s)
        return assemble_grids(self.receiver, grids, self.taken, self.of.arcs, self.of.label, self.observations)


@dataclass(frozen=True, eq=False)
class _Phases:
    """`TimeSliced[ArrayPhases]` of a tracked recording."""

    of: Assembled
    array: AntennaArray
    gpst: Instants

    @property
    def receiver(self) -> str:
        return self.of.tracker.samples.name

    def select_between(self, begin_s: float, end_s: float) -> ArrayPhases:
        rows, tracker = self.of.rows_between(begin_s, end_s), self.of.tracker
        found = assemble_array_phases(
            self.receiver,
            tracker.measured.read(rows.start + 1, rows.stop + 1),
            self.of.arcs,
            self.of.elapsed_s[rows],
            self.gpst[rows],
            array=self.array,
            carrier_hz=tracker.receiver.settings.signal.carrier_hz,
            averaged_s=tracker.epoch_s,
        )
        return found.select_between(begin_s, end_s)
