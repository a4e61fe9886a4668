"""Broadcast orbits and clocks: Kepler's form with the names of IS-GPS-200 for four systems, a state for GLONASS."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from skyproof.arrays import Indices, Integers, Reals
from skyproof.gnss import orbit_rows as k
from skyproof.gnss.constants import (
    BDT_BEHIND_GPST_S,
    BEIDOU_EARTH_ROTATION_RAD_S,
    BEIDOU_MU_M3_S2,
    EARTH_ROTATION_RAD_S,
    GALILEO_MU_M3_S2,
    GALILEO_RELATIVITY_F_S_SQRT_M,
    MU_M3_S2,
    RELATIVITY_F_S_SQRT_M,
)
from skyproof.gnss.time import gpst as instant
from skyproof.gnss.time import seconds_between
from skyproof.short_repr import ShortRepr

SYSTEM_NAMES: Final = {"G": "GPS", "J": "QZSS", "E": "Galileo", "C": "BeiDou", "R": "GLONASS", "S": "SBAS"}
"""By the letter that a satellite's number begins with in RINEX."""
MAX_AGE_S: Final = {"G": 7500.0, "J": 7500.0, "E": 7500.0, "C": 7500.0, "R": 1800.0}
"""Seconds from the time of ephemeris within which it serves, by system.

GPS and QZSS: half of the usual four hours of fit, and 5 min for the change (IS-GPS-200N, 20.3.4.4). Galileo and BeiDou
renew at least hourly and are fit for more; two hours bridge a missed one. GLONASS: the 15 min of the force model
(GLONASS ICD L1, L2 5.1, A.3.1.2), and as much again for a late change.
"""
_GPS: Final = (MU_M3_S2, EARTH_ROTATION_RAD_S, RELATIVITY_F_S_SQRT_M)
_KEPLER: Final = {
    "G": _GPS,
    "J": _GPS,  # IS-QZSS-PNT-005, 5.5 refers to GPS
    "E": (GALILEO_MU_M3_S2, EARTH_ROTATION_RAD_S, GALILEO_RELATIVITY_F_S_SQRT_M),
    "C": (BEIDOU_MU_M3_S2, BEIDOU_EARTH_ROTATION_RAD_S, GALILEO_RELATIVITY_F_S_SQRT_M),
}
"""Gravity, earth's rotation and F of each system."""
GEOSTATIONARY: Final = frozenset((*(f"C{n:02d}" for n in range(1, 6)), *(f"C{n:02d}" for n in range(59, 64))))
_GALILEO_GAMMA: Final = {"E5a": (154.0 / 115.0) ** 2, "E5b": (154.0 / 118.0) ** 2}


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
    a_dot, delta_n_dot : m/s and rad/s^2, by which axis and mean motion change; of CNAV and B-CNAV.
    delays_s : of these, band, codes and group delay of each signal, which they state one by one.
    message : that carries it: LNAV, CNAV, INAV, FNAV, D1, D2, BCNAV1, BCNAV2. Clocks of INAV and FNAV differ by
        their pair of signals.
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
    a_dot: float = 0.0
    delta_n_dot: float = 0.0
    delays_s: tuple[tuple[str, str, float], ...] = ()

    @property
    def reference_gpst(self) -> np.datetime64:
        """Return the time of ephemeris as a GPS instant."""
        return instant(self.week, self.toe + system_offset_s(self.sat))

    @property
    def healthy(self) -> bool:
        """Return whether its message calls the first band's signal good.

        The last bit of QZSS is about L1C/B, which no receiver of L1 C/A tracks (IS-QZSS-PNT-005, 5.4.1).
        """
        return (self.health & ~1 if self.sat.startswith("J") else self.health) == 0

    @cached_property
    def orbit_row(self) -> Reals:
        """Return clock and orbit (N_ORBIT,) as kernels take them."""
        row = np.empty(k.N_ORBIT)
        row[k.KIND] = k.GEOSTATIONARY if self.sat in GEOSTATIONARY else k.KEPLER
        row[k.WEEK : k.AF2 + 1] = (
            self.week,
            self.toe,
            system_offset_s(self.sat),
            self.toc_week,
            self.toc,
            self.af0,
            self.af1,
            self.af2,
        )
        row[k.MU : k.SQRT_A] = _KEPLER[self.sat[0]]
        row[k.SQRT_A : k.CRS] = (
            self.sqrt_a,
            self.e,
            self.i0,
            self.omega0,
            self.omega,
            self.m0,
            self.delta_n,
            self.idot,
            self.omega_dot,
        )
        row[k.CRS : k.CIC + 1] = self.crs, self.crc, self.cus, self.cuc, self.cis, self.cic
        row[k.A_DOT], row[k.DELTA_N_DOT] = self.a_dot, self.delta_n_dot
        return row


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
        """Return the time of ephemeris as a GPS instant."""
        return instant(self.week, self.toe)

    @property
    def healthy(self) -> bool:
        """Return whether its message calls it good."""
        return self.health == 0

    @cached_property
    def orbit_row(self) -> Reals:
        """Return clock and state (N_ORBIT,) as kernels take them."""
        row = np.zeros(k.N_ORBIT)
        row[k.KIND] = k.GLONASS
        row[k.WEEK : k.AF2 + 1] = self.week, self.toe, 0.0, self.week, self.toe, -self.tau_n, self.gamma_n, 0.0
        row[k.POSITION : k.VELOCITY] = self.position_m
        row[k.VELOCITY : k.ACCELERATION] = self.velocity_m_s
        row[k.ACCELERATION : k.ACCELERATION + 3] = self.acceleration_m_s2
        return row


