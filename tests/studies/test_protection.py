"""The protection matrix: what equipment makes of a scene, and how a run's answer is held against the truth."""

import json
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from skyproof.batch import Store
from skyproof.fusion.labels import LabelledSignal
from skyproof.records import SignalRef
from skyproof.simulator.constellation import make_navigation
from skyproof.simulator.measurements import simulate_observations
from skyproof.simulator.scenario import parse_scenario
from skyproof.simulator.scenes import load_ready_made, read_ready_made
from skyproof.simulator.sky import make_scene
from skyproof.studies.base import StudySettings
from skyproof.studies.protection import cell, clean, items, matrix
from skyproof.studies.protection.cell import LONGEST_S, cut_scene, make_rows
from skyproof.studies.protection.equipment import APART_M, EQUIPMENT, equip
from skyproof.studies.protection.errors import STANFORD, FixErrors, fix_errors, protection_columns, stanford_rows
from skyproof.studies.protection.score import false_labels, onset_s, true_labels


@pytest.mark.parametrize("name", load_ready_made())
def test_a_stretch_is_a_writable_scene_with_the_onset(name):
    made = cut_scene(read_ready_made(name))
    assert made.duration_s <= LONGEST_S
    again = parse_scenario(made.model_dump(exclude_none=True))
    assert again.duration_s == made.duration_s
    start_s = made.receivers[0].start_offset_s
    for attack in made.attacks:
        points = (*attack.away_points_enu_m, *attack.clock_points_s) if attack.kind == "takeover" else ()
        begins_s = min((point[0] for point in points), default=attack.onset_s)
        assert begins_s < start_s + made.duration_s - 35.0


@pytest.mark.parametrize("equipment", EQUIPMENT)
def test_every_equipment_stands_at_the_first_receiver(equipment):
    scenario = read_ready_made("takeover").model_copy(update={"duration_s": 16.0})
    found = equip(scenario, equipment)
    assert found is not None
    scene = make_scene(found.scenario, make_navigation(found.scenario))
    places = [sky.point(np.zeros(1)).position_ecef_m[0] for sky in scene.skies]
    of = [sky.receiver.name for sky in scene.skies]
    assert (
        np.linalg.norm(places[0] - make_scene(scenario, scene.navigation).skies[0].point(np.zeros(1)).position_ecef_m)
        < 1
    )
    if len(found.scenario.receivers) > 1:
        second = places[of.index(found.scenario.receivers[1].name)]
        assert np.linalg.norm(second - places[0]) == pytest.approx(APART_M, abs=0.1)
    assert [table["name"] for table in found.stated["receivers"]] == [r.name for r in found.scenario.receivers]


def test_moving_scenes_do_not_state_that_they_stand():
    assert equip(read_ready_made("texbat-like-5"), "standing") is None
    assert equip(read_ready_made("las-vegas"), "second receiver at 20 m") is None
    assert equip(read_ready_made("las-vegas"), "everything") is not None


@pytest.fixture(scope="module")
def measurements():
    scenario = read_ready_made("starts-spoofed").model_copy(update={"duration_s": 20.0})
    scene = make_scene(scenario, make_navigation(scenario))
    observed, labels = simulate_observations(scenario, scene.navigation, rng=np.random.default_rng(1))
    return scene, observed, labels


def test_the_truth_of_labels_is_that_of_the_simulator(measurements):
    scene, observed, labels = measurements
    for o, sky in zip(observed, scene.skies, strict=True):
        found = true_labels(o, sky, scene)
        for column, signal in enumerate(o.signals):
            assert set(found[:, column]) == {labels[SignalRef(o.receiver, signal)]}


def test_a_label_that_is_false_for_a_second_is_reported(measurements):
    scene, observed, labels = measurements
    o = observed[0]
    receiver = SimpleNamespace(reception=SimpleNamespace(source=SimpleNamespace(name=o.receiver), observations=o))
    right = [
        LabelledSignal(ref=ref, label=labels[ref], first_epoch=0, last_epoch=9, because=())
        for ref in (SignalRef(o.receiver, signal) for signal in o.signals)
    ]
    label = right[3]
    swapped = replace(label, label="authentic" if label.label == "spoofed" else "spoofed")
    for given, faults in ((right, 0), ([*right[:3], swapped], 1), ([replace(swapped, label="unknown")], 0)):
        outcome = SimpleNamespace(receivers=[receiver], decision=SimpleNamespace(labels=given))
        assert len(list(false_labels(scene, outcome))) == faults


def test_an_earlier_attack_begins_with_the_first_sample(measurements):
    scene, _, _ = measurements
    assert onset_s(scene) == pytest.approx(min(sky.receiver.start_offset_s for sky in scene.skies))


