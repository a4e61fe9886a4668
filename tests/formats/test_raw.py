"""Raw recordings: every packing reads back, every fault is reported, and the levels are looked at."""

import hashlib
import json
import re
import struct
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from skyproof.errors import InputError
from skyproof.formats.raw import (
    SampleLayout,
    check_levels,
    compute_sha256,
    open_raw,
    open_raw_channels,
    read_sidecar,
    write_sidecar_text,
)
from skyproof.records import Samples
from skyproof.remarks import Remark, RemarkKind

PACKINGS = [
    ("sign", 1),
    *(("sign-magnitude", bits) for bits in (2, 4, 8, 12, 16, 32)),
    *(("offset-binary", bits) for bits in (1, 2, 4, 8, 12, 16, 32)),
    *(("int", bits) for bits in (2, 4, 8, 12, 16, 32)),
    ("float", 32),
    ("float", 64),
]


# --- an independent, slow writer: text of "0" and "1", number by number


def list_values(encoding, bits):
    if encoding == "float":
        return st.floats(width=32, allow_nan=False, allow_infinity=False)
    top = 2**bits
    if encoding == "int":
        return st.integers(-(top // 2), top // 2 - 1)
    if encoding == "sign":
        return st.sampled_from([1, -1])
    return st.integers(0, top // 2 - 1).flatmap(lambda m: st.sampled_from([2 * m + 1, -2 * m - 1]))


def encode_bits(value, encoding, bits):
    if encoding == "float":
        octets = struct.pack(">f" if bits == 32 else ">d", value)
        return "".join(f"{octet:08b}" for octet in octets)
    if encoding == "int":
        return f"{value % 2**bits:0{bits}b}"
    if encoding == "sign":
        return "0" if value > 0 else "1"
    if encoding == "sign-magnitude":
        return ("0" if value > 0 else "1") + f"{(abs(value) - 1) // 2:0{bits - 1}b}"
    return f"{(value + 2**bits - 1) // 2:0{bits}b}"


def pack_values(values, layout):
    words = [encode_bits(value, layout.encoding, layout.bits) for value in values]
    if layout.bits == 12:
        words += ["0" * 12] * (len(words) % 2)
        first, order = (0, "big") if layout.bit_order == "msb-first" else (1, "little")
        threes = [(words[k + first], words[k + 1 - first]) for k in range(0, len(words), 2)]
        return b"".join(int("".join(three), 2).to_bytes(3, order) for three in threes)
    if layout.bits >= 8:
        octets = [[int(word[k : k + 8], 2) for k in range(0, layout.bits, 8)] for word in words]
        return bytes(o for word in octets for o in (word if layout.byte_order == "big" else word[::-1]))
    out = bytearray()
    for k in range(0, len(words), 8 // layout.bits):
        fields = words[k : k + 8 // layout.bits]
        out.append(int("".join(fields if layout.bit_order == "msb-first" else fields[::-1]), 2))
    return bytes(out)


def write(folder, layout, octets, name="rec"):
    """Write a recording and its sidecar."""
    path = Path(folder) / f"{name}.bin"
    path.write_bytes(b"\xa5" * layout.header_bytes + octets)
    path.with_suffix(".toml").write_text(write_sidecar_text(layout), encoding="utf-8")
    return path


def make_layout(encoding="int", bits=8, kind="complex", **more):
    return SampleLayout(rate_hz=2.6e6, kind=kind, encoding=encoding, bits=bits, **({"if_hz": 0.0} | more))


def draw_noise(n_samples, *, seed=1, sigma=20.0, numbers=2):
    return np.clip(np.random.default_rng(seed).normal(0.0, sigma, numbers * n_samples).round(), -127, 127)


# --- what is read


@pytest.mark.parametrize(("encoding", "bits"), [("sign", 1), ("sign-magnitude", 2), ("int", 8), ("float", 32)])
@pytest.mark.parametrize("n_channels", [2, 3, 4])
def test_channels_of_one_file_are_what_files_of_their_own_are(tmp_path, encoding, bits, n_channels):
    rng = np.random.default_rng(n_channels)
    of_each = [[draw(encoding, bits, rng) for _ in range(2 * 4000)] for _ in range(n_channels)]
    layout = make_layout(encoding, bits, start_gpst="2022-01-01T21:45:58")
    woven = np.array(of_each).reshape(n_channels, -1, 2).swapaxes(0, 1).ravel().tolist()
    together = layout.model_copy(update={"channels": n_channels})
    opened = open_raw_channels(write(tmp_path, together, pack_values(woven, together), "all"))
    assert [item.name for item in opened] == [f"all-{k + 1}" for k in range(n_channels)]
    assert [item.antenna for item in opened] == [f"1-{k + 1}" for k in range(n_channels)]
    for item, values in zip(opened, of_each, strict=True):
        alone = open_raw(write(tmp_path, layout, pack_values(values, layout), "alone"))
        assert (item.n_samples, item.rate_hz, item.start_gpst) == (4000, 2.6e6, alone.start_gpst)
        assert np.array_equal(item.read(0, 4000), alone.read(0, 4000))
        assert np.array_equal(item.read(1234, 567), alone.read(1234, 567))


def draw(encoding, bits, rng):
    if encoding == "float":
        return float(np.float32(rng.normal()))
    if encoding == "int":
        return int(rng.integers(-100, 100))
    magnitude = 1 if encoding == "sign" else 2 * int(rng.integers(0, 2 ** (bits - 1))) + 1
    return magnitude * int(rng.choice([-1, 1]))


def test_a_channel_that_never_changes_is_left_out_and_reported(tmp_path):
    values = np.stack([draw_noise(5000), np.full(10_000, 3.0)]).reshape(2, -1, 2).swapaxes(0, 1)
    layout = make_layout(channels=2)
    (alive,) = open_raw_channels(write(tmp_path, layout, values.astype(np.int8).tobytes()))
    assert alive.name == "rec-1"
    assert any(re.search(r"\brec-2\b.* 3 in ", remark) for remark in alive.remarks)
    first, second = open_raw_channels(tmp_path / "rec.bin", dead=True)
    assert (first.name, first.dead, second.name) == ("rec-1", "", "rec-2")
    assert re.search(r" 3 in ", second.dead)
    assert [second.read(start, 3000).shape for start in (0, 4000, 5000)] == [(2, 3000), (2, 1000), (2, 0)]
    assert not second.read(0, 5000).any()


@pytest.mark.parametrize(("encoding", "bits"), PACKINGS, ids=lambda value: str(value))
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_every_packing_reads_back_from_any_place(tmp_path, encoding, bits, data):
    kind = data.draw(st.sampled_from(["real", "complex"]))
    flags = st.booleans() if kind == "complex" else st.just(False)
    layout = make_layout(
        encoding,
        bits,
        kind,
        bit_order=data.draw(st.sampled_from(["msb-first", "lsb-first"])),
        byte_order=data.draw(st.sampled_from(["little", "big"])),
        header_bytes=data.draw(st.integers(0, 5)),
        swap_iq=data.draw(flags),
        conjugate=data.draw(flags),
    )
    n_octets = data.draw(st.integers(1, 6)) * (3 if bits == 12 else max(1, bits * layout.numbers // 8))
    value = list_values(encoding, bits)
    values = data.draw(st.lists(value, min_size=n_octets * 8 // bits, max_size=n_octets * 8 // bits))
    first, second = values[:: layout.numbers], values[1::2]
    expected = np.zeros((2, len(first)))
    expected[0] = second if layout.swap_iq else first
    if kind == "complex":
        expected[1] = np.multiply(-1 if layout.conjugate else 1, first if layout.swap_iq else second)
    path = write(tmp_path, layout, pack_values(values, layout))
    if (expected == expected[:, :1]).all():  # as a few numbers may well be
        with pytest.raises(InputError, match="nothing"):
            open_raw(path)
        return
    samples = open_raw(path)
    assert samples.n_samples == len(first)
    start = data.draw(st.integers(0, len(first)))
    count = data.draw(st.integers(0, len(first) + 2))
    stretch = samples.read(start, count)
    assert stretch.dtype == np.float32
    assert stretch.flags.c_contiguous
    np.testing.assert_array_equal(stretch, expected[:, start : start + count].astype(np.float32))


def test_the_bits_of_a_byte_mean_what_the_sidecar_says(tmp_path):
    sign = write(tmp_path, make_layout("sign", 1), bytes([0b01_00_11_10] * 2))
    i, q = open_raw(sign).read(0, 4)
    assert (i.tolist(), q.tolist()) == ([1, 1, -1, -1], [-1, 1, -1, 1])
    magnitude = write(tmp_path, make_layout("sign-magnitude", 2, "real"), bytes([0b00_01_10_11]))
    assert open_raw(magnitude).read(0, 4)[0].tolist() == [1, 3, -1, -3]
    lsb_first = write(tmp_path, make_layout("sign-magnitude", 2, "real", bit_order="lsb-first"), bytes([0b00_01_10_11]))
    assert open_raw(lsb_first).read(0, 4)[0].tolist() == [-3, -1, 3, 1]
    offset = write(tmp_path, make_layout("offset-binary", 8, "real"), bytes([0, 127, 128, 255]))
    assert open_raw(offset).read(0, 4)[0].tolist() == [-255, -1, 1, 255]
    nibbles = write(tmp_path, make_layout("int", 4, "complex"), bytes([0x7F, 0x80]))
    assert open_raw(nibbles).read(0, 2).tolist() == [[7, -8], [-1, 0]]


def test_blocks_joined_are_the_whole(tmp_path):
    path = write(tmp_path, make_layout("sign", 1), np.random.default_rng(3).bytes(5000))
    samples = open_raw(path)
    blocks = [samples.read(start, 777) for start in range(0, samples.n_samples, 777)]
    np.testing.assert_array_equal(np.concatenate(blocks, axis=1), samples.read(0, samples.n_samples))
    assert samples.read(samples.n_samples, 10).shape == (2, 0)
    assert samples.read(samples.n_samples + 5, 10).shape == (2, 0)
    with pytest.raises(ValueError, match="negative"):
        samples.read(-1, 10)


def test_an_inverted_spectrum_is_turned_back(tmp_path):
    n = np.arange(4096)
    tone = 50.0 * np.exp(-2j * np.pi * 0.1 * n)  # below the centre in the file, so above it in truth
    octets = np.stack([tone.real, tone.imag], axis=-1).round().astype(np.int8).tobytes()
    i, q = open_raw(write(tmp_path, make_layout(conjugate=True), octets)).read(0, n.size)
    assert np.fft.fftfreq(n.size)[np.abs(np.fft.fft(i + 1j * q)).argmax()] == pytest.approx(0.1, abs=1e-3)


def test_an_intermediate_frequency_is_folded_as_sampling_does(tmp_path):
    layout = SampleLayout(rate_hz=5.714e6, kind="real", encoding="int", bits=8, if_hz=4.1304e6)
    samples = open_raw(write(tmp_path, layout, draw_noise(1000, numbers=1).astype(np.int8).tobytes()))
    assert samples.if_hz == pytest.approx(4.1304e6 - 5.714e6)


def test_the_record_states_what_the_sidecar_stated(tmp_path):
    path = write(
        tmp_path,
        make_layout(centre_hz=1575e6, if_hz=0.42e6, start_gpst="2022-01-01T21:45:58.25", antenna="mast"),
        draw_noise(2600).astype(np.int8).tobytes(),
        name="rx7",
    )
    samples = open_raw(path)
    assert (samples.name, samples.path, samples.format, samples.antenna) == ("rx7", str(path), "raw", "mast")
    assert (samples.rate_hz, samples.centre_hz, samples.if_hz) == (2.6e6, 1575e6, 0.42e6)
    assert samples.start_gpst == np.datetime64("2022-01-01T21:45:58.25")
    assert samples.duration_s == pytest.approx(0.001)
    assert samples.remarks == ()


def test_one_bit_samples_cost_nanoseconds(tmp_path):
    samples = open_raw(write(tmp_path, make_layout("sign", 1), np.random.default_rng(3).bytes(1_000_000)))

    def measure_ns():
        start = time.perf_counter()
        samples.read(1, 2_000_000)
        return (time.perf_counter() - start) / 2e-3

    assert min(measure_ns() for _ in range(5)) < 10.0  # measured 0.4 to 1 at rest; a loop per sample would be 100


# --- the sidecar


@given(
    st.fixed_dictionaries(
        {
            "rate_hz": st.floats(1e5, 1e11),
            "kind": st.sampled_from(["real", "complex"]),
            "packing": st.sampled_from(PACKINGS),
            "if_hz": st.floats(-1e9, 1e9),
        },
        optional={
            "centre_hz": st.floats(1e8, 1e11),
            "bit_order": st.sampled_from(["msb-first", "lsb-first"]),
            "byte_order": st.sampled_from(["little", "big"]),
            "header_bytes": st.integers(0, 10**9),
            "antenna": st.text(min_size=1).filter(lambda text: text.encode("utf-8", "ignore").decode() == text),
            "start_gpst": st.integers(0, 2**61).map(lambda ns: str(np.datetime64("1980-01-06", "ns") + ns)),
        },
    )
)
@settings(deadline=None)
def test_a_sidecar_written_reads_back(tmp_path_factory, fields):
    encoding, bits = fields.pop("packing")
    layout = SampleLayout(encoding=encoding, bits=bits, **fields)
    path = tmp_path_factory.getbasetemp() / "sidecar.toml"
    path.write_text(write_sidecar_text(layout), encoding="utf-8", newline="")
    assert read_sidecar(path) == layout


def test_a_sidecar_may_hold_a_bare_date_and_time(tmp_path):
    path = tmp_path / "a.toml"
    path.write_text(
        '[samples]\nrate_hz = 2600000\nkind = "complex"\nencoding = "sign"\nbits = 1\n'
        "start_gpst = 2022-01-01T21:45:58.5\n"
    )
    assert read_sidecar(path).start_gpst == np.datetime64("2022-01-01T21:45:58.5")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"rate": 2.6e6}, ["samples.rate ", "rate_hz?"]),
        ({"colour": 1}, ["samples.colour ", "rate_hz, kind"]),
        ({"kind": "cmplx"}, ['samples.kind = "cmplx"', '"real" or "complex"']),
        ({"bits": 3}, ["samples.bits = 3", "1, 2, 4"]),
        ({"conjugate": 1}, ["samples.conjugate = 1", "expected true"]),
        ({"encoding": "float"}, [r"samples.bits = 8 does", 'encoding = "float"', "32, 64"]),
        ({"rate_hz": 2.6}, ["samples.rate_hz = 2.6", "in hertz"]),
        ({"rate_hz": "2.6e6"}, ['samples.rate_hz = "2.6e6"', "in hertz"]),
        ({"rate_hz": float("nan")}, ["samples.rate_hz = nan"]),
        ({"centre_hz": 1575.42}, ["samples.centre_hz = 1575.42", "1575420000.0 is L1"]),
        ({"kind": "real"}, ["samples.if_hz is missing"]),
        ({"kind": "real", "if_hz": 1e6, "conjugate": True}, ["negative if_hz"]),
        ({"header_bytes": -1}, ["samples.header_bytes = -1", "zero"]),
        ({"start_gpst": "yesterday"}, ['samples.start_gpst = "yesterday"', "2022-01-01T21:45:58"]),
        ({"start_gpst": "1970-01-01T00:00:00"}, ["samples.start_gpst", "2022-01-01T21:45:58"]),
        ({"start_gpst": "2022-01-01T21:45:58Z"}, ["samples.start_gpst", "zone"]),
        ({"kind": "cmplx", "bits": 3, "rate": 1}, ["samples.kind", "samples.bits", "samples.rate "]),
    ],
    ids=lambda value: json.dumps(value)[:50],
)
def test_a_wrong_sidecar_is_reported_with_file_key_and_remedy(tmp_path, change, words):
    fields = {"rate_hz": 2.6e6, "kind": "complex", "encoding": "int", "bits": 8} | change
    path = tmp_path / "rec.toml"
    path.write_text(
        "[samples]\n" + "".join(f"{key} = {json.dumps(value).replace('NaN', 'nan')}\n" for key, value in fields.items())
    )
    with pytest.raises(InputError) as raised:
        read_sidecar(path)
    assert str(path) in str(raised.value)
    assert "\n" not in str(raised.value)
    for word in words:
        assert word in str(raised.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[samples]\nrate_hz = = 3\n", "line 2"),
        ("rate_hz = 2.6e6\n", "rate_hz stands outside"),
        ("", "samples "),
        ("[sample]\nbits = 1\n", "sample "),
        ("[samples]\nbits = 1\n", "samples.rate_hz is missing"),
        ("samples = 3\n", "samples = 3"),
    ],
    ids=["syntax", "no table", "empty", "misspelt table", "key missing", "no table but a number"],
)
def test_a_sidecar_of_another_form_is_reported(tmp_path, text, words):
    path = tmp_path / "rec.toml"
    path.write_text(text)
    with pytest.raises(InputError) as raised:
        read_sidecar(path)
    assert str(path) in str(raised.value)
    assert words in str(raised.value)


def test_a_sidecar_that_is_no_text_is_reported(tmp_path):
    path = tmp_path / "rec.toml"
    path.write_bytes(b"# \xff\xfe")
    with pytest.raises(InputError, match="not UTF-8"):
        read_sidecar(path)


def test_a_missing_sidecar_is_reported_with_a_working_example(tmp_path):
    path = tmp_path / "rec.bin"
    path.write_bytes(draw_noise(1000).astype(np.int8).tobytes())
    with pytest.raises(InputError) as raised:
        open_raw(path)
    message = str(raised.value)
    assert str(path.with_suffix(".toml")) in message
    path.with_suffix(".toml").write_text(message[message.index("samples = {") :])
    assert open_raw(path).n_samples == 1000


def test_a_sidecar_may_stand_elsewhere(tmp_path):
    path = write(tmp_path, make_layout(), draw_noise(1000).astype(np.int8).tobytes())
    moved = path.with_suffix(".toml").rename(tmp_path / "other.toml")
    assert open_raw(path, moved).n_samples == 1000


# --- the file


def test_a_missing_recording_is_reported(tmp_path):
    with pytest.raises(InputError, match=r"gone\.bin"):
        open_raw(tmp_path / "gone.bin")


def test_a_folder_is_no_recording(tmp_path):
    with pytest.raises(InputError, match="regular"):
        open_raw(tmp_path)


def test_an_empty_recording_is_reported(tmp_path):
    with pytest.raises(InputError, match=r"rec\.bin.*empty"):
        open_raw(write(tmp_path, make_layout(), b""))


@pytest.mark.parametrize(("bits", "extra"), [(8, 1), (16, 1), (16, 3), (32, 7)])
def test_a_cut_recording_loses_a_part_of_a_sample_and_reports_it(tmp_path, bits, extra):
    octets = draw_noise(1000).astype(f"<i{bits // 8}").tobytes()
    samples = open_raw(write(tmp_path, make_layout("int", bits), octets + b"\x01" * extra))
    assert samples.n_samples == 1000
    assert samples.read(0, 2000).shape == (2, 1000)
    assert len(samples.remarks) == 1
    assert f" {extra} bytes" in samples.remarks[0]


@pytest.mark.parametrize(("octets", "header"), [(b"\x01\x02\x03", 0), (b"\x01" * 8, 8), (b"\x01" * 8, 100)])
def test_less_than_one_sample_is_reported(tmp_path, octets, header):
    path = write(tmp_path, make_layout("int", 16), octets)
    path.with_suffix(".toml").write_text(write_sidecar_text(make_layout("int", 16, header_bytes=header)))
    with pytest.raises(InputError, match=r"\b32 bits"):
        open_raw(path)


def test_the_digest_is_the_files_and_progress_is_reported(tmp_path):
    path = tmp_path / "a.bin"
    octets = np.random.default_rng(1).bytes(5_000_000)
    path.write_bytes(octets)
    reported = []
    assert compute_sha256(path, lambda done, size: reported.append((done, size))) == hashlib.sha256(octets).hexdigest()
    assert reported == [(1 << 22, 5_000_000), (5_000_000, 5_000_000)]
    with pytest.raises(InputError, match=r"\bgone\b.*exist"):
        compute_sha256(tmp_path / "gone")


# --- damage


@given(cut=st.integers(0, 4 + 400 * 4), bits=st.sampled_from([4, 8, 16]))
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_recording_cut_anywhere_loses_what_is_cut_and_no_more(tmp_path, cut, bits):
    octets = np.random.default_rng(1).bytes(400 * 4)
    layout = make_layout("int", bits, header_bytes=4)
    path = write(tmp_path, layout, octets)
    whole = open_raw(path)
    expected = whole.read(0, whole.n_samples)
    path.write_bytes(path.read_bytes()[:cut])
    kept = max(0, cut - 4) * 8 // (2 * bits)
    try:
        samples = open_raw(path)
    except InputError:
        kept_values = expected[:, :kept]
        constant = bool((kept_values == kept_values[:, :1]).all()) if kept else True
        samples = None
    if samples is None:
        assert constant
    else:
        assert samples.n_samples == kept
        np.testing.assert_array_equal(samples.read(0, 9999), expected[:, :kept])
        assert any(Remark.kind_of(r) is RemarkKind.CUT for r in samples.remarks) == ((cut - 4) % max(1, bits // 4) != 0)


@given(place=st.integers(0, 10**6), bit=st.integers(0, 7))
@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_flipped_bit_in_a_sidecar_is_refused_or_read(tmp_path, place, bit):
    layout = make_layout(
        centre_hz=1575e6, header_bytes=2, start_gpst="2022-01-01T21:45:58", swap_iq=True, antenna="mast"
    )
    path = write(tmp_path, layout, draw_noise(400).astype(np.int8).tobytes())
    sidecar = path.with_suffix(".toml")
    text = bytearray(sidecar.read_bytes())
    text[place % len(text)] ^= 1 << bit
    sidecar.write_bytes(text)
    try:
        samples = open_raw(path)
    except InputError as error:
        refusal = str(error)
    else:
        refusal = ""
        assert samples.read(0, 9999).shape == (2, samples.n_samples)
        read = read_sidecar(sidecar)
        commented = text.count(b"#") > 1  # a key may become a remark; then its default holds, as in a text without it
        assert commented or read.model_fields_set == layout.model_fields_set
    assert "\n" not in refusal


# --- the levels


@pytest.mark.parametrize(("octet", "words"), [(0, "zero in "), (5, r"samples are 5\b")])
def test_a_recording_that_never_changes_is_refused(tmp_path, octet, words):
    with pytest.raises(InputError, match=words) as raised:
        open_raw(write(tmp_path, make_layout(), bytes([octet]) * 2_000_000))
    assert "rec.bin" in str(raised.value)


def test_one_bit_zeros_are_refused(tmp_path):
    with pytest.raises(InputError, match="nothing"):
        open_raw(write(tmp_path, make_layout("sign", 1), b"\x00" * 100_000))


def test_good_levels_call_for_no_remark(tmp_path):
    rng = np.random.default_rng(5)
    assert open_raw(write(tmp_path, make_layout("sign", 1), rng.bytes(300_000))).remarks == ()
    assert open_raw(write(tmp_path, make_layout(), draw_noise(300_000).astype(np.int8).tobytes())).remarks == ()
    best_two_bits = np.clip(np.floor(rng.normal(size=600_000)), -2, 1) * 2 + 1  # thresholds -1, 0, 1 sigma
    layout = make_layout()
    assert open_raw(write(tmp_path, layout, best_two_bits.astype(np.int8).tobytes())).remarks == ()


@pytest.mark.parametrize("sigma", [100.0, 1000.0])
def test_saturation_is_reported(tmp_path, sigma):
    (remark,) = open_raw(
        write(tmp_path, make_layout(), draw_noise(100_000, sigma=sigma).astype(np.int8).tobytes())
    ).remarks
    clipped = 20 if sigma == 100.0 else 90  # percent beyond 126.5: 2 (1 - Phi(1.265)) and 2 (1 - Phi(0.1265))
    assert "saturated" in remark
    assert abs(int(remark.split("%")[0].split()[-1]) - clipped) <= 1


def test_saturated_two_bit_samples_are_reported(tmp_path):
    strong = np.clip(np.floor(np.random.default_rng(5).normal(size=600_000, scale=5.0)), -2, 1)
    (remark,) = open_raw(write(tmp_path, make_layout(), (2 * strong + 1).astype(np.int8).tobytes())).remarks
    assert "saturated" in remark


def test_offset_and_imbalance_are_reported(tmp_path):
    octets = draw_noise(200_000).reshape(-1, 2)
    octets[:, 0] += 4.0  # a fifth of sigma
    octets[:, 1] *= 0.9  # 0.92 dB
    remarks = open_raw(write(tmp_path, make_layout(), octets.round().astype(np.int8).tobytes())).remarks
    assert [remark for remark in remarks if "DC offset +0.20 in I" in remark]
    assert [remark for remark in remarks if "I/Q imbalance +0.9 dB" in remark]


def test_a_dead_branch_is_reported(tmp_path):
    octets = draw_noise(100_000).reshape(-1, 2)
    octets[:, 1] = 0.0
    (remark,) = open_raw(write(tmp_path, make_layout(), octets.astype(np.int8).tobytes())).remarks
    assert remark.startswith("Q ")


def test_real_samples_have_no_dead_branch(tmp_path):
    octets = draw_noise(100_000, numbers=1).astype(np.int8).tobytes()
    assert open_raw(write(tmp_path, make_layout(kind="real", if_hz=1e6), octets)).remarks == ()


def test_a_gap_is_reported_with_its_time(tmp_path):
    octets = draw_noise(2_600_000).astype(np.int8)
    octets[2_600_000:] = 0
    (remark,) = open_raw(write(tmp_path, make_layout(), octets.tobytes())).remarks
    assert re.search(r"\b8 of 16\b", remark)
    assert 0.5 <= float(remark.split("first at ")[1].split()[0]) < 0.6


def test_floats_that_are_no_numbers_are_reported_and_zero(tmp_path):
    values = draw_noise(100_000).astype(np.float32)
    values[20:2020:2] = np.nan
    values[5] = np.inf
    samples = open_raw(write(tmp_path, make_layout("float", 32), values.tobytes()))
    assert "1.00%" in samples.remarks[0]
    assert np.isfinite(samples.read(0, 100_000)).all()
    assert samples.read(10, 1)[0, 0] == 0.0
    assert samples.read(10, 1)[1, 0] == values[21]


def test_nothing_but_floats_that_are_no_numbers_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"100\.00%"):
        open_raw(write(tmp_path, make_layout("float", 32), b"\xff" * 8000))


def test_the_check_of_levels_reads_a_bounded_part():
    reads = []

    def read(start, count):
        reads.append((start, count))
        return np.random.default_rng(start).normal(size=(2, count)).astype(np.float32)

    samples = Samples(name="day", rate_hz=25e6, n_samples=10**12, read=read)
    assert check_levels(samples) == ()
    assert sum(count for _, count in reads) <= 2**19
    assert max(start + count for start, count in reads) == 10**12


@pytest.mark.shared_data
def test_the_rendered_pair_reads_as_its_notes_say(shared_data):
    path = shared_data / "rf" / "meaconing-pair" / "rx1.bin"
    samples = open_raw(path)
    assert samples.duration_s == 60.0
    assert samples.remarks == ()
    first = path.open("rb").read(1)[0]
    expected = [1 - 2 * (first >> shift & 1) for shift in range(7, -1, -1)]
    assert samples.read(0, 4).T.ravel().tolist() == expected


@pytest.mark.shared_data
def test_a_recorded_file_has_two_bit_levels(shared_data, tmp_path):
    layout = SampleLayout(rate_hz=12e6, kind="real", encoding="int", bits=8, centre_hz=1575.42e6, if_hz=3e6)
    sidecar = tmp_path / "l1.toml"
    sidecar.write_text(write_sidecar_text(layout))
    samples = open_raw(shared_data / "real" / "iq-pocketsdr" / "L1_20211125_004000_12MHz_I.bin", sidecar)
    assert samples.n_samples == 1_200_000
    assert np.unique(samples.read(0, 100_000)[0]).tolist() == [-3, -1, 1, 3]
    assert samples.remarks == ()
