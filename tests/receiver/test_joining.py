"""From a loop to a joint channel and back, without a seam."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.receiver.test_joint_channel import samples

from skyproof.gnss.signals import GPS_L1_CA
from skyproof.receiver import joint as j
from skyproof.receiver import kernels as k
from skyproof.receiver.channels import Channel
from skyproof.receiver.joining import JointReceiver, handed_back, handed_over
from skyproof.receiver.joint_tracker import Followed, JointTracker
from skyproof.receiver.tracking import Receiver, ReceiverSettings, ReceiverState

RATE_HZ = 4.0037e6
RECEIVER = JointReceiver(GPS_L1_CA, RATE_HZ)
TRACKER: JointTracker = RECEIVER.tracker("G07")


def loop(*, start=123_456, chip=0.1, periods=1007, bit_start=3, hz=1234.5, phase_cyc=77.25, cn0_dbhz=45.0):
    row = np.zeros(k.N_STATE)
    row[[k.START, k.CHIP, k.PERIODS, k.BIT_START]] = start, chip, periods, bit_start
    row[[k.FREQUENCY, k.PLL_VELOCITY, k.PHASE, k.CN0_DBHZ]] = hz, hz, phase_cyc, cn0_dbhz
    row[k.CODE_RATE] = GPS_L1_CA.chip_rate_hz * (1.0 + hz / GPS_L1_CA.carrier_hz)
    return row


def shown_chips(row, sample):
    """What a loop's code shows at a sample, since its code period 0."""
    return row[k.PERIODS] * 1023 + row[k.CHIP] + (sample - row[k.START]) / RATE_HZ * row[k.CODE_RATE]


@given(bit_start=st.integers(0, 19), periods=st.integers(0, 10_000), chip=st.floats(0.0, 0.25), hz=st.floats(-4e3, 4e3))
def test_a_joint_channel_begins_with_the_next_bit_of_the_loop(bit_start, periods, chip, hz):
    one = loop(bit_start=bit_start, periods=periods, chip=chip, hz=hz)
    replica = handed_over(TRACKER, one[None], 2.0).replica
    assert replica.periods % 20 == bit_start
    assert 0 <= replica.periods - periods < 20
    assert replica.start >= one[k.START]
    assert replica.periods * 1023 + replica.chip == pytest.approx(shown_chips(one, replica.start), abs=1e-6)
    gone_s = (replica.start - one[k.START]) / RATE_HZ
    assert replica.phase_cyc == pytest.approx(one[k.PHASE] + gone_s * hz, abs=1e-6)


@given(later_chips=st.floats(-1.4, 1.4), apart_hz=st.floats(-50.0, 50.0))
def test_a_second_loop_stands_beside_the_first_as_it_did(later_chips, apart_hz):
    first = loop()
    second = loop(hz=first[k.FREQUENCY] + apart_hz, periods=17, cn0_dbhz=40.0)
    second[k.START] += 4001
    second[k.CHIP] = (shown_chips(first, second[k.START]) - later_chips) % 1023
    state = handed_over(TRACKER, np.stack([first, second]), 2.0)
    drift = apart_hz / GPS_L1_CA.carrier_hz * GPS_L1_CA.chip_rate_hz * (state.replica.start - second[k.START]) / RATE_HZ
    mean = state.channel.joint.mean
    assert mean[1, j.CHIPS] == pytest.approx(later_chips - drift, abs=1e-4)
    assert mean[1, j.HZ] == pytest.approx(apart_hz)
    assert state.channel.joint.sigma(j.RE)[1] > math.sqrt(TRACKER.model.energy(40.0))  # its phase is not known


