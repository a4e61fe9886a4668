"""From whole observations to windows of records, and what every detector says of each."""

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np

from skyproof.app.common.body import Body
from skyproof.app.common.epoch_source import EpochSource
from skyproof.app.common.settings import Settings
from skyproof.arrays import Instants, Reals
from skyproof.detectors.base import Detector
from skyproof.detectors.levels.front_end import carrier_name
from skyproof.detectors.registry import instantiate, load_detectors
from skyproof.fusion.policy import POLICY
from skyproof.gnss.time import timedelta_from_s
from skyproof.navigation.clock import TimeBreaks
from skyproof.navigation.inertial_predictor import Inertial
from skyproof.navigation.predictor import Predictor, Standing
from skyproof.navigation.sets import find_consistent_sets
from skyproof.navigation.window import median_interval_s
from skyproof.records import (
    ArrayPhases,
    Asked,
    Ccaf,
    CcafAsked,
    CellStatus,
    ConsistentSet,
    FrontEndLevels,
    Holding,
    NavigationData,
    Need,
    ObservationLog,
    Observations,
    ReceivedMessages,
    ReceiverFixes,
    Records,
    SignalId,
    SnapshotChanges,
    SpinArm,
    Taps,
    TapsAsked,
    TimeSliced,
)

__all__ = [
    "Run",
    "Windows",
    "asked",
    "cut",
    "find_tier",
    "instantiate_detectors",
    "widen_windows",
    "windows_of",
]

H = TypeVar("H", bound=Hashable)

NO_TIME = np.datetime64("NaT", "ns")
STRETCH_EPOCHS = 1024
RECEIVED = frozenset({Need.OBSERVATIONS, Need.TWO_RECEIVERS, Need.SETS, Need.NAVIGATION, Need.FINDINGS})
"""What any detector may need that every receiver makes, sooner or later; the rest comes from special equipment."""


def cut(observations: ObservationLog, start_gpst: np.datetime64, end_gpst: np.datetime64) -> Observations:
    """Return the epochs with start <= label < end."""
    first, stop = np.searchsorted(observations.gpst, [start_gpst, end_gpst])
    return observations.read(int(first), int(stop))


def find_span_s(
    observations: ObservationLog, start_gpst: np.datetime64, end_gpst: np.datetime64
) -> tuple[float, float]:
    """Return the elapsed seconds between which everything is nearest to the epochs with start <= label < end."""
    first, stop = (int(row) for row in np.searchsorted(observations.gpst, [start_gpst, end_gpst]))
    elapsed_s = observations.elapsed_s

    def find_middle_s(row: int) -> float:
        """Return the middle between an epoch and the one before it."""
        if row == 0 or row == elapsed_s.size:
            return -np.inf if row == 0 else np.inf
        return 0.5 * float(elapsed_s[row - 1] + elapsed_s[row])

    return find_middle_s(first), find_middle_s(stop)


def widen_windows(settings: Settings, observations: Sequence[ObservationLog]) -> Settings:
    """Return the settings with windows of at least five epochs of the receiver that has fewest."""
    needed_s = round(
        POLICY.least_window_epochs * max((median_interval_s(o.elapsed_s) for o in observations), default=0.0), 3
    )
    return settings if needed_s <= settings.window_s else settings.model_copy(update={"window_s": needed_s})


@dataclass(frozen=True, eq=False, kw_only=True)
class Arrived:
    """What came of one receiver's epochs: their labels (n,), the usual time between them, and breaks of its time (m,).

    until_gpst : up to when nothing more can come.
    """

    gpst: Instants
    interval_s: float
    breaks: Instants
    until_gpst: np.datetime64


