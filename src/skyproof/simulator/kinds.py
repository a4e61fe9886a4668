"""Simulate what satellites send on several bands: carriers and delays beside those of the first signal."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import BroadcastEphemeris, GlonassEphemeris, group_delay_s
from skyproof.gnss.signals import carrier_hz_of
from skyproof.simulator.ranges import FIRST_SIGNAL

__all__ = ["Kind"]

_UNKNOWN_S = 1e-9
_UNKNOWN_STEPS = 13


@dataclass(frozen=True)
class Kind:
    """One signal of all satellites of a system.

    system, band, code : as in `records.SignalId`. receiver_delay_m : by a receiver's name, how much later it measures
        these signals than their first kind's by GPS's clock: its own delay of them, and what their time scale is off.
    """

    system: str
    band: str
    code: str
    receiver_delay_m: Mapping[str, float] = field(default_factory=dict)

    def carrier_hz(self, ephemeris: BroadcastEphemeris) -> float:
        """Return the nominal carrier; GLONASS's is the satellite's own."""
        number = ephemeris.frequency_number if isinstance(ephemeris, GlonassEphemeris) else None
        return carrier_hz_of(self.band, number)

    def satellite_delay_m(self, ephemeris: BroadcastEphemeris) -> float:
        """Return how much later the satellite sends it than its system's first signal.

        The message gives it; else some nanoseconds that differ from satellite to satellite.
        """
        known_s = group_delay_s(ephemeris, self.band, self.code)
        if not np.isfinite(known_s):
            known_s = _UNKNOWN_S * (int(ephemeris.sat[1:]) * 7 % _UNKNOWN_STEPS - _UNKNOWN_STEPS // 2)
        return SPEED_OF_LIGHT_M_S * (known_s - group_delay_s(ephemeris, *FIRST_SIGNAL[ephemeris.sat[0]]))
