"""Hours of clean sky for `dccaf` at the correlators: grids drawn with their covariance, without and with reflectors.

Of each window of 10 s the burst that is looked at, eight satellites spread over the sky. Reflections come from the
ground below the antenna (path longer by 2 h sin E), from one wall (2 d cos E cos A, satellites that face it), or from
ground and three walls around a vehicle whose speed turns their phases. Each is 3 to 20 dB weaker. What is counted is
the first half of the detector's test: satellites whose second signal no reflection explains, p-values of their number
(binomial, as the detector has it), and windows with five such satellites, from which on a second sky is searched.

`python bench/clean_grids.py --hours 5` writes a table as markdown.
"""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from time import process_time

import numpy as np

from skyproof.arrays import Complexes, Reals
from skyproof.detectors.dccaf.bursts import autocorrelate_code, build_shapes, fit_components, joint_p_value
from skyproof.detectors.dccaf.delays import DccafSettings
from skyproof.detectors.dccaf.detector import GRIDS
from skyproof.detectors.dccaf.policy import POLICY
from skyproof.gnss.constants import CA_CHIP_RATE_HZ, L1_HZ, SPEED_OF_LIGHT_M_S
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.statistics.distributions import binomial_survival

CHIP_M = SPEED_OF_LIGHT_M_S / CA_CHIP_RATE_HZ
BAND_HZ = 3.0e6
POINTS = np.arange(-5.0, 6.0) * 0.3
SATELLITES = 8
WINDOW_S = 10.0
LEVELS = (0.1, 0.01, 1e-3)
WEAKER_DB = (3.0, 20.0)

Rays = tuple[Reals, Reals, Reals]
"""Delay behind the direct way in chips, level in dB and Doppler against it in Hz, (n_rays,)."""


@dataclass(frozen=True)
class Sky:
    """Where the satellites stand, rad."""

    azimuth: Reals
    elevation: Reals


def drawn_sky(rng: np.random.Generator) -> Sky:
    """Even over the half sphere above 5 degrees."""
    low = np.sin(np.radians(5.0))
    return Sky(rng.uniform(0.0, 2.0 * np.pi, SATELLITES), np.arcsin(rng.uniform(low, 1.0, SATELLITES)))


def _levels(rng: np.random.Generator, n: int) -> Reals:
    return -rng.uniform(*WEAKER_DB, n)


def nothing(rng: np.random.Generator, sky: Sky) -> list[Rays]:
    """No reflection."""
    return [(np.empty(0), np.empty(0), np.empty(0))] * sky.azimuth.size


def ground(rng: np.random.Generator, sky: Sky) -> list[Rays]:
    """Below an antenna 1 to 60 m up."""
    longer_m = 2.0 * rng.uniform(1.0, 60.0) * np.sin(sky.elevation)
    level_db = _levels(rng, sky.azimuth.size)
    return [(longer_m[k : k + 1] / CHIP_M, level_db[k : k + 1], np.zeros(1)) for k in range(sky.azimuth.size)]


def wall(rng: np.random.Generator, sky: Sky, *, speed_m_s: float = 0.0) -> list[Rays]:
    """3 to 100 m from the antenna; it does not reflect what comes from behind it."""
    away_m, faces = rng.uniform(3.0, 100.0), rng.uniform(0.0, 2.0 * np.pi)
    along = np.cos(sky.elevation) * np.cos(sky.azimuth - faces)
    hz = -2.0 * speed_m_s * np.cos(rng.uniform(0.0, 2.0 * np.pi)) * along * L1_HZ / SPEED_OF_LIGHT_M_S
    level_db = _levels(rng, sky.azimuth.size)
    return [
        (2.0 * away_m * along[[k]] / CHIP_M, level_db[[k]], hz[[k]]) if along[k] > 0.0 else (np.empty(0),) * 3
        for k in range(sky.azimuth.size)
    ]


def vehicle(rng: np.random.Generator, sky: Sky) -> list[Rays]:
    """Ground 2 m below and three walls, at up to 30 m/s."""
    speed_m_s = rng.uniform(0.0, 30.0)
    below = [(np.array([4.0 * np.sin(e)]) / CHIP_M, _levels(rng, 1), np.zeros(1)) for e in sky.elevation]
    sides = [wall(rng, sky, speed_m_s=speed_m_s) for _ in range(3)]
    return [
        tuple(np.concatenate([item[k][part] for item in (below, *sides)]) for part in range(3))
        for k in range(sky.azimuth.size)
    ]


SURROUNDINGS: dict[str, Callable[[np.random.Generator, Sky], list[Rays]]] = {
    "open sky": nothing,
    "ground": ground,
    "wall": wall,
    "vehicle": vehicle,
}


