"""Compiled search for one more signal in what a row of looks has left: Rao's score test at every delay and Doppler."""

import numpy as np

from skyproof.arrays import Complexes, Reals
from skyproof.compiled import compiled
from skyproof.decomposition.kernels import table_at
from skyproof.receiver.joint_kernels import (
    CHIPS,
    FAST,
    HZ,
    IM,
    N_FITTED,
    N_STATE,
    POWER,
    RE,
    SLOPE,
    Table,
    dot,
    fill_coefficients,
    fill_products,
    fill_shapes,
    fill_turns,
)

__all__ = ["search"]


@compiled
def search(
    looks: Complexes,
    times_s: Reals,
    look_s: float,
    means: Reals,
    spreads: Reals,
    table: Table,
    chips: Reals,
    hz: Reals,
    room: float,
    scores: Reals,
    states: Reals,
) -> None:
    """The largest score of a further signal beside those of `means` (channels, n, N_STATE), and where it is.

    looks : (channels, n_looks, d). spreads : covariance (channels, p, p) of the signals' fitted parameters.
    chips, hz : (u,), (f,) where it is looked for, both even. room : of a candidate's energy, added to what is left of
    it when all that the known signals can imitate is projected out.
    scores : (channels,), states : (channels, N_STATE), filled; each the top of the parabola through the largest score
    and its neighbours.
    """
    count, d = times_s.size, looks.shape[2]
    value, unused = np.empty((chips.size, d)), np.empty(d)
    for u in range(chips.size):
        table_at(chips[u], table[0], table[1], table[2], table[3], value[u], unused)
    wanted = np.zeros((hz.size, N_STATE))
    wanted[:, HZ] = hz
    turn = np.empty((hz.size, count), np.complex128)
    fill_turns(wanted, times_s, look_s, turn)
    for one in range(means.shape[0]):
        field = _scores(looks[one], times_s, look_s, means[one], spreads[one], table, value, turn, room)
        best = int(np.argmax(field[0]))
        f, u = best // chips.size, best % chips.size
        off_hz, more_hz = _top(field[0, :, u], f)
        off_chips, more_chips = _top(field[0, f], u)
        scores[one] = field[0, f, u] + more_hz + more_chips
        states[one] = 0.0
        states[one, RE], states[one, IM] = field[1, f, u], field[2, f, u]
        states[one, HZ] = hz[f] + off_hz * (hz[1] - hz[0])
        states[one, CHIPS] = chips[u] + off_chips * (chips[1] - chips[0])


@compiled
def _top(line: Reals, at_place: int) -> tuple[float, float]:
    """Where, in places beside the largest of a line, the parabola through it and its neighbours is highest, and by how
    much it is higher there; none at the ends.
    """
    if at_place == 0 or at_place == line.size - 1:
        return 0.0, 0.0
    before, here, after = line[at_place - 1], line[at_place], line[at_place + 1]
    bend = max(2.0 * here - before - after, 1e-9)
    off = min(max(0.5 * (after - before) / bend, -0.5), 0.5)
    return off, 0.5 * bend * off * off


@compiled
def _left(looks: Complexes, times_s: Reals, look_s: float, mean: Reals, table: Table) -> Complexes:
    """Looks (n_looks, d) without what the signals show."""
    n, d = mean.shape[0], looks.shape[1]
    turn, space = np.empty((n, times_s.size), np.complex128), np.empty((2, n, d))
    fill_turns(mean, times_s, look_s, turn)
    fill_shapes(mean[:, CHIPS], table, space)
    left = looks.copy()
    for k in range(n):
        for i in range(times_s.size):
            now = turn[k, i] * complex(mean[k, RE], mean[k, IM])
            for m in range(d):
                left[i, m] -= now * space[0, k, m]
    return left


