"""Find changes common to all satellites of one antenna that neither the sky nor its receiver makes.

An attack that lies on the true signals to centimetres breaks nothing and makes no second peak. It still has to move all
satellites together, and two things show that:

- **code and carrier diverge** on all of them alike, if codes are dragged off and carriers are not. The ionosphere makes
  them diverge by centimetres a second at most.
- **all carriers turn** as by a clock, faster than an oscillator of the stated class wanders, and as no motion does.

`continuity` has the same of one moment: steps of code against carrier and of the clock. `levels` has C/N0 and noise.
This test looks for changes that last for seconds. `laws` has the statistics and their assumptions.

None of this shows an attack: a receiver whose sampling clock and carrier come from two oscillators parts code from
carrier. Both overrule what windows say one by one, as steps do.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from skyproof.detectors.base import NotTested, Reporter, leave_open
from skyproof.detectors.common_change.laws import alike_p_value, turn_p_value, turn_sigma_m
from skyproof.detectors.common_change.policy import POLICY
from skyproof.detectors.common_change.series import estimate_rates, estimate_turn
from skyproof.detectors.continuity.one_sky import join_later, select_columns, select_one_per_transmission
from skyproof.detectors.continuity.policy import POLICY as CONTINUITY
from skyproof.errors import SettingsError, require_probability
from skyproof.gnss.oscillators import OSCILLATORS, PLATFORM_CLASSES
from skyproof.records import (
    Cause,
    ConsistentSet,
    Datum,
    Finding,
    Hypothesis,
    Need,
    Observations,
    Records,
    SignalId,
    SignalRef,
    Transmission,
)

__all__ = ["CommonChange", "CommonChangeSettings"]

_SHARES = 2  # of the false alarms: code against carrier, turns


@dataclass(frozen=True)
class CommonChangeSettings:
    """Settings of `CommonChange`.

    false_alarm_probability : of each receiver and window, for all tests together.
    multipath_sigma_m : of one pseudorange, one sigma, with any correlation over time.
    ionosphere_m_s : by which it may part code from carrier on all satellites alike, more than some minutes before.
    oscillator : the class of the receivers' clocks, as in a platform file; turns are not looked at without.
    oscillator_share : by which a single oscillator may wander more than `gnss.oscillators` has it of its class.
    carrier_error_m : of a carrier beside noise, by reflections and the air, one sigma.
    """

    false_alarm_probability: float = 1e-3
    multipath_sigma_m: float = 1.0
    ionosphere_m_s: float = 0.03
    oscillator: str | None = None
    oscillator_share: float = 3.0
    carrier_error_m: float = 0.01

    def __post_init__(self) -> None:
        require_probability("common_change", "false_alarm_probability", self.false_alarm_probability)
        for name in ("carrier_error_m", "oscillator_share"):
            if not getattr(self, name) > 0.0:
                raise SettingsError(f"common_change: {name} is {getattr(self, name)}, expected more than 0")
        if self.oscillator is not None and self.oscillator not in PLATFORM_CLASSES:
            raise SettingsError(
                f"common_change: oscillator is {self.oscillator!r}, expected one of {', '.join(PLATFORM_CLASSES)}"
            )


class _Reference(NamedTuple):
    """A rate of code less carrier over `span_s` until `until_s`, which later ones are held against."""

    rate_m_s: float
    sigma_m_s: float
    span_s: float
    until_s: float


@dataclass(frozen=True, eq=False, kw_only=True)
class _Past:
    """What is remembered of a receiver: bounded by the number of transmissions and the longest span."""

    tail: Observations
    sources: Mapping[Transmission, SignalId]
    members: tuple[SignalId, ...] = ()
    references: Mapping[SignalId, _Reference] = field(default_factory=dict)


class CommonChange:
    """The detector: see the module's text. It remembers half a minute of each receiver."""

    name = "common_change"
    needs = (Need.OBSERVATIONS,)

    def __init__(self, settings: CommonChangeSettings | None = None) -> None:
        self.settings = settings or CommonChangeSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Finding], Any]:
        """Return the findings of one window; never raises for what the data lack."""
        report = Reporter(self, records, Hypothesis.CONTINUOUS)
        if lacking := report.name_missing():
            return lacking, state
        pasts: dict[str, _Past] = dict(state or {})
        found: list[Finding] = []
        for o in records.observations:
            before = pasts.get(o.receiver)
            if before is not None and o.elapsed_s[-1] <= before.tail.elapsed_s[-1]:
                before = None  # another recording
            of_receiver, past = _Window(report, self.settings, o, before).examine()
            found += of_receiver
            if past is not None:
                pasts[o.receiver] = past
        return found, pasts


