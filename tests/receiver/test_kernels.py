"""The tracking kernel against a plain NumPy twin."""

import numpy as np
import pytest

from skyproof.gnss.signals import GPS_L1_CA
from skyproof.receiver import kernels as k
from skyproof.receiver.correlator import table_pad
from skyproof.receiver.discriminator import compute_discriminator
from skyproof.receiver.replica import CODE_SCALE, code_table, low_pass_gain

RATE_HZ = 2.6e6
CODE = GPS_L1_CA.code(7)
GAIN = compute_discriminator(1.023e6 / RATE_HZ, 0.25).gain


def correlate_numpy(planes, begin, n, chip, code_rate_hz, phase_cyc, frequency_hz, taps_chips):
    """Sums of one period with the exact code at every sample."""
    index = np.arange(n)
    base = (planes[0, begin : begin + n] + 1j * planes[1, begin : begin + n]) * np.exp(
        -2j * np.pi * (phase_cyc + index * frequency_hz / RATE_HZ)
    )
    chips = chip + index * code_rate_hz / RATE_HZ
    return base @ smooth_code(chips, taps_chips)


def smooth_code(chips, taps_chips):
    """Filter the code by the replica's low-pass times its scale, from its line spectrum: (n_chips, n_taps)."""
    line = np.arange(-1300, 1301)  # kilohertz: the low-pass ends at half the rate
    spectrum = np.fft.fft(CODE)[line % 1023] / 1023.0 * np.sinc(line / 1023.0) * np.exp(-1j * np.pi * line / 1023.0)
    spectrum *= low_pass_gain(line * 1e3 / RATE_HZ)
    shifted = spectrum[:, None] * np.exp(2j * np.pi * np.outer(line, taps_chips) / 1023.0)
    return CODE_SCALE * np.real(np.exp(2j * np.pi * np.outer(chips / 1023.0, line)) @ shifted)


def draw_signal(n, *, delay_chips, doppler_hz, phase_cyc=0.2, amplitude=1.0):
    """Draw a noiseless signal, I and Q in float32."""
    index = np.arange(n)
    chips = index * 1.023e6 * (1.0 + doppler_hz / 1575.42e6) / RATE_HZ - delay_chips
    wave = (
        amplitude
        * CODE[np.floor(chips).astype(int) % 1023]
        * np.exp(2j * np.pi * (phase_cyc + index * doppler_hz / RATE_HZ))
    )
    return np.stack([wave.real, wave.imag]).astype(np.float32)


