"""What is said of a choice between skies, or of none, as evidence."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from skyproof.fusion.rivals import Rivals
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.time import iso
from skyproof.navigation.foresight import SkyFix
from skyproof.navigation.prediction import Choice
from skyproof.records import ConsistentSet, Evidence, ObservationLog, OverlappingSkies, SignalRef

__all__ = ["DETECTOR", "REFUSED", "chosen", "chosen_overlapping", "not_chosen", "taken_for_true"]

DETECTOR: Final = "prediction"
REFUSED: Final = 1e-3
"""Probability that the true sky is refused in a window because it does not fit."""
_LEAST_SHOWN: Final = 1e-12


def taken_for_true(
    o: ObservationLog, window: Rivals, end_gpst: np.datetime64, assumes: tuple[str, ...], because: str
) -> Evidence:
    """The window's only sky is authentic."""
    return Evidence(
        detector=DETECTOR,
        start_gpst=window.start,
        end_gpst=end_gpst,
        subject=_refs(o, window.sets[0]),
        says="authentic",
        because=because,
        assumes=assumes,
    )


def chosen(
    o: ObservationLog,
    window: Rivals,
    shown: Sequence[SkyFix],
    choice: Choice,
    by: str,
    assumes: tuple[str, ...],
    *,
    first: bool,
) -> list[Evidence]:
    """One sky is authentic, the others are spoofed. first : of its receiver; it stands beside the verdict."""
    assert choice.chosen is not None
    wrong = max(choice.wrong_probability, _LEAST_SHOWN)
    fits = {number: float(fit) for number, fit in enumerate(choice.fits)}
    true_fit = fits.pop(choice.chosen)
    words = f"of {len(shown)} skies of {o.receiver}, {_apart(shown, choice)}, "
    stated = f"the probability that this is the wrong choice is {_stated(choice)} or less"
    because = f"{words}this one fits {by}; {stated}"
    if first:
        seen = iso(window.start, 0)[11:]
        because = f"which of {len(shown)} skies of {o.receiver} is true was chosen from {seen} on by {by}; {stated}"
    true = Evidence(
        detector=DETECTOR,
        start_gpst=window.start,
        end_gpst=window.end,
        subject=_refs(o, window.sets[choice.chosen]),
        says="authentic",
        because=because,
        false_alarm_probability=REFUSED,
        p_value=max(fits.values()),
        log_likelihood_ratio=float(np.log1p(-wrong) - np.log(wrong)),
        assumes=assumes,
        noted=first,
    )
    false = [
        replace(
            true,
            subject=_refs(o, window.sets[number]),
            says="spoofed",
            because=f"{words}this one does not fit {by} (p = {fit:.0e}), and another one does (p = {true_fit:.2g}); "
            f"{stated}",
            p_value=fit,
            assumes=(),
            noted=False,
            whole_sky=True,
        )
        for number, fit in fits.items()
    ]
    return [true, *false]


def chosen_overlapping(
    o: ObservationLog,
    window: Rivals,
    skies: OverlappingSkies,
    shown: Sequence[SkyFix],
    choice: Choice,
    by: str,
    assumes: tuple[str, ...],
    doubt: float,
    *,
    first: bool,
) -> Evidence:
    """Which of two skies within a chip is true: no signal is named, for the receiver's channels follow their sum.

    doubt : that these are not skies to choose from.
    """
    assert choice.chosen is not None
    of = f"{_apart(shown, choice)}, of {len(skies.sets[0].signals)} satellites each"
    return Evidence(
        detector=DETECTOR,
        start_gpst=window.start,
        end_gpst=window.end,
        subject=_refs(o, skies.sets[0]),
        says="attack" if window.attacked else "undecided",
        because=f"in signals of {o.receiver} that overlap within a chip are {len(shown)} skies, {of}; the true one was "
        f"chosen by {by}, and its fixes are trusted; the probability that this is the wrong choice is "
        f"{_stated(choice, doubt)} or less",
        assumes=(*assumes, f"one of the skies that overlap in {o.receiver} is the true one"),
        noted=first,
    )


def not_chosen(
    o: ObservationLog,
    window: Rivals,
    skies: Sequence[ConsistentSet],
    shown: Sequence[SkyFix],
    choice: Choice,
    by: str,
    most_wrong: float,
    doubt: float = 0.0,
) -> Evidence:
    """The window stays open, and why. skies : that were compared; doubt : that these are not skies to choose from."""
    fit = float(np.max(choice.fits))
    if fit < REFUSED:
        why = f"none of them fits {by} (p = {fit:.0e})"
    elif choice.wrong_probability > most_wrong:
        why = (
            f"by {by} the likelier one is wrong with a probability of {choice.wrong_probability:.2g}, more than the "
            f"limit of {most_wrong:g}"
        )
    elif choice.wrong_probability + doubt > most_wrong:
        why = f"the likelier one alone, with its reflections or by chance, may make the others (p = {doubt:.2g})"
    elif choice.chosen is None:
        why = f"in what {by} shows they do not differ by more than their noise"
    else:
        why = f"they differ in what {by} does not show, too, and are of so few satellites that both may be false"
    return Evidence(
        detector=DETECTOR,
        start_gpst=window.start,
        end_gpst=window.end,
        subject=tuple(dict.fromkeys(ref for s in skies for ref in _refs(o, s))),
        says="undecided",
        because=f"of {len(shown)} skies of {o.receiver}, {_apart(shown, choice)}, none is chosen: {why}",
        false_alarm_probability=REFUSED,
        p_value=fit,
        would_need="skies that part farther, or a better prediction: an inertial unit, a better oscillator, a surveyed "
        "position",
        may_also_be=("statement",) if fit < REFUSED else (),
    )


def _stated(choice: Choice, doubt: float = 0.0) -> str:
    """The probability of a wrong choice. doubt : that it was one between other skies."""
    return _rounded_up(max(choice.wrong_probability + doubt, _LEAST_SHOWN))


def _rounded_up(probability: float) -> str:
    """To one digit."""
    unit = 10.0 ** np.floor(np.log10(probability))
    return f"{np.ceil(probability / unit - 1e-9) * unit:.0e}"


def _apart(shown: Sequence[SkyFix], choice: Choice) -> str:
    """How far the likeliest two are from each other."""
    one, other = (shown[k].whole for k in np.argsort(-choice.probabilities)[:2])
    off = one.mean - other.mean
    return f"{np.linalg.norm(off[:3]):.0f} m and {abs(off[6]) / SPEED_OF_LIGHT_M_S * 1e9:.0f} ns apart"


def _refs(o: ObservationLog, s: ConsistentSet) -> tuple[SignalRef, ...]:
    return tuple(SignalRef(o.receiver, signal) for signal in s.signals)
