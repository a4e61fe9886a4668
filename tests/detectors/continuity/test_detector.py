"""Breaks of position, velocity, clock and time are found; receivers that stand or move under a clean sky pass."""

from dataclasses import fields, replace
from functools import cache

import numpy as np
import pytest
from scipy import stats

from skyproof.app.common.windows import cut
from skyproof.detectors.base import NotTested
from skyproof.detectors.continuity.detector import Continuity, ContinuitySettings, explain_few_epochs, explain_no_step
from skyproof.detectors.continuity.series import Limits, build_series
from skyproof.detectors.continuity.steps import compare_sides, fit_jumps, p_values
from skyproof.errors import SettingsError
from skyproof.gnss.frames import ecef_from_geodetic, rot_enu_ecef
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.navigation.rates import fill_dopplers
from skyproof.records import OBSERVABLES, Cause, ConsistentSet, Records
from skyproof.simulator.measurement_errors import FieldErrors
from skyproof.simulator.measurements import NoiseModel, draw, make_ideal_measurements
from skyproof.simulator.scenario import parse_scenario
from skyproof.simulator.sky import make_scene
from skyproof.testing import MeasuredScene, TrackErrors, check_pieces

START = "2023-03-04T05:06:07"
PLACE = {"lat_deg": 40.0, "lon_deg": -3.0, "height_m": 650.0}
PLACE_RAD = np.radians(PLACE["lat_deg"]), np.radians(PLACE["lon_deg"])
PLACE_ECEF_M = ecef_from_geodetic(*PLACE_RAD, PLACE["height_m"])
NAVIGATION = make_nominal_constellation(np.datetime64(START, "ns"))
CORNERS = [[0, 0, 0], [800, 0, 0], [800, 500, 0], [0, 500, 0], [0, 0, 30]]
MOTIONS = {
    "standing": {},
    "ship": {"path": {"kind": "circle", "radius_m": 300.0, "speed_m_s": 8.0}},
    "car at 2 g": {"path": {"kind": "circle", "radius_m": 45.0, "speed_m_s": 30.0}},
    "aircraft at 3 g": {"path": {"kind": "circle", "radius_m": 2000.0, "speed_m_s": 250.0}},
    "brakes and turns at 2 g": {
        "path": {
            "kind": "way-points",
            "points_enu_m": CORNERS,
            "speed_m_s": 60.0,
            "acceleration_m_s2": 20.0,
            "turn_m_s2": 20.0,
        }
    },
}
WINDOW_S, EPOCH_S = 10, 0.2
FIELD = NoiseModel(sigma_m=1.5, carrier_sigma_cyc=0.01, doppler_sigma_hz=0.3, field=FieldErrors())
WHITE = NoiseModel(sigma_m=1.5, carrier_sigma_cyc=0.01, doppler_sigma_hz=0.3)
LIGHT_M_S = 299_792_458.0


@cache
def simulate_receiver(motion="standing", oscillator="tcxo", *, place=(0.0, 0.0), lo_ppm=0.3, duration_s=42.0, seed=1):
    """Simulate one receiver, `place` metres east and north of the usual one."""
    table = {
        "seed": seed,
        "start_gpst": START,
        "duration_s": duration_s,
        "receivers": [
            {
                "name": "rx1",
                **PLACE,
                **MOTIONS[motion],
                "lo_ppm": lo_ppm,
                "oscillator": oscillator,
                "lat_deg": PLACE["lat_deg"] + place[1] / 111_000.0,
                "lon_deg": PLACE["lon_deg"] + place[0] / 85_400.0,
            }
        ],
    }
    return make_ideal_measurements(make_scene(parse_scenario(table), NAVIGATION), interval_s=EPOCH_S)


def observe_scene(draw_of=0, *, noise=FIELD, **scene):
    (o,), _ = draw(simulate_receiver(**scene), rng=np.random.default_rng(draw_of), noise=noise)
    return o


def change_cells(o, **cells):
    return replace(o, **cells)


