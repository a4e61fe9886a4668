"""A run that is killed leaves what it has measured and found so far, whole and readable."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from tests.app import kit

from skyproof.formats.pieces import UNFINISHED_RUN
from skyproof.verdict import WORDS

COMMAND = "from skyproof.cli import main; main()"
MOMENTS = 20


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("killed")
    return kit.record(kit.make_scenario(duration_s=34.0), folder)


def start_run(recorded, out: Path, *options: str) -> subprocess.Popen:
    arguments = [*map(str, recorded.paths), "--nav", str(recorded.nav), "--out", str(out), *options]
    return subprocess.Popen(
        [sys.executable, "-c", COMMAND, "protect", *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )


def read(left: Path) -> tuple[int, int]:
    """Read how many rows of measurements and lines of evidence a run has written; all have to be readable."""
    rows = 0
    for path in left.rglob("*.npz"):
        with np.load(path) as piece:
            columns = ("elapsed_s", "arc", *(("table", "sat") if path.parent.name == "measured" else ("value",)))
            lengths = {len(piece[name]) for name in columns} if "arc" in piece else set()
            assert len(lengths) <= 1
            rows += sum(lengths) if path.parent.name == "measured" else 0
    lines = left / "evidence.jsonl"
    evidence = [json.loads(line) for line in lines.read_text().splitlines()] if lines.exists() else []
    assert all(item["detector"] and item["because"] for item in evidence)
    words = left / "words.jsonl"
    decided = [json.loads(line) for line in words.read_text().splitlines()] if words.exists() else []
    assert all(item["word"] in WORDS and item["run"] in WORDS for item in decided)
    return rows, len(evidence)


@pytest.mark.long
def test_a_killed_run_leaves_readable_results_at_any_moment(recording, tmp_path):
    begin = time.monotonic()
    assert start_run(recording, tmp_path / "whole").wait() == 0
    whole_s = time.monotonic() - begin
    names = sorted(path.name for path in (tmp_path / "whole").iterdir())
    assert UNFINISHED_RUN not in names
    rng = np.random.default_rng(1)
    out, found = tmp_path / "out", []
    out.mkdir()
    for _ in range(MOMENTS):
        run = start_run(recording, out, "--overwrite")
        try:
            run.wait(float(rng.uniform(0.05, 1.1)) * whole_s)
        except subprocess.TimeoutExpired:
            run.send_signal(signal.SIGKILL)
            run.wait()
        found.append(read(out / UNFINISHED_RUN))
        present = {path.name for path in out.iterdir() if path.is_file()}
        assert "checksums.sha256" not in present or present >= set(names)
        assert present == set() or "verdict.json" in present
    assert max(rows for rows, _ in found) > 500
    assert start_run(recording, out, "--overwrite").wait() == 0
    assert sorted(path.name for path in out.iterdir() if not path.name.startswith(".")) == names