def window_edges(
    received: Sequence[Arrived], window_s: float, *, keep_pauses: bool = False, ended: bool = True
) -> list[np.datetime64]:
    """Return the edges of the windows, common to all receivers: from the first epoch of any to past the last.

    Windows in a row that hold no epoch are one, for a log may pause for years. Not so with `keep_pauses`: correlators
    may have measured where no epoch came of it.

    Where a receiver's time breaks one window ends and another begins: ranges before and after it have nothing in
    common, and a mean over both describes neither. So it is where all begin, and where the first of them ends:
    the windows of all do not hold what one of them measured without the others. A single epoch makes no window.

    ended : whether nothing more comes; if not, edges are those that no further epoch moves.
    """
    first = min(source.gpst[0] for source in received)
    last = max(source.until_gpst for source in received) + np.timedelta64(1, "ms")
    # Between epochs: those of receivers that do not steer their clocks come some milliseconds early or late.
    longest_s = min(max(source.interval_s for source in received), window_s / POLICY.least_window_epochs)
    early = timedelta_from_s(0.5 * longest_s)
    all_from, all_to = max(source.gpst[0] for source in received), min(source.until_gpst for source in received)
    most = max(timedelta_from_s(POLICY.ends_together_s), 3 * early)  # of one epoch nothing can be said
    alone = [at for at, by in ((all_from, all_from - first), (all_to + 2 * early, last - all_to)) if by > most]
    breaks = np.unique(np.concatenate([*(source.breaks for source in received), np.array(alone, "M8[ns]")]))
    epochs = np.unique(np.concatenate([source.gpst for source in received]))
    edges = [first]
    for begin, end in pairwise([first, *breaks, last]):
        if end - begin > early or end == last:  # not at the break that another receiver saw at its own epoch
            within = None if keep_pauses else epochs[slice(*np.searchsorted(epochs, [begin - early, end]))]
            goes_on = end == last and not ended
            edges += [*_space_evenly(begin, end, window_s, early, within, goes_on), end if end == last else end - early]
    return edges if ended else edges[:-1]


def _space_evenly(
    begin: np.datetime64,
    end: np.datetime64,
    window_s: float,
    early: np.timedelta64,
    epochs: Instants | None,
    goes_on: bool,
) -> list[np.datetime64]:
    """Return edges between two instants, every so often, without those that part nothing from nothing.

    goes_on : there may be more epochs after the end, which those edges hold with as well.
    """
    step = timedelta_from_s(window_s)
    count = max(int((end - begin) / step + (1.0 - POLICY.last_window_share)), 1)
    if epochs is None:
        return [begin + k * step - early for k in range(1, count)]
    occupied = (epochs - begin + early) // step

    def edges(last: int) -> set[int]:
        of_last = np.clip(occupied, 0, last)
        return {int(k) for k in np.concatenate([of_last, of_last + 1]) if 0 < k <= last}

    found = edges(count - 1) & edges(int(occupied.max(initial=0)) + 1) if goes_on else edges(count - 1)
    return [begin + k * step - early for k in sorted(found)]


@dataclass(frozen=True, eq=False, kw_only=True)
class Run(Holding):
    """All that is known of a run, as `Records` has it of a window, but as logs that are read in stretches.

    body : that carries the antennas.
    """

    observations: tuple[ObservationLog, ...]
    navigation: NavigationData | None
    taps: tuple[TimeSliced[Taps], ...] = ()
    ccaf: tuple[TimeSliced[Ccaf], ...] = ()
    array_phases: tuple[TimeSliced[ArrayPhases], ...] = ()
    vector_taps: tuple[TimeSliced[Taps], ...] = ()
    spin_arms: tuple[SpinArm, ...] = ()
    body: Body | None = None
    levels: Mapping[str, FrontEndLevels] = field(default_factory=dict)
    messages: Mapping[str, ReceivedMessages] = field(default_factory=dict)
    own_fixes: Mapping[str, ReceiverFixes] = field(default_factory=dict)
    standing: Mapping[str, Predictor] = field(default_factory=dict)
    inertial: Mapping[str, Predictor] = field(default_factory=dict)
    expected: Mapping[str, Predictor] = field(default_factory=dict)
    changes: Mapping[str, SnapshotChanges] = field(default_factory=dict)
    apart_from: Mapping[str, frozenset[str]] = field(default_factory=dict)

    @property
    def nav_state(self) -> Body | None:
        """Return what gives each window its own state of the body."""
        return self.body


