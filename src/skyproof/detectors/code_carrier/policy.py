"""Numbers by which the comparison of code with carrier decides."""

from dataclasses import dataclass
from typing import Final

from skyproof.detectors.policy import policy_field

__all__ = ["POLICY", "CodeCarrierPolicy"]


@dataclass(frozen=True)
class CodeCarrierPolicy:
    """Numbers by which the comparison of code with carrier decides, each with its reason."""

    remembered_s: float = policy_field(
        120.0,
        unit="s",
        reason=("A drag of metres a second shows within two minutes; the ionosphere parts codes by little meanwhile."),
    )
    remembered_epochs: int = policy_field(
        512,
        unit="1",
        reason="Bounds what is remembered of fast receivers.",
    )
    broken_intervals: float = policy_field(
        2.5,
        unit="1",
        reason="A pause of more usual intervals breaks a stretch.",
    )
    least_signals: int = policy_field(
        4,
        unit="1",
        reason="That have a step at one epoch, for its median to be that of all.",
    )
    ionosphere_sigma_m_s: float = policy_field(
        0.06,
        unit="m/s",
        reason="The ionosphere parts code from carrier no faster, storms included.",
    )
    least_epochs: int = policy_field(
        8,
        unit="1",
        reason="Two epochs a quarter.",
    )
    reflected_chips: float = policy_field(
        0.25,
        unit="chip",
        reason=("A reflection that comes or goes draws a code off by half of the half chip from early to late."),
    )


POLICY: Final = CodeCarrierPolicy()
