"""A fix departs from the inertial prediction: an attack, or a unit that may err."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import stats
from tests.app.protect.choosing import NAVIGATION, find_nothing, make_inertia, make_takeover
from tests.app.protect.test_choosing import DRIVE, WALK

from skyproof.app.common.epoch_source import WholeSource
from skyproof.app.common.settings import Settings
from skyproof.app.common.windows import cut, windows_of
from skyproof.detectors.prediction.course import PredictedCourse
from skyproof.detectors.prediction.free_navigators import RefusedWindow
from skyproof.detectors.prediction.inertia import Inertia, InertiaSettings, list_navigators
from skyproof.detectors.prediction.unit_errors import Departure, find_unit_p_value
from skyproof.navigation.nav_estimate import NavEstimate
from skyproof.records import Cause, Finding, Hypothesis, Need, list_refs
from skyproof.simulator.sky import make_scene
from skyproof.studies.receiver_model import ChannelNoise, model_receptions

ALPHA = 1e-7
PULL_S = 45.0


@cache
def simulate_path(path="drive", seed=2, speed_m_s=0.0, duration_s=71.0, carrier="follows"):
    """Simulate measurements, windows with their sets, and the unit's prediction; under attack if it is fast."""
    way = {"drive": DRIVE, "walk": WALK}[path]
    unit = {"grade": "tactical", "rate_hz": 50.0}
    scene = make_takeover(
        path=way,
        imu=unit,
        seed=seed,
        duration_s=duration_s,
        onset_s=PULL_S - 3.0,
        speed_m_s=speed_m_s or 1.0,
        carrier=carrier,
    )
    if not speed_m_s:
        scene = make_scene(scene.scenario.model_copy(update={"attacks": ()}), NAVIGATION)
    (model,) = model_receptions(scene, ChannelNoise(code_m=0.5), rng=np.random.default_rng(seed))
    o = model.reception.observations
    windows = list(windows_of([WholeSource(o)], NAVIGATION, Settings()))
    settings = Settings(oscillator="ocxo")
    return o, windows, make_inertia(scene, settings, "tactical", seed=seed)["bow"]


def walk(found, change=lambda readings: readings, shown=None):
    """Return the findings of these measurements, with changed readings or ranges, and the navigator."""
    o, windows, predictor = found
    o = o if shown is None else shown(o)
    unit = replace(predictor, readings=change(predictor.readings))
    return examine(Inertia(InertiaSettings(false_alarm_probability=ALPHA)), o, windows, inertial={"bow": unit})


def examine(detector, o, windows, doubts=(), **expected):
    """Return findings of windows in which nothing else but doubts is found, and the navigator after them."""
    state, findings = None, []
    for number, (window, clean) in enumerate(zip(windows, find_nothing(windows, o.signals), strict=True)):
        part = cut(o, window.start_gpst, window.end_gpst)
        others = (clean, *(doubt for at, doubt in doubts if at == number))
        records = replace(window, observations=(part,), findings=others, **expected)
        found, state = detector.examine(records, state)
        findings += found
    return findings, list_navigators(state).get("bow")


def list_departures(found, change=lambda readings: readings, shown=None):
    """List the departures among the findings."""
    return [e for e in walk(found, change, shown)[0] if e.says != "clean" and e.code != "not_aligned"]


def shift_readings(readings, since_s):
    return (readings.gpst >= readings.gpst[0] + np.timedelta64(round(since_s * 1e9), "ns"))[:, None]


def test_a_dragged_position_is_an_attack_where_it_begins():
    found = simulate_path(speed_m_s=2.0)
    start = found[0].gpst[0]
    first, *rest = list_departures(found)
    assert first.says == "attack"
    assert PULL_S < float((first.end_gpst - start) / np.timedelta64(1, "s")) <= PULL_S + 10.0
    assert first.data["assumes"][0] == "inertial_as_stated"
    assert {e.code for e in (first, *rest)} == {"departs"}


