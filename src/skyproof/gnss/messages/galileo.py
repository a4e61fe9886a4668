"""I/NAV and F/NAV of Galileo: words and pages to ephemerides (Galileo OS SIS ICD 2.1, 4.2 to 4.4 and 5.1)."""

import bisect
from collections.abc import Mapping
from typing import Any, Final

from skyproof.gnss.constants import SECONDS_PER_DAY
from skyproof.gnss.ephemeris import Ephemeris, UtcParameters, UtcStatement
from skyproof.gnss.lnav import URA_M
from skyproof.gnss.messages.bit_fields import EPHEMERIS_NAMES, BitField, Words, compute_crc_24q, read_fields
from skyproof.gnss.time import find_nearest_week, gpst

__all__ = ["fnav_ephemeris", "fnav_page", "inav_ephemeris", "inav_utc", "inav_word", "sisa_m"]

_GST_WEEK_0: Final = 1024  # the GPS week in which Galileo's time began; its week counts modulo 4096 (5.1.2)
_INAV_BITS, _WORD_BITS, _FNAV_BITS = 240, 128, 244
_SISA_STEPS_M: Final = ((50, 0.0, 0.01), (75, 0.5, 0.02), (100, 1.0, 0.04), (126, 2.0, 0.16))  # table 89


def _list_clock_fields(first: int) -> tuple[BitField, ...]:
    """Return time of clock and polynomial, which both messages pack alike."""
    return (
        BitField("toc", ((first, 14),), 60.0),
        BitField("af0", ((first + 14, 31),), 2.0**-34, signed=True),
        BitField("af1", ((first + 45, 21),), 2.0**-46, signed=True),
        BitField("af2", ((first + 66, 6),), 2.0**-59, signed=True),
    )


