"""Signals of BeiDou, as logs bring them (BDS-SIS-ICD: B1I 3.0, B3I 1.0, B1C 1.0, B2a 1.0, B2b 1.0; B2I in 2.1)."""

from typing import Final

from skyproof.gnss.signals.plan import SignalPlan

__all__ = ["BEIDOU"]

_SECOND_GENERATION: Final = tuple(  # satellites that stay over one place send D2, 2 ms a symbol and no secondary code
    SignalPlan(
        name=f"BeiDou {band}I" if code[1] == "I" else f"BeiDou {band} {code}",
        systems="C",
        band=band,
        codes=(code,),
        carrier_hz=carrier_hz,
        chip_rate_hz=chip_rate_hz,
        code_length=code_length,
        secondary_length=20,
        symbol_s=0.02,
        message="D1",
    )
    for band, digit, carrier_hz, chip_rate_hz, code_length in (
        ("B1", "2", 1561.098e6, 2.046e6, 2046),
        ("B2", "7", 1207.14e6, 2.046e6, 2046),
        ("B3", "6", 1268.52e6, 10.23e6, 10230),
    )
    for code in (f"{digit}I", f"{digit}Q", f"{digit}X")
)
B1C: Final = SignalPlan(
    name="BeiDou B1C",
    systems="C",
    band="B1C",
    codes=("1D", "1P", "1X"),
    carrier_hz=1575.42e6,
    chip_rate_hz=1.023e6,
    code_length=10230,
    secondary_length=1800,
    symbol_s=0.01,
    message="BCNAV1",
)
B2A: Final = SignalPlan(
    name="BeiDou B2a",
    systems="C",
    band="B2a",
    codes=("5D", "5P", "5X"),
    carrier_hz=1176.45e6,
    chip_rate_hz=10.23e6,
    code_length=10230,
    secondary_length=100,
    symbol_s=0.005,
    message="BCNAV2",
)
B2B: Final = SignalPlan(
    name="BeiDou B2b",
    systems="C",
    band="B2b",
    codes=("7D", "7P", "7Z"),
    carrier_hz=1207.14e6,
    chip_rate_hz=10.23e6,
    code_length=10230,
    symbol_s=0.001,
    message="BCNAV3",
)
B2AB: Final = SignalPlan(  # both sidebands at once
    name="BeiDou B2a+b",
    systems="C",
    band="B2ab",
    codes=("8D", "8P", "8X"),
    carrier_hz=1191.795e6,
    chip_rate_hz=10.23e6,
    code_length=10230,
)

BEIDOU: Final = (*_SECOND_GENERATION, B1C, B2A, B2B, B2AB)
