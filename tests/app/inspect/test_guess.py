"""Recordings that nothing describes: read as they were made, written down, or refused with what is needed."""

import json
import os
import re
import shlex
import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import skyproof
from skyproof import cli
from skyproof.app.inspect import NotUnderstood, inspect
from skyproof.app.inspect.guess import guess
from skyproof.errors import InputError, NotEnoughData, SettingsError
from skyproof.formats.raw import read_sidecar
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.simulator import scenes
from skyproof.simulator.samples import render_samples
from skyproof.simulator.scenario import FrontEnd, ScenePlace, Sky

START = np.datetime64("2024-03-03T11:59:58", "ns")


@cache
def render(rate_hz: float, if_hz: float, real: bool, seed: int, duration_s: float = 0.1, cn0s: tuple = (50.0, 40.0)):
    """Render a sky to rows of samples (1 or 2, n) of rms 1 each."""
    room_hz = rate_hz / 2 - abs(if_hz) if not real else min(if_hz, rate_hz / 2 - if_hz)
    front_end = FrontEnd(
        rate_hz=rate_hz,
        if_hz=if_hz,
        kind="real" if real else "complex",
        encoding="float",
        bits=32,
        bandwidth_hz=min(1.6 * room_hz, 8e6),
    )
    place = ScenePlace(lat_deg=-60.0 + 4.0 * seed, lon_deg=-170.0 + 12.0 * seed, height_m=500.0)
    scenario = scenes.make_clean(
        place, START, duration_s=duration_s, receivers=1, mask_deg=10.0, seed=seed, front_end=front_end
    )
    scenario = scenario.model_copy(update={"sky": Sky(zenith_cn0_dbhz=cn0s[0], horizon_cn0_dbhz=cn0s[1])})
    samples = render_samples(scenario, make_nominal_constellation(START))[0]
    planes = samples.read(0, samples.n_samples)[: 1 if real else 2]
    return planes / planes.std()


def interleave(planes: np.ndarray) -> np.ndarray:
    """Interleave the planes: I0 Q0 I1 Q1 ..."""
    return planes.T.reshape(-1)


def store_ints(planes: np.ndarray, kind: str, rms: float) -> bytes:
    limits = np.iinfo(kind)
    return np.clip(np.round(interleave(planes) * rms), limits.min, limits.max).astype(kind).tobytes()


def store_unsigned(planes: np.ndarray, rms: float, kind: str = "u1", middle: float = 127.5) -> bytes:
    return np.clip(np.round(interleave(planes) * rms + middle - 0.5), 0, np.iinfo(kind).max).astype(kind).tobytes()


def mirror_spectrum(planes: np.ndarray) -> np.ndarray:
    """Mirror the spectrum of real samples."""
    return planes * (-1.0) ** np.arange(planes.shape[1])


