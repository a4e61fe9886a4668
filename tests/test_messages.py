"""Each error says what came, what was expected and what to do: those that no other test raises, and their table."""

import ast
import json
import re
import tarfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import BaseModel, Field, ValidationError
from tests.facts import match_facts
from tests.messages import (
    NEVER_RAISED,
    Message,
    Site,
    _list_sites_in,
    list_sites,
    list_unraised,
    make_table,
    shorten_paths,
)

from skyproof import cli
from skyproof.app.common.platform import read_platform
from skyproof.app.common.progress import Silent
from skyproof.app.common.settings import Settings, resolve_settings
from skyproof.app.receive.inputs import open_inputs
from skyproof.app.receive.snapshot import snapshot
from skyproof.app.scenes.demo import demo
from skyproof.app.scenes.simulate import simulate
from skyproof.detectors.array.array_common import ArrayCommonSettings
from skyproof.detectors.array.ins_array import InsArraySettings
from skyproof.detectors.array.spin import SpinSettings
from skyproof.detectors.second_signals.detector import SecondSignalsSettings
from skyproof.errors import InputError, NotEnoughData, OutputError, ScenarioError, SettingsError, describe_fault
from skyproof.formats import byte_io, sigmf
from skyproof.formats.atomic_write import OutputStep, write_in_turn
from skyproof.formats.crinex import expand
from skyproof.formats.raw import read_sidecar
from skyproof.formats.sigmf import open_sigmf
from skyproof.records import Samples
from skyproof.simulator.scenario import parse_scenario, read_scenario
from skyproof.studies.position_filter_state import FilterSettings

# --- settings


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[protect]\nwindow_s = 1\n", "protect.window_s = 1 … 2"),
        ('[protect]\nwindow_s = "long"\n', 'protect.window_s = "long" … number'),
        ("[protect]\nplace_deg = [57.7]\n", "protect.place_deg[1] is missing"),
        (
            "[protect]\nstart = 3\n",
            "protect.start: … start_s? … : false_alarm_probability_per_hour, ",
        ),
        ("[protect]\nqqqq = 3\n", "protect.qqqq: … : false_alarm_probability_per_hour, "),
        ("protect = 3\n", "protect = 3 … table"),
        ("[protect\n", "(at line 1, column 9)"),
        (
            "[protect]\nstart_s = -1\nsmoothing_s = 0\n",
            "protect.smoothing_s = 0 … 0; protect.start_s = -1",
        ),
    ],
)
def test_a_wrong_platform_file_is_refused_by_file_and_key(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "platform.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises((SettingsError, InputError)) as raised:
        read_platform(path)
    assert str(raised.value).startswith(f"{path}: ")
    assert re.search(match_facts(words), str(raised.value))


def test_a_wrong_option_is_refused_as_a_setting(tmp_path: Path) -> None:
    path = tmp_path / "platform.toml"
    path.write_text("[protect]\nstart_s = 1\n", encoding="utf-8")
    with pytest.raises(SettingsError, match=r"^setting start_s = -2\.0, .*\b0\b"):
        resolve_settings(read_platform(path).protect, start_s=-2.0)
    with pytest.raises(InputError, match=r"none\.toml: .*exist"):
        read_platform(tmp_path / "none.toml")


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: ArrayCommonSettings(false_alarm_probability=0.0), "array_common: false_alarm_probability is 0.0"),
        (lambda: InsArraySettings(false_alarm_probability=1.0), "ins_array: false_alarm_probability is 1.0"),
        (
            lambda: SecondSignalsSettings(unexplained_probability=float("nan")),
            "second_signals: unexplained_probability is nan",
        ),
        (lambda: SpinSettings(false_alarm_probability=-1.0), "spin: false_alarm_probability is -1.0"),
        (lambda: FilterSettings(false_alarm_probability=2.0), "filter: false_alarm_probability is 2.0"),
    ],
)
def test_what_is_no_probability_is_refused(make: Callable[[], object], words: str) -> None:
    with pytest.raises(SettingsError) as raised:
        make()
    assert str(raised.value).startswith(f"{words}, ")


