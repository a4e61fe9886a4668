"""Vector against scalar tracking, the same channels, loops and sums in both, through the whole receiver: at which C/N0
lock is lost, how far replicas go off in a blockage and under 2 g, and the fixes of two scenes.

`python bench/vector_limits.py lock` and so on for a part. Replicas are held against those of a receiver of the same
samples without what disturbs.
"""

import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from vector import PLACE, START_GPST, _in_memory, _tracked

from skyproof.app.common.settings import Settings
from skyproof.app.receive.reception import observe
from skyproof.app.receive.tracker import Workspace, _set_up_tracker
from skyproof.arrays import Floats, Reals
from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.signals import GPS_SATS
from skyproof.navigation.fix import fix
from skyproof.receiver import guidance as g
from skyproof.receiver.settings import LoopSettings
from skyproof.receiver.tracking import Receiver
from skyproof.records import Asked, NavigationData, Observations, Samples, SignalId
from skyproof.simulator import scenes
from skyproof.simulator.constellation import make_navigation
from skyproof.simulator.samples import render_samples
from skyproof.simulator.scenario import FrontEnd, Scenario

RATE_HZ, LEVEL_DBHZ, FROM_S = 1.6e6, 45.0, 7.0
FALL_DB_S, LOWEST_DBHZ, SEEDS = 1.5, 12.0, 2
BANDS_DBHZ = (36.0, 33.0, 30.0, 27.0, 24.0, 21.0, 18.0, 15.0, 12.0)
NUMBERS = (5, 10)
LOST_CHIPS, LOST_HZ = 0.5, 25.0
STEPS_DBHZ = (40.0, 34.0, 32.0, 31.0, 30.0, 28.0, 26.0, 24.0, 23.0, 22.0, 21.0, 20.0, 18.0)
BLOCKED_S = (2.0, 5.0, 10.0)
SCENE_S = 30.0
BOTH = ("scalar", "vector")
AGILE, AGILE_LOOPS = "scalar, 18 Hz", LoopSettings(integration=5, pll_bandwidth_hz=18.0, dll_bandwidth_hz=0.5)
"""A scalar receiver whose carrier loops stay as wide below 31 dB-Hz as 2 g asks for; others get 6 Hz there."""


class Replicas(NamedTuple):
    """Of every satellite each half second (steps, 32): what its replica shows, in seconds of code and hertz; NaN
    without a channel. measured : whether the last row of measurements has it."""

    at_s: Reals
    shown_s: Reals
    doppler_hz: Reals
    measured: Reals


def report(parts: tuple[str, ...] = ("lock", "steps", "blockage", "scenes")) -> Iterator[str]:
    """Rows of the table."""
    for part in parts:
        yield from {"lock": _lock, "blockage": _blockage, "steps": _steps, "scenes": _scenes}[part]()


def _sky(duration_s: float, satellites: int | None = None, level_dbhz: float = LEVEL_DBHZ) -> Scenario:
    scene = scenes.make_clean(
        PLACE,
        START_GPST,
        zenith_cn0_dbhz=level_dbhz,
        horizon_cn0_dbhz=level_dbhz,
        duration_s=duration_s,
        receivers=1,
        mask_deg=5.0,
        front_end=FrontEnd(rate_hz=RATE_HZ, bandwidth_hz=0.8 * RATE_HZ, encoding="int", bits=8),
        seed=3,
    )
    if satellites is None:
        return scene
    seen = _in_view(scene)
    return scene.model_copy(update={"sky": scene.sky.model_copy(update={"sats": seen[:satellites]})})


def _in_view(scene: Scenario) -> tuple[str, ...]:
    """Satellites of a scene, spread over the sky: every other one first."""
    samples, planes, navigation = _rendered(scene.model_copy(update={"duration_s": 2.0}))
    found = _followed(samples, planes, navigation, "scalar")
    sats = [GPS_SATS[k] for k in np.flatnonzero(np.isfinite(found.shown_s[-1]))]
    return (*sats[::2], *sats[1::2])


def _rendered(scene: Scenario) -> tuple[Samples, Floats, NavigationData]:
    navigation = make_nominal_constellation(START_GPST)
    samples = render_samples(scene, navigation)[0]
    return samples, samples.read(0, samples.n_samples), navigation


