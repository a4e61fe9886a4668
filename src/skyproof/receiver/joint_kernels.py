"""Compiled inner loops of `joint`: the filter over data bits, and rows fitted anew.

A signal in looks is a vector over time times a real vector over delays that a table holds (`decomposition`): so every
inner product is one over looks times one over delays, and a step of a filter costs microseconds. A call works on
several channels, each by itself, and holds no lock.
"""

import math

import numpy as np

from skyproof.arrays import Complexes, Reals
from skyproof.compiled import compiled
from skyproof.decomposition.kernels import solve, table_at

__all__ = [
    "dot",
    "equations",
    "fill_coefficients",
    "fill_products",
    "fill_shapes",
    "fill_turns",
    "fit_rows",
    "follow",
    "predict_one",
]

# Of the state of a signal.
RE, IM, HZ, HZ_S, CHIPS, CHIPS_S = range(6)
N_STATE = 6
N_FITTED = 5  # of those in a row; a delay's own rate shows over longer times only

SURE = 4.0
"""Least log-likelihood ratio between the signs of a data bit that wipes it off: of 100 bits two would be wrong."""

_STEPS = 4
_LONGEST_CHIPS = 0.1
_NEAR_CHIPS = 3e-4

# Which power of time and which of value and slope stand beside each fitted parameter.
POWER = np.array([0, 0, 1, 2, 0])
SLOPE = np.array([0, 0, 0, 0, 1])

FAST = {"reassoc", "contract", "nsz"}

Table = tuple[float, float, Reals, Reals]
"""Of a dictionary: first delay, step, values, slopes."""


@compiled
def fill_turns(mean: Reals, times_s: Reals, look_s: float, turn: Complexes) -> None:
    """By what each signal (n, N_STATE) has turned in each look, and what is left of it, (n, n_looks)."""
    for k in range(mean.shape[0]):
        lost = math.pi * mean[k, HZ] * look_s
        left = math.sin(lost) / lost if abs(lost) > 1e-8 else 1.0
        for i in range(times_s.size):
            t = times_s[i]
            angle = 2.0 * math.pi * (mean[k, HZ] * t + 0.5 * mean[k, HZ_S] * t * t)
            turn[k, i] = complex(left * math.cos(angle), left * math.sin(angle))


@compiled
def fill_shapes(chips: Reals, table: Table, space: Reals) -> None:
    """Values and slopes (2, n, d) at delays (n,)."""
    for k in range(chips.size):
        table_at(chips[k], table[0], table[1], table[2], table[3], space[0, k], space[1, k])


@compiled
def fill_coefficients(mean: Reals, c: Complexes) -> None:
    """Of each signal's parameters (n, N_FITTED), beside power of time and value or slope."""
    for k in range(mean.shape[0]):
        a = complex(mean[k, RE], mean[k, IM])
        c[k, 0], c[k, 1] = 1.0, 1.0j
        c[k, 2], c[k, 3] = 2j * math.pi * a, 1j * math.pi * a
        c[k, 4] = a


@compiled(fastmath=FAST)
def fill_products(looks: Complexes, shape: Reals, out: Complexes) -> None:
    """Inner products (n_looks,) of looks (n_looks, d) with a vector of delays."""
    for i in range(looks.shape[0]):
        real, imaginary = 0.0, 0.0
        for m in range(shape.size):
            real += looks[i, m].real * shape[m]
            imaginary += looks[i, m].imag * shape[m]
        out[i] = complex(real, imaginary)


@compiled(fastmath=FAST)
def dot(a: Reals, b: Reals) -> float:
    total = 0.0
    for m in range(a.size):
        total += a[m] * b[m]
    return total


@compiled(fastmath=FAST)
def _energy(looks: Complexes) -> float:
    total = 0.0
    for i in range(looks.shape[0]):
        for m in range(looks.shape[1]):
            total += looks[i, m].real * looks[i, m].real + looks[i, m].imag * looks[i, m].imag
    return total


