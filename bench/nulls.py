"""Antenna arrays under drawn jammers and stronger transmitters: positions without and behind a null.

    python bench/nulls.py --jammed 20 --overpowered 20 --clean 5      counts; --first 20 goes on elsewhere
    python bench/nulls.py --only jammed-3 --bits 2                    one scene

One receiver of two to four antennas a wavelength apart stands under ten satellites; from the middle of 26 s on a chirp
jammer or a transmitter of all satellites comes from a drawn direction. Samples are of 1.6 Msps. Counted
are seconds of attack with a trusted or consistent fix, as recorded and behind the null, and fixes that lie farther from
the truth than their bounds of 95 % horizontally with what may be hidden.
"""

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path
from time import process_time

import numpy as np
import tomli_w

from skyproof.app.protect import protect
from skyproof.formats.rinex_nav import write_nav
from skyproof.gnss.frames import ecef_from_geodetic, geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.records import FixStatus
from skyproof.simulator.attacks import Interference, Spoofer
from skyproof.simulator.files import write
from skyproof.simulator.scenario import FrontEnd, Scenario, ScenePlace, Sky
from skyproof.verdict import radius_95_m

START = np.datetime64("2024-05-14T09:59:58", "ns")
PLACE = {"lat_deg": 57.7012, "lon_deg": 11.9321, "height_m": 52.0}
ELEMENTS_M = ((0.0, 0.0, 0.0), (0.19, 0.0, 0.0), (0.095, 0.165, 0.0), (0.095, 0.055, -0.155))
RATE_HZ, DURATION_S, ONSET_S = 1.6e6, 26.0, 13.0
KINDS = ("jammed", "overpowered", "clean")


def draw_scene(kind: str, number: int, bits: int) -> tuple[Scenario, int, str]:
    """Draw a scene; return it with how many antennas it has, and what was drawn in words."""
    rng = np.random.default_rng((KINDS.index(kind), number))
    antennas, power_db = int(rng.integers(2, 5)), float(rng.uniform(10.0, 40.0))
    azimuth, elevation, away_m = (
        rng.uniform(0.0, 2.0 * np.pi),
        np.radians(rng.uniform(0.0, 30.0)),
        rng.uniform(100, 500),
    )
    transmit = _place(away_m * np.array([np.sin(azimuth), np.cos(azimuth), np.tan(elevation)]))
    attacks, interference, what = (), (), "no source"
    if kind == "jammed":
        sweep_hz, period_s = float(rng.uniform(0.5e6, 1.5e6)), float(10.0 ** rng.uniform(-5.0, -4.0))
        given = {"transmit": transmit, "power_db": power_db, "onset_s": ONSET_S, "sweep_hz": sweep_hz}
        interference = (Interference(kind="chirp", period_s=period_s, **given),)
        what = f"chirp, J/N {power_db:.0f} dB"
    elif kind == "overpowered":
        shows = _place(rng.uniform(-800.0, 800.0, 3) * (1.0, 1.0, 0.0))
        attacks = (Spoofer(shows=shows, transmit=transmit, power_db=power_db, clock_offset_s=3e-6, onset_s=ONSET_S),)
        what = f"transmitter {power_db:+.0f} dB"
    elements = [
        {"name": str(k), "body_m": place, "line_bias_cyc": float(rng.uniform(-0.5, 0.5)) if k else 0.0}
        for k, place in enumerate(ELEMENTS_M[:antennas])
    ]
    heading = float(rng.uniform(0.0, 360.0))
    encoding = {8: "int", 2: "sign-magnitude", 1: "sign"}[bits]
    scenario = Scenario(
        seed=int(rng.integers(1 << 31)),
        start_gpst=START,
        duration_s=DURATION_S,
        receivers=[{"name": "array", **PLACE, "clock_offset_s": 1e-4, "heading_deg": heading, "antennas": elements}],
        attacks=attacks,
        interference=interference,
        front_end=FrontEnd(rate_hz=RATE_HZ, bandwidth_hz=0.8 * RATE_HZ, encoding=encoding, bits=bits, agc=True),
        sky=Sky(zenith_cn0_dbhz=48.0, horizon_cn0_dbhz=40.0),
    )
    what += f" from {np.degrees(azimuth):.0f}, {np.degrees(elevation):.0f} degrees, {antennas} antennas, {bits} bits"
    return scenario, antennas, what