def run(planes, state, taps_chips, *, first_sample=0, look_samples=np.inf, look_share=1.0):
    out = np.zeros((1, planes.shape[1] // 2600 + 2, k.OUT_TAPS + 2 * taps_chips.size))
    counts = np.zeros(1, np.int64)
    table = code_table(CODE, 1.023e6 / RATE_HZ, 32, 2601)[None]
    power = float(np.mean(planes**2) * 2.0) * CODE_SCALE**2
    k.advance(
        np.ascontiguousarray(planes, np.float32)[None],
        planes.shape[1],
        first_sample,
        power,
        np.array([[[1.0, 0.0]]]),
        state,
        table,
        table_pad(1.023e6 / RATE_HZ),
        np.zeros(1, np.int64),
        taps_chips,
        np.zeros(1),
        look_samples,
        look_share,
        RATE_HZ,
        0.0,
        1.023e6,
        1575.42e6,
        1023,
        GAIN,
        out,
        counts,
    )
    return out[0, : counts[0]]


def list_taps(rows):
    """Return complex correlators, (n, n_taps)."""
    return rows[:, k.OUT_TAPS :: 2] + 1j * rows[:, k.OUT_TAPS + 1 :: 2]


def state_for(*, delay_chips, doppler_hz, phase_cyc=0.2, pll=0.0, dll=0.0):
    first = int(np.ceil(delay_chips / 1.023e6 * RATE_HZ))
    state = np.zeros((1, k.N_STATE))
    state[0, k.START] = first
    state[0, k.CHIP] = first * 1.023e6 / RATE_HZ - delay_chips
    state[0, k.PHASE] = phase_cyc + first * doppler_hz / RATE_HZ
    state[0, k.FREQUENCY] = state[0, k.PLL_VELOCITY] = doppler_hz
    state[0, k.CODE_RATE] = 1.023e6 * (1.0 + doppler_hz / 1575.42e6)
    state[0, k.PLL_BANDWIDTH] = pll
    state[0, k.DLL_BANDWIDTH] = dll
    state[0, k.BIT_START] = -1.0
    state[0, k.INTEGRATION] = 1.0
    return state


@pytest.mark.parametrize(
    ("doppler_hz", "taps"),
    [(-7000.0, (0.125, 0.0, -0.125)), (0.0, (0.5, 0.0, -0.5, 1.0, -1.0)), (3210.7, (0.5, 0.0, -0.5, 1.0, -1.0))],
)
def test_the_kernel_equals_its_numpy_twin(doppler_hz, taps):
    rng = np.random.default_rng(1)
    taps_chips = np.array(taps)
    planes = draw_signal(8000, delay_chips=300.3, doppler_hz=doppler_hz) + rng.normal(size=(2, 8000)).astype(np.float32)
    rows = run(planes, state_for(delay_chips=300.3, doppler_hz=doppler_hz), taps_chips)
    assert len(rows) == 2
    for row in rows:
        code_rate_hz = 1.023e6 * (1.0 + doppler_hz / 1575.42e6)  # the loops are open
        n = int(np.ceil((1023 - row[k.OUT_CHIP]) / (code_rate_hz / RATE_HZ)))
        twin = correlate_numpy(
            planes,
            int(row[k.OUT_START]),
            n,
            row[k.OUT_CHIP],
            code_rate_hz,
            row[k.OUT_PHASE],
            row[k.OUT_FREQUENCY],
            taps_chips,
        )
        ours = row[k.OUT_TAPS :: 2] + 1j * row[k.OUT_TAPS + 1 :: 2]
        # The code is read at the nearest of 32 fractions of a sample.
        assert np.abs(ours - twin).max() < 0.01 * n * CODE_SCALE


def test_the_discriminator_returns_the_error_it_was_given():
    for error_chips, tolerance in ((-0.08, 0.01), (-0.03, 0.003), (0.0, 0.003), (0.02, 0.003), (0.07, 0.01)):
        planes = draw_signal(400_000, delay_chips=100.0, doppler_hz=1234.5)
        state = state_for(delay_chips=100.0 + error_chips, doppler_hz=1234.5)
        rows = run(planes, state, np.array([0.125, 0.0, -0.125]))
        # The replica is late by error_chips, so the signal is ahead by as much; the mean over all sample fractions.
        early, prompt, late = (list_taps(rows[50:])[:, i] for i in range(3))
        found = np.real((early - late) / prompt) / GAIN - rows[50:, k.OUT_SHIFT]
        assert np.mean(found) == pytest.approx(error_chips, abs=tolerance)  # the peak is round


def test_a_frequency_error_is_pulled_in_and_the_phase_locked():
    planes = draw_signal(2_600_000, delay_chips=17.2, doppler_hz=2003.0)
    state = state_for(delay_chips=17.2, doppler_hz=1990.0, pll=15.0, dll=1.0)
    state[0, k.FLL_BANDWIDTH] = 8.0
    rows = run(planes, state, np.array([0.125, 0.0, -0.125]))
    late = rows[900:]
    assert np.abs(late[:, k.OUT_FREQUENCY] - 2003.0).max() < 0.5
    assert np.abs(np.angle(list_taps(late)[:, 1] ** 2)).max() < 0.01 * 4.0 * np.pi


def test_sums_begin_and_end_with_the_data_bits():
    planes = draw_signal(300_000, delay_chips=5.0, doppler_hz=0.0)
    state = state_for(delay_chips=5.0, doppler_hz=0.0, pll=15.0, dll=1.0)
    state[0, k.BIT_START], state[0, k.INTEGRATION] = 7.0, 20.0
    rows = run(planes, state, np.array([0.125, 0.0, -0.125]))
    steered = np.flatnonzero(np.diff(rows[:, k.OUT_FREQUENCY]) != 0.0) + 1
    assert set(rows[steered, k.OUT_PERIOD] % 20) == {7.0}
    assert state[0, k.LOCK_COUNT] == len(rows[7:]) // 20 + 1  # the first sum is cut short by the first bit's end
    assert state[0, k.SUM_PERIODS] == (len(rows) - 7) % 20


def test_two_calls_give_what_one_gives():
    rng = np.random.default_rng(2)
    planes = draw_signal(60_000, delay_chips=5.0, doppler_hz=-800.0) + rng.normal(size=(2, 60_000)).astype(np.float32)
    taps = np.array([0.125, 0.0, -0.125])
    whole = run(planes, state_for(delay_chips=5.0, doppler_hz=-800.0, pll=15.0, dll=1.0), taps)
    state = state_for(delay_chips=5.0, doppler_hz=-800.0, pll=15.0, dll=1.0)
    first = run(planes[:, :31_234], state, taps)
    cut = int(state[0, k.START])
    second = run(planes[:, cut:], state, taps, first_sample=cut)
    pieces = np.concatenate([first, second])
    # Only the stretch's mean power, which normalises the discriminator, may differ between calls.
    np.testing.assert_allclose(pieces[:5], whole[:5], rtol=1e-4, atol=0.05 * CODE_SCALE)


def test_snapshot_taps_equal_continuous_ones_and_spare_loops():
    planes = draw_signal(int(0.0512 * RATE_HZ), delay_chips=5.0, doppler_hz=-800.0)
    delays = np.array([0.125, 0.0, -0.125, 0.5, -0.5])
    whole = run(planes, state_for(delay_chips=5.0, doppler_hz=-800.0, pll=15.0, dll=1.0), delays)
    state = state_for(delay_chips=5.0, doppler_hz=-800.0, pll=15.0, dll=1.0)
    looked = run(planes, state, delays, look_samples=0.02 * RATE_HZ, look_share=0.2)
    taken = whole[:, k.OUT_START] % (0.02 * RATE_HZ) < 0.004 * RATE_HZ
    assert taken.sum() == 12
    np.testing.assert_array_equal(looked[taken], whole[taken])
    near = k.OUT_TAPS + 6
    np.testing.assert_array_equal(looked[:, :near], whole[:, :near])
    assert np.isnan(looked[~taken, near:]).all()
