"""Carriers that begin anew, and are not marked by the receiver."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.navigation.rates import fill_dopplers
from skyproof.navigation.slips import mark_slips
from skyproof.records import CellStatus
from skyproof.testing import MeasuredScene

(SEEN,) = (
    MeasuredScene(antennas_enu_m={"rx1": (0.0, 0.0, 0.0)}, epochs=20).records(np.random.default_rng(1)).observations
)
CYCLES = np.where(np.arange(20) >= 12, 300.0, 0.0)[:, None] * np.where(np.arange(len(SEEN.signals)) < 3, 1.0, 0.0)


@pytest.mark.parametrize("with_doppler", [True, False])
def test_carriers_that_code_and_doppler_contradict_are_marked(with_doppler: bool) -> None:
    doppler_hz = SEEN.doppler_hz if with_doppler else np.full_like(SEEN.doppler_hz, np.nan)
    marked = mark_slips(replace(SEEN, carrier_cyc=SEEN.carrier_cyc + CYCLES, doppler_hz=doppler_hz))
    assert set(zip(*np.nonzero(marked.status == CellStatus.SLIP), strict=True)) == {(12, 0), (12, 1), (12, 2)}
    filled, _ = fill_dopplers(marked)
    np.testing.assert_allclose(filled.doppler_hz, SEEN.doppler_hz, atol=1.0)


def test_a_clock_that_steps_and_codes_that_jump_mark_nothing() -> None:
    step_m = np.where(np.arange(20) >= 12, 1500.0, 0.0)[:, None]
    codes_m = SEEN.pseudorange_m + step_m
    stepped = replace(
        SEEN, pseudorange_m=codes_m, carrier_cyc=SEEN.carrier_cyc + step_m * SEEN.carrier_hz / SPEED_OF_LIGHT_M_S
    )
    assert mark_slips(stepped) is stepped
    jumped = replace(SEEN, pseudorange_m=codes_m)
    assert mark_slips(jumped) is jumped
