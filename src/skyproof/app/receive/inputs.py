"""Inputs as sources, one per receiver: recordings of samples and observation files, in any mixture."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path
from typing import Final

import numpy as np

from skyproof.app.common.settings import Settings
from skyproof.app.receive.antennas import in_step
from skyproof.app.receive.logged import holds_log, open_log
from skyproof.app.receive.observed import ObservedFile, has_same_measurements, open_observations
from skyproof.errors import InputError, SettingsError, write_value
from skyproof.formats.pieces import Workspace
from skyproof.formats.recording import open_recording
from skyproof.formats.rinex_nav import get_glonass_channels
from skyproof.formats.rinex_obs_read import holds_observations
from skyproof.formats.spool import rename_receiver
from skyproof.gnss.time import timedelta_from_s
from skyproof.records import NavigationData, Samples
from skyproof.remarks import Remark

__all__ = ["adopt_antenna_multipath", "cut_stretch", "list_antennas", "list_paths", "open_inputs", "require_recordings"]

SAME_SAMPLES: Final = 1 << 16  # compared, to tell whether two recordings are one
LONGEST_NAME: Final = 200  # of a receiver, in bytes; of a file it is 255


def list_paths(inputs: Iterable[str | Path | Iterable[str | Path]]) -> list[Path]:
    """Return the paths of inputs that are given one by one, together in a list, or both.

    Raises InputError for what is no path.
    """
    paths: list[Path] = []
    for item in inputs:
        for path in [item] if isinstance(item, str | Path) or not isinstance(item, Iterable) else item:
            if not isinstance(path, str | Path):
                raise InputError(
                    f"an input is {write_value(path)}, of type {type(path).__name__}; give the path of a file"
                )
            paths.append(Path(path))
    return paths


def open_inputs(
    paths: Sequence[Path | tuple[Path, ...]],
    settings: Settings,
    navigation: NavigationData | None = None,
    called: Sequence[str | None] = (),
    workspace: Workspace | None = None,
) -> list[Samples | ObservedFile]:
    """Open recordings and observation files, cut them to the stretch asked for, and give each receiver its own name.

    paths : each a file, of whose channels each is a receiver; or the antennas of one receiver, a file each or the
        channels of one.
    navigation : has the frequency numbers of GLONASS that an observation file may lack, and the week of a log.
    called : the receiver's name of each path; as its file is named where that is None.
    workspace : where the measurements of long observation files are kept.

    Raises
    ------
    InputError : no input, one that cannot be opened, or one that is the same as another.
    SettingsError : antennas of other receivers than these.
    """
    if not paths:
        raise InputError(
            "no input given; give one per receiver: samples with their sidecar, or an observation file; or a platform "
            "file that names them"
        )
    opened: list[Samples | ObservedFile] = []
    for path, receiver in zip_longest(paths, called):
        for source in _open_stretch(path, settings, navigation, workspace):
            _require_own(source, opened)
            names = [other.name for other in opened] + [name for name in called if name not in (None, receiver)]
            name = receiver or _shorten(source.name)
            candidates = (name, *(f"{name}-{number}" for number in range(2, len(names) + 3)))
            opened.append(_rename(source, next(name for name in candidates if name not in names)))
    _require_antennas(settings, [source.name for source in opened])
    return opened


def require_recordings(sources: Sequence[Samples | ObservedFile]) -> list[Samples]:
    """Return the sources, all of them recordings. Raises InputError if one holds no samples."""
    for source in sources:
        if not isinstance(source, Samples):
            raise InputError(
                f"{source.path}: an observation file, whose signals were tracked already; give a recording of samples, "
                "or protect it directly (skyproof protect)"
            )
    return [source for source in sources if isinstance(source, Samples)]


def _open_stretch(
    wanted: Path | tuple[Path, ...],
    settings: Settings,
    navigation: NavigationData | None,
    workspace: Workspace | None,
) -> tuple[Samples | ObservedFile, ...]:
    """Open the requested stretch of one source, or of each channel of a file, each a receiver."""
    paths = wanted if isinstance(wanted, tuple) else (wanted,)
    several = isinstance(wanted, tuple)  # antennas, which keep their numbers if one of them is dead
    sources = [s for path in paths for s in _open_file(path, settings, navigation, workspace, dead=several)]
    if len(sources) == 1 or not several:
        _require_living(sources)
        return tuple(sources)
    antennas: list[Samples] = []
    for source in sources:
        if not isinstance(source, Samples):
            raise InputError(
                f"{source.path}: an observation file among the antennas of one receiver; give recordings of samples, "
                "one per antenna, or make a receiver of its own of it"
            )
        _require_own(source, antennas)
        antennas.append(source)
    _require_living(antennas)
    return (in_step(antennas, _shorten(paths[0].stem)),)


def _require_living(antennas: Sequence[Samples | ObservedFile]) -> None:
    """Raise InputError if none of the antennas gives anything."""
    dead = [antenna.dead for antenna in antennas if isinstance(antenna, Samples) and antenna.dead]
    if dead and len(dead) == len(antennas):
        raise InputError(dead[0])


def adopt_antenna_multipath(settings: Settings, sources: Sequence[Samples | ObservedFile]) -> Settings:
    """Return the settings with the multipath of the poorest antenna, where the user states none."""
    known_m = [s.multipath_sigma_m for s in sources if isinstance(s, ObservedFile) and s.multipath_sigma_m is not None]
    worst_m = max(known_m, default=0.0)
    if "multipath_sigma_m" in settings.model_fields_set or worst_m <= settings.multipath_sigma_m:
        return settings
    return settings.model_copy(update={"multipath_sigma_m": worst_m})


def _open_file(
    path: Path,
    settings: Settings,
    navigation: NavigationData | None,
    workspace: Workspace | None,
    *,
    dead: bool,
) -> tuple[Samples | ObservedFile, ...]:
    if holds_log(path):
        return (
            open_log(path, navigation, start_s=settings.start_s, duration_s=settings.duration_s, workspace=workspace),
        )
    if not holds_observations(path):
        return tuple(
            cut_stretch(recording, settings.start_s, settings.duration_s)
            for recording in open_recording(path, dead=dead)
        )
    channels = None if navigation is None else get_glonass_channels(navigation)
    return (
        open_observations(
            path, channels, start_s=settings.start_s, duration_s=settings.duration_s, workspace=workspace
        ),
    )


def _require_own(source: Samples | ObservedFile, others: Sequence[Samples | ObservedFile]) -> None:
    """Raise InputError if an antenna of this source is one of the others'."""
    for other in others:
        if any(
            _is_same(antenna, own_antenna) for antenna in list_antennas(other) for own_antenna in list_antennas(source)
        ):
            raise InputError(
                f"{source.path}: the same recording as {other.path}; two antennas that are one would look like signals "
                "from one place: give each receiver's own recording of each antenna, and each once"
            )


