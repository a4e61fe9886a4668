"""SigMF: every data type, channel and capture reads back, every fault is reported, and an independent writer agrees."""

import hashlib
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sigmf import SigMFFile, sigmffile, validate
from tests.formats.sigmf_files import (
    DATATYPES,
    NO_TMP_PER_EXAMPLE,
    RATE_HZ,
    draw_noise,
    draw_numbers,
    make_meta,
    read_one,
    read_planes,
    write,
)

from skyproof.errors import InputError
from skyproof.formats.layout import FITTING_BITS
from skyproof.formats.raw import SampleLayout, open_raw, write_sidecar_text
from skyproof.formats.sigmf import check_sha512, meta_from_layout, open_sigmf
from skyproof.records import SampleGap

# --- what is read


@pytest.mark.parametrize("datatype", DATATYPES)
@settings(max_examples=15, deadline=None, suppress_health_check=NO_TMP_PER_EXAMPLE)
@given(data=st.data())
def test_every_type_channel_capture_and_header_reads_back(tmp_path, datatype, data):
    n_channels = data.draw(st.integers(1, 3))
    lengths = data.draw(st.lists(st.integers(0, 5), min_size=1, max_size=4).filter(lambda n: sum(n) > 1))
    headers = data.draw(st.lists(st.integers(0, 3), min_size=len(lengths), max_size=len(lengths)))
    missing = data.draw(st.lists(st.integers(0, 2), min_size=len(lengths), max_size=len(lengths)))
    trailing, offset = data.draw(st.integers(0, 4)), data.draw(st.integers(0, 9))
    numbers = 2 if datatype[0] == "c" else 1
    stored = draw_numbers(datatype, (sum(lengths), n_channels, numbers), data.draw(st.integers(0, 99)))
    starts = np.cumsum([0, *lengths])
    octets = (
        b"".join(
            b"\xa5" * header + stored[start : start + n].tobytes()
            for header, start, n in zip(headers, starts, lengths, strict=False)
        )
        + b"\x5a" * trailing
    )
    captures = [
        {
            "core:sample_start": int(start) + offset,
            "core:header_bytes": header,
            "core:frequency": 1.5e9,
            "core:global_index": int(start) + sum(missing[: number + 1]),
        }
        for number, (start, header) in enumerate(zip(starts, headers, strict=False))
    ]
    meta = make_meta(
        datatype, captures=captures, num_channels=n_channels, trailing_bytes=trailing, offset=offset, dataset="rec.dat"
    )
    opened = open_sigmf(write(tmp_path, meta, octets))
    assert [s.name for s in opened] == (["rec"] if n_channels == 1 else [f"rec-{n + 1}" for n in range(n_channels)])
    jumps = {}
    for start, n in zip(starts[1:-1], missing[1:], strict=True):
        if start > 0:
            jumps[int(start)] = jumps.get(int(start), 0) + n
    jumps = {start: n for start, n in jumps.items() if n and start < sum(lengths)}
    for channel, samples in enumerate(opened):
        expected = read_planes(stored[:, channel])
        assert samples.n_samples == sum(lengths)
        start, count = data.draw(st.integers(0, sum(lengths))), data.draw(st.integers(0, sum(lengths)))
        np.testing.assert_array_equal(samples.read(start, count), expected[:, start : start + count])
        np.testing.assert_array_equal(samples.read(0, sum(lengths)), expected)
        assert {gap.at_sample: gap.missing_samples for gap in samples.gaps} == jumps


