"""Studies of "GNSS Spoofing Detection and Exclusion by Decomposition of Complex Cross Ambiguity Function (DCCAF) with
INS Aiding" (Ahmed, Khanafseh, Pervan)."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from skyproof.detectors.decomposition import (
    Dictionary,
    blocks_dictionary,
    correlation,
    count_statistic,
    count_test,
    decompose,
    delay_bound,
    delay_dictionary,
    noise_variance,
    simulate_taps,
)
from skyproof.detectors.swarm import SwarmSettings, swarm_decompose
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.navigation.exclusion import choose_fix, wrong_choice_probability, wrong_choice_rule
from skyproof.navigation.ins_errors import error_covariance, start_covariance
from skyproof.navigation.strapdown import strapdown_paths
from skyproof.records import NavState
from skyproof.simulate.inertial import GRADES, ImuGrade, inertial
from skyproof.simulate.trajectories import las_vegas
from skyproof.statistics.gauss_markov import gauss_markov_step
from skyproof.studies.base import Chart, Claim, Row, Settings, Study

__all__ = ["STUDIES"]

Reals = NDArray[np.float64]
Complexes = NDArray[np.complex128]

PAPER: Final = (
    "Ahmed, Khanafseh, Pervan, decomposition of the cross-ambiguity function with inverse RAIM and inertia"
)
AMPLITUDES: Final = np.array([1.0, 0.87])
POWER_DB: Final = float(20.0 * np.log10(AMPLITUDES[1]))
_CLOSE_CHIPS: Final = 0.05  # both delays within this: success


# Separation -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class _Case:
    rate_hz: float
    separation_chip: float = 0.25
    cn0_dbhz: float = 45.0
    coherent_ms: float = 20.0
    doppler_hz: float | None = 0.0
    """Of the second signal from the first; None where both are known and wiped off."""


_SEPARATIONS: Final = (
    *(_Case(rate_hz=rate) for rate in (5e6, 10e6, 25e6, 50e6)),
    *(_Case(rate_hz=5e6, separation_chip=d) for d in (0.1, 0.15, 0.2, 0.5)),
    *(_Case(rate_hz=10e6, separation_chip=d) for d in (0.05, 0.1, 0.15)),
    *(_Case(rate_hz=25e6, separation_chip=d) for d in (0.05, 0.1)),
    *(_Case(rate_hz=rate, cn0_dbhz=cn0) for rate in (5e6, 25e6) for cn0 in (40.0, 42.0, 48.0)),
    *(_Case(rate_hz=rate, coherent_ms=ms) for rate in (5e6, 25e6) for ms in (1.0, 4.0, 10.0, 100.0)),
)
_SWARMS: Final = ((100, 300), (200, 600))
_BLOCKS: Final = 10


def separation(settings: Settings) -> Iterator[Row]:
    """Two signals, random phases and places between the samples: how often both are found, and how well."""
    rng = settings.rng()
    for case in _SEPARATIONS[:4] if settings.quick else _SEPARATIONS:
        yield _projection(case, settings.count(3000, 600), rng, unknown_doppler=False)
    for case in (_Case(rate_hz=5e6, doppler_hz=3.0), _Case(rate_hz=25e6, doppler_hz=3.0)):
        yield _projection(case, settings.count(250, 15), rng, unknown_doppler=True)
    for rate_hz in (5e6, 25e6):
        for particles, iterations in _SWARMS[:1] if settings.quick else _SWARMS:
            for known in (True, False):
                if settings.quick and not known:
                    continue
                yield _swarmed(_Case(rate_hz=rate_hz), settings.count(100, 40), rng, particles, iterations, known)


def _signals(n: int, separation_chip: float, rng: np.random.Generator) -> tuple[Reals, Complexes]:
    first = rng.uniform(-0.2, 0.2, (n, 1))
    delay = np.concatenate((first, first + separation_chip), axis=1)
    swapped = np.where(rng.random((n, 1)) < 0.5, AMPLITUDES, AMPLITUDES[::-1])  # either may come first
    return delay, swapped * np.exp(2j * np.pi * rng.random((n, 2)))


def _projection(case: _Case, trials: int, rng: np.random.Generator, *, unknown_doppler: bool) -> Row:
    delays, coherent_s = delay_dictionary(case.rate_hz), 1e-3 * case.coherent_ms
    variance = noise_variance(case.cn0_dbhz, coherent_s, case.rate_hz)
    delay, amplitude = _signals(trials, case.separation_chip, rng)
    blocks, hertz = None, np.zeros((trials, 2))
    if unknown_doppler:
        blocks = blocks_dictionary(coherent_s, _BLOCKS, within_hz=60.0)
        hertz = rng.uniform(-20.0, 20.0, (trials, 1)) + np.array([0.0, case.doppler_hz or 0.0])
        turn = np.exp(2j * np.pi * hertz[:, None, :] * blocks.points[:, None])
        turn *= np.sinc(hertz[:, None, :] * coherent_s / _BLOCKS) / np.sqrt(_BLOCKS)
        shape = (trials, _BLOCKS, 2)
        taps = simulate_taps(np.broadcast_to(delay[:, None, :], shape), amplitude[:, None, :] * turn,
                             np.full(shape[:2], variance), delays, rng)  # fmt: skip
    else:
        taps = simulate_taps(delay, amplitude, variance, delays, rng)
    decompose(taps[:1], delays, blocks, noise_variance=variance)  # compiled and read from the cache before it is timed
    begin = time.process_time()
    found = decompose(taps, delays, blocks, noise_variance=variance)
    took_s = time.process_time() - begin
    bound = delay_bound(delay, amplitude, variance, delays, blocks, hertz)
    method = "variable projection, Dopplers unknown" if unknown_doppler else "variable projection"
    return _row(method, case, found.delay_chips - delay, bound, took_s)


def _swarmed(
    case: _Case, trials: int, rng: np.random.Generator, particles: int, iterations: int, known: bool
) -> Row:  # fmt: skip
    """The paper's method, on a window of one chip to both sides and, where Dopplers are unknown, five bins of 25 Hz."""
    delays, coherent_s = delay_dictionary(case.rate_hz), 1e-3 * case.coherent_ms
    variance = noise_variance(case.cn0_dbhz, coherent_s, case.rate_hz)
    delay, amplitude = _signals(trials, case.separation_chip, rng)
    near = np.abs(delays.points) <= 1.0
    bins = np.zeros(1) if known else 25.0 * np.arange(-2.0, 3.0)
    grid = _grid(delay, amplitude, bins, coherent_s, float(variance), delays, rng)[:, :, near]
    options: dict[str, Any] = {"bins_hz": bins, "coherent_s": coherent_s, "band_hz": case.rate_hz, "rng": rng}
    swarm = SwarmSettings(particles=particles, iterations=iterations, within_hz=0.0 if known else 1.0 / coherent_s)
    swarm_decompose(grid[:1], delays.points[near], settings=replace(swarm, iterations=1), **options)
    begin = time.process_time()
    found = swarm_decompose(grid, delays.points[near], settings=swarm, **options)
    took_s = time.process_time() - begin
    bound = delay_bound(delay, amplitude, variance, delays)
    method = f"swarm {particles} x {iterations}, {'6' if known else '8'} unknowns"
    return _row(method, case, found.delay_chips - delay, bound, took_s)


