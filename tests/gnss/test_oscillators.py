"""Two states for a clock: as far off as they state, by clocks that the simulator draws with flicker noise in them."""

import numpy as np
import pytest

from skyproof.gnss.oscillators import OSCILLATORS, PLATFORM_CLASSES, compute_clock_step
from skyproof.simulator.clocks import make_clock


@pytest.mark.parametrize("name", sorted(set(PLATFORM_CLASSES.values()) | {"tcxo-good"}))
def test_two_states_have_at_least_the_classs_allan_deviation(name):
    oscillator = OSCILLATORS[name]
    tau = np.geomspace(0.1, 1000.0, 25)
    white = compute_clock_step(oscillator, 1e-3)[1][0, 0] / 1e-3
    walk = compute_clock_step(oscillator, 1.0)[1][1, 1]
    found = np.sqrt(white / tau + walk * tau / 3.0)
    assert np.all(found >= oscillator.allan_deviation(tau) * (1 - 1e-3))
    middle = np.sqrt(white / 30.0 + walk * 10.0)
    assert middle == pytest.approx(oscillator.allan_deviation(30.0), rel=1e-3)


def test_steps_add_up():
    whole, noise = compute_clock_step(OSCILLATORS["ocxo"], 10.0)
    first, first_noise = compute_clock_step(OSCILLATORS["ocxo"], 4.0)
    second, second_noise = compute_clock_step(OSCILLATORS["ocxo"], 6.0)
    assert second @ first == pytest.approx(whole)
    assert second @ first_noise @ second.T + second_noise == pytest.approx(noise, rel=1e-12)


@pytest.mark.parametrize(("name", "least"), [("tcxo", 0.4), ("ocxo", 0.4), ("csac", 0.4), ("tcxo-good", 0.2)])
def test_clocks_are_off_as_far_as_predicted(name, least):
    # From the phase at two times 5 s apart to 30 s later; flicker noise is over-stated by design.
    squares = []
    for seed in range(60):
        phase = make_clock(name, seed=seed, duration_s=40.0).offset_s(np.array([0.0, 5.0, 35.0]))
        slope = (phase[1] - phase[0]) / 5.0
        _, noise = compute_clock_step(OSCILLATORS[name], 5.0)
        moves, later = compute_clock_step(OSCILLATORS[name], 30.0)
        back = np.array([1.0 / 5.0, -1.0])  # error of that slope as the drift at its end
        variance = moves[0, 1] ** 2 * (back @ noise @ back) + later[0, 0]
        squares.append((phase[2] - phase[1] - 30.0 * slope) ** 2 / variance)
    assert least < np.mean(squares) < 1.0 + 4.0 * np.sqrt(2.0 / len(squares))
