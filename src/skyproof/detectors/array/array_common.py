"""Which signals come to an antenna array from one direction? No attitude, no ephemeris, no exact array needed.

Signals of one transmitter reach every pair of antennas with the same phase difference. What is wrong with antenna
positions, lines and attitude is the same for them and cancels; only white noise is left, so that the test of equality
is exact for any array. Sources that differ by whole cycles at all antennas look equal; how often that happens by chance
is computed from the geometry (`equality_chance`).

Clusters, and what is said of them, are shared with `spin`.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from math import comb
from typing import Any

import numpy as np

from skyproof.arrays import Indices, Reals
from skyproof.detectors.array.array_model import array_design, mean_differences, white_covariance
from skyproof.detectors.array.failing import failing, without
from skyproof.detectors.base import Detector, missing, undecided
from skyproof.errors import require_probability
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.records import ArrayPhases, Evidence, Need, Records, SignalRef
from skyproof.statistics.directions import equal_clusters, equal_statistic, equality_chance
from skyproof.statistics.distributions import chi_square_survival, chi_square_threshold

__all__ = [
    "ArrayCommon",
    "ArrayCommonSettings",
    "cluster_chance",
    "cluster_evidence",
    "of_one_carrier",
    "of_one_sky",
    "once_each",
]


ONE_ANTENNA = "false signals are several, and come from one transmit antenna"


def cluster_chance(signals: int, size: int, chance: float) -> float:
    """At most this probable: that among independent directions `size` of `signals` are taken for one, each pair of them
    with `chance` (the union bound over all choices, each about one of its members)."""
    return min(1.0, comb(signals, size) * chance ** (size - 1)) if size > 1 else 1.0


def of_one_carrier(carrier_hz: Reals) -> Indices:
    """The channels of the commonest carrier: phases of different wavelengths are not compared."""
    values, counts = np.unique(carrier_hz, return_counts=True)
    return np.flatnonzero(carrier_hz == values[counts.argmax()]) if values.size else np.zeros(0, np.intp)


def of_one_sky(records: Records, receiver: str, refs: Sequence[SignalRef]) -> tuple[SignalRef, ...]:
    """Those of a receiver's signals that the consistent set with most of them holds; where there is no set, those of
    transmissions that are there once: of two signals of one, one is not what the satellite sent."""
    own = [one for one in records.sets if one.receiver == receiver]
    if own:
        best = max(own, key=lambda one: sum(ref.signal in one.signals for ref in refs))
        return tuple(ref for ref in refs if ref.signal in best.signals)
    return tuple(refs[k] for k in once_each(refs, range(len(refs))))


def once_each(refs: Sequence[SignalRef], rows: Sequence[int]) -> list[int]:
    """Of some signals those whose transmission is there once among them."""
    sent = Counter(refs[k].signal.transmission for k in rows)
    return [k for k in rows if sent[refs[k].signal.transmission] == 1]


def cluster_evidence(
    detector: Detector,
    records: Records,
    refs: Sequence[SignalRef],
    values: Reals,
    covariance: Reals,
    design: Reals,
    *,
    wrapped: bool,
) -> list[Evidence]:
    """What clusters of equal values say of the signals.

    A cluster of satellites that would be found in a true sky with less than the false-alarm probability is "spoofed".
    Of two signals of one satellite in it one is what the transmitter sends; the other may be the true one, of a
    satellite that stands behind it, so that neither is named.
    If no two signals are equal and "all come from one antenna" is rejected, those that are one sky are "authentic", by
    a test of several directions; transmitters at several places would pass it as well. Where there are two skies, one
    of them is false, and it stays open which.

    Parameters
    ----------
    values : (n, d), covariance : (n, d, d), design : (d, 3) and `wrapped` as in `equal_clusters`, `equality_chance`.
    """
    alpha = float(detector.settings.false_alarm_probability)
    n, d = values.shape
    refs = tuple(refs)
    if n < 2:
        return [
            undecided(
                detector,
                records,
                refs,
                code="few_signals",
                because=f"{n} signals make no pair to compare",
                would_need="two or more signals over the same time",
            )
        ]
    clusters = equal_clusters(values, covariance, false_alarm_probability=alpha, wrapped=wrapped)
    chance = equality_chance(design, np.mean(covariance, axis=0), clusters.limit, wrapped=wrapped)
    satellites = len({ref.signal.sat for ref in refs})
    found: list[Evidence] = []
    unclear = False
    for label in np.unique(clusters.labels):
        members = np.flatnonzero(clusters.labels == label)
        size = len({refs[k].signal.sat for k in members})
        if size < 2:
            continue
        p_value = cluster_chance(satellites, size, chance)
        named = tuple(refs[k] for k in once_each(refs, members.tolist()))
        if p_value >= alpha or not named:
            unclear = True
            continue
        found.append(
            Evidence(
                detector=detector.name,
                start_gpst=records.start_gpst,
                end_gpst=records.end_gpst,
                subject=named,
                says="spoofed",
                false_alarm_probability=alpha,
                p_value=p_value,
                because=f"signals of {size} of {satellites} satellites come to {refs[0].receiver} from one direction",
                statistic=float(clusters.distance[np.ix_(members, members)].max()),
                threshold=clusters.limit,
            )
        )
    if found:
        return found
    statistic = float(equal_statistic(values, covariance, wrapped=wrapped)[0])
    p_value = float(chi_square_survival(statistic, (n - 1) * d))
    if unclear or p_value >= alpha:
        return [
            undecided(
                detector,
                records,
                refs,
                code="directions_near",
                would_need="a longer window, more satellites, or a larger array or arm",
                because=f"some of {n} signals in {refs[0].receiver} are too near to each other to tell their "
                "directions apart, and too few to have come from one",
            )
        ]
    receiver = refs[0].receiver
    if sum(one.receiver == receiver for one in records.sets) > 1:
        return [
            undecided(
                detector,
                records,
                refs,
                code="two_skies",
                would_need="the attitude of the array, by which directions are held against the orbits",
                because=f"no two of {n} signals come to {receiver} from one direction, but they are two skies",
            )
        ]
    return [
        Evidence(
            detector=detector.name,
            start_gpst=records.start_gpst,
            end_gpst=records.end_gpst,
            subject=of_one_sky(records, receiver, refs),
            says="authentic",
            because=f"no two of {n} signals come to {receiver} from one direction",
            assumes=(ONE_ANTENNA,),
            statistic=statistic,
            threshold=float(chi_square_threshold(alpha, (n - 1) * d)),
            false_alarm_probability=alpha,
            p_value=p_value,
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

    def examine(self, records: Records, state: Any = None) -> tuple[list[Evidence], Any]:
        """Evidence of one window; never raises for what the data lack."""
        lacking = missing(self, records)
        if lacking:
            return lacking, state
        return [evidence for phases in records.array_phases for evidence in self._array(records, phases)], state

    def _array(self, records: Records, phases: ArrayPhases) -> list[Evidence]:
        phases = without(phases, failing(phases))
        if len(phases.elements_m) < 2:
            return [
                undecided(
                    self,
                    records,
                    tuple(SignalRef(phases.receiver, s) for s in phases.signals),
                    code="few_antennas",
                    because=f"fewer than two antennas of {phases.receiver} give phases",
                    would_need="phases of two antennas or more",
                )
            ]
        mean = mean_differences(phases)
        channels = of_one_carrier(phases.carrier_hz)
        used = channels[mean.long_enough(self.settings.min_share)[channels]]
        # Whole cycles are taken off against the first signal: let that not depend on the order of the channels.
        used = np.array(sorted(used, key=lambda k: phases.signals[k]), np.intp)
        wavelength_m = SPEED_OF_LIGHT_M_S / (phases.carrier_hz[used[0]] if used.size else 1.0)
        return cluster_evidence(
            self,
            records,
            [SignalRef(phases.receiver, phases.signals[k]) for k in used],
            mean.cycles[used],
            white_covariance(mean.sigma_cyc[used]),
            array_design(phases.elements_m / wavelength_m),
            wrapped=True,
        )
