"""Clean skies with damaged auxiliary inputs through `protect`: is one called spoofed, and is the true cause named?

    python bench/damaged.py --draws 300 --out damaged.jsonl      300 of each kind; goes on where it was stopped
    python bench/damaged.py --kinds orbits positions --draws 50
    python bench/damaged.py --attacks 60 --out attacked.jsonl    the reverse: spoofed skies, none may be authentic
    python bench/damaged.py --table damaged.jsonl                the counts alone

Skies are those of real receivers 1 m, 3.3 km and 5.3 km apart (the folder that SKYPROOF_DATA names) and simulated ones
at drawn places and times, half a minute each (seven minutes at 30 s); with `--real no` the simulated ones alone. One
thing is damaged in each run: the navigation file, surveyed positions, the distance, attitude and places in the body,
the file of inertial readings, the header or the epochs of an observation file. A damage follows from its name alone.

A cause is named where a code of `wrong_statements`, a remark on that input, or the error that ends the run says it. A
damage that is not named was harmless if the run says of the sky what it says without the damage and, of a statement,
if it is off by no more than three of its own stated sigmas; else the cause was missed.
"""

import os
import re
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
import tomli_w
from rows import Row, parser_of, rows_of

from skyproof.app.protect import protect
from skyproof.errors import SkyproofError
from skyproof.formats.rinex_nav import write_nav
from skyproof.formats.rinex_obs import write_obs
from skyproof.gnss.frames import ecef_from_geodetic, geodetic_from_ecef, rot_enu_ecef, rot_ned_body
from skyproof.gnss.geoid import interpolate_geoid_m
from skyproof.records import Observations
from skyproof.testing import FalseSky, MeasuredScene, TrackErrors

KINDS: Final = ("orbits", "positions", "distances", "attitudes", "imu", "headers", "epochs")
EPOCHS: Final = 26
SEED: Final = 1
NAMES: Final = ("one", "two")
SIGMAS: Final = 3.0  # a statement that is off by less is as good as it says
CARRIER_M: Final = 299_792_458.0 / 1575.42e6


@dataclass(frozen=True, eq=False, kw_only=True)
class Sky:
    """A clean sky. obs, nav : lines of the files. ecef_m : (2, 3) where the antennas stand, to `sigma_m`."""

    name: str
    obs: tuple[tuple[str, ...], tuple[str, ...]]
    nav: tuple[str, ...]
    ecef_m: np.ndarray
    sigma_m: float
    seconds: float

    @property
    def enu_m(self) -> np.ndarray:
        """(3,) from the first antenna to the second."""
        return frame_of(self.ecef_m[0]) @ (self.ecef_m[1] - self.ecef_m[0])


@dataclass(kw_only=True)
class Inputs:
    """What a run gets. named : what has to be said of the cause, as patterns of codes, remarks and errors.

    right : the same with a statement as it should be; None where a file is damaged. off_m, sigma_m : how far off the
    statement is, and how far it says that it may be.
    """

    obs: list[list[str]]
    nav: list[str]
    platform: dict[str, Any] = field(default_factory=dict)
    options: dict[str, Any] = field(default_factory=dict)
    imu: str | None = None
    damage: str = ""
    named: tuple[str, ...] = ()
    right: "Inputs | None" = None
    off_m: float = 0.0
    sigma_m: float = np.inf


def frame_of(ecef_m: np.ndarray) -> np.ndarray:
    lat, lon, _ = geodetic_from_ecef(ecef_m)
    return rot_enu_ecef(lat, lon)


# ---------------------------------------------------------------------- clean skies


def folder() -> Path:
    return Path(os.environ.get("SKYPROOF_DATA", Path(__file__).resolve().parents[2] / "shared" / "data")) / "real"


def cut(lines: Sequence[str], epochs: int) -> tuple[str, ...]:
    """The header and the first epochs of an observation file."""
    end = next(k for k, line in enumerate(lines) if "END OF HEADER" in line)
    version = float(lines[0][:9])
    begins = re.compile(r">" if version >= 3.0 else r" \d\d [ \d]\d [ \d]\d [ \d]\d [ \d]\d[ \d.]{11}  0")
    starts = [k for k in range(end + 1, len(lines)) if begins.match(lines[k])]
    return tuple(lines[: starts[epochs]] if len(starts) > epochs else lines)


@cache
def real(name: str) -> Sky:
    """One of the real pairs. The places of the farther two are those that code shows, good to some metres."""
    where, files, nav, ecef_m, sigma_m, epochs = {
        "1m": (
            "rinex-mosaic-1m",
            ("base.obs", "rover.obs"),
            "base.nav",
            ((-3817681.121, 3562839.431, 3650159.159), (-3817681.381, 3562839.979, 3650158.376)),
            0.02,
            EPOCHS,
        ),
        "5km": (
            "rinex-mosaic-5km",
            ("3034265G.21O", "SEPT265G.21O"),
            "SEPT2650.21P",
            ((-3959400.631, 3385704.533, 3667523.111), (-3961952.3, 3381199.2, 3668916.9)),
            5.0,
            EPOCHS,
        ),
        "3km": (
            "rinex-gsi-3km",
            ("07590920.05o", "30400920.05o"),
            "07590920.05n",
            ((-3976219.508, 3382372.567, 3652512.985), (-3978242.435, 3382841.172, 3649902.767)),
            5.0,
            15,
        ),
    }[name]

    def lines(file: str) -> tuple[str, ...]:
        return tuple((folder() / where / file).read_text(encoding="latin-1").splitlines())

    one, two = (cut(lines(file), epochs) for file in files)
    return Sky(
        name=name, obs=(one, two), nav=lines(nav), ecef_m=np.array(ecef_m), sigma_m=sigma_m, seconds=30.0 * epochs
    )


