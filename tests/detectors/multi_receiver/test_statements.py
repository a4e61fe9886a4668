"""Statements of where antennas stand that the signals contradict: a slip, or an attack?"""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.detectors.multi_receiver.detector import MultiReceiver
from skyproof.detectors.multi_receiver.settings import MultiReceiverSettings
from skyproof.gnss.frames import ecef_from_geodetic, rot_enu_ecef
from skyproof.gnss.slips import UNLISTED, list_position_slips
from skyproof.records import Cause
from skyproof.testing import FalseSky, MeasuredScene, TrackErrors

TRUE_M = (24.0, 18.0, 6.0)
DISTANCE_M = float(np.linalg.norm(TRUE_M))
PAIR = {"rx1": (0.0, 0.0, 0.0), "rx2": TRUE_M}
ERRORS = TrackErrors(0.5, 0.0, 0.3)
PLACE_DEG = (57.7012, 11.9321, 52.0)
MEACONER = FalseSky()
CAPTURED = {"sky": ("rx1",), "false": (replace(MEACONER, receivers=("rx2",), shows_enu_m=(60.0, -40.0, 3.0)),)}


def make_windows(*changes, antennas=PAIR):
    rng = np.random.default_rng(0)
    keys = {"antennas_enu_m": antennas, "errors": ERRORS, "place_deg": PLACE_DEG, "epochs": 10}
    return [MeasuredScene(**(keys | change)).records(rng) for change in changes]


def review_all(records, **settings):
    detector = MultiReceiver(MultiReceiverSettings(**settings))
    state, findings = None, []
    for records_of_window in records:
        found, state = detector.examine(records_of_window, state)
        findings += found
    return list(detector.review(findings))


def select_against(evidence):
    return [e for e in evidence if e.says in ("spoofed", "attack")]


def list_codes(evidence):
    (causes,) = {tuple(c.code for c in e.wrong_statements) for e in evidence if e.wrong_statements}
    return causes


@pytest.mark.parametrize(
    ("factor", "code"),
    [
        (1.0 / 0.3048, "feet"),
        (0.3048, "made_feet"),
        (100.0, "centimetres"),
        (2.0, "twice"),
        (0.5, "half"),
        (10.0, "decimal_point"),
    ],
    ids=str,
)
def test_a_distance_with_a_likely_slip_is_named_and_no_attack(factor, code):
    evidence = review_all(make_windows({}, {}), antenna_distance_m=factor * DISTANCE_M)
    assert not select_against(evidence)
    assert code in list_codes(evidence)
    assert {(e.says, e.failed) for e in evidence} == {("undecided", True)}


def test_a_level_distance_for_one_with_height_is_named():
    steep = {"rx1": (0.0, 0.0, 0.0), "rx2": (9.0, 12.0, 20.0)}
    evidence = review_all(make_windows({}, {}, antennas=steep), antenna_distance_m=15.0)
    assert not select_against(evidence)
    assert "level_distance" in list_codes(evidence)


@pytest.mark.parametrize(
    ("stated_m", "code"),
    [
        ((18.0, 24.0, -6.0), "north_east_down"),
        ((18.0, 24.0, 6.0), "east_and_north_swapped"),
        ((-24.0, 18.0, 6.0), "east_sign"),
        ((-24.0, -18.0, -6.0), "receivers_swapped"),
        ((24.0, 18.0, 46.0), "height"),
        ((0.0, 30.0, 6.0), "attitude_or_axes"),
    ],
    ids=str,
)
def test_places_with_a_likely_slip_are_named_and_no_attack(stated_m, code):
    evidence = review_all(make_windows({}, {}), antennas_enu_m={"rx1": (0.0, 0.0, 0.0), "rx2": stated_m})
    assert not select_against(evidence)
    assert code in list_codes(evidence)