@settings(max_examples=60, deadline=None, suppress_health_check=NO_TMP_PER_EXAMPLE)
@given(data=st.data())
def test_what_a_sidecar_says_metadata_of_sigmf_say_as_well(tmp_path, data):
    encoding = data.draw(st.sampled_from(list(FITTING_BITS)))
    kind = data.draw(st.sampled_from(["real", "complex"]))
    flags = st.booleans() if kind == "complex" else st.just(False)
    layout = SampleLayout(
        rate_hz=RATE_HZ,
        kind=kind,
        encoding=encoding,
        bits=data.draw(st.sampled_from(FITTING_BITS[encoding])),
        if_hz=data.draw(st.floats(-1e7, 1e7)),
        centre_hz=data.draw(st.floats(1e9, 2e9)),
        bit_order=data.draw(st.sampled_from(["msb-first", "lsb-first"])),
        byte_order=data.draw(st.sampled_from(["little", "big"])),
        header_bytes=data.draw(st.integers(0, 5)),
        swap_iq=data.draw(flags),
        conjugate=data.draw(flags),
        antenna=data.draw(st.sampled_from(["1", "mast"])),
        **data.draw(st.sampled_from([{}, {"start_gpst": "2022-01-01T21:45:58.123456789"}])),
    )
    octets = np.random.default_rng(data.draw(st.integers(0, 9))).bytes(960)
    (tmp_path / "rec.bin").write_bytes(b"\xa5" * layout.header_bytes + octets)
    (tmp_path / "rec.toml").write_text(write_sidecar_text(layout))
    meta = meta_from_layout(layout)
    validate.validate(meta)
    raw, samples = open_raw(tmp_path / "rec.bin"), read_one(write(tmp_path, meta, (tmp_path / "rec.bin").read_bytes()))
    np.testing.assert_array_equal(samples.read(0, 9999), raw.read(0, 9999))
    for field in ("rate_hz", "n_samples", "centre_hz", "if_hz", "start_gpst", "antenna"):
        assert getattr(samples, field) == getattr(raw, field)


@settings(max_examples=40, deadline=None, suppress_health_check=NO_TMP_PER_EXAMPLE)
@given(data=st.data())
def test_packed_channels_read_as_each_by_itself(tmp_path, data):
    encoding = data.draw(st.sampled_from(["sign", "sign-magnitude", "offset-binary", "int"]))
    layout = SampleLayout(
        rate_hz=RATE_HZ,
        kind=data.draw(st.sampled_from(["real", "complex"])),
        encoding=encoding,
        if_hz=0.0,
        bits=data.draw(st.sampled_from([b for b in FITTING_BITS[encoding] if b < 8])),
        bit_order=data.draw(st.sampled_from(["msb-first", "lsb-first"])),
    )
    n_channels = data.draw(st.integers(2, 4))
    octets = np.random.default_rng(data.draw(st.integers(0, 9))).bytes(240)
    flat = read_one(write(tmp_path, meta_from_layout(layout), octets, "flat")).read(0, 9999)
    for channel, samples in enumerate(
        open_sigmf(write(tmp_path, meta_from_layout(layout, n_channels=n_channels), octets))
    ):
        start = data.draw(st.integers(0, samples.n_samples))
        np.testing.assert_array_equal(samples.read(start, 77), flat[:, channel::n_channels][:, start : start + 77])


@pytest.mark.parametrize("datatype", DATATYPES)
@pytest.mark.parametrize("n_channels", [1, 2])
def test_the_package_sigmf_reads_the_same_samples(tmp_path, datatype, n_channels):
    numbers = 2 if datatype[0] == "c" else 1
    stored = draw_numbers(datatype, (40, n_channels, numbers))
    path = write(tmp_path, make_meta(datatype, num_channels=n_channels), stored.tobytes())
    theirs = sigmffile.fromfile(str(path), autoscale=False)[:].reshape(40, n_channels)
    for channel, samples in enumerate(open_sigmf(path)):
        ours = samples.read(0, 40)
        their = np.stack([theirs[:, channel].real, theirs[:, channel].imag]).astype(np.float64)
        if datatype[1] == "u":
            bits = 8 * stored.dtype.itemsize
            their[:numbers] = 2.0 * their[:numbers] - (2.0**bits - 1.0)
        tolerance = 2.0**10 if datatype[1:4] in ("u32", "i32") else 0.0  # theirs passes through float32 first
        np.testing.assert_allclose(ours, their, atol=tolerance, rtol=0.0)


def test_what_the_package_sigmf_writes_is_read(tmp_path):
    stored = draw_noise(1000)
    stored.tofile(tmp_path / "theirs.sigmf-data")
    meta = SigMFFile(
        data_file=str(tmp_path / "theirs.sigmf-data"),
        global_info={"core:datatype": "ci8", "core:sample_rate": RATE_HZ, "core:author": "someone"},
    )
    meta.add_capture(0, {"core:frequency": 1575.42e6, "core:datetime": "2022-01-01T21:45:40.250Z"})
    meta.add_annotation(100, 50, {"core:label": "tone"})
    meta.tofile(str(tmp_path / "theirs"))
    samples = read_one(tmp_path / "theirs.sigmf-meta")
    np.testing.assert_array_equal(samples.read(0, 1000), read_planes(stored))
    assert samples.start_gpst == np.datetime64("2022-01-01T21:45:58.250")
    assert [re.findall(r'\d+\.\d+|\d+|"\w+"', remark) for remark in samples.remarks] == [["1", '"tone"', "0.000"]]
    meta.archive(str(tmp_path / "packed.sigmf"))
    packed = read_one(tmp_path / "packed.sigmf")
    np.testing.assert_array_equal(packed.read(0, 1000), read_planes(stored))
    assert packed.path == str(tmp_path / "packed.sigmf")


