"""Whether data bits moved: how often it is said of bits that did not, through fades and beats, and that it is seen."""

import numpy as np
import pytest
from scipy import stats

from skyproof.gnss.signals import GPS_L1_CA
from skyproof.receiver.bit_edges import EdgeSums, add_bits, edge_scores, shift_limit

PERIODS_PER_BIT = GPS_L1_CA.periods_per_symbol
N_PERIODS = 200
NOTHING = EdgeSums(periods_per_bit=PERIODS_PER_BIT, since_s=0.0)


def limit(probability):
    return shift_limit(probability, PERIODS_PER_BIT)


def draw_prompts(rng, *, cn0_dbhz, moved=0, start=0, beat=None):
    """Draw complex prompts with noise of variance 1 in both parts and bits that begin `moved` earlier.

    beat : amplitude of a second signal and by how many hertz its carrier differs.
    """
    bits = rng.choice([-1.0, 1.0], N_PERIODS // PERIODS_PER_BIT + 3)
    at = np.arange(N_PERIODS) - start + moved + PERIODS_PER_BIT
    values = np.sqrt(2.0 * 10.0 ** (0.1 * cn0_dbhz) * 1e-3) * bits[at // PERIODS_PER_BIT] * np.exp(6.28j * rng.random())
    if beat is not None:
        share, apart_hz = beat
        values = values * (1.0 + share * np.exp(2j * np.pi * (apart_hz * 1e-3 * np.arange(N_PERIODS) + rng.random())))
    return values + rng.normal(size=N_PERIODS) + 1j * rng.normal(size=N_PERIODS)


def score_of(rng, n_signals, **signal):
    starts = rng.integers(0, PERIODS_PER_BIT, n_signals)
    prompts = np.array([draw_prompts(rng, start=start, **signal) for start in starts])
    firsts = rng.integers(0, 10_000, n_signals)
    sums = add_bits(
        NOTHING,
        prompts,
        firsts,
        ((firsts + starts) % PERIODS_PER_BIT).astype(float),
    )
    return edge_scores(sums)


@pytest.mark.parametrize(
    ("cn0_dbhz", "beat"), [(-20.0, None), (45.0, None), (30.0, (0.9, 10.0)), (45.0, (0.95, 1.0)), (45.0, (1.1, 25.0))]
)
def test_unmoved_bits_are_called_moved_at_most_at_the_rate(cn0_dbhz, beat):
    rng = np.random.default_rng(1)
    stated, n = 0.02, 150
    alarms = sum(score_of(rng, 4, cn0_dbhz=cn0_dbhz, beat=beat).max() > limit(stated) for _ in range(n))
    assert stats.binomtest(alarms, n, stated, alternative="greater").pvalue > 1e-3


@pytest.mark.parametrize("step_db", [-6.0, 6.0])
@pytest.mark.parametrize("n_signals", [5, 20])
def test_strength_that_changes_in_all_signals_moves_no_bits(n_signals, step_db):
    # Jamming that begins, while no bit turns over: what is compared stands for the same time.
    rng = np.random.default_rng(5)
    stated, n, alarms = 0.02, 150, 0
    for _ in range(n):
        gain = np.where(np.arange(N_PERIODS) < rng.integers(60, 140), 1.0, 10.0 ** (0.05 * step_db))
        noise = rng.normal(size=(2, n_signals, N_PERIODS))
        prompts = gain * np.sqrt(2.0 * 10.0**4.2 * 1e-3) + noise[0] + 1j * noise[1]
        starts = rng.integers(0, PERIODS_PER_BIT, n_signals).astype(float)
        sums = add_bits(NOTHING, prompts, np.zeros(n_signals, np.int64), starts)
        alarms += edge_scores(sums).max() > limit(stated)
    assert stats.binomtest(alarms, n, stated, alternative="greater").pvalue > 1e-3


@pytest.mark.parametrize("beat", [None, (0.9, 10.0)])
@pytest.mark.parametrize("moved", [1, 10, 19])
def test_bits_that_moved_are_seen_in_a_few_looks(moved, beat):
    rng = np.random.default_rng(2)
    sums = NOTHING
    for _ in range(3):
        prompts = np.array([draw_prompts(rng, cn0_dbhz=43.0, moved=moved, beat=beat) for _ in range(6)])
        sums = add_bits(sums, prompts, np.zeros(6, np.int64), np.zeros(6))
    assert edge_scores(sums).max() > limit(1e-6)


def test_the_strength_of_a_signal_does_not_matter():
    rng = np.random.default_rng(3)
    prompts = np.array([draw_prompts(rng, cn0_dbhz=40.0) for _ in range(4)])
    same, louder = (add_bits(NOTHING, factor * prompts, np.zeros(4, np.int64), np.zeros(4)) for factor in (1.0, 1e4))
    np.testing.assert_allclose(edge_scores(same), edge_scores(louder))


def test_too_few_bits_say_nothing():
    rng = np.random.default_rng(4)
    prompts = draw_prompts(rng, cn0_dbhz=45.0, moved=5)[None]
    sums = add_bits(NOTHING, prompts, np.zeros(1, np.int64), np.zeros(1))
    assert 0 < sums.n_bits < 15
    assert not edge_scores(sums).any()