def test_errors_are_in_space_and_bounds_level(measurements):
    scene, _, _ = measurements
    sky = scene.skies[0]
    at = sky.point(np.array([5.0]))
    up = at.position_ecef_m[0] / np.linalg.norm(at.position_ecef_m[0])
    fix = SimpleNamespace(
        status=np.zeros(1, np.uint8),
        gpst=scene.scenario.start_gpst + np.array([5_000_000_000]).astype("timedelta64[ns]"),
        position_ecef_m=at.position_ecef_m + 30.0 * up,
        covariance_m2=np.eye(4)[None],
        protection_m=np.array([[5.0, 20.0]]),
        hidden_m=np.array([4.0]),
    )
    found = fix_errors(scene, sky, fix)
    assert found.space_m[0] == pytest.approx(30.0, abs=0.01)
    assert found.horizontal_m[0] < 0.1 * found.bound_m[0]
    columns = protection_columns([found])
    assert (columns["beyond_protection"], columns["beyond_vertical_protection"]) == (0, 1)


def test_the_diagram_holds_every_fix_with_a_level():
    off_enu_m = np.array([[3.0, 4.0, 1.0], [0.0, 0.0, -8.0], [50.0, 0.0, 0.0], [0.3, 0.4, 0.0]])
    levels_m = np.array([[4.9, 7.0], [5.1, 7.9], [np.nan, np.nan], [5.1, 7.0]])
    found = FixErrors(off_enu_m=off_enu_m, sigma_enu_m=np.ones((4, 3)), protection_m=levels_m, hidden_m=np.zeros(4))
    assert protection_columns([found]) == {
        "protection_share": 0.75,
        "protection_p50_m": 5.1,
        "vertical_protection_p50_m": 7.0,
        "beyond_protection": 1,
        "beyond_vertical_protection": 1,
    }
    rows = stanford_rows([found, found])
    for axis in ("horizontal", "vertical"):
        assert sum(row["fixes"] for row in rows if row["axis"] == axis) == 6
    (worst,) = (row for row in rows if row["axis"] == "vertical" and row["error_m"] > 2.0)
    assert worst["protection_m"] == pytest.approx(7.9, rel=0.06)
    assert worst["error_m"] == pytest.approx(8.0, rel=0.06)
    assert protection_columns([])["protection_share"] is None
    assert stanford_rows([]) == []


def test_cells_that_a_folder_has_are_not_made_again(tmp_path, monkeypatch):
    settings = StudySettings(quick=True, folder=tmp_path)
    (asked,) = matrix.cells(settings)
    with Store(tmp_path / matrix.NAME) as store, store.filling(asked.item) as folder:
        (folder / items.ROWS).write_text(json.dumps([{"scene": "takeover", "verdict": "spoofed"}]))
    monkeypatch.setattr(items, "Processes", lambda count: nullcontext(Nobody()))
    assert [row["verdict"] for row in matrix.rows(settings)] == ["spoofed"]
    with pytest.raises(AssertionError):
        list(matrix.rows(replace(settings, seed=2)))


def test_the_diagram_counts_all_cells_the_matrix_does_not(tmp_path, monkeypatch):
    bins = [
        {"axis": "horizontal", "protection_m": 12.0, "error_m": 1.5, "fixes": 7},
        {"axis": "vertical", "protection_m": 20.0, "error_m": 2.0, "fixes": 7},
    ]
    settings = StudySettings(trials=2, folder=tmp_path)
    with Store(tmp_path / matrix.NAME) as store:
        for asked in matrix.cells(settings):
            with store.filling(asked.item) as folder:
                (folder / items.ROWS).write_text(json.dumps([{"scene": asked.scenario.name, STANFORD: bins}]))
    monkeypatch.setattr(items, "Processes", lambda count: nullcontext(Nobody()))
    assert list(matrix.rows(settings)) == [{"scene": next(iter(load_ready_made()))}] * 2
    found = list(matrix.stanford(settings))
    assert found == [{**bin_found, "fixes": 14, "fixes_from": 10} for bin_found in bins]


class Nobody:
    """Does nothing, and is not to be asked."""

    @property
    def free(self):
        raise AssertionError


def test_every_scene_has_every_equipment_that_it_can():
    every = [(asked.scenario.name, name) for asked in matrix.cells(StudySettings()) for name in asked.equipments]
    assert len(every) == len(set(every))
    assert {scene for scene, _ in every} == set(load_ready_made())
    left_out = {(scene, name) for scene in load_ready_made() for name in EQUIPMENT} - set(every)
    assert ("texbat-like-5", "standing") in left_out
    assert {name for _, name in left_out} == {"standing", "second receiver at 20 m"}