BroadcastEphemeris = Ephemeris | GlonassEphemeris


def system_offset_s(sat: str) -> float:
    """Return GPS time minus the time of the satellite's system, in whole seconds.

    GLONASS's leap seconds count as added.
    """
    return BDT_BEHIND_GPST_S if sat.startswith("C") else 0.0


def group_delay_s(ephemeris: BroadcastEphemeris, band: str, code: str) -> float:
    """Return the group delay that a user of one signal subtracts from the satellite's clock, in seconds.

    NaN where the message gives none.

    GPS and QZSS: TGD on L1, gamma times that on L2 (IS-GPS-200N, 20.3.3.3.3.2). Galileo: the clock is that of the pair
    E1, E5b in I/NAV and E1, E5a in F/NAV, and the delay between the same two counts (OS SIS ICD 2.1, 5.1.5). BeiDou:
    the clock is that of B3I, TGD1 counts on B1I and TGD2 on B2I (BDS-SIS-ICD-B1I-3.0, 5.2.4.10); D1 has no delay of
    B1C, which takes TGD1, of almost the same carrier. CNAV and B-CNAV state it by signal (IS-GPS-200N, 30.3.3.3.1.1.1;
    BDS-SIS-ICD-B1C-1.0, 7.6). GLONASS: the clock is that of G1.
    """
    if isinstance(ephemeris, GlonassEphemeris):
        return {"G1": 0.0, "G2": ephemeris.delta_tau_n}.get(band, np.nan)
    if ephemeris.message in ("CNAV", "BCNAV1", "BCNAV2"):
        return next((s for b, codes, s in ephemeris.delays_s if b == band and code in codes.split()), np.nan)
    if ephemeris.sat[0] == "E":
        pair, delay_s = ("E5a", ephemeris.tgd) if ephemeris.message == "FNAV" else ("E5b", ephemeris.tgd2)
        return {"E1": delay_s, pair: delay_s * _GALILEO_GAMMA[pair]}.get(band, np.nan)
    if ephemeris.sat[0] == "C":
        return {"B1": ephemeris.tgd, "B1C": ephemeris.tgd, "B2": ephemeris.tgd2, "B3": 0.0}.get(band, np.nan)
    return {"L1": ephemeris.tgd, "L2": ephemeris.tgd * (77.0 / 60.0) ** 2}.get(band, np.nan)


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


