"""RINEX navigation: real files of many writers, and damage of every kind done to a small one."""

import gzip
import math
import re
from collections import Counter
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skyproof.errors import InputError, OutputError
from skyproof.formats.rinex_nav import get_glonass_channels, parse_nav, read_nav, write_nav
from skyproof.gnss.ephemeris import Ephemeris, NavigationData, UtcParameters
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.time import gpst, parse_iso, seconds_between, week_and_tow

VERSION_2 = """\
     2              NAVIGATION DATA                         RINEX VERSION / TYPE
CCRINEXN V1.6.0 UX  CDDIS               02-JAN-22 18:31     PGM / RUN BY / DATE
    0.1211D-07 -0.7451D-08 -0.5960D-07  0.1192D-06          ION ALPHA
    0.1167D+06 -0.2458D+06 -0.6554D+05  0.1114D+07          ION BETA
    0.279396772385D-08 0.799360577730D-14   147456     2191 DELTA-UTC: A0,A1,T,W
    18                                                      LEAP SECONDS
                                                            END OF HEADER
 1 22  1  1  0  0  0.0 0.469126738608D-03-0.100044417195D-10 0.000000000000D+00
    0.390000000000D+02-0.141125000000D+03 0.398838041777D-08-0.624294238235D+00
   -0.736303627491D-05 0.112181392033D-01 0.469572842121D-05 0.515367499542D+04
    0.518400000000D+06-0.316649675369D-07-0.103661124009D+01 0.195577740669D-06
    0.986418769490D+00 0.299750000000D+03 0.884087601569D+00-0.813355308085D-08
   -0.377872882780D-09 0.100000000000D+01 0.219000000000D+04 0.000000000000D+00
    0.200000000000D+01 0.000000000000D+00 0.512227416039D-08 0.390000000000D+02
    0.511218000000D+06 0.400000000000D+01 0.000000000000D+00 0.000000000000D+00
 2 22  1  1  0  0  0.0-0.647393986583D-03-0.113686837722D-11 0.000000000000D+00
    0.410000000000D+02-0.142718750000D+03 0.455626121514D-08-0.453245129719D+00
   -0.748783349991D-05 0.206388905644D-01 0.423192977905D-05 0.515366817474D+04
    0.518400000000D+06-0.258907675743D-06-0.112496293255D+01 0.122934579849D-06
    0.964744088915D+00 0.303625000000D+03-0.146476911829D+01-0.868964767299D-08
   -0.262153776900D-09 0.100000000000D+01 0.219000000000D+04 0.000000000000D+00
    0.200000000000D+01 0.630000000000D+02-0.176951289177D-07 0.410000000000D+02
    0.512376000000D+06 0.400000000000D+01 0.000000000000D+00 0.000000000000D+00
""".splitlines()

VERSION_3_HEADER = """\
     3.04           N: GNSS NAV DATA    M: MIXED            RINEX VERSION / TYPE
sbf2rin-15.9.0                          20240624 104231 UTC PGM / RUN BY / DATE
GPSA   1.8626E-08  2.2352E-08 -1.1921E-07 -5.9605E-08       IONOSPHERIC CORR
GPSB   1.2902E+05  1.6384E+05 -1.9661E+05 -2.6214E+05       IONOSPHERIC CORR
GAL    1.6175E+02  6.6016E-01  1.9379E-02  0.0000E+00       IONOSPHERIC CORR
GPUT -9.3132257462E-10-7.993605777E-15 319488 2320          TIME SYSTEM CORR
    18    18  2185     7                                    LEAP SECONDS
    14    14  2185     7BDS                                 LEAP SECONDS
                                                            END OF HEADER
""".splitlines()
GPS_RECORD = """\
G05 2024 06 24 10 00 00-1.774230040610E-04-1.364242052659E-12 0.000000000000E+00
     7.200000000000E+01-9.821875000000E+01 4.293035965037E-09 1.714815412488E+00
    -5.291774868965E-06 5.927642923780E-03 1.830980181694E-06 5.153635631561E+03
     1.224000000000E+05 3.352761268616E-08 2.520897825810E+00-5.774199962616E-08
     9.719266524177E-01 3.536250000000E+02 1.273307347665E+00-8.275344701323E-09
    -2.610823036973E-10 1.000000000000E+00 2.320000000000E+03 0.000000000000E+00
     2.000000000000E+00 0.000000000000E+00-1.071020960808E-08 7.200000000000E+01
     1.152180000000E+05 4.000000000000E+00
""".splitlines()
OTHER_RECORDS = """\
S23 2024 06 24 08 15 00 3.219847567379E-05 0.000000000000E+00 1.152000000000E+05
     1.188000000000E+04-1.767650246620E+00-2.712457791886E-09 0.000000000000E+00
     1.164990423670E+04-6.385937500000E-01-4.683612896077E-09 1.000000000000E+00
     0.000000000000E+00 2.000000000000E+00 2.320000000000E-09 0.000000000000E+00
I12 2024 06 24 08 20 00 3.219847567379E-04-3.410605131648E-13 0.000000000000E+00
     1.188000000000E+05-1.767650246620E-06-2.712457791886E-09 0.000000000000E+00
""".splitlines()
VERSION_3 = [*VERSION_3_HEADER, *GPS_RECORD, *OTHER_RECORDS]