def _grid(
    delay: Reals, amplitude: Complexes, bins_hz: Reals, coherent_s: float, variance: float, delays: Dictionary,
    rng: np.random.Generator,
) -> Complexes:  # fmt: skip
    """Grids (n, bins, taps) of signals at zero Doppler, with noise correlated over both."""
    n = len(delay)
    along = np.sum(
        amplitude[..., None] * correlation(delays.points - delay[..., None], delays.band_hz), axis=1
    )  # fmt: skip
    noise = simulate_taps(np.zeros((n, bins_hz.size, 1)), np.zeros((n, bins_hz.size, 1)),
                          np.full((n, bins_hz.size), variance), delays, rng)  # fmt: skip
    values, vectors = np.linalg.eigh(np.sinc((bins_hz[:, None] - bins_hz) * coherent_s))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    return np.asarray(np.sinc(bins_hz * coherent_s)[:, None] * along[:, None, :] + root @ noise)


def _row(method: str, case: _Case, error: Reals, bound: Reals, took_s: float) -> Row:
    """crlb_chip is the root of the mean bound over the trials and both signals: what rms_chip can be at best."""
    trials, n = error.shape
    return {
        "method": method, "rate_hz": case.rate_hz, "separation_chip": case.separation_chip, "cn0_dbhz": case.cn0_dbhz,
        "coherent_ms": case.coherent_ms, "power_db": POWER_DB, "doppler_hz": case.doppler_hz,
        "success": float(np.mean(np.all(np.abs(error) < _CLOSE_CHIPS, axis=1))),
        "rms_chip": float(np.sqrt(np.mean(error**2))),
        "crlb_chip": float(np.sqrt(np.mean(np.diagonal(bound, axis1=1, axis2=2)[:, :n]))),
        "ms_per_satellite": 1e3 * took_s / trials, "trials": trials,
    }  # fmt: skip


