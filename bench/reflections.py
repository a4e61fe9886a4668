"""How often trusted and consistent fixes lie within their 95 % bound under reflections, and how wide the bound is.

    python bench/reflections.py --skies 200                    errors of codes drawn after a measured channel
    python bench/reflections.py --correlators 40 --first 100   drawn skies behind drawn correlators, through protect
    python bench/reflections.py --words 30 --first 200         words of such skies, 60 s, one receiver

Channel: BDS B1I in a dense urban canyon, standing receiver, W. Wang et al., Satellite Navigation 1, 27 (2020), table 1:
delays by elevation gamma, power -12.35 dB - 0.0016 dB/m, fading 0.08 Hz in the mean, lifetimes 9 s. Every satellite has
one or two such reflections at any time. Behind correlators the skies are those of `studies.protection.clean`. Each sky
is judged with and without its reflections, and by bounds with and without what the discriminators show.
A run counts as held if 95 % of its fixes are within their bound.
"""

import argparse
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import tomli_w
from scipy.stats import genpareto

from skyproof.app.receive.reception import Reception
from skyproof.arrays import Complexes, Reals
from skyproof.fusion.trusted import fix_of
from skyproof.gnss.constants import CA_CHIP_RATE_HZ, SPEED_OF_LIGHT_M_S
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.signals import prn_of
from skyproof.navigation.smooth import smooth
from skyproof.receiver.discriminator import compute_discriminator
from skyproof.records import CellStatus, Fix, Observations
from skyproof.simulator.measurements import make_ideal_measurements
from skyproof.simulator.received import Scene
from skyproof.simulator.sky import make_scene
from skyproof.studies.correlator_model import protect_scene
from skyproof.studies.correlator_model.correlation import interpolate, tabulate_correlation
from skyproof.studies.correlator_model.session import receive_antenna
from skyproof.studies.protection.clean import clean_sky
from skyproof.studies.protection.errors import FixErrors, fix_errors
from skyproof.verdict import WORDS, write_word

SEED = 1
CHIP_M = SPEED_OF_LIGHT_M_S / CA_CHIP_RATE_HZ
INTERVAL_S, RUN_S, WINDOW_S = 0.5, 60.0, 100.0
RATE_HZ, HALF_CHIPS = 4e6, 0.128
CODE_SIGMA_M, MULTIPATH_SIGMA_M, MASK_DEG = 0.5, 1.0, 5.0
SHAPE = np.array([2.62, 2.77, 2.81, 2.56, 2.47, 2.40])
SCALE_M = np.array([129.83, 105.52, 80.93, 65.12, 53.22, 43.24])
"""Of delays, by elevation in steps of 15 degrees."""
POWER_DB, POWER_DB_A_M, FADING_HZ, LIFETIME = -12.35, -0.0016, 1.0 / 12.3, (0.04, 8.07, 0.3)
INTEGRITY_RISK = 1e-7


@dataclass(frozen=True)
class Run:
    """Fixes of a sky by one kind of bound. bounds : error over bound of each fix. vertical : the same, of heights."""

    bounds: Reals
    vertical: Reals
    error_m: float
    bound_m: float
    beyond_level: int
    level_m: float

    @staticmethod
    def of(parts: list[FixErrors]) -> "Run | None":
        """Gather the errors of a run's fixes; None without any."""
        parts = [part for part in parts if part.horizontal_m.size]
        if not parts:
            return None
        error_m = np.concatenate([part.horizontal_m for part in parts])
        bound_m = np.concatenate([part.bound_m for part in parts])
        sizes_m, levels_m = (np.concatenate([getattr(p, n) for p in parts]) for n in ("sizes_m", "protection_m"))
        up_m = 1.96 * np.concatenate([part.sigma_enu_m[:, 2] for part in parts])
        return Run(
            bounds=error_m / bound_m,
            vertical=sizes_m[:, 1] / up_m,
            error_m=float(np.median(error_m)),
            bound_m=float(np.median(bound_m)),
            beyond_level=int(np.sum(sizes_m > levels_m)),
            level_m=float(np.median(levels_m[:, 0])),
        )


