"""Compare the levels of a front end's chains with their own past."""

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from skyproof.arrays import Booleans, Reals
from skyproof.detectors.levels.laws import OwnScale
from skyproof.detectors.levels.policy import POLICY
from skyproof.records import FrontEndLevels, SignalId

__all__ = ["Gauge", "GaugeChange", "average_readings", "carrier_name", "chain_covers", "follow_gauges"]

_CARRIERS: Final = {
    "L1": "L1",
    "E1": "L1",
    "B1C": "L1",
    "L5": "L5",
    "E5a": "L5",
    "B2a": "L5",
    "E5b": "E5b",
    "B2": "E5b",
    "B2b": "E5b",
    "E5": "E5",
    "B2ab": "E5",
    "E6": "E6",
    "L6": "E6",
}
_UPPER: Final = frozenset({"L1", "B1", "G1", "G1a"})
"""Carriers from 1559 to 1610 MHz; the others lie from 1164 to 1300 MHz."""
_UPPER_NAMES: Final = ("L1", "E1", "B1", "G1")
_LOWER_NAMES: Final = ("L2", "L5", "L6", "E5", "E6", "B2", "B3", "G2", "G3")


class Gauge(NamedTuple):
    """Own level of a front end's chain, in sigmas of the settings: mean of so many windows, and its scale."""

    level: float
    windows: float
    scale: OwnScale


class GaugeChange(NamedTuple):
    """How far a chain's level is over its own past: in sigmas, in dB where that is known, and the chances of it.

    sigma_db : of rise_db by the gain's own wander. rise, fall : chance of a level so far up or down.
    """

    chain: str
    kind: str
    statistic: float
    rise_db: float
    sigma_db: float
    rise: float
    fall: float


def follow_gauges(
    levels: FrontEndLevels | None,
    before: Mapping[tuple[str, str], Gauge],
    *,
    gain_db: float,
    gain_share: float,
    steady_probability: float,
) -> tuple[list[GaugeChange], dict[tuple[str, str], Gauge]]:
    """Compare the front end's levels with their past, and update what is remembered of them.

    gain_db, gain_share : by which the gain wanders, one sigma, dB or a share of the full scale. steady_probability : a
    level that is less probable than this over their number is no part of the past.
    """
    after = dict(before)
    changes = []
    for (chain, kind), value in average_readings(levels, gain_db, gain_share).items():
        gauge = after.get((chain, kind))
        if gauge is None:
            after[chain, kind] = Gauge(value, 1.0, OwnScale())
            continue
        statistic = (value - gauge.level) / np.sqrt(1.0 + 1.0 / gauge.windows)
        rise, fall = gauge.scale.above(statistic), gauge.scale.below(statistic)
        in_db = gain_db if kind != "share" else np.nan
        rise_db, sigma_db = (
            (value - gauge.level) * in_db,
            in_db * gauge.scale.sigma * np.sqrt(1.0 + 1.0 / gauge.windows),
        )
        changes.append(GaugeChange(chain, kind, float(statistic), rise_db, float(sigma_db), rise, fall))
        if min(rise, fall) * len(after) > steady_probability:
            windows = min(gauge.windows + 1.0, POLICY.remembered_windows)
            level = gauge.level + (value - gauge.level) / windows
            after[chain, kind] = Gauge(level, windows, gauge.scale.after(statistic))
    return changes, after


def average_readings(levels: FrontEndLevels | None, gain_db: float, gain_share: float) -> dict[tuple[str, str], float]:
    """Return the median of readings, in sigmas, by chain and kind."""
    if levels is None:
        return {}
    agc_db = levels.agc_db
    readings: dict[str, Reals] = {
        "input": (np.nan_to_num(levels.noise_db) - agc_db) / gain_db,
        "share": np.where(np.isfinite(agc_db), np.nan, -levels.agc_share) / gain_share,
        "noise": np.where(np.isfinite(agc_db), np.nan, levels.noise_db) / gain_db,
    }
    found: dict[tuple[str, str], float] = {}
    for chain in np.unique(levels.band).tolist():
        rows = levels.band == chain
        for kind, values in readings.items():
            known: Booleans = rows & np.isfinite(values)
            if known.any():
                found[chain, kind] = float(np.median(values[known]))
    return found


def carrier_name(signal: SignalId) -> str:
    """Name the carrier of a signal: by GPS's name where other systems share it."""
    return _CARRIERS.get(signal.band, signal.band)


def chain_covers(chain: str, carrier: str) -> bool:
    """Tell whether a front end's chain, named as `FrontEndLevels.band`, may receive a carrier; yes where not known."""
    upper, lower = (any(name in chain for name in names) for names in (_UPPER_NAMES, _LOWER_NAMES))
    if not (upper or lower):
        return True
    return upper if carrier in _UPPER else lower
