"""Damaged files through every reader end in data or in an error of our own, in five seconds and a gibibyte."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from tests.fuzz.__main__ import find_fault, make_input
from tests.fuzz.readers import READERS

ROOT = Path(__file__).resolve().parents[2]


def run_fuzz(inputs: int, seed: int) -> int:
    """Run so many inputs in a process of its own and return their number."""
    command = [sys.executable, "-m", "tests.fuzz", "--inputs", str(inputs), "--seed", str(seed)]
    paths = os.pathsep.join([str(ROOT / "src"), str(ROOT), os.environ.get("PYTHONPATH", "")])
    run = subprocess.run(command, cwd=ROOT, env=os.environ | {"PYTHONPATH": paths}, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr[-2000:]
    found = json.loads(run.stdout)
    faults = {
        f"{name}, seed {seed}, input {numbers[0]}": fault
        for name, value in found.items()
        for fault, numbers in value["faults"].items()
    }
    assert faults == {}
    return sum(value["inputs"] for value in found.values())


@pytest.mark.parametrize("name", READERS)
def test_what_damage_begins_with_is_read(tmp_path: Path, name: str) -> None:
    reader = READERS[name]
    for beside, content in reader.beside:
        (tmp_path / beside).write_bytes(content)
    for seed in reader.seeds[:1]:
        (tmp_path / reader.name).write_bytes(seed)
        if name != "any":  # bare bytes have no sidecar, which is said
            reader.read(tmp_path / reader.name)


def test_a_number_determines_its_input_and_others_differ() -> None:
    assert make_input("nav", 3, 5) == make_input("nav", 3, 5)
    assert len({make_input("nav", seed, number) for seed in range(3) for number in range(100)}) > 250


def test_what_is_no_error_of_ours_counts_as_a_fault(tmp_path: Path) -> None:
    def read(path: Path) -> None:
        raise KeyError(path.name)

    fault, _ = find_fault(READERS["nav"].__class__("a", read, (b"",), 1), tmp_path / "a", b"")
    assert fault is not None
    assert fault.startswith("KeyError: 'a'")


def test_a_thousand_damaged_files_end_in_data_or_our_own_errors() -> None:
    assert run_fuzz(1_000, seed=0) == 1_000


@pytest.mark.long
@pytest.mark.parametrize("seed", range(1, 11))
def test_a_million_damaged_files_end_in_data_or_our_own_errors(seed: int) -> None:
    assert run_fuzz(100_000, seed) == 100_000
