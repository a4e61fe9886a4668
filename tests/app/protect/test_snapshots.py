"""Recordings of tens of milliseconds, too short to follow signals, through the whole of `protect`."""

import re

import numpy as np
import pytest
import tomli_w
from tests.app import kit

from skyproof.app.protect import protect
from skyproof.app.protect.pictures import build_pictures
from skyproof.errors import InputError, NotEnoughData
from skyproof.formats.recording import open_recording
from skyproof.simulator.scenario import FrontEnd

FRONT_END = FrontEnd(rate_hz=4_092_000, if_hz=1_023_000, kind="real", encoding="sign", bits=1, bandwidth_hz=2e6)


@pytest.fixture(scope="module")
def snapshots(made_once):
    """Record 64 ms of one sky by four antennas, one bit, real, with and without a transmitter 100 m off."""

    def fill(folder):
        shows, transmit = kit.ELSEWHERE.model_dump(), kit.TRANSMIT.model_dump()
        attack = {"kind": "spoofer", "shows": shows, "transmit": transmit, "power_db": 3.0, "clock_offset_s": 3e-6}
        for name, attacks in (("clean", ()), ("attacked", ({**attack, "onset_s": -1.0},))):
            scenario = kit.make_array_scenario(duration_s=0.064, seed=5, attacks=attacks)
            recorded = kit.record(scenario.model_copy(update={"front_end": FRONT_END}), folder / name)
            (folder / name / "broadcast.rnx").rename(folder / name / "nav.rnx")
            table = {"name": "array", "antennas_m": [list(place) for place in kit.ELEMENTS_M]}
            inputs = {"inputs": [path.name for path in recorded.paths]}
            (folder / name / "platform.toml").write_text(tomli_w.dumps({"receivers": [table | inputs]}))
            # The same in one file of NumPy.
            (first, *rest) = [open_recording(path)[0] for path in recorded.paths]
            planes = np.stack([item.read(0, first.n_samples)[0] for item in (first, *rest)]).astype(np.int8)
            np.save(folder / name / "whole.npy", planes)
            stated = f'rate_hz = 4092000.0\nif_hz = 1023000.0\nstart_gpst = "{first.start_gpst}"\n'
            (folder / name / "whole.toml").write_text(f"[samples]\n{stated}")
            (folder / name / "one.toml").write_text(tomli_w.dumps({"receivers": [table | {"inputs": ["whole.npy"]}]}))

    return made_once("snapshots", fill)


def list_labels(result):
    return {(s.sat, s.copy): s.label for s in result.verdict.signals}


def list_left_out(result):
    """List the antennas that a finding leaves out, each with its code."""
    found = [e for e in result.outcome.evidence if e.code.startswith("antennas_")]
    return {(e.code, name) for e in found for name in e.data["antennas"]}


def place_of(position):
    return np.hypot(
        (position.lat_deg - kit.PLACES[0].lat_deg) * 111e3,
        (position.lon_deg - kit.PLACES[0].lon_deg) * 111e3 * np.cos(np.radians(position.lat_deg)),
    )


@pytest.mark.long
def test_a_clean_sky_without_orbits_has_several_directions(snapshots, tmp_path):
    folder = snapshots / "clean"
    result = protect(platform=folder / "one.toml", out=tmp_path / "out")
    assert result.verdict.verdict == "authentic"
    labels = list_labels(result)
    assert len(labels) > 6
    assert set(labels.values()) == {"authentic"}
    assert result.verdict.receivers[0].trusted_fix is None
    assert any("no position" in remark for remark in result.verdict.inputs[0].all_remarks)


@pytest.mark.long
def test_one_transmitter_is_named_without_orbits(snapshots):
    result = protect(platform=snapshots / "attacked" / "one.toml")
    assert result.verdict.verdict == "spoofed"
    assert {copy for (_, copy), label in list_labels(result).items() if label == "spoofed"} == {"a"}  # the stronger


def test_one_transmitter_is_named_and_the_true_place_found(snapshots):
    folder = snapshots / "attacked"
    result = protect(platform=folder / "platform.toml", nav=folder / "nav.rnx")
    assert result.verdict.verdict == "spoofed"
    labels = list_labels(result)
    assert {label for (_, copy), label in labels.items() if copy == "a"} == {"spoofed"}
    assert {label for (_, copy), label in labels.items() if copy == "b"} == {"authentic"}
    fix = result.verdict.receivers[0].trusted_fix
    assert place_of(fix) < 4.0 * np.hypot(fix.sigma_east_m, fix.sigma_north_m)
    assert place_of(result.verdict.receivers[0].unprotected_fix) > 400.0


