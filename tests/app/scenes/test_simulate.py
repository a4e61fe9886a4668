"""The data of a scene: everything is there, everything agrees, and the resolved scenario makes the same bytes again."""

import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from skyproof.app.scenes import simulate as module
from skyproof.app.scenes.simulate import (
    load_ready_made,
    load_scenario,
    simulate,
    write_document_json,
    write_ready_made_json,
)
from skyproof.errors import OutputError, ScenarioError, SettingsError
from skyproof.formats.recording import open_recording
from skyproof.formats.rinex_nav import read_nav, write_nav
from skyproof.formats.rinex_obs_read import read_obs
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.logs.stream import read_log
from skyproof.records import SignalId
from skyproof.simulator.scenario import FrontEnd, Meaconer, Scenario, SceneImu, ScenePlace, SceneReceiver
from skyproof.simulator.sky import make_scene
from skyproof.simulator.truth import compute_signal_truth

START = np.datetime64("2024-05-14T09:59:58", "ns")
TABLES = (".csv", ".parquet")


def make_small(**changes: object) -> Scenario:
    """Make two receivers and a meaconer for four seconds, at a million samples of one bit a second."""
    made = Scenario(
        name="small",
        seed=5,
        start_gpst=START,
        duration_s=4.0,
        front_end=FrontEnd(rate_hz=1e6),
        receivers=(
            SceneReceiver(
                name="bow",
                lat_deg=57.7012,
                lon_deg=11.9321,
                height_m=52.0,
                start_offset_s=2.1e-5,
                clock_offset_s=1.9e-4,
                lo_ppm=0.4,
                imu=SceneImu(rate_hz=10.0, grade="navigation"),
            ),
            SceneReceiver(name="stern", lat_deg=57.7009, lon_deg=11.93295, height_m=51.0, clock_offset_s=-2.7e-4),
        ),
        attacks=(
            Meaconer(
                receive=ScenePlace(lat_deg=57.6951, lon_deg=11.9405, height_m=66.0),
                transmit=ScenePlace(lat_deg=57.7018, lon_deg=11.9333, height_m=58.0),
                delay_s=4e-6,
                onset_s=1.0,
            ),
        ),
    )
    return made.model_copy(update=changes)


