"""Plain NMEA sentences in bulk: what GGA, RMC and GSV state, where their fields are digits as receivers write them.

The grammar here is narrower than that of `formats.nmea_read`, and where a sentence keeps to it both give the same
numbers to the last bit. What does not keep to it is left to that module, sentence by sentence.
"""

from collections.abc import Iterator
from functools import lru_cache
from typing import Any, Final, NamedTuple

import numpy as np

from skyproof.arrays import Booleans, Integers, Octets, Reals
from skyproof.compiled import compiled
from skyproof.formats.nmea_read import FARTHEST_M, Sentence, read_sentence

__all__ = ["Addresses", "LevelCells", "read_addresses", "read_levels", "read_plain"]

_STAR: Final = 42
_COMMA: Final = 44
_MOST_FIELDS: Final = 24
_COLUMNS: Final = 11
_TENS: Final = 10.0 ** np.arange(16)


class Addresses(NamedTuple):
    """Addresses of sentences: talker and kind, packed a letter an octet; 0 where it is not five letters and a comma."""

    talker: Integers
    kind: Integers


class LevelCells(NamedTuple):
    """C/N0 of satellites, n of them: the sentence that states each, the satellite's number, signal, and dB-Hz.

    plain : (n_sentences,) those that keep to the grammar; the others give nothing here.
    """

    sentence: Integers
    number: Integers
    signal: Integers
    level_dbhz: Reals
    plain: Booleans


def read_addresses(octets: Octets, begin: Integers, length: Integers) -> Addresses:
    """Read the addresses of sentences that begin with "$" at these octets."""
    packed = np.zeros((2, begin.size), np.int64)
    _read_addresses(octets, begin, length, packed)
    return Addresses(packed[0], packed[1])


def pack(letters: str) -> int:
    """Pack letters an octet each, the first one highest."""
    return int.from_bytes(letters.encode("ascii"), "big")


def unpack(packed: int) -> str:
    """Return packed letters."""
    return packed.to_bytes(3, "big").lstrip(b"\0").decode("ascii")


def read_levels(octets: Octets, begin: Integers, length: Integers) -> LevelCells:
    """Read what GSV sentences state; `sentence` counts these."""
    room = int(length.sum()) // 6 + begin.size  # a satellite takes four commas and two digits at least
    cells = np.empty((3, room), np.int64)
    levels = np.empty(room)
    plain = np.zeros(begin.size, np.bool_)
    n = _read_levels(octets, begin, length, cells, levels, plain)
    return LevelCells(cells[0, :n], cells[1, :n], cells[2, :n], levels[:n], plain)


def read_plain(octets: Octets, begin: Integers, length: Integers, kind: str) -> Iterator[Sentence | None]:
    """Give what sentences of a kind, GGA or RMC, state; None for one that is not plain. Talkers are not read."""
    columns = np.full((begin.size, _COLUMNS), np.nan)
    times = np.zeros((begin.size, 4), np.int64)
    (_read_gga if kind == "GGA" else _read_rmc)(octets, begin, length, _TENS, columns, times)
    for row, (plain, of_day_ns, leap_ns, date) in zip(columns.tolist(), times.tolist(), strict=True):
        day = _day(date) if plain and date >= 0 else None
        if not plain or (day is None and date >= 0):
            yield None
            continue
        lat_deg, lon_deg, altitude_m, separation_m, satellites, estimated = row[:6]
        yield Sentence(
            "",
            kind,
            of_day_ns,
            leap_ns,
            day,
            bool(estimated),
            lat_deg,
            lon_deg,
            altitude_m,
            separation_m,
            int(satellites),
        )


@lru_cache(64)
def _day(date: int) -> np.datetime64 | None:
    """Return the day of a number such as 50224, of 5 February 2024, by the rules of the other module; None of none."""
    try:
        sentence = read_sentence(f"GPRMC,000000,V,,,,,,,{date:06d},,".split(","))
    except ValueError:
        return None
    return None if sentence is None else sentence.date


@compiled
def _read_addresses(octets: Octets, begin: Integers, length: Integers, packed: Integers) -> None:
    for i in range(begin.size):
        k = begin[i]
        if length[i] < 7 or octets[k + 6] != _COMMA or octets[k + 1] == 0x50:  # P: of a maker
            continue
        for j in range(1, 6):
            letter = octets[k + j]
            if not 0x41 <= letter <= 0x5A:
                break
        else:
            packed[0, i] = octets[k + 1] * 256 + octets[k + 2]
            packed[1, i] = (octets[k + 3] * 256 + octets[k + 4]) * 256 + octets[k + 5]


