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
from skyproof.receiver.joining import JointReceiver, handed_back, handed_over, is_needed
from skyproof.receiver.joint_tracker import Followed, JointTracker

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


@given(
    bit_start=st.integers(0, 19),
    periods=st.integers(0, 10_000),
    chip=st.floats(0.0, 0.25),
    hz=st.floats(-4e3, 4e3),
    later=st.integers(-10_000, 10_000),
    half_cycles=st.integers(-3, 3),
)
def test_a_joint_channel_begins_with_the_bit_that_the_loop_is_in(bit_start, periods, chip, hz, later, half_cycles):
    one = loop(bit_start=bit_start, periods=periods, chip=chip, hz=hz)
    one[k.HALF_CYCLES] = half_cycles
    at = one[k.START] + later
    replica = handed_over(TRACKER, one[None], 2.0, at).replica
    assert replica.periods % 20 == bit_start
    assert at - 0.0201 * RATE_HZ < replica.start < at + 1
    assert replica.periods * 1023 + replica.chip == pytest.approx(shown_chips(one, replica.start), abs=1e-6)
    gone_s = (replica.start - one[k.START]) / RATE_HZ
    assert replica.phase_cyc == pytest.approx(one[k.PHASE] + 0.5 * half_cycles + gone_s * hz, abs=1e-6)


@given(at=st.integers(10**6, 10**7))
def test_rows_are_chosen_so_that_an_epoch_comes_within_a_bit_after_their_middle(at):
    epoch = 0.2 * RATE_HZ
    tracker = JointTracker(TRACKER.model, 0.0, epoch)
    state = handed_over(tracker, loop()[None], 2.0, at)
    bit = 0.02 * RATE_HZ
    assert -bit < state.replica.start - at < 9.0 * bit + 1
    later = (-(state.replica.start + 5.0 * bit)) % epoch
    assert -1.0 <= later < bit + 1.0
    assert state.replica.periods * 1023 + state.replica.chip == pytest.approx(
        shown_chips(loop(), state.replica.start), abs=1e-5
    )


@given(later_chips=st.floats(-1.4, 1.4), apart_hz=st.floats(-50.0, 50.0))
def test_a_second_loop_stands_beside_the_first_as_it_did(later_chips, apart_hz):
    first = loop()
    second = loop(hz=first[k.FREQUENCY] + apart_hz, periods=17, cn0_dbhz=40.0)
    second[k.START] += 4001
    second[k.CHIP] = (shown_chips(first, second[k.START]) - later_chips) % 1023
    state = handed_over(TRACKER, np.stack([first, second]), 2.0, first[k.START])
    drift = apart_hz / GPS_L1_CA.carrier_hz * GPS_L1_CA.chip_rate_hz * (state.replica.start - second[k.START]) / RATE_HZ
    mean = state.channel.joint.mean
    assert mean[1, j.CHIPS] == pytest.approx(later_chips - drift, abs=1e-3)
    assert mean[1, j.HZ] == pytest.approx(apart_hz)
    assert state.channel.joint.sigma(j.RE)[1] > math.sqrt(TRACKER.model.energy(40.0))  # its phase is not known


@given(
    off_chips=st.floats(-0.4, 0.4),
    turned_cyc=st.floats(-0.4, 0.4),
    hz=st.floats(-4e3, 4e3),
    half_cycles=st.integers(-3, 3),
)
def test_a_loop_goes_on_where_the_joint_channel_has_the_signal(off_chips, turned_cyc, hz, half_cycles):
    one = loop(hz=hz)
    one[k.HALF_CYCLES] = half_cycles
    middle = one[k.START] - 321_000.5
    followed = Followed(
        name=0,
        at=middle,
        code_chips=shown_chips(one, middle) + off_chips,
        # Whole cycles are the loop's.
        phase_cyc=one[k.PHASE] + 0.5 * half_cycles + (middle - one[k.START]) / RATE_HZ * hz + turned_cyc - 7.0,
        hz=hz,
        hz_s=0.0,
        cn0_dbhz=44.0,
        code_sigma_chips=0.01,
        phase_sigma_cyc=0.01,
        hz_sigma=0.1,
        alone=True,
    )
    back = handed_back(one, followed, TRACKER.model)
    assert 0.0 <= back[k.CHIP] < 0.5 + 1e-6  # 0.1 of the loop, 0.4 from it at most, to a rounding
    assert shown_chips(back, one[k.START]) - shown_chips(one, one[k.START]) == pytest.approx(off_chips, abs=1e-6)
    phase_then = back[k.PHASE] - (back[k.START] - one[k.START]) / RATE_HZ * hz
    assert phase_then - one[k.PHASE] == pytest.approx(turned_cyc, abs=1e-6)
    assert back[k.FREQUENCY] == hz


NOWHERE = np.zeros(4, np.bool_)


def test_loops_near_each_other_make_one_channel_and_others_their_own_where_a_look_is_wanted():
    first, second, third = loop(), loop(cn0_dbhz=40.0, periods=2507), loop(cn0_dbhz=50.0)
    second[k.CHIP] += 0.7
    third[k.CHIP] += 40.0
    loops = np.stack([second, first, third, loop()])
    channels = [(1, "G07"), (2, "G07"), (3, "G07"), (4, "G09")]
    near = RECEIVER.begin([], channels, loops, NOWHERE, 2.0, first[k.START])
    assert [(one.arcs, one.periods) for one in near] == [({0: 2, 1: 1}, {0: 0, 1: 1500})]
    wanted = np.array([False, False, True, False])
    both = RECEIVER.begin(near, channels, loops, wanted, 2.0, first[k.START])
    assert [one.arcs for one in both] == [{0: 2, 1: 1}, {0: 3}]
    assert RECEIVER.begin(both, channels, loops, wanted, 2.0, first[k.START]) == both


@pytest.mark.long
def test_a_look_ends_with_its_row_where_nothing_more_is_seen_and_a_second_signal_keeps_it():
    for apart_chips, stays in ((None, False), (0.45, True)):
        delay_s, hz = 1.5e-3, 1234.5
        waves = [(47.0, delay_s, hz, 0.2, 0.0)]
        if apart_chips is not None:
            waves.append((44.0, delay_s + apart_chips / GPS_L1_CA.chip_rate_hz, hz + 3.0, 0.7, 0.0))
        planes = samples(np.random.default_rng(4), RATE_HZ, 0.25, waves)
        start = math.ceil(delay_s * RATE_HZ)
        chip = start / RATE_HZ * GPS_L1_CA.chip_rate_hz * (1.0 + hz / GPS_L1_CA.carrier_hz)
        chip -= delay_s * GPS_L1_CA.chip_rate_hz
        one = loop(start=start, chip=chip, periods=40, bit_start=0, hz=hz, phase_cyc=hz * start / RATE_HZ + 0.2)
        followed = RECEIVER.begin([], [(5, "G07")], one[None], np.ones(1, np.bool_), 2.0, start)
        found, left = RECEIVER.step(followed, planes, 0, {5: ("G07", 5e4)})
        assert [each.arc for each in found] == [5]
        assert [each.row.came for each in left if is_needed(each)] == ([(1,)] if stays else [])
        # Where another satellite's code may be so strong, nothing is said to come.
        _, left = RECEIVER.step(followed, planes, 0, {5: ("G07", 5e4), 6: ("G09", 5e4 * (1023 / 65) ** 2)})
        assert not any(each.row.came for each in left)
