"""What each detector's evidence comes to over a run, in one pass."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from skyproof.explain import explain, stands_beside
from skyproof.gnss.time import format_iso
from skyproof.records import Finding
from skyproof.verdict import Method

__all__ = ["OfDetector", "count_by_detector"]

STRENGTH: Final = ("undecided", "clean", "multipath", "authentic", "failed", "attack", "spoofed")
"""What a test says, the stronger the later. A failed test outranks passed ones: it is what a reader must not miss."""


@dataclass(kw_only=True)
class OfDetector:
    """Count one detector's evidence, as far as it was read.

    first : piece of all. tests : pieces with a p-value. telling : of each word the piece with the least p-value.
    reasons : of pieces that decide nothing, by their code: how many, and the first.
    """

    first: Finding
    tests: int = 0
    telling: dict[str, Finding] = field(default_factory=dict)
    reasons: dict[str, tuple[int, Finding]] = field(default_factory=dict)

    def add(self, e: Finding) -> None:
        """Add one more piece."""
        if e.p_value is None and e.says == "undecided":
            if stands_beside(e) and explain(e).remedy is None:
                return  # a remark on the input
            count, first = self.reasons.get(e.code, (0, e))
            self.reasons[e.code] = count + 1, first
        remark = stands_beside(e) and e.says == "clean"
        if e.p_value is None and (e.says == "undecided" or remark):
            return
        self.tests += e.p_value is not None
        word = "failed" if e.failed else e.says
        known = self.telling.get(word)
        if known is None or _get_p_value(e) < _get_p_value(known):
            self.telling[word] = e

    @property
    def decision(self) -> str | None:
        """Return the strongest word of all pieces; None where no test was made."""
        return max(self.telling, key=STRENGTH.index, default=None)

    @property
    def most_telling(self) -> Finding | None:
        """Return the piece with the least p-value behind the decision; None without any."""
        return None if self.decision is None else self.telling[self.decision]

    @property
    def reason(self) -> Finding | None:
        """Return the piece with the most frequent reason for deciding nothing; None where all are tests."""
        return max(self.reasons.values(), key=lambda counted: counted[0], default=(0, None))[1]

    def method(self) -> Method:
        """Return what `verdict.json` says of the detector."""
        telling = self.most_telling
        asked = self.first if telling is None else telling
        return Method(
            detector=self.first.detector,
            ran=telling is not None,
            why_not=None if telling is not None else explain(self.reason or self.first).sentence,
            would_need=self._suggest_remedy(),
            decision=self.decision,
            tests=self.tests,
            from_gpst=None if telling is None else _instant(telling.start_gpst),
            to_gpst=None if telling is None else _instant(telling.end_gpst),
            statistic=None if telling is None else telling.statistic,
            threshold=None if telling is None else telling.threshold,
            p_value=None if telling is None else telling.p_value,
            false_alarm_probability=asked.alpha,
        )

    def _suggest_remedy(self) -> str | None:
        """Describe what would decide: by the telling piece, else by what is open beside the word."""
        pieces = [self.most_telling]
        if self.decision not in ("authentic", "spoofed", "multipath"):
            pieces += [self.telling.get("undecided"), self.reason]
        remedies = (explain(e).remedy for e in pieces if e is not None)
        return next((remedy for remedy in remedies if remedy is not None), None)


def count_by_detector(evidence: Iterable[Finding]) -> tuple[OfDetector, ...]:
    """Count the evidence of each detector, in the order of their names."""
    found: dict[str, OfDetector] = {}
    for e in evidence:
        found.setdefault(e.detector, OfDetector(first=e)).add(e)
    return tuple(found[name] for name in sorted(found))


def _get_p_value(e: Finding) -> float:
    """Return its p-value, or infinity where none is stated."""
    return np.inf if e.p_value is None else e.p_value


def _instant(gpst: np.datetime64) -> str | None:
    return None if np.isnat(gpst) else format_iso(gpst)
