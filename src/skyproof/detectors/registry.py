"""Find the installed detectors, and contain the faults of those from other packages: no such fault ends a run."""

import traceback
from collections.abc import Callable, Iterable, Sequence
from dataclasses import fields, is_dataclass
from importlib.metadata import EntryPoint
from math import isfinite
from pathlib import Path
from typing import Any, Final, get_args

from skyproof.detectors.adapter import finding_from_evidence, get_signals, restore
from skyproof.detectors.base import Detector, NotTested, Reporter, signals_of
from skyproof.detectors.entries import OURS, list_registered, package_of
from skyproof.errors import SettingsError, make_readable, shorten
from skyproof.records import AnyFinding, Cause, Evidence, Finding, Hypothesis, Need, Records, Says, SignalRef

__all__ = ["examine_window", "find_result_fault", "instantiate", "is_ours", "load_detectors", "review_evidence"]

_LONGEST: Final = 300


def load_detectors() -> dict[str, type[Detector]]:
    """Load the installed detectors, ours and others', by name and in order of name.

    Raises
    ------
    SettingsError : a registered detector cannot be imported or made, is none, or has the name of another; the message
        says from which package and why.
    """
    found: dict[str, type[Detector]] = {}
    points: dict[str, EntryPoint] = {}
    for point in list_registered():
        if point.name in found:
            raise SettingsError(
                f"detector {point.name!r} is registered twice, by {package_of(points[point.name])} and by "
                f"{package_of(point)}; rename one, or uninstall one of the packages"
            )
        found[point.name], points[point.name] = _load(point), point
    return found


def is_ours(detector: Detector) -> bool:
    """Tell if a detector belongs to skyproof, so that a fault in it is a fault of skyproof."""
    return type(detector).__module__.partition(".")[0] == OURS


def instantiate(kind: type[Detector], settings: Any) -> Detector:
    """Instantiate a detector with these settings.

    Raises
    ------
    SettingsError : it does not take them.
    """
    made: Callable[..., Detector] = kind
    try:
        return made(settings=settings)
    except Exception as error:
        raise SettingsError(
            f"detector {kind.__name__} of {kind.__module__} cannot be made with settings=...: "
            f"{_describe_error(error)}; repair or uninstall its package"
        ) from error


def _load(point: EntryPoint) -> type[Detector]:
    """Load a detector from its entry point; raise SettingsError if it is no detector of this name."""
    try:
        kind = point.load()
        fault = _find_declaration_fault(kind(), point.name)
    except Exception as error:
        raise SettingsError(
            f"detector {point.name!r} of {package_of(point)} cannot be loaded from {point.value}: "
            f"{_describe_error(error)}; repair or uninstall that package"
        ) from error
    if fault:
        raise SettingsError(
            f"detector {point.name!r} of {package_of(point)}, {point.value}: {fault}; repair or uninstall that package"
        )
    loaded: type[Detector] = kind
    return loaded


def _find_declaration_fault(made: Any, name: str) -> str | None:
    """Name what is wrong with how a detector declares itself; None if nothing is."""
    lacking = [attribute for attribute in ("name", "needs", "settings", "examine") if not hasattr(made, attribute)]
    if lacking:
        return f"it has no {' and no '.join(lacking)}"
    if made.name != name:
        return f"its name is {made.name!r}, expected the registered name {name!r}"
    if not isinstance(made.needs, tuple) or not all(isinstance(need, Need) for need in made.needs):
        return f"its needs are {shorten(str(made.needs))}, expected a tuple of members of skyproof.records.Need"
    settings = made.settings
    if not is_dataclass(settings) or "false_alarm_probability" not in {f.name for f in fields(settings)}:
        return "its settings are no dataclass with a field false_alarm_probability"
    return None


def find_result_fault(detector: Detector, records: Records, result: object) -> str | None:
    """Name what is wrong with the value that `examine` returned; None if nothing is.

    An alarm whose p-value is above the rate that it states is a fault too.
    """
    if not isinstance(result, tuple) or len(result) != 2 or not isinstance(result[0], list):
        return f"examine gave {shorten(repr(type(result)))}, expected a list of Evidence and the state"
    kinds = (records.observations, records.taps, records.vector_taps, records.ccaf, records.array_phases)
    signals = {SignalRef(item.receiver, signal) for kind in kinds for item in kind for signal in item.signals}
    return next((fault for item in result[0] if (fault := _find_evidence_fault(detector, item, signals))), None)


