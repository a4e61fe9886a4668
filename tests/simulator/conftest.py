"""One small scene that the tests of this room share: two receivers and a meaconer, no file needed."""

import numpy as np
import pytest

from skyproof.gnss.ephemeris import NavigationData
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.simulator.scenario import Meaconer, Scenario, ScenePlace, SceneReceiver

START = np.datetime64("2023-03-04T05:06:07.25", "ns")


@pytest.fixture(scope="session")
def navigation() -> NavigationData:
    return make_nominal_constellation(START)


@pytest.fixture(scope="session")
def scenario() -> Scenario:
    return Scenario(
        seed=7,
        start_gpst=START,
        duration_s=3.0,
        receivers=(
            SceneReceiver(
                name="one",
                lat_deg=40.0,
                lon_deg=-3.0,
                height_m=650.0,
                start_offset_s=1.23e-5,
                clock_offset_s=2.1e-4,
                lo_ppm=0.7,
            ),
            SceneReceiver(
                name="two",
                lat_deg=40.0004,
                lon_deg=-2.9996,
                height_m=650.0,
                start_offset_s=-4.1e-4,
                clock_offset_s=-3.3e-4,
                lo_ppm=-1.1,
            ),
        ),
        attacks=(
            Meaconer(
                receive=ScenePlace(lat_deg=40.005, lon_deg=-3.008, height_m=700.0),
                transmit=ScenePlace(lat_deg=40.001, lon_deg=-3.0005, height_m=660.0),
                delay_s=3.7e-6,
                onset_s=1.5,
            ),
        ),
    )
