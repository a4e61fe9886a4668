"""Positions from real RINEX files by code and broadcast orbits, beside those of RTKLIB's single-point mode.

Truths are those of the data's own README: surveyed for 3034, fixed carrier-phase for mosaic-1m (good to millimetres
between the two, of unstated origin in absolute), approximate (a few metres) for the stations of gsi-3km. The moving
rover of mosaic-5km has none: it stands beside itself corrected with the reference station's errors.
"""

import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time

import numpy as np

from skyproof.arrays import Reals
from skyproof.formats.rinex_nav import read_nav
from skyproof.formats.rinex_obs_read import read_obs
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.navigation.fix import fix
from skyproof.navigation.least_squares import compute_line_of_sight
from skyproof.navigation.ranges import correct_ranges
from skyproof.records import NavigationData, Observations, SignalId
from skyproof.studies.code_signals import select_code_signals
from skyproof.studies.position_filter import FilterSettings, step

MASK_DEG = 10.0


@dataclass(frozen=True)
class Station:
    """Files of one station below the data folder, and where it stands."""

    name: str
    observations: str
    navigation: str
    truth_ecef_m: tuple[float, float, float]
    systems: tuple[str, ...]


GSI, M1, M5 = "real/rinex-gsi-3km", "real/rinex-mosaic-1m", "real/rinex-mosaic-5km"
ROVER, REFERENCE, ORBITS = f"{M5}/SEPT265G.21O", f"{M5}/3034265G.21O", f"{M5}/SEPT2650.21P"
STATIONS = (
    Station(
        "mosaic-1m base", f"{M1}/base.obs", f"{M1}/base.nav", (-3817681.121, 3562839.431, 3650159.159), ("G", "GERC")
    ),
    Station(
        "mosaic-1m rover", f"{M1}/rover.obs", f"{M1}/base.nav", (-3817681.381, 3562839.979, 3650158.376), ("G", "GERC")
    ),
    Station("mosaic-5km 3034", REFERENCE, ORBITS, (-3959400.631, 3385704.533, 3667523.111), ("G", "GE")),
    Station(
        "gsi-3km 0759", f"{GSI}/07590920.05o", f"{GSI}/07590920.05n", (-3976219.508, 3382372.567, 3652512.985), ("G",)
    ),
    Station(
        "gsi-3km 3040", f"{GSI}/30400920.05o", f"{GSI}/30400920.05n", (-3978241.958, 3382840.234, 3649900.853), ("G",)
    ),
)
_RTKLIB_SYSTEM = {"G": 1, "R": 4, "E": 8, "C": 32}


