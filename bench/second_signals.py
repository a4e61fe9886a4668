"""Second signals where there are none: searches and recordings of a clean sky, and satellites with a reflection."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from pair_trials import trial
from waves import CHIP_S, RATE_HZ, Cell, Wave, add, bits, noise

from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.signals import GPS_L1_CA, GPS_SATS
from skyproof.receiver.acquisition import KnownSignal, Peak, Searcher
from skyproof.receiver.tracking import Receiver, ReceiverSettings, ReceiverState
from skyproof.simulator import ScenePlace, render_samples, scenes

REFLECTIONS = tuple(product((0.2, 0.35, 0.5, 0.7), (-3.0, -6.0, -10.0), (0.0, 0.3)))


@dataclass(frozen=True, kw_only=True)
class Count:
    """Searches of clean sky: how many, of how many tracked signals, and in how many something came up."""

    searches: int
    signals: int
    peaks: tuple[Peak, ...]
    alarms: int


def clean_searches(rng: np.random.Generator, searches: int, *, full: bool) -> Count:
    """Stretches of clean sky, each of its own, searched as the receiver does while it tracks all that is there.

    4 to 9 satellites of 38 to 52 dB-Hz, at any Doppler and place in their bits; known as a loop knows them: to 0.02
    chips and 2 Hz (thermal, 38 dB-Hz).
    """
    settings = ReceiverSettings()
    searcher = Searcher(GPS_L1_CA, RATE_HZ, settings.search if full else settings.near_search)
    steps = np.arange(-14.0, 15.0) * 500.0
    step_hz = settings.near_search.doppler_step_hz
    reach = settings.near_doppler_hz // step_hz
    near_hz = np.arange(-reach, reach + 1.0) * step_hz
    signals, alarms, peaks = 0, 0, []
    for _ in range(searches):
        planes = noise(rng, searcher.n_samples)
        known, grid = {}, dict.fromkeys(GPS_SATS, steps) if full else {}
        for sat in rng.choice(GPS_SATS, rng.integers(4, 10), replace=False).tolist():
            one = Wave(
                sat=sat,
                cn0_dbhz=rng.uniform(38.0, 52.0),
                delay_s=rng.uniform(0.0, 0.0199),
                doppler_hz=rng.uniform(-4500.0, 4500.0),
                phase_cyc=rng.random(),
                bits=bits(rng, searcher.duration_s),
            )
            add(one, 0, planes)
            delay_s = (one.delay_s + 0.02 * CHIP_S * rng.normal()) % GPS_L1_CA.period_s
            known[sat] = [KnownSignal(delay_s=delay_s, doppler_hz=one.doppler_hz + 2.0 * rng.normal())]
            if not full:
                grid[sat] = near_hz + round(one.doppler_hz / step_hz) * step_hz
            signals += 1
        found = searcher.search(planes, 0.0, grid, known)
        alarms += bool(found)
        peaks += found
    return Count(searches=searches, signals=signals, peaks=tuple(peaks), alarms=alarms)


def clean_recording(duration_s: float, seed: int) -> tuple[float, list[str]]:
    """A clean sky through the whole receiver: signal-seconds followed, and confirmed signals that are not there."""
    start = np.datetime64("2024-05-14T09:59:58", "ns")
    place = ScenePlace(lat_deg=-60.0 + 17.0 * (seed % 8), lon_deg=(41.0 * seed) % 360.0 - 180.0, height_m=50.0)
    scenario = scenes.make_clean(place, start, receivers=1, duration_s=duration_s, seed=seed)
    samples = render_samples(scenario, make_nominal_constellation(start))[0]
    receiver, state, arcs, epochs = Receiver(samples.rate_hz), ReceiverState(), {}, 0
    n = round(samples.rate_hz)
    for begin in range(0, samples.n_samples, n):
        output, state = receiver.step(state, samples.read(begin, min(n, samples.n_samples - begin)))
        arcs |= output.arcs
        epochs += len(output.measurements)
    names = {(arc.signal.sat, arc.signal.copy) for arc in arcs.values()}
    return 0.2 * epochs, sorted(f"{sat}{copy}" for sat, copy in names if copy != "a")


def reflected(
    rng: np.random.Generator,
    apart_chips: float,
    relative_db: float,
    apart_hz: float,
    settings: ReceiverSettings | None = None,
) -> int:
    """Signals reported beside a satellite's own, of one with a reflection."""
    cell = Cell(apart_chips=apart_chips, relative_db=relative_db, apart_hz=apart_hz, cn0_dbhz=rng.uniform(42.0, 50.0))
    outcome = trial(rng, cell, settings)
    return outcome.others + outcome.both


def report(trials: int) -> Iterator[str]:
    """Rows of the table."""
    yield "second signals on clean sky, 4 to 9 tracked satellites of 38 to 52 dB-Hz"
    rng = np.random.default_rng(1)
    for full, searches in ((False, 2000 * trials), (True, 60 * trials)):
        yield _counted(clean_searches(rng, searches, full=full), full)
    yield f"second signals beside a reflection, {trials} trials each, 42 to 50 dB-Hz"
    yield from _reflections(rng, trials)


def _counted(count: Count, full: bool) -> str:
    settings = ReceiverSettings()
    each_s = settings.full_search_s if full else settings.near_search_s
    what = "full" if full else "near"
    hours = count.searches * each_s / 3600.0
    return (
        f"  {count.searches} {what} searches ({hours:.2f} h at one each {each_s:g} s) of {count.signals} signals: "
        f"{count.alarms} with a peak"
    )


def _reflections(rng: np.random.Generator, trials: int) -> Iterator[str]:
    for apart_chips, relative_db, apart_hz in REFLECTIONS:
        seen = [reflected(rng, apart_chips, relative_db, apart_hz) for _ in range(trials)]
        yield (
            f"  {apart_chips:4.2f} chips {relative_db:+3.0f} dB {apart_hz:.1f} Hz: "
            f"{sum(n > 0 for n in seen)}/{trials} with another signal"
        )
