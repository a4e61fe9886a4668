"""The body that carries the antennas, window by window: its attitude and, where that is known, each antenna's place.

The attitude comes from the inertial navigator that fixes corrected in earlier windows, those in which no test failed
(`detectors.prediction.inertia`). Before it is aligned, the gyros carry on the attitude stated at the first reading.
Where neither reaches, it is the attitude stated for the body. The place of a receiver's antenna comes

- from the platform file, where the receiver is surveyed and does not move: then it is known, with its covariance;
- from another receiver that is surveyed, with the largest distance between the two as its error;
- else from what the signals of the window themselves show, which may be false. It is used for one thing: to say where
  north and the vertical are. The state then has an infinite variance of position, so nothing takes it for a position.
  The attitude's variance covers every position that signals show in the window. So it holds for true signals, and
  false ones gain nothing by it.

Neither velocity nor position of the navigator is used here.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from skyproof.app.common.platform import Platform
from skyproof.app.common.platform_tables import PlatformImu, PlatformReceiver
from skyproof.arrays import Instants, Reals
from skyproof.errors import SettingsError
from skyproof.formats.attitude import AttitudeFile, read_attitude
from skyproof.formats.byte_io import compute_sha256
from skyproof.formats.imu import ImuFile, imu_from_rows, read_imu
from skyproof.formats.imu_pieces import StoredImuFile, store_readings
from skyproof.formats.pieces import Workspace
from skyproof.formats.timed_rows import TimedRows
from skyproof.fusion.corrected import CorrectedNavigator
from skyproof.fusion.policy import POLICY
from skyproof.gnss.frames import attitude_ecef, ecef_from_geodetic
from skyproof.gnss.imu_grades import ImuGrade
from skyproof.gnss.time import format_iso, timedelta_from_s
from skyproof.logs.content import InertialRows
from skyproof.navigation.attitude import (
    bound_direction_error_rad,
    estimate_interpolation_sigma_rad,
    set_place,
    state_from_angles,
)
from skyproof.navigation.inertia import TURN_MOST_RAD, FreeRun, begin_free_run, coast, measure_apparent_tilt_rad
from skyproof.navigation.inertial_predictor import Inertial
from skyproof.records import Attitude, ImuSeries, InertialReadings, NavState, Records
from skyproof.remarks import Remark, RemarkKind

__all__ = [
    "Body",
    "BodyFiles",
    "Carried",
    "KnownPlace",
    "body_of",
    "body_states",
    "open_body",
    "with_imu",
    "with_logged_imu",
]

_PIECE_S: Final = 10.0  # of readings that are integrated at once
_EQUATOR: Final = ecef_from_geodetic(0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class BodyFiles:
    """The files that a platform names for its body.

    initial : the attitude at the first inertial reading. sums : SHA-256 of each file as it was read, by its name.
    """

    imu: ImuFile | StoredImuFile | None = None
    attitude: AttitudeFile | None = None
    initial: Attitude | None = None
    sums: Mapping[str, str] = field(default_factory=dict)

    def remarks(
        self, body: "Body | None", run: Records, readings: InertialReadings | None = None
    ) -> Iterator[tuple[str, str, tuple[str, ...]]]:
        """Name, kind and remarks of each file, once its part in a run is known. readings : in GPS time."""
        stated = None if body is None else body.stated
        if readings is None and body is not None:
            readings = body.readings
        if self.imu is not None:
            words = _remark_on_coverage(readings, run) or (_UNALIGNED if self.initial is None else ())
            yield self.imu.source, "inertial readings", self.imu.remarks + words
        if self.attitude is not None:
            yield self.attitude.source, "attitude", self.attitude.remarks + _remark_on_coverage(stated, run)


_UNALIGNED: Final = (
    "the attitude at the first reading is not stated: it is found from the motion; for directions before that give "
    "initial in [imu] of a platform file",
)


def with_stored_readings(files: BodyFiles, workspace: Workspace) -> BodyFiles:
    """Return the files with the values of many inertial readings on a disk, read back by window."""
    return replace(files, imu=store_readings(files.imu, workspace)) if isinstance(files.imu, ImuFile) else files


def _remark_on_coverage(series: InertialReadings | Attitude | None, run: Records) -> tuple[str, ...]:
    """Report the part of a run that a series leaves out. A run whose signals gave no time has a remark elsewhere."""
    if series is None or series.gpst.size == 1 or np.isnat(run.start_gpst):  # one alone holds at all times
        return ()
    span = f"it covers {format_iso(series.gpst[0], 1)} to {format_iso(series.gpst[-1], 1)}, the signals of "
    span += f"{format_iso(run.start_gpst, 1)} to {format_iso(run.end_gpst, 1)}"
    if series.gpst[0] > run.end_gpst or series.gpst[-1] < run.start_gpst:
        return (Remark(f"not used: {span}; check start_gpst", RemarkKind.BEARS),)
    missing = max(series.gpst[0] - run.start_gpst, run.end_gpst - series.gpst[-1])
    if missing > timedelta_from_s(POLICY.readings_missing_s):
        partly = f"not there all the time: {span}; what needs it cannot run for the rest"
        return (Remark(partly, RemarkKind.BEARS),)
    return ()


def with_imu(platform: Platform, imu: str | Path | None) -> Platform:
    """Replace a platform's file of inertial readings, if another one is given."""
    if imu is None:
        return platform
    unit = PlatformImu(file=Path(imu)) if platform.imu is None else platform.imu.model_copy(update={"file": Path(imu)})
    return platform.model_copy(update={"imu": unit})


