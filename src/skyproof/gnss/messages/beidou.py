"""D1 and D2 of BeiDou: subframes and pages to ephemerides (BDS-SIS-ICD-B1I-3.0, 5.2 and 5.3).

A frame is 300 bits with their parity bits, as sent after the interleaving is undone: 26 bits of data and 4 of parity
in the first word, 22 and 8 in the nine others.
"""

from collections.abc import Mapping
from typing import Any, Final

from skyproof.gnss.constants import BDT_BEHIND_GPST_S, SECONDS_PER_DAY
from skyproof.gnss.ephemeris import Ephemeris, UtcParameters, UtcStatement
from skyproof.gnss.messages.bit_fields import EPHEMERIS_NAMES, BitField, Words, read_fields
from skyproof.gnss.time import find_nearest_week, gpst

__all__ = ["d1_ephemeris", "d1_subframe", "d1_utc", "d2_ephemeris", "d2_page"]

_BITS: Final = 300
_PREAMBLE: Final = 0b11100010010
_WEEK_0: Final = 1356  # the GPS week in which BDT began; its week counts to 8191
_SECOND: Final = BitField("sow_s", ((18, 8), (30, 12)))

_D1: Final[dict[int, tuple[BitField, ...]]] = {
    1: (
        BitField("health", ((42, 1),)),
        BitField("iodc", ((43, 5),)),
        BitField("ura_index", ((48, 4),)),
        BitField("week_mod_8192", ((60, 13),)),
        BitField("toc", ((73, 9), (90, 8)), 8.0),
        BitField("tgd", ((98, 10),), 1e-10, signed=True),
        BitField("tgd2", ((108, 4), (120, 6)), 1e-10, signed=True),
        BitField("af2", ((214, 11),), 2.0**-66, signed=True),
        BitField("af0", ((225, 7), (240, 17)), 2.0**-33, signed=True),
        BitField("af1", ((257, 5), (270, 17)), 2.0**-50, signed=True),
        BitField("iode", ((287, 5),)),
    ),
    2: (
        BitField("delta_n", ((42, 10), (60, 6)), 2.0**-43, signed=True, angle=True),
        BitField("cuc", ((66, 16), (90, 2)), 2.0**-31, signed=True),
        BitField("m0", ((92, 20), (120, 12)), 2.0**-31, signed=True, angle=True),
        BitField("e", ((132, 10), (150, 22)), 2.0**-33),
        BitField("cus", ((180, 18),), 2.0**-31, signed=True),
        BitField("crc", ((198, 4), (210, 14)), 2.0**-6, signed=True),
        BitField("crs", ((224, 8), (240, 10)), 2.0**-6, signed=True),
        BitField("sqrt_a", ((250, 12), (270, 20)), 2.0**-19),
        BitField("toe_high", ((290, 2),), 8.0 * 2.0**15),
    ),
    3: (
        BitField("toe_low", ((42, 10), (60, 5)), 8.0),
        BitField("i0", ((65, 17), (90, 15)), 2.0**-31, signed=True, angle=True),
        BitField("cic", ((105, 7), (120, 11)), 2.0**-31, signed=True),
        BitField("omega_dot", ((131, 11), (150, 13)), 2.0**-43, signed=True, angle=True),
        BitField("cis", ((163, 9), (180, 9)), 2.0**-31, signed=True),
        BitField("idot", ((189, 13), (210, 1)), 2.0**-43, signed=True, angle=True),
        BitField("omega0", ((211, 21), (240, 11)), 2.0**-31, signed=True, angle=True),
        BitField("omega", ((251, 11), (270, 21)), 2.0**-31, signed=True, angle=True),
    ),
    5: (
        BitField("page", ((43, 7),)),
        BitField("leap_seconds", ((50, 2), (60, 6)), signed=True),
        BitField("leap_seconds_future", ((66, 8),), signed=True),
        BitField("wn_lsf_mod_256", ((74, 8),)),
        BitField("a0", ((90, 22), (120, 10)), 2.0**-30, signed=True),
        BitField("a1", ((130, 12), (150, 12)), 2.0**-50, signed=True),
        BitField("dn", ((162, 8),)),
    ),
}
"""Of subframes 1 to 3 and of page 10 of subframe 5 of D1 (figures 5-8 to 5-10 and 5-11-9)."""
_UTC_PAGE: Final = 10


