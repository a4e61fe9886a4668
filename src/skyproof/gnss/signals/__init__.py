"""Signals: one description each, found by the names that receivers give them.

Samples are received of `GPS_L1_CA`; measurements of all others come from observation files and logs.
"""

from skyproof.gnss.signals.catalogue import PLANS, carrier_hz_of, frequency_number_of, plan_of, service_of
from skyproof.gnss.signals.gps_l1_ca import GPS_L1_CA
from skyproof.gnss.signals.names import GPS_SATS, prn_of, rinex_attribute, rinex_signal, sat_name, time_scale_of
from skyproof.gnss.signals.plan import MessageDecoder, SignalPlan

__all__ = [
    "GPS_L1_CA",
    "GPS_SATS",
    "PLANS",
    "MessageDecoder",
    "SignalPlan",
    "carrier_hz_of",
    "frequency_number_of",
    "plan_of",
    "prn_of",
    "rinex_attribute",
    "rinex_signal",
    "sat_name",
    "service_of",
    "time_scale_of",
]
