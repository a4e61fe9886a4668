"""Two signals of one satellite through the whole receiver, and none where there is one: `bench/pairs.py`."""

import importlib
import math
import sys
from itertools import product
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy import stats

APART_CLEARLY = (1.5, 2.0, 4.0, 8.0)
PER_SEARCH = 1e-4
"""False alarms of a search of clean sky, as it is set."""


BENCH = Path(__file__).parents[2] / "bench"


def load_bench(name: str) -> ModuleType:
    """Load a module of the benches: the simulation, theory and counts behind the table."""
    sys.path.insert(0, str(BENCH))
    try:
        return importlib.import_module(name)
    finally:
        sys.path.remove(str(BENCH))


pairs, pulls, second_signals, waves = (load_bench(name) for name in ("pairs", "pulls", "second_signals", "waves"))


def find_cell(apart_chips, relative_db, apart_hz):
    return waves.Cell(apart_chips=apart_chips, relative_db=relative_db, apart_hz=apart_hz)


def predict_m(row, of):
    """Predict the errors that noise and the other signal explain together."""
    _, sigma_m, pull_m = row.code_m[of]
    return math.hypot(sigma_m, pull_m)


# ---------------------------------------------------------------------- two signals


@pytest.mark.parametrize(
    ("apart_chips", "relative_db", "apart_hz"), [(1.5, 0.0, 2.0), (2.0, 10.0, 50.0), (4.0, -6.0, 0.0), (8.0, 6.0, 10.0)]
)
def test_both_signals_of_a_pair_are_followed_and_measured_right(apart_chips, relative_db, apart_hz):
    row = pairs.row_of(find_cell(apart_chips, relative_db, apart_hz), 1)
    assert row.found == 1
    assert row.others == row.pulled == 0
    assert row.wait_s[1] < 1.5
    for of in (0, 1):
        # Five epochs; a constant pull may be 1.4 times its mean square over the phases.
        assert row.code_m[of][0] < 2.5 * predict_m(row, of)
        error_hz, sigma_hz, pull_hz = row.doppler_hz[of]
        assert error_hz < 2.5 * math.hypot(sigma_hz, pull_hz)


@pytest.mark.parametrize(("apart_hz", "least", "most"), [(0.0, 0.25, 0.65), (10.0, 0.0, 0.1)])
def test_at_a_chip_the_weaker_one_holds_for_some_phases_only(apart_hz, least, most):
    # Sharp tops and taps close together: where the cosine of the phase between them is below the ratio of amplitudes.
    assert least <= pulls.stays(find_cell(1.0, -10.0, apart_hz), True)[0] <= most
    assert pulls.stays(find_cell(1.0, -10.0, apart_hz), False)[0] == 1.0
    assert pulls.stays(find_cell(1.5, -10.0, apart_hz), True)[0] == 1.0


# ---------------------------------------------------------------------- one signal


def test_searches_of_a_clean_sky_find_nothing_more():
    rng = np.random.default_rng(5)
    assert second_signals.clean_searches(rng, 150, full=False).alarms == 0
    assert second_signals.clean_searches(rng, 5, full=True).alarms == 0


@pytest.mark.parametrize("apart_hz", [0.0, 0.3])
def test_a_reflection_is_not_reported_as_a_signal(apart_hz):
    assert second_signals.reflected(np.random.default_rng(6), 0.35, -6.0, apart_hz) == 0


# ---------------------------------------------------------------------- counts


@pytest.mark.long
@pytest.mark.parametrize("apart_hz", [0.0, 2.0, 10.0, 50.0])
def test_pairs_beyond_1_5_chips_are_followed_within_errors(apart_hz):
    rows = [
        pairs.row_of(find_cell(*case, apart_hz), 3) for case in product(APART_CLEARLY, (-10.0, -6.0, 0.0, 6.0, 10.0))
    ]
    found = {weak: [row for row in rows if (row.cell.relative_db < -6.0) == weak] for weak in (False, True)}
    assert sum(row.found for row in found[False]) >= 0.97 * sum(row.trials for row in found[False])
    assert sum(row.found for row in found[True]) >= 0.85 * sum(row.trials for row in found[True])
    assert sum(row.others for row in rows) == 0
    for of in (0, 1):
        ratios = [row.code_m[of][0] / predict_m(row, of) for row in rows if row.found]
        assert math.sqrt(np.mean(np.square(ratios))) < 1.3


@pytest.mark.long
@pytest.mark.parametrize(("full", "searches"), [(False, 9000), (True, 600)])
def test_false_alarms_on_clean_sky_keep_the_stated_rate(full, searches):
    count = second_signals.clean_searches(np.random.default_rng([8, full]), searches, full=full)
    assert stats.binomtest(count.alarms, searches, PER_SEARCH, alternative="greater").pvalue > 1e-3


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_clean_sky_in_the_receiver_has_one_signal_each(seed):
    followed_s, seconds = second_signals.clean_recording(60.0, seed)
    assert followed_s > 180.0
    assert seconds == []


@pytest.mark.long
def test_reflections_within_half_a_chip_are_hardly_ever_reported():
    rng = np.random.default_rng(9)
    reflections = [case for case in second_signals.REFLECTIONS if case[0] <= 0.5]
    reported = [second_signals.reflected(rng, *case) > 0 for case in reflections for _ in range(4)]
    assert np.mean(reported) < 0.05