@dataclass(eq=False, kw_only=True)
class Windows:
    """Cut what comes of a run into windows; each is given once, as soon as all its epochs are there.

    A window is complete half a window after its end, or at a break or the end of all sources: a last window of less
    than half joins the one before.
    """

    run: Run
    sources: tuple[EpochSource, ...]
    window_s: float
    multipath_sigma_m: float
    keep_pauses: bool = False
    _breaks: tuple[TimeBreaks, ...] = ()
    _looked: list[int] = field(default_factory=list)
    _known: dict[str, set[SignalId]] = field(default_factory=dict)
    _given: np.datetime64 | None = None

    def __post_init__(self) -> None:
        self._breaks = tuple(TimeBreaks() for _ in self.sources)
        self._looked = [0] * len(self.sources)

    def edges(self) -> list[np.datetime64]:
        """Return the edges, common to all receivers, that further epochs do not move; (n + 1,)."""
        if not self.sources:
            return [NO_TIME, NO_TIME]
        logs = [source.log for source in self.sources]
        if any(log.gpst.size < POLICY.interval_epochs and not source.ended for log, source in self._pair_logs(logs)):
            return []
        last = [log.gpst[-1] for log in logs]
        horizon = min((at for at, source in zip(last, self.sources, strict=True) if not source.ended), default=None)
        received = []
        for k, (log, source) in enumerate(self._pair_logs(logs)):
            self._look_for_breaks(k, log)
            until = last[k] if horizon is None or (source.ended and last[k] < horizon) else horizon
            known = log.gpst[: int(np.searchsorted(log.gpst, until, side="right"))]
            if not known.size:
                return []
            breaks = self._breaks[k].gpst
            received.append(
                Arrived(
                    gpst=known,
                    interval_s=median_interval_s(log.elapsed_s[: POLICY.interval_epochs]),
                    breaks=breaks[breaks <= until],
                    until_gpst=until,
                )
            )
        return window_edges(received, self.window_s, keep_pauses=self.keep_pauses, ended=horizon is None)

    def __len__(self) -> int:
        return max(len(self.edges()) - 1, 0)

    def _pair_logs(self, logs: Sequence[ObservationLog]) -> Iterator[tuple[ObservationLog, EpochSource]]:
        return zip(logs, self.sources, strict=True)

    def _look_for_breaks(self, k: int, log: ObservationLog) -> None:
        """Look at the epochs that came since."""
        stop = log.gpst.size
        for first in range(self._looked[k], stop, STRETCH_EPOCHS):
            self._breaks[k].take(log.read(first, min(first + STRETCH_EPOCHS, stop)))
        self._looked[k] = stop

    def __iter__(self) -> Iterator[Records]:
        """Yield the windows that are complete and were not given before."""
        for start, end in pairwise(self.edges()):
            if self._given is not None and start < self._given:
                continue
            self._given = end
            yield self._build_window(start, end)

    def _drop_later_signals(self, o: Observations) -> Observations:
        """Return epochs without the signals that come after them alone: of what is fed these are not known yet."""
        known = self._known.setdefault(o.receiver, set())
        tracked = np.flatnonzero((o.status != CellStatus.NOT_TRACKED).any(axis=0))
        known.update(o.signals[k] for k in tracked)
        columns = [k for k, signal in enumerate(o.signals) if signal in known]
        return o if len(columns) == len(o.signals) else o.select_channels(np.array(columns, np.intp))

    def _build_window(self, start: np.datetime64, end: np.datetime64) -> Records:
        """Return each receiver's epochs in a window, and the consistent sets that they hold."""
        run = self.run
        received = (self._drop_later_signals(cut(o, start, end)) for o in run.observations)
        cuts = tuple(o for o in received if o.gpst.size > 1)
        sets: list[ConsistentSet] = []
        if run.navigation is not None:
            for window in cuts:
                sets += find_consistent_sets(window, run.navigation, multipath_sigma_m=self.multipath_sigma_m)
        spans_s = {o.receiver: find_span_s(o, start, end) for o in run.observations}
        grids = tuple(log.select_between(*spans_s[log.receiver]) for log in run.ccaf)
        phases = (log.select_between(*spans_s[log.receiver]) for log in run.array_phases)
        taps, vector_taps = (
            tuple(record for log in logs if (record := log.select_between(*spans_s[log.receiver])).elapsed_s.size)
            for logs in (run.taps, run.vector_taps)
        )
        return Records(
            start_gpst=start,
            end_gpst=end,
            observations=cuts,
            navigation=run.navigation,
            sets=tuple(sets),
            taps=taps,
            vector_taps=vector_taps,
            ccaf=tuple(record for record in grids if record.gpst.size),
            array_phases=tuple(record for record in phases if record.gpst.size),
            spin_arms=run.spin_arms,
            levels={name: levels.select_between(start, end) for name, levels in run.levels.items()}
            | {record.receiver: measure_levels_between_signals(record) for record in grids if record.gpst.size},
            messages={name: messages.select_between(start, end) for name, messages in run.messages.items()},
            own_fixes={name: fixes.select_between(start, end) for name, fixes in run.own_fixes.items()},
            standing=run.standing,
            inertial=run.inertial,
            expected=run.expected,
            changes=run.changes,
            apart_from=run.apart_from,
        )


