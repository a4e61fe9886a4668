"""From whole observations to windows of records, and what every detector says of each."""

from collections.abc import Sequence
from dataclasses import fields, replace
from itertools import pairwise
from typing import Any

import numpy as np

from skyproof.app.common.progress import Progress
from skyproof.app.common.settings import Settings
from skyproof.arrays import Booleans
from skyproof.detectors.base import Detector, load_detectors
from skyproof.navigation.sets import consistent_sets
from skyproof.records import ConsistentSet, Evidence, NavigationData, Need, Observations, Records

__all__ = ["cut", "detectors_for", "examine", "window_records"]

NO_TIME = np.datetime64("NaT", "ns")
RECEIVED = frozenset({Need.OBSERVATIONS, Need.TWO_RECEIVERS, Need.SETS, Need.NAVIGATION})
"""What any detector may need that every receiver makes, sooner or later; the rest is of special equipment."""
MIN_WINDOW_SHARE = 0.5
"""A last window shorter than this share of a whole one is joined to the one before."""


def cut(observations: Observations, start_gpst: np.datetime64, end_gpst: np.datetime64) -> Observations:
    """The epochs with start <= label < end."""
    return take(observations, (observations.gpst >= start_gpst) & (observations.gpst < end_gpst))


def take(observations: Observations, rows: Booleans) -> Observations:
    """The chosen epochs of a record."""
    n = observations.gpst.size
    chosen = {
        f.name: getattr(observations, f.name)[rows]
        for f in fields(observations)
        if isinstance(getattr(observations, f.name), np.ndarray)
        and getattr(observations, f.name).shape[:1] == (n,)
        and f.name not in ("found_elapsed_s", "missed_elapsed_s", "carrier_hz")
    }
    return replace(observations, **chosen)


def window_edges(observations: Sequence[Observations], window_s: float) -> list[np.datetime64]:
    """Edges of the windows, common to all receivers: from the first epoch of any to past the last."""
    if not observations:
        return [NO_TIME, NO_TIME]
    first = min(o.gpst[0] for o in observations)
    last = max(o.gpst[-1] for o in observations) + np.timedelta64(1, "ms")
    step = np.timedelta64(round(window_s * 1e9), "ns")
    count = max(int((last - first) / step + (1.0 - MIN_WINDOW_SHARE)), 1)
    edges: list[np.datetime64] = [first + k * step for k in range(count)]
    return [*edges, last]


def window_records(
    observations: Sequence[Observations], navigation: NavigationData, settings: Settings, progress: Progress
) -> tuple[list[Records], bool]:
    """One `Records` a window: each receiver's epochs in it, and the consistent sets that they hold.

    Returns the windows and whether Ctrl-C ended it early. Without observations there is one empty window, in which
    every detector can tell what it lacks.
    """
    orbits = navigation if navigation.ephemerides else None
    edges = window_edges(observations, settings.window_s)
    windows: list[Records] = []
    try:
        with progress.stage("finding consistent sets", len(edges) - 1) as stage:
            for start, end in pairwise(edges):
                cuts = tuple(c for c in (cut(o, start, end) for o in observations) if c.gpst.size > 1)
                sets: list[ConsistentSet] = []
                for window in cuts if orbits is not None else ():
                    sets += consistent_sets(window, navigation, multipath_sigma_m=settings.multipath_sigma_m)
                windows.append(
                    Records(start_gpst=start, end_gpst=end, observations=cuts, navigation=orbits, sets=tuple(sets))
                )
                stage.advance(len(windows))
    except KeyboardInterrupt:
        return windows, True
    return windows, False


def detectors_for(settings: Settings, n_receivers: int, windows: Sequence[Records]) -> list[Detector]:
    """Every installed detector with the run's settings.

    The probability allowed per hour is shared evenly among windows, detectors and receivers (union bound; a detector
    may test each receiver), so that the whole keeps it whatever the dependence between tests. Detectors for equipment
    that the run does not have cannot raise an alarm, and get no share.
    """
    classes = load_detectors()
    tests = max(sum(_equipped(cls(), windows) for cls in classes.values()), 1) * max(n_receivers, 1)
    alpha = settings.false_alarm_probability_per_hour * settings.window_s / 3600.0 / tests
    shared: dict[str, Any] = settings.model_dump() | {"false_alarm_probability": alpha}
    detectors = []
    for cls in classes.values():
        defaults = cls().settings
        known = {f.name for f in fields(defaults)}
        chosen = {name: value for name, value in shared.items() if name in known}
        detectors.append(cls(settings=replace(defaults, **chosen)))  # type: ignore[call-arg]
    return detectors


def _equipped(detector: Detector, windows: Sequence[Records]) -> bool:
    """Whether the run has what special equipment gives and this detector needs."""
    return all(any(records.has(need) for records in windows) for need in detector.needs if need not in RECEIVED)


def examine(windows: Sequence[Records], detectors: Sequence[Detector]) -> list[Evidence]:
    """All that all detectors say of all windows, in order of time.

    A detector with a method `review(evidence) -> evidence` looks at all windows' evidence once more at the end.
    """
    evidence: list[Evidence] = []
    states: dict[str, Any] = {}
    for records in windows:
        for detector in detectors:
            said, states[detector.name] = detector.examine(records, states.get(detector.name))
            evidence += said
    for detector in detectors:
        if (review := getattr(detector, "review", None)) is not None:
            evidence = review(evidence)
    return evidence
