"""Lines that a second signal of the same satellite leaves in the correlators of the first."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from tests.detectors.nulls import CHIP_M, DELAYS_CHIPS, LOOK_S, draw_looks

from skyproof.detectors.correlators.correlator_laws import triangle
from skyproof.detectors.correlators.second_component import (
    OTHER_CHIPS,
    TWO_REFLECTIONS,
    _compute_spectrum,
    combine_smallest,
    distortion,
    earlier,
    line_p_value,
    pair_taps,
    reflection_amplitude,
)


def give_both(value):
    return distortion(value, DELAYS_CHIPS, LOOK_S), earlier(value, DELAYS_CHIPS, LOOK_S)


def test_a_single_bin_has_the_stated_law():
    rng = np.random.default_rng(1)
    mixed = rng.standard_normal((3, 3)) + 1j * rng.standard_normal((3, 3))
    bins = (rng.standard_normal((4000, 13, 3)) + 1j * rng.standard_normal((4000, 13, 3))) @ mixed
    tested, rest = bins[:, 0], bins[:, 1:]
    scatter = np.linalg.inv(np.einsum("tki,tkj->tij", rest, rest.conj()))
    odds = np.real(np.einsum("ti,tij,tj->t", tested.conj(), scatter, tested))
    assert stats.kstest(line_p_value(odds, 3, 12), "uniform").pvalue > 1e-3


@pytest.mark.parametrize(
    ("cn0_dbhz", "trials"),
    [(35.0, 150), (50.0, 150), *(pytest.param(c, 4000, marks=pytest.mark.long) for c in (35.0, 40.0, 45.0, 50.0))],
)
def test_p_values_of_one_signal_are_uniform_or_conservative(cn0_dbhz, trials):
    rng = np.random.default_rng(2)
    found = [give_both(draw_looks(rng, cn0_dbhz, 200)) for _ in range(trials)]
    p_values = np.array([any_line.p_value for any_line, _ in found])
    # The smallest of neighbouring bins, which estimate their noise from each other, is taken for that of independent
    # ones: of 12 000 p-values 1.5 % too many lie below 0.9. Where decisions are made nothing of it is left.
    assert stats.kstest(p_values, "uniform").statistic < 0.02 + 1.95 / np.sqrt(trials)
    for level in (0.01, 0.05):
        assert stats.binomtest(int(np.sum(p_values < level)), trials, level).pvalue > 1e-3
    assert min(early.p_value for _, early in found) > 0.1 / trials


def test_what_the_tracked_signal_does_itself_is_no_distortion():
    # It fades, its phase and its code wander, and the front end is lopsided; the noise stays what it is.
    rng = np.random.default_rng(3)
    t = LOOK_S * np.arange(500)
    fading = (1.0 + 0.3 * np.sin(2 * np.pi * 0.7 * t)) * np.exp(0.2j * np.sin(2 * np.pi * 3.1 * t))
    wander_chips = 0.01 * np.sin(2 * np.pi * 0.4 * t)[:, None]
    far = np.abs(DELAYS_CHIPS) > 0.3  # near the top a triangle's error is not odd, a front end's is
    for _ in range(20):
        alone = draw_looks(rng, 45.0)
        moved = np.where(far, triangle(DELAYS_CHIPS + wander_chips), triangle(DELAYS_CHIPS))
        value = alone - triangle(DELAYS_CHIPS) + fading[:, None] * (moved + 0.05 * DELAYS_CHIPS)
        assert distortion(value[:, 1:][:, [0, 2, 3, 4, 5]], DELAYS_CHIPS[[1, 3, 4, 5, 6]], LOOK_S).p_value > 1e-3


def test_a_second_signal_shows_at_its_beat():
    value = draw_looks(np.random.default_rng(4), 40.0, second=0.2, lag_chips=0.5, beat_hz=7.3)
    line = distortion(value, DELAYS_CHIPS, LOOK_S)
    assert line.p_value < 1e-12
    assert line.frequency_hz == pytest.approx(7.3, abs=0.1)


def test_a_beat_that_drifts_does_not_hide_itself():
    rng = np.random.default_rng(5)
    t = LOOK_S * np.arange(500)
    drifting = 0.3 * np.exp(2j * np.pi * (7.0 * t + 0.05 * t**2))[:, None] * triangle(DELAYS_CHIPS + 0.5)
    assert distortion(draw_looks(rng, 45.0) + drifting, DELAYS_CHIPS, LOOK_S).p_value < 1e-12


@settings(max_examples=60, deadline=None)
@given(
    lag_chips=st.floats(-0.1, float(OTHER_CHIPS.max())),
    second=st.floats(0.0, 0.95),
    beat_hz=st.floats(-24.0, 24.0),
    cn0_dbhz=st.floats(35.0, 50.0),
    seed=st.integers(0, 1000),
)
def test_a_reflection_never_comes_before_its_signal(lag_chips, second, beat_hz, cn0_dbhz, seed):
    value = draw_looks(np.random.default_rng(seed), cn0_dbhz, second=second, lag_chips=lag_chips, beat_hz=beat_hz)
    assert earlier(value, DELAYS_CHIPS, LOOK_S).p_value > 1e-4


@settings(max_examples=30, deadline=None)
@given(
    lag_chips=st.floats(-1.4, -0.4),
    beat_hz=st.floats(2.5, 24.0) | st.floats(-24.0, -2.5),
    seed=st.integers(0, 1000),
)
def test_a_signal_before_the_tracked_one_is_seen_there(lag_chips, beat_hz, seed):
    value = draw_looks(np.random.default_rng(seed), 45.0, second=0.5, lag_chips=lag_chips, beat_hz=beat_hz)
    line = earlier(value, DELAYS_CHIPS, LOOK_S)
    assert line.p_value < 1e-8
    assert line.lag_chips == pytest.approx(lag_chips, abs=0.3)


def test_what_two_lags_explain_is_the_projection_on_both():
    rng = np.random.default_rng(2)
    spectrum = _compute_spectrum(
        draw_looks(rng, 45.0, second=0.3, lag_chips=0.5, beat_hz=4.0).astype(complex), LOOK_S, least_hz=2.0
    )
    shape = triangle(DELAYS_CHIPS[:, None] + OTHER_CHIPS)
    found = spectrum.by_two(shape, TWO_REFLECTIONS)
    for row, pair in ((17, 3), (200, 0), (99, len(TWO_REFLECTIONS) - 1)):
        two, inverse, line = shape[:, TWO_REFLECTIONS[pair]], spectrum.inverse[row], spectrum.bins[row]
        seen, gram = two.T @ inverse @ line, two.T @ inverse @ two
        assert found[row, pair] == pytest.approx(np.real(seen.conj() @ np.linalg.solve(gram, seen)))


def test_two_reflections_of_one_beat_come_after_their_signal():
    for seed in range(20):
        rng = np.random.default_rng(seed)
        value = draw_looks(rng, 46.0, second=0.6, lag_chips=rng.uniform(0.3, 0.8), beat_hz=2.8)
        other = draw_looks(rng, 46.0, second=0.4, lag_chips=rng.uniform(0.0, 0.2), beat_hz=2.9) - triangle(DELAYS_CHIPS)
        assert earlier(value + other, DELAYS_CHIPS, LOOK_S).p_value > 1e-4


def test_reflections_that_are_allowed_for_are_not_counted():
    # As many times the allowed error as its own law has it: half of them within 0.7 sigma, and few beyond three.
    rng = np.random.default_rng(6)
    allowed = reflection_amplitude(1.0, 0.125, CHIP_M)
    assert allowed == pytest.approx(1.0 / (0.125 * CHIP_M))
    p_values = []
    for _ in range(100):
        size = abs(rng.standard_normal() + 1j * rng.standard_normal()) * np.sqrt(0.5) * allowed
        value = draw_looks(rng, 47.0, second=size, lag_chips=rng.uniform(0.1, 1.4), beat_hz=rng.uniform(0.3, 20.0))
        p_values.append(distortion(value, DELAYS_CHIPS, LOOK_S, allowed=allowed).p_value)
    assert np.mean(np.array(p_values) < 0.05) < 0.15
    strong = draw_looks(rng, 47.0, second=12.0 * allowed, lag_chips=0.7, beat_hz=3.0)
    assert distortion(strong, DELAYS_CHIPS, LOOK_S, allowed=allowed).p_value < 1e-4


def test_pairs_stand_evenly_about_the_prompt():
    assert pair_taps(np.array([0.5, 0.0, -0.5, 1.0])) == [(0, 2, 1)]
    assert pair_taps(np.array([0.5, -0.5])) == []


def test_p_values_of_several_are_made_one():
    assert combine_smallest(0.01, 1) == pytest.approx(0.01)
    assert combine_smallest(0.01, 10) == pytest.approx(1.0 - 0.99**10)
    assert combine_smallest(1.0, 5) == pytest.approx(1.0)
