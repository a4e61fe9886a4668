"""Beats of all signals' power: a further sky's, a reflector's, a modulation's, and those of nothing in common."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from tests.detectors import nulls

from skyproof.detectors.correlators.beats import Line, find_line, fit_common_motion, mirror_p_value, weaker_p_value
from skyproof.detectors.correlators.beats_detector import Beats
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.navigation.directions import compute_directions
from skyproof.records import Cause, Finding, Records
from skyproof.testing import MeasuredScene

STEP_S = 0.02
LOOKS = 500
WAVELENGTH_M = SPEED_OF_LIGHT_M_S / 1575.42e6
SCENE = MeasuredScene(antennas_enu_m={"rx1": (0.0, 0.0, 0.0)}, epochs=50, step_s=0.2, max_satellites=10)


def beat(rng, rates_m_s, *, amplitude=0.3, scene=SCENE) -> Records:
    """Return a window whose signals have a second one each, at these rates (n,) beside them; NaN has none."""
    records = nulls.track(scene.records(rng))
    (o,), (taps,) = records.observations, records.taps
    at_s = STEP_S * np.arange(LOOKS)
    n = len(o.signals)
    second = np.nan_to_num(amplitude * np.exp(2j * np.pi * at_s[:, None] * np.asarray(rates_m_s)[:n] / WAVELENGTH_M))
    second = second * np.exp(2j * np.pi * rng.random(n))
    noise = 0.06 * (rng.standard_normal((LOOKS, n)) + 1j * rng.standard_normal((LOOKS, n)))
    value = (1.0 + second + noise)[:, :, None, None].astype(np.complex64)
    return replace(records, taps=(replace(taps, elapsed_s=at_s, value=value),))


def read_directions(records: Records) -> np.ndarray:
    """Return the rows (n, 4) of the geometry of a window's signals."""
    (o,) = records.observations
    directions = compute_directions(o, records.navigation, o.signals)
    assert directions is not None
    return np.nan_to_num(directions.design)


def examine(records: Records) -> Finding:
    (found,) = Beats().examine(records)[0]
    return found


def move(state, seed=0, **changes) -> Records:
    """Return a window with a further sky that moves, and whose clock runs, by these (4,) beside the tracked one."""
    rates_m_s = read_directions(beat(np.random.default_rng(seed), np.zeros(10))) @ np.asarray(state)
    return beat(np.random.default_rng(seed), rates_m_s, **changes)


@pytest.mark.parametrize("amplitude", [0.1, 0.3, 1.0, 3.0])
@pytest.mark.parametrize("state", [(1.0, 0.4, -0.6, 0.0), (0.3, 0.9, 0.5, 1.5), (-6.0, 5.0, 2.0, 0.0)])
def test_a_further_sky_is_an_attack(state, amplitude):
    # The last one moves by 8 m/s: some lines repeat with the rate of looks.
    found = examine(move(state, amplitude=amplitude))
    assert found.says == "attack"
    assert found.data["motion_m_s"] == pytest.approx(np.linalg.norm(state[:3]), rel=0.02)
    assert abs(found.data["clock_m_s"] - abs(state[3])) < 0.02


def test_a_slow_sky_shows_in_two_windows():
    # At 0.4 m/s few lines are fast enough to be sure after one window.
    state = np.array([0.3, 0.2, -0.17, 0.0])
    records = move(state, amplitude=0.3)
    (o,), (taps,) = records.observations, records.taps
    at_s = STEP_S * np.arange(2 * LOOKS)
    rates_m_s = read_directions(records) @ state
    phases = np.random.default_rng(1).random(len(o.signals))
    value = (1.0 + 0.3 * np.exp(2j * np.pi * (at_s[:, None] * rates_m_s / WAVELENGTH_M + phases)))[:, :, None, None]
    detector, remembered, p_values = Beats(), None, []
    for half in (slice(0, LOOKS), slice(LOOKS, None)):
        looks = replace(taps, elapsed_s=at_s[half], value=value[half].astype(np.complex64))
        (found,), remembered = detector.examine(replace(records, taps=(looks,)), remembered)
        p_values.append(found.p[Cause.CLEAN])
    assert p_values[1] < 0.1 * p_values[0]
    assert found.data["motion_m_s"] == pytest.approx(np.linalg.norm(state[:3]), rel=0.02)


def test_two_lines_of_others_hide_nothing():
    rates_m_s = read_directions(beat(np.random.default_rng(1), np.zeros(10))) @ [2.0, 1.1, -1.6, 0.0]
    rates_m_s[[2, 7]] = 1.9, np.nan
    found = examine(beat(np.random.default_rng(1), rates_m_s))
    assert found.says == "attack"
    assert len(found.signals) == 8


def test_one_modulation_of_all_signals_stays_open():
    found = examine(move((0.0, 0.0, 0.0, 1.2)))
    assert found.says == "undecided"
    assert {Cause.INTERFERENCE, Cause.FAULT} < set(found.may_also_be)


