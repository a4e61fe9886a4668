"""Every reader of the package as a function of one file's path, with the small files that damage begins with."""

import gzip
import io
import tarfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tests.logs.frames import nmea_sentence, resealed
from tests.logs.test_nmea import gga, rmc
from tests.logs.test_rtcm3 import glonass_time, old_gps, simple
from tests.logs.test_ubx import gps, hardware, pvt, radio, rawx

from skyproof.app.common.platform import read_platform
from skyproof.formats.attitude import read_attitude
from skyproof.formats.byte_io import read_content
from skyproof.formats.imu import read_imu
from skyproof.formats.raw import open_raw
from skyproof.formats.readings import list_likely_packings, measure_header
from skyproof.formats.recording import open_recording
from skyproof.formats.rinex_nav import get_glonass_channels, read_nav
from skyproof.formats.rinex_obs_pieces import continue_pieces, read_obs_pieces
from skyproof.formats.rinex_obs_read import read_obs
from skyproof.formats.sigmf import check_sha512, open_sigmf
from skyproof.formats.signatures import identify_other, read_head, read_wav_header
from skyproof.formats.track import read_track
from skyproof.formats.verdict import read_verdict
from skyproof.logs.content import Beside
from skyproof.logs.kinds import kind_of_log
from skyproof.logs.orbits import OrbitCollector
from skyproof.records import Samples
from skyproof.simulator.scenario import read_scenario

__all__ = ["READERS", "Reader"]

SEEDS = Path(__file__).with_name("seeds")
_RANDOM = np.random.default_rng(0).integers(0, 256, 1 << 15, dtype=np.uint8).tobytes()
_FIRST_GPST, _LAST_GPST = np.datetime64("1980-01-06"), np.datetime64("2200-01-01")


@dataclass(frozen=True)
class Reader:
    """A reader of the file `name`; `beside` are files that stand in the same folder, undamaged.

    weight : how many of a hundred inputs are its own.
    """

    name: str
    read: Callable[[Path], None]
    seeds: tuple[bytes, ...]
    weight: int
    beside: tuple[tuple[str, bytes], ...] = ()


def _seeds(*names: str) -> tuple[bytes, ...]:
    return tuple((SEEDS / name).read_bytes() for name in names)


def _in_time(*instants: np.datetime64 | None) -> None:
    for instant in instants:
        assert instant is None or _FIRST_GPST <= instant < _LAST_GPST, f"a year that nobody wrote: {instant}"


def _nav(path: Path) -> None:
    navigation = read_nav(path)
    get_glonass_channels(navigation)
    _in_time(*(ephemeris.reference_gpst for ephemeris in navigation.ephemerides))


def _obs(path: Path) -> None:
    observations = read_obs(path).observations
    _in_time(observations.gpst.min(), observations.gpst.max())


def _content(path: Path) -> bytes:
    """Read what is given on in blocks, from regular files only, as all readers do."""
    return read_content(path, 1 << 30, "the file", "give a smaller one")


def _pieces(path: Path) -> None:
    content = _content(path)
    blocks = (content[k : k + 3001] for k in range(0, len(content), 3001))
    for piece in continue_pieces(found.observations for found in read_obs_pieces(blocks, piece_bytes=4096)):
        _in_time(piece.gpst.min(), piece.gpst.max())


def _track(path: Path) -> None:
    _in_time(read_track(path).start_gpst)


def _imu(path: Path) -> None:
    found = read_imu(path)
    assert np.isfinite(found.specific_force_m_s2).all()
    assert np.isfinite(found.angular_rate_rad_s).all()
    _in_time(*found.series(np.datetime64("2022-01-01", "ns")).gpst[[0, -1]])


def _attitude(path: Path) -> None:
    _in_time(*read_attitude(path).attitude(np.datetime64("2022-01-01", "ns"), 0.01).gpst[[0, -1]])


def _samples(opened: tuple[Samples, ...]) -> None:
    for samples in opened:
        _in_time(samples.start_gpst)
        for start in (0, max(samples.n_samples - 100, 0)):
            samples.read(start, min(samples.n_samples - start, 100))


def _sidecar(path: Path) -> None:
    _samples((open_raw(path.with_suffix(".bin"), path),))


def _sigmf(path: Path) -> None:
    _samples(open_sigmf(path))
    check_sha512(path)


