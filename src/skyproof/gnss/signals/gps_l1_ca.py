"""GPS L1 C/A (IS-GPS-200N): 3.3.1.1 carrier, 3.2.1.3 and 3.3.2.3 code, 3.3.3.1 fifty bits a second."""

from typing import Final

from skyproof.gnss.codes import ca_code
from skyproof.gnss.constants import CA_CHIP_RATE_HZ, CA_CODE_LENGTH, L1_HZ
from skyproof.gnss.signals.plan import SignalPlan

__all__ = ["GPS_L1_CA"]

GPS_L1_CA: Final = SignalPlan(
    name="GPS L1 C/A",
    systems="G",
    band="L1",
    codes=("CA",),
    carrier_hz=L1_HZ,
    chip_rate_hz=CA_CHIP_RATE_HZ,
    code_length=CA_CODE_LENGTH,
    symbol_s=0.02,
    message="LNAV",
    code=ca_code,
    highest_side_lobe=65.0 / CA_CODE_LENGTH,  # three-valued Gold codes: -65, -1, 63
)
