"""CNAV of GPS, and B-CNAV of BeiDou-3: messages whose orbits change their axis and motion.

IS-GPS-200N, 30.3.3 (message types 10, 11, 30 to 37), and IS-GPS-705J, 20.3.3, which is the same on L5;
BDS-SIS-ICD-B1C-1.0, 7 (subframe 2 of B-CNAV1); BDS-SIS-ICD-B2a-1.0, 7 (message types 10, 11, 30
of B-CNAV2).
A frame is an integer whose highest bit is the first sent.
"""

from collections.abc import Mapping
from typing import Any, Final

from skyproof.gnss.constants import BDT_WEEK_0, GPS_PI
from skyproof.gnss.ephemeris import GEOSTATIONARY, Ephemeris
from skyproof.gnss.messages.bit_fields import (
    BitField,
    Words,
    angle_options,
    chain_fields,
    compute_crc_24q,
    read_fields,
    sign_options,
)
from skyproof.gnss.orbit_faults import find_orbit_fault
from skyproof.gnss.time import find_nearest_week

__all__ = [
    "bcnav1_ephemeris",
    "bcnav1_subframe",
    "bcnav2_ephemeris",
    "bcnav2_message",
    "cnav_ephemeris",
    "cnav_message",
]

_CNAV_BITS, _BCNAV1_BITS, _BCNAV2_BITS = 300, 600, 288
_PREAMBLE: Final = 0b10001011
_AXIS_M: Final = {"GPS": 26_559_710.0, "MEO": 27_906_100.0, "IGSO": 42_162_200.0}
"""To which the message's difference is added (IS-GPS-200N, 30.3.3.1.3; B1C ICD, 7.4.1)."""
_OMEGA_DOT: Final = -2.6e-9 * GPS_PI  # of GPS, to which its message's difference is added, rad/s
_GAMMA: Final = (77.0 / 60.0) ** 2
_UNKNOWN: Final = -(1 << 12)  # a group delay that is not available (30.3.3.3.1.1.1)


_Chained = tuple[str, int, dict[str, Any]]
"""Name, length, and what else `BitField` takes."""


_ORBIT: Final = (
    ("delta_a", 26, sign_options(2.0**-9)),
    ("a_dot", 25, sign_options(2.0**-21)),
    ("delta_n", 17, angle_options(2.0**-44)),
    ("delta_n_dot", 23, angle_options(2.0**-57)),
    ("m0", 33, angle_options(2.0**-32)),
    ("e", 33, {"scale": 2.0**-34}),
    ("omega", 33, angle_options(2.0**-32)),
)
_HARMONICS: Final = (
    ("idot", 15, angle_options(2.0**-44)),
    ("cis", 16, sign_options(2.0**-30)),
    ("cic", 16, sign_options(2.0**-30)),
    ("crs", 24, sign_options(2.0**-8)),
    ("crc", 24, sign_options(2.0**-8)),
    ("cus", 21, sign_options(2.0**-30)),
    ("cuc", 21, sign_options(2.0**-30)),
)
_PLANE: Final = (("omega0", 33, angle_options(2.0**-32)), ("i0", 33, angle_options(2.0**-32)))
_TOE: Final = ("toe", 11, {"scale": 300.0})
_CLOCK: Final = (
    *chain_fields(
        60,
        ("toc", 11, {"scale": 300.0}),
        ("af0", 26, sign_options(2.0**-35)),
        ("af1", 20, sign_options(2.0**-48)),
        ("af2", 10, sign_options(2.0**-60)),
    ),
)
_CNAV: Final[dict[int, tuple[BitField, ...]]] = {
    10: (
        BitField("week_mod_8192", ((38, 13),)),
        BitField("health", ((51, 3),)),
        BitField("ura_ed", ((65, 5),), signed=True),
        *chain_fields(70, _TOE, *_ORBIT),
    ),
    11: chain_fields(38, _TOE, *_PLANE, ("delta_omega_dot", 17, angle_options(2.0**-44)), *_HARMONICS),
    30: (
        *_CLOCK,
        *chain_fields(127, *((f"{name}_steps", 13, {"signed": True}) for name in ("tgd", "l1ca", "l2c", "l5i", "l5q"))),
    ),
    **dict.fromkeys(range(31, 38), _CLOCK),
}
"""Of the message types (figures 30-1 to 30-8). Group delays are in steps of 2^-35 s; one value means none."""
_FIRST: Final[tuple[_Chained, ...]] = (_TOE, ("kind", 2, {}), *_ORBIT)
_SECOND: Final = (*_PLANE, ("omega_dot", 19, angle_options(2.0**-44)), *_HARMONICS)
_BDS_CLOCK: Final = (
    ("toc", 11, {"scale": 300.0}),
    ("af0", 25, sign_options(2.0**-34)),
    ("af1", 22, sign_options(2.0**-50)),
    ("af2", 11, sign_options(2.0**-66)),
)
_BCNAV2: Final[dict[int, tuple[BitField, ...]]] = {
    10: (BitField("week_bdt", ((30, 13),)), BitField("iode", ((53, 8),)), *chain_fields(61, *_FIRST)),
    11: (BitField("health", ((30, 2),)), *chain_fields(42, *_SECOND)),
    30: (
        *chain_fields(42, *_BDS_CLOCK, ("iodc", 10, {})),
        *chain_fields(121, ("tgd_b2a", 12, sign_options(2.0**-34)), ("isc_b2a", 12, sign_options(2.0**-34))),
        BitField("tgd_b1c", ((219, 12),), 2.0**-34, signed=True),
    ),
}
_BCNAV1: Final = chain_fields(
    0,
    ("week_bdt", 13, {}),
    ("hour", 8, {}),
    ("iodc", 10, {}),
    ("iode", 8, {}),
    *_FIRST,
    *_SECOND,
    *_BDS_CLOCK,
    *((name, 12, sign_options(2.0**-34)) for name in ("tgd_b2a", "isc_b1c", "tgd_b1c")),
)


