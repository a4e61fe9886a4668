"""Recordings of few seconds, and the command line run on them in silence."""

import numpy as np
import pytest
from tests.app import kit
from tests.app.bad_input.common import START, Ended

from skyproof import cli
from skyproof.app.common.progress import Silent
from skyproof.cli import protect as protect_command
from skyproof.cli import receive as receive_command
from skyproof.simulator.scenario import FrontEnd


@pytest.fixture(scope="session")
def pair(tmp_path_factory):
    """Record two receivers under a clean sky for 8 s: just enough for a time of week and a verdict."""
    return kit.record(kit.make_scenario(duration_s=8.0, start_gpst=START), tmp_path_factory.mktemp("pair"))


@pytest.fixture(autouse=True)
def _quiet(monkeypatch):
    for command in (protect_command, receive_command):
        monkeypatch.setattr(command, "progress", Silent)


@pytest.fixture
def run(capsys, tmp_path):
    def run(*inputs, nav=None, out=None, options=()):
        folder = out or tmp_path / "out"
        argv = ["protect", *map(str, inputs), "--out", str(folder), *options]
        code = cli.main(argv + (["--nav", str(nav)] if nav is not None else []))
        reported = capsys.readouterr()
        return Ended(code, reported.out, reported.err.splitlines(), folder)

    return run


@pytest.fixture
def no_tracking(monkeypatch):
    """Fail the test if tracking begins."""
    too_early = "the long work began before the check"
    monkeypatch.setattr("skyproof.app.protect.run.track", lambda *_: pytest.fail(too_early))


@pytest.fixture(scope="session")
def wide(tmp_path_factory):
    """Record most of a second of one receiver in 8-bit numbers, short enough to be hashed at once."""
    front_end = FrontEnd(encoding="int", bits=8)
    scenario = kit.make_scenario(receivers=1, duration_s=0.9, front_end=front_end)
    return kit.record(scenario, tmp_path_factory.mktemp("wide")).paths[0]


@pytest.fixture(scope="session")
def later(tmp_path_factory):
    """Record the scene of `pair` five minutes later."""
    start = START + np.timedelta64(300, "s")
    return kit.record(kit.make_scenario(duration_s=7.0, start_gpst=start), tmp_path_factory.mktemp("later"))
