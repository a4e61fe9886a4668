"""Recordings in NumPy files: whatever type, order and shape, every channel reads back."""

import numpy as np
import pytest

from skyproof.errors import InputError
from skyproof.formats.recording import open_recording

RATE = "[samples]\nrate_hz = 4e6\nif_hz = 1e6\n"


def store(folder, array, sidecar=RATE):
    path = folder / "array.npy"
    np.save(path, array)
    path.with_suffix(".toml").write_text(sidecar)
    return path


def draw_numbers(dtype, channels, length):
    rng = np.random.default_rng(3)
    values = rng.integers(-100, 100, (channels, length)) if np.dtype(dtype).kind != "u" else None
    if values is None:
        return rng.integers(0, 200, (channels, length)).astype(dtype)
    if np.dtype(dtype).kind == "c":
        values = values + 1j * rng.integers(-100, 100, (channels, length))
    return values.astype(dtype)


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("time_first", [False, True])
@pytest.mark.parametrize("dtype", ["i1", "u1", "<i2", ">i2", "<f4", ">f8", "<c8", "<c16"])
def test_every_channel_reads_back(tmp_path, dtype, time_first, order):
    array = draw_numbers(dtype, 5, 1000)
    path = store(tmp_path, np.asarray(array.T if time_first else array, order=order))
    channels = open_recording(path)
    assert len(channels) == 5
    for channel, values in zip(channels, array, strict=True):
        expected = values if np.dtype(dtype).kind != "u" else 2.0 * values.astype(float) - 255.0
        planes = channel.read(13, 700)
        np.testing.assert_array_equal(planes[0], expected.real[13:713])
        np.testing.assert_array_equal(planes[1], expected.imag[13:713])
        assert (channel.rate_hz, channel.if_hz, channel.n_samples) == (4e6, 1e6, 1000)


def test_one_axis_is_one_channel(tmp_path):
    array = draw_numbers("i1", 1, 1000)[0]
    (channel,) = open_recording(store(tmp_path, array))
    np.testing.assert_array_equal(channel.read(0, 1000)[0], array)


def test_packed_signs_in_rows_of_bytes(tmp_path):
    bits = np.random.default_rng(4).integers(0, 2, (3, 800), dtype=np.uint8)
    path = store(tmp_path, np.packbits(bits, axis=1), RATE + 'kind = "real"\nencoding = "sign"\nbits = 1\n')
    channels = open_recording(path)
    assert [channel.n_samples for channel in channels] == [800] * 3
    for channel, signs in zip(channels, bits, strict=True):
        np.testing.assert_array_equal(channel.read(5, 500)[0], 1.0 - 2.0 * signs[5:505])


@pytest.mark.parametrize(
    ("array", "sidecar", "words"),
    [
        (np.zeros((2, 3, 50), np.int8), RATE, r"\(2, 3, 50\).*\(samples,\), \(channels, samples\)"),
        (np.arange(50), RATE, r"\bint64\b.*\b8 to 32 bits"),
        (np.zeros(50, np.float16), RATE, r"\bfloat16\b"),
        (np.zeros(50, bool), RATE, r"\bbool\b"),
        (np.zeros((100, 200), np.int8), RATE, r"\(100, 200\).*\b64 channels"),
        (np.ones((50, 2), np.int16), RATE + "bits = 8\n", r"\b8 bits.*array\.npy.*\bint16\b"),
        (np.ones((50, 2), np.int8), RATE + "channels = 2\n", r"channels.*header_bytes.*array\.npy"),
        (np.ones(50, np.int8), "[samples]\nif_hz = 1e6\n", "samples.rate_hz is missing"),
        (np.array([None, 1]), RATE, r"\bobject\b"),
    ],
)
def test_what_cannot_be_read_is_said(tmp_path, array, sidecar, words):
    with pytest.raises(InputError, match=words):
        open_recording(store(tmp_path, array, sidecar))


def test_a_cut_or_foreign_file_is_said(tmp_path):
    path = store(tmp_path, draw_numbers("i1", 2, 1000))
    path.write_bytes(path.read_bytes()[:-10])
    with pytest.raises(InputError, match=r"\b2128\b"):
        open_recording(path)
    path.write_bytes(b"no numbers at all")
    with pytest.raises(InputError, match="NumPy"):
        open_recording(path)
    path.with_suffix(".toml").unlink()
    np.save(path, draw_numbers("i1", 2, 1000))
    with pytest.raises(InputError, match=r"\brate\b.*no sidecar"):
        open_recording(path)
