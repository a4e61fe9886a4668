"""Vector tracking: false alarms of its correlators through the whole receiver, what it costs beside scalar tracking,
what a blockage does to either, and which satellites `vector_sqm` names.

`python bench/vector.py alarms` and so on for a part.
"""

import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import count, islice
from time import process_time
from typing import Any

import numpy as np
from timing import Spread, line

from skyproof.app.common.settings import Settings
from skyproof.app.receive.reception import observe
from skyproof.app.receive.tracker import Tracker, Workspace, _set_up_tracker
from skyproof.arrays import Complexes, Floats, Reals
from skyproof.detectors.correlators.correlator_laws import phase_discriminator
from skyproof.detectors.correlators.vector_parity import build_whitener, parity_test, parity_vector
from skyproof.detectors.correlators.vector_sqm import satellite_geometry
from skyproof.detectors.correlators.vector_sqm_detector import (
    VectorSqm,
    VectorSqmSettings,
    compute_directions,
    select_pair,
    t_squared_survival,
)
from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.navigation.vector_filter import VectorSettings
from skyproof.receiver import measurement as m
from skyproof.records import Asked, Finding, NavigationData, Records, Samples, Taps, TapsAsked
from skyproof.simulator import scenes
from skyproof.simulator.constellation import make_navigation
from skyproof.simulator.samples import render_samples
from skyproof.simulator.scenario import FrontEnd, Scenario, ScenePlace
from skyproof.studies.discriminator_laws import (
    code_discriminator,
    code_sigma_chips,
    combine_taps,
    phase_sigma_rad,
    prompt_amplitude,
)
from skyproof.studies.vector_loops import draw_taps
from skyproof.studies.vector_rules import (
    Equilibrium,
    detection_probability,
    equilibrium,
    rule_alarm_probability,
    two_step,
)
from skyproof.testing import MeasuredScene

START_GPST = np.datetime64("2024-05-14T09:59:58", "ns")
PLACE = ScenePlace(lat_deg=57.7, lon_deg=11.94, height_m=50.0)
EVERY_MS = Asked(taps=TapsAsked(delays_chips=(0.5, -0.5), every_s=1e-3, coherent_s=1e-3))
EVERY_20_MS = Asked(taps=TapsAsked(delays_chips=(0.5, -0.5), every_s=0.02, coherent_s=0.004))
JUDGED_S = 24.0
LEVELS_DBHZ, ALARM_S = (40.0, 45.0), 31.0
COST_RATE_HZ, COST_S, COST_FROM_S, RUNS = 5e6, 10.0, 6.0, 3
BLOCKED_S = (2.0, 5.0, 10.0)
NUMBERS = (6, 8, 10)
DRAWS, SKIES, WINDOW_S, LOOK_S, LOOKED_S = 200, 20, 4.0, 0.02, 0.004


def report(parts: tuple[str, ...] = ("cost", "alarms", "blockage", "judge", "named")) -> Iterator[str]:
    """Rows of the table."""
    for part in parts:
        yield from {"cost": _cost, "alarms": _alarms, "blockage": _blockage, "judge": _judge, "named": _named}[part]()


def _in_memory(samples: Samples, planes: Floats) -> Samples:
    return replace(samples, read=lambda first, count: planes[:, first : first + count])


def _tracked(
    samples: Samples,
    navigation: NavigationData,
    tracking: str,
    asked: Asked | None = None,
    from_s: float = 0.0,
    not_driving: tuple[str, ...] = (),
    filter_settings: VectorSettings | None = None,
) -> tuple[Tracker, float]:
    """A recording tracked to its end, and the processor's time from `from_s` on."""
    settings = Settings(tracking=tracking, not_driving=not_driving)
    tracker = _set_up_tracker(samples, settings, navigation, False, asked or Asked(), Workspace())
    if tracker.vector is not None and filter_settings is not None:
        tracker.vector = replace(tracker.vector, settings=filter_settings)
    begin = process_time()
    while tracker.advance():
        if tracker.examined_s <= from_s:
            begin = process_time()
    return tracker, process_time() - begin


