"""Count satellites that take each other's place from epoch to epoch, with the law of that count.

A receiver that two skies pull about tracks a few satellites at an epoch and others at the next, at full strength. Shade
or interference removes and returns satellites singly, or together: at an epoch many are lost, or many are found again,
and rarely both. The exchange of an epoch is the smaller of the two numbers. A whole system that is there at one epoch
and not at the next is left out: some receivers and files write systems by turns.

**Law.** From an epoch to the next each tracked satellite is lost with probability `rate` or less, independently or
together with others. What is lost together comes back together, at another epoch. So the exchange is stochastically no
larger than a binomial of the tracked satellites at that rate, whatever was before. Against the rate doubled the
likelihood ratio of such a binomial has a mean of 1 or less, and so has the product from any epoch on. The chance that
it ever exceeds x is 1/x or less (Ville's inequality). The sum that Page's rule keeps is the logarithm of the largest
product over all beginnings; with k beginnings the chance of a sum s is k exp(-s) or less (union bound; the mean time
between false alarms: G. Lorden, Annals of Mathematical Statistics 42(6), 1971, theorem 2).

**Rate.** A stated bound, or the receiver's own past where that is larger: a phone indoors exchanges satellites always.
"""

from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from skyproof.arrays import Booleans, Indices, Reals
from skyproof.detectors.torn.policy import POLICY
from skyproof.records import CellStatus, Observations

__all__ = ["Exchange", "ExchangePast", "count_exchanges", "examine_exchange"]

_NEVER: Final = np.datetime64("NaT", "ns")


@dataclass(frozen=True, kw_only=True)
class ExchangePast:
    """What is remembered of a receiver: its satellites, the sum and since when it grows, and its own rate.

    tracked, strong : satellites of the last epoch. known : all so far. beginnings : epochs since the sum grows from
    zero. began : the first of them. exchanged, cells : of the windows in which nothing was odd.
    """

    end_s: float = -np.inf
    tracked: frozenset[str] = frozenset()
    strong: frozenset[str] = frozenset()
    known: frozenset[str] = frozenset()
    score: float = 0.0
    beginnings: int = 0
    began: np.datetime64 = _NEVER
    exchanged: float = 0.0
    cells: float = 0.0

    @property
    def rate(self) -> float:
        """Return the largest rate at which satellites are exchanged without an attack."""
        past_rate = (POLICY.most_exchanged_share * POLICY.prior_cells + self.exchanged) / (
            POLICY.prior_cells + self.cells
        )
        return max(POLICY.most_exchanged_share, past_rate)


class Exchange(NamedTuple):
    """What a window shows: its p-value, satellites exchanged and tracked over its epochs, which, and since when."""

    p_value: float
    exchanged: int
    tracked: int
    satellites: tuple[str, ...]
    began: np.datetime64


def count_exchanges(tracked: Booleans, strong: Booleans, known: Booleans, system: Indices) -> tuple[Reals, Reals]:
    """Count what is exchanged between epochs and out of how many, two arrays (n_epochs - 1,).

    tracked, strong : (n_epochs, n_satellites). known, system : (n_satellites,) tracked before the first of these
    epochs, and the number of its system.
    """
    seen = known | np.logical_or.accumulate(tracked, axis=0)
    of_system = np.stack([tracked[:, system == number].sum(axis=1) for number in range(system.max(initial=-1) + 1)], 1)
    before, after = of_system[:-1], of_system[1:]
    by_turns = ((before >= POLICY.whole_system_satellites) & (after == 0)) | (
        (after >= POLICY.whole_system_satellites) & (before == 0)
    )
    counted = ~by_turns[:, system]
    lost = strong[:-1] & ~tracked[1:] & counted
    again = ~tracked[:-1] & strong[1:] & seen[:-1] & counted
    exchanged = np.minimum(lost.sum(axis=1), again.sum(axis=1))
    return exchanged.astype(np.float64), (strong[:-1] & counted).sum(axis=1).astype(np.float64)


