"""What the tests of a run would have noticed: of each kind of attack, the size from which on."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from skyproof.records import Finding, NoticedKind
from skyproof.verdict import NoticedSize

__all__ = ["TestedWindows", "collect_tested_windows", "list_noticed_sizes"]

_UNITS: Final[dict[NoticedKind, str]] = {
    "position_jump": "m",
    "clock_jump": "s",
    "velocity_jump": "m/s",
    "clock_push": "s/s",
    "code_drag": "m/s",
    "motion": "m/s",
    "drag": "m/s",
    "displacement": "m",
    "one_transmitter": "1",
    "elsewhere": "rad",
}
_KINDS: Final = tuple(_UNITS)


@dataclass(frozen=True, eq=False)
class TestedWindows:
    """Windows of each receiver, start to end; and of each receiver and kind of attack the size that the best test of a
    window would have noticed, with the test's detector, by the window's start."""

    ends: dict[str, dict[np.datetime64, np.datetime64]]
    best: dict[tuple[str, NoticedKind], dict[np.datetime64, tuple[float, str]]]


def collect_tested_windows(findings: Iterable[Finding]) -> TestedWindows:
    """Collect what the tests of all windows would have noticed."""
    found = TestedWindows({}, {})
    for finding in findings:
        start, end = finding.start_gpst, finding.end_gpst
        for receiver in {ref.receiver for ref in finding.signals}:
            ends = found.ends.setdefault(receiver, {})
            ends[start] = max(end, ends.get(start, end))
            for attack in finding.noticed:
                best = found.best.setdefault((receiver, attack.kind), {})
                size = attack.size, finding.detector
                best[start] = min(size, best.get(start, size))
    return found


def list_noticed_sizes(findings: Iterable[Finding]) -> Iterator[NoticedSize]:
    """Yield the size of each kind of attack that the best test of any window would notice.

    A window in which no test gives a size counts as one in which the attack would have passed.
    """
    windows = collect_tested_windows(findings)
    for (receiver, kind), best in sorted(windows.best.items(), key=lambda each: (each[0][0], _KINDS.index(each[0][1]))):
        size, detector = max(best.values())
        share = len(best) / len(windows.ends[receiver])
        yield NoticedSize(
            receiver=receiver, kind=kind, size=size, unit=_UNITS[kind], detector=detector, share_of_windows=share
        )
