"""Noise of codes against what is stated of it."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.navigation.code_noise import compare_code_noise, estimate_noise_factors, raise_code_sigmas
from skyproof.records import CellStatus, Observations
from skyproof.testing import MeasuredScene

SCENE = MeasuredScene(antennas_enu_m={"rx1": (0.0, 0.0, 0.0)}, epochs=60)


def draw(seed: int, factor: float) -> Observations:
    """Draw measurements whose codes are so much noisier than stated."""
    rng = np.random.default_rng(seed)
    (o,) = SCENE.records(rng).observations
    codes_m = SPEED_OF_LIGHT_M_S / o.carrier_hz * o.carrier_cyc + factor * o.pseudorange_sigma_m * rng.standard_normal(
        o.pseudorange_m.shape
    )
    return replace(o, pseudorange_m=codes_m)


def test_noise_is_measured_beside_slips_and_a_jump() -> None:
    o = draw(1, 6.0)
    carrier, status = o.carrier_cyc.copy(), o.status.copy()
    carrier[20:, 0] += 1e5
    carrier[30:] += 800.0
    status[40] = CellStatus.SLIP
    carrier[40:] += 1e6
    slipped = replace(o, carrier_cyc=carrier, status=status)
    ((kind, factor),) = estimate_noise_factors([compare_code_noise(slipped)]).items()
    assert kind == o.signals[0].kind
    assert factor == pytest.approx(6.0, rel=0.15)
    np.testing.assert_allclose(raise_code_sigmas(o, {kind: 6.0}), 6.0 * o.pseudorange_sigma_m)


def test_noise_as_stated_or_smaller_raises_nothing() -> None:
    assert not any(estimate_noise_factors([compare_code_noise(draw(seed, 1.0))]) for seed in range(100))
    assert not estimate_noise_factors([compare_code_noise(draw(1, 0.1))])


def test_what_has_no_carrier_is_left_as_stated() -> None:
    o = draw(2, 6.0)
    without = replace(o, carrier_cyc=np.full_like(o.carrier_cyc, np.nan))
    assert estimate_noise_factors([compare_code_noise(without)]) == {}
