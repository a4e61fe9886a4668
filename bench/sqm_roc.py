"""The signal quality metrics of the literature on correlators of a scalar receiver: false alarms, detection, delay.

`python bench/sqm_roc.py`. Correlators at 0, +-1/8 and +-1/2 chip (and 25 Hz to either side) of 20 ms of a true signal
and a second one of its satellite, sharp chips, noise correlated as theirs is; a code loop of 1 Hz follows their sum, a
phase loop holds it. Metrics are means over a second against their exact law (`ratio_deviate`), with the code loop's own
jitter, and delta's variance over a second against its own. Powers, speeds and carriers of the second signal are those
of the scenes that rows are named after, by satellite: the scenes' samples are not run. Eight satellites; a receiver
alarms when one of them does at an eighth of the level.

`python bench/sqm_roc.py receiver takeover texbat-like-3` : the same metrics on correlators of the whole receiver, its
loops, front end and search as they are, behind drawn correlators; no law fits a front end's peak, so that each signal's
mean and scatter are those of its own seconds before the onset, and rates those counted in as many clean runs.
"""

import sys
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from held import SCENES as HELD
from held import scene_named
from scipy import special

from skyproof.app.common.settings import Settings
from skyproof.app.scenes.simulate import load_scenario
from skyproof.arrays import Complexes, Reals
from skyproof.detectors.correlators.correlator_laws import triangle
from skyproof.gnss.constants import CA_CHIP_RATE_HZ, L1_HZ, SPEED_OF_LIGHT_M_S
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.simulator.received import Scene
from skyproof.simulator.sky import make_scene
from skyproof.studies import quality_metrics as sqm
from skyproof.studies.correlator_model import receive_antenna

LOOK_S, LOOKS, ALIGNED_S, SATELLITES, RECEIVERS = 0.02, 50, 5, 8, 25
DELAYS = np.array([0.5, 0.125, 0.0, -0.125, -0.5])
OFFSET_HZ, LOOP_HZ = 25.0, 1.0
CHIP_M = SPEED_OF_LIGHT_M_S / CA_CHIP_RATE_HZ
LEVELS = (1e-2, 1e-3, 1e-4)
NAMES = ("delta", "ratio", "magnitude", "slow-fast", "variance")


class Second(NamedTuple):
    """A second signal: power over the true one; metres a second by which it leaves it, the largest or (`common`) of
    all; whether its carrier goes with its code; metres by which it is off from the beginning, and its phase's rate."""

    power_db: float
    speed_m_s: float = 0.0
    common: bool = False
    follows: bool = True
    off_m: tuple[float, float] = (0.0, 0.0)
    beat_hz: float = 0.0
    seconds: int = 45


SCENES = {
    "takeover": Second(4.0, 10.5),
    "static-austin": Second(0.0, 1.0, seconds=105),
    "texbat-like-2": Second(10.0, 5.0, common=True),
    "texbat-like-3": Second(1.3, 5.0, common=True, follows=False),
    "texbat-like-4": Second(0.4, 5.0, follows=False),
    "reflections": Second(-6.0, off_m=(30.0, 150.0), beat_hz=0.2),
}


def report() -> Iterator[str]:
    """Rows of the table."""
    yield f"no second signal, share of seconds below 0.01, 0.001: {', '.join(NAMES)}"
    for level_dbhz in (35.0, 40.0, 45.0, 50.0):
        p = _p_values(None, level_dbhz, 1000)
        yield f"  {level_dbhz:g} dB-Hz: " + _shares(p, LEVELS[:2])
    yield f"45 dB-Hz, seconds from the pull on: share below {', '.join(f'{one:g}' for one in LEVELS)}"
    for name, second in SCENES.items():
        p = _p_values(second, 45.0, second.seconds)
        yield f"  {name}: " + _shares(p[:, :, ALIGNED_S:], LEVELS)
        by_receiver = p.reshape(len(NAMES), RECEIVERS, SATELLITES, -1).min(axis=2) < 1e-3 / SATELLITES
        yield "    receiver at 0.001, first alarm: " + "; ".join(
            f"{metric} {_first(alarm)}" for metric, alarm in zip(NAMES, by_receiver, strict=True)
        )


def _shares(p: Reals, levels: tuple[float, ...]) -> str:
    return "; ".join(
        f"{metric} " + " ".join(f"{np.mean(item < level):.4f}" for level in levels)
        for metric, item in zip(NAMES, p, strict=True)
    )


def _first(alarm: np.ndarray) -> str:
    """Of (receivers, seconds): alarms while aligned, and the median of the seconds from the pull on to the first."""
    before = alarm[:, :ALIGNED_S].any(axis=1).mean()
    after = alarm[:, ALIGNED_S:]
    found = after.any(axis=1)
    at_s = np.where(found, after.argmax(axis=1) + 1.0, np.inf)
    return f"{found.mean():.2f}, median {np.median(at_s):.0f} s (before the pull {before:.2f})"


