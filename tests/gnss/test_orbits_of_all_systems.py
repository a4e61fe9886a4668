"""Orbits of Galileo, BeiDou, QZSS and GLONASS against an independent program's, and the laws they have to keep."""

from dataclasses import replace

import numpy as np
import pytest
from tests.gnss import orbit_twin
from tests.gnss.orbit_twin import clock_polynomial_s

from skyproof.formats.rinex_nav import read_nav
from skyproof.gnss import orbit_kernels
from skyproof.gnss.ephemeris import Ephemeris, GlonassEphemeris, NavigationData, group_delay_s
from skyproof.gnss.orbits import compute_satellite_state, compute_satellite_state_s
from skyproof.gnss.time import gpst

# RTKLIB (pyrtklib 0.2.7), readrnx with eph2pos and geph2pos, on real/rinex-mosaic-1m/base.nav: satellite, message,
# second of GPS week 2320, seconds from the time of ephemeris, ECEF m, clock s. C01, C59 and C60 are geostationary.
GOLDEN = (
    ("E04", "INAV", 116434.5, 1234.5, (-5497138.6886, 26318208.6381, 12383030.1833), -4.2883818420618185e-04),
    ("E33", "INAV", 114320.0, -880.0, (-26538513.3412, 13023990.9898, -1447984.5381), 1.311043784108763e-05),
    ("C01", "D2", 114334.0, -880.0, (-34307415.4606, 24457889.7867, 1431238.1334), 9.03939691119524e-04),
    ("C01", "D2", 116448.5, 1234.5, (-34311546.9934, 24453884.2986, 1373736.27), 9.03944239514857e-04),
    ("C60", "D2", 116448.5, 1234.5, (7301527.7794, 41483353.3729, 1725338.5192), -6.483948964829134e-07),
    ("C13", "D1", 116448.5, 1234.5, (-1270067.5687, 21665553.518, 36307500.5664), 4.385158527714312e-04),
    ("C25", "D1", 114334.0, -880.0, (-26914275.497, -3058481.3778, 6661709.4622), 4.3385795729989393e-04),
    ("J02", "LNAV", 117920.0, -880.0, (-27892917.5185, 15194341.8121, -23075426.3218), -4.880951415094862e-07),
    ("R01", "FDMA", 115238.0, -880.0, (-12416295.8296, -1041356.0129, 22261746.8024), 8.934004290495244e-05),
    ("R03", "FDMA", 116118.25, 0.25, (7410364.6913, 22441681.6833, 9718265.3555), 1.0267924540127368e-04),
    ("R24", "FDMA", 117352.5, 1234.5, (-13939404.8234, 19561030.0694, -8547294.1614), -6.110631966293868e-05),
)
EPHEMERIS = Ephemeris(
    sat="C01", week=2320, toe=115200.0, toc_week=2320, toc=115200.0, af0=-1.1e-4, af1=-3.4e-12, af2=2e-19, tgd=-5e-9,
    tgd2=3e-9, iode=1, iodc=1, sqrt_a=6493.5, e=0.0006, i0=0.09, omega0=-2.9, omega=1.02, m0=-2.31, delta_n=-2.6e-9,
    idot=-3.3e-10, omega_dot=1.06e-9, crs=-84.9, crc=272.1, cus=6.0e-6, cuc=-4.6e-6, cis=1.1e-7, cic=-9.3e-8,
    message="D2",
)  # fmt: skip
GLONASS = GlonassEphemeris(
    sat="R10", week=2213, toe=294318.0, tau_n=8.3e-5, gamma_n=9.1e-13, frequency_number=-7,
    position_m=(23738359.86328, 9180367.1875, -2194117.675781),
    velocity_m_s=(-232.55443573, -245.2783584595, -3543.992996216), acceleration_m_s2=(9.3e-07, -9.3e-07, 9.3e-07),
)  # fmt: skip


@pytest.mark.shared_data
@pytest.mark.parametrize(("sat", "message", "tow_s", "since_s", "ecef_m", "clock_s"), GOLDEN)
def test_positions_and_clocks_are_those_of_rtklib(shared_data, sat, message, tow_s, since_s, ecef_m, clock_s):
    navigation = read_nav(shared_data / "real" / "rinex-mosaic-1m" / "base.nav")
    at = gpst(2320, tow_s)
    (eph, *_) = [e for e in navigation.ephemerides if e.sat == sat and getattr(e, "message", "FDMA") == message
                 and abs((at - e.reference_gpst) / np.timedelta64(1, "ns") - since_s * 1e9) < 0.5]  # fmt: skip
    state = compute_satellite_state(eph, at)
    # The printed digits; of GLONASS RTKLIB has a GM that ends at ...44 instead of 4418: 2 mm in 20 min.
    tolerance_m = 3e-3 if sat[0] == "R" else 2e-4
    np.testing.assert_allclose(state.position_ecef_m, ecef_m, rtol=0, atol=tolerance_m)
    assert abs(float(state.clock_s) - clock_s) < 1e-15


@pytest.mark.parametrize("eph", [EPHEMERIS, replace(EPHEMERIS, sat="C20"), replace(EPHEMERIS, sat="E05"), GLONASS],
                         ids=["geostationary", "BeiDou", "Galileo", "GLONASS"])  # fmt: skip