# Count ----------------------------------------------------------------------------------------------------------------


def count(settings: Settings) -> Iterator[Row]:
    """One signal: how often two are counted; and two signals: how often they are.

    noise: "thermal" is known; "other satellites" raise it by 20 % unseen; "estimated" from 100 values of the noise that
    there is, raised, which mends that.
    """
    rng = settings.rng()
    n = settings.count(100_000, 4000)
    for rate_hz in (5e6,) if settings.quick else (5e6, 25e6):
        delays = delay_dictionary(rate_hz)
        law = count_test(delays, rng, runs=n)
        variance = float(noise_variance(45.0, 0.02, rate_hz))
        one = rng.uniform(-0.5, 0.5, (n, 1)), np.exp(2j * np.pi * rng.random((n, 1)))
        for noise, raised, samples in (
            ("thermal", 1.0, None), ("other satellites", 1.2, None), ("estimated", 1.2, 100)
        ):  # fmt: skip
            if settings.quick and noise == "other satellites":
                continue
            told: Any = variance
            if samples is not None:
                told = variance * raised * rng.chisquare(2 * samples, n) / (2 * samples)
            statistic = _statistics(*one, raised * variance, told, delays, rng)
            p_value = replace(law, noise_samples=samples).p_value(statistic)
            for asked in (0.1, 0.01, 0.001):
                yield {
                    "case": "one signal", "rate_hz": rate_hz, "noise": noise, "separation_chip": None,
                    "p_fa_asked": asked, "threshold": float(replace(law, noise_samples=samples).threshold(asked)),
                    "counted_as_two": float(np.mean(p_value < asked)), "trials": n,
                }  # fmt: skip
        for separation_chip in (0.02, 0.03, 0.05, 0.1, 0.15, 0.25):
            trials = settings.count(4000, 300)
            two = _signals(trials, separation_chip, rng)
            p_value = law.p_value(_statistics(*two, variance, variance, delays, rng))
            yield {
                "case": "two signals", "rate_hz": rate_hz, "noise": "thermal", "separation_chip": separation_chip,
                "p_fa_asked": 0.001, "threshold": float(law.threshold(0.001)),
                "counted_as_two": float(np.mean(p_value < 0.001)), "trials": trials,
            }  # fmt: skip


def _statistics(
    delay: Reals, amplitude: Complexes, variance: float, told: Any, delays: Dictionary, rng: np.random.Generator
) -> Reals:
    parts = []
    told = np.broadcast_to(told, len(delay))
    for begin in range(0, len(delay), 5000):
        part = slice(begin, begin + 5000)
        taps = simulate_taps(delay[part], amplitude[part], variance, delays, rng)
        parts.append(count_statistic(taps, delays, told[part])[0])
    return np.concatenate(parts)


# Exclusion ------------------------------------------------------------------------------------------------------------

_OFFSET_ENU_M: Final = np.array([1.0, 0.0, 1.0]) * np.sqrt(0.5)
_FIX_SIGMA_M: Final = np.array([1.5, 1.5, 3.0])
_MOMENTS_S: Final = (100, 190, 233)
_RATE_HZ: Final = 2.0  # of the readings: the approach is straight, 0.4 mm are lost


@dataclass(frozen=True, kw_only=True)
class _Start:
    position_m: float = 0.0
    velocity_m_s: float = 0.0
    tilt_deg: float = 0.0


