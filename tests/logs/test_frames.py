"""Frames of mixed protocols in a stream: each found once, whatever is between them and wherever blocks end."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from tests.logs.frames import make_nmea_sentence, make_rtcm3_frame, make_sbf_block, make_ubx_frame

from skyproof.logs.frames import Frames, Protocol, split_frames

FRAMES = (
    (Protocol.UBX, make_ubx_frame(0x02, 0x15, bytes(range(16)))),
    (Protocol.NMEA, make_nmea_sentence("GPGGA,120000.00,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,")),
    (Protocol.SBF, make_sbf_block(4027, bytes(range(40)))),
    (Protocol.RTCM3, make_rtcm3_frame(bytes([0x43, 0x50]) + bytes(60))),
)
NOISE = b"\x00\xff\xb5\x24\x24$@\xd3 text \r\n"


def list_contents(pieces: list[Frames]) -> list[tuple[int, bytes]]:
    """Return protocol and bytes of each frame."""
    return [
        (int(protocol), piece.octets[begin : begin + length].tobytes())
        for piece in pieces
        for protocol, begin, length in zip(piece.protocol, piece.begin, piece.length, strict=True)
    ]


def list_expected(frames: list[tuple[Protocol, bytes]]) -> list[tuple[int, bytes]]:
    """Return the same of frames as they were made; a sentence ends before its line end."""
    return [
        (int(protocol), frame.rstrip(b"\r\n") if protocol == Protocol.NMEA else frame) for protocol, frame in frames
    ]


@given(
    order=st.lists(st.sampled_from(range(len(FRAMES))), max_size=12),
    noise=st.lists(st.integers(0, len(NOISE)), min_size=12, max_size=12),
    block=st.integers(1, 300),
)
def test_frames_are_found_wherever_blocks_end(order: list[int], noise: list[int], block: int) -> None:
    frames = [FRAMES[k] for k in order]
    stream = b"".join(NOISE[:n] + frame for (_, frame), n in zip(frames, noise, strict=False))
    blocks = [stream[k : k + block] for k in range(0, len(stream), block)]
    assert list_contents(list(split_frames(blocks))) == list_expected(frames)


def test_stretches_give_what_the_whole_gives(monkeypatch) -> None:
    stream = b"".join(frame for _, frame in FRAMES) * 50
    whole = list_contents(list(split_frames([stream])))
    monkeypatch.setattr("skyproof.logs.frames._BLOCK_BYTES", 100)
    pieces = list(split_frames([stream[k : k + 7] for k in range(0, len(stream), 7)]))
    assert len(pieces) > 50
    assert list_contents(pieces) == whole
    assert len(whole) == 200


@given(damage=st.integers(0, 3), at=st.integers(0, 200), flip=st.integers(1, 255))
def test_damage_costs_one_frame(damage: int, at: int, flip: int) -> None:
    broken = bytearray(FRAMES[damage][1])
    broken[at % (len(broken) - 2)] ^= flip
    stream = b"".join(bytes(broken) if k == damage else frame for k, (_, frame) in enumerate(FRAMES)) + b"\n" * 8200
    rest = [frame for k, frame in enumerate(FRAMES) if k != damage]
    found = list_contents(list(split_frames([stream])))
    assert [frame for frame in found if frame in list_expected(rest)] == list_expected(rest)
    assert len(found) <= len(rest) + 1


def test_a_stream_that_ends_in_a_frame_is_cut() -> None:
    for protocol, frame in FRAMES:
        *_, last = split_frames([FRAMES[0][1] + frame[:-9]])
        assert last.cut, protocol
        assert last.begin.size == 1
    *_, last = split_frames([b"".join(frame for _, frame in FRAMES)])
    assert not last.cut


def test_random_bytes_hold_no_frame_but_by_chance() -> None:
    octets = np.random.default_rng(1).integers(0, 256, 1 << 20, dtype=np.uint8).tobytes()
    found = list_contents(list(split_frames([octets])))
    assert len(found) < 5
