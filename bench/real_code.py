"""How large the errors of real code are: what multipath keeps for a window, and how fast the rest changes.

Files of real receivers, from the folder that SKYPROOF_DATA names. Of each track two figures: code less the phase of two
bands, free of geometry and ionosphere but for a constant (the part that changes), and the difference between two
receivers less that of the antennas' places (all of it, but for what all satellites share).
"""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyproof.formats.rinex_nav import get_glonass_channels, read_nav
from skyproof.formats.rinex_obs_read import read_obs
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.gnss.sky import compute_azimuth_elevation
from skyproof.navigation.least_squares import compute_line_of_sight
from skyproof.navigation.ranges import correct_ranges
from skyproof.records import CellStatus, NavigationData, Observations, SignalId

Reals = NDArray[np.float64]

ELEVATIONS_DEG = ((5.0, 15.0), (15.0, 30.0), (30.0, 90.0))
TOGETHER_S = 0.02
SIGNALS = {
    "GPS L1 C/A": ("G", "L1", ("CA",)),
    "GPS L2": ("G", "L2", ("W", "L", "X")),
    "GPS L5": ("G", "L5", ("Q", "X")),
    "Galileo E1": ("E", "E1", ("C", "X")),
    "Galileo E5a": ("E", "E5a", ("Q", "X")),
    "BeiDou B1I": ("C", "B1", ("2I",)),
    "GLONASS G1": ("R", "G1", ("CA",)),
}


@dataclass(frozen=True)
class Pair:
    """Two files and their navigation file; where the antennas are (None: where the files put them), and rows that
    count: those of a receiver at rest, or all with a position at each epoch."""

    name: str
    files: tuple[str, str]
    nav: str
    places: tuple[Any, Any] | None = None
    known: bool = False
    rows: tuple[slice, ...] = (slice(None),)
    moving: bool = False
    window_s: float = 10.0


def geodetic(lat_deg: float, lon_deg: float, height_m: float) -> Reals:
    return np.asarray(ecef_from_geodetic(np.radians(lat_deg), np.radians(lon_deg), height_m), float)


MOSAIC_5KM = ("rinex-mosaic-5km/3034265G.21O", "rinex-mosaic-5km/SEPT265G.21O")
NAV_5KM = "rinex-mosaic-5km/SEPT2650.21P"
PAIRS = (
    Pair(
        "1 m, at rest",
        ("rinex-mosaic-1m/base.obs", "rinex-mosaic-1m/rover.obs"),
        "rinex-mosaic-1m/base.nav",
        (geodetic(35.134707705, 136.977577939, 104.853), geodetic(35.13469901, 136.97757549, 104.8626)),
        known=True,
    ),
    Pair("5 km, rover at rest", MOSAIC_5KM, NAV_5KM, rows=(slice(0, 40), slice(315, 360))),
    Pair("5 km, rover moves", MOSAIC_5KM, NAV_5KM, rows=(slice(40, 315),), moving=True),
    Pair(
        "3 km, at rest, 30 s",
        ("rinex-gsi-3km/07590920.05o", "rinex-gsi-3km/30400920.05o"),
        "rinex-gsi-3km/07590920.05n",
        window_s=150.0,
    ),
)


def report() -> Iterator[str]:
    """Rows of the tables; one that says what is missing without the data."""
    folder = Path(os.environ.get("SKYPROOF_DATA", "")) / "real"
    if not os.environ.get("SKYPROOF_DATA") or not folder.is_dir():
        yield "SKYPROOF_DATA names no folder with real files: errors of real code are not measured"
        return
    yield "code less phases: sigma of one track, AR(1) coefficient from epoch to epoch, correlation time"
    for path, nav in dict.fromkeys((path, pair.nav) for pair in PAIRS for path in pair.files):
        yield from _changing(folder, path, nav)
    yield "differences between two receivers: sigma of one track's mean over a window (and over a file)"
    for pair in PAIRS:
        yield from _constant(folder, pair)


def _read(folder: Path, path: str, navigation: NavigationData) -> tuple[Observations, Reals]:
    found = read_obs(folder / path, glonass_channels=get_glonass_channels(navigation))
    return found.observations, np.asarray(found.position_ecef_m)


# ---------------------------------------------------------------------- what changes


def _changing(folder: Path, path: str, nav: str) -> Iterator[str]:
    navigation = read_nav(folder / nav)
    o, place = _read(folder, path, navigation)
    elevation_deg = _elevation_deg(o, navigation, place)
    step_s = float(np.median(np.diff(o.elapsed_s)))
    yield f"  {path}, {step_s:g} s from epoch to epoch"
    for name, (system, band, codes) in SIGNALS.items():
        arcs = [
            (item, el)
            for k, s in enumerate(o.signals)
            if s.sat[0] == system and s.band == band and s.code in codes
            for item, el in _code_less_phases(o, k, elevation_deg)
        ]
        for low, high in ELEVATIONS_DEG:
            matching = [item for item, el in arcs if low <= el < high]
            if matching:
                sigma_m, phi, time_s = _law(matching, step_s)
                yield (
                    f"    {name:12s} {low:2.0f} to {high:2.0f} deg  {len(matching):3d} arcs  {sigma_m:5.2f} m  "
                    f"{phi:5.2f}  {time_s:5.0f} s"
                )


