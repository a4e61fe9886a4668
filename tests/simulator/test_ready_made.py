"""The ready-made scenes are those of the list, and hold the facts that their papers and pages give."""

import re
from functools import cache

import numpy as np
import pytest

from skyproof.arrays import Reals
from skyproof.errors import ScenarioError
from skyproof.gnss.constants import CA_CHIP_RATE_HZ, L1_HZ, SPEED_OF_LIGHT_M_S
from skyproof.gnss.frames import ecef_from_geodetic, rot_enu_ecef
from skyproof.simulator.attacks import Meaconer
from skyproof.simulator.constellation import make_navigation
from skyproof.simulator.received import ReceiverSky, Scene
from skyproof.simulator.scenario import Scenario, ScenePlace, parse_scenario
from skyproof.simulator.scenes import load_ready_made, read_ready_made
from skyproof.simulator.sky import make_scene
from skyproof.simulator.trajectories import make_las_vegas_false

WAVELENGTH_M = SPEED_OF_LIGHT_M_S / L1_HZ
CHIP_M = SPEED_OF_LIGHT_M_S / CA_CHIP_RATE_HZ
NAMES = {
    "ins-array-1",
    "ins-array-1-location-2",
    "ins-array-2",
    "ins-array-2-location-2",
    "some-satellites",
    "spin",
    "las-vegas",
    "static-austin",
    "vector-one-spoofer",
    "vector-many",
    "multi-receiver",
    "meacon-ramp",
    "clean",
    "takeover",
    "starts-spoofed",
    "two-antennas",
    "multipath",
    "jamming",
    *(f"texbat-like-{number}" for number in range(1, 9)),
}


@cache
def read_scene(name: str) -> Scene:
    return work_out(read_ready_made(name))


def work_out(scenario: Scenario) -> Scene:
    return make_scene(scenario, make_navigation(scenario))


def convert_ecef(place: ScenePlace) -> Reals:
    return ecef_from_geodetic(*place.geodetic_rad)


def convert_enu_m(place: ScenePlace, seen_from: ScenePlace) -> Reals:
    lat_rad, lon_rad, _ = seen_from.geodetic_rad
    return np.asarray(rot_enu_ecef(lat_rad, lon_rad) @ (convert_ecef(place) - convert_ecef(seen_from)))


def convert_az_el_deg(place: ScenePlace, seen_from: ScenePlace) -> tuple[float, float]:
    east, north, up = convert_enu_m(place, seen_from)
    return float(np.degrees(np.arctan2(east, north)) % 360.0), float(np.degrees(np.arctan2(up, np.hypot(east, north))))


def measure_away_m(name: str, one: str, other: str) -> float:
    places = {receiver.name: receiver for receiver in read_ready_made(name).receivers}
    return float(np.linalg.norm(convert_ecef(places[one]) - convert_ecef(places[other])))


def list_columns(sky: ReceiverSky, label: str) -> dict[str, int]:
    return {heard.id.sat: column for column, heard in enumerate(sky.signals) if heard.label == label}


def measure_lags_m(sky: ReceiverSky, true_s: Reals) -> tuple[Reals, Reals]:
    """Subtract the true code and carrier from the false, (n, n_sats) each, the satellites in order."""
    code_s, carrier_s = sky.delays_s(true_s)
    false, true = list_columns(sky, "spoofed"), list_columns(sky, "authentic")
    pairs = np.array([(false[sat], true[sat]) for sat in sorted(false.keys() & true.keys())])
    return (
        SPEED_OF_LIGHT_M_S * (code_s[:, pairs[:, 0]] - code_s[:, pairs[:, 1]]),
        SPEED_OF_LIGHT_M_S * (carrier_s[:, pairs[:, 0]] - carrier_s[:, pairs[:, 1]]),
    )


def measure_excess_db(sky: ReceiverSky, true_s: Reals) -> Reals:
    """Divide the false power by the true, (n, n_sats), dB."""
    level = sky.cn0_dbhz(true_s)
    false, true = list_columns(sky, "spoofed"), list_columns(sky, "authentic")
    usable = sorted(false.keys() & true.keys())
    return np.asarray(level[:, [false[sat] for sat in usable]] - level[:, [true[sat] for sat in usable]])


