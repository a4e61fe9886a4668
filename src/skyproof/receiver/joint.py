"""Several signals of one satellite within a chip and a half, followed together by one filter.

Loops of their own see the sum: each is pulled by the other, and within half a chip there is one peak. Here all signals
are states of one extended Kalman filter whose measurement is the whole correlation function, so that what one signal
does to the other is part of the model (Gauss and Newton iterated about the estimate: Bell and Cathey, IEEE Trans.
Automatic Control 38(2), 1993). Noise between taps is whitened by `decomposition.fit.Dictionary`.

A measurement is a few looks: correlators over some code periods each, in whitened coordinates, divided by the noise of
one, so that it is white of variance one. A signal of amplitude a, Doppler f and delay tau shows in the look at time t

    a exp(i 2 pi (f t + g t^2 / 2)) sinc(f T) D(tau),    T the length of a look, g the Doppler's rate.

Doppler and delay are those beside a replica that moves as its carrier does; the delay of a signal goes with its Doppler
besides, as code and carrier belong together, and with a rate of its own, since an attacker need not keep that.

Leading axes (...) are channels: all with the same number n of signals are worked on at once. Delays are in chips, later
positive.
"""

from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Complexes, Reals
from skyproof.decomposition.fit import Dictionary
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.receiver import joint_kernels as k
from skyproof.receiver.joint_kernels import CHIPS, CHIPS_S, HZ, HZ_S, IM, N_FITTED, N_STATE, RE

__all__ = [
    "CHIPS",
    "CHIPS_S",
    "HZ",
    "HZ_S",
    "IM",
    "N_FITTED",
    "N_STATE",
    "RE",
    "Joint",
    "JointSettings",
    "Row",
    "bound",
    "carried",
    "fit_row",
    "follow",
    "normal_equations",
    "predict",
    "signals_in",
    "turns",
]


@dataclass(frozen=True, kw_only=True)
class JointSettings:
    """What moves signals, as densities of random walks: squares of the named roots, a second.

    Common to all signals of a satellite, with the receiver and its clock (a TCXO; 1 g a second), and of each alone.
    """

    common_phase_cyc: float = 0.01
    common_hz: float = 1.0
    common_hz_s: float = 8.0
    own_phase_cyc: float = 0.01
    own_hz: float = 0.1
    own_hz_s: float = 0.3
    own_amplitude: float = 0.2  # relative
    own_chips: float = 5e-4
    own_chips_s: float = 2e-3
    chips_per_cycle: float = GPS_L1_CA.chip_rate_hz / GPS_L1_CA.carrier_hz


@dataclass(frozen=True, eq=False, kw_only=True)
class Joint:
    """State of the filter: n signals a channel.

    mean : (..., n, N_STATE) amplitude (in-phase and quadrature, in sigmas of the noise of a look), Doppler, its rate,
        delay, the delay's own rate. covariance : (..., n N_STATE, n N_STATE).
    settings : of the motion.
    """

    mean: Reals
    covariance: Reals
    settings: JointSettings = field(default_factory=JointSettings)

    @property
    def amplitude(self) -> Complexes:
        """(..., n), complex."""
        return np.asarray(self.mean[..., RE] + 1j * self.mean[..., IM])

    def sigma(self, column: int) -> Reals:
        """Standard deviation of a column of the state, (..., n)."""
        variance = np.diagonal(self.covariance, axis1=-2, axis2=-1)[..., column::N_STATE]
        return np.sqrt(np.maximum(variance, 0.0))

    def apart(self) -> tuple[Reals, Reals]:
        """By how much the last signal is later than the first (...), and its standard deviation."""
        last = self.covariance.shape[-1] - N_STATE + CHIPS
        p = self.covariance
        variance = p[..., CHIPS, CHIPS] + p[..., last, last] - 2.0 * p[..., CHIPS, last]
        return self.mean[..., -1, CHIPS] - self.mean[..., 0, CHIPS], np.sqrt(np.maximum(variance, 0.0))


# Measuring ------------------------------------------------------------------------------------------------------------