@dataclass(frozen=True, kw_only=True)
class UtcStatement:
    """What one satellite says of UTC, with a change of leap seconds that was made or is announced.

    utc : leap seconds are those of GPS minus UTC, whatever the system. later_leap_seconds : from `later_from_gpst` on.
    """

    sat: str
    utc: UtcParameters
    later_leap_seconds: int
    later_from_gpst: np.datetime64

    def leap_seconds_at(self, gpst: np.datetime64) -> int:
        """Return GPS minus UTC in whole seconds at an instant (IS-GPS-200N, 20.3.3.5.2.4)."""
        return self.utc.leap_seconds if gpst < self.later_from_gpst else self.later_leap_seconds

    def off_s(self, gpst: np.datetime64) -> float:
        """Return by how much the system's time and UTC differ beside whole seconds."""
        since_s = float(seconds_between(gpst, instant(self.utc.wnt, self.utc.tot)))
        return self.utc.a0 + self.utc.a1 * since_s


@dataclass(frozen=True, kw_only=True, repr=False)
class NavigationData(ShortRepr):
    """Everything a navigation file or the signals themselves give of orbits, clocks and the ionosphere."""

    ephemerides: tuple[BroadcastEphemeris, ...]
    ionosphere: Klobuchar | None = None
    utc: UtcParameters | None = None
    source: str = ""
    remarks: tuple[str, ...] = ()  # what was skipped or corrected on the way in

    def __hash__(self) -> int:
        return self._hash

    @cached_property
    def _hash(self) -> int:
        return hash((self.ephemerides, self.source))

    @cached_property
    def orbit_rows(self) -> Reals:
        """Return all ephemerides (n, N_ORBIT) as kernels take them."""
        return np.array([e.orbit_row for e in self.ephemerides]).reshape(-1, k.N_ORBIT)

    @cached_property
    def reference_ns(self) -> Integers:
        """Return the times of all ephemerides (n,), in nanoseconds since 1970."""
        return np.array([e.reference_gpst for e in self.ephemerides], "M8[ns]").astype(np.int64)

    @cached_property
    def healthy_rows(self) -> Mapping[str, Indices]:
        """Group the rows of healthy ephemerides by satellite."""
        rows: dict[str, list[int]] = {}
        for row, ephemeris in enumerate(self.ephemerides):
            if ephemeris.healthy:
                rows.setdefault(ephemeris.sat, []).append(row)
        return {sat: np.array(numbers, np.intp) for sat, numbers in rows.items()}

    @cached_property
    def _found_serving(self) -> dict[tuple[str, str, str], tuple[Indices, Reals]]:
        return {}

    def find_serving(self, sat: str, band: str, code: str) -> tuple[Indices, Reals]:
        """Find the ephemerides that serve a signal, all healthy ones of its satellite; with its group delays.

        Returns
        -------
        (k,) rows of `ephemerides` and (k,) seconds, NaN where the message does not give the delay.
        """
        if (found := self._found_serving.get((sat, band, code))) is None:
            rows = self.healthy_rows.get(sat, np.zeros(0, np.intp))
            delays_s = np.array([group_delay_s(self.ephemerides[row], band, code) for row in rows], float)
            found = self._found_serving[sat, band, code] = rows, delays_s
        return found

    def best(self, sat: str, gpst: np.datetime64, *, max_age_s: float | None = None) -> BroadcastEphemeris | None:
        """Find the healthy ephemeris of `sat` nearest in time to `gpst`; None if none is within `max_age_s`.

        Without `max_age_s` it is that of the system, `MAX_AGE_S`.
        """
        limit_s = MAX_AGE_S.get(sat[:1], 0.0) if max_age_s is None else max_age_s
        rows = self.healthy_rows.get(sat)
        if rows is None:
            return None
        ages_ns = np.abs(self.reference_ns[rows] - gpst.astype("M8[ns]").astype(np.int64))
        nearest = int(np.argmin(ages_ns))
        return self.ephemerides[rows[nearest]] if ages_ns[nearest] <= limit_s * 1e9 else None
