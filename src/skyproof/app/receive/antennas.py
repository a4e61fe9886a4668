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
    """One source of a receiver's antennas, in their order.

    name : of the receiver.

    Raises
    ------
    InputError : they differ in rate, frequency, length, start or gaps. A start that only some state holds for all.
    """
    first, *others = antennas
    start_gpst = next((one.start_gpst for one in antennas if one.start_gpst is not None), None)
    for other in others:
        for key, (stated, to_do) in _ALIKE.items():
            one, two = getattr(first, key), getattr(other, key)
            if one != two and not (key == "start_gpst" and None in (one, two)):
                raise InputError(
                    f"{other.path or other.name}: {stated.format(_shown(two))}, expected {stated.format(_shown(one))} "
                    f"as of {first.path or first.name}, the first antenna of {name}; {to_do}"
                )
    names = [one.antenna for one in antennas]
    if len(set(names)) < len(names):
        names = [str(number) for number in range(1, len(names) + 1)]
    of_all = [remark for remark in first.remarks if all(remark in other.remarks for other in others)]
    own = [
        Remark.reworded(remark, f"antenna {called}: {remark}")
        for called, one in zip(names, antennas, strict=True)
        for remark in (
            *one.remarks,
            *([Remark(f"nothing comes from it: {one.dead}", RemarkKind.BEARS)] if one.dead else ()),
        )
        if remark not in of_all
    ]
    first, *others = (replace(one, antenna=called) for called, one in zip(names, antennas, strict=True))
    return replace(first, name=name, start_gpst=start_gpst, remarks=(*of_all, *own), others=tuple(others))


def _shown(value: Any) -> Any:
    """Gaps as numbers of samples."""
    if not isinstance(value, tuple):
        return value
    return ", ".join(f"{gap.missing_samples} before sample {gap.at_sample}" for gap in value) or "none"
