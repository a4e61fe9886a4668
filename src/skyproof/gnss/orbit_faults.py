"""Find orbits, clocks and ionospheres that no satellite broadcasts: beyond a field's range, or impossible to fly.

A navigation file that was edited, converted wrongly or damaged holds numbers that no satellite sends. The bounds are
what the fields of the messages can hold: IS-GPS-200N, tables 20-I, 20-III and 20-X; IS-QZSS-PNT-005, 4.3.2; Galileo OS
SIS ICD 2.1, tables 56 to 67; BDS-SIS-ICD-B1I-3.0, 5.2.4; GLONASS ICD L1, L2 5.1, table 4.5.
"""

import math
from collections.abc import Iterable
from typing import Final

import numpy as np

from skyproof.gnss.constants import (
    GLONASS_EARTH_ROTATION_RAD_S,
    GLONASS_MU_M3_S2,
    SECONDS_PER_WEEK,
)
from skyproof.gnss.ephemeris import SYSTEM_NAMES, BroadcastEphemeris, Ephemeris, GlonassEphemeris, Klobuchar

__all__ = ["find_clock_fault", "find_ionosphere_fault", "find_orbit_fault"]

_MOST_APART_S: Final = 600.0
"""Between the times of clock and of orbit of one data set: satellites send both for one instant (IS-GPS-200N,
20.3.4.5), and the shortest step from one data set to the next is Galileo's 10 min."""
_LIKE_GPS: Final = {
    "af0": 2.0**-10,
    "af1": 2.0**-28,
    "af2": 2.0**-48,
    "tgd": 2.0**-24,
    "crs": 2.0**10,
    "crc": 2.0**10,
    "cuc": 2.0**-14,
    "cus": 2.0**-14,
    "cic": 2.0**-14,
    "cis": 2.0**-14,
    "delta_n": math.pi * 2.0**-28,
    "idot": math.pi * 2.0**-30,
    "omega_dot": 2e-8,
}
_LARGEST: Final = {
    "G": _LIKE_GPS,
    "J": _LIKE_GPS,
    "E": _LIKE_GPS | {"af0": 2.0**-4, "af1": 2.0**-26, "af2": 2.0**-54, "tgd": 2.0**-23, "tgd2": 2.0**-23},
    "C": _LIKE_GPS
    | {"af1": 2.0**-29, "af2": 2.0**-56, "tgd": 5.12e-8, "tgd2": 5.12e-8, "crs": 2.0**11, "crc": 2.0**11},
}
"""Largest magnitude that a field can hold, in the units of `Ephemeris`."""
_ROUNDED: Final = 1.0 + 1e-9
_ORBITS: Final = {
    "G": (5000.0, 5300.0, 0.1, 0.7, 1.2),
    "E": (5150.0, 5600.0, 0.2, 0.8, 1.2),
    "J": (6300.0, 6700.0, 0.2, -0.1, 1.2),
    "C": (5100.0, 6700.0, 0.1, -0.2, 1.3),
}
"""Bounds of sqrt_a, e and i0; two Galileo satellites missed their orbit (e 0.17), i0 of GEOs is small."""
_GLONASS_AXIS_M: Final = (25_000e3, 26_000e3)
"""About the nominal 25 508 km (ICD 5.1, 1.2): the sun and the moon move it by some kilometres."""
_GLONASS_TAU_S, _GLONASS_GAMMA, _GLONASS_ACCELERATION_M_S2 = 2.0**-9, 2.0**-30, 2.0**-26 * 1e3
_KLOBUCHAR: Final = {
    "alpha": (2.0**-23, 2.0**-20, 2.0**-17, 2.0**-17),
    "beta": (2.0**18, 2.0**21, 2.0**23, 2.0**23),
}
_MOST_VERTICAL_S: Final = 200e-9
"""Of the model at the zenith: 60 m on L1, for 370 TECU. In the storm of 2003 satellites measured 330 (A. Mannucci et
al., Geophysical Research Letters 32, 2005, L12S02)."""
_GEOMAGNETIC_SEMICIRCLES: Final = np.linspace(-0.48, 0.48, 97)  # 0.416 of latitude and 0.064 (20.3.3.5.2.5)


