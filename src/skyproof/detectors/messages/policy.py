"""Numbers by which the test of messages decides."""

from dataclasses import dataclass
from typing import Final

from skyproof.records.policy import number

__all__ = ["POLICY", "MessagesPolicy"]


@dataclass(frozen=True)
class MessagesPolicy:
    """Numbers by which the test of messages decides, each with its reason."""

    below_horizon_deg: float = number(
        2.0,
        "deg",
        "Refraction lifts signals by 0.6 degrees at most, and orbits of an old data set err by less.",
        "ITU-R P.834-9, equation (14)",
    )
    remembered_data_sets: int = number(
        4, "1", "Of a satellite and message, each sent for two hours: eight hours.", "IS-GPS-200N, 20.3.4.4"
    )
    time_back_s: float = number(
        300.0,
        "s",
        "The time of a data set may go back by so much: after an upload it is off the hour.",
        "IS-GPS-200N, 20.3.4.5",
    )
    valid_together_s: float = number(
        7200.0,
        "s",
        "Data sets of GPS are sent for two hours and fit four; those of other systems are renewed sooner.",
        "IS-GPS-200N, 20.3.4.4",
    )
    sideways_share: float = number(
        1.0 / 7.0,
        "1",
        "What a data set errs along and across counts so much in a range, of GPS; of the others less.",
        "Montenbruck, Steigenberger and Hauschild, Advances in Space Research 61(12), 2018",
    )
    last_day_s: float = number(
        93_600.0,
        "s",
        "The last data set of a file of the day before is sent for two hours more.",
        "IS-GPS-200N, 20.3.4.4",
    )
    medium_axis_m: float = number(
        36e6, "m", "Medium orbits have axes of 25.5e6 (GLONASS) to 29.6e6 (Galileo), those of a day's period 42.2e6."
    )
    tide_per_s2: float = number(
        2.9e-13,
        "1/s^2",
        "Moon and Sun at their nearest, 2 GM / d^3: the pull on a satellite beyond that on Earth, over its distance.",
        "Montenbruck and Gill, Satellite Orbits, 3.3",
    )
    clock_spread: float = number(
        3.0, "1", "Chosen: single oscillators of one class differ by factors of several.", "skyproof.gnss.oscillators"
    )
    day_fault_probability: float = number(
        0.01,
        "1",
        "Chosen: a satellite is manoeuvred, or its clock served, once or twice a year (notices to NAVSTAR users).",
    )
    utc_apart_s: float = number(
        1e-6,
        "s",
        "GPS time is within so much of UTC but for whole seconds; the others are nearer.",
        "IS-GPS-200N, 3.3.4",
    )


POLICY: Final = MessagesPolicy()
