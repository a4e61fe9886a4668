"""Births and deaths: how often they are wrong, and that they come."""

import numpy as np
import pytest
from scipy import stats
from tests.receiver.test_joint import noisy

from skyproof.gnss.signals import GPS_L1_CA
from skyproof.receiver import joint as j
from skyproof.receiver.components import birth_threshold, born, faint, newcomer, unresolved
from skyproof.receiver.joint_model import JointModel

MODEL = JointModel(signal=GPS_L1_CA, code=GPS_L1_CA.code(7), rate_hz=5e6)
TIMES_S, LOOK_S = MODEL.row_times_s, MODEL.look_s


def rows(rng, model, count, n):
    """Rows of n known signals, 35 to 50 dB-Hz, any Doppler within 60 Hz, no two nearer than half a chip."""
    mean = np.zeros((count, n, j.N_STATE))
    energy = 10.0 ** (0.1 * rng.uniform(35.0, 50.0, (count, n))) * model.look_s
    amplitude = np.sqrt(energy) * np.exp(2j * np.pi * rng.random((count, n)))
    mean[..., j.RE], mean[..., j.IM] = amplitude.real, amplitude.imag
    mean[..., j.HZ] = rng.uniform(-55.0, 55.0, (count, 1)) + rng.uniform(-4.0, 4.0, (count, n))
    mean[..., j.CHIPS] = rng.uniform(-0.6, 0.6, (count, 1)) + 0.6 * np.arange(n)
    looks = noisy(rng, j.signals_in(mean, TIMES_S, LOOK_S, model.dictionary))
    return looks, j.fit_row(looks, TIMES_S, LOOK_S, mean, model.dictionary, steps=4), mean


def count_false_births(rng, model, runs, n, probability):
    threshold = birth_threshold(probability, model.dictionary, model.candidates, TIMES_S, LOOK_S)
    found = 0
    for _ in range(runs // 20):
        looks, row, _ = rows(rng, model, 20, n)
        score, _ = newcomer(looks, TIMES_S, LOOK_S, row, model.dictionary, model.candidates)
        found += int(np.sum(score > threshold))
    return found


def check_rate(found, runs, stated):
    """At most what is stated, and not less than a third: between the places of the search some height is lost."""
    assert stats.binom.sf(found - 1, runs, stated) > 1e-3, found
    assert stats.binom.cdf(found, runs, stated / 3.0) > 1e-3, found


@pytest.mark.long
def test_noise_is_taken_for_a_signal_as_often_as_stated():
    check_rate(count_false_births(np.random.default_rng(1), MODEL, 400, 1, 0.1), 400, 0.1)


@pytest.mark.long
@pytest.mark.parametrize(("n", "rate_hz"), [(1, 5e6), (2, 5e6), (1, 25e6)])
def test_noise_is_taken_for_a_signal_as_often_as_stated_in_thousands_of_rows(n, rate_hz):
    model = JointModel(signal=GPS_L1_CA, code=GPS_L1_CA.code(7), rate_hz=rate_hz)
    runs = 6000 if rate_hz < 10e6 else 1500
    check_rate(count_false_births(np.random.default_rng(n), model, runs, n, 0.01), runs, 0.01)


@pytest.mark.parametrize(("apart_chips", "apart_hz"), [(0.25, 0.0), (0.4, 3.0), (-0.6, 20.0), (1.0, -45.0)])
def test_a_newcomer_is_found_where_it_is(apart_chips, apart_hz):
    rng = np.random.default_rng(4)
    mean = np.zeros((2, j.N_STATE))
    mean[:, j.RE] = np.sqrt(MODEL.energy(45.0)) * np.array([1.0, 0.5])
    mean[1, j.IM] = 0.4 * mean[0, j.RE]
    mean[1, j.CHIPS], mean[1, j.HZ] = apart_chips, apart_hz
    looks = noisy(rng, j.signals_in(mean, TIMES_S, LOOK_S, MODEL.dictionary))
    alone = j.fit_row(looks, TIMES_S, LOOK_S, mean[:1], MODEL.dictionary)
    score, state = newcomer(looks, TIMES_S, LOOK_S, alone, MODEL.dictionary, MODEL.candidates)
    assert score > MODEL.threshold
    both, holds = born(looks, TIMES_S, LOOK_S, alone, state, MODEL.dictionary, MODEL.threshold)
    assert holds
    off = np.abs(both.mean[:, [j.CHIPS, j.HZ]] - mean[:, [j.CHIPS, j.HZ]])
    sigma = np.stack([both.sigma(j.CHIPS), both.sigma(j.HZ)], axis=-1)
    assert np.all(off < 4.5 * sigma)


def test_a_second_signal_that_the_row_cannot_resolve_is_not_born():
    rng = np.random.default_rng(5)
    mean = np.zeros((2, j.N_STATE))
    mean[:, j.RE] = np.sqrt(MODEL.energy(45.0))
    mean[1, j.CHIPS] = 0.03
    looks = noisy(rng, j.signals_in(mean, TIMES_S, LOOK_S, MODEL.dictionary))
    alone = j.fit_row(looks, TIMES_S, LOOK_S, mean[:1], MODEL.dictionary)
    _, state = newcomer(looks, TIMES_S, LOOK_S, alone, MODEL.dictionary, MODEL.candidates)
    _, holds = born(looks, TIMES_S, LOOK_S, alone, state, MODEL.dictionary, MODEL.threshold)
    assert not holds


def test_a_faint_signal_is_told_from_a_strong_one_and_a_pair_at_one_place_from_a_pair_apart():
    mean = np.zeros((2, j.N_STATE))
    mean[:, j.RE], mean[1, j.CHIPS] = (10.0, 2.0), 0.3
    covariance = np.eye(12) * 0.01
    strong = j.Joint(mean=mean, covariance=covariance)
    assert not faint(strong)[0]
    assert not unresolved(strong)
    is_faint, which = faint(j.Joint(mean=mean, covariance=covariance * 40.0))
    assert is_faint
    assert which == 1
    mean[1, j.CHIPS] = 0.1
    assert unresolved(j.Joint(mean=mean, covariance=covariance))
