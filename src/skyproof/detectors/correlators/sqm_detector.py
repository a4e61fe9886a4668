"""Test signal quality: does a second signal of the same satellite overlap the tracked one?

A reflection within a chip distorts correlators exactly as a second transmitter does. What tells them apart is how many
satellites show it at once, and on which side: a reflection comes after its signal, so one that comes before is the
weaker direct signal beside a tracked reflection, or not of the sky. Both counts are binomial if reflections are
independent between satellites; only the second one excludes reflections.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from skyproof.arrays import Booleans, ComplexFloats
from skyproof.detectors.base import NotTested, Reporter
from skyproof.detectors.correlators.policy import POLICY
from skyproof.detectors.correlators.second_component import (
    BeatLine,
    combine_smallest,
    distortion,
    earlier,
    pair_taps,
    reflection_amplitude,
)
from skyproof.errors import SettingsError, require_probability
from skyproof.records import (
    Asked,
    Cause,
    Datum,
    Finding,
    Hypothesis,
    Need,
    Records,
    SignalRef,
    Taps,
    TapsAsked,
    list_refs,
)
from skyproof.statistics.distributions import binomial_survival

__all__ = ["Sqm", "SqmSettings"]


@dataclass(frozen=True)
class SqmSettings:
    """Settings of `Sqm`.

    false_alarm_probability : of a receiver's window.
    multipath_sigma_m : error of code that a reflection causes without being counted, one sigma; 0 counts every one.
    reflection_probability : that a signal has a reflection beyond that.
    tracked_reflection_probability : that what is tracked is a reflection, with its direct signal weaker before it.
    min_signals : with fewer, no test of them together is made.
    """

    false_alarm_probability: float = 1e-3
    multipath_sigma_m: float = 1.0
    reflection_probability: float = 0.1
    tracked_reflection_probability: float = 0.01
    min_signals: int = 4

    def __post_init__(self) -> None:
        for name in ("false_alarm_probability", "reflection_probability", "tracked_reflection_probability"):
            require_probability("sqm", name, getattr(self, name))
        if self.multipath_sigma_m < 0.0:
            raise SettingsError(f"sqm: multipath_sigma_m is {self.multipath_sigma_m:g}, expected 0 or more")


@dataclass(frozen=True)
class _Signal:
    """What one signal's correlators show: the most telling line of all, and the most telling one before it."""

    ref: SignalRef
    distorted: BeatLine
    early: BeatLine


class Sqm:
    """The detector: one finding of each receiver and window, from `taps`.

    While several signals of a satellite are tracked nothing is said of them: they distort each other, and
    `second_signals` looks at them. The counts' p-values are upper bounds. That of a single signal's distortion is exact
    with `multipath_sigma_m` = 0.
    """

    name = "sqm"
    needs = (Need.TAPS,)
    asks = Asked(taps=TapsAsked(delays_chips=(-1.0, -0.5, 0.5, 1.0), every_s=0.02, coherent_s=0.004))

    def __init__(self, settings: SqmSettings | None = None) -> None:
        self.settings = settings or SqmSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Finding], Any]:
        """Return the findings of one window; never raises for what the data lack."""
        report = Reporter(self, records, Hypothesis.ONE_COMPONENT)
        lacking = report.name_missing()
        return lacking or [self._test_receiver(report, taps) for taps in records.taps], state

    def _test_receiver(self, report: Reporter, taps: Taps) -> Finding:
        """Count the signals that are distorted, and those that an earlier one distorts."""
        settings, signals = self.settings, _test_signals(taps, self.settings.multipath_sigma_m)
        n = len(signals)
        if n < settings.min_signals:
            refs = list_refs(taps.receiver, taps.signals)
            return report.pass_over(refs, _explain_few(taps, n, settings.min_signals))
        distorted = [s for s in signals if s.distorted.p_value < POLICY.signal_probability]
        early = [s for s in signals if s.early.p_value < POLICY.signal_probability]
        p_many = float(
            binomial_survival(len(distorted), n, settings.reflection_probability + POLICY.signal_probability)
        )
        p_early = float(
            binomial_survival(len(early), n, settings.tracked_reflection_probability + POLICY.signal_probability)
        )
        alpha = settings.false_alarm_probability
        certain = [s for s in signals if combine_smallest(s.distorted.p_value, n) < alpha]
        if 2.0 * p_early < alpha:
            code, tested = "earlier_signals", early
        elif 2.0 * p_many < alpha:
            code, tested = "many_distorted", distorted
        elif certain:
            code, tested = "some_distorted", certain
        else:
            code, tested = "undistorted", signals
        data: dict[str, Datum] = {
            "statistic": len(early) if code == "earlier_signals" else len(distorted),
            "of": n,
            "multipath_sigma_m": settings.multipath_sigma_m,
        }
        # However many signals are reflected, no reflection comes before its signal.
        p = {Cause.CLEAN: min(2.0 * p_many, 2.0 * p_early, 1.0), Cause.REFLECTIONS: min(2.0 * p_early, 1.0)}
        return report.find(tuple(s.ref for s in tested), code, p, data=data)


