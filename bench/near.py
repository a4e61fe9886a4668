"""Two receivers near each other: how many windows of 10 s are decided after some time, rightly and wrongly, beside the
most that any test could decide that is given the errors.

    python bench/near.py                 5 m apart, the stated rate of 0.1 %
    python bench/near.py --distance-m 10 --probability 1e-7 --runs 50
    python bench/near.py --distance-m 1 --known "places to 1 cm, and carriers"

The bound is that of code.
"""

import argparse
from collections.abc import Iterator
from dataclasses import replace
from time import process_time
from typing import Any

import numpy as np
from scipy import stats

from skyproof.app.common.windows import cut
from skyproof.arrays import Reals
from skyproof.detectors.multi_receiver.detector import MultiReceiver
from skyproof.detectors.multi_receiver.one_antenna import WHITE, baseline_design, compute_contrasts
from skyproof.detectors.multi_receiver.pairing import pair_up
from skyproof.detectors.multi_receiver.settings import MultiReceiverSettings
from skyproof.records import Records
from skyproof.testing import FalseSky, MeasuredScene, TrackErrors

WINDOW_S, AFTER_S = 10, (10, 30, 60, 120)
ERRORS = (
    TrackErrors(1.0, 0.0, 0.0),
    TrackErrors(1.0, 0.5, 0.5),
    TrackErrors(1.0, 0.5, 1.0),
    TrackErrors(2.0, 0.5, 1.0),
    TrackErrors(1.0, 0.9, 1.0),
)
SATELLITES = 10
DOUBTS = {"spoofed", "attack"}


def windows(records: Records) -> Iterator[Records]:
    """The records of a run in windows, between whose edges no epoch lies."""
    early = np.timedelta64(50, "ms")
    for k in range(AFTER_S[-1] // WINDOW_S):
        start, end = (records.start_gpst + np.timedelta64(WINDOW_S * n, "s") - (early if n else 0) for n in (k, k + 1))
        cuts = tuple(cut(o, start, end) for o in records.observations)
        yield replace(records, start_gpst=start, end_gpst=end, observations=cuts)


def said_of(detector: MultiReceiver, records: Records) -> list[tuple[int, set[str]]]:
    """What is said: after how many windows, of which one and what."""
    state, found, starts = None, [], []
    for number, window in enumerate(windows(records), 1):
        starts.append(window.start_gpst)
        evidence, state = detector.examine(window, state)
        found += [(number, starts.index(e.start_gpst), e.says) for e in evidence if e.says != "undecided"]
    return found


def most(scene: MeasuredScene, enu_m: Reals, seconds: int, rate: float) -> float:
    """Probability with which the sky is told from one antenna, given all errors and where the antennas stand."""
    records = scene.records(np.random.default_rng(0))
    units = pair_up(records, records.sets, WHITE, min_satellites=5).unit_enu
    assert units is not None
    _, _, matrix = compute_contrasts(np.zeros((1, len(units), 2)), np.ones((len(units), 2)))
    shift_m = np.linalg.norm(baseline_design(matrix, units) @ enu_m)
    errors, lags = scene.errors, np.abs(np.subtract.outer(np.arange(seconds), np.arange(seconds)))
    information = np.linalg.inv(errors.sigma_m**2 * np.power(errors.correlation, lags)).sum()
    return float(stats.norm.sf(stats.norm.isf(rate) - shift_m / np.sqrt(1.0 / information + errors.constant_m**2)))


def by_code_alone(records: Records) -> Records:
    """The same without carriers."""
    observations = (replace(o, carrier_cyc=np.full_like(o.carrier_cyc, np.nan)) for o in records.observations)
    return replace(records, observations=tuple(observations))


def row(scene: MeasuredScene, settings: MultiReceiverSettings, runs: int, right: set[str], *, carriers: bool) -> str:
    """Share of the windows up to each time that are decided by then as they should be, and of all that are not."""
    rng, detector = np.random.default_rng(1), MultiReceiver(settings)
    decided, wrong, begin = np.zeros(len(AFTER_S)), 0, process_time()
    for _ in range(runs):
        records = scene.records(rng)
        said = said_of(detector, records if carriers else by_code_alone(records))
        for k, after_s in enumerate(AFTER_S):
            count = after_s // WINDOW_S
            decided[k] += len({which for when, which, says in said if when <= count and says in right}) / count / runs
        wrong += len({which for _, which, says in said if says not in right})
    cost_ms = 1e3 * (process_time() - begin) / runs / (AFTER_S[-1] // WINDOW_S)
    return f"{' '.join(f'{share:5.2f}' for share in decided)} | {wrong:5d} | {cost_ms:4.0f}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--distance-m", type=float, default=5.0)
    parser.add_argument("--probability", type=float, default=1e-3)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--known", nargs="*", help="of the rows by what is known: all")
    args = parser.parse_args()
    places = {"rx1": (0.0, 0.0, 0.0), "rx2": (0.8 * args.distance_m, 0.6 * args.distance_m, 0.0)}
    known: dict[str, dict[str, Any]] = {
        "distance": {"antenna_distance_m": args.distance_m},
        "places": {"antennas_enu_m": places},
        "places to 1 cm, and carriers": {"antennas_enu_m": places, "antennas_sigma_m": 0.01},
    }
    times = " ".join(f"{s:3d} s" for s in AFTER_S)
    print(f"sky | errors | known | decided after {times} | wrong | ms a window | the most")
    for errors in ERRORS:
        options = {"antennas_enu_m": places, "epochs": AFTER_S[-1], "errors": errors, "max_satellites": SATELLITES}
        clean, captured = MeasuredScene(**options), MeasuredScene(**options, sky=(), false=(FalseSky(),))
        bound = " ".join(f"{most(clean, np.array(places['rx2']), s, args.probability):.2f}" for s in AFTER_S)
        words = f"{errors.sigma_m:g} m, AR(1) {errors.correlation:g}, {errors.constant_m:g} m constant"
        for name in args.known or known:
            settings = MultiReceiverSettings(false_alarm_probability=args.probability, **known[name])
            carriers = "carriers" in name
            for sky, scene, right in (("true", clean, {"authentic"}), ("false", captured, DOUBTS)):
                print(
                    f"{sky} | {words} | {name} | {row(scene, settings, args.runs, right, carriers=carriers)} | {bound}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
