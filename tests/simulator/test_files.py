"""What is written can be opened, and holds what the samples in memory hold; the truth lies beside it."""

import csv
import errno
import hashlib
import json
import tomllib
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from sigmf import SigMFCollection, sigmffile

from skyproof.errors import OutputError, SettingsError
from skyproof.formats.recording import open_recording
from skyproof.gnss.ephemeris import NavigationData
from skyproof.simulator import files
from skyproof.simulator.files import (
    choose_container,
    count_sample_octets,
    estimate_series_octets,
    list_sample_names,
    list_series_names,
    write,
    write_samples,
    write_series,
    write_truth,
)
from skyproof.simulator.samples import render_samples
from skyproof.simulator.scenario import Antenna, FrontEnd, Interference, Scenario, SceneImu, Takeover
from skyproof.simulator.sites import Circle, Site
from skyproof.simulator.sky import make_scene
from skyproof.simulator.truth import compute_signal_truth, compute_trajectory_truth, simulate_imus
from skyproof.simulator.truth_document import build_truth

FRONT_ENDS = [
    FrontEnd(rate_hz=1e6),
    FrontEnd(rate_hz=1e6, encoding="sign-magnitude", bits=2),
    FrontEnd(rate_hz=1e6, encoding="int", bits=8),
    FrontEnd(rate_hz=1e6, encoding="int", bits=16),
    FrontEnd(rate_hz=1e6, encoding="float", bits=32),
    FrontEnd(rate_hz=2e6, kind="real", if_hz=4e5),
    FrontEnd(rate_hz=2e6, kind="real", if_hz=4e5, encoding="sign-magnitude", bits=2),
    FrontEnd(rate_hz=2e6, kind="real", if_hz=4e5, encoding="int", bits=8),
    FrontEnd(rate_hz=2e6, kind="real", if_hz=4e5, encoding="float", bits=32),
]


def name_files(front_end: FrontEnd) -> str:
    return f"{front_end.kind}-{front_end.encoding}-{front_end.bits}"


def is_fitting(front_end: FrontEnd) -> bool:
    return front_end.bits >= 8


@pytest.fixture(scope="module")
def arrays(scenario: Scenario) -> Scenario:
    """Write two antennas on a car that drives, with an inertial unit, an attack that pauses, and interference."""
    first, second = scenario.receivers
    (meaconer,) = scenario.attacks
    site = first.model_dump(exclude={"heading_deg", "pitch_deg", "roll_deg", "path", "antennas", "imu"})
    car = type(first)(
        **site,
        path=Circle(radius_m=40.0, speed_m_s=8.0),
        imu=SceneImu(rate_hz=20.0, grade="tactical"),
        antennas=(Antenna(name="l"), Antenna(name="r", body_m=(0.0, 1.0, 0.0))),
    )
    at = Site(lat_deg=40.002, lon_deg=-3.0, height_m=700.0)
    return scenario.model_copy(
        update={
            "name": "arrays",
            "duration_s": 1.0,
            "receivers": (car, second),
            "front_end": FrontEnd(rate_hz=1e6, encoding="int", bits=8),
            "attacks": (meaconer.model_copy(update={"onset_s": 0.25, "off_s": ((0.5, 0.75),)}),),
            "interference": (
                Interference(kind="noise", transmit=at, power_db=3.0, onset_s=0.1, until_s=0.2),
                Interference(kind="cw", name="tone", transmit=at, power_db=-3.0, onset_s=0.9),
            ),
        }
    )


# --- samples


@pytest.mark.parametrize(
    ("front_end", "container"),
    [
        (front_end, container)
        for front_end in FRONT_ENDS
        for container in ("raw", "sigmf")
        if container == "raw" or is_fitting(front_end)
    ],
    ids=lambda value: name_files(value) if isinstance(value, FrontEnd) else value,
)
def test_files_hold_what_the_samples_in_memory_hold(
    scenario: Scenario, navigation: NavigationData, front_end: FrontEnd, container: str, tmp_path: Path
) -> None:
    scenario = scenario.model_copy(update={"front_end": front_end, "duration_s": 0.3, "attacks": ()})
    paths = write(scenario, navigation, tmp_path, container=container)
    ending = "bin" if container == "raw" else "sigmf-meta"
    assert [path.name for path in paths] == [f"one.{ending}", f"two.{ending}"]
    for path, samples in zip(paths, render_samples(scenario, navigation), strict=True):
        (opened,) = open_recording(path)
        for name in ("name", "antenna", "n_samples", "rate_hz", "if_hz", "centre_hz", "start_gpst"):
            assert getattr(opened, name) == getattr(samples, name), name
        assert opened.n_samples == int(0.3 * front_end.rate_hz)
        assert opened.remarks == ()
        np.testing.assert_array_equal(opened.read(0, 700_000), samples.read(0, 700_000))
    data = [tmp_path / name for name in list_sample_names(make_scene(scenario, navigation), container)]
    assert all(path.exists() for path in data)
    stored = sum(path.stat().st_size for path in data if path.suffix in (".bin", ".sigmf-data"))
    assert stored == count_sample_octets(scenario)


