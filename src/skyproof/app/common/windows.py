"""From whole observations to windows of records, and what every detector says of each."""

import math
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np

from skyproof.app.common.body import Body, Carried, body_states
from skyproof.app.common.packed_log import PACKED, PackedLog
from skyproof.app.common.progress import Progress
from skyproof.app.common.settings import Settings
from skyproof.arrays import Instants, Reals
from skyproof.detectors.base import Detector
from skyproof.detectors.registry import examined, load_detectors, made_with, review_of
from skyproof.fusion.policy import POLICY
from skyproof.gnss.time import seconds_between, timedelta_from_s
from skyproof.interruption import watch
from skyproof.navigation.clock import time_breaks
from skyproof.navigation.sets import consistent_sets
from skyproof.navigation.window import interval_s
from skyproof.records import (
    ArrayPhases,
    Asked,
    Ccaf,
    CcafAsked,
    ConsistentSet,
    Finding,
    FrontEndLevels,
    Holding,
    NavigationData,
    Need,
    ObservationLog,
    Observations,
    ReceivedMessages,
    ReceiverFixes,
    Records,
    SignalRef,
    SpinArm,
    Stretched,
    Taps,
    TapsAsked,
)

__all__ = [
    "Run",
    "Windows",
    "asked",
    "cut",
    "detectors_for",
    "examine",
    "examine_all",
    "following_epochs",
    "reviewed",
    "windows_of",
]

H = TypeVar("H", bound=Hashable)

NO_TIME = np.datetime64("NaT", "ns")
RECEIVED = frozenset({Need.OBSERVATIONS, Need.TWO_RECEIVERS, Need.SETS, Need.NAVIGATION})
"""What any detector may need that every receiver makes, sooner or later; the rest is of special equipment."""


def cut(observations: ObservationLog, start_gpst: np.datetime64, end_gpst: np.datetime64) -> Observations:
    """The epochs with start <= label < end."""
    first, stop = np.searchsorted(observations.gpst, [start_gpst, end_gpst])
    return observations.read(int(first), int(stop))


def span_s(observations: ObservationLog, start_gpst: np.datetime64, end_gpst: np.datetime64) -> tuple[float, float]:
    """From when to when, in elapsed seconds, lies what is nearest to the epochs with start <= label < end."""
    first, stop = (int(row) for row in np.searchsorted(observations.gpst, [start_gpst, end_gpst]))
    elapsed_s = observations.elapsed_s

    def middle_s(row: int) -> float:
        """Between an epoch and the one before it."""
        if row == 0 or row == elapsed_s.size:
            return -np.inf if row == 0 else np.inf
        return 0.5 * float(elapsed_s[row - 1] + elapsed_s[row])

    return middle_s(first), middle_s(stop)


def following_epochs(settings: Settings, observations: Sequence[ObservationLog]) -> Settings:
    """The settings with windows of at least five epochs of the receiver that has fewest."""
    needed_s = round(POLICY.least_window_epochs * max((interval_s(o.elapsed_s) for o in observations), default=0.0), 3)
    return settings if needed_s <= settings.window_s else settings.model_copy(update={"window_s": needed_s})


def window_edges(
    observations: Sequence[ObservationLog], window_s: float, *, keep_pauses: bool = False
) -> list[np.datetime64]:
    """Edges of the windows, common to all receivers: from the first epoch of any to past the last.

    Windows in a row that hold no epoch are one, for a log may pause for years. Not so with `keep_pauses`: correlators
    may have measured where no epoch came of it.

    Where a receiver's time breaks one window ends and another begins: ranges before and after it have nothing in
    common, and a mean over both is of neither. So it is where all receivers begin, and where the first of them ends:
    what all measured says nothing of what one of them measured without the others. A single epoch makes no window.
    """
    if not observations:
        return [NO_TIME, NO_TIME]
    first = min(o.gpst[0] for o in observations)
    last = max(o.gpst[-1] for o in observations) + np.timedelta64(1, "ms")
    # Between epochs: those of receivers that do not steer their clocks come some milliseconds early or late.
    early = timedelta_from_s(0.5 * max(interval_s(o.elapsed_s) for o in observations))
    all_from, all_to = max(o.gpst[0] for o in observations), min(o.gpst[-1] for o in observations)
    most = max(timedelta_from_s(POLICY.ends_together_s), 3 * early)  # of one epoch nothing can be said
    alone = [at for at, by in ((all_from, all_from - first), (all_to + 2 * early, last - all_to)) if by > most]
    breaks = np.unique(np.concatenate([*(time_breaks(o) for o in observations), np.array(alone, "M8[ns]")]))
    epochs = np.unique(np.concatenate([o.gpst for o in observations]))
    edges = [first]
    for begin, end in pairwise([first, *breaks, last]):
        if end - begin > early or end == last:  # not at the break that another receiver saw at its own epoch
            within = None if keep_pauses else epochs[slice(*np.searchsorted(epochs, [begin - early, end]))]
            edges += [*_evenly(begin, end, window_s, early, within), end if end == last else end - early]
    return edges


