"""Signals that a grid holds are drawn with their own delay, power and phase, and between the taps unchanged."""

import numpy as np
import pytest

from skyproof.app.protect.takeover_pictures import _decompose_epoch
from skyproof.detectors.dccaf.bursts import autocorrelate_code
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.records import Ccaf, SignalId

BAND_HZ = 3.0e6
AMPLITUDE = 60.0
PRN = 7


def make_grid(second_chips, second_db, second_deg, rng, n=4):
    taps = np.arange(-5.0, 6.0) * 0.3
    sizes = np.array([1.0, 10.0 ** (second_db / 20.0) * np.exp(1j * np.radians(second_deg))])
    seen = autocorrelate_code(GPS_L1_CA, PRN, taps[:, None] - np.array([0.1, 0.1 + second_chips]), BAND_HZ) @ sizes
    covariance = autocorrelate_code(GPS_L1_CA, PRN, taps[:, None] - taps, BAND_HZ)
    values, vectors = np.linalg.eigh(covariance)
    white = (rng.standard_normal((n, taps.size)) + 1j * rng.standard_normal((n, taps.size))) / np.sqrt(2.0)
    noise = white @ (vectors * np.sqrt(np.maximum(values, 0.0))).T
    turned = np.exp(2j * np.pi * rng.random(n))[:, None]
    return Ccaf(
        receiver="rx1",
        signals=(SignalId(f"G{PRN:02}", "L1", "CA"),),
        gpst=np.datetime64("2024-01-01T00:00:00", "ns") + np.arange(n) * np.timedelta64(20, "ms"),
        elapsed_s=0.02 * np.arange(n),
        coherent_s=0.02,
        band_hz=BAND_HZ,
        delays_chips=taps,
        dopplers_hz=np.zeros(1),
        reference_m=np.full((n, 1), 2.2e7),
        reference_hz=np.zeros((n, 1)),
        value=(AMPLITUDE * turned * seen + noise)[:, None, None, :],
        noise_variance=np.ones((n, 1)),
    )


@pytest.mark.parametrize(("chips", "db", "deg"), [(-0.5, -6.0, 120.0), (0.7, -3.0, -60.0), (0.4, -9.0, 90.0)])
def test_a_second_signal_is_drawn_with_its_delay_power_and_phase(chips, db, deg):
    rng = np.random.default_rng(3)
    (drawn,) = _decompose_epoch(make_grid(chips, db, deg, rng), np.arange(4), 1.0)
    assert drawn.second_chips == pytest.approx(chips, abs=0.08)
    assert drawn.second_db == pytest.approx(db, abs=1.5)
    assert drawn.second_deg == pytest.approx(deg, abs=12.0)
    inside = np.abs(drawn.delays_chips) < 1.0
    sizes = AMPLITUDE * np.array([1.0, 10.0 ** (db / 20.0) * np.exp(1j * np.radians(deg))])
    true = autocorrelate_code(GPS_L1_CA, PRN, drawn.delays_chips[:, None] - np.array([0.0, chips]), BAND_HZ) @ sizes
    assert np.abs(drawn.value - true)[inside].max() < 0.15 * AMPLITUDE


def test_one_signal_alone_is_not_drawn():
    assert not _decompose_epoch(make_grid(0.5, -200.0, 0.0, np.random.default_rng(3)), np.arange(4), 1.0)