@compiled
def _split_fields(octets: Octets, first: int, stop: int, edges: Integers) -> int:
    """Fill `edges` with where fields begin, the end of the last one after them, and return how many there are.

    Too many for the room are -1.
    """
    n = 1
    edges[0] = first
    for k in range(first, stop):
        letter = octets[k]
        if letter == _STAR:
            stop = k
            break
        if letter == _COMMA:
            if n == edges.size - 1:
                return -1
            edges[n] = k + 1
            n += 1
    edges[n] = stop + 1
    return n


@compiled
def _integer(octets: Octets, first: int, stop: int, longest: int) -> int:
    """Return a number of digits alone; -1 of an empty field, -2 of another one."""
    if stop <= first:
        return -1
    if stop - first > longest:
        return -2
    value = 0
    for k in range(first, stop):
        digit = octets[k] - 0x30
        if not 0 <= digit <= 9:
            return -2
        value = 10 * value + digit
    return value


@compiled
def _decimal(octets: Octets, first: int, stop: int, tens: Reals) -> tuple[float, int]:
    """Return a number of at most 15 digits, which may have a sign and a point; and 1, 0 of an empty field, -1 else."""
    if stop <= first:
        return np.nan, 0
    negative = octets[first] == 0x2D
    digits, behind, point = 0, 0, False
    value = 0
    for k in range(first + negative, stop):
        letter = octets[k]
        if letter == 0x2E and not point:
            point = True
            continue
        digit = letter - 0x30
        if not 0 <= digit <= 9:
            return np.nan, -1
        value = 10 * value + digit
        digits += 1
        behind += point
    if digits == 0 or digits > 15:
        return np.nan, -1
    exact = value / tens[behind]  # both are whole numbers below 2**53: rounded once, as text is read
    return -exact if negative else exact, 1


@compiled
def _time(octets: Octets, first: int, stop: int, tens: Reals, times: Integers) -> bool:
    """Put the time of day, ns, and of a leap second 1e9 into `times`[1:3]; return whether the field is plain."""
    if stop - first < 6 or (stop - first == 7 or (stop - first > 6 and octets[first + 6] != 0x2E)):
        return False
    hour, minute = _integer(octets, first, first + 2, 2), _integer(octets, first + 2, first + 4, 2)
    whole = _integer(octets, first + 4, first + 6, 2)
    seconds, plain = _decimal(octets, first + 4, stop, tens)
    if plain != 1 or hour < 0 or minute < 0 or whole < 0 or hour > 23 or minute > 59 or whole > 60:
        return False
    leap_ns = 10**9 if whole == 60 else 0
    times[1] = (hour * 60 + minute) * 60 * 10**9 + int(np.rint(seconds * 1e9)) - leap_ns
    times[2] = leap_ns
    return True


@compiled
def _angle(octets: Octets, first: int, stop: int, side: int, side_stop: int, tens: Reals) -> tuple[float, bool]:
    """Return an angle of one to three digits of degrees and minutes, degrees; and whether both fields are plain."""
    point = stop
    for k in range(first, stop):
        if octets[k] == 0x2E:
            point = k
            break
    if side_stop - side != 1 or not 3 <= point - first <= 5 or octets[first] == 0x2D:
        return np.nan, False
    whole = _integer(octets, first, point - 2, 3)
    minutes, plain = _decimal(octets, point - 2, stop, tens)
    if whole < 0 or plain != 1 or octets[point - 2] == 0x2D or minutes >= 60.0:
        return np.nan, False
    letter = octets[side]
    value = whole + minutes / 60.0
    if letter == 0x4E or letter == 0x45:  # N, E
        return value, True
    return -value, bool(letter == 0x53 or letter == 0x57)


@compiled
def _place(octets: Octets, edges: Integers, at: int, tens: Reals, row: Reals) -> bool:
    """Put the place of four fields into a row; return whether they are plain."""
    row[0], lat = _angle(octets, edges[at], edges[at + 1] - 1, edges[at + 1], edges[at + 2] - 1, tens)
    row[1], lon = _angle(octets, edges[at + 2], edges[at + 3] - 1, edges[at + 3], edges[at + 4] - 1, tens)
    return bool(lat and lon)


