"""Signals of QZSS, of SBAS and of NavIC, as logs bring them.

IS-QZSS-PNT-005 and IS-QZSS-L6-004; RTCA DO-229F, appendix A, and DO-401; NavIC SIS ICD for SPS 1.1 and L1 SPS 1.0.
"""

from dataclasses import replace
from typing import Final

from skyproof.gnss.codes import generate_ca_code
from skyproof.gnss.signals.gps import L1C, L2C, L5
from skyproof.gnss.signals.gps_l1_ca import GPS_L1_CA
from skyproof.gnss.signals.plan import SignalPlan

__all__ = ["NAVIC", "QZSS", "SBAS"]

QZSS: Final = (
    replace(GPS_L1_CA, name="QZSS L1 C/A", systems="J", strongest_dbw=L1C.strongest_dbw),
    replace(L1C, name="QZSS L1C", systems="J"),
    replace(L2C, name="QZSS L2C", systems="J"),
    replace(L5, name="QZSS L5", systems="J"),
    *(
        SignalPlan(  # two codes alternate chip by chip, each of 2.5575 MHz, shifted by what they send in each 4 ms
            name=f"QZSS L6 {code}",
            systems="J",
            band="L6",
            codes=(code,),
            carrier_hz=1278.75e6,
            chip_rate_hz=5.115e6,
            code_length=20460,
            symbol_s=0.004,
        )
        for code in "SLXEZ"
    ),
)
SBAS: Final = (
    SignalPlan(
        name="SBAS L1",
        systems="S",
        band="L1",
        codes=("CA",),
        carrier_hz=GPS_L1_CA.carrier_hz,
        chip_rate_hz=1.023e6,
        code_length=1023,
        symbol_s=0.002,
        message="SBAS",
        code=generate_ca_code,
        highest_side_lobe=GPS_L1_CA.highest_side_lobe,
    ),
    SignalPlan(
        name="SBAS L5",
        systems="S",
        band="L5",
        codes=("I", "Q", "X"),
        carrier_hz=L5.carrier_hz,
        chip_rate_hz=10.23e6,
        code_length=10230,
        symbol_s=0.002,
        message="SBAS",
    ),
)
NAVIC: Final = (
    SignalPlan(
        name="NavIC L1 SPS",
        systems="I",
        band="L1",
        codes=("D", "P", "X"),
        carrier_hz=GPS_L1_CA.carrier_hz,
        chip_rate_hz=1.023e6,
        code_length=10230,
        secondary_length=1800,
        symbol_s=0.01,
    ),
    *(
        SignalPlan(
            name=f"NavIC {band} SPS",
            systems="I",
            band=band,
            codes=("A",),
            carrier_hz=carrier_hz,
            chip_rate_hz=1.023e6,
            code_length=1023,
            symbol_s=0.02,
        )
        for band, carrier_hz in (("L5", 1176.45e6), ("S", 2492.028e6))
    ),
    *(
        SignalPlan(
            name=f"NavIC {band} RS {code}",
            systems="I",
            band=band,
            codes=(code,),
            carrier_hz=carrier_hz,
            chip_rate_hz=2.046e6,
        )
        for band, carrier_hz in (("L5", 1176.45e6), ("S", 2492.028e6))
        for code in "BCX"
    ),
)