VERSION_4 = [
    "     4.00           N: GNSS NAV DATA    M: MIXED            RINEX VERSION / TYPE",
    "    18                                                      LEAP SECONDS",
    "                                                            END OF HEADER",
    "> EPH G05 LNAV",
    *GPS_RECORD,
    "> EPH G05 CNAV",
    *GPS_RECORD,
    "> STO G05 LNAV",
    "    2022 06 10 19 56 48 GPUT                                  UTC(USNO)",
    "     2.952840000000E+05 9.313225746155E-10 2.664535259100E-15 0.000000000000E+00",
    "> ION G29 LNAV",
    "    2022 06 08 09 59 48 1.024454832077E-08 2.235174179077E-08-5.960464477539E-08",
    "    -1.192092895508E-07 9.625600000000E+04 1.310720000000E+05-6.553600000000E+04",
    "    -5.898240000000E+05 0.000000000000E+00",
    "> EPH I12 LNAV",
    *OTHER_RECORDS[4:],
]


def drop_line(lines, number):
    return [*lines[:number], *lines[number + 1 :]]


def change_line(lines, number, old, new):
    assert old in lines[number]
    return [*lines[:number], lines[number].replace(old, new), *lines[number + 1 :]]


# ---------------------------------------------------------------- what stands where


def test_version_2_gives_every_value_its_place():
    navigation = parse_nav(VERSION_2, source="brdc")
    eph, second = navigation.ephemerides
    assert asdict(eph) == {
        "sat": "G01",
        "week": 2190,
        "toe": 518400.0,
        "toc_week": 2190,
        "toc": 518400.0,
        "af0": 0.469126738608e-03,
        "af1": -0.100044417195e-10,
        "af2": 0.0,
        "tgd": 0.512227416039e-08,
        "iode": 39,
        "iodc": 39,
        "sqrt_a": 0.515367499542e04,
        "e": 0.112181392033e-01,
        "i0": 0.986418769490,
        "omega0": -0.103661124009e01,
        "omega": 0.884087601569,
        "m0": -0.624294238235,
        "delta_n": 0.398838041777e-08,
        "idot": -0.377872882780e-09,
        "omega_dot": -0.813355308085e-08,
        "crs": -141.125,
        "crc": 299.75,
        "cus": 0.469572842121e-05,
        "cuc": -0.736303627491e-05,
        "cis": 0.195577740669e-06,
        "cic": -0.316649675369e-07,
        "health": 0,
        "ura_index": 0,
        "fit_interval_h": 4.0,
        "code_on_l2": 1,
        "l2_p_flag": 0,
        "transmission_tow": 511218.0,
        "message": "LNAV",
        "tgd2": 0.0,
        "a_dot": 0.0,
        "delta_n_dot": 0.0,
        "delays_s": (),
    }
    assert (second.sat, second.health) == ("G02", 63)
    assert navigation.ionosphere.alpha == (0.1211e-07, -0.7451e-08, -0.5960e-07, 0.1192e-06)
    assert navigation.ionosphere.beta == (0.1167e06, -0.2458e06, -0.6554e05, 0.1114e07)
    assert navigation.utc == UtcParameters(
        a0=0.279396772385e-08, a1=0.799360577730e-14, tot=147456.0, wnt=2191, leap_seconds=18
    )
    assert (navigation.source, navigation.remarks) == ("brdc", ())


