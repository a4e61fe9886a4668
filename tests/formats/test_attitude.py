"""Angles from files: round trips, and what is no attitude."""

import re

import numpy as np
import pytest
from tests.written import write_table

from skyproof.errors import InputError
from skyproof.formats.attitude import COLUMNS, read_attitude

START = np.datetime64("2022-01-01T10:29:58", "ns")
ANGLES_DEG = np.column_stack([np.arange(350.0, 359.0), np.linspace(-3.0, 3.0, 9), np.linspace(179.0, -179.0, 9)])


def write_angles(folder, angles_deg=ANGLES_DEG, ending=".csv"):
    path = folder / f"attitude{ending}"
    gpst = START + np.arange(len(angles_deg)) * np.timedelta64(200, "ms")
    write_table(path, {"gpst": gpst, **dict(zip(COLUMNS, np.asarray(angles_deg).T, strict=True))})
    return path


@pytest.mark.parametrize("ending", [".csv", ".parquet"])
def test_angles_that_are_written_come_back(tmp_path, ending):
    found = read_attitude(write_angles(tmp_path, ending=ending))
    attitude = found.attitude(np.datetime64("NaT"), 0.01)
    assert attitude.gpst[0] == START
    assert attitude.gpst[-1] == START + np.timedelta64(1600, "ms")
    assert np.array_equal(attitude.angles_rad, np.radians(ANGLES_DEG))
    assert attitude.sigma_rad == 0.01
    assert not found.remarks


def test_times_from_a_start_count_from_the_one_given(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("time_s,roll_deg,pitch_deg,heading_deg\n0.5,1,2,3\n1.5,1,2,4\n")
    attitude = read_attitude(path).attitude(START, 0.01)
    assert attitude.gpst[0] == START + np.timedelta64(500, "ms")
    assert np.degrees(attitude.angles_rad[1]) == pytest.approx([4.0, 2.0, 1.0])


def test_rows_without_an_angle_are_left_out_and_reported(tmp_path):
    angles = ANGLES_DEG.copy()
    angles[3, 1] = angles[7, 0] = np.nan
    found = read_attitude(write_angles(tmp_path, angles))
    assert len(found.angles_rad) == 7
    assert [re.findall(r"\d+", remark) for remark in found.remarks] == [["2"]]
    with pytest.raises(InputError, match=r"\b1 rows.*\[attitude\]"):
        read_attitude(write_angles(tmp_path, ANGLES_DEG[:1]))


def test_angles_that_are_none_are_refused_radians_suspected(tmp_path):
    angles = ANGLES_DEG.copy()
    angles[4, 1] = 91.0
    with pytest.raises(InputError, match=r"line 6, pitch_deg: 91, .*\b90\b"):
        read_attitude(write_angles(tmp_path, angles))
    circle = np.column_stack([np.linspace(0.0, 6.2, 50), np.zeros(50), np.zeros(50)])
    (remark,) = read_attitude(write_angles(tmp_path, circle)).remarks
    assert "radians" in remark
    assert not read_attitude(write_angles(tmp_path, np.degrees(circle))).remarks
