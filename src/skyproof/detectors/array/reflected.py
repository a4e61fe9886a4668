"""Find signals from elsewhere than their satellites that reflections alone explain: late, and not stronger."""

from collections.abc import Sequence

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.array.policy import POLICY
from skyproof.detectors.second_signals.policy import POLICY as SECOND_SIGNALS
from skyproof.navigation.search import compute_misfits
from skyproof.navigation.sets import measure_window
from skyproof.records import NavigationData, Observations, SignalId

__all__ = ["levels_dbhz", "select_reflections"]


def select_reflections(
    observations: Observations | None,
    navigation: NavigationData,
    place_ecef_m: Reals,
    true: Sequence[SignalId],
    others: Sequence[SignalId],
    *,
    multipath_sigma_m: float,
    ionosphere_share: float,
) -> dict[SignalId, bool]:
    """Select those of `others` that reflections of the signals in `true` explain, seen from a place (3,).

    They are hardly earlier than the place and the clock of `true` predict. They are weaker than the true signal of
    their satellite. Without one, they may be the sum of the direct signal and its reflection, which is at most
    `blended_gain_db` stronger than the strongest true signal of their kind.

    Returns of each whether it is late by more than noise.

    Signals without a pseudorange are left out: nothing is known of their delay.
    """
    if observations is None or not others or observations.gpst.size == 0:
        return {}
    mean, ranges, usable = measure_window(
        observations, navigation, multipath_sigma_m=multipath_sigma_m, ionosphere_share=ionosphere_share, min_share=0.1
    )
    rows = np.flatnonzero(usable)
    if not rows.size:
        return {}
    misfit_m, sigma_m, _ = compute_misfits(ranges, rows, np.append(place_ecef_m, 0.0))
    late = {mean.signals[row]: (m, s) for row, m, s in zip(rows, misfit_m, sigma_m, strict=True)}
    level = dict(zip(observations.signals, levels_dbhz(observations), strict=True))
    clocks: dict[tuple[str, str, str], list[float]] = {}
    for signal in true:
        if signal in late:
            clocks.setdefault(signal.kind, []).append(late[signal][0])
    found = dict[SignalId, bool]()
    for signal in others:
        if signal not in late or signal.kind not in clocks:
            continue
        late_m = late[signal][0] - float(np.median(clocks[signal.kind]))
        of_sat = [level[signal_id] for signal_id in true if signal_id.transmission == signal.transmission]
        usual = (
            max(of_sat) - SECOND_SIGNALS.copy_weaker_db
            if of_sat
            else max(level[signal_id] for signal_id in true if signal_id.kind == signal.kind) + POLICY.blended_gain_db
        )
        noise_m = float(POLICY.early_sigmas * np.sqrt(2.0) * late[signal][1])
        early_m = max(noise_m, POLICY.blended_chips * signal.plan.chip_m)
        if -early_m < late_m < SECOND_SIGNALS.most_late_m and level[signal] <= usual:
            found[signal] = late_m > noise_m
    return found


def levels_dbhz(observations: Observations) -> list[float]:
    """Return the median C/N0 of each signal; minus infinity of none."""
    levels = []
    for column in range(len(observations.signals)):
        values = observations.cn0_dbhz[:, column]
        known = values[np.isfinite(values)]
        levels.append(float(np.median(known)) if known.size else -np.inf)
    return levels