def test_version_3_gives_the_same_and_leaves_out_other_systems():
    navigation = parse_nav(VERSION_3)
    (eph,) = navigation.ephemerides
    assert (eph.sat, eph.week, eph.toe, eph.toc) == ("G05", 2320, 122400.0, 122400.0)
    assert (eph.crs, eph.m0) == (-98.21875, 1.714815412488)
    assert (eph.omega_dot, eph.tgd) == (-8.275344701323e-09, -1.071020960808e-08)
    assert navigation.ionosphere.alpha == (1.8626e-08, 2.2352e-08, -1.1921e-07, -5.9605e-08)
    assert navigation.ionosphere.beta == (1.2902e05, 1.6384e05, -1.9661e05, -2.6214e05)
    assert navigation.utc == UtcParameters(
        a0=-9.3132257462e-10, a1=-7.993605777e-15, tot=319488.0, wnt=2320, leap_seconds=18
    )
    assert navigation.source == "navigation data"
    assert [re.findall(r"\w+: \d+|^\d+", remark) for remark in navigation.remarks] == [["2", "I: 1", "S: 1"]]


def test_version_4_takes_lnav_orbits_and_ionosphere_only():
    navigation = parse_nav(VERSION_4)
    assert repr(navigation.ephemerides) == repr(parse_nav(VERSION_3).ephemerides)
    alpha = (1.024454832077e-08, 2.235174179077e-08, -5.960464477539e-08, -1.192092895508e-07)
    assert navigation.ionosphere.alpha == alpha
    assert navigation.ionosphere.beta == (96256.0, 131072.0, -65536.0, -589824.0)
    assert navigation.utc.leap_seconds == 18
    (remark,) = navigation.remarks
    assert re.match(r"3 .*\(G EPH CNAV: 1, G STO LNAV: 1, I EPH LNAV: 1\)$", remark)


@pytest.mark.parametrize("spelling", ["-.774230040610D-04", "-7.74230040610e-05", "-7.74230040610d-05"])
def test_numbers_are_read_in_every_spelling(spelling):
    lines = change_line(VERSION_3, 9, "-1.774230040610E-04", f"{spelling:>19}")
    assert parse_nav(lines).ephemerides[0].af0 == -7.74230040610e-05


def test_a_three_digit_exponent_without_a_letter_is_zero():
    lines = change_line(VERSION_3, 9, "-1.364242052659E-12", " 0.499063314480-269")  # as in a file of the IGS
    assert parse_nav(lines).ephemerides[0].af1 == 0.0


def test_missing_trailing_and_blank_fields_have_their_defaults():
    lines = [*VERSION_3_HEADER, *GPS_RECORD[:6], "     2.000000000000E+00", ""]
    lines[14] = GPS_RECORD[5][:23]  # nothing after IDOT
    (eph,) = parse_nav(lines).ephemerides
    assert (eph.week, eph.code_on_l2, eph.l2_p_flag, eph.health, eph.tgd) == (2320, 0, 0, 0, 0.0)
    assert (eph.iodc, eph.fit_interval_h) == (72, 4.0)
    assert math.isnan(eph.transmission_tow)
    assert repr(parse_nav([*VERSION_3_HEADER, *GPS_RECORD[:6], GPS_RECORD[6]]).ephemerides[0]) == repr(
        replace(parse_nav(VERSION_3).ephemerides[0], transmission_tow=math.nan)
    )


@pytest.mark.parametrize(
    ("metres", "index"),
    [
        ("2.000", 0),
        ("2.400", 0),
        ("2.800", 1),
        ("3.400", 1),
        ("5.700", 3),
        ("16.00", 6),
        ("24.00", 6),
        ("4096.", 14),
        ("8192.", 15),
        ("0.000", 0),
    ],
)
def test_accuracy_in_metres_finds_its_index(metres, index):
    lines = change_line(VERSION_3, 15, "     2.000000000000E+00", f"    {metres:>19}")
    assert parse_nav(lines).ephemerides[0].ura_index == index


@pytest.mark.parametrize("fit", ["0.000000000000E+00", "                  "])
def test_an_unknown_fit_interval_is_four_hours(fit):
    lines = change_line(VERSION_3, 16, "4.000000000000E+00", fit)
    assert parse_nav(lines).ephemerides[0].fit_interval_h == 4.0


# ---------------------------------------------------------------- weeks


@pytest.mark.parametrize("written", ["2.720000000000E+02", "1.296000000000E+03"])
def test_the_date_resolves_the_week_whatever_the_writer_counted(written):
    navigation = parse_nav(change_line(VERSION_3, 14, "2.320000000000E+03", written))
    assert navigation.ephemerides[0].week == 2320
    assert any(re.search(r"\bGPS week\b.*\b1 records\b", remark) for remark in navigation.remarks)


