"""The detector of two skies in overlapping signals: the contract, and an attack that it names."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.detectors.dccaf import Dccaf, DccafSettings, delays_of
from skyproof.detectors.decomposition import delay_dictionary, noise_variance, simulate_taps
from skyproof.errors import SettingsError
from skyproof.records import Ccaf
from skyproof.testing import FalseSky, MeasuredScene, TrackErrors, check_detector

RATE_HZ = 10e6
CHIP_M = 299_792_458.0 / 1.023e6
ONE = {"antennas_enu_m": {"rx1": (0.0, 0.0, 0.0)}, "epochs": 3, "errors": TrackErrors(0.3)}
CLEAN = MeasuredScene(**ONE)
SHOWS = (150.0, 0.0, 150.0)
OVERLAPPED = MeasuredScene(false=(FalseSky(antenna_enu_m=(0.0, 0.0, 0.0), shows_enu_m=SHOWS, delay_m=20.0),), **ONE)


def with_ccaf(records, rng):
    """Grids of the observations' last epoch: copy a at the reference, copy b, where there is one, beside it."""
    (o,) = records.observations
    firsts = [k for k, signal in enumerate(o.signals) if signal.copy == "a"]
    where = {signal: k for k, signal in enumerate(o.signals)}
    range_m, delays = o.pseudorange_m[-1], delay_dictionary(RATE_HZ)
    variance = float(noise_variance(45.0, 0.02, RATE_HZ))
    value = []
    for k in firsts:
        both = [0.0]
        other = where.get(replace(o.signals[k], copy="b"))
        if other is not None:
            both.append((range_m[other] - range_m[k]) / CHIP_M)
        turn = np.exp(2j * np.pi * rng.random(len(both))) * np.array([1.0, 0.87])[: len(both)]
        value.append(simulate_taps(np.array(both), turn, np.array(variance), delays, rng))
    n = len(firsts)
    grid = Ccaf(
        receiver=o.receiver, signals=tuple(o.signals[k] for k in firsts), gpst=o.gpst[-1:], elapsed_s=o.elapsed_s[-1:],
        coherent_s=0.02, band_hz=RATE_HZ, delays_chips=delays.points, dopplers_hz=np.zeros(1),
        reference_m=range_m[None, firsts], reference_hz=np.zeros((1, n)), value=np.array(value)[None, :, None, :],
        noise_variance=np.full((1, n), variance),
    )  # fmt: skip
    return replace(records, extras={"ccaf": (grid,)})


def test_dccaf_meets_the_contract():
    settings = DccafSettings(count_runs=1000, multipath_sigma_m=2.0)
    check_detector(
        lambda: Dccaf(settings), lambda rng: with_ccaf(CLEAN.records(rng), rng), np.random.default_rng(1), windows=60,
        conservative="a clean sky would need five false second signals that fit one position",
    )  # fmt: skip


def test_a_sky_shown_two_hundred_metres_off_in_overlapping_signals_is_an_attack():
    rng = np.random.default_rng(2)
    detector = Dccaf(DccafSettings(count_runs=1000))
    told = [detector.examine(with_ccaf(OVERLAPPED.records(rng), rng))[0][0] for _ in range(10)]
    assert sum(evidence.says == "attack" for evidence in told) >= 9
    assert any("second position" in evidence.because for evidence in told)


def test_two_delays_come_where_the_count_says_two_and_one_elsewhere():
    rng = np.random.default_rng(3)
    settings = DccafSettings(count_runs=1000)
    one, two = (with_ccaf(scene.records(rng), rng).extras["ccaf"][0] for scene in (CLEAN, OVERLAPPED))
    assert np.isnan(delays_of(one, 0, settings).delay_chips[:, 1]).all()
    found = delays_of(two, 0, settings)
    assert np.isfinite(found.delay_chips[:, 1]).sum() >= 5


def test_missing_grids_cost_their_channel_only():
    rng = np.random.default_rng(4)
    records = with_ccaf(OVERLAPPED.records(rng), rng)
    grid = records.extras["ccaf"][0]
    value = np.array(grid.value)
    value[:, 0] = np.nan
    less = replace(records, extras={"ccaf": (replace(grid, value=value),)})
    assert Dccaf(DccafSettings(count_runs=1000)).examine(less)[0][0].says == "attack"
    value[:, :-4] = np.nan
    none = replace(records, extras={"ccaf": (replace(grid, value=value),)})
    assert Dccaf(DccafSettings(count_runs=1000)).examine(none)[0][0].says == "undecided"


def test_settings_that_make_no_sense_are_refused():
    with pytest.raises(SettingsError, match="second_signal_probability"):
        DccafSettings(second_signal_probability=0.0)
