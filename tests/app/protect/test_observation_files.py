"""Observation files as inputs of `protect`: written by our own writer from simulated measurements, and read back."""

import gzip
import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.app import kit
from tests.app.kit import ENU_M, make_scenario
from tests.app.protect.captured import capture_receiver

from skyproof.app.protect import protect
from skyproof.detectors.continuity.series import Limits, build_series
from skyproof.errors import InputError
from skyproof.formats.rinex_nav import write_nav
from skyproof.formats.rinex_obs import write_obs
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.navigation.clock import anchor_label
from skyproof.navigation.fix import fix
from skyproof.records import CellStatus, FixStatus, Observations
from skyproof.simulator.measurements import NoiseModel, simulate_observations
from skyproof.simulator.nominal_systems import make_nominal_systems

SETTINGS = {"antennas_enu_m": {name: ENU_M[name] for name in ("bow", "stern")}}
MIDDLE = 30


@pytest.fixture(scope="module")
def measurements():
    """Simulate a minute of two receivers, an epoch a second."""
    navigation, (bow, stern) = kit.simulate_measurements(61.0)
    return bow, stern, navigation


def write_files(folder: Path, *observations: Observations) -> list[Path]:
    paths = []
    for o in observations:
        paths.append(folder / f"{o.receiver}.obs")
        write_obs(paths[-1], o, signals=o.signals, holds="simulated", marker=o.receiver, version="test")
    return paths


def test_a_clean_sky_is_authentic_in_observation_files(measurements, tmp_path):
    bow, stern, navigation = measurements
    write_nav(tmp_path / "nav.rnx", navigation)
    result = protect(write_files(tmp_path, bow, stern), nav=tmp_path / "nav.rnx", out=tmp_path / "out", **SETTINGS)
    assert result.verdict.verdict == "authentic", result.verdict.summary
    assert {s.label for s in result.verdict.signals} == {"authentic"}
    assert [i.format for i in result.verdict.inputs] == ["RINEX 3.05 observations"] * 2 + ["RINEX navigation"]
    assert all(i.sha256 is not None for i in result.verdict.inputs)
    assert any("no samples" in remark for remark in result.verdict.inputs[0].all_remarks)
    for name in ("verdict.json", "report.html", "fixes.csv", "tracks.kml", "bow-authentic.obs", "stern-trusted.nmea"):
        assert (tmp_path / "out" / name).stat().st_size > 0


@pytest.mark.parametrize("row", [31, 39])
def test_a_jump_of_a_receiver_that_stands_is_dated_to_its_epoch(measurements, tmp_path, row):
    # All ranges jump to a place 1 km off, and the carriers slip there.
    bow, _, navigation = measurements
    place_ecef_m = np.nanmedian(fix(bow, navigation).position_ecef_m, axis=0)
    unit = build_series(bow, navigation, place_ecef_m, Limits()).unit
    away_m = -(unit[row:] @ np.array([0.0, 600.0, 800.0]))
    jumped = {"pseudorange_m": np.vstack([bow.pseudorange_m[:row], bow.pseudorange_m[row:] + away_m])}
    slipped = bow.status.copy()
    slipped[row] = CellStatus.SLIP
    write_nav(tmp_path / "nav.rnx", navigation)
    (tmp_path / "platform.toml").write_text('motion = "static"\n')
    (path,) = write_files(tmp_path, replace(bow, status=slipped, **jumped))
    verdict = protect([path], nav=tmp_path / "nav.rnx", platform=tmp_path / "platform.toml").verdict
    assert verdict.verdict == "spoofed"
    assert np.datetime64(verdict.since_gpst) == bow.gpst[row]


def shorten(path: Path, how: str) -> Path:
    """Cut the file within a line or within its gzip stream, or behind a whole stretch if `how` says so."""
    content = path.read_bytes()
    if how == "gzip":
        packed = gzip.compress(content)
        path.with_suffix(".obs.gz").write_bytes(packed[: round(0.9 * len(packed))])
        return path.with_suffix(".obs.gz")
    path.write_bytes(content[: content.index(b"\n", round(0.9 * len(content))) - 7])
    return path