def with_logged_imu(
    platform: Platform, files: BodyFiles, path: str, rows: InertialRows | None, where: str
) -> tuple[Platform, BodyFiles]:
    """Return a platform and its files with the readings that stand in the log of its first receiver.

    A file of readings comes before them. What else the platform file says of the unit holds for them. where : begins a
    message on that.

    Raises
    ------
    InputError : the readings are none of a unit.
    SettingsError : as of `open_body`, or there are no readings for a unit that is described.
    """
    unit = platform.imu
    if unit is not None and unit.file is not None:
        return platform, files
    if rows is None:
        if unit is not None:
            raise SettingsError(
                f"{where}: imu.file is missing, and {path} holds no inertial readings; give the file of the readings, "
                "or a flight log that holds them as the first input"
            )
        return platform, files
    rising = np.append(True, np.diff(np.maximum.accumulate(rows.gpst)) > np.timedelta64(0, "ns"))
    table = TimedRows(
        source=path,
        time_ns=rows.gpst[rising].astype(np.int64),
        dated=True,
        values=np.hstack([rows.specific_force_m_s2, rows.angular_rate_rad_s])[rising],
        where=lambda row: f"{path}: inertial reading {row + 1}",
    )
    imu = imu_from_rows(table, rot_body_unit=None if unit is None else unit.rotation)
    initial = None if unit is None else _read_initial(unit, imu, where)
    sums = {**files.sums, path: compute_sha256(path)}
    return with_imu(platform, path), replace(files, imu=imu, initial=initial, sums=sums)


def open_body(platform: Platform, where: str = "the platform file") -> BodyFiles:
    """Read and check the files of the body before any signal is processed.

    Raises
    ------
    InputError : a file that cannot be read as what it should be.
    SettingsError : gravity in the accelerometers is far from the vertical by the attitude stated.
    """
    stated, unit = platform.attitude, platform.imu
    attitude = None if stated is None or stated.file is None else read_attitude(stated.file)
    files = [path for path in (None if unit is None else unit.file, None if stated is None else stated.file) if path]
    sums = {str(path): compute_sha256(path) for path in files}
    if unit is None or unit.file is None:
        return BodyFiles(attitude=attitude, sums=sums)
    imu = read_imu(unit.file, rot_body_unit=unit.rotation)
    return BodyFiles(imu=imu, attitude=attitude, initial=_read_initial(unit, imu, where), sums=sums)


