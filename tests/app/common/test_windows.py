from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from skyproof.app.common.epoch_source import WholeSource
from skyproof.app.common.settings import Settings
from skyproof.app.common.windows import (
    RECEIVED,
    asked,
    instantiate_detectors,
    measure_levels_between_signals,
    widen_windows,
    windows_of,
)
from skyproof.detectors.code_doppler.detector import CodeDoppler
from skyproof.detectors.correlators.beats_detector import Beats
from skyproof.detectors.correlators.sqm_detector import Sqm
from skyproof.detectors.registry import load_detectors
from skyproof.records import (
    OBSERVABLES,
    Ccaf,
    NavigationData,
    Need,
    Observations,
    Records,
    SignalId,
    SpinArm,
    Taps,
)
from skyproof.testing import MeasuredScene

START = np.datetime64("2022-01-01", "ns")
ARM = SpinArm(receiver="rx1", radius_m=0.1, rate_rad_s=1.0)


def sum_shares():
    """Sum the shares of the false alarms that detectors take which any run may use."""
    kinds = [kind for kind in load_detectors().values() if RECEIVED.issuperset(kind().needs)]
    return sum(getattr(kind, "share", 1.0) for kind in kinds)


def share(run):
    (detector,) = (d for d in instantiate_detectors(Settings(), run) if d.name == "second_signals")
    return detector.settings.false_alarm_probability


def test_a_detector_without_equipment_gets_no_false_alarm_share():
    settings = Settings()
    of_a_window = settings.false_alarm_probability_per_hour * settings.window_s / 3600.0
    bare = Records(start_gpst=START, end_gpst=START)
    turning = Records(start_gpst=START, end_gpst=START, spin_arms=(ARM,))
    assert share(bare) == pytest.approx(of_a_window / sum_shares())
    assert share(turning) == pytest.approx(of_a_window / (sum_shares() + 1.0))


def test_what_never_accuses_takes_no_share_but_tests_at_its_rate():
    detectors = {
        d.name: d.settings.false_alarm_probability
        for d in instantiate_detectors(Settings(), Records(start_gpst=START, end_gpst=START))
    }
    assert detectors["torn"] == detectors["residual"]
    assert detectors["code_motion"] == pytest.approx(0.05 * detectors["residual"])


def make_epochs(step_s, n, late_s=0.0):
    """Make empty observations at epochs that come a little early or late."""
    elapsed_s = step_s * np.arange(n) + late_s * np.resize([0.0, 1.0, 0.0, -1.0], n)
    cells = dict.fromkeys(
        OBSERVABLES,
        np.ones((n, 1)),
    )
    return Observations(
        receiver="rx1",
        signals=(SignalId("G05"),),
        gpst=START + np.round(elapsed_s * 1e9).astype("timedelta64[ns]"),
        elapsed_s=elapsed_s,
        status=np.zeros((n, 1), np.uint8),
        found_elapsed_s=np.zeros(1),
        missed_elapsed_s=np.full(1, np.nan),
        **cells,
    )


@pytest.mark.parametrize(("step_s", "window_s"), [(0.05, 10.0), (1.0, 10.0), (2.0, 10.0), (5.0, 25.0), (30.0, 150.0)])
def test_windows_hold_five_epochs_or_more_at_any_interval(step_s, window_s):
    fast, slow = make_epochs(0.1, 10), make_epochs(step_s, 41, late_s=0.002 * step_s)
    settings = widen_windows(Settings(), [fast, slow])
    assert settings.window_s == pytest.approx(window_s, rel=1e-3)
    windows = windows_of([WholeSource(slow)], NavigationData(ephemerides=()), settings)
    counts = [window.observations[0].gpst.size for window in windows if window.observations]
    assert min(counts) >= 5
    assert sum(counts) == 41
    (detector,) = (d for d in instantiate_detectors(settings, windows.run) if d.name == "second_signals")
    usual = sum_shares()
    of_a_window = settings.false_alarm_probability_per_hour * settings.window_s / 3600.0
    assert detector.settings.false_alarm_probability == pytest.approx(of_a_window / usual)


def test_each_correlator_snapshot_is_in_exactly_one_window():
    # Looks lie to both sides of the epoch whose block they belong to; where the clock's label steps they go along.
    observations = (
        MeasuredScene(epochs=40, antennas_enu_m={"rx1": (0.0, 0.0, 0.0)})
        .records(np.random.default_rng(1))
        .observations[0]
    )
    later = np.where(np.arange(40) < 25, 0, 7).astype("timedelta64[ms]")
    observations = replace(observations, gpst=observations.gpst + later)
    elapsed_s = (observations.elapsed_s[:, None] + np.arange(-0.5, 0.45, 0.1)).ravel()
    value = np.repeat(np.arange(40.0), 10)[:, None, None, None] * np.ones((1, len(observations.signals), 1, 1))
    taps = Taps(
        receiver="rx1",
        signals=observations.signals,
        elapsed_s=elapsed_s,
        delays_chips=np.zeros(1),
        dopplers_hz=np.zeros(1),
        value=value.astype(np.complex64),
    )
    windows = windows_of([WholeSource(observations)], NavigationData(ephemerides=()), Settings(window_s=12.0), [taps])
    seen = []
    for records in windows:
        (part,), (observed,) = records.taps, records.observations
        epochs = np.flatnonzero(np.isin(observations.gpst, observed.gpst))
        assert part.value[:, 0, 0, 0].real.tolist() == np.repeat(epochs, 10).tolist()
        seen += part.elapsed_s.tolist()
    assert seen == elapsed_s.tolist()


