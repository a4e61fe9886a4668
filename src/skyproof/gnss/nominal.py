"""A GPS constellation for any date: the published slots, each filled, with plain orbits and clocks."""

from typing import Final

import numpy as np

from skyproof.gnss.constants import EARTH_ROTATION_RAD_S, GPS_PI, MU_M3_S2
from skyproof.gnss.ephemeris import Ephemeris, Klobuchar, NavigationData, UtcParameters
from skyproof.gnss.lnav import quantise
from skyproof.gnss.signals import sat_name
from skyproof.gnss.time import gpst as instant
from skyproof.gnss.time import leap_seconds, seconds_between, week_and_tow

__all__ = ["NOMINAL_KLOBUCHAR", "make_nominal_constellation"]

NOMINAL_KLOBUCHAR: Final = Klobuchar(
    alpha=(13 * 2.0**-30, -1 * 2.0**-27, -1 * 2.0**-24, 2 * 2.0**-24),
    beta=(57 * 2.0**11, -15 * 2.0**14, -1 * 2.0**16, 17 * 2.0**16),
)
"""What GPS sent on 1 January 2022: an ordinary day."""

# GPS SPS Performance Standard, 5th edition (2020), tables 3.2-1 (baseline slots) and 3.2-2 (B1, D2 and F2 expanded).
_EPOCH: Final = np.datetime64("1993-07-01T00:00:00", "ns")
_GREENWICH_DEG: Final = 279.06  # hour angle at the epoch: 18 h 36 min 14.4 s
_A_M: Final = 26_559_700.0
_INCLINATION_DEG: Final = 55.0
_NODE_DEG: Final = {"A": 272.847, "B": 332.847, "C": 32.847, "D": 92.847, "E": 152.847, "F": 212.847}
_LATITUDE_ARGUMENTS_DEG: Final = {
    "A": (268.126, 161.786, 11.676, 41.806),
    "B": (94.916, 66.356, 173.336, 309.976, 204.376),
    "C": (111.876, 11.796, 339.666, 241.556),
    "D": (135.226, 282.676, 257.976, 35.156, 167.356),
    "E": (197.046, 302.596, 66.066, 333.686),
    "F": (238.886, 0.456, 334.016, 105.206, 135.346),
}
# Four satellites beyond the published slots, where they help most (found by a search over ten-degree steps): with 27
# alone, one place in 140 sees five or fewer above 10.6 degrees at times. As many more do fly.
_SPARES_DEG: Final = {"A": 310.0, "B": 140.0, "E": 130.0, "F": 210.0}
_SLOTS: Final = (
    *((_NODE_DEG[plane], u) for plane, us in _LATITUDE_ARGUMENTS_DEG.items() for u in us),
    *((_NODE_DEG[plane], u) for plane, u in _SPARES_DEG.items()),
)

_NODE_RATE_RAD_S: Final = -7.8320e-9  # by the Earth's flattening: -4.4874e-7 deg/s
_MEAN_MOTION_RAD_S: Final = 2.0 * (EARTH_ROTATION_RAD_S - _NODE_RATE_RAD_S)  # kept so, that ground tracks repeat
_TOE_STEP_S: Final = 7200.0


def make_nominal_constellation(gpst: np.datetime64) -> NavigationData:
    """Generate ephemerides of the nominal constellation around `gpst`, any date, always the same bits.

    There are 31 satellites: one in each of the 27 published slots and four more (G28 to G31). Orbits, clocks and group
    delays differ a little from satellite to satellite as real ones do. Time of ephemeris is the full two hours nearest
    to `gpst`; neighbouring sets lie on one orbit. All values are what the message can hold.
    """
    week, tow_s = week_and_tow(gpst)
    toe = instant(week, round(tow_s / _TOE_STEP_S) * _TOE_STEP_S)
    week, _ = week_and_tow(toe)
    return NavigationData(
        ephemerides=tuple(_make_ephemeris(prn, *slot, toe) for prn, slot in enumerate(_SLOTS, start=1)),
        ionosphere=NOMINAL_KLOBUCHAR,
        utc=UtcParameters(a0=0.0, a1=0.0, tot=147456.0, wnt=week, leap_seconds=leap_seconds(toe)),
        source="nominal constellation",
    )


def _make_ephemeris(prn: int, node_deg: float, u_deg: float, toe: np.datetime64) -> Ephemeris:
    week, toe_s = week_and_tow(toe)
    since_s = seconds_between(toe, _EPOCH)
    longitude_rad = np.radians(node_deg - _GREENWICH_DEG) + (_NODE_RATE_RAD_S - EARTH_ROTATION_RAD_S) * since_s
    omega_rad = prn * 2.4  # the perigees are anywhere: the golden angle spreads them
    clock_rate = ((prn * 5) % 13 - 6) * 2.0**-40  # within 6e-12
    return quantise(
        Ephemeris(
            sat=sat_name(prn),
            week=week,
            toe=toe_s,
            toc_week=week,
            toc=toe_s,
            af0=((prn * 7) % 23 - 11) * 2e-5 + clock_rate * toe_s,
            af1=clock_rate,
            af2=0.0,
            tgd=((prn * 11) % 25 - 20) * 2.0**-31,
            iode=int(toe_s // _TOE_STEP_S),
            iodc=int(toe_s // _TOE_STEP_S),
            sqrt_a=_A_M**0.5,
            e=0.001 + (prn * 3) % 11 * 0.001,
            i0=np.radians(_INCLINATION_DEG),
            omega0=_wrap(longitude_rad + EARTH_ROTATION_RAD_S * toe_s),
            omega=_wrap(omega_rad),
            m0=_wrap(np.radians(u_deg) + _MEAN_MOTION_RAD_S * since_s - omega_rad),
            delta_n=_MEAN_MOTION_RAD_S - (MU_M3_S2 / _A_M**3) ** 0.5,
            idot=0.0,
            omega_dot=_NODE_RATE_RAD_S,
            crs=0.0,
            crc=0.0,
            cus=0.0,
            cuc=0.0,
            cis=0.0,
            cic=0.0,
        )
    )


def _wrap(angle_rad: float) -> float:
    """Wrap an angle to -pi .. pi less one step, which is what 32 bits of a semicircle hold."""
    step_rad = GPS_PI * 2.0**-31
    return float((round(angle_rad / step_rad) + 2**31) % 2**32 - 2**31) * step_rad
