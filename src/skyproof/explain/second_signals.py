"""What `second_signals` finds, in words."""

from collections.abc import Mapping
from typing import Any, Final

from skyproof.explain.entry import Entry
from skyproof.records import Finding

__all__ = ["ENTRIES"]

_COUNT: Final = "{doubled} of {satellites} satellites in {receiver} have a credible second signal"


def _describe_unlike_echoes(finding: Finding) -> str:
    """State how many satellites have a second signal, and how rarely echoes are like those of some of them."""
    data: Mapping[str, Any] = finding.data
    words = _COUNT.format_map({**data, "receiver": finding.signals[0].receiver})
    cases = float(f"{1.0 / data['of_echoes']:.2g}")
    return f"{words}; echoes look like those of {data['unlike_echoes']} of them once in {cases:.0f} cases each"


ENTRIES: Final[Mapping[str, Entry]] = {
    "no_cn0": Entry(
        "{receiver} gives no C/N0, so weak signals cannot be told from noise",
        "C/N0 of the signals (in an observation file, the types that begin with S)",
    ),
    "few_satellites": Entry(
        "{satellites} satellites with a signal of {min_cn0_dbhz:g} dB-Hz or more are too few",
        "more satellites in view",
    ),
    "delay_unknown": Entry(
        "the delay between the two signals of {unknown} satellites is not known yet",
        "6 s more of signal to decode the time of week, or a navigation file",
    ),
    "like_echoes": Entry(_COUNT),
    "unlike_echoes": Entry(_describe_unlike_echoes),
    "late_copy": Entry(
        "{n_satellites} satellites in {receiver} have a second signal, weaker and later by the same delay, as from a "
        "repeater or a reflector; it shows no other position",
    ),
}
