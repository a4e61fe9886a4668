"""A turning antenna whose arm is not what is stated, drawn: false alarms, and detection beside theory.

    python bench/arms.py --draws 300          counts
    python bench/arms.py --command 20         the zone around a satellite in which a false signal of it is not found,
                                              through files and the whole of `protect`: so many runs at each distance

Each is one window of 15 s, ten measurements a second (N = 150), of 7 to 10 satellites, an arm of half a wavelength that
turns once in 4 s and starts anywhere. Three false signals are shown beside the true ones: two from one direction, one
0.3 to 2 degrees from it. By pairs, at 1 %: how often those of one direction are called different, and how often the
near one is told from them, beside the chance by theory. By windows, as `protect` judges them: names right and wrong.
"""

import argparse
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import tomli_w

from skyproof.app.common.rinex import write_channels
from skyproof.app.protect import protect
from skyproof.arrays import Reals
from skyproof.detectors.array.spin import Levels, Spin, SpinSettings, estimate_levels
from skyproof.formats.rinex_nav import write_nav
from skyproof.gnss.constants import L1_HZ, SPEED_OF_LIGHT_M_S
from skyproof.gnss.orbits import compute_satellite_state_s
from skyproof.gnss.sky import compute_azimuth_elevation
from skyproof.gnss.time import week_and_tow
from skyproof.records import Records, SpinArm
from skyproof.statistics.directions import direction_cosines
from skyproof.statistics.distributions import chi_square_threshold, noncentral_chi_square_survival
from skyproof.testing import FalseSky, MeasuredScene, TrackErrors

RADIUS_M, RATE_HZ = 0.5 * SPEED_OF_LIGHT_M_S / L1_HZ, 0.25
N, STEP_S = 150, 0.1
FALSE = 3
PAIRS_ALPHA, WINDOWS_ALPHA = 0.01, 1e-4
OF_A_RUN = 1e-3 * N * STEP_S / 3600.0 / 6.0
"""What `protect` allows a window of so many seconds, by default and of one receiver."""
BESIDE_DEG = (2.0, 5.0, 10.0, 15.0, 20.0, 30.0)
CASES: dict[str, dict[str, Any]] = {
    "as stated": {},
    "rate wrong by 1 %": {"rate_share": 0.01},
    "wobble of 2 degrees": {"wobble_rad": np.radians(2.0)},
    "two slips": {"slips": 2},
    "all of these": {"rate_share": 0.01, "wobble_rad": np.radians(2.0), "slips": 2},
}


