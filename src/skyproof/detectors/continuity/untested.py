"""Why a receiver's signals could not be tested for going on, and what would let them be."""

import numpy as np

from skyproof.detectors.base import NEEDS, Untested
from skyproof.detectors.continuity.one_sky import MIN_SATELLITES
from skyproof.records import Need, Observations

__all__ = ["LEAST_EPOCHS", "explain_few_epochs", "explain_no_set", "explain_no_step"]

LEAST_EPOCHS = 3
_LONGER = f"{MIN_SATELLITES} or more satellites with pseudoranges over a longer time"


def explain_no_set(receiver: str) -> Untested:
    """Explain a receiver that has no consistent set in this window, nor had any before."""
    return Untested(
        "no_set", f"no position fits the signals of {receiver}, so no sky is there to follow", NEEDS[Need.SETS]
    )


def explain_few_epochs(o: Observations, epochs: int, *, stepped: bool) -> Untested:
    """Explain a stretch of too few epochs.

    o : of the window. epochs : that have enough satellites, those before the window included. stepped : whether those
    before the last step were left out.
    """
    most = int(np.isfinite(o.pseudorange_m).sum(axis=1).max(initial=0))
    if most < MIN_SATELLITES:
        return Untested(
            "few_satellites",
            f"{o.receiver} has pseudoranges of {most} satellites at most at one epoch, and {MIN_SATELLITES} are needed",
            f"pseudoranges of {MIN_SATELLITES} or more satellites at the same epochs",
        )
    since = " since the last step" if stepped else ""
    return Untested(
        "few_epochs",
        f"{o.receiver} has {epochs} epochs with {MIN_SATELLITES} satellites or more{since}, and {LEAST_EPOCHS} are "
        "needed",
        _LONGER,
    )


def explain_no_step(o: Observations) -> Untested:
    """Explain a stretch in which no moment can be tested, whatever its epochs.

    o : the stretch, one signal a transmission.
    """
    ranged = np.isfinite(o.pseudorange_m).any(axis=0)
    tuned = ranged & np.isfinite(o.carrier_hz)
    if tuned.sum() < MIN_SATELLITES <= ranged.sum():
        return Untested(
            "no_frequency",
            f"the carrier frequencies of {int((ranged & ~tuned).sum())} of {int(ranged.sum())} signals of "
            f"{o.receiver} are not known",
            "the frequency numbers of GLONASS, in the header of the file or a navigation file",
        )
    moving = tuned & (np.isfinite(o.carrier_cyc) | np.isfinite(o.doppler_hz)).any(axis=0)
    if moving.sum() < MIN_SATELLITES <= tuned.sum():
        without = int((tuned & ~moving).sum())
        return Untested(
            "ranges_alone",
            f"{without} of {int(tuned.sum())} signals of {o.receiver} have pseudoranges alone: without carrier phases "
            "or Dopplers nothing shows how they should go on",
            "carrier phases or Dopplers beside the pseudoranges",
        )
    return Untested(
        "one_side",
        f"fewer than {MIN_SATELLITES} satellites in {o.receiver} are there both before and after any moment of the "
        "window",
        _LONGER,
    )