def test_a_number_of_echoes_is_more_than_zero() -> None:
    with pytest.raises(SettingsError, match=r"second_signals: echoes_per_satellite is 0\b"):
        SecondSignalsSettings(echoes_per_satellite=0.0)


def test_an_error_time_of_a_filter_is_more_than_zero() -> None:
    with pytest.raises(SettingsError, match=r"filter: error_time_s is 0\.0,"):
        FilterSettings(error_time_s=0.0)


# --- scenarios


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({}, "scenario: start_gpst … duration_s … receivers"),
        ({"receivers": []}, "receivers holds 0 … 1"),
        ({"receivers": 3}, "receivers = 3 … list"),
        ({"seed": "x"}, 'seed = "x" … number'),
        ({"receivers": [3]}, "receivers[0] = 3 … table"),
    ],
)
def test_a_wrong_scenario_names_what_came_and_what_was_expected(table: dict[str, Any], words: str) -> None:
    with pytest.raises(ScenarioError) as raised:
        parse_scenario(table)
    assert re.search(match_facts(words), str(raised.value))


def test_a_members_fault_does_not_make_a_list_too_short() -> None:
    with pytest.raises(ScenarioError) as raised:
        parse_scenario({"receivers": [{"name": "a", "lat_deg": 1.0, "lon_deg": 2.0, "height_m": -600.0}]})
    assert re.search(match_facts("receivers[0].height_m = -600.0 … -500"), str(raised.value))
    assert "holds" not in str(raised.value)


def test_a_scenario_that_cannot_be_read_says_why(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"none\.toml: .*exist"):
        read_scenario(tmp_path / "none.toml")
    (tmp_path / "a.toml").write_bytes(b"a\xff\xfe")
    with pytest.raises(ScenarioError, match=r"a\.toml: byte 1 .*UTF-8"):
        read_scenario(tmp_path / "a.toml")


SCENE = """
start_gpst = "2024-05-14T10:00:00"
duration_s = 60.0
[[receivers]]
name = "one"
path = { kind = "file", path = "way.csv" }
"""


def test_a_path_that_is_shorter_than_the_scene_is_refused(tmp_path: Path) -> None:
    rows = [f"{t},57.7,{11.9 + 1e-5 * t:.6f},20" for t in range(30)]
    (tmp_path / "way.csv").write_text("\n".join(["t_s,lat_deg,lon_deg,height_m", *rows]), encoding="ascii")
    (tmp_path / "scene.toml").write_text(SCENE, encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"receivers\[0\]\.path: .*start_s"):
        simulate(tmp_path / "scene.toml", out=tmp_path / "out", depth="measurements")


# --- recordings


def write_recording(path: Path) -> Path:
    path.write_bytes(np.random.default_rng(1).bytes(4000))
    keys = 'rate_hz = 1e6\nkind = "complex"\nencoding = "int"\nbits = 8\n'
    path.with_suffix(".toml").write_text(f"[samples]\n{keys}", encoding="utf-8")
    return path


def test_a_start_behind_the_end_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"rx1\.bin: .*\b0\.002 s, .*\bstart_s is 3;"):
        open_inputs([write_recording(tmp_path / "rx1.bin")], Settings(start_s=3.0))


def test_a_moment_of_samples_without_a_date_asks_for_one() -> None:
    samples = Samples(name="rx1", rate_hz=1e6, n_samples=1000, read=lambda _, count: np.zeros((2, count), np.float32))
    with pytest.raises(NotEnoughData, match=r"rx1: .*start_gpst"):
        snapshot(samples, None)  # type: ignore[arg-type]


def test_files_that_the_system_refuses_are_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_recording(tmp_path / "rx1.bin")

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(byte_io.os, "preadv", refuse)
    with pytest.raises(InputError, match=r"rx1\.bin .*\(Permission denied\)"):
        open_inputs([path], Settings())
    with pytest.raises(InputError, match=r"sidecar .*\(Is a directory\)"):
        read_sidecar(tmp_path)


