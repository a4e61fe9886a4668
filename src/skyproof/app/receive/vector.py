"""Vector tracking: the navigation filter between a receiver's rows of measurements and its loops.

A row of measurements goes into the filter, and what the filter predicts goes back as guides of the channels, which hold
until the next row. All of it is a step with an explicit state.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from skyproof.app.receive.policy import POLICY
from skyproof.arrays import Booleans, Integers, Reals
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.time import gpst
from skyproof.navigation.least_squares import fit_position
from skyproof.navigation.ranges import correct_ranges
from skyproof.navigation.vector_filter import (
    CLOCK,
    VectorEpoch,
    VectorSettings,
    VectorState,
    VectorUpdate,
    dopplers_from_rates,
    predict_measurements,
    propagate_state,
    rates_from_dopplers,
    start_state,
    update_state,
)
from skyproof.navigation.vector_inertia import AntennaUnit, FreeMotion, begin_motion, carry_motion
from skyproof.navigation.vector_sky import SkyAhead, SkyEpoch, compute_sky_ahead
from skyproof.receiver import guidance as g
from skyproof.receiver import measurement as m
from skyproof.receiver.channels import Arc
from skyproof.receiver.measurement import Measurements
from skyproof.receiver.observables import WEEK_MS, ReceiverTimeTag, collect_navigation, receiver_time_tag
from skyproof.receiver.tracking import MEASURE_FRAMES, Receiver, ReceiverState, StepOutput
from skyproof.records import NavigationData, SignalId

__all__ = ["Guiding", "guide_channels"]

AHEAD_EPOCHS: Final = 24
"""For which orbits are computed at once: 5 s."""
DECODE_S: Final = 6.0
"""How often orbits are looked for in the messages, where none are given."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Guiding:
    """What vector tracking remembers from one row of measurements to the next.

    navigation : orbits, None until they are known. week : of the first sample, roughly. barred : satellites that
    neither drive the filter nor are guided. unit : of inertia, that carries the filter from row to row, until one
    has diverged; carried : its navigator. label : what the receiver's clock shows; None before a time of week was
    read. filter : None before it has begun. agreed : epochs in a row in which it was not contradicted. sky : orbits of
    the next epochs. driving : signals that drive the filter and are guided by it. out : those that ever went off it,
    and until when they track alone. began_s : when the loops first followed the filter. diverged : how often it
    went wrong. misfit_m : with which a filter could not begin.
    """

    navigation: NavigationData | None
    week: int
    barred: frozenset[str] = frozenset()
    settings: VectorSettings = field(default_factory=VectorSettings)
    unit: AntennaUnit | None = None
    carried: FreeMotion | None = None
    label: ReceiverTimeTag | None = None
    filter: VectorState | None = None
    agreed: int = 0
    sky: SkyAhead | None = None
    driving: frozenset[SignalId] = frozenset()
    out: Mapping[SignalId, float] = field(default_factory=dict)
    began_s: float | None = None
    diverged: int = 0
    misfit_m: float | None = None

    def restart(self) -> "Guiding":
        """Return the state for the same recording from its first sample on."""
        known = replace(self, label=None, filter=None, agreed=0, sky=None, driving=frozenset(), out={}, carried=None)
        return replace(known, began_s=None, diverged=0, misfit_m=None)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Return the remarks on vector tracking when the recording has ended."""
        if self.began_s is None:
            why = "no time of week, or fewer than five satellites with orbits"
            if self.misfit_m is not None:
                why = f"the signals leave {self.misfit_m:.3g} m in a fit of one position: are these the day's orbits?"
            return (f"vector tracking never began, and every channel followed its own signal: {why}",)
        without = f" without {', '.join(sorted(self.barred))}" if self.barred else ""
        often = f"; its filter was given up {self.diverged} times" if self.diverged else ""
        helped = "" if self.carried is None else ", carried by the inertial unit"
        return (f"vector tracking from {self.began_s:.1f} s on{without}{helped}{often}",)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Channels:
    """The channels (k,) that the filter may use, one a satellite: arcs, signals, time of week in ms at which each one's
    code period 0 was sent; pseudorange and its rate that the loops show, roughly; what the row of measurements holds,
    NaN where nothing."""

    arcs: tuple[int, ...]
    signals: tuple[SignalId, ...]
    sent_ms: Integers
    rough_m: Reals
    rough_m_s: Reals
    pseudorange_m: Reals
    doppler_hz: Reals
    range_sigma_m: Reals
    doppler_sigma_hz: Reals


def guide_channels(
    guiding: Guiding, receiver: Receiver, state: ReceiverState, output: StepOutput, arcs: Mapping[int, Arc]
) -> tuple[Guiding, ReceiverState]:
    """Propagate the filter over the row of measurements just completed, and guide the channels by it.

    output : of a step that ended with the frame of a row.
    """
    elapsed_s = (state.frame - 1) * receiver.settings.frame_s
    if output.gaps:  # by an unknown time, all that was known of the clock has moved
        guiding = _without_filter(replace(guiding, label=None))
    guiding = _learn_time_and_orbits(guiding, output.measurements, arcs, elapsed_s)
    if guiding.label is None or guiding.navigation is None:
        return guiding, state
    measured = Measurements.join([output.measurements, output.noncoherent])
    channels = _channels(guiding, receiver, state, measured, arcs, elapsed_s)
    if not channels.arcs:
        return guiding, state
    if guiding.filter is None:
        return _begin_filter(guiding, channels, elapsed_s, receiver), state
    return _follow(guiding, receiver, state, channels, elapsed_s)


def _learn_time_and_orbits(
    guiding: Guiding, measured: Measurements, arcs: Mapping[int, Arc], elapsed_s: float
) -> Guiding:
    """Set time and orbits as soon as there are any."""
    if guiding.label is None:
        guiding = replace(guiding, label=receiver_time_tag(measured, arcs, guiding.week))
    if guiding.navigation is None and guiding.label is not None and (elapsed_s + 1e-6) % DECODE_S < 0.1:
        found = collect_navigation(arcs, guiding.label.week, "the signals")
        if len({ephemeris.sat for ephemeris in found.ephemerides}) >= 5:
            guiding = replace(guiding, navigation=found)
    return guiding


def _without_filter(guiding: Guiding) -> Guiding:
    return replace(guiding, filter=None, agreed=0, sky=None, driving=frozenset(), out={}, carried=None)


def _channels(
    guiding: Guiding,
    receiver: Receiver,
    state: ReceiverState,
    measured: Measurements,
    arcs: Mapping[int, Arc],
    elapsed_s: float,
) -> _Channels:
    assert guiding.label is not None
    assert guiding.navigation is not None
    known = {ephemeris.sat for ephemeris in guiding.navigation.ephemerides} - guiding.barred
    of_sat: dict[str, int] = {}
    for i, channel in sorted(enumerate(state.channels), key=lambda item: (item[1].copy or "~", item[1].found_s)):
        if channel.copy is not None and channel.telemetry.tow_ms_at_period_0 is not None and channel.sat in known:
            of_sat.setdefault(channel.sat, i)
    places = [i for _, i in sorted(of_sat.items())]
    chosen = [state.channels[i] for i in places]
    k = len(chosen)
    sent_ms = np.array([channel_state.telemetry.tow_ms_at_period_0 for channel_state in chosen], np.int64)
    pseudorange_m, doppler_hz, range_sigma_m, doppler_sigma_hz = np.full((4, k), np.nan)
    row_of = {int(arc): row for row, arc in enumerate(measured.arc) if abs(measured.elapsed_s[row] - elapsed_s) < 1e-6}
    for i, channel_state in enumerate(chosen):
        if (row := row_of.get(channel_state.arc)) is None:
            continue
        table = measured.table[row]
        whole_ms = _whole_ms(guiding.label, elapsed_s, sent_ms[i] + int(table[m.PERIODS]) * receiver.signal.period_ms)
        pseudorange_m[i] = SPEED_OF_LIGHT_M_S * (whole_ms * 1e-3 - table[m.FRACTION_S])
        doppler_hz[i], doppler_sigma_hz[i] = table[m.DOPPLER_HZ], table[m.DOPPLER_SIGMA_HZ]
        range_sigma_m[i] = SPEED_OF_LIGHT_M_S * table[m.CODE_SIGMA_S]
    shown_s, doppler_shown_hz = g.read_loops(
        state.loops[places], elapsed_s, rate_hz=receiver.rate_hz, if_hz=receiver.if_hz, signal=receiver.signal
    )
    whole_ms_all = np.array([_whole_ms(guiding.label, elapsed_s, int(sent)) for sent in sent_ms])
    return _Channels(
        arcs=tuple(channel_state.arc for channel_state in chosen),
        signals=tuple(arcs[channel_state.arc].signal for channel_state in chosen),
        sent_ms=sent_ms,
        rough_m=SPEED_OF_LIGHT_M_S * (whole_ms_all * 1e-3 - shown_s),
        rough_m_s=-SPEED_OF_LIGHT_M_S / receiver.signal.carrier_hz * doppler_shown_hz,
        pseudorange_m=pseudorange_m,
        doppler_hz=doppler_hz,
        range_sigma_m=range_sigma_m,
        doppler_sigma_hz=doppler_sigma_hz,
    )


def _whole_ms(label: ReceiverTimeTag, elapsed_s: float, sent_ms: int) -> int:
    """Return receiver time less time of transmission, both in whole milliseconds of the week."""
    return (label.tow_ms + round(elapsed_s * 1e3) - sent_ms + WEEK_MS // 2) % WEEK_MS - WEEK_MS // 2


def _begin_filter(guiding: Guiding, channels: _Channels, elapsed_s: float, receiver: Receiver) -> Guiding:
    """Begin the filter, if five satellites or more fit one position."""
    assert guiding.label is not None
    assert guiding.navigation is not None
    label = gpst(guiding.label.week, np.array([guiding.label.tow_ms * 1e-3 + elapsed_s]))
    ranges = correct_ranges(channels.signals, label, channels.pseudorange_m[None], guiding.navigation)
    used = np.isfinite(ranges.range_m[0]) & np.isfinite(channels.doppler_hz)
    if used.sum() < 5:
        return guiding
    rough = fit_position(ranges.satellite_ecef_m[0], ranges.range_m[0], np.where(used, 1.0, np.nan), np.zeros(4))
    misfit_m = float(np.sqrt(np.mean(rough.residual_m[used] ** 2)))
    place_m = rough.state_m[:3]
    if not misfit_m < POLICY.worst_start_m or not np.linalg.norm(place_m) < POLICY.farthest_m:
        return replace(guiding, misfit_m=misfit_m)
    guiding, sky = _look_up_sky(guiding, receiver, channels, place_m, elapsed_s)
    began = start_state(_epoch(channels, sky, receiver, guiding.settings), sky, place_m, elapsed_s)
    driving = frozenset(signal for signal, uses in zip(channels.signals, used.tolist(), strict=True) if uses)
    at = (
        None
        if began is None or guiding.unit is None
        else begin_motion(guiding.unit, began, _true_time(guiding, began, elapsed_s))
    )
    return replace(guiding, filter=began, carried=at, agreed=0, driving=driving, out={})


def _true_time(guiding: Guiding, filtered: VectorState, elapsed_s: float) -> np.datetime64:
    """Return the true GPS time of an epoch, by the filter's clock."""
    assert guiding.label is not None
    late_s = float(filtered.mean[CLOCK]) / SPEED_OF_LIGHT_M_S
    return gpst(guiding.label.week, guiding.label.tow_ms * 1e-3 + elapsed_s - late_s)