def measure_shown_enu_m(name: str, true_s: Reals) -> Reals:
    """Measure how far the place shown has left the receiver, in axes of where that is at the first time."""
    the_scene = read_scene(name)
    (trajectory,) = the_scene.trajectories.values()
    shown_m, true_m = the_scene.shown[0](true_s).position_ecef_m, trajectory.at(true_s).position_ecef_m
    receiver = the_scene.scenario.receivers[0]
    return np.asarray((shown_m - true_m) @ rot_enu_ecef(*receiver.geodetic_rad[:2]).T)


# ------------------------------------------------------------------ all of them


def test_they_are_those_of_the_list() -> None:
    assert load_ready_made().keys() == NAMES
    assert list(load_ready_made()) == sorted(NAMES)


def test_a_name_that_is_none_is_refused_with_the_nearest() -> None:
    with pytest.raises(ScenarioError, match=r"'texbat-lik-7' .*'texbat-like-\d'"):
        read_ready_made("texbat-lik-7")


@pytest.mark.parametrize("name", sorted(NAMES))
def test_each_describes_itself_and_can_be_worked_out(name: str) -> None:
    made, scenario = load_ready_made()[name], read_ready_made(name)
    assert scenario.name == name == made.path.stem
    assert (made.title, made.source) == (scenario.description, scenario.source)
    assert re.fullmatch(r"[^\n]{20,110}\.", made.title)
    text = made.path.read_text(encoding="utf-8")
    comment = re.match(r"(#.*\n)+", text)
    assert comment is not None
    assert comment[0].startswith("# Shows: ")
    assert "\n# Chosen here: " in comment[0]
    assert "\n# Source: " in comment[0] or scenario.source == "this package"
    assert all(len(line) <= 120 for line in text.splitlines())
    assert scenario.front_end.bandwidth_hz == pytest.approx(0.8 * scenario.front_end.rate_hz)
    assert scenario.navigation is None  # no file is needed
    assert all(sky.signals for sky in read_scene(name).skies)
    assert {heard.label for sky in read_scene(name).skies for heard in sky.signals} == (
        {"authentic"} if name in {"clean", "multipath", "jamming"} else {"authentic", "spoofed"}
    )


@pytest.mark.parametrize("name", sorted(NAMES))
def test_each_reads_the_same_after_it_was_written(name: str) -> None:
    scenario = read_ready_made(name)
    assert Scenario.model_validate_json(scenario.model_dump_json()) == scenario


# ------------------------------------------------------------------ papers


def test_receivers_of_multi_receiver_stand_as_tables_3_and_4_say() -> None:
    pairs = {
        ("rx1", "rx2"): 100,
        ("rx3", "rx4"): 100,
        ("rx1", "rx5"): 1,
        ("rx1", "rx6"): 5,
        ("rx1", "rx7"): 10,
        ("rx1", "rx8"): 20,
        ("rx1", "rx9"): 35,
        ("rx1", "rx10"): 50,
        ("rx6", "rx7"): 5,
        ("rx1", "rx3"): 50,
        ("rx1", "rx4"): 50,
    }
    for (first, other), metres in pairs.items():
        assert measure_away_m("multi-receiver", first, other) == pytest.approx(metres, abs=0.01), (first, other)
    scenario = read_ready_made("multi-receiver")
    places = {receiver.name: receiver for receiver in scenario.receivers}
    assert len(places) == 10
    along, across = convert_enu_m(places["rx2"], places["rx1"]), convert_enu_m(places["rx4"], places["rx3"])
    assert along[:2] == pytest.approx([-(0.5**0.5) * 100, 0.5**0.5 * 100], abs=0.01)  # to the north-west
    assert along @ across == pytest.approx(0.0, abs=1.0)
    path_m = dict(zip(places, read_scene("multi-receiver").path_m[0], strict=True))
    assert path_m["rx1"] == pytest.approx(500.0, abs=0.01)
    assert path_m["rx2"] == pytest.approx(600.0, abs=0.01)
    assert path_m["rx3"] == pytest.approx(path_m["rx4"], abs=0.01)