@compiled(fastmath=FAST)
def _scores(
    looks: Complexes,
    times_s: Reals,
    look_s: float,
    mean: Reals,
    spread: Reals,
    table: Table,
    value: Reals,
    turn: Complexes,
    room: float,
) -> Reals:
    """Score and amplitude (real, imaginary) of a candidate at each Doppler and delay, (3, f, u).

    value : (u, d) and turn : (f, n_looks), of the candidates. What errors of the known signals do to a candidate is, at
    one Doppler, linear in the 2 n inner products of its shape with their values and slopes: their covariance is brought
    down to those once a Doppler.
    """
    n, count, (width, d) = mean.shape[0], times_s.size, value.shape
    residual = _left(looks, times_s, look_s, mean, table)
    real, imaginary = np.empty((count, width)), np.empty((count, width))
    along = np.empty(count, np.complex128)
    for u in range(width):
        fill_products(residual, value[u], along)
        for i in range(count):
            real[i, u], imaginary[i, u] = along[i].real, along[i].imag
    own, space, c = np.empty((n, count), np.complex128), np.empty((2, n, d)), np.empty((n, N_FITTED), np.complex128)
    fill_turns(mean, times_s, look_s, own)
    fill_shapes(mean[:, CHIPS], table, space)
    fill_coefficients(mean, c)
    beside, size = np.empty((2 * n, width)), np.empty(width)  # of values, then of slopes
    for u in range(width):
        size[u] = dot(value[u], value[u])
        for k in range(n):
            beside[k, u] = dot(space[0, k], value[u])
            beside[n + k, u] = dot(space[1, k], value[u])
    out = np.empty((3, turn.shape[0], width))
    into, time = np.empty((2, 2 * n, n * N_FITTED)), np.empty(3, np.complex128)
    forms = np.empty((3, 2 * n, 2 * n))
    in_phase, quadrature = np.empty(width), np.empty(width)
    taken = np.empty((3, width))
    for f in range(turn.shape[0]):
        duration = 0.0
        in_phase[:], quadrature[:] = 0.0, 0.0
        for i in range(count):
            cosine, sine = turn[f, i].real, turn[f, i].imag
            duration += cosine * cosine + sine * sine
            for u in range(width):
                in_phase[u] += 2.0 * (cosine * real[i, u] + sine * imaginary[i, u])
                quadrature[u] += 2.0 * (cosine * imaginary[i, u] - sine * real[i, u])
        into[:] = 0.0
        for k in range(n):
            time[:] = 0.0
            for i in range(count):
                now = np.conj(own[k, i]) * turn[f, i]
                time[0] += now
                time[1] += now * times_s[i]
                time[2] += now * times_s[i] * times_s[i]
            for q in range(N_FITTED):
                now = 2.0 * np.conj(c[k, q]) * time[POWER[q]]
                into[0, SLOPE[q] * n + k, k * N_FITTED + q] = now.real
                into[1, SLOPE[q] * n + k, k * N_FITTED + q] = -now.imag
        _form(into[0], spread, into[0], forms[0])
        _form(into[1], spread, into[1], forms[1])
        _form(into[0], spread, into[1], forms[2])
        taken[:] = 0.0
        for form in range(3):
            for k in range(2 * n):
                for m in range(2 * n):
                    weight = forms[form, k, m]
                    for u in range(width):
                        taken[form, u] += weight * beside[k, u] * beside[m, u]
        for u in range(width):
            energy = 2.0 * duration * size[u] * (1.0 + room)
            rr, ii, ri = energy - taken[0, u], energy - taken[1, u], -taken[2, u]
            determinant = rr * ii - ri * ri
            a = (ii * in_phase[u] - ri * quadrature[u]) / determinant
            b = (rr * quadrature[u] - ri * in_phase[u]) / determinant
            out[0, f, u] = a * in_phase[u] + b * quadrature[u]
            out[1, f, u], out[2, f, u] = a, b
    return out


@compiled
def _form(left: Reals, middle: Reals, right: Reals, out: Reals) -> None:
    """left middle right^T, (a, p) (p, p) (b, p)."""
    for i in range(left.shape[0]):
        for j in range(right.shape[0]):
            total = 0.0
            for q in range(middle.shape[0]):
                if left[i, q] != 0.0:
                    for r in range(middle.shape[1]):
                        total += left[i, q] * middle[q, r] * right[j, r]
            out[i, j] = total
