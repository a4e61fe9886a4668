"""Orbits that RTCM 3 relays, against pyrtcm field by field, on real streams and on messages made here."""

import io

import numpy as np
import pytest
from pyrtcm import RTCMReader
from tests.logs.frames import make_rtcm3_frame
from tests.logs.test_orbits import encode_value

from skyproof.gnss.constants import GPS_PI
from skyproof.gnss.ephemeris import Ephemeris
from skyproof.gnss.messages.rtcm import _FIELDS, read_relayed_orbit
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.orbits import compute_satellite_state

NAMES = {
    1019: {"crs": 86, "delta_n": 87, "m0": 88, "cuc": 89, "e": 90, "cus": 91, "sqrt_a": 92, "toe": 93, "cic": 94}
    | {"omega0": 95, "cis": 96, "i0": 97, "crc": 98, "omega": 99, "omega_dot": 100, "tgd": 101, "health": 102}
    | {"idot": 79, "iode": 71, "toc": 81, "af2": 82, "af1": 83, "af0": 84, "iodc": 85, "week": 76},
    1042: {"idot": 491, "iode": 492, "toc": 493, "af2": 494, "af1": 495, "af0": 496, "iodc": 497, "crs": 498}
    | {"delta_n": 499, "m0": 500, "cuc": 501, "e": 502, "cus": 503, "sqrt_a": 504, "toe": 505, "cic": 506}
    | {"omega0": 507, "cis": 508, "i0": 509, "crc": 510, "omega": 511, "omega_dot": 512, "health": 515, "week": 489},
    1044: {"toc": 430, "af2": 431, "af1": 432, "af0": 433, "iode": 434, "crs": 435, "delta_n": 436, "m0": 437}
    | {"cuc": 438, "e": 439, "cus": 440, "sqrt_a": 441, "toe": 442, "cic": 443, "omega0": 444, "cis": 445, "i0": 446}
    | {"crc": 447, "omega": 448, "omega_dot": 449, "idot": 450, "week": 452, "health": 454, "tgd": 455, "iodc": 456},
    1045: {"week": 289, "iode": 290, "idot": 292, "toc": 293, "af2": 294, "af1": 295, "af0": 296, "crs": 297}
    | {"delta_n": 298, "m0": 299, "cuc": 300, "e": 301, "cus": 302, "sqrt_a": 303, "toe": 304, "cic": 305}
    | {"omega0": 306, "cis": 307, "i0": 308, "crc": 309, "omega": 310, "omega_dot": 311, "tgd": 312, "e5a_health": 314},
    1046: {"week": 289, "iode": 290, "idot": 292, "toc": 293, "af2": 294, "af1": 295, "af0": 296, "crs": 297}
    | {"m0": 299, "sqrt_a": 303, "toe": 304, "omega_dot": 311, "tgd": 312, "tgd2": 313, "e5b_health": 316}
    | {"e5b_invalid": 317, "e1_health": 287, "e1_invalid": 288},
    1020: {"x_velocity_m_s": 111, "x_position_m": 112, "x_acceleration_m_s2": 113, "y_velocity_m_s": 114}
    | {"y_position_m": 115, "z_position_m": 118, "z_acceleration_m_s2": 119, "gamma_n": 121, "tau_n": 124}
    | {"delta_tau_n": 125, "age_days": 126, "reference_steps": 110, "ill": 123, "ill_b": 108, "slot": 38},
}
"""Data field of pyrtcm by our name."""
ANGLES = {"delta_n", "m0", "omega0", "i0", "omega", "omega_dot", "idot"}
PLAIN = {"gamma_n": 2.0**-40, "tau_n": 2.0**-30, "delta_tau_n": 2.0**-30}
"""Which pyrtcm gives as whole numbers."""
KILOMETRES = {f"{axis}_{name}" for axis in "xyz" for name in ("velocity_m_s", "position_m", "acceleration_m_s2")}


def assert_same(message, content: bytes) -> None:
    """Compare every named field of a message with pyrtcm's."""
    number = int(message.identity)
    orbit = read_relayed_orbit(content, 2300)
    for name, field in NAMES[number].items():
        theirs = float(getattr(message, f"DF{field:03d}"))
        scale = GPS_PI if name in ANGLES else 1e3 if name in KILOMETRES else PLAIN.get(name, 1.0)
        assert orbit.values[name] == pytest.approx(theirs * scale, rel=1e-9, abs=1e-18), (number, name)


@pytest.mark.shared_data
@pytest.mark.parametrize("name", ["GMSD7_20121014.rtcm3", "testglo.rtcm3"])
def test_relayed_orbits_are_those_of_pyrtcm(shared_data, name) -> None:
    compared = set()
    with open(shared_data / "real/streams" / name, "rb") as stream:
        for raw, message in RTCMReader(stream, quitonerror=0):
            if message is not None and message.identity in ("1019", "1020"):
                assert_same(message, raw[3:-3])
                compared.add(message.identity)
    assert compared == {"1019", "1020"}