def measure_levels_between_signals(ccaf: Ccaf) -> FrontEndLevels:
    """Return the power of the noise that grids show between the signals, in place of a front end's own readings."""
    rows = np.isfinite(ccaf.noise_variance).any(axis=1)
    unknown = np.full(int(rows.sum()), np.nan)
    return FrontEndLevels(
        gpst=ccaf.gpst[rows],
        band=np.full(unknown.size, carrier_name(ccaf.signals[0]) if ccaf.signals else ""),
        agc_db=unknown,
        agc_share=unknown,
        noise_db=10.0 * np.log10(np.nanmean(ccaf.noise_variance[rows], axis=1)),
        jamming_share=unknown,
    )


def windows_of(
    sources: Sequence[EpochSource],
    navigation: NavigationData,
    settings: Settings,
    taps: Sequence[TimeSliced[Taps]] = (),
    *,
    vector_taps: Sequence[TimeSliced[Taps]] = (),
    ccaf: Sequence[TimeSliced[Ccaf]] = (),
    array_phases: Sequence[TimeSliced[ArrayPhases]] = (),
    spin_arms: Sequence[SpinArm] = (),
    body: Body | None = None,
    levels: Mapping[str, FrontEndLevels] | None = None,
    messages: Mapping[str, ReceivedMessages] | None = None,
    own_fixes: Mapping[str, ReceiverFixes] | None = None,
    predictors: Mapping[str, Predictor] | None = None,
    changes: Mapping[str, SnapshotChanges] | None = None,
    apart_from: Mapping[str, frozenset[str]] | None = None,
) -> Windows:
    """Return the windows of a run. Without observations it is empty, and each detector says what it lacks.

    predictors : what is expected of receivers. changes : within those whose recording is a snapshot. apart_from : see
    `Records`.
    """
    expected = predictors or {}
    run = Run(
        observations=tuple(source.log for source in sources),
        navigation=navigation if navigation.ephemerides else None,
        taps=tuple(taps),
        vector_taps=tuple(vector_taps),
        ccaf=tuple(ccaf),
        array_phases=tuple(array_phases),
        spin_arms=tuple(spin_arms),
        body=body,
        levels=levels or {},
        messages=messages or {},
        own_fixes=own_fixes or {},
        standing={
            name: predictor
            for name, predictor in expected.items()
            if isinstance(predictor, Standing) and predictor.stands
        },
        inertial={name: predictor for name, predictor in expected.items() if isinstance(predictor, Inertial)},
        expected=expected,
        changes=changes or {},
        apart_from=apart_from or {},
    )
    return Windows(
        run=run,
        sources=tuple(sources),
        window_s=settings.window_s,
        multipath_sigma_m=settings.multipath_sigma_m,
        keep_pauses=bool(taps or vector_taps or ccaf or array_phases),
    )


