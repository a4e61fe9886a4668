"""Do the codes of a satellite's bands differ by no more than the ionosphere makes of them?

Signals of one satellite that left together come apart by the ionosphere, which delays them by the inverse square of
their frequency, by the satellite's group delays and by the receiver's bands, which delay all satellites alike. A false
signal on one band alone, or a receiver that is torn between two, shows codes hundreds of metres apart.

Model. For each pair of kinds of signal that three satellites or more have, the mean difference of each satellite over
the window, less the median of all, is normal with the variance of the codes and of two group delays, about a mean
within what slant ionospheres between none and the most can differ by. A reflection changes either code by an eighth
of a chip at most while the direct signal is there. Two-sided, and the number of differences shares the rate.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.bands.policy import POLICY
from skyproof.detectors.base import NotTested, Reporter, leave_open
from skyproof.errors import require_probability
from skyproof.gnss.constants import L1_HZ
from skyproof.records import Cause, Datum, Finding, Hypothesis, Need, Observations, Records, SignalId, SignalRef
from skyproof.statistics.distributions import normal_two_sided

__all__ = ["Bands", "BandsSettings"]


@dataclass(frozen=True)
class BandsSettings:
    """Settings of `Bands`.

    false_alarm_probability : of each receiver and window, for all satellites and pairs of bands together.
    """

    false_alarm_probability: float = 1e-3

    def __post_init__(self) -> None:
        require_probability("bands", "false_alarm_probability", self.false_alarm_probability)


class _Apart(NamedTuple):
    """Two signals of a satellite, by how much the first is later than is usual for the two kinds, and the chance."""

    first: SignalId
    second: SignalId
    metres: float
    p_value: float


class Bands:
    """The detector: see the module's text. It remembers nothing."""

    name = "bands"
    share = 0.0  # it never speaks of an attack
    needs = (Need.OBSERVATIONS,)

    def __init__(self, settings: BandsSettings | None = None) -> None:
        self.settings = settings or BandsSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Finding], Any]:
        """Return the findings of one window; never raises for what the data lack."""
        report = Reporter(self, records, Hypothesis.CODE_FOLLOWS_CARRIER)
        return report.name_missing() or [self._test_receiver(report, o) for o in records.observations], state

    def _test_receiver(self, report: Reporter, o: Observations) -> Finding:
        """Test all pairs of bands of a receiver."""
        pairs = [apart for group in _pairs_of(o) for apart in _compare(o, group)]
        if not pairs:
            every = tuple(SignalRef(o.receiver, signal) for signal in o.signals)
            return report.pass_over(every, NotTested("one_band", {"needed": POLICY.least_satellites}))
        worst = min(pairs, key=lambda apart: apart.p_value)
        failed = [apart for apart in pairs if len(pairs) * apart.p_value < self.settings.false_alarm_probability]
        chosen = failed or pairs
        data: dict[str, Datum] = {
            "tested": len(pairs),
            "parted": tuple(f"{apart.first.sat} {apart.first.band}/{apart.second.band}" for apart in failed),
            "first": str(worst.first),
            "second": str(worst.second),
            "late_m": worst.metres,
        }
        signals = dict.fromkeys(signal for apart in chosen for signal in (apart.first, apart.second))
        return report.find(
            tuple(SignalRef(o.receiver, signal) for signal in signals),
            "parted" if failed else "together",
            {Cause.CLEAN: min(1.0, len(pairs) * worst.p_value), **leave_open((Cause.REFLECTIONS, Cause.FAULT))},
            data=data,
        )


def _pairs_of(o: Observations) -> Iterator[list[tuple[int, int]]]:
    """Give the columns of two signals of one satellite, for each two kinds of one system."""
    by_kind: dict[tuple[str, str, str], dict[str, int]] = {}
    for column, signal in enumerate(o.signals):
        key = (signal.sat[0], signal.band, signal.code)
        by_kind.setdefault(key, {}).setdefault(signal.sat, column)
    for first, second in combinations(sorted(by_kind), 2):
        if first[0] == second[0] and first[1] != second[1]:
            both = sorted(by_kind[first].keys() & by_kind[second].keys())
            if len(both) >= POLICY.least_satellites:
                yield [(by_kind[first][sat], by_kind[second][sat]) for sat in both]


def _compare(o: Observations, columns: list[tuple[int, int]]) -> Iterator[_Apart]:
    """Give what each satellite's two codes are apart, against the median of all."""
    first, second = (np.array(which) for which in zip(*columns, strict=True))
    apart_m = o.pseudorange_m[:, first] - o.pseudorange_m[:, second]
    variance_m2 = o.pseudorange_sigma_m[:, first] ** 2 + o.pseudorange_sigma_m[:, second] ** 2
    known = np.isfinite(apart_m) & np.isfinite(variance_m2)
    count = known.sum(axis=0)
    used = np.flatnonzero(count > 0)
    if used.size < POLICY.least_satellites:
        return
    mean_m = np.where(known, apart_m, 0.0)[:, used].sum(axis=0) / count[used]
    mean_m2 = np.where(known, variance_m2, 0.0)[:, used].sum(axis=0) / count[used] ** 2
    own_m = mean_m - np.median(mean_m)
    slack_m = _ionosphere_m(o, first[used], second[used]) + _reflected_m(o, first[used], second[used])
    beyond = np.maximum(np.abs(own_m) - slack_m, 0.0) / np.sqrt(mean_m2 + 2.0 * POLICY.group_delay_sigma_m**2)
    for k, p_value in enumerate(normal_two_sided(beyond)):
        yield _Apart(o.signals[first[used[k]]], o.signals[second[used[k]]], float(own_m[k]), float(p_value))


def _ionosphere_m(o: Observations, first: Any, second: Any) -> Reals:
    """Return what the most ionosphere makes of two bands (n,), metres."""
    inverse = [(L1_HZ / o.carrier_hz[columns]) ** 2 for columns in (first, second)]
    return np.asarray(POLICY.most_ionosphere_m * np.abs(np.nan_to_num(inverse[0] - inverse[1], nan=1.0)))


def _reflected_m(o: Observations, first: Any, second: Any) -> Reals:
    """Return what reflections make of two codes (n,), metres."""
    chips_m = [[s.plan.chip_m for s in (o.signals[int(k)] for k in columns)] for columns in (first, second)]
    return np.asarray(POLICY.reflected_chips * np.sum(chips_m, axis=0))
