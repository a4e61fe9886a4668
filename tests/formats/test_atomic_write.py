"""Files that appear whole, in their order, and never beside those of another run."""

import errno
import os
import signal
from functools import partial
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyproof.errors import OutputError
from skyproof.formats import atomic_write
from skyproof.formats.atomic_write import (
    OutputStep,
    Unwritten,
    describe_missing,
    write_in_turn,
    write_lines,
    write_whole,
)

NAMES = ("verdict.json", "report.html", "a.csv", "sums")


def write_run(folder: Path, run: str, names: tuple[str, ...] = NAMES, fails: str = "") -> tuple[Unwritten, ...]:
    def write(name: str, part: Path) -> None:
        if name in fails.split():
            raise OSError(errno.ENOSPC, "No space left on device") if name != "b.csv" else ZeroDivisionError("of b")
        write_lines(part / name, [run])

    steps = [OutputStep((name,), partial(write, name), after_all=name == "sums") for name in names]
    return write_in_turn(folder, steps, ahead=2, instead_of=["only-old.obs", *NAMES])


def kill_at(step: int, write: object) -> int:
    """Run `write` in a process that is killed at its `step`-th change of a name; return how it ended."""
    child = os.fork()
    if child == 0:
        done = 0

        def count_changes(change: object) -> object:
            def changed(*arguments: object, **options: object) -> object:
                nonlocal done
                done += 1
                if done > step:
                    os.kill(os.getpid(), signal.SIGKILL)
                return change(*arguments, **options)

            return changed

        os.replace, Path.unlink, os.rmdir = (
            count_changes(os.replace),
            count_changes(Path.unlink),
            count_changes(os.rmdir),
        )
        write()
        os._exit(0)
    return os.waitpid(child, 0)[1]


def read_texts(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text().strip() for path in folder.iterdir() if path.is_file()}


def test_a_kill_never_leaves_an_old_file_beside_a_new_one(tmp_path):
    status, step = -1, 0
    while status != 0:
        folder = tmp_path / str(step)
        folder.mkdir()
        write_run(folder, "old")
        (folder / "only-old.obs").write_text("old")
        (folder / "mine.txt").write_text("mine")
        status = kill_at(step, lambda folder=folder: write_run(folder, "new"))
        result = read_texts(folder)
        assert result.pop("mine.txt") == "mine"
        assert set(result.values()) in ({"old"}, {"new"}, set()), f"at step {step}"
        assert "verdict.json" not in result or {"verdict.json", "report.html"} <= set(result), f"at step {step}"
        assert result.get("sums") is None or "verdict.json" not in result or set(NAMES) <= set(result), (
            f"at step {step}"
        )
        write_run(folder, "third", NAMES[:3])
        assert {path.name for path in folder.iterdir()} == {"mine.txt", *NAMES[:3]}
        step += 1
    assert step > 12


def test_an_early_interruption_leaves_all_unchanged(tmp_path):
    write_run(tmp_path, "old")

    def interrupt(part: Path) -> None:
        write_lines(part / "a.csv", ["new"])
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_in_turn(tmp_path, [OutputStep(("a.csv",), interrupt)], instead_of=NAMES)
    assert read_texts(tmp_path) == dict.fromkeys(NAMES, "old")
    assert len(list(tmp_path.iterdir())) == len(NAMES)


@pytest.mark.parametrize(
    ("fails", "missing"),
    [
        ("report.html", ["report.html", "sums"]),
        ("a.csv", ["a.csv", "sums"]),
        ("b.csv", ["b.csv", "sums"]),
        ("a.csv b.csv", ["a.csv", "b.csv", "sums"]),
    ],
)
def test_a_file_that_cannot_be_written_costs_itself_and_the_sums(tmp_path, fails, missing):
    write_run(tmp_path, "old")
    names = (*NAMES[:3], "b.csv", "c.csv", "sums")
    unwritten = write_run(tmp_path, "new", names, fails)
    assert [name for each in unwritten for name in each.names] == missing
    assert read_texts(tmp_path) == dict.fromkeys(sorted({*names} - {*missing}), "new")


def test_without_room_for_the_first_file_what_was_there_stays(tmp_path):
    write_run(tmp_path, "old")
    (unwritten, rest) = write_run(tmp_path, "new", fails="verdict.json")
    assert (unwritten.names, set(rest.names)) == (("verdict.json",), set(NAMES[1:]))
    assert read_texts(tmp_path) == dict.fromkeys(NAMES, "old")


def test_a_folder_that_takes_nothing_loses_nothing(tmp_path, monkeypatch):
    write_run(tmp_path, "old")
    monkeypatch.setattr(atomic_write, "UNFINISHED", "report.html")  # a file stands in the way
    unwritten = write_run(tmp_path, "new")
    assert {name for each in unwritten for name in each.names} == set(NAMES)
    assert set(read_texts(tmp_path).values()) == {"old"}


def test_missing_files_are_named_with_one_cause(tmp_path):
    full = OutputError("x/a cannot be written (No space left on device): the disk is full; free space")
    words = describe_missing(Path("out"), [Unwritten(("a", "b"), full), Unwritten(("c",), full)])
    assert words.startswith("out lacks a, b, c: ")
    assert words.count("disk") == 1
    assert "--overwrite" in words


def test_what_is_hidden_is_not_named(tmp_path):
    (unwritten,) = write_in_turn(
        tmp_path, [OutputStep(("a.csv",), lambda part: write_lines(part / "none" / "a.csv", ["x"]))]
    )
    assert str(unwritten.error).startswith(f"{tmp_path}/none/a.csv ")


def test_remains_of_killed_writers_go_and_of_live_ones_stay(tmp_path):
    def half() -> None:
        with write_whole(tmp_path / "[x].bin") as file:
            file.write(b"half")
            file.flush()
            os.kill(os.getpid(), signal.SIGKILL)

    assert kill_at(99, half) == signal.SIGKILL
    assert [path.suffix for path in tmp_path.iterdir()] == [".part"]
    with write_whole(tmp_path / "[x].bin") as file:
        file.write(b"one")
        write_lines(tmp_path / "[x].bin", ["another"])
        assert len(list(tmp_path.iterdir())) == 2
    assert read_texts(tmp_path) == {"[x].bin": "one"}


@given(st.text(st.characters(exclude_characters="/\0", exclude_categories=["Cs"]), min_size=1, max_size=255))
def test_a_file_of_any_name_that_the_system_takes_is_written(tmp_path_factory, name):
    folder = tmp_path_factory.mktemp("names")
    if name in (".", ".."):
        return
    if len(name.encode()) > 255:
        with pytest.raises(OutputError, match="shorter"):
            write_lines(folder / name, ["x"])
    else:
        write_lines(folder / name, ["x"])
        assert read_texts(folder) == {name: "x"}
    assert atomic_write.UNFINISHED not in os.listdir(folder)
