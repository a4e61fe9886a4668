"""What stands in the tables of sentences, and how an entry and a finding become text."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from skyproof.records import Finding

__all__ = ["Entry", "Wording", "Words", "collect_fields", "fill", "join", "name_first"]

_NAMED: Final = 6
Words = str | Callable[[Finding], str | None]
"""A template with the fields of `collect_fields`, or a function of the finding where a template does not do."""


@dataclass(frozen=True)
class Entry:
    """The words for one code of a detector.

    sentence : what was found. remedy : what would let the test run, or decide; None if nothing would. beside : it
    stands beside the verdict, whatever that is, the first time that a receiver shows it.
    """

    sentence: Words
    remedy: Words | None = None
    beside: bool = False


@dataclass(frozen=True)
class Wording:
    """A finding in words: without capital and full stop, as it may stand within a sentence."""

    sentence: str
    remedy: str | None = None
    assumptions: tuple[str, ...] = ()


def collect_fields(finding: Finding) -> Mapping[str, Any]:
    """Return what a template may name: the finding's data, its receivers, its numbers of signals and satellites."""
    receivers = sorted({ref.receiver for ref in finding.signals})
    return {
        "receiver": join(receivers),
        "n_signals": len(finding.signals),
        "n_satellites": len({ref.signal.sat for ref in finding.signals}),
        **finding.data,
    }


def fill(words: Words, finding: Finding) -> str | None:
    """Return a template filled with the finding's fields, or what a function makes of the finding."""
    return words.format_map(collect_fields(finding)) if isinstance(words, str) else words(finding)


def join(names: "list[str] | tuple[str, ...]", last: str = "and") -> str:
    """Return names as a list in a sentence: "a", "a and b", "a, b and c"."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} {last} {names[-1]}" if names else ""


def name_first(names: Sequence[str]) -> str:
    """Return the first six names, and how many more there are."""
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more
