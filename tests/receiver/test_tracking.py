"""The receiver as a step, against the simulator's truth."""

from dataclasses import fields
from itertools import pairwise

import numpy as np
import pytest
from tests.receiver.conftest import PLACE, START, Rendered

from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.time import week_and_tow
from skyproof.receiver import measurement as m
from skyproof.receiver.channels import letter
from skyproof.receiver.measurement import Measurements
from skyproof.receiver.observables import assemble, receiver_time_tag, resolve_carriers
from skyproof.receiver.tracking import Receiver, ReceiverState
from skyproof.records import Observations
from skyproof.simulator import scenes
from skyproof.simulator.scenario import FrontEnd


def receive(rendered, cuts):
    """Track a recording that comes in pieces with these edges (sample indices); return measurements and arcs."""
    receiver = Receiver(rendered.samples.rate_hz, rendered.samples.if_hz)
    state, parts, arcs = ReceiverState(), [], {}
    edges = [0, *cuts, rendered.planes.shape[1]]
    for first, end in pairwise(edges):
        output, state = receiver.step(state, rendered.planes[:, first:end])
        parts.append(output.measurements)
        arcs |= output.arcs
    return Measurements.join(parts), arcs


def make_observations(rendered, measurements, arcs):
    week = week_and_tow(rendered.scenario.start_gpst)[0]
    first = np.isin(np.arange(len(measurements)), np.unique(measurements.arc, return_index=True)[1])
    label = receiver_time_tag(measurements.select(first), arcs, week)
    assert label is not None
    elapsed_s = 0.2 * np.arange(1, round(measurements.elapsed_s[-1] / 0.2) + 1)
    carriers = resolve_carriers(
        np.rint(measurements.elapsed_s / 0.2).astype(np.int64),
        measurements.arc,
        measurements.column(m.PERIODS).astype(np.int64),
        measurements.column(m.TURNED) > 0.0,
        measurements.column(m.SLIP) > 0.0,
        arcs,
        averaged_s=0.2,
    )
    return assemble("rx", measurements, arcs, label, elapsed_s, carriers, carrier_hz=1575.42e6, averaged_s=0.2)


def test_an_antenna_that_receives_nothing_has_no_carriers():
    nothing = np.zeros(0, np.int64)
    of_none = nothing.astype(bool)
    assert resolve_carriers(nothing, nothing, nothing, of_none, of_none, {}, averaged_s=0.2) == {}


@pytest.fixture(scope="session")
def track(clean):
    return receive(clean, [])


@pytest.fixture(scope="session")
def meaconer_tracked(meaconer):
    return receive(meaconer, [])


def find_truth(rendered, o: Observations):
    """Return true code delay (s), carrier delay (s) and Doppler (Hz) at every epoch, columns as in `o`."""
    sky = rendered.scene.skies[rendered.receiver]
    true_s = o.elapsed_s + sky.true_minus_elapsed_s(o.elapsed_s)
    columns = [[heard.id.sat for heard in sky.signals].index(signal.sat) for signal in o.signals]
    drift = sky.receiver.lo_ppm * 1e-6
    doppler_hz = -1575.42e6 * (sky.carrier_delay_rate(true_s)[:, columns] + drift)
    return true_s, sky.code_delay_s(true_s)[:, columns], sky.carrier_delay_s(true_s)[:, columns], doppler_hz


@pytest.mark.parametrize(
    "cuts", [[1_300_000], [1, 260_000, 260_001, 3_333_333], list(range(100_003, 15_000_000, 999_983))]
)
def test_pieces_give_what_the_whole_gives(meaconer, meaconer_tracked, cuts):
    whole, whole_arcs = meaconer_tracked
    pieces, arcs = receive(meaconer, [c for c in cuts if c < meaconer.planes.shape[1]])
    assert len(whole_arcs) > 10
    assert arcs.keys() == whole_arcs.keys()
    for name in ("elapsed_s", "arc", "table", "taps"):
        assert np.array_equal(getattr(pieces, name), getattr(whole, name))  # to the last bit


