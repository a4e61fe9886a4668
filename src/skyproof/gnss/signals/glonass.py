"""Signals of GLONASS, as logs bring them (ICD L1, L2 5.1; ICD CDMA L1, L2, L3 1.0)."""

from typing import Final

from skyproof.gnss.signals.plan import SignalPlan

__all__ = ["GLONASS"]

_OF_NUMBER_0: Final = (("G1", 1602.0e6, 0.5625e6), ("G2", 1246.0e6, 0.4375e6))  # ICD 5.1, 3.3.1.1

_STANDARD: Final = tuple(
    SignalPlan(
        name=f"GLONASS {band} C/A",
        systems="R",
        band=band,
        codes=("CA",),
        carrier_hz=carrier_hz,
        carrier_step_hz=step_hz,
        chip_rate_hz=0.511e6,
        code_length=511,
        symbol_s=0.01,  # fifty bits a second, each with a meander
        message="GNAV",
    )
    for band, carrier_hz, step_hz in _OF_NUMBER_0
)
_PRECISE: Final = tuple(
    SignalPlan(
        name=f"GLONASS {band} P",
        systems="R",
        band=band,
        codes=("P",),
        carrier_hz=carrier_hz,
        carrier_step_hz=step_hz,
        chip_rate_hz=5.11e6,
    )
    for band, carrier_hz, step_hz in _OF_NUMBER_0
)
L3: Final = SignalPlan(
    name="GLONASS L3OC",
    systems="R",
    band="G3",
    codes=("I", "Q", "X"),
    carrier_hz=1202.025e6,
    chip_rate_hz=10.23e6,
    code_length=10230,
    secondary_length=10,
    symbol_s=0.005,
)
_CODE_DIVISION: Final = tuple(  # data and pilot alternate chip by chip, each of 511.5 kHz
    SignalPlan(
        name=f"GLONASS {name} {code}",
        systems="R",
        band=band,
        codes=(code,),
        carrier_hz=carrier_hz,
        chip_rate_hz=1.023e6,
    )
    for name, band, carrier_hz in (("L1OC", "G1a", 1600.995e6), ("L2OC", "G2a", 1248.06e6))
    for code in "ABX"
)

GLONASS: Final = (*_STANDARD, *_PRECISE, L3, *_CODE_DIVISION)
