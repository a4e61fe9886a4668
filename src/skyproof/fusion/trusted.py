"""Positions from signals of one label: the trusted fix, and what the false signals show."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from skyproof.arrays import Booleans, Integers, Reals
from skyproof.fusion.labels import LabelledSignal
from skyproof.fusion.policy import POLICY
from skyproof.navigation.fix import fix_and_geometry
from skyproof.navigation.protection import add_protection
from skyproof.navigation.reflections import estimate_reflection_sigma_m
from skyproof.navigation.screen import empty_epochs, reject_misfits
from skyproof.records import (
    OBSERVABLES,
    CellStatus,
    Fix,
    FixStatus,
    Label,
    NavigationData,
    ObservationLog,
    Observations,
    SignalId,
)

__all__ = ["apply_mask", "carries", "fix_of", "mask_signals"]


def carries(log: ObservationLog, labels: Sequence[LabelledSignal], label: Label) -> Booleans:
    """Mark the cells, (n_epochs, n_signals), that carry a label."""
    mask = np.zeros((log.gpst.size, len(log.signals)), np.bool_)
    for s in labels:
        if s.ref.receiver == log.receiver and s.label == label:
            mask[s.first_epoch : s.last_epoch + 1, log.signals.index(s.ref.signal)] = True
    return mask


def mask_signals(log: ObservationLog, signals: Collection[SignalId]) -> Booleans:
    """Mark the cells, (n_epochs, n_signals), of these signals."""
    chosen = np.array([signal in signals for signal in log.signals], np.bool_)
    return np.broadcast_to(chosen, (log.gpst.size, chosen.size))


def apply_mask(observations: Observations, mask: Booleans) -> Observations:
    """Empty every cell of observations where `mask`, (n_epochs, n_signals), is false."""
    emptied: dict[str, Any] = {name: np.where(mask, getattr(observations, name), np.nan) for name in OBSERVABLES}
    kept = mask | (observations.status == CellStatus.NOT_TRACKED)
    status = np.where(kept, observations.status, CellStatus.NOT_TRACKED).astype(np.uint8)
    return replace(observations, status=status, **emptied)


def fix_of(
    observations: Observations,
    navigation: NavigationData,
    *,
    multipath_sigma_m: float,
    elevation_mask_deg: float,
    ordinary: bool = False,
    integrity_risk: float | None = None,
    faults: Integers | None = None,
    quadrature_m: Reals | None = None,
) -> Fix | None:
    """Compute the fix from all cells, in each epoch of one kind of signal of each time scale; None without any.

    Epochs whose residuals fit no one position are no fix (`navigation.screen`).

    ordinary : as a good receiver without protection makes it, which leaves measurements out that fit worst, and shows
        what the rest gives whether it fits or not.
    integrity_risk : if given, with protection levels that promise it, and no fix where none does: a satellite that no
        other one checks may put it anywhere. faults : (n_epochs,) of so many satellites at once; one if absent.

    quadrature_m : (n_epochs, n_signals) what code discriminators show off the carriers, averaged as the ranges; their
        reflections count in the sigmas (`navigation.reflections`).

    Two signals of one transmission with the same label leave it open which is meant: neither is used.
    """
    usable = np.isfinite(observations.pseudorange_m)
    for transmission in {signal.transmission for signal in observations.signals}:
        columns = [i for i, signal in enumerate(observations.signals) if signal.transmission == transmission]
        twice = usable[:, columns].sum(axis=1) > 1
        usable[np.ix_(twice, columns)] = False
    usable &= _select_one_kind_a_scale(observations.signals, usable)
    kept = np.flatnonzero(usable.any(axis=0))
    if kept.size < POLICY.fix_signals:
        return None
    signals = tuple(observations.signals[k] for k in kept)
    reflected_m = None
    if quadrature_m is not None:
        reflected_m = estimate_reflection_sigma_m(
            np.where(usable, quadrature_m, np.nan),
            observations.pseudorange_sigma_m,
        )
    found, geometry = fix_and_geometry(
        apply_mask(observations, usable),
        navigation,
        signals=signals,
        multipath_sigma_m=multipath_sigma_m,
        elevation_mask_deg=elevation_mask_deg,
        false_alarm_probability=POLICY.ordinary_alarm_probability if ordinary else None,
        reflected_sigma_m=reflected_m,
    )
    kept_fix = reject_misfits(found, geometry, with_misfits=ordinary)
    if integrity_risk is None:
        return kept_fix
    levelled = add_protection(kept_fix, geometry, integrity_risk=integrity_risk, faults=faults)
    unchecked = (levelled.status == FixStatus.OK) & ~np.isfinite(levelled.protection_m).all(axis=1)
    return empty_epochs(levelled, unchecked, np.where(unchecked, FixStatus.UNCHECKED, levelled.status).astype(np.uint8))


def _select_one_kind_a_scale(signals: Sequence[SignalId], usable: Booleans) -> Booleans:
    """Select the cells, (n_epochs, n_signals), of the kind that is taken: one per time scale and epoch.

    The first kind, L1 before L2, that has `band_share` of the signals that any of the scale has. So the scale's
    clock is one kind's, where bands are false at different times as well; it steps where the kind changes.
    """
    taken = np.zeros_like(usable)
    for scale in {signal.kind[0] for signal in signals}:
        kinds = sorted({signal.kind for signal in signals if signal.kind[0] == scale})
        of = np.array([kinds.index(signal.kind) if signal.kind in kinds else -1 for signal in signals])
        count = np.stack([usable[:, of == number].sum(axis=1) for number in range(len(kinds))])
        chosen = np.argmax(count >= POLICY.band_share * count.max(axis=0), axis=0)
        taken |= of == chosen[:, None]
    return taken