def test_false_ranges_differ_by_distances_to_the_meaconer() -> None:
    the_scene = read_scene("multi-receiver")
    at_s = np.array([10.0, 300.0])
    rx = {sky.name: sky for sky in the_scene.skies}
    false_m = {
        name: SPEED_OF_LIGHT_M_S * sky.delays_s(at_s)[0][:, sorted(list_columns(sky, "spoofed").values())]
        for name, sky in rx.items()
    }
    assert false_m["rx1"] - false_m["rx2"] == pytest.approx(-100.0, abs=0.011)
    assert false_m["rx3"] - false_m["rx4"] == pytest.approx(0.0, abs=0.011)
    meaconer = the_scene.scenario.attacks[0]
    assert isinstance(meaconer, Meaconer)
    assert SPEED_OF_LIGHT_M_S * meaconer.delay_s == pytest.approx(400.0, abs=0.01)
    assert len(list_columns(rx["rx1"], "authentic")) == len(list_columns(rx["rx1"], "spoofed")) == 7


def test_powers_of_multi_receiver_are_those_of_section_4_2_2() -> None:
    sky = read_scene("multi-receiver").skies[0]
    for since_s, until_s, level_db in ((0, 119, 0), (122, 179, -3), (182, 239, 3), (242, 299, 10), (302, 360, 20)):
        assert measure_excess_db(sky, np.linspace(since_s, until_s, 9)) == pytest.approx(level_db, abs=0.01)


def test_the_meaconer_of_the_ramp_climbs_and_falls_2_db_in_30_s() -> None:
    sky = read_scene("meacon-ramp").skies[0]
    middle_s = np.arange(15.0, 930.0, 30.0)
    level_db = measure_excess_db(sky, middle_s).mean(axis=1)
    up = -14.0 + 2.0 * np.arange(15)
    assert level_db == pytest.approx([*up, 14.0, 14.0, *up[-2::-1]], abs=0.01)
    distances = {("A", "B"): 50.0, ("A", "C"): 15.0}
    for (first, other), metres in distances.items():
        assert measure_away_m("meacon-ramp", first, other) == pytest.approx(metres, abs=0.01)
    assert read_scene("meacon-ramp").path_m[0, :2] == pytest.approx([120.0, 70.0], abs=0.1)
    meaconer = read_ready_made("meacon-ramp").attacks[0]
    assert isinstance(meaconer, Meaconer)
    assert np.linalg.norm(
        convert_enu_m(meaconer.receive, read_ready_made("meacon-ramp").receivers[0])
    ) == pytest.approx(900.0, abs=30.0)


def test_the_arm_of_spin_makes_the_phase_of_the_paper() -> None:
    scenario = read_ready_made("spin")
    (antenna,) = scenario.receivers[0].antennas
    assert antenna.spin is not None
    assert antenna.spin.radius_m == pytest.approx(0.5 * WAVELENGTH_M, abs=1e-7)
    table = scenario.model_dump(mode="json", exclude_none=True)
    table["receivers"][0]["antennas"] = [{"name": "middle"}]
    turning, still = read_scene("spin").skies[0], work_out(parse_scenario(table)).skies[0]
    n = np.arange(20.0)
    w = 0.05 * np.pi  # a sample at 10 Hz
    phase_cyc = -L1_HZ * (turning.delays_s(n / 10.0)[1] - still.delays_s(n / 10.0)[1])
    assert scenario.sky.directions is not None
    toward = {(sky.sat, "authentic"): (sky.az_deg, sky.el_deg) for sky in scenario.sky.directions}
    toward |= {("G01", "spoofed"): (160.0, 55.0), ("G02", "spoofed"): (160.0, 55.0)}
    assert {toward["G03", "authentic"], toward["G04", "authentic"]} == {(148.0, 50.0), (158.0, 53.0)}
    assert len(toward) == len(turning.signals)
    for column, heard in enumerate(turning.signals):
        az, el = np.radians(toward[heard.id.sat, heard.label])
        expected_cyc = 0.5 * np.cos(el) * np.cos(w * n + az)
        assert phase_cyc[:, column] == pytest.approx(expected_cyc, abs=3e-4), heard  # satellites move 0.02 degrees


