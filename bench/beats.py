"""Beats of a second sky and of walls, drawn as lines: how often each is called an attack.

    python bench/beats.py --scenes 20000

A satellite's line is at the difference of the range rates of both ways, known to a hundredth of a hertz as in a window
of 10 s. Walls stand and are vertical, or parallel in pairs; the ground is level; one reflector may move. One reflector
that each satellite is before, drawn at random, reflects it. Lines below 0.3 Hz are not seen, and those above half the
rate of looks repeat.
"""

import argparse
from collections.abc import Callable
from typing import Final

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.correlators.beats import Line, common_p_value, fit_common_motion, mirror_p_value
from skyproof.detectors.correlators.policy import POLICY
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S

WAVELENGTH_M: Final = SPEED_OF_LIGHT_M_S / 1575.42e6
STEP_S, SIGMA_HZ = 0.02, 0.01
ALPHA: Final = 1e-7
"""Of a window and test, at 0.001 false alarms an hour."""
UP: Final = np.array([0.0, 0.0, 1.0])


def draw_sky(rng: np.random.Generator, n: int) -> Reals:
    """Draw directions (n, 3), even over the sky above 5 degrees."""
    up, azimuth_rad = rng.uniform(np.sin(np.radians(5.0)), 1.0, n), rng.uniform(0.0, 2.0 * np.pi, n)
    level = np.sqrt(1.0 - up**2)
    return np.stack([level * np.sin(azimuth_rad), level * np.cos(azimuth_rad), up], axis=1)


def draw_wall(rng: np.random.Generator) -> Reals:
    """Draw the normal of a vertical wall."""
    azimuth_rad = rng.uniform(0.0, 2.0 * np.pi)
    return np.array([np.sin(azimuth_rad), np.cos(azimuth_rad), 0.0])


def draw_velocity(rng: np.random.Generator) -> Reals:
    """Draw the velocity of a platform, on the ground or climbing."""
    speed_m_s, climb = np.exp(rng.uniform(np.log(0.3), np.log(30.0))), rng.uniform(-0.2, 0.2)
    return speed_m_s * (draw_wall(rng) + climb * UP)


def reflect(
    rng: np.random.Generator, sky: Reals, velocity_m_s: Reals, normals: list[Reals], walls_m_s: list[float]
) -> Reals:
    """Return the rate (n,) of each satellite's line by a reflector that it is before; NaN without one."""
    rates_m_s = np.full(len(sky), np.nan)
    for k, u in enumerate(sky):
        before = [j for j, normal in enumerate(normals) if normal @ u > 0.0]
        if before:
            j = before[rng.integers(len(before))]
            rates_m_s[k] = -2.0 * (velocity_m_s @ normals[j] - walls_m_s[j]) * (normals[j] @ u)
    return rates_m_s


def walls(rng: np.random.Generator, sky: Reals, velocity_m_s: Reals) -> Reals:
    """One to four walls, and the ground in half of the scenes."""
    normals = [draw_wall(rng) for _ in range(rng.integers(1, 5))] + [UP] * int(rng.integers(2))
    return reflect(rng, sky, velocity_m_s, normals, [0.0] * len(normals))


def street(rng: np.random.Generator, sky: Reals, velocity_m_s: Reals) -> Reals:
    """Two parallel walls."""
    normal = draw_wall(rng)
    return reflect(rng, sky, velocity_m_s, [normal, -normal], [0.0, 0.0])


def moving(rng: np.random.Generator, sky: Reals, velocity_m_s: Reals) -> Reals:
    """One wall that moves."""
    return reflect(rng, sky, velocity_m_s, [draw_wall(rng)], [rng.uniform(-5.0, 5.0)])


def ground(rng: np.random.Generator, sky: Reals, velocity_m_s: Reals) -> Reals:
    """The ground alone."""
    return reflect(rng, sky, velocity_m_s, [UP], [0.0])


