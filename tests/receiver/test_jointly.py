"""A receiver that follows signals of one satellite jointly: what it measures of them, and that nothing else changes."""

from dataclasses import replace

import numpy as np
import pytest
from tests.receiver.test_pairs import waves

from skyproof.gnss.signals import GPS_L1_CA
from skyproof.receiver import joining
from skyproof.receiver import measurement as m
from skyproof.receiver.measurement import Measurements
from skyproof.receiver.tracking import Receiver, ReceiverSettings, ReceiverState

RATE_HZ, SAT = waves.RATE_HZ, waves.SAT
JOINT = ReceiverSettings(sats=(SAT,), joint=True)


def received(cell, begin_s, end_s, seconds, settings, *, seed=1, between=None):
    """Measurements, arcs, a pair of waves, the second of which is there for a while, and what joint channels said.

    between : time, and what is done then.
    """
    rng = np.random.default_rng(seed)
    pair = waves.pair_of(rng, cell, begin_s, 0.5 * (begin_s + end_s), seconds)
    receiver, state, parts, arcs, said = Receiver(RATE_HZ, 0.0, settings), ReceiverState(), [], {}, []
    n = round(0.1 * RATE_HZ)
    for block in range(round(seconds / 0.1)):
        if between is not None and block == round(between[0] / 0.1):
            between[1]()
        planes = waves.noise(rng, n)
        for wave in pair if begin_s <= 0.1 * block < end_s else pair[:1]:
            waves.add(wave, block * n, planes)
        output, state = receiver.step(state, planes)
        parts.append(output.measurements)
        arcs |= output.arcs
        said += output.components
    return Measurements.joined(parts), arcs, pair, said


def errors(measured, arcs, wave, copy):
    """Time, code's error over its sigma, and carrier's error (cycles) of a signal's rows."""
    rows = np.array([arcs[int(arc)].signal.copy == copy for arc in measured.arc])
    t_s, table = measured.elapsed_s[rows], measured.table[rows]
    shown_s = table[:, m.PERIODS] * GPS_L1_CA.period_s + table[:, m.FRACTION_S]
    off_s = (shown_s - wave.sent_s(t_s) + 0.5e-3) % 1e-3 - 0.5e-3
    carrier_cyc = table[:, m.CARRIER_CYC] + wave.doppler_hz * t_s
    return t_s, off_s / table[:, m.CODE_SIGMA_S], carrier_cyc - carrier_cyc[-1], table[:, m.SLIP]


def test_what_comes_beside_a_signal_and_goes_again_is_a_signal_of_its_own_in_between():
    cell = waves.Cell(apart_chips=0.5, relative_db=-3.0, apart_hz=3.0)
    measured, arcs, (first, second), _ = received(cell, 2.4, 4.6, 6.6, JOINT)
    assert {arc.signal.copy for arc in arcs.values()} == {"a", "b"}
    t_s, code, carrier_cyc, slip = errors(measured, arcs, second, "b")
    inside = t_s < 4.45
    assert t_s[0] < 4.0
    np.testing.assert_allclose(np.diff(t_s[inside]), 0.2)  # row by row
    assert np.sqrt(np.mean(code[inside] ** 2)) < 1.6
    assert np.ptp(carrier_cyc[inside]) < 0.1
    assert not slip[inside].any()
    came_s = t_s[0]
    t_s, code, carrier_cyc, slip = errors(measured, arcs, first, "a")
    led = (t_s >= came_s) & (t_s < 4.45)
    assert np.sqrt(np.mean(code[led] ** 2)) < 1.6
    # Its carrier goes on through what comes and goes; where it may have slipped, that is said.
    late = t_s >= came_s
    np.testing.assert_allclose(np.diff(t_s[late]), 0.2)
    steps = np.abs(np.diff(carrier_cyc[late]))
    assert np.all((steps < 0.12) | (slip[late][1:] > 0.0))
    assert np.sum(slip[late]) <= 2
    assert np.abs(code[t_s > 6.2]).max() < 5.0


@pytest.mark.parametrize(
    ("cell", "begin_s"),
    [
        (waves.Cell(apart_chips=0.5, relative_db=6.0, apart_hz=2.0), 2.0),
        # Between two carriers of some tens of hertz a loop locks on neither and would be let go.
        (waves.Cell(apart_chips=0.3, relative_db=8.0, apart_hz=40.0), 2.1),
    ],
)
def test_a_signal_that_is_overpowered_at_once_keeps_its_letter_and_its_arc(cell, begin_s):
    measured, arcs, (first, second), _ = received(cell, begin_s, 9.0, begin_s + 1.6, JOINT)
    assert sorted(arc.signal.copy for arc in arcs.values()) == ["a", "b"]
    for wave, copy in ((first, "a"), (second, "b")):
        t_s, code, _, _ = errors(measured, arcs, wave, copy)
        assert np.sum(t_s > 2.9) >= 3
        assert np.abs(code[t_s > 2.9]).max() < 4.5


def test_the_side_lobes_of_a_signal_chips_away_are_no_signals():
    cell = waves.Cell(apart_chips=8.0, relative_db=6.0, apart_hz=50.0)
    _, arcs, _, _ = received(cell, 2.0, 9.0, 3.4, replace(JOINT, joint_look_s=0.4))
    assert sorted(arc.signal.copy for arc in arcs.values()) == ["a", "b"]


def test_signals_that_part_go_on_with_loops_of_their_own_without_a_seam(monkeypatch):
    cell = waves.Cell(apart_chips=1.2, relative_db=0.0, apart_hz=45.0)

    def part():
        monkeypatch.setattr(joining, "PARTED_CHIPS", 0.6)
        monkeypatch.setattr(joining, "TOGETHER_CHIPS", 0.6)

    measured, arcs, pair, _ = received(cell, 2.4, 9.0, 5.2, JOINT, between=(4.2, part))
    assert {arc.signal.copy for arc in arcs.values()} == {"a", "b"}
    for wave, copy in zip(pair, "ab", strict=True):
        t_s, code, carrier_cyc, slip = errors(measured, arcs, wave, copy)
        late = t_s > 3.5
        np.testing.assert_allclose(np.diff(t_s[late]), 0.2)
        assert not slip[late].any()
        assert np.ptp(carrier_cyc[late]) < 0.15
        assert np.abs(code[t_s < 4.1][-3:]).max() < 4.5


def test_a_clean_sky_is_measured_as_without():
    cell = waves.Cell(apart_chips=0.5, relative_db=0.0, apart_hz=0.0)
    often = replace(JOINT, joint_look_s=0.4)
    (joint, _, _, said), (plain, *_) = (
        received(cell, 9.0, 9.0, 3.6, one) for one in (often, ReceiverSettings(sats=(SAT,)))
    )
    assert len(said) >= 2  # it was looked for others
    assert len(joint) > 8
    np.testing.assert_array_equal(joint.table, plain.table)
    np.testing.assert_array_equal(joint.arc, plain.arc)
