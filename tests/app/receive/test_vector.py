"""Vector tracking through a recording: the same in pieces, through a blockage, and given up when it goes wrong."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.app.common.settings import Settings, resolve_settings
from skyproof.app.receive import tracker as tracking
from skyproof.app.receive.reception import observe
from skyproof.errors import SettingsError
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.navigation.fix import fix
from skyproof.receiver import measurement as m
from skyproof.records import Asked, TapsAsked
from skyproof.simulator import scenes
from skyproof.simulator.samples import render_samples
from skyproof.simulator.scenario import FrontEnd, ScenePlace

START = np.datetime64("2024-05-14T09:59:58", "ns")
RATE_HZ = 1.6e6
NAV = make_nominal_constellation(START)
ASKED = Asked(taps=TapsAsked(delays_chips=(0.5, -0.5), every_s=0.02, coherent_s=0.004))


@pytest.fixture(scope="module")
def sky():
    """Render 8 s of clean sky, and its samples."""
    scenario = scenes.make_clean(
        ScenePlace(lat_deg=57.7, lon_deg=11.94, height_m=50.0),
        START,
        duration_s=8.0,
        receivers=1,
        mask_deg=10.0,
        front_end=FrontEnd(rate_hz=RATE_HZ, bandwidth_hz=1.28e6, encoding="int", bits=8),
        seed=3,
    )
    samples = render_samples(scenario, NAV)[0]
    return samples, samples.read(0, samples.n_samples)


def make_tracker(sky, planes=None, nav=NAV, **settings):
    samples, clean = sky
    planes = clean if planes is None else planes
    held = replace(samples, read=lambda first, count: planes[:, first : first + count])
    chosen = Settings(tracking="vector", **settings)
    return tracking._set_up_tracker(held, chosen, nav, False, ASKED, tracking.Workspace())


def run_to_end(tracker):
    while tracker.advance():
        pass
    return tracker


@pytest.fixture(scope="module")
def whole(sky):
    return run_to_end(make_tracker(sky))


def test_the_filter_takes_over_and_is_where_the_receiver_is(whole):
    assert whole.vector.began_s < 5.5
    assert whole.vector.diverged == 0
    assert len(whole.vector.driving) == len(whole.state.channels)
    found = fix(collect_observations(whole), NAV)
    apart_m = whole.vector.filter.mean[:3] - found.position_ecef_m[-1]
    assert np.linalg.norm(apart_m) < 3.0


def collect_observations(tracker):
    o = observe(tracker, NAV).observations
    return o.read(0, o.gpst.size)


def test_pieces_give_what_the_whole_gives(sky, whole, monkeypatch):
    monkeypatch.setattr(tracking, "BLOCK_S", 0.37)
    pieces = run_to_end(make_tracker(sky))
    first, other = whole.measured.whole(), pieces.measured.whole()
    np.testing.assert_array_equal(first.table, other.table)
    np.testing.assert_array_equal(first.turns_rad, other.turns_rad)
    np.testing.assert_array_equal(whole.vector.filter.mean, pieces.vector.filter.mean)


def test_only_guided_channels_give_taps_and_they_centre_on_zero(whole):
    taps = observe(whole, NAV).vector_taps.select_between(0.0, 8.0)
    guided = np.isfinite(taps.value).all(axis=(1, 2, 3))
    assert not guided[taps.elapsed_s < whole.vector.began_s].any()
    assert guided[(taps.elapsed_s > whole.vector.began_s + 0.5) & (taps.elapsed_s < 7.7)].all()
    mean = taps.value[guided][:, :, 0].astype(complex).mean(axis=0)
    order = np.argsort(-taps.delays_chips)
    early, late = np.abs(mean[:, order[0]]), np.abs(mean[:, order[-1]])
    assert np.all(np.abs((early - late) / (early + late)) < 0.05)
    assert np.all(np.abs(np.angle(mean[:, np.argmin(np.abs(taps.delays_chips))])) < 0.05)


def test_a_blocked_channel_goes_on_and_is_there_again_at_once(sky):
    _, clean = sky
    planes = clean.copy()
    gone = slice(int(5.8 * RATE_HZ), int(6.9 * RATE_HZ))
    rng = np.random.default_rng(1)
    planes[:, gone] = rng.normal(0.0, clean.std(), planes[:, gone].shape)
    tracker = run_to_end(make_tracker(sky, planes))
    measured = tracker.measured.whole()
    n = len(tracker.state.channels)
    assert {arc.began for arc in tracker.arcs.values()} == {"found"}
    assert not np.any((measured.elapsed_s > 6.1) & (measured.elapsed_s < 6.7))
    assert np.sum(np.abs(measured.elapsed_s - 7.4) < 0.05) == n
    code_m = 3e8 * measured.column(m.CODE_SIGMA_S)
    assert np.all(code_m[measured.elapsed_s > 7.3] < 10.0)


@pytest.fixture(scope="module")
def weak(sky):
    """Render a sky that falls to 22 dB-Hz at 5.8 s, where no channel holds a phase or measures."""
    _, clean = sky
    planes, first = clean.copy(), int(5.8 * RATE_HZ)
    noise = np.random.default_rng(2).standard_normal(planes[:, first:].shape, np.float32)
    planes[:, first:] += np.sqrt(10.0**2.4 - 1.0) * clean.std() * noise  # of 46 dB-Hz
    planes[:, first:] *= 10.0**-1.2
    return run_to_end(make_tracker(sky, planes)), planes


def test_signals_whose_phase_nobody_holds_still_drive_the_filter(sky, whole, weak):
    tracker, _ = weak
    rows = tracker.measured.whole()
    assert np.sum(rows.elapsed_s > 6.3) < 5  # of eight rows of nine channels
    assert tracker.vector.filter.elapsed_s == whole.vector.filter.elapsed_s
    assert tracker.vector.diverged == 0
    off = tracker.vector.filter.mean - whole.vector.filter.mean
    sigma = np.sqrt(np.diag(tracker.vector.filter.covariance))
    assert np.all(sigma[3:6] < 1.5)  # with nothing measured for 1.4 s they would be 4 m/s and more
    assert np.all(np.abs(off) < 5.0 * sigma)


def test_pieces_give_what_the_whole_gives_where_no_phase_is_held(sky, weak, monkeypatch):
    monkeypatch.setattr(tracking, "BLOCK_S", 0.53)
    tracker, planes = weak
    np.testing.assert_array_equal(tracker.vector.filter.mean, run_to_end(make_tracker(sky, planes)).vector.filter.mean)


def test_a_satellite_that_does_not_drive_is_not_guided(sky, whole):
    sat = sorted({signal.sat for signal in whole.vector.driving})[0]
    tracker = make_tracker(sky, not_driving=(sat,))
    while tracker.examined_s < 6.5:
        tracker.advance()
    assert tracker.vector.agreed > 0
    assert {signal.sat for signal in whole.vector.driving} - {signal.sat for signal in tracker.vector.driving} == {sat}
    rows = tracker.measured.whole()
    (arc,) = (number for number, arc in tracker.arcs.items() if arc.signal.sat == sat)
    assert rows.elapsed_s[rows.arc == arc][-1] == rows.elapsed_s[-1]
    taps = observe(tracker, NAV).vector_taps.select_between(6.0, 6.3)
    guided = {signal.sat: np.isfinite(taps.value[:, k]).any() for k, signal in enumerate(taps.signals)}
    assert not guided.pop(sat, False)
    assert guided
    assert all(guided.values())
    assert f"without {sat}" in tracker.vector.remarks[0]


def test_a_satellite_that_is_no_gps_satellite_is_refused():
    with pytest.raises(SettingsError, match=r"'X1' .*\bG01 to G32"):
        resolve_settings(not_driving=("X1",))


@pytest.mark.long
@pytest.mark.parametrize(
    "wrong_m", [(60.0, 60.0, 50.0, 0.0), (0.0, 0.0, 0.0, 299_792.458)], ids=["100 m", "1 ms of the clock"]
)
def test_a_wrong_filter_is_given_up_in_a_second_and_comes_back(sky, wrong_m):
    tracker = make_tracker(sky)
    while tracker.examined_s < 5.9:
        tracker.advance()
    wrong = tracker.vector.filter
    mean = wrong.mean.copy()
    mean[[0, 1, 2, 6]] += wrong_m
    tracker.vector = replace(tracker.vector, filter=replace(wrong, mean=mean))
    tracker.advance()
    tracker.advance()
    assert tracker.vector.diverged == 1
    run_to_end(tracker)
    assert tracker.vector.agreed > 0
    rows = tracker.measured.whole()
    last = rows.elapsed_s == rows.elapsed_s[-1]
    assert last.sum() == len(tracker.state.channels)
    assert {arc.began for arc in tracker.arcs.values()} == {"found"}


def test_orbits_of_another_day_start_no_filter_and_are_reported(sky):
    other = make_nominal_constellation(START + np.timedelta64(9, "h"))
    moved = replace(
        NAV,
        ephemerides=tuple(replace(e, m0=o.m0) for e in NAV.ephemerides for o in other.ephemerides if o.sat == e.sat),
    )
    tracker = run_to_end(make_tracker(sky, nav=moved))
    assert tracker.vector.began_s is None
    assert "orbits" in tracker.vector.remarks[0]
