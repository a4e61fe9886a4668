"""Find the plan of a signal by the names that receivers give it."""

from dataclasses import replace
from functools import cache
from typing import Final

import numpy as np

from skyproof.gnss.signals.beidou import BEIDOU
from skyproof.gnss.signals.galileo import GALILEO
from skyproof.gnss.signals.glonass import GLONASS
from skyproof.gnss.signals.gps import GPS
from skyproof.gnss.signals.gps_l1_ca import GPS_L1_CA
from skyproof.gnss.signals.plan import SignalPlan
from skyproof.gnss.signals.regional import NAVIC, QZSS, SBAS

__all__ = ["PLANS", "carrier_hz_of", "frequency_number_of", "plan_of", "service_of"]

PLANS: Final = (GPS_L1_CA, *GPS, *GALILEO, *BEIDOU, *GLONASS, *QZSS, *SBAS, *NAVIC)
"""Of one system and band, the signal that most receivers take comes first."""
_OF_BAND: Final = {plan.band: plan for plan in reversed(PLANS)}
"""All signals of a band have one carrier."""


@cache
def plan_of(system: str, band: str, code: str) -> SignalPlan:
    """Return the plan of a signal by its system's letter, its band and its code (`SignalId`).

    A code that no plan names is a signal of its own. It has the chips of the first plan of that system and band, or of
    that band in another system. Raises ValueError for a band that no system has.
    """
    of_band = [plan for plan in PLANS if plan.band == band]
    of_system = [plan for plan in of_band if system in plan.systems]
    named = next((plan for plan in of_system if code in plan.codes), None)
    if named is not None:
        return named
    if not of_band:
        raise ValueError(f"{band!r} is not a band; expected one of {', '.join(sorted(_OF_BAND))}")
    return replace((of_system or of_band)[0], codes=(code,))


def service_of(system: str, band: str, code: str) -> str:
    """Return one name for the codes by which receivers take the same signal: of a pilot, of its data, or of both.

    Receivers call what they tracked by different codes, "C" or "X" on E1, that are one signal with one delay.
    """
    codes = plan_of(system, band, code).codes
    return code if len(codes) == 1 else f"{band} {' '.join(codes)}"


def frequency_number_of(band: str, carrier_hz: float) -> int | None:
    """Return GLONASS's frequency number of a carrier in its bands G1 and G2; None in any other band."""
    plan = _OF_BAND.get(band)
    if plan is None or not plan.carrier_step_hz or not np.isfinite(carrier_hz):
        return None
    return round((carrier_hz - plan.carrier_hz) / plan.carrier_step_hz)


def carrier_hz_of(band: str, frequency_number: int | None = None) -> float:
    """Return the carrier of a band in Hz; of GLONASS's G1 and G2 by the satellite's frequency number, NaN without it.

    Raises KeyError for a band that no system has.
    """
    plan = _OF_BAND[band]
    if not plan.carrier_step_hz:
        return plan.carrier_hz
    return float("nan") if frequency_number is None else plan.carrier_hz + plan.carrier_step_hz * frequency_number