def satellites_counted(rng: np.random.Generator, rays: list[Rays]) -> tuple[int, int]:
    """Of one window: satellites with a second signal, and those of them that no reflection explains."""
    settings, second, unlike = DccafSettings(), 0, 0
    for prn, (delay_chips, level_db, hz) in zip(rng.choice(32, SATELLITES, replace=False) + 1, rays, strict=True):
        own = build_shapes(GPS_L1_CA, int(prn), tuple(POINTS.tolist()), BAND_HZ, settings.window_chips)
        found = fit_components(_burst(rng, int(prn), delay_chips, level_db, hz)[None], own, np.ones((1, 4)))
        second += bool(joint_p_value(found.second, GRIDS.intervals, own.path)[0] < POLICY.signal_probability)
        unlike += bool(joint_p_value(found.unlike, GRIDS.intervals, own.path)[0] < POLICY.signal_probability)
    return second, unlike


def _burst(rng: np.random.Generator, prn: int, delay_chips: Reals, level_db: Reals, hz: Reals) -> Complexes:
    """Taps (intervals, points) in noise of variance 1, 38 to 50 dB-Hz."""
    n = GRIDS.intervals
    size = np.sqrt(10.0 ** (0.1 * rng.uniform(38.0, 50.0)) * GRIDS.coherent_s)
    times_s = GRIDS.coherent_s * np.arange(n)[:, None]
    turned = np.exp(2j * np.pi * (rng.random(hz.size) + hz * times_s)) * np.sinc(hz * GRIDS.coherent_s)
    waves = np.concatenate([np.ones((n, 1)), turned * 10.0 ** (0.05 * level_db)], axis=1)
    seen = autocorrelate_code(GPS_L1_CA, prn, POINTS - np.append(0.0, delay_chips)[:, None], BAND_HZ)
    values, vectors = np.linalg.eigh(autocorrelate_code(GPS_L1_CA, prn, POINTS[:, None] - POINTS, BAND_HZ))
    white = rng.standard_normal((n, POINTS.size, 2)) @ np.array([1.0, 1.0j]) / np.sqrt(2.0)
    return np.asarray(size * waves @ seen + white @ (vectors * np.sqrt(np.maximum(values, 0.0))).T)


def row_of(name: str, hours: float, seed: int = 1) -> str:
    """One surroundings' hours as a row of the table."""
    rng, windows = np.random.default_rng([seed, len(name)]), round(3600.0 * hours / WINDOW_S)
    counts = []
    for _ in range(windows):
        sky = drawn_sky(rng)
        counts.append(satellites_counted(rng, SURROUNDINGS[name](rng, sky)))
    second, unlike = np.array(counts).T
    chance = DccafSettings().no_reflection_probability + POLICY.signal_probability
    p_values = np.array([float(binomial_survival(int(k), SATELLITES, chance)) for k in unlike])
    shares = [f"{np.mean(p_values <= level):.4f}" for level in LEVELS]
    cells = [name, f"{hours:g}", f"{second.mean() / SATELLITES:.3f}", f"{unlike.mean() / SATELLITES:.4f}", *shares]
    return (
        "| " + " | ".join([*cells, str(int(np.sum(unlike >= POLICY.sky_satellites))), f"{p_values.min():.1e}"]) + " |"
    )


def table(hours: float) -> Iterator[str]:
    """All surroundings."""
    head = ["surroundings", "hours", "share with a second signal", "share no reflection explains"]
    head += [f"windows p ≤ {level:g}" for level in LEVELS] + ["windows with five", "smallest p"]
    yield "| " + " | ".join(head) + " |"
    yield "|" + "---|" * len(head)
    for name in SURROUNDINGS:
        yield row_of(name, hours)


def report() -> Iterator[str]:
    """A short table, and what it costs to take a burst apart."""
    yield "clean sky at the correlators, eight satellites: second signals, and the number that no reflection explains"
    yield from table(0.5)
    rng, rays = np.random.default_rng(2), nothing(np.random.default_rng(2), drawn_sky(np.random.default_rng(2)))
    satellites_counted(rng, rays)  # compiled before it is timed
    since, n = process_time(), 50
    for _ in range(n):
        satellites_counted(rng, rays)
    yield f"  {1e3 * (process_time() - since) / (n * SATELLITES):.2f} ms of CPU a satellite and burst, drawing included"


def main() -> None:
    """The table, for as many hours as wanted."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--hours", type=float, default=5.0, help="of each surroundings")
    for line in table(options.parse_args().hours):
        print(line, flush=True)


if __name__ == "__main__":
    main()
