"""What must hold for every recording: pieces make the whole, and damage costs what is damaged and no more."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skyproof.gnss.constants import L1_HZ, SPEED_OF_LIGHT_M_S
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.receiver import measurement as m
from skyproof.receiver.measurement import Measurements
from skyproof.receiver.tracking import Receiver, ReceiverSettings, ReceiverState
from skyproof.simulator import FrontEnd, ScenePlace, make_clean, render_samples

START = np.datetime64("2024-03-03T11:59:58", "ns")
RATE_HZ = 2_600_000
DURATION_S = 8.0
DAMAGED_S = 4.03
PULL_IN_S = 2.0
"""From the first sample on: until then a channel's loops change, and with them what its noise is."""
RECOVERY_S = 0.6
"""After a short damage: a loop of 1 Hz has forgotten it to 1 %, and epochs average 0.4 s."""
BACK_S = 2.5
"""After a loss of lock: half a second to notice it, as much to the next search, 0.8 s to confirm, and an epoch."""
FOUND_AGAIN_S = 3.0
"""After samples that are missing: as much, and half a second in which it may be a fade."""


class Heard:
    """What came out of the receiver: a row an epoch and signal, by signal."""

    def __init__(self, parts, arcs, gaps):
        self.table = Measurements.join(parts)
        self.gaps = gaps
        self.arcs = arcs
        self.signals = {str(arc.signal) for arc in arcs.values()}
        self.names = np.array([str(arcs[number].signal) for number in self.table.arc.tolist()])

    def read_column(self, signal, name):
        """Read epochs in tenths of a second, and one column of the table."""
        mine = self.names == signal
        return np.rint(self.table.elapsed_s[mine] * 10).astype(int), self.table.table[mine, name]

    def read_code_s(self, signal):
        tenths, periods = self.read_column(signal, m.PERIODS)
        return tenths, periods * 1e-3 + self.read_column(signal, m.FRACTION_S)[1]


@pytest.fixture(scope="module")
def planes():
    """Render a clean sky of the five highest satellites to two-bit samples."""
    scenario = make_clean(
        ScenePlace(lat_deg=48.1, lon_deg=11.6, height_m=500.0),
        START,
        duration_s=DURATION_S,
        zenith_cn0_dbhz=48.0,
        horizon_cn0_dbhz=44.0,
        receivers=1,
        mask_deg=35.0,
        seed=3,
        front_end=FrontEnd(rate_hz=RATE_HZ, encoding="sign-magnitude", bits=2),
    )
    samples = render_samples(scenario, make_nominal_constellation(START))[0]
    return samples.read(0, samples.n_samples)


@pytest.fixture(scope="module")
def receiver(planes):
    """Make a receiver that searches for the satellites in view and two others; whole searches are elsewhere."""
    state, output = ReceiverState(), None
    finder = Receiver(RATE_HZ)
    output, state = finder.step(state, planes[:, : int(1.5 * RATE_HZ)])
    tracked_sats = {arc.signal.sat for arc in output.arcs.values()}
    absent = [sat for sat in finder.settings.sats if sat not in tracked_sats][:2]
    sats = tuple(sorted({*tracked_sats, *absent}))
    looks = {"further_taps_chips": (0.5, -0.5), "looks_per_frame": 5, "look_share": 0.2}
    return Receiver(RATE_HZ, settings=ReceiverSettings(sats=sats, **looks))


def receive(receiver, planes, cuts=()):
    state, parts, arcs, gaps = ReceiverState(), [], {}, []
    for first, end in pairwise([0, *cuts, planes.shape[1]]):
        output, state = receiver.step(state, planes[:, first:end])
        parts.append(output.measurements)
        arcs |= output.arcs
        gaps += output.gaps
    return Heard(parts, arcs, gaps)


@pytest.fixture(scope="module")
def whole(receiver, planes):
    heard = receive(receiver, planes)
    assert len(heard.signals) >= 4
    assert all(name.endswith(" a") for name in heard.signals)
    return heard


# ---------------------------------------------------------------- pieces


def assert_same(heard, whole):
    """Check that measurements, taps, and their owners are the same to the last bit."""
    assert heard.signals == whole.signals
    np.testing.assert_array_equal(heard.names, whole.names)
    np.testing.assert_array_equal(heard.table.elapsed_s, whole.table.elapsed_s)
    np.testing.assert_array_equal(heard.table.table, whole.table.table)
    np.testing.assert_array_equal(heard.table.taps, whole.table.taps)


CUTS = st.lists(st.integers(0, int(DURATION_S * RATE_HZ)), max_size=12).map(sorted)  # empty pieces too


@settings(max_examples=2, deadline=None, derandomize=True)
@given(cuts=CUTS)
def test_pieces_equal_the_whole_at_any_cut(receiver, planes, whole, cuts):
    assert_same(receive(receiver, planes, cuts), whole)


