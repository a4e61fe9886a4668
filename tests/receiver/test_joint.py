"""Signals of one satellite within a chip and a half in one filter: its mathematics, and its errors beside its bound."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyproof.gnss.signals import GPS_L1_CA
from skyproof.receiver import joint as j
from skyproof.receiver.joint_model import JointModel

RATE_HZ = 5e6
MODEL = JointModel(signal=GPS_L1_CA, code=GPS_L1_CA.code(7), rate_hz=RATE_HZ)
RHO = MODEL.settings.chips_per_cycle


def signals(apart_chips, relative_db, apart_hz, *, cn0_dbhz=45.0, phase_cyc=0.1, count=1):
    """States (count, 2, N_STATE) of two signals about the replica."""
    mean = np.zeros((count, 2, j.N_STATE))
    energy = MODEL.energy(cn0_dbhz) * 10.0 ** (0.1 * np.array([0.0, relative_db]))
    turn = np.exp(2j * np.pi * np.stack([np.zeros(count), np.broadcast_to(phase_cyc, count)], axis=-1))
    mean[..., j.RE], mean[..., j.IM] = (np.sqrt(energy) * turn).real, (np.sqrt(energy) * turn).imag
    mean[:, 1, j.HZ] = apart_hz
    mean[:, 0, j.CHIPS], mean[:, 1, j.CHIPS] = -0.5 * apart_chips, 0.5 * apart_chips
    return mean


def noisy(rng, looks):
    return looks + (rng.standard_normal(looks.shape) + 1j * rng.standard_normal(looks.shape)) * np.sqrt(0.5)


def seen(mean, times_s):
    return j.signals_in(mean, times_s, MODEL.look_s, MODEL.dictionary)


@given(apart=st.floats(0.05, 1.5), hz=st.floats(-50.0, 50.0), phase=st.floats(0.0, 1.0), parameter=st.integers(0, 9))
def test_the_score_is_the_slope_of_the_misfit(apart, hz, phase, parameter):
    # All of it but the loss within a look, which is left out of the slope by Doppler.
    mean = signals(apart, -3.0, hz, phase_cyc=phase)[0]
    rng = np.random.default_rng(1)
    looks = noisy(rng, seen(mean, MODEL.bit_times_s))
    _, score, misfit = j.normal_equations(looks, MODEL.bit_times_s, MODEL.look_s, mean, MODEL.dictionary)
    signal, column = divmod(parameter, j.N_FITTED)
    step = 1e-5

    def misfit_at(change):
        moved = mean.copy()
        moved[signal, column] += change
        return np.sum(np.abs(looks - seen(moved, MODEL.bit_times_s)) ** 2)

    assert misfit == pytest.approx(misfit_at(0.0))
    slope = -(misfit_at(step) - misfit_at(-step)) / (2.0 * step)
    loss = 2.0 if column == j.HZ else 0.0
    assert score[parameter] == pytest.approx(slope, abs=1e-3 * abs(slope) + 2e-3 + loss)


def test_the_information_is_the_spread_of_the_score():
    mean, rng = signals(0.4, -3.0, 7.0, count=2000), np.random.default_rng(2)
    looks = noisy(rng, seen(mean, MODEL.bit_times_s))
    information, score, _ = j.normal_equations(looks, MODEL.bit_times_s, MODEL.look_s, mean, MODEL.dictionary)
    counted = score.T @ score / len(score)
    scale = np.sqrt(np.diagonal(information[0]))
    np.testing.assert_allclose(counted / np.outer(scale, scale), information[0] / np.outer(scale, scale), atol=0.12)


@given(first_s=st.floats(-0.2, 0.2), then_s=st.floats(-0.2, 0.2))
def test_two_steps_carry_as_one(first_s, then_s):
    mean = signals(0.5, 3.0, 20.0)
    mean[..., j.HZ_S], mean[..., j.CHIPS_S] = 3.0, 0.01
    np.testing.assert_allclose(
        j.carried(j.carried(mean, first_s, RHO), then_s, RHO), j.carried(mean, first_s + then_s, RHO), atol=1e-9
    )


def follow(joint, looks):
    """One data bit on: looks (..., n_looks, d)."""
    joint, signs = j.follow(
        joint, looks[..., None, :, :], MODEL.bit_times_s, MODEL.look_s, MODEL.bit_s, MODEL.dictionary
    )
    return joint, signs[..., 0]


def followed(rng, mean, bits):
    """A filter over so many bits of the signals (count, 2, N_STATE), with random data: its last state, the truth, and
    the last ten bits wiped off.
    """
    start = mean.copy()
    spread = np.array([1.0, 1.0, 0.3, 0.3, 0.02, 1e-3])
    start += rng.standard_normal(mean.shape) * spread
    covariance = np.broadcast_to(np.diag(np.tile(spread, 2) ** 2), (len(mean), 12, 12))
    joint, wiped = j.Joint(mean=start, covariance=covariance), []
    for _ in range(bits):
        mean = j.carried(mean, 0.02, RHO)
        data = rng.choice([-1.0, 1.0], len(mean))[:, None, None]
        looks = noisy(rng, data * seen(mean, MODEL.bit_times_s))
        joint, sign = follow(joint, looks)
        wiped.append(sign[:, None, None] * looks)
    return joint, mean, np.concatenate(wiped[-10:], axis=1)


@pytest.mark.parametrize(
    ("apart_chips", "relative_db", "apart_hz"), [(0.3, 0.0, 0.0), (0.5, -6.0, 0.0), (0.5, 6.0, 10.0), (1.2, -6.0, 50.0)]
)
def test_both_are_followed_and_a_row_is_at_the_bound(apart_chips, relative_db, apart_hz):
    rng = np.random.default_rng(3)
    truth = signals(apart_chips, relative_db, apart_hz, phase_cyc=rng.random(120), count=120)
    joint, last, looks = followed(rng, truth, 30)
    error = joint.mean[..., j.CHIPS] - last[..., j.CHIPS]
    assert np.abs(error).max() < 0.5 * apart_chips
    # The signals stand still and the filter allows for motion: it says too much rather than too little.
    assert np.mean((error / joint.sigma(j.CHIPS)) ** 2) < 1.35
    middle = j.carried(last, -0.09, RHO)
    start = j.carried(joint.mean, -0.09, RHO)
    row = j.fit_row(looks, MODEL.row_times_s, MODEL.look_s, start, MODEL.dictionary)
    limit = j.bound(middle, MODEL.row_times_s, MODEL.look_s, MODEL.dictionary)
    for column in (j.HZ, j.CHIPS):
        off = row.mean[..., column] - middle[..., column]
        at_best = np.diagonal(limit, axis1=-2, axis2=-1)[..., column :: j.N_FITTED]
        ratio = np.sqrt(np.mean(off**2 / at_best, axis=0))
        assert np.all((ratio > 0.8) & (ratio < 1.2)), ratio
        stated = np.mean(off**2 / row.sigma(column) ** 2)
        assert 0.7 < stated < 1.4


def test_signals_that_stand_together_have_no_bound_and_say_so():
    mean = signals(0.0, -3.0, 0.0, phase_cyc=0.0)
    assert np.isinf(j.bound(mean, MODEL.row_times_s, MODEL.look_s, MODEL.dictionary)).all()
    near = signals(0.05, -3.0, 0.0, phase_cyc=0.0)
    limit = j.bound(near, MODEL.row_times_s, MODEL.look_s, MODEL.dictionary)
    assert np.sqrt(limit[0, j.CHIPS, j.CHIPS]) > 0.02  # of 0.05: not to be told apart in a row


def test_a_bit_in_which_nothing_is_seen_teaches_nothing():
    mean = signals(0.5, 0.0, 0.0)[0]
    joint = j.Joint(mean=mean, covariance=np.eye(12) * 0.1)
    silent = np.zeros((5, MODEL.dictionary.value.shape[1]), np.complex128)
    after, sign = follow(joint, silent)
    assert sign == 0.0
    as_foretold = j.predict(joint, MODEL.bit_s)
    np.testing.assert_array_equal(after.mean, as_foretold.mean)
    np.testing.assert_array_equal(after.covariance, as_foretold.covariance)


@pytest.mark.parametrize("count", [1, 10, 12])  # as many channels as parameters or states, too
def test_channels_and_bits_at_once_are_as_one_by_one(count):
    rng = np.random.default_rng(6)
    mean = signals(0.5, -3.0, 5.0, phase_cyc=rng.random(count), count=count)
    looks = np.stack([noisy(rng, seen(j.carried(mean, t, RHO), MODEL.bit_times_s)) for t in (0.02, 0.04, 0.06)], axis=1)
    covariance = np.broadcast_to(np.diag(np.tile([1.0, 1.0, 0.3, 0.3, 0.02, 1e-3], 2) ** 2), (count, 12, 12))
    together, signs = j.follow(
        j.Joint(mean=mean, covariance=covariance),
        looks,
        MODEL.bit_times_s,
        MODEL.look_s,
        MODEL.bit_s,
        MODEL.dictionary,
    )
    for one in range(count):
        alone = j.Joint(mean=mean[one], covariance=covariance[one])
        for bit in range(3):
            alone, sign = follow(alone, looks[one, bit])
            assert sign == signs[one, bit]
        np.testing.assert_array_equal(together.mean[one], alone.mean)
        np.testing.assert_array_equal(together.covariance[one], alone.covariance)
