"""A pair of signals of one satellite through the receiver: what it finds of both, beside the truth and the bound."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from waves import CHIP_M, SAT, Cell, Wave, add, noise, pair_of

from skyproof.arrays import Reals
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.receiver import measurement as m
from skyproof.receiver.channels import Arc
from skyproof.receiver.measurement import Measurements
from skyproof.receiver.tracking import Receiver, ReceiverSettings, ReceiverState

BLOCK_S = 0.1
ALONE_S = 1.5  # at least, before the second signal begins
WAIT_S = 4.0  # for a second signal to be found
TRACKED_S = 2.0  # before errors are taken
SEEN_S = 1.0  # over which they are
NEAR_CHIPS = 0.25


@dataclass(frozen=True, eq=False, kw_only=True)
class Outcome:
    """What the receiver made of a pair.

    wait_s : from the beginning of the second signal to the search that found it; NaN if not both were followed.
    others : confirmed channels beyond one on each; pulled : arcs that ended as pulled away.
    swapped : whether the first's letter ended elsewhere. followed : (n_epochs,) since both were found, if they are.
    code_m, doppler_hz : errors of first and second, (2, n_epochs), and their stated sigmas.
    """

    wait_s: float = math.nan
    others: int
    pulled: int
    swapped: bool = False
    followed: NDArray[np.bool_] = field(default_factory=lambda: np.empty(0, np.bool_))
    code_m: Reals = field(default_factory=lambda: np.empty((2, 0)))
    code_sigma_m: Reals = field(default_factory=lambda: np.empty((2, 0)))
    doppler_hz: Reals = field(default_factory=lambda: np.empty((2, 0)))
    doppler_sigma_hz: Reals = field(default_factory=lambda: np.empty((2, 0)))

    @property
    def both(self) -> bool:
        """Whether both were found, confirmed, and still followed when errors were taken."""
        return math.isfinite(self.wait_s)


def trial(rng: np.random.Generator, cell: Cell, settings: ReceiverSettings | None = None) -> Outcome:
    """One pair through the receiver."""
    receiver = Receiver(cell.rate_hz, 0.0, settings or ReceiverSettings(sats=(SAT,)))
    # At any moment between two searches.
    onset_s = ALONE_S + receiver.settings.near_search_s * rng.random()
    # Code and carrier belong together, so that signals of different Doppler move apart.
    middle_s = onset_s + 0.3 + TRACKED_S + 0.5 * SEEN_S
    first, second = pair_of(rng, cell, onset_s, middle_s, onset_s + WAIT_S + TRACKED_S + SEEN_S)
    state, parts, arcs = ReceiverState(), [], {}
    n = round(BLOCK_S * cell.rate_hz)
    stop_s = math.inf  # of the epochs that count
    for block in range(math.floor((onset_s + WAIT_S + TRACKED_S + SEEN_S) / BLOCK_S)):  # as long as there are bits
        planes = noise(rng, n)
        add(first, block * n, planes, cell.rate_hz)
        add(second, block * n, planes, cell.rate_hz)
        output, state = receiver.step(state, planes)
        parts.append(output.measurements)
        arcs |= output.arcs
        now_s = (block + 1) * BLOCK_S
        new = [c.found_s for c in state.channels if c.copy is not None and c.found_s > onset_s - 0.05]
        stop_s = min(new) + TRACKED_S + SEEN_S if new else math.inf
        if now_s > min(stop_s + 0.3, math.inf if new else onset_s + WAIT_S + 1.0):
            break
    return _outcome(Measurements.join(parts), arcs, (first, second), onset_s, min(stop_s, now_s))


def _outcome(
    measured: Measurements, arcs: dict[int, Arc], waves: tuple[Wave, Wave], onset_s: float, stop_s: float
) -> Outcome:
    """Channels given to the signal that each is nearer to, within half a chip, in the last second."""
    t_s = measured.elapsed_s
    late = (t_s > stop_s - SEEN_S + 1e-9) & (t_s < stop_s + 1e-9)
    shown_s = measured.column(m.PERIODS) * GPS_L1_CA.period_s + measured.column(m.FRACTION_S)
    error_m = np.stack([SPEED_OF_LIGHT_M_S * ((shown_s - wave.sent_s(t_s) + 0.5e-3) % 1e-3 - 0.5e-3) for wave in waves])
    letters = np.array([arcs[int(arc)].signal.copy for arc in measured.arc])
    rows_of: list[list[NDArray[np.bool_]]] = [[], []]
    rest = 0
    for name in np.unique([arc.signal.copy for arc in arcs.values()]):
        rows = late & (letters == name)
        off_m = np.median(np.abs(error_m[:, rows]), axis=1) if rows.any() else np.full(2, math.inf)
        which = int(np.argmin(off_m))
        if off_m[which] < 0.5 * CHIP_M:
            rows_of[which].append(rows)
        elif rows.any() or any(arc.found_s > onset_s - 0.05 for arc in arcs.values() if arc.signal.copy == name):
            rest += 1
    rest += sum(len(found) - 1 for found in rows_of if found)
    pulled = sum(arc.began == "pulled away" for arc in arcs.values())
    if not all(rows_of):
        return Outcome(others=rest, pulled=pulled)
    found_s = [min(arcs[int(arc)].found_s for arc in measured.arc[found[0]]) for found in rows_of]
    n = min(int(found[0].sum()) for found in rows_of)
    numbers = [np.flatnonzero(found[0])[:n] for found in rows_of]
    table = np.stack([measured.table[rows] for rows in numbers])
    since = (t_s > max(found_s) + 1e-9) & (t_s < stop_s + 1e-9)
    return Outcome(
        wait_s=max(found_s) - onset_s,
        others=rest,
        pulled=pulled,
        swapped=not any(letters[rows[0]] == "a" for rows in numbers[:1]),
        followed=_followed(t_s[since], error_m[:, since], waves),
        code_m=np.stack([error_m[i, rows] for i, rows in enumerate(numbers)]),
        code_sigma_m=table[..., m.CODE_SIGMA_S] * SPEED_OF_LIGHT_M_S,
        doppler_hz=table[..., m.DOPPLER_HZ] - np.array([[wave.doppler_hz] for wave in waves]),
        doppler_sigma_hz=table[..., m.DOPPLER_SIGMA_HZ],
    )


def _followed(t_s: Reals, error_m: Reals, waves: tuple[Wave, Wave]) -> NDArray[np.bool_]:
    """Whether both signals are followed at each epoch, by rows of errors (2, n_rows) beside each of them."""
    apart_m = SPEED_OF_LIGHT_M_S * np.abs(waves[1].sent_s(t_s) - waves[0].sent_s(t_s))
    near = np.abs(error_m) < np.minimum(NEAR_CHIPS * CHIP_M, 0.5 * apart_m)
    return np.array([near[:, t_s == epoch].any(axis=1).all() for epoch in np.unique(t_s)], np.bool_)