def test_an_orbit_of_next_week_with_this_weeks_clock_is_mended():
    lines = change_line(VERSION_3, 9, "2024 06 24 10 00 00", "2024 06 22 23 59 44")
    lines = change_line(lines, 12, "1.224000000000E+05", "0.000000000000E+00")
    eph = parse_nav(lines).ephemerides[0]
    assert (eph.toc_week, eph.toc, eph.week, eph.toe) == (2319, 604784.0, 2320, 0.0)


def test_the_week_of_utc_is_resolved_whatever_the_writer_counted():
    # 1061 stands for 1317 in a file of 2005 (rinex-gsi-3km): modulo 256 both are 37.
    for written in ("2320", "  16", " 272"):
        lines = change_line(VERSION_3, 5, "319488 2320", f"319488 {written}")
        assert parse_nav(lines).utc.wnt == 2320


@pytest.mark.parametrize(("year", "full"), [("80", 1980), ("99", 1999), ("00", 2000), ("79", 2079)])
def test_years_of_two_digits_run_from_1980_to_2079(year, full):
    lines = change_line(VERSION_2[:15], 7, " 1 22  1  1", f" 1 {year}  1 12")
    lines = change_line(lines, 12, "0.219000000000D+04", " " * 18)
    _, tow_s = week_and_tow(parse_iso(f"{full}-01-12"))
    lines = change_line(lines, 10, "0.518400000000D+06", f"0.{round(tow_s):06d}000000D+06")
    eph = parse_nav(lines).ephemerides[0]
    assert gpst(eph.toc_week, eph.toc) == parse_iso(f"{full}-01-12")


@pytest.mark.parametrize("hours", [-24, -9, -1, 1, 24])
def test_a_clock_of_another_time_than_the_orbit_is_left_out(hours):
    # As where the dates of a file were edited and the times of ephemeris were not.
    text = GPS_RECORD[0]
    when = np.datetime64("2024-06-24T10:00:00") + np.timedelta64(hours, "h")
    edited = f"G05 {str(when)[:19].replace('-', ' ').replace('T', ' ').replace(':', ' ')}{text[23:]}"
    second = ["G06" + GPS_RECORD[0][3:], *GPS_RECORD[1:]]
    navigation = parse_nav([*VERSION_3_HEADER, edited, *GPS_RECORD[1:], *second])
    assert [eph.sat for eph in navigation.ephemerides] == ["G06"]
    (remark,) = navigation.remarks
    assert f"{hours:+.2f} h" in remark


@pytest.mark.parametrize(
    ("line", "old", "new"),
    [
        (2, "1.8626E-08", "1.8626E-05"),  # more than the message can hold
        (2, "2.2352E-08", "9.2352E-07"),  # so dense is no ionosphere
        (3, "1.2902E+05", "1.2902E+09"),
    ],
    ids=["alpha", "dense", "beta"],
)
def test_an_impossible_ionosphere_is_left_out(line, old, new):
    header = change_line(VERSION_3_HEADER, line, old, new)
    navigation = parse_nav([*header, *GPS_RECORD])
    assert navigation.ionosphere is None
    assert any("ionosphere" in remark for remark in navigation.remarks)


@pytest.mark.parametrize("leaps", [0, 15, 37, 180])
def test_impossible_leap_seconds_are_left_out(leaps):
    header = change_line(VERSION_3_HEADER, 6, "    18    18", f"{leaps:6d}{leaps:6d}")
    navigation = parse_nav([*header, *GPS_RECORD])
    assert navigation.utc.leap_seconds == 18
    assert any("leap seconds" in remark for remark in navigation.remarks)


# Records of KMS3, 8 June 2022.
GLONASS_RECORD = """\
R10 2022 06 08 09 45 00-8.311402052641E-05 9.094947017729E-13 2.934000000000E+05
     2.373835986328E+04-2.325544357300E-01 9.313225746155E-10 0.000000000000E+00
     9.180367187500E+03-2.452783584595E-01-9.313225746155E-10-7.000000000000E+00
    -2.194117675781E+03-3.543992996216E+00 9.313225746155E-10 0.000000000000E+00
     1.830000000000E+02 2.793967723846E-09 5.000000000000E+00 0.000000000000E+00
""".splitlines()
MIXED = [*VERSION_3, *GLONASS_RECORD]