def _cost() -> Iterator[str]:
    yield f"vector over scalar tracking, {COST_RATE_HZ / 1e6:g} Msps, the same channels, once both are under way"
    for mask_deg in (25.0, 10.0):
        scenario = _clean(COST_S, COST_RATE_HZ, mask_deg)
        samples = render_samples(scenario, make_nominal_constellation(START_GPST))[0]
        held = _in_memory(samples, samples.read(0, samples.n_samples))
        took: dict[str, list[float]] = {"scalar": [], "vector": []}
        for _ in range(RUNS + 1):
            for tracking, seconds in took.items():
                tracker, cpu_s = _tracked(held, make_nominal_constellation(START_GPST), tracking, from_s=COST_FROM_S)
                seconds.append(cpu_s)
        n = len(tracker.state.channels)
        cells = n * (COST_S - COST_FROM_S) * COST_RATE_HZ * 1e-9
        for tracking, seconds in took.items():
            beside = f"{min(took['vector'][1:]) / min(took['scalar'][1:]):.2f} of scalar, least of each"
            spread = Spread.of([one / cells for one in seconds[1:]])
            yield line(f"{tracking}, {n} channels", spread, "ns a sample", beside if tracking == "vector" else "")


def _clean(duration_s: float, rate_hz: float, mask_deg: float = 10.0, seed: int = 3) -> Scenario:
    return scenes.make_clean(
        PLACE,
        START_GPST,
        duration_s=duration_s,
        receivers=1,
        mask_deg=mask_deg,
        front_end=FrontEnd(rate_hz=rate_hz, bandwidth_hz=0.8 * rate_hz, encoding="int", bits=8),
        seed=seed,
    )


# False alarms ---------------------------------------------------------------------------------------------------------


def _alarms() -> Iterator[str]:
    yield f"false alarms through the receiver, {ALARM_S:g} s at 10 Msps, six satellites, windows of K ms"
    for level in LEVELS_DBHZ:
        scene = scenes.read_ready_made("vector-one-spoofer")
        assert scene.sky.directions is not None
        sats = tuple(direction.sat for direction in scene.sky.directions)
        sky = scene.sky.model_copy(update={"sats": sats, "zenith_cn0_dbhz": level, "horizon_cn0_dbhz": level})
        front_end = FrontEnd(rate_hz=10e6, bandwidth_hz=8e6, encoding="int", bits=8)
        scenario = scene.model_copy(update={"sky": sky, "attacks": (), "duration_s": ALARM_S, "front_end": front_end})
        navigation = make_navigation(scenario)
        tracker, _ = _tracked(render_samples(scenario, navigation)[0], navigation, "vector", EVERY_MS)
        reception = observe(tracker, navigation)
        assert reception.vector_taps is not None
        assert reception.observations is not None
        taps = reception.vector_taps.select_between(0.0, ALARM_S)
        o = reception.observations.read(0, reception.observations.gpst.size)
        there = compute_directions(o, navigation, taps.signals, VectorSqmSettings())
        assert there is not None
        cn0_dbhz = np.nanmedian(o.cn0_dbhz, axis=0)
        yield from _counted(f"{level:g} dB-Hz", _three(taps), cn0_dbhz, there.design)


def _three(taps: Taps, channels: list[int] | slice = slice(None)) -> Complexes:
    """(looks, n, 3) early, prompt, late of the looks in which all of these channels were guided."""
    pair = select_pair(taps)
    assert pair is not None
    value = taps.value[:, channels, 0][..., list(pair[1:])].astype(np.complex128)
    return value[np.isfinite(value).all(axis=(1, 2))]


