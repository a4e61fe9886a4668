"""The same scene at the level of correlators: what every tap of every channel holds, in closed form, without samples.

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
the loss of R at Dopplers of kilohertz beside the mean's; and other satellites' signals, each of which adds a
pseudo-random -24 dB at most, -30 dB rms in a millisecond: with `others="noise"` they count as the noise that they are
like in the mean over Dopplers.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from skyproof.arrays import Booleans, Complexes, ComplexFloats, Integers, Reals
from skyproof.compiled import compiled
from skyproof.gnss.signals import SignalDescription, prn_of
from skyproof.records import SignalId, Taps, freeze
from skyproof.simulator.correlation import Correlation, Replica, correlation, read
from skyproof.simulator.received import AddedNoise, Delay, Jammer, ReceivedSignal, ReceiverSky, Scene, row_of
from skyproof.simulator.scenario import FrontEnd

__all__ = ["CorrelatorOutputs", "Parts", "Replica", "Tracked", "aligned", "correlate"]

STRAIGHT_S = 0.02
"""Over which phases and lags run straight: a GPS carrier bends by 5e-5 cycles, differences of copies by less."""
_RIDGE = 1e-9  # of the noise, that keeps the root of its covariance real where taps are nearly one
_LOBE_CHIPS = {"chips": 1.0, "filtered": 2.0}
"""Beyond, replicas do not correlate but for side lobes."""
_JITTER = 1e-12
_INT_SIGMA = {8: 24.0, 16: 4096.0}
"""One sigma of receiver noise in steps of the recorder's integers."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Tracked:
    """What replicas are aligned to: any delays of code and carrier, true times (n,) to (n, n_channels) each.

    signals : the satellite (and copy) of each channel. symbols : the row of the scene's messages that each channel
        wipes off, (n_channels,). columns : of the sky's signals that channels stand on, -1 for none.
    """

    signals: tuple[SignalId, ...]
    delays_s: Delay
    symbols: Integers
    columns: Integers

    def moved(self, *, code_s: ArrayLike = 0.0, doppler_hz: ArrayLike = 0.0, carrier_hz: float) -> "Tracked":
        """The same with replicas later by `code_s` and higher by `doppler_hz`, (n_channels,) or one for all; the
        carrier turns from the scene's start.
        """
        late_s, fast = np.asarray(code_s, np.float64), np.asarray(doppler_hz, np.float64) / carrier_hz

        def delays_s(true_s: Reals) -> tuple[Reals, Reals]:
            code, carrier = self.delays_s(true_s)
            return code + late_s, carrier - true_s[:, np.newaxis] * fast

        return replace(self, delays_s=delays_s)


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
        """One draw as a receiver hands it on."""
        value = np.where(self.there[:, :, np.newaxis, np.newaxis], self.value[draw], np.complex64(np.nan))
        return Taps(
            receiver=self.receiver,
            signals=self.signals,
            elapsed_s=self.elapsed_s,
            delays_chips=self.delays_chips,
            dopplers_hz=self.dopplers_hz,
            value=value,
        )


