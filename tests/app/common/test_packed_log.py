"""Evidence packed and read again."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skyproof.app.common import packed_log
from skyproof.app.common.packed_log import PackedLog
from skyproof.records import Baseline, Evidence, SignalId, SignalRef

START = np.datetime64("2024-03-03T12:00:00", "ns")


def make_piece(number, rng):
    """Make a piece of a recording with every kind of content that a piece can have."""
    window = number // 12
    subject = tuple(SignalRef("rx1", SignalId(f"G{sat:02d}", "L1", "CA", "a")) for sat in range(1, 25))
    baseline = Baseline(
        receivers=("rx1", "rx2"),
        start_gpst=START,
        end_gpst=START,
        enu_m=rng.normal(size=(1, 3)),
        covariance_m2=np.eye(3) * rng.uniform(),
    )
    return Evidence(
        detector=f"detector-{number % 12}",
        start_gpst=START + np.timedelta64(10 * window, "s"),
        end_gpst=START + np.timedelta64(10 * window + 10, "s"),
        subject=subject,
        says="clean",
        because=f"the statistic is {rng.normal():.3f}",
        statistic=float(rng.normal()),
        p_value=float(rng.uniform()),
        baselines=(baseline,) if number % 12 == 0 else (),
    )


def list_words(evidence):
    return [(e.detector, e.start_gpst, e.subject, e.because, e.p_value, len(e.baselines)) for e in evidence]


@given(n=st.integers(0, 60), places=st.lists(st.integers(-70, 70)), cuts=st.lists(st.integers(0, 60)))
@settings(max_examples=40)
def test_it_is_a_sequence_like_any_other(n, places, cuts):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(packed_log, "PACKED", 7)
        plain = [make_piece(number, np.random.default_rng(number)) for number in range(n)]
        log = PackedLog()
        edges = [0, *sorted(cut for cut in cuts if cut <= n), n]
        for first, end in pairwise(edges):
            log.extend(plain[first:end])
        assert len(log) == n
        assert list_words(log) == list_words(plain)
        assert list_words(log[3:20:2]) == list_words(plain[3:20:2])
        for place in places:
            if -n <= place < n:
                assert list_words([log[place]]) == list_words([plain[place]])
            else:
                with pytest.raises(IndexError):
                    log[place]


@pytest.mark.long
def test_a_day_of_it_takes_a_few_megabytes_of_a_disk():
    rng = np.random.default_rng(1)
    log = PackedLog(make_piece(number, rng) for number in range(12 * 360))
    a_day_mb = 24 * log._ends[-1] / 1e6
    assert 1.0 < a_day_mb < 15.0
    assert log[12].baselines[0].enu_m.shape == (1, 3)
