"""Every reader of the package as a function of one file's path, with the small files that damage begins with."""

import gzip
import io
import tarfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tests.logs.frames import make_nmea_sentence, reseal
from tests.logs.test_nmea import make_gga, make_rmc
from tests.logs.test_rtcm3 import make_glonass_time, make_old_gps, make_simple
from tests.logs.test_ubx import make_gps, make_hardware, make_pvt, make_radio, make_rawx

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


def _make_seeds(*names: str) -> tuple[bytes, ...]:
    return tuple((SEEDS / name).read_bytes() for name in names)


def _limit_time(*instants: np.datetime64 | None) -> None:
    for instant in instants:
        assert instant is None or _FIRST_GPST <= instant < _LAST_GPST, f"a year that nobody wrote: {instant}"


def _read_nav(path: Path) -> None:
    navigation = read_nav(path)
    get_glonass_channels(navigation)
    _limit_time(*(ephemeris.reference_gpst for ephemeris in navigation.ephemerides))


def _read_obs(path: Path) -> None:
    observations = read_obs(path).observations
    _limit_time(observations.gpst.min(), observations.gpst.max())


def _read_content(path: Path) -> bytes:
    """Read what is given on in blocks, from regular files only, as all readers do."""
    return read_content(path, 1 << 30, "the file", "give a smaller one")


def _read_pieces(path: Path) -> None:
    content = _read_content(path)
    blocks = (content[k : k + 3001] for k in range(0, len(content), 3001))
    for piece in continue_pieces(found.observations for found in read_obs_pieces(blocks, piece_bytes=4096)):
        _limit_time(piece.gpst.min(), piece.gpst.max())


def _track(path: Path) -> None:
    _limit_time(read_track(path).start_gpst)


def _read_imu(path: Path) -> None:
    found = read_imu(path)
    assert np.isfinite(found.specific_force_m_s2).all()
    assert np.isfinite(found.angular_rate_rad_s).all()
    _limit_time(*found.series(np.datetime64("2022-01-01", "ns")).gpst[[0, -1]])


def _read_attitude(path: Path) -> None:
    _limit_time(*read_attitude(path).attitude(np.datetime64("2022-01-01", "ns"), 0.01).gpst[[0, -1]])


def _read_samples(opened: tuple[Samples, ...]) -> None:
    for samples in opened:
        _limit_time(samples.start_gpst)
        for start in (0, max(samples.n_samples - 100, 0)):
            samples.read(start, min(samples.n_samples - start, 100))


def _read_sidecar(path: Path) -> None:
    _read_samples((open_raw(path.with_suffix(".bin"), path),))


def _read_sigmf(path: Path) -> None:
    _read_samples(open_sigmf(path))
    check_sha512(path)


