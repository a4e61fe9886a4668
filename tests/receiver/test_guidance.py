"""Guided loops: the replica follows the guide, and closes without it once the guide has lapsed."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from skyproof.gnss.signals import GPS_L1_CA
from skyproof.receiver import guidance as g
from skyproof.receiver import kernels as k

RATE_HZ, IF_HZ, FRAME_S = 2.6e6, 1000.0, 0.1


def make_loop(doppler_hz=1200.0, periods=5000, chip=0.1, own_hz=None):
    """Make a channel (1, N_STATE) whose next period begins at 5 s."""
    loops = np.zeros((1, k.N_STATE))
    loops[0, k.START] = 5.0 * RATE_HZ
    loops[0, [k.PERIODS, k.CHIP]] = periods, chip
    loops[0, k.PLL_VELOCITY] = doppler_hz if own_hz is None else own_hz
    loops[0, k.FREQUENCY] = IF_HZ + loops[0, k.PLL_VELOCITY]
    loops[0, k.CODE_RATE] = GPS_L1_CA.chip_rate_hz
    loops[0, k.DLL_BANDWIDTH] = 1.0
    return loops


def make_guide(away_chips=0.0, doppler_hz=1200.0, until_s=5.5, **columns):
    """Make guidance for that channel: what is received is ahead of the replica by so much at 5 s."""
    row = np.full((1, g.N_GUIDE), np.nan)
    row[0, [g.AT_S, g.DOPPLER_HZ, g.CORRECTION_HZ, g.UNTIL_S]] = 4.8, doppler_hz, 0.0, until_s
    shown_s = (5000 + 0.1 / 1023) * 1e-3 + away_chips / GPS_L1_CA.chip_rate_hz
    row[0, g.SENT_S] = shown_s - 0.2 * (1.0 + doppler_hz / GPS_L1_CA.carrier_hz)
    for column, value in columns.items():
        row[0, getattr(g, column)] = value
    return row


def guide_loop_rows(loops, guides, unseen=False, now_s=5.0):
    return g.guide_loops(
        loops,
        guides,
        np.array([unseen]),
        now_s,
        frame_s=FRAME_S,
        rate_hz=RATE_HZ,
        if_hz=IF_HZ,
        signal=GPS_L1_CA,
    )


@given(
    away_chips=st.floats(-0.4, 0.4),
    doppler_hz=st.floats(-5e3, 5e3),
    own_hz=st.floats(-200.0, 200.0),
    unseen=st.booleans(),
)
def test_the_replica_is_where_it_is_predicted_a_frame_later(away_chips, doppler_hz, own_hz, unseen):
    loops, _ = guide_loop_rows(make_loop(own_hz=doppler_hz + own_hz), make_guide(away_chips, doppler_hz), unseen)
    runs_chips = (loops[0, k.CODE_RATE] - GPS_L1_CA.chip_rate_hz * (1.0 + doppler_hz / GPS_L1_CA.carrier_hz)) * FRAME_S
    assert abs(runs_chips - away_chips) < 1e-4
    assert loops[0, k.DLL_BANDWIDTH] == 0.0


def test_an_unseen_carrier_follows_the_prediction():
    for unseen, velocity_hz in ((True, 1300.0), (False, 1200.0)):
        loops, _ = guide_loop_rows(make_loop(), make_guide(doppler_hz=1300.0), unseen)
        assert loops[0, k.PLL_VELOCITY] == velocity_hz
        assert loops[0, k.FREQUENCY] == IF_HZ + velocity_hz


def test_the_carriers_correction_is_half_a_cycle_a_kilohertz():
    loops, _ = guide_loop_rows(make_loop(), make_guide(CORRECTION_HZ=-89.0))
    assert np.isclose(loops[0, k.CARRIER_CORRECTION], -0.0445)


def test_a_guide_lapses_and_leaves_the_loops_to_themselves():
    steered, guides = guide_loop_rows(make_loop(), make_guide(0.2, CORRECTION_HZ=50.0))
    for lapsed in (make_guide(until_s=4.9), g.no_guide()[None]):
        loops, guides_left = guide_loop_rows(steered, lapsed)
        assert loops[0, k.CODE_STEER] == loops[0, k.CARRIER_CORRECTION] == 0.0
        assert np.isnan(guides_left).all()
    assert np.isfinite(guides[0, g.AT_S])


def test_what_loops_show_is_what_a_guide_would_tell_them():
    shown_s, doppler_hz = g.read_loops(make_loop(), 4.8, rate_hz=RATE_HZ, if_hz=IF_HZ, signal=GPS_L1_CA)
    expected = make_guide()[0]
    assert np.isclose(shown_s[0], expected[g.SENT_S], rtol=0.0, atol=1e-12)
    assert doppler_hz[0] == 1200.0