def _p_values(second: Second | None, level_dbhz: float, seconds: int) -> Reals:
    """(metrics, tracks, seconds)."""
    rng = np.random.default_rng(7)
    n = RECEIVERS * SATELLITES if second is not None else SATELLITES
    found = [_second_by_second(track) for track in _tracks(rng, n, second, level_dbhz, seconds)]
    return np.stack(found, axis=-1)


def _tracks(
    rng: np.random.Generator, n: int, second: Second | None, level_dbhz: float, seconds: int
) -> Iterator[tuple[Complexes, Complexes]]:
    """Of each second the correlators (looks, n, 5) and those slow and fast (looks, n, 2), unit noise a component."""
    amplitude = np.sqrt(2.0 * LOOK_S * 10.0 ** (0.1 * level_dbhz))
    ratio = 0.0 if second is None else 10.0 ** (0.05 * second.power_db)
    one = second or Second(0.0)
    speed_m_s = one.speed_m_s * (np.ones(n) if one.common else rng.uniform(-1.0, 1.0, n))
    off_m, phase_cyc = rng.uniform(*one.off_m, n), rng.uniform(0.0, 1.0, n)
    mixed, code, angle = np.linalg.cholesky(sqm.tap_covariance(DELAYS)), np.zeros(n), np.zeros(n)
    side = np.sinc(OFFSET_HZ * LOOK_S)
    sides = np.linalg.cholesky(np.eye(2) - side**2 + 1e-12 * np.eye(2))
    for at in range(seconds):
        taps, slow_fast = np.empty((LOOKS, n, 5), complex), np.empty((LOOKS, n, 2), complex)
        for look in range(LOOKS):
            pulled = at + look * LOOK_S >= ALIGNED_S
            hz = -speed_m_s / SPEED_OF_LIGHT_M_S * L1_HZ if one.follows and pulled else 0.0
            hz = np.broadcast_to(hz + one.beat_hz, (n,))
            off_m = off_m + (speed_m_s * LOOK_S if pulled else 0.0)
            phase_cyc = phase_cyc + hz * LOOK_S
            later = ratio * np.exp(2j * np.pi * phase_cyc) * np.sinc(hz * LOOK_S)
            # Replica ahead by `code`; a tap at a delay of d is ahead by d more.
            true, false = (triangle(code[:, None] + DELAYS - s[:, None]) for s in (np.zeros(n), off_m / CHIP_M))
            value = amplitude * (true + later[:, None] * false)
            turn = np.exp(-1j * np.angle(value[:, 2]))
            own_hz = np.angle(turn.conj() * np.exp(-1j * angle)) / (2.0 * np.pi * LOOK_S) if at + look else 0.0 * code
            angle = -np.angle(turn)
            noise = (rng.standard_normal((n, 5)) + 1j * rng.standard_normal((n, 5))) @ mixed.T
            taps[look] = value * turn[:, None] + noise
            more = (rng.standard_normal((n, 2)) + 1j * rng.standard_normal((n, 2))) @ sides.T
            for k, offset_hz in enumerate((-OFFSET_HZ, OFFSET_HZ)):
                first = true[:, 2] * np.sinc((-own_hz - offset_hz) * LOOK_S)
                other = (
                    ratio * np.exp(2j * np.pi * phase_cyc) * false[:, 2] * np.sinc((hz - own_hz - offset_hz) * LOOK_S)
                )
                slow_fast[look, :, k] = amplitude * turn * (first + other) + side * noise[:, 2] + more[:, k]
            prompt = taps[look, :, 2]
            error = np.real((taps[look, :, 1] - taps[look, :, 3]) * prompt.conj()) / np.abs(prompt) ** 2 / 2.0
            code = code + 4.0 * LOOP_HZ * LOOK_S * np.clip(error, -0.5, 0.5)
        yield taps, slow_fast


def _second_by_second(track: tuple[Complexes, Complexes]) -> Reals:
    """(metrics, n) p-values of one second; amplitudes are what prompts show."""
    taps, slow_fast = (np.sqrt(LOOKS) * item.mean(axis=0) for item in track)
    early, prompt, late = taps[:, 0], taps[:, 2], taps[:, 4]
    jitter_chips = sqm.code_jitter_chips(LOOP_HZ, 0.125, np.abs(prompt) / np.sqrt(LOOKS), LOOK_S)
    lost = 0.0, 2.0 * np.sqrt(2.0 / np.pi) * jitter_chips  # on the mean over a second half of it, give or take
    delta, doppler = sqm.delta_law(0.5), sqm.doppler_law(OFFSET_HZ, LOOK_S)
    of_looks = sqm.delta_metric(track[0][..., 0], track[0][..., 2], track[0][..., 4])
    deviates = (
        sqm.ratio_deviate(sqm.delta_metric(early, prompt, late), prompt, delta),
        sqm.ratio_deviate(sqm.ratio_metric(early, prompt, late), prompt, *(sqm.ratio_law(0.5, item) for item in lost)),
        sqm.ratio_deviate(sqm.magnitude_difference(early, prompt, late), prompt, delta),
        sqm.ratio_deviate(sqm.doppler_metric(slow_fast[:, 0], prompt, slow_fast[:, 1]), prompt, doppler),
    )
    variance = sqm.ratio_deviate(of_looks, track[0][..., 2], delta).var(axis=0, ddof=1)
    return np.stack(
        [
            *(2.0 * special.ndtr(-np.abs(item)) for item in deviates),
            sqm.moving_variance_p_value(variance, 1.0, LOOKS),
        ]
    )


