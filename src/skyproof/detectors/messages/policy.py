"""Numbers by which the test of messages decides."""

from dataclasses import dataclass
from typing import Final

from skyproof.detectors.policy import policy_field

__all__ = ["POLICY", "MessagesPolicy"]


@dataclass(frozen=True)
class MessagesPolicy:
    """Numbers by which the test of messages decides, each with its reason."""

    below_horizon_deg: float = policy_field(
        2.0,
        unit="deg",
        reason="Refraction lifts signals by 0.6 degrees at most, and orbits of an old data set err by less.",
    )
    remembered_data_sets: int = policy_field(
        4,
        unit="1",
        reason="Of a satellite and message: a data set is sent for two hours and replaced by the next.",
    )
    time_back_s: float = policy_field(
        300.0,
        unit="s",
        reason="The time of a data set may go back by so much: after an upload it is off the hour.",
        source="IS-GPS-200N, 20.3.4.5",
    )
    valid_together_s: float = policy_field(
        7200.0,
        unit="s",
        reason=("Data sets of GPS are sent for two hours and fit four; those of other systems are renewed sooner."),
        source="IS-GPS-200N, 20.3.4.4",
    )
    sideways_share: float = policy_field(
        1.0 / 7.0,
        unit="1",
        reason="What a data set errs along and across counts so much in a range, of GPS; of the others less.",
        source="Montenbruck, Steigenberger and Hauschild, Advances in Space Research 61(12), 2018",
    )


POLICY: Final = MessagesPolicy()
