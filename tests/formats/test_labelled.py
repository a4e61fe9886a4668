"""Measurements and fixes as tables of pandas and xarray hold what the records hold."""

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest

from skyproof.errors import SettingsError
from skyproof.formats import labelled
from skyproof.formats.labelled import to_dataframe, to_xarray
from skyproof.formats.pieces import Workspace
from skyproof.formats.spool import ObservationSpool
from skyproof.gnss.frames import geodetic_from_ecef
from skyproof.navigation.fix import fix
from skyproof.records import OBSERVABLES, CellStatus, FixStatus, Observations
from skyproof.testing import MeasuredScene

WINDOW = MeasuredScene(epochs=20, max_satellites=6).records(np.random.default_rng(1))
WHOLE: Observations = WINDOW.observations[0]
GONE = replace(WHOLE, status=np.where(np.arange(20)[:, None] + np.arange(len(WHOLE.signals)) < 5, 1, WHOLE.status))
assert WINDOW.navigation is not None
FIX = fix(WHOLE, WINDOW.navigation)


def write_whole(whole):
    log = ObservationSpool(Workspace(), whole.receiver)
    for first, stop in ((0, 7), (7, 20)):
        log.append(whole.read(first, stop))
    return log


@pytest.mark.parametrize("held", [lambda o: o, write_whole], ids=["in memory", "on a disk"])
def test_a_frame_has_a_row_for_each_tracked_cell(held):
    frame = to_dataframe(held(GONE))
    rows, channels = np.nonzero(GONE.status != CellStatus.NOT_TRACKED)
    assert len(frame) == rows.size < GONE.status.size
    np.testing.assert_array_equal(frame.gpst, GONE.gpst[rows])
    assert list(frame.sat) == [GONE.signals[c].sat for c in channels]
    for name in OBSERVABLES:
        np.testing.assert_array_equal(frame[name], getattr(GONE, name)[rows, channels])
    assert set(frame.status) == {CellStatus(number).name for number in np.unique(GONE.status[rows, channels])}
    assert set(frame.receiver) == {GONE.receiver}


@pytest.mark.parametrize("held", [lambda o: o, write_whole], ids=["in memory", "on a disk"])
def test_a_dataset_has_every_cell_by_time_and_signal(held):
    data = to_xarray(held(GONE))
    assert data.sizes == {"gpst": 20, "signal": len(GONE.signals)}
    for name in (*OBSERVABLES, "status", "half_cycle_open"):
        np.testing.assert_array_equal(data[name], getattr(GONE, name))
    signal = GONE.signals[2]
    picked = data.pseudorange_m.sel(signal=str(signal), gpst=GONE.gpst[9])
    assert float(picked) == GONE.pseudorange_m[9, 2]
    assert (str(data.sat[2].values), data.pseudorange_m.units, data.cn0_dbhz.units) == (signal.sat, "m", "dB-Hz")


def test_a_fix_has_its_places_by_time():
    good = FIX.status == FixStatus.OK
    frame, data = to_dataframe(FIX), to_xarray(FIX)
    lat_rad, lon_rad, height_m = geodetic_from_ecef(FIX.position_ecef_m[good])
    for table in (frame, data):
        np.testing.assert_array_equal(table.gpst, FIX.gpst[good])
        np.testing.assert_allclose(table.lat_deg, np.degrees(lat_rad), rtol=0, atol=0)
        np.testing.assert_allclose(table.height_m, height_m, rtol=0, atol=0)
    assert (data.receiver, data.lat_deg.units, set(frame.receiver)) == (FIX.receiver, "degree", {FIX.receiver})
    assert len(lat_rad) > 10
    assert np.degrees(lon_rad).shape == frame.lon_deg.shape


def test_no_signal_and_no_epoch_are_empty_tables():
    empty = WHOLE.read(0, 0)
    assert len(to_dataframe(empty)) == 0
    assert to_xarray(empty).sizes["gpst"] == 0


@pytest.mark.parametrize(("convert", "library"), [(to_dataframe, "pandas"), (to_xarray, "xarray")])
def test_a_library_that_is_missing_names_its_extra(convert, library, monkeypatch):
    def missing(name):
        if name == library:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        return import_module(name)

    monkeypatch.setattr(labelled, "import_module", missing)
    with pytest.raises(SettingsError, match=rf"'skyproof\[{library}\]'"):
        convert(WHOLE)
