"""GPS L1 C/A (IS-GPS-200N): 3.3.1.1 carrier, 3.2.1.3 and 3.3.2.3 code, 3.3.3.1 fifty bits a second."""

from typing import Final

from skyproof.gnss.codes import generate_ca_code
from skyproof.gnss.constants import CA_CHIP_RATE_HZ, CA_CODE_LENGTH, L1_HZ
from skyproof.gnss.lnav import (
    BITS_PER_SUBFRAME,
    Subframe,
    decode_how,
    decode_subframe,
    find_subframes,
    find_word_signs,
)
from skyproof.gnss.signals.plan import MessageDecoder, SignalPlan

__all__ = ["GPS_L1_CA"]


def _is_kept(subframe: Subframe) -> bool:
    """Keep orbit and clock, and the page with ionosphere and UTC."""
    return subframe.id < 4 or "alpha0" in subframe.fields


_LNAV: Final = MessageDecoder(
    frame_bits=BITS_PER_SUBFRAME,
    head_bits=60,
    word_bits=30,
    find_frames=find_subframes,
    read_time=decode_how,
    read_frame=decode_subframe,
    keeps=_is_kept,
    sign_words=find_word_signs,
)

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
    decoder=_LNAV,
    code=generate_ca_code,
    strongest_dbw=-153.0,  # 6.3.1
    highest_side_lobe=65.0 / CA_CODE_LENGTH,  # three-valued Gold codes: -65, -1, 63
)
