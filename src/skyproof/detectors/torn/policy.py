"""Numbers by which the test for torn tracking decides."""

from dataclasses import dataclass
from typing import Final

from skyproof.detectors.policy import policy_field

__all__ = ["POLICY", "TornPolicy"]


@dataclass(frozen=True)
class TornPolicy:
    """Numbers by which the test for torn tracking decides, each with its reason."""

    stray_m: float = policy_field(
        1000.0,
        unit="m",
        reason="Beyond any reflection: of 19 900 in cities none was later than 500 m; and the atmosphere.",
        source="ITU-R P.681-11, 6.3",
    )
    most_drift: float = policy_field(
        1e-6,
        unit="s/s",
        reason="A plain quartz parts from its rate at the last fix by no more, as its temperature changes.",
    )
    fault_probability: float = policy_field(
        1e-4,
        unit="1",
        reason="Measurements of an epoch that fit its position more rarely are left out of the fix.",
    )
    least_dof: int = policy_field(
        2,
        unit="1",
        reason="A fix by which others are judged has two measurements more than unknowns.",
    )
    velocity_off_sigmas: float = policy_field(
        5.0,
        unit="sigma",
        reason="A velocity by two fixes is off by no more.",
    )
    most_exchanged_share: float = policy_field(
        0.1,
        unit="1",
        reason=(
            "Of tracked satellites, an epoch: in shade one of ten is lost while another is found, at full strength."
        ),
        source="Kaplan & Hegarty, 8.12",
    )
    weak_dbhz: float = policy_field(
        30.0,
        unit="dB-Hz",
        reason="Below, noise alone makes receivers lose a signal; with 5 dB for its scatter.",
        source="Kaplan & Hegarty, 8.9",
    )
    prior_cells: float = policy_field(
        40.0,
        unit="1",
        reason="The stated bound weighs as much as so many cells of the receiver's own past.",
    )
    most_cells: float = policy_field(
        400.0,
        unit="1",
        reason="A rate rests on no more cells of the past; older ones fade.",
    )
    most_score: float = policy_field(
        60.0,
        unit="1",
        reason="Chances below 1e-26 are alike, and what ended shall end.",
    )
    long_intervals: float = policy_field(
        1.5,
        unit="1",
        reason="Epochs that are more usual intervals apart do not follow each other.",
    )
    whole_system_satellites: int = policy_field(
        3,
        unit="1",
        reason="Satellites of a system that come or go all at once are written by turns, or the system is lost.",
    )


POLICY: Final = TornPolicy()