def _predict(guiding: Guiding, elapsed_s: float) -> tuple[Guiding, VectorState]:
    """Predict the filter's state at the next row, by the inertial unit where there is one."""
    assert guiding.filter is not None
    if guiding.carried is None:
        return guiding, propagate_state(guiding.filter, elapsed_s, guiding.settings)
    found = carry_motion(guiding.carried, _true_time(guiding, guiding.filter, elapsed_s))
    if found is None:
        return replace(guiding, carried=None), propagate_state(guiding.filter, elapsed_s, guiding.settings)
    carried_unit, (change, walk2) = found
    return replace(guiding, carried=carried_unit), propagate_state(
        guiding.filter, elapsed_s, guiding.settings, change, walk2=walk2
    )


def _look_up_sky(
    guiding: Guiding, receiver: Receiver, channels: _Channels, place_ecef_m: Reals, elapsed_s: float
) -> tuple[Guiding, SkyEpoch]:
    """Look up the orbits at an epoch, computing them ahead where necessary."""
    assert guiding.label is not None
    assert guiding.navigation is not None
    known = guiding.sky
    if known is not None and known.signals == channels.signals and (found := known.at(elapsed_s)) is not None:
        return guiding, found
    at_s = elapsed_s + MEASURE_FRAMES * receiver.settings.frame_s * np.arange(AHEAD_EPOCHS, dtype=np.float64)
    sky = compute_sky_ahead(
        channels.signals,
        at_s,
        gpst(guiding.label.week, guiding.label.tow_ms * 1e-3 + at_s),
        channels.rough_m,
        channels.rough_m_s,
        place_ecef_m,
        guiding.navigation,
    )
    first = sky.at(elapsed_s)
    assert first is not None
    return replace(guiding, sky=sky), first


