"""Readings on a disk are those in memory, to the bit, however they are cut and whichever are asked for."""

from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skyproof.formats import imu_pieces
from skyproof.formats.imu import ImuFile
from skyproof.formats.imu_pieces import StoredImuFile, StoredReadings, store_readings
from skyproof.formats.pieces import Workspace
from skyproof.gnss.time import GPS_EPOCH

N = 1000
STARTS = GPS_EPOCH, GPS_EPOCH + np.timedelta64(5, "s")


def write_file(n=N, *, dated=False):
    rng = np.random.default_rng(3)
    return ImuFile(
        source="imu.csv",
        time_ns=np.cumsum(rng.integers(9_000_000, 11_000_000, n)),
        dated=dated,
        interval_s=0.01,
        specific_force_m_s2=rng.standard_normal((n, 3)),
        angular_rate_rad_s=rng.standard_normal((n, 3)),
        remarks=("one",),
    )


def assert_same(one, other):
    assert one.interval_s == other.interval_s
    for name in ("gpst", "specific_force_m_s2", "angular_rate_rad_s"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


@settings(max_examples=20, deadline=None)
@given(
    each=st.integers(90, 1200),
    cuts=st.lists(st.tuples(st.integers(-5, N + 5), st.integers(-5, N + 5)), min_size=1, max_size=6),
    dated=st.booleans(),
)
def test_a_slice_that_is_read_back_is_that_of_the_whole(each, cuts, dated):
    whole = write_file(dated=dated)
    with patch.object(imu_pieces, "PIECE_READINGS", each):
        stored = StoredImuFile(whole, Workspace())
    for zero in STARTS:
        of_whole, of_pieces = whole.series(zero), stored.series(zero)
        np.testing.assert_array_equal(of_pieces.gpst, of_whole.gpst)
        for first, stop in cuts:
            assert_same(of_pieces.select(slice(first, stop)), of_whole.select(slice(first, stop)))


@pytest.mark.parametrize(("n", "kind"), [(N - 1, ImuFile), (N, ImuFile), (N + 1, StoredImuFile)])
def test_few_readings_stay_in_memory(n, kind):
    with patch.object(imu_pieces, "HELD_READINGS", N):
        kept = store_readings(write_file(n), Workspace())
    assert type(kept) is kind
    assert (kept.source, kept.remarks, kept.interval_s) == ("imu.csv", ("one",), 0.01)


def test_no_values_stay_at_hand(tmp_path):
    # Of each reading its time alone, once for the unit and the body that share it.
    with patch.object(imu_pieces, "PIECE_READINGS", 100):
        stored = StoredImuFile(write_file(), Workspace(tmp_path))
    first, other = stored.series(GPS_EPOCH), stored.series(GPS_EPOCH)
    assert isinstance(first, StoredReadings)
    assert first.gpst is other.gpst
    assert len([*tmp_path.rglob("inertial/*.npz")]) == 10
    first.select(slice(0, N))
    assert len(first._pieces._cached) <= 2
