"""What each further antenna of an array costs: tracked with the others, beside a receiver of its own.

A further antenna is correlated like the first, and shares loops, search and what is taken off for other signals.
Processor time, of all cores together; the samples are in memory. And how many windows a second tests of arrays judge.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from time import process_time

import arrays
import numpy as np
from timing import Spread, line, take_turns

from skyproof.arrays import Floats, Indices, Reals
from skyproof.detectors.array.array_common import ArrayCommon, ArrayCommonSettings
from skyproof.detectors.array.ins_array import InsArray, InsArraySettings
from skyproof.gnss.constants import L1_HZ
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.receiver.acquisition import Peak
from skyproof.receiver.measurement import Measurements
from skyproof.receiver.settings import ReceiverSettings
from skyproof.receiver.tracking import Receiver, ReceiverState
from skyproof.records import Samples
from skyproof.simulator import make_navigation, make_scene, read_ready_made, render_samples
from skyproof.simulator.received import Scene
from skyproof.simulator.scenario import FrontEnd

RATE_HZ = 2.6e6
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


def scene_and_samples(power_db: float) -> tuple[Scene, Samples]:
    """The scene with all satellites imitated at this power, and the array's recording."""
    scenario = read_ready_made("ins-array-2")
    attack = scenario.attacks[0].model_copy(update={"sats": None, "power_db": power_db})
    front_end = FrontEnd(rate_hz=RATE_HZ, bandwidth_hz=0.8 * RATE_HZ, encoding="int", bits=16, agc=True)
    scenario = scenario.model_copy(update={"attacks": (attack,), "duration_s": DURATION_S, "front_end": front_end})
    navigation = make_navigation(scenario)
    first, *others = render_samples(scenario, navigation)
    return make_scene(scenario, navigation), replace(first, others=tuple(others))


def columns_of(scene: Scene, label: str) -> Indices:
    """Of the scene's signals."""
    return np.flatnonzero([signal.label == label for signal in scene.skies[0].signals])


def _late_s(scene: Scene, elapsed_s: Reals, antenna: int = 0, *, carrier: bool = False) -> Reals:
    """(n, n_signals) by how much less each signal shows than the sampling clock."""
    sky = scene.skies[antenna]
    late_s = sky.true_minus_elapsed_s(elapsed_s)
    delay_s = (sky.carrier_delay_s if carrier else sky.code_delay_s)(elapsed_s + late_s)
    return np.asarray(delay_s - late_s[:, None])


def track(samples: Samples, scene: Scene, columns: Indices) -> Measurements:
    """What channels measure that begin on these signals, and look for no others; arcs are numbered in their order."""
    receiver = Receiver(RATE_HZ, samples.if_hz, ReceiverSettings(sats=()))
    state = ReceiverState(tail=samples.read_all(0, 0))
    begin_s = np.array([0.0, 0.01])
    code_s, carrier_s = _late_s(scene, begin_s), _late_s(scene, begin_s, carrier=True)
    for column in columns:
        peak = Peak(
            sat=scene.skies[0].signals[column].id.sat,
            delay_s=float(code_s[0, column] % GPS_L1_CA.period_s),
            doppler_hz=float(-np.diff(carrier_s[:, column])[0] / 0.01 * L1_HZ),
            cn0_dbhz=45.0,
            power=100.0,
            p_value=0.0,
        )
        state = receiver.start_channel(state, peak)
    parts, step = [], round(0.5 * RATE_HZ)
    for start in range(0, samples.n_samples, step):
        output, state = receiver.step(state, samples.read_all(start, step))
        parts.append(output.measurements)
    return Measurements.join(parts)


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
