"""Tens of milliseconds of many antennas, drawn: what is named, what wrongly, in what time and memory.

    python bench/snapshots.py --clean 100 --attacks 60          counts; --first 200 goes on elsewhere
    python bench/snapshots.py --only 17 --antennas 24           all that is said of one
    python bench/snapshots.py --kind alone --attacks 20         of another kind; see KINDS

Each is 64 ms of one-bit real samples, made here from a drawn sky (place, time, attitude, line delays; array of half a
wavelength's spacing and more) and judged as `protect` does, with orbits and without. The code of a satellite reaches
all antennas at once, and its carrier with the phase of the antenna. An attack shows another place from one direction,
for some or all satellites. A wrong word is a true signal called spoofed or a false one called authentic; of a true and
a false signal that are received as one, since they lie within a chip, neither word is wrong.
"""

import argparse
import resource
import time
from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from skyproof.app.common.progress import Silent
from skyproof.app.common.settings import Settings
from skyproof.app.protect.judging import judge
from skyproof.app.receive.short import observe_short
from skyproof.arrays import Floats, Reals
from skyproof.explain import explain
from skyproof.gnss.constants import L1_HZ, SPEED_OF_LIGHT_M_S
from skyproof.gnss.frames import attitude_ecef, ecef_from_geodetic, rot_enu_ecef
from skyproof.gnss.signals import GPS_L1_CA, prn_of
from skyproof.navigation.ranges import correct_ranges
from skyproof.records import AntennaArray, Observations, Samples
from skyproof.statistics.directions import direction_cosines
from skyproof.testing import FalseSky, MeasuredScene, TrackErrors

WAVE_M = SPEED_OF_LIGHT_M_S / L1_HZ
CHIP_M = SPEED_OF_LIGHT_M_S / GPS_L1_CA.chip_rate_hz
TRUTH = {False: "true", True: "false"}
DURATION_S = 0.064
STEP_S = 0.02


KINDS = {
    "": "as above",
    "alone": "of an attack: the true signals are not received, and all satellites imitated",
    "two": "of an attack: each signal from one of two transmitters",
    "one": "of an attack: one satellite is imitated",
    "frequency": "the intermediate frequency is stated 1.5 kHz off",
    "gains": "antennas that receive all up to 15 dB weaker",
    "tone": "a tone up to 25 dB stronger than the noise",
    "begins": "of an attack: it begins within the snapshot, with 0.25 to 0.8 of it over",
    "lies": "of an attack: it begins so, upon the true signals: within half a chip of them",
}


