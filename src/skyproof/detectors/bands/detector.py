"""Test if the codes of a satellite's bands differ by no more than the ionosphere makes of them.

Signals that leave a satellite together are separated by three delays. The ionosphere's goes with the inverse square of
the frequency. The satellite has group delays. The receiver's bands delay all satellites alike. A false
signal on one band alone, or a receiver that is torn between two, shows codes hundreds of metres apart.

Model. A pair of kinds of signal is tested if three satellites or more have both. The value is each satellite's mean
difference over the window, less the median of all. It is normal with the variance of the codes and of two group delays.
Its mean lies within what slant ionospheres between none and the most can differ by. A reflection changes either code by
an eighth of a chip at most while the direct signal is received. The test is two-sided, and the number of differences
shares the rate.

A receiver's delay between two bands is constant, whatever its oscillator does. So each satellite's difference continues
from window to window, and only the ionosphere changes those of all satellites together. A false band whose time is
moved shows by this, even if its position stays: see `laws`. A window is compared with the one before and the oldest
remembered.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any, Final, NamedTuple

import numpy as np

from skyproof.arrays import Indices, Reals
from skyproof.detectors.bands.laws import evaluate_common_change
from skyproof.detectors.bands.policy import POLICY
from skyproof.detectors.base import NotTested, Reporter, leave_open
from skyproof.errors import require_probability
from skyproof.gnss.constants import L1_HZ
from skyproof.records import (
    Cause,
    Datum,
    Finding,
    Hypothesis,
    Kind,
    Need,
    Observations,
    Records,
    SignalId,
    SignalRef,
    list_refs,
)
from skyproof.statistics.distributions import normal_two_sided
from skyproof.statistics.medians import medians

__all__ = ["Bands", "BandsSettings"]

_TESTS: Final = 2  # of each satellite by itself, and of what all do together


@dataclass(frozen=True)
class BandsSettings:
    """Settings of `Bands`.

    false_alarm_probability : of each receiver and window, for all satellites and pairs of bands together.
    multipath_sigma_m : of one pseudorange, one sigma; it may change altogether from window to window.
    """

    false_alarm_probability: float = 1e-3
    multipath_sigma_m: float = 1.0

    def __post_init__(self) -> None:
        require_probability("bands", "false_alarm_probability", self.false_alarm_probability)


class _Apart(NamedTuple):
    """Two signals of a satellite, by how much the first is later than is usual for the two kinds, and the chance."""

    first: SignalId
    second: SignalId
    metres: float
    p_value: float


class _Difference(NamedTuple):
    """What two kinds of signal of each satellite are apart in a window: mean and variance (n,), of its epochs each.

    first, second : (n,) columns. each_m : (n_epochs, n).
    """

    sats: tuple[str, ...]
    first: Indices
    second: Indices
    mean_m: Reals
    mean_m2: Reals
    each_m: Reals


class _Kept(NamedTuple):
    """What is remembered of a window: its middle, and mean and variance of each satellite."""

    elapsed_s: float
    by_sat: Mapping[str, tuple[float, float]]


class _Step(NamedTuple):
    """What all satellites of two kinds changed by together, and the chance."""

    first: SignalId
    second: SignalId
    metres: float
    satellites: int
    p_value: float
    columns: tuple[int, ...]
    dated_gpst: np.datetime64


@dataclass(frozen=True, kw_only=True)
class _Past:
    """What is remembered of a receiver: of each pair of kinds the last windows, the oldest first."""

    end_s: float = -np.inf
    kept: Mapping[tuple[Kind, Kind], tuple[_Kept, ...]] = field(default_factory=dict)

    def list_references(self, kinds: tuple[Kind, Kind]) -> tuple[_Kept, ...]:
        """Return the windows that a pair of kinds is compared with: the oldest and the last."""
        windows = self.kept.get(kinds, ())
        return windows[:1] if len(windows) < 2 else (windows[0], windows[-1])


class Bands:
    """The detector: see the module's text. It remembers the differences of six windows."""

    name = "bands"
    share = 0.0  # it never speaks of an attack
    needs = (Need.OBSERVATIONS,)

    def __init__(self, settings: BandsSettings | None = None) -> None:
        self.settings = settings or BandsSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Finding], Any]:
        """Return the findings of one window; never raises for what the data lack."""
        report = Reporter(self, records, Hypothesis.CODE_FOLLOWS_CARRIER)
        if lacking := report.name_missing():
            return lacking, state
        pasts: dict[str, _Past] = dict(state or {})
        found = []
        for o in records.observations:
            past = pasts.get(o.receiver, _Past())
            if o.elapsed_s.size and o.elapsed_s[-1] <= past.end_s:
                past = _Past()  # another recording
            differences = {kinds: d for kinds, columns in _pair_kinds(o) if (d := _difference(o, columns)) is not None}
            found.append(self._test_each(report, o, differences))
            found += self._test_together(report, o, differences, past)
            if o.elapsed_s.size:
                pasts[o.receiver] = _add_window(o, differences, past)
        return found, pasts

    def _test_each(
        self, report: Reporter, o: Observations, differences: Mapping[tuple[Kind, Kind], _Difference]
    ) -> Finding:
        """Test each satellite of all pairs of bands of a receiver."""
        alpha = self.settings.false_alarm_probability / _TESTS
        pairs = [apart for difference in differences.values() for apart in _compare(o, difference)]
        if not pairs:
            every = list_refs(o.receiver, o.signals)
            return report.pass_over(every, NotTested("one_band", {"needed": POLICY.least_satellites}))
        worst = min(pairs, key=lambda apart: apart.p_value)
        failed = [apart for apart in pairs if len(pairs) * apart.p_value < alpha]
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
            list_refs(o.receiver, signals),
            "parted" if failed else "together",
            {Cause.CLEAN: min(1.0, len(pairs) * worst.p_value), **leave_open((Cause.REFLECTIONS, Cause.FAULT))},
            alpha=alpha,
            data=data,
        )

    def _test_together(
        self, report: Reporter, o: Observations, differences: Mapping[tuple[Kind, Kind], _Difference], past: _Past
    ) -> list[Finding]:
        """Test what all satellites of each pair of bands change by together; nothing where no window came before."""
        steps = [
            step
            for kinds, difference in differences.items()
            for kept in past.list_references(kinds)
            if (step := self._step(o, difference, kept)) is not None
        ]
        if not steps:
            return []
        worst = min(steps, key=lambda step: step.p_value)
        p_value, alpha = min(1.0, len(steps) * worst.p_value), self.settings.false_alarm_probability / _TESTS
        failed = p_value < alpha
        columns = worst.columns if failed else tuple(dict.fromkeys(k for step in steps for k in step.columns))
        data: dict[str, Datum] = {
            "first": f"{worst.first.sat[0]} {worst.first.band}",
            "second": f"{worst.second.sat[0]} {worst.second.band}",
            "satellites": worst.satellites,
            "statistic": worst.metres,
        }
        return [
            report.find(
                tuple(SignalRef(o.receiver, o.signals[k]) for k in columns),
                "part_together" if failed else "go_on_together",
                {Cause.CLEAN: p_value, **leave_open((Cause.FAULT,))},
                alpha=alpha,
                data=data,
                dated_gpst=worst.dated_gpst if failed else None,
            )
        ]

    def _step(self, o: Observations, difference: _Difference, kept: _Kept) -> _Step | None:
        """Compute how much the satellites common to a remembered window changed since; None if they are too few."""
        common = np.array([k for k, sat in enumerate(difference.sats) if sat in kept.by_sat], np.intp)
        if common.size < POLICY.step_satellites:
            return None
        before_m, before_m2 = np.array([kept.by_sat[difference.sats[k]] for k in common]).T
        first, second = difference.first[common], difference.second[common]
        variance_m2 = difference.mean_m2[common] + before_m2 + 4.0 * self.settings.multipath_sigma_m**2
        since_s = float(o.elapsed_s.mean()) - kept.elapsed_s
        share = np.max(_ionosphere_m(o, first, second)) / POLICY.most_ionosphere_m
        slack_m = POLICY.ionosphere_pace_m_s * share * since_s
        metres, p_value = evaluate_common_change(difference.mean_m[common] - before_m, variance_m2, slack_m)
        change_m = medians(difference.each_m[:, common] - before_m, axis=1)
        before = np.flatnonzero(~(np.abs(change_m) > 0.5 * abs(metres)))
        row = int(before[-1]) + 1 if before.size else 0
        return _Step(
            first=o.signals[first[0]],
            second=o.signals[second[0]],
            metres=metres,
            satellites=common.size,
            p_value=p_value,
            columns=(*first.tolist(), *second.tolist()),
            dated_gpst=o.gpst[row if row < o.gpst.size else 0],
        )


