"""Numbers by which the test of carriers that break together decides."""

from dataclasses import dataclass
from typing import Final

from skyproof.records.policy import number

__all__ = ["POLICY", "CarrierBreakPolicy"]


@dataclass(frozen=True)
class CarrierBreakPolicy:
    """Numbers by which the test of carriers that break together decides, each with its reason."""

    least_signals: int = number(5, "1", "One common phase and four that may differ from it.")
    together_share: float = number(
        0.8, "1", "Of all carriers: reflections or shade break some, not nearly all at once."
    )
    longest_s: float = number(1.0, "s", "Over longer breaks Dopplers do not carry a phase to a tenth of a cycle.")
    carrier_error_cyc: float = number(
        0.02, "cycle", "Assumed: reflections and the air change a phase so little within a second, one sigma."
    )
    most_sigma_cyc: float = number(
        0.08, "cycle", "Three sigmas within half of the half cycle that bits leave open; else phases tell nothing."
    )
    beside_epochs: int = number(
        5, "1", "Before and after a break, without the epochs next to it, which may hold a part of it."
    )
    tail_epochs: int = number(10, "1", "Remembered of the window before, for a break at its end.")


POLICY: Final = CarrierBreakPolicy()
