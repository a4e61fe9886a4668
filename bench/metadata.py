"""Metadata of SigMF: what our reader makes of damaged ones, and what the library sigmf would have refused before it.

One to three damages each: a value lost, misspelt in its key, or exchanged for another one of JSON. A recording is right
if samples, rate, frequencies, start and gaps are those of the undamaged one.
"""

import copy
import hashlib
import json
import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any

import numpy as np
from sigmf import SigMFFile
from sigmf.error import SigMFError
from timing import line, take_turns

from skyproof.errors import InputError
from skyproof.formats.sigmf import open_sigmf
from skyproof.formats.sigmf_keys import check_keys, parse_meta

INPUTS = 1000
CAPTURES = 10_000
VALUES: tuple[Any, ...] = (None, True, 0, -1, 2, 1.5, 4096.0, 1e308, 2**63, "", "ci16_lex", "yesterday", [], {}, [1])
STORED = np.random.default_rng(1).integers(0, 256, 40_000, dtype=np.uint8).tobytes()
WHOLE: dict[str, Any] = {
    "global": {
        "core:datatype": "ci8",
        "core:sample_rate": 4e6,
        "core:version": "1.2.6",
        "core:num_channels": 2,
        "core:sha512": hashlib.sha512(STORED).hexdigest(),
        "core:author": "someone",
        "core:license": "MIT",
        "core:hw": "a receiver",
        "core:dataset": "a.dat",
        "core:trailing_bytes": 4,
        "skyproof:antenna": "bow",
        "core:extensions": [{"name": "skyproof", "version": "1.0.0", "optional": True}],
    },
    "captures": [
        {
            "core:sample_start": 0,
            "core:frequency": 1575.42e6,
            "core:header_bytes": 8,
            "core:datetime": "2024-05-14T09:59:40Z",
            "core:geolocation": {"type": "Point", "coordinates": [11.9, 57.7, 30.0]},
        },
        {"core:sample_start": 4096, "core:frequency": 1575.42e6, "core:global_index": 5000},
        {"core:sample_start": 8192, "core:frequency": 1227.6e6},
    ],
    "annotations": [{"core:sample_start": 100, "core:sample_count": 50, "core:label": "burst"}],
}


def report() -> Iterator[str]:
    """Rows of the table."""
    warnings.simplefilter("ignore")  # of the library
    yield f"metadata of SigMF, {INPUTS} damaged ones, by what open_sigmf gives and whether sigmf.validate accepts them"
    with TemporaryDirectory() as folder:
        counts, raised = _damaged(Path(folder))
    for state in ("right", "wrong, a remark says so", "wrong, nothing says so", "refused"):
        yield f"  {state:<42} {counts[state, True]:9d} accepted, {counts[state, False]} refused by sigmf"
    yield f"  raised by sigmf: {', '.join(f'{name} {n}' for name, n in raised.most_common())}"
    few, many = json.dumps(WHOLE).encode(), _long().encode()
    for name, text in (("3 captures", few), (f"{CAPTURES} captures", many)):
        ours, theirs = take_turns(
            lambda text=text: check_keys(parse_meta(text, "x"), "x"),
            lambda text=text: _library(text),
            clock=process_time,
        )
        yield line(f"{name}, ours", ours * 1e3, "ms")
        yield line(f"{name}, sigmf", theirs * 1e3, "ms")


def _damaged(folder: Path) -> tuple[Counter[tuple[str, bool]], Counter[str]]:
    path = folder / "a.sigmf-meta"
    (folder / "a.dat").write_bytes(STORED)
    right, remarks = _read(path, json.dumps(WHOLE))
    assert right
    counts: Counter[tuple[str, bool]] = Counter()
    raised: Counter[str] = Counter()
    for number in range(INPUTS):
        text = json.dumps(_mutated(Random(number)))
        found, said = _read(path, text)
        wrong = "wrong, a remark says so" if said != remarks else "wrong, nothing says so"
        fault = _library(text.encode())
        counts["refused" if found is None else "right" if found == right else wrong, not fault] += 1
        raised.update([fault] if fault else [])
    return counts, raised


def _read(path: Path, text: str) -> tuple[list[Any] | None, list[Any]]:
    """What decides which samples are read, recording by recording, and the remarks; None if they are refused."""
    path.write_text(text, encoding="utf-8")
    try:
        opened = open_sigmf(path)
    except InputError:
        return None, []
    keys = [(s.rate_hz, s.centre_hz, s.if_hz, s.start_gpst, s.antenna, s.gaps) for s in opened]
    return [(*key, s.read(0, s.n_samples).tobytes()) for key, s in zip(keys, opened, strict=True)], [
        s.remarks for s in opened
    ]


def _library(text: bytes) -> str:
    """The kind of error that the library raises; empty if it accepts the metadata."""
    try:
        SigMFFile(metadata=text).validate()
    except Exception as error:
        return f"{type(error).__name__} (its own)" if isinstance(error, SigMFError) else type(error).__name__
    return ""


def _long() -> str:
    captures = [{"core:sample_start": k, "core:frequency": 1.5e9} for k in range(CAPTURES)]
    return json.dumps(WHOLE | {"captures": captures})


def _mutated(rng: Random) -> Any:
    tree = copy.deepcopy(WHOLE)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        parent, key = rng.choice(list(_places(tree)))
        match rng.randrange(5):
            case 0:
                del parent[key]
            case 1 if isinstance(parent, dict):
                at = rng.randrange(len(key))
                parent[key[:at] + rng.choice("abcdefgh:_") + key[at + 1 :]] = parent.pop(key)
            case _:
                parent[key] = copy.deepcopy(rng.choice(VALUES))
    return tree


def _places(tree: Any) -> Iterator[tuple[Any, Any]]:
    """Every place in the tree: what holds it, and its key or index."""
    for key, value in list(tree.items() if isinstance(tree, dict) else enumerate(tree)):
        yield tree, key
        if isinstance(value, dict | list):
            yield from _places(value)


if __name__ == "__main__":
    for text in report():
        print(text)
