"""Golden numbers that programs of others gave: RTKLIB, PROJ, pymap3d, astropy. `interop/golden.py` prints them again.

Each tolerance is what the printed digits and double precision leave, but for those that say otherwise. Where orbits
really were, nothing here shows: precise products of the days of these files are not at hand.
"""

import numpy as np
import pytest

from skyproof.formats.rinex_nav import read_nav
from skyproof.gnss.atmosphere import compute_klobuchar_s, compute_saastamoinen_m
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import Klobuchar
from skyproof.gnss.frames import ecef_from_geodetic, geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.orbits import compute_satellite_state_s
from skyproof.gnss.sky import compute_azimuth_elevation
from skyproof.gnss.time import gpst, gpst_from_utc, leap_seconds, utc_from_gpst, week_and_tow

# RTKLIB (pyrtklib 0.2.7), readrnx and eph2pos: file, satellite, week, second of week, IODE, ECEF m, clock s.
ORBITS = (
    ("rf/brdc0010.22n", "G05", 2190, 597600.0, 67,
     (-15789851.6729, 8582410.3439, 19443289.7798), -6.645197386087708e-05),
    ("rf/brdc0010.22n", "G16", 2190, 596770.25, 78,
     (17447855.7501, -4770624.2012, 19348455.4191), -4.494591733822912e-04),
    ("rf/brdc0010.22n", "G18", 2190, 564001.5, 107,
     (5155733.8693, -25899315.0993, 2268153.0673), 2.690648106861881e-04),
    ("rf/brdc0010.22n", "G29", 2190, 522300.0, 83,
     (-7245771.4610, 13173486.9485, -21932905.4318), -4.614414205585233e-04),
    ("real/brdc/brdc3050.12n", "G11", 1712, 300000.0, 30,
     (11599273.0815, -23556912.7327, -3162213.6992), -3.183540807972759e-04),
    ("real/brdc/brdc3050.12n", "G31", 1712, 331234.5, 69,
     (-18935125.8760, 8527712.2851, 16896834.4633), 2.840612181802228e-04),
    ("real/rinex-gsi-3km/07590920.05n", "G28", 1316, 518410.0, 111,
     (-2406143.4227, 17495055.6461, 19969623.4086), 4.688724570611568e-05),
    ("real/rinex-gsi-3km/07590920.05n", "G03", 1316, 521929.996, 83,
     (-22490262.9427, -11062875.9437, -9312052.8070), 9.673934887681567e-05),
)  # fmt: skip

# RTKLIB, ionmodel: latitude, longitude, azimuth, elevation in degrees, second of week, L1 delay m.
KLOBUCHAR = Klobuchar(alpha=(1.1176e-08, -7.4506e-09, -5.9605e-08, 1.1921e-07),
                      beta=(1.1674e05, -2.2938e05, -1.3107e05, 1.0486e06))  # fmt: skip
IONOSPHERE = (
    (40.0, 260.0, 210.0, 20.0, 74700.0, 8.213151),
    (-33.9, 151.2, 15.0, 5.0, 18000.0, 13.738525),
    (1.3, 103.8, 300.0, 75.0, 21600.0, 4.958989),
    (71.0, 25.0, 90.0, 12.0, 600000.0, 3.884528),
    (-54.8, -68.3, 181.0, 33.0, 68400.0, 5.857706),
)

# RTKLIB, tropmodel at the zenith, humidity 0.6: latitude degrees, height m, delay m.
TROPOSPHERE = ((59.4121, 31.0, 2.39759), (-33.8688, 58.0, 2.39441), (0.0, 4000.0, 1.42607), (78.23, -40.0, 2.40463))

# PROJ (pyproj 3.7.2), EPSG:4979 to 4978: latitude, longitude degrees, height m, ECEF m.
PLACES = (
    (59.4121, 16.8837, 31.0, (3113427.338140, 944964.138081, 5467465.230440)),
    (-33.8688, 151.2093, 58.0, (-4646093.477288, 2553229.535817, -3534404.710910)),
    (0.0, -179.9999, 4000.0, (-6382136.999990, -11.138930, 0.000000)),
    (78.23, 15.65, -40.0, (1256832.537906, 352096.532565, 6222185.794920)),
    (-89.9, 45.0, 2835.0, (7901.451714, 7901.451714, -6359577.562791)),
    (35.6, 139.7, 20200000.0, (-16486292.982609, 13981393.205906, 15451079.015713)),
)

# pymap3d 3.2.0: of a satellite at SEEN_M from latitude, longitude degrees, height m: east, north, up m, azimuth and
# elevation degrees.
SEEN_M = np.array([-12.3e6, 14.1e6, 19.2e6])
DIRECTIONS = (
    (59.4121, 16.8837, 31.0, (17064525.82448, 16395669.57591, 6260606.96554), 46.1451677592, 14.8184086467),
    (-33.8688, 151.2093, 58.0, (-6433206.00874, 25714067.80331, -2482725.96679), 345.9539234454, -5.3509673421),
    (0.0, -179.9999, 4000.0, (-14100021.46753, 19200000.00000, 5917838.39084), 323.7073286538, 13.9513958718),
    (78.23, 15.65, -40.0, (16895328.98103, 11796371.61442, 10798596.90467), 55.0771340786, 27.6568551133),
    (-89.9, 45.0, 2835.0, (18667619.02332, 1306225.80015, -25557336.69589), 85.9973772127, -53.7881469523),
)

