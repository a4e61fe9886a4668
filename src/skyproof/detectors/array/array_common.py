"""Find signals that come to an antenna array from one direction, without attitude, ephemeris or exact array.

Signals of one transmitter reach every pair of antennas with the same phase difference. What is wrong with antenna
positions, lines and attitude is the same for them and cancels; only white noise is left, so that the test of equality
is exact for any array. Sources that differ by whole cycles at all antennas look equal; how often that happens by chance
is computed from the geometry (`equality_chance`).

Clusters, and what is found of them, are shared with `spin`.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from math import comb
from typing import Any

import numpy as np

from skyproof.arrays import Indices, Reals
from skyproof.detectors.array.array_model import array_design, mean_differences, white_covariance
from skyproof.detectors.array.failing import find_failing, leave_out
from skyproof.detectors.array.noticed import least_noticeable_satellites
from skyproof.detectors.base import NotTested, Reporter, leave_open
from skyproof.errors import require_probability
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.records import ArrayPhases, Cause, Datum, Finding, Hypothesis, Need, Records, SignalRef, list_refs
from skyproof.statistics.directions import Clusters, equal_clusters, equal_statistic, equality_chance
from skyproof.statistics.distributions import chi_square_survival, chi_square_threshold

__all__ = [
    "ArrayCommon",
    "ArrayCommonSettings",
    "bound_chance_by_size",
    "bound_chance_of_cluster",
    "compare_directions",
    "select_commonest_carrier",
    "select_one_sky",
    "select_unrepeated",
]


def bound_chance_by_size(signals: int, size: int, chance: float) -> float:
    """Bound the probability that `size` of `signals` independent directions are taken for one.

    Each pair is taken for one with `chance`. The union bound is over all choices, each about one of its members.
    """
    return min(1.0, comb(signals, size) * chance ** (size - 1)) if size > 1 else 1.0


def bound_chance_of_cluster(
    clusters: Clusters, members: Indices, signals: int, size: int, design: Reals, covariance: Reals, *, wrapped: bool
) -> float:
    """Bound the probability that independent directions lie as near to each other as these members.

    Two bounds are taken, each at half the probability: by the limit of all clusters, and by the members' largest
    distance, for every size that a cluster may have. In the second all lie within that distance of one member, whose
    error may be any.

    Parameters
    ----------
    members : rows of a cluster. signals, size : satellites in all, and in the cluster. design, covariance : as in
        `equality_chance`.
    """
    if size < 2:
        return 1.0
    limit = equality_chance(design, covariance, clusters.limit, wrapped=wrapped)
    by_limit = bound_chance_by_size(signals, size, limit)
    farthest = float(clusters.distance[np.ix_(members, members)][np.triu_indices(members.size, 1)].max())
    # Of the pair's variance the other one has half.
    nearest = equality_chance(design, 0.5 * covariance, 2.0 * farthest, wrapped=wrapped)
    by_distance = (signals - 1) * bound_chance_by_size(signals, size, nearest)
    return min(1.0, 2.0 * min(by_limit, by_distance))


def select_commonest_carrier(carrier_hz: Reals) -> Indices:
    """Select the channels of the commonest carrier: phases of different wavelengths are not comparable."""
    values, counts = np.unique(carrier_hz, return_counts=True)
    return np.flatnonzero(carrier_hz == values[counts.argmax()]) if values.size else np.zeros(0, np.intp)


def select_one_sky(records: Records, receiver: str, refs: Sequence[SignalRef]) -> tuple[SignalRef, ...]:
    """Select the signals that belong to the receiver's consistent set with most of them.

    Without a set, select those whose transmission is received once: of two signals of one transmission, one is not what
    the satellite sent.
    """
    candidates = [candidate for candidate in records.sets if candidate.receiver == receiver]
    if candidates:
        best = max(candidates, key=lambda candidate: sum(ref.signal in candidate.signals for ref in refs))
        return tuple(ref for ref in refs if ref.signal in best.signals)
    return tuple(refs[k] for k in select_unrepeated(refs, range(len(refs))))


def select_unrepeated(refs: Sequence[SignalRef], rows: Sequence[int]) -> list[int]:
    """Select the rows whose transmission occurs once among them."""
    sent = Counter(refs[k].signal.transmission for k in rows)
    return [k for k in rows if sent[refs[k].signal.transmission] == 1]


def compare_directions(
    report: Reporter,
    refs: Sequence[SignalRef],
    values: Reals,
    covariance: Reals,
    design: Reals,
    *,
    wrapped: bool,
) -> list[Finding]:
    """Return the findings that clusters of equal values support.

    A cluster of satellites that would be found in a true sky with less than the false-alarm probability is false.
    Of two signals of one satellite in it one is what the transmitter sends; the other may be the true one, of a
    satellite that stands behind it, so that neither is named.
    If no two signals are equal and "all come from one antenna" is rejected, those that form one sky are true. This
    tests for several directions: transmitters at several places would pass it as well. If two skies are received, one
    of them is false, and it stays open which.

    Parameters
    ----------
    values : (n, d), covariance : (n, d, d), design : (d, 3) and `wrapped` as in `equal_clusters`, `equality_chance`.
    """
    alpha = float(report.detector.settings.false_alarm_probability)
    n, d = values.shape
    refs = tuple(refs)
    if n < 2:
        return [report.pass_over(refs, NotTested("few_signals", {"signals": n}))]
    clusters = equal_clusters(values, covariance, false_alarm_probability=alpha, wrapped=wrapped)
    usual = np.mean(covariance, axis=0)
    satellites = len({ref.signal.sat for ref in refs})
    found: list[Finding] = []
    unclear = False
    for label in np.unique(clusters.labels):
        members = np.flatnonzero(clusters.labels == label)
        size = len({refs[k].signal.sat for k in members})
        if size < 2:
            continue
        p_value = bound_chance_of_cluster(clusters, members, satellites, size, design, usual, wrapped=wrapped)
        named = tuple(refs[k] for k in select_unrepeated(refs, members.tolist()))
        if p_value >= alpha or not named:
            unclear = True
            continue
        cluster: dict[str, Datum] = {
            "size": size,
            "of": satellites,
            "statistic": float(clusters.distance[np.ix_(members, members)].max()),
            "threshold": float(clusters.limit),
        }
        # Where all phases of two antennas differ by the same, nothing shows that those are two.
        one_antenna = d == 1 and members.size == n
        p = {Cause.CLEAN: p_value, **leave_open((Cause.STATEMENT,) if one_antenna else ())}
        code = "one_direction_or_antenna" if one_antenna else "one_direction"
        found.append(report.find(named, code, p, singled_out=not one_antenna, data=cluster))
    if found:
        return found
    statistic = float(equal_statistic(values, covariance, wrapped=wrapped)[0])
    p_value = float(chi_square_survival(statistic, (n - 1) * d))
    if unclear or p_value >= alpha:
        return [report.pass_over(refs, NotTested("directions_near"))]
    receiver = refs[0].receiver
    if sum(sky.receiver == receiver for sky in report.records.sets) > 1:
        return [report.pass_over(refs, NotTested("two_skies"))]
    apart: dict[str, Datum] = {
        "receiver": receiver,
        "of": n,
        "statistic": statistic,
        "threshold": float(chi_square_threshold(alpha, (n - 1) * d)),
        "assumes": ("one_transmit_antenna",),
    }
    limit = equality_chance(design, usual, clusters.limit, wrapped=wrapped)
    noticed = least_noticeable_satellites(
        satellites, lambda size: 2.0 * bound_chance_by_size(satellites, size, limit), alpha
    )
    return [
        report.find(
            select_one_sky(report.records, receiver, refs),
            "directions_differ",
            {Cause.FALSE_SKY: p_value},
            hypothesis=Hypothesis.ONE_ANTENNA,
            data=apart,
            estimates={"noticed": noticed},
        )
    ]


@dataclass(frozen=True)
class ArrayCommonSettings:
    """Settings of `ArrayCommon`.

    false_alarm_probability : of each array and window: that signals of one antenna are divided, and, at most, that a
        true sky is said to have a cluster.
    min_share : of a signal that is compared, of the epochs of the signal that has most.
    """

    false_alarm_probability: float = 1e-3
    min_share: float = 0.2

    def __post_init__(self) -> None:
        require_probability("array_common", "false_alarm_probability", self.false_alarm_probability)


class ArrayCommon:
    """The detector, from `array_phases`: a tuple of `ArrayPhases`. The array must hardly turn within a window
    (by much less than a cycle over its longest baseline), as phase differences are averaged."""

    name = "array_common"
    needs = (Need.ARRAY_PHASES,)

    def __init__(self, settings: ArrayCommonSettings | None = None) -> None:
        self.settings = settings or ArrayCommonSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Finding], Any]:
        """Return the findings of one window; never raises for what the data lack."""
        report = Reporter(self, records, Hypothesis.SKY_DIRECTIONS)
        lacking = report.name_missing()
        if lacking:
            return lacking, state
        return [finding for phases in records.array_phases for finding in self._test_array(report, phases)], state

    def _test_array(self, report: Reporter, phases: ArrayPhases) -> list[Finding]:
        """Compare the directions of one array's signals."""
        phases = leave_out(phases, find_failing(phases))
        if len(phases.elements_m) < 2:
            every = list_refs(phases.receiver, phases.signals)
            return [report.pass_over(every, NotTested("few_antennas", {"receiver": phases.receiver}))]
        mean = mean_differences(phases)
        channels = select_commonest_carrier(phases.carrier_hz)
        used = channels[mean.long_enough(self.settings.min_share)[channels]]
        # Whole cycles are taken off against the first signal: let that not depend on the order of the channels.
        used = np.array(sorted(used, key=lambda k: phases.signals[k]), np.intp)
        wavelength_m = SPEED_OF_LIGHT_M_S / (phases.carrier_hz[used[0]] if used.size else 1.0)
        return compare_directions(
            report,
            [SignalRef(phases.receiver, phases.signals[k]) for k in used],
            mean.cycles[used],
            white_covariance(mean.sigma_cyc[used]),
            array_design(phases.elements_m / wavelength_m),
            wrapped=True,
        )
