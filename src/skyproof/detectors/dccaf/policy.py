"""Numbers by which the decomposition of correlation grids decides."""

from dataclasses import dataclass
from typing import Final

from skyproof.detectors.policy import policy_field

__all__ = ["POLICY", "DccafPolicy"]


@dataclass(frozen=True)
class DccafPolicy:
    """Numbers by which the decomposition of correlation grids decides, each with its reason."""

    reflected_weaker_db: float = policy_field(
        3.0,
        unit="dB",
        reason="A wall takes at least so much of a circular wave, so that a reflection is weaker.",
    )
    apart_sigmas: float = policy_field(
        3.0,
        unit="sigma",
        reason=("Two delays whose difference is smaller may be two sides of one peak, with amplitudes that cancel."),
    )
    signal_probability: float = policy_field(
        1e-4,
        unit="1",
        reason="A satellite counts as having a second signal that no reflection explains so often by chance.",
    )
    sky_satellites: int = policy_field(
        5,
        unit="1",
        reason="Ranges of four satellites fit any position.",
    )
    least_satellites: int = policy_field(
        5,
        unit="1",
        reason="Ranges of four satellites fit any position.",
    )


POLICY: Final = DccafPolicy()