def signals_in(mean: Reals, times_s: Reals, look_s: float, dictionary: Dictionary) -> Complexes:
    """What signals (..., n, N_STATE) show in looks (..., n_looks, d) at times from the state's own."""
    turn = turns(mean, times_s, look_s) * (mean[..., RE] + 1j * mean[..., IM])[..., None]
    value, _ = dictionary.at(mean[..., CHIPS])
    return np.asarray(np.swapaxes(turn, -1, -2) @ value)


def turns(mean: Reals, times_s: Reals, look_s: float) -> Complexes:
    """By what each signal (..., n, N_STATE) has turned in each look, and what is left of it, (..., n, n_looks)."""
    hz, hz_s = mean[..., HZ, None], mean[..., HZ_S, None]
    cycles = hz * times_s + 0.5 * hz_s * times_s**2
    return np.asarray(np.exp(2j * np.pi * cycles) * np.sinc(hz * look_s))


def normal_equations(
    looks: Complexes, times_s: Reals, look_s: float, mean: Reals, dictionary: Dictionary
) -> tuple[Reals, Reals, Reals]:
    """Fisher information (..., n N_FITTED, n N_FITTED), score (..., n N_FITTED) and misfit (...) of looks at `mean`.

    looks : (..., n_looks, d). The misfit is the energy that the signals do not explain: n_looks d on average at the
    truth.
    """
    leading, p = mean.shape[:-2], mean.shape[-2] * N_FITTED
    at = _flat(mean, 2)
    information, score, misfit = np.empty((len(at), p, p)), np.empty((len(at), p)), np.empty(len(at))
    k.equations(_flat(looks, 2), times_s, look_s, at, dictionary.table, information, score, misfit)
    return information.reshape(*leading, p, p), score.reshape(*leading, p), misfit.reshape(leading)


def _flat(values: NDArray[Any], last: int) -> NDArray[Any]:
    """Contiguous, with one leading axis before the last ones, for kernels."""
    return np.ascontiguousarray(values).reshape(-1, *values.shape[values.ndim - last :])


# The filter -----------------------------------------------------------------------------------------------------------


def carried(mean: Reals, dt_s: float, chips_per_cycle: float) -> Reals:
    """States (..., n, N_STATE) as they were or will be, `dt_s` from now, if nothing disturbs them."""
    cycles = mean[..., HZ] * dt_s + 0.5 * mean[..., HZ_S] * dt_s**2
    moved = (mean[..., RE] + 1j * mean[..., IM]) * np.exp(2j * np.pi * cycles)
    new = mean.copy()
    new[..., RE], new[..., IM] = moved.real, moved.imag
    new[..., HZ] += mean[..., HZ_S] * dt_s
    new[..., CHIPS] += mean[..., CHIPS_S] * dt_s - chips_per_cycle * cycles
    return new


def predict(joint: Joint, dt_s: float) -> Joint:
    """The state `dt_s` later."""
    mean, covariance = _flat(joint.mean, 2).copy(), _flat(joint.covariance, 2).copy()
    for one, spread in zip(mean, covariance, strict=True):
        k.predict_one(one, spread, dt_s, *_motion(joint.settings, dt_s))
    return replace(joint, mean=mean.reshape(joint.mean.shape), covariance=covariance.reshape(joint.covariance.shape))


def follow(
    joint: Joint, looks: Complexes, times_s: Reals, look_s: float, bit_s: float, dictionary: Dictionary
) -> tuple[Joint, Reals]:
    """The state after the looks (..., bits, n_looks, d) of data bits that come next, at its last one's middle.

    times_s : (n_looks,) of a bit's looks, about its middle. A bit's sign is that which the prediction makes the
    likelier; where neither is, nothing is learned.

    Returns the state, and the signs (..., bits): 1, -1, or 0 where it is not known.
    """
    mean, covariance = _flat(joint.mean, 2).copy(), _flat(joint.covariance, 2).copy()
    signs = np.empty((len(mean), looks.shape[-3]))
    motion = _motion(joint.settings, bit_s)
    k.follow(_flat(looks, 3), times_s, look_s, bit_s, mean, covariance, dictionary.table, *motion, signs)
    after = replace(joint, mean=mean.reshape(joint.mean.shape), covariance=covariance.reshape(joint.covariance.shape))
    return after, signs.reshape(looks.shape[:-2])