@pytest.mark.long
@settings(max_examples=100, deadline=None)
@given(cuts=CUTS)
def test_pieces_equal_the_whole_at_any_of_many_cuts(receiver, planes, whole, cuts):
    assert_same(receive(receiver, planes, cuts), whole)


@pytest.mark.parametrize("block", [pytest.param(2_601, marks=pytest.mark.long), 777_777])
def test_any_block_size_gives_the_same_observables(receiver, planes, whole, block):
    assert_same(receive(receiver, planes, range(block, planes.shape[1], block)), whole)


# ---------------------------------------------------------------- damage


def find_differences(heard, whole, signal, tenths_from, tenths_to):
    """Subtract over the epochs of both: code in sigmas, carrier in cycles modulo a half, Doppler in Hz.

    The middle of the carriers' differences is taken off.
    """
    (at, code_s), (at_whole, code_whole_s) = heard.read_code_s(signal), whole.read_code_s(signal)
    _, mine, theirs = np.intersect1d(at, at_whole, return_indices=True)
    inside = (at[mine] >= tenths_from) & (at[mine] < tenths_to)
    mine, theirs = mine[inside], theirs[inside]
    sigma_s = whole.read_column(signal, m.CODE_SIGMA_S)[1][theirs]
    code = (code_s[mine] - code_whole_s[theirs]) / sigma_s
    carrier_cyc = (
        heard.read_column(signal, m.CARRIER_CYC)[1][mine] - whole.read_column(signal, m.CARRIER_CYC)[1][theirs]
    )
    doppler_hz = heard.read_column(signal, m.DOPPLER_HZ)[1][mine] - whole.read_column(signal, m.DOPPLER_HZ)[1][theirs]
    return code, carrier_cyc, doppler_hz


def list_epochs(whole, signal, tenths_from, tenths_to):
    at, _ = whole.read_code_s(signal)
    return int(((at >= tenths_from) & (at < tenths_to)).sum())


def assert_only_that_is_lost(heard, whole, damaged_to_s, recovery_s):
    """Check that every bit before the damage is the same, and that all is back after it, within the noise."""
    # The epoch at t uses samples to t + 0.1 s, and the frame that decides on it ends there.
    before, after = int((DAMAGED_S - 0.1) * 10), int(np.ceil((damaged_to_s + recovery_s) * 10))
    assert heard.signals == whole.signals
    for signal in whole.signals:
        code, carrier_cyc, doppler_hz = find_differences(heard, whole, signal, 0, before + 1)
        assert code.size == list_epochs(whole, signal, 0, before + 1)
        assert not code.any()
        assert not carrier_cyc.any()
        assert not doppler_hz.any()
        code, carrier_cyc, doppler_hz = find_differences(heard, whole, signal, after, 10_000)
        assert code.size == list_epochs(whole, signal, after, 10_000) > 3
        assert np.abs(code).max() < 3.0  # the noise is that of the same samples
        assert np.abs(2.0 * carrier_cyc - np.rint(2.0 * carrier_cyc)).max() < 0.04
        assert np.ptp(carrier_cyc) < 0.02
        assert np.abs(doppler_hz).max() < 0.2


def damage_samples(planes, kind, duration_s, rng):
    first, end = int(DAMAGED_S * RATE_HZ), int((DAMAGED_S + duration_s) * RATE_HZ)
    out = planes.copy()
    stretch = out[:, first:end]
    if kind == "zeros":
        stretch[:] = 0.0
    elif kind == "noise":
        stretch[:] = rng.choice(planes[0, :1000], stretch.shape)
    else:
        stretch[rng.random(stretch.shape) < 0.2] *= -1.0  # the sign bit of one number in five
    return out


@pytest.mark.parametrize("kind", ["zeros", "noise", "flipped bits"])
def test_twenty_damaged_milliseconds_cost_the_epochs_around_them(receiver, planes, whole, kind):
    out = damage_samples(planes, kind, 0.02, np.random.default_rng(5))
    heard = receive(receiver, out)
    assert_only_that_is_lost(heard, whole, DAMAGED_S + 0.02, RECOVERY_S)


@pytest.mark.long
def test_flipped_bits_for_half_a_second_cost_strength_only(receiver, planes, whole):
    heard = receive(receiver, damage_samples(planes, "flipped bits", 0.5, np.random.default_rng(6)))
    assert_only_that_is_lost(heard, whole, DAMAGED_S + 0.5, RECOVERY_S)
    for signal in whole.signals:
        at, cn0_dbhz = heard.read_column(signal, m.CN0_DBHZ)
        # 1 - 2 * 0.2 of the amplitude is 4.4 dB; the epoch stands for 0.2 s before and 0.1 s after it or more.
        assert cn0_dbhz[at == 44] < cn0_dbhz[at == 38] - 1.0