def _followed(samples: Samples, planes: Floats, navigation: NavigationData, tracking: str) -> Replicas:
    """A recording tracked, and its replicas on the way."""
    held = _in_memory(samples, planes)
    settings = Settings(tracking="scalar" if tracking == AGILE else tracking)
    tracker = _set_up_tracker(held, settings, navigation, False, Asked(), Workspace())
    if tracking == AGILE:
        own = tracker.receiver
        tracker.receiver = Receiver(own.rate_hz, own.if_hz, replace(own.settings, weak=AGILE_LOOPS))
    at_s, rows = [], []
    while tracker.advance():
        receiver, state = tracker.receiver, tracker.state
        now_s = tracker.examined_s
        row = np.full((3, len(GPS_SATS)), np.nan)
        mine = [i for i, channel in enumerate(state.channels) if channel.copy is not None]
        shown_s, doppler_hz = g.read_loops(
            state.loops[mine], now_s, rate_hz=receiver.rate_hz, if_hz=receiver.if_hz, signal=receiver.signal
        )
        measured = tracker.measured.whole()
        fresh = set(measured.arc[measured.elapsed_s > now_s - 0.45].tolist()) if measured.arc.size else set()
        for k, i in enumerate(mine):
            column = GPS_SATS.index(state.channels[i].sat)
            row[:, column] = shown_s[k], doppler_hz[k], state.channels[i].arc in fresh
        at_s.append(now_s)
        rows.append(row)
    table = np.array(rows)
    return Replicas(np.array(at_s), table[:, 0], table[:, 1], np.nan_to_num(table[:, 2]))


def _apart(found: Replicas, reference: Replicas) -> tuple[Reals, Reals]:
    """Code in chips, whatever whole periods, and Doppler in hertz, of one less the other."""
    late_ms = 1e3 * (found.shown_s - reference.shown_s)
    return 1023.0 * (late_ms - np.round(late_ms)), found.doppler_hz - reference.doppler_hz


# Lock -----------------------------------------------------------------------------------------------------------------


def _lock() -> Iterator[str]:
    yield (
        f"C/N0 of all signals falls by {FALL_DB_S:g} dB a second from {LEVEL_DBHZ:g} dB-Hz on, receiver at rest: root "
        f"mean square error of replicas by C/N0, and where they are {LOST_CHIPS:g} chip or {LOST_HZ:g} Hz off for good"
    )
    for n in NUMBERS:
        scene = _sky(FROM_S + (LEVEL_DBHZ - LOWEST_DBHZ) / FALL_DB_S, n)
        samples, planes, navigation = _rendered(scene)
        reference = _followed(samples, planes, navigation, "scalar")
        level = LEVEL_DBHZ - _fall(reference.at_s)
        on = np.isfinite(reference.shown_s[-1])
        for tracking in BOTH:
            code, carrier, lost, last = [], [], [], []
            for seed in range(SEEDS):
                found = _followed(samples, _weaker(planes, seed, _fall), navigation, tracking)
                code_chips, hz = (item[:, on] for item in _apart(found, reference))
                code.append(np.nan_to_num(code_chips, nan=LOST_CHIPS))
                carrier.append(np.nan_to_num(hz, nan=LOST_HZ))
                good = (np.abs(code_chips) < LOST_CHIPS) & (np.abs(hz) < LOST_HZ)
                lost += [level[np.flatnonzero(item)[-1]] for item in good.T]
                last += [level[np.flatnonzero(item)[-1]] for item in found.measured[:, on].T > 0.0]
            yield (
                f"  {on.sum():2} satellites, {tracking}: off for good at {np.mean(lost):.1f} dB-Hz (first "
                f"{max(lost):.1f}, last {min(lost):.1f}); measured down to {np.mean(last):.1f}"
            )
            bands = [(level > low) & (level <= low + 3.0) & (reference.at_s > FROM_S) for low in BANDS_DBHZ]
            chips, hz_rms = ([np.sqrt(np.mean(np.square(item)[:, band])) for band in bands] for item in (code, carrier))
            cells = zip(BANDS_DBHZ, chips, hz_rms, strict=True)
            yield "     " + ", ".join(f"{low + 1.5:.1f}: {293.05 * x:.1f} m {f:.2f} Hz" for low, x, f in cells)