@pytest.mark.parametrize("front_end", FRONT_ENDS, ids=name_files)
def test_sigmf_is_the_default_where_it_can_hold_the_samples(front_end: FrontEnd) -> None:
    assert choose_container(front_end) == ("sigmf" if is_fitting(front_end) else "raw")
    assert choose_container(front_end, "raw") == "raw"
    if not is_fitting(front_end):
        with pytest.raises(SettingsError, match='encoding = "int"'):
            choose_container(front_end, "sigmf")


def test_sigmf_is_what_an_independent_reader_takes_for_it(
    arrays: Scenario, navigation: NavigationData, tmp_path: Path
) -> None:
    scene = make_scene(arrays, navigation)
    paths = write_samples(scene, tmp_path, "sigmf")
    assert [path.name for path in paths] == ["one.l.sigmf-meta", "one.r.sigmf-meta", "two.sigmf-meta"]
    for path, sky in zip(paths, scene.skies, strict=True):
        meta = sigmffile.fromfile(path)
        meta.validate()
        data = path.with_name(path.name.replace("-meta", "-data")).read_bytes()
        general, (capture,) = meta.get_global_info(), meta.get_captures()
        assert general["core:sha512"] == hashlib.sha512(data).hexdigest()
        assert general["core:collection"] == "arrays"
        assert general["core:datatype"] == "ci8"
        assert capture["core:datetime"] == "2023-03-04T05:05:49.000000000Z"  # the receiver's own clock, UTC
        reported = (capture if sky.receiver.name == "one" else general)["core:geolocation"]["coordinates"]
        place = sky.point(np.array([0.0])).position_ecef_m[0]
        assert open_recording(path)[0].antenna == sky.antenna.name
        assert reported[:2] == pytest.approx([sky.receiver.lon_deg, sky.receiver.lat_deg], abs=1e-3)
        assert np.isfinite(place).all()
    collection = sigmffile.fromfile(tmp_path / "arrays.sigmf-collection")
    assert isinstance(collection, SigMFCollection)
    collection.verify_stream_hashes()
    assert collection.get_stream_names() == ["one.l", "one.r", "two"]


def test_annotations_stand_where_the_first_wave_arrives(
    arrays: Scenario, navigation: NavigationData, tmp_path: Path
) -> None:
    # By samples of the receiver's own clock: 12.3 us late it begins, and a wave takes under a microsecond.
    scene = make_scene(arrays, navigation)
    write_samples(scene, tmp_path, "sigmf")
    annotations = json.loads((tmp_path / "one.l.sigmf-meta").read_text())["annotations"]
    found = [(a["core:label"], a["core:sample_start"], a["core:sample_count"]) for a in annotations]
    expected = [("noise", 0.1, 0.2), ("meaconer", 0.25, 0.5), ("meaconer", 0.75, 1.0), ("tone", 0.9, 1.0)]
    for (label, first, count), (name, from_s, until_s) in zip(found, expected, strict=True):
        assert label == name
        assert first == pytest.approx((from_s - 1.23e-5) * 1e6, abs=3.0)
        last = 1_000_000 if until_s == 1.0 else (until_s - 1.23e-5) * 1e6
        assert first + count == pytest.approx(last, abs=3.0)
    samples = np.stack([samples.read(0, 1_000_000)[0] for samples in render_samples(arrays, navigation)[:1]])[0]
    first = found[0][1]
    assert samples[first : first + 50_000].std() > 1.3 * samples[first - 50_000 : first].std()