def list_antennas(source: Samples | ObservedFile) -> tuple[Samples | ObservedFile, ...]:
    """Return the source of each antenna of a receiver, itself first."""
    return (source, *source.others) if isinstance(source, Samples) else (source,)


def _rename(source: Samples | ObservedFile, name: str) -> Samples | ObservedFile:
    if isinstance(source, Samples):
        return replace(source, name=name)
    return replace(source, name=name, observations=rename_receiver(source.observations, name))


def _shorten(name: str) -> str:
    """Shorten a receiver's name, so that file names have room for what follows it."""
    return name.encode()[:LONGEST_NAME].decode(errors="ignore")


def _require_antennas(settings: Settings, names: Sequence[str]) -> None:
    """Raise SettingsError if `antennas_enu_m` does not name these receivers."""
    if settings.antennas_enu_m is not None and set(settings.antennas_enu_m) != set(names):
        raise SettingsError(
            f"setting antennas_enu_m names {', '.join(settings.antennas_enu_m) or 'no receiver'}, but the receivers "
            f"are {', '.join(names)}; give the place of each by its name"
        )


def _is_same(a: Samples | ObservedFile, b: Samples | ObservedFile) -> bool:
    """Test whether two inputs have a stretch in common, where both are long enough. Noise never repeats itself."""
    if Path(a.path).resolve() == Path(b.path).resolve() and a.name == b.name:
        return True
    if isinstance(a, ObservedFile) or isinstance(b, ObservedFile):
        return isinstance(a, ObservedFile) and isinstance(b, ObservedFile) and has_same_measurements(a, b)
    count = min(SAME_SAMPLES, a.n_samples, b.n_samples)
    starts = (0, (min(a.n_samples, b.n_samples) - count) // 2)
    pairs = [(a.read(start, count), b.read(start, count)) for start in starts]
    return all(np.array_equal(*pair) for pair in pairs) and any(np.ptp(values) > 0.0 for values, _ in pairs)


def cut_stretch(samples: Samples, start_s: float, duration_s: float | None) -> Samples:
    """Cut the part of a recording from `start_s` on, `duration_s` long at most."""
    if start_s == 0.0 and duration_s is None:
        return samples
    first = round(start_s * samples.rate_hz)
    if first >= samples.n_samples:
        raise InputError(f"{samples.path}: lasts {samples.duration_s:.3f} s, but start_s is {start_s:g}; give less")
    count = samples.n_samples - first
    if duration_s is not None:
        count = min(count, round(duration_s * samples.rate_hz))
    remarks = samples.remarks if first + count == samples.n_samples else Remark.without_cut(samples.remarks)
    missing_s = sum(gap.missing_samples for gap in samples.gaps if gap.at_sample <= first) / samples.rate_hz
    later = timedelta_from_s(start_s + missing_s)
    return replace(
        samples,
        n_samples=count,
        remarks=remarks,
        read=lambda start, n: samples.read(first + start, min(n, count - start)),
        start_gpst=None if samples.start_gpst is None else samples.start_gpst + later,
        gaps=tuple(
            replace(gap, at_sample=gap.at_sample - first)
            for gap in samples.gaps
            if first < gap.at_sample < first + count
        ),
        others=tuple(cut_stretch(other, start_s, duration_s) for other in samples.others),
    )
