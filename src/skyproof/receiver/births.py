"""Signals that begin in a row of a joint channel, and signals that its filter has lost: fits from several beginnings.

A fit finds the signals from near by only, and bits' signs with them: a filter that does not know a newcomer sees the
sum, and may be anywhere between the two.
"""

import math
from dataclasses import replace
from itertools import permutations

import numpy as np

from skyproof.arrays import Complexes, Reals
from skyproof.receiver import joint as j
from skyproof.receiver.components import born, newcomer
from skyproof.receiver.joint import Row
from skyproof.receiver.joint_model import JointModel

__all__ = ["found_anew", "strongest", "wiped", "with_newcomer"]

SURE_SIGMAS = 4.0
RESIGNED = 3


def with_newcomer(
    model: JointModel,
    looks: Complexes,
    signs: Reals,
    seen: Reals,
    expected: Reals,
    state: Reals,
    least: float,
) -> Row | None:
    """A row (bits, looks, d) fitted with a newcomer, which is its last; None where no fit with one holds.

    signs : of the bits, as the filter saw them. seen, expected : where the filter has the signals known, and where they
    were expected, (n, N_STATE); state : (N_STATE,) of the newcomer beside those seen. least : amplitude that all have
    to be surely above. A sudden strong newcomer has drawn the filter to somewhere between the two, from where no fit
    finds either: so one begins with the strongest alone.
    """
    births = [
        _birth(model, looks, signs, seen),
        _birth(model, looks, _signs_beside(model, looks, expected, state), expected),
    ]
    if len(expected) == 1:
        births.append(_birth(model, looks, *strongest(model, looks)))
    fewer = min(misfit for _, misfit, _ in births)
    there = [fitted for fitted, _, holds in births if holds and 2.0 * (fewer - fitted.misfit) > model.threshold]
    return _settled(min(there, key=lambda fitted: float(fitted.misfit), default=None), expected, least)


def found_anew(model: JointModel, looks: Complexes, misfit: float, expected: Reals, least: float) -> Row | None:
    """A row (bits, looks, d) fitted with two signals without regard to what the filter had of them, None where that is
    not surely better than its `misfit`: where it is, the filter has lost them.

    expected, least : as in `with_newcomer`.
    """
    fitted, _, holds = _birth(model, looks, *strongest(model, looks))
    better = holds and 2.0 * (misfit - fitted.misfit) > model.threshold
    return _settled(fitted if better else None, expected, least)


def _settled(fitted: Row | None, expected: Reals, least: float) -> Row | None:
    return _in_order(fitted, expected) if fitted is not None and _stronger_than(fitted, least) else None


def _birth(model: JointModel, looks: Complexes, signs: Reals, start: Reals) -> tuple[Row, float, bool]:
    """A row (bits, looks, d) fitted with one signal more than there are in `start`, the misfit without it, and whether
    it holds; signs of the bits are gone over again with what was fitted.
    """
    times_s, look_s, dictionary = model.row_times_s, model.look_s, model.dictionary
    for _ in range(RESIGNED):
        told = wiped(looks, signs)
        fewer = j.fit_row(told, times_s, look_s, start, dictionary)
        _, state = newcomer(told, times_s, look_s, fewer, dictionary, model.candidates)
        fitted, holds = born(told, times_s, look_s, fewer, state, dictionary, model.threshold)
        again = _signs_of(model, looks, fitted)
        if np.array_equal(again, signs):
            break
        signs = again
    return fitted, float(fewer.misfit), bool(holds)


