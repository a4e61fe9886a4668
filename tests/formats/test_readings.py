"""What bytes may mean, by their statistics; what a file is, by its first bytes; what a name says."""

import struct

import numpy as np
import pytest

from skyproof.formats.names import NameHints, read_hints
from skyproof.formats.readings import list_likely_packings, measure_header
from skyproof.formats.signatures import WavHeader, identify_other, read_wav_header

N = 1 << 17


def draw_normal(rms: float, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).normal(0.0, rms, N)


def store_octets(values: np.ndarray, kind: str) -> np.ndarray:
    stored = values.astype(kind) if "f" in kind else np.round(values).astype(kind)
    return np.frombuffer(stored.tobytes(), np.uint8)


def list_kinds(stored: np.ndarray) -> set[tuple]:
    return {(packing.packing.encoding, packing.packing.bits) for packing in list_likely_packings(stored)}


@pytest.mark.parametrize("rms", [3.0, 20.0, 60.0])
def test_whole_bytes_are_recognized_by_their_hump(rms: float) -> None:
    values = np.clip(draw_normal(rms), -128, 127)
    assert list_kinds(store_octets(values, "<i1")) == {("int", 8)}
    assert list_kinds(store_octets(np.clip(values + 128, 0, 255), "<u1")) == {("offset-binary", 8)}


@pytest.mark.parametrize("rms", [100.0, 2000.0])
@pytest.mark.parametrize("order", ["little", "big"])
def test_wide_numbers_are_recognized_by_their_quiet_byte(rms: float, order: str) -> None:
    stored = store_octets(draw_normal(rms), f"{'<' if order == 'little' else '>'}i2")
    assert list_kinds(stored) == {("int", 16)}
    assert {packing.packing.byte_order for packing in list_likely_packings(stored)} == {order}
    assert {packing.header_bytes for packing in list_likely_packings(stored)} == {0}


@pytest.mark.parametrize("order", ["little", "big"])
@pytest.mark.parametrize("step", [256.0, 1000.0, 4096.0])
@pytest.mark.parametrize("rms", [0.4, 1.0, 3.0])
def test_the_order_of_wide_numbers_with_quiet_low_bytes_is_found(rms: float, step: float, order: str) -> None:
    values = np.clip(step * np.round(draw_normal(rms)), -32768, 32767)
    (first, *_) = list_likely_packings(store_octets(values, f"{'<' if order == 'little' else '>'}i2"))
    assert (first.packing.encoding, first.packing.bits, first.packing.byte_order) == ("int", 16, order)
    assert first.header_bytes == 0


@pytest.mark.parametrize("order", ["little", "big"])
@pytest.mark.parametrize("level", [1, 2, 100, 256, 1000, 8192, 32767])
def test_wide_numbers_of_two_values_are_one_stream(level: int, order: str) -> None:
    # In either order they are the same signal.
    stored = store_octets(np.where(draw_normal(1.0) > 0.0, level, -level), f"{'<' if order == 'little' else '>'}i2")
    assert {(packing.packing.bits, packing.header_bytes) for packing in list_likely_packings(stored)} == {(16, 0)}


@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_two_byte_channels_of_one_antenna_are_no_wide_numbers(noise: float) -> None:
    result = np.stack(
        [
            draw_normal(20.0) + noise * np.random.default_rng(k).normal(0.0, 20.0, draw_normal(1.0).size)
            for k in range(2)
        ]
    )
    assert list_kinds(store_octets(np.clip(result.T.reshape(-1), -128, 127), "<i1")) == {("int", 8)}


def test_a_wide_number_that_begins_late_is_found() -> None:
    stored = np.concatenate([np.zeros(1, np.uint8), store_octets(draw_normal(100.0), "<i2")])
    assert {(packing.packing.byte_order, packing.header_bytes) for packing in list_likely_packings(stored)} == {
        ("little", 1)
    }


@pytest.mark.parametrize(("kind", "bits"), [("<f4", 32), (">f4", 32), ("<f8", 64), (">f8", 64)])
def test_floats_are_recognized_by_being_near_each_other(kind: str, bits: int) -> None:
    assert list_kinds(store_octets(draw_normal(0.01), kind)) == {("float", bits)}


def pack_twelve(values, order):
    """Pack pairs of 12 bits into three bytes, through a text of 24 digits."""
    threes = [[f"{v % 4096:012b}" for v in pair] for pair in values.reshape(-1, 2).tolist()]
    if order == "msb-first":
        return b"".join(int(a + b, 2).to_bytes(3, "big") for a, b in threes)
    return b"".join(int(b + a, 2).to_bytes(3, "little") for a, b in threes)


@pytest.mark.parametrize("order", ["msb-first", "lsb-first"])
@pytest.mark.parametrize("rms", [20.0, 300.0, 700.0])
@pytest.mark.parametrize("skip", [0, 1, 2])
@pytest.mark.parametrize("encoding", ["int", "offset-binary"])
def test_packed_numbers_of_twelve_bits_are_recognized(rms, order, skip, encoding) -> None:
    values = np.clip(np.rint(draw_normal(rms)[:96_000]), -2048, 2047).astype(int)
    stored = pack_twelve(values + (2048 if encoding == "offset-binary" else 0), order)
    found = list_likely_packings(np.frombuffer(stored, np.uint8)[3 - skip : -skip or None])
    best = found[0]
    assert (best.packing.encoding, best.packing.bits, best.packing.bit_order) == (encoding, 12, order)
    assert best.header_bytes == skip


