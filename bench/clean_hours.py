"""Hours of clean sky at measurement level through the whole decision: false alarms counted against the asked rate.

    python bench/clean_hours.py --hours 100 --out hours.jsonl     goes on where it was stopped
    python bench/clean_hours.py --table hours.jsonl               the counts alone

Half of the hours are of two receivers ("pair"), half of one ("single"), in runs of ten minutes at drawn places and
times, standing, moving or turning, with antennas known or not, as in `skyproof.studies.random_scenes`; no reflections,
and errors as they are assumed: code noise of 0.4 to 0.9 m, white or AR(1) 0.9 from epoch to epoch, and a constant error
of each signal. Windows are of 10 s. Runs are judged at 0.4 false alarms an hour, nearly the most that can be asked:
whether 0.001, which is asked by itself, comes too seldom would take thousands of hours. What would be said at lower
rates follows from how far below its share of the rate a test's p-value is; `--asked 0.001` judges further runs so.

Counted are windows in which signals are said to be false, or an attack, and those in which a test fails without that
word, with Poisson's 95 % interval of their rate; verdicts; and p-values by detector, of which a share of 1 % would be
below 0.01, and above 0.99, were they uniform. Windows of one run share its constant errors: intervals of shares are by
runs.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from drawn import heard_of, settings_of
from fused import AGAINST, dependence, tests_of
from rows import Row, parser_of, rows_of
from scipy import stats

from skyproof.app.common.progress import Silent
from skyproof.app.common.settings import Settings
from skyproof.app.protect import judge
from skyproof.explain import explain
from skyproof.records import Evidence
from skyproof.studies.random_scenes import build_scene, draw_scene

RUN_S: Final = 600.0
FIRST: Final = 1_000_000
"""Number of the first scene: those before are of other counts."""
CONSTANT_M: Final = 1.0
ASKED: Final = 0.4
LOWER: Final = (0.1, 0.01, 0.001)
"""Rates an hour at which is counted as well."""
LIMITS: Final = (0.1, 0.01, 0.001)
PLACES: Final = 4
"""Digits that are kept of a p-value."""


def row_of(name: str) -> Row:
    """A run of a name such as "pair-17-0.001"."""
    kind, number, rate = name.split("-", 2)
    drawn = draw_scene(f"clean-{FIRST + int(number)}", most_receivers=2, duration_s=RUN_S)
    made = build_scene(replace(drawn, field=False, constant_m=CONSTANT_M))
    assert made is not None
    kept = 2 if kind == "pair" else 1
    heard = heard_of(replace(made, scene=replace(made.scene, skies=made.scene.skies[:kept])))
    settings = settings_of(made) if kind == "pair" else Settings()
    asked = settings.model_copy(update={"false_alarm_probability_per_hour": float(rate)})
    outcome, _ = judge([h.reception for h in heard], made.navigation, asked, Silent())
    findings = [e for e in outcome.evidence if e.says in AGAINST]
    failed = [e for e in outcome.evidence if e.failed]
    return {
        "name": name,
        "hours": RUN_S / 3600.0,
        "verdict": outcome.decision.verdict,
        "n_windows": len({(e.start_gpst, e.end_gpst) for e in outcome.evidence}),
        "against": _from_rates(findings, float(rate)),
        "failed": _from_rates(failed, float(rate)),
        "why": sorted({f"{e.detector}: {explain(e).sentence}" for e in (*findings, *failed)}),
        "labels": sum(s.label == "spoofed" for s in outcome.decision.labels),
        "windows": [[(d, float(f"{p:.{PLACES}g}"), s) for d, p, s in w] for w in tests_of(outcome.evidence)],
    }


def _from_rates(evidence: Iterable[Evidence], rate: float) -> dict[str, float]:
    """By window, from which rate asked an hour on some of these tests reject."""
    found: dict[str, float] = {}
    for e in evidence:
        share = e.alpha or 1.0
        window = str(e.start_gpst)
        found[window] = min(found.get(window, np.inf), rate * (e.p_value or 0.0) / share)
    return found


def table(rows: Sequence[Row]) -> Iterator[str]:
    for rate in sorted({row["name"].rpartition("-")[2] for row in rows}, key=float):
        at_rate = [row for row in rows if row["name"].endswith(f"-{rate}")]
        yield f"asked: {rate} an hour"
        for kind in ("pair", "single", ""):
            yield from _counts([row for row in at_rate if row["name"].startswith(kind)], kind or "all", float(rate))
    for kind in ("pair", "single"):
        some = [row for row in rows if row["name"].startswith(kind)]
        yield f"{kind}: p-values by detector, shares of windows with intervals by runs"
        for detector in sorted({name for row in some for window in row["windows"] for name, _, _ in window}):
            yield f"  {detector:15} {_shares(some, detector)}"
        yield from (f"  {words}" for words in dependence(some))


def _counts(rows: Sequence[Row], kind: str, asked: float) -> Iterator[str]:
    if not rows:
        return
    hours = sum(row["hours"] for row in rows)
    yield f"  {kind}: {len(rows)} runs, {sum(row['n_windows'] for row in rows)} windows, {hours:.1f} h"
    yield f"    {dict(Counter(row['verdict'] for row in rows))}; labels false {sum(row['labels'] for row in rows)}"
    for rate in (asked, *(lower for lower in LOWER if lower < asked)):
        words = []
        for title, key in (("against the sky", "against"), ("a test fails", "failed")):
            windows = sum(at <= rate for row in rows for at in row[key].values())
            runs = sum(any(at <= rate for at in row[key].values()) for row in rows)
            words.append(f"{title} {windows} windows, {runs} runs: {_rate(runs, hours)} an hour")
        yield f"    at {rate:g} an hour, {rate * hours:.2f} expected at most: " + "; ".join(words)
    yield from (f"    {row['name']}: {words}" for row in rows for words in row["why"])


def _rate(count: int, hours: float) -> str:
    """Poisson's exact 95 % interval."""
    low = stats.chi2.ppf(0.025, 2 * count) / 2.0 if count else 0.0
    return f"{count / hours:.4f} ({low / hours:.4f}-{stats.chi2.ppf(0.975, 2 * count + 2) / 2.0 / hours:.4f})"


