"""A carrier held whole half cycles a bit off: how often it is detected, and how rarely a true lock is called one."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.gnss.signals import GPS_L1_CA
from skyproof.receiver import kernels as k
from skyproof.receiver import measurement as m
from skyproof.receiver import tracking
from skyproof.receiver.false_lock import FALSE_TURNING, N_BITS, false_lock_hz, is_turning, leave_false_locks, sum_turns

BIT_S = 0.02
PERIOD_S = GPS_L1_CA.period_s
ROW_BITS = 10


def draw_prompts(off_hz, cn0_dbhz, n_bits, rng, n_signals=1, first=0):
    """Draw (n_signals, n) prompts of unit noise, with bits that turn over at random."""
    n = 20 * n_bits
    amplitude = np.sqrt(10 ** (0.1 * cn0_dbhz) * PERIOD_S)
    bits = np.repeat(rng.choice([-1.0, 1.0], (n_signals, n_bits + 1)), 20, axis=1)[:, first : first + n]
    turn = np.exp(2j * np.pi * (off_hz * PERIOD_S * np.arange(n) + rng.uniform(size=(n_signals, 1))))
    noise = (rng.normal(size=(n_signals, n)) + 1j * rng.normal(size=(n_signals, n))) * np.sqrt(0.5)
    return amplitude * bits * turn + noise


def draw_sums(off_hz, cn0_dbhz, n_bits, seed, n_signals=1):
    prompts = draw_prompts(off_hz, cn0_dbhz, n_bits, np.random.default_rng(seed), n_signals)
    return sum_turns(prompts, np.zeros(n_signals, np.int64), np.zeros(n_signals), 20)


def test_bits_are_taken_whole_wherever_they_begin():
    prompts = draw_prompts(0.0, 60.0, 12, np.random.default_rng(1), first=7)
    turns = sum_turns(prompts, np.array([107]), np.array([0.0]), 20)
    assert turns[0, N_BITS] == 11
    assert turns[0, 1] == pytest.approx(11 * 4 * 16 * 1000.0, rel=0.02)  # of four products of sums over four periods


@pytest.mark.parametrize("probability", [0.01, 0.1])
@pytest.mark.parametrize("cn0_dbhz", [25, 29, 35, 50])
@pytest.mark.parametrize("off_hz", [12.5, pytest.param(-12.5, marks=pytest.mark.long)])
def test_a_carrier_half_way_is_called_false_at_the_stated_rate(off_hz, cn0_dbhz, probability):
    # To one of two sides: half as often. The bits' products are normal enough for Student's t.
    n = 20_000
    says = int(is_turning(draw_sums(off_hz, cn0_dbhz, ROW_BITS, 7, n), probability).sum())
    assert 0.8 * 0.5 * probability * n < says < 1.2 * 0.5 * probability * n + 3.0 * np.sqrt(0.5 * probability * n)


def test_rows_on_true_locks_pass_and_on_false_ones_do_not():
    n = 20_000
    assert np.mean(is_turning(draw_sums(0.0, 25.0, ROW_BITS, 11, n), FALSE_TURNING)) < 1e-3
    for half_cycles, seen_dbhz in ((1, 25.0), (-1, 27.0), (3, 25.0)):
        lost_db = -20.0 * np.log10(np.abs(np.sinc(25.0 * half_cycles * BIT_S)))
        turning = is_turning(draw_sums(25.0 * half_cycles, seen_dbhz + lost_db, ROW_BITS, 12, n), FALSE_TURNING)
        assert np.mean(turning) > 0.85


@pytest.mark.parametrize("half_cycles", [-4, -3, -2, -1, 1, 2, 3, 4])
def test_a_false_lock_of_a_signal_that_would_be_measured_is_seen(half_cycles):
    off_hz = 25.0 * half_cycles
    n = 2000
    lost_db = -20.0 * np.log10(np.abs(np.sinc(off_hz * BIT_S))) if half_cycles % 2 else 14.0
    turns = draw_sums(off_hz, 25.0 + max(lost_db, 3.9), 50, 3, n)
    assert np.mean(false_lock_hz(turns, BIT_S) == off_hz) > 0.995


def test_noise_alone_moves_no_carrier():
    assert not false_lock_hz(draw_sums(0.0, -40.0, 50, 5, 4000), BIT_S).any()


def test_few_bits_say_nothing():
    assert not is_turning(draw_sums(25.0, 50.0, 4, 2), FALSE_TURNING).any()
    loops = np.zeros((0, k.N_STATE))
    blocks = ((np.zeros((0, 110, 12)), np.zeros(0, np.int64)),) * 2
    turning, _, _ = leave_false_locks(loops, np.zeros((0, 6)), blocks, np.zeros(0, np.bool_), GPS_L1_CA)
    assert turning.size == 0


@pytest.fixture(scope="module")
def locked(clean):
    """Return a receiver after 4 s, whose loops sum over a bit since bits are known."""
    settings = tracking.ReceiverSettings(weak_dbhz=60.0)
    receiver = tracking.Receiver(clean.samples.rate_hz, clean.samples.if_hz, settings)
    edge = int(4.0 * clean.samples.rate_hz)
    _, state = receiver.step(tracking.ReceiverState(), clean.planes[:, :edge])
    assert (state.loops[:, k.BIT_START] >= 0.0).all()
    return receiver, state, edge


@pytest.mark.parametrize("off_hz", [25.0, -75.0])
def test_a_false_lock_moves_to_its_carrier_unmeasured(clean, locked, off_hz, monkeypatch):
    receiver, state, edge = locked
    true_hz = state.loops[0, k.PLL_VELOCITY]
    loops = state.loops.copy()
    loops[0, [k.PLL_VELOCITY, k.FREQUENCY]] += off_hz
    later = clean.planes[:, edge : edge + int(3.0 * clean.samples.rate_hz)]
    output, after = receiver.step(replace(state, loops=loops), later)
    arc = state.channels[0].arc
    # The first row is made of what came before as well.
    rows = (output.measurements.arc == arc) & (output.measurements.elapsed_s > 4.3)
    assert after.loops[0, k.PLL_VELOCITY] == pytest.approx(true_hz, abs=3.0)
    assert rows.sum() >= 5
    np.testing.assert_allclose(output.measurements.column(m.DOPPLER_HZ)[rows], true_hz, atol=3.0)
    assert output.measurements.column(m.SLIP)[rows][0] == 1.0
    # Without the test it stays there for good.
    monkeypatch.setattr(
        tracking, "leave_false_locks", lambda loops, turns, _, good, __: (np.zeros_like(good), loops, turns)
    )
    _, moved_state = receiver.step(replace(state, loops=loops), later)
    assert abs(moved_state.loops[0, k.PLL_VELOCITY] - true_hz) > 20.0