@pytest.mark.parametrize(
    ("name", "predicted", "from_where"),
    [
        (
            "ins-array-1",
            {"G03": (276.80, 22.19), "G29": (48.0, 21.0), "G32": (148.04, 30.85)},
            {"G03": (276.0, 24.0), "G29": (60.0, 30.0), "G32": (150.0, 23.0)},
        ),
        (
            "ins-array-1-location-2",
            {"G02": (356.0, 67.0), "G20": (233.0, 76.0), "G29": (313.0, 12.0)},
            {"G02": (276.0, 24.0), "G20": (60.0, 30.0), "G29": (150.0, 23.0)},
        ),
        (
            "ins-array-2",
            {"G03": (276.80, 22.19), "G29": (48.0, 21.0), "G32": (148.04, 30.85)},
            dict.fromkeys(("G03", "G29", "G32"), (150.0, 30.0)),
        ),
        (
            "ins-array-2-location-2",
            {"G02": (356.0, 67.0), "G20": (233.0, 76.0), "G29": (313.0, 12.0)},
            dict.fromkeys(("G02", "G20", "G29"), (150.0, 30.0)),
        ),
    ],
)
def test_signals_reach_the_array_from_the_papers_directions(
    name: str, predicted: dict[str, tuple[float, float]], from_where: dict[str, tuple[float, float]]
) -> None:
    scenario = read_ready_made(name)
    receiver, attack = scenario.receivers[0], scenario.attacks[0]
    assert attack.sats == tuple(sorted(from_where))
    for sat, direction in from_where.items():
        sender = attack.transmit_sites[attack.find_antenna(sat)]
        assert convert_az_el_deg(sender, receiver) == pytest.approx(direction, abs=0.001)
    places = np.array([antenna.body_m for antenna in receiver.antennas])
    sides = [np.linalg.norm(places[k] - places[k - 1]) for k in range(3)]
    assert sides == pytest.approx([WAVELENGTH_M] * 3, abs=1e-6)
    # What an array with the compass azimuths of these directions measures, in cycles
    skies = read_scene(name).skies
    phase_cyc = [-L1_HZ * sky.delays_s(np.array([0.0]))[1][0] for sky in skies]
    for directions, label in ((predicted, "authentic"), (from_where, "spoofed")):
        for sat, direction in directions.items():
            az, el = np.radians(direction)
            cosines = np.array([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az)])
            column = list_columns(skies[0], label)[sat]
            for number in (1, 2):
                measured = phase_cyc[number][column] - phase_cyc[0][column]
                expected = places[number, :2] @ cosines / WAVELENGTH_M
                assert measured == pytest.approx(expected, abs=2e-4), (sat, label)


def test_the_vector_sky_is_that_of_the_tables() -> None:
    directions = {
        "G02": (274, 21),
        "G12": (327, 24),
        "G13": (90, 26),
        "G17": (239, 73),
        "G20": (168, 57),
        "G28": (212, 31),
    }
    for name in ("vector-one-spoofer", "vector-many"):
        sky = read_scene(name).skies[0]
        signals = list_columns(sky, "authentic") | list_columns(sky, "spoofed")
        assert signals.keys() == directions.keys()
        first = (sky.knots_s >= 0.0) & (sky.knots_s <= 1.0)
        for sat, column in signals.items():
            az, el = np.radians(directions[sat])
            az_rad, el_rad = sky.az_rad[first, column], sky.el_rad[first, column]
            cosine = np.sin(el_rad) * np.sin(el) + np.cos(el_rad) * np.cos(el) * np.cos(az_rad - az)
            assert np.degrees(np.arccos(np.minimum(cosine, 1.0))).max() < 0.01, sat
        az, el = np.radians(np.array(list(directions.values()), np.float64).T)
        rows = np.stack([-np.cos(el) * np.sin(az), -np.cos(el) * np.cos(az), -np.sin(el), np.ones(6)], axis=1)
        residual = np.eye(6) - rows @ np.linalg.pinv(rows)
        assert residual[0, 0] == pytest.approx(0.4454, abs=1e-4)
        assert np.sqrt(np.trace(np.linalg.inv(rows.T @ rows))) == pytest.approx(2.651, abs=1e-3)