def _shares(rows: Sequence[Row], detector: str) -> str:
    """Of the p-values below and above some, each with the error of the mean over runs."""
    matching = [np.array([p for w in row["windows"] for name, p, _ in w if name == detector]) for row in rows]
    matching = [p for p in matching if p.size]
    cells = [f"below {at:g} {_by_runs([p < at for p in matching])}" for at in LIMITS]
    cells += [f"above 0.99 {_by_runs([p > 0.99 for p in matching])}", f"of 1 {_by_runs([p == 1.0 for p in matching])}"]
    return f"{sum(p.size for p in matching)}: " + ", ".join(cells)


def _by_runs(hits: Sequence[Any]) -> str:
    """A share, and its standard error times 1.96 with runs as what is independent."""
    n, k = np.array([hit.size for hit in hits]), np.array([hit.sum() for hit in hits])
    mean = k.sum() / n.sum()
    error = np.sqrt(np.sum((k - mean * n) ** 2)) / n.sum()
    return f"{mean:.5f} ± {1.96 * error:.5f}"


def main() -> None:
    """Run and print the counts."""
    parser = parser_of(__doc__)
    parser.add_argument("--hours", type=float, default=0.0)
    parser.add_argument("--asked", type=float, default=ASKED, help="false alarms an hour")
    parser.add_argument("--first", type=int, default=0, help="number of the first run")
    chosen = parser.parse_args()
    each = round(chosen.hours * 3600.0 / RUN_S / 2.0)
    numbers = range(chosen.first, chosen.first + each)
    names = [f"{kind}-{number}-{chosen.asked:g}" for number in numbers for kind in ("pair", "single")]
    print("\n".join(table(rows_of(chosen, names, row_of))))


if __name__ == "__main__":
    main()