def test_the_record_states_what_the_metadata_stated(tmp_path):
    captures = [
        {
            "core:sample_start": 0,
            "core:frequency": 1575e6,
            "skyproof:if_hz": 0.42e6,
            "core:datetime": "2016-12-31T23:59:60.5Z",
        }
    ]
    meta = make_meta(captures=captures, skyproof__antenna="mast")
    samples = read_one(write(tmp_path, meta, draw_noise(4000).tobytes(), "rx7"))
    assert (samples.name, samples.format, samples.antenna) == ("rx7", "SigMF", "mast")
    assert samples.path == str(tmp_path / "rx7.sigmf-data")
    assert (samples.rate_hz, samples.centre_hz, samples.if_hz) == (4e6, 1575e6, 0.42e6)
    assert samples.start_gpst == np.datetime64("2017-01-01T00:00:17.5")  # within the leap second
    assert samples.remarks == ()
    assert read_one(tmp_path / "rx7.sigmf-data").name == "rx7"


@pytest.mark.parametrize(
    ("text", "gpst"),
    [
        ("2022-01-01T21:45:40Z", "2022-01-01T21:45:58"),
        ("2022-01-01T21:45:40.1234567891Z", "2022-01-01T21:45:58.123456789"),
        ("2022-01-02T00:45:40+03:00", "2022-01-01T21:45:58"),
        ("2005-06-01T00:00:00z", "2005-06-01T00:00:13"),
    ],
)
def test_dates_are_utc_and_become_gps_time(tmp_path, text, gpst):
    meta = make_meta(captures=[{"core:sample_start": 0, "core:frequency": 1.5e9, "core:datetime": text}])
    assert read_one(write(tmp_path, meta, draw_noise(100).tobytes())).start_gpst == np.datetime64(gpst)


def test_a_clock_that_was_never_set_is_reported_and_not_used(tmp_path):
    captures = [{"core:sample_start": 0, "core:frequency": 1.5e9, "core:datetime": "1970-01-01T00:00:07Z"}]
    samples = read_one(write(tmp_path, make_meta(captures=captures), draw_noise(100).tobytes()))
    assert samples.start_gpst is None
    assert "clock" in samples.remarks[0]


def test_the_start_is_counted_back_from_the_dated_capture(tmp_path):
    captures = [
        {"core:sample_start": 0, "core:frequency": 1.5e9},
        {
            "core:sample_start": 400,
            "core:frequency": 1.5e9,
            "core:global_index": 2000400,
            "core:datetime": "2022-01-01T21:45:40Z",
        },
    ]
    samples = read_one(write(tmp_path, make_meta(captures=captures), draw_noise(1000).tobytes()))
    assert samples.gaps == (SampleGap(400, 2_000_000),)
    assert samples.start_gpst == np.datetime64("2022-01-01T21:45:57.4999")
    assert any("2000000 before sample 400" in remark for remark in samples.remarks)


def test_dates_that_samples_contradict_are_reported(tmp_path):
    captures = [
        {"core:sample_start": start, "core:frequency": 1.5e9, "core:datetime": f"2022-01-01T00:00:{second}Z"}
        for start, second in ((0, "00"), (400, "07"))
    ]
    samples = read_one(write(tmp_path, make_meta(captures=captures), draw_noise(1000).tobytes()))
    assert samples.gaps == ()
    assert any("captures[1] is +7.000 s" in remark for remark in samples.remarks)


def test_a_count_that_goes_back_is_reported_and_is_no_gap(tmp_path):
    captures = [
        {"core:sample_start": 0, "core:frequency": 1.5e9, "core:global_index": 900},
        {"core:sample_start": 400, "core:frequency": 1.5e9, "core:global_index": 1000},
    ]
    samples = read_one(write(tmp_path, make_meta(captures=captures), draw_noise(1000).tobytes()))
    assert samples.gaps == ()
    assert any(re.search(r"\b300 samples .*captures\[1\]", remark) for remark in samples.remarks)