def pack_codes(codes: np.ndarray, bits: int, *, lsb_first: bool = False) -> bytes:
    codes = codes[: codes.size // (8 // bits) * (8 // bits)].reshape(-1, 8 // bits).astype(np.uint8)
    places = np.arange(8 // bits) * bits
    return np.bitwise_or.reduce(codes << (places if lsb_first else places[::-1]).astype(np.uint8), axis=1).tobytes()


def take_signs(planes: np.ndarray) -> np.ndarray:
    return interleave(planes) < 0


def code_signs(planes: np.ndarray, level: float = 1.0) -> np.ndarray:
    return 2 * take_signs(planes) + (np.abs(interleave(planes)) > level)


def code_offset(planes: np.ndarray, bits: int, step: float) -> np.ndarray:
    half = 2 ** (bits - 1)
    return np.clip(np.floor(interleave(planes) / step) + half, 0, 2 * half - 1).astype(np.uint8)


def make_wav(body: bytes, rate_hz: int, channels: int, bits: int, code: int = 1) -> bytes:
    size = channels * bits // 8
    head = struct.pack(
        "<4sI4s4sIHHIIHH",
        b"RIFF",
        36 + len(body),
        b"WAVE",
        b"fmt ",
        16,
        code,
        channels,
        rate_hz,
        rate_hz * size,
        size,
        bits,
    )
    return head + struct.pack("<4sI", b"data", len(body)) + body


@dataclass(frozen=True)
class Strange:
    """A file, and the layout that a right guess has; `if_hz` may have the other sign where the spectrum is mirrored."""

    name: str
    octets: Callable[[], bytes]
    layout: dict
    mirrored: bool = False

    def write(self, folder: Path) -> Path:
        path = folder / self.name
        path.write_bytes(self.octets())
        return path


def _case(name: str, octets: Callable[[], bytes], *, mirrored: bool = False, **layout: object) -> Strange:
    return Strange(name, octets, layout, mirrored)


COMPLEX, REAL = {"kind": "complex"}, {"kind": "real"}
TEN = (
    _case("one.bin", lambda: pack_codes(take_signs(render(2.6e6, 0.0, False, 1)), 1),
          rate_hz=2.6e6, if_hz=0.0, kind="complex", encoding="sign", bits=1, bit_order="msb-first"),
    _case("two.bin", lambda: pack_codes(code_signs(render(16.368e6, 4.092e6, True, 2)), 2),
          rate_hz=16.368e6, if_hz=4.092e6, kind="real", encoding="sign-magnitude", bits=2, bit_order="msb-first"),
    _case("three.dat", lambda: store_ints(render(4e6, 0.0, False, 3), "i1", 25.0),
          rate_hz=4e6, if_hz=0.0, kind="complex", encoding="int", bits=8),
    _case("four.dat", lambda: store_ints(render(5e6, 0.0, False, 4), ">i2", 300.0),
          rate_hz=5e6, if_hz=0.0, kind="complex", encoding="int", bits=16, byte_order="big"),
    _case("five", lambda: interleave(render(2.048e6, 0.0, False, 5)).astype("<f4").tobytes(),
          rate_hz=2.048e6, if_hz=0.0, kind="complex", encoding="float", bits=32, byte_order="little"),
    _case("six.bin", lambda: store_unsigned(render(2.4e6, 0.0, False, 6), 20.0),
          rate_hz=2.4e6, if_hz=0.0, kind="complex", encoding="offset-binary", bits=8),
    _case("seven.bin", lambda: store_ints(render(8.184e6, 1.405e6, False, 7)[::-1], "i1", 10.0), mirrored=True,
          rate_hz=8.184e6, if_hz=1.405e6, kind="complex", encoding="int", bits=8),
    _case("eight.bin",
          lambda: b"RECORDER 7 2024".ljust(1024, b"\0") + store_ints(render(10e6, 0.0, False, 8), "<i2", 900.0),
          rate_hz=10e6, if_hz=0.0, kind="complex", encoding="int", bits=16, byte_order="little", header_bytes=1024),
    _case("nine.bin", lambda: pack_codes(take_signs(render(5.456e6, 1.405e6, True, 9)), 1, lsb_first=True),
          rate_hz=5.456e6, if_hz=1.405e6, kind="real", encoding="sign", bits=1, bit_order="lsb-first"),
    _case("ten.wav", lambda: make_wav(store_ints(render(2.5e6, 0.0, False, 10), "<i2", 2000.0), 2_500_000, 2, 16),
          rate_hz=2.5e6, if_hz=0.0, kind="complex", encoding="int", bits=16, header_bytes=44),
)  # fmt: skip
"""The ten of mixed formats."""

MORE = (
    _case("nibbles.bin",
          lambda: pack_codes(np.frombuffer(store_ints(render(6.5e6, 0.0, False, 11), "i1", 2.0), np.int8) & 15, 4),
          rate_hz=6.5e6, if_hz=0.0, kind="complex", encoding="int", bits=4, bit_order="msb-first"),
    _case("offset-pairs.bin",
          lambda: pack_codes(code_offset(render(12.5e6, 2e6, False, 12), 2, 1.0), 2, lsb_first=True),
          rate_hz=12.5e6, if_hz=2e6, kind="complex", encoding="offset-binary", bits=2, bit_order="lsb-first"),
    _case("odd-rate.bin", lambda: store_ints(render(3_276_800.0, 123_000.0, False, 13), "i1", 30.0),
          rate_hz=3_276_800.0, if_hz=123_000.0, kind="complex", encoding="int", bits=8),
    _case("fraction.bin", lambda: store_ints(render(4_166_667.0, 0.0, False, 14), "<i2", 100.0),
          rate_hz=4_166_667.0, if_hz=0.0, kind="complex", encoding="int", bits=16, byte_order="little"),
    _case("odd-header.bin", lambda: b"a header of thirty-seven bytes, odd.\n"
          + store_ints(render(4e6, 0.0, False, 15), "<i2", 60.0),
          rate_hz=4e6, if_hz=0.0, kind="complex", encoding="int", bits=16, byte_order="little", header_bytes=37),
    _case("twelve-bit.bin", lambda: store_unsigned(render(5e6, 0.0, False, 16), 200.0, "<u2", 2048.0),
          rate_hz=5e6, if_hz=0.0, kind="complex", bits=16, byte_order="little"),
    _case("wide.bin", lambda: store_ints(render(2.8e6, 0.0, False, 17), "<i4", 5e6),
          rate_hz=2.8e6, if_hz=0.0, kind="complex", encoding="int", bits=32, byte_order="little"),
    _case("gn3s.bin",
          lambda: (2 * code_offset(render(38.192e6, 9.548e6, True, 18, 0.05), 2, 1.0) - 3).astype("i1").tobytes(),
          rate_hz=38.192e6, if_hz=9.548e6, kind="real", encoding="int", bits=8),
    _case("weak.bin", lambda: store_ints(render(2.048e6, 0.0, False, 19, 0.3, (42.0, 36.0)), "i1", 20.0),
          rate_hz=2.048e6, if_hz=0.0, kind="complex", encoding="int", bits=8),
    _case("dead-start.bin", lambda: bytes(400_000) + store_ints(render(4e6, 0.0, False, 20), "i1", 20.0),
          rate_hz=4e6, if_hz=0.0, kind="complex", encoding="int", bits=8),
    _case("off-carrier.bin", lambda: store_ints(render(10e6, 3.17e6, False, 21), "i1", 20.0),
          rate_hz=10e6, if_hz=3.17e6, kind="complex", encoding="int", bits=8),
    _case("real-off-quarter.bin", lambda: store_ints(render(20e6, 3.5e6, True, 22), "i1", 20.0),
          rate_hz=20e6, if_hz=3.5e6, kind="real", encoding="int", bits=8),
    _case("mirrored-real.bin", lambda: store_ints(mirror_spectrum(render(16.368e6, 4.092e6, True, 23)), "i1", 20.0),
          rate_hz=16.368e6, if_hz=-4.092e6, kind="real", encoding="int", bits=8),
    _case("doubles.bin", lambda: interleave(render(3.2e6, 0.0, False, 24)).astype(">f8").tobytes(),
          rate_hz=3.2e6, if_hz=0.0, kind="complex", encoding="float", bits=64, byte_order="big"),
    _case("unpacked.bin", lambda: take_signs(render(4.092e6, 0.0, False, 25)).astype(np.uint8).tobytes(),
          rate_hz=4.092e6, if_hz=0.0, kind="complex", bits=8),
    _case("two-valued.bin", lambda: (600 - 1200 * take_signs(render(4e6, 0.0, False, 29)).astype("<i2")).tobytes(),
          rate_hz=4e6, if_hz=0.0, kind="complex", bits=16, byte_order="little"),
    _case("shifted.bin", lambda: (256 * np.round(interleave(render(4e6, 0.0, False, 16)))).astype("<i2").tobytes(),
          rate_hz=4e6, if_hz=0.0, kind="complex", encoding="int", bits=16, byte_order="little"),
    _case("loud.bin", lambda: store_ints(render(4e6, 0.0, False, 26), "i1", 110.0),
          rate_hz=4e6, if_hz=0.0, kind="complex", encoding="int", bits=8),
    _case("magnitudes-first.bin", lambda: pack_codes(code_signs(render(8e6, 0.0, False, 27), 0.6), 2, lsb_first=True),
          rate_hz=8e6, if_hz=0.0, kind="complex", encoding="sign-magnitude", bits=2, bit_order="lsb-first"),
    _case("short.bin", lambda: store_ints(render(4e6, 0.0, False, 28, 0.01), "i1", 20.0),
          rate_hz=4e6, if_hz=0.0, kind="complex", encoding="int", bits=8),
)  # fmt: skip
"""Further formats, for which nothing was designed."""


# --- what is right


def find_differences(layout: dict, case: Strange) -> dict:
    """List what of a guess differs from how the file was made.

    A header may be a few samples longer or shorter while I and Q stay what they are, and a frequency may be off by
    2 ppm, which no satellite separates from the oscillator's error.
    """
    differs = {key: (layout.get(key), value) for key, value in case.layout.items() if layout.get(key) != value}
    frame = 2 * case.layout["bits"] // 8
    if "header_bytes" in differs and abs(off := layout["header_bytes"] - case.layout["header_bytes"]) <= 16:
        differs.pop("header_bytes") if off % frame == 0 else None
    if "if_hz" in differs and abs(layout["if_hz"] - case.layout["if_hz"]) < 2e-6 * 1575.42e6:
        differs.pop("if_hz")
    return differs


def read_as(found) -> dict:
    return {key: getattr(found.layout, key) for key in type(found.layout).model_fields}


@pytest.mark.parametrize(
    "case",
    [case for case in TEN if case.name in ("one.bin", "two.bin", "nine.bin", "ten.wav")],
    ids=lambda case: case.name,
)
def test_the_reading_that_shows_satellites_is_proposed_first(case: Strange, tmp_path: Path) -> None:
    found = guess(case.write(tmp_path))
    best = found.proposals[0]
    assert best.convincing
    assert find_differences({key: getattr(best.layout, key) for key in type(best.layout).model_fields}, case) == {}
    assert len(best.satellites) >= 7


@pytest.mark.long
@pytest.mark.parametrize("case", TEN, ids=lambda case: case.name)
def test_ten_recordings_of_mixed_formats_are_read_right(case: Strange, tmp_path: Path) -> None:
    path = case.write(tmp_path)
    (found,) = inspect(path, write=True)
    assert find_differences(read_as(found), case) == {}
    assert found.layout.conjugate is case.mirrored
    assert found.conjugate in (False, None)
    assert read_sidecar(path.with_suffix(".toml")) == found.layout


@pytest.mark.long
@pytest.mark.parametrize("case", MORE, ids=lambda case: case.name)
def test_formats_that_nothing_was_designed_for_are_read_right(case: Strange, tmp_path: Path) -> None:
    (found,) = inspect(case.write(tmp_path))
    assert find_differences(read_as(found), case) == {}


REAL = {
    "rf/meaconing-pair/rx1.bin": (2.6e6, 0.0, "complex", "sign", 1, False),
    "rf/meaconing-pair/rx2.bin": (2.6e6, 0.0, "complex", "sign", 1, False),
    "real/iq-cttc/GSoC_CTTC_capture_2012_07_26_4Msps_4ms.dat": (4e6, 0.0, "complex", "float", 32, False),
    "real/iq-pocketsdr/L1_20211125_004000_12MHz_I.bin": (12e6, 3e6, "real", "int", 8, False),
    "real/iq-pocketsdr/L1_20211201_054600_24MHz_I.bin": (24e6, 6e6, "real", "int", 8, False),
    "real/iq-pocketsdr/L1_20211202_084700_4MHz_IQ.bin": (4e6, 0.0, "complex", "int", 8, True),
}


LIKE_ANOTHER = ("rf/meaconing-pair/rx2.bin", "real/iq-pocketsdr/L1_20211201_054600_24MHz_I.bin")


@pytest.mark.shared_data
@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.long) if n in LIKE_ANOTHER else n for n in REAL])
def test_recordings_without_name_and_sidecar_are_read_right(name: str, shared_data: Path, tmp_path: Path) -> None:
    strange = tmp_path / "strange.bin"
    strange.symlink_to(shared_data / name)
    (found,) = inspect(strange, write=True)
    layout = found.layout
    seen = (layout.rate_hz, layout.if_hz, layout.kind, layout.encoding, layout.bits, layout.conjugate)
    assert seen == REAL[name]
    assert len(found.satellites) >= 5
    assert read_sidecar(tmp_path / "strange.toml") == layout


