"""Numbers stand in a message where they were put."""

import numpy as np
import pytest

from skyproof.gnss.constants import GPS_PI
from skyproof.gnss.messages import beidou, galileo, glonass
from skyproof.gnss.messages.bit_fields import BitField

TABLES = {
    "INAV": (galileo._INAV, 128),
    "FNAV": (galileo._FNAV, 244),
    "D1": (beidou._D1, 300),
    "D2": (beidou._D2_PAGES, 300),
    "GLONASS": (glonass._STRINGS, 85),
}


@pytest.mark.parametrize(
    ("field", "value"),
    [
        (BitField("a", ((0, 4), (8, 4))), 0xA3),
        (BitField("a", ((0, 4), (8, 4)), signed=True), 0xA3 - 256),
        (BitField("a", ((0, 4), (8, 4)), magnitude=True), -0x23),
        (BitField("a", ((0, 4), (8, 4)), 0.5), 0xA3 / 2),
        (BitField("a", ((0, 4), (8, 4)), 2.0**-7, signed=True, angle=True), (0xA3 - 256) * 2.0**-7 * GPS_PI),
    ],
)
def test_a_number_has_its_sign_scale_and_angle(field, value) -> None:
    assert field.value(0xAF3F, 16) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize("kind", TABLES)
def test_no_two_numbers_of_a_frame_share_a_bit(kind) -> None:
    tables, n_bits = TABLES[kind]
    for number, fields in tables.items():
        used = np.zeros(n_bits, int)
        for field in fields:
            for first, length in field.runs:
                assert first + length <= n_bits, (number, field.name)
                used[first : first + length] += 1
        assert used.max() == 1, (number, np.flatnonzero(used > 1))


@pytest.mark.parametrize("kind", ["D1", "D2"])
def test_no_number_of_beidou_stands_in_parity_bits(kind) -> None:
    tables, _ = TABLES[kind]
    parity = np.zeros(300, bool)
    for word in range(10):
        parity[30 * word + (26 if word == 0 else 22) : 30 * word + 30] = True
    for number, fields in tables.items():
        for field in fields:
            for first, length in field.runs:
                assert not parity[first : first + length].any(), (number, field.name)
