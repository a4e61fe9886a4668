"""Fixes that are none: what residuals reject, and what few satellites put where no receiver is."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.navigation.fix import fix_and_geometry
from skyproof.navigation.screen import NUMBERS, reject_misfits
from skyproof.records import FixStatus
from skyproof.testing import MeasuredScene, TrackErrors

EPOCHS = 30


def screen_fixes(sats: int, late_m: float = 0.0, first: int = EPOCHS, seed: int = 1, **options):
    """Screen fixes by so many satellites; one is late by `late_m` from epoch `first` on."""
    scene = MeasuredScene(epochs=EPOCHS, max_satellites=sats, errors=TrackErrors(sigma_m=1.0))
    records = scene.records(np.random.default_rng(seed))
    observations = records.observations[0]
    ranges_m = observations.pseudorange_m.copy()
    ranges_m[first:, 0] += late_m
    observations = replace(observations, pseudorange_m=ranges_m)
    return reject_misfits(*fix_and_geometry(observations, records.navigation, multipath_sigma_m=1.0), **options)


@pytest.mark.parametrize("sats", [4, 5, 8])
def test_fixes_of_a_true_sky_are_kept(sats):
    assert not screen_fixes(sats).status.any()


def test_residuals_that_fit_no_position_leave_no_fix():
    fix = screen_fixes(8, late_m=500.0, first=20)
    assert set(fix.status[20:].tolist()) == {FixStatus.MISFIT}
    assert not fix.status[:20].any()
    for name in NUMBERS:
        assert np.isnan(getattr(fix, name)[20:]).all()
    assert np.isfinite(fix.position_ecef_m[:20]).all()


@pytest.mark.parametrize("late_m", [-300e3, 300e3])
def test_as_few_satellites_as_unknowns_count_on_earth_only(late_m):
    fix = screen_fixes(4, late_m=late_m, first=20)
    assert (fix.status[20:] == 5).all()
    assert np.isnan(fix.position_ecef_m[20:]).all()
    assert not fix.status[:20].any()


def test_a_receiver_that_ignores_residuals_counts_on_earth():
    fix = screen_fixes(8, late_m=500.0, first=20, with_misfits=True)
    assert not fix.status.any()
    assert np.isfinite(fix.position_ecef_m).all()
    far = screen_fixes(8, late_m=1e6, first=20, with_misfits=True)
    assert (far.status[20:] == 5).all()