class DrawnArm:
    """A window by its number.

    records : its arm is as stated. towards : (n_signals, 3) directions, north, east, up; false : (n_signals,).
    beside_rad : so far from its satellite's direction comes one false signal, in place of the true one; off : (3,) by
    that.
    """

    def __init__(
        self,
        number: int,
        *,
        attack: bool = True,
        rate_share: float = 0.0,
        wobble_rad: float = 0.0,
        slips: int = 0,
        beside_rad: float | None = None,
    ) -> None:
        rng = np.random.default_rng([number, attack, 150])
        scene = MeasuredScene(
            antennas_enu_m={"rx1": (0.0, 0.0, 0.0)},
            false=(FalseSky(shows_enu_m=(*rng.uniform(-500.0, 500.0, 2), 0.0), delay_m=50.0),),
            epochs=N,
            step_s=STEP_S,
            errors=TrackErrors(1.0, 0.9),
            place_deg=(rng.uniform(-60.0, 60.0), rng.uniform(-180.0, 180.0), 50.0),
            max_satellites=int(rng.integers(7, 11)),
        )
        records = scene.records(rng)
        (o,) = records.observations
        n = len(o.signals) // 2
        false = n + rng.permutation(n)[: FALSE * attack]
        kept = np.r_[np.arange(n), false]
        self.towards = self._directions(rng, scene, records, kept[:n])
        if beside_rad is not None:  # one alone, and not its true one
            across = np.cross(self.towards[false[0] - n], rng.normal(size=3))
            near = self.towards[false[0] - n] + np.tan(beside_rad) * across / np.linalg.norm(across)
            near /= np.linalg.norm(near)
            self.off = near - self.towards[false[0] - n]
            kept = np.r_[np.delete(np.arange(n), false[0] - n), false[0]]
            self.towards = np.vstack([np.delete(self.towards[:n], false[0] - n, axis=0), near])
        self.false = kept >= n
        rate_rad_s = 2.0 * np.pi * RATE_HZ * (1.0 + rate_share * rng.choice([-1.0, 1.0]))
        arm_m = self._arm_m(rng, o.elapsed_s, rate_rad_s, wobble_rad)
        carrier = o.carrier_cyc[:, kept] - arm_m @ self.towards[: kept.size].T * L1_HZ / SPEED_OF_LIGHT_M_S
        for _ in range(slips):
            carrier[rng.integers(10, N - 10) :, rng.integers(kept.size)] += 0.5 * rng.choice([-2.0, -1.0, 1.0, 2.0])
        self.towards = self.towards[: kept.size]
        shape = o.carrier_cyc.shape
        cells = {
            name: value[:, kept]
            for name, value in vars(o).items()
            if isinstance(value, np.ndarray) and value.shape == shape and name != "carrier_cyc"
        }
        cells["cn0_dbhz"] = cells["cn0_dbhz"] + np.where(self.false, 3.0, 0.0)
        single = {name: getattr(o, name)[kept] for name in ("found_elapsed_s", "missed_elapsed_s", "carrier_hz")}
        part = replace(o, signals=tuple(o.signals[k] for k in kept), carrier_cyc=carrier, **cells, **single)
        arm = SpinArm(
            receiver="rx1",
            radius_m=RADIUS_M,
            rate_rad_s=2.0 * np.pi * RATE_HZ,
            rate_sigma_rad_s=2.0 * np.pi * RATE_HZ * rate_share,
        )
        self.records = replace(records, observations=(part,), sets=records.sets[:1], spin_arms=(arm,))

    def _directions(self, rng: np.random.Generator, scene: MeasuredScene, records: Records, true: Any) -> Reals:
        """Of the true signals, then twice that of the transmitter, then that of another near it."""
        week, tow_s = week_and_tow(scene.start_gpst)
        angles = []
        for k in true:
            orbit = records.navigation.best(records.observations[0].signals[k].sat, scene.start_gpst)
            where = compute_satellite_state_s(orbit, week, tow_s).position_ecef_m
            angles.append(compute_azimuth_elevation(records.sets[0].position_ecef_m, where))
        azimuth, elevation = rng.uniform(0.0, 2.0 * np.pi), np.radians(rng.uniform(5.0, 40.0))
        off, turned = np.radians(rng.uniform(0.3, 2.0)), rng.uniform(0.0, 2.0 * np.pi)
        near = azimuth + off * np.cos(turned) / np.cos(elevation), elevation + off * np.sin(turned)
        angles += [(azimuth, elevation)] * (FALSE - 1) + [near]
        return direction_cosines(*np.array(angles).T)

    def _arm_m(self, rng: np.random.Generator, elapsed_s: Reals, rate_rad_s: float, wobble_rad: float) -> Reals:
        """(N, 3) north, east, up: the arm turns clockwise in a plane that is inclined, and whose incline swings."""
        angle = rng.uniform(0.0, 2.0 * np.pi) + rate_rad_s * elapsed_s
        axis, swing_hz, swings = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.05, 1.0), rng.uniform(0.0, 2.0 * np.pi)
        incline = np.cos(angle - axis) + np.cos(2.0 * np.pi * swing_hz * elapsed_s + swings)
        return RADIUS_M * np.column_stack([np.cos(angle), np.sin(angle), wobble_rad * incline])

    def levels(self) -> Levels:
        """As the detector finds them."""
        found = estimate_levels(self.records.observations[0], self.records.spin_arms[0])
        assert found is not None
        return found


def report() -> Iterator[str]:
    """Rows of the table of `make bench`: few draws, for the counts of a run of its own."""
    yield from table(draws=20)


def table(draws: int) -> Iterator[str]:
    """Counts of each case."""
    yield f"a turning arm, N = {N}, {draws} windows of each kind"
    for name, how in CASES.items():
        yield f"  {name}"
        yield f"    {_pairs(draws, how)}"
        for attack in (True, False):
            yield f"    {'attacked' if attack else 'clean'}: {_windows(draws, attack, how)}"


