"""Ways to make one alarm out of many p-values, on drawn scenes: detection against false alarms of each.

    python bench/fused.py --attacks 300 --clean 300 --shade 40 --out fused.jsonl    goes on where it was stopped
    python bench/fused.py --table fused.jsonl                                       the counts alone

Scenes are those of `skyproof.studies.random_scenes`, at measurement level through the whole decision; clean ones with
reflections and what models of the air leave ("clean"), without ("plain"), and without but with the first receiver's
signals weaker by 10 dB in the middle third ("shade", as many as --shade says). A run's own p-value, out of the p-values
of all tests that may reject a clean sky, of all but `residual`'s that measurements fit one position, or of those alone
that speak of an attack where they reject, is by     union      the least one times their number (Bonferroni)     Holm
the least of Holm's stepwise ones: as an alarm the same; it rejects more tests beside the first     Cauchy     tan((1/2
- p) pi) averaged: valid in the tail whatever the dependence (Liu, Xie, JASA 115, 2020)     Fisher     -2 sum(log p), as
if tests were independent     majority   in some window more than half of its detectors are below it (least over windows
of the median p, times                their number and 2)     mixture    one likelihood ratio: an attack from any window
to any later one, seen in each by any one detector, all                alike before; p-values as likelihood ratios by
Vovk and Wang (Annals of Statistics 49(3), 2021, after                Sellke, Bayarri and Berger), so that it exceeds
1/p with p at most if windows are independent The verdict, which weighs what else may be the reason, has no p-value: one
point, at the rate asked by itself.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any, Final

import numpy as np
from drawn import FOLLOWED_S, heard_of, of_receiver, pairs_of, settings_of
from rows import Row, parser_of, rows_of
from scipy import special, stats

from skyproof.app.common.progress import Silent
from skyproof.app.protect import judge
from skyproof.arrays import Reals
from skyproof.records import Cause, Finding
from skyproof.studies.random_scenes import BuiltScene, build_scene, draw_scene
from skyproof.studies.receiver_model import KnownReception

Test = tuple[str, float, bool]
"""Of a detector, its p-value, and whether it speaks of an attack where it rejects."""
Windows = Sequence[Sequence[Test]]

ASKED: Final = (1e-2, 1e-4, 1e-6)
COUNTED: Final = 0.02
TOLD: Final = 1e-3
LEAST: Final = 1e-300
JOINT: Final = 0.01
SHADE_DB: Final = 10.0
AGAINST: Final = ("spoofed", "attack")


def tests_of(evidence: Iterable[Finding]) -> list[list[Test]]:
    """By window, the tests of a clean sky.

    "One antenna" is rejected in a clean sky, as it should be: counted are tests of the sky, and what speaks against it.
    All tests of `second_signals` speak of an attack, and those of others that did: where `residual` or `continuity`
    fail otherwise it may be an echo, a shade or a gap.
    """
    windows: dict[Any, list[Test]] = {}
    for e in sorted(evidence, key=lambda e: (e.start_gpst, e.end_gpst)):
        against = e.says in AGAINST
        if e.p_value is not None and (against or Cause.CLEAN in e.p):
            speaks = against or e.detector == "second_signals"
            p_value = e.p_value if against else e.p[Cause.CLEAN]
            windows.setdefault((e.start_gpst, e.end_gpst), []).append((e.detector, float(p_value), speaks))
    return list(windows.values())


# ---------------------------------------------------------------------- ways


def union(windows: Windows) -> float:
    every = _all(windows)
    return min(1.0, float(every.min() * every.size))


def holm(windows: Windows) -> float:
    return float(_by_holm(_all(windows)).min())


def cauchy(windows: Windows) -> float:
    """A p-value of 1 has no tangent: it counts as 1 - 1/n."""
    every = _all(windows)
    every = np.where(every < 1.0, np.minimum(every, 1.0 - 1e-12), 1.0 - 1.0 / max(every.size, 2))
    # tan((1/2 - p) pi) is 1 / (p pi) where p is so small that the tangent loses it
    each = np.where(every < 1e-8, 1.0 / (np.pi * every), np.tan((0.5 - every) * np.pi))
    mean = float(each.mean())
    return 1.0 / (np.pi * mean) if mean > 1e8 else float(0.5 - np.arctan(mean) / np.pi)


def fisher(windows: Windows) -> float:
    every = _all(windows)
    return float(stats.chi2.sf(-2.0 * np.log(every).sum(), 2 * every.size))


def majority(windows: Windows) -> float:
    """Of a detector's tests in a window the least counts, times their number."""
    found = [float(np.median(list(by_detector(window).values()))) for window in windows]
    return min(1.0, 2.0 * min(found) * len(found))


