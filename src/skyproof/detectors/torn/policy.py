"""Numbers by which the test for torn tracking decides."""

from dataclasses import dataclass
from typing import Final

from skyproof.records.policy import number

__all__ = ["POLICY", "TornPolicy"]


@dataclass(frozen=True)
class TornPolicy:
    """Numbers by which the test for torn tracking decides, each with its reason."""

    stray_m: float = number(
        1000.0,
        "m",
        "At the horizon one echo in a hundred is later, at 37 degrees one in 3600.",
        "doi 10.1186/s43020-020-00027-7, table 1",
    )
    most_drift: float = number(
        1e-6,
        "s/s",
        "Assumed: a plain quartz parts from its rate at the last fix by no more, as its temperature changes.",
    )
    fault_probability: float = number(1e-4, "1", "Chosen: a good measurement is left out of the fix so rarely.")
    least_dof: int = number(2, "1", "Of two measurements beyond the unknowns one may be wrong, and the other shows it.")
    velocity_off_sigmas: float = number(5.0, "sigma", "Normal errors exceed it once in two million.")
    most_exchanged_share: float = number(
        0.1,
        "1",
        "Chosen, of tracked satellites an epoch: in shade one of ten is lost while another is found, at full strength.",
    )
    weak_dbhz: float = number(
        30.0,
        "dB-Hz",
        "Below, noise alone makes receivers lose a signal; with 5 dB for its scatter.",
        "Kaplan & Hegarty, 8.9",
    )
    prior_cells: float = number(
        40.0, "1", "Chosen: the stated bound weighs as much as so many cells of the receiver's own past."
    )
    most_cells: float = number(400.0, "1", "Chosen: a rate rests on no more cells of the past; older ones fade.")
    most_score: float = number(60.0, "1", "Chances below 1e-26 are alike, and what ended shall end.")
    long_intervals: float = number(
        1.5, "1", "Halfway to one epoch that is missing: epochs farther apart do not follow each other."
    )
    whole_system_satellites: int = number(
        3,
        "1",
        "Chosen: satellites of a system that come or go all at once are written by turns, or the system is lost.",
    )


POLICY: Final = TornPolicy()
