"""What each further antenna of an array costs: tracked with the others, beside a receiver of its own.

A further antenna is correlated like the first, and shares loops, search and what is taken off for other signals.
Processor time, of all cores together; the samples are in memory. And how many windows a second tests of arrays judge.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from time import process_time

import arrays
import numpy as np
from spatial import RATE_HZ, columns_of, scene_and_samples, track
from timing import Spread, line, take_turns

from skyproof.arrays import Floats
from skyproof.detectors.array.array_common import ArrayCommon, ArrayCommonSettings
from skyproof.detectors.array.ins_array import InsArray, InsArraySettings
from skyproof.records import Samples

RUNS = 5
DURATION_S = 3.0
WINDOWS = 20


def report() -> Iterator[str]:
    """Rows of the table."""
    scene, samples = scene_and_samples(0.0)
    held = _in_memory(samples)
    true = columns_of(scene, "authentic")
    first, *others = (held, *held.others)
    alone = replace(first, others=())
    counts = range(1, 2 + len(others))
    together = [replace(first, others=tuple(others[: count - 1])) for count in counts]

    def tracking(recordings: list[Samples]) -> Callable[[], object]:
        return lambda: [track(item, scene, true) for item in recordings]

    each = [replace(item, others=()) for item in (first, *others)]
    taken = take_turns(*(tracking([item]) for item in together), tracking(each), runs=RUNS, clock=process_time)
    per = 1e9 / (true.size * alone.n_samples)
    yield f"tracking an array: {true.size} signals, {DURATION_S:g} s at {RATE_HZ / 1e6:g} Msps, processor time"
    for count, spread in zip(counts, taken, strict=False):
        beside = "" if count == 1 else _further(taken, count)
        yield line(f"{count} antennas together" if count > 1 else "one antenna", spread * per, "ns a sample", beside)
    beside = f"together take {taken[-2].median / taken[-1].median:.2f} of it"
    yield line(f"{len(each)} antennas, each alone", taken[-1] * per, "ns a sample", beside)
    yield from _statistics()


def _further(taken: list[Spread], count: int) -> str:
    share = (taken[count - 1].median - taken[0].median) / (count - 1) / taken[0].median
    return f"a further antenna costs {share:.2f} of one receiver's channel (aim: 0.5)"


def _in_memory(samples: Samples) -> Samples:
    count = round(DURATION_S * samples.rate_hz)
    planes = samples.read_all(0, count)

    def of(plane: Floats) -> Callable[[int, int], Floats]:
        return lambda start, n: plane[:, start : start + n]

    first, *others = (
        replace(item, read=of(plane), n_samples=count, others=())
        for item, plane in zip((samples, *samples.others), planes, strict=True)
    )
    return replace(first, others=tuple(others))


def _statistics() -> Iterator[str]:
    scenes = [arrays.drawn(number, attack=bool(number % 2)).records for number in range(WINDOWS)]
    signals = np.mean([len(records.observations[0].signals) for records in scenes])
    detectors = (
        ArrayCommon(ArrayCommonSettings(false_alarm_probability=arrays.ALPHA)),
        InsArray(InsArraySettings(false_alarm_probability=arrays.ALPHA)),
    )
    yield f"windows of 10 s at 5 Hz judged, {signals:.0f} signals on 3 to 7 antennas"
    for detector in detectors:

        def judging(detector: ArrayCommon | InsArray = detector) -> None:
            for records in scenes:
                detector.examine(records)

        (spread,) = take_turns(judging, runs=RUNS, clock=process_time)
        a_second = Spread(*(WINDOWS / value for value in (spread.median, spread.most, spread.least)))
        yield line(detector.name, a_second, "windows a second", f"{a_second.median * signals:.0f} signals")


if __name__ == "__main__":
    for row in report():
        print(row, flush=True)