@pytest.mark.parametrize("kind", [pytest.param("zeros", marks=pytest.mark.long), "noise"])
def test_a_second_without_signals_costs_itself_and_the_way_back(receiver, planes, whole, kind):
    heard = receive(receiver, damage_samples(planes, kind, 1.0, np.random.default_rng(7)))
    # Its loops coasted: every arc goes on, with its time of week, and nothing is said to be missing.
    assert heard.gaps == []
    assert heard.arcs.keys() == whole.arcs.keys()
    for number, arc in heard.arcs.items():
        assert arc.signal == whole.arcs[number].signal
        assert arc.tow_ms_at_period_0 == whole.arcs[number].tow_ms_at_period_0 is not None
    for signal in whole.signals:
        at, _ = heard.read_code_s(signal)
        back = int(np.ceil((DAMAGED_S + 1.0 + BACK_S) * 10))
        assert (at >= back).sum() == list_epochs(whole, signal, back, 10_000) > 0
        code, _, doppler_hz = find_differences_modulo_ms(heard, whole, signal, back, 0.0)
        assert np.abs(code).max() < 5.0
        assert np.abs(doppler_hz).max() < 1.0


# ---------------------------------------------------------------- missing samples


def find_differences_modulo_ms(heard, whole, signal, tenths_from, missing_s):
    """Subtract as `find_differences` for a channel that counts its code periods again, `missing_s` later."""
    (at, code_s), (at_whole, code_whole_s) = heard.read_code_s(signal), whole.read_code_s(signal)
    _, mine, theirs = np.intersect1d(at, at_whole, return_indices=True)
    mine, theirs = mine[at[mine] >= tenths_from], theirs[at[mine] >= tenths_from]
    doppler_whole_hz = whole.read_column(signal, m.DOPPLER_HZ)[1][theirs]
    expected_s = code_whole_s[theirs] + missing_s * (1.0 + doppler_whole_hz / L1_HZ)
    apart_s = code_s[mine] - expected_s
    apart_s -= 1e-3 * np.rint(apart_s * 1e3)
    sigma_s = whole.read_column(signal, m.CODE_SIGMA_S)[1][theirs]
    doppler_hz = heard.read_column(signal, m.DOPPLER_HZ)[1][mine] - doppler_whole_hz
    return apart_s / sigma_s, apart_s * SPEED_OF_LIGHT_M_S, doppler_hz


HALF_A_BIT = pytest.param(26_000, marks=pytest.mark.long)


@pytest.mark.parametrize(
    "missing", [pytest.param(997, marks=pytest.mark.long), HALF_A_BIT, pytest.param(123_457, marks=pytest.mark.long)]
)
def test_missing_samples_cost_the_way_back_and_no_letter(receiver, planes, whole, missing):
    # Signals are lost and found again, each under its name, at its new delay.
    # 997 samples are 392 chips; 26 000 are ten code periods to the sample, which no code loop can notice.
    first = int(DAMAGED_S * RATE_HZ)
    heard = receive(receiver, np.delete(planes, slice(first, first + missing), axis=1))
    assert heard.signals == whole.signals
    back = int(np.ceil((DAMAGED_S + FOUND_AGAIN_S) * 10))
    for signal in whole.signals:
        at, _ = heard.read_code_s(signal)
        expected = list_epochs(whole, signal, back, int((DURATION_S - missing / RATE_HZ) * 10))
        assert (at >= back).sum() >= expected - 1 > 0
        code, _, doppler_hz = find_differences_modulo_ms(heard, whole, signal, back, missing / RATE_HZ)
        assert np.abs(code).max() < 5.0
        assert np.abs(doppler_hz).max() < 1.0


@pytest.mark.parametrize("missing", [997, pytest.param(123_457, marks=pytest.mark.long)])
def test_missing_samples_are_reported_as_one_gap_of_their_length(receiver, planes, whole, missing):
    first = int(DAMAGED_S * RATE_HZ)
    heard = receive(receiver, np.delete(planes, slice(first, first + missing), axis=1))
    assert all(DAMAGED_S - 0.2 <= gap.elapsed_s <= DAMAGED_S + BACK_S for gap in heard.gaps)
    (gap,) = (gap for gap in heard.gaps if gap.shift_s != 0.0)  # before it, the carriers' jump may show the same
    assert gap.signals >= 3
    off_s = gap.shift_s + missing / RATE_HZ  # the code comes earlier by what is missing
    assert abs(off_s - 1e-3 * np.rint(off_s * 1e3)) < 0.2 / 1.023e6


def test_a_whole_recording_has_no_gap(whole):
    assert whole.gaps == []