def mixture(windows: Windows) -> float:
    """Adds up over time what is too weak in each window."""
    each = [special.logsumexp(_log_ratio(list(by_detector(w).values()))) - np.log(len(by_detector(w))) for w in windows]
    sums = np.concatenate([[0.0], np.cumsum(each)])
    begins, ends = np.triu_indices(len(sums), 1)
    return float(np.exp(-max(special.logsumexp(sums[ends] - sums[begins]) - np.log(begins.size), 0.0)))


def _log_ratio(p_values: Sequence[float]) -> Reals:
    """The mean over 0 < k < 1 of the densities k p^(k-1), (1 - p + p log p) / (p log^2 p); 1/2 of p = 1."""
    p = np.minimum(p_values, 1.0 - 1e-4)
    log_p = np.log(p)
    return np.asarray(np.log(1.0 - p + p * log_p) - log_p - 2.0 * np.log(-log_p))


WAYS: Final[Mapping[str, Callable[[Windows], float]]] = {
    "union": union,
    "Holm": holm,
    "Cauchy": cauchy,
    "Fisher": fisher,
    "majority": majority,
    "mixture": mixture,
}


def by_detector(window: Sequence[Test]) -> dict[str, float]:
    """The least p-value of each detector's tests, times their number."""
    own: dict[str, list[float]] = {}
    for name, p, _ in window:
        own.setdefault(name, []).append(max(p, LEAST))
    return {name: min(1.0, min(ps) * len(ps)) for name, ps in own.items()}


def _by_holm(every: Reals) -> Reals:
    """In ascending order, each the largest so far of p times the number of those that are not below it."""
    ordered = np.sort(every)
    return np.minimum(np.maximum.accumulate(ordered * np.arange(every.size, 0, -1)), 1.0)


def _all(windows: Windows) -> Reals:
    return np.maximum([p for window in windows for _, p, _ in window], LEAST)


def _kept(windows: Windows, keep: Callable[[Test], bool]) -> Windows:
    """With the other tests' p-values as 1, so that they take their share."""
    return [[test if keep(test) else (test[0], 1.0, test[2]) for test in window] for window in windows]


CHOICES: Final[Mapping[str, Callable[[Windows], Windows]]] = {
    "every test": lambda windows: windows,
    "all but that measurements fit one position": lambda windows: _kept(windows, lambda t: t[2] or t[0] != "residual"),
    "tests of an attack": lambda windows: _kept(windows, lambda t: t[2]),
}


# ---------------------------------------------------------------------- scenes


def row_of(name: str) -> Row:
    """A scene's tests and verdict; no windows where there is no scene of that name."""
    kind, _, number = name.partition("-")
    drawn = draw_scene(f"{kind if kind == 'attack' else 'clean'}-{number}")
    made = build_scene(replace(drawn, field=kind in ("clean", "attack")))
    if made is None:
        return {"name": name, "windows": []}
    first, *others = heard_of(made)
    return {"name": name} | _judged(made, [_shaded(first) if kind == "shade" else first, *others])


