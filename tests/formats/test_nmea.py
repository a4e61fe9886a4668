"""NMEA 0183 sentences, checked by a reader of their own."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyproof.formats.nmea import write_nmea, write_nmea_sentences
from skyproof.gnss.time import gpst_from_utc

FIELDS = {"GGA": 14, "RMC": 12, "GST": 8, "TXT": 4}  # NMEA 0183 (RMC with the mode of 2.3)
ANGLE = re.compile(r"(\d{2,3})(\d\d\.\d+)")


def split_fields(sentence, talker="GP"):
    """Check a sentence as any reader does, and return its type and fields."""
    assert sentence.isascii()
    assert len(sentence) + 2 <= 82
    match = re.fullmatch(r"\$([^*$]+)\*([0-9A-F]{2})", sentence)
    checksum = 0
    for letter in match[1]:
        checksum ^= ord(letter)
    assert checksum == int(match[2], 16)
    kind, *fields = match[1].split(",")
    assert kind[:2] == talker
    assert len(fields) == FIELDS[kind[2:]]
    return kind[2:], fields


def parse_angle(text, side):
    degrees, minutes = ANGLE.fullmatch(text).groups()
    assert float(minutes) < 60.0
    return (int(degrees) + float(minutes) / 60.0) * (-1 if side in "SW" else 1)


def make_epoch(utc="2022-01-01T21:45:58", lat_deg=59.41, lon_deg=16.88, height_m=52.3142, satellites=9, **more):
    gpst = np.array([gpst_from_utc(np.datetime64(utc))])
    sentences = list(write_nmea_sentences(gpst, [lat_deg], [lon_deg], [height_m], [satellites], **more))
    found = [split_fields(sentence, more.get("talker", "GP")) for sentence in sentences]
    return [kind for kind, _ in found], dict(found)


def test_the_sentences_of_an_epoch_come_in_order():
    assert make_epoch()[0] == ["GGA", "RMC", "TXT"]
    sigmas = {"sigma_east_m": 1.0, "sigma_north_m": 2.0, "sigma_up_m": 3.0}
    assert make_epoch(**sigmas)[0] == ["GGA", "RMC", "GST", "TXT"]
    assert make_epoch(**sigmas, geoid_separation_m=25.0)[0] == ["GGA", "RMC", "GST"]


@given(st.floats(-90, 90), st.floats(-180, 180))
def test_places_read_back_to_two_millimetres(lat_deg, lon_deg):
    _, found = make_epoch(lat_deg=lat_deg, lon_deg=lon_deg)
    for fields in (found["GGA"][1:5], found["RMC"][2:6]):
        assert parse_angle(*fields[:2]) == pytest.approx(lat_deg, abs=1e-8)
        assert parse_angle(*fields[2:]) == pytest.approx(lon_deg, abs=1e-8)


def test_minutes_never_read_sixty():
    _, found = make_epoch(lat_deg=58.9999999999, lon_deg=-9.9999999999)
    assert found["GGA"][1:5] == ["5900.000000", "N", "01000.000000", "W"]


def test_time_is_utc_and_rounded_as_a_whole():
    _, found = make_epoch(utc="2021-12-31T23:59:59.996")
    assert found["GGA"][0] == found["RMC"][0] == "000000.00"
    assert found["RMC"][8] == "010122"
    gpst = np.array(["2022-01-01T21:45:58"], "datetime64[ns]")
    first = next(write_nmea_sentences(gpst, [1.0], [2.0], [3.0], [4]))
    assert split_fields(first)[1][0] == "214540.00"


def test_without_a_geoid_the_ellipsoidal_height_is_reported():
    _, found = make_epoch(hdop=0.87)
    assert found["GGA"][5:] == ["1", "09", "0.9", "", "M", "", "M", "", ""]
    assert found["TXT"] == ["01", "01", "02", "HAE=52.314"]


def test_with_a_geoid_altitude_counts_from_it():
    _, found = make_epoch(geoid_separation_m=25.1)
    assert found["GGA"][5:] == ["1", "09", "", "27.21", "M", "25.1", "M", "", ""]


def test_speed_course_and_sigmas_are_reported():
    _, found = make_epoch(speed_m_s=10.0, course_deg=-90.0, sigma_east_m=1.25, sigma_north_m=2.5, sigma_up_m=4.0)
    assert found["RMC"][6:8] == ["19.438", "270.00"]
    assert found["GST"][1:] == ["", "", "", "", "2.500", "1.250", "4.000"]  # latitude, longitude, altitude


def test_an_epoch_without_a_position_says_so():
    kinds, found = make_epoch(lat_deg=np.nan, lon_deg=np.nan, height_m=np.nan, satellites=3)
    assert kinds == ["GGA", "RMC"]
    assert found["GGA"][1:7] == ["", "", "", "", "0", "00"]
    assert found["RMC"][1:6] == ["V", "", "", "", ""]
    assert found["RMC"][11] == "N"


def test_the_longest_sentence_keeps_to_82_characters():
    kinds, _ = make_epoch(
        lat_deg=-89.1,
        lon_deg=-179.1,
        height_m=12345.678,
        satellites=24,
        hdop=1e6,
        geoid_separation_m=-104.123,
        speed_m_s=9999.0,
        course_deg=359.99,
        sigma_east_m=9999.9,
        sigma_north_m=9999.9,
        sigma_up_m=9999.9,
    )
    assert kinds == ["GGA", "RMC", "GST"]


def test_another_talker_is_reported():
    make_epoch(talker="GN")


def test_lines_end_as_a_serial_line_does(tmp_path):
    gpst = np.datetime64("2022-01-01T21:45:58", "ns") + np.arange(4) * np.timedelta64(1, "s")
    gpst[2] = "NaT"
    path = tmp_path / "trusted.nmea"
    write_nmea(path, write_nmea_sentences(gpst, np.full(4, 59.0), np.full(4, 16.0), np.full(4, 50.0), np.full(4, 9)))
    octets = path.read_bytes()
    assert octets.endswith(b"\r\n")
    lines = octets.decode("ascii").split("\r\n")[:-1]
    assert [split_fields(line)[0] for line in lines] == ["GGA", "RMC", "TXT"] * 3
