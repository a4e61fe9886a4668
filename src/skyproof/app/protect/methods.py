"""What each detector's evidence comes to over a run, in one pass."""

from collections.abc import Iterable
from dataclasses import dataclass, field

from skyproof.records import Evidence, Says
from skyproof.verdict import Method

__all__ = ["OfDetector", "of_detectors"]

STRENGTH: tuple[Says, ...] = ("undecided", "clean", "multipath", "authentic", "attack", "spoofed")


@dataclass(kw_only=True)
class OfDetector:
    """One detector's evidence, as far as it was read.

    first : piece of all; undecided : first that is. always_needs : whether each piece says what it would need. tests :
    pieces with a p-value. best : of these the least p-value, of each word and under None of all.
    """

    first: Evidence
    decision: Says = "undecided"
    undecided: Evidence | None = None
    always_needs: bool = True
    tests: int = 0
    best: dict[Says | None, Evidence] = field(default_factory=dict)

    def add(self, e: Evidence) -> None:
        """One more piece."""
        self.decision = max(self.decision, e.says, key=STRENGTH.index)
        self.always_needs &= e.would_need is not None
        if e.says == "undecided" and self.undecided is None:
            self.undecided = e
        if e.p_value is None:
            return
        self.tests += 1
        for word in (e.says, None):
            known = self.best.get(word)
            if known is None or known.p_value is None or e.p_value < known.p_value:
                self.best[word] = e

    @property
    def telling(self) -> Evidence | None:
        """The piece that says most: the least p-value behind the decision; None without any."""
        return self.best.get(self.decision, self.best.get(None))

    def method(self) -> Method:
        """As the verdict has it."""
        best, undecided = self.telling, self.undecided
        is_open = undecided is not None and self.decision in ("undecided", "clean", "attack")
        return Method(
            detector=self.first.detector,
            ran=self.tests > 0 or not self.always_needs,
            why_not=None if self.tests or undecided is None else undecided.because,
            would_need=undecided.would_need if is_open and undecided is not None else None,
            decision=self.decision if self.tests else None,
            tests=self.tests,
            statistic=None if best is None else best.statistic,
            threshold=None if best is None else best.threshold,
            p_value=None if best is None else best.p_value,
            false_alarm_probability=self.first.false_alarm_probability,
        )


def of_detectors(evidence: Iterable[Evidence]) -> tuple[OfDetector, ...]:
    """Of each detector, in the order of their names."""
    found: dict[str, OfDetector] = {}
    for e in evidence:
        found.setdefault(e.detector, OfDetector(first=e)).add(e)
    return tuple(found[name] for name in sorted(found))
