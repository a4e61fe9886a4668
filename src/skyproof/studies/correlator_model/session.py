"""From a scene to the verdict of `protect`, behind drawn correlators."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from skyproof.app.common.body import body_of, open_body
from skyproof.app.common.platform import read_platform
from skyproof.app.common.platform_use import derive_settings, match_tables
from skyproof.app.common.progress import Silent
from skyproof.app.common.settings import Settings, resolve_settings
from skyproof.app.common.windows import asked, widen_windows
from skyproof.app.protect.document import document
from skyproof.app.protect.judging import judge
from skyproof.app.protect.outcome import Outcome
from skyproof.app.protect.predictors import build_antenna_units, build_predictors, build_unit
from skyproof.app.receive.measured import MeasurementLog, RowLog
from skyproof.app.receive.reception import Reception, observe
from skyproof.app.receive.tracker import Tracker, build_receiver_settings, set_up_guiding
from skyproof.formats.pieces import Workspace
from skyproof.gnss.signals import GPS_SATS
from skyproof.navigation.vector_inertia import AntennaUnit
from skyproof.receiver.tracking import MEASURE_FRAMES
from skyproof.records import NavigationData, Samples
from skyproof.simulator.received import Scene
from skyproof.studies.correlator_model.receiver import ModelReceiver
from skyproof.verdict import Verdict

__all__ = ["protect_scene", "receive_antenna", "track_scene"]


class _Undiagnosed(Tracker):
    """Many arcs do not raise the question here whether the recording was read as it should be."""

    @property
    def ended(self) -> bool:
        return False


def receive_antenna(
    scene: Scene,
    index: int,
    settings: Settings,
    navigation: NavigationData,
    rng: np.random.Generator,
    unit: AntennaUnit | None = None,
) -> Reception:
    """Receive at antenna number `index`, behind drawn correlators."""
    wanted = build_receiver_settings(GPS_SATS, settings, asked())
    return track_scene(scene, index, ModelReceiver(scene, index, wanted, rng), navigation, settings, unit)[0]


def track_scene(
    scene: Scene,
    index: int,
    receiver: ModelReceiver,
    navigation: NavigationData,
    settings: Settings,
    unit: AntennaUnit | None = None,
) -> tuple[Reception, Tracker]:
    """Track the whole scene, and return the reception and the tracker."""
    front_end, name = scene.scenario.front_end, scene.skies[index].name
    samples = Samples(
        name=name,
        rate_hz=front_end.rate_hz,
        n_samples=round(scene.scenario.duration_s * front_end.rate_hz),
        read=lambda start, count: np.empty((0, count), np.float32),
        if_hz=front_end.if_hz,
        start_gpst=scene.scenario.start_gpst,
    )
    workspace = Workspace()
    tracker = _Undiagnosed(
        samples=samples,
        receiver=receiver,
        measured=MeasurementLog(workspace, name, MEASURE_FRAMES * receiver.settings.frame_s),
        grids=RowLog(workspace, f"{name}/grids"),
        vector=set_up_guiding(samples, navigation, settings, unit) if settings.tracking == "vector" else None,
        checks=0,
    )
    while tracker.advance():
        pass
    return observe(tracker, navigation, None, workspace), tracker


def protect_scene(
    scene: Scene,
    navigation: NavigationData,
    platform_path: Path,
    seed: int,
    receive: Callable[..., Reception] = receive_antenna,
) -> tuple[Verdict, Outcome]:
    """Protect as `protect` does with the scene's recordings, navigation file and platform file.

    receive : with the arguments of `receive_antenna`, what a receiver receives.
    """
    platform = read_platform(platform_path)
    names = [sky.name for sky in scene.skies]
    tables = match_tables(platform, names, str(platform_path))
    settings, _ = derive_settings(platform, resolve_settings(platform.protect), names, tables)
    rng = np.random.default_rng(seed)
    start_gpst, files = scene.scenario.start_gpst, open_body(platform)
    unit = build_unit(platform, files, names, tables, start_gpst)
    carrying = build_antenna_units(unit)
    receptions = [
        receive(scene, index, settings, navigation, rng, carrying.get(name)) for index, name in enumerate(names)
    ]
    observed = [r.observations for r in receptions if r.observations is not None]
    settings = widen_windows(settings, observed)
    body = body_of(platform, files, names, tables, start_gpst, settings.max_separation_m)
    predictors = build_predictors(names, settings, platform, tables, unit)
    outcome, _ = judge(receptions, navigation, settings, Silent(), body=body, predictors=predictors)
    return document(outcome, (), settings), outcome