def test_numbers_of_24_bits_are_not_taken_for_twelve() -> None:
    stored = np.rint(draw_normal(1e5)[:64_000]).astype("<i4").view(np.uint8).reshape(-1, 4)[:, :3].ravel()
    assert not any(packing.packing.bits == 12 for packing in list_likely_packings(stored[: stored.size // 48 * 48]))


def test_two_and_four_bit_numbers_are_recognized_by_their_codes() -> None:
    shares = {"sign-magnitude": (0.34, 0.16, 0.34, 0.16), "offset-binary": (0.16, 0.34, 0.34, 0.16)}
    shares["int"] = (0.34, 0.16, 0.16, 0.34)
    rng = np.random.default_rng(2)
    for encoding, share in shares.items():
        codes = rng.choice(4, (N, 4), p=share).astype(np.uint8)
        stored = np.bitwise_or.reduce(codes << np.array([0, 2, 4, 6], np.uint8), axis=1)
        assert (encoding, 2) in list_kinds(stored)
    nibbles = (np.clip(np.round(draw_normal(2.5)), -8, 7).astype(np.int8) & 15).astype(np.uint8)
    assert list_kinds(nibbles[0::2] << 4 | nibbles[1::2]) == {("int", 4)}


def test_what_shows_nothing_is_taken_for_signs() -> None:
    stored = np.frombuffer(np.random.default_rng(3).bytes(N), np.uint8)
    assert list_kinds(stored) == {("sign", 1)}
    assert {packing.packing.bit_order for packing in list_likely_packings(stored)} == {"msb-first", "lsb-first"}


@pytest.mark.parametrize("header", [b"", b"made by a recorder".ljust(512, b"\0"), bytes(8192)])
def test_a_header_ends_where_the_bytes_change(header: bytes) -> None:
    stored = np.frombuffer(header + np.random.default_rng(4).bytes(N), np.uint8)
    assert measure_header(stored) == len(header)


@pytest.mark.parametrize("seed", range(20))
def test_samples_alone_have_no_header(seed: int) -> None:
    assert measure_header(store_octets(draw_normal(20.0, seed), "<i1")) == 0
    assert measure_header(store_octets(draw_normal(60.0, seed), "<i2")) == 0


@pytest.mark.parametrize(
    ("head", "what"),
    [
        (b"7z\xbc\xaf\x27\x1c", "7-Zip"),
        (b"\x00\x00\x00\x18ftypmp42", "video"),
        (b"\xb5b\x02\x15", "UBX"),
        (b"$GPGGA,1", "NMEA"),
        (b"# a remark\nrate = 1\n" * 5, "text"),
        (b'{"global": {"core:datatype": "ci8"}}', "SigMF"),
    ],
)
def test_what_holds_no_samples_is_named(head: bytes, what: str) -> None:
    known = identify_other(head)
    assert known is not None
    assert what in known[0]


def test_samples_are_not_taken_for_anything_else() -> None:
    for seed in range(200):
        assert identify_other(np.random.default_rng(seed).bytes(4096)) is None
        assert identify_other(store_octets(draw_normal(20.0, seed)[:4096], "<i1").tobytes()) is None


def test_a_wav_header_states_how_to_read_what_follows() -> None:
    head = struct.pack("<4sI4s4sIHHIIHH", b"RIFF", 0, b"WAVE", b"fmt ", 16, 1, 2, 2_500_000, 10_000_000, 4, 16)
    extra = struct.pack("<4sI", b"LIST", 3) + b"abc\0"
    found = read_wav_header(head + extra + struct.pack("<4sI", b"data", 1000) + bytes(100))
    assert found == WavHeader(rate_hz=2.5e6, channels=2, encoding="int", bits=16, header_bytes=56, data_bytes=1000)
    assert read_wav_header(b"RIFF" + bytes(100)) is None
    adpcm = head.replace(struct.pack("<HH", 1, 2), struct.pack("<HH", 17, 2))
    assert read_wav_header(adpcm + struct.pack("<4sI", b"data", 1000)) is None


@pytest.mark.parametrize(
    ("name", "reported"),
    [
        ("fs4.092_if1.405.bin", NameHints(rate_hz=4.092e6, if_hz=1.405e6)),
        ("rec_2.6Msps.cs8", NameHints(rate_hz=2.6e6, kind="complex", encoding="int", bits=8)),
        (
            "L1_20211125_004000_12MHz_I.bin",
            NameHints(rate_hz=12e6, kind="real", start_utc=np.datetime64("2021-11-25T00:40:00", "ns")),
        ),
        (
            "SDRSharp_20210101_120000Z_1575420000Hz_IQ.wav",
            NameHints(centre_hz=1575.42e6, kind="complex", start_utc=np.datetime64("2021-01-01T12:00:00", "ns")),
        ),
        ("strange.bin", NameHints()),
        ("20211399_004000.bin", NameHints()),
    ],
)
def test_a_name_states_what_it_states(name: str, reported: NameHints) -> None:
    assert read_hints(name) == reported