def test_captures_of_another_tuning_are_another_recording(tmp_path):
    stored = draw_noise(900)
    captures = [
        {"core:sample_start": 300 * n, "core:frequency": frequency_hz}
        for n, frequency_hz in enumerate((1575.42e6, 1227.6e6, 1575.42e6))
    ]
    l1, l2 = open_sigmf(write(tmp_path, make_meta(captures=captures), stored.tobytes()))
    assert (l1.name, l2.name) == ("rec-1575.42MHz", "rec-1227.6MHz")
    assert (l1.centre_hz, l2.centre_hz) == (1575.42e6, 1227.6e6)
    np.testing.assert_array_equal(l1.read(0, 999), read_planes(np.concatenate([stored[:300], stored[600:]])))
    np.testing.assert_array_equal(l2.read(0, 999), read_planes(stored[300:600]))
    assert (l1.gaps, l2.gaps) == ((SampleGap(300, 300),), ())
    assert any(re.search(r"\b2 tunings\b", remark) for remark in l1.remarks)


def test_a_tuning_goes_on_in_captures_that_state_none(tmp_path):
    stored = draw_noise(900)
    captures = [
        {"core:sample_start": 0, "core:frequency": 1575e6, "skyproof:if_hz": 1e5},
        {"core:sample_start": 300},
        {"core:sample_start": 600, "core:datetime": "2022-01-01T00:00:00Z"},
    ]
    samples = read_one(write(tmp_path, make_meta(captures=captures), stored.tobytes()))
    assert (samples.name, samples.centre_hz, samples.if_hz) == ("rec", 1575e6, 1e5)
    np.testing.assert_array_equal(samples.read(0, 999), read_planes(stored))
    assert any("core:frequency" in remark and "captures[1], captures[2]" in remark for remark in samples.remarks)


def test_what_goes_on_is_that_of_the_capture_before(tmp_path):
    captures = [
        {"core:sample_start": 0},
        {"core:sample_start": 100, "core:frequency": 1227.6e6},
        {"core:sample_start": 200, "core:frequency": 1176.45e6},
        {"core:sample_start": 300},
    ]
    first, *rest = open_sigmf(write(tmp_path, make_meta(captures=captures), draw_noise(400).tobytes()))
    assert (first.centre_hz, first.n_samples) == (1575.42e6, 100)
    assert [(o.centre_hz, o.n_samples) for o in rest] == [(1227.6e6, 100), (1176.45e6, 200)]


def test_an_inverted_spectrum_is_turned_back(tmp_path):
    stored = draw_noise(500)
    plain = read_one(write(tmp_path, make_meta(), stored.tobytes())).read(0, 500)
    turned = read_one(write(tmp_path, make_meta(skyproof__conjugate=True), stored.tobytes())).read(0, 500)
    swapped = read_one(write(tmp_path, make_meta(skyproof__swap_iq=True), stored.tobytes())).read(0, 500)
    np.testing.assert_array_equal(turned, plain * [[1], [-1]])
    np.testing.assert_array_equal(swapped, plain[::-1])


def test_samples_before_the_first_capture_are_read(tmp_path):
    stored = draw_noise(500)
    captures = [
        {
            "core:sample_start": 100,
            "core:frequency": 1.5e9,
            "core:header_bytes": 4,
            "core:datetime": "2022-01-01T21:45:40Z",
        }
    ]
    octets = stored[:100].tobytes() + b"HEAD" + stored[100:].tobytes()
    samples = read_one(write(tmp_path, make_meta(captures=captures), octets))
    np.testing.assert_array_equal(samples.read(0, 999), read_planes(stored))
    assert samples.start_gpst == np.datetime64("2022-01-01T21:45:57.999975")
    assert samples.gaps == ()


def test_no_capture_is_one_capture_on_l1_and_reported(tmp_path):
    samples = read_one(write(tmp_path, make_meta(captures=[]), draw_noise(500).tobytes()))
    assert samples.centre_hz == 1575.42e6
    assert "core:frequency" in samples.remarks[0]