@pytest.mark.parametrize(("amplitude", "stands"), [(0.3, False), (0.7, False), (1.4, False), (0.3, True), (1.0, False)])
def test_an_image_of_a_moving_antenna_stays_open_unless_it_is_as_strong_as_the_sky(amplitude, stands):
    # The antenna moves at 1 m/s towards a wall: its image moves at 2 m/s beside it.
    velocity_m_s = np.array([0.6, -0.48, 0.64])
    records = move((*(-2.0 * velocity_m_s), 0.0), amplitude=amplitude)
    (o,) = records.observations
    attack = stands or amplitude == 1.0
    dopplers_hz = o.doppler_hz - (read_directions(records)[:, :3] @ -velocity_m_s) / WAVELENGTH_M
    for sign in (1.0, -1.0):  # whichever way the design's rows point
        moved = replace(o, doppler_hz=o.doppler_hz + sign * (dopplers_hz - o.doppler_hz))
        known = {"rx1": object()} if stands else {}
        found = examine(replace(records, observations=(moved,), standing=known))
        assert found.code == "together"
        assert (found.says == "attack") == attack
        assert attack or found.may_also_be == (Cause.REFLECTIONS,)


def test_a_reflector_that_moves_has_all_satellites_before_it():
    # Straight up, as a position that is drawn upwards: above the antenna stand all.
    records = beat(np.random.default_rng(0), np.zeros(10))
    directions = read_directions(records)[:, :3]
    up = directions.sum(axis=0) / np.linalg.norm(directions.sum(axis=0))
    assert (directions @ up).min() > 0.0
    found = examine(move((*(3.0 * up), 0.0)))
    assert found.may_also_be == (Cause.REFLECTIONS,)


def test_a_street_of_two_parallel_walls_stays_open():
    # Fast enough for lines that repeat with the rate of looks: the clock's rate is known but for that.
    rng, repeated_m_s = np.random.default_rng(7), WAVELENGTH_M / STEP_S
    design = read_directions(move((0.0, 0.0, 0.0, 0.0)))
    explained = 0
    for _ in range(40):
        velocity_m_s, normal = (8.0 * rng.standard_normal(3) for _ in range(2))
        normal /= np.linalg.norm(normal)
        rates_m_s = np.abs(design[:, :3] @ (-2.0 * (velocity_m_s @ normal) * normal))
        rates_m_s = np.abs(rates_m_s - repeated_m_s * np.rint(rates_m_s / repeated_m_s))
        lines = [Line(float(rate) / WAVELENGTH_M, 0.01, 1e4) for rate in rates_m_s]
        motion = fit_common_motion(lines, np.full(10, WAVELENGTH_M), design, STEP_S)
        explained += motion is not None and motion.p_value < 1e-7
        assert motion is None or mirror_p_value(motion, velocity_m_s, 1e-4 * np.eye(3)) > 1e-3
    assert explained > 20


def test_reflections_of_several_walls_are_none():
    # Lines of all signals, log-uniform and of nothing in common: below 0.1 lies no more than a tenth.
    rng = np.random.default_rng(2)
    p_values = []
    for _ in range(100):
        p = examine(beat(rng, np.exp(rng.uniform(np.log(0.06), np.log(4.0), 10)))).p
        p_values.append(p[Cause.CLEAN])
    for asked in (0.1, 0.01):
        assert stats.binomtest(int((np.array(p_values) < asked).sum()), 100, asked, alternative="greater").pvalue > 1e-3


@pytest.mark.parametrize("amplitude", [10.0**-0.15, 10.0**0.15])
def test_a_reflection_of_3_db_less_is_rarely_taken_for_an_equal_signal(amplitude):
    rng, equal = np.random.default_rng(5), 0
    at_s = STEP_S * np.arange(LOOKS)
    for _ in range(1000):
        turning = amplitude * np.exp(2j * np.pi * (rng.uniform(0.5, 20.0) * at_s + rng.random()))
        noise = 0.05 * (rng.standard_normal(LOOKS) + 1j * rng.standard_normal(LOOKS))
        line = find_line(np.abs(1.0 + turning + noise) ** 2, STEP_S)
        equal += weaker_p_value([line]) < 1.0
    assert stats.binomtest(equal, 1000, 1e-4, alternative="greater").pvalue > 1e-3


def test_noise_has_no_lines():
    rng = np.random.default_rng(3)
    found = sum(find_line(rng.chisquare(2, LOOKS), STEP_S) is not None for _ in range(2000))
    assert stats.binomtest(found, 2000, 1e-4, alternative="greater").pvalue > 1e-3


def test_few_signals_are_not_tested():
    records = beat(np.random.default_rng(4), np.zeros(10), scene=replace(SCENE, max_satellites=5))
    assert examine(records).code == "few_signals"
