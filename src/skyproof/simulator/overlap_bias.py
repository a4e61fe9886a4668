"""Compute how receivers measure where signals of one satellite overlap: pulled by others and by reflections.

A code loop that starts on its signal settles where early and late are equal beside the prompt; the carrier loop follows
the phase of the sum there. Both see the mean of the other signals over an epoch: a copy whose Doppler is far off
averages out. The loop's own settling and its past are left out: a loop that is caught and carried away is shown, epoch
by epoch, where it is caught.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Booleans, Complexes, Integers, Reals
from skyproof.compiled import compiled
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.signals import prn_of
from skyproof.simulator.correlation import Replica, compute_correlation
from skyproof.simulator.correlators import correlate
from skyproof.simulator.received import Scene

__all__ = ["Pull", "compute_pull"]

_STEPS = 60
_LONGEST_CHIPS = 0.1  # step of the loop
_CLOSE_CHIPS = 1e-6
_FARTHEST_CHIPS = 1.5


@dataclass(frozen=True, eq=False, kw_only=True)
class Pull:
    """Of each signal that is received, (n_epochs, n_signals): measured minus its own truth. Zero where it stands alone.

    code_m, carrier_cyc : late is positive; the carrier to the nearest half a cycle either way. doppler_hz.
    level_db : power of the prompt over that of the signal alone.
    """

    code_m: Reals
    carrier_cyc: Reals
    doppler_hz: Reals
    level_db: Reals


def compute_pull(
    scene: Scene,
    index: int,
    elapsed_s: ArrayLike,
    *,
    averaged_s: float,
    early_late_chips: float = 0.5,
    replica: Replica = "chips",
) -> Pull:
    """Compute the pull at antenna number `index` over epochs of `averaged_s` centred on `elapsed_s` (n,).

    Replicas are `early_late_chips` apart.
    """
    sky, n_signals = scene.skies[index], len(scene.skies[index].signals)
    middle_s = np.atleast_1d(np.asarray(elapsed_s, np.float64))
    half_s = 0.5 * averaged_s
    halves_s = (middle_s[:, np.newaxis] + half_s * np.array([-0.5, 0.5])).ravel()
    parts = correlate(scene, index, halves_s, delays_chips=[0.0], coherent_s=half_s, quantised=False).parts
    weight = parts.weight.reshape(middle_s.size, 2, -1)
    lag_chips = parts.lag_chips.reshape(middle_s.size, 2, -1).mean(axis=1)
    sats = sorted({received.id.sat for received in sky.signals})
    tables = compute_correlation([prn_of(sat) for sat in sats], sky.signal, scene.scenario.front_end, replica=replica)
    table_of = np.array([sats.index(received.id.sat) for received in sky.signals], np.int64)
    is_own = (parts.ray < 0) & (parts.signal == parts.channel)
    many = np.bincount(parts.channel, minlength=n_signals) > 1

    ahead_chips = np.zeros((middle_s.size, n_signals))
    prompt = np.ones((middle_s.size, 3, n_signals), np.complex128)  # of the first half, the second, and both
    _settle_loops(
        ahead_chips,
        prompt,
        parts.channel,
        table_of,
        many,
        weight,
        lag_chips,
        early_late_chips,
        tables.signal,
        float(tables.points),
    )
    alone = np.abs(weight.mean(axis=1)[:, is_own]) * tables.signal[table_of, 0]
    alone[:, ~many] = 1.0
    turned_cyc = np.angle(prompt[:, 1] * prompt[:, 0].conj()) / (2.0 * np.pi)
    with np.errstate(divide="ignore", invalid="ignore"):
        level_db = 20.0 * np.log10(np.abs(prompt[:, 2]) / alone)
    return Pull(
        code_m=-ahead_chips / sky.signal.chip_rate_hz * SPEED_OF_LIGHT_M_S,
        carrier_cyc=-np.angle(prompt[:, 2]) / (2.0 * np.pi),
        doppler_hz=turned_cyc / half_s,
        level_db=np.where(alone > 0.0, level_db, 0.0),
    )


@compiled
def _read_table(table: Reals, lag_chips: float, points: float) -> float:
    at = lag_chips * points
    at -= math.floor(at / table.size) * table.size
    whole = int(at)
    share = at - whole
    return float(table[whole % table.size] * (1.0 - share) + table[(whole + 1) % table.size] * share)


@compiled
def _settle_loops(
    ahead_chips: Reals,
    prompt: Complexes,
    channel: Integers,
    table_of: Integers,
    many: Booleans,
    weight: Complexes,
    lag_chips: Reals,
    apart_chips: float,
    tables: Reals,
    points: float,
) -> None:
    """Settle each channel's loop from its own signal on.

    It stops where early less late has no part in phase with the prompt.
    """
    for c in range(ahead_chips.shape[1]):
        if not many[c]:
            continue
        mine = np.flatnonzero(channel == c)
        table = tables[table_of[c]]
        for e in range(ahead_chips.shape[0]):
            ahead = 0.0
            for _ in range(_STEPS):
                early, late, middle = 0j, 0j, 0j
                for p in mine:
                    w = 0.5 * (weight[e, 0, p] + weight[e, 1, p])
                    early += w * _read_table(table, lag_chips[e, p] + ahead + 0.5 * apart_chips, points)
                    late += w * _read_table(table, lag_chips[e, p] + ahead - 0.5 * apart_chips, points)
                    middle += w * _read_table(table, lag_chips[e, p] + ahead, points)
                power = middle.real**2 + middle.imag**2
                if power == 0.0:
                    break
                error = ((early - late) * middle.conjugate()).real / (2.0 * power)
                step = min(max(error, -_LONGEST_CHIPS), _LONGEST_CHIPS)
                ahead = min(max(ahead + step, -_FARTHEST_CHIPS), _FARTHEST_CHIPS)
                if abs(step) < _CLOSE_CHIPS:
                    break
            ahead_chips[e, c] = ahead
            for h in range(2):
                prompt[e, h, c] = 0j
                for p in mine:
                    prompt[e, h, c] += weight[e, h, p] * _read_table(table, lag_chips[e, p] + ahead, points)
            prompt[e, 2, c] = 0.5 * (prompt[e, 0, c] + prompt[e, 1, c])