def _table_only(grade: ImuGrade) -> ImuGrade:
    return replace(grade, accelerometer_repeatability_m_s2=0.0, gyro_repeatability_rad_s=0.0)


_MOVING: Final = _Start(position_m=1.0, velocity_m_s=0.05)
_UNITS: Final[dict[tuple[str, str], tuple[ImuGrade, _Start]]] = {
    (name, errors): unit
    for name, tilt_deg, calibrated_deg in (("navigation", 0.01, 0.003), ("tactical", 0.1, 0.02))
    for errors, unit in (
        ("table 1", (_table_only(GRADES[name]), _Start())),
        ("table 1, start", (_table_only(GRADES[name]), _MOVING)),
        ("calibrated, start", (GRADES[f"{name}-calibrated"], replace(_MOVING, tilt_deg=calibrated_deg))),
        ("switch-on, start", (GRADES[name], replace(_MOVING, tilt_deg=tilt_deg))),
    )
}


def exclusion(settings: Settings) -> Iterator[Row]:
    """The Las Vegas approach on a free-running unit: its drift, and which of the true and the false fix it chooses.

    The false fix is 1 m/s up-east from 90 s on, 100 m away from 190 s on. Both have noise of (1.5, 1.5, 3) m.
    """
    rng = settings.rng()
    runs = settings.count(6000, 500)
    seconds = np.arange(0.0, 234.0)
    motion = las_vegas().at(seconds)
    path = NavState(time_s=seconds, position_ecef_m=motion.position_ecef_m, velocity_ecef_m_s=motion.velocity_ecef_m_s,
                    attitude=motion.attitude)  # fmt: skip
    to_enu = rot_enu_ecef(*geodetic_from_ecef(motion.position_ecef_m[0])[:2])
    for (name, errors), (grade, start) in _UNITS.items():
        drift_m = np.concatenate([
            _drift(path, grade, start, min(1000, runs - begin), to_enu, rng) for begin in range(0, runs, 1000)
        ])  # fmt: skip
        first = start_covariance(grade, position_m=start.position_m, velocity_m_s=start.velocity_m_s,
                                 tilt_rad=float(np.radians(start.tilt_deg)))  # fmt: skip
        predicted = to_enu @ error_covariance(path, grade, first)[:, :3, :3] @ to_enu.T
        for k, moment_s in enumerate(_MOMENTS_S):
            yield _exclusion_row(name, errors, moment_s, drift_m[:, k], predicted[moment_s], rng)


def _drift(
    path: NavState, grade: ImuGrade, start: _Start, runs: int, to_enu: Reals, rng: np.random.Generator
) -> Reals:
    """Errors of position (runs, moments, 3), east, north, up, of units that begin at the path's first state."""
    unit = inertial(las_vegas().at, rate_hz=_RATE_HZ, duration_s=float(path.time_s[-1]))
    true = unit.read(0, unit.n_samples)
    force = true.specific_force_m_s2 + _sensor_errors(
        grade.accelerometer_repeatability_m_s2, grade.accelerometer_instability_m_s2,
        grade.velocity_random_walk_m_s_rts, grade.correlation_s, runs, unit.n_samples, rng,
    )  # fmt: skip
    rate = true.angular_rate_rad_s + _sensor_errors(
        grade.gyro_repeatability_rad_s, grade.gyro_instability_rad_s, grade.angular_random_walk_rad_rts,
        grade.correlation_s, runs, unit.n_samples, rng,
    )  # fmt: skip
    turn = np.radians(start.tilt_deg) * rng.standard_normal((runs, 3))
    tilted = path.attitude[0] + np.cross(turn[:, None, :], path.attitude[0].T).swapaxes(-1, -2)
    tilted, _ = np.linalg.qr(tilted)
    tilted = tilted * np.sign(np.sum(tilted * path.attitude[0], axis=1, keepdims=True))  # a rotation near it again
    places, _, _ = strapdown_paths(
        path.position_ecef_m[0] + start.position_m * rng.standard_normal((runs, 3)),
        path.velocity_ecef_m_s[0] + start.velocity_m_s * rng.standard_normal((runs, 3)),
        tilted, force, rate, 1.0 / _RATE_HZ, gravity_reach_m=2000.0,
    )  # fmt: skip
    moments = [round(moment_s * _RATE_HZ) for moment_s in _MOMENTS_S]
    return np.asarray((places[:, moments] - path.position_ecef_m[list(_MOMENTS_S)]) @ to_enu.T)


