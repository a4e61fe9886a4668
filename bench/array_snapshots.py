"""Snapshots of an array at the level of correlators: false alarms, p-values and directions, by the thousand.

    python bench/array_snapshots.py --draws 2000                       24 antennas, clean: words of array_common
    python bench/array_snapshots.py --draws 500 --antennas 7 --orbits  words and p-values of ins_array too
    python bench/array_snapshots.py --draws 300 --antennas 7 --attacks directions of one transmitter over their sigma

Of 24 antennas whose lines are not known `ins_array` takes seconds a draw, `array_common` a hundredth.

Each draw has what a sum over `PARTS` stretches of 16 ms leaves on every antenna: the phase of each signal with the
noise of its C/N0, true antenna positions some millimetres off, lines of any delay. Geometry and sky stay for a batch,
what is drawn anew is noise, lines, positions, attitude error and, of an attack, where it comes from.
"""

import argparse
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from arrays import off_sigma
from scipy.spatial.transform import Rotation
from scipy.stats import kstest

from skyproof.arrays import Reals
from skyproof.detectors.array.array_common import ArrayCommon, ArrayCommonSettings
from skyproof.detectors.array.array_model import predict_directions
from skyproof.detectors.array.ins_array import InsArray, InsArraySettings
from skyproof.explain import stands_beside
from skyproof.gnss.constants import L1_HZ, SPEED_OF_LIGHT_M_S
from skyproof.gnss.frames import attitude_ecef, ecef_from_geodetic, rot_enu_ecef
from skyproof.records import ArrayPhases, NavState, Records
from skyproof.statistics.directions import direction_cosines
from skyproof.testing import FalseSky, MeasuredScene, TrackErrors

WAVE_M = SPEED_OF_LIGHT_M_S / L1_HZ
PARTS, PART_S = 4, 0.016
POSITION_SIGMA_M = 0.003
TILT_RAD = np.radians(0.2)
BATCH = 100


