"""Test if the codes of tracked signals move as their Dopplers say.

Only correlators of ours are tested: what another receiver prints may be smoothed, or be of several oscillators.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from skyproof.arrays import Indices, Reals
from skyproof.detectors.base import NotTested, Reporter
from skyproof.detectors.code_carrier.policy import POLICY as CODE_CARRIER
from skyproof.detectors.code_doppler.coherence import coherence_p_values, measure_parting_m_s
from skyproof.errors import require_probability
from skyproof.records import Cause, Finding, Hypothesis, Need, Observations, Records, list_refs

__all__ = ["CodeDoppler", "CodeDopplerSettings"]


@dataclass(frozen=True)
class CodeDopplerSettings:
    """Settings of `CodeDoppler`.

    false_alarm_probability : of each receiver's window, for all its signals together.
    multipath_sigma_m : of one pseudorange, one sigma.
    """

    false_alarm_probability: float = 1e-3
    multipath_sigma_m: float = 1.0

    def __post_init__(self) -> None:
        require_probability("code_doppler", "false_alarm_probability", self.false_alarm_probability)


class CodeDoppler:
    """Make one finding of each receiver with correlators and window.

    Whatever displaces a signal by another way, clock or orbit moves its code as its carrier, unless the receiver has
    two oscillators, which part all alike. A signal is named if its code leaves its Doppler and no such rate would
    explain more signals than one oscillator does.
    """

    name = "code_doppler"
    needs = (Need.OBSERVATIONS, Need.TAPS)

    def __init__(self, settings: CodeDopplerSettings | None = None) -> None:
        self.settings = settings or CodeDopplerSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Finding], Any]:
        """Return the findings of one window; never raises for what the data lack."""
        report = Reporter(self, records, Hypothesis.CODE_FOLLOWS_CARRIER)
        if lacking := report.name_missing():
            return lacking, state
        tracked = {taps.receiver for taps in records.taps}
        return [self._test_receiver(report, o) for o in records.observations if o.receiver in tracked], state

    def _test_receiver(self, report: Reporter, o: Observations) -> Finding:
        """Test all signals of a receiver, by one oscillator and by two."""
        alpha, sigma_m = self.settings.false_alarm_probability, self.settings.multipath_sigma_m
        parting_m_s = measure_parting_m_s(o, np.arange(len(o.signals)))
        columns: Indices = np.flatnonzero(np.isfinite(parting_m_s))
        if not columns.size:
            why = NotTested("few_epochs", {"receiver": o.receiver, "needed": CODE_CARRIER.least_epochs})
            return report.pass_over(list_refs(o.receiver, o.signals), why)
        n, parting_m_s = columns.size, parting_m_s[columns]
        alone: Reals = n * coherence_p_values(o, columns, sigma_m)
        rates_m_s = parting_m_s if alone.min() < alpha else ()  # where one oscillator does, two are not asked
        two = [n * n * coherence_p_values(o, columns, sigma_m, float(rate)) for rate in rates_m_s]
        one_way = min(1.0, max(float(p_values.min()) for p_values in (alone, *two)))
        failed = one_way < alpha
        sure = failed and (alone >= alpha).sum() >= max((p_values >= alpha).sum() for p_values in two)
        named = np.flatnonzero(alone < alpha) if sure else np.arange(n)
        worst = int(np.argmin(alone))
        return report.find(
            list_refs(o.receiver, tuple(o.signals[k] for k in columns[named])),
            "incoherent" if failed else "coherent",
            dict.fromkeys((Cause.CLEAN, Cause.REFLECTIONS, Cause.FAULT), one_way),
            data={"worst": str(o.signals[columns[worst]]), "parting_m_s": float(parting_m_s[worst])},
            singled_out=bool(sure),
        )
