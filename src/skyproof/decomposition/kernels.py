"""Compiled inner loops of `decomposition`: the search over pairs of delays and the fit that follows.

Everything is given in whitened coordinates: noise is white with variance one per complex sample after scaling. A signal
is amplitude times D(delay) times e(Doppler), an outer product of a real and a complex vector that tables hold with
their derivatives; so every inner product is one over delays times one over Dopplers, and a step costs little.
"""

import numpy as np

from skyproof.compiled import compiled

__all__ = ["fit_all", "solve", "table_at"]

_STARTS = 3  # pairs that the fit begins from
_STEPS = 25
_APART = 4  # grid cells between the starts
_CLOSEST_CHIPS = 1e-3  # two delays nearer than this are one to rounding


@compiled
def solve(matrix, right):  # type: ignore[no-untyped-def]
    """Solve a small system with several right sides, by elimination with pivots; False if it has no solution."""
    n, m = right.shape
    a, b = matrix.copy(), right.copy()
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(a[i, k]) > abs(a[pivot, k]):
                pivot = i
        if abs(a[pivot, k]) < 1e-14:
            return False, b
        if pivot != k:
            for j in range(n):
                a[k, j], a[pivot, j] = a[pivot, j], a[k, j]
            for j in range(m):
                b[k, j], b[pivot, j] = b[pivot, j], b[k, j]
        for i in range(k + 1, n):
            share = a[i, k] / a[k, k]
            for j in range(k, n):
                a[i, j] -= share * a[k, j]
            for j in range(m):
                b[i, j] -= share * b[k, j]
    for k in range(n - 1, -1, -1):
        for j in range(m):
            total = b[k, j]
            for i in range(k + 1, n):
                total -= a[k, i] * b[i, j]
            b[k, j] = total / a[k, k]
    return True, b


@compiled
def table_at(x, first, step, value, slope, out, out_slope):  # type: ignore[no-untyped-def]
    """Interpolate a table's vector and its derivative at x, by cubic Hermites."""
    place = (x - first) / step
    i = min(max(int(np.floor(place)), 0), value.shape[0] - 2)
    u = place - i
    h0, h1 = (1.0 + 2.0 * u) * (1.0 - u) ** 2, u * u * (3.0 - 2.0 * u)
    g0, g1 = u * (1.0 - u) ** 2 * step, u * u * (u - 1.0) * step
    dh = 6.0 * u * (u - 1.0) / step
    dg0, dg1 = (1.0 - u) * (1.0 - 3.0 * u), u * (3.0 * u - 2.0)
    for k in range(value.shape[1]):
        out[k] = h0 * value[i, k] + h1 * value[i + 1, k] + g0 * slope[i, k] + g1 * slope[i + 1, k]
        out_slope[k] = dh * (value[i, k] - value[i + 1, k]) + dg0 * slope[i, k] + dg1 * slope[i + 1, k]