def test_correlators_are_those_that_detectors_ask_for():
    together = asked()
    for need, kind in ((Need.TAPS, "taps"), (Need.CCAF, "ccaf")):
        wanting = [detector for detector in load_detectors().values() if need in detector().needs]
        stated = [
            request for item in wanting if (request := getattr(getattr(item, "asks", None), kind, None)) is not None
        ]
        assert len(stated) <= 1
        assert getattr(together, kind) == (stated[0] if stated else None)
    assert together.taps is not None


def test_a_run_with_correlators_shares_the_false_alarms_with_tests_of_them():
    settings = Settings()
    of_a_window = settings.false_alarm_probability_per_hour * settings.window_s / 3600.0
    taps = Taps(
        receiver="rx1",
        signals=(),
        elapsed_s=np.zeros(0),
        delays_chips=np.zeros(1),
        dopplers_hz=np.zeros(1),
        value=np.zeros((0, 0, 1, 1), np.complex64),
    )
    run = Records(start_gpst=START, end_gpst=START, taps=(taps,))
    of_correlators = (Sqm, Beats, CodeDoppler)
    assert share(run) == pytest.approx(of_a_window / (sum_shares() + len(of_correlators)))


def test_a_window_ends_where_a_receivers_time_breaks():
    rng = np.random.default_rng(1)
    (whole,) = MeasuredScene(epochs=40, antennas_enu_m={"rx1": (0.0, 0.0, 0.0)}).records(rng).observations
    later = np.arange(40) >= 4
    broken = replace(whole, pseudorange_m=whole.pseudorange_m - np.where(later, 99_000.0, 0.0)[:, None])
    windows = windows_of([WholeSource(broken)], NavigationData(ephemerides=()), Settings(window_s=10.0))
    assert [window.observations[0].gpst.size for window in windows] == [4, 10, 10, 10, 6]
    plain = windows_of([WholeSource(whole)], NavigationData(ephemerides=()), Settings(window_s=10.0))
    assert [window.observations[0].gpst.size for window in plain] == [10, 10, 10, 10]


@pytest.mark.parametrize(("more", "windows"), [(0, 6), (1, 6), (2, 7)])
def test_one_epoch_of_one_receiver_alone_makes_no_window(more, windows):
    receivers = (make_epochs(30.0, 30), replace(make_epochs(30.0, 30 + more), receiver="rx2"))
    settings = widen_windows(Settings(), receivers)
    made = list(windows_of([WholeSource(o) for o in receivers], NavigationData(ephemerides=()), settings))
    assert len(made) == windows
    assert all(records.observations for records in made)


@pytest.mark.parametrize("pause", [np.timedelta64(95, "s"), np.timedelta64(17 * 365, "D")])
def test_a_pause_of_years_is_one_window(pause):
    before = make_epochs(1.0, 60)
    gpst = np.concatenate([before.gpst, before.gpst[-1] + pause + np.arange(40) * np.timedelta64(1, "s")])
    result = make_epochs(1.0, 100)
    log = replace(result, gpst=gpst, elapsed_s=(gpst - gpst[0]) / np.timedelta64(1, "s"))
    windows = windows_of([WholeSource(log)], NavigationData(ephemerides=()), Settings())
    held = [int(((gpst >= start) & (gpst < end)).sum()) for start, end in pairwise(windows.edges())]
    assert sum(held) == 100
    assert sum(count == 0 for count in held) == 1
    assert len(windows) <= 12


def test_grids_give_the_level_between_the_signals():
    # In place of a front end's readings; the mean of the signals at each instant, NaN where none is measured.
    o = MeasuredScene(epochs=4).records(np.random.default_rng(1)).observations[0]
    n = len(o.signals)
    noise = np.full((4, n), 10.0)
    noise[1], noise[2, 1:] = np.nan, np.nan
    grids = Ccaf(
        receiver=o.receiver,
        signals=o.signals,
        gpst=o.gpst,
        elapsed_s=o.elapsed_s,
        coherent_s=0.02,
        band_hz=3e6,
        delays_chips=np.zeros(1),
        dopplers_hz=np.zeros(1),
        reference_m=np.zeros((4, n)),
        reference_hz=np.zeros((4, n)),
        value=np.zeros((4, n, 1, 1), complex),
        noise_variance=noise,
    )
    levels = measure_levels_between_signals(grids)
    np.testing.assert_allclose(levels.noise_db, [10.0, 10.0, 10.0])
    np.testing.assert_array_equal(levels.gpst, o.gpst[[0, 2, 3]])
    assert set(levels.band) == {"L1"}
    assert np.isnan(levels.agc_db).all()