def _check_crc(frame: int, n_bits: int) -> bool:
    """Tell whether the checksum in the last 24 bits of a frame holds."""
    return compute_crc_24q(frame >> 24, n_bits - 24) == frame & 0xFFFFFF


def cnav_message(frame: int) -> tuple[int, Mapping[str, float]] | None:
    """Return type and numbers of a CNAV message (300 bits); None without preamble or where its checksum fails.

    Types 30 to 37 have the clock, 30 the group delays too.
    """
    if frame >> 292 != _PREAMBLE or not _check_crc(frame, _CNAV_BITS):
        return None
    kind = frame >> 280 & 63
    head = {"prn": float(frame >> 286 & 63), "tow_s": 6.0 * (frame >> 263 & 0x1FFFF)}
    return kind, {**head, **read_fields(_CNAV.get(kind, ()), frame, _CNAV_BITS)}


def cnav_ephemeris(messages: Words, sat: str, week_near: int) -> Ephemeris | None:
    """Return the ephemeris that messages 10, 11, 30 and one with the clock make; None unless they have one time.

    None of QZSS, whose axis and node count from elsewhere; its LNAV says the same.

    week_near : a full GPS week within 78 years of the truth.
    """
    if not all(kind in messages for kind in (10, 11, 30)):
        return None
    clocks = [messages[kind] for kind in range(30, 38) if kind in messages]
    first, second = messages[10], messages[11]
    clock = next((c for c in clocks if c["toc"] == first["toe"] == second["toe"]), None)
    if clock is None or sat[0] != "G" or first["prn"] != int(sat[1:]):
        return None
    week = find_nearest_week(int(first["week_mod_8192"]), week_near, 8192)
    values: dict[str, Any] = {**clock, **second, **first}
    values["omega_dot"] = _OMEGA_DOT + values["delta_omega_dot"]
    delays_s = _list_gps_delays_s(messages[30])
    return _make_ephemeris(
        values,
        sat,
        _AXIS_M["GPS"],
        week + round((first["tow_s"] - first["toe"]) / 604_800),
        message="CNAV",
        health=int(values["health"]) >> 2,
        ura_index=max(int(values["ura_ed"]), 0),
        delays_s=delays_s,
        tgd=dict(((band, codes), s) for band, codes, s in delays_s).get(("L1", "P W Y"), 0.0),
    )


def _list_gps_delays_s(message: Mapping[str, float]) -> tuple[tuple[str, str, float], ...]:
    """Return what users of single signals take off the clock: group delay less the signal's own correction."""
    tgd = message["tgd_steps"]
    if tgd == _UNKNOWN:
        return ()
    signals = (
        ("L1", "CA", "l1ca_steps"),
        ("L2", "S L X", "l2c_steps"),
        ("L5", "I", "l5i_steps"),
        ("L5", "Q X", "l5q_steps"),
    )
    step_s = 2.0**-35
    known = [(b, c, step_s * (tgd - message[name])) for b, c, name in signals if message[name] != _UNKNOWN]
    return (*known, ("L1", "P W Y", step_s * tgd), ("L2", "P W Y D", step_s * tgd * _GAMMA))