def _read_bytes(path: Path) -> None:
    head = read_head(path)
    identify_other(head)
    read_wav_header(head)
    octets = np.fromfile(path, np.uint8)
    measure_header(octets)
    if octets.size >= 64:
        list_likely_packings(octets[: octets.size // 16 * 16])


def _read_any(path: Path) -> None:
    _read_samples(open_recording(path))


def _log(path: Path) -> None:
    """Read a receiver's log of any kind, as it was damaged and with checksums that hold in spite of it."""
    content = _read_content(path)
    kind = kind_of_log(content)
    if kind is None:
        return
    for octets in (content, reseal(content)):
        collector = OrbitCollector()
        for piece in kind.read((octets[k : k + 3001] for k in range(0, len(octets), 3001)), "rx", Beside(_NEAR)):
            collector.take(piece.frames, {"R01": 1})
            collector.add(piece.ephemerides)
            for record in (piece.observations, piece.fixes, piece.levels, piece.states, *piece.frames):
                if record is not None and record.gpst.size:
                    _limit_time(record.gpst.min(), record.gpst.max())
        collector.navigation("fuzz")


def _read_platform(path: Path) -> None:
    start_gpst = getattr(read_platform(path).imu, "start_gpst", None)
    if start_gpst is not None:
        _limit_time(start_gpst)


def _read_scenario(path: Path) -> None:
    _limit_time(read_scenario(path).start_gpst)


def _read_verdict(path: Path) -> None:
    read_verdict(path)


def _make_archive() -> bytes:
    file = io.BytesIO()
    with tarfile.open(fileobj=file, mode="w") as tar:
        for name, content in (
            ("a/ci8.sigmf-meta", _make_seeds("ci8.sigmf-meta")[0]),
            ("a/ci8.sigmf-data", _RANDOM[:20480]),
        ):
            member = tarfile.TarInfo(name)
            member.size = len(content)
            tar.addfile(member, io.BytesIO(content))
    return file.getvalue()


def _make_wav() -> bytes:
    header = b"RIFF\x24\x80\0\0WAVEfmt \x10\0\0\0\1\0\2\0\x40\x42\x0f\0\0\x09\x3d\0\4\0\x10\0data\0\x80\0\0"
    return header + _RANDOM[:8192]


def _make_packed(*contents: bytes) -> Iterator[bytes]:
    return (gzip.compress(content, mtime=0) for content in contents)


def _make_logs() -> tuple[bytes, ...]:
    """Return short logs of each protocol."""
    ubx = (
        make_rawx(100.0, 2300, [make_gps(9000)] * 3)
        + make_hardware(90, 4000, 9, 1)
        + make_radio((1, 80, 8191, 0), (3, 120, 0, 255))
    )
    glonass = make_simple(make_glonass_time(2, 50_000_000), number=1087)
    rtcm = make_simple(0) + glonass + make_simple(0, number=1127) + make_old_gps(0, 5)
    gsv = make_nmea_sentence("GPGSV,1,1,02,05,40,083,46,09,10,100,33,1")
    nmea = make_rmc("120000.00", "050224") + make_gga("120000.00") + gsv + make_gga("120001.00")
    return (ubx + make_pvt(104_000, (2024, 2, 4)), rtcm, nmea + rtcm + ubx, nmea)


_NEAR = np.datetime64("2024-02-05T12:00:00", "ns")
_NAV = _make_seeds("nav-2.21n", "nav-3.rnx", "nav-4.rnx", "nav-mixed.rnx")
_OBS = _make_seeds("obs-2.21o", "obs-3.rnx")
_COMPACT = _make_seeds("compact-1.21d", "compact-3.crx")

READERS: dict[str, Reader] = {
    "nav": Reader("a.rnx", _read_nav, (*_NAV, *_make_packed(_NAV[1])), 12),
    "obs": Reader("a.obs", _read_obs, (*_OBS, *_make_packed(_OBS[1])), 8),
    "compact": Reader("a.crx", _read_obs, _COMPACT, 3),
    "pieces": Reader(
        "a.obs", _read_pieces, (*_OBS, *_COMPACT, _OBS[1] + _OBS[1], 2 * _COMPACT[1], *_make_packed(_OBS[0])), 6
    ),
    "log": Reader("a.log", _log, (*_make_logs(), *_make_seeds("gnsslogger.txt", "flight.ulg", "flight.bin")), 6),
    "csv": Reader("a.csv", _track, _make_seeds("track.csv", "track-ecef.csv"), 6),
    "imu": Reader("a.csv", _read_imu, _make_seeds("imu.csv", "imu-time.csv"), 4),
    "attitude": Reader("a.csv", _read_attitude, _make_seeds("attitude.csv"), 2),
    "nmea": Reader("a.nmea", _track, _make_seeds("track.nmea"), 6),
    "kml": Reader("a.kml", _track, _make_seeds("track.kml", "line.kml"), 6),
    "sidecar": Reader(
        "a.toml", _read_sidecar, _make_seeds("sidecar.toml", "sidecar-real.toml"), 8, (("a.bin", _RANDOM[:4096]),)
    ),
    "sigmf": Reader(
        "a.sigmf-meta",
        _read_sigmf,
        _make_seeds("ci8.sigmf-meta", "bits.sigmf-meta"),
        8,
        (("a.sigmf-data", _RANDOM[:20480]),),
    ),
    "archive": Reader("a.sigmf", _read_sigmf, (_make_archive(),), 4),
    "bytes": Reader("a.bin", _read_bytes, (_RANDOM[:8192], _make_wav(), *_NAV[:1], *_COMPACT[:1]), 2),
    "any": Reader("b.bin", _read_any, (_RANDOM[:8192], _make_wav(), *_NAV[:1], *_COMPACT[:1]), 2),
    "platform": Reader("a.toml", _read_platform, _make_seeds("platform.toml", "platform-whole.toml"), 8),
    "scenario": Reader("a.toml", _read_scenario, _make_seeds("scenario.toml", "sidecar.toml"), 5),
    "verdict": Reader("verdict.json", _read_verdict, _make_seeds("verdict.json"), 4),
}