def report() -> Iterator[str]:
    """Rows of the table."""
    folder = Path(os.environ.get("SKYPROOF_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
    yield f"position, metres: median and 95 % horizontal, median and 95 % vertical; mask {MASK_DEG:g} degrees"
    if not (folder / M1).is_dir():
        yield f"  skipped: no recordings at {folder}; set SKYPROOF_DATA"
        return
    if shutil.which("rnx2rtkp") is None:
        yield "  RTKLIB's rnx2rtkp is not installed: no rows of it"
    for station in STATIONS:
        seen, navigation = read_obs(folder / station.observations).observations, read_nav(folder / station.navigation)
        for systems in station.systems:
            yield from _rows(station, systems, seen, navigation, folder)
    yield from _moving(folder)


def _rows(
    station: Station, systems: str, seen: Observations, navigation: NavigationData, folder: Path
) -> Iterator[str]:
    signals = chosen(seen, systems)
    n, what = max(seen.gpst.size, 1), f"{station.name} {systems}"
    begin = process_time()
    found = fix(seen, navigation, signals=signals, elevation_mask_deg=MASK_DEG)
    yield _line(what, "fix", found.position_ecef_m[found.status == 0], station, (process_time() - begin) / n)
    begin = process_time()
    settings = FilterSettings(mode="static", elevation_mask_deg=MASK_DEG)
    filtered, _ = step(None, seen, navigation, settings=settings, signals=signals)
    kept = filtered.fix.status == 0
    yield _line(what, "static filter", filtered.fix.position_ecef_m[kept], station, (process_time() - begin) / n)
    if shutil.which("rnx2rtkp") is not None:
        yield _line(what, "RTKLIB single", rtklib(folder, station, systems), station)


def chosen(seen: Observations, systems: str) -> tuple[SignalId, ...]:
    """One code signal of each satellite of the systems named by their letters."""
    return tuple(signal for signal in select_code_signals(seen) if signal.sat[0] in systems)


def rtklib(folder: Path, station: Station, systems: str) -> Reals:
    """Positions of RTKLIB's single mode, (n, 3)."""
    settings = {
        "pos1-posmode": "single",
        "pos1-frequency": "l1",
        "pos1-elmask": f"{MASK_DEG:g}",
        "pos1-ionoopt": "brdc",
        "pos1-tropopt": "saas",
        "pos1-sateph": "brdc",
        "out-solformat": "xyz",
        "out-timesys": "gpst",
        "pos1-navsys": str(sum(_RTKLIB_SYSTEM[letter] for letter in systems)),
    }
    with tempfile.TemporaryDirectory() as scratch:
        conf, out = Path(scratch) / "single.conf", Path(scratch) / "out.pos"
        conf.write_text("".join(f"{key} ={value}\n" for key, value in settings.items()), encoding="ascii")
        files = [str(folder / station.observations), str(folder / station.navigation)]
        subprocess.run(["rnx2rtkp", "-k", str(conf), "-o", str(out), *files], check=True, capture_output=True)
        lines = out.read_text(encoding="ascii").splitlines()
    return np.array([[float(x) for x in text.split()[2:5]] for text in lines if not text.startswith("%")])


def quantiles(error_enu_m: Reals) -> tuple[float, float, float, float]:
    """Median and 95 % of the horizontal error, then of the vertical one."""
    horizontal, vertical = np.hypot(error_enu_m[:, 0], error_enu_m[:, 1]), np.abs(error_enu_m[:, 2])
    h, v = np.quantile(horizontal, [0.5, 0.95]), np.quantile(vertical, [0.5, 0.95])
    return float(h[0]), float(h[1]), float(v[0]), float(v[1])


def enu(difference_m: Reals, at_ecef_m: Reals) -> Reals:
    """East, north, up of differences (n, 3)."""
    lat_rad, lon_rad, _ = geodetic_from_ecef(at_ecef_m)
    return np.asarray(difference_m @ rot_enu_ecef(lat_rad, lon_rad).T)


def _line(what: str, how: str, position_m: Reals, station: Station, seconds: float | None = None) -> str:
    truth = np.array(station.truth_ecef_m)
    h50, h95, v50, v95 = quantiles(enu(position_m - truth, truth))
    cost = "" if seconds is None else f"   {seconds * 1e3:.2f} ms of CPU an epoch"
    return f"  {what:<22} {how:<14} {h50:5.2f} {h95:5.2f}  {v50:5.2f} {v95:5.2f}   {len(position_m):4d} epochs{cost}"


def _moving(folder: Path) -> Iterator[str]:
    alone, corrected = moving_rover(folder)
    h50, h95, v50, v95 = quantiles(enu(alone - corrected, corrected[0]))
    yield f"  {'mosaic-5km rover GE':<22} {'against itself':<14} {h50:5.2f} {h95:5.2f}  {v50:5.2f} {v95:5.2f}   " + (
        f"{len(alone):4d} epochs: kinematic filter, less the reference's error, beside code-differential fixes"
    )


def moving_rover(folder: Path) -> tuple[Reals, Reals]:
    """The moving rover's kinematic filter minus the reference's error at the same time, and code-differential fixes.

    The differential fix takes from every pseudorange what the reference's, at its known place, has too much. Atmosphere
    and orbits are the same over 5 km, so the two differ by noise, multipath and the filter's own lag.
    """
    navigation = read_nav(folder / ORBITS)
    rover, fixed = (read_obs(folder / path).observations for path in (ROVER, REFERENCE))
    common = tuple(s for s in chosen(rover, "GE") if s.sat in {t.sat for t in chosen(fixed, "GE")})
    there = tuple(t for s in common for t in chosen(fixed, "GE") if t.sat == s.sat)
    _, mine, theirs = np.intersect1d(rover.gpst, fixed.gpst, return_indices=True)
    truth = np.array(STATIONS[2].truth_ecef_m)
    settings = FilterSettings(mode="kinematic", elevation_mask_deg=MASK_DEG)
    moving, _ = step(None, rover, navigation, settings=settings, signals=common)
    still, _ = step(None, fixed, navigation, settings=replace(settings, mode="static"), signals=there)
    alone = moving.fix.position_ecef_m[mine] - (still.fix.position_ecef_m[theirs] - truth)

    at_truth = fix(fixed, navigation, signals=there, elevation_mask_deg=MASK_DEG)
    moved_m = at_truth.position_ecef_m - truth
    # Residual at the truth is the residual of the fix plus what moving the place to the truth adds, along the lines
    # of sight; both positions see the satellites at the same angles to 1e-7.
    excess_m = at_truth.residual_m + _along(fixed, there, navigation, truth, moved_m)
    columns = [rover.signals.index(signal) for signal in common]
    code = np.full_like(rover.pseudorange_m, np.nan)
    code[np.ix_(mine, columns)] = rover.pseudorange_m[np.ix_(mine, columns)] - excess_m[theirs]
    corrected = fix(replace(rover, pseudorange_m=code), navigation, signals=common, elevation_mask_deg=MASK_DEG)
    good = np.isfinite(alone[:, 0]) & (corrected.status[mine] == 0)
    return alone[good], corrected.position_ecef_m[mine][good]


def _along(
    seen: Observations, signals: tuple[SignalId, ...], navigation: NavigationData, place: Reals, moved_m: Reals
) -> Reals:
    """What a move of the place by `moved_m` (n, 3) takes off each range, (n, k)."""
    columns = [seen.signals.index(signal) for signal in signals]
    ranges = correct_ranges(signals, seen.gpst, seen.pseudorange_m[:, columns], navigation)
    _, unit, _ = compute_line_of_sight(ranges.satellite_ecef_m, np.broadcast_to(place, (seen.gpst.size, 3)))
    return -np.einsum("nki,ni->nk", unit, moved_m)