def _read_initial(unit: PlatformImu, imu: ImuFile, where: str) -> Attitude | None:
    """Return the attitude stated at the first reading. Raises SettingsError if gravity says otherwise."""
    if unit.initial is None:
        return None
    turn = unit.initial
    initial = _make_attitude(turn.heading_deg, turn.pitch_deg, turn.roll_deg, turn.sigma_deg)
    _require_upright(imu, initial, where)
    return initial


def _make_attitude(heading_deg: float, pitch_deg: float, roll_deg: float, sigma_deg: float) -> Attitude:
    return Attitude(
        gpst=np.array([np.datetime64(0, "ns")]),
        angles_rad=np.radians([[heading_deg, pitch_deg, roll_deg]]),
        sigma_rad=float(np.radians(sigma_deg)),
    )


def _require_upright(imu: ImuFile, initial: Attitude, where: str) -> None:
    readings = imu.series(np.datetime64(0, "ns"))
    first = max(round(POLICY.levelled_s / imu.interval_s), 1)
    state = _start_at_rest(readings, initial, _EQUATOR)
    tilt_rad = measure_apparent_tilt_rad(state, readings.specific_force_m_s2[:first])
    if tilt_rad > POLICY.most_tilt_rad:
        raise SettingsError(
            f"{where}: gravity in the accelerometers of {imu.source} is {np.degrees(tilt_rad):.0f} degrees from the "
            "vertical by the attitude stated at the first reading; correct axes or initial in [imu]"
        )


def _start_at_rest(readings: InertialReadings, initial: Attitude, place_ecef_m: Reals) -> NavState:
    """Build the navigation state at the first reading: at rest, with the stated attitude."""
    return NavState(
        gpst=readings.gpst[:1],
        position_ecef_m=place_ecef_m[None],
        velocity_ecef_m_s=np.zeros((1, 3)),
        attitude=attitude_ecef(place_ecef_m[None], *initial.angles_rad.T),
        covariance=np.diag(np.repeat([0.0, 0.0, initial.sigma_rad**2], 3))[None],
    )


class KnownPlace(NamedTuple):
    """Where an antenna stands by the platform file: ecef_m (3,), covariance_m2 (3, 3)."""

    ecef_m: Reals
    covariance_m2: Reals


@dataclass(frozen=True, eq=False, kw_only=True)
class Body:
    """What is known of the body in GPS time.

    stated : its attitude, with the error of interpolation. readings, initial, grade : of the inertial unit.
    places : of each receiver's first antenna; empty where none is surveyed, or the body moves. antennas_m : (3,) of
    each receiver's first antenna in the body; empty unless it is stated of all. antennas_sigma_m : of each axis.
    """

    stated: Attitude | None = None
    readings: InertialReadings | None = None
    initial: Attitude | None = None
    grade: ImuGrade | None = None
    places: Mapping[str, KnownPlace] = field(default_factory=dict)
    antennas_m: Mapping[str, Reals] = field(default_factory=dict)
    antennas_sigma_m: float = 0.0


