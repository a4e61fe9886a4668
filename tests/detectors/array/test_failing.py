"""An antenna of an array that fails is found, left out and named, and no true signal is called spoofed for it."""

from dataclasses import replace

import numpy as np
import pytest
from tests.detectors.nulls import SIGNALS, START, STATE, TRUE, draw_array_records, make_empty_phases

from skyproof.detectors.array.array_common import ArrayCommon
from skyproof.detectors.array.failing import find_failing, leave_out
from skyproof.detectors.array.ins_array import InsArray
from skyproof.explain import stands_beside

WAVE = np.linalg.norm(make_empty_phases().elements_m[1])
ELEMENTS_M = WAVE * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.87, 0.0], [0.5, 0.3, -0.8]])
EPOCHS = 40


def draw_sky(rng):
    """Draw forty epochs of four antennas under a true sky."""
    direction = np.repeat(TRUE[1:2], EPOCHS, axis=0)
    phase = direction @ ELEMENTS_M.T / WAVE + 0.003 * rng.standard_normal((EPOCHS, len(SIGNALS), 4))
    shape = phase.shape
    return replace(
        make_empty_phases(EPOCHS),
        gpst=START + np.timedelta64(900, "ms") + np.arange(EPOCHS) * np.timedelta64(5, "ms"),
        elements_m=ELEMENTS_M,
        phase_cyc=(phase + rng.random((*shape[:2], 1))) % 1.0,
        sigma_cyc=np.full(shape, 0.003),
    )


def kill_antenna(phases, rng):
    phase = phases.phase_cyc.copy()
    phase[4:, :, 2] = np.nan
    return replace(phases, phase_cyc=phase)


def swap_antenna(phases, rng):
    """Give antenna 2 every signal as another antenna of its own would receive it."""
    late_cyc = np.where(np.arange(4) == 2, phases.phase_cyc, np.nan)
    rest = np.where(np.arange(4) == 2, np.nan, phases.phase_cyc)
    copies = tuple(replace(signal, copy="b") for signal in phases.signals)
    return replace(
        phases,
        signals=(*phases.signals, *copies),
        phase_cyc=np.concatenate([rest, late_cyc], axis=1),
        sigma_cyc=np.tile(phases.sigma_cyc, (1, 2, 1)),
        carrier_hz=np.tile(phases.carrier_hz, 2),
    )


def add_noise(phases, rng):
    phase = phases.phase_cyc.copy()
    phase[..., 2] += 0.1 * rng.standard_normal(phase.shape[:2])
    return replace(phases, phase_cyc=phase)


def add_jumps(phases, rng):
    phase = phases.phase_cyc.copy()
    phase[17:, :, 2] += 0.3
    return replace(phases, phase_cyc=phase)


def add_half_cycles(phases, rng):
    phase = phases.phase_cyc.copy()
    phase[17:, :, 2] += 0.5
    return replace(phases, phase_cyc=phase)


def add_jumps_within_epoch(phases, rng):
    phase = phases.phase_cyc.copy()
    phase[18:, :, 2] += 0.5
    phase[17, :, 2] = np.nan
    return replace(phases, phase_cyc=phase)


def silence_antenna(phases, rng):
    return replace(phases, phase_cyc=np.full_like(phases.phase_cyc, np.nan))


FAULTS = {
    swap_antenna: "deaf",
    kill_antenna: "silent",
    add_noise: "noisy",
    add_jumps: "jumping",
    add_half_cycles: "jumping",
    add_jumps_within_epoch: "jumping",
}


@pytest.mark.parametrize(("fault", "how"), FAULTS.items())
@pytest.mark.parametrize("seed", range(3))
def test_the_antenna_that_fails_is_found(fault, how, seed):
    rng = np.random.default_rng(seed)
    phases = fault(draw_sky(rng), rng)
    assert find_failing(phases) == {2: how}
    others_phases = leave_out(phases, {2: how})
    np.testing.assert_array_equal(others_phases.elements_m, ELEMENTS_M[[0, 1, 3]])


def test_antennas_that_work_stay():
    rng = np.random.default_rng(1)
    assert not any(find_failing(draw_sky(rng)) for _ in range(50))
    assert not find_failing(silence_antenna(draw_sky(rng), rng))


def test_of_two_antennas_it_stays_open_which_one_jumps():
    rng = np.random.default_rng(1)
    assert not find_failing(leave_out(add_jumps(draw_sky(rng), rng), {0: "silent", 1: "silent"}))


@pytest.mark.parametrize(("fault", "how"), FAULTS.items())
def test_it_is_reported_and_the_signals_stay_authentic(fault, how):
    rng = np.random.default_rng(4)
    records = replace(draw_array_records(rng), array_phases=(fault(draw_sky(rng), rng),), nav_state={"rx1": STATE})
    noted, finding = InsArray().examine(records)[0]
    assert (noted.code, noted.data["antennas"], noted.p) == (f"antennas_{how}", ("3",), {})
    assert stands_beside(noted)
    assert finding.says == "authentic"
    (finding,), _ = ArrayCommon().examine(records)
    assert finding.says == "authentic"
