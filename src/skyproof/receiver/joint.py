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

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Complexes, Integers, Reals
from skyproof.decomposition.fit import Dictionary
from skyproof.gnss.signals import GPS_L1_CA

__all__ = [
    "Joint",
    "JointSettings",
    "Row",
    "bound",
    "carried",
    "fit_row",
    "normal_equations",
    "predict",
    "projected",
    "signals_in",
    "update",
]

# Of the state of a signal.
RE, IM, HZ, HZ_S, CHIPS, CHIPS_S = range(6)
N_STATE = 6
N_FITTED = 5  # of those in a row; a delay's own rate shows over longer times only

STEPS = 4
LONGEST_CHIPS = 0.1
NEAR_CHIPS = 3e-4
SURE = 4.0
"""Least log-likelihood ratio between the signs of a data bit that wipes it off: of 100 bits two would be wrong."""


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


# Which power of time and which of value and slope stand beside each fitted parameter.
_TO_SECOND = np.arange(3)
_POWER = np.array([0, 0, 1, 2, 0])
_SLOPE = np.array([0, 0, 0, 0, 1])


def normal_equations(
    looks: Complexes, times_s: Reals, look_s: float, mean: Reals, dictionary: Dictionary
) -> tuple[Reals, Reals, Reals]:
    """Fisher information (..., n N_FITTED, n N_FITTED), score (..., n N_FITTED) and misfit (...) of looks at `mean`.

    looks : (..., n_looks, d). The misfit is the energy that the signals do not explain: n_looks d on average at the
    truth. Every inner product is one over looks times one over delays.
    """
    amplitude = mean[..., RE] + 1j * mean[..., IM]
    n = mean.shape[-2]
    turn = turns(mean, times_s, look_s)
    both = np.concatenate(dictionary.at(mean[..., CHIPS]), axis=-2)  # (..., 2 n, d): values, then slopes
    # Matrix products and not einsum: looking for the best order would take longer than the sums.
    space = both @ np.swapaxes(both, -1, -2)
    timed = (turn[..., None, :, :] * times_s ** _TO_SECOND[:, None, None]).conj()  # (..., 3, n, n_looks)
    flat = timed.reshape(*turn.shape[:-2], 3 * n, times_s.size)
    along = looks @ np.swapaxes(both, -1, -2)  # (..., n_looks, 2 n)
    seen = (flat @ along).reshape(*turn.shape[:-2], 3, n, 2, n)[..., range(n), :, range(n)]  # (n, ..., 3, 2)
    seen = np.moveaxis(seen, 0, -1)  # (..., 3, 2, n)
    time = (flat @ np.swapaxes(flat.conj(), -1, -2)).reshape(*turn.shape[:-2], 3, n, 3, n)
    space = space.reshape(*turn.shape[:-2], 2, n, 2, n)
    c = _coefficients(amplitude)  # (..., n, N_FITTED)
    # Every parameter is a power of time, and value or slope: (..., q, n, r, m).
    pairs = time[..., _POWER, :, :, :][..., _POWER, :] * space[..., _SLOPE, :, :, :][..., _SLOPE, :]
    each = np.moveaxis(c, -1, -2)  # (..., N_FITTED, n)
    inner = (each.conj()[..., None, None] * each[..., None, None, :, :] * pairs).real
    # Of the signals themselves, to be subtracted: the product with their amplitudes.
    own = (pairs[..., 0, :] @ amplitude[..., None, :, None])[..., 0]  # (..., N_FITTED, n)
    left = seen[..., _POWER, _SLOPE, :] - own
    score = 2.0 * (each.conj() * left).real
    misfit = np.sum(np.abs(looks) ** 2, axis=(-2, -1)) - np.sum(
        (amplitude.conj() * (2.0 * seen[..., 0, 0, :] - own[..., 0, :])).real, axis=-1
    )
    size = n * N_FITTED
    inner = np.moveaxis(inner, (-4, -2), (-3, -1)).reshape(*turn.shape[:-2], size, size)
    return 2.0 * inner, np.moveaxis(score, -2, -1).reshape(*turn.shape[:-2], size), misfit


