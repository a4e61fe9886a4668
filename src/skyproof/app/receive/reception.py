"""Recordings to observations: track everything, tell what was heard."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from skyproof.app.common.progress import Progress, Silent
from skyproof.app.common.settings import Settings
from skyproof.app.inspect.advice import correction_remark
from skyproof.app.receive.bridge import bridged
from skyproof.app.receive.clock_check import CHECKED_S, MOST_CHECKS, agreeing
from skyproof.app.receive.diagnosis import Diagnosis, diagnosis, gap_remarks, oscillator_told
from skyproof.arrays import Indices, Reals
from skyproof.errors import InputError, NotEnoughData
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.orbits import satellite_state
from skyproof.gnss.signals import GPS_L1_CA, GPS_SATS
from skyproof.gnss.time import iso, resolve_week, seconds_between, week_and_tow
from skyproof.navigation.clock import anchored
from skyproof.navigation.fix import fix
from skyproof.navigation.horizon import sats_above
from skyproof.receiver.channels import Arc, Gap
from skyproof.receiver.grids import Grids
from skyproof.receiver.measurement import DOPPLER_HZ, Measurements
from skyproof.receiver.observables import (
    ReceiverTimeTag,
    array_phases_of,
    assemble,
    ccaf_of,
    messages_that_differ,
    navigation_of,
    receiver_time_tag,
    taps_of,
    timed_by_range,
    week_told,
)
from skyproof.receiver.tracking import MEASURE_FRAMES, Receiver, ReceiverSettings, ReceiverState
from skyproof.recording.conditioning import conditioned, measure_front_end
from skyproof.records import (
    AntennaArray,
    ArrayPhases,
    Asked,
    Ccaf,
    FixStatus,
    NavigationData,
    Observations,
    Samples,
    SignalId,
    Source,
    Taps,
)

__all__ = ["Reception", "Tracker", "clock_biases_s", "observe", "require_signals", "track"]

BLOCK_S = 0.5
ENOUGH_SATS = 4
NEARLY_ALL = 0.9
MANY_ARCS = 5  # a satellite; whoever reads the spectrum mirrored has ten times as many
FOLLOWED_S = 2.0  # shorter, a signal that is there may not have proved itself
TIME_OF_WEEK_S = 12.0  # by then a signal has told its time of week: it does so every 6 s, once its bits can be read


@dataclass(frozen=True, eq=False, kw_only=True)
class Reception:
    """What one receiver heard: its recording after tracking, or its own measurements.

    observations : None if there are none; `left_out` then says why.
    examined_s : how much of the recording was worked on.
    same_as : the receiver whose noise it holds too, where the two are taken as one; its observations are then left out.
    messages_differ : where signals of one satellite tell different messages, in words; among the remarks as well.
    taps, ccaf : correlators beside the observations, if they were asked for.
    antennas : the same signals at the same epochs on each antenna, where the receiver has several; `observations` are
        those of the first, or if that has clearly fewer those of the antenna that has most.
    array_phases : the carrier's phases on all of them, if it is known where they are.
    """

    source: Source
    observations: Observations | None
    told: NavigationData  # by the signals themselves
    n_signals: int
    examined_s: float
    left_out: str | None = None
    same_as: str | None = None
    remarks: tuple[str, ...] = ()
    messages_differ: tuple[str, ...] = ()
    taps: Taps | None = None
    ccaf: Ccaf | None = None
    antennas: tuple[Observations, ...] = ()
    array_phases: ArrayPhases | None = None

    @property
    def samples(self) -> Samples | None:
        """The recording, where the source is one."""
        return self.source if isinstance(self.source, Samples) else None


@dataclass(kw_only=True)
class Tracker:
    """One recording on its way through the receiver: which sample comes next, and all that came out so far.

    told : what was done to the samples before, and what ended them.
    broken : why the recording could be read no further, if it could not: all that came before counts.
    given : the recording as it is described, if its codes and carriers agree at another rate or carrier only; `samples`
        are read so then, and `told` ends with it. checks : how often that is looked at yet.
    """

    samples: Samples
    receiver: Receiver
    told: tuple[str, ...] = ()
    broken: str = ""
    given: Samples | None = None
    checks: int = MOST_CHECKS
    state: ReceiverState = field(default_factory=ReceiverState)
    position: int = 0
    measured: list[Measurements] = field(default_factory=list)
    arcs: dict[int, Arc] = field(default_factory=dict)
    gaps: list[Gap] = field(default_factory=list)
    grids: list[Grids] = field(default_factory=list)

    def advance(self) -> bool:
        """Work on the next block; False when the recording has ended, or can be read no further."""
        count = min(int(BLOCK_S * self.samples.rate_hz), self.samples.n_samples - self.position)
        if count <= 0 or self.broken:
            return False
        try:
            planes = self.samples.read_all(self.position, count)
        except InputError as error:
            self.broken = str(error)
            self.told = (*self.told, f"only its first {self.examined_s:.1f} s were worked on: {error}")
            return False
        output, self.state = self.receiver.step(self.state, planes)
        self.position += count
        self.arcs |= output.arcs  # before the measurements that name them, whenever Ctrl-C comes
        self.measured.append(output.measurements)
        self.gaps += output.gaps
        self.grids.append(output.grids)
        if self.checks and (self.examined_s >= CHECKED_S or self.ended):
            self._check_clock()
        return True

    def _check_clock(self) -> None:
        """Begin anew where codes and carriers do not agree at the rate given."""
        found = agreeing(self.samples, self.measurements, self.arcs)
        self.checks = self.checks - 1 if found else 0
        if found is None:
            return
        self.told = self.told if self.given is None else self.told[:-1]
        self.given = self.given or self.samples
        self.samples, apart = found
        self.told = (*self.told, correction_remark(self.given, self.samples, apart.sigma))
        self.receiver = Receiver(self.samples.rate_hz, carrier_at_hz(self.samples), self.receiver.settings)
        self.state, self.position = ReceiverState(), 0
        self.measured, self.arcs, self.gaps, self.grids = [], {}, [], []

    @property
    def examined_s(self) -> float:
        return self.position / self.samples.rate_hz

    @property
    def ended(self) -> bool:
        """Whether all of the recording was worked on."""
        return self.position >= self.samples.n_samples

    @property
    def measurements(self) -> Measurements:
        return Measurements.joined(self.measured)

    @property
    def epoch_s(self) -> float:
        """From one row of measurements to the next."""
        return MEASURE_FRAMES * self.receiver.settings.frame_s


def track(
    recordings: Sequence[Samples],
    settings: Settings,
    progress: Progress | None = None,
    navigation: NavigationData | None = None,
    *,
    watchful: bool = True,
    summed: bool = False,
    asked: Asked | None = None,
) -> tuple[list[Tracker], bool]:
    """Track all recordings side by side, so that an interruption leaves all equally far.

    navigation : tells which satellites stand above the horizon, where the place is known.

    watchful : look for further signals twice as often as receiving alone needs.

    summed : the sums of the files will be asked for.

    asked : correlators to take beside early, prompt and late.

    Returns the trackers and whether Ctrl-C ended it early: what was tracked until then is kept.
    """
    progress = progress or Silent()
    trackers = [_tracker(samples, settings, navigation, watchful, asked or Asked()) for samples in recordings]
    for samples in (one for recording in recordings for one in (recording, *recording.others)):
        if summed and samples.file is not None:
            samples.file.sum_as_read()
    names = ", ".join(s.name for s in recordings)
    total_s = sum(s.duration_s for s in recordings)
    try:
        with progress.stage(f"tracking {names}", total_s) as stage:
            running = True
            while running:
                running = False
                for tracker in trackers:
                    running |= tracker.advance()
                    stage.advance(sum(t.examined_s for t in trackers))
    except KeyboardInterrupt:
        return trackers, True
    return trackers, False


def _tracker(
    samples: Samples, settings: Settings, navigation: NavigationData | None, watchful: bool, asked: Asked
) -> Tracker:
    """A recording made ready: what hurts in its samples taken off, gaps that it tells of bridged."""
    clean, cleaned = _cleaned_all(samples)
    whole, filled = bridged(clean, begun_s=settings.start_s)
    sats, narrowed = _sats(samples, settings, navigation)
    receiver_settings = ReceiverSettings(
        sats=sats,
        doppler_max_hz=settings.doppler_max_hz,
        near_search_s=0.5 if watchful else 1.0,
        full_search_s=10.0 if watchful else 20.0,
        grids=asked.ccaf,
    )
    if (taps := asked.taps) is not None:
        receiver_settings = replace(
            receiver_settings,
            further_taps_chips=taps.delays_chips,
            looks_per_frame=max(round(receiver_settings.frame_s / taps.every_s), 1),
            look_share=taps.coherent_s / taps.every_s,
        )
    receiver = Receiver(samples.rate_hz, carrier_at_hz(samples), receiver_settings)
    return Tracker(samples=whole, receiver=receiver, told=(*cleaned, *filled, *narrowed))


def _sats(
    samples: Samples, settings: Settings, navigation: NavigationData | None
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The satellites to look for, and what was done to their list."""
    if settings.place_deg is None:
        return GPS_SATS, ()
    if navigation is None or samples.start_gpst is None:
        lacks = "a navigation file (--nav)" if navigation is None else "a date in the recording (start_gpst)"
        return GPS_SATS, (f"every satellite was looked for: place_deg is of use with {lacks} only",)
    lat_rad, lon_rad = np.radians(settings.place_deg)
    end = samples.start_gpst + np.timedelta64(round(samples.duration_s * 1e9), "ns")
    above = sats_above(navigation, GPS_SATS, float(lat_rad), float(lon_rad), samples.start_gpst, end)
    if len(above) < ENOUGH_SATS:
        return GPS_SATS, (
            f"every satellite was looked for: at place_deg only {len(above)} stood above the horizon; check it and the "
            "recording's date",
        )
    return above, (f"only the {len(above)} satellites above the horizon of place_deg were looked for",)


