"""Decide between one signal or two, with the same delays through a burst, and whether a reflection explains the second.

The intervals of a burst follow each other within tenths of a second: delays stay, amplitudes are free in each. With
b(tau) the whitened correlation of an interval with a signal at delay tau, and sums over the intervals, what two signals
explain is

    Q(tau1, tau2) = sum (|b1|^2 g22 + |b2|^2 g11 - 2 g12 Re(b1* b2)) / (g11 g22 - g12^2)

as in `decomposition.fit` for one interval; nothing but the sums of the products b1* b2 is needed to search all pairs.

Each satellite's own code is used: its side lobes, of C/A up to 0.06 from one chip on, are no second signals.

A reflection comes after its signal and is weaker. `BurstComponents` therefore holds two statistics: what any second
signal explains more than none, and what it explains more than the best pair whose later signal is weaker by
`reflected_weaker_db` at least. The second is small under one signal, and under a signal with a reflection.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from skyproof.arrays import Booleans, Complexes, Reals
from skyproof.compiled import compiled
from skyproof.detectors.dccaf.policy import POLICY
from skyproof.gnss.signals import SignalPlan

__all__ = [
    "BurstComponents",
    "Decomposed",
    "Shapes",
    "autocorrelate_code",
    "build_shapes",
    "estimate_amplitudes",
    "fit_components",
    "interpolate_taps",
    "joint_p_value",
    "whiten_taps",
]

_POINTS = 128
"""Of a code's correlation, a chip: cubics between them are right to 2e-8 in 8 MHz of band, and to 1e-7 in 20 MHz."""
_STEP_CHIPS = 0.01
_CODE_NULLS = 1e-7
_LAST_STEP_CHIPS = 2e-4
_CLOSEST_CHIPS = 0.004
_SHIFTS = np.array([0.0, -0.02, 0.02, -0.05, 0.05])
"""By which the first signal may stand off where one alone would, when the search for a second begins."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Shapes:
    """What one satellite's signal looks like in white noise, by delay.

    whiten : (d, m) from taps to coordinates in which noise is white. grid : (g,) chips. value, slope : (g, d).
    band_cycles : highest frequency that passes, in cycles per chip.
    path : length that the direction of a second signal goes as its delay runs over the window.
    """

    whiten: Reals
    grid: Reals
    value: Reals
    slope: Reals
    band_cycles: float
    path: float


@lru_cache(maxsize=64)
def build_shapes(
    signal: SignalPlan, prn: int, taps_chips: tuple[float, ...], band_hz: float, window_chips: float
) -> Shapes:
    """Build the shapes of a signal's code `prn` in an ideal band of two-sided width `band_hz`.

    Delays lie within `window_chips`.
    """
    taps = np.array(taps_chips)
    count = round(window_chips / _STEP_CHIPS)
    grid = np.arange(-count, count + 1.0) * _STEP_CHIPS
    correlation, _ = _correlate_code(signal, prn, band_hz, taps[:, None] - taps)
    values, vectors = np.linalg.eigh(correlation)
    kept = values > _CODE_NULLS * values[-1]
    whiten = (vectors[:, kept] / np.sqrt(values[kept])).T
    seen, rising = _correlate_code(signal, prn, band_hz, taps[:, None] - grid)
    value, slope = (whiten @ seen).T.copy(), -(whiten @ rising).T
    return Shapes(
        whiten=whiten,
        grid=grid,
        value=value,
        slope=np.ascontiguousarray(slope),
        band_cycles=0.5 * band_hz / signal.chip_rate_hz,
        path=_path(value, slope),
    )


def estimate_amplitudes(taps: Complexes, own: Shapes, seen: Reals) -> Complexes:
    """Estimate the amplitudes of signals (n,) in one interval (m,), by least squares in its noise.

    `seen` (m, n) is each signal's shape in the taps, at amplitude 1.
    """
    return np.asarray(np.linalg.lstsq(own.whiten @ seen + 0j, own.whiten @ taps, rcond=None)[0])


def interpolate_taps(taps: Complexes, own: Shapes, read: Reals) -> Complexes:
    """Interpolate an interval's correlation (m,) at other delays (n,), for what is in the band and passes the taps.

    `read` (n, m) is the code's correlation from those to the taps.
    """
    return np.asarray(read @ (own.whiten.T @ (own.whiten @ taps)))


def autocorrelate_code(signal: SignalPlan, prn: int, lag_chips: ArrayLike, band_hz: float) -> Reals:
    """Correlate a signal's code `prn` with itself in a band at lags (...), side lobes included."""
    return _correlate_code(signal, prn, band_hz, np.asarray(lag_chips, np.float64))[0]


