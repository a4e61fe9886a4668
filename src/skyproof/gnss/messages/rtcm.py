"""Broadcast orbits as RTCM 3 relays them: messages 1019, 1020, 1042, 1044, 1045 and 1046 (RTCM 10403.3, 3.5).

The numbers are those of the satellites' own messages, in another order and without their times of transmission.
"""

import bisect
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from skyproof.gnss.ephemeris import GEOSTATIONARY, BroadcastEphemeris, Ephemeris, system_offset_s
from skyproof.gnss.lnav import URA_M, fit_interval_h
from skyproof.gnss.messages.bit_fields import (
    EPHEMERIS_NAMES,
    BitField,
    angle_options,
    chain_fields,
    magnitude_options,
    read_fields,
    sign_options,
)
from skyproof.gnss.messages.galileo import sisa_m
from skyproof.gnss.messages.glonass import glonass_ephemeris
from skyproof.gnss.orbit_faults import find_orbit_fault
from skyproof.gnss.time import find_nearest_week, week_and_tow

__all__ = ["EPHEMERIS_MESSAGES", "RelayedOrbit", "read_relayed_orbit"]


_ORBIT_OF_GPS: Final = (
    ("crs", 16, sign_options(2.0**-5)),
    ("delta_n", 16, angle_options(2.0**-43)),
    ("m0", 32, angle_options(2.0**-31)),
    ("cuc", 16, sign_options(2.0**-29)),
    ("e", 32, {"scale": 2.0**-33}),
    ("cus", 16, sign_options(2.0**-29)),
    ("sqrt_a", 32, {"scale": 2.0**-19}),
)
_PLANE_OF_GPS: Final = (
    ("cic", 16, sign_options(2.0**-29)),
    ("omega0", 32, angle_options(2.0**-31)),
    ("cis", 16, sign_options(2.0**-29)),
    ("i0", 32, angle_options(2.0**-31)),
    ("crc", 16, sign_options(2.0**-5)),
    ("omega", 32, angle_options(2.0**-31)),
    ("omega_dot", 24, angle_options(2.0**-43)),
)
_CLOCK_OF_GPS: Final = (
    ("toc", 16, {"scale": 16.0}),
    ("af2", 8, sign_options(2.0**-55)),
    ("af1", 16, sign_options(2.0**-43)),
    ("af0", 22, sign_options(2.0**-31)),
)
_GALILEO: Final = (
    ("week", 12),
    ("iode", 10),
    ("sisa", 8),
    ("idot", 14, angle_options(2.0**-43)),
    ("toc", 14, {"scale": 60.0}),
    ("af2", 6, sign_options(2.0**-59)),
    ("af1", 21, sign_options(2.0**-46)),
    ("af0", 31, sign_options(2.0**-34)),
    *_ORBIT_OF_GPS,
    ("toe", 14, {"scale": 60.0}),
    *_PLANE_OF_GPS,
    ("tgd", 10, sign_options(2.0**-32)),
)
_STATE: Final = tuple(
    (f"{axis}_{name}", length, magnitude_options(scale))
    for axis in "xyz"
    for name, length, scale in (
        ("velocity_m_s", 24, 1e3 * 2.0**-20),
        ("position_m", 27, 1e3 * 2.0**-11),
        ("acceleration_m_s2", 5, 1e3 * 2.0**-30),
    )
)
_FIELDS: Final[dict[int, tuple[BitField, ...]]] = {
    1019: chain_fields(
        12,
        ("sv", 6),
        ("week", 10),
        ("ura_index", 4),
        ("code_on_l2", 2),
        ("idot", 14, angle_options(2.0**-43)),
        ("iode", 8),
        *_CLOCK_OF_GPS,
        ("iodc", 10),
        *_ORBIT_OF_GPS,
        ("toe", 16, {"scale": 16.0}),
        *_PLANE_OF_GPS,
        ("tgd", 8, sign_options(2.0**-31)),
        ("health", 6),
        ("l2_p_flag", 1),
        ("fit", 1),
    ),
    1020: chain_fields(
        12,
        ("slot", 6),
        ("channel", 5),
        ("almanac", 2),
        ("p1", 2),
        ("frame_time", 12),
        ("ill_b", 1),
        ("p2", 1),
        ("reference_steps", 7),
        *_STATE,
        ("p3", 1),
        ("gamma_n", 11, magnitude_options(2.0**-40)),
        ("p", 2),
        ("ill", 1),
        ("tau_n", 22, magnitude_options(2.0**-30)),
        ("delta_tau_n", 5, magnitude_options(2.0**-30)),
        ("age_days", 5),
    ),
    1042: chain_fields(
        12,
        ("sv", 6),
        ("week", 13),
        ("ura_index", 4),
        ("idot", 14, angle_options(2.0**-43)),
        ("iode", 5),
        ("toc", 17, {"scale": 8.0}),
        ("af2", 11, sign_options(2.0**-66)),
        ("af1", 22, sign_options(2.0**-50)),
        ("af0", 24, sign_options(2.0**-33)),
        ("iodc", 5),
        ("crs", 18, sign_options(2.0**-6)),
        ("delta_n", 16, angle_options(2.0**-43)),
        ("m0", 32, angle_options(2.0**-31)),
        ("cuc", 18, sign_options(2.0**-31)),
        ("e", 32, {"scale": 2.0**-33}),
        ("cus", 18, sign_options(2.0**-31)),
        ("sqrt_a", 32, {"scale": 2.0**-19}),
        ("toe", 17, {"scale": 8.0}),
        ("cic", 18, sign_options(2.0**-31)),
        ("omega0", 32, angle_options(2.0**-31)),
        ("cis", 18, sign_options(2.0**-31)),
        ("i0", 32, angle_options(2.0**-31)),
        ("crc", 18, sign_options(2.0**-6)),
        ("omega", 32, angle_options(2.0**-31)),
        ("omega_dot", 24, angle_options(2.0**-43)),
        ("tgd", 10, sign_options(1e-10)),
        ("tgd2", 10, sign_options(1e-10)),
        ("health", 1),
    ),
    1044: chain_fields(
        12,
        ("sv", 4),
        *_CLOCK_OF_GPS,
        ("iode", 8),
        *_ORBIT_OF_GPS,
        ("toe", 16, {"scale": 16.0}),
        *_PLANE_OF_GPS,
        ("idot", 14, angle_options(2.0**-43)),
        ("code_on_l2", 2),
        ("week", 10),
        ("ura_index", 4),
        ("health", 6),
        ("tgd", 8, sign_options(2.0**-31)),
        ("iodc", 10),
        ("fit", 1),
    ),
    1045: chain_fields(12, ("sv", 6), *_GALILEO, ("e5a_health", 2), ("e5a_invalid", 1)),
    1046: chain_fields(
        12,
        ("sv", 6),
        *_GALILEO,
        ("tgd2", 10, sign_options(2.0**-32)),
        ("e5b_health", 2),
        ("e5b_invalid", 1),
        ("e1_health", 2),
        ("e1_invalid", 1),
    ),
}
EPHEMERIS_MESSAGES: Final = {
    1019: ("G", "LNAV", 1024, 0),
    1020: ("R", "", 0, 0),
    1042: ("C", "D1", 8192, 1356),
    1044: ("J", "LNAV", 1024, 0),
    1045: ("E", "FNAV", 4096, 1024),
    1046: ("E", "INAV", 4096, 1024),
}
"""System, broadcast message, modulus of the week and GPS week of its week 0, of each message."""


