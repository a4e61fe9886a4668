"""The platform file: every key, right and wrong, and what must agree with itself."""

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from tests.facts import match_facts

from skyproof.app.common.platform import SCHEMA_PATH, Platform, platform_schema, read_platform
from skyproof.app.common.platform_tables import (
    InitialAttitude,
    PlatformImu,
    PlatformReceiver,
    PlatformSpin,
    StatedAttitude,
    Surveyed,
)
from skyproof.app.common.settings import Settings
from skyproof.errors import SettingsError, SkyproofError
from skyproof.gnss.imu_grades import GRADES

MODELS = (Platform, PlatformReceiver, Surveyed, PlatformSpin, StatedAttitude, PlatformImu, InitialAttitude)

WHOLE = """
motion = "static"
speed_max_m_s = 40
oscillator = "tcxo"

[[receivers]]
name = "rx1"
inputs = ["rx1_ant1.bin", "sub/rx1_ant2.bin", "/far/rx1_ant3.bin"]
position = { lat_deg = 57.7, lon_deg = 11.94, height_m = 50.0, sigma_m = 0.05 }
body_m = [0.0, 0.0, 0.0]
antennas_m = [[0.0, 0.0, 0.0], [0.190, 0.0, 0.0], [0.095, -0.165, 0.0]]
antenna_sigma_m = 0.003
antenna_pattern_sigma_m = 0.005
line_bias_cyc = [0.0, 0.25, -0.125]

[[receivers]]
name = "rx2"
body_m = [0.0, 3.0, 0.0]
spin = { radius_m = 0.0951, rate_hz = 0.25, rate_sigma_hz = 0.001 }

[attitude]
heading_deg = 35.0
pitch_deg = 2.0
roll_deg = -1.0
sigma_deg = 0.2

[imu]
file = "imu.csv"
start_gpst = 2022-01-01T10:29:58.5
grade = "tactical"
axes = "frd"
lever_arm_m = [0.1, 0.2, -0.3]
initial = { heading_deg = 40.0, pitch_deg = 0.6, roll_deg = 0.5, sigma_deg = 0.5 }

[protect]
window_s = 20
antennas_sigma_m = 0.2
"""


def read(folder: Path, text: str) -> Platform:
    (folder / "platform.toml").write_text(text, encoding="utf-8")
    return read_platform(folder / "platform.toml")


def test_every_key_is_read(tmp_path: Path) -> None:
    platform = read(tmp_path, WHOLE)
    first, second = platform.receivers
    assert (platform.motion, platform.speed_max_m_s, platform.oscillator) == ("static", 40.0, "tcxo")
    assert (first.name, second.name) == ("rx1", "rx2")
    assert first.position == Surveyed(lat_deg=57.7, lon_deg=11.94, height_m=50.0, sigma_m=0.05)
    assert (first.antenna_sigma_m, first.antenna_pattern_sigma_m) == (0.003, 0.005)
    assert first.line_bias_cyc == (0.0, 0.25, -0.125)
    np.testing.assert_array_equal(first.antennas_body_m, [[0, 0, 0], [0.19, 0, 0], [0.095, -0.165, 0]])
    np.testing.assert_array_equal(second.antennas_body_m, [[0, 3, 0]])
    assert second.spin == PlatformSpin(radius_m=0.0951, rate_hz=0.25, rate_sigma_hz=0.001)
    assert platform.attitude == StatedAttitude(heading_deg=35.0, pitch_deg=2.0, roll_deg=-1.0, sigma_deg=0.2)
    assert platform.imu is not None
    assert platform.imu.start_gpst == np.datetime64("2022-01-01T10:29:58.5", "ns")
    assert (platform.imu.grade, platform.imu.lever_arm_m) == ("tactical", (0.1, 0.2, -0.3))
    assert platform.imu.initial == InitialAttitude(heading_deg=40.0, pitch_deg=0.6, roll_deg=0.5, sigma_deg=0.5)
    assert platform.protect == Settings(window_s=20.0, antennas_sigma_m=0.2)


