"""What `common_change` finds, in words."""

from collections.abc import Mapping
from typing import Any, Final

from skyproof.explain.entry import Entry
from skyproof.records import Finding

__all__ = ["ENTRIES"]


def _describe_noise(finding: Finding) -> str:
    """Say whether the noise rose or fell, and by how much."""
    data: Mapping[str, Any] = finding.data
    moved = f"{'rose' if data['change_db'] > 0.0 else 'fell'} by {abs(data['change_db']):.0f} dB"
    return (
        f"the noise in {finding.signals[0].receiver} {moved} within {data['time_s']:.0f} s: a change of gain, a "
        "jammer, or further signals"
    )


ENTRIES: Final[Mapping[str, Entry]] = {
    "few_satellites": Entry(
        "fewer than two epochs of {receiver} have {needed} satellites with pseudoranges",
        "{needed} or more satellites with pseudoranges",
    ),
    "first_window": Entry(
        "this is the first window of {receiver}: later ones are held against it", "half a minute of signal or more"
    ),
    "nothing_shared": Entry(
        "no {needed} satellites in {receiver} have code and carrier both now and before",
        "{needed} or more satellites with code and carrier over half a minute",
    ),
    "together": Entry("code and carrier of the satellites in {receiver} stay together"),
    "parted": Entry(
        "code and carrier in {receiver} part by {rate_m_s:+.2f} m/s on all satellites alike: codes are drawn off and "
        "carriers are not, or the sampling clock and the carrier come from two oscillators",
        "a receiver with one oscillator",
    ),
    "turns_as_clock": Entry("the carriers in {receiver} turn as motion and an oscillator of the class {oscillator} do"),
    "turned": Entry(
        "all carriers in {receiver} turn by {turn_m:+.2f} m within {time_s:.0f} s as no motion turns them, more than "
        "an oscillator of the class {oscillator} wanders",
        "what the receiver's clock runs on, or whether it is steered",
    ),
    "noise_steady": Entry("the noise in {receiver} stays what it is"),
    "noise_moved": Entry(_describe_noise, "a second receiver, whose levels go on"),
}