@compiled
def _equations(
    looks: Complexes,
    energy: float,
    times_s: Reals,
    look_s: float,
    mean: Reals,
    table: Table,
    information: Reals,
    score: Reals,
) -> float:
    """Fills Fisher information (n N_FITTED, n N_FITTED) and score (n N_FITTED,) of looks (n_looks, d) at `mean`.

    energy : of the looks. Returns the misfit, the energy that the signals do not explain.
    """
    n, count, d = mean.shape[0], times_s.size, looks.shape[1]
    turn, space, c = np.empty((n, count), np.complex128), np.empty((2, n, d)), np.empty((n, N_FITTED), np.complex128)
    fill_turns(mean, times_s, look_s, turn)
    fill_shapes(mean[:, CHIPS], table, space)
    fill_coefficients(mean, c)
    # Of the looks: (3 powers of time, value or slope, n).
    seen, along = np.zeros((3, 2, n), np.complex128), np.empty(count, np.complex128)
    for k in range(n):
        for s in range(2):
            fill_products(looks, space[s, k], along)
            for i in range(count):
                one = np.conj(turn[k, i]) * along[i]
                seen[0, s, k] += one
                seen[1, s, k] += one * times_s[i]
                seen[2, s, k] += one * times_s[i] * times_s[i]
    own = np.zeros((N_FITTED, n), np.complex128)  # of the signals themselves, to be subtracted
    time = np.empty(5, np.complex128)
    for k in range(n):
        for m in range(n):
            time[:] = 0.0
            for i in range(count):
                one = np.conj(turn[k, i]) * turn[m, i]
                for power in range(5):
                    time[power] += one
                    one *= times_s[i]
            for q in range(N_FITTED):
                for r in range(N_FITTED):
                    both = time[POWER[q] + POWER[r]] * dot(space[SLOPE[q], k], space[SLOPE[r], m])
                    information[k * N_FITTED + q, m * N_FITTED + r] = 2.0 * (np.conj(c[k, q]) * c[m, r] * both).real
                    if r == 0:
                        own[q, k] += both * complex(mean[m, RE], mean[m, IM])
    explained = 0.0
    for k in range(n):
        for q in range(N_FITTED):
            left = seen[POWER[q], SLOPE[q], k] - own[q, k]
            score[k * N_FITTED + q] = 2.0 * (np.conj(c[k, q]) * left).real
        explained += (complex(mean[k, RE], -mean[k, IM]) * (2.0 * seen[0, 0, k] - own[0, k])).real
    return energy - explained


@compiled
def equations(
    looks: Complexes,
    times_s: Reals,
    look_s: float,
    means: Reals,
    table: Table,
    information: Reals,
    score: Reals,
    misfit: Reals,
) -> None:
    """Fills information (channels, p, p), score (channels, p), misfit (channels,) of looks (channels, n_looks, d)."""
    for one in range(means.shape[0]):
        misfit[one] = _equations(
            looks[one], _energy(looks[one]), times_s, look_s, means[one], table, information[one], score[one]
        )


@compiled
def fit_rows(
    looks: Complexes,
    times_s: Reals,
    look_s: float,
    means: Reals,
    table: Table,
    steps: int,
    information: Reals,
    misfit: Reals,
) -> None:
    """Least squares (Levenberg and Marquardt) of looks (channels, n_looks, d) from `means` (channels, n, N_STATE).

    Moves `means` in place; fills information (channels, p, p) and misfit (channels,) where each ends.
    """
    n = means.shape[1]
    p = n * N_FITTED
    score, new_score, new_information = np.empty(p), np.empty(p), np.empty((p, p))
    scale, even, right = np.empty(p), np.empty((p, p)), np.empty((p, 1))
    for one in range(means.shape[0]):
        mean, energy, known = means[one], _energy(looks[one]), information[one]
        misfit[one] = _equations(looks[one], energy, times_s, look_s, mean, table, known, score)
        damping = 1e-4
        for _ in range(steps):
            for q in range(p):
                scale[q] = math.sqrt(max(known[q, q], 1e-12))
            for q in range(p):
                right[q, 0] = score[q] / scale[q]
                for r in range(p):
                    even[q, r] = known[q, r] / (scale[q] * scale[r])
                even[q, q] += damping
            solvable, step = solve(even, right)
            tried = mean.copy()
            for k in range(n):
                for q in range(N_FITTED):
                    tried[k, q] += step[k * N_FITTED + q, 0] / scale[k * N_FITTED + q]
                moved = tried[k, CHIPS] - mean[k, CHIPS]
                tried[k, CHIPS] = mean[k, CHIPS] + min(max(moved, -_LONGEST_CHIPS), _LONGEST_CHIPS)
            new = _equations(looks[one], energy, times_s, look_s, tried, table, new_information, new_score)
            if solvable and new < misfit[one]:
                mean[:], known[:], score[:], misfit[one] = tried, new_information, new_score, new
                damping *= 0.1
            else:
                damping *= 10.0