def _code_less_phases(o: Observations, k: int, elevation_deg: Reals) -> Iterator[tuple[Reals, float]]:
    """Arcs of code of one signal less its own and another band's phase, less their mean, and their elevations."""
    rest = [j for j, s in enumerate(o.signals) if s.sat == o.signals[k].sat and s.band != o.signals[k].band]
    rest = [j for j in rest if np.isfinite(o.carrier_cyc[:, j]).any() and np.isfinite(o.carrier_hz[j])]
    if not rest:
        return
    j = max(rest, key=lambda j: abs(o.carrier_hz[j] - o.carrier_hz[k]))
    phase_m = o.carrier_cyc[:, [k, j]] * SPEED_OF_LIGHT_M_S / o.carrier_hz[[k, j]]
    ratio = (o.carrier_hz[k] / o.carrier_hz[j]) ** 2
    values_m = o.pseudorange_m[:, k] - phase_m[:, 0] - 2.0 / (ratio - 1.0) * (phase_m[:, 0] - phase_m[:, 1])
    present = np.isfinite(values_m)
    slips = (o.status[:, [k, j]] == CellStatus.SLIP).any(axis=1)
    edges = np.flatnonzero(np.diff(present.astype(int), prepend=0) | (slips & present))
    for first, end in zip(edges, np.append(edges[1:], present.size)):  # noqa: B905
        if present[first] and end - first >= 20:
            arc = values_m[first:end]
            yield arc - arc.mean(), float(np.nanmean(elevation_deg[first:end, k]))


def _law(arcs: list[Reals], step_s: float) -> tuple[float, float, float]:
    """Sigma, the coefficient from one epoch to the next, and the time in which what is not white falls to 1/e."""
    n = sum(len(a) for a in arcs)
    variance = sum(float(a @ a) for a in arcs) / (n - len(arcs))
    one, two = (
        sum(float(a[lag:] @ a[:-lag]) for a in arcs) / sum(len(a) - lag for a in arcs) / variance for lag in (1, 2)
    )
    pace = two / one if one > 0.1 else np.nan
    return float(np.sqrt(variance)), one, -step_s / float(np.log(pace)) if 0.0 < pace < 1.0 else np.nan


def _elevation_deg(o: Observations, navigation: NavigationData, place: Reals) -> Reals:
    satellites, _ = _satellites(o, navigation)
    with np.errstate(invalid="ignore"):
        return np.degrees(compute_azimuth_elevation(place, satellites)[1])


def _satellites(o: Observations, navigation: NavigationData) -> tuple[Reals, Reals]:
    """Positions at transmission (n_epochs, n_channels, 3) and the clocks' ranges, whatever the signal's group delay."""
    reference = {"G": ("L1", "CA"), "J": ("L1", "CA"), "E": ("E1", "C"), "C": ("B3", "6I"), "R": ("G1", "CA")}
    signals = tuple(SignalId(s.sat, *reference.get(s.sat[0], ("L1", "CA"))) for s in o.signals)
    ranges = correct_ranges(signals, o.gpst, o.pseudorange_m, navigation)
    return ranges.satellite_ecef_m, ranges.range_m


# ---------------------------------------------------------------------- what stays


def _constant(folder: Path, pair: Pair) -> Iterator[str]:
    navigation = read_nav(folder / pair.nav)
    observed = [_read(folder, path, navigation) for path in pair.files]
    places = pair.places or tuple(place for _, place in observed)
    rows = _common_rows(*(o for o, _ in observed))
    remaining, unit, elevation_deg = zip(
        *(_less_geometry(o, navigation, place) for (o, _), place in zip(observed, places, strict=True)), strict=True
    )
    yield f"  {pair.name}: windows of {pair.window_s:g} s"
    a, b = (o for o, _ in observed)
    step = max(round(pair.window_s / float(np.median(np.diff(a.elapsed_s)))), 1)
    for name, (system, band, codes) in SIGNALS.items():
        columns = _same_signals(a, b, system, band, codes)
        if len(columns) < 5:
            continue
        ka, kb = (np.array(k) for k in zip(*columns, strict=True))
        difference_m = remaining[1][rows[1]][:, kb] - remaining[0][rows[0]][:, ka]
        units, elevations = unit[0][rows[0]][:, ka], elevation_deg[0][rows[0]][:, ka]
        difference_m = np.where(elevations >= ELEVATIONS_DEG[0][0], difference_m, np.nan)
        parts = [(difference_m[part], units[part], elevations[part]) for part in pair.rows]
        short = [r for p in parts for r in _errors(*p, step=step, pair=pair)]
        whole = [r for p in parts for r in _errors(*p, step=len(p[0]), pair=pair)]
        text = [f"{_rms(short, *ends)}" for ends in (*ELEVATIONS_DEG, (5.0, 90.0))]
        largest = max(abs(e) for e, _, _ in short)
        lasting = _rms(whole, 5.0, 90.0)
        yield (
            f"    {name:12s} {len(columns):2d} satellites  5-15, 15-30, 30-90, all: {', '.join(text)} m; "
            f"largest {largest / np.sqrt(2.0):.1f} m; mean of the file {lasting} m"
        )