def _cleaned_all(samples: Samples) -> tuple[Samples, tuple[str, ...]]:
    """`_cleaned` antenna by antenna: each has a front end of its own behind the one oscillator."""
    if not samples.others:
        return _cleaned(samples)
    (first, *others), told = zip(*map(_cleaned, (samples, *samples.others)), strict=True)
    names = (one.antenna for one in (samples, *samples.others))
    words = [f"antenna {name}: {word}" for name, words in zip(names, told, strict=True) for word in words]
    return replace(first, others=tuple(others)), tuple(words)


def _cleaned(samples: Samples) -> tuple[Samples, tuple[str, ...]]:
    """The recording without what costs C/N0, and what was done; itself where nothing does, or too little tells it.

    Figures of DC and imbalance are told with the levels when a file is opened, and not again.
    """
    try:
        front = measure_front_end(samples)
    except ValueError:  # too few samples, or none that changes
        return samples, ()
    told = [f"the DC offset cost {front.dc_loss_db:.2f} dB of C/N0 and is removed"] if front.removes_dc else []
    if front.balances:
        told.append(f"the I/Q imbalance made images of {front.image_db:.0f} dB and is corrected")
    told += [
        f"a line at {line.frequency_hz / 1e3:+.1f} kHz cost {line.loss_db:.2f} dB of C/N0 and is notched"
        for line in front.notched
    ]
    return conditioned(samples, front), tuple(told)


