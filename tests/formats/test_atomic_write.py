"""Files that appear whole, and together, whatever ends the one who writes them."""

import os
import signal
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyproof.errors import OutputError
from skyproof.formats import atomic_write
from skyproof.formats.atomic_write import write_lines, writing, writing_together

NAMES = ("a.csv", "report.html", "verdict.json")


def write_run(folder: Path, run: str, names: tuple[str, ...] = NAMES) -> None:
    with writing_together(folder, instead_of=["only-old.obs"], last="verdict.json") as part:
        for name in names:
            write_lines(part / name, [run])


def killed_at(step: int, write: object) -> int:
    """Run `write` in a process that is killed at its `step`-th change of a name; how it ended."""
    child = os.fork()
    if child == 0:
        done = 0

        def counted(change: object) -> object:
            def changed(*arguments: object, **options: object) -> object:
                nonlocal done
                done += 1
                if done > step:
                    os.kill(os.getpid(), signal.SIGKILL)
                return change(*arguments, **options)

            return changed

        os.replace, Path.unlink, os.rmdir = counted(os.replace), counted(Path.unlink), counted(os.rmdir)
        write()
        os._exit(0)
    return os.waitpid(child, 0)[1]


def texts(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text().strip() for path in folder.iterdir() if path.is_file()}


def test_whoever_is_killed_at_any_moment_leaves_no_old_file_beside_a_new_one(tmp_path):
    status, step = -1, 0
    while status != 0:
        folder = tmp_path / str(step)
        folder.mkdir()
        write_run(folder, "old")
        (folder / "only-old.obs").write_text("old")
        (folder / "mine.txt").write_text("mine")
        status = killed_at(step, lambda folder=folder: write_run(folder, "new"))
        left = texts(folder)
        assert left.pop("mine.txt") == "mine"
        assert set(left.values()) in ({"old"}, {"new"}, set()), f"at step {step}"
        assert "verdict.json" not in left or set(NAMES) <= set(left), f"at step {step}"
        if left.get("verdict.json") == "new":
            assert left == dict.fromkeys(NAMES, "new")
        write_run(folder, "third", NAMES[1:])
        assert {"mine.txt", *NAMES[1:]} <= {path.name for path in folder.iterdir()} <= {"mine.txt", *NAMES}
        step += 1
    assert step > 12


def test_what_is_not_finished_leaves_all_as_it_was(tmp_path):
    write_run(tmp_path, "old")

    def interrupted() -> None:
        with writing_together(tmp_path) as part:
            write_lines(part / "a.csv", ["new"])
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert texts(tmp_path) == dict.fromkeys(NAMES, "old")
    assert len(list(tmp_path.iterdir())) == 3


def test_two_runs_do_not_write_into_one_folder_at_once(tmp_path):
    with writing_together(tmp_path) as part:
        with pytest.raises(OutputError, match="another run is writing into it; wait until it ends"):
            write_run(tmp_path, "other")
        write_lines(part / "a.csv", ["new"])
    assert texts(tmp_path) == {"a.csv": "new"}


def test_a_folder_that_cannot_be_written_is_named_without_what_is_hidden_in_it(tmp_path):
    with pytest.raises(OutputError, match=rf"^{tmp_path}/none/a\.csv cannot be written .*: its folder does not exist"):
        write_run(tmp_path, "new", ("none/a.csv",))
    (tmp_path / "a").write_text("a file")
    with pytest.raises(OutputError, match=r"a cannot be written \(Not a directory\)"):
        write_run(tmp_path / "a", "new")


def test_what_a_killed_writer_left_goes_with_the_next_and_what_another_writes_stays(tmp_path):
    def half() -> None:
        with writing(tmp_path / "[x].bin") as file:
            file.write(b"half")
            file.flush()
            os.kill(os.getpid(), signal.SIGKILL)

    assert killed_at(99, half) == signal.SIGKILL
    assert [path.suffix for path in tmp_path.iterdir()] == [".part"]
    with writing(tmp_path / "[x].bin") as file:
        file.write(b"one")
        write_lines(tmp_path / "[x].bin", ["another"])
        assert len(list(tmp_path.iterdir())) == 2
    assert texts(tmp_path) == {"[x].bin": "one"}


@given(st.text(st.characters(exclude_characters="/\0", exclude_categories=["Cs"]), min_size=1, max_size=255))
def test_a_file_of_any_name_that_the_system_takes_is_written(tmp_path_factory, name):
    folder = tmp_path_factory.mktemp("names")
    if name in (".", ".."):
        return
    if len(name.encode()) > 255:
        with pytest.raises(OutputError, match="the name is too long; choose a shorter one"):
            write_lines(folder / name, ["x"])
    else:
        write_lines(folder / name, ["x"])
        assert texts(folder) == {name: "x"}
    assert atomic_write.UNFINISHED not in os.listdir(folder)