def test_the_same_seed_gives_the_same_bytes(scenario: Scenario, navigation: NavigationData, tmp_path: Path) -> None:
    first, second = (write(scenario, navigation, tmp_path / name)[0].read_bytes() for name in "ab")
    assert first == second
    other = write(scenario.model_copy(update={"seed": 8}), navigation, tmp_path / "c")[0].read_bytes()
    assert first != other


def test_the_sidecar_has_the_agreed_keys(scenario: Scenario, navigation: NavigationData, tmp_path: Path) -> None:
    write(scenario, navigation, tmp_path)
    sidecar = tomllib.loads((tmp_path / "one.toml").read_text())["samples"]
    assert sidecar.pop("start_gpst").startswith("2023-03-04T05:06:07")
    assert sidecar == {
        "rate_hz": 2.6e6,
        "centre_hz": 1575.42e6,
        "if_hz": 0.0,
        "kind": "complex",
        "encoding": "sign",
        "bits": 1,
        "bit_order": "msb-first",
    }


def test_the_truth_says_what_is_false_and_what_it_shows(scenario: Scenario, navigation: NavigationData) -> None:
    truth = json.loads(json.dumps(build_truth(make_scene(scenario, navigation))))
    (attack,) = truth["attacks"]
    assert attack["onset_gpst"] == "2023-03-04T05:06:08.750000000"
    assert attack["captured_receiver_shows_position"] == {"lat_deg": 40.005, "lon_deg": -3.008, "height_m": 700.0}
    assert attack["captured_clock_extra_s"]["one"] == pytest.approx(3.7e-6 + 118.0 / 3e8, rel=0.01)
    first, _ = truth["receivers"]
    assert first["true_start_gpst"] == "2023-03-04T05:06:07.250012300"
    labels = {(row["sat"], row["copy"]): row["label"] for row in first["signals"]}
    assert {labels[sat, "b"] for sat in attack["sats"]} == {"spoofed"}
    false = [row for row in first["signals"] if row["label"] == "spoofed"]
    assert all(300.0 < row["delay_to_authentic_m_first_last"][0] < 2500.0 for row in false)
    assert all(row["from_gpst"].startswith("2023-03-04T05:06:08.7500") for row in false)


def test_progress_ends_with_all_samples(scenario: Scenario, navigation: NavigationData, tmp_path: Path) -> None:
    calls: list[tuple[int, int]] = []
    write(scenario, navigation, tmp_path, progress=lambda done, total: calls.append((done, total)))
    assert calls == sorted(calls)
    assert calls[-1] == (2 * 7_800_000, 2 * 7_800_000)


def test_a_folder_that_is_a_file_is_reported(scenario: Scenario, navigation: NavigationData, tmp_path: Path) -> None:
    place = tmp_path / "taken"
    place.write_text("")
    with pytest.raises(OutputError, match=r"\btaken: "):
        write(scenario, navigation, place)


@pytest.mark.parametrize("container", ["raw", "sigmf"])
def test_an_interruption_leaves_no_file_that_is_not_whole(
    arrays: Scenario, navigation: NavigationData, tmp_path: Path, container: str
) -> None:
    def stop(done: int, total: int) -> None:
        if done > total / 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_samples(make_scene(arrays, navigation), tmp_path, container, progress=stop)
    endings = {"raw": {".bin", ".toml"}, "sigmf": {".sigmf-data", ".sigmf-meta"}}[container]
    assert {path.name for path in tmp_path.iterdir()} == {f"one.l{ending}" for ending in endings}


