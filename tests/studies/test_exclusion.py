"""Exclusion by covariance: the wrong choice comes as often as predicted, and doubt is reported."""

import numpy as np
import pytest

from skyproof.studies.exclusion import choose_fix, distance_squared, wrong_choice_probability, wrong_choice_rule

OFFSET = 100.0 * np.array([1.0, 0.0, 1.0]) * np.sqrt(0.5)
FIX = np.diag([1.5, 1.5, 3.0]) ** 2
TACTICAL = np.diag([92.0, 92.0, 12.4]) ** 2


def draw_chosen(rng, n, covariance, offset, **options):
    place = rng.standard_normal((n, 3)) @ np.linalg.cholesky(covariance).T
    fixes = np.stack([np.zeros(3), offset]) + rng.standard_normal((n, 2, 3)) @ np.sqrt(FIX)
    return choose_fix(place, covariance, fixes, FIX, **options)


@pytest.mark.parametrize(
    ("covariance", "offset"),
    [
        (TACTICAL, OFFSET),
        (np.diag([25.0, 25.0, 25.0]), 0.1 * OFFSET),
        (np.diag([9.0, 4.0, 1.0]), 0.1 * OFFSET),
        (np.diag([175.0, 175.0, 57.0]) ** 2, OFFSET),
    ],
)
def test_the_wrong_fix_is_nearer_as_often_as_predicted(covariance, offset):
    rng = np.random.default_rng(1)
    n = 200_000
    wrong = np.mean(draw_chosen(rng, n, covariance, offset).nearest == 1)
    predicted = wrong_choice_probability(offset, covariance, FIX)
    assert wrong == pytest.approx(predicted, abs=4.5 * np.sqrt(predicted / n))


def test_the_rule_of_thumb_has_the_guides_figures():
    total = np.diag([92.0, 92.0, 12.2]) ** 2 + FIX  # the guide rounds the vertical drift to 12
    assert wrong_choice_rule(OFFSET, total) == pytest.approx(0.0024, abs=3e-4)
    assert wrong_choice_rule(OFFSET, np.diag([93.0, 93.0, 17.3]) ** 2 + FIX) == pytest.approx(0.0200, abs=2e-3)
    assert wrong_choice_rule(OFFSET, np.diag([175.0, 175.0, 57.0]) ** 2 + FIX) == pytest.approx(0.260, abs=6e-3)
    assert wrong_choice_probability(OFFSET, TACTICAL, FIX) == pytest.approx(
        wrong_choice_rule(OFFSET, TACTICAL + FIX), rel=0.2
    )


def test_the_true_fix_fails_its_test_as_often_as_stated():
    found = draw_chosen(np.random.default_rng(2), 100_000, TACTICAL, OFFSET)
    for asked in (0.1, 0.01):
        assert np.mean(found.p_value[:, 0] < asked) == pytest.approx(asked, rel=0.1)


def test_a_choice_is_wrong_less_often_than_asked():
    rng = np.random.default_rng(3)
    found = draw_chosen(rng, 200_000, np.diag([93.0, 93.0, 17.3]) ** 2, OFFSET)
    assert np.mean(found.chosen == 1) < 1e-3
    assert np.mean(found.chosen == -1) == pytest.approx(0.34, abs=0.03)  # guide: 34 %
    rough = draw_chosen(rng, 2000, np.diag([650.0, 650.0, 200.0]) ** 2, OFFSET)
    assert np.mean(rough.chosen == -1) > 0.99


def test_two_failing_fixes_are_refused_and_a_lone_pass_taken():
    far = choose_fix(np.zeros(3), np.eye(3), np.array([[50.0, 0, 0], [0, 60.0, 0]]), np.eye(3))
    assert far.chosen == -1
    choice = choose_fix(np.zeros(3), np.eye(3), np.array([[50.0, 0, 0], [0, 1.0, 0], [0, 0, 40.0]]), np.eye(3))
    assert choice.chosen == 1
    assert choose_fix(np.zeros(3), np.eye(3), np.zeros((1, 3)), np.eye(3)).chosen == 0


def test_leading_axes_are_free():
    rng = np.random.default_rng(4)
    apart = rng.standard_normal((2, 5, 3))
    assert distance_squared(apart, np.broadcast_to(2.0 * np.eye(3), (5, 3, 3))) == pytest.approx(
        0.5 * np.sum(apart**2, axis=-1)
    )
    assert wrong_choice_probability(apart, np.eye(3), np.eye(3)).shape == (2, 5)