def scene_keys(rng: np.random.Generator) -> tuple[dict[str, Any], np.ndarray]:
    """Of a pair of antennas 2 to 100 m apart, anywhere at any time; and where they are."""
    apart_m = float(10.0 ** rng.uniform(0.3, 2.0))
    az, up_m = rng.uniform(0.0, 2.0 * np.pi), 0.3 * apart_m * rng.uniform(-1.0, 1.0)
    level_m = float(np.sqrt(apart_m**2 - up_m**2))
    enu_m = np.array([level_m * np.sin(az), level_m * np.cos(az), up_m])
    place = (float(np.degrees(np.arcsin(rng.uniform(-0.9, 0.9)))), float(rng.uniform(-180.0, 180.0)), 80.0)
    here_m = ecef_from_geodetic(np.radians(place[0]), np.radians(place[1]), place[2])
    keys = {
        "antennas_enu_m": {NAMES[0]: (0.0, 0.0, 0.0), NAMES[1]: tuple(map(float, enu_m))},
        "epochs": EPOCHS,
        "errors": TrackErrors(
            float(rng.uniform(0.3, 0.8)), float(rng.choice([0.0, 0.9])), float(rng.uniform(0.2, 0.8))
        ),
        "place_deg": place,
        "start_gpst": np.datetime64("2022-01-01T00:00:00", "ns") + np.timedelta64(int(rng.integers(63_000_000)), "s"),
    }
    return keys, np.array([here_m, here_m + frame_of(here_m).T @ enu_m])


def written(
    observations: Sequence[Observations], navigation: Any
) -> tuple[tuple[tuple[str, ...], ...], tuple[str, ...]]:
    """Lines of the observation files and the navigation file, by our own writer."""
    with tempfile.TemporaryDirectory() as place:
        files = []
        for o in observations:
            path = Path(place) / f"{o.receiver}.obs"
            write_obs(path, o, signals=o.signals, holds="simulated", marker=o.receiver, version="bench")
            files.append(tuple(path.read_text(encoding="latin-1").splitlines()))
        write_nav(Path(place) / "nav.rnx", navigation)
        return tuple(files), tuple((Path(place) / "nav.rnx").read_text(encoding="latin-1").splitlines())


def simulated(rng: np.random.Generator) -> Sky:
    keys, ecef_m = scene_keys(rng)
    scene = MeasuredScene(**keys)
    (one, two), nav = written(scene.records(rng).observations, scene.navigation)
    return Sky(name="sim", obs=(one, two), nav=nav, ecef_m=ecef_m, sigma_m=0.02, seconds=float(EPOCHS))


# ---------------------------------------------------------------------- damages


def truth_options(sky: Sky) -> dict[str, Any]:
    """The distance as it is, so that the sky alone is authentic where it can be."""
    apart_m = float(np.linalg.norm(sky.enu_m))
    sigma_m = max(0.03, float(np.hypot(sky.sigma_m, sky.sigma_m)))
    options = {"antenna_distance_m": round(apart_m, 3), "antenna_distance_sigma_m": sigma_m}
    return options | far_of(sky)


def far_of(sky: Sky) -> dict[str, Any]:
    """What a run of receivers so far apart has to be told in any case."""
    return {"max_separation_m": 1e4} if np.linalg.norm(sky.enu_m) > 250.0 else {}


def nav_records(lines: Sequence[str]) -> tuple[list[str], list[list[str]]]:
    """The header, and the lines of each record."""
    end = next(k for k, line in enumerate(lines) if "END OF HEADER" in line)
    begins = re.compile(r"[A-Z][ \d]\d " if float(lines[0][:9]) >= 3.0 else r"[ \d]\d [ \d]\d [ \d]\d [ \d]\d ")
    found: list[list[str]] = []
    for line in lines[end + 1 :]:
        if begins.match(line):
            found.append([line])
        elif found:
            found[-1].append(line)
    return list(lines[: end + 1]), found


def shift_date(line: str, hours: int, version: float) -> str:
    """A record's first line with its date moved."""
    if version >= 3.0:
        y, mo, d, h, mi, s = (int(line[a:b]) for a, b in ((4, 8), (9, 11), (12, 14), (15, 17), (18, 20), (21, 23)))
        when = np.datetime64(f"{y:04d}-{mo:02d}-{d:02d}T{h:02d}:{mi:02d}:{s:02d}") + np.timedelta64(hours, "h")
        return line[:4] + re.sub("[-T:]", " ", str(when)) + line[23:]
    y, mo, d, h, mi = (int(line[a:b]) for a, b in ((3, 5), (6, 8), (9, 11), (12, 14), (15, 17)))
    when = np.datetime64(f"{2000 + y:04d}-{mo:02d}-{d:02d}T{h:02d}:{mi:02d}") + np.timedelta64(hours, "h")
    y, mo, d, h, mi = (int(x) for x in re.split("[-T:]", str(when)))
    return f"{line[:2]} {y % 100:02d} {mo:2d} {d:2d} {h:2d} {mi:2d}{line[17:]}"


def field_of(record: list[str], row: int, column: int, version: float) -> tuple[int, int]:
    first = (4 if version >= 3.0 else 3) + 19 * column
    return first, first + 19


def put(record: list[str], row: int, column: int, version: float, change: Callable[[float], float]) -> None:
    """Change a number of a record in its place."""
    a, b = field_of(record, row, column, version)
    text = record[row][a:b].replace("D", "E").replace("d", "e")
    if not text.strip():
        return
    value = change(float(text))
    record[row] = record[row][:a].ljust(a) + f"{value:19.12E}" + record[row][b:]