@pytest.mark.parametrize("code", ["height_above_sea_level", "height_in_feet", "degrees_and_minutes"])
def test_a_position_slip_is_named_with_the_right_value(code):
    lat, lon, height_m = PLACE_DEG
    here_m = ecef_from_geodetic(np.radians(lat), np.radians(lon), height_m)
    rot = rot_enu_ecef(np.radians(lat), np.radians(lon))
    stated_m = {"rx1": here_m, "rx2": here_m + rot.T @ TRUE_M}
    if code == "degrees_and_minutes":
        stated_m["rx2"] = ecef_from_geodetic(np.radians(57.42), np.radians(11.56), height_m)
    # What was stated is such that the slip gives the truth.
    for _ in range(200):
        (slip,) = (s for s in list_position_slips(stated_m["rx2"]) if s.code == code)
        stated_m["rx2"] = stated_m["rx2"] - (slip.position_ecef_m - here_m - rot.T @ TRUE_M)
    places = {name: tuple(rot @ (place - here_m)) for name, place in stated_m.items()}
    evidence = review_all(make_windows({}, {}), antennas_enu_m=places, positions_ecef_m=stated_m)
    assert not select_against(evidence)
    assert code in list_codes(evidence)
    (cause,) = {c for e in evidence for c in e.wrong_statements if c.code == code}
    assert cause.about == "position of rx2"
    assert cause.value


def test_a_distance_that_is_wrong_by_any_amount_is_no_attack():
    evidence = review_all(make_windows({}, {}), antenna_distance_m=1.37 * DISTANCE_M)
    assert not select_against(evidence)
    assert list_codes(evidence) == (UNLISTED,)


def test_a_statement_that_was_borne_out_makes_the_rest_an_attack():
    for order in ([{}, CAPTURED], [CAPTURED, {}]):
        evidence = review_all(make_windows(*order), antennas_enu_m=PAIR)
        assert {e.says for e in evidence} == {"authentic", "attack"}


def test_a_captured_receiver_within_a_slip_is_never_authentic():
    evidence = review_all(make_windows(CAPTURED, CAPTURED), antennas_enu_m=PAIR)
    assert {(e.says, e.failed, e.overrules) for e in evidence} == {("undecided", True, True)}


def test_a_receiver_that_is_led_far_away_is_attacked():
    # Farther than antennas may stand apart, and than a slip makes of the distance.
    far = replace(CAPTURED["false"][0], shows_enu_m=(700.0, 500.0, 30.0))
    evidence = review_all(make_windows({**CAPTURED, "false": (far,)}), antenna_distance_m=DISTANCE_M)
    assert {e.says for e in evidence} == {"attack"}


def test_antennas_turned_since_stated_are_no_attack():
    turned = {"antennas_enu_m": {"rx1": (0.0, 0.0, 0.0), "rx2": (-18.0, 24.0, 6.0)}}
    evidence = review_all(make_windows({}, turned), antennas_enu_m=PAIR)
    assert [e.says for e in evidence] == ["authentic", "undecided"]
    assert list_codes(evidence) == ("attitude_or_axes",)


@pytest.mark.parametrize("carriers", [False, True])
def test_one_transmitter_is_named_where_carriers_show_one_place(carriers):
    with_both = make_windows(*2 * [{"sky": (), "false": (MEACONER,)}])
    if not carriers:
        without = [
            [replace(o, carrier_cyc=np.full_like(o.carrier_cyc, np.nan)) for o in r.observations] for r in with_both
        ]
        with_both = [replace(r, observations=tuple(bare)) for r, bare in zip(with_both, without, strict=True)]
    evidence = review_all(with_both, antennas_enu_m=PAIR)
    assert {e.says for e in evidence} == ({"spoofed"} if carriers else {"undecided"})
    assert all(e.failed for e in evidence) != carriers


NEAR = {"rx1": (0.0, 0.0, 0.0), "rx2": (1.0, 0.6, 0.2)}
NEAR_M = float(np.linalg.norm(NEAR["rx2"]))
CAREFUL = {"false_alarm_probability": 1e-8, "carrier_multipath_sigma_m": 0.001}


@pytest.mark.parametrize(
    ("stated", "code"),
    [
        ({"antenna_distance_m": NEAR_M}, None),
        ({"antenna_distance_m": 0.3048 * NEAR_M}, "made_feet"),
        ({"antenna_distance_m": 0.5 * NEAR_M}, "half"),
        ({"antennas_enu_m": NEAR}, None),
        ({"antennas_enu_m": NEAR | {"rx2": (3.2808, 1.9685, 0.6562)}}, "feet"),
        ({"antennas_enu_m": NEAR | {"rx2": (1.0, -0.6, 0.2)}}, "north_sign"),
    ],
    ids=["right distance", "made feet", "half", "right places", "feet", "north"],
)
def test_carriers_of_near_antennas_name_the_slip(stated, code):
    # Code could be of one antenna: the word stays open, no test fails, and what may be wrong is named.
    sigma = {"antenna_distance_sigma_m": 0.01} if "antenna_distance_m" in stated else {"antennas_sigma_m": 0.02}
    evidence = review_all(make_windows({}, {}, antennas=NEAR), **stated, **sigma, **CAREFUL)
    named = {cause.code for e in evidence for cause in e.wrong_statements}
    assert (code in named) if code else not named
    assert not any(e.failed for e in evidence)


