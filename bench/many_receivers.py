"""Deciding one window: time against the number of receivers and of signals, beside a plain double loop.

The group decision tests all receivers and satellites of a pairing at once, for every noise that is considered; the loop
takes the F test of the published rule for one pair of receivers and satellites after the other.

    python bench/many_receivers.py
"""

import itertools
from collections.abc import Callable, Iterator
from time import process_time

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.multi_receiver.one_antenna import (
    TrackNoise,
    average_contrasts,
    compute_contrasts,
    one_antenna_test,
)
from skyproof.studies.double_difference import difference_test

EPOCHS = 10
SIZES = [(2, 14), (2, 30), (2, 60), (2, 120), (5, 14), (10, 14), (20, 14), (50, 14), (100, 14), (200, 14)]
"""Receivers and satellites with a signal in each."""
LOOPED = 300
"""Pairs that the loop takes; its time for all is in proportion."""


def report() -> Iterator[str]:
    """A row for each size."""
    rng = np.random.default_rng(1)
    yield f"one window of {EPOCHS} epochs, processor time, s: together | pair by pair (of {LOOPED}, in proportion)"
    for receivers, signals in SIZES:
        ranges_m = rng.standard_normal((EPOCHS, signals, receivers))
        together_s = _time_s(lambda ranges_m=ranges_m: _together(ranges_m))
        yield f"  {receivers:3d} receivers, {signals:3d} signals: {together_s:8.4f} | {_looped_s(ranges_m):8.3f}"


def _together(ranges_m: Reals) -> None:
    values, gain, _ = compute_contrasts(ranges_m, np.ones(ranges_m.shape[1:]))
    one_antenna_test(average_contrasts(values, gain, TrackNoise()))


def _looped_s(ranges_m: Reals) -> float:
    _, signals, receivers = ranges_m.shape
    pairs = itertools.product(itertools.combinations(range(receivers), 2), itertools.combinations(range(signals), 2))
    some = list(itertools.islice(pairs, LOOPED))
    every = receivers * (receivers - 1) // 2 * signals * (signals - 1) // 2

    def loop() -> None:
        for (i, j), (k, m) in some:
            difference_test((ranges_m[:, k, j] - ranges_m[:, k, i] - ranges_m[:, m, j] + ranges_m[:, m, i])[:, None])

    return _time_s(loop) * every / len(some)


def _time_s(call: Callable[[], object]) -> float:
    """Of the second call; the first one fills caches."""
    call()
    begin = process_time()
    call()
    return process_time() - begin


if __name__ == "__main__":
    for words in report():
        print(words, flush=True)
