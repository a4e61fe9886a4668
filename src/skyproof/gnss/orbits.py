"""Compute position, velocity and clock of a satellite from its broadcast ephemeris."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Instants, Reals
from skyproof.gnss.ephemeris import BroadcastEphemeris
from skyproof.gnss.orbit_kernels import fill_states, fill_states_at
from skyproof.gnss.orbit_rows import N_ORBIT, N_STATE
from skyproof.gnss.time import gpst as instant
from skyproof.gnss.time import seconds_between, week_and_tow

__all__ = ["SatelliteState", "compute_satellite_positions_m", "compute_satellite_state", "compute_satellite_state_s"]


@dataclass(frozen=True, eq=False, kw_only=True)
class SatelliteState:
    """State of one satellite at instants of shape (...).

    position_ecef_m, velocity_ecef_m_s : (..., 3) in the ECEF frame of each instant. The systems' own frames (PZ-90.11,
        GTRF, BDCS) count as WGS-84: they agree to centimetres.
    clock_s : (...) satellite clock minus its system's time (BDT and GLONASS time as their whole seconds are counted),
        with the relativistic term, without group delay: what a user of one signal corrects with is
        `clock_s - group_delay_s(...)`. Systems differ by tens of nanoseconds: each needs a receiver clock of its own.
    clock_drift : (...) its rate, s/s.
    """

    position_ecef_m: Reals
    velocity_ecef_m_s: Reals
    clock_s: Reals
    clock_drift: Reals


def compute_satellite_state(ephemeris: BroadcastEphemeris, gpst: Instants | np.datetime64) -> SatelliteState:
    """Compute the state at GPS instants `gpst` (...), which are times of transmission.

    IS-GPS-200N, 20.3.3.3.3.1, 20.3.3.4.3; Galileo OS SIS ICD 2.1, 5.1.1; BDS-SIS-ICD-B1I-3.0, 5.2.4.12; GLONASS ICD
    L1, L2 5.1, A.3.1.2.
    """
    since_week_s = np.asarray(seconds_between(gpst, instant(ephemeris.week, 0.0)))
    return compute_satellite_state_s(ephemeris, ephemeris.week, since_week_s)


def compute_satellite_state_s(ephemeris: BroadcastEphemeris, week: ArrayLike, tow_s: ArrayLike) -> SatelliteState:
    """Compute the state for full GPS weeks and float64 seconds of week (also beyond its ends); shapes broadcast."""
    weeks, seconds = np.broadcast_arrays(np.asarray(week, np.int64), np.asarray(tow_s, np.float64))
    states = np.empty((seconds.size, N_STATE))
    fill_states(ephemeris.orbit_row, weeks.ravel(), seconds.ravel(), states)
    states = states.reshape(*seconds.shape, N_STATE)
    return SatelliteState(
        position_ecef_m=states[..., :3],
        velocity_ecef_m_s=states[..., 3:6],
        clock_s=states[..., 6],
        clock_drift=states[..., 7],
    )


def compute_satellite_positions_m(ephemerides: Sequence[BroadcastEphemeris], gpst: np.datetime64) -> Reals:
    """Compute positions (k, 3) of several satellites at one instant of transmission, ECEF of that instant."""
    states = np.empty((len(ephemerides), N_STATE))
    rows = np.array([ephemeris.orbit_row for ephemeris in ephemerides]).reshape(-1, N_ORBIT)
    fill_states_at(rows, *week_and_tow(gpst), states)
    return states[:, :3]
