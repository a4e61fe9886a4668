"""Two signals of one satellite, each measured as if it were alone."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.receiver import antennas
from skyproof.receiver import kernels as k
from skyproof.receiver import measurement as m
from skyproof.receiver.acquisition import Peak
from skyproof.receiver.crosstalk import POINTS, autocorrelate_period, take_out
from skyproof.receiver.measurement import Measurements
from skyproof.receiver.tracking import Receiver, ReceiverSettings, ReceiverState
from skyproof.simulator.ideal import SignalDelays, make_ideal_signals
from skyproof.simulator.samples import BLOCK, render
from skyproof.simulator.scenario import FrontEnd

SAT, PRN = "G05", 5
CODE = GPS_L1_CA.code(PRN)
FRONT_END = FrontEnd(rate_hz=2.6e6, bandwidth_hz=2.08e6, encoding="float", bits=32)
WEAK_DBHZ = 50.0
SETTLED_S, SPREAD_S = 1.2, 2.2
CHIP_S = 1.0 / GPS_L1_CA.chip_rate_hz


def find_step() -> int:
    """Find a lag from which the code's autocorrelation steps from -1/1023 to another value at the next chip."""
    auto = np.rint(np.fft.ifft(np.abs(np.fft.fft(CODE.astype(float))) ** 2).real)
    return int(next(lag for lag in range(20, 900) if auto[lag] == -1 and auto[lag + 1] == 63))


