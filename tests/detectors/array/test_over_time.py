"""Windows of arrays and arms together: what none shows alone, blocks of 2, 4, 8 show, at an error rate that holds."""

from dataclasses import replace

import numpy as np
import pytest
from tests.detectors.array.test_arm import RADIUS_M, RATE_HZ, make_turning

from skyproof.detectors.array.agreement import ArrayFrame, MeanPhases, residuals
from skyproof.detectors.array.over_time import (
    Block,
    Waiting,
    add_block,
    alpha_alone,
    alpha_of_block,
    pattern_share,
    share_after_averaging,
)
from skyproof.detectors.array.policy import POLICY
from skyproof.detectors.array.spin import Spin, SpinSettings
from skyproof.gnss.constants import L1_HZ
from skyproof.records import SignalId, SignalRef, SpinArm

ELEMENTS = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.0, 0.5, 0.0]])
REFS = tuple(SignalRef("rx1", SignalId(f"G{k:02d}")) for k in range(1, 5))


def make_block(residual_cyc, *, refs=REFS, heading_rad=0.0):
    """Make a window of 10 s."""
    n = len(refs)
    towards = np.tile([0.6, 0.0, -0.8], (n, 1))
    measured = MeanPhases(
        cycles=np.zeros((n, 2)),
        direction=towards,
        sigma_cyc=np.full((n, 3), 0.01),
        elements_cyc=ELEMENTS,
        ratio=np.ones(n),
        position_sigma_cyc=0.0,
    )
    turn = np.array(
        [[np.cos(heading_rad), np.sin(heading_rad), 0], [-np.sin(heading_rad), np.cos(heading_rad), 0], [0, 0, 1]]
    )
    frame = ArrayFrame(
        turn=turn, bias_cyc=np.array([0.1, -0.2]), attitude_covariance_rad2=1e-6 * np.eye(3), bias_sigma_cyc=0.005
    )
    return Block(
        refs=refs,
        residual_cyc=np.asarray(residual_cyc),
        towards=towards @ turn.T,
        white_cyc2=np.full((n, 3), 1e-4),
        lasting_cyc2=np.full(3, 1e-4),
        frame=frame,
        body=turn,
        measured=measured,
        windows=1,
        duration_s=10.0,
    )


def test_a_block_holds_the_mean_of_its_windows_and_few_wait():
    rng = np.random.default_rng(1)
    mean = rng.normal(0.0, 0.1, (4, 2))
    off = mean + 0.02 * rng.standard_normal((16, 4, 2))
    waiting, complete, lengths = Waiting(), [], []
    for number in range(16):
        cycles = rng.integers(-3, 4, (4, 2))
        waiting, complete = add_block(waiting, make_block(off[number] + cycles))
        lengths += [selected_block.windows for selected_block in complete]
        assert sum(selected_block is not None for selected_block in waiting.blocks) <= number.bit_length() + 1
    assert sorted(lengths) == [2] * 8 + [4] * 4 + [8] * 2 + [16]
    last = complete[-1]
    apart = last.residual_cyc - off.mean(axis=0)
    np.testing.assert_allclose(apart - np.rint(apart), 0.0, atol=1e-12)
    np.testing.assert_allclose(last.white_cyc2, 1e-4 / 16)
    phases = last.mean_phases(0.25)
    np.testing.assert_allclose(residuals(phases, last.frame), last.residual_cyc, atol=1e-12)
    lasting = 0.25 + 0.75 * share_after_averaging(160.0)
    np.testing.assert_allclose(phases.sigma_cyc**2, 1e-4 / 16 + lasting * 1e-4)


def test_windows_of_a_body_that_has_turned_do_not_join():
    waiting, _ = add_block(Waiting(), make_block(np.zeros((4, 2))))
    waiting, complete = add_block(waiting, make_block(np.zeros((4, 2)), heading_rad=0.1))
    assert not complete
    _, (joined,) = add_block(waiting, make_block(np.zeros((3, 2)), refs=REFS[1:], heading_rad=0.11))
    assert joined.refs == REFS[1:]


@pytest.mark.parametrize("duration_s", [20.0, 160.0, 2560.0])
def test_what_a_mean_leaves_of_a_gauss_markov_process(duration_s):
    t = np.linspace(0.0, duration_s, 2001)[:-1]
    mean = np.exp(-np.abs(t[:, None] - t) / POLICY.lasting_forgotten_s).mean()
    assert share_after_averaging(duration_s) == pytest.approx(mean, rel=2e-3)


def test_windows_and_blocks_spend_what_the_windows_have():
    spent = 256 * alpha_alone(1e-6)
    spent += sum(256 // 2**k * alpha_of_block(1e-6, 2**k) for k in range(1, POLICY.block_lengths + 1))
    assert spent == pytest.approx(256e-6)


def test_the_pattern_of_antennas_is_never_forgotten():
    assert pattern_share(0.0101, L1_HZ) == pytest.approx(0.271, abs=1e-3)
    assert pattern_share(0.0, L1_HZ) == 1.0
    assert pattern_share(0.0101, L1_HZ, 0.0) == 0.0
    assert pattern_share(0.03, L1_HZ, 0.005) == pytest.approx(0.767, abs=1e-3)


def test_a_false_signal_below_each_window_is_named_by_four():
    arm = SpinArm(receiver="rx1", radius_m=RADIUS_M, rate_rad_s=2.0 * np.pi * RATE_HZ)
    detector, state, found = Spin(SpinSettings(false_alarm_probability=1e-6)), None, []
    for _ in range(7):
        records = make_turning(np.random.default_rng(7), false=0, moved_rad=np.radians(10.0))
        evidence, state = detector.examine(replace(records, spin_arms=(arm,)), state)
        found.append({e.says: (e.code, {ref.signal for ref in e.signals}) for e in evidence})
    first = records.observations[0].signals[0]
    assert [number for number, words in enumerate(found) if "spoofed" in words] == [3]
    assert found[3]["spoofed"] == ("from_elsewhere_over_time", {first})
    assert all(first not in words["authentic"][1] for words in found)
