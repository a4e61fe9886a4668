"""`skyproof init`: the platform file that it writes parses, runs, and lays out every key that a person may state."""

import os
import re
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest
from tests.app import kit
from tests.app.kit import PLACES

from skyproof.app.common.platform import Platform, read_platform
from skyproof.app.common.platform_tables import (
    InitialAttitude,
    PlatformImu,
    PlatformReceiver,
    PlatformSpin,
    StatedAttitude,
    Surveyed,
)
from skyproof.app.common.settings import Settings
from skyproof.app.init import init
from skyproof.app.init.text import FoundReceiver, write_one_line, write_platform_lines
from skyproof.app.protect import protect
from skyproof.errors import InputError, OutputError
from skyproof.formats.raw import SampleLayout, write_sidecar_text
from skyproof.formats.rinex_nav import write_nav
from skyproof.formats.rinex_obs import write_obs
from skyproof.gnss.frames import ecef_from_geodetic

EXAMPLE = re.compile(r"^#(?=[\w\[])", re.MULTILINE)


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write two observation files and their navigation file."""
    folder = tmp_path_factory.mktemp("measured")
    navigation, pair = kit.simulate_measurements(31.0)
    for marker, name, o, place in zip(("BOW 1", "BOW 1"), ("one", "two"), pair, PLACES, strict=False):
        here_m = ecef_from_geodetic(*place.geodetic_rad)
        write_obs(
            folder / f"{name}.obs",
            o,
            signals=o.signals,
            holds="simulated",
            marker=marker,
            version="test",
            position_ecef_m=here_m,
        )
    write_nav(folder / "brdc.rnx", navigation)
    return folder


def write_recording(folder: Path, name: str = "rx 1.bin") -> Path:
    np.random.default_rng(1).integers(-20, 20, 8000).astype(np.int8).tofile(folder / name)
    layout = SampleLayout.model_validate(
        {"rate_hz": 2e6, "kind": "complex", "encoding": "int", "bits": 8, "start_gpst": "2022-01-01T10:29:58"}
    )
    (folder / name).with_suffix(".toml").write_text(write_sidecar_text(layout), encoding="utf-8")
    return folder / name


def test_what_is_written_runs_as_it_is(inputs: Path, tmp_path: Path) -> None:
    made = init([inputs / "one.obs", inputs / "two.obs"], out=inputs / "platform.toml")
    assert [receiver.name for receiver in made.platform.receivers] == ["one", "two"]
    assert [receiver.inputs for receiver in made.platform.receivers] == [
        (inputs / "one.obs",),
        (inputs / "two.obs",),
    ]
    verdict = protect(platform=made.path, nav=inputs / "brdc.rnx").verdict
    assert [receiver.name for receiver in verdict.receivers] == ["one", "two"]
    assert verdict.inputs[-1].all_remarks == ()


def test_what_the_files_say_stands_beside_their_receiver(inputs: Path) -> None:
    made = init([inputs / "one.obs", write_recording(inputs)], out=inputs / "platform.toml", overwrite=True)
    first, other = made.path.read_text(encoding="utf-8").split("[[receivers]]")[1:]
    place = PLACES[0]
    assert f"lat_deg = {place.lat_deg:.6f}, lon_deg = {place.lon_deg:.6f}, height_m = {place.height_m:.1f}" in (
        first.replace("\n# ", " ")
    )
    assert 'inputs = ["one.obs"]' in first
    assert "from 2024-05-14T" in first
    assert re.search(
        r'name = "rx-1"\ninputs = \["rx 1\.bin"\]\n# raw, 2 Msps, .*\b2022-01-01T10:29:58\.000\b.* 0\.0 s', other
    )


def test_a_receiver_is_named_as_its_marker_where_no_other_is(inputs: Path, tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    files = [inputs / "one.obs", write_recording(tmp_path, "rx.bin"), write_recording(tmp_path / "sub", "rx.bin")]
    made = init(files, out=tmp_path / "platform.toml")
    assert [receiver.name for receiver in made.platform.receivers] == ["BOW-1", "rx", "rx-2"]


def test_every_key_can_be_completed_by_taking_its_sign_away(tmp_path: Path) -> None:
    receivers = [FoundReceiver("a", "a.bin", (), 1), FoundReceiver("b", "b.sigmf-meta", ("its channels",), 3)]
    text = "\n".join(write_platform_lines(receivers, {}, "1"))
    assert set(tomllib.loads(text)) == {"receivers"}
    (tmp_path / "platform.toml").write_text(EXAMPLE.sub("", text).replace('file = "attitude.csv"', ""), "utf-8")
    tables = tomllib.loads((tmp_path / "platform.toml").read_text(encoding="utf-8"))
    for table in tables["receivers"]:
        table.pop("position")  # as examples both stand at one place
    platform = Platform.model_validate(tables)
    assert platform.imu is not None
    assert platform.receivers[1].antennas_m == ((0.0, 0.0, 0.0), (0.0, 0.19, 0.0), (0.0, 0.38, 0.0))
    models = (
        Platform,
        PlatformReceiver,
        Surveyed,
        PlatformSpin,
        StatedAttitude,
        PlatformImu,
        InitialAttitude,
        Settings,
    )
    derived = {"antennas_enu_m", "antennas_sigma_m"}
    absent = [key for model in models for key in model.model_fields if not re.search(rf"\b{key}\b", text)]
    assert set(absent) == derived


@pytest.mark.parametrize("table", ["imu", "attitude"])
def test_readings_over_time_are_told_apart_by_their_columns(table: str, tmp_path: Path) -> None:
    times = np.arange(50) * 0.01
    imu = ",".join(["time_s", *(f"accel_{x}_m_s2" for x in "xyz"), *(f"gyro_{x}_rad_s" for x in "xyz")])
    head, row = {"imu": (imu, "0.1,0,-9.81,0,0,0"), "attitude": ("time_s,heading_deg,pitch_deg,roll_deg", "40,1,0")}[
        table
    ]
    (tmp_path / "log.csv").write_text("\n".join([head, *(f"{t:.2f},{row}" for t in times)]) + "\n", encoding="ascii")
    files = [write_recording(tmp_path), tmp_path / "log.csv"]
    made = init(files, out=tmp_path / "platform.toml")
    text = made.path.read_text(encoding="utf-8")
    if table == "imu":
        assert made.platform.imu == PlatformImu(file=tmp_path / "log.csv")
    else:
        assert '#[attitude]\n#file = "log.csv"\n' in text
    shutil.copy(tmp_path / "log.csv", tmp_path / "other.csv")
    with pytest.raises(InputError, match=rf"other\.csv: .*\[{table}\]"):
        init([*files, tmp_path / "other.csv"], out=tmp_path / "p.toml")
    (tmp_path / "log.csv").write_text("a,b\n1,2\n", encoding="ascii")
    with pytest.raises(InputError, match=r"neither.*\battitude: "):
        init(files, out=tmp_path / "p.toml")


def test_nothing_is_replaced_unasked(tmp_path: Path) -> None:
    out = tmp_path / "platform.toml"
    out.write_text("motion = 'static'\n", encoding="utf-8")
    with pytest.raises(OutputError, match=r"platform\.toml: .*--overwrite"):
        init([write_recording(tmp_path)], out=out)
    assert read_platform(out).motion == "static"
    assert init([write_recording(tmp_path)], out=out, overwrite=True).platform.motion is None


@pytest.mark.parametrize("name", ["rx 1.toml", "rx 1.bin"])
def test_no_input_and_no_sidecar_is_ever_replaced(name: str, tmp_path: Path) -> None:
    path = write_recording(tmp_path)
    before = (tmp_path / name).read_bytes()
    with pytest.raises(OutputError, match=rf"{name}: .*\bsidecar\b.*--out"):
        init([path], out=tmp_path / name, overwrite=True)
    assert (tmp_path / name).read_bytes() == before


def test_paths_count_from_the_folder_of_the_platform_file(tmp_path: Path) -> None:
    for folder in ("here", "there"):
        (tmp_path / folder).mkdir()
    path = write_recording(tmp_path / "there")
    made = init([path], out=tmp_path / "here" / "platform.toml")
    assert 'inputs = ["../there/rx 1.bin"]' in made.path.read_text(encoding="utf-8")
    assert made.platform.receivers[0].inputs[0].resolve() == path.resolve()


@pytest.mark.parametrize("files", [[], ["none.bin"]])
def test_what_cannot_be_opened_leaves_no_file(files: list[str], tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.bin|observation file"):
        init([tmp_path / name for name in files], out=tmp_path / "platform.toml")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("value", ['a[ b, ]\\"ö\n\u2028', [], [1, [2.5, True]], {"a": [1.0], "b": "x"}])
def test_a_value_on_one_line_reads_back(value: object) -> None:
    line = write_one_line(value)
    assert "\n" not in line
    assert tomllib.loads(f"x = {line}") == {"x": value}


def test_a_name_that_is_no_text_is_refused(inputs: Path, tmp_path: Path) -> None:
    odd = os.fsdecode(b"odd-\xff.obs")
    shutil.copy(inputs / "one.obs", tmp_path / odd)
    with pytest.raises(InputError, match="UTF-8"):
        init([tmp_path / odd], out=tmp_path / "platform.toml")
