import numpy as np
import pytest

from skyproof.detectors.code_carrier.divergence import estimate_divergences


def test_signals_together_diverge_as_each_does_alone():
    rng = np.random.default_rng(6)
    n, k = 30, 12
    elapsed_s = np.arange(n) * 1.0
    apart_m = 3.0 * rng.standard_normal((n, k)).cumsum(axis=0)
    apart_m[rng.random((n, k)) < 0.1] = np.nan
    code_m2, gathered_m2 = rng.uniform(0.1, 1.0, (n, k)), rng.uniform(0.0, 0.1, (n, k)).cumsum(axis=0)
    chip_m, starts = np.full(k, 293.0), rng.integers(0, 26, k)
    together = estimate_divergences(elapsed_s, apart_m, code_m2, gathered_m2, chip_m, starts)
    for column in range(k):
        rows = [row for row in range(starts[column], n) if np.isfinite(apart_m[row, column])]
        if len(rows) < 8:
            assert together[column] is None
            continue
        quarter = len(rows) // 4
        first, last = apart_m[rows[:quarter], column], apart_m[rows[-quarter:], column]
        assert together[column].change_m == pytest.approx(last.mean() - first.mean())
        assert together[column].time_s == elapsed_s[rows[-quarter:]].mean() - elapsed_s[rows[:quarter]].mean()
        (alone,) = estimate_divergences(elapsed_s, apart_m[:, [column]], code_m2[:, [column]], gathered_m2[:, [column]],
                                  chip_m[[column]], starts[[column]])  # fmt: skip
        assert together[column].p_value == pytest.approx(alone.p_value, rel=1e-12)
    assert sum(look is None for look in together) > 0
