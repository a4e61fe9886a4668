"""Antenna arrays that are jammed or overpowered: positions go on behind a null."""

import numpy as np
import pytest
import tomli_w
from tests.app import kit

from skyproof.app.protect import behind_null, protect
from skyproof.records import FixStatus
from skyproof.simulator.attacks import Interference, Spoofer
from skyproof.simulator.scenario import FrontEnd

ONSET_S = 12.0
SPOOFER = {"shows": kit.ELSEWHERE, "transmit": kit.TRANSMIT, "clock_offset_s": 3e-6}
CHIRP = Interference(kind="chirp", transmit=kit.TRANSMIT, power_db=30.0, sweep_hz=1e6, period_s=2e-5, onset_s=ONSET_S)


def judge_array(folder, *, bits=8, duration_s=18.0, interference=(), attacks=(), late_samples=0):
    """Judge a scene of three antennas, one of them late; return the result and the receiver's outcome."""
    front_end = FrontEnd(
        rate_hz=1.6e6, bandwidth_hz=1.28e6, encoding="int" if bits == 8 else "sign", bits=bits, agc=bits == 8
    )
    scenario = kit.make_array_scenario(antennas=3, duration_s=duration_s, attacks=attacks)
    scenario = scenario.model_copy(update={"interference": interference, "front_end": front_end})
    recorded = kit.record(scenario, folder)
    if late_samples:
        values = np.fromfile(recorded.paths[1], np.int8)
        np.roll(values, -2 * late_samples).tofile(recorded.paths[1])
    table = {
        "name": "array",
        "inputs": [str(path) for path in recorded.paths],
        "antennas_m": [list(place) for place in kit.ELEMENTS_M[:3]],
    }
    (folder / "platform.toml").write_text(tomli_w.dumps({"receivers": [table]}))
    result = protect(platform=folder / "platform.toml", nav=recorded.nav)
    return result, result.outcome.receivers[0]


def measure_errors_m(r):
    """Measure how far consistent fixes are off, (n,), and at which times after the first sample, s."""
    fix = r.positions.whole("consistent")
    good = fix.status == FixStatus.OK
    return kit.measure_error_m(fix, kit.PLACES[0])[good], r.positions.log.elapsed_s[good]


def test_positions_of_a_jammed_array_go_on_behind_a_null(tmp_path):
    result, r = judge_array(tmp_path, interference=(CHIRP,))
    (receiver,) = result.verdict.receivers
    assert receiver.behind_null.source_to_noise_db == pytest.approx(29.0, abs=1.5)
    assert receiver.behind_null.seconds > 5.0
    assert receiver.behind_null.cn0_cost_db < 5.0
    errors_m, elapsed_s = measure_errors_m(r)
    assert np.sum(elapsed_s > ONSET_S + 0.5) > 25
    assert errors_m.max() < 15.0
    assert "behind a null" in result.verdict.assumed
    assert result.verdict.interference.state == "present"
    assert not any(signal.label == "spoofed" for signal in result.verdict.signals)


@pytest.mark.long
def test_true_signals_are_found_behind_a_stronger_transmitter(tmp_path):
    spoofer = Spoofer(power_db=30.0, onset_s=ONSET_S, **SPOOFER)
    result, r = judge_array(tmp_path, duration_s=26.0, attacks=(spoofer,))
    assert result.verdict.verdict == "spoofed"
    assert result.verdict.receivers[0].behind_null.seconds > 10.0
    errors_m, elapsed_s = measure_errors_m(r)
    assert np.sum(elapsed_s > ONSET_S + 0.5) > 50
    assert errors_m.max() < 15.0
    labels = {label.ref.signal: label.label for label in result.outcome.decision.labels}
    assert all(label != "authentic" for signal, label in labels.items() if signal.copy > "a")


@pytest.mark.long
def test_a_clean_array_is_tracked_once(tmp_path, monkeypatch):
    monkeypatch.setattr(behind_null, "track", lambda *_, **__: pytest.fail("tracked again"))
    result, _ = judge_array(tmp_path)
    assert result.verdict.receivers[0].behind_null is None


@pytest.mark.long
def test_an_array_that_is_jammed_from_the_start_is_judged_behind_a_null(tmp_path):
    jammer = CHIRP.model_copy(update={"onset_s": -1.0})
    result, r = judge_array(tmp_path, duration_s=26.0, interference=(jammer,))
    assert (result.verdict.verdict, result.verdict.interference.state) == ("no_attack_seen", "present")
    assert "behind a null" in result.verdict.inputs[0].left_out[0]
    errors_m, _ = measure_errors_m(r)
    assert errors_m.size > 100
    assert errors_m.max() < 15.0


@pytest.mark.long
def test_one_bit_leaves_nothing_behind_a_null_and_that_is_said(tmp_path):
    result, r = judge_array(tmp_path, bits=1, interference=(CHIRP,))
    found = result.verdict.receivers[0].behind_null
    assert (found.seconds, found.from_gpst) == (0.0, None)
    assert "behind this null either" in result.verdict.summary
    assert not r.has_fixes_behind_null


def test_a_second_transmitter_behind_a_null_makes_the_run_suspect(tmp_path):
    elsewhere = kit.TRANSMIT.model_copy(update={"lat_deg": kit.TRANSMIT.lat_deg + 0.01})
    spoofer = Spoofer(power_db=6.0, onset_s=ONSET_S, **SPOOFER | {"transmit": elsewhere})
    result, _ = judge_array(tmp_path, duration_s=22.0, interference=(CHIRP,), attacks=(spoofer,))
    assert result.verdict.receivers[0].behind_null.word in ("suspect", "spoofed")
    assert result.verdict.verdict == "suspect"
    assert result.verdict.receivers[0].word == "suspect"
    assert "fit positions" in result.verdict.reason


@pytest.mark.long
def test_nothing_is_fixed_behind_a_null_where_there_is_no_source(tmp_path):
    result, r = judge_array(tmp_path, interference=(CHIRP,), late_samples=1600)
    assert result.verdict.verdict == "suspect"  # the antennas are not as stated
    at_s = r.positions.log.elapsed_s[r.positions.behind_null.epochs]
    assert at_s.size > 10
    assert at_s.min() > ONSET_S - 0.2
