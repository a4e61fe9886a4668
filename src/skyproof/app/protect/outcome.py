"""Everything that a run found out, and its inputs as they were read."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final, get_args

import numpy as np

from skyproof.app.protect.bearings import Bearing, find_bearings
from skyproof.app.protect.positions import KINDS, Positions, SatelliteKind, Track
from skyproof.app.receive.reception import Reception
from skyproof.arrays import Booleans
from skyproof.detectors.prediction.choice import Compared
from skyproof.fusion.consistent import Rest
from skyproof.fusion.fuse import Decision
from skyproof.records import (
    ConsistentSet,
    Finding,
    Fix,
    NavigationData,
)
from skyproof.remarks import Remark, RemarkKind
from skyproof.short_repr import ShortRepr
from skyproof.verdict import USABLE, InputFile

__all__ = ["DIGITS", "InputNote", "Outcome", "ReceiverOutcome"]


DIGITS: Final = 6
"""Of a second in instants."""


@dataclass(frozen=True, kw_only=True)
class InputNote:
    """One input as it was read. remarks : of any kind (`records.Remark`)."""

    path: str
    format: str
    sha256: str | None
    remarks: tuple[str, ...]

    def of_kind(self, kind: RemarkKind) -> tuple[str, ...]:
        """Select the remarks of a kind, as plain text."""
        return tuple(str(remark) for remark in self.remarks if Remark.kind_of(remark) is kind)

    def file(self) -> InputFile:
        """Make the row of the document."""
        return InputFile(
            path=self.path,
            format=self.format,
            sha256=self.sha256,
            cut=self.of_kind(RemarkKind.CUT),
            left_out=self.of_kind(RemarkKind.BEARS),
            remarks=self.of_kind(RemarkKind.NOTE),
        )


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ReceiverOutcome(ShortRepr):
    """One receiver's positions by kind (`positions.KINDS`, or the name of a source or of one of two open skies).

    tracks : those that have a fix, in the order of `KINDS`.
    """

    reception: Reception
    positions: Positions | None = None
    tracks: Mapping[str, Track] = field(default_factory=dict)

    @property
    def shown(self) -> dict[str, Track]:
        """Return the tracks that sources of false signals or open skies show, by their names."""
        return {name: track for name, track in self.tracks.items() if name not in KINDS}

    @property
    def usable(self) -> Track | None:
        """Return the track of the first kind that a user may use; None if there is none."""
        return next((self.tracks[kind] for kind in USABLE if kind in self.tracks), None)

    @property
    def fixed_by_satellites(self) -> Booleans:
        """Return at which epochs (n_epochs,) there is a trusted or a consistent fix."""
        assert self.positions is not None
        found = np.zeros(self.positions.log.gpst.size, np.bool_)
        for kind in get_args(SatelliteKind):
            found |= self.tracks[kind].fixed if kind in self.tracks else False
        return found

    @property
    def has_rest_fixes(self) -> bool:
        """Tell whether there are fixes of the signals beside named false ones."""
        track = self.tracks.get("consistent")
        if track is None or self.positions is None or self.positions.consistent is None:
            return False
        behind = False if self.positions.behind_null is None else self.positions.behind_null.epochs
        return bool((track.fixed & self.positions.consistent().of_rest & ~np.asarray(behind)).any())

    @property
    def has_fixes_behind_null(self) -> bool:
        """Tell whether there are fixes of an array behind a null."""
        behind = None if self.positions is None else self.positions.behind_null
        return behind is not None and bool(behind.epochs.any())

    @cached_property
    def trusted(self) -> Fix | None:
        """Return all fixes from authentic signals; None if there is none."""
        return None if self.positions is None else self.positions.whole("trusted")


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Outcome(ShortRepr):
    """Everything that a run found out.

    sets : in the order of their windows. compared : skies beside what was expected, of receivers that had two. rest :
        what is decided of the signals beside named false ones; None without any.
    """

    receivers: tuple[ReceiverOutcome, ...]
    decision: Decision
    evidence: Sequence[Finding]
    sets: Sequence[ConsistentSet]
    navigation: NavigationData
    compared: tuple[Compared, ...] = ()
    rest: Rest | None = None

    @cached_property
    def bearings(self) -> Mapping[str, Bearing]:
        """Return the bearings of sources that are seen from trusted places, by their names."""
        trusted = {r.reception.source.name: r.tracks["trusted"] for r in self.receivers if "trusted" in r.tracks}
        return {
            bearing.source.name: bearing for bearing in find_bearings(self.decision.sources, self.evidence, trusted)
        }
