"""What a run knows of each receiver that says which of two skies is true: from its settings and the platform file."""

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

__all__ = ["InertialUnit", "antenna_units", "predictors_of", "surveyed_positions", "unit_of"]


@dataclass(frozen=True, eq=False, kw_only=True)
class InertialUnit:
    """A run's inertial unit. settings : but for oscillator and lever arm. levers_m : (3,) to the antenna of each
    receiver of which it is known. initial : the attitude at the first reading, if stated."""

    readings: InertialReadings
    settings: InsSettings
    levers_m: Mapping[str, Reals]
    initial: Attitude | None


def unit_of(
    platform: Platform,
    files: BodyFiles,
    names: Sequence[str],
    tables: Mapping[str, PlatformReceiver],
    zero_gpst: np.datetime64,
) -> InertialUnit | None:
    """The inertial unit of a run, if it has one. zero_gpst : as of `body_of`; tables : see `described`.

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


def antenna_units(unit: InertialUnit | None) -> dict[str, AntennaUnit]:
    """By receiver, where attitude and lever arm are stated: what carries vector tracking from row to row."""
    if unit is None or unit.initial is None:
        return {}
    return {
        name: AntennaUnit(unit.readings, unit.initial, replace(unit.settings, lever_m=lever_m))
        for name, lever_m in unit.levers_m.items()
    }


def predictors_of(
    names: Sequence[str],
    settings: Settings,
    platform: Platform | None = None,
    tables: Mapping[str, PlatformReceiver] | None = None,
    unit: InertialUnit | None = None,
) -> dict[str, Predictor]:
    """By receiver; none of one of which neither place nor motion nor clock is known. tables : see `described`."""
    found = {}
    for name in names:
        moving = platform is not None and platform.motion == "moving"
        table = None if tables is None or moving else tables.get(name)
        one = _predictor(name, settings, None if table is None else table.position, unit)
        if one is not None:
            found[name] = one
    return found


def surveyed_positions(predictors: Mapping[str, Predictor]) -> dict[str, Reals]:
    """List the receivers that stand where they were surveyed, (3,) ECEF."""
    return {
        name: one.known.mean[:3]
        for name, one in predictors.items()
        if isinstance(one, Standing) and one.surveyed and one.known is not None
    }


def _predictor(name: str, settings: Settings, place: Surveyed | None, unit: InertialUnit | None) -> Predictor | None:
    """Of a receiver that stands its place says more than an inertial unit does."""
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
