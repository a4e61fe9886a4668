"""The series of the truth agree with their scene, with measurements and samples, and with each other."""

import numpy as np
import pytest

from skyproof.gnss.ephemeris import NavigationData
from skyproof.gnss.frames import ecef_from_geodetic, heading_pitch_roll_rad
from skyproof.gnss.time import seconds_between
from skyproof.simulator import truth
from skyproof.simulator.measurements import make_ideal_measurements
from skyproof.simulator.received import Scene
from skyproof.simulator.scenario import Antenna, Multipath, Scenario, SceneImu
from skyproof.simulator.sites import Circle
from skyproof.simulator.sky import make_scene
from skyproof.simulator.truth import (
    compute_signal_truth,
    compute_trajectory_truth,
    iterate_imu_blocks,
    iterate_signal_blocks,
    iterate_trajectory_blocks,
    simulate_imus,
)

LIGHT_M_S = 299_792_458.0


@pytest.fixture(scope="module")
def scene(scenario: Scenario, navigation: NavigationData) -> Scene:
    """Make two receivers: one stands, one drives in a circle with a restless clock, two antennas, an inertial unit and
    a reflection.
    """
    first, second = scenario.receivers
    site = second.model_dump(exclude={"heading_deg", "pitch_deg", "roll_deg", "path", "antennas", "imu", "multipath"})
    second = type(second)(
        **site | {"oscillator": "tcxo"},
        path=Circle(radius_m=40.0, speed_m_s=8.0),
        antennas=(Antenna(name="l"), Antenna(name="r", body_m=(0.0, 1.0, 0.0), line_bias_cyc=0.25)),
        imu=SceneImu(rate_hz=50.0, mounting_deg=(0.0, 0.0, 90.0)),
        multipath=(Multipath(delay_m=20.0, power_db=-12.0),),
    )
    return make_scene(scenario.model_copy(update={"receivers": (first, second), "duration_s": 12.0}), navigation)


def test_rows_stand_at_whole_tenths_of_the_scene(scene: Scene) -> None:
    table = compute_trajectory_truth(scene, "two")
    assert len({len(column) for column in table.values()}) == 1
    np.testing.assert_allclose(table["true_s"], np.arange(0, 120) / 10.0, atol=1e-12)  # it starts 0.4 ms early
    assert table["gpst"][1] - scene.scenario.start_gpst == np.timedelta64(100_000_000, "ns")
    assert table["elapsed_s"][0] == pytest.approx(4.1e-4, abs=1e-9)


def test_where_it_is_said_in_three_ways(scene: Scene) -> None:
    table = compute_trajectory_truth(scene, "two", 50.0)
    place = np.stack([table[name] for name in ("x_m", "y_m", "z_m")], axis=1)
    angles = np.radians(table["lat_deg"]), np.radians(table["lon_deg"]), table["height_m"]
    np.testing.assert_allclose(ecef_from_geodetic(*angles), place, atol=1e-6)
    velocity = np.stack([table[name] for name in ("vx_m_s", "vy_m_s", "vz_m_s")], axis=1)
    np.testing.assert_allclose((place[2:] - place[:-2]) * 25.0, velocity[1:-1], atol=2e-4)
    along = np.degrees(np.arctan2(table["v_east_m_s"], table["v_north_m_s"])) % 360.0
    np.testing.assert_allclose(along, table["heading_deg"], atol=1e-6)
    np.testing.assert_allclose(np.hypot(table["v_east_m_s"], table["v_north_m_s"]), 8.0, atol=1e-4)
    motion = scene.trajectories["two"].at(table["true_s"])
    _, pitch_rad, roll_rad = heading_pitch_roll_rad(motion.position_ecef_m, motion.attitude)
    np.testing.assert_allclose(table["roll_deg"], np.degrees(roll_rad))
    np.testing.assert_allclose(table["pitch_deg"], np.degrees(pitch_rad))


@pytest.mark.parametrize("name", ["one", "two"])
def test_the_clock_is_what_the_sampling_clock_counts(scene: Scene, name: str) -> None:
    # What it shows at a row is what it showed at the first sample, and what has been counted since.
    table = next(iterate_trajectory_blocks(scene, name, 10_000.0))
    receiver = next(sky.receiver for sky in scene.skies if sky.receiver.name == name)
    shown_s = receiver.start_offset_s + receiver.clock_offset_s + table["elapsed_s"]
    np.testing.assert_allclose(table["clock_offset_s"], shown_s - table["true_s"], atol=1e-13)
    rate = (table["clock_offset_s"][2:] - table["clock_offset_s"][:-2]) * 5_000.0
    np.testing.assert_allclose(rate, table["clock_drift"][1:-1], rtol=0.0, atol=1e-9)  # a knot is a corner
    assert (np.ptp(table["clock_drift"]) > 1e-9) == (name == "two")


