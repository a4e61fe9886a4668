"""All satellites blocked while a receiver speeds up and turns by 2 g: vector tracking with an inertial unit or without.

`python bench/vector_inertia.py`. Behind drawn correlators, nine satellites at 44 to 48 dB-Hz, blocked from 8.5 s on;
from 9 s on the receiver speeds up by 2 g to 40 m/s and turns through a right angle by 2 g. Of the filter at the end of
the blockage how far it is off, and how many signals had to be found anew. The last rows state a wrong attitude, block
nothing: the unit then has to be given up.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from skyproof.app.common.settings import Settings
from skyproof.app.common.windows import asked
from skyproof.app.receive.measured import MeasurementLog, RowLog
from skyproof.app.receive.tracker import Tracker, build_receiver_settings, set_up_guiding
from skyproof.formats.pieces import Workspace
from skyproof.gnss.frames import heading_pitch_roll_rad
from skyproof.gnss.imu_grades import GRADES
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.oscillators import OSCILLATORS
from skyproof.gnss.signals import GPS_SATS
from skyproof.navigation.ins import InsSettings
from skyproof.navigation.vector_inertia import AntennaUnit
from skyproof.receiver.tracking import MEASURE_FRAMES
from skyproof.records import Attitude, Samples
from skyproof.simulator.received import Scene
from skyproof.simulator.scenario import FrontEnd, Scenario, SceneImu, SceneReceiver, Sky
from skyproof.simulator.sites import WayPoints
from skyproof.simulator.sky import make_scene
from skyproof.simulator.truth import simulate_imus
from skyproof.studies.correlator_model import STEP_S, ModelReceiver

START = np.datetime64("2024-05-14T09:59:58", "ns")
FROM_S, GOES_S, LONGEST_S, AFTER_S = 8.5, 9.0, 10.0, 3.0
SEEDS = (1, 2, 3)
SIGMA_DEG = 0.2
"""Of the attitude stated."""


class Passage(NamedTuple):
    """off_m : of the filter at the end of the blockage, inf without one. anew : signals found a second time.
    given_up : how often a filter was. carried : whether the unit still carries it at the end."""

    off_m: float
    anew: int
    given_up: int
    carried: bool


def scene(grade: str | None = "tactical", seconds: float = FROM_S + LONGEST_S + AFTER_S) -> Scene:
    """The way, the sky and the unit."""
    way = WayPoints(
        points_enu_m=((0.0, 0.0, 0.0), (200.0, 0.0, 0.0), (200.0, 600.0, 0.0)),
        speed_m_s=40.0,
        acceleration_m_s2=19.6,
        turn_m_s2=19.6,
        start_s=GOES_S,
    )
    receiver = SceneReceiver(
        name="rx",
        lat_deg=57.7,
        lon_deg=11.94,
        height_m=50.0,
        oscillator="tcxo-good",
        path=way,
        imu=SceneImu(grade=grade, rate_hz=100.0),
    )
    scenario = Scenario(
        seed=4,
        start_gpst=START,
        duration_s=seconds,
        mask_deg=10.0,
        receivers=(receiver,),
        front_end=FrontEnd(rate_hz=5e6, bandwidth_hz=4e6, encoding="int", bits=8),
        sky=Sky(zenith_cn0_dbhz=48.0, horizon_cn0_dbhz=44.0),
    )
    return make_scene(scenario, make_nominal_constellation(START))


def unit_of(scene: Scene, wrong_deg: float = 0.0) -> AntennaUnit:
    """The scene's inertial unit. wrong_deg : of the heading that is stated."""
    readings = simulate_imus(scene)["rx"]
    series, at = readings.read(0, readings.n_samples), scene.trajectories["rx"].at(np.zeros(1))
    angles_rad = np.array(heading_pitch_roll_rad(at.position_ecef_m[0], at.attitude[0])) + [np.radians(wrong_deg), 0, 0]
    initial = Attitude(gpst=series.gpst[:1], angles_rad=angles_rad[None], sigma_rad=np.radians(SIGMA_DEG))
    return AntennaUnit(series, initial, InsSettings(grade=GRADES["tactical"], oscillator=OSCILLATORS["tcxo"]))


def passage(scene: Scene, unit: AntennaUnit | None, blocked_s: float, seed: int) -> Passage:
    """What becomes of vector tracking."""
    settings, workspace = Settings(tracking="vector"), Workspace()
    rate_hz, n_samples = (
        scene.scenario.front_end.rate_hz,
        round(scene.scenario.duration_s * scene.scenario.front_end.rate_hz),
    )
    samples = Samples(
        name="rx",
        rate_hz=rate_hz,
        n_samples=n_samples,
        read=lambda start, count: np.empty((0, count), np.float32),
        start_gpst=START,
    )
    wanted = build_receiver_settings(GPS_SATS, settings, asked())
    receiver = ModelReceiver(scene, 0, wanted, np.random.default_rng(seed))
    end_s = FROM_S + blocked_s
    receiver.waves.amplitude[round(FROM_S / STEP_S) : round(end_s / STEP_S)] = 0.0
    tracker = Tracker(
        samples=samples,
        receiver=receiver,
        measured=MeasurementLog(workspace, "rx", MEASURE_FRAMES * wanted.frame_s),
        grids=RowLog(workspace, "rx/grids"),
        vector=set_up_guiding(samples, make_nominal_constellation(START), settings, unit),
        checks=0,
    )
    off_m = np.inf
    while tracker.advance():
        guiding = tracker.vector
        assert guiding is not None
        if guiding.filter is not None and guiding.filter.elapsed_s <= end_s:
            true = scene.skies[0].point(np.array([guiding.filter.elapsed_s]))
            off_m = float(np.linalg.norm(guiding.filter.mean[:3] - true.position_ecef_m[0]))
    assert guiding is not None
    anew = sum(arc.began != "found" for arc in tracker.arcs.values())
    return Passage(off_m, anew, guiding.diverged, guiding.carried is not None)


def report() -> Iterator[str]:
    """Rows of the table."""
    way = scene()
    unit = unit_of(way)
    yield f"all satellites blocked under 2 g, {len(SEEDS)} noises: filter off by at most, signals found anew"
    for blocked_s in (2.0, 5.0, 10.0):
        for name, item in (("without", None), ("with", unit)):
            found = [passage(way, item, blocked_s, seed) for seed in SEEDS]
            off_m, anew = max(each.off_m for each in found), sum(each.anew for each in found)
            yield f"  {blocked_s:4.0f} s, {name:<7} a unit: {off_m:6.1f} m, {anew} anew"
    for wrong_deg in (5.0, 30.0, 180.0):
        found = [passage(way, unit_of(way, wrong_deg), 0.0, seed) for seed in SEEDS]
        given_up, anew = sum(each.given_up for each in found), sum(each.anew for each in found)
        yield f"  heading {wrong_deg:g} deg off, nothing blocked: filter given up {given_up} times, {anew} anew"


if __name__ == "__main__":
    for text in report():
        print(text, flush=True)