def test_code_that_contradicts_a_statement_names_it():
    apart = {"rx1": (0.0, 0.0, 0.0), "rx2": (7.0, 4.0, 1.0)}
    both_windows = make_windows({}, {}, antennas=apart)
    without = [
        [replace(o, carrier_cyc=np.full_like(o.carrier_cyc, np.nan)) for o in r.observations] for r in both_windows
    ]
    both_windows = [replace(r, observations=tuple(bare)) for r, bare in zip(both_windows, without, strict=True)]
    distance_m = float(np.linalg.norm(apart["rx2"]))
    evidence = review_all(both_windows, antenna_distance_m=10.0 * distance_m, false_alarm_probability=1e-30)
    assert {(e.says, e.failed) for e in evidence} == {("undecided", False)}
    assert "decimal_point" in list_codes(evidence)
    assert not any(
        e.wrong_statements
        for e in review_all(both_windows, antenna_distance_m=distance_m, false_alarm_probability=1e-30)
    )


@pytest.mark.parametrize(("least_m", "fails"), [(0.5 * DISTANCE_M, False), (300.0, True)])
def test_antennas_nearer_than_they_are_said_to_be_at_least_fail(least_m, fails):
    # Signals that are surely not of one antenna passed before, however near they put the antennas.
    evidence = review_all(make_windows({}, {}), antenna_separation_m=least_m, max_separation_m=1000.0)
    assert {(e.says, e.failed) for e in evidence} == {("undecided", fails)}
    assert {cause.about for e in evidence for cause in e.wrong_statements} == (
        {"antenna_separation_m"} if fails else set()
    )


NOT_FAR = {"rx1": (0.0, 0.0, 0.0), "rx2": (4.0, 3.0, 0.0)}
ONE_LED_AWAY = {"sky": ("rx1",), "false": (replace(MEACONER, receivers=("rx2",), shows_enu_m=(150.0, -80.0, 3.0)),)}


@pytest.mark.parametrize("stated", [{"antennas_enu_m": NOT_FAR}, {"antenna_distance_m": 5.0}], ids=["places", "far"])
def test_antennas_that_stood_as_stated_before_leave_an_attack(stated):
    # Code of antennas 5 m apart proves no window authentic, but shows that they did not stand elsewhere all along.
    evidence = review_without_carriers([{}, ONE_LED_AWAY], **stated)
    assert [e.says for e in evidence] == ["undecided", "attack"]
    assert evidence[0].p_value >= 1e-3
    assert evidence[1].p[Cause.STATEMENT] < 1e-6


@pytest.mark.parametrize("stated", [{"antennas_enu_m": NOT_FAR}, {"antenna_distance_m": 5.0}], ids=["places", "far"])
@pytest.mark.parametrize(
    "places_m", [((150.0, -80.0, 3.0), (150.0, -80.0, 3.0)), ((150.0, 9.0, 3.0), (90.0, 9.0, 3.0))]
)
def test_antennas_that_never_stood_as_stated_leave_the_statement(stated, places_m):
    windows = [{"antennas": {"rx1": (0.0, 0.0, 0.0), "rx2": place_m}} for place_m in places_m]
    evidence = review_without_carriers(windows, **stated)
    assert not select_against(evidence)
    assert list_codes(evidence) == (UNLISTED,)


def review_without_carriers(windows, **stated):
    made = [make_windows(window, antennas=window.pop("antennas", NOT_FAR))[0] for window in map(dict, windows)]
    bare = [
        replace(
            r, observations=tuple(replace(o, carrier_cyc=np.full_like(o.carrier_cyc, np.nan)) for o in r.observations)
        )
        for r in made
    ]
    return review_all(bare, false_alarm_probability=1e-6, **stated)
