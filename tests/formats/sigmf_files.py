"""Recordings in SigMF for the tests: numbers of every type, their metadata, and what they mean."""

import json
from pathlib import Path

import numpy as np
from hypothesis import HealthCheck

from skyproof.errors import InputError
from skyproof.formats.sigmf import open_sigmf

NUMBERS = ("f32", "f64", "i32", "i16", "i8", "u32", "u16", "u8")
DATATYPES = [
    f"{kind}{number}{order}"
    for kind in "cr"
    for number in NUMBERS
    for order in (("",) if "8" in number else ("_le", "_be"))
]
RATE_HZ = 4e6
NO_TMP_PER_EXAMPLE = [HealthCheck.function_scoped_fixture]


def find_stored_type(datatype):
    order = ">" if datatype.endswith("_be") else "<"
    return np.dtype(f"{order}{datatype[1]}{int(datatype[2:].split('_')[0]) // 8}")


def draw_numbers(datatype, shape, seed=1):
    """Draw numbers over the whole range of the type, as stored."""
    dtype, rng = find_stored_type(datatype), np.random.default_rng(seed)
    if dtype.kind == "f":
        return rng.normal(size=shape).astype(np.float32).astype(dtype)
    limits = np.iinfo(dtype)
    return rng.integers(limits.min, limits.max, shape, endpoint=True, dtype=dtype.newbyteorder("=")).astype(dtype)


def read_planes(stored):
    """Convert samples (n, numbers) to float32 of shape (2, n), number by number: the slow way."""

    def find_value(number):
        if stored.dtype.kind != "u":
            return float(number)
        return float(2 * int(number) - (2 ** (8 * stored.dtype.itemsize) - 1))

    planes = np.zeros((2, len(stored)), np.float32)
    for row, column in zip(planes, stored.T, strict=False):
        row[:] = [find_value(number) for number in column]
    return planes


def make_meta(datatype="ci8", *, captures=None, annotations=(), **more):
    """Make metadata; keys of the global object by their names, skyproof__if_hz for skyproof:if_hz."""
    keys = {(k.replace("__", ":") if "__" in k else f"core:{k}"): v for k, v in more.items()}
    if datatype[0] == "r":
        keys = {"skyproof:if_hz": 1e6} | keys
    general = {"core:datatype": datatype, "core:sample_rate": RATE_HZ, "core:version": "1.2.0"} | keys
    if captures is None:
        captures = [{"core:sample_start": 0, "core:frequency": 1575.42e6}]
    return {"global": general, "captures": captures, "annotations": list(annotations)}


def write(folder, meta, octets, name="rec"):
    path = Path(folder) / f"{name}.sigmf-meta"
    path.write_text(meta if isinstance(meta, str) else json.dumps(meta), encoding="utf-8")
    path.with_name(
        meta["global"].get("core:dataset", f"{name}.sigmf-data") if isinstance(meta, dict) else f"{name}.sigmf-data"
    ).write_bytes(octets)
    return path


def draw_noise(n_samples, seed=1):
    return np.random.default_rng(seed).normal(0.0, 20.0, (n_samples, 2)).round().clip(-127, 127).astype(np.int8)


def try_read(path):
    """Return the recordings, and the error if they were refused."""
    try:
        return open_sigmf(path), ""
    except InputError as error:
        return (), str(error)


def read_one(path):
    (samples,) = open_sigmf(path)
    return samples
