"""What the tests of a run would have noticed: of each kind of attack, the size from which on."""

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from skyproof.records import Finding, NoticedKind
from skyproof.verdict import NoticedSize

__all__ = ["noticed_sizes"]

_UNITS: Final[dict[NoticedKind, str]] = {"position_jump": "m", "clock_jump": "s", "code_drag": "m/s", "motion": "m/s"}
_KINDS: Final = tuple(_UNITS)


def noticed_sizes(findings: Sequence[Finding]) -> Iterator[NoticedSize]:
    """Yield of each receiver and kind of attack the size that the best test of any window would have noticed.

    A window of which no test gives a size counts as one in which the attack would have passed.
    """
    best: dict[tuple[str, NoticedKind], dict[np.datetime64, tuple[float, str]]] = {}
    windows: dict[str, set[np.datetime64]] = {}
    for finding in findings:
        for receiver in {ref.receiver for ref in finding.signals}:
            windows.setdefault(receiver, set()).add(finding.start_gpst)
            for attack in finding.noticed:
                of_kind = best.setdefault((receiver, attack.kind), {})
                found = attack.size, finding.detector
                of_kind[finding.start_gpst] = min(found, of_kind.get(finding.start_gpst, found))
    for (receiver, kind), of_kind in sorted(best.items(), key=lambda each: (each[0][0], _KINDS.index(each[0][1]))):
        size, detector = max(of_kind.values())
        share = len(of_kind) / len(windows[receiver])
        yield NoticedSize(
            receiver=receiver, kind=kind, size=size, unit=_UNITS[kind], detector=detector, share_of_windows=share
        )
