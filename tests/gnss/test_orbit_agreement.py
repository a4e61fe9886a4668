"""Orbits of one satellite held against each other, and numbers that no message holds."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.gnss.ephemeris import GlonassEphemeris
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.orbit_agreement import find_contradicted
from skyproof.gnss.orbit_faults import find_orbit_fault
from skyproof.gnss.time import gpst

FIRST = make_nominal_constellation(gpst(2300, 7200.0)).ephemerides[0]
GLONASS = GlonassEphemeris(  # R10 of KMS3, 8 June 2022
    sat="R10",
    week=2213,
    toe=294318.0,
    tau_n=8.311402052641e-05,
    gamma_n=9.094947017729e-13,
    frequency_number=-7,
    position_m=(2.373835986328e7, 9.180367187500e6, -2.194117675781e6),
    velocity_m_s=(-2.325544357300e2, -2.452783584595e2, -3.543992996216e3),
    acceleration_m_s2=(9.313225746155e-7, -9.313225746155e-7, 9.313225746155e-7),
)


def follow(ephemeris, hours):
    """Describe the same orbit by a data set of a later time."""
    later_s = 3600.0 * hours
    mean_motion = np.sqrt(3.986005e14) / ephemeris.sqrt_a**3 + ephemeris.delta_n
    return replace(
        ephemeris,
        toe=ephemeris.toe + later_s,
        toc=ephemeris.toc + later_s,
        m0=ephemeris.m0 + mean_motion * later_s,
        # in the frame that the week began with the node moves by its own rate alone
        omega0=ephemeris.omega0 + ephemeris.omega_dot * later_s,
        i0=ephemeris.i0 + ephemeris.idot * later_s,
        af0=ephemeris.af0 + ephemeris.af1 * later_s + ephemeris.af2 * later_s**2,
        af1=ephemeris.af1 + 2.0 * ephemeris.af2 * later_s,
    )


SETS = tuple(follow(FIRST, hours) for hours in (0, 2, 4))


def test_data_sets_of_one_orbit_agree():
    assert find_contradicted(SETS) == {}


@pytest.mark.parametrize(
    "change",
    [{"af0": 1e-6}, {"af1": 3e-10}, {"m0": 1e-5}, {"sqrt_a": 0.02}, {"omega0": 1e-5}],
    ids=lambda change: next(iter(change)),
)
@pytest.mark.parametrize("which", [0, 1, 2])
def test_the_one_that_contradicts_two_is_named(change, which):
    ((name, by),) = change.items()
    sets = list(SETS)
    sets[which] = replace(sets[which], **{name: getattr(sets[which], name) + by})
    assert set(find_contradicted(sets)) == {which}


def test_of_two_alone_that_differ_neither_is_believed():
    assert set(find_contradicted((FIRST, replace(FIRST, m0=FIRST.m0 + 1e-4)))) == {0, 1}


def test_of_two_for_one_time_the_neighbours_tell():
    wrong = replace(SETS[1], m0=SETS[1].m0 + 1e-4)
    assert set(find_contradicted((*SETS, wrong))) == {3}


def test_equal_copies_and_the_unhealthy_say_nothing():
    assert find_contradicted((FIRST, FIRST, replace(FIRST, health=63, m0=FIRST.m0 + 1.0))) == {}


def test_a_glonass_orbit_with_another_one_is_named():
    wrong = replace(GLONASS, position_m=tuple(1.001 * x for x in GLONASS.position_m))
    assert find_orbit_fault(GLONASS) is None
    assert set(find_contradicted((GLONASS, wrong))) == {0, 1}


@pytest.mark.parametrize(
    "change",
    [
        {"e": 1.2},
        {"sqrt_a": 515.3},
        {"af0": 0.01},
        {"af1": 1e-8},
        {"crs": 2e3},
        {"cuc": 1e-3},
        {"tgd": 1e-6},
        {"delta_n": 1e-6},
        {"toc": FIRST.toc + 3600.0},
        {"toc_week": FIRST.toc_week - 1},
    ],
    ids=lambda change: "-".join(change),
)
def test_what_no_message_holds_is_a_fault(change):
    assert find_orbit_fault(FIRST) is None
    assert find_orbit_fault(replace(FIRST, **change)) is not None


@pytest.mark.parametrize(
    "change",
    [
        {"tau_n": 0.01},
        {"gamma_n": 1e-8},
        {"acceleration_m_s2": (1e-3, 0.0, 0.0)},
        {"velocity_m_s": (0.0, 0.0, 0.0)},
        {"velocity_m_s": (4e3, 4e3, 4e3)},
        {"position_m": (0.0, 0.0, 0.0)},
    ],
    ids=lambda change: "-".join(change),
)
def test_what_no_glonass_message_holds_is_a_fault(change):
    assert find_orbit_fault(replace(GLONASS, **change)) is not None
