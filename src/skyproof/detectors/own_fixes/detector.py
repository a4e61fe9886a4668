"""Test if the positions that a receiver computed itself move as a platform can.

A log may hold no ranges, as one of NMEA does. Then the only position is what the receiver reports, which it may have
filtered, held or put on a road. So nothing is known of its errors but that large ones are rare.

Law. A platform departs from the place that two fixes lead to by half of A d1 (d0 + d1) at most. Here A is the largest
acceleration, and d0, d1 are the intervals. From one fix to the next no platform goes farther than its largest speed
allows. Any excess is due to errors of the fixes. An error of more than x has at most the probability exp(-x / b), where
b is 20 m, or what the receiver states if that is more. Reflections in streets put fixes tens of metres off, rarely more
(Kaplan & Hegarty, 3rd edition, 9.5). Where a sum of errors with weights w exceeds x, one of them exceeds x / sum(w):
the union bound gives the p-value. Jumps of some kilometres from second to second count, and nothing that is slow.

A receiver may err without an attack: the cause of a fix that jumps stays open.
"""

from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np

from skyproof.arrays import Booleans, Instants, Reals
from skyproof.detectors.base import NotTested, Reporter, leave_open
from skyproof.detectors.own_fixes.policy import POLICY
from skyproof.errors import SettingsError, require_probability
from skyproof.records import Cause, Datum, Finding, Hypothesis, Need, ReceiverFixes, Records, SignalRef

__all__ = ["OwnFixes", "OwnFixesSettings", "chance_of_jumps"]

_TAIL: Final = 2  # fixes that are remembered: the law looks back so far


@dataclass(frozen=True)
class OwnFixesSettings:
    """Settings of `OwnFixes`.

    false_alarm_probability : of each receiver and window, for all its fixes together.
    acceleration_max_m_s2 : no platform exceeds it. speed_max_m_s : no platform exceeds it, if it is known.
    """

    false_alarm_probability: float = 1e-3
    acceleration_max_m_s2: float = 50.0
    speed_max_m_s: float | None = None

    def __post_init__(self) -> None:
        require_probability("own_fixes", "false_alarm_probability", self.false_alarm_probability)
        if not self.acceleration_max_m_s2 > 0.0:
            raise SettingsError(
                f"own_fixes: acceleration_max_m_s2 is {self.acceleration_max_m_s2}, expected more than 0"
            )


class _Series(NamedTuple):
    """Fixes in order: instants, places and the scale of their errors."""

    gpst: Instants
    position_ecef_m: Reals
    error_m: Reals

    def rows(self, chosen: Booleans | slice) -> "_Series":
        """Return some of them."""
        return _Series(self.gpst[chosen], self.position_ecef_m[chosen], self.error_m[chosen])


class OwnFixes:
    """The detector: see the module's text. It remembers two fixes of each receiver."""

    name = "own_fixes"
    share = 0.0  # it never speaks of an attack
    needs = (Need.OWN_FIXES,)

    def __init__(self, settings: OwnFixesSettings | None = None) -> None:
        self.settings = settings or OwnFixesSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Finding], Any]:
        """Return the findings of one window; never raises for what the data lack."""
        report = Reporter(self, records, Hypothesis.OWN_FIX)
        if lacking := report.name_missing():
            return lacking, state
        tails: dict[str, _Series] = dict(state or {})
        found = []
        for receiver, fixes in records.own_fixes.items():
            tail = tails.get(receiver)
            if tail is not None and fixes.gpst.size and tail.gpst.size and tail.gpst[-1] >= fixes.gpst[0]:
                tail = None  # another recording
            series = _rising(fixes, tail)
            found.append(self._test_receiver(report, receiver, series))
            tails[receiver] = series.rows(slice(-_TAIL, None))
        return found, tails

    def _test_receiver(self, report: Reporter, receiver: str, series: _Series) -> Finding:
        """Test each fix against the two before it."""
        observations = (o for o in report.records.observations if o.receiver == receiver)
        signals = tuple(SignalRef(receiver, signal) for o in observations for signal in o.signals)
        if series.gpst.size < _TAIL + 1:
            return report.pass_over(signals, NotTested("few_own_fixes", {"receiver": receiver, "needed": _TAIL + 1}))
        t_s = (series.gpst - series.gpst[0]).astype(np.int64) * 1e-9
        chances = chance_of_jumps(
            t_s,
            series.position_ecef_m,
            series.error_m,
            self.settings.acceleration_max_m_s2,
            np.inf if self.settings.speed_max_m_s is None else self.settings.speed_max_m_s,
        )
        jumps = chances.size * chances < self.settings.false_alarm_probability
        p = {Cause.CLEAN: min(1.0, chances.size * float(chances.min())), **leave_open((Cause.FAULT,))}
        if not jumps.any():
            return report.find(signals, "goes_on", p, data={"receiver": receiver})
        k = int(np.argmax(jumps))  # the first: a jump bends the way at two fixes
        jump_m = float(np.linalg.norm(series.position_ecef_m[k + _TAIL] - series.position_ecef_m[k + _TAIL - 1]))
        data: dict[str, Datum] = {"receiver": receiver, "jump_m": jump_m}
        return report.find(signals, "jumps", p, data=data, dated_gpst=series.gpst[k + _TAIL])


def chance_of_jumps(
    t_s: Reals, position_ecef_m: Reals, error_m: Reals, acceleration_max_m_s2: float, speed_max_m_s: float
) -> Reals:
    """Return the largest probability (n - 2,) of each fix from the third on under a platform that moves as it can.

    t_s : (n,) rising. position_ecef_m : (n, 3). error_m : (n,) scale of each fix's error.
    """
    before_s, after_s = np.diff(t_s)[:-1], np.diff(t_s)[1:]
    step_m = np.diff(position_ecef_m, axis=0)
    ratio = after_s / before_s
    beyond_m = np.linalg.norm(step_m[1:] - ratio[:, None] * step_m[:-1], axis=1)
    beyond_m -= 0.5 * acceleration_max_m_s2 * after_s * (before_s + after_s)
    scale_m = np.maximum.reduce([error_m[2:], error_m[1:-1], error_m[:-2]])
    chance = 3.0 * np.exp(-np.maximum(beyond_m, 0.0) / (scale_m * (2.0 + 2.0 * ratio)))
    if np.isfinite(speed_max_m_s):
        far_m = np.maximum(np.linalg.norm(step_m[1:], axis=1) - speed_max_m_s * after_s, 0.0)
        of_speed = 2.0 * np.exp(-far_m / (2.0 * np.maximum(error_m[2:], error_m[1:-1])))
        chance = 2.0 * np.minimum(chance, of_speed)
    return np.asarray(np.minimum(chance, 1.0))


def _rising(fixes: ReceiverFixes, tail: _Series | None) -> _Series:
    """Return the fixes behind those that are remembered, without those whose time does not rise."""
    stated_m = np.hypot(np.nan_to_num(fixes.horizontal_sigma_m), np.nan_to_num(fixes.vertical_sigma_m))
    series = _Series(fixes.gpst, fixes.position_ecef_m, np.maximum(stated_m, POLICY.fix_error_m))
    if tail is not None:
        series = _Series(
            np.concatenate([tail.gpst, series.gpst]),
            np.concatenate([tail.position_ecef_m, series.position_ecef_m]),
            np.concatenate([tail.error_m, series.error_m]),
        )
    if not series.gpst.size:
        return series
    latest = np.maximum.accumulate(series.gpst)[:-1]
    return series.rows(np.append(True, series.gpst[1:] > latest))
