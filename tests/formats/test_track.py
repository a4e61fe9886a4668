"""Files of points: what is written comes back, and what is damaged is reported or refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.written import write_table

from skyproof.errors import InputError
from skyproof.formats.kml import write_kml
from skyproof.formats.nmea import write_nmea, write_nmea_sentences
from skyproof.formats.track import parse_csv, parse_kml, parse_nmea, read_track
from skyproof.gnss.frames import ecef_from_geodetic

START = np.datetime64("2022-01-01T21:45:58.5", "ns")


def make_points(n=20, lat_deg=59.41, lon_deg=-16.88, height_m=52.125, start=START):
    gpst = start + np.arange(n) * np.timedelta64(500, "ms")
    k = np.arange(n)
    return gpst, lat_deg + 1e-5 * k, lon_deg + 2e-5 * k, height_m + 0.25 * k


def convert_ecef(lat_deg, lon_deg, height_m):
    return ecef_from_geodetic(np.radians(lat_deg), np.radians(lon_deg), height_m)


def measure_apart_m(track, places):
    return np.linalg.norm(track.position_ecef_m - convert_ecef(*places), axis=1).max()


def make_line(body):
    checksum = 0
    for letter in body.encode():
        checksum ^= letter
    return f"${body}*{checksum:02X}"


GGA = "GPGGA,214540.50,5924.600000,N,01652.800000,W,1,09,0.9,10.50,M,60.2,M,,"


# --- there and back


@pytest.mark.parametrize("place", [(59.41, -16.88), (-33.9, 151.2), (0.0, 179.9999)])
def test_nmea_comes_back_to_its_digits(tmp_path, place):
    gpst, *places = make_points(20, *place)
    write_nmea(tmp_path / "a.nmea", write_nmea_sentences(gpst, *places, 9, speed_m_s=1.0, course_deg=90.0))
    track = read_track(tmp_path / "a.nmea")
    assert measure_apart_m(track, places) < 3e-3
    np.testing.assert_array_equal(track.t_s, 0.5 * np.arange(20))
    assert track.start_gpst == START
    assert track.attitude_rad is None
    assert track.remarks == ()


def test_nmea_heights_are_altitude_and_separation():
    gpst, *places = make_points()
    track = parse_nmea(write_nmea_sentences(gpst, *places, 9, geoid_separation_m=60.2))
    assert measure_apart_m(track, places) < 6e-3


def test_nmea_goes_on_over_midnight():
    later, *places = make_points(start=np.datetime64("2022-05-04T00:00:13", "ns"))
    track = parse_nmea(write_nmea_sentences(later, *places, 9))
    assert track.start_gpst == later[0]
    assert track.t_s[-1] == 9.5


def test_a_leap_second_takes_a_second():
    times = ("235959.50", "235960.00", "235960.50", "000000.00")
    dates = ("311216",) * 3 + ("010117",)
    track = parse_nmea(
        make_line(f"GPRMC,{time},A,5924.6,N,01652.8,W,1.0,90.0,{date},,,A")
        for time, date in zip(times, dates, strict=True)
    )
    np.testing.assert_array_equal(track.t_s, [0.0, 0.5, 1.0, 1.5])
    assert track.start_gpst == np.datetime64("2017-01-01T00:00:16.5", "ns")


def test_kml_comes_back_to_its_digits(tmp_path):
    gpst, *places = make_points()
    write_kml(tmp_path / "a.kml", {"rx1 trusted": (gpst, *places)})
    track = read_track(tmp_path / "a.kml")
    assert measure_apart_m(track, places) < 1e-3
    np.testing.assert_array_equal(track.t_s, 0.5 * np.arange(20))
    assert track.start_gpst == START
    assert track.remarks == ()


def test_one_of_several_kml_tracks_is_taken_by_its_name(tmp_path):
    gpst, *places = make_points()
    other = [places[0] + 1.0, *places[1:]]
    write_kml(tmp_path / "a.kml", {"trusted": (gpst, *places), "false": (gpst, *other)})
    assert measure_apart_m(read_track(tmp_path / "a.kml", name="false"), other) < 1e-3
    with pytest.raises(InputError, match=r'\b2 tracks \("trusted", "false"\)'):
        read_track(tmp_path / "a.kml")
    with pytest.raises(InputError, match=r'"x".*"trusted", "false"'):
        read_track(tmp_path / "a.kml", name="x")


def test_a_table_comes_back_exactly(tmp_path):
    gpst, *places = make_points()
    angles = np.stack([np.linspace(0.0, 350.0, 20), np.linspace(-5.0, 5.0, 20), np.zeros(20)])
    named = dict(zip(("lat_deg", "lon_deg", "height_m"), places, strict=True))
    named |= dict(zip(("heading_deg", "pitch_deg", "roll_deg"), angles, strict=True))
    write_table(tmp_path / "a.csv", {"receiver": np.full(20, "rx"), "gpst": gpst, **named})
    track = read_track(tmp_path / "a.csv")
    np.testing.assert_array_equal(track.position_ecef_m, convert_ecef(*places))
    np.testing.assert_array_equal(track.attitude_rad, np.radians(angles.T))
    np.testing.assert_array_equal(track.t_s, 0.5 * np.arange(20))
    assert track.start_gpst == START


def test_a_table_in_seconds_and_ecef_has_no_date(tmp_path):
    places = convert_ecef(*make_points()[1:])
    named = dict(zip(("x_ecef_m", "y_ecef_m", "z_ecef_m"), places.T, strict=True))
    write_table(tmp_path / "a.csv", {"t_s": 3.0 + 0.1 * np.arange(20), **named})
    track = read_track(tmp_path / "a.csv")
    np.testing.assert_array_equal(track.position_ecef_m, places)
    np.testing.assert_allclose(track.t_s, 0.1 * np.arange(20), atol=1e-12)
    assert track.start_gpst is None


@given(st.floats(-89.9, 89.9), st.floats(-180.0, 180.0), st.floats(-400.0, 20_000.0))
def test_any_place_comes_back_through_nmea(lat_deg, lon_deg, height_m):
    places = [np.array([value]) for value in (lat_deg, lon_deg, height_m)]
    track = parse_nmea(write_nmea_sentences(np.array([START]), *places, 9))
    assert measure_apart_m(track, places) < 3e-3


# --- CSV


def test_rows_without_a_place_are_left_out_and_reported():
    track = parse_csv("t_s,lat_deg,lon_deg,height_m\n0,40,3,1\n1,,,\n\n2,40,3,2\n")
    np.testing.assert_array_equal(track.t_s, [0.0, 2.0])
    assert [remark[:7] for remark in track.remarks] == ["1 rows "]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", r"line 1: .*\bt_s or gpst, .*\blat_deg, lon_deg, height_m\b"),
        ("t_s,lat,lon\n0,1,2\n", r"line 1: .*\bt_s, lat, lon\b"),
        ("t_s,lat_deg,lon_deg,height_m\n", "no row"),
        ("t_s,lat_deg,lon_deg,height_m\n0,40,3\n", r"line 2: 3 .* 4\b"),
        ("t_s,lat_deg,lon_deg,height_m\n0,40,3,x\n", 'line 2, height_m: "x"'),
        ("t_s,lat_deg,lon_deg,height_m\n0,40,3,nan\n", 'line 2, height_m: "nan"'),
        (
            "t_s,lat_deg,lon_deg,height_m\n0,400,3,1\n",
            r"line 2: .*\b400, .*\b3, .*\b1 m\b",
        ),
        ("t_s,lat_deg,lon_deg,height_m\n0,40,3,1\n0,40,3,1\n", r"line 3: .*\bline 2\b"),
        ("gpst,lat_deg,lon_deg,height_m\n2022-01-01T00:00:00Z,40,3,1\n", r"line 2, gpst: .*\binstant\b"),
        ("t_s,lat_deg,lon_deg,height_m,heading_deg\n0,40,3,1,9\n", "line 1: pitch_deg, roll_deg "),
        ("t_s,lat_deg,lon_deg,height_m,heading_deg,pitch_deg,roll_deg\n0,40,3,1,9,,0\n", 'line 2, pitch_deg: "" is'),
    ],
)
def test_a_table_that_holds_no_track_is_refused(text, words):
    with pytest.raises(InputError, match=f"^a.csv: {words}"):
        parse_csv(text, source="a.csv")


# --- NMEA


def test_damaged_sentences_and_epochs_without_fix_are_reported():
    gpst, *places = make_points()
    places[0][7] = np.nan
    lines = list(write_nmea_sentences(gpst, *places, 9, geoid_separation_m=60.2))
    lines[0] = lines[0].replace("59", "58")  # GGA of the first epoch; its RMC still has the place
    track = parse_nmea(["noise", *lines, "$GPGSV,1,1,00", make_line("GPGGA,21454")])
    assert track.t_s.size == 19
    assert [remark[:9] for remark in track.remarks] == ["2 damaged", "1 epochs ", "1 points "]


def test_nmea_without_date_or_separation_is_reported():
    bare = GGA.replace("60.2", "")
    track = parse_nmea([make_line(bare), make_line(bare.replace("214540.50", "214542.25"))])
    assert track.start_gpst is None
    np.testing.assert_array_equal(track.t_s, [0.0, 1.75])
    assert "geoid" in track.remarks[0]
    reported = parse_nmea([make_line(bare)], geoid_separation_m=60.2)
    assert reported.remarks == ()
    assert measure_apart_m(reported, [np.array([v]) for v in (59.41, -16.88, 70.7)]) < 1e-6


def test_rmc_alone_puts_the_points_on_the_ellipsoid_and_says_so():
    track = parse_nmea([make_line("GNRMC,214540.50,A,5924.6,N,01652.8,W,1.0,90.0,010122,,,A")])
    assert measure_apart_m(track, [np.array([v]) for v in (59.41, -16.88, 0.0)]) < 1e-6
    assert track.start_gpst == START
    assert [("height" in remark, "ellipsoid" in remark) for remark in track.remarks] == [(True, True)]


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ([], r".*\bGGA or RMC\b.*\(0 damaged\)"),
        (["hello", "$GPGGA,x*00"], r".*\bGGA or RMC\b.*\(1 damaged\)"),
        ([make_line(GGA.replace(",1,09", ",0,09"))], r".*\bGGA or RMC\b"),
        ([make_line(GGA), make_line(GGA.replace("214540", "214530"))], r"line 2: .*\bline 1\b"),
    ],
)
def test_nmea_that_holds_no_track_is_refused(lines, words):
    with pytest.raises(InputError, match=f"^a.nmea: {words}"):
        parse_nmea(lines, source="a.nmea")


# --- KML


def make_kml(inside, mode=""):
    return (
        f'<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2"><Document>'
        f"<Placemark><name>way</name>{inside.replace('MODE', mode)}</Placemark></Document></kml>"
    )


def make_gx(*moments, more=""):
    whens = "".join(f"<when>{when}</when>" for when, _ in moments)
    return f"<gx:Track>MODE{whens}{''.join(f'<gx:coord>{coord}</gx:coord>' for _, coord in moments)}{more}</gx:Track>"


TWO = (("2022-01-01T21:45:40.5Z", "3 40 10"), ("2022-01-01T22:45:42.5+01:00", "3 40.1 11"))


def test_a_line_has_points_without_times():
    track = parse_kml(make_kml("<LineString><coordinates> 3,40,10\n3.1,40.2 3.2,40.3,5 </coordinates></LineString>"))
    assert track.t_s is None
    assert track.start_gpst is None
    assert measure_apart_m(track, np.array([[40, 3, 10], [40.2, 3.1, 0], [40.3, 3.2, 5]]).T) < 1e-6


def test_a_track_has_times_of_any_zone_and_angles_if_given():
    track = parse_kml(make_kml(make_gx(*TWO, more="<gx:angles>90 5 -3</gx:angles><gx:angles>91 5 -3</gx:angles>")))
    assert track.start_gpst == START
    np.testing.assert_array_equal(track.t_s, [0.0, 2.0])
    np.testing.assert_allclose(np.degrees(track.attitude_rad), [[90, 5, -3], [91, 5, -3]])
    assert measure_apart_m(track, np.array([[40, 3, 10], [40.1, 3, 11]]).T) < 1e-6


def test_a_multitrack_is_one_track_and_its_line_no_other():
    two = f"<gx:MultiTrack>{make_gx(TWO[0])}{make_gx(TWO[1])}</gx:MultiTrack>"
    assert parse_kml(make_kml(two)).t_s.size == 2
    assert (
        parse_kml(make_kml(two + "<LineString><coordinates>3,40,10 3,41,10</coordinates></LineString>")).t_s.size == 2
    )


def test_moments_without_a_place_are_left_out():
    track = parse_kml(make_kml(make_gx(TWO[0], ("2022-01-01T21:45:41Z", ""), TWO[1])))
    np.testing.assert_array_equal(track.t_s, [0.0, 2.0])
    assert [remark[:9] for remark in track.remarks] == ["1 points "]


def test_absolute_heights_count_from_the_geoid():
    text = make_kml(make_gx(*TWO), "<altitudeMode>absolute</altitudeMode>")
    reported = parse_kml(text, geoid_separation_m=50.0)
    assert measure_apart_m(reported, np.array([[40, 3, 60], [40.1, 3, 61]]).T) < 1e-6
    assert "geoid" in parse_kml(text).remarks[0]
    ground = parse_kml(text.replace("absolute", "relativeToGround"))
    assert "ground" in ground.remarks[0]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("PK\x03\x04", r"not KML: .*\.kml"),
        (make_kml(""), r".*\bgx:Track or LineString\b"),
        (make_kml(make_gx()), r".*\bno points"),
        (make_kml(make_gx(*TWO, more="<when>2022-01-01T21:45:43Z</when>")), r"3 times .*\b2 points"),
        (make_kml(make_gx(*TWO, more="<gx:angles>1 2 3</gx:angles>")), "1 gx:angles but 2 points"),
        (make_kml(make_gx(*TWO, more="<gx:angles>1 2</gx:angles>" * 2)), r"gx:angles .*\b3\b"),
        (make_kml(make_gx(("soon", "3 40 10"))), 'point 1: "soon"'),
        (make_kml(make_gx(("2022-01-01T21:45:40Z", "3 x 10"))), 'point 1, coordinates: "x"'),
        (
            make_kml(make_gx(("2022-01-01T21:45:40Z", "3 95 10"))),
            r"point 1: .*\b95, .*\b3, .*\b10 m\b",
        ),
        (make_kml(make_gx(*TWO[::-1])), r"point 2: .*\bpoint 1\b"),
    ],
)
def test_kml_that_holds_no_track_is_refused(text, words):
    with pytest.raises(InputError, match=f"^a.kml: {words}"):
        parse_kml(text, source="a.kml")


# --- files


def test_a_file_that_cannot_be_read_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"a\.csv: .*exist"):
        read_track(tmp_path / "a.csv")
    with pytest.raises(InputError, match=r"\.kmz.*\.csv, \.nmea or \.kml"):
        read_track(tmp_path / "a.kmz")