def damage_orbits(rng: np.random.Generator, sky: Sky, inputs: Inputs) -> None:
    version = float(sky.nav[0][:9])
    header, records = nav_records(inputs.nav)
    share = float(rng.choice([0.1, 0.3, 0.6, 1.0]))
    some = [k for k in range(len(records)) if rng.random() < share] or [0]
    hours = int(rng.choice([-48, -24, -12, -8, -3, -2, -1, 1, 2, 3, 8, 12, 24, 48]))
    kepler = [k for k in some if records[k][0][0] not in "RS" or version < 3.0]
    fault = str(
        rng.choice(
            [
                "dates",
                "toe",
                "dates and toe",
                "week",
                "number",
                "digit",
                "sign",
                "exponent",
                "copy",
                "health",
                "system",
                "swapped",
                "ionosphere",
                "leaps",
                "cut",
                "clock",
            ]
        )
    )
    inputs.named = (
        r"left out",
        r"no ephemeris",
        r"no orbits",
        r"its orbits are for",
        r"none of its orbits",
        r"GPS week resolved",
        r"ends within",
        r"unhealthy",
        r"^orbits$",
    )
    if fault in ("dates", "dates and toe"):
        for k in some:
            records[k][0] = shift_date(records[k][0], hours, version)
    if fault in ("toe", "dates and toe"):
        for k in kepler:
            put(records[k], 3, 0, version, lambda toe: (toe + 3600.0 * hours) % 604800.0)
    if fault == "week":
        by = int(rng.choice([-1024, -1, 1, 1024, 37]))
        for k in kepler:
            put(records[k], 5, 2, version, lambda week: week + by)
    if fault in ("number", "digit", "sign", "exponent"):
        for k in kepler:
            row, column = int(rng.integers(1, 5)), int(rng.integers(4))
            factor = {"number": 1.0 + 10.0 ** rng.uniform(-6, 0), "sign": -1.0, "exponent": 10.0 ** rng.choice([-1, 1])}
            a, b = field_of(records[k], row, column, version)
            if fault == "digit":
                place = int(rng.integers(a + 2, b - 5))
                line = records[k][row].ljust(b)
                if line[place].isdigit():
                    records[k][row] = line[:place] + str(rng.integers(10)) + line[place + 1 :]
            else:
                put(records[k], row, column, version, lambda x, by=factor[fault]: x * by)
    if fault == "clock":
        for k in kepler:
            records[k] = list(records[k])
            a = 23 if version >= 3.0 else 22
            text = records[k][0][a : a + 19].replace("D", "E")
            value = float(text) + float(rng.choice([-1, 1])) * 10.0 ** rng.uniform(-8, -3)
            records[k][0] = records[k][0][:a] + f"{value:19.12E}" + records[k][0][a + 19 :]
    if fault == "copy":
        for k in kepler:
            other = list(records[k])
            put(
                other,
                int(rng.integers(1, 5)),
                int(rng.integers(4)),
                version,
                lambda x: x * (1.0 + 10.0 ** rng.uniform(-5, -1)),
            )
            records.append(other)
    if fault == "health":
        for k in kepler:
            put(records[k], 6, 1, version, lambda health: float(rng.choice([1, 63])))
    if fault == "system":
        keep = str(rng.choice(list("GRECJ")))
        kept = [r for r in records if r[0][0] == keep] if version >= 3.0 else records[:2]
        records = kept or records[:1]
    if fault == "swapped" and len(records) > 3:
        i, j = rng.choice(len(records), 2, replace=False)
        n = 3 if version >= 3.0 else 2
        if records[i][0][0] == records[j][0][0] or version < 3.0:
            a, b = records[i][0][:n], records[j][0][:n]
            records[i][0], records[j][0] = b + records[i][0][n:], a + records[j][0][n:]
    if fault == "ionosphere":
        for k, line in enumerate(header):
            if "ION ALPHA" in line or "ION BETA" in line or line[:3] == "GPS":
                header[k] = re.sub(
                    r"[ED]([-+]\d\d)", lambda m: f"E{int(m[1]) + int(rng.choice([-3, 2, 3, 5])):+03d}", line
                )
    if fault == "leaps":
        header = [f"{int(rng.choice([0, -18, 99, 37])):6d}" + x[6:] if "LEAP SECONDS" in x else x for x in header]
    lines = header + [line for record in records for line in record]
    if fault == "cut":
        lines = lines[: int(rng.integers(len(header) + 1, len(lines)))]
        lines[-1] = lines[-1][: int(rng.integers(1, 79))]
    inputs.nav, inputs.damage = lines, f"{fault} {share:g}"


def surveyed(ecef_m: np.ndarray, sigma_m: float) -> dict[str, float]:
    lat, lon, height = geodetic_from_ecef(ecef_m)
    return {
        "lat_deg": float(np.degrees(lat)),
        "lon_deg": float(np.degrees(lon)),
        "height_m": float(height),
        "sigma_m": sigma_m,
    }


def place_of(position: dict[str, float]) -> np.ndarray:
    """(3,) ECEF of what `surveyed` gives."""
    return ecef_from_geodetic(np.radians(position["lat_deg"]), np.radians(position["lon_deg"]), position["height_m"])


def minutes(value: float) -> float:
    degrees = np.floor(abs(value))
    return float(np.copysign(degrees + 0.6 * (abs(value) - degrees), value))


