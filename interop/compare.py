"""Two receivers on the same samples: which signal of the one is which of the other, and how far they are apart.

Each receiver's clock shows what it likes. At one instant the clocks differ by a lag, and all pseudoranges by c times
that lag, so the lag is where the differences of most satellites agree. What is left after the median of the other
satellites of an epoch is taken off is free of both clocks.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from tracks import Tracks

from skyproof.arrays import Reals

__all__ = ["Row", "compare", "header", "text"]

C_M_S = 299_792_458.0
SAME_M = 50.0  # signals of one satellite closer than a sixth of a chip cannot be told apart here
INCREMENT_S = 1.0
SLIP_CYC = 0.25  # half cycles are what a loop slips by


@dataclass(frozen=True)
class Spread:
    """Median, and 1.4826 times the median distance from it: the standard deviation if the noise is Gaussian."""

    bias: float
    sigma: float

    @classmethod
    def of(cls, values: Reals) -> "Spread":
        values = values[np.isfinite(values)]
        if values.size == 0:
            return cls(np.nan, np.nan)
        middle = float(np.median(values))
        return cls(middle, 1.4826 * float(np.median(np.abs(values - middle))))


@dataclass(frozen=True)
class Row:
    """One signal of the other receiver beside the reference's signal that it is; differences are other - reference.

    on : share of its epochs on each signal of the reference, the largest first; the rest is on none of them.
    """

    signal: str
    epochs: int
    on: tuple[tuple[str, float], ...]
    cn0_db: Spread
    doppler_hz: Spread
    pseudorange_m: Spread
    increment_cyc: Spread
    slips: int


def compare(reference: Tracks, other: Tracks) -> list[Row]:
    """A row for each signal of `other`; no row at all if no two satellites agree on a lag."""
    lag_s = _lag_s(reference, other)
    if lag_s is None:
        return []
    known = reference.at(other.label_s - lag_s)
    gap_m = _gaps_m(known, other) - C_M_S * lag_s[:, None, None]
    near = np.abs(gap_m) < SAME_M  # (epoch, other's signal, reference's)
    shares = near.sum(axis=0) / np.maximum(np.isfinite(other.pseudorange_m).sum(axis=0), 1)[:, None]
    best = np.argmax(shares, axis=1)
    pick = np.arange(len(other.signals)), best
    on = near[:, *pick]
    difference = {
        "cn0_db": other.cn0_dbhz - known.cn0_dbhz[:, best],
        "doppler_hz": _without_common(np.where(on, other.doppler_hz - known.doppler_hz[:, best], np.nan)),
        "pseudorange_m": _without_common(np.where(on, gap_m[:, *pick], np.nan)),
        "increment_cyc": _without_common(
            _increments(other.label_s, np.where(on, other.carrier_cyc - known.carrier_cyc[:, best], np.nan))
        ),
    }
    rows = []
    for column, signal in enumerate(other.signals):
        order = np.argsort(-shares[column])
        figures = {name: Spread.of(np.where(on, table, np.nan)[:, column]) for name, table in difference.items()}
        rows.append(
            Row(
                signal=signal[:3],
                epochs=int(np.isfinite(other.pseudorange_m[:, column]).sum()),
                on=tuple((reference.signals[k], float(shares[column, k])) for k in order if shares[column, k] > 0.0),
                slips=int((np.abs(difference["increment_cyc"][:, column]) > SLIP_CYC).sum()),
                **figures,
            )
        )
    return rows


def _gaps_m(known: Tracks, other: Tracks) -> Reals:
    """(epoch, signal of other, signal of known) differences of pseudorange, NaN between different satellites."""
    same = np.array([[a[:3] == b[:3] for b in known.signals] for a in other.signals])
    return np.where(same, other.pseudorange_m[:, :, None] - known.pseudorange_m[:, None, :], np.nan)


def _lag_s(reference: Tracks, other: Tracks) -> Reals | None:
    """What the other's clock shows more than the reference's, at each epoch of the other."""
    lag_s = np.zeros(other.label_s.size)
    for _ in range(4):  # a range changes by less than 1e-5 of the lag, so each round gains five digits
        gap_m = _gaps_m(reference.at(other.label_s - lag_s), other)
        centre_m = _where_most_agree(gap_m)
        if centre_m is None:
            return None
        agreeing = np.where(np.abs(gap_m - centre_m[:, None, None]) < SAME_M, gap_m, np.nan)
        there = np.isfinite(agreeing).any(axis=(1, 2))
        lag_s[there] = np.nanmedian(agreeing[there].reshape(int(there.sum()), -1), axis=1) / C_M_S
        lag_s[~there] = centre_m[~there] / C_M_S
    return lag_s


def _where_most_agree(gap_m: Reals) -> Reals | None:
    """At each epoch the difference that most satellites share; between epochs it may drift, but evenly."""
    centres = np.full(gap_m.shape[0], np.nan)
    for row, gaps in enumerate(gap_m):
        values = gaps[np.isfinite(gaps)]
        counts = np.array([(np.abs(gaps - value) < SAME_M).any(axis=1).sum() for value in values])
        if counts.size and counts.max() >= 2:
            centres[row] = values[np.argmax(counts)]
    there = np.flatnonzero(np.isfinite(centres))
    if there.size < 2:
        return None
    slope = np.median(np.diff(centres[there]) / np.diff(there))
    return np.median(centres[there] - slope * there) + slope * np.arange(centres.size)


def _without_common(table: Reals) -> Reals:
    """Each cell less the median of the other satellites of its epoch: single differences against their middle.

    Of the others: a satellite that is its epoch's median itself would differ by nothing, and that often.
    """
    out = np.full(table.shape, np.nan)
    for column in range(table.shape[1]):
        others = np.delete(table, column, axis=1)
        there = np.isfinite(others).any(axis=1)
        out[there, column] = table[there, column] - np.nanmedian(others[there], axis=1)
    return out


def _increments(label_s: Reals, table: Reals) -> Reals:
    """Change over the next second, on the row where it begins."""
    ends = np.searchsorted(label_s, label_s + INCREMENT_S - 1e-3)
    inside = ends < label_s.size
    ends = np.minimum(ends, label_s.size - 1)
    right = inside & (np.abs(label_s[ends] - label_s - INCREMENT_S) < 0.05)
    return np.where(right[:, None], table[ends] - table, np.nan)


def header(reference: str) -> str:
    """Two lines above the table."""
    owner = f"{reference}'s"
    return (
        f"    {'':35}{'C/N0 dB':13}{'Doppler Hz':17}{'pseudorange m':17}{'carrier in 1 s, mcyc'}\n"
        f"    sat  epochs  {owner:12} share   bias  sigma     bias   sigma     bias   sigma     bias   sigma"
        "   slips   also on"
    )


def text(rows: list[Row]) -> Iterator[str]:
    """The table, a line a signal."""
    for row in rows:
        signal, share = row.on[0] if row.on else ("none", 0.0)
        also = ", ".join(f"{s} {100 * part:.0f} %" for s, part in row.on[1:] if part >= 0.005)
        phase = Spread(row.increment_cyc.bias * 1e3, row.increment_cyc.sigma * 1e3)
        yield (
            f"    {row.signal}  {row.epochs:6d}  {signal:12} {100 * share:3.0f} %"
            f"  {row.cn0_db.bias:5.1f} {row.cn0_db.sigma:5.1f}  {row.doppler_hz.bias:7.3f} {row.doppler_hz.sigma:7.3f}"
            f"  {row.pseudorange_m.bias:7.2f} {row.pseudorange_m.sigma:7.2f}"
            f"  {phase.bias:7.1f} {phase.sigma:7.1f}  {row.slips:6d}   {also}".rstrip()
        )
