"""Two receivers' logs in UBX, made from scenes, beside two RINEX files of the same measurements, by word and position.

Each receiver follows the strongest copy of each signal. The logs are judged with the navigation file, and again with
the orbits of their own messages alone.

    python bench/two_logs.py [SCENE ...]
"""

import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from skyproof.app.common.rinex import write_channels
from skyproof.app.protect import protect
from skyproof.errors import SkyproofError
from skyproof.formats.rinex_nav import write_nav
from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.logs.ubx_write import ubx_log
from skyproof.simulator.constellation import make_navigation
from skyproof.simulator.measurements import draw, make_ideal_measurements
from skyproof.simulator.ordinary import follow_strongest
from skyproof.simulator.scenes import read_ready_made
from skyproof.simulator.sky import make_scene

SCENES = ("clean", "starts-spoofed", "some-satellites", "meacon-ramp", "jamming")
FIXES = ("trusted_fix", "false_fix", "unprotected_fix")


def report(scenes: tuple[str, ...] = SCENES) -> Iterator[str]:
    """Rows of the table."""
    yield "two receivers of a scene by RINEX, by UBX, and by UBX alone; and how far positions of the first two differ"
    for name in scenes:
        with TemporaryDirectory() as folder:
            found = _judged(name, Path(folder))
        words = ", ".join("error" if item is None else item.verdict for item in found)
        apart_m = "" if None in found[:2] else f"{_apart_m(*found[:2]):.2f} m"
        yield f"  {name:<18} {words:<50} {apart_m}"


def _judged(name: str, folder: Path) -> list[Any]:
    """Return the verdicts; None where none comes out."""
    made = read_ready_made(name)
    navigation = make_navigation(made)
    scene = make_scene(made, navigation)
    observations, _ = draw(make_ideal_measurements(scene), rng=np.random.default_rng(1))
    nav = folder / "nav.rnx"
    write_nav(nav, navigation)
    logs, files, places = [], [], []
    for o, sky in zip(map(follow_strongest, observations[:2]), scene.skies[:2], strict=True):
        logs.append(folder / f"{o.receiver}.ubx")
        logs[-1].write_bytes(b"".join(ubx_log(o, navigation)))
        files.append(folder / f"{o.receiver}.obs")
        write_channels(files[-1], o, "mixed", None, o.signals)
        places.append(sky.point(np.array([sky.receiver.start_offset_s])).position_ecef_m[0])
    arguments = {"antenna_distance_m": float(np.linalg.norm(places[0] - places[1]))} if len(places) > 1 else {}
    return [_verdict(files, nav=nav, **arguments), _verdict(logs, nav=nav, **arguments), _verdict(logs, **arguments)]


def _verdict(paths: list[Path], **given: Any) -> Any:
    try:
        return protect(paths, **given).verdict
    except SkyproofError as error:
        print(error, file=sys.stderr)
        return None


def _apart_m(a: Any, b: Any) -> float:
    """Return the largest distance of positions of the same kind; infinite where only one verdict has one."""
    apart_m = [0.0]
    for ours, theirs in zip(a.receivers, b.receivers, strict=True):
        for kind in FIXES:
            fixes = [getattr(receiver, kind) for receiver in (ours, theirs)]
            if None not in fixes:
                places = [ecef_from_geodetic(np.radians(f.lat_deg), np.radians(f.lon_deg), f.height_m) for f in fixes]
                apart_m.append(float(np.linalg.norm(places[0] - places[1])))
            elif fixes != [None, None]:
                apart_m.append(float("inf"))
    return max(apart_m)


if __name__ == "__main__":
    for row in report(tuple(sys.argv[1:]) or SCENES):
        print(row, flush=True)
