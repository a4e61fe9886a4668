"""A receiver's measurements of two recordings of TEXBAT: code and carrier part where the attack draws codes off."""

import numpy as np
import pytest

from skyproof.detectors.common_change.detector import CommonChange, CommonChangeSettings
from skyproof.records import CellStatus, Observations, Records, SignalId

pytestmark = pytest.mark.shared_data

OF_A_RUN = 1e-3 * 10.0 / 3600.0 / 7.0
COLUMNS = {"pseudorange_m": 7, "carrier_cyc": 6, "doppler_hz": 5, "cn0_dbhz": 8}
LOCKED, GPS = 5, 32


def read_log(path):
    """Read valid measurements of GPS satellites in phase lock, by epochs of the raw receiver time."""
    table = np.loadtxt(path, delimiter=",")
    table = table[(table[:, 13] <= GPS) & (table[:, 2] != 9999) & (table[:, 9] == 1) & (table[:, 11] >= LOCKED)]
    elapsed_s, rows = np.unique(table[:, 1].round(6), return_inverse=True)
    prns, columns = np.unique(table[:, 13].astype(int), return_inverse=True)
    shape = elapsed_s.size, prns.size
    cells = {name: np.full(shape, np.nan) for name in COLUMNS}
    for name, column in COLUMNS.items():
        cells[name][rows, columns] = table[:, column]
    measured = np.isfinite(cells["pseudorange_m"])
    o = Observations(
        receiver="rx1",
        signals=tuple(SignalId(f"G{prn:02d}") for prn in prns),
        gpst=np.datetime64("2012-09-14T12:44:42", "ns") + np.rint(elapsed_s * 1e9).astype("timedelta64[ns]"),
        elapsed_s=elapsed_s,
        pseudorange_sigma_m=np.ones(shape),
        carrier_sigma_cyc=np.full(shape, 0.01),
        doppler_sigma_hz=np.full(shape, 0.1),
        status=np.where(measured, CellStatus.OK, CellStatus.NOT_TRACKED).astype(np.uint8),
        found_elapsed_s=np.zeros(prns.size),
        missed_elapsed_s=np.full(prns.size, np.nan),
        **cells,
    )
    return o.select(np.flatnonzero((measured.sum(axis=1) >= 5) & (np.diff(elapsed_s, prepend=-1.0) > 0.01)))


@pytest.mark.parametrize(("name", "clean_s", "by_s"), [("ds2", 100.0, 125.0), ("ds3", 110.0, 226.0)])
def test_codes_that_a_real_attack_drags_leave_their_carriers(shared_data, name, clean_s, by_s):
    # The attacks begin after 100 and 110 s. Before, and long after, when codes stay drawn off, there is no alarm.
    o = read_log(shared_data / "real" / "spoofed-real" / f"texbat_{name}.channel.csv.gz")
    detector, state = CommonChange(CommonChangeSettings(false_alarm_probability=OF_A_RUN)), None
    alarms_s = []
    for begin_s in np.arange(o.elapsed_s[0], o.elapsed_s[-1] - 9.0, 10.0):
        window = o.select(np.flatnonzero((o.elapsed_s >= begin_s) & (o.elapsed_s < begin_s + 10.0)))
        records = Records(start_gpst=window.gpst[0], end_gpst=window.gpst[-1], observations=(window,))
        evidence, state = detector.examine(records, state)
        alarms_s += [float(window.elapsed_s[-1]) for e in evidence if e.failed]
    assert clean_s < min(alarms_s) < by_s
    assert max(alarms_s) < 250.0
