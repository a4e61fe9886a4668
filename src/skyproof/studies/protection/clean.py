"""Hours without an attack, through samples and the whole job, with every equipment: how often is a false word said?

Runs of 100 s at drawn places and times, standing, on a way with bends or in circles; signals of drawn strength, with
reflections from the ground or from walls for some satellites or all; sampled as drawn. Equipment is that of the matrix,
and so is what is stated of it.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, Literal

import numpy as np
from scipy.stats import chi2

from skyproof.gnss.oscillators import OSCILLATORS
from skyproof.gnss.signals import GPS_SATS
from skyproof.simulator.scenario import FrontEnd, Multipath, Scenario, SceneReceiver, Sky
from skyproof.simulator.sites import Circle, WayPoints
from skyproof.studies.base import Row, Study, StudySettings
from skyproof.studies.protection.equipment import EQUIPMENT
from skyproof.studies.protection.items import SharedSamples, list_cells, run_cells
from skyproof.verdict import WORDS

__all__ = ["NAME", "STUDY", "clean_sky"]

NAME: Final = "protection-clean"
RUNS: Final = 90
"""With all equipment, some 20 h."""
RUN_S: Final = 100.0
QUICK: Final = ("one receiver",)
QUICK_S: Final = 12.0
PROBABILITY: Final = 0.95
SUMS: Final = ("false_alarms", "wrong_labels", "wrong_fixes", "beyond_protection", "beyond_vertical_protection")
_SAMPLES: Final[Sequence[tuple[Literal["sign", "sign-magnitude", "int"], int]]] = (
    ("sign", 1),
    ("sign-magnitude", 2),
    ("int", 8),
)


def clean_sky(seed: int, number: int, duration_s: float = RUN_S) -> Scenario:
    """Draw one of the runs of a seed."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number,)))
    rate_hz = float(rng.choice([2e6, 2.6e6, 4e6]))
    encoding, bits = _SAMPLES[int(rng.integers(len(_SAMPLES)))]
    return Scenario(
        name=f"clean-{number}",
        seed=int(rng.integers(2**31)),
        start_gpst=np.datetime64("2021-01-01T00:00:00", "ns") + np.timedelta64(int(rng.integers(126_230_400)), "s"),
        duration_s=duration_s,
        mask_deg=float(rng.choice([5.0, 10.0, 15.0])),
        receivers=(_receiver(rng, duration_s),),
        front_end=FrontEnd(
            rate_hz=rate_hz, bandwidth_hz=0.8 * rate_hz, encoding=encoding, bits=bits, agc=bool(rng.random() < 0.5)
        ),
        sky=Sky(zenith_cn0_dbhz=float(rng.uniform(45.0, 51.0)), horizon_cn0_dbhz=float(rng.uniform(37.0, 43.0))),
    )


def _receiver(rng: np.random.Generator, duration_s: float) -> SceneReceiver:
    moves = (None, _way(rng, duration_s), _circle(rng))
    path = moves[rng.choice(3, p=[0.5, 0.3, 0.2])]
    return SceneReceiver(
        name="rx",
        lat_deg=rng.uniform(-68.0, 68.0),
        lon_deg=rng.uniform(-180.0, 180.0),
        height_m=rng.uniform(0.0, 800.0),
        heading_deg=rng.uniform(0.0, 360.0) if path is None else 0.0,
        path=path,
        lo_ppm=rng.uniform(-2.5, 2.5),
        clock_offset_s=rng.uniform(-1e-3, 1e-3),
        oscillator=str(rng.choice(list(OSCILLATORS))),
        multipath=tuple(_ray(rng) for _ in range(rng.integers(5))),
    )


