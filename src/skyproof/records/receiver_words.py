"""Hold what a receiver says beside its measurements: levels, its own fixes, broadcast messages."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Instants, Integers, Reals
from skyproof.gnss.ephemeris import BroadcastEphemeris, UtcStatement
from skyproof.gnss.frames import ecef_from_geodetic, rot_enu_ecef
from skyproof.records.shapes import Selectable, freeze
from skyproof.short_repr import ShortRepr

__all__ = [
    "FrontEndLevels",
    "ReceivedMessages",
    "ReceiverFixes",
]


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class FrontEndLevels(ShortRepr, Selectable):
    """Levels that the receiver measured in its front end; NaN where it gives none.

    gpst : (n,). band : (n,) text, such as "L1", "L2L5", or a receiver's own name of the chain. agc_db : (n,) gain of
    the amplifier in decibels, of arbitrary zero, falling when the input grows; agc_share : (n,) the same as a share
    of full scale, 0 to 1, where only that is known. noise_db : (n,) power of the samples, decibels of arbitrary zero.
    jamming_share : (n,) the receiver's indicator of continuous waves, 0 to 1.
    """

    gpst: Instants
    band: NDArray[np.str_]
    agc_db: Reals
    agc_share: Reals
    noise_db: Reals
    jamming_share: Reals

    def __post_init__(self) -> None:
        names = ("gpst", "band", "agc_db", "agc_share", "noise_db", "jamming_share")
        freeze(self, dict.fromkeys(names, ("row",)))


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ReceiverFixes(ShortRepr, Selectable):
    """Positions, velocities and clocks that the receiver computed itself; NaN where it gives none.

    gpst : (n,) of the fix. position_ecef_m, velocity_ecef_m_s : (n, 3). horizontal_sigma_m, vertical_sigma_m : (n,) as
    the receiver states its accuracy, one sigma. clock_bias_s, clock_drift : (n,) receiver minus GPS time, s and s/s.
    satellites : (n,) used, -1 where not known.
    """

    gpst: Instants
    position_ecef_m: Reals
    velocity_ecef_m_s: Reals
    horizontal_sigma_m: Reals
    vertical_sigma_m: Reals
    clock_bias_s: Reals
    clock_drift: Reals
    satellites: Integers

    def __post_init__(self) -> None:
        row = dict.fromkeys(
            ("gpst", "horizontal_sigma_m", "vertical_sigma_m", "clock_bias_s", "clock_drift", "satellites"), ("fix",)
        )
        freeze(self, row | dict.fromkeys(("position_ecef_m", "velocity_ecef_m_s"), ("fix", "3")))

    @classmethod
    def from_geodetic(
        cls,
        gpst: Instants,
        lat_rad: Reals,
        lon_rad: Reals,
        height_m: Reals,
        *,
        velocity_enu_m_s: Reals | None = None,
        **given: NDArray[Any],
    ) -> "ReceiverFixes":
        """Make fixes of latitude, longitude and height above the ellipsoid; what is not given is not known.

        velocity_enu_m_s : (n, 3) to the east, the north and upwards. given : any other field.
        """
        unknown = np.full(gpst.size, np.nan)
        fields: dict[str, Any] = {
            "velocity_ecef_m_s": np.full((gpst.size, 3), np.nan),
            "horizontal_sigma_m": unknown,
            "vertical_sigma_m": unknown,
            "clock_bias_s": unknown,
            "clock_drift": unknown,
            "satellites": np.full(gpst.size, -1, np.int64),
        }
        if velocity_enu_m_s is not None:
            rotation = np.swapaxes(rot_enu_ecef(lat_rad, lon_rad), -1, -2)
            fields["velocity_ecef_m_s"] = (rotation @ velocity_enu_m_s[:, :, None])[:, :, 0]
        return cls(gpst=gpst, position_ecef_m=ecef_from_geodetic(lat_rad, lon_rad, height_m), **(fields | given))


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ReceivedMessages(ShortRepr):
    """Broadcast messages of one receiver's signals, as they came.

    gpst : (n,) when each of the data sets was whole, by the receiver's clock; ephemerides : n of them, without those
    that repeat the last one of their satellite and message. mistimed_gpst : (m,) when a message said another time of
    week than the receiver's clock; mistimed_sat : m satellites that sent them. utc_gpst : (k,) when a satellite said
    what of UTC; utc : k of these, without those that repeat its last one.
    """

    gpst: Instants
    ephemerides: tuple[BroadcastEphemeris, ...]
    mistimed_gpst: Instants
    mistimed_sat: tuple[str, ...]
    utc_gpst: Instants = field(default_factory=lambda: np.empty(0, "M8[ns]"))
    utc: tuple[UtcStatement, ...] = ()

    def select_between(self, start_gpst: np.datetime64, end_gpst: np.datetime64) -> "ReceivedMessages":
        """Return what has start <= time < end."""
        rows = np.flatnonzero((self.gpst >= start_gpst) & (self.gpst < end_gpst))
        times = np.flatnonzero((self.mistimed_gpst >= start_gpst) & (self.mistimed_gpst < end_gpst))
        stated = np.flatnonzero((self.utc_gpst >= start_gpst) & (self.utc_gpst < end_gpst))
        return ReceivedMessages(
            gpst=self.gpst[rows],
            ephemerides=tuple(self.ephemerides[k] for k in rows),
            mistimed_gpst=self.mistimed_gpst[times],
            mistimed_sat=tuple(self.mistimed_sat[k] for k in times),
            utc_gpst=self.utc_gpst[stated],
            utc=tuple(self.utc[k] for k in stated),
        )
