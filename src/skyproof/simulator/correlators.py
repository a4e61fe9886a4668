"""Simulate a scene at the level of correlators: what every tap of every channel holds, in closed form.

Over an integration of T seconds a signal of amplitude A adds to the tap whose replica is d chips ahead and f hertz off

    A R(lag + d) mean of b(t) exp(2 pi i (phase(t) - f (t - middle)))

with R the correlation of the signal behind the front end and the replica, its lag and phase against the tracked ones,
and b the data bits of both. Phases run straight over at most 20 ms and are cut where bits turn over, where guesses of
them end, and where signals come and go; amplitudes are those of the middle; nothing else is rounded. White noise of the
samples makes the taps Gaussian: two taps correlate as their replicas do, R_replica(d1 - d2) in delay and sin(x)/x of
the Doppler's distance, also across channels on copies that overlap.

Units are those of the samples: correlation a sample, the receiver's own noise having variance 1 in I and in Q before
the quantiser, whose gain and own noise follow from the normal law (Bussgang, 1952). R is exact for the whole code
period, side lobes of the satellite's own code included, in the mean over where samples fall within chips. Left out:
what sharp chips fold back when they are sampled, a thousandth to a hundredth of the prompt at a few Msps where a
millisecond is a whole number of samples (the rendered samples have it, if the replica or the signal has sharp chips);
the loss of R at Dopplers of kilohertz beside the mean's; and other satellites' signals. Each of those adds a
pseudo-random -24 dB at most, -30 dB rms in a millisecond: with `others="noise"` they count as noise, as they are in the
mean over Dopplers.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Booleans, Complexes, ComplexFloats, Integers, Reals
from skyproof.compiled import compiled
from skyproof.gnss.signals import prn_of
from skyproof.records import SignalId, Taps, freeze
from skyproof.simulator.correlation import Replica, compute_correlation
from skyproof.simulator.correlator_coupling import (
    StraightSpans,
    WaveEdges,
    compute_couplings,
    cut_spans,
    list_pairs,
    list_received_waves,
    list_replica_waves,
    mark_present,
)
from skyproof.simulator.correlator_levels import compute_levels
from skyproof.simulator.received import ReceiverSky, Scene
from skyproof.simulator.tap_noise import TapNoise
from skyproof.simulator.tracked import Tracked, align_channels

__all__ = ["CorrelatorOutputs", "Parts", "correlate"]

_LOBE_CHIPS = {"chips": 1.0, "filtered": 2.0}
"""Beyond, replicas do not correlate but for side lobes."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Parts:
    """The truth: which signal adds what to which channel. One part is a channel and a signal of its satellite.

    channel, signal : (n_parts,) numbers of the channel, and of the signal in the sky. ray : (n_parts,) the reflection's
        number, -1 for the signal itself. label : "authentic", "spoofed" or "multipath".
    lag_chips, doppler_hz, phase_cyc : (n_epochs, n_parts) of the signal over the replica, in the middle.
    weight : (n_epochs, n_parts) complex, amplitude with all losses at the Doppler tap nearest to 0, before R; 0 while
        the signal is not there.
    """

    channel: Integers
    signal: Integers
    ray: Integers
    label: tuple[str, ...]
    lag_chips: Reals
    doppler_hz: Reals
    phase_cyc: Reals
    weight: Complexes


@dataclass(frozen=True, eq=False, kw_only=True)
class CorrelatorOutputs:
    """Correlator outputs of one antenna: epochs are integrations, as many and as near as were asked for.

    elapsed_s : (n_epochs,) the middles, on the sampling clock. delays_chips, dopplers_hz : as in `Taps`.
    value : (*draws, n_epochs, n_channels, n_dopplers, n_delays) complex64. mean : the same without noise and draws.
    noise_sigma : (n_epochs, n_channels), of the noise in I and in Q of each tap.
    there : (n_epochs, n_channels) whether the signal that a channel is aligned to was there throughout.
    """

    receiver: str
    signals: tuple[SignalId, ...]
    elapsed_s: Reals
    delays_chips: Reals
    dopplers_hz: Reals
    coherent_s: float
    value: ComplexFloats
    mean: Complexes
    noise_sigma: Reals
    there: Booleans
    parts: Parts

    def __post_init__(self) -> None:
        shape = ("epoch", "channel", "doppler", "delay")
        freeze(
            self,
            {
                "elapsed_s": ("epoch",),
                "delays_chips": ("delay",),
                "dopplers_hz": ("doppler",),
                "mean": shape,
                "noise_sigma": shape[:2],
                "there": shape[:2],
            },
        )

    def taps(self, *draw: int) -> Taps:
        """Return one draw as a receiver hands it on."""
        value = np.where(self.there[:, :, np.newaxis, np.newaxis], self.value[draw], np.complex64(np.nan))
        return Taps(
            receiver=self.receiver,
            signals=self.signals,
            elapsed_s=self.elapsed_s,
            delays_chips=self.delays_chips,
            dopplers_hz=self.dopplers_hz,
            value=value,
        )