def find_orbit_fault(ephemeris: BroadcastEphemeris) -> str | None:
    """Name what no satellite of its system sends in an ephemeris; None where nothing is wrong."""
    if isinstance(ephemeris, GlonassEphemeris):
        return _find_glonass_fault(ephemeris)
    sqrt_a_from, sqrt_a_to, e_to, i0_from, i0_to = _ORBITS[ephemeris.sat[0]]
    flown = (
        sqrt_a_from < ephemeris.sqrt_a < sqrt_a_to
        and 0.0 <= ephemeris.e < e_to
        and i0_from < ephemeris.i0 < i0_to
        and 0.0 <= ephemeris.toe < SECONDS_PER_WEEK
        and 0.0 <= ephemeris.toc < SECONDS_PER_WEEK
        and (ephemeris.sat[0] != "G" or ephemeris.omega_dot < 0.0)
    )
    if not flown:
        return f"no {SYSTEM_NAMES[ephemeris.sat[0]]} satellite can have its orbit"
    values = [(name, getattr(ephemeris, name), largest) for name, largest in _LARGEST[ephemeris.sat[0]].items()]
    return _find_overflow(values) or find_clock_fault(ephemeris)


def _find_overflow(values: Iterable[tuple[str, float, float]]) -> str | None:
    """Name the first of some values, each with its largest, that does not fit into its field."""
    for name, value, largest in values:
        if not abs(value) <= largest * _ROUNDED:
            return f"its {name} is {value:.3g}, more than the {largest:.3g} that the message can hold"
    return None


def find_clock_fault(ephemeris: Ephemeris) -> str | None:
    """Report times of clock and orbit that belong to different data sets; None where they agree."""
    apart_s = (ephemeris.toc_week - ephemeris.week) * SECONDS_PER_WEEK + ephemeris.toc - ephemeris.toe
    if abs(apart_s) <= _MOST_APART_S:
        return None
    return f"its time of clock is {apart_s / 3600.0:+.2f} h from its time of ephemeris, expected the same"


def _find_glonass_fault(ephemeris: GlonassEphemeris) -> str | None:
    """Check the axis of the orbit by vis-viva, from position and velocity in a frame at rest."""
    position, velocity = np.array(ephemeris.position_m), np.array(ephemeris.velocity_m_s)
    x, y, _ = position
    at_rest = velocity + GLONASS_EARTH_ROTATION_RAD_S * np.array([-y, x, 0.0])
    radius = float(np.linalg.norm(position))
    with np.errstate(divide="ignore", invalid="ignore"):
        axis_m = 1.0 / np.float64(2.0 / max(radius, 1.0) - float(at_rest @ at_rest) / GLONASS_MU_M3_S2)
    if not _GLONASS_AXIS_M[0] < axis_m < _GLONASS_AXIS_M[1]:
        return "no GLONASS satellite can have its orbit"
    return _find_overflow(
        (
            ("tau_n", ephemeris.tau_n, _GLONASS_TAU_S),
            ("gamma_n", ephemeris.gamma_n, _GLONASS_GAMMA),
            ("acceleration", max(map(abs, ephemeris.acceleration_m_s2)), _GLONASS_ACCELERATION_M_S2),
        )
    )


def find_ionosphere_fault(ionosphere: Klobuchar) -> str | None:
    """Report why no message can hold these parameters, or no ionosphere be so dense.

    None where nothing is wrong.
    """
    for name, bounds in _KLOBUCHAR.items():
        numbered = enumerate(zip(getattr(ionosphere, name), bounds, strict=True))
        if fault := _find_overflow((f"{name}{k}", value, largest) for k, (value, largest) in numbered):
            return fault
    amplitude_s = np.polynomial.polynomial.polyval(_GEOMAGNETIC_SEMICIRCLES, ionosphere.alpha)
    if (most_s := 5e-9 + float(amplitude_s.max())) > _MOST_VERTICAL_S:
        return (
            f"it delays L1 by {most_s * 1e9:.0f} ns at the zenith, more than the {_MOST_VERTICAL_S * 1e9:.0f} ns of any"
        )
    return None