def examine_exchange(o: Observations, past: ExchangePast) -> tuple[Exchange | None, ExchangePast]:
    """Return what a window shows after what came before, None where no two epochs follow each other; and the past."""
    sats = sorted({signal.sat for signal in o.signals} | past.known)
    tracked, strong = _track_satellites(o, sats)
    elapsed_s, gpst = o.elapsed_s, o.gpst
    if past.end_s < elapsed_s[0]:
        first = np.array([[sat in part for sat in sats] for part in (past.tracked, past.strong)], np.bool_)
        tracked, strong = np.vstack([first[:1], tracked]), np.vstack([first[1:], strong])
        elapsed_s, gpst = np.append(past.end_s, elapsed_s), np.append(gpst[:1], gpst)
    else:
        past = ExchangePast()  # another recording
    known = np.array([sat in past.known for sat in sats], np.bool_)
    if not sats:
        return None, replace(past, end_s=float(o.elapsed_s[-1]))
    system = np.unique([sat[0] for sat in sats], return_inverse=True)[1]
    exchanged, cells = count_exchanges(tracked, strong, known, system)
    apart_s = np.diff(elapsed_s)
    follows = apart_s < POLICY.long_intervals * np.median(apart_s[-max(o.gpst.size - 1, 1) :])
    exchanged, cells = np.where(follows, exchanged, 0.0), np.where(follows, cells, 0.0)
    rate = past.rate
    doubled = min(2.0 * rate, 0.5 * (1.0 + rate))
    ratios = exchanged * np.log(doubled / rate) + (cells - exchanged) * np.log((1.0 - doubled) / (1.0 - rate))
    score, beginnings, began, least = past.score, past.beginnings, past.began, np.inf
    found = began
    for k, ratio in enumerate(ratios.tolist()):
        if score == 0.0:
            beginnings, began = 0, gpst[k + 1]
        score = min(max(0.0, score + ratio), POLICY.most_score)
        beginnings += 1
        chance = float(np.log(max(beginnings, ratios.size)) - score)
        if chance < least:
            least, found = chance, began
    p_value = float(np.exp(min(least, 0.0)))
    after = replace(
        past,
        end_s=float(o.elapsed_s[-1]),
        tracked=frozenset(np.array(sats)[tracked[-1]].tolist()),
        strong=frozenset(np.array(sats)[strong[-1]].tolist()),
        known=past.known | frozenset(np.array(sats)[tracked.any(axis=0)].tolist()),
        score=score,
        beginnings=beginnings,
        began=began,
    )
    total, of = float(exchanged.sum()), float(cells.sum())
    if p_value > 0.05:
        keep = min(1.0, POLICY.most_cells / max(past.cells, 1.0))
        after = replace(after, exchanged=keep * past.exchanged + total, cells=keep * past.cells + of)
    if not follows.any():
        return None, after
    changes = ((tracked[1:] != tracked[:-1]) & (exchanged > 0.0)[:, None]).any(axis=0)
    return Exchange(p_value, int(total), int(of), tuple(np.array(sats)[changes].tolist()), found), after


def _track_satellites(o: Observations, sats: list[str]) -> tuple[Booleans, Booleans]:
    """Return which satellites have a range at each epoch, and which of them are not weak: (n_epochs, n_satellites)."""
    ranged = np.isfinite(o.pseudorange_m) | (o.status == CellStatus.IMPOSSIBLE)
    enough = ranged & ~(o.cn0_dbhz < POLICY.weak_dbhz)
    number = np.array([sats.index(signal.sat) for signal in o.signals], np.intp)
    tracked, strong = (np.zeros((o.gpst.size, len(sats)), np.bool_) for _ in range(2))
    for column, sat in enumerate(number.tolist()):
        tracked[:, sat] |= ranged[:, column]
        strong[:, sat] |= enough[:, column]
    return tracked, strong
