"""`skyproof inspect`: real recordings give what is known of them, simulated ones what was put in."""

import json
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from tests.recordings import COMPLEX_4, CTTC, REAL_12, REAL_24

from skyproof import cli
from skyproof.app.inspect.advice import advise
from skyproof.app.inspect.guess import guess
from skyproof.app.inspect.inspection import Inspection, write_document_json
from skyproof.app.inspect.run import inspect
from skyproof.app.inspect.signal_pictures import write_pictures
from skyproof.app.inspect.signals import _search_readings, inspect_samples
from skyproof.errors import InputError, NotEnoughData, OutputError, SettingsError
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.records import SampleGap, Samples
from skyproof.simulator import scenes
from skyproof.simulator.attacks import Interference
from skyproof.simulator.samples import render_samples
from skyproof.simulator.scenario import FrontEnd, ScenePlace
from skyproof.simulator.sky import make_scene

INT8 = 'encoding = "int"\nbits = 8\n'
START = np.datetime64("2024-03-03T11:59:58", "ns")


def inspect_json(path: Path, sidecar: str, folder: Path) -> dict:
    beside = folder / "how.toml"
    beside.write_text("[samples]\n" + sidecar, encoding="utf-8")
    return json.loads(write_document_json(inspect(path, sidecar=beside)))


def list_satellites(document: dict) -> set[int]:
    assert all(item["peaks"] == 1 for item in document["satellites"])
    return {int(item["sat"][1:]) for item in document["satellites"]}


def assert_agrees(document: dict, table: dict[int, tuple[float, float]], *, doppler_hz: float) -> None:
    """Check Dopplers and code phases against those that the README of the recordings lists."""
    for item in document["satellites"]:
        if (listed := table.get(int(item["sat"][1:]))) is not None:
            assert item["doppler_hz"] == pytest.approx(listed[0], abs=doppler_hz)
            assert (item["code_phase_chips"] - listed[1] + 511.5) % 1023 - 511.5 == pytest.approx(0.0, abs=1.0)


def is_gap(gap: dict, at_sample: int, missing: int) -> bool:
    """Place to 2000 samples and size to a few, as the README gives them, beside our own sigma."""
    return (
        abs(gap["at_sample"] - at_sample) < 2000 + 4.0 * gap["at_sigma_samples"]
        and abs(gap["missing_samples_modulo_period"] - missing) < 1.0 + 3.0 * gap["missing_sigma_samples"]
    )


@pytest.mark.shared_data
def test_12_mhz_real_samples_lose_some_once(shared_data: Path, tmp_path: Path) -> None:
    path = shared_data / "real" / "iq-pocketsdr" / "L1_20211125_004000_12MHz_I.bin"
    document = inspect_json(path, INT8 + 'rate_hz = 12e6\nif_hz = 3e6\nkind = "real"\n', tmp_path)
    found = list_satellites(document)
    assert found <= set(REAL_12)
    assert set(REAL_12) - found <= {24, 28}
    assert len(found) >= len(REAL_12) - 1
    assert_agrees(document, REAL_12, doppler_hz=50.0)
    (gap,) = document["gaps"]
    assert is_gap(gap, 1_048_576, 965)
    assert document["conjugate"] is False
    lines_hz = [line["frequency_hz"] for line in document["lines"]]
    assert any(abs(line - 0.42e6) < 5e3 for line in lines_hz)
    assert any(abs(line - 5.58e6) < 5e3 for line in lines_hz)
    assert abs(document["oscillator_error_hz"] - 285.0) < 3.0 * document["oscillator_error_sigma_hz"]


@pytest.mark.long
@pytest.mark.shared_data
def test_24_mhz_real_samples_lose_some_twice(shared_data: Path, tmp_path: Path) -> None:
    path = shared_data / "real" / "iq-pocketsdr" / "L1_20211201_054600_24MHz_I.bin"
    document = inspect_json(path, INT8 + 'rate_hz = 24e6\nif_hz = 6e6\nkind = "real"\n', tmp_path)
    found = list_satellites(document)
    assert found <= set(REAL_24)
    assert set(REAL_24) - found in (set(), {23}, {24}, {29})
    assert_agrees(document, REAL_24, doppler_hz=50.0)
    first, second = document["gaps"]
    assert is_gap(first, 1 << 20, 3434)
    assert is_gap(second, 1 << 21, 5877)
    assert document["conjugate"] is False