@pytest.mark.parametrize("number", [1019, 1020, 1042, 1044, 1045, 1046])
def test_made_orbits_are_those_of_pyrtcm(number) -> None:
    rng = np.random.default_rng(number)
    for _ in range(20):
        length = _FIELDS[number][-1].runs[0][0] + _FIELDS[number][-1].runs[0][1]
        size = {1019: 61, 1020: 45, 1042: 64, 1044: 61, 1045: 62, 1046: 63}[number]
        assert length <= 8 * size
        content = bytearray(rng.integers(0, 256, size, dtype=np.uint8).tobytes())
        content[:3] = (number << 12 | 5 << 6 | 9).to_bytes(3, "big")
        if number == 1044:
            content[:3] = (number << 12 | 5 << 8 | 99).to_bytes(3, "big")
        ((_, message),) = RTCMReader(io.BytesIO(make_rtcm3_frame(bytes(content))), quitonerror=2)
        assert_same(message, bytes(content))


def encode(number: int, e: Ephemeris, more: dict[str, float]) -> bytes:
    """Return the content of a message that carries an orbit."""
    last = _FIELDS[number][-1].runs[0]
    n_bits = -(-(last[0] + last[1]) // 8) * 8
    frame = number << (n_bits - 12)
    for field in _FIELDS[number]:
        frame |= encode_value(field, more.get(field.name, getattr(e, field.name, 0)), n_bits)
    return frame.to_bytes(n_bits // 8, "big")


@pytest.mark.parametrize(("number", "week_0", "modulus"), [(1019, 0, 1024), (1045, 1024, 4096), (1046, 1024, 4096)])
def test_a_relayed_orbit_is_where_the_satellite_is(number, week_0, modulus) -> None:
    e = make_nominal_constellation(np.datetime64("2022-01-01T20:00:00", "ns")).ephemerides[3]
    galileo = number != 1019
    sent = {"sv": 4, "week": (e.week - week_0) % modulus, "sqrt_a": 5440.6 if galileo else e.sqrt_a}
    orbit = read_relayed_orbit(encode(number, e, sent), e.week + 3)
    assert (orbit.sat, orbit.week) == ("E04" if galileo else "G04", e.week)
    assert orbit.toe_s == e.toe
    made = orbit.ephemeris(e.reference_gpst - np.timedelta64(1800, "s"))
    assert (made.week, made.toe, made.toc_week) == (e.week, e.toe, e.toc_week)
    assert made.message == {1019: "LNAV", 1045: "FNAV", 1046: "INAV"}[number]
    if not galileo:
        at = e.reference_gpst
        apart = compute_satellite_state(made, at).position_ecef_m - compute_satellite_state(e, at).position_ecef_m
        assert np.linalg.norm(apart) < 1.0


def test_a_relayed_orbit_of_the_next_week_is_of_it() -> None:
    e = make_nominal_constellation(np.datetime64("2022-01-01T20:00:00", "ns")).ephemerides[3]
    content = encode(1019, e, {"sv": 4, "week": 100, "toe": 0.0, "toc": 0.0})
    orbit = read_relayed_orbit(content, 2148)
    saturday = np.datetime64("2021-03-13T23:30:00", "ns")  # of week 2148
    assert orbit.week == 2148
    assert orbit.ephemeris(saturday).week == 2149


def test_beidou_and_qzss_keep_their_own_seconds() -> None:
    e = make_nominal_constellation(np.datetime64("2022-01-01T20:00:00", "ns")).ephemerides[3]
    more = {"sv": 2, "week": 834, "toe": 3600.0, "toc": 3600.0, "sqrt_a": 6493.4, "i0": 0.05, "omega_dot": -2e-9}
    at = np.datetime64("2022-01-02T00:40:00", "ns")  # week 2191; 1356 + 834 is the one before
    made = read_relayed_orbit(encode(1042, e, more), 2190).ephemeris(at)
    assert (made.sat, made.week, made.toe, made.message) == ("C02", 2191, 3600.0, "D2")
    more = {"sv": 3, "week": 2190 % 1024, "sqrt_a": 6493.4, "i0": 0.7, "e": 0.07}
    made = read_relayed_orbit(encode(1044, e, more), 2190).ephemeris(e.reference_gpst)
    assert (made.sat, made.week, made.message) == ("J03", e.week, "LNAV")


def test_galileo_health_is_packed_as_rinex_has_it() -> None:
    e = make_nominal_constellation(np.datetime64("2022-01-01T20:00:00", "ns")).ephemerides[3]
    more = {"sv": 4, "week": 1166, "sqrt_a": 5440.6, "e1_invalid": 1, "e1_health": 2, "e5b_health": 1, "e5a_health": 3}
    at = e.reference_gpst
    assert read_relayed_orbit(encode(1046, e, more), 2190).ephemeris(at).health == 0b010_000_101
    assert read_relayed_orbit(encode(1045, e, more), 2190).ephemeris(at).health == 0b110_000


def test_short_messages_and_orbits_nobody_flies_are_none() -> None:
    e = make_nominal_constellation(np.datetime64("2022-01-01T20:00:00", "ns")).ephemerides[3]
    content = encode(1019, e, {"sv": 4, "week": 142})
    assert read_relayed_orbit(content[:-1], 2190) is None
    assert read_relayed_orbit(b"", 2190) is None
    assert read_relayed_orbit(encode(1019, e, {"sv": 0, "week": 142}), 2190) is None
    assert (
        read_relayed_orbit(encode(1019, e, {"sv": 4, "week": 142, "sqrt_a": 10.0}), 2190).ephemeris(e.reference_gpst)
        is None
    )