@pytest.mark.parametrize(
    ("name", "sats", "chips", "hertz", "cn0_dbhz"),
    [("vector-one-spoofer", ["G02"], 0.4, 200.0, 40.0), ("vector-many", ["G12", "G13", "G17"], 0.5, 250.0, 45.0)],
)
def test_false_signals_are_shifted_as_the_tables_state(
    name: str, sats: list[str], chips: float, hertz: float, cn0_dbhz: float
) -> None:
    table = read_ready_made(name).model_dump(mode="json", exclude_none=True)
    table["sky"].pop("sats")  # the true ones of the attacked satellites as well
    sky = work_out(parse_scenario(table)).skies[0]
    assert sorted(list_columns(sky, "spoofed")) == sats
    at_s = np.linspace(0.0, 59.0, 30)
    code_m, carrier_m = measure_lags_m(sky, at_s)
    assert code_m / CHIP_M == pytest.approx(chips, abs=1e-5)
    doppler_hz = -np.diff(carrier_m, axis=0) / WAVELENGTH_M / np.diff(at_s)[:, np.newaxis]
    assert doppler_hz == pytest.approx(hertz, abs=1e-4)
    assert sky.cn0_dbhz(at_s) == pytest.approx(cn0_dbhz, abs=1e-6)


def test_the_path_shown_over_las_vegas_is_that_of_the_paper() -> None:
    at_s = np.array([0.0, 60.0, 89.0, 90.0, 120.0, 150.0, 190.0, 191.0, 232.0])
    offset_m = read_scene("las-vegas").shown[0](at_s).position_ecef_m - make_las_vegas_false().at(at_s).position_ecef_m
    assert np.linalg.norm(offset_m, axis=1).max() < 0.2  # axes of the fix here, of the place at 90 s there: 1 mrad
    assert np.linalg.norm(offset_m[:3], axis=1).max() < 1e-6
    sky = read_scene("las-vegas").skies[0]
    code_m, _ = measure_lags_m(sky, at_s)
    assert np.abs(code_m[:3]).max() < 1e-3
    assert np.abs(code_m[-1]).max() > 30.0
    assert measure_excess_db(sky, at_s) == pytest.approx(0.0, abs=0.02)
    assert read_scene("las-vegas").scenario.front_end.rate_hz == 25e6
    assert read_scene("las-vegas").scenario.duration_s == 233.0


def test_the_austin_roof_stands_at_figure_8_and_is_led_up_east() -> None:
    roof = read_ready_made("static-austin").receivers[0]
    assert roof.lat_deg == pytest.approx(30 + 17 / 60 + 15.068 / 3600, abs=1e-8)
    assert roof.lon_deg == pytest.approx(-(97 + 44 / 60 + 8.642 / 3600), abs=1e-8)
    offset_m = measure_shown_enu_m("static-austin", np.array([0.0, 19.0, 70.0, 121.0, 130.0]))
    size_m = np.array([0.0, 0.0, 50.0, 100.0, 100.0])
    assert offset_m == pytest.approx(size_m[:, np.newaxis] * np.array([0.5**0.5, 0.0, 0.5**0.5]), abs=1e-6)
    assert np.abs(measure_lags_m(read_scene("static-austin").skies[0], np.array([0.0, 10.0]))[0]).max() < 1e-3


# ------------------------------------------------------------------ our own


