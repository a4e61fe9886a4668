"""What is in a folder already, who else writes into it, and what does not fit on its disk."""

import json
import os
import re
import resource
import shutil
from pathlib import Path

import pytest

from skyproof import cli
from skyproof.app.common.folder import claim
from skyproof.app.protect import protect
from skyproof.errors import IncompleteOutput
from skyproof.formats.verdict import read_verdict


def read_octets(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


@pytest.fixture(scope="session")
def finished(tmp_path_factory, wide) -> Path:
    """Run the command to its end and return its output folder."""
    folder = tmp_path_factory.mktemp("ended") / "out"
    protect([wide], out=folder)
    return folder


def test_a_rerun_is_refused_before_the_work(run, wide, finished, no_tracking):
    before = read_octets(finished)
    ended = run(wide, out=finished)
    assert ended.code == 2
    assert re.search(rf"{re.escape(str(finished))}\b.*\bearlier\b.*--out\b", ended.stderr[-1])
    assert "--overwrite" in ended.stderr[-1]
    assert read_octets(finished) == before


def test_a_rerun_replaces_what_it_wrote_if_asked_to(run, wide, finished, tmp_path):
    folder = shutil.copytree(finished, tmp_path / "out")
    older = json.loads((folder / "verdict.json").read_text())
    older["receivers"].append(older["receivers"][0] | {"name": "mast"})
    (folder / "verdict.json").write_text(json.dumps(older))
    for name in ("mast-authentic.obs", "mast-other-2.obs"):
        (folder / name).write_text("old")
    (folder / "notes.txt").write_text("mine")
    assert run(wide, out=folder, options=["--overwrite"]).code == 0
    assert read_octets(folder) == read_octets(finished) | {"notes.txt": b"mine"}


@pytest.mark.parametrize("name", ["report.html", "settings.toml", "bow-unknown.obs", "unfinished-run"])
@pytest.mark.parametrize("options", [[], ["--overwrite"]])
def test_a_file_of_somebody_else_is_never_overwritten(run, wide, tmp_path, no_tracking, name, options):
    (tmp_path / "out").mkdir()
    if name == "unfinished-run":
        (tmp_path / "out" / name).mkdir()
        (tmp_path / "out" / name / "mine.txt").write_text("mine")
    else:
        (tmp_path / "out" / name).write_text("mine")
    ended = run(wide, options=options)
    assert ended.code == 2
    assert re.search(rf"\b{re.escape(name)} .*\boverwritten\b", ended.stderr[-1])
    assert [path.read_text() for path in (tmp_path / "out").rglob("*") if path.is_file()] == ["mine"]


def test_files_of_other_names_are_no_hindrance(run, wide, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "rx9-unknown.obs").write_text("mine")
    assert run(wide).code == 0
    assert (tmp_path / "out" / "rx9-unknown.obs").read_text() == "mine"


def test_a_run_into_a_folder_that_has_one_is_refused_at_once(run, wide, tmp_path, no_tracking):
    with claim(tmp_path / "out"):
        ended = run(wide)
        assert ended.code == 2
        assert re.search(r"\banother run\b.*--out$", ended.stderr[-1])
        assert (tmp_path / "out").is_dir()


@pytest.mark.parametrize("command", ["protect", "receive"])
def test_a_run_that_is_refused_leaves_no_folder(tmp_path, command):
    assert cli.main([command, str(tmp_path / "none.bin"), "--out", str(tmp_path / "a" / "out")]) == 2
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def fill_disk():
    """Limit how many bytes files may take, as on a disk that is full."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield lambda octets: resource.setrlimit(resource.RLIMIT_FSIZE, (octets, before[1]))
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_full_disk_loses_what_does_not_fit_and_not_the_answer(run, wide, finished, fill_disk):
    sizes = {name: len(octets) for name, octets in read_octets(finished).items()}
    fill_disk(sizes["verdict.json"] + 500)
    ended = run(wide, options=["--json"])
    fill_disk(resource.RLIM_INFINITY)
    assert ended.code == 2
    fits = {name for name, size in sizes.items() if size < sizes["verdict.json"]}
    assert {"verdict.json", "settings.toml"} <= read_octets(ended.folder).keys() <= fits | {"verdict.json"}
    assert json.loads(ended.stdout) == json.loads((ended.folder / "verdict.json").read_text())
    missing = sizes.keys() - read_octets(ended.folder).keys()
    assert {"report.html", "checksums.sha256"} <= missing
    assert all(name in ended.stderr[-1] for name in missing)
    assert sorted(os.listdir(ended.folder)) == sorted(read_octets(ended.folder))
    assert run(wide, options=["--overwrite"]).code == 0
    assert read_octets(ended.folder).keys() == sizes.keys()


def test_a_full_disk_leaves_the_answer_on_the_terminal(run, wide, finished, fill_disk):
    fill_disk(100)
    ended = run(wide, options=["--json", "--exit-code"])
    fill_disk(resource.RLIM_INFINITY)
    assert ended.code == 2
    assert json.loads(ended.stdout)["verdict"] == read_verdict(finished / "verdict.json").verdict
    assert "verdict.json" in ended.stderr[-1]
    assert not ended.folder.exists()


def test_from_python_the_error_holds_the_answer(wide, tmp_path, monkeypatch):
    monkeypatch.setattr("skyproof.app.protect.outputs.write_report_html", lambda *_: 1 / 0)
    with pytest.raises(
        IncompleteOutput, match=r"lacks report.html, checksums.sha256: unexpected ZeroDivision"
    ) as raised:
        protect([wide], out=tmp_path / "out")
    assert raised.value.result.verdict == read_verdict(tmp_path / "out" / "verdict.json")


def test_received_files_are_replaced_only_if_asked_to(pair, tmp_path, monkeypatch, capsys):
    command = ["receive", str(pair.paths[0]), "--nav", str(pair.nav), "--out", str(tmp_path)]
    assert cli.main(command) == 0
    before = read_octets(tmp_path)
    with monkeypatch.context() as patched:
        patched.setattr("skyproof.app.receive.run.track", lambda *_: pytest.fail("the work began before the check"))
        assert cli.main(command) == 2
        assert re.search(r"\bearlier: bow-nav\.rnx, bow\.obs;", capsys.readouterr().err)
    (tmp_path / "bow-3.obs").write_bytes(before["bow.obs"])
    assert cli.main([*command, "--overwrite"]) == 0
    assert read_octets(tmp_path) == before
    (tmp_path / "bow.obs").write_text("foreign")
    assert cli.main([*command, "--overwrite"]) == 2
    assert re.search(r"\bbow\.obs .*\boverwritten\b", capsys.readouterr().err)
    assert (tmp_path / "bow.obs").read_text() == "foreign"


def test_received_files_that_do_not_fit_are_named(pair, tmp_path, fill_disk, capsys):
    fill_disk(100)
    code = cli.main(["receive", str(pair.paths[0]), "--nav", str(pair.nav), "--out", str(tmp_path / "out"), "--json"])
    fill_disk(resource.RLIM_INFINITY)
    out, err = capsys.readouterr()
    assert code == 2
    assert json.loads(out)["receivers"][0]["n_signals"] > 4
    assert re.search(r"\bbow-nav\.rnx, bow\.obs: .*\btoo large\b", err)