def offsets(rng: np.random.Generator, elapsed_s: Reals, el_rad: float, prn: int, reflected: bool) -> Complexes:
    """What reflections do to a discriminator (n_epochs,), in metres: the code's error, and the part off the carrier."""
    waves = np.zeros((2, elapsed_s.size), np.complex128)
    delay_chips = np.zeros((2, elapsed_s.size))
    row = min(int(np.degrees(el_rad) / 15.0), 5)
    for ray in range(int(rng.integers(1, 3)) if reflected else 0):
        at_s = -float(rng.uniform(0.0, 10.0))
        while at_s < elapsed_s[-1]:
            until_s = at_s + float(genpareto.rvs(LIFETIME[0], LIFETIME[2], LIFETIME[1], random_state=rng))
            now = (elapsed_s >= at_s) & (elapsed_s < until_s)
            delay_m = float(rng.gamma(SHAPE[row], SCALE_M[row]))
            cycles = float(rng.uniform()) + float(rng.laplace(0.0, FADING_HZ)) * elapsed_s[now]
            size = 10.0 ** (0.05 * (POWER_DB + POWER_DB_A_M * delay_m))
            waves[ray, now], delay_chips[ray, now] = size * np.exp(2j * np.pi * cycles), delay_m / CHIP_M
            at_s = until_s
    table = tabulate_correlation(prn, RATE_HZ, 0.8 * RATE_HZ, None).signal
    gain = compute_discriminator(CA_CHIP_RATE_HZ / RATE_HZ, 2.0 * HALF_CHIPS).gain
    late_chips = np.zeros(elapsed_s.size)
    for _ in range(30):  # as a loop settles
        early, prompt, late = (
            interpolate(table, late_chips + tap) + np.sum(waves * interpolate(table, late_chips + tap - delay_chips), 0)
            for tap in (-HALF_CHIPS, 0.0, HALF_CHIPS)
        )
        apart = (late - early) * np.conj(prompt) / np.abs(prompt) ** 2 / gain
        late_chips = late_chips + 0.5 * apart.real
    return np.asarray(CHIP_M * (late_chips + 1j * apart.imag))


def measured(number: int, reflected: bool) -> tuple[Run | None, Run | None]:
    """A sky at measurement level by both bounds: without and with what the discriminators show."""
    rng = np.random.default_rng([SEED, number])
    scene = _scene(number, RUN_S, reflected=False)
    (ideal,) = make_ideal_measurements(scene, interval_s=INTERVAL_S)
    shape = ideal.pseudorange_m.shape
    apart_m = np.stack(
        [
            offsets(rng, ideal.elapsed_s, float(ideal.exposure.el_rad[:, k].mean()), prn_of(signal.sat), reflected)
            for k, signal in enumerate(ideal.signals)
        ],
        axis=1,
    )
    noise_m = CODE_SIGMA_M * rng.standard_normal((2, *shape))
    observations = Observations(
        receiver=ideal.receiver,
        signals=ideal.signals,
        gpst=ideal.gpst,
        elapsed_s=ideal.elapsed_s,
        pseudorange_m=ideal.pseudorange_m + apart_m.real + noise_m[0],
        carrier_cyc=ideal.carrier_cyc,
        doppler_hz=ideal.doppler_hz,
        cn0_dbhz=ideal.cn0_dbhz,
        pseudorange_sigma_m=np.full(shape, CODE_SIGMA_M),
        carrier_sigma_cyc=np.full(shape, 0.01),
        doppler_sigma_hz=np.full(shape, 0.05),
        status=np.full(shape, CellStatus.OK, np.uint8),
        found_elapsed_s=np.zeros(shape[1]),
        missed_elapsed_s=np.full(shape[1], np.nan),
    )
    carrier_m = ideal.carrier_cyc * SPEED_OF_LIGHT_M_S / observations.carrier_hz
    beside = replace(observations, pseudorange_m=carrier_m + apart_m.imag + noise_m[1])
    quadrature_m = smooth(beside, window_s=WINDOW_S).pseudorange_m - carrier_m
    smoothed = smooth(observations, window_s=WINDOW_S)

    def by(shown_m: Reals | None) -> Run | None:
        found = fix_of(
            smoothed,
            scene.navigation,
            multipath_sigma_m=MULTIPATH_SIGMA_M,
            elevation_mask_deg=MASK_DEG,
            integrity_risk=INTEGRITY_RISK,
            quadrature_m=shown_m,
        )
        return None if found is None else Run.of([fix_errors(scene, scene.skies[0], found)])

    return by(None), by(quadrature_m)


def correlated(number: int, reflected: bool, duration_s: float = 40.0) -> tuple[Run | None, Run | None]:
    """A sky behind drawn correlators, one receiver of which nothing is stated, by both bounds."""
    scene = _scene(number, duration_s, reflected=reflected)
    with TemporaryDirectory(prefix="reflections") as folder:
        platform = Path(folder) / "platform.toml"
        platform.write_text(tomli_w.dumps({"receivers": [{"name": "rx"}]}), encoding="utf-8")
        _, outcome = protect_scene(scene, scene.navigation, platform, scene.scenario.seed)
    positions = outcome.receivers[0].positions
    if positions is None:
        return None, None

    def errors(fix: Fix | None) -> list[FixErrors]:
        return [] if fix is None else [fix_errors(scene, scene.skies[0], fix)]

    unseen = replace(positions.log.read(0, positions.log.gpst.size), quadrature_m=np.array(np.nan))
    plain, shown = replace(positions, log=unseen), replace(positions)  # nothing that was computed is kept
    both = [[e for kind in ("trusted", "consistent") for e in errors(by.whole(kind))] for by in (plain, shown)]
    return Run.of(both[0]), Run.of(both[1])


