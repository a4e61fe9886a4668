"""Scenes through the whole job, and the truth that its answer is held against."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skyproof.app.protect import ProtectResult, protect
from skyproof.formats.rinex_nav import write_nav
from skyproof.gnss.frames import ecef_from_geodetic, rot_enu_ecef
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.records import Fix, NavigationData, Observations
from skyproof.simulator.files import write
from skyproof.simulator.measurements import NoiseModel, simulate_observations
from skyproof.simulator.scenario import FrontEnd, Scenario, ScenePlace, SceneReceiver, Sky
from skyproof.simulator.sky import ReceiverSky, Scene, make_scene
from skyproof.studies.protection.score import false_labels, true_labels

START = np.datetime64("2024-05-14T09:59:58", "ns")  # two seconds before subframe 1

PLACES = (
    SceneReceiver(
        name="bow",
        lat_deg=57.7012,
        lon_deg=11.9321,
        height_m=52.0,
        start_offset_s=2.1e-5,
        clock_offset_s=1.9e-4,
        lo_ppm=0.4,
    ),
    SceneReceiver(
        name="stern",
        lat_deg=57.7009,
        lon_deg=11.93295,
        height_m=51.0,
        start_offset_s=6.4e-5,
        clock_offset_s=-2.7e-4,
        lo_ppm=-0.6,
    ),
    SceneReceiver(
        name="mast",
        lat_deg=57.70145,
        lon_deg=11.93285,
        height_m=64.0,
        start_offset_s=-3.1e-5,
        clock_offset_s=4.2e-4,
        lo_ppm=0.9,
    ),
)
ENU_M = {
    place.name: tuple(
        (
            rot_enu_ecef(*PLACES[0].geodetic_rad[:2])
            @ (ecef_from_geodetic(*place.geodetic_rad) - ecef_from_geodetic(*PLACES[0].geodetic_rad))
        ).tolist()
    )
    for place in PLACES
}
DISTANCE_M = round(float(np.linalg.norm(ENU_M["stern"])), 1)
"""Between the antennas of bow and stern."""
TRANSMIT = ScenePlace(lat_deg=57.7018, lon_deg=11.9333, height_m=58.0)
ELSEWHERE = ScenePlace(lat_deg=57.6951, lon_deg=11.9405, height_m=66.0)


def make_scenario(
    *,
    receivers: int = 2,
    duration_s: float = 34.0,
    start_gpst: np.datetime64 = START,
    attacks: tuple = (),
    front_end: FrontEnd | None = None,
    seed: int = 1,
) -> Scenario:
    """Make a scenario of receivers on a ship at a quay, 60 m and 45 m apart."""
    return Scenario(
        seed=seed,
        start_gpst=start_gpst,
        duration_s=duration_s,
        receivers=PLACES[:receivers],
        attacks=attacks,
        front_end=front_end or FrontEnd(),
        sky=Sky(zenith_cn0_dbhz=50.0, horizon_cn0_dbhz=42.0),
    )


ELEMENTS_M = ((0.0, 0.0, 0.0), (0.19, 0.0, 0.0), (0.095, 0.165, 0.0), (0.095, 0.055, -0.155))
LINE_BIAS_CYC = (0.0, 0.31, -0.12, 0.47)


def make_array_scenario(
    *,
    antennas: int = 4,
    duration_s: float = 13.0,
    start_gpst: np.datetime64 = START,
    attacks: tuple = (),
    seed: int = 1,
    **receiver: object,
) -> Scenario:
    """Make a scenario of one receiver whose antennas are a wavelength apart, on a ship heading 30 degrees."""
    elements = [
        {"name": str(number), "body_m": place, "line_bias_cyc": bias}
        for number, (place, bias) in enumerate(zip(ELEMENTS_M[:antennas], LINE_BIAS_CYC, strict=False), 1)
    ]
    place = PLACES[0].model_dump(include={"lat_deg", "lon_deg", "height_m", "clock_offset_s", "lo_ppm"})
    return Scenario(
        seed=seed,
        start_gpst=start_gpst,
        duration_s=duration_s,
        receivers=[{"name": "array", **place, "heading_deg": 30.0, "pitch_deg": 2.0, "antennas": elements, **receiver}],
        attacks=attacks,
        front_end=FrontEnd(rate_hz=1.6e6, bandwidth_hz=1.28e6, encoding="int", bits=8),
        sky=Sky(zenith_cn0_dbhz=48.0, horizon_cn0_dbhz=42.0),
    )


@dataclass(frozen=True, eq=False)
class Recorded:
    """A scene on disk: recordings, the navigation file of the day, and the truth."""

    paths: list[Path]
    nav: Path
    scene: Scene


def record(scenario: Scenario, folder: Path, *, navigation: NavigationData | None = None) -> Recorded:
    navigation = navigation or make_nominal_constellation(scenario.start_gpst)
    paths = write(scenario, navigation, folder)
    write_nav(folder / "broadcast.rnx", navigation)
    return Recorded(paths, folder / "broadcast.rnx", make_scene(scenario, navigation))


def protect_scenario(scenario: Scenario, folder: Path, *, with_nav: bool = True, **options: object) -> "Judged":
    recorded = record(scenario, folder)
    result = protect(recorded.paths, nav=recorded.nav if with_nav else None, out=folder / "out", **options)
    return Judged(result, recorded.scene)


@dataclass(frozen=True, eq=False)
class Judged:
    """What came out, beside the truth."""

    result: ProtectResult
    scene: Scene

    @property
    def verdict(self):
        return self.result.verdict

    def find_false_labels(self) -> list[str]:
        """Find stretches of a second or more that are called authentic and are spoofed, or the other way round."""
        return list(false_labels(self.scene, self.result.outcome))

    def list_named(self, label: str, receiver: str) -> set[str]:
        """List satellites with a signal of that label whose label is right in truth."""
        o = next(o for o in self.list_observations() if o.receiver == receiver)
        true = true_labels(o, self._find_sky(receiver), self.scene)
        return {
            s.ref.signal.sat
            for s in self.result.outcome.decision.labels
            if s.ref.receiver == receiver
            and s.label == label
            and (true[s.first_epoch : s.last_epoch + 1, o.signals.index(s.ref.signal)] == label).any()
        }

    def measure_trusted_error_m(self, receiver: str) -> NDArray[np.float64]:
        """Measure the distance of the trusted fixes from the truth, (n_epochs,), NaN where there is none."""
        r = next(r for r in self.result.outcome.receivers if r.reception.source.name == receiver)
        return np.empty(0) if r.trusted is None else measure_error_m(r.trusted, self._find_sky(receiver).receiver)

    def list_observations(self) -> Iterable[Observations]:
        receptions = (r.reception.observations for r in self.result.outcome.receivers)
        return [o for o in receptions if o is not None]

    def _find_sky(self, receiver: str) -> ReceiverSky:
        return next(sky for sky in self.scene.skies if sky.receiver.name == receiver)


def measure_error_m(fix: Fix, place: ScenePlace) -> NDArray[np.float64]:
    """Measure the distance of each fix from a place, (n_epochs,)."""
    return np.linalg.norm(fix.position_ecef_m - ecef_from_geodetic(*place.geodetic_rad), axis=1)


def simulate_measurements(duration_s: float) -> tuple[NavigationData, tuple[Observations, ...]]:
    """Simulate orbits and what the first two receivers measure once a second, with the errors of loops."""
    scenario = make_scenario(duration_s=duration_s)
    navigation = make_nominal_constellation(scenario.start_gpst)
    noise = NoiseModel(sigma_m=1.0, ar1=0.9, constant_m=0.5)
    return navigation, simulate_observations(scenario, navigation, rng=np.random.default_rng(3), noise=noise)[0]
