"""The kernels of joint channels beside the same in plain matrices: they agree to a millionth of a sigma."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from tests.receiver.test_joint import noisy

from skyproof.gnss.signals import GPS_L1_CA
from skyproof.receiver import joint as j
from skyproof.receiver.components import LEFT, Candidates, newcomer
from skyproof.receiver.joint_model import JointModel

MODEL = JointModel(signal=GPS_L1_CA, code=GPS_L1_CA.code(7), rate_hz=2.6e6)
LOOK_S = MODEL.look_s


@st.composite
def states(draw, n=None):
    """One to three signals (n, N_STATE), at least 0.15 chips apart."""
    n = draw(st.integers(1, 3)) if n is None else n
    mean = np.zeros((n, j.N_STATE))
    size = np.sqrt([MODEL.energy(draw(st.floats(35.0, 50.0))) for _ in range(n)])
    turn = np.exp(2j * np.pi * np.array([draw(st.floats(0.0, 1.0)) for _ in range(n)]))
    mean[:, j.RE], mean[:, j.IM] = (size * turn).real, (size * turn).imag
    mean[:, j.HZ] = [draw(st.floats(-20.0, 20.0)) for _ in range(n)]
    mean[:, j.HZ_S] = draw(st.floats(-5.0, 5.0))
    mean[:, j.CHIPS] = draw(st.floats(-0.8, 0.0)) + np.cumsum([draw(st.floats(0.15, 0.5)) for _ in range(n)])
    mean[:, j.CHIPS_S] = 0.01
    return mean


def columns(mean, times_s):
    """What each fitted parameter changes in looks, and the signals themselves: (p, looks d), (looks d,)."""
    value, slope = MODEL.dictionary.at(mean[:, j.CHIPS])
    turn = j.turns(mean, times_s, LOOK_S)
    found, shown = [], 0.0
    for v, s, t, one in zip(value, slope, turn, mean, strict=True):
        a = one[j.RE] + 1j * one[j.IM]
        by_time = [t, 1j * t, 2j * np.pi * a * times_s * t, 1j * np.pi * a * times_s**2 * t]
        found += [np.outer(each, v).ravel() for each in by_time] + [np.outer(a * t, s).ravel()]
        shown = shown + np.outer(a * t, v).ravel()
    return np.array(found), shown


def plain_equations(looks, times_s, mean):
    jacobian, shown = columns(mean, times_s)
    left = looks.ravel() - shown
    information = 2.0 * (jacobian.conj() @ jacobian.T).real
    return information, 2.0 * (jacobian.conj() @ left).real, np.sum(np.abs(left) ** 2)


def fitted(n):
    """Which states are fitted."""
    return (np.arange(n)[:, None] * j.N_STATE + np.arange(j.N_FITTED)).ravel()


def drawn_covariance(rng, n):
    """Any covariance of about the size that a filter has."""
    sigmas = np.tile([1.0, 1.0, 0.3, 1.0, 0.02, 2e-3], n)
    mixed = rng.standard_normal((6 * n, 6 * n))
    return (mixed @ mixed.T / (6 * n) + 0.1 * np.eye(6 * n)) * np.outer(sigmas, sigmas)


@given(mean=states(), seed=st.integers(0, 99))
def test_normal_equations(mean, seed):
    times_s = MODEL.row_times_s
    looks = noisy(np.random.default_rng(seed), j.signals_in(mean, times_s, LOOK_S, MODEL.dictionary))
    off = mean + 0.01
    information, score, misfit = j.normal_equations(looks, times_s, LOOK_S, off, MODEL.dictionary)
    wanted, wanted_score, wanted_misfit = plain_equations(looks, times_s, off)
    scale = np.sqrt(np.diagonal(wanted))
    np.testing.assert_allclose(information / np.outer(scale, scale), wanted / np.outer(scale, scale), atol=1e-9)
    np.testing.assert_allclose(score / scale, wanted_score / scale, atol=1e-7)
    assert misfit == pytest.approx(wanted_misfit, rel=1e-9)


@given(mean=states(), seed=st.integers(0, 99))
def test_prediction(mean, seed):
    n, dt, s = len(mean), 0.02, MODEL.settings
    covariance = drawn_covariance(np.random.default_rng(seed), n)
    after = j.predict(j.Joint(mean=mean, covariance=covariance), dt)
    moved = j.carried(mean, dt, s.chips_per_cycle)
    np.testing.assert_allclose(after.mean, moved, rtol=1e-9, atol=1e-9)
    transition = np.zeros((6 * n, 6 * n))
    for state in range(6 * n):
        ahead, behind = mean.copy(), mean.copy()
        ahead.flat[state] += 1e-4
        behind.flat[state] -= 1e-4
        both = [j.carried(one, dt, s.chips_per_cycle).ravel() for one in (ahead, behind)]
        transition[:, state] = (both[0] - both[1]) / 2e-4
    # Phase, Doppler and its rate as integrals of white noise, each alone and all together.
    noise, cascade = np.zeros((6 * n, 6 * n)), np.zeros((6 * n, 3))
    for k in range(n):
        cascade[6 * k : 6 * k + 2, 0] = 2.0 * np.pi * np.array([-moved[k, j.IM], moved[k, j.RE]])
        cascade[6 * k + j.HZ, 1] = cascade[6 * k + j.HZ_S, 2] = 1.0

    def walk(phase, hz, hz_s):
        jerk = np.array(
            [[dt**5 / 20, dt**4 / 8, dt**3 / 6], [dt**4 / 8, dt**3 / 3, dt**2 / 2], [dt**3 / 6, dt**2 / 2, dt]]
        )
        drift = np.array([[dt**3 / 3, dt**2 / 2, 0], [dt**2 / 2, dt, 0], [0, 0, 0]])
        return hz_s**2 * jerk + hz**2 * drift + np.diag([phase**2 * dt, 0, 0])

    noise += cascade @ walk(s.common_phase_cyc, s.common_hz, s.common_hz_s) @ cascade.T
    for k in range(n):
        part, own = slice(6 * k, 6 * k + 6), cascade[6 * k : 6 * k + 6]
        noise[part, part] += own @ walk(s.own_phase_cyc, s.own_hz, s.own_hz_s) @ own.T
        noise[6 * k : 6 * k + 2, 6 * k : 6 * k + 2] += s.own_amplitude**2 * dt * np.outer(moved[k, :2], moved[k, :2])
        noise[6 * k + 4 : 6 * k + 6, 6 * k + 4 : 6 * k + 6] += s.own_chips_s**2 * walk(0, 1, 0)[:2, :2]
        noise[6 * k + 4, 6 * k + 4] += s.own_chips**2 * dt
    wanted = transition @ covariance @ transition.T + noise
    scale = np.sqrt(np.diagonal(wanted))
    np.testing.assert_allclose(after.covariance / np.outer(scale, scale), wanted / np.outer(scale, scale), atol=1e-6)


@given(mean=states(), seed=st.integers(0, 99), sign=st.sampled_from([-1.0, 1.0]))
def test_a_data_bit(mean, seed, sign):
    rng, n, times_s = np.random.default_rng(seed), len(mean), MODEL.bit_times_s
    before = j.Joint(mean=mean, covariance=drawn_covariance(rng, n))
    foretold = j.predict(before, MODEL.bit_s)
    truth = foretold.mean + rng.standard_normal(mean.shape) * np.array([1.0, 1.0, 0.1, 0.0, 0.01, 0.0])
    looks = sign * noisy(rng, j.signals_in(truth, times_s, LOOK_S, MODEL.dictionary))
    after, signs = j.follow(before, looks[None], times_s, LOOK_S, MODEL.bit_s, MODEL.dictionary)
    expected = j.signals_in(foretold.mean, times_s, LOOK_S, MODEL.dictionary)
    agreement = np.sum((expected.conj() * looks).real)
    assert signs[0] == (np.sign(agreement) if abs(agreement) > 1.0 else 0.0)
    if signs[0] == 0.0:
        return
    # Iterated in information form, steps of delays limited, until they are short.
    inverse, at = np.linalg.inv(foretold.covariance), foretold.mean
    for _ in range(4):
        information, score, _ = plain_equations(signs[0] * looks, times_s, at)
        wide, right = np.zeros_like(inverse), np.zeros(6 * n)
        wide[np.ix_(fitted(n), fitted(n))], right[fitted(n)] = information, score
        spread = np.linalg.inv(inverse + wide)
        new = foretold.mean + (spread @ (right + wide @ (at - foretold.mean).ravel())).reshape(mean.shape)
        step = np.clip(new[:, j.CHIPS] - at[:, j.CHIPS], -0.1, 0.1)
        new[:, j.CHIPS] = at[:, j.CHIPS] + step
        at = new
        if np.abs(step).max() < 3e-4:
            break
    sigma = np.sqrt(np.diagonal(spread))
    assert np.abs((after.mean - at).ravel() / sigma).max() < 1e-6
    np.testing.assert_allclose(after.covariance / np.outer(sigma, sigma), spread / np.outer(sigma, sigma), atol=1e-6)


def told_apart(mean, times_s):
    """Each amplitude is eight of its own sigmas by the Cramer-Rao bound, so that noise leaves one minimum nearby.

    Two signals of 35 dB-Hz that are 0.2 chips apart with one phase and Doppler are not: their least squares may have no
    minimum but where both are large and cancel each other.
    """
    sigma = np.sqrt(np.diagonal(j.bound(mean, times_s, LOOK_S, MODEL.dictionary))).reshape(-1, j.N_FITTED)
    amplitude = np.hypot(mean[:, j.RE], mean[:, j.IM])
    return np.all(amplitude > 8.0 * np.hypot(sigma[:, j.RE], sigma[:, j.IM]))


@settings(max_examples=30)
@given(mean=states(), seed=st.integers(0, 99))
def test_a_row(mean, seed):
    rng, times_s = np.random.default_rng(seed), MODEL.row_times_s
    assume(told_apart(mean, times_s))
    looks = noisy(rng, j.signals_in(mean, times_s, LOOK_S, MODEL.dictionary))
    row = j.fit_row(looks, times_s, LOOK_S, mean, MODEL.dictionary, steps=40)
    information, score, misfit = plain_equations(looks, times_s, row.mean)
    bound = np.linalg.inv(information)
    assert row.misfit == pytest.approx(misfit, rel=1e-9)
    assert 0.5 * score @ bound @ score < 1e-6  # nothing more to be gained
    sigma = np.sqrt(np.diagonal(bound))
    np.testing.assert_allclose(row.covariance / np.outer(sigma, sigma), bound / np.outer(sigma, sigma), atol=1e-6)


@settings(max_examples=20)
@given(mean=states(), apart=st.floats(-1.2, 1.2), hz=st.floats(-30.0, 30.0), seed=st.integers(0, 99))
def test_the_search_for_one_more(mean, apart, hz, seed):
    times_s = MODEL.bit_times_s
    further = np.zeros((1, j.N_STATE))
    further[0, [j.RE, j.HZ, j.CHIPS]] = 6.0, hz, apart
    there = np.concatenate([mean, further])
    looks = noisy(np.random.default_rng(seed), j.signals_in(there, times_s, LOOK_S, MODEL.dictionary))
    row = j.fit_row(looks, times_s, LOOK_S, mean, MODEL.dictionary)
    if not np.isfinite(row.covariance).all():
        return
    candidates = Candidates(np.linspace(-1.6, 1.6, 9), np.linspace(-60.0, 60.0, 7))
    score, state = newcomer(looks, times_s, LOOK_S, row, MODEL.dictionary, candidates)
    jacobian, shown = columns(row.mean, times_s)
    left = looks.ravel() - shown
    field, amplitude = np.empty((7, 9)), np.empty((7, 9), complex)
    for f, u in np.ndindex(7, 9):
        at = np.zeros((1, j.N_STATE))
        at[0, [j.RE, j.HZ, j.CHIPS]] = 1.0, candidates.hz[f], candidates.chips[u]
        both = columns(at, times_s)[0][:2]  # in phase and in quadrature
        cross = 2.0 * (both.conj() @ jacobian.T).real
        spread = 2.0 * np.sum(np.abs(both[0]) ** 2) * (1.0 + LEFT) * np.eye(2) - cross @ row.covariance @ cross.T
        seen = 2.0 * (both.conj() @ left).real
        best = np.linalg.solve(spread, seen)
        field[f, u], amplitude[f, u] = seen @ best, best[0] + 1j * best[1]
    f, u = np.unravel_index(np.argmax(field), field.shape)
    assert state[j.RE] + 1j * state[j.IM] == pytest.approx(amplitude[f, u], rel=1e-6)
    top, place = field[f, u], [candidates.hz[f], candidates.chips[u]]
    for axis, (line, i, step) in enumerate(((field[:, u], f, 20.0), (field[f], u, 0.4))):
        if 0 < i < line.size - 1:
            bend, slope = 2.0 * line[i] - line[i - 1] - line[i + 1], 0.5 * (line[i + 1] - line[i - 1])
            top += 0.5 * slope**2 / bend
            place[axis] += slope / bend * step
    assert score == pytest.approx(top, rel=1e-6)
    assert state[[j.HZ, j.CHIPS]] == pytest.approx(place, rel=1e-6, abs=1e-6)