def test_files_are_looked_for_beside_the_platform_file(tmp_path: Path) -> None:
    platform = read(
        tmp_path,
        WHOLE.replace("[attitude]", '[attitude]\nfile = "a.csv"', 1).replace(
            "heading_deg = 35.0\npitch_deg = 2.0\nroll_deg = -1.0\n", ""
        ),
    )
    assert platform.receivers[0].inputs == (
        tmp_path / "rx1_ant1.bin",
        tmp_path / "sub" / "rx1_ant2.bin",
        Path("/far/rx1_ant3.bin"),
    )
    assert platform.attitude is not None
    assert platform.attitude.file == tmp_path / "a.csv"
    assert platform.imu is not None
    assert platform.imu.file == tmp_path / "imu.csv"


def test_an_empty_file_is_a_platform_of_which_nothing_is_known(tmp_path: Path) -> None:
    assert read(tmp_path, "") == Platform()
    assert read(tmp_path, "") == Platform.model_validate({})


def test_the_grades_are_those_whose_errors_are_known() -> None:
    assert set(PlatformImu.model_fields["grade"].annotation.__args__[0].__args__) == set(GRADES)  # type: ignore[union-attr]


def test_every_key_says_what_it_means() -> None:
    untold = [f"{m.__name__}.{key}" for m in MODELS for key, field in m.model_fields.items() if not field.description]
    assert untold == []


@pytest.mark.parametrize(
    ("axes", "unit", "body"),
    [
        ("frd", (1, 2, 3), (1, 2, 3)),
        ("flu", (1, 2, 3), (1, -2, -3)),
        ("rfu", (1, 2, 3), (2, 1, -3)),
        ([[0, 0, 1], [1, 0, 0], [0, 1, 0]], (1, 2, 3), (3, 1, 2)),
        ([[0.866, 0.5, 0], [-0.5, 0.866, 0], [0, 0, 1]], (1, 0, 0), (np.sqrt(0.75), -0.5, 0)),
    ],
)
def test_readings_in_any_axes_become_those_of_the_body(axes: Any, unit: Any, body: Any) -> None:
    rotation = PlatformImu(file="imu.csv", axes=axes).rotation
    np.testing.assert_allclose(rotation @ unit, body, atol=1e-4)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)


RECEIVER = "[[receivers]]\n"
SECOND = '[[receivers]]\nname = "a"\n[[receivers]]\n'
PLACE = "position = {{ lat_deg = {}, lon_deg = {}, height_m = {}, sigma_m = {} }}\n"
IMU = '[imu]\nfile = "imu.csv"\n'
ATTITUDE = "[attitude]\nsigma_deg = 1.0\n"
HERE = PLACE.format(57.7, 11.9, 50, 0.1)