def _evenly(
    begin: np.datetime64, end: np.datetime64, window_s: float, early: np.timedelta64, epochs: Instants | None
) -> list[np.datetime64]:
    """Edges between two instants, every so often, without those that part nothing from nothing."""
    step = timedelta_from_s(window_s)
    count = max(int((end - begin) / step + (1.0 - POLICY.last_window_share)), 1)
    if epochs is None:
        return [begin + k * step - early for k in range(1, count)]
    occupied = np.clip((epochs - begin + early) // step, 0, count - 1)
    edges = np.unique(np.concatenate([occupied, occupied + 1]))
    return [begin + int(k) * step - early for k in edges[(edges > 0) & (edges < count)]]


@dataclass(frozen=True, eq=False, kw_only=True)
class Run(Holding):
    """All that is known of a run, as `Records` has it of a window, but as logs that are read in stretches.

    body : that carries the antennas.
    """

    observations: tuple[ObservationLog, ...]
    navigation: NavigationData | None
    taps: tuple[Stretched[Taps], ...] = ()
    ccaf: tuple[Stretched[Ccaf], ...] = ()
    array_phases: tuple[Stretched[ArrayPhases], ...] = ()
    vector_taps: tuple[Stretched[Taps], ...] = ()
    spin_arms: tuple[SpinArm, ...] = ()
    body: Body | None = None
    levels: Mapping[str, FrontEndLevels] = field(default_factory=dict)
    messages: Mapping[str, ReceivedMessages] = field(default_factory=dict)
    own_fixes: Mapping[str, ReceiverFixes] = field(default_factory=dict)

    @property
    def nav_state(self) -> Body | None:
        """What gives each window its own."""
        return self.body


@dataclass(frozen=True, kw_only=True)
class Windows:
    """A run cut into windows, which are made one by one as they are asked for.

    edges : of the windows, common to all receivers; (n + 1,).
    """

    run: Run
    edges: tuple[np.datetime64, ...]
    multipath_sigma_m: float

    def __len__(self) -> int:
        return len(self.edges) - 1

    @property
    def mean_s(self) -> float:
        """Mean length of the windows that hold epochs, s: less than asked where breaks cut them; NaN without any."""
        if not self.run.observations:
            return math.nan
        edges = np.array(self.edges)
        inside = [np.searchsorted(edges, o.gpst, side="right") - 1 for o in self.run.observations]
        occupied = np.unique(np.clip(np.concatenate(inside), 0, len(self) - 1))
        return float(np.mean(seconds_between(edges[occupied + 1], edges[occupied])))

    def __iter__(self) -> Iterator[Records]:
        carried = Carried()
        for start, end in pairwise(self.edges):
            records = self._window(start, end)
            if self.run.body is not None:
                states, carried = body_states(self.run.body, records, carried)
                records = replace(records, nav_state=states)
            yield records

    def _window(self, start: np.datetime64, end: np.datetime64) -> Records:
        """Each receiver's epochs in a window, and the consistent sets that they hold."""
        run = self.run
        cuts = tuple(c for c in (cut(o, start, end) for o in run.observations) if c.gpst.size > 1)
        sets: list[ConsistentSet] = []
        if run.navigation is not None:
            for window in cuts:
                sets += consistent_sets(window, run.navigation, multipath_sigma_m=self.multipath_sigma_m)
        spans_s = {o.receiver: span_s(o, start, end) for o in run.observations}
        grids = (log.between(*spans_s[log.receiver]) for log in run.ccaf)
        phases = (log.between(*spans_s[log.receiver]) for log in run.array_phases)
        taps, vector_taps = (
            tuple(one for log in logs if (one := log.between(*spans_s[log.receiver])).elapsed_s.size)
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
            ccaf=tuple(one for one in grids if one.gpst.size),
            array_phases=tuple(one for one in phases if one.gpst.size),
            spin_arms=run.spin_arms,
            levels={name: levels.between(start, end) for name, levels in run.levels.items()},
            messages={name: messages.between(start, end) for name, messages in run.messages.items()},
            own_fixes={name: fixes.between(start, end) for name, fixes in run.own_fixes.items()},
        )


def windows_of(
    observations: Sequence[ObservationLog],
    navigation: NavigationData,
    settings: Settings,
    taps: Sequence[Stretched[Taps]] = (),
    *,
    vector_taps: Sequence[Stretched[Taps]] = (),
    ccaf: Sequence[Stretched[Ccaf]] = (),
    array_phases: Sequence[Stretched[ArrayPhases]] = (),
    spin_arms: Sequence[SpinArm] = (),
    body: Body | None = None,
    levels: Mapping[str, FrontEndLevels] | None = None,
    messages: Mapping[str, ReceivedMessages] | None = None,
    own_fixes: Mapping[str, ReceiverFixes] | None = None,
) -> Windows:
    """The windows of a run. Without observations it is one empty window, in which every detector says what it lacks."""
    run = Run(
        observations=tuple(observations),
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
    )
    edges = window_edges(observations, settings.window_s, keep_pauses=bool(taps or vector_taps or ccaf or array_phases))
    return Windows(run=run, edges=tuple(edges), multipath_sigma_m=settings.multipath_sigma_m)


def detectors_for(
    settings: Settings,
    run: Holding,
    *,
    further: int = 0,
    mean_s: float = float("inf"),
    positions_ecef_m: Mapping[str, Reals] | None = None,
) -> list[Detector]:
    """Every installed detector with the run's settings.

    The probability allowed per hour is shared among windows, detectors and receivers (union bound; a detector may test
    each receiver), so that the whole keeps it whatever the dependence between tests; evenly, but for detectors whose
    `share` is another one. Detectors for equipment that the run does not have, and those that never speak of an attack
    (`share = 0`), cannot raise an alarm: they take nothing from the others. The latter test at a whole share's rate,
    which makes a run *suspect* at most.

    further : tests beside the detectors, of each receiver, that are left a share. mean_s : length of the windows, where
        breaks of time make more of them than the settings do. positions_ecef_m : (3,) of each surveyed receiver.
    """
    classes = load_detectors()
    n_receivers = len(run.observations)
    shares = {name: _share_of(cls) for name, cls in classes.items()}
    equipped = sum(shares[name] for name, cls in classes.items() if _equipped(cls(), run))
    tests = max(equipped + further, 1.0) * max(n_receivers, 1)
    alpha = settings.false_alarm_probability_per_hour * min(settings.window_s, mean_s) / 3600.0 / tests
    shared: dict[str, Any] = settings.model_dump()
    shared |= {"positions_ecef_m": positions_ecef_m}
    detectors = []
    for name, cls in classes.items():
        defaults = cls().settings
        shared["false_alarm_probability"] = alpha * (shares[name] or 1.0)
        known = {f.name for f in fields(defaults)}
        chosen = {name: value for name, value in shared.items() if name in known}
        detectors.append(made_with(cls, replace(defaults, **chosen)))
    return detectors


def _share_of(kind: type[Any]) -> float:
    """Return what a detector takes of the probability of a false alarm, 1 being what most take."""
    return float(getattr(kind, "share", 1.0))


def asked() -> Asked:
    """The correlators that the installed detectors ask for, all together."""
    stated = [one for kind in load_detectors().values() if isinstance(one := getattr(kind, "asks", None), Asked)]
    taps = [one.taps for one in stated if one.taps is not None]
    grids = [one.ccaf for one in stated if one.ccaf is not None]
    return Asked(taps=_taps_together(taps) if taps else None, ccaf=_grids_together(grids) if grids else None)


def _taps_together(taps: Sequence[TapsAsked]) -> TapsAsked:
    return TapsAsked(
        delays_chips=tuple(sorted({delay for one in taps for delay in one.delays_chips})),
        every_s=min(one.every_s for one in taps),
        coherent_s=max(one.coherent_s for one in taps),
    )


def _grids_together(grids: Sequence[CcafAsked]) -> CcafAsked:
    """Where they differ, what costs most; the coherent time is that of the first."""
    return CcafAsked(
        reach_chips=max(one.reach_chips for one in grids),
        every_s=min(one.every_s for one in grids),
        soon_s=min(one.soon_s for one in grids),
        dopplers_hz=tuple(sorted({doppler_hz for one in grids for doppler_hz in one.dopplers_hz})),
        coherent_s=grids[0].coherent_s,
        intervals=max(one.intervals for one in grids),
    )


def _equipped(detector: Detector, run: Holding) -> bool:
    """Whether the run has what special equipment gives and this detector needs."""
    return all(run.has(need) for need in detector.needs if need not in RECEIVED)


States = Mapping[str, Any]
"""What each detector remembers from window to window, by its name."""


def examine(detectors: Sequence[Detector], records: Records, states: States) -> tuple[list[Finding], States]:
    """All that all detectors say of one window, and what they remember of it."""
    evidence: list[Finding] = []
    remembered = dict(states)
    for detector in detectors:
        said, remembered[detector.name] = examined(detector, records, states.get(detector.name))
        evidence += said
    return evidence, remembered


def reviewed(detectors: Sequence[Detector], evidence: Sequence[Finding]) -> Sequence[Finding]:
    """The evidence of all windows, after each detector that has a method `review` looked at it once more."""
    seen = evidence
    for detector in detectors:
        if (after := review_of(detector, seen)) is not seen:
            seen = PackedLog(after)
    return seen


def examine_all(
    windows: Windows,
    detectors: Sequence[Detector],
    progress: Progress,
    take: Callable[[Records, Sequence[Finding]], None] | None = None,
) -> tuple[Sequence[Finding], Sequence[ConsistentSet], bool]:
    """The evidence of all detectors and windows, the sets found in them, and whether a signal left windows out.

    take : is called with each window and what was found in it, as it comes.
    """
    evidence, sets = _Kept(), PackedLog[ConsistentSet]()
    states: States = {}
    interrupted, cut_short = watch(), False
    with progress.stage("examining the signals, window by window", len(windows)) as stage:
        for number, records in enumerate(windows, 1):
            said, states = examine(detectors, records, states)
            evidence.take(said)
            if take is not None:
                take(records, said)
            sets.extend(records.sets)
            stage.advance(number)
            if interrupted() and number < len(windows):
                cut_short = True
                break
    return reviewed(detectors, evidence.all), sets, cut_short


class _Kept:
    """Evidence in little memory: what is equal in windows that follow each other is kept once, and that a test cannot
    run is said once in a row.
    """

    def __init__(self) -> None:
        self.all = PackedLog[Finding]()
        self._same: dict[Hashable, Any] = {}
        self._lacking: set[tuple[str, tuple[SignalRef, ...], tuple[Need, ...]]] = set()

    def take(self, said: Sequence[Finding]) -> None:
        """The evidence of one more window."""
        lacking = set()
        for one in said:
            subject = self._once(tuple(self._once(ref) for ref in one.signals))
            if one.lacking:
                key = one.detector, subject, one.lacking
                lacking.add(key)
                if key in self._lacking:
                    continue
            self.all.extend((replace(one, signals=subject),))
        self._lacking = lacking
        if len(self._same) > PACKED:  # words with figures in them hardly ever come again
            self._same.clear()

    def _once(self, value: H) -> H:
        kept: H = self._same.setdefault(value, value)
        return kept
