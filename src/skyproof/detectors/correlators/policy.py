"""Numbers by which the tests of correlators decide."""

from dataclasses import dataclass
from typing import Final

from skyproof.detectors.policy import policy_field

__all__ = ["POLICY", "CorrelatorPolicy"]


@dataclass(frozen=True)
class CorrelatorPolicy:
    """Numbers by which the tests of correlators decide, each with its reason."""

    fastest_loop_hz: float = policy_field(
        2.0,
        unit="Hz",
        reason=(
            "Above, a code loop of about a hertz does not follow, so the tracked signal stays where it is in the taps."
        ),
    )
    line_half_width_hz: float = policy_field(
        1.0,
        unit="Hz",
        reason="A line may spread so far to either side of a bin.",
    )
    shape_error_share: float = policy_field(
        0.1,
        unit="1",
        reason="Triangles may miss so much of the power of a line, where a front end rounds the correlation.",
    )
    longest_line_s: float = policy_field(
        10.0,
        unit="s",
        reason="The beat of two signals drifts: a line is looked for over no more at once.",
    )
    least_looks: int = policy_field(
        100,
        unit="1",
        reason="Two seconds of looks every 20 ms resolve a line of half a hertz.",
    )
    signal_probability: float = policy_field(
        1e-4,
        unit="1",
        reason="A signal counts as distorted so often by chance.",
    )
    lasting_share: float = policy_field(
        0.1,
        unit="1",
        reason="Of the false-alarm probability: that lasting errors are longer than their bound.",
    )
    cusum_branches: tuple[tuple[int, float], ...] = policy_field(
        ((5, 1.0), (50, 0.5)),
        unit="looks, sigma",
        reason=("Looks of one step and reference: a tenth of a second and a second where looks come every 20 ms."),
    )
    guided_looks_share: float = policy_field(
        0.8,
        unit="1",
        reason="Channels that were guided in fewer of a window's looks are left out.",
    )
    looks_more: int = policy_field(
        20,
        unit="1",
        reason="So many looks more than numbers tested make the noise known.",
    )
    bent_share: float = policy_field(
        0.05,
        unit="1",
        reason=(
            "Of a code's offset, one sigma, by which its discriminator is not straight: noise and front ends round it."
        ),
    )


POLICY: Final = CorrelatorPolicy()