def test_a_late_front_end_costs_a_second_and_not_the_recording(clean):
    planes = clean.planes[:, : 3 * 2_600_000].copy()
    planes[:, : 2_600_000 // 3] = 1.0
    receiver = Receiver(2_600_000)
    output, _ = receiver.step(ReceiverState(), planes)
    in_sky = {heard.id.sat for heard in clean.scene.skies[0].signals}
    assert {arc.signal.sat for arc in output.arcs.values()} == in_sky
    assert {arc.found_s for arc in output.arcs.values()} == {1.0}


def test_every_satellite_has_one_signal_and_a_time(clean, track):
    o = make_observations(clean, *track)
    in_sky = sorted(heard.id.sat for heard in clean.scene.skies[0].signals)
    assert [signal.sat for signal in o.signals] == in_sky
    assert {signal.copy for signal in o.signals} == {"a"}
    assert np.isfinite(o.pseudorange_m[5:]).all()


def test_the_time_of_week_is_exact_to_the_millisecond(clean, track):
    measurements, arcs = track
    sky = clean.scene.skies[0]
    start_s = week_and_tow(clean.scenario.start_gpst)[1]
    sats = [heard.id.sat for heard in sky.signals]
    for number, arc in arcs.items():
        last = np.flatnonzero(measurements.arc == number)[-1]
        elapsed_s, row = float(measurements.elapsed_s[last]), measurements.table[last]
        true_s = elapsed_s + float(sky.true_minus_elapsed_s(elapsed_s))
        sent_s = start_s + true_s - float(sky.code_delay_s(true_s)[sats.index(arc.signal.sat)])
        told_s = (arc.tow_ms_at_period_0 + row[m.PERIODS]) * 1e-3 + row[m.FRACTION_S]
        assert abs(told_s - sent_s) < 1e-7


def test_pseudorange_noise_is_white_unbiased_and_as_stated(clean, track):
    o = make_observations(clean, *track)
    _, code_s, _, _ = find_truth(clean, o)
    error_m = o.pseudorange_m - SPEED_OF_LIGHT_M_S * code_s
    error_m -= np.median(error_m, axis=1, keepdims=True)  # the receiver's clock
    error_m = error_m[5:]
    ratio = error_m.std(axis=0) / o.pseudorange_sigma_m[5:].mean(axis=0)
    assert 0.8 < np.median(ratio) < 1.3
    assert np.abs(error_m.mean(axis=0)).max() < 0.6
    lag_one = np.mean(error_m[1:] * error_m[:-1], axis=0) / error_m.var(axis=0)
    assert abs(np.mean(lag_one)) < 0.15


def test_carrier_and_doppler_agree_with_the_truth(clean, track):
    o = make_observations(clean, *track)
    _, _, carrier_s, doppler_hz = find_truth(clean, o)
    o_rows = slice(8, None)
    sky = clean.scene.skies[0]
    clock_s = -sky.true_minus_elapsed_s(o.elapsed_s)[:, None]
    error_cyc = (o.carrier_cyc - 1575.42e6 * (carrier_s + clock_s))[o_rows]
    # One arbitrary start a channel, by whole cycles: the change over time is what counts, and the fraction.
    moved = error_cyc - error_cyc[0]
    assert np.abs(moved).max() < 0.06
    assert np.abs(wrap_cycles(error_cyc - error_cyc[:, :1])).max() < 0.06
    assert np.abs((o.doppler_hz - doppler_hz)[o_rows]).max() < 0.5


def test_copies_appear_with_the_meaconer_and_bracket_its_onset(meaconer, meaconer_tracked):
    _, arcs = meaconer_tracked
    late = [arc for arc in arcs.values() if arc.signal.copy == "b"]
    assert len(late) == len(meaconer.scene.skies[0].signals) // 2
    for arc in late:
        assert arc.missed_s <= 2.0 + 0.1
        assert arc.found_s >= 2.0 - 0.1
        assert arc.found_s - arc.missed_s <= 5.0


def test_state_does_not_grow_with_time(clean):
    receiver = Receiver(clean.samples.rate_hz)
    state = ReceiverState()
    sizes = []
    for second in range(5):
        part = clean.planes[:, int(second * 2.6e6) : int((second + 1) * 2.6e6)]
        _, state = receiver.step(state, part)
        sizes.append(state.tail.shape[-1])
    assert max(sizes) < 8000
    assert "lost" in {f.name for f in fields(state)}


def test_letters_go_on_after_z():
    assert [letter(n) for n in (0, 1, 25, 26, 27, 701, 702)] == ["a", "b", "z", "aa", "ab", "zz", "aaa"]


# ---------------------------------------------------------------------- half cycles


def wrap_cycles(cycles):
    return cycles - np.rint(cycles)


@pytest.fixture(scope="module")
def pair():
    """Render two receivers 60 m apart, from two seconds before a subframe on."""
    front_end = FrontEnd(rate_hz=2_600_000, encoding="sign-magnitude", bits=2)
    scenario = scenes.make_clean(PLACE, START, duration_s=4.2, receivers=2, mask_deg=25.0, front_end=front_end, seed=3)
    return [Rendered(scenario, receiver) for receiver in (0, 1)]


def find_carrier_errors_cyc(rendered, o):
    return o.carrier_cyc - 1575.42e6 * find_truth(rendered, o)[2]


def test_double_differences_are_whole_cycles_off_the_truth(pair):
    received = [make_observations(rendered, *receive(rendered, [])) for rendered in pair]
    a, b = (find_carrier_errors_cyc(rendered, o) for rendered, o in zip(pair, received, strict=True))
    assert [o.signals for o in received] == [received[0].signals] * 2
    assert len(received[0].signals) > 4
    double = (a - b)[8:] - (a - b)[8:, :1]
    assert np.isfinite(double).all()
    assert np.abs(wrap_cycles(double)).max() < 0.05
    assert not any(o.half_cycle_open.any() for o in received)


def test_a_half_cycle_turn_is_a_slip_and_right_on_both_sides(clean, track):
    # All samples inverted from 6.53 s on: no loop notices, but the data bits do.
    turned = Rendered.__new__(Rendered)
    turned.__dict__ |= clean.__dict__
    turned.planes = clean.planes[:, : int(10.1 * 2.6e6)].copy()
    turned.planes[:, int(6.53 * 2.6e6) :] *= -1.0
    o = make_observations(turned, *receive(turned, []))
    before, after = o.elapsed_s < 6.5, o.elapsed_s > 6.6
    moved = o.carrier_cyc - make_observations(clean, *track).carrier_cyc[: o.elapsed_s.size]
    good = np.isfinite(moved) & ~o.half_cycle_open
    np.testing.assert_allclose(wrap_cycles(moved[before][good[before]]), 0.0, atol=0.01)
    np.testing.assert_allclose(np.abs(wrap_cycles(moved[after][good[after]])), 0.5, atol=0.01)
    for column in range(len(o.signals)):
        slipped = np.flatnonzero(o.status[:, column] == 3)
        assert 6.0 < o.elapsed_s[slipped[0]] <= 6.6 <= o.elapsed_s[slipped[-1]] < 7.2
        assert set(np.flatnonzero(o.half_cycle_open[:, column])) <= set(slipped)