def unlike(rng: np.random.Generator, sky: Reals, velocity_m_s: Reals) -> Reals:
    """Lines of nothing in common, log-uniform."""
    return WAVELENGTH_M * np.exp(rng.uniform(np.log(0.3), np.log(22.5), len(sky)))


def even(rng: np.random.Generator, sky: Reals, velocity_m_s: Reals) -> Reals:
    """Lines of nothing in common, uniform up to a fastest."""
    return WAVELENGTH_M * rng.uniform(1.0, 25.0) * rng.random(len(sky))


def modulated(rng: np.random.Generator, sky: Reals, velocity_m_s: Reals) -> Reals:
    """One line for all."""
    return np.full(len(sky), WAVELENGTH_M * rng.uniform(0.5, 20.0))


def second_sky(
    slow_m_s: float, fast_m_s: float, clock_m_s: float
) -> Callable[[np.random.Generator, Reals, Reals], Reals]:
    """A further sky that moves in any direction, at speeds between these, and whose clock runs by up to so much."""

    def draw(rng: np.random.Generator, sky: Reals, velocity_m_s: Reals) -> Reals:
        w = rng.standard_normal(3)
        w *= rng.uniform(slow_m_s, fast_m_s) / np.linalg.norm(w)
        return sky @ w - rng.uniform(-clock_m_s, clock_m_s)

    return draw


KINDS: Final = {
    "walls, ground": walls,
    "street": street,
    "a wall that moves": moving,
    "ground": ground,
    "nothing in common": unlike,
    "the same, evenly spread": even,
    "one modulation": modulated,
    "second sky, 0.3 to 0.6 m/s": second_sky(0.3, 0.6, 0.0),
    "second sky, 0.6 to 2 m/s": second_sky(0.6, 2.0, 0.0),
    "second sky, 2 to 8 m/s": second_sky(2.0, 8.0, 0.0),
    "the same with a clock to 3 m/s": second_sky(2.0, 8.0, 3.0),
}


def judge(rng: np.random.Generator, sky: Reals, rates_m_s: Reals, velocity_m_s: Reals) -> tuple[bool, bool]:
    """Return whether one motion explains the lines, and whether no reflector and no modulation does."""
    seen_hz = np.abs(rates_m_s / WAVELENGTH_M + SIGMA_HZ * rng.standard_normal(len(sky)))
    seen_hz = np.abs(seen_hz - np.rint(seen_hz * STEP_S) / STEP_S)
    there = (seen_hz > POLICY.least_beat_hz) & (seen_hz < POLICY.most_beat_share / STEP_S)
    lines = [Line(float(hz), SIGMA_HZ, 1e4) for hz in seen_hz[there]]
    design = np.column_stack([sky, -np.ones(len(sky))])[there]
    motion = fit_common_motion(lines, np.full(len(lines), WAVELENGTH_M), design, STEP_S)
    if motion is None or motion.p_value >= ALPHA:
        return False, False
    benign = max(mirror_p_value(motion, velocity_m_s, 1e-4 * np.eye(3)), common_p_value(motion))
    return True, benign < ALPHA


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=2000, help="of each kind")
    parser.add_argument("--satellites", type=int, default=10)
    parser.add_argument("--first", type=int, default=0, help="seed")
    given = parser.parse_args()
    print("| lines | scenes | one motion explains them | attack |\n|---|---:|---:|---:|")
    for name, draw in KINDS.items():
        rng = np.random.default_rng((given.first, *name.encode()))
        found = []
        for _ in range(given.scenes):
            sky, velocity_m_s = draw_sky(rng, given.satellites), draw_velocity(rng)
            found.append(judge(rng, sky, draw(rng, sky, velocity_m_s), velocity_m_s))
        one, attack = np.mean(found, axis=0)
        print(f"| {name} | {given.scenes} | {one:.4f} | {attack:.4f} |", flush=True)


if __name__ == "__main__":
    main()
