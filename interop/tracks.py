"""What a receiver measured, as its RINEX file states it: the common ground on which receivers are compared."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from skyproof.arrays import Reals
from skyproof.gnss.time import parse_iso, week_and_tow

__all__ = ["FIELDS", "Tracks", "beside_each_other", "parse_tracks", "read_tracks"]

FIELDS = {"C1C": "pseudorange_m", "L1C": "carrier_cyc", "D1C": "doppler_hz", "S1C": "cn0_dbhz"}
_WEEK_S = 604800.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Tracks:
    """Epochs x signals of one receiver, NaN where nothing was measured.

    signals : satellite and copy, "G05a".
    label_s : (n_epochs,) what the receiver's clock shows, in seconds of the GPS week of the first epoch. It places the
        measurements beside each other (to 0.1 ns); none is made of it.
    """

    name: str
    signals: tuple[str, ...]
    label_s: Reals
    pseudorange_m: Reals
    carrier_cyc: Reals
    doppler_hz: Reals
    cn0_dbhz: Reals

    def at(self, label_s: Reals) -> "Tracks":
        """The same signals at other times (n,): NaN where the neighbouring epochs are not both there.

        The carrier between its epochs by a cubic spline, the code along the carrier: its noise alone is interpolated.
        """
        wavelength_m = 299_792_458.0 / 1575.42e6
        carrier_cyc = _between(self.label_s, self.carrier_cyc, label_s, smooth=True)
        code_minus_carrier_m = self.pseudorange_m - wavelength_m * self.carrier_cyc
        return Tracks(
            name=self.name,
            signals=self.signals,
            label_s=label_s,
            pseudorange_m=_between(self.label_s, code_minus_carrier_m, label_s) + wavelength_m * carrier_cyc,
            carrier_cyc=carrier_cyc,
            doppler_hz=_between(self.label_s, self.doppler_hz, label_s),
            cn0_dbhz=_between(self.label_s, self.cn0_dbhz, label_s),
        )


def _between(known_s: Reals, values: Reals, wanted_s: Reals, *, smooth: bool = False) -> Reals:
    step_s = float(np.median(np.diff(known_s)))
    out = np.full((wanted_s.size, values.shape[1]), np.nan)
    for column in range(values.shape[1]):
        there = np.flatnonzero(np.isfinite(values[:, column]))
        if there.size < 4:
            continue
        x_s, y = known_s[there], values[there, column]
        after = np.clip(np.searchsorted(x_s, wanted_s), 1, there.size - 1)
        inside = (x_s[after] - x_s[after - 1] < 1.5 * step_s) & (wanted_s >= x_s[0]) & (wanted_s <= x_s[-1])
        found = CubicSpline(x_s, y)(wanted_s) if smooth else np.interp(wanted_s, x_s, y)
        out[inside, column] = found[inside]
    return out


def read_tracks(paths: Sequence[Path], name: str) -> Tracks:
    """RINEX 3 files of one receiver; those of the first are copies a, of the second b, and so on."""
    parts = [
        parse_tracks(path.read_text(encoding="ascii", errors="replace").splitlines(), name, copy)
        for path, copy in zip(paths, "abcdefgh", strict=False)
    ]
    return beside_each_other(parts)


def parse_tracks(lines: Iterable[str], name: str, copy: str) -> Tracks:
    """GPS L1 C/A of a RINEX 3 observation file (RINEX 3.05, tables A2 and A3), with as little code as will do it."""
    columns: list[str] = []
    labels: list[float] = []
    weeks: list[int] = []
    cells: dict[tuple[int, str], list[float]] = {}
    in_body = False
    for line in lines:
        if not in_body:
            if line[60:].startswith("SYS / # / OBS TYPES") and line.startswith("G"):
                columns = line[6:60].split()
            in_body = line[60:].startswith("END OF HEADER")
        elif line.startswith(">"):
            week, tow_s = week_and_tow(parse_iso("{}-{}-{}T{}:{}".format(*line[2:18].split()) + ":00"))
            weeks.append(week)
            labels.append((week - weeks[0]) * _WEEK_S + tow_s + float(line[18:29]))
        elif re.match(r"G[ \d]\d", line):
            fields = (line[3 + 16 * k : 17 + 16 * k].strip() for k in range(len(columns)))
            cells[len(labels) - 1, line[:3].replace(" ", "0")] = [float(text) if text else np.nan for text in fields]
    sats = sorted({sat for _, sat in cells})
    tables = {field: np.full((len(labels), len(sats)), np.nan) for field in FIELDS.values()}
    for (row, sat), values in cells.items():
        for column, value in zip(columns, values, strict=True):
            if column in FIELDS:
                tables[FIELDS[column]][row, sats.index(sat)] = value
    return Tracks(name=name, signals=tuple(sat + copy for sat in sats), label_s=np.array(labels), **tables)


def beside_each_other(parts: Sequence[Tracks]) -> Tracks:
    """Signals of several files of one receiver on its common epochs."""
    label_s = np.unique(np.concatenate([part.label_s for part in parts]))
    tables = {}
    for field in FIELDS.values():
        table = np.full((label_s.size, sum(len(part.signals) for part in parts)), np.nan)
        column = 0
        for part in parts:
            width = len(part.signals)
            table[np.searchsorted(label_s, part.label_s), column : column + width] = getattr(part, field)
            column += width
        tables[field] = table
    signals = tuple(signal for part in parts for signal in part.signals)
    return Tracks(name=parts[0].name, signals=signals, label_s=label_s, **tables)
