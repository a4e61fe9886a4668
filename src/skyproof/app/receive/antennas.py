"""Recordings of the antennas of one receiver, joined to one source."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

from skyproof.errors import InputError
from skyproof.records import Samples
from skyproof.remarks import Remark, RemarkKind

__all__ = ["in_step"]

_ALIKE: Final = {
    "rate_hz": ("{:.12g} samples a second", "one clock samples all antennas: correct rate_hz of one of them"),
    "centre_hz": ("tuned to {:.12g} Hz", "one oscillator serves all antennas: correct centre_hz of one of them"),
    "if_hz": ("its carrier at {:.12g} Hz", "one oscillator serves all antennas: correct if_hz of one of them"),
    "n_samples": (
        "{} samples",
        "antennas are compared sample by sample: record them together, or give the duration_s that all have, if they "
        "began together",
    ),
    "start_gpst": (
        "begun at {}",
        "antennas are compared sample by sample: correct start_gpst, or record them together",
    ),
    "gaps": ("gaps {}", "antennas are compared sample by sample: record them together"),
}
"""What the antennas of one receiver have in common: how it is stated, and what to do where it is not so."""


def in_step(antennas: Sequence[Samples], name: str) -> Samples:
    """Join the recordings of a receiver's antennas, in their order, into one source.

    name : of the receiver.

    Raises
    ------
    InputError : they differ in rate, frequency, length, start or gaps. A start that only some state holds for all.
    """
    first, *rest = antennas
    start_gpst = next((recording.start_gpst for recording in antennas if recording.start_gpst is not None), None)
    for other in rest:
        for key, (stated, to_do) in _ALIKE.items():
            value, other_value = getattr(first, key), getattr(other, key)
            if value != other_value and not (key == "start_gpst" and None in (value, other_value)):
                raise InputError(
                    f"{other.path or other.name}: {stated.format(_describe_value(other_value))}, expected "
                    f"{stated.format(_describe_value(value))} "
                    f"as of {first.path or first.name}, the first antenna of {name}; {to_do}"
                )
    names = [recording.antenna for recording in antennas]
    if len(set(names)) < len(names):
        names = [str(number) for number in range(1, len(names) + 1)]
    of_all = [remark for remark in first.remarks if all(remark in other.remarks for other in rest)]
    remarks_by_antenna = [
        Remark.reword(remark, f"antenna {called}: {remark}")
        for called, recording in zip(names, antennas, strict=True)
        for remark in (
            *recording.remarks,
            *([Remark(f"nothing comes from it: {recording.dead}", RemarkKind.BEARS)] if recording.dead else ()),
        )
        if remark not in of_all
    ]
    first, *rest = (replace(recording, antenna=called) for called, recording in zip(names, antennas, strict=True))
    return replace(first, name=name, start_gpst=start_gpst, remarks=(*of_all, *remarks_by_antenna), others=tuple(rest))


def _describe_value(value: Any) -> Any:
    """Write gaps as numbers of samples."""
    if not isinstance(value, tuple):
        return value
    return ", ".join(f"{gap.missing_samples} before sample {gap.at_sample}" for gap in value) or "none"
