from collections import Counter
from itertools import combinations_with_replacement, groupby

import numpy as np
import pytest

from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.signals import (
    GPS_L1_CA,
    GPS_SATS,
    PLANS,
    SignalPlan,
    carrier_hz_of,
    frequency_number_of,
    plan_of,
    prn_of,
    sat_name,
    service_of,
)
from skyproof.records import SignalId


def test_the_signal_is_described_in_one_place():
    assert GPS_L1_CA.code(7).shape == (GPS_L1_CA.code_length,)
    assert GPS_L1_CA.period_s == pytest.approx(1e-3, abs=1e-18)
    assert GPS_L1_CA.carrier_hz / GPS_L1_CA.chip_rate_hz == 1540.0  # IS-GPS-200N, 3.3.1.1: both from 10.23 MHz
    assert GPS_L1_CA.periods_per_symbol == 20


def test_the_highest_side_lobe_is_that_of_the_codes():
    # Of any two, at any delay: Gold codes have three values.
    codes = np.fft.rfft([GPS_L1_CA.code(prn_of(sat)) for sat in GPS_SATS[:8]])
    beside = [
        np.fft.irfft(codes[a] * codes[b].conj(), GPS_L1_CA.code_length)[int(a == b) :]
        for a, b in combinations_with_replacement(range(len(codes)), 2)
    ]
    highest = max(float(np.max(np.abs(part))) for part in beside) / GPS_L1_CA.code_length
    assert highest == pytest.approx(GPS_L1_CA.highest_side_lobe)


@pytest.mark.parametrize("plan", PLANS, ids=lambda plan: plan.name)
def test_a_symbol_is_whole_code_periods(plan: SignalPlan):
    if plan.symbol_s:
        assert plan.periods_per_symbol >= 1
        assert plan.periods_per_symbol * plan.period_s == pytest.approx(plan.symbol_s)
    assert plan.chip_m * plan.chip_rate_hz == pytest.approx(SPEED_OF_LIGHT_M_S)


def test_signals_of_a_band_share_a_carrier_and_not_a_name():
    by_band = groupby(sorted(PLANS, key=lambda plan: plan.band), key=lambda plan: plan.band)
    for _, plans in by_band:
        assert len({(plan.carrier_hz, plan.carrier_step_hz) for plan in plans}) == 1
    named = Counter((plan.systems, plan.band, code) for plan in PLANS for code in plan.codes)
    assert max(named.values()) == 1


def test_carriers_and_numbers_of_glonass_agree():
    assert carrier_hz_of("G1", -7) == 1598.0625e6
    assert np.isnan(carrier_hz_of("G1"))
    assert [frequency_number_of("G2", carrier_hz_of("G2", k)) for k in range(-7, 7)] == list(range(-7, 7))
    assert frequency_number_of("L1", 1575.42e6) is None


@pytest.mark.parametrize(
    ("signal", "chip_m"),
    [
        (SignalId("G01"), 293.05),
        (SignalId("G01", "L5", "Q"), 29.305),
        (SignalId("G01", "L2", "W"), 29.305),
        (SignalId("G01", "L2", "L"), 293.05),
        (SignalId("R01", "G1", "CA"), 586.68),
        (SignalId("R01", "G2", "P"), 58.668),
        (SignalId("E01", "E6", "C"), 58.610),
        (SignalId("C20", "B1", "2I"), 146.53),
        (SignalId("C20", "B3", "6I"), 29.305),
        (SignalId("I02", "L5", "A"), 293.05),  # of NavIC's standard service, beside L5 of all others
        (SignalId("J02", "L5", "Q"), 29.305),
    ],
)
def test_a_signal_knows_its_chip(signal: SignalId, chip_m: float):
    assert signal.plan.chip_m == pytest.approx(chip_m, rel=1e-4)
    assert signal.plan.carrier_hz == pytest.approx(carrier_hz_of(signal.band, 0))


def test_a_code_without_a_plan_has_the_chips_of_its_band():
    assert plan_of("E", "E6", "Z").chip_m == plan_of("E", "E6", "C").chip_m
    assert plan_of("E", "E6", "Z").codes == ("Z",)
    with pytest.raises(ValueError, match=r"'L9' .*\bB1, "):
        plan_of("G", "L9", "X")


def test_names_and_numbers_of_satellites_agree():
    assert [prn_of(sat) for sat in GPS_SATS] == list(range(1, 33))
    assert tuple(sat_name(prn) for prn in range(1, 33)) == GPS_SATS
    assert prn_of("G5") == 5
    assert [prn_of(sat) for sat in ("J01", "S20", "S58", "E36", "C63", "R01", "I14")] == [193, 120, 158, 36, 63, 1, 14]


@pytest.mark.parametrize("sat", ["G00", "G33", "E37", "S19", "J11", "5", "", "G005", "g05", "X01"])
def test_a_name_that_is_no_satellite_is_refused(sat):
    with pytest.raises(ValueError, match=r"\bG01 to G32, "):
        prn_of(sat)


@pytest.mark.parametrize("prn", [0, 33])
def test_a_number_that_is_no_gps_satellite_is_refused(prn):
    with pytest.raises(ValueError, match="is not a GPS satellite"):
        sat_name(prn)


def test_codes_of_one_signal_are_one_service_and_others_are_not():
    assert service_of("E", "E1", "C") == service_of("E", "E1", "X") == service_of("E", "E1", "B")
    assert service_of("G", "L2", "L") == service_of("G", "L2", "X")
    assert service_of("G", "L2", "W") != service_of("G", "L2", "L")
    assert service_of("G", "L1", "CA") != service_of("G", "L1", "X")
    assert service_of("C", "B1C", "1P") == service_of("C", "B1C", "1X")
    assert service_of("E", "E1", "A") not in (service_of("E", "E1", "C"), service_of("E", "E1", "Z"))
