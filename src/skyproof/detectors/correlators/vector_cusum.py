"""Add up a vector receiver's looks: find small offsets over many windows, and when large ones began.

Each look leaves residuals of code and of phase, over their noise: t = s W'W x with x the discriminators of n
satellites, s their sigmas and W the whitened parity basis (`vector_parity`). They have n numbers and n - 4 degrees.
Unlike W x they are the same for every basis, so that a sum continues while the geometry turns. Code and phase have a
bank of Crosier's sums each (`statistics.cusum`) over steps of some looks.

Lasting errors of codes (multipath, ionosphere, orbits) would add up without end in a sum. So its reference grows by b,
a length that they exceed with a stated probability. Then |s + y + e| - (k + b) <= |s + y| - k where |e| <= b, and the
law of |s + y| grows with |s|. So alarms come at most as often as without such errors.

Successive windows share a sum. A window's p-value is that of a sum that has always run (`cusum_within`). So it is
uniform under the null in each window, though not independent of the window before.
"""

from bisect import bisect_left
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.correlators.policy import POLICY
from skyproof.detectors.correlators.vector_parity import Whitener
from skyproof.records import SignalId
from skyproof.statistics.cusum import cusum_path, cusum_within
from skyproof.statistics.distributions import chi_square_threshold

__all__ = ["BankFound", "BankState", "run_bank"]


@dataclass(frozen=True, eq=False, kw_only=True)
class BankState:
    """State carried from window to window: sums (n,) of each branch, of code and then of phase, with these signals."""

    signals: tuple[SignalId, ...]
    sums: tuple[Reals, ...]


class BankFound(NamedTuple):
    """Over one window.

    p_value : below any level, from the requested one up, at most as often as stated, for each sum has a fourth. Of
        16 000 successive windows of 100 looks, six satellites, 8.8 % are below 10 % and 0.82 % below 1 %. One below
        the requested level is an alarm; sums then restart, so that alarms come more rarely than that.
    began, seen : looks, counted in the window, at which the alarming sum last left zero (-1: before the window) and at
        which it passed its threshold; None without an alarm.
    state : for the next window; it restarts after an alarm.
    """

    p_value: float
    began: int | None
    seen: int | None
    state: BankState


def run_bank(
    signals: tuple[SignalId, ...],
    code_chips: Reals,
    phase_rad: Reals,
    white: Whitener,
    lasting_chips: Reals,
    false_alarm_probability: float,
    state: BankState | None = None,
) -> BankFound:
    """Run the bank of sums over one window's discriminators (looks, n).

    white : of one look's noise. lasting_chips : (n,) one sigma of what codes may be off for good. Looks beyond the last
    whole step of a branch do not count in it: windows should hold a multiple of 50.
    """
    n, dof = len(signals), white.code.shape[0]
    kinds = ((code_chips, white.code, white.sigma_chips), (phase_rad, white.phase, white.sigma_rad))
    if state is None or state.signals != signals:
        state = BankState(signals=signals, sums=(np.zeros(n),) * (len(kinds) * len(POLICY.cusum_branches)))
    share = (1.0 - POLICY.lasting_share) * false_alarm_probability / len(state.sums)
    lasting = _bound_lasting_errors(white, lasting_chips, POLICY.lasting_share * false_alarm_probability)
    ended, p_values, alarms = [], [1.0], []
    for i, total in enumerate(state.sums):
        (x, rows, sigma), (looks, reference) = (
            kinds[i // len(POLICY.cusum_branches)],
            POLICY.cusum_branches[i % len(POLICY.cusum_branches)],
        )
        steps = len(x) // looks
        mean = np.sqrt(looks) * x[: steps * looks].reshape(steps, looks, n).mean(axis=1)
        bound = np.sqrt(looks) * lasting if x is code_chips else 0.0
        path = cusum_path(sigma * (mean @ rows.T @ rows), reference + bound, sigma * ((sigma * total) @ rows.T @ rows))
        ended.append(path.state)
        if steps:
            highest = np.maximum.accumulate(path.size)
            p_values.append(_p_value_of_height(float(highest[-1]), steps, reference, dof))
            if p_values[-1] < share:
                alarms.append(_alarm(path.size, highest, reference, dof, share, looks))
    seen, began = min(alarms, default=(None, None))
    if alarms:
        ended = [np.zeros(n) for _ in ended]
    p_value = min(len(ended) * min(p_values) + POLICY.lasting_share * false_alarm_probability, 1.0)
    return BankFound(p_value, began, seen, BankState(signals=signals, sums=tuple(ended)))


def _p_value_of_height(size: float, steps: int, reference: float, degrees: int) -> float:
    return cusum_within(size, steps, reference, degrees) if size > 0.0 else 1.0


def _alarm(size: Reals, highest: Reals, reference: float, degrees: int, share: float, looks: int) -> tuple[int, int]:
    """Looks at which a sum was so large that the window alarms, and at which it last left zero, -1 for before it."""
    steps = len(size)
    first = bisect_left(
        range(steps), True, key=lambda k: _p_value_of_height(float(highest[k]), steps, reference, degrees) < share
    )
    zeros = np.flatnonzero(size[:first] <= 0.0)
    return (first + 1) * looks, (int(zeros[-1]) + 1) * looks if zeros.size else -1


def _bound_lasting_errors(white: Whitener, lasting_chips: Reals, probability: float) -> float:
    """Return the length in one look's y that lasting errors of code exceed at this probability."""
    spread = np.linalg.norm(white.code * lasting_chips, ord=2)
    return float(spread * np.sqrt(chi_square_threshold(probability, white.code.shape[0])))
