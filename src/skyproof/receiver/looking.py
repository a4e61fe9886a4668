"""Schedule when and where the receiver searches for further signals, and start channels on those found."""

from dataclasses import replace

import numpy as np

from skyproof.arrays import Reals
from skyproof.receiver import kernels as k
from skyproof.receiver.acquisition import KnownSignal, Peak, Searcher
from skyproof.receiver.channels import FORGET_S, Channel
from skyproof.receiver.settings import ReceiverSettings
from skyproof.receiver.state import ReceiverState, with_channel
from skyproof.receiver.steering import set_loops

__all__ = ["Lookout", "delay_s"]

DOPPLER_BIN_HZ = 500.0
"""How finely it is remembered where was searched last."""


def delay_s(loops: Reals, begin: int, rate_hz: float, period_s: float) -> Reals:
    """Return the delay of the first start of a code period at or after sample `begin`.

    loops (..., N_STATE) gives (...).
    """
    delay = (loops[..., k.START] - begin) / rate_hz - loops[..., k.CHIP] / loops[..., k.CODE_RATE]
    return np.asarray(np.mod(delay, period_s))


class Lookout:
    """Searches of a receiver: everywhere now and then, and near the Dopplers of what is tracked or was lost often."""

    def __init__(self, rate_hz: float, if_hz: float, settings: ReceiverSettings) -> None:
        self.settings, self.signal = settings, settings.signal
        self.rate_hz, self.if_hz = rate_hz, if_hz
        self.searcher = Searcher(self.signal, rate_hz, settings.search)
        self.near_searcher = Searcher(self.signal, rate_hz, settings.near_search)

    def look(self, state: ReceiverState, begin: int, rows_shape: tuple[int, int]) -> ReceiverState:
        """Search one antenna after the other, so that what a faded one misses the next one finds.

        rows_shape : of what the kernel gives of a channel in a frame.
        """
        now_s = state.frame * self.settings.frame_s
        settings = self.settings
        for searcher, every_s, dopplers in (
            (self.searcher, self._full_search_s(state), self._list_all_dopplers(state)),
            (self.near_searcher, settings.near_search_s, self._list_near_dopplers(state, now_s)),
        ):
            if not dopplers or state.tail_start + state.tail.shape[-1] - begin < searcher.n_samples:
                continue
            alive = _list_alive(state)
            antenna = alive[round(now_s / every_s) % len(alive)]
            samples = state.tail[antenna, :, begin - state.tail_start :]
            peaks = searcher.search(samples, self.if_hz, dopplers, self._list_known(state, begin))
            for peak in peaks:
                state = self.start_channel(state, peak, begin, now_s, antenna, rows_shape)
            searched = {sat: dict(bins) for sat, bins in state.searched.items()}
            for sat, grid in dopplers.items():
                searched.setdefault(sat, {}).update({_bin(d): now_s for d in grid})
            state = replace(state, searched=searched)
        return state

    def _full_search_s(self, state: ReceiverState) -> float:
        """Return how often every Doppler is searched: soon, while a front end may not have come up yet."""
        return self.settings.full_search_s if state.next_arc else self.settings.first_search_s

    def _list_all_dopplers(self, state: ReceiverState) -> dict[str, Reals]:
        """List every Doppler of every satellite, when it is time."""
        settings = self.settings
        if state.frame % round(self._full_search_s(state) / settings.frame_s):
            return {}
        step_hz = settings.search.doppler_step_hz
        n = int(settings.doppler_max_hz // step_hz)
        grid = np.arange(-n, n + 1, dtype=np.float64) * step_hz
        return {sat: grid for sat in settings.sats}

    def _list_near_dopplers(self, state: ReceiverState, now_s: float) -> dict[str, Reals]:
        """List Dopplers near those of tracked signals, and of those lost a moment ago."""
        settings = self.settings
        if state.frame == 0 or state.frame % round(settings.near_search_s / settings.frame_s):
            return {}
        step_hz = settings.near_search.doppler_step_hz
        reach = int(settings.near_doppler_hz // step_hz)
        centres: dict[str, set[int]] = {}
        for channel, loop in zip(state.channels, state.loops, strict=True):
            centres.setdefault(channel.sat, set()).add(round((loop[k.FREQUENCY] - self.if_hz) / step_hz))
        for old in state.lost:
            if now_s - old.place.at_s < FORGET_S:
                centres.setdefault(old.sat, set()).add(round(old.place.doppler_hz / step_hz))
        return {
            sat: step_hz * np.array(sorted({c + d for c in found for d in range(-reach, reach + 1)}), np.float64)
            for sat, found in centres.items()
        }

    def _list_known(self, state: ReceiverState, begin: int) -> dict[str, list[KnownSignal]]:
        """List the tracked signals of each satellite, as of sample `begin`."""
        known: dict[str, list[KnownSignal]] = {}
        delays_s = delay_s(state.loops, begin, self.rate_hz, self.signal.period_s).tolist()
        dopplers_hz = (state.loops[:, k.FREQUENCY] - self.if_hz).tolist()
        for channel, at_s, doppler_hz in zip(state.channels, delays_s, dopplers_hz, strict=True):
            known.setdefault(channel.sat, []).append(KnownSignal(delay_s=at_s, doppler_hz=doppler_hz))
        return known

    def start_channel(
        self, state: ReceiverState, peak: Peak, begin: int, now_s: float, antenna: int, rows_shape: tuple[int, int]
    ) -> ReceiverState:
        """Start a channel on a peak that was found at sample `begin`."""
        chips_per_sample = self.signal.chip_rate_hz / self.rate_hz
        first = np.ceil(peak.delay_s * self.rate_hz)
        loop = np.zeros(k.N_STATE)
        loop[k.START] = begin + first
        loop[k.CHIP] = (first - peak.delay_s * self.rate_hz) * chips_per_sample
        loop[k.PLL_VELOCITY] = peak.doppler_hz
        loop[k.FREQUENCY] = self.if_hz + peak.doppler_hz
        loop[k.CODE_RATE] = self.signal.chip_rate_hz * (1.0 + peak.doppler_hz / self.signal.carrier_hz)
        loop[k.BIT_START] = -1.0
        loop[[k.RESIDUAL, k.CODE_MINUS_CARRIER]] = np.nan
        loop[k.CN0_DBHZ] = peak.cn0_dbhz
        set_loops(loop, self.settings.pull_in)
        missed_s = state.searched.get(peak.sat, {}).get(_bin(peak.doppler_hz), np.nan)
        channel = Channel(sat=peak.sat, began_s=now_s, found_s=now_s, missed_s=missed_s, arc=state.next_arc)
        return with_channel(state, channel, loop, peak.delay_s, antenna=antenna, rows_shape=rows_shape)


def _list_alive(state: ReceiverState) -> list[int]:
    """List the antennas with samples other than zero; the first if there is none, or no other."""
    if len(state.tail) == 1:
        return [0]
    return np.flatnonzero(state.tail.any(axis=(1, 2))).tolist() or [0]


def _bin(doppler_hz: float) -> int:
    return round(doppler_hz / DOPPLER_BIN_HZ)