def projected(
    mean: Reals, times_s: Reals, look_s: float, dictionary: Dictionary, turn: Complexes, value: NDArray[np.inexact]
) -> Complexes:
    """Inner products of what signals (..., n, N_STATE) would change, parameter by parameter, with vectors of a grid.

    turn : (f, n_looks). value : (u, d). Gives (..., f, u, n N_FITTED).
    """
    amplitude = mean[..., RE] + 1j * mean[..., IM]
    both = np.stack(dictionary.at(mean[..., CHIPS]), axis=-3)  # (..., 2, n, d)
    space = both @ value.T  # (..., 2, n, u)
    own = turns(mean, times_s, look_s).conj()[..., None, :, :] * (times_s ** np.arange(3)[:, None])[:, None, :]
    time = own @ turn.T  # (..., 3, n, f)
    c = np.moveaxis(_coefficients(amplitude).conj(), -1, -2)  # (..., N_FITTED, n)
    each = c[..., None] * time[..., _POWER, :, :]  # (..., N_FITTED, n, f)
    inner = np.einsum("...qnf,...qnu->...funq", each, space[..., _SLOPE, :, :], optimize=True)
    return np.asarray(inner.reshape(*inner.shape[:-2], -1))


def _coefficients(amplitude: Complexes) -> Complexes:
    one = np.ones_like(amplitude)
    return np.stack([one, 1j * one, 2j * np.pi * amplitude, 1j * np.pi * amplitude, amplitude], axis=-1)


def _of_states(n: int) -> Integers:
    """Where the fitted parameters of n signals stand among their states: of the others a look shows nothing."""
    return (np.arange(n)[:, None] * N_STATE + np.arange(N_FITTED)).ravel()


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
    mean, n, s = joint.mean, joint.mean.shape[-2], joint.settings
    rho = s.chips_per_cycle
    turn = np.exp(2j * np.pi * (mean[..., HZ] * dt_s + 0.5 * mean[..., HZ_S] * dt_s**2))
    new, moved = carried(mean, dt_s, rho), joint.amplitude * turn
    step = np.zeros((*mean.shape[:-1], N_STATE, N_STATE))
    step[..., range(N_STATE), range(N_STATE)] = 1.0
    step[..., RE, RE], step[..., RE, IM] = turn.real, -turn.imag
    step[..., IM, RE], step[..., IM, IM] = turn.imag, turn.real
    for column, by_hz in ((HZ, dt_s), (HZ_S, 0.5 * dt_s**2)):
        step[..., RE, column], step[..., IM, column] = _turned(moved, by_hz)
        step[..., CHIPS, column] = -rho * by_hz
    step[..., HZ, HZ_S] = step[..., CHIPS, CHIPS_S] = dt_s
    # Block by block: states of different signals are moved by different matrices.
    p = joint.covariance.reshape(*joint.covariance.shape[:-2], n, N_STATE, n, N_STATE)
    p = np.moveaxis(p, -2, -3)  # (..., n, n, N_STATE, N_STATE)
    p = step[..., :, None, :, :] @ p @ np.swapaxes(step, -1, -2)[..., None, :, :, :] + _noise(moved, dt_s, s)
    return replace(joint, mean=new, covariance=np.moveaxis(p, -2, -3).reshape(joint.covariance.shape))


def _turned(amplitude: Complexes, cycles: float) -> tuple[Reals, Reals]:
    """Change of amplitude by so small a turn."""
    return -2.0 * np.pi * cycles * amplitude.imag, 2.0 * np.pi * cycles * amplitude.real


def _noise(amplitude: Complexes, dt: float, s: JointSettings) -> Reals:
    """Covariance of what the random walks added, (..., n, n, N_STATE, N_STATE)."""
    n = amplitude.shape[-1]
    into = np.zeros((*amplitude.shape, N_STATE, 3))  # of phase (cycles), Doppler, its rate
    into[..., RE, 0], into[..., IM, 0] = _turned(amplitude, 1.0)
    into[..., HZ, 1] = into[..., HZ_S, 2] = 1.0
    common = _walk(dt, s.common_phase_cyc, s.common_hz, s.common_hz_s)
    own = _walk(dt, s.own_phase_cyc, s.own_hz, s.own_hz_s)
    back = np.swapaxes(into, -1, -2)
    q = into[..., :, None, :, :] @ common @ back[..., None, :, :, :]
    alone = into @ own @ back
    fading = s.own_amplitude * np.sqrt(dt) * np.stack([amplitude.real, amplitude.imag], axis=-1)
    alone[..., :2, :2] += fading[..., :, None] * fading[..., None, :]
    alone[..., CHIPS:, CHIPS:] += s.own_chips_s**2 * np.array([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]])
    alone[..., CHIPS, CHIPS] += s.own_chips**2 * dt
    q[..., range(n), range(n), :, :] += alone
    return np.asarray(q)


