"""Logs of text, a line a record: the kind of each line by its first word, and the numbers in its fields."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from skyproof.arrays import Booleans, Integers, Octets, Reals
from skyproof.compiled import compiled
from skyproof.records import freeze

__all__ = ["MISSING", "Fields", "TextStretch", "read_fields", "split_lines"]

MISSING: Final = int(np.iinfo(np.int64).min)
"""Stands for a whole number that a field does not hold."""

_STRETCH_BYTES: Final = 1 << 22
_LONGEST_LINE: Final = 1 << 16
_COMMA, _MINUS, _PLUS, _DOT, _SPACE = (ord(sign) for sign in ",-+. ")
_LARGEST: Final = 1e60  # that is taken for a number: what is made of it stays finite
_TENS: Final = 10.0 ** np.arange(23)  # exact in double precision
_MOST: Final = (np.iinfo(np.int64).max - 9) // 10


@dataclass(frozen=True, eq=False, kw_only=True)
class TextStretch:
    """Whole lines of a text, in order.

    octets : (n_octets,). begin, end : (n_lines,) of each line, without its end. word : (n_lines,) number of the first
    word of a line; equal words have equal numbers. last : whether the text ends here. cut : it ends inside a line.
    """

    octets: Octets
    begin: Integers
    end: Integers
    word: Integers
    last: bool = False
    cut: bool = False

    def __post_init__(self) -> None:
        freeze(self, {"octets": ("octet",)} | dict.fromkeys(("begin", "end", "word"), ("line",)))

    def line(self, number: int) -> str:
        """Return a line as text."""
        return self.octets[self.begin[number] : self.end[number]].tobytes().decode("utf-8", "replace")

    def words(self) -> dict[str, Integers]:
        """Return the lines that begin with each word, by the word."""
        distinct, first, number = np.unique(self.word, return_index=True, return_inverse=True)
        order = np.argsort(number, kind="stable")
        parts = np.split(order, np.cumsum(np.bincount(number, minlength=distinct.size))[:-1]) if order.size else []
        return {self.line(int(k)).partition(",")[0].strip(): lines for k, lines in zip(first, parts, strict=True)}


def split_lines(
    blocks: Iterable[bytes], complete: Callable[[TextStretch], int] = lambda stretch: stretch.begin.size
) -> Iterator[TextStretch]:
    """Split a text into lines, stretch by stretch; a line that a block cuts goes to the next stretch.

    What is longer than any line is passed over. The last stretch may be empty.

    complete : how many lines of a stretch hold whole records; those after them go to the next stretch.
    """
    rest = b""
    gathered: list[bytes] = []
    n_gathered = 0
    for block in blocks:
        gathered.append(block)
        n_gathered += len(block)
        if n_gathered >= _STRETCH_BYTES:
            text = b"".join([rest, *gathered])
            whole = text.rfind(b"\n") + 1
            stretch = _lines_of(text[:whole], last=False)
            count = complete(stretch)
            used = int(stretch.begin[count]) if 0 < count < stretch.begin.size else whole
            yield (
                stretch
                if used == whole
                else replace(stretch, begin=stretch.begin[:count], end=stretch.end[:count], word=stretch.word[:count])
            )
            rest = text[used:whole] + text[whole:][-_LONGEST_LINE:]
            gathered, n_gathered = [], 0
    yield _lines_of(b"".join([rest, *gathered]), last=True)


@dataclass(frozen=True, eq=False)
class Fields:
    """Columns of lines by their names, (n,) each, with a number or a place for each line.

    reals : NaN where a field is missing or no number. wholes : exact, `MISSING` where it is no whole number. places :
    octet at which a field begins, -1 where the line ends before.
    """

    reals: dict[str, Reals]
    wholes: dict[str, Integers]
    places: dict[str, Integers]

    def select(self, rows: Booleans) -> "Fields":
        """Return some of the lines."""
        if rows.all():
            return self
        chosen = np.flatnonzero(rows)
        parts: list[dict[str, Any]] = [
            {name: values[chosen] for name, values in part.items()} for part in (self.reals, self.wholes, self.places)
        ]
        return Fields(*parts)


def read_fields(
    stretch: TextStretch,
    lines: Integers,
    columns: Mapping[str, int],
    *,
    reals: Sequence[str] = (),
    wholes: Sequence[str] = (),
    places: Sequence[str] = (),
) -> Fields:
    """Read fields of lines, parted by commas.

    columns : number of the field of each name, the first is 0; what is not in it is missing everywhere.
    """
    rows = np.full((3, max((columns.get(name, -1) for name in (*reals, *wholes, *places)), default=-1) + 1), -1)
    for wanted, row in zip((reals, wholes, places), rows, strict=True):
        for k, name in enumerate(wanted):
            if name in columns:
                row[columns[name]] = k
    real = np.full((len(reals), lines.size), np.nan)
    whole, place = np.full((len(wholes), lines.size), MISSING), np.full((len(places), lines.size), -1)
    _read(stretch.octets, stretch.begin[lines], stretch.end[lines], rows, _TENS, real, whole, place)
    return Fields(
        dict(zip(reals, real, strict=True)),
        dict(zip(wholes, whole, strict=True)),
        dict(zip(places, place, strict=True)),
    )


def _lines_of(text: bytes, *, last: bool) -> TextStretch:
    octets = np.frombuffer(text, np.uint8)
    ends = np.flatnonzero(octets == ord("\n"))
    cut = bool(last and octets.size and octets[-1] != ord("\n"))
    begin = np.append(0, ends + 1)
    end = np.append(ends, octets.size)
    some = end > begin
    begin, end = begin[some], end[some]
    end -= octets[end - 1] == ord("\r")
    words = np.empty(begin.size, np.int64)
    _number_words(octets, begin, end, words)
    return TextStretch(octets=octets, begin=begin, end=end, word=words, last=last, cut=cut)


@compiled
def _number_words(octets: Octets, begin: Integers, end: Integers, words: Integers) -> None:
    for k in range(begin.size):
        number = 0
        for i in range(begin[k], end[k]):
            if octets[i] == _COMMA:
                break
            number = number * 257 + octets[i] + 1  # modulo 2^64: words of up to seven letters never share a number
        words[k] = number


@compiled
def _read(
    octets: Octets,
    begin: Integers,
    end: Integers,
    rows: Integers,
    tens: Reals,
    real: Reals,
    whole: Integers,
    place: Integers,
) -> None:
    for k in range(begin.size):
        i, stop = begin[k], end[k]
        for column in range(rows.shape[1]):
            if i > stop:
                break
            to_real, to_whole, to_place = rows[0, column], rows[1, column], rows[2, column]
            if to_place >= 0:
                place[to_place, k] = i
            if to_real >= 0 or to_whole >= 0:
                while i < stop and octets[i] == _SPACE:
                    i += 1
                minus = i < stop and octets[i] == _MINUS
                if minus or (i < stop and octets[i] == _PLUS):
                    i += 1
                mantissa, power, digits, exact, after_dot = 0, 0, 0, True, 0
                while i < stop:
                    octet = octets[i]
                    if 0x30 <= octet <= 0x39:
                        digits += 1
                        if mantissa <= _MOST:
                            mantissa = 10 * mantissa + (octet - 0x30)
                            power -= after_dot
                        else:
                            power += 1 - after_dot
                            exact = False
                    elif octet == _DOT and after_dot == 0:
                        after_dot, exact = 1, False
                    else:
                        break
                    i += 1
                good = digits > 0
                if good and i < stop and (octets[i] == 0x45 or octets[i] == 0x65):  # E, e
                    exact = False
                    i += 1
                    down = i < stop and octets[i] == _MINUS
                    if down or (i < stop and octets[i] == _PLUS):
                        i += 1
                    exponent, good = 0, False
                    while i < stop and 0x30 <= octets[i] <= 0x39:
                        exponent, good = min(10 * exponent + (octets[i] - 0x30), 9999), True
                        i += 1
                    power += -exponent if down else exponent
                while i < stop and octets[i] == _SPACE:
                    i += 1
                good = good and (i == stop or octets[i] == _COMMA)
                if good and to_whole >= 0 and exact:
                    whole[to_whole, k] = -mantissa if minus else mantissa
                if good and to_real >= 0:
                    value = float(mantissa)
                    if power < 0:
                        value = value / tens[-power] if power >= -22 else value * 10.0**power
                    elif power > 0:
                        value = value * tens[power] if power <= 22 else value * 10.0**power
                    if value < _LARGEST:
                        real[to_real, k] = -value if minus else value
            while i < stop and octets[i] != _COMMA:
                i += 1
            i += 1