@dataclass(frozen=True, kw_only=True)
class RelayedOrbit:
    """One message's numbers, before the week is known.

    week : full GPS week as the message states it, of its transmission; None of GLONASS. toe_s : second of it in GPS
    time; of GLONASS NaN. channel : GLONASS's frequency number; None where it is none or another system's.
    """

    number: int
    sat: str
    week: int | None
    toe_s: float
    channel: int | None
    values: Mapping[str, float]

    def ephemeris(self, received_gpst: np.datetime64) -> BroadcastEphemeris | None:
        """Return the orbit as of when it came; None for an impossible one."""
        made = self._make_glonass(received_gpst) if self.sat[0] == "R" else self._make_kepler(received_gpst)
        return None if made is None or find_orbit_fault(made) is not None else made

    def _make_glonass(self, received_gpst: np.datetime64) -> BroadcastEphemeris | None:
        if self.channel is None:
            return None
        values = {**self.values, "health": int(self.values["ill_b"]) << 2}
        return glonass_ephemeris({1: {}, 2: {}, 3: {}, 4: values}, self.sat, received_gpst, self.channel)

    def _make_kepler(self, received_gpst: np.datetime64) -> Ephemeris:
        system, message, _, _ = EPHEMERIS_MESSAGES[self.number]
        values: dict[str, Any] = {"tgd2": 0.0, **self.values}
        week, tow_s = week_and_tow(received_gpst)

        def week_of(second: float) -> int:
            """Return the week of a time of ephemeris or clock, which lies within half a week of when it came."""
            return week + round((tow_s - second) / 604_800)

        more: dict[str, Any] = {}
        if system == "E":
            more = {"iodc": values["iode"], "health": _pack_galileo_health(values)}
            more["ura_index"] = bisect.bisect_left(URA_M, sisa_m(int(values["sisa"])))
        elif system != "C":
            more = {name: int(values[name]) for name in ("code_on_l2", "l2_p_flag") if name in values}
            more["fit_interval_h"] = fit_interval_h(int(values["iodc"])) if values["fit"] else 4.0
        fields: dict[str, Any] = {
            name: int(values[name]) for name in ("iode", "iodc", "health", "ura_index") if name in values
        } | more
        return Ephemeris(
            sat=self.sat,
            week=week_of(values["toe"]),
            toc_week=week_of(values["toc"]),
            message="D2" if message == "D1" and self.sat in GEOSTATIONARY else message,
            **fields,
            **{name: values[name] for name in EPHEMERIS_NAMES},
        )