def test_a_glonass_record_is_a_state_in_metres_at_gps_time():
    (eph,) = parse_nav([*VERSION_3_HEADER, *GLONASS_RECORD]).ephemerides
    assert (eph.sat, eph.week, eph.toe) == ("R10", 2213, 3 * 86400 + 9 * 3600 + 45 * 60 + 18.0)  # 18 leap seconds
    assert (eph.tau_n, eph.gamma_n) == (8.311402052641e-05, 9.094947017729e-13)  # the file has minus tau
    assert eph.position_m == pytest.approx((23738359.86328, 9180367.1875, -2194117.675781), abs=1e-6)
    assert eph.velocity_m_s == pytest.approx((-232.55443573, -245.2783584595, -3543.992996216), abs=1e-9)
    assert eph.acceleration_m_s2 == pytest.approx((9.313225746155e-07, -9.313225746155e-07, 9.313225746155e-07))
    assert (eph.frequency_number, eph.health, eph.delta_tau_n) == (-7, 0, 2.793967723846e-09)
    assert eph.message_tow == 293400.0
    assert get_glonass_channels(NavigationData(ephemerides=(eph,))) == {"R10": -7}


def test_version_2_counts_a_glonass_frame_from_midnight():
    header = [
        "     2.11           G: GLONASS NAV DATA                     RINEX VERSION / TYPE",
        "                                                            END OF HEADER",
    ]
    record = [
        GLONASS_RECORD[0].replace("R10 2022 06 08 09 45 00", "10 22  6  8  9 45  0.0"),
        *(line[1:] for line in GLONASS_RECORD[1:4]),
    ]
    record[0] = record[0].replace("2.934000000000E+05", "3.420000000000E+04")
    (eph,) = parse_nav([*header, *record]).ephemerides
    (as_version_3,) = parse_nav([*VERSION_3_HEADER, *GLONASS_RECORD[:4]]).ephemerides
    assert repr(eph) == repr(as_version_3)


def test_beidou_and_galileo_keep_their_own_fields():
    orbit = [*GPS_RECORD[1:3], *GPS_RECORD[3:5]]
    orbit[1] = orbit[1].replace("5.153635631561E+03", "5.282635631561E+03")
    fifth = "    -2.610823036973E-10 0.000000000000E+00 {:.12E} 0.000000000000E+00"
    beidou = [
        GPS_RECORD[0].replace("G05", "C30"),
        *orbit,
        fifth.format(2320 - 1356),
        "     2.000000000000E+00 0.000000000000E+00 8.499999815115E-09-1.200000000000E-09",
        "     1.224000000000E+05 3.000000000000E+00",
    ]
    orbit[1] = orbit[1].replace("5.282635631561E+03", "5.440635631561E+03")
    galileo = [
        GPS_RECORD[0].replace("G05", "E12"),
        *orbit,
        fifth.format(2320).replace(" 0.000000000000E+00", " 2.580000000000E+02", 1),
        "     3.120000000000E+00 0.000000000000E+00-1.000000000000E-09-2.000000000000E-09",
        "     1.224000000000E+05",
    ]
    c, e = parse_nav([*VERSION_3_HEADER, *beidou, *galileo]).ephemerides
    assert (c.sat, c.week, c.message, c.tgd, c.tgd2, c.iodc) == ("C30", 2320, "D1", 8.499999815115e-9, -1.2e-9, 3)
    assert seconds_between(c.reference_gpst, gpst(c.week, c.toe)) == 14.0
    assert (e.sat, e.week, e.message, e.tgd, e.tgd2) == ("E12", 2320, "FNAV", -1e-9, -2e-9)


# ---------------------------------------------------------------- damage


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda lines: change_line(lines, 9, "0.398838041777D-08", "0.39883x041777D-08"), "'0.39883x041777D-08'"),
        (lambda lines: change_line(lines, 9, "0.390000000000D+02", "*" * 18), "'******************'"),
        (lambda lines: drop_line(drop_line(lines, 10), 10), "6 of its 8 lines"),
        (lambda lines: change_line(lines, 8, "22  1  1  0", "22 13  1  0"), "'22 13 1 0 0 0.0'"),
        (lambda lines: change_line(lines, 8, " 1 22", "77 22"), "G77 left"),
        (lambda lines: change_line(lines, 10, "0.515367499542D+04", "0.515367499542D+01"), " its orbit"),
        (lambda lines: change_line(lines, 9, "-0.141125000000D+03", " " * 19), "is missing"),
        (lambda lines: change_line(lines, 8, " 1 22  1  1", " 1 21  1  1"), "GPS week 2138"),
    ],
    ids=["letter", "overflow", "lines gone", "month 13", "satellite 77", "orbit", "blank", "year"],
)
def test_a_damaged_record_costs_that_record_only(damage, words):
    navigation = parse_nav(damage(["", *VERSION_2])[1:])  # the numbers above are those of the lines
    assert [eph.sat for eph in navigation.ephemerides] == ["G02"]
    (remark,) = navigation.remarks
    assert remark.startswith("line 8: ")
    assert words in remark


