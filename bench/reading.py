"""Reading samples: bytes of a file to planes of float32, beside a strided copy by NumPy and the filling of memory."""

import json
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from time import process_time

import numpy as np
from numpy.typing import NDArray
from timing import line, take_turns

from skyproof.formats.raw import SampleLayout, write_sidecar_text
from skyproof.formats.recording import open_recording
from skyproof.formats.sigmf import meta_from_layout
from skyproof.records import Samples

N_SAMPLES = 1 << 22  # of the file; a second at 4 Msps
BLOCK = 1 << 17  # read at once: what a cache holds
PACKINGS = (("int", 8), ("int", 16), ("offset-binary", 8), ("float", 32), ("sign-magnitude", 2), ("sign", 1))


def report() -> Iterator[str]:
    """Rows of the table."""
    yield f"reading complex samples, blocks of {BLOCK}, then the whole {N_SAMPLES} at once, one core"
    with tempfile.TemporaryDirectory() as folder:
        for encoding, bits in PACKINGS:
            layout = SampleLayout.model_validate(
                {"rate_hz": 4e6, "kind": "complex", "encoding": encoding, "bits": bits}
            )
            path = Path(folder) / f"{encoding}{bits}.sigmf-data"
            stored = _stored(layout)
            stored.tofile(path)
            path.with_suffix(".sigmf-meta").write_text(json.dumps(meta_from_layout(layout)), encoding="utf-8")
            path.with_suffix(".toml").write_text(write_sidecar_text(layout), encoding="utf-8")
            yield from _rows(path, f"{encoding}, {bits} bits", stored if bits >= 8 else None)


def _stored(layout: SampleLayout) -> NDArray[np.generic]:
    rng = np.random.default_rng(1)
    if layout.bits < 8:
        return rng.integers(0, 256, N_SAMPLES * 2 * layout.bits // 8, dtype=np.uint8)
    values = rng.normal(0.0, 20.0, 2 * N_SAMPLES).round()
    return (values + 128.0 * (layout.encoding == "offset-binary")).clip(-127, 255).astype(layout.packing.dtype)


def _through(samples: Samples) -> None:
    """Block after block, none of them kept: their memory is used again."""
    for start in range(0, N_SAMPLES, BLOCK):
        samples.read(start, BLOCK)


def _rows(path: Path, name: str, stored: NDArray[np.generic] | None) -> Iterator[str]:
    (raw,) = open_recording(path, path.with_suffix(".toml"))
    (sigmf,) = open_recording(path)
    starts = range(0, N_SAMPLES, BLOCK)
    planes = np.empty((2, BLOCK), np.float32)

    def strided() -> None:
        """What an encoding of whole bytes costs without a kernel; the zero point and memory are left out."""
        assert stored is not None
        for start in starts:
            planes[...] = stored[2 * start : 2 * (start + BLOCK)].reshape(-1, 2).T

    def filled() -> None:
        for _ in starts:
            planes.fill(1.0)

    functions: list[Callable[[], object]] = [
        lambda: _through(raw),
        lambda: _through(sigmf),
        lambda: raw.read(0, N_SAMPLES),
        filled,
        *([strided] if stored is not None else []),
    ]
    blocks, same, whole, fill, *peer = take_turns(*functions, runs=9, clock=process_time)
    per_sample = 1e9 / N_SAMPLES
    beside = f"memory filled {fill.median * per_sample:.2f}"
    if peer:
        beside += f", strided copy {peer[0].median * per_sample:.2f}"
    yield line(f"{name}, raw", blocks * per_sample, "ns a sample", beside)
    yield line(f"{name}, SigMF", same * per_sample, "ns a sample")
    yield line(f"{name}, at once", whole * per_sample, "ns a sample", "fresh memory included")
