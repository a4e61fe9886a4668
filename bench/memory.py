"""Peak memory and processor time of the main job on runs of different lengths: samples of two receivers, rendered as
they are read, and measurements of 1 Hz, as observation files and as UBX logs. Memory should not grow with the run.

Each run is a process of its own: `python memory.py samples MINUTES` is one, `python memory.py rinex HOURS` and
`python memory.py ubx HOURS` are, and with a number behind the hours, for so many receivers. What is rendered grows with
the scene: `python memory.py rendering MINUTES` does that alone, and what it takes more than for the shortest run is
taken off.
"""

import json
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from time import perf_counter, process_time
from unittest.mock import patch

import numpy as np

from skyproof.app.protect import protect
from skyproof.formats.rinex_nav import write_nav
from skyproof.formats.rinex_obs import write_obs
from skyproof.gnss.ephemeris import Ephemeris
from skyproof.gnss.lnav import quantise
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.logs.ubx_write import ubx_log
from skyproof.records import NavigationData, Observations, Samples
from skyproof.simulator.kinds import Kind
from skyproof.simulator.measurements import NoiseModel, draw, make_ideal_measurements
from skyproof.simulator.nominal_systems import make_nominal_systems
from skyproof.simulator.samples import render_samples
from skyproof.simulator.scenario import FrontEnd, Scenario, SceneReceiver
from skyproof.simulator.sky import make_scene

sys.path.insert(0, str(Path(__file__).parent.parent))
from tests.gnss.later import extrapolate_hours

START = np.datetime64("2022-01-01T10:30:00", "ns")
LAT_DEG, LON_DEG, APART_DEG = 57.7, 11.94, 6.7e-4  # 40 m
RATE_HZ = 2.6e6
GEOSTATIONARY = {f"C{number:02d}" for number in range(1, 6)}
KINDS = (("G", "L1", "CA"), ("G", "L2", "L"), ("E", "E1", "C"), ("C", "B1", "2I"))
MINUTES, HOURS = (1, 10), (1, 6)
WHOLE_MINUTES, WHOLE_HOURS = (1, 10, 60), (1, 24)


def report(minutes: tuple[int, ...] = MINUTES, hours: tuple[int, ...] = HOURS) -> Iterator[str]:
    """Rows of the table."""
    for kind, lengths, unit in (("samples", minutes, "min"), ("rinex", hours, "h"), ("ubx", hours, "h")):
        first: float | None = None
        least: float | None = None
        for length in lengths:
            run = _run_of_its_own(kind, length)
            scene_mb = _run_of_its_own("rendering", length)["peak_mb"] if kind == "samples" else 0.0
            least = scene_mb if least is None else least
            own_mb = run["peak_mb"] - (scene_mb - least)
            first = first or own_mb
            ratio = f"{own_mb:.0f} MB without what rendering grows by, {own_mb / first:.2f} of the shortest"
            yield (
                f"  {kind} of two receivers, {length:2d} {unit}: peak {run['peak_mb']:.0f} MB ({ratio}), "
                f"{run['seconds']:.0f} s, {run['processor_s']:.0f} s of processor time, {run['verdict']}"
            )


def whole() -> Iterator[str]:
    """Rows of an hour of samples and a day of observations."""
    return report(WHOLE_MINUTES, WHOLE_HOURS)


def hour_by_format() -> Iterator[str]:
    """Rows of an hour of the same measurements by each format, of one receiver and of two."""
    for receivers in (1, 2):
        for kind in ("rinex", "ubx"):
            run = _run_of_its_own(kind, 1, receivers)
            yield (
                f"  protect, an hour of {receivers} at 1 Hz by {kind:<5} {run['processor_s']:6.3g} s of processor, "
                f"peak {run['peak_mb']:.0f} MB, files of {run['files_mb']:.1f} MB, {run['verdict']}"
            )