def words(numbers: range, *, shown: bool) -> str:
    """A row of how many skies have each word, with and without what the discriminators show in the tests."""
    counts: Counter[str] = Counter()
    for number in numbers:
        scene = _scene(number, RUN_S, reflected=True)
        with TemporaryDirectory(prefix="reflections") as folder:
            platform = Path(folder) / "platform.toml"
            platform.write_text(tomli_w.dumps({"receivers": [{"name": "rx"}]}), encoding="utf-8")
            receive = receive_antenna if shown else _receive_unseen
            verdict, _ = protect_scene(scene, scene.navigation, platform, scene.scenario.seed, receive)
        counts[verdict.verdict] += 1
    cells = " | ".join(str(counts[word]) for word in WORDS)
    return f"| {'discriminators' if shown else 'multipath_sigma_m alone'} | {cells} |"


def _receive_unseen(*given: Any) -> Reception:
    """Receive without what discriminators show."""
    reception = receive_antenna(*given)
    log = reception.observations
    if log is None:
        return reception
    return replace(reception, observations=replace(log.read(0, log.gpst.size), quadrature_m=np.array(np.nan)))


def _scene(number: int, duration_s: float, *, reflected: bool) -> Scene:
    scenario = clean_sky(SEED, number, duration_s)
    if not reflected:
        receivers = (scenario.receivers[0].model_copy(update={"multipath": ()}),)
        scenario = scenario.model_copy(update={"receivers": receivers})
    return make_scene(scenario, make_nominal_constellation(scenario.start_gpst))


def row_of(name: str, runs: list[Run | None]) -> str:
    """A row of the table."""
    found = [run for run in runs if run is not None]
    inside = np.array([np.mean(run.bounds <= 1.0) for run in found])
    upright = np.array([np.mean(run.vertical <= 1.0) for run in found])
    cells = [
        f"{len(found)}",
        f"{sum(run.bounds.size for run in found)}",
        f"{inside.mean():.3f}",
        f"{np.mean(inside >= 0.95):.3f}",
        f"{np.sum(inside == 0.0)}",
        f"{upright.mean():.3f}",
        f"{np.median([run.error_m for run in found]):.2f}",
        f"{np.median([run.bound_m for run in found]):.2f}",
        f"{np.median([run.level_m for run in found]):.1f}",
        f"{sum(run.beyond_level for run in found)}",
    ]
    return f"| {name} | " + " | ".join(cells) + " |"


def table(numbers: range, *, correlators: bool) -> Iterator[str]:
    """Rows without and with reflections, by both bounds."""
    draw, level = (correlated, "correlators") if correlators else (measured, "measurements")
    for reflected in (False, True):
        pairs = [draw(number, reflected) for number in numbers]
        for what, runs in zip(("multipath_sigma_m alone", "discriminators"), zip(*pairs, strict=True), strict=True):
            yield row_of(f"{level}, {'with' if reflected else 'no'} reflections, {what}", list(runs))


HEAD = (
    "skies",
    "fixes",
    "within, mean over runs",
    "runs within 0.95",
    "runs never within",
    "within, heights",
    "error, m",
    "bound, m",
    "level, m",
    "beyond a level",
)


def report() -> Iterator[str]:
    """A short table."""
    yield "fixes within their 95 % bound under reflections, at measurement level"
    yield "| errors and bound | " + " | ".join(HEAD) + " |"
    yield "|---" * (1 + len(HEAD)) + "|"
    yield from table(range(20), correlators=False)


def main() -> None:
    """The table, for as many skies as wanted."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--skies", type=int, default=0, help="at measurement level")
    options.add_argument("--correlators", type=int, default=0, help="behind drawn correlators")
    options.add_argument("--words", type=int, default=0, help="words behind drawn correlators")
    options.add_argument("--first", type=int, default=0, help="number of the first sky")
    chosen = options.parse_args()
    if chosen.words:
        print("| tests | " + " | ".join(map(write_word, WORDS)) + " |\n" + "|---" * (1 + len(WORDS)) + "|")
        for shown in (False, True):
            print(words(range(chosen.first, chosen.first + chosen.words), shown=shown), flush=True)
        return
    print("| errors and bound | " + " | ".join(HEAD) + " |\n" + "|---" * (1 + len(HEAD)) + "|")
    for count, correlators in ((chosen.skies, False), (chosen.correlators, True)):
        if count:
            for line in table(range(chosen.first, chosen.first + count), correlators=correlators):
                print(line, flush=True)


if __name__ == "__main__":
    main()