@pytest.mark.parametrize("antenna", ["one", "two.l", "two.r"])
def test_signals_are_what_is_measured_without_noise(scene: Scene, antenna: str) -> None:
    # Measurements are means over a second, which a steady acceleration moves by less than a tenth of a metre.
    table = compute_signal_truth(scene, antenna)
    (geometry,) = (measurement for measurement in make_ideal_measurements(scene) if measurement.receiver == antenna)
    compared = 0
    for column, signal in enumerate(geometry.signals):
        mine = (table["sat"] == signal.sat) & (table["copy"] == signal.copy)
        assert set(table["label"][mine]) == {geometry.labels[column]}
        for row in np.flatnonzero(np.isin(table["receiver_gpst"], geometry.gpst) & mine):
            (epoch,) = np.flatnonzero(geometry.gpst == table["receiver_gpst"][row])
            if not geometry.present[epoch, column]:
                continue
            assert table["elapsed_s"][row] == geometry.elapsed_s[epoch]
            assert abs(table["pseudorange_m"][row] - geometry.pseudorange_m[epoch, column]) < 0.15
            assert table["doppler_hz"][row] == pytest.approx(geometry.doppler_hz[epoch, column], abs=1e-6)
            assert table["cn0_dbhz"][row] == pytest.approx(geometry.cn0_dbhz[epoch, column])
            compared += 1
        cycles = table["carrier_cyc"][mine] * LIGHT_M_S / 1575.42e6 - table["pseudorange_m"][mine]
        assert np.abs(cycles).max() < 100.0  # the ionosphere, twice, and the line: no ambiguity
    assert compared > 50


def test_a_pseudorange_is_the_way_and_the_clock(scene: Scene) -> None:
    table = compute_signal_truth(scene, "two.r", 5.0)
    clock = compute_trajectory_truth(scene, "two", 200.0)
    (sky,) = (sky for sky in scene.skies if sky.name == "two.r")
    offset_s = np.interp(table["true_s"], clock["true_s"], clock["clock_offset_s"])
    columns = {(heard.id.sat, heard.id.copy): column for column, heard in enumerate(sky.signals)}
    of = [columns[key] for key in zip(table["sat"], table["copy"], strict=True)]
    code_s = sky.code_delay_s(table["true_s"])[np.arange(len(of)), of]
    kept = table["true_s"] >= clock["true_s"][0]
    np.testing.assert_allclose((table["pseudorange_m"] - LIGHT_M_S * (code_s + offset_s))[kept], 0.0, atol=0.01)


def test_a_line_bias_is_in_the_carrier(scene: Scene, scenario: Scenario, navigation: NavigationData) -> None:
    bare = [
        receiver.model_copy(
            update={
                "antennas": tuple(antenna.model_copy(update={"line_bias_cyc": 0.0}) for antenna in receiver.antennas)
            }
        )
        for receiver in scene.scenario.receivers
    ]
    without = compute_signal_truth(
        make_scene(scene.scenario.model_copy(update={"receivers": tuple(bare)}), navigation), "two.r"
    )
    table = compute_signal_truth(scene, "two.r")
    np.testing.assert_allclose(table["carrier_cyc"] - without["carrier_cyc"], 0.25, atol=1e-6)
    np.testing.assert_allclose(table["pseudorange_m"], without["pseudorange_m"], atol=1e-6)


def test_false_signals_have_rows_while_they_are_there(scene: Scene) -> None:
    table = compute_signal_truth(scene, "one", 10.0)
    false = table["label"] == "spoofed"
    assert set(table["source"][false]) == {"meaconer"}
    assert set(table["source"][~false]) == {"sky"}
    assert 1.5 < table["true_s"][false].min() < 1.6
    assert table["true_s"][~false].min() < 0.1
    assert ((table["elevation_deg"] > 4.9) & (table["elevation_deg"] <= 90.0)).all()
    assert ((table["azimuth_deg"] >= 0.0) & (table["azimuth_deg"] < 360.0)).all()