class _Window:
    """One receiver in one window, after what came before."""

    def __init__(self, report: Reporter, settings: CommonChangeSettings, o: Observations, past: _Past | None) -> None:
        self.report, self.records, self.settings = report, report.records, settings
        self.o, self.past = o, past
        self.alpha = self.settings.false_alarm_probability / _SHARES
        sets = sorted(
            (s for s in self.records.sets if s.receiver == o.receiver), key=lambda s: (-len(s.signals), s.statistic)
        )
        self.sky: ConsistentSet | None = sets[0] if sets else None

    def examine(self) -> tuple[list[Finding], _Past | None]:
        """Return what changes alike, and what is remembered."""
        before = self.past.members if self.past is not None else ()
        members = self.sky.signals if self.sky is not None else before
        sources = self.past.sources if self.past is not None else {}
        now, sources = select_one_per_transmission(self.o, members, before, sources)
        if now.gpst.size < 2:
            return [self._pass_over(NotTested("few_satellites", self._state_need()))], self.past
        stretch = now if self.past is None else join_later(self.past.tail, now)
        past = self.past or _Past(tail=now.select(slice(0)), sources={})
        rates = [estimate_rates(stretch, span_s, self.settings.multipath_sigma_m) for span_s in POLICY.spans_s]
        parted = self._test_parting(rates, past, float(stretch.elapsed_s[-1]))
        tested = [parted, self._test_turns(stretch)]
        found = [finding for finding in tested if finding is not None]
        failed = parted is not None and parted.failed
        references = (
            past.references if failed else _keep_first_rates(rates, past.references, float(stretch.elapsed_s[-1]))
        )
        end_s = float(stretch.elapsed_s[-1])
        first = int(np.searchsorted(stretch.elapsed_s, end_s - max(POLICY.spans_s) - 1e-6))
        return found or [self._pass_over(self._explain_nothing_before())], _Past(
            tail=stretch.select(slice(first, None)),
            sources=sources,
            members=members,
            references=references,
        )

    def _test_parting(self, rates: list[Mapping[SignalId, Any]], past: _Past, end_s: float) -> Finding | None:
        """Test code against carrier, less what it was when each satellite came."""
        tests: list[tuple[float, float]] = []
        for span_s, found in zip(POLICY.spans_s, rates, strict=True):
            begun_s = end_s - (1.0 - POLICY.overlap_share) * span_s
            earlier = {signal: old for signal, old in past.references.items() if old.until_s <= begun_s}
            for kind_signals in _group_by_kind(found.keys() & earlier.keys()):
                pairs = [(found[signal], earlier[signal]) for signal in kind_signals]
                difference = np.array([rate.rate_m_s - old.rate_m_s for rate, old in pairs])
                sigma = np.array([np.hypot(rate.sigma_m_s, old.sigma_m_s) for rate, old in pairs])
                p = float(alike_p_value(difference, sigma, self.settings.ionosphere_m_s))
                tests.append((p, float(np.median(difference))))
        if not tests:
            return None
        least, rate_m_s = min(tests)
        return self._find(
            min(1.0, len(tests) * least),
            ("together", "parted"),
            (Cause.OSCILLATOR,),
            {"statistic": rate_m_s, "rate_m_s": rate_m_s},
            hypothesis=Hypothesis.CODE_FOLLOWS_CARRIER,
        )

    def _test_turns(self, stretch: Observations) -> Finding | None:
        """Test all carriers against the oscillator's class."""
        settings, navigation = self.settings, self.records.navigation
        if settings.oscillator is None or navigation is None or self.sky is None:
            return None
        oscillator = OSCILLATORS[PLATFORM_CLASSES[settings.oscillator]]
        tests: list[tuple[float, float, float]] = []
        kinds = [
            select_columns(stretch, np.array([stretch.signals.index(s) for s in observations]))
            for observations in _group_by_kind(stretch.signals)
        ]
        for observations, apart_s in product(kinds, POLICY.turns_s):
            turn = estimate_turn(observations, navigation, self.sky.position_ecef_m, apart_s, settings.carrier_error_m)
            if turn is not None:
                sigma_m = settings.oscillator_share * turn_sigma_m(oscillator, apart_s)
                p = float(turn_p_value(turn.turn_m, turn.variance_m2, sigma_m))
                tests.append((p, float(turn.turn_m), apart_s))
        if not tests:
            return None
        least, turn_m, apart_s = min(tests)
        return self._find(
            min(1.0, len(tests) * least),
            ("turns_as_clock", "turned"),
            (Cause.OSCILLATOR, Cause.STATEMENT),
            {
                "statistic": turn_m,
                "turn_m": turn_m,
                "time_s": 2.0 * apart_s,
                "oscillator": settings.oscillator,
            },
            hypothesis=Hypothesis.CONTINUOUS,
        )

    def _find(
        self,
        p_value: float,
        codes: tuple[str, str],
        causes: tuple[Cause, ...],
        data: Mapping[str, Datum],
        *,
        hypothesis: Hypothesis,
    ) -> Finding:
        """Return a test's finding. codes : where it passes, and where it fails."""
        return self.report.find(
            self._subject(),
            codes[p_value < self.alpha],
            {Cause.CLEAN: p_value, **leave_open(causes)},
            hypothesis=hypothesis,
            alpha=self.alpha,
            data=data,
        )

    def _explain_nothing_before(self) -> NotTested:
        """Return whether this window is the first, or the same signals are not there now and before."""
        if self.past is None:
            return NotTested("first_window", self._state_need())
        return NotTested("nothing_shared", self._state_need())

    def _state_need(self) -> dict[str, Datum]:
        """Return the receiver, and how many satellites a test needs."""
        return {"receiver": self.o.receiver, "needed": CONTINUITY.one_sky_satellites}

    def _pass_over(self, why: NotTested) -> Finding:
        """Return why nothing could be tested."""
        return self.report.pass_over(self._subject(), why)

    def _subject(self) -> tuple[SignalRef, ...]:
        measured = np.isfinite(self.o.pseudorange_m).any(axis=0)
        return tuple(SignalRef(self.o.receiver, self.o.signals[k]) for k in np.flatnonzero(measured))


def _group_by_kind(signals: Iterable[SignalId]) -> list[list[SignalId]]:
    """Group the signals by kind, for each kind with five or more: one per satellite, imitated all or none."""
    kinds: dict[tuple[str, str, str], list[SignalId]] = {}
    for signal in sorted(signals):
        kinds.setdefault(signal.kind, []).append(signal)
    return [members for members in kinds.values() if len(members) >= CONTINUITY.one_sky_satellites]


def _keep_first_rates(
    rates: list[Mapping[SignalId, Any]], before: Mapping[SignalId, _Reference], end_s: float
) -> Mapping[SignalId, _Reference]:
    """Keep the first rate of each satellite, over the longest span that was available."""
    references = dict(before)
    for span_s, found in zip(POLICY.spans_s, rates, strict=True):
        for signal, rate in found.items():
            if signal not in references or (
                references[signal].span_s < span_s and end_s - references[signal].until_s <= span_s
            ):
                references[signal] = _Reference(rate.rate_m_s, rate.sigma_m_s, span_s, end_s)
    return references