@pytest.mark.parametrize("line", [-1, -2], ids=["last line", "line before, which may be the last"])
def test_a_file_cut_within_a_number_loses_that_record_only(line):
    # A group delay of 1.8E-0 in place of 1.8E-08 would be a clock that is off by seconds.
    whole = VERSION_2[: len(VERSION_2) + line + 1]
    for kept in range(4, 79):
        navigation = parse_nav([*whole[:-1], whole[-1][:kept]])
        between = len(whole[-1][:kept].rstrip()) in (0, 22, 41, 60, 79)
        assert [eph.sat for eph in navigation.ephemerides] == (["G01", "G02"] if between else ["G01"])
        assert between or re.match(r"line 16: G02 .*\bnumber\b", navigation.remarks[0])


def test_many_damaged_records_are_counted_not_listed():
    record = change_line(VERSION_2[7:15], 1, "0.390000000000D+02", "0.39x000000000D+02")
    navigation = parse_nav([*VERSION_2, *record * 30])
    assert len(navigation.ephemerides) == 2
    assert len(navigation.remarks) == 11
    assert navigation.remarks[-1].startswith("20 further ")


def test_a_damaged_header_line_is_reported_and_left_out():
    navigation = parse_nav(change_line(VERSION_2, 2, "0.1211D-07", "0.1211D-x7"))
    assert navigation.ionosphere is None
    assert [remark[:18] for remark in navigation.remarks] == ["line 3: ION ALPHA "]


def test_leap_seconds_come_from_the_date_without_their_field():
    assert parse_nav(drop_line(VERSION_2, 5)).utc.leap_seconds == 18
    nothing = parse_nav(drop_line(drop_line(VERSION_2, 4), 4))
    assert nothing.utc is None
    only = parse_nav(drop_line(VERSION_2, 4)).utc
    assert (only.a0, only.a1, only.leap_seconds, only.wnt) == (0.0, 0.0, 18, 2190)


@settings(max_examples=100, deadline=None)
@given(st.data())
def test_no_damage_ends_in_anything_but_data_or_a_message(data):
    text = bytearray("\n".join(data.draw(st.sampled_from([VERSION_2, VERSION_3, VERSION_4, MIXED]))), "latin-1")
    for _ in range(data.draw(st.integers(1, 6))):
        at = data.draw(st.integers(0, len(text) - 1))
        text[at : at + data.draw(st.integers(0, 90))] = data.draw(st.binary(max_size=4))
        if not text:
            break
    try:
        navigation = parse_nav(text.decode("latin-1").splitlines(), source="x")
    except InputError:
        return
    assert navigation.ephemerides


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ([], "line 1: ''"),
        (["hello world"], "line 1: 'hello world'"),
        (["     3.04           OBSERVATION DATA    M: MIXED            RINEX VERSION / TYPE"], "holds observations"),
        (["     2.11           H: SBAS NAV DATA                        RINEX VERSION / TYPE"], "SBAS navigation"),
        (["     3.04           G: GLONASS NAV DATA                     RINEX VERSION / TYPE"], "GLONASS navigation"),
        (["     5.00           N: GNSS NAV DATA    M: MIXED            RINEX VERSION / TYPE"], "RINEX version '5.00'"),
        (["     x              N: GNSS NAV DATA    M: MIXED            RINEX VERSION / TYPE"], "RINEX version 'x'"),
        (["1.0                 COMPACT RINEX FORMAT                    CRINEX VERS   / TYPE"], "compressed RINEX obs"),
        (VERSION_3_HEADER[:-1], "line 8: .*END OF HEADER"),
        (VERSION_3_HEADER, "line 9;"),
        ([*VERSION_3_HEADER, *OTHER_RECORDS], r"\b2 records\b"),
        ([*VERSION_3_HEADER, *GPS_RECORD[:3]], r"line 10: G05.*\b3 of its 8 lines\b"),
    ],
)
def test_a_wrong_navigation_file_is_reported_with_place(lines, words):
    with pytest.raises(InputError) as caught:
        parse_nav(lines, source="some.file")
    assert str(caught.value).startswith("some.file")
    assert re.search(words, str(caught.value))
    assert re.search(r"; (give|fetch) ", str(caught.value))


