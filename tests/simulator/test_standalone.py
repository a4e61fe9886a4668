"""A resolved scenario makes the same scene again, with the files that it names beside it."""

import gzip
import tomllib
from pathlib import Path

import numpy as np
import pytest
import tomli_w

from skyproof.errors import ScenarioError
from skyproof.formats.rinex_nav import write_nav
from skyproof.gnss.ephemeris import NavigationData
from skyproof.simulator.scenario import Scenario, parse_scenario, read_scenario
from skyproof.simulator.scenes import load_ready_made, read_ready_made
from skyproof.simulator.standalone import collect_standalone, override, resolve


def test_any_text_and_number_reads_back() -> None:
    description = 'one\ntwo \u2028\x85\x0c\x7f "ö\\'
    scenario = read_ready_made("clean")
    odd = Scenario.model_validate(resolve(scenario) | {"description": description, "seed": 2**53 + 1})
    assert read_back(odd) == odd


def read_back(scenario: Scenario) -> Scenario:
    return parse_scenario(tomllib.loads("\n".join(collect_standalone(scenario).lines("a remark"))))


@pytest.mark.parametrize("name", load_ready_made())
def test_every_ready_made_scene_reads_back_the_same(name: str) -> None:
    scenario = read_ready_made(name)
    assert read_back(scenario).model_dump() == scenario.model_dump()
    assert resolve(read_back(scenario)) == resolve(scenario)


def test_defaults_are_written_out(scenario: Scenario) -> None:
    table = resolve(scenario)
    assert table["mask_deg"] == 5.0
    assert table["front_end"]["rate_hz"] == 2.6e6
    assert table["receivers"][0]["antennas"][0]["gain"] == "isotropic"
    assert table["attacks"][0]["message"] == "true"
    assert "until_s" not in table["attacks"][0]


def test_what_moves_has_no_attitude_of_its_own(scenario: Scenario) -> None:
    moving = dict(resolve(scenario)["receivers"][0]) | {"path": {"kind": "circle", "radius_m": 30.0, "speed_m_s": 3.0}}
    for angle in ("heading_deg", "pitch_deg", "roll_deg"):
        del moving[angle]
    made = parse_scenario(resolve(scenario) | {"receivers": [moving]})
    assert "heading_deg" not in resolve(made)["receivers"][0]
    assert read_back(made).model_dump() == made.model_dump()


def test_files_that_are_named_lie_beside_it(scenario: Scenario, navigation: NavigationData, tmp_path: Path) -> None:
    source, target = tmp_path / "there", tmp_path / "here"
    source.mkdir()
    target.mkdir()
    write_nav(source / "plain.rnx", navigation)
    (source / "day.rnx.gz").write_bytes(gzip.compress((source / "plain.rnx").read_bytes()))
    (source / "walk.CSV").write_text("time_s,lat_deg,lon_deg,height_m\n0,40.0,-3.0,650\n10,40.0,-2.999,650\n")
    table = resolve(scenario)
    del table["receivers"][1]
    receiver = table["receivers"][0] | {"path": {"kind": "file", "path": "walk.CSV", "start_s": -1.0}}
    for angle in ("heading_deg", "pitch_deg", "roll_deg"):
        del receiver[angle]
    made = Scenario.model_validate(table | {"navigation": "day.rnx.gz", "receivers": [receiver]})
    (source / "s.toml").write_text(tomli_w.dumps(resolve(made)))

    read = read_scenario(source / "s.toml")
    assert read.navigation == source / "day.rnx.gz"
    assert read.receivers[0].path.path == source / "walk.CSV"
    alone = collect_standalone(read)
    assert alone.table["navigation"] == "broadcast.rnx"
    assert alone.table["receivers"][0]["path"]["path"] == "track-1.csv"
    assert set(alone.files) == {"broadcast.rnx", "track-1.csv"}
    assert alone.files["broadcast.rnx"] == (source / "plain.rnx").read_bytes()
    for name, octets in alone.files.items():
        (target / name).write_bytes(octets)
    (target / "scenario.toml").write_text("\n".join(alone.lines()))
    again = collect_standalone(read_scenario(target / "scenario.toml"))
    assert again.table == alone.table
    assert again.files == alone.files


def test_seed_and_duration_are_replaced_and_checked(scenario: Scenario) -> None:
    made = override(scenario, seed=11, duration_s=2.0)
    assert (made.seed, made.duration_s, made.start_gpst) == (11, 2.0, scenario.start_gpst)
    assert isinstance(made.start_gpst, np.datetime64)
    assert override(scenario) is scenario
    with pytest.raises(ScenarioError, match=r"onset_s 1\.5\b"):
        override(scenario, duration_s=1.0)
    with pytest.raises(ScenarioError, match="seed"):
        override(scenario, seed=-1)


def test_a_file_that_is_not_there_is_reported(scenario: Scenario) -> None:
    with pytest.raises(ScenarioError, match=r"navigation: nowhere\.rnx: .*exist"):
        collect_standalone(scenario.model_copy(update={"navigation": Path("nowhere.rnx")}))
