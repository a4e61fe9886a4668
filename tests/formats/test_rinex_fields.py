"""The kernel that lays out RINEX records against plain Python."""

import numpy as np
import pytest

from skyproof.formats import rinex_fields

NAMES, SAT_OF, SLOT, SLOTS = (
    ("E05", "G07", "G31"),
    np.array([0, 0, 1, 2, 2]),
    np.array([0, 2, 0, 0, 1]),
    np.array([3, 2, 2]),
)
HEADS = tuple(f"> 2024 06 24 08 20{second:3d}.0000000  0" for second in range(40))
KERNELS = pytest.mark.parametrize(
    "kernel", [rinex_fields.lay_out, rinex_fields.lay_out.py_func], ids=["compiled", "python"]
)


def lay_out_in_python(values, there, indicator):
    lines = []
    for n, head in enumerate(HEADS[: len(values)]):
        rows = {}
        for c in np.flatnonzero(there[n]):
            strength = str(int(min(max(values[n, c, 3] // 6.0, 1.0), 9.0))) if np.isfinite(values[n, c, 3]) else " "
            marks = (f" {strength}", f"{indicator[n, c] or ' '}{strength}", "  ", "  ")
            cells = zip(values[n, c], marks, strict=True)
            fields = "".join(f"{v:14.3f}{mark}" if np.isfinite(v) else " " * 16 for v, mark in cells)
            rows.setdefault(SAT_OF[c], {})[SLOT[c]] = fields
        if rows:
            lines.append(f"{head}{len(rows):3d}")
        for sat, own in rows.items():
            lines.append((NAMES[sat] + "".join(own.get(k, " " * 64) for k in range(SLOTS[sat]))).rstrip())
    return "".join(line + "\n" for line in lines)


def lay_out(kernel, values, there, indicator):
    heads = np.array([list(head.encode()) for head in HEADS[: len(values)]], np.uint8)
    names = np.array([list(name.encode()) for name in NAMES], np.uint8)
    out = np.empty(len(values) * rinex_fields.bound_bytes(heads.shape[1], SLOTS), np.uint8)
    count = kernel(values, there, indicator, heads, SAT_OF, names, SLOT, SLOTS, out)
    return out[:count].tobytes().decode("ascii")


@KERNELS
def test_records_are_those_that_python_formats(kernel):
    rng = np.random.default_rng(3)
    values = rng.uniform(-1.0, 1.0, (40, 5, 4)) * 10.0 ** rng.integers(-4, 9, (40, 5, 4))
    values[..., 3] = rng.uniform(0.0, 70.0, (40, 5))
    values[rng.random(values.shape) < 0.1] = np.nan
    present = np.isfinite(values[..., :3]).any(axis=-1) & (rng.random((40, 5)) < 0.8)
    present[7] = False
    indicator = rng.integers(0, 4, (40, 5))
    assert lay_out(kernel, values, present, indicator) == lay_out_in_python(values, present, indicator)


@KERNELS
def test_halves_of_the_last_digit_round_as_text_does(kernel):
    halves = (np.arange(-60, 60) + 0.5) / 1000.0
    exact = np.array([0.0625, 0.1875, -0.0625, -0.0, 0.0, 0.0004, -0.0004, 9999999999.9985, -999999999.9985, 2.0625])
    values = np.concatenate((halves, halves + 20000000.0, halves + 123456.0, exact, np.zeros(30)))[:400].reshape(
        -1, 5, 4
    )
    present, indicator = np.ones(values.shape[:2], bool), np.zeros(values.shape[:2], int)
    assert lay_out(kernel, values, present, indicator) == lay_out_in_python(values, present, indicator)