def _sensor_errors(
    repeatability: float, instability: float, walk: float, correlation_s: float, runs: int, n: int,
    rng: np.random.Generator,
) -> Reals:  # fmt: skip
    """Errors (runs, n, 3) of readings: constant, Gauss-Markov and white."""
    step = gauss_markov_step(instability, correlation_s, 1.0 / _RATE_HZ)
    keep = float(step.keep)
    at_start = instability * rng.standard_normal((runs, 1, 3))
    drive = float(step.drive) * rng.standard_normal((runs, n, 3))
    later, _ = lfilter([1.0], [1.0, -keep], drive, axis=1, zi=keep * at_start)
    slow = np.concatenate((at_start, later), axis=1)
    means = (slow[:, 1:] + slow[:, :-1]) * float(step.half) * _RATE_HZ
    spread = np.hypot(float(step.spread) * _RATE_HZ, walk * np.sqrt(_RATE_HZ))
    constant = repeatability * rng.standard_normal((runs, 1, 3))
    return np.asarray(constant + means + spread * rng.standard_normal((runs, n, 3)))


def _exclusion_row(
    name: str, errors: str, moment_s: float, drift_m: Reals, predicted_m2: Reals, rng: np.random.Generator
) -> Row:
    runs = len(drift_m)
    offset_m = min(max(moment_s - 90.0, 0.0), 100.0) * _OFFSET_ENU_M
    fixes = np.stack((np.zeros((runs, 3)), np.broadcast_to(offset_m, (runs, 3))), axis=1)
    fixes = fixes + _FIX_SIGMA_M * rng.standard_normal((runs, 2, 3))
    fix_covariance = np.diag(_FIX_SIGMA_M**2)
    choice = choose_fix(drift_m, predicted_m2, fixes, fix_covariance)
    apart = drift_m[:, None, :] - fixes
    nearest = np.argmin(np.sum(apart**2, axis=-1), axis=-1)
    horizontal = np.argmin(np.sum(apart[..., :2] ** 2, axis=-1), axis=-1)
    sigma_m, expected_m = np.sqrt(np.mean(drift_m**2, axis=0)), np.sqrt(np.diag(predicted_m2))
    return {
        "grade": name, "errors": errors, "time_s": moment_s, "offset_m": float(np.linalg.norm(offset_m)),
        "east_m": float(sigma_m[0]), "north_m": float(sigma_m[1]), "up_m": float(sigma_m[2]),
        "east_predicted_m": float(expected_m[0]), "north_predicted_m": float(expected_m[1]),
        "up_predicted_m": float(expected_m[2]), "wrong_nearest": float(np.mean(nearest)),
        "wrong_horizontal": float(np.mean(horizontal)), "wrong_covariance": float(np.mean(choice.nearest)),
        "wrong_predicted": float(wrong_choice_probability(offset_m, predicted_m2, fix_covariance)),
        "wrong_rule": float(wrong_choice_rule(offset_m, predicted_m2 + fix_covariance)),
        "chosen_wrong": float(np.mean(choice.chosen == 1)), "undecided": float(np.mean(choice.chosen == -1)),
        "trials": runs,
    }  # fmt: skip


# What is claimed ------------------------------------------------------------------------------------------------------


def _value(column: str, **where: Any) -> Callable[[Sequence[Row]], float]:
    def found(rows: Sequence[Row]) -> float:
        for row in rows:
            if all(row[key] == value for key, value in where.items()):
                return float(row[column])
        return float("nan")  # not among the rows of a quick run

    return found


def _ratio(**where: Any) -> Callable[[Sequence[Row]], float]:
    rms, bound = _value("rms_chip", **where), _value("crlb_chip", **where)
    return lambda rows: rms(rows) / bound(rows)


_NOT_STATED: Final = "not stated"
_USUAL: Final = {"separation_chip": 0.25, "cn0_dbhz": 45.0, "coherent_ms": 20.0}
_OURS: Final = {"method": "variable projection", **_USUAL}
_SWARM: Final = {"method": "swarm 200 x 600, 6 unknowns", **_USUAL}