def test_the_takeover_begins_on_true_signals_and_ends_as_stated() -> None:
    sky = read_scene("takeover").skies[0]
    on_s = np.array([15.0001, 20.0, 28.9])
    code_m, carrier_m = measure_lags_m(sky, on_s)
    assert np.abs(code_m).max() < 1e-3
    assert np.ptp(carrier_m, axis=0).max() < 1e-3  # a phase of its own, and no other Doppler
    assert measure_excess_db(sky, np.array([15.01, 25.0, 60.0]))[:, 0] == pytest.approx([-20.0, 4.0, 4.0], abs=0.05)
    assert measure_shown_enu_m("takeover", np.array([28.9, 61.1, 75.0])) == pytest.approx(
        np.array([[0, 0, 0], [300, 100, 0], [300, 100, 0]]), abs=1e-6
    )
    code_m, _ = measure_lags_m(sky, np.array([75.0]))
    az, el = np.array(
        [(sky.az_rad[-5, column], sky.el_rad[-5, column]) for _, column in sorted(list_columns(sky, "spoofed").items())]
    ).T
    toward = np.stack([np.cos(el) * np.sin(az), np.cos(el) * np.cos(az), np.sin(el)], axis=1)
    assert code_m[0] == pytest.approx(-toward @ [300.0, 100.0, 0.0], abs=0.1)  # the air differs by centimetres there


def test_the_attack_of_starts_spoofed_is_in_the_first_sample() -> None:
    for sky in read_scene("starts-spoofed").skies:
        false = [heard for heard in sky.signals if heard.label == "spoofed"]
        assert sum(heard.from_s < sky.receiver.start_offset_s for heard in false) >= 8  # others rise later
        assert len(false) == len(list_columns(sky, "authentic"))


def test_satellites_of_two_antennas_are_shared_between_both() -> None:
    scenario = read_ready_made("two-antennas")
    attack = scenario.attacks[0]
    first, second = attack.transmit_sites
    assert np.linalg.norm(convert_ecef(first) - convert_ecef(second)) == pytest.approx(300.0, abs=1.0)
    assert measure_away_m("two-antennas", "rx1", "rx2") == pytest.approx(20.0, abs=0.01)
    one, two = read_scene("two-antennas").skies
    false_m = [SPEED_OF_LIGHT_M_S * sky.delays_s(np.array([30.0]))[0][0] for sky in (one, two)]
    by_antenna: dict[int, list[float]] = {0: [], 1: []}  # alike but for 67 ns, in which ranges change by 0.05 mm
    for sat, column in list_columns(one, "spoofed").items():
        by_antenna[attack.find_antenna(sat)].append(false_m[0][column] - false_m[1][column])
    assert all(len(differences) >= 5 and np.ptp(differences) < 5e-4 for differences in by_antenna.values())
    assert abs(np.mean(by_antenna[0]) - np.mean(by_antenna[1])) > 5.0


def test_multipath_and_jamming_are_there() -> None:
    rays = [len(sky.rays) for sky in read_scene("multipath").skies]
    assert rays[0] > rays[1] >= 8
    for sky in read_scene("jamming").skies:
        assert [jammer.source.kind for jammer in sky.jammers] == ["chirp", "cw"]
        assert len(sky.noises) == 1
    van = read_scene("jamming").skies[0].jammers[0]
    at_s = np.linspace(10.5, 69.5, 600)
    assert 10.0 * np.log10(van.power(at_s).max()) == pytest.approx(-5.0 + 20.0 * np.log10(600.5 / 25.0), abs=0.3)
    assert at_s[van.power(at_s).argmax()] == pytest.approx(40.0, abs=0.2)


# ------------------------------------------------------------------ likenesses of TEXBAT


