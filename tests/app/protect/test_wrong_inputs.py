"""Auxiliary inputs that are wrong, beside a clean sky: the input is named, and the sky is not called spoofed."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from tests.app import kit
from tests.app.kit import ENU_M, PLACES

from skyproof.app.protect import protect
from skyproof.errors import InputError
from skyproof.formats.rinex_nav import write_nav
from skyproof.formats.rinex_obs import write_obs
from skyproof.gnss.geoid import interpolate_geoid_m

BOW, STERN = PLACES[:2]
APART_M = float(np.linalg.norm(ENU_M["stern"]))


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Write half a minute of two receivers and their orbits."""
    folder = tmp_path_factory.mktemp("recorded")
    navigation, observations = kit.simulate_measurements(31.0)
    for o in observations:
        write_obs(
            folder / f"{o.receiver}.obs", o, signals=o.signals, holds="simulated", marker=o.receiver, version="test"
        )
    write_nav(folder / "nav.rnx", navigation)
    return folder, navigation


def place(receiver, **other):
    keys = {"lat_deg": receiver.lat_deg, "lon_deg": receiver.lon_deg, "height_m": receiver.height_m, "sigma_m": 0.05}
    return {**keys, **{key: float(value) for key, value in other.items()}}


def judge_files(folder: Path, tmp_path: Path, positions) -> object:
    receivers = [
        {"name": item.name, "inputs": [str(folder / f"{item.name}.obs")], "position": position}
        for item, position in zip((BOW, STERN), positions, strict=True)
    ]
    platform = tmp_path / "platform.toml"
    platform.write_text(tomli_w.dumps({"receivers": receivers}), encoding="utf-8")
    return protect(nav=folder / "nav.rnx", platform=platform).verdict


def test_positions_as_they_are_make_a_clean_sky_authentic(files, tmp_path):
    verdict = judge_files(files[0], tmp_path, [place(BOW), place(STERN)])
    assert verdict.verdict == "authentic"
    assert verdict.wrong_statements == ()


@pytest.mark.parametrize(
    ("wrong", "code"),
    [
        ({"height_m": STERN.height_m - interpolate_geoid_m(STERN.lat_deg, STERN.lon_deg)}, "height_above_sea_level"),
        ({"height_m": STERN.height_m / 0.3048}, "height_in_feet"),
        ({"height_m": STERN.height_m - 18.0}, "height"),
        ({"lat_deg": STERN.lat_deg - 0.0007}, "wrong_statement"),
    ],
    ids=["sea level", "feet", "ground", "any"],
)
def test_one_position_that_is_wrong_is_named(files, tmp_path, wrong, code):
    verdict = judge_files(files[0], tmp_path, [place(BOW), place(STERN, **wrong)])
    assert verdict.verdict == "suspect"
    assert {s.label for s in verdict.signals} <= {"unknown"}
    named = [item for item in verdict.wrong_statements if item.about in ("position of stern", "antennas_enu_m")]
    assert code in {item.code for item in named}


@pytest.mark.parametrize(
    ("factor", "code"), [(1.0 / 0.3048, "feet"), (2.0, "twice"), (100.0, "centimetres"), (1.4, "wrong_statement")]
)
def test_a_wrong_distance_is_named(files, factor, code):
    folder, _ = files
    paths = [folder / f"{item.name}.obs" for item in (BOW, STERN)]
    verdict = protect(paths, nav=folder / "nav.rnx", antenna_distance_m=factor * APART_M).verdict
    assert verdict.verdict == "suspect"
    assert code in {item.code for item in verdict.wrong_statements}


@pytest.mark.parametrize("hours", [-1, 1, 9])
def test_edited_dates_of_some_orbits_leave_those_out(files, tmp_path, hours):
    # The times of clock of every second satellite are moved, the times of ephemeris are not.
    folder, navigation = files
    moved = [
        replace(item, toc=item.toc + 3600.0 * hours) if number % 2 else item
        for number, item in enumerate(navigation.ephemerides)
    ]
    write_nav(tmp_path / "edited.rnx", replace(navigation, ephemerides=tuple(moved)))
    paths = [folder / f"{item.name}.obs" for item in (BOW, STERN)]
    verdict = protect(paths, nav=tmp_path / "edited.rnx", antenna_distance_m=APART_M).verdict
    assert verdict.verdict in ("authentic", "no_attack_seen")
    (nav,) = (item for item in verdict.inputs if item.path.endswith("edited.rnx"))
    assert any("clock" in words for words in nav.all_remarks)