def damage_positions(rng: np.random.Generator, sky: Sky, inputs: Inputs) -> None:
    places = [surveyed(ecef_m, sky.sigma_m) for ecef_m in sky.ecef_m]
    true = deepcopy(places)
    fault = str(
        rng.choice(
            [
                "sea level",
                "feet",
                "ground",
                "swapped",
                "lon sign",
                "lat sign",
                "minutes",
                "offset",
                "height",
                "digit",
                "exchanged",
            ]
        )
    )
    which = [int(rng.integers(2))] if rng.random() < 0.6 else [0, 1]
    up_m, offset_m = float(rng.uniform(0.5, 60.0)), float(10.0 ** rng.uniform(0.3, 4.0))
    codes = {
        "sea level": "height",
        "feet": "height",
        "ground": "height",
        "height": "height",
        "swapped": "swapped",
        "lon sign": "sign",
        "lat sign": "sign",
        "minutes": "minutes",
    }
    for k in which:
        one = places[k]
        if fault == "sea level":
            one["height_m"] -= float(interpolate_geoid_m(one["lat_deg"], one["lon_deg"]))
        if fault == "feet":
            one["height_m"] /= 0.3048
        if fault == "ground":
            one["height_m"] -= up_m
        if fault == "height":
            one["height_m"] += float(rng.normal()) * 30.0
        if fault == "swapped" and abs(one["lon_deg"]) <= 90.0:
            one["lat_deg"], one["lon_deg"] = one["lon_deg"], one["lat_deg"]
        if fault == "lon sign":
            one["lon_deg"] = -one["lon_deg"]
        if fault == "lat sign":
            one["lat_deg"] = -one["lat_deg"]
        if fault == "minutes":
            one["lat_deg"], one["lon_deg"] = minutes(one["lat_deg"]), minutes(one["lon_deg"])
        if fault == "digit":
            one["lat_deg"] += float(rng.choice([-1, 1])) * 10.0 ** -float(rng.integers(1, 6))
        if fault == "offset":
            az = rng.uniform(0.0, 2.0 * np.pi)
            one["lat_deg"] += np.degrees(offset_m * np.cos(az) / 6.37e6)
            one["lon_deg"] += np.degrees(offset_m * np.sin(az) / 6.37e6)
    if fault == "exchanged":
        places.reverse()
    inputs.options = far_of(sky)
    inputs.platform["receivers"] = [{"position": place} for place in places]
    if rng.random() < 0.5:
        inputs.platform["motion"] = "static"
    off_m = [float(np.linalg.norm(place_of(a) - place_of(b))) for a, b in zip(places, true, strict=True)]
    if rng.random() < 0.3:  # one receiver alone
        k = which[0]
        inputs.obs, inputs.platform["receivers"] = [inputs.obs[k]], [inputs.platform["receivers"][k]]
        true, off_m = [true[k]], [off_m[k]]
    inputs.right = deepcopy(inputs)
    inputs.right.platform["receivers"] = [{"position": place} for place in true]
    inputs.damage, inputs.off_m, inputs.sigma_m = fault, max(off_m), sky.sigma_m
    inputs.named = (
        codes.get(fault, r"wrong_statement|receivers_swapped|attitude_or_axes|height"),
        r"\.position is",
        "wrong_statement",
    )


def damage_distances(rng: np.random.Generator, sky: Sky, inputs: Inputs) -> None:
    true_m = float(np.linalg.norm(sky.enu_m))
    factors = {
        "feet": 1.0 / 0.3048,
        "made feet": 0.3048,
        "cm": 100.0,
        "mm": 1000.0,
        "twice": 2.0,
        "half": 0.5,
        "decimal": float(rng.choice([0.1, 10.0])),
        "yards": 1.0 / 0.9144,
        "any": float(10.0 ** rng.uniform(-1.0, 1.0)),
    }
    fault = str(rng.choice([*factors, "level", "absolute", "separation"]))
    stated_m = true_m * factors.get(fault, 1.0)
    if fault == "level":
        stated_m = max(float(np.hypot(*sky.enu_m[:2])), 0.05)
    if fault == "absolute":
        stated_m = float(rng.uniform(0.5, 300.0))
    inputs.damage = fault
    inputs.named = ("feet|yards|metres|twice|half|decimal|level|wrong_statement",)
    if fault == "separation":
        least_m = min(true_m * float(10.0 ** rng.uniform(0.0, 1.5)), 1e5)
        inputs.options = {
            "antenna_separation_m": least_m,
            "max_separation_m": float(np.clip(2.0 * least_m, 300.0, 1e5)),
        }
        inputs.right = replace(inputs, options=inputs.options | {"antenna_separation_m": 0.5 * true_m})
        inputs.off_m, inputs.sigma_m = least_m - true_m, 0.0
        return
    stated_m = min(round(stated_m, 3), 1e5)
    inputs.options = {"antenna_distance_m": stated_m} | far_of(sky)
    inputs.off_m, inputs.sigma_m = abs(stated_m - true_m), max(0.025 * stated_m, 0.5)
    if rng.random() < 0.5:
        inputs.sigma_m = max(0.01 * stated_m, 0.02)
        inputs.options["antenna_distance_sigma_m"] = inputs.sigma_m
    inputs.right = replace(inputs, options=inputs.options | {"antenna_distance_m": round(true_m, 3)})