def instantiate_detectors(
    settings: Settings,
    run: Holding,
    *,
    positions_ecef_m: Mapping[str, Reals] | None = None,
) -> list[Detector]:
    """Instantiate every installed detector with the run's settings.

    The probability allowed per hour is shared among windows, detectors and receivers (union bound; a detector may test
    each receiver), so that the whole keeps it whatever the dependence between tests; evenly, but for detectors whose
    `share` is another one. Detectors for equipment that the run does not have, and those that never speak of an attack
    (`share = 0`), cannot raise an alarm: they take nothing from the others. The latter test at a whole share's rate,
    which makes a run *suspect* at most.

    Those that need what others find come last. positions_ecef_m : (3,) of each surveyed receiver.
    """
    classes = load_detectors()
    n_receivers = len(run.observations)
    shares = {name: _share_of(cls) for name, cls in classes.items()}
    equipped = sum(shares[name] for name, cls in classes.items() if _is_equipped(cls(), run))
    tests = max(equipped, 1.0) * max(n_receivers, 1)
    alpha = settings.false_alarm_probability_per_hour * settings.window_s / 3600.0 / tests
    shared: dict[str, Any] = settings.model_dump()
    shared |= {"positions_ecef_m": positions_ecef_m}
    if isinstance(run, Run) and run.body is not None and run.body.antennas_m:
        shared |= {"antennas_body_m": run.body.antennas_m, "antennas_body_sigma_m": run.body.antennas_sigma_m}
    detectors = []
    for name, cls in classes.items():
        defaults = cls().settings
        shared["false_alarm_probability"] = alpha * (shares[name] or 1.0)
        known = {f.name for f in fields(defaults)}
        chosen = {name: value for name, value in shared.items() if name in known}
        detectors.append(instantiate(cls, replace(defaults, **chosen)))
    return sorted(detectors, key=find_tier)


def find_tier(detector: Detector) -> int:
    """Return after how many others a detector looks at a window: see `Need.tier`."""
    return max((need.tier for need in detector.needs), default=0)


def _share_of(kind: type[Any]) -> float:
    """Return what a detector takes of the probability of a false alarm, 1 being what most take."""
    return float(getattr(kind, "share", 1.0))


def asked() -> Asked:
    """Combine the correlators that the installed detectors ask for."""
    stated = [
        request for kind in load_detectors().values() if isinstance(request := getattr(kind, "asks", None), Asked)
    ]
    taps = [request.taps for request in stated if request.taps is not None]
    grids = [request.ccaf for request in stated if request.ccaf is not None]
    return Asked(taps=_combine_taps(taps) if taps else None, ccaf=_combine_grids(grids) if grids else None)


def _combine_taps(taps: Sequence[TapsAsked]) -> TapsAsked:
    return TapsAsked(
        delays_chips=tuple(sorted({delay for request in taps for delay in request.delays_chips})),
        every_s=min(request.every_s for request in taps),
        coherent_s=max(request.coherent_s for request in taps),
    )


def _combine_grids(grids: Sequence[CcafAsked]) -> CcafAsked:
    """Combine grids by what costs most where they differ; the coherent time is that of the first."""
    return CcafAsked(
        reach_chips=max(request.reach_chips for request in grids),
        every_s=min(request.every_s for request in grids),
        soon_s=min(request.soon_s for request in grids),
        dopplers_hz=tuple(sorted({doppler_hz for request in grids for doppler_hz in request.dopplers_hz})),
        coherent_s=grids[0].coherent_s,
        intervals=max(request.intervals for request in grids),
    )


def _is_equipped(detector: Detector, run: Holding) -> bool:
    """Tell whether the run has what special equipment gives and this detector needs."""
    return all(run.has(need) for need in detector.needs if need not in RECEIVED)
