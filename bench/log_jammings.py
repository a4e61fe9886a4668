"""Interference put into logs of real receivers, and the same logs as they are: what `levels` reports of both.

    python bench/log_jammings.py --jammings 200 --shorts 200 --cuts 200 --out drawn.jsonl    goes on where stopped
    python bench/log_jammings.py --table drawn.jsonl                            the counts alone

Logs are those of `real_logs` with C/N0. A jamming takes 5 to 30 dB from all bands or from the upper one, for 10 s to a
third of the log (`skyproof.studies.log_attacks.put_jamming`), a short one for 2 to 6 s; what is too weak then is lost.
A cut is a part of a log
as it was recorded, half of it or more. Only the detector runs and what joins its windows: a second a draw. The words
of whole runs are counted by `log_attacks.py --jammings`.
"""

import argparse
from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any, Final

import numpy as np
from real_logs import LOGS, cut_log, open_real
from rows import Row, parser_of, rows_of

from skyproof.app.common.settings import Settings
from skyproof.app.common.windows import widen_windows, windows_of
from skyproof.app.receive.observed import observe_file
from skyproof.detectors.levels.detector import SignalLevels, SignalLevelsSettings
from skyproof.detectors.levels.front_end import carrier_name
from skyproof.errors import SkyproofError
from skyproof.explain import explain
from skyproof.fusion.interference import Spell, join_spells
from skyproof.gnss.time import seconds_between
from skyproof.records import Evidence, NavigationData, Observations
from skyproof.studies.log_attacks import Jamming, put_jamming

SEED: Final = 44
KINDS: Final = ("jamming", "cut", "short")
RATE: Final = 2.8e-6  # of a failed test a window: 0.001 an hour
LEAST_WINDOWS: Final = 6
STEPS_DB: Final = (5.0, 8.0, 12.0, 20.0, 30.0)


@cache
def usable() -> dict[str, Observations]:
    """Return the logs that hold C/N0 over some windows."""
    found = {}
    for name in LOGS:
        try:
            source, _ = open_real(name)
        except SkyproofError:
            continue
        log = observe_file(source).observations
        if log is None or not log.gpst.size:
            continue
        o = log.read(0, log.gpst.size)
        window_s = widen_windows(Settings(), [o]).window_s
        if np.isfinite(o.cn0_dbhz).any() and o.elapsed_s[-1] >= LEAST_WINDOWS * window_s:
            found[name] = o
    return found


def examine(o: Observations) -> list[Evidence]:
    """Return what the detector says of each window."""
    detector = SignalLevels(SignalLevelsSettings(false_alarm_probability=RATE))
    settings = widen_windows(Settings(), [o])
    state: Any = None
    found: list[Evidence] = []
    for records in windows_of([o], NavigationData(ephemerides=()), settings):
        evidence, state = detector.examine(records, state)
        found += evidence
    return found


def row_of(name: str) -> Row:
    """Make the row of a name such as "jamming-3" or "cut-17"."""
    what, number = name.split("-")
    rng = np.random.default_rng([SEED, int(number), KINDS.index(what)])
    logs = usable()
    log = str(rng.choice(sorted(logs)))
    whole = logs[log]
    last_s = float(whole.elapsed_s[-1])
    usual_s = float(np.median(np.diff(whole.elapsed_s)))
    row: Row = {"name": name, "what": what, "log": log, "usual_s": usual_s}
    if what == "cut":
        begin_s = rng.uniform(0.0, 0.5) * last_s
        o = cut_log(whole, begin_s, begin_s + rng.uniform(0.5, 1.0) * last_s)
        found = examine(o)
        return row | _counts(found, join_spells(found, [o]) or (), o) | {"seconds": float(o.elapsed_s[-1])}
    begin_s = rng.uniform(0.3, 0.6) * last_s
    lasts_s = max(rng.uniform(10.0, last_s / 3.0), 3.0 * usual_s) if last_s > 30.0 else last_s / 3.0
    lasts_s = max(float(rng.uniform(2.0, 6.0)), usual_s) if what == "short" else lasts_s
    jamming = Jamming(
        begin_s=begin_s,
        end_s=begin_s + lasts_s,
        loss_db=float(STEPS_DB[int(number) % len(STEPS_DB)]),
        upper_only=bool(rng.random() < 0.5),
    )
    o = put_jamming(whole, jamming, rng)
    found = examine(o)
    spells = join_spells(found, [o]) or ()
    rows = np.flatnonzero((o.elapsed_s >= jamming.begin_s) & (o.elapsed_s < jamming.end_s))
    row |= {"loss_db": jamming.loss_db, "upper_only": jamming.upper_only, "lasts_s": round(lasts_s, 1)}
    return row | _counts(found, spells, o) | _against_truth(spells, o, rows, jamming)