def make_quick_scenario():
    (asked,) = matrix.cells(StudySettings(quick=True))
    return asked.scenario


@pytest.mark.long
def test_the_first_antenna_of_an_array_receives_as_a_single(tmp_path):
    one, three = make_rows(make_quick_scenario(), ("one receiver", "three antennas"), tmp_path)
    assert (one["equipment"], three["equipment"]) == ("one receiver", "three antennas")
    assert len(list(tmp_path.glob("*.bin"))) == 3
    assert one["wrong_fixes"] == three["wrong_fixes"] == 0
    alone = tmp_path / "alone"
    alone.mkdir()
    (again,) = make_rows(make_quick_scenario(), ("one receiver",), alone)
    assert {**again, "seconds": 0.0} == {**one, "seconds": 0.0}


def test_equipment_with_an_extra_antenna_needs_own_samples(tmp_path, monkeypatch):
    monkeypatch.setattr(cell, "write_samples", lambda scene, folder, container: [folder] * len(scene.skies))
    with pytest.raises(ValueError, match=r"at 20 m: .*\bantenna\b"):
        make_rows(make_quick_scenario(), ("second receiver at 20 m", "three antennas"), tmp_path)


@pytest.mark.long
def test_a_cell_goes_through_samples(tmp_path):
    (row,) = matrix.rows(StudySettings(quick=True, folder=tmp_path))
    assert row["verdict"] == "no_attack_seen"  # one antenna that stands: nothing can vouch for its signals
    assert not row["no_sign"]
    assert row["wrong_fixes"] == row["wrong_labels"] == 0
    assert list(tmp_path.rglob(items.ROWS))


def test_a_clean_sky_is_drawn_by_seed_and_has_no_attack():
    skies = [clean.clean_sky(seed, number) for seed in (1, 2) for number in range(20)]
    assert len({sky.model_dump_json() for sky in skies}) == len(skies)
    assert clean.clean_sky(2, 19) == skies[-1]
    for sky in skies:
        assert not sky.attacks
        assert parse_scenario(sky.model_dump(exclude_none=True)) == sky
    moving = [sky.receivers[0].path is not None for sky in skies]
    assert 8 <= sum(moving) <= 32
    hours = sum(len(cell.equipments) * cell.scenario.duration_s for cell in clean.cells(StudySettings())) / 3600.0
    assert hours >= 20.0


def test_clean_hours_add_up_and_false_alarms_bound_their_rate(tmp_path, monkeypatch):
    settings = StudySettings(trials=1, folder=tmp_path)
    row = {
        "verdict": "no_attack_seen",
        "duration_s": 360.0,
        "trusted_worst_m": None,
        "trusted_share": 0.5,
        **dict.fromkeys(clean.SUMS, 0),
    }
    with Store(tmp_path / clean.NAME) as store:
        for asked in clean.cells(settings):
            with store.filling(asked.item) as folder:
                made = [{**row, "equipment": name} for name in asked.equipments]
                made[0] |= {"false_alarms": 1, "verdict": "spoofed", "trusted_worst_m": 3.0}
                (folder / items.ROWS).write_text(json.dumps(made))
    monkeypatch.setattr(items, "Processes", lambda count: nullcontext(Nobody()))
    found = {item["equipment"]: item for item in clean.rows(settings)}
    assert list(found) == [name for name in EQUIPMENT if name in found] + ["all"]
    first, whole = found["one receiver"], found["all"]
    assert (first["hours"], first["spoofed"], first["false_alarms"]) == (0.1, 1, 1)
    assert first["at_most_an_hour"] == pytest.approx(47.4, abs=0.1)  # 4.74 expected give one or none in 1 of 20
    assert found["with IMU"]["at_most_an_hour"] == pytest.approx(30.0, abs=0.1)  # and 3.00 none
    assert whole["runs"] == sum(item["runs"] for item in found.values()) - whole["runs"]
    assert (whole["spoofed"], whole["trusted_worst_m"], whole["trusted_share"]) == (2, 3.0, 0.5)


@pytest.mark.long
@pytest.mark.parametrize("equipments", [("one receiver",), ("three antennas",)])
def test_reflections_far_larger_than_stated_are_no_attack(equipments, tmp_path):
    # Four reflections of up to 190 m of a receiver that drives in a circle: its position jumps by 50 m and back.
    (row,) = make_rows(clean.clean_sky(1, 47), equipments, tmp_path)
    assert row["verdict"] == "suspect"
    assert (row["false_alarms"], row["wrong_labels"], row["wrong_fixes"]) == (0, 0, 0)
