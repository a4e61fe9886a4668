"""A file in pieces gives what the whole gives, wherever it is cut and however it is packed."""

import gzip
import itertools
import re
import zlib
from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skyproof.errors import InputError
from skyproof.formats import rinex_obs_pieces
from skyproof.formats.rinex_obs_pieces import continue_pieces, read_obs_pieces
from skyproof.formats.rinex_obs_read import parse_obs
from skyproof.records import Observations
from skyproof.remarks import Remark, RemarkKind

TYPES_3 = f"{'G    4 C1C L1C D1C S1C':60}SYS / # / OBS TYPES"
VERSION_3 = [
    f"{'     3.05           OBSERVATION DATA    G: GPS':60}RINEX VERSION / TYPE",
    TYPES_3,
    f"{'':60}END OF HEADER",
]
VERSION_2 = [
    f"{'     2.11           OBSERVATION DATA    G (GPS)':60}RINEX VERSION / TYPE",
    f"{'     4    C1    L1    D1    S1':60}# / TYPES OF OBSERV",
    f"{'':60}END OF HEADER",
]


def join_pieces(pieces):
    """Join the observations of pieces of a file to one record."""
    return Observations.join([*continue_pieces(piece.observations for piece in pieces)])


def write_cell(value, lli=" "):
    return f"{value:14.3f}{lli}7"


def write_satellite_3(k, n):
    marks = "2" if (k // 3 + n) % 4 == 0 else " "  # a half cycle, now and then
    return (
        f"G{n:02d}"
        + write_cell(2.2e7 + 100.0 * k + n)
        + write_cell(1e6 + 500.0 * k + n, marks)
        + write_cell(-500.0)
        + write_cell(44.0)
    )


def make_file_3(n_epochs=24):
    lines = list(VERSION_3)
    for k in range(n_epochs):
        if k == 7:
            lines += [">                              4  1", f"{'a splice':60}COMMENT"]
        if k == 11:
            lines += ["> 2024 05 14 10 00 11.0000000  6  1", "G07" + write_cell(0.0) + write_cell(3.0)]
        sats = [n for n in (5, 7, 9, 12) if (k + n) % 9]
        lines.append(f"> 2024 05 14 10 {k // 60:02d} {k % 60:2d}.0000000  {1 if k == 15 else 0}{len(sats):3d}")
        lines += [write_satellite_3(k, n) for n in sats]
        if k == 18:  # other types from now on: the phase first
            lines += [">                              4  1", TYPES_3.replace("C1C L1C", "L1C C1C")]
        if k == 20:  # a file put behind another
            lines += VERSION_3
    return "\n".join([*lines, ""]).encode()


def make_file_2(n_epochs=24):
    lines = list(VERSION_2)
    for k in range(n_epochs):
        sats = [n for n in (5, 7, 9, 12) if (k + n) % 9]
        listed = "".join(f"G{n:02d}" for n in sats)
        lines.append(f" 24  5 14 10  0 {k:2d}.0000000  0{len(sats):3d}{listed}")
        lines += [write_satellite_3(k, n)[3:] for n in sats]
        if k == 7:
            lines += [f"{'':28}4  1", f"{'a splice':60}COMMENT"]
        if k == 15:
            lines += [text.replace("    C1    L1", "    L1    C1") for text in VERSION_2]
    return "\n".join([*lines, ""]).encode()


def split_content(content, cuts):
    edges = [0, *sorted(cuts), len(content)]
    return [content[a:b] for a, b in itertools.pairwise(edges)]


def assert_same(a, b):
    assert a.signals == b.signals
    for f in fields(a):
        first, other = getattr(a, f.name), getattr(b, f.name)
        if isinstance(first, np.ndarray):
            np.testing.assert_array_equal(first, other, err_msg=f.name)


@pytest.mark.parametrize("content", [make_file_3(), make_file_2()], ids=["3", "2"])
@settings(deadline=None, max_examples=25)
@given(st.data())
def test_pieces_put_together_are_the_whole_file(content, data):
    cuts = data.draw(st.lists(st.integers(0, len(content)), max_size=6))
    piece_bytes = data.draw(st.integers(1, len(content)))
    packed = data.draw(st.booleans())
    given_bytes = gzip.compress(content) if packed else content
    cuts = [min(cut, len(given_bytes)) for cut in cuts]
    found = list(read_obs_pieces(split_content(given_bytes, cuts), piece_bytes=piece_bytes))
    whole = parse_obs(content)
    assert_same(join_pieces(found), whole.observations)
    remarks = [remark for piece in found for remark in piece.remarks]
    assert sum("header lines" in remark for remark in remarks) >= 1


def test_no_piece_is_larger_than_was_asked_for():
    content = make_file_3(600)
    found = list(read_obs_pieces(split_content(content, range(500, len(content), 500)), piece_bytes=4000))
    assert len(found) > 20
    assert max(piece.observations.gpst.size for piece in found) < 30
    assert sum(piece.observations.gpst.size for piece in found) == 600


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (gzip.compress(make_file_3())[:-8] + b"xxxxxxxx", r"a\.obs: .*gzip"),
        (b"\n".join(VERSION_3[i].encode() for i in (0, 1)), r"a\.obs, line 2: .*END OF HEADER"),
        (b"", "expected RINEX VERSION / TYPE"),
    ],
)
def test_a_damaged_file_is_refused_where_it_is_come_upon(content, words):
    with pytest.raises(InputError, match=words):
        list(read_obs_pieces([content], source="a.obs"))


