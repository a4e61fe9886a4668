"""Hold positions and clocks: of one set of signals over time, and of a set that fits one position."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Instants, Reals
from skyproof.records.shapes import Selectable, freeze
from skyproof.records.signals import SignalId
from skyproof.short_repr import ShortRepr

__all__ = [
    "FIX_STATUS",
    "ConsistentSet",
    "Fix",
    "FixStatus",
]


class FixStatus(IntEnum):
    """The status of an epoch of a `Fix`. Only `OK` has numbers; the others NaN."""

    OK = 0
    TOO_FEW = 1
    WEAK_GEOMETRY = 2
    NOT_CONVERGED = 3
    MISFIT = 4
    OFF_EARTH = 5
    UNCHECKED = 6


FIX_STATUS: dict[int, str] = {
    FixStatus.OK: "ok",
    FixStatus.TOO_FEW: "fewer than four satellites with an ephemeris",
    FixStatus.WEAK_GEOMETRY: "geometry too weak",
    FixStatus.NOT_CONVERGED: "did not converge",
    FixStatus.MISFIT: "residuals that fit no one position",
    FixStatus.OFF_EARTH: "off the Earth, by as few satellites as unknowns",
    FixStatus.UNCHECKED: "no protection level: an alarm, or a satellite that no other checks",
}
"""A `FixStatus` in words."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Fix(ShortRepr, Selectable):
    """Position, velocity and clock of one receiver from one set of signals, epoch by epoch.

    gpst : (n_epochs,) true time of reception (the clock bias is taken off), to the nanosecond.
    clock_bias_s : what the receiver's clock shows minus what the signals' time says.
    covariance_m2 : (n_epochs, 4, 4) of ECEF position and c times clock bias.
    residual_m : (n_epochs, n_signals) measured minus modelled pseudorange, NaN where not used.
    status : (n_epochs,) uint8, see FixStatus; NaN in the numbers unless 0.
    inter_system_s : time scale ("G", "E", "C", "R") to (n_epochs,), the clock bias by its signals minus
        `clock_bias_s`; NaN where it has none. Zero for the scale that the clock bias refers to: the first of G, E, C, R
        that is there. Empty from sources that do not state it.
    protection_m : (n_epochs, 2) horizontal and vertical protection level, see `navigation.protection`; NaN where none
        is promised. By default none is at any epoch.
    hidden_m : (n_epochs,) by how much more an attack may have moved the position that the tests would have missed; NaN
        where nothing bounds that. By default nothing does at any epoch.
    """

    BY_ROW = (
        "gpst",
        "position_ecef_m",
        "velocity_ecef_m_s",
        "clock_bias_s",
        "clock_drift",
        "covariance_m2",
        "residual_m",
        "status",
        "inter_system_s",
        "protection_m",
        "hidden_m",
    )

    receiver: str
    signals: tuple[SignalId, ...]
    gpst: Instants
    position_ecef_m: Reals
    velocity_ecef_m_s: Reals
    clock_bias_s: Reals
    clock_drift: Reals
    covariance_m2: Reals
    residual_m: Reals
    status: NDArray[np.uint8]
    inter_system_s: Mapping[str, Reals] = field(default_factory=dict)
    protection_m: Reals = field(default_factory=lambda: np.full(2, np.nan))
    hidden_m: Reals = field(default_factory=lambda: np.array(np.nan))

    def __post_init__(self) -> None:
        if self.protection_m.ndim == 1:  # the same at every epoch
            object.__setattr__(self, "protection_m", np.broadcast_to(self.protection_m, (len(self.gpst), 2)))
        if self.hidden_m.ndim == 0:
            object.__setattr__(self, "hidden_m", np.broadcast_to(self.hidden_m, (len(self.gpst),)))
        freeze(
            self,
            {
                "gpst": ("epoch",),
                "position_ecef_m": ("epoch", "3"),
                "velocity_ecef_m_s": ("epoch", "3"),
                "clock_bias_s": ("epoch",),
                "clock_drift": ("epoch",),
                "covariance_m2": ("epoch", "4", "4"),
                "residual_m": ("epoch", "signal"),
                "status": ("epoch",),
                "protection_m": ("epoch", "2"),
                "hidden_m": ("epoch",),
            },
        )


@dataclass(frozen=True, eq=False, kw_only=True, repr=False, slots=True)
class ConsistentSet(ShortRepr):
    """Signals of one receiver, at most one per transmission, that together fit one position in one window, and a clock
    for each kind of signal (`SignalId.kind`).

    The set proves no authenticity: a meaconed sky is as consistent as the true one.
    clock_bias_s : by the kind of most of those on a first band; offsets_s : kind to its clock bias minus that
        one, so what time scales and the ways through the receiver differ by. Empty where one kind is all.
    statistic : the sum of squared normalised residuals, chi-square with `dof` degrees if the set is consistent.
    """

    receiver: str
    signals: tuple[SignalId, ...]
    gpst: np.datetime64  # middle of the window
    position_ecef_m: Reals  # (3,)
    clock_bias_s: float
    covariance_m2: Reals  # (4, 4)
    statistic: float
    dof: int
    p_value: float
    offsets_s: Mapping[tuple[str, str, str], float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        freeze(self, {"position_ecef_m": ("3",), "covariance_m2": ("4", "4")})

    def clock_of_s(self, kind: tuple[str, str, str]) -> float:
        """Return the clock bias by one kind of signal; NaN where the set has none of it."""
        if any(signal.kind == kind for signal in self.signals):
            return self.clock_bias_s + self.offsets_s.get(kind, 0.0)
        return float("nan")