def carrier_at_hz(samples: Samples) -> float:
    """Where the nominal carrier lies in the samples: the frequency `centre_hz` lies at `if_hz`."""
    return samples.if_hz + GPS_L1_CA.carrier_hz - samples.centre_hz


def observe(tracker: Tracker, navigation: NavigationData | None, array: AntennaArray | None = None) -> Reception:
    """Time, observations and navigation data of one tracked recording.

    array : where its antennas are, if it has several and that is known.

    The week comes from the recording's date, else from the navigation file, else from the message (which knows it
    modulo 1024, resolved by nothing better than the calendar's present era).
    """
    samples = tracker.samples
    heard = {arc.signal for arc in tracker.arcs.values()}
    remarks: list[str] = [*tracker.told]
    week = _week(tracker, navigation, remarks)
    label = _label(tracker, week)
    if label is not None:
        label = _near_date(label, samples, tracker.arcs, remarks)
        week = label.week
    told = navigation_of(tracker.arcs, week, samples.path or samples.name)
    orbits = navigation if navigation is not None else told
    antennas: tuple[Observations, ...] = ()
    observations = phases = ccaf = None
    if label is not None:
        antennas = _on_antennas(tracker, tracker.arcs, label)
        best = _best(antennas)
        timed = _all_timed(tracker, antennas[best], orbits, label, remarks)
        arcs = tracker.arcs if timed is None else timed
        if timed is not None:
            antennas = _on_antennas(tracker, arcs, label)
        biases_s = clock_biases_s(antennas[best], orbits, tracker.gaps)
        if biases_s is not None:
            antennas = tuple(anchored(one, biases_s) for one in antennas)
        observations = antennas[best]
        ccaf = _ccaf(tracker, arcs, label, observations)
        if array is not None:
            phases = _array_phases(tracker, observations, array)
        if best:
            remarks.append(
                f"its measurements are those on antenna {best + 1} of {len(antennas)}, for the first has fewer: check "
                "that antenna and its line"
            )
    found = _diagnosed(tracker) if observations is None or _is_doubtful(tracker) else None
    if found is None or not found.mirrored:  # signals of a mirrored spectrum are lost all the time: no gaps are told
        remarks += gap_remarks(tracker.gaps, tracker.receiver.signal.period_s)
        remarks += oscillator_told(_dopplers_hz(tracker))
    differ = tuple(messages_that_differ(tracker.arcs))
    remarks += differ
    left_out = None
    if observations is None:
        left_out = _no_time(tracker, len(heard)) if heard else _nothing_heard(tracker, found)
        left_out += "" if found is None else f"; {found.cure}"
        remarks.append(f"left out: {left_out}")
    elif found is not None:
        remarks.append(f"few signals as it was read, or none for long: {found.cure}")
    return Reception(
        source=samples,
        observations=observations,
        told=told,
        n_signals=len(heard),
        examined_s=tracker.examined_s,
        left_out=left_out,
        remarks=tuple(remarks),
        messages_differ=differ,
        taps=None if observations is None else _taps(tracker, observations.elapsed_s),
        ccaf=ccaf,
        antennas=antennas if len(antennas) > 1 else (),
        array_phases=phases,
    )


