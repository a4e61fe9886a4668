"""Broadcast orbits and clocks: Kepler's form with the names of IS-GPS-200 for four systems, a state for GLONASS."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from skyproof.gnss.constants import BDT_BEHIND_GPST_S
from skyproof.gnss.time import gpst as instant
from skyproof.gnss.time import seconds_between
from skyproof.short_repr import ShortRepr

MAX_AGE_S: Final = {"G": 7500.0, "J": 7500.0, "E": 7500.0, "C": 7500.0, "R": 1800.0}
"""Seconds from the time of ephemeris within which it serves, by system.

GPS and QZSS: half of the usual four hours of fit, and 5 min for the change (IS-GPS-200N, 20.3.4.4). Galileo and BeiDou
renew at least hourly and are fit for more; two hours bridge a missed one. GLONASS: the 15 min of the force model
(GLONASS ICD L1, L2 5.1, A.3.1.2), and as much again for a late change.
"""


@dataclass(frozen=True, kw_only=True)
class Ephemeris:
    """Clock, orbit and health of one satellite of GPS, QZSS, Galileo or BeiDou; `sat[0]` says which.

    Names of IS-GPS-200N, tables 20-I and 20-III; Galileo (OS SIS ICD 2.1, 5.1.1) and BeiDou (B1I ICD 3.0, 5.2.4) send
    the same parameters. Angles are in radians (the message's semicircles times pi), times in seconds of the system's
    own week: `week` is the full GPS week (no rollover) of `toe`, `toc_week` that of `toc`. BeiDou's seconds are those
    of BDT, 14 s behind GPS, and its weeks are counted as GPS counts (week 0 of BDT is 1356); `reference_gpst` is
    `toe` as an instant.

    iode, iodc : of Galileo IODnav, of BeiDou AODE and AODC.
    tgd : group delay; of Galileo BGD(E1, E5a), of BeiDou TGD1 (B1I).
    tgd2 : of Galileo BGD(E1, E5b), of BeiDou TGD2 (B2I).
    ura_index : index of the accuracy in metres on GPS's scale, whatever the system.
    message : which one it is of: LNAV, INAV, FNAV, D1, D2. Clocks of INAV and FNAV differ by their pair of signals.
    """

    sat: str  # "G05"
    week: int
    toe: float
    toc_week: int
    toc: float
    af0: float
    af1: float
    af2: float
    tgd: float
    iode: int
    iodc: int
    sqrt_a: float
    e: float
    i0: float
    omega0: float
    omega: float
    m0: float
    delta_n: float
    idot: float
    omega_dot: float
    crs: float
    crc: float
    cus: float
    cuc: float
    cis: float
    cic: float
    health: int = 0
    ura_index: int = 0
    fit_interval_h: float = 4.0
    code_on_l2: int = 1
    l2_p_flag: int = 0
    transmission_tow: float = float("nan")  # seconds of `week`; only RINEX files give it
    message: str = "LNAV"
    tgd2: float = 0.0

    @property
    def reference_gpst(self) -> np.datetime64:
        """The time of ephemeris as a GPS instant."""
        return instant(self.week, self.toe + ahead_of_system_s(self.sat))

    @property
    def healthy(self) -> bool:
        """Whether its message calls the first band's signal good.

        The last bit of QZSS is about L1C/B, which no receiver of L1 C/A tracks (IS-QZSS-PNT-005, 5.4.1).
        """
        return (self.health & ~1 if self.sat.startswith("J") else self.health) == 0


@dataclass(frozen=True, kw_only=True)
class GlonassEphemeris:
    """Clock, state and health of one GLONASS satellite (GLONASS ICD L1, L2 5.1, table 4.5).

    week, toe : full GPS week and second of it of the message's t_b, the leap seconds added.
    tau_n : s, system time minus the satellite's clock at t_b; gamma_n : relative deviation of its frequency.
    position_m, velocity_m_s : in PZ-90 at t_b. acceleration_m_s2 : of the sun and the moon.
    frequency_number : of the carriers, -7 to 6. delta_tau_n : s, delay of G2 over G1; NaN where the file has none.
    """

    sat: str  # "R05"
    week: int
    toe: float
    tau_n: float
    gamma_n: float
    frequency_number: int
    position_m: tuple[float, float, float]
    velocity_m_s: tuple[float, float, float]
    acceleration_m_s2: tuple[float, float, float]
    health: int = 0
    age_days: float = 0.0
    message_tow: float = float("nan")  # seconds of the UTC week at the message frame's start
    delta_tau_n: float = float("nan")

    @property
    def reference_gpst(self) -> np.datetime64:
        """The time of ephemeris as a GPS instant."""
        return instant(self.week, self.toe)

    @property
    def healthy(self) -> bool:
        """Whether its message calls it good."""
        return self.health == 0


BroadcastEphemeris = Ephemeris | GlonassEphemeris


def ahead_of_system_s(sat: str) -> float:
    """GPS time minus the time of the satellite's system, in whole seconds, GLONASS's leap seconds taken as added."""
    return BDT_BEHIND_GPST_S if sat.startswith("C") else 0.0


def age_s(ephemeris: BroadcastEphemeris, gpst: np.datetime64) -> float:
    """Seconds between the time of ephemeris and the instant, either way."""
    since_week_s = float(seconds_between(gpst, instant(ephemeris.week, 0.0)))
    return abs(since_week_s - ephemeris.toe - ahead_of_system_s(ephemeris.sat))


@dataclass(frozen=True, kw_only=True)
class Klobuchar:
    """The eight ionosphere parameters (IS-GPS-200N, 20.3.3.5.1.7), in seconds per semicircle to the n."""

    alpha: tuple[float, float, float, float]
    beta: tuple[float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class UtcParameters:
    """GPS to UTC (IS-GPS-200N, 20.3.3.5.2.4)."""

    a0: float
    a1: float
    tot: float
    wnt: int  # full week
    leap_seconds: int


@dataclass(frozen=True, kw_only=True, repr=False)
class NavigationData(ShortRepr):
    """Everything a navigation file or the signals themselves give of orbits, clocks and the ionosphere."""

    ephemerides: tuple[BroadcastEphemeris, ...]
    ionosphere: Klobuchar | None = None
    utc: UtcParameters | None = None
    source: str = ""
    remarks: tuple[str, ...] = ()  # what was skipped or corrected on the way in

    def best(self, sat: str, gpst: np.datetime64, *, max_age_s: float | None = None) -> BroadcastEphemeris | None:
        """The healthy ephemeris of `sat` nearest in time to `gpst`; None if none is within `max_age_s`.

        Without `max_age_s` it is that of the system, `MAX_AGE_S`.
        """
        limit_s = MAX_AGE_S.get(sat[:1], 0.0) if max_age_s is None else max_age_s
        near = [(age_s(e, gpst), e) for e in self.ephemerides if e.sat == sat and e.healthy]
        nearest_s, ephemeris = min(near, key=lambda pair: pair[0], default=(np.inf, None))
        return ephemeris if nearest_s <= limit_s else None
