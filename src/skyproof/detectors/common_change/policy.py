"""Numbers by which the test for common changes decides."""

from dataclasses import dataclass
from typing import Final

from skyproof.detectors.policy import policy_field

__all__ = ["POLICY", "CommonChangePolicy"]


@dataclass(frozen=True)
class CommonChangePolicy:
    """Numbers by which the test for common changes decides, each with its reason."""

    spans_s: tuple[float, ...] = policy_field(
        (10.0, 30.0),
        unit="s",
        reason="Over which code is held against carrier.",
    )
    turns_s: tuple[float, ...] = policy_field(
        (5.0, 10.0),
        unit="s",
        reason="From the first of three epochs to the second, and from there to the third.",
    )
    levels_s: float = policy_field(
        60.0,
        unit="s",
        reason="For so long levels are remembered.",
    )
    overlap_share: float = policy_field(
        0.1,
        unit="1",
        reason="A span may share so much with that of a reference: windows end between epochs.",
    )
    parting_share: float = policy_field(
        0.75,
        unit="1",
        reason=(
            "Of the satellites that have to part alike: the others may have slipped, or have a reflection of their own."
        ),
    )
    whole_span_share: float = policy_field(
        0.75,
        unit="1",
        reason="A run of a satellite that is a shorter part of a span gives no rate.",
    )
    jump_m: float = policy_field(
        100.0,
        unit="m",
        reason="Between epochs: no rate of code against carrier, but a slip that nobody reported.",
    )
    gap_intervals: float = policy_field(
        1.5,
        unit="1",
        reason="A pause of more usual intervals breaks a run.",
    )
    even_share: float = policy_field(
        0.02,
        unit="1",
        reason="The two times of a turn may differ by so much.",
    )


POLICY: Final = CommonChangePolicy()