@pytest.mark.shared_data
@pytest.mark.parametrize("conjugate", [False, pytest.param(True, marks=pytest.mark.long)])
def test_4_mhz_complex_samples_are_mirrored(shared_data: Path, tmp_path: Path, conjugate: bool) -> None:
    path = shared_data / "real" / "iq-pocketsdr" / "L1_20211202_084700_4MHz_IQ.bin"
    sidecar = INT8 + 'rate_hz = 4e6\nkind = "complex"\n' + ("conjugate = true\n" if conjugate else "")
    document = inspect_json(path, sidecar, tmp_path)
    assert document["conjugate"] is not conjugate
    assert document["conjugate_error_probability"] < 1e-6
    assert ("mirrored" in document["summary"]) is not conjugate
    found = list_satellites(document)
    assert found - {3} <= set(COMPLEX_4)  # the README holds 3 for very likely present
    assert set(COMPLEX_4) - found in (set(), {4}, {25})
    assert_agrees(document, COMPLEX_4, doppler_hz=50.0)
    assert document["gaps"] == []
    assert abs(document["oscillator_error_hz"] - 285.0) < 3.0 * document["oscillator_error_sigma_hz"]
    assert abs(document["clock_minus_lo_ppm"]) < 4.0 * document["clock_minus_lo_sigma_ppm"]


@pytest.mark.shared_data
def test_on_another_carrier_there_is_nothing(shared_data: Path, tmp_path: Path) -> None:
    path = shared_data / "real" / "iq-pocketsdr" / "L2_20211202_084700_4MHz_IQ_first100ms.bin"
    as_l1 = inspect_json(path, INT8 + 'rate_hz = 4e6\nkind = "complex"\n', tmp_path)
    assert as_l1["satellites"] == []
    assert "no GPS L1 C/A signal" in as_l1["summary"]
    assert as_l1["conjugate"] is None
    as_l2 = inspect_json(path, INT8 + 'rate_hz = 4e6\nkind = "complex"\ncentre_hz = 1227.6e6\n', tmp_path)
    assert as_l2["satellites"] == []
    assert any("1227.600 MHz" in remark for remark in as_l2["remarks"])


@pytest.mark.shared_data
def test_an_oscillator_6_ppm_off_is_reported(shared_data: Path, tmp_path: Path) -> None:
    path = shared_data / "real" / "iq-cttc" / "GSoC_CTTC_capture_2012_07_26_4Msps_4ms.dat"
    document = inspect_json(path, 'encoding = "float"\nbits = 32\nrate_hz = 4e6\nkind = "complex"\n', tmp_path)
    found = list_satellites(document)
    assert found <= set(CTTC)
    assert set(CTTC) - found in (set(), {2}, {30})
    assert_agrees(document, CTTC, doppler_hz=60.0)  # the README's come from bins, and 4 ms make no better ones
    assert abs(document["oscillator_error_hz"] - 9520.0) < 3.0 * document["oscillator_error_sigma_hz"]
    assert document["oscillator_error_ppm"] == pytest.approx(6.0, abs=1.0)
    assert any("oscillator" in remark for remark in document["remarks"])
    assert any(line["frequency_hz"] == pytest.approx(580e3, abs=2e3) for line in document["lines"])


# Simulated


LO_PPM = 0.628  # how much too fast the oscillator of that scene is
PLACE = ScenePlace(lat_deg=48.1, lon_deg=11.6, height_m=500.0)


def make_sky(*, if_hz: float = 0.0, duration_s: float = 0.06) -> tuple[Samples, set[str]]:
    front_end = FrontEnd(rate_hz=4e6, if_hz=if_hz, encoding="int", bits=8)
    scenario = scenes.make_clean(
        PLACE, START, duration_s=duration_s, receivers=1, mask_deg=10.0, seed=2, front_end=front_end
    )
    assert scenario.receivers[0].lo_ppm == pytest.approx(LO_PPM, abs=0.01)
    navigation = make_nominal_constellation(START)
    heard = {signal.id.sat for signal in make_scene(scenario, navigation).skies[0].signals}
    return render_samples(scenario, navigation)[0], heard