def test_files_that_cannot_be_read_are_reported(tmp_path):
    for name, content in (("cut.gz", gzip.compress("\n".join(VERSION_2).encode())[:-20]), ("junk.gz", b"\x1f\x8bjunk")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=rf"{re.escape(name)}: .*gzip"):
            read_nav(tmp_path / name)
    (tmp_path / "old.Z").write_bytes(b"\x1f\x9d\x90abc")
    with pytest.raises(InputError, match="uncompress"):
        read_nav(tmp_path / "old.Z")
    with pytest.raises(InputError, match=r"absent: .*exist"):
        read_nav(tmp_path / "absent")
    with pytest.raises(InputError, match=r"\bdirectory\b"):
        read_nav(tmp_path)


def test_line_ends_of_any_system_and_gzip_read_the_same(tmp_path):
    expected = repr(parse_nav(VERSION_3).ephemerides)
    for name, content in (("unix", "\n".join(VERSION_3)), ("dos", "\r\n".join(VERSION_3) + "\r\n")):
        (tmp_path / name).write_bytes(content.encode())
        (tmp_path / f"{name}.gz").write_bytes(gzip.compress(content.encode()))
        assert repr(read_nav(tmp_path / name).ephemerides) == expected
        assert repr(read_nav(str(tmp_path / f"{name}.gz")).ephemerides) == expected


# ---------------------------------------------------------------- writing


def is_same(first, second):
    """Compare with NaN equal to NaN."""
    return repr(first) == repr(second)


@pytest.mark.parametrize("lines", [VERSION_2, VERSION_3, VERSION_4], ids=["2", "3", "4"])
def test_what_is_written_reads_back_the_same(tmp_path, lines):
    navigation = parse_nav(lines)
    write_nav(tmp_path / "nav.rnx", navigation, created=parse_iso("2026-01-02T03:04:05"))
    back = read_nav(tmp_path / "nav.rnx")
    assert is_same(back.ephemerides, navigation.ephemerides)
    np.testing.assert_allclose(back.ionosphere.alpha, navigation.ionosphere.alpha, rtol=5e-5)  # five digits
    np.testing.assert_allclose(back.ionosphere.beta, navigation.ionosphere.beta, rtol=5e-5)
    assert back.utc.a0 == pytest.approx(navigation.utc.a0, rel=1e-10)
    assert back.utc.a1 == pytest.approx(navigation.utc.a1, rel=1e-9)
    assert replace(back.utc, a0=0.0, a1=0.0) == replace(navigation.utc, a0=0.0, a1=0.0)
    assert back.remarks == ()
    write_nav(tmp_path / "again.rnx", back, created=parse_iso("2026-01-02T03:04:05"))
    assert (tmp_path / "again.rnx").read_bytes() == (tmp_path / "nav.rnx").read_bytes()


def test_a_written_file_has_the_columns_of_the_format(tmp_path):
    navigation = make_nominal_constellation(parse_iso("2022-01-01T21:46:00"))
    write_nav(tmp_path / "nav.rnx", navigation)
    lines = (tmp_path / "nav.rnx").read_text(encoding="ascii").splitlines()
    assert lines[0] == "     3.05           N: GNSS NAV DATA    G: GPS              RINEX VERSION / TYPE"
    assert all(len(line) <= 80 for line in lines)
    end = next(k for k, line in enumerate(lines) if line[60:].strip() == "END OF HEADER")
    assert {line[60:].strip() for line in lines[:end]} == {
        "RINEX VERSION / TYPE",
        "PGM / RUN BY / DATE",
        "IONOSPHERIC CORR",
        "TIME SYSTEM CORR",
        "LEAP SECONDS",
    }
    assert len(lines) == end + 1 + 8 * len(navigation.ephemerides)
    assert lines[end + 1].startswith("G01 2022 01 01 22 00 00")
    assert re.fullmatch(r"G01 2022 01 01 22 00 00([- ]\d\.\d{12}E[-+]\d\d){3}", lines[end + 1])
    assert all(re.fullmatch(r"    ([- ]\d\.\d{12}E[-+]\d\d){4}", line) for line in lines[end + 2 : end + 8])
    back = read_nav(tmp_path / "nav.rnx")
    for written, read in zip(navigation.ephemerides, back.ephemerides, strict=True):
        assert read.sat == written.sat
        for name, value in asdict(replace(written, sat=0)).items():
            if not isinstance(value, str):
                assert getattr(replace(read, sat=0), name) == pytest.approx(value, rel=5e-13, nan_ok=True), name
    assert back.utc == navigation.utc


