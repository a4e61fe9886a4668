"""Align the channels of a receiver: to signals exactly, or to any delays."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Integers, Reals
from skyproof.records import SignalId
from skyproof.simulator.received import Delay, Scene, find_rows

__all__ = ["Tracked", "align_channels"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Tracked:
    """What replicas are aligned to: any delays of code and carrier, true times (n,) to (n, n_channels) each.

    signals : the satellite (and copy) of each channel. symbols : the row of the scene's messages that each channel
        wipes off, (n_channels,). columns : of the sky's signals that channels stand on, -1 for none.
    """

    signals: tuple[SignalId, ...]
    delays_s: Delay
    symbols: Integers
    columns: Integers

    def move(self, *, code_s: ArrayLike = 0.0, doppler_hz: ArrayLike = 0.0, carrier_hz: float) -> "Tracked":
        """Move replicas later by `code_s` and higher by `doppler_hz`, (n_channels,) or one for all.

        The carrier turns from the scene's start.
        """
        late_s, fast = np.asarray(code_s, np.float64), np.asarray(doppler_hz, np.float64) / carrier_hz

        def delays_s(true_s: Reals) -> tuple[Reals, Reals]:
            code, carrier = self.delays_s(true_s)
            return code + late_s, carrier - true_s[:, np.newaxis] * fast

        return replace(self, delays_s=delays_s)


def align_channels(scene: Scene, index: int, columns: ArrayLike | None = None) -> Tracked:
    """Align one channel to each signal in `columns` of antenna number `index`, exactly; to all if absent.

    A column may be named several times: with `move`, several hypotheses of one signal.
    """
    sky = scene.skies[index]
    chosen = np.arange(len(sky.signals)) if columns is None else np.asarray(columns, np.int64)

    def delays_s(true_s: Reals) -> tuple[Reals, Reals]:
        code_s, carrier_s = sky.delays_s(true_s)
        return code_s[:, chosen], carrier_s[:, chosen]

    return Tracked(
        signals=tuple(sky.signals[column].id for column in chosen),
        delays_s=delays_s,
        columns=chosen,
        symbols=find_rows(scene.messages, sky.signals)[chosen],
    )
