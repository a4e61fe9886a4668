"""What `code_carrier` finds, in words."""

from collections.abc import Mapping
from typing import Final

from skyproof.explain.entry import Entry, name_first
from skyproof.records import Finding

__all__ = ["ENTRIES"]


def _describe_parted(finding: Finding) -> str:
    """State which codes leave their carriers, and the worst by how much."""
    names, data = name_first([str(ref.signal) for ref in finding.signals]), finding.data
    return (
        f"code and carrier diverge: {names} in {finding.signals[0].receiver}; {data['worst']} by "
        f"{data['change_m']:.0f} m in {data['time_s']:.0f} s"
    )


ENTRIES: Final[Mapping[str, Entry]] = {
    "no_carrier": Entry(
        "fewer than {needed} signals of {receiver} have code and carrier, or Doppler, over {epochs} unbroken epochs",
        "carrier phases or Dopplers beside the codes",
    ),
    "together": Entry("the codes of {n_signals} signals in {receiver} follow their carriers"),
    "parted": Entry(_describe_parted, "another receiver, or correlators, to tell a fault from a false signal"),
}