def test_a_jammer_shows_its_power_over_the_noise() -> None:
    near = ScenePlace(lat_deg=48.1005, lon_deg=11.6, height_m=500.0)
    jammer = Interference(kind="noise", transmit=near, power_db=15.0, onset_s=0.03)
    front_end = FrontEnd(rate_hz=4e6, encoding="int", bits=8)
    scene = scenes.make_clean(PLACE, START, duration_s=0.06, receivers=1, seed=2, front_end=front_end)
    scene = scene.model_copy(update={"interference": (jammer,)})
    (samples,) = render_samples(scene, make_nominal_constellation(START))
    document = inspect_samples(samples).document()
    assert document["power"]["jammer_to_noise_low_db"] < 15.0 < document["power"]["jammer_to_noise_high_db"]
    assert document["power"]["jammer_to_noise_db"] == pytest.approx(15.0, abs=1.0)
    assert any("J/N" in remark for remark in document["remarks"])


@pytest.fixture(scope="module")
def samples() -> tuple[bytes, set[str]]:
    samples, heard = make_sky(if_hz=300e3)
    return samples.read(0, samples.n_samples).T.astype(np.int8).tobytes(), heard


@pytest.fixture
def recording(samples: tuple[bytes, set[str]], tmp_path: Path) -> tuple[Path, set[str]]:
    path = tmp_path / "rx.bin"
    path.write_bytes(samples[0])
    return path, samples[1]


@pytest.fixture(scope="module")
def inspection(samples: tuple[bytes, set[str]], tmp_path_factory: pytest.TempPathFactory) -> tuple[Inspection, ...]:
    """Inspect the recording once for all tests that look at what is shown."""
    path = tmp_path_factory.mktemp("inspected") / "rx.bin"
    path.write_bytes(samples[0])
    return tuple(inspect(path, layout=LAYOUT))


