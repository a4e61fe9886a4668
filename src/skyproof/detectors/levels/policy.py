"""Numbers by which the test of levels decides."""

from dataclasses import dataclass
from typing import Final

from skyproof.records.policy import number

__all__ = ["POLICY", "LevelsPolicy"]


@dataclass(frozen=True)
class LevelsPolicy:
    """Numbers by which the test of levels decides, each with its reason."""

    least_satellites: int = number(4, "1", "A median of four outvotes one that changes alone.")
    most_cn0_over_power_db: float = number(
        216.0,
        "dB",
        "C/N0 over what `SignalPlan.strongest_dbw` states: 7 dBi to the zenith, a system of 100 K (-208.6 dBW/Hz).",
    )
    noise_dbw_hz: float = number(
        -201.5,
        "dBW/Hz",
        "Thermal noise k T of a system of 513 K: 290 K of ground and antenna, and an amplifier of 2.5 dB.",
    )
    open_sky_loss_db: float = number(
        7.0, "dB", "A patch loses 5 dB at low elevations against 0 dBi, and the receiver's bits and filters 2 dB."
    )
    reading_sigma_db: float = number(
        1.0,
        "dB",
        "Readings to whole decibels err by 0.3 dB, and estimates over a second by less at 63 dB-Hz.",
    )
    remembered_windows: int = number(
        6, "1", "At 10 s a window a satellite's own course follows elevation and slow drifts, and no step."
    )
    forgotten_s: float = number(
        600.0, "s", "A signal that was not received for so long starts again: satellites move by 5 degrees meanwhile."
    )
    confirming_p_value: float = number(
        0.01, "1", "Of a fall that a significant rise of the level confirms, or that lasts from the window before."
    )
    pause_parts: float = number(
        1.5, "1", "Halfway to one part that is missing; where a part is one epoch, the usual pause is a whole one."
    )
    prior_degrees: float = number(
        10.0, "1", "Chosen: the stated scale weighs as much as so many earlier windows of the receiver's own."
    )
    most_degrees: float = number(60.0, "1", "Chosen: a scale rests on no more earlier windows; older ones fade.")
    prior_lost: float = number(1.0, "1", "With the next number: as if one signal of ten had been lost before.")
    prior_stayed: float = number(9.0, "1", "With the number before: as if nine signals of ten had stayed.")


POLICY: Final = LevelsPolicy()