def _epoch(channels: _Channels, sky: SkyEpoch, receiver: Receiver, settings: VectorSettings) -> VectorEpoch:
    wavelength_m = SPEED_OF_LIGHT_M_S / receiver.signal.carrier_hz
    return VectorEpoch(
        range_m=channels.pseudorange_m + sky.offset_m,
        range_sigma_m=np.sqrt(channels.range_sigma_m**2 + sky.delay_sigma_m**2 + settings.range_sigma_m**2),
        rate_m_s=rates_from_dopplers(sky, channels.doppler_hz, receiver.signal.carrier_hz),
        rate_sigma_m_s=np.hypot(wavelength_m * channels.doppler_sigma_hz, settings.rate_sigma_m_s),
    )


def _follow(
    guiding: Guiding, receiver: Receiver, state: ReceiverState, channels: _Channels, elapsed_s: float
) -> tuple[Guiding, ReceiverState]:
    """Propagate the filter over a row, and guide the channels by it."""
    assert guiding.filter is not None
    guiding, before = _predict(guiding, elapsed_s)
    guiding, sky = _look_up_sky(guiding, receiver, channels, before.mean[:3], elapsed_s)
    epoch = _epoch(channels, sky, receiver, guiding.settings)
    waits = np.array([guiding.out.get(signal, -np.inf) > elapsed_s for signal in channels.signals])
    drove = np.array([signal in guiding.driving for signal in channels.signals])
    was_out = np.array([signal in guiding.out for signal in channels.signals])
    predicted = predict_measurements(before.mean, sky)
    off_m, off_m_s = epoch.range_m - predicted.range_m, epoch.rate_m_s - predicted.rate_m_s
    back = _exceed_bound(off_m, off_m_s, receiver) < POLICY.back_share
    near = _exceed_bound(off_m, off_m_s, receiver, chips=POLICY.comes_chips, hz=POLICY.comes_hz) < 1.0
    comes = ~waits & np.where(was_out, back, near)
    found = update_state(before, epoch, predicted, drove | comes, guiding.settings)
    if found.diverged:
        nothing = dict.fromkeys(channels.arcs, g.no_guide())
        # A unit that is not what is stated of it would lead the next filter wrong as well.
        fresh = replace(_without_filter(guiding), unit=None, diverged=guiding.diverged + 1)
        return fresh, receiver.set_guides(state, nothing)
    off_m = np.fmax(np.abs(found.range_left_m), 0.5 * np.abs(epoch.range_m - found.range_m))
    away = np.nan_to_num(np.where(drove | comes, _exceed_bound(off_m, found.rate_left_m_s, receiver), 0.0))
    stays = (drove | comes) & ~((away == away.max()) & (away > 1.0))
    leaving = [i for i in np.flatnonzero(drove & ~stays)]
    agreed = guiding.agreed + 1 if found.state.misses == 0 else 0
    guiding = replace(
        guiding,
        filter=found.state,
        agreed=agreed,
        driving=frozenset(channels.signals[i] for i in np.flatnonzero(stays)),
        out={**guiding.out, **{channels.signals[i]: elapsed_s + POLICY.out_s for i in leaving}},
    )
    guides = {channels.arcs[i]: g.no_guide() for i in leaving}
    if guiding.began_s is not None or agreed >= POLICY.agreed_epochs:
        guiding = replace(guiding, began_s=elapsed_s if guiding.began_s is None else guiding.began_s)
    if agreed >= POLICY.agreed_epochs:
        guides |= _guide(guiding, receiver, channels, found, sky, stays, elapsed_s)
    return guiding, receiver.set_guides(state, guides)