def test_after_a_refused_window_the_unit_returns_to_before_it():
    # It teaches, and the navigator from before it is held.
    found = simulate_path(speed_m_s=0.7, duration_s=91.0)
    findings, navigator = walk(found)
    start = found[0].gpst[0]
    refused = next(e for e in findings if e.p and e.p_value < 1e-3)
    assert (refused.code, refused.start_gpst - start < np.timedelta64(round(PULL_S), "s")) == ("goes_on", True)
    later = [e for e in findings if e.start_gpst > refused.start_gpst]
    assert later
    assert all(e.failed and e.dated_gpst == refused.start_gpst for e in later)
    assert navigator.until <= refused.start_gpst


def test_reflections_that_taught_navigators_are_no_attack_by_the_others():
    # Dopplers of two satellites are off for a minute: first by less than fails.
    def show(o):
        off = np.zeros(o.doppler_hz.shape)
        off[o.elapsed_s > PULL_S + 2.0, :2] = -1.1 / 0.19
        return replace(o, doppler_hz=o.doppler_hz + off)

    found = [e for e in walk(simulate_path(duration_s=111.0), shown=show)[0] if e.p and e.p_value < 1e-3]
    assert (found[0].code, found[-1].code) == ("goes_on", "by_some")
    assert not any(e.says == "attack" for e in found)


def test_a_window_is_refused_by_chance_once_in_as_many():
    refused = RefusedWindow(number=4, p_value=1e-5)
    assert [refused.is_chance(learned) for learned in (5, 103, 104, 200)] == [False, False, True, True]


def test_velocities_of_a_whole_window_show_what_the_last_does_not():
    # As large as the noise of one, and lasting.
    rng = np.random.default_rng(3)
    at = [np.datetime64("2024-01-01", "ns") + np.timedelta64(second, "s") for second in range(10)]
    sigma = np.array([1.0] * 3 + [0.05] * 3 + [1.0, 0.05])

    def make(mean, sigma):
        return [
            NavEstimate(gpst=gpst, mean=row, covariance=np.diag(sigma**2)) for gpst, row in zip(at, mean, strict=True)
        ]

    course = PredictedCourse(0, None, tuple(make(np.zeros((10, 8)), 0.01 * sigma)))
    clean, dragged = [], []
    for _ in range(2000):
        noise = sigma * rng.standard_normal((10, 8))
        clean.append(course.fit_p_value(make(noise, sigma)))
        dragged.append(course.fit_p_value(make(noise + np.repeat([0.0, 0.1, 0.0], [3, 1, 4]), sigma)))
    for level in (0.1, 0.01):
        assert stats.binomtest(int(np.sum(np.array(clean) < level)), 2000, level, alternative="greater").pvalue > 1e-3
    assert np.mean(np.array(clean) < 0.1) > 0.04
    assert np.median(dragged) < 1e-5


def test_codes_drawn_off_alone_are_no_error_of_the_unit():
    # Velocities go on, and those of a unit that errs part as positions do.
    found = list_departures(simulate_path(speed_m_s=3.0, carrier="locked"))
    assert found[-1].code == "departs"
    named = next(e for e in found if e.says == "attack")
    assert named.data["off_m_s"] < 0.2 < named.data["statistic"]
    assert max(named.p[cause] for cause in (Cause.STATEMENT, Cause.FAULT, Cause.REFLECTIONS)) < ALPHA


def test_a_unit_that_wanders_between_looks_is_to_blame_as_stated():
    # Epochs half a minute apart, and a velocity that errs as a random walk: positions part by what no look shows.
    rng, apart_s, n = np.random.default_rng(6), 30.0, 8
    step_s = 0.5
    p_values = []
    for _ in range(400):
        error_m_s = np.vstack([np.zeros(3), rng.standard_normal((round(apart_s / step_s) * (n - 1), 3)).cumsum(axis=0)])
        error_m = np.vstack([np.zeros(3), (0.5 * step_s * (error_m_s[1:] + error_m_s[:-1])).cumsum(axis=0)])
        errors = np.hstack([error_m, error_m_s])[:: round(apart_s / step_s)]
        at = [np.datetime64("2024-01-01", "ns") + np.timedelta64(round(1e9 * apart_s * k), "ns") for k in range(n)]
        looks = [Departure(gpst, error[3:], error, 1e-4 * np.eye(6)) for gpst, error in zip(at, errors, strict=True)]
        p_values.append(find_unit_p_value(looks))
    assert stats.kstest(p_values, "uniform").pvalue > 1e-3