def test_every_accuracy_index_and_week_survives(tmp_path):
    base = parse_nav(VERSION_3).ephemerides[0]
    variants = [replace(base, ura_index=index) for index in range(16)]
    variants.append(replace(base, week=2321, toe=0.0, toc=604784.0))
    variants.append(replace(base, fit_interval_h=26.0, iodc=500, iode=244))
    write_nav(tmp_path / "nav.rnx", NavigationData(ephemerides=tuple(variants)))
    back = read_nav(tmp_path / "nav.rnx")
    assert is_same(back.ephemerides, tuple(variants))
    assert (back.ionosphere, back.utc) == (None, None)


def test_a_place_that_cannot_be_written_is_reported(tmp_path):
    with pytest.raises(OutputError, match=r"nav\.rnx"):
        write_nav(tmp_path / "absent" / "nav.rnx", parse_nav(VERSION_3))


# ---------------------------------------------------------------- real files

# Records of each system in each file, counted with grep: lines that begin with a PRN (version 2), a letter (3) or
# "> EPH" and a message that is read (4).
REAL = {
    "rf/brdc0010.22n": "G422",
    "real/brdc/brdc3050.12n": "G423",
    "real/phone-orientation/hour3460.19n": "G306",
    "real/rinex-gsi-3km/07590920.05n": "G162",
    "real/rinex-gsi-3km/30400920.05n": "G164",
    "real/rinex-mosaic-1m/base.nav": "C32 E67 G13 J3 R19",
    "real/rinex-mosaic-5km/SEPT2650.21P": "E253 G49 J19",
    "real/rinex-variety/KMS300DNK_R_20221591000_01H_MN.rnx.gz": "C36 E108 G30 J1 R24",
    "real/rinex-variety/cbw10010.21n.gz": "G187",
    "real/rinex-variety/AMEL00NLD_R_20210010000_01D_MN.rnx": "C2 E2 R2",
    "real/rinex-variety/BRDC00GOP_R_20210010000_01D_MN.rnx.gz": "C1 E1 R1",
    "real/rinex-variety/NYA100NOR_S_20241240000_01D_CN.rnx.gz": "C194",
    "real/rinex-variety/amel0010.21g": "R6",
    "real/spoofed-real/brdc2580.12n": "G414",
}
LEFT_OUT = {
    "real/rinex-variety/BRDC00GOP_R_20210010000_01D_MN.rnx.gz": "S: 1",
    "real/rinex-variety/KMS300DNK_R_20221591000_01H_MN.rnx.gz": "S EPH SBAS: 158",
}


@pytest.mark.shared_data
@pytest.mark.parametrize("name", REAL)
def test_every_record_of_a_real_file_is_read_and_written(shared_data, tmp_path, name):
    navigation = read_nav(shared_data / name)
    counts = Counter(eph.sat[0] for eph in navigation.ephemerides)
    assert " ".join(f"{system}{counts[system]}" for system in sorted(counts)) == REAL[name]
    assert not [remark for remark in navigation.remarks if "left out, " in remark]
    assert any(LEFT_OUT.get(name, "") in remark for remark in (*navigation.remarks, ""))
    for eph in navigation.ephemerides:
        if isinstance(eph, Ephemeris):
            assert abs(seconds_between(gpst(eph.week, eph.toe), gpst(eph.toc_week, eph.toc))) < 7200.0
    write_nav(tmp_path / "nav.rnx", navigation)
    assert is_same(read_nav(tmp_path / "nav.rnx").ephemerides, navigation.ephemerides)


@pytest.mark.shared_data
def test_no_other_real_file_passes_for_a_navigation_file(shared_data):
    known = {*REAL}
    files = [path for path in sorted((shared_data / "real").rglob("*")) if path.is_file() and path.stat().st_size < 3e6]
    rest = [path for path in files if str(path.relative_to(shared_data)) not in known]
    assert len(rest) > 30
    for path in rest:
        with pytest.raises(InputError, match=re.escape(str(path))):
            read_nav(path)


@pytest.mark.shared_data
def test_two_writers_of_one_day_agree(shared_data):
    # Two stations' receivers wrote what the same satellites sent.
    folder: Path = shared_data / "real" / "rinex-gsi-3km"
    first, second = (
        {(e.sat, e.week, e.toe, e.iode): e for e in read_nav(folder / name).ephemerides}
        for name in ("07590920.05n", "30400920.05n")
    )
    common = first.keys() & second.keys()
    assert len(common) > 150
    for key in common:
        assert replace(first[key], transmission_tow=0.0) == replace(second[key], transmission_tow=0.0)