def d1_subframe(frame: int) -> tuple[int, Mapping[str, float]] | None:
    """Return number and contents of a subframe of D1; None where it does not begin as one."""
    if frame >> 289 != _PREAMBLE:
        return None
    number = frame >> 282 & 7
    fields = (_SECOND, *_D1.get(number, ()))
    return number, read_fields(fields, frame, _BITS)


def d1_utc(subframe: Mapping[str, float], sat: str, week_near: int) -> UtcStatement | None:
    """Return what page 10 of subframe 5 says of UTC (5.2.4.18); None for other pages.

    week_near : a full GPS week within two years of the truth.
    """
    if subframe.get("page") != _UTC_PAGE:
        return None
    week = find_nearest_week(int(subframe["wn_lsf_mod_256"]) + _WEEK_0, week_near, 256)
    leap_seconds, later = (int(subframe[name] + BDT_BEHIND_GPST_S) for name in ("leap_seconds", "leap_seconds_future"))
    # Its parameters count from the beginning of the week.
    return UtcStatement(
        sat=sat,
        utc=UtcParameters(a0=subframe["a0"], a1=subframe["a1"], tot=0.0, wnt=week_near, leap_seconds=leap_seconds),
        later_leap_seconds=later,
        later_from_gpst=gpst(week, SECONDS_PER_DAY * (subframe["dn"] + 1) + leap_seconds),  # days count from 0
    )


def d1_ephemeris(subframes: Words, sat: str, week_near: int) -> Ephemeris | None:
    """Return the ephemeris that subframes 1 to 3 make; None unless they were sent one after the other.

    week_near : a full GPS week within 78 years of the truth.
    """
    if not all(number in subframes for number in (1, 2, 3)):
        return None
    first_s = subframes[1]["sow_s"]
    if any(subframes[number]["sow_s"] != first_s + 6.0 * (number - 1) for number in (2, 3)):
        return None
    merged: dict[str, Any] = {**subframes[3], **subframes[2], **subframes[1]}
    merged["toe"] = merged["toe_high"] + merged["toe_low"]
    return _make_ephemeris(merged, sat, week_near, "D1")


