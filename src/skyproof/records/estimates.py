"""Hold what detectors estimate beside their tests: directions, baselines, second skies, interference."""

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from skyproof.arrays import Reals
from skyproof.records.fixes import ConsistentSet
from skyproof.records.shapes import freeze
from skyproof.short_repr import ShortRepr

__all__ = [
    "NOTICED",
    "Baseline",
    "Direction",
    "InterferenceSign",
    "NoiseRise",
    "NoticedAttack",
    "NoticedKind",
    "OverlappingSkies",
    "WeakStart",
]


NoticedKind = Literal[
    "position_jump",
    "clock_jump",
    "velocity_jump",
    "clock_push",
    "code_drag",
    "motion",
    "drag",
    "displacement",
    "one_transmitter",
    "elsewhere",
]
"""What an attack may do to a receiver, and what it is measured in.

position_jump : the position jumps, m. clock_jump : the time jumps, s. velocity_jump : codes and carriers together begin
to drag the position off at once, m/s. clock_push : they begin to push the time at once, s/s. code_drag : codes drag the
position off while carriers stay, m/s. motion : carriers move a receiver that is stated to stand, m/s. drag : the
position of a receiver with an inertial unit is dragged off, by codes alone or with their carriers, m/s. displacement :
the position of a receiver that stands is moved by any motion, m. one_transmitter : an antenna imitates so many
satellites, 1. elsewhere : one false signal, which no reflection explains, comes from so far beside its satellite, rad.
"""


NOTICED: Final = 0.99
"""Probability with which an attack of the size that a finding gives is noticed."""


@dataclass(frozen=True)
class NoticedAttack:
    """The size from which on a test would have noticed an attack of a kind, with probability `NOTICED`; SI unit."""

    kind: NoticedKind
    size: float


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Direction(ShortRepr):
    """Where a signal comes from, as seen from the antenna, radians.

    azimuth_rad : from north by east, or in the body frame from forward to the right. elevation_rad : above the horizon,
        or above the body's plane of forward and right.
    covariance_rad2 : (2, 2) of the angles between the estimate and the truth, along the horizon to where the azimuth
        grows, and upwards.
    """

    azimuth_rad: float
    elevation_rad: float
    covariance_rad2: Reals
    frame: Literal["enu", "body"]

    def __post_init__(self) -> None:
        freeze(self, {"covariance_rad2": ("2", "2")})

    @property
    def sigma_rad(self) -> float:
        """Return one sigma of each of the two angles, root mean square."""
        return float(np.sqrt(0.5 * np.trace(self.covariance_rad2)))


@dataclass(frozen=True, eq=False, kw_only=True, repr=False, slots=True)
class Baseline(ShortRepr):
    """Where these receivers' antennas stand relative to the first one, by what their signals show over a stretch.

    enu_m : (R - 1, 3) east, north, up, metres; covariance_m2 : (3 (R - 1), 3 (R - 1)), thermal noise and multipath.
    """

    receivers: tuple[str, ...]
    start_gpst: np.datetime64
    end_gpst: np.datetime64
    enu_m: Reals
    covariance_m2: Reals

    def __post_init__(self) -> None:
        freeze(self, {"enu_m": ("other", "3"), "covariance_m2": ("axis", "axis")})

    @property
    def distances_m(self) -> tuple[tuple[float, float], ...]:
        """Return each receiver's distance of its antenna from the first one, and its sigma, metres."""
        away = [float(np.linalg.norm(enu_m)) for enu_m in self.enu_m]
        blocks = [self.covariance_m2[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] for k in range(len(self.enu_m))]
        units = self.enu_m / np.maximum(away, 1e-9)[:, None]
        return tuple((d, float(np.sqrt(u @ c @ u))) for d, u, c in zip(away, units, blocks, strict=True))


@dataclass(frozen=True, eq=False, kw_only=True, repr=False, slots=True)
class OverlappingSkies(ShortRepr):
    """Skies in signals of one receiver that overlap within a chip, taken apart at one instant; one is true at most.

    sets : what each shows; their `signals` are the channels that it was found in. doubt : bound of the probability that
    these are not the skies, under the model of the signals. reflected : of each set, bound of the probability that its
    signals or the others' are so, if one sky made all by reflections and this set is taken for the true one.
    """

    sets: tuple[ConsistentSet, ...]
    doubt: float
    reflected: tuple[float, ...]


InterferenceSign = Literal["cn0", "lost", "level"]
"""What interference shows by: C/N0 that falls, signals that are lost, the level of the front end that rises."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False, slots=True)
class NoiseRise(ShortRepr):
    """Interference on one carrier of a receiver: C/N0 of all its signals falls alike.

    carrier : by GPS's name where systems share one, "L1". from_gpst, to_gpst : first and last epoch that show it.
    fall_db, sigma_db : of C/N0, and its one sigma; a lower bound where most signals are lost. level_db : by which the
    front end takes in more power, and level_sigma_db; None where that is not known. lost : signals that are lost.
    may_be_shade : nothing tells it from shade of the whole antenna.
    """

    receiver: str
    carrier: str
    from_gpst: np.datetime64
    to_gpst: np.datetime64
    fall_db: float
    sigma_db: float
    level_db: float | None
    lost: int
    signs: tuple[InterferenceSign, ...]
    may_be_shade: bool
    level_sigma_db: float | None = None


@dataclass(frozen=True, eq=False, kw_only=True, repr=False, slots=True)
class WeakStart(ShortRepr):
    """Signals that are weaker from a log's first window on than satellites under an open sky are.

    Noise from outside, shade and a poor antenna do so alike. carrier : by GPS's name where systems share one.
    from_gpst : first epoch. cn0_dbhz : median of the satellites. least_dbhz : what an open sky gives at least.
    """

    receiver: str
    carrier: str
    from_gpst: np.datetime64
    cn0_dbhz: float
    least_dbhz: float