def test_a_full_disk_is_reported(
    scenario: Scenario, navigation: NavigationData, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(files, "_pack_block", full)
    with pytest.raises(OutputError, match=r"one\.bin .*\bdisk\b"):
        write(scenario, navigation, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["truth.json"]


# --- series


def test_series_on_disk_are_the_series_in_memory(arrays: Scenario, navigation: NavigationData, tmp_path: Path) -> None:
    scene = make_scene(arrays, navigation)
    paths = write_series(scene, tmp_path)
    assert [path.name for path in paths] == list_series_names(scene)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(list_series_names(scene))
    imu = simulate_imus(scene)["one"].read(0, 1000)
    force = {f"accel_{axis}_m_s2": imu.specific_force_m_s2[:, k] for k, axis in enumerate("xyz")}
    expected = {
        "one-truth": compute_trajectory_truth(scene, "one"),
        "two-truth": compute_trajectory_truth(scene, "two"),
        "one.r-signals": compute_signal_truth(scene, "one.r"),
        "one-imu": force,
    }
    for stem, table in expected.items():
        parquet = pq.read_table(tmp_path / f"{stem}.parquet")
        with open(tmp_path / f"{stem}.csv", newline="") as file:
            rows = list(csv.DictReader(file))
        assert rows[0].keys() == set(parquet.column_names)
        for name, column in table.items():
            np.testing.assert_array_equal(parquet[name].to_numpy(), column, err_msg=name)
            if column.dtype.kind == "f":
                np.testing.assert_array_equal([float(row[name]) for row in rows], column, err_msg=name)
    reported = pq.read_table(tmp_path / "one-imu.parquet").schema.metadata
    assert reported[b"grade"] == b"tactical"
    assert b"forward, right, down" in reported[b"axes"]
    assert b"STIM300" in reported[b"errors"]


def test_room_for_the_series_is_guessed_high_but_not_by_much(
    arrays: Scenario, navigation: NavigationData, tmp_path: Path
) -> None:
    scene = make_scene(arrays.model_copy(update={"duration_s": 60.0}), navigation)
    size = sum(path.stat().st_size for path in write_series(scene, tmp_path))
    assert size < estimate_series_octets(scene) < 2 * size


# --- the document


def test_the_truth_of_arrays_clocks_and_interference(
    arrays: Scenario, navigation: NavigationData, tmp_path: Path
) -> None:
    scene = make_scene(arrays, navigation)
    truth = json.loads(write_truth(tmp_path, build_truth(scene, files=["a.bin"])).read_text())
    assert (truth["format"], truth["seed"], truth["files"]) == ("skyproof-truth/1", 7, ["a.bin"])
    assert truth["navigation"] == "nominal constellation"
    left_truth, right, two = truth["receivers"]
    assert (right["name"], right["receiver"], right["antenna"]["body_m"]) == ("one.r", "one", [0.0, 1.0, 0.0])
    assert left_truth["path"] == "circle"
    assert left_truth["position"] != left_truth["position_at_end"]
    assert two["position"] == two["position_at_end"] == {"lat_deg": 40.0004, "lon_deg": -2.9996, "height_m": 650.0}
    assert left_truth["clock_offset_at_end_s"] - left_truth["clock_offset_at_start_s"] == pytest.approx(
        0.7e-6, rel=1e-5
    )
    assert left_truth["clock_drift_at_start"] == pytest.approx(0.7e-6)
    assert left_truth["imu"]["errors"]["source"]
    assert two["imu"] is None
    noise, tone = truth["interference"]
    assert [noise["name"], tone["name"]] == ["noise", "tone"]
    (window,) = noise["heard"]["one.l"]
    assert window[0].startswith("2023-03-04T05:06:07.35000")
    (attack,) = truth["attacks"]
    assert len(attack["heard"]["one.l"]) == len(attack["on_gpst"]) == 2
    assert attack["on_gpst"][1] == ["2023-03-04T05:06:08.000000000", None]


def test_a_takeover_shows_its_target_no_extra_clock(scenario: Scenario, navigation: NavigationData) -> None:
    # It sends as much earlier as the way takes; at another receiver the difference of the ways is left.
    takeover = Takeover(
        transmit=Site(lat_deg=40.003, lon_deg=-3.0, height_m=680.0),
        target="two",
        onset_s=0.0,
        away_points_enu_m=((1.0, 0.0, 0.0, 0.0), (2.0, 30.0, 0.0, 0.0)),
        clock_points_s=((1.0, 0.0), (2.0, 2e-7)),
    )
    scene = make_scene(scenario.model_copy(update={"attacks": (takeover,)}), navigation)
    (attack,) = build_truth(scene)["attacks"]
    assert attack["captured_clock_extra_s"]["two"] == 0.0
    ways_m = scene.path_m[0]
    assert attack["captured_clock_extra_s"]["one"] == pytest.approx((ways_m[0] - ways_m[1]) / 299_792_458.0)
    assert attack["captured_clock_extra_grows_until_end_s"] == pytest.approx(2e-7, rel=0.01)
    start, end = attack["captured_receiver_shows_position"], attack["captured_receiver_shows_position_at_end"]
    assert (end["lon_deg"] - start["lon_deg"]) * 111_320.0 * np.cos(np.radians(40.0)) == pytest.approx(30.0, rel=0.01)