@compiled
def _evaluate(data, where, n, delay, doppler):  # type: ignore[no-untyped-def]
    """Compute amplitudes, captured energy, gradient and information at `where`: n delays, then n Dopplers if fitted.

    The information is Re(J^H P J) with P the projection off the signals (Kaufman's variable projection).
    """
    first, step, value, slope = delay
    f_first, f_step, f_value, f_slope = doppler
    blocks, d = data.shape
    p = where.size
    space, dspace = np.empty((n, d)), np.empty((n, d))
    time, dtime = np.empty((n, blocks), np.complex128), np.empty((n, blocks), np.complex128)
    for k in range(n):
        table_at(where[k], first, step, value, slope, space[k], dspace[k])
        table_at(where[n + k] if p > n else 0.0, f_first, f_step, f_value, f_slope, time[k], dtime[k])
    gram = np.empty((n, n), np.complex128)
    cross = np.empty((n, p), np.complex128)
    inner = np.empty((p, p), np.complex128)
    seen, dseen = np.zeros((n, 1), np.complex128), np.zeros(p, np.complex128)
    for k in range(n):
        for b in range(blocks):
            along, dalong = 0.0j, 0.0j
            for i in range(d):
                along += space[k, i] * data[b, i]
                dalong += dspace[k, i] * data[b, i]
            seen[k, 0] += np.conj(time[k, b]) * along
            dseen[k] += np.conj(time[k, b]) * dalong
            if p > n:
                dseen[n + k] += np.conj(dtime[k, b]) * along
        for j in range(n):
            ss, sd, ds, dd = 0.0, 0.0, 0.0, 0.0
            for i in range(d):
                ss += space[k, i] * space[j, i]
                sd += space[k, i] * dspace[j, i]
                ds += dspace[k, i] * space[j, i]
                dd += dspace[k, i] * dspace[j, i]
            tt, tu, ut, uu = 0.0j, 0.0j, 0.0j, 0.0j
            for b in range(blocks):
                tt += np.conj(time[k, b]) * time[j, b]
                tu += np.conj(time[k, b]) * dtime[j, b]
                ut += np.conj(dtime[k, b]) * time[j, b]
                uu += np.conj(dtime[k, b]) * dtime[j, b]
            gram[k, j] = ss * tt
            cross[k, j] = sd * tt
            inner[k, j] = dd * tt
            if p > n:
                cross[k, n + j] = ss * tu
                inner[k, n + j] = ds * tu
                inner[n + k, j] = sd * ut
                inner[n + k, n + j] = ss * uu
    information, gradient = np.zeros((p, p)), np.zeros(p)
    solvable, amplitude = solve(gram, seen)
    if not solvable:
        return amplitude[:, 0], -1.0, gradient, information
    _, explained = solve(gram, cross)
    captured = 0.0
    for k in range(n):
        captured += (np.conj(seen[k, 0]) * amplitude[k, 0]).real
    for q in range(p):
        unexplained = dseen[q]
        for k in range(n):
            unexplained -= np.conj(cross[k, q]) * amplitude[k, 0]
        gradient[q] = (np.conj(amplitude[q % n, 0]) * unexplained).real
        for r in range(p):
            off = inner[q, r]
            for k in range(n):
                off -= np.conj(cross[k, q]) * explained[k, r]
            information[q, r] = (np.conj(amplitude[q % n, 0]) * amplitude[r % n, 0] * off).real
    return amplitude[:, 0], captured, gradient, information


@compiled
def _are_apart(where, n):  # type: ignore[no-untyped-def]
    for k in range(n):
        for j in range(k):
            if abs(where[k] - where[j]) < _CLOSEST_CHIPS:
                return False
    return True


@compiled
def _polish(data, where, n, delay, doppler):  # type: ignore[no-untyped-def]
    """Run Levenberg-Marquardt from `where`; steps of at most 0.1 chip and 10 Hz."""
    last = delay[0] + delay[1] * (delay[2].shape[0] - 1)
    f_last = doppler[0] + doppler[1] * (doppler[2].shape[0] - 1)
    p = where.size
    amplitude, captured, gradient, information = _evaluate(data, where, n, delay, doppler)
    damping = 1e-3
    right = np.empty((p, 1))
    for _ in range(_STEPS):
        damped = information.copy()
        for q in range(p):
            damped[q, q] = information[q, q] * (1.0 + damping) + 1e-12
            right[q, 0] = gradient[q]
        solvable, step = solve(damped, right)
        moved = where.copy()
        longest = 0.0
        for q in range(p):
            limit = 0.1 if q < n else 10.0
            change = min(max(step[q, 0], -limit), limit) if solvable else 0.0
            low, high = (delay[0], last) if q < n else (doppler[0], f_last)
            moved[q] = min(max(where[q] + change, low), high)
            longest = max(longest, abs(moved[q] - where[q]) * (1.0 if q < n else 0.01))
        if longest < 1e-7:
            break
        better = False
        if _are_apart(moved, n):
            tried = _evaluate(data, moved, n, delay, doppler)
            better = tried[1] > captured
        if better:
            where = moved
            amplitude, captured, gradient, information = tried
            damping = max(0.1 * damping, 1e-9)
        else:
            damping *= 10.0
            if damping > 1e8:
                break
    return where, amplitude, captured, information