def test_annotations_are_counted_and_labels_reported(tmp_path):
    annotations = [{"core:sample_start": 4000 * n, "core:label": f"mark {n}"} for n in range(12)] + [{}, "damaged"]
    (remark,) = read_one(write(tmp_path, make_meta(annotations=annotations), draw_noise(5000).tobytes())).remarks
    assert re.findall(r'"mark (\d+)" at 0\.00(\d) s', remark) == [(str(n), str(n)) for n in range(10)]
    assert re.match(r"14 .*\b2 more$", remark)


def test_extensions_that_are_not_needed_are_passed_over(tmp_path):
    extensions = [{"name": "antenna", "version": "1.0.0", "optional": True}]
    meta = make_meta(extensions=extensions, antenna__model="patch")
    assert read_one(write(tmp_path, meta, draw_noise(5000).tobytes())).remarks == ()
    samples = read_one(write(tmp_path, make_meta(cpre__offset=3), draw_noise(5000).tobytes()))
    assert "cpre:offset" in samples.remarks[0]
    of_old = make_meta(extensions={"antenna": "0.9"}, antenna__model="patch")
    assert read_one(write(tmp_path, of_old, draw_noise(5000).tobytes())).remarks == ()


def test_a_channel_that_never_changes_costs_itself_only(tmp_path):
    stored = np.zeros((5000, 2, 2), np.int8)
    stored[:, 1] = draw_noise(5000)
    (samples,) = open_sigmf(write(tmp_path, make_meta(num_channels=2), stored.tobytes()))
    assert samples.name == "rec-2"
    assert any(re.search(r"\brec-1\b.*\bzero\b", remark) for remark in samples.remarks)


# --- the digest


def test_only_a_digest_that_differs_is_reported(tmp_path):
    octets = draw_noise(5000).tobytes()
    right = hashlib.sha512(octets).hexdigest()
    path = write(tmp_path, make_meta(sha512=right), octets)
    assert read_one(path).remarks == ()
    reported = []
    assert check_sha512(path, lambda done, size: reported.append((done, size))) == ()
    assert reported == [(10_000, 10_000)]
    path.with_suffix(".sigmf-data").write_bytes(octets[:-1] + b"\x00")
    assert "core:sha512" in read_one(path).remarks[0]
    assert len(check_sha512(path)) == 1


def test_long_data_are_not_digested_on_opening(tmp_path):
    path = write(tmp_path, make_meta(sha512="0" * 128), draw_noise(5000).tobytes())
    with open(path.with_suffix(".sigmf-data"), "r+b") as file:
        file.truncate(1 << 26)
    assert not any("sha512" in remark for remark in read_one(path).remarks)


# --- what is refused


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"core:datatype": "cf16_le"}, ['global.core:datatype = "cf16_le"', "ci8 or cf32_le"]),
        ({"core:datatype": "ci16_leX"}, ["global.core:datatype"]),
        ({"core:sample_rate": None}, ["global.core:sample_rate = null", "in hertz"]),
        ({"core:sample_rate": 2.6}, ["global.core:sample_rate = 2.6", "in hertz"]),
        ({"core:num_channels": 0}, ["global.core:num_channels = 0", "from 1 to 1024"]),
        ({"core:num_channels": 2**62}, ["global.core:num_channels", "from 1 to 1024"]),
        ({"core:trailing_bytes": -1}, ["global.core:trailing_bytes = -1", "zero"]),
        ({"core:trailing_bytes": 9999}, ["sample of 16 bits", "9999 trailing bytes"]),
        ({"core:sha512": "12"}, ['global.core:sha512 = "12"', "128 hexadecimal digits"]),
        ({"core:dataset": "../secret"}, ['global.core:dataset = "../secret"', "folder"]),
        ({"core:dataset": "gone.bin"}, ["gone.bin"]),
        ({"core:extensions": [{"name": "vita49", "version": "1", "optional": False}]}, ["extension vita49"]),
        ({"skyproof:if": 1.0}, ["global.skyproof:if is", "skyproof:if_hz?"]),
        ({"skyproof:encoding": "sign"}, ["global.skyproof:bits go"]),
        ({"skyproof:encoding": "sign", "skyproof:bits": 2}, ["global.skyproof:bits = 2"]),
        ({"core:datatype": "ri8"}, ["captures[0].skyproof:if_hz is missing", "real samples"]),
        ({"core:datatype": "ri8", "skyproof:if_hz": 0.0, "skyproof:conjugate": True}, ["complex samples"]),
        ({"core:datatype": "no", "core:num_channels": -1}, ["core:datatype", "core:num_channels"]),
    ],
    ids=lambda value: json.dumps(value)[:60],
)
def test_wrong_metadata_are_reported_with_file_key_and_remedy(tmp_path, change, words):
    meta = make_meta()
    path = write(tmp_path, meta, draw_noise(100).tobytes())
    meta["global"] |= change
    path.write_text(json.dumps(meta))
    with pytest.raises(InputError) as raised:
        open_sigmf(path)
    assert str(tmp_path) in str(raised.value)
    assert "\n" not in str(raised.value)
    for word in words:
        assert word in str(raised.value)