def _exceed_bound(
    misfit_m: Reals,
    rate_left_m_s: Reals,
    receiver: Receiver,
    *,
    chips: float = POLICY.out_chips,
    hz: float = POLICY.out_hz,
) -> Reals:
    """Return how many bounds channels are off, (k,); NaN where neither part is known."""
    signal = receiver.signal
    off_chips = np.abs(misfit_m) * signal.chip_rate_hz / SPEED_OF_LIGHT_M_S
    off_hz = np.abs(rate_left_m_s) * signal.carrier_hz / SPEED_OF_LIGHT_M_S
    return np.fmax(off_chips / chips, off_hz / hz)


def _guide(
    guiding: Guiding,
    receiver: Receiver,
    channels: _Channels,
    found: VectorUpdate,
    sky: SkyEpoch,
    stays: Booleans,
    elapsed_s: float,
) -> dict[int, Reals]:
    """Guide the channels that stay and whose prediction is sure enough."""
    assert guiding.label is not None
    signal, settings = receiver.signal, receiver.settings
    sigma_m, sigma_m_s = (
        np.sqrt(np.einsum("ki,ij,kj->k", found.design, found.state.covariance[np.ix_(places, places)], found.design))
        for places in ([0, 1, 2, 6], [3, 4, 5, 7])
    )
    sure = stays & (sigma_m < POLICY.sure_m) & (sigma_m_s < POLICY.sure_m_s)
    doppler_hz = dopplers_from_rates(sky, found.rate_m_s, signal.carrier_hz)
    correction_hz = np.nan_to_num(found.rate_left_m_s) * signal.carrier_hz / SPEED_OF_LIGHT_M_S
    delay_s = (found.range_m - sky.offset_m) / SPEED_OF_LIGHT_M_S
    until_s = elapsed_s + (POLICY.lapse_epochs + 0.5) * MEASURE_FRAMES * settings.frame_s
    guides = {}
    for i in np.flatnonzero(sure).tolist():
        guide = np.full(g.N_GUIDE, np.nan)
        guide[g.AT_S] = elapsed_s
        guide[g.SENT_S] = _whole_ms(guiding.label, elapsed_s, int(channels.sent_ms[i])) * 1e-3 - delay_s[i]
        guide[g.DOPPLER_HZ], guide[g.CORRECTION_HZ] = doppler_hz[i], correction_hz[i]
        guide[g.UNTIL_S] = until_s
        guides[channels.arcs[i]] = guide
    return guides