@lru_cache(maxsize=2)  # 2 MB each, and `build_shapes` of a satellite are made once
def _period(signal: SignalPlan, prn: int, band_hz: float) -> tuple[Reals, Reals]:
    """Compute the whole autocorrelation and its derivative per chip, at `_POINTS` a chip."""
    code = signal.code(prn).astype(np.float64)
    lines = np.arange(code.size * _POINTS // 2 + 1)
    cycles = lines / code.size
    power = np.abs(np.fft.fft(code))[lines % code.size] ** 2 * np.sinc(cycles) ** 2
    power *= cycles <= 0.5 * band_hz / signal.chip_rate_hz
    whole = np.fft.irfft(power, code.size * _POINTS)
    slope = np.fft.irfft(power * 2j * np.pi * cycles, code.size * _POINTS)
    return whole / whole[0], slope / whole[0]


def _correlate_code(signal: SignalPlan, prn: int, band_hz: float, lag_chips: Reals) -> tuple[Reals, Reals]:
    """Correlate a code with itself in a band at lags (...), and its slope per chip, by cubic Hermite polynomials."""
    value, slope = _period(signal, prn, band_hz)
    at = lag_chips * _POINTS
    whole = np.floor(at).astype(np.int64)
    u, first, last = at - whole, whole % value.size, (whole + 1) % value.size
    rise, d0, d1 = value[last] - value[first], slope[first] / _POINTS, slope[last] / _POINTS
    read = value[first] + u * (d0 + u * (3.0 * rise - 2.0 * d0 - d1 + u * (d0 + d1 - 2.0 * rise)))
    rising = d0 + u * (2.0 * (3.0 * rise - 2.0 * d0 - d1) + 3.0 * u * (d0 + d1 - 2.0 * rise))
    return read, rising * _POINTS


def _path(value: Reals, slope: Reals) -> float:
    """Measure the path of the unit vectors towards D(tau) beside D(0).

    At zero that is towards the derivative, whose sign has no meaning.
    """
    middle = len(value) // 2
    first = value[middle] / np.linalg.norm(value[middle])
    beside = value - np.outer(value @ first, first)
    beside[middle] = slope[middle] - (slope[middle] @ first) * first
    unit = beside / np.linalg.norm(beside, axis=1)[:, None]
    turns = np.sum(unit[1:] * unit[:-1], axis=1)
    return float(np.sum(np.arccos(np.clip(np.abs(turns), 0.0, 1.0))))


def joint_p_value(statistic: ArrayLike, intervals: int, path: float, noise_samples: int | None = None) -> Reals:
    """Bound the chance (...) of a statistic `BurstComponents.second` at least as large under one signal.

    Over the delay of the second signal, its statistic is a chi-square process of 2 K degrees for K intervals. The
    chance that its highest point exceeds t is at most that of one point plus the expected number of level crossings,

        P(chi2_2K > t) + path / sqrt(pi) (t/2)^(K - 1/2) exp(-t/2) / Gamma(K)

    (Davies, Biometrika 74(1), 1987; Rice's formula for chi-square). A second degree is added, for the first signal's
    delay moves as well. If the variance is estimated from `noise_samples` complex values, the law is mixed over that
    estimate.
    """
    t = np.maximum(np.asarray(statistic, np.float64), 0.0)[..., None]
    if noise_samples is not None:
        share = (np.arange(64) + 0.5) / 64
        t = t * special.chdtri(2.0 * noise_samples, share) / (2.0 * noise_samples)
    k = intervals + 0.5
    log_crossings = (k - 0.5) * np.log(np.maximum(0.5 * t, 1e-300)) - 0.5 * t - special.gammaln(k)
    chance = special.chdtrc(2.0 * k, t) + path / np.sqrt(np.pi) * np.exp(log_crossings)
    return np.asarray(np.minimum(chance, 1.0).mean(axis=-1))


@dataclass(frozen=True, eq=False, kw_only=True)
class BurstComponents:
    """One signal, and two, of each burst (n,).

    one_chips, one_sigma : (n,) delay of the signal, if it is one; alone : (n,) Q1, what it explains. two_chips : (n, 2)
    of two, the stronger first; two_variance : (n, 2). at_edge : (n,) whether they lie at an edge of what is searched,
    as near as two may be or as far off as any: then their variance is none.
    two_energy : (n, 2) mean square amplitude in units of the noise's variance.
    second : (n,) 2 (Q2 - Q1), what a second signal explains. unlike : (n,) 2 (Q2 - Q_reflection), at most `second`.
    """

    one_chips: Reals
    one_sigma: Reals
    alone: Reals
    two_chips: Reals
    two_variance: Reals
    at_edge: Booleans
    two_energy: Reals
    second: Reals
    unlike: Reals


class Decomposed(NamedTuple):
    """One channel over a burst: its intervals (k, d) in white noise of variance one, its shapes, and what was found."""

    white: Complexes
    shapes: Shapes
    found: BurstComponents


def whiten_taps(taps: Complexes, own: Shapes, noise_variance: Reals) -> Complexes:
    """Transform intervals (..., m) to white noise of variance one (..., d); `noise_variance` (...)."""
    return np.asarray(np.asarray(taps, np.complex128) @ own.whiten.T / np.sqrt(noise_variance)[..., None])


def fit_components(taps: Complexes, own: Shapes, noise_variance: Reals) -> BurstComponents:
    """Fit one signal and two to bursts (n, intervals, m) of one satellite at the tracked Doppler.

    `noise_variance` is (n, intervals).
    """
    n = len(taps)
    white = whiten_taps(taps, own, noise_variance)
    step = max(round(min(0.1 / own.band_cycles, 0.08) / _STEP_CHIPS), 1)
    out = np.empty((n, _N_OUT))
    _fit_all(
        np.ascontiguousarray(white),
        float(own.grid[0]),
        _STEP_CHIPS,
        own.value,
        own.slope,
        np.arange(0, own.grid.size, step),
        10.0 ** (-0.1 * POLICY.reflected_weaker_db),
        out,
    )
    order = np.argsort(-out[:, 5:7], axis=1)
    each = [np.take_along_axis(out[:, first : first + 2], order, axis=1) for first in (3, 7, 5)]
    return BurstComponents(
        one_chips=out[:, 1],
        one_sigma=np.sqrt(out[:, 2]),
        alone=out[:, 0],
        two_chips=each[0],
        two_variance=each[1],
        at_edge=out[:, 11] > 0.0,
        two_energy=each[2] / taps.shape[1],
        second=np.maximum(2.0 * (out[:, 9] - out[:, 0]), 0.0),
        unlike=np.maximum(2.0 * (out[:, 9] - np.maximum(out[:, 10], out[:, 0])), 0.0),
    )


# Columns: 0 Q1, 1 delay, 2 its variance, 3 4 delays of two, 5 6 energies, 7 8 variances, 9 Q2, 10 Q of a reflection,
# 11 whether the two are at an edge.
_N_OUT = 12


@compiled
def _interpolate_vector(x, first, step, value, slope, out):  # type: ignore[no-untyped-def]
    """Interpolate a table's vector at x by cubic Hermite polynomials."""
    place = (x - first) / step
    i = min(max(int(np.floor(place)), 0), value.shape[0] - 2)
    u = place - i
    h0, h1 = (1.0 + 2.0 * u) * (1.0 - u) ** 2, u * u * (3.0 - 2.0 * u)
    g0, g1 = u * (1.0 - u) ** 2 * step, u * u * (u - 1.0) * step
    for k in range(value.shape[1]):
        out[k] = h0 * value[i, k] + h1 * value[i + 1, k] + g0 * slope[i, k] + g1 * slope[i + 1, k]


@compiled
def _project(data, vector, out):  # type: ignore[no-untyped-def]
    """Compute each interval's projection on a vector, and the vector's square."""
    for b in range(data.shape[0]):
        real, imag = 0.0, 0.0
        for i in range(vector.size):
            real += vector[i] * data[b, i].real
            imag += vector[i] * data[b, i].imag
        out[b] = complex(real, imag)
    return np.sum(vector * vector)


@compiled
def _explain_pair(b1, b2, g11, g22, g12):  # type: ignore[no-untyped-def]
    """Compute what two signals explain, and the energy of each without what noise adds; -1 if they are one."""
    e1, e2, x = 0.0, 0.0, 0.0
    for k in range(b1.size):
        e1 += b1[k].real ** 2 + b1[k].imag ** 2
        e2 += b2[k].real ** 2 + b2[k].imag ** 2
        x += b1[k].real * b2[k].real + b1[k].imag * b2[k].imag
    det = g11 * g22 - g12 * g12
    if det < 1e-9 * g11 * g22:
        return -1.0, 0.0, 0.0
    q = (e1 * g22 + e2 * g11 - 2.0 * g12 * x) / det
    a1 = (e1 * g22**2 + e2 * g12**2 - 2.0 * g22 * g12 * x) / det**2 - b1.size * g22 / det
    a2 = (e2 * g11**2 + e1 * g12**2 - 2.0 * g11 * g12 * x) / det**2 - b1.size * g11 / det
    return q, a1, a2


@compiled
def _explain_delays(data, t1, t2, weaker, table, room):  # type: ignore[no-untyped-def]
    """Compute Q of a pair.

    With `weaker` >= 0 only if the later one has at most that share of the earlier one's energy.
    """
    first, step, value, slope = table
    v1, v2, b1, b2 = room
    last = first + step * (value.shape[0] - 1)
    if min(t1, t2) < first or max(t1, t2) > last or abs(t1 - t2) < _CLOSEST_CHIPS:
        return -1.0
    _interpolate_vector(t1, first, step, value, slope, v1)
    _interpolate_vector(t2, first, step, value, slope, v2)
    g11, g22, g12 = _project(data, v1, b1), _project(data, v2, b2), np.sum(v1 * v2)
    q, a1, a2 = _explain_pair(b1, b2, g11, g22, g12)
    if weaker >= 0.0:
        early, late = (a1, a2) if t1 < t2 else (a2, a1)
        if late > weaker * early:
            return -1.0
    return q


@compiled
def _climb(data, t1, t2, weaker, table, room):  # type: ignore[no-untyped-def]
    """Find the top near a pair, by trying all eight sides and halving the step."""
    best, size = _explain_delays(data, t1, t2, weaker, table, room), 0.02
    while size > _LAST_STEP_CHIPS:
        to1, to2, top = t1, t2, best
        for i in range(-1, 2):
            for j in range(-1, 2):
                if i == 0 and j == 0:
                    continue
                q = _explain_delays(data, t1 + i * size, t2 + j * size, weaker, table, room)
                if q > top:
                    to1, to2, top = t1 + i * size, t2 + j * size, q
        if top > best:
            t1, t2, best = to1, to2, top
        else:
            size *= 0.5
    return t1, t2, best


@compiled
def _explain_single(data, t, table, room):  # type: ignore[no-untyped-def]
    first, step, value, slope = table
    if t < first or t > first + step * (value.shape[0] - 1):
        return -1.0
    _interpolate_vector(t, first, step, value, slope, room[0])
    g = _project(data, room[0], room[2])
    return np.sum(room[2].real ** 2 + room[2].imag ** 2) / g


@compiled
def _information(data, t1, t2, table, room):  # type: ignore[no-untyped-def]
    """Compute the information of both delays and what they share, from the curvature at the top.

    Tells also if an edge of the search spoils it.
    """
    h, sides = 0.002, np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            sides[i, j] = _explain_delays(data, t1 + (i - 1) * h, t2 + (j - 1) * h, -1.0, table, room)
    i11 = (2.0 * sides[1, 1] - sides[2, 1] - sides[0, 1]) / h**2
    i22 = (2.0 * sides[1, 1] - sides[1, 2] - sides[1, 0]) / h**2
    i12 = (sides[2, 0] + sides[0, 2] - sides[2, 2] - sides[0, 0]) / (4.0 * h**2)
    return i11, i22, i12, sides.min() < 0.0


@compiled
def _find_second(data, t1, weaker, coarse, seen, table, room):  # type: ignore[no-untyped-def]
    """Find the best cell beside a signal at t1."""
    first, step, value, slope = table
    _interpolate_vector(t1, first, step, value, slope, room[0])
    g11 = _project(data, room[0], room[2])
    best, top = -1, -1.0
    for c in range(coarse.size):
        t2 = first + step * coarse[c]
        if abs(t2 - t1) < 0.5 * step:
            continue
        v2 = value[coarse[c]]
        q, a1, a2 = _explain_pair(room[2], seen[c], g11, np.sum(v2 * v2), np.sum(room[0] * v2))
        if weaker >= 0.0:
            early, late = (a1, a2) if t1 < t2 else (a2, a1)
            if late > weaker * early:
                continue
        if q > top:
            best, top = c, q
    return best, top


@compiled
def _fit_all(data, first, step, value, slope, coarse, reflected, out):  # type: ignore[no-untyped-def]
    n, blocks, d = data.shape
    table = (first, step, value, slope)
    room = (np.empty(d), np.empty(d), np.empty(blocks, np.complex128), np.empty(blocks, np.complex128))
    seen = np.empty((coarse.size, blocks), np.complex128)
    for burst in range(n):
        burst_data = data[burst]
        top, best = -1.0, 0
        for c in range(coarse.size):
            g = _project(burst_data, value[coarse[c]], seen[c])
            q = np.sum(seen[c].real ** 2 + seen[c].imag ** 2) / g
            if q > top:
                best, top = c, q
        t, size = first + step * coarse[best], step * (coarse[1] - coarse[0])
        while size > 0.5 * _LAST_STEP_CHIPS:
            low, high = (
                _explain_single(burst_data, t - size, table, room),
                _explain_single(burst_data, t + size, table, room),
            )
            if max(low, high) > top:
                t, top = (t - size, low) if low > high else (t + size, high)
            else:
                size *= 0.5
        h = 0.002
        curved = (
            2.0 * top
            - _explain_single(burst_data, t - h, table, room)
            - _explain_single(burst_data, t + h, table, room)
        ) / h**2
        out[burst, 0], out[burst, 1] = top, t
        out[burst, 2] = 1.0 / curved if curved > 0.0 else np.inf
        for kind in range(2):  # any pair, then pairs that a reflection may make
            weaker = -1.0 if kind == 0 else reflected
            most, at1, at2 = -1.0, t, t
            for shift in _SHIFTS:
                start = min(max(t + shift, first), first + step * (value.shape[0] - 1))
                c, _ = _find_second(burst_data, start, weaker, coarse, seen, table, room)
                if c < 0:
                    continue
                t1, t2, q = _climb(burst_data, start, first + step * coarse[c], weaker, table, room)
                if q > most:
                    most, at1, at2 = q, t1, t2
            if kind == 1:
                out[burst, 10] = most
                break
            out[burst, 9] = most
            out[burst, 3], out[burst, 4] = at1, at2
            if most < 0.0:
                out[burst, 5:9], out[burst, 11] = np.nan, 1.0
                continue
            _interpolate_vector(at1, first, step, value, slope, room[0])
            _interpolate_vector(at2, first, step, value, slope, room[1])
            g11, g22, g12 = (
                _project(burst_data, room[0], room[2]),
                _project(burst_data, room[1], room[3]),
                np.sum(room[0] * room[1]),
            )
            _, out[burst, 5], out[burst, 6] = _explain_pair(room[2], room[3], g11, g22, g12)
            i11, i22, i12, out[burst, 11] = _information(burst_data, at1, at2, table, room)
            det = i11 * i22 - i12 * i12
            sure = det > 1e-9 * abs(i11 * i22) and i11 > 0.0
            out[burst, 7] = i22 / det if sure else np.inf
            out[burst, 8] = i11 / det if sure else np.inf
