"""The correlator against plain sums in NumPy and float64."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from skyproof.gnss.signals import GPS_L1_CA
from skyproof.receiver import correlator as c

CODE = GPS_L1_CA.code(7)
CHIP_RATE_HZ = 1.023e6
PHASES = 32


def make_sharp_table(code, chips_per_sample, n_phases, n_samples, reach_chips=c.REACH_CHIPS):
    """Tabulate the code at `n_phases` fractions of a sample.

    Row p, column k is the chip (k - pad + p / n_phases) samples on.
    """
    pad = c.table_pad(chips_per_sample, reach_chips)
    samples = np.arange(-pad, n_samples + pad)[None, :] + np.arange(n_phases)[:, None] / n_phases
    return code[np.floor(samples * chips_per_sample).astype(np.int64) % code.size]


class Case:
    """Noise, and one stretch of it to correlate."""

    def __init__(
        self,
        rate_hz=2.6e6,
        *,
        n=None,
        begin=3,
        chip=0.2,
        doppler_hz=1234.5,
        code_doppler=3e-6,
        phase_cyc=0.3,
        delays_chips=(0.125, 0.0, -0.125),
        reach_chips=2.0,
        seed=1,
    ) -> None:
        self.nominal = CHIP_RATE_HZ / rate_hz
        self.step = self.nominal * (1.0 + code_doppler)
        self.n = math.ceil((1023 - chip) / self.step) if n is None else n
        self.begin, self.chip, self.phase_cyc = begin, chip, phase_cyc
        self.cycles = doppler_hz / rate_hz
        self.delays = np.array(delays_chips)
        self.samples = np.random.default_rng(seed).normal(size=(2, begin + self.n + 2)).astype(np.float32)
        self.reach = reach_chips

    @property
    def stretch(self):
        planes = self.samples[:, self.begin : self.begin + self.n].astype(np.float64)
        return planes[0] + 1j * planes[1]

    @property
    def wiped(self):
        return self.stretch * np.exp(-2j * np.pi * (self.phase_cyc + np.arange(self.n) * self.cycles))

    def compute_chips(self, delay_chips):
        """Compute the exact code phase of the replica at every sample."""
        return self.chip + np.arange(self.n) * self.step + delay_chips

    def correlate_plainly(self):
        return np.array(
            [np.sum(self.wiped * CODE[np.floor(self.compute_chips(d)).astype(int) % 1023]) for d in self.delays]
        )

    def bound_doubt(self, sample):
        """Bound the change of each sum by a replica that is displaced by up to `sample`."""
        changed = [
            CODE[np.floor(self.compute_chips(d) - sample * self.nominal).astype(int) % 1023]
            != CODE[np.floor(self.compute_chips(d) + sample * self.nominal).astype(int) % 1023]
            for d in self.delays
        ]
        return np.array([2.0 * np.sum(np.abs(self.stretch[samples])) for samples in changed])

    def run(self, *, first=0, n=None, dopplers=(0.0,), room=None):
        """Sums (n_dopplers, n_delays) and shifts of `n` samples from the one numbered `first` in the stretch."""
        n = self.n - first if n is None else n
        table = make_sharp_table(CODE, self.nominal, PHASES, math.ceil(1023 / self.nominal) + 1, self.reach)
        sums = np.full((len(dopplers), self.delays.size, 2), np.inf)
        shifts = np.full(self.delays.size, np.inf)
        c.correlate_period(
            self.samples[0],
            self.samples[1],
            self.begin + first,
            n,
            self.chip + first * self.step,
            self.step,
            self.phase_cyc + first * self.cycles,
            self.cycles,
            table,
            c.table_pad(self.nominal, self.reach),
            self.nominal,
            self.delays,
            np.array(dopplers),
            c.allocate_scratch(room or self.n, self.delays.size),
            sums,
            shifts,
        )
        return sums[..., 0] + 1j * sums[..., 1], shifts


def measure_displacement(case, n):
    """Samples by which the table's fractions and the code's drift within a chunk may displace the replica."""
    drift = abs(case.step / case.nominal - 1.0) * 0.5 * c._chunk_length(n)
    return 0.5 / PHASES + drift + 1e-6


CASES = st.builds(
    Case,
    st.floats(2.046e6, 50e6) | st.sampled_from([2.046e6, 2.6e6, 4e6, 4.092e6, 25e6, 50e6]),
    begin=st.integers(0, 40),
    chip=st.floats(-0.1, 0.5),
    doppler_hz=st.floats(-1.2e6, 1.2e6),
    code_doppler=st.floats(-1e-5, 1e-5),
    phase_cyc=st.floats(-1e9, 1e9),
    delays_chips=st.lists(st.floats(-1.9, 1.9), min_size=1, max_size=12),
    seed=st.integers(0, 99),
)


@settings(max_examples=30, deadline=None)
@given(case=CASES)
def test_sums_are_the_plain_ones_within_the_codes_rounding(case):
    sums, shifts = case.run()
    assert np.all(
        np.abs(sums[0] - case.correlate_plainly())
        <= case.bound_doubt(measure_displacement(case, case.n)) + 1e-5 * case.n
    )
    assert np.all(np.abs(shifts) <= (0.5 / PHASES + 1e-6) * case.nominal)


@settings(max_examples=30, deadline=None)
@given(case=CASES, share=st.floats(0.01, 0.99))
def test_two_pieces_add_up_to_the_whole(case, share):
    cut = int(share * case.n)
    assume(0 < cut < case.n)
    whole, first, second = case.run()[0], case.run(n=cut)[0], case.run(first=cut)[0]
    doubt = 2.0 * case.bound_doubt(measure_displacement(case, case.n))
    assert np.all(np.abs(whole - first - second)[0] <= doubt + 2e-5 * case.n)


@settings(max_examples=30, deadline=None)
@given(case=CASES, n=st.integers(1, c.CHUNK))
def test_the_shift_returned_is_the_shift_of_the_replica_used(case, n):
    case.n = min(n, case.n)
    sums, shifts = case.run()
    for total, delay, shift in zip(sums[0], case.delays, shifts, strict=True):
        middle = case.compute_chips(delay)[0] + 0.5 * (case.n - 1) * case.step - shift
        first = middle / case.nominal - 0.5 * (case.n - 1)
        on_grid = round(first * PHASES) / PHASES  # a fraction that the table has
        assert abs(first - on_grid) < 1e-6
        replica = CODE[np.floor((on_grid + np.arange(case.n)) * case.nominal).astype(int) % 1023]
        assert abs(total - np.sum(case.wiped * replica)) < 1e-5 * case.n + 1e-5


def test_the_mean_shift_over_chunks_is_taken_off_without_bias():
    # Early minus late of a signal without noise: with 40 samples a chip, the shift is what is left to be seen.
    errors = []
    for chip in np.linspace(0.0, 0.02, 40, endpoint=False):
        case = Case(41e6, chip=chip, doppler_hz=0.0, phase_cyc=0.0, delays_chips=(0.25, 0.0, -0.25), begin=0)
        case.samples[:] = 0.0
        case.samples[0, : case.n] = CODE[np.floor(case.compute_chips(0.0)).astype(int) % 1023]
        sums, shifts = case.run()
        early, prompt, late = sums[0].real
        errors.append([0.5 * (early - late) / prompt, 0.5 * (shifts[0] + shifts[2])])
    seen, reported = np.array(errors).T
    assert np.abs(np.mean(seen - reported)) < 1e-4


@pytest.mark.parametrize("rate_hz", [2.6e6, 25e6])
@pytest.mark.parametrize("n_delays", range(1, 13))
def test_a_sum_does_not_depend_on_how_many_others_are_asked_for(rate_hz, n_delays):
    delays = np.linspace(-1.5, 1.3, n_delays)
    together = Case(rate_hz, delays_chips=delays).run()[0][0]
    alone = [Case(rate_hz, delays_chips=[delay]).run()[0][0, 0] for delay in delays]
    np.testing.assert_allclose(together, alone, atol=2e-6 * rate_hz / 1e3, rtol=0)


@pytest.mark.parametrize("rate_hz", [2.6e6, 4e6, 25e6])
@pytest.mark.parametrize("offset_hz", [-900.0, -50.0, 120.0, 500.0])
def test_a_doppler_tap_finds_its_signal_less_the_loss_stated(rate_hz, offset_hz):
    case = Case(rate_hz, delays_chips=(0.0, 0.5))
    k = np.arange(case.n)
    code = CODE[np.floor(case.compute_chips(0.0)).astype(int) % 1023]
    wave = code * np.exp(2j * np.pi * (case.phase_cyc + k * (case.cycles + offset_hz / rate_hz)))
    case.samples[:, case.begin : case.begin + case.n] = np.stack([wave.real, wave.imag])
    sums, _ = case.run(dopplers=(0.0, offset_hz / rate_hz))
    plain = np.sum(np.exp(2j * np.pi * k * offset_hz / rate_hz))
    loss = np.sinc(offset_hz * c._chunk_length(case.n) / rate_hz)  # over a chunk
    assert loss > 0.8
    doubt = case.bound_doubt(measure_displacement(case, case.n))[0]
    assert abs(sums[0, 0] - plain) < doubt + 1e-5 * case.n
    assert abs(sums[1, 0] - loss * case.n) < doubt + 2e-3 * case.n


def test_a_doppler_tap_of_zero_is_the_plain_sum():
    case = Case()
    sums, _ = case.run(dopplers=(0.0, 1e-7, 0.0))
    np.testing.assert_array_equal(sums[0], case.run()[0][0])
    np.testing.assert_array_equal(sums[0], sums[2])
    assert np.all(sums[1] != sums[0])


@pytest.mark.parametrize("where", [0, 1000, -1])
def test_a_sample_that_is_not_a_number_makes_every_sum_one(where):
    case = Case(delays_chips=(-0.5, -0.1, 0.0, 0.1, 0.5))
    case.samples[1, case.begin + (where % case.n)] = np.nan
    assert np.all(np.isnan(case.run(dopplers=(0.0, 1e-4))[0]))


def test_samples_outside_the_stretch_are_not_touched():
    case = Case()
    sums, _ = case.run()
    case.samples[:, : case.begin] = np.nan
    case.samples[:, case.begin + case.n :] = np.nan
    np.testing.assert_array_equal(case.run()[0], sums)


def test_far_delays_need_a_table_that_reaches_so_far():
    far = (-8.0, 0.0, 8.0)
    case = Case(delays_chips=far, reach_chips=8.0)
    assert np.all(
        np.abs(case.run()[0][0] - case.correlate_plainly())
        <= case.bound_doubt(measure_displacement(case, case.n)) + 1e-5 * case.n
    )
    for delay in (-8.0, 8.0):
        sums, shifts = Case(delays_chips=(0.0, delay)).run()
        assert np.all(np.isnan(sums))
        assert np.all(np.isnan(shifts))


@pytest.mark.parametrize(
    "wrong", [{"begin": -1}, {"n": 999_999}, {"chip": math.nan}, {"chip": 900.0}, {"room": 600}, {"step": 0.0}]
)
def test_a_stretch_beyond_samples_or_table_has_no_sums(wrong):
    case = Case()
    room, n = wrong.get("room"), wrong.get("n")
    case.begin, case.chip = wrong.get("begin", case.begin), wrong.get("chip", case.chip)
    case.step = wrong.get("step", case.step)
    if room:
        case = Case(12e6)
    assert np.all(np.isnan(case.run(n=n, room=room)[0]))


def test_an_empty_stretch_sums_to_nothing():
    sums, shifts = Case().run(n=0)
    assert np.all(sums == 0.0)
    assert np.all(shifts == 0.0)


def test_the_scratch_keeps_nothing_from_call_to_call():
    case, other = Case(delays_chips=(0.3, 0.2, 0.1, 0.0, -0.1)), Case(seed=2, chip=0.1, delays_chips=[0.5] * 5)
    table = make_sharp_table(CODE, case.nominal, PHASES, 2605)
    scratch = c.allocate_scratch(2605, 5)

    def run(which):
        sums, shifts = np.empty((1, 5, 2)), np.empty(5)
        c.correlate_period(
            which.samples[0],
            which.samples[1],
            which.begin,
            which.n,
            which.chip,
            which.step,
            which.phase_cyc,
            which.cycles,
            table,
            c.table_pad(which.nominal),
            which.nominal,
            which.delays,
            np.zeros(1),
            scratch,
            sums,
            shifts,
        )
        return sums

    first = run(case)
    run(other)
    np.testing.assert_array_equal(run(case), first)


@pytest.mark.parametrize("n", [1, 15, 500, 1500, 1600, 2600, 25_000])
def test_a_period_is_cut_into_equal_chunks(n):
    length = c._chunk_length(n)
    assert length % 16 == 0
    assert length <= 1.5 * c.CHUNK + 16
    n_chunks = math.ceil(n / length)
    assert 0 <= n_chunks * length - n < 16 * n_chunks
