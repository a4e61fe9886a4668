"""`platform.toml` for the files given: which receiver has which, and what only a person knows as commented lines."""

import importlib.metadata
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skyproof.app.common.platform import Platform, read_platform
from skyproof.app.init.text import FoundReceiver, write_platform_lines
from skyproof.app.inspect.log import holds_measurements, inspect_log
from skyproof.errors import InputError, OutputError
from skyproof.formats.atomic_write import write_lines
from skyproof.formats.attitude import read_attitude
from skyproof.formats.imu import read_imu
from skyproof.formats.recording import open_recording
from skyproof.formats.rinex_obs_read import holds_observations, read_obs
from skyproof.gnss.frames import geodetic_from_ecef
from skyproof.gnss.time import format_iso, seconds_between

__all__ = ["InitResult", "init"]

_SERIES = (".csv", ".parquet")


@dataclass(frozen=True, kw_only=True)
class InitResult:
    """The file that was written, and the platform that it describes."""

    path: Path
    platform: Platform


def init(files: Sequence[str | Path], *, out: str | Path = "platform.toml", overwrite: bool = False) -> InitResult:
    """Write a platform file that `protect` takes, from what recordings, logs and observation files say.

    Parameters
    ----------
    files : one per receiver: recordings with their sidecars, logs, observation files; besides, inertial readings or an
        attitude as CSV or Parquet.
    out : the file to write; paths in it are relative to its folder.
    overwrite : whether an existing file is replaced.

    Raises
    ------
    InputError : a file that cannot be opened; inertial readings or attitudes in more than one.
    OutputError : the file already exists, is an input or the sidecar of one, or cannot be written.
    """
    out = Path(out)
    paths = [Path(file) for file in files]
    inputs = [path.resolve() for path in paths]
    if any(out.resolve() in (path, path.parent / f"{path.stem}.toml") for path in inputs):
        raise OutputError(f"{out}: is an input or its sidecar; give another name with --out")
    if out.exists() and not overwrite:
        raise OutputError(f"{out}: already exists; give another name with --out, or --overwrite to replace it")
    series = [path for path in paths if path.suffix.lower() in _SERIES]
    receivers = _name_receivers([_read_input(path, out.parent) for path in paths if path not in series])
    if not receivers:
        raise InputError("no recording, log or observation file given; give one per receiver")
    tables = _assign_tables(series, out.parent)
    version = importlib.metadata.version("skyproof")
    write_lines(out, write_platform_lines(receivers, tables, version), encoding="utf-8")
    return InitResult(path=out, platform=read_platform(out))


@dataclass(frozen=True, kw_only=True)
class _Found:
    """One input, what it says in words, and how many antennas it has; `marker` as a header names it."""

    path: Path
    input: str
    says: tuple[str, ...]
    marker: str = ""
    antennas: int = 1


def _read_input(path: Path, folder: Path) -> _Found:
    if holds_observations(path):
        return _read_observations(path, folder)
    if holds_measurements(path) and not path.with_suffix(".toml").exists():
        return _read_log(path, folder)
    channels = open_recording(path)
    channel = channels[0]
    time = _describe_time(channel.start_gpst, channel.duration_s)
    says = [f"{channel.format or 'raw'}, {channel.rate_hz / 1e6:g} Msps, {time}"]
    if len(channels) > 1:
        says.append(f"its {len(channels)} channels are the receiver's antennas")
    return _Found(path=path, input=_relative_path(path, folder), says=tuple(says), antennas=len(channels))


def _read_observations(path: Path, folder: Path) -> _Found:
    file = read_obs(path)
    o = file.observations
    lasts_s = seconds_between(o.gpst[-1], o.gpst[0])
    says = [f"RINEX {file.version:g} observations, {o.gpst.size} epochs, {_describe_time(o.gpst[0], lasts_s)}"]
    if file.position_ecef_m is not None and np.any(file.position_ecef_m):
        lat, lon, height_m = (float(value) for value in geodetic_from_ecef(file.position_ecef_m))
        says.append(
            f"its header says that it stands near lat_deg = {np.degrees(lat):.6f}, lon_deg = {np.degrees(lon):.6f}, "
            f"height_m = {height_m:.1f}, and not how nearly"
        )
    return _Found(path=path, input=_relative_path(path, folder), says=tuple(says), marker=file.marker)


def _read_log(path: Path, folder: Path) -> _Found:
    """Return what a receiver's log says, and what it should hold besides."""
    log = inspect_log(path)
    if not log.epochs:
        raise InputError(f"{path}: {log.summary}; {'; '.join(log.configuration) or 'have the receiver log them'}")
    says = [f"{log.format}, {log.epochs} epochs, {_describe_time(log.start_gpst, log.duration_s)}"]
    says += [f"without {', '.join(wanted.name for wanted in log.missing)}, which would help"] if log.missing else []
    return _Found(path=path, input=_relative_path(path, folder), says=(*says, *log.configuration))


def _name_receivers(found: Sequence[_Found]) -> list[FoundReceiver]:
    """Name each receiver by its marker if no other has that, else by its file."""
    markers = [input_file.marker for input_file in found]
    receivers: list[FoundReceiver] = []
    for input_file in found:
        text = (
            input_file.marker if markers.count(input_file.marker) == 1 and input_file.marker else input_file.path.stem
        )
        name = _make_name(text, [receiver.name for receiver in receivers])
        receivers.append(FoundReceiver(name, input_file.input, input_file.says, input_file.antennas))
    return receivers


def _describe_time(start_gpst: np.datetime64 | None, lasts_s: float) -> str:
    start = "of unknown date" if start_gpst is None else f"from {format_iso(start_gpst, 3)} (GPS time)"
    return f"{start}, {lasts_s:.1f} s"


def _make_name(text: str, names: Sequence[str]) -> str:
    """Make a receiver's name that is not yet taken, from the letters that a name may have."""
    plain = re.sub(r"[^A-Za-z0-9._-]+", "-", text).strip("._-")[:90] or "rx"
    candidates = (plain, *(f"{plain}-{number}" for number in range(2, len(names) + 3)))
    return next(name for name in candidates if name not in names)


def _relative_path(path: Path, folder: Path) -> str:
    """Make a path relative to a folder, as a file there names it. Raises InputError if no text can hold it."""
    text = Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()
    try:
        text.encode()
    except UnicodeEncodeError as error:
        raise InputError(f"{path}: its name is not UTF-8, which a platform file is; rename it") from error
    return text


def _assign_tables(series: Sequence[Path], folder: Path) -> dict[str, str]:
    """Assign each file of readings over time to its table: "imu" or "attitude"."""
    tables: dict[str, str] = {}
    for path in series:
        table = _table_of(path)
        if table in tables:
            raise InputError(f"{path}: a second file for [{table}], which has one; give one of the two")
        tables[table] = _relative_path(path, folder)
    return tables


def _table_of(path: Path) -> str:
    try:
        read_imu(path)
        return "imu"
    except InputError as not_imu:
        try:
            read_attitude(path)
            return "attitude"
        except InputError as neither:
            raise InputError(f"neither inertial readings nor an attitude: {not_imu}; {neither}") from neither
