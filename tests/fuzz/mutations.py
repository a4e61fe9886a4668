"""Damage to a file, drawn at random: bytes, numbers, words, lines, and depth, alone and several at once."""

import re
from collections.abc import Callable, Sequence
from random import Random

__all__ = ["mutate_seed"]

_WORDS = [
    b"", b" ", b"\n", b"\r\n", b"\0", b"\xff\xfe", b"&", b"-", b"-1&", b"3&", b">", b"$", b"#", b",", b";", b'"',
    b"'", b"=", b"[", b"]", b"{", b"}", b"[[", b"]]", b"<", b"\\", b"%", b"0", b"-0", b"-1", b"1", b"00", b"99",
    b"999999", b"2147483648", b"9223372036854775807", b"9223372036854775808", b"-9223372036854775809", b"1E+999",
    b"1e308", b"-1e-320", b"1D+99", b"9.9e19", b"nan", b"inf", b"-inf", b"NaN", b"Infinity", b"null", b"true",
    b"false", b"0x10", b"1_000", b"1.5", b".", b"..", b"1979-12-31", b"2600-01-01T00:00:00", b"9999-12-31T23:59:60",
    b"0000-00-00", b"07:32:00", b"1677", b"2262", b"2600", b"9999", b"0001", b"G00", b"G99", b"R30", b"Z01",
    b"\xc3\xa9", b"\xe2\x88\x9e", b"\xed\xa0\x80", b"/dev/null", b"../..", b"9" * 400, b"a" * 300, b"END OF HEADER",
    b"[protect]", b"[samples]", b"[[receivers]]", b"[[attacks]]", b"{}", b"[]",
]  # fmt: skip
_NUMBER = re.compile(rb"[-+]?\d+(?:\.\d+)?(?:[eEdD][-+]?\d+)?")
_WORD = re.compile(rb"[A-Za-z_:]+")
_DEPTHS = (2, 30, 1000, 20_000)
_LONG = (100, 5_000, 140_000)
_NESTS = ((b"[", b"]"), (b"{a=", b"}"), (b'{"a":', b"}"), (b"a.", b""), (b"<a>", b"</a>"), (b"[[", b""))
_RUNS = (b"9", b"a", b" ", b",", b"0.", b"\xc3\xa9", b'"', b"\n")
_MANY = (2, 20, 2_000)


def mutate_seed(rng: Random, seed: bytes, others: Sequence[bytes]) -> bytes:
    """Damage the seed in one to six ways; pieces of the other seeds may come in."""
    content = seed
    for _ in range(rng.choice((1, 1, 1, 2, 3, 6))):
        content = rng.choice(_KINDS)(rng, content, others)
    return content


def _draw_place(rng: Random, content: bytes) -> int:
    return rng.randrange(len(content) + 1)


def _change_byte(rng: Random, content: bytes, _: Sequence[bytes]) -> bytes:
    at = _draw_place(rng, content)
    return content[:at] + bytes([rng.randrange(256)]) + content[at + 1 :]


def _flip_bit(rng: Random, content: bytes, _: Sequence[bytes]) -> bytes:
    at = _draw_place(rng, content)
    return content[:at] + bytes(octet ^ 1 << rng.randrange(8) for octet in content[at : at + 1]) + content[at + 1 :]


def _cut(rng: Random, content: bytes, _: Sequence[bytes]) -> bytes:
    at = _draw_place(rng, content)
    return content[:at] + content[at + rng.choice((1, 1, 2, 16, 80, 1000)) :]


def _end(rng: Random, content: bytes, _: Sequence[bytes]) -> bytes:
    return content[: _draw_place(rng, content)]


def _insert_word(rng: Random, content: bytes, _: Sequence[bytes]) -> bytes:
    at, word = _draw_place(rng, content), rng.choice(_WORDS)
    return content[:at] + word + content[at + rng.choice((0, len(word))) :]


def _change_number(rng: Random, content: bytes, _: Sequence[bytes]) -> bytes:
    return _replace(rng, content, _NUMBER)


def _name(rng: Random, content: bytes, _: Sequence[bytes]) -> bytes:
    return _replace(rng, content, _WORD)


def _replace(rng: Random, content: bytes, pattern: re.Pattern[bytes]) -> bytes:
    """Replace one match within the next stretch by a word, by another match, or by one as wide."""
    at = _draw_place(rng, content)
    match = pattern.search(content, at) or pattern.search(content)
    if match is None:
        return content
    other = pattern.search(content, _draw_place(rng, content))
    word = rng.choice(_WORDS) if other is None or rng.random() < 0.7 else other[0]
    if rng.random() < 0.5:
        word = word.rjust(len(match[0]))[: max(len(match[0]), 1)]
    return content[: match.start()] + word + content[match.end() :]


def _move_line(rng: Random, content: bytes, others: Sequence[bytes]) -> bytes:
    lines = content.split(b"\n")
    k, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(5):
        case 0:
            del lines[k]
        case 1:
            lines.insert(k, lines[j])
        case 2:
            lines[k], lines[j] = lines[j], lines[k]
        case 3:
            lines[k] = rng.choice(_WORDS)
        case _:
            lines.insert(k, rng.choice(rng.choice(others).split(b"\n")))
    return b"\n".join(lines)


def _splice(rng: Random, content: bytes, others: Sequence[bytes]) -> bytes:
    other = rng.choice(others)
    at, begin = _draw_place(rng, content), _draw_place(rng, other)
    return content[:at] + other[begin : begin + rng.choice((8, 80, 400))] + content[at + rng.choice((0, 80)) :]


def _repeat(rng: Random, content: bytes, _: Sequence[bytes]) -> bytes:
    at = _draw_place(rng, content)
    piece = content[at : at + rng.choice((1, 8, 81, 400))]
    times = min(rng.choice(_MANY), 200_000 // max(len(piece), 1))
    return content[:at] + piece * times + content[at:]


def _nest(rng: Random, content: bytes, _: Sequence[bytes]) -> bytes:
    depth, at = rng.choice(_DEPTHS), _draw_place(rng, content)
    begin, end = rng.choice(_NESTS)
    return content[:at] + begin * depth + b"1" + end * depth + content[at:]


def _lengthen(rng: Random, content: bytes, _: Sequence[bytes]) -> bytes:
    at = _draw_place(rng, content)
    return content[:at] + rng.choice(_RUNS) * rng.choice(_LONG) + content[at:]


_Kind = Callable[[Random, bytes, Sequence[bytes]], bytes]
_KINDS: tuple[_Kind, ...] = (
    *(_change_byte, _flip_bit, _cut, _insert_word) * 4, *(_change_number,) * 12, *(_name,) * 4, *(_move_line,) * 8,
    *(_splice,) * 4, _end, _repeat, _nest, _lengthen,
)  # fmt: skip