def bcnav2_message(frame: int) -> tuple[int, Mapping[str, float]] | None:
    """Return type and numbers of a message of B-CNAV2 (288 bits); None where its checksum fails."""
    if not _check_crc(frame, _BCNAV2_BITS):
        return None
    kind = frame >> 276 & 63
    head = {"prn": float(frame >> 282), "sow_s": 3.0 * (frame >> 258 & 0x3FFFF)}
    return kind, {**head, **read_fields(_BCNAV2.get(kind, ()), frame, _BCNAV2_BITS)}


def bcnav2_ephemeris(messages: Words, sat: str, week_near: int) -> Ephemeris | None:
    """Return the ephemeris that messages 10, 11 and 30 make; None unless they share one issue and came in order.

    Message 11 has no issue of its own: it is the one that follows 10, within the minute.
    """
    if not all(kind in messages for kind in (10, 11, 30)) or messages[10]["prn"] != int(sat[1:]):
        return None
    first, second, clock = messages[10], messages[11], messages[30]
    if int(clock["iodc"]) & 0xFF != first["iode"] or not 0.0 <= (second["sow_s"] - first["sow_s"]) % 604_800 <= 60.0:
        return None
    values: dict[str, Any] = {**clock, **second, **first}
    b1c, b2a = values["tgd_b1c"], values["tgd_b2a"]
    delays_s = (("B1C", "1P 1X", b1c), ("B2a", "5P 5X", b2a), ("B2a", "5D", b2a + values["isc_b2a"]))
    return _make_beidou(values, sat, week_near, first["sow_s"], "BCNAV2", int(values["health"]), delays_s)


def bcnav1_subframe(frame: int) -> tuple[int, Mapping[str, float]] | None:
    """Return 2 and the numbers of subframe 2 of B-CNAV1 (600 bits); None where its checksum fails."""
    return (2, read_fields(_BCNAV1, frame, _BCNAV1_BITS)) if _check_crc(frame, _BCNAV1_BITS) else None


def bcnav1_ephemeris(subframes: Words, sat: str, week_near: int) -> Ephemeris | None:
    """Return the ephemeris of subframe 2, which is whole in itself; its health stands in subframe 3."""
    values: dict[str, Any] = dict(subframes[2])
    if int(values["iodc"]) & 0xFF != values["iode"]:
        return None
    b1c, b2a = values["tgd_b1c"], values["tgd_b2a"]
    delays_s = (("B1C", "1P 1X", b1c), ("B1C", "1D", b1c + values["isc_b1c"]), ("B2a", "5P 5X", b2a))
    return _make_beidou(values, sat, week_near, 3600.0 * values["hour"], "BCNAV1", 0, delays_s)


def _make_beidou(
    values: dict[str, Any],
    sat: str,
    week_near: int,
    sow_s: float,
    message: str,
    health: int,
    delays_s: tuple[tuple[str, str, float], ...],
) -> Ephemeris | None:
    """Return an ephemeris of BeiDou-3; None of a kind of orbit that sends no B-CNAV."""
    if sat in GEOSTATIONARY or values["kind"] not in (2, 3):
        return None
    week = find_nearest_week(int(values["week_bdt"]) + BDT_WEEK_0, week_near, 8192)
    return _make_ephemeris(
        values,
        sat,
        _AXIS_M["IGSO" if values["kind"] == 2 else "MEO"],
        week + round((sow_s - values["toe"]) / 604_800),
        message=message,
        health=health,
        ura_index=0,
        iode=int(values["iode"]),
        iodc=int(values["iodc"]),
        delays_s=(*delays_s, ("B3", "6I 6Q 6X", 0.0)),
        tgd=values["tgd_b1c"],
        tgd2=values["tgd_b2a"],
    )


_AS_THEY_ARE: Final = (
    *("toe", "toc", "af0", "af1", "af2", "e", "i0", "omega0", "omega", "m0", "delta_n", "delta_n_dot", "a_dot"),
    *("idot", "omega_dot", "crs", "crc", "cus", "cuc", "cis", "cic"),
)


def _make_ephemeris(values: Mapping[str, Any], sat: str, axis_m: float, week: int, **more: Any) -> Ephemeris | None:
    """Return the ephemeris of a week; None for an impossible orbit."""
    axis_m += values["delta_a"]
    if axis_m <= 0.0:
        return None
    issues = {"iode": int(values["toe"]) // 300, "iodc": int(values["toe"]) // 300}  # which of CNAV is its time
    made = Ephemeris(
        sat=sat,
        week=week,
        toc_week=week + round((values["toe"] - values["toc"]) / 604_800),
        sqrt_a=axis_m**0.5,
        **(issues | more),
        **{name: values[name] for name in _AS_THEY_ARE},
    )
    return made if find_orbit_fault(made) is None else None
