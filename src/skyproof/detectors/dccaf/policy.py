"""Numbers by which the decomposition of correlation grids decides."""

from dataclasses import dataclass
from typing import Final

from skyproof.records.policy import number

__all__ = ["POLICY", "DccafPolicy"]


@dataclass(frozen=True)
class DccafPolicy:
    """Numbers by which the decomposition of correlation grids decides, each with its reason."""

    reflected_weaker_db: float = number(
        3.0, "dB", "A wall takes at least so much of a circular wave, so that a reflection is weaker."
    )
    apart_sigmas: float = number(
        3.0,
        "sigma",
        "Two delays whose difference is smaller may be two sides of one peak, with amplitudes that cancel.",
    )
    signal_probability: float = number(
        1e-4, "1", "Chosen: a satellite shows a second signal that no reflection explains by chance so rarely."
    )
    most_condition: float = number(
        1e3, "1", "Chosen: eight unknowns, or four satellites, that a thousandth of an error leaves open are not known."
    )
    sky_satellites: int = number(5, "1", "Four ranges fit any position: five test it.", "Kaplan & Hegarty, 2.5.2")
    least_satellites: int = number(5, "1", "Four ranges fit any position: five test it.", "Kaplan & Hegarty, 2.5.2")


POLICY: Final = DccafPolicy()