def _common_rows(a: Observations, b: Observations) -> tuple[Any, Any]:
    near = np.clip(np.searchsorted(b.gpst, a.gpst - np.timedelta64(20, "ms")), 0, b.gpst.size - 1)
    apart_s = np.abs((b.gpst[near] - a.gpst) / np.timedelta64(1, "s"))
    rows = np.flatnonzero(apart_s < TOGETHER_S)
    return rows, near[rows]


def _less_geometry(o: Observations, navigation: NavigationData, place: Reals) -> tuple[Reals, Reals, Reals]:
    """Pseudorange less geometric range and satellite clock, line of sight and elevation of all cells."""
    satellites, range_m = _satellites(o, navigation)
    turned, unit, distance_m = compute_line_of_sight(satellites, place)
    with np.errstate(invalid="ignore"):
        return range_m - distance_m, unit, np.degrees(compute_azimuth_elevation(place, turned)[1])


def _same_signals(a: Observations, b: Observations, system: str, band: str, codes: tuple[str, ...]) -> list[Any]:
    """Columns of both, of one satellite and band each; codes of one band may differ, as receivers name them."""
    found = []
    for k, s in enumerate(a.signals):
        if s.sat[0] == system and s.band == band and s.code in codes:
            theirs = [j for j, t in enumerate(b.signals) if t.sat == s.sat and t.band == band and t.code in codes]
            same = [j for j in theirs if b.signals[j].code == s.code] or theirs
            if same and not any(a.signals[i].sat == s.sat for i, _ in found):
                found.append((k, same[0]))
    return found


def _errors(
    difference_m: Reals, units: Reals, elevations: Reals, *, step: int, pair: Pair
) -> list[tuple[float, float, float]]:
    """Mean errors of differences over `step` epochs about what clock and, where it is not known, the baseline explain;
    each with its elevation and the share of its variance that is left by that."""
    n = len(difference_m)
    found = []
    baseline = np.zeros(3) if pair.known or pair.moving else _baseline(difference_m, units)
    for first in range(0, n - step // 2, step):
        part = slice(first, min(first + step, n))
        steady = difference_m[part] + units[part] @ baseline
        present = np.isfinite(steady).mean(axis=0) > 0.8
        if present.sum() < 5:
            continue
        design = np.ones((int(present.sum()), 1))
        if pair.moving:  # each epoch has a position of its own
            design = np.hstack((design, units[part][len(steady) // 2][present]))
            remaining = np.array(
                [_left_over(row[present], u[present]) for row, u in zip(steady, units[part], strict=True)]
            )
        else:
            remaining = steady[:, present] - np.nanmean(steady[:, present], axis=1)[:, None]
        values = np.nanmean(remaining, axis=0)
        hat = design @ np.linalg.pinv(np.nan_to_num(design))
        share = np.clip(1.0 - np.diag(hat), 1e-3, 1.0)
        el = np.nanmean(elevations[part][:, present], axis=0)
        found += [(float(v), float(e), float(s)) for v, e, s in zip(values, el, share, strict=True) if np.isfinite(v)]
    return found


def _left_over(row: Reals, unit: Reals) -> Reals:
    present = np.isfinite(row)
    design = np.hstack((np.ones((int(present.sum()), 1)), unit[present]))
    out = np.full(row.shape, np.nan)
    out[present] = row[present] - design @ np.linalg.lstsq(design, row[present], rcond=None)[0]
    return out


def _baseline(difference_m: Reals, units: Reals) -> Reals:
    """(3,) what the second place is off, by all epochs."""
    y, x = [], []
    for row, unit in zip(difference_m, units, strict=True):
        present = np.isfinite(row)
        if present.sum() >= 4:
            y.append(row[present] - row[present].mean())
            x.append(-(unit[present] - unit[present].mean(axis=0)))
    return np.asarray(np.linalg.lstsq(np.vstack(x), np.concatenate(y), rcond=None)[0])


def _rms(found: list[tuple[float, float, float]], low: float, high: float) -> str:
    """Of one track: a difference has the errors of two."""
    matching = [(e, s) for e, el, s in found if low <= el < high]
    if not matching:
        return "   -"
    return f"{np.sqrt(sum(e * e for e, _ in matching) / sum(s for _, s in matching) / 2.0):4.2f}"
