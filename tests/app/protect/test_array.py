"""One receiver with several antennas, from samples to the verdict."""

import re
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from scipy import stats
from tests.app import kit

from skyproof.app.common.settings import Settings
from skyproof.app.protect import protect
from skyproof.app.receive.inputs import open_inputs
from skyproof.app.receive.reception import observe
from skyproof.app.receive.tracker import track
from skyproof.detectors.array.array_model import mean_differences, white_covariance
from skyproof.errors import SettingsError
from skyproof.explain import explain
from skyproof.records import AntennaArray
from skyproof.simulator.scenario import Sky
from skyproof.statistics.directions import equal_statistic


def write_platform(folder: Path, inputs, **receiver) -> Path:
    """Write a platform file of the array."""
    places_m = [list(place) for place in kit.ELEMENTS_M]
    table = {"name": "array", "inputs": [str(path) for path in inputs], "antennas_m": places_m, **receiver}
    path = folder / "platform.toml"
    path.write_text(tomli_w.dumps({"receivers": [table]}))
    return path


def list_evidence(result, detector):
    return [e for e in result.outcome.evidence if e.detector == detector]


def make_spoofer(**given):
    """Make a transmitter 100 m off that shows another place."""
    shows, transmit = kit.ELSEWHERE.model_dump(), kit.TRANSMIT.model_dump()
    return {"kind": "spoofer", "shows": shows, "transmit": transmit, "power_db": 3.0, "clock_offset_s": 3e-6, **given}


@pytest.mark.long
def test_a_clean_sky_comes_from_several_directions(array_files, tmp_path):
    result = protect(platform=write_platform(tmp_path, [array_files.sigmf]), nav=array_files.nav)
    (finding,) = list_evidence(result, "array_common")
    assert (finding.says, {ref.receiver for ref in finding.signals}) == ("authentic", {"array"})
    assert len(finding.signals) > 7
    assert explain(finding).assumptions[0] in result.verdict.assumed
    (finding,) = list_evidence(result, "ins_array")  # by the attitude and the lines that the sky itself shows
    assert (finding.says, {ref.receiver for ref in finding.signals}) == ("authentic", {"array"})
    assert len(finding.signals) > 7
    assert explain(finding).assumptions[0] in result.verdict.assumed
    assert not any(signal.label == "spoofed" for signal in result.verdict.signals)


@pytest.mark.long
def test_other_antennas_than_the_inputs_have_are_refused(array_files, tmp_path):
    three = write_platform(tmp_path, [array_files.woven], antennas_m=[list(place) for place in kit.ELEMENTS_M[:3]])
    with pytest.raises(SettingsError, match=r"antennas_m .*\barray .*\b3 antennas\b.* 4"):
        protect(platform=three, nav=array_files.nav)


SILENT = "antennas_silent"
JUMPS = "antennas_jumping"
LATE, LATE_SAMPLES = "antennas_deaf", 20_000
FAILURES = {
    "dead": (lambda iq, rng: np.zeros_like(iq), SILENT),
    "constant": (lambda iq, rng: np.full_like(iq, 7), SILENT),
    "dead before its middle": (lambda iq, rng: iq * (np.arange(len(iq)) < 0.4 * len(iq))[:, None], SILENT),
    "noise": (lambda iq, rng: np.rint(20.0 * rng.standard_normal(iq.shape)), SILENT),
    "at another rate": (lambda iq, rng: iq[np.rint(np.arange(len(iq)) * 0.999).astype(int)], SILENT),
    "mirrored": (lambda iq, rng: iq[:, ::-1], SILENT),
    "a jump": (lambda iq, rng: np.where((np.arange(len(iq)) < 0.6 * len(iq))[:, None], iq, -iq), JUMPS),
    "begun late": (lambda iq, rng: np.roll(iq, -LATE_SAMPLES, axis=0), LATE),
    "turned over": (lambda iq, rng: -iq, None),  # half a cycle of its line: it is no failure
}


@pytest.mark.long
@pytest.mark.parametrize(("failed", "how"), FAILURES.values(), ids=FAILURES.keys())
def test_an_antenna_that_fails_is_left_out_and_reported(array_files, tmp_path, failed, how):
    iq = np.fromfile(array_files.woven, np.int8).reshape(-1, 4, 2)
    iq[:, 1] = np.clip(failed(iq[:, 1].astype(float), np.random.default_rng(1)), -127, 127)
    iq.tofile(tmp_path / "woven.bin")
    (tmp_path / "woven.toml").write_text(array_files.woven.with_suffix(".toml").read_text())
    result = protect(platform=write_platform(tmp_path, [tmp_path / "woven.bin"]), nav=array_files.nav)
    labels = {signal.label for signal in result.verdict.signals}
    assert "spoofed" not in labels
    (finding,) = list_evidence(result, "array_common")
    assert finding.says == "authentic"
    assert len(finding.signals) > 7
    left_out = [(e.code, *e.data["antennas"]) for e in result.outcome.evidence if "antennas" in e.data]
    assert set(left_out) == ({(how, "2")} if how is not None else set())
    late = f" {LATE_SAMPLES} samples of "
    assert (late in " ".join(result.verdict.inputs[0].all_remarks)) == (how == LATE)