def damage_attitudes(rng: np.random.Generator, sky: Sky, inputs: Inputs) -> None:
    """Places in the body, and how the body is turned."""
    heading, pitch, roll = float(rng.uniform(0.0, 360.0)), float(rng.normal() * 3.0), float(rng.normal() * 3.0)
    ned = np.array([sky.enu_m[1], sky.enu_m[0], -sky.enu_m[2]])
    body_m = rot_ned_body(*np.radians([heading, pitch, roll])).T @ ned
    fault = str(
        rng.choice(["heading", "opposite", "right angle", "left", "up", "order", "sign", "radians", "feet", "enu"])
    )
    true = (heading, body_m)
    if fault == "heading":
        heading += float(rng.normal() * 30.0)
    if fault == "opposite":
        heading += 180.0
    if fault == "right angle":
        heading += float(rng.choice([-90.0, 90.0]))
    if fault == "sign":
        heading = -heading
    if fault == "radians":
        heading = float(np.radians(heading))
    if fault == "left":
        body_m = body_m * [1.0, -1.0, 1.0]
    if fault == "up":
        body_m = body_m * [1.0, 1.0, -1.0]
    if fault == "order":
        body_m = body_m[[1, 0, 2]]
    if fault == "feet":
        body_m = body_m / 0.3048
    inputs.damage, inputs.options = fault, far_of(sky)
    inputs.named = ("attitude|axes|sign|swapped|feet|down|wrong_statement|height",)
    if fault == "enu" or np.abs(body_m).max() > 1e3:  # places as east, north, up, in another order of axes
        orders = ([1, 0, 2], [0, 1, 2]), ([1, -1, 1], [-1, 1, 1], [1, 1, -1])
        enu_m = np.array(sky.enu_m)[orders[0][int(rng.integers(2))]] * orders[1][int(rng.integers(3))]
        places = {"0": (0.0, 0.0, 0.0), "1": tuple(map(float, enu_m))}
        inputs.options |= {"antennas_enu_m": places, "antennas_sigma_m": max(sky.sigma_m, 0.02)}
        right = {"0": (0.0, 0.0, 0.0), "1": tuple(map(float, sky.enu_m))}
        inputs.right = replace(inputs, options=inputs.options | {"antennas_enu_m": right})
        inputs.off_m, inputs.sigma_m = float(np.linalg.norm(enu_m - sky.enu_m)), max(sky.sigma_m, 0.02)
        return
    sigma_deg, sigma_m = float(rng.choice([0.2, 1.0])), max(sky.sigma_m, 0.02)

    def platform(heading_deg: float, places_m: np.ndarray) -> dict[str, Any]:
        turned = {"heading_deg": heading_deg % 360.0, "pitch_deg": pitch, "roll_deg": roll, "sigma_deg": sigma_deg}
        second = {"body_m": [float(x) for x in places_m], "antenna_sigma_m": sigma_m}
        return {
            "attitude": turned,
            "receivers": [{"body_m": [0.0, 0.0, 0.0], "antenna_sigma_m": sigma_m}, second],
        }

    inputs.right = replace(inputs, platform=inputs.platform | platform(*true))
    inputs.platform |= platform(heading, body_m)
    stated_ned = rot_ned_body(*np.radians([heading, pitch, roll])) @ body_m
    inputs.off_m = float(np.linalg.norm(stated_ned - ned))
    inputs.sigma_m = float(np.hypot(sigma_m, np.radians(sigma_deg) * np.linalg.norm(body_m)))