STUDIES: tuple[Study, ...] = (
    Study(
        name="dccaf.separation", title="Two signals a fraction of a chip apart", paper=PAPER,
        figure="Case 1", run=separation,
        charts=(
            Chart(title="Both delays within 0.05 chip, 45 dB-Hz, 20 ms", x="separation_chip", y="success",
                  x_label="separation, chip", y_label="success", by=("method", "rate_hz"),
                  where={"cn0_dbhz": 45.0, "coherent_ms": 20.0}),
            Chart(title="Both delays within 0.05 chip, 0.25 chip, 20 ms", x="cn0_dbhz", y="success",
                  x_label="C/N0, dB-Hz", y_label="success", by=("rate_hz",),
                  where={"method": "variable projection", "separation_chip": 0.25, "coherent_ms": 20.0}),
        ),
        claims=tuple(
            claim for rate_hz, success, ratio, swarm in
            ((5e6, 0.997, 1.00, 0.75), (10e6, 1.0, 1.02, None), (25e6, 1.0, 1.04, 0.84))
            for claim in (
                Claim(what=f"success, 0.25 chip, 45 dB-Hz, 20 ms, {rate_hz / 1e6:g} Msps (same: swarm, 6 unknowns)",
                      paper=_NOT_STATED, reference=swarm, tolerance=None if swarm is None else 0.13,
                      same=None if swarm is None else _value("success", rate_hz=rate_hz, **_SWARM),
                      better=_value("success", rate_hz=rate_hz, **_OURS)),
                Claim(what=f"RMS over the Cramer-Rao bound, the same, {rate_hz / 1e6:g} Msps", paper=_NOT_STATED,
                      reference=ratio, better=_ratio(rate_hz=rate_hz, **_OURS)),
            )
        ),
    ),
    Study(
        name="dccaf.count", title="One signal or two", paper=PAPER, figure="Case 2", run=count,
        charts=(Chart(title="Counted as two at 0.1 % false second signals", x="separation_chip", y="counted_as_two",
                      x_label="separation, chip", y_label="share", by=("rate_hz",), where={"case": "two signals"}),),
        claims=tuple(
            Claim(what=f"false second signals at {asked:g} asked, 5 Msps, noise {noise}", paper="no test is given",
                  reference=asked, better=_value("counted_as_two", case="one signal", rate_hz=5e6, noise=noise,
                                                 p_fa_asked=asked))
            for noise in ("thermal", "estimated") for asked in (0.01, 0.001)
        ),
    ),
    Study(
        name="dccaf.exclusion", title="Which fix is true: the free-running unit decides", paper=PAPER,
        figure="Figures 11 and 14", run=exclusion,
        charts=(
            Chart(title="Drift to the east", x="time_s", y="east_m", x_label="time, s", y_label="1 sigma, m",
                  by=("grade", "errors"), y_log=True),
            Chart(title="Wrong choice by covariance", x="time_s", y="wrong_predicted", x_label="time, s",
                  y_label="probability", by=("grade", "errors")),
        ),
        claims=tuple(
            claim for grade, errors, drift, tolerance, wrong in (
                ("navigation", "table 1", 2.5, 0.2, 0.0), ("navigation", "calibrated, start", 19.0, 1.5, 6e-4),
                ("navigation", "switch-on, start", 49.0, 4.0, 8e-3), ("tactical", "table 1", 92.0, 5.0, 2.4e-3),
                ("tactical", "table 1, start", 93.0, 5.0, 0.02), ("tactical", "calibrated, start", 182.0, 18.0, 0.26),
                ("tactical", "switch-on, start", 686.0, 60.0, 0.43),
            )
            for claim in (
                Claim(what=f"{grade} grade, {errors}: drift east at 233 s, m", paper="a picture", reference=drift,
                      same=_value("east_m", grade=grade, errors=errors, time_s=233), tolerance=tolerance),
                Claim(what=f"{grade} grade, {errors}: wrong choice at 233 s by distance (same) and covariance (better)",
                      paper="a picture", reference=wrong,
                      same=_value("wrong_nearest", grade=grade, errors=errors, time_s=233),
                      better=_value("wrong_covariance", grade=grade, errors=errors, time_s=233)),
            )
        ),
    ),
)