@compiled
def _read_gga(octets: Octets, begin: Integers, length: Integers, tens: Reals, rows: Reals, times: Integers) -> None:
    edges = np.empty(_MOST_FIELDS + 1, np.int64)
    for i in range(begin.size):
        times[i, 3] = -1
        rows[i, 4], rows[i, 5] = -1.0, 0.0
        n = _split_fields(octets, begin[i] + 7, begin[i] + length[i], edges)  # the first one is the time
        if n < 11:
            continue
        quality = _integer(octets, edges[5], edges[6] - 1, 1)
        if quality == -2 or not _time(octets, edges[0], edges[1] - 1, tens, times[i]):
            continue
        rows[i, 5] = quality >= 6 and quality <= 8
        if quality > 0:
            satellites = _integer(octets, edges[6], edges[7] - 1, 4)
            rows[i, 2], high = _decimal(octets, edges[8], edges[9] - 1, tens)
            rows[i, 3], geoid = _decimal(octets, edges[10], edges[11] - 1, tens)
            known = high >= 0 and geoid >= 0 and satellites != -2 and _place(octets, edges, 1, tens, rows[i])
            if not known or abs(rows[i, 2]) >= FARTHEST_M or abs(rows[i, 3]) >= FARTHEST_M:
                continue
            rows[i, 4] = satellites
        times[i, 0] = 1


@compiled
def _read_rmc(octets: Octets, begin: Integers, length: Integers, tens: Reals, rows: Reals, times: Integers) -> None:
    edges = np.empty(_MOST_FIELDS + 1, np.int64)
    for i in range(begin.size):
        rows[i, 4], rows[i, 5] = -1.0, 0.0
        n = _split_fields(octets, begin[i] + 7, begin[i] + length[i], edges)
        if n < 9 or not _time(octets, edges[0], edges[1] - 1, tens, times[i]):
            continue
        date = _integer(octets, edges[8], edges[9] - 1, 6)
        day, month = date // 10000, date // 100 % 100
        if date == -2 or (date >= 0 and (edges[9] - 1 - edges[8] != 6 or not (1 <= day <= 31 and 1 <= month <= 12))):
            continue
        times[i, 3] = date
        if n > 11 and edges[12] - 1 - edges[11] == 1:
            mode = octets[edges[11]]
            rows[i, 5] = mode == 0x45 or mode == 0x4D or mode == 0x53  # E, M, S
        if edges[2] - 1 - edges[1] == 1 and octets[edges[1]] == 0x41 and not _place(octets, edges, 2, tens, rows[i]):
            continue
        times[i, 0] = 1


@compiled
def _read_levels(octets: Octets, begin: Integers, length: Integers, cells: Integers, levels: Reals, plain: Any) -> int:
    n = 0
    for i in range(begin.size):
        first, stop = begin[i] + 7, begin[i] + length[i]
        known, before, field, number = True, n, 0, -1
        signal, hexadecimal, one_letter = 0, -1, False
        k = first
        while known:
            end = k
            while end < stop and octets[end] != _COMMA and octets[end] != _STAR:
                end += 1
            which = (field - 3) % 4  # fields 0 to 2 count sentences and satellites
            if field >= 3 and which == 0:
                number = _integer(octets, k, end, 4)
                one_letter, hexadecimal = end - k == 1, -1
                if one_letter:
                    letter = octets[k]
                    if 0x30 <= letter <= 0x39:
                        hexadecimal = letter - 0x30
                    elif 0x41 <= letter <= 0x46:
                        hexadecimal = letter - 0x37
            elif field >= 3 and which == 3:
                level = _integer(octets, k, end, 3)
                known = number != -2 and level != -2
                if known and number >= 0 and 0 < level < 100:
                    cells[0, n], cells[1, n], levels[n] = i, number, level
                    n += 1
            if end >= stop or octets[end] == _STAR:
                break
            field += 1
            k = end + 1
        if known and field >= 3 and (field - 3) % 4 == 0 and number != -1:
            known = hexadecimal >= 0
            signal = hexadecimal
        if not known:
            n = before
            continue
        plain[i] = True
        cells[2, before:n] = signal
    return n
