"""Numbers by which the comparison of code with carrier decides."""

from dataclasses import dataclass
from typing import Final

from skyproof.records.policy import number

__all__ = ["POLICY", "CodeCarrierPolicy"]


@dataclass(frozen=True)
class CodeCarrierPolicy:
    """Numbers by which the comparison of code with carrier decides, each with its reason."""

    remembered_s: float = number(
        120.0,
        "s",
        "A drag of metres a second shows within two minutes; the ionosphere parts codes by little meanwhile.",
    )
    remembered_epochs: int = number(
        512, "1", "More than four a second for all that is remembered; of faster receivers some are passed over."
    )
    broken_intervals: float = number(2.5, "1", "Two epochs that are missing make three intervals, and break a stretch.")
    least_signals: int = number(4, "1", "A median of four outvotes one signal that is wrong.")
    ionosphere_sigma_m_s: float = number(
        0.06, "m/s", "Assumed: the ionosphere parts code from carrier no faster, storms included."
    )
    least_epochs: int = number(
        8, "1", "Two epochs a quarter of a stretch, so that each quarter has a mean and a scatter."
    )
    reflected_chips: float = number(
        0.25,
        "chip",
        "A reflection that comes or goes draws a code off by half of the half chip from early to late.",
        "Kaplan & Hegarty, 9.5",
    )


POLICY: Final = CodeCarrierPolicy()
