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
    remembered_epochs: int = number(512, "1", "Bounds what is remembered of fast receivers.")
    broken_intervals: float = number(2.5, "1", "A pause of more usual intervals breaks a stretch.")
    least_signals: int = number(4, "1", "That have a step at one epoch, for its median to be that of all.")
    ionosphere_sigma_m_s: float = number(
        0.06, "m/s", "The ionosphere parts code from carrier no faster, storms included."
    )
    least_epochs: int = number(8, "1", "Two epochs a quarter.")
    reflected_chips: float = number(
        0.25, "chip", "A reflection that comes or goes draws a code off by half of the half chip from early to late."
    )


POLICY: Final = CodeCarrierPolicy()