def require_signals(trackers: Sequence[Tracker]) -> None:
    """Raise NotEnoughData if no recording holds a signal, or InputError if that is because none could be read.

    One that holds none beside others that do is left out.
    """
    if trackers and not any(tracker.arcs for tracker in trackers):
        broken = [tracker.broken for tracker in trackers if tracker.broken]
        if broken:
            raise InputError("; ".join(broken))
        paths = ", ".join(t.samples.path or t.samples.name for t in trackers)
        found = diagnosis(trackers[0].samples, trackers[0].receiver.settings.doppler_max_hz)
        raise NotEnoughData(f"{paths}: {_nothing_heard(trackers[0], found)}; {found.cure}")


def _is_doubtful(tracker: Tracker) -> bool:
    """Whether what was heard looks as if the recording was not read as it should be."""
    n_sats = len({arc.signal.sat for arc in tracker.arcs.values()})
    return n_sats < ENOUGH_SATS or len(tracker.arcs) > MANY_ARCS * n_sats


def _diagnosed(tracker: Tracker) -> Diagnosis | None:
    """None of a recording that was left before its end: whoever interrupts does not wait."""
    return diagnosis(tracker.samples, tracker.receiver.settings.doppler_max_hz) if tracker.ended else None


def _dopplers_hz(tracker: Tracker) -> list[float]:
    """The mean of each satellite's signals."""
    measurements = tracker.measurements
    values: dict[str, list[float]] = {}
    for number, doppler_hz in zip(measurements.arc.tolist(), measurements.column(DOPPLER_HZ).tolist(), strict=True):
        values.setdefault(tracker.arcs[number].signal.sat, []).append(doppler_hz)
    return [float(np.nanmean(of_sat)) for of_sat in values.values()]