def _counted(name: str, value: Complexes, cn0_dbhz: Reals, design: Reals) -> Iterator[str]:
    for sums in (1, 10):
        blocks = value[: len(value) // sums * sums].reshape(-1, sums, *value.shape[1:])
        summed = combine_taps(blocks, axis=1)
        u, q = code_discriminator(summed[..., 0], summed[..., 2]), phase_discriminator(summed[..., 1])
        amplitude = prompt_amplitude(cn0_dbhz, sums)
        beyond = (np.abs(u) > 0.1) | (np.abs(q) > 0.05 * np.pi)
        one, rule = detection_probability(amplitude).mean(), rule_alarm_probability(amplitude, 0.0, 0.0)
        counted = two_step(u, q).alarm.mean()
        yield (
            f"  {name}, K = {sums:<3} {len(u):6} windows: one satellite {beyond.mean():.4f} (theory {one:.4f}), "
            f"the largest {counted:.4f} (theory {rule:.4f}); sd of code {u.std(axis=0).mean():.4f} "
            f"({code_sigma_chips(amplitude).mean():.4f}), of phase {q.std(axis=0).mean():.4f} "
            f"({phase_sigma_rad(amplitude).mean():.4f})"
        )
    parity = satellite_geometry(design).parity
    u, q = code_discriminator(value[..., 0], value[..., 2]), phase_discriminator(value[..., 1])
    for looks in (100, 500):
        p_values = []
        for first in range(0, len(u) - looks + 1, looks):
            rows = slice(first, first + looks)
            sigmas = (x[rows].std(axis=0, ddof=1) / np.sqrt(looks) for x in (u, q))
            white = build_whitener(parity, *sigmas)
            y = parity_vector(u[rows].mean(axis=0), q[rows].mean(axis=0), white, scores=False)
            p_values.append(t_squared_survival(float(parity_test(y).statistic), y.size, looks))
        found = np.array(p_values)
        rates = ", ".join(f"{np.mean(found < p):.4f} at {p:g}" for p in (0.1, 0.01))
        yield f"  {name}, T^2 of {looks} ms, {found.size} windows, no allowance for errors that stay: {rates}"


# Blockage -------------------------------------------------------------------------------------------------------------


def _blockage() -> Iterator[str]:
    yield "blockage from 7 s on, 2.6 Msps, receiver at rest: of the blocked signals, s until measured again, new arcs,"
    yield "largest error of the first code after it over the sigma that it states"
    for share in (0.5, 1.0):
        for blocked_s in BLOCKED_S:
            yield from _blocked(share, blocked_s)


def _blocked(share: float, blocked_s: float) -> Iterator[str]:
    scenario = _clean(7.0 + blocked_s + 3.0, 2.6e6)
    navigation = make_nominal_constellation(START_GPST)
    samples = render_samples(scenario, navigation)[0]
    planes = samples.read(0, samples.n_samples)
    gone = slice(round(7.0 * samples.rate_hz), round((7.0 + blocked_s) * samples.rate_hz))
    reference, _ = _tracked(_in_memory(samples, planes), navigation, "scalar")
    sats = sorted({arc.signal.sat for arc in reference.arcs.values()})
    blocked = sats if share == 1.0 else sats[::2]
    remaining = tuple(sat for sat in sats if sat not in blocked)
    if remaining:
        sky = scenario.sky.model_copy(update={"sats": remaining})
        planes[:, gone] = render_samples(scenario.model_copy(update={"sky": sky}), navigation)[0].read(
            gone.start, gone.stop - gone.start
        )
    else:
        planes[:, gone] = np.random.default_rng(0).normal(0.0, planes.std(), (2, gone.stop - gone.start))
    clean = observe(reference, navigation).observations
    assert clean is not None
    truth = clean.read(0, clean.gpst.size)
    for tracking in ("scalar", "vector"):
        tracker, _ = _tracked(_in_memory(samples, planes), navigation, tracking)
        rows = tracker.measured.whole()
        back_s, errors = [], []
        for sat in blocked:
            arcs = [number for number, arc in tracker.arcs.items() if arc.signal.sat == sat]
            after = np.flatnonzero(np.isin(rows.arc, arcs) & (rows.elapsed_s > 7.0 + blocked_s - 0.05))
            if not after.size:
                back_s.append(np.inf)
                continue
            row = after[0]
            back_s.append(rows.elapsed_s[row] - 7.0 - blocked_s)
            again = np.flatnonzero(np.abs(truth.elapsed_s - rows.elapsed_s[row]) < 0.05)
            column = [signal.sat for signal in truth.signals].index(sat)
            known = tracker.arcs[int(rows.arc[row])].tow_ms_at_period_0 is not None
            if again.size and known:
                found = observe(tracker, navigation).observations
                assert found is not None
                o = found.read(0, found.gpst.size)
                matching = [signal.sat for signal in o.signals].index(sat)
                apart_m = o.pseudorange_m[again[0], matching] - truth.pseudorange_m[again[0], column]
                errors.append(abs(apart_m) / (3e8 * rows.table[row, m.CODE_SIGMA_S]))
        new = sum(arc.began != "found" for arc in tracker.arcs.values())
        yield (
            f"  {tracking:<8} {len(blocked)} of {len(sats)} for {blocked_s:4.0f} s: {np.median(back_s):5.1f} "
            f"(last {max(back_s):.1f}); {new} new arcs; {max(errors, default=np.nan):.1f} sigma"
        )


# Judge ----------------------------------------------------------------------------------------------------------------


def _judge() -> Iterator[str]:
    yield (
        f"{JUDGED_S:g} s of vector-one-spoofer at 2.6 Msps: the false one drives the filter, or not; second half, "
        "mean offsets of true signals, and the error of the position"
    )
    front_end = FrontEnd(rate_hz=2.6e6, bandwidth_hz=2.4e6, encoding="int", bits=8)
    scene = scenes.read_ready_made("vector-one-spoofer").model_copy(
        update={"duration_s": JUDGED_S, "front_end": front_end}
    )
    navigation = make_navigation(scene)
    samples = render_samples(scene, navigation)[0]
    held = _in_memory(samples, samples.read(0, samples.n_samples))
    false = tuple(sorted({sat for attack in scene.attacks for sat in attack.sats or ()}))
    at = scene.receivers[0]
    place_m = ecef_from_geodetic(np.radians(at.lat_deg), np.radians(at.lon_deg), at.height_m)
    for barred in ((), false):
        tracker, _ = _tracked(held, navigation, "vector", EVERY_20_MS, not_driving=barred)
        reception = observe(tracker, navigation)
        assert reception.vector_taps is not None
        assert tracker.vector is not None
        guided = "no filter"
        if (filtered := tracker.vector.filter) is not None:
            guided = f"{np.linalg.norm(filtered.mean[:3] - place_m):.1f} m"
        taps = reception.vector_taps.select_between(0.5 * JUDGED_S, JUDGED_S)
        true = [k for k, signal in enumerate(taps.signals) if signal.sat not in false]
        value = _three(taps, true)
        u, q = code_discriminator(value[..., 0], value[..., 2]), phase_discriminator(value[..., 1])
        worst = f"{np.abs(u.mean(axis=0)).max():.3f} chip, {np.abs(q.mean(axis=0)).max():.3f} rad"
        yield f"  without {' '.join(barred) or 'none':<11}: {worst} at most; {guided}"


# Which satellite ------------------------------------------------------------------------------------------------------


def _named() -> Iterator[str]:
    settings = VectorSqmSettings(false_alarm_probability=1e-4)
    yield (
        f"named by vector_sqm, {DRAWS} draws a row of settled correlators, three windows of {WINDOW_S:g} s, onset in "
        "the second, 0.05 to 1 chip, 5 to 500 Hz, 38 to 50 dB-Hz; names of the third; delays in s, median and 95 %"
    )
    rng = np.random.default_rng(0)
    for n in NUMBERS:
        drawn = (_sky(n, np.random.default_rng([n, k])) for k in count())
        skies = list(islice((sky for sky in drawn if len(sky.records(rng).observations[0].signals) == n), SKIES))
        for attacked in (0, 1, 2, 3):
            yield _drawn(skies, attacked, settings, np.random.default_rng([n, attacked]))


def _sky(n: int, rng: np.random.Generator) -> MeasuredScene:
    """Somewhere, some time."""
    return MeasuredScene(
        antennas_enu_m={"rx1": (0.0, 0.0, 0.0)},
        epochs=3,
        max_satellites=n,
        mask_deg=5.0,
        place_deg=(float(rng.uniform(-60.0, 60.0)), float(rng.uniform(-180.0, 180.0)), 100.0),
        start_gpst=np.datetime64("2022-01-01T12:00:00", "ns") + np.timedelta64(int(rng.integers(600)), "m"),
    )


def _drawn(skies: list[MeasuredScene], attacked: int, settings: VectorSqmSettings, rng: np.random.Generator) -> str:
    lost = 0
    counted = Counter[str]()
    word_s, seen_s = [], []
    for draw in range(DRAWS):
        records = skies[draw % len(skies)].records(rng)
        (o,) = records.observations
        assert records.navigation is not None
        there = compute_directions(o, records.navigation, o.signals, settings)
        assert there is not None
        n, level = len(o.signals), rng.uniform(38.0, 50.0)
        hit = rng.permutation(n)[:attacked]
        code, doppler = np.zeros(n), np.zeros(n)
        code[hit] = rng.uniform(0.05, 1.0, attacked) * rng.choice([-1.0, 1.0], attacked)
        doppler[hit] = rng.uniform(5.0, 500.0, attacked) * rng.choice([-1.0, 1.0], attacked)
        # The loops' correction is that of 1 ms whatever they sum, which is no less than a look does.
        offsets = equilibrium(satellite_geometry(there.design), code, doppler, level + 10.0 * np.log10(LOOKED_S / 1e-3))
        if not all(np.isfinite(item).all() for item in offsets) or np.abs(offsets.code_chips).max() > 0.5:
            lost += 1
            continue
        evidence, onset_s = _examined(records, offsets, level, settings, rng)
        names = tuple(str(o.signals[k]) for k in sorted(hit))
        first = next((k for k, item in enumerate(evidence) if item.failed), None)
        if first is None:
            continue
        counted["noticed"] += 1
        word_s.append((first + 1) * WINDOW_S - onset_s)
        seen: Any = evidence[first].data
        if "seen_s" in seen:
            seen_s.append(seen["seen_s"] - onset_s)
        last: Any = evidence[-1].data
        suspects, size = last.get("suspects", ()), last.get("set_size", 0)
        if last.get("sets") == 1 and size:
            true_named = not set(suspects) <= set(names)
            counted["wrong" if true_named else "right" if size == attacked else "part"] += 1
        else:
            counted["several"] += 1
            counted["among"] += any(suspects[k : k + size] == names for k in range(0, len(suspects), max(size, 1)))
    delays = ", ".join(
        f"{name} {np.median(item):.1f}, {np.quantile(item, 0.95):.1f}"
        for name, item in (("word", word_s), ("seen", seen_s))
        if item
    )
    return (
        f"  {attacked} of {skies[0].max_satellites:2}: {lost:3} without an equilibrium; of {DRAWS - lost} others "
        f"{counted['noticed']} noticed, {counted['right']} rightly named, {counted['part']} in part, "
        f"{counted['wrong']} wrongly, {counted['several']} open (the true ones among {counted['among']}); "
        f"{delays or 'no delay'}"
    )


def _examined(
    records: Records, offsets: Equilibrium, level: float, settings: VectorSqmSettings, rng: np.random.Generator
) -> tuple[list[Finding], float]:
    """Three windows, and when the attack begins in the second."""
    detector, state, findings = VectorSqm(settings), None, []
    n, looks = offsets.code_chips.size, round(WINDOW_S / LOOK_S)
    amplitude = prompt_amplitude(level, coherent_s=LOOKED_S)
    onset = looks + int(rng.integers(looks))
    on = (np.arange(3 * looks) >= onset)[:, None]
    value = draw_taps(rng, (3 * looks, n), amplitude, on * offsets.code_chips, on * offsets.phase_rad) / amplitude
    for k in range(3):
        taps = Taps(
            receiver=records.observations[0].receiver,
            signals=records.observations[0].signals,
            elapsed_s=LOOK_S * np.arange(k * looks, (k + 1) * looks),
            delays_chips=np.array([0.5, 0.0, -0.5]),
            dopplers_hz=np.zeros(1),
            value=value[k * looks : (k + 1) * looks, :, None, :].astype(np.complex64),
        )
        evidence, state = detector.examine(replace(records, vector_taps=(taps,)), state)
        findings += evidence
    return findings, onset * LOOK_S


if __name__ == "__main__":
    for text in report(tuple(sys.argv[1:]) or ("cost", "alarms", "blockage", "judge", "named")):
        print(text, flush=True)