def test_velocity_and_drift_are_the_rates_of_position_and_clock(eph):
    tow_s = eph.toe + np.array([-700.0, 10.0, 845.0])
    before, after = (compute_satellite_state_s(eph, eph.week, tow_s + h) for h in (-0.5, 0.5))
    state = compute_satellite_state_s(eph, eph.week, tow_s)
    np.testing.assert_allclose(after.position_ecef_m - before.position_ecef_m, state.velocity_ecef_m_s, atol=2e-6)
    np.testing.assert_allclose(after.clock_s - before.clock_s, state.clock_drift, atol=1e-19)


@pytest.mark.parametrize("kernel", [orbit_kernels.fill_states, orbit_kernels.fill_states.py_func],
                         ids=["compiled", "python"])  # fmt: skip
@pytest.mark.parametrize("eph", [EPHEMERIS, replace(EPHEMERIS, sat="C20"), replace(EPHEMERIS, sat="E05"), GLONASS],
                         ids=["geostationary", "BeiDou", "Galileo", "GLONASS"])  # fmt: skip
def test_the_kernel_of_orbits_equals_its_numpy_twin(eph, kernel):
    tow_s = eph.toe + np.array([-899.0, 0.0, 59.9, 60.0, 3.1, np.nan, 600.5, 1790.0, -61.0, 2e5])
    week = np.full(tow_s.size, eph.week)
    states = np.empty((tow_s.size, orbit_kernels.N_STATE))
    kernel(eph.orbit_row, week, tow_s, states)
    twin = orbit_twin.satellite_state_s(eph, week, tow_s)
    np.testing.assert_allclose(states[:, :3], twin.position_ecef_m, rtol=0, atol=5e-8)
    np.testing.assert_allclose(states[:, 3:6], twin.velocity_ecef_m_s, rtol=0, atol=1e-11)
    np.testing.assert_allclose(states[:, 6], twin.clock_s, rtol=1e-14)
    np.testing.assert_allclose(states[:, 7], twin.clock_drift, rtol=1e-12)


def test_a_glonass_instant_does_not_depend_on_the_others():
    tow_s = GLONASS.toe + np.linspace(-900.0, 900.0, 37)
    together = compute_satellite_state_s(GLONASS, GLONASS.week, tow_s.reshape(1, 37)).position_ecef_m[0]
    alone = np.array([compute_satellite_state_s(GLONASS, GLONASS.week, t).position_ecef_m for t in tow_s])
    np.testing.assert_array_equal(together, alone)
    assert np.isnan(compute_satellite_state_s(GLONASS, GLONASS.week + 1, GLONASS.toe).position_ecef_m).all()


def test_glonass_there_and_back_comes_home():
    state = compute_satellite_state_s(GLONASS, GLONASS.week, GLONASS.toe + 900.0)
    later = replace(GLONASS, toe=GLONASS.toe + 900.0, position_m=tuple(state.position_ecef_m),
                    velocity_m_s=tuple(state.velocity_ecef_m_s))  # fmt: skip
    back = compute_satellite_state_s(later, GLONASS.week, GLONASS.toe)
    np.testing.assert_allclose(back.position_ecef_m, GLONASS.position_m, atol=1e-4)


def test_beidou_counts_fourteen_seconds_behind_gps():
    as_galileo = replace(EPHEMERIS, sat="E01")
    ours, theirs = (clock_polynomial_s(e, 2320, 115200.0 + late) for e, late in ((EPHEMERIS, 14.0), (as_galileo, 0.0)))
    assert ours == theirs == EPHEMERIS.af0
    assert (EPHEMERIS.reference_gpst - as_galileo.reference_gpst) / np.timedelta64(1, "s") == 14.0


def test_each_signal_has_the_group_delay_of_its_message():
    galileo = replace(EPHEMERIS, sat="E01", tgd=1e-9, tgd2=2e-9)
    assert group_delay_s(replace(galileo, message="FNAV"), "E1", "C") == 1e-9
    assert group_delay_s(replace(galileo, message="INAV"), "E1", "C") == 2e-9
    assert group_delay_s(EPHEMERIS, "B1", "2I") == -5e-9
    assert group_delay_s(EPHEMERIS, "B2", "7I") == 3e-9
    assert group_delay_s(EPHEMERIS, "B3", "6I") == 0.0
    assert group_delay_s(replace(EPHEMERIS, sat="J02"), "L1", "CA") == -5e-9
    assert group_delay_s(GLONASS, "G1", "CA") == 0.0
    assert np.isnan(group_delay_s(GLONASS, "G2", "CA"))
    assert np.isnan(group_delay_s(replace(galileo, message="INAV"), "E5a", "Q"))


def test_the_best_ephemeris_is_healthy_and_of_its_systems_age():
    qzss = replace(EPHEMERIS, sat="J02", health=1)  # the bit of L1C/B
    navigation = NavigationData(ephemerides=(GLONASS, replace(GLONASS, toe=GLONASS.toe + 900.0, health=1), qzss,
                                             replace(qzss, sat="J03", health=32)))  # fmt: skip
    assert navigation.best("R10", gpst(2213, GLONASS.toe + 1000.0)) is GLONASS
    assert navigation.best("R10", gpst(2213, GLONASS.toe + 1900.0)) is None
    assert navigation.best("J02", gpst(2320, 115200.0)) is qzss
    assert navigation.best("J03", gpst(2320, 115200.0)) is None
