"""Whether codes and carriers of a recording agree at the rate and carrier given, once its first seconds were tracked.

The loops show it at no cost and to 0.001 ppm, as long as they hold; where they do not, an inspection does.
"""

from collections.abc import Callable, Mapping

from skyproof.app.inspect import Inspection
from skyproof.errors import InputError, NotEnoughData
from skyproof.receiver.channels import Arc
from skyproof.receiver.clock_agreement import Disagreement, correct_samples, estimate_from_tracks
from skyproof.receiver.measurement import Measurements
from skyproof.records import Samples

__all__ = ["correct_disagreement"]


def correct_disagreement(
    samples: Samples, measured: Measurements, arcs: Mapping[int, Arc], inspected: Callable[[], Inspection]
) -> tuple[Samples, Disagreement] | None:
    """Correct the rate or carrier by which codes and carriers disagree, and say by how much.

    None if there is nothing to correct, or too little to tell.

    inspected : gives the recording's inspection.
    """
    apart = estimate_from_tracks(measured, {number: arc.signal.sat for number, arc in arcs.items()})
    if apart is not None:
        return (correct_samples(samples, apart), apart) if apart.certain else None
    try:
        found = inspected()
    except (InputError, NotEnoughData):  # too short, or cut while it is read: tracking says so
        return None
    return None if found.disagreement is None else (found.samples, found.disagreement)