def _pack_galileo_health(values: Mapping[str, float]) -> int:
    """Return the bits as RINEX packs them (3.05, table A8): E1-B in 0 to 2, E5a in 3 to 5, E5b in 6 to 8."""
    places = {"e1": 0, "e5a": 3, "e5b": 6}
    return sum(
        (int(values[f"{name}_invalid"]) | int(values[f"{name}_health"]) << 1) << place
        for name, place in places.items()
        if f"{name}_health" in values
    )


def read_relayed_orbit(content: bytes, week_near: int) -> RelayedOrbit | None:
    """Read an ephemeris message; None for another one, one that is too short, or of a satellite that has no name.

    content : of the frame, from the message's number on. week_near : a full GPS week within half of the modulus of
    the system's weeks, ten years of GPS, of the truth.
    """
    frame, n_bits = int.from_bytes(content, "big"), 8 * len(content)
    number = frame >> max(n_bits - 12, 0)
    fields = _FIELDS.get(number)
    if fields is None or fields[-1].runs[0][0] + fields[-1].runs[0][1] > n_bits:
        return None
    system, _, modulus, week_0 = EPHEMERIS_MESSAGES[number]
    values = read_fields(fields, frame, n_bits)
    if system == "R":
        slot, channel = int(values["slot"]), int(values["channel"]) - 7
        known = channel if -7 <= channel <= 6 else None
        if not 1 <= slot <= 32:
            return None
        return RelayedOrbit(
            number=number, sat=f"R{slot:02d}", week=None, toe_s=float("nan"), channel=known, values=values
        )
    sv = int(values["sv"])
    if sv < 1:
        return None
    return RelayedOrbit(
        number=number,
        sat=f"{system}{sv:02d}",
        week=find_nearest_week(int(values["week"]) + week_0, week_near, modulus),
        toe_s=values["toe"] + system_offset_s(system),
        channel=None,
        values=values,
    )
