"""The plug: what a detector is."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol, runtime_checkable

from skyproof.records import (
    UNTESTED,
    AnyFinding,
    Cause,
    Datum,
    Evidence,
    Finding,
    Hypothesis,
    Need,
    Observations,
    Records,
    SignalRef,
)

__all__ = [
    "NEEDS",
    "Detector",
    "NotTested",
    "Reporter",
    "leave_open",
    "missing",
    "signals_of",
    "undecided",
]

NEEDS: dict[Need, str] = {
    Need.OBSERVATIONS: "measurements of a receiver",
    Need.TWO_RECEIVERS: "measurements of a second receiver nearby, over the same time",
    Need.NAVIGATION: "orbits: a navigation file, or 30 s of signals whose messages can be read",
    Need.SETS: "signals that fit one position: pseudoranges of at least 5 satellites with their orbits",
    Need.TAPS: "correlators beside the prompt one",
    Need.VECTOR_TAPS: "correlators of a receiver whose channels all follow one position",
    Need.CCAF: "correlation over a grid of delay and Doppler, for each satellite",
    Need.ARRAY_PHASES: "carrier phases of an antenna array",
    Need.NAV_STATE: "attitude of the body over the same time: an inertial unit, or angles that are stated",
    Need.OWN_FIXES: "the receiver's own fixes, in a log (UBX-NAV-PVT, SBF PVTGeodetic, NMEA GGA)",
    Need.SPIN_ARMS: "length and rate of the arm that turns the antenna",
    Need.STANDING: 'a receiver that stands: its surveyed position, or motion = "static", in the platform file',
    Need.INERTIAL: "readings of an inertial unit that carries the antenna, with its grade (--imu or a platform file)",
    Need.FINDINGS: "what other tests find in the same window",
    Need.EXPECTED: "a receiver that stands, or whose oscillator or inertial unit is known (settings or platform file)",
    Need.CHANGES: "a recording shorter than a second; others are checked by tests of continuity",
}
"""What detectors may need, in words for the user."""


@runtime_checkable
class Detector(Protocol):
    """One method of telling true from false.

    A class with this shape, registered under the entry point group `skyproof.detectors`, joins every run. It is
    instantiated with no argument or with its `settings`. These are a frozen dataclass with a default for every field
    and a field `false_alarm_probability`. It sees records of one window at a time, does not change them, and returns
    what it finds.

    `state` is what it remembers: None at the start, returned by `examine`, and passed in again with the next
    window. So a recording in pieces gives what the whole gives. `skyproof.testing.check_detector` holds the
    contract.

    A class may have a `share` of the probability of a false alarm, 1 being what most detectors take; 0 if it never
    says "attack" or "spoofed".

    One that needs `Need.TAPS` or `Need.CCAF` has an `Asked` as its class's `asks`: the receivers take what any detector
    asks for.

    A detector may have a method `review(evidence) -> list[Evidence]` as well. At the end of a run it receives the
    evidence of all detectors and windows. It returns all of it, with its own changed by what later windows have shown.
    """

    @property
    def name(self) -> str: ...

    @property
    def needs(self) -> tuple[Need, ...]: ...

    @property
    def settings(self) -> Any: ...

    def examine(self, records: Records, state: Any = None) -> tuple[Sequence[AnyFinding], Any]: ...


def leave_open(causes: Iterable[Cause]) -> dict[Cause, float]:
    """Return the p-values of causes that may have corrupted everything a test looks at, the likeliest first."""
    return dict.fromkeys(causes, UNTESTED)


@dataclass(frozen=True)
class NotTested:
    """Why a test could not run: a code, with what its words need."""

    code: str
    data: Mapping[str, Datum] = field(default_factory=dict)


@dataclass(frozen=True)
class Reporter:
    """One detector in one window: makes its findings.

    hypothesis : the null of its tests, where a finding names no other.
    """

    detector: Detector
    records: Records
    hypothesis: Hypothesis

    def find(
        self,
        signals: tuple[SignalRef, ...],
        code: str,
        p: Mapping[Cause, float],
        *,
        hypothesis: Hypothesis | None = None,
        alpha: float | None = None,
        data: Mapping[str, Datum] | None = None,
        **more: Any,
    ) -> Finding:
        """Return a finding of this window. more : `singled_out`, `estimates`, `dated_gpst`.

        A cause that does nothing is a clean sky: no p-value is less than that.
        """
        clean = p.get(Cause.CLEAN, 0.0)
        return Finding(
            detector=self.detector.name,
            start_gpst=self.records.start_gpst,
            end_gpst=self.records.end_gpst,
            signals=signals,
            hypothesis=hypothesis or self.hypothesis,
            code=code,
            p={cause: max(value, clean) for cause, value in p.items()},
            alpha=self.detector.settings.false_alarm_probability if alpha is None else alpha,
            data=data or {},
            **more,
        )

    def pass_over(self, signals: tuple[SignalRef, ...], why: NotTested) -> Finding:
        """Return that these signals could not be tested, and why."""
        return self.find(signals, why.code, {}, data=why.data)

    def name_missing(self) -> list[Finding]:
        """Return that the window lacks what the detector needs; empty if it lacks nothing."""
        lacking = tuple(need for need in self.detector.needs if not self.records.has(need))
        if not lacking:
            return []
        why = NotTested("_".join(("without", *lacking)), {"lacking": tuple(map(str, lacking))})
        return [self.pass_over(signals_of(self.records.observations), why)]


def signals_of(observations: tuple[Observations, ...]) -> tuple[SignalRef, ...]:
    """List every signal of every receiver."""
    return tuple(SignalRef(o.receiver, signal) for o in observations for signal in o.signals)


def undecided(
    detector: Detector,
    records: Records,
    subject: tuple[SignalRef, ...],
    *,
    because: str,
    would_need: str | None = None,
    code: str = "",
) -> Evidence:
    """Return evidence of a test that could not tell, or could not run. code : short name of the reason."""
    return Evidence(
        detector=detector.name,
        start_gpst=records.start_gpst,
        end_gpst=records.end_gpst,
        subject=subject,
        says="undecided",
        because=because,
        would_need=would_need,
        code=code,
        false_alarm_probability=detector.settings.false_alarm_probability,
    )


def missing(detector: Detector, records: Records) -> list[Evidence]:
    """Name the records that `detector` needs and does not get, in one undecided Evidence; empty if it gets all."""
    lacking = [need for need in detector.needs if not records.has(need)]
    if not lacking:
        return []
    evidence = undecided(
        detector,
        records,
        signals_of(records.observations),
        because=f"without {' and '.join(need.replace('_', ' ') for need in lacking)}",
        would_need="; ".join(NEEDS[need] for need in lacking),
        code="_".join(("without", *lacking)),
    )
    return [replace(evidence, lacking=tuple(lacking))]
