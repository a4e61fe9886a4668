"""Why a receiver's signals could not be tested for going on."""

import numpy as np

from skyproof.detectors.base import NotTested
from skyproof.detectors.continuity.policy import POLICY
from skyproof.records import Observations

__all__ = ["explain_few_epochs", "explain_no_step"]


def explain_few_epochs(o: Observations, epochs: int, *, stepped: bool) -> NotTested:
    """Explain a stretch of too few epochs.

    o : of the window. epochs : that have enough satellites, those before the window included. stepped : whether those
    before the last step were left out.
    """
    most = int(np.isfinite(o.pseudorange_m).sum(axis=1).max(initial=0))
    if most < POLICY.one_sky_satellites:
        return NotTested("few_satellites", {"most": most, "needed": POLICY.one_sky_satellites})
    data = {"epochs": epochs, "needed": POLICY.untested_epochs, "satellites": POLICY.one_sky_satellites}
    return NotTested("few_epochs_since_step" if stepped else "few_epochs", data)


def explain_no_step(o: Observations) -> NotTested:
    """Explain a stretch in which no moment can be tested, whatever its epochs.

    o : the stretch, one signal a transmission.
    """
    ranged = np.isfinite(o.pseudorange_m).any(axis=0)
    tuned = ranged & np.isfinite(o.carrier_hz)
    if tuned.sum() < POLICY.one_sky_satellites <= ranged.sum():
        return NotTested("no_frequency", {"without": int((ranged & ~tuned).sum()), "ranged": int(ranged.sum())})
    moving = tuned & (np.isfinite(o.carrier_cyc) | np.isfinite(o.doppler_hz)).any(axis=0)
    if moving.sum() < POLICY.one_sky_satellites <= tuned.sum():
        return NotTested("ranges_alone", {"without": int((tuned & ~moving).sum()), "tuned": int(tuned.sum())})
    return NotTested("one_side", {"needed": POLICY.one_sky_satellites})
