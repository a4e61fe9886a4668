"""One loop: what is fed in pieces of any size gives what the whole gives, window by window."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skyproof.app.common.epoch_source import FedSource, WholeSource
from skyproof.app.common.progress import Silent
from skyproof.app.common.session import Session, examine_all, open_session
from skyproof.app.common.settings import Settings
from skyproof.app.common.windows import widen_windows, windows_of
from skyproof.navigation.predictor import Standing
from skyproof.records import OBSERVABLES, ConsistentSet, NavigationData, Observations, Records, SignalId
from skyproof.testing import MeasuredScene

PLACES = {"rx1": (0.0, 0.0, 0.0), "rx2": (12.0, 16.0, 0.0)}
STANDS = {"rx1": Standing(stands=True, oscillator=None, by=("standing",), assumes=("receiver_stands",))}
START = np.datetime64("2024-05-14T10:00:00", "ns")


@pytest.fixture(scope="module")
def scene():
    return MeasuredScene(epochs=47, antennas_enu_m=PLACES).records(np.random.default_rng(3))


class Cut(list):
    """Windows that are made already."""

    window_s = 10.0
    run = windows_of([], NavigationData(ephemerides=()), Settings()).run


def summarize_step(step):
    """Return what of a window has to be the same."""
    records, word = step.records, step.deciding
    found = [(e.detector, e.code, e.signals, dict(e.p), e.alpha, e.dated_gpst, str(e.data)) for e in step.findings]
    return records.start_gpst, records.end_gpst, found, word.words, word.word


def feed_session(scene, sizes):
    """Feed the receivers' epochs in pieces of such sizes, in turn, and return the session's steps."""
    sources = [FedSource(o.receiver) for o in scene.observations]
    session = open_session(sources, scene.navigation, Settings(), STANDS)
    given_to, steps = [0] * len(sources), []
    n = scene.observations[0].gpst.size
    turn = 0
    while min(given_to) < n:
        k = turn % len(sources)
        size = sizes[turn % len(sizes)]
        sources[k].feed(scene.observations[k].read(given_to[k], given_to[k] + size))
        given_to[k] = min(given_to[k] + size, n)
        steps += session.steps()
        turn += 1
    for source in sources:
        source.end()
    return steps, [*steps, *session.steps()]


@settings(max_examples=3, deadline=None)
@given(sizes=st.lists(st.integers(1, 30), min_size=1, max_size=5))
def test_pieces_of_any_size_give_what_the_whole_gives(scene, sizes):
    whole = open_session([WholeSource(o) for o in scene.observations], scene.navigation, Settings(), STANDS)
    steps = list(whole.steps())
    assert [summarize_step(step) for step in feed_session(scene, sizes)[1]] == [summarize_step(step) for step in steps]
    assert any(e.detector == "place" and e.code == "there" for step in steps for e in step.findings)


@pytest.mark.parametrize("seed", range(6))
def test_gaps_rates_and_starts_move_no_window_that_was_given(seed):
    rng = np.random.default_rng(seed)
    logs = [draw_epochs(f"rx{k}", rng) for k in range(int(rng.integers(1, 4)))]
    chosen, nothing = widen_windows(Settings(), logs), NavigationData(ephemerides=())
    sources = [FedSource(o.receiver) for o in logs]
    windows, found, given_to = windows_of(sources, nothing, chosen), [], [0] * len(logs)
    while remaining := [k for k, o in enumerate(logs) if given_to[k] < o.gpst.size]:
        k, size = int(rng.choice(remaining)), int(rng.integers(1, 25))
        sources[k].feed(logs[k].read(given_to[k], given_to[k] + size))
        given_to[k] += size
        if given_to[k] >= logs[k].gpst.size:
            sources[k].end()
        found += [(window.start_gpst, window.end_gpst) for window in windows]
    whole = windows_of([WholeSource(o) for o in logs], nothing, chosen)
    assert found == [(window.start_gpst, window.end_gpst) for window in whole]


def draw_epochs(receiver, rng):
    """Draw epochs of one signal with some interval, start, gaps, and perhaps a break of its time."""
    n = int(rng.integers(20, 150))
    elapsed_s = float(rng.choice([0.2, 1.0, 5.0, 30.0])) * np.arange(n)
    kept = np.ones(n, bool)
    for _ in range(int(rng.integers(0, 4))):
        first = int(rng.integers(1, n - 1))
        kept[first : first + int(rng.integers(1, 30))] = False
    kept[-1] = True
    start = START + np.timedelta64(int(1e9 * rng.choice([0.0, rng.uniform(0.0, 15.0)])), "ns")
    whole = Observations(
        receiver=receiver,
        signals=(SignalId("G05"),),
        gpst=start + np.round(elapsed_s * 1e9).astype("timedelta64[ns]"),
        elapsed_s=elapsed_s,
        status=np.zeros((n, 1), np.uint8),
        found_elapsed_s=np.zeros(1),
        missed_elapsed_s=np.full(1, np.nan),
        **dict.fromkeys(OBSERVABLES, np.ones((n, 1))),
    )
    return whole.select(np.flatnonzero(kept))


def test_windows_come_before_the_end():
    records = MeasuredScene(epochs=47, antennas_enu_m={"rx1": PLACES["rx1"]}).records(np.random.default_rng(4))
    before, steps = feed_session(records, [1])
    assert (len(before), len(steps)) == (4, 5)


def test_the_first_window_comes_half_a_window_after_its_end():
    records = MeasuredScene(epochs=47, antennas_enu_m={"rx1": PLACES["rx1"]}).records(np.random.default_rng(4))
    source = FedSource("rx1")
    session = open_session([source], records.navigation, Settings())
    seen = []
    for row in range(20):
        source.feed(records.observations[0].read(row, row + 1))
        seen.append(len(list(session.steps())))
    assert seen.index(1) == 15


def test_signals_that_come_later_change_no_window_before(scene):
    (o, *_), late = scene.observations, 25
    part = o.select_channels(np.arange(1, len(o.signals)))
    pieces = [part.read(0, late), o.read(late, o.gpst.size)]
    source = FedSource(o.receiver)
    for piece in pieces:
        source.feed(piece)
    source.end()
    session = open_session([source], scene.navigation, Settings())
    whole = open_session([WholeSource(Observations.join(pieces))], scene.navigation, Settings())
    assert [summarize_step(step) for step in session.steps()] == [summarize_step(step) for step in whole.steps()]


def test_a_break_of_time_cuts_what_is_fed_as_it_cuts_the_whole():
    records = MeasuredScene(epochs=47, antennas_enu_m={"rx1": PLACES["rx1"]}).records(np.random.default_rng(4))
    (o,) = records.observations
    later = np.arange(47) >= 23
    broken = replace(records, observations=(replace(o, pseudorange_m=o.pseudorange_m - 99e3 * later[:, None]),))
    whole = open_session([WholeSource(broken.observations[0])], records.navigation, Settings(), STANDS)
    steps = [summarize_step(step) for step in whole.steps()]
    assert any(start == o.gpst[23] - np.timedelta64(500, "ms") for start, *_ in steps)
    assert [summarize_step(step) for step in feed_session(broken, [1])[1]] == steps


def test_what_is_remembered_stops_growing():
    records = MeasuredScene(epochs=420, antennas_enu_m={"rx1": PLACES["rx1"]}).records(np.random.default_rng(4))
    session = open_session([WholeSource(records.observations[0])], records.navigation, Settings())
    sizes = [len(pickle.dumps((session._states, session._deciding))) for _ in session.steps()]
    assert max(sizes[25:]) <= 1.01 * sizes[24]


def test_nothing_is_fed_after_the_end(scene):
    source = FedSource("rx1")
    source.end()
    with pytest.raises(ValueError, match="rx1"):
        source.feed(scene.observations[0])


def test_a_short_window_has_its_share_of_the_false_alarms():
    records = MeasuredScene(epochs=40, antennas_enu_m={"rx1": PLACES["rx1"]}).records(np.random.default_rng(1))
    (o,) = records.observations
    later = np.arange(40) >= 4
    broken = replace(o, pseudorange_m=o.pseudorange_m - np.where(later, 99_000.0, 0.0)[:, None])
    session = open_session([WholeSource(broken)], records.navigation, Settings())
    alphas = [
        {e.detector: e.alpha for e in step.findings if e.alpha is not None}.get("residual") for step in session.steps()
    ]
    assert alphas[0] == pytest.approx(0.35 * alphas[1])
    assert alphas[1] == alphas[2]


def test_the_sets_of_every_window_are_kept_however_long_the_run():
    found_set = ConsistentSet(
        receiver="rx1",
        signals=(SignalId("G05"),),
        gpst=START,
        position_ecef_m=np.zeros(3),
        clock_bias_s=0.0,
        covariance_m2=np.eye(4),
        statistic=0.0,
        dof=0,
        p_value=1.0,
    )
    windows = [
        Records(start_gpst=START, end_gpst=START, sets=(replace(found_set, clock_bias_s=number),))
        for number in range(700)
    ]
    _, sets, _ = examine_all(Session(Cut(windows), []), Silent())
    assert [s.clock_bias_s for s in sets] == list(range(700))
