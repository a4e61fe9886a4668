"""Half cycles of the carrier resolved by the message, and said to be open where they are not."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.receiver.test_telemetry import feed, make_prompts

from skyproof.gnss.lnav import encode_subframes
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.receiver import telemetry as tm
from skyproof.receiver.polarity import Stretch, find_stretches, join_stretches, resolve_half_cycles

NAVIGATION = make_nominal_constellation(np.datetime64("2024-03-03T12:00:00", "ns"))
MESSAGE = encode_subframes(NAVIGATION.ephemerides[0], None, None, 43_200, NAVIGATION.ephemerides[0].week, 4)


def find_sign(stretches, bit):
    """Return the sign that the stretches give a bit, by the code periods in it; None if none."""
    reported = {s.inverted for s in stretches if s.first_period <= 20 * bit < s.end_period}
    assert len(reported) < 2
    return reported.pop() if reported else None


# ---------------------------------------------------------------------- the sign of the bits


@given(lead=st.integers(0, 299), turn=st.integers(100, 1000), inverted=st.booleans())
def test_the_bits_sign_is_known_up_to_the_word_where_it_turns(lead, turn, inverted):
    bits = MESSAGE[lead:].copy()
    truth = (np.arange(bits.size) >= turn) ^ inverted
    stretches = find_stretches(bits ^ truth.astype(np.int8), (-lead) % 300, 0, GPS_L1_CA, GPS_L1_CA.decoder)
    reported = [find_sign(stretches, bit) for bit in range(bits.size)]
    assert all(t is None or t == truth[bit] for bit, t in enumerate(reported) if abs(bit - turn) > 30)
    words = range((-lead) % 30 + 30, bits.size - 330, 30)  # whole ones with a word before them and a subframe after
    for first in words:
        if not first - 2 <= turn <= first + 30:
            near = reported[first : first + 30]
            assert None not in near or abs(first - turn) < 300


@given(seed=st.integers(0, 10_000), error_rate=st.sampled_from([0.003, 0.01, 0.03]))
def test_damaged_bits_never_give_a_wrong_sign(seed, error_rate):
    rng = np.random.default_rng(seed)
    bits = MESSAGE ^ (rng.random(MESSAGE.size) < error_rate).astype(np.int8)
    assert not any(stretch.inverted for stretch in find_stretches(bits, 0, 0, GPS_L1_CA, GPS_L1_CA.decoder))


def test_stretches_of_one_sign_join_unless_much_is_between():
    near, far = Stretch(600, 1200, True), Stretch(6000, 7000, True)
    assert join_stretches([near], [Stretch(0, 600, True), far], 1200) == (Stretch(0, 1200, True), far)
    assert join_stretches([near], [Stretch(1800, 2400, False)], 1200) == (near, Stretch(1800, 2400, False))


@pytest.mark.parametrize("block", [100, 137, 1000])
def test_a_channel_learns_the_sign_and_its_turn_in_any_blocks(block):
    values = make_prompts(26, lead_periods=777, cn0_dbhz=38.0, polarity=-1.0)
    values[13_000:] *= -1.0
    stretches = feed(values, block=block).stretches
    assert [stretch.inverted for stretch in stretches] == [True, False]
    assert 13_000 - 640 <= stretches[0].end_period <= 13_000 <= stretches[1].first_period <= 13_000 + 640


def test_what_is_known_of_the_sign_does_not_grow_with_time():
    assert len(feed(make_prompts(90, lead_periods=0, cn0_dbhz=40.0)).stretches) == 1


def test_a_new_time_of_week_forgets_the_earlier_sign():
    known = tm.Telemetry(tow_ms_at_period_0=5, stretches=(Stretch(0, 500, True),), synchronised=True)
    state = tm.step(known, make_prompts(8, lead_periods=100, cn0_dbhz=45.0), 0, GPS_L1_CA)
    assert state.tow_ms_at_period_0 is not None
    assert not any(stretch.inverted for stretch in state.stretches)


# ---------------------------------------------------------------------- rows of measurements


PERIODS = np.arange(0, 20_000, 200)
NEVER = np.zeros(PERIODS.size, np.bool_)


def make_rows(*stretches, turned=NEVER, slipped=NEVER):
    return resolve_half_cycles(PERIODS, turned, slipped, stretches, 100)


def test_what_is_known_late_counts_for_the_whole_arc():
    found = make_rows(Stretch(12_000, 13_200, True))
    assert (found.added == 1).all()
    assert not found.open.any()
    assert not found.slipped.any()


def test_without_the_message_every_row_is_open():
    found = make_rows()
    assert found.open.all()
    assert not found.added.any()


def test_a_loop_that_slips_half_a_cycle_changes_nothing():
    # Its bits come inverted from then on, and its measured carrier is half a cycle off it: `HALF_CYCLES`.
    turned = PERIODS >= 6000
    found = make_rows(Stretch(0, 5400, False), Stretch(6600, 20_000, True), turned=turned, slipped=PERIODS == 6000)
    assert not found.added.any()
    assert not found.open.any()
    assert np.flatnonzero(found.slipped).tolist() == [30]


def test_a_slip_ends_what_the_message_shows():
    slipped = (PERIODS == 6000) | (PERIODS == 8000)
    found = make_rows(Stretch(0, 5400, True), Stretch(8100, 20_000, False), slipped=slipped)
    assert found.added.tolist() == [1] * 30 + [0] * 70
    assert np.flatnonzero(found.open).tolist() == list(range(30, 40))


def test_an_unseen_turn_is_a_slip_and_open_meanwhile():
    found = make_rows(Stretch(0, 6000, False), Stretch(6600, 20_000, True))
    assert np.flatnonzero(found.slipped).tolist() == [30, 31, 32, 33, 34]  # row 29 is the last to lie in the first
    assert np.flatnonzero(found.open).tolist() == [30, 31, 32, 33]
    assert found.added.tolist() == [0] * 34 + [1] * 66


@given(
    seed=st.integers(0, 10_000),
    edges=st.sets(st.integers(0, 20_000), min_size=2, max_size=8),
    flips=st.floats(0.0, 0.5),
)
def test_the_carrier_moves_by_half_a_cycle_at_slips_only(seed, edges, flips):
    rng = np.random.default_rng(seed)
    turned, slipped = rng.random((2, PERIODS.size)) < flips
    stretches = [Stretch(a, b, bool(rng.integers(2))) for a, b in pairwise(sorted(edges))]
    found = make_rows(*stretches, turned=turned, slipped=slipped)
    assert (found.slipped | ~slipped).all()
    steps = np.flatnonzero(np.diff(found.added)) + 1
    assert found.slipped[steps].all()
    assert found.slipped[np.flatnonzero(np.diff(found.open.astype(int))) + 1].all()
