"""Compute ranges from satellites to moving points: times of flight solved exactly, many at once.

A satellite's place and clock are smooth: a cubic through knots of 10 s leaves micrometres (the fourth derivative of a
GPS orbit is 1e-8 m/s^4). What a receiver does is not smooth, so it stays outside of the cubic: for each instant the
light-time equation is solved with the place where the receiver's antenna really is.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike

from skyproof.arrays import Integers, Reals
from skyproof.compiled import compiled
from skyproof.gnss.constants import EARTH_ROTATION_RAD_S, SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import BroadcastEphemeris, group_delay_s
from skyproof.gnss.orbits import compute_satellite_state_s
from skyproof.gnss.time import week_and_tow

__all__ = ["FIRST_SIGNAL", "Orbits", "Sight", "fit_orbits"]

FIRST_SIGNAL = {"G": ("L1", "CA"), "E": ("E1", "C"), "C": ("B1", "2I"), "R": ("G1", "CA")}
"""Band and code, by system, of the signal whose delays a scene has."""
KNOT_S = 10.0
_EARLIEST_S = 0.2  # before reception; no signal is under way for longer
_FIRST_GUESS_S = 0.075
_CLOSE_S = 3e-12  # from one round to the next; each shrinks the error by the range rate over that of light, 3e-6


@dataclass(frozen=True, eq=False, kw_only=True)
class Sight:
    """What a point sees of n_sats satellites at n instants of reception.

    flight_s : (n, n_sats) time of flight in vacuum.
    toward : (n, n_sats, 3) unit vectors to the satellites as they stand in the ECEF frame of reception.
    clock_s : (n, n_sats) what each satellite's clock shows minus true time, at transmission.
    """

    flight_s: Reals
    toward: Reals
    clock_s: Reals


@dataclass(frozen=True, eq=False, kw_only=True)
class Orbits:
    """Places and clocks of satellites between two times, in seconds since a scenario's start.

    pieces : (n_pieces, n_sats, 4, 4) coefficients, highest power first, of x, y, z and clock.
    """

    sats: tuple[str, ...]
    first_s: float
    last_s: float
    pieces: Reals

    def compute_sight(self, received_s: ArrayLike, point_ecef_m: Reals, columns: Integers | None = None) -> Sight:
        """Compute what points (n, 3) see at times of reception (n,).

        columns : of the satellites wanted; all if absent.

        Raises ValueError if a time lies outside of `first_s` to `last_s`.
        """
        at_s = np.atleast_1d(np.asarray(received_s, np.float64))
        if at_s.size and not (at_s.min() >= self.first_s and at_s.max() <= self.last_s):
            raise ValueError(
                f"orbits from {self.first_s:g} to {self.last_s:g} s asked for {at_s.min():g} to {at_s.max():g} s"
            )
        wanted = np.arange(len(self.sats)) if columns is None else columns
        shape = at_s.size, wanted.size
        flight_s, clock_s, toward = np.empty(shape), np.empty(shape), np.empty((*shape, 3))
        points = np.broadcast_to(point_ecef_m, (at_s.size, 3))
        _solve(self.pieces, wanted, self.first_s - _EARLIEST_S, at_s, points, flight_s, toward, clock_s)
        return Sight(flight_s=flight_s, toward=toward, clock_s=clock_s)


def fit_orbits(
    ephemerides: Sequence[BroadcastEphemeris], start_gpst: np.datetime64, first_s: float, last_s: float
) -> Orbits:
    """Fit orbits by one ephemeris a satellite.

    The clock is that of a user of its system's first signal alone.

    That is the message's minus the group delay, of GPS on L1 (IS-GPS-200N, 20.3.3.3.3.2).
    """
    week, tow_s = week_and_tow(start_gpst)
    n_knots = max(math.ceil((last_s - first_s + _EARLIEST_S) / KNOT_S), 3) + 1
    knots_s = first_s - _EARLIEST_S + KNOT_S * np.arange(n_knots, dtype=np.float64)
    rows = np.empty((n_knots, len(ephemerides), 4))
    for column, ephemeris in enumerate(ephemerides):
        state = compute_satellite_state_s(ephemeris, week, tow_s + knots_s)
        rows[:, column, :3] = state.position_ecef_m
        rows[:, column, 3] = state.clock_s - group_delay_s(ephemeris, *FIRST_SIGNAL[ephemeris.sat[0]])
    pieces = np.moveaxis(scipy.interpolate.CubicSpline(knots_s, rows).c, 0, -1)
    return Orbits(
        sats=tuple(ephemeris.sat for ephemeris in ephemerides),
        first_s=first_s,
        last_s=last_s,
        pieces=np.ascontiguousarray(pieces),
    )


@compiled
def _solve(
    pieces: Reals,
    wanted: Integers,
    first_s: float,
    at_s: Reals,
    points: Reals,
    flight_s: Reals,
    toward: Reals,
    clock_s: Reals,
) -> None:
    last = pieces.shape[0] - 1
    for s in range(wanted.size):
        flight = _FIRST_GUESS_S
        for n in range(at_s.size):
            change = 1.0
            while abs(change) > _CLOSE_S:
                sent_s = at_s[n] - flight - first_s
                piece = min(max(int(sent_s / KNOT_S), 0), last)
                u = sent_s - piece * KNOT_S
                c = pieces[piece, wanted[s]]
                x = ((c[0, 0] * u + c[0, 1]) * u + c[0, 2]) * u + c[0, 3]
                y = ((c[1, 0] * u + c[1, 1]) * u + c[1, 2]) * u + c[1, 3]
                z = ((c[2, 0] * u + c[2, 1]) * u + c[2, 2]) * u + c[2, 3]
                turned = EARTH_ROTATION_RAD_S * flight  # 5 microradian: two terms are exact
                cosine = 1.0 - 0.5 * turned * turned
                dx = cosine * x + turned * y - points[n, 0]
                dy = cosine * y - turned * x - points[n, 1]
                dz = z - points[n, 2]
                away = math.sqrt(dx * dx + dy * dy + dz * dz)
                change = away / SPEED_OF_LIGHT_M_S - flight
                flight += change
            flight_s[n, s] = flight
            toward[n, s, 0], toward[n, s, 1], toward[n, s, 2] = dx / away, dy / away, dz / away
            clock_s[n, s] = ((c[3, 0] * u + c[3, 1]) * u + c[3, 2]) * u + c[3, 3]
