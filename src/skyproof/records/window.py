"""Hold all that is known of one window."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from skyproof.gnss.ephemeris import NavigationData
from skyproof.records.correlations import Ccaf, Taps
from skyproof.records.findings import Finding
from skyproof.records.fixes import ConsistentSet
from skyproof.records.measurements import ArrayPhases, Observations, SnapshotChanges
from skyproof.records.needs import Need
from skyproof.records.platform import NavState, SpinArm
from skyproof.records.receiver_words import FrontEndLevels, ReceivedMessages, ReceiverFixes
from skyproof.short_repr import ShortRepr

__all__ = ["Holding", "Records"]


class Holding:
    """An object whose fields meet needs of the same names."""

    observations: tuple[Any, ...]

    def has(self, need: Need) -> bool:
        """Test whether it has what a detector needs."""
        if need is Need.TWO_RECEIVERS:
            return len({o.receiver for o in self.observations}) >= 2
        value = getattr(self, need)
        return value is not None and value != () and value != {}


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Records(ShortRepr, Holding):
    """All that is known of one window, for detectors to look at. A detector declares which of these it needs.

    sets : of each receiver, what was found in `observations`. taps, array_phases : of the receivers that have them.
    vector_taps : of receivers whose channels all follow one position. ccaf : correlation grids.
    nav_state : of the body that carries all antennas, by receiver, with the place of its antenna. spin_arms : of the
        receivers whose antenna turns. levels : of the front ends, own_fixes : that the receivers computed themselves,
        both by receiver. standing, inertial : what is expected of receivers that stand, and of those that an inertial
        unit carries, by receiver, each a `navigation.predictor.Predictor`. changes : within snapshots, by receiver.
    findings : of the window, by the detectors that come before. expected : what predicts the fixes of each receiver
    that is known to stand, or whose clock or inertial unit is known: a predictor, or the `fusion.corrected` navigator.
    apart_from : of each receiver, those that have another antenna by their noise.
    """

    start_gpst: np.datetime64
    end_gpst: np.datetime64
    observations: tuple[Observations, ...] = ()
    navigation: NavigationData | None = None
    sets: tuple[ConsistentSet, ...] = ()
    taps: tuple[Taps, ...] = ()
    vector_taps: tuple[Taps, ...] = ()
    ccaf: tuple[Ccaf, ...] = ()
    array_phases: tuple[ArrayPhases, ...] = ()
    nav_state: Mapping[str, NavState] = field(default_factory=dict)
    spin_arms: tuple[SpinArm, ...] = ()
    levels: Mapping[str, FrontEndLevels] = field(default_factory=dict)
    messages: Mapping[str, ReceivedMessages] = field(default_factory=dict)
    own_fixes: Mapping[str, ReceiverFixes] = field(default_factory=dict)
    standing: Mapping[str, Any] = field(default_factory=dict)
    inertial: Mapping[str, Any] = field(default_factory=dict)
    changes: Mapping[str, SnapshotChanges] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    expected: Mapping[str, Any] = field(default_factory=dict)
    apart_from: Mapping[str, frozenset[str]] = field(default_factory=dict)