class DrawnSnapshot:
    """A snapshot by its number. false : (n_signals,). samples : of all antennas; array : where they are."""

    def __init__(
        self,
        number: int,
        *,
        attack: bool,
        antennas: int | None = None,
        rate_hz: float = 4.092e6,
        kind: str = "",
        duration_s: float = DURATION_S,
    ) -> None:
        self.kind, self.duration_s = kind, duration_s
        rng = np.random.default_rng([number, attack, 64])
        count = antennas or int(rng.choice([4, 7, 12, 24]))
        self.power_db = float(rng.uniform(-3.0, 12.0))
        lat_deg, lon_deg = rng.uniform(-65.0, 65.0), rng.uniform(-180.0, 180.0)
        shows_m = (*rng.uniform(-1e3, 1e3, 2), rng.uniform(-20.0, 20.0))
        delay_m = rng.uniform(-1e3, 1e3)
        if kind == "lies":
            shows_m, delay_m = (shows_m[0] / 20.0, shows_m[1] / 20.0, shows_m[2]), delay_m / 20.0
        scene = MeasuredScene(
            antennas_enu_m={"array": (0.0, 0.0, 0.0)},
            false=(FalseSky(shows_enu_m=shows_m, delay_m=delay_m),) * attack,
            epochs=5,
            step_s=STEP_S,
            errors=TrackErrors(1.0, 0.9, 0.7),
            place_deg=(lat_deg, lon_deg, 50.0),
            max_satellites=int(rng.integers(7, 13)),
        )
        self.navigation = scene.navigation
        (o,) = scene.records(rng).observations
        false = np.array([s.copy == "b" for s in o.signals])
        sats = sorted({s.sat for s in o.signals})
        copied = set(rng.choice(sats, rng.integers(1, len(sats) + 1), replace=False)) if attack else set()
        if attack and kind:
            copied = {"alone": set(sats), "one": {sats[0]}}.get(kind, copied)
        kept = np.array([s.sat in copied if s.copy == "b" else kind != "alone" or not attack for s in o.signals])
        self.signals = [s for s, there in zip(o.signals, kept, strict=True) if there]
        self.false = false[kept]
        place_ecef_m = np.tile(ecef_from_geodetic(*np.radians((lat_deg, lon_deg)), 50.0), (1, 1))
        angles = np.array([rng.uniform(0.0, 2.0 * np.pi), *np.radians(rng.uniform(-10.0, 10.0, 2))])
        body = attitude_ecef(place_ecef_m, *angles[:, None])[0]
        side = int(np.ceil(np.sqrt(count)))
        grid = np.array([(k // side, k % side, 0.0) for k in range(count)])
        elements_m = grid * rng.uniform(0.5, 0.8) * WAVE_M @ Rotation.random(rng=rng).as_matrix().T
        ranges = correct_ranges(o.signals, o.gpst[:1], o.pseudorange_m[:1], self.navigation)
        to_sats = ranges.satellite_ecef_m[0] - place_ecef_m[0]
        towards = (to_sats / np.linalg.norm(to_sats, axis=1, keepdims=True))[kept]
        source = direction_cosines(rng.uniform(0.0, 2.0 * np.pi), np.radians(rng.uniform(0.0, 40.0)))[[1, 0, 2]]
        towards[self.false] = source @ rot_enu_ecef(*np.radians((lat_deg, lon_deg)))
        if kind == "two":
            other = direction_cosines(rng.uniform(0.0, 2.0 * np.pi), np.radians(rng.uniform(0.0, 40.0)))[[1, 0, 2]]
            towards[np.flatnonzero(self.false)[::2]] = other @ rot_enu_ecef(*np.radians((lat_deg, lon_deg)))
        true_m = elements_m + 0.002 * rng.standard_normal(elements_m.shape)
        phase_cyc = towards @ body @ true_m.T / WAVE_M + rng.random(count)  # and line delays
        self.phase_cyc = phase_cyc
        self.delay_m = o.pseudorange_m[0, kept]
        self.array = AntennaArray(elements_m=elements_m, sigma_m=0.003)
        planes = self._planes(rng, o, np.flatnonzero(kept), phase_cyc, rate_hz)
        if_hz = rate_hz / 4.0 + (1500.0 if kind == "frequency" else 0.0)
        self.samples = _recording(
            planes, rate_hz, if_hz, o.gpst[0] + np.timedelta64(round(rng.uniform(-30.0, 30.0)), "s")
        )

    def _planes(
        self, rng: np.random.Generator, o: Observations, columns: Any, phase_cyc: Reals, rate_hz: float
    ) -> Floats:
        """(n_antennas, n) signs."""
        n = round(self.duration_s * rate_hz)
        begin = rng.uniform(0.25, 0.8) * self.duration_s if self.kind in ("begins", "lies") else 0.0
        t = np.arange(n) / rate_hz
        label_s = (o.gpst[0].astype("datetime64[ns]").astype(np.int64) % 1_000_000) * 1e-9
        waves = np.empty((columns.size, n), np.complex64)
        for row, column in enumerate(columns):
            signal, doppler_hz = o.signals[column], float(np.mean(o.doppler_hz[:, column]))
            shown_s = label_s - o.pseudorange_m[0, column] / SPEED_OF_LIGHT_M_S
            chips = (shown_s + t * (1.0 + doppler_hz / L1_HZ)) * GPS_L1_CA.chip_rate_hz
            code = GPS_L1_CA.code(prn_of(signal.sat))[np.floor(chips).astype(np.int64) % GPS_L1_CA.code_length]
            bits = rng.choice([-1.0, 1.0], round(50.0 * self.duration_s) + 3)
            period = np.floor(chips / GPS_L1_CA.code_length).astype(np.int64)
            symbol = (period - period[0] + rng.integers(20)) // 20
            power_db = o.cn0_dbhz[0, column] + (self.power_db if self.false[row] else 0.0)
            amplitude = np.sqrt(4.0 * 10.0 ** (0.1 * power_db) / rate_hz)
            cycles = np.mod((rate_hz / 4.0 + doppler_hz) * t, 1.0)
            waves[row] = amplitude * bits[symbol] * code * np.exp(2j * np.pi * cycles)
            if self.false[row]:
                waves[row] *= t >= begin
        turns = np.exp(2j * np.pi * phase_cyc).astype(np.complex64)
        if self.kind == "gains":
            turns *= 10.0 ** (-0.05 * rng.uniform(0.0, 15.0, turns.shape[1])).astype(np.float32)
        if self.kind == "tone":
            tone = np.exp(2j * np.pi * np.mod((rate_hz / 4.0 + rng.uniform(-4e5, 4e5)) * t, 1.0))
            over = np.sqrt(2.0) * 10.0 ** (0.05 * rng.uniform(0.0, 25.0))
            waves = np.vstack([waves, (over * tone).astype(np.complex64)])
            turns = np.vstack([turns, np.exp(2j * np.pi * rng.random((1, turns.shape[1]))).astype(np.complex64)])
        planes = np.empty((turns.shape[1], n), np.int8)
        for antenna, plane in enumerate(planes):
            received = turns[:, antenna].real @ waves.real - turns[:, antenna].imag @ waves.imag
            plane[:] = np.where(received + rng.standard_normal(n, np.float32) > 0.0, 1, -1)
        return planes


def _recording(planes: Any, rate_hz: float, if_hz: float, start_gpst: np.datetime64) -> Samples:
    def of(antenna: int) -> Any:
        def read(start: int, count: int) -> Floats:
            plane = planes[antenna, start : start + count].astype(np.float32)
            return np.stack([plane, np.zeros_like(plane)])

        return read

    first, *others = [
        Samples(
            name="array",
            rate_hz=rate_hz,
            n_samples=planes.shape[1],
            read=of(antenna),
            if_hz=if_hz,
            start_gpst=start_gpst,
            antenna=str(antenna + 1),
            format="drawn",
        )
        for antenna in range(len(planes))
    ]
    return Samples(**{**vars(first), "others": tuple(others)})


def judged(scene: DrawnSnapshot, *, with_orbits: bool) -> tuple[Any, float]:
    """What `protect` makes of it, and the seconds of processor that it takes."""
    begin = time.process_time()
    settings, navigation = Settings(), scene.navigation if with_orbits else None
    reception = observe_short(scene.samples, navigation, settings, Silent(), scene.array)
    outcome, _ = judge([reception], navigation, settings, Silent())
    return outcome, time.process_time() - begin


def said_of(scene: DrawnSnapshot, outcome: Any) -> list[tuple[str, str]]:
    """Of each signal received what it is, "true", "false" or "both" of them in one, and its label."""
    reception = outcome.receivers[0].reception
    if reception.observations is None:
        return []
    phases, said = reception.array_phases, []
    received = Counter(signal.sat for signal in reception.observations.signals)
    for s in outcome.decision.labels:
        made = [k for k, one in enumerate(scene.signals) if one.sat == s.ref.signal.sat]
        if not made:
            said.append(("nothing", s.label))
            continue
        column = phases.signals.index(s.ref.signal)
        near = np.ptp(scene.delay_m[made]) < 1.5 * CHIP_M
        if near and (received[s.ref.signal.sat] == 1 or not np.isfinite(phases.phase_cyc[:, column]).any()):
            said.append(("both" if len(made) > 1 else TRUTH[bool(scene.false[made[0]])], s.label))
            continue
        # From which direction it comes says the phases; what the antennas share is arbitrary.
        turns = np.exp(2j * np.pi * (phases.phase_cyc[:, column, None] - scene.phase_cyc[made]))
        present = np.isfinite(turns).all(axis=(1, 2))
        alike = np.abs(np.mean(turns[present], axis=-1)).sum(axis=0)
        said.append((TRUTH[bool(scene.false[made[int(np.argmax(alike))]])], s.label))
    return said


def counted(
    *,
    number: int,
    attack: bool,
    with_orbits: bool,
    antennas: int | None,
    rate_hz: float,
    first: int = 0,
    kind: str = "",
    duration_s: float = DURATION_S,
) -> Iterator[str]:
    """Rows of a table: words of signals and verdicts, then the scenes with a wrong word."""
    count: Counter[str] = Counter()
    wrong, seconds, off = [], [], []
    for k in range(first, first + number):
        scene = DrawnSnapshot(k, attack=attack, antennas=antennas, rate_hz=rate_hz, kind=kind, duration_s=duration_s)
        outcome, took_s = judged(scene, with_orbits=with_orbits)
        seconds.append(took_s)
        said = said_of(scene, outcome)
        count.update(f"{truth} {label}" for truth, label in said)
        count[f"verdict {outcome.decision.verdict}"] += 1
        if {("true", "spoofed"), ("false", "authentic")} & set(said):
            wrong.append(f"{k}: {sorted(set(said))} power {scene.power_db:.1f} dB")
        if attack and outcome.decision.verdict == "authentic":
            wrong.append(f"{k}: an attack is called authentic, power {scene.power_db:.1f} dB, {Counter(said)}")
        if not attack and outcome.decision.verdict == "spoofed":
            wrong.append(f"{k}: a clean sky is called spoofed")
        off += [e.p_value for e in outcome.evidence if e.detector == "residual" and e.p_value is not None]
    name = ("attacks" if attack else "clean") + (", orbits" if with_orbits else ", no orbits")
    name += f", {kind}" if kind else ""
    yield f"{name}: {number}: {dict(sorted(count.items()))}; {np.median(seconds):.1f} s of processor each"
    if off and not attack:
        low = [float(np.mean(np.array(off) < p)) for p in (0.1, 0.01)]
        yield f"  residual's p-values: {len(off)}, below 0.1: {low[0]:.3f}, below 0.01: {low[1]:.3f}"
    yield from (f"  WRONG {item}" for item in wrong)


def table(*, attacks: int, clean: int, **how: Any) -> Iterator[str]:
    """Counts with orbits and without."""
    for number, attack in ((clean, False), (attacks, True)):
        for with_orbits in (True, False):
            if number:
                yield from counted(number=number, attack=attack, with_orbits=with_orbits, **how)
    yield f"memory at most: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB"


def report() -> Iterator[str]:
    """Rows of the table of `make bench`: few, and one of 24 antennas at 16.368 million samples a second."""
    yield from table(attacks=4, clean=4, antennas=None, rate_hz=4.092e6)
    yield from table(attacks=0, clean=1, antennas=24, rate_hz=16.368e6)


def main() -> None:
    """Counts, or one scene."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--attacks", type=int, default=60)
    parser.add_argument("--clean", type=int, default=100)
    parser.add_argument("--antennas", type=int)
    parser.add_argument("--rate", type=float, default=4.092e6)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--only", type=int)
    parser.add_argument("--kind", choices=KINDS, default="", help=str(KINDS))
    parser.add_argument("--quiet-sky", action="store_true", help="of --only: the clean sky of that number")
    parser.add_argument("--duration", type=float, default=DURATION_S, help="seconds of a snapshot")
    options = parser.parse_args()
    how = {
        "antennas": options.antennas,
        "rate_hz": options.rate,
        "kind": options.kind,
        "duration_s": options.duration,
    }
    if options.only is None:
        for row in table(attacks=options.attacks, clean=options.clean, first=options.first, **how):
            print(row, flush=True)
        return
    scene = DrawnSnapshot(options.only, attack=not options.quiet_sky, **how)
    for with_orbits in (True, False):
        outcome, took_s = judged(scene, with_orbits=with_orbits)
        print(outcome.decision.verdict, f"{took_s:.1f} s", f"power {scene.power_db:.1f} dB")
        for e in outcome.evidence:
            if not e.lacking:
                print("  ", e.detector, e.says, explain(e).sentence, e.p_value)
        print("  ", {str(s.ref.signal): s.label for s in outcome.decision.labels})
        print("  ", outcome.receivers[0].reception.remarks)
        print("  ", Counter(said_of(scene, outcome)))


if __name__ == "__main__":
    main()