CRINEX = [
    f"{'3.0                 COMPACT RINEX FORMAT':60}CRINEX VERS   / TYPE",
    f"{'RNX2CRX':60}CRINEX PROG / DATE",
]
MEBIBYTE = 1 << 20


def make_bomb(head, filling, mebibytes):
    """Make a gzip file of so many mebibytes of one filling, without holding them."""
    packer = zlib.compressobj(9, zlib.DEFLATED, 31)
    unit = (filling * (MEBIBYTE // len(filling) + 1))[:MEBIBYTE]
    parts = [packer.compress("\n".join([*head, ""]).encode()), *(packer.compress(unit) for _ in range(mebibytes))]
    return b"".join([*parts, packer.flush()])


@pytest.mark.parametrize("filling", [b" ", b"\n", b" " * 79 + b"\n", b"\0"], ids=["blank", "ends", "lines", "zero"])
@pytest.mark.parametrize("head", [VERSION_3, [], VERSION_3[:1], [*CRINEX, *VERSION_3], CRINEX])
def test_a_gzip_bomb_is_refused_before_it_is_read(monkeypatch, head, filling):
    monkeypatch.setattr(rinex_obs_pieces, "OBSERVATION_BYTES", 8 * MEBIBYTE)
    content = make_bomb(head, filling, 40)
    blocks_read = 0

    def count():
        nonlocal blocks_read
        for at in range(0, len(content), 4096):
            blocks_read += 1
            yield content[at : at + 4096]

    with pytest.raises(InputError):
        list(read_obs_pieces(count(), source="b.gz"))
    assert blocks_read * 4096 < 0.7 * len(content)


def test_what_is_unpacked_has_a_bound(monkeypatch):
    monkeypatch.setattr(rinex_obs_pieces, "STREAM_BYTES", 2000)
    with pytest.raises(InputError, match=r"unpacked.*MiB"):
        list(read_obs_pieces([gzip.compress(make_file_3())]))


def test_garbage_amid_epochs_costs_no_others(monkeypatch):
    monkeypatch.setattr(rinex_obs_pieces, "EPOCH_BYTES", 4096)
    whole = make_file_3()
    at = whole.index(b"> 2024 05 14 10 00 12.")
    found = join_pieces(read_obs_pieces([whole[:at], b"\0" * 20_000, b"\n", whole[at:]], piece_bytes=1024))
    assert found.gpst.size == parse_obs(whole).observations.gpst.size


def test_remarks_on_a_compact_file_and_a_header_come_through():
    content = "\n".join([*CRINEX, VERSION_3[0], TYPES_3.replace("G    4", "G    6"), *VERSION_3[2:]])
    epochs = ["> 2024 05 14 10 00 01.0000000  0  1      G05", "", "3&20000000000   ", f"{'':24}x"]
    pieces = list(read_obs_pieces(["\n".join([content, *epochs, ""]).encode()]))
    remarks = " ".join(pieces[-1].remarks)
    assert re.search(r"\b6 \w+ types of G .*\b4\b", remarks)
    assert any(Remark.kind_of(remark) is RemarkKind.CUT for remark in pieces[-1].remarks)


REAL = [
    "rinex-gsi-3km/07590920.05o",
    "rinex-mosaic-5km/SEPT265G.21O",
    "rinex-variety/ACOR00ESP_R_20213550000_01D_30S_MO.crx",
    "rinex-variety/AJAC3550.21D",
    "rinex-variety/GEOP092I.24o.gz",
    "rinex-variety/KMS300DNK_R_20221591000_01H_30S_MO.crx",
    "rinex-variety/rovn0010.21o",
    "rinex-variety/zegv0010.21d",
]


@pytest.mark.shared_data
@pytest.mark.parametrize("name", REAL)
def test_real_files_in_pieces_are_the_whole_file(shared_data, name):
    content = (shared_data / "real" / name).read_bytes()
    found = list(read_obs_pieces(split_content(content, range(10_007, len(content), 10_007)), piece_bytes=1 << 15))
    whole = parse_obs(gzip.decompress(content) if name.endswith(".gz") else content)
    assert_same(join_pieces(found), whole.observations)
