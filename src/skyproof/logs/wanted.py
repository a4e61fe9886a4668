"""Which messages of a receiver help, and how to turn them on.

u-blox: messages are turned on by UBX-CFG-VALSET with a key of each message and port, from generation 9 on (F9 HPG 1.32
interface description, 6.9.14 and 6.9.19). Septentrio: by the command setSBFOutput (mosaic-X5 reference guide 4.14.0,
3.2).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

__all__ = ["WantedMessage", "configure", "missing_messages", "protocol_of"]


@dataclass(frozen=True)
class WantedMessage:
    """A message that helps. also : others that give the same. gives : what it is good for."""

    protocol: str
    name: str
    gives: str
    also: tuple[str, ...] = ()


_WANTED: Final = {
    "UBX": (
        WantedMessage("UBX", "RXM-RAWX", "measurements, which every test needs", ("RXM-RAW",)),
        WantedMessage("UBX", "RXM-SFRBX", "orbits, in place of a navigation file", ("RXM-SFRB",)),
        WantedMessage("UBX", "MON-RF", "levels of the front end, which tell a jammer from a spoofer", ("MON-HW",)),
        WantedMessage("UBX", "SEC-SIG", "the receiver's own word on jamming and spoofing, shown beside ours"),
        WantedMessage("UBX", "NAV-PVT", "the receiver's own positions, shown beside the trusted ones"),
    ),
    "SBF": (
        WantedMessage("SBF", "MeasEpoch", "measurements, which every test needs"),
        WantedMessage("SBF", "GPSRawCA", "orbits, in place of a navigation file"),
        WantedMessage("SBF", "GALRawINAV", "orbits of Galileo"),
        WantedMessage("SBF", "ReceiverStatus", "levels of the front end, which tell a jammer from a spoofer"),
        WantedMessage("SBF", "RFStatus", "the receiver's own word on jamming and spoofing, shown beside ours"),
        WantedMessage("SBF", "PVTGeodetic", "the receiver's own positions, shown beside the trusted ones"),
    ),
}
_UBX_RATE_MS: Final = 200
"""Between epochs: five a second, so that a jump is seen within a second."""


def missing_messages(messages: Mapping[str, int]) -> tuple[WantedMessage, ...]:
    """Return the messages that would help and are not in a log, of the protocols that it holds.

    messages : how many of each name the log holds, as `LogPiece.messages`.
    """
    return tuple(
        wanted
        for protocol, all_wanted in _WANTED.items()
        if any(protocol_of(name) == protocol for name in messages)
        for wanted in all_wanted
        if not {wanted.name, *wanted.also} & messages.keys()
    )


def configure(missing: Sequence[WantedMessage], interval_s: float | None) -> Iterator[str]:
    """Give the lines that turn messages on, one a protocol. interval_s : between epochs; None where there are none."""
    keys = [f"CFG-MSGOUT-UBX_{wanted.name.replace('-', '_')}_USB = 1" for wanted in missing if wanted.protocol == "UBX"]
    if keys:
        slow = interval_s is None or interval_s > 1e-3 * _UBX_RATE_MS + 1e-3
        keys += [f"CFG-RATE-MEAS = {_UBX_RATE_MS}"] if slow else []
        yield f"UBX-CFG-VALSET: {', '.join(keys)} (_UART1 in place of _USB for a serial line)"
    blocks = [wanted.name for wanted in missing if wanted.protocol == "SBF"]
    if blocks:
        yield f"setSBFOutput, Stream2, USB1, {'+'.join(blocks)}, sec1"


def protocol_of(name: str) -> str:
    """Return the protocol of a message's name: UBX names are CLASS-MESSAGE, SBF names are one word."""
    first, _, rest = name.partition(" ")
    if rest or first.startswith("0x"):
        return {"0x": "UBX"}.get(first[:2], first)
    return "UBX" if "-" in name else "SBF"
