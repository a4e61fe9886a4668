"""What is stated of the platform and its receivers, made ready for what they received."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from skyproof.app.common.body import Body, BodyFiles, body_of
from skyproof.app.common.platform import Platform
from skyproof.app.common.platform_antennas import build_spin_arms
from skyproof.app.common.platform_tables import PlatformReceiver
from skyproof.app.common.settings import Settings
from skyproof.app.common.windows import widen_windows
from skyproof.app.protect.duplicates import leave_out_duplicates
from skyproof.app.protect.predictors import InertialUnit, build_predictors, build_unit
from skyproof.app.receive.reception import Reception
from skyproof.gnss.time import timedelta_from_s
from skyproof.navigation.predictor import Predictor
from skyproof.records import Records, SpinArm

__all__ = ["ReadyRun", "Stated", "find_span"]


@dataclass(frozen=True, eq=False, kw_only=True)
class ReadyRun:
    """What receivers received, with what carries them and is expected of them."""

    receptions: tuple[Reception, ...]
    settings: Settings
    spin_arms: Sequence[SpinArm]
    body: Body | None
    unit: InertialUnit | None
    predictors: Mapping[str, Predictor]


@dataclass(frozen=True, eq=False, kw_only=True)
class Stated:
    """What is stated: the platform and its files, and by name the table of each receiver."""

    platform: Platform
    files: BodyFiles
    names: Sequence[str]
    tables: Mapping[str, PlatformReceiver]

    def equip(self, receptions: Sequence[Reception], settings: Settings) -> ReadyRun:
        """Return what receivers received, of those with the same noise one, with what is stated for its time.

        Raises InputError where what is stated does not belong to it.
        """
        each = leave_out_duplicates(receptions, settings)
        settings = widen_windows(settings, [r.observations for r in each if r.observations is not None])
        start_gpst = find_span(each).start_gpst
        body = body_of(self.platform, self.files, self.names, self.tables, start_gpst, settings.max_separation_m)
        unit = build_unit(self.platform, self.files, self.names, self.tables, start_gpst)
        return ReadyRun(
            receptions=tuple(each),
            settings=settings,
            spin_arms=build_spin_arms(self.tables),
            body=body,
            unit=unit,
            predictors=build_predictors(self.names, settings, self.platform, self.tables, unit),
        )


def find_span(receptions: Sequence[Reception]) -> Records:
    """Return the time from the start of the first recording to the last epoch of any; NaT if nothing was received."""
    received = [r.observations for r in receptions if r.observations is not None and r.observations.gpst.size]
    if not received:
        return Records(start_gpst=np.datetime64("NaT", "ns"), end_gpst=np.datetime64("NaT", "ns"))
    starts = [o.gpst[0] - timedelta_from_s(float(o.elapsed_s[0])) for o in received]
    return Records(start_gpst=min(starts), end_gpst=max(o.gpst[-1] for o in received))
