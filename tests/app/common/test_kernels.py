"""Machine code is made ahead, once, side by side and with progress; and each kernel belongs to one job."""

import os
import shutil
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest

import skyproof
from skyproof import compiled as account
from skyproof.app import warm
from skyproof.app.common import kernels
from skyproof.app.common.kernels import JOBS, RECEIVING, kernels_of, make_ready
from skyproof.app.common.progress import Silent


class Watched:
    """Progress that is kept."""

    def __init__(self):
        self.stages, self.done, self.said = [], [], []

    @contextmanager
    def stage(self, name, total):
        self.stages.append(total)
        yield self

    def advance(self, to):
        self.done.append(to)

    def say(self, text):
        self.said.append(text)


@pytest.fixture
def processes(monkeypatch):
    """Replace processes by a list of the jobs that were requested and of the modules that they compile."""
    asked, compiles = [], []

    def compile_jobs(jobs):
        asked.extend(jobs)
        yield from compiles

    monkeypatch.setattr(kernels, "_run_jobs", compile_jobs)
    return asked, compiles


def drop_kernels(monkeypatch, job, share=1.0):
    """Make this share of a job's kernels missing, and return their names."""
    names = sorted(kernels_of(job))
    names = names[: round(share * len(names))]
    lost = {id(kernels_of(job)[name]) for name in names}
    monkeypatch.setattr(kernels, "is_kept", lambda kernel: id(kernel) not in lost)
    return names


def test_where_all_is_kept_nothing_is_run_or_reported(monkeypatch, processes):
    monkeypatch.setattr(kernels, "is_kept", lambda _: True)
    progress = Watched()
    make_ready(RECEIVING, progress)
    assert (processes[0], progress.stages, progress.said) == ([], [], [])


def test_only_jobs_with_missing_kernels_run_with_progress(monkeypatch, processes):
    asked, compiles = processes
    first, second, *rest = names = drop_kernels(monkeypatch, "receiver")
    compiles += [first, "skyproof.of_no_job", second, second, *rest]
    progress = Watched()
    make_ready(RECEIVING, progress)
    assert asked == ["receiver"]
    assert progress.stages == [len(names)]
    assert progress.done == [1, 1, 2, 2, *range(3, len(names) + 1)]
    assert progress.said[0].startswith(f"{len(names)} of {len(names)} ")


def test_for_a_few_missing_kernels_no_job_is_begun(monkeypatch, processes):
    # Else a kernel that no job makes would be waited for in each run.
    drop_kernels(monkeypatch, "receiver", share=0.4)
    progress = Watched()
    make_ready(RECEIVING, progress)
    assert (processes[0], progress.stages, progress.said) == ([], [], [])


def test_a_job_that_fails_leaves_the_rest_to_their_first_use(monkeypatch, processes):
    asked, compiles = processes
    names = drop_kernels(monkeypatch, "overlaps")
    compiles += names[:1]
    progress = Watched()
    make_ready(RECEIVING, progress)
    assert asked == ["overlaps"]
    assert progress.said[0].startswith(f"1 of {len(names)} ")


def test_where_nothing_can_be_kept_no_process_compiles(monkeypatch, processes):
    drop_kernels(monkeypatch, "receiver")
    monkeypatch.setattr(account, "_ACCOUNT", account._Account())
    monkeypatch.setattr(kernels, "writable_folder", lambda _: None)
    progress = Watched()
    make_ready(RECEIVING, progress)
    assert (processes[0], progress.stages) == ([], [])
    assert "NUMBA_CACHE_DIR" in progress.said[0]


def test_who_calls_from_python_reads_it_in_the_log(monkeypatch, processes, caplog):
    names = drop_kernels(monkeypatch, "receiver")
    processes[1].extend(names)
    make_ready(RECEIVING, Silent())
    first, last = caplog.records
    assert first.args == (len(names),)
    assert last.getMessage().startswith(f"{len(names)} of {len(names)} ")


def test_processes_pass_on_what_they_print_and_end(monkeypatch):
    monkeypatch.setattr(kernels.subprocess, "Popen", _echo(subprocess.Popen))
    monkeypatch.setattr(kernels, "count_threads", lambda: 2)
    assert sorted(kernels._run_jobs(["a", "b", "c"])) == ["job a", "job b", "job c"]


def _echo(popen):
    program = "import sys; print('job', sys.argv[1]); sys.exit(3 if sys.argv[1] == 'b' else 0)"
    return lambda command, **options: popen([command[0], "-c", program, command[-1]], **options)


def test_every_job_is_one_that_can_be_done():
    assert set(warm._DO) == set(JOBS)
    assert len({module for modules in JOBS.values() for module in modules}) == sum(map(len, JOBS.values()))
    for job in JOBS:
        assert kernels_of(job)


@pytest.mark.long
@pytest.mark.parametrize("job", JOBS)
def test_a_job_compiles_all_kernels_of_its_modules(job, tmp_path):
    # From nothing, in a copy of the package: else each run would begin it again.
    source = Path(skyproof.__file__).parent
    shutil.copytree(source, tmp_path / "skyproof", ignore=shutil.ignore_patterns("*.nbi", "*.nbc", "__pycache__"))
    environment = os.environ | {"PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "kept")}
    run = subprocess.run(
        [sys.executable, "-m", "skyproof.app.warm", job], env=environment, capture_output=True, text=True, check=True
    )
    assert set(kernels_of(job)) <= set(run.stdout.split())
