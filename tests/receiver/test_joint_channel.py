"""One channel of several signals: who comes, who goes, who is who, and the same from samples."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.receiver.test_joint import noisy

from skyproof.gnss.signals import GPS_L1_CA
from skyproof.receiver import joint as j
from skyproof.receiver.births import strongest
from skyproof.receiver.joint_channel import bits, rebased, started
from skyproof.receiver.joint_model import JointModel
from skyproof.receiver.joint_tracker import JointState, JointTracker, Replica

MODEL = JointModel(signal=GPS_L1_CA, code=GPS_L1_CA.code(7), rate_hz=5e6)
RHO = MODEL.settings.chips_per_cycle


class Sky:
    """Two signals, the second of them there for a while."""

    def __init__(self, seed, apart_chips, relative_db, apart_hz, *, on_s=0.4, off_s=math.inf) -> None:
        self.rng = np.random.default_rng(seed)
        self.on_s, self.off_s, self.now_s = on_s, off_s, 0.01
        self.mean = np.zeros((2, j.N_STATE))
        size = np.sqrt(MODEL.energy(45.0)) * np.array([1.0, 10.0 ** (relative_db / 20.0)])
        amplitude = size * np.exp(2j * np.pi * self.rng.random(2))
        self.mean[:, j.RE], self.mean[:, j.IM] = amplitude.real, amplitude.imag
        self.mean[1, j.HZ], self.mean[1, j.CHIPS] = apart_hz, apart_chips

    def at(self, t_s):
        mean = j.carried(self.mean, t_s, RHO)
        return mean if self.on_s <= t_s < self.off_s else mean[:1]

    def bit(self):
        looks = j.signals_in(self.at(self.now_s), MODEL.bit_times_s, MODEL.look_s, MODEL.dictionary)
        self.now_s += MODEL.bit_s
        return noisy(self.rng, self.rng.choice([-1.0, 1.0]) * looks)


def begun(sky):
    """A channel on the first signal, somewhat wrong."""
    first = sky.at(-0.01)[0]
    return started(MODEL, complex(first[j.RE], first[j.IM]) * np.exp(0.2j), 0.5)


def run(sky, channel, seconds):
    """Rows with the moment of their middle."""
    rows = []
    for _ in range(round(seconds / MODEL.bit_s)):
        channel, row = bits(MODEL, [channel], sky.bit()[None, None])[0]
        if row is not None:
            rows.append((sky.now_s - MODEL.bit_s - 0.09, row))
    return rows, channel


@pytest.mark.parametrize(
    ("apart_chips", "relative_db", "apart_hz"),
    [(0.5, 6.0, 0.0), (-0.3, -6.0, 2.0), (1.4, -10.0, 0.0), (0.2, 0.0, 10.0)],
)
def test_a_second_signal_comes_and_goes_and_the_first_keeps_its_name(apart_chips, relative_db, apart_hz):
    sky = Sky(1, apart_chips, relative_db, apart_hz, on_s=0.4, off_s=1.2)
    rows, channel = run(sky, begun(sky), 3.0)
    assert [(row.came, row.went) for _, row in rows if row.came or row.went] == [((1,), ()), ((), (1,))]
    assert next(t for t, row in rows if row.came) < 0.8
    for t_s, row in rows:
        if len(row.names) == 2 and t_s < 1.1:
            error = np.abs(row.filtered[:, j.CHIPS] - sky.at(t_s)[:, j.CHIPS])
            assert np.all(error < 5.0 * row.sigma[:, j.CHIPS])
    assert channel.names == (0,)
    assert abs(channel.joint.mean[0, j.CHIPS] - sky.at(sky.now_s - MODEL.bit_s)[0, j.CHIPS]) < 0.02


@given(seed=st.integers(0, 1000), apart_chips=st.floats(-1.4, 1.4), apart_hz=st.floats(-50.0, 50.0))
@settings(max_examples=25)
def test_the_strongest_signal_is_found_without_signs_of_bits(seed, apart_chips, apart_hz):
    sky = Sky(seed, apart_chips, 10.0, apart_hz, on_s=0.0)
    turned, looks = [], []
    for _ in range(MODEL.bits_per_row):
        there = j.signals_in(sky.at(sky.now_s), MODEL.bit_times_s, MODEL.look_s, MODEL.dictionary)
        sky.now_s += MODEL.bit_s
        turned.append(sky.rng.choice([-1.0, 1.0]))
        looks.append(noisy(sky.rng, turned[-1] * there))
    signs, state = strongest(MODEL, np.stack(looks))
    truth = sky.at(0.1)[1]
    assert abs(np.dot(signs, turned)) == MODEL.bits_per_row
    assert abs(state[0, j.CHIPS] - truth[j.CHIPS]) < 0.15
    assert abs(state[0, j.HZ] - truth[j.HZ]) < 1.5
    assert math.hypot(state[0, j.RE], state[0, j.IM]) == pytest.approx(math.hypot(truth[j.RE], truth[j.IM]), rel=0.4)


@pytest.mark.parametrize(("seed", "off_hz"), [(3, 25.0), (4, -40.0), (5, 60.0)])
def test_signals_that_the_filter_has_lost_are_found_anew_and_rows_until_then_are_not_believed(seed, off_hz):
    sky = Sky(seed, 0.4, 0.0, 10.0, on_s=0.0)
    _, channel = run(sky, begun(sky), 0.6)
    assert channel.names == (0, 1)
    mean = channel.joint.mean.copy()
    mean[:, j.HZ] += off_hz
    mean[1, j.CHIPS] -= 0.3
    rows, channel = run(sky, replace(channel, joint=replace(channel.joint, mean=mean)), 0.8)
    assert rows[0][1].lost
    for middle_s, row in rows:
        assert row.names == (0, 1)
        off = row.alone.mean[:, j.CHIPS] - sky.at(middle_s)[:, j.CHIPS]
        assert row.lost or np.abs(off / row.alone.sigma(j.CHIPS)).max() < 5.0
    assert not rows[-1][1].lost


def test_a_replica_that_moves_changes_no_signal():
    sky = Sky(2, 0.5, -3.0, 10.0, on_s=0.0)
    _, channel = run(sky, begun(sky), 0.4)
    later_s, hz, chips = 0.15, 0.7, 0.1
    before = j.carried(channel.joint.mean, later_s, RHO)
    after = j.carried(rebased(channel, hz, chips).joint.mean, later_s, RHO)
    # Beside a carrier that has turned so much more, and a code that has come so much earlier since.
    turned = (after[:, j.RE] + 1j * after[:, j.IM]) * np.exp(2j * np.pi * hz * later_s)
    np.testing.assert_allclose(turned, before[:, j.RE] + 1j * before[:, j.IM])
    np.testing.assert_allclose(after[:, j.HZ] + hz, before[:, j.HZ])
    np.testing.assert_allclose(after[:, j.CHIPS] + chips - RHO * hz * later_s, before[:, j.CHIPS])


def test_a_replica_does_not_move_within_a_row():
    sky = Sky(3, 0.5, 0.0, 0.0)
    channel, _ = bits(MODEL, [begun(sky)], sky.bit()[None, None])[0]
    with pytest.raises(ValueError, match=r"\b1 bits\b"):
        rebased(channel, 1.0, 0.0)


def samples(rng, rate_hz, seconds, waves):
    """Sharp chips in white noise of variance one in I and in Q; waves: C/N0, delay (s), Doppler, phase, begin (s)."""
    n = round(rate_hz * seconds)
    t_s = np.arange(n) / rate_hz
    planes = rng.standard_normal((2, n), dtype=np.float32)
    bits = rng.choice([-1.0, 1.0], math.ceil(seconds * 50) + 2)
    for cn0_dbhz, delay_s, hz, phase_cyc, begin_s in waves:
        chip = (t_s * (1.0 + hz / GPS_L1_CA.carrier_hz) - delay_s) * GPS_L1_CA.chip_rate_hz
        whole = np.floor(chip).astype(np.int64)
        wave = bits[whole // 20460 + 1] * MODEL.code[whole % 1023] * (t_s >= begin_s)
        turn = np.exp(2j * np.pi * (hz * t_s + phase_cyc)) * math.sqrt(2.0 * 10.0 ** (0.1 * cn0_dbhz) / rate_hz)
        planes += np.stack([(wave * turn).real, (wave * turn).imag]).astype(np.float32)
    return planes


def test_two_signals_in_samples_are_measured_as_they_were_made():
    rng, rate_hz = np.random.default_rng(4), 4.0037e6
    model = JointModel(signal=GPS_L1_CA, code=MODEL.code, rate_hz=rate_hz)
    delay_s, hz = 1.2345e-3, 1234.5
    waves = [
        (47.0, delay_s, hz, 0.2, 0.0),
        (44.0, delay_s + 0.45 / GPS_L1_CA.chip_rate_hz, hz + 3.0, 0.7, 0.25),
    ]
    planes = samples(rng, rate_hz, 1.1, waves)
    start = math.ceil(delay_s * rate_hz)
    chip = (start / rate_hz * (1.0 + hz / GPS_L1_CA.carrier_hz) - delay_s) * GPS_L1_CA.chip_rate_hz
    replica = Replica(start=start, chip=chip + 0.03, phase_cyc=0.0, hz=hz - 1.0)
    tracker = JointTracker(model)
    noise = model.look_s * rate_hz * 2.0 * tracker.replica_power
    amplitude = math.sqrt(model.energy(47.0)) * np.exp(2j * np.pi * (hz * start / rate_hz + 0.2))
    state = JointState(replica=replica, row_began=replica, channel=started(model, complex(amplitude), 1.0), noise=noise)
    # In two pieces as in one.
    cut = round(0.5 * rate_hz)
    head, state = tracker.step(state, planes[:, :cut], 0)
    rest = state.replica.start
    tail, state = tracker.step(state, planes[:, rest:], rest)
    seen = [followed for _, followed in [*head, *tail] if len(followed) == 2]
    assert len(seen) >= 2
    for followed in seen:
        for one, (_, delay_s, hz, _, _) in zip(followed, waves, strict=True):
            t_s = one.at / rate_hz
            sent = (t_s * (1.0 + hz / GPS_L1_CA.carrier_hz) - delay_s) * GPS_L1_CA.chip_rate_hz
            assert abs(one.code_chips - sent) < 4.5 * one.code_sigma_chips
            assert abs(one.hz - hz) < 4.5 * one.hz_sigma
    assert state.noise == pytest.approx(noise, rel=0.15)
    assert [one.cn0_dbhz for one in seen[-1]] == pytest.approx([47.0, 44.0], abs=1.0)
