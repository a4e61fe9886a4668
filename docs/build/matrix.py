"""Write the page of the protection matrix from the rows of a study, or of two more, with the second's chart beside it.

skyproof study protection-matrix --json --out DIR > cells.json
skyproof study protection-stanford --json --out DIR > levels.json
skyproof study protection-clean --json --out DIR > clean.json
python docs/build/matrix.py docs/protection.md cells.json [levels.json clean.json]

Without the last two the sections that they make stay as they are in the page.
"""

import json
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import numpy as np

from skyproof.report.chart import draw_chart_svg
from skyproof.simulator.scenes import read_ready_made
from skyproof.studies.base import StudySettings
from skyproof.studies.protection import matrix
from skyproof.studies.protection.equipment import EQUIPMENT
from skyproof.verdict import WORDS, write_word

Row = Mapping[str, Any]
PICTURE: Final = "protection.svg"
CHARTS: Final = next(study.charts for study in matrix.STUDIES if study.name == "protection-stanford")
HEAD = """# Protection matrix

What `protect` makes of the simulated samples of every ready-made [scene](scenarios.md), with nine kinds of equipment
and a platform file. Scenes are shortened to 110 s from 20 s before the attack begins, and sampled at 5 Msps at most; a
scene that moves has no standing equipment.

skyproof {version}, {date}: {cells}. `skyproof study protection-matrix --json` makes them again: some minutes of
a processor each scene; with `--out DIR` it goes on where it was stopped.

A cell holds the verdict ({letters}), a
delay, an error and two shares. The delay, in seconds, is from the first false wave or the first sample to the end of
the first window in which a test says so (– : none does). The error is the largest of a trusted fix, in metres. The
shares, in percent, are of epochs with a trusted fix and with a consistent one. *Unprotected* is the largest error of an
ordinary receiver in the same samples, in metres. An empty cell cannot be.
{before}"""
LETTERS: Final = {word: word[0].upper() for word in reversed(WORDS)} | {"suspect": "?"}
BEFORE: Final = {"undecided": "U"}
"""Of rows that were made before that word was parted into *suspect* and *no attack seen*."""
PARTED: Final = """
These rows were made before *undecided* (**U**) was parted into *suspect* (a test failed) and *no attack seen* (all that
could run passed): which of the two a cell is they do not hold.
"""

LEVELS_TITLE: Final = "## Protection levels"
LEVELS: Final = """*`skyproof study protection-stanford --plot` draws it. No trusted satellite is wrong in these scenes,
and fixes that inertia alone carries are off the most. How often levels hold with a wrong one is
[counted](verdict.md#how-far-a-trusted-fix-may-be-off).*"""

HOURS: Final = """*Runs of `skyproof study protection-clean`: 100 s of samples each, at drawn places and times,
standing, on a way or in circles, with reflections from the ground and from walls. A false alarm is a window of 10 s
in which a test says that there is an attack; no more than the next column come in an hour, at 95 %.*"""


def table(rows: Sequence[Row]) -> Iterator[str]:
    cells = {(row["scene"], row["equipment"]): row for row in rows}
    yield "| scene | unprotected | " + " | ".join(EQUIPMENT) + " |"
    yield "|---|---:|" + "---|" * len(EQUIPMENT)
    for scene in dict.fromkeys(row["scene"] for row in rows):
        own = [cells.get((scene, name)) for name in EQUIPMENT]
        plain = next((row for row in own if row is not None and "unprotected_worst_m" in row), None)
        worst_m = None if plain is None else plain["unprotected_worst_m"]
        yield f"| `{scene}` | {_number(worst_m)} | " + " | ".join(_cell(row) for row in own) + " |"


def _cell(row: Row | None) -> str:
    if row is None:
        return ""
    if "error" in row:
        return "error"
    delay = "–" if row["delay_s"] is None else f"{row['delay_s']:.0f}"
    letter = (LETTERS | BEFORE)[row["verdict"]]
    shares = f"{100 * row['trusted_share']:.0f}+{100 * row['consistent_share']:.0f}"
    return f"**{letter}** {delay}; {_number(row['trusted_worst_m'])}; {shares}"


def _metres(value: float | None) -> str:
    return _number(value) if value is None else f"{_number(value)} m"


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.1f}" if value < 100.0 else f"{value:.0f}"


