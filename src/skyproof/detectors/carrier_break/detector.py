"""Test if carriers that break together go on together, as those of one sky do.

Only receivers with correlators of ours are tested: others restart their carriers as they like.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from skyproof.detectors.base import NotTested, Reporter, leave_open
from skyproof.detectors.carrier_break.phases import Break, compare_phases, find_breaks
from skyproof.detectors.carrier_break.policy import POLICY
from skyproof.errors import require_probability
from skyproof.navigation.fix import fix
from skyproof.records import Cause, Finding, Hypothesis, NavigationData, Need, Observations, Records, list_refs

__all__ = ["CarrierBreak", "CarrierBreakSettings"]


@dataclass(frozen=True)
class CarrierBreakSettings:
    """Settings of `CarrierBreak`.

    false_alarm_probability : of each receiver's window.
    """

    false_alarm_probability: float = 1e-3

    def __post_init__(self) -> None:
        require_probability("carrier_break", "false_alarm_probability", self.false_alarm_probability)


class CarrierBreak:
    """Make one finding of each receiver with correlators and window; remember the last epochs of each.

    A test that fails leaves open that the antenna was moved or exchanged, and a fault of the receiver.
    """

    name = "carrier_break"
    share = 0.0  # it never speaks of an attack
    needs = (Need.OBSERVATIONS, Need.NAVIGATION, Need.TAPS)

    def __init__(self, settings: CarrierBreakSettings | None = None) -> None:
        self.settings = settings or CarrierBreakSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Finding], Any]:
        """Return the findings of one window; never raises for what the data lack."""
        report = Reporter(self, records, Hypothesis.CONTINUOUS)
        lacking = report.name_missing()
        if lacking or records.navigation is None:
            return lacking, state
        tails: dict[str, Observations] = dict(state or {})
        tracked, found = {taps.receiver for taps in records.taps}, []
        for o in records.observations:
            if o.receiver not in tracked:
                continue
            tail = tails.get(o.receiver)
            joined = o if tail is None or tail.elapsed_s[-1] >= o.elapsed_s[0] else Observations.join((tail, o))
            found.append(self._test_receiver(report, joined, records.navigation))
            tails[o.receiver] = joined.read(max(joined.gpst.size - POLICY.tail_epochs, 0), joined.gpst.size)
        return found, tails

    def _test_receiver(self, report: Reporter, o: Observations, navigation: NavigationData) -> Finding:
        """Compare phases over each break of a receiver's carriers; report the worst."""
        every, breaks = list_refs(o.receiver, o.signals), find_breaks(o)
        if not np.isfinite(o.carrier_cyc).any():
            return report.pass_over(every, NotTested("no_carriers", {"receiver": o.receiver}))
        still = {Cause.CLEAN: 1.0, **leave_open((Cause.MISSING_SAMPLES, Cause.MOTION, Cause.FAULT))}
        if not breaks:
            return report.find(every, "unbroken", still)
        stands = o.receiver in report.records.standing
        p_values = [
            compare_phases(o, broken, 0.0 if stands else _measure_velocity_change_m_s(o, navigation, broken))
            for broken in breaks
        ]
        worst = min(range(len(breaks)), key=lambda k: p_values[k][0])
        p_value, off_cyc = min(1.0, len(breaks) * p_values[worst][0]), p_values[worst][1]
        failed = p_value < self.settings.false_alarm_probability
        return report.find(
            list_refs(o.receiver, tuple(o.signals[k] for k in breaks[worst].columns)),
            "goes_apart" if failed else "goes_on",
            still | {Cause.CLEAN: p_value},
            data={"off_cyc": off_cyc if np.isfinite(off_cyc) else 0.0, "breaks": len(breaks)},
            dated_gpst=o.gpst[breaks[worst].after] if failed else None,
        )


def _measure_velocity_change_m_s(o: Observations, navigation: NavigationData, broken: Break) -> float:
    """Measure by how much the velocity over a break may differ from the mean of that before and after, largest axis.

    It is half of their difference, and the error of their means; infinite if they are not known. One signal of each
    satellite is used.
    """
    first = {signal.sat: signal for signal in reversed(o.signals)}
    ends = [
        (max(broken.before + 1 - POLICY.tail_epochs, 0), broken.before + 1),
        (broken.after, broken.after + POLICY.tail_epochs),
    ]
    means, errors = [], []
    for begin, end in ends:
        beside = o.read(begin, min(end, o.gpst.size))
        velocity_m_s = fix(beside, navigation, signals=tuple(first.values())).velocity_ecef_m_s
        known = velocity_m_s[np.isfinite(velocity_m_s).all(axis=1)]
        if len(known) < POLICY.beside_epochs:
            return np.inf
        means.append(known.mean(axis=0))
        errors.append(known.std(axis=0, ddof=1) / np.sqrt(len(known)))
    return float(np.max(0.5 * np.abs(means[1] - means[0]) + np.hypot(*errors)))