_INAV: Final[dict[int, tuple[BitField, ...]]] = {
    1: (
        BitField("iode", ((6, 10),)),
        BitField("toe", ((16, 14),), 60.0),
        BitField("m0", ((30, 32),), 2.0**-31, signed=True, angle=True),
        BitField("e", ((62, 32),), 2.0**-33),
        BitField("sqrt_a", ((94, 32),), 2.0**-19),
    ),
    2: (
        BitField("iode", ((6, 10),)),
        BitField("omega0", ((16, 32),), 2.0**-31, signed=True, angle=True),
        BitField("i0", ((48, 32),), 2.0**-31, signed=True, angle=True),
        BitField("omega", ((80, 32),), 2.0**-31, signed=True, angle=True),
        BitField("idot", ((112, 14),), 2.0**-43, signed=True, angle=True),
    ),
    3: (
        BitField("iode", ((6, 10),)),
        BitField("omega_dot", ((16, 24),), 2.0**-43, signed=True, angle=True),
        BitField("delta_n", ((40, 16),), 2.0**-43, signed=True, angle=True),
        BitField("cuc", ((56, 16),), 2.0**-29, signed=True),
        BitField("cus", ((72, 16),), 2.0**-29, signed=True),
        BitField("crc", ((88, 16),), 2.0**-5, signed=True),
        BitField("crs", ((104, 16),), 2.0**-5, signed=True),
        BitField("sisa", ((120, 8),)),
    ),
    4: (
        BitField("iode", ((6, 10),)),
        BitField("svid", ((16, 6),)),
        BitField("cic", ((22, 16),), 2.0**-29, signed=True),
        BitField("cis", ((38, 16),), 2.0**-29, signed=True),
        *_list_clock_fields(54),
    ),
    5: (
        BitField("tgd", ((47, 10),), 2.0**-32, signed=True),
        BitField("tgd2", ((57, 10),), 2.0**-32, signed=True),
        BitField("e5b_health", ((67, 2),)),
        BitField("e1_health", ((69, 2),)),
        BitField("e5b_invalid", ((71, 1),)),
        BitField("e1_invalid", ((72, 1),)),
        BitField("week_mod_4096", ((73, 12),)),
        BitField("tow_s", ((85, 20),)),
    ),
    6: (
        BitField("a0", ((6, 32),), 2.0**-30, signed=True),
        BitField("a1", ((38, 24),), 2.0**-50, signed=True),
        BitField("leap_seconds", ((62, 8),), signed=True),
        BitField("tot", ((70, 8),), 3600.0),
        BitField("wnt_mod_256", ((78, 8),)),
        BitField("wn_lsf_mod_256", ((86, 8),)),
        BitField("dn", ((94, 3),)),
        BitField("leap_seconds_future", ((97, 8),), signed=True),
    ),
}
"""Of the words of I/NAV (tables 42 to 47)."""
_FNAV: Final[dict[int, tuple[BitField, ...]]] = {
    1: (
        BitField("svid", ((6, 6),)),
        BitField("iode", ((12, 10),)),
        *_list_clock_fields(22),
        BitField("sisa", ((94, 8),)),
        BitField("tgd", ((143, 10),), 2.0**-32, signed=True),
        BitField("e5a_health", ((153, 2),)),
        BitField("week_mod_4096", ((155, 12),)),
        BitField("tow_s", ((167, 20),)),
        BitField("e5a_invalid", ((187, 1),)),
    ),
    2: (
        BitField("iode", ((6, 10),)),
        BitField("m0", ((16, 32),), 2.0**-31, signed=True, angle=True),
        BitField("omega_dot", ((48, 24),), 2.0**-43, signed=True, angle=True),
        BitField("e", ((72, 32),), 2.0**-33),
        BitField("sqrt_a", ((104, 32),), 2.0**-19),
        BitField("omega0", ((136, 32),), 2.0**-31, signed=True, angle=True),
        BitField("idot", ((168, 14),), 2.0**-43, signed=True, angle=True),
    ),
    3: (
        BitField("iode", ((6, 10),)),
        BitField("i0", ((16, 32),), 2.0**-31, signed=True, angle=True),
        BitField("omega", ((48, 32),), 2.0**-31, signed=True, angle=True),
        BitField("delta_n", ((80, 16),), 2.0**-43, signed=True, angle=True),
        BitField("cuc", ((96, 16),), 2.0**-29, signed=True),
        BitField("cus", ((112, 16),), 2.0**-29, signed=True),
        BitField("crc", ((128, 16),), 2.0**-5, signed=True),
        BitField("crs", ((144, 16),), 2.0**-5, signed=True),
        BitField("toe", ((160, 14),), 60.0),
    ),
    4: (
        BitField("iode", ((6, 10),)),
        BitField("cic", ((16, 16),), 2.0**-29, signed=True),
        BitField("cis", ((32, 16),), 2.0**-29, signed=True),
    ),
}
"""Of the pages of F/NAV (tables 28 to 31)."""


def inav_word(frame: int) -> tuple[int, Mapping[str, float]] | None:
    """Return type and numbers of the word in an even and an odd page (240 bits, the even one first).

    None for pages of an alert, in the wrong order, or whose checksum fails; numbers are none for words not used here.
    """
    even, odd = frame >> 120, frame & (1 << 120) - 1
    if even >> 118 != 0b00 or odd >> 118 != 0b10:  # even or odd, and a nominal page
        return None
    covered = (even >> 6) << 82 | odd >> 38  # 114 bits of the even page and 82 of the odd one
    if compute_crc_24q(covered, 196) != odd >> 14 & 0xFFFFFF:
        return None
    word = (even >> 6 & (1 << 112) - 1) << 16 | odd >> 102 & 0xFFFF
    kind = word >> 122
    return kind, read_fields(_INAV.get(kind, ()), word, _WORD_BITS)


def fnav_page(frame: int) -> tuple[int, Mapping[str, float]] | None:
    """Return type and numbers of a page (244 bits); None where its checksum fails."""
    if compute_crc_24q(frame >> 30, 214) != frame >> 6 & 0xFFFFFF:
        return None
    kind = frame >> 238
    return kind, read_fields(_FNAV.get(kind, ()), frame, _FNAV_BITS)