@given(off_chips=st.floats(-0.4, 0.4), turned_cyc=st.floats(-0.4, 0.4), hz=st.floats(-4e3, 4e3))
def test_a_loop_goes_on_where_the_joint_channel_has_the_signal(off_chips, turned_cyc, hz):
    one = loop(hz=hz)
    middle = one[k.START] - 321_000.5
    followed = Followed(
        name=0,
        middle=middle,
        code_chips=shown_chips(one, middle) + off_chips,
        phase_cyc=one[k.PHASE] + (middle - one[k.START]) / RATE_HZ * hz + turned_cyc,
        hz=hz,
        cn0_dbhz=44.0,
        code_sigma_chips=0.01,
        phase_sigma_cyc=0.01,
        hz_sigma=0.1,
        alone=True,
    )
    back = handed_back(one, followed, TRACKER.model)
    assert 0.0 <= back[k.CHIP] < 0.5
    assert shown_chips(back, one[k.START]) - shown_chips(one, one[k.START]) == pytest.approx(off_chips, abs=1e-6)
    phase_then = back[k.PHASE] - (back[k.START] - one[k.START]) / RATE_HZ * hz
    assert phase_then - one[k.PHASE] == pytest.approx(turned_cyc, abs=1e-6)
    assert back[k.FREQUENCY] == hz


def test_loops_near_each_other_make_one_channel_and_others_their_own():
    first, second, third = loop(), loop(cn0_dbhz=40.0), loop(cn0_dbhz=50.0)
    second[k.CHIP] += 0.7
    third[k.CHIP] += 40.0
    loops = np.stack([second, first, third, loop()])
    channels = [(1, "G07"), (2, "G07"), (3, "G07"), (4, "G09")]
    states = RECEIVER.begin({}, channels, loops, 2.0)
    assert {arc: len(state.channel.names) for arc, (_, state) in states.items()} == {2: 2, 3: 1, 4: 1}
    assert RECEIVER.begin(states, channels, loops, 2.0).keys() == states.keys()


def test_a_channel_whose_signal_is_gone_is_given_up():
    rng = np.random.default_rng(1)
    states = RECEIVER.begin({}, [(1, "G07")], loop(start=1000)[None], 2.0)
    planes = rng.standard_normal((2, round(2.2 * RATE_HZ)), dtype=np.float32)
    found, left = RECEIVER.step(states, planes, 0)
    assert left == {}
    assert {one.arc for one in found} == {1}


def test_a_receiver_follows_jointly_what_one_of_its_loops_cannot_tell_apart():
    settings = ReceiverSettings(sats=("G07",), joint=True)
    receiver = Receiver(RATE_HZ, 0.0, settings)
    delay_s, hz = 1.5e-3, 1234.5
    waves = [
        (47.0, delay_s, hz, 0.2, 0.0),
        (44.0, delay_s + 0.45 / GPS_L1_CA.chip_rate_hz, hz + 3.0, 0.7, 0.25),
    ]
    planes = samples(np.random.default_rng(4), RATE_HZ, 1.0, waves)
    start = math.ceil(delay_s * RATE_HZ)
    code_rate = GPS_L1_CA.chip_rate_hz * (1.0 + hz / GPS_L1_CA.carrier_hz)
    chip = start / RATE_HZ * code_rate - delay_s * GPS_L1_CA.chip_rate_hz
    row = loop(start=start, chip=chip, periods=40, bit_start=0, hz=hz, phase_cyc=hz * start / RATE_HZ + 0.2)
    channel = Channel(sat="G07", began_s=0.0, found_s=0.0, missed_s=math.nan, arc=5, copy="a")
    state = ReceiverState(tail=planes[None], frame=10, channels=(channel,), loops=row[None], next_arc=6)
    assert receiver.joint is not None
    found = []
    for _ in range(2):  # begun by the loop, then followed
        state = receiver._follow_jointly(receiver.joint, state, found)
    assert {one.arc for one in found} == {5}
    late = [one.followed for one in found][-2:]
    assert [one.name for one in late] == [0, 1]
    for one, (_, delay_s, hz, _, _) in zip(late, waves, strict=True):
        sent = (one.middle / RATE_HZ * (1.0 + hz / GPS_L1_CA.carrier_hz) - delay_s) * GPS_L1_CA.chip_rate_hz
        assert abs(one.code_chips - 40 * 1023 - sent) < 5.0 * one.code_sigma_chips
        assert abs(one.hz - hz) < 5.0 * one.hz_sigma
    assert state.joint[5][1].replica.start > 0.9 * planes.shape[1]
