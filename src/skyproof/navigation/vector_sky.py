"""Compute the satellites of a vector receiver some seconds ahead: many epochs cost as much as one."""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from skyproof.arrays import Instants, Reals
from skyproof.gnss.constants import EARTH_ROTATION_RAD_S, SPEED_OF_LIGHT_M_S
from skyproof.gnss.sky import rotate_to_reception
from skyproof.gnss.time import week_and_tow
from skyproof.navigation.least_squares import compute_line_of_sight
from skyproof.navigation.ranges import compute_atmosphere, correct_ranges
from skyproof.records import NavigationData, SignalId

__all__ = ["SkyAhead", "SkyEpoch", "compute_sky_ahead"]

_DELAYS_STEP: Final = 8
"""Epochs for which one value of the delays on the way does: a centimetre in two seconds, of a satellite that rises."""


class SkyEpoch(NamedTuple):
    """The satellites' side of one epoch, (k,) each, NaN without an orbit.

    satellite_ecef_m : (k, 3) at transmission, in its frame. offset_m : to be added to a pseudorange to have a range:
    satellite's clock and group delay, and less the delays on the way. delay_sigma_m : what the models leave of these.
    moving, along_m_s, drift_gain, satellite_drift : of the rates, see `fix.compute_range_rates`: 1 + (along +
    turning)/c, along, their factor of the receiver's drift, and the satellite clock's own.
    """

    satellite_ecef_m: Reals
    offset_m: Reals
    delay_sigma_m: Reals
    moving: Reals
    along_m_s: Reals
    drift_gain: Reals
    satellite_drift: Reals


@dataclass(frozen=True, eq=False, kw_only=True)
class SkyAhead:
    """`SkyEpoch` of epochs (n,) of receiver time, each array with the epochs before."""

    signals: tuple[SignalId, ...]
    elapsed_s: Reals
    of: SkyEpoch

    def at(self, elapsed_s: float) -> SkyEpoch | None:
        """Select one epoch; None if it is not among them."""
        row = int(np.argmin(np.abs(self.elapsed_s - elapsed_s)))
        if abs(self.elapsed_s[row] - elapsed_s) > 1e-6:
            return None
        return SkyEpoch(*(array[row] for array in self.of))


def compute_sky_ahead(
    signals: tuple[SignalId, ...],
    elapsed_s: Reals,
    gpst: Instants,
    pseudorange_m: Reals,
    rate_m_s: Reals,
    place_ecef_m: Reals,
    navigation: NavigationData,
) -> SkyAhead:
    """Compute the satellites at epochs (n,) with labels `gpst` (n,), of one frequency.

    pseudorange_m, rate_m_s : (k,) at the first epoch and its change, roughly: an error of a kilometre moves a satellite
        by a centimetre. place_ecef_m : (3,) of the receiver, to 100 m.
    """
    rough_m = pseudorange_m + rate_m_s * (elapsed_s - elapsed_s[0])[:, None]
    ranges = correct_ranges(signals, gpst, rough_m, navigation)
    satellite, unit, distance_m = compute_line_of_sight(ranges.satellite_ecef_m, place_ecef_m)
    _, tow_s = week_and_tow(gpst)
    some = np.arange(0, elapsed_s.size, _DELAYS_STEP)
    delays = compute_atmosphere(
        np.broadcast_to(place_ecef_m, (some.size, 3)), satellite[some], tow_s[some], navigation.ionosphere
    )
    of = np.arange(elapsed_s.size) // _DELAYS_STEP
    c = SPEED_OF_LIGHT_M_S
    velocity = rotate_to_reception(ranges.satellite_velocity_ecef_m_s, distance_m / c)
    turning = EARTH_ROTATION_RAD_S * (satellite[..., 0] * unit[..., 1] - satellite[..., 1] * unit[..., 0])
    along = np.sum(unit * velocity, axis=-1)
    moving = 1.0 + (along + turning) / c
    return SkyAhead(
        signals=signals,
        elapsed_s=elapsed_s,
        of=SkyEpoch(
            satellite_ecef_m=ranges.satellite_ecef_m,
            offset_m=ranges.range_m - rough_m - delays.delay_m[of],
            delay_sigma_m=delays.sigma_m[of],
            moving=moving,
            along_m_s=along,
            drift_gain=moving * (1.0 - rate_m_s / c),
            satellite_drift=ranges.satellite_drift,
        ),
    )
