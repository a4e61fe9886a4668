"""Every log of a real receiver, whole and cut anywhere, through the whole decision: words against a clean sky counted.

    python bench/clean_logs.py --cuts 20 --out clean.jsonl      twenty cuts of each log; goes on where it was stopped
    python bench/clean_logs.py --table clean.jsonl              the counts alone

A cut is a stretch of ten epochs or more, drawn evenly over where it begins and, in the logarithm, over how long it is;
every fourth has every second epoch left out, every fourth other one a gap. Nothing is stated of the receiver. Hours are
added up by file; what fails in any window is printed.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from real_logs import LOGS, open_real, take_rows
from rows import Row, parser_of, rows_of

from skyproof.app.common.progress import Silent
from skyproof.app.common.settings import Settings
from skyproof.app.common.windows import widen_windows
from skyproof.app.protect.judging import judge
from skyproof.app.protect.outcome import Outcome
from skyproof.app.receive.inputs import adopt_antenna_multipath
from skyproof.app.receive.observed import ObservedFile, observe_file
from skyproof.errors import InputError, SkyproofError
from skyproof.explain import explain
from skyproof.records import NavigationData, ObservationLog, Observations

LEAST_EPOCHS: Final = 10
SEED: Final = 47


def row_of(name: str) -> Row:
    """Make the row of a name such as "walk-0", the whole log, or "walk-17", a cut."""
    log = name.rpartition("-")[0]
    try:
        source, navigation = open_real(log)
    except SkyproofError as error:
        return {"name": name, "verdict": "refused", "why": str(error)[:200], "hours": 0.0, "failed": []}
    o = cut_of(name, source.observations)
    row: Row = {"name": name, "epochs": int(o.gpst.size), "hours": float(o.elapsed_s[-1]) / 3600.0, "failed": []}
    try:
        outcome = judged(source, o, navigation)
    except SkyproofError as error:
        return row | {"verdict": "refused", "why": str(error)[:200]}
    failed = [e for e in outcome.evidence if e.failed or e.says in ("attack", "spoofed")]
    return row | {
        "verdict": outcome.decision.verdict,
        "failed": sorted({f"{e.detector}: {explain(e).sentence} (p {e.p_value:.2g})" for e in failed}),
    }


def outcome_of(name: str) -> Outcome:
    """Judge the log of a name, whole or cut."""
    source, navigation = open_real(name.rpartition("-")[0])
    return judged(source, cut_of(name, source.observations), navigation)


def cut_of(name: str, whole: ObservationLog) -> Observations:
    """Return the epochs that the name asks for."""
    log, _, number = name.rpartition("-")
    o = whole.read(0, whole.gpst.size)
    return (
        draw_cut(o, np.random.default_rng([SEED, list(LOGS).index(log), int(number)]), int(number))
        if int(number)
        else o
    )


def judged(source: ObservedFile, o: Observations, navigation: NavigationData) -> Outcome:
    """Judge a log as `protect` does."""
    reception = observe_file(replace(source, observations=o))
    if reception.observations is None:
        raise InputError(f"{source.observations.receiver}: no epoch has a measurement")
    settings = widen_windows(adopt_antenna_multipath(Settings(), [source]), [reception.observations])
    return judge([reception], navigation, settings, Silent())[0]


def draw_cut(o: Observations, rng: np.random.Generator, number: int) -> Observations:
    """Draw a stretch, thinned or with a gap."""
    n = o.gpst.size
    length = int(np.exp(rng.uniform(np.log(LEAST_EPOCHS), np.log(n)))) if n > LEAST_EPOCHS else n
    first = int(rng.integers(0, n - length + 1))
    rows = np.arange(first, first + length)
    if number % 4 == 1 and length >= 2 * LEAST_EPOCHS:
        rows = rows[::2]
    if number % 4 == 3 and length >= 2 * LEAST_EPOCHS:
        begin = int(rng.integers(1, length - LEAST_EPOCHS // 2))
        rows = np.delete(rows, slice(begin, begin + int(rng.integers(1, length // 2))))
    return take_rows(o, rows)


def table(rows: Sequence[Row]) -> Iterator[str]:
    """Print the counts by file."""
    for log in [*LOGS, ""]:
        some = [row for row in rows if not log or row["name"].rpartition("-")[0] == log]
        words: dict[str, Any] = Counter(row["verdict"] for row in some)
        if some:
            hours = sum(row["hours"] for row in some)
            counts = ", ".join(f"{word} {count}" for word, count in sorted(words.items()))
            yield f"{log or 'all':16} {len(some):4} runs, {hours:6.2f} h: {counts}"
    for row in rows:
        if row["verdict"] in ("spoofed", "suspect"):
            yield f"  {row['name']}, {row['epochs']} epochs: {row['verdict']}"
            yield from (f"      {words[:200]}" for words in row["failed"])


def main() -> None:
    """Run and print the counts."""
    parser = parser_of(__doc__)
    parser.add_argument("--cuts", type=int, default=0)
    chosen = parser.parse_args()
    names = [f"{log}-{number}" for number in range(chosen.cuts + 1) for log in LOGS]
    print("\n".join(table(rows_of(chosen, names, row_of))))


if __name__ == "__main__":
    main()