def strongest(model: JointModel, looks: Complexes) -> tuple[Reals, Reals]:
    """The strongest signal in a row (bits, looks, d) whose bits' signs are not known: the signs, and its state
    (1, N_STATE).
    """
    candidates, times_s = model.candidates, model.row_times_s.reshape(looks.shape[:-1])
    value, _ = model.dictionary.at(candidates.chips)
    coarse_hz = np.arange(-60.0, 61.0, 10.0)
    turned = (
        np.exp(-2j * np.pi * coarse_hz[:, None] * model.bit_times_s) / np.linalg.norm(value, axis=-1)[:, None, None]
    )
    of_bits = turned @ (looks @ value.conj().T).transpose(2, 1, 0)  # (chips, hz, bits)
    place, step = np.unravel_index(np.argmax(np.sum(np.abs(of_bits) ** 2, axis=-1)), of_bits.shape[:2])
    # Squares have no signs: twice the rest of the Doppler is what they turn by from bit to bit.
    bits_s, fine_hz = times_s.mean(axis=-1), np.arange(-12.5, 12.5, 0.25)
    seen = of_bits[place, step] * np.exp(-2j * np.pi * coarse_hz[step] * bits_s)
    turns = np.exp(-2j * np.pi * fine_hz[:, None] * bits_s)
    squares = turns**2 @ seen**2
    best = int(np.argmax(np.abs(squares)))
    told = seen * turns[best] * np.exp(-0.5j * np.angle(squares[best]))
    signs = np.where(told.real < 0.0, -1.0, 1.0)
    size = np.sum(signs * seen * turns[best]) / (times_s.size * np.linalg.norm(value[place]))
    state = np.zeros((1, j.N_STATE))
    state[0, [j.RE, j.IM]] = size.real, size.imag
    state[0, [j.HZ, j.CHIPS]] = coarse_hz[step] + fine_hz[best], candidates.chips[place]
    return signs, state


def _signs_of(model: JointModel, looks: Complexes, row: Row) -> Reals:
    """Signs of the bits of a row (bits, looks, d), by the signals fitted to it."""
    shown = j.signals_in(row.mean, model.row_times_s, model.look_s, model.dictionary).reshape(looks.shape)
    return np.asarray(np.where(np.sum((shown.conj() * looks).real, axis=(-2, -1)) < 0.0, -1.0, 1.0), np.float64)


def _signs_beside(model: JointModel, looks: Complexes, expected: Reals, state: Reals) -> Reals:
    """Signs of the bits of a row (bits, looks, d) in which a newcomer (N_STATE,) came beside those that were expected.

    A filter that does not know the newcomer sees the sum, which turns over at each null of the beat: it takes that for
    data. So amplitudes are solved for at the delays of all, bit by bit, and the signs are those of the signals known.
    """
    mean = np.concatenate([expected, state[None]])
    n, d = len(mean), looks.shape[-1]
    turn = j.turns(mean, model.row_times_s, model.look_s).reshape(n, len(looks), -1)
    value, _ = model.dictionary.at(mean[:, j.CHIPS])
    shown = (turn[..., None] * value[:, None, None, :]).transpose(1, 0, 2, 3).reshape(len(looks), n, -1)
    gram = shown.conj() @ np.swapaxes(shown, -1, -2)
    seen = shown.conj() @ looks.reshape(len(looks), -1, 1)
    amplitude = np.linalg.solve(gram + 1e-6 * d * np.eye(n), seen)[..., 0]
    foretold = expected[:, j.RE] + 1j * expected[:, j.IM]
    agreement = np.sum((amplitude[:, : n - 1] * foretold.conj()).real, axis=-1)
    return np.asarray(np.where(agreement < 0.0, -1.0, 1.0), np.float64)


def wiped(looks: Complexes, signs: Reals) -> Complexes:
    """Looks (..., bits, looks of a bit, d) with the bits' signs (..., bits) taken off, bit behind bit."""
    signed = looks * signs[..., None, None]
    return np.asarray(signed.reshape(*looks.shape[:-3], -1, looks.shape[-1]))


def _stronger_than(row: Row, least: float) -> bool:
    """Whether all amplitudes are surely larger."""
    size = np.hypot(row.mean[:, j.RE], row.mean[:, j.IM])
    sigma = np.hypot(row.sigma(j.RE), row.sigma(j.IM)) / math.sqrt(2.0)
    return bool(np.all(size - SURE_SIGMAS * sigma > least))


def _in_order(row: Row, expected: Reals) -> Row:
    """The row with its signals in the order of those that were expected, the newcomer last.

    A sudden strong newcomer draws the filter of one signal over to itself within a row: what was there before is what
    the row before foretold.
    """
    chips, foretold = row.mean[:, j.CHIPS], expected[:, j.CHIPS]
    orders = list(permutations(range(chips.size)))
    off = [float(np.sum(np.abs(chips[list(order[: foretold.size])] - foretold))) for order in orders]
    order = np.array(orders[int(np.argmin(off))])
    states = (order[:, None] * j.N_FITTED + np.arange(j.N_FITTED)).ravel()
    return replace(row, mean=row.mean[order], covariance=row.covariance[np.ix_(states, states)])