def _pair_kinds(o: Observations) -> Iterator[tuple[tuple[Kind, Kind], list[tuple[int, int]]]]:
    """Yield each two kinds of one system, and the columns of the two signals of each satellite."""
    by_kind: dict[Kind, dict[str, int]] = {}
    for column, signal in enumerate(o.signals):
        key = (signal.sat[0], signal.band, signal.code)
        by_kind.setdefault(key, {}).setdefault(signal.sat, column)
    for first, second in combinations(sorted(by_kind), 2):
        if first[0] == second[0] and first[1] != second[1]:
            common = sorted(by_kind[first].keys() & by_kind[second].keys())
            if len(common) >= POLICY.least_satellites:
                yield (first, second), [(by_kind[first][sat], by_kind[second][sat]) for sat in common]


def _difference(o: Observations, columns: list[tuple[int, int]]) -> _Difference | None:
    """Compute how far each satellite's two codes are apart; None with too few satellites."""
    first, second = (np.array(which) for which in zip(*columns, strict=True))
    apart_m = o.pseudorange_m[:, first] - o.pseudorange_m[:, second]
    variance_m2 = o.pseudorange_sigma_m[:, first] ** 2 + o.pseudorange_sigma_m[:, second] ** 2
    known = np.isfinite(apart_m) & np.isfinite(variance_m2)
    count = known.sum(axis=0)
    used = np.flatnonzero(count > 0)
    if used.size < POLICY.least_satellites:
        return None
    return _Difference(
        sats=tuple(o.signals[first[k]].sat for k in used),
        first=first[used],
        second=second[used],
        mean_m=np.where(known, apart_m, 0.0)[:, used].sum(axis=0) / count[used],
        mean_m2=np.where(known, variance_m2, 0.0)[:, used].sum(axis=0) / count[used] ** 2,
        each_m=np.where(known, apart_m, np.nan)[:, used],
    )


