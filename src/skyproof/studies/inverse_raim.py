"""Studies of inverse RAIM, the second half of the paper on decomposition (Ahmed, Khanafseh, Pervan)."""

import time
from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.dccaf.inverse_raim import find_passing_sets
from skyproof.gnss.frames import ecef_from_geodetic, geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.orbits import compute_satellite_state_s
from skyproof.gnss.sky import compute_unit_vectors
from skyproof.gnss.time import week_and_tow
from skyproof.report.chart import Axes
from skyproof.studies.base import Claim, Row, Study, StudySettings, value_of
from skyproof.studies.inverse_raim_choice import inverse_raim

__all__ = ["STUDIES"]

PAPER: Final = "Ahmed, Khanafseh, Pervan, decomposition of the cross-ambiguity function with inverse RAIM and inertia"
_DIRECTION_ENU: Final = np.array([1.0, 0.0, 1.0]) * np.sqrt(0.5)
_START: Final = np.datetime64("2022-01-01T00:00:00", "ns")
_MASK_DEG: Final = 7.0
_MOST_GDOP: Final = 10.0
_PRUNED_REPEATS: Final = 20


def sets(settings: StudySettings) -> Iterator[Row]:
    """Count which choices of one signal per satellite pass at 0.1 %, and how fast.

    attack "position": the false fix lies up-east; "time": all false signals are late by as much. With three signals the
    third is anywhere within 300 m. Satellites are those of the nominal constellation at places and times by chance.
    """
    rng = settings.rng()
    skies = _Skies(rng)
    for satellites, signals in ((6, 2), (6, 3), (8, 2), (12, 2), (12, 3)):
        yield _time_sets(satellites, signals, skies, rng, settings.count(60, 15))
    trials = settings.count(1000, 100)
    for satellites in (6, 8):
        for sigma_m in (1.0, 3.0):
            for offset_m in (10.0, 30.0, 60.0, 100.0, 300.0):
                yield _count_sets("position", satellites, sigma_m, offset_m, skies, rng, trials)
    for offset_m in (10.0, 30.0, 100.0):
        yield _count_sets("time", 7, 3.0, offset_m, skies, rng, trials)


