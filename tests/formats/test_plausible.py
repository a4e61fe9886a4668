"""What no receiver measures is left out and counted; what an attack can make stays."""

import itertools

import numpy as np
import pytest

from skyproof.formats.plausible import describe_impossible, leave_out_impossible
from skyproof.gnss.constants import L1_HZ, SPEED_OF_LIGHT_M_S
from skyproof.records import SignalId

WAVELENGTH_M = SPEED_OF_LIGHT_M_S / L1_HZ
SATS = ["G01", "G05", "G12", "G24", "G31", "E05", "E11", "E30", "R01", "R09", "C02", "C08", "C25", "J02", "S23"]
BANDS = {
    "G": ("L1", "CA"),
    "E": ("E1", "C"),
    "R": ("G1", "CA"),
    "C": ("B1", "2I"),
    "J": ("L1", "CA"),
    "S": ("L1", "CA"),
}
SIGNALS = tuple(SignalId(sat, *BANDS[sat[0]]) for sat in SATS)
MIDDLE_M = {"G": 2.2e7, "E": 2.4e7, "R": 2.1e7, "J": 3.8e7, "S": 3.8e7}


def draw_sky(n_epochs=30, clock_m=0.0, drift_m_s=0.0):
    """Draw ranges of fifteen satellites with rates of their own, and carrier, Doppler and C/N0 to match."""
    seconds = np.arange(float(n_epochs))[:, None]
    rates_m_s = np.linspace(-700.0, 700.0, len(SATS)) + drift_m_s
    begin_m = [{"C02": 3.8e7, "C08": 3.7e7, "C25": 2.3e7}.get(sat) or MIDDLE_M[sat[0]] for sat in SATS]
    range_m = np.array(begin_m) + rates_m_s * seconds
    noise_m = np.random.default_rng(5).normal(0.0, 1.0, range_m.shape)
    return {
        "pseudorange_m": range_m + noise_m + clock_m,
        "carrier_cyc": range_m / WAVELENGTH_M - 1e8,
        "doppler_hz": np.broadcast_to(-rates_m_s / WAVELENGTH_M, range_m.shape).copy(),
        "cn0_dbhz": np.full(range_m.shape, 44.0),
    }


def judge(cells, **options):
    elapsed_s = np.arange(float(len(cells["cn0_dbhz"])))
    carrier_hz = np.full(len(SATS), L1_HZ)
    return leave_out_impossible(cells, signals=SIGNALS, elapsed_s=elapsed_s, carrier_hz=carrier_hz, **options)


def assert_same(cells, kept):
    for name, values in cells.items():
        np.testing.assert_array_equal(kept[name], values, err_msg=name)


@pytest.mark.parametrize("clock_m", [0.0, 2.9e6, -2.9e6, 3e7, -1.5e7])
def test_a_receiver_clock_that_is_off_costs_no_cell(clock_m):
    cells = draw_sky(clock_m=clock_m, drift_m_s=3000.0)
    kept, found = judge(cells)
    assert_same(cells, kept)
    assert found.counts == found.misread == {}
    assert found.remarks == ()


def test_only_ranges_that_no_orbit_gives_are_left_out():
    cells = draw_sky()
    wrong = {
        "G01": 8.3e7,
        "E05": 4.5e7,
        "R01": 3.4e7,
        "C02": 2.2e7,
        "C25": 5.5e7,
        "J02": 2.2e7,
        "S23": 8.9e6,
        "G31": -5.0,
    }
    for sat, range_m in wrong.items():
        cells["pseudorange_m"][7:10, SATS.index(sat)] = range_m
    kept, found = judge(cells)
    gone = ~np.isfinite(kept["pseudorange_m"])
    assert sorted(SATS[k] for k in np.flatnonzero(gone.any(axis=0))) == sorted(wrong)
    assert (gone.sum(axis=0)[gone.any(axis=0)] == 3).all()
    assert found.counts == {"G C1C": 6, "E C1C": 3, "R C1C": 3, "C C2I": 6, "J C1C": 3, "S C1C": 3}
    assert np.isfinite(kept["carrier_cyc"]).all()


