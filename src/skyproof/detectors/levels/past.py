"""Remember a receiver's levels, and estimate the common change of its signals."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from skyproof.arrays import Instants, Reals
from skyproof.detectors.levels.front_end import Gauge
from skyproof.detectors.levels.laws import Dip, OwnRate, OwnScale, SharedChange
from skyproof.detectors.levels.parts import WindowPart
from skyproof.records import SignalId

__all__ = ["LevelsPast", "OwnLevel", "SharedSeries", "Unit", "UnitChange"]

Unit = tuple[str, ...]
"""What is tested together: a carrier of all systems, or system, band and code."""


class OwnLevel(NamedTuple):
    """Own level of a signal: mean of so many windows, when it was seen last, and whether in the window before."""

    level_db: float
    windows: float
    seen_s: float
    fresh: bool = True


class SharedSeries(NamedTuple):
    """What satellites share, epoch by epoch, dB."""

    gpst: Instants
    change_db: Reals


@dataclass(frozen=True, kw_only=True)
class LevelsPast:
    """What is remembered of a receiver: a number a signal, a unit and a chain, and the series of one window.

    began_gpst : first epoch, or that at which interference ended that was there before. parts : the last two of the
    window; steps : scales of what changes about a part, of kinds and of chains.
    """

    end_s: float
    began_gpst: np.datetime64
    references: Mapping[SignalId, OwnLevel] = field(default_factory=dict)
    floors_db: Mapping[Unit, float] = field(default_factory=dict)
    scales: Mapping[Unit, OwnScale] = field(default_factory=dict)
    dips: Mapping[Unit, OwnScale] = field(default_factory=dict)
    slopes: Mapping[Unit, OwnScale] = field(default_factory=dict)
    rates: Mapping[Unit, OwnRate] = field(default_factory=dict)
    series: Mapping[Unit, SharedSeries] = field(default_factory=dict)
    gauges: Mapping[tuple[str, str], Gauge] = field(default_factory=dict)
    interfered: Mapping[str, float] = field(default_factory=dict)
    parts: tuple[WindowPart, ...] = ()
    steps: Mapping[Unit, OwnScale] = field(default_factory=dict)
    odd: bool = False


class UnitChange(NamedTuple):
    """What a unit's satellites share, its statistic over its sigma, and how many signals were lost.

    fall, rise : chance of a change so far down or up. losses : of so many lost signals. fall_db : estimated without
    what is lost, where enough is left. dip : the lowest part of the window; fall_in_part : the chance of it;
    lost_in_dip : signals that it takes.
    """

    unit: Unit
    columns: tuple[int, ...]
    common: SharedChange
    statistic: float
    fall: float
    rise: float
    losses: float
    lost: int
    fall_db: float
    series: SharedSeries
    dip: Dip
    fall_in_part: float
    lost_in_dip: int

    @property
    def noise(self) -> float:
        """Return the chance of falls and losses at least so large (union bound, a twentieth of it for parts)."""
        return min(1.0, 2.1 * min(self.fall, self.losses), 21.0 * self.fall_in_part)

    @property
    def short(self) -> bool:
        """Tell whether a part of the window is less probable than the whole of it."""
        return 10.0 * self.fall_in_part < min(self.fall, self.losses)

    @property
    def lasting_db(self) -> float:
        """Return the fall, dB."""
        return -self.dip.change_db if self.short else -self.common.change_db