def write_sigmf_files(folder: Path, data: bytes, captures: list[dict[str, Any]], **more: Any) -> Path:
    meta = {
        "global": {"core:datatype": "ci8", "core:sample_rate": 1e6, "core:version": "1.2.0"} | more,
        "captures": captures,
        "annotations": [],
    }
    (folder / "rec.sigmf-data").write_bytes(data)
    (folder / "rec.sigmf-meta").write_text(json.dumps(meta), encoding="utf-8")
    return folder / "rec.sigmf-meta"


def test_a_capture_that_begins_within_a_byte_is_refused(tmp_path: Path) -> None:
    packed = {"core:datatype": "ri8", "skyproof:encoding": "sign", "skyproof:bits": 1, "skyproof:if_hz": 2e5}
    path = write_sigmf_files(
        tmp_path, bytes(range(256)), [{"core:sample_start": 0}, {"core:sample_start": 3}], **packed
    )
    with pytest.raises(InputError, match=r"captures\[1\]\.core:sample_start = 3 .*\bbyte"):
        open_sigmf(path)


def test_samples_in_the_place_of_metadata_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_sigmf_files(tmp_path, bytes(range(256)), [{"core:sample_start": 0}])
    monkeypatch.setattr(sigmf, "METADATA_BYTES", 10)
    with pytest.raises(InputError, match=r"\bSigMF .*\.sigmf-meta"):
        open_sigmf(path)


def test_an_archive_that_is_cut_before_its_samples_is_refused(tmp_path: Path) -> None:
    path = write_sigmf_files(tmp_path, bytes(range(256)) * 8, [{"core:sample_start": 0}])
    with tarfile.open(tmp_path / "rec.sigmf", "w") as tar:
        for item in (path, path.with_suffix(".sigmf-data")):
            tar.add(item, f"rec/{item.name}")
    with tarfile.open(tmp_path / "rec.sigmf") as tar:
        begin = tar.getmember("rec/rec.sigmf-data").offset_data
    whole = (tmp_path / "rec.sigmf").read_bytes()
    (tmp_path / "rec.sigmf").write_bytes(whole[:begin])
    with pytest.raises(InputError, match=r"rec/rec\.sigmf-data, .*\bcut\b"):
        open_sigmf(tmp_path / "rec.sigmf")


def test_foreign_or_endless_compact_rinex_is_refused() -> None:
    head = f"{'2.0':20}{'COMPACT RINEX FORMAT':40}CRINEX VERS   / TYPE"
    with pytest.raises(InputError, match=r"a\.crx, line 1: .*'2\.0', .*\b1\.0 or 3\.0"):
        expand(f"{head}\n".encode(), source="a.crx")
    with pytest.raises(InputError, match=r"a\.crx, line 2: .*END OF HEADER"):
        expand(f"{head.replace('2.0', '3.0')}\nany\n".encode(), source="a.crx")


# --- the folder


def refuse(*_: object, **__: object) -> None:
    raise PermissionError(13, "Permission denied")


def test_what_cannot_be_removed_of_an_earlier_run_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "nav.rnx").write_text("old", encoding="ascii")
    scene = ["clean", "--depth", "measurements", "--duration-s", "2"]
    assert cli.main(["simulate", *scene, "--out", str(tmp_path / "scene")]) == 0
    monkeypatch.setattr(Path, "unlink", refuse)
    step = OutputStep(("a",), lambda part: (part / "a").touch())
    (unwritten,) = write_in_turn(tmp_path, [step], instead_of=["nav.rnx"])
    assert re.search(r"\(Permission denied\): .*\bfolder\b", str(unwritten.error))
    with pytest.raises(OutputError, match=r"\bearlier run .*Permission denied.*--out"):
        simulate("clean", depth="measurements", duration_s=2.0, out=tmp_path / "scene", overwrite=True)


def test_a_study_says_that_its_folder_cannot_be_made(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "taken").touch()
    assert cli.main(["study", "spin.roc", "--out", str(tmp_path / "taken" / "in")]) == 2
    assert re.search(r"\(Not a directory\); .*--out", capsys.readouterr().err)