def _counts(found: Sequence[Evidence], spells: Sequence[Spell], o: Observations) -> Row:
    return {
        "windows": sum(e.p_value is not None for e in found),
        "failed": [explain(e).sentence for e in found if e.failed],
        "spells": [(list(s.carriers), round(s.fall_db, 1), s.may_be_shade) for s in spells],
        "begin_s": [round(float(seconds_between(s.since_gpst, o.gpst[0])), 2) for s in spells],
    }


def _against_truth(spells: Sequence[Spell], o: Observations, rows: Any, jamming: Jamming) -> Row:
    """Say how late in epochs it was dated, how many dB the fall is off, and what else was reported."""
    first, last = o.gpst[rows[0]], o.gpst[rows[-1]]
    met = [s for s in spells if s.since_gpst <= last and (s.until_gpst is None or s.until_gpst >= first)]
    reached = {carrier_name(s) for s, hz in zip(o.signals, o.carrier_hz, strict=True) if hz > 1.5e9}
    return {
        "reported": bool(met),
        "late_epochs": int(np.searchsorted(o.gpst, met[0].since_gpst)) - int(rows[0]) if met else None,
        "over_db": round(met[0].fall_db - jamming.loss_db, 1) if met else None,
        "lost": bool(met) and "lost" in met[0].signs,
        "beside": len(spells) - len(met),
        "other_bands": jamming.upper_only and bool(met) and bool({c for s in met for c in s.carriers} - reached),
    }


def table(rows: Sequence[Row]) -> Iterator[str]:
    """Print the counts."""
    cuts = [row for row in rows if row["what"] == "cut"]
    if cuts:
        hours = sum(row["seconds"] for row in cuts) / 3600.0
        windows = sum(row["windows"] for row in cuts)
        yield f"{len(cuts)} cuts of clean logs, {windows} windows, {hours:.1f} h:"
        for log in sorted({row["log"] for row in cuts}):
            some = [row for row in cuts if row["log"] == log]
            yield (
                f"  {log:12} {len(some):4} cuts, {sum(row['windows'] for row in some):5} windows: interference "
                f"{sum(len(row['spells']) for row in some)}, failed {sum(len(row['failed']) for row in some)}"
            )
        yield from (f"    {row['name']} {row['log']}: {row['spells']} {row['failed']}" for row in cuts if _odd(row))
    for what in ("jamming", "short"):
        yield from _jams([row for row in rows if row["what"] == what], what)


def _jams(jams: Sequence[Row], what: str) -> Iterator[str]:
    for loss_db in sorted({row["loss_db"] for row in jams}):
        some = [row for row in jams if row["loss_db"] == loss_db]
        met = [row for row in some if row["reported"]]
        exact = sum(row["late_epochs"] == 0 for row in met)
        over = [row["over_db"] for row in met if not row["lost"]]
        yield (
            f"{what}, {loss_db:4.0f} dB: {len(met):3} of {len(some):3} reported, {exact} of them dated to the epoch; "
            f"{f'off by {np.median(over):+.1f} dB at the median' if over else 'all with lost signals, a lower bound'}; "
            f"beside {sum(row['beside'] for row in some)}; other bands {sum(row['other_bands'] for row in met)}; "
            f"failed tests in {sum(bool(row['failed']) for row in some)}"
        )
    for log in sorted({row["log"] for row in jams}):
        some = [row for row in jams if row["log"] == log]
        yield f"  {log:12} {sum(row['reported'] for row in some):3} of {len(some):3} reported"
    yield from (f"    {row['name']} {row['log']}: {row['failed'][:2]}" for row in jams if row["failed"])


def _odd(row: Row) -> bool:
    return bool(row["spells"] or row["failed"])


def main() -> None:
    """Run and print the counts."""
    parser = parser_of(__doc__)
    for option in ("jammings", "shorts", "cuts"):
        parser.add_argument(f"--{option}", type=int, default=0)
    chosen: argparse.Namespace = parser.parse_args()
    names = [f"{kind}-{k}" for kind in sorted(KINDS) for k in range(getattr(chosen, f"{kind}s"))]
    print("\n".join(table(rows_of(chosen, names, row_of))))


if __name__ == "__main__":
    main()
