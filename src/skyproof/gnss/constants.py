"""Constants of the interfaces, each the value that a message's users must use, not the best known one; and a bound."""

from typing import Final

__all__ = [
    "BDT_BEHIND_GPST_S",
    "BDT_WEEK_0",
    "BEIDOU_EARTH_ROTATION_RAD_S",
    "BEIDOU_MU_M3_S2",
    "CA_CHIP_RATE_HZ",
    "CA_CODE_LENGTH",
    "EARTH_ROTATION_RAD_S",
    "FASTEST_M_S",
    "FOOT_M",
    "GALILEO_MU_M3_S2",
    "GALILEO_RELATIVITY_F_S_SQRT_M",
    "GLONASS_EARTH_RADIUS_M",
    "GLONASS_EARTH_ROTATION_RAD_S",
    "GLONASS_J2",
    "GLONASS_MU_M3_S2",
    "GPS_PI",
    "L1_HZ",
    "MILLISECOND_M",
    "MU_M3_S2",
    "RELATIVITY_F_S_SQRT_M",
    "SECONDS_PER_DAY",
    "SECONDS_PER_WEEK",
    "SPEED_OF_LIGHT_M_S",
    "WGS84_A_M",
    "WGS84_F",
]

SPEED_OF_LIGHT_M_S: Final = 299_792_458.0  # IS-GPS-200N, 20.3.4.3 (and the SI)
MILLISECOND_M: Final = 1e-3 * SPEED_OF_LIGHT_M_S  # by whole ones receivers steer their clocks
FASTEST_M_S: Final = 4e4
"""By which a range changes at most: satellite and receiver in orbit, 10 km/s, and a clock of 100 ppm."""
L1_HZ: Final = 1575.42e6  # IS-GPS-200N, 3.3.1.1
CA_CHIP_RATE_HZ: Final = 1.023e6  # IS-GPS-200N, 3.3.2.3
CA_CODE_LENGTH: Final = 1023  # chips; IS-GPS-200N, 3.2.1.3
GPS_PI: Final = 3.1415926535898  # turns the message's semicircles to radians; IS-GPS-200N, table 20-IV
MU_M3_S2: Final = 3.986005e14  # WGS-84 value for GPS users; IS-GPS-200N, table 20-IV
EARTH_ROTATION_RAD_S: Final = 7.2921151467e-5  # IS-GPS-200N, table 20-IV
RELATIVITY_F_S_SQRT_M: Final = -4.442807633e-10  # F, in s / m^(1/2); IS-GPS-200N, 20.3.3.3.3.1
GALILEO_MU_M3_S2: Final = 3.986004418e14  # Galileo OS SIS ICD 2.1, table 67
GALILEO_RELATIVITY_F_S_SQRT_M: Final = -4.442807309e-10  # Galileo OS SIS ICD 2.1, 5.1.4; BeiDou's F has the same value
BEIDOU_MU_M3_S2: Final = 3.986004418e14  # BDS-SIS-ICD-B1I-3.0, 5.2.4.12
BEIDOU_EARTH_ROTATION_RAD_S: Final = 7.2921150e-5  # BDS-SIS-ICD-B1I-3.0, 5.2.4.12
BDT_WEEK_0: Final = 1356  # the GPS week in which BDT began: BDS-SIS-ICD-B1I-3.0, 3.3
BDT_BEHIND_GPST_S: Final = 14.0  # BDT began at 2006-01-01 UTC: BDS-SIS-ICD-B1I-3.0, 3.3
GLONASS_MU_M3_S2: Final = 3.986004418e14  # GLONASS ICD L1, L2 5.1, table 3.2
GLONASS_EARTH_RADIUS_M: Final = 6_378_136.0  # semi-major axis of PZ-90; GLONASS ICD L1, L2 5.1, table 3.2
GLONASS_J2: Final = 1082.62575e-6  # GLONASS ICD L1, L2 5.1, table 3.2
GLONASS_EARTH_ROTATION_RAD_S: Final = 7.292115e-5  # GLONASS ICD L1, L2 5.1, table 3.2
FOOT_M: Final = 0.3048  # the international one
SECONDS_PER_DAY: Final = 86_400
SECONDS_PER_WEEK: Final = 604_800  # IS-GPS-200N, 3.3.4
WGS84_A_M: Final = 6_378_137.0  # semi-major axis; NGA.STND.0036_1.0.0_WGS84, table 3.1
WGS84_F: Final = 1.0 / 298.257223563  # flattening; NGA.STND.0036_1.0.0_WGS84, table 3.1
