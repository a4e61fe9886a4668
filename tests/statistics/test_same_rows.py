import numpy as np

from skyproof.statistics.same_rows import group_by_rows


def test_each_column_is_in_the_group_of_its_rows():
    chosen = np.random.default_rng(2).random((6, 40)) < 0.5
    chosen[:, 3], chosen[:, 17] = False, chosen[:, 5]
    groups = group_by_rows(chosen)
    assert sorted(column for _, columns in groups for column in columns) == list(range(40))
    for rows, columns in groups:
        for column in columns:
            np.testing.assert_array_equal(np.flatnonzero(chosen[:, column]), rows)
    assert len({tuple(rows) for rows, _ in groups}) == len(groups)
