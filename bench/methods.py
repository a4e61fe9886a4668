"""The papers' methods as functions: nanoseconds a statistic with leading axes, beside a plain loop over single calls;
a million draws of each Monte Carlo in one call; the dead-zone map of the whole sky."""

from collections.abc import Callable, Iterator
from time import perf_counter, process_time
from typing import NamedTuple

import numpy as np
from timing import line, take_turns

from skyproof.arrays import Reals
from skyproof.decomposition.fit import decompose
from skyproof.detectors.array.arm_phases import fit_whole_series
from skyproof.detectors.array.array_common import equal_statistic
from skyproof.detectors.array.array_model import array_design, joint_statistic, residual_covariance, white_covariance
from skyproof.detectors.correlators.vector_parity import parity_test, parity_vector
from skyproof.detectors.correlators.vector_sqm import satellite_geometry
from skyproof.detectors.dccaf.inverse_raim import find_passing_sets
from skyproof.detectors.multi_receiver.along_baselines import span_test
from skyproof.statistics.cusum import cusum_path
from skyproof.statistics.directions import hemisphere
from skyproof.studies.arm_angles import arm_angles, fit_pairs
from skyproof.studies.array_geometry import equilateral_triangle, single_statistic
from skyproof.studies.decomposition_laws import count_statistic, delay_dictionary, noise_variance, simulate_taps
from skyproof.studies.direction_tests import blocks, measure_dead_zone
from skyproof.studies.double_difference import difference_test, reject_pairs
from skyproof.studies.exclusion import choose_fix
from skyproof.studies.group_choice import split_skies
from skyproof.studies.quality_metrics import delta_law, delta_metric, moving_variance, ratio_p_value
from skyproof.studies.vector_parity_tests import whitener
from skyproof.studies.vector_rules import geometry_matrix, two_step

MANY, FEW = 20_000, 500
"""Statistics in one call, and single calls of the plain loop."""
DRAWS, MOST_NUMBERS = 1_000_000, 50_000_000
RATE_HZ = 5e6
SATS = 8
CELLS_CYC = 5.0 * equilateral_triangle(1.0)
WHITE = white_covariance([0.01] * 3)
ARM = {"radius_cyc": 0.5, "sigma_cyc": 0.01}


class Method(NamedTuple):
    """draw : so many trials' measurements, the trials along the first axis. test : the statistic of all of them.
    of_each : statistics a trial."""

    name: str
    draw: Callable[[int, np.random.Generator], Reals]
    test: Callable[[Reals], object]
    of_each: int = 1


def _normal(*shape: int, sigma: float = 1.0) -> Callable[[int, np.random.Generator], Reals]:
    return lambda n, rng: sigma * rng.standard_normal((n, *shape))


def _methods() -> Iterator[Method]:
    units = hemisphere(9)[:SATS]  # the ninth stands at the horizon
    where = satellite_geometry(geometry_matrix(np.arctan2(units[:, 0], units[:, 1]), np.arcsin(units[:, 2])))
    white, amplitude = whitener(where.parity, 20.0), 20.0
    law = delta_law(0.5)
    yield Method("multi-receiver 1b, 30 epochs", _normal(30, 1), difference_test)
    yield Method(
        "multi-receiver 1b, all pairs of a window",
        _normal(28, 30, 1),
        lambda sd_m: reject_pairs(sd_m, 0.01),
        28 * 27 // 2,
    )
    yield Method("two skies, 64 splits", _normal(7, 2), lambda range_m: split_skies(range_m, units[:7]), 64)
    yield Method(
        "one pairing of skies", _normal(2, 7, 2), lambda range_m: span_test(range_m[:, 0], range_m[:, 1], units[:7])
    )
    yield Method(
        "exclusion by inertia, two fixes", _normal(3, 3), lambda m: choose_fix(m[:, 0], np.eye(3), m[:, 1:], np.eye(3))
    )
    yield Method("two-step rule, 8 satellites", _normal(2, SATS, sigma=0.1), lambda m: two_step(m[:, 0], m[:, 1]))
    yield Method(
        "parity of vector tracking",
        _normal(2, SATS, sigma=0.05),
        lambda m: parity_test(parity_vector(m[:, 0], m[:, 1], white)),
    )
    yield Method("CUSUM, 20 steps of 8 numbers", _normal(20, SATS), lambda y: cusum_path(y, 1.0), 20)
    yield Method(
        "delta and its p-value",
        _normal(3),
        lambda m: ratio_p_value(
            delta_metric(amplitude / 2 + m[:, 0], amplitude + m[:, 1], amplitude / 2 + m[:, 2]), law, amplitude
        ),
    )
    yield Method("moving variance, 100 of 20 epochs", _normal(119), lambda values: moving_variance(values, 20), 100)
    yield Method("array and attitude, one signal", _normal(2, sigma=0.01), lambda z: single_statistic(z, WHITE))
    yield Method(
        "the same, whole cycles unknown", _normal(2, sigma=0.01), lambda z: single_statistic(z, WHITE, wrapped=True)
    )
    common = residual_covariance(CELLS_CYC, units, position_sigma_cyc=0.016, attitude_covariance_rad2=1e-6)
    yield Method("the same, 8 signals jointly", _normal(SATS, 2, sigma=0.01), lambda z: joint_statistic(z, common))
    yield Method("array alone, 8 signals equal", _normal(SATS, 2, sigma=0.01), lambda z: equal_statistic(z, WHITE))
    angle_rad = arm_angles(150, 0.05 * np.pi)
    yield Method("spin as printed, 150 samples", _normal(150, sigma=0.01), lambda z: fit_pairs(z, angle_rad, **ARM))
    yield Method(
        "spin, whole series, 150 samples", _normal(150, sigma=0.01), lambda z: fit_whole_series(z, angle_rad, **ARM)
    )


