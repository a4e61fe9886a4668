"""Mutated frames of receivers' logs through every reader: none may raise, be slow, or take a gibibyte.

    python bench/fuzz_logs.py --frames 1000000 --seed 1

Frames are those of the logs in the folder that SKYPROOF_DATA names: UBX, SBF, RTCM 3 and NMEA. The content of each is
mutated, and its checksum made anew, so that what a reader sees is wrong and passes. A stream of some hundred frames at
a time goes through `read_log` and the collector of orbits; lines of Android logs go through their reader. Each stream
follows from the seed and its number.
"""

import argparse
import resource
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from random import Random
from typing import Any, Final

import numpy as np
from real_logs import folder

from skyproof.errors import SkyproofError
from skyproof.logs.content import Beside
from skyproof.logs.frames import Protocol, split_frames
from skyproof.logs.kinds import LOG_KINDS, LogKind
from skyproof.logs.orbits import OrbitCollector

sys.path.insert(0, str(Path(__file__).parent.parent))
from tests.fuzz.mutations import mutate_seed
from tests.logs.frames import make_rtcm3_frame, make_ubx_frame
from tests.logs.frames import make_sbf_block as sbf_frame

STREAM: Final = 200
MOST_S, MOST_BYTES = 5.0, 1 << 30
KEPT: Final = 400
"""Frames of each kind of message that are kept as seeds."""
_EDGES: Final = (0x00, 0x01, 0x7F, 0x80, 0xFE, 0xFF)
_HEADERS: Final = {Protocol.UBX: (6, 2), Protocol.SBF: (8, 0), Protocol.RTCM3: (3, 3)}


def seeds_of() -> dict[Protocol, list[bytes]]:
    """Return whole frames of every protocol, as many of each kind of message as are kept."""
    found: dict[Protocol, list[bytes]] = {protocol: [] for protocol in Protocol}
    count: Counter[tuple[Protocol, bytes]] = Counter()
    paths = [folder() / "imu-gnss-walk" / "gnss_1730.ubx"]
    paths += [path for name in ("streams", "osnma-sbf") for path in sorted((folder() / name).iterdir())]
    for path in paths:
        for frames in split_frames([path.read_bytes()[: 1 << 21]]):
            for kind, begin, length in zip(frames.protocol, frames.begin, frames.length, strict=True):
                frame = frames.octets[begin : begin + length].tobytes()
                key = Protocol(int(kind)), frame[2:6] if kind != Protocol.NMEA else frame[:6]
                count[key] += 1
                if count[key] <= KEPT:
                    found[key[0]].append(frame)
    return found


def lines_of() -> list[bytes]:
    """Return lines of Android logs, those that begin with a hash first."""
    return [
        line
        for path in sorted((folder() / "phone-orientation").glob("*.txt"))
        for line in path.read_bytes().splitlines(keepends=True)[:3000]
    ]


def damage(rng: Random, content: bytes) -> bytes:
    """Return the content with bytes set, fields set to extremes, or another length."""
    octets = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 4, 16))):
        if not octets:
            octets = bytearray(rng.randrange(40))
            continue
        at, how = rng.randrange(len(octets)), rng.randrange(5)
        if how == 0:
            octets[at] = rng.randrange(256)
        elif how == 1:
            octets[at] ^= 1 << rng.randrange(8)
        elif how == 2:
            width = rng.choice((1, 2, 4, 8))
            octets[at : at + width] = bytes([rng.choice(_EDGES)]) * min(width, len(octets) - at)
        elif how == 3:
            del octets[at : at + rng.choice((1, 4, 32, 1000))]
        else:
            octets[at:at] = bytes([rng.choice(_EDGES)]) * rng.choice((1, 4, 32, 400))
    return bytes(octets)