# The filter -----------------------------------------------------------------------------------------------------------


@compiled
def predict_one(mean: Reals, covariance: Reals, dt: float, motion: Reals, common: Reals, own: Reals) -> None:
    """One channel's state (n, N_STATE) and covariance (n N_STATE, n N_STATE) `dt` later, in place.

    motion : relative change of amplitude, chips and chips/s of each signal alone, roots of densities; chips a cycle.
    common, own : covariance (3, 3) of what moved phase (cycles), Doppler and its rate of all and of each.
    """
    n = mean.shape[0]
    fading, own_chips, own_chips_s, rho = motion
    step, into = np.zeros((n, N_STATE, N_STATE)), np.zeros((n, N_STATE, 3))
    half = 0.5 * dt * dt
    for k in range(n):
        cycles = mean[k, HZ] * dt + half * mean[k, HZ_S]
        cosine, sine = math.cos(2.0 * math.pi * cycles), math.sin(2.0 * math.pi * cycles)
        real = mean[k, RE] * cosine - mean[k, IM] * sine
        imaginary = mean[k, RE] * sine + mean[k, IM] * cosine
        f = step[k]
        for q in range(N_STATE):
            f[q, q] = 1.0
        f[RE, RE], f[RE, IM], f[IM, RE], f[IM, IM] = cosine, -sine, sine, cosine
        f[RE, HZ], f[IM, HZ], f[CHIPS, HZ] = -2.0 * math.pi * dt * imaginary, 2.0 * math.pi * dt * real, -rho * dt
        f[RE, HZ_S], f[IM, HZ_S] = -2.0 * math.pi * half * imaginary, 2.0 * math.pi * half * real
        f[CHIPS, HZ_S] = -rho * half
        f[HZ, HZ_S] = f[CHIPS, CHIPS_S] = dt
        into[k, RE, 0], into[k, IM, 0] = -2.0 * math.pi * imaginary, 2.0 * math.pi * real
        into[k, HZ, 1] = into[k, HZ_S, 2] = 1.0
        mean[k, RE], mean[k, IM] = real, imaginary
        mean[k, CHIPS] += mean[k, CHIPS_S] * dt - rho * cycles
        mean[k, HZ] += mean[k, HZ_S] * dt
    # Block by block: states of different signals are moved by different matrices.
    moved, noise = np.empty((N_STATE, N_STATE)), np.empty((N_STATE, N_STATE))
    for k in range(n):
        for m in range(n):
            block = covariance[k * N_STATE : (k + 1) * N_STATE, m * N_STATE : (m + 1) * N_STATE]
            _between(step[k], block, step[m], moved)
            _between(into[k], common, into[m], noise)
            block[:] = moved + noise
        block = covariance[k * N_STATE : (k + 1) * N_STATE, k * N_STATE : (k + 1) * N_STATE]
        _between(into[k], own, into[k], noise)
        block += noise
        for q in range(2):
            for r in range(2):
                block[q, r] += fading * fading * dt * mean[k, q] * mean[k, r]
        block[CHIPS, CHIPS] += own_chips_s**2 * dt**3 / 3.0 + own_chips**2 * dt
        block[CHIPS, CHIPS_S] += own_chips_s**2 * half
        block[CHIPS_S, CHIPS] += own_chips_s**2 * half
        block[CHIPS_S, CHIPS_S] += own_chips_s**2 * dt


@compiled
def _between(left: Reals, middle: Reals, right: Reals, out: Reals) -> None:
    """left middle right^T."""
    size, inner = left.shape
    half = np.zeros((size, inner))
    for i in range(size):
        for j in range(inner):
            if left[i, j] != 0.0:
                for m in range(inner):
                    half[i, m] += left[i, j] * middle[j, m]
    for i in range(size):
        for j in range(size):
            total = 0.0
            for m in range(inner):
                total += half[i, m] * right[j, m]
            out[i, j] = total