def report() -> Iterator[str]:
    """Rows of the table."""
    yield f"nanoseconds a statistic, one core, {MANY} trials in one call beside {FEW} calls one by one"
    methods = list(_methods())
    for method in methods:
        yield _row(method)
    yield from _decomposition()
    yield from _sets()
    yield f"{DRAWS:.0e} draws and their statistics in one call, seconds"
    for method in methods:
        yield _all_at_once(method)
    yield from _maps()


def _row(method: Method) -> str:
    rng = np.random.default_rng(1)
    many, few = method.draw(MANY, rng), method.draw(FEW, rng)
    at_once, by_loop = take_turns(
        lambda: method.test(many), lambda: [method.test(item[None]) for item in few], runs=5, clock=process_time
    )
    at_once, by_loop = at_once * (1e9 / MANY / method.of_each), by_loop * (1e9 / FEW / method.of_each)
    times = by_loop.median / at_once.median
    return line(method.name, at_once, "ns", f"plain loop {by_loop.median:.3g} ns ({times:.0f} times)")


def _all_at_once(method: Method) -> str:
    """Where a trial is large a million of them would be gigabytes: then as many as make 400 MB, and said."""
    rng = np.random.default_rng(1)
    values = method.draw(1, rng).size
    draws = min(DRAWS, MOST_NUMBERS // values)
    begin = perf_counter()
    drawn = method.draw(draws, rng)
    made_s = perf_counter() - begin
    begin = perf_counter()
    method.test(drawn)
    took_s = perf_counter() - begin
    fewer = "" if draws == DRAWS else f"; {draws} draws of {values} numbers"
    return f"  {method.name:<42} {took_s:9.3g} s, beside {made_s:.3g} s to draw them{fewer}"


def _decomposition() -> Iterator[str]:
    rng = np.random.default_rng(1)
    delays, variance = delay_dictionary(RATE_HZ), float(noise_variance(45.0, 0.02, RATE_HZ))
    many = 2000
    first = rng.uniform(-0.2, 0.2, (many, 1))
    phase = np.exp(2j * np.pi * rng.random((many, 2)))
    taps = simulate_taps(np.concatenate((first, first + 0.25), axis=1), phase * [1.0, 0.87], variance, delays, rng)
    for name, test in (
        ("two signals, 5 Msps, variable projection", lambda t: decompose(t, delays, noise_variance=variance)),
        ("one signal or two", lambda t: count_statistic(t, delays, variance)),
    ):
        at_once, by_loop = take_turns(
            lambda test=test: test(taps),
            lambda test=test: [test(tap[None]) for tap in taps[:100]],
            runs=5,
            clock=process_time,
        )
        at_once, by_loop = at_once * (1e9 / many), by_loop * (1e9 / 100)
        times = by_loop.median / at_once.median
        yield line(name, at_once, "ns", f"plain loop {by_loop.median:.3g} ns ({times:.1f} times)")


def _sets() -> Iterator[str]:
    units = np.asarray(hemisphere(13)[:12])
    rng = np.random.default_rng(1)
    for satellites, signals in ((6, 2), (12, 3)):
        misfit_m = rng.standard_normal((satellites, signals))
        misfit_m[:, 1] -= 100.0 * (units[:satellites] @ np.array([0.6, 0.0, 0.8]))
        misfit_m[:, 2:] += rng.uniform(-300.0, 300.0, (satellites, signals - 2))
        pruned, exhaustive = take_turns(
            lambda n=satellites, m=misfit_m: [find_passing_sets(units[:n], m, 1.0) for _ in range(20)],
            lambda n=satellites, m=misfit_m: find_passing_sets(units[:n], m, 1.0, exhaustive=True),
            runs=9,
            clock=process_time,
        )
        pruned *= 1 / 20
        beside = f"exhaustive {1e3 * exhaustive.median:.3g} ms ({exhaustive.median / pruned.median:.0f} times)"
        yield line(f"sets that fit, {satellites} x {signals}: {signals**satellites}", pruned * 1e3, "ms", beside)


def _maps() -> Iterator[str]:
    """Every predicted block of 5 degrees against every received one, three antennas 5 wavelengths apart."""
    grid = blocks(5.0)
    design = array_design(CELLS_CYC)
    plain, wrapped = take_turns(
        lambda: measure_dead_zone(grid.direction, grid.direction, design, WHITE, weight=grid.share),
        lambda: measure_dead_zone(grid.direction, grid.direction, design, WHITE, weight=grid.share, wrapped=True),
        runs=3,
    )
    beside = f"with whole cycles unknown {wrapped.median:.3g} s; limit 2 s"
    yield line("dead zones of the whole sky, 5 x 5 degrees", plain, "s", beside)
