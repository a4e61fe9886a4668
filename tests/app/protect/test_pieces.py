"""However a run is cut into pieces, on the way from samples or files to what is written, the outputs are the same."""

from contextlib import ExitStack
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.app.kit import DISTANCE_M, START, make_scenario

from skyproof.app.protect import protect
from skyproof.formats.rinex_nav import write_nav
from skyproof.formats.rinex_obs import write_obs
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.simulator.files import write
from skyproof.simulator.measurements import NoiseModel, simulate_observations
from skyproof.simulator.scenario import FrontEnd

epochs = st.integers(2, 40)


def run_with_constants(folder: Path, paths: list[Path], nav: Path, constants: dict) -> dict[str, bytes]:
    """Run the command with these constants in place of the package's own, and return its files."""
    with ExitStack() as stack:
        for name, value in constants.items():
            stack.enter_context(patch(f"skyproof.{name}", value))
        protect(paths, nav=nav, out=folder, antenna_distance_m=DISTANCE_M if len(paths) == 2 else None, window_s=5.0)
    files = {path.name: path.read_bytes() for path in folder.iterdir()}
    # Rows come in groups as they were written; the values are text. So sums of the files differ as well.
    for name in ("fixes.parquet", "signals.parquet", "checksums.sha256"):
        files.pop(name)
    return files


def run_stretches(stretch, held, piece_bytes=None) -> dict:
    constants = {
        "app.protect.positions.STRETCH_EPOCHS": stretch,
        "app.receive.assembled.STRETCH_EPOCHS": stretch,
        "app.receive.observed.STRETCH_EPOCHS": stretch,
        "formats.rinex_obs._STRETCH_EPOCHS": stretch,
        "app.protect.outputs._TABLE_CELLS": 5 * stretch,
        "formats.spool.HELD_EPOCHS": held,
    }
    return constants if piece_bytes is None else constants | {"app.receive.observed.PIECE_BYTES": piece_bytes}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("observed")
    scenario = make_scenario(duration_s=41.0)
    navigation = make_nominal_constellation(scenario.start_gpst)
    noise = NoiseModel(sigma_m=0.5, constant_m=0.3)
    measured, _ = simulate_observations(scenario, navigation, rng=np.random.default_rng(3), noise=noise)
    for o in measured:
        write_obs(folder / f"{o.receiver}.obs", o, signals=o.signals, holds="simulated", marker="x", version="1")
    write_nav(folder / "nav.rnx", navigation)
    paths, nav = [folder / f"{o.receiver}.obs" for o in measured], folder / "nav.rnx"
    return paths, nav, run_with_constants(folder / "whole", paths, nav, {})


def assert_same_in_pieces(observed, folder, stretch, held, piece_bytes):
    paths, nav, whole = observed
    found = run_with_constants(
        folder / f"{stretch}-{held}-{piece_bytes}", paths, nav, run_stretches(stretch, held, piece_bytes)
    )
    assert {name for name in whole if found.get(name) != whole[name]} == set()
    assert found.keys() == whole.keys()


@settings(max_examples=2, deadline=None)
@given(stretch=epochs, held=st.integers(0, 60), piece_bytes=st.integers(500, 20_000))
def test_observation_files_in_any_pieces_give_the_same_bytes(files, tmp_path_factory, stretch, held, piece_bytes):
    assert_same_in_pieces(files, tmp_path_factory.mktemp("pieces"), stretch, held, piece_bytes)


def test_consistent_fixes_in_stretches_are_those_of_the_whole(files, tmp_path):
    (path, _), nav, _ = files
    whole = run_with_constants(tmp_path / "whole", [path], nav, {})
    assert b"consistent" in whole["fixes.csv"]
    assert run_with_constants(tmp_path / "parts", [path], nav, run_stretches(16, 60))["fixes.csv"] == whole["fixes.csv"]


@pytest.mark.long
@settings(max_examples=60, deadline=None)
@given(stretch=epochs, held=st.integers(0, 60), piece_bytes=st.integers(500, 20_000))
def test_observation_files_in_many_pieces_give_the_same_bytes(files, tmp_path_factory, stretch, held, piece_bytes):
    assert_same_in_pieces(files, tmp_path_factory.mktemp("pieces"), stretch, held, piece_bytes)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorded")
    scenario = make_scenario(duration_s=20.0, front_end=FrontEnd(rate_hz=2.0e6))
    navigation = make_nominal_constellation(START)
    write(scenario, navigation, folder)
    write_nav(folder / "nav.rnx", navigation)
    paths, nav = [folder / f"{receiver.name}.bin" for receiver in scenario.receivers], folder / "nav.rnx"
    return paths, nav, run_with_constants(folder / "whole", paths, nav, {})


@pytest.mark.long
@settings(max_examples=8, deadline=None)
@given(stretch=epochs, held=st.integers(0, 120), block_s=st.floats(0.03, 3.0), piece_s=st.floats(0.2, 8.0))
def test_recordings_in_any_pieces_give_the_same_bytes(recordings, tmp_path_factory, stretch, held, block_s, piece_s):
    paths, nav, whole = recordings
    constants = run_stretches(stretch, held)
    constants |= {"app.receive.tracker.BLOCK_S": block_s, "app.receive.measured.PIECE_S": piece_s}
    found = run_with_constants(tmp_path_factory.mktemp("pieces"), paths, nav, constants)
    assert {name for name in whole if found.get(name) != whole[name]} == set()
    assert found.keys() == whole.keys()