def make_windows(o, *, sets=True):
    """Make records of 10 s each, whose one set is the whole sky."""
    found = []
    for number in range(int(o.elapsed_s[-1] // WINDOW_S)):
        start = o.gpst[0] + np.timedelta64(WINDOW_S * number, "s")
        end = start + np.timedelta64(WINDOW_S, "s")
        part = cut(o, start, end)
        sky = ConsistentSet(
            receiver=o.receiver,
            signals=o.signals,
            gpst=part.gpst[part.gpst.size // 2],
            position_ecef_m=PLACE_ECEF_M,
            clock_bias_s=0.0,
            covariance_m2=np.eye(4),
            statistic=1.0,
            dof=4,
            p_value=0.5,
        )
        found.append(
            Records(
                start_gpst=start, end_gpst=end, observations=(part,), navigation=NAVIGATION, sets=(sky,) if sets else ()
            )
        )
    return found


def examine_all(o, **settings):
    """Examine all windows with the settings of a usual run."""
    detector, state, found = Continuity(ContinuitySettings(**({"false_alarm_probability": 1e-6} | settings))), None, []
    for records in make_windows(o):
        evidence, state = detector.examine(records, state)
        found.append(evidence)
    return found


def select_failed(found):
    return [e for evidence in found for e in evidence if e.says != "clean"]


def join_rows(one, other, row, *, slip=True):
    """Join the first rows of one record and the rest of the other, as in a file that was cut and joined."""
    cells = {name: np.concatenate((getattr(one, name)[:row], getattr(other, name)[row:])) for name in OBSERVABLES}
    carrier_cyc, doppler_hz = cells["carrier_cyc"], cells["doppler_hz"]
    goes_on_cyc = carrier_cyc[row - 1] - 0.5 * EPOCH_S * (doppler_hz[row - 1] + doppler_hz[row])
    carrier_cyc[row:] += np.rint(goes_on_cyc - carrier_cyc[row])  # as a loop that has seen nothing counts them
    status = one.status.copy()
    status[row] = 3 if slip else 0
    return replace(one, status=status, **cells)


def shift_ahead(o, row, seconds):
    """Shift the signals' time ahead, as where samples are missing, and break all carriers."""
    later = np.arange(o.gpst.size)[:, None] >= row
    status = o.status.copy()
    status[row] = 3
    return replace(
        o,
        status=status,
        pseudorange_m=o.pseudorange_m - np.where(later, LIGHT_M_S * seconds, 0.0),
        carrier_cyc=o.carrier_cyc - np.where(later, o.carrier_hz * seconds + 0.3, 0.0),
    )


def drop_rows(o, first, last):
    """Drop the measurements of these rows, after which carriers start again."""
    hidden = {name: getattr(o, name).copy() for name in OBSERVABLES}
    status = o.status.copy()
    for cells in hidden.values():
        cells[first:last] = np.nan
    status[first:last], status[last] = 1, 3
    hidden["carrier_cyc"][last:] += 1234.5
    return replace(o, status=status, **hidden)


# What goes on ---------------------------------------------------------------------------------------------------------


def add_breaks(o, rng):
    """Add slips, gaps of single signals, and one outage of all, after which they come back one by one."""
    cells, status = {name: getattr(o, name).copy() for name in OBSERVABLES}, o.status.copy()
    n, m = status.shape

    def lose(first, last, channel):
        for values in cells.values():
            values[first:last, channel] = np.nan
        status[first:last, channel], status[last, channel] = 1, 3
        cells["carrier_cyc"][last:, channel] += 1000.0 * rng.normal()

    for _ in range(10):
        row, channel = rng.integers(1, n), rng.integers(m)
        status[row, channel] = 3
        cells["carrier_cyc"][row:, channel] += 0.5 * rng.integers(-50, 50)
    for _ in range(6):
        row = int(rng.integers(1, n - 60))
        lose(row, row + int(rng.integers(1, 25)), int(rng.integers(m)))
    row, length = int(rng.integers(30, n - 60)), int(rng.integers(2, 40))
    for channel in range(m):
        lose(row, row + length + int(rng.integers(0, 10)), channel)
    return replace(o, status=status, **cells)


def count_alarms(motion, oscillator, draws, seed, *, alpha=0.1, disturb=False, **limits):
    """Count false alarms of tests of continuity, and tests, over windows of clean sky."""
    rng, count, tests = np.random.default_rng(seed), 0, 0
    exact = simulate_receiver(motion, oscillator, duration_s=62.0, lo_ppm=float(rng.normal()), seed=seed)
    detector = Continuity(ContinuitySettings(false_alarm_probability=alpha, **limits))
    for _ in range(draws):
        (o,), _ = draw(exact, rng=rng, noise=FIELD)
        state = None
        for records in make_windows(add_breaks(o, rng) if disturb else o):
            evidence, state = detector.examine(records, state)
            count += any(e.p_value is not None and e.says == "undecided" for e in evidence)
            tests += 1
            state = {name: replace(past, broke={}) for name, past in state.items()}
    return count, tests


@pytest.mark.parametrize(
    ("motion", "oscillator"), [("standing", "tcxo"), ("aircraft at 3 g", "tcxo"), ("brakes and turns at 2 g", "ocxo")]
)
def test_clean_skies_go_on(motion, oscillator):
    count, tests = count_alarms(motion, oscillator, 3, 1, disturb=True)
    assert tests == 18
    assert count == 0  # bounds all: a hundred times as many draws have hardly one


@pytest.mark.parametrize("draws", [1, pytest.param(100, marks=pytest.mark.long)])
def test_a_known_standing_receiver_continues_through_outages(draws):
    count, tests = count_alarms("standing", "tcxo", draws, 11, disturb=True, speed_max_m_s=0.0)
    assert tests == 6 * draws
    assert stats.binomtest(count, tests, 0.1, alternative="greater").pvalue > 1e-3


@pytest.mark.long
@pytest.mark.parametrize("disturb", [False, True], ids=["steady", "slips, gaps and outages"])
@pytest.mark.parametrize("oscillator", ["tcxo", "ocxo"])
@pytest.mark.parametrize("motion", MOTIONS)
def test_false_alarms_of_clean_skies_are_no_more_than_asked(motion, oscillator, disturb):
    count, tests = count_alarms(motion, oscillator, 40, 7, disturb=disturb)
    assert tests == 240
    assert stats.binomtest(count, tests, 0.1, alternative="greater").pvalue > 1e-3


def draw_jumps(n, limits):
    scene = MeasuredScene(antennas_enu_m={"rx1": (0.0, 0.0, 0.0)}, epochs=50, step_s=0.2, errors=TrackErrors(1.0))
    rng, row, chances = np.random.default_rng(3), np.array([25]), []
    for _ in range(n):
        records = scene.records(rng)
        series = build_series(records.observations[0], records.navigation, records.sets[0].position_ecef_m, limits)
        sides = compare_sides(series, row, limits)
        jump, rate, usable = fit_jumps(sides)
        assert usable.all()
        chances.append(p_values(sides, jump, rate, np.zeros(1), limits)[0])
    return np.array(chances)


def test_steps_of_position_and_clock_are_chi_square_if_clean():
    chances = draw_jumps(200, Limits(span_s=5.0, multipath_sigma_m=0.0))
    for column in (0, 1):
        assert stats.kstest(chances[:, column], "uniform").pvalue > 1e-3
        assert stats.binomtest(int((chances[:, column] < 0.1).sum()), 200, 0.1).pvalue > 1e-3


def test_pieces_equal_the_whole():
    check_pieces(Continuity, make_windows(add_breaks(observe_scene(3), np.random.default_rng(3))))


def test_slow_drift_and_unseen_turns_are_no_step():
    o = drop_rows(observe_scene(motion="aircraft at 3 g"), 70, 85)  # 3 s
    assert not select_failed(examine_all(o))


def test_one_satellite_that_jumps_by_itself_is_no_step():
    o = observe_scene()
    pseudorange_m = o.pseudorange_m.copy()
    pseudorange_m[70:, 2] += 80.0
    assert not select_failed(examine_all(replace(o, pseudorange_m=pseudorange_m)))


def fit_fewer(windows, columns):
    """Take signals out of the sets of all windows but the first, as where they do not fit one position any more."""
    first, *later = windows
    gone = {first.observations[0].signals[k] for k in columns}
    fewer = [replace(w, sets=tuple(replace(s, signals=tuple(set(s.signals) - gone)) for s in w.sets)) for w in later]
    return [first, *fewer]


@pytest.mark.parametrize("stepped", [False, True], ids=["goes on", "steps"])
def test_only_signals_that_fit_one_position_make_it_step(stepped):
    # Two satellites' channels go over to signals 250 m later and back: leaving one out after the other cures no fit.
    one, other = observe_scene(), observe_scene(1, place=(300.0, -200.0))
    o = join_rows(one, other, 130, slip=False) if stepped else one
    late_m = np.where((o.elapsed_s >= 15.0) & (o.elapsed_s < 23.0) | (o.elapsed_s >= 31.0), 250.0, 0.0)
    columns = [0, 1]
    pseudorange_m = o.pseudorange_m.copy()
    pseudorange_m[:, columns] += late_m[:, None]
    detector, state, failed = Continuity(ContinuitySettings(false_alarm_probability=1e-6)), None, []
    for records in fit_fewer(make_windows(replace(o, pseudorange_m=pseudorange_m)), columns):
        evidence, state = detector.examine(records, state)
        failed += [e for e in evidence if e.code == "step"]
    assert bool(failed) == stepped


@pytest.mark.parametrize("steps", [-1, 1])
def test_a_clock_steered_by_a_millisecond_goes_on(steps):
    o = observe_scene()
    moved = steps * 1e-3 * (np.arange(o.gpst.size)[:, None] >= 77)
    steered = replace(
        o,
        pseudorange_m=o.pseudorange_m + LIGHT_M_S * moved,
        carrier_cyc=o.carrier_cyc + o.carrier_hz * moved,
    )
    unmoved = replace(steered, carrier_cyc=o.carrier_cyc)
    assert not select_failed(examine_all(steered))
    assert not select_failed(examine_all(unmoved))


def test_a_label_that_moves_with_the_pseudoranges_is_no_step():
    o = observe_scene()
    later = np.arange(o.gpst.size) >= 77
    moved = replace(
        o,
        gpst=o.gpst + np.where(later, np.timedelta64(5, "ms"), np.timedelta64(0, "ms")),
        pseudorange_m=o.pseudorange_m + np.where(later, LIGHT_M_S * 5e-3, 0.0)[:, None],
        carrier_cyc=o.carrier_cyc + np.where(later, 5e-3, 0.0)[:, None] * o.carrier_hz,
    )
    assert not select_failed(examine_all(moved))


# What does not --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("row", [70, 99, 100, 101, 140])
@pytest.mark.parametrize("slip", [True, False], ids=["slips marked", "carriers glued"])
def test_halves_of_two_receivers_joined_are_reported(row, slip):
    other = observe_scene(2, noise=WHITE, place=(40.0, 46.0), lo_ppm=0.8)
    found = examine_all(join_rows(observe_scene(1, noise=WHITE), other, row, slip=slip))
    first = select_failed(found)[0]
    assert (first.says, first.overrules, first.may_also_be) == ("undecided", True, ("joined",))
    assert first.p_value < first.alpha
    assert {ref.signal for ref in first.signals} == set(observe_scene(1, noise=WHITE).signals)
    assert "position" in first.data["kinds"]
    assert first.data["position_m"] == pytest.approx(61.0, abs=5.0)
    assert abs(first.dated_gpst - observe_scene(1, noise=WHITE).gpst[row]) <= np.timedelta64(300, "ms")
    assert first.data["broke"] is slip or not slip
    assert {(e.code, e.dated_gpst) for e in select_failed(found)} == {
        ("step", first.dated_gpst)
    }  # found once, and kept
    assert any(e.overrules and e.dated_gpst == first.dated_gpst for e in found[-1])


@pytest.mark.parametrize("slip", [True, False], ids=["carriers break", "carriers go on"])
def test_a_jump_of_one_receiver_by_its_clock_is_an_attack(slip):
    # The clock's rate goes on, as that of no other receiver does.
    found = examine_all(
        join_rows(observe_scene(1, noise=WHITE), observe_scene(2, noise=WHITE, place=(40.0, 46.0)), 70, slip=slip)
    )
    first = select_failed(found)[0]
    assert (first.says, first.code) == ("attack", "step")
    assert first.p[Cause.JOINED] < 1e-7
    assert max(first.p.values()) < first.alpha


def test_a_jump_of_a_steered_clock_may_be_another_receiver():
    elsewhere = observe_scene(2, noise=WHITE, place=(40.0, 46.0), lo_ppm=0.0)
    first = select_failed(examine_all(join_rows(observe_scene(1, noise=WHITE, lo_ppm=0.0), elsewhere, 70)))[0]
    assert first.may_also_be == ("joined",)


def test_a_step_smaller_than_errors_is_not_reported():
    assert not select_failed(examine_all(join_rows(observe_scene(1), observe_scene(2, place=(2.0, 1.0)), 70)))


def test_another_oscillator_is_recognized_by_its_rate():
    (first, *_) = select_failed(examine_all(join_rows(observe_scene(1), observe_scene(2, lo_ppm=0.8, seed=1), 70)))
    assert "rate" in first.data["kinds"]
    assert first.data["rate"] == pytest.approx(0.5e-6, abs=5e-9)


def test_time_that_goes_back_is_reported():
    (first, *_) = select_failed(examine_all(shift_ahead(observe_scene(), 77, -3e-6)))
    assert "clock" in first.data["kinds"]
    assert first.data["clock_s"] == pytest.approx(3e-6, rel=0.2)
    assert first.data["broke"]


def test_a_recording_that_begins_again_is_reported():
    o = observe_scene()
    cells = {name: np.concatenate((getattr(o, name)[:80], getattr(o, name)[:80])) for name in OBSERVABLES}
    cells["pseudorange_m"][80:] += LIGHT_M_S * 16.0
    status = np.concatenate((o.status[:80], o.status[:80]))
    status[80] = 3
    again = replace(
        o,
        gpst=o.gpst[:160],
        elapsed_s=o.elapsed_s[:160],
        status=status,
        half_cycle_open=np.array(False),
        quadrature_m=np.array(np.nan),
        **cells,
    )
    (first, *_) = select_failed(examine_all(again))
    assert first.data["clock_s"] == pytest.approx(16.0, abs=1e-3)
    assert "position" not in first.data["kinds"]


@pytest.mark.parametrize("motion", ["standing", "aircraft at 3 g"])
def test_missing_samples_are_reported_and_are_no_failure(motion):
    exact = observe_scene(4, motion=motion, noise=FIELD)
    row, missing = 77, 2  # epochs of 0.2 s
    moved = np.arange(exact.gpst.size - missing) + np.where(np.arange(exact.gpst.size - missing) >= row, missing, 0)
    cells = {name: getattr(exact, name)[moved] for name in OBSERVABLES}
    kept = slice(None, exact.gpst.size - missing)
    late_s = np.where(np.arange(exact.gpst.size - missing) >= row, missing * EPOCH_S, 0.0)[:, None]
    cells["pseudorange_m"] = cells["pseudorange_m"] - LIGHT_M_S * late_s
    status = exact.status[moved].copy()
    status[row] = 3
    o = replace(
        exact,
        gpst=exact.gpst[kept],
        elapsed_s=exact.elapsed_s[kept],
        quadrature_m=np.array(np.nan),
        status=status,
        half_cycle_open=np.array(False),
        **cells,
    )
    (only,) = select_failed(examine_all(o))
    assert only.p_value is None
    assert not only.overrules
    assert only.code == "time_ahead"
    assert only.data["missing_s"] == pytest.approx(0.4, abs=1e-6)


def add_second_kind(o):
    """Add the same satellites by another code."""
    second = tuple(replace(signal, code="W") for signal in o.signals)
    twice = {name: np.tile(getattr(o, name), (1, 2)) for name in (*OBSERVABLES, "status")}
    lives = {name: np.tile(getattr(o, name), 2) for name in ("found_elapsed_s", "missed_elapsed_s", "carrier_hz")}
    return replace(
        o, signals=o.signals + second, half_cycle_open=np.array(False), quadrature_m=np.array(np.nan), **twice, **lives
    )


@pytest.mark.parametrize("only_one", [True, False], ids=["one kind", "both kinds"])
def test_samples_are_missing_in_all_kinds_or_in_none(only_one):
    # A kind that is ahead while the other goes on is no gap of a recording.
    o, row = add_second_kind(observe_scene(noise=WHITE)), 77
    late = shift_ahead(o, row, 5e-7)
    if only_one:
        n = len(o.signals) // 2
        cells = {
            name: np.hstack((getattr(late, name)[:, :n], getattr(o, name)[:, n:])) for name in (*OBSERVABLES, "status")
        }
        late = replace(late, **cells)
    codes = {e.code for e in select_failed(examine_all(late))}
    assert codes == ({"step"} if only_one else {"time_ahead"})


def test_an_impossible_jump_in_an_outage_is_reported():
    far = join_rows(observe_scene(1), observe_scene(2, place=(900.0, 0.0), lo_ppm=0.8), 80)
    near = join_rows(observe_scene(1), observe_scene(2, place=(90.0, 0.0)), 80)
    reported = select_failed(examine_all(drop_rows(far, 70, 85)))[0]
    assert reported.data["outage_s"] == pytest.approx(3.2)
    assert reported.data["position_m"] == pytest.approx(900.0, abs=10.0)
    assert "joined" in reported.may_also_be
    assert not select_failed(examine_all(drop_rows(near, 70, 85)))
    limited = select_failed(examine_all(drop_rows(near, 70, 85), speed_max_m_s=5.0))[0]
    assert limited.data["position_m"] == pytest.approx(90.0, abs=10.0)


def test_signals_found_again_under_other_names_are_the_same_sky():
    o = observe_scene()
    again = replace(drop_rows(o, 70, 78), signals=tuple(replace(s, copy="b") for s in o.signals))
    all_signals = tuple(o.signals) + again.signals
    n = np.arange(o.gpst.size)[:, None]

    def double(first, second):
        return np.concatenate((np.where(n < 70, first, np.nan), np.where(n >= 78, second, np.nan)), axis=1)

    cells = {name: double(getattr(o, name), getattr(again, name)) for name in OBSERVABLES}
    status = np.where(np.isfinite(cells["pseudorange_m"]), 0, 1).astype(np.uint8)
    lives = {
        f.name: np.concatenate((getattr(o, f.name),) * 2)
        for f in fields(o)
        if f.name in ("found_elapsed_s", "missed_elapsed_s", "carrier_hz")
    }
    joined = replace(
        o,
        signals=all_signals,
        status=status,
        half_cycle_open=np.array(False),
        quadrature_m=np.array(np.nan),
        **cells,
        **lives,
    )
    assert not select_failed(examine_all(joined))
    moved = cells["pseudorange_m"].copy()
    (elsewhere,) = (observe_scene(place=(400.0, 460.0)),)
    moved[78:, len(o.signals) :] = elsewhere.pseudorange_m[78:]
    jump = select_failed(examine_all(replace(joined, pseudorange_m=moved)))[0]
    assert jump.data["position_m"] == pytest.approx(610.0, abs=40.0)


def test_what_is_lacking_is_reported():
    records = make_windows(observe_scene())[0]
    (evidence,), state = Continuity().examine(replace(records, sets=()))
    assert evidence.says == "undecided"
    assert evidence.lacking
    assert state is None


def drop_fields(o, *names):
    """Drop some of the measured fields."""
    return replace(o, **{name: np.full_like(getattr(o, name), np.nan) for name in names})


def keep_few(o, satellites, rows=slice(None)):
    """Keep pseudoranges of so many satellites at most, at some epochs."""
    ranges_m = o.pseudorange_m.copy()
    ranges_m[rows, satellites:] = np.nan
    return replace(o, pseudorange_m=ranges_m)


@pytest.mark.parametrize(
    ("lacks", "reason"),
    [
        (lambda o: keep_few(o, 4), explain_few_epochs(keep_few(observe_scene(), 4), 0, stepped=False)),
        (lambda o: keep_few(o, 4, slice(2, None)), explain_few_epochs(observe_scene(), 2, stepped=False)),
        (
            lambda o: drop_fields(o, "carrier_cyc", "doppler_hz"),
            explain_no_step(drop_fields(observe_scene(), "carrier_cyc", "doppler_hz")),
        ),
        (lambda o: replace(o, carrier_hz=np.full(len(o.signals), np.nan)), None),
    ],
    ids=["satellites", "epochs", "ranges alone", "frequencies"],
)
def test_each_reason_not_to_run_has_its_own_code(lacks, reason):
    o = lacks(observe_scene())
    reason = reason or explain_no_step(o)
    (evidence, *_), _ = Continuity().examine(make_windows(o)[0])
    assert (evidence.code, evidence.data) == (reason.code, reason.data)
    assert evidence.p_value is None


def test_reasons_not_to_run_are_told_apart():
    o = observe_scene()
    apart = replace(o, pseudorange_m=np.where(np.arange(len(o.signals)) % 2, o.pseudorange_m, np.nan))
    reasons = [
        NotTested("no_set"),
        explain_few_epochs(keep_few(o, 4), 0, stepped=False),
        explain_few_epochs(o, 2, stepped=True),
        explain_no_step(replace(o, carrier_hz=np.full(len(o.signals), np.nan))),
        explain_no_step(drop_fields(o, "carrier_cyc", "doppler_hz")),
        explain_no_step(apart),
    ]
    codes = ["no_set", "few_satellites", "few_epochs_since_step", "no_frequency", "ranges_alone", "one_side"]
    assert [reason.code for reason in reasons] == codes


def test_settings_that_make_no_sense_are_refused():
    with pytest.raises(SettingsError, match="span_s is 0"):
        ContinuitySettings(span_s=0.0)


def test_the_places_of_the_tests_are_as_far_apart_as_they_say():
    (elsewhere,) = simulate_receiver(place=(40.0, 46.0))
    assert elsewhere.receiver == "rx1"
    east_m = rot_enu_ecef(*PLACE_RAD) @ (
        ecef_from_geodetic(
            PLACE_RAD[0] + np.radians(46.0 / 111_000.0), PLACE_RAD[1] + np.radians(40.0 / 85_400.0), PLACE["height_m"]
        )
        - PLACE_ECEF_M
    )
    assert np.linalg.norm(east_m) == pytest.approx(61.0, abs=0.3)


def test_missing_epochs_without_dopplers_are_no_jump():
    # One of 30 s, whose Dopplers are the slopes of its carriers: an epoch without neighbours has none.
    scene = MeasuredScene(epochs=15, step_s=30.0)
    o = scene.records(np.random.default_rng(1)).observations[0]
    without = replace(o, doppler_hz=np.full_like(o.doppler_hz, np.nan))
    o = fill_dopplers(without.select(np.array([8, 10, 12, 13, 14])), 30.0)[0]
    assert np.isnan(o.doppler_hz[:2]).all()
    place = scene.records(np.random.default_rng(1)).sets[0].position_ecef_m
    offset_m = build_series(o, scene.navigation, place, Limits()).offset_m
    assert np.ptp(offset_m, axis=0).max() < 10.0


def reflect(o, row, *, seen, rng):
    """Change all ranges from a row on as reflections do, and what discriminators show off the carriers where seen."""
    later = np.arange(o.gpst.size)[:, None] >= row
    late_m, off_m = 10.0 * rng.standard_normal((2, len(o.signals)))
    noise_m = o.pseudorange_sigma_m * rng.standard_normal(o.pseudorange_m.shape)
    return replace(
        o,
        pseudorange_m=o.pseudorange_m + np.where(later, late_m, 0.0),
        quadrature_m=noise_m + np.where(later, off_m, 0.0) if seen else np.array(np.nan),
    )


@pytest.mark.parametrize(("seen", "steps"), [(False, 11), (True, 0)])
def test_reflections_that_discriminators_show_are_no_step(seen, steps):
    rng = np.random.default_rng(11)
    reflected = [reflect(observe_scene(draw), 77, seen=seen, rng=rng) for draw in range(12)]
    failed = [bool(select_failed(examine_all(o, multipath_sigma_m=1.0))) for o in reflected]
    assert sum(failed) == steps


def test_a_jump_of_a_single_sky_is_found_beside_silent_discriminators():
    rng = np.random.default_rng(12)
    o = observe_scene()
    quiet = replace(o, quadrature_m=o.pseudorange_sigma_m * rng.standard_normal(o.pseudorange_m.shape))
    moved = join_rows(quiet, observe_scene(place=(40.0, 0.0)), 77)
    assert not select_failed(examine_all(quiet))
    assert "position" in select_failed(examine_all(moved))[0].data["kinds"]
