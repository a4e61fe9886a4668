"""Golden chips: IS-GPS-200N, table 3-Ia (PRN 1 to 37) and table 3-Ib / RTCA DO-229, table A-1 (SBAS)."""

import numpy as np
import pytest

from skyproof.gnss.codes import UNUSED_DELAYS_CHIPS, UNUSED_PRNS, generate_ca_code, generate_gold_code

FIRST_TEN_OCTAL = (
    0o1440, 0o1620, 0o1710, 0o1744, 0o1133, 0o1455, 0o1131, 0o1454, 0o1626, 0o1504, 0o1642, 0o1750, 0o1764, 0o1772,
    0o1775, 0o1776, 0o1156, 0o1467, 0o1633, 0o1715, 0o1746, 0o1763, 0o1063, 0o1706, 0o1743, 0o1761, 0o1770, 0o1774,
    0o1127, 0o1453, 0o1625, 0o1712, 0o1745, 0o1713, 0o1134, 0o1456, 0o1713,
)  # fmt: skip
SBAS_FIRST_TEN_OCTAL = (
    0o0671, 0o0536, 0o1510, 0o1545, 0o0160, 0o0701, 0o0013, 0o1060, 0o0245, 0o0527, 0o1436, 0o1226, 0o1257, 0o0046,
    0o1071, 0o0561, 0o1037, 0o0770, 0o1327,
)  # fmt: skip

# Table 3-Ia gives each code twice: as a delay of G2 and as two stages of G2 whose sum is that delay.
G2_STAGES = (
    (2, 6), (3, 7), (4, 8), (5, 9), (1, 9), (2, 10), (1, 8), (2, 9), (3, 10), (2, 3), (3, 4), (5, 6), (6, 7), (7, 8),
    (8, 9), (9, 10), (1, 4), (2, 5), (3, 6), (4, 7), (5, 8), (6, 9), (1, 3), (4, 6), (5, 7), (6, 8), (7, 9), (8, 10),
    (1, 6), (2, 7), (3, 8), (4, 9), (5, 10), (4, 10), (1, 7), (2, 8), (4, 10),
)  # fmt: skip


def read_first_ten(prn):
    return int("".join("1" if chip < 0 else "0" for chip in generate_ca_code(prn)[:10]), 2)


def step_registers(stage_a, stage_b):
    """Step both registers together and read G2 at two stages (IS-GPS-200N, figure 3-10): the slow twin."""
    g1, g2, chips = [1] * 10, [1] * 10, []
    for _ in range(1023):
        chips.append(g1[9] ^ g2[stage_a - 1] ^ g2[stage_b - 1])
        g1 = [g1[2] ^ g1[9], *g1[:9]]
        g2 = [g2[1] ^ g2[2] ^ g2[5] ^ g2[7] ^ g2[8] ^ g2[9], *g2[:9]]
    return 1 - 2 * np.array(chips)


@pytest.mark.parametrize(("prn", "octal"), [*enumerate(FIRST_TEN_OCTAL, start=1)])
def test_the_first_ten_chips_are_those_of_the_standard(prn, octal):
    assert read_first_ten(prn) == octal


@pytest.mark.parametrize(("prn", "octal"), [*enumerate(SBAS_FIRST_TEN_OCTAL, start=120)])
def test_the_first_ten_chips_of_sbas_are_those_of_the_standard(prn, octal):
    assert read_first_ten(prn) == octal


@pytest.mark.parametrize(("prn", "stages"), [*enumerate(G2_STAGES, start=1)])
def test_a_delayed_register_equals_the_sum_of_two_stages(prn, stages):
    np.testing.assert_array_equal(generate_ca_code(prn), step_registers(*stages))


def test_codes_are_gold_codes():
    codes = np.array([generate_ca_code(prn) for prn in range(1, 33)], dtype=float)
    assert set(codes.sum(axis=-1)) == {-1.0}  # 512 ones, 511 zeros
    spectra = np.fft.fft(codes)
    products = np.rint(np.fft.ifft(spectra[:, None] * spectra.conj()).real).astype(int)
    peaks = products[np.arange(32), np.arange(32)]
    assert set(peaks[:, 0]) == {1023}
    assert set(peaks[:, 1:].ravel()) == {-65, -1, 63}
    rest = products[~np.eye(32, dtype=bool)]
    assert set(rest.ravel()) == {-65, -1, 63}


def test_a_code_is_made_once_and_read_only():
    assert generate_ca_code(5) is generate_ca_code(5)
    assert generate_ca_code(5).dtype == np.int8
    with pytest.raises(ValueError, match="read-only"):
        generate_ca_code(5)[0] = 0


def test_codes_for_calibrating_belong_to_no_satellite():
    sent = {generate_ca_code(prn).tobytes() for prn in (*range(1, 33), *range(120, 159), *range(193, 203))}
    assert not sent & {generate_ca_code(prn).tobytes() for prn in UNUSED_PRNS}
    assert not sent & {generate_gold_code(delay).tobytes() for delay in UNUSED_DELAYS_CHIPS}
    assert len(UNUSED_DELAYS_CHIPS) == 1023 - 209  # PRN 34 and 37 share one


@pytest.mark.parametrize("prn", [0, 211, -3])
def test_a_prn_without_a_code_is_refused(prn):
    with pytest.raises(ValueError, match=rf"PRN {prn} "):
        generate_ca_code(prn)
