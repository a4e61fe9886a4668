"""Several antennas of one receiver, against the simulator's truth."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.receiver.conftest import PLACE, START

from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.receiver import kernels as k
from skyproof.receiver import measurement as m
from skyproof.receiver.antennas import compute_weights, unwrap_phases
from skyproof.receiver.measurement import Measurements
from skyproof.receiver.observables import assemble_array_phases
from skyproof.receiver.tracking import Receiver, ReceiverSettings, ReceiverState
from skyproof.records import AntennaArray
from skyproof.simulator.samples import render_samples
from skyproof.simulator.scenario import FrontEnd, Scenario
from skyproof.simulator.sky import make_scene

ELEMENTS_M = ((0.0, 0.0, 0.0), (0.19, 0.0, 0.0), (0.095, 0.165, 0.0))
LINE_BIAS_CYC = (0.0, 0.21, -0.34)
RATE_HZ = 2_600_000


class Array:
    """5 s of clean sky on three antennas with lines of different lengths, in memory."""

    def __init__(self) -> None:
        antennas = [
            {"name": str(number), "body_m": place, "line_bias_cyc": bias}
            for number, (place, bias) in enumerate(zip(ELEMENTS_M, LINE_BIAS_CYC, strict=True))
        ]
        receiver = {"name": "array", **PLACE.model_dump(), "heading_deg": 30.0, "lo_ppm": 0.4, "antennas": antennas}
        scenario = Scenario(
            start_gpst=START,
            duration_s=5.0,
            mask_deg=10.0,
            sky={
                "zenith_cn0_dbhz": 43.0,
                "horizon_cn0_dbhz": 40.0,
            },  # stronger ones disturb each other beside the noise
            receivers=[receiver],
            front_end=FrontEnd(rate_hz=RATE_HZ, bandwidth_hz=2.1e6, encoding="int", bits=8),
        )
        navigation = make_nominal_constellation(START)
        self.skies = make_scene(scenario, navigation).skies
        self.planes = np.stack([plane.read(0, plane.n_samples) for plane in render_samples(scenario, navigation)])

    def find_carrier_cyc(self, antenna, sat, elapsed_s):
        """Return the true accumulated carrier phase, but for what all antennas and satellites share."""
        sky = self.skies[antenna]
        true_s = elapsed_s + sky.true_minus_elapsed_s(elapsed_s)
        column = [received.id.sat for received in sky.signals].index(sat)
        return 1575.42e6 * (sky.carrier_delay_s(true_s)[:, column] - sky.true_minus_elapsed_s(elapsed_s))

    def find_code_m(self, antenna, sat, elapsed_s):
        sky = self.skies[antenna]
        true_s = elapsed_s + sky.true_minus_elapsed_s(elapsed_s)
        column = [received.id.sat for received in sky.signals].index(sat)
        return SPEED_OF_LIGHT_M_S * (sky.code_delay_s(true_s)[:, column] - sky.true_minus_elapsed_s(elapsed_s))


def receive(planes, cuts=()):
    receiver, state, parts, arcs = Receiver(RATE_HZ), ReceiverState(), [], {}
    for piece in np.split(planes, cuts, axis=-1):
        output, state = receiver.step(state, piece)
        parts.append(output.measurements)
        arcs |= output.arcs
    return Measurements.join(parts), arcs


@pytest.fixture(scope="module")
def array():
    return Array()


@pytest.fixture(scope="module")
def track(array):
    return receive(array.planes)


def normalize_differences(array, measurements, arcs, antennas):
    """Divide errors of phase differences against the first of `antennas` by their sigmas; also per signal."""
    first, *other_antennas = antennas
    for number, arc in arcs.items():
        rows = measurements.arc == number
        antenna_rows, at_s = measurements.own[rows], measurements.elapsed_s[rows]
        for other in other_antennas:
            sat = arc.signal.sat
            true_cyc = array.find_carrier_cyc(first, sat, at_s) - array.find_carrier_cyc(other, sat, at_s)
            error = antenna_rows[:, other, m.OWN_PHASE_CYC] - antenna_rows[:, first, m.OWN_PHASE_CYC] - true_cyc
            sigma = np.hypot(
                antenna_rows[:, other, m.OWN_PHASE_SIGMA_CYC], antenna_rows[:, first, m.OWN_PHASE_SIGMA_CYC]
            )
            yield (error - np.rint(np.nanmedian(error))) / sigma


@pytest.mark.long
def test_phases_differ_by_the_direction_with_the_noise_stated(array, track):
    ratios = np.concatenate(list(normalize_differences(array, *track, [0, 1, 2])))
    assert ratios.size > 300
    assert np.isfinite(ratios).all()
    assert 0.8 < np.mean(ratios**2) < 1.2


@pytest.mark.long
def test_the_sum_is_stronger_by_the_number_of_antennas(track):
    measurements, _ = track
    gain_db = measurements.column(m.CN0_DBHZ)[:, None] - measurements.own[..., m.OWN_CN0_DBHZ]
    assert np.median(gain_db) == pytest.approx(10.0 * np.log10(3.0), abs=0.3)


@pytest.mark.long
def test_code_and_carrier_on_each_antenna_are_true(array, track):
    measurements, arcs = track
    spreads = []
    for antenna in range(3):
        on_one = measurements.on_antenna(antenna)
        for number, arc in arcs.items():
            part = on_one.select((on_one.arc == number) & (on_one.elapsed_s > 1.5))
            at_s, sat = part.elapsed_s, arc.signal.sat
            carrier = part.column(m.CARRIER_CYC) - array.find_carrier_cyc(antenna, sat, at_s)
            assert np.abs(carrier - np.median(carrier)).max() < 0.06
            assert part.column(m.SLIP).max() == 0.0
            shown_s = part.column(m.PERIODS) * 1e-3 + part.column(m.FRACTION_S)
            range_m = SPEED_OF_LIGHT_M_S * (at_s - shown_s)  # but for the time of transmission of the first period
            error_m = range_m - array.find_code_m(antenna, sat, at_s)
            spreads.append(np.std(error_m) / np.mean(part.column(m.CODE_SIGMA_S)) / SPEED_OF_LIGHT_M_S)
    assert 0.8 < np.sqrt(np.mean(np.square(spreads))) < 1.2


@pytest.mark.long
def test_pieces_give_what_the_whole_gives(array, track):
    whole, whole_arcs = track
    pieces, arcs = receive(array.planes, [1, 260_000, 3_333_333])
    assert arcs.keys() == whole_arcs.keys()
    for name in ("elapsed_s", "arc", "table", "taps", "own"):
        assert np.array_equal(getattr(pieces, name), getattr(whole, name), equal_nan=True)


def test_looks_of_the_first_antenna_are_those_that_it_has_alone(array):
    planes = array.planes[..., : 2 * RATE_HZ]
    powers = []
    for part in (planes, planes[0]):
        output, _ = Receiver(RATE_HZ, settings=ReceiverSettings(looks_per_frame=5, look_share=0.2)).step(
            ReceiverState(), part
        )
        measured = output.measurements.select(output.measurements.elapsed_s > 1.0)
        power = measured.first_power if part.ndim == 3 else np.abs(measured.taps[..., 1]) ** 2
        assert power.shape[1] == 10
        powers.append({output.arcs[n].signal.sat: np.nanmean(power[measured.arc == n]) for n in set(measured.arc)})
    several, alone = powers
    both = several.keys() & alone.keys()
    assert len(both) > 3
    for sat in both:
        assert several[sat] == pytest.approx(alone[sat], rel=0.1)


@pytest.mark.long
def test_an_antenna_that_fades_does_not_lose_the_array(array, track):
    planes = array.planes.copy()
    faded = int(2.05 * RATE_HZ)
    planes[0, :, faded:] = np.rint(24.0 * np.random.default_rng(1).normal(size=planes[0, :, faded:].shape))
    measurements, arcs = receive(planes)
    assert {arc.signal for arc in arcs.values()} == {arc.signal for arc in track[1].values()}
    assert len(arcs) == len(track[1])  # none ended and began anew
    later = measurements.select(measurements.elapsed_s > 2.3)
    assert np.isfinite(later.own[:, 0, m.OWN_PHASE_CYC]).mean() < 0.01
    ratios = np.concatenate(list(normalize_differences(array, later, arcs, [1, 2])))
    assert 0.75 < np.mean(ratios**2) < 1.25


@pytest.mark.long
def test_signals_are_found_with_a_dead_first_antenna(array, track):
    planes = array.planes[..., : 3 * RATE_HZ].copy()
    planes[0] = 0.0
    measurements, arcs = receive(planes)
    assert {arc.signal.sat for arc in arcs.values()} == {arc.signal.sat for arc in track[1].values()}
    assert {arc.found_s for arc in arcs.values()} == {0.0}  # antennas that give nothing are not searched
    assert np.isnan(measurements.own[:, 0, m.OWN_PHASE_CYC]).all()
    ratios = np.concatenate(list(normalize_differences(array, measurements, arcs, [1, 2])))
    assert 0.75 < np.mean(ratios**2) < 1.25


@pytest.mark.long
def test_delays_of_the_lines_are_taken_off_where_they_are_known(array, track):
    measurements, arcs = track
    elapsed_s = 0.2 * np.arange(1, 25)
    gpst = START + (elapsed_s * 1e9).astype("timedelta64[ns]")
    elements_m, lines_cyc = np.array(ELEMENTS_M), np.array(LINE_BIAS_CYC)
    unknown, known = (
        assemble_array_phases(
            "array", measurements, arcs, elapsed_s, gpst, array=array, carrier_hz=1575.42e6, averaged_s=0.2
        )
        for array in (AntennaArray(elements_m=elements_m), AntennaArray(elements_m=elements_m, line_bias_cyc=lines_cyc))
    )
    assert known.calibrated
    assert not unknown.calibrated
    measured = np.isfinite(unknown.phase_cyc)
    assert measured[8:].all()
    off = (known.phase_cyc - unknown.phase_cyc)[measured].reshape(-1, 3)
    assert np.allclose(off, LINE_BIAS_CYC)
    for column, signal in enumerate(known.signals):
        true_cyc = -array.find_carrier_cyc(1, signal.sat, elapsed_s) + array.find_carrier_cyc(0, signal.sat, elapsed_s)
        error = known.phase_cyc[:, column, 1] - known.phase_cyc[:, column, 0] - true_cyc - LINE_BIAS_CYC[1]
        assert np.nanmedian(np.abs(error - np.rint(error))) < 0.01


@given(st.integers(0, 2**32 - 1), st.integers(2, 5))
def test_weights_find_the_best_sum_and_do_not_turn_it(seed, n_antennas):
    rng = np.random.default_rng(seed)
    power = rng.uniform(0.1, 10.0, n_antennas)
    gain = rng.normal(size=n_antennas) + 1j * rng.normal(size=n_antennas)
    data = rng.choice([-1.0, 1.0], (1, 30, 1)) * np.exp(1j * rng.uniform(0, 7))
    prompts = gain * data
    rows = np.zeros((1, 40, k.row_size(3, n_antennas)))
    antenna_sums = rows[:, :30, k.row_size(3, 1) :].reshape(1, 30, n_antennas, 3, 2)
    antenna_sums[..., 1, 0], antenna_sums[..., 1, 1] = prompts.real, prompts.imag
    rows[:, :30, k.row_size(3, 1) :] = antenna_sums.reshape(1, 30, -1)
    before = rng.normal(size=(1, n_antennas, 2))
    weights = compute_weights(rows, before, power)
    turned, old = weights[..., 0] + 1j * weights[..., 1], before[..., 0] + 1j * before[..., 1]
    assert np.sum(np.abs(turned) ** 2 * power) == pytest.approx(power.max())
    best = gain / power
    share = np.abs(np.vdot(best, turned[0])) / np.linalg.norm(best) / np.linalg.norm(turned)
    assert share == pytest.approx(1.0)
    was, now = prompts[0] @ old[0].conj(), prompts[0] @ turned[0].conj()
    assert np.allclose(np.angle(now / was), 0.0, atol=1e-9)


@given(st.floats(-2.0, 2.0), st.floats(-20.0, 20.0), st.integers(-3, 3))
def test_phases_go_on_over_whole_cycles(rate_hz, start_cyc, turns):
    true = np.array([start_cyc, start_cyc + 0.2 * rate_hz])
    antenna_rows = np.zeros((2, 1, 1, m.N_OWN))
    antenna_rows[:, 0, 0, m.OWN_PHASE_CYC] = true - np.rint(true) + np.array([0, turns])
    antenna_rows[..., m.OWN_DOPPLER_HZ], antenna_rows[..., m.OWN_PHASE_SIGMA_CYC] = rate_hz, 0.002
    good = np.array([True])
    last = unwrap_phases(antenna_rows[0], np.full((1, 1, 3), np.nan), good, 0.2)
    assert antenna_rows[0, 0, 0, m.OWN_SLIP] == 1.0  # from nothing
    unwrap_phases(antenna_rows[1], last, good, 0.2)
    moved = antenna_rows[1, 0, 0, m.OWN_PHASE_CYC] - antenna_rows[0, 0, 0, m.OWN_PHASE_CYC]
    assert moved == pytest.approx(0.2 * rate_hz, abs=1e-9)
    assert antenna_rows[1, 0, 0, m.OWN_SLIP] == 0.0


def test_a_phase_too_noisy_to_count_cycles_is_a_slip():
    antenna_rows = np.zeros((1, 1, m.N_OWN))
    antenna_rows[..., m.OWN_PHASE_SIGMA_CYC] = 0.07
    last = np.array([[[0.0, 0.0, 0.07]]])
    unwrap_phases(antenna_rows, last, np.array([True]), 0.2)
    assert antenna_rows[0, 0, m.OWN_SLIP] == 1.0