def inav_ephemeris(words: Words, sat: str, week_near: int) -> Ephemeris | None:
    """Return the ephemeris that words 1 to 5 make; None unless 1 to 4 share one issue of data.

    week_near : a full GPS week within 39 years of the truth.
    """
    if not all(kind in words for kind in (1, 2, 3, 4, 5)):
        return None
    if len({words[kind]["iode"] for kind in (1, 2, 3, 4)}) != 1 or words[4]["svid"] != int(sat[1:]):
        return None
    of_five = words[5]
    # As RINEX packs it (3.05, table A8): E1-B in bits 0 to 2, E5b in bits 6 to 8.
    health = int(of_five["e1_invalid"]) | int(of_five["e1_health"]) << 1
    health |= int(of_five["e5b_invalid"]) << 6 | int(of_five["e5b_health"]) << 7
    merged: dict[str, Any] = {**words[1], **words[2], **words[3], **words[4]}
    merged |= {"tgd": of_five["tgd"], "tgd2": of_five["tgd2"]}
    return _make_ephemeris(merged, sat, of_five, week_near, health, "INAV")


def fnav_ephemeris(pages: Words, sat: str, week_near: int) -> Ephemeris | None:
    """Return the ephemeris that pages 1 to 4 make; None unless all share one issue of data."""
    if not all(kind in pages for kind in (1, 2, 3, 4)):
        return None
    if len({pages[kind]["iode"] for kind in (1, 2, 3, 4)}) != 1 or pages[1]["svid"] != int(sat[1:]):
        return None
    health = (int(pages[1]["e5a_invalid"]) | int(pages[1]["e5a_health"]) << 1) << 3  # bits 3 to 5
    merged: dict[str, Any] = {**pages[1], **pages[2], **pages[3], **pages[4], "tgd2": 0.0}
    return _make_ephemeris(merged, sat, pages[1], week_near, health, "FNAV")


def _make_ephemeris(
    merged: dict[str, Any], sat: str, timed: Mapping[str, float], week_near: int, health: int, message: str
) -> Ephemeris:
    sent_week = find_nearest_week(int(timed["week_mod_4096"]) + _GST_WEEK_0, week_near, 4096)

    def week_of(second: float) -> int:
        """Return the week of a time of ephemeris or clock, which lies within half a week of when it was sent."""
        return sent_week + round((timed["tow_s"] - second) / 604_800)

    return Ephemeris(
        sat=sat,
        week=week_of(merged["toe"]),
        toc_week=week_of(merged["toc"]),
        iode=int(merged["iode"]),
        iodc=int(merged["iode"]),
        health=health,
        ura_index=bisect.bisect_left(URA_M, sisa_m(int(merged["sisa"]))),
        message=message,
        **{name: merged[name] for name in EPHEMERIS_NAMES},
    )


def inav_utc(word: Mapping[str, float], sat: str, week_near: int) -> UtcStatement:
    """Return what word 6 says of UTC (5.1.7). week_near : a full GPS week within two years of the truth."""
    week = find_nearest_week(int(word["wnt_mod_256"]) + _GST_WEEK_0, week_near, 256)
    later_week = find_nearest_week(int(word["wn_lsf_mod_256"]) + _GST_WEEK_0, week_near, 256)
    leap_seconds = int(word["leap_seconds"])
    return UtcStatement(
        sat=sat,
        utc=UtcParameters(a0=word["a0"], a1=word["a1"], tot=word["tot"], wnt=week, leap_seconds=leap_seconds),
        later_leap_seconds=int(word["leap_seconds_future"]),
        later_from_gpst=gpst(later_week, SECONDS_PER_DAY * word["dn"] + leap_seconds),
    )


def sisa_m(index: int) -> float:
    """Return the signal-in-space accuracy of an index, metres; infinite where none is promised."""
    lower = 0
    for end, begin_m, step_m in _SISA_STEPS_M:
        if index < end:
            return begin_m + step_m * (index - lower)
        lower = end
    return float("inf")