@pytest.mark.shared_data
def test_a_recording_of_another_band_convinces_of_nothing(shared_data: Path, tmp_path: Path) -> None:
    strange = tmp_path / "strange.bin"
    strange.symlink_to(shared_data / "real" / "iq-pocketsdr" / "L2_20211202_084700_4MHz_IQ_first100ms.bin")
    with pytest.raises(NotUnderstood, match="the rate") as refused:
        inspect(strange, write=True)
    assert not refused.value.guess.convincing
    assert not (tmp_path / "strange.toml").exists()


# --- several channels


@pytest.fixture
def guessed_once(monkeypatch) -> None:
    """Cache guesses, so that tests that inspect one file again do not repeat them."""
    monkeypatch.setattr("skyproof.app.inspect.undescribed.guess", cache(guess))


def render_receivers(n: int, rate_hz: float, if_hz: float, real: bool, duration_s: float = 0.1) -> np.ndarray:
    """Render several receivers to rows of numbers, one or two each."""
    scene = [render(rate_hz, if_hz, real, seed, duration_s) for seed in range(1, n + 1)]
    shortest = min(planes.shape[1] for planes in scene)
    return np.concatenate([planes[:, :shortest] for planes in scene])


def split_antenna(real: bool, noise: float) -> np.ndarray:
    """Make two channels of one antenna, each with noise of its own."""
    planes = render(4.092e6, 1.023e6, True, 3) if real else render(4e6, 0.0, False, 3)
    rng = np.random.default_rng(3)
    return np.concatenate([planes + noise * rng.normal(size=planes.shape) for _ in range(2)])


