"""The particle swarm of the paper on decomposing the correlation function, as a baseline for `decomposition`.

Ahmed, Khanafseh, Pervan, section on particle swarm optimisation, equations 8 to 13: amplitude, delay, Doppler and phase
of each signal are searched together, and the cost is the sum of squared differences over the grid as if its noise were
white. Corrected, since it cannot run as printed: random numbers are uniform in (0, 1), for each particle and coordinate
(printed: "uniformly distributed with N(mu, sigma^2)"); the best of the swarm is where the cost is least (equation 12
takes the largest cost itself); velocity is renewed before position. Phases are those at mid-interval.

It is no worse at searching than at what it searches for: in most runs it finds a cost below that of the truth. The cost
without whitening is the larger fault.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Complexes, Reals
from skyproof.compiled import compiled
from skyproof.decomposition.correlation import correlation
from skyproof.gnss.signals import GPS_L1_CA

__all__ = ["SwarmFit", "SwarmSettings", "swarm_decompose"]

_TABLE_CHIPS = 0.002
_TABLE_REACH_CHIPS = 4.0


@dataclass(frozen=True, kw_only=True)
class SwarmSettings:
    """particles, iterations; inertia w and pulls c1, c2 (the usual constriction); most_amplitude, within_chips and
    within_hz bound the search, the last zero where the Doppler is known."""

    particles: int = 200
    iterations: int = 600
    inertia: float = 0.7298
    own_pull: float = 1.496
    swarm_pull: float = 1.496
    most_amplitude: float = 1.5
    within_chips: float = 1.0
    within_hz: float = 0.0


@dataclass(frozen=True, eq=False, kw_only=True)
class SwarmFit:
    """delay_chips, doppler_hz, amplitude (complex): (..., n) in order of the delays; cost (...), unwhitened."""

    delay_chips: Reals
    doppler_hz: Reals
    amplitude: Complexes
    cost: Reals


@compiled
def _cost(at, signals, data, taps, bins, coherent_s, table, step, known, lags, factors):  # type: ignore[no-untyped-def]
    """Sum of squared differences between the grid and the signals at `at`: amplitude, delay, phase, Doppler each."""
    per = 3 if known else 4
    middle = table.size // 2 - 1  # the table ends one cell later than it begins
    for k in range(signals):
        for i in range(taps.size):
            place = (taps[i] - at[per * k + 1]) / step + middle
            j = int(place)
            lags[k, i] = table[j] + (place - j) * (table[j + 1] - table[j])
        for b in range(bins.size):
            x = np.pi * ((0.0 if known else at[per * k + 3]) - bins[b]) * coherent_s
            sinc = 1.0 if abs(x) < 1e-9 else np.sin(x) / x
            factors[k, b] = at[per * k] * sinc * complex(np.cos(at[per * k + 2]), np.sin(at[per * k + 2]))
    total = 0.0
    for b in range(bins.size):
        for i in range(taps.size):
            residual = data[b, i]
            for k in range(signals):
                residual -= factors[k, b] * lags[k, i]
            total += residual.real**2 + residual.imag**2
    return total


@compiled
def _swarm(  # type: ignore[no-untyped-def]
    data,
    taps,
    bins,
    coherent_s,
    table,
    step,
    signals,
    known,
    low,
    high,
    particles,
    iterations,
    inertia,
    own_pull,
    swarm_pull,
    rng,
):
    per = 3 if known else 4
    p = low.size
    lags, factors = np.empty((signals, taps.size)), np.empty((signals, bins.size), np.complex128)
    at, speed, best_own = np.empty((particles, p)), np.zeros((particles, p)), np.empty((particles, p))
    own_cost = np.empty(particles)
    best, best_cost = np.empty(p), np.inf
    for i in range(particles):
        for q in range(p):
            at[i, q] = low[q] + (high[q] - low[q]) * rng.random()
        best_own[i] = at[i]
        own_cost[i] = _cost(at[i], signals, data, taps, bins, coherent_s, table, step, known, lags, factors)
        if own_cost[i] < best_cost:
            best_cost = own_cost[i]
            best[:] = at[i]
    for _ in range(iterations):
        for i in range(particles):
            for q in range(p):
                wide = high[q] - low[q]
                v = (
                    inertia * speed[i, q]
                    + own_pull * rng.random() * (best_own[i, q] - at[i, q])
                    + swarm_pull * rng.random() * (best[q] - at[i, q])
                )
                speed[i, q] = min(max(v, -0.5 * wide), 0.5 * wide)
                moved = at[i, q] + speed[i, q]
                if q % per == 2:
                    moved = low[q] + (moved - low[q]) % wide
                at[i, q] = min(max(moved, low[q]), high[q])
            cost = _cost(at[i], signals, data, taps, bins, coherent_s, table, step, known, lags, factors)
            if cost < own_cost[i]:
                own_cost[i] = cost
                best_own[i] = at[i]
        # the swarm's best is renewed after the round, as the paper does
        for i in range(particles):
            if own_cost[i] < best_cost:
                best_cost = own_cost[i]
                best[:] = best_own[i]
    return best, best_cost


def swarm_decompose(
    grid: ArrayLike,
    taps_chips: ArrayLike,
    *,
    bins_hz: ArrayLike = 0.0,
    coherent_s: float,
    band_hz: float,
    rng: np.random.Generator,
    signals: int = 2,
    settings: SwarmSettings | None = None,
) -> SwarmFit:
    """Fit `signals` signals to a grid (..., bins, taps) of complex correlation, phases at mid-interval.

    Dopplers are unknown if `settings.within_hz` is above zero.
    """
    settings = settings or SwarmSettings()
    z = np.asarray(grid, np.complex128)
    taps, bins = np.atleast_1d(np.asarray(taps_chips, np.float64)), np.atleast_1d(np.asarray(bins_hz, np.float64))
    shape = z.shape[:-2]
    known = settings.within_hz <= 0.0
    particle = [(0.0, settings.most_amplitude), (-settings.within_chips, settings.within_chips), (-np.pi, np.pi)]
    if not known:
        particle.append((-settings.within_hz, settings.within_hz))
    per = len(particle)
    low, high = np.array(particle * signals).T.copy()
    half = round(_TABLE_REACH_CHIPS / _TABLE_CHIPS)
    table = correlation(np.arange(-half, half + 2) * _TABLE_CHIPS, band_hz, GPS_L1_CA)
    flat = z.reshape(-1, *z.shape[-2:])
    found, cost = np.empty((len(flat), per * signals)), np.empty(len(flat))
    for t, data in enumerate(flat):
        found[t], cost[t] = _swarm(
            np.ascontiguousarray(data),
            taps,
            bins,
            coherent_s,
            table,
            _TABLE_CHIPS,
            signals,
            known,
            low,
            high,
            settings.particles,
            settings.iterations,
            settings.inertia,
            settings.own_pull,
            settings.swarm_pull,
            rng,
        )
    each = found.reshape(-1, signals, per)
    each = np.take_along_axis(each, np.argsort(each[:, :, 1], axis=1)[:, :, None], axis=1)
    doppler = np.zeros(each.shape[:2]) if known else each[:, :, 3]
    return SwarmFit(
        delay_chips=each[:, :, 1].reshape(*shape, signals),
        doppler_hz=doppler.reshape(*shape, signals),
        amplitude=(each[:, :, 0] * np.exp(1j * each[:, :, 2])).reshape(*shape, signals),
        cost=cost.reshape(shape),
    )