@pytest.mark.parametrize("how", ["line", "gzip", "behind"])
def test_what_comes_after_a_cut_keeps_a_clean_sky_from_authentic(measurements, tmp_path, how):
    bow, stern, navigation = measurements
    write_nav(tmp_path / "nav.rnx", navigation)
    whole, cut = write_files(tmp_path, bow, stern)
    paths = [whole, shorten(cut, how)]
    duration_s = 45.0 if how == "behind" else None
    verdict = protect(paths, nav=tmp_path / "nav.rnx", duration_s=duration_s, **SETTINGS).verdict
    assert verdict.verdict == ("authentic" if how == "behind" else "no_attack_seen")
    assert [bool(item.cut) for item in verdict.inputs] == [False, how != "behind", False]
    if how != "behind":
        assert verdict.reason == f"{paths[1]}: {verdict.inputs[1].cut[0]}"
        assert dict(verdict.explained)["Cut:"].startswith(verdict.reason)


@pytest.mark.parametrize(
    ("interval_s", "duration_s", "window_s"),
    [pytest.param(0.05, 12.0, 10.0, marks=pytest.mark.long), (30.0, 631.0, 150.0)],
)
def test_any_interval_and_clock_step_and_missing_column_works(tmp_path, interval_s, duration_s, window_s):
    # One receiver sets its clock by a millisecond in the middle, and reports neither Doppler nor C/N0.
    scenario = make_scenario(duration_s=duration_s)
    navigation = make_nominal_constellation(scenario.start_gpst)
    rng = np.random.default_rng(7)
    (bow, stern), _ = simulate_observations(
        scenario, navigation, rng=rng, interval_s=interval_s, noise=NoiseModel(sigma_m=0.5, constant_m=0.3)
    )
    nothing = np.full_like(stern.doppler_hz, np.nan)
    stern = anchor_label(stern, 1e-3 * (np.arange(stern.gpst.size) > stern.gpst.size // 2))
    stern = replace(stern, doppler_hz=nothing, cn0_dbhz=nothing)
    write_nav(tmp_path / "nav.rnx", navigation)
    result = protect(write_files(tmp_path, bow, stern), nav=tmp_path / "nav.rnx", **SETTINGS)
    assert result.verdict.verdict == "authentic", result.verdict.summary
    assert result.verdict.settings["window_s"] == pytest.approx(window_s)
    remarks = " ".join(result.verdict.inputs[1].all_remarks)
    assert "milliseconds" in remarks
    assert "Dopplers of 100%" in remarks
    assert "C/N0" in remarks
    assert {s.cn0_dbhz for s in result.verdict.signals if s.receiver == "stern"} == {None}
    for r in result.outcome.receivers:
        assert r.trusted is not None
        assert (r.trusted.status == FixStatus.OK).all()


def test_a_captured_receiver_is_spoofed_since_then(measurements, tmp_path):
    bow, stern, navigation = measurements
    write_nav(tmp_path / "nav.rnx", navigation)
    stern = capture_receiver(stern, bow, MIDDLE, rng=np.random.default_rng(4))
    result = protect(write_files(tmp_path, bow, stern), nav=tmp_path / "nav.rnx", **SETTINGS)
    verdict = result.verdict
    assert verdict.verdict == "spoofed", verdict.summary
    latest = np.datetime64(verdict.since_latest_gpst, "ns")
    assert abs((latest - bow.gpst[MIDDLE]) / np.timedelta64(1, "s")) <= 10.0
    false = {(s.receiver, s.sat) for s in verdict.signals if s.label == "spoofed"}
    assert {sat for receiver, sat in false if receiver == "stern"} == {s.sat for s in stern.signals}
    for s in verdict.signals:
        if s.label == "authentic":
            assert np.datetime64(s.to_gpst, "ns") <= bow.gpst[MIDDLE]


def test_a_stretch_of_a_file_is_protected(measurements, tmp_path):
    bow, stern, navigation = measurements
    write_nav(tmp_path / "nav.rnx", navigation)
    paths = write_files(tmp_path, bow, stern)
    verdict = protect(paths, nav=tmp_path / "nav.rnx", start_s=20.0, duration_s=20.0, **SETTINGS).verdict
    assert verdict.verdict == "authentic"
    assert [round(r.duration_s) for r in verdict.receivers] == [19, 19]
    assert np.datetime64(verdict.receivers[0].start_gpst, "ns") == bow.gpst[0] + np.timedelta64(20, "s")
    with pytest.raises(InputError, match=r"bow\.obs: .*\b59\.000 s\b.*\bstart_s is 99\b"):
        protect(paths, nav=tmp_path / "nav.rnx", start_s=99.0)


def test_observation_files_alone_need_orbits(measurements, tmp_path):
    with pytest.raises(InputError, match=r"bow\.obs: .*\borbits\b"):
        protect(write_files(tmp_path, *measurements[:2]))


def test_orbits_of_another_day_are_refused_for_observations(measurements, tmp_path):
    write_nav(tmp_path / "late.rnx", make_nominal_constellation(np.datetime64("2031-03-03", "ns")))
    with pytest.raises(InputError, match=r"late\.rnx: .*\b2031\b.*\bday$"):
        protect(write_files(tmp_path, *measurements[:2]), nav=tmp_path / "late.rnx")


def test_orbits_of_another_system_are_refused(measurements, tmp_path):
    galileo = make_nominal_systems(measurements[0].gpst[0], "E")
    write_nav(tmp_path / "other.rnx", galileo)
    with pytest.raises(InputError, match=r"other\.rnx: .*Galileo.*GPS"):
        protect(write_files(tmp_path, *measurements[:2]), nav=tmp_path / "other.rnx")


def test_orbits_left_out_are_named_where_none_is_left(measurements, tmp_path):
    # Dates edited by nine hours, times of ephemeris not.
    navigation = measurements[2]
    wrong = tuple(replace(e, toc=(e.toc - 32400.0) % 604800.0) for e in navigation.ephemerides)
    write_nav(tmp_path / "edited.rnx", replace(navigation, ephemerides=wrong))
    with pytest.raises(InputError, match=r"edited\.rnx: .* -9\.00 h"):
        protect(write_files(tmp_path, *measurements[:2]), nav=tmp_path / "edited.rnx")


def test_one_receivers_file_is_refused_twice(measurements, tmp_path):
    bow, _, _ = measurements
    path, *_ = write_files(tmp_path, bow)
    thinned = tmp_path / "again.obs"
    half = replace(bow, receiver="again", pseudorange_m=np.where(np.arange(60)[:, None] % 2, bow.pseudorange_m, np.nan))
    write_obs(thinned, half, signals=half.signals, holds="simulated", marker="again", version="test")
    with pytest.raises(InputError, match=r"again\.obs: .*bow\.obs"):
        protect([path, thinned])


def test_a_navigation_file_in_the_place_of_an_input_is_named(measurements, tmp_path):
    write_nav(tmp_path / "nav.rnx", measurements[2])
    with pytest.raises(InputError, match=r"nav\.rnx.*RINEX navigation.*--nav"):
        protect([*write_files(tmp_path, measurements[0]), tmp_path / "nav.rnx"])


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (lambda lines: lines[:3], r"bow\.obs, line 3: .*END OF HEADER"),
        (lambda lines: [line.replace("G    4 C1C", "I    4 C5A") for line in lines], r"bow\.obs.*\bno measurement\b"),
        (
            lambda lines: [*lines[:1], *(x for x in lines[1:] if "OBS TYPES" not in x)],
            r"bow\.obs.*\bobservation types\b",
        ),
    ],
)
def test_a_file_without_observations_is_refused(measurements, tmp_path, content, words):
    path, *_ = write_files(tmp_path, measurements[0])
    path.write_text("\n".join([*content(path.read_text().splitlines()), ""]))
    with pytest.raises(InputError, match=words):
        protect([path])


def test_packed_files_are_read_and_named_without_their_packing(measurements, tmp_path):
    bow, stern, navigation = measurements
    write_nav(tmp_path / "nav.rnx", navigation)
    paths = write_files(tmp_path, bow, stern)
    packed = tmp_path / "bow.obs.gz"
    packed.write_bytes(gzip.compress(paths[0].read_bytes()))
    verdict = protect([packed, paths[1]], nav=tmp_path / "nav.rnx", duration_s=20.0, **SETTINGS).verdict
    assert [r.name for r in verdict.receivers] == ["bow", "stern"]
    assert verdict.verdict == "authentic"
    assert verdict.inputs[0].sha256 == hashlib.sha256(packed.read_bytes()).hexdigest()
