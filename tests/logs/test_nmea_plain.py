"""Plain sentences read in bulk give the same as read singly, whatever is damaged."""

from dataclasses import fields

import numpy as np
import pytest
from tests.logs.frames import make_nmea_sentence
from tests.logs.test_nmea import NEAR

from skyproof.logs.content import Beside
from skyproof.logs.nmea_plain import Addresses, pack, unpack
from skyproof.logs.stream import read_log

LETTERS = "0123456789,,,.-ANSEWM*FX"


def find_unplain(octets, begin, length) -> Addresses:
    """Return addresses that are not plain, so that sentences are read singly."""
    return Addresses(np.zeros(begin.size, np.int64), np.zeros(begin.size, np.int64))


def draw_sentences(rng: np.random.Generator, count: int) -> list[str]:
    """Draw sentences of receivers."""
    drawn = []
    for k in range(count):
        time = f"{k // 60 % 24:02d}{k % 60:02d}{rng.integers(0, 61):02d}" + rng.choice(["", ".00", ".250", "."])
        lat = f"{rng.integers(0, 90):02d}{rng.uniform(0, 61):.5f}"
        lon = f"{rng.integers(0, 180):03d}{rng.uniform(0, 60):.7f}"
        place = f"{lat},{rng.choice(list('NSX'))},{lon},{rng.choice(list('EW'))}"
        place = rng.choice([place, place, ",,,"])
        height = rng.choice(["350.0", "-12.25", "", "1e3", "123456789012345678.0"])
        date = rng.choice(["040224", "310124", "290223", "", "4224", "010101"])
        levels = ",".join(
            f"{rng.integers(0, 330)},40,123,{rng.choice(['44', '', '7', '00', '100', '45.5'])}"
            for _ in range(rng.integers(0, 5))
        )
        signal = rng.choice(["", ",1", ",6", ",A", ",b", ",17", ","])
        talker = rng.choice(["GP", "GN", "GA", "GL", "GB", "BD", "XX"])
        status, mode = rng.choice(["A", "V", ""]), rng.choice(["", ",A", ",E", ",EA"])
        quality = rng.choice(["0", "1", "2", "6", "8", "", "12"])
        drawn += [
            f"{talker}RMC,{time},{status},{place},0.0,0.0,{date},,{mode}",
            f"{talker}GGA,{time},{place},{quality},{rng.integers(0, 30)},0.8,{height},M,50.0,M,,",
            f"{talker}GSV,1,1,20{',' if levels else ''}{levels}{signal}",
            f"{talker}{rng.choice(['GSA', 'VTG', 'GLL', 'ZDA'])},{time},A,3,1",
        ]
    return drawn


def split_pieces(octets: bytes):
    return list(read_log([octets[k : k + 4096] for k in range(0, len(octets), 4096)], "rx", Beside(NEAR)))


@pytest.mark.parametrize("seed", range(6))
def test_in_bulk_sentences_give_what_each_gives(seed, monkeypatch) -> None:
    rng = np.random.default_rng(seed)
    drawn = draw_sentences(rng, 80)
    for k in np.flatnonzero(rng.random(len(drawn)) < 0.3 * (seed % 3)):
        text = list(drawn[k])
        text[rng.integers(len(text))] = rng.choice(list(LETTERS))
        drawn[k] = "".join(text)
    octets = b"".join(make_nmea_sentence(text) for text in drawn)
    monkeypatch.setattr("skyproof.logs.frames._BLOCK_BYTES", 3000)
    bulk = split_pieces(octets)
    monkeypatch.setattr("skyproof.logs.nmea.read_addresses", find_unplain)
    single = split_pieces(octets)
    assert len(bulk) == len(single) > 3
    for ours, theirs in zip(bulk, single, strict=True):
        assert ours.damaged_frames == theirs.damaged_frames
        assert {k: n for k, n in ours.messages.items() if n} == {k: n for k, n in theirs.messages.items() if n}
        assert ours.undated_epochs == theirs.undated_epochs
        for name in ("fixes", "observations"):
            first, second = getattr(ours, name), getattr(theirs, name)
            assert (first is None) == (second is None)
            for field in () if first is None else fields(first):
                value, other = getattr(first, field.name), getattr(second, field.name)
                if isinstance(value, np.ndarray):
                    np.testing.assert_array_equal(value, other, err_msg=field.name)
                else:
                    assert value == other, field.name
    assert any(piece.fixes is not None for piece in bulk)


def test_letters_are_packed_and_unpacked() -> None:
    assert [unpack(pack(kind)) for kind in ("GGA", "GSV", "HT")] == ["GGA", "GSV", "HT"]
