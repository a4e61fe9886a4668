"""Measure how steady generated clocks and inertial units are, against their class and grade."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
import scipy

from skyproof.arrays import Reals
from skyproof.gnss.imu_grades import GRADES
from skyproof.gnss.oscillators import OSCILLATORS
from skyproof.records import freeze
from skyproof.simulator.clocks import STEP_S, make_clock
from skyproof.simulator.inertial import (
    BLOCK,
    ImuErrors,
    compute_accelerometer_allan_m_s2,
    compute_gyro_allan_rad_s,
)
from skyproof.statistics.allan import allan_deviation

__all__ = ["Stability", "measure_clock_stability", "measure_imu_stability"]

IMU_HZ: Final = 10.0
IMU_S: Final = 6000.0
IMU_UNITS: Final = 4  # of three axes each
CLOCK_S: Final = 500.0
CLOCK_RUNS: Final = 8
CLOCK_EVERY: Final = 16  # knots from one phase to the next; longer averaging times need no closer ones


@dataclass(frozen=True, eq=False, kw_only=True)
class Stability:
    """The Allan deviation of generated data at averaging times tau_s (n,), and what theory says there.

    deviation : (n,) root of the mean variance of several runs. lower, upper : (n,) its 90 % limits by the runs' own
        spread, which assumes no kind of noise. what : the quantity, given in `unit`.
    """

    name: str
    what: str
    unit: str
    tau_s: Reals
    deviation: Reals
    lower: Reals
    upper: Reals
    theory: Reals

    def __post_init__(self) -> None:
        freeze(self, {name: ("tau",) for name in ("tau_s", "deviation", "lower", "upper", "theory")})


def measure_imu_stability(*, seed: int = 0) -> list[Stability]:
    """Measure accelerometers and gyros of the two grades of the paper's table.

    A turn-on bias does not show here.
    """
    results = []
    n_blocks = int(np.ceil(IMU_S * IMU_HZ / BLOCK))
    for number, name in enumerate(("navigation", "tactical")):
        grade = GRADES[name]
        units = [ImuErrors.of(grade, IMU_HZ, n_blocks, seed, IMU_UNITS * number + unit) for unit in range(IMU_UNITS)]
        drawn = np.stack([np.concatenate([unit.drawn(block) for block in range(n_blocks)]) for unit in units])
        phase = np.cumsum(np.moveaxis(drawn, 1, 2), axis=-1) / IMU_HZ
        theories = (
            ("accelerometer", "m/s²", partial(compute_accelerometer_allan_m_s2, grade)),
            ("gyro", "rad/s", partial(compute_gyro_allan_rad_s, grade)),
        )
        for first, (quantity, unit, theory) in zip((0, 3), theories, strict=True):
            runs = phase[:, first : first + 3].reshape(3 * IMU_UNITS, -1)
            results.append(_measure_stability(name, quantity, unit, runs, 1.0 / IMU_HZ, theory))
    return results


def measure_clock_stability(*, seed: int = 0) -> list[Stability]:
    """Measure every class of oscillator that has noise."""
    interval_s = CLOCK_EVERY * STEP_S
    at_s = np.arange(0.0, CLOCK_S, interval_s)
    noisy = {name: o for name, o in OSCILLATORS.items() if max(o.white_s, o.flicker, o.walk_hz) > 0.0}
    results = []
    for number, (name, oscillator) in enumerate(noisy.items()):
        streams = range(CLOCK_RUNS * number, CLOCK_RUNS * (number + 1))
        runs = [make_clock(oscillator, seed=seed, stream=s, duration_s=CLOCK_S).offset_s(at_s) for s in streams]
        results.append(
            _measure_stability(name, "oscillator", "s/s", np.stack(runs), interval_s, oscillator.allan_deviation)
        )
    return results


def _measure_stability(
    name: str, what: str, unit: str, phase: Reals, interval_s: float, theory: Callable[[Reals], Reals]
) -> Stability:
    """Measure runs (n_runs, n) of a phase, at three averaging times a decade up to a tenth of their length."""
    longest = phase.shape[-1] / 10.0
    steps = np.geomspace(1.0, longest, int(3.0 * np.log10(longest)) + 1)
    measured = allan_deviation(phase, interval_s, sorted({int(step) for step in steps}))
    variance = measured.deviation**2
    mean = variance.mean(axis=0)
    half_width = scipy.special.stdtrit(len(phase) - 1, 0.95) * variance.std(axis=0, ddof=1) / np.sqrt(len(phase))
    return Stability(
        name=name,
        what=what,
        unit=unit,
        tau_s=measured.tau_s,
        deviation=np.sqrt(mean),
        lower=np.sqrt(np.maximum(mean - half_width, 0.01 * mean)),
        upper=np.sqrt(mean + half_width),
        theory=theory(measured.tau_s),
    )
