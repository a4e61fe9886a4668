"""Sources taken out of an array's samples, against the theory of linearly constrained minimum variance."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skyproof.recording.null import make_null, measure_rise, take_out_sources
from skyproof.records import Samples

RATE_HZ = 1e6
SKY_HZ = 0.3 * RATE_HZ


def _draw(rng, *shape):
    return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2.0)


def _draw_steering(rng, antennas):
    return np.exp(2j * np.pi * rng.random(antennas))


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), antennas=st.integers(2, 8), share=st.floats(0.0, 0.999))
def test_no_weights_that_null_the_sources_do_better(seed, antennas, share):
    rng = np.random.default_rng(seed)
    sources = int(share * antennas)
    gains, wanted = 10.0 ** rng.uniform(-1.0, 1.0, antennas), _draw(rng, antennas)
    signatures = np.linalg.qr(_draw(rng, antennas, antennas))[0][:, :sources] * np.sqrt(1e4)
    power = np.eye(antennas) + signatures @ signatures.conj().T
    power /= np.sqrt(np.outer(np.diag(power).real, np.diag(power).real))  # gain control
    values, vectors = np.linalg.eigh(power)
    null = make_null(power * np.outer(gains, gains), 0.3)
    assert null.n_sources == np.sum(values > values[0] * (1.0 + 0.3 * antennas))

    combined = null.filter @ (gains * wanted)  # each combination weighted by the signal's own amplitude in it
    weights = null.filter.conj().T @ combined / gains
    weights *= gains**2
    reached = np.abs(weights.conj() @ wanted) ** 2 / np.real(weights.conj() @ power @ weights)
    assert reached == pytest.approx(np.sum(np.abs(combined) ** 2), rel=1e-6)
    basis = vectors[:, : antennas - null.n_sources]  # all weights without the sources
    tried = basis @ _draw(rng, antennas - null.n_sources, 200)
    rest = np.abs(tried.conj().T @ wanted) ** 2 / np.real(np.sum(tried.conj() * (power @ tried), axis=0))
    assert np.all(rest <= reached * (1.0 + 1e-6))


@pytest.mark.parametrize("source_db", [5.0, 20.0, 40.0])
def test_the_power_of_a_source_is_measured_whatever_the_gains(source_db):
    rng = np.random.default_rng(3)
    for antennas in (2, 3, 7):
        gains, source = 10.0 ** rng.uniform(-1.0, 1.0, antennas), _draw_steering(rng, antennas)
        power = 10.0 ** (0.1 * source_db)
        null = make_null((np.eye(antennas) + power * np.outer(source, source.conj())) * np.outer(gains, gains), 0.3)
        assert null.n_sources == 1
        assert null.rise == pytest.approx(1.0 + power)
        assert np.abs(null.filter @ (gains * source)).max() < 1e-5


def test_a_clean_sky_loses_nothing():
    rng = np.random.default_rng(4)
    for antennas in (2, 3, 7):
        gains = 10.0 ** rng.uniform(-1.0, 1.0, antennas)
        sky = sum(0.03 * np.outer(a, a.conj()) for a in (_draw_steering(rng, antennas) for _ in range(10)))
        null = make_null((np.eye(antennas) + sky) * np.outer(gains, gains), 0.3)
        assert (null.n_sources, null.rise) == (0, 1.0)
        assert np.linalg.matrix_rank(null.filter) == antennas


def _make_recording(waves):
    def of(one):
        def read(start, count):
            part = one[start : start + count]
            return np.stack([part.real, part.imag]).astype(np.float32)

        return read

    first, *rest = (
        Samples(name="array", rate_hz=RATE_HZ, n_samples=one.size, read=of(one), antenna=str(number))
        for number, one in enumerate(waves)
    )
    return replace(first, others=tuple(rest))


@pytest.mark.parametrize("power", [2.0, 1e2, 1e4])
def test_a_source_above_the_noise_is_gone_from_the_samples(power):
    rng = np.random.default_rng(6)
    antennas, n = 3, 25_000
    source, gains = _draw_steering(rng, antennas), np.array([0.3, 1.0, 5.0])
    sent = _draw(rng, n)
    waves = gains[:, None] * (np.sqrt(power) * np.outer(source, sent) + _draw(rng, antennas, n))
    recording = _make_recording(waves)
    planes = take_out_sources(recording, SKY_HZ, block_s=0.01).read_all(0, n)
    like = (planes[:, 0] + 1j * planes[:, 1]) @ sent.conj() / n
    assert np.abs(like).max() < 4.0 / np.sqrt(n)  # noise alone
    assert np.mean(planes**2) == pytest.approx(0.5 * (antennas - 1) / antennas, rel=0.02)
    assert measure_rise(recording, 0, n, SKY_HZ) == pytest.approx(1.0 + power, rel=0.05)


@settings(max_examples=40, deadline=None)
@given(
    starts=st.lists(st.tuples(st.integers(0, 3300), st.integers(0, 1500), st.integers(0, 2)), min_size=1, max_size=6)
)
def test_a_stretch_is_the_same_whatever_was_read_before(starts):
    rng = np.random.default_rng(7)
    waves = _draw(rng, 3, 3217)
    waves[:, 1000:2100] = 0.0  # a whole block of them
    out = take_out_sources(_make_recording(waves), SKY_HZ, block_s=1e-3)
    whole = take_out_sources(_make_recording(waves), SKY_HZ, block_s=1e-3).read_all(0, 3217)
    for start, count, antenna in starts:
        part = (out, *out.others)[antenna].read(start, count)
        np.testing.assert_array_equal(part, whole[antenna][:, start : start + count])


def test_antennas_that_give_nothing_are_left_out():
    rng = np.random.default_rng(8)
    with pytest.raises(ValueError, match="one antenna"):
        take_out_sources(_make_recording(_draw(rng, 1, 100)), SKY_HZ)
    assert not make_null(np.zeros((2, 2)), 0.3).filter.any()
    source = np.array([1.0, 1j, 0.0])  # one of three is dead
    null = make_null(np.diag([1.0, 1.0, 0.0]) + 100.0 * np.outer(source, source.conj()), 0.3)
    assert null.n_sources == 1
    assert not null.filter[2].any()
    assert null.filter[:2].any()
