"""How detectors are found, and what is held of those of other packages: a fault of theirs costs nobody a run."""

import traceback
from collections.abc import Callable, Iterable, Sequence
from dataclasses import fields, is_dataclass
from importlib.metadata import EntryPoint
from math import isfinite
from pathlib import Path
from typing import Any, Final, get_args

from skyproof.detectors.adapter import adapt, get_signals, restore
from skyproof.detectors.base import Detector, NotTested, Reporter, signals_of
from skyproof.detectors.entries import OURS, package_of, registered
from skyproof.errors import SettingsError, readable, shortened
from skyproof.records import AnyFinding, Cause, Evidence, Finding, Hypothesis, Need, Records, Says, SignalRef

__all__ = ["evidence_fault", "examined", "instantiate", "is_ours", "load_detectors", "review_of"]

_LONGEST: Final = 300


def load_detectors() -> dict[str, type[Detector]]:
    """The installed detectors by name, ours and others', in order of name.

    Raises
    ------
    SettingsError : a registered detector cannot be imported or made, is none, or has the name of another; the message
        says from which package and why.
    """
    found: dict[str, type[Detector]] = {}
    packages: dict[str, str] = {}
    for point in registered():
        package = package_of(point)
        if point.name in found:
            raise SettingsError(
                f"detector {point.name!r} is registered twice, by {packages[point.name]} and by {package}; "
                "rename one, or uninstall one of the packages"
            )
        found[point.name], packages[point.name] = _loaded(point, package), package
    return found


def is_ours(detector: Detector) -> bool:
    """Whether a fault in it is one of skyproof."""
    return type(detector).__module__.partition(".")[0] == OURS


def instantiate(kind: type[Detector], settings: Any) -> Detector:
    """A detector with these settings.

    Raises
    ------
    SettingsError : it does not take them.
    """
    made: Callable[..., Detector] = kind
    try:
        return made(settings=settings)
    except Exception as error:
        raise SettingsError(
            f"detector {kind.__name__} of {kind.__module__} cannot be made with settings=...: {_words(error)}; "
            "repair or uninstall its package"
        ) from error


def _loaded(point: EntryPoint, package: str) -> type[Detector]:
    """Raises SettingsError if it is no detector of this name."""
    try:
        kind = point.load()
        fault = _fault(kind(), point.name)
    except Exception as error:
        raise SettingsError(
            f"detector {point.name!r} of {package} cannot be loaded from {point.value}: {_words(error)}; "
            "repair or uninstall that package"
        ) from error
    if fault:
        raise SettingsError(
            f"detector {point.name!r} of {package}, {point.value}: {fault}; repair or uninstall that package"
        )
    loaded: type[Detector] = kind
    return loaded


def _fault(made: Any, name: str) -> str | None:
    """What is wrong with how a detector declares itself."""
    lacking = [one for one in ("name", "needs", "settings", "examine") if not hasattr(made, one)]
    if lacking:
        return f"it has no {' and no '.join(lacking)}"
    if made.name != name:
        return f"its name is {made.name!r}, expected {name!r} as it is registered"
    if not isinstance(made.needs, tuple) or not all(isinstance(need, Need) for need in made.needs):
        return f"its needs are {shortened(str(made.needs))}, expected a tuple of members of skyproof.records.Need"
    settings = made.settings
    if not is_dataclass(settings) or "false_alarm_probability" not in {f.name for f in fields(settings)}:
        return "its settings are no dataclass with a field false_alarm_probability"
    return None


def evidence_fault(detector: Detector, records: Records, said: object) -> str | None:
    """What is wrong with the value that `examine` gave, in words; None if nothing is.

    An alarm whose p-value is above the rate that it states is a fault too.
    """
    if not isinstance(said, tuple) or len(said) != 2 or not isinstance(said[0], list):
        return f"examine gave {shortened(repr(type(said)))}, expected a list of Evidence and the state"
    kinds = (records.observations, records.taps, records.vector_taps, records.ccaf, records.array_phases)
    there = {SignalRef(one.receiver, signal) for kind in kinds for one in kind for signal in one.signals}
    return next((fault for one in said[0] if (fault := _evidence_fault(detector, one, there))), None)


