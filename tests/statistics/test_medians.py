import numpy as np
import pytest

from skyproof.statistics.medians import medians


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("shape", [(1, 1), (2, 5), (7, 6), (10, 1)])
def test_medians_are_those_of_what_is_known_alone(shape, axis):
    rng = np.random.default_rng(sum(shape))
    values = rng.standard_normal(shape)
    values[rng.random(shape) < 0.3] = np.nan
    lines = values.T if axis == 0 else values
    expected = [np.median(line[np.isfinite(line)]) if np.isfinite(line).any() else np.nan for line in lines]
    np.testing.assert_array_equal(medians(values, axis=axis), expected)


def test_nothing_has_no_median():
    assert np.isnan(medians(np.empty((0, 3)))).all()
    assert medians(np.empty((0, 3))).shape == (3,)
