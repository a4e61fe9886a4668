"""Ways to make one alarm out of many p-values, on drawn scenes: false alarms counted against asked ones, detection.

    python bench/fused.py --attacks 300 --clean 300      scenes of drawn_scenes.py, a second of a processor each

Each test of each window that rejects a clean sky gives a p-value. A run's own p-value by
    union      the least one times their number (Bonferroni); Holm's first step is the same, and an alarm is its first
    Cauchy     tan((1/2 - p) pi) averaged: valid in the tail whatever the dependence (Liu, Xie, JASA 115, 2020)
    Fisher     -2 sum(log p), as if tests were independent
    majority   in some window more than half of its detectors are below it (least over windows of the median p, times
               their number and 2)
    by us      the verdict, which weighs what else may be the reason: no p-value, one point
"""

import argparse
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import groupby
from typing import Any, Final

import numpy as np
from drawn import judged, scene_of_name
from scipy import stats

from skyproof.arrays import Reals
from skyproof.records import Evidence

ASKED: Final = (1e-2, 1e-3, 1e-4, 1e-6)
COUNTED: Final = 0.02
LEAST: Final = 1e-300
_REJECTS_CLEAN: Final = ("spoofed", "attack", "clean", "undecided")


def p_values(evidence: Iterable[Evidence]) -> list[list[tuple[str, float]]]:
    """By window: detector and p-value of each test of a clean sky."""
    tested = [e for e in evidence if e.p_value is not None and not e.lacking and e.says in _REJECTS_CLEAN]
    tested = [e for e in tested if e.detector != "multi_receiver" or e.says in ("spoofed", "attack")]
    tested.sort(key=lambda e: (e.start_gpst, e.end_gpst))
    windows = groupby(tested, key=lambda e: (e.start_gpst, e.end_gpst))
    return [[(e.detector, max(float(e.p_value or 0.0), LEAST)) for e in rows] for _, rows in windows]


def union(windows: Sequence[Sequence[tuple[str, float]]]) -> float:
    every = _all(windows)
    return min(1.0, float(every.min() * every.size))


def cauchy(windows: Sequence[Sequence[tuple[str, float]]]) -> float:
    every = np.minimum(_all(windows), 1.0 - 1e-12)
    # tan((1/2 - p) pi) is 1 / (p pi) where p is so small that the tangent loses it
    each = np.where(every < 1e-8, 1.0 / (np.pi * every), np.tan((0.5 - every) * np.pi))
    mean = float(each.mean())
    return 1.0 / (np.pi * mean) if mean > 1e8 else float(0.5 - np.arctan(mean) / np.pi)


def fisher(windows: Sequence[Sequence[tuple[str, float]]]) -> float:
    every = _all(windows)
    return float(stats.chi2.sf(-2.0 * np.log(every).sum(), 2 * every.size))


def majority(windows: Sequence[Sequence[tuple[str, float]]]) -> float:
    """Of a detector's tests in a window the least counts, times their number."""
    found = []
    for window in windows:
        own = [np.array([p for name, p in window if name == one]) for one in {name for name, _ in window}]
        found.append(float(np.median([min(1.0, p.min() * p.size) for p in own])))
    return min(1.0, 2.0 * min(found) * len(found))


WAYS: Final = {"union": union, "Cauchy": cauchy, "Fisher": fisher, "majority": majority}


def _all(windows: Sequence[Sequence[tuple[str, float]]]) -> Reals:
    return np.array([p for window in windows for _, p in window])


def row_of(name: str) -> dict[str, Any] | None:
    """A scene's p-value by each way, and the verdict; None where there is no scene of that name."""
    _, made, _ = scene_of_name(name)
    if made is None:
        return None
    _, outcome, _ = judged(made)
    windows = p_values(outcome.evidence)
    if not windows:
        return None
    return {way: combine(windows) for way, combine in WAYS.items()} | {"verdict": outcome.decision.verdict}


def table(clean: Sequence[Mapping[str, Any]], attacks: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    yield f"{len(clean)} clean runs, {len(attacks)} attacks; shares with their 95 % intervals"
    heads = " ".join(f"{f'false at {asked:g}':>21}" for asked in ASKED)
    yield f"{'way':9} {heads}  named at {COUNTED:.0%} counted"
    for way in WAYS:
        null = np.array([row[way] for row in clean])
        under = np.array([row[way] for row in attacks])
        false = " ".join(f"{_share(null < asked):>21}" for asked in ASKED)
        yield f"{way:9} {false}  {_share(under < np.quantile(null, COUNTED))}"
    for words in (("spoofed",), ("spoofed", "undecided")):
        false, named = (np.array([row["verdict"] in words for row in rows]) for rows in (clean, attacks))
        yield f"by us, {' or '.join(words)}: false {_share(false)}, named {_share(named)}"


def _share(hits: Any) -> str:
    """With its 95 % interval (Clopper, Pearson)."""
    found = stats.binomtest(int(np.sum(hits)), len(hits)).proportion_ci()
    return f"{np.mean(hits):.3f} ({found.low:.3f}-{found.high:.3f})"


def main() -> None:
    """Draw, judge and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--attacks", type=int, default=300)
    parser.add_argument("--clean", type=int, default=300)
    asked = parser.parse_args()
    names = [f"clean-{n}" for n in range(asked.clean)], [f"attack-{n}" for n in range(asked.attacks)]
    with ProcessPoolExecutor() as pool:
        clean, attacks = ([row for row in pool.map(row_of, some, chunksize=8) if row is not None] for some in names)
        print("\n".join(table(clean, attacks)))


if __name__ == "__main__":
    main()