@lru_cache(maxsize=64)
def _walk(dt: float, phase_cyc: float, hz: float, hz_s: float) -> Reals:
    """Covariance (3, 3) of phase, frequency and its rate after white noise has moved each for `dt`."""
    jerk = [[dt**5 / 20, dt**4 / 8, dt**3 / 6], [dt**4 / 8, dt**3 / 3, dt**2 / 2], [dt**3 / 6, dt**2 / 2, dt]]
    drift = [[dt**3 / 3, dt**2 / 2, 0.0], [dt**2 / 2, dt, 0.0], [0.0, 0.0, 0.0]]
    walk = np.diag([dt, 0.0, 0.0])
    return np.asarray(hz_s**2 * np.array(jerk) + hz**2 * np.array(drift) + phase_cyc**2 * walk)


def update(
    joint: Joint, looks: Complexes, times_s: Reals, look_s: float, dictionary: Dictionary
) -> tuple[Joint, Reals]:
    """The state after the looks (..., n_looks, d) of one data bit, at times from the state's own.

    The bit's sign is that which the prediction makes the likelier; where neither is, nothing is learned.

    Returns the state, and the sign (...): 1, -1, or 0 where it is not known.
    """
    n = joint.mean.shape[-2]
    expected = signals_in(joint.mean, times_s, look_s, dictionary)
    agreement = np.sum((expected.conj() * looks).real, axis=(-2, -1))
    sign = np.where(4.0 * np.abs(agreement) > SURE, np.sign(agreement), 0.0)
    wiped = sign[..., None, None] * looks
    known = (sign != 0.0)[..., None]
    p, mean, fitted = joint.covariance, joint.mean, _of_states(n)
    for _ in range(STEPS):
        information, score, _ = normal_equations(wiped, times_s, look_s, mean, dictionary)
        wide, right = np.zeros_like(p), np.zeros(p.shape[:-1])
        wide[..., fitted[:, None], fitted], right[..., fitted] = information * known[..., None], score * known
        gone = (mean - joint.mean).reshape(*mean.shape[:-2], -1)
        right += (wide @ gone[..., None])[..., 0]
        system = np.eye(n * N_STATE) + p @ wide
        change = np.linalg.solve(system, (p @ right[..., None]))[..., 0]
        new = joint.mean + change.reshape(mean.shape)
        step = np.clip(new[..., CHIPS] - mean[..., CHIPS], -LONGEST_CHIPS, LONGEST_CHIPS)
        new[..., CHIPS] = mean[..., CHIPS] + step
        mean = new
        if np.max(np.abs(step), initial=0.0) < NEAR_CHIPS:
            break
    after = np.linalg.solve(system, p)
    even = np.asarray(0.5 * (after + np.swapaxes(after, -1, -2)), np.float64)
    return replace(joint, mean=mean, covariance=even), sign


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
    mean = start.copy()
    information, score, misfit = normal_equations(looks, times_s, look_s, mean, dictionary)
    damping = np.full(misfit.shape, 1e-4)
    for _ in range(steps):
        diagonal = np.diagonal(information, axis1=-2, axis2=-1)
        scale = np.sqrt(np.maximum(diagonal, 1e-12))
        even = information / (scale[..., :, None] * scale[..., None, :])
        even = even + damping[..., None, None] * np.eye(even.shape[-1])
        step = np.linalg.solve(even, (score / scale)[..., None])[..., 0] / scale
        tried = mean.copy()
        tried[..., :N_FITTED] += step.reshape(*mean.shape[:-1], N_FITTED)
        moved = np.clip(tried[..., CHIPS] - mean[..., CHIPS], -LONGEST_CHIPS, LONGEST_CHIPS)
        tried[..., CHIPS] = mean[..., CHIPS] + moved
        new = normal_equations(looks, times_s, look_s, tried, dictionary)
        better = new[2] < misfit
        mean = np.where(better[..., None, None], tried, mean)
        information = np.where(better[..., None, None], new[0], information)
        score, misfit = np.where(better[..., None], new[1], score), np.where(better, new[2], misfit)
        damping = np.where(better, 0.1 * damping, 10.0 * damping)
    return Row(mean=mean, covariance=_inverse(information), misfit=misfit)


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