def body_of(
    platform: Platform,
    files: BodyFiles,
    names: Sequence[str],
    tables: Mapping[str, PlatformReceiver],
    zero_gpst: np.datetime64,
    apart_m: float,
) -> Body | None:
    """Return the body of a run; None if nothing is known of its attitude.

    tables : see `described`. zero_gpst : the recording's start, from which files without GPS time count unless the
    platform says otherwise. apart_m : the antennas of two receivers stand at most this far apart.
    """
    stated, unit = platform.attitude, platform.imu
    attitude, readings = None, None
    if files.attitude is not None and stated is not None:
        attitude = files.attitude.attitude(zero_gpst, float(np.radians(stated.sigma_deg)))
        sigma_rad = float(np.hypot(attitude.sigma_rad, estimate_interpolation_sigma_rad(attitude)))
        attitude = replace(attitude, sigma_rad=sigma_rad)
    elif stated is not None and stated.heading_deg is not None and platform.motion != "moving":
        attitude = _make_attitude(stated.heading_deg, stated.pitch_deg, stated.roll_deg, stated.sigma_deg)
    if files.imu is not None and unit is not None:
        readings = files.imu.series(zero_gpst if unit.start_gpst is None else unit.start_gpst)
    if attitude is None and readings is None:
        return None
    mounted = {name: tables[name] for name in names if name in tables and tables[name].body_m is not None}
    whole = len(mounted) == len(names) > 1
    return Body(
        stated=attitude,
        antennas_m={name: table.antennas_body_m[0] for name, table in mounted.items()} if whole else {},
        antennas_sigma_m=max((table.body_sigma_m for table in mounted.values()), default=0.0),
        readings=readings,
        initial=files.initial,
        grade=None if unit is None else unit.errors,
        places={} if platform.motion == "moving" else _collect_places(names, tables, apart_m),
    )


def _collect_places(
    names: Sequence[str], tables: Mapping[str, PlatformReceiver], apart_m: float
) -> dict[str, KnownPlace]:
    """Collect where each receiver's first antenna stands."""
    surveyed = {name: place for name in names if name in tables and (place := tables[name].position) is not None}
    if not surveyed:
        return {}
    first = next(iter(surveyed.values()))
    return {
        name: KnownPlace(survey.ecef_m, survey.sigma_m**2 * np.eye(3))
        if (survey := surveyed.get(name)) is not None
        else KnownPlace(first.ecef_m, (first.sigma_m**2 + apart_m**2) * np.eye(3))
        for name in names
    }


class Carried(NamedTuple):
    """What is carried from window to window.

    run : of the gyros alone, None once it has ended. begun_ecef_m : where that began. navigator : that fixes corrected
    last. ahead : the same at the start of the last window.
    """

    run: FreeRun | None = None
    begun_ecef_m: Reals | None = None
    navigator: Inertial | None = None
    ahead: Inertial | None = None