def correlate(
    scene: Scene,
    index: int,
    elapsed_s: ArrayLike,
    *,
    delays_chips: ArrayLike,
    dopplers_hz: ArrayLike = (0.0,),
    coherent_s: float = 0.02,
    tracked: Tracked | None = None,
    replica: Replica = "chips",
    wiped: bool = True,
    others: Literal["neglected", "noise"] = "neglected",
    quantised: bool = True,
    rng: np.random.Generator | None = None,
    draws: tuple[int, ...] = (),
) -> CorrelatorOutputs:
    """Simulate correlator outputs of antenna number `index` over integrations centred on `elapsed_s` (n,).

    Each integration lasts `coherent_s`.

    delays_chips : of the replica ahead of the tracked code. dopplers_hz : of the replica's carrier over the tracked.
    tracked : what channels are aligned to; each signal that is received if absent.
    wiped : whether the tracked message's bits are taken off; else the replica has none.
    others : satellites' signals in other channels: see above. quantised : in units of the recorder's numbers, with its
        loss; else as before the quantiser and the gain control.
    rng, draws : noise, in `draws` sets of outputs; the mean alone without `rng`. Integrations are independent if they
        do not overlap in time, and are drawn so.
    """
    sky, front_end = scene.skies[index], scene.scenario.front_end
    if coherent_s <= 0.0:
        raise ValueError(f"coherent_s {coherent_s:g} must be positive")
    middle_s = np.atleast_1d(np.asarray(elapsed_s, np.float64))
    delays, dopplers = (np.atleast_1d(np.asarray(taps, np.float64)) for taps in (delays_chips, dopplers_hz))
    tracked = tracked if tracked is not None else align_channels(scene, index)
    sats = sorted({signal.sat for signal in tracked.signals})
    tables = compute_correlation([prn_of(sat) for sat in sats], sky.signal, front_end, replica=replica)
    spans = cut_spans(sky, middle_s, coherent_s)
    rows, channels = list_received_waves(scene, sky, spans), list_replica_waves(scene, sky, tracked, spans, wiped)
    channel_sat = [signal.sat for signal in tracked.signals]
    pairs = list_pairs(channel_sat, rows.sats)
    lag_chips, turns_cyc, coupling = compute_couplings(spans, channels, rows, pairs, dopplers, sky.signal)

    level = compute_levels(sky, front_end, rows, spans, coherent_s, tables, others, quantised, channel_sat)
    weight = coupling * level.amplitude[:, pairs[:, 1], np.newaxis, np.newaxis]
    mean = np.zeros((middle_s.size, len(channel_sat), dopplers.size, delays.size), np.complex128)
    table_of = np.array([sats.index(channel_sat[channel]) for channel in pairs[:, 0]], np.int64)
    _add_spread(mean, pairs, table_of, weight, lag_chips, delays, tables.signal, float(tables.points))

    value = np.broadcast_to(mean, (*draws, *mean.shape)).astype(np.complex64)
    if rng is not None:
        noise = TapNoise(tables, delays, dopplers, coherent_s, sky.signal, _LOBE_CHIPS[replica])
        value += noise.draw(rng, draws, channel_sat, sats, spans, channels) * level.sigma[:, :, np.newaxis, np.newaxis]
    return CorrelatorOutputs(
        receiver=sky.name,
        signals=tracked.signals,
        elapsed_s=middle_s,
        delays_chips=delays,
        dopplers_hz=dopplers,
        coherent_s=coherent_s,
        value=value,
        mean=mean,
        noise_sigma=level.sigma,
        there=mark_present(sky, tracked, spans),
        parts=_make_parts(sky, spans, rows, pairs, lag_chips, turns_cyc, weight, dopplers),
    )


def _make_parts(
    sky: ReceiverSky,
    spans: StraightSpans,
    rows: WaveEdges,
    pairs: Integers,
    lag_chips: Reals,
    turns_cyc: Reals,
    weight: Complexes,
    dopplers_hz: Reals,
) -> Parts:
    channel, row = pairs.T
    n_signals, edges_s = len(sky.signals), spans.elapsed_s
    middle_s = 0.5 * (edges_s[:, :1] + edges_s[:, -1:])
    last = edges_s.shape[1] - 2
    at = np.clip((edges_s <= middle_s).sum(axis=1, keepdims=True) - 1, 0, last)[..., np.newaxis]
    turns_before, turns_after = (np.take_along_axis(turns_cyc, at + later, axis=1)[:, 0] for later in (0, 1))
    before_s, after_s = (np.take_along_axis(edges_s, at[..., 0] + later, axis=1) for later in (0, 1))
    lengths_s = np.diff(edges_s, axis=1)[..., np.newaxis]
    return Parts(
        channel=channel,
        signal=rows.of[row],
        ray=np.where(row < n_signals, -1, row - n_signals),
        label=tuple(sky.signals[r].label if r < n_signals else "multipath" for r in row.tolist()),
        lag_chips=(lag_chips * lengths_s).sum(axis=1) / lengths_s.sum(axis=1),
        doppler_hz=(turns_cyc[:, -1] - turns_cyc[:, 0]) / (edges_s[:, -1:] - edges_s[:, :1]),
        phase_cyc=turns_before + (turns_after - turns_before) * (middle_s - before_s) / (after_s - before_s),
        weight=weight.sum(axis=2)[..., np.abs(dopplers_hz).argmin()],
    )


@compiled
def _add_spread(
    mean: Complexes,
    pairs: Integers,
    table_of: Integers,
    weight: Complexes,
    lag_chips: Reals,
    delays: Reals,
    tables: Reals,
    points: float,
) -> None:
    """Add to mean (n_epochs, n_channels, n_dopplers, n_delays) each part's weight times R at lag plus delay."""
    period = tables.shape[1]
    for e in range(mean.shape[0]):
        for p in range(pairs.shape[0]):
            c, table = pairs[p, 0], tables[table_of[p]]
            for s in range(lag_chips.shape[1]):
                for k in range(delays.size):
                    at = (lag_chips[e, s, p] + delays[k]) * points
                    at -= math.floor(at / period) * period
                    whole = int(at)
                    share = at - whole
                    first = whole if whole < period else 0
                    second = first + 1 if first + 1 < period else 0
                    value = table[first] * (1.0 - share) + table[second] * share
                    for d in range(mean.shape[2]):
                        mean[e, c, d, k] += weight[e, p, s, d] * value
