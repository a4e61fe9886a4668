"""Satellites that take each other's place are counted by their law; shade and interference are not."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.detectors.torn.detector import Torn, TornSettings
from skyproof.detectors.torn.exchange import ExchangePast, examine_exchange
from skyproof.detectors.torn.policy import POLICY
from skyproof.records import Cause, Observations, Records
from skyproof.testing import MeasuredScene, TrackErrors

SCENE = MeasuredScene(
    antennas_enu_m={"rx1": (0.0, 0.0, 0.0)}, epochs=60, errors=TrackErrors(sigma_m=1.0, constant_m=1.0)
)


def draw_scene(seed: int = 0) -> Records:
    return SCENE.records(np.random.default_rng(seed))


def keep_tracked(o: Observations, tracked: np.ndarray, *, cn0_dbhz: float = 45.0) -> Observations:
    """Return measurements of the satellites that are tracked (n_epochs, n_signals), the others without a range."""
    codes_m = np.where(tracked, o.pseudorange_m, np.nan)
    return replace(o, pseudorange_m=codes_m, cn0_dbhz=np.full(codes_m.shape, cn0_dbhz))


def make_windows(o: Observations, epochs: int = 10) -> tuple[list, ExchangePast]:
    past, found = ExchangePast(), []
    for first in range(0, o.gpst.size, epochs):
        exchange, past = examine_exchange(o.read(first, first + epochs), past)
        found.append(exchange)
    return found, past


def draw_few(rng: np.random.Generator, shape: tuple[int, int], onset: int) -> np.ndarray:
    """Draw two to six satellites an epoch, others at the next, from an epoch on."""
    tracked = np.ones(shape, np.bool_)
    for row in range(onset, shape[0]):
        tracked[row, rng.permutation(shape[1])[rng.integers(2, 7) :]] = False
    return tracked


def draw_chain(rng: np.random.Generator, shape: tuple[int, int], lost: float, found: float) -> np.ndarray:
    """Draw satellites that are lost and found at these rates an epoch, and all lost at once every twenty epochs."""
    tracked = np.ones(shape, np.bool_)
    for row in range(1, shape[0]):
        draws = rng.random(shape[1])
        tracked[row] = np.where(tracked[row - 1], draws >= lost, draws < found) & (row % 20 > 0)
    return tracked


@pytest.mark.parametrize("seed", range(4))
def test_a_torn_receiver_is_found_and_dated(seed) -> None:
    (o,) = draw_scene(seed).observations
    found, _ = make_windows(keep_tracked(o, draw_few(np.random.default_rng(seed), o.status.shape, 23)))
    assert [exchange.p_value < 1e-6 for exchange in found[4:]] == [True, True]
    assert [exchange.p_value for exchange in found[:2]] == [1.0, 1.0]
    assert abs((found[-1].began - o.gpst[23]) / np.timedelta64(1, "s")) <= 2.0


def test_its_finding_is_dated_and_names_shade() -> None:
    records = draw_scene()
    (o,) = records.observations
    o = keep_tracked(o, draw_few(np.random.default_rng(0), o.status.shape, 23))
    detector, state, failed = Torn(TornSettings(false_alarm_probability=1e-6)), None, []
    for first in range(0, 60, 10):
        (evidence,), state = detector.examine(replace(records, observations=(o.read(first, first + 10),)), state)
        failed += [evidence] if evidence.failed else []
    assert failed
    assert {(e.code, e.says, e.data["by"]) for e in failed} == {("torn", "undecided", "exchange")}
    assert {e.may_also_be for e in failed} == {(Cause.SHADE, Cause.INTERFERENCE, Cause.FAULT)}
    assert failed[0].dated_gpst < o.gpst[26]


def test_no_more_false_alarms_than_asked_at_the_bound() -> None:
    rng, p_values = np.random.default_rng(1), []
    (o,) = draw_scene().observations
    for _ in range(150):
        tracked = draw_chain(rng, o.status.shape, POLICY.most_exchanged_share, 0.5)
        p_values += [exchange.p_value for exchange in make_windows(keep_tracked(o, tracked))[0]]
    assert np.mean(np.array(p_values) < 0.05) <= 0.05
    assert np.mean(np.array(p_values) < 0.01) <= 0.01


def test_what_all_lose_and_find_at_once_is_no_exchange() -> None:
    (o,) = draw_scene().observations
    tracked = np.ones(o.status.shape, np.bool_)
    tracked[np.arange(o.gpst.size) % 4 < 2, 2:] = False
    assert {exchange.exchanged for exchange in make_windows(keep_tracked(o, tracked))[0]} == {0}


def test_systems_that_are_written_by_turns_are_no_exchange() -> None:
    (o,) = draw_scene().observations
    half = np.arange(len(o.signals)) % 2 == 0
    beidou = [replace(s, sat=f"C{s.sat[1:]}", band="B1", code="2I") for s in o.signals]
    renamed = [s if first else other for s, other, first in zip(o.signals, beidou, half, strict=True)]
    o = keep_tracked(replace(o, signals=tuple(renamed)), half[None, :] == (np.arange(o.gpst.size) % 2 == 0)[:, None])
    assert {exchange.exchanged for exchange in make_windows(o)[0]} == {0}


def test_weak_satellites_come_and_go_by_noise() -> None:
    (o,) = draw_scene().observations
    tracked = draw_few(np.random.default_rng(2), o.status.shape, 5)
    found, _ = make_windows(keep_tracked(o, tracked, cn0_dbhz=POLICY.weak_dbhz - 1.0))
    assert {exchange.exchanged for exchange in found} == {0}


def test_a_receiver_that_always_exchanges_is_held_against_itself() -> None:
    (o,) = replace(SCENE, epochs=1200).records(np.random.default_rng(0)).observations
    tracked = draw_chain(np.random.default_rng(3), o.status.shape, 0.3, 0.4)
    found, past = make_windows(keep_tracked(o, tracked))
    assert past.rate > POLICY.most_exchanged_share
    assert all(exchange.p_value > 1e-5 for exchange in found)


def test_epochs_across_a_gap_are_not_compared() -> None:
    (o,) = draw_scene().observations
    o = keep_tracked(o, draw_few(np.random.default_rng(4), o.status.shape, 0))
    before, past = examine_exchange(o.read(0, 20), ExchangePast())
    after, _ = examine_exchange(o.read(40, 60), past)
    assert (before.tracked > 0, after.tracked) == (True, examine_exchange(o.read(40, 60), ExchangePast())[0].tracked)


def test_pieces_give_what_the_whole_gives() -> None:
    (o,) = draw_scene().observations
    o = keep_tracked(o, draw_few(np.random.default_rng(5), o.status.shape, 30))
    _, whole = make_windows(o, 60)
    _, pieces = make_windows(o, 6)
    assert (pieces.score, pieces.began, pieces.tracked) == (whole.score, whole.began, whole.tracked)