def measure_weaker(apart_chips, stronger_db, apart_hz, *, same_bits=True):
    """Measure errors of the weaker signal: code (m), carrier (cycles), C/N0 (dB), and code's stated sigma (m)."""
    doppler_hz = np.array([-1234.5, -1234.5 + apart_hz])
    middle_s = SETTLED_S + 0.5 * SPREAD_S
    delay_s = 0.07 + np.array([0.0, apart_chips * CHIP_S + apart_hz / GPS_L1_CA.carrier_hz * middle_s])
    motion = SignalDelays(delay_s=delay_s, doppler_hz=doppler_hz)
    levels = WEAK_DBHZ + np.array([0.0, stronger_db])
    rendering = make_ideal_signals([SAT, SAT], motion, levels, FRONT_END, duration_s=SETTLED_S + SPREAD_S + 0.1, seed=7)
    if same_bits:
        rendering = replace(rendering, carried=np.zeros(2, np.int64))
    receiver = Receiver(FRONT_END.rate_hz, 0.0, ReceiverSettings(sats=(), near_search_s=1e9))
    state = ReceiverState()
    for i in range(2):
        peak = Peak(
            sat=SAT, delay_s=delay_s[i] % 1e-3, doppler_hz=doppler_hz[i], power=1.0, p_value=0.0, cn0_dbhz=levels[i]
        )
        state = receiver.start_channel(state, peak)
    parts = []
    for block in range(-(-rendering.n_samples // BLOCK)):
        output, state = receiver.step(state, render(rendering, block)[:, : rendering.n_samples - block * BLOCK])
        parts.append(output.measurements)
    measured = Measurements.join(parts)
    chosen = (measured.arc == 0) & (measured.elapsed_s > SETTLED_S)
    t, table = measured.elapsed_s[chosen], measured.table[chosen]
    late_s = t - motion.code_delay_s(t)[:, 0] - table[:, m.FRACTION_S]
    late_s -= 1e-3 * np.rint(late_s * 1e3)
    cycles = table[:, m.CARRIER_CYC] - motion.carrier_delay_s(t)[:, 0] * GPS_L1_CA.carrier_hz
    sigma_m = SPEED_OF_LIGHT_M_S * table[:, m.CODE_SIGMA_S]
    return SPEED_OF_LIGHT_M_S * late_s, cycles - 0.5 * np.rint(2.0 * cycles), table[:, m.CN0_DBHZ] - WEAK_DBHZ, sigma_m


def compute_rms(values) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.long
@pytest.mark.parametrize(
    ("apart_chips", "stronger_db", "apart_hz", "same_bits"),
    [
        (2.0, 10.0, 0.0, True),
        (find_step() + 0.5, 20.0, 0.0, True),
        (find_step() + 0.5, 20.0, 0.5, True),
        (-(find_step() + 0.5), 10.0, 0.1, False),  # bits turn over in the midst of the other's
    ],
)
def test_the_weaker_of_two_is_measured_as_if_alone(monkeypatch, apart_chips, stronger_db, apart_hz, same_bits):
    code_m, carrier_cyc, cn0_db, sigma_m = measure_weaker(apart_chips, stronger_db, apart_hz, same_bits=same_bits)
    assert code_m.size >= 10
    assert compute_rms(code_m / sigma_m) < 1.6  # of 11 epochs
    assert compute_rms(carrier_cyc) < 0.0025
    assert compute_rms(cn0_db) < 0.8
    monkeypatch.setattr(antennas, "take_out", lambda sats, *_, **__: np.full(len(sats), np.nan))
    swung_m, *_ = measure_weaker(apart_chips, stronger_db, apart_hz, same_bits=same_bits)
    assert swung_m.size == 0 or compute_rms(swung_m) > 3.0 * compute_rms(code_m)  # pulled away, or metres off


def test_at_whole_chips_the_table_is_the_sum_of_products():
    table = autocorrelate_period(CODE, 0.02)
    code = CODE.astype(float)
    for lag in (0, 1, 2, 7, 500, 1000, 1022):
        assert table[lag * POINTS] == pytest.approx(np.dot(code[lag:], code[: code.size - lag]) / code.size, abs=5e-3)


def make_rows(*starts_chips):
    """Make two frames of ten periods of channels with unit prompts whose codes begin so many chips later."""
    frames = []
    for first in (0, 10):
        rows = np.zeros((len(starts_chips), 12, k.OUT_TAPS + 6))
        periods = first + np.arange(12)
        for row, start in zip(rows, starts_chips, strict=True):
            at = 2600.0 * periods + start * 2600.0 / 1023.0
            row[:, k.OUT_START] = np.ceil(at)
            row[:, k.OUT_CHIP] = (np.ceil(at) - at) * 1023.0 / 2600.0
            row[:, k.OUT_PERIOD] = periods
            row[:, k.OUT_TAPS :] = (0.9, 0.0, 1.0, 0.0, 0.9, 0.0)
        frames.append((rows, np.full(len(starts_chips), 10)))
    return frames


def clean_taps(sats, before, now):
    return take_out(
        sats,
        before,
        now,
        taps_chips=np.array([0.125, 0.0, -0.125]),
        rate_hz=2.6e6,
        if_hz=0.0,
        signal=GPS_L1_CA,
        code_gain=1.0,
    )


@pytest.mark.parametrize(
    ("sats", "starts_chips"),
    [(["G05", "G07"], (0.0, 3.0)), (["G05", "G05"], (0.0, 0.5)), (["G05", "G05"], (1022.7, 0.0))],
)
def test_single_signals_and_shared_channels_stay_unchanged(sats, starts_chips):
    before, now = make_rows(*starts_chips)
    was = before[0].copy(), now[0].copy()
    assert np.isnan(clean_taps(sats, before, now)).all()
    assert np.array_equal(before[0], was[0])
    assert np.array_equal(now[0], was[1])


def test_the_autocorrelation_at_the_other_signal_is_removed():
    before, now = make_rows(0.0, 3.0, 40.0)
    other = before[0][2:, :, k.OUT_TAPS :], now[0][2:, :, k.OUT_TAPS :]
    for taps in other:
        taps[:] = 0.0
    errors_chips = clean_taps(["G05"] * 3, before, now)
    assert np.isfinite(errors_chips).all()
    table = np.interp(
        3.0 + np.array([0.125, 0.0, -0.125]),
        np.arange(1023 * POINTS + 1) / POINTS,
        autocorrelate_period(CODE, 1.023 / 2.6),
    )
    far = autocorrelate_period(CODE, 1.023 / 2.6)[1020 * POINTS]
    assert now[0][0, 2, k.OUT_TAPS + 2] == pytest.approx(1.0 - table[1] - far, abs=0.01)
    assert now[0][0, 2, k.OUT_TAPS] - now[0][0, 2, k.OUT_TAPS + 4] == pytest.approx(table[2] - table[0], abs=0.01)
