import numpy as np
import pytest

from skyproof.gnss.atmosphere import compute_klobuchar_s, compute_saastamoinen_m, compute_troposphere_m
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import Klobuchar
from skyproof.gnss.nominal import NOMINAL_KLOBUCHAR


def test_the_ionosphere_is_that_of_an_independent_program():
    # Orekit, KlobucharModelTest.compareExpectedValue (Apache-2.0): 23.784 m, tolerance 1 mm.
    klobuchar = Klobuchar(alpha=(0.3820e-7, 0.1490e-7, -0.1790e-6, 0.0), beta=(0.1430e6, 0.0, -0.3280e6, 0.1130e6))
    delay_s = compute_klobuchar_s(klobuchar, *np.radians([40.0, -100.0, 210.0, 20.0]), 20 * 3600.0 + 45 * 60.0)
    assert delay_s * SPEED_OF_LIGHT_M_S == pytest.approx(23.784, abs=1e-3)


def test_the_night_ionosphere_is_five_ns_times_obliquity():
    el_rad = np.radians([90.0, 30.0])
    delay_s = compute_klobuchar_s(NOMINAL_KLOBUCHAR, 0.7, 0.0, 1.0, el_rad, 2 * 3600.0)
    # IS-GPS-200N, 20.3.3.5.2.5: F = 1 + 16 (0.53 - E)^3, E in semicircles.
    np.testing.assert_allclose(delay_s, 5e-9 * (1.0 + 16.0 * (0.53 - el_rad / np.pi) ** 3), rtol=1e-12)


def test_the_ionosphere_follows_time_of_day_and_peaks_at_14_h():
    tow_s = np.arange(0.0, 2 * 86400.0, 900.0)
    delay_s = compute_klobuchar_s(NOMINAL_KLOBUCHAR, 0.5, 0.0, 0.0, np.pi / 2, tow_s)
    np.testing.assert_allclose(delay_s[:96], delay_s[96:], rtol=1e-12)
    assert tow_s[np.argmax(delay_s[:96])] == 50400.0  # 14 h local, at longitude 0


def test_the_ionosphere_is_constant_near_the_pole():
    # IS-GPS-200N, 20.3.3.5.2.5: the piercing point's latitude is held to 0.416 semicircles, 74.9 degrees.
    klobuchar = Klobuchar(alpha=(1e-8, 1e-7, 0.0, 0.0), beta=(1.2e5, 0.0, 0.0, 0.0))
    lat_rad = np.radians([73.5, 74.5, 76.0, 85.0])
    delay_s = compute_klobuchar_s(klobuchar, np.stack([lat_rad, -lat_rad]), 0.0, np.pi / 2, np.pi / 2, 43200.0)
    assert (delay_s[:, 2] == delay_s[:, 3]).all()
    assert delay_s[0, 0] < delay_s[0, 1] < delay_s[0, 2]
    assert delay_s[1, 0] >= delay_s[1, 1] >= delay_s[1, 2]


def test_hydrostatic_and_wet_zenith_delays_are_the_textbook_ones():
    # Saastamoinen 1972: 0.0022768 m per hPa at 45 degrees and sea level.
    assert compute_saastamoinen_m(np.pi / 4, 0.0, humidity=0.0) == pytest.approx(0.0022768 * 1013.25, abs=1e-6)
    # Saturation pressure at 15 C is 17.04 hPa (WMO No. 8, annex 4.B), ours 0.6 % more; 0.002277 (1255/T + 0.05) m/hPa.
    wet_m = compute_saastamoinen_m(np.pi / 4, 0.0, humidity=1.0) - compute_saastamoinen_m(np.pi / 4, 0.0, humidity=0.0)
    assert wet_m == pytest.approx(0.002277 * (1255.0 / 288.15 + 0.05) * 17.04, abs=2e-3)


def test_the_standard_atmosphere_thins_with_height():
    # ICAO Doc 7488: 898.75 hPa at 1000 m.
    assert compute_saastamoinen_m(np.pi / 4, 1000.0, humidity=0.0) == pytest.approx(0.0022768 * 898.75, rel=1e-3)
    zenith_m = compute_saastamoinen_m(0.5, np.array([-100.0, 0.0, 500.0, 5000.0, 11000.0, 1e6]))
    assert zenith_m[0] == zenith_m[1]
    assert zenith_m[4] == zenith_m[5]
    assert (np.diff(zenith_m[1:5]) < 0.0).all()


def test_a_low_satellite_shines_through_more_air():
    el_rad = np.radians([90.0, 30.0, 5.0])
    factor = compute_troposphere_m(0.7, 0.0, el_rad) / compute_saastamoinen_m(0.7, 0.0)
    # RTCA DO-229, A.4.2.4: 1 at the zenith, near the cosecant at 30 degrees, 10.2 at 5 degrees.
    np.testing.assert_allclose(factor, [1.0, 1.994, 10.218], rtol=1e-4)


def test_leading_axes_broadcast():
    el_rad = np.linspace(0.1, 1.5, 6)
    assert compute_troposphere_m(0.5, np.zeros((4, 1)), el_rad).shape == (4, 6)
    assert compute_klobuchar_s(NOMINAL_KLOBUCHAR, 0.5, 0.2, el_rad, el_rad, np.zeros((4, 1))).shape == (4, 6)
