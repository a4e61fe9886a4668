"""Effects that are there whichever few of the data are left out."""

from itertools import combinations

import numpy as np
from scipy import stats

from skyproof.statistics.leave_out import largest_p_value_without

ITEMS = range(8)


def find_p_values(values):
    """Find p-values, without each set, of a mean of zero for values (8,) with errors of one."""

    def p_values(sets):
        for some in sets:
            kept = np.delete(values, some)
            yield 2.0 * stats.norm.sf(abs(kept.sum()) / np.sqrt(kept.size))

    return p_values


def test_it_is_the_largest_of_all_pairs():
    values = np.random.default_rng(1).normal(1.0, 1.0, 8)
    by_hand = max(p for some in combinations(ITEMS, 2) for p in find_p_values(values)([some]))
    assert largest_p_value_without(ITEMS, find_p_values(values), least=5) == by_hand


def test_an_effect_of_two_items_is_none_and_of_all_is_one():
    two = np.where(np.arange(8) < 2, 30.0, 0.0)
    assert largest_p_value_without(ITEMS, find_p_values(two), least=5) > 0.5
    assert largest_p_value_without(ITEMS, find_p_values(np.full(8, 5.0)), least=5) < 1e-20


def test_false_alarms_are_rarer_than_asked_whatever_two_are():
    rng = np.random.default_rng(2)
    wrong = np.where(np.arange(8) < 2, 100.0, 0.0)
    found = [largest_p_value_without(ITEMS, find_p_values(wrong + rng.standard_normal(8)), least=5) for _ in range(300)]
    assert stats.binomtest(sum(p < 0.1 for p in found), 300, 0.1, alternative="greater").pvalue > 1e-3


def test_too_few_that_remain_show_nothing():
    values = np.full(8, 5.0)
    assert largest_p_value_without(ITEMS, find_p_values(values), least=7) == 1.0
    assert largest_p_value_without(ITEMS, find_p_values(values), least=6) < 1e-10


def test_all_numbers_that_are_left_out_count():
    values = np.array([5.0, *[-5.0 / 7.0] * 7])  # without the first there is an effect, with it none
    assert largest_p_value_without(ITEMS, find_p_values(values), counts=(1,), least=5) < 1.0 - 1e-9
    assert largest_p_value_without(ITEMS, find_p_values(values), counts=(0, 1), least=5) > 1.0 - 1e-9


def test_no_more_are_asked_for_than_matter():
    asked = []

    def p_values(sets):
        for some in sets:
            asked.append(some)
            yield 0.3

    assert largest_p_value_without(ITEMS, p_values, least=5, enough=0.2) == 0.3
    assert len(asked) == 1
