"""One flight log of PX4: raw signals and inertia of a drone that is led away, through the same judge."""

from dataclasses import dataclass

import numpy as np
import pytest
from tests.logs.drone import BOOT_US, convert_utc_us, make_px4_flight
from tests.logs.test_autopilots import START, find_boot_us, make_gps_row

from skyproof.app.common.settings import Settings
from skyproof.app.protect import protect
from skyproof.app.receive.inputs import open_inputs
from skyproof.errors import SettingsError
from skyproof.formats.rinex_nav import write_nav
from skyproof.gnss.frames import geodetic_from_ecef
from skyproof.logs.ubx_write import ubx_log
from skyproof.navigation.fix import fix
from skyproof.records import NavigationData
from skyproof.simulator.constellation import make_navigation
from skyproof.simulator.measurements import draw, make_ideal_measurements
from skyproof.simulator.ordinary import follow_strongest
from skyproof.simulator.scenario import parse_scenario
from skyproof.simulator.sky import make_scene
from skyproof.simulator.truth import simulate_imus

ONSET_S, DRAWN_S, END_S = 50.0, 55.0, 100.0
LATE_S = 0.15  # from an epoch until the autopilot has what the receiver says of it


@dataclass
class Flight:
    """A flight log, with when it begins and the orbits of its sky."""

    log: bytes
    start_gpst: np.datetime64
    navigation: NavigationData


@pytest.fixture(scope="module")
def flight() -> Flight:
    corners = [[0.0, 0.0, 0.0], [300.0, 0.0, 20.0], [300.0, 300.0, 40.0], [0.0, 300.0, 20.0], [0.0, 0.0, 0.0]]
    made = parse_scenario(
        {
            "name": "drone",
            "seed": 3,
            "start_gpst": "2024-05-14T10:00:00",
            "duration_s": END_S,
            "receivers": [
                {
                    "name": "drone",
                    "lat_deg": 57.7,
                    "lon_deg": 11.9,
                    "height_m": 120.0,
                    "path": {"kind": "way-points", "points_enu_m": corners, "speed_m_s": 12.0},
                    "imu": {"grade": "consumer", "rate_hz": 100.0},
                }
            ],
            "attacks": [
                {
                    "kind": "takeover",
                    "target": "drone",
                    "onset_s": ONSET_S,
                    "power_db": 6.0,
                    "away_points_enu_m": [[DRAWN_S, 0.0, 0.0, 0.0], [END_S - 5.0, 200.0, 0.0, 0.0]],
                    "transmit": {"lat_deg": 57.701, "lon_deg": 11.902, "height_m": 60.0},
                }
            ],
        }
    )
    navigation = make_navigation(made)
    scene = make_scene(made, navigation)
    observations, _ = draw(make_ideal_measurements(scene), rng=np.random.default_rng(1))
    (o,) = map(follow_strongest, observations)
    start = o.gpst[0]
    lat, lon, height = geodetic_from_ecef(fix(o, navigation).position_ecef_m)
    words = {"fix_type": 3, "eph": 1.5, "epv": 2.5, "satellites_used": 9, "jamming_state": 1, "spoofing_state": 1}
    epochs = [
        (
            BOOT_US + round(1e6 * (float(o.elapsed_s[k] - o.elapsed_s[0]) + LATE_S)),
            octets,
            words
            | {"time_utc_usec": convert_utc_us(o.gpst[k]), "latitude_deg": np.degrees(lat[k])}
            | {"longitude_deg": np.degrees(lon[k]), "altitude_ellipsoid_m": height[k]},
        )
        for k, octets in enumerate(ubx_log(o, navigation))
    ]
    readings = simulate_imus(scene)["drone"].read(0, round(100.0 * END_S))
    boot_us = BOOT_US + np.rint((readings.gpst - start) / np.timedelta64(1, "us")).astype(np.int64)
    rows = zip(boot_us.tolist(), readings.angular_rate_rad_s, readings.specific_force_m_s2, strict=True)
    log = make_px4_flight(epochs, [(t, rate.tolist(), force.tolist()) for t, rate, force in rows])
    return Flight(log, start, navigation)


def test_a_drones_log_dates_the_attack_by_its_inertia(flight, tmp_path) -> None:
    path = tmp_path / "flight.ulg"
    path.write_bytes(flight.log)
    write_nav(tmp_path / "nav.rnx", flight.navigation)
    result = protect([path], nav=tmp_path / "nav.rnx")
    assert result.verdict.verdict == "spoofed"
    assert result.verdict.since_gpst is not None
    onset_s = (np.datetime64(result.verdict.since_gpst, "ns") - flight.start_gpst) / np.timedelta64(1, "s")
    assert ONSET_S - 2.0 < onset_s < DRAWN_S + 30.0
    (receiver,) = result.verdict.receivers
    assert receiver.trusted_fix is not None
    kinds = {note.format for note in result.verdict.inputs}
    assert "inertial readings" in kinds


