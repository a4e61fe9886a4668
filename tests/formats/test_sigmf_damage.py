"""SigMF: a cut or damaged recording loses what is gone and reports it, in files and in archives."""

import hashlib
import json
import tarfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.formats.sigmf_files import (
    NO_TMP_PER_EXAMPLE,
    draw_noise,
    draw_numbers,
    make_meta,
    read_one,
    read_planes,
    try_read,
    write,
)

from skyproof.errors import InputError
from skyproof.formats.sigmf import open_sigmf

# --- damage

CAPTURES = [
    {
        "core:sample_start": 0,
        "core:header_bytes": 3,
        "core:frequency": 1575.42e6,
        "core:datetime": "2022-01-01T00:00:00Z",
    },
    {"core:sample_start": 60, "core:header_bytes": 5, "core:frequency": 1575.42e6, "core:global_index": 70},
    {"core:sample_start": 90, "core:frequency": 1575.42e6},
]


@given(cut=st.integers(0, 3 + 5 + 100 * 8 - 1))
@settings(max_examples=80, deadline=None, suppress_health_check=NO_TMP_PER_EXAMPLE)
def test_data_cut_anywhere_lose_what_is_cut_and_say_so(tmp_path, cut):
    stored = draw_numbers("ci16_le", (100, 2, 2))
    octets = b"\x01" * 3 + stored[:60].tobytes() + b"\x02" * 5 + stored[60:].tobytes()
    meta = make_meta("ci16_le", captures=CAPTURES, num_channels=2)
    path = write(tmp_path, meta, octets[:cut])
    whole = sum(1 for n in range(100) if (n + 1) * 8 + (3 if n < 60 else 8) <= cut)
    opened, refusal = try_read(path)
    assert not refusal or whole < 2  # one sample never changes
    for channel, samples in enumerate(opened):
        np.testing.assert_array_equal(samples.read(0, 200), read_planes(stored[:whole, channel]))
        reported = any("cut" in remark for remark in samples.remarks)
        assert reported or cut == 3 + 5 + 8 * whole  # the last capture has no end of its own


@given(place=st.integers(0, 10**6), bit=st.integers(0, 7))
@settings(max_examples=100, deadline=None, suppress_health_check=NO_TMP_PER_EXAMPLE)
def test_metadata_with_a_flipped_bit_are_refused_or_reported(tmp_path, place, bit):
    stored = draw_noise(100)
    octets = b"\x01" * 3 + stored[:60].tobytes() + b"\x02" * 5 + stored[60:].tobytes()
    meta = make_meta(captures=CAPTURES, sha512=hashlib.sha512(octets).hexdigest(), num_channels=1)
    path = write(tmp_path, meta, octets)
    right = read_one(path)
    text = bytearray(path.read_bytes())
    text[place % len(text)] ^= 1 << bit
    path.write_bytes(text)
    opened, refusal = try_read(path)
    if refusal:
        assert str(tmp_path) in refusal
        assert "\n" not in refusal
        return
    reported = opened[0].remarks != right.remarks or len(opened) > 1
    differs = not np.array_equal(opened[0].read(0, 999), right.read(0, 999)) or any(
        getattr(opened[0], field) != getattr(right, field)
        for field in ("rate_hz", "centre_hz", "if_hz", "gaps", "start_gpst")
    )
    if differs and not reported:  # then a value was changed to another one that can stand there; no key went unread
        flipped = json.loads(text)
        assert [list(c) for c in flipped["captures"]] == [list(c) for c in meta["captures"]]
        assert set(flipped["global"]) == set(meta["global"])


# --- archives


def write_archive(path, members):
    with tarfile.open(path, "w") as tar:
        for member in members:
            tar.add(member, arcname=f"{path.stem}/{member.name}")
    return path


def test_an_archive_is_read_where_it_lies(tmp_path):
    paths = [write(tmp_path, make_meta(), draw_noise(3000, seed).tobytes(), f"rx{seed}") for seed in (1, 2)]
    packed = write_archive(tmp_path / "both.sigmf", [p for m in paths for p in (m.with_suffix(".sigmf-data"), m)])
    opened = open_sigmf(packed)
    assert [samples.name for samples in opened] == ["rx1", "rx2"]
    for seed, samples in enumerate(opened, 1):
        np.testing.assert_array_equal(samples.read(0, 9999), read_planes(draw_noise(3000, seed)))


def test_a_cut_archive_loses_what_is_cut_and_says_so(tmp_path):
    path = write(tmp_path, make_meta(), draw_noise(3000).tobytes())
    packed = write_archive(tmp_path / "rec.sigmf", [path, path.with_suffix(".sigmf-data")])
    octets = packed.read_bytes()
    lengths = set()
    for cut in range(100, octets.rindex(draw_noise(3000)[-9:].tobytes()), 500):
        packed.write_bytes(octets[:cut])
        opened, refusal = try_read(packed)
        assert opened or str(packed) in refusal
        for samples in opened:
            lengths.add(samples.n_samples)
            assert any("cut" in remark for remark in samples.remarks)
            np.testing.assert_array_equal(samples.read(0, 9999), read_planes(draw_noise(3000))[:, : samples.n_samples])
    assert len(lengths) > 5
    assert max(lengths) < 3000


def test_no_archive_is_reported(tmp_path):
    (tmp_path / "a.sigmf").write_bytes(b"no tar at all" * 100)
    with pytest.raises(InputError, match="not a SigMF"):
        open_sigmf(tmp_path / "a.sigmf")
    other = tmp_path / "b.txt"
    other.write_text("hello")
    with pytest.raises(InputError, match=r"b\.sigmf: .*no \.sigmf-meta"):
        open_sigmf(write_archive(tmp_path / "b.sigmf", [other]))
