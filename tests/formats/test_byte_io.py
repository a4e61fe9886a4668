"""Bytes of files that stay open: which are read, which are summed, and what becomes of a file meanwhile."""

import hashlib
import os
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyproof.errors import InputError
from skyproof.formats.byte_io import FileBytes
from skyproof.formats.layout import Chunk, PackedSamples, Packing

CONTENT = np.random.default_rng(1).bytes(1000)
OTHER = bytes(255 - octet for octet in CONTENT)


def hash_content(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "some.bin"
    path.write_bytes(CONTENT)
    return path


@pytest.fixture(scope="module")
def kept_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("kept") / "some.bin"
    path.write_bytes(CONTENT)
    return path


stretches = st.lists(st.tuples(st.integers(0, 1000), st.integers(0, 400)), max_size=8)


@given(stretches, st.integers(0, 50))
def test_any_stretch_is_read_and_the_sum_is_of_the_whole_file(kept_file, parts, start):
    octets = FileBytes(kept_file, start)
    octets.sum_as_read()
    for first, count in parts:
        assert octets[first : first + count].tobytes() == CONTENT[start:][first : first + count]
    assert octets.sha256() == hash_content(CONTENT)
    assert octets.changes() == ()


def test_the_sum_is_of_the_bytes_as_they_were_read(path):
    octets = FileBytes(path, start=100)  # behind a header
    octets.sum_as_read()
    octets[0:500], octets[400:900]
    with open(path, "r+b") as file:
        file.write(OTHER)
    assert octets.sha256() == hash_content(CONTENT)
    assert "written to" in octets.changes()[0]


def test_no_sum_is_given_if_the_bytes_read_are_unknown(path, monkeypatch):
    monkeypatch.setattr("skyproof.formats.byte_io._LONGEST_HEADER", 100)  # further on nothing is read for a sum alone
    octets = FileBytes(path)
    octets.sum_as_read()
    octets[200:300]
    path.write_bytes(OTHER)
    os.utime(path, ns=(1, 1))
    assert octets.sha256() is None


def test_a_deleted_or_replaced_file_is_read_to_its_end(path):
    octets = FileBytes(path)
    path.unlink()
    path.write_bytes(OTHER)
    assert octets[900:].tobytes() == CONTENT[900:]
    assert octets.sha256() == hash_content(CONTENT)
    assert "replaced" in octets.changes()[0]


def test_a_growing_file_is_read_as_far_as_it_was_opened(path):
    octets = FileBytes(path)
    with open(path, "ab") as file:
        file.write(OTHER)
    assert octets.size == 1000
    assert octets.sha256() == hash_content(CONTENT)
    assert re.search(r"\bgrown\b.*\b1000 bytes", octets.changes()[0])


def test_a_file_cut_while_read_is_reported_and_summed_so_far(path):
    octets = FileBytes(path)
    octets.sum_as_read()
    assert octets[:300].size == 300
    os.truncate(path, 300)
    with pytest.raises(InputError, match=r"some\.bin .*\b300 bytes.*\b1000\b"):
        octets[290:310]
    assert octets.sha256() == hash_content(CONTENT[:300])
    (change,) = octets.changes()
    assert re.findall(r"\d+", change) == ["1000", "300", "300"]


@given(
    packing=st.builds(
        Packing,
        kind=st.sampled_from(["real", "complex"]),
        encoding=st.just("offset-binary"),
        bits=st.sampled_from([1, 2, 4, 8, 16]),
        n_channels=st.integers(1, 3),
    ),
    start=st.integers(0, 60),
    count=st.integers(0, 60),
    at_byte=st.integers(0, 3),
    piece=st.integers(1, 16),
)
def test_samples_equal_the_files_bytes_in_pieces_of_any_length(kept_file, packing, start, count, at_byte, piece):
    chunks = [Chunk(at_byte, 41), Chunk(796, 17)]  # of 12 bytes at most
    whole = PackedSamples(np.frombuffer(CONTENT, np.uint8), packing, chunks)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("skyproof.formats.layout._PIECE_BYTES", piece)
        pieces = PackedSamples(FileBytes(kept_file), packing, chunks)
    assert np.array_equal(pieces.read(start, count), whole.read(0, 58)[:, start : start + count])
