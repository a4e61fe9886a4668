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

__all__ = ["derive_settings", "match_tables", "select_inputs"]


def select_inputs(
    platform: Platform, given: Sequence[str | Path], where: str = "the platform file"
) -> tuple[list[Path | tuple[Path, ...]], list[str | None]]:
    """Return the inputs of a run as `open_inputs` takes them, and the receiver's name of each.

    given : the inputs of the command line; with any, the platform may not name others. They are the antennas of the
        only receiver if that has as many; one that has the name of a receiver with several has them in its channels.
    where : the platform file, to begin messages.

    Raises
    ------
    SettingsError : inputs in both places, or a receiver without any.
    """
    tables = platform.receivers
    if given:
        double = [number for number, table in enumerate(tables) if table.inputs]
        if double:
            raise SettingsError(
                f"{where}: receivers[{double[0]}] has inputs, and the command line as well: which receiver is which is "
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


def match_tables(
    platform: Platform, names: Sequence[str], where: str = "the platform file"
) -> dict[str, PlatformReceiver]:
    """Return the table of each receiver that has one, by its name in this run.

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


def derive_settings(
    platform: Platform, settings: Settings, names: Sequence[str], tables: Mapping[str, PlatformReceiver]
) -> tuple[Settings, tuple[str, ...]]:
    """Add to the settings what follows from the platform, and remark on what is not used.

    settings : the run's options and the platform's table [protect], which come first.
    names : of the run's receivers. tables : see `match_tables`.
    """
    use = _bound_speed(platform) if settings.speed_max_m_s is None else _Use()
    if platform.oscillator is not None and settings.oscillator is None:
        use = use + _Use({"oscillator": platform.oscillator}, frozenset({"oscillator"}))
    remarks = []
    stated = next((key for key in ("antennas_enu_m", "antenna_distance_m") if getattr(settings, key) is not None), None)
    if len(names) > 1 and len(tables) == len(names):
        places = _place_antennas(platform, {name: tables[name] for name in names})
        if stated is None:
            use = use + places
        elif places.keys:
            first = f"{stated} is a setting of this run, and comes before {', '.join(sorted(places.keys))}"
            remarks.append(Remark(first, RemarkKind.BEARS))
            use = use + _Use(keys=places.keys)
    use = use + _Use(keys=_list_body_keys(platform) | _list_predictor_keys(platform))
    unused = [key for key in _list_keys(platform) if key not in use.keys]
    if unused:
        remarks.append(Remark(f"{', '.join(unused)}: read, used by no method of this run", RemarkKind.BEARS))
    return resolve_settings(settings, **use.settings), tuple(remarks)


def _list_keys(platform: Platform) -> list[str]:
    """List the keys of the file that describe the platform; `platform_antennas` uses others."""
    top = [key for key in ("motion", "speed_max_m_s", "oscillator", "attitude", "imu") if getattr(platform, key)]
    return top + [
        f"receivers[{number}].{key}"
        for number, table in enumerate(platform.receivers)
        for key in ("position", "body_m", *(() if is_array(table) and table.antennas_m else ("line_bias_cyc",)))
        if getattr(table, key) is not None
    ]


def _list_body_keys(platform: Platform) -> frozenset[str]:
    """List the keys that `body` uses for its state, where there are arrays to test against it."""
    if not any(is_array(table) and table.antennas_m for table in platform.receivers):
        return frozenset()
    placed = next((k for k, table in enumerate(platform.receivers) if table.position is not None), None)
    place = () if placed is None or platform.motion == "moving" else (f"receivers[{placed}].position", "motion")
    return frozenset({"attitude", "imu", *place})


def _list_predictor_keys(platform: Platform) -> frozenset[str]:
    """List the keys by which `predictors` chooses between skies: surveyed positions, inertia."""
    tables = platform.receivers
    if platform.motion == "moving":
        return frozenset({"imu"})
    moves = platform.motion is None and not (tables and all(table.position for table in tables))
    places = {f"receivers[{k}].position" for k, table in enumerate(tables) if table.position}
    return frozenset(places | ({"imu"} if moves else set()))


def _bound_speed(platform: Platform) -> _Use:
    """Bound an antenna's speed by the platform's and that of the arm that turns it."""
    bound_m_s = 0.0 if platform.motion == "static" else platform.speed_max_m_s
    if bound_m_s is None:
        return _Use()
    arms_m_s = [2.0 * pi * r.spin.radius_m * abs(r.spin.rate_hz) for r in platform.receivers if r.spin is not None]
    return _Use({"speed_max_m_s": bound_m_s + max(arms_m_s, default=0.0)}, frozenset({"motion", "speed_max_m_s"}))


def _place_antennas(platform: Platform, tables: Mapping[str, PlatformReceiver]) -> _Use:
    """Place the antennas relative to each other.

    By survey, else in the body with its attitude, else by the distance of two. Where the body turns, each window has
    its attitude, which turns the places (`Body.antennas_m`).
    """
    numbers = [platform.receivers.index(table) for table in tables.values()]
    positions = frozenset(f"receivers[{number}].position" for number in numbers)
    bodies = frozenset(f"receivers[{number}].body_m" for number in numbers)
    surveyed = [table.position for table in tables.values() if table.position is not None]
    placed = [table for table in tables.values() if table.body_m is not None]
    if len(surveyed) == len(tables):  # the model has held body_m against them
        return _Use(_place_by_survey(list(tables), surveyed), positions | bodies)
    if len(placed) < len(tables):
        return _Use()
    body_m = np.array([table.antennas_body_m[0] for table in placed])
    sigma_m = max(table.body_sigma_m for table in placed)
    if (rot := _build_fixed_rotation(platform)) is not None and platform.attitude is not None:
        arm_m = max(dist(antenna_m, body_m[0]) for antenna_m in body_m)
        sigma_m = hypot(sigma_m, arm_m * radians(platform.attitude.sigma_deg))
        enu_m = (body_m - body_m[0]) @ (ROT_ENU_NED @ rot).T
        return _Use(_antennas(list(tables), enu_m, sigma_m), bodies | {"attitude"})
    turns = platform.imu is not None or (platform.attitude is not None and platform.attitude.file is not None)
    used = bodies | {"imu", "attitude"} if turns else bodies
    if len(placed) == 2 and (distance_m := dist(*body_m)) > 0.0:
        known = {"antenna_distance_m": distance_m, "antenna_distance_sigma_m": hypot(sigma_m, sigma_m)}
        return _Use(known, used)
    return _Use(keys=used) if turns else _Use()


def _place_by_survey(names: Sequence[str], positions: Sequence[Surveyed]) -> dict[str, Any]:
    origin = positions[0]
    rot = rot_enu_ecef(radians(origin.lat_deg), radians(origin.lon_deg))
    enu_m = np.array([rot @ (place.ecef_m - origin.ecef_m) for place in positions])
    return _antennas(names, enu_m, max(place.sigma_m for place in positions))


def _antennas(names: Sequence[str], enu_m: Reals, sigma_m: float) -> dict[str, Any]:
    places = {name: tuple(map(float, one_m)) for name, one_m in zip(names, enu_m, strict=True)}
    return {"antennas_enu_m": places, "antennas_sigma_m": sigma_m}


def _build_fixed_rotation(platform: Platform) -> Reals | None:
    """Return the rotation (3, 3) from body to north, east, down where the attitude is fixed angles."""
    stated = platform.attitude
    if stated is None or stated.heading_deg is None or platform.motion == "moving":
        return None
    return rot_ned_body(*map(radians, (stated.heading_deg, stated.pitch_deg, stated.roll_deg)))