def _evidence_fault(detector: Detector, one: Any, there: set[SignalRef]) -> str | None:
    if not isinstance(one, Evidence | Finding):
        return f"a {type(one).__name__} among what it gave, expected Evidence"
    if one.detector != detector.name:
        return f"detector is {one.detector!r}, expected its own name, {detector.name!r}"
    if isinstance(one, Finding):
        return _finding_fault(one, there)
    if one.says not in get_args(Says):
        return f"says is {one.says!r}, expected one of {', '.join(get_args(Says))}"
    if not isinstance(one.subject, tuple) or not set(one.subject) <= there:
        return "subject is not a tuple of SignalRef of the window's signals"
    if not isinstance(one.because, str) or not one.because:
        return f"because is {one.because!r}, expected the reason in words"
    if not isinstance(one.assumes, tuple) or not all(isinstance(line, str) for line in one.assumes):
        return f"assumes is {one.assumes!r}, expected a tuple of sentences"
    for name in ("p_value", "false_alarm_probability"):
        value = getattr(one, name)
        if value is not None and not (isfinite(value) and 0.0 <= value <= 1.0):
            return f"{name} is {value}, expected 0 to 1"
    p, asked = one.p_value, one.false_alarm_probability
    if one.says in ("spoofed", "attack") and p is not None and asked is not None and p > asked * (1.0 + 1e-9):
        return f"says {one.says!r} at p = {p:.3g}, above the false_alarm_probability of {asked:.3g} that it states"
    return None


def _finding_fault(one: Finding, there: set[SignalRef]) -> str | None:
    if not isinstance(one.signals, tuple) or not set(one.signals) <= there:
        return "signals is not a tuple of SignalRef of the window's signals"
    if not isinstance(one.code, str) or not one.code:
        return f"code is {one.code!r}, expected a short name"
    if one.p and not {Cause.CLEAN, Cause.FALSE_SKY} & one.p.keys():
        return f"p is of {', '.join(one.p)}, expected one of clean or of false_sky beside"
    for cause, p in one.p.items():
        if not (isfinite(p) and 0.0 <= p <= 1.0):
            return f"p of {cause} is {p}, expected 0 to 1"
    least = one.p.get(Cause.CLEAN, 0.0)
    for cause, p in one.p.items():
        if p < least:
            return f"p of {cause} is {p:.3g}, less than {least:.3g} of clean, which is a case of it"
    if one.p and (one.alpha is None or not 0.0 < one.alpha <= 1.0):
        return f"alpha is {one.alpha}, expected more than 0 and at most 1"
    return None


class _Faulty(Exception):
    """What a detector of another package gave cannot be used."""


def examined(detector: Detector, records: Records, state: Any) -> tuple[list[Finding], Any]:
    """What a detector says of a window, and what it remembers.

    One of another package that fails is undecided of that window, says why, and goes on with the next: a fault in one
    of ours is one of skyproof's, and is raised.
    """
    if is_ours(detector):
        found, state = detector.examine(records, state)
        return _adapt_all(found), state
    try:
        said = detector.examine(records, state)
        if fault := evidence_fault(detector, records, said):
            raise _Faulty(fault)
    except Exception as error:
        return [_report_failure(detector, records, "failed", error)], state
    return _adapt_all(said[0]), said[1]


def _adapt_all(found: Iterable[AnyFinding]) -> list[Finding]:
    return [adapt(e) if isinstance(e, Evidence) else e for e in found]


def review_of(detector: Detector, evidence: Sequence[Finding]) -> Iterable[Finding]:
    """The evidence after a detector looked at all of it once more, if it does.

    One of another package changes what it said itself and nothing else. Where that fails as above, all stays as it was,
    with one more that says so.
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
        if fault := _review_fault(detector, evidence, after):
            raise _Faulty(fault)
    except Exception as error:
        last = Records(start_gpst=evidence[-1].start_gpst, end_gpst=evidence[-1].end_gpst)
        return [*evidence, _report_failure(detector, last, "review_failed", error)]
    changed = _adapt_all(after)
    return [new if old.detector == detector.name else old for old, new in zip(evidence, changed, strict=True)]


def _report_failure(detector: Detector, records: Records, code: str, error: Exception) -> Finding:
    """Return that a detector of another package failed, and how."""
    data = {"detector": detector.name, "module": type(detector).__module__, "error": _words(error)}
    reporter = Reporter(detector, records, Hypothesis.ONE_POSITION)
    return reporter.pass_over(signals_of(records.observations), NotTested(code, data))


def _review_fault(detector: Detector, evidence: Sequence[AnyFinding], after: Sequence[Any]) -> str | None:
    """What is wrong with what `review` gave, in words; None if nothing is."""
    if len(after) != len(evidence):
        return f"it gave {len(after)} of {len(evidence)} pieces of evidence, expected each once, in their order"
    own = [(old, new) for old, new in zip(evidence, after, strict=True) if old.detector == detector.name]
    return next((fault for old, new in own if (fault := _evidence_fault(detector, new, set(get_signals(old))))), None)


def _words(error: Exception) -> str:
    """Which error and where, in a line."""
    text = shortened(readable(" ".join(str(error).split())), _LONGEST)
    if isinstance(error, _Faulty):
        return text
    frames = traceback.extract_tb(error.__traceback__)
    inside = frames and frames[-1].filename != __file__
    at = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if inside else ""
    return f"{type(error).__name__}: {text}{at}"
