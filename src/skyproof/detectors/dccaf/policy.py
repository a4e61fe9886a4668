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
        1e-4, "1", "A satellite counts as having a second signal that no reflection explains so often by chance."
    )
    sky_satellites: int = number(5, "1", "Ranges of four satellites fit any position.")
    least_satellites: int = number(5, "1", "Ranges of four satellites fit any position.")


POLICY: Final = DccafPolicy()