TOGETHER = [
    (2, 4e6, 0.0, False), (2, 2.6e6, 0.0, False), (2, 5e6, 1.2e6, False), (2, 8.184e6, 2.046e6, True),
    (2, 5.456e6, 1.405e6, True), (3, 4e6, 0.0, False), (4, 4e6, 0.0, False), (4, 2.6e6, 0.0, False),
    (4, 5e6, 1.2e6, False), (4, 5.456e6, 1.405e6, True), (4, 8.184e6, 2.046e6, True),
]  # fmt: skip


def store_rows(rows: np.ndarray, form: str) -> bytes:
    return pack_codes(take_signs(rows), 1) if form == "bits" else store_ints(rows, form, 20.0)


@pytest.mark.usefixtures("guessed_once")
@pytest.mark.parametrize(
    ("real", "form", "words"),
    [(False, "bits", "2 complex"), pytest.param(True, "i1", "2 real", marks=pytest.mark.long)],
)
def test_interleaved_channels_are_reported_and_get_no_sidecar(
    real: bool, form: str, words: str, tmp_path: Path
) -> None:
    words = f"{words} channels"
    path = tmp_path / "both.bin"
    path.write_bytes(
        store_rows(
            render_receivers(2, 5.456e6, 1.405e6, True) if real else render_receivers(2, 2.6e6, 0.0, False), form
        )
    )
    with pytest.raises(NotUnderstood, match=words) as refused:
        inspect(path, write=True)
    (command,) = re.findall(r"`skyproof inspect \S+ ([^`]*)`", str(refused.value))
    options = {name.replace("-", "_"): value for name, value in re.findall(r"--(\S+) (\S+)", command)}
    layout = {key: float(value) if value[0].isdecimal() else value for key, value in options.items()}
    layout |= {key: int(layout[key]) for key in ("channels", "bits")} | ({"if_hz": 1.405e6} if real else {})
    separate = inspect(path, layout=layout)
    assert len(separate) == 2
    assert all(len(item.satellites) > 3 for item in separate)
    assert refused.value.guess.proposals[0].log10_chance < -6.0  # it would have convinced
    first = refused.value.document()["proposals"][0]
    assert (first["interleaved"], first["convincing"]) == (words, False)
    assert list(tmp_path.iterdir()) == [path]
    (forced,) = inspect(path, write=1)
    assert any(words in remark for remark in forced.remarks)