_D2_PAGES: Final[dict[int, tuple[BitField, ...]]] = {
    1: (
        BitField("health", ((46, 1),)),
        BitField("iodc", ((47, 5),)),
        BitField("ura_index", ((60, 4),)),
        BitField("week_mod_8192", ((64, 13),)),
        BitField("toc", ((77, 5), (90, 12)), 8.0),
        BitField("tgd", ((102, 10),), 1e-10, signed=True),
        BitField("tgd2", ((120, 10),), 1e-10, signed=True),
    ),
    3: (BitField("af0", ((100, 12), (120, 12)), 2.0**-33, signed=True), BitField("af1_high", ((132, 4),))),
    4: (
        BitField("af1_low", ((46, 6), (60, 12))),
        BitField("af2", ((72, 10), (90, 1)), 2.0**-66, signed=True),
        BitField("iode", ((91, 5),)),
        BitField("delta_n", ((96, 16),), 2.0**-43, signed=True, angle=True),
        BitField("cuc_high", ((120, 14),)),
    ),
    5: (
        BitField("cuc_low", ((46, 4),)),
        BitField("m0", ((50, 2), (60, 22), (90, 8)), 2.0**-31, signed=True, angle=True),
        BitField("cus", ((98, 14), (120, 4)), 2.0**-31, signed=True),
        BitField("e_high", ((124, 10),)),
    ),
    6: (
        BitField("e_low", ((46, 6), (60, 16))),
        BitField("sqrt_a", ((76, 6), (90, 22), (120, 4)), 2.0**-19),
        BitField("cic_high", ((124, 10),)),
    ),
    7: (
        BitField("cic_low", ((46, 6), (60, 2))),
        BitField("cis", ((62, 18),), 2.0**-31, signed=True),
        BitField("toe", ((80, 2), (90, 15)), 8.0),
        BitField("i0_high", ((105, 7), (120, 14))),
    ),
    8: (
        BitField("i0_low", ((46, 6), (60, 5))),
        BitField("crc", ((65, 17), (90, 1)), 2.0**-6, signed=True),
        BitField("crs", ((91, 18),), 2.0**-6, signed=True),
        BitField("omega_dot_high", ((109, 3), (120, 16))),
    ),
    9: (
        BitField("omega_dot_low", ((46, 5),)),
        BitField("omega0", ((51, 1), (60, 22), (90, 9)), 2.0**-31, signed=True, angle=True),
        BitField("omega_high", ((99, 13), (120, 14))),
    ),
    10: (BitField("omega_low", ((46, 5),)), BitField("idot", ((51, 1), (60, 13)), 2.0**-43, signed=True, angle=True)),
}
"""Of the pages of subframe 1 of D2 that carry the ephemeris (figures 5-14 to 5-23)."""
_DIVIDED: Final = {
    "af1": BitField("af1", ((0, 4), (4, 18)), 2.0**-50, signed=True),
    "cuc": BitField("cuc", ((0, 14), (14, 4)), 2.0**-31, signed=True),
    "e": BitField("e", ((0, 10), (10, 22)), 2.0**-33),
    "cic": BitField("cic", ((0, 10), (10, 8)), 2.0**-31, signed=True),
    "i0": BitField("i0", ((0, 21), (21, 11)), 2.0**-31, signed=True, angle=True),
    "omega_dot": BitField("omega_dot", ((0, 19), (19, 5)), 2.0**-43, signed=True, angle=True),
    "omega": BitField("omega", ((0, 27), (27, 5)), 2.0**-31, signed=True, angle=True),
}
"""Numbers that begin on one page and end on the next."""


def d2_page(frame: int) -> tuple[int, Mapping[str, float]] | None:
    """Return number and contents of a page of subframe 1 of D2; None for all other frames."""
    if frame >> 289 != _PREAMBLE or frame >> 282 & 7 != 1:
        return None
    number = frame >> 254 & 15
    return number, read_fields((_SECOND, *_D2_PAGES.get(number, ())), frame, _BITS)


def d2_ephemeris(pages: Words, sat: str, week_near: int) -> Ephemeris | None:
    """Return the ephemeris that pages 1 and 3 to 10 make; None unless they were sent in one half minute."""
    if not all(number in pages for number in _D2_PAGES):
        return None
    first_s = pages[1]["sow_s"]
    if any(pages[number]["sow_s"] != first_s + 3.0 * (number - 1) for number in _D2_PAGES):
        return None
    merged: dict[str, Any] = {name: value for number in _D2_PAGES for name, value in pages[number].items()}
    for name, field in _DIVIDED.items():
        n_low = field.runs[1][1]
        n_bits = field.runs[0][1] + n_low
        merged[name] = field.value(int(merged[f"{name}_high"]) << n_low | int(merged[f"{name}_low"]), n_bits)
    merged["sow_s"] = first_s
    return _make_ephemeris(merged, sat, week_near, "D2")


def _make_ephemeris(merged: Mapping[str, Any], sat: str, week_near: int, message: str) -> Ephemeris:
    sent_week = find_nearest_week(int(merged["week_mod_8192"]) + _WEEK_0, week_near, 8192)
    return Ephemeris(
        sat=sat,
        week=sent_week + round((merged["sow_s"] - merged["toe"]) / 604_800),
        toc_week=sent_week + round((merged["sow_s"] - merged["toc"]) / 604_800),
        iode=int(merged["iode"]),
        iodc=int(merged["iodc"]),
        health=int(merged["health"]),
        ura_index=int(merged["ura_index"]),
        message=message,
        **{name: merged[name] for name in EPHEMERIS_NAMES},
    )