def _bytes(path: Path) -> None:
    head = read_head(path)
    identify_other(head)
    read_wav_header(head)
    octets = np.fromfile(path, np.uint8)
    measure_header(octets)
    if octets.size >= 64:
        list_likely_packings(octets[: octets.size // 16 * 16])


def _any(path: Path) -> None:
    _samples(open_recording(path))


def _log(path: Path) -> None:
    """Read a receiver's log of any kind, as it was damaged and with checksums that hold in spite of it."""
    content = _content(path)
    kind = kind_of_log(content)
    if kind is None:
        return
    for octets in (content, resealed(content)):
        collector = OrbitCollector()
        for piece in kind.read((octets[k : k + 3001] for k in range(0, len(octets), 3001)), "rx", Beside(_NEAR)):
            collector.take(piece.frames, {"R01": 1})
            collector.add(piece.ephemerides)
            for record in (piece.observations, piece.fixes, piece.levels, piece.states, *piece.frames):
                if record is not None and record.gpst.size:
                    _in_time(record.gpst.min(), record.gpst.max())
        collector.navigation("fuzz")


def _platform(path: Path) -> None:
    start_gpst = getattr(read_platform(path).imu, "start_gpst", None)
    if start_gpst is not None:
        _in_time(start_gpst)


def _scenario(path: Path) -> None:
    _in_time(read_scenario(path).start_gpst)


def _verdict(path: Path) -> None:
    read_verdict(path)


def _archive() -> bytes:
    file = io.BytesIO()
    with tarfile.open(fileobj=file, mode="w") as tar:
        for name, content in (("a/ci8.sigmf-meta", _seeds("ci8.sigmf-meta")[0]), ("a/ci8.sigmf-data", _RANDOM[:20480])):
            member = tarfile.TarInfo(name)
            member.size = len(content)
            tar.addfile(member, io.BytesIO(content))
    return file.getvalue()


def _wav() -> bytes:
    header = b"RIFF\x24\x80\0\0WAVEfmt \x10\0\0\0\1\0\2\0\x40\x42\x0f\0\0\x09\x3d\0\4\0\x10\0data\0\x80\0\0"
    return header + _RANDOM[:8192]


def _packed(*contents: bytes) -> Iterator[bytes]:
    return (gzip.compress(content, mtime=0) for content in contents)


def _logs() -> tuple[bytes, ...]:
    """Return short logs of each protocol."""
    ubx = rawx(100.0, 2300, [gps(9000)] * 3) + hardware(90, 4000, 9, 1) + radio((1, 80, 8191, 0), (3, 120, 0, 255))
    glonass = simple(glonass_time(2, 50_000_000), number=1087)
    rtcm = simple(0) + glonass + simple(0, number=1127) + old_gps(0, 5)
    gsv = nmea_sentence("GPGSV,1,1,02,05,40,083,46,09,10,100,33,1")
    nmea = rmc("120000.00", "050224") + gga("120000.00") + gsv + gga("120001.00")
    return (ubx + pvt(104_000, (2024, 2, 4)), rtcm, nmea + rtcm + ubx, nmea)


_NEAR = np.datetime64("2024-02-05T12:00:00", "ns")
_NAV = _seeds("nav-2.21n", "nav-3.rnx", "nav-4.rnx", "nav-mixed.rnx")
_OBS = _seeds("obs-2.21o", "obs-3.rnx")
_COMPACT = _seeds("compact-1.21d", "compact-3.crx")

READERS: dict[str, Reader] = {
    "nav": Reader("a.rnx", _nav, (*_NAV, *_packed(_NAV[1])), 12),
    "obs": Reader("a.obs", _obs, (*_OBS, *_packed(_OBS[1])), 8),
    "compact": Reader("a.crx", _obs, _COMPACT, 3),
    "pieces": Reader("a.obs", _pieces, (*_OBS, *_COMPACT, _OBS[1] + _OBS[1], 2 * _COMPACT[1], *_packed(_OBS[0])), 6),
    "log": Reader("a.log", _log, (*_logs(), *_seeds("gnsslogger.txt", "flight.ulg", "flight.bin")), 6),
    "csv": Reader("a.csv", _track, _seeds("track.csv", "track-ecef.csv"), 6),
    "imu": Reader("a.csv", _imu, _seeds("imu.csv", "imu-time.csv"), 4),
    "attitude": Reader("a.csv", _attitude, _seeds("attitude.csv"), 2),
    "nmea": Reader("a.nmea", _track, _seeds("track.nmea"), 6),
    "kml": Reader("a.kml", _track, _seeds("track.kml", "line.kml"), 6),
    "sidecar": Reader("a.toml", _sidecar, _seeds("sidecar.toml", "sidecar-real.toml"), 8, (("a.bin", _RANDOM[:4096]),)),
    "sigmf": Reader(
        "a.sigmf-meta", _sigmf, _seeds("ci8.sigmf-meta", "bits.sigmf-meta"), 8, (("a.sigmf-data", _RANDOM[:20480]),)
    ),
    "archive": Reader("a.sigmf", _sigmf, (_archive(),), 4),
    "bytes": Reader("a.bin", _bytes, (_RANDOM[:8192], _wav(), *_NAV[:1], *_COMPACT[:1]), 2),
    "any": Reader("b.bin", _any, (_RANDOM[:8192], _wav(), *_NAV[:1], *_COMPACT[:1]), 2),
    "platform": Reader("a.toml", _platform, _seeds("platform.toml", "platform-whole.toml"), 8),
    "scenario": Reader("a.toml", _scenario, _seeds("scenario.toml", "sidecar.toml"), 5),
    "verdict": Reader("verdict.json", _verdict, _seeds("verdict.json"), 4),
}
