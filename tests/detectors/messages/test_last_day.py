"""Data sets of the day before, carried on: how far an orbit of true forces and a clock go, and what is beyond."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares
from tests.gnss.later import extrapolate_hours

from skyproof.detectors.messages.last_day import (
    clock_sigma_m,
    difference_over_hours,
    is_of_last_day,
    orbit_bound_m,
)
from skyproof.detectors.messages.policy import POLICY
from skyproof.gnss.constants import EARTH_ROTATION_RAD_S, MU_M3_S2, SPEED_OF_LIGHT_M_S
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.orbits import compute_satellite_state
from skyproof.gnss.time import timedelta_from_s

SENT = replace(make_nominal_constellation(np.datetime64("2024-05-14T10:00:00", "ns")).ephemerides[0], ura_index=0)
MOON_M3_S2, MOON_M = 4.903e12, 3.633e8  # at its nearest
SUN_M3_S2, SUN_M = 1.3271e20, 1.471e11
EARTH_M, J2 = 6.378137e6, 1.0826e-3


def shift_time(hours: float):
    return extrapolate_hours(SENT, hours)


def pull_m_s2(t_s: float, state: np.ndarray, moon_rad: float) -> np.ndarray:
    """Return velocity and acceleration by an oblate Earth, the Moon and the Sun (Montenbruck & Gill, 3.2 and 3.3)."""
    place, velocity = state[:3], state[3:]
    far_m = np.linalg.norm(place)
    flat = 1.5 * J2 * MU_M3_S2 * EARTH_M**2 / far_m**5
    z = 5.0 * place[2] ** 2 / far_m**2
    total = -MU_M3_S2 * place / far_m**3 + flat * place * (z - np.array([1.0, 1.0, 3.0]))
    angle = moon_rad + 2.0 * math.pi * t_s / (27.3 * 86_400.0)
    moon = MOON_M * np.array([math.cos(angle), 0.9 * math.sin(angle), 0.43 * math.sin(angle)])
    sun = SUN_M * np.array([0.6, 0.73, 0.32])
    for mass, body in ((MOON_M3_S2, moon), (SUN_M3_S2, sun)):
        total += mass * ((body - place) / np.linalg.norm(body - place) ** 3 - body / np.linalg.norm(body) ** 3)
    return np.concatenate([velocity, total])


FITTED = ("sqrt_a", "e", "i0", "omega0", "omega", "m0", "delta_n", "idot", "omega_dot")
FITTED += ("crs", "crc", "cus", "cuc", "cis", "cic")
STEPS = dict(zip(FITTED, (1e-2, 1e-6, *[1e-6] * 4, *[1e-10] * 3, 10.0, 10.0, *[1e-6] * 4), strict=True))


@pytest.mark.parametrize("moon_rad", [0.0, 0.9, 2.2, 4.0])
def test_an_orbit_under_moon_and_sun_stays_within_the_bound(moon_rad: float) -> None:
    # Elements are fitted to four hours of it, as the ground segment does, and carried on for a day.
    at_s = np.arange(-7200.0, 86_401.0, 900.0)
    labels = SENT.reference_gpst + timedelta_from_s(at_s)
    fixed = compute_satellite_state(SENT, labels).position_ecef_m[[0, 1]]
    turn = [make_rotation(t) for t in at_s]
    first, second = turn[0].T @ fixed[0], turn[1].T @ fixed[1]
    normal = np.cross(first, second)
    speed_m_s = math.sqrt(1.01 * MU_M3_S2 / np.linalg.norm(first))  # at perigee
    ahead = np.cross(normal, first)
    start = np.concatenate([first, speed_m_s * ahead / np.linalg.norm(ahead)])
    path = solve_ivp(
        pull_m_s2, (at_s[0], at_s[-1]), start, t_eval=at_s, args=(moon_rad,), rtol=1e-11, atol=1e-4, method="DOP853"
    ).y[:3]
    truth_m = np.array([r @ place for r, place in zip(turn, path.T, strict=True)])
    served = at_s <= 7200.0
    since_perigee_rad = 7200.0 * math.sqrt(MU_M3_S2) / SENT.sqrt_a**3
    near = replace(SENT, e=0.01, omega=SENT.omega + SENT.m0 - since_perigee_rad, m0=since_perigee_rad)

    def off_m(steps: np.ndarray, rows: np.ndarray) -> np.ndarray:
        fields = {name: getattr(near, name) + STEPS[name] * x for name, x in zip(FITTED, steps, strict=True)}
        return compute_satellite_state(replace(near, **fields), labels[rows]).position_ecef_m - truth_m[rows]

    found = least_squares(lambda x: off_m(x, served).ravel(), np.zeros(len(FITTED)), x_scale="jac", max_nfev=200)
    assert np.abs(off_m(found.x, served)).max() < 5.0
    apart_m = off_m(found.x, np.ones(at_s.size, bool))
    radial_m = np.einsum("ij,ij->i", apart_m, truth_m) / np.linalg.norm(truth_m, axis=1)
    sideways_m = np.sqrt(np.maximum((apart_m**2).sum(axis=1) - radial_m**2, 0.0))
    range_m = np.hypot(radial_m, POLICY.sideways_share * sideways_m)
    bound_m = np.array([orbit_bound_m(SENT.sqrt_a, abs(t)) for t in at_s])
    assert (range_m < bound_m).all()
    assert range_m.max() > 0.05 * bound_m.max()  # the bound is of that size


def make_rotation(since_s: float) -> np.ndarray:
    """Return what turns places that do not turn with the Earth into those that do."""
    c, s = math.cos(EARTH_ROTATION_RAD_S * since_s), math.sin(EARTH_ROTATION_RAD_S * since_s)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def test_a_set_that_serves_later_is_the_same_orbit() -> None:
    found = difference_over_hours(shift_time(12.0), SENT)
    assert found.chance == 1.0
    assert found.amount_m < 1e-3


@pytest.mark.parametrize(("late_m", "is_found"), [(20.0, False), (400.0, True)])
@pytest.mark.parametrize("hours", [3.0, 24.0])
def test_a_clock_goes_as_far_as_a_rubidium_standard(hours: float, late_m: float, is_found: bool) -> None:
    e = shift_time(hours)
    found = difference_over_hours(replace(e, af0=e.af0 + late_m / SPEED_OF_LIGHT_M_S), SENT)
    assert (found.what, round(found.amount_m)) == ("clock", round(late_m))
    assert (found.chance < 1e-4) == is_found


def test_yesterdays_orbit_with_todays_times_is_far_beyond() -> None:
    # Four minutes of the sidereal day are 930 km along the orbit.
    found = difference_over_hours(replace(SENT, week=shift_time(24.0).week, toe=shift_time(24.0).toe), SENT)
    assert (found.what, found.chance) == ("orbit", 0.0)
    assert found.amount_m > 50.0 * orbit_bound_m(SENT.sqrt_a, 86_400.0)


def test_what_no_accuracy_is_stated_of_is_not_compared() -> None:
    assert difference_over_hours(replace(shift_time(12.0), ura_index=15), SENT) is None


@pytest.mark.parametrize(("hours", "is_compared"), [(1.0, False), (3.0, True), (26.0, True), (27.0, False)])
def test_sets_of_one_day_are_compared(hours: float, is_compared: bool) -> None:
    assert is_of_last_day(shift_time(hours), SENT) == is_compared
    assert not is_of_last_day(replace(shift_time(hours), sqrt_a=6493.4), SENT)
    assert not is_of_last_day(replace(shift_time(hours), message="CNAV"), SENT)


def test_the_clocks_deviation_grows_with_time() -> None:
    assert [round(clock_sigma_m(3600.0 * h)) for h in (3, 12, 24)] == [4, 28, 74]
