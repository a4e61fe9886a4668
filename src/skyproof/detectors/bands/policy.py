"""Numbers by which the comparison of bands decides."""

from dataclasses import dataclass
from typing import Final

from skyproof.records.policy import number

__all__ = ["POLICY", "BandsPolicy"]


@dataclass(frozen=True)
class BandsPolicy:
    """Numbers by which the comparison of bands decides, each with its reason."""

    most_ionosphere_m: float = number(
        150.0,
        "m",
        "Slant delay at L1: 50 m at the zenith in a storm, three times as much low down.",
        "Kaplan & Hegarty, 10.2.4.1",
    )
    group_delay_sigma_m: float = number(
        3.0,
        "m",
        "Bands of a GPS satellite may be delayed against each other by 15 ns at most; two thirds of that.",
        "IS-GPS-200N, 3.3.1.7.2",
    )
    reflected_chips: float = number(
        0.125,
        "chip",
        "Half of what an equal reflection draws a code off by, as reflections are weaker: in each of two bands.",
        "Kaplan & Hegarty, 9.5",
    )
    least_satellites: int = number(3, "1", "The median of three satellites outvotes one that is wrong.")
    step_satellites: int = number(4, "1", "Of three satellites two that reflections change alike look like all.")
    ionosphere_pace_m_s: float = number(
        0.06,
        "m/s",
        "Assumed: the delay of L1 changes by no more in storms: 20 TECU a minute.",
    )
    misfit_probability: float = number(
        0.01, "1", "Chosen: changes scatter by more than their model so rarely; then the scatter gives their scale."
    )
    remembered_windows: int = number(6, "1", "At 10 s a window a minute: a slow push is metres by then.")


POLICY: Final = BandsPolicy()
