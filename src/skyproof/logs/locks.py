"""Where a carrier breaks, by how long the receiver says that it followed it."""

from typing import Final

import numpy as np

from skyproof.arrays import Booleans, Integers
from skyproof.compiled import compiled

__all__ = ["NEVER", "CarrierLocks"]

NEVER: Final = np.iinfo(np.int64).min


class CarrierLocks:
    """Remembers the last carrier of each signal: its instant, its lock time and whether half a cycle was open."""

    def __init__(self) -> None:
        self._last = np.empty((0, 3), np.int64)

    def slips(
        self,
        instant_ns: Integers,
        signal: Integers,
        lock_ms: Integers,
        carrier: Booleans,
        half_open: Booleans,
        *,
        longest_ms: Integers,
        step_ms: int,
    ) -> Booleans:
        """Tell where (n,) a carrier does not continue the signal's last one, in these rows or before them.

        Its lock time fell, or is shorter than the time since that one, or half a cycle was resolved.

        instant_ns : rising for each signal. signal : number of each. carrier : where there is one. longest_ms : to
        which the lock time counts. step_ms : by which it counts.
        """
        if signal.size and int(signal.max()) >= len(self._last):
            more = int(signal.max()) + 1 - len(self._last)
            self._last = np.vstack([self._last, np.tile([NEVER, 0, 0], (more, 1))])
        slipped = np.zeros(signal.size, np.bool_)
        _find_slips(instant_ns, signal, lock_ms, carrier, half_open, longest_ms, step_ms, self._last, slipped)
        return slipped


@compiled
def _find_slips(
    instant_ns: Integers,
    signal: Integers,
    lock_ms: Integers,
    carrier: Booleans,
    half_open: Booleans,
    longest_ms: Integers,
    step_ms: int,
    carriers: Integers,
    slipped: Booleans,
) -> None:
    for k in range(signal.size):
        if not carrier[k]:
            continue
        last = carriers[signal[k]]
        if last[0] != NEVER:
            since_ms = min((instant_ns[k] - last[0]) // 1_000_000 - step_ms + 1, longest_ms[k])
            slipped[k] = lock_ms[k] < last[1] or lock_ms[k] < since_ms or half_open[k] != (last[2] == 1)
        last[0], last[1], last[2] = instant_ns[k], lock_ms[k], half_open[k]