def _nothing_heard(tracker: Tracker, found: Diagnosis | None) -> str:
    """What to check if no satellite was followed, in the order of likelihood."""
    samples = tracker.samples
    if found is not None and found.n_sats and samples.duration_s < FOLLOWED_S:
        return (
            f"it holds {found.n_sats} satellites, read as it is described, but lasts {samples.duration_s:.3g} s, and "
            f"signals have to be followed for seconds: give {TIME_OF_WEEK_S:g} s or more"
        )
    return (
        f"no GPS L1 C/A signal found in {tracker.examined_s:.1f} s; it was read as {samples.format}, "
        f"{samples.rate_hz:g} samples/s, carrier at {carrier_at_hz(samples):g} Hz: "
        "check rate_hz, if_hz, kind, encoding, bits and bit_order in its sidecar, that the antenna was connected, and "
        "whether the oscillator may be off by more than the search reaches (doppler_max_hz)"
    )


def _no_time(tracker: Tracker, n_signals: int) -> str:
    """Why signals without a time of week are of no use, and what would give it."""
    cure = (
        f"give {TIME_OF_WEEK_S:g} s of signal or more"
        if tracker.examined_s < TIME_OF_WEEK_S
        else "the signals are too weak or too often interrupted to read their messages"
    )
    return f"{n_signals} signals found, but no time of week read from them in {tracker.examined_s:.1f} s: {cure}"


def _week(tracker: Tracker, navigation: NavigationData | None, remarks: list[str]) -> int:
    start = tracker.samples.start_gpst
    if start is not None:
        return int(week_and_tow(start)[0])
    if navigation is not None and navigation.ephemerides:
        week = int(np.median([e.week for e in navigation.ephemerides]))
        remarks.append(f"no date in the sidecar: GPS week {week} taken from the navigation file")
        return week
    told = week_told(tracker.arcs)
    near = np.datetime64("now", "ns")
    week = resolve_week(told, near) if told is not None else int(week_and_tow(near)[0])
    remarks.append(
        f"no date in the sidecar and no navigation file: GPS week {week} taken "
        + ("from the message, as the one nearest to today" if told is not None else "as today's; give start_gpst")
    )
    return week


def _label(tracker: Tracker, week: int) -> ReceiverTimeTag | None:
    """The label at the first sample: from what was measured before samples were missing, if that tells it."""
    whole = tracker.measurements
    rows = _segment(whole.elapsed_s, tracker.gaps) == 0
    label = receiver_time_tag(whole.chosen(rows), tracker.arcs, week)
    return label if label is not None else receiver_time_tag(whole, tracker.arcs, week)


def _segment(elapsed_s: ArrayLike, gaps: Sequence[Gap]) -> Indices:
    """How many unmarked gaps lie before each moment."""
    return np.searchsorted(np.sort([gap.elapsed_s for gap in gaps]), np.asarray(elapsed_s, float), side="right")


