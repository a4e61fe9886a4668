"""Arrays and arms of the user's own: what they miss, beside what is known of the paper's."""

from pathlib import Path

import numpy as np
import pytest

from skyproof.cli.study import study
from skyproof.errors import SettingsError
from skyproof.records import AntennaArray, SpinArm
from skyproof.statistics.directions import direction_cosines
from skyproof.studies.array_geometry import equilateral_triangle
from skyproof.studies.base import StudySettings
from skyproof.studies.geometry import WAVE_M, arm, array
from skyproof.studies.ins_array_figures import lattice_share

OWN = """
[[receivers]]
name = "mast"
antennas_m = [[0.0, 0.0, 0.0], [0.19, 0.0, 0.0]]
"""


def test_a_triangle_misses_what_its_discs_cover():
    triangle = AntennaArray(elements_m=equilateral_triangle(WAVE_M), sigma_m=1e-6)
    rows = list(array(StudySettings(arrays={"own": triangle})))
    azimuths = np.arange(24) * 2.0 * np.pi / 24
    for row in rows[::4]:
        directions = direction_cosines(azimuths, np.radians(row["elevation_deg"]))
        expected = 100.0 * np.mean([lattice_share(direction, 1.0) for direction in directions])
        assert row["missed_percent"] == pytest.approx(expected, rel=0.05)


def test_an_inclined_plane_mirrors_the_sky_into_the_sky():
    flat = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.0, 0.3, 0.0]]) * WAVE_M
    inclined = flat + [[0.0, 0.0, 0.0], [0.0, 0.0, -0.3 * WAVE_M], [0.0, 0.0, 0.0]]
    arrays = {
        name: AntennaArray(elements_m=elements_m, sigma_m=1e-6)
        for name, elements_m in (("flat", flat), ("inclined", inclined))
    }
    rows = list(array(StudySettings(quick=True, arrays=arrays)))
    missed = {(row["array"], row["elevation_deg"]): row["missed_percent"] for row in rows}
    assert missed["inclined", 85] > 1.3 * missed["flat", 85]


def test_a_longer_arm_and_more_turns_miss_less():
    arms = tuple(SpinArm(receiver=str(cm), radius_m=0.01 * cm, rate_rad_s=np.pi / 2.0) for cm in (5, 10, 20))
    rows = list(arm(StudySettings(quick=True, arms=arms)))
    missed = {(row["arm"], row["seconds"]): row["missed_percent"] for row in rows}
    for seconds in (4, 8, 15):
        assert missed["5", seconds] > missed["10", seconds] > missed["20", seconds]
    assert missed["10", 2] > 5.0 * missed["10", 8]


def test_a_platform_file_gives_the_geometry(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    path = tmp_path / "platform.toml"
    path.write_text(OWN)
    assert study("geometry.array", platform=path, quick=True, plot=True, out=tmp_path) == 0
    assert "mast" in capsys.readouterr().out
    assert "mast" in (tmp_path / "geometry.array.svg").read_text()
    with pytest.raises(SettingsError, match=r"\bspin, .*\bgeometry\.arm\b"):
        study("geometry.arm", platform=path)
    with pytest.raises(SettingsError, match=r"spin\.roc .*--platform; .*geometry\.array .*geometry\.arm\b"):
        study("spin.roc", platform=path)
