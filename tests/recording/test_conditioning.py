"""The front end measured and corrected: what is found, what it costs, what remains; and signals stay unharmed."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal as filters
from scipy import stats

from skyproof.gnss.codes import generate_ca_code
from skyproof.recording.conditioning import LOSS_LIMIT_DB, Conditioner, condition, measure_front_end, measure_power
from skyproof.records import Samples

RATE_HZ = 4e6
LINE_HZ = 212_345.6


def make_recording(planes, *, if_hz=0.0, rate_hz=RATE_HZ) -> Samples:
    planes = np.asarray(planes, np.float32)
    return Samples(
        name="x",
        rate_hz=rate_hz,
        n_samples=planes.shape[1],
        if_hz=if_hz,
        read=lambda start, count: planes[:, start : start + count],
    )


def draw_noise(n, seed=0):
    return np.random.default_rng(seed).standard_normal((2, n)).astype(np.float32)


def draw_line(n, frequency_hz, power_over_n0_dbhz, rate_hz=RATE_HZ):
    """Draw a line over noise of variance 1 in I and in Q."""
    amplitude = np.sqrt(2.0 * 10.0 ** (power_over_n0_dbhz / 10.0) / rate_hz)
    turn = amplitude * np.exp(2j * np.pi * np.mod(frequency_hz / rate_hz * np.arange(n), 1.0))
    return np.stack([turn.real, turn.imag]).astype(np.float32)


def make_replica(prn, n, *, delay_chips=0.0, doppler_hz=0.0, rate_hz=RATE_HZ):
    time_s = np.arange(n) / rate_hz
    chips = generate_ca_code(prn)[np.floor(time_s * 1.023e6 - delay_chips).astype(int) % 1023]
    return chips * np.exp(2j * np.pi * np.mod(doppler_hz * time_s, 1.0))


def measure_cn0_dbhz(planes, prn=7, doppler_hz=1234.0):
    """Measure C/N0 of an unmodulated signal at delay zero, over the noise of other codes, Dopplers and delays."""
    base = (planes[0] + 1j * planes[1]).astype(np.complex128)
    n = base.size
    carrier = abs(np.mean(base * np.conj(make_replica(prn, n, doppler_hz=doppler_hz)))) ** 2
    rest = []
    for other in range(1, 33, 2):
        product = base * np.conj(make_replica(other, n, delay_chips=31.0 * other, doppler_hz=311.0 * other - 5000.0))
        rest.append(np.mean(np.abs(product.reshape(-1, 4000).mean(axis=1)) ** 2))
    return 10.0 * np.log10(carrier / (np.mean(rest) * 1e-3))


def draw_sky(n, dbhz=45.0):
    base = make_replica(7, n, doppler_hz=1234.0) * np.sqrt(2.0 * 10.0 ** (dbhz / 10.0) / RATE_HZ)
    return draw_noise(n) + np.stack([base.real, base.imag]).astype(np.float32)


# Nothing to do


def test_a_clean_front_end_is_left_alone_and_costs_nothing():
    samples = make_recording(draw_sky(400_000))
    front = measure_front_end(samples)
    assert not front.acts
    assert front.remarks == ()
    assert condition(samples, front) is samples
    block = samples.read(0, 1000)
    out, state = Conditioner(front).step(None, block)
    assert out is block
    assert state.position == 1000


@pytest.mark.parametrize("kind", ["white", "filtered", "real", "two-bit"])
def test_lines_are_seen_in_noise_as_seldom_as_stated(kind):
    # Filtered noise gives fewer, for where the filter stops no line is looked for; white noise as many as stated.
    rng = np.random.default_rng(3)
    trials, wanted = 150, 0.1
    low_pass = filters.firwin(63, 0.5)
    band_pass = filters.butter(4, [0.35, 0.75], "band", output="sos")
    alarms = 0
    for _ in range(trials):
        planes = rng.standard_normal((2, 12_000))
        if kind in ("filtered", "two-bit"):
            planes = filters.lfilter(low_pass, 1.0, planes, axis=1)[:, 100:]
        if kind == "two-bit":
            planes = np.copysign(np.where(np.abs(planes) > planes.std(), 3.0, 1.0), planes)
        if kind == "real":
            planes = np.stack([filters.sosfilt(band_pass, planes[0]), np.zeros(planes.shape[1])])
        samples = make_recording(planes, if_hz=1e6 if kind == "real" else 0.0)
        alarms += bool(measure_front_end(samples, false_alarm_probability=wanted).lines)
    low, high = stats.binom.interval(0.998, trials, wanted)
    assert alarms <= high
    assert alarms >= (low if kind == "white" else 1)


# Lines


@pytest.mark.parametrize("over_signal_db", [20.0, 35.0, 50.0])
def test_a_line_costs_what_theory_says_and_is_notched(over_signal_db):
    n = 400_000
    clean = draw_sky(n)
    samples = make_recording(clean + draw_line(n, LINE_HZ, 45.0 + over_signal_db))
    front = measure_front_end(samples)
    (line,) = front.notched
    assert line.frequency_hz == pytest.approx(LINE_HZ, abs=20.0)
    assert line.jn0_dbhz == pytest.approx(45.0 + over_signal_db, abs=0.3)
    power_over_n0 = 10.0 ** ((45.0 + over_signal_db) / 10.0)
    theory_db = 10.0 * np.log10(1.0 + power_over_n0 * np.sinc(LINE_HZ / 1.023e6) ** 2 / 1.023e6)
    assert line.loss_db == pytest.approx(theory_db, abs=0.3)
    undisturbed_dbhz = measure_cn0_dbhz(clean[:, 4000:-4000])
    assert undisturbed_dbhz - measure_cn0_dbhz(samples.read(0, n)) == pytest.approx(
        theory_db, abs=1.5
    )  # few codes, few lines
    corrected = condition(samples, front).read(4000, n - 8000)  # at the ends a notch is not settled
    assert undisturbed_dbhz - measure_cn0_dbhz(corrected) < 0.15


def test_a_line_that_does_not_hurt_is_reported_and_left():
    n = 800_000
    samples = make_recording(draw_noise(n) + draw_line(n, LINE_HZ, 38.0))
    front = measure_front_end(samples)
    (line,) = front.lines
    assert line.frequency_hz == pytest.approx(LINE_HZ, abs=300.0)
    assert line.loss_db < LOSS_LIMIT_DB
    assert not front.acts
    assert "left in" in front.remarks[0]


def test_a_strong_line_outside_the_signals_band_is_left():
    n = 400_000
    front = measure_front_end(
        make_recording(draw_noise(n) + draw_line(n, 1.023e6, 60.0))
    )  # a null of the code's spectrum
    assert front.lines
    assert not front.notched


def test_a_line_in_real_samples_is_notched():
    n, rate_hz = 1_200_000, 12e6
    line = np.sqrt(4.0 * 10.0**7.0 / rate_hz) * np.cos(2.0 * np.pi * np.mod(3.1e6 / rate_hz * np.arange(n), 1.0))
    still = draw_noise(n) * [[1.0], [0.0]]
    samples = make_recording(still + [line, 0.0 * line], if_hz=3e6, rate_hz=rate_hz)
    front = measure_front_end(samples)
    assert front.real
    (found,) = front.notched
    assert found.frequency_hz == pytest.approx(3.1e6, abs=60.0)
    assert found.jn0_dbhz == pytest.approx(70.0, abs=0.3)
    corrected = condition(samples, front).read(50_000, 1_000_000)
    assert not corrected[1].any()
    remaining = 2.0 * np.mean(
        corrected[0] * np.exp(-2j * np.pi * np.mod(3.1e6 / rate_hz * np.arange(50_000, 1_050_000), 1.0))
    )
    assert abs(remaining) < 0.01 * np.sqrt(4.0 * 10.0**7.0 / rate_hz)


def draw_wide_lines(n, frequencies_hz, width_hz, power_over_n0_dbhz):
    """Draw lines of noise of an rms width, as of a jammer that sweeps and is there for a part of the time."""
    rng, low = np.random.default_rng(5), filters.butter(2, 1.5 * width_hz / (RATE_HZ / 2.0), output="sos")
    total = np.zeros(n, complex)
    for frequency_hz in frequencies_hz:
        slow = filters.sosfilt(low, rng.standard_normal((2, n)))
        slow *= np.sqrt(10.0 ** (power_over_n0_dbhz / 10.0) / RATE_HZ) / slow.std()
        total += (slow[0] + 1j * slow[1]) * np.exp(2j * np.pi * np.mod(frequency_hz / RATE_HZ * np.arange(n), 1.0))
    return np.stack([total.real, total.imag])


@pytest.mark.parametrize(
    ("power_dbhz", "width_hz", "together_hz", "beside"), [(60.0, 3e3, 80e3, 0.1), (50.0, 100.0, 40e3, 0.04)]
)
def test_wide_lines_are_not_notched_without_neighbours(power_dbhz, width_hz, together_hz, beside):
    # Of 600 m and the strength of the true peak, in all satellites: such were taken for a second sky once.
    n = 400_000
    lines = draw_wide_lines(n, 100e3 * np.arange(-4, 5), width_hz, power_dbhz)
    front = measure_front_end(make_recording(draw_sky(n) + lines))
    hurting = sum(line.hurts for line in front.lines)
    assert hurting >= 9
    assert len(front.notched) * front.notch_hz <= together_hz
    assert any(remark.startswith(f"{hurting - len(front.notched)} more line") for remark in front.remarks)
    base = make_replica(7, n)
    clean = np.stack([base.real, base.imag]).astype(np.float32)
    out = condition(make_recording(clean), replace(front, dc=np.zeros(2), dc_loss_db=0.0)).read(20_000, 200_000)
    received = out[0] + 1j * out[1]
    lags = np.arange(-30, 31)
    replicas = np.array([np.roll(base, lag)[20_000:220_000] for lag in lags])
    replica_mean, remaining = (np.mean(seen * replicas.conj(), axis=1) for seen in (base[20_000:220_000], received))
    assert np.abs(remaining - replica_mean)[np.abs(lags) > 1.5 * RATE_HZ / 1.023e6].max() < beside


@pytest.mark.parametrize("line_hz", [3e3, -211_003.0, 511_500.0])
@pytest.mark.parametrize("prn", [1, 22])
def test_a_notch_biases_neither_code_nor_carrier(line_hz, prn):
    n = 400_000
    front = measure_front_end(make_recording(draw_noise(n) + draw_line(n, line_hz, 75.0)))
    assert len(front.notched) == 1
    delay_chips, doppler_hz = 200.3, -2750.0
    base = make_replica(prn, n, delay_chips=delay_chips, doppler_hz=doppler_hz)
    corrected = condition(make_recording(np.stack([base.real, base.imag])), front).read(40_000, 320_000)
    corrected = (corrected[0] + 1j * corrected[1]).astype(np.complex128)

    def correlation(offset_chips, planes):
        local = make_replica(prn, n, delay_chips=delay_chips + offset_chips, doppler_hz=doppler_hz)[40_000:360_000]
        return np.mean(planes * np.conj(local))

    plain = base[40_000:360_000]
    spacing = 0.1
    early, prompt, late = (correlation(offset, corrected) for offset in (-spacing, 0.0, spacing))
    reference = [correlation(offset, plain) for offset in (-spacing, 0.0, spacing)]

    def error_chips(before, after):
        return 0.5 * (1.0 - spacing) * (abs(after) - abs(before)) / (abs(after) + abs(before))

    assert abs(error_chips(early, late) - error_chips(reference[0], reference[2])) * 293.0 < 0.05  # metres
    assert abs(np.angle(prompt / reference[1])) / (2.0 * np.pi) < 1e-4
    assert 20.0 * np.log10(abs(reference[1]) / abs(prompt)) < 0.3


# DC and imbalance


def test_dc_of_one_rms_is_measured_and_removed():
    n = 400_000
    clean = draw_sky(n)
    samples = make_recording(clean + np.array([[1.0], [0.0]], np.float32))
    front = measure_front_end(samples)
    assert front.removes_dc
    assert front.dc_loss_db == pytest.approx(10.0 * np.log10(1.0 + 0.5 * RATE_HZ / 1.023e6), abs=0.1)
    corrected = condition(samples, front).read(0, n)
    assert np.abs(corrected.mean(axis=1)).max() < 0.01
    assert measure_cn0_dbhz(clean) - measure_cn0_dbhz(corrected) < 0.05


def test_imbalance_is_measured_and_its_image_removed():
    n = 800_000
    clean = draw_noise(n) + draw_line(n, LINE_HZ, 70.0)
    gain, skew = 10.0 ** (1.0 / 20.0), np.radians(5.0)
    # Q is what lies 85 degrees from I, and weaker by 1 dB
    skewed = np.stack([gain * clean[0], np.cos(skew) * clean[1] + np.sin(skew) * clean[0]])
    samples = make_recording(skewed)
    front = measure_front_end(samples)
    assert front.gain_imbalance_db == pytest.approx(1.0, abs=0.05)
    assert front.phase_imbalance_deg == pytest.approx(5.0, abs=0.3)
    assert front.image_db == pytest.approx(-22.8, abs=0.3)
    assert front.balances
    corrected = condition(samples, replace(front, lines=())).read(0, n)

    def power_at(frequency_hz, planes):
        base = (planes[0] + 1j * planes[1]).astype(np.complex128)
        return abs(np.mean(base * np.exp(-2j * np.pi * np.mod(frequency_hz / RATE_HZ * np.arange(n), 1.0)))) ** 2

    assert 10.0 * np.log10(power_at(-LINE_HZ, skewed) / power_at(LINE_HZ, skewed)) == pytest.approx(-22.8, abs=0.3)
    assert 10.0 * np.log10(power_at(-LINE_HZ, corrected) / power_at(LINE_HZ, corrected)) < -40.0


# The rest of what is reported


def test_band_levels_and_clipping_are_reported():
    low_pass = filters.firwin(255, 0.5)  # of half the rate: -1 to 1 MHz
    planes = filters.lfilter(low_pass, 1.0, draw_noise(300_000), axis=1)[:, 300:]
    front = measure_front_end(make_recording(np.clip(np.round(planes * 3.0), -3, 3)))
    assert front.band_hz == pytest.approx((-1e6, 1e6), abs=30e3)
    assert front.noise_bandwidth_hz == pytest.approx(2e6, rel=0.1)
    assert front.levels.tolist() == [-3, -2, -1, 0, 1, 2, 3]
    assert front.level_shares.sum() == pytest.approx(1.0)
    assert front.extreme_share == pytest.approx(front.level_shares[0] + front.level_shares[-1])


def test_too_few_samples_are_refused():
    with pytest.raises(ValueError, match="at least 1024"):
        measure_front_end(make_recording(draw_noise(1000)))


# Pieces


HURT = draw_sky(30_000) + draw_line(30_000, LINE_HZ, 80.0) + draw_line(30_000, -150e3, 75.0) + np.float32(0.5)
FRONT = measure_front_end(make_recording(HURT))


@settings(max_examples=25, deadline=None)
@given(cuts=st.lists(st.integers(0, HURT.shape[1]), max_size=6))
def test_pieces_give_bit_by_bit_what_the_whole_gives(cuts):
    conditioner = Conditioner(FRONT)
    whole, _ = conditioner.step(None, HURT)
    state, pieces = None, []
    for begin, end in zip([0, *sorted(cuts)], [*sorted(cuts), HURT.shape[1]], strict=True):
        piece, state = conditioner.step(state, HURT[:, begin:end])
        pieces.append(piece)
    np.testing.assert_array_equal(np.concatenate(pieces, axis=1), whole)


def test_a_step_changes_neither_its_state_nor_its_block():
    conditioner = Conditioner(FRONT)
    _, state = conditioner.step(None, HURT[:, :5000])
    block = HURT[:, 5000:9000].copy()
    first, _ = conditioner.step(state, block)
    again, _ = conditioner.step(state, block)
    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(block, HURT[:, 5000:9000])


@pytest.mark.parametrize(("start", "count"), [(0, 3000), (12_345, 777), (29_000, 5000), (30_000, 10)])
def test_a_stretch_read_is_that_of_the_whole_at_its_own_time(start, count):
    corrected = condition(make_recording(HURT), FRONT)
    whole = corrected.read(0, HURT.shape[1])
    assert whole.shape == HURT.shape
    np.testing.assert_allclose(corrected.read(start, count), whole[:, start : start + count], rtol=0.0, atol=1e-5)
    late = Conditioner(FRONT).delay_samples
    stepped, _ = Conditioner(FRONT).step(None, HURT)
    np.testing.assert_allclose(whole[:, : HURT.shape[1] - late], stepped[:, late:], rtol=0.0, atol=1e-5)


@pytest.mark.parametrize("sigma", [0.5, 3.0, 30.0])
@pytest.mark.parametrize("most", [1, 7, 127])
def test_the_power_of_noise_is_found_through_a_quantiser_that_clips(sigma, most) -> None:
    planes = np.clip(np.round(sigma * draw_noise(200_000) - 0.5) + 0.5, -most - 0.5, most + 0.5)
    assert 10.0 * np.log10(measure_power(planes) / (2.0 * sigma**2)) == pytest.approx(0.0, abs=0.3)


def test_one_bit_shows_no_power() -> None:
    assert np.isnan(measure_power(np.sign(draw_noise(1000))))
