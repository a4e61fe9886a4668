"""Rows of measurements become a grid, whatever their order."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from skyproof.gnss.constants import L1_HZ
from skyproof.logs.rows import SignalRows, observations_from_rows
from skyproof.records import CellStatus, SignalId

SIGNALS = (SignalId("R02", "G1"), SignalId("G05"), SignalId("E11", "E1", "C"))
START_NS = 1_700_000_000_000_000_000


def make_rows(epoch: np.ndarray, signal: np.ndarray, code_m: np.ndarray, **given: np.ndarray) -> SignalRows:
    """Return rows of the given epochs, signals and codes, all else missing."""
    missing = np.full(epoch.size, np.nan)
    values = dict.fromkeys(
        ("carrier_cyc", "doppler_hz", "cn0_dbhz", "pseudorange_sigma_m", "carrier_sigma_cyc", "doppler_sigma_hz"),
        missing,
    )
    flags = dict.fromkeys(("slipped", "half_cycle_open"), np.zeros(epoch.size, np.bool_))
    return SignalRows(
        signals=SIGNALS,
        frequency_numbers={"R02": -4},
        instant_ns=START_NS + 1_000_000_000 * epoch,
        signal=signal,
        pseudorange_m=code_m,
        **(values | flags | given),
    )


@given(st.lists(st.tuples(st.integers(0, 4), st.integers(0, 2)), min_size=1, unique=True), st.randoms())
def test_every_row_stands_in_its_cell(cells: list[tuple[int, int]], random) -> None:
    random.shuffle(cells)
    epoch, signal = (np.array(values, np.int64) for values in zip(*cells, strict=True))
    code_m = 2e7 + 1000.0 * epoch + signal
    o = observations_from_rows(make_rows(epoch, signal, code_m), "rx1")
    assert list(o.signals) == sorted({SIGNALS[k] for k in signal})
    assert np.isfinite(o.pseudorange_m).sum() == len(cells)
    assert (np.diff(o.elapsed_s) > 0.0).all()
    for k in range(len(cells)):
        row = np.flatnonzero(o.gpst.astype(np.int64) == START_NS + 1_000_000_000 * epoch[k])[0]
        column = o.signals.index(SIGNALS[signal[k]])
        assert o.pseudorange_m[row, column] == code_m[k]
        assert o.pseudorange_sigma_m[row, column] > 0.0
        assert o.status[row, column] == CellStatus.OK


def test_the_first_of_two_rows_of_a_cell_counts() -> None:
    twice = np.zeros(2, np.int64)
    o = observations_from_rows(make_rows(twice, twice + 1, np.array([2e7, 3e7])), "rx1")
    assert o.pseudorange_m.tolist() == [[2e7]]


def test_stated_sigmas_stand_beside_thermal_ones() -> None:
    epoch, signal = np.array([0, 1]), np.array([1, 1])
    stated = np.array([2.5, np.nan])
    o = observations_from_rows(make_rows(epoch, signal, np.full(2, 2e7), pseudorange_sigma_m=stated), "rx1")
    assert o.pseudorange_sigma_m[0, 0] == 2.5
    assert 0.1 < o.pseudorange_sigma_m[1, 0] < 5.0


def test_zero_is_no_measurement() -> None:
    none = np.zeros(1, np.int64)
    assert observations_from_rows(make_rows(none, none, np.zeros(1)), "rx1") is None


def test_glonass_carriers_follow_the_frequency_number() -> None:
    epoch, signal = np.zeros(2, np.int64), np.array([0, 1])
    o = observations_from_rows(make_rows(epoch, signal, np.full(2, 2e7)), "rx1")
    assert dict(zip(o.signals, o.carrier_hz, strict=True)) == {SIGNALS[0]: 1599.75e6, SIGNALS[1]: L1_HZ}


def test_signals_date_their_search() -> None:
    epoch, signal = np.array([0, 1, 2, 2]), np.array([1, 1, 1, 2])
    o = observations_from_rows(make_rows(epoch, signal, np.full(4, 2e7)), "rx1")
    assert o.found_elapsed_s.tolist() == [2.0, 0.0]
    assert o.missed_elapsed_s[0] == 1.0
    assert np.isnan(o.missed_elapsed_s[1])