def mutate(rng: Random, protocol: Protocol, frame: bytes) -> bytes:
    """Return a frame with another content, whose checksum holds."""
    if protocol is Protocol.NMEA:
        text = damage(rng, frame[1 : frame.find(b"*")] if b"*" in frame else frame[1:])
        return b"$" + text + b"*%02X\r\n" % int(np.bitwise_xor.reduce(np.frombuffer(text or b"\0", np.uint8)))
    header, checksum = _HEADERS[protocol]
    content = damage(rng, frame[header : len(frame) - checksum])
    if protocol is Protocol.UBX:
        return make_ubx_frame(frame[2], frame[3], content[:8192])
    if protocol is Protocol.SBF:
        number = int.from_bytes(frame[4:6], "little")
        return sbf_frame(number & 0x1FFF, content[:60000], number >> 13)
    return make_rtcm3_frame(content[:1023])


def stream(rng: Random, seeds: dict[Protocol, list[bytes]]) -> bytes:
    """Return a stream of frames, three of four mutated, of one protocol mostly."""
    protocols = [protocol for protocol, frames in seeds.items() if frames]
    most = rng.choice(protocols)
    frames = []
    for _ in range(STREAM):
        protocol = most if rng.random() < 0.9 else rng.choice(protocols)
        frame = rng.choice(seeds[protocol])
        frames.append(frame if rng.random() < 0.25 else mutate(rng, protocol, frame))
    return b"".join(frames)


def text(rng: Random, lines: Sequence[bytes]) -> bytes:
    """Return an Android log of mutated lines."""
    begin = rng.randrange(max(len(lines) - STREAM, 1))
    head = [line for line in lines[:40] if line.startswith(b"#")]
    body = [
        line if rng.random() < 0.25 else mutate_seed(rng, line, lines[:50]) for line in lines[begin : begin + STREAM]
    ]
    return b"".join([*head, *body])


def through(octets: bytes, kind: LogKind, cut: int, beside: Beside) -> None:
    """Read a stream in two blocks, orbits included."""
    orbits, blocks = OrbitCollector(), [octets[:cut], octets[cut:]]
    kind.first_instant(blocks)
    for piece in kind.read(blocks, "rx", beside):
        orbits.take(piece.frames, {})
    orbits.navigation("mutated")
    orbits.received()


def main() -> None:
    """Run and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--again", type=int, help="one stream, whose error is raised")
    chosen = parser.parse_args()
    seeds, lines = seeds_of(), lines_of()
    text_kind, *_, stream_kind = LOG_KINDS  # flight logs are damaged in tests/fuzz
    near = Beside(near=np.datetime64("2025-08-28T17:30:40", "ns"), first_day=None, channels={"R05": 1})
    count, faults, slowest = 0, Counter[str](), 0.0
    numbers = range(-(-chosen.frames // STREAM)) if chosen.again is None else [chosen.again]
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    found: dict[str, Any] = {}
    for number in numbers:
        rng = Random(f"{chosen.seed} {number}")
        of_text = bool(lines) and rng.random() < 0.1
        octets = text(rng, lines) if of_text else stream(rng, seeds)
        begun_s = time.process_time()
        # Each reader sees what it is for, and now and then what is for the other.
        for kind in (text_kind, stream_kind) if rng.random() < 0.05 else [text_kind if of_text else stream_kind]:
            try:
                through(octets, kind, rng.randrange(len(octets)), near if rng.random() < 0.5 else Beside())
            except SkyproofError:
                continue
            except Exception as error:
                if chosen.again is not None:
                    raise
                words = f"{type(error).__name__}: {str(error)[:120]}"
                faults[words] += 1
                found.setdefault(words, number)
        slowest = max(slowest, time.process_time() - begun_s)
        count += STREAM
    used = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024
    print(
        f"{count} frames in {len(numbers)} streams: {sum(faults.values())} faults, the slowest stream {slowest:.2f} s"
    )
    print(f"{used / 1e6:.0f} MB more than at the start; limits are {MOST_S:g} s and {MOST_BYTES / 1e6:.0f} MB")
    print(
        "\n".join(
            f"  {words}: {n}, first in stream {found.get(words.split(': ', 1)[1])}" for words, n in faults.items()
        )
    )


if __name__ == "__main__":
    main()
