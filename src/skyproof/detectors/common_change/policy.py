"""Numbers by which the test for common changes decides."""

from dataclasses import dataclass
from typing import Final

from skyproof.records.policy import number

__all__ = ["POLICY", "CommonChangePolicy"]


@dataclass(frozen=True)
class CommonChangePolicy:
    """Numbers by which the test for common changes decides, each with its reason."""

    spans_s: tuple[float, ...] = number(
        (10.0, 30.0),
        "s",
        "A drag of 1 m/s parts code from carrier by 10 m in the first, one of 0.3 m/s by 9 m in the second.",
    )
    turns_s: tuple[float, ...] = number(
        (5.0, 10.0),
        "s",
        "Half a usual window and a whole one, from the first of three epochs to the second and on to the third.",
    )
    overlap_share: float = number(
        0.1, "1", "A span may share so much with that of a reference: windows end between epochs."
    )
    parting_share: float = number(
        0.75, "1", "Of ten satellites two may have slipped or have reflections of their own; the others part alike."
    )
    whole_span_share: float = number(
        0.75, "1", "A rate over a shorter part of a span is a third noisier than its law says."
    )
    jump_m: float = number(
        100.0, "m", "A third of a chip: no loop that tracks parts code from carrier by so much between two epochs."
    )
    gap_intervals: float = number(1.5, "1", "Halfway to one epoch that is missing: a longer pause breaks a run.")
    even_share: float = number(0.02, "1", "The two times of a turn may differ by so much.")


POLICY: Final = CommonChangePolicy()