@compiled
def _select_starts(seen, gram, n, found, score):  # type: ignore[no-untyped-def]
    """Select grid cells (starts, n) to fit from, best first, into `found`; return how many there are.

    `score` gets their captured energy. All cells serve for one signal, all pairs for two; further signals are added one
    at a time where they capture most.
    """
    cells = seen.size
    if n == 1:
        best, most = 0, -1.0
        for i in range(cells):
            energy = abs(seen[i]) ** 2 / gram[i, i]
            if energy > most:
                best, most = i, energy
        found[0, 0], score[0] = best, most
        return 1
    power = np.empty(cells)
    for i in range(cells):
        power[i] = seen[i].real ** 2 + seen[i].imag ** 2
    energy = np.full((cells, cells), -1.0)
    for i in range(cells):
        for j in range(i + 1, cells):
            product = seen[i].real * seen[j].real + seen[i].imag * seen[j].imag
            energy[i, j] = (power[i] * gram[j, j] + power[j] * gram[i, i] - 2.0 * gram[i, j] * product) / (
                gram[i, i] * gram[j, j] - gram[i, j] ** 2
            )
    count = 0
    for start in range(_STARTS):
        best_i, best_j, most = -1, -1, -1.0
        for i in range(cells):
            for j in range(i + 1, cells):
                if energy[i, j] > most:
                    near = False
                    for k in range(start):
                        if abs(i - found[k, 0]) <= _APART and abs(j - found[k, 1]) <= _APART:
                            near = True
                    if not near:
                        best_i, best_j, most = i, j, energy[i, j]
        if best_i < 0:
            break
        found[start, 0], found[start, 1], score[start] = best_i, best_j, most
        count += 1
    for start in range(count):
        for m in range(2, n):
            _find_next_cell(seen, gram, found[start], m, score, start)
    return count


@compiled
def _find_next_cell(seen, gram, cells, m, score, start):  # type: ignore[no-untyped-def]
    """Find the cell that captures most beside the first m of `cells`."""
    inside = np.empty((m, m))
    rest = np.empty((m, 1), np.complex128)
    for k in range(m):
        rest[k, 0] = seen[cells[k]]
        for j in range(m):
            inside[k, j] = gram[cells[k], cells[j]]
    _, amplitude = solve(inside.astype(np.complex128), rest)
    best, most = -1, -1.0
    column = np.empty((m, 1))
    for i in range(seen.size):
        apart = True
        for k in range(m):
            column[k, 0] = gram[cells[k], i]
            apart &= abs(i - cells[k]) > 1
        if not apart:
            continue
        _, mix = solve(inside, column)
        rest_i, room = seen[i], gram[i, i]
        for k in range(m):
            rest_i -= column[k, 0] * amplitude[k, 0]
            room -= column[k, 0] * mix[k, 0]
        gain = abs(rest_i) ** 2 / max(room, 1e-12)
        if gain > most:
            best, most = i, gain
    cells[m] = best
    score[start] += most


@compiled
def fit_all(data, n, delay, doppler, coarse, gram, f_coarse, fitted, where, amplitude, captured, information):  # type: ignore[no-untyped-def]
    """Fit n signals to each of `data` (trials, blocks, d) and fill the outputs.

    delay, doppler : (first, step, values, slopes) of the tables. coarse : grid cells of the delay table to search;
    gram : (c, c) of their vectors. f_coarse : Dopplers to search, the same for all signals there.
    where : (trials, n), or (trials, 2 n) if Dopplers are `fitted`.
    """
    trials, blocks, d = data.shape
    cells = coarse.size
    value = delay[2]
    seen = np.empty(cells, np.complex128)
    summed = np.empty(d, np.complex128)
    time, dtime = np.empty(blocks, np.complex128), np.empty(blocks, np.complex128)
    found, score = np.zeros((_STARTS, n), np.int64), np.zeros(_STARTS)
    best_found, best_score = np.zeros((_STARTS, n), np.int64), np.zeros(_STARTS)
    p = 2 * n if fitted else n
    for t in range(trials):
        top, best_count, best_f = -1.0, 0, 0.0
        for f in f_coarse:
            table_at(f, doppler[0], doppler[1], doppler[2], doppler[3], time, dtime)
            norm = 0.0
            for b in range(blocks):
                norm += abs(time[b]) ** 2
            norm = np.sqrt(norm)
            for i in range(d):
                summed[i] = 0.0
                for b in range(blocks):
                    summed[i] += np.conj(time[b]) * data[t, b, i] / norm
            for c in range(cells):
                real, imag = 0.0, 0.0
                for i in range(d):
                    real += value[coarse[c], i] * summed[i].real
                    imag += value[coarse[c], i] * summed[i].imag
                seen[c] = complex(real, imag)
            count = _select_starts(seen, gram, n, found, score)
            if score[0] > top:
                top, best_count, best_f = score[0], count, f
                best_found[:], best_score[:] = found, score
        best = -1.0
        begin = np.empty(p)
        for start in range(best_count):
            for k in range(n):
                begin[k] = delay[0] + delay[1] * coarse[best_found[start, k]]
                if fitted:
                    begin[n + k] = best_f
            at, a, energy, known = _polish(data[t], begin, n, delay, doppler)
            if energy > best:
                best = energy
                where[t], amplitude[t], captured[t], information[t] = at, a, energy, known