def _shaded(heard: KnownReception) -> KnownReception:
    """As under trees: all satellites together."""
    o = heard.reception.observations
    assert o is not None
    level_db = o.cn0_dbhz.copy()
    level_db[level_db.shape[0] // 3 : 2 * level_db.shape[0] // 3] -= SHADE_DB
    return replace(heard, reception=replace(heard.reception, observations=replace(o, cn0_dbhz=level_db)))


def _judged(made: BuiltScene, heard: Sequence[KnownReception]) -> Row:
    outcome, _ = judge([h.reception for h in heard], made.navigation, settings_of(made), Silent())
    each = [of_receiver(made, h, r) for h, r in pairs_of(heard, outcome)]
    return {
        "windows": tests_of(outcome.evidence),
        "verdict": outcome.decision.verdict,
        "captured": any(item["captured_s"] >= FOLLOWED_S for item in each),
    }


# ---------------------------------------------------------------------- tables


def table(rows: Sequence[Row]) -> Iterator[str]:
    rows = [row for row in rows if row["windows"]]
    kinds = {
        kind: [row for row in rows if row["name"].startswith(kind)] for kind in ("plain", "clean", "shade", "attack")
    }
    kinds["captured"] = [row for row in kinds["attack"] if row["captured"]]
    kinds = {kind: some for kind, some in kinds.items() if some}
    yield ", ".join(f"{len(some)} {kind}" for kind, some in kinds.items()) + "; shares with their 95 % intervals"
    if not kinds.keys() >= {"plain", "clean", "captured"}:
        return
    plain, clean, captured = kinds["plain"], kinds["clean"], kinds["captured"]
    for title, chosen in CHOICES.items():
        yield title
        for way, combine in WAYS.items():
            values = {k: np.array([combine(chosen(row["windows"])) for row in some]) for k, some in kinds.items()}
            for asked in ASKED:
                cells = (f"{k} {share(p < asked)}" for k, p in values.items())
                yield f"  {way:9} at {asked:g}: " + ", ".join(cells)
            cut = {k: np.quantile(values[k], COUNTED, method="lower") for k in ("plain", "clean")}
            cells = (f"{k} {share(values['captured'] < at)}" for k, at in cut.items())
            yield f"  {way:9} captured, at {COUNTED:.0%} counted on: " + ", ".join(cells)
    for words in (("spoofed",), ("spoofed", "suspect")):
        cells = (f"{k} {share([row['verdict'] in words for row in some])}" for k, some in kinds.items())
        yield f"verdict {' or '.join(words)}: " + ", ".join(cells)
    by_union, by_holm = np.sum([_rejected(row["windows"]) for row in captured], axis=0)
    yield f"tests rejected in {len(captured)} captured runs at {TOLD:g}: union {by_union}, Holm {by_holm}"
    for name, some in (("plain", plain), ("clean", clean)):
        yield f"{name}: tests below {ASKED[-1]:g} over their number, by detector: {_blamed(some)}"
        yield from (f"  {words}" for words in dependence(some))


def _rejected(windows: Windows) -> tuple[int, int]:
    every = _all(windows)
    return int(np.sum(every * every.size < TOLD)), int(np.sum(_by_holm(every) < TOLD))


def _blamed(rows: Sequence[Row]) -> str:
    """Which detectors' tests make the union's false alarms: runs with one, by detector."""
    found = Counter[str]()
    for row in rows:
        n = sum(map(len, row["windows"]))
        found.update({name for window in row["windows"] for name, p, _ in window if p * n < ASKED[-1]})
    return ", ".join(f"{name} {count}" for name, count in found.most_common()) or "none"


def dependence(rows: Sequence[Row]) -> Iterator[str]:
    """Of the detectors' p-values in a window: Spearman's correlation, and how often both are small."""
    windows = [by_detector(window) for row in rows for window in row["windows"]]
    for one, other in combinations(sorted({name for window in windows for name in window}), 2):
        both = np.array([(w[one], w[other]) for w in windows if one in w and other in w])
        if not both.size or (np.ptp(both, axis=0) == 0.0).any():
            continue
        small = both < JOINT
        expected = small.mean(axis=0).prod() * len(both)
        yield (
            f"{one}, {other}: rank correlation {stats.spearmanr(both).statistic:+.3f} in {len(both)} windows; below "
            f"{JOINT:g} {small.sum(axis=0).tolist()}, both {small.all(axis=1).sum()}, {expected:.2f} if independent"
        )


def share(hits: Any) -> str:
    """With its 95 % interval (Clopper, Pearson)."""
    found = stats.binomtest(int(np.sum(hits)), len(hits)).proportion_ci()
    return f"{np.mean(hits):.3f} ({found.low:.3f}-{found.high:.3f})"


def main() -> None:
    """Draw, judge and print the table."""
    parser = parser_of(__doc__)
    parser.add_argument("--attacks", type=int, default=0)
    parser.add_argument("--clean", type=int, default=0, help="with errors of the field, and as many without")
    parser.add_argument("--shade", type=int, default=0)
    chosen = parser.parse_args()
    counts = {"attack": chosen.attacks, "clean": chosen.clean, "plain": chosen.clean, "shade": chosen.shade}
    # Of all kinds alike, so that what was stopped can be counted.
    turns = [(number, kind) for kind, n in counts.items() for number in range(n)]
    print("\n".join(table(rows_of(chosen, [f"{kind}-{number}" for number, kind in sorted(turns)], row_of))))


if __name__ == "__main__":
    main()