@pytest.mark.long
def test_a_late_first_antenna_does_not_stand_for_the_receiver(array_files, tmp_path):
    iq = np.fromfile(array_files.woven, np.int8).reshape(-1, 4, 2)
    iq[:, 0] = np.roll(iq[:, 0], -LATE_SAMPLES, axis=0)
    iq.tofile(tmp_path / "woven.bin")
    (tmp_path / "woven.toml").write_text(array_files.woven.with_suffix(".toml").read_text())
    result = protect(platform=write_platform(tmp_path, [tmp_path / "woven.bin"]), nav=array_files.nav)
    assert result.verdict.verdict == "authentic"
    assert re.search(r"\bantenna 1 .*\b12\.5 ms after .*2\b", " ".join(result.verdict.inputs[0].all_remarks))


@pytest.mark.long
def test_false_signals_of_a_transmitter_are_named_no_true_one(tmp_path):
    clean = kit.record(kit.make_array_scenario(duration_s=34.0, seed=3), tmp_path / "clean")
    result = protect(platform=write_platform(tmp_path, clean.paths), nav=clean.nav)
    assert result.verdict.verdict == "authentic"
    scenario = kit.make_array_scenario(duration_s=34.0, seed=3, attacks=(make_spoofer(onset_s=8.0),))
    attacked = kit.record(scenario, tmp_path / "attacked")
    result = protect(platform=write_platform(tmp_path, attacked.paths), nav=attacked.nav)
    assert result.verdict.verdict == "spoofed"
    labels = {label.ref.signal: label.label for label in result.outcome.decision.labels}
    # The attitude that the sky itself shows vouches for those that come from where their satellites stand.
    assert {signal.copy for signal, label in labels.items() if label == "authentic"} == {"a"}
    named = {signal for signal, label in labels.items() if label == "spoofed"}
    assert len({signal.sat for signal in named}) >= 8
    assert {signal.copy for signal in named if signal.copy == "a"} == set()  # what was there before the attack


@pytest.mark.long
def test_false_signals_of_one_transmitter_are_equal_within_noise(tmp_path):
    # Weak: the transmitter's other codes are noise of one direction too, which antennas share; their phases then differ
    # by less than the noise of each (statistic over its mean: 0.94 at -3 dB, 0.83 at +3 dB, 0.53 at +10 dB).
    scenario = kit.make_array_scenario(duration_s=40.0, seed=7, attacks=(make_spoofer(onset_s=-1.0, power_db=-3.0),))
    alone = scenario.model_copy(update={"sky": Sky(zenith_cn0_dbhz=41.0, horizon_cn0_dbhz=39.0, until_s=-0.5)})
    recorded = kit.record(alone, tmp_path)
    (source,) = open_inputs([tuple(recorded.paths)], Settings(), None, ["array"])
    (tracker,), _ = track([source], Settings())
    lines_cyc = np.array(kit.LINE_BIAS_CYC)
    places = AntennaArray(elements_m=np.array(kit.ELEMENTS_M), line_bias_cyc=lines_cyc)
    phases = observe(tracker, None, places).array_phases.select_between(0.0, np.inf)
    p_values = []
    for first in range(10, phases.gpst.size - 5, 5):
        rows = slice(first, first + 5)
        part = type(phases)(
            receiver="array",
            signals=phases.signals,
            gpst=phases.gpst[rows],
            elapsed_s=phases.elapsed_s[rows],
            elements_m=phases.elements_m,
            phase_cyc=phases.phase_cyc[rows],
            sigma_cyc=phases.sigma_cyc[rows],
        )
        mean = mean_differences(part)
        measured = mean.epochs == 5
        statistic, *_ = equal_statistic(mean.cycles[measured], white_covariance(mean.sigma_cyc[measured]), wrapped=True)
        p_values.append(stats.chi2.sf(float(statistic), 3 * (int(measured.sum()) - 1)))
    assert len(p_values) > 30
    assert stats.kstest(p_values, "uniform").pvalue > 1e-3