@lru_cache(maxsize=64)
def _motion(s: JointSettings, dt: float) -> tuple[Reals, Reals, Reals]:
    """What moves signals over `dt`, as kernels take it: each alone but by its carrier; carriers of all, and of each."""
    alone = np.array([s.own_amplitude, s.own_chips, s.own_chips_s, s.chips_per_cycle])
    common = _walk(dt, s.common_phase_cyc, s.common_hz, s.common_hz_s)
    return alone, common, _walk(dt, s.own_phase_cyc, s.own_hz, s.own_hz_s)


def _walk(dt: float, phase_cyc: float, hz: float, hz_s: float) -> Reals:
    """Covariance (3, 3) of phase, frequency and its rate after white noise has moved each for `dt`."""
    jerk = [[dt**5 / 20, dt**4 / 8, dt**3 / 6], [dt**4 / 8, dt**3 / 3, dt**2 / 2], [dt**3 / 6, dt**2 / 2, dt]]
    drift = [[dt**3 / 3, dt**2 / 2, 0.0], [dt**2 / 2, dt, 0.0], [0.0, 0.0, 0.0]]
    walk = np.diag([dt, 0.0, 0.0])
    return np.asarray(hz_s**2 * np.array(jerk) + hz**2 * np.array(drift) + phase_cyc**2 * walk)


# Rows -----------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, kw_only=True)
class Row:
    """Signals as a stretch of looks alone shows them, at its middle: white from row to row.

    mean : (..., n, N_STATE). covariance : (..., n N_FITTED, n N_FITTED), the Cramer-Rao bound there; infinite where the
    looks do not determine the signals. misfit : (...) energy left.
    """

    mean: Reals
    covariance: Reals
    misfit: Reals

    def sigma(self, column: int) -> Reals:
        """Standard deviation of a fitted column of the state, (..., n)."""
        return np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1)[..., column::N_FITTED])


def fit_row(
    looks: Complexes, times_s: Reals, look_s: float, start: Reals, dictionary: Dictionary, *, steps: int = 6
) -> Row:
    """Least squares (Levenberg and Marquardt) of looks (..., n_looks, d) whose data bits are wiped off.

    start : (..., n, N_STATE) at time 0, near enough that phases are right within a quarter of a cycle.
    """
    leading, p = start.shape[:-2], start.shape[-2] * N_FITTED
    mean = _flat(start, 2).copy()
    information, misfit = np.empty((len(mean), p, p)), np.empty(len(mean))
    k.fit_rows(_flat(looks, 2), times_s, look_s, mean, dictionary.table, steps, information, misfit)
    covariance = _inverse(information.reshape(*leading, p, p))
    return Row(mean=mean.reshape(start.shape), covariance=covariance, misfit=misfit.reshape(leading))


def bound(mean: Reals, times_s: Reals, look_s: float, dictionary: Dictionary) -> Reals:
    """Cramer-Rao bound (..., n N_FITTED, n N_FITTED) of signals (..., n, N_STATE) from looks at these times."""
    nothing = np.zeros((*mean.shape[:-2], times_s.size, dictionary.value.shape[1]), np.complex128)
    return _inverse(normal_equations(nothing, times_s, look_s, mean, dictionary)[0])


def _inverse(information: Reals) -> Reals:
    """Inverse of symmetric matrices; infinite where they have none to speak of."""
    scale = np.sqrt(np.maximum(np.diagonal(information, axis1=-2, axis2=-1), 1e-300))
    even = information / (scale[..., :, None] * scale[..., None, :])
    values, vectors = np.linalg.eigh(even)
    sound = values[..., 0] > 1e-10
    values = np.where(sound[..., None], values, 1.0)
    inverse = (vectors / values[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    inverse = inverse / (scale[..., :, None] * scale[..., None, :])
    return np.asarray(np.where(sound[..., None, None], inverse, np.inf))