def _way(rng: np.random.Generator, duration_s: float) -> WayPoints:
    """Draw a way along a street with bends, as long as the run takes."""
    speed_m_s, heading_rad, points = rng.uniform(1.0, 25.0), rng.uniform(0.0, 2.0 * np.pi), [np.zeros(3)]
    for _ in range(int(duration_s / 20.0) + 3):
        leg_m = 20.0 * speed_m_s
        points.append(points[-1] + leg_m * np.array([np.sin(heading_rad), np.cos(heading_rad), rng.normal(0.0, 0.01)]))
        heading_rad += rng.normal(0.0, 0.4)
    places = tuple((float(east), float(north), float(up)) for east, north, up in points)
    return WayPoints(points_enu_m=places, speed_m_s=speed_m_s, start_s=-10.0, from_rest=False, to_rest=False)


def _circle(rng: np.random.Generator) -> Circle:
    return Circle(
        radius_m=rng.uniform(20.0, 300.0), speed_m_s=rng.uniform(1.0, 10.0), clockwise=bool(rng.random() < 0.5)
    )


def _ray(rng: np.random.Generator) -> Multipath:
    """Draw reflections from level ground below, of all satellites; or from a wall, of some."""
    way: dict[str, Any] = {"height_m": rng.uniform(0.5, 20.0)}
    if rng.random() < 0.6:
        some = rng.choice(GPS_SATS, size=rng.integers(3, 12), replace=False)
        way = {"delay_m": 10.0 ** rng.uniform(0.7, 2.5), "sats": tuple(map(str, some))}
        way["rate_hz"] = rng.uniform(-2.0, 2.0)
    return Multipath(power_db=rng.uniform(-20.0, -4.0), phase_deg=rng.uniform(0.0, 360.0), **way)


def cells(settings: StudySettings) -> list[SharedSamples]:
    """List the items of work. trials : how many skies."""
    if settings.quick:
        return [SharedSamples(scenario=clean_sky(settings.seed, 0, QUICK_S), equipments=QUICK)]
    skies = [clean_sky(settings.seed, number) for number in range(settings.count(RUNS, 1))]
    return [cell for sky in skies for cell in list_cells(sky)]


def rows(settings: StudySettings) -> Iterator[Row]:
    """Yield a row for each equipment and one of all, once all runs are done; then errors.

    false_alarms : windows in which a test says attack or spoofed; at_most_an_hour : of them, at 95 %, if they come one
        by one. Other columns are sums of the matrix's, or the worst. Raises KeyboardInterrupt as `run_cells`.
    """
    found, interrupted = list[dict[str, Any]](), False
    try:
        for row in run_cells(cells(settings), NAME, settings):
            if "error" in row:
                yield row
            else:
                found.append(row)
    except KeyboardInterrupt:
        interrupted = True
    for name in EQUIPMENT:
        if rows_of_equipment := [row for row in found if row["equipment"] == name]:
            yield _sum(name, rows_of_equipment)
    if found:
        yield _sum("all", found)
    if interrupted:
        raise KeyboardInterrupt


def _sum(name: str, found: Sequence[Mapping[str, Any]]) -> Row:
    hours = sum(row["duration_s"] for row in found) / 3600.0
    words: dict[str, int] = {word: sum(row["verdict"] == word for row in found) for word in WORDS}
    sums = {column: sum(row[column] for row in found) for column in SUMS}
    at_most = chi2.ppf(PROBABILITY, 2 * (sums["false_alarms"] + 1)) / 2.0 / hours
    return {
        "equipment": name,
        "runs": len(found),
        "hours": round(hours, 3),
        **words,
        **sums,
        "at_most_an_hour": round(float(at_most), 3),
        "trusted_worst_m": max((row["trusted_worst_m"] for row in found if row["trusted_worst_m"]), default=None),
        "trusted_share": round(float(np.mean([row["trusted_share"] for row in found])), 3),
    }


STUDY: Final = Study(
    name=NAME,
    title="Hours of sky without an attack with every equipment, through samples and the whole job: false words",
    paper="skyproof",
    figure="hours without an attack",
    run=rows,
)
