"""The consistent sets of 12 satellites with two signals each, beside trying every combination."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from timing import line, take_turns

from skyproof.navigation.least_squares import fit_position
from skyproof.navigation.ranges import correct_ranges
from skyproof.navigation.sets import find_consistent_sets
from skyproof.navigation.window import average_window
from skyproof.records import Observations
from skyproof.testing import FalseSky, MeasuredScene, TrackErrors


def report() -> Iterator[str]:
    """Rows of the table."""
    scene = MeasuredScene(
        antennas_enu_m={"rx1": (0.0, 0.0, 0.0)},
        false=(FalseSky(),),
        epochs=50,
        step_s=0.2,
        mask_deg=0.0,
        max_satellites=12,
        errors=TrackErrors(sigma_m=1.0),
    )
    records = scene.records(np.random.default_rng(1))
    window, orbits = records.observations[0], scene.navigation
    sats = len({signal.sat for signal in window.signals})
    odd = _with_odd_signals(window, 2)
    mean = average_window(window)
    ranges = correct_ranges(mean.signals, np.array([mean.gpst]), mean.pseudorange_m[None, :], orbits)
    choices = _every_choice([signal.sat for signal in mean.signals])

    def fit_all() -> NDArray[np.float64]:
        """One fit for each of the 2^12 choices of a signal for every satellite, all at once, without atmosphere."""
        return fit_position(
            ranges.satellite_ecef_m[0][choices],
            ranges.range_m[0][choices],
            np.ones(choices.shape),
            np.zeros((len(choices), 4)),
        ).state_m

    assert [len(s.signals) for s in find_consistent_sets(window, orbits)] == [sats, sats]
    assert [len(s.signals) for s in find_consistent_sets(odd, orbits)] == [sats, sats - 2]
    whole_s, odd_s, fits_s = take_turns(
        lambda: find_consistent_sets(window, orbits), lambda: find_consistent_sets(odd, orbits), fit_all, runs=5
    )
    yield f"consistent sets of {sats} satellites with two signals each, one window"
    times = fits_s.median / whole_s.median
    beside = f"one fit of each of the {len(choices)} full choices {fits_s.median:.3f} s ({times:.1f} times)"
    yield line("both skies whole", whole_s, "s", beside)
    yield line("two false signals that fit nothing", odd_s, "s", "all smaller choices: 3^12 = 531441 fits")


def _with_odd_signals(window: Observations, count: int) -> Observations:
    """The last `count` channels moved by kilometres."""
    moved_m = np.zeros(len(window.signals))
    moved_m[-count:] = 5e3 * np.arange(1, count + 1)
    return replace(window, pseudorange_m=window.pseudorange_m + moved_m)


def _every_choice(sats: list[str]) -> NDArray[np.intp]:
    rows = [[k for k, other in enumerate(sats) if other == sat] for sat in sorted(set(sats))]
    return np.array(list(product(*rows)))
