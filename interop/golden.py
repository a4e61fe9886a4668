"""Prints the numbers that tests/gnss/test_golden.py holds: `golden.py DATA`, DATA the folder of recordings.

Not a line of skyproof takes part, and skyproof does not depend on what does. In an environment of its own:
`pip install pyrtklib==0.2.7 pymap3d==3.2.0 pyproj==3.7.2 astropy==8.0.2`.
"""

import sys
from pathlib import Path

import astropy.units as u
import pymap3d
import pyproj
import pyrtklib as rtk
from astropy.time import Time
from astropy.utils.iers import LeapSeconds

# File, satellite, week, second of week: one instant near the time of ephemeris, one at the edge of its use.
ORBITS = (
    ("rf/brdc0010.22n", 5, 2190, 597600.0),
    ("rf/brdc0010.22n", 16, 2190, 596770.25),
    ("rf/brdc0010.22n", 18, 2190, 564001.5),
    ("rf/brdc0010.22n", 29, 2190, 522300.0),
    ("real/brdc/brdc3050.12n", 11, 1712, 300000.0),
    ("real/brdc/brdc3050.12n", 31, 1712, 331234.5),
    ("real/rinex-gsi-3km/07590920.05n", 28, 1316, 518410.0),
    ("real/rinex-gsi-3km/07590920.05n", 3, 1316, 521929.996),
)
PLACES_DEG_M = (
    (59.4121, 16.8837, 31.0),
    (-33.8688, 151.2093, 58.0),
    (0.0, -179.9999, 4000.0),
    (78.23, 15.65, -40.0),
    (-89.9, 45.0, 2835.0),
    (35.6, 139.7, 20_200_000.0),
)
IONOSPHERE = ((1.1176e-08, -7.4506e-09, -5.9605e-08, 1.1921e-07), (1.1674e05, -2.2938e05, -1.3107e05, 1.0486e06))
IONOSPHERE_AT = (
    (40.0, 260.0, 210.0, 20.0, 74700.0),
    (-33.9, 151.2, 15.0, 5.0, 18000.0),
    (1.3, 103.8, 300.0, 75.0, 21600.0),
    (71.0, 25.0, 90.0, 12.0, 600000.0),
    (-54.8, -68.3, 181.0, 33.0, 68400.0),
)
INSTANTS = (
    "1980-01-06T00:00:19.5",
    "1994-07-01T00:00:00",
    "2005-12-31T23:59:59.75",
    "2016-12-31T23:59:59.5",
    "2022-01-01T21:45:58",
    "2038-11-21T12:34:56.125",
)


def orbits(data: Path) -> None:
    for file, prn, week, tow_s in ORBITS:
        navigation = rtk.nav_t()
        rtk.readrnx(str(data / file), 1, "", rtk.obs_t(), navigation, rtk.sta_t())
        time = rtk.gpst2time(week, tow_s)
        own = [navigation.eph[k] for k in range(navigation.n) if navigation.eph[k].sat == prn]  # GPS: number is PRN
        best = min(own, key=lambda eph: abs(eph.toe.time + eph.toe.sec - time.time - time.sec))
        position_m, clock_s, variance = rtk.Arr1Ddouble(3), rtk.Arr1Ddouble(1), rtk.Arr1Ddouble(1)
        rtk.eph2pos(time, best, position_m, clock_s, variance)
        ecef_m = ", ".join(f"{position_m[k]:.4f}" for k in range(3))
        print(f'    ("{file}", "G{prn:02d}", {week}, {tow_s!r}, {best.iode}, ({ecef_m}), {clock_s[0]:.15e}),')


def ionosphere() -> None:
    coefficients = rtk.Arr1Ddouble(8)
    for k, value in enumerate((*IONOSPHERE[0], *IONOSPHERE[1])):
        coefficients[k] = value
    for lat, lon, az, el, tow_s in IONOSPHERE_AT:
        place, direction = rtk.Arr1Ddouble(3), rtk.Arr1Ddouble(2)
        degree = 0.017453292519943295
        place[0], place[1], place[2] = lat * degree, lon * degree, 0.0
        direction[0], direction[1] = az * degree, el * degree
        print(
            f"    ({lat}, {lon}, {az}, {el}, {tow_s}, "
            f"{rtk.ionmodel(rtk.gpst2time(2190, tow_s), coefficients, place, direction):.6f}),"
        )


def troposphere() -> None:
    for lat, _, height_m in PLACES_DEG_M[:4]:
        place, zenith = rtk.Arr1Ddouble(3), rtk.Arr1Ddouble(2)
        place[0], place[1], place[2] = lat * 0.017453292519943295, 0.0, height_m
        zenith[0], zenith[1] = 0.0, 1.5707963267948966
        print(f"    ({lat}, {height_m}, {rtk.tropmodel(rtk.gpst2time(2190, 0.0), place, zenith, 0.6):.5f}),")


def frames() -> None:
    to_ecef = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
    for lat, lon, height_m in PLACES_DEG_M:
        ecef_m = ", ".join(f"{x:.6f}" for x in to_ecef.transform(lon, lat, height_m))
        print(f"    ({lat}, {lon}, {height_m}, ({ecef_m})),")
    for lat, lon, height_m in PLACES_DEG_M[:5]:
        satellite_m = (-12.3e6, 14.1e6, 19.2e6)
        enu_m = ", ".join(f"{x:.5f}" for x in pymap3d.ecef2enu(*satellite_m, lat, lon, height_m))
        az_deg, el_deg, _ = pymap3d.ecef2aer(*satellite_m, lat, lon, height_m)
        print(f"    ({lat}, {lon}, {height_m}, ({enu_m}), {az_deg:.10f}, {el_deg:.10f}),")


def times() -> None:
    for row in LeapSeconds.auto_open():
        if row["year"] > 1980:
            print(f'    ("{row["year"]}-{row["month"]:02d}-01", {row["tai_utc"] - 19}),')
    for text in INSTANTS:
        seconds = Time(text, scale="utc").to_value("gps", subfmt="decimal")  # decimals: a float loses nanoseconds
        week = int(seconds // 604800)
        print(f'    ("{text}", {week}, {round(float(seconds - week * 604800), 9)!r}),')
    print((Time("2024-01-01", scale="tai") - Time("1980-01-06T00:00:19", scale="tai")).to(u.s))


if __name__ == "__main__":
    orbits(Path(sys.argv[1]))
    ionosphere()
    troposphere()
    frames()
    times()
