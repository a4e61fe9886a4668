"""LNAV, the message of GPS L1 C/A: words with parity, subframes, and what they carry (IS-GPS-200N, 20.3).

Bits are int8 0 and 1 in order of transmission. A stream from a carrier loop may be inverted as a whole: decoding takes
either polarity. Ten words of 30 bits make a subframe of 6 s. A field is named by the numbers of its bits in the
subframe, 1 to 300, as the figures of the standard name them.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Booleans, Integers
from skyproof.gnss.constants import GPS_PI, SECONDS_PER_DAY, SECONDS_PER_WEEK
from skyproof.gnss.ephemeris import Ephemeris, Klobuchar, UtcParameters, UtcStatement
from skyproof.gnss.orbit_faults import find_orbit_fault
from skyproof.gnss.time import find_nearest_week, gpst, leap_seconds

__all__ = [
    "BITS_PER_SUBFRAME",
    "SUBFRAME_S",
    "URA_M",
    "Bits",
    "How",
    "Subframe",
    "check_words",
    "decode_how",
    "decode_subframe",
    "encode_subframes",
    "ephemeris_from_subframes",
    "find_subframes",
    "find_word_signs",
    "fit_interval_h",
    "ionosphere_and_utc",
    "quantise",
    "subframe_from_source",
    "utc_statement",
]

Bits = NDArray[np.int8]

BITS_PER_SUBFRAME: Final = 300
SUBFRAME_S: Final = 6
URA_M: Final = (2.4, 3.4, 4.85, 6.85, 9.65, 13.65, 24.0, 48.0, 96.0, 192.0, 384.0, 768.0, 1536.0, 3072.0, 6144.0)
"""Upper limit of the user range accuracy of index 0 to 14, metres; 15 promises nothing (IS-GPS-200N, 20.3.3.3.1.3)."""

_PREAMBLE: Final = np.array([1, 0, 0, 0, 1, 0, 1, 1], dtype=np.int8)  # 20.3.3.1
_PREAMBLE_VALUE: Final = 0b10001011
_ZEROS: Final = np.zeros(2, dtype=np.int8)
_HOW_COUNTS: Final = SECONDS_PER_WEEK // SUBFRAME_S
_IONOSPHERE_PAGE, _IONOSPHERE_SV_ID = 18, 56  # of subframe 4; table 20-V

# ---------------------------------------------------------------- parity: 20.3.5.2 and table 20-XIV

_PARITY_OF: Final = (
    (1, 2, 3, 5, 6, 10, 11, 12, 13, 14, 17, 18, 20, 23),
    (2, 3, 4, 6, 7, 11, 12, 13, 14, 15, 18, 19, 21, 24),
    (1, 3, 4, 5, 7, 8, 12, 13, 14, 15, 16, 19, 20, 22),
    (2, 4, 5, 6, 8, 9, 13, 14, 15, 16, 17, 20, 21, 23),
    (1, 3, 5, 6, 7, 9, 10, 14, 15, 16, 17, 18, 21, 22, 24),
    (3, 5, 6, 8, 9, 10, 11, 13, 15, 19, 22, 23, 24),
)
_PARITY: Final = np.array([[bit in row for row in _PARITY_OF] for bit in range(1, 25)], dtype=np.int8)
_PARITY_OF_LAST_TWO: Final = np.array([[1, 0, 1, 0, 0, 1], [0, 1, 0, 1, 1, 0]], dtype=np.int8)  # rows D29*, D30*


def _compute_parity(data: Bits, last_two: Bits) -> Bits:
    """Compute six parity bits (..., 6) of source bits (..., 24) after a word that ended in `last_two` (..., 2)."""
    return np.asarray((data @ _PARITY + last_two @ _PARITY_OF_LAST_TWO) & 1, dtype=np.int8)


def check_words(bits: Bits) -> tuple[Bits, Booleans]:
    """Check the parity of the whole words at the start of a subframe of upright polarity.

    Parameters
    ----------
    bits : (..., 30 n) from the first bit of a subframe; the word before it ended in two zeros, as word 10 always does.

    Returns
    -------
    data : (..., n, 24) bits as they were before encoding.
    holds : (..., n) whether the parity of each word is right.
    """
    words = bits.reshape(*bits.shape[:-1], -1, 30)
    last_two = np.zeros((*words.shape[:-1], 2), dtype=np.int8)
    last_two[..., 1:, :] = words[..., :-1, 28:]
    data = words[..., :24] ^ last_two[..., 1:]
    return data, (_compute_parity(data, last_two) == words[..., 24:]).all(axis=-1)


def find_word_signs(bits: Bits, start: int) -> tuple[Integers, Booleans, NDArray[np.int8]]:
    """Find the polarity of each whole word in a stream of bits (n,) with a subframe at bit `start`.

    Returns
    -------
    at : (n_words,) first bit of each word that has at least two bits before it.
    holds : (n_words,) whether its parity is right, in either polarity as long as those two bits came in the same.
    signs : (n_words,) +1 upright, -1 inverted, by its known bits; 0 for other words and where it does not hold. Known
    are the preamble, and the zeros in which words 2 and 10 end (20.3.3.2).
    """
    first = start % 30 if start % 30 > 1 else start % 30 + 30
    at = np.arange(first, bits.size - 29, 30)
    words = bits[at[:, None] + np.arange(30)]
    last_two = bits[at[:, None] + np.arange(-2, 0)]
    holds = (_compute_parity(words[:, :24] ^ last_two[:, 1:], last_two) == words[:, 24:]).all(axis=-1)
    signs = np.zeros(at.size, np.int8)
    number = (at - start) // 30 % 10
    for which, begin, expected in ((0, 0, _PREAMBLE), (1, 28, _ZEROS), (9, 28, _ZEROS)):
        wrong = (words[:, begin : begin + expected.size] != expected).mean(axis=-1)
        signs[(number == which) & holds & (wrong == 0.0)] = 1
        signs[(number == which) & holds & (wrong == 1.0)] = -1
    return at, holds, signs


def _encode_words(data: Bits) -> Bits:
    """Encode source bits (10, 24) as 300 bits.

    Bits 23 and 24 of words 2 and 10 are chosen so that those end in zeros.
    """
    words = np.empty((10, 30), dtype=np.int8)
    last_two = np.zeros(2, dtype=np.int8)
    for k, source in enumerate(data.copy()):
        if k in (1, 9):
            source[22:] = 0
            d29, d30 = _compute_parity(source, last_two)[4:]
            source[23] = d29  # D29 takes in bit 24, D30 takes in bits 23 and 24
            source[22] = d30 ^ d29
        words[k, :24] = source ^ last_two[1]
        words[k, 24:] = _compute_parity(source, last_two)
        last_two = words[k, 28:]
    return words.reshape(BITS_PER_SUBFRAME)


# ---------------------------------------------------------------- fields: figure 20-1, tables 20-I, -III, -IX and -X


@dataclass(frozen=True)
class _Field:
    """A number in a subframe: runs of (first bit, length), most significant first; value = integer * scale."""

    name: str
    runs: tuple[tuple[int, int], ...]
    scale: float = 1.0
    signed: bool = False
    angle: bool = False  # semicircles in the message, radians outside

    @property
    def length(self) -> int:
        return sum(length for _, length in self.runs)

    @property
    def whole(self) -> bool:
        return self.scale == 1.0 and not self.angle

    @property
    def step(self) -> float:
        """Return the value of the least significant bit."""
        return self.scale * GPS_PI if self.angle else self.scale

    def value(self, source: int) -> float:
        """Extract the value from 240 source bits, an integer whose highest bit is bit 1 of the subframe."""
        raw = 0
        for first, length in self.runs:
            raw = raw << length | _cut(source, first, length)
        if self.signed and raw >> (self.length - 1):
            raw -= 1 << self.length
        return raw if self.whole else raw * self.scale * (GPS_PI if self.angle else 1.0)

    def put(self, value: float) -> int:
        """Encode `value` as source bits; ValueError if it does not fit."""
        raw = round(value / GPS_PI / self.scale) if self.angle else round(value / self.scale)
        lowest = -(1 << (self.length - 1)) if self.signed else 0
        if not lowest <= raw < lowest + (1 << self.length):
            raise ValueError(f"{self.name} = {value} does not fit into {self.length} bits of {self.step:g}")
        raw %= 1 << self.length
        source, remaining = 0, self.length
        for first, length in self.runs:
            remaining -= length
            source |= (raw >> remaining & (1 << length) - 1) << _find_shift(first, length)
        return source


def _find_shift(first: int, length: int) -> int:
    """Return how far a run of bits stands from the right end of the 240 source bits (without parity bits)."""
    word, bit = divmod(first - 1, 30)
    return 240 - 24 * word - bit - length


def _cut(source: int, first: int, length: int) -> int:
    return source >> _find_shift(first, length) & (1 << length) - 1


_HOW: Final = (
    _Field("preamble", ((1, 8),)),
    _Field("how", ((31, 17),)),
    _Field("alert", ((48, 1),)),
    _Field("anti_spoof", ((49, 1),)),
    _Field("id", ((50, 3),)),
)

_PAGE: Final = (_Field("data_id", ((61, 2),)), _Field("sv_id", ((63, 6),)))

_IONOSPHERE_AND_UTC: Final = (
    _Field("alpha0", ((69, 8),), 2.0**-30, signed=True),
    _Field("alpha1", ((77, 8),), 2.0**-27, signed=True),
    _Field("alpha2", ((91, 8),), 2.0**-24, signed=True),
    _Field("alpha3", ((99, 8),), 2.0**-24, signed=True),
    _Field("beta0", ((107, 8),), 2.0**11, signed=True),
    _Field("beta1", ((121, 8),), 2.0**14, signed=True),
    _Field("beta2", ((129, 8),), 2.0**16, signed=True),
    _Field("beta3", ((137, 8),), 2.0**16, signed=True),
    _Field("a1", ((151, 24),), 2.0**-50, signed=True),
    _Field("a0", ((181, 24), (211, 8)), 2.0**-30, signed=True),
    _Field("tot", ((219, 8),), 2.0**12),
    _Field("wnt_mod_256", ((227, 8),)),
    _Field("leap_seconds", ((241, 8),), signed=True),
    _Field("wn_lsf_mod_256", ((249, 8),)),
    _Field("dn", ((257, 8),)),
    _Field("leap_seconds_future", ((271, 8),), signed=True),
)

_FIELDS: Final[Mapping[int, tuple[_Field, ...]]] = {
    1: (
        _Field("week_mod_1024", ((61, 10),)),
        _Field("code_on_l2", ((71, 2),)),
        _Field("ura_index", ((73, 4),)),
        _Field("health", ((77, 6),)),
        _Field("iodc", ((83, 2), (211, 8))),
        _Field("l2_p_flag", ((91, 1),)),
        _Field("tgd", ((197, 8),), 2.0**-31, signed=True),
        _Field("toc", ((219, 16),), 16.0),
        _Field("af2", ((241, 8),), 2.0**-55, signed=True),
        _Field("af1", ((249, 16),), 2.0**-43, signed=True),
        _Field("af0", ((271, 22),), 2.0**-31, signed=True),
    ),
    2: (
        _Field("iode", ((61, 8),)),
        _Field("crs", ((69, 16),), 2.0**-5, signed=True),
        _Field("delta_n", ((91, 16),), 2.0**-43, signed=True, angle=True),
        _Field("m0", ((107, 8), (121, 24)), 2.0**-31, signed=True, angle=True),
        _Field("cuc", ((151, 16),), 2.0**-29, signed=True),
        _Field("e", ((167, 8), (181, 24)), 2.0**-33),
        _Field("cus", ((211, 16),), 2.0**-29, signed=True),
        _Field("sqrt_a", ((227, 8), (241, 24)), 2.0**-19),
        _Field("toe", ((271, 16),), 16.0),
        _Field("fit_interval_flag", ((287, 1),)),
        _Field("aodo", ((288, 5),)),
    ),
    3: (
        _Field("cic", ((61, 16),), 2.0**-29, signed=True),
        _Field("omega0", ((77, 8), (91, 24)), 2.0**-31, signed=True, angle=True),
        _Field("cis", ((121, 16),), 2.0**-29, signed=True),
        _Field("i0", ((137, 8), (151, 24)), 2.0**-31, signed=True, angle=True),
        _Field("crc", ((181, 16),), 2.0**-5, signed=True),
        _Field("omega", ((197, 8), (211, 24)), 2.0**-31, signed=True, angle=True),
        _Field("omega_dot", ((241, 24),), 2.0**-43, signed=True, angle=True),
        _Field("iode", ((271, 8),)),
        _Field("idot", ((279, 14),), 2.0**-43, signed=True, angle=True),
    ),
    4: _PAGE,
    5: _PAGE,
}


# ---------------------------------------------------------------- decoding


@dataclass(frozen=True)
class How:
    """What the first two words of a subframe state."""

    id: int  # 1 to 5
    tow_s: int  # of the start of this subframe
    inverted: bool  # polarity of the bits as they came
    alert: bool  # IS-GPS-200N, 20.3.3.2: use the satellite at one's own risk


@dataclass(frozen=True, kw_only=True)
class Subframe(How):
    """One subframe that holds. `words` are ten of 24 source bits; `fields` in seconds, metres, radians, or whole."""

    words: tuple[int, ...]
    fields: Mapping[str, float]


def decode_how(bits: Bits) -> How | None:
    """Decode the time of week from the first 60 bits of a subframe, of either polarity.

    None as for `decode_subframe`.
    """
    source, inverted = _decode_source(np.asarray(bits[:60], dtype=np.int8), 2)
    return None if source is None else _read_how(source, inverted)


def decode_subframe(bits: Bits) -> Subframe | None:
    """Decode the subframe in `bits`, shape (300,), of either polarity.

    None unless the preamble, the subframe's number, the zeros that words 2 and 10 end in, and the parity of all ten
    words hold.
    """
    source, inverted = _decode_source(np.asarray(bits, dtype=np.int8), 10)
    return None if source is None else _read_subframe(source, inverted)


def subframe_from_source(source: int) -> Subframe | None:
    """Read a subframe from its 240 source bits, as receivers log it after they checked the parity.

    None unless the preamble is there and the subframe's number fits its time.
    """
    return _read_subframe(source, False) if source >> 232 == _PREAMBLE_VALUE else None


def _read_subframe(source: int, inverted: bool) -> Subframe | None:
    how = _read_how(source, inverted)
    if how is None:
        return None
    table = _FIELDS[how.id]
    values = {field.name: field.value(source) for field in table}
    if how.id == 4 and values["sv_id"] == _IONOSPHERE_SV_ID:
        values |= {field.name: field.value(source) for field in _IONOSPHERE_AND_UTC}
    words = tuple(source >> 24 * (9 - k) & 0xFFFFFF for k in range(10))
    return Subframe(**vars(how), words=words, fields=values)


def find_subframes(bits: Bits) -> list[int]:
    """Find where subframes start in a stream of bits (n,) of one unknown polarity, in order.

    A start is where a preamble stands at the head of two words that hold, with a subframe number that fits the time;
    the last one may be cut off after these 60 bits. All of this happens by chance once in 2^24 bits, so the starts
    must also agree: whole subframes apart, one polarity, and hand-over words that count on. The largest family that
    agrees is returned: a damaged subframe is missing, and a false start does not appear beside true ones.
    """
    bits = np.asarray(bits, dtype=np.int8)
    if bits.size < 60:
        return []
    same = (np.lib.stride_tricks.sliding_window_view(bits, 8)[: bits.size - 59] == _PREAMBLE).sum(axis=-1)
    families: dict[tuple[int, bool, int], list[int]] = {}
    for start in np.flatnonzero((same == 8) | (same == 0)).tolist():
        how = decode_how(bits[start : start + 60])
        if how is not None:
            number, phase = divmod(start, BITS_PER_SUBFRAME)
            count_at_zero = (how.tow_s // SUBFRAME_S - number) % _HOW_COUNTS
            families.setdefault((phase, how.inverted, count_at_zero), []).append(start)

    def weight(starts: list[int]) -> tuple[int, int]:
        return len(starts), _count_words(bits[starts[0] : starts[0] + BITS_PER_SUBFRAME])

    return max(families.values(), key=weight, default=[])


def _count_words(bits: Bits) -> int:
    upright = bits ^ (1 - bits[0])
    return int(check_words(upright[: bits.size // 30 * 30])[1].sum())


def _decode_source(bits: Bits, n_words: int) -> tuple[int | None, bool]:
    """Decode all source bits to one integer of 240, highest bit first, or None.

    Returns whether they were inverted, too. Words not asked for are zeros.
    """
    if bits.size != 30 * n_words:
        raise ValueError(f"{bits.size} bits given, expected {30 * n_words}")
    inverted = bool(bits[0] == 0)  # the preamble begins with a one
    upright = bits ^ np.int8(inverted)
    data, holds = check_words(upright)
    ends = upright.reshape(-1, 30)[1::8, 28:]  # words 2 and 10 end in zeros: 20.3.3.2
    if not holds.all() or ends.any() or (data[0, :8] != _PREAMBLE).any():
        return None, inverted
    source = int.from_bytes(np.packbits(data.astype(np.uint8)).tobytes(), "big")
    return source << 24 * (10 - n_words), inverted


def _read_how(source: int, inverted: bool) -> How | None:
    values = {field.name: int(field.value(source)) for field in _HOW}
    tow_s = (values["how"] - 1) % _HOW_COUNTS * SUBFRAME_S  # the word gives the start of the next subframe
    if values["how"] >= _HOW_COUNTS or values["id"] != _find_id(tow_s):
        return None
    return How(id=values["id"], tow_s=tow_s, inverted=inverted, alert=bool(values["alert"]))


def _find_id(tow_s: int) -> int:
    """Return the number of the subframe that starts at this second.

    Every half minute of the week starts with 1 (20.3.4.1).
    """
    return tow_s // SUBFRAME_S % 5 + 1


# ---------------------------------------------------------------- gathering

_EPHEMERIS_FIELDS: Final = {field.name for field in fields(Ephemeris)}
_FIT_HOURS: Final = (
    (range(240, 248), 8.0),
    ((*range(248, 256), 496), 14.0),
    ((*range(497, 504), *range(1021, 1024)), 26.0),
)
"""Fit interval by IODC when the flag is set, other IODCs 6 h: IS-GPS-200N, table 20-XII."""


def ephemeris_from_subframes(
    sub1: Subframe, sub2: Subframe, sub3: Subframe, sat: str, week_near: int
) -> Ephemeris | None:
    """Combine subframes 1, 2 and 3 of one satellite to an ephemeris.

    None unless they belong to one data set (IODC and both IODEs agree, IS-GPS-200N, 20.3.4.4), with an orbit that a GPS
    satellite can have. `week_near` is a full week within ten years of the truth.
    """
    if (sub1.id, sub2.id, sub3.id) != (1, 2, 3):
        raise ValueError(f"subframes {sub1.id}, {sub2.id}, {sub3.id} given, expected 1, 2, 3")
    iode = sub2.fields["iode"]
    if iode != sub3.fields["iode"] or iode != int(sub1.fields["iodc"]) % 256:
        return None
    merged: dict[str, Any] = {**sub1.fields, **sub2.fields, **sub3.fields}
    week = find_nearest_week(merged["week_mod_1024"], week_near, 1024)
    ephemeris = Ephemeris(
        sat=sat,
        week=week + round((sub1.tow_s - merged["toe"]) / SECONDS_PER_WEEK),
        toc_week=week + round((sub1.tow_s - merged["toc"]) / SECONDS_PER_WEEK),
        fit_interval_h=fit_interval_h(merged["iodc"]) if merged["fit_interval_flag"] else 4.0,
        **{name: value for name, value in merged.items() if name in _EPHEMERIS_FIELDS},
    )
    return ephemeris if find_orbit_fault(ephemeris) is None else None


def ionosphere_and_utc(sub4: Subframe, week_near: int) -> tuple[Klobuchar, UtcParameters] | None:
    """Extract ionosphere and UTC from page 18 of subframe 4; None for any other subframe or page."""
    if "alpha0" not in sub4.fields:
        return None
    values: Any = sub4.fields
    klobuchar = Klobuchar(
        alpha=(values["alpha0"], values["alpha1"], values["alpha2"], values["alpha3"]),
        beta=(values["beta0"], values["beta1"], values["beta2"], values["beta3"]),
    )
    utc = UtcParameters(
        a0=values["a0"],
        a1=values["a1"],
        tot=values["tot"],
        wnt=find_nearest_week(values["wnt_mod_256"], week_near, 256),
        leap_seconds=values["leap_seconds"],
    )
    return klobuchar, utc


def utc_statement(sub4: Subframe, sat: str, week_near: int) -> UtcStatement | None:
    """Extract UTC, and a change of leap seconds, from page 18 of subframe 4.

    None for any other subframe or page.
    """
    found = ionosphere_and_utc(sub4, week_near)
    if found is None:
        return None
    values, utc = sub4.fields, found[1]
    week = find_nearest_week(int(values["wn_lsf_mod_256"]), week_near, 256)
    return UtcStatement(
        sat=sat,
        utc=utc,
        later_leap_seconds=int(values["leap_seconds_future"]),
        later_from_gpst=gpst(week, SECONDS_PER_DAY * values["dn"] + utc.leap_seconds),  # at the end of day DN of UTC
    )


def fit_interval_h(iodc: int) -> float:
    """Return the hours of fit of a data set whose flag says that they are not four (IS-GPS-200N, table 20-XII)."""
    return next((hours for iodcs, hours in _FIT_HOURS if iodc in iodcs), 6.0)


# ---------------------------------------------------------------- encoding


def encode_subframes(
    ephemeris: Ephemeris,
    klobuchar: Klobuchar | None,
    utc: UtcParameters | None,
    tow_of_start: int,
    week: int,
    count: int,
) -> Bits:
    """Encode the bits (count * 300,) that the satellite sends from `tow_of_start` of full week `week`.

    `tow_of_start` is a multiple of 6 s.

    Subframes 1 to 5 in turn, pages of 4 and 5 by the time as in a superframe that starts with the week. Page 18 of
    subframe 4 carries ionosphere and UTC (without one of them zeros, and the leap seconds of the time; a dummy page
    without both); every other page is a dummy of satellite 0, as sent when there is no almanac (IS-GPS-200N,
    20.3.3.5.1).
    Raises ValueError if a value does not fit into its field, or for a time between subframes.
    """
    if tow_of_start % SUBFRAME_S:
        raise ValueError(f"second of week {tow_of_start} is not the start of a subframe; expected a multiple of 6")
    first = week * _HOW_COUNTS + tow_of_start // SUBFRAME_S
    bodies: dict[tuple[int, int], int] = {}  # by week and kind of subframe: most of the work is done once
    stream = np.empty((count, BITS_PER_SUBFRAME), dtype=np.int8)
    for k in range(count):
        week_k, number = divmod(first + k, _HOW_COUNTS)
        sub_id, page = _find_id(number * SUBFRAME_S), number // 5 % 25 + 1
        kind = page * 10 + sub_id if sub_id > 3 else sub_id
        if (week_k, kind) not in bodies:
            bodies[week_k, kind] = _encode_body(ephemeris, klobuchar, utc, sub_id, page, week_k)
        head = {"preamble": 0b10001011, "how": (number + 1) % _HOW_COUNTS, "alert": 0, "anti_spoof": 1, "id": sub_id}
        source = bodies[week_k, kind] | _encode_fields(_HOW, head)
        stream[k] = _encode_words(_unpack_bits(source).reshape(10, 24))
    return stream.reshape(-1)


def quantise(ephemeris: Ephemeris) -> Ephemeris:
    """Round each value of an ephemeris to what its field in the message can hold, as a receiver gets it."""
    values = asdict(ephemeris)
    for table in (_FIELDS[1], _FIELDS[2], _FIELDS[3]):
        for field in table:
            if field.name in values:
                values[field.name] = field.value(field.put(values[field.name]))
    return replace(ephemeris, **values)


def _encode_body(
    ephemeris: Ephemeris, klobuchar: Klobuchar | None, utc: UtcParameters | None, sub_id: int, page: int, week: int
) -> int:
    """Encode words 3 to 10 of a subframe as source bits."""
    if sub_id <= 3:
        values = asdict(ephemeris) | {
            "week_mod_1024": week % 1024,
            "iode": ephemeris.iodc % 256,
            "fit_interval_flag": int(ephemeris.fit_interval_h > 4.0),
            "aodo": 31,  # 20.3.3.4.4: the correction table of page 13 is not to be used
        }
        return _encode_fields(_FIELDS[sub_id], values)
    if (sub_id, page) == (4, _IONOSPHERE_PAGE) and (klobuchar or utc):
        return _encode_fields(_PAGE, {"data_id": 1, "sv_id": _IONOSPHERE_SV_ID}) | _encode_fields(
            _IONOSPHERE_AND_UTC, _list_page_values(klobuchar, utc, week)
        )
    filler = sum(_Field("", ((first, length),)).put(0xAAAAAA >> 24 - length) for first, length in _DUMMY_RUNS)
    return _encode_fields(_PAGE, {"data_id": 1, "sv_id": 0}) | filler


_DUMMY_RUNS: Final = ((69, 16), *((first, 24) for first in range(91, 271, 30)), (271, 22))


def _list_page_values(klobuchar: Klobuchar | None, utc: UtcParameters | None, week: int) -> dict[str, float]:
    klobuchar = klobuchar or Klobuchar(alpha=(0.0,) * 4, beta=(0.0,) * 4)
    utc = utc or UtcParameters(a0=0.0, a1=0.0, tot=0.0, wnt=week, leap_seconds=leap_seconds(gpst(week, 0.0)))
    values = {f"alpha{k}": value for k, value in enumerate(klobuchar.alpha)}
    values |= {f"beta{k}": value for k, value in enumerate(klobuchar.beta)}
    return values | {
        "a0": utc.a0,
        "a1": utc.a1,
        "tot": utc.tot,
        "wnt_mod_256": utc.wnt % 256,
        "leap_seconds": utc.leap_seconds,
        "wn_lsf_mod_256": utc.wnt % 256,
        "dn": 7,
        "leap_seconds_future": utc.leap_seconds,
    }


def _encode_fields(table: tuple[_Field, ...], values: Mapping[str, float]) -> int:
    return sum(field.put(values[field.name]) for field in table)


def _unpack_bits(source: int) -> Bits:
    return np.unpackbits(np.frombuffer(source.to_bytes(30, "big"), dtype=np.uint8)).astype(np.int8)