def aligned(scene: Scene, index: int, columns: ArrayLike | None = None) -> Tracked:
    """One channel on each of the signals in `columns` of antenna number `index`, exactly; on all if absent.

    A column may be named several times: with `moved`, several hypotheses of one signal.
    """
    sky = scene.skies[index]
    chosen = np.arange(len(sky.signals)) if columns is None else np.asarray(columns, np.int64)

    def delays_s(true_s: Reals) -> tuple[Reals, Reals]:
        code_s, carrier_s = sky.delays_s(true_s)
        return code_s[:, chosen], carrier_s[:, chosen]

    return Tracked(
        signals=tuple(sky.signals[column].id for column in chosen),
        delays_s=delays_s,
        columns=chosen,
        symbols=row_of(scene.messages, sky.signals)[chosen],
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
    """Correlator outputs of antenna number `index` over integrations of `coherent_s` centred on `elapsed_s` (n,).

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
    tracked = tracked if tracked is not None else aligned(scene, index)
    sats = sorted({signal.sat for signal in tracked.signals})
    tables = correlation([prn_of(sat) for sat in sats], sky.signal, front_end, replica=replica)
    spans = _spans(sky, middle_s, coherent_s)
    rows, channels = _rows(scene, sky, spans), _channels(scene, sky, tracked, spans, wiped)
    channel_sat = [signal.sat for signal in tracked.signals]
    pairs = _pairs(channel_sat, rows.sats)
    lag_chips, turns_cyc, coupling = _couplings(spans, channels, rows, pairs, dopplers, sky.signal)

    level = _levels(sky, front_end, rows, spans, coherent_s, tables, others, quantised, channel_sat)
    weight = coupling * level.amplitude[:, pairs[:, 1], np.newaxis, np.newaxis]
    mean = np.zeros((middle_s.size, len(channel_sat), dopplers.size, delays.size), np.complex128)
    table_of = np.array([sats.index(channel_sat[channel]) for channel in pairs[:, 0]], np.int64)
    _spread(mean, pairs, table_of, weight, lag_chips, delays, tables.signal, float(tables.points))

    value = np.broadcast_to(mean, (*draws, *mean.shape)).astype(np.complex64)
    if rng is not None:
        noise = _Noise(tables, delays, dopplers, coherent_s, sky.signal, _LOBE_CHIPS[replica])
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
        there=_there(sky, tracked, spans),
        parts=_parts(sky, spans, rows, pairs, lag_chips, turns_cyc, weight, dopplers),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class _Spans:
    """Edges of the stretches over which phases run straight: (n_epochs, n_stretches + 1)."""

    elapsed_s: Reals
    true_s: Reals

    @property
    def middle_true_s(self) -> Reals:
        return np.asarray(0.5 * (self.true_s[:, 0] + self.true_s[:, -1]))


@dataclass(frozen=True, eq=False, kw_only=True)
class _Waves:
    """Signals or replicas at the edges: delays (n_epochs, n_edges, n), the bits' positions, which bits, when there.

    sent : symbols since the first of the message. symbols, guesses : (n_messages, n_symbols), as in `Messages`.
    message : (n,) -1 for no bits. guessed : (n,) how much of each symbol, 0 for replicas, who know it.
    windows_s : (n, n_windows, 2) in true time.
    """

    sats: list[str]
    code_s: Reals
    carrier_s: Reals
    sent: Reals
    symbols: NDArray[np.int8]
    guesses: NDArray[np.int8]
    message: Integers
    guessed: Reals
    windows_s: Reals
    of: Integers


def _spans(sky: ReceiverSky, middle_s: Reals, coherent_s: float) -> _Spans:
    """Even stretches, cut where a signal comes or goes: carriers may bend sharply there."""
    stretches = math.ceil(coherent_s / STRAIGHT_S * (1.0 - _JITTER))
    elapsed_s = middle_s[:, np.newaxis] + coherent_s * (np.arange(stretches + 1) / stretches - 0.5)
    edges_s = np.unique(_windows(sky.signals))
    edges_s = sky.elapsed_at(edges_s[np.isfinite(edges_s)])
    inside = np.abs(middle_s[:, np.newaxis] - edges_s) < 0.5 * coherent_s
    cuts_s = np.sort(np.where(inside, edges_s, elapsed_s[:, -1:]), axis=1)[:, : inside.sum(axis=1).max(initial=0)]
    elapsed_s = np.sort(np.concatenate([elapsed_s, cuts_s], axis=1), axis=1)
    return _Spans(elapsed_s=elapsed_s, true_s=elapsed_s + sky.true_minus_elapsed_s(elapsed_s))


def _at(delays_s: Delay, true_s: Reals) -> tuple[Reals, Reals]:
    code_s, carrier_s = delays_s(true_s.ravel())
    return code_s.reshape(*true_s.shape, -1), carrier_s.reshape(*true_s.shape, -1)


def _sent(scene: Scene, sky: ReceiverSky, true_s: Reals, code_s: Reals) -> Reals:
    """Symbols that have been sent since the first."""
    symbol_s = sky.signal.period_s * sky.signal.periods_per_symbol
    return np.asarray((scene.messages.lead_s + (true_s[..., np.newaxis] - code_s)) / symbol_s)


def _rows(scene: Scene, sky: ReceiverSky, spans: _Spans) -> _Waves:
    """Signals, then their reflections."""
    code_s, carrier_s = _at(sky.delays_s, spans.true_s)
    of = np.array([*range(len(sky.signals)), *(ray.of for ray in sky.rays)], np.int64)
    code_s, carrier_s = code_s[..., of], carrier_s[..., of]
    for row, ray in enumerate(sky.rays, len(sky.signals)):
        further_s = ray.further_s(spans.true_s)
        code_s[..., row] += further_s
        carrier_s[..., row] += further_s - (ray.phase_cyc + ray.rate_hz * spans.true_s) / sky.signal.carrier_hz
    received = [sky.signals[column] for column in of]
    message = row_of(scene.messages, received)
    return _Waves(
        sats=[each.id.sat for each in received],
        code_s=code_s,
        carrier_s=carrier_s,
        sent=_sent(scene, sky, spans.true_s, code_s),
        symbols=scene.messages.symbols,
        guesses=scene.messages.guesses,
        message=message,
        guessed=scene.messages.guess_s[message] / sky.signal.symbol_s,
        windows_s=_windows(received),
        of=of,
    )


def _channels(scene: Scene, sky: ReceiverSky, tracked: Tracked, spans: _Spans, wiped: bool) -> _Waves:
    """Replicas."""
    code_s, carrier_s = _at(tracked.delays_s, spans.true_s)
    always_s = np.tile([-np.inf, np.inf], (len(tracked.signals), 1, 1))
    return _Waves(
        sats=[signal.sat for signal in tracked.signals],
        code_s=code_s,
        carrier_s=carrier_s,
        sent=_sent(scene, sky, spans.true_s, code_s),
        symbols=scene.messages.symbols,
        guesses=scene.messages.guesses,
        message=tracked.symbols if wiped else np.full(len(tracked.signals), -1),
        guessed=np.zeros(len(tracked.signals)),
        windows_s=always_s,
        of=tracked.columns,
    )


def _windows(received: Sequence[ReceivedSignal]) -> Reals:
    most = max(len(each.windows_s) for each in received)
    windows_s = np.full((len(received), most, 2), np.inf)
    for row, each in enumerate(received):
        windows_s[row, : len(each.windows_s)] = each.windows_s
    return windows_s


def _there(sky: ReceiverSky, tracked: Tracked, spans: _Spans) -> Booleans:
    windows_s = _windows(sky.signals)
    first_s, last_s = (spans.true_s[:, edge, np.newaxis, np.newaxis] for edge in (0, -1))
    there: Booleans = np.any((windows_s[..., 0] <= first_s) & (last_s <= windows_s[..., 1]), axis=2)
    return np.asarray(there[:, tracked.columns] | (tracked.columns < 0))


def _pairs(channel_sats: Sequence[str], row_sats: Sequence[str]) -> Integers:
    """Channels and rows of one satellite, (n_pairs, 2)."""
    return np.argwhere(np.array(channel_sats)[:, np.newaxis] == np.array(row_sats))


def _couplings(
    spans: _Spans,
    channels: _Waves,
    rows: _Waves,
    pairs: Integers,
    dopplers_hz: Reals,
    signal: SignalDescription,
) -> tuple[Reals, Reals, Complexes]:
    """Lag in chips (n_epochs, n_stretches, n_pairs), phase at the edges in cycles (n_epochs, n_edges, n_pairs), and
    what each stretch adds to the mean of bits and phasor, (n_epochs, n_pairs, n_stretches, n_dopplers).
    """
    channel, row = pairs.T
    late_chips = (rows.code_s[..., row] - channels.code_s[..., channel]) * signal.chip_rate_hz
    turns_cyc = signal.carrier_hz * (channels.carrier_s[..., channel] - rows.carrier_s[..., row])
    since_s = spans.elapsed_s - 0.5 * (spans.elapsed_s[:, :1] + spans.elapsed_s[:, -1:])
    shape = turns_cyc.shape[0], pairs.shape[0], turns_cyc.shape[1] - 1, dopplers_hz.size
    coupling = np.empty(shape, np.complex128)
    _couple(
        coupling,
        pairs,
        spans.true_s,
        turns_cyc,
        np.multiply.outer(since_s, dopplers_hz),
        rows.sent,
        channels.sent,
        rows.symbols,
        rows.guesses,
        rows.message,
        rows.guessed,
        channels.message,
        rows.windows_s,
    )
    return 0.5 * (late_chips[:, :-1] + late_chips[:, 1:]), turns_cyc, coupling


@dataclass(frozen=True, eq=False, kw_only=True)
class _Levels:
    """amplitude : (n_epochs, n_rows) of correlation. sigma : (n_epochs, n_channels), of noise in I and in Q."""

    amplitude: Reals
    sigma: Reals


def _levels(
    sky: ReceiverSky,
    front_end: FrontEnd,
    rows: _Waves,
    spans: _Spans,
    coherent_s: float,
    tables: Correlation,
    others: Literal["neglected", "noise"],
    quantised: bool,
    channel_sats: Sequence[str],
) -> _Levels:
    at_s, signal = spans.middle_true_s, sky.signal
    band_hz = front_end.rate_hz * (0.5 if front_end.kind == "real" else 1.0)
    power = 10.0 ** (sky.cn0_dbhz(at_s)[:, rows.of] / 10.0) / band_hz  # over the noise's
    power *= np.array([1.0] * len(sky.signals) + [ray.amplitude**2 for ray in sky.rays])
    begin_s, end_s = rows.windows_s[..., 0], rows.windows_s[..., 1]
    now = ((begin_s <= at_s[:, np.newaxis, np.newaxis]) & (at_s[:, np.newaxis, np.newaxis] <= end_s)).any(axis=2)
    of_signals = np.where(now, power, 0.0)
    added = np.sum([_now(noise, at_s) for noise in sky.noises], axis=0) + np.zeros(at_s.size)
    lines = np.reshape([_now(jammer, at_s) for jammer in sky.jammers], (-1, at_s.size))
    total = 1.0 + added + of_signals.sum(axis=1) + lines.sum(axis=0)
    gain, variance = _recorded(front_end, total) if quantised else (np.ones(at_s.size), total)

    # what is white, then what only the replica's spectrum lets through
    white = variance - gain**2 * (of_signals.sum(axis=1) + lines.sum(axis=0))
    shares = np.array([_share(jammer, signal.chip_rate_hz) for jammer in sky.jammers])
    coloured = shares @ lines * band_hz / signal.chip_rate_hz
    noise = (white + gain**2 * coloured)[:, np.newaxis] * np.ones(len(channel_sats))
    if others == "noise":
        near = np.abs(np.fft.fftfreq(tables.signal.shape[1], 1.0 / (signal.code_length))) < 2.0
        through = np.sum(tables.signal[:, near] ** 2, axis=1).mean() / tables.points  # 2/3 for chips
        other = np.array(rows.sats)[:, np.newaxis] != np.array(channel_sats)
        noise += gain[:, np.newaxis] ** 2 * (of_signals @ other) * through * band_hz / signal.chip_rate_hz
    real = front_end.kind == "real"  # half of a real signal's amplitude, and of the noise's power, meets the replica
    return _Levels(
        amplitude=gain[:, np.newaxis] * np.sqrt((0.5 if real else 2.0) * power),
        sigma=np.sqrt((0.5 if real else 1.0) * noise / (front_end.rate_hz * coherent_s)),
    )


def _now(source: AddedNoise | Jammer, at_s: Reals) -> Reals:
    return np.asarray(np.where((source.from_s <= at_s) & (at_s <= source.until_s), source.power(at_s), 0.0))


def _share(jammer: Jammer, chip_rate_hz: float) -> float:
    """Of a line's power, what chips' spectrum lets through, 1 in its middle; the mean over a chirp."""
    sweep_hz = jammer.source.sweep_hz if jammer.source.kind == "chirp" else 0.0
    offsets_hz = jammer.source.offset_hz + sweep_hz * (np.arange(200) / 199.0 - 0.5)
    return float(np.mean(np.sinc(offsets_hz / chip_rate_hz) ** 2))


def _recorded(front_end: FrontEnd, power: Reals) -> tuple[Reals, Reals]:
    """Gain and power of the recorder's numbers, for normal samples of variance `power`, any shape.

    The gain of a staircase is the sum of its steps times the density there (Bussgang's theorem).
    """
    sigma = np.sqrt(power)
    before = 1.0 / sigma if front_end.agc else np.ones(power.shape)  # of the gain control
    at = sigma * before
    if front_end.encoding == "sign":
        return before * np.sqrt(2.0 / np.pi) / at, np.ones(power.shape)
    if front_end.encoding == "sign-magnitude":
        density = (2.0 + 4.0 * np.exp(-0.5 / at**2)) / (np.sqrt(2.0 * np.pi) * at)
        return before * density, 1.0 + 16.0 * scipy.special.ndtr(-1.0 / at)
    steps = _INT_SIGMA[front_end.bits] if front_end.encoding == "int" else 1.0
    return before * steps, (at * steps) ** 2 + (1.0 / 12.0 if steps > 1.0 else 0.0)


def _parts(
    sky: ReceiverSky,
    spans: _Spans,
    rows: _Waves,
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
    one, other = (np.take_along_axis(turns_cyc, at + later, axis=1)[:, 0] for later in (0, 1))
    one_s, other_s = (np.take_along_axis(edges_s, at[..., 0] + later, axis=1) for later in (0, 1))
    lengths_s = np.diff(edges_s, axis=1)[..., np.newaxis]
    return Parts(
        channel=channel,
        signal=rows.of[row],
        ray=np.where(row < n_signals, -1, row - n_signals),
        label=tuple(sky.signals[r].label if r < n_signals else "multipath" for r in row.tolist()),
        lag_chips=(lag_chips * lengths_s).sum(axis=1) / lengths_s.sum(axis=1),
        doppler_hz=(turns_cyc[:, -1] - turns_cyc[:, 0]) / (edges_s[:, -1:] - edges_s[:, :1]),
        phase_cyc=one + (other - one) * (middle_s - one_s) / (other_s - one_s),
        weight=weight.sum(axis=2)[..., np.abs(dopplers_hz).argmin()],
    )


class _Noise:
    """Noise of all taps with the covariance that the replicas give, of variance 1 in I and in Q."""

    def __init__(
        self,
        tables: Correlation,
        delays: Reals,
        dopplers: Reals,
        coherent_s: float,
        signal: SignalDescription,
        lobe_chips: float,
    ) -> None:
        self.tables, self.dopplers, self.coherent_s, self.signal = tables, dopplers, coherent_s, signal
        apart = np.subtract.outer(delays, delays)
        self.reach_chips = float(np.ptp(delays)) + lobe_chips
        self.of_delays = [_root(read(table, apart, tables.points)).T.astype(np.float32) for table in tables.replica]
        self.of_dopplers = _root(np.sinc(np.subtract.outer(dopplers, dopplers) * coherent_s)).astype(np.float32)
        distances, which = np.unique(np.round(apart, 12), return_inverse=True)  # few, if taps stand evenly
        self.apart: Reals = np.asarray(distances, np.float64)
        self.which: Integers = np.asarray(which, np.int64).reshape(delays.size, delays.size)

    def draw(
        self,
        rng: np.random.Generator,
        draws: tuple[int, ...],
        channel_sats: Sequence[str],
        sats: Sequence[str],
        spans: _Spans,
        channels: _Waves,
    ) -> ComplexFloats:
        """(*draws, n_epochs, n_channels, n_dopplers, n_delays)."""
        cell = self.dopplers.size, self.which.shape[0]
        count, epochs = math.prod(draws), spans.true_s.shape[0]
        noise = np.empty((count, epochs, len(channel_sats), *cell), np.complex64)
        for number, sat in enumerate(sats):
            mine = [channel for channel, name in enumerate(channel_sats) if name == sat]
            near = self._near(mine, channels)
            far = np.setdiff1d(np.arange(epochs), near)
            if far.size:
                shape = 2, count, far.size, len(mine), *cell
                mixed = rng.standard_normal((math.prod(shape[:-1]), cell[1]), np.float32) @ self.of_delays[number]
                if cell[0] > 1:
                    mixed = self.of_dopplers @ mixed.reshape(-1, *cell)
                mixed = mixed.reshape(shape)
                noise[:, far[:, np.newaxis], mine] = mixed[0] + 1j * mixed[1]
            if near.size:
                together = self._together(rng, count, near, mine, self.tables.replica[number], spans, channels)
                noise[:, near[:, np.newaxis], mine] = together
        return noise.reshape(*draws, *noise.shape[1:])

    def _near(self, mine: list[int], channels: _Waves) -> Integers:
        """The epochs in which replicas of these channels overlap."""
        late_chips = channels.code_s[..., mine] * self.signal.chip_rate_hz
        distance = np.diff(np.sort(late_chips, axis=-1), axis=-1)
        return np.flatnonzero((distance < self.reach_chips).any(axis=(1, 2)))

    def _together(
        self,
        rng: np.random.Generator,
        count: int,
        near: Integers,
        mine: list[int],
        table: Reals,
        spans: _Spans,
        channels: _Waves,
    ) -> ComplexFloats:
        """Channels of one satellite in these epochs: (count, n_near, n_mine, n_dopplers, n_delays)."""
        pairs = np.array([(one, other) for one in mine for other in mine])
        apart_hz = np.subtract.outer(self.dopplers, self.dopplers).ravel()
        those = _Spans(elapsed_s=spans.elapsed_s[near], true_s=spans.true_s[near])
        taken = replace(
            channels, code_s=channels.code_s[near], carrier_s=channels.carrier_s[near], sent=channels.sent[near]
        )
        lag_chips, _, coupling = _couplings(those, taken, taken, pairs, apart_hz, self.signal)
        n, d, k = len(mine), self.dopplers.size, self.which.shape[0]
        common = coupling.sum(axis=2).reshape(-1, n, n, d, d)
        lags = read(table, lag_chips.mean(axis=1).reshape(-1, n, n, 1) + self.apart, self.tables.points)
        if n == 2 and d == 1:
            return self._of_two(rng, count, common[:, 0, 1, 0, 0], lags[:, 0, 1][:, self.which], table)
        # axes: epoch, channel, channel, doppler, doppler, delay, delay
        covariance = common[..., np.newaxis, np.newaxis] * lags[..., self.which][:, :, :, np.newaxis, np.newaxis]
        root = _root(covariance.transpose(0, 1, 3, 5, 2, 4, 6).reshape(near.size, n * d * k, n * d * k))
        normals = rng.standard_normal((near.size, n * d * k, 2 * count), np.float32)
        mixed = root.astype(np.complex64) @ normals.view(np.complex64)
        return np.asarray(mixed.reshape(-1, n, d, k, count).transpose(4, 0, 1, 2, 3))

    def _of_two(
        self, rng: np.random.Generator, count: int, common: Complexes, alike: Reals, table: Reals
    ) -> ComplexFloats:
        """The same for two channels without Doppler taps: but for one turn the covariance is real, and its first block
        is known; four times faster.
        """
        k = self.which.shape[0]
        known = _root(read(table, self.apart, self.tables.points)[self.which])
        shared = np.linalg.inv(known) @ (np.abs(common)[:, np.newaxis, np.newaxis] * alike)
        rest = known @ known.T - shared.transpose(0, 2, 1) @ shared
        own = np.linalg.cholesky(rest + 10.0 * _RIDGE * np.eye(k))
        normals = rng.standard_normal((2, common.size, k, 2 * count), np.float32)
        one = known.astype(np.float32) @ normals[0]
        other = shared.transpose(0, 2, 1).astype(np.float32) @ normals[0] + own.astype(np.float32) @ normals[1]
        turn = np.exp(-1j * np.angle(common)).astype(np.complex64)[:, np.newaxis, np.newaxis]
        mixed = np.stack([one.view(np.complex64), other.view(np.complex64) * turn], axis=1)  # epoch, channel, tap, draw
        return np.asarray(mixed.transpose(3, 0, 1, 2)[:, :, :, np.newaxis])


def _root(covariance: Reals | Complexes) -> Reals | Complexes:
    """Lower triangles whose squares are covariances of variance 1, (..., n, n)."""
    return np.asarray(np.linalg.cholesky(covariance + _RIDGE * np.eye(covariance.shape[-1])))


# --- kernels


@compiled
def _couple(
    coupling: Complexes,
    pairs: Integers,
    true_s: Reals,
    turns_cyc: Reals,
    tap_cyc: Reals,
    sent: Reals,
    wiped: Reals,
    symbols: NDArray[np.int8],
    guesses: NDArray[np.int8],
    message: Integers,
    guessed: Reals,
    wiped_message: Integers,
    windows_s: Reals,
) -> None:
    """Each stretch's share of the mean of both bits times the phasor; the arrays are those of `_couplings`."""
    epochs, n_pairs, stretches, n_dopplers = coupling.shape
    for e in range(epochs):
        for p in range(n_pairs):
            c, r = pairs[p, 0], pairs[p, 1]
            for s in range(stretches):
                for d in range(n_dopplers):
                    coupling[e, p, s, d] = 0.0
                begin_s, took_s = true_s[e, s], true_s[e, s + 1] - true_s[e, s]
                if took_s <= 0.0:
                    continue
                part = took_s / (true_s[e, stretches] - true_s[e, 0])
                bit, bits = sent[e, s, r], sent[e, s + 1, r] - sent[e, s, r]
                own, owns = wiped[e, s, c], wiped[e, s + 1, c] - wiped[e, s, c]
                for w in range(windows_s.shape[1]):
                    u = min(max((windows_s[r, w, 0] - begin_s) / took_s, 0.0), 1.0)
                    end = min(max((windows_s[r, w, 1] - begin_s) / took_s, 0.0), 1.0)
                    while u < end:
                        # the middle of what is left of a bit shows which bit it is, roundings or not
                        at, own_at = math.floor(bit + u * bits + 1e-9), math.floor(own + u * owns + 1e-9)
                        until = min(end, (at + 1 - bit) / bits)
                        sign = 1.0
                        if message[r] >= 0:
                            sign = float(symbols[message[r], at])
                        if bit + u * bits + 1e-9 - at < guessed[r]:
                            sign = float(guesses[message[r], at])
                            until = min(until, (at + guessed[r] - bit) / bits)
                        if wiped_message[c] >= 0:
                            until = min(until, (own_at + 1 - own) / owns)
                            sign *= symbols[wiped_message[c], own_at]
                        if until <= u:
                            until = min(end, u + 1e-9)
                        share, half = until - u, 0.5 * (until + u)
                        for d in range(n_dopplers):
                            run = turns_cyc[e, s + 1, p] - turns_cyc[e, s, p] - tap_cyc[e, s + 1, d] + tap_cyc[e, s, d]
                            turn = turns_cyc[e, s, p] - tap_cyc[e, s, d] + run * half
                            angle_rad = 2.0 * math.pi * (turn - math.floor(turn))
                            x = math.pi * run * share
                            loss = math.sin(x) / x if abs(x) > 1e-6 else 1.0
                            size = sign * share * loss * part
                            coupling[e, p, s, d] += complex(size * math.cos(angle_rad), size * math.sin(angle_rad))
                        u = until


@compiled
def _spread(
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
