"""However a run is cut into pieces, on the way from samples or files to what is written, the outputs are the same."""

from contextlib import ExitStack
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.app.kit import DISTANCE_M, START, scenario_of

from skyproof.app.protect import protect
from skyproof.formats.rinex_nav import write_nav
from skyproof.formats.rinex_obs import write_obs
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.simulator.files import write
from skyproof.simulator.measurements import NoiseModel, simulate_observations
from skyproof.simulator.scenario import FrontEnd

epochs = st.integers(2, 40)


def outputs(folder: Path, paths: list[Path], nav: Path, constants: dict) -> dict[str, bytes]:
    """Files of a run with these constants in the place of the package's own."""
    with ExitStack() as stack:
        for name, value in constants.items():
            stack.enter_context(patch(f"skyproof.{name}", value))
        protect(paths, nav=nav, out=folder, antenna_distance_m=DISTANCE_M if len(paths) == 2 else None, window_s=5.0)
    files = {path.name: path.read_bytes() for path in folder.iterdir()}
    # Rows come in groups as they were written; the values are text. So sums of the files differ as well.
    for name in ("fixes.parquet", "signals.parquet", "checksums.sha256"):
        files.pop(name)
    return files


def of_stretches(stretch, held, piece_bytes=None) -> dict:
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
def observed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("observed")
    scenario = scenario_of(duration_s=41.0)
    navigation = make_nominal_constellation(scenario.start_gpst)
    noise = NoiseModel(sigma_m=0.5, constant_m=0.3)
    measured, _ = simulate_observations(scenario, navigation, rng=np.random.default_rng(3), noise=noise)
    for o in measured:
        write_obs(folder / f"{o.receiver}.obs", o, signals=o.signals, holds="simulated", marker="x", version="1")
    write_nav(folder / "nav.rnx", navigation)
    paths, nav = [folder / f"{o.receiver}.obs" for o in measured], folder / "nav.rnx"
    return paths, nav, outputs(folder / "whole", paths, nav, {})


def same_in_pieces(observed, folder, stretch, held, piece_bytes):
    paths, nav, whole = observed
    found = outputs(folder / f"{stretch}-{held}-{piece_bytes}", paths, nav, of_stretches(stretch, held, piece_bytes))
    assert {name for name in whole if found.get(name) != whole[name]} == set()
    assert found.keys() == whole.keys()


@settings(max_examples=2, deadline=None)
@given(stretch=epochs, held=st.integers(0, 60), piece_bytes=st.integers(500, 20_000))
def test_observation_files_in_any_pieces_give_the_same_bytes(observed, tmp_path_factory, stretch, held, piece_bytes):
    same_in_pieces(observed, tmp_path_factory.mktemp("pieces"), stretch, held, piece_bytes)


def test_consistent_fixes_in_stretches_are_those_of_the_whole(observed, tmp_path):
    (path, _), nav, _ = observed
    whole = outputs(tmp_path / "whole", [path], nav, {})
    assert b"consistent" in whole["fixes.csv"]
    assert outputs(tmp_path / "parts", [path], nav, of_stretches(16, 60))["fixes.csv"] == whole["fixes.csv"]


@pytest.mark.long
@settings(max_examples=60, deadline=None)
@given(stretch=epochs, held=st.integers(0, 60), piece_bytes=st.integers(500, 20_000))
def test_observation_files_in_many_pieces_give_the_same_bytes(observed, tmp_path_factory, stretch, held, piece_bytes):
    same_in_pieces(observed, tmp_path_factory.mktemp("pieces"), stretch, held, piece_bytes)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorded")
    scenario = scenario_of(duration_s=20.0, front_end=FrontEnd(rate_hz=2.0e6))
    navigation = make_nominal_constellation(START)
    write(scenario, navigation, folder)
    write_nav(folder / "nav.rnx", navigation)
    paths, nav = [folder / f"{receiver.name}.bin" for receiver in scenario.receivers], folder / "nav.rnx"
    return paths, nav, outputs(folder / "whole", paths, nav, {})


@pytest.mark.long
@settings(max_examples=8, deadline=None)
@given(stretch=epochs, held=st.integers(0, 120), block_s=st.floats(0.03, 3.0), piece_s=st.floats(0.2, 8.0))
def test_recordings_in_any_pieces_give_the_same_bytes(recorded, tmp_path_factory, stretch, held, block_s, piece_s):
    paths, nav, whole = recorded
    constants = of_stretches(stretch, held)
    constants |= {"app.receive.tracker.BLOCK_S": block_s, "app.receive.measured.PIECE_S": piece_s}
    found = outputs(tmp_path_factory.mktemp("pieces"), paths, nav, constants)
    assert {name for name in whole if found.get(name) != whole[name]} == set()
    assert found.keys() == whole.keys()
