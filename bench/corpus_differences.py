"""What differs between two runs of the corpus, sorted by the truth of each row: better, worse, other."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np
from rows import Row

from skyproof.verdict import WORDS

MOVED_M: Final = 1e-3
"""A trusted position that differs by less is the same."""
P_RATIO: Final = 1e-3
"""A p-value that differs by less is the same."""


def differences(before: Sequence[Row], after: Sequence[Row]) -> Iterator[tuple[str, str]]:
    """Yield "better", "worse" or "other", and a line that says what differs."""
    old_rows, new_rows = ({row["name"]: row for row in rows} for rows in (before, after))
    for name, row in new_rows.items():
        if name not in old_rows:
            yield "other", f"{name}: was not there before"
            continue
        old_runs = old_rows[name]["runs"]
        for run in sorted(old_runs.keys() | row["runs"].keys()):
            old, new = old_runs.get(run, {"word": "not run"}), row["runs"].get(run, {"word": "not run"})
            yield from ((sort, f"{name} {run}: {text}".replace(" :", ":")) for sort, text in _of_run(old, new))
    yield from (("other", f"{name}: is not there any more") for name in old_rows.keys() - new_rows.keys())


def _of_run(old: Row, new: Row) -> Iterator[tuple[str, str]]:
    if old["word"] != new["word"]:
        yield sort_words(new.get("truth", ""), old["word"], new["word"]), f"{old['word']} -> {new['word']}"
    yield from _labels(old, new)
    yield from _places(old, new)
    yield from _p_values(old.get("p", {}), new.get("p", {}))
    old, new = _same_codes(old, new)
    for key in ("failed", "interference", "may_also_be", "seen", "gaps", "truth"):
        if old.get(key) != new.get(key):
            yield "other", f"{key}: {_part(old.get(key), new.get(key))} -> {_part(new.get(key), old.get(key))}"
    counts = [key for key in ("false_alarms",) if _count(old, key) != _count(new, key)]
    for key in counts:
        sort = "worse" if _count(new, key) > _count(old, key) else "better"
        yield sort, f"{key}: {_count(old, key)} -> {_count(new, key)}"


def _same_codes(old: Row, new: Row) -> tuple[Row, Row]:
    """Return both with failed tests counted without their codes, where one tree has none for them."""
    if not any(key.split()[1] == "-" for row in (old, new) for key in row.get("failed", {})):
        return old, new
    return tuple(row | {"failed": _without_codes(row["failed"])} if "failed" in row else row for row in (old, new))  # type: ignore[return-value]


def _without_codes(failed: Mapping[str, int]) -> dict[str, int]:
    counts: Counter[str] = Counter()
    for key, count in failed.items():
        detector, _, *rest = key.split()
        counts[" ".join([detector, *rest])] += count
    return dict(sorted(counts.items()))


def _part(value: Any, other: Any) -> Any:
    """Return what the other does not have."""
    if isinstance(value, dict) and isinstance(other, dict):
        return {key: item for key, item in value.items() if other.get(key) != item}
    if isinstance(value, list) and isinstance(other, list):
        return [item for item in value if item not in other]
    return value


def sort_words(truth: str, before: str, after: str) -> str:
    """Tell whether the second word is nearer to the truth than the first one."""
    if truth not in ("clean", "captured") or not {before, after} <= set(WORDS):
        return "other"
    order = WORDS if truth == "captured" else WORDS[::-1]
    return "better" if order.index(after) > order.index(before) else "worse"


def sort_counts(old: Row, new: Row, what: str) -> str:
    """Tell whether fewer are wrong or, of as many, more are right."""
    wrong, right = f"wrong_{what}", f"right_{what}"
    for key, sign in ((wrong, -1), (right, 1)):
        change = sign * (_count(new, key) - _count(old, key))
        if change:
            return "better" if change > 0 else "worse"
    return "other"


def _count(row: Row, key: str) -> int:
    return int(row.get("counts", {}).get(key, 0))


def _labels(old: Row, new: Row) -> Iterator[tuple[str, str]]:
    was, now = old.get("labels", {}), new.get("labels", {})
    changed = [key for key in was.keys() | now.keys() if was.get(key) != now.get(key)]
    if changed:
        key = min(changed)
        text = f"{len(changed)} stretches of labels, as {key}: {was.get(key)} -> {now.get(key)}"
        yield sort_counts(old, new, "labels"), text


def _places(old: Row, new: Row) -> Iterator[tuple[str, str]]:
    was, now = old.get("places", {}), new.get("places", {})
    for receiver in sorted(was.keys() | now.keys()):
        text = _moved(was.get(receiver, []), now.get(receiver, []))
        if text:
            yield sort_counts(old, new, "fixes"), f"{receiver}: {text}"
    for kind in () if was != now else ("fixes",):
        if _count(old, f"wrong_{kind}") != _count(new, f"wrong_{kind}"):
            yield sort_counts(old, new, kind), f"wrong_{kind}: {old['counts']} -> {new['counts']}"


def _moved(was: Sequence[Any], now: Sequence[Any]) -> str:
    old_m, new_m = np.array(was, float).reshape(-1, 3), np.array(now, float).reshape(-1, 3)
    old_has, new_has = np.isfinite(old_m).all(axis=1), np.isfinite(new_m).all(axis=1)
    if old_has.sum() != new_has.sum():
        return f"{old_has.sum()} -> {new_has.sum()} trusted epochs"
    if old_m.shape != new_m.shape or not np.array_equal(old_has, new_has):
        return "other epochs are trusted"
    step_m = float(np.linalg.norm(old_m[old_has] - new_m[old_has], axis=1).max(initial=0.0))
    return f"trusted places by up to {step_m:.3f} m" if step_m > MOVED_M else ""


def _p_values(was: Mapping[str, float], now: Mapping[str, float]) -> Iterator[tuple[str, str]]:
    tests: Counter[str] = Counter()
    for key in was.keys() | now.keys():
        old, new = was.get(key), now.get(key)
        if old is None or new is None or abs(old - new) > P_RATIO * max(old, new):
            tests[key.split()[0]] += 1
    if tests:
        yield "other", "p-values of windows: " + ", ".join(f"{name} {count}" for name, count in sorted(tests.items()))
