"""Prompts to bits, time and subframes."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.gnss.lnav import encode_subframes
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.receiver import telemetry as tm

NAVIGATION = make_nominal_constellation(np.datetime64("2024-03-03T12:00:00", "ns"))
WEEK = NAVIGATION.ephemerides[0].week
TOW_S = 43_200


def make_prompts(seconds, *, lead_periods, cn0_dbhz, polarity=1.0, seed=1):
    """Make in-phase prompts of 1 ms that begin `lead_periods` before a subframe."""
    bits = encode_subframes(NAVIGATION.ephemerides[0], NAVIGATION.ionosphere, None, TOW_S - 6, WEEK, seconds // 6 + 3)
    symbols = np.repeat(1.0 - 2.0 * bits, 20)
    start = 6000 - lead_periods
    rng = np.random.default_rng(seed)
    amplitude = np.sqrt(2.0 * 10.0 ** (cn0_dbhz / 10.0) * 1e-3)
    return polarity * amplitude * symbols[start : start + 1000 * seconds] + rng.normal(size=1000 * seconds)


def feed(values, *, block=100):
    state = tm.Telemetry()
    for start in range(0, values.size, block):
        state = tm.step(state, values[start : start + block], start, GPS_L1_CA)
    return state


@pytest.mark.parametrize("lead_periods", [0, 7, 1313, 5999])
@pytest.mark.parametrize("polarity", [1.0, -1.0])
def test_the_time_of_week_is_that_of_code_period_0(lead_periods, polarity):
    state = feed(make_prompts(20, lead_periods=lead_periods, cn0_dbhz=38.0, polarity=polarity))
    assert state.tow_ms_at_period_0 == TOW_S * 1000 - lead_periods


def test_blocks_of_any_size_give_the_same():
    values = make_prompts(20, lead_periods=777, cn0_dbhz=35.0)
    a, b = feed(values, block=100), feed(values, block=137)
    assert a.tow_ms_at_period_0 == b.tow_ms_at_period_0
    assert a.subframes.keys() == b.subframes.keys()


def test_subframes_1_to_3_are_kept_as_they_come():
    state = feed(make_prompts(26, lead_periods=100, cn0_dbhz=40.0))
    first = TOW_S // 6 % 5 + 1
    expected = {(first - 1 + i) % 5 + 1 for i in range(4)} & {1, 2, 3}
    assert expected <= state.subframes.keys()


def test_noise_has_no_time_of_week():
    rng = np.random.default_rng(9)
    assert feed(rng.normal(size=40_000)).tow_ms_at_period_0 is None


def test_memory_does_not_grow():
    state = feed(make_prompts(120, lead_periods=0, cn0_dbhz=40.0))
    assert state.bits.size <= tm.bits_kept(GPS_L1_CA.decoder)
    assert state.prompts.size < 2000


# ---------------------------------------------------------------------- a time of week that is kept


def test_a_fitting_time_of_week_is_kept_without_a_message():
    # Bits that a beat turns over at other places in each word: no subframe for longer than two.
    values = make_prompts(50, lead_periods=1313, cn0_dbhz=42.0)
    known = feed(values[:12_000])
    turned = np.where((np.arange(38_000) // 97) % 2, -1.0, 1.0)
    state = known
    for start in range(12_000, 50_000, 500):
        state = tm.step(state, (values[12_000:] * turned)[start - 12_000 : start - 11_500], start, GPS_L1_CA)
        assert state.tow_ms_at_period_0 == TOW_S * 1000 - 1313
        assert tm.bit_start(state, GPS_L1_CA) == -(TOW_S * 1000 - 1313) % 20


def test_a_time_of_week_is_dropped_once_bits_begin_elsewhere():
    state = tm.Telemetry(tow_ms_at_period_0=TOW_S * 1000 - 4313)
    values = make_prompts(3, lead_periods=4306, cn0_dbhz=40.0)  # no subframe begins in them
    assert tm.bit_start(state, GPS_L1_CA) == 4313 % 20
    state = tm.step(state, values, 0, GPS_L1_CA)
    assert state.synchronised
    assert state.tow_ms_at_period_0 is None
    assert tm.bit_start(state, GPS_L1_CA) == 4306 % 20


def send(bits, *, lead_periods, cn0_dbhz, rng):
    """Make in-phase prompts of bits (n,); the first begins at period `lead_periods` (0 to 19)."""
    strength = 10.0 ** (0.1 * cn0_dbhz) * 1e-3
    values = np.sqrt(2.0 * strength) * np.repeat(bits, 20)[(20 - lead_periods) % 20 :]
    return (values + rng.normal(size=values.size)).astype(np.float32)


@pytest.mark.parametrize("cn0_dbhz", [30.0, 40.0, 50.0])
def test_bits_that_do_not_turn_over_tell_no_start(cn0_dbhz):
    # A message may send nothing but zeros for seconds: where its bits begin is then not seen, and not guessed.
    rng = np.random.default_rng(2)
    for lead_periods in range(0, 20, 3):
        quiet, turning = np.ones(150), rng.choice([-1.0, 1.0], 150)
        values = send(np.concatenate([quiet, turning]), lead_periods=lead_periods, cn0_dbhz=cn0_dbhz, rng=rng)
        assert not feed(values[:2900]).synchronised
        assert tm.bit_start(feed(values), GPS_L1_CA) == lead_periods


@pytest.mark.long
@pytest.mark.parametrize("turning", [0.02, 0.1, 0.4])
@pytest.mark.parametrize("cn0_dbhz", [25.0, 32.0, 45.0])
def test_bits_are_hardly_ever_taken_to_begin_where_they_do_not(turning, cn0_dbhz):
    rng = np.random.default_rng(3)
    for _ in range(300):
        lead_periods = int(rng.integers(20))
        bits = np.cumprod(np.where(rng.random(300) < turning, -1.0, 1.0))
        state = feed(send(bits, lead_periods=lead_periods, cn0_dbhz=cn0_dbhz, rng=rng))
        assert tm.bit_start(state, GPS_L1_CA) in (None, lead_periods)


def test_bits_and_time_follow_the_signals_plan():
    # A message of 100 symbols a second: nothing counts C/A's twenty milliseconds.
    plan = replace(GPS_L1_CA, symbol_s=0.01)
    lead, every = 100, plan.periods_per_symbol
    values = (
        make_prompts(40, lead_periods=2 * lead, cn0_dbhz=45.0).reshape(-1, 2).sum(axis=1)
    )  # of each bit ten prompts
    state = tm.Telemetry()
    for start in range(0, values.size, 100):
        state = tm.step(state, values[start : start + 100], start, plan)
    assert tm.bit_start(state, plan) == lead % every
    behind_ms = state.tow_ms_at_period_0 - (TOW_S * 1000 - lead)  # frames of 3 s, each of which counts 6 s on
    assert behind_ms % 3000 == 0
    assert {1, 2, 3} & state.subframes.keys()


def test_a_signal_whose_message_is_not_known_is_not_read():
    empty = tm.Telemetry()
    assert tm.step(empty, np.ones(4000), 0, replace(GPS_L1_CA, decoder=None)) is empty
