"""What `code_doppler` finds, in words."""

from collections.abc import Mapping
from typing import Final

from skyproof.explain.entry import Entry, name_first
from skyproof.records import Finding

__all__ = ["ENTRIES"]


def _describe_incoherent(finding: Finding) -> str:
    """State which codes do not move as their Dopplers say, and the worst by how much."""
    names, data = name_first([str(ref.signal) for ref in finding.signals]), finding.data
    which = names if finding.singled_out else f"some of {names}"
    return (
        f"the code of {which} in {finding.signals[0].receiver} does not move as its Doppler says, whatever "
        f"reflects it: {data['worst']} leaves it by {data['parting_m_s']:.1f} m/s"
    )


ENTRIES: Final[Mapping[str, Entry]] = {
    "few_epochs": Entry(
        "no signal of {receiver} has code and Doppler in {needed} epochs of the window", "a longer recording"
    ),
    "coherent": Entry("the codes of {n_signals} signals in {receiver} move as their Dopplers say"),
    "incoherent": Entry(_describe_incoherent),
}