def test_a_drones_log_before_the_attack_shows_none(flight, tmp_path) -> None:
    path = tmp_path / "flight.ulg"
    path.write_bytes(flight.log)
    write_nav(tmp_path / "nav.rnx", flight.navigation)
    assert protect([path], nav=tmp_path / "nav.rnx", duration_s=ONSET_S - 3.0).verdict.verdict == "no_attack_seen"


def test_a_drones_log_holds_what_the_receiver_says_of_itself(flight, tmp_path) -> None:
    path = tmp_path / "flight.bin"
    path.write_bytes(flight.log)
    (source,) = open_inputs([path], Settings())
    assert source.own.fixes.gpst.size == source.observations.gpst.size
    assert source.inertial.gpst.size > 9000
    assert {e.sat[0] for e in source.decoded.ephemerides} == {"G"}


def test_inertial_readings_that_are_none_are_left_out(flight, tmp_path) -> None:
    path = tmp_path / "flight.ulg"
    in_g = np.float32(9.80665)
    octets = bytearray(flight.log)
    # Accelerations in g: the rows of sensor_combined, whose first field is their time.
    for at in _find_rows(octets, 2):
        values = np.frombuffer(octets[at + 28 : at + 40], "<f4") / in_g
        octets[at + 28 : at + 40] = values.tobytes()
    path.write_bytes(octets)
    write_nav(tmp_path / "nav.rnx", flight.navigation)
    result = protect([path], nav=tmp_path / "nav.rnx", duration_s=ONSET_S - 3.0)
    remarks = [remark for note in result.verdict.inputs for remark in note.left_out]
    assert any("inertial" in remark for remark in remarks)


def test_a_platform_file_describes_the_unit_of_the_log(flight, tmp_path) -> None:
    path, platform = tmp_path / "flight.ulg", tmp_path / "platform.toml"
    path.write_bytes(flight.log)
    write_nav(tmp_path / "nav.rnx", flight.navigation)
    platform.write_text('[imu]\ngrade = "consumer"\nlever_arm_m = [0.1, 0.0, -0.05]\n')
    result = protect([path], nav=tmp_path / "nav.rnx", platform=platform)
    assert result.verdict.verdict == "spoofed"
    platform.write_text('[imu]\naxes = "flu"\ninitial = { heading_deg = 0.0, sigma_deg = 5.0 }\n')
    with pytest.raises(SettingsError, match="gravity"):
        protect([path], nav=tmp_path / "nav.rnx", platform=platform)


def test_a_unit_without_readings_is_refused(flight, tmp_path) -> None:
    path, platform = tmp_path / "flight.ulg", tmp_path / "platform.toml"
    rows = [make_gps_row(k) for k in range(20)]
    path.write_bytes(make_px4_flight([(find_boot_us(k), b"", row) for k, row in enumerate(rows)], []))
    platform.write_text('[imu]\ngrade = "consumer"\n')
    with pytest.raises(SettingsError, match=r"imu\.file"):
        protect([path], platform=platform)


@pytest.mark.parametrize(("far_deg", "word"), [(0.0, "no_attack_seen"), (0.05, "suspect")])
def test_a_log_of_fixes_alone_shows_jumps_of_its_place(far_deg, word, tmp_path) -> None:
    rows = [make_gps_row(k, latitude_deg=47.5 + 1e-5 * k + far_deg * (k > 30)) for k in range(60)]
    path = tmp_path / "flight.ulg"
    path.write_bytes(make_px4_flight([(find_boot_us(k), b"", row) for k, row in enumerate(rows)], []))
    verdict = protect([path]).verdict
    assert verdict.verdict == word
    if word == "suspect":
        at = np.datetime64(verdict.since_gpst, "ns") - START
        assert abs(at / np.timedelta64(1, "s") - 31.0) < 2.0


def _find_rows(octets: bytearray, number: int) -> list[int]:
    """Return where the records of a subscribed message begin, after the message's number."""
    found, k = [], 16
    while k + 5 <= len(octets):
        size = int.from_bytes(octets[k : k + 2], "little")
        if octets[k + 2] == ord("D") and int.from_bytes(octets[k + 3 : k + 5], "little") == number:
            found.append(k + 5)
        k += 3 + size
    return found