@pytest.mark.parametrize(
    ("number", "power_db", "onset_s", "locked", "pushed", "moving"),
    [
        (2, 10.0, 110.1, False, "time", False),
        (3, 1.3, 118.9, True, "time", False),
        (4, 0.4, 113.8, True, "position", False),
        (5, 9.9, 102.0, False, "time", True),
        (6, 0.8, 105.0, True, "position", True),
    ],
)
def test_likenesses_2_to_6_push_as_published(
    number: int, power_db: float, onset_s: float, locked: bool, pushed: str, moving: bool
) -> None:
    name = f"texbat-like-{number}"
    sky = read_scene(name).skies[0]
    at_s = np.array([onset_s + 0.01, 140.0, 152.9, 160.0, 260.0, 280.0, 299.0])
    code_m, carrier_m = measure_lags_m(sky, at_s)
    for heard in sky.signals:
        assert heard.from_s == (pytest.approx(onset_s, abs=1e-6) if heard.label == "spoofed" else -np.inf)
    assert np.abs(code_m[:3]).max() < 1e-3
    assert measure_excess_db(sky, at_s) == pytest.approx(power_db, abs=0.01)
    along_m = np.array([0.0, 0.0, 0.0, 30.0, 530.0, 600.0, 600.0])  # 5 m/s
    if pushed == "time":
        assert code_m == pytest.approx(np.broadcast_to(along_m[:, np.newaxis], code_m.shape), abs=2e-3)
    else:
        up = np.array([0.0, 0.0, 1.0])
        assert measure_shown_enu_m(name, at_s) == pytest.approx(
            along_m[:, np.newaxis] * up, abs=0.1
        )  # axes turn on the way
        assert np.ptp(code_m[-1]) > 100.0
    drawn_m = carrier_m - carrier_m[0]
    assert drawn_m == pytest.approx(np.zeros(code_m.shape) if locked else code_m - code_m[0], abs=2e-3)
    moved_m = np.ptp(read_scene(name).skies[0].point(at_s).position_ecef_m, axis=0).max()
    assert (moved_m > 300.0) == moving


def test_likeness_1_switches_from_the_sky_to_the_spoofer() -> None:
    sky = read_scene("texbat-like-1").skies[0]
    true, false = list_columns(sky, "authentic"), list_columns(sky, "spoofed")
    assert true.keys() == false.keys()
    for sat in true:
        assert sky.signals[true[sat]].until_s == pytest.approx(125.0, abs=1e-9)
        assert sky.signals[false[sat]].from_s == pytest.approx(125.0, abs=1e-6)
    assert np.abs(measure_lags_m(sky, np.array([125.1, 299.0]))[0]).max() < 1e-3
    assert measure_excess_db(sky, np.array([125.1, 299.0])) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("number", [7, 8])
def test_likenesses_7_and_8_push_all_satellites_at_1_2_m_s(number: int) -> None:
    # `test_seamless_takeover` measures them.
    the_scene = read_scene(f"texbat-like-{number}")
    sky, scenario = the_scene.skies[0], the_scene.scenario
    assert scenario.duration_s == 468.0
    assert [heard.source for heard in sky.signals].count("takeover") == len(sky.signals) / 2 >= 8
    assert scenario.attacks[0].guess_s == (0.0 if number == 7 else 50e-6)
    at_s = np.array([110.5, 120.0, 129.0, 131.0, 149.9, 150.1, 275.0, 400.0, 420.0])
    code_m, carrier_m = measure_lags_m(sky, at_s)
    pushed_m = 1.2 * np.maximum(at_s - 150.0, 0.0)
    assert code_m == pytest.approx(np.broadcast_to(pushed_m[:, np.newaxis], code_m.shape), abs=2e-3)
    ahead_deg = -360.0 * carrier_m / WAVELENGTH_M
    published_deg = np.interp(at_s, [110.0, 130.0], [90.0, 180.0])
    assert ahead_deg == pytest.approx(np.broadcast_to(published_deg[:, np.newaxis], ahead_deg.shape), abs=0.1)
    amplitude = 10.0 ** (measure_excess_db(sky, at_s) / 20.0)
    published = np.where(at_s < 150.0, -2.0 * np.cos(np.radians(published_deg)), np.interp(at_s, [150, 400], [2, 1]))
    assert amplitude == pytest.approx(np.broadcast_to(published[:, np.newaxis], amplitude.shape), rel=1e-4)
