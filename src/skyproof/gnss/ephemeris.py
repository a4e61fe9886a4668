"""The broadcast orbit and clock of one GPS satellite, as IS-GPS-200 names its parameters."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, kw_only=True)
class Ephemeris:
    """Clock, orbit and health of one satellite (IS-GPS-200N, tables 20-I and 20-III).

    Angles are in radians (the message's semicircles times pi), times in seconds.
    `week` is the full GPS week (no rollover) of `toe`; `toc_week` that of `toc`.
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
class NavigationData:
    """Everything a navigation file or the signals themselves tell about orbits, clocks and the ionosphere."""

    ephemerides: tuple[Ephemeris, ...]
    ionosphere: Klobuchar | None = None
    utc: UtcParameters | None = None
    source: str = ""
    remarks: tuple[str, ...] = ()  # what was skipped or mended on the way in

    def best(self, sat: str, gpst: np.datetime64, *, max_age_s: float = 7500.0) -> Ephemeris | None:
        """The ephemeris of `sat` whose time of ephemeris is nearest to `gpst`; None if none is within `max_age_s`."""
        epoch = np.datetime64("1980-01-06T00:00:00", "ns")
        t_s = float((gpst - epoch) / np.timedelta64(1, "s"))
        near = [(abs(t_s - (e.week * 604800.0 + e.toe)), e) for e in self.ephemerides if e.sat == sat]
        age_s, ephemeris = min(near, key=lambda pair: pair[0], default=(np.inf, None))
        return ephemeris if age_s <= max_age_s else None
