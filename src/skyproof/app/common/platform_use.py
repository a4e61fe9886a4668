"""What a platform file gives a run: its inputs, the names of its receivers, and settings that follow from it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import dist, hypot, pi, radians
from pathlib import Path
from typing import Any

import numpy as np

from skyproof.app.common.platform import Platform
from skyproof.app.common.platform_antennas import is_array
from skyproof.app.common.platform_tables import PlatformReceiver, Surveyed
from skyproof.app.common.settings import Settings, resolve_settings
from skyproof.arrays import Reals
from skyproof.errors import SettingsError
from skyproof.gnss.frames import ROT_ENU_NED, rot_enu_ecef, rot_ned_body
from skyproof.remarks import Remark, RemarkKind

__all__ = ["described", "inputs_of", "settings_of"]


def inputs_of(
    platform: Platform, given: Sequence[str | Path], where: str = "the platform file"
) -> tuple[list[Path | tuple[Path, ...]], list[str | None]]:
    """The inputs of a run as `open_inputs` takes them, and the name of the receiver of each where it has one.

    given : the inputs of the command line; with any, the platform may not name others. They are the antennas of the
        only receiver if that has as many; one that has the name of a receiver with several has them in its channels.
    where : the platform file, to begin messages.

    Raises
    ------
    SettingsError : inputs in both places, or a receiver without any.
    """
    tables = platform.receivers
    if given:
        both = [number for number, table in enumerate(tables) if table.inputs]
        if both:
            raise SettingsError(
                f"{where}: receivers[{both[0]}] has inputs, and the command line as well: which receiver is which is "
                "then not known; give all inputs in one of the two places"
            )
        paths = tuple(Path(path) for path in given)
        if len(tables) == 1 and is_array(tables[0]) and len(paths) in (1, len(tables[0].antennas_m or ())):
            return [paths], [tables[0].name]
        arrays = {table.name for table in tables if is_array(table)}
        return [(path,) if path.stem in arrays else path for path in paths], [None] * len(paths)
    without = [number for number, table in enumerate(tables) if not table.inputs]
    if without:
        raise SettingsError(
            f"{where}: receivers[{without[0]}] has no inputs; give it some, or all inputs on the command line"
        )
    return [table.inputs for table in tables], [table.name for table in tables]


def described(
    platform: Platform, names: Sequence[str], where: str = "the platform file"
) -> dict[str, PlatformReceiver]:
    """The table of each receiver, by the name that it has in this run; none where there is no table.

    A receiver with inputs is the one opened in its turn, another one the one of its name, or the only one.

    Raises
    ------
    SettingsError : a table of no receiver.
    """
    tables = platform.receivers
    if any(table.inputs for table in tables):
        return dict(zip(names, tables, strict=True))
    if len(tables) == len(names) == 1:
        return {names[0]: tables[0]}
    for number, table in enumerate(tables):
        if table.name not in names:
            raise SettingsError(
                f"{where}: receivers[{number}] is {table.name or 'without name and inputs'}, but the receivers are "
                f"{', '.join(names)}; give it the name of one of them"
            )
    return {str(table.name): table for table in tables}


@dataclass(frozen=True)
class _Use:
    """Settings that follow from a platform, and the keys that they follow from."""

    settings: Mapping[str, Any] = field(default_factory=dict)
    keys: frozenset[str] = frozenset()

    def __add__(self, other: "_Use") -> "_Use":
        return _Use({**self.settings, **other.settings}, self.keys | other.keys)


def settings_of(
    platform: Platform, settings: Settings, names: Sequence[str], tables: Mapping[str, PlatformReceiver]
) -> tuple[Settings, tuple[str, ...]]:
    """The settings with all that follows from the platform, and remarks on what of it is not used.

    settings : the run's options and the platform's table [protect], which come first.
    names : of the run's receivers. tables : see `described`.
    """
    use = _speed(platform) if settings.speed_max_m_s is None else _Use()
    if platform.oscillator is not None and settings.oscillator is None:
        use = use + _Use({"oscillator": platform.oscillator}, frozenset({"oscillator"}))
    remarks = []
    stated = next((key for key in ("antennas_enu_m", "antenna_distance_m") if getattr(settings, key) is not None), None)
    if len(names) > 1 and len(tables) == len(names):
        places = _geometry(platform, {name: tables[name] for name in names})
        if stated is None:
            use = use + places
        elif places.keys:
            first = f"{stated} is a setting of this run, and comes before {', '.join(sorted(places.keys))}"
            remarks.append(Remark(first, RemarkKind.BEARS))
            use = use + _Use(keys=places.keys)
    use = use + _Use(keys=_of_body(platform) | _expected(platform))
    unused = [key for key in _given(platform) if key not in use.keys]
    if unused:
        remarks.append(Remark(f"{', '.join(unused)}: read, used by no method of this run", RemarkKind.BEARS))
    return resolve_settings(settings, **use.settings), tuple(remarks)


def _given(platform: Platform) -> list[str]:
    """The keys that stand in the file and say something of the platform; `platform_antennas` uses others."""
    top = [key for key in ("motion", "speed_max_m_s", "oscillator", "attitude", "imu") if getattr(platform, key)]
    return top + [
        f"receivers[{number}].{key}"
        for number, table in enumerate(platform.receivers)
        for key in ("position", "body_m", *(() if is_array(table) and table.antennas_m else ("line_bias_cyc",)))
        if getattr(table, key) is not None
    ]


def _of_body(platform: Platform) -> frozenset[str]:
    """The keys that `body` makes the state of: arrays are held against it."""
    if not any(is_array(table) and table.antennas_m for table in platform.receivers):
        return frozenset()
    placed = next((k for k, table in enumerate(platform.receivers) if table.position is not None), None)
    place = () if placed is None or platform.motion == "moving" else (f"receivers[{placed}].position", "motion")
    return frozenset({"attitude", "imu", *place})


def _expected(platform: Platform) -> frozenset[str]:
    """The keys by which `predictors` chooses between skies: surveyed positions, and inertia of what may move."""
    tables = platform.receivers
    if platform.motion == "moving":
        return frozenset({"imu"})
    moves = platform.motion is None and not (tables and all(table.position for table in tables))
    places = {f"receivers[{k}].position" for k, table in enumerate(tables) if table.position}
    return frozenset(places | ({"imu"} if moves else set()))


def _speed(platform: Platform) -> _Use:
    """The bound of an antenna's speed: the platform's, and that of the arm that turns it."""
    bound_m_s = 0.0 if platform.motion == "static" else platform.speed_max_m_s
    if bound_m_s is None:
        return _Use()
    arms_m_s = [2.0 * pi * r.spin.radius_m * abs(r.spin.rate_hz) for r in platform.receivers if r.spin is not None]
    return _Use({"speed_max_m_s": bound_m_s + max(arms_m_s, default=0.0)}, frozenset({"motion", "speed_max_m_s"}))


def _geometry(platform: Platform, tables: Mapping[str, PlatformReceiver]) -> _Use:
    """Where the antennas stand relative to each other: as surveyed, else in the body as it is turned, else how far
    apart two are.
    """
    numbers = [platform.receivers.index(table) for table in tables.values()]
    positions = frozenset(f"receivers[{number}].position" for number in numbers)
    bodies = frozenset(f"receivers[{number}].body_m" for number in numbers)
    surveyed = [table.position for table in tables.values() if table.position is not None]
    placed = [table for table in tables.values() if table.body_m is not None]
    if len(surveyed) == len(tables):  # the model has held body_m against them
        return _Use(_surveyed(list(tables), surveyed), positions | bodies)
    if len(placed) < len(tables):
        return _Use()
    body_m = np.array([table.antennas_body_m[0] for table in placed])
    sigma_m = max(table.body_sigma_m for table in placed)
    if (rot := _turn(platform)) is not None and platform.attitude is not None:
        arm_m = max(dist(one, body_m[0]) for one in body_m)
        sigma_m = hypot(sigma_m, arm_m * radians(platform.attitude.sigma_deg))
        enu_m = (body_m - body_m[0]) @ (ROT_ENU_NED @ rot).T
        return _Use(_antennas(list(tables), enu_m, sigma_m), bodies | {"attitude"})
    if len(placed) == 2 and (distance_m := dist(*body_m)) > 0.0:
        known = {"antenna_distance_m": distance_m, "antenna_distance_sigma_m": hypot(sigma_m, sigma_m)}
        return _Use(known, bodies)
    return _Use()


def _surveyed(names: Sequence[str], positions: Sequence[Surveyed]) -> dict[str, Any]:
    origin = positions[0]
    rot = rot_enu_ecef(radians(origin.lat_deg), radians(origin.lon_deg))
    enu_m = np.array([rot @ (place.ecef_m - origin.ecef_m) for place in positions])
    return _antennas(names, enu_m, max(place.sigma_m for place in positions))


def _antennas(names: Sequence[str], enu_m: Reals, sigma_m: float) -> dict[str, Any]:
    places = {name: tuple(map(float, one_m)) for name, one_m in zip(names, enu_m, strict=True)}
    return {"antennas_enu_m": places, "antennas_sigma_m": sigma_m}


def _turn(platform: Platform) -> Reals | None:
    """(3, 3) from body to north, east, down where the attitude is angles; those of a body that moves do not stay."""
    stated = platform.attitude
    if stated is None or stated.heading_deg is None or platform.motion == "moving":
        return None
    return rot_ned_body(*map(radians, (stated.heading_deg, stated.pitch_deg, stated.roll_deg)))
