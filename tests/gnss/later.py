"""Data sets of one orbit that serve hours later."""

import math
from dataclasses import replace

from skyproof.gnss.constants import (
    BEIDOU_EARTH_ROTATION_RAD_S,
    EARTH_ROTATION_RAD_S,
    GALILEO_MU_M3_S2,
    MU_M3_S2,
    SECONDS_PER_WEEK,
)
from skyproof.gnss.ephemeris import Ephemeris
from skyproof.gnss.time import gpst, week_and_tow


def extrapolate_hours(e: Ephemeris, hours: float) -> Ephemeris:
    """Return the same orbit and clock by a set that counts from so many hours later: IS-GPS-200N, table 20-IV, by tk.

    BeiDou's geostationary satellites have none: they turn in a frame of their own.
    """
    later_s = 3600.0 * hours
    week, toe_s = week_and_tow(gpst(e.week, e.toe + later_s))
    gravity_m3_s2 = MU_M3_S2 if e.sat[0] == "G" else GALILEO_MU_M3_S2  # BeiDou's is Galileo's
    earth_rad_s = BEIDOU_EARTH_ROTATION_RAD_S if e.sat[0] == "C" else EARTH_ROTATION_RAD_S
    motion_rad_s = gravity_m3_s2**0.5 / e.sqrt_a**3 + e.delta_n
    # The node counts from Greenwich at the week's beginning.
    node_rad = e.omega0 + e.omega_dot * later_s - earth_rad_s * SECONDS_PER_WEEK * (week - e.week)
    return replace(
        e,
        week=week,
        toe=toe_s,
        toc_week=week,
        toc=toe_s,
        iode=(e.iode + round(hours)) % 128,
        iodc=(e.iodc + round(hours)) % 128,
        af0=e.af0 + e.af1 * later_s,
        m0=math.remainder(e.m0 + motion_rad_s * later_s, math.tau),
        omega0=math.remainder(node_rad, math.tau),
        i0=e.i0 + e.idot * later_s,
    )
