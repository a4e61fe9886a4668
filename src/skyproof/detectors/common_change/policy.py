"""Numbers by which the test for common changes decides."""

from dataclasses import dataclass
from typing import Final

from skyproof.records.policy import number

__all__ = ["POLICY", "CommonChangePolicy"]


@dataclass(frozen=True)
class CommonChangePolicy:
    """Numbers by which the test for common changes decides, each with its reason."""

    spans_s: tuple[float, ...] = number((10.0, 30.0), "s", "Over which code is held against carrier.")
    turns_s: tuple[float, ...] = number(
        (5.0, 10.0), "s", "From the first of three epochs to the second, and from there to the third."
    )
    levels_s: float = number(60.0, "s", "For so long levels are remembered.")
    overlap_share: float = number(
        0.1, "1", "A span may share so much with that of a reference: windows end between epochs."
    )
    parting_share: float = number(
        0.75,
        "1",
        "Of the satellites that have to part alike: the others may have slipped, or have a reflection of their own.",
    )
    whole_span_share: float = number(0.75, "1", "A run of a satellite that is a shorter part of a span gives no rate.")
    jump_m: float = number(
        100.0, "m", "Between epochs: no rate of code against carrier, but a slip that nobody reported."
    )
    gap_intervals: float = number(1.5, "1", "A pause of more usual intervals breaks a run.")
    even_share: float = number(0.02, "1", "The two times of a turn may differ by so much.")


POLICY: Final = CommonChangePolicy()
