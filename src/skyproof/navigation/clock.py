"""The receiver's clock moved by whole milliseconds, as receivers do that keep theirs near GPS time."""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.records import Observations

__all__ = ["anchored"]


def anchored(observations: Observations, clock_bias_s: ArrayLike) -> Observations:
    """The same measurements with a clock label that is off by no more than half a millisecond.

    With k = round(bias / 1 ms), `gpst` moves back by k ms exactly, the pseudorange by c times k ms, and the carrier by
    the cycles in k ms (whole cycles on L1): the times of transmission and code minus carrier stay what they were.

    Parameters
    ----------
    clock_bias_s : what the clock shows minus true time, as in `Fix`. A scalar shifts all epochs alike; an array
        (n_epochs,) each by its own k, which steps by a millisecond where a drifting clock passes a half.

    Raises
    ------
    ValueError : a bias is not finite or the array does not fit the epochs.
    """
    bias_s = np.asarray(clock_bias_s, np.float64)
    if bias_s.shape not in ((), observations.gpst.shape) or not np.all(np.isfinite(bias_s)):
        raise ValueError(
            f"clock_bias_s must be finite, one number or {observations.gpst.size}; got shape {bias_s.shape}"
        )
    shift_ms = np.broadcast_to(np.rint(bias_s * 1e3).astype(np.int64), observations.gpst.shape)
    return replace(
        observations,
        gpst=observations.gpst - shift_ms.astype("timedelta64[ms]"),
        pseudorange_m=observations.pseudorange_m - shift_ms[:, None] * (SPEED_OF_LIGHT_M_S * 1e-3),
        carrier_cyc=observations.carrier_cyc - shift_ms[:, None] * (observations.carrier_hz * 1e-3),
    )
