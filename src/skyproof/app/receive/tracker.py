"""Recordings tracked side by side, block by block: every signal in them, and all that it sends."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np

from skyproof.app.common.progress import Progress, Silent
from skyproof.app.common.settings import Settings
from skyproof.app.inspect import Inspection, inspect_recording
from skyproof.app.inspect.advice import remark_on_correction
from skyproof.app.receive.bridge import bridge_gaps
from skyproof.app.receive.clock_check import correct_disagreement
from skyproof.app.receive.measured import MeasurementLog, RowLog
from skyproof.app.receive.policy import POLICY
from skyproof.app.receive.vector import Guiding, guide_channels
from skyproof.arrays import Floats
from skyproof.errors import InputError
from skyproof.formats.pieces import Workspace
from skyproof.gnss.signals import GPS_L1_CA, GPS_SATS
from skyproof.gnss.time import timedelta_from_s, week_and_tow
from skyproof.interruption import watch
from skyproof.navigation.horizon import list_sats_above
from skyproof.navigation.vector_inertia import AntennaUnit
from skyproof.receiver.channels import Arc, Gap
from skyproof.receiver.grids import Grids
from skyproof.receiver.tracking import MEASURE_FRAMES, Receiver, ReceiverSettings, ReceiverState
from skyproof.recording.conditioning import condition, measure_front_end
from skyproof.records import Asked, NavigationData, Samples
from skyproof.remarks import Remark, RemarkKind

__all__ = ["Tracker", "build_receiver_settings", "carrier_at_hz", "clean_antennas", "set_up_guiding", "track"]

BLOCK_S, BLOCK_SAMPLES = 0.5, 2_500_000
"""At most, of one antenna: larger blocks leave the processor's cache, and their memory is cleared each time."""
_READER = ThreadPoolExecutor(1, "reader")


