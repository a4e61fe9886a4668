"""C/A codes: Gold codes of 1023 chips (IS-GPS-200N, 3.2.1.3 and 3.3.2.3)."""

from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from skyproof.gnss.constants import CA_CODE_LENGTH

__all__ = ["UNUSED_DELAYS_CHIPS", "UNUSED_PRNS", "generate_ca_code", "generate_gold_code"]

_G1_TAPS: Final = (3, 10)  # 1 + X^3 + X^10
_G2_TAPS: Final = (2, 3, 6, 8, 9, 10)  # 1 + X^2 + X^3 + X^6 + X^8 + X^9 + X^10

_G2_DELAYS_CHIPS: Final = (
    5, 6, 7, 8, 17, 18, 139, 140, 141, 251, 252, 254, 255, 256, 257, 258, 469, 470, 471, 472, 473, 474, 509, 512, 513,
    514, 515, 516, 859, 860, 861, 862, 863, 950, 947, 948, 950, 67, 103, 91, 19, 679, 225, 625, 946, 638, 161, 1001,
    554, 280, 710, 709, 775, 864, 558, 220, 397, 55, 898, 759, 367, 299, 1018, 729, 695, 780, 801, 788, 732, 34, 320,
    327, 389, 407, 525, 405, 221, 761, 260, 326, 955, 653, 699, 422, 188, 438, 959, 539, 879, 677, 586, 153, 792, 814,
    446, 264, 1015, 278, 536, 819, 156, 957, 159, 712, 885, 461, 248, 713, 126, 807, 279, 122, 197, 693, 632, 771, 467,
    647, 203, 145, 175, 52, 21, 237, 235, 886, 657, 634, 762, 355, 1012, 176, 603, 130, 359, 595, 68, 386, 797, 456,
    499, 883, 307, 127, 211, 121, 118, 163, 628, 853, 484, 289, 811, 202, 1021, 463, 568, 904, 670, 230, 911, 684, 309,
    644, 932, 12, 314, 891, 212, 185, 675, 503, 150, 395, 345, 846, 798, 992, 357, 995, 877, 112, 144, 476, 193, 109,
    445, 291, 87, 399, 292, 901, 339, 208, 711, 189, 263, 537, 663, 942, 173, 900, 30, 500, 935, 556, 373, 85, 652, 310,
)  # fmt: skip
"""G2 delay of PRN 1 to 210: IS-GPS-200N, tables 3-Ia (GPS), 3-Ib and 6-I (SBAS, QZSS and reserved)."""

UNUSED_PRNS: Final = (33, 34, 35, 36)
"""PRNs of table 3-Ia that no satellite sends (reserved for other uses; 37 repeats 34): for calibrating a search."""

UNUSED_DELAYS_CHIPS: Final = tuple(sorted(set(range(CA_CODE_LENGTH)) - set(_G2_DELAYS_CHIPS)))
"""G2 delays of Gold codes that no listed transmitter sends: more codes for calibrating, by `generate_gold_code`."""


@cache
def generate_ca_code(prn: int) -> NDArray[np.int8]:
    """Generate one period of the C/A code of `prn`: shape (1023,), +1 for chip 0, -1 for chip 1.

    PRN 1 to 210 have a code; 1 to 32 are GPS.

    Computed once and read-only. Raises ValueError for a PRN without a code.
    """
    if not 1 <= prn <= len(_G2_DELAYS_CHIPS):
        raise ValueError(f"PRN {prn} has no C/A code; expected 1 to {len(_G2_DELAYS_CHIPS)}")
    return generate_gold_code(_G2_DELAYS_CHIPS[prn - 1])


@cache
def generate_gold_code(delay_chips: int) -> NDArray[np.int8]:
    """Generate the Gold code G1 xor G2 delayed by `delay_chips`.

    Shape (1023,), +1 for chip 0, -1 for chip 1, read-only.
    """
    chips = _run_register(_G1_TAPS) ^ np.roll(_run_register(_G2_TAPS), delay_chips)
    code = (1 - 2 * chips).astype(np.int8)
    code.flags.writeable = False
    return code


@cache
def _run_register(taps: tuple[int, ...]) -> NDArray[np.int8]:
    """Run a 10-stage shift register for one period: all ones at the start, feedback `taps`, output stage 10."""
    stages = [1] * 10
    chips = np.empty(CA_CODE_LENGTH, dtype=np.int8)
    for k in range(CA_CODE_LENGTH):
        chips[k] = stages[9]
        stages = [sum(stages[tap - 1] for tap in taps) % 2, *stages[:9]]
    return chips
