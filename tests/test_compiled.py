"""Where the machine code of kernels is kept: read beside the source, and never needed."""

import importlib.util
import itertools
import os
import tempfile
from pathlib import Path

import numpy as np
import pytest

import skyproof
from skyproof import compiled as account
from skyproof.compiled import compiled, is_kept, kernels_in, on_compiled, writable_folder

SOURCE = """
from skyproof.compiled import compiled

@compiled
def total(values):
    s = 0.0
    for value in values:
        s += value
    return s
"""
NUMBER = itertools.count()


@pytest.fixture
def count_calls(tmp_path, monkeypatch):
    """Return a function that counts whether machine code was found for a module imported again: 1 or 0."""
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    path = tmp_path / "package" / "kernels_there.py"
    path.parent.mkdir()
    path.write_text(SOURCE)
    monkeypatch.setattr(account, "_ACCOUNT", account._Account())

    def call() -> int:
        call.module = f"kernels_there_{next(NUMBER)}"
        spec = importlib.util.spec_from_file_location(call.module, path)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        call.kernel, call.kept_before = module.total, is_kept(module.total)
        assert module.total(np.arange(4.0)) == 6.0
        return sum(module.total.stats.cache_hits.values())

    return call


@pytest.fixture
def read_only(monkeypatch):
    """Make folders refuse all writing from now on, for the super-user as well."""
    folders = []
    makedirs, temporary, replace = os.makedirs, tempfile.TemporaryFile, os.replace

    def refuse(path):
        if any(str(path).startswith(str(folder)) for folder in folders):
            raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(os, "makedirs", lambda path, *rest, **more: (refuse(path), makedirs(path, *rest, **more)))
    monkeypatch.setattr(tempfile, "TemporaryFile", lambda *_, dir: (refuse(dir), temporary(dir=dir))[1])
    monkeypatch.setattr(os, "replace", lambda part, path: (refuse(path), replace(part, path)))
    return folders.append


def test_setups_kernels_are_read_where_nothing_can_be_written(count_calls, tmp_path, read_only):
    assert (count_calls(), count_calls()) == (0, 1)
    read_only(tmp_path)
    assert count_calls() == 1
    assert not (tmp_path / "home").exists()


def test_what_setup_did_not_compile_is_kept_for_the_user(count_calls, tmp_path, read_only):
    read_only(tmp_path / "package")
    assert (count_calls(), count_calls()) == (0, 1)
    assert list((tmp_path / "home").rglob("*.nbc"))
    assert not list((tmp_path / "package").rglob("*.nbc"))


def test_kernels_run_where_nothing_is_kept_or_can_be_written(count_calls, tmp_path, read_only):
    read_only(tmp_path)
    assert (count_calls(), count_calls()) == (0, 0)


def test_a_kernel_is_kept_once_it_was_compiled(count_calls, tmp_path, read_only):
    count_calls()
    assert not count_calls.kept_before
    assert is_kept(count_calls.kernel)
    count_calls()
    assert count_calls.kept_before
    assert kernels_in(count_calls.module) == {f"{count_calls.module}.total": count_calls.kernel}
    assert writable_folder(count_calls.kernel).parent == tmp_path / "package"
    read_only(tmp_path / "package")
    assert writable_folder(count_calls.kernel).is_relative_to(tmp_path / "home")
    read_only(tmp_path)
    assert writable_folder(count_calls.kernel) is None


def test_what_is_compiled_is_named_and_nothing_else(count_calls):
    names = []
    on_compiled(names.append)
    count_calls()
    first = count_calls.module
    count_calls()
    assert names == [f"{first}.total"]


def test_what_is_compiled_in_no_time_is_not_reported(count_calls, caplog, monkeypatch):
    monkeypatch.setattr(account._ACCOUNT, "_report_s", float("inf"))  # however slow this machine is
    count_calls()
    assert not caplog.records
    monkeypatch.setattr(account._ACCOUNT, "_report_s", 0.0)
    count_calls()
    assert not caplog.records  # it was kept


@pytest.mark.parametrize("nowhere", [False, True])
def test_a_report_says_where_nothing_can_be_kept(count_calls, tmp_path, read_only, caplog, monkeypatch, nowhere):
    monkeypatch.setattr(account._ACCOUNT, "_report_s", 0.0)
    if nowhere:
        read_only(tmp_path)
    count_calls()
    (record,) = caplog.records
    assert record.args[0] == 1
    assert ("NUMBA_CACHE_DIR" in record.getMessage()) == nowhere
    assert (str(tmp_path / "home") in record.getMessage()) == nowhere
    monkeypatch.setattr(account._ACCOUNT, "_report_s", 0.0)
    path = tmp_path / "package" / "kernels_there.py"
    path.write_text(f"# changed\n{path.read_text()}")
    count_calls()
    assert len(caplog.records) == 2
    assert "NUMBA_CACHE_DIR" not in caplog.records[1].getMessage()  # the reason once a process


def test_machine_code_of_another_source_is_not_used(count_calls, tmp_path):
    assert count_calls() == 0
    path = tmp_path / "package" / "kernels_there.py"
    path.write_text(SOURCE.replace("s = 0.0", "s = 0.0  # changed"))
    assert count_calls() == 0


def test_a_function_of_no_file_is_compiled():
    names = {}
    exec("def twice(x):\n    return 2 * x\n", names)
    assert compiled(names["twice"])(21) == 42


def test_every_kernel_that_is_kept_is_kept_so():
    # Numba's own caching would refuse all work in a package that may not be written.
    sources = Path(skyproof.__file__).parent.rglob("*.py")
    assert [path.name for path in sources if "cache=True" in path.read_text(encoding="utf-8")] == []