WRONG = [
    ('motion = "flying"', "motion = \"flying\" … 'static' or 'moving'"),
    ("speed_max_m_s = 0", "speed_max_m_s = 0 … 0"),
    ('speed_max_m_s = "40"', 'speed_max_m_s = "40" … 40'),
    ('[protect]\nantenna_distance_m = "60"', 'protect.antenna_distance_m = "60" … 60'),
    ("speed_max_m_s = nan", "speed_max_m_s = nan, expected"),
    ("speed_max_m_s = true", "speed_max_m_s = true … number"),
    ("speed_max = 40", "speed_max: … speed_max_m_s? … : motion, "),
    ('oscillator = "caesium"', "oscillator = \"caesium\" … 'quartz', 'tcxo', 'ocxo', 'csac' or 'rubidium'"),
    ("receivers = 3", "receivers = 3 … list"),
    ('[receivers]\nname = "a"', "receivers = {'name': 'a'} … list"),
    (f'{SECOND}nam = "b"', "receivers[1].nam: … name? … : name, inputs, "),
    (f'{SECOND}name = "b c"', "receivers[1].name = \"b c\" … '.', '_' and '-'"),
    (f'{SECOND}name = "a"', "receivers: [1].name repeats a; … own"),
    (f'{RECEIVER}inputs = "a.bin"', 'receivers[0].inputs = "a.bin" … list'),
    (f"{RECEIVER}inputs = [3]", "receivers[0].inputs[0] = 3 … text"),
    (f'{RECEIVER}inputs = [""]', "receivers[0].inputs[0]: … path"),
    (f'{RECEIVER}inputs = ["a", "a"]', "receivers[0].inputs: [1] repeats a; … antenna"),
    (
        f'{RECEIVER}inputs = ["a"]\n{RECEIVER}inputs = ["b", "a"]',
        "receivers: [1].inputs repeats a … two receivers",
    ),
    (f"{RECEIVER}position = 3", "receivers[0].position = 3 … table"),
    (f"{RECEIVER}{PLACE.format(91, 0, 0, 1)}", "receivers[0].position.lat_deg = 91 … 90"),
    (f"{RECEIVER}{PLACE.format(0, 361, 0, 1)}", "receivers[0].position.lon_deg = 361 … 360"),
    (f"{RECEIVER}{PLACE.format(0, 0, 1e6, 1)}", "receivers[0].position.height_m = 1000000.0 … 100000"),
    (f"{RECEIVER}{PLACE.format(0, 0, 0, 0)}", "receivers[0].position.sigma_m = 0 … 0"),
    (f"{RECEIVER}position = {{ lat_deg = 1 }}", "lon_deg is missing; receivers[0].position.height_m is missing; "),
    (f"{RECEIVER}position = {{ lat = 1 }}", "receivers[0].position.lat: … lat_deg?"),
    (
        f"{RECEIVER}{HERE}{RECEIVER}{PLACE.format(-57.7, 11.9, 50, 0.1)}",
        "receivers: [1].position is 10736 km … [0].position … 100 km",
    ),
    (
        f"{RECEIVER}{HERE}body_m = [0, 0, 0]\n{RECEIVER}{PLACE.format(57.7001, 11.9, 50, 0.1)}body_m = [3, 0, 0]",
        "receivers: [1].position is 11.14 m … [0].position … body_m … 3.00 m … sigma 0.20",
    ),
    (f"{RECEIVER}body_m = [0, 0]", "receivers[0].body_m[2] is missing"),
    (f"{RECEIVER}body_m = [0, 0, 2000]", "receivers[0].body_m[2] = 2000 … 1000"),
    (f"{RECEIVER}antennas_m = [0, 0, 0]", "receivers[0].antennas_m[0] = 0 … list"),
    (f"{RECEIVER}antennas_m = []", "receivers[0].antennas_m holds 0 … 1"),
    (
        f'{RECEIVER}inputs = ["a", "b", "c"]\nantennas_m = [[0, 0, 0], [1, 0, 0]]',
        "receivers[0].antennas_m: … 2 antennas … inputs has 3",
    ),
    (f"{RECEIVER}antenna_sigma_m = 0", "receivers[0].antenna_sigma_m = 0 … 0"),
    (f"{RECEIVER}antenna_pattern_sigma_m = 1", "receivers[0].antenna_pattern_sigma_m = 1 … 0.1"),
    (f"{RECEIVER}line_bias_cyc = 0.1", "receivers[0].line_bias_cyc = 0.1 … list"),
    (
        f"{RECEIVER}antennas_m = [[0, 0, 0], [1, 0, 0]]\nline_bias_cyc = [0.1]",
        "receivers[0].line_bias_cyc: … 1 antennas … antennas_m has 2",
    ),
    (f"{SECOND}spin = {{ radius_m = 0, rate_hz = 1 }}", "receivers[1].spin.radius_m = 0 … 0"),
    (f"{SECOND}spin = {{ radius_m = 1, rate_hz = 0 }}", "receivers[1].spin.rate_hz: is 0 … turns"),
    (f"{SECOND}spin = {{ radius_m = 1, rate_hz = 51 }}", "receivers[1].spin.rate_hz = 51 … 50"),
    (
        f"{SECOND}spin = {{ radius_m = 1, rate_hz = 1, rate_sigma_hz = -1 }}",
        "receivers[1].spin.rate_sigma_hz = -1 … 0",
    ),
    (f"{SECOND}spin = {{ radius_m = 1, rate = 1 }}", "receivers[1].spin.rate: … rate_hz?"),
    (
        f'{RECEIVER}inputs = ["a", "b"]\nspin = {{ radius_m = 1, rate_hz = 1 }}',
        "receivers[0].spin: … has 2",
    ),
    ("[attitude]\nheading_deg = 3", "attitude.sigma_deg is missing"),
    (f"{ATTITUDE}pitch_deg = 3", "attitude: heading_deg is missing … file"),
    (f"{ATTITUDE}heading_deg = 400", "attitude.heading_deg = 400 … 360"),
    (f"{ATTITUDE}heading_deg = 0\npitch_deg = 91", "attitude.pitch_deg = 91 … 90"),
    (f"{ATTITUDE}heading_deg = 0\nroll_deg = 181", "attitude.roll_deg = 181 … 180"),
    (f'{ATTITUDE}file = "a"\nroll_deg = 1', "attitude: roll_deg … file both"),
    (f"{ATTITUDE}file = 3", "attitude.file = 3 … text"),
    (f"{ATTITUDE}yaw_deg = 3", "attitude.yaw_deg: … ?"),
    (f"{IMU}start_gpst = 2022-01-01T10:29:58Z", "imu.start_gpst: … zone"),
    (f'{IMU}start_gpst = "noon"', "imu.start_gpst: 'noon' … 2022-01-01T21:45:58"),
    (f"{IMU}start_gpst = 10:29:58", "imu.start_gpst: is 10:29:58 … 2022-01-01T21:45:58"),
    (f'{IMU}grade = "toy"', "imu.grade = \"toy\" … 'consumer', 'industrial', 'tactical'"),
    (
        f'{IMU}grade = "tactical"\naccel_bias_ug = 3',
        "imu: grade … accel_bias_ug both",
    ),
    (
        f"{IMU}gyro_bias_deg_h = 3\naccel_bias_ug = 3",
        "imu: gyro_bias_deg_h … not gyro_noise_deg_sqrt_h, accel_noise_m_s_sqrt_h;",
    ),
    (f"{IMU}gyro_bias_deg_h = -1", "imu.gyro_bias_deg_h = -1 … 0"),
    (f"{IMU}gyro_noise_deg_sqrt_h = -1", "imu.gyro_noise_deg_sqrt_h = -1 … 0"),
    (f"{IMU}accel_bias_ug = -1", "imu.accel_bias_ug = -1 … 0"),
    (f"{IMU}accel_noise_m_s_sqrt_h = -1", "imu.accel_noise_m_s_sqrt_h = -1 … 0"),
    (f"{IMU}scale_ppm = -1", "imu.scale_ppm = -1 … 0"),
    (f"{IMU}misalignment_mrad = -1", "imu.misalignment_mrad = -1 … 0"),
    (f"{IMU}misalignment_mrad = 1", "imu: misalignment_mrad … not gyro_bias_deg_h, gyro_noise_deg_sqrt_h"),
    (f'{IMU}axes = "ned"', "imu.axes: is \"ned\" … 'frd', 'flu', 'rfu'"),
    (f"{IMU}axes = [[1, 0, 0], [0, 1, 0], [0, 0, -1]]", "imu.axes … right angles"),
    (f"{IMU}axes = [[1, 0, 0], [0, 1, 0], [0.1, 0, 1]]", "imu.axes … right angles"),
    (f"{IMU}axes = [[1, 0, 0], [0, 1, 0]]", "imu.axes … three numbers"),
    (f'{IMU}axes = [[1, 0, 0], [0, 1, 0], [0, 0, "1"]]', "imu.axes … three numbers"),
    (f"{IMU}axes = [[1, 0, 0], [0, 1, 0], [0, 0, nan]]", "imu.axes … three numbers"),
    (f"{IMU}lever_arm_m = [0, 0]", "imu.lever_arm_m[2] is missing"),
    (f"{IMU}initial = 40.0", "imu.initial = 40.0 … table"),
    (f"{IMU}initial = {{ heading_deg = 3 }}", "imu.initial.sigma_deg is missing"),
    (f"{IMU}initial = {{ heading_deg = 3, sigma_deg = 0 }}", "imu.initial.sigma_deg = 0 … 0"),
    (f"{IMU}rate_hz = 3", "imu.rate_hz: "),
    ("[protect]\nwindow = 3", "protect.window: … window_s?"),
    ("[protect]\nantenna_separation_m = 400", "protect: antenna_separation_m = 400 … max_separation_m"),
    (
        "speed_max_m_s = 3\n[protect]\nspeed_max_m_s = 4",
        "protect: speed_max_m_s … platform",
    ),
    ("[protct]\nwindow = 3", "protct: … protect?"),
]


