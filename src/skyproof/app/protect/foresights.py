"""What a run knows of each receiver that says which of two skies is true: from its settings and the platform file."""

from collections.abc import Mapping, Sequence

import numpy as np

from skyproof.app.common.platform import Platform
from skyproof.app.common.platform_tables import PlatformReceiver
from skyproof.app.common.settings import Settings
from skyproof.gnss.oscillators import OSCILLATORS, PLATFORM_CLASSES
from skyproof.navigation.foresight import Foresight, Standing, surveyed

__all__ = ["foresights_of"]


def foresights_of(
    names: Sequence[str],
    settings: Settings,
    platform: Platform | None = None,
    tables: Mapping[str, PlatformReceiver] | None = None,
) -> dict[str, Foresight]:
    """By receiver; none of one of which neither place nor motion nor clock is known. tables : see `described`."""
    found: dict[str, Foresight] = {}
    for name in names:
        table = None if tables is None else tables.get(name)
        moving = platform is not None and platform.motion == "moving"
        place = None if table is None or moving else table.position
        stands = settings.speed_max_m_s == 0.0 or place is not None
        by, assumes = [], []
        if place is not None:
            by.append("its surveyed place")
            assumes.append(f"{name} stands where it was surveyed")
        elif stands:
            by.append("its standing still")
            assumes.append(f"{name} does not move")
        if settings.oscillator is not None:
            by.append("its clock")
            assumes.append(f"the clock of {name} runs freely on an oscillator of the class {settings.oscillator}")
        if not by:
            continue
        oscillator = None if settings.oscillator is None else OSCILLATORS[PLATFORM_CLASSES[settings.oscillator]]
        standing = Standing(stands=stands, oscillator=oscillator, by=" and ".join(by), assumes=tuple(assumes))
        if place is not None:
            standing = surveyed(standing, place.ecef_m, place.sigma_m**2 * np.eye(3))
        found[name] = standing
    return found
