"""The receiver's own fixes: what no platform does fails, and everything that one can do does not."""

import numpy as np
import pytest

from skyproof.detectors.own_fixes.detector import OwnFixes, OwnFixesSettings, chance_of_jumps
from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.records import Cause, ReceiverFixes, Records

START = np.datetime64("2024-02-05T12:00:00", "ns")
HOME = ecef_from_geodetic(np.radians(47.5), np.radians(8.5), 400.0)


def make_fixes(t_s, position_ecef_m, sigma_m: float = np.nan) -> ReceiverFixes:
    n = len(t_s)
    none = np.full(n, np.nan)
    return ReceiverFixes(
        gpst=START + np.round(np.asarray(t_s) * 1e9).astype("m8[ns]"),
        position_ecef_m=np.asarray(position_ecef_m),
        velocity_ecef_m_s=np.full((n, 3), np.nan),
        horizontal_sigma_m=np.full(n, sigma_m),
        vertical_sigma_m=none,
        clock_bias_s=none,
        clock_drift=none,
        satellites=np.full(n, 9, np.int64),
    )


def make_records(fixes: ReceiverFixes) -> Records:
    return Records(start_gpst=START, end_gpst=START + np.timedelta64(60, "s"), own_fixes={"rx": fixes})


def examine_attack(t_s, position_ecef_m, sigma_m: float = np.nan, **settings):
    detector = OwnFixes(OwnFixesSettings(false_alarm_probability=1e-6, **settings))
    ((evidence,), _) = detector.examine(make_records(make_fixes(t_s, position_ecef_m, sigma_m)))
    return evidence


def draw_standing(n: int, seed: int = 1) -> np.ndarray:
    return HOME + np.random.default_rng(seed).normal(0.0, 5.0, (n, 3))


def test_a_receiver_that_stands_or_flies_is_clean() -> None:
    t_s = np.arange(60.0)
    assert examine_attack(t_s, draw_standing(60)).says == "clean"
    turn = HOME + 4000.0 * np.stack([np.cos(t_s / 9.5), np.sin(t_s / 9.5), 0.0 * t_s], axis=1)  # 420 m/s, 4.5 g
    evidence = examine_attack(t_s, turn)
    assert (evidence.says, evidence.p_value) == ("clean", 1.0)


def test_a_jump_of_kilometres_fails_and_is_dated() -> None:
    places = draw_standing(60)
    places[30:, 0] += 5000.0
    evidence = examine_attack(np.arange(60.0), places)
    assert (evidence.says, evidence.code, evidence.overrules) == ("undecided", "jumps", True)
    assert evidence.may_also_be == (Cause.FAULT,)
    assert evidence.data["jump_m"] == pytest.approx(5000.0, abs=50.0)
    assert evidence.dated_gpst == START + np.timedelta64(30, "s")
    assert evidence.p_value < 1e-6


def test_a_jump_that_the_receiver_may_err_by_is_clean() -> None:
    places = draw_standing(60)
    places[30:, 0] += 300.0
    assert examine_attack(np.arange(60.0), places).says == "clean"
    places[30:, 0] += 5000.0
    assert examine_attack(np.arange(60.0), places, sigma_m=2000.0).says == "clean"


def test_after_a_gap_only_a_bounded_speed_tells() -> None:
    places = draw_standing(20)
    places[10:, 0] += 20_000.0
    t_s = np.append(np.arange(10.0), 60.0 + np.arange(10.0))
    assert examine_attack(t_s, places).says == "clean"
    assert examine_attack(t_s, places, speed_max_m_s=50.0).says == "undecided"


def test_a_jump_between_windows_is_seen() -> None:
    detector = OwnFixes(OwnFixesSettings(false_alarm_probability=1e-6))
    _, state = detector.examine(make_records(make_fixes(np.arange(10.0), draw_standing(10))))
    places = draw_standing(10) + [6000.0, 0.0, 0.0]
    ((evidence,), _) = detector.examine(make_records(make_fixes(10.0 + np.arange(10.0), places)), state)
    assert evidence.dated_gpst == START + np.timedelta64(10, "s")


def test_times_that_do_not_rise_are_left_out() -> None:
    t_s = np.array([0.0, 1.0, 1.0, 2.0, 0.5, 3.0])
    assert examine_attack(t_s, draw_standing(6)).says == "clean"


def test_the_bound_holds_for_errors_as_rare_as_it_says() -> None:
    rng = np.random.default_rng(5)
    t_s = np.arange(200_000.0)
    errors = rng.exponential(20.0, t_s.size)[:, None] * (lambda u: u / np.linalg.norm(u, axis=1)[:, None])(
        rng.normal(size=(t_s.size, 3))
    )
    chances = chance_of_jumps(t_s, HOME + errors, np.full(t_s.size, 20.0), 1e-9, np.inf)
    for rate in (0.3, 0.1, 0.03, 0.01):
        assert np.mean(chances < rate) <= rate


@pytest.mark.parametrize("n", [0, 1, 2])
def test_fewer_than_three_fixes_are_said(n) -> None:
    evidence = examine_attack(np.arange(float(n)), draw_standing(n).reshape(n, 3))
    assert (evidence.says, evidence.code) == ("undecided", "few_own_fixes")
