"""`protect --imu`: inertial readings and attitude of the platform file are read before all else, and reported."""

from pathlib import Path

import numpy as np
import pytest
from tests.app.kit import PLACES, make_scenario
from tests.written import write_table

from skyproof.app.protect import protect
from skyproof.errors import InputError
from skyproof.formats.byte_io import compute_sha256
from skyproof.formats.imu import COLUMNS
from skyproof.formats.rinex_nav import write_nav
from skyproof.formats.rinex_obs import write_obs
from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.simulator.measurements import NoiseModel, simulate_observations


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write half a minute of one receiver, its orbits, and readings at rest timed from the recording's start."""
    folder = tmp_path_factory.mktemp("imu")
    scenario = make_scenario(receivers=1, duration_s=31.0)
    navigation = make_nominal_constellation(scenario.start_gpst)
    (observed,), _ = simulate_observations(
        scenario, navigation, rng=np.random.default_rng(3), noise=NoiseModel(sigma_m=0.5)
    )
    write_obs(folder / "bow.obs", observed, signals=observed.signals, holds="simulated", marker="bow", version="test")
    write_nav(folder / "brdc.rnx", navigation)
    still = np.tile([0.0, 0.0, -9.81, 0.0, 0.0, 0.0], (3500, 1))
    write_table(folder / "imu.csv", {"time_s": np.arange(1, 3501) * 0.01, **dict(zip(COLUMNS, still.T, strict=True))})
    (folder / "platform.toml").write_text(
        '[imu]\nfile = "imu.csv"\ngrade = "industrial"\ninitial = { heading_deg = 30.0, sigma_deg = 1.0 }\n'
        "[attitude]\nheading_deg = 30.0\nsigma_deg = 1.0\n"
    )
    return folder


def test_readings_are_an_input_with_their_sum_and_remarks(folder: Path) -> None:
    result = protect([folder / "bow.obs"], nav=folder / "brdc.rnx", platform=folder / "platform.toml")
    note = next(note for note in result.verdict.inputs if note.format == "inertial readings")
    assert (note.path, note.sha256) == (str(folder / "imu.csv"), compute_sha256(folder / "imu.csv"))
    assert list(note.all_remarks) == []
    lacking = {need for evidence in result.outcome.evidence for need in evidence.lacking}
    assert "array_phases" in lacking
    assert "nav_state" not in lacking
    place = np.linalg.norm(result.outcome.sets[0].position_ecef_m - np.asarray(_place()))
    assert place < 50.0


def _place() -> np.ndarray:
    place = make_scenario(receivers=1).receivers[0]
    assert place.name == PLACES[0].name
    return np.asarray(ecef_from_geodetic(*place.geodetic_rad))


def test_the_option_overrides_the_platform_file(folder: Path) -> None:
    with pytest.raises(InputError, match=r"bow\.obs: .*inertial"):
        protect([folder / "bow.obs"], platform=folder / "platform.toml", imu=folder / "bow.obs")
    result = protect([folder / "bow.obs"], nav=folder / "brdc.rnx", imu=folder / "imu.csv")
    note = next(note for note in result.verdict.inputs if note.format == "inertial readings")
    assert "not stated" in note.all_remarks[-1]
    lacking = {need for evidence in result.outcome.evidence for need in evidence.lacking}
    assert "array_phases" in lacking
