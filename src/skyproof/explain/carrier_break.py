"""What `carrier_break` finds, in words."""

from collections.abc import Mapping
from typing import Final

from skyproof.explain.entry import Entry

__all__ = ["ENTRIES"]

ENTRIES: Final[Mapping[str, Entry]] = {
    "no_carriers": Entry("{receiver} has no carrier phases", "carrier phases"),
    "unbroken": Entry("the carriers in {receiver} do not break together"),
    "goes_on": Entry("after {breaks} common breaks the carriers of {n_signals} signals in {receiver} go on together"),
    "goes_apart": Entry(
        "the carriers of {n_signals} signals in {receiver} break at one moment and go on {off_cyc:.2f} cycles apart, "
        "as another sky's would",
        "whether the antenna or its cable was exchanged at that moment",
    ),
}
