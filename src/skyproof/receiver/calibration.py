"""Calibrate the search's noise: the tail of the same samples correlated with codes that no satellite sends.

White noise makes the sum of `n_sums` powers over its mean a Gamma(n_sums, 1/n_sums) variable (Kay, Detection Theory,
5.3). Cross-correlations with strong signals and coloured noise do not. So every power is put on the scale on which that
law is the standard exponential, e = -ln Q(m, m x). The tail of the unused codes beyond a high quantile is taken as
exponential. Its scale is the mean excess, never less than the 1 of white noise. See Coles, An Introduction to
Statistical Modeling of Extreme Values, 4.2, with shape zero. This
extrapolates from a few in a hundred thousand to the few in 10^11 of a threshold for the whole search.

Counted: it holds on white and coloured noise, on lines, and beside strong signals once they are subtracted. Under
strong signals it does not. Cross-correlations add different powers to different cells, and an exponential through the
highest of such a mixture falls too fast. So the search subtracts those first (`acquisition`).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from skyproof.arrays import Floats, Reals
from skyproof.gnss.codes import UNUSED_DELAYS_CHIPS, generate_gold_code

__all__ = ["Tail", "fit_tail", "list_unused_codes", "tail_exponent", "white_tail"]

_SHARE = 0.004
"""Of all powers in white noise: what lies above that quantile is the tail."""
_EXPONENT_MAX = 690.0  # beyond that, probabilities leave the range of a float64


@dataclass(frozen=True, kw_only=True)
class Tail:
    """Share of cells whose exponent exceeds e: share exp(-(e - level) / scale), for e above `level`."""

    n_sums: int
    level: float
    share: float
    scale: float

    def threshold(self, n_cells: int, probability: float) -> float:
        """Return the power over mean that noise exceeds in any of `n_cells` with this probability."""
        e = self.level + self.scale * np.log(n_cells * self.share / -np.log1p(-probability))
        return power_from_exponent(max(float(e), self.level), self.n_sums)

    def p_value(self, power: float, n_cells: int) -> float:
        """Return the probability that noise reaches `power` over mean in any of `n_cells`."""
        e = float(tail_exponent(np.array(power), self.n_sums))
        expected = n_cells * self.share * np.exp(-max(e - self.level, 0.0) / self.scale)
        return float(-np.expm1(-expected))


def tail_exponent(power: NDArray[np.floating], n_sums: int) -> Reals:
    """Compute -ln of the probability that the mean of `n_sums` noise powers exceeds `power` times its mean."""
    survival = special.gammaincc(n_sums, n_sums * np.asarray(power, dtype=np.float64))
    e: Reals = np.minimum(-np.log(np.maximum(survival, 1e-300)), _EXPONENT_MAX)
    return e


def power_from_exponent(e: float, n_sums: int) -> float:
    """Invert `tail_exponent`."""
    return float(special.gammainccinv(n_sums, np.exp(-min(e, _EXPONENT_MAX))) / n_sums)


def fit_tail(power: Floats, n_sums: int) -> Tail:
    """Fit the tail of powers over their mean where there is no signal; any shape, at least some thousand values."""
    level = -float(np.log(_SHARE))
    e = tail_exponent(power[power > power_from_exponent(level, n_sums)], n_sums)
    excess = float(np.mean(e - level)) if e.size else 1.0
    return Tail(n_sums=n_sums, level=level, share=max(e.size, 1) / power.size, scale=max(1.0, excess))


def white_tail(n_sums: int) -> Tail:
    """Return the tail of white noise; no other is thinner."""
    return Tail(n_sums=n_sums, level=-float(np.log(_SHARE)), share=_SHARE, scale=1.0)


def list_unused_codes(count: int) -> list[NDArray[np.int8]]:
    """List `count` Gold codes that no satellite sends, spread over the family: int8 of shape (1023,), +-1."""
    picks = np.linspace(0, len(UNUSED_DELAYS_CHIPS) - 1, count).astype(np.int64)
    return [generate_gold_code(UNUSED_DELAYS_CHIPS[int(k)]) for k in picks]
