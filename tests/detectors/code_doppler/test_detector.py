"""Codes that leave their Dopplers in a receiver's window: who is named, and when nobody is."""

from dataclasses import replace

import numpy as np
import pytest
from tests.detectors import nulls
from tests.detectors.code_doppler.test_coherence import move, receive

from skyproof.detectors.code_doppler.detector import CodeDoppler
from skyproof.records import Cause, Finding, Observations
from skyproof.testing import MeasuredScene


def examine(o: Observations, *, correlators: bool = True) -> list[Finding]:
    """Examine a window of a receiver."""
    records = MeasuredScene(epochs=3).records(np.random.default_rng(0))
    records = replace(records, observations=(o,))
    found, _ = CodeDoppler().examine(nulls.track(records) if correlators else records)
    return found


def shift(o: Observations, columns: list[int], carrier_m_s: float) -> Observations:
    """Return the observations with carriers that are off beside their codes."""
    for column in columns:
        o = move(o, column, carrier_m_s=carrier_m_s)
    return o


@pytest.mark.parametrize("columns", [[2], [1, 4, 6], [0, 1, 2, 3]])
def test_codes_that_leave_their_dopplers_are_named(columns: list[int]) -> None:
    o = receive()
    (found,) = examine(shift(o, columns, 47.6))
    assert found.says == "spoofed"
    assert [ref.signal for ref in found.signals] == [o.signals[k] for k in columns]
    assert max(found.p.values()) < 1e-9


def test_most_of_the_signals_may_be_those_of_two_oscillators() -> None:
    (found,) = examine(shift(receive(), [0, 1, 2, 3, 4], 47.6))
    assert found.says == "attack"
    assert len(found.signals) == 8


def test_two_oscillators_are_no_attack() -> None:
    (found,) = examine(shift(receive(), list(range(8)), 47.6))
    assert not found.failed


def test_clean_codes_go_with_their_dopplers() -> None:
    (found,) = examine(receive())
    assert found.code == "coherent"
    assert found.p[Cause.CLEAN] == pytest.approx(1.0)


def test_without_correlators_or_epochs_nothing_is_tested() -> None:
    assert examine(receive(), correlators=False)[0].code == "without_taps"
    assert examine(receive().select(slice(5)))[0].code == "few_epochs"