def _near_date(
    label: ReceiverTimeTag, samples: Samples, arcs: Mapping[int, Arc], remarks: list[str]
) -> ReceiverTimeTag:
    """The label in the week that brings it nearest to the recording's date; tell if the signals say otherwise.

    A recorder's clock may never have been set. The message knows the week modulo 1024.
    """
    if samples.start_gpst is None:
        return label
    week, tow_s = week_and_tow(samples.start_gpst)
    ahead_s = label.tow_ms * 1e-3 - tow_s
    turned = round(ahead_s / 604800.0)
    label = replace(label, week=int(week) - turned)
    off_s = ahead_s - 604800.0 * turned
    told = _week_of_message(arcs, label)
    if told is not None and (told - label.week) % 1024 != 0:
        label = replace(label, week=resolve_week(told, samples.start_gpst))
        off_s += 604800.0 * (label.week - int(week) + turned)
    if abs(off_s) > 2.0:
        remarks.append(
            f"the sidecar's start_gpst is {iso(samples.start_gpst, 0)}, but the signals' own time differs from it by "
            f"{off_s:+.1f} s; the signals' time is used"
        )
    return label


def _week_of_message(arcs: Mapping[int, Arc], label: ReceiverTimeTag) -> int | None:
    """The week at `label`, modulo 1024, that most signals tell; None if none does."""
    half_week_s = 302_400
    weeks = Counter(
        (int(first.fields["week_mod_1024"]) - (first.tow_s < label.tow_ms * 1e-3 - half_week_s)) % 1024
        for arc in arcs.values()
        if (first := arc.subframes.get(1)) is not None
    )
    return weeks.most_common(1)[0][0] if weeks else None


def _on_antennas(tracker: Tracker, arcs: Mapping[int, Arc], label: ReceiverTimeTag) -> tuple[Observations, ...]:
    """What each antenna measured; of a receiver with one, all that there is."""
    settings, measured = tracker.receiver.settings, tracker.measurements
    parts = [measured.on_antenna(antenna) for antenna in range(measured.own.shape[1])] or [measured]
    n_epochs = int(tracker.state.frame - 1) // MEASURE_FRAMES
    return tuple(
        assemble(
            tracker.samples.name,
            part,
            arcs,
            label,
            settings.frame_s * MEASURE_FRAMES * np.arange(1.0, n_epochs + 1),
            carrier_hz=settings.signal.carrier_hz,
            averaged_s=tracker.epoch_s,
        )
        for part in parts
    )


def _best(antennas: Sequence[Observations]) -> int:
    """The antenna whose measurements stand for the receiver: the first, if it has nearly as many as any."""
    counts = [int(np.isfinite(one.pseudorange_m).sum()) for one in antennas]
    return 0 if counts[0] >= NEARLY_ALL * max(counts) else int(np.argmax(counts))


def _array_phases(tracker: Tracker, observations: Observations, array: AntennaArray) -> ArrayPhases | None:
    """None if there is no epoch."""
    if observations.elapsed_s.size == 0:
        return None
    return array_phases_of(
        observations.receiver,
        tracker.measurements,
        tracker.arcs,
        observations.elapsed_s,
        observations.gpst,
        array=array,
        carrier_hz=tracker.receiver.settings.signal.carrier_hz,
        averaged_s=tracker.epoch_s,
    )


def _taps(tracker: Tracker, elapsed_s: Reals) -> Taps | None:
    """The correlators that were asked for, at the epochs of the observations."""
    receiver = tracker.receiver
    if not receiver.settings.looks_per_frame:
        return None
    return taps_of(
        tracker.samples.name,
        tracker.measurements,
        tracker.arcs,
        elapsed_s,
        delays_chips=receiver.taps_chips,
        dopplers_hz=receiver.taps_hz,
        samples_per_period=receiver.rate_hz * receiver.signal.period_s,
        averaged_s=tracker.epoch_s,
        look_share=receiver.settings.look_share,
    )


def _ccaf(tracker: Tracker, arcs: Mapping[int, Arc], label: ReceiverTimeTag, observations: Observations) -> Ccaf | None:
    """The correlation grids that were asked for; None without any."""
    taken, grids = tracker.receiver.grids, Grids.joined(tracker.grids)
    if taken is None or not len(grids):
        return None
    return ccaf_of(tracker.samples.name, grids, taken, arcs, label, observations)


