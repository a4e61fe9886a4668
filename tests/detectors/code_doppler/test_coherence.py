"""Codes and their Dopplers: what leaves them together, and what parts them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from skyproof.detectors.code_doppler.coherence import coherence_p_values, measure_parting_m_s
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.records import Observations
from skyproof.testing import MeasuredScene

SCENE = MeasuredScene(antennas_enu_m={"rx1": (0.0, 0.0, 0.0)}, epochs=11, max_satellites=8)
CHIP_M = SPEED_OF_LIGHT_M_S / 1.023e6
SECONDS = np.arange(11.0)


def receive(seed: int = 0) -> Observations:
    """Return ten seconds of a clean sky."""
    return SCENE.records(np.random.default_rng(seed)).observations[0]


def move(o: Observations, column: int, *, code_m: np.ndarray | float = 0.0, carrier_m_s: float = 0.0) -> Observations:
    """Return the observations with a code that moves, (n_epochs,), and a carrier that does by itself."""
    ranges_m, dopplers_hz = o.pseudorange_m.copy(), o.doppler_hz.copy()
    ranges_m[:, column] += code_m
    dopplers_hz[:, column] -= carrier_m_s * o.carrier_hz[column] / SPEED_OF_LIGHT_M_S
    return replace(o, pseudorange_m=ranges_m, doppler_hz=dopplers_hz)


def measure_all(o: Observations) -> np.ndarray:
    return coherence_p_values(o, np.arange(len(o.signals)), 1.0)


@pytest.mark.parametrize("drawn_chips", [0.0, 0.25])
def test_two_ways_part_a_code_at_most_at_its_rate(drawn_chips: float) -> None:
    # The second case is the farthest that a mean may lie under the null.
    p_values = []
    for seed in range(300):
        o = receive(seed)
        drawn_m = np.where(SECONDS >= 5.0, drawn_chips * CHIP_M, 0.0) * SECONDS / 10.0
        p_values.append(measure_all(move(o, 0, code_m=drawn_m))[0])
    for asked in (0.1, 0.01):
        found = int((np.array(p_values) < asked).sum())
        assert stats.binomtest(found, 300, asked, alternative="greater").pvalue > 1e-4


@pytest.mark.parametrize(
    ("code_m", "carrier_m_s"),
    [
        (30.0 * SECONDS, 30.0),  # a reflector that moves, or a satellite's clock or orbit
        (np.where(SECONDS > 4.5, 1.4 * CHIP_M, 0.0), 0.0),  # the direct signal is blocked
        (0.2 * CHIP_M * np.sin(SECONDS), 0.0),  # a reflection that fades
        (0.7 * CHIP_M * (SECONDS > 3.5) + 0.7 * CHIP_M * (SECONDS > 7.5), 0.0),  # from reflection to reflection
        (0.4 * CHIP_M * (SECONDS % 4 < 2) - 0.1 * SECONDS, 0.0),  # a loop beside a strong reflection
        (-150.0 * (SECONDS % 10), 0.0),  # and one that falls behind and jumps back
        (0.0, 2 * SPEED_OF_LIGHT_M_S / 1575.42),  # a strong signal's cross-correlation, 2 kHz off
    ],
)
def test_one_way_moves_code_and_carrier_alike(code_m: np.ndarray, carrier_m_s: float) -> None:
    p_values = measure_all(move(receive(), 3, code_m=code_m, carrier_m_s=carrier_m_s))
    assert p_values.min() > 1e-3


@pytest.mark.parametrize("carrier_m_s", [38.1, -47.6])
def test_a_carrier_shifted_beside_its_code_is_named(carrier_m_s: float) -> None:
    # 200 and 250 Hz, as in tables 2 and 3 of Zhang and others.
    p_values = measure_all(move(receive(), 3, carrier_m_s=carrier_m_s))
    assert p_values[3] < 1e-12
    assert np.delete(p_values, 3).min() > 1e-3


def test_two_oscillators_part_all_alike() -> None:
    o = receive()
    for column in range(8):
        o = move(o, column, carrier_m_s=40.0)
    assert measure_all(o).max() < 1e-12
    rates_m_s = measure_parting_m_s(o, np.arange(8))
    assert rates_m_s == pytest.approx(-40.0, abs=1.0)
    assert coherence_p_values(o, np.arange(8), 1.0, rates_m_s[0]).min() > 1e-3


def test_a_few_epochs_test_nothing() -> None:
    o = move(receive(), 3, carrier_m_s=38.1)
    assert (measure_all(o.select(slice(5))) == 1.0).all()