def _explain_few(taps: Taps, examined: int, least: int) -> NotTested:
    """Return whether the correlators, their number in the window, or the signals are what is missing."""
    sent = {signal.transmission for signal in taps.signals}
    data: dict[str, Datum] = {
        "receiver": taps.receiver,
        "looks": taps.elapsed_s.size,
        "needed_looks": POLICY.least_looks,
        "examined": examined,
        "needed": least,
        "satellites": len(sent),
    }
    if not pair_taps(taps.delays_chips):
        return NotTested("no_pair", data)
    if taps.elapsed_s.size < POLICY.least_looks:
        return NotTested("few_looks", data)
    if len(sent) < len(taps.signals) and len(sent) >= least:
        return NotTested("several_of_a_satellite", data)
    return NotTested("few_signals", data)


def _test_signals(taps: Taps, multipath_sigma_m: float) -> list[_Signal]:
    """Test every signal that is the only one of its satellite and was tracked long enough without a break."""
    pairs, signals = pair_taps(taps.delays_chips), []
    if not pairs or taps.elapsed_s.size < POLICY.least_looks:
        return []
    step_s = float(np.median(np.diff(taps.elapsed_s)))
    early_chips = float(np.min(np.abs(taps.delays_chips[[a for a, _, _ in pairs]])))
    value = taps.value[:, :, int(np.argmin(np.abs(taps.dopplers_hz)))]
    tracked: Booleans = np.asarray(np.isfinite(value).all(axis=2))
    for column in np.flatnonzero(tracked.any(axis=0)):
        alternatives = [k for k, s in enumerate(taps.signals) if s.transmission == taps.signals[column].transmission]
        looks = _longest_run(value[:, column], tracked[:, column] & (tracked[:, alternatives].sum(axis=1) == 1))
        if len(looks) < POLICY.least_looks:
            continue
        allowed = reflection_amplitude(multipath_sigma_m, early_chips, taps.signals[column].plan.chip_m)
        parts = np.array_split(looks, -(-len(looks) // round(POLICY.longest_line_s / step_s)))
        lines = [distortion(part, taps.delays_chips, step_s, allowed=allowed) for part in parts]
        early = [earlier(part, taps.delays_chips, step_s) for part in parts]
        ref = SignalRef(taps.receiver, taps.signals[column])
        signals.append(_Signal(ref, _select_strongest(lines), _select_strongest(early)))
    return signals


def _longest_run(looks: ComplexFloats, there: Booleans) -> ComplexFloats:
    """Return the longest run without a gap."""
    if not there.any():
        return looks[:0]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], there, [False]]).astype(np.int8)))
    begins, ends = edges[::2], edges[1::2]
    longest = int(np.argmax(ends - begins))
    return looks[begins[longest] : ends[longest]]


def _select_strongest(lines: list[BeatLine]) -> BeatLine:
    best = min(lines, key=lambda line: line.p_value)
    return best._replace(p_value=combine_smallest(best.p_value, len(lines)))