def _find_evidence_fault(detector: Detector, item: Any, signals: set[SignalRef]) -> str | None:
    if not isinstance(item, Evidence | Finding):
        return f"a {type(item).__name__} among what it gave, expected Evidence"
    if item.detector != detector.name:
        return f"detector is {item.detector!r}, expected its own name, {detector.name!r}"
    if isinstance(item, Finding):
        return _find_finding_fault(item, signals)
    if item.says not in get_args(Says):
        return f"says is {item.says!r}, expected one of {', '.join(get_args(Says))}"
    if not isinstance(item.subject, tuple) or not set(item.subject) <= signals:
        return "subject is not a tuple of SignalRef of the window's signals"
    if not isinstance(item.because, str) or not item.because:
        return f"because is {item.because!r}, expected the reason in words"
    if not isinstance(item.assumes, tuple) or not all(isinstance(line, str) for line in item.assumes):
        return f"assumes is {item.assumes!r}, expected a tuple of sentences"
    for name in ("p_value", "false_alarm_probability"):
        value = getattr(item, name)
        if value is not None and not (isfinite(value) and 0.0 <= value <= 1.0):
            return f"{name} is {value}, expected 0 to 1"
    p, asked = item.p_value, item.false_alarm_probability
    if item.says in ("spoofed", "attack") and p is not None and asked is not None and p > asked * (1.0 + 1e-9):
        return f"says {item.says!r} at p = {p:.3g}, above the false_alarm_probability of {asked:.3g} that it states"
    return None


def _find_finding_fault(finding: Finding, signals: set[SignalRef]) -> str | None:
    if not isinstance(finding.signals, tuple) or not set(finding.signals) <= signals:
        return "signals is not a tuple of SignalRef of the window's signals"
    if not isinstance(finding.code, str) or not finding.code:
        return f"code is {finding.code!r}, expected a short name"
    if finding.p and not {Cause.CLEAN, Cause.FALSE_SKY} & finding.p.keys():
        return f"p is of {', '.join(finding.p)}, expected one of clean or of false_sky beside"
    for cause, p in finding.p.items():
        if not (isfinite(p) and 0.0 <= p <= 1.0):
            return f"p of {cause} is {p}, expected 0 to 1"
    least = finding.p.get(Cause.CLEAN, 0.0)
    for cause, p in finding.p.items():
        if p < least:
            return f"p of {cause} is {p:.3g}, less than {least:.3g} of clean, which is a case of it"
    if finding.p and (finding.alpha is None or not 0.0 < finding.alpha <= 1.0):
        return f"alpha is {finding.alpha}, expected more than 0 and at most 1"
    return None


class _Faulty(Exception):
    """What a detector of another package gave cannot be used."""


def examine_window(detector: Detector, records: Records, state: Any) -> tuple[list[Finding], Any]:
    """Examine a window with a detector; return its findings and its state.

    A detector of another package that fails is undecided for that window, names the reason, and continues with the
    next. A fault in one of ours is a fault of skyproof, and is raised.
    """
    if is_ours(detector):
        found, state = detector.examine(records, state)
        return _adapt_all(found), state
    try:
        result = detector.examine(records, state)
        if fault := find_result_fault(detector, records, result):
            raise _Faulty(fault)
    except Exception as error:
        return [_report_failure(detector, records, "failed", error)], state
    return _adapt_all(result[0]), result[1]


def _adapt_all(found: Iterable[AnyFinding]) -> list[Finding]:
    return [finding_from_evidence(e) if isinstance(e, Evidence) else e for e in found]


def review_evidence(detector: Detector, evidence: Sequence[Finding]) -> Iterable[Finding]:
    """Request a detector's review of all evidence at the end of a run, if it has one.

    A detector of another package may change its own evidence and nothing else. If it fails, all evidence stays as it
    was, with one more piece that reports the failure.
    """
    review = getattr(detector, "review", None)
    if review is None or not evidence:
        return evidence
    if is_ours(detector):
        seen: Iterable[Finding] = review(evidence)
        return seen
    try:
        before = restore(evidence, detector.name)
        after = list(review(before))
        if fault := _find_review_fault(detector, evidence, after):
            raise _Faulty(fault)
    except Exception as error:
        last = Records(start_gpst=evidence[-1].start_gpst, end_gpst=evidence[-1].end_gpst)
        return [*evidence, _report_failure(detector, last, "review_failed", error)]
    changed = _adapt_all(after)
    return [new if old.detector == detector.name else old for old, new in zip(evidence, changed, strict=True)]


def _report_failure(detector: Detector, records: Records, code: str, error: Exception) -> Finding:
    """Return that a detector of another package failed, and how."""
    data = {"detector": detector.name, "module": type(detector).__module__, "error": _describe_error(error)}
    reporter = Reporter(detector, records, Hypothesis.ONE_POSITION)
    return reporter.pass_over(signals_of(records.observations), NotTested(code, data))


def _find_review_fault(detector: Detector, evidence: Sequence[AnyFinding], after: Sequence[Any]) -> str | None:
    """Name what is wrong with what `review` returned; None if nothing is."""
    if len(after) != len(evidence):
        return f"it gave {len(after)} of {len(evidence)} pieces of evidence, expected each once, in their order"
    pairs = [(old, new) for old, new in zip(evidence, after, strict=True) if old.detector == detector.name]
    return next(
        (fault for old, new in pairs if (fault := _find_evidence_fault(detector, new, set(get_signals(old))))), None
    )


def _describe_error(error: Exception) -> str:
    """Name an error and its place in one line."""
    text = shorten(make_readable(" ".join(str(error).split())), _LONGEST)
    if isinstance(error, _Faulty):
        return text
    frames = traceback.extract_tb(error.__traceback__)
    inside = frames and frames[-1].filename != __file__
    at = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if inside else ""
    return f"{type(error).__name__}: {text}{at}"