def _pairs(draws: int, how: dict[str, Any]) -> str:
    limit = float(chi_square_threshold(PAIRS_ALPHA, 2))
    apart = np.zeros(2, int)
    chance = []
    for number in range(draws):
        drawn = DrawnArm(number, **how)
        seen = drawn.levels()
        first, other, near = np.flatnonzero(drawn.false)
        inverse = np.linalg.inv(2.0 * seen.covariance)
        for kind, (a, b) in enumerate(((first, other), (first, near))):
            difference = seen.level[a] - seen.level[b]
            apart[kind] += difference @ inverse @ difference > limit
        true = (drawn.towards[first] - drawn.towards[near])[:2]
        chance.append(float(noncentral_chi_square_survival(limit, 2, true @ inverse @ true)))
    same, told = apart / draws
    sigma = np.sqrt(np.array([PAIRS_ALPHA * (1.0 - PAIRS_ALPHA), np.mean(chance) * (1.0 - np.mean(chance))]) / draws)
    return (
        f"one direction called two {same:.4f} (0.01 +- {sigma[0]:.4f}), two told apart {told:.3f} "
        f"({np.mean(chance):.3f} +- {sigma[1]:.3f} by theory)"
    )


def dead_zone(draws: int) -> Iterator[str]:
    """By distance from its satellite: how often a false signal is named, and a true one."""
    yield f"one false signal beside its satellite, N = {N}, {draws} runs each through RINEX and the command"
    for beside_deg in BESIDE_DEG:
        named, true, power = 0, 0, []
        for number in range(draws):
            drawn = DrawnArm(number, beside_rad=np.radians(beside_deg))
            with TemporaryDirectory() as folder:
                given = _labels(Path(folder), drawn)
            (false,) = np.flatnonzero(drawn.false)
            o = drawn.records.observations[0]
            named += given.get(o.signals[false].sat) == "spoofed"
            true += sum(given.get(o.signals[k].sat) == "spoofed" for k in np.flatnonzero(~drawn.false))
            power.append(_power(drawn))
        yield f"  {beside_deg:4g} degrees: named {named / draws:.2f} ({np.mean(power):.2f} by theory), true ones {true}"


def _labels(folder: Path, drawn: DrawnArm) -> dict[str, str]:
    """Of each satellite, after the whole command; a window is the whole run."""
    (o,) = drawn.records.observations
    write_channels(folder / "rx1.obs", o, "drawn", None, o.signals)
    write_nav(folder / "nav.rnx", drawn.records.navigation)
    table = {"name": "rx1", "inputs": ["rx1.obs"], "spin": {"radius_m": RADIUS_M, "rate_hz": RATE_HZ}}
    settings = {"window_s": N * STEP_S}
    (folder / "platform.toml").write_text(tomli_w.dumps({"receivers": [table], "protect": settings}))
    result = protect(platform=folder / "platform.toml", nav=folder / "nav.rnx")
    return {one.sat: one.label for one in result.verdict.signals}


def _power(drawn: DrawnArm) -> float:
    """Of the chi-square test of one signal by what the detector takes for its errors, with all others known exactly."""
    wavelength_m = SPEED_OF_LIGHT_M_S / L1_HZ
    white = np.trace(drawn.levels().covariance) / 2.0
    variance = white + (SpinSettings().lasting_sigma_cyc * wavelength_m / RADIUS_M) ** 2
    limit = float(chi_square_threshold(OF_A_RUN / len(drawn.false), 2))
    return float(noncentral_chi_square_survival(limit, 2, np.sum(drawn.off[:2] ** 2) / variance))


def _windows(draws: int, attack: bool, how: dict[str, Any]) -> str:
    detector = Spin(SpinSettings(false_alarm_probability=WINDOWS_ALPHA))
    count: Counter[str] = Counter()
    for number in range(draws):
        drawn = DrawnArm(number, attack=attack, **how)
        signals = drawn.records.observations[0].signals
        findings = {ref.signal: item.says for item in detector.examine(drawn.records)[0] for ref in item.signals}
        for signal, false in zip(signals, drawn.false, strict=True):
            count[f"{'false' if false else 'true'} {findings.get(signal, 'nothing')}"] += 1
    return str(dict(sorted(count.items())))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=300)
    parser.add_argument("--command", type=int, default=0)
    chosen = parser.parse_args()
    for row in dead_zone(chosen.command) if chosen.command else table(chosen.draws):
        print(row, flush=True)
