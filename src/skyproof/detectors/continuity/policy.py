"""Numbers by which the test of continuity decides."""

from dataclasses import dataclass
from typing import Final

from skyproof.records.policy import number

__all__ = ["POLICY", "ContinuityPolicy"]


@dataclass(frozen=True)
class ContinuityPolicy:
    """Numbers by which the test of continuity decides, each with its reason."""

    code_spans_s: tuple[float, ...] = number(
        (10.0, 20.0),
        "s",
        "Over which codes are held against carriers: a drag of metres a second shows in them beyond noise.",
    )
    late_share: float = number(
        0.1, "1", "A span's first epoch may come so much of the span late: epochs do not fall on its edge."
    )
    ionosphere_sigma_m_s: float = number(
        0.06,
        "m/s",
        "Assumed: the ionosphere parts code from carrier of one satellite more than of another by so much, in storms.",
    )
    sure_sigmas: float = number(
        3.1, "sigma", "A third of the motion points along the whole of it by chance once in a thousand."
    )
    one_sky_satellites: int = number(5, "1", "Four ranges fit any position: five test it.", "Kaplan & Hegarty, 2.5.2")
    carrier_spans_s: tuple[float, ...] = number(
        (2.5, 10.0), "s", "Over which a motion is looked for: carriers show centimetres within seconds."
    )
    span_late_share: float = number(
        0.1, "1", "A span's first epoch may come so much of the span late: epochs do not fall on its edge."
    )
    air_share: float = number(0.25, "1", "Assumed: models leave so much of the change of the air's delay.")
    outage_intervals: float = number(
        1.5, "1", "Halfway to one epoch that is missing: over a longer pause no step is tested."
    )
    broken_together_share: float = number(
        0.75, "1", "Chosen: where carriers of so many channels break at once, the receiver broke them, or another sky."
    )
    faulty_channel_probability: float = number(1e-4, "1", "Chosen: a channel is called faulty by chance so rarely.")
    steered_within_m: float = number(
        150.0, "m", "A receiver steers its clock by whole milliseconds: a step within so much of one is the receiver's."
    )
    untested_epochs: int = number(3, "1", "A step has an epoch before it and two behind.")
    misfit_probability: float = number(
        0.01, "1", "Chosen: errors are called larger than stated by chance so rarely, and then nothing is said."
    )
    unrelated_spread_m: float = number(
        300.0, "m", "Assumed: unrelated errors of ranges spread over this much, as reflections in a street do."
    )
    joined_per_hour: float = number(
        1.0, "1/h", "Assumed: a recording is joined from those of several receivers no more often."
    )


POLICY: Final = ContinuityPolicy()
