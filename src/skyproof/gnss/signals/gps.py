"""Signals of GPS beside L1 C/A, as logs bring them (IS-GPS-200N, IS-GPS-705J, IS-GPS-800J)."""

from typing import Final

from skyproof.gnss.signals.plan import SignalPlan

__all__ = ["GPS"]

_L1_HZ, _L2_HZ, _L5_HZ = 1575.42e6, 1227.60e6, 1176.45e6

L1C: Final = SignalPlan(
    name="GPS L1C",
    systems="G",
    band="L1",
    codes=("S", "L", "X"),
    carrier_hz=_L1_HZ,
    chip_rate_hz=1.023e6,
    code_length=10230,
    secondary_length=1800,
    symbol_s=0.01,
    message="CNAV-2",
)
L2C: Final = SignalPlan(  # CM and CL alternate chip by chip, each of 511.5 kHz; CM repeats every 20 ms
    name="GPS L2C",
    systems="G",
    band="L2",
    codes=("S", "L", "X"),
    carrier_hz=_L2_HZ,
    chip_rate_hz=1.023e6,
    code_length=20460,
    symbol_s=0.02,
    message="CNAV",
)
L2_CA: Final = SignalPlan(
    name="GPS L2 C/A",
    systems="G",
    band="L2",
    codes=("C",),
    carrier_hz=_L2_HZ,
    chip_rate_hz=1.023e6,
    code_length=1023,
    symbol_s=0.02,
    message="LNAV",
)
L5: Final = SignalPlan(
    name="GPS L5",
    systems="G",
    band="L5",
    codes=("I", "Q", "X"),
    carrier_hz=_L5_HZ,
    chip_rate_hz=10.23e6,
    code_length=10230,
    secondary_length=20,
    symbol_s=0.01,
    message="CNAV",
)
PRECISE: Final = tuple(  # P(Y) repeats once a week; M is as wide by its subcarrier
    SignalPlan(
        name=f"GPS {band} {code}", systems="G", band=band, codes=(code,), carrier_hz=carrier_hz, chip_rate_hz=10.23e6
    )
    for band, carrier_hz in (("L1", _L1_HZ), ("L2", _L2_HZ))
    for code in "PYWDMN"
)

GPS: Final = (L1C, L2C, L2_CA, L5, *PRECISE)
