"""Guess what bytes mean: the packings that their statistics allow, the most probable first.

A front end hands over noise, whose numbers lie close around zero, alike on either side, small ones more often. So in
the right packing a histogram has one hump in the middle; in a wrong one it has teeth, or is flat:

- numbers of 16 and 32 bits: the highest byte of each has less entropy than the lowest, or, where few values occur, one
  byte of a number predicts the other;
- numbers of 12 bits, two in three bytes: one byte of three has less entropy, and both numbers spread alike;
- floats: all are finite, and within a few powers of ten of each other;
- whole bytes: one hump, around 0 or around 128, or few values;
- several numbers a byte: the same of their codes; two-bit codes show it by which of them are alike;
- one bit: all bytes are about equally frequent, as also when nothing else fits.

How a stream of numbers is divided into samples, and in which order they lie within a byte, does not show so; what
repeats in them, and what a search finds, does.
"""

from dataclasses import dataclass
from itertools import product
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Integers, Octets, Reals
from skyproof.formats.layout import BitOrder, ByteOrder, Encoding, Kind, Packing, unpack_twelve_bits

__all__ = ["Likely", "list_likely_packings", "measure_header"]

_HEADER_MOST: Final = 1 << 16
_HEADER_NATS: Final = 25.0
"""Log-likelihood ratio at which bytes at the start are taken for a header."""
_ENTROPY_APART: Final = 0.4  # bits, of the bytes of one number; those of I and Q differ by less than 0.1
_BOUND: Final = 0.9  # of a byte's entropy, that another explains
_SHAPED: Final = 1 << 16  # numbers, to see their histogram's shape
_HUMPED: Final = 2.0  # kurtosis that is enough
_FLATTER: Final = 0.25  # how much less speaks against a reading
_BESIDE: Final = 0.25, 2.0  # mean over sigma, where -1 is read as the greatest number
_SPREAD_ALIKE: Final = 1.25  # greater over smaller sigma, of I and Q
_FEW_VALUES: Final = 64
_HUMP: Final = 3.0
"""Sum of all steps of a histogram over its highest value: 2 of one hump, more with noise on it, many with teeth."""
_FLAT: Final = 1.3  # highest share over the mean one, of codes that are all about as frequent
_UNEVEN: Final = 0.05  # and shares that two signs have of which one is nearly always the same
_CLIPPED: Final = 10.0  # shares of the extreme codes over those of their neighbours, where numbers were clipped
_FAIR: Final = 0.008  # of a quarter: shares of two-bit codes that two independent signs have


@dataclass(frozen=True, kw_only=True)
class Likely:
    """A packing that fits, and `header_bytes` to skip beyond the header found, so that numbers begin where they do."""

    packing: Packing
    header_bytes: int = 0


