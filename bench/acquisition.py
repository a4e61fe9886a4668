"""The search, everywhere and near tracked signals, beside one that wipes off and transforms anew for each Doppler."""

from collections.abc import Iterator
from time import perf_counter, process_time

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from timing import Spread, line, take_turns

from skyproof.gnss.signals import GPS_L1_CA, GPS_SATS, prn_of
from skyproof.receiver.acquisition import KnownSignal, Searcher, SearchSettings
from skyproof.receiver.fourier import N_CELLS, correlate_rows

STEPS = 14  # of 500 Hz on either side: 7 kHz
PLAIN_SATS = 2  # what the slow peer does of the 32
LIMIT_S = 0.25
NEAR = SearchSettings(coherent_periods=4, n_sums=5)


def report() -> Iterator[str]:
    """Rows of the table."""
    yield "acquisition: one transform with product and powers, one core"
    yield from _kernel()
    for rate_hz in (2.6e6, 4e6):
        yield f"acquisition, 12 satellites in the sky, {rate_hz / 1e6:g} Msps (CPU: all cores together)"
        yield from _searches(rate_hz)


def _kernel() -> Iterator[str]:
    rng = np.random.default_rng(1)
    spectra = rng.normal(size=(1, 100, 2, N_CELLS)).astype(np.float32)
    code = rng.normal(size=(1, 2, N_CELLS)).astype(np.float32)
    power, highest, zero = np.empty((1, N_CELLS), np.float32), np.empty(1, np.float32), np.zeros(1, np.int64)
    products = (rng.normal(size=(100, N_CELLS)) + 1j).astype(np.complex64)
    ours, theirs = take_turns(
        lambda: correlate_rows(spectra, code, zero, zero, 0, 1, power, highest),
        lambda: fft.ifft(products, axis=1),
        runs=31,
        clock=process_time,
    )
    yield line(f"{N_CELLS} cells", ours * 1e4, "us", f"SciPy's transform alone {theirs.median * 1e4:.1f} us")


def _searches(rate_hz: float) -> Iterator[str]:
    rng = np.random.default_rng(2)
    everywhere = Searcher(GPS_L1_CA, rate_hz, SearchSettings(n_sums=10))
    near = Searcher(GPS_L1_CA, rate_hz, NEAR)
    known = {
        sat: [KnownSignal(delay_s=rng.uniform(0.0, 1e-3), doppler_hz=rng.uniform(-5e3, 5e3))] for sat in GPS_SATS[:12]
    }
    samples = _sky(rng, rate_hz, near.n_samples, known)
    grid_hz = np.arange(-STEPS, STEPS + 1) * everywhere.settings.doppler_step_hz
    grids = dict.fromkeys(GPS_SATS, grid_hz)
    step_hz = near.settings.doppler_step_hz
    nearby = {sat: (round(one.doppler_hz / step_hz) + np.arange(-2.0, 3.0)) * step_hz for sat, (one,) in known.items()}
    assert {peak.sat for peak in everywhere.search(samples, 0.0, grids, {})} == set(known)
    assert not everywhere.search(samples, 0.0, grids, known)
    plain_s = _once(lambda: _plain(samples, rate_hz, grid_hz, 10)) * len(GPS_SATS) / PLAIN_SATS
    for clock, name, scale, unit in ((perf_counter, "wall", 1.0, "s"), (process_time, "CPU", 1e3, "ms")):
        first, again, close = take_turns(
            lambda: everywhere.search(samples, 0.0, grids, {}),
            lambda: everywhere.search(samples, 0.0, grids, known),
            lambda: near.search(samples, 0.0, nearby, known),
            runs=21,
            clock=clock,
        )
        beside = f"limit {LIMIT_S} s; plain search {plain_s:.2f} s on one core" if clock is perf_counter else ""
        yield line(f"32 satellites, +-7 kHz, 10 x 1 ms, {name}", first * scale, unit, beside)
        yield line(f"  the same, all signals known, {name}", again * scale, unit)
        yield line(f"  near 12 known, +-250 Hz, 5 x 4 ms, {name}", close * scale, unit, _a_second(again, close, clock))


def _a_second(again: Spread, close: Spread, clock: object) -> str:
    if clock is perf_counter:
        return ""
    return f"everywhere each 5 s and near each 0.5 s: {1e3 * (0.2 * again.median + 2.0 * close.median):.0f} ms a second"


def _sky(rng: np.random.Generator, rate_hz: float, n: int, known: dict[str, list[KnownSignal]]) -> NDArray[np.float32]:
    k = np.arange(n)
    wave = rng.normal(size=n) + 1j * rng.normal(size=n)
    for sat, (one,) in known.items():
        chips = (k / rate_hz - one.delay_s) * GPS_L1_CA.chip_rate_hz * (1.0 + one.doppler_hz / GPS_L1_CA.carrier_hz)
        amplitude = np.sqrt(2.0 * 10.0 ** (0.1 * rng.uniform(42.0, 50.0)) / rate_hz)
        code = GPS_L1_CA.code(prn_of(sat))[np.floor(chips).astype(np.int64) % GPS_L1_CA.code_length]
        wave += amplitude * code * np.exp(2j * np.pi * (one.doppler_hz / rate_hz * k + rng.random()))
    return np.stack([wave.real, wave.imag]).astype(np.float32)


def _once(function) -> float:  # type: ignore[no-untyped-def]
    begin = process_time()
    function()
    return process_time() - begin


def _plain(samples: NDArray[np.float32], rate_hz: float, grid_hz: NDArray[np.float64], periods: int) -> float:
    """Largest power over the median of each of PLAIN_SATS satellites."""
    n = round(rate_hz * GPS_L1_CA.period_s)
    base = (samples[0, : periods * n] + 1j * samples[1, : periods * n]).astype(np.complex64)
    time_s = np.arange(base.size) / rate_hz
    best = 0.0
    for sat in GPS_SATS[:PLAIN_SATS]:
        chips = GPS_L1_CA.code(prn_of(sat))
        replica = np.conj(np.fft.fft(chips[np.floor(np.arange(n) * chips.size / n).astype(np.int64)]))
        for doppler_hz in grid_hz:
            wiped = (base * np.exp(-2j * np.pi * doppler_hz * time_s)).reshape(periods, n)
            power = np.sum(np.abs(np.fft.ifft(np.fft.fft(wiped, axis=1) * replica, axis=1)) ** 2, axis=0)
            best = max(best, float(power.max() / np.median(power)))
    return best