def body_states(
    body: Body, records: Records, carried: Carried, navigators: Mapping[str, CorrectedNavigator] | None = None
) -> tuple[dict[str, NavState], Carried]:
    """Compute the body's state at each receiver over a window, and what the next window needs.

    The states share the attitude; the position is that of the receiver's own antenna. navigators : of receivers, as
    windows before this one corrected them.
    """
    set_places_ecef_m = [each_set.position_ecef_m for each_set in records.sets]
    path, carried = _follow_navigator(navigators or {}, records, carried)
    if path is not None:
        level = path.position_ecef_m[path.gpst.size // 2]
    else:
        path, carried = _propagate_attitude(
            body, records, carried, [place.ecef_m for place in body.places.values()] or set_places_ecef_m
        )
        level = carried.begun_ecef_m
    received = (*(o.receiver for o in records.observations), *(each_set.receiver for each_set in records.sets))
    states = {}
    for name in dict.fromkeys((*body.places, *received)):
        state = _state_at_place(body, records, path, level, body.places.get(name), set_places_ecef_m)
        if state is not None:
            states[name] = state
    return states, carried


def _state_at_place(
    body: Body,
    records: Records,
    path: NavState | None,
    level: Reals | None,
    known: KnownPlace | None,
    shown: list[Reals],
) -> NavState | None:
    """Place the body's attitude at a known place, or at one that the received signals give.

    path : of the inertial unit. level : where its attitude refers to north and the vertical.
    """
    places = shown if known is None else [known.ecef_m]
    if not places:
        return None
    place = places[0]
    if path is None and body.stated is not None:
        path, level = state_from_angles(body.stated, records.start_gpst, records.end_gpst, place), place
    if path is None or level is None:
        return None
    off_rad = max(bound_direction_error_rad(level, place, other) for other in places)
    state = set_place(path, place, None if known is None else known.covariance_m2, off_rad)
    largest = 0.0 if state.covariance is None else float(np.linalg.eigvalsh(state.covariance[:, 6:, 6:]).max())
    return state if largest < TURN_MOST_RAD**2 else None


def _follow_navigator(
    navigators: Mapping[str, CorrectedNavigator], records: Records, carried: Carried
) -> tuple[NavState | None, Carried]:
    """Propagate the navigator of the first receiver that has an aligned one over a window; None without any."""
    aligned = (each.predictor for each in navigators.values() if each.predictor.state is not None)
    navigator = next(aligned, None)
    if navigator is None:
        return None, carried
    begun = carried.ahead if carried.ahead is not None and navigator is carried.navigator else navigator
    ahead = begun.until(records.start_gpst)
    # Up to the first reading after the end.
    path = ahead.states_until(records.end_gpst + timedelta_from_s(navigator.readings.interval_s))
    if path is not None and path.gpst[-1] <= records.start_gpst:
        path = None
    return path, carried._replace(navigator=navigator, ahead=ahead)


def _propagate_attitude(
    body: Body, records: Records, carried: Carried, places: list[Reals]
) -> tuple[NavState | None, Carried]:
    """Propagate the inertial unit over a window; only its attitude is used."""
    readings, grade = body.readings, body.grade
    if readings is None or body.initial is None or grade is None or readings.gpst[0] >= records.end_gpst:
        return None, carried
    run, begun = carried.run, carried.begun_ecef_m
    if begun is None:
        if not places:
            return None, carried
        run, begun = begin_free_run(_start_at_rest(readings, body.initial, places[0]), grade), places[0]
    paths = list[NavState]()
    last_gpst = min(records.end_gpst, readings.gpst[-1])
    while run is not None and run.state.gpst[0] < last_gpst:
        end_gpst = min(run.state.gpst[0] + timedelta_from_s(_PIECE_S), last_gpst)
        at_rest = replace(run.state, position_ecef_m=begun[None], velocity_ecef_m_s=np.zeros((1, 3)))
        path, run = coast(
            replace(run, state=at_rest),
            _select_readings(readings, run.state.gpst[0], end_gpst),
            grade,
            tilt_most_rad=np.inf,
            turn_most_rad=TURN_MOST_RAD,
        )
        if path.gpst[-1] > records.start_gpst:
            paths.append(path)
        if run is not None and run.state.gpst[0] < end_gpst:  # the rest is shorter than an interval
            break
    return (_join_paths(paths, records.start_gpst) if paths else None), carried._replace(run=run, begun_ecef_m=begun)


def _select_readings(readings: InertialReadings, start_gpst: np.datetime64, end_gpst: np.datetime64) -> ImuSeries:
    """Select the readings later than an instant, up to the first at or after the other."""
    first = int(np.searchsorted(readings.gpst, start_gpst, side="right"))
    stop = int(np.searchsorted(readings.gpst, end_gpst)) + 1
    return readings.select(slice(first, stop))


def _join_paths(paths: list[NavState], start_gpst: np.datetime64) -> NavState:
    """Join consecutive pieces of a path, from the last state at or before an instant.

    Each piece begins with the end of the one before.
    """
    gpst: Instants = np.concatenate([paths[0].gpst[:1], *(path.gpst[1:] for path in paths)])
    kept = slice(max(int(np.searchsorted(gpst, start_gpst, side="right")) - 1, 0), None)

    def whole(name: str) -> Reals:
        parts = [getattr(path, name) for path in paths]
        return np.asarray(np.concatenate([parts[0][:1], *(part[1:] for part in parts)])[kept])

    return NavState(
        gpst=gpst[kept],
        position_ecef_m=whole("position_ecef_m"),
        velocity_ecef_m_s=whole("velocity_ecef_m_s"),
        attitude=whole("attitude"),
        covariance=whole("covariance"),
    )