@dataclass(kw_only=True)
class Tracker:
    """One recording on its way through the receiver: which sample comes next, and all that came out so far.

    remarks : what was done to the samples before, and what ended them.
    broken : why the recording could be read no further, if it could not: all that came before counts.
    given : the recording by its description, if its codes and carriers agree at another rate or carrier only; `samples`
        are read so then, and `remarks` ends with it. checks : how often that is looked at yet.
    vector : of vector tracking. ahead : the next block, which is read while this one is worked on.
    """

    samples: Samples
    receiver: Receiver
    measured: MeasurementLog
    grids: RowLog[Grids]
    remarks: tuple[str, ...] = ()
    broken: str = ""
    given: Samples | None = None
    vector: Guiding | None = None
    checks: int = POLICY.most_checks
    state: ReceiverState = field(default_factory=ReceiverState)
    position: int = 0
    arcs: dict[int, Arc] = field(default_factory=dict)
    gaps: list[Gap] = field(default_factory=list)
    inspection: Inspection | None = None
    ahead: Future[Floats] | None = None

    def advance(self) -> bool:
        """Process the next block; False when the recording has ended, or can be read no further."""
        reading = self.ahead or self._begin_to_read(self.position)
        if reading is None or self.broken:
            return False
        try:
            planes = reading.result()
        except InputError as error:
            self.broken = str(error)
            only = f"only its first {self.examined_s:.1f} s were processed: {error}"
            self.remarks = (*self.remarks, Remark(only, RemarkKind.CUT))
            return False
        following = self.position + self._count_block(self.position)
        # No restart may come while something is read.
        self.ahead = None if self.checks else self._begin_to_read(following)
        for part in self._cut_block(planes):
            self._step(part)
        self.position = following
        if self.checks and (self.examined_s >= POLICY.checked_s or self.ended):
            self._check_clock()
        return True

    def _begin_to_read(self, position: int) -> Future[Floats] | None:
        """Begin to read the block from a sample on, beside whatever else is done; None at the end."""
        count = self._count_block(position)
        return _READER.submit(self.samples.read_all, position, count) if count > 0 else None

    def _count_block(self, position: int) -> int:
        return min(int(BLOCK_S * self.samples.rate_hz), BLOCK_SAMPLES, self.samples.n_samples - position)

    def _cut_block(self, planes: Floats) -> Iterator[Floats]:
        """Yield a block, cut where a row of measurements is complete if that guides the loops."""
        first, stop = self.position, self.position + planes.shape[-1]
        while self.vector is not None:
            row = -(-self.state.frame // MEASURE_FRAMES) * MEASURE_FRAMES
            end = self.receiver.frame_start(row + 1)
            if end > stop:
                break
            yield planes[..., first - self.position : end - self.position]
            first = end
        yield planes[..., first - self.position :]

    def _step(self, planes: Floats) -> None:
        frame = self.state.frame
        output, self.state = self.receiver.step(self.state, planes)
        self.arcs |= output.arcs  # before the measurements that name them, whenever Ctrl-C comes
        self.measured.append(output.measurements, self.arcs)
        self.gaps += output.gaps
        self.grids.append(output.grids, self.arcs)
        if self.vector is not None and self.state.frame > frame and (self.state.frame - 1) % MEASURE_FRAMES == 0:
            self.vector, self.state = guide_channels(self.vector, self.receiver, self.state, output, self.arcs)

    def _check_clock(self) -> None:
        """Restart where codes and carriers do not agree at the rate given."""
        found = correct_disagreement(self.samples, self.measured.whole(), self.arcs, self.get_inspection)
        self.checks = self.checks - 1 if found else 0
        if found is None:
            return
        self.remarks = self.remarks if self.given is None else self.remarks[:-1]
        self.given = self.given or self.samples
        self.samples, apart = found
        self.inspection = None
        self.remarks = (*self.remarks, remark_on_correction(self.given, self.samples, apart.sigma))
        self.receiver = Receiver(self.samples.rate_hz, carrier_at_hz(self.samples), self.receiver.settings)
        self.state, self.position = ReceiverState(), 0
        self.vector = None if self.vector is None else self.vector.restart()
        self.measured.clear()
        self.grids.clear()
        self.arcs, self.gaps = {}, []

    def get_inspection(self) -> Inspection:
        """Inspect `samples` at the first call, which takes seconds.

        Raises InputError and NotEnoughData as `inspect_recording` does.
        """
        if self.inspection is None:
            self.inspection = inspect_recording(self.samples)
        return self.inspection

    @property
    def examined_s(self) -> float:
        return self.position / self.samples.rate_hz

    @property
    def ended(self) -> bool:
        """Return whether all of the recording was processed."""
        return self.position >= self.samples.n_samples

    @property
    def n_epochs(self) -> int:
        """Return the rows of measurements so far; row k, from 1 on, is at k times `epoch_s`."""
        return max(int(self.state.frame - 1) // MEASURE_FRAMES, 0)

    @property
    def epoch_s(self) -> float:
        """Return the time between rows of measurements."""
        return self.measured.epoch_s


def track(
    recordings: Sequence[Samples],
    settings: Settings,
    progress: Progress | None = None,
    navigation: NavigationData | None = None,
    *,
    watchful: bool = True,
    summed: bool = False,
    asked: Asked | None = None,
    workspace: Workspace | None = None,
    units: Mapping[str, AntennaUnit] | None = None,
    look: Callable[[Sequence[Tracker]], None] | None = None,
    as_one: bool = False,
) -> tuple[list[Tracker], bool]:
    """Track all recordings side by side, so that an interruption leaves all equally far.

    navigation : gives which satellites stand above the horizon, where the place is known.

    watchful : look for further signals twice as often as receiving alone needs.

    summed : the sums of the files will be asked for.

    asked : correlators to take beside early, prompt and late.

    workspace : where measurements are kept; a temporary folder if None.

    units : inertial units by recording, which carry vector tracking from row to row.

    look : is called with the trackers after each block of all.

    as_one : measure several antennas in their sum only.

    Returns the trackers and whether a signal ended it early: what was tracked until then is kept.
    """
    if not recordings:
        return [], False
    progress = progress or Silent()
    interrupted = watch()
    kept = workspace or Workspace()
    trackers = [
        _set_up_tracker(
            samples, settings, navigation, watchful, asked or Asked(), kept, (units or {}).get(samples.name), as_one
        )
        for samples in recordings
    ]
    for samples in (antenna for recording in recordings for antenna in (recording, *recording.others)):
        if summed and samples.file is not None:
            samples.file.sum_as_read()
    names = ", ".join(s.name for s in recordings)
    total_s = sum(s.duration_s for s in recordings)
    with progress.stage(f"tracking {names}", total_s) as stage:
        running = True
        while running and not interrupted():
            running = False
            for tracker in trackers:
                running |= tracker.advance()
                stage.advance(sum(t.examined_s for t in trackers))
            if look is not None:
                look(trackers)
    return trackers, interrupted()


def _set_up_tracker(
    samples: Samples,
    settings: Settings,
    navigation: NavigationData | None,
    watchful: bool,
    asked: Asked,
    workspace: Workspace,
    unit: AntennaUnit | None = None,
    as_one: bool = False,
) -> Tracker:
    """Set up a recording's tracker: disturbances removed from the samples, stated gaps bridged."""
    clean, words = clean_antennas(samples)
    whole, filled = bridge_gaps(clean, begun_s=settings.start_s)
    sats, narrowed = _list_sats(samples, settings, navigation)
    wanted = build_receiver_settings(sats, settings, asked, watchful=watchful)
    receiver = Receiver(samples.rate_hz, carrier_at_hz(samples), wanted)
    grids: RowLog[Grids] = RowLog(workspace, f"{samples.name}/grids")
    measured = MeasurementLog(workspace, samples.name, MEASURE_FRAMES * wanted.frame_s, as_one=as_one)
    return Tracker(
        samples=whole,
        receiver=receiver,
        measured=measured,
        grids=grids,
        remarks=(*words, *filled, *narrowed),
        vector=set_up_guiding(whole, navigation, settings, unit) if settings.tracking == "vector" else None,
    )


def build_receiver_settings(
    sats: tuple[str, ...], settings: Settings, asked: Asked, *, watchful: bool = True
) -> ReceiverSettings:
    """Build the settings of a receiver that searches `sats` and takes the requested correlators.

    watchful : as in `track`.
    """
    wanted = ReceiverSettings(
        sats=sats,
        doppler_max_hz=settings.doppler_max_hz,
        near_search_s=0.5 if watchful else 1.0,
        full_search_s=10.0 if watchful else 20.0,
        grids=asked.ccaf,
    )
    if (taps := asked.taps) is None:
        return wanted
    return replace(
        wanted,
        further_taps_chips=taps.delays_chips,
        looks_per_frame=max(round(wanted.frame_s / taps.every_s), 1),
        look_share=taps.coherent_s / taps.every_s,
    )


def set_up_guiding(
    samples: Samples, navigation: NavigationData | None, settings: Settings, unit: AntennaUnit | None = None
) -> Guiding:
    """Set up vector tracking that has not begun."""
    near = samples.start_gpst if samples.start_gpst is not None else np.datetime64("now", "ns")
    week = int(week_and_tow(near)[0])
    if samples.start_gpst is None and navigation is not None and navigation.ephemerides:
        week = int(np.median([ephemeris.week for ephemeris in navigation.ephemerides]))
    return Guiding(navigation=navigation, week=week, barred=frozenset(settings.not_driving or ()), unit=unit)


def _list_sats(
    samples: Samples, settings: Settings, navigation: NavigationData | None
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """List the satellites to search, and remark on the list."""
    if settings.place_deg is None:
        return GPS_SATS, ()
    if navigation is None or samples.start_gpst is None:
        lacks = "a navigation file (--nav)" if navigation is None else "a date in the recording (start_gpst)"
        return GPS_SATS, (f"every satellite was looked for: place_deg is useful with {lacks} only",)
    lat_rad, lon_rad = np.radians(settings.place_deg)
    end = samples.start_gpst + timedelta_from_s(samples.duration_s)
    above = list_sats_above(navigation, GPS_SATS, float(lat_rad), float(lon_rad), samples.start_gpst, end)
    if len(above) < POLICY.fix_satellites:
        return GPS_SATS, (
            f"every satellite was looked for: at place_deg only {len(above)} stood above the horizon; check it and the "
            "recording's date",
        )
    return above, (f"only the {len(above)} satellites above the horizon of place_deg were looked for",)


def clean_antennas(samples: Samples) -> tuple[Samples, tuple[str, ...]]:
    """Remove what costs C/N0 from every antenna's samples, and say what was done.

    Each antenna has a front end of its own behind the one oscillator.
    """
    if not samples.others:
        return _clean(samples)
    (first, *rest), done = zip(*map(_clean, (samples, *samples.others)), strict=True)
    names = (antenna.antenna for antenna in (samples, *samples.others))
    words = [f"antenna {name}: {word}" for name, words in zip(names, done, strict=True) for word in words]
    return replace(first, others=tuple(rest)), tuple(words)


def _clean(samples: Samples) -> tuple[Samples, tuple[str, ...]]:
    """Remove what costs C/N0 from the samples, and say what was done; unchanged if too little shows it.

    Figures of DC and imbalance are reported with the levels when a file is opened, and not again.
    """
    try:
        front = measure_front_end(samples)
    except ValueError:  # too few samples, or none that changes
        return samples, ()
    done = [f"the DC offset cost {front.dc_loss_db:.2f} dB of C/N0 and is removed"] if front.removes_dc else []
    if front.balances:
        done.append(f"the I/Q imbalance made images of {front.image_db:.0f} dB and is corrected")
    done += [
        f"a line at {line.frequency_hz / 1e3:+.1f} kHz cost {line.loss_db:.2f} dB of C/N0 and is notched"
        for line in front.notched
    ]
    return condition(samples, front), tuple(done)


def carrier_at_hz(samples: Samples) -> float:
    """Return where the nominal carrier lies in the samples: the frequency `centre_hz` lies at `if_hz`."""
    return samples.if_hz + GPS_L1_CA.carrier_hz - samples.centre_hz
