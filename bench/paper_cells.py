"""The fifth paper's pairs of receivers through samples and `protect`, beside what the study's functions keep.

    python bench/paper_cells.py --pairs 6 4 --skies 0 --seconds 26

N. Stenberg and others, NAVIGATION 69(1), 2022, doi 10.33012/navi.510, table 4: seven satellites, a meaconer 500 m from
rx1 whose copies, 400 m late, are there all the time; nothing is known of the antennas. Counted are, of seven and on the
mean of both receivers, satellites whose true signal is authentic at the end, and false signals that are; a receiver
needs some seconds before its first window.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time

import numpy as np
from numpy.typing import NDArray

from skyproof.app.protect import protect
from skyproof.formats.rinex_nav import write_nav
from skyproof.gnss.frames import ecef_from_geodetic, geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.orbits import compute_satellite_state
from skyproof.gnss.sky import compute_azimuth_elevation
from skyproof.simulator.files import write_samples
from skyproof.simulator.scenario import FrontEnd, Meaconer, Scenario, ScenePlace, SceneReceiver, Sky
from skyproof.simulator.sky import make_scene
from skyproof.studies.multi_receiver import PAIRS
from skyproof.studies.multi_receiver_scene import MEACONER_ENU_M, PLACES, SATS
from skyproof.studies.receiver_model import add_truth

BASE_DEG = (59.0, 17.0, 100.0)
FIRST = np.datetime64("2012-07-01T20:00:16", "ns")
LIGHT_M_S = 299_792_458.0


def place_of(enu_m: NDArray[np.float64]) -> dict[str, float]:
    """Keys of a place so far from the base."""
    lat_rad, lon_rad = np.radians(BASE_DEG[:2])
    away = rot_enu_ecef(lat_rad, lon_rad).T @ np.asarray(enu_m, float)
    lat, lon, height_m = geodetic_from_ecef(ecef_from_geodetic(lat_rad, lon_rad, BASE_DEG[2]) + away)
    return {"lat_deg": float(np.degrees(lat)), "lon_deg": float(np.degrees(lon)), "height_m": float(height_m)}


def cell(pair: str, sky: int, seconds: float, power_db: float) -> str:
    """A row."""
    begin = process_time()
    distance_m, direction, names = PAIRS[pair]
    start = FIRST + np.timedelta64(80 * sky, "m")
    navigation = make_nominal_constellation(start)
    base = ecef_from_geodetic(*np.radians(BASE_DEG[:2]), BASE_DEG[2])
    up = {
        orbit.sat: float(compute_azimuth_elevation(base, compute_satellite_state(orbit, start).position_ecef_m)[1])
        for orbit in navigation.ephemerides
    }
    meaconer = ScenePlace(**place_of(MEACONER_ENU_M))
    scenario = Scenario(
        seed=sky,
        start_gpst=start,
        duration_s=seconds,
        receivers=tuple(
            SceneReceiver(name=name, clock_offset_s=1e-4 * (k + 1), lo_ppm=0.3 - 0.5 * k, **place_of(PLACES[name]))
            for k, name in enumerate(names)
        ),
        attacks=(
            Meaconer(receive=meaconer, transmit=meaconer, delay_s=400.0 / LIGHT_M_S, power_db=power_db, onset_s=-10.0),
        ),
        front_end=FrontEnd(rate_hz=2.6e6, bandwidth_hz=2.08e6),
        sky=Sky(
            zenith_cn0_dbhz=47.0, horizon_cn0_dbhz=43.0, sats=tuple(sorted(sorted(up, key=up.__getitem__)[-SATS:]))
        ),
    )
    scene = make_scene(scenario, navigation)
    with TemporaryDirectory(prefix="cells") as folder:
        write_nav(Path(folder) / "broadcast.rnx", navigation)
        outcome = protect(write_samples(scene, Path(folder), "raw"), nav=Path(folder) / "broadcast.rnx").outcome
    kept, wrong = set[str](), set[str]()
    for index, r in enumerate(outcome.receivers):
        o = r.reception.observations
        assert o is not None
        share = add_truth(scene, index, r.reception).false_share
        for s in outcome.decision.labels:
            if s.ref.receiver == o.receiver and s.label == "authentic":
                false = np.nanmean(share[s.first_epoch : s.last_epoch + 1, o.signals.index(s.ref.signal)])
                (wrong if false > 0.5 else kept).add(f"{o.receiver} {s.ref.signal.sat}")
    which = f"{distance_m:5g} m {direction}, {power_db:+g} dB, sky {sky}, {seconds:g} s"
    found = f"{outcome.decision.verdict}, authentic {len(kept) / 2:g} true and {len(wrong) / 2:g} false of {SATS}"
    return f"  {which}: {found}; {process_time() - begin:.0f} s of processor"


def rows(pairs: list[str], skies: list[int], powers_db: list[float], seconds: float) -> Iterator[str]:
    yield from (cell(pair, sky, seconds, db) for pair in pairs for sky in skies for db in powers_db)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", nargs="+", choices=sorted(PAIRS), default=["6", "4"])
    parser.add_argument("--skies", nargs="+", type=int, default=[0])
    parser.add_argument("--powers-db", nargs="+", type=float, default=[0.0], help="of the copies over the true signals")
    parser.add_argument("--seconds", type=float, default=26.0)
    chosen = parser.parse_args()
    for words in rows(chosen.pairs, chosen.skies, chosen.powers_db, chosen.seconds):
        print(words, flush=True)


if __name__ == "__main__":
    main()