def _run_of_its_own(kind: str, *numbers: int) -> dict[str, float]:
    command = [sys.executable, __file__, kind, *map(str, numbers)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return dict(json.loads(done.stdout.splitlines()[-1]))


def _receivers(oscillator: str, number: int = 2) -> tuple[SceneReceiver, ...]:
    return tuple(
        SceneReceiver(
            name=f"rx{k + 1}",
            lat_deg=LAT_DEG,
            lon_deg=LON_DEG + k * APART_DEG,
            height_m=50.0,
            clock_offset_s=1e-5 * (k + 1),
            oscillator=oscillator,
        )
        for k in range(number)
    )


def _rendered(minutes: int) -> tuple[list[Samples], NavigationData]:
    scenario = Scenario(
        seed=1,
        start_gpst=START,
        duration_s=60.0 * minutes,
        front_end=FrontEnd(rate_hz=RATE_HZ),
        receivers=_receivers("ocxo"),
    )
    navigation = make_nominal_constellation(START + np.timedelta64(30 * minutes, "s"))
    return list(render_samples(scenario, navigation)), navigation


def rendering(minutes: int) -> str:
    """A tenth of a second of each minute, of both receivers."""
    sources, _ = _rendered(minutes)
    for source in sources:
        for minute in range(minutes):
            source.read(int(60 * minute * RATE_HZ), int(0.1 * RATE_HZ))
    return ""


def samples(minutes: int, folder: Path) -> str:
    """The verdict on samples that are rendered as they are read."""
    sources, navigation = _rendered(minutes)
    write_nav(folder / "nav.rnx", navigation)
    with patch("skyproof.app.protect.run.open_inputs", lambda *_: sources):
        return protect(["rendered"], nav=folder / "nav.rnx", out=folder / "out").verdict.verdict


def measurements(kind: str, hours: int, folder: Path, receivers: int = 2) -> None:
    """Print the verdict on measurements of 1 Hz, as observation files or as UBX logs that hold the messages of GPS."""
    paths = [folder / f"rx{number}.{kind}" for number in range(1, receivers + 1)]
    nominal = make_nominal_systems(START + np.timedelta64(30, "m"), "GEC")
    # BeiDou's geostationary satellites turn in a frame of their own, where one orbit has no second set.
    first = replace(nominal, ephemerides=tuple(e for e in nominal.ephemerides if e.sat not in GEOSTATIONARY))
    # What is believed of the ionosphere is not what it is.
    believed = replace(first.ionosphere, alpha=tuple(0.8 * a for a in first.ionosphere.alpha))
    sets: list[Ephemeris] = []
    for hour in range(hours):
        start = START + np.timedelta64(hour, "h")
        truth = replace(first, ephemerides=tuple(_sent_at(e, hour) for e in first.ephemerides))
        scenario = Scenario(
            seed=1, start_gpst=start, duration_s=3600.0, mask_deg=8.0, receivers=_receivers("rubidium", receivers)
        )
        scene = make_scene(scenario, truth, sats=[e.sat for e in truth.ephemerides])
        kinds = [Kind(*kind, {"rx1": 1.0, "rx2": 2.0}) for kind in KINDS]
        noise = NoiseModel(sigma_m=0.5, constant_m=0.5)
        observed, _ = draw(
            make_ideal_measurements(scene, interval_s=1.0, kinds=kinds), rng=np.random.default_rng(hour), noise=noise
        )
        sent = replace(truth, ionosphere=believed)
        for path, o in zip(paths, observed, strict=True):
            with path.open("ab") as file:
                file.writelines(_rinex(o, hour) if kind == "rinex" else ubx_log(o, sent))
        sets += truth.ephemerides
    write_nav(folder / "nav.rnx", NavigationData(ephemerides=tuple(sets), ionosphere=believed))
    # Making the files takes memory of its own: the run is another process.
    done = subprocess.run(
        [sys.executable, __file__, "protect", *map(str, paths), str(folder / "nav.rnx"), str(folder / "out")],
        capture_output=True,
        text=True,
        check=True,
    )
    files_mb = sum(path.stat().st_size for path in paths) / 1e6
    print(json.dumps(json.loads(done.stdout) | {"files_mb": files_mb}))


def _sent_at(e: Ephemeris, hour: int) -> Ephemeris:
    """Return the data set of an hour, whose numbers are those of the message where the logs hold it."""
    later = extrapolate_hours(e, hour)
    return quantise(later) if e.sat[0] == "G" else later


def _rinex(o: Observations, hour: int) -> Iterator[bytes]:
    """Give the lines of a file; those of the header at the first hour alone."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "one.obs"
        write_obs(path, o, signals=o.signals, holds="truth", marker=o.receiver, version="bench")
        lines = path.read_text("ascii").splitlines()
    body = next(row for row, text in enumerate(lines) if "END OF HEADER" in text) + 1
    return (f"{text}\n".encode() for text in lines[body if hour else 0 :])


def _measured(verdict: str, begin: float) -> str:
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    seconds = {"seconds": perf_counter() - begin, "processor_s": process_time()}
    return json.dumps({"peak_mb": peak_mb, **seconds, "verdict": verdict})


def main(kind: str, *rest: str) -> None:
    """One run."""
    with tempfile.TemporaryDirectory() as folder:
        begin = perf_counter()
        if kind == "samples":
            print(_measured(samples(int(rest[0]), Path(folder)), begin))
        elif kind == "rendering":
            print(_measured(rendering(int(rest[0])), begin))
        elif kind in ("rinex", "ubx"):
            hours, *receivers = map(int, rest)
            measurements(kind, hours, Path(folder), *receivers)
        else:
            *paths, nav, out = rest
            print(_measured(protect(paths, nav=nav, out=out).verdict.verdict, begin))


if __name__ == "__main__":
    main(*sys.argv[1:])