def test_one_antenna_gives_its_position_and_no_verdict(snapshots):
    folder = snapshots / "clean"
    result = protect([next(folder.glob("*.1.bin"))], nav=folder / "nav.rnx")
    assert result.verdict.verdict == "no_attack_seen"
    fix = result.verdict.receivers[0].unprotected_fix
    assert place_of(fix) < 4.0 * np.hypot(fix.sigma_east_m, fix.sigma_north_m)


FAILURES = {
    "dead": lambda plane, rng: np.zeros_like(plane),
    "constant": lambda plane, rng: np.ones_like(plane),
    "noise": lambda plane, rng: rng.choice([-1, 1], plane.size),
    "a phase that jumps": lambda plane, rng: np.where(np.arange(plane.size) < plane.size // 2, plane, -plane),
    "recorded at another time": lambda plane, rng: np.roll(plane, plane.size // 3),
}


@pytest.mark.long
@pytest.mark.parametrize("failed", FAILURES.values(), ids=FAILURES.keys())
def test_an_antenna_that_fails_is_left_out_and_reported(snapshots, tmp_path, failed):
    planes = np.load(snapshots / "clean" / "whole.npy")
    planes[2] = failed(planes[2], np.random.default_rng(1))
    np.save(tmp_path / "whole.npy", planes)
    for name in ("whole.toml", "one.toml"):
        (tmp_path / name).write_text((snapshots / "clean" / name).read_text())
    result = protect(platform=tmp_path / "one.toml", nav=snapshots / "clean" / "nav.rnx")
    assert result.verdict.verdict == "authentic"
    assert set(list_labels(result).values()) == {"authentic"}
    assert list_left_out(result) == {("antennas_silent", "3")}
    assert any("antenna 3 " in r for r in result.verdict.inputs[0].all_remarks)


def write_with_planes(snapshots, folder, planes):
    """Write a platform file of these samples, otherwise as the clean ones."""
    np.save(folder / "whole.npy", planes)
    for name in ("whole.toml", "one.toml"):
        (folder / name).write_text((snapshots / "clean" / name).read_text())
    return folder / "one.toml"


@pytest.mark.long
@pytest.mark.parametrize("with_orbits", [True, False])
@pytest.mark.parametrize("begun", [0.3, 0.6])
def test_an_attack_that_begins_within_is_not_passed_over(snapshots, tmp_path, begun, with_orbits):
    clean, attacked = (np.load(snapshots / name / "whole.npy") for name in ("clean", "attacked"))
    count = round(begun * clean.shape[1])
    platform = write_with_planes(snapshots, tmp_path, np.hstack([clean[:, :count], attacked[:, count:]]))
    result = protect(platform=platform, nav=snapshots / "clean" / "nav.rnx" if with_orbits else None)
    findings = [e for e in result.outcome.evidence if e.detector == "snapshot"]
    assert findings[0].code == "changes"
    assert result.verdict.verdict == "spoofed" if with_orbits else result.verdict.verdict != "authentic"


@pytest.mark.long
@pytest.mark.parametrize("late_ms", [3, -7])
def test_an_antenna_late_by_milliseconds_is_left_out(snapshots, tmp_path, late_ms):
    planes = np.load(snapshots / "attacked" / "whole.npy")
    planes[1] = np.roll(planes[1], -4092 * late_ms)
    result = protect(platform=write_with_planes(snapshots, tmp_path, planes), nav=snapshots / "clean" / "nav.rnx")
    remarks = " ".join(result.verdict.inputs[0].all_remarks)
    how, whose = ("after", "the other antennas") if late_ms > 0 else ("before", "antenna 2")
    assert re.search(rf"\bantenna 2 \w+ {abs(late_ms)} ms {how} ", remarks)
    assert re.search(rf" {4092 * abs(late_ms)} samples of {whose}", remarks)
    assert result.verdict.verdict == "spoofed"


@pytest.mark.long
def test_a_dead_file_among_antennas_is_left_out_and_reported(snapshots, tmp_path):
    folder = snapshots / "attacked"
    for path in [*folder.glob("array.?.bin"), *folder.glob("array.?.toml"), folder / "platform.toml"]:
        (tmp_path / path.name).write_bytes(path.read_bytes())
    dead = tmp_path / "array.1.bin"
    dead.write_bytes(bytes(dead.stat().st_size))
    result = protect(platform=tmp_path / "platform.toml", nav=folder / "nav.rnx", out=tmp_path / "out")
    assert result.verdict.verdict == "spoofed"
    labels = list_labels(result)
    assert {copy for (_, copy), label in labels.items() if label == "spoofed"} == {"a"}
    assert {copy for (_, copy), label in labels.items() if label == "authentic"} == {"b"}
    assert (tmp_path / "out" / "report.html").is_file()
    assert build_pictures(result.outcome).profiles  # of antenna 2
    assert list_left_out(result) == {("antennas_silent", "1")}
    remarks = [remark for note in result.verdict.inputs for remark in note.all_remarks]
    assert any("antenna 1: " in r for r in remarks)


def test_antennas_of_which_none_gives_anything_are_an_error(snapshots, tmp_path):
    np.save(tmp_path / "whole.npy", np.ones_like(np.load(snapshots / "clean" / "whole.npy")))
    for name in ("whole.toml", "one.toml"):
        (tmp_path / name).write_text((snapshots / "clean" / name).read_text())
    with pytest.raises(InputError, match=r"\b1 in each\b"):
        protect(platform=tmp_path / "one.toml")


@pytest.mark.long
@pytest.mark.parametrize(("heading_deg", "off_deg"), [(30.0, None), (50.0, 20), (210.0, 180)])
def test_an_attitude_that_is_wrong_is_reported_and_not_used(snapshots, tmp_path, heading_deg, off_deg):
    folder = snapshots / "clean"
    attitude = {"heading_deg": heading_deg, "pitch_deg": 2.0, "roll_deg": 0.0, "sigma_deg": 0.2}
    text = (folder / "one.toml").read_text().replace("whole.npy", str(folder / "whole.npy"))
    (tmp_path / "platform.toml").write_text(text + tomli_w.dumps({"attitude": attitude}))
    result = protect(platform=tmp_path / "platform.toml", nav=folder / "nav.rnx")
    assert result.verdict.verdict == "authentic"
    unused = [e.data["off_deg"] for e in result.outcome.evidence if e.code == "attitude_unused"]
    assert [round(off) for off in unused] == ([] if off_deg is None else [off_deg] * len(unused))
    assert bool(unused) == (off_deg is not None)


@pytest.mark.long
def test_an_attitude_of_another_day_is_reported_and_not_used(snapshots, tmp_path):
    folder = snapshots / "clean"
    (tmp_path / "attitude.csv").write_text(
        "gpst,heading_deg,pitch_deg,roll_deg\n2024-05-13T09:00:00,50,2,0\n2024-05-13T11:00:00,50,2,0\n"
    )
    text = (folder / "one.toml").read_text().replace("whole.npy", str(folder / "whole.npy"))
    attitude = {"attitude": {"file": "attitude.csv", "sigma_deg": 0.2}}
    (tmp_path / "platform.toml").write_text(text + tomli_w.dumps(attitude))
    result = protect(platform=tmp_path / "platform.toml", nav=folder / "nav.rnx")
    assert result.verdict.verdict == "authentic"
    assert set(list_labels(result).values()) == {"authentic"}
    remarks = [remark for note in result.verdict.inputs for remark in note.all_remarks]
    assert any("2024-05-13" in remark for remark in remarks)


def test_noise_alone_is_said(tmp_path):
    np.save(tmp_path / "noise.npy", np.random.default_rng(1).integers(-9, 10, (2, 200_000), dtype=np.int8))
    (tmp_path / "noise.toml").write_text("[samples]\nrate_hz = 4092000.0\nif_hz = 1023000.0\n")
    table = {"name": "array", "inputs": ["noise.npy"], "antennas_m": [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]]}
    (tmp_path / "platform.toml").write_text(tomli_w.dumps({"receivers": [table]}))
    with pytest.raises(NotEnoughData, match=r"\b0\.0489 s\b"):
        protect(platform=tmp_path / "platform.toml")
