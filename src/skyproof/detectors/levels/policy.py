"""Numbers by which the test of levels decides."""

from dataclasses import dataclass
from typing import Final

from skyproof.detectors.policy import policy_field

__all__ = ["POLICY", "LevelsPolicy"]


@dataclass(frozen=True)
class LevelsPolicy:
    """Numbers by which the test of levels decides, each with its reason."""

    least_satellites: int = policy_field(
        4,
        unit="1",
        reason="Four satellites tell a common change from single ones'.",
    )
    most_cn0_dbhz: float = policy_field(
        63.0,
        unit="dB-Hz",
        reason=("C/A at -153 dBW in an antenna of 0 dBi, 7 dBi towards the zenith, a system of 100 K (-208.6 dBW/Hz)."),
        source="IS-GPS-200N, 6.3.1",
    )
    others_stronger_db: float = policy_field(
        5.0,
        unit="dB",
        reason="Signals other than C/A are stronger by so much at most: -148 dBW, of Galileo's E5 and of L5.",
    )
    remembered_windows: int = policy_field(
        6,
        unit="1",
        reason="At 10 s a window a satellite's own course follows elevation and slow drifts, and no step.",
    )
    forgotten_s: float = policy_field(
        600.0,
        unit="s",
        reason="A signal that was not seen for so long begins anew: satellites move by 5 degrees meanwhile.",
    )
    confirming_p_value: float = policy_field(
        0.01,
        unit="1",
        reason=("Of a fall that a significant rise of the level confirms, or that goes on from the window before."),
    )
    prior_degrees: float = policy_field(
        10.0,
        unit="1",
        reason="The stated scale weighs as much as so many earlier windows of the receiver's own.",
    )
    most_degrees: float = policy_field(
        60.0,
        unit="1",
        reason="A scale rests on no more earlier windows; older ones fade.",
    )
    prior_lost: float = policy_field(
        1.0,
        unit="1",
        reason="With the next number: as if one signal of ten had been lost before.",
    )
    prior_stayed: float = policy_field(
        9.0,
        unit="1",
        reason="With the number before: as if nine signals of ten had stayed.",
    )


POLICY: Final = LevelsPolicy()
