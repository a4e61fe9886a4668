"""Changes within a snapshot: found where they are, and hardly ever where there is none."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyproof.receiver.snapshot_changes import find_change


def draw_sums(rng, n_parts=4, n_antennas=4, amplitude=30.0):
    """Sums of a signal of any phase in each part, and of noise."""
    direction = np.exp(2j * np.pi * rng.random(n_antennas))
    phases = np.exp(2j * np.pi * rng.random(n_parts))
    return amplitude * phases[:, None] * direction + draw_noise(rng, n_parts, n_antennas)


def draw_noise(rng, n_parts, n_antennas):
    parts = rng.standard_normal((2, n_parts, n_antennas)) / np.sqrt(2.0)
    return parts[0] + 1j * parts[1]


@given(st.integers(0, 2**32 - 1), st.integers(2, 16), st.integers(1, 24), st.floats(2.0, 300.0))
def test_a_signal_that_stays_what_it_is_does_not_change(seed, n_parts, n_antennas, amplitude):
    assert find_change(draw_sums(np.random.default_rng(seed), n_parts, n_antennas, amplitude)) is None


@given(st.integers(0, 2**32 - 1))
def test_a_signal_that_fades_to_half_does_not_change(seed):
    sums = draw_sums(np.random.default_rng(seed), amplitude=100.0)
    sums[2:] *= 0.5
    assert find_change(sums) is None


def test_the_chance_of_a_turn_is_uniform_without_one(monkeypatch):
    monkeypatch.setattr("skyproof.receiver.snapshot_changes._TURNED", 0.0)
    monkeypatch.setattr("skyproof.receiver.snapshot_changes.CHANCE", np.inf)
    rng = np.random.default_rng(4)
    p_values = [find_change(draw_sums(rng, n_parts=2, amplitude=30.0)).p_value for _ in range(2000)]
    for p in (0.01, 0.1, 0.5):
        assert abs(np.mean(np.array(p_values) < p) - p) < 4.0 * np.sqrt(p * (1.0 - p) / 2000)


@pytest.mark.parametrize("part", [1, 2, 3])
def test_a_signal_from_elsewhere_from_a_part_on_is_found(part):
    rng = np.random.default_rng(part)
    sums = np.concatenate([draw_sums(rng)[:part], draw_sums(rng)[part:]])
    change = find_change(sums)
    assert (change.kind, change.part) == ("turns", part)


@pytest.mark.parametrize("part", [1, 2, 3])
@pytest.mark.parametrize("n_antennas", [1, 4])
def test_a_signal_that_begins_or_ends_is_found(part, n_antennas):
    rng = np.random.default_rng(part)
    sums = np.concatenate([draw_noise(rng, part, n_antennas), draw_sums(rng, n_antennas=n_antennas)[part:]])
    change = find_change(sums)
    assert (change.kind, change.part) == ("begins", part)
    change = find_change(sums[::-1])
    assert (change.kind, change.part) == ("ends", 4 - part)