def sums(rows: Sequence[Row]) -> Iterator[str]:
    good = [row for row in rows if "error" not in row]
    attacked = [row for row in good if read_ready_made(row["scene"]).attacks]
    told = sum(row["verdict"] == "spoofed" for row in attacked)
    missed = sum(row["verdict"] == "authentic" or row["no_sign"] for row in attacked)
    false = sum(row["verdict"] == "spoofed" for row in good) - told
    others = Counter(row["verdict"] for row in attacked if row["verdict"] not in ("spoofed", "authentic"))
    words = ", ".join(f"{others[word]} *{write_word(word)}*" for word in (*WORDS, *BEFORE) if others[word])
    yield f"- With an attack: {told} of {len(attacked)} cells *spoofed*, {missed} *authentic*, {words or 'no others'}."
    yield f"- Without one: {false} of {len(good) - len(attacked)} cells *spoofed*."
    yield f"- Trusted fixes off by more than three of their 95 % bounds: {_sum(good, 'wrong_fixes')}."
    yield f"- Wrong labels *authentic* or *spoofed* for a second or more: {_sum(good, 'wrong_labels')}."
    beyond = _sum(good, "beyond_protection"), _sum(good, "beyond_vertical_protection")
    yield f"- Trusted fixes beyond their protection level: {beyond[0]} horizontally, {beyond[1]} vertically."


def _sum(rows: Sequence[Row], key: str) -> int:
    return sum(row[key] for row in rows)


def levels(rows: Sequence[Row]) -> Iterator[str]:
    """Sizes from the bins of the diagram, which are 12 % wide."""
    yield LEVELS_TITLE
    yield ""
    yield "| trusted fixes | with a level | level: median | 95 % | error: median | 95 % | largest error over level |"
    yield "|---|---:|---:|---:|---:|---:|---:|"
    for axis in dict.fromkeys(row["axis"] for row in rows):
        own = [row for row in rows if row["axis"] == axis]
        counts = [row["fixes"] for row in own]
        sizes = [
            _metres(float(value))
            for column in ("protection_m", "error_m")
            for value in np.quantile(np.repeat([row[column] for row in own], counts), (0.5, 0.95))
        ]
        largest = max(row["error_m"] / row["protection_m"] for row in own)
        yield f"| {axis} | {sum(counts)} | " + " | ".join(sizes) + f" | {largest:.3f} |"
    yield ""
    yield f"![Error of each trusted fix over its protection level; none is above the line]({PICTURE})"
    yield ""
    yield LEVELS


def hours(rows: Sequence[Row]) -> Iterator[str]:
    words = [write_word(word) for word in (*WORDS, *BEFORE) if any(word in row for row in rows)]
    names = ("equipment", "runs", "hours", *words, "false alarms", "at most an hour", "wrong labels", "wrong fixes")
    yield "## Hours without an attack"
    yield ""
    yield "| " + " | ".join(names) + " |"
    yield "|---" + "|---:" * (len(names) - 1) + "|"
    for row in rows:
        numbers = [f"{row[name.replace(' ', '_')]:.3g}" for name in names[1:]]
        yield f"| {row['equipment']} | " + " | ".join(numbers) + " |"
    yield ""
    yield HOURS


def page(rows: Sequence[Row], others: Sequence[str]) -> str:
    """Return the page. others : lines of its other sections."""
    possible = sum(len(asked.equipments) for asked in matrix.cells(StudySettings()))
    there = sum("error" not in row for row in rows)
    head = HEAD.format(
        version=version("skyproof"),
        date=datetime.now(UTC).date(),
        letters=", ".join(f"**{letter}** {write_word(word)}" for word, letter in LETTERS.items()),
        before=PARTED if any(row.get("verdict") in BEFORE for row in rows) else "",
        cells=f"{there} of {possible} cells" if there < possible else f"all {possible} cells",
    )
    return "\n".join([head, *sums(rows), "", *table(rows), "", *others, ""])


def main() -> None:
    """Write the page, and its picture where there are rows of it."""
    written, cells, *more = map(Path, sys.argv[1:])
    if more:
        bins, clean = map(_rows, more)
        others = [*levels(bins), "", *hours(clean)]
        (written.parent / PICTURE).write_text(draw_chart_svg(bins, CHARTS), encoding="utf-8")
    else:
        before = written.read_text(encoding="utf-8").rstrip().splitlines()
        others = before[before.index(LEVELS_TITLE) :]
    written.write_text(page(_rows(cells), others), encoding="utf-8")


def _rows(path: Path) -> list[Row]:
    found: list[Row] = json.loads(path.read_text(encoding="utf-8"))["rows"]
    return found


if __name__ == "__main__":
    main()