def test_a_clean_drive_goes_on_and_says_what_would_be_noticed():
    findings, navigator = walk(simulate_path())
    assert findings[0].code == "not_aligned"
    findings = [e for e in findings if e.code != "not_aligned"]
    assert {(e.says, e.code) for e in findings} == {("clean", "goes_on")}
    jumps_m, sizes_m_s = ([e.noticed[number].size for e in findings] for number in range(2))
    assert {tuple(item.kind for item in e.noticed) for e in findings} == {("position_jump", "drag")}
    assert max(jumps_m) < 25.0
    assert sizes_m_s[-1] < 0.7 * sizes_m_s[0]  # by navigators that run free for longer
    assert navigator.hidden_m == pytest.approx(jumps_m[-4] + 10.0 * sum(sizes_m_s[-4:]), rel=0.1)
    assert navigator.hidden_m_s < jumps_m[-1] / 10.0  # what has just begun shows in the velocity


def test_for_a_slow_drag_inertia_states_what_it_may_miss():
    # One that draws the navigator along before it is noticed, by navigators that have run free for a minute.
    found = simulate_path(speed_m_s=0.8, duration_s=121.0, carrier="locked")
    findings, navigator = walk(found)
    start = found[0].gpst[0]
    first = next(e for e in findings if e.failed)
    begun_s, noticed_s, last_s = (
        (t - start) / np.timedelta64(1, "s") for t in (first.dated_gpst, first.start_gpst, navigator.until)
    )
    assert last_s <= begun_s <= noticed_s - 10.0
    assert 0.8 * (last_s - PULL_S) < navigator.hidden_m


def test_what_only_the_clean_start_taught_is_kept():
    # As one that saw nothing later, which a drag has led away.
    o, windows, predictor = simulate_path(speed_m_s=0.8, duration_s=121.0, carrier="locked")
    detector = Inertia(InertiaSettings(false_alarm_probability=ALPHA))
    _, early = examine(detector, o, windows[:3], inertial={"bow": predictor})
    _, late = examine(detector, o, windows, inertial={"bow": predictor})
    at = windows[8].start_gpst
    assert (early.clean, early.until) == (None, windows[2].end_gpst)
    np.testing.assert_allclose(late.clean.at(at).mean, early.predictor.at(at).mean, rtol=1e-12)
    assert np.abs(late.predictor.at(at).mean - late.clean.at(at).mean)[:3].max() > 2.0


def make_doubt(o, window, dated_gpst, code):
    """Return that another test failed: of an attack where no benign cause is left."""
    return Finding(
        detector="none",
        start_gpst=window.start_gpst,
        end_gpst=window.end_gpst,
        signals=list_refs("bow", o.signals),
        hypothesis=Hypothesis.CONTINUOUS,
        code=code,
        p={Cause.CLEAN: 1e-9} | ({Cause.FAULT: 1.0} if code == "odd" else {}),
        alpha=ALPHA,
        dated_gpst=dated_gpst,
    )


@pytest.mark.parametrize("code", ["odd", "attack"])
def test_what_a_later_finding_doubts_corrects_no_navigator(code):
    # As if it had been known from the start: what windows taught from its date on is taken back.
    o, windows, predictor = simulate_path(duration_s=101.0)
    since = windows[5].start_gpst + np.timedelta64(2, "s")
    detector = Inertia(InertiaSettings(false_alarm_probability=ALPHA))
    late = [(8, make_doubt(o, windows[8], since, code))]
    early = [(number, make_doubt(o, windows[number], since, code)) for number in range(5, 9)]
    _, after = examine(detector, o, windows[:9], late, inertial={"bow": predictor})
    _, known = examine(detector, o, windows[:9], early, inertial={"bow": predictor})
    # Under an attack the window before may hold its beginning.
    assert after.until == known.until == windows[4 if code == "odd" else 3].end_gpst
    at = windows[8].start_gpst
    np.testing.assert_allclose(after.predictor.at(at).mean, known.predictor.at(at).mean, rtol=1e-12)


