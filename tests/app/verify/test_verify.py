"""What a run wrote and read is held against its sums."""

import shutil
import subprocess
from pathlib import Path

import pytest
from tests.app import kit

from skyproof.app.protect import protect
from skyproof.app.verify import verify
from skyproof.cli import main
from skyproof.errors import InputError
from skyproof.formats.rinex_nav import write_nav
from skyproof.formats.rinex_obs import write_obs


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a folder with inputs, and in it one with the outputs."""
    folder = tmp_path_factory.mktemp("run")
    navigation, pair = kit.simulate_measurements(21.0)
    write_obs(folder / "one.obs", pair[0], signals=pair[0].signals, holds="simulated", marker="ONE", version="test")
    write_nav(folder / "brdc.rnx", navigation)
    protect([folder / "one.obs"], nav=folder / "brdc.rnx", out=folder / "out")
    return folder


@pytest.fixture
def run(whole: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(whole, tmp_path / "run"))


def list_states(found, state):
    return {file.name for file in found.files if file.state == state}


def test_what_nobody_touched_is_unchanged(run, capfd):
    found = verify(run / "out", inputs_in=run)
    assert found.unchanged
    assert found.complete
    assert {"verdict.json", "report.html", "fixes.csv", "settings.toml"} < list_states(found, "same")
    assert len(list_states(found, "same")) == len(found.files)
    assert main(["verify", str(run / "out"), "--inputs-in", str(run)]) == 0
    assert "unchanged: " in capfd.readouterr().out


def test_the_sums_are_those_that_other_programs_check(run):
    done = subprocess.run(["sha256sum", "--check", "checksums.sha256"], cwd=run / "out", capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "verdict.json: OK" in done.stdout


@pytest.mark.parametrize("name", ["verdict.json", "fixes.csv", "report.html", "../one.obs"])
def test_one_bit_is_seen(run, name, capfd):
    path = run / "out" / name
    content = bytearray(path.read_bytes())
    content[content.index(b"1")] ^= 1  # another digit: the document can be read as before
    path.write_bytes(content)
    found = verify(run / "out", inputs_in=run)
    assert not found.unchanged
    assert {Path(path_found).name for path_found in list_states(found, "different")} == {path.name}
    assert main(["verify", str(run / "out"), "--inputs-in", str(run)]) == 1
    assert "CHANGED" in capfd.readouterr().out


def test_what_is_gone_or_came_is_named(run):
    (run / "out" / "fixes.csv").unlink()
    (run / "out" / "notes.txt").write_text("mine")
    (run / "brdc.rnx").unlink()
    found = verify(run / "out", inputs_in=run)
    assert list_states(found, "missing") == {"fixes.csv"}
    assert list_states(found, "not of the run") == {"notes.txt"}
    assert {Path(path_found).name for path_found in list_states(found, "not found")} == {"brdc.rnx"}
    assert not found.unchanged
    assert not found.complete


def test_inputs_that_are_elsewhere_leave_it_open(run):
    assert main(["verify", str(run / "out"), "--inputs-in", str(run / "out")]) == 3


def test_without_sums_it_says_what_to_give(run):
    (run / "out" / "checksums.sha256").unlink()
    with pytest.raises(InputError, match=r"checksums\.sha256"):
        verify(run / "out")


def test_a_line_that_is_no_sum_is_named(run):
    sums = run / "out" / "checksums.sha256"
    sums.write_text(sums.read_text() + "abc  ../../etc/passwd\n")
    count = len(sums.read_text().splitlines())
    with pytest.raises(InputError, match=rf"line {count}: .*\b64\b"):
        verify(run / "out")