def judge_scene(kind: str, number: int, bits: int) -> tuple[str, np.ndarray]:
    """Judge a scene; return a row of words, and seconds as recorded, behind the null, fixes there, and wrong ones."""
    scenario, antennas, what = draw_scene(kind, number, bits)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        navigation = make_nominal_constellation(START)
        paths = write(scenario, navigation, folder)
        write_nav(folder / "nav.rnx", navigation)
        table = {
            "name": "array",
            "inputs": [str(p) for p in paths],
            "antennas_m": [list(p) for p in ELEMENTS_M[:antennas]],
        }
        (folder / "platform.toml").write_text(tomli_w.dumps({"receivers": [table]}))
        began_s = process_time()
        result = protect(platform=folder / "platform.toml", nav=folder / "nav.rnx")
        took_s = process_time() - began_s
        (r,) = result.outcome.receivers
        positions = r.positions
        assert positions is not None
        behind, elapsed_s = positions.behind_null, positions.log.elapsed_s
        late, here = elapsed_s > ONSET_S, np.zeros(elapsed_s.size, np.bool_) if behind is None else behind.epochs
        fixed, wrong, worst_m = np.zeros_like(here), 0, 0.0
        truth = ecef_from_geodetic(np.radians(PLACE["lat_deg"]), np.radians(PLACE["lon_deg"]), PLACE["height_m"])
        rot = rot_enu_ecef(np.radians(PLACE["lat_deg"]), np.radians(PLACE["lon_deg"]))
        for kind_ in ("trusted", "consistent"):
            fix = positions.whole(kind_)
            good = np.zeros_like(here) if fix is None else fix.status == FixStatus.OK
            fixed |= good
            for row in np.flatnonzero(good & here):
                east_m, north_m, _ = rot @ (fix.position_ecef_m[row] - truth)
                spread = np.sqrt(np.diag(rot @ fix.covariance_m2[row, :3, :3] @ rot.T))
                off_m = float(np.hypot(east_m, north_m))
                worst_m = max(worst_m, off_m)
                hidden_m = float(np.nan_to_num(fix.hidden_m[row]))
                wrong += off_m > radius_95_m(float(spread[0]), float(spread[1])) + hidden_m
        counts = 0.2 * np.array([np.sum(fixed & late & ~here), np.sum(here & late)])
        cost = "" if behind is None or behind.cost_db is None else f", C/N0 {-behind.cost_db:+.1f} dB"
        row = (
            f"{kind}-{number}: {result.verdict.verdict}; of {DURATION_S - ONSET_S:.0f} s {counts[0]:.0f} as recorded, "
            f"{counts[1]:.0f} behind a null{cost}; {worst_m:.1f} m off at worst, {wrong} of {here.sum()} beyond; "
            f"{took_s:.0f} s of processor time ({what})"
        )
        return row, np.array([*counts, here.sum(), wrong])


def _place(enu_m: np.ndarray) -> ScenePlace:
    lat, lon = np.radians(PLACE["lat_deg"]), np.radians(PLACE["lon_deg"])
    at = geodetic_from_ecef(ecef_from_geodetic(lat, lon, PLACE["height_m"]) + rot_enu_ecef(lat, lon).T @ enu_m)
    return ScenePlace(lat_deg=float(np.degrees(at[0])), lon_deg=float(np.degrees(at[1])), height_m=float(at[2]))


def report(jammed: int = 2, overpowered: int = 2, clean: int = 1, first: int = 0, bits: int = 8) -> Iterator[str]:
    """Rows of scenes, then their sums."""
    for kind, n in zip(KINDS, (jammed, overpowered, clean), strict=True):
        total = np.zeros(4)
        for number in range(first, first + n):
            row, counts = judge_scene(kind, number, bits)
            total += counts
            yield row
        if n:
            yield (
                f"{kind}, {n} scenes: of {n * (DURATION_S - ONSET_S):.0f} s {total[0]:.0f} as recorded, {total[1]:.0f} "
                f"behind a null; {total[3]:.0f} of {total[2]:.0f} fixes there beyond their bounds"
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    for kind in KINDS:
        parser.add_argument(f"--{kind}", type=int, default=0)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--bits", type=int, default=8)
    parser.add_argument("--only")
    given = parser.parse_args()
    if given.only:
        kind, number = given.only.split("-")
        print(judge_scene(kind, int(number), given.bits)[0])
        return
    for row in report(given.jammed, given.overpowered, given.clean, given.first, given.bits):
        print(row, flush=True)


if __name__ == "__main__":
    main()
