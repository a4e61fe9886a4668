"""Test if the code of each signal moves with its carrier, or its Doppler.

A false signal that lies upon a true one drags the code away; a carrier loop that holds the true phase, or a transmitter
that does not turn its carrier as it moves its code, lets both part. `continuity` and `common_change` look at what all
signals do together. Here each signal is tested alone, over the last seconds and over minutes (`divergence`).

A test that fails leaves the cause open: a satellite's fault, a direct signal that came to be blocked, or a false one.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from skyproof.arrays import Booleans
from skyproof.detectors.base import NotTested, Reporter, leave_open
from skyproof.detectors.code_carrier.divergence import (
    Divergence,
    code_minus_carrier,
    estimate_divergences,
)
from skyproof.detectors.code_carrier.policy import POLICY
from skyproof.errors import require_probability
from skyproof.records import (
    Cause,
    CellStatus,
    Datum,
    Finding,
    Hypothesis,
    Need,
    Observations,
    Records,
    SignalRef,
    list_refs,
)

__all__ = ["CodeCarrier", "CodeCarrierSettings"]


@dataclass(frozen=True)
class CodeCarrierSettings:
    """Settings of `CodeCarrier`.

    false_alarm_probability : of each receiver and window, for all its signals together.
    multipath_sigma_m : of one pseudorange, one sigma; it may change altogether.
    """

    false_alarm_probability: float = 1e-3
    multipath_sigma_m: float = 1.0

    def __post_init__(self) -> None:
        require_probability("code_carrier", "false_alarm_probability", self.false_alarm_probability)


class CodeCarrier:
    """The detector: see the module's text. It remembers two minutes of each receiver, thinned to 512 epochs."""

    name = "code_carrier"
    share = 0.0  # it never speaks of an attack
    needs = (Need.OBSERVATIONS,)

    def __init__(self, settings: CodeCarrierSettings | None = None) -> None:
        self.settings = settings or CodeCarrierSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Finding], Any]:
        """Return the findings of one window; never raises for what the data lack."""
        report = Reporter(self, records, Hypothesis.CODE_FOLLOWS_CARRIER)
        if lacking := report.name_missing():
            return lacking, state
        tails: dict[str, Observations] = dict(state or {})
        found = []
        for o in records.observations:
            tail = tails.get(o.receiver)
            if tail is not None and tail.elapsed_s[-1] >= o.elapsed_s[0]:
                tail = None  # another recording
            joined = o if tail is None else Observations.join((tail, o))
            found.append(self._test_receiver(report, o, joined))
            kept = joined.elapsed_s >= o.elapsed_s[-1] - POLICY.remembered_s
            first = max(int(np.argmax(kept)), joined.gpst.size - POLICY.remembered_epochs)
            tails[o.receiver] = joined.read(first, joined.gpst.size)
        return found, tails

    def _test_receiver(self, report: Reporter, o: Observations, joined: Observations) -> Finding:
        """Test each signal over this window and over what is remembered of it."""
        tested: list[tuple[SignalRef, Divergence]] = []
        tests = 0
        whole = _find_unbroken(joined)
        signals = [signal for signal in o.signals if whole[-1, joined.column_of[signal]]]
        columns = np.array([joined.column_of[signal] for signal in signals], np.intp)
        begins = whole[:, columns].argmax(axis=0)
        window = int(np.searchsorted(joined.elapsed_s, o.elapsed_s[0]))
        apart_m, gathered_m2 = (values[:, columns] for values in code_minus_carrier(joined))
        code_m2 = joined.pseudorange_sigma_m[:, columns] ** 2
        chip_m = np.array([signal.plan.chip_m for signal in signals])
        looks = [
            estimate_divergences(
                joined.elapsed_s, apart_m, code_m2, gathered_m2, chip_m, starts, self.settings.multipath_sigma_m
            )
            for starts in (np.maximum(window, begins), begins)
        ]
        for k, signal in enumerate(signals):
            spans = looks if begins[k] != window else looks[:1]
            known = [look for span in spans if (look := span[k]) is not None]
            tests += len(known)
            if known:
                tested.append((SignalRef(o.receiver, signal), min(known, key=lambda look: look.p_value)))
        if not tested:
            every = list_refs(o.receiver, o.signals)
            return report.pass_over(
                every, NotTested("no_carrier", {"needed": POLICY.least_signals, "epochs": POLICY.least_epochs})
            )
        worst, look = min(tested, key=lambda each: each[1].p_value)
        failed = [ref for ref, each in tested if tests * each.p_value < self.settings.false_alarm_probability]
        data: dict[str, Datum] = {"worst": str(worst.signal), "change_m": look.change_m, "time_s": look.time_s}
        return report.find(
            tuple(failed or (ref for ref, _ in tested)),
            "parted" if failed else "together",
            {Cause.CLEAN: min(1.0, tests * look.p_value), **leave_open((Cause.REFLECTIONS, Cause.FAULT))},
            data=data,
        )


def _find_unbroken(o: Observations) -> Booleans:
    """Find where (n_epochs, n_signals) a signal continues to the last epoch without a slip or a gap.

    The epoch of a slip begins the continuous stretch.
    """
    received = np.isfinite(o.pseudorange_m) & (o.status != CellStatus.NOT_TRACKED)
    step_s = np.diff(o.elapsed_s)
    usual_s = float(np.median(step_s)) if step_s.size else 0.0
    gap = np.append(False, step_s > POLICY.broken_intervals * usual_s)
    with_carrier = np.isfinite(o.carrier_cyc).any(axis=0)
    broken = received & (gap[:, None] | ((o.status == CellStatus.SLIP) & with_carrier))
    lost = np.where(with_carrier, received & ~np.isfinite(o.carrier_cyc), False)
    later_break = np.cumsum((broken | lost | ~received)[::-1], axis=0)[::-1]
    after = np.vstack([later_break[1:], np.zeros((1, later_break.shape[1]), later_break.dtype)])
    return np.asarray((after == 0) & received & ~lost)