def read_octets(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


class Watch:
    """Progress that notes what is said and how far it was."""

    def __init__(self) -> None:
        self.said: list[str] = []
        self.done: dict[str, list[float]] = {}

    def say(self, text: str) -> None:
        self.said.append(text)

    @contextmanager
    def stage(self, name: str, total: float) -> Iterator["Watch"]:
        self.name = name
        self.done[name] = [0.0]
        yield self
        assert self.done[name][-1] == total

    def advance(self, to: float) -> None:
        self.done[self.name].append(to)


def test_all_that_is_made(tmp_path: Path) -> None:
    watch = Watch()
    result = simulate(make_small(), out=tmp_path / "out", progress=watch)
    names = {"scenario.toml", "broadcast.rnx", "truth.json"}
    names |= {f"{name}{ending}" for name in ("bow", "stern") for ending in (".bin", ".toml", ".obs", "-2.obs")}
    stems = ("bow-truth", "stern-truth", "bow-signals", "stern-signals", "bow-imu")
    names |= {f"{stem}{ending}" for stem in stems for ending in TABLES}
    assert set(read_octets(tmp_path / "out")) == set(result.files) == names
    assert [path.name for path in result.recordings] == ["bow.bin", "stern.bin"]
    assert [path.name for path in result.observations] == ["bow.obs", "bow-2.obs", "stern.obs", "stern-2.obs"]
    assert json.loads((tmp_path / "out" / "truth.json").read_text())["files"] == list(result.files)
    assert watch.said[0].startswith("scene small: ")
    assert all(done == sorted(done) for done in watch.done.values())
    for path in result.recordings:
        (samples,) = open_recording(path)
        assert samples.duration_s == 4.0
    document = json.loads(write_document_json(result))
    assert document["format"] == "skyproof-simulate/1"
    assert document["files"] == list(result.files)


def test_the_resolved_scenario_makes_the_same_bytes(tmp_path: Path) -> None:
    navigation = tmp_path / "day.22n"
    write_nav(navigation, make_nominal_constellation(START))
    simulate(make_small(navigation=navigation), out=tmp_path / "a", seed=9)
    simulate(tmp_path / "a" / "scenario.toml", out=tmp_path / "b")
    first = read_octets(tmp_path / "a")
    assert first == read_octets(tmp_path / "b")
    simulate(tmp_path / "a" / "scenario.toml", out=tmp_path / "a", overwrite=True)  # over itself
    assert first == read_octets(tmp_path / "a")
    other = simulate(make_small(navigation=navigation), out=tmp_path / "c", seed=10, depth="measurements")
    differ = {name for name in other.files if first[name] != (tmp_path / "c" / name).read_bytes()}
    assert {"bow.obs", "stern-2.obs", "bow-imu.csv", "scenario.toml", "truth.json"} <= differ
    assert "bow-signals.csv" not in differ  # where things are is not a matter of chance


def test_observations_are_the_truth_and_noise(tmp_path: Path) -> None:
    # Every copy in the file of its letter, with the label that it has.
    made = make_small(duration_s=20.0)
    result = simulate(made, out=tmp_path, depth="measurements")
    assert not list(tmp_path.glob("*.bin"))
    table = compute_signal_truth(make_scene(made, read_nav(tmp_path / "broadcast.rnx")), "bow")
    for name, letter, label in (("bow.obs", "a", "authentic"), ("bow-2.obs", "b", "spoofed")):
        assert tmp_path / name in result.observations
        observations = read_obs(tmp_path / name).observations
        errors = []
        for row in np.flatnonzero(table["copy"] == letter):
            column = observations.signals.index(SignalId(table["sat"][row]))
            epochs = np.flatnonzero(observations.gpst == table["receiver_gpst"][row])
            errors += (observations.pseudorange_m[epochs, column] - table["pseudorange_m"][row]).tolist()
        assert len(errors) > 100
        assert 0.1 < np.nanstd(errors) < 10.0
        assert f"Signals labelled {label}:" in (tmp_path / name).read_text()


def test_a_log_follows_the_strongest_copy_and_has_fixes(tmp_path: Path) -> None:
    result = simulate(make_small(duration_s=20.0), out=tmp_path, depth="measurements", log="ubx")
    assert [path.name for path in result.logs] == ["bow.ubx", "stern.ubx"]
    (piece,) = read_log([(tmp_path / "bow.ubx").read_bytes()], "bow")
    files = [read_obs(tmp_path / name).observations for name in ("bow.obs", "bow-2.obs")]
    assert piece.observations.gpst.tolist() == files[0].gpst.tolist() == piece.fixes.gpst.tolist()
    for column, signal in enumerate(piece.observations.signals):
        for k, gpst in enumerate(piece.observations.gpst):
            code_m = piece.observations.pseudorange_m[k, column]
            copies_m = [o.pseudorange_m[o.gpst == gpst, o.signals.index(signal)] for o in files if signal in o.signals]
            assert np.nanmin(np.abs(np.concatenate(copies_m) - code_m)) < 1e-3  # of RINEX
    assert {frames.kind for frames in piece.frames} == {"LNAV"}
    with pytest.raises(SettingsError, match="depth"):
        simulate(make_small(), out=tmp_path / "b", depth="samples", log="ubx")
    assert not (tmp_path / "b").exists()


def test_sigmf_where_it_can_be(tmp_path: Path) -> None:
    eight = make_small(front_end=FrontEnd(rate_hz=1e6, encoding="int", bits=8), duration_s=2.0)
    result = simulate(eight, out=tmp_path / "a", depth="samples")
    assert [path.name for path in result.recordings] == ["bow.sigmf-meta", "stern.sigmf-meta"]
    assert "small.sigmf-collection" in result.files
    assert result.observations == ()
    assert simulate(eight, out=tmp_path / "b", depth="samples", container="raw").recordings[0].name == "bow.bin"
    with pytest.raises(SettingsError, match=r"\braw\b"):
        simulate(make_small(), out=tmp_path / "c", container="sigmf")
    assert not (tmp_path / "c").exists()


def test_two_runs_never_mix(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("stays")
    simulate(make_small(), out=tmp_path, depth="measurements")
    single = make_small(receivers=make_small().receivers[:1])
    result = simulate(single, out=tmp_path, depth="measurements", overwrite=True)
    assert set(read_octets(tmp_path)) == {*result.files, "mine.txt"}


@pytest.mark.parametrize(
    "text",
    [
        '{"files": ["mine.txt"]}',
        "[]",
        "no JSON",
        '{"format": "skyproof-truth/1"}',
        '{"format": "skyproof-truth/1", "files": ["../mine.txt", 7]}',
    ],
)
def test_what_is_not_ours_is_not_removed(tmp_path: Path, text: str) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    for place in (tmp_path, folder):
        (place / "mine.txt").write_text("stays")
    (folder / "truth.json").write_text(text)
    assert folder / "mine.txt" not in module.read_earlier_scene(folder)[1]


def make(folder: Path, **options: object) -> None:
    simulate("clean", depth="measurements", duration_s=2.0, out=folder, **options)  # type: ignore[arg-type]


def test_a_scene_is_replaced_only_if_asked_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make(tmp_path)
    before = read_octets(tmp_path)
    (tmp_path / "mine.txt").write_text("mine")
    with monkeypatch.context() as patched:
        patched.setattr(module, "make_navigation", lambda _: pytest.fail("the work began before the check"))
        with pytest.raises(OutputError, match=r"\bearlier\b.*--overwrite"):
            make(tmp_path, seed=9)
    assert read_octets(tmp_path) == before | {"mine.txt": b"mine"}
    make(tmp_path, seed=9, overwrite=True)
    after = read_octets(tmp_path)
    assert after.pop("mine.txt") == b"mine"
    assert after.keys() == before.keys()
    assert after["truth.json"] != before["truth.json"]


@pytest.mark.parametrize("overwrite", [False, True])
def test_a_file_of_somebody_else_is_not_overwritten(tmp_path: Path, overwrite: bool) -> None:
    (tmp_path / "broadcast.rnx").write_text("mine")
    with pytest.raises(OutputError, match=r"broadcast\.rnx .*overwritten"):
        make(tmp_path, overwrite=overwrite)
    assert read_octets(tmp_path) == {"broadcast.rnx": b"mine"}


def test_what_a_killed_run_left_is_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patched:
        patched.setattr(module, "write_series", lambda *_, **__: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            make(tmp_path)
    assert (tmp_path / "truth.json").exists()
    make(tmp_path, overwrite=True)


def test_an_interruption_leaves_whole_files_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = simulate(make_small(), out=tmp_path / "whole")

    class Impatient(Watch):
        @contextmanager
        def stage(self, name: str, total: float) -> Iterator[Watch]:
            self.name = name
            yield self

        def advance(self, to: float) -> None:
            if "samples" in self.name and to > 0.5:
                raise KeyboardInterrupt

    result = simulate(make_small(), out=tmp_path / "part", progress=Impatient())
    assert result.interrupted
    written = read_octets(tmp_path / "part")
    assert set(written) == set(result.files) == set(whole.files) - {"stern.bin", "stern.toml"}
    assert {name: (tmp_path / "whole" / name).read_bytes() for name in written} == written
    assert [path.name for path in result.recordings] == ["bow.bin"]


def test_too_little_room_is_reported_before_anything_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(module.shutil, "disk_usage", lambda _: usage._replace(free=1_500_000))
    with pytest.raises(OutputError, match=r"\d MB .*\b1\.5 MB\b"):
        simulate(make_small(), out=tmp_path)
    assert read_octets(tmp_path) == {}
    simulate(make_small(), out=tmp_path, depth="measurements")


def test_names_that_would_meet_in_one_file_are_reported(tmp_path: Path) -> None:
    first, second = make_small().receivers
    with pytest.raises(ScenarioError, match=r"scenario\.toml"):
        simulate(make_small(receivers=(first, second.model_copy(update={"name": "scenario"}))), out=tmp_path)
    assert read_octets(tmp_path) == {}


def test_measurements_of_a_moment_are_refused_or_left_out(tmp_path: Path) -> None:
    short = make_small(duration_s=1.5)
    with pytest.raises(ScenarioError, match=r"duration_s: 1\.5 s; .*\b2 s"):
        simulate(short, out=tmp_path, depth="measurements")
    watch = Watch()
    result = simulate(short, out=tmp_path, progress=watch)
    assert result.observations == ()
    assert any("none" in line for line in watch.said)


def test_every_ready_made_scene_has_a_sentence_and_can_be_run() -> None:
    assert {"takeover", "clean", "spin"} <= set(load_ready_made())
    listed = json.loads(write_ready_made_json())["scenes"]
    assert [item["name"] for item in listed] == list(load_ready_made())
    assert all(item["description"].endswith(".") for item in listed)
    assert load_scenario("takeover").name == "takeover"


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("takover", "'takeover'"),
        ("xyzzy", "simulate --list"),
        ("no/where", r"no/where.*exist"),
        ("none.toml", r"none\.toml.*exist"),
    ],
)
def test_a_scene_that_is_not_there_is_reported(name: str, words: str) -> None:
    with pytest.raises(ScenarioError, match=words):
        load_scenario(name)


def test_a_folder_with_the_name_of_a_scene_is_no_scenario(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "takeover").mkdir()
    assert load_scenario("takeover").name == "takeover"


def test_sizes_are_written_in_words() -> None:
    words = [module._size(octets) for octets in (0, 1500, 999_400, 999_600, 21_400_000, 2e9, 5e12)]
    assert words == ["0 kB", "1.5 kB", "999 kB", "1 MB", "21.4 MB", "2 GB", "5000 GB"]
