"""Numbers by which the test of continuity decides."""

from dataclasses import dataclass
from typing import Final

from skyproof.detectors.policy import policy_field

__all__ = ["POLICY", "ContinuityPolicy"]


@dataclass(frozen=True)
class ContinuityPolicy:
    """Numbers by which the test of continuity decides, each with its reason."""

    code_spans_s: tuple[float, ...] = policy_field(
        (10.0, 20.0),
        unit="s",
        reason=("Over which codes are held against carriers: a drag of metres a second shows in them beyond noise."),
    )
    late_share: float = policy_field(
        0.1,
        unit="1",
        reason="A span's first epoch may come so much of the span late: epochs do not fall on its edge.",
    )
    ionosphere_sigma_m_s: float = policy_field(
        0.06,
        unit="m/s",
        reason=(
            "The ionosphere parts code from carrier of one satellite more than of another by so much, storms included."
        ),
    )
    sure_sigmas: float = policy_field(
        3.1,
        unit="sigma",
        reason="A third of the motion points along the whole of it by chance once in a thousand.",
    )
    one_sky_satellites: int = policy_field(
        5,
        unit="1",
        reason="Ranges of four satellites fit any position.",
    )
    carrier_spans_s: tuple[float, ...] = policy_field(
        (2.5, 10.0),
        unit="s",
        reason="Over which a motion is looked for: carriers show centimetres within seconds.",
    )
    span_late_share: float = policy_field(
        0.1,
        unit="1",
        reason="A span's first epoch may come so much of the span late: epochs do not fall on its edge.",
    )
    air_share: float = policy_field(
        0.25,
        unit="1",
        reason="Models leave so much of the change of the air's delay.",
    )
    outage_intervals: float = policy_field(
        1.5,
        unit="1",
        reason="A pause of more usual intervals is an outage, over which no step is tested.",
    )
    broken_together_share: float = policy_field(
        0.75,
        unit="1",
        reason="Where carriers of so many channels break at once, the receiver broke them, or another sky.",
    )
    faulty_channel_probability: float = policy_field(
        1e-4,
        unit="1",
        reason="Residuals show by chance so rarely that a channel jumps by itself.",
    )
    steered_within_m: float = policy_field(
        150.0,
        unit="m",
        reason="One epoch shows a step of a millisecond by this much; what the step leaves is tested.",
    )
    untested_epochs: int = policy_field(
        3,
        unit="1",
        reason="A step has an epoch before it and two behind.",
    )
    misfit_probability: float = policy_field(
        0.01,
        unit="1",
        reason="Residuals that are rarer by chance show that errors are not as stated.",
    )
    reflected_step_chips: float = policy_field(
        0.5,
        unit="chip",
        reason="A reflection draws a code loop off by no more than half a chip.",
    )


POLICY: Final = ContinuityPolicy()