def test_cn0_and_doppler_beyond_what_is_possible_go():
    cells = draw_sky()
    cells["cn0_dbhz"][3, :2], cells["doppler_hz"][4, 5] = (-3.0, 75.0), 1e8
    kept, found = judge(cells)
    assert found.counts == {"G S1C": 2, "E D1C": 1}
    assert np.isfinite(kept["pseudorange_m"]).all()


@pytest.mark.parametrize(
    ("observable", "factor", "left_out"),
    [
        ("carrier_cyc", WAVELENGTH_M, "L1C"),  # metres
        ("carrier_cyc", -1.0, "L1C"),
        ("carrier_cyc", 2.0, "L1C"),
        ("doppler_hz", WAVELENGTH_M, "D1C"),  # metres a second
        ("doppler_hz", -WAVELENGTH_M, "D1C"),
        ("doppler_hz", -1.0, "D1C"),
    ],
)
def test_a_type_of_another_unit_or_sign_is_left_out(observable, factor, left_out):
    cells = draw_sky(clock_m=100.0, drift_m_s=150.0)
    its = [k for k, sat in enumerate(SATS) if sat[0] == "G"]
    cells[observable][:, its] *= factor
    kept, found = judge(cells)
    assert set(found.misread) == {f"G {left_out}"}
    assert found.counts == {f"G {left_out}": 30 * 5}
    assert np.isnan(kept[observable][:, its]).all()
    assert sum(np.isfinite(values).sum() for values in kept.values()) == 4 * 30 * len(SATS) - 150


def test_codes_in_cycles_within_the_bounds_are_the_codes_fault():
    cells = draw_sky()
    its = [k for k, sat in enumerate(SATS) if sat[0] == "G"]
    cells["pseudorange_m"][:, its] = cells["carrier_cyc"][:, its] - cells["carrier_cyc"][0, its] + 2.2e7
    _, found = judge(cells)
    assert set(found.misread) == {"G C1C"}


def test_columns_that_are_off_by_one_are_left_out_whole():
    cells = draw_sky()
    its = [k for k, sat in enumerate(SATS) if sat[0] == "G"]
    names = list(cells)
    shifted = {name: cells[other][:, its].copy() for name, other in itertools.pairwise(names)}
    for name, values in shifted.items():
        cells[name][:, its] = values
    kept, found = judge(cells)
    assert {"G C1C", "G L1C", "G D1C"} <= set(found.counts)
    assert not any(np.isfinite(kept[name][:, its]).any() for name in names[:3])


def test_cn0_in_place_of_doppler_is_left_out():
    cells = draw_sky()
    cells["doppler_hz"][:, :5] = cells["cn0_dbhz"][:, :5]
    _, found = judge(cells)
    assert set(found.misread) == {"G D1C"}


def test_what_an_attack_can_make_is_kept():
    cells = draw_sky()
    seconds = np.arange(30.0)[:, None]
    cells["pseudorange_m"][10:, :5] += 9e5  # a jump of three milliseconds
    cells["pseudorange_m"][:, 5:8] -= 400.0 * seconds  # codes that are drawn off their carriers
    cells["doppler_hz"][:, 8:10] = 300.0 + 1e3 * np.arange(2)  # a transmitter that keeps its frequency
    kept, _ = judge(cells)
    assert_same(cells, kept)


def test_a_contradiction_that_is_kept_is_a_remark():
    cells = draw_sky()
    cells["doppler_hz"][:, :5] = 1234.0
    kept, found = judge(cells)
    assert_same(cells, kept)
    assert [remark[:6] for remark in found.remarks] == ["G D1C "]


def test_a_type_that_was_misread_before_stays_left_out():
    cells = draw_sky(n_epochs=2)
    _, found = judge(cells, misread={"G L1C": "left out: half cycles"})
    assert found.counts == {"G L1C": 10}
    assert set(found.misread) == {"G L1C"}


def test_ten_types_are_named_and_the_others_counted():
    counts = {f"G C{k}X": k for k in range(1, 15)}
    (words,) = describe_impossible(counts, {})
    assert "G C14X 14" in words
    assert "G C4X" not in words
    assert words.endswith("and 4 more")
    assert describe_impossible({}, {}) == []
