"""Compare levels of a few seconds with those just before: where power comes in, and signals get stronger with it.

A window is cut into parts. About each part, the one after it is held against the one before, so that a step inside it
counts in full. Steps of signals and of the power that comes in have laws of their own, learnt from the recording's own
earlier steps (`laws.OwnScale`); a level that wanders as a random walk does so by the root of the time. After K. D.
Wesson, J. N. Gross, T. E. Humphreys, B. L. Evans, IEEE Trans. Aerospace and Electronic Systems 54(2), 2018, doi
10.1109/TAES.2017.2765258: interference raises the power and strengthens no signal, a false sky does both.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from skyproof.detectors.levels.front_end import average_readings, chain_covers
from skyproof.detectors.levels.laws import DIP_PARTS, OwnScale
from skyproof.detectors.levels.policy import POLICY
from skyproof.records import FrontEndLevels, Observations, Transmission
from skyproof.statistics.many_small import many_small

__all__ = [
    "LevelStep",
    "PowerStep",
    "WindowPart",
    "combine_two",
    "cut_in_parts",
    "find_power_step",
    "learn_steps",
    "list_steps",
]

STEP_SHARE: Final = 2.0 / DIP_PARTS
"""Of a window: from the part before one to the part after it."""


class WindowPart(NamedTuple):
    """A part of a window: its levels by transmission, dB, and what comes in by chain and kind, in sigmas of the
    settings. start_s, stop_s : of the recording."""

    start_s: float
    stop_s: float
    levels_db: Mapping[Transmission, float]
    inputs: Mapping[tuple[str, str], float]


class LevelStep(NamedTuple):
    """What changes about a part, over one sigma of the settings: of each transmission, and of each chain and kind.

    risen : of a transmission, over its own level as well: what was weak and comes back rises by nothing.
    """

    levels: Mapping[Transmission, float]
    risen: Mapping[Transmission, float]
    inputs: Mapping[tuple[str, str], float]


class PowerStep(NamedTuple):
    """Where signals of a kind get stronger while more power comes in.

    p_signals : that so many get so much stronger, each independently. p_power : of so much more power. p_alike : that
    all change alike, as by a change of gain before the noise is added. rise_db : median of the satellites.
    satellites : that were compared. p_value : of both at once; 1 where one of them alone is no surprise, as with
    shade that ends and noise that begins.
    """

    p_signals: float
    p_power: float
    p_alike: float
    rise_db: float
    satellites: int
    p_value: float


def cut_in_parts(
    o: Observations, levels: FrontEndLevels | None, end_gpst: np.datetime64, *, gain_db: float, gain_share: float
) -> list[WindowPart]:
    """Cut a window that ends at a time into parts with the levels of each.

    Of several signals of a transmission the strongest counts. Without readings of power there is nothing to compare.
    """
    if levels is None:
        return []
    n = o.gpst.size
    edges = np.linspace(0, n, min(DIP_PARTS, n) + 1).round().astype(np.intp).tolist()
    found = []
    for first, stop in pairwise(edges):
        cells_db = o.cn0_dbhz[first:stop]
        known = np.isfinite(cells_db).any(axis=0)
        levels_db: dict[Transmission, float] = {}
        for k in np.flatnonzero(known).tolist():
            sent = o.signals[k].transmission
            levels_db[sent] = max(float(np.nanmean(cells_db[:, k])), levels_db.get(sent, -np.inf))
        within = levels.select_between(o.gpst[first], o.gpst[stop] if stop < n else end_gpst)
        inputs = average_readings(within, gain_db, gain_share)
        found.append(WindowPart(float(o.elapsed_s[first]), float(o.elapsed_s[stop - 1]), levels_db, inputs))
    return found


def list_steps(parts: Sequence[WindowPart], own_db: Mapping[Transmission, float], fading_db: float) -> list[LevelStep]:
    """List what changes about each part that has a neighbour on both sides, where no time is missing.

    own_db : own levels of transmissions that were there before, without interference.
    """
    steps = []
    usual_s = float(np.median(np.diff([part.start_s for part in parts]))) if len(parts) > 1 else 0.0
    for before, about, after in zip(parts, parts[1:], parts[2:], strict=False):
        paused_s = max(about.start_s - before.stop_s, after.start_s - about.stop_s)
        if paused_s > POLICY.pause_parts * usual_s:
            continue
        root = np.sqrt(STEP_SHARE)
        unit_db = fading_db * root
        levels = {
            sent: (after.levels_db[sent] - before.levels_db[sent]) / unit_db
            for sent in before.levels_db.keys() & after.levels_db.keys()
        }
        risen = {
            sent: min(change, (after.levels_db[sent] - own_db.get(sent, -np.inf)) / unit_db)
            for sent, change in levels.items()
        }
        inputs = {
            name: (after.inputs[name] - before.inputs[name]) / root
            for name in before.inputs.keys() & after.inputs.keys()
        }
        steps.append(LevelStep(levels, risen, inputs))
    return steps


def find_power_step(
    steps: Sequence[LevelStep],
    kind: tuple[str, ...],
    carrier: str,
    own: Mapping[tuple[str, ...], OwnScale],
    *,
    fading_db: float,
    common_db: float,
    stands: bool,
) -> PowerStep | None:
    """Find the least likely step of the satellites of a kind with the power on their carrier; None without any.

    own : scales of steps by their past. common_db : by which all signals may get stronger together, as the noise
    figure wanders. stands : no shade ends about the receiver: the power need not rise, and may not fall.
    """
    found: list[PowerStep] = []
    confirmed = 1.0 - POLICY.confirming_p_value if stands else POLICY.confirming_p_value
    unit_db = fading_db * np.sqrt(STEP_SHARE)
    for step in steps:
        sents = [sent for sent in sorted(step.levels) if _kind_of(sent) == kind]
        changes, risen = (np.array([of[sent] for sent in sents]) for of in (step.levels, step.risen))
        chains = {name: change for name, change in step.inputs.items() if chain_covers(name[0], carrier)}
        if changes.size < POLICY.least_satellites or not chains:
            continue
        scale, least = own.get(kind, OwnScale()), max(POLICY.least_satellites, -(-changes.size // 2))
        stronger = [scale.above(change - common_db / unit_db) for change in risen]
        apart = [2.0 * scale.above(abs(change)) for change in changes - np.median(changes)]
        power = min(own.get(name, OwnScale()).above(change) for name, change in chains.items())
        p_signals, p_power = many_small(stronger, least=least).p_value, min(1.0, len(chains) * power)
        surprise = p_signals < POLICY.confirming_p_value and p_power < confirmed
        found.append(
            PowerStep(
                p_signals=p_signals,
                p_power=p_power,
                p_alike=many_small(np.minimum(apart, 1.0), least=least).p_value,
                rise_db=float(np.median(changes)) * unit_db,
                satellites=changes.size,
                p_value=float(combine_two(p_signals, p_power)) if surprise else 1.0,
            )
        )
    least_likely = min(found, key=lambda step: step.p_value, default=None)
    return None if least_likely is None else least_likely._replace(p_value=min(1.0, len(found) * least_likely.p_value))


def combine_two(first: float, second: float) -> float:
    """Return the chance that the product of two independent p-values is so small (R. A. Fisher, 1932)."""
    product = max(first * second, np.finfo(float).tiny)
    return min(1.0, product * (1.0 - float(np.log(product))))


def learn_steps(
    own: Mapping[tuple[str, ...], OwnScale], steps: Sequence[LevelStep], disturbed: frozenset[tuple[str, ...]]
) -> dict[tuple[str, ...], OwnScale]:
    """Return the scales that have seen more steps. disturbed : kinds that are not learnt from."""
    scales = dict(own)
    for step in steps:
        by_kind: dict[tuple[str, ...], list[float]] = {}
        for sent, change in step.levels.items():
            by_kind.setdefault(_kind_of(sent), []).append(change)
        for kind, changes in by_kind.items():
            if kind not in disturbed:
                scales[kind] = scales.get(kind, OwnScale()).after(float(np.sqrt(np.mean(np.square(changes)))))
        for name, change in step.inputs.items():
            scales[name] = scales.get(name, OwnScale()).after(change)
    return scales


def _kind_of(sent: Transmission) -> tuple[str, ...]:
    return sent[0][0], sent[1], sent[2]