def test_blocks_put_together_are_the_whole(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = compute_trajectory_truth(scene, "two"), compute_signal_truth(scene, "two.l")
    monkeypatch.setattr(truth, "_ROWS", 7)
    monkeypatch.setattr(truth, "_EPOCHS", 3)
    assert len(list(iterate_trajectory_blocks(scene, "two"))) == 18
    assert len(list(iterate_signal_blocks(scene, "two.l"))) == 4
    for first, other in zip(
        whole, (compute_trajectory_truth(scene, "two"), compute_signal_truth(scene, "two.l")), strict=True
    ):
        assert first.keys() == other.keys()
        for name in first:
            if first[name].dtype.kind == "f":
                apart = 1e-14
                if "doppler" in name:
                    apart = 2e-5  # of differences of delays, over 20 ms
                elif "to_authentic" in name:
                    apart = 1e-7  # of differences of delays, in metres and cycles
                np.testing.assert_allclose(first[name], other[name], rtol=1e-14, atol=apart)
            else:
                np.testing.assert_array_equal(first[name], other[name])


def test_labels_keep_a_nanosecond_and_true_s_the_rest(scene: Scene) -> None:
    table = compute_signal_truth(scene, "one")
    label_s = seconds_between(table["gpst"], scene.scenario.start_gpst)
    assert np.abs(label_s - table["true_s"]).max() < 0.6e-9
    shown_s = seconds_between(table["receiver_gpst"], np.datetime64("2023-03-04T05:06:00", "ns"))
    np.testing.assert_array_equal(shown_s, np.rint(shown_s))


def test_an_inertial_unit_feels_gravity_and_the_turn(scene: Scene) -> None:
    # 8 m/s round 40 m: 1.6 m/s2 to the right, which the bank takes up; the unit's x axis points to the right.
    imus = simulate_imus(scene)
    assert set(imus) == {"two"}
    table = {name: column for block in iterate_imu_blocks(scene, imus["two"]) for name, column in block.items()}
    assert len(table["gpst"]) == 600
    np.testing.assert_allclose(table["true_s"], -4.1e-4 + np.arange(1, 601) / 50.0, atol=1e-12)
    axes = ("x", "y", "z")
    force, rate = (
        np.stack([table[f"{kind}_{axis}_{unit}"] for axis in axes], axis=1)
        for kind, unit in (("accel", "m_s2"), ("gyro", "rad_s"))
    )
    np.testing.assert_allclose(np.linalg.norm(force, axis=1), np.hypot(9.80, 1.6), atol=0.02)
    lean_rad = np.arctan2(1.6, 9.80665)
    np.testing.assert_allclose(rate[:, 0], -0.2 * np.sin(lean_rad) * -1.0, atol=1e-3)
    np.testing.assert_allclose(rate[:, 1], 0.0, atol=1e-3)
    np.testing.assert_allclose(rate[:, 2], 0.2 * np.cos(lean_rad), atol=1e-3)


def test_false_minus_true_is_the_difference_of_their_rows(scene: Scene) -> None:
    table = compute_signal_truth(scene, "one", 10.0)
    true = {
        (sat, at_s): row
        for row, (sat, at_s, label) in enumerate(zip(table["sat"], table["true_s"], table["label"], strict=True))
        if label == "authentic"
    }
    false = np.flatnonzero(table["label"] == "spoofed")
    paired = [(row, true[key]) for row in false if (key := (table["sat"][row], table["true_s"][row])) in true]
    alone = set(false.tolist()) - {row for row, _ in paired}
    assert len(paired) > 50
    for row, row_true in paired:
        apart = {
            name: table[name][row] - table[name][row_true] for name in ("pseudorange_m", "carrier_cyc", "cn0_dbhz")
        }
        assert table["delay_to_authentic_m"][row] == pytest.approx(apart["pseudorange_m"], abs=1e-6)
        assert table["phase_to_authentic_cyc"][row] == pytest.approx(-apart["carrier_cyc"], abs=1e-5)
        assert 20.0 * np.log10(table["amplitude_to_authentic"][row]) == pytest.approx(apart["cn0_dbhz"], abs=1e-9)
        assert table["doppler_to_authentic_hz"][row] == table["doppler_hz"][row] - table["doppler_hz"][row_true]
    assert all(np.isnan(table["delay_to_authentic_m"][row]) for row in alone)


def test_a_name_that_is_not_there_is_reported(scene: Scene) -> None:
    with pytest.raises(KeyError, match=r"two\.l"):
        compute_signal_truth(scene, "two")
    with pytest.raises(KeyError, match="one, two"):
        compute_trajectory_truth(scene, "three")
