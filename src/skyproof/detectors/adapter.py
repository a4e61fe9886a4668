"""The contract of detectors before findings: `Evidence` with a word and a sentence, taken over as a `Finding`.

A package's own detector of that contract works until skyproof 0.3, in which this module and `Evidence` end.
"""

from collections.abc import Sequence
from math import nextafter
from typing import Any

from skyproof.records import UNTESTED, AnyFinding, Cause, Evidence, Finding, Hypothesis, SignalRef

__all__ = ["finding_from_evidence", "get_signals", "restore"]

_FAILED: tuple[Cause, ...] = (Cause.FAULT,)
"""Benign cause of a failed test that names none."""


def finding_from_evidence(evidence: Evidence) -> Finding:
    """Convert evidence to a finding that states the same.

    Where no p-value is stated, the rate that the evidence states bounds it.
    """
    data: dict[str, Any] = {"because": evidence.because, "would_need": evidence.would_need, "beside": evidence.noted}
    data |= {"words_assumed": evidence.assumes, "whole_sky": evidence.whole_sky}
    numbers = ("statistic", "threshold", "log_likelihood_ratio", "group")
    data |= {name: value for name in numbers if (value := getattr(evidence, name)) is not None}
    data |= {"lacking": tuple(map(str, evidence.lacking))} if evidence.lacking else {}
    estimates = {
        "evidence": evidence,
        "directions": evidence.directions,
        "baselines": evidence.baselines,
        "overlapping": evidence.overlapping,
        "interference": evidence.interference,
        "statement": evidence.statement,
        "wrong_statements": evidence.wrong_statements,
    }
    hypothesis, p, alpha = _find_p_values(evidence)
    return Finding(
        detector=evidence.detector,
        start_gpst=evidence.start_gpst,
        end_gpst=evidence.end_gpst,
        signals=evidence.subject,
        hypothesis=hypothesis,
        code=evidence.code or evidence.says,
        p=p,
        alpha=alpha,
        singled_out=evidence.says in ("spoofed", "multipath"),
        estimates=estimates,
        data=data,
        dated_gpst=evidence.dated_gpst,
    )


def restore(findings: Sequence[AnyFinding], detector: str) -> list[AnyFinding]:
    """Return findings with a detector's own evidence in the form in which it gave it, for its `review`."""
    return [
        e.estimates["evidence"]
        if isinstance(e, Finding) and e.detector == detector and "evidence" in e.estimates
        else e
        for e in findings
    ]


def get_signals(finding: AnyFinding) -> tuple[SignalRef, ...]:
    """Return the signals of a finding, or of evidence."""
    return finding.signals if isinstance(finding, Finding) else finding.subject


def _find_p_values(evidence: Evidence) -> tuple[Hypothesis, dict[Cause, float], float | None]:
    """Return the null, the p-values and their limit that give the evidence's word."""
    stated, p_value = evidence.false_alarm_probability, evidence.p_value
    alpha = 1.0 if stated is None else stated
    below = nextafter(alpha, 0.0) if p_value is None else min(p_value, nextafter(alpha, 0.0))
    sky = Hypothesis.CONTINUOUS if evidence.overrules else Hypothesis.ONE_POSITION
    if evidence.says == "authentic":
        return Hypothesis.ONE_ANTENNA, {Cause.FALSE_SKY: below}, alpha
    if evidence.says in ("spoofed", "attack"):
        return sky, {Cause.CLEAN: below}, alpha
    if evidence.says == "multipath":
        return sky, {Cause.CLEAN: below, Cause.REFLECTIONS: UNTESTED}, alpha
    if p_value is None:
        return sky, {}, stated
    if evidence.null == "one antenna":
        return Hypothesis.ONE_ANTENNA, {Cause.FALSE_SKY: max(p_value, alpha)}, alpha
    if evidence.failed:
        causes = tuple(Cause(name) for name in evidence.may_also_be) or _FAILED
        return sky, {Cause.CLEAN: p_value, **dict.fromkeys(causes, UNTESTED)}, alpha
    return sky, {Cause.CLEAN: p_value if stated is None else max(p_value, stated)}, stated
