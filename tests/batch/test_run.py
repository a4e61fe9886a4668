"""Items done once and whole, whatever dies on the way. The long tests kill at random moments."""

import os
import random
import re
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import pytest
from tests.batch.fake_work import Fake, fail_work, fake_work, make_item, read_results

from skyproof.batch import Item, Processes, Store, Work, run
from skyproof.errors import OutputError


def run_items(
    items: Sequence[Item], folder: Path, work: Work = fake_work, *, workers: int = 2
) -> tuple[dict[str, str], list[int]]:
    """Run the items; return the errors and how many items were reported as ended, from first to last."""
    reported: list[int] = []
    with Store(folder) as store, Processes(workers) as processes:
        errors, remaining = run(items, work, store, processes, report=reported.append)
    assert not remaining
    return errors, reported


def test_a_bad_item_and_a_killed_worker_cost_nothing_else(tmp_path: Path) -> None:
    once, always = tmp_path / "once", tmp_path / "always"
    once.mkdir()
    always.mkdir()
    fakes = [Fake(n) for n in range(6)]
    fakes += [Fake(6, error=True), Fake(7, kills=str(once), how_often=1), Fake(8, kills=str(always), how_often=99)]
    errors, reported = run_items([make_item(fake) for fake in fakes], tmp_path / "a")
    assert list(errors) == ["item-6", "item-8"]
    assert errors["item-6"].startswith("item 6: line 7 ")
    assert re.search(r"\bsignal 9\b", errors["item-8"])
    assert len(list(once.iterdir())) == 1
    assert len(list(always.iterdir())) == 2
    assert reported == sorted(reported)
    assert (reported[0], reported[-1]) == (0, 9)
    whole = {f"item-{n}/half.txt": b"whole\n" for n in (0, 1, 2, 3, 4, 5, 7)}
    assert read_results(tmp_path / "a") == whole | {
        f"item-{n}/inner/sum.txt": b"%d\n" % n**2 for n in (0, 1, 2, 3, 4, 5, 7)
    }

    # Again, with what failed put right and another version of one: only these are done, and one worker is enough.
    times = {path: path.stat().st_mtime_ns for path in (tmp_path / "a" / "items").iterdir()}
    repaired = [make_item(Fake(n), version="2" if n == 3 else "1") for n in range(9)]
    errors, reported = run_items(repaired, tmp_path / "a", workers=1)
    assert (errors, reported[0]) == ({}, 6)
    kept = {path.name for path, before in times.items() if path.stat().st_mtime_ns == before}
    assert kept == {f"item-{n}" for n in (0, 1, 2, 4, 5, 7)}
    assert len(read_results(tmp_path / "a")) == 18


def test_our_own_mistake_costs_the_item_and_says_whose_it_is(tmp_path: Path) -> None:
    errors, _ = run_items([make_item(Fake(1))], tmp_path, fail_work, workers=1)
    assert list(errors) == ["item-1"]
    assert "ZeroDivisionError: of 1." in errors["item-1"]
    assert read_results(tmp_path) == {}


def test_two_runs_do_not_share_a_folder(tmp_path: Path) -> None:
    with Store(tmp_path), pytest.raises(OutputError, match="another run"):
        Store(tmp_path).__enter__()
    with Store(tmp_path):
        pass


def test_two_items_of_one_key_are_refused(tmp_path: Path) -> None:
    with Store(tmp_path) as store, pytest.raises(ValueError, match="one key"):
        run([make_item(Fake(1)), make_item(Fake(1))], fake_work, store, Processes(1))


@pytest.mark.parametrize("step", ["rename", "replace"])
def test_an_item_whose_last_steps_are_missing_is_done_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: str
) -> None:
    item = make_item(Fake(1))

    def fill() -> None:
        with store.filling(item) as folder:
            fake_work(item.given, folder)

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    with Store(tmp_path) as store:
        with monkeypatch.context() as patched:
            patched.setattr(os, step, interrupt)
            with pytest.raises(KeyboardInterrupt):
                fill()
        assert not store.has(item)
        fill()
        assert store.has(item)
        assert list(read_results(tmp_path)) == ["item-1/half.txt", "item-1/inner/sum.txt"]


DRIVER = """
import sys
from pathlib import Path
from skyproof.batch import Processes, Store, run
from tests.batch.fake_work import Fake, fake_work, make_item
from skyproof.interruption import ENDING, listen
with Store(Path(sys.argv[1])) as store, Processes(2) as processes, listen(*ENDING):
    print("begun", flush=True)
    errors, left = run([make_item(Fake(n, sleep_s=0.05)) for n in range(int(sys.argv[2]))], fake_work, store, processes,
                       say=lambda text: print(text, flush=True))
print(errors, left, flush=True)
"""


def start_driver(folder: Path, count: int) -> subprocess.Popen[str]:
    started = subprocess.Popen(
        [sys.executable, "-c", DRIVER, str(folder), str(count)],
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )
    assert started.stdout is not None
    assert started.stdout.readline() == "begun\n"
    return started


def wait_for_items(folder: Path, count: int) -> None:
    until = time.monotonic() + 60.0
    while len(list((folder / ".skyproof-batch" / "done").iterdir())) < count:
        assert time.monotonic() < until
        time.sleep(0.001)


@pytest.mark.parametrize("whole_group", [False, True])
def test_sigterm_lets_items_end_and_the_rest_runs_next_time(tmp_path: Path, whole_group: bool) -> None:
    started = start_driver(tmp_path, 1000)
    wait_for_items(tmp_path, 1)
    if whole_group:  # as a service manager asks every process of a service
        for worker in Path(f"/proc/{started.pid}/task/{started.pid}/children").read_text().split():
            os.kill(int(worker), signal.SIGTERM)
    started.send_signal(signal.SIGTERM)
    out, _ = started.communicate(timeout=60)
    *announced, ended = out.splitlines()
    assert ended == "{} True"
    # Nothing is announced where all items under way ended in the moment of the signal.
    assert [words.partition(":")[0] for words in announced] in ([], ["interrupted"])
    results = {path.split("/")[0] for path in read_results(tmp_path)}
    assert 0 < len(results) < 1000
    with Store(tmp_path) as store:
        assert sum(store.has(make_item(Fake(n))) for n in range(1000)) == len(results)


@pytest.mark.long
def test_a_driver_killed_at_twenty_moments_leaves_the_same_bytes(tmp_path: Path) -> None:
    moments = random.Random(1)
    count, killed = 1000, 0
    for number in range(20):
        started = start_driver(tmp_path / "killed", count)
        wait_for_items(tmp_path / "killed", 5 * number)
        time.sleep(moments.uniform(0.0, 0.05))
        started.kill()
        started.wait()
        killed += started.returncode == -signal.SIGKILL
    assert killed == 20
    assert run_items([make_item(Fake(n)) for n in range(count)], tmp_path / "killed")[0] == {}
    run_items([make_item(Fake(n)) for n in range(count)], tmp_path / "whole", workers=1)
    assert read_results(tmp_path / "killed") == read_results(tmp_path / "whole")
    assert list((tmp_path / "killed" / ".skyproof-batch" / "doing").iterdir()) == []