def _fall(t_s: Reals) -> Reals:
    return FALL_DB_S * np.maximum(t_s - FROM_S, 0.0)


def _weaker(planes: Floats, seed: int, loss_db: Callable[[Reals], Reals]) -> Floats:
    """With noise added so that C/N0 is lower by so much at times (n,), and as strong as before all in all."""
    rng, sigma = np.random.default_rng(seed), float(planes[:, : round(RATE_HZ)].std())
    weaker, chunk = np.empty_like(planes), round(RATE_HZ)
    for first in range(0, planes.shape[-1], chunk):
        part = planes[:, first : first + chunk]
        t_s = np.arange(first, first + part.shape[-1]) / RATE_HZ
        gain = (10.0 ** (0.1 * loss_db(t_s))).astype(np.float32)
        noise = sigma * np.sqrt(gain - 1.0) * rng.standard_normal(part.shape, np.float32)
        weaker[:, first : first + chunk] = (part + noise) / np.sqrt(gain)
    return weaker


# Blockage and acceleration --------------------------------------------------------------------------------------------


def _blockage() -> Iterator[str]:
    yield (
        f"signals blocked from {FROM_S:g} s on: the blocked replicas' largest error at the end, code in m and Doppler "
        "in Hz; at rest, and speeding up by 2 g to 40 m/s half a second into it"
    )
    for moving in (False, True):
        for blocked_s in BLOCKED_S:
            scene = _sky(FROM_S + blocked_s + 0.5)
            if moving:
                scene = _speeding(scene, FROM_S + 0.5)
            samples, planes, navigation = _rendered(scene)
            reference = _followed(samples, planes, navigation, "scalar")
            sats = [GPS_SATS[k] for k in np.flatnonzero(np.isfinite(reference.shown_s[-1]))]
            for share in (0.5, 1.0):
                blocked = sats if share == 1.0 else sats[::2]
                held = _without(scene, samples, planes, navigation, sats, blocked, blocked_s)
                row = int(np.argmin(np.abs(reference.at_s - FROM_S - blocked_s)))
                on = [GPS_SATS.index(sat) for sat in blocked]
                cells = []
                for tracking in BOTH:
                    code_chips, hz = _apart(_followed(samples, held, navigation, tracking), reference)
                    gone = int(np.isnan(code_chips[row, on]).sum())
                    code_m = 293.05 * np.abs(code_chips[row, on])
                    cells.append(
                        f"{tracking} {np.nanmax(code_m):.1f} m, {np.nanmax(np.abs(hz[row, on])):.1f} Hz"
                        + (f", {gone} given up" if gone else "")
                    )
                how = "2 g" if moving else "at rest"
                yield f"  {len(blocked):2} of {len(sats)} for {blocked_s:4.0f} s, {how}: {'; '.join(cells)}"


def _speeding(scene: Scenario, start_s: float) -> Scenario:
    receiver = scene.receivers[0]
    path = {
        "kind": "way-points",
        "points_enu_m": [[0.0, 0.0, 0.0], [4000.0, 1500.0, 0.0]],
        "speed_m_s": 40.0,
        "acceleration_m_s2": 19.6,
        "start_s": start_s,
        "to_rest": False,
    }
    table = receiver.model_dump(exclude_unset=True) | {"path": path}
    return scene.model_copy(update={"receivers": (type(receiver).model_validate(table),)})


def _without(
    scene: Scenario,
    samples: Samples,
    planes: Floats,
    navigation: NavigationData,
    sats: list[str],
    blocked: list[str],
    blocked_s: float,
) -> Floats:
    gone = slice(round(FROM_S * samples.rate_hz), round((FROM_S + blocked_s) * samples.rate_hz))
    held, remaining = planes.copy(), tuple(sat for sat in sats if sat not in blocked)
    if remaining:
        sky = scene.sky.model_copy(update={"sats": remaining})
        rest = render_samples(scene.model_copy(update={"sky": sky}), navigation)[0]
        held[:, gone] = rest.read(gone.start, gone.stop - gone.start)
    else:
        held[:, gone] = np.random.default_rng(0).normal(0.0, planes.std(), (2, gone.stop - gone.start))
    return held