class Geometry:
    """An array under a sky. elements_m : (n_antennas, 3)."""

    def __init__(self, number: int, antennas: int, *, attack: bool) -> None:
        rng = np.random.default_rng([number, antennas, 24])
        lat_deg, lon_deg = rng.uniform(-65.0, 65.0), rng.uniform(-180.0, 180.0)
        self.lat_lon = np.radians((lat_deg, lon_deg))
        self.scene = MeasuredScene(
            antennas_enu_m={"array": (0.0, 0.0, 0.0)},
            false=(FalseSky(shows_enu_m=(500.0, 300.0, 0.0)),) * attack,
            epochs=PARTS,
            step_s=PART_S,
            errors=TrackErrors(1.0, 0.9, 0.7),
            place_deg=(lat_deg, lon_deg, 50.0),
            max_satellites=int(rng.integers(7, 13)),
        )
        self.records = self.scene.records(rng)
        (self.o,) = self.records.observations
        self.false = np.array([s.copy == "b" for s in self.o.signals])
        place_ecef_m = np.tile(ecef_from_geodetic(*self.lat_lon, 50.0), (2, 1))
        angles = np.array([rng.uniform(0.0, 2.0 * np.pi), *np.radians(rng.uniform(-10.0, 10.0, 2))])
        self.attitude = attitude_ecef(place_ecef_m, *np.tile(angles[:, None], 2))
        gpst = np.array([self.o.gpst[0] - np.timedelta64(1, "s"), self.o.gpst[-1] + np.timedelta64(1, "s")])
        self.state = NavState(
            gpst=gpst, position_ecef_m=place_ecef_m, velocity_ecef_m_s=np.zeros((2, 3)), attitude=self.attitude
        )
        side = int(np.ceil(np.sqrt(antennas)))
        grid = np.array([(k // side, k % side, 0.0) for k in range(antennas)])
        self.elements_m: Reals = grid * rng.uniform(0.5, 0.8) * WAVE_M
        cn0_hz = 10.0 ** (0.1 * (self.o.cn0_dbhz - rng.uniform(0.0, 8.0, len(self.o.signals))))
        sigma_cyc = 1.0 / np.sqrt(2.0 * PART_S * cn0_hz) / (2.0 * np.pi)
        self.phases = ArrayPhases(
            receiver="array",
            signals=self.o.signals,
            gpst=self.o.gpst,
            elapsed_s=self.o.elapsed_s,
            elements_m=self.elements_m,
            phase_cyc=np.zeros((*cn0_hz.shape, antennas)),
            sigma_cyc=np.repeat(sigma_cyc[..., None], antennas, axis=2),
            calibrated=False,
            elements_sigma_m=POSITION_SIGMA_M,
        )
        self.towards = predict_directions(self.phases, self.state, self.scene.navigation)

    def drawn(self, rng: Any) -> tuple[Records, Reals]:
        """One draw, and from where its false signals come, east, north, up."""
        source = direction_cosines(rng.uniform(0.0, 2.0 * np.pi), np.radians(rng.uniform(0.0, 60.0)))[[1, 0, 2]]
        towards = self.towards.copy()
        towards[:, self.false] = source @ rot_enu_ecef(*self.lat_lon) @ self.attitude[0]
        shape = self.phases.phase_cyc.shape
        wrong_m = self.elements_m + POSITION_SIGMA_M * rng.standard_normal(self.elements_m.shape)
        phase = towards @ wrong_m.T / WAVE_M + self.phases.sigma_cyc * rng.standard_normal(shape)
        phase += rng.random((*shape[:2], 1)) + rng.random(shape[2])
        turned = Rotation.from_rotvec(TILT_RAD * rng.standard_normal(3)).as_matrix() @ self.attitude
        covariance = np.tile(np.diag(np.repeat([1.0, 1.0, TILT_RAD**2], 3)), (2, 1, 1))
        made = replace(self.phases, phase_cyc=phase - np.floor(phase))
        state = replace(self.state, attitude=turned, covariance=covariance)
        return replace(self.records, array_phases=(made,), nav_state={made.receiver: state}), source


def clean(draws: int, antennas: int, *, orbits: bool, alpha: float = 0.01) -> Iterator[str]:
    """Words of a clean sky, each detector at a false-alarm probability that can be counted, and p-values."""
    count: Counter[str] = Counter()
    p_values: list[float] = []
    begin = time.process_time()
    ins = InsArray(InsArraySettings(false_alarm_probability=alpha))
    common = ArrayCommon(ArrayCommonSettings(false_alarm_probability=alpha))
    for number in range(draws):
        if number % BATCH == 0:
            sky = Geometry(number // BATCH, antennas, attack=False)
            rng = np.random.default_rng([number, antennas])
        records, _ = sky.drawn(rng)
        count.update(f"array_common {word}" for word in {e.says for e in common.examine(records)[0]})
        if not orbits:
            continue
        findings = [e for e in ins.examine(records)[0] if not stands_beside(e)]
        count.update(f"ins_array {word}" for word in {e.says for e in findings})
        view = ins.view_from(
            records.array_phases[0], records.nav_state[records.array_phases[0].receiver], sky.scene.navigation
        )
        p_values.append(view.agreed.p_value)
    took_s = (time.process_time() - begin) / draws
    yield f"clean, {antennas} antennas, {draws} draws at {alpha:g}, {took_s:.2f} s each: {dict(sorted(count.items()))}"
    if p_values:
        p = np.array(p_values)
        low = ", ".join(f"{np.mean(p < x):.4f} below {x:g}" for x in (0.01, 0.1, 0.5, 0.9))
        yield f"  p-values of the joint test: {low}; uniform: {kstest(p, 'uniform').pvalue:.2g}"


def attacked(draws: int, antennas: int) -> Iterator[str]:
    """Directions of one transmitter over their sigma, and wrong words."""
    count: Counter[str] = Counter()
    off: list[float] = []
    ins = InsArray(InsArraySettings(false_alarm_probability=1e-6))
    for number in range(draws):
        if number % BATCH == 0:
            sky = Geometry(number // BATCH, antennas, attack=True)
            rng = np.random.default_rng([number, antennas, 1])
        records, source = sky.drawn(rng)
        false = {s for s, is_false in zip(sky.o.signals, sky.false, strict=True) if is_false}
        for e in ins.examine(records)[0]:
            subject = {ref.signal for ref in e.signals}
            if stands_beside(e):
                continue
            count[f"{e.says}, {'false' if subject <= false else 'true' if not subject & false else 'both'}"] += 1
            if e.says == "spoofed" and e.directions:
                off.append(min(off_sigma(d, source) for d in e.directions))
    yield f"attacks, {antennas} antennas, {draws} draws: {dict(sorted(count.items()))}"
    squares = np.array(off) ** 2
    yield (
        f"  directions over sigma: {len(off)}, median {np.sqrt(np.median(squares)):.2f} (1.18), beyond 3.03 (1 %): "
        f"{np.mean(squares > 9.21):.3f}"
    )


def report() -> Iterator[str]:
    """Rows of the table of `make bench`: few, for the counts of a run of its own."""
    yield from clean(100, 24, orbits=False)


def main() -> None:
    """Counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=2000)
    parser.add_argument("--antennas", type=int, default=24)
    parser.add_argument("--attacks", action="store_true")
    parser.add_argument("--orbits", action="store_true")
    options = parser.parse_args()
    rows = (
        attacked(options.draws, options.antennas)
        if options.attacks
        else clean(options.draws, options.antennas, orbits=options.orbits)
    )
    for row in rows:
        print(row, flush=True)


if __name__ == "__main__":
    main()
