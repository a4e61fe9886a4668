"""Steps of a few seconds: their laws on both sides."""

import numpy as np
import pytest
from scipy import stats

from skyproof.detectors.levels.laws import OwnScale
from skyproof.detectors.levels.parts import WindowPart, combine_two, find_power_step, learn_steps, list_steps

KIND = ("G", "L1", "CA")
CHAIN = ("L1", "noise")
FADING_DB = 2.0
N = 9


def draw_parts(rng: np.random.Generator, n: int, *, levels_db: float = 1.0, inputs: float = 0.4) -> list[WindowPart]:
    """Draw random walks of levels and of what comes in, by a part of two seconds."""
    walks = np.cumsum(levels_db * rng.standard_normal((n, N)), axis=0)
    power = np.cumsum(inputs * rng.standard_normal(n))
    return [
        WindowPart(
            start_s=2.0 * k,
            stop_s=2.0 * k + 1.0,
            levels_db={(f"G{sat:02d}", "L1", "CA"): float(walks[k, sat - 1]) for sat in range(1, N + 1)},
            inputs={CHAIN: float(power[k])},
        )
        for k in range(n)
    ]


def find_entered(parts: list[WindowPart], own: dict, *, stands: bool):
    steps = list_steps(parts, {}, FADING_DB)
    return find_power_step(steps, KIND, "L1", own, fading_db=FADING_DB, common_db=0.5, stands=stands)


@pytest.mark.parametrize("stands", [True, False])
@pytest.mark.parametrize("size", [0.3, 1.0])
def test_a_random_walk_enters_at_its_rate(stands: bool, size: float) -> None:
    # Draw walks of the stated law and smaller ones, whose scale is learnt: p-values are no smaller than stated.
    rng = np.random.default_rng(46)
    p_values = []
    for _ in range(300):
        parts, own = draw_parts(rng, 22, levels_db=0.9 * size, inputs=0.45 * size), {}
        for first in range(0, 15, 5):
            own = learn_steps(own, list_steps(parts[first : first + 7], {}, FADING_DB), frozenset())
        found = find_entered(parts[15:], own, stands=stands)
        assert found is not None
        p_values.append(found.p_value)
    for asked in (0.1, 0.01):
        assert stats.binomtest(int(np.sum(np.array(p_values) < asked)), 300, asked, alternative="greater").pvalue > 1e-4


def test_the_product_of_two_p_values_has_its_law() -> None:
    pairs = np.random.default_rng(1).random((4000, 2))
    together = [combine_two(first, second) for first, second in pairs.tolist()]
    assert stats.kstest(together, "uniform").pvalue > 1e-3
    assert combine_two(0.0, 0.0) < 1e-290


def test_a_step_inside_a_part_counts_in_full() -> None:
    # The part in which signals rise lies half before and half after.
    parts = draw_parts(np.random.default_rng(2), 7, levels_db=0.05, inputs=0.02)
    raised = [
        part._replace(
            levels_db={sent: value + rise_db for sent, value in part.levels_db.items()}, inputs={CHAIN: rise_db / 2.0}
        )
        for part, rise_db in zip(parts, (0.0, 0.0, 0.0, 3.0, 6.0, 6.0, 6.0), strict=True)
    ]
    found = find_entered(raised, {KIND: OwnScale(0.1, 20.0), CHAIN: OwnScale(0.1, 20.0)}, stands=False)
    assert found is not None
    assert found.rise_db == pytest.approx(6.0, abs=0.3)
    assert found.p_value < 1e-9
    assert found.p_alike > 1e-3  # as an amplifier that is switched on


def test_a_pause_between_parts_is_no_step() -> None:
    parts = draw_parts(np.random.default_rng(3), 7)
    paused = [part if k < 4 else part._replace(start_s=part.start_s + 9.0, stop_s=part.stop_s + 9.0)
              for k, part in enumerate(parts)]  # fmt: skip
    assert len(list_steps(parts, {}, FADING_DB)) == 5
    assert len(list_steps(paused, {}, FADING_DB)) == 3


def test_steps_under_interference_are_not_learnt() -> None:
    steps = list_steps(draw_parts(np.random.default_rng(4), 7), {}, FADING_DB)
    assert set(learn_steps({}, steps, frozenset({KIND}))) == {CHAIN}
    assert learn_steps({}, steps, frozenset())[KIND].seen == 5.0


def test_what_comes_back_to_its_own_level_has_not_risen() -> None:
    # Noise that ends, or shade: signals are where they were before.
    parts = draw_parts(np.random.default_rng(5), 7, levels_db=0.0)
    back = [
        part._replace(levels_db={sent: fall_db for sent in part.levels_db})
        for part, fall_db in zip(parts, (-8.0, -8.0, -8.0, -2.0, 0.0, 0.0, 0.0), strict=True)
    ]
    own_db = dict.fromkeys(parts[0].levels_db, 0.0)
    assert max(max(step.risen.values()) for step in list_steps(back, own_db, FADING_DB)) <= 0.0
    assert max(max(step.risen.values()) for step in list_steps(back, {}, FADING_DB)) > 5.0