def damage_imu(rng: np.random.Generator, sky: Sky, inputs: Inputs) -> None:
    """The readings of a unit that stands."""
    rate = int(rng.choice([10, 50, 100]))
    t = np.arange(0.0, sky.seconds + 4.0, 1.0 / rate)
    force = np.tile([0.0, 0.0, -9.8], (t.size, 1)) + 0.02 * rng.standard_normal((t.size, 3))
    turn = 1e-3 * rng.standard_normal((t.size, 3))
    heads = ["time_s", *(f"accel_{a}_m_s2" for a in "xyz"), *(f"gyro_{a}_rad_s" for a in "xyz")]
    fault = str(
        rng.choice(
            [
                "ms",
                "us",
                "g",
                "deg/s",
                "axes",
                "sign",
                "up",
                "late",
                "gap",
                "slow",
                "nan",
                "twice",
                "noise",
                "names",
                "words",
                "cut",
                "bom",
                "semicolon",
                "back",
                "bias",
                "empty",
            ]
        )
    )
    if fault == "ms":
        t = t * 1e3
    if fault == "us":
        t = t * 1e6
    if fault == "g":
        force = force / 9.80665
    if fault == "deg/s":
        turn = np.degrees(turn)
    if fault == "axes":
        order = rng.permutation(3)
        force, turn = force[:, order], turn[:, order]
    if fault in ("sign", "up"):
        force = -force
        turn = turn if fault == "sign" else turn * [1.0, -1.0, -1.0]
    if fault == "late":
        t = t + float(rng.choice([-1e4, -20.0, 5.0, 1e4]))
    if fault == "gap":
        keep = (t < 5.0) | (t > 5.0 + float(rng.uniform(1.0, 15.0)))
        t, force, turn = t[keep], force[keep], turn[keep]
    if fault == "slow":
        every = int(rng.choice([10, 100, 10 * rate]))
        t, force, turn = t[::every], force[::every], turn[::every]
    if fault == "noise":
        force, turn = force + 5.0 * rng.standard_normal(force.shape), turn + 1.0 * rng.standard_normal(turn.shape)
    if fault == "bias":
        force, turn = force + rng.normal(size=3), turn + 0.3 * rng.normal(size=3)
    if fault == "back":
        t[t.size // 2 :] -= 3.0
    rows = [[f"{x:.6f}" for x in (a, *b, *c)] for a, b, c in zip(t, force, turn, strict=True)]
    if fault == "nan":
        for k in rng.integers(len(rows), size=max(len(rows) // 5, 1)):
            rows[k][int(rng.integers(1, 7))] = str(rng.choice(["", "nan", "inf"]))
    if fault == "twice":
        rows = [row for row in rows for _ in range(2)]
    if fault == "words":
        rows[len(rows) // 2][2] = "n/a"
    if fault == "names":
        heads = ["time", "ax", "ay", "az", "gx", "gy", "gz"]
    between = ";" if fault == "semicolon" else ","
    text = "\n".join([between.join(heads), *(between.join(row) for row in rows)]) + "\n"
    if fault == "cut":
        text = text[: int(rng.integers(len(text) // 3, len(text)))]
    if fault == "bom":
        text = "\ufeff" + text
    if fault == "empty":
        text = between.join(heads) + "\n"
    inputs.imu, inputs.damage = text, fault
    grade = str(rng.choice(["consumer", "industrial", "tactical"]))
    inputs.platform["imu"] = {"file": "imu.csv", "grade": grade}
    if rng.random() < 0.5:
        turned = {"heading_deg": float(rng.uniform(0.0, 360.0)), "pitch_deg": 0.0, "roll_deg": 0.0, "sigma_deg": 1.0}
        inputs.platform["imu"]["initial"] = turned
    inputs.named = (r"imu", r"inertial", r"accel", r"gyro", r"missing", r"readings", r"time_s", r"axes")


def damage_headers(rng: np.random.Generator, sky: Sky, inputs: Inputs) -> None:
    k = int(rng.integers(2))
    lines = inputs.obs[k]
    end = next(n for n, line in enumerate(lines) if "END OF HEADER" in line)
    types = [n for n in range(end) if "OBS TYPES" in lines[n] or "TYPES OF OBSERV" in lines[n]]
    fault = str(
        rng.choice(
            [
                "count",
                "names",
                "order",
                "again",
                "version",
                "position",
                "interval",
                "first",
                "label",
                "blank",
                "bom",
                "system",
                "no end",
                "scale",
            ]
        )
    )
    at = int(rng.choice(types))
    if fault == "count":
        counted = [n for n in types if re.match(r"[A-Z]? *\d+ ", lines[n][:7])]
        at = int(rng.choice(counted))
        by = int(rng.choice([-3, -1, 1, 2]))
        lines[at] = re.sub(
            r"^([A-Z]? *)(\d+)", lambda m: m[1] + f"{max(int(m[2]) + by, 0):{len(m[2])}d}", lines[at], count=1
        )
    if fault == "names":
        lines[at] = (
            lines[at][:6] + re.sub(r"\b([CLDS]\d)[A-Z]?\b", lambda m: m[1], lines[at][6:60]).ljust(54) + lines[at][60:]
        )
    if fault == "order":
        names = lines[at][6:60].split()
        rng.shuffle(names)
        width = 4 if float(lines[0][:9]) >= 3.0 else 6
        lines[at] = lines[at][:6] + "".join(f"{x:>{width}}" for x in names).ljust(54)[:54] + lines[at][60:]
    if fault == "again":
        starts = [n for n in range(end + 1, len(lines)) if lines[n][:1] == ">"] or [end + 1 + (len(lines) - end) // 2]
        middle = starts[len(starts) // 2]
        second = [x for x in lines[: end + 1]]
        if types:
            second[types[0]] = re.sub(r"C1C L1C", "L1C C1C", second[types[0]])
        lines[middle:middle] = second
    if fault == "version":
        lines[0] = str(rng.choice(["     2.11", "     3.02", "     4.00", "     9.99"])) + lines[0][9:]
    for label, text in (
        ("APPROX POSITION XYZ", f"{float(rng.normal() * 6e6):14.4f}{float(rng.normal() * 6e6):14.4f}{0.0:14.4f}"),
        ("INTERVAL", f"{float(rng.choice([0.0, 0.1, 30.0, -1.0])):10.3f}"),
        ("TIME OF FIRST OBS", "  1999     1     1     0     0    0.0000000     GPS"),
    ):
        if fault == label.split()[0].lower() or (fault, label[:6]) in (("position", "APPROX"), ("first", "TIME O")):
            lines[:] = [text.ljust(60) + x[60:] if x[60:].startswith(label) else x for x in lines]
    if fault == "label":
        lines[at] = lines[at][:60] + "SYS / # / OBS TYPE"
    if fault == "blank":
        lines.insert(int(rng.integers(1, end)), "")
    if fault == "bom":
        lines[0] = "\u00ef\u00bb\u00bf" + lines[0]
    if fault == "system":
        lines[at] = str(rng.choice(list("GERCJ"))) + lines[at][1:] if float(lines[0][:9]) >= 3.0 else lines[at]
    if fault == "no end":
        del lines[end]
    if fault == "scale":
        lines.insert(end, "G   10  2 C1C L1C".ljust(60) + "SYS / SCALE FACTOR")
    inputs.damage = fault
    inputs.named = (r"header", r"type", r"version", r"obs", r"left out", r"END OF", r"line \d+", r"marker|byte order")


def damage_epochs(rng: np.random.Generator, sky: Sky, inputs: Inputs) -> None:
    k = int(rng.integers(2))
    lines = inputs.obs[k]
    end = next(n for n, line in enumerate(lines) if "END OF HEADER" in line)
    new = float(lines[0][:9]) >= 3.0
    begins = re.compile(r">" if new else r" \d\d [ \d]\d [ \d]\d [ \d]\d [ \d]\d[ \d.]{11}  \d")
    starts = [n for n in range(end + 1, len(lines)) if begins.match(lines[n])]
    body = [lines[a:b] for a, b in zip(starts, [*starts[1:], len(lines)], strict=True)]
    fault = str(
        rng.choice(
            [
                "absent",
                "unreadable",
                "twice",
                "order",
                "digits",
                "cycles",
                "cut",
                "count",
                "flag",
                "date",
                "blank",
                "shifted",
                "lines lost",
                "late",
                "satellite",
                "dots",
            ]
        )
    )
    some = [n for n in range(len(body)) if rng.random() < float(rng.choice([0.1, 0.3, 0.6]))] or [len(body) // 2]
    cells = [(n, m) for n in some for m in range(1, len(body[n]))]
    if fault == "absent":
        body = [epoch for n, epoch in enumerate(body) if n not in some]
    if fault == "unreadable":
        for n in some:
            body[n][0] = body[n][0].replace(" ", "#", 3)
    if fault == "twice":
        body = [epoch for n, epoch in enumerate(body) for _ in range(2 if n in some else 1)]
    if fault == "order":
        n = int(rng.integers(len(body) - 1))
        body[n], body[n + 1] = body[n + 1], body[n]
    if fault in ("digits", "dots"):
        for n, m in cells:
            if rng.random() < 0.3 and len(body[n][m]) > 12:
                place = int(rng.integers(4, min(len(body[n][m]), 60)))
                new_one = str(rng.integers(10)) if fault == "digits" else str(rng.choice([".", "*", "-"]))
                body[n][m] = body[n][m][:place] + new_one + body[n][m][place + 1 :]
    if fault == "cycles" and new:
        for epoch in body[len(body) // 2 :]:
            for m in range(1, len(epoch)):
                if epoch[m][3:17].strip():
                    epoch[m] = epoch[m][:3] + f"{float(epoch[m][3:17]) / CARRIER_M:14.3f}" + epoch[m][17:]
    if fault == "count":
        for n in some:
            a, b = (32, 35) if new else (29, 32)
            number = body[n][0][a:b]
            if number.strip().isdigit():
                body[n][0] = (
                    body[n][0][:a] + f"{max(int(number) + int(rng.choice([-2, -1, 1, 3])), 0):3d}" + body[n][0][b:]
                )
    if fault == "flag":
        for n in some:
            a = 31 if new else 28
            body[n][0] = body[n][0][:a] + str(rng.choice(list("1345"))) + body[n][0][a + 1 :]
    if fault == "date":
        for n in some:
            body[n][0] = body[n][0][:2] + str(rng.choice(["19", "20", "99"])) + body[n][0][4:]
    if fault == "blank":
        for n, m in cells:
            if rng.random() < 0.3:
                body[n][m] = body[n][m][:3] if new else ""
    if fault == "shifted":
        for n, m in cells:
            body[n][m] = body[n][m][:3] + " " + body[n][m][3:]
    if fault == "lines lost":
        for n in some:
            body[n] = [x for m, x in enumerate(body[n]) if m == 0 or rng.random() > 0.3]
    if fault == "late":
        for n in some:
            a, b = (18, 29) if new else (15, 26)
            body[n][0] = (
                body[n][0][:a]
                + f"{(float(body[n][0][a:b]) + float(rng.uniform(-0.4, 0.4))) % 60:11.7f}"
                + body[n][0][b:]
            )
    if fault == "satellite" and new:
        for n, m in cells:
            if rng.random() < 0.2:
                body[n][m] = str(rng.choice(["G99", "X01", "g05", "E77"])) + body[n][m][3:]
    flat = [x for epoch in body for x in epoch]
    if fault == "cut":
        flat = flat[: int(rng.integers(len(flat) // 3, len(flat)))]
        flat[-1] = flat[-1][: int(rng.integers(1, max(len(flat[-1]), 2)))]
    inputs.obs[k] = lines[: starts[0]] + flat
    inputs.damage = fault
    inputs.named = (r"epoch", r"left out", r"line", r"cell", r"missing", r"satellite", r"number", r"time", r"common")


DAMAGES: Final = {
    "orbits": damage_orbits,
    "positions": damage_positions,
    "distances": damage_distances,
    "attitudes": damage_attitudes,
    "imu": damage_imu,
    "headers": damage_headers,
    "epochs": damage_epochs,
}

# ---------------------------------------------------------------------- runs


def said(inputs: Inputs) -> dict[str, Any]:
    """What a run says: its word, the codes of other causes, remarks on inputs, or the error that ended it."""
    with tempfile.TemporaryDirectory() as place:
        at = Path(place)
        paths = []
        for name, lines in zip(NAMES, inputs.obs, strict=False):
            (at / f"{name}.obs").write_text("\n".join(lines) + "\n", encoding="latin-1")
            paths.append(at / f"{name}.obs")
        (at / "nav.rnx").write_text("\n".join(inputs.nav) + "\n", encoding="latin-1")
        if inputs.imu is not None:
            (at / "imu.csv").write_text(inputs.imu, encoding="utf-8")
        options = dict(inputs.options)
        if "antennas_enu_m" in options:
            places = options["antennas_enu_m"].values()
            options["antennas_enu_m"] = dict(zip(NAMES, places, strict=True))
        platform = None
        if inputs.platform:
            table = dict(inputs.platform)
            if "receivers" in table:
                table["receivers"] = [
                    {"name": name, "inputs": [f"{name}.obs"], **item}
                    for name, item in zip(NAMES, table["receivers"], strict=False)
                ]
                paths = []
            platform = at / "platform.toml"
            platform.write_text(tomli_w.dumps(table), encoding="utf-8")
        try:
            verdict = protect(paths, nav=at / "nav.rnx", platform=platform, **options).verdict
        except SkyproofError as error:
            return {"word": "error", "codes": [], "remarks": [str(error)], "reason": "", "why": str(error)[:300]}
        except Exception as error:  # a fault of skyproof, which is counted as such
            return {"word": "crash", "codes": [], "remarks": [], "reason": "", "why": repr(error)[:300]}
        remarks = [str(remark) for item in verdict.inputs for remark in item.all_remarks]
        codes = [cause.code for cause in verdict.wrong_statements]
        why = (verdict.summary + " | " + " ".join(remarks))[:600]
        codes += verdict.may_also_be[:1]
        return {"word": verdict.verdict, "codes": codes, "remarks": remarks, "reason": verdict.reason or "", "why": why}


def clean_inputs(sky: Sky) -> Inputs:
    return Inputs(obs=[list(o) for o in sky.obs], nav=list(sky.nav), options=truth_options(sky))


@cache
def undamaged(name: str) -> dict[str, Any]:
    """What is said of a real sky as it is."""
    return said(clean_inputs(real(name)))


def row_of(name: str) -> Row:
    """A run of a name such as "orbits-17" or, without real files, "orbits-17-sim"."""
    kind, number, *rest = name.split("-")
    rng = np.random.default_rng([SEED, KINDS.index(kind), int(number)])
    skies = ("sim",) if rest else ("1m", "1m", "3km", "5km", "sim", "sim")
    which = str(rng.choice(skies))
    sky = simulated(rng) if which == "sim" else real(which)
    inputs = clean_inputs(sky)
    as_it_is = clean_inputs(sky)
    DAMAGES[kind](rng, sky, inputs)
    found = said(inputs)
    before = said(inputs.right or as_it_is) if inputs.right or which == "sim" else undamaged(which)
    known = {_without_path(remark) for remark in before["remarks"]}
    text = [*found["codes"], *(item for item in found["remarks"] if _without_path(item) not in known)]
    text += [found["reason"]] if kind in ("orbits", "imu") and found["reason"] != before["reason"] else []
    named = any(re.search(pattern, item, re.IGNORECASE) for pattern in inputs.named for item in text)
    return {
        "name": name,
        "kind": kind,
        "sky": which,
        "damage": inputs.damage,
        "word": found["word"],
        "undamaged": before["word"],
        "named": named,
        "off_m": round(inputs.off_m, 3),
        "sigmas": round(inputs.off_m / inputs.sigma_m, 1) if inputs.sigma_m else np.inf,
        "codes": found["codes"][:6],
        "why": found["why"],
    }


def _without_path(remark: str) -> str:
    return re.sub(r"\S*/\S*/", "", remark)


def attacked_row(name: str) -> Row:
    """A spoofed sky with a damaged auxiliary input: "attack-17"."""
    number = int(name.split("-")[1])
    rng = np.random.default_rng([SEED, 99, number])
    keys, ecef_m = scene_keys(rng)
    shows = tuple(float(x) for x in rng.normal(size=3) * [200.0, 200.0, 10.0])
    who = [NAMES, NAMES[:1], NAMES[1:]][int(rng.integers(3))]
    false = FalseSky(shows_enu_m=shows, receivers=who)
    free = tuple(one for one in NAMES if one not in who)
    attacked = MeasuredScene(**keys, sky=free, false=(false,))
    observations = attacked.records(rng).observations
    late = rng.random() < 0.5
    if late:  # from the middle on
        before = MeasuredScene(**keys).records(rng).observations
        observations = tuple(_switched(a, b) for a, b in zip(before, observations, strict=True))
    (one, two), nav = written(observations, attacked.navigation)
    sky = Sky(name="attack", obs=(one, two), nav=nav, ecef_m=ecef_m, sigma_m=0.02, seconds=float(EPOCHS))
    inputs = clean_inputs(sky)
    kind = str(rng.choice(KINDS))
    DAMAGES[kind](rng, sky, inputs)
    found = said(inputs)
    damage = f"{kind}: {inputs.damage}"
    return {"name": name, "kind": f"{'late' if late else 'whole'}, {len(who)} of 2", "damage": damage, **found}


def _switched(before: Observations, after: Observations) -> Observations:
    half = before.gpst.size // 2
    cells = {}
    for name in ("pseudorange_m", "carrier_cyc", "doppler_hz", "cn0_dbhz"):
        cells[name] = np.concatenate([getattr(before, name)[:half], getattr(after, name)[half:]])
    return Observations(
        receiver=before.receiver,
        signals=before.signals,
        gpst=before.gpst,
        elapsed_s=before.elapsed_s,
        pseudorange_sigma_m=before.pseudorange_sigma_m,
        carrier_sigma_cyc=before.carrier_sigma_cyc,
        doppler_sigma_hz=before.doppler_sigma_hz,
        status=before.status,
        found_elapsed_s=before.found_elapsed_s,
        missed_elapsed_s=before.missed_elapsed_s,
        **cells,
    )


# ---------------------------------------------------------------------- counts


def table(rows: Sequence[Row]) -> Iterator[str]:
    if rows and "undamaged" not in rows[0]:
        yield from _attacked(rows)
        return
    yield f"{'kind':10}{'runs':>6}{'spoofed':>9}{'crash':>7}{'error':>7}{'named':>7}{'harmless':>10}{'missed':>8}"
    for kind in (*KINDS, ""):
        matching = [row for row in rows if row["kind"] == kind or not kind]
        if matching:
            words = Counter(row["word"] for row in matching)
            named = sum(row["named"] for row in matching)
            harmless = sum(not row["named"] and is_harmless(row) for row in matching)
            yield (
                f"{kind or 'all':10}{len(matching):6}{words['spoofed']:9}{words['crash']:7}{words['error']:7}{named:7}"
                f"{harmless:10}{len(matching) - named - harmless:8}"
            )
    for row in rows:
        if row["word"] in ("spoofed", "crash"):
            yield f"  {row['name']} {row['sky']}, {row['damage']}: {row['word']}: {row['why'][:200]}"


def is_harmless(row: Row) -> bool:
    """Whether the word stays, and a statement is within three of its sigmas."""
    return row["word"] == row["undamaged"] and row["sigmas"] <= SIGMAS


def _attacked(rows: Sequence[Row]) -> Iterator[str]:
    for kind in sorted({row["kind"] for row in rows}):
        matching = [row for row in rows if row["kind"] == kind]
        yield f"{kind:20}{len(matching):4} {dict(Counter(row['word'] for row in matching))}"
    yield from (f"  {row['name']} {row['damage']}: {row['why'][:200]}" for row in rows if row["word"] == "authentic")


def main() -> None:
    """Run and print the counts."""
    parser = parser_of(__doc__)
    parser.add_argument("--draws", type=int, default=20, help="of each kind")
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), choices=KINDS)
    parser.add_argument("--attacks", type=int, default=0, help="spoofed skies in place of clean ones")
    parser.add_argument("--real", choices=("yes", "no"), default="yes")
    chosen = parser.parse_args()
    if chosen.attacks:
        rows = rows_of(chosen, [f"attack-{k}" for k in range(chosen.attacks)], attacked_row)
    else:
        end = "" if chosen.real == "yes" else "-sim"
        names = [f"{kind}-{k}{end}" for k in range(chosen.draws) for kind in chosen.kinds]
        rows = rows_of(chosen, names, row_of)
    print("\n".join(table(rows)))


if __name__ == "__main__":
    main()