def measure_header(octets: Octets) -> int:
    """Count the bytes at the start that are text or mostly zero, where the rest is not; 0 if none.

    octets : (n,) from the start of the file on, long enough to be mostly samples.
    """
    if octets.size < 4 * 1024:
        return 0
    if still := _measure_still(octets):
        return still
    bulk = octets[octets.size // 2 :]
    rest = np.empty((2, 256))
    for parity in range(2):
        counts = np.bincount(bulk[parity::2], minlength=256) + 0.5
        rest[(octets.size // 2 + parity) % 2] = np.log(counts / counts.sum())
    header = np.full(256, 0.25 / 256)
    header[0] += 0.25
    header[32:127] += 0.5 / 95
    start = octets[: min(_HEADER_MOST, octets.size // 2)]
    gains = np.cumsum(np.log(header)[start] - rest[np.arange(start.size) % 2, start])
    length = int(np.argmax(gains)) + 1
    if gains[length - 1] < _HEADER_NATS:
        return 0
    for unit, within in ((512, 6), (16, 3), (4, 1)):
        if abs(whole := round(length / unit) * unit - length) <= within and length + whole > 0:
            return length + whole
    return length


def _measure_still(octets: Octets) -> int:
    """Count the bytes at the start that are all equal, if many.

    Whole blocks of 4096, so that numbers stay whole.
    """
    changes = np.flatnonzero(octets != octets[0])
    length = int(changes[0]) if changes.size else 0
    return length // 4096 * 4096


def list_likely_packings(octets: Octets) -> list[Likely]:
    """List the packings that fit `octets`, (n,) whole samples from a file's body, the most probable first."""
    floats = _find_floats(octets)
    if floats:
        return floats
    wide = _find_wide(octets)
    if wide:
        return wide
    found = _find_twelve_bits(octets) or _find_whole_bytes(octets)
    if not found:
        found = _find_nibbles(octets) or _find_pairs(octets)
    return found


def _list_both_kinds(encoding: Encoding, bits: int, **more: object) -> list[Packing]:
    kinds: tuple[Kind, Kind] = ("complex", "real")
    return [Packing(kind=kind, encoding=encoding, bits=bits, **more) for kind in kinds]  # type: ignore[arg-type]


def _list_packed(encoding: Encoding, bits: int) -> list[Likely]:
    orders: tuple[BitOrder, BitOrder] = ("msb-first", "lsb-first")
    return [
        Likely(packing=packing) for order in orders for packing in _list_both_kinds(encoding, bits, bit_order=order)
    ]


def _find_floats(octets: Octets) -> list[Likely]:
    """Find floats in both byte orders, where numbers begin before any bytes are skipped.

    Whole numbers are plausible floats a byte late.
    """
    orders: tuple[ByteOrder, ByteOrder] = ("little", "big")
    for bits in (32, 64):
        size = bits // 8
        for skip in range(size):
            whole = octets[skip : skip + (octets.size - skip) // size * size]
            for order in orders:
                stored = whole.view(f"{'<' if order == 'little' else '>'}f{size}")
                if stored.size and _are_plausible(stored):
                    packings = _list_both_kinds("float", bits, byte_order=order)
                    return [Likely(packing=packing, header_bytes=skip) for packing in packings]
    return []


def _are_plausible(stored: NDArray[np.floating]) -> bool:
    with np.errstate(all="ignore"):
        sizes = np.abs(stored[:65536].astype(np.float64))
        if not np.isfinite(sizes).mean() > 0.99:
            return False
        sizes = sizes[np.isfinite(sizes)]
        if np.mean(sizes == 0.0) > 0.9:
            return False
        middle = float(np.median(sizes[sizes > 0.0]))
        good = (sizes == 0.0) | ((sizes > 1e-5 * middle) & (sizes < 30.0 * middle))
        return bool(1e-12 < middle < 1e12 and good.mean() > 0.995)


def _find_wide(octets: Octets) -> list[Likely]:
    """Find numbers of 16 and 32 bits, by their byte of least entropy, or by bytes that predict each other."""
    entropy = np.array([_compute_entropy(octets[place::4]) for place in range(4)])
    if max(abs(entropy[0] - entropy[2]), abs(entropy[1] - entropy[3])) > _ENTROPY_APART:
        size, skips = 4, [0, 1, 2, 3]
    elif abs(entropy[0] - entropy[1]) > _ENTROPY_APART:
        size, skips = 2, [0, 1]
    elif (first := _find_first_bound(octets, entropy)) is not None:
        size, skips = 2, [first]
    else:
        return []
    encoding, order, skip = _choose_order(octets, size, skips)
    return [
        Likely(packing=packing, header_bytes=skip) for packing in _list_both_kinds(encoding, 8 * size, byte_order=order)
    ]


def _find_twelve_bits(octets: Octets) -> list[Likely]:
    """Find numbers of 12 bits by the bytes of three with least entropy.

    Both numbers have to spread alike, and least.

    In a wrong order one of the two has the bits that count least above those that count most. So have the two halves of
    numbers of 24 bits, which are none of these.
    """
    entropy = [_compute_entropy(octets[place::3]) for place in range(3)]
    if max(entropy) - min(entropy) < _ENTROPY_APART:
        return []
    encodings: tuple[Encoding, Encoding] = ("int", "offset-binary")
    orders: tuple[BitOrder, BitOrder] = ("msb-first", "lsb-first")
    found: list[tuple[float, Likely]] = []
    for skip, order in product(range(3), orders):
        codes = unpack_twelve_bits(octets[skip : skip + (octets.size - skip) // 3 * 3][: 3 * _SHAPED], order)
        for encoding in encodings:
            shapes = [_measure_shape((c ^ 2048) - 2048 if encoding == "int" else c - 2048) for c in codes.T]
            sigmas = [shape.sigma for shape in shapes]
            if max(sigmas) > _SPREAD_ALIKE * min(sigmas) or any(
                each_shape.kurtosis < _HUMPED or each_shape.beside for each_shape in shapes
            ):
                continue
            packings = _list_both_kinds(encoding, 12, bit_order=order)
            found += [(max(sigmas), Likely(packing=each_shape, header_bytes=skip)) for each_shape in packings]
    narrowest = min((sigma for sigma, _ in found), default=0.0)
    return [likely for sigma, likely in found if sigma < _SPREAD_ALIKE * narrowest]


def _find_first_bound(octets: Octets, entropy: Reals) -> int | None:
    """Find where pairs begin, if every other byte depends on the one before it only.

    So it is in numbers of few values; None if it is not so.

    Two channels that hold the same numbers are bound as well, but alike.
    """
    pairs = octets[: octets.size // 2 * 2].reshape(-1, 2)
    least = float(min(entropy[:2]))
    if least < _ENTROPY_APART or np.array_equal(pairs[:, 0], pairs[:, 1]):
        return None
    shared = _compute_shared_bits(octets, entropy), _compute_shared_bits(octets[1:-1], entropy)
    bound = max(shared) > _BOUND * least and min(shared) < 0.5 * max(shared)
    return int(shared[1] > shared[0]) if bound else None


def _compute_shared_bits(octets: Octets, entropy: Reals) -> float:
    """Compute the mutual information of the first and second byte of each pair, in bits."""
    pairs = octets[: octets.size // 2 * 2].view("<u2")
    shares = np.bincount(pairs, minlength=1 << 16) / pairs.size
    shares = shares[shares > 0.0]
    return float(entropy[0] + entropy[1] + np.sum(shares * np.log2(shares)))


def _choose_order(octets: Octets, size: int, skips: list[int]) -> tuple[Encoding, ByteOrder, int]:
    """Choose how numbers of `size` bytes are stored, and how many bytes come before the first.

    In a wrong order the byte that counts most is one that counts little or another number's: then the numbers are flat
    or have two humps, negative ones look like large positive ones, or all spread wider than in the right order. Where
    none of these decides, no skipped bytes are more probable.
    """
    encodings: tuple[Encoding, Encoding] = ("int", "offset-binary")
    orders: tuple[ByteOrder, ByteOrder] = ("little", "big")
    shapes = {choice: _read_shape(octets, size, *choice) for choice in product(encodings, orders, skips)}
    most = max(shape.kurtosis for shape in shapes.values())
    shapes = {choice: shape for choice, shape in shapes.items() if shape.kurtosis > most - _FLATTER}
    shapes = {choice: shape for choice, shape in shapes.items() if not shape.beside} or shapes
    narrowest = min(shape.sigma for shape in shapes.values())
    return min(shapes, key=lambda choice: (round(shapes[choice].sigma / narrowest, 2), choice[2]))


@dataclass(frozen=True, kw_only=True)
class _Shape:
    """Shape of a histogram.

    kurtosis : 1 for two values, 1.8 for a uniform one, 3 for noise; only what tells these apart counts. beside :
    whether it lies beside zero by about its width, as where -1 is read as the greatest number. In offset binary also by
    more, since numbers far from the middle may as well be signed ones.
    """

    kurtosis: float
    sigma: float
    beside: bool


def _read_shape(octets: Octets, size: int, encoding: Encoding, order: ByteOrder, skip: int) -> _Shape:
    letter = "u" if encoding == "offset-binary" else "i"
    stored = octets[skip : skip + (octets.size - skip) // size * size][: _SHAPED * size]
    numbers = stored.view(f"{'<' if order == 'little' else '>'}{letter}{size}").astype(np.float64)
    return _measure_shape(numbers - (0.0 if encoding == "int" else 2.0 ** (8 * size - 1)), everywhere=encoding != "int")


def _measure_shape(numbers: NDArray[Any], *, everywhere: bool = True) -> _Shape:
    """Return the shape of numbers whose middle is zero. everywhere : whether any mean far off is beside it."""
    mean, sigma = float(numbers.mean()), max(float(numbers.std()), 1e-30)
    off = abs(mean) / sigma
    kurtosis = float(np.mean(((numbers - mean) / sigma) ** 4))
    beside = off > _BESIDE[0] and (off < _BESIDE[1] or everywhere)
    return _Shape(kurtosis=min(kurtosis, _HUMPED), sigma=sigma, beside=beside)


def _find_whole_bytes(octets: Octets) -> list[Likely]:
    counts = np.bincount(octets, minlength=256)
    shares = counts / octets.size
    around_128 = _is_around_128(octets)
    if np.count_nonzero(counts) > _FEW_VALUES:
        ordered = shares if around_128 else np.roll(shares, 128)
        ends, ordered = ordered[[0, -1]], ordered[1:-1]
        clipped = ends.sum() > _CLIPPED * ordered[[0, -1]].sum()
        if (ordered.max() < _FLAT / 256 and not clipped) or _sum_steps(ordered) > _HUMP * ordered.max() + 0.05:
            return []
    encoding: Encoding = "offset-binary" if around_128 else "int"
    return [Likely(packing=packing) for packing in _list_both_kinds(encoding, 8)]


def _find_nibbles(octets: Octets) -> list[Likely]:
    codes = np.concatenate([octets >> 4, octets & 15])
    shares = np.bincount(codes, minlength=16) / codes.size
    if shares.max() < _FLAT / 16:
        return []
    orders: dict[Encoding, Integers] = {
        "int": np.roll(np.arange(16), 8),
        "offset-binary": np.arange(16),
        "sign-magnitude": np.concatenate([np.arange(15, 7, -1), np.arange(8)]),
    }
    steps = {encoding: _sum_steps(shares[order]) / shares.max() for encoding, order in orders.items()}
    best = min(steps, key=lambda encoding: steps[encoding])
    return _list_packed(best, 4) if steps[best] < 2.4 and _is_centred(shares[orders[best]]) else []


def _find_pairs(octets: Octets) -> list[Likely]:
    """Find numbers of two bits, or one.

    With four levels the outer ones are rarer than the inner, and either pair is alike.
    """
    codes = np.concatenate([(octets >> shift) & 3 for shift in (0, 2, 4, 6)])
    shares = np.bincount(codes, minlength=4) / codes.size
    uneven = float(np.abs(shares - 0.25).max())
    if uneven < _FAIR:
        return _list_bits()
    by_magnitude = abs(shares[0] - shares[2]) + abs(shares[1] - shares[3])
    by_offset = abs(shares[0] - shares[3]) + abs(shares[1] - shares[2])
    if by_magnitude < by_offset:
        # no two signs do that, unless one of them is far from even
        return [*_list_packed("sign-magnitude", 2), *(_list_bits() if uneven < _UNEVEN else ())]
    return [*_list_packed("offset-binary" if shares[0] + shares[3] < 0.5 else "int", 2), *_list_bits()]


def _list_bits() -> list[Likely]:
    return _list_packed("sign", 1)


def _is_around_128(octets: Octets) -> bool:
    counts = np.bincount(octets, minlength=256)
    if np.count_nonzero(counts) > _FEW_VALUES:
        counts[[0, 127, 128, 255]] = 0  # where clipped numbers pile up, in either reading
    return bool(counts[64:192].sum() > 0.5 * counts.sum())


def _sum_steps(shares: Reals) -> float:
    return float(np.abs(np.diff(shares, prepend=0.0, append=0.0)).sum())


def _is_centred(shares: Reals) -> bool:
    """Test whether the middle of the histogram lies near the middle."""
    middle = float(np.sum(shares * np.arange(shares.size)))
    return abs(middle - 0.5 * (shares.size - 1)) < 0.1 * shares.size


def _compute_entropy(octets: Octets) -> float:
    shares = np.bincount(octets, minlength=256) / octets.size
    shares = shares[shares > 0.0]
    return float(-np.sum(shares * np.log2(shares)))