def test_an_attack_in_a_window_without_sets_ends_the_learning():
    o, windows, predictor = simulate_path(duration_s=101.0)
    windows[5] = replace(windows[5], sets=())
    doubt = [(5, make_doubt(o, windows[5], windows[5].start_gpst, "attack"))]
    found, after = examine(
        Inertia(InertiaSettings(false_alarm_probability=ALPHA)), o, windows, doubt, inertial={"bow": predictor}
    )
    assert after.until == windows[3].end_gpst
    assert [e.lacking for e in found if e.start_gpst == windows[5].start_gpst] == [(Need.SETS,)]


def add_spike(readings):
    force = readings.specific_force_m_s2.copy()
    force[(52 * 50)] += [100.0, 0.0, 0.0]
    return replace(readings, specific_force_m_s2=force)


BAD = {
    "half a second late": (lambda r: replace(r, gpst=r.gpst + np.timedelta64(500, "ms")), "not_tried"),
    "a tenth too much": (lambda r: replace(r, specific_force_m_s2=1.1 * r.specific_force_m_s2), "not_tried"),
    "axes exchanged": (
        lambda r: replace(
            r,
            specific_force_m_s2=r.specific_force_m_s2[:, [1, 0, 2]],
            angular_rate_rad_s=r.angular_rate_rad_s[:, [1, 0, 2]],
        ),
        "not_tried",
    ),
    "turns the wrong way": (
        lambda r: replace(r, angular_rate_rad_s=r.angular_rate_rad_s * [1.0, 1.0, -1.0]),
        "moved_more",
    ),
    "a bias from 50 s on": (
        lambda r: replace(
            r, specific_force_m_s2=r.specific_force_m_s2 + 0.5 * shift_readings(r, 50.0) * [1.0, 0.0, 0.0]
        ),
        "parts_slowly",
    ),
    "one reading is wrong": (add_spike, "blow"),
}

QUICK = {"half a second late", "a bias from 50 s on", "one reading is wrong"}


@pytest.mark.parametrize(
    ("change", "code"),
    [pytest.param(*bad, id=name, marks=() if name in QUICK else pytest.mark.long) for name, bad in BAD.items()],
)
def test_a_log_that_errs_is_no_attack_and_the_reason_is_said(change, code):
    found = list_departures(simulate_path(), change)
    assert found
    assert all(e.says == "undecided" and e.failed and e.overrules for e in found)
    assert found[0].code == code


@pytest.mark.parametrize("satellites", [pytest.param(1, marks=pytest.mark.long), 2])
def test_what_a_few_satellites_alone_show_is_no_attack(satellites):
    # Reflections by what drives past: the Dopplers of some are off by 4 m/s.
    def show(o):
        off = np.zeros(o.doppler_hz.shape)
        off[o.elapsed_s > PULL_S + 2.0, :satellites] = 20.0
        return replace(o, doppler_hz=o.doppler_hz + off)

    found = list_departures(simulate_path(), shown=show)
    assert not any(e.says == "attack" for e in found)


@pytest.mark.long
@pytest.mark.parametrize("path", ["drive", "walk"])
def test_of_clean_ways_no_more_p_values_are_small_than_stated(path):
    p = []
    for seed in range(24):
        findings, _ = walk(simulate_path.__wrapped__(path, seed, duration_s=150.0))
        assert {e.says for e in findings if e.p} == {"clean"}
        p += [e.p_value for e in findings if e.p]
    p = np.array(p)
    print(
        f"{path}: {p.size} windows, below 0.1 {np.mean(p < 0.1):.3f}, below 0.01 {np.mean(p < 0.01):.4f}, {p.min():.2g}"
    )
    for level in (0.1, 0.01):
        assert stats.binomtest(int((p < level).sum()), p.size, level, alternative="greater").pvalue > 1e-3