@pytest.mark.parametrize(
    ("captures", "words"),
    [
        ([{}], "captures[0].core:sample_start is missing"),
        ([{"core:sample_start": 0, "core:frequency": 0}], "captures[0].core:frequency = 0"),
        ([{"core:sample_start": 9}, {"core:sample_start": 3}], "captures[1].core:sample_start = 3"),
        ([{"core:sample_start": 0, "core:datetime": "yesterday"}], 'captures[0].core:datetime = "yesterday"'),
        ([{"core:sample_start": 0, "core:datetime": "2022-02-30T00:00:00Z"}], "expected UTC"),
        ([{"core:sample_start": 0, "core:header_bytes": 2.5}], "captures[0].core:header_bytes = 2.5"),
        ("none", 'captures = "none"'),
        ([{"core:sample_start": n, "core:frequency": 1e9 + n} for n in range(40)], "40 tunings"),
    ],
)
def test_wrong_captures_are_reported_with_their_place(tmp_path, captures, words):
    with pytest.raises(InputError) as raised:
        open_sigmf(write(tmp_path, make_meta(captures=captures), draw_noise(100).tobytes()))
    assert words in str(raised.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "not valid JSON"),
        ("[]", "an object"),
        ("{}", "global "),
        ('{"global": 3, "captures": []}', "global = 3"),
        ('{"global": {}, "captuses": []}', '"captuses"'),
        ("[" * 100_000, "too deep"),
        ('{"global": ' + "9" * 5000 + "}", "not valid JSON"),
    ],
)
def test_metadata_of_another_form_are_reported(tmp_path, text, words):
    with pytest.raises(InputError) as raised:
        open_sigmf(write(tmp_path, text, draw_noise(100).tobytes()))
    assert str(tmp_path / "rec.sigmf-meta") in str(raised.value)
    assert words in str(raised.value)


def test_missing_files_are_reported(tmp_path):
    with pytest.raises(InputError, match=r"gone\.sigmf-meta.*exist"):
        open_sigmf(tmp_path / "gone.sigmf-meta")
    path = write(tmp_path, make_meta(), draw_noise(100).tobytes())
    path.unlink()
    with pytest.raises(InputError, match=r"\bno /.*rec\.sigmf-meta beside"):
        open_sigmf(tmp_path / "rec.sigmf-data")
    path.write_text(json.dumps(make_meta(metadata_only=True)))
    (tmp_path / "rec.sigmf-data").unlink()
    with pytest.raises(InputError, match="without samples"):
        open_sigmf(path)
    (tmp_path / "rec.sigmf-data").write_bytes(b"")
    with pytest.raises(InputError, match="is empty"):
        open_sigmf(path)


def test_a_misspelt_key_that_would_move_the_samples_is_reported(tmp_path):
    captures = [{"core:sample_start": 0, "core:frequency": 1.5e9, "core:headr_bytes": 4}]
    (remark,) = read_one(write(tmp_path, make_meta(captures=captures), draw_noise(5000).tobytes())).remarks
    assert remark.startswith("captures[0].core:headr_bytes ")
    assert remark.endswith(" core:header_bytes?")


# --- length


def test_many_captures_without_a_byte_between_are_read_in_one_go(tmp_path):
    captures = [{"core:sample_start": n, "core:frequency": 1.5e9} for n in range(0, 3000, 3)]
    samples = read_one(write(tmp_path, make_meta(captures=captures), draw_noise(3000).tobytes()))
    np.testing.assert_array_equal(samples.read(0, 3000), read_planes(draw_noise(3000)))
    assert replace(samples, remarks=()).gaps == ()
