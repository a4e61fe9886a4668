"""What is said of signals by where they come from, of attitude and lines that are wrong or not known, of antennas."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.detectors.nulls import NAVIGATION, PLACE_M, SIGNALS, START, STATE, TRUE, draw_array_records

from skyproof.detectors.array.array_common import ArrayCommon
from skyproof.detectors.array.ins_array import InsArray, InsArraySettings
from skyproof.detectors.array.policy import POLICY
from skyproof.explain import stands_beside
from skyproof.gnss.constants import L1_HZ, SPEED_OF_LIGHT_M_S
from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.orbits import compute_satellite_state_s
from skyproof.gnss.sky import compute_azimuth_elevation
from skyproof.gnss.time import week_and_tow
from skyproof.navigation.predictor import Standing, place_surveyed
from skyproof.records import Cause, ConsistentSet, Records, SignalId
from skyproof.statistics.directions import (
    direction_cosines,
)

IDEAL = InsArraySettings(pattern_sigma_m=0.0)


def test_predicted_directions_are_those_of_azimuth_and_elevation():
    week, tow_s = week_and_tow(START)
    by_sat = {orbit.sat: orbit for orbit in NAVIGATION.ephemerides}
    for k, signal in enumerate(SIGNALS):
        position_m = compute_satellite_state_s(by_sat[signal.sat], week, tow_s).position_ecef_m
        az, el = compute_azimuth_elevation(PLACE_M, position_m)
        forward_right_down = [np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), -np.sin(el)]
        np.testing.assert_allclose(TRUE[0, k], forward_right_down, atol=3e-5)  # the satellite moves on by 300 m


def make_set(*numbers, place_m=PLACE_M):
    """Make a consistent set of these signals at a place."""
    return ConsistentSet(
        receiver="rx1",
        signals=tuple(SIGNALS[k] for k in numbers),
        gpst=START,
        position_ecef_m=place_m,
        clock_bias_s=0.0,
        covariance_m2=np.eye(4),
        statistic=1.0,
        dof=1,
        p_value=0.5,
    )


def examine_records(records, **settings):
    """Examine the records and list the signals of each kind of finding."""
    evidence, _ = InsArray(replace(IDEAL, **settings)).examine(records)
    assert len({e.says for e in evidence}) == len(evidence)
    return {e.says: {ref.signal for ref in e.signals} for e in evidence}, evidence


def move_two():
    direction = TRUE.copy()
    direction[:, 2:4] = direction[:, :1]
    return draw_array_records(np.random.default_rng(8), direction)


def test_false_signals_are_named_and_the_true_ones_are_not():
    words, _ = examine_records(move_two())
    assert words == {"spoofed": set(SIGNALS[2:4]), "authentic": {*SIGNALS[:2], *SIGNALS[4:]}}


def test_a_satellite_behind_the_transmitter_is_not_authentic():
    direction = TRUE.copy()
    direction[:, 2:5] = direction[:, :1]
    words, _ = examine_records(draw_array_records(np.random.default_rng(8), direction))
    assert words == {"spoofed": set(SIGNALS[2:5]), "authentic": {SIGNALS[1], *SIGNALS[5:]}}


@pytest.mark.parametrize(
    ("band", "code", "apart_m", "weaker_db", "named"),
    [
        ("L1", "CA", 200.0, 0.0, 0),
        ("L1", "CA", 2000.0, 0.0, 1),
        ("L1", "CA", 2000.0, 16.0, 0),
        ("L5", "Q", 20.0, 0.0, 0),
        ("L5", "Q", 200.0, 0.0, 1),
    ],
)
def test_a_signal_that_another_covers_is_not_named(monkeypatch, band, code, apart_m, weaker_db, named):
    # Its phases are a mixture of both: where they overlap, and where filters leave some of a stronger one.
    monkeypatch.setattr("skyproof.detectors.array.ins_array.select_reflections", lambda *given, **more: {})
    direction = TRUE.copy()
    direction[:, 3], direction[:, 2] = TRUE[:, 2], TRUE[:, 0]
    records = draw_array_records(np.random.default_rng(8), direction)
    covered = replace(SIGNALS[2], band=band, code=code)
    signals = (*SIGNALS[:2], covered, replace(covered, copy="b"), *SIGNALS[4:])
    phases = tuple(replace(phases, signals=signals) for phases in records.array_phases)
    range_m = np.full((2, len(signals)), 2.1e7)
    range_m[:, 3] += apart_m
    cn0_dbhz = np.full(range_m.shape, 45.0)
    cn0_dbhz[:, 2] -= weaker_db
    observed = SimpleNamespace(receiver="rx1", signals=signals, pseudorange_m=range_m, cn0_dbhz=cn0_dbhz)
    words, _ = examine_records(replace(records, array_phases=phases, observations=(observed,)))
    assert words.get("spoofed", set()) == ({signals[2]} if named else set())
    assert {*SIGNALS[:2], *SIGNALS[4:]} <= words["authentic"]


def explain_as_reflections(monkeypatch, *, late=True):
    monkeypatch.setattr(
        "skyproof.detectors.array.ins_array.select_reflections",
        lambda observations, navigation, place_ecef_m, true, others, **given: dict.fromkeys(others, late),
    )


@pytest.mark.parametrize(("late", "word"), [(True, "multipath"), (False, "undecided")])
def test_a_signal_from_elsewhere_is_a_reflection_only_if_it_is_late(monkeypatch, late, word):
    explain_as_reflections(monkeypatch, late=late)
    direction = TRUE.copy()
    direction[:, 2] = direction_cosines(np.radians(40.0), np.radians(-25.0))
    records = draw_array_records(np.random.default_rng(8), direction)
    words, evidence = examine_records(records)
    assert words == {word: {SIGNALS[2]}, "authentic": {*SIGNALS[:2], *SIGNALS[3:]}}
    (open_still,) = [e for e in evidence if e.says == word]
    assert (open_still.failed, open_still.singled_out) == (not late, True)


def test_reflections_from_one_direction_leave_the_sky_open(monkeypatch):
    explain_as_reflections(monkeypatch)
    direction = TRUE.copy()
    direction[:, 2:4] = direction_cosines(np.radians([40.0, 200.0]), np.radians([-25.0, -60.0]))
    words, _ = examine_records(draw_array_records(np.random.default_rng(8), direction))
    assert words == {"multipath": set(SIGNALS[2:4]), "authentic": {*SIGNALS[:2], *SIGNALS[4:]}}
    words, evidence = examine_records(move_two())
    assert words == {"undecided": set(SIGNALS[2:4]), "authentic": {*SIGNALS[:2], *SIGNALS[4:]}}
    (open_still,) = [e for e in evidence if e.says == "undecided"]
    assert (open_still.code, open_still.may_also_be) == ("repeated", (Cause.REFLECTIONS,))
    assert open_still.overrules


def find_low_satellite():
    """Find the signal of a satellite twenty degrees or more below the horizon."""
    week, tow_s = week_and_tow(START)
    for orbit in NAVIGATION.ephemerides:
        if compute_azimuth_elevation(PLACE_M, compute_satellite_state_s(orbit, week, tow_s).position_ecef_m)[
            1
        ] < np.radians(-20.0):
            return SignalId(orbit.sat)
    raise AssertionError("all satellites are in view")


@pytest.mark.parametrize("low", [True, False])
def test_signals_beside_a_false_one_are_of_its_transmitter(monkeypatch, low):
    # All that come from there look like reflections, but the satellite of one stands below the horizon.
    explain_as_reflections(monkeypatch)
    direction = TRUE.copy()
    direction[:, 5:] = direction_cosines(np.radians(40.0), np.radians(-25.0))
    records = draw_array_records(np.random.default_rng(8), direction)
    signals = (*SIGNALS[:5], replace(SIGNALS[0], copy="b"), SIGNALS[6], find_low_satellite() if low else SIGNALS[7])
    phases = tuple(replace(phases, signals=signals) for phases in records.array_phases)
    words, evidence = examine_records(replace(records, array_phases=phases), false_alarm_probability=1e-5)
    assert words.get("spoofed", set()) == (set(signals[5:]) if low else set())
    assert words["authentic"] == set(SIGNALS[:5])
    if low:
        (spoofed,) = [e for e in evidence if e.says == "spoofed"]
        assert spoofed.code == "from_one_direction"


@pytest.mark.parametrize(("beside_deg", "named"), [(0.0, 2), (4.0, 1)])
def test_one_signal_so_near_to_a_false_one_is_of_its_transmitter(monkeypatch, beside_deg, named):
    # One satellite stands below the horizon; the other one's signal alone would pass for a reflection.
    explain_as_reflections(monkeypatch, late=False)
    direction = TRUE.copy()
    direction[:, 6] = direction_cosines(np.radians(40.0 + beside_deg), np.radians(-25.0))
    direction[:, 7] = direction_cosines(np.radians(40.0), np.radians(-25.0))
    records = draw_array_records(np.random.default_rng(8), direction)
    signals = (*SIGNALS[:7], find_low_satellite())
    phases = tuple(replace(phases, signals=signals) for phases in records.array_phases)
    words, _ = examine_records(replace(records, array_phases=phases), false_alarm_probability=1e-5)
    assert words["spoofed"] == set(signals[-named:])
    assert words["authentic"] == set(SIGNALS[:6])


def add_patterns(records, sigma_m, rng):
    """Add to each signal's phase on each antenna what the antenna's pattern writes into it."""
    (phases,) = records.array_phases
    off_cyc = sigma_m * L1_HZ / SPEED_OF_LIGHT_M_S * rng.standard_normal(phases.phase_cyc.shape[1:])
    return replace(records, array_phases=(replace(phases, phase_cyc=phases.phase_cyc + off_cyc),))


@pytest.mark.parametrize("stated", [False, True])
def test_patterns_of_antennas_leave_a_sky_true_and_a_false_signal_named(monkeypatch, stated):
    monkeypatch.setattr("skyproof.detectors.array.ins_array.select_reflections", lambda *given, **more: {})
    direction = TRUE.copy()
    direction[:, 2] = direction_cosines(np.radians(40.0), np.radians(-25.0))
    rng = np.random.default_rng(8)
    for false in (False, True):
        for _ in range(20):
            sigma_m = 0.01 if stated else POLICY.coupled_pattern_sigma_m
            records = add_patterns(draw_array_records(rng, direction if false else TRUE), sigma_m, rng)
            (phases,) = records.array_phases
            records = replace(records, array_phases=(replace(phases, pattern_sigma_m=0.01 if stated else None),))
            settings = {"pattern_sigma_m": POLICY.coupled_pattern_sigma_m, "false_alarm_probability": 1e-6}
            words, evidence = examine_records(records, **settings)
            named, wrong = words.get("spoofed", set()), {SIGNALS[2]} if false else set()
            assert named <= wrong
            assert not words.get("authentic", set()) & wrong
            assert false or not any(e.failed for e in evidence)
            # As large as stated here, patterns hide one false signal of three antennas now and then.
            assert stated or (named, words["authentic"]) == (wrong, set(SIGNALS) - wrong)


def test_patterns_of_antennas_do_not_add_up_to_an_alarm():
    # The longer the mean, the less noise hides what the patterns write into it.
    rng = np.random.default_rng(5)
    first = add_patterns(draw_array_records(rng), POLICY.coupled_pattern_sigma_m, rng)
    detector, state = InsArray(InsArraySettings(false_alarm_probability=1e-6)), None
    (phases,) = first.array_phases
    for _ in range(16):
        noisy_cyc = phases.phase_cyc + 0.01 * rng.standard_normal(phases.phase_cyc.shape)
        records = replace(first, array_phases=(replace(phases, phase_cyc=noisy_cyc),))
        evidence, state = detector.examine(records, state)
        assert not any(e.failed for e in evidence)


def test_in_a_sky_that_fails_a_signal_unlike_true_ones_is_not_authentic(monkeypatch):
    # Too near to its satellite to be named so rarely, too far to be one of the true ones.
    monkeypatch.setattr("skyproof.detectors.array.ins_array.select_reflections", lambda *given, **more: {})
    doubted = 0
    for beside_deg in np.arange(1.0, 4.0, 0.25):
        direction = TRUE.copy()
        direction[:, 2] = direction_cosines(np.radians(40.0), np.radians(-25.0))
        turned = Rotation.from_euler("z", beside_deg, degrees=True)
        direction[:, 4] = turned.apply(TRUE[:, 4])
        records = draw_array_records(np.random.default_rng(8), direction)
        evidence, _ = InsArray(replace(IDEAL, false_alarm_probability=1e-8)).examine(records)
        shown = {ref.signal for e in evidence if e.says in ("authentic", "spoofed") or e.failed for ref in e.signals}
        assert shown == set(SIGNALS)
        doubted += any(e.code == "not_late" for e in evidence)
    assert doubted


def test_false_directions_are_among_the_directions_given():
    direction = TRUE.copy()
    direction[:, 2:4] = direction_cosines(np.radians(40.0), np.radians(-25.0))  # down is positive in the body
    _, evidence = examine_records(draw_array_records(np.random.default_rng(8), direction))
    (spoofed,) = [e for e in evidence if e.says == "spoofed"]
    # Level, north at the first epoch and turned by a degree in each second.
    azimuth_rad, elevation_rad = np.radians(40.0 + 1.5), np.radians(25.0)
    off = [
        np.hypot((d.azimuth_rad - azimuth_rad) * np.cos(elevation_rad), d.elevation_rad - elevation_rad) / d.sigma_rad
        for d in spoofed.directions
    ]
    assert min(off) < 3.0
    assert all(d.frame == "enu" for d in spoofed.directions)


def test_one_source_for_all_is_found():
    direction = np.repeat(TRUE[:, :1], len(SIGNALS), axis=1)
    words, evidence = examine_records(draw_array_records(np.random.default_rng(9), direction))
    assert words == {"spoofed": set(SIGNALS)}
    assert evidence[0].p_value < 1e-9


def test_without_a_place_the_fitting_sets_place_is_taken():
    covariance = np.tile(np.radians(0.05) ** 2 * np.eye(9), (STATE.gpst.size, 1, 1))
    covariance[:, range(6), range(6)] = np.inf
    records = replace(move_two(), nav_state={"rx1": replace(STATE, covariance=covariance)})
    words, (finding,) = examine_records(records)
    assert finding.code == "no_place"
    far = ecef_from_geodetic(np.radians(-20.0), np.radians(80.0), 0.0)
    words, _ = examine_records(replace(records, sets=(make_set(2, 3, place_m=far), make_set(0, 1, 4, 5, 6, 7))))
    assert words == {"spoofed": set(SIGNALS[2:4]), "authentic": {*SIGNALS[:2], *SIGNALS[4:]}}


def test_a_surveyed_place_needs_neither_attitude_nor_a_set():
    surveyed = place_surveyed(Standing(stands=True, oscillator=None, by=()), PLACE_M, 25.0 * np.eye(3))
    (phases,) = move_two().array_phases
    first = replace(move_two(), array_phases=(take_first(phases),), nav_state={}, standing={"rx1": surveyed})
    words, _ = examine_records(first)
    assert words == {"spoofed": set(SIGNALS[2:4]), "authentic": {*SIGNALS[:2], *SIGNALS[4:]}}


@pytest.mark.parametrize("false", [False, True])
def test_a_wrong_attitude_is_reported_and_names_no_true_signal(false):
    records = move_two() if false else draw_array_records(np.random.default_rng(8))
    turned = STATE.attitude @ Rotation.from_euler("z", 20.0, degrees=True).as_matrix()
    evidence, _ = InsArray(IDEAL).examine(replace(records, nav_state={"rx1": replace(STATE, attitude=turned)}))
    (noted,) = [e for e in evidence if stands_beside(e)]
    assert noted.code == "attitude_unused"
    # Fewer signals leave several attitudes open, one cycle of phase apart.
    assert noted.data == ({} if false else {"off_deg": pytest.approx(20.0, abs=1.0)})
    spoofed = {ref.signal for e in evidence if e.says == "spoofed" for ref in e.signals}
    assert spoofed == (set(SIGNALS[2:4]) if false else set())


@pytest.mark.parametrize("false", [False, True])
def test_wrong_line_delays_are_reported_and_name_no_true_signal(false):
    records = move_two() if false else draw_array_records(np.random.default_rng(8))
    (phases,) = records.array_phases
    moved = replace(phases, phase_cyc=phases.phase_cyc + np.array([0.0, 0.3, -0.2]))
    evidence, _ = InsArray(IDEAL).examine(replace(records, array_phases=(moved,)))
    assert [e.code for e in evidence if stands_beside(e)] == ["lines_unused"]
    spoofed = {ref.signal for e in evidence if e.says == "spoofed" for ref in e.signals}
    assert spoofed == (set(SIGNALS[2:4]) if false else set())


def take_first(phases, **changes):
    """Take the first epoch alone, since the body turns."""
    first = {name: getattr(phases, name)[:1] for name in ("gpst", "elapsed_s", "phase_cyc", "sigma_cyc")}
    return replace(phases, **first, **changes)


def misstate_antenna(records, *, lines_known=True):
    """State the third antenna 3 m forward of where it is."""
    (phases,) = records.array_phases
    stated = replace(phases, elements_m=phases.elements_m + np.array([[0.0], [0.0], [3.0]]) * [1.0, 0.0, 0.0])
    return replace(records, array_phases=(replace(stated, calibrated=lines_known),))


@pytest.mark.parametrize(("false", "lines_known"), [(0, True), (0, False), (4, False)])
def test_a_misplaced_antenna_is_told_by_true_signals(false, lines_known):
    direction = TRUE.copy()
    direction[:, :false] = direction_cosines(np.radians(40.0), np.radians(-25.0))
    records = draw_array_records(np.random.default_rng(8), direction)
    words, evidence = examine_records(misstate_antenna(records, lines_known=lines_known))
    assert words == {"undecided": set(SIGNALS[false:])} | ({"spoofed": set(SIGNALS[:false])} if false else {})
    (undecided,) = [e for e in evidence if e.says == "undecided"]
    assert (undecided.code, undecided.may_also_be) == ("not_as_stated", (Cause.STATEMENT, Cause.REFLECTIONS))
    assert (undecided.overrules, undecided.data["beside"]) == (not false, bool(false))


@pytest.mark.parametrize("seed", range(3))
def test_sums_of_true_and_false_waves_belong_to_no_sky(seed):
    # A false signal on every true one, as strong and in step with it: the sum comes from halfway between.
    transmitter = direction_cosines(np.radians(40.0), np.radians(-25.0))
    records = draw_array_records(np.random.default_rng(seed), 0.5 * (TRUE + transmitter))
    differing, _ = ArrayCommon().examine(records)
    assert "authentic" in {e.says for e in differing}
    findings, _ = InsArray(IDEAL).examine(records)
    assert [(e.says, e.failed, e.overrules, len(e.signals)) for e in findings] == [
        ("undecided", True, True, len(SIGNALS))
    ]


def test_one_transmitter_tells_the_same_at_any_antenna_places():
    # A line that is longer by the way to an antenna elsewhere gives the same phases: no test can tell them apart.
    direction = np.broadcast_to(direction_cosines(np.radians(40.0), np.radians(-25.0)), TRUE.shape)
    records = draw_array_records(np.random.default_rng(8), direction)
    records = replace(records, array_phases=(take_first(records.array_phases[0], calibrated=False),))
    (right,), _ = InsArray(IDEAL).examine(records)
    (wrong,), _ = InsArray(IDEAL).examine(misstate_antenna(records, lines_known=False))
    assert (wrong.code, wrong.signals, wrong.data) == (right.code, right.signals, right.data)
    assert wrong.says == "spoofed"
    assert wrong.directions == right.directions == ()


def test_unknown_attitude_and_lines_come_from_the_sky_itself():
    records = move_two()
    (phases,) = records.array_phases
    unknown = take_first(replace(phases, phase_cyc=phases.phase_cyc + np.array([0.0, 0.3, -0.2])), calibrated=False)
    words, _ = examine_records(
        replace(records, array_phases=(unknown,), nav_state={}, sets=(make_set(0, 1, 4, 5, 6, 7),)),
    )
    assert words == {"spoofed": set(SIGNALS[2:4]), "authentic": {*SIGNALS[:2], *SIGNALS[4:]}}


def draw_two_skies(seed):
    """Draw every satellite and, as copy b, one transmitter's signal of each, with unknown lines and attitude."""
    beam = np.broadcast_to(direction_cosines(np.radians(40.0), np.radians(-25.0)), TRUE.shape)
    records, false = (draw_array_records(np.random.default_rng(seed), direction) for direction in (TRUE, beam))
    true_phases, false_phases = (take_first(made.array_phases[0], calibrated=False) for made in (records, false))
    cells = {
        name: np.concatenate([getattr(true_phases, name), getattr(false_phases, name)], 1)
        for name in ("phase_cyc", "sigma_cyc")
    }
    signals = (*true_phases.signals, *(replace(signal, copy="b") for signal in false_phases.signals))
    phases = replace(true_phases, signals=signals, carrier_hz=np.tile(true_phases.carrier_hz, 2), **cells)
    return replace(records, array_phases=(phases,), nav_state={}, sets=(make_set(*range(len(SIGNALS))),))


@pytest.mark.parametrize("seed", range(3))
def test_rare_alarms_let_no_false_signal_into_the_fit(seed):
    # A gate of one in 10^9 is so wide that some of the transmitter's signals are within it by chance.
    words, _ = examine_records(draw_two_skies(seed), false_alarm_probability=1e-8)
    copies = {word: {signal.copy for signal in words[word]} for word in ("spoofed", "authentic")}
    assert copies == {"spoofed": {"b"}, "authentic": {"a"}}
    assert min(len(words["authentic"]), len(words["spoofed"])) > 5


def test_without_an_ephemeris_of_any_satellite_it_says_so():
    records = draw_array_records(np.random.default_rng(10))
    late = make_nominal_constellation(START + np.timedelta64(40, "D"))
    (finding,), _ = InsArray(IDEAL).examine(Records(**(vars(records) | {"navigation": late})))
    assert (finding.says, finding.code) == ("undecided", "no_signal")