@pytest.fixture
def known_inspection(inspection: tuple[Inspection, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the command show these findings without a new search."""
    monkeypatch.setattr("skyproof.app.inspect.inspect", lambda *_, **__: inspection)


LAYOUT = {"rate_hz": 4e6, "kind": "complex", "encoding": "int", "bits": 8, "if_hz": 300e3}
OPTIONS = ["--rate-hz", "4e6", "--kind", "complex", "--encoding", "int", "--bits", "8", "--if-hz", "300e3"]


def test_a_clean_sky_is_all_there_with_nothing_wrong(
    samples: tuple[bytes, set[str]], inspection: tuple[Inspection, ...]
) -> None:
    _, heard = samples
    (found,) = inspection
    assert {satellite.sat for satellite in found.satellites} == heard
    assert found.conjugate is False
    assert found.survey.gaps == ()
    assert [remark for remark in found.remarks if "oscillator" not in remark] == []
    assert abs(found.oscillator.doppler_hz + LO_PPM * 1575.42) < 3.0 * found.oscillator.sigma_hz
    assert "but" not in found.summary


def test_satellites_in_the_conjugate_only_are_found(recording: tuple[Path, set[str]]) -> None:
    path, heard = recording
    (found,) = inspect(path, layout={**LAYOUT, "conjugate": True})
    assert {satellite.sat for satellite in found.satellites} == heard
    assert found.conjugate is True
    assert any("mirrored" in remark for remark in found.remarks)


def test_the_longest_stretch_between_gaps_is_searched() -> None:
    samples, heard = make_sky(duration_s=0.09)
    planes = samples.read(0, samples.n_samples)
    kept = np.concatenate([planes[:, :100_000], planes[:, 101_234:]], axis=1)
    cut = Samples(
        name="cut",
        rate_hz=4e6,
        n_samples=kept.shape[1],
        gaps=(SampleGap(100_000, 1234),),
        read=lambda start, count: kept[:, start : start + count],
    )
    found = inspect_samples(cut)
    (gap,) = found.survey.gaps
    assert gap.missing_samples == pytest.approx(1234, abs=0.5)
    assert found.stretch[0] > 99_900
    assert {satellite.sat for satellite in found.satellites} == heard
    assert all(satellite.peaks == 1 for satellite in found.satellites)


def test_the_command_prints_one_document_or_one_screen(recording: tuple[Path, set[str]], capsys) -> None:
    path, heard = recording
    assert cli.main(["inspect", str(path), *OPTIONS, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["format"] == "skyproof-inspect/1"
    assert {item["sat"] for item in document["satellites"]} == heard
    assert cli.main(["inspect", str(path), *OPTIONS]) == 0
    screen = capsys.readouterr().out
    assert all(sat in screen for sat in heard)
    assert screen.count("\n") < 40


def test_what_makes_no_sense_is_one_line(recording: tuple[Path, set[str]], tmp_path: Path) -> None:
    path, _ = recording
    with pytest.raises(SettingsError, match="bits = 7, expected 1, 2, 4"):
        inspect(path, layout={**LAYOUT, "bits": 7})
    with pytest.raises(SettingsError, match=r"rate_hz = 10\.0, .*\b1.*; encoding "):
        inspect(path, layout={"rate_hz": 10.0, "kind": "complex", "bits": 8})
    with pytest.raises(InputError, match=r"gone\.bin.*exist"):
        inspect(path.with_name("gone.bin"))
    with pytest.raises(InputError, match=r"sidecar.*\bdirectory\b"):
        inspect(path, sidecar=tmp_path)
    (tmp_path / "still.bin").write_bytes(bytes(40_000))
    with pytest.raises(InputError, match=r"still\.bin.*\bzero\b"):
        inspect(tmp_path / "still.bin", layout=LAYOUT)
    (tmp_path / "short.bin").write_bytes(path.read_bytes()[:4000])
    with pytest.raises(NotEnoughData, match="search needs"):
        inspect(tmp_path / "short.bin", layout=LAYOUT)


def test_options_override_a_sidecar_and_facts_name_their_source(
    recording: tuple[Path, set[str]],
) -> None:
    path, _ = recording
    sidecar = f"[samples]\nrate_hz = 4e6\nif_hz = 1.0\nkind = 'complex'\n{INT8}"
    path.with_suffix(".toml").write_text(sidecar, encoding="utf-8")
    (document,) = [item.document() for item in inspect(path, layout={"if_hz": 300e3})]
    sources = document["sources"]
    assert (sources["rate_hz"], sources["if_hz"], sources["centre_hz"]) == ("sidecar rx.toml", "option", "default")
    assert sources["start_gpst"] not in ("option", "default", "sidecar rx.toml")
    assert document["layout"]["if_hz"] == 300e3
    assert all({"sat", "cn0_dbhz", "doppler_hz", "peaks"} <= set(item) for item in document["satellites"])


def test_two_signals_of_a_satellite_are_two_peaks(tmp_path: Path) -> None:
    samples, heard = make_sky(duration_s=0.06)
    planes = samples.read(0, samples.n_samples)
    later = np.pad(planes, ((0, 0), (20, 0)))[:, : planes.shape[1]]  # 5 microseconds, 5.1 chips
    result = Samples(
        name="both",
        rate_hz=4e6,
        n_samples=planes.shape[1],
        read=lambda start, count: (planes + later)[:, start : start + count],
    )
    found = inspect_samples(result)
    assert {satellite.sat for satellite in found.satellites} == heard
    assert sum(satellite.peaks == 2 for satellite in found.satellites) >= len(heard) - 2
    assert "than one" in found.summary


def test_the_last_sentence_says_what_can_be_done_and_is_missing(recording: tuple[Path, set[str]]) -> None:
    samples, _ = make_sky()
    short = inspect_samples(samples)
    assert "too short" in short.advice
    long = advise(replace(samples, n_samples=int(60 * 4e6)), short.satellites, gaps=0, mirrored=False)
    assert "`protect` can" in long
    assert "second receiver" in long
    assert "--nav" not in long
    tens = advise(replace(samples, n_samples=int(20 * 4e6)), short.satellites, gaps=1, mirrored=False)
    assert "--nav" in tens
    assert "samples" in tens
    assert "no satellite" in advise(samples, (), gaps=0, mirrored=False)
    assert "no position" in advise(
        replace(samples, n_samples=int(60 * 4e6)), short.satellites[:3], gaps=0, mirrored=False
    )


@pytest.mark.usefixtures("known_inspection")
@pytest.mark.parametrize("width", [60, 80, 120])
def test_the_screen_keeps_to_the_terminal(recording: tuple[Path, set[str]], width: int, capsys, monkeypatch) -> None:
    path, heard = recording
    monkeypatch.setenv("COLUMNS", str(width))
    assert cli.main(["inspect", str(path), *OPTIONS]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines[1:])) <= width  # the first one is the path, to be copied
    assert len(lines) <= 45
    assert not any("…" in line for line in lines)
    assert sum(line.startswith(tuple(heard)) for line in lines) == len(heard)
    for word in ("format", "rate", "carrier", "start", "duration", "levels", "spectrum", "lines", "gaps", "oscillator"):
        assert sum(line.startswith(word) for line in lines) == 1


@pytest.mark.usefixtures("known_inspection")
def test_pictures_are_written_where_asked_for(recording: tuple[Path, set[str]], tmp_path: Path, capsys) -> None:
    path, heard = recording
    out = tmp_path / "pictures"
    assert cli.main(["inspect", str(path), *OPTIONS, "--plot", "--out", str(out)]) == 0
    assert {item.name for item in out.iterdir()} == {"rx-levels.svg", "rx-spectrum.svg", "rx-correlation.svg"}
    for item in out.iterdir():
        assert ElementTree.parse(item).getroot().tag.endswith("svg")
    correlation = (out / "rx-correlation.svg").read_text(encoding="utf-8")
    assert all(sat in correlation for sat in heard)
    assert correlation.count('class="peak"') == len(heard)
    again = tmp_path / "again"
    assert cli.main(["inspect", str(path), *OPTIONS, "--plot", "--out", str(again), "--json"]) == 0
    reported = capsys.readouterr().out
    json.loads(reported[reported.index("{\n") :])
    assert all((again / item.name).read_bytes() == item.read_bytes() for item in out.iterdir())


def test_a_folder_for_pictures_that_cannot_be_made_is_reported(
    recording: tuple[Path, set[str]], inspection: tuple[Inspection, ...]
) -> None:
    path, _ = recording
    with pytest.raises(OutputError, match=r"rx\.bin/pictures: .*--out"):
        write_pictures(inspection, path / "pictures")


def test_a_notebook_shows_recording_and_satellites_escaped(recording: tuple[Path, set[str]]) -> None:
    path, heard = recording
    strange = path.rename(path.with_name("a<b>&c.bin"))
    (found,) = inspect(strange, layout=LAYOUT)
    result = found._repr_html_()
    ElementTree.fromstring(result)
    assert "a&lt;b&gt;&amp;c.bin" in result
    assert all(f">{sat}<" in result for sat in heard)
    assert result.count("<tr>") == 1 + len(heard)
    assert "4 MHz" in result


def test_earlier_results_are_shown_without_a_new_search(
    recording: tuple[Path, set[str]], inspection: tuple[Inspection, ...], monkeypatch
) -> None:
    path, _ = recording
    (described,) = inspection
    peaks = guess(path).proposals[0].peaks
    searched = []
    monkeypatch.setattr(
        "skyproof.app.inspect.signals._search_readings",
        lambda *reported, looks=_search_readings: searched.append(1) or looks(*reported),
    )
    again = inspect_samples(described.samples, peaks=peaks)
    assert searched == []
    assert {satellite.sat for satellite in again.satellites} == {satellite.sat for satellite in described.satellites}
    assert inspect_samples(described.samples, peaks=peaks[:3]).satellites == described.satellites
    assert searched == [1]
