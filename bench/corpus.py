"""What the decision says of many scenes, files and logs, kept so that two trees can be held against each other.

    make corpus                                           into .cache/corpus.jsonl; goes on where it was stopped
    python bench/corpus.py --quick --out a.jsonl          one to three rows of every kind, some minutes on one core
    python bench/corpus.py --samples --out a.jsonl        scenes and cells through samples as well: hours
    python bench/corpus.py --only attack-3 case-07        rows of these names alone; without --out they are printed
    python bench/corpus.py --compare a.jsonl b.jsonl      what differs, sorted: better, worse, other

A row holds, for each run, the word, the label of each epoch, trusted positions, the least p-value of each test in each
window, which tests failed by which code, and interference; beside them the truth and what of this is right and wrong.
Scenes are those that the other benches draw, at measurement level or behind drawn correlators; files, logs and cases
are those of the folder that SKYPROOF_DATA names, and are left out where there is none.
"""

import argparse
import json
import sys
import tomllib
from collections import Counter
from pathlib import Path

import damaged
import words
from corpus_differences import differences
from corpus_kinds import CASES, REAL, names_of_cells, names_of_files, row_of
from real_logs import LOGS
from rows import read, run

from skyproof.detectors.entries import GROUP, list_registered

DEFAULT_OUT = Path(".cache/corpus.jsonl")
DRAWN = {"attack": 240, **dict.fromkeys(words.CLEAN, 120), "several": 80, "takeover": 150, "missing": 60}
"""Scenes of each kind by default."""
VECTOR_TAKEOVERS, WINDOWS, DAMAGED = 30, 80, 16
"""Takeovers in vector tracking, windows of arrays and arms clean and attacked, damages of each kind."""
LOG_ATTACKS, LOG_JAMMINGS, LOG_CUTS = 384, 96, 8
SAMPLES = 20
QUICK = (
    *("attack-0", "attack-1", "attack-6", "plain-1", "reflections-0", "reflections-3", "jammed-0", "jammed-1"),
    *("several-0", "several-1", "takeover-0", "takeover-1", "takeover-2", "takeover-1-vector", "missing-0"),
    *("array-0", "array-1-attack", "array-2-attack", "arm-0", "arm-1-attack"),
    *(f"damaged-{kind}-1" for kind in damaged.KINDS),
    *("cell-takeover-0", "cell-jamming-1", "cell-texbat-like-2-2", "cell-starts-spoofed-3", "cell-takeover-4"),
)
QUICK_REAL = (
    *(f"logattack-{number}" for number in (0, 1, 2, 3, 4, 5, 12, 18, 19, 35)),
    *("logjamming-0", "logjamming-1", "log-walk-0", "log-phone_1107-0", "log-kms3-2", "log-osnma_park-0"),
    *("file-1m", "file-3km", "file-5km", "file-ubx", "file-pulled", *(f"case-{number}" for number in CASES)),
)


def names_of(*, samples: bool = False) -> list[str]:
    """Return the rows of the whole corpus, of every kind throughout; of files and logs where there is a data folder."""
    kinds = [[f"{kind}-{k}" for k in range(count)] for kind, count in DRAWN.items()]
    kinds.append([f"takeover-{k}-vector" for k in range(VECTOR_TAKEOVERS)])
    kinds += [[f"{kind}-{k}{end}" for k in range(WINDOWS)] for kind in ("array", "arm") for end in ("", "-attack")]
    kinds += [[f"damaged-{kind}-{k}" for k in range(DAMAGED)] for kind in damaged.KINDS]
    kinds.append(names_of_cells())
    if has_data():
        kinds += [[f"logattack-{k}" for k in range(LOG_ATTACKS)], [f"logjamming-{k}" for k in range(LOG_JAMMINGS)]]
        kinds += [names_of_files(), [f"log-{log}-{k}" for k in range(1, LOG_CUTS + 1) for log in LOGS]]
    kinds += [names_through_samples()] if samples else []
    return [name for _, name in sorted((k / len(names), name) for names in kinds for k, name in enumerate(names))]


def names_through_samples() -> list[str]:
    """Return the rows that render samples."""
    return [f"samples-attack-{k}" for k in range(SAMPLES)] + [
        name.replace("cell-", "cellsamples-") for name in names_of_cells()
    ]


def not_installed() -> list[str]:
    """Return the detectors of this tree that the environment does not know: a run leaves them out without a word."""
    project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return sorted(project["entry-points"][GROUP].keys() - {point.name for point in list_registered()})


def has_data() -> bool:
    return damaged.folder().is_dir()


def quick_names() -> list[str]:
    """Return one to three rows of every kind."""
    return [*QUICK, *(QUICK_REAL if has_data() else ())]


def compare(before: Path, after: Path) -> int:
    """Print what differs and return how much of it is worse."""
    found = list(differences(read(before), read(after)))
    for kind in ("worse", "other", "better"):
        lines = [text for sort, text in found if sort == kind]
        print(f"{kind}: {len(lines)}", *(f"  {text}" for text in lines), sep="\n")
    return sum(kind == "worse" for kind, _ in found)


def main() -> int:
    """Make the corpus, or compare two."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--samples", action="store_true")
    parser.add_argument("--only", nargs="+")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--compare", type=Path, nargs=2, metavar=("BEFORE", "AFTER"))
    options = parser.parse_args()
    if options.compare:
        return int(compare(*options.compare) > 0)
    if missing := not_installed():
        parser.error(f"detectors that are not installed: {', '.join(missing)}; run `make setup`")
    if options.only and not options.out:
        print("\n".join(json.dumps(row_of(name), default=str) for name in options.only))
        return 0
    if not has_data():
        print(f"{damaged.folder()} is not there: rows of {', '.join(REAL)} are left out", file=sys.stderr)
    out = options.out or DEFAULT_OUT
    out.parent.mkdir(parents=True, exist_ok=True)
    names = options.only or (quick_names() if options.quick else names_of(samples=options.samples))
    rows = run(names, row_of, out, options.processes)
    counts = Counter((item["truth"], item["word"][:40]) for row in rows for item in row["runs"].values())
    for (truth, word), count in sorted(counts.items()):
        print(f"{truth or '-':10s} {word or '-':40s} {count}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