# IERS, Leap_Second.dat (valid to 2027-06-28) as astropy carries it: from this day of UTC on, GPS is ahead by so much.
LEAPS = (
    ("1981-07-01", 1), ("1982-07-01", 2), ("1983-07-01", 3), ("1985-07-01", 4), ("1988-01-01", 5), ("1990-01-01", 6),
    ("1991-01-01", 7), ("1992-07-01", 8), ("1993-07-01", 9), ("1994-07-01", 10), ("1996-01-01", 11), ("1997-07-01", 12),
    ("1999-01-01", 13), ("2006-01-01", 14), ("2009-01-01", 15), ("2012-07-01", 16), ("2015-07-01", 17),
    ("2017-01-01", 18),
)  # fmt: skip

# astropy 8.0.2, Time(utc).gps: UTC, GPS week, second of week.
WEEKS = (
    ("1980-01-06T00:00:19.5", 0, 19.5),
    ("1994-07-01T00:00:00", 755, 432010.0),
    ("2005-12-31T23:59:59.75", 1356, 12.75),
    ("2016-12-31T23:59:59.5", 1930, 16.5),
    ("2022-01-01T21:45:58", 2190, 596776.0),
)


@pytest.mark.shared_data
@pytest.mark.parametrize(("file", "sat", "week", "tow_s", "iode", "position_m", "clock_s"), ORBITS)
def test_orbits_and_clocks_are_those_of_rtklib(shared_data, file, sat, week, tow_s, iode, position_m, clock_s):
    ephemeris = read_nav(shared_data / file).best(sat, gpst(week, tow_s))
    assert ephemeris.iode == iode
    state = compute_satellite_state_s(ephemeris, week, tow_s)
    np.testing.assert_allclose(state.position_ecef_m, position_m, rtol=0.0, atol=1e-4)
    # RTKLIB reads the polynomial at satellite time less its own clock: af1 times half a millisecond is 1e-14 s.
    assert abs(float(state.clock_s) - clock_s) < 3e-14


@pytest.mark.parametrize(("lat_deg", "lon_deg", "az_deg", "el_deg", "tow_s", "delay_m"), IONOSPHERE)
def test_the_ionosphere_is_that_of_rtklib(lat_deg, lon_deg, az_deg, el_deg, tow_s, delay_m):
    delay_s = compute_klobuchar_s(KLOBUCHAR, *np.radians([lat_deg, lon_deg, az_deg, el_deg]), tow_s)
    assert float(delay_s) * SPEED_OF_LIGHT_M_S == pytest.approx(delay_m, abs=1e-6)


@pytest.mark.parametrize(("lat_deg", "height_m", "zenith_m"), TROPOSPHERE)
def test_the_troposphere_at_the_zenith_is_that_of_rtklib(lat_deg, height_m, zenith_m):
    # Both after Saastamoinen with a vapour pressure by the same formula; 0.1 mm.
    assert float(compute_saastamoinen_m(np.radians(lat_deg), height_m)) == pytest.approx(zenith_m, abs=1e-4)


@pytest.mark.parametrize(("lat_deg", "lon_deg", "height_m", "ecef_m"), PLACES)
def test_places_are_where_proj_puts_them(lat_deg, lon_deg, height_m, ecef_m):
    lat_rad, lon_rad = np.radians([lat_deg, lon_deg])
    np.testing.assert_allclose(ecef_from_geodetic(lat_rad, lon_rad, height_m), ecef_m, rtol=0.0, atol=1e-6)
    back_lat_rad, back_lon_rad, back_height_m = geodetic_from_ecef(np.array(ecef_m))
    assert abs(back_lat_rad - lat_rad) < 1e-12  # 6 um on the ground
    assert abs(back_height_m - height_m) < 2e-6
    assert abs(back_lon_rad - lon_rad) * np.hypot(*ecef_m[:2]) < 2e-6


@pytest.mark.parametrize(("lat_deg", "lon_deg", "height_m", "enu_m", "az_deg", "el_deg"), DIRECTIONS)
def test_directions_are_those_of_pymap3d(lat_deg, lon_deg, height_m, enu_m, az_deg, el_deg):
    lat_rad, lon_rad = np.radians([lat_deg, lon_deg])
    here_m = ecef_from_geodetic(lat_rad, lon_rad, height_m)
    np.testing.assert_allclose(rot_enu_ecef(lat_rad, lon_rad) @ (SEEN_M - here_m), enu_m, rtol=0.0, atol=2e-5)
    az_rad, el_rad = compute_azimuth_elevation(here_m, SEEN_M)
    assert np.degrees(az_rad) == pytest.approx(az_deg, abs=1e-9)
    assert np.degrees(el_rad) == pytest.approx(el_deg, abs=1e-9)


@pytest.mark.parametrize(("day", "leaps"), LEAPS)
def test_every_leap_second_of_the_iers_is_counted_and_no_other(day, leaps):
    midnight = np.datetime64(day, "ns")
    before, after = (gpst_from_utc(midnight + np.timedelta64(ms, "ms")) for ms in (-1, 0))
    assert (leap_seconds(before), leap_seconds(after)) == (leaps - 1, leaps)
    assert after - before == np.timedelta64(1001, "ms")
    if (day, leaps) == LEAPS[-1]:
        assert leap_seconds(np.datetime64("2027-06-28", "ns")) == leaps


@pytest.mark.parametrize(("utc", "week", "tow_s"), WEEKS)
def test_weeks_and_seconds_are_those_of_astropy(utc, week, tow_s):
    instant = gpst_from_utc(np.datetime64(utc, "ns"))
    assert week_and_tow(instant) == (week, pytest.approx(tow_s, abs=1e-9))
    assert utc_from_gpst(instant) == np.datetime64(utc, "ns")