class _Skies:
    """Unit vectors, east, north, up, to satellites above the mask, anywhere and at any time."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._seen: list[Reals] = []
        for _ in range(120):
            when = _START + np.timedelta64(int(rng.integers(86_400)), "s")
            place = ecef_from_geodetic(np.arcsin(rng.uniform(-1.0, 1.0)), rng.uniform(-np.pi, np.pi), 0.0)
            week, tow_s = week_and_tow(when)
            orbits = make_nominal_constellation(when).ephemerides
            ecef_m = np.stack([compute_satellite_state_s(orbit, week, tow_s).position_ecef_m for orbit in orbits])
            units = compute_unit_vectors(place, ecef_m) @ rot_enu_ecef(*geodetic_from_ecef(place)[:2]).T
            self._seen.append(units[units[:, 2] > np.sin(np.radians(_MASK_DEG))])

    def some(self, satellites: int) -> Reals:
        """Draw (n, 3) of as many satellites from one sky, in a geometry that a receiver would use."""
        while True:
            seen = self._seen[self._rng.integers(len(self._seen))]
            if len(seen) < satellites:
                continue
            units = seen[self._rng.permutation(len(seen))[:satellites]]
            design = np.concatenate((-units, np.ones((satellites, 1))), axis=1)
            normal = design.T @ design
            if np.linalg.det(normal) > 1e-6 and np.trace(np.linalg.inv(normal)) < _MOST_GDOP**2:
                return units


def _misfits(
    units: Reals, signals: int, sigma_m: float, offset_m: float, attack: str, rng: np.random.Generator
) -> Reals:
    """Draw misfits (n, signals): true, false, and any."""
    misfit = sigma_m * rng.standard_normal((len(units), signals))
    misfit[:, 1] += offset_m if attack == "time" else -offset_m * (units @ _DIRECTION_ENU)
    if signals > 2:
        misfit[:, 2:] += rng.uniform(-300.0, 300.0, (len(units), signals - 2))
    return misfit


def _time_sets(satellites: int, signals: int, skies: _Skies, rng: np.random.Generator, repeats: int) -> Row:
    took: dict[bool, list[float]] = {True: [], False: []}
    same, passing = True, []
    for repeat in range(repeats + 1):
        units = skies.some(satellites)
        misfit = _misfits(units, signals, 1.0, 100.0, "position", rng)
        found = {}
        for exhaustive in (True, False):
            found[exhaustive] = find_passing_sets(units, misfit, 1.0, exhaustive=exhaustive)
            begin = time.process_time()
            for _ in range(1 if exhaustive else _PRUNED_REPEATS):
                find_passing_sets(units, misfit, 1.0, exhaustive=exhaustive)
            spent_s = time.process_time() - begin
            if repeat:  # the first call loads the compiled kernel
                took[exhaustive].append(spent_s / (1 if exhaustive else _PRUNED_REPEATS))
        same &= set(map(tuple, found[True].choice)) == set(map(tuple, found[False].choice))
        passing.append(len(found[False].statistic))
    return _row(
        satellites=satellites,
        signals=signals,
        sets=signals**satellites,
        attack="position",
        sigma_m=1.0,
        offset_m=100.0,
        ms_exhaustive=1e3 * float(np.median(took[True])),
        ms_pruned=1e3 * float(np.median(took[False])),
        same_sets=same,
        passing=float(np.mean(passing)),
        trials=repeats,
    )


def _count_sets(
    attack: str, satellites: int, sigma_m: float, offset_m: float, skies: _Skies, rng: np.random.Generator, trials: int
) -> Row:
    mixed, pure, groups, pairs, clocks = [], [], [], [], []
    for _ in range(trials):
        units = skies.some(satellites)
        found = inverse_raim(units, _misfits(units, 2, sigma_m, offset_m, attack, rng), sigma_m)
        is_pure = np.isin(found.sets.choice.sum(axis=1), (0, satellites))
        mixed.append(int(np.sum(~is_pure)))
        pure.append(bool(is_pure.size > 1 and is_pure[:2].all()))
        groups.append(len(found.leader))
        pairs.append(found.pair is not None and bool(is_pure[list(found.pair)].all()))
        clocks.append(found.timing_only)
    return _row(
        satellites=satellites,
        signals=2,
        sets=2**satellites,
        attack=attack,
        sigma_m=sigma_m,
        offset_m=offset_m,
        mixed_passing=float(np.mean(mixed)),
        two_smallest_pure=float(np.mean(pure)),
        clusters=float(np.mean(groups)),
        pair_is_pure=float(np.mean(pairs)),
        timing_only=float(np.mean(clocks)),
        passing=None,
        trials=trials,
    )


def _row(**values: Any) -> Row:
    names = (
        "satellites",
        "signals",
        "sets",
        "attack",
        "sigma_m",
        "offset_m",
        "ms_exhaustive",
        "ms_pruned",
        "same_sets",
        "passing",
        "mixed_passing",
        "two_smallest_pure",
        "clusters",
        "pair_is_pure",
        "timing_only",
        "trials",
    )
    return {name: values.get(name) for name in names}


_SIX: Final[dict[str, Any]] = {"satellites": 6, "attack": "position", "offset_m": 100.0}
STUDIES: tuple[Study, ...] = (
    Study(
        name="inverse-raim.sets",
        title="Which sets of signals fit one position",
        paper=PAPER,
        figure="Figures 9 and 13",
        run=sets,
        charts=(
            Axes(
                title="Mixed sets that pass at 0.1 %",
                x="offset_m",
                y="mixed_passing",
                x_label="offset, m",
                y_label="mean number",
                by=("satellites", "sigma_m"),
                where={"attack": "position"},
                x_log=True,
                y_log=True,
            ),
            Axes(
                title="The two smallest residuals are the true and the false set",
                x="offset_m",
                y="two_smallest_pure",
                x_label="offset, m",
                y_label="share",
                by=("satellites", "sigma_m"),
                where={"attack": "position"},
                x_log=True,
            ),
        ),
        claims=(
            Claim(
                what="mixed sets that pass, 6 satellites, 1 m, 100 m",
                paper="none",
                reference=1.0,
                same=value_of("mixed_passing", sigma_m=1.0, **_SIX),
            ),
            Claim(
                what="two smallest residuals pure, the same",
                paper="always",
                reference=0.75,
                same=value_of("two_smallest_pure", sigma_m=1.0, **_SIX),
                better=value_of("pair_is_pure", sigma_m=1.0, **_SIX),
            ),
            Claim(
                what="mixed sets that pass, 6 satellites, 3 m, 100 m",
                paper="none",
                reference=4.8,
                same=value_of("mixed_passing", sigma_m=3.0, **_SIX),
            ),
            *(
                Claim(
                    what=f"{name} sets, ms (better: branch and bound)",
                    paper="not stated",
                    reference=reference,
                    same=value_of("ms_exhaustive", satellites=satellites, signals=signals),
                    better=value_of("ms_pruned", satellites=satellites, signals=signals),
                )
                for name, satellites, signals, reference in (
                    ("2^6", 6, 2, "not timed"),
                    ("2^12", 12, 2, 0.07),
                    ("3^12", 12, 3, 12.0),
                )
            ),
            Claim(
                what="the same sets by both searches, 3^12",
                paper="not stated",
                reference=1.0,
                tolerance=0.0,
                better=value_of("same_sets", satellites=12, signals=3),
            ),
            Claim(
                what="numbers of the two passing sets of figure 9",
                paper="6 and 59 of 64",
                reference="complements, "
                "5 + 58 = 63 counted from 0: the numbering is not given, and the almanac's sky is not available",
            ),
        ),
    ),
)
