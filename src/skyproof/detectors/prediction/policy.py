"""Numbers by which what is shown is held against what was expected."""

from dataclasses import dataclass
from typing import Final

from skyproof.records.policy import number

__all__ = ["POLICY", "PredictionPolicy"]


@dataclass(frozen=True)
class PredictionPolicy:
    """Numbers by which what is shown is held against what was expected, each with its reason."""

    label_off_s: float = number(
        0.02, "s", "By which a receiver's label may be off the instant of its epoch: a clock not steered for hours."
    )
    least_satellites: int = number(
        5, "1", "Ranges of four satellites fit any position: what fewer than five show, chance may."
    )
    misfit_satellites: int = number(
        1, "1", "One satellite may be faulty; more that do not fit show that errors are not as stated."
    )
    slip_p_value: float = number(
        1e-3, "1", "From which on the place that a slip in writing gives is the one that is shown."
    )
    datum_sigma_m: float = number(
        2.0, "m", "On each axis: NAD 83 lies 1 to 2 m from WGS 84, which surveys take for equal.", "EPSG:1188"
    )
    tried_windows: int = number(2, "1", "One window in which unit and signals agree may be chance.")
    tried_ratio: float = number(
        2.0,
        "1",
        "Changes of velocity may be so much larger than those tried: errors of gain no more than double with them.",
    )
    quiet_m_s: float = number(
        0.5, "m/s", "A change of velocity in which even a gain that is wrong by a tenth errs by no more than fixes do."
    )
    parts_within_s: float = number(
        2.0, "s", "A sky that takes over parts so fast; what a unit errs by adds up for as long as it errs."
    )
    stays_parted_s: float = number(4.0, "s", "Velocities stay apart for twice as long as they took to part.")
    parted_share: float = number(0.7, "1", "Chosen: most of what velocities are apart by at last has parted at once.")
    blow_m_s: float = number(
        0.1,
        "m/s",
        "One reading that changes the velocity by more than its neighbours is a blow, or an error of the log.",
    )
    look_interval_s: float = number(0.25, "s", "Between looks at both velocities: eight while they part.")
    least_looks: int = number(3, "1", "One before velocities part, one then and one after.")


POLICY: Final = PredictionPolicy()
