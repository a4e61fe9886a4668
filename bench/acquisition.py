"""The search of all 32 satellites at every Doppler, beside one that wipes off and transforms anew for each."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from os import cpu_count

import numpy as np
from numpy.typing import NDArray
from scipy import special
from timing import line, take_turns

from skyproof.gnss.nominal import nominal_constellation
from skyproof.gnss.signals import GPS_L1_CA, GPS_SATS, prn_of
from skyproof.receiver.acquisition import Peak, Searcher, SearchSettings
from skyproof.simulate import samples_of, scenes

STEPS = 14  # of 500 Hz on either side: 7 kHz
PLAIN_SATS = 4  # what the slow peer does of the 32


def report() -> Iterator[str]:
    """Rows of the table."""
    scenario = scenes.demo(duration_s=0.1, onset_s=0.0)
    recording = samples_of(scenario, nominal_constellation(scenario.start_gpst))[0]
    searcher = Searcher(GPS_L1_CA, recording.rate_hz, SearchSettings())
    samples = recording.read(0, searcher.n_samples)
    grid_hz = np.arange(-STEPS, STEPS + 1) * searcher.settings.doppler_step_hz

    def ours() -> list[Peak]:
        return searcher.search(samples, 0.0, dict.fromkeys(GPS_SATS, grid_hz), lambda _: [])

    found = {peak.sat for peak in ours()}
    plain = _plain(searcher, samples, grid_hz)
    assert found == {sat for sat, power in zip(GPS_SATS, plain(GPS_SATS), strict=True) if power > _threshold(searcher)}
    near_hz = {peak.sat: 500.0 * (round(peak.doppler_hz / 500.0) + np.arange(-2, 3)) for peak in ours()}
    search_s, near_s, plain_s = take_turns(
        ours, lambda: searcher.search(samples, 0.0, near_hz, lambda _: []), lambda: plain(GPS_SATS[:PLAIN_SATS]), runs=5
    )
    plain_32_s = plain_s * (len(GPS_SATS) / PLAIN_SATS)
    yield f"acquisition, 32 satellites, {grid_hz.size} Dopplers, 20 x 1 ms, {recording.rate_hz / 1e6:g} Msps, all cores"
    yield line(
        f"{len(found)} satellites found", search_s, "s",
        f"plain search {plain_32_s.median:.2f} s ({plain_32_s.median / search_s.median:.1f} times)",
    )  # fmt: skip
    share = 0.2 * search_s.median + 2.0 * near_s.median
    beside = f"everywhere every 5 s and so every 0.5 s: {share:.2f} s a second of signal"
    yield line(f"the same {len(near_hz)}, 5 Dopplers each", near_s, "s", beside)


def _threshold(searcher: Searcher) -> float:
    return searcher.threshold(len(GPS_SATS) * (2 * STEPS + 1) * searcher.n)


def _plain(searcher: Searcher, samples: NDArray[np.float32], grid_hz: NDArray[np.float64]):  # type: ignore[no-untyped-def]
    """Largest power over noise of each satellite; as many threads as the other."""
    n = round(searcher.rate_hz * searcher.period_s)
    periods = searcher.settings.n_periods
    base = (samples[0, : periods * n] + 1j * samples[1, : periods * n]).astype(np.complex64)
    time_s = np.arange(base.size) / searcher.rate_hz
    median_over_mean = float(special.gammaincinv(periods, 0.5) / periods)

    def largest(sat: str) -> float:
        chips = GPS_L1_CA.code(prn_of(sat))
        replica = np.conj(np.fft.fft(chips[np.floor(np.arange(n) * chips.size / n).astype(np.int64)]))
        best = 0.0
        for doppler_hz in grid_hz:
            wiped = (base * np.exp(-2j * np.pi * doppler_hz * time_s)).reshape(periods, n)
            power = np.sum(np.abs(np.fft.ifft(np.fft.fft(wiped, axis=1) * replica, axis=1)) ** 2, axis=0)
            best = max(best, float(power.max() / np.median(power)))
        return best * median_over_mean

    pool = ThreadPoolExecutor(cpu_count())
    return lambda sats: list(pool.map(largest, sats))