@pytest.mark.parametrize("wrong", ["unhealthy", "no orbits"])
def test_satellites_whose_orbits_are_not_usable_are_named(files, tmp_path, wrong):
    folder, navigation = files
    out = sorted({e.sat for e in navigation.ephemerides})[::4]
    kept = [e for e in navigation.ephemerides if wrong == "unhealthy" or e.sat not in out]
    ill = [replace(e, health=63) if e.sat in out else e for e in kept]
    write_nav(tmp_path / "some.rnx", replace(navigation, ephemerides=tuple(ill)))
    paths = [folder / f"{item.name}.obs" for item in (BOW, STERN)]
    verdict = protect(paths, nav=tmp_path / "some.rnx", antenna_distance_m=APART_M).verdict
    (nav,) = (item for item in verdict.inputs if item.path.endswith("some.rnx"))
    (remark,) = (words for words in nav.all_remarks if wrong in words)
    assert set(re.findall(r"G\d\d", remark)) == set(out) & {s.sat for s in verdict.signals}


@pytest.mark.parametrize("who", [("bow",), ("bow", "stern")], ids=["one", "both"])
@pytest.mark.parametrize("late_s", [0.1, 0.4, -18.0])
def test_epoch_times_that_do_not_fit_the_ranges_are_corrected(files, tmp_path, late_s, who):
    # As in UTC, which is 18 s behind GPS time.
    _, observations = kit.simulate_measurements(31.0)
    paths = []
    for o in observations:
        late_ns = np.timedelta64(round(late_s * 1e9) if o.receiver in who else 0, "ns")
        paths.append(tmp_path / f"{o.receiver}.obs")
        later = replace(o, gpst=o.gpst + late_ns)
        write_obs(paths[-1], later, signals=o.signals, holds="simulated", marker=o.receiver, version="test")
    verdict = protect(paths, nav=files[0] / "nav.rnx", antenna_distance_m=APART_M).verdict
    assert verdict.verdict == "authentic"
    for item in verdict.inputs[:2]:
        remarks = [words for words in item.left_out if "ranges fit the orbits" in words]
        assert len(remarks) == (Path(item.path).stem in who)
        assert all(("UTC" in words) == (late_s == -18.0) for words in remarks)


def test_epochs_whose_times_stray_are_left_out(files, tmp_path):
    _, (bow, _) = kit.simulate_measurements(31.0)
    late_ns = np.zeros(bow.gpst.size, "m8[ns]")
    late_ns[[3, 4, 11, 20, 27]] = np.array([300, -200, 90, -380, 150]) * np.timedelta64(1_000_000, "ns")
    strays = replace(bow, gpst=bow.gpst + late_ns)
    write_obs(tmp_path / "bow.obs", strays, signals=bow.signals, holds="simulated", marker="bow", version="test")
    paths = [tmp_path / "bow.obs", files[0] / "stern.obs"]
    verdict = protect(paths, nav=files[0] / "nav.rnx", antenna_distance_m=APART_M).verdict
    assert verdict.verdict in ("authentic", "no_attack_seen")
    assert any(words.startswith("5 epochs ") for words in verdict.inputs[0].left_out)


@pytest.mark.shared_data
def test_a_height_above_sea_level_of_one_real_receiver_is_named(shared_data):
    case = next((shared_data / "cases").glob("14_*"), None)
    if case is None:
        pytest.skip("no such case")
    verdict = protect(platform=case / "p.toml", nav=case / "base.nav").verdict
    assert verdict.verdict == "suspect"
    assert verdict.wrong_statements[0].code == "height_above_sea_level"


@pytest.mark.shared_data
@pytest.mark.parametrize("name", ["hour0", "day_before"])
def test_edited_dates_of_a_real_file_end_the_run_with_the_reason(shared_data, name):
    case = next((shared_data / "cases").glob("01_*"), None)
    if case is None:
        pytest.skip("no such case")
    with pytest.raises(InputError, match=r"\bclock is\b"):
        protect([case / "b.obs"], nav=case / f"{name}.nav")