def _all_timed(
    tracker: Tracker, observations: Observations, orbits: NavigationData, label: ReceiverTimeTag, remarks: list[str]
) -> dict[int, Arc] | None:
    """Arcs too short for a subframe take their time of week from the position that the others give; None if no arc
    gains by it.
    """
    untimed = [arc for arc in tracker.arcs.values() if arc.tow_ms_at_period_0 is None and arc.bit_synchronised]
    if not untimed:
        return None
    shown = fix(observations, orbits, signals=first_copies(observations), elevation_mask_deg=0.0)
    good = np.flatnonzero(shown.status == FixStatus.OK)
    if good.size == 0:
        return None

    segment = _segment(observations.elapsed_s[good], tracker.gaps)

    def range_m(sat: str, elapsed_s: float) -> float | None:
        # Beyond a gap the receiver's clock is another one.
        near = good[segment == _segment(elapsed_s, tracker.gaps)]
        if near.size == 0:
            return None
        row = near[np.argmin(np.abs(observations.elapsed_s[near] - elapsed_s))]
        ephemeris = orbits.best(sat, shown.gpst[row])
        if ephemeris is None:
            return None
        later = np.timedelta64(round((elapsed_s - float(observations.elapsed_s[row])) * 1e9), "ns")
        state = satellite_state(ephemeris, shown.gpst[row] + later - np.timedelta64(75, "ms"))
        clock_s = float(shown.clock_bias_s[row]) - float(state.clock_s)
        away_m = float(np.linalg.norm(state.position_ecef_m - shown.position_ecef_m[row]))
        return away_m + SPEED_OF_LIGHT_M_S * clock_s

    arcs = timed_by_range(tracker.arcs, tracker.measurements, label, range_m)
    gained = sorted(
        str(arc.signal)
        for number, arc in arcs.items()
        if arc.tow_ms_at_period_0 is not None and tracker.arcs[number].tow_ms_at_period_0 is None
    )
    if not gained:
        return None
    remarks.append(
        f"{', '.join(gained)}: received too shortly for a time of week of their own; it was taken from the range that "
        "the position of the others predicts"
    )
    return arcs


def clock_biases_s(observations: Observations, navigation: NavigationData, gaps: Sequence[Gap]) -> Reals | None:
    """By how much to move the clock label at each epoch, (n_epochs,), to bring it to within half a millisecond of what
    most signals say; None where they give no fix at all. Where samples are missing unmarked it steps by what is
    missing. Where the signals' time goes back, as in a recording joined to itself, it goes on with the samples.
    """
    shown = fix(observations, navigation, signals=first_copies(observations), elevation_mask_deg=0.0)
    known = np.isfinite(shown.clock_bias_s)
    if not known.any():
        return None
    segment = _segment(observations.elapsed_s, gaps)
    told = np.unique(segment[known])
    biases_s = np.array([np.median(shown.clock_bias_s[known & (segment == one)]) for one in told])
    biases_s = np.minimum.accumulate(biases_s)  # labels never go back, where the signals' time does
    chosen = biases_s[np.clip(np.searchsorted(told, segment), 0, told.size - 1)]
    # When a gap began is known to a few epochs only: the fixes themselves tell on which side of it they lie.
    chosen[known] = biases_s[np.argmin(np.abs(shown.clock_bias_s[known][:, None] - biases_s), axis=1)]
    return np.asarray(chosen)


def first_copies(observations: Observations) -> tuple[SignalId, ...]:
    """Of each satellite the signal that was found first."""
    first: dict[str, SignalId] = {}
    for signal in sorted(observations.signals, key=lambda s: (len(s.copy), s.copy)):
        first.setdefault(signal.sat, signal)
    return tuple(first.values())


def overlap_s(a: Observations, b: Observations) -> float:
    """Common time of two receivers, seconds; negative if they were recorded one after the other."""
    return float(seconds_between(min(a.gpst[-1], b.gpst[-1]), max(a.gpst[0], b.gpst[0])))