@compiled
def _agreement(looks: Complexes, times_s: Reals, look_s: float, mean: Reals, table: Table) -> float:
    """Real part of the inner product of looks (n_looks, d) with what the signals would show."""
    n, count = mean.shape[0], times_s.size
    turn, space, along = (
        np.empty((n, count), np.complex128),
        np.empty((2, n, looks.shape[1])),
        np.empty_like(looks[:, 0]),
    )
    fill_turns(mean, times_s, look_s, turn)
    fill_shapes(mean[:, CHIPS], table, space)
    total = 0.0
    for k in range(n):
        fill_products(looks, space[0, k], along)
        for i in range(count):
            total += (np.conj(turn[k, i] * complex(mean[k, RE], mean[k, IM])) * along[i]).real
    return total


@compiled
def _update(looks: Complexes, times_s: Reals, look_s: float, mean: Reals, covariance: Reals, table: Table) -> float:
    """State and covariance after the looks (n_looks, d) of a data bit, in place; the bit's sign, 0 if it is not known.

    The sign is the one that the prediction makes likelier. Gauss and Newton iterated about the estimate.
    """
    agreement = _agreement(looks, times_s, look_s, mean, table)
    if not 4.0 * abs(agreement) > SURE:
        return 0.0
    sign = 1.0 if agreement > 0.0 else -1.0
    wiped = sign * looks
    energy = _energy(wiped)
    n, size, p = mean.shape[0], covariance.shape[0], mean.shape[0] * N_FITTED
    known, score, wide = np.empty((p, p)), np.empty(p), np.zeros((size, size))
    begin, right = mean.copy(), np.zeros(size)
    system, side = np.empty((size, size)), np.empty((size, 1))
    for _ in range(_STEPS):
        _equations(wiped, energy, times_s, look_s, mean, table, known, score)
        for q in range(p):
            i = q // N_FITTED * N_STATE + q % N_FITTED
            right[i] = score[q]
            for r in range(p):
                j = r // N_FITTED * N_STATE + r % N_FITTED
                wide[i, j] = known[q, r]
                right[i] += known[q, r] * (mean[j // N_STATE, j % N_STATE] - begin[j // N_STATE, j % N_STATE])
        for i in range(size):
            side[i, 0] = dot(covariance[i], right)
            for j in range(size):  # the information is symmetric
                system[i, j] = dot(covariance[i], wide[j]) + (1.0 if i == j else 0.0)
        solvable, change = solve(system, side)
        if not solvable:
            mean[:] = begin
            return 0.0
        longest = 0.0
        for k in range(n):
            chips = mean[k, CHIPS]
            for q in range(N_STATE):
                mean[k, q] = begin[k, q] + change[k * N_STATE + q, 0]
            step = min(max(mean[k, CHIPS] - chips, -_LONGEST_CHIPS), _LONGEST_CHIPS)
            mean[k, CHIPS] = chips + step
            longest = max(longest, abs(step))
        if longest < _NEAR_CHIPS:
            break
    _, after = solve(system, covariance)
    for i in range(size):
        for j in range(size):
            covariance[i, j] = 0.5 * (after[i, j] + after[j, i])
    return sign


@compiled
def follow(
    looks: Complexes,
    times_s: Reals,
    look_s: float,
    bit_s: float,
    means: Reals,
    covariances: Reals,
    table: Table,
    motion: Reals,
    common: Reals,
    own: Reals,
    signs: Reals,
) -> None:
    """States (channels, n, N_STATE) from bit to bit of looks (channels, bits, n_looks, d), in place.

    times_s : of a bit's looks, about its middle, where states are. motion, common, own : as in `predict_one`, over a
    bit. signs : (channels, bits), filled.
    """
    for one in range(means.shape[0]):
        for bit in range(looks.shape[1]):
            predict_one(means[one], covariances[one], bit_s, motion, common, own)
            signs[one, bit] = _update(looks[one, bit], times_s, look_s, means[one], covariances[one], table)