def _steps() -> Iterator[str]:
    yield (
        f"{LEVEL_DBHZ:g} dB-Hz, from {FROM_S:g} s on as stated; a second later speeding up by 2 g to 40 m/s, then on "
        f"to 16 s, {SEEDS} noises: share of channels within {LOST_CHIPS:g} chip and {LOST_HZ:g} Hz at the end, their "
        "largest error of code on the way, and the C/N0 at which half of them are lost"
    )
    for n in NUMBERS:
        samples, planes, navigation = _rendered(_speeding(_sky(16.0, n), FROM_S + 1.0))
        reference = _followed(samples, planes, navigation, "scalar")
        rows, on = reference.at_s > FROM_S + 1.0, np.isfinite(reference.shown_s[-1])
        for tracking in (*BOTH, AGILE):
            cells, shares = [], []
            for level in STEPS_DBHZ:
                held, worst = [], [0.0]
                for seed in range(SEEDS):
                    weaker = _weaker(planes, seed, lambda t_s, to=level: np.where(t_s < FROM_S, 0.0, LEVEL_DBHZ - to))
                    found = _followed(samples, weaker, navigation, tracking)
                    code_chips, hz = (item[rows][:, on] for item in _apart(found, reference))
                    good = (np.abs(code_chips[-1]) < LOST_CHIPS) & (np.abs(hz[-1]) < LOST_HZ)
                    held += good.tolist()
                    worst += np.nanmax(np.abs(code_chips[:, good]), axis=0).tolist()
                shares.append(float(np.mean(held)))
                cells.append(f"{level:g}: {shares[-1]:.2f} {293.05 * max(worst):.1f} m")
            half = f"half lost at {_half_lost_dbhz(np.array(shares)):.1f} dB-Hz"
            yield f"  {on.sum():2} satellites, {tracking}, {half}: {', '.join(cells)}"


def _half_lost_dbhz(shares: Reals) -> float:
    """Where the share of channels that are held, by level as in `STEPS_DBHZ`, last falls below a half; NaN where it
    never does."""
    held = np.flatnonzero(shares >= 0.5)
    if not held.size or held[-1] + 1 == shares.size:
        return float("nan")
    i, levels = int(held[-1]), np.array(STEPS_DBHZ)
    return float(np.interp(0.5, shares[[i + 1, i]], levels[[i + 1, i]]))


# Scenes ---------------------------------------------------------------------------------------------------------------


def _scenes() -> Iterator[str]:
    yield f"fixes of the first receiver of a scene, {SCENE_S:g} s: how many, and their error, median and largest"
    for name in ("multipath", "jamming"):
        scene = scenes.read_ready_made(name)
        at = scene.receivers[0]
        scene = scene.model_copy(update={"duration_s": SCENE_S, "receivers": (at,)})
        navigation = make_navigation(scene)
        samples = render_samples(scene, navigation)[0]
        held = _in_memory(samples, samples.read(0, samples.n_samples))
        place_m = ecef_from_geodetic(np.radians(at.lat_deg), np.radians(at.lon_deg), at.height_m)
        for tracking in BOTH:
            tracker, _ = _tracked(held, navigation, tracking)
            observations = observe(tracker, navigation).observations
            assert observations is not None
            o = observations.read(0, observations.gpst.size)
            off_m = np.linalg.norm(fix(o, navigation, signals=_strongest(o)).position_ecef_m - place_m, axis=1)
            known = np.isfinite(off_m)
            yield (
                f"  {name}, {tracking}: {known.sum()} of {known.size}; {np.median(off_m[known]):.2f} m, "
                f"{off_m[known].max():.2f} m; {np.isfinite(o.pseudorange_m).sum()} ranges"
            )


def _strongest(o: Observations) -> tuple[SignalId, ...]:
    """One signal of each satellite, strong and measured for long: a reflection may be followed beside it."""
    of_sat: dict[str, tuple[float, SignalId]] = {}
    for signal, cn0_dbhz in zip(o.signals, np.nansum(o.cn0_dbhz, axis=0), strict=True):
        of_sat[signal.sat] = max(of_sat.get(signal.sat, (0.0, signal)), (float(cn0_dbhz), signal))
    return tuple(signal for _, signal in of_sat.values())


if __name__ == "__main__":
    for text in report(*filter(None, [tuple(sys.argv[1:])])):
        print(text, flush=True)
