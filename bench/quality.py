"""Correlators as evidence: false alarms of `sqm` over hours of clean sky, what reflections do to it, its power on a
takeover, and what its correlators cost the receiver.

Correlators come from the simulator in closed form, tracked without error; the receiver's own are counted where a whole
recording is received.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from time import process_time

import numpy as np
from scipy import stats
from timing import Spread, line

from skyproof.app.common.settings import Settings
from skyproof.app.receive.tracker import track
from skyproof.detectors.correlators.second_component import combine_smallest, distortion
from skyproof.detectors.correlators.sqm_detector import Sqm, SqmSettings
from skyproof.explain import stands_beside
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.records import Finding, Records, Taps
from skyproof.simulator import FrontEnd, ScenePlace, make_clean, scenes
from skyproof.simulator.correlators import correlate
from skyproof.simulator.samples import render_samples
from skyproof.simulator.scenario import Multipath, Scenario
from skyproof.simulator.sky import make_scene
from skyproof.simulator.tracked import align_channels

START_GPST = np.datetime64("2024-05-14T09:59:58", "ns")
PLACE = ScenePlace(lat_deg=57.7, lon_deg=11.94, height_m=50.0)
LEVELS_DBHZ = (35.0, 38.75, 42.5, 46.25, 50.0)
HOURS, SKIES = 0.5, 4
CITIES = 20
WINDOW_S = 10.0
TAPS = Sqm.asks.taps
assert TAPS is not None
DELAYS_CHIPS = (0.125, 0.0, -0.125, *TAPS.delays_chips)
OF_A_RUN = 1e-3 * WINDOW_S / 3600.0 / 5.0
"""What `protect` allows a window of one receiver, by default."""
RATE_HZ, TRACKED_S, RUNS = 2.6e6, 12.0, 5


def report() -> Iterator[str]:
    """Rows of the table."""
    yield from _clean()
    yield from _reflections()
    yield from _takeover()
    yield from _cost()


def _clean() -> Iterator[str]:
    hours = len(LEVELS_DBHZ) * HOURS * SKIES
    yield f"clean sky, {hours:g} h of correlators, windows of {WINDOW_S:g} s, 0.001 a window asked for"
    for level in LEVELS_DBHZ:
        scenario = make_clean(
            PLACE,
            START_GPST,
            duration_s=HOURS * 3600.0,
            zenith_cn0_dbhz=level,
            horizon_cn0_dbhz=level,
            receivers=1,
            mask_deg=20.0,
            seed=3,
            front_end=FrontEnd(rate_hz=4e6, bandwidth_hz=3.2e6),
        )
        counts, p_values, named = Counter[str](), list[float](), 0
        rng = np.random.default_rng(int(level))
        for taps in (t for _ in range(SKIES) for t in _windows(scenario, "a", HOURS * 3600.0, rng)):
            counts.update(map(_word, _said([taps], SqmSettings())))
            exact = _exact(taps)
            named += any(combine_smallest(p, len(exact)) < SqmSettings().false_alarm_probability for p in exact)
            p_values += exact
        uniform = stats.kstest(p_values, "uniform").pvalue
        yield (
            f"  {level:g} dB-Hz, {counts.total()} windows: attack {counts['attack']}, open {counts['open']}, named "
            f"{counts['named']}; named {named} without allowance for multipath; p-values of {len(p_values)} signals: "
            f"{np.mean(np.array(p_values) < 0.01):.4f} below 0.01, uniform by Kolmogorov-Smirnov {uniform:.2f}"
        )


def _exact(taps: Taps) -> list[float]:
    """p-values of the signals tracked throughout, no reflection allowed."""
    value = taps.value[:, np.isfinite(taps.value).all(axis=(0, 2, 3)), 0]
    return [distortion(value[:, k], taps.delays_chips, TAPS.every_s).p_value for k in range(value.shape[1])]


def _reflections() -> Iterator[str]:
    yield f"reflections and no attack, {OF_A_RUN:.1g} a window asked for"
    ready = scenes.read_ready_made("multipath")
    for receiver in range(2):
        said = _said(_windows(ready, "a", ready.duration_s, np.random.default_rng(1), receiver))
        yield f"  scene multipath, {ready.receivers[receiver].name}: {_counted(said)}"
    rng = np.random.default_rng(2)
    street = [e for _ in range(CITIES) for e in _said(_windows(_city(rng), "a", 120.0, rng))]
    yield f"  all satellites reflected, -15 to -3 dB, 20 to 400 m, beats to 20 Hz: {_counted(street)}"


def _city(rng: np.random.Generator) -> Scenario:
    """A reflection of its own for every satellite."""
    ready = scenes.read_ready_made("multipath")
    rays = tuple(
        Multipath(
            delay_m=rng.uniform(20.0, 400.0),
            power_db=rng.uniform(-15.0, -3.0),
            rate_hz=rng.uniform(-20.0, 20.0),
            sats=(f"G{prn:02d}",),
        )
        for prn in range(1, 33)
    )
    return ready.model_copy(update={"receivers": (ready.receivers[0].model_copy(update={"multipath": rays}),)})


def _takeover() -> Iterator[str]:
    yield f"scene takeover, from 30 s on drawn away by 10.5 m/s, 4 dB stronger; {OF_A_RUN:.1g} a window asked for"
    ready = scenes.read_ready_made("takeover")
    for copy, tracked in (("a", "true"), ("b", "false")):
        for start_s in (10.0, 20.0, 30.0, 35.0, 40.0, 45.0, 50.0):
            said = [
                e
                for seed in range(5)
                for e in _said(_windows(ready, copy, 10.0, np.random.default_rng(seed), start_s=start_s))
            ]
            yield f"  {tracked} signals tracked, from {start_s:g} s: {_counted(said)}"


def _cost() -> Iterator[str]:
    scenario = make_clean(
        PLACE,
        START_GPST,
        duration_s=TRACKED_S,
        receivers=1,
        mask_deg=10.0,
        seed=3,
        front_end=FrontEnd(rate_hz=RATE_HZ, encoding="int", bits=8),
    )
    navigation = make_nominal_constellation(START_GPST)
    (samples,) = render_samples(scenario, navigation)
    planes = samples.read(0, samples.n_samples)
    (held,) = [samples.__class__(**{**vars(samples), "read": lambda start, n: planes[:, start : start + n]})]

    def tracked(taps: bool) -> tuple[float, float]:
        begin = process_time()
        (tracker,), _ = track([held], Settings(), asked=Sqm.asks if taps else None)
        cpu_s = process_time() - begin
        return cpu_s, len(tracker.measured) * tracker.epoch_s * RATE_HZ

    tracked(False), tracked(True)
    ns: dict[bool, list[float]] = {False: [], True: []}
    for _ in range(RUNS):
        for taps in (False, True):
            cpu_s, cells = tracked(taps)
            ns[taps].append(cpu_s * 1e9 / cells)
    yield f"tracking at {RATE_HZ / 1e6:g} Msps, search included, CPU a sample and channel"
    plain = Spread.of(ns[False])
    yield line("early, prompt and late", plain, "ns")
    further = Spread.of(ns[True])
    more = further.least / plain.least - 1.0
    yield line(f"and {len(TAPS.delays_chips)} taps in looks", further, "ns", f"{more:+.1%}, least of each")
    (window,) = _windows(scenario, "a", WINDOW_S, np.random.default_rng(1))
    begin = process_time()
    for _ in range(20):
        _said([window])
    took_ms = (process_time() - begin) / 20 / len(window.signals) * 1e3
    yield f"  examining them: {took_ms:.2f} ms a signal and window of {WINDOW_S:g} s"


def _windows(
    scenario: Scenario,
    copy: str,
    duration_s: float,
    rng: np.random.Generator,
    receiver: int = 0,
    *,
    start_s: float = 0.0,
) -> Iterator[Taps]:
    """The correlators of every whole window, of channels on the signals of one copy."""
    scene = make_scene(scenario, make_nominal_constellation(scenario.start_gpst))
    columns = [k for k, s in enumerate(scene.skies[receiver].signals) if s.id.copy == copy]
    asked, tracked = TAPS, align_channels(scene, receiver, columns)
    looks = np.arange(0.0, WINDOW_S, asked.every_s) + 0.5 * asked.coherent_s
    for begin_s in np.arange(start_s, start_s + duration_s - WINDOW_S + 1e-6, WINDOW_S):
        yield correlate(
            scene,
            receiver,
            begin_s + looks,
            delays_chips=DELAYS_CHIPS,
            coherent_s=asked.coherent_s,
            tracked=tracked,
            replica="filtered",
            others="noise",
            rng=rng,
        ).taps()


def _said(windows: Sequence[Taps] | Iterator[Taps], settings: SqmSettings | None = None) -> list[Finding]:
    detector = Sqm(settings or SqmSettings(false_alarm_probability=OF_A_RUN))
    end_gpst = START_GPST + np.timedelta64(10, "s")
    return [
        e
        for taps in windows
        for e in detector.examine(Records(start_gpst=START_GPST, end_gpst=end_gpst, taps=(taps,)))[0]
    ]


def _word(e: Finding) -> str:
    """attack; open: so many at once that the verdict stays open; named: some signals are reported as distorted."""
    return "open" if e.failed else "named" if stands_beside(e) else e.says


def _counted(said: Sequence[Finding]) -> str:
    counts = Counter(map(_word, said))
    return ", ".join(f"{word} {counts[word]}" for word in ("attack", "open", "named", "clean")) + f" of {len(said)}"


if __name__ == "__main__":
    for text in report():
        print(text, flush=True)
