"""Cumulative sums over a vector receiver's looks: how often they alarm, what is carried between windows, and when."""

import numpy as np
import pytest
from scipy.optimize import brentq

from skyproof.detectors.correlators import vector_parity as parity
from skyproof.detectors.correlators.policy import POLICY
from skyproof.detectors.correlators.vector_cusum import BankState, run_bank
from skyproof.records import SignalId
from skyproof.statistics.cusum import cusum_within
from skyproof.statistics.distributions import binomial_survival
from skyproof.studies.vector_sky import PRNS, SKY

SIGNALS = tuple(SignalId(f"G{prn:02d}") for prn in PRNS)
CODE_CHIPS, PHASE_RAD = 0.05, 0.07
ONE = parity.build_whitener(SKY.parity, np.full(6, CODE_CHIPS), np.full(6, PHASE_RAD))
NO_ERRORS = np.zeros(6)


def draw_looks(rng, n, code_chips=0.0, phase_rad=0.0):
    """Draw discriminators (n, 6) of channels off by so much."""
    u, q = rng.standard_normal((2, n, 6))
    return code_chips + CODE_CHIPS * u, phase_rad + PHASE_RAD * q


def find_in_windows(rng, count, n, probability, code_chips=0.0, phase_rad=0.0, lasting=NO_ERRORS, carried=True):
    """Return what the bank finds in each of `count` windows of `n` snapshots."""
    state: BankState | None = None
    for _ in range(count):
        found = run_bank(SIGNALS, *draw_looks(rng, n, code_chips, phase_rad), ONE, lasting, probability, state)
        state = found.state if carried else None
        yield found


def test_alarms_keep_the_stated_rate_and_so_do_p_values():
    found = list(find_in_windows(np.random.default_rng(1), 150, 100, 0.1))
    alarms = sum(result.seen is not None for result in found)
    assert all((result.seen is None) == (result.p_value >= 0.1) for result in found)
    assert binomial_survival(alarms, 150, 0.1) > 1e-3
    assert alarms > 2  # the sums' exact laws, less what one share for each of four dependent sums loses


def test_lasting_errors_alarm_only_without_an_allowance():
    rng = np.random.default_rng(2)
    sigma = np.full(6, 0.02)
    alarms = without = 0
    for _ in range(12):
        stays = sigma * rng.standard_normal(6)
        alarms += sum(found.seen is not None for found in find_in_windows(rng, 5, 100, 0.05, stays, lasting=sigma))
        without += sum(found.seen is not None for found in find_in_windows(rng, 5, 100, 0.05, stays))
    assert binomial_survival(alarms, 60, 0.05) > 1e-3
    assert without > 20


def test_a_small_offset_is_found_over_several_windows():
    code, phase = 0.25 * CODE_CHIPS * SKY.projector[0], 0.25 * PHASE_RAD * SKY.projector[0]
    alone = list(find_in_windows(np.random.default_rng(3), 12, 200, 1e-5, code, phase, carried=False))
    assert not any(result.seen for result in alone)
    together = list(find_in_windows(np.random.default_rng(3), 12, 200, 1e-5, code, phase))
    assert any(result.seen for result in together)


def test_a_large_offsets_onset_is_found_to_tenths_of_a_second():
    rng = np.random.default_rng(4)
    quiet, off = draw_looks(rng, 230), draw_looks(rng, 270, 0.2 * SKY.projector[0], 0.3 * SKY.projector[0])
    u, q = (np.concatenate(pair) for pair in zip(quiet, off, strict=True))
    found = run_bank(SIGNALS, u, q, ONE, NO_ERRORS, 1e-6)
    assert 205 <= found.began <= 235
    assert 235 <= found.seen <= 245
    assert all(np.all(total == 0.0) for total in found.state.sums)


def test_a_sum_that_just_alarms_is_seen_at_its_step():
    probability, (step, reference) = 0.5, POLICY.cusum_branches[0]
    share = (1.0 - POLICY.lasting_share) * probability / 4
    steps, dof = 3, len(SKY.parity)
    least = brentq(lambda size: cusum_within(size, steps, reference, dof) - share, 0.1, 10.0)
    y = np.zeros(dof)
    y[0] = least + 1e-6 + reference  # from zero, in one step
    direction = CODE_CHIPS**2 * ONE.code.T @ y / np.sqrt(step)  # W x = y
    u = np.zeros((steps * step, 6))
    u[-step:] = direction
    found = run_bank(SIGNALS, u, np.zeros_like(u), ONE, NO_ERRORS, probability)
    assert found.p_value < probability
    assert (found.began, found.seen) == (2 * step, steps * step)


def test_sums_live_in_parity_space_and_restart_on_new_signals():
    rng = np.random.default_rng(5)
    u, q = draw_looks(rng, 100)
    turned = parity.build_whitener(
        np.array([[0.6, 0.8], [-0.8, 0.6]]) @ SKY.parity, np.full(6, CODE_CHIPS), np.full(6, PHASE_RAD)
    )
    first = run_bank(SIGNALS, u, q, ONE, NO_ERRORS, 1e-3)
    for white in (ONE, turned):
        again = run_bank(SIGNALS, u, q, white, NO_ERRORS, 1e-3, first.state)
        for total, other in zip(
            again.state.sums,
            run_bank(SIGNALS, u, q, ONE, NO_ERRORS, 1e-3, first.state).state.sums,
            strict=True,
        ):
            np.testing.assert_allclose(total, other, atol=1e-12)
    other_signals = (SignalId("G01"), *SIGNALS[1:])
    anew = run_bank(other_signals, u, q, ONE, NO_ERRORS, 1e-3, first.state)
    np.testing.assert_array_equal(anew.state.sums, run_bank(other_signals, u, q, ONE, NO_ERRORS, 1e-3).state.sums)


@pytest.mark.long
def test_p_values_of_windows_that_share_a_sum_are_nearly_uniform():
    p_values = np.array([found.p_value for found in find_in_windows(np.random.default_rng(7), 4000, 100, 1e-3)])
    for level in (0.1, 0.05, 0.02, 0.01):
        error = (p_values < level).reshape(40, 100).mean(axis=1).std(ddof=1) / np.sqrt(40)
        # Shares of four sums, of which two see the same looks each, are a little too cautious.
        assert 0.85 * level - 3.0 * error < np.mean(p_values < level) < level + 3.0 * error
        assert error < 0.25 * level
    assert binomial_survival(np.sum(p_values < 1e-3), 4000, 1e-3) > 1e-3


@pytest.mark.long
def test_alarms_in_many_windows_at_one_percent():
    alarms = sum(found.seen is not None for found in find_in_windows(np.random.default_rng(6), 3000, 100, 0.01))
    assert binomial_survival(alarms, 3000, 0.01) > 1e-3
    assert alarms > 8