@pytest.mark.long
@pytest.mark.parametrize("form", ["i1", "<i2", "bits"])
@pytest.mark.parametrize(("n", "rate_hz", "if_hz", "real"), TOGETHER)
def test_no_reading_of_several_channels_convinces(
    n: int, rate_hz: float, if_hz: float, real: bool, form: str, tmp_path: Path
) -> None:
    path = tmp_path / "several.bin"
    path.write_bytes(store_rows(render_receivers(n, rate_hz, if_hz, real), form))
    found = guess(path)
    assert not found.convincing
    assert found.proposals[0].interleaved or not found.proposals[0].satellites
    if found.proposals[0].interleaved:
        assert f"{n} {'real' if real else 'complex'}" in found.proposals[0].interleaved or (
            real and f" {n} real" in found.proposals[0].interleaved
        )


@pytest.mark.long
@pytest.mark.parametrize("form", ["i1", "bits"])
@pytest.mark.parametrize("real", [False, True])
@pytest.mark.parametrize("noise", [1.0, 0.3, 0.0])
def test_no_reading_of_a_split_antenna_convinces(real: bool, noise: float, form: str, tmp_path: Path) -> None:
    path = tmp_path / "split.bin"
    path.write_bytes(store_rows(split_antenna(real, noise), form))
    assert not guess(path).convincing


