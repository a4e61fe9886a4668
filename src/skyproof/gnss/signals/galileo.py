"""Signals of Galileo, as logs bring them (Galileo OS SIS ICD 2.1, tables 11, 14 to 19; E6-B/C codes note 1.0)."""

from typing import Final

from skyproof.gnss.signals.plan import SignalPlan

__all__ = ["GALILEO"]

E1: Final = SignalPlan(
    name="Galileo E1",
    systems="E",
    band="E1",
    codes=("B", "C", "X"),
    carrier_hz=1575.42e6,
    chip_rate_hz=1.023e6,
    code_length=4092,
    secondary_length=25,
    symbol_s=0.004,
    message="INAV",
)
E5A: Final = SignalPlan(
    name="Galileo E5a",
    systems="E",
    band="E5a",
    codes=("I", "Q", "X"),
    carrier_hz=1176.45e6,
    chip_rate_hz=10.23e6,
    code_length=10230,
    secondary_length=100,
    symbol_s=0.02,
    message="FNAV",
)
E5B: Final = SignalPlan(
    name="Galileo E5b",
    systems="E",
    band="E5b",
    codes=("I", "Q", "X"),
    carrier_hz=1207.14e6,
    chip_rate_hz=10.23e6,
    code_length=10230,
    secondary_length=100,
    symbol_s=0.004,
    message="INAV",
)
E5: Final = SignalPlan(  # both sidebands at once
    name="Galileo E5",
    systems="E",
    band="E5",
    codes=("I", "Q", "X"),
    carrier_hz=1191.795e6,
    chip_rate_hz=10.23e6,
    code_length=10230,
    secondary_length=100,
)
E6: Final = SignalPlan(
    name="Galileo E6",
    systems="E",
    band="E6",
    codes=("B", "C", "X"),
    carrier_hz=1278.75e6,
    chip_rate_hz=5.115e6,
    code_length=5115,
    secondary_length=100,
    symbol_s=0.001,
    message="CNAV",
)

GALILEO: Final = (E1, E5A, E5B, E5, E6)
