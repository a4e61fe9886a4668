"""Decompose one correlation function into the signals that it is the sum of.

After S. Ahmed, S. Khanafseh, B. Pervan, "GNSS Spoofing Detection and Exclusion by Decomposition of Complex Cross
Ambiguity Function (DCCAF) with INS Aiding", ION. The model is in `correlation`. What is done differently from the
paper, beside the band's R:

- Noise on the grid is not white: E[v1 v2*] = s^2 R(tau1 - tau2) sinc(pi (f1 - f2) T). It is whitened first, which at 25
  Msps divides the error by four.
- Amplitudes are linear, so only delays (and Dopplers) are searched: all pairs on a grid, then variable projection
  (Golub and Pereyra, SIAM J. Numer. Anal. 10(2), 1973; Kaufman, BIT 15, 1975). The swarm is in
  `studies.swarm`.
- How many signals there are is a test with a law of its own (`studies.decomposition_laws`): the second amplitude is
  never near zero.

Leading axes are free. Delays are in chips, larger for a longer way.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg

from skyproof.arrays import Complexes, Reals
from skyproof.decomposition.correlation import correlation, correlation_slope
from skyproof.decomposition.kernels import fit_all
from skyproof.gnss.signals import SignalPlan

__all__ = [
    "Decomposition",
    "Dictionary",
    "bins_dictionary",
    "combine_bins",
    "decompose",
    "doppler_grid",
    "invert_information",
    "one_doppler",
    "sinc_slope",
    "taps_dictionary",
]

_CODE_NULLS = 1e-7  # of the largest eigenvalue: below, the code has no power there
_COARSE_CHIPS = 0.02
_COARSE_BAND = 29.3  # cycles per chip, two-sided; of a narrower band a hundredth of a chip is fine enough
_COARSE_HZ = 2.0


# Dictionaries ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, kw_only=True)
class Dictionary:
    """What a signal looks like in white noise, by delay or by Doppler: a table, with its slope, on an even grid.

    whiten : (d, m) from the m taps, blocks or bins to coordinates in which noise is white and signals are all there is.
    value, slope : (g, d), real for delays. grid : (g,) chips or Hz. points : (m,) of the taps, blocks or bins.
    """

    points: Reals
    whiten: NDArray[np.inexact]
    grid: Reals
    value: NDArray[np.inexact]
    slope: NDArray[np.inexact]
    band_hz: float = 0.0

    @property
    def table(self) -> tuple[float, float, NDArray[np.inexact], NDArray[np.inexact]]:
        step = float(self.grid[1] - self.grid[0])
        return float(self.grid[0]), step, self.value, self.slope

    def at(self, x: ArrayLike) -> tuple[NDArray[np.inexact], NDArray[np.inexact]]:
        """Interpolate the vectors at delays or Dopplers (...) and their derivatives, (..., d), by cubic Hermites.

        Beyond the grid the cubic of its last cell continues.
        """
        first, step, value, slope = self.table
        place = (np.asarray(x, np.float64) - first) / step
        i = np.clip(np.floor(place).astype(np.int64), 0, value.shape[0] - 2)
        u = (place - i)[..., None]
        v0, v1, s0, s1 = value[i], value[i + 1], step * slope[i], step * slope[i + 1]
        along = u * (1.0 - u)
        vector = (
            (1.0 + 2.0 * u) * (1.0 - u) ** 2 * v0 + u * u * (3.0 - 2.0 * u) * v1 + along * ((1.0 - u) * s0 - u * s1)
        )
        derivative = 6.0 * along * (v1 - v0) + (1.0 - u) * (1.0 - 3.0 * u) * s0 + u * (3.0 * u - 2.0) * s1
        return vector, derivative / step


@lru_cache(maxsize=32)
def taps_dictionary(
    taps_chips: tuple[float, ...], band_hz: float, signal: SignalPlan, *, window_chips: float = 1.3
) -> Dictionary:
    """Build a dictionary of taps anywhere, for delays within `window_chips`.

    band_hz : two-sided, of the front end.
    """
    taps = np.array(taps_chips)
    # Hermite's error stays below 1e-3 of the highest frequency.
    step = 0.01 if band_hz < _COARSE_BAND * signal.chip_rate_hz else 0.005
    grid = np.asarray(step * np.arange(-round(window_chips / step), round(window_chips / step) + 1), np.float64)
    lag = taps[:, None] - grid
    whiten = _whitening(correlation(taps[:, None] - taps, band_hz, signal))
    value, slope = whiten @ correlation(lag, band_hz, signal), -whiten @ correlation_slope(lag, band_hz, signal)
    basis, size, _ = np.linalg.svd(value, full_matrices=False)
    basis = basis[:, size > 1e-7 * size[0]]
    return Dictionary(
        points=taps,
        whiten=basis.T @ whiten,
        grid=grid,
        value=np.ascontiguousarray((basis.T @ value).T),
        slope=np.ascontiguousarray((basis.T @ slope).T),
        band_hz=band_hz,
    )


def one_doppler() -> Dictionary:
    """Build a dictionary for a known Doppler of zero: one coordinate, whatever the Doppler."""
    ones = np.ones((2, 1), np.complex128)
    return Dictionary(
        points=np.zeros(1),
        whiten=np.ones((1, 1), np.complex128),
        grid=np.array([0.0, 1.0]),
        value=ones,
        slope=0.0 * ones,
    )


def bins_dictionary(coherent_s: float, bins_hz: ArrayLike, *, within_hz: float) -> Dictionary:
    """Build a dictionary of the Doppler bins of a grid, phases at mid-interval.

    The noise of bins is correlated as sinc(pi (f1 - f2) T).
    """
    bins = np.atleast_1d(np.asarray(bins_hz, np.float64))
    whiten = _whitening(np.sinc((bins[:, None] - bins) * coherent_s)).astype(np.complex128)
    grid = doppler_grid(within_hz)
    x = (grid[:, None] - bins) * coherent_s
    return Dictionary(
        points=bins, whiten=whiten, grid=grid, value=np.sinc(x) @ whiten.T, slope=sinc_slope(x) * coherent_s @ whiten.T
    )


def doppler_grid(within_hz: float) -> Reals:
    """List the Dopplers of a dictionary, every 1 Hz."""
    return np.asarray(np.arange(-np.ceil(within_hz), np.ceil(within_hz) + 1.0), np.float64)


def sinc_slope(x: Reals) -> Reals:
    """Compute the derivative of sin(pi x) / (pi x)."""
    small = np.abs(x) < 1e-4
    safe = np.where(small, 1.0, x)
    return np.asarray(np.where(small, -(np.pi**2) * x / 3.0, (np.cos(np.pi * safe) - np.sinc(safe)) / safe))


def _whitening(covariance: Reals) -> Reals:
    values, vectors = linalg.eigh(covariance)
    kept = values > _CODE_NULLS * values[-1]
    return np.asarray((vectors[:, kept] / np.sqrt(values[kept])).T)


# Fitting --------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, kw_only=True)
class Decomposition:
    """n signals in order of their delays. Leading axes (...) are those of the taps.

    delay_chips, doppler_hz : (..., n). amplitude : (..., n) complex, phase at mid-interval.
    captured : (...) energy in the signals, in units of the noise's variance.
    covariance : (..., p, p) of the delays and, if they were fitted, the Dopplers, p = n or 2 n; the amplitudes are
        unknown, too. That of a linear model around the estimate: the Cramer-Rao bound there. It holds only if all n
        signals exist: count first.
    """

    delay_chips: Reals
    doppler_hz: Reals
    amplitude: Complexes
    captured: Reals
    covariance: Reals


def decompose(
    taps: ArrayLike,
    delays: Dictionary,
    dopplers: Dictionary | None = None,
    *,
    signals: int = 2,
    noise_variance: ArrayLike = 1.0,
    search_hz: float = 50.0,
) -> Decomposition:
    """Estimate the delays, Dopplers and amplitudes of `signals` signals that together explain most.

    The method is variable projection.

    Parameters
    ----------
    taps : (..., m) complex, at `delays.points`; (..., blocks or bins, m) with `dopplers`.
    dopplers : such as `bins_dictionary` to fit a Doppler to each signal; None if they are known and
        wiped off.
    noise_variance : (...) E|v|^2 of a tap (of the whole interval's mean).
    search_hz : a common Doppler is first looked for up to here, every 2 Hz.

    Raises
    ------
    ValueError : the taps do not fit the dictionary.
    """
    z = np.asarray(taps, np.complex128)
    doppler = one_doppler() if dopplers is None else dopplers
    if dopplers is None:
        z = z[..., None, :]
    if z.shape[-2:] != (doppler.whiten.shape[1], delays.whiten.shape[1]):
        raise ValueError(
            f"taps have shape {z.shape[-2:]} at the end, the dictionaries "
            f"({doppler.whiten.shape[1]}, {delays.whiten.shape[1]})"
        )
    shape = z.shape[:-2]
    sigma = np.sqrt(np.broadcast_to(np.asarray(noise_variance, np.float64), shape)).reshape(-1)
    white = (doppler.whiten @ z @ delays.whiten.T).reshape(-1, doppler.whiten.shape[0], delays.whiten.shape[0])
    white = np.ascontiguousarray(white / sigma[:, None, None])
    trials, fitted = len(white), dopplers is not None
    p = 2 * signals if fitted else signals
    where, amplitude = np.zeros((trials, p)), np.zeros((trials, signals), np.complex128)
    captured, information = np.zeros(trials), np.zeros((trials, p, p))
    coarse = np.arange(0, delays.grid.size, round(_COARSE_CHIPS / (delays.grid[1] - delays.grid[0])))
    gram = delays.value[coarse] @ delays.value[coarse].T
    reach = min(search_hz, float(doppler.grid[-1])) if fitted else 0.0
    f_coarse = np.arange(-np.floor(reach / _COARSE_HZ), np.floor(reach / _COARSE_HZ) + 1.0) * _COARSE_HZ
    fit_all(
        white,
        signals,
        delays.table,
        doppler.table,
        coarse,
        gram,
        f_coarse,
        fitted,
        where,
        amplitude,
        captured,
        information,
    )
    order = np.argsort(where[:, :signals], axis=1)
    parameters = np.concatenate((order, order + signals), axis=1)[:, :p]
    where = np.take_along_axis(where, parameters, axis=1)
    information = np.take_along_axis(
        np.take_along_axis(information, parameters[:, :, None], 1), parameters[:, None, :], 2
    )
    hertz = where[:, signals:] if fitted else np.zeros((trials, signals))
    amplitude = np.take_along_axis(amplitude, order, axis=1) * sigma[:, None]
    return Decomposition(
        delay_chips=where[:, :signals].reshape(*shape, signals),
        doppler_hz=hertz.reshape(*shape, signals),
        amplitude=amplitude.reshape(*shape, signals),
        captured=captured.reshape(shape),
        covariance=invert_information(information).reshape(*shape, p, p),
    )


def combine_bins(
    grid: ArrayLike, delays: Dictionary, bins_hz: ArrayLike, coherent_s: float
) -> tuple[Complexes, Reals, Reals]:
    """Combine all bins of a grid (..., bins, m) into taps (..., m) at the strongest signal's Doppler.

    Returns the taps, the factor (...) by which their noise's variance exceeds that of one bin, and the Doppler (...).
    The combination has no bias and the least noise (Gauss and Markov), so a reference that is off by some hertz costs
    nothing. Delay and Doppler are orthogonal at mid-interval: laws of delays at a known Doppler still hold.
    """
    z = np.asarray(grid, np.complex128)
    bins = np.atleast_1d(np.asarray(bins_hz, np.float64))
    within_hz = float(np.max(np.abs(bins))) + 0.5 / coherent_s
    dopplers = bins_dictionary(coherent_s, bins, within_hz=within_hz)
    strongest = decompose(z, delays, dopplers, signals=1, search_hz=within_hz).doppler_hz
    seen = np.sinc((strongest - bins) * coherent_s) @ dopplers.whiten.T  # (..., whitened bins), real in fact
    energy = np.sum(np.abs(seen) ** 2, axis=-1)
    taps = np.sum(np.conj(seen)[..., None] * (dopplers.whiten @ z), axis=-2) / energy[..., None]
    return np.asarray(taps), np.asarray(1.0 / energy), np.asarray(strongest[..., 0])


def invert_information(information: Reals) -> Reals:
    """Invert an information matrix, halved for complex noise of variance one.

    The covariance is infinite where a parameter is not determined.
    """
    scale = np.sqrt(np.maximum(np.diagonal(information, axis1=-2, axis2=-1), 1e-300))
    even = information / (scale[..., :, None] * scale[..., None, :])
    determined = np.linalg.det(even) > 1e-12
    safe = np.where(determined[..., None, None], even, np.eye(information.shape[-1]))
    covariance = 0.5 * np.linalg.inv(safe) / (scale[..., :, None] * scale[..., None, :])
    return np.asarray(np.where(determined[..., None, None], covariance, np.inf))
