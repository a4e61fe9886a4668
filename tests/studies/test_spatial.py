"""Sources taken out of an array's samples, against the theory of linearly constrained minimum variance."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skyproof.records import Samples
from skyproof.studies.spatial import filter_of, filtered, signature_of, sinr_share

RATE_HZ = 1e6


def _draw(rng, *shape):
    return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2.0)


def _draw_steering(rng, antennas):
    return np.exp(2j * np.pi * rng.random(antennas))


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), antennas=st.integers(2, 8), share=st.floats(0.0, 0.999))
def test_no_weights_that_null_the_sources_do_better(seed, antennas, share):
    rng = np.random.default_rng(seed)
    sources = int(share * antennas)
    signatures, wanted = _draw(rng, antennas, sources), _draw(rng, antennas)
    mixed = _draw(rng, antennas, antennas)
    covariance = mixed @ mixed.conj().T + 0.1 * np.eye(antennas)
    held = filter_of(covariance, signatures)

    assert np.abs(held @ signatures).max(initial=0.0) < 1e-8 * np.abs(held).max() * np.abs(signatures).max(initial=1.0)
    combined = held @ wanted  # each combination weighted by the signal's own amplitude in it
    weights = held.conj().T @ combined
    reached = np.abs(weights.conj() @ wanted) ** 2 / np.real(weights.conj() @ covariance @ weights)
    assert reached == pytest.approx(np.sum(np.abs(combined) ** 2), rel=1e-6)
    basis = np.linalg.svd(signatures)[0][:, sources:]  # all weights without the sources
    tried = basis @ _draw(rng, antennas - sources, 200)
    rest = np.abs(tried.conj().T @ wanted) ** 2 / np.real(np.sum(tried.conj() * (covariance @ tried), axis=0))
    assert np.all(rest <= reached * (1.0 + 1e-6))


def test_the_share_beside_one_source_is_that_of_the_angle():
    rng = np.random.default_rng(3)
    for antennas in (2, 3, 7):
        wanted, source = _draw_steering(rng, antennas), _draw_steering(rng, antennas)
        held = filter_of(np.eye(antennas), source[:, None])
        like = np.abs(np.vdot(source, wanted) / antennas) ** 2
        assert sinr_share(held, wanted, np.eye(antennas)) == pytest.approx(1.0 - like)


def test_a_covariance_of_few_samples_costs_what_theory_says():
    rng = np.random.default_rng(4)
    antennas, n = 4, 20
    wanted, source = _draw_steering(rng, antennas), _draw_steering(rng, antennas)
    root = np.linalg.cholesky(np.eye(antennas) + 100.0 * np.outer(source, source.conj()))
    true = root @ root.conj().T
    best = np.real(wanted.conj() @ np.linalg.solve(true, wanted))
    shares = []
    for _ in range(2000):
        waves = root @ _draw(rng, antennas, n)
        held = filter_of(waves @ waves.conj().T / n, np.zeros((antennas, 0)))
        weights = held.conj().T @ (held @ wanted)
        shares.append(np.abs(weights.conj() @ wanted) ** 2 / np.real(weights.conj() @ true @ weights) / best)
    expected = (n + 2 - antennas) / (n + 1)
    assert np.mean(shares) == pytest.approx(expected, abs=4.0 * np.std(shares) / np.sqrt(len(shares)))


def test_a_signature_is_found_whatever_the_rows_share():
    rng = np.random.default_rng(5)
    antennas, n, sigma_cyc = 4, 400, 0.02
    source = _draw_steering(rng, antennas) * (0.5, 1.0, 1.0, 2.0)
    sigmas = np.tile(sigma_cyc / np.abs(source), (n, 1))
    phases = np.angle(source) / (2.0 * np.pi) + sigmas * rng.standard_normal((n, antennas)) + rng.random((n, 1))
    phases[0, 2] = np.nan
    found = signature_of(phases, sigmas, np.ones(antennas))
    held = filter_of(np.eye(antennas), found[:, None])
    remaining = np.sum(np.abs(held @ source) ** 2) / np.sum(np.abs(source) ** 2)
    assert remaining < 10.0 * antennas * (2.0 * np.pi * sigma_cyc) ** 2 / n
    with pytest.raises(ValueError, match="all antennas"):
        signature_of(phases[:1], sigmas[:1], np.ones(antennas))


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


@pytest.mark.parametrize("power", [1e-3, 1.0, 1e4])
def test_a_source_of_any_power_is_gone_from_the_samples(power):
    rng = np.random.default_rng(6)
    antennas, n = 3, 25_000
    source, gains = _draw_steering(rng, antennas), np.array([0.3, 1.0, 5.0])
    sent = _draw(rng, n)
    waves = gains[:, None] * (np.sqrt(power) * np.outer(source, sent) + _draw(rng, antennas, n))
    known = (gains * source)[:, None]
    out = filtered(_make_recording(waves), lambda _: known, block_s=0.01)
    planes = out.read_all(0, n)
    like = (planes[:, 0] + 1j * planes[:, 1]) @ sent.conj() / n
    assert np.abs(like).max() < 4.0 / np.sqrt(n)  # noise alone
    assert np.mean(planes**2) == pytest.approx(0.5 * (antennas - 1) / antennas, rel=0.02)


@settings(max_examples=40, deadline=None)
@given(
    starts=st.lists(st.tuples(st.integers(0, 3300), st.integers(0, 1500), st.integers(0, 2)), min_size=1, max_size=6)
)
def test_a_stretch_is_the_same_whatever_was_read_before(starts):
    rng = np.random.default_rng(7)
    waves = _draw(rng, 3, 3217)
    waves[:, 1000:2100] = 0.0  # a whole block of them
    out = filtered(_make_recording(waves), block_s=1e-3)
    whole = filtered(_make_recording(waves), block_s=1e-3).read_all(0, 3217)
    for start, count, antenna in starts:
        part = (out, *out.others)[antenna].read(start, count)
        np.testing.assert_array_equal(part, whole[antenna][:, start : start + count])


def test_what_cannot_be_filtered_is_said():
    rng = np.random.default_rng(8)
    with pytest.raises(ValueError, match="one antenna"):
        filtered(_make_recording(_draw(rng, 1, 100)))
    with pytest.raises(ValueError, match=r"\b2 sources .*\b2 antennas"):
        filter_of(np.eye(2), _draw(rng, 2, 2))
    dead = np.diag([1.0, 1.0, 0.0])  # one of three antennas, two sources
    with pytest.raises(ValueError, match=r"\b2 antennas"):
        filter_of(dead, _draw(rng, 3, 2))
    assert not filter_of(dead, _draw(rng, 3, 1))[2].any()
