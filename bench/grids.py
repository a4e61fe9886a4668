"""Correlation grids and their decomposition: processor time for each satellite, and for each second of a recording.

Eight satellites in noise, one core. Grids are those that `dccaf` asks for, of one burst; how often bursts are taken
depends on what is at stake. What the loops of a channel cost, `receiver` prints.
"""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from time import process_time

import numpy as np
from following import following
from timing import Spread, line, take_turns

from skyproof.detectors.dccaf.bursts import build_shapes, fit_components, joint_p_value
from skyproof.detectors.dccaf.delays import DccafSettings
from skyproof.detectors.dccaf.detector import GRIDS
from skyproof.gnss.signals import GPS_L1_CA, GPS_SATS, prn_of
from skyproof.receiver.grids import GridCorrelator, Grids

RATES_HZ = (2.6037e6, 5.0037e6, 25.0037e6)
SATS = GPS_SATS[:8]
FOLLOWED_S = 0.5
RUNS = 5


def report() -> Iterator[str]:
    """Rows of the table."""
    yield (
        f"correlation grids of {len(SATS)} satellites, {GRIDS.intervals} intervals of {1e3 * GRIDS.coherent_s:g} ms a "
        f"burst, one core, processor time a satellite; a second of recording has 1/{GRIDS.every_s:g} bursts, "
        f"1/{GRIDS.soon_s:g} while much is at stake"
    )
    for rate_hz in RATES_HZ:
        yield from _rows(rate_hz, np.random.default_rng(1))


def _rows(rate_hz: float, rng: np.random.Generator) -> Iterator[str]:
    receiver, state, planes = following(rate_hz, SATS, FOLLOWED_S, rng)
    settings = receiver.settings
    _, state = receiver.step(state, planes)

    correlator = GridCorrelator(GRIDS, rate_hz, 0.0, settings.signal, settings.code_phases)
    begin_s, bits = (state.frame - 1) * settings.frame_s, np.zeros(len(SATS))
    arcs = np.array([channel.arc for channel in state.channels])

    with ThreadPoolExecutor(1) as threads:

        def take() -> Grids:
            frame = state.rows, state.counts
            return correlator.take(planes, 0, frame, bits, SATS, arcs, begin_s, threads, 1)

        grids = take()
        assert len(grids) == len(SATS) * GRIDS.intervals
        values = grids.value.reshape(len(SATS), GRIDS.intervals, *grids.value.shape[1:])[:, :, 0].astype(np.complex128)
        variance = grids.noise_variance.reshape(len(SATS), GRIDS.intervals)

        def apart() -> None:
            for row, sat in enumerate(SATS):
                taps = tuple(correlator.delays_chips.tolist())
                own = build_shapes(GPS_L1_CA, prn_of(sat), taps, correlator.band_hz, DccafSettings().window_chips)
                found = fit_components(values[row][None], own, variance[row][None])
                joint_p_value(found.second, GRIDS.intervals, own.path, correlator.noise_samples)

        taken, decomposed = (
            turn * (1e3 / len(SATS)) for turn in take_turns(take, apart, runs=RUNS, clock=process_time)
        )
    whole = taken.median + decomposed.median
    yield f"  {1e-6 * rate_hz:.1f} Msps, {correlator.delays_chips.size} delays"
    yield line("  grids of a burst", taken, "ms")
    yield line("  decomposition of a burst", decomposed, "ms")
    spread = Spread(whole / GRIDS.every_s, whole / GRIDS.every_s, whole / GRIDS.soon_s)
    yield line("  both, a second of recording", spread, "ms", "the most while much is at stake")
