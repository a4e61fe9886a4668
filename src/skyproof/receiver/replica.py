"""The replica that samples are correlated with: the code as a front end lets it pass, at fractions of a sample."""

import numpy as np
from numpy.typing import NDArray

from skyproof.receiver.correlator import REACH_CHIPS, table_pad

__all__ = ["CODE_SCALE", "code_table"]

CODE_SCALE = 127
"""What a chip is in the code tables."""
SMOOTHING_STEPS = 64
"""Steps a sample in which the code is smoothed."""


def code_table(
    code: NDArray[np.int8],
    chips_per_sample: float,
    n_phases: int,
    n_samples: int,
    reach_chips: float = REACH_CHIPS,
) -> NDArray[np.int8]:
    """The code resampled at `n_phases` fractions of a sample, smoothed, times `CODE_SCALE`.

    code : (n_chips,) of +1 and -1, repeated without end.
    chips_per_sample : at the nominal code rate.
    n_samples : of the longest period to correlate.
    reach_chips : how far from the prompt a delay may lie.

    Gives (n_phases, n_samples + 2 pad), pad being `table_pad(chips_per_sample, reach_chips)`. Row p, column k is the
    mean of the code under a triangle of one sample to either side of the time (k - pad + p / n_phases) samples after
    the start of the code.

    Samples are band-limited to half their rate and the edges of chips are not: read at the samples' instants alone, a
    replica's spectrum folds back and shifts the code by metres, differently for every delay. The triangle takes away
    what would fold; it is nearly the matched filter of what a front end lets pass (docs/design/receiver.md).
    """
    pad = table_pad(chips_per_sample, reach_chips)
    steps = n_phases * max(round(SMOOTHING_STEPS / n_phases), 1)
    # A triangle is a box over one sample, twice; boxes of an even number of steps are centred half a step off.
    at = (np.arange(-steps, steps * (n_samples + 2 * pad + 1)) + 1.0) / steps - pad
    once = np.cumsum(np.concatenate([[0.0], code[np.floor(at * chips_per_sample).astype(np.int64) % code.size]]))
    once = (once[steps:] - once[:-steps]) / steps
    twice = np.cumsum(np.concatenate([[0.0], once]))
    twice = (twice[steps:] - twice[:-steps]) / steps
    start = np.arange(n_samples + 2 * pad)[None, :] * steps + (np.arange(n_phases) * (steps // n_phases))[:, None]
    return np.asarray(np.rint(CODE_SCALE * twice[start]), np.int8)