def test_a_demo_that_is_interrupted_names_what_is_whole(tmp_path: Path) -> None:
    class Impatient(Silent):
        def advance(self, to: float) -> None:
            raise KeyboardInterrupt

    (tmp_path / "older.bin").touch()
    with pytest.raises(KeyboardInterrupt) as raised:
        demo(tmp_path, progress=Impatient())
    assert str(raised.value).endswith(f"{tmp_path}: truth.json")
    assert {path.name for path in tmp_path.iterdir()} == {"truth.json", "older.bin"}


# --- words of faults


class Whole(BaseModel):
    number: float = Field(1.0, ge=0.0, lt=5.0)
    many: list[int] = Field(default_factory=list, max_length=2)
    word: str = ""
    switch: bool = False


def list_faults(content: Any) -> list[str]:
    try:
        Whole.model_validate(content, strict=True)
    except ValidationError as error:
        return [describe_fault(".".join(map(str, fault["loc"])), fault) for fault in error.errors()]
    return []


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"number": -1.0}, "number = -1.0, expected 0 or more"),
        ({"number": 5.0}, "number = 5.0, expected less than 5"),
        ({"number": "x" * 99}, f'number = "{"x" * 56}..., expected a number'),
        ({"many": [1, 2, 3]}, "many holds 3, expected 2"),
        ({"many": 1}, "many = 1, expected a list"),
        ({"word": 1}, "word = 1, expected a text"),
        ({"switch": "on"}, 'switch = "on", expected true or false'),
        (3, "the whole = 3, expected a table"),
    ],
)
def test_a_fault_names_place_what_came_and_what_was_expected(content: Any, words: str) -> None:
    assert list_faults(content) == [words]


# --- the table of all messages


WORDS = "/home/someone/rx1.bin: 7 of 8 | *bytes*; mend it"
MESSAGE = Message("InputError", "formats/a.py", 12, WORDS, "tests/a.py::test")


def test_messages_that_differ_in_numbers_only_are_one() -> None:
    other = Message("InputError", "formats/a.py", 12, "/tmp/x/rx1.bin: 5 of 12 | *bytes*; mend it", "tests/b.py::test")
    assert MESSAGE.key == other.key
    assert MESSAGE.key != Message("InputError", "formats/a.py", 13, MESSAGE.words, MESSAGE.test).key


def test_the_table_shows_messages_as_printed_without_folders() -> None:
    text = make_table([MESSAGE])
    assert "## formats/a.py" in text
    assert "| InputError | rx1.bin: 7 of 8 &#124; &#42;bytes&#42;; mend it | 12 | tests/a.py::test |" in text


def test_folders_are_left_out_and_other_strokes_stay() -> None:
    assert shorten_paths("`/a/b/c d.bin`: 3 m/s, ENU/N/U; and/or") == "`/a/b/c d.bin`: 3 m/s, ENU/N/U; and/or"
    assert shorten_paths("no /a/b/c.bin beside it, /a/b") == "no c.bin beside it, b"


def test_a_place_whose_error_was_not_seen_is_reported() -> None:
    seen = [Message("InputError", site.file, site.first_line, "", "") for site in list_sites()]
    assert len(seen) > 150
    assert list_unraised(seen) == []
    left_out = next(site for site in list_sites() if site.name not in NEVER_RAISED)
    missing = list_unraised([message for message in seen if not left_out.made(message)])
    assert [site.name for site in missing] == [left_out.name]


def test_a_place_is_found_wherever_the_error_is_made() -> None:
    code = "def f():\n    if x:\n        raise InputError(\n            'a')\n    faults.append(InputError('b'))\n"
    found: Iterator[Site] = _list_sites_in(ast.parse(code), "a.py", {"InputError"})
    assert list(found) == [Site("a.py", "f", 3, 4), Site("a.py", "f", 5, 5)]


def test_reasons_are_given_for_places_that_exist() -> None:
    assert set(NEVER_RAISED) <= {site.name for site in list_sites()}
