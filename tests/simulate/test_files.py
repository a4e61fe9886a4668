"""What is written can be opened, and holds what the samples in memory hold; the truth lies beside it."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

from skyproof.errors import OutputError
from skyproof.formats.raw import open_raw
from skyproof.gnss.ephemeris import NavigationData
from skyproof.simulate.document import truth_of
from skyproof.simulate.files import write
from skyproof.simulate.samples import samples_of
from skyproof.simulate.scenario import FrontEnd, Scenario
from skyproof.simulate.sky import scene_of


@pytest.mark.parametrize(
    "front_end",
    [
        FrontEnd(rate_hz=1e6),
        FrontEnd(rate_hz=1e6, encoding="sign-magnitude", bits=2),
        FrontEnd(rate_hz=1e6, encoding="int", bits=8),
        FrontEnd(rate_hz=1e6, encoding="int", bits=16),
        FrontEnd(rate_hz=1e6, encoding="float", bits=32),
        FrontEnd(rate_hz=2e6, kind="real", if_hz=4e5),
        FrontEnd(rate_hz=2e6, kind="real", if_hz=4e5, encoding="sign-magnitude", bits=2),
        FrontEnd(rate_hz=2e6, kind="real", if_hz=4e5, encoding="int", bits=8),
    ],
    ids=lambda front_end: f"{front_end.kind}-{front_end.encoding}-{front_end.bits}",
)
def test_files_hold_what_the_samples_in_memory_hold(
    scenario: Scenario, navigation: NavigationData, front_end: FrontEnd, tmp_path: Path
) -> None:
    scenario = scenario.model_copy(update={"front_end": front_end, "duration_s": 0.3, "attacks": ()})
    paths = write(scenario, navigation, tmp_path)
    assert [path.name for path in paths] == ["one.bin", "two.bin"]
    for path, samples in zip(paths, samples_of(scenario, navigation), strict=True):
        opened = open_raw(path)
        assert (opened.n_samples, opened.rate_hz, opened.if_hz) == (samples.n_samples, samples.rate_hz, samples.if_hz)
        assert opened.start_gpst == samples.start_gpst
        assert opened.n_samples == int(0.3 * front_end.rate_hz)
        assert opened.remarks == ()
        np.testing.assert_array_equal(opened.read(0, 400_000), samples.read(0, 400_000))


def test_the_same_seed_gives_the_same_bytes(scenario: Scenario, navigation: NavigationData, tmp_path: Path) -> None:
    first, second = (write(scenario, navigation, tmp_path / name)[0].read_bytes() for name in "ab")
    assert first == second
    other = write(scenario.model_copy(update={"seed": 8}), navigation, tmp_path / "c")[0].read_bytes()
    assert first != other


def test_the_sidecar_has_the_agreed_keys(scenario: Scenario, navigation: NavigationData, tmp_path: Path) -> None:
    write(scenario, navigation, tmp_path)
    sidecar = tomllib.loads((tmp_path / "one.toml").read_text())["samples"]
    assert sidecar.pop("start_gpst").startswith("2023-03-04T05:06:07")
    assert sidecar == {"rate_hz": 2.6e6, "centre_hz": 1575.42e6, "if_hz": 0.0, "kind": "complex", "encoding": "sign",
                       "bits": 1, "bit_order": "msb-first"}  # fmt: skip


def test_the_truth_says_what_is_false_and_what_it_shows(scenario: Scenario, navigation: NavigationData) -> None:
    truth = json.loads(json.dumps(truth_of(scene_of(scenario, navigation))))
    (attack,) = truth["attacks"]
    assert attack["onset_gpst"] == "2023-03-04T05:06:08.750000000"
    assert attack["captured_receiver_shows_position"] == {"lat_deg": 40.005, "lon_deg": -3.008, "height_m": 700.0}
    assert attack["captured_clock_extra_s"]["one"] == pytest.approx(3.7e-6 + 118.0 / 3e8, rel=0.01)
    one, _ = truth["receivers"]
    assert one["true_start_gpst"] == "2023-03-04T05:06:07.250012300"
    labels = {(row["sat"], row["copy"]): row["label"] for row in one["signals"]}
    assert {labels[sat, "b"] for sat in attack["sats"]} == {"spoofed"}
    false = [row for row in one["signals"] if row["label"] == "spoofed"]
    assert all(300.0 < row["delay_to_authentic_m_first_last"][0] < 2500.0 for row in false)
    assert all(row["from_gpst"].startswith("2023-03-04T05:06:08.7500") for row in false)


def test_progress_ends_with_all_samples(scenario: Scenario, navigation: NavigationData, tmp_path: Path) -> None:
    calls: list[tuple[int, int]] = []
    write(scenario, navigation, tmp_path, progress=lambda done, total: calls.append((done, total)))
    assert calls == sorted(calls)
    assert calls[-1] == (2 * 7_800_000, 2 * 7_800_000)


def test_a_folder_that_is_a_file_is_told(scenario: Scenario, navigation: NavigationData, tmp_path: Path) -> None:
    place = tmp_path / "taken"
    place.write_text("")
    with pytest.raises(OutputError, match="taken: cannot be written"):
        write(scenario, navigation, place)
