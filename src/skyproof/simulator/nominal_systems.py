"""Galileo, BeiDou and GLONASS beside the nominal GPS: Walker constellations for any date, each slot filled.

Orbits are circles of the published size and inclination. Galileo: 24/3/1, OS SDD 1.3, annex D. BeiDou: the 24/3/1 of
its medium orbits, BDS-SIS-ICD-B1I-3.0, 3.1. GLONASS: 24/3/1, ICD L1, L2 5.1, 1.2. Clocks and group delays differ from
satellite to satellite, within what is usual.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from skyproof.arrays import Reals
from skyproof.gnss.constants import EARTH_ROTATION_RAD_S, GLONASS_EARTH_ROTATION_RAD_S, GLONASS_MU_M3_S2
from skyproof.gnss.ephemeris import Ephemeris, GlonassEphemeris, NavigationData, system_offset_s
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.time import gpst as instant
from skyproof.gnss.time import seconds_between, week_and_tow

__all__ = ["make_nominal_systems"]

_EPOCH: Final = np.datetime64("2020-01-01T00:00:00", "ns")
_TOE_STEP_S: Final = 1800.0
_PLANES: Final = 3
_SATS: Final = 24
_CHANNELS: Final = (1, -4, 5, 6, 1, -4, 5, 6)  # of a plane's slots: opposite satellites share one


@dataclass(frozen=True)
class _Walker:
    """Radius, inclination, mu, and the node of the first plane from Greenwich at the epoch."""

    a_m: float
    inclination_deg: float
    mu_m3_s2: float
    node_deg: float
    message: str


_WALKER: Final = {
    "E": _Walker(29_599_800.0, 56.0, 3.986004418e14, 20.0, "INAV"),
    "C": _Walker(27_906_100.0, 55.0, 3.986004418e14, 70.0, "D1"),
}
_GLONASS: Final = _Walker(25_508_000.0, 64.8, GLONASS_MU_M3_S2, 45.0, "")


def make_nominal_systems(gpst: np.datetime64, systems: str = "GECR") -> NavigationData:
    """Make ephemerides of the nominal constellations of these systems around `gpst`, any date.

    Satellites are E01 to E24 and so on.

    Time of ephemeris is the full half hour nearest to `gpst` (of GPS the two hours); neighbouring sets of Galileo and
    BeiDou lie on one orbit, those of GLONASS nearly, as they have no further harmonics than its model.
    """
    gps = make_nominal_constellation(gpst)
    like = next(e for e in gps.ephemerides if isinstance(e, Ephemeris))
    week, tow_s = week_and_tow(gpst)
    toe = instant(week, round(tow_s / _TOE_STEP_S) * _TOE_STEP_S)
    found = list(gps.ephemerides) if "G" in systems else []
    for system in "EC":
        if system in systems:
            found += [_make_kepler(system, number, toe, like) for number in range(_SATS)]
    if "R" in systems:
        found += [_state(number, toe) for number in range(_SATS)]
    return replace(gps, ephemerides=tuple(found), source="nominal constellations")


def _compute_slot(walker: _Walker, number: int) -> tuple[float, float]:
    """Return node and argument of latitude at the epoch, rad."""
    plane, place = divmod(number, _SATS // _PLANES)
    node_rad = np.radians(walker.node_deg) + plane * 2.0 * np.pi / _PLANES
    return float(node_rad), float(2.0 * np.pi * (place * _PLANES + plane) / _SATS)


def _make_kepler(system: str, number: int, toe: np.datetime64, like: Ephemeris) -> Ephemeris:
    walker, (node_rad, u_rad) = _WALKER[system], _compute_slot(_WALKER[system], number)
    sat = f"{system}{number + 1:02d}"
    week, toe_s = week_and_tow(toe - np.timedelta64(round(system_offset_s(sat)), "s"))
    since_s = float(seconds_between(toe, _EPOCH))
    motion_rad_s = (walker.mu_m3_s2 / walker.a_m**3) ** 0.5
    return replace(
        like,
        sat=sat,
        week=week,
        toe=toe_s,
        toc_week=week,
        toc=toe_s,
        af0=((number * 7) % 23 - 11) * 2e-5,
        af1=0.0,
        tgd=((number * 5) % 17 - 8) * 1e-9,
        tgd2=((number * 11) % 19 - 9) * 1e-9,
        sqrt_a=walker.a_m**0.5,
        e=0.0,
        i0=float(np.radians(walker.inclination_deg)),
        omega0=_wrap(node_rad - EARTH_ROTATION_RAD_S * since_s + EARTH_ROTATION_RAD_S * toe_s),
        omega=0.0,
        m0=_wrap(u_rad + motion_rad_s * since_s),
        delta_n=0.0,
        omega_dot=0.0,
        message=walker.message,
    )


def _state(number: int, toe: np.datetime64) -> GlonassEphemeris:
    node_rad, u_rad = _compute_slot(_GLONASS, number)
    week, toe_s = week_and_tow(toe)
    since_s = float(seconds_between(toe, _EPOCH))
    motion_rad_s = (_GLONASS.mu_m3_s2 / _GLONASS.a_m**3) ** 0.5
    node, u = node_rad - GLONASS_EARTH_ROTATION_RAD_S * since_s, u_rad + motion_rad_s * since_s
    tilt = np.radians(_GLONASS.inclination_deg)
    out = np.array([np.cos(node), np.sin(node), 0.0])
    up = np.array([-np.sin(node) * np.cos(tilt), np.cos(node) * np.cos(tilt), np.sin(tilt)])
    position = _GLONASS.a_m * (np.cos(u) * out + np.sin(u) * up)
    inertial = _GLONASS.a_m * motion_rad_s * (np.cos(u) * up - np.sin(u) * out)
    turning = GLONASS_EARTH_ROTATION_RAD_S * np.array([-position[1], position[0], 0.0])
    return GlonassEphemeris(
        sat=f"R{number + 1:02d}",
        week=week,
        toe=toe_s,
        tau_n=((number * 7) % 23 - 11) * 1e-5,
        gamma_n=0.0,
        frequency_number=_CHANNELS[number % 8],
        position_m=_split_vector(position),
        velocity_m_s=_split_vector(inertial - turning),
        acceleration_m_s2=(0.0, 0.0, 0.0),
        delta_tau_n=((number * 3) % 11 - 5) * 1e-9,
    )


def _split_vector(vector: Reals) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return x, y, z


def _wrap(angle_rad: float) -> float:
    return float((angle_rad + np.pi) % (2.0 * np.pi) - np.pi)
