import errno
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skyproof.formats.pieces import _CONTENTS, UNFINISHED_RUN, ArrayPieces, Workspace, is_unfinished
from skyproof.formats.spool import ObservationSpool, gather
from skyproof.records import Observations
from skyproof.testing import MeasuredScene

WHOLE = MeasuredScene(epochs=40, step_s=0.5, max_satellites=6).records(np.random.default_rng(1)).observations[0]
SLIPPING = replace(WHOLE, status=np.where(np.arange(40)[:, None] % 7 == np.arange(len(WHOLE.signals)), 3, WHOLE.status))


def select_channels(observations, kept):
    """Select the observations of some signals."""
    names = {f.name for f in fields(Observations)} - {"receiver", "signals", "gpst", "elapsed_s", "averaged_s"}
    arrays = {name: getattr(observations, name)[..., kept] for name in names}
    return replace(observations, signals=tuple(observations.signals[k] for k in kept), **arrays)


def cut(whole, cuts):
    return [whole.read(first, stop) for first, stop in zip([0, *cuts], [*cuts, whole.gpst.size], strict=True)]


def spool(whole, cuts, workspace=None):
    log = ObservationSpool(workspace or Workspace(), whole.receiver)
    for piece in cut(whole, cuts):
        log.append(piece)
    return log


def assert_equal(one, other):
    for f in fields(Observations):
        a, b = getattr(one, f.name), getattr(other, f.name)
        if isinstance(a, np.ndarray):
            assert a.dtype == b.dtype, f.name
            np.testing.assert_array_equal(a, b, err_msg=f.name)
        else:
            assert a == b, f.name


@settings(max_examples=25)
@given(
    cuts=st.lists(st.integers(0, 40), max_size=5).map(sorted),
    ends=st.tuples(st.integers(0, 40), st.integers(0, 40)).map(sorted),
)
def test_pieces_give_what_the_whole_gives_cut_and_read_anywhere(cuts, ends):
    log = spool(SLIPPING, cuts)
    first, stop = ends
    assert_equal(log.read(first, stop), SLIPPING.read(first, stop))
    assert log.signals == SLIPPING.signals
    for name in ("gpst", "elapsed_s", "measured", "slipped", "found_elapsed_s", "missed_elapsed_s"):
        np.testing.assert_array_equal(getattr(log, name), getattr(SLIPPING, name), err_msg=name)
    for channel in range(len(log.signals)):
        first_log, other = (o.series("pseudorange_m", channel, first, stop) for o in (log, SLIPPING))
        np.testing.assert_array_equal(first_log, other)


def test_a_signal_that_comes_late_was_not_tracked_before():
    log = ObservationSpool(Workspace(), WHOLE.receiver)
    log.append(select_channels(WHOLE, [1, 3]).read(0, 20))
    log.append(select_channels(WHOLE, [0, 3]).read(20, 40))
    assert log.signals == (WHOLE.signals[0], WHOLE.signals[1], WHOLE.signals[3])
    got = log.read(0, 40)
    assert np.array_equal(got.measured.sum(axis=0), [20, 20, 40])
    assert set(got.status[:20, 0]) == {1}
    assert np.array_equal(got.pseudorange_m[:, 2], WHOLE.pseudorange_m[:, 3])
    assert np.isnan(log.series("cn0_dbhz", 0)[:20]).all()


def test_a_piece_out_of_order_is_refused_and_loses_nothing():
    log = spool(WHOLE, [10])
    with pytest.raises(ValueError, match=r"\bafter\b"):
        log.append(WHOLE.read(30, 40))
    assert_equal(log.read(0, 40), WHOLE)


@pytest.mark.parametrize("held_epochs", [0, 15, 40])
def test_few_pieces_stay_in_memory_and_many_go_to_the_disk(held_epochs, monkeypatch):
    monkeypatch.setattr("skyproof.formats.spool.HELD_EPOCHS", held_epochs)
    log = gather(cut(SLIPPING, [10, 20]), "rx1", Workspace())
    assert isinstance(log, Observations) == (held_epochs == 40)
    assert_equal(log.read(0, 40), replace(SLIPPING, receiver="rx1"))


def test_a_runs_folder_goes_with_it_and_remains_with_the_next(tmp_path):
    with Workspace(tmp_path) as workspace:
        log = spool(WHOLE, [10], workspace)
        assert sorted(path.name for path in (tmp_path / UNFINISHED_RUN).iterdir()) == ["README.txt", WHOLE.receiver]
        assert_equal(log.read(0, 40), WHOLE)
    assert not list(tmp_path.iterdir())
    killed = Workspace(tmp_path)
    killed.save("rx9/observations/000000.npz", {"values": np.arange(3)})
    with Workspace(tmp_path) as workspace:
        assert workspace.removed
        assert not list(tmp_path.iterdir())


def test_a_folder_of_that_name_that_is_not_of_a_run_stays(tmp_path):
    (tmp_path / UNFINISHED_RUN).mkdir()
    (tmp_path / UNFINISHED_RUN / "notes.txt").touch()
    assert not is_unfinished(tmp_path)
    assert not Workspace(tmp_path).removed
    assert (tmp_path / UNFINISHED_RUN / "notes.txt").exists()


def test_the_text_names_what_is_there_and_nothing_else(tmp_path):
    def describe() -> set[str]:
        text = (tmp_path / UNFINISHED_RUN / "README.txt").read_text()
        return {kind for kind in _CONTENTS if kind in text}

    with Workspace(tmp_path) as workspace:
        workspace.note("evidence.jsonl", ["{}"])
        assert describe() == {"evidence.jsonl"}
        ArrayPieces(workspace, "rx1/measured").append({"arc": np.arange(3)})
        ArrayPieces(workspace, "rx1/measured").append({"arc": np.arange(3)})
        assert describe() == {"evidence.jsonl", "measured"}
        workspace.drop_notes("evidence.jsonl")
        assert describe() == {"measured"}
        assert not (tmp_path / UNFINISHED_RUN / "evidence.jsonl").exists()


@pytest.mark.parametrize("elsewhere", [True, False])
def test_a_disk_that_is_full_costs_no_piece(tmp_path, monkeypatch, elsewhere):
    true_savez = np.savez

    def savez(file, **arrays):
        if not elsewhere or Path(file.name).is_relative_to(tmp_path):
            file.write(b"half")
            raise OSError(errno.ENOSPC, "No space left on device")
        true_savez(file, **arrays)

    with Workspace(tmp_path) as workspace:
        log = ArrayPieces(workspace, "rx1/measured")
        values = np.arange(4)
        log.append({"arc": values})
        monkeypatch.setattr(np, "savez", savez)
        log.append({"arc": values})
        workspace.note("evidence.jsonl", ["{}"])  # does not fail either
        values += 1
        for piece in range(2):
            np.testing.assert_array_equal(log.read(piece)["arc"], np.arange(4))
            np.testing.assert_array_equal(log.read_one(piece, "arc"), np.arange(4))
        assert not list(tmp_path.rglob("*.part"))


def test_a_temporary_folder_lasts_as_long_as_what_is_in_it():
    log = spool(WHOLE, [10])
    folder = Path(log._stored._workspace._temporary.name)
    assert_equal(log.read(0, 40), WHOLE)
    assert folder.is_dir()
    del log
    assert not folder.exists()
