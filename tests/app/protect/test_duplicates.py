"""Recordings of one antenna, and copies of one file, are one receiver: never a sign of spoofing by being alike."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
from scipy import signal as filters
from tests.app import kit

from skyproof.app.common.progress import Silent
from skyproof.app.common.settings import Settings
from skyproof.app.protect import judge, protect
from skyproof.app.protect.duplicates import find_shared_noise, leave_out_duplicates
from skyproof.app.receive.reception import observe
from skyproof.app.receive.short import observe_short
from skyproof.app.receive.tracker import track
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.simulator.samples import render_samples
from skyproof.simulator.scenario import FrontEnd

DURATION_S = 14.0
FAR = Settings(antenna_separation_m=50.0)


@pytest.mark.long
def test_a_copy_that_begins_later_is_one_receiver_and_no_attack(tmp_path):
    recorded = kit.record(kit.make_scenario(receivers=1, duration_s=DURATION_S), tmp_path)
    (original,) = recorded.paths
    copy = tmp_path / "copy.bin"
    copy.write_bytes(original.read_bytes()[round(2.6e6) * 2 // 8 :])  # one bit for I and for Q
    shutil.copy(original.with_suffix(".toml"), copy.with_suffix(".toml"))
    result = protect([original, copy], nav=recorded.nav, antenna_separation_m=50.0)
    assert result.verdict.verdict == "no_attack_seen"
    assert [r.reception.same_as for r in result.outcome.receivers] == [None, "bow"]
    assert {s.receiver for s in result.verdict.signals} == {"bow"}
    assert result.verdict.inputs[1].left_out


# ---------------------------------------------------------------------- each kind of copy, and what is none


class Pair:
    """A clean pair of receivers in memory, with a hand to make copies of the first one."""

    def __init__(self, front_end):
        scenario = kit.make_scenario(duration_s=DURATION_S, front_end=front_end)
        self.navigation = make_nominal_constellation(scenario.start_gpst)
        self.rng = np.random.default_rng(1)
        first, second = render_samples(scenario, self.navigation)
        self.planes = [s.read(0, s.n_samples) for s in (first, second)]
        self.samples = [first, second]

    def receive(self, planes, *, name="copy", rate_hz=None):
        """Make the reception of samples that are described as those of the first receiver."""
        samples = replace(
            self.samples[0],
            name=name,
            n_samples=planes.shape[1],
            rate_hz=rate_hz or self.samples[0].rate_hz,
            read=lambda start, count: planes[:, start : start + count],
        )
        (tracker,), _ = track([samples], FAR, None, self.navigation)
        return observe(tracker, self.navigation)

    def noise(self, n):
        return (self.rng.normal(size=n) + 1j * self.rng.normal(size=n)).astype(np.complex64)

    def judge(self, *receptions):
        """Return the verdicts without and with the test of noise."""
        taken = leave_out_duplicates(receptions, FAR)
        return [judge(list(some), self.navigation, FAR, Silent())[0].decision.verdict for some in (receptions, taken)]


def quantize_planes(wave):
    return np.stack([wave.real, wave.imag]).astype(np.float32)


def record_slow_clock(wave, faster, rate_hz, carrier_hz=1575.42e6):
    """Sample and mix down a wave by an oscillator that is slow by the share `faster`."""
    half, block = 12, 2600
    out = np.empty(wave.size - 100, np.complex64)
    padded = np.concatenate([np.zeros(100, np.complex64), wave, np.zeros(100, np.complex64)])
    for start in range(0, out.size, block):
        stop = min(start + block, out.size)
        whole, part = divmod((start + 0.5 * block) * faster, 1.0)
        taps = np.sinc(np.arange(-half, half + 1) - part) * np.hanning(2 * half + 3)[1:-1]
        first = 100 + start + int(whole) - half
        out[start:stop] = np.convolve(padded[first : first + stop - start + 2 * half], taps[::-1], "valid")
    turns = np.mod(carrier_hz * faster / rate_hz * np.arange(out.size), 1.0)
    return (out * np.exp(2j * np.pi * turns)).astype(np.complex64)


@pytest.mark.long
def test_changed_copies_are_found_and_other_antennas_are_none():
    pair = Pair(FrontEnd())
    whole = pair.planes[0]
    original = pair.receive(whole, name="original")

    def flipped(share):
        return np.where(pair.rng.random(whole.shape) < share, -whole, whole).astype(np.float32)

    copies = [whole[:, 2600:], whole[:, 2_600_000:], whole[:, 3:], flipped(0.01), flipped(0.2), 0.37 * whole]
    for planes in copies:
        copy = pair.receive(planes)
        assert not any(r.apart_from for r in leave_out_duplicates((original, copy), FAR))
        assert pair.judge(original, copy) == ["spoofed", "no_attack_seen"]
        found = find_shared_noise(original, copy, alpha=1e-6, code_sigma_m=1.0)
        assert found is not None
        assert found.coefficient > 0.5
    other = pair.receive(pair.planes[1])
    assert find_shared_noise(original, other, alpha=0.1, code_sigma_m=1.0) is None
    assert [r.apart_from for r in leave_out_duplicates((original, other), FAR)] == [{"copy"}, {"original"}]
    assert pair.judge(original, other) == ["no_attack_seen", "no_attack_seen"]  # nothing is given of the antennas


@pytest.mark.long
def test_receivers_of_any_clock_and_rate_on_one_antenna_are_one():
    pair = Pair(FrontEnd(encoding="float", bits=32))
    antenna = (pair.planes[0][0] + 1j * pair.planes[0][1]).astype(np.complex64)
    scale = np.float32(np.sqrt(0.1))
    original = pair.receive(np.sign(quantize_planes(antenna + scale * pair.noise(antenna.size))), name="original")
    slow = record_slow_clock(antenna, 0.7e-6, 2.6e6)
    fast = record_slow_clock(filters.resample_poly(antenna, 20, 13).astype(np.complex64), -0.9e-6, 4e6)
    for wave, rate_hz in ((slow, 2.6e6), (fast, 4e6)):
        second = pair.receive(quantize_planes(wave + scale * pair.noise(wave.size)), rate_hz=rate_hz)
        assert pair.judge(original, second) == ["spoofed", "no_attack_seen"]


@pytest.mark.long
def test_a_jammer_that_two_antennas_hear_does_not_make_them_one():
    # Its noise is four times the receivers' own; but the satellites' signals are not as late as it is.
    pair = Pair(FrontEnd(encoding="float", bits=32))
    first, second = ((planes[0] + 1j * planes[1]).astype(np.complex64) for planes in pair.planes)
    plain = pair.receive(quantize_planes(first)).observations, pair.receive(quantize_planes(second)).observations
    sat = plain[0].signals.index(plain[1].signals[0])
    # Of one satellite: when the second receiver hears what the first does, and how much higher.
    sent = [
        (o.gpst - plain[0].gpst[0]) / np.timedelta64(1, "s") - o.pseudorange_m[:, c] / 299_792_458.0
        for o, c in zip(plain, (sat, 0), strict=True)
    ]
    present = [np.isfinite(item) for item in sent]
    later_s = np.interp(sent[0][present[0]], sent[1][present[1]], plain[1].elapsed_s[present[1]])
    slope, offset_s = np.polyfit(plain[0].elapsed_s[present[0]], later_s - plain[0].elapsed_s[present[0]], 1)
    higher_hz = float(np.nanmedian(plain[1].doppler_hz[:, 0]) - np.nanmedian(plain[0].doppler_hz[:, sat]))
    jammer = 2.0 * pair.noise(first.size + 1000)
    there_too = record_slow_clock(jammer, -slope, 2.6e6, 0.0)[: first.size]
    shift = round(offset_s * 2.6e6)
    there_too = np.roll(there_too, shift)
    there_too = there_too * np.exp(2j * np.pi * np.mod(higher_hz / 2.6e6 * np.arange(first.size), 1.0))
    heard = (
        pair.receive(quantize_planes(first + jammer[: first.size])),
        pair.receive(quantize_planes(second + there_too)),
    )
    assert find_shared_noise(*heard, alpha=1e-3, code_sigma_m=100.0) is not None  # but for the ranges they would be one
    assert find_shared_noise(*heard, alpha=1e-3, code_sigma_m=1.0) is None


# ---------------------------------------------------------------------- snapshots


def make_snapshot(wave, name, like):
    """Observe some milliseconds without orbits."""
    planes = quantize_planes(wave)
    samples = replace(
        like,
        name=name,
        n_samples=planes.shape[1],
        start_gpst=None,
        read=lambda start, count: planes[:, start : start + count],
    )
    return observe_short(samples, None, Settings(), Silent())


@pytest.mark.parametrize("together", [True, False])
def test_snapshots_behind_a_splitter_are_one_receiver(together):
    scenario = kit.make_scenario(duration_s=0.045, front_end=FrontEnd(encoding="float", bits=32))
    first, second = render_samples(scenario, make_nominal_constellation(scenario.start_gpst))
    rng = np.random.default_rng(4)
    waves = []
    for samples in (first, first if together else second):
        planes = samples.read(0, samples.n_samples)
        wave = planes[0] + 1j * planes[1]
        level = np.sqrt(np.mean(np.abs(wave) ** 2))
        waves.append(wave + level * (rng.normal(size=wave.size) + 1j * rng.normal(size=wave.size)))
    heard = [make_snapshot(wave, name, first) for wave, name in zip(waves, ("left", "right"), strict=True)]
    assert all(reception.n_signals >= 4 for reception in heard)
    taken = leave_out_duplicates(heard, Settings())
    assert sum(reception.same_as is not None for reception in taken) == together


@pytest.mark.shared_data
@pytest.mark.long
def test_a_real_splitter_is_told_in_milliseconds(shared_data, tmp_path):
    folder = shared_data / "real" / "iq-ion" / "IFEN"
    for number, band in enumerate((1, 3)):
        path = folder / f"SX3_AltBOC_DualRF_Band{band}_FE0_ANT{number}_f1575420000.stream"
        shutil.copy(path, tmp_path / f"ant{number}.bin")
        layout = "rate_hz = 20e6\nkind = 'real'\nencoding = 'offset-binary'\nbits = 2\nif_hz = 5000445.9\n"
        (tmp_path / f"ant{number}.toml").write_text(f"[samples]\n{layout}bit_order = 'lsb-first'\n")
    result = protect([tmp_path / "ant0.bin", tmp_path / "ant1.bin"])
    assert sorted(str(r.reception.same_as) for r in result.outcome.receivers) == ["None", "ant0"]