# Through the receiver -------------------------------------------------------------------------------------------------

SETTLED_S, LEARNT_S, CLEAN_RUNS = 3, 8, 3
RECEIVED = ("delta", "ratio", "magnitude", "variance")
RATES = (0.01,)


def received(names: tuple[str, ...]) -> Iterator[str]:
    """Rows of the table: share of seconds after the pull above what so many of the clean ones exceed, and delays."""
    for name in names:
        scene = scene_named(name, short=True) if name in HELD else _scene_of(name)
        (attack,) = scene.scenario.attacks
        pull_s = min(point[0] for point in [*attack.away_points_enu_m, *attack.clock_points_s])  # type: ignore[union-attr]
        quiet = make_scene(scene.scenario.model_copy(update={"attacks": ()}), scene.navigation)
        clean = np.concatenate([_scores(quiet, seed) for seed in range(1, 1 + CLEAN_RUNS)], axis=1)
        attacked = _scores(scene, 1)
        yield f"{name}: {clean.shape[1]} clean seconds of a receiver, {attacked.shape[1]} with an onset, a pull later"
        for k, metric in enumerate(RECEIVED):
            at_s = SETTLED_S + LEARNT_S + 0.5 + np.arange(attacked.shape[1])
            pulled = attacked[k, at_s > pull_s]
            cells = []
            for rate in RATES:
                limit = np.quantile(clean[k], 1.0 - rate)
                over = np.flatnonzero((attacked[k] > limit) & (at_s > attack.onset_s))
                late_s = at_s[over[0]] + 0.5 - attack.onset_s if over.size else np.inf
                cells.append(f"at {rate:g}: {np.mean(pulled > limit):.2f}, first {late_s:.0f} s after the onset")
            area = np.mean(pulled[:, None] > clean[k][None])
            yield f"  {metric:<9} {'; '.join(cells)}; area {area:.3f}"


def _scene_of(name: str) -> Scene:
    scenario = load_scenario(name)
    return make_scene(scenario, make_nominal_constellation(scenario.start_gpst))


def _scores(scene: Scene, seed: int) -> Reals:
    """(metrics, seconds) of a receiver: the largest deviation of any signal over its own scatter in
    its first seconds."""
    reception = receive_antenna(scene, 0, Settings(), scene.navigation, np.random.default_rng(seed))
    (taps,) = [] if reception.taps is None else [reception.taps.select_between(SETTLED_S, scene.scenario.duration_s)]
    at = [int(np.argmin(np.abs(taps.delays_chips - delay))) for delay in (0.5, 0.0, -0.5)]
    first = [k for k, signal in enumerate(taps.signals) if signal.copy == "a"]
    seconds = int(taps.elapsed_s[-1]) - SETTLED_S
    looks = np.full((seconds, LOOKS, len(first), 3), np.nan, complex)
    for second in range(seconds):
        rows = np.flatnonzero((taps.elapsed_s >= SETTLED_S + second) & (taps.elapsed_s < SETTLED_S + second + 1))[
            :LOOKS
        ]
        looks[second, : rows.size] = taps.value[rows][:, first, 0][..., at]
    mean = looks.mean(axis=1)
    early, prompt, late = mean[..., 0], mean[..., 1], mean[..., 2]
    values = np.stack(
        [
            sqm.delta_metric(early, prompt, late),
            sqm.ratio_metric(early, prompt, late),
            sqm.magnitude_difference(early, prompt, late),
            np.log(sqm.delta_metric(looks[..., 0], looks[..., 1], looks[..., 2]).var(axis=1)),
        ]
    )
    learnt = values[:, :LEARNT_S]
    deviates = np.abs(values - learnt.mean(axis=1, keepdims=True)) / learnt.std(axis=1, ddof=1, keepdims=True)
    return np.asarray(np.nanmax(np.where(np.isfinite(deviates), deviates, 0.0), axis=2)[:, LEARNT_S:])


if __name__ == "__main__":
    chosen = sys.argv[1:]
    for text in received(tuple(chosen[1:])) if chosen[:1] == ["receiver"] else report():
        print(text, flush=True)
