"""Build each receiver's predictor from settings and platform file, to choose between two skies."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from skyproof.app.common.body import BodyFiles
from skyproof.app.common.platform import Platform
from skyproof.app.common.platform_tables import PlatformReceiver, Surveyed
from skyproof.app.common.settings import Settings
from skyproof.arrays import Reals
from skyproof.gnss.oscillators import OSCILLATORS, PLATFORM_CLASSES
from skyproof.navigation.inertial_predictor import Inertial
from skyproof.navigation.ins import InsSettings
from skyproof.navigation.predictor import Predictor, Standing, place_surveyed
from skyproof.navigation.vector_inertia import AntennaUnit
from skyproof.records import Attitude, InertialReadings

__all__ = ["InertialUnit", "build_antenna_units", "build_predictors", "build_unit", "list_surveyed"]


@dataclass(frozen=True, eq=False, kw_only=True)
class InertialUnit:
    """A run's inertial unit. settings : but for oscillator and lever arm. levers_m : (3,) to the antenna of each
    receiver with a known one. initial : the attitude at the first reading, if stated."""

    readings: InertialReadings
    settings: InsSettings
    levers_m: Mapping[str, Reals]
    initial: Attitude | None


def build_unit(
    platform: Platform,
    files: BodyFiles,
    names: Sequence[str],
    tables: Mapping[str, PlatformReceiver],
    zero_gpst: np.datetime64,
) -> InertialUnit | None:
    """Build the inertial unit of a run, if it has one.

    zero_gpst : as of `body_of`; tables : see `match_tables`.

    The lever arm is stated to the first receiver's antenna; to another one it is known where both have a place in the
    body.
    """
    unit = platform.imu
    if unit is None or files.imu is None or np.isnat(zero_gpst):
        return None
    arm_m = np.array(unit.lever_arm_m)
    first = tables.get(names[0])
    levers_m = {names[0]: arm_m}
    for name in names[1:]:
        table = tables.get(name)
        if first is not None and table is not None and first.body_m is not None and table.body_m is not None:
            levers_m[name] = arm_m + table.antennas_body_m[0] - first.antennas_body_m[0]
    return InertialUnit(
        readings=files.imu.series(zero_gpst if unit.start_gpst is None else unit.start_gpst),
        settings=InsSettings(grade=unit.errors, oscillator=OSCILLATORS["tcxo"]),
        levers_m=levers_m,
        initial=files.initial,
    )


def build_antenna_units(unit: InertialUnit | None) -> dict[str, AntennaUnit]:
    """Return by receiver the unit that predicts vector tracking, where attitude and lever arm are stated."""
    if unit is None or unit.initial is None:
        return {}
    return {
        name: AntennaUnit(unit.readings, unit.initial, replace(unit.settings, lever_m=lever_m))
        for name, lever_m in unit.levers_m.items()
    }


def build_predictors(
    names: Sequence[str],
    settings: Settings,
    platform: Platform | None = None,
    tables: Mapping[str, PlatformReceiver] | None = None,
    unit: InertialUnit | None = None,
) -> dict[str, Predictor]:
    """Build a predictor for each receiver whose place, motion or clock is known. // tables : see `match_tables`."""
    found = {}
    for name in names:
        moving = platform is not None and platform.motion == "moving"
        table = None if tables is None or moving else tables.get(name)
        predictor = _build_predictor(name, settings, None if table is None else table.position, unit)
        if predictor is not None:
            found[name] = predictor
    return found


def list_surveyed(predictors: Mapping[str, Predictor]) -> dict[str, Reals]:
    """List the receivers that stand where they were surveyed, (3,) ECEF."""
    return {
        name: predictor.known.mean[:3]
        for name, predictor in predictors.items()
        if isinstance(predictor, Standing) and predictor.surveyed and predictor.known is not None
    }


def _build_predictor(
    name: str, settings: Settings, place: Surveyed | None, unit: InertialUnit | None
) -> Predictor | None:
    """Build one receiver's predictor; a known place says more than an inertial unit."""
    by, assumes = [], []
    if place is not None:
        by, assumes = ["surveyed_place"], ["stands_where_surveyed"]
    elif settings.speed_max_m_s == 0.0:
        by, assumes = ["standing"], ["receiver_stands"]
    elif unit is not None and name in unit.levers_m:
        by, assumes = ["inertial_unit"], ["inertial_as_stated"]
    stands, moves = place is not None or settings.speed_max_m_s == 0.0, bool(by)
    oscillator = None if settings.oscillator is None else OSCILLATORS[PLATFORM_CLASSES[settings.oscillator]]
    if oscillator is not None:
        by.append("clock")
        assumes.append(f"oscillator_{settings.oscillator}")
    if not by:
        return None
    if moves and not stands and unit is not None:
        return Inertial(
            readings=unit.readings,
            settings=replace(
                unit.settings, lever_m=unit.levers_m[name], oscillator=oscillator or unit.settings.oscillator
            ),
            initial=unit.initial,
            clock=oscillator is not None,
            by=tuple(by),
            assumes=tuple(assumes),
        )
    standing = Standing(stands=stands, oscillator=oscillator, by=tuple(by), assumes=tuple(assumes))
    return standing if place is None else place_surveyed(standing, place.ecef_m, place.sigma_m**2 * np.eye(3))
