"""Any recording: the kind of file decides, and memory does not grow with its length."""

import json
import resource
import subprocess
import sys

import numpy as np
import pytest

from skyproof.errors import InputError
from skyproof.formats.layout import Chunk, PackedSamples, Packing, _split
from skyproof.formats.raw import SampleLayout, write_sidecar_text
from skyproof.formats.recording import open_recording
from skyproof.formats.sigmf import meta_from_layout

LAYOUT = SampleLayout(rate_hz=4e6, kind="complex", encoding="int", bits=8, centre_hz=1575.42e6)
GIB = 1 << 30


def draw_noise(n_samples):
    return np.random.default_rng(1).normal(0.0, 20.0, (n_samples, 2)).round().clip(-127, 127).astype(np.int8)


def write(folder, name="rec.bin", *, sidecar=False, meta=False):
    path = folder / name
    path.write_bytes(draw_noise(5000).tobytes())
    if sidecar:
        path.with_suffix(".toml").write_text(write_sidecar_text(LAYOUT))
    if meta:
        path.with_suffix(".sigmf-meta").write_text(json.dumps(meta_from_layout(LAYOUT)))
    return path


def test_a_sidecar_makes_it_raw(tmp_path):
    (samples,) = open_recording(write(tmp_path, sidecar=True, meta=True))
    assert samples.format == "raw"
    moved = (tmp_path / "rec.toml").rename(tmp_path / "other.toml")
    (samples,) = open_recording(tmp_path / "rec.bin", moved)
    assert samples.format == "raw"


@pytest.mark.parametrize("asked", ["rec.sigmf-meta", "rec.sigmf-data"])
def test_either_file_of_sigmf_opens_the_same(tmp_path, asked):
    write(tmp_path, "rec.sigmf-data", meta=True)
    (samples,) = open_recording(tmp_path / asked)
    assert (samples.format, samples.path) == ("SigMF", str(tmp_path / "rec.sigmf-data"))
    np.testing.assert_array_equal(samples.read(0, 9999), draw_noise(5000).T)


def test_metadata_beside_a_raw_file_without_sidecar_are_used(tmp_path):
    (samples,) = open_recording(write(tmp_path, meta=True))
    assert (samples.format, samples.path) == ("SigMF", str(tmp_path / "rec.bin"))


def test_a_raw_file_that_nothing_describes_is_reported_as_ever(tmp_path):
    with pytest.raises(InputError, match=r"rec\.toml"):
        open_recording(write(tmp_path))
    with pytest.raises(InputError, match=r"gone\.bin.*exist"):
        open_recording(tmp_path / "gone.bin")


@pytest.mark.parametrize(
    ("name", "words"),
    [("a.sigmf.gz", "unpack"), ("a.sigmf-collection", r"collection .*\.sigmf-meta")],
)
def test_containers_that_are_not_read_are_reported(tmp_path, name, words):
    with pytest.raises(InputError, match=words):
        open_recording(tmp_path / name)


def test_sigmf_takes_no_sidecar(tmp_path):
    write(tmp_path, "rec.sigmf-data", meta=True)
    with pytest.raises(InputError, match=r"\bremove\b"):
        open_recording(tmp_path / "rec.sigmf-meta", tmp_path / "rec.toml")


# --- how it is read


@pytest.mark.parametrize("kernel", [_split, _split.py_func], ids=["compiled", "python"])
@pytest.mark.parametrize("dtype", ["i1", "<i2", "<i4", "u1", "<u2", "<f4", "<f8"])
def test_the_kernel_equals_a_strided_copy(kernel, dtype):
    stored = np.arange(200).astype(dtype)
    planes = np.empty((2, 100), np.float32)
    kernel(stored, planes[0], planes[1])
    np.testing.assert_array_equal(planes, stored.reshape(-1, 2).T.astype(np.float32))


def test_chunks_are_read_as_one_at_any_cut():
    octets = np.arange(64, dtype=np.uint8)
    packed = PackedSamples(
        octets,
        Packing(kind="complex", encoding="int", bits=8),
        [Chunk(3, 5), Chunk(20, 0), Chunk(21, 1), Chunk(40, 12)],
    )
    expected = np.concatenate([octets[3:13], octets[21:23], octets[40:64]]).reshape(-1, 2).T
    assert packed.n_samples == 18
    for start in range(19):
        for count in range(20):
            np.testing.assert_array_equal(packed.read(start, count), expected[:, start : start + count])


MEASURE = """
import resource, sys
import numpy as np
from skyproof.formats.recording import open_recording
(small,) = open_recording(sys.argv[1])
small.read(0, 1000)
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
(samples,) = open_recording(sys.argv[2])
total = 0
for start in np.linspace(0, samples.n_samples - 4_000_000, 6).astype(int).tolist():
    total += samples.read(start, 4_000_000).shape[1]
print(samples.n_samples, total, (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // 1024)
"""


@pytest.mark.parametrize("name", ["long.bin", "long.sigmf-data"])
def test_more_than_30_gb_take_no_more_memory_than_their_pieces(tmp_path, name):
    small, long = write(tmp_path, sidecar=True), write(tmp_path, name, sidecar=name.endswith("bin"), meta=True)
    with open(long, "r+b") as file:
        file.truncate(32 * GIB)  # sparse: the rest is zeros that stand nowhere
    limit = resource.getrlimit(resource.RLIMIT_DATA)

    def no_more_than_a_gib():  # of memory of its own; pages of the map are the file's
        resource.setrlimit(resource.RLIMIT_DATA, (GIB, limit[1]))

    command = [sys.executable, "-c", MEASURE, str(small), str(long)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, preexec_fn=no_more_than_a_gib)
    n_samples, total, grown_mib = map(int, done.stdout.split())
    assert n_samples == 16 * GIB
    assert total == 24_000_000
    # 48 MB of the file were touched, and the system may keep their pages; a block of samples is 32 MB
    assert grown_mib < 250


def test_a_sidecar_is_no_recording(tmp_path):
    path = tmp_path / "rx1.toml"
    path.write_text('[samples]\nrate_hz = 4e6\nkind = "complex"\nencoding = "int"\nbits = 8\n')
    with pytest.raises(InputError, match=r"rx1\.toml"):
        open_recording(path)