# --- nothing there


def make_noise(kind: str, seed: int) -> bytes:
    rng = np.random.default_rng(seed)
    if kind == "bits":
        return rng.bytes(200_000)
    return np.round(rng.normal(0.0, 20.0, 400_000)).astype("i1").tobytes()


@pytest.mark.parametrize("kind", ["bits", "int8"])
def test_noise_convinces_of_nothing(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "noise.bin"
    path.write_bytes(make_noise(kind, 1))
    with pytest.raises(NotUnderstood) as refused:
        inspect(path, write=True)
    proposals = refused.value.guess.proposals
    assert {proposal.layout.bits for proposal in proposals} == {1 if kind == "bits" else 8}
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.long
def test_of_many_noises_none_convinces(tmp_path: Path) -> None:
    path = tmp_path / "noise.bin"
    found = 0
    for seed in range(40):
        path.write_bytes(make_noise(("bits", "int8")[seed % 2], 100 + seed))
        trial = guess(path)
        assert not trial.convincing
        found += any(proposal.satellites for proposal in trial.proposals)
    assert found <= 2  # each search has a false alarm once in 10^4, and some twelve are made of each file


# --- what is written


@pytest.fixture
def swapped(tmp_path: Path) -> Path:
    """Write a one-bit file that has Q before I."""
    path = tmp_path / "swapped.bin"
    path.write_bytes(pack_codes(take_signs(render(2.6e6, 0.0, False, 1)[::-1]), 1))
    return path


def test_a_sidecar_states_what_was_measured_and_is_read_back(swapped: Path) -> None:
    (found,) = inspect(swapped, write=True)
    sidecar = swapped.with_suffix(".toml")
    assert found.sidecar == str(sidecar)
    assert "# measured: " in sidecar.read_text(encoding="utf-8")
    (again,) = inspect(swapped)
    assert again.layout == found.layout
    assert again.sources["rate_hz"] == "sidecar swapped.toml"
    assert again.conjugate is False  # Q comes first in this file, and the sidecar says what to do about it
    assert again.proposals == ()
    assert {satellite.sat for satellite in again.satellites} == {satellite.sat for satellite in found.satellites}


@pytest.mark.usefixtures("guessed_once")
def test_nothing_is_written_unasked_nor_over_what_is_there(swapped: Path) -> None:
    sidecar = swapped.with_suffix(".toml")
    (found,) = skyproof.inspect(swapped)
    assert found.sidecar is None
    assert not sidecar.exists()
    sidecar.write_text("[samples]\nrate_hz = 1", encoding="utf-8")
    with pytest.raises(InputError, match=r"swapped\.toml"):
        inspect(swapped, write=True)
    assert sidecar.read_text(encoding="utf-8") == "[samples]\nrate_hz = 1"


@pytest.mark.long
@pytest.mark.usefixtures("guessed_once")
def test_another_proposal_can_be_taken(swapped: Path) -> None:
    (first,) = inspect(swapped)
    assert len(first.proposals) > 1
    (second,) = inspect(swapped, write=2)
    assert (second.taken, second.layout.kind) == (1, first.proposals[1].layout.kind)
    assert read_sidecar(swapped.with_suffix(".toml")) == second.layout
    swapped.with_suffix(".toml").unlink()
    with pytest.raises(SettingsError, match="proposal 9"):
        inspect(swapped, write=9)


@pytest.mark.usefixtures("guessed_once")
def test_the_command_shows_the_guess_and_writes_it(swapped: Path, capsys) -> None:
    assert cli.main(["protect", str(swapped), "--out", str(swapped.parent / "out")]) == 2
    assert f"skyproof inspect {swapped}`" in capsys.readouterr().err
    assert cli.main(["inspect", str(swapped), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["proposals"][0]["convincing"]
    assert document["proposals"][0]["layout"]["rate_hz"] == 2.6e6
    assert document["sidecar_written"] is None
    assert not swapped.with_suffix(".toml").exists()
    assert cli.main(["inspect", str(swapped)]) == 0
    screen = capsys.readouterr().out
    assert "measured: " in screen
    assert "swapped.toml" in screen
    assert screen.count("\n") <= 55
    assert os.listdir(swapped.parent) == ["swapped.bin"]
    command = next(line for line in screen.splitlines() if "--write" in line).partition("skyproof ")[2]
    assert cli.main(shlex.split(command)) == 0
    output = [line[2:] for line in screen.splitlines() if line.startswith("  ")]
    assert set(swapped.with_suffix(".toml").read_text().splitlines()) <= {line.rstrip() for line in output} | {""}


@pytest.mark.usefixtures("guessed_once")
def test_what_cannot_be_decided_is_one_screen_and_one_document(tmp_path: Path, capsys) -> None:
    path = tmp_path / "noise.bin"
    path.write_bytes(make_noise("int8", 2))
    assert cli.main(["inspect", str(path)]) == 0
    assert "--rate-hz RATE" in " ".join(capsys.readouterr().out.split())
    assert cli.main(["inspect", str(path), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert (document["format"], document["path"]) == ("skyproof-inspect/1", str(path))
    assert all(not item["convincing"] for item in document["proposals"])


@pytest.mark.usefixtures("guessed_once")
def test_pictures_are_written_even_if_nothing_convinces(tmp_path: Path, capsys) -> None:
    path = tmp_path / "noise.bin"
    path.write_bytes(make_noise("int8", 2))
    out = tmp_path / "pictures"
    assert cli.main(["inspect", str(path), "--plot", "--out", str(out)]) == 0
    assert "not certain" in capsys.readouterr().out
    assert {item.name for item in out.iterdir()} == {"noise-levels.svg", "noise-spectrum.svg"}
    assert cli.main(["inspect", str(path), "--plot", "--out", str(out)]) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert cli.main(["inspect", str(path), "--plot", "--out", str(out), "--json", "--overwrite"]) == 0
    json.loads(capsys.readouterr().out)


def test_a_name_is_tried_and_not_believed(tmp_path: Path) -> None:
    octets = next(case for case in TEN if case.name == "three.dat").octets()
    honest, lying = tmp_path / "gps_4Msps_cs8.bin", tmp_path / "gps_5Msps_real_if1.405.bin"
    for path in (honest, lying):
        path.write_bytes(octets)
    reported = guess(honest).proposals[0]
    assert re.match(r".*\bname; code\b", reported.sources["rate_hz"])
    measured = guess(lying).proposals[0].layout
    assert (measured.rate_hz, measured.if_hz, measured.kind) == (4e6, 0.0, "complex")


# --- what is no recording


@pytest.mark.parametrize(
    ("octets", "words"),
    [
        (b"", ["is empty", "recorder"]),
        (b"PK\x03\x04" + bytes(500), ["a ZIP", "unpack it"]),
        (b"\x1f\x8b\x08" + bytes(500), ["a gzip", "unpack it"]),
        (b"\x89PNG\r\n\x1a\n" + bytes(500), ["a picture", "recording itself"]),
        (b"lat,lon,height\n" * 100, ["like text", "recording itself"]),
        (
            b"     2.11           N: GPS NAV DATA                         RINEX VERSION / TYPE\n" * 3,
            ["RINEX navigation", "--nav"],
        ),
        (b"[samples]\nrate_hz = 1e6\nkind = 'real'\n", ["a sidecar", "stands beside"]),
        (b"RIFF\x00\x10\x00\x00AVI " + bytes(500), ["a RIFF file", "PCM WAV"]),
    ],
)
def test_what_is_no_recording_is_recognized_by_name(octets: bytes, words: list[str], tmp_path: Path, capsys) -> None:
    path = tmp_path / "strange.bin"
    path.write_bytes(octets)
    for command in (["inspect", str(path)], ["protect", str(path), "--out", str(tmp_path / "out")]):
        assert cli.main(command) == 2
        reported = capsys.readouterr().err
        assert reported.count("\n") == 1
        assert str(path) in reported
        assert all(word in reported for word in words) or (command[0] == "protect" and b"AVI" in octets)


def test_a_folder_and_a_file_that_is_not_there_are_reported(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="regular"):
        inspect(tmp_path)
    with pytest.raises(InputError, match=r"gone\.bin.*exist"):
        inspect(tmp_path / "gone.bin")


def test_too_few_bytes_are_reported(tmp_path: Path) -> None:
    path = tmp_path / "tiny.bin"
    path.write_bytes(np.random.default_rng(1).bytes(100))
    with pytest.raises(NotEnoughData, match=r"\b100 bytes\b"):
        inspect(path)
