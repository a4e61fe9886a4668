"""Several antennas of one receiver as one source: in one file, in files of their own, and where they do not agree."""

from dataclasses import fields, replace

import numpy as np
import pytest

from skyproof.app.common.settings import Settings
from skyproof.app.receive.antennas import in_step
from skyproof.app.receive.inputs import open_inputs
from skyproof.app.receive.reception import observe
from skyproof.app.receive.tracker import track
from skyproof.errors import InputError
from skyproof.records import Observations, SampleGap, Samples

START = np.datetime64("2024-05-14T09:59:58", "ns")


def track_antennas(*paths):
    """Track the receiver of the four antennas."""
    (source,) = open_inputs([tuple(paths)], Settings(), None, ["array"])
    (tracker,), _ = track([source], Settings())
    return observe(tracker, None)


@pytest.fixture(scope="module")
def of_files(array_files):
    return track_antennas(*array_files.raw)


@pytest.mark.long
def test_antennas_in_one_file_measure_as_in_files_of_their_own(of_files, array_files):
    apart, together = of_files.antennas, track_antennas(array_files.sigmf).antennas
    assert len(apart) == len(together) == 4
    for separate, joined in zip(apart, together, strict=True):
        assert separate.signals == joined.signals
        assert np.isfinite(separate.pseudorange_m).sum() > 100
        for field in fields(Observations):
            a, b = getattr(separate, field.name), getattr(joined, field.name)
            if isinstance(a, np.ndarray):
                assert np.array_equal(a, b, equal_nan=a.dtype.kind == "f")  # to the last bit
    assert not np.array_equal(apart[0].pseudorange_m, apart[1].pseudorange_m, equal_nan=True)


def test_channels_of_a_raw_file_are_read_as_those_of_sigmf(array_files):
    raw, sigmf = open_inputs([(array_files.woven,)], Settings())[0], open_inputs([(array_files.sigmf,)], Settings())[0]
    assert raw.read_all(0, 10).shape == (4, 2, 10)
    assert np.array_equal(raw.read_all(123_456, 65_536), sigmf.read_all(123_456, 65_536))


def test_the_first_antenna_stands_for_the_receiver(of_files):
    assert of_files.observations is of_files.antennas[0]
    assert {o.receiver for o in of_files.antennas} == {"array"}
    assert of_files.array_phases is None  # nobody said where they are


def make_samples(**given):
    rng = np.random.default_rng(len(str(given)))
    values = rng.normal(size=(2, 1000)).astype(np.float32)
    samples = Samples(
        name="one",
        rate_hz=2.6e6,
        n_samples=1000,
        read=lambda start, count: values[:, start : start + count],
        start_gpst=START,
        path="one.bin",
    )
    return replace(samples, **given)


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("rate_hz", 2.6001e6, r"two\.bin: 2600100 .*\b2600000\b.*one\.bin"),
        ("centre_hz", 1575.5e6, r"two\.bin: .*\b1575500000 Hz, .*\b1575420000 Hz"),
        ("if_hz", 10.0, r"two\.bin: .*\b10 Hz, .*\b0 Hz"),
        (
            "n_samples",
            999,
            r"two\.bin: 999 samples, .*\b1000 samples .*one\.bin, .*duration_s",
        ),
        ("start_gpst", START + np.timedelta64(1, "s"), r"two\.bin: .*\b2024-05-14T09:59:59"),
        ("gaps", (SampleGap(10, 20),), r"two\.bin: .*\b20 .*\b10, .*none"),
    ],
)
def test_antennas_that_are_not_in_step_are_refused(key, value, words):
    with pytest.raises(InputError, match=words):
        in_step([make_samples(), make_samples(path="two.bin", **{key: value})], "rx")


def test_a_start_that_only_one_states_holds_for_all():
    source = in_step([make_samples(start_gpst=None), make_samples(path="two.bin")], "rx")
    assert (source.name, source.start_gpst, source.antenna) == ("rx", START, "1")
    assert [other.antenna for other in source.others] == ["2"]
    assert source.read_all(0, 1000).shape == (2, 2, 1000)


def test_remarks_name_the_antenna_unless_they_are_of_all():
    first, second = make_samples(remarks=("cut", "loud"), antenna="mast"), make_samples(remarks=("cut",), antenna="bow")
    assert in_step([first, second], "rx").remarks == ("cut", "antenna mast: loud")


def test_one_recording_twice_is_no_array(array_files, tmp_path):
    twin = tmp_path / "twin.bin"
    twin.write_bytes(array_files.raw[0].read_bytes())
    twin.with_suffix(".toml").write_text(array_files.raw[0].with_suffix(".toml").read_text())
    with pytest.raises(InputError, match=r"twin\.bin: .*\bsame\b"):
        open_inputs([(array_files.raw[0], twin)], Settings())
