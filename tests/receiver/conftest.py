"""A short clean sky and a short meaconed one, rendered once."""

import numpy as np
import pytest

from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.simulator import scenes
from skyproof.simulator.samples import render_samples
from skyproof.simulator.scenario import FrontEnd, ScenePlace
from skyproof.simulator.sky import Scene, make_scene

START = np.datetime64("2024-03-03T11:59:58", "ns")
PLACE = ScenePlace(lat_deg=48.1, lon_deg=11.6, height_m=500.0)


class Rendered:
    """A scene with the samples of one of its receivers in memory."""

    def __init__(self, scenario, receiver=0) -> None:  # type: ignore[no-untyped-def]
        self.receiver = receiver
        self.scenario = scenario
        self.navigation = make_nominal_constellation(scenario.start_gpst)
        self.scene: Scene = make_scene(scenario, self.navigation)
        self.samples = render_samples(scenario, self.navigation)[receiver]
        self.planes = self.samples.read(0, self.samples.n_samples)


@pytest.fixture(scope="session")
def clean() -> Rendered:
    """Render 15 s of clean sky to two-bit samples, long enough for the time of week."""
    front_end = FrontEnd(rate_hz=2_600_000, encoding="sign-magnitude", bits=2)
    return Rendered(
        scenes.make_clean(
            PLACE,
            START,
            duration_s=15.0,
            zenith_cn0_dbhz=48.0,
            horizon_cn0_dbhz=44.0,
            receivers=1,
            mask_deg=10.0,
            front_end=front_end,
            seed=3,
        )
    )


@pytest.fixture(scope="session")
def meaconer() -> Rendered:
    """Render 6 s under a meaconer that is on from 2 s."""
    return Rendered(scenes.make_meaconed(duration_s=6.0, onset_s=2.0, seed=5))
