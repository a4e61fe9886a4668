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


POLICY: Final = MessagesPolicy()