@pytest.mark.parametrize(("text", "words"), WRONG)
def test_a_key_that_makes_no_sense_is_named_with_its_place(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(SettingsError) as raised:
        read(tmp_path, text)
    assert str(raised.value).startswith(f"{tmp_path / 'platform.toml'}: ")
    assert re.search(match_facts(words), str(raised.value))


def test_every_key_has_a_wrong_example() -> None:
    named = {re.split(r"[ :]", words)[0].rpartition(".")[2].partition("[")[0] for _, words in WRONG}
    assert [key for model in MODELS for key in model.model_fields if key not in named] == []


def test_faults_are_named_together_up_to_a_bound(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match=r"motion = .*; receivers\[0\]\.name = .*; imu\.scale_ppm .*$"):
        read(tmp_path, 'motion = 3\n[[receivers]]\nname = "/"\n[imu]\nscale_ppm = -1\n')
    with pytest.raises(SettingsError, match=r"key9: .*\b20 more$"):
        read(tmp_path, "".join(f"key{number} = 1\n" for number in range(30)))


@pytest.mark.parametrize("text", ["motion", "motion = ", "[[receivers]\n", "a = 1\na = 2"])
def test_what_is_no_toml_is_refused_with_its_line(tmp_path: Path, text: str) -> None:
    with pytest.raises(SkyproofError, match=r"platform\.toml: .*TOML: .*line"):
        read(tmp_path, text)


def test_unit_errors_come_from_grade_numbers_or_the_poorest() -> None:
    numbers = {
        "gyro_bias_deg_h": 36.0,
        "gyro_noise_deg_sqrt_h": 0.6,
        "accel_bias_ug": 1000.0,
        "accel_noise_m_s_sqrt_h": 0.06,
    }
    stated = PlatformImu(file=Path("imu.csv"), **numbers).errors
    assert stated.gyro_repeatability_rad_s == pytest.approx(np.radians(0.01))
    assert stated.angular_random_walk_rad_rts == pytest.approx(np.radians(0.01))
    assert stated.accelerometer_repeatability_m_s2 == pytest.approx(9.80665e-3)
    assert stated.velocity_random_walk_m_s_rts == pytest.approx(0.001)
    assert (stated.gyro_scale, stated.misalignment_rad) == (0.0, 0.0)
    with_gains = PlatformImu(file=Path("imu.csv"), **numbers, scale_ppm=500.0, misalignment_mrad=1.0).errors
    assert with_gains.gyro_scale == with_gains.accelerometer_scale == pytest.approx(5e-4)
    assert with_gains.misalignment_rad == pytest.approx(1e-3)
    assert PlatformImu(file=Path("imu.csv"), grade="tactical").errors is GRADES["tactical"]
    assert PlatformImu(file=Path("imu.csv")).errors is GRADES["consumer"]
    assert max(GRADES.values(), key=lambda grade: grade.gyro_repeatability_rad_s) is GRADES["consumer"]


def test_the_published_schema_is_the_one_of_the_model() -> None:
    assert json.loads(SCHEMA_PATH.read_text(encoding="utf-8")) == platform_schema(), (
        "write it anew: python -c 'import json; from skyproof.app.common.platform import *; "
        'SCHEMA_PATH.write_text(json.dumps(platform_schema(), indent=1) + "\\n")\''
    )


def test_the_schema_takes_what_is_right_and_names_what_is_wrong() -> None:
    checker = jsonschema.Draft202012Validator(platform_schema())
    checker.check_schema(platform_schema())
    whole = json.loads(json.dumps(tomllib.loads(WHOLE), default=lambda instant: instant.isoformat()))
    assert list(checker.iter_errors(whole)) == []
    for table in (whole, whole["receivers"][0]["position"], whole["protect"]):
        table["unknown"] = 1
        assert not checker.is_valid(whole)
        del table["unknown"]
    assert checker.is_valid(whole)
    whole["receivers"][0]["position"]["lat_deg"] = 91
    assert not checker.is_valid(whole)


def test_alternative_keys_have_examples_that_hold() -> None:
    numbers = {
        key: PlatformImu.model_fields[key].examples[0]
        for key in PlatformImu.model_fields
        if key.startswith(("gyro_", "accel"))
    }
    assert len(numbers) == 4
    assert PlatformImu.model_validate({"file": "imu.csv"} | numbers).grade is None
    examples = {key: StatedAttitude.model_fields[key].examples[0] for key in ("file", "sigma_deg")}
    assert StatedAttitude.model_validate(examples).heading_deg is None