def _compare(o: Observations, difference: _Difference) -> Iterator[_Apart]:
    """Give what each satellite's two codes are apart, against the median of all."""
    first, second = difference.first, difference.second
    own_m = difference.mean_m - np.median(difference.mean_m)
    slack_m = _ionosphere_m(o, first, second) + _reflections_m(o, first, second)
    sigma_m = np.sqrt(difference.mean_m2 + 2.0 * POLICY.group_delay_sigma_m**2)
    beyond = np.maximum(np.abs(own_m) - slack_m, 0.0) / sigma_m
    for k, p_value in enumerate(normal_two_sided(beyond)):
        yield _Apart(o.signals[first[k]], o.signals[second[k]], float(own_m[k]), float(p_value))


def _add_window(o: Observations, differences: Mapping[tuple[Kind, Kind], _Difference], past: _Past) -> _Past:
    """Return the past with one more window."""
    kept = dict(past.kept)
    for kinds, difference in differences.items():
        numbers = zip(difference.sats, difference.mean_m.tolist(), difference.mean_m2.tolist(), strict=True)
        window = _Kept(float(o.elapsed_s.mean()), {sat: (mean_m, mean_m2) for sat, mean_m, mean_m2 in numbers})
        kept[kinds] = (*kept.get(kinds, ()), window)[-POLICY.remembered_windows :]
    return _Past(end_s=float(o.elapsed_s[-1]), kept=kept)


def _ionosphere_m(o: Observations, first: Any, second: Any) -> Reals:
    """Return the largest difference (n,) that the ionosphere makes between two bands, metres."""
    inverse = [(L1_HZ / o.carrier_hz[columns]) ** 2 for columns in (first, second)]
    return np.asarray(POLICY.most_ionosphere_m * np.abs(np.nan_to_num(inverse[0] - inverse[1], nan=1.0)))


def _reflections_m(o: Observations, first: Any, second: Any) -> Reals:
    """Return the largest difference (n,) that reflections make between two codes, metres."""
    chips_m = [[s.plan.chip_m for s in (o.signals[int(k)] for k in columns)] for columns in (first, second)]
    return np.asarray(POLICY.reflected_chips * np.sum(chips_m, axis=0))
